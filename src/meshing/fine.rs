//! A mesh while it is cut: pieces of a surface's triangles that meet at common points.

use super::Weights;
use crate::scene::Scene;
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Two points that an edge joins, the lower number first.
pub type Edge = [u32; 2];

/// The edge between two points.
pub fn edge(a: u32, b: u32) -> Edge {
    if a < b { [a, b] } else { [b, a] }
}

/// The pieces of a surface's triangles. They are watertight where the mesh is: an edge is cut for all pieces that have it.
#[derive(Clone, Debug)]
pub struct FineMesh {
    /// World positions [m] of the distinct places where corners lie: vertices of the mesh at one place are one point.
    pub points: Vec<DVec3>,
    /// How many of the points, the first ones, are the mesh's own.
    pub own: usize,
    pub pieces: Vec<Piece>,
    /// Edges across which light may jump.
    pub breaks: BTreeSet<Edge>,
}

/// A piece of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// The triangle of the mesh.
    pub source: u32,
    /// The points at its corners, in the winding of the mesh.
    pub points: [u32; 3],
    /// Where its corners lie in the triangle.
    pub corners: [Weights; 3],
}

impl Piece {
    /// The share of its triangle that it covers; negative where it is turned over.
    pub fn share(&self) -> f64 {
        DMat3::from_cols(self.corners[0].0, self.corners[1].0, self.corners[2].0).determinant()
    }
}

impl FineMesh {
    /// The mesh of surface `surface` as it is.
    pub fn new(scene: &Scene, surface: usize) -> Self {
        let placed = &scene.surfaces[surface];
        let mesh = &scene.meshes[placed.mesh];
        let transform = placed.world_from_local;
        let (matrix, translation) = (transform.matrix3.as_dmat3(), transform.translation.as_dvec3());
        let mut points: Vec<DVec3> = Vec::new();
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let mut point = |vertex: u32| {
            let p = mesh.positions[vertex as usize];
            // Adding zero makes -0 and 0 one place.
            *known.entry((p + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                points.push(matrix * p.as_dvec3() + translation);
                points.len() as u32 - 1
            })
        };
        let whole =
            |(source, t): (u32, &[u32; 3])| Piece { source, points: t.map(&mut point), corners: Weights::CORNERS };
        let pieces = (0..).zip(&mesh.triangles).map(whole).collect();
        Self { own: points.len(), points, pieces, breaks: BTreeSet::new() }
    }

    /// Triangles that there are at least, however many points go again: those along breaks stay. About, as a new point in the middle
    /// of things adds two triangles, and one on the border one.
    pub fn least_triangles(&self, given: usize) -> u64 {
        let new = |p: &u32| *p as usize >= self.own;
        let fixed: BTreeSet<u32> = self.breaks.iter().flatten().copied().filter(new).collect();
        (given + 2 * fixed.len()) as u64
    }

    /// Cuts edges in two, each at its middle, and all pieces that have one of them. Returns, for each piece there is now, the number of
    /// the piece that it was or is a part of; the order of triangles stays.
    pub fn bisect(&mut self, edges: &BTreeSet<Edge>) -> Vec<u32> {
        let mut middle: HashMap<Edge, u32> = HashMap::with_capacity(edges.len());
        for &[a, b] in edges {
            middle.insert([a, b], self.points.len() as u32);
            self.points.push((self.points[a as usize] + self.points[b as usize]) * 0.5);
            if self.breaks.remove(&[a, b]) {
                let new = self.points.len() as u32 - 1;
                self.breaks.extend([edge(a, new), edge(b, new)]);
            }
        }
        let mut pieces = Vec::with_capacity(self.pieces.len() + 2 * edges.len());
        let mut parents = Vec::with_capacity(pieces.capacity());
        for (number, piece) in self.pieces.iter().enumerate() {
            let before = pieces.len();
            self.part(piece, &middle, &mut pieces);
            parents.resize(parents.len() + pieces.len() - before, number as u32);
        }
        self.pieces = pieces;
        parents
    }

    /// Adds the parts of `piece`, of which the edges that have a middle are cut.
    fn part(&self, piece: &Piece, middle: &HashMap<Edge, u32>, parts: &mut Vec<Piece>) {
        let cut = |k: usize| middle.get(&edge(piece.points[k], piece.points[(k + 1) % 3])).copied();
        let cuts = [cut(0), cut(1), cut(2)];
        let corner = |k: usize| (piece.points[k % 3], piece.corners[k % 3]);
        // The middle of the edge from corner k to the next, weighed from its lower point to its higher one.
        let half = |k: usize, point: u32| {
            let (a, b) = (corner(k), corner(k + 1));
            let (low, high) = if a.0 < b.0 { (a.1, b.1) } else { (b.1, a.1) };
            (point, low.lerp(high, 0.5))
        };
        let mut add = |corners: [(u32, Weights); 3]| {
            parts.push(Piece { source: piece.source, points: corners.map(|c| c.0), corners: corners.map(|c| c.1) });
        };
        let place = |c: (u32, Weights)| self.points[c.0 as usize];
        match cuts.iter().flatten().count() {
            0 => parts.push(*piece),
            1 => {
                let k = (0..3).find(|k| cuts[*k].is_some()).unwrap_or(0);
                let m = half(k, cuts[k].unwrap_or(0));
                add([corner(k), m, corner(k + 2)]);
                add([m, corner(k + 1), corner(k + 2)]);
            }
            2 => {
                // The corner k lies between the two edges.
                let k = (0..3).find(|k| cuts[(*k + 1) % 3].is_none()).unwrap_or(0);
                let (after, before) = (half(k, cuts[k].unwrap_or(0)), half(k + 2, cuts[(k + 2) % 3].unwrap_or(0)));
                let (next, last) = (corner(k + 1), corner(k + 2));
                add([before, corner(k), after]);
                if place(after).distance_squared(place(last)) <= place(before).distance_squared(place(next)) {
                    add([after, next, last]);
                    add([after, last, before]);
                } else {
                    add([after, next, before]);
                    add([before, next, last]);
                }
            }
            _ => {
                let [a, b, c] = [0, 1, 2].map(|k| half(k, cuts[k].unwrap_or(0)));
                add([corner(0), a, c]);
                add([a, corner(1), b]);
                add([c, b, corner(2)]);
                add([a, b, c]);
            }
        }
    }

    /// The pieces at each edge.
    pub fn pieces_at_edges(&self) -> BTreeMap<Edge, Vec<u32>> {
        let mut at: BTreeMap<Edge, Vec<u32>> = BTreeMap::new();
        for (number, piece) in (0..).zip(&self.pieces) {
            for k in 0..3 {
                at.entry(edge(piece.points[k], piece.points[(k + 1) % 3])).or_default().push(number);
            }
        }
        at
    }
}
