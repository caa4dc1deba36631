//! Direct light at every patch: what arrives from each light without occluders, exact or nearly so, times the share of the
//! light that is seen ([`shadow`](super::shadow)); brightness samples for what is sharp of a sky ([`sharp_sky`](super::sharp_sky)).
//!
//! A few shadow rays go from every patch to every light. Where they and those of the patches around agree, they are right,
//! and without noise. Where some see the light and some don't, a shadow's edge is near: the patch looks closely, with as
//! many rays as its share needs. What comes out of it may differ from the next patch again, so edges are followed.

use super::emitter::{Emitter, Sight};
use super::penumbra::Penumbra;
use super::receiver::Site;
use super::shadow::{Ballot, Examined, Look, Volley, examine, glance};
use super::sharp_sky::add_sky;
use super::skylight::{self, SkyLook};
use super::touched::Kept;
use super::{Lights, Lit};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::patch::{Cutter, Footprint, NONE, Sparse, footprint::Facet};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

pub use super::receiver::{Arriving, Receiver};

/// How much effort direct light gets.
#[derive(Clone, Debug)]
pub struct DirectParams {
    /// First shadow rays from a patch to each light, 1..=4.
    pub first_samples: u32,
    /// Standard error of the light from one emitter in a shadow, relative to all direct light around; more than 0.
    pub shadow_error: f32,
    /// Shadow samples shared among the clusters of a cut through many polygons, and of each polygon whose light varies. At least 1.
    pub cluster_samples: u32,
    /// Time that the whole bake may take [s]; none: as long as it needs. Past half of it shadows are looked at with few samples.
    pub time: Option<f64>,
    /// Whether irradiance is shown about the interpolated normal.
    pub shading_normals: bool,
    /// Whether stages find where their light comes from ([`crate::moments`]), too.
    pub moments: bool,
    pub seed: u32,
    /// Which of several units of lamps: each has shadow samples of its own, but the points are the same over which light is averaged that
    /// is known without shadows, as that of all must add up.
    pub unit: u32,
}

impl DirectParams {
    /// Samples of a close look at a light, at most.
    pub(super) fn most_samples(&self, progress: &dyn Progress) -> u32 {
        let is_late = |time: f64| progress.elapsed().as_secs_f64() > LATE * time;
        if self.time.is_some_and(is_late) { LATE_SAMPLES } else { MOST_SAMPLES }
    }
}

/// Irradiance straight from lights [lx], one a patch. Of the sky only what is sharp is in it ([`Sky::sharp`](super::Sky::sharp)).
#[derive(Clone, Debug)]
pub struct Direct {
    /// About the normal that is shown.
    pub shown: Sparse,
    /// About the geometric normal, for transport.
    pub transport: Arc<Vec<Rgb>>,
    /// The part of `transport` from lights that are no surface, as flux over all patches [lm].
    pub inflow: DVec3,
    /// Shadow rays that were traced.
    pub rays: u64,
}

impl Direct {
    /// With `other` added.
    pub fn plus(self, other: &Self) -> Self {
        let sum = |a: &[Rgb], b: &dyn Fn(usize) -> Rgb| -> Vec<Rgb> { (0..a.len()).map(|i| a[i] + b(i)).collect() };
        let transport = Arc::new(sum(&self.transport, &|i| other.transport[i]));
        let shown = Sparse::new(Arc::clone(&transport), (0..transport.len()).map(|i| self.shown[i] + other.shown[i]));
        Self { shown, transport, inflow: self.inflow + other.inflow, rays: self.rays + other.rays }
    }

    /// The same with the numbers that patches have now, of which there are `patches`; those that had none are dark.
    pub(super) fn renumbered(&self, numbers: &[u32], patches: usize) -> Self {
        let (mut transport, mut shown) = (vec![Rgb::ZERO; patches], vec![Rgb::ZERO; patches]);
        for (before, &now) in numbers.iter().enumerate().filter(|(_, now)| **now != NONE) {
            (transport[now as usize], shown[now as usize]) = (self.transport[before], self.shown[before]);
        }
        let transport = Arc::new(transport);
        let shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
        Self { shown, transport, inflow: self.inflow, rays: self.rays }
    }
}

