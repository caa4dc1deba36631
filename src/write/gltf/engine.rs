//! The engine profile of a glTF source: lightmap UVs for each mesh, a rectangle for each node, all else as it was.

use super::accessor::Elements;
use super::document::Document;
use super::primitive::{Group, material_indices, primitive_json, set_attribute, split_mesh, triangles_by_part};
use super::{extras, nodes};
use crate::error::{Result, Warnings};
use crate::scene::Mesh;
use crate::write::Baked;
use serde_json::Value;
use std::collections::BTreeMap;

/// Adds lightmap UVs and rectangles to `doc`.
///
/// # Errors
/// `Invalid` where the document is broken, `Unsupported` where a mesh is compressed.
pub fn write(doc: &mut Document, baked: &Baked, warnings: &mut Warnings) -> Result<()> {
    // A node's mesh, and the scene mesh that was loaded from it, to its surfaces. Meshes that were loaded more than once
    // (in different poses) become as many.
    let mut uses: BTreeMap<(usize, usize), Vec<(usize, usize)>> = BTreeMap::new();
    for (surface, node) in nodes(baked.scene, warnings) {
        if let Some(mesh) = extras::mesh_of(doc, node)? {
            uses.entry((mesh, baked.scene.surfaces[surface].mesh)).or_default().push((surface, node));
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
        let tex_coord = write_mesh(doc, baked, target, scene_mesh, warnings)?;
        for (surface, node) in placed {
            doc.item_mut("nodes", node)?.insert("mesh".into(), target.into());
            extras::write_placement(doc, node, &baked.atlas.placements[surface], tex_coord)?;
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
    let corners: Vec<[[f32; 2]; 3]> = uvs.corners.iter().map(|c| c.map(|uv| uv.to_array())).collect();
    for group in split_mesh(doc, mesh, loaded, &corners)? {
        write_uvs(doc, mesh, &group, set)?;
    }
    Ok(set)
}

/// Sets `TEXCOORD_<set>` of a group, and the sets below it that are missing: they must be numbered without a gap.
fn write_uvs(doc: &mut Document, mesh: usize, group: &Group<2>, set: usize) -> Result<()> {
    let accessor = Elements::floats(group.values.iter().copied()).push(doc);
    for part in &group.parts {
        for n in 0..=set {
            let name = format!("TEXCOORD_{n}");
            let there = primitive_json(doc, mesh, part.primitive)?.get("attributes").is_some_and(|a| a.get(&name).is_some());
            if n == set || !there {
                set_attribute(doc, mesh, part.primitive, &name, accessor)?;
            }
        }
    }
    Ok(())
}

/// The first set from 1 on that no primitive has, or has without a texture that reads it (lightmap UVs of an earlier bake).
fn free_set(doc: &Document, mesh: usize, loaded: &Mesh) -> Result<usize> {
    let mut set = 1;
    loop {
        let mut taken = false;
        for primitive in triangles_by_part(loaded).into_keys() {
            let primitive = primitive_json(doc, mesh, primitive)?;
            let there = primitive.get("attributes").is_some_and(|a| a.get(format!("TEXCOORD_{set}")).is_some());
            let materials = material_indices(primitive).into_iter().filter_map(|m| doc.root().get("materials")?.get(m));
            taken |= there && materials.into_iter().any(|material| reads_set(material, set));
        }
        if !taken {
            return Ok(set);
        }
        set += 1;
    }
}

/// True where a texture of `material` is read through set `set`.
fn reads_set(material: &Value, set: usize) -> bool {
    match material {
        Value::Object(object) => object.iter().any(|(key, value)| {
            let own = key == "texCoord" && value.as_u64() == Some(set as u64);
            own || (key != "extras" && reads_set(value, set))
        }),
        Value::Array(items) => items.iter().any(|v| reads_set(v, set)),
        _ => false,
    }
}

/// `1` of `TEXCOORD_1`.
fn set_number(name: &str) -> Option<usize> {
    name.strip_prefix("TEXCOORD_")?.parse().ok()
}
