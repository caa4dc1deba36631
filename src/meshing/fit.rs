//! Values at vertices by least squares (Kavan, Bargteil and Sloan 2011, "Least squares vertex baking", section 3): those whose
//! linear interpolation is nearest to the light at all samples, weighed by area: no light is lost. Held against the light there, a
//! coarse mesh fits its dark parts, and a room loses up to half of its light.
//!
//! Corners at one place share a value where the surface is smooth there; across hard edges, materials that change what is held, and
//! edges where light jumps, each side has its own. Where samples say little (under furniture, within walls), values follow their
//! neighbours by a small share of the Laplacian.

use super::Weights;
use super::fine::{FineMesh, edge};
use super::sample::{Samples, Within};
use crate::color::Rgb;
use crate::scene::Mesh;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Cosine of the largest angle between flat faces of what still counts as one smooth surface: 30 degrees, as modelling tools'
/// smoothing has it by default.
const FLAT_COS: f32 = 0.866_025_4;
/// Cosine between authored normals that are one and the same: 1 degree, for quantized ones.
const SMOOTH_COS: f32 = 0.999_847_7;
/// Weight of the Laplacian beside that of samples.
const SMOOTHING: f64 = 1e-5;
/// Weight of doubtful samples.
const DOUBTFUL: f64 = 1e-7;
/// How far values may go beyond those of the samples around, as a share of their range: a line through the middles of texels goes
/// on to their edge, but no further.
const BEYOND: f32 = 0.25;
/// Steps of conjugate gradients, at most: mass matrices need few (Wathen 1987).
const STEPS: usize = 60;
/// Rounds of relaxation within limits, and the part of a full step that each takes: mass matrices have eigenvalues up to 2 beside
/// their diagonal (Wathen 1987).
const RELAXATIONS: usize = 24;
const RELAXATION: f64 = 0.7;
/// Steps to the factor that holds a surface's light, at most, and the part of that light that may be missing.
const FACTORS: usize = 8;
const HELD: f64 = 1e-6;
/// The residual at which conjugate gradients end, relative to the first.
const RESIDUAL: f64 = 1e-5;

/// Which corners share a value.
#[derive(Clone, Debug, Default)]
pub struct Groups {
    /// By piece: the groups of its corners.
    pub of: Vec<[u32; 3]>,
    pub count: usize,
}

impl Groups {
    /// The groups of `fine`, cut from `mesh`. `by_material`: values change with the material.
    pub fn new(fine: &FineMesh, mesh: &Mesh, by_material: bool) -> Self {
        let normals = Normals::new(fine, mesh);
        let mut corners: Vec<u32> = (0..3 * fine.pieces.len() as u32).collect();
        let place = |c: &u32| fine.pieces[*c as usize / 3].points[*c as usize % 3];
        // Stable: corners at a point stay in the order of pieces.
        corners.sort_by_key(place);
        let broken: std::collections::BTreeSet<u32> = fine.breaks.iter().flatten().copied().collect();
        let mut groups = Self { of: vec![[u32::MAX; 3]; fine.pieces.len()], count: 0 };
        for around in corners.chunk_by(|a, b| place(a) == place(b)) {
            let point = place(&around[0]);
            let material = |c: u32| {
                if by_material { mesh.triangle_material[fine.pieces[c as usize / 3].source as usize] } else { 0 }
            };
            let is_smooth = |a: u32, b: u32| material(a) == material(b) && normals.agree(a, b);
            let fans = if broken.contains(&point) { fans(fine, point, around) } else { vec![around.to_vec()] };
            for fan in fans {
                let mut first: Vec<(u32, u32)> = Vec::new();
                for c in fan {
                    let known = first.iter().find(|(corner, _)| is_smooth(*corner, c)).map(|(_, group)| *group);
                    let group = known.unwrap_or_else(|| {
                        first.push((c, groups.count as u32));
                        groups.count += 1;
                        groups.count as u32 - 1
                    });
                    groups.of[c as usize / 3][c as usize % 3] = group;
                }
            }
        }
        groups
    }
}

