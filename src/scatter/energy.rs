//! How much of the light that meets rough microfacets leaves after one bounce: tables by cosine and roughness, from which what is
//! lost is given back (Kulla, Conty 2017, "Revisiting Physically Based Shading at Imageworks").
//!
//! Single scattering loses what a facet sends to another: up to 60 % at roughness 1. With E the share that leaves, the lobe
//! `(1 - E(o)) (1 - E(i)) / (pi (1 - mean E))` is reciprocal and adds up to what is missing; so is a diffuse one below a coat that
//! reflects E. Means are over the hemisphere, weighed by the cosine. All tables are found by quadrature over visible normals.

use super::fresnel::{self, Rise};
use super::ggx::{Ggx, mirrored, refracted};
use glam::Vec3;
use rayon::prelude::*;

/// Cosines and roughnesses of a table.
const COSINES: usize = 48;
const ROUGHNESSES: usize = 33;
/// Means are kept at four times as many roughnesses.
const MEANS: usize = 4 * (ROUGHNESSES - 1) + 1;
/// Steps of the quadrature over visible normals: azimuths of a half, and polar ones.
const AZIMUTHS: usize = 12;
const POLARS: usize = 32;

/// Width of the GGX distribution at a perceptual roughness.
pub fn alpha(roughness: f32) -> f32 {
    (roughness * roughness).max(1e-6)
}

/// A share of light by cosine, 0..=1, and perceptual roughness, 0..=1.
#[derive(Clone, Debug)]
pub struct Table {
    /// Row by row of one roughness.
    values: Vec<f32>,
    means: Vec<f32>,
}

impl Table {
    /// The table of `share`, a function of the direction of sight and the distribution.
    fn new(share: impl Fn(Vec3, Ggx) -> f32 + Sync) -> Self {
        let values: Vec<f32> = (0..ROUGHNESSES * COSINES)
            .into_par_iter()
            .map(|k| {
                let alpha = alpha((k / COSINES) as f32 / (ROUGHNESSES - 1) as f32);
                let x = (k % COSINES) as f32 / (COSINES - 1) as f32;
                let cos = cosine_at(x, alpha).clamp(1e-5, 1.0);
                share(Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos), Ggx { alpha })
            })
            .collect();
        let mut table = Self { values, means: Vec::new() };
        let of = |k: usize| table.integrate(k as f32 / (MEANS - 1) as f32);
        table.means = (0..MEANS).into_par_iter().map(of).collect();
        table
    }

    /// The share at a cosine and a roughness, bilinear.
    pub fn at(&self, cos: f32, roughness: f32) -> f32 {
        let x = place(cos, alpha(roughness)) * (COSINES - 1) as f32;
        let column = (x as usize).min(COSINES - 2);
        let (row, down) = cell(roughness, ROUGHNESSES);
        let along = |row: usize| {
            let at = row * COSINES + column;
            let (a, b) = (self.values[at], self.values[at + 1]);
            a + (b - a) * (x - column as f32)
        };
        let (a, b) = (along(row), along(row + 1));
        a + (b - a) * down
    }

    /// Its mean at a roughness.
    pub fn mean(&self, roughness: f32) -> f32 {
        let (k, f) = cell(roughness, MEANS);
        self.means[k] + (self.means[k + 1] - self.means[k]) * f
    }

    /// The mean of what [`at`](Self::at) gives: midpoints, as dense as the table's own cosines.
    fn integrate(&self, roughness: f32) -> f32 {
        const STEPS: usize = 8 * COSINES;
        let alpha = alpha(roughness);
        let edge = |k: usize| cosine_at(k as f32 / STEPS as f32, alpha);
        let cells = (0..STEPS).map(|k| {
            let (low, high) = (edge(k), edge(k + 1));
            self.at(0.5 * (low + high), roughness) * (high * high - low * low)
        });
        cells.sum()
    }
}

fn cell(roughness: f32, count: usize) -> (usize, f32) {
    let y = roughness.clamp(0.0, 1.0) * (count - 1) as f32;
    let row = (y as usize).min(count - 2);
    (row, y - row as f32)
}

/// Place of a cosine in a table, 0..=1: half of it for cosines about as large as the slope of facets, where shadowing changes, and half
/// for angles, by which Fresnel's reflection does.
fn place(cos: f32, alpha: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    0.5 * (cos * (1.0 + alpha) / (cos + alpha) + cos.sqrt())
}

