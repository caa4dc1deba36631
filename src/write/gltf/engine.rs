//! The engine profile of a glTF source: lightmap UVs for each mesh, a rectangle for each node, all else as it was.

use super::accessor::Elements;
use super::document::{Document, Object, index};
use super::primitive::{Group, material_indices, primitive_json, set_attribute, split_mesh};
use super::{extras, instances, nodes};
use crate::error::{Result, Warnings};
use crate::scene::Mesh;
use crate::write::Baked;
use crate::write::pieces::Pieces;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// The surfaces and the node of each use of a mesh of the document as a mesh of the scene.
type Uses = BTreeMap<(usize, usize), Vec<(Vec<usize>, usize)>>;

/// Adds lightmap UVs and rectangles to `doc`.
///
/// # Errors
/// `Invalid` where the document is broken, `Unsupported` where a mesh is compressed.
pub fn write(doc: &mut Document, baked: &Baked, warnings: &mut Warnings) -> Result<()> {
    // A node's mesh, and the scene mesh that was loaded from it, to its surfaces. Meshes that were loaded more than once
    // (in different poses) become as many.
    let mut uses = Uses::new();
    for (node, surfaces) in nodes(baked.scene) {
        if let Some(mesh) = extras::mesh_of(doc, node)? {
            uses.entry((mesh, baked.scene.surfaces[surfaces[0]].mesh)).or_default().push((surfaces, node));
        }
    }
    let mut last = None;
    let mut original = Value::Null;
    for ((mesh, scene_mesh), placed) in uses {
        let target = if last == Some(mesh) {
            doc.push("meshes", original.clone())
        } else {
            original = Value::Object(doc.item("meshes", mesh)?.clone());
            last = Some(mesh);
            mesh
        };
        let is_shown = |surfaces: &[usize]| surfaces.iter().any(|s| baked.atlas.is_shown(*s));
        let tex_coord = match placed.iter().any(|(surfaces, _)| is_shown(surfaces)) {
            true => write_mesh(doc, baked, target, scene_mesh, warnings)?,
            false => 0,
        };
        for (surfaces, node) in placed {
            doc.item_mut("nodes", node)?.insert("mesh".into(), target.into());
            if !is_shown(&surfaces) {
                continue;
            }
            if instances::are_in(doc, node)? {
                instances::write_placements(doc, node, baked, &surfaces, tex_coord)?;
            } else {
                extras::write_placement(doc, node, &baked.atlas.placements[surfaces[0]], tex_coord)?;
            }
        }
    }
    Ok(())
}

/// Gives a mesh its lightmap UVs; returns the number of their set.
fn write_mesh(
    doc: &mut Document,
    baked: &Baked,
    mesh: usize,
    scene_mesh: usize,
    warnings: &mut Warnings,
) -> Result<usize> {
    let uvs = &baked.atlas.meshes[scene_mesh];
    if let Some(set) = uvs.authored.as_deref().and_then(set_number) {
        return Ok(set);
    }
    let loaded = &baked.scene.meshes[scene_mesh];
    let set = free_set(doc, mesh, loaded)?;
    if set != 1 {
        let message = format!("TEXCOORD_1 is used by a texture; the lightmap UVs are TEXCOORD_{set}");
        warnings.add(&loaded.name, message);
    }
    let name = format!("TEXCOORD_{set}");
    if loaded.uv_set(&name).is_some() {
        warnings.add(&loaded.name, format!("{name}, which no texture reads, was replaced by the lightmap UVs"));
    }
    let corners: Vec<[[f32; 2]; 3]> = uvs.corners.iter().map(|c| c.map(|uv| uv.to_array())).collect();
    for group in split_mesh(doc, mesh, loaded, &Pieces::whole(&corners))? {
        write_uvs(doc, mesh, &group, set)?;
    }
    Ok(set)
}

/// Sets `TEXCOORD_<set>` of a group. Sets must be numbered without a gap, so it stands in for those below that are missing
/// (or in which an earlier bake's did).
fn write_uvs(doc: &mut Document, mesh: usize, group: &Group<2>, set: usize) -> Result<()> {
    let accessor = Elements::floats(group.values.iter().copied()).push(doc);
    for part in &group.parts {
        let primitive = primitive_json(doc, mesh, part.primitive)?;
        let current = |n: usize| primitive.get("attributes").and_then(|a| a.get(format!("TEXCOORD_{n}")));
        let stands_in = |n: usize| match current(n) {
            None => true,
            there => there == current(set) && !is_read(doc, primitive, n),
        };
        for n in (0..set).filter(|n| stands_in(*n)).chain([set]).collect::<Vec<_>>() {
            set_attribute(doc, mesh, part.primitive, &format!("TEXCOORD_{n}"), accessor)?;
        }
    }
    Ok(())
}

/// The first set from 1 on that no primitive has, or has without a texture that reads it (lightmap UVs of an earlier bake).
fn free_set(doc: &Document, mesh: usize, loaded: &Mesh) -> Result<usize> {
    let primitives: BTreeSet<usize> = loaded.origin.iter().map(|origin| origin.part as usize).collect();
    let mut set = 1;
    loop {
        let mut taken = false;
        for &primitive in &primitives {
            let primitive = primitive_json(doc, mesh, primitive)?;
            let there = primitive.get("attributes").is_some_and(|a| a.get(format!("TEXCOORD_{set}")).is_some());
            taken |= there && is_read(doc, primitive, set);
        }
        if !taken {
            return Ok(set);
        }
        set += 1;
    }
}

/// True where a texture of a primitive's materials is read through set `set`.
pub fn is_read(doc: &Document, primitive: &Object, set: usize) -> bool {
    fn reads(value: &Value, set: usize) -> bool {
        match value {
            Value::Object(object) => {
                // A textureInfo without a set means 0; a texture transform without one leaves it.
                let own = index(object, "texCoord").or(object.contains_key("index").then_some(0));
                own == Some(set) || object.iter().any(|(key, value)| key != "extras" && reads(value, set))
            }
            Value::Array(items) => items.iter().any(|v| reads(v, set)),
            _ => false,
        }
    }
    let materials = doc.root().get("materials");
    material_indices(primitive).into_iter().filter_map(|m| materials?.get(m)).any(|material| reads(material, set))
}

/// `1` of `TEXCOORD_1`.
fn set_number(name: &str) -> Option<usize> {
    name.strip_prefix("TEXCOORD_")?.parse().ok()
}
