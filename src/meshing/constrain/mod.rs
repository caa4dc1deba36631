//! Cuts the triangles of a mesh along critical lines: a constrained Delaunay triangulation of each, in its own plane.
//!
//! Lines are drawn on each triangle ([`draw`]); where they end on a side, all triangles that share it get the same
//! points, at the same part of the way from its lower point to its higher; then each triangle is arranged ([`arrange`])
//! and triangulated ([`triangulate`]) on its own. Nothing comes nearer than the tolerance to anything else: ends and
//! crossings move to what is there, and of lines that run beside others those that show most stay. Cost: the square of
//! the lines of one triangle.

mod arrange;
mod draw;
mod triangulate;

use super::critical::{CriticalLine, Order};
use super::fine::{Edge, FineMesh, Piece, edge};
use super::weights::Weights;
use arrange::{Arranged, arrange};
use draw::{Drawing, draw};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// How triangles are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstrainParams {
    /// What lies nearer than this is one [m]; more than 0.
    pub tolerance: f64,
}

impl ConstrainParams {
    /// For a lightmap of `density` [texels per metre].
    pub fn of_density(density: f64) -> Self {
        Self { tolerance: 0.2 / density }
    }
}

/// Where an edge is cut: parts of the way from its lower point to its higher one, rising, and the points there.
type SidePoints = BTreeMap<Edge, Vec<(f64, u32)>>;

/// Cuts `mesh`, whose pieces are whole triangles in order, along `lines`, all of its surface. Pieces stay in the order
/// of triangles, and keep their winding; where lines of [`Order::Jump`] run, edges become breaks. Lines that can't be
/// followed are left out.
pub fn constrain(mesh: &mut FineMesh, lines: &[CriticalLine], params: &ConstrainParams) {
    let mut sorted: Vec<&CriticalLine> = lines.iter().filter(|l| (l.triangle as usize) < mesh.pieces.len()).collect();
    // Jumps first, as they become breaks; stable: others stay in the order of what they show.
    sorted.sort_by_key(|line| (line.triangle, line.order != Order::Jump));
    let drawings: Vec<Drawing> = sorted
        .chunk_by(|a, b| a.triangle == b.triangle)
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|lines| draw(&Face::new(mesh, lines[0].triangle as usize)?, lines, params.tolerance))
        .collect();
    let sides = cut_sides(mesh, &drawings, params.tolerance);
    let mut drawn = drawings.iter().peekable();
    let mut work: Vec<(usize, Option<&Drawing>)> = Vec::new();
    for (number, piece) in mesh.pieces.iter().enumerate() {
        let drawing = drawn.next_if(|d| d.triangle == number);
        let is_cut = (0..3).any(|k| sides.contains_key(&edge(piece.points[k], piece.points[(k + 1) % 3])));
        if drawing.is_some() || is_cut {
            work.push((number, drawing));
        }
    }
    let whole = &*mesh;
    let arranged: Vec<Arranged> =
        work.par_iter().map(|(number, drawing)| arrange(whole, *number, *drawing, &sides, params.tolerance)).collect();
    replace(mesh, &work, arranged);
}

/// Puts the pieces of the triangles that were cut in their places.
fn replace(mesh: &mut FineMesh, work: &[(usize, Option<&Drawing>)], arranged: Vec<Arranged>) {
    let mut pieces: Vec<Piece> = Vec::with_capacity(mesh.pieces.len());
    let mut breaks = BTreeSet::new();
    let mut next = 0;
    for ((number, _), mut arranged) in work.iter().zip(arranged) {
        pieces.extend(&mesh.pieces[next..*number]);
        next = number + 1;
        // Points of its own have numbers from here on.
        let first = mesh.points.len() as u32;
        let place = |v: u32| arranged.places[v as usize].unwrap_or_else(|own| first + own);
        let source = mesh.pieces[*number].source;
        let piece =
            |t: &[u32; 3]| Piece { source, points: t.map(place), corners: t.map(|v| arranged.weights[v as usize]) };
        pieces.extend(arranged.triangles.iter().map(piece));
        breaks.extend(arranged.breaks.iter().map(|[a, b]| edge(place(*a), place(*b))));
        mesh.points.append(&mut arranged.points);
    }
    pieces.extend(&mesh.pieces[next..]);
    mesh.pieces = pieces;
    mesh.breaks.append(&mut breaks);
}

