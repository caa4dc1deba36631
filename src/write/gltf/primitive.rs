//! Primitives that gain a value at each triangle corner: vertices are copied where a corner needs its own, with everything
//! that they hold, and triangles that were cut give way to their pieces, whose new vertices are blends of the triangle's.
//!
//! Vertices are blended as they rest; skins and morph targets move what was blended as they move its sources: morph targets and
//! influences of joints are blended by the same weights. Both sides of an edge move alike.
//!
//! Exporters often let primitives share their vertices and differ in indices alone. Such primitives are a group here, and
//! share the new vertices too.

use super::accessor::{self, Blending, Elements};
use super::document::{Document, Object, index};
use super::influences;
use crate::error::{Error, Result};
use crate::scene::Mesh;
use crate::write::pieces::Pieces;
use crate::write::split::{Sources, Vertices, split};
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
    /// Its triangles over the group's vertices, in the order of the source.
    pub triangles: Vec<[u32; 3]>,
    /// The piece that each of them is; `None` where the loader left the triangle out.
    pub pieces: Vec<Option<usize>>,
}

/// Primitives over one list of vertices, before these have one value each.
struct Shared<const N: usize> {
    /// What primitives must have in common to share vertices: attributes and morph targets.
    key: Object,
    vertices: Vertices,
    parts: Vec<Part>,
    /// The values at the corners of the parts' triangles; none for those that the loader left out.
    corners: Vec<Option<[[f32; N]; 3]>>,
}

/// Gives the vertices of mesh `mesh` of the document one value each, from `pieces` of the triangles of `scene_mesh`, which was
/// loaded from it. Rewrites attributes, morph targets and indices where vertices had to be copied or triangles were cut.
/// Primitives that the loader left out stay as they are.
///
/// # Errors
/// `Invalid` where the document is broken, `Unsupported` where it is compressed.
pub fn split_mesh<const N: usize>(
    doc: &mut Document,
    mesh: usize,
    scene_mesh: &Mesh,
    pieces: &Pieces<N>,
) -> Result<Vec<Group<N>>> {
    let mut groups: Vec<Shared<N>> = Vec::new();
    for (primitive, own) in pieces_by_part(scene_mesh, pieces) {
        let json = primitive_json(doc, mesh, primitive)?;
        let key: Object = json
            .iter()
            .filter(|(k, _)| *k == "attributes" || *k == "targets")
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect();
        let faces = faces(doc, json)?;
        let place = format!("{}: meshes[{mesh}].primitives[{primitive}]", doc.place);
        let group = match groups.iter().position(|group| group.key == key) {
            Some(known) => &mut groups[known],
            None => {
                let vertices = Vertices::new(vertex_count(doc, mesh, &key)?);
                groups.push(Shared { key, vertices, parts: Vec::new(), corners: Vec::new() });
                groups.last_mut().expect("just pushed")
            }
        };
        if faces.iter().flatten().any(|v| *v as usize >= group.vertices.own()) {
            return Err(Error::invalid(&place, "has indices out of range; export the file again"));
        }
        let part = cut(primitive, &faces, scene_mesh, pieces, own, group)
            .ok_or_else(|| Error::invalid(&place, "doesn't hold the triangles that were loaded from it"))?;
        group.parts.push(part);
    }
    groups.into_iter().map(|group| split_group(doc, mesh, group)).collect()
}

/// The number of vertices that the attributes of `key` have.
fn vertex_count(doc: &Document, mesh: usize, key: &Object) -> Result<usize> {
    let broken = || Error::invalid(&doc.place, format!("meshes[{mesh}] has no POSITION; export the file again"));
    let positions = key.get("attributes").and_then(Value::as_object).and_then(|a| index(a, "POSITION"));
    index(doc.item("accessors", positions.ok_or_else(broken)?)?, "count").ok_or_else(broken)
}

/// The triangles `faces` of a primitive, those that were cut as their pieces, whose corners are added to `group`; `own` are the
/// primitive's pieces, by index. `None` where they don't belong to `faces`.
fn cut<const N: usize>(
    primitive: usize,
    faces: &[[u32; 3]],
    scene_mesh: &Mesh,
    pieces: &Pieces<N>,
    mut own: Vec<usize>,
    group: &mut Shared<N>,
) -> Option<Part> {
    let origin = |piece: usize| &scene_mesh.origin[pieces.source(piece)];
    own.sort_by_key(|piece| origin(*piece).face);
    let mut part =
        Part { primitive, triangles: Vec::with_capacity(faces.len()), pieces: Vec::with_capacity(faces.len()) };
    let mut rest = own.as_slice();
    for (number, face) in faces.iter().enumerate() {
        let count = rest.iter().take_while(|piece| origin(**piece).face as usize == number).count();
        let (of_face, others) = rest.split_at(count);
        rest = others;
        if of_face.is_empty() {
            part.triangles.push(*face);
            part.pieces.push(None);
            group.corners.push(None);
        }
        for &piece in of_face {
            let corners = origin(piece).corners;
            let order = order(face, &corners)?;
            let vertices = pieces.face(piece, scene_mesh, corners, &mut group.vertices);
            part.triangles.push(order.map(|k| vertices[k]));
            part.pieces.push(Some(piece));
            group.corners.push(Some(order.map(|k| pieces.values[piece][k])));
        }
    }
    rest.is_empty().then_some(part)
}

