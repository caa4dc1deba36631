//! A Mesh prim as triangles: polygons, holes, orientation, normals, UVs and colours.

use super::polygon;
use super::primvar::{Interpolation, Place, Primvar, Sizes, read_primvar};
use super::read;
use crate::error::Warnings;
use crate::scene::{Mesh, TriangleOrigin, UvSet};
use glam::{Vec2, Vec3, Vec4};
use openusd::usd::Prim;
use std::collections::HashSet;

/// The material of each face, and whether it shows the mesh's display colour.
pub struct FaceMaterials {
    /// The material of a face that no subset claims.
    pub default: MaterialUse,
    /// One a face, where subsets are; else empty.
    pub by_face: Vec<MaterialUse>,
}

/// A material on a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialUse {
    /// Index into `Scene::materials`.
    pub index: u32,
    /// Its albedo is multiplied by the mesh's displayColor.
    pub display_color: bool,
}

impl FaceMaterials {
    fn of(&self, face: usize) -> MaterialUse {
        self.by_face.get(face).copied().unwrap_or(self.default)
    }

    fn any_display_color(&self) -> bool {
        self.default.display_color || self.by_face.iter().any(|m| m.display_color)
    }
}

/// What a mesh's topology says, before triangles are made.
pub struct Topology {
    pub points: Vec<Vec3>,
    counts: Vec<i32>,
    indices: Vec<i32>,
}

impl Topology {
    /// Reads points and faces; `None`, with a warning, where there are none.
    pub fn read(prim: &Prim, warnings: &mut Warnings) -> Option<Self> {
        let mut ints = |name: &str| read::value(prim, name, warnings).and_then(read::to_ints).unwrap_or_default();
        let (counts, indices) = (ints("faceVertexCounts"), ints("faceVertexIndices"));
        let points = read::value(prim, "points", warnings).and_then(read::to_vec3s).unwrap_or_default();
        if points.is_empty() || counts.is_empty() || indices.is_empty() {
            warnings.add(prim.path(), "a mesh without points or faces was left out");
            return None;
        }
        Some(Self { points, counts, indices })
    }

    pub fn sizes(&self) -> Sizes {
        Sizes { faces: self.counts.len(), points: self.points.len(), corners: self.indices.len() }
    }
}

/// What varies over the mesh besides positions.
struct Attributes {
    normals: Option<Primvar<Vec3>>,
    uvs: Vec<(String, Primvar<Vec2>)>,
    color: Option<Primvar<Vec3>>,
    opacity: Option<Primvar<f32>>,
}

/// Builds the mesh of `prim`. `inherited_color` is an ancestor's displayColor.
pub fn build(
    prim: &Prim,
    name: String,
    topology: &Topology,
    materials: &FaceMaterials,
    inherited_color: Option<Vec3>,
    warnings: &mut Warnings,
) -> Mesh {
    let attributes = read_attributes(prim, topology.sizes(), materials.any_display_color(), warnings);
    let left_handed = read::token(prim, "orientation", warnings).as_deref() == Some("leftHanded");
    let holes: HashSet<i32> =
        read::value(prim, "holeIndices", warnings).and_then(read::to_ints).unwrap_or_default().into_iter().collect();
    let mut builder = Builder::new(name, topology, &attributes, materials.any_display_color());
    let (mut broken, mut fans) = (0usize, 0usize);
    let mut first = 0usize;
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for (face, &count) in topology.counts.iter().enumerate() {
        let count = usize::try_from(count).unwrap_or(0);
        let polygon = first..first.saturating_add(count);
        first = polygon.end;
        let points = topology.indices.get(polygon.clone()).unwrap_or_default();
        corners.clear();
        corners.extend(points.iter().map_while(|&p| topology.points.get(usize::try_from(p).ok()?)).copied());
        if count < 3 || corners.len() != count {
            broken += 1;
            continue;
        }
        if i32::try_from(face).is_ok_and(|f| holes.contains(&f)) {
            continue;
        }
        triangles.clear();
        fans += usize::from(!polygon::triangulate(&corners, &mut triangles));
        let material = materials.of(face);
        let facing = if left_handed { -polygon::area_vector(&corners) } else { polygon::area_vector(&corners) };
        for &[a, b, c] in &triangles {
            let turned = if left_handed { [a, c, b] } else { [a, b, c] };
            let corners = turned.map(|k| polygon.start + k as usize);
            builder.push(face, corners, facing, material, inherited_color);
        }
    }
    if broken > 0 {
        warnings.add(format!("{} ({broken})", prim.path()), "faces with fewer than 3 corners or indices out of range");
    }
    if fans > 0 {
        warnings.add(prim.path(), "a concave polygon of very many corners was triangulated as a fan");
    }
    builder.mesh
}

