//! Which extensions are read, which don't matter to a bake, and what happens to all others.

use crate::error::{Error, Result, Warnings};
use serde_json::Value;

/// Read by this loader.
const READ: &[&str] = &[
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Nothing that diffuse light depends on: metadata, animation, the shape of highlights.
const HARMLESS: &[&str] = &[
    "ADOBE_materials_thin_transparency",
    "AGI_articulations",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "KHR_animation_pointer",
    "KHR_interactivity",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_specular",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "NV_materials_mdl",
];

/// Compression of geometry, which can't be read.
const COMPRESSED: &[&str] = &["EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_meshopt_compression"];

/// Refuses a file that needs an extension which changes geometry and isn't read; names all others that aren't read.
///
/// # Errors
/// `Unsupported`, naming the extension.
pub(super) fn check(json: &Value, place: &str, warnings: &mut Warnings) -> Result<()> {
    let names = |key: &str| {
        let list = json.get(key).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(Value::as_str).collect::<Vec<_>>()
    };
    let known = |name: &str| READ.contains(&name) || HARMLESS.contains(&name);
    let required = names("extensionsRequired");
    for name in required.iter().copied().filter(|name| !known(name)) {
        if COMPRESSED.contains(&name) {
            let message =
                format!("the geometry is compressed with {name}, which can't be read; export it uncompressed");
            return Err(Error::unsupported(place, message));
        }
        if touches_geometry(json, name) {
            let message = format!("requires {name}, which changes geometry and isn't read; export without it");
            return Err(Error::unsupported(place, message));
        }
    }
    let mut used = names("extensionsUsed");
    used.extend(required);
    used.sort_unstable();
    used.dedup();
    for name in used.into_iter().filter(|name| !known(name)) {
        let message = if COMPRESSED.contains(&name) {
            format!("{name} is not read; the uncompressed copy of the geometry was used")
        } else {
            format!("the extension {name} is not read; the scene was baked without it")
        };
        warnings.add(place, message);
    }
    Ok(())
}

/// True where an object that makes up geometry carries the extension `name`.
fn touches_geometry(json: &Value, name: &str) -> bool {
    let extends = |item: &Value| item.get("extensions").is_some_and(|e| e.get(name).is_some());
    let any = |section: &str, test: &dyn Fn(&Value) -> bool| {
        json.get(section).and_then(Value::as_array).is_some_and(|items| items.iter().any(test))
    };
    let primitives =
        |mesh: &Value| mesh.get("primitives").and_then(Value::as_array).is_some_and(|list| list.iter().any(extends));
    ["nodes", "meshes", "accessors", "bufferViews", "buffers"].iter().any(|section| any(section, &extends))
        || any("meshes", &primitives)
}
