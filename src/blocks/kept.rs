//! Links as they are kept: in three bytes each, so that they outlive a bake.
//!
//! What a sweep needs of a link is its patch and form factor. Patches of a half are sorted and told by the gaps between them, which lie
//! close where the block sees much of one place; form factors by their logarithm, in steps of an eighth of an octave, scaled to
//! their exact sum: each is off by 4 % at most, and the mean over a hundred by three in a thousand. Where one value does for
//! all normals, directions don't matter; curved blocks, which weigh links by them, the sky, and all links of bakes that tell where light
//! comes from, have theirs in 16 bits.
//!
//! A bake solves with links as they come back from here, kept or not: what is read later is what was solved with then, to the bit.

use super::SHARE;
use super::bits::{BitReader, BitWriter};
use super::block::{Block, Blocks, Shape};
use super::field::Field;
use super::guide::Found;
use super::link::{Drawn, Half, Normals, SkyLink};
use super::respond::is_curved;
use super::shoot::Sampled;
use crate::color::Rgb;
use crate::light::Lit;
use crate::patch::NONE;
use crate::sample::octahedral;
use crate::store::Entry;
use crate::work::Stored;
use glam::Vec3;
use half::f16;
use rayon::prelude::*;
use std::borrow::Cow;

/// Steps of an octave in which form factors are told, and the last of them.
const STEPS: f32 = 8.0;
const LAST_STEP: u32 = 127;

/// Cosine to the block's normal that reconstructed directions have at least: a block's middle may lie beside what its edge sees.
const LEAST_COS: f32 = 0.05;

/// What blocks see, and all that is needed to find the light of any lamps by it.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    /// Of blocks: the gap before, the number of texels, and the level.
    pub shapes: Vec<u8>,
    /// The patches in the order that blocks are runs of: from each to the next.
    pub order: Vec<u8>,
    /// Blocks that are no backs; they come first.
    pub fronts: u32,
    /// The end of each block's bytes in `links`. It holds their lengths where it is stored.
    pub ends: Vec<usize>,
    pub links: Vec<u8>,
    /// The light that blocks had when links were last looked along [lx]: where sweeps start.
    pub irradiance: Vec<Rgb>,
    /// What patches sent then, in all, by channel [lm].
    pub flux: [f64; 3],
    /// Patches whose backs are seen, and blocks whose backs' direct light is wanted, ascending.
    pub back_patches: Vec<u32>,
    pub back_blocks: Vec<u32>,
    /// What stratification and smoothing leave of the variance of independent samples.
    pub gain: f32,
    /// Rays that were traced.
    pub rays: u64,
    /// The error that was left, of the mean light or of that of each place.
    pub error: f64,
    /// Links when all blocks were last looked at.
    pub links_at_first: u64,
}

/// Keeps what `field` has seen; `normal` is the one that a patch shows.
pub fn keep(
    field: &Field,
    gain: f32,
    (error, links_at_first): (f64, u64),
    normal: &(dyn Fn(usize) -> Vec3 + Sync),
) -> Kept {
    let blocks = &field.blocks;
    let encode = |b: usize| {
        let mut bits = BitWriter::default();
        let asks_directions = field.lit.params.moments || is_curved(blocks, b, normal);
        write_block(&mut bits, &field.sampled[b], asks_directions);
        bits.finish()
    };
    let each: Vec<Vec<u8>> = (0..blocks.list.len()).into_par_iter().with_max_len(SHARE).map(encode).collect();
    let (back_patches, back_blocks) = field.lit_backs();
    Kept {
        shapes: write_shapes(&blocks.list),
        order: write_order(&blocks.order),
        fronts: blocks.fronts() as u32,
        ends: ends(each.iter().map(Vec::len)),
        links: each.concat(),
        irradiance: field.irradiance.clone(),
        flux: field.flux(),
        back_patches,
        back_blocks,
        gain,
        rays: field.rays,
        error,
        links_at_first,
    }
}

