//! Samples of many blocks, in parts that can be done by others or have been done before.
//!
//! A part is a run of blocks. What is put down of it is what each block found anew, to the bit: links with their densities, as they are
//! weighed again with each look.

use super::block::Blocks;
use super::field::draw_view;
use super::guide::{Guide, View};
use super::link::{Half, Link, Normals, Sight, SkyLink};
use super::reach::Reach;
use super::shoot::{Draw, Sampled, Samples, Scratch};
use super::{BlockParams, SHARE};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::patch::NONE;
use crate::progress::Progress;
use crate::work::Job;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Samples that a part has, about: a second's work.
const PART: u64 = 1 << 20;

/// What each block is sampled for, and by.
pub struct Sampling<'a> {
    source: Source<'a>,
    /// What has been found about each block.
    pub sampled: Vec<Sampled>,
    /// Blocks that are sampled, ascending, and how many samples each half of each gets.
    wanted: Vec<(usize, u32)>,
    /// Where parts end in them.
    ends: Vec<usize>,
    /// What each of them had before, where that is to be known.
    before: Vec<[Before; 2]>,
    /// Patches whose backs were seen.
    pub backs: Vec<u32>,
    pub rays: u64,
}

/// How much a half had found.
#[derive(Clone, Copy, Default)]
struct Before {
    links: usize,
    sky: usize,
    tints: usize,
    sky_tints: usize,
    lost: u32,
}

impl Before {
    fn of(half: &Half) -> Self {
        Self {
            links: half.links.len(),
            sky: half.sky.len(),
            tints: half.tints.len(),
            sky_tints: half.sky_tints.len(),
            lost: half.lost,
        }
    }
}

/// What samples are drawn by, beside what was found.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    pub lit: &'a Lit<'a>,
    pub params: &'a BlockParams,
    pub blocks: &'a Blocks,
    /// Irradiance of blocks as far as it is known [lx].
    pub irradiance: &'a [Rgb],
    pub bright: Option<&'a (Guide, Reach)>,
    pub progress: &'a dyn Progress,
}

impl<'a> Sampling<'a> {
    /// Of `plan` samples for each half of each block, on top of what was `sampled`.
    pub fn new(source: Source<'a>, sampled: Vec<Sampled>, plan: &[u32]) -> Self {
        let wanted: Vec<(usize, u32)> = plan.iter().copied().enumerate().filter(|(_, count)| *count > 0).collect();
        let (mut ends, mut sum) = (Vec::new(), 0);
        for (k, (_, count)) in wanted.iter().enumerate() {
            sum += 2 * u64::from(*count);
            if sum >= PART || k + 1 == wanted.len() {
                ends.push(k + 1);
                sum = 0;
            }
        }
        let before = wanted.iter().map(|(b, _)| sampled[*b].halves.each_ref().map(Before::of)).collect();
        Self { source, sampled, wanted, ends, before, backs: Vec::new(), rays: 0 }
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        self.ends.len()
    }

    /// Those of `wanted` that are part `part`.
    fn range(&self, part: usize) -> Range<usize> {
        let start = if part == 0 { 0 } else { self.ends[part - 1] };
        start..self.ends[part]
    }

    /// Calls `find` for each block of a part: with its number, its samples, and what has been found about it, from which links follow
    /// that are weighed then.
    fn each(
        &mut self,
        part: usize,
        find: impl Fn(usize, Samples, &mut Sampled, &mut Scratch) -> Option<()> + Sync,
    ) -> Result<Option<()>> {
        let range = self.range(part);
        let (wanted, before) = (&self.wanted[range.clone()], &self.before[range]);
        let Some(first) = wanted.first().map(|w| w.0) else { return Ok(Some(())) };
        let Source { lit, irradiance, bright, blocks, progress, .. } = self.source;
        let one = |k: usize, found: &mut Sampled, scratch: &mut Scratch| -> Option<Vec<u32>> {
            let (b, count) = wanted[k];
            let mut arriving = std::mem::take(&mut scratch.arriving);
            let view = bright.and_then(|(guide, reach)| {
                guide.arriving(&blocks.list[b], reach.of(b), &mut arriving);
                draw_view(guide, luminance(irradiance[b]), &arriving, count)
            });
            let areas = view.as_ref().map_or(0, |v: &(View, u32)| v.1);
            let samples = Samples {
                hemisphere: count - areas,
                areas,
                guide: bright.map(|b| &b.0),
                view: view.as_ref().map(|v| &v.0),
            };
            find(k, samples, found, scratch)?;
            let sight = match bright {
                Some((guide, _)) => Sight::new(guide, &found.drawn, arriving),
                None => Sight::default(),
            };
            found.weigh(&sight);
            found.close();
            scratch.arriving = sight.expected;
            let mut backs: Vec<u32> = (found.halves.iter().zip(before[k]))
                .flat_map(|(half, before)| half.links.targets().skip(before.links))
                .filter(|(_, back)| *back)
                .map(|(patch, _)| patch as u32)
                .collect();
            backs.sort_unstable();
            backs.dedup();
            Some(backs)
        };
        let mut at = vec![None; wanted.last().map_or(0, |w| w.0 + 1 - first)];
        (0..).zip(wanted).for_each(|(k, (b, _))| at[b - first] = Some(k));
        let found: Result<Vec<Option<Vec<u32>>>> = self.sampled[first..first + at.len()]
            .par_iter_mut()
            .zip(at)
            .with_max_len(SHARE)
            .filter_map(|(found, k)| Some((found, k?)))
            .map_init(
                || Scratch::new(lit.ground),
                |scratch, (found, k)| {
                    progress.check()?;
                    Ok(one(k, found, scratch))
                },
            )
            .collect();
        let Some(found) = found?.into_iter().collect::<Option<Vec<Vec<u32>>>>() else { return Ok(None) };
        self.backs.extend(found.into_iter().flatten());
        self.rays += wanted.iter().map(|(_, count)| 2 * u64::from(*count)).sum::<u64>();
        Ok(Some(()))
    }
}

