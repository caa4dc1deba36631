//! How much of the light that meets rough microfacets leaves after one bounce: tables by cosine and roughness, from
//! which what is lost is given back (Kulla, Conty 2017, "Revisiting Physically Based Shading at Imageworks").
//!
//! Single scattering loses what a facet sends to another: up to 60 % at roughness 1. With E the share that leaves, the
//! lobe `(1 - E(o)) (1 - E(i)) / (pi (1 - mean E))` is reciprocal and adds up to what is missing; so is a diffuse one
//! below a coat that reflects E. Means are over the hemisphere, weighed by the cosine. All tables are found by
//! quadrature over visible normals.

use super::fresnel::{self, Rise};
use super::ggx::{Ggx, mirrored, refracted};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Cosines and roughnesses of a table.
const COSINES: usize = 48;
const ROUGHNESSES: usize = 33;
/// Means are kept at four times as many roughnesses.
const MEANS: usize = 4 * (ROUGHNESSES - 1) + 1;
/// Points of the quadrature over visible normals: a Fibonacci lattice, and the number before. Errors stay below 5e-4.
const POINTS: u32 = 610;
const POINTS_BEFORE: u32 = 377;

/// What tables depend on.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Mirrors(Rise),
    Rising(Rise),
    /// A side of an interface, by the index ahead.
    Side(f32),
}

/// Tables that were found before, whatever the scene: each takes some tens of milliseconds, and they are the same every time.
static KNOWN: Mutex<Vec<(Kind, Vec<Table>)>> = Mutex::new(Vec::new());

/// Kinds that are kept: about 7 KB a table.
const MOST_KNOWN: usize = 256;

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
    /// Tables of the kind `of`, of `shares`, functions of the direction of sight and the distribution; found once a process.
    fn several<const N: usize>(of: Kind, shares: impl Fn(Vec3, Ggx) -> [f32; N] + Sync) -> [Self; N] {
        // Not locked meanwhile: a thread that waits within parallel work may be given other work that needs the lock.
        let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let before =
            known().iter().find(|(kind, _)| *kind == of).and_then(|(_, tables)| tables.clone().try_into().ok());
        before.unwrap_or_else(|| {
            let tables = Self::integrated(shares);
            let mut known = known();
            if known.len() < MOST_KNOWN && known.iter().all(|(kind, _)| *kind != of) {
                known.push((of, tables.to_vec()));
            }
            tables
        })
    }

    fn integrated<const N: usize>(shares: impl Fn(Vec3, Ggx) -> [f32; N] + Sync) -> [Self; N] {
        let values: Vec<[f32; N]> = (0..ROUGHNESSES * COSINES)
            .into_par_iter()
            .map(|k| {
                let alpha = alpha((k / COSINES) as f32 / (ROUGHNESSES - 1) as f32);
                let x = (k % COSINES) as f32 / (COSINES - 1) as f32;
                let cos = cosine_at(x, alpha).clamp(1e-5, 1.0);
                shares(Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos), Ggx { alpha })
            })
            .collect();
        std::array::from_fn(|n| {
            let mut table = Self { values: values.iter().map(|v| v[n]).collect(), means: Vec::new() };
            let of = |k: usize| table.integrate(k as f32 / (MEANS - 1) as f32);
            table.means = (0..MEANS).into_par_iter().map(of).collect();
            table
        })
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

    /// The mean of what [`at`](Self::at) gives: midpoints, denser towards grazing angles.
    fn integrate(&self, roughness: f32) -> f32 {
        const STEPS: usize = 2 * COSINES;
        let cells = (0..STEPS).map(|k| {
            let square = |k: usize| (k as f32 / STEPS as f32).powi(2);
            let (low, high) = (square(k), square(k + 1));
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

/// Place of a cosine in a table, 0..=1: half of it for cosines about as large as the slope of facets, where shadowing
/// changes, and half for angles, by which Fresnel's reflection does.
fn place(cos: f32, alpha: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    0.5 * (cos * (1.0 + alpha) / (cos + alpha) + cos.sqrt())
}

/// The cosine at a place: the inverse of [`place`], by bisection.
fn cosine_at(x: f32, alpha: f32) -> f32 {
    if x >= 1.0 {
        return 1.0;
    }
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if place(middle, alpha) < x { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The means over normals visible from `o` of `f`, which hold for either half of the azimuths.
fn over_normals<const N: usize>(o: Vec3, ggx: Ggx, f: impl Fn(Vec3) -> [f32; N]) -> [f32; N] {
    let mut sums = [0.0f64; N];
    for k in 0..POINTS {
        // Denser towards normals at grazing angles, of which there are few and which change most.
        let t = 1.0 - (k as f32 + 0.5) / POINTS as f32;
        let around = 0.5 * ((k * POINTS_BEFORE) % POINTS) as f32 / POINTS as f32;
        let found = f(ggx.sample(o, [around, 1.0 - t * t]));
        sums.iter_mut().zip(found).for_each(|(sum, v)| *sum += f64::from(v * 2.0 * t));
    }
    sums.map(|sum| (sum / f64::from(POINTS)) as f32)
}

/// Shares that leave upwards after one reflection at facets that reflect `fresnel` of the cosine to them.
fn reflected<const N: usize>(o: Vec3, ggx: Ggx, fresnel: impl Fn(f32) -> [f32; N]) -> [f32; N] {
    over_normals(o, ggx, |h| {
        let seen = seen_from_above(o, mirrored(o, h), ggx);
        fresnel(o.dot(h)).map(|f| f * seen)
    })
}

/// Of the light that facets send to `i`, the share that no other facet catches: 0 where `i` is below.
fn seen_from_above(o: Vec3, i: Vec3, ggx: Ggx) -> f32 {
    if i.z > 0.0 { ggx.shadowing(o, i) / ggx.masking(o) } else { 0.0 }
}

/// What facets reflect that reflect everything, as Schlick's curve has it, and as that of `rise` does.
pub fn mirrors(rise: Rise) -> [Table; 3] {
    Table::several(Kind::Mirrors(rise), |o, ggx| reflected(o, ggx, |cos| [1.0, fresnel::schlick(cos), rise.at(cos)]))
}

/// What facets reflect that reflect as `rise` says.
pub fn rising(rise: Rise) -> Table {
    let [table] = Table::several(Kind::Rising(rise), |o, ggx| reflected(o, ggx, |cos| [rise.at(cos)]));
    table
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
        let side = |eta: f32| {
            let [reflected, transmitted] = Table::several(Kind::Side(eta), |o, ggx| {
                over_normals(o, ggx, |h| {
                    let fresnel = fresnel::dielectric(o.dot(h), eta);
                    let back = fresnel * seen_from_above(o, mirrored(o, h), ggx);
                    let on = refracted(o, h, eta).map_or(0.0, |i| seen_from_above(o, i.with_z(-i.z), ggx));
                    [back, (1.0 - fresnel) * on]
                })
            });
            Side { reflected, transmitted }
        };
        Self { sides: [side(ior), side(1.0 / ior)] }
    }

    /// Of what each side loses, the share that passes to the other side.
    ///
    /// Reciprocity up to the square of the index asks that share times mean loss, outside, be ior^2 times the same
    /// inside. One factor is left; it makes the geometric mean of both shares that of what passes of diffuse light.
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
