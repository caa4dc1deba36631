//! The direct light of a lamp as it is kept: what it would be at a strength of 1, where there is any, in 24 bits.
//!
//! A bake takes the light as it comes back from here, kept or not: what is read later is what was baked with then, to the bit.

use super::Direct;
use crate::color::Rgb;
use crate::patch::Sparse;
use crate::store::Entry;
use crate::work::Stored;
use glam::DVec3;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Channels that differ by less than this share are one.
const ALIKE: f32 = 1e-5;

/// Bits of a value that are left out.
const CUT: u32 = 8;

/// The direct light of one lamp, or several, at a strength of 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptLight {
    /// About the geometric normal.
    transport: Values,
    /// About the shown one, where it differs.
    shown: Values,
    /// Flux from lights that are no surface [lm].
    inflow: [f64; 3],
    rays: u64,
    /// The mean over each block of patches of what arrived at a first look, and the first patch of each.
    pub means: Vec<Rgb>,
    pub firsts: Vec<u32>,
    /// How many times as much other light there was beside it when it was found.
    pub beside: f64,
}

/// Colours of some of many patches.
#[derive(Clone, Debug, Default, PartialEq)]
struct Values {
    count: u64,
    /// A bit for each patch that has one.
    some: Vec<u64>,
    /// Channels, 1 or 3, of 3 bytes each.
    bytes: Vec<u8>,
}

/// `value` over `strength`, by channel; nothing where there is no strength.
pub fn over(value: Rgb, strength: Rgb) -> Rgb {
    let channel = |k: usize| if strength[k] > 0.0 { value[k] / strength[k] } else { 0.0 };
    Rgb::from_array(std::array::from_fn(channel))
}

/// Means over blocks of what lamps of the strength `strength` cause [lx], at a strength of 1.
pub(super) fn means_over(means: impl Iterator<Item = Rgb>, strength: Rgb) -> Vec<Rgb> {
    means.map(|mean| over(mean, strength)).collect()
}

/// The same for sums.
fn over_strength(sum: DVec3, strength: Rgb) -> DVec3 {
    DVec3::select(strength.cmpgt(Rgb::ZERO), sum / strength.as_dvec3(), DVec3::ZERO)
}

impl KeptLight {
    /// What is kept of `direct`, which lamps of the strength `strength` cause, with `beside` times as much other light around. What arrived
    /// at a first look is told by the first patches of blocks, and the means over these at a strength of 1.
    pub fn new(direct: &Direct, strength: Rgb, (firsts, means): (Vec<u32>, Vec<Rgb>), beside: f64) -> Self {
        let unit = |value: Rgb| over(value, strength);
        let has = strength.cmpgt(Rgb::ZERO);
        let is_lit = |i: usize| direct.transport[i] != Rgb::ZERO;
        let differs =
            |i: usize| direct.shown[i].to_array().map(f32::to_bits) != direct.transport[i].to_array().map(f32::to_bits);
        let count = direct.transport.len();
        Self {
            transport: Values::new(count, is_lit, |i| unit(direct.transport[i]), has),
            shown: Values::new(count, differs, |i| unit(direct.shown[i]), has),
            inflow: over_strength(direct.inflow, strength).to_array(),
            rays: direct.rays,
            means,
            firsts,
            beside,
        }
    }

    /// The means over `blocks` of patches that had other numbers and have `numbers` now: nothing where a block isn't one of then.
    pub fn means_of(&self, numbers: &[u32], blocks: &[Range<usize>]) -> Vec<Rgb> {
        let mut means = vec![Rgb::ZERO; blocks.len()];
        for (first, mean) in self.firsts.iter().zip(&self.means) {
            let now = numbers.get(*first as usize).map(|now| *now as usize);
            if let Some(block) = now.and_then(|now| blocks.binary_search_by_key(&now, |block| block.start).ok()) {
                means[block] = *mean;
            }
        }
        means
    }

