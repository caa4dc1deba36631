//! Paths from a point on a surface, one vertex after the other (Kajiya 1986, "The Rendering Equation", section 4).
//!
//! `E(x) = integral over the hemisphere of L cos`, and between diffuse surfaces `L = L_e + rho E / pi`. With cosine-distributed
//! directions the estimate of E is pi L along one ray: E = pi L_e + rho E(next vertex), where light sampling takes over its
//! share of L_e at each vertex. So a path's weight is the product of the albedos so far.
//!
//! Cost a vertex: one ray, and a shadow ray for each kind of light that there is.

use super::PathParams;
use super::light::{Emitters, LightDraw};
use crate::color::Rgb;
use crate::light::Lit;
use crate::moments::Moments;
use crate::patch::SurfacePoint;
use crate::patch::footprint::Facet;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::PI;

/// Reflections after which Russian roulette may end a path: before, most of the light is still to come.
const ROULETTE_START: u32 = 3;

/// Sets of four dimensions that a vertex draws from, and the vertices that one sequence has dimensions for; those after them
/// draw from a sequence of their own, since dimensions used twice would correlate the bounces of long paths.
const SETS: u32 = 3;
const VERTICES_A_SEQUENCE: u32 = 21;

/// Traces paths through a scene.
pub struct PathTracer<'a> {
    lit: Lit<'a>,
    emitters: Emitters<'a>,
    params: &'a PathParams,
}

/// The random numbers of a bunch of paths: stage, and the receiver's number, below 2^40.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    pub stage: Stage,
    pub receiver: u64,
}

/// What a bunch of paths found, as means over them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Found {
    /// Irradiance about the shading normals of the first points [lx].
    pub irradiance: DVec3,
    /// The part of it that comes straight from lights and the sky.
    pub direct: DVec3,
    /// The part of that which comes from the sky and from lights that are no surface.
    pub inflow: DVec3,
    /// Where it comes from, if asked for.
    pub moments: Option<Moments>,
    /// Share of the first rays that landed on something that can send light back.
    pub landed_share: f64,
    /// Rays and shadow rays.
    pub rays: u64,
}

/// A path under way.
struct Path {
    /// Its number, for random numbers.
    index: u32,
    /// The vertex it has come to.
    point: SurfacePoint,
    /// Product of the albedos and tints so far, and of what Russian roulette divided by.
    weight: Rgb,
    /// The direction in which it set out, over its cosine to the shading normal, and the inverse of that cosine.
    first: (Vec3, f32),
}

impl<'a> PathTracer<'a> {
    /// Prepares the lights.
    pub fn new(lit: Lit<'a>, params: &'a PathParams) -> Self {
        Self { lit, emitters: Emitters::new(lit.ground, lit.lights, params.strategy), params }
    }

    /// Paths `0..count`, at least one, from `start`, which takes a path's number and a place in the unit square.
    pub fn trace(&self, key: Key, count: u32, start: impl Fn(u32, [f32; 2]) -> SurfacePoint) -> Found {
        let mut found = Found { moments: self.lit.params.moments.then(Moments::default), ..Found::default() };
        let first = self.sequence(key, 0);
        let mut paths: Vec<Path> = (0..count)
            .map(|index| {
                let [x, y, ..] = first.point(index, 0);
                Path { index, point: start(index, [x, y]), weight: Rgb::ONE, first: (Vec3::ZERO, 0.0) }
            })
            .collect();
        let mut bounce = 0;
        while !paths.is_empty() {
            paths = self.extend(paths, bounce, &self.sequence(key, bounce), &mut found);
            bounce += 1;
        }
        let n = f64::from(count);
        Found {
            irradiance: found.irradiance / n,
            direct: found.direct / n,
            inflow: found.inflow / n,
            moments: found.moments.map(|m| m * n.recip() as f32),
            landed_share: found.landed_share / n,
            rays: found.rays,
        }
    }

    /// The sequence that vertex number `bounce` draws from.
    fn sequence(&self, key: Key, bounce: u32) -> Sequence {
        let block = u64::from(bounce / VERTICES_A_SEQUENCE);
        Sequence::new(self.params.seed, key.stage, key.receiver + (block << 40))
    }

