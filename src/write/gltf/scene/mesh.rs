//! Meshes of the scene to glTF meshes: a primitive for each material.

use super::super::accessor::{Elements, push_triangles};
use super::super::document::{Document, Object, number};
use super::material::Materials;
use crate::error::{Result, Warnings};
use crate::scene::Mesh;
use crate::write::blend::Blend;
use crate::write::pieces::Pieces;
use crate::write::split::{Vertices, split};
use glam::{Affine3A, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A mesh, and the transform that its vertices take where a node can't.
pub struct Source<'a> {
    pub mesh: &'a Mesh,
    pub transform: Option<Affine3A>,
}

/// Attributes of some vertices of a mesh, with their names.
pub type Attributes = Vec<(&'static str, Elements)>;

impl Source<'_> {
    /// Appends `pieces` of the mesh's triangles to `doc`, vertices copied where their values differ; returns the mesh's index.
    /// `class` gives a piece's material and whether the value is all that leaves it; `attributes` makes attributes of the
    /// values.
    ///
    /// # Errors
    /// Those of materials.
    pub fn write<const N: usize>(
        &self,
        doc: &mut Document,
        materials: &mut Materials,
        pieces: &Pieces<N>,
        class: impl Fn(usize) -> (u32, bool),
        attributes: impl Fn(&[[f32; N]]) -> Attributes,
        warnings: &mut Warnings,
    ) -> Result<usize> {
        let mut classes: BTreeMap<(u32, bool), Vec<usize>> = BTreeMap::new();
        (0..pieces.len()).for_each(|p| classes.entry(class(p)).or_default().push(p));
        let mut primitives = Vec::new();
        for ((material, whole), own) in classes {
            let mut vertices = Vertices::new(self.mesh.positions.len());
            let face = |p: &usize| {
                let corners = self.mesh.triangles[pieces.source(*p)];
                pieces.face(*p, self.mesh, corners, &mut vertices)
            };
            let faces: Vec<[u32; 3]> = own.iter().map(face).collect();
            let values: Vec<_> = own.iter().map(|p| Some(pieces.values[*p])).collect();
            let mut split = split(vertices, &faces, &values);
            if self.transform.is_some_and(|t| t.matrix3.determinant() < 0.0) {
                split.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
            let mut json = Object::new();
            let mut add = |doc: &mut Document, name: String, elements: Elements| {
                let accessor = elements.push(doc);
                json.insert(name, accessor.into());
                accessor
            };
            let place = |v: Blend| self.position(v).to_array();
            add(doc, "POSITION".into(), Elements::floats(split.sources.iter().map(place)).with_bounds());
            if !self.mesh.normals.is_empty() {
                let normals = split.sources.iter().map(|v| self.normal(v).to_array());
                add(doc, "NORMAL".into(), Elements::floats(normals));
            }
            if !whole {
                for (number, name) in materials.sets(material as usize) {
                    let Some(coords) = self.mesh.uv_set(&name) else { continue };
                    let coords = split.sources.iter().map(|v| v.coords(coords).to_array());
                    add(doc, format!("TEXCOORD_{number}"), Elements::floats(coords));
                }
            }
            let mut own = None;
            for (name, elements) in attributes(&split.values) {
                own = Some(add(doc, name.into(), elements));
            }
            if !self.mesh.colors.is_empty() && N == 2 {
                let colors = split.sources.iter().map(|v| v.color(&self.mesh.colors).to_array());
                add(doc, "COLOR_0".into(), Elements::floats(colors));
            }
            fill_sets(&mut json, own);
            let indices = push_triangles(doc, &split.triangles, split.values.len());
            let material = materials.write(doc, material as usize, whole, warnings)?;
            primitives.push(json!({ "attributes": json, "indices": indices, "material": material }));
        }
        Ok(doc.push("meshes", json!({ "name": self.mesh.name, "primitives": primitives })))
    }

    /// Appends the mesh without anything of the bake; returns its index.
    ///
    /// # Errors
    /// Those of materials.
    pub fn write_plain(&self, doc: &mut Document, materials: &mut Materials, warnings: &mut Warnings) -> Result<usize> {
        let corners = vec![[[0.0; 2]; 3]; self.mesh.triangles.len()];
        let class = |p: usize| (self.mesh.triangle_material[p], false);
        self.write(doc, materials, &Pieces::whole(&corners), class, |_| Attributes::new(), warnings)
    }

    fn position(&self, vertex: Blend) -> Vec3 {
        let p = vertex.point(&self.mesh.positions);
        self.transform.map_or(p, |t| t.transform_point3(p))
    }

    fn normal(&self, vertex: Blend) -> Vec3 {
        let n = vertex.direction(&self.mesh.normals);
        self.transform.map_or(n, |t| (t.matrix3.inverse().transpose() * n).normalize_or(n))
    }
}

/// The lightmap's UVs.
pub fn lightmap_attributes(values: &[[f32; 2]]) -> Attributes {
    vec![("TEXCOORD_1", Elements::floats(values.iter().copied()))]
}

/// UV sets must be numbered without a gap: those that are missing below the last one are `stand_in`.
fn fill_sets(attributes: &mut Object, stand_in: Option<usize>) {
    let has = |attributes: &Object, n: usize| attributes.contains_key(&format!("TEXCOORD_{n}"));
    let last = (0..8).rev().find(|n| has(attributes, *n)).unwrap_or(0);
    for n in 0..last {
        if let (false, Some(stand_in)) = (has(attributes, n), stand_in) {
            attributes.insert(format!("TEXCOORD_{n}"), stand_in.into());
        }
    }
}

/// `[number]` of each value, as an array.
pub fn array(values: impl IntoIterator<Item = f32>) -> Value {
    values.into_iter().map(number).collect::<Vec<_>>().into()
}
