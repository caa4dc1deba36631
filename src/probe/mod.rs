//! Light probes: the light that passes through points of space, for objects that move and have no lightmap.
//!
//! A probe holds radiance over the sphere as spherical harmonics to order 2 ([`harmonics`]). Light straight from lights is found with
//! shadow rays ([`lights`]), what surfaces send by rays over the sphere that read the finished light of the texels that they meet: what
//! a page shows, times the albedo. Rays come in sets of 24, a direction in all orders and signs of its coordinates: such a set adds up to
//! nothing in every harmonic of orders 1 to 3, so that even light is told exactly.
//!
//! A probe from which many rays meet black backs stands inside of something: it is marked, and an engine takes its neighbours
//! in its place. Inside of walls whose backs reflect nothing can be told.
//!
//! Cost: `rays` rays, and at most 32 shadow rays for each light or cluster of lights, a probe. Limits: backs that no surface sees are
//! dark; what doesn't cast isn't seen.

pub mod harmonics;
pub mod lights;
pub mod place;

pub use harmonics::Harmonics;
pub use place::{Grid, Placement};

use crate::Result;
use crate::color::Rgb;
use crate::gather::Backs;
use crate::light::Lit;
use crate::light::polygon::Source;
use crate::patch::NONE;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::{Hit, Ray};
use glam::Vec3;
use lights::Viewer;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI};

/// Rays that a set has.
pub const SET: u32 = 24;

/// The share of rays that may meet black backs before a probe counts as being inside of something: that of DDGI (Majercik and others
/// 2019, "Dynamic Diffuse Global Illumination with Ray-Traced Irradiance Fields"; RTXGI's default).
pub const MOST_BACKS: f32 = 0.25;

/// Which probes, and how well.
#[derive(Clone, Debug, Default)]
pub struct ProbeParams {
    pub sets: Vec<Placement>,
    /// Rays of each, at least [`SET`]; rounded up to whole sets.
    pub rays: u32,
    pub seed: u32,
}

/// All probes of a bake.
#[derive(Clone, Debug, Default)]
pub struct LightProbes {
    /// The sets that they belong to, one after the other.
    pub sets: Vec<Placement>,
    pub list: Vec<Probe>,
    /// Rays and shadow rays.
    pub rays: u64,
}

/// The light at one point.
#[derive(Clone, Copy, Debug, Default)]
pub struct Probe {
    /// [m].
    pub position: Vec3,
    /// Radiance [nit].
    pub radiance: Harmonics,
    /// The share of rays that met the backs of single-sided surfaces, 0..=1.
    pub back_share: f32,
    /// Mean distance to what rays met [m], and mean of its square [m^2]: what a visibility test needs (Chebyshev's inequality, as DDGI
    /// has it, here over all directions). Rays that met nothing are left out; 0 where all are.
    pub distance: [f32; 2],
}

impl Probe {
    /// True where it doesn't stand inside of something ([`MOST_BACKS`]).
    pub fn is_valid(&self) -> bool {
        self.back_share <= MOST_BACKS
    }
}

/// The finished light of a scene, as probes see it.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    pub lit: &'a Lit<'a>,
    /// Irradiance of every patch [lx].
    pub irradiance: &'a [Rgb],
    pub backs: &'a Backs,
}

/// Finds the light at all probes.
///
/// # Errors
/// `Cancelled`.
pub fn probes(around: &Surroundings, params: &ProbeParams, progress: &dyn Progress) -> Result<LightProbes> {
    let positions: Vec<Vec3> = params.sets.iter().flat_map(Placement::positions).collect();
    progress.begin("probes", positions.len() as u64);
    let polygon_of = around.polygon_of();
    let one = |(number, position): (usize, &Vec3)| {
        progress.check()?;
        progress.advance(1);
        Ok(around.probe(&polygon_of, *position, number as u64, params))
    };
    let found: Vec<(Probe, u64)> = positions.par_iter().enumerate().with_max_len(4).map(one).collect::<Result<_>>()?;
    let rays = found.iter().map(|f| f.1).sum();
    Ok(LightProbes { sets: params.sets.clone(), list: found.into_iter().map(|f| f.0).collect(), rays })
}

/// The direction at `u` of the unit square in all orders that keep their turn, and all signs, of its coordinates.
fn set_of([a, b]: [f32; 2]) -> impl Iterator<Item = Vec3> {
    let (sin, cos) = (FRAC_PI_2 * b).sin_cos();
    let r = (1.0 - a * a).max(0.0).sqrt();
    let first = Vec3::new(r * cos, r * sin, a);
    let sign = |k: u32, bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
    [first, Vec3::new(first.y, first.z, first.x), Vec3::new(first.z, first.x, first.y)]
        .into_iter()
        .flat_map(move |d| (0..8).map(move |k| d * Vec3::new(sign(k, 0), sign(k, 1), sign(k, 2))))
}

