//! Skies that are found by brightness samples, at every patch: what is sharp of a sky with a picture, and skies through portals.
//!
//! It goes as with lights ([`direct`](super::direct)): a few samples from every patch, and where they and those of the patches around
//! agree about what is seen, no more but as the sky's own unevenness asks for. Where they don't, a shadow's edge is near, and
//! the patch looks closely; what grain is left then is taken out ([`Penumbra`]).

use super::Lit;
use super::at_block::at_block;
use super::direct::{GRAIN, MOST_ROUNDS, SHARE, SHARP};
use super::penumbra::Penumbra;
use super::receiver::Arriving;
use super::shadow::Ballot;
use super::skylight::{SkyFound, SkyLook, look, smooth_glimpse};
use crate::Result;
use crate::color::luminance;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;

/// Samples of an even part of the sky, from a patch that no shadow is near, at most.
const MOST_EVEN: u32 = 256;

/// Looks at the skies of blocks.
struct Skies<'a> {
    lit: &'a Lit<'a>,
    blocks: &'a [Range<usize>],
    /// Mean light around each [lx]: from lights, and from the smooth part of the sky.
    around: Vec<f32>,
    progress: &'a dyn Progress,
}

/// What is known of patches.
struct Known {
    arriving: Vec<Arriving>,
    ballots: Vec<Ballot>,
    /// Of what arrives [lx^2], by patch; 0 where no shadow is near.
    variance: Vec<f32>,
    is_close: Vec<bool>,
}

/// Adds what brightness samples find of skies to what arrives at patches; `around` is the mean light of lights at each block [lx].
/// Twice as many units of work as there are patches.
///
/// # Errors
/// `Cancelled`.
pub(super) fn add_sky(
    lit: &Lit,
    blocks: &[Range<usize>],
    around: &[f32],
    arriving: &mut [Arriving],
    progress: &dyn Progress,
) -> Result<()> {
    let mut skies = Skies { lit, blocks, around: around.to_vec(), progress };
    let mut known = skies.glance(arriving.len())?;
    skies.follow(&mut known)?;
    skies.settle(&mut known)?;
    for (sum, sky) in arriving.iter_mut().zip(known.arriving) {
        sum.transport += sky.transport;
        sum.shown += sky.shown;
        sum.other += sky.other;
        sum.rays += sky.rays;
    }
    Ok(())
}

