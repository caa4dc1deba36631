//! Direct light on the backs of surfaces, which no texel shows but others see: found lamp by lamp, at a strength of 1, and remembered.
//!
//! What a lamp brings to a back depends on nothing but the lamp and what stands in its way, so that other strengths and albedos trace
//! nothing, and after a change those backs alone are looked at anew which it can touch.

use super::SHARE;
use super::bits::{BitReader, BitWriter};
use super::shoot::Draw;
use crate::Result;
use crate::color::Rgb;
use crate::light::direct::DirectParams;
use crate::light::kept::over;
use crate::light::touched::{Shafts, keeps_links};
use crate::light::{Lights, Lit, Shining};
use crate::patch::{Ground, NONE};
use crate::progress::Progress;
use crate::store::{Entry, Key};
use crate::work::{Stored, Work};
use glam::Vec3;
use rayon::prelude::*;
use std::borrow::Cow;

/// Patches over which the direct light of a back is averaged.
const BACK_PATCHES: usize = 8;

/// The kind of results that direct light on backs is.
const BACKS: &str = "backs";

/// Lamps whose direct light is found on its own.
#[derive(Default)]
pub struct BackLamps(Vec<Unit>);

/// What a unit of lamps is told by.
pub struct Told {
    pub shining: Vec<Shining>,
    /// What its light at a strength of 1 depends on, beside what all results do.
    pub key: Key,
    /// What its light is a multiple of.
    pub strength: Rgb,
}

struct Unit {
    key: Key,
    lights: Lights,
    params: DirectParams,
    strength: Rgb,
    known: Known,
    /// What was known before a change, and what of it the change can touch.
    before: Option<(Known, Shafts)>,
    /// More is known than is kept.
    is_new: bool,
}

/// Values by number, ascending.
#[derive(Clone, Debug)]
pub struct List<V> {
    keys: Vec<u32>,
    values: Vec<V>,
}

impl<V> Default for List<V> {
    fn default() -> Self {
        Self { keys: Vec::new(), values: Vec::new() }
    }
}

impl<V: Copy> List<V> {
    /// The same with the numbers that they have now; those that have none go.
    fn renumbered(&self, numbers: &[u32]) -> Self {
        let now = |(key, value)| Some((numbers.get(key as usize).copied().filter(|now| *now != NONE)?, value));
        let mut all: Vec<(u32, V)> = self.iter().filter_map(now).collect();
        all.sort_unstable_by_key(|(key, _)| *key);
        let (keys, values) = all.into_iter().unzip();
        Self { keys, values }
    }

    /// The numbers.
    pub fn keys(&self) -> &[u32] {
        &self.keys
    }

    /// Numbers and values, in order.
    pub fn iter(&self) -> impl Iterator<Item = (u32, V)> {
        self.keys.iter().copied().zip(self.values.iter().copied())
    }

    /// The values of `keys`, ascending, where there are any.
    pub fn get(&self, keys: &[u32]) -> Vec<Option<V>> {
        let mut own = self.iter().peekable();
        let find = |key: &u32| {
            while own.next_if(|(k, _)| k < key).is_some() {}
            own.peek().filter(|(k, _)| k == key).map(|(_, value)| *value)
        };
        keys.iter().map(find).collect()
    }

    /// Adds values by numbers, ascending, in place of those that there are.
    pub fn add(&mut self, others: impl Iterator<Item = (u32, V)>) {
        let old = std::mem::take(self);
        let mut old = old.iter().peekable();
        for (key, value) in others {
            while let Some((k, v)) = old.next_if(|(k, _)| *k < key) {
                self.push(k, v);
            }
            old.next_if(|(k, _)| *k == key);
            self.push(key, value);
        }
        old.for_each(|(k, v)| self.push(k, v));
    }

    fn push(&mut self, key: u32, value: V) {
        self.keys.push(key);
        self.values.push(value);
    }
}

/// Direct light on backs at a strength of 1 [lx].
#[derive(Default)]
struct Known {
    of_patch: List<[Rgb; 1]>,
    /// By the first patch of each block: the mean over it from all lamps, and from those that are no surface.
    of_block: List<[Rgb; 2]>,
}

