//! Direct light at every patch: what arrives from each light without occluders, exact or nearly so, times the share of the
//! light that is seen ([`shadow`](super::shadow)); brightness samples for a sky with a picture.
//!
//! A few shadow rays go from every patch to every light. Where they and those of the patches around agree, they are right,
//! and without noise. Where some see the light and some don't, a shadow's edge is near: the patch looks closely, with as
//! many rays as its share needs. What comes out of it may differ from the next patch again, so edges are followed.

use super::emitter::{Emitter, Sight};
use super::receiver::Site;
use super::shadow::{Ballot, Look, Volley, examine, glance};
use super::skylight::{from_sky, through_portals};
use super::{Lights, Lit};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::patch::{Cutter, Footprint};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

pub use super::receiver::{Arriving, Receiver};
pub use super::skylight::hemisphere_weight;

/// How much effort direct light gets.
#[derive(Clone, Debug)]
pub struct DirectParams {
    /// First shadow rays from a patch to each light, 1..=4.
    pub first_samples: u32,
    /// Standard error of the light from one emitter in a shadow, relative to all direct light around; more than 0.
    pub shadow_error: f32,
    /// Shadow samples shared among the clusters of a cut through many polygons, and of each polygon whose light varies. At least 1.
    pub cluster_samples: u32,
    /// Brightness samples of a sky with a picture, for each ray of the final gather; 0 leaves the sky to the gather alone.
    pub sky_ratio: f32,
    /// Rays of the final gather.
    pub gather_samples: u32,
    /// Whether irradiance is shown about the interpolated normal.
    pub shading_normals: bool,
    pub seed: u32,
}

/// Irradiance straight from lights [lx], one a patch. The share of the sky that the gather finds is not in it.
#[derive(Clone, Debug)]
pub struct Direct {
    /// About the normal that is shown; the same memory as `transport` where that is the geometric one.
    pub shown: Arc<Vec<Rgb>>,
    /// About the geometric normal, for transport.
    pub transport: Arc<Vec<Rgb>>,
    /// The part of `transport` from lights that are no surface, as flux over all patches [lm].
    pub inflow: DVec3,
    /// Shadow rays that were traced.
    pub rays: u64,
}

/// Blocks of 2^3 texels a side share a cut through the light tree and the rays of a glance.
const BLOCK_LEVEL: u32 = 3;
/// Shadow rays from a patch to one light, at most.
const MOST_SAMPLES: u32 = 1024;
/// The same from one of the several receivers of a surface that no texel shows.
const MOST_ARRIVING: u32 = 64;
/// How often shadow edges are followed to patches around; each time by one patch.
const MOST_ROUNDS: usize = 16;

