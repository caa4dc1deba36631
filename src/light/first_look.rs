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
pub(super) const MOST_HELD: usize = 288;

/// Blocks that are looked at before what was seen is put away.
const BATCH: usize = 2048;

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
    /// By patch, where it was at all of them.
    arriving: Vec<Arriving>,
    ballots: Vec<Ballot>,
    /// By block and patch, where it was at some: empty where it wasn't.
    found: Vec<Vec<Glanced>>,
    /// The mean over each block of what arrives from lamps, and by brightness samples from the sky [lx].
    pub means: Vec<[Rgb; 2]>,
}

impl FirstLook {
    /// Of a `unit`, at so many patches.
    fn of(unit: &Looking, patches: usize) -> Self {
        let room = if unit.is_held && unit.kept.is_none() { patches } else { 0 };
        Self { arriving: Vec::with_capacity(room), ballots: Vec::with_capacity(room), ..Self::default() }
    }

    /// Adds what was `found` at the next block.
    fn add(&mut self, unit: &Looking, found: Vec<Glanced>, mean: [Rgb; 2]) {
        self.means.push(mean);
        match unit.kept {
            Some(_) => self.found.push(found),
            None => {
                self.arriving.extend(found.iter().map(|glanced| glanced.0));
                self.ballots.extend(found.iter().map(|glanced| glanced.1));
            }
        }
    }

    /// What arrives at each patch, and what it saw: from before the change where nothing was looked at.
    pub fn on_patches(mut self, blocks: &[Range<usize>], kept: Option<&Kept>) -> (Vec<Arriving>, Vec<Ballot>) {
        let Some(kept) = kept else { return (self.arriving, self.ballots) };
        for (found, block) in self.found.into_iter().zip(blocks) {
            if found.is_empty() {
                self.arriving.extend(block.clone().map(|i| kept.arriving(i)));
            }
            for (arrived, ballot) in found {
                self.arriving.push(arrived);
                self.ballots.push(ballot);
            }
            self.ballots.resize(self.arriving.len(), Ballot::default());
        }
        (self.arriving, self.ballots)
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
    if units.is_empty() {
        return Ok(Vec::new());
    }
    let of_block = |(b, block): (usize, &Range<usize>)| {
        progress.check()?;
        progress.advance((units.len() * block.len()) as u64);
        Ok(look_from(lit, units, b, block))
    };
    let mut looks: Vec<FirstLook> = units.iter().map(|unit| FirstLook::of(unit, lit.ground.patches.len())).collect();
    for (first, batch) in (0..).step_by(BATCH).zip(blocks.chunks(BATCH)) {
        let of_batch: Vec<Vec<(Vec<Glanced>, [Rgb; 2])>> = batch
            .par_iter()
            .enumerate()
            .with_max_len(SHARE)
            .map(|(b, block)| of_block((first + b, block)))
            .collect::<Result<_>>()?;
        for of_units in of_batch {
            for ((look, unit), (found, mean)) in looks.iter_mut().zip(units).zip(of_units) {
                look.add(unit, found, mean);
            }
        }
    }
    Ok(looks)
}

/// What patches of block number `b` see of each of `units`, and the means over the block.
fn look_from(lit: &Lit, units: &[Looking], b: usize, block: &Range<usize>) -> Vec<(Vec<Glanced>, [Rgb; 2])> {
    let is_seen = |unit: &Looking, i: usize| unit.kept.is_none_or(|kept| kept.touched()[i] != Touch::None);
    let is_member = |i: &usize| !lit.is_known(*i) && units.iter().any(|unit| is_seen(unit, *i));
    let members: Vec<usize> = block.clone().filter(is_member).collect();
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