    /// The light of lamps of the strength `strength` on so many patches; `None` where this is of others.
    pub fn light(&self, strength: Rgb, patches: usize) -> Option<Direct> {
        let mut transport = vec![Rgb::ZERO; patches];
        self.transport.each(patches, |i, value| transport[i] = value * strength)?;
        let mut shown = transport.clone();
        self.shown.each(patches, |i, value| shown[i] = value * strength)?;
        let transport = Arc::new(transport);
        let shown = match self.shown.bytes.is_empty() && self.shown.some.iter().all(|word| *word == 0) {
            true => Sparse::same(Arc::clone(&transport)),
            false => Sparse::new(Arc::clone(&transport), shown.into_iter()),
        };
        let inflow = DVec3::from_array(self.inflow) * strength.as_dvec3();
        Some(Direct { shown, transport, inflow, rays: self.rays })
    }
}

impl Values {
    /// `value` of those of `count` patches that are `some`; `has` tells the channels that mean anything.
    fn new(count: usize, some: impl Fn(usize) -> bool, value: impl Fn(usize) -> Rgb, has: glam::BVec3) -> Self {
        let mut bits = vec![0u64; count.div_ceil(64)];
        (0..count).filter(|&i| some(i)).for_each(|i| bits[i / 64] |= 1 << (i % 64));
        let values = || (0..count).filter(|&i| bits[i / 64] >> (i % 64) & 1 == 1).map(&value);
        let first = (0..3).find(|&k| has.test(k)).unwrap_or(0);
        let is_grey = |v: Rgb| (0..3).all(|k| !has.test(k) || (v[k] - v[first]).abs() <= ALIKE * v[first].abs());
        let bytes = match values().all(is_grey) {
            true => values().flat_map(|v| cut(v[first])).collect(),
            false => values().flat_map(|v| v.to_array().map(cut)).flatten().collect(),
        };
        Self { count: count as u64, some: bits, bytes }
    }

    /// Calls `take` with each patch and its value; `None` where they are of other than `patches` patches.
    fn each(&self, patches: usize, mut take: impl FnMut(usize, Rgb)) -> Option<()> {
        let some: usize = self.some.iter().map(|word| word.count_ones() as usize).sum();
        let channels = if some == 0 { 0 } else { self.bytes.len() / (3 * some) };
        let is_sound = self.count == patches as u64
            && self.some.len() == patches.div_ceil(64)
            && self.bytes.len() == 3 * some * channels
            && matches!((some, channels), (0, _) | (_, 1 | 3));
        if !is_sound {
            return None;
        }
        let mut values = self.bytes.chunks_exact(3 * channels.max(1)).map(|bytes| match channels {
            1 => Rgb::splat(whole(bytes)),
            _ => Rgb::new(whole(&bytes[..3]), whole(&bytes[3..6]), whole(&bytes[6..])),
        });
        for (k, word) in self.some.iter().enumerate() {
            let mut left = *word;
            while left != 0 {
                let i = 64 * k + left.trailing_zeros() as usize;
                take(i, values.next().filter(|_| i < patches)?);
                left &= left - 1;
            }
        }
        Some(())
    }
}

/// The upper 24 bits of `value`, rounded.
fn cut(value: f32) -> [u8; 3] {
    let bits = value.to_bits();
    let rounded = bits.wrapping_add(1 << (CUT - 1));
    // The largest numbers must not become infinite.
    let bits = if f32::from_bits(rounded).is_finite() { rounded } else { bits };
    let [_, low, middle, high] = bits.to_le_bytes();
    [low, middle, high]
}

/// The value of which the upper 24 bits are `bytes`.
fn whole(bytes: &[u8]) -> f32 {
    f32::from_bits(u32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]))
}