    /// Collects the light at the vertices that `paths` have come to, and takes those that go on to their next ones.
    fn extend(&self, paths: Vec<Path>, bounce: u32, sequence: &Sequence, found: &mut Found) -> Vec<Path> {
        let set = SETS * (bounce % VERTICES_A_SEQUENCE);
        let mut setting_out = Vec::with_capacity(paths.len());
        let mut rays = Vec::with_capacity(paths.len());
        for mut path in paths {
            let [a, b, c, d] = sequence.point(path.index, set + 1);
            let [e, f, g, h] = sequence.point(path.index, set + 2);
            let draw = LightDraw { polygon: [a, b], delta: h, disc: [c, d], sky: [e, f, g] };
            let lit = self.emitters.sample(&path.point, &draw, bounce == 0 && self.lit.params.moments);
            found.rays += lit.rays;
            found.add(bounce, path.weight * lit.irradiance, path.weight * lit.other);
            match lit.moments {
                Some(moments) => found.add_moments(&moments),
                None => found.add_along(&path, path.weight * lit.irradiance),
            }
            let [_, _, s, t] = sequence.point(path.index, set);
            let direction = frame(path.point.shading) * cosine_hemisphere([s, t]);
            // Below the triangle's own horizon there is nothing to see.
            if direction.dot(path.point.normal) > 0.0 {
                let origin = self.lit.ground.tracer.off_surface(path.point.position, path.point.normal);
                if bounce == 0 {
                    let inverse = path.point.shading.dot(direction).max(Moments::LEAST_COS).recip();
                    path.first = (direction * inverse, inverse);
                }
                rays.push(Ray { origin, direction });
                setting_out.push(path);
            }
        }
        let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
        let mut tints = Vec::new();
        self.lit.ground.tracer.closest_tinted(&rays, &mut hits, &mut tints);
        found.rays += rays.len() as u64;
        let mut going_on = Vec::new();
        for (k, ((mut path, ray), hit)) in setting_out.into_iter().zip(&rays).zip(&hits).enumerate() {
            path.weight *= tints.get(k).copied().unwrap_or(Rgb::ONE);
            let Some(hit) = hit else {
                let sky = path.weight * self.emitters.escaped(&path.point, ray.direction) * PI;
                found.add(bounce, sky, sky);
                found.add_along(&path, sky);
                continue;
            };
            let point = self.point_at(hit);
            let emitted = self.emitters.emitted(&path.point, ray.direction, hit, point.position);
            found.add(bounce, path.weight * emitted * PI, Rgb::ZERO);
            found.add_along(&path, path.weight * emitted * PI);
            let Some(albedo) = self.albedo_under(hit) else { continue };
            found.landed_share += if bounce == 0 { 1.0 } else { 0.0 };
            if self.params.max_bounces.is_some_and(|most| bounce >= most) {
                continue;
            }
            // The dimensions that the first vertex takes its place from.
            let [u, ..] = sequence.point(path.index, set);
            if let Some(weight) = roulette(path.weight * albedo, bounce, u) {
                going_on.push(Path { point, weight, ..path });
            }
        }
        going_on
    }

    /// The place of a hit, on the side that was hit; transport is about the triangle's own normal.
    fn point_at(&self, hit: &Hit) -> SurfacePoint {
        let (surface, triangle) = self.lit.ground.tracer.place(hit.triangle);
        let point = Facet::new(self.lit.ground.scene, surface, triangle).point(Vec2::from(hit.barycentric));
        let normal = if hit.back { -point.normal } else { point.normal };
        SurfacePoint { normal, ..point }.flat()
    }

    /// The albedo of the texel under a hit; `None` where nothing is sent back: on black backs and buried texels.
    fn albedo_under(&self, hit: &Hit) -> Option<Rgb> {
        Some(self.lit.reflectance.0[self.lit.reflecting(hit)?])
    }
}

impl Found {
    /// Adds light that came to a path's vertex number `bounce`; `other` of it from the sky and from lights that are no surface.
    fn add(&mut self, bounce: u32, irradiance: Vec3, other: Vec3) {
        self.irradiance += irradiance.as_dvec3();
        if bounce == 0 {
            self.direct += irradiance.as_dvec3();
            self.inflow += other.as_dvec3();
        }
    }
}

impl Found {
    fn add_moments(&mut self, moments: &Moments) {
        if let Some(sum) = &mut self.moments {
            *sum += *moments;
        }
    }

    /// Adds what came along a path's first direction to where light comes from.
    fn add_along(&mut self, path: &Path, irradiance: Rgb) {
        if let Some(sum) = &mut self.moments {
            let (direction, inverse) = path.first;
            sum.scalar += irradiance * inverse;
            sum.vector.iter_mut().zip(direction.to_array()).for_each(|(sum, d)| *sum += irradiance * d);
        }
    }
}

/// Russian roulette by the weight that a path has left: what survives is worth what was given up. `None` for paths that end.
fn roulette(weight: Rgb, bounce: u32, u: f32) -> Option<Rgb> {
    let most = weight.max_element();
    if bounce < ROULETTE_START {
        return (most > 0.0).then_some(weight);
    }
    (u < most).then(|| weight / most)
}
