//! Primitives that gain a value at each triangle corner: vertices are copied where a corner needs its own, with everything
//! that they hold.
//!
//! Exporters often let primitives share their vertices and differ in indices alone. Such primitives are a group here, and
//! share the new vertices too.

use super::accessor::{self, Elements};
use super::document::{Document, Object, index};
use super::split::split;
use crate::error::{Error, Result};
use crate::scene::Mesh;
use serde_json::Value;
use std::collections::BTreeMap;

/// Primitives of a mesh over one list of vertices, after the vertices were copied as needed.
pub struct Group<const N: usize> {
    /// The value of each vertex.
    pub values: Vec<[f32; N]>,
    pub parts: Vec<Part>,
}

/// A primitive of a [`Group`].
pub struct Part {
    /// Index of the primitive in its mesh.
    pub primitive: usize,
    /// Its triangles over the group's vertices.
    pub triangles: Vec<[u32; 3]>,
    /// The scene mesh's triangle that each of them is; `None` where the loader left it out.
    pub scene_triangles: Vec<Option<usize>>,
}

/// A primitive, and the values at the corners of its triangles; `None` for those that the loader left out.
type Valued<const N: usize> = (Part, Vec<Option<[[f32; N]; 3]>>);

/// Gives the vertices of mesh `mesh` of the document one value each, from `corners`: a value for each corner of the
/// triangles of `scene_mesh`, which was loaded from it. Rewrites attributes, morph targets and indices where vertices had
/// to be copied. Primitives that the loader left out stay as they are.
///
/// # Errors
/// `Invalid` where the document is broken, `Unsupported` where it is compressed.
pub fn split_mesh<const N: usize>(
    doc: &mut Document,
    mesh: usize,
    scene_mesh: &Mesh,
    corners: &[[[f32; N]; 3]],
) -> Result<Vec<Group<N>>> {
    let mut groups: Vec<(Object, Vec<Valued<N>>)> = Vec::new();
    for (primitive, triangles) in triangles_by_part(scene_mesh) {
        let json = primitive_json(doc, mesh, primitive)?;
        // What primitives must have in common to share vertices.
        let key: Object = json
            .iter()
            .filter(|(k, _)| *k == "attributes" || *k == "targets")
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect();
        let faces = faces(doc, json)?;
        let place = format!("{}: meshes[{mesh}].primitives[{primitive}]", doc.place);
        let mut part = Part { primitive, scene_triangles: vec![None; faces.len()], triangles: faces };
        let mut values = vec![None; part.triangles.len()];
        for t in triangles {
            let origin = scene_mesh.origin[t];
            let face = part.triangles.get(origin.face as usize);
            let value = face.and_then(|face| by_vertex(face, &origin.corners, &corners[t]));
            let value =
                value.ok_or_else(|| Error::invalid(&place, "doesn't hold the triangles that were loaded from it"))?;
            values[origin.face as usize] = Some(value);
            part.scene_triangles[origin.face as usize] = Some(t);
        }
        match groups.iter_mut().find(|(k, _)| *k == key) {
            Some((_, parts)) => parts.push((part, values)),
            None => groups.push((key, vec![(part, values)])),
        }
    }
    groups.into_iter().map(|(key, parts)| split_group(doc, mesh, &key, parts)).collect()
}