impl Known {
    fn renumbered(&self, numbers: &[u32]) -> Self {
        Self { of_patch: self.of_patch.renumbered(numbers), of_block: self.of_block.renumbered(numbers) }
    }
}

/// Finds the light of one of several backs from each of several lots of lamps, and the rays that took.
type Trace<'a, const N: usize> = dyn Fn(usize, &[(&Lights, &DirectParams)]) -> Vec<([Rgb; N], u64)> + Sync + 'a;

/// Which of the two lists of what is known is meant.
type Of<const N: usize> = fn(&mut Known) -> &mut List<[Rgb; N]>;

impl BackLamps {
    /// Those of `units`, with what is remembered of them.
    ///
    /// # Errors
    /// `Io`.
    pub fn recall(lit: &Lit, units: Vec<Told>, work: &Work) -> Result<Self> {
        let recall = |(number, told): (u32, Told)| {
            let Told { shining, key, strength } = told;
            let lights = Lights::of(lit.ground.scene, |one| shining.contains(&one));
            let found = work.find(BACKS, |hasher| hasher.add_key(key))?;
            let before = match &found {
                Some(_) => None,
                None => work.find_before(BACKS, |hasher| hasher.add_key(key))?,
            };
            let before = before.filter(|(_, change)| keeps_links(lit.ground.scene, &shining, change));
            let before = before.and_then(|(known, change): (Known, _)| {
                let numbers = change.numbers(&lit.ground.runs())?;
                Some((known.renumbered(&numbers), Shafts::new(&lights, change)?))
            });
            let params = DirectParams { unit: number, ..params_of_backs(lit.params) };
            let (is_new, known) = (found.is_none(), found.unwrap_or_default());
            Ok(Unit { key, lights, params, strength, known, before, is_new })
        };
        (0..).zip(units).map(recall).collect::<Result<_>>().map(Self)
    }

    /// Keeps what has become known.
    ///
    /// # Errors
    /// `Io` where others wait for it.
    pub fn keep(&mut self, work: &Work) -> Result<()> {
        for unit in self.0.iter_mut().filter(|unit| unit.is_new) {
            work.keep(BACKS, |hasher| hasher.add_key(unit.key), &unit.known)?;
            unit.is_new = false;
        }
        Ok(())
    }

    /// The direct light on the backs of `patches`, ascending [lx], and the rays that took.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn light(&mut self, draw: &Draw, patches: &[u32], progress: &dyn Progress) -> Result<(Vec<Rgb>, u64)> {
        let around = |k: usize| around(draw.lit.ground, &patches[k..=k]);
        let trace = |k: usize, lamps: &[(&Lights, &DirectParams)]| {
            let found = draw.direct_on_back(patches[k] as usize, lamps);
            found.iter().map(|arriving| ([arriving.transport], arriving.rays)).collect()
        };
        let (light, rays) = self.find(patches, &around, &trace, |known| &mut known.of_patch, progress)?;
        Ok((light.into_iter().map(|[light]| light).collect(), rays))
    }

    /// The mean direct light on the back blocks `list`, ascending, from a few patches all over each: from all lamps, and from those that are
    /// no surface [lx]; and the rays that took.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn light_blocks(
        &mut self,
        draw: &Draw,
        list: &[usize],
        progress: &dyn Progress,
    ) -> Result<(Vec<[Rgb; 2]>, u64)> {
        let first: Vec<u32> = list.iter().map(|&b| draw.blocks.members(b)[0]).collect();
        let around = |k: usize| around(draw.lit.ground, draw.blocks.members(list[k]));
        let trace = |k: usize, lamps: &[(&Lights, &DirectParams)]| mean_on_back(draw, list[k], lamps);
        self.find(&first, &around, &trace, |known| &mut known.of_block, progress)
    }

    /// The light of what has the numbers `keys`, ascending: known, or known before a change that can't touch it, for which each has a box
    /// `around` it; else `trace` finds that of each lamp, and the rays that took. Of what is unknown of one lamp all are traced: they share most
    /// of what that takes.
    fn find<const N: usize>(
        &mut self,
        keys: &[u32],
        around: &(dyn Fn(usize) -> (u32, [Vec3; 2]) + Sync),
        trace: &Trace<N>,
        of: Of<N>,
        progress: &dyn Progress,
    ) -> Result<(Vec<[Rgb; N]>, u64)> {
        let mut known: Vec<Vec<Option<[Rgb; N]>>> =
            self.0.iter_mut().map(|unit| unit.recall(keys, around, of)).collect();
        let unknown: Vec<usize> =
            (0..keys.len()).filter(|&k| known.iter().any(|of_unit| of_unit[k].is_none())).collect();
        let lamps: Vec<_> = self.0.iter().map(|unit| (&unit.lights, &unit.params)).collect();
        let one = |&k: &usize| {
            progress.check()?;
            Ok(trace(k, &lamps))
        };
        let traced: Vec<Vec<([Rgb; N], u64)>> =
            unknown.par_iter().with_max_len(SHARE).map(one).collect::<Result<_>>()?;
        let rays = traced.iter().flatten().map(|(_, rays)| rays).sum();
        for (u, (unit, known)) in self.0.iter_mut().zip(&mut known).enumerate().filter(|_| !unknown.is_empty()) {
            for (&k, traced) in unknown.iter().zip(&traced) {
                known[k] = Some(traced[u].0.map(|light| over(light, unit.strength)));
            }
            of(&mut unit.known).add(unknown.iter().filter_map(|&k| Some((keys[k], known[k]?))));
            unit.is_new = true;
        }
        let add = |sum: [Rgb; N], (unit, known): (&Unit, [Rgb; N])| -> [Rgb; N] {
            std::array::from_fn(|n| sum[n] + known[n] * unit.strength)
        };
        let light = |k: usize| {
            let units = self.0.iter().zip(&known);
            units.filter_map(|(unit, known)| Some((unit, known[k]?))).fold([Rgb::ZERO; N], add)
        };
        Ok(((0..keys.len()).map(light).collect(), rays))
    }
}