/// The corners `around` a point, parted by the edges of the point across which light jumps.
fn fans(fine: &FineMesh, point: u32, around: &[u32]) -> Vec<Vec<u32>> {
    let mut of_edge: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (k, c) in around.iter().enumerate() {
        let others = fine.pieces[*c as usize / 3].points.into_iter().filter(|p| *p != point);
        others.filter(|p| !fine.breaks.contains(&edge(point, *p))).for_each(|p| of_edge.entry(p).or_default().push(k));
    }
    let mut fan: Vec<usize> = (0..around.len()).collect();
    // Few corners meet at a point: passing the least number on until nothing changes is quick.
    loop {
        let before = fan.clone();
        for corners in of_edge.values() {
            let least = corners.iter().map(|k| fan[*k]).min().unwrap_or(0);
            corners.iter().for_each(|k| fan[*k] = least);
        }
        if fan == before {
            break;
        }
    }
    let mut fans: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    around.iter().zip(fan).for_each(|(c, f)| fans.entry(f).or_default().push(*c));
    fans.into_values().collect()
}

/// Normals at the corners of pieces: authored ones, or those of the flat triangles.
struct Normals {
    of: Vec<Vec3>,
    least_cos: f32,
}

impl Normals {
    fn new(fine: &FineMesh, mesh: &Mesh) -> Self {
        if mesh.normals.is_empty() {
            let flat = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
                (b - a).cross(c - a).normalize_or_zero().as_vec3()
            };
            let flat: Vec<Vec3> = mesh.triangles.iter().map(flat).collect();
            let of = fine.pieces.iter().flat_map(|piece| [flat[piece.source as usize]; 3]).collect();
            return Self { of, least_cos: FLAT_COS };
        }
        let blend = |piece: &super::fine::Piece| {
            let corners = mesh.triangles[piece.source as usize].map(|v| mesh.normals[v as usize].as_dvec3());
            let matrix = DMat3::from_cols(corners[0], corners[1], corners[2]);
            piece.corners.map(|w| (matrix * w.0).normalize_or_zero().as_vec3())
        };
        Self { of: fine.pieces.iter().flat_map(blend).collect(), least_cos: SMOOTH_COS }
    }

    fn agree(&self, a: u32, b: u32) -> bool {
        self.of[a as usize].dot(self.of[b as usize]) >= self.least_cos
    }
}

/// A piece's part of the normal equations.
struct Block {
    /// Products of the corners' hats, weighed: 00, 11, 22, 01, 12, 20.
    matrix: [f64; 6],
    groups: [usize; 3],
}

/// What the samples of a piece say.
struct Part {
    matrix: [f64; 6],
    right: [DVec3; 3],
    /// Values and weights, added up.
    sum: (DVec3, f64),
    /// The least and greatest of those that are certain.
    bounds: (Rgb, Rgb),
}

impl Part {
    fn new(corners: &[Weights; 3], members: &[u32], samples: &Samples) -> Self {
        let mut part = Self {
            matrix: [0.0; 6],
            right: [DVec3::ZERO; 3],
            sum: (DVec3::ZERO, 0.0),
            bounds: (Rgb::INFINITY, Rgb::NEG_INFINITY),
        };
        let mut mass = 0.0;
        if let Some(within) = Within::new(corners) {
            for s in members.iter().map(|s| &samples.all[*s as usize]) {
                let w = within.weights(s.weights());
                let whole = f64::from(s.area);
                let weight = if s.is_doubtful { DOUBTFUL * whole } else { whole };
                let value = s.value.as_dvec3();
                for k in 0..3 {
                    part.matrix[k] += weight * w[k] * w[k];
                    part.matrix[3 + k] += weight * w[k] * w[(k + 1) % 3];
                    part.right[k] += value * (weight * w[k]);
                }
                part.sum = (part.sum.0 + value * weight, part.sum.1 + weight);
                if !s.is_doubtful {
                    part.bounds = (part.bounds.0.min(s.value), part.bounds.1.max(s.value));
                }
                mass += whole;
            }
        }
        // The least weight keeps pieces without a sample attached to their neighbours.
        let smoothing = SMOOTHING * mass.max(1e-30);
        for k in 0..3 {
            part.matrix[k] += 2.0 * smoothing;
            part.matrix[3 + k] -= smoothing;
        }
        part
    }
}

