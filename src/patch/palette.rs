//! Vectors by patch, each stored once where many patches share it: normals of flat walls, albedos of plain materials.
//!
//! A patch takes 4 bytes in place of 12, none at all where all share one vector; where few do, vectors stand as they are. What is read
//! is what was put in, to the bit.

use glam::Vec3;
use std::ops::Index;

/// Slots of the table in which shared vectors are found again while a palette is made, a power of two. What falls out of it is
/// stored once more.
const SLOTS: usize = 1 << 12;

/// A vector for each patch.
#[derive(Clone, Debug)]
pub struct Palette(Kind);

#[derive(Clone, Debug)]
enum Kind {
    /// All `count` the same.
    One {
        value: Vec3,
        count: usize,
    },
    /// `values[of[i]]`.
    Shared {
        values: Vec<Vec3>,
        of: Vec<u32>,
    },
    Each(Vec<Vec3>),
}

impl Palette {
    /// Number of patches.
    pub fn len(&self) -> usize {
        match &self.0 {
            Kind::One { count, .. } => *count,
            Kind::Shared { of, .. } => of.len(),
            Kind::Each(values) => values.len(),
        }
    }

    /// True without a patch.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The vectors by patch.
    pub fn iter(&self) -> impl Iterator<Item = &Vec3> {
        (0..self.len()).map(|i| &self[i])
    }
}

impl Index<usize> for Palette {
    type Output = Vec3;

    #[inline]
    fn index(&self, patch: usize) -> &Vec3 {
        match &self.0 {
            Kind::One { value, count } => {
                assert!(patch < *count, "patch {patch} of {count}");
                value
            }
            Kind::Shared { values, of } => &values[of[patch] as usize],
            Kind::Each(values) => &values[patch],
        }
    }
}

impl FromIterator<Vec3> for Palette {
    fn from_iter<I: IntoIterator<Item = Vec3>>(values: I) -> Self {
        let mut builder = Builder::default();
        builder.extend(values);
        builder.finish()
    }
}

/// A palette that is being filled, patch by patch in order.
pub(super) struct Builder {
    values: Vec<Vec3>,
    of: Vec<u32>,
    /// Where vectors were put last, by their hash.
    recent: Vec<u32>,
}

impl Default for Builder {
    fn default() -> Self {
        Self { values: Vec::new(), of: Vec::new(), recent: vec![u32::MAX; SLOTS] }
    }
}

impl Extend<Vec3> for Builder {
    fn extend<I: IntoIterator<Item = Vec3>>(&mut self, values: I) {
        for value in values {
            let slot = &mut self.recent[slot(value)];
            let is_known = self.values.get(*slot as usize).is_some_and(|known| is_same(*known, value));
            if !is_known {
                *slot = self.values.len() as u32;
                self.values.push(value);
            }
            self.of.push(*slot);
        }
    }
}

impl Builder {
    /// The palette, in whichever form is the smallest.
    pub fn finish(mut self) -> Palette {
        let count = self.of.len();
        Palette(match self.values[..] {
            [value] => Kind::One { value, count },
            _ if size_of::<Vec3>() * self.values.len() + size_of::<u32>() * count >= size_of::<Vec3>() * count => {
                Kind::Each(self.of.iter().map(|&k| self.values[k as usize]).collect())
            }
            _ => {
                self.values.shrink_to_fit();
                self.of.shrink_to_fit();
                Kind::Shared { values: self.values, of: self.of }
            }
        })
    }
}

fn is_same(a: Vec3, b: Vec3) -> bool {
    a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits)
}

/// Multiplicative hashing by a prime near 2^64 / phi (Knuth 1998, "The Art of Computer Programming", volume 3, section 6.4).
fn slot(value: Vec3) -> usize {
    const PRIME: u64 = 0x9e37_79b9_7f4a_7c15;
    let mix = |hash: u64, bits: u32| (hash ^ u64::from(bits)).wrapping_mul(PRIME).rotate_left(23);
    let hash = value.to_array().map(f32::to_bits).into_iter().fold(0, mix);
    (hash.wrapping_mul(PRIME) >> (64 - SLOTS.trailing_zeros())) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(values: &[Vec3]) -> Palette {
        let palette: Palette = values.iter().copied().collect();
        assert_eq!(palette.len(), values.len());
        assert!(palette.iter().zip(values).all(|(read, put)| is_same(*read, *put)));
        palette
    }

    #[test]
    fn what_is_put_in_is_read() {
        let one = round_trip(&[Vec3::X; 100]);
        assert!(matches!(one.0, Kind::One { .. }));
        let few: Vec<Vec3> = (0..30_000).map(|i| Vec3::new((i % 7) as f32, 0.5, -0.0)).collect();
        assert!(matches!(&round_trip(&few).0, Kind::Shared { values, .. } if values.len() == 7));
        let all: Vec<Vec3> = (0..30_000).map(|i| Vec3::new(i as f32, 1.0, 2.0)).collect();
        assert!(matches!(round_trip(&all).0, Kind::Each(_)));
        assert!(round_trip(&[]).is_empty());
    }

    #[test]
    fn zeros_of_either_sign_and_nan_keep_their_bits() {
        round_trip(&[Vec3::ZERO, -Vec3::ZERO, Vec3::NAN, Vec3::ZERO, Vec3::NAN]);
    }
}