/// Where each of so many bytes ends, one after the other.
fn ends(lengths: impl Iterator<Item = usize>) -> Vec<usize> {
    let end = |sum: &mut usize, length: usize| {
        *sum += length;
        Some(*sum)
    };
    lengths.scan(0, end).collect()
}

impl Kept {
    /// The blocks of `lit`; `None` where they aren't of the same patches.
    pub fn blocks(&self, lit: &Lit) -> Option<Blocks> {
        Blocks::shaped(lit, &self.shapes()?)
    }

    fn shapes(&self) -> Option<Vec<Shape>> {
        let mut bits = BitReader::new(&self.shapes);
        let mut end = 0u32;
        let mut shape = |_| {
            let first = end.checked_add(bits.get_any()?)?;
            end = first.checked_add(bits.get_any()?)?;
            Some(Shape { first, end, level: bits.get_any()? })
        };
        (0..self.ends.len()).map(&mut shape).collect()
    }

    /// The blocks as they were, of patches that have the numbers `numbers` now; there are `patches` of them.
    pub fn old_blocks(&self, numbers: &[u32], patches: usize) -> Option<OldBlocks> {
        let shapes = self.shapes()?;
        let mut order = read_order(&self.order, shapes.last().map_or(0, |last| last.end) as usize, numbers.len())?;
        order.iter_mut().for_each(|i| *i = numbers[*i as usize]);
        let (mut front_of, mut back_of) = (vec![NONE; patches], vec![NONE; patches]);
        for (shape, b) in shapes.iter().zip(0..) {
            let of = if b < self.fronts { &mut front_of } else { &mut back_of };
            let members = order.get(shape.first as usize..shape.end as usize)?;
            members.iter().filter(|i| **i != NONE).for_each(|&i| of[i as usize] = b);
        }
        Some(OldBlocks { shapes, order, front_of, back_of })
    }

    /// Samples of each half of block `b`: over the hemisphere, and towards what shines.
    pub fn drawn(&self, b: usize) -> Option<[u32; 2]> {
        let mut bits = BitReader::new(self.bytes(b)?);
        let drawn = [bits.get_any()?, bits.get_any()?];
        drawn[0].checked_add(drawn[1]).map(|_| drawn)
    }

    fn bytes(&self, b: usize) -> Option<&[u8]> {
        let start = if b == 0 { 0 } else { *self.ends.get(b - 1)? };
        self.links.get(start..*self.ends.get(b)?)
    }

    /// What each of `blocks` has seen; `None` where that can't be, and what is kept is of something else.
    pub fn sampled(&self, lit: &Lit, blocks: &Blocks) -> Option<Vec<Sampled>> {
        let all: Vec<Option<usize>> = (0..self.ends.len()).map(Some).collect();
        self.sampled_of(blocks, &all, Targets { patches: lit.ground.patches.len(), numbers: None })
    }

    /// What each of `blocks` has seen, by the number that it has here; nothing where it has none.
    pub fn sampled_of(&self, blocks: &Blocks, known: &[Option<usize>], targets: Targets) -> Option<Vec<Sampled>> {
        let shares = std::array::from_fn(|step| (-(step as f32) / STEPS).exp2());
        let read = |(_, known): (&Block, &Option<usize>)| match known {
            None => Some(Sampled::default()),
            Some(b) => Reading { bits: BitReader::new(self.bytes(*b)?), targets, shares: &shares }.sampled(),
        };
        blocks.list.par_iter().zip(known).with_max_len(SHARE).map(read).collect()
    }
}

/// Patches that links lead to.
#[derive(Clone, Copy)]
pub struct Targets<'a> {
    /// How many there were.
    pub patches: usize,
    /// The number that each has now, where it isn't the same; [`GONE`] where it has none.
    pub numbers: Option<&'a [u32]>,
}

/// A patch that is gone.
pub const GONE: usize = (NONE >> 1) as usize;

/// Blocks of a bake before, of patches as they are numbered now.
pub struct OldBlocks {
    shapes: Vec<Shape>,
    order: Vec<u32>,
    front_of: Vec<u32>,
    back_of: Vec<u32>,
}

