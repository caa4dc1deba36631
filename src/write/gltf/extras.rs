//! The `extras.lumel` objects: what an engine needs to find a surface's light, and which lights are baked in.

use super::document::{Document, Object, index, number, numbers};
use crate::error::Result;
use crate::load::gltf::role;
use crate::unwrap::Placement;
use crate::write::{Baked, BakedLights};
use serde_json::{Value, json};

/// Name of the object inside `extras`.
const KEY: &str = "lumel";
const LIGHTS: &str = "KHR_lights_punctual";
/// Extensions by which a node shines.
const SHINING: [&str; 3] = [LIGHTS, "EXT_lights_area", "EXT_lights_ies"];

/// The `extras.lumel` of `object`, made where it is missing. Extras that are no object move to `extras.original`.
pub fn lumel(object: &mut Object) -> &mut Object {
    let extras = object.entry("extras").or_insert_with(|| json!({}));
    if !extras.is_object() {
        *extras = json!({ "original": extras.take() });
    }
    let lumel = &mut extras[KEY];
    if !lumel.is_object() {
        *lumel = json!({});
    }
    lumel.as_object_mut().expect("just made an object")
}

/// Takes the extras of an earlier bake out of the document; what nodes say of their roles stays.
pub fn strip(doc: &mut Document) {
    fn strip_node(object: &mut Object) {
        let lumel = object.get_mut("extras").and_then(|e| e.get_mut(KEY)).and_then(Value::as_object_mut);
        let Some(lumel) = lumel else { return strip_object(object) };
        role::WRITTEN.iter().for_each(|key| drop(lumel.shift_remove(*key)));
        if lumel.is_empty() {
            strip_object(object);
        }
    }
    fn strip_object(object: &mut Object) {
        let Some(extras) = object.get_mut("extras").and_then(Value::as_object_mut) else { return };
        if extras.shift_remove(KEY).is_some() && extras.is_empty() {
            object.shift_remove("extras");
        }
    }
    let root = doc.root_mut();
    root.get_mut("asset").and_then(Value::as_object_mut).into_iter().for_each(strip_object);
    let nodes = root.get_mut("nodes").and_then(Value::as_array_mut);
    nodes.into_iter().flatten().filter_map(Value::as_object_mut).for_each(strip_node);
    lights(root).into_iter().flatten().filter_map(Value::as_object_mut).for_each(strip_object);
}

/// Writes what the whole bake holds into `asset.extras.lumel`; `vertex_scale` where there are baked vertex colours.
pub fn write_asset(doc: &mut Document, baked: &Baked, vertex_scale: Option<f32>) {
    let quantity = baked.quantity;
    let pages: Vec<Value> = baked
        .page_uris
        .iter()
        .zip(&baked.atlas.pages)
        .map(|(uri, [width, height])| json!({ "uri": uri, "width": width, "height": height }))
        .collect();
    if let Some(asset) = doc.root_mut().get_mut("asset").and_then(Value::as_object_mut) {
        let lumel = lumel(asset);
        lumel.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        lumel.insert("quantity".into(), quantity.name().into());
        lumel.insert("unit".into(), quantity.unit().into());
        lumel.insert("pages".into(), pages.into());
        // What else the pages hold, such as the directions that light comes from.
        let layers: Vec<&str> = baked.lightmap.iter().flat_map(|l| &l.layers).map(|l| l.name.as_str()).collect();
        if !layers.is_empty() {
            lumel.insert("layers".into(), layers.into());
        }
        if let Some(scale) = vertex_scale {
            lumel.insert("vertexScale".into(), number(scale));
        }
    }
}

/// Writes a surface's rectangle into its node.
///
/// # Errors
/// `Invalid` where there is no such node.
pub fn write_placement(doc: &mut Document, node: usize, placement: &Placement, tex_coord: usize) -> Result<()> {
    let lumel = lumel(doc.item_mut("nodes", node)?);
    lumel.insert("page".into(), placement.page.into());
    lumel.insert("texCoord".into(), tex_coord.into());
    lumel.insert("scale".into(), numbers(&placement.scale.to_array()));
    lumel.insert("offset".into(), numbers(&placement.offset.to_array()));
    Ok(())
}

/// Marks or removes the lights whose nodes are `nodes`.
///
/// # Errors
/// `Invalid` where there is no such node.
pub fn write_lights(doc: &mut Document, nodes: impl Iterator<Item = usize>, mode: BakedLights) -> Result<()> {
    for node in nodes {
        let node = doc.item_mut("nodes", node)?;
        match mode {
            BakedLights::Keep => {}
            BakedLights::Mark => {
                let light = node.get("extensions").and_then(|e| e.get(LIGHTS)).and_then(|l| l.get("light"));
                let light = light.and_then(Value::as_u64);
                lumel(node).insert("baked".into(), true.into());
                let light = light.and_then(|i| lights(doc.root_mut())?.get_mut(usize::try_from(i).ok()?));
                if let Some(light) = light.and_then(Value::as_object_mut) {
                    lumel(light).insert("baked".into(), true.into());
                }
            }
            BakedLights::Remove => {
                if let Some(extensions) = node.get_mut("extensions").and_then(Value::as_object_mut) {
                    SHINING.iter().for_each(|name| drop(extensions.shift_remove(*name)));
                    if extensions.is_empty() {
                        node.shift_remove("extensions");
                    }
                }
            }
        }
    }
    for name in SHINING {
        let is_light = |node: &Value| node.get("extensions").is_some_and(|e| e.get(name).is_some());
        let nodes = doc.root().get("nodes").and_then(Value::as_array);
        if mode == BakedLights::Remove && !nodes.is_some_and(|nodes| nodes.iter().any(is_light)) {
            doc.drop_extension(name);
        }
    }
    Ok(())
}

/// The punctual lights of the document.
fn lights(root: &mut Object) -> Option<&mut Vec<Value>> {
    root.get_mut("extensions")?.get_mut(LIGHTS)?.get_mut("lights")?.as_array_mut()
}

/// The mesh of a node.
pub fn mesh_of(doc: &Document, node: usize) -> Result<Option<usize>> {
    Ok(index(doc.item("nodes", node)?, "mesh"))
}
