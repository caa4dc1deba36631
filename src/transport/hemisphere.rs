//! Hemisphere sampling: cosine-distributed rays from an element; the share of them that lands on another estimates the form
//! factor to it (Malley). One set of rays serves all receivers, and tells what escapes and what the sky sends.

use super::{Effort, Elements, FormFactor};
use crate::color::Rgb;
use crate::light::Lit;
use crate::patch::{Ground, SurfacePoint};
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray};
use std::f32::consts::PI;

/// What an element's rays found.
#[derive(Clone, Debug, Default)]
pub struct Probe {
    /// Elements that were hit, ascending, with the share of the rays that hit them.
    pub landed: Vec<(u32, f32)>,
    /// Share of the rays that landed on elements; the rest escaped or fell on black backs.
    pub landed_share: f32,
    /// Irradiance of the sky [lx], without the part that brightness samples carry.
    pub sky: Rgb,
}

/// Probes element `i` with `count` rays.
pub fn probe(elements: &Elements, lit: &Lit, count: u32, i: usize) -> Probe {
    let Lit { ground, lights, .. } = *lit;
    let (_, rays, hits, tints) = shoot(elements, ground, i, 0, count);
    let mut landed: Vec<u32> = Vec::with_capacity(rays.len());
    let mut sky = Rgb::ZERO;
    for (k, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
        match hit {
            Some(hit) => landed.extend(elements.element_under(ground, hit)),
            None => {
                if let Some(s) = &lights.sky {
                    let tint = tints.get(k).copied().unwrap_or(Rgb::ONE);
                    sky += s.smooth(ground.scene, ray.direction) * tint;
                }
            }
        }
    }
    landed.sort_unstable();
    let n = count as f32;
    Probe {
        landed_share: landed.len() as f32 / n,
        landed: landed.chunk_by(|a, b| a == b).map(|g| (g[0], g.len() as f32 / n)).collect(),
        sky: sky * (PI / n),
    }
}

/// Cosine-distributed rays `first..end` of element `i`, what they hit, and the tints of what they see, if there are any.
fn shoot(
    elements: &Elements,
    ground: &Ground,
    i: usize,
    first: u32,
    end: u32,
) -> (Vec<SurfacePoint>, Vec<Ray>, Vec<Option<Hit>>, Vec<Rgb>) {
    let sequence = Sequence::new(elements.seed, Stage::Probe, i as u64);
    let points: Vec<SurfacePoint> = (first..end).map(|index| elements.point(ground, i, index)).collect();
    let rays: Vec<Ray> = (first..end)
        .zip(&points)
        .map(|(index, point)| {
            let [x, y, ..] = sequence.point(index, 0);
            Ray { origin: point.position, direction: frame(point.normal) * cosine_hemisphere([x, y]) }
        })
        .collect();
    let mut hits = vec![None; rays.len()];
    let mut tints = Vec::new();
    ground.tracer.closest_tinted(&rays, &mut hits, &mut tints);
    (points, rays, hits, tints)
}

/// The form factor from element `i` to `j` by the share of rays that land on it, doubled until the standard error of the
/// count is small enough.
pub fn form_factor(elements: &Elements, ground: &Ground, i: usize, j: usize, effort: &Effort) -> FormFactor {
    let (mut taken, mut end, mut landed) = (0u32, 64.min(effort.most_samples), 0u32);
    loop {
        let (_, _, hits, _) = shoot(elements, ground, i, taken, end);
        let on_target = |hit: &&Hit| elements.element_under(ground, hit) == Some(j as u32);
        landed += hits.iter().flatten().filter(on_target).count() as u32;
        taken = end;
        let n = f64::from(taken);
        let value = f64::from(landed) / n;
        let error = (value * (1.0 - value) / n).sqrt();
        if taken >= effort.most_samples || (landed > 0 && error <= effort.tolerance(value)) {
            return FormFactor { value, error, samples: taken };
        }
        end = taken * 2;
    }
}