/// Splits the vertices of one group and rewrites its primitives where that changed anything.
fn split_group<const N: usize>(
    doc: &mut Document,
    mesh: usize,
    key: &Object,
    parts: Vec<Valued<N>>,
) -> Result<Group<N>> {
    let broken = || Error::invalid(&doc.place, format!("meshes[{mesh}] has no POSITION; export the file again"));
    let positions = key.get("attributes").and_then(Value::as_object).and_then(|a| index(a, "POSITION"));
    let count = index(doc.item("accessors", positions.ok_or_else(broken)?)?, "count").ok_or_else(broken)?;
    let (parts, values): (Vec<Part>, Vec<_>) = parts.into_iter().unzip();
    let triangles: Vec<[u32; 3]> = parts.iter().flat_map(|p| p.triangles.iter().copied()).collect();
    if triangles.iter().flatten().any(|v| *v as usize >= count) {
        return Err(Error::invalid(
            &doc.place,
            format!("meshes[{mesh}] has indices out of range; export the file again"),
        ));
    }
    let split = split(count, &triangles, &values.concat());
    let mut rest = split.triangles.as_slice();
    let mut group = Group { values: split.values, parts };
    for part in &mut group.parts {
        let (own, others) = rest.split_at(part.triangles.len());
        part.triangles = own.to_vec();
        rest = others;
    }
    if split.changed {
        let mut vertices = Vertices { doc, sources: &split.sources, copies: BTreeMap::new() };
        let attributes = vertices.copy_all(key.get("attributes").unwrap_or(&Value::Null))?;
        let targets = key
            .get("targets")
            .and_then(Value::as_array)
            .map(|targets| targets.iter().map(|t| vertices.copy_all(t)).collect::<Result<Vec<_>>>());
        let targets = targets.transpose()?;
        for part in &group.parts {
            let indices = accessor::push_triangles(doc, &part.triangles, group.values.len());
            let json = primitive_json_mut(doc, mesh, part.primitive)?;
            json.insert("attributes".into(), attributes.clone());
            if let Some(targets) = &targets {
                json.insert("targets".into(), targets.clone().into());
            }
            json.insert("indices".into(), indices.into());
            if json.contains_key("mode") {
                json.insert("mode".into(), 4.into());
            }
        }
    }
    Ok(group)
}

/// Copies of accessors in a new order; each accessor is copied once.
struct Vertices<'a> {
    doc: &'a mut Document,
    sources: &'a [u32],
    copies: BTreeMap<usize, usize>,
}

impl Vertices<'_> {
    /// The attributes `attributes` (names to accessors), with copied accessors.
    fn copy_all(&mut self, attributes: &Value) -> Result<Value> {
        let attributes = attributes.as_object().cloned().unwrap_or_default();
        let copied = attributes.into_iter().map(|(name, value)| {
            let accessor = value.as_u64().and_then(|a| usize::try_from(a).ok());
            let accessor =
                accessor.ok_or_else(|| Error::invalid(&self.doc.place, format!("{name} names no accessor")))?;
            Ok((name, Value::from(self.copy(accessor)?)))
        });
        Ok(Value::Object(copied.collect::<Result<_>>()?))
    }

    fn copy(&mut self, accessor: usize) -> Result<usize> {
        if let Some(copy) = self.copies.get(&accessor) {
            return Ok(*copy);
        }
        let elements = accessor::read(self.doc, accessor)?.gather(self.sources).ok_or_else(|| {
            Error::invalid(&self.doc.place, format!("accessors[{accessor}] is too short; export the file again"))
        })?;
        let copy = elements.push(self.doc);
        self.copies.insert(accessor, copy);
        Ok(copy)
    }
}

/// Sets attribute `name` of primitive `primitive` of mesh `mesh`. Morph targets of an attribute that was replaced no
/// longer fit and go.
///
/// # Errors
/// `Invalid` where there is no such primitive.
pub fn set_attribute(doc: &mut Document, mesh: usize, primitive: usize, name: &str, accessor: usize) -> Result<()> {
    let json = primitive_json_mut(doc, mesh, primitive)?;
    if let Some(attributes) = json.get_mut("attributes").and_then(Value::as_object_mut) {
        attributes.insert(name.into(), accessor.into());
    }
    for target in json.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
        target.as_object_mut().and_then(|t| t.shift_remove(name));
    }
    Ok(())
}