/// Direct light at every patch that is not buried.
///
/// # Errors
/// `Cancelled`.
pub fn direct(lit: &Lit, progress: &dyn Progress) -> Result<Direct> {
    let patches = lit.ground.patches;
    progress.begin("direct", patches.len() as u64);
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    let glances: Vec<Vec<(Arriving, Ballot)>> = blocks
        .par_iter()
        .map(|block| {
            progress.check()?;
            progress.advance(block.len() as u64);
            let all: Vec<usize> = block.clone().collect();
            Ok(at_block(lit, block, &all, |sight, emitters, sites| {
                glance(sight, emitters, sites, &mut Volley::default())
            }))
        })
        .collect::<Result<_>>()?;
    let around: Vec<f32> = glances.iter().map(|block| mean_light(block)).collect();
    let (mut arriving, ballots): (Vec<Arriving>, Vec<Ballot>) = glances.into_iter().flatten().unzip();
    look_closely(lit, &blocks, &around, ballots, &mut arriving, progress)?;
    if lit.lights.sky.as_ref().is_some_and(|sky| sky.has_picture()) || !lit.lights.portals.is_empty() {
        add_sky(lit, &blocks, &mut arriving, progress)?;
    }
    let mut inflow = DVec3::ZERO;
    for (a, area) in arriving.iter().zip(&lit.exposure.area) {
        inflow += a.other.as_dvec3() * f64::from(*area);
    }
    let rays = arriving.iter().map(|a| a.rays).sum();
    let transport: Arc<Vec<Rgb>> = Arc::new(arriving.iter().map(|a| a.transport).collect());
    let shown = match lit.params.shading_normals {
        true => Arc::new(arriving.iter().map(|a| a.shown).collect()),
        false => Arc::clone(&transport),
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
    let site = Site::new(receiver, 0.0, &[]);
    // Of the light around nothing is known.
    let look = Look { closely, around: 0.0, most_samples: MOST_ARRIVING };
    let (mut sum, _) = examine(sight, &emitters, &site, look, &mut Volley::default());
    from_sky(sight, receiver, false, &mut sum);
    through_portals(sight, receiver, false, &mut sum);
    sum
}

/// Mean luminance of what arrives at a block's patches [lx].
fn mean_light(block: &[(Arriving, Ballot)]) -> f32 {
    block.iter().map(|(a, _)| luminance(a.transport)).sum::<f32>() / block.len() as f32
}

/// Looks closely wherever a light is disputed, and follows what is found.
fn look_closely(
    lit: &Lit,
    blocks: &[Range<usize>],
    around: &[f32],
    mut ballots: Vec<Ballot>,
    arriving: &mut [Arriving],
    progress: &dyn Progress,
) -> Result<()> {
    let ground = lit.ground;
    let mut closely = vec![0u32; ballots.len()];
    // Patches around which something may be disputed that was not before, by block.
    let mut candidates: Vec<(usize, Vec<usize>)> =
        blocks.iter().enumerate().map(|(b, block)| (b, block.clone().collect())).collect();
    for _ in 0..MOST_ROUNDS {
        let found: Vec<Vec<(usize, u32, Arriving, Ballot)>> = candidates
            .par_iter()
            .map(|(b, patches)| {
                progress.check()?;
                let wanted = |i: &usize| {
                    let all = ground.neighbours(*i).fold(ballots[*i], |all, j| all.or(ballots[j]));
                    let disputed = all.disputed(ballots[*i]);
                    (disputed & !closely[*i] != 0).then_some((*i, disputed | closely[*i]))
                };
                let (members, bits): (Vec<usize>, Vec<u32>) = patches.iter().filter_map(wanted).unzip();
                if members.is_empty() {
                    return Ok(Vec::new());
                }
                let looked = at_block(lit, &blocks[*b], &members, |sight, emitters, sites| {
                    let mut volley = Volley::default();
                    let look = |(site, bits): (&Site, &u32)| {
                        let look = Look { closely: *bits, around: around[*b], most_samples: MOST_SAMPLES };
                        examine(sight, emitters, site, look, &mut volley)
                    };
                    sites.iter().zip(&bits).map(look).collect()
                });
                Ok(members.into_iter().zip(bits).zip(looked).map(|((i, c), (a, v))| (i, c, a, v)).collect())
            })
            .collect::<Result<_>>()?;
        let mut next = Vec::new();
        for (i, bits, arrived, ballot) in found.into_iter().flatten() {
            let rays = arriving[i].rays;
            arriving[i] = Arriving { rays: rays + arrived.rays, ..arrived };
            closely[i] = bits;
            if ballot != ballots[i] {
                ballots[i] = ballot.or(ballots[i]);
                next.extend(ground.neighbours(i));
            }
        }
        if next.is_empty() {
            break;
        }
        next.sort_unstable();
        next.dedup();
        let block_of = |i: usize| blocks.partition_point(|block| block.end <= i);
        candidates = next
            .chunk_by(|i, j| block_of(*i) == block_of(*j))
            .map(|patches| (block_of(patches[0]), patches.to_vec()))
            .collect();
    }
    Ok(())
}

/// Adds what brightness samples find of the sky.
fn add_sky(lit: &Lit, blocks: &[Range<usize>], arriving: &mut [Arriving], progress: &dyn Progress) -> Result<()> {
    let found: Vec<Vec<Arriving>> = blocks
        .par_iter()
        .map(|block| {
            progress.check()?;
            let all: Vec<usize> = block.clone().collect();
            Ok(at_block(lit, block, &all, |sight, _, sites| {
                let sky = |site: &Site| {
                    let mut sum = Arriving::default();
                    from_sky(sight, site.receiver, true, &mut sum);
                    through_portals(sight, site.receiver, true, &mut sum);
                    sum
                };
                sites.iter().map(sky).collect()
            }))
        })
        .collect::<Result<_>>()?;
    for (sum, sky) in arriving.iter_mut().zip(found.into_iter().flatten()) {
        sum.transport += sky.transport;
        sum.shown += sky.shown;
        sum.other += sky.other;
        sum.rays += sky.rays;
    }
    Ok(())
}

/// Applies `look` to the sites of `members` of a block, in the light of the block's emitters; buried members have none, and get
/// the default.
fn at_block<T: Clone + Default>(
    lit: &Lit,
    block: &Range<usize>,
    members: &[usize],
    look: impl FnOnce(&Sight, &[Emitter], &[Site]) -> Vec<T>,
) -> Vec<T> {
    let Lit { ground, exposure, lights, params, .. } = *lit;
    let patches = ground.patches;
    let mut all = vec![T::default(); members.len()];
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
        }
    };
    let receivers: Vec<Receiver> = open.iter().enumerate().map(receiver).collect();
    let parts: Vec<_> = footprints.iter().map(Footprint::flat_parts).collect();
    let sight = Sight { scene: ground.scene, tracer: ground.tracer, lights, params };
    let emitters = emitters(lit, &sight, block);
    let nearest = |r: &Receiver| sight.nearest(&emitters, r.position);
    let sites: Vec<Site> = receivers.iter().zip(&parts).map(|(r, parts)| Site::new(r, nearest(r), parts)).collect();
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
    let normals = &patches.normal[block.clone()];
    let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
    // A patch reaches beyond its middle by a diagonal at most.
    let reach = |i: usize| patches.position[i].distance(centre) + (2.0 * patches.area[i]).sqrt();
    let widest = block.clone().map(reach).fold(0.0, f32::max);
    let normal = if normals.iter().all(|n| n.dot(normals[0]) > ONE_WAY) { normals[0] } else { Vec3::ZERO };
    sight.emitters(centre, normal, widest)
}