/// Blocks of 2^3 texels a side share a cut through the light tree and the rays of a glance.
pub(super) const BLOCK_LEVEL: u32 = 3;
/// Blocks that a thread takes at once, at most: those in a penumbra cost far more than others.
pub(super) const SHARE: usize = 8;
/// Seeds of units differ by multiples of this.
const APART: u32 = 0x9E37_79B9;
/// One of so many blocks tells about the light of all.
const GLIMPSED: usize = 16;
/// Blocks that are glanced at before what was seen is put away.
const BATCH: usize = 2048;
/// Shadow rays from a patch to one light, at most.
const MOST_SAMPLES: u32 = 1024;
/// The same past this share of the time that there is.
const LATE: f64 = 0.5;
const LATE_SAMPLES: u32 = 16;
/// The same from one of the several receivers of a surface that no texel shows.
pub(super) const MOST_ARRIVING: u32 = 64;
/// What neighbours take out of it, noise may be more at first.
pub(super) const GRAIN: f32 = 2.0;
/// Patches that keep more than this share of their difference to those around are looked at until they have no noise to speak of.
pub(super) const SHARP: f32 = 0.5;
/// How often shadow edges are followed to patches around; each time by one patch.
pub(super) const MOST_ROUNDS: usize = 16;

/// Direct light at every patch that is not buried.
///
/// # Errors
/// `Cancelled`.
pub fn direct(lit: &Lit, progress: &dyn Progress) -> Result<Direct> {
    direct_beside(lit, &[], None, progress)
}

/// About the direct light that falls on patches, added up [lm], by channel: from a first look at some of them.
///
/// # Errors
/// `Cancelled`.
pub(super) fn glimpse_flux(lit: &Lit, progress: &dyn Progress) -> Result<DVec3> {
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    // A block is of one chart.
    let some: Vec<&Range<usize>> = blocks.iter().filter(|block| !lit.is_known(block.start)).step_by(GLIMPSED).collect();
    let has_sky = lit.lights.has_sharp_sky();
    let of_block = |block: &&Range<usize>| {
        progress.check()?;
        let all: Vec<usize> = (*block).clone().collect();
        let found = at_block(lit, block, &all, |sight, emitters, sites| {
            let mut found = glance(sight, emitters, sites, &mut Volley::default());
            if has_sky {
                for ((sum, _), site) in found.iter_mut().zip(sites) {
                    sum.transport += skylight::look(sight, site.receiver, SkyLook::FIRST).arriving.transport;
                }
            }
            found
        });
        let flux = all
            .iter()
            .zip(&found)
            .map(|(&i, (arriving, _))| arriving.transport.as_dvec3() * f64::from(lit.exposure.area[i]));
        Ok(flux.sum::<DVec3>())
    };
    let each: Vec<DVec3> = some.par_iter().with_max_len(SHARE).map(of_block).collect::<Result<_>>()?;
    Ok(each.iter().sum::<DVec3>() * GLIMPSED as f64)
}