impl OldBlocks {
    fn of(&self, patch: usize, back: bool) -> Option<usize> {
        let b = if back { self.back_of[patch] } else { self.front_of[patch] };
        (b != NONE).then_some(b as usize)
    }

    /// The level of the block that patch `patch` was in.
    pub fn level(&self, patch: usize, back: bool) -> Option<u32> {
        self.of(patch, back).map(|b| self.shapes[b].level)
    }

    /// The block that had the first patch of block `b` of `blocks`.
    pub fn around(&self, blocks: &Blocks, b: usize) -> Option<usize> {
        self.of(blocks.members(b)[0] as usize, blocks.list[b].back)
    }

    /// The block that had the same patches as block `b` of `blocks`, and no others.
    pub fn same_as(&self, blocks: &Blocks, b: usize) -> Option<usize> {
        self.around(blocks, b).filter(|&k| {
            let Shape { first, end, level } = self.shapes[k];
            level == blocks.list[b].level && self.order[first as usize..end as usize] == *blocks.members(b)
        })
    }
}

fn write_order(order: &[u32]) -> Vec<u8> {
    let mut bits = BitWriter::default();
    // One after the other as a rule: how far off that is, up or down.
    let before = std::iter::once(u32::MAX).chain(order.iter().copied());
    order.iter().zip(before).for_each(|(i, before)| {
        let off = i.wrapping_sub(before).wrapping_sub(1) as i32;
        bits.put_rice(((off << 1) ^ (off >> 31)) as u32, 0);
    });
    bits.finish()
}

fn read_order(bytes: &[u8], count: usize, patches: usize) -> Option<Vec<u32>> {
    let mut bits = BitReader::new(bytes);
    let mut before = u32::MAX;
    let next = |_| {
        let code = bits.get_rice(0)?;
        let off = (code >> 1) ^ (code & 1).wrapping_neg();
        before = before.wrapping_add(off).wrapping_add(1);
        Some(before).filter(|i| (*i as usize) < patches)
    };
    (0..count).map(next).collect()
}

impl Stored for Kept {
    fn sections(&self) -> Vec<Cow<'_, [u8]>> {
        let head: Vec<u8> = [
            u64::from(self.gain.to_bits()),
            self.rays,
            u64::from(self.fronts),
            self.error.to_bits(),
            self.links_at_first,
        ]
        .into_iter()
        .chain(self.flux.map(f64::to_bits))
        .flat_map(u64::to_le_bytes)
        .collect();
        let starts = std::iter::once(&0).chain(&self.ends);
        let lengths: Vec<u32> = self.ends.iter().zip(starts).map(|(end, start)| (end - start) as u32).collect();
        let light: &[u8] = bytemuck::cast_slice(&self.irradiance);
        vec![
            Cow::Owned(head),
            Cow::Borrowed(&self.shapes[..]),
            Cow::Borrowed(&self.links[..]),
            Cow::Borrowed(light),
            Cow::Owned(bytemuck::cast_slice(&lengths).to_vec()),
            Cow::Borrowed(bytemuck::cast_slice(&self.back_patches)),
            Cow::Borrowed(bytemuck::cast_slice(&self.back_blocks)),
            Cow::Borrowed(&self.order[..]),
        ]
    }

    fn restore(entry: &Entry) -> Option<Self> {
        let &[gain, rays, fronts, error, links_at_first, ref flux @ ..] = entry.slice::<u64>(0).ok()? else {
            return None;
        };
        let list = |k: usize| Some(entry.slice::<u32>(k).ok()?.to_vec());
        let ends = ends(entry.slice::<u32>(4).ok()?.iter().map(|length| *length as usize));
        if ends.last().copied().unwrap_or(0) != entry.section(2).len() {
            return None;
        }
        Some(Self {
            shapes: entry.section(1).to_vec(),
            order: entry.section(7).to_vec(),
            fronts: u32::try_from(fronts).ok()?,
            links: entry.section(2).to_vec(),
            irradiance: entry.slice::<Rgb>(3).ok()?.to_vec(),
            ends,
            back_patches: list(5)?,
            back_blocks: list(6)?,
            flux: flux.iter().map(|bits| f64::from_bits(*bits)).collect::<Vec<_>>().try_into().ok()?,
            gain: f32::from_bits(gain as u32),
            rays,
            error: f64::from_bits(error),
            links_at_first,
        })
    }
}

