//! The edges of a mesh, found by sorting its corners.

use super::cage::Cage;
use rayon::prelude::*;

/// The place of a face that isn't there.
pub const NO_FACE: u32 = u32::MAX;

/// An edge between two vertices.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// The smaller vertex first.
    pub ends: [u32; 2],
    /// The faces on both sides, the first by index first; [`NO_FACE`] where there is one alone.
    pub faces: [u32; 2],
    /// The corners of these faces at which the edge starts.
    pub corners: [u32; 2],
    pub sharpness: f32,
    /// Joins more than two faces, or a vertex with itself.
    pub is_tangled: bool,
}

/// The edges of a mesh.
pub struct Adjacency {
    /// In the order of their ends.
    pub edges: Vec<Edge>,
    /// The edge that starts at each corner.
    pub edge_of_corner: Vec<u32>,
}

impl Adjacency {
    /// Finds the edges of `cage`. O(n log n).
    pub fn new(cage: &Cage) -> Self {
        let mut half_edges: Vec<(u32, u32, u32)> = Vec::with_capacity(cage.corners.len());
        let mut face_of_corner = vec![0u32; cage.corners.len()];
        for f in 0..cage.face_count() {
            for corner in cage.face(f) {
                let (a, b) = (cage.corners[corner], cage.corners[cage.next(f, corner)]);
                half_edges.push((a.min(b), a.max(b), corner as u32));
                face_of_corner[corner] = f as u32;
            }
        }
        half_edges.par_sort_unstable();
        let mut edges: Vec<Edge> = Vec::with_capacity(half_edges.len() / 2 + 1);
        let mut edge_of_corner = vec![0u32; cage.corners.len()];
        for &(a, b, corner) in &half_edges {
            let (face, sharpness) = (face_of_corner[corner as usize], cage.edge_sharpness[corner as usize]);
            match edges.last_mut().filter(|edge| edge.ends == [a, b]) {
                Some(edge) => {
                    edge.is_tangled |= edge.faces[1] != NO_FACE;
                    if edge.faces[1] == NO_FACE {
                        edge.faces[1] = face;
                        edge.corners[1] = corner;
                    }
                    edge.sharpness = edge.sharpness.max(sharpness);
                }
                None => edges.push(Edge {
                    ends: [a, b],
                    faces: [face, NO_FACE],
                    corners: [corner, corner],
                    sharpness,
                    is_tangled: a == b,
                }),
            }
            edge_of_corner[corner as usize] = edges.len() as u32 - 1;
        }
        Self { edges, edge_of_corner }
    }
}