/// As [`direct`], where `beside` it there is other light [lx], by patch: shadows are looked at less closely in it. Empty: none. Of what is
/// `kept` from before a change, that alone is found anew which the change can touch.
///
/// # Errors
/// `Cancelled`.
pub(super) fn direct_beside(lit: &Lit, beside: &[Rgb], kept: Option<&Kept>, progress: &dyn Progress) -> Result<Direct> {
    let patches = lit.ground.patches;
    let has_sky = lit.lights.has_sharp_sky();
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    let (mut arriving, mut ballots) = (Vec::with_capacity(patches.len()), Vec::with_capacity(patches.len()));
    let mut around = Vec::with_capacity(blocks.len());
    let touched = kept.map(|kept| (kept, kept.touched(lit, &blocks)));
    for (first, batch) in (0..).step_by(BATCH).zip(blocks.chunks(BATCH)) {
        let look = |(b, block): (usize, &Range<usize>)| {
            progress.check()?;
            progress.advance(block.len() as u64);
            if let Some((kept, touched)) = &touched
                && !touched[first + b]
            {
                return Ok(block.clone().map(|i| (kept.arriving(i), Ballot::default())).collect());
            }
            let all: Vec<usize> = block.clone().collect();
            Ok(at_block(lit, block, &all, |sight, emitters, sites| {
                glance(sight, emitters, sites, &mut Volley::default())
            }))
        };
        let glances: Vec<Vec<(Arriving, Ballot)>> =
            batch.par_iter().enumerate().with_max_len(SHARE).map(look).collect::<Result<_>>()?;
        around.extend(glances.iter().map(|block| mean_light(block)));
        for (arrived, ballot) in glances.into_iter().flatten() {
            arriving.push(arrived);
            ballots.push(ballot);
        }
    }
    for (around, block) in around.iter_mut().zip(&blocks) {
        let others = beside.get(block.clone()).unwrap_or_default();
        *around += others.iter().map(|e| luminance(*e)).sum::<f32>() / block.len() as f32;
    }
    let close = Close { lit, blocks: &blocks, around: &around, progress };
    let noise = close.follow(ballots, &mut arriving)?;
    close.settle(noise, &mut arriving)?;
    if has_sky {
        add_sky(lit, &blocks, &around, &mut arriving, progress)?;
    }
    let mut inflow = DVec3::ZERO;
    for (i, a) in arriving.iter().enumerate().filter(|(i, _)| lit.ground.casts(*i)) {
        inflow += a.other.as_dvec3() * lit.exposure.taking_area(i);
    }
    let rays = arriving.iter().map(|a| a.rays).sum();
    let transport: Arc<Vec<Rgb>> = Arc::new(arriving.iter().map(|a| a.transport).collect());
    let shown = match lit.params.shading_normals {
        true => Sparse::new(Arc::clone(&transport), arriving.iter().map(|a| a.shown)),
        false => Sparse::same(Arc::clone(&transport)),
    };
    Ok(Direct { shown, transport, inflow, rays })
}

/// Everything that arrives straight from lights at `receiver`.
pub fn arrive(scene: &Scene, tracer: &Tracer, lights: &Lights, receiver: &Receiver, params: &DirectParams) -> Arriving {
    let sight = Sight { scene, tracer, lights, params };
    look_at(&sight, receiver, u32::MAX)
}

/// The same by the first shadow rays alone: noisy in penumbrae, for receivers that are only seen among many others.
pub fn glimpse(
    scene: &Scene,
    tracer: &Tracer,
    lights: &Lights,
    receiver: &Receiver,
    params: &DirectParams,
) -> Arriving {
    let sight = Sight { scene, tracer, lights, params };
    look_at(&sight, receiver, 0)
}

/// What arrives at `receiver`; the lights whose bits are set in `closely` are looked at closely.
fn look_at(sight: &Sight, receiver: &Receiver, closely: u32) -> Arriving {
    let emitters = sight.emitters(receiver.position, receiver.normal, receiver.radius);
    let site = Site::new(receiver, 0.0, None);
    // Of the light around nothing is known.
    let error = sight.params.shadow_error;
    let look = Look { closely, around: 0.0, error, most_samples: MOST_ARRIVING, evenly: false };
    let mut sum = examine(sight, &emitters, &site, look, &mut Volley::default()).arriving;
    let sky = match closely {
        0 => SkyLook::FIRST,
        _ => SkyLook { closely: true, around: luminance(sum.transport), error, most_samples: MOST_ARRIVING },
    };
    let sky = skylight::look(sight, receiver, sky).arriving;
    sum.transport += sky.transport;
    sum.shown += sky.shown;
    sum.other += sky.other;
    sum.rays += sky.rays;
    sum
}

/// Mean luminance of what arrives at a block's patches [lx].
fn mean_light(block: &[(Arriving, Ballot)]) -> f32 {
    block.iter().map(|(a, _)| luminance(a.transport)).sum::<f32>() / block.len() as f32
}

/// Close looks at the light of blocks.
struct Close<'a> {
    lit: &'a Lit<'a>,
    blocks: &'a [Range<usize>],
    /// Mean light around each [lx].
    around: &'a [f32],
    progress: &'a dyn Progress,
}

/// Patches that were looked at closely.
struct Noise {
    /// The bits of the emitters concerned, by patch.
    closely: Vec<u32>,
    /// What is left of noise [lx^2] (luminance), by patch.
    variance: Vec<f32>,
}