fn write_shapes(list: &[Block]) -> Vec<u8> {
    let mut bits = BitWriter::default();
    let mut end = 0;
    for block in list {
        bits.put_any(block.first - end);
        bits.put_any(block.end - block.first);
        bits.put_any(block.level);
        end = block.end;
    }
    bits.finish()
}

fn write_block(bits: &mut BitWriter, sampled: &Sampled, curved: bool) {
    let Sampled { halves, drawn, .. } = sampled;
    bits.put_any(drawn.hemisphere);
    bits.put_any(drawn.areas);
    if drawn.samples() == 0 {
        return;
    }
    bits.put_any(drawn.normals.0.len() as u32);
    drawn.normals.0.iter().for_each(|n| bits.put(octahedral::pack(*n), 32));
    bits.put(u32::from(curved), 1);
    for half in halves {
        write_links(bits, half, curved);
        write_sky(bits, half);
        bits.put_any(half.lost);
    }
}

fn write_links(bits: &mut BitWriter, half: &Half, curved: bool) {
    let key = |(patch, back): (usize, bool)| (patch as u32) << 1 | u32::from(back);
    let mut order: Vec<(u32, u32)> = half.links.targets().zip(0..).map(|(seen, k)| (key(seen), k)).collect();
    order.sort_unstable();
    bits.put_any(order.len() as u32);
    if order.is_empty() {
        return;
    }
    let before = std::iter::once(0).chain(order.iter().map(|o| o.0));
    let gaps: Vec<u32> = order.iter().zip(before).map(|(o, before)| o.0 - before).collect();
    bits.put_all(gaps.iter().copied());
    let at = |k: &(u32, u32)| k.1 as usize;
    write_weights(bits, order.iter().map(|k| half.weights[at(k)]));
    if curved {
        order.iter().for_each(|k| bits.put(octahedral::pack_16(half.links.get(at(k)).direction()), 16));
    }
    let mut place = vec![0; order.len()];
    order.iter().zip(0..).for_each(|(k, now)| place[at(k)] = now);
    write_tints(bits, half.tints.iter().map(|(k, tint)| (place[*k as usize], *tint)));
}

fn write_sky(bits: &mut BitWriter, half: &Half) {
    bits.put_any(half.sky.len() as u32);
    if half.sky.is_empty() {
        return;
    }
    write_weights(bits, half.sky_weights.iter().copied());
    half.sky.iter().for_each(|link| bits.put(octahedral::pack_16(link.direction()), 16));
    write_tints(bits, half.sky_tints.iter().copied());
}

fn write_weights(bits: &mut BitWriter, weights: impl ExactSizeIterator<Item = f32> + Clone) {
    let largest = weights.clone().fold(0.0, f32::max);
    let step =
        |w: f32| (STEPS * (largest / w.max(f32::MIN_POSITIVE)).log2()).round().clamp(0.0, LAST_STEP as f32) as u32;
    bits.put(weights.clone().sum::<f32>().to_bits(), 32);
    let steps: Vec<u32> = weights.map(step).collect();
    bits.put_all(steps.iter().copied());
}

fn write_tints(bits: &mut BitWriter, tints: impl Iterator<Item = (u32, Rgb)>) {
    let mut tints: Vec<(u32, Rgb)> = tints.collect();
    tints.sort_unstable_by_key(|t| t.0);
    bits.put_any(tints.len() as u32);
    for (k, tint) in tints {
        bits.put_any(k);
        tint.to_array().into_iter().for_each(|v| bits.put(u32::from(f16::from_f32(v).to_bits()), 16));
    }
}

/// A block's bytes, while they are read.
struct Reading<'a> {
    bits: BitReader<'a>,
    targets: Targets<'a>,
    /// Form factors by step, relative to the largest.
    shares: &'a [f32; LAST_STEP as usize + 1],
}

