//! The form factor between two elements without occluders, by adaptive quadrature.
//!
//! `F_ij = 1/A_i * integral over A_i of F(x -> A_j) dx`: the inner integral is Lambert's contour integral over each polygon of
//! j (Baum, Rushmeier, Winget 1989, section 3: analytic inside, numerical outside), the outer one an adaptive rule over the
//! triangles of i. Radon's rule of seven points (degree 5; Stroud 1971, T2:5-1) and the two rules of degree 2 on four of them tell
//! its error; the triangle with the largest is cut in four until their sum is small enough. Cuts gather where the kernel's
//! slope has no bound: at edges that the elements share, and where one dips below the other's horizon.
//!
//! Polygons of j so small and far that the kernel hardly varies over them count as points. Cost: at least 7 points a polygon
//! of i; times 0.1 microseconds a near polygon of j, a hundredth of that a far one. Limits: nothing blocks.

use super::outline::{Outline, Polygon};
use super::{Effort, Elements, FormFactor};
use crate::contour::point_to_polygon_f64;
use crate::patch::Ground;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use glam::DVec3;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

/// Pairs of points that are looked at for occluders.
const BLOCKED_SAMPLES: u32 = 1 << 14;

/// A triangle of the outer element with its integral.
struct Tile {
    corners: [DVec3; 3],
    /// The polygon that it is part of.
    polygon: u32,
    integral: f64,
    error: f64,
}

impl PartialEq for Tile {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Tile {}
impl PartialOrd for Tile {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Tile {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.error.total_cmp(&other.error)
    }
}

/// The form factor from element `i` to `j`; `outlines` are theirs. `error` bounds the quadrature's error (it is no matter of
/// chance), `samples` are points on the outer element. `A_i F_ij` is the same for (j, i) at the same tolerance.
pub fn form_factor(
    elements: &Elements,
    i: usize,
    j: usize,
    [of_i, of_j]: [&Outline; 2],
    effort: &Effort,
) -> FormFactor {
    let areas = [f64::from(elements.area[i]), f64::from(elements.area[j])];
    // The smaller one is the outer: the kernel varies less over it.
    let i_is_outer = (areas[0], i) <= (areas[1], j);
    let (outer, inner) = if i_is_outer { (of_i, of_j) } else { (of_j, of_i) };
    // Buried parts share no light: the rest counts as if it were all over the element.
    let exposed = areas[0] * areas[1] / (outer.area * inner.area);
    let scale = exposed / areas[0];
    if !scale.is_finite() {
        return FormFactor::default();
    }
    // A point's share of the error that is allowed may be spent on taking polygons for points.
    let reach = f64::from(effort.relative_error).max(1e-9).sqrt().recip();
    let seen: Vec<Vec<&Polygon>> =
        outer.polygons.iter().map(|p| inner.polygons.iter().filter(|q| p.faces(q)).collect()).collect();
    let mut points = 0u32;
    let mut tile = |corners: [DVec3; 3], polygon: u32| {
        points += 7;
        let (normal, seen) = (outer.polygons[polygon as usize].normal, &seen[polygon as usize]);
        let (integral, error) = radon(&corners, |x| seen.iter().map(|q| kernel(x, normal, q, reach)).sum());
        Tile { corners, polygon, integral, error }
    };
    let mut tiles = BinaryHeap::new();
    for (k, polygon) in outer.polygons.iter().enumerate().filter(|(k, _)| !seen[*k].is_empty()) {
        tiles.extend(polygon.triangles().map(|corners| tile(corners, k as u32)));
    }
    let total =
        |tiles: &BinaryHeap<Tile>| tiles.iter().fold((0.0, 0.0), |(sum, error), t| (sum + t.integral, error + t.error));
    let (mut sum, mut error) = total(&tiles);
    let mut cuts = 0;
    while error * scale > effort.tolerance(sum * scale) && 7 * (tiles.len() as u32 + 3) < effort.most_samples {
        let Some(worst) = tiles.pop() else { break };
        sum -= worst.integral;
        error -= worst.error;
        let [a, b, c] = worst.corners;
        let [ab, bc, ca] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
        for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            let part = tile(corners, worst.polygon);
            sum += part.integral;
            error += part.error;
            tiles.push(part);
        }
        cuts += 1;
        // Rounding of the running sums would pass for an error that no cut removes.
        if cuts % 256 == 0 {
            (sum, error) = total(&tiles);
        }
    }
    FormFactor { value: sum * scale, error: error.max(0.0) * scale, samples: points }
}