impl Stored for KeptLight {
    fn sections(&self) -> Vec<Cow<'_, [u8]>> {
        let head: Vec<u8> = [self.transport.count, self.shown.count, self.rays]
            .into_iter()
            .chain(self.inflow.into_iter().chain([self.beside]).map(f64::to_bits))
            .flat_map(u64::to_le_bytes)
            .collect();
        let words = |values: &'_ Values| Cow::Owned(bytemuck::cast_slice(&values.some).to_vec());
        vec![
            Cow::Owned(head),
            words(&self.transport),
            Cow::Borrowed(&self.transport.bytes),
            words(&self.shown),
            Cow::Borrowed(&self.shown.bytes),
            Cow::Borrowed(bytemuck::cast_slice(&self.means)),
            Cow::Borrowed(bytemuck::cast_slice(&self.firsts)),
        ]
    }

    fn restore(entry: &Entry) -> Option<Self> {
        let &[lit, differing, rays, ref numbers @ ..] = entry.slice::<u64>(0).ok()? else { return None };
        let numbers: Vec<f64> = numbers.iter().map(|bits| f64::from_bits(*bits)).collect();
        let &[x, y, z, beside] = &numbers[..] else { return None };
        let values = |count: u64, k: usize| {
            Some(Values { count, some: entry.slice::<u64>(k).ok()?.to_vec(), bytes: entry.section(k + 1).to_vec() })
        };
        Some(Self {
            transport: values(lit, 1)?,
            shown: values(differing, 3)?,
            inflow: [x, y, z],
            rays,
            means: entry.slice::<Rgb>(5).ok()?.to_vec(),
            firsts: entry.slice::<u32>(6).ok()?.to_vec(),
            beside,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direct(value: impl Fn(usize) -> Rgb) -> Direct {
        let transport: Arc<Vec<Rgb>> = Arc::new((0..1000).map(&value).collect());
        let shown = (0..1000).map(|i| if i % 7 == 3 { 0.5 * value(i) } else { value(i) });
        let shown = Sparse::new(Arc::clone(&transport), shown.collect::<Vec<_>>().into_iter());
        Direct { shown, transport, inflow: DVec3::new(3.0, 2.0, 0.0), rays: 12 }
    }

    #[test]
    fn light_comes_back_at_another_strength() {
        let strength = Rgb::new(3.0, 2.0, 0.0);
        let shape = |i: usize| if i.is_multiple_of(3) { 0.0 } else { 1.0 / (1.0 + i as f32) };
        let grey = KeptLight::new(&direct(|i| strength * shape(i)), strength, (vec![0], vec![Rgb::ONE]), 2.0);
        assert_eq!(grey.transport.bytes.len(), 3 * (0..1000).filter(|i| i % 3 != 0).count(), "one channel does");
        let other = Rgb::new(1.0, 5.0, 0.0);
        let light = grey.light(other, 1000).unwrap();
        for i in 0..1000 {
            let expected = other * shape(i);
            assert!((light.transport[i] - expected).abs().max_element() <= 2e-5 * expected.max_element(), "{i}");
            let expected = if i % 7 == 3 { 0.5 * expected } else { expected };
            assert!((light.shown[i] - expected).abs().max_element() <= 2e-5 * expected.max_element(), "{i}");
        }
        assert!((light.inflow - DVec3::new(1.0, 5.0, 0.0)).abs().max_element() < 1e-12);
        assert!(grey.light(other, 999).is_none(), "of other patches");
        let tinted =
            KeptLight::new(&direct(|i| Rgb::new(1.0, 0.5, 0.25) * shape(i)), Rgb::ONE, Default::default(), 0.0);
        let light = tinted.light(Rgb::ONE, 1000).unwrap();
        assert!((light.transport[1] - Rgb::new(0.5, 0.25, 0.125)).abs().max_element() < 1e-5);
    }

    #[test]
    fn numbers_keep_24_bits() {
        for value in [0.0, 1.0, 0.1, 1e-30, 6.5e4, f32::MAX, f32::MIN_POSITIVE] {
            assert!((whole(&cut(value)) - value).abs() <= 2e-5 * value, "{value}");
        }
    }
}
