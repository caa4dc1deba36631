//! The points and edges of one triangle: points on its sides, ends and crossings of its lines.

use super::draw::{Drawing, ON_LINE, Spot, Stroke};
use super::triangulate::{fan_out, triangulate};
use super::{Face, SidePoints};
use crate::meshing::fine::{FineMesh, edge};
use crate::meshing::weights::Weights;
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// The pieces of one triangle, by the numbers of their own points.
pub struct Arranged {
    /// What points of the mesh they are, or numbers among the new ones.
    pub places: Vec<Result<u32, u32>>,
    pub weights: Vec<Weights>,
    /// New points [m].
    pub points: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub breaks: Vec<[u32; 2]>,
}

/// The border of a triangle, from corner to corner, counter-clockwise.
struct Border {
    /// Points of the mesh.
    points: Vec<u32>,
    weights: Vec<Weights>,
    /// The sides that each lies on, a bit each.
    sides: Vec<u8>,
    /// By side: the part of the way along it, and the number in the border, of each point of it, corners included.
    along: [Vec<(f64, u32)>; 3],
}

/// Cuts triangle `number` along a drawing, with the points that its sides have.
pub fn arrange(
    mesh: &FineMesh,
    number: usize,
    drawing: Option<&Drawing>,
    sides: &SidePoints,
    tolerance: f64,
) -> Arranged {
    let border = Border::new(mesh, number, sides);
    let mut breaks = border.jumps(drawing);
    let mut places: Vec<Result<u32, u32>> = border.points.iter().map(|p| Ok(*p)).collect();
    let mut weights = border.weights.clone();
    let mut points = Vec::new();
    let corners = mesh.pieces[number].points.map(|p| mesh.points[p as usize]);
    if let Some(face) = Face::new(mesh, number) {
        let mut sketch = Sketch::new(&face, &border, tolerance);
        sketch.draw(drawing.map_or(&[], |d| &d.strokes));
        let constraints: Vec<[u32; 2]> = sketch.edges.keys().copied().collect();
        if let Some(triangles) = triangulate(&sketch.points, &border.sides, &constraints) {
            for p in &sketch.points[border.points.len()..] {
                let w = face.weights(*p);
                places.push(Err(points.len() as u32));
                weights.push(w);
                points.push(corners[0] * w.0.x + corners[1] * w.0.y + corners[2] * w.0.z);
            }
            let sides_of = |t: &[u32; 3]| [edge(t[0], t[1]), edge(t[1], t[2]), edge(t[2], t[0])];
            let there: BTreeSet<[u32; 2]> = triangles.iter().flat_map(sides_of).collect();
            let jumps = sketch.edges.iter().filter(|(e, jumps)| **jumps && there.contains(*e)).map(|(e, _)| *e);
            breaks.extend(jumps);
            return Arranged { places, weights, points, triangles, breaks };
        }
    }
    let triangles = fan_out(&border.sides);
    Arranged { places, weights, points, triangles, breaks }
}

impl Border {
    fn new(mesh: &FineMesh, number: usize, sides: &SidePoints) -> Self {
        let corners = mesh.pieces[number].points;
        let mut border = Self { points: Vec::new(), weights: Vec::new(), sides: Vec::new(), along: Default::default() };
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (a, b) = (corners[k], corners[next]);
            border.along[k].push((0.0, border.points.len() as u32));
            border.push(a, Weights::CORNERS[k], 1 << k | 1 << ((k + 2) % 3));
            let side = edge(a, b);
            // Both triangles at a side blend its ends from the lower to the higher.
            let (low, high) = if a < b { (k, next) } else { (next, k) };
            let mut cuts: Vec<(f64, u32)> = sides.get(&side).cloned().unwrap_or_default();
            if a > b {
                cuts.reverse();
            }
            for (t, point) in cuts {
                border.along[k].push((if a < b { t } else { 1.0 - t }, border.points.len() as u32));
                border.push(point, Weights::CORNERS[low].lerp(Weights::CORNERS[high], t), 1 << k);
            }
        }
        for k in 0..3 {
            let end = border.along[(k + 1) % 3][0].1;
            border.along[k].push((1.0, end));
        }
        border
    }

    fn push(&mut self, point: u32, weights: Weights, sides: u8) {
        self.points.push(point);
        self.weights.push(weights);
        self.sides.push(sides);
    }

    /// The point of side `k` nearest to the part `t` of the way along it.
    fn nearest(&self, k: usize, t: f64) -> u32 {
        let off = |(s, _): &&(f64, u32)| (s - t).abs();
        self.along[k].iter().min_by(|a, b| off(a).total_cmp(&off(b))).map_or(0, |(_, i)| *i)
    }

    /// The edges of sides along which light jumps.
    fn jumps(&self, drawing: Option<&Drawing>) -> Vec<[u32; 2]> {
        let mut jumps = Vec::new();
        for (k, [from, to]) in drawing.iter().flat_map(|d| &d.jumps) {
            let (first, last) = (self.nearest(*k, *from), self.nearest(*k, *to));
            let place = |v: u32| self.along[*k].iter().position(|(_, i)| *i == v).unwrap_or(0);
            jumps.extend(self.along[*k][place(first)..=place(last)].windows(2).map(|w| [w[0].1, w[1].1]));
        }
        jumps
    }
}

