//! Vectors by patch that are those of another list but for some patches: light about interpolated normals, which is that about
//! geometric ones wherever a wall is flat.
//!
//! A patch takes 3 bits, and 12 bytes where it differs.

use glam::Vec3;
use std::ops::Index;
use std::sync::Arc;

/// A list of vectors by patch, kept as its differences to one that is shared.
#[derive(Clone, Debug)]
pub struct Sparse {
    base: Arc<Vec<Vec3>>,
    /// By 64 patches: which of them differ, and how many do before.
    words: Vec<(u64, u32)>,
    values: Vec<Vec3>,
}

impl Sparse {
    /// The same as `base` throughout.
    pub fn same(base: Arc<Vec<Vec3>>) -> Self {
        Self { base, words: Vec::new(), values: Vec::new() }
    }

    /// `values`, one for each of `base`, to the bit.
    pub fn new(base: Arc<Vec<Vec3>>, values: impl ExactSizeIterator<Item = Vec3>) -> Self {
        assert_eq!(base.len(), values.len(), "vectors of as many patches");
        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
        let mut sparse = Self::same(Arc::clone(&base));
        for (i, value) in values.enumerate() {
            if i % 64 == 0 {
                sparse.words.push((0, sparse.values.len() as u32));
            }
            if bits(value) != bits(base[i]) {
                sparse.words[i / 64].0 |= 1 << (i % 64);
                sparse.values.push(value);
            }
        }
        if sparse.values.is_empty() {
            sparse.words.clear();
        }
        sparse.words.shrink_to_fit();
        sparse.values.shrink_to_fit();
        sparse
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.base.len()
    }

    /// True without a patch.
    pub fn is_empty(&self) -> bool {
        self.base.is_empty()
    }

    /// The vectors by patch.
    pub fn iter(&self) -> impl Iterator<Item = &Vec3> {
        (0..self.len()).map(|i| &self[i])
    }

    /// The vectors by patch, as a list of their own.
    pub fn to_vec(&self) -> Vec<Vec3> {
        self.iter().copied().collect()
    }
}

impl Index<usize> for Sparse {
    type Output = Vec3;

    #[inline]
    fn index(&self, patch: usize) -> &Vec3 {
        match self.words.get(patch / 64) {
            Some((word, before)) if word >> (patch % 64) & 1 == 1 => {
                let below = word & ((1 << (patch % 64)) - 1);
                &self.values[(before + below.count_ones()) as usize]
            }
            _ => &self.base[patch],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_in_is_read() {
        let base: Arc<Vec<Vec3>> = Arc::new((0..1000).map(|i| Vec3::splat(i as f32)).collect());
        let is_other = |i: usize| i == 0 || i == 999 || (130..300).contains(&i) && !i.is_multiple_of(3);
        let values: Vec<Vec3> =
            (0..1000).map(|i| if is_other(i) { Vec3::X * i as f32 - 1.0 } else { base[i] }).collect();
        let sparse = Sparse::new(Arc::clone(&base), values.iter().copied());
        assert_eq!(sparse.to_vec(), values);
        assert_eq!(sparse.values.len(), (0..1000).filter(|&i| is_other(i)).count());
        let same = Sparse::new(Arc::clone(&base), base.iter().copied());
        assert!(same.words.is_empty() && same.to_vec() == *base);
    }
}