fn read_attributes(prim: &Prim, sizes: Sizes, colors: bool, warnings: &mut Warnings) -> Attributes {
    let scheme = read::token(prim, "subdivisionScheme", warnings);
    let subdivided = scheme.as_deref() != Some("none");
    if subdivided {
        warnings.add(prim.path(), "a subdivision surface is taken as its control cage, with flat faces");
    }
    let mut normals = |name: &str, default| {
        if subdivided {
            // The schema says so: a subdivision surface's normals follow from its limit surface.
            return None;
        }
        read_primvar(prim, name, default, sizes, read::to_vec3s, warnings)
    };
    let normals =
        normals("primvars:normals", Interpolation::Constant).or_else(|| normals("normals", Interpolation::Point));
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
        if let Some(set) = read_primvar(prim, attribute.as_str(), constant, sizes, read::to_vec2s, warnings) {
            uvs.push((name.to_owned(), set));
        }
    }
    let constant = Interpolation::Constant;
    let color = colors
        .then(|| read_primvar(prim, "primvars:displayColor", constant, sizes, read::to_vec3s, warnings))
        .flatten();
    let opacity = colors
        .then(|| read_primvar(prim, "primvars:displayOpacity", constant, sizes, read::to_floats, warnings))
        .flatten();
    Attributes { normals, uvs, color, opacity }
}

/// Vertices of one point with more different attributes than this are no longer looked for, only appended: a hostile
/// mesh must not take quadratic time.
const LONGEST_CHAIN: usize = 64;

/// No vertex.
const NONE: u32 = u32::MAX;

/// Collects triangles; a vertex is one combination of point and attribute values.
struct Builder<'a> {
    mesh: Mesh,
    topology: &'a Topology,
    attributes: &'a Attributes,
    has_colors: bool,
    /// The last vertex made of each point, and of each vertex the one made before it.
    newest: Vec<u32>,
    older: Vec<u32>,
    uv: Vec<Vec2>,
}

impl<'a> Builder<'a> {
    fn new(name: String, topology: &'a Topology, attributes: &'a Attributes, has_colors: bool) -> Self {
        let uvs = attributes.uvs.iter().map(|(name, _)| UvSet { name: name.clone(), coords: Vec::new() }).collect();
        Self {
            mesh: Mesh { name, uvs, ..Mesh::default() },
            topology,
            attributes,
            has_colors,
            newest: vec![NONE; topology.points.len()],
            older: Vec::new(),
            uv: Vec::new(),
        }
    }

    fn push(&mut self, face: usize, corners: [usize; 3], facing: Vec3, material: MaterialUse, inherited: Option<Vec3>) {
        let triangle = corners.map(|corner| self.vertex(face, corner, facing, material, inherited));
        let [Some(a), Some(b), Some(c)] = triangle else { return };
        self.mesh.triangles.push([a, b, c]);
        self.mesh.triangle_material.push(material.index);
        let corners = corners.map(|corner| corner as u32);
        self.mesh.origin.push(TriangleOrigin { part: 0, face: face as u32, corners });
    }

    /// The vertex at a face corner, made where there is none like it. `None` only where an index is out of range.
    fn vertex(
        &mut self,
        face: usize,
        corner: usize,
        facing: Vec3,
        material: MaterialUse,
        inherited: Option<Vec3>,
    ) -> Option<u32> {
        let point = usize::try_from(*self.topology.indices.get(corner)?).ok()?;
        let position = *self.topology.points.get(point)?;
        let place = Place { face, point, corner };
        let normal = self.attributes.normals.as_ref().map(|normals| {
            let authored = normals.at(place).and_then(|n| n.try_normalize());
            authored.or_else(|| facing.try_normalize()).unwrap_or(Vec3::Y)
        });
        let color = self.has_colors.then(|| {
            if !material.display_color {
                return Vec4::ONE;
            }
            let own = self.attributes.color.as_ref().and_then(|c| c.at(place));
            let opacity = self.attributes.opacity.as_ref().and_then(|o| o.at(place));
            own.or(inherited).unwrap_or(Vec3::ONE).extend(opacity.unwrap_or(1.0))
        });
        self.uv.clear();
        // USD's v points up, the scene's down.
        self.uv.extend(self.attributes.uvs.iter().map(|(_, set)| {
            let uv = set.at(place).unwrap_or_default();
            Vec2::new(uv.x, 1.0 - uv.y)
        }));
        let newest = *self.newest.get(point)?;
        let mut candidate = newest;
        for _ in 0..LONGEST_CHAIN {
            if candidate == NONE {
                break;
            }
            if self.is_vertex(candidate as usize, normal, color) {
                return Some(candidate);
            }
            candidate = self.older.get(candidate as usize).copied().unwrap_or(NONE);
        }
        let made = u32::try_from(self.mesh.positions.len()).ok().filter(|&v| v != NONE)?;
        self.mesh.positions.push(position);
        self.mesh.normals.extend(normal);
        self.mesh.colors.extend(color);
        for (set, uv) in self.mesh.uvs.iter_mut().zip(&self.uv) {
            set.coords.push(*uv);
        }
        self.older.push(newest);
        *self.newest.get_mut(point)? = made;
        Some(made)
    }

    fn is_vertex(&self, v: usize, normal: Option<Vec3>, color: Option<Vec4>) -> bool {
        self.mesh.normals.get(v).copied() == normal
            && self.mesh.colors.get(v).copied() == color
            && self.mesh.uvs.iter().zip(&self.uv).all(|(set, uv)| set.coords.get(v) == Some(uv))
    }
}
