//! Triangle meshes in their own space.

use glam::{Vec2, Vec3, Vec4};

/// A triangle mesh in local space. A vertex is one combination of position, normal, UVs and colour; vertices at one
/// position need not be shared.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// The source's name or path, for messages.
    pub name: String,
    /// Local positions [the unit that the surface's transform takes to metres], one a vertex.
    pub positions: Vec<Vec3>,
    /// Unit normals, one a vertex; empty where the source gives none (then shading is flat).
    pub normals: Vec<Vec3>,
    /// Texture coordinates, v down (glTF's way); each set has one pair a vertex.
    pub uvs: Vec<UvSet>,
    /// Linear RGBA that multiplies the albedo, one a vertex, or empty.
    pub colors: Vec<Vec4>,
    /// Vertex indices, counter-clockwise seen from the front. No triangle is degenerate.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `Scene::materials`, one a triangle.
    pub triangle_material: Vec<u32>,
    /// Where each triangle came from, one a triangle.
    pub origin: Vec<TriangleOrigin>,
}

/// A named set of texture coordinates: `TEXCOORD_0`, `st`, ...
#[derive(Clone, Debug)]
pub struct UvSet {
    pub name: String,
    pub coords: Vec<Vec2>,
}

/// A triangle's place in its source.
///
/// glTF: `part` is the primitive, `face` the triangle's ordinal in it, `corners` vertex indices of that primitive.
/// USD: `part` is 0, `face` the polygon, `corners` indices into faceVertexIndices (that is, face-varying ones).
/// Triangles with equal `part` and `face` make up one polygon, and stay in one chart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TriangleOrigin {
    pub part: u32,
    pub face: u32,
    pub corners: [u32; 3],
}

impl Mesh {
    /// The texture coordinates named `name`, one pair a vertex.
    pub fn uv_set(&self, name: &str) -> Option<&[Vec2]> {
        self.uvs.iter().find(|s| s.name == name).map(|s| s.coords.as_slice())
    }
}