impl Reading<'_> {
    fn sampled(mut self) -> Option<Sampled> {
        let (hemisphere, areas) = (self.bits.get_any()?, self.bits.get_any()?);
        let mut sampled = Sampled { drawn: Drawn::of(hemisphere, areas), ..Sampled::default() };
        if hemisphere.checked_add(areas)? == 0 {
            return Some(sampled);
        }
        let normals = self.bits.get_any()?;
        let normals = (0..normals).map(|_| Some(octahedral::unpack(self.bits.get(32)?)));
        sampled.drawn.normals = Normals(normals.collect::<Option<_>>()?);
        let curved = self.bits.get(1)? == 1;
        for half in &mut sampled.halves {
            self.links(half, curved)?;
            self.sky(half)?;
            half.lost = self.bits.get_any()?;
        }
        Some(sampled)
    }

    fn links(&mut self, half: &mut Half, curved: bool) -> Option<()> {
        let count = self.bits.get_any()? as usize;
        if count == 0 {
            return Some(());
        }
        let Targets { patches, numbers } = self.targets;
        let number = |patch: usize| numbers.map_or(patch, |numbers| (numbers[patch] as usize).min(GONE));
        let mut key = 0u32;
        // A number that is no count of links ends with the bits.
        half.links.reserve_targets(count.min(1 << 16));
        self.bits.get_all(count, |gap| {
            key = key.checked_add(gap)?;
            let (patch, back) = ((key >> 1) as usize, key & 1 == 1);
            let patch = (patch < patches).then(|| number(patch))?;
            half.links.push_target(patch, back);
            Some(())
        })?;
        self.weights(count, &mut half.weights)?;
        if curved {
            let directions = (0..count).map(|_| Some(octahedral::unpack_16(self.bits.get(16)?)));
            half.links.direct(directions.collect::<Option<Vec<Vec3>>>()?.into_iter());
        }
        self.tints(count, &mut half.tints)
    }

    fn sky(&mut self, half: &mut Half) -> Option<()> {
        let count = self.bits.get_any()? as usize;
        if count == 0 {
            return Some(());
        }
        self.weights(count, &mut half.sky_weights)?;
        half.sky.reserve_exact(count);
        for _ in 0..count {
            half.sky.push(SkyLink::new(octahedral::unpack_16(self.bits.get(16)?), Found::NOTHING));
        }
        self.tints(count, &mut half.sky_tints)
    }

    fn weights(&mut self, count: usize, weights: &mut Vec<f32>) -> Option<()> {
        let sum = f32::from_bits(self.bits.get(32)?);
        weights.reserve_exact(count.min(1 << 16));
        self.bits.get_all(count, |step| {
            weights.push(*self.shares.get(step as usize)?);
            Some(())
        })?;
        let scale = sum / weights.iter().sum::<f32>();
        weights.iter_mut().for_each(|w| *w *= scale);
        scale.is_finite().then_some(())
    }

    fn tints(&mut self, count: usize, tints: &mut Vec<(u32, Rgb)>) -> Option<()> {
        for _ in 0..self.bits.get_any()? {
            let k = self.bits.get_any().filter(|k| (*k as usize) < count)?;
            let mut channel = || Some(f16::from_bits(self.bits.get(16)? as u16).to_f32());
            tints.push((k, Rgb::new(channel()?, channel()?, channel()?)));
        }
        Some(())
    }
}

/// The direction from the middle of `block` to `position`, above its horizon.
pub fn way(block: &Block, position: Vec3) -> Vec3 {
    let direction = (position - block.centre).try_normalize().unwrap_or(block.normal);
    let below = LEAST_COS - direction.dot(block.normal);
    if below > 0.0 { (direction + block.normal * below).normalize() } else { direction }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_may_take_more_than_four_gigabytes() {
        let lengths = [u32::MAX as usize, 0, 2];
        assert_eq!(ends(lengths.into_iter()), [0xffff_ffff, 0xffff_ffff, 0x1_0000_0001]);
    }
}
