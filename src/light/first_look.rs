//! A first look at lamps, unit by unit: what arrives by a few shadow rays from every patch, and what they saw.
//!
//! Most of what it takes is the same for all: the parts that a patch consists of, and points on them. So all units are looked at in one go.

use super::at_block::with_sites;
use super::emitter::Sight;
use super::receiver::{Arriving, Site};
use super::shadow::{Ballot, Volley, glance};
use super::skylight::{self, SkyLook};
use super::touched::{Kept, Touch};
use super::{Lit, direct::SHARE};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;

/// One of so many patches of a block tells how bright the sky is there.
const SKY_PATCHES: usize = 16;

/// Bytes that first looks may hold, for each patch.
pub(super) const MOST_HELD: usize = 256;

/// What a first look at one patch takes [bytes].
pub(super) const EACH: usize = size_of::<Glanced>();

/// What a patch got, and what it saw.
type Glanced = (Arriving, Ballot);

/// A unit of lamps that is looked at.
pub(super) struct Looking<'a> {
    /// With its lights and numbers.
    pub lit: Lit<'a>,
    /// What is known from before a change.
    pub kept: Option<&'a Kept<'a>>,
    /// Whether more than the means is wanted.
    pub is_held: bool,
}

/// What a first look at one unit found.
#[derive(Default)]
pub(super) struct FirstLook {
    /// By block and patch; empty where nothing was looked at.
    found: Vec<Vec<Glanced>>,
    /// The mean over each block of what arrives from lamps, and by brightness samples from the sky [lx].
    pub means: Vec<[Rgb; 2]>,
}

impl FirstLook {
    /// What arrives at each patch, and what it saw: from before the change where nothing was looked at.
    pub fn on_patches(self, blocks: &[Range<usize>], kept: Option<&Kept>) -> (Vec<Arriving>, Vec<Ballot>) {
        let count = blocks.last().map_or(0, |last| last.end);
        let (mut arriving, mut ballots) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for (found, block) in self.found.into_iter().zip(blocks) {
            if found.is_empty() {
                arriving.extend(block.clone().map(|i| kept.map_or_else(Arriving::default, |kept| kept.arriving(i))));
            }
            for (arrived, ballot) in found {
                arriving.push(arrived);
                ballots.push(ballot);
            }
            ballots.resize(arriving.len(), Ballot::default());
        }
        (arriving, ballots)
    }
}

/// Looks at `units` from all patches, or from those alone that a change can touch.
///
/// # Errors
/// `Cancelled`.
pub(super) fn first_looks(
    lit: &Lit,
    units: &[Looking],
    blocks: &[Range<usize>],
    progress: &dyn Progress,
) -> Result<Vec<FirstLook>> {
    let of_block = |(b, block): (usize, &Range<usize>)| {
        progress.check()?;
        progress.advance((units.len() * block.len()) as u64);
        Ok(look_from(lit, units, b, block))
    };
    let by_block: Vec<Vec<(Vec<Glanced>, [Rgb; 2])>> =
        blocks.par_iter().enumerate().with_max_len(SHARE).map(of_block).collect::<Result<_>>()?;
    let mut looks: Vec<FirstLook> = units.iter().map(|_| FirstLook::default()).collect();
    for of_units in by_block {
        for (look, (found, mean)) in looks.iter_mut().zip(of_units) {
            look.found.push(found);
            look.means.push(mean);
        }
    }
    Ok(looks)
}

/// What patches of block number `b` see of each of `units`, and the means over the block.
fn look_from(lit: &Lit, units: &[Looking], b: usize, block: &Range<usize>) -> Vec<(Vec<Glanced>, [Rgb; 2])> {
    let is_seen = |unit: &Looking, i: usize| unit.kept.is_none_or(|kept| kept.touched()[i] != Touch::None);
    let members: Vec<usize> = block.clone().filter(|&i| units.iter().any(|unit| is_seen(unit, i))).collect();
    let start = |unit: &Looking| match unit.kept {
        None => (vec![Glanced::default(); block.len()], [Rgb::ZERO; 2]),
        Some(kept) if block.clone().any(|i| is_seen(unit, i)) => {
            (block.clone().map(|i| (kept.outside(i), Ballot::default())).collect(), [Rgb::ZERO; 2])
        }
        Some(kept) => (Vec::new(), [kept.means[b], Rgb::ZERO]),
    };
    let mut all: Vec<(Vec<Glanced>, [Rgb; 2])> = units.iter().map(start).collect();
    with_sites(lit, lit.lights, block, &members, |stance, open, sites| {
        let mut volley = Volley::default();
        for (unit, (found, mean)) in units.iter().zip(&mut all) {
            let own = open.iter().zip(sites).map(|(&k, site)| (members[k], site));
            let (own, sites): (Vec<usize>, Vec<&Site>) = own.filter(|(i, _)| is_seen(unit, *i)).unzip();
            if own.is_empty() {
                continue;
            }
            let sight = Sight::of(&unit.lit);
            for (i, (arriving, ballot)) in
                own.into_iter().zip(glance(&sight, &stance.emitters(&sight), &sites, &mut volley))
            {
                let slot = &mut found[i - block.start];
                // Patches beside those that are touched are asked what they see alone.
                if unit.kept.is_none_or(|kept| kept.touched()[i] == Touch::Whole) {
                    slot.0 = arriving;
                }
                slot.1 = ballot;
            }
            if unit.lit.lights.has_sharp_sky() {
                let some = sites.iter().step_by(SKY_PATCHES);
                let share = sites.len() as f32 / (some.len() * block.len()) as f32;
                let light = |site: &&Site| skylight::look(&sight, site.receiver, SkyLook::FIRST).arriving.transport;
                mean[1] = some.map(light).sum::<Rgb>() * share;
            }
        }
    });
    for (unit, (found, mean)) in units.iter().zip(&mut all) {
        if !found.is_empty() {
            mean[0] = found.iter().map(|(arriving, _)| arriving.transport).sum::<Rgb>() / block.len() as f32;
        }
        if !unit.is_held {
            found.clear();
            found.shrink_to_fit();
        }
    }
    all
}