impl Unit {
    /// What is known of `keys`, and taken over from before a change: see [`BackLamps::find`].
    fn recall<const N: usize>(
        &mut self,
        keys: &[u32],
        around: &(dyn Fn(usize) -> (u32, [Vec3; 2]) + Sync),
        of: Of<N>,
    ) -> Vec<Option<[Rgb; N]>> {
        let mut known = of(&mut self.known).get(keys);
        let Some((before, shafts)) = &mut self.before else { return known };
        let old = of(before).get(keys);
        let is_apart = |k: usize| {
            let (surface, bounds) = around(k);
            !shafts.meet(surface, &bounds)
        };
        let taken: Vec<usize> = (0..keys.len())
            .into_par_iter()
            .filter(|&k| known[k].is_none() && old[k].is_some() && is_apart(k))
            .collect();
        taken.iter().for_each(|&k| known[k] = old[k]);
        of(&mut self.known).add(taken.iter().filter_map(|&k| Some((keys[k], old[k]?))));
        self.is_new |= !taken.is_empty();
        known
    }
}

/// How direct light on backs is looked at, of which fronts are looked at as `params` say: at a glance, as no texel shows it.
pub fn params_of_backs(params: &DirectParams) -> DirectParams {
    DirectParams { shading_normals: false, first_samples: 1, ..params.clone() }
}

/// The mean direct light on back block `b` from a few patches all over it, from each of several lots of lamps: all of it, and that from lights
/// that are no surface [lx]; and the rays that took.
pub fn mean_on_back(draw: &Draw, b: usize, lamps: &[(&Lights, &DirectParams)]) -> Vec<([Rgb; 2], u64)> {
    let members = draw.blocks.members(b);
    let some = members.iter().step_by(members.len().div_ceil(BACK_PATCHES));
    let count = some.len() as f32;
    let mut sums = vec![([Rgb::ZERO; 2], 0); lamps.len()];
    for &i in some {
        for ((sum, rays), arriving) in sums.iter_mut().zip(draw.direct_on_back(i as usize, lamps)) {
            *sum = [sum[0] + arriving.transport / count, sum[1] + arriving.other / count];
            *rays += arriving.rays;
        }
    }
    sums
}

