//! Polygons as triangles: holes, orientation, normals, UVs and colours.

use super::geometry::Geometry;
use super::polygon;
use super::primvar::Place;
use super::read::Reading;
use crate::scene::{Mesh, TriangleOrigin, UvSet};
use glam::{Vec2, Vec3, Vec4};

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

    /// True where one of them shows the display colour.
    pub fn any_display_color(&self) -> bool {
        self.default.display_color || self.by_face.iter().any(|m| m.display_color)
    }
}

/// Triangulates `geometry`. `inherited_color` is an ancestor's displayColor.
pub fn build(
    name: String,
    geometry: &Geometry,
    materials: &FaceMaterials,
    inherited_color: Option<Vec3>,
    reading: &mut Reading,
) -> Mesh {
    let Geometry { topology, left_handed, .. } = geometry;
    let mut builder = Builder::new(name.clone(), geometry, materials.any_display_color());
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
        if u32::try_from(face).is_ok_and(|f| geometry.holes.contains(&f)) {
            continue;
        }
        triangles.clear();
        fans += usize::from(!polygon::triangulate(&corners, &mut triangles));
        let material = materials.of(geometry.source_face(face));
        let area = polygon::area_vector(&corners);
        let facing = if *left_handed { -area } else { area };
        for &[a, b, c] in &triangles {
            let turned = if *left_handed { [a, c, b] } else { [a, b, c] };
            let corners = turned.map(|k| polygon.start + k as usize);
            builder.push(face, corners, facing, material, inherited_color);
        }
    }
    if broken > 0 {
        reading.add(format!("{name} ({broken})"), "faces with fewer than 3 corners or indices out of range");
    }
    if fans > 0 {
        reading.add(name, "a concave polygon of very many corners was triangulated as a fan");
    }
    builder.mesh
}

/// Vertices of one point with more different attributes than this are no longer looked for, only appended: a hostile
/// mesh must not take quadratic time.
const LONGEST_CHAIN: usize = 64;

/// No vertex.
const NONE: u32 = u32::MAX;

/// Collects triangles; a vertex is one combination of point and attribute values.
struct Builder<'a> {
    mesh: Mesh,
    geometry: &'a Geometry,
    has_colors: bool,
    /// The last vertex made of each point, and of each vertex the one made before it.
    newest: Vec<u32>,
    older: Vec<u32>,
    uv: Vec<Vec2>,
}

impl<'a> Builder<'a> {
    fn new(name: String, geometry: &'a Geometry, has_colors: bool) -> Self {
        let uvs =
            geometry.attributes.uvs.iter().map(|(name, _)| UvSet { name: name.clone(), coords: Vec::new() }).collect();
        Self {
            mesh: Mesh { name, uvs, ..Mesh::default() },
            geometry,
            has_colors,
            newest: vec![NONE; geometry.topology.points.len()],
            older: Vec::new(),
            uv: Vec::new(),
        }
    }

    fn push(&mut self, face: usize, corners: [usize; 3], facing: Vec3, material: MaterialUse, inherited: Option<Vec3>) {
        let triangle = corners.map(|corner| self.vertex(face, corner, facing, material, inherited));
        let [Some(a), Some(b), Some(c)] = triangle else { return };
        self.mesh.triangles.push([a, b, c]);
        self.mesh.triangle_material.push(material.index);
        // Of a remade surface no corner is the prim's own: its triangles are numbered instead, as the writer writes them.
        let (part, corners) = match self.geometry.remade {
            None => (0, corners.map(|corner| corner as u32)),
            Some(_) => {
                let first = 3 * self.mesh.origin.len() as u32;
                (self.geometry.source_face(face) as u32, [first, first + 1, first + 2])
            }
        };
        self.mesh.origin.push(TriangleOrigin { part, face: face as u32, corners });
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
        let point = usize::try_from(*self.geometry.topology.indices.get(corner)?).ok()?;
        let position = *self.geometry.topology.points.get(point)?;
        let place = Place { face, point, corner };
        let normal = self.geometry.attributes.normals.as_ref().map(|normals| {
            let authored = normals.at(place).and_then(|n| n.try_normalize());
            authored.or_else(|| facing.try_normalize()).unwrap_or(Vec3::Y)
        });
        let color = self.has_colors.then(|| {
            if !material.display_color {
                return Vec4::ONE;
            }
            let own = self.geometry.attributes.color.as_ref().and_then(|c| c.at(place));
            let opacity = self.geometry.attributes.opacity.as_ref().and_then(|o| o.at(place));
            own.or(inherited).unwrap_or(Vec3::ONE).extend(opacity.unwrap_or(1.0))
        });
        self.uv.clear();
        // USD's v points up, the scene's down.
        self.uv.extend(self.geometry.attributes.uvs.iter().map(|(_, set)| {
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
