//! Vertex colours that hold the light: values at the vertices of meshes, and meshes that follow the light.
//!
//! A mesh that is refined keeps its triangles: each is cut into pieces, and a new vertex is a place in a triangle of the source,
//! so that whatever vertices hold (normals, UVs, weights of skins, morph targets) can be blended there.

pub mod constrain;
pub mod corner;
pub mod critical;
pub mod fine;
pub mod weights;

use crate::color::Rgb;
pub use weights::Weights;

/// The light at the vertices of all surfaces.
#[derive(Clone, Debug, Default)]
pub struct VertexLight {
    /// By surface; empty for those that don't receive.
    pub surfaces: Vec<LitMesh>,
}

/// A surface's mesh with light at its vertices.
#[derive(Clone, Debug, Default)]
pub struct LitMesh {
    /// The pieces of the mesh's triangles, in the order of those; each triangle has one piece at least.
    pub triangles: Vec<LitTriangle>,
}

/// A triangle of the source's mesh, or a piece of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitTriangle {
    /// The triangle of the mesh that this is a piece of.
    pub source: u32,
    /// Where its corners lie in that triangle; its winding is that triangle's.
    pub corners: [Weights; 3],
    /// The lightmap's quantity at its corners.
    pub values: [Rgb; 3],
}

impl LitMesh {
    /// The mesh as it was given, with `values` at the corners of its triangles.
    pub fn given(values: impl IntoIterator<Item = [Rgb; 3]>) -> Self {
        let whole = |(source, values)| LitTriangle { source, corners: Weights::CORNERS, values };
        Self { triangles: (0..).zip(values).map(whole).collect() }
    }

    /// True where no triangle was cut.
    pub fn is_given(&self) -> bool {
        self.triangles.iter().all(|t| t.corners == Weights::CORNERS)
    }
}

/// How meshes follow the light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MeshMode {
    /// Not at all.
    #[default]
    Given,
    /// Triangles are cut where values between vertices miss the light.
    Adaptive,
    /// The same, after triangles were cut along the critical curves of shadows and contacts.
    Discontinuity,
}