impl Close<'_> {
    /// Looks closely wherever a light is disputed, and follows what is found.
    fn follow(&self, mut ballots: Vec<Ballot>, arriving: &mut [Arriving]) -> Result<Noise> {
        let lit = self.lit;
        let mut noise = Noise { closely: vec![0; ballots.len()], variance: vec![0.0; ballots.len()] };
        // Patches around which something may be disputed that was not before.
        let mut candidates: Vec<usize> = (0..ballots.len()).filter(|&i| !lit.is_known(i)).collect();
        for _ in 0..MOST_ROUNDS {
            let wanted = |i: usize| {
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
                    next.extend(lit.ground.neighbours(i));
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
    fn settle(&self, mut noise: Noise, arriving: &mut [Arriving]) -> Result<()> {
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
                Ok(at_block(self.lit, &self.blocks[b], &members, |sight, emitters, sites| {
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

/// Applies `look` to the sites of `members` of a block, in the light of the block's emitters; buried members have none, and get
/// the default.
pub(super) fn at_block<T: Clone + Default>(
    lit: &Lit,
    block: &Range<usize>,
    members: &[usize],
    look: impl FnOnce(&Sight, &[Emitter], &[Site]) -> Vec<T>,
) -> Vec<T> {
    let Lit { ground, exposure, lights, params, .. } = *lit;
    let patches = ground.patches;
    let mut all = vec![T::default(); members.len()];
    if lit.is_known(block.start) {
        return all;
    }
    let mut cutter = Cutter::new(ground);
    let cut = |k: usize| {
        let i = members[k];
        let mut footprint = (!exposure.is_buried(i)).then(|| cutter.footprint(i)).filter(|f| !f.is_empty())?;
        footprint.restrict(exposure.cells[i]);
        Some((k, footprint))
    };
    let (open, footprints): (Vec<usize>, Vec<Footprint>) = (0..members.len()).filter_map(cut).unzip();
    if open.is_empty() {
        return all;
    }
    let samples: Vec<_> = footprints.iter().map(|f| |u| f.sample(u)).collect();
    let receiver = |(k, &member): (usize, &usize)| {
        let i = members[member];
        Receiver {
            sample: &samples[k],
            position: patches.position[i],
            normal: patches.normal[i],
            radius: footprints[k].radius(patches.position[i]),
            sequence: Sequence::new(params.seed, Stage::Direct, i as u64),
            apart: Sequence::new(params.seed ^ APART.wrapping_mul(params.unit), Stage::Direct, i as u64),
        }
    };
    let receivers: Vec<Receiver> = open.iter().enumerate().map(receiver).collect();
    let sight = Sight { scene: ground.scene, tracer: ground.tracer, lights, params };
    let emitters = emitters(lit, &sight, block);
    let nearest = |r: &Receiver| sight.nearest(&emitters, r.position);
    let sites: Vec<Site> = receivers.iter().zip(&footprints).map(|(r, f)| Site::new(r, nearest(r), Some(f))).collect();
    for (k, found) in open.into_iter().zip(look(&sight, &emitters, &sites)) {
        all[k] = found;
    }
    all
}

/// Patches of a block whose normals differ from the first one's by no more than this cosine face one way.
const ONE_WAY: f32 = 0.999;

/// The emitters that can light a block, whichever of its patches are asked for.
fn emitters(lit: &Lit, sight: &Sight, block: &Range<usize>) -> Vec<Emitter> {
    let patches = lit.ground.patches;
    let positions = &patches.position[block.clone()];
    let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
    // A patch reaches beyond its middle by a diagonal at most.
    let reach = |i: usize| patches.position[i].distance(centre) + (2.0 * patches.area[i]).sqrt();
    let widest = block.clone().map(reach).fold(0.0, f32::max);
    let first = patches.normal[block.start];
    let is_level = block.clone().all(|i| patches.normal[i].dot(first) > ONE_WAY) && !is_shown_round(lit, block);
    let normal = if is_level { first } else { Vec3::ZERO };
    sight.emitters(centre, normal, widest)
}

/// True where some patch of a block is shown rounder than it is, so that it may be lit from below its own horizon.
fn is_shown_round(lit: &Lit, block: &Range<usize>) -> bool {
    let Lit { ground, params, .. } = *lit;
    let mut last = NONE;
    params.shading_normals
        && block.clone().any(|i| {
            let number = ground.patches.first_triangle(i);
            let is_new = std::mem::replace(&mut last, number) != number;
            let (surface, triangle) = ground.tracer.place(number);
            is_new && Facet::new(ground.scene, surface, triangle).is_round()
        })
}
