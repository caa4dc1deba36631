//! Lightmap values at the corners of triangles, for vertex colours.

use crate::color::Rgb;

/// Values at every triangle corner, averaged over the corners that a smooth surface shares.
#[derive(Clone, Debug)]
pub struct CornerColors {
    /// By surface, by triangle of its mesh: the lightmap's quantity at its three corners (order of `Mesh::triangles`).
    pub surfaces: Vec<Vec<[Rgb; 3]>>,
}
