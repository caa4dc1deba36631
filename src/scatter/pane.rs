//! What a window pane stops of the light that meets it.
//!
//! Rays pass panes by chance (`trace/sheet`): of each channel the share t of [`crate::scene::Material::transmission`],
//! whatever the angle. A ray that ends at a pane has met the rest, S = 1 - t: both faces mirror F' = 2 F / (1 + F) of
//! the light, and no more than S; a diffuse part sends back some of what is left, `a (S - F'(o)) (S - F'(i)) / (pi
//! mean(S - F'))`. Both are reciprocal, and never more than S.

use super::fresnel;
use super::layered::both_faces;
use super::{Scattered, Transport};
use crate::color::Rgb;
use crate::sample::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// A pane at a point.
#[derive(Clone, Copy, Debug)]
pub struct Pane {
    /// What it stops, by channel.
    stops: Rgb,
    ior: f32,
    /// Albedo of what is stopped and not mirrored.
    albedo: Rgb,
    /// Mean of what isn't mirrored, over the hemisphere.
    mean_rest: Rgb,
}

/// Steps of the mean over the hemisphere.
const STEPS: usize = 16;

impl Pane {
    /// A pane that lets `passes` through and, of the light that meets it, sends back `diffuse` diffusely.
    pub fn new(passes: Rgb, ior: f32, diffuse: Rgb) -> Self {
        let stops = (Rgb::ONE - passes).clamp(Rgb::ZERO, Rgb::ONE);
        let albedo =
            (diffuse / stops.max(Rgb::splat(1e-4))).clamp(Rgb::ZERO, Rgb::splat(crate::scene::look::MOST_ALBEDO));
        let mut pane = Self { stops, ior, albedo, mean_rest: Rgb::ONE };
        if albedo != Rgb::ZERO {
            let steps = (0..STEPS).map(|k| {
                // Denser towards grazing angles: the squared cosine is the square of what is spaced evenly.
                let s = (k as f32 + 0.5) / STEPS as f32;
                pane.rest(s) * 2.0 * s
            });
            pane.mean_rest = steps.sum::<Rgb>() / STEPS as f32;
        }
        pane
    }

    fn mirror(&self, cos: f32) -> Rgb {
        Rgb::splat(both_faces(fresnel::dielectric(cos, self.ior))).min(self.stops)
    }

    fn rest(&self, cos: f32) -> Rgb {
        self.stops - self.mirror(cos)
    }

    pub fn diffuse_albedo(&self, cos: f32) -> Rgb {
        self.albedo * self.rest(cos)
    }

    pub fn whole_albedo(&self, cos: f32) -> Rgb {
        self.mirror(cos) + self.diffuse_albedo(cos)
    }

    pub fn is_delta(&self) -> bool {
        self.albedo == Rgb::ZERO
    }

    /// The BRDF [1/sr] without the mirror, both directions above.
    pub fn evaluate(&self, o: Vec3, i: Vec3) -> Rgb {
        self.albedo * self.rest(o.z) * self.rest(i.z) * FRAC_1_PI / self.mean_rest.max(Rgb::splat(1e-6))
    }

    /// Chance of the mirror; `None` where nothing is sent back.
    fn mirror_chance(&self, o: Vec3) -> Option<f32> {
        let (mirror, diffuse) = (self.mirror(o.z).element_sum(), self.diffuse_albedo(o.z).element_sum());
        (mirror + diffuse > 0.0).then(|| mirror / (mirror + diffuse))
    }

    pub fn pdf(&self, o: Vec3, i: Vec3) -> f32 {
        self.mirror_chance(o).map_or(0.0, |chance| (1.0 - chance) * cosine_hemisphere_pdf(i.z))
    }

    /// The mirror, with the whole of its share.
    pub fn single(&self, o: Vec3) -> Scattered {
        Scattered::single(Vec3::new(-o.x, -o.y, o.z), self.mirror(o.z), 1.0)
    }

    pub fn sample(&self, o: Vec3, u: [f32; 3], _: Transport) -> Option<Scattered> {
        let chance = self.mirror_chance(o)?;
        if u[2] < chance {
            return Some(Scattered::single(Vec3::new(-o.x, -o.y, o.z), self.mirror(o.z), chance));
        }
        let direction = cosine_hemisphere([u[0], u[1]]);
        let pdf = self.pdf(o, direction);
        if direction.z <= 0.0 || pdf <= 0.0 {
            return None;
        }
        let weight = self.evaluate(o, direction) * (direction.z / pdf);
        Some(Scattered { direction, weight, pdf, delta: false, transmitted: false })
    }
}
