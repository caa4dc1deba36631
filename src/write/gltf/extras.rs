//! The `extras.lumel` objects: what an engine needs to find a surface's light, and which lights are baked in.

use super::document::{Document, Object, index, number, numbers};
use super::scene::light;
use crate::color::Rgb;
use crate::error::Result;
use crate::load::Source;
use crate::load::gltf::role;
use crate::scene::clear_sky::elevation_azimuth;
use crate::scene::{BakeMode, Environment, LightShape, Scene};
use crate::unwrap::Placement;
use crate::write::encode::{Encoded, Encoding};
use crate::write::{Baked, BakedLights};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Name of the object inside `extras`.
const KEY: &str = "lumel";
const LIGHTS: &str = "KHR_lights_punctual";
const SKY: &str = "EXT_lights_image_based";
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
    lights(root).into_iter().flatten().filter_map(Value::as_object_mut).for_each(strip_node);
    let skies = root.get_mut("extensions").and_then(|e| e.get_mut(SKY)?.get_mut("lights")?.as_array_mut());
    skies.into_iter().flatten().filter_map(Value::as_object_mut).for_each(strip_node);
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
        if let Some(encodings) = encodings(baked) {
            lumel.insert("encodings".into(), encodings);
        }
        // What else the pages hold, such as the directions that light comes from.
        let layers: Vec<&str> = baked.lightmap.iter().flat_map(|l| &l.layers).map(|l| l.name.as_str()).collect();
        if !layers.is_empty() {
            lumel.insert("layers".into(), layers.into());
        }
        if let Some(scale) = vertex_scale {
            lumel.insert("vertexScale".into(), number(scale));
        }
        if let Some(sky) = missing_sky(baked) {
            lumel.insert("sky".into(), sky);
        }
        if let Some(sun) = missing_sun(baked) {
            lumel.insert("sun".into(), sun.into());
        }
        if let (Source::Usd(_), Some(_)) = (baked.source, baked.lightmap) {
            let missing: Vec<&str> = light::missing(baked.scene).collect();
            if !missing.is_empty() {
                lumel.insert("missingLights".into(), missing.into());
            }
        }
    }
}

/// The sky of the bake where the file has no form for it: its radiance [nit], or the name of one with a picture.
fn missing_sky(baked: &Baked) -> Option<Value> {
    let is_told = |sky: &Environment| matches!(baked.source, Source::Gltf(_)) && !sky.name.starts_with("--");
    let sky = baked.scene.environment.as_ref().filter(|sky| baked.lightmap.is_some() && !is_told(sky))?;
    if sky.is_constant() {
        let radiance: Rgb = sky.each().map(|sky| sky.radiance).sum();
        return Some(json!({ "name": sky.name, "radiance": numbers(&radiance.to_array()) }));
    }
    let names: Vec<&str> = sky.each().map(|sky| sky.name.as_str()).collect();
    Some(json!({ "name": names.join(", ") }))
}

/// The sun from the command line, as it was given there, where a glTF that is edited doesn't hold it.
fn missing_sun(baked: &Baked) -> Option<String> {
    let is_edited = matches!(baked.source, Source::Gltf(_)) && baked.lightmap.is_some();
    let sun = baked.scene.lights.iter().find(|light| is_edited && light.name == "--sun")?;
    let LightShape::Directional { direction, illuminance, .. } = sun.shape else { return None };
    let (elevation, azimuth) = elevation_azimuth(-direction);
    Some(format!("{elevation:.3},{azimuth:.3},{}", illuminance.max_element()))
}