impl Job for Sampling<'_> {
    fn make(&mut self, part: usize) -> Result<()> {
        let Source { lit, blocks, params, .. } = self.source;
        let draw = Draw { lit, blocks, seed: params.seed };
        let wanted = self.wanted[self.range(part)].to_vec();
        self.each(part, |k, samples, found, scratch| {
            draw.sample(wanted[k].0, samples, found, scratch);
            Some(())
        })?;
        Ok(())
    }

    fn write(&self, part: usize) -> Vec<u8> {
        let range = self.range(part);
        let mut words: Vec<u32> = Vec::new();
        let mut ends: Vec<u32> = vec![range.len() as u32];
        for ((b, _), before) in self.wanted[range.clone()].iter().zip(&self.before[range]) {
            write_found(&self.sampled[*b], before, &mut words);
            ends.push(words.len() as u32);
        }
        ends.extend(words);
        bytemuck::cast_slice(&ends).to_vec()
    }

    fn read(&mut self, part: usize, bytes: &[u8]) -> Option<()> {
        let words: &[u32] = bytemuck::try_cast_slice(bytes).ok()?;
        let count = self.range(part).len();
        let (ends, words) = words.split_first()?.1.split_at_checked(count)?;
        if bytemuck::cast_slice::<u8, u32>(bytes)[0] as usize != count {
            return None;
        }
        let of_block = |k: usize| {
            let start = if k == 0 { 0 } else { ends[k - 1] as usize };
            words.get(start..ends[k] as usize)
        };
        let (front_of, back_of) = (&self.source.blocks.front_of, &self.source.blocks.back_of);
        let is_seen = |link: &Link| {
            let (patch, back) = link.target();
            (if back { back_of } else { front_of }).get(patch).is_some_and(|b| *b != NONE)
        };
        // All or nothing: what was found is added to what there was.
        let fits = (0..count)
            .all(|k| of_block(k).is_some_and(|words| Words(words).found(&mut Sampled::default(), &is_seen).is_some()));
        if !fits {
            return None;
        }
        let taken = self.each(part, |k, samples, found, _| {
            Words(of_block(k)?).found(found, &is_seen)?;
            found.drawn.hemisphere += samples.hemisphere;
            if let Some(view) = samples.view {
                found.drawn.expect(view, samples.areas);
            }
            Some(())
        });
        taken.ok()?
    }
}

/// Writes what `sampled` found beyond `before`.
fn write_found(sampled: &Sampled, before: &[Before; 2], words: &mut Vec<u32>) {
    words.push(sampled.inverse_distance.to_bits());
    words.push(sampled.drawn.normals.0.len() as u32);
    words.extend(sampled.drawn.normals.0.iter().flat_map(|n| n.to_array().map(f32::to_bits)));
    for (half, before) in sampled.halves.iter().zip(before) {
        words.push((half.links.len() - before.links) as u32);
        words.extend(half.links.iter().skip(before.links).flat_map(Link::to_words));
        words.push((half.sky.len() - before.sky) as u32);
        words.extend(half.sky[before.sky..].iter().flat_map(|link| link.to_words()));
        words.push(half.lost - before.lost);
        for (tints, from) in [(&half.tints, before.tints), (&half.sky_tints, before.sky_tints)] {
            words.push((tints.len() - from) as u32);
            for (k, tint) in &tints[from..] {
                words.push(*k);
                words.extend(tint.to_array().map(f32::to_bits));
            }
        }
    }
}

/// What is left to be read.
struct Words<'a>(&'a [u32]);

impl Words<'_> {
    fn next(&mut self) -> Option<u32> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    fn three(&mut self) -> Option<[u32; 3]> {
        Some([self.next()?, self.next()?, self.next()?])
    }

    /// Adds what [`write_found`] wrote to `sampled`.
    fn found(mut self, sampled: &mut Sampled, is_seen: &dyn Fn(&Link) -> bool) -> Option<()> {
        sampled.inverse_distance = f32::from_bits(self.next()?);
        let normals = self.next()?;
        let normals = (0..normals).map(|_| Some(Vec3::from_array(self.three()?.map(f32::from_bits))));
        sampled.drawn.normals = Normals(normals.collect::<Option<_>>()?);
        for half in &mut sampled.halves {
            let links = self.next()?;
            half.links.reserve_exact((links as usize).min(self.0.len() / 3));
            for _ in 0..links {
                half.links.push(Some(Link::from_words(self.three()?)).filter(is_seen)?);
            }
            for _ in 0..self.next()? {
                half.sky.push(SkyLink::from_words(self.three()?));
            }
            half.lost = half.lost.checked_add(self.next()?)?;
            for tints in [&mut half.tints, &mut half.sky_tints] {
                for _ in 0..self.next()? {
                    let k = self.next()?;
                    tints.push((k, Rgb::from_array(self.three()?.map(f32::from_bits))));
                }
            }
        }
        self.0.is_empty().then_some(())
    }
}
