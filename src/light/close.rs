//! Close looks at shadows: wherever a light is disputed between a patch and those around, edges are followed.

use super::at_block::at_block;
use super::direct::{GRAIN, MOST_ROUNDS, SHARE, SHARP};
use super::penumbra::Penumbra;
use super::receiver::{Arriving, Site};
use super::shadow::{Ballot, Examined, Look, Volley, examine};
use super::touched::Touch;
use super::{Lights, Lit};
use crate::Result;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;

/// Close looks at the light of blocks.
pub(super) struct Close<'a> {
    pub lit: &'a Lit<'a>,
    /// The lamps that patches are cut for.
    pub all: &'a Lights,
    pub blocks: &'a [Range<usize>],
    /// Mean light around each [lx].
    pub around: &'a [f32],
    /// Patches that may be looked at, where not all may.
    pub touched: Option<&'a [Touch]>,
    pub progress: &'a dyn Progress,
}

/// Patches that were looked at closely.
pub(super) struct Noise {
    /// The bits of the emitters concerned, by patch.
    closely: Vec<u32>,
    /// What is left of noise [lx^2] (luminance), by patch.
    variance: Vec<f32>,
}

impl Close<'_> {
    /// Looks closely wherever a light is disputed, and follows what is found.
    pub fn follow(&self, mut ballots: Vec<Ballot>, arriving: &mut [Arriving]) -> Result<Noise> {
        let lit = self.lit;
        let mut noise = Noise { closely: vec![0; ballots.len()], variance: vec![0.0; ballots.len()] };
        let may = |i: &usize| self.touched.is_none_or(|touched| touched[*i] == Touch::Whole);
        // Patches around which something may be disputed that was not before.
        let mut candidates: Vec<usize> = (0..ballots.len()).filter(may).collect();
        for _ in 0..MOST_ROUNDS {
            let wanted = |i: usize| {
                if ballots[i] == Ballot::default() {
                    return None;
                }
                let all = lit.ground.neighbours(i).fold(ballots[i], |all, j| all.or(ballots[j]));
                let disputed = all.disputed(ballots[i]);
                (disputed & !noise.closely[i] != 0).then_some((i, disputed | noise.closely[i]))
            };
            let wanted: Vec<(usize, u32)> = candidates.into_par_iter().filter_map(wanted).collect();
            let mut next = Vec::new();
            for (&(i, bits), examined) in
                wanted.iter().zip(self.examine(&wanted, GRAIN * lit.params.shadow_error, false)?)
            {
                noise.closely[i] = bits;
                let ballot = examined.ballot;
                examined.replace(&mut arriving[i], &mut noise.variance[i]);
                if ballot != ballots[i] {
                    ballots[i] = ballot.or(ballots[i]);
                    next.extend(lit.ground.neighbours(i).filter(may));
                }
            }
            if next.is_empty() {
                break;
            }
            next.sort_unstable();
            next.dedup();
            candidates = next;
        }
        Ok(noise)
    }

    /// Takes the grain out of penumbrae, and has another look at what the patches around can't tell.
    pub fn settle(&self, mut noise: Noise, arriving: &mut [Arriving]) -> Result<()> {
        let Lit { ground, exposure, .. } = *self.lit;
        let first = Penumbra::new(ground, exposure, arriving, &noise.variance);
        let sharp = |(&i, &kept): (&u32, &f32)| (kept > SHARP).then_some((i as usize, noise.closely[i as usize]));
        let sharp: Vec<(usize, u32)> = first.patches.iter().zip(&first.kept).filter_map(sharp).collect();
        for (&(i, _), examined) in sharp.iter().zip(self.examine(&sharp, self.lit.params.shadow_error, true)?) {
            examined.replace(&mut arriving[i], &mut noise.variance[i]);
        }
        let settled = if sharp.is_empty() { first } else { Penumbra::new(ground, exposure, arriving, &noise.variance) };
        settled.settle(arriving);
        Ok(())
    }

    /// Examines patches, in order, each with the bits of emitters that it looks at closely.
    fn examine(&self, wanted: &[(usize, u32)], error: f32, evenly: bool) -> Result<Vec<Examined>> {
        let block_of = |i: usize| self.blocks.partition_point(|block| block.end <= i);
        let by_block: Vec<(usize, &[(usize, u32)])> = wanted
            .chunk_by(|(i, _), (j, _)| self.blocks[block_of(*i)].contains(j))
            .map(|wanted| (block_of(wanted[0].0), wanted))
            .collect();
        let looked: Vec<Vec<Examined>> = by_block
            .into_par_iter()
            .with_max_len(SHARE)
            .map(|(b, wanted)| {
                self.progress.check()?;
                let most_samples = self.lit.params.most_samples(self.progress);
                let (members, bits): (Vec<usize>, Vec<u32>) = wanted.iter().copied().unzip();
                Ok(at_block(self.lit, self.all, &self.blocks[b], &members, |sight, emitters, sites| {
                    let mut volley = Volley::default();
                    let look = |(site, bits): (&Site, &u32)| {
                        let (closely, around) = (*bits, self.around[b]);
                        let look = Look { closely, around, error, most_samples, evenly };
                        examine(sight, emitters, site, look, &mut volley)
                    };
                    sites.iter().zip(&bits).map(look).collect()
                }))
            })
            .collect::<Result<_>>()?;
        Ok(looked.into_iter().flatten().collect())
    }
}
