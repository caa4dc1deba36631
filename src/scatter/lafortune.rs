//! Measured reflection as a sum of cosine lobes (Lafortune et al. 1997); [`Lobes`] has the formula.

use super::{Scattered, Transport};
use crate::color::Rgb;
use crate::sample::warp::{cosine_hemisphere, cosine_hemisphere_pdf, frame};
use crate::scene::{Lobe, Lobes};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Lobes ready to be sampled.
#[derive(Clone, Debug)]
pub struct Measured {
    diffuse: Rgb,
    lobes: Vec<Lobe>,
    /// Factor that keeps the albedo at most 1 from every direction.
    scale: f32,
    /// Albedo of the lobes without the diffuse part, by cosine, at [`STEPS`] + 1 places: the largest over azimuths,
    /// each channel apart.
    albedo: Vec<Rgb>,
}

/// Steps of the tables by cosine.
const STEPS: usize = 32;
/// Azimuths that are looked at, of a quarter turn: lobes look alike from all four.
const AZIMUTHS: usize = 5;

impl Measured {
    /// Prepares lobes without a fault.
    pub fn new(lobes: &Lobes) -> Self {
        let mut made =
            Self { diffuse: lobes.diffuse, lobes: lobes.lobes.clone(), scale: 1.0, albedo: vec![Rgb::ZERO; STEPS + 1] };
        let is_round = lobes.lobes.iter().all(|lobe| lobe.x == lobe.y);
        let azimuths = if is_round { 1 } else { AZIMUTHS };
        for step in 0..=STEPS {
            let cos = (step as f32 / STEPS as f32).max(1e-3);
            let sin = (1.0 - cos * cos).sqrt();
            for k in 0..azimuths {
                let (s, c) = (FRAC_PI_2 * k as f32 / (AZIMUTHS - 1) as f32).sin_cos();
                let share = made.integrate(Vec3::new(sin * c, sin * s, cos));
                made.albedo[step] = made.albedo[step].max(share);
            }
        }
        let most = made.albedo.iter().fold(0.0f32, |most, a| most.max((*a + made.diffuse).max_element()));
        if most > 1.0 {
            // A little less, since directions between those that were looked at may send back more.
            made.scale = 0.995 / most;
            made.albedo.iter_mut().for_each(|a| *a *= made.scale);
        }
        made
    }

    /// The share of light from `o` that the lobes send up: a grid around the direction of each, which peaks there.
    fn integrate(&self, o: Vec3) -> Rgb {
        const POLARS: usize = 64;
        const ROUND: usize = 32;
        let mut sum = Rgb::ZERO;
        for lobe in &self.lobes {
            for channel in 0..3 {
                let (axis, n) = (turned(lobe, o, channel), lobe.exponent[channel]);
                let Some(direction) = axis.try_normalize() else {
                    // Flat, where it is 0 to the power of 0.
                    sum[channel] += if n == 0.0 { std::f32::consts::PI } else { 0.0 };
                    continue;
                };
                let about = frame(direction);
                // cos^(n + 1) is spread evenly over directions that follow the lobe.
                let height = axis.length().powf(n) * TAU / (n + 1.0);
                let mut share = 0.0;
                for p in 0..POLARS {
                    let z = ((p as f32 + 0.5) / POLARS as f32).powf(1.0 / (n + 1.0));
                    for a in 0..ROUND {
                        let (s, c) = (TAU * (a as f32 + 0.5) / ROUND as f32).sin_cos();
                        let r = (1.0 - z * z).max(0.0).sqrt();
                        share += (about * Vec3::new(r * c, r * s, z)).z.max(0.0);
                    }
                }
                sum[channel] += height * share / (POLARS * ROUND) as f32;
            }
        }
        sum
    }

    fn specular_albedo(&self, cos: f32) -> Rgb {
        let x = cos.clamp(0.0, 1.0) * STEPS as f32;
        let k = (x as usize).min(STEPS - 1);
        self.albedo[k].lerp(self.albedo[k + 1], x - k as f32)
    }

    /// Share of the light that the diffuse part sends back.
    pub fn diffuse_albedo(&self) -> Rgb {
        self.diffuse * self.scale
    }