/// The cosine at a place: the inverse of [`place`], by bisection.
fn cosine_at(x: f32, alpha: f32) -> f32 {
    let (mut low, mut high) = (0.0f32, 1.0f32);
    if x >= 1.0 {
        return 1.0;
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if place(middle, alpha) < x { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The mean over normals visible from `o` of `f`.
fn over_normals(o: Vec3, ggx: Ggx, f: impl Fn(Vec3) -> f32) -> f32 {
    let mut sum = 0.0f64;
    for p in 0..POLARS {
        for a in 0..AZIMUTHS {
            let u = [0.5 * (a as f32 + 0.5) / AZIMUTHS as f32, (p as f32 + 0.5) / POLARS as f32];
            sum += f64::from(f(ggx.sample(o, u)));
        }
    }
    (sum / (AZIMUTHS * POLARS) as f64) as f32
}

/// Share that leaves upwards after one reflection at facets that reflect `fresnel` of the cosine to them.
fn reflected(o: Vec3, ggx: Ggx, fresnel: impl Fn(f32) -> f32) -> f32 {
    over_normals(o, ggx, |h| {
        let i = mirrored(o, h);
        if i.z <= 0.0 { 0.0 } else { fresnel(o.dot(h)) * ggx.shadowing(o, i) / ggx.masking(o) }
    })
}

/// Share that leaves downwards after one refraction.
fn transmitted(o: Vec3, ggx: Ggx, eta: f32) -> f32 {
    over_normals(o, ggx, |h| match refracted(o, h, eta) {
        Some(i) if i.z < 0.0 => (1.0 - fresnel::dielectric(o.dot(h), eta)) * ggx.shadowing(o, i) / ggx.masking(o),
        _ => 0.0,
    })
}

/// What facets reflect that reflect everything.
pub fn whole() -> Table {
    Table::new(|o, ggx| reflected(o, ggx, |_| 1.0))
}

/// What facets reflect that reflect as `rise` says.
pub fn rising(rise: Rise) -> Table {
    Table::new(|o, ggx| reflected(o, ggx, |cos| rise.at(cos)))
}

/// One side of a rough interface between dielectrics.
#[derive(Clone, Debug)]
pub struct Side {
    /// Shares that are reflected and that pass, after one bounce.
    pub reflected: Table,
    pub transmitted: Table,
}

impl Side {
    /// Share lost to a second bounce.
    pub fn lost(&self, cos: f32, roughness: f32) -> f32 {
        (1.0 - self.reflected.at(cos, roughness) - self.transmitted.at(cos, roughness)).max(0.0)
    }

    /// Its mean.
    pub fn mean_lost(&self, roughness: f32) -> f32 {
        (1.0 - self.reflected.mean(roughness) - self.transmitted.mean(roughness)).max(0.0)
    }
}

/// A rough interface from outside (0) and from inside (1).
#[derive(Clone, Debug)]
pub struct Interface {
    pub sides: [Side; 2],
}

impl Interface {
    /// The interface of a solid of index `ior`.
    pub fn new(ior: f32) -> Self {
        let side = |eta: f32| Side {
            reflected: Table::new(|o, ggx| reflected(o, ggx, |cos| fresnel::dielectric(cos, eta))),
            transmitted: Table::new(|o, ggx| transmitted(o, ggx, eta)),
        };
        Self { sides: [side(ior), side(1.0 / ior)] }
    }

    /// Of what each side loses, the share that passes to the other side.
    ///
    /// Reciprocity up to the square of the index asks that share times mean loss, outside, be ior^2 times the same inside. One factor is
    /// left; it makes the geometric mean of both shares that of what passes of diffuse light.
    pub fn crossing(&self, ior: f32, roughness: f32) -> [f32; 2] {
        let lost = [self.sides[0].mean_lost(roughness), ior * ior * self.sides[1].mean_lost(roughness)];
        if lost[0] <= 0.0 || lost[1] <= 0.0 {
            return [0.0; 2];
        }
        let passes = [0, 1].map(|k| self.sides[k].transmitted.mean(0.0));
        let flux = (passes[0] * passes[1] * lost[0] * lost[1]).sqrt().min(lost[0]).min(lost[1]);
        [flux / lost[0], flux / lost[1]]
    }
}
