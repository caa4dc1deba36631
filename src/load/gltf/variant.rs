//! KHR_materials_variants: the materials of the chosen variants become the primitives' own.

use crate::error::{Error, Result};
use serde_json::Value;

const EXTENSION: &str = "KHR_materials_variants";

/// Puts the materials of the variants `names` in the place of the default ones; of several for one primitive, the one
/// named last. The extension stays, so that the other variants can still be chosen in what is written.
///
/// # Errors
/// `Invalid` naming the variants that exist where one of `names` doesn't.
pub(super) fn choose(json: &mut Value, names: &[String], place: &str) -> Result<()> {
    if names.is_empty() {
        return Ok(());
    }
    let list = json.pointer(&format!("/extensions/{EXTENSION}/variants")).and_then(Value::as_array);
    let there: Vec<String> = list
        .into_iter()
        .flatten()
        .map(|v| v.get("name").and_then(Value::as_str).unwrap_or_default().to_owned())
        .collect();
    for name in names {
        let Some(index) = there.iter().position(|n| n == name) else {
            let there: Vec<String> = there.iter().map(|n| format!("\"{n}\"")).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            return Err(Error::invalid(place, format!("has no variant \"{name}\"; there is: {there}")));
        };
        let meshes = json.get_mut("meshes").and_then(Value::as_array_mut);
        let primitives = meshes.into_iter().flatten().filter_map(|m| m.get_mut("primitives")?.as_array_mut());
        for primitive in primitives.flatten() {
            let mappings = primitive.get("extensions").and_then(|e| e.get(EXTENSION)?.get("mappings")?.as_array());
            let is_in = |mapping: &&Value| {
                let variants = mapping.get("variants").and_then(Value::as_array);
                variants.is_some_and(|v| v.iter().any(|v| v.as_u64() == u64::try_from(index).ok()))
            };
            let material = mappings.and_then(|m| m.iter().find(is_in)?.get("material")).cloned();
            if let (Some(material), Some(primitive)) = (material, primitive.as_object_mut()) {
                primitive.insert("material".to_owned(), material);
            }
        }
    }
    Ok(())
}
