//! A mesh's triangles, whole or in pieces, with the values that a writer puts at their corners.

use super::blend::Blend;
use super::split::Vertices;
use crate::meshing::{LitTriangle, Weights};
use crate::scene::Mesh;

/// The triangles of a mesh of the scene, or pieces of them, with values at their corners.
#[derive(Clone, Copy, Debug)]
pub struct Pieces<'a, const N: usize> {
    /// None where the triangles are whole.
    cut: Option<&'a [LitTriangle]>,
    /// Of the corners of each piece.
    pub values: &'a [[[f32; N]; 3]],
}

impl<'a, const N: usize> Pieces<'a, N> {
    /// The triangles as they are, with `values` at the corners of each.
    pub fn whole(values: &'a [[[f32; N]; 3]]) -> Self {
        Self { cut: None, values }
    }

    /// The pieces `cut`, with `values` at the corners of each.
    pub fn cut(cut: &'a [LitTriangle], values: &'a [[[f32; N]; 3]]) -> Self {
        assert_eq!(cut.len(), values.len(), "values for each piece");
        Self { cut: Some(cut), values }
    }

    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// The triangle of the mesh that piece `piece` belongs to.
    pub fn source(&self, piece: usize) -> usize {
        self.cut.map_or(piece, |cut| cut[piece].source as usize)
    }

    /// The vertices at the corners of piece `piece`, among `vertices`, where `corners` are those of its triangle of `mesh`.
    pub fn face(&self, piece: usize, mesh: &Mesh, corners: [u32; 3], vertices: &mut Vertices) -> [u32; 3] {
        let places = self.cut.map_or(Weights::CORNERS, |cut| cut[piece].corners);
        if places == Weights::CORNERS {
            return corners;
        }
        let positions = mesh.triangles[self.source(piece)].map(|v| mesh.positions[v as usize]);
        places.map(|place| vertices.place(Blend::at(place, corners, positions)))
    }
}
