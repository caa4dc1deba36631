//! The vertex profile of a glTF source: baked vertex colours under unlit materials, a mesh for each node.

use super::accessor::{Elements, push_triangles};
use super::document::{Document, Object, index};
use super::primitive::{Group, material_indices, primitive_json, primitive_json_mut, set_group_attribute, split_mesh};
use super::radiance::{CornerValue, SurfaceLight};
use super::{extras, instances, nodes};
use crate::error::{Result, Warnings};
use crate::write::{Baked, VertexColors};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Name of the extension without lighting.
pub const UNLIT: &str = "KHR_materials_unlit";

/// Gives every node of `doc` that receives light a mesh with vertex colours of its own.
///
/// # Errors
/// `Invalid` where the document is broken, `Unsupported` where a mesh is compressed.
pub fn write(doc: &mut Document, baked: &Baked, lights: &[SurfaceLight], warnings: &mut Warnings) -> Result<()> {
    // Where instances share a node, the first one with light of its own speaks for all.
    let receives = |s: &usize| baked.scene.surfaces[*s].role.receives;
    let nodes: Vec<(usize, usize)> = nodes(baked.scene)
        .into_iter()
        .filter_map(|(node, surfaces)| Some((surfaces.into_iter().find(receives)?, node)))
        .collect();
    let mut users: BTreeMap<usize, usize> = BTreeMap::new();
    for node in 0..doc.count("nodes") {
        if let Some(mesh) = extras::mesh_of(doc, node)? {
            *users.entry(mesh).or_default() += 1;
        }
    }
    for (_, node) in &nodes {
        extras::mesh_of(doc, *node)?.and_then(|mesh| users.get_mut(&mesh)).into_iter().for_each(|n| *n -= 1);
    }
    // A mesh itself goes to its first node, unless nodes outside of the scene need it as it was.
    let mut originals: BTreeMap<usize, Value> = BTreeMap::new();
    let mut whites = BTreeMap::new();
    for (surface, node) in nodes {
        let Some(mesh) = extras::mesh_of(doc, node)? else { continue };
        if instances::are_in(doc, node)? {
            let message = "GPU instances share their vertices; all of them show the light of the first one";
            warnings.add(&baked.scene.surfaces[surface].name, message);
        }
        let first = !originals.contains_key(&mesh) && users.get(&mesh) == Some(&0);
        let original = Value::Object(doc.item("meshes", mesh)?.clone());
        let original = originals.entry(mesh).or_insert(original).clone();
        let target = if first { mesh } else { doc.push("meshes", original) };
        doc.item_mut("nodes", node)?.insert("mesh".into(), target.into());
        let scene_mesh = &baked.scene.meshes[baked.scene.surfaces[surface].mesh];
        let light = &lights[surface];
        for group in split_mesh(doc, target, scene_mesh, &light.pieces())? {
            write_colors(doc, target, &group, baked.vertex_colors)?;
            for part in &group.parts {
                // Triangles that the loader left out can't be seen; they go where no primitive has to be cut for them.
                let all = part.pieces.iter().flatten().all(|piece| light.whole[*piece]);
                let whole = |piece: &Option<usize>| piece.map_or(all, |piece| light.whole[piece]);
                let whole: Vec<bool> = part.pieces.iter().map(whole).collect();
                write_materials(doc, target, part.primitive, &part.triangles, &whole, group.values.len(), &mut whites)?;
            }
        }
    }
    Ok(())
}