/// The share of segments between elements that face each other that something blocks: what this method does not know.
pub fn blocked_share(elements: &Elements, ground: &Ground) -> f64 {
    let n = elements.len() as u32;
    let pairs = Sequence::new(elements.seed, Stage::FormFactor, u64::MAX);
    let segments: Vec<Segment> = (0..BLOCKED_SAMPLES)
        .filter_map(|k| {
            let [i, j] = [2 * k, 2 * k + 1].map(|salt| pairs.hash(salt) % n);
            let (a, b) = (elements.kept_point(i as usize, k), elements.kept_point(j as usize, k));
            let way = b.position - a.position;
            let faces = i != j && way.dot(a.normal) > 0.0 && way.dot(b.normal) < 0.0;
            faces.then_some(Segment { from: a.position, to: b.position })
        })
        .collect();
    let mut blocked = vec![false; segments.len()];
    ground.tracer.occluded(&segments, &mut blocked);
    blocked.iter().filter(|b| **b).count() as f64 / segments.len().max(1) as f64
}

/// The share of the cosine-weighted hemisphere at `x` that the front of `polygon` covers. Its centre stands for all of it beyond
/// `reach` times its radius.
fn kernel(x: DVec3, normal: DVec3, polygon: &Polygon, reach: f64) -> f64 {
    let way = polygon.centre - x;
    let height = -way.dot(polygon.normal);
    if height <= 1e-9 * polygon.radius {
        return 0.0;
    }
    let square = way.length_squared();
    let far = reach * polygon.radius;
    if square > far * far {
        return way.dot(normal).max(0.0) * height * polygon.area / (PI * square * square);
    }
    point_to_polygon_f64(x, normal, &polygon.corners)
}

/// The integral of `f` over a triangle, and how far it may be off.
fn radon(corners: &[DVec3; 3], f: impl Fn(DVec3) -> f64) -> (f64, f64) {
    let root = 15f64.sqrt();
    let [near, far] = [(6.0 - root) / 21.0, (6.0 + root) / 21.0];
    let weights = [0.225, (155.0 - root) / 1200.0, (155.0 + root) / 1200.0];
    let [a, b, c] = *corners;
    let orbit = |s: f64| {
        let at = |p: DVec3| f(p * (1.0 - 2.0 * s) + (a + b + c - p) * s);
        [at(a), at(b), at(c)]
    };
    let centre = f((a + b + c) / 3.0);
    let (inner, outer) = (orbit(far), orbit(near));
    let sum = |v: [f64; 3]| v.iter().sum::<f64>();
    let mean = weights[0] * centre + weights[1] * sum(outer) + weights[2] * sum(inner);
    // The centre and three others alone: exact up to degree 2 for this weight of the orbit.
    let lower = |s: f64, orbit: [f64; 3]| {
        let weight = 1.0 / (12.0 * (1.0 - 3.0 * s).powi(2));
        (1.0 - 3.0 * weight) * centre + weight * sum(orbit)
    };
    let spread = (weights[0] * (centre - mean).abs())
        + outer.iter().map(|v| weights[1] * (v - mean).abs()).sum::<f64>()
        + inner.iter().map(|v| weights[2] * (v - mean).abs()).sum::<f64>();
    // The lower rules' error is what is seen; where that is a small part of the variation the function is smooth, and the
    // higher rule better by as much again (the heuristic of QUADPACK, Piessens et al. 1983, section 2.2).
    let seen = (mean - lower(near, outer)).abs().max((mean - lower(far, inner)).abs());
    let error = if spread > 0.0 { seen * (SMOOTH * seen / spread).min(1.0) } else { 0.0 };
    let area = 0.5 * (b - a).cross(c - a).length();
    (area * mean, area * error)
}

/// How far the lower rules' error is trusted to tell the smoothness: safe by a few times on the kernels of the tests.
const SMOOTH: f64 = 10.0;