    /// Share that is sent back in all, at most.
    pub fn whole_albedo(&self, cos: f32) -> Rgb {
        self.diffuse_albedo() + self.specular_albedo(cos)
    }

    /// The BRDF [1/sr], both directions above.
    pub fn evaluate(&self, o: Vec3, i: Vec3) -> Rgb {
        let product = o * i;
        let lobes: Rgb = self.lobes.iter().map(|lobe| value(lobe, product)).sum();
        (self.diffuse * FRAC_1_PI + lobes) * self.scale
    }

    /// Chance of the diffuse part; lobes share the rest.
    fn diffuse_chance(&self, o: Vec3) -> f32 {
        if self.lobes.is_empty() {
            return 1.0;
        }
        let (diffuse, specular) = (self.diffuse_albedo().element_sum(), self.specular_albedo(o.z).element_sum());
        // Never without either: lobes are seen by their largest azimuth alone.
        (diffuse / (diffuse + specular).max(f32::MIN_POSITIVE)).clamp(0.05, 0.95)
    }

    /// Density [1/sr] of [`sample`](Self::sample).
    pub fn pdf(&self, o: Vec3, i: Vec3) -> f32 {
        let chance = self.diffuse_chance(o);
        let lobes: f32 = self.axes(o).map(|(axis, n)| cosine_power_pdf(axis, n, i)).sum();
        chance * cosine_hemisphere_pdf(i.z) + (1.0 - chance) * lobes / (3 * self.lobes.len()).max(1) as f32
    }

    /// The directions and exponents of all lobes and channels, as seen from `o`.
    fn axes(&self, o: Vec3) -> impl Iterator<Item = (Vec3, f32)> + '_ {
        let of = move |lobe: &Lobe, k: usize| (turned(lobe, o, k).normalize_or(Vec3::Z), lobe.exponent[k]);
        self.lobes.iter().flat_map(move |lobe| (0..3).map(move |k| of(lobe, k)))
    }

    /// A direction, with what it is worth.
    pub fn sample(&self, o: Vec3, u: [f32; 3], _: Transport) -> Option<Scattered> {
        let chance = self.diffuse_chance(o);
        let direction = if u[2] < chance {
            cosine_hemisphere([u[0], u[1]])
        } else {
            let count = 3 * self.lobes.len();
            let k = ((u[2] - chance) / (1.0 - chance) * count as f32) as usize;
            let (axis, n) = self.axes(o).nth(k.min(count - 1))?;
            frame(axis) * cosine_power([u[0], u[1]], n)
        };
        let pdf = self.pdf(o, direction);
        if direction.z <= 0.0 || pdf.is_nan() || pdf <= 0.0 {
            return None;
        }
        let weight = self.evaluate(o, direction) * (direction.z / pdf);
        weight.is_finite().then_some(Scattered { direction, weight, pdf, delta: false, transmitted: false })
    }
}

/// A lobe's value by channel, of the product of both directions.
fn value(lobe: &Lobe, product: Vec3) -> Rgb {
    let base = (lobe.x * product.x + lobe.y * product.y + lobe.z * product.z).max(Rgb::ZERO);
    Rgb::new(base.x.powf(lobe.exponent.x), base.y.powf(lobe.exponent.y), base.z.powf(lobe.exponent.z))
}

/// Where a channel of a lobe points as seen from `o`, not of unit length.
fn turned(lobe: &Lobe, o: Vec3, channel: usize) -> Vec3 {
    Vec3::new(lobe.x[channel] * o.x, lobe.y[channel] * o.y, lobe.z[channel] * o.z)
}

/// A direction around +Z, in proportion to its cosine to the power of `n`.
fn cosine_power(u: [f32; 2], n: f32) -> Vec3 {
    let z = (1.0 - u[0]).powf(1.0 / (n + 1.0));
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * u[1]).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

fn cosine_power_pdf(axis: Vec3, n: f32, i: Vec3) -> f32 {
    let cos = axis.dot(i);
    if cos <= 0.0 { 0.0 } else { (n + 1.0) / TAU * cos.powf(n) }
}