/// Points and edges of a triangle while they are drawn.
struct Sketch<'a> {
    face: &'a Face,
    border: &'a Border,
    tolerance: f64,
    points: Vec<DVec2>,
    /// Points by the cell of a grid that they lie in.
    cells: HashMap<[i64; 2], Vec<u32>>,
    /// Edges along lines, and whether light jumps there.
    edges: BTreeMap<[u32; 2], bool>,
}

impl<'a> Sketch<'a> {
    fn new(face: &'a Face, border: &'a Border, tolerance: f64) -> Self {
        let mut sketch =
            Self { face, border, tolerance, points: Vec::new(), cells: HashMap::new(), edges: BTreeMap::new() };
        for weights in &border.weights {
            let [a, b, c] = face.corners;
            let w = weights.0;
            sketch.push(a * w.x + b * w.y + c * w.z);
        }
        sketch
    }

    fn push(&mut self, p: DVec2) -> u32 {
        let number = self.points.len() as u32;
        self.points.push(p);
        self.cells.entry(self.cell(p)).or_default().push(number);
        number
    }

    fn cell(&self, p: DVec2) -> [i64; 2] {
        (p / (2.0 * self.tolerance)).floor().to_array().map(|x| x as i64)
    }

    /// The numbers of points within the tolerance of `p`, and some more.
    fn around(&self, p: DVec2) -> impl Iterator<Item = u32> {
        let [x, y] = self.cell(p);
        let cells = (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [x.saturating_add(dx), y.saturating_add(dy)]));
        cells.filter_map(|cell| self.cells.get(&cell)).flatten().copied()
    }

    /// The point at a place: the nearest within the tolerance, or a new one; `None` where it would crowd a side.
    fn at(&mut self, p: DVec2) -> Option<u32> {
        let distance = |i: &u32| self.points[*i as usize].distance_squared(p);
        let nearest = self.around(p).min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        if let Some(i) = nearest.filter(|i| distance(i) < self.tolerance * self.tolerance) {
            return Some(i);
        }
        let side = (0..3).find(|k| self.face.depth(*k, p) < 0.5 * self.tolerance);
        if let Some(k) = side {
            let [a, b] = self.face.side(k);
            let i = self.border.nearest(k, (p - a).dot(b - a) / a.distance_squared(b));
            return (distance(&i) < (3.0 * self.tolerance).powi(2)).then_some(i);
        }
        Some(self.push(p))
    }

    fn draw(&mut self, strokes: &[Stroke]) {
        let mut lines: Vec<([u32; 2], bool)> = Vec::new();
        for stroke in strokes {
            let mut end = |spot: Spot| match spot {
                Spot::Corner(k) => Some(self.border.along[k][0].1),
                Spot::Side(k, t) => Some(self.border.nearest(k, t)),
                Spot::Inside(p) => self.at(p),
            };
            if let (Some(a), Some(b)) = (end(stroke.ends[0]), end(stroke.ends[1]))
                && a != b
            {
                lines.push(([a, b], stroke.jumps));
            }
        }
        for i in 0..lines.len() {
            for j in 0..i {
                if let Some(p) = crossing(self.ends(lines[i].0), self.ends(lines[j].0)) {
                    self.at(p);
                }
            }
        }
        for (ends, jumps) in lines {
            self.add_edges(ends, jumps);
        }
    }

    fn ends(&self, line: [u32; 2]) -> [DVec2; 2] {
        line.map(|i| self.points[i as usize])
    }

    /// Adds a line as edges from point to point, of those that lie near it.
    fn add_edges(&mut self, line: [u32; 2], jumps: bool) {
        let [a, b] = self.ends(line);
        let (way, length) = ((b - a).normalize(), a.distance(b));
        let steps = (length / (2.0 * self.tolerance)).ceil().min(1e6) as usize;
        let mut on: Vec<(f64, u32)> = Vec::new();
        for step in 0..=steps {
            for i in self.around(a.lerp(b, step as f64 / steps.max(1) as f64)) {
                let lever = self.points[i as usize] - a;
                let along = lever.dot(way);
                if lever.perp_dot(way).abs() < ON_LINE * self.tolerance && along > 0.0 && along < length {
                    on.push((along, i));
                }
            }
        }
        on.retain(|(_, i)| !line.contains(i));
        on.extend([(0.0, line[0]), (length, line[1])]);
        on.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        on.dedup();
        for pair in on.windows(2) {
            let (p, q) = (pair[0].1, pair[1].1);
            let is_side = (p as usize) < self.border.sides.len()
                && (q as usize) < self.border.sides.len()
                && self.border.sides[p as usize] & self.border.sides[q as usize] != 0;
            if !is_side {
                *self.edges.entry(edge(p, q)).or_default() |= jumps;
            }
        }
    }
}

/// Where two lines cross, between their ends.
fn crossing([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> Option<DVec2> {
    let (way, other) = (b - a, d - c);
    let turn = way.perp_dot(other);
    let (u, v) = ((c - a).perp_dot(other) / turn, (c - a).perp_dot(way) / turn);
    (u > 0.0 && u < 1.0 && v > 0.0 && v < 1.0).then(|| a + way * u)
}