/// The surface that `patches` are part of, and the box around them [m].
fn around(ground: &Ground, patches: &[u32]) -> (u32, [Vec3; 2]) {
    let each = patches.iter().map(|&i| ground.patches.around(i as usize));
    let bounds = each.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |sum, own| [sum[0].min(own[0]), sum[1].max(own[1])]);
    (ground.patches.surface(patches[0] as usize), bounds)
}

/// A list as it is stored: its numbers, which of its values aren't nothing, and those.
fn write_list<const N: usize>(list: &List<[Rgb; N]>) -> [Cow<'_, [u8]>; 3] {
    let mut some = vec![0u64; list.keys.len().div_ceil(64)];
    let mut values: Vec<Rgb> = Vec::new();
    for (k, value) in list.values.iter().enumerate().filter(|(_, value)| **value != [Rgb::ZERO; N]) {
        some[k / 64] |= 1 << (k % 64);
        values.extend(value);
    }
    let owned = |bytes: &[u8]| Cow::Owned(bytes.to_vec());
    [Cow::Owned(write_keys(&list.keys)), owned(bytemuck::cast_slice(&some)), owned(bytemuck::cast_slice(&values))]
}

/// Ascending numbers by the gaps between them.
fn write_keys(keys: &[u32]) -> Vec<u8> {
    let mut bits = BitWriter::default();
    bits.put_any(keys.len() as u32);
    let before = std::iter::once(0).chain(keys.iter().copied());
    let gaps: Vec<u32> = keys.iter().zip(before).map(|(key, before)| key - before).collect();
    bits.put_all(gaps.iter().copied());
    bits.finish()
}

fn read_keys(bytes: &[u8]) -> Option<Vec<u32>> {
    let mut bits = BitReader::new(bytes);
    let (count, mut keys, mut key) = (bits.get_any()?, Vec::new(), 0u32);
    bits.get_all(count as usize, |gap| {
        key = key.checked_add(gap)?;
        keys.push(key);
        Some(())
    })?;
    Some(keys)
}

fn read_list<const N: usize>(entry: &Entry, section: usize) -> Option<List<[Rgb; N]>> {
    let keys = read_keys(entry.section(section))?;
    let (some, values) = (entry.slice::<u64>(section + 1).ok()?, entry.slice::<Rgb>(section + 2).ok()?);
    let mut values = values.chunks_exact(N);
    let value = |k: usize| match some.get(k / 64)? >> (k % 64) & 1 {
        0 => Some([Rgb::ZERO; N]),
        _ => values.next()?.try_into().ok(),
    };
    let values = (0..keys.len()).map(value).collect::<Option<_>>()?;
    Some(List { keys, values })
}

impl Stored for Known {
    fn sections(&self) -> Vec<Cow<'_, [u8]>> {
        write_list(&self.of_patch).into_iter().chain(write_list(&self.of_block)).collect()
    }

    fn restore(entry: &Entry) -> Option<Self> {
        Some(Self { of_patch: read_list(entry, 0)?, of_block: read_list(entry, 3)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        for keys in [vec![], vec![0], vec![7, 8, 9, 4_000_000_000]] {
            let bytes = write_keys(&keys);
            assert_eq!(read_keys(&bytes), Some(keys));
        }
        assert_eq!(read_keys(&[]), None);
    }

    #[test]
    fn lists_are_merged_and_looked_up_in_order() {
        let mut list = List::default();
        list.add([(3, 'a'), (7, 'b'), (9, 'c')].into_iter());
        list.add([(1, 'd'), (7, 'e'), (8, 'f'), (12, 'g')].into_iter());
        let now = list.renumbered(&[0, 9, 1, 8, NONE, NONE, NONE, 2, 5, 4]);
        assert_eq!(now.iter().collect::<Vec<_>>(), [(2, 'e'), (4, 'c'), (5, 'f'), (8, 'a'), (9, 'd')]);
        assert_eq!(list.iter().collect::<Vec<_>>(), [(1, 'd'), (3, 'a'), (7, 'e'), (8, 'f'), (9, 'c'), (12, 'g')]);
        assert_eq!(
            list.get(&[0, 1, 2, 7, 9, 10, 12, 13]),
            [None, Some('d'), None, Some('e'), Some('c'), None, Some('g'), None]
        );
    }
}
