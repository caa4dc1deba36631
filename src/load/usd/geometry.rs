//! The polygons of a gprim with what varies over them, before they become triangles.

use super::primvar::{Interpolation, Primvar, Sizes, read_primvar};
use super::read::{self, Reading};
use glam::{Vec2, Vec3};
use openusd::usd::Prim;
use std::collections::HashSet;

/// Points and faces.
pub struct Topology {
    pub points: Vec<Vec3>,
    /// Corners of each face.
    pub counts: Vec<i32>,
    /// The point of each corner.
    pub indices: Vec<i32>,
}

impl Topology {
    /// Reads points and faces; `None`, with a warning, where there are none.
    pub fn read(prim: &Prim, reading: &mut Reading) -> Option<Self> {
        let mut ints = |name: &str| read::value(prim, name, reading).and_then(read::to_ints).unwrap_or_default();
        let (counts, indices) = (ints("faceVertexCounts"), ints("faceVertexIndices"));
        let points = read::value(prim, "points", reading).and_then(read::to_vec3s).unwrap_or_default();
        if points.is_empty() || counts.is_empty() || indices.is_empty() {
            reading.add(prim.path(), "a mesh without points or faces was left out");
            return None;
        }
        Some(Self { points, counts, indices })
    }

    pub fn sizes(&self) -> Sizes {
        Sizes { faces: self.counts.len(), points: self.points.len(), corners: self.indices.len() }
    }
}

/// What varies over the polygons besides positions.
#[derive(Default)]
pub struct Attributes {
    pub normals: Option<Primvar<Vec3>>,
    /// By name; v up.
    pub uvs: Vec<(String, Primvar<Vec2>)>,
    pub color: Option<Primvar<Vec3>>,
    pub opacity: Option<Primvar<f32>>,
}

/// Polygons as they are triangulated.
pub struct Geometry {
    pub topology: Topology,
    pub attributes: Attributes,
    /// Faces that are not shown.
    pub holes: HashSet<u32>,
    /// Fronts are clockwise.
    pub left_handed: bool,
    /// Where the faces are not the prim's own (a shape, a refined surface): the prim's face that each lies in.
    pub remade: Option<Vec<u32>>,
}

impl Geometry {
    /// The polygons of the Mesh prim `prim`. `colors`: a material reads displayColor.
    pub fn read(prim: &Prim, topology: Topology, colors: bool, reading: &mut Reading) -> Self {
        let attributes = Attributes::read(prim, topology.sizes(), colors, reading);
        let left_handed = is_left_handed(prim, reading);
        let holes = read::value(prim, "holeIndices", reading).and_then(read::to_ints).unwrap_or_default();
        let holes = holes.into_iter().filter_map(|f| u32::try_from(f).ok()).collect();
        Self { topology, attributes, holes, left_handed, remade: None }
    }

    /// The prim's own face that `face` lies in.
    pub fn source_face(&self, face: usize) -> usize {
        match &self.remade {
            Some(faces) => faces.get(face).map_or(0, |&f| f as usize),
            None => face,
        }
    }
}

/// True where fronts are clockwise.
pub fn is_left_handed(prim: &Prim, reading: &mut Reading) -> bool {
    read::token(prim, "orientation", reading).as_deref() == Some("leftHanded")
}

/// True where the schema calls `prim` a subdivision surface.
pub fn is_subdivided(prim: &Prim, reading: &mut Reading) -> bool {
    read::token(prim, "subdivisionScheme", reading).as_deref() != Some("none")
}

impl Attributes {
    fn read(prim: &Prim, sizes: Sizes, colors: bool, reading: &mut Reading) -> Self {
        let subdivided = is_subdivided(prim, reading);
        let mut normals = |name: &str, default| {
            if subdivided {
                // The schema says so: a subdivision surface's normals follow from its limit surface.
                return None;
            }
            read_primvar(prim, name, default, sizes, read::to_vec3s, reading)
        };
        let normals =
            normals("primvars:normals", Interpolation::Constant).or_else(|| normals("normals", Interpolation::Vertex));
        let mut uvs = Vec::new();
        for attribute in prim.authored_property_names().unwrap_or_default() {
            let Some(name) = attribute.strip_prefix("primvars:") else { continue };
            let kind = prim.attribute(attribute.as_str()).type_name().ok().flatten();
            let is_uv = kind.is_some_and(|kind| {
                let kind = kind.as_str().trim_end_matches("[]");
                matches!(kind, "texCoord2f" | "texCoord2d" | "texCoord2h" | "float2" | "double2" | "half2")
            });
            if !is_uv || name.ends_with(":indices") {
                continue;
            }
            let constant = Interpolation::Constant;
            if let Some(set) = read_primvar(prim, attribute.as_str(), constant, sizes, read::to_vec2s, reading) {
                uvs.push((name.to_owned(), set));
            }
        }
        let constant = Interpolation::Constant;
        let color = colors
            .then(|| read_primvar(prim, "primvars:displayColor", constant, sizes, read::to_vec3s, reading))
            .flatten();
        let opacity = colors
            .then(|| read_primvar(prim, "primvars:displayOpacity", constant, sizes, read::to_floats, reading))
            .flatten();
        Self { normals, uvs, color, opacity }
    }
}