/// Gathers where drawings end on sides, and makes points there: none nearer to another or an end than the tolerance.
fn cut_sides(mesh: &mut FineMesh, drawings: &[Drawing], tolerance: f64) -> SidePoints {
    let mut ends: Vec<(Edge, f64)> = Vec::new();
    for drawing in drawings {
        let points = mesh.pieces[drawing.triangle].points;
        let side = |(k, t): &(usize, f64)| {
            let (a, b) = (points[*k], points[(k + 1) % 3]);
            (edge(a, b), if a < b { *t } else { 1.0 - t })
        };
        ends.extend(drawing.touches.iter().map(side));
    }
    ends.par_sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut sides = SidePoints::new();
    for of_side in ends.chunk_by(|a, b| a.0 == b.0) {
        let side = of_side[0].0;
        let [low, high] = side.map(|p| mesh.points[p as usize]);
        let near = tolerance / low.distance(high).max(f64::MIN_POSITIVE);
        let mut places: Vec<(f64, u32)> = Vec::new();
        for (_, t) in of_side {
            let last = places.last().map_or(0.0, |(t, _)| *t);
            if *t - last >= near && 1.0 - *t >= near {
                places.push((*t, mesh.points.len() as u32));
                mesh.points.push(low.lerp(high, *t));
            }
        }
        if !places.is_empty() {
            sides.insert(side, places);
        }
    }
    sides
}

/// A triangle in its own plane [m]: counter-clockwise, its first corner at the origin, its first side along x.
struct Face {
    triangle: usize,
    origin: DVec3,
    axes: [DVec3; 2],
    corners: [DVec2; 3],
}

impl Face {
    /// `None` where the triangle has no area.
    fn new(mesh: &FineMesh, triangle: usize) -> Option<Self> {
        let [a, b, c] = mesh.pieces[triangle].points.map(|p| mesh.points[p as usize]);
        let x = (b - a).try_normalize()?;
        let y = (b - a).cross(c - a).cross(x).try_normalize()?;
        let flat = |p: DVec3| DVec2::new((p - a).dot(x), (p - a).dot(y));
        let corners = [DVec2::ZERO, DVec2::new(a.distance(b), 0.0), flat(c)];
        let face = Self { triangle, origin: a, axes: [x, y], corners };
        (face.twice_area().is_finite() && face.least_height() > 0.0).then_some(face)
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        DVec2::from_array(self.axes.map(|axis| (p - self.origin).dot(axis)))
    }

    fn twice_area(&self) -> f64 {
        let [a, b, c] = self.corners;
        (b - a).perp_dot(c - a)
    }

    fn side(&self, k: usize) -> [DVec2; 2] {
        [self.corners[k], self.corners[(k + 1) % 3]]
    }

    /// Its height above its longest side [m].
    fn least_height(&self) -> f64 {
        let longest = (0..3).map(|k| self.side(k)[0].distance(self.side(k)[1])).fold(0.0, f64::max);
        self.twice_area() / longest
    }

    /// How far inside of side `k` a place lies [m].
    fn depth(&self, k: usize, p: DVec2) -> f64 {
        let [a, b] = self.side(k);
        (b - a).normalize().perp_dot(p - a)
    }

    /// Where a place inside lies, by weights of the corners.
    fn weights(&self, p: DVec2) -> Weights {
        let share = |k: usize| {
            let [a, b] = self.side((k + 1) % 3);
            (b - a).perp_dot(p - a).max(0.0)
        };
        let w = DVec3::new(share(0), share(1), share(2));
        Weights(w / w.element_sum())
    }
}