/// `COLOR_0` in the form `form`, and `_IRRADIANCE`. Floats have alpha where there is any; integers have it always, as GPUs have no
/// formats of three of them, and attributes start at multiples of 4 bytes.
pub fn color_attributes(values: &[CornerValue], form: VertexColors) -> [(&'static str, Elements); 2] {
    let is_opaque = values.iter().all(|v| v[3] == 1.0 || v[..4] == [0.0; 4]);
    // What no triangle uses has no alpha of its own.
    let rgba = |v: &CornerValue| [v[0], v[1], v[2], if is_opaque { 1.0 } else { v[3] }];
    let colors = match form {
        VertexColors::U8 => Elements::normalized_u8(values.iter().map(rgba)),
        VertexColors::U16 => Elements::normalized_u16(values.iter().map(rgba)),
        VertexColors::Float if is_opaque => Elements::floats(values.iter().map(|v| [v[0], v[1], v[2]])),
        VertexColors::Float => Elements::floats(values.iter().map(|v| [v[0], v[1], v[2], v[3]])),
    };
    [("COLOR_0", colors), ("_IRRADIANCE", Elements::floats(values.iter().map(|v| [v[4], v[5], v[6]])))]
}

fn write_colors(doc: &mut Document, mesh: usize, group: &Group<7>, form: VertexColors) -> Result<()> {
    let attributes = color_attributes(&group.values, form);
    attributes.iter().try_for_each(|(name, elements)| set_group_attribute(doc, mesh, group, name, elements))
}

/// Makes the materials of a primitive unlit; its triangles marked in `whole` get a white one, in a primitive of their own
/// where they aren't all.
fn write_materials(
    doc: &mut Document,
    mesh: usize,
    primitive: usize,
    triangles: &[[u32; 3]],
    whole: &[bool],
    vertex_count: usize,
    whites: &mut BTreeMap<Option<usize>, usize>,
) -> Result<()> {
    let json = primitive_json(doc, mesh, primitive)?.clone();
    let material = index(&json, "material");
    if whole.iter().any(|w| *w) {
        let white = match whites.get(&material) {
            Some(white) => *white,
            None => {
                let white = white(material.map(|m| doc.item("materials", m)).transpose()?);
                let white = push_unlit(doc, white);
                whites.insert(material, white);
                white
            }
        };
        let mut shining = json.clone();
        shining.insert("material".into(), white.into());
        // Variants would bring back what the colour replaces.
        if let Some(extensions) = shining.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.shift_remove("KHR_materials_variants");
        }
        if whole.iter().all(|w| *w) {
            *primitive_json_mut(doc, mesh, primitive)? = shining;
            return Ok(());
        }
        let pick = |kept: bool| -> Vec<[u32; 3]> {
            triangles.iter().zip(whole).filter(|(_, w)| **w == kept).map(|(t, _)| *t).collect()
        };
        shining.insert("indices".into(), push_triangles(doc, &pick(true), vertex_count).into());
        shining.shift_remove("mode");
        let rest = push_triangles(doc, &pick(false), vertex_count);
        let json = primitive_json_mut(doc, mesh, primitive)?;
        json.insert("indices".into(), rest.into());
        json.shift_remove("mode");
        if let Some(primitives) = doc.item_mut("meshes", mesh)?.get_mut("primitives").and_then(Value::as_array_mut) {
            primitives.push(shining.into());
        }
    }
    for material in material_indices(&json) {
        make_unlit(doc.item_mut("materials", material)?);
        doc.use_extension(UNLIT);
    }
    if material.is_none() {
        let plain = match whites.get(&None) {
            Some(plain) => *plain,
            None => {
                let plain = push_unlit(doc, white(None));
                whites.insert(None, plain);
                plain
            }
        };
        primitive_json_mut(doc, mesh, primitive)?.insert("material".into(), plain.into());
    }
    Ok(())
}

fn push_unlit(doc: &mut Document, material: Value) -> usize {
    doc.use_extension(UNLIT);
    doc.push("materials", material)
}

/// A white, unlit material with the name, sides and opacity of `source`.
pub fn white(source: Option<&Object>) -> Value {
    let mut material = json!({});
    for key in ["name", "alphaMode", "alphaCutoff", "doubleSided", "extras"] {
        if let Some(value) = source.and_then(|s| s.get(key)) {
            material[key] = value.clone();
        }
    }
    let factor = source.and_then(|s| s.get("pbrMetallicRoughness")).and_then(|p| p.get("baseColorFactor"));
    let alpha = factor.and_then(|f| f.get(3)).cloned().unwrap_or(json!(1.0));
    material["pbrMetallicRoughness"] =
        json!({ "baseColorFactor": [1.0, 1.0, 1.0, alpha], "metallicFactor": 0.0, "roughnessFactor": 1.0 });
    material["extensions"] = json!({ UNLIT: {} });
    material
}

/// Adds the unlit extension; the diffuse colour of specular-glossiness materials becomes the base colour that it shows.
fn make_unlit(material: &mut Object) {
    let diffuse = material.get("extensions").and_then(|e| e.get("KHR_materials_pbrSpecularGlossiness")).cloned();
    if let Some(diffuse) = diffuse {
        let pbr = material.entry("pbrMetallicRoughness").or_insert_with(|| json!({}));
        for (from, to) in [("diffuseFactor", "baseColorFactor"), ("diffuseTexture", "baseColorTexture")] {
            if let (Some(value), Some(pbr)) = (diffuse.get(from), pbr.as_object_mut()) {
                pbr.insert(to.into(), value.clone());
            }
        }
    }
    let extensions = material.entry("extensions").or_insert_with(|| json!({}));
    if let Some(extensions) = extensions.as_object_mut() {
        // It must not stand beside the unlit one.
        extensions.shift_remove("KHR_materials_pbrSpecularGlossiness");
        extensions.entry(UNLIT).or_insert_with(|| json!({}));
    }
}
