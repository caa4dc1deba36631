//! Meshes of the scene to glTF meshes: a primitive for each material.

use super::super::accessor::{Elements, push_triangles};
use super::super::document::{Document, Object, number};
use super::super::split::split;
use super::material::Materials;
use crate::error::{Result, Warnings};
use crate::scene::Mesh;
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
    /// Appends the mesh to `doc`, vertices copied where `corners` (a value for each corner) differ; returns its index.
    /// `class` gives a triangle's material and whether the value is all that leaves it; `attributes` makes attributes of
    /// the values.
    ///
    /// # Errors
    /// Those of materials.
    pub fn write<const N: usize>(
        &self,
        doc: &mut Document,
        materials: &mut Materials,
        corners: &[[[f32; N]; 3]],
        class: impl Fn(usize) -> (u32, bool),
        attributes: impl Fn(&[u32], &[[f32; N]]) -> Attributes,
        warnings: &mut Warnings,
    ) -> Result<usize> {
        let mut classes: BTreeMap<(u32, bool), Vec<usize>> = BTreeMap::new();
        (0..self.mesh.triangles.len()).for_each(|t| classes.entry(class(t)).or_default().push(t));
        let mut primitives = Vec::new();
        for ((material, whole), triangles) in classes {
            let faces: Vec<[u32; 3]> = triangles.iter().map(|t| self.mesh.triangles[*t]).collect();
            let values: Vec<_> = triangles.iter().map(|t| Some(corners[*t])).collect();
            let mut split = split(self.mesh.positions.len(), &faces, &values);
            if self.transform.is_some_and(|t| t.matrix3.determinant() < 0.0) {
                split.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
            let mut json = Object::new();
            let mut add = |doc: &mut Document, name: String, elements: Elements| {
                let accessor = elements.push(doc);
                json.insert(name, accessor.into());
                accessor
            };
            let place = |v: &u32| self.position(*v as usize).to_array();
            add(doc, "POSITION".into(), Elements::floats(split.sources.iter().map(place)).with_bounds());
            if !self.mesh.normals.is_empty() {
                let normals = split.sources.iter().map(|v| self.normal(*v as usize).to_array());
                add(doc, "NORMAL".into(), Elements::floats(normals));
            }
            if !whole {
                for (number, name) in materials.sets(material as usize) {
                    let Some(coords) = self.mesh.uv_set(&name) else { continue };
                    let coords = split.sources.iter().map(|v| coords[*v as usize].to_array());
                    add(doc, format!("TEXCOORD_{number}"), Elements::floats(coords));
                }
            }
            let mut own = None;
            for (name, elements) in attributes(&split.sources, &split.values) {
                own = Some(add(doc, name.into(), elements));
            }
            if !self.mesh.colors.is_empty() && N == 2 {
                let colors = split.sources.iter().map(|v| self.mesh.colors[*v as usize].to_array());
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
        let class = |t: usize| (self.mesh.triangle_material[t], false);
        self.write(doc, materials, &corners, class, |_, _| Attributes::new(), warnings)
    }

    fn position(&self, vertex: usize) -> Vec3 {
        let p = self.mesh.positions[vertex];
        self.transform.map_or(p, |t| t.transform_point3(p))
    }

    fn normal(&self, vertex: usize) -> Vec3 {
        let n = self.mesh.normals[vertex];
        self.transform.map_or(n, |t| (t.matrix3.inverse().transpose() * n).normalize_or(n))
    }
}

/// The lightmap's UVs.
pub fn lightmap_attributes(_: &[u32], values: &[[f32; 2]]) -> Attributes {
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