impl Skies<'_> {
    /// A few samples from every patch of `count`.
    fn glance(&mut self, count: usize) -> Result<Known> {
        let error = GRAIN * self.lit.params.shadow_error;
        let glance = |(block, around): (&Range<usize>, &f32)| {
            self.progress.check()?;
            self.progress.advance(block.len() as u64);
            let all: Vec<usize> = block.clone().collect();
            let mut smooth = 0.0;
            let found = at_block(self.lit, self.lit.lights, block, &all, |sight, _, sites| {
                let sum: f32 = sites.iter().map(|site| smooth_glimpse(sight, site.receiver, 0)).sum();
                smooth = sum / sites.len().max(1) as f32;
                let glance = SkyLook { closely: false, around: around + smooth, error, most_samples: MOST_EVEN };
                sites.iter().map(|site| look(sight, site.receiver, glance)).collect()
            });
            Ok((found, smooth))
        };
        let blocks = self.blocks.par_iter().zip(&self.around).with_max_len(SHARE);
        let found: Vec<(Vec<SkyFound>, f32)> = blocks.map(glance).collect::<Result<_>>()?;
        let mut known = Known {
            arriving: Vec::with_capacity(count),
            ballots: Vec::with_capacity(count),
            variance: vec![0.0; count],
            is_close: vec![false; count],
        };
        for ((found, smooth), around) in found.into_iter().zip(&mut self.around) {
            let seen: f32 = found.iter().map(|f| luminance(f.arriving.transport)).sum();
            *around += smooth + seen / found.len().max(1) as f32;
            known.arriving.extend(found.iter().map(|f| f.arriving));
            known.ballots.extend(found.iter().map(|f| f.ballot));
        }
        Ok(known)
    }

    /// Looks closely wherever it is disputed what is seen, and follows what is found.
    fn follow(&self, known: &mut Known) -> Result<()> {
        let count = known.ballots.len();
        let mut candidates: Vec<usize> = (0..count).filter(|&i| !self.lit.is_known(i)).collect();
        for round in 0..MOST_ROUNDS {
            let wanted = |i: &usize| {
                let all = self.lit.ground.neighbours(*i).fold(known.ballots[*i], |all, j| all.or(known.ballots[j]));
                !known.is_close[*i] && all.disputed(known.ballots[*i]) != 0
            };
            let wanted: Vec<usize> = candidates.into_par_iter().filter(wanted).collect();
            if round == 0 {
                self.progress.advance((count - wanted.len()) as u64);
            }
            let mut next = Vec::new();
            for (&i, found) in wanted.iter().zip(self.examine(&wanted, GRAIN, round == 0)?) {
                known.is_close[i] = true;
                known.put(i, found);
                let ballot = found.ballot.or(known.ballots[i]);
                if ballot != known.ballots[i] {
                    known.ballots[i] = ballot;
                    next.extend(self.lit.ground.neighbours(i));
                }
            }
            if next.is_empty() {
                break;
            }
            next.sort_unstable();
            next.dedup();
            candidates = next;
        }
        Ok(())
    }

    /// Takes the grain out, and has another look at what the patches around can't tell.
    fn settle(&self, known: &mut Known) -> Result<()> {
        let Lit { ground, exposure, .. } = *self.lit;
        let first = Penumbra::new(ground, exposure, &known.arriving, &known.variance);
        let sharp = first.patches.iter().zip(&first.kept).filter(|(_, kept)| **kept > SHARP);
        let sharp: Vec<usize> = sharp.map(|(&i, _)| i as usize).collect();
        if sharp.is_empty() {
            first.settle(&mut known.arriving);
            return Ok(());
        }
        for (&i, found) in sharp.iter().zip(self.examine(&sharp, 1.0, false)?) {
            known.put(i, found);
        }
        Penumbra::new(ground, exposure, &known.arriving, &known.variance).settle(&mut known.arriving);
        Ok(())
    }

    /// Looks closely at patches, in order, to so many times the error of shadows.
    fn examine(&self, wanted: &[usize], grain: f32, advance: bool) -> Result<Vec<SkyFound>> {
        let error = grain * self.lit.params.shadow_error;
        let block_of = |i: usize| self.blocks.partition_point(|block| block.end <= i);
        let by_block: Vec<(usize, &[usize])> = wanted
            .chunk_by(|i, j| self.blocks[block_of(*i)].contains(j))
            .map(|wanted| (block_of(wanted[0]), wanted))
            .collect();
        let looked: Vec<Vec<SkyFound>> = by_block
            .into_par_iter()
            .with_max_len(SHARE)
            .map(|(b, members)| {
                self.progress.check()?;
                let most_samples = self.lit.params.most_samples(self.progress);
                let close = SkyLook { closely: true, around: self.around[b], error, most_samples };
                let found = at_block(self.lit, self.lit.lights, &self.blocks[b], members, |sight, _, sites| {
                    sites.iter().map(|site| look(sight, site.receiver, close)).collect()
                });
                if advance {
                    self.progress.advance(members.len() as u64);
                }
                Ok(found)
            })
            .collect::<Result<_>>()?;
        Ok(looked.into_iter().flatten().collect())
    }
}

impl Known {
    /// Puts what was found in the place of what was known before, with the rays that took.
    fn put(&mut self, i: usize, found: SkyFound) {
        self.arriving[i] = Arriving { rays: self.arriving[i].rays + found.arriving.rays, ..found.arriving };
        self.variance[i] = found.variance;
    }
}