/// Splits the vertices of one group and rewrites its primitives where that changed anything.
fn split_group<const N: usize>(doc: &mut Document, mesh: usize, group: Shared<N>) -> Result<Group<N>> {
    let Shared { key, vertices, parts, corners } = group;
    let triangles: Vec<[u32; 3]> = parts.iter().flat_map(|p| p.triangles.iter().copied()).collect();
    let split = split(vertices, &triangles, &corners);
    let mut rest = split.triangles.as_slice();
    let mut group = Group { values: split.values, parts };
    for part in &mut group.parts {
        let (own, others) = rest.split_at(part.triangles.len());
        part.triangles = own.to_vec();
        rest = others;
    }
    if split.changed {
        let mut vertices = Copies { doc, sources: &split.sources, copies: BTreeMap::new() };
        let attributes = vertices.copy_attributes(key.get("attributes").unwrap_or(&Value::Null))?;
        let targets = key
            .get("targets")
            .and_then(Value::as_array)
            .map(|targets| targets.iter().map(|t| vertices.copy_target(t)).collect::<Result<Vec<_>>>());
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

/// Copies of accessors for new vertices; each accessor is copied once for each way to blend it.
struct Copies<'a> {
    doc: &'a mut Document,
    sources: &'a Sources,
    copies: BTreeMap<(usize, Blending), usize>,
}

impl Copies<'_> {
    /// The attributes `attributes` (names to accessors), with copied accessors.
    fn copy_attributes(&mut self, attributes: &Value) -> Result<Value> {
        let attributes = self.named(attributes)?;
        let mut copied = if self.sources.are_given() {
            BTreeMap::new()
        } else {
            influences::write(self.doc, &attributes, self.sources)?
        };
        let copy = |(name, accessor): (String, usize)| {
            let copy = match copied.remove(&name) {
                Some(copy) => copy,
                None => self.copy(accessor, |elements| blending(&name, elements))?,
            };
            Ok((name, Value::from(copy)))
        };
        Ok(Value::Object(attributes.into_iter().map(copy).collect::<Result<_>>()?))
    }

    /// The same for a morph target: what it adds is blended, whatever it is added to.
    fn copy_target(&mut self, target: &Value) -> Result<Value> {
        let target = self.named(target)?;
        let copy = |(name, accessor)| Ok((name, Value::from(self.copy(accessor, |_| Blending::Linear)?)));
        Ok(Value::Object(target.into_iter().map(copy).collect::<Result<_>>()?))
    }

    /// Names and accessors of `attributes`.
    fn named(&self, attributes: &Value) -> Result<Vec<(String, usize)>> {
        let named = attributes.as_object().into_iter().flatten().map(|(name, value)| {
            let accessor = value.as_u64().and_then(|a| usize::try_from(a).ok());
            let accessor =
                accessor.ok_or_else(|| Error::invalid(&self.doc.place, format!("{name} names no accessor")))?;
            Ok((name.clone(), accessor))
        });
        named.collect()
    }

    fn copy(&mut self, accessor: usize, blending: impl Fn(&Elements) -> Blending) -> Result<usize> {
        let elements = accessor::read(self.doc, accessor)?;
        let blending = blending(&elements);
        if let Some(copy) = self.copies.get(&(accessor, blending)) {
            return Ok(*copy);
        }
        let elements = elements.gather(self.sources, blending).ok_or_else(|| {
            Error::invalid(&self.doc.place, format!("accessors[{accessor}] is too short; export the file again"))
        })?;
        let copy = elements.push(self.doc);
        self.copies.insert((accessor, blending), copy);
        Ok(copy)
    }
}

/// How attribute `name` is blended. Integers of an application's own that don't stand for fractions are taken for names of
/// things, as feature ids are (EXT_mesh_features).
fn blending(name: &str, elements: &Elements) -> Blending {
    let is_own = name.starts_with('_');
    match name {
        "NORMAL" | "TANGENT" => Blending::Direction,
        _ if name.starts_with("_FEATURE_ID_") || name.starts_with("JOINTS_") => Blending::Strongest,
        _ if is_own && !elements.is_float() && !elements.is_normalized() => Blending::Strongest,
        _ => Blending::Linear,
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

/// The pieces of a scene mesh's triangles by the primitive that these came from.
fn pieces_by_part<const N: usize>(mesh: &Mesh, pieces: &Pieces<N>) -> BTreeMap<usize, Vec<usize>> {
    let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for piece in 0..pieces.len() {
        parts.entry(mesh.origin[pieces.source(piece)].part as usize).or_default().push(piece);
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

/// Where the vertices of `face` stand among `corners`, those of the same triangle in any order.
fn order(face: &[u32; 3], corners: &[u32; 3]) -> Option<[usize; 3]> {
    let place = |v: u32| corners.iter().position(|c| *c == v);
    Some([place(face[0])?, place(face[1])?, place(face[2])?])
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