/// The values of `groups` that fit the samples best: `members` are the numbers of the samples of each piece. `start`: a first guess,
/// one a group, or none.
pub fn fit(
    fine: &FineMesh,
    groups: &Groups,
    samples: &Samples,
    members: &[Vec<u32>],
    start: Option<Vec<DVec3>>,
) -> Vec<Rgb> {
    let part = |k: usize| Part::new(&fine.pieces[k].corners, &members[k], samples);
    let parts: Vec<Part> = (0..fine.pieces.len()).into_par_iter().with_min_len(64).map(part).collect();
    let mut right = vec![DVec3::ZERO; groups.count];
    let mut bounds = vec![(Rgb::INFINITY, Rgb::NEG_INFINITY); groups.count];
    let mut sums = vec![(DVec3::ZERO, 0.0); groups.count];
    let mut blocks = Vec::with_capacity(parts.len());
    for (part, of) in parts.into_iter().zip(&groups.of) {
        let of = of.map(|g| g as usize);
        for (k, g) in of.into_iter().enumerate() {
            right[g] += part.right[k];
            sums[g] = (sums[g].0 + part.sum.0, sums[g].1 + part.sum.1);
            bounds[g] = (bounds[g].0.min(part.bounds.0), bounds[g].1.max(part.bounds.1));
        }
        blocks.push(Block { matrix: part.matrix, groups: of });
    }
    let mean = |(sum, weight): &(DVec3, f64)| if *weight > 0.0 { *sum / *weight } else { DVec3::ZERO };
    let start = start.unwrap_or_else(|| sums.iter().map(mean).collect());
    let limits: Vec<(DVec3, DVec3)> = bounds.into_iter().map(|(low, high)| limits(low, high)).collect();
    let mut values = solve(&blocks, right.clone(), start);
    let clamped: Vec<DVec3> = values.iter().zip(&limits).map(|(v, (low, high))| v.clamp(*low, *high)).collect();
    if clamped != values {
        values = within(&blocks, &right, clamped, &limits);
    }
    values.into_iter().map(|v| v.as_vec3()).collect()
}

/// The limits of a value around which samples go from `low` to `high`; those of any light where there are none.
fn limits(low: Rgb, high: Rgb) -> (DVec3, DVec3) {
    if !low.is_finite() {
        return (DVec3::ZERO, DVec3::INFINITY);
    }
    let margin = (high - low) * BEYOND;
    ((low - margin).max(Rgb::ZERO).as_dvec3(), (high + margin).as_dvec3())
}

/// The best values within `limits`, by projected relaxation from `x`: values that may not go further leave their light to others,
/// and what these don't take, all make up for in proportion, so that the surface keeps its light.
fn within(blocks: &[Block], right: &[DVec3], mut x: Vec<DVec3>, limits: &[(DVec3, DVec3)]) -> Vec<DVec3> {
    let inverse = inverse_diagonal(blocks, x.len());
    // The area that a value stands for: the Laplacian has no part in it.
    let areas = apply(blocks, &vec![DVec3::ONE; x.len()]);
    let light: DVec3 = right.iter().sum();
    for _ in 0..RELAXATIONS {
        let image = apply(blocks, &x);
        for (k, x) in x.iter_mut().enumerate() {
            *x += (right[k] - image[k]) * (RELAXATION * inverse[k]);
        }
        hold(&mut x, limits, &areas, light);
    }
    x
}

