//! What surfaces emit and lands nowhere, from rays of its own.
//!
//! A lamp is often no more than a few blocks of texels, which look around with a few hundred rays in all: enough for the light
//! on the lamp, but all the power of the scene hangs on how many of them leave it. So the balance asks anew: [`RAYS`] rays from
//! all that emits, each standing for an equal share of the power, stratified over place and direction at once. The estimate is
//! exactly 0 in a closed scene. Cost: some hundredths of a second.

use crate::color::luminance;
use crate::gather::Backs;
use crate::light::Lit;
use crate::patch::{Cutter, NONE, SurfacePoint};
use crate::sample::Discrete;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::Ray;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Rays over all emitting surfaces: a power of two, at most [`Sequence::LENGTH`].
const RAYS: u32 = 1 << 15;

/// Rays that a thread takes at once.
const BATCH: u32 = 1 << 11;

/// One side of a patch that emits.
struct Emitting {
    patch: usize,
    back: bool,
    /// Power by channel [lm].
    power: DVec3,
}

/// The power [lm] that patches, and the backs that `backs` knows, emit to where nothing can send it back. Draws by the seed of `lit`.
pub(super) fn escaped(lit: &Lit, backs: &Backs) -> DVec3 {
    let sources = sources(lit, backs);
    let weight = |source: &Emitting| f64::from(luminance(source.power.as_vec3()));
    let Some(table) = Discrete::new(sources.iter().map(weight)) else { return DVec3::ZERO };
    let sequence = Sequence::new(lit.params.seed, Stage::Emitted, 0);
    let batch = |first: u32| -> DVec3 {
        let mut cutter = Cutter::new(lit.ground);
        let (mut rays, mut powers) = (Vec::new(), Vec::new());
        for index in first..(first + BATCH).min(RAYS) {
            let [pick, x, s, t] = sequence.point(index, 0);
            let (k, rest) = table.sample(pick);
            let source = &sources[k];
            let Some(point) = place(lit, &mut cutter, source, [rest, x]) else { continue };
            let origin = lit.ground.tracer.off_surface(point.position, point.normal);
            rays.push(Ray { origin, direction: frame(point.normal) * cosine_hemisphere([s, t]) });
            powers.push(source.power / (f64::from(RAYS) * table.pdf(k)));
        }
        let (mut hits, mut tints) = (vec![None; rays.len()], Vec::new());
        lit.ground.tracer.closest_tinted(&rays, &mut hits, &mut tints);
        let lost = |k: &usize| hits[*k].as_ref().is_none_or(|hit| lit.reflecting(hit).is_none());
        let power = |k: usize| powers[k] * tints.get(k).map_or(DVec3::ONE, |tint| tint.as_dvec3());
        (0..rays.len()).filter(lost).map(power).sum()
    };
    let parts: Vec<DVec3> = (0..RAYS.div_ceil(BATCH)).into_par_iter().map(|part| batch(part * BATCH)).collect();
    parts.into_iter().sum()
}

/// All that emits, patch by patch.
fn sources(lit: &Lit, backs: &Backs) -> Vec<Emitting> {
    let Lit { ground, exposure, emission, .. } = *lit;
    let mut sources = Vec::new();
    for i in (0..ground.patches.len()).filter(|&i| ground.casts(i)) {
        let emittance = PI * emission.0[i].as_dvec3();
        let mut add = |back: bool, area: f32| {
            if area > 0.0 && emittance != DVec3::ZERO {
                sources.push(Emitting { patch: i, back, power: f64::from(area) * emittance });
            }
        };
        add(false, exposure.area[i]);
        if backs.of_patch[i] != NONE {
            add(true, exposure.back_area(ground.patches, i));
        }
    }
    sources
}

/// The point of a source at `u` of the unit square, its normal to the side that emits.
fn place(lit: &Lit, cutter: &mut Cutter, source: &Emitting, u: [f32; 2]) -> Option<SurfacePoint> {
    let mut footprint = cutter.footprint(source.patch);
    if !source.back {
        footprint.restrict(lit.exposure.cells[source.patch]);
    }
    if footprint.is_empty() {
        return None;
    }
    let point = footprint.sample(u);
    Some(if source.back { SurfacePoint { normal: -point.normal, ..point } } else { point })
}
