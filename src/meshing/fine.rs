//! A mesh while it is cut: pieces of a surface's triangles that meet at common points.

use super::Weights;
use crate::scene::Scene;
use glam::DVec3;
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

/// Where an edge is cut: the part of the way from its lower point to its higher one, in 0..1, and what point that becomes.
pub type Cuts = BTreeMap<Edge, f64>;

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
}