/// Scales values by one factor a channel that makes them hold `light` within `limits`, where one does: by Newton's method, as what
/// they hold is a piecewise linear, rising function of it.
fn hold(x: &mut [DVec3], limits: &[(DVec3, DVec3)], areas: &[DVec3], light: DVec3) {
    let mut factor = DVec3::ONE;
    for _ in 0..FACTORS {
        let (mut held, mut slope) = (DVec3::ZERO, DVec3::ZERO);
        for ((x, (low, high)), area) in x.iter().zip(limits).zip(areas) {
            let scaled = *x * factor;
            let value = scaled.clamp(*low, *high);
            held += *area * value;
            slope += DVec3::select(value.cmpeq(scaled), *area * *x, DVec3::ZERO);
        }
        let miss = light - held;
        let can_move = slope.cmpgt(DVec3::ZERO) & miss.abs().cmpgt(light.abs() * HELD);
        if !can_move.any() {
            break;
        }
        factor = DVec3::select(can_move, (factor + miss / slope).max(DVec3::ZERO), factor);
    }
    x.iter_mut().zip(limits).for_each(|(x, (low, high))| *x = (*x * factor).clamp(*low, *high));
}

/// The inverse of the diagonal of the normal equations; 0 where nothing is said.
fn inverse_diagonal(blocks: &[Block], count: usize) -> Vec<f64> {
    let mut diagonal = vec![0.0; count];
    for block in blocks {
        (0..3).for_each(|k| diagonal[block.groups[k]] += block.matrix[k]);
    }
    diagonal.into_iter().map(|d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect()
}

/// The normal equations' matrix times `v`.
fn apply(blocks: &[Block], v: &[DVec3]) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; v.len()];
    for block in blocks {
        let [a, b, c] = block.groups;
        let [aa, bb, cc, ab, bc, ca] = block.matrix;
        out[a] += v[a] * aa + v[b] * ab + v[c] * ca;
        out[b] += v[a] * ab + v[b] * bb + v[c] * bc;
        out[c] += v[a] * ca + v[b] * bc + v[c] * cc;
    }
    out
}

/// Conjugate gradients, preconditioned by the diagonal, for the three channels at once.
fn solve(blocks: &[Block], mut residual: Vec<DVec3>, mut x: Vec<DVec3>) -> Vec<DVec3> {
    let inverse = inverse_diagonal(blocks, x.len());
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).fold(DVec3::ZERO, |sum, (a, b)| sum + *a * *b);
    let condition = |r: &[DVec3]| r.iter().zip(&inverse).map(|(r, i)| *r * *i).collect::<Vec<DVec3>>();
    let quotient = |a: DVec3, b: DVec3| DVec3::select(b.cmpgt(DVec3::ZERO), a / b, DVec3::ZERO);
    residual.iter_mut().zip(apply(blocks, &x)).for_each(|(r, a)| *r -= a);
    let mut z = condition(&residual);
    let mut direction = z.clone();
    let mut energy = dot(&residual, &z);
    let enough = energy * RESIDUAL * RESIDUAL;
    for _ in 0..STEPS {
        if !energy.cmpgt(enough).any() {
            break;
        }
        let image = apply(blocks, &direction);
        let step = quotient(energy, dot(&direction, &image));
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += *d * step);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= *i * step);
        z = condition(&residual);
        let next = dot(&residual, &z);
        let turn = quotient(next, energy);
        direction.iter_mut().zip(&z).for_each(|(d, z)| *d = *z + *d * turn);
        energy = next;
    }
    x
}

/// An error in colour, relative to `level`: that of the channel that is farthest off.
pub fn relative_error(difference: DVec3, level: f64) -> f64 {
    difference.abs().max_element() / level
}