/// The forms that pages were written in, unless OpenEXR is the only one: decoded texels times `scale` are the values.
fn encodings(baked: &Baked) -> Option<Value> {
    let is_plain = |forms: &[Encoded]| forms.iter().all(|f| f.encoding == Encoding::Exr);
    let form = |f: &Encoded| json!({ "name": f.encoding.name(), "scale": number(f.scale), "uris": f.uris });
    (!is_plain(baked.encoded)).then(|| baked.encoded.iter().map(form).collect::<Vec<_>>().into())
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

/// Marks or removes the lights of `scene` in its source, and its sky: what is wholly baked as `baked`, what is baked as indirect light
/// alone as `bake` and, in `realtime`, what an engine has to add. Dynamic lights stay as they are.
///
/// # Errors
/// `Invalid` where there is no such node.
pub fn write_lights(doc: &mut Document, scene: &Scene, lights: BakedLights) -> Result<()> {
    if lights == BakedLights::Keep {
        return Ok(());
    }
    // What several lights of a node, or several nodes of a light, don't agree on stays with the engine.
    let mut modes: BTreeMap<usize, BakeMode> = BTreeMap::new();
    let mut of_light: BTreeMap<usize, BakeMode> = BTreeMap::new();
    let keep = |known: &mut BakeMode, mode: BakeMode| *known = mode.max(*known);
    for light in &scene.lights {
        let (Some(node), mode) = (light.gltf_node, light.contribution.mode()) else { continue };
        keep(modes.entry(node).or_insert(mode), mode);
    }
    for (&node, &mode) in &modes {
        let light = doc.item("nodes", node)?.get("extensions").and_then(|e| e.get(LIGHTS)?.get("light")?.as_u64());
        if let Some(light) = light.and_then(|light| usize::try_from(light).ok()) {
            keep(of_light.entry(light).or_insert(mode), mode);
        }
    }
    for (node, mode) in modes {
        let node = doc.item_mut("nodes", node)?;
        if (mode, lights) != (BakeMode::Baked, BakedLights::Remove) {
            mark(node, mode);
        } else if let Some(extensions) = node.get_mut("extensions").and_then(Value::as_object_mut) {
            SHINING.iter().for_each(|name| drop(extensions.shift_remove(*name)));
            if extensions.is_empty() {
                node.shift_remove("extensions");
            }
        }
    }
    for (light, mode) in of_light {
        let light =
            self::lights(doc.root_mut()).and_then(|lights| lights.get_mut(light)).and_then(Value::as_object_mut);
        if let Some(light) = light.filter(|_| (mode, lights) != (BakeMode::Baked, BakedLights::Remove)) {
            mark(light, mode);
        }
    }
    write_sky(doc, scene, lights);
    for name in SHINING {
        let is_light = |node: &Value| node.get("extensions").is_some_and(|e| e.get(name).is_some());
        let nodes = doc.root().get("nodes").and_then(Value::as_array);
        if lights == BakedLights::Remove && !nodes.is_some_and(|nodes| nodes.iter().any(is_light)) {
            doc.drop_extension(name);
        }
    }
    Ok(())
}

/// Marks what shines with what of it is baked.
pub fn mark(object: &mut Object, mode: BakeMode) {
    match mode.left_to_engine() {
        None => drop(lumel(object).insert("baked".into(), true.into())),
        Some(_) if mode == BakeMode::Dynamic => {}
        Some(left) => {
            lumel(object).insert("bake".into(), mode.name().into());
            lumel(object).insert("realtime".into(), left.into());
        }
    }
}

/// Marks or removes the sky of the default scene, where it is the one that was baked and not one from the command line.
fn write_sky(doc: &mut Document, scene: &Scene, lights: BakedLights) {
    let Some(sky) = scene.environment.as_ref().filter(|sky| !sky.name.starts_with("--")) else { return };
    let mode = sky.contribution.mode();
    let shown = index(doc.root(), "scene").unwrap_or(0);
    let Some(scenes) = doc.root_mut().get_mut("scenes").and_then(Value::as_array_mut) else { return };
    let Some(extensions) = scenes.get_mut(shown).and_then(|s| s.get_mut("extensions")?.as_object_mut()) else { return };
    let Some(light) = extensions.get(SKY).and_then(|sky| sky.get("light")?.as_u64()) else { return };
    if (mode, lights) == (BakeMode::Baked, BakedLights::Remove) {
        extensions.shift_remove(SKY);
        if extensions.is_empty() {
            scenes[shown].as_object_mut().into_iter().for_each(|scene| drop(scene.shift_remove("extensions")));
        }
        if !scenes.iter().any(|scene| scene.get("extensions").is_some_and(|e| e.get(SKY).is_some())) {
            doc.drop_extension(SKY);
        }
        return;
    }
    let place = usize::try_from(light).unwrap_or(usize::MAX);
    let light = doc.root_mut().get_mut("extensions").and_then(|e| e.get_mut(SKY)?.get_mut("lights")?.get_mut(place));
    light.and_then(Value::as_object_mut).into_iter().for_each(|light| mark(light, mode));
}

/// The punctual lights of the document.
fn lights(root: &mut Object) -> Option<&mut Vec<Value>> {
    root.get_mut("extensions")?.get_mut(LIGHTS)?.get_mut("lights")?.as_array_mut()
}

/// The mesh of a node.
pub fn mesh_of(doc: &Document, node: usize) -> Result<Option<usize>> {
    Ok(index(doc.item("nodes", node)?, "mesh"))
}