impl Surroundings<'_> {
    /// The polygon that each triangle is; [`NONE`] where it doesn't shine.
    fn polygon_of(&self) -> Vec<u32> {
        let tracer = self.lit.ground.tracer;
        let mut polygon_of = vec![NONE; tracer.triangle_count()];
        for (p, polygon) in self.lit.lights.polygons.polygons.iter().enumerate() {
            if let Source::Surface { surface, triangle, .. } = polygon.source {
                polygon_of[tracer.number(surface, triangle) as usize] = p as u32;
            }
        }
        polygon_of
    }

    /// The probe number `number` at `position`, and the rays that it took.
    fn probe(&self, polygon_of: &[u32], position: Vec3, number: u64, params: &ProbeParams) -> (Probe, u64) {
        let Lit { ground, lights, .. } = *self.lit;
        let sequence = Sequence::new(params.seed, Stage::LightProbe, number);
        let count = params.rays.div_ceil(SET).max(1);
        let viewer = Viewer { lit: self.lit, position, sequence, rays: count * SET };
        let straight = viewer.look();
        let mut probe = Probe { position, radiance: straight.light, ..Probe::default() };
        let start = |index| {
            let [a, b, ..] = sequence.point(index, 0);
            set_of([a, b])
        };
        let rays: Vec<Ray> = (0..count).flat_map(start).map(|direction| Ray { origin: position, direction }).collect();
        let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
        let mut tints = Vec::new();
        ground.tracer.closest_tinted(&rays, &mut hits, &mut tints);
        let solid_angle = 4.0 * PI / rays.len() as f32;
        let (mut backs, mut met, mut distance) = (0u32, 0u32, [0.0f64; 2]);
        for (k, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
            let tint = tints.get(k).copied().unwrap_or(Rgb::ONE);
            let Some(hit) = hit else {
                if let Some(sky) = &lights.sky {
                    let share = viewer.escaped_share(sky, ray.direction);
                    let light = sky.radiance(ground.scene, ray.direction) * tint * (share * solid_angle);
                    probe.radiance.receive(light, ray.direction);
                }
                continue;
            };
            met += 1;
            let t = f64::from(hit.t);
            distance = [distance[0] + t, distance[1] + t * t];
            let is_wide = straight.wide.binary_search(&polygon_of[hit.triangle as usize]).is_ok();
            match self.sent(hit, is_wide) {
                Some(radiance) => probe.radiance.receive(radiance * tint * solid_angle, ray.direction),
                None => backs += 1,
            }
        }
        probe.back_share = backs as f32 / rays.len() as f32;
        probe.distance = distance.map(|sum| (sum / f64::from(met.max(1))) as f32);
        (probe, straight.rays + rays.len() as u64)
    }

    /// Radiance that is sent out where `hit` is [nit], what it emits only with `emission`; `None` on black backs.
    fn sent(&self, hit: &Hit, emission: bool) -> Option<Rgb> {
        let Lit { ground, reflectance, .. } = *self.lit;
        let (surface, triangle) = ground.tracer.place(hit.triangle);
        let is_double_sided = ground.scene.material(surface, triangle).double_sided;
        if hit.back && !is_double_sided {
            return None;
        }
        let Some(patch) = ground.patch_under(hit) else { return Some(Rgb::ZERO) };
        let irradiance = match self.backs.of_patch.get(patch) {
            _ if !hit.back => self.irradiance[patch],
            None | Some(&NONE) => Rgb::ZERO,
            Some(&group) => self.backs.irradiance[group as usize],
        };
        let emitted = if emission { self.lit.emission.0[patch] } else { Rgb::ZERO };
        Some(reflectance.0[patch] * irradiance * FRAC_1_PI + emitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_of_rays_adds_up_to_nothing_but_its_mean() {
        let mut sum = Harmonics::default();
        let directions: Vec<Vec3> = set_of([0.3, 0.8]).collect();
        assert_eq!(directions.len() as u32, SET);
        directions.iter().for_each(|d| sum.receive(Rgb::ONE, *d));
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        assert!((sum.0[0].x - 24.0 * 0.282_094_8).abs() < 1e-4);
        assert!(sum.0[1..].iter().all(|c| c.abs().max_element() < 1e-4), "{sum:?}");
    }
}