/// Primitive `primitive` of mesh `mesh`.
///
/// # Errors
/// `Invalid` where there is none.
pub fn primitive_json(doc: &Document, mesh: usize, primitive: usize) -> Result<&Object> {
    let json = doc.item("meshes", mesh)?.get("primitives").and_then(|p| p.get(primitive)).and_then(Value::as_object);
    json.ok_or_else(|| missing(&doc.place, mesh, primitive))
}

/// [`primitive_json`], to edit.
///
/// # Errors
/// `Invalid` where there is none.
pub fn primitive_json_mut(doc: &mut Document, mesh: usize, primitive: usize) -> Result<&mut Object> {
    let error = missing(&doc.place, mesh, primitive);
    let primitives = doc.item_mut("meshes", mesh)?.get_mut("primitives");
    primitives.and_then(|p| p.get_mut(primitive)).and_then(Value::as_object_mut).ok_or(error)
}

fn missing(place: &str, mesh: usize, primitive: usize) -> Error {
    Error::invalid(place, format!("meshes[{mesh}].primitives[{primitive}] is missing; export the file again"))
}

/// The triangles of a scene mesh by the primitive that they came from.
pub fn triangles_by_part(mesh: &Mesh) -> BTreeMap<usize, Vec<usize>> {
    let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (t, origin) in mesh.origin.iter().enumerate() {
        parts.entry(origin.part as usize).or_default().push(t);
    }
    parts
}

/// The triangles of a primitive as vertex indices, strips and fans taken apart (glTF 2.0, section 3.7.2.1).
fn faces(doc: &Document, primitive: &Object) -> Result<Vec<[u32; 3]>> {
    let compressed = primitive.get("extensions").is_some_and(|e| e.get("KHR_draco_mesh_compression").is_some());
    if compressed {
        let message = "KHR_draco_mesh_compression can't be edited; export it uncompressed";
        return Err(Error::unsupported(&doc.place, message));
    }
    let positions = primitive.get("attributes").and_then(Value::as_object).and_then(|a| index(a, "POSITION"));
    let corners = match (index(primitive, "indices"), positions) {
        (Some(indices), _) => accessor::read_indices(doc, indices)?,
        (None, Some(positions)) => (0..accessor::read(doc, positions)?.count() as u32).collect(),
        (None, None) => Vec::new(),
    };
    let turn = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
    Ok(match (index(primitive, "mode").unwrap_or(4), corners.as_slice()) {
        (5, corners) => corners.windows(3).enumerate().map(turn).collect(),
        (6, [center, rim @ ..]) => rim.windows(2).map(|w| [w[0], w[1], *center]).collect(),
        (_, corners) => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    })
}

/// The values of `corners` (vertices of one triangle, in any order) in the order of `face`.
fn by_vertex<T: Copy>(face: &[u32; 3], corners: &[u32; 3], values: &[T; 3]) -> Option<[T; 3]> {
    let value = |v: u32| corners.iter().position(|c| *c == v).map(|k| values[k]);
    Some([value(face[0])?, value(face[1])?, value(face[2])?])
}

/// Appends `elements`, one a vertex of `group`, and sets them as attribute `name` of its primitives.
///
/// # Errors
/// `Invalid` where a primitive is missing.
pub fn set_group_attribute<const N: usize>(
    doc: &mut Document,
    mesh: usize,
    group: &Group<N>,
    name: &str,
    elements: &Elements,
) -> Result<()> {
    let accessor = elements.push(doc);
    group.parts.iter().try_for_each(|part| set_attribute(doc, mesh, part.primitive, name, accessor))
}

/// The materials of a primitive: its own, and those of its variants.
pub fn material_indices(primitive: &Object) -> Vec<usize> {
    let variants = primitive.get("extensions").and_then(|e| e.get("KHR_materials_variants"));
    let mappings = variants.and_then(|v| v.get("mappings")).and_then(Value::as_array).into_iter().flatten();
    let variants = mappings.filter_map(Value::as_object).filter_map(|m| index(m, "material"));
    index(primitive, "material").into_iter().chain(variants).collect()
}
