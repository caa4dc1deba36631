//! Which extensions are read, which don't matter to a bake, and what happens to all others.
//!
//! | extension | what is done with it |
//! |---|---|
//! | EXT_lights_area | rectangles and disks that shine, in nit |
//! | EXT_lights_ies | points that shine as their profile says |
//! | EXT_lights_image_based | the sky: the sharpest cube map, or the irradiance coefficients where it can't be read |
//! | EXT_mesh_gpu_instancing | each instance is a surface of its own |
//! | EXT_meshopt_compression, KHR_meshopt_compression | decoded |
//! | EXT_texture_webp | decoded |
//! | KHR_draco_mesh_compression | refused, unless the file has an uncompressed copy |
//! | KHR_lights_punctual | point, spot and directional lights, range included |
//! | KHR_materials_clearcoat, _specular, _ior | no effect on radiosity: highlights and coats; what they take from the diffuse light beneath (some 4 %) is left to it. Methods that follow rays see them (`appearance`) |
//! | KHR_materials_iridescence, _anisotropy, _sheen, _dispersion | no effect |
//! | KHR_materials_diffuse_transmission | leaves the albedo and joins what passes; straight on, not spread |
//! | KHR_materials_emissive_strength | a factor on the emission, which is then in nit |
//! | KHR_materials_pbrSpecularGlossiness | diffuse colour and texture in place of the base colour |
//! | KHR_materials_transmission | leaves the albedo for what passes, tinted by the base colour; thin: no refraction |
//! | KHR_materials_unlit | the base colour as a diffuse albedo |
//! | KHR_materials_variants | the materials of the variants that are asked for |
//! | KHR_materials_volume | tints what passes by the attenuation over `thicknessFactor` |
//! | KHR_mesh_quantization | read, in morph targets too |
//! | KHR_node_visibility | hidden nodes are left out, and named |
//! | KHR_texture_basisu | not decoded: the ordinary picture beside it is used, else the factor alone |
//! | KHR_texture_transform | read |
//! | KHR_animation_pointer | its channels are skipped, and named |
//!
//! Of all others, a required one that sits on geometry refuses the file; the rest are named in a warning.

use crate::error::{Error, Result, Warnings};
use serde_json::Value;

/// Read by this loader.
const READ: &[&str] = &[
    "EXT_lights_area",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Not read, but said where it is met: by the node, texture or channel that has it.
const NAMED_WHERE_MET: &[&str] = &["KHR_animation_pointer", "KHR_texture_basisu"];

/// Nothing that diffuse light depends on: metadata, interaction, the shape of highlights.
const HARMLESS: &[&str] = &[
    "ADOBE_materials_thin_transparency",
    "AGI_articulations",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "KHR_interactivity",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "NV_materials_mdl",
];

/// Compression of geometry, which can't be read.
///
/// Of the crates that decode it, draco_decoder builds Google's C++ by CMake, and draco-oxide is an alpha with unsafe code.
const DRACO: &str = "KHR_draco_mesh_compression";
pub(super) const DRACO_MESSAGE: &str = "the geometry is compressed with KHR_draco_mesh_compression, which can't be read; decode \
    it first (gltf-transform copy, or the exporter without compression), or compress it with EXT_meshopt_compression";

/// Refuses a file that needs an extension which changes geometry and isn't read; names all others that aren't read.
///
/// # Errors
/// `Unsupported`, naming the extension.
pub(super) fn check(json: &Value, place: &str, warnings: &mut Warnings) -> Result<()> {
    let names = |key: &str| {
        let list = json.get(key).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(Value::as_str).collect::<Vec<_>>()
    };
    let known = |name: &str| [READ, NAMED_WHERE_MET, HARMLESS].iter().any(|list| list.contains(&name));
    let required = names("extensionsRequired");
    for name in required.iter().copied().filter(|name| !known(name)) {
        if name == DRACO {
            return Err(Error::unsupported(place, DRACO_MESSAGE));
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
        let message = if name == DRACO {
            format!("{name} is not read; the uncompressed copy of the geometry was used")
        } else {
            format!("the extension {name} is not read; the scene was baked without it")
        };
        warnings.add(place, message);
    }
    Ok(())
}

/// Takes Draco's streams out of primitives that have an uncompressed copy as well.
pub(super) fn forget_draco_copies(json: &mut Value) {
    let required = json.get("extensionsRequired").and_then(Value::as_array);
    let used = json.get("extensionsUsed").and_then(Value::as_array);
    let names_it = |list: Option<&Vec<Value>>| list.is_some_and(|l| l.iter().any(|n| n.as_str() == Some(DRACO)));
    if names_it(required) || !names_it(used) {
        return;
    }
    let backed: Vec<bool> = json
        .get("accessors")
        .and_then(Value::as_array)
        .map_or_else(Vec::new, |accessors| accessors.iter().map(|a| a.get("bufferView").is_some()).collect());
    let meshes = json.get_mut("meshes").and_then(Value::as_array_mut);
    let primitives = meshes.into_iter().flatten().filter_map(|m| m.get_mut("primitives")?.as_array_mut()).flatten();
    let mut left = false;
    for primitive in primitives.filter_map(Value::as_object_mut) {
        let position = primitive.get("attributes").and_then(|a| a.get("POSITION")?.as_u64());
        let has_copy = position.and_then(|p| backed.get(usize::try_from(p).ok()?)).is_some_and(|b| *b);
        let Some(extensions) = primitive.get_mut("extensions").and_then(Value::as_object_mut) else { continue };
        if has_copy {
            extensions.shift_remove(DRACO);
        }
        left |= extensions.contains_key(DRACO);
        if extensions.is_empty() {
            primitive.shift_remove("extensions");
        }
    }
    if !left {
        forget(json, &[DRACO]);
    }
}

/// Takes `names` out of the lists of used and required extensions.
pub(super) fn forget(json: &mut Value, names: &[&str]) {
    let Some(root) = json.as_object_mut() else { return };
    for key in ["extensionsUsed", "extensionsRequired"] {
        let Some(list) = root.get_mut(key).and_then(Value::as_array_mut) else { continue };
        list.retain(|name| !name.as_str().is_some_and(|name| names.contains(&name)));
        if list.is_empty() {
            root.shift_remove(key);
        }
    }
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
