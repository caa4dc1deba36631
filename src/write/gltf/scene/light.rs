//! Lights of the scene as KHR_lights_punctual, where that has a form for them.

use super::super::document::{Document, number, numbers};
use super::super::extras;
use super::mesh::array;
use crate::color::Rgb;
use crate::error::{Result, Warnings};
use crate::scene::{BakeMode, Light, LightShape, Scene};
use crate::write::{Baked, BakedLights};
use glam::{Quat, Vec3};
use serde_json::{Value, json};

const EXTENSION: &str = "KHR_lights_punctual";

/// Writes a node for each light that can be expressed; returns the nodes. Others are named in a warning.
///
/// # Errors
/// None but broken documents.
pub fn write(doc: &mut Document, baked: &Baked, warnings: &mut Warnings) -> Result<Vec<usize>> {
    let mut nodes = Vec::new();
    let mut lights = Vec::new();
    for light in &baked.scene.lights {
        let mode = light.contribution.mode();
        if (mode, baked.lights) == (BakeMode::Baked, BakedLights::Remove) {
            continue;
        }
        let Some((mut json, mut node)) = punctual(light) else {
            let message = match mode {
                BakeMode::Baked => {
                    "a light of this shape can't be expressed in the GLB; its light is in the lightmap alone"
                }
                _ => "a light of this shape can't be expressed in the GLB, and not all of its light is in the lightmap",
            };
            warnings.add(&light.name, message);
            continue;
        };
        json["name"] = light.name.as_str().into();
        node["name"] = light.name.as_str().into();
        node["extensions"] = json!({ EXTENSION: { "light": lights.len() } });
        if baked.lights != BakedLights::Keep
            && let (Some(json), Some(node)) = (json.as_object_mut(), node.as_object_mut())
        {
            extras::mark(json, mode);
            extras::mark(node, mode);
        }
        lights.push(json);
        nodes.push(doc.push("nodes", node));
    }
    if !lights.is_empty() {
        doc.use_extension(EXTENSION);
        doc.root_mut().insert("extensions".into(), json!({ EXTENSION: { "lights": lights } }));
    }
    Ok(nodes)
}

/// Names of the lights of `scene` that can't be expressed.
pub fn missing(scene: &Scene) -> impl Iterator<Item = &str> {
    scene.lights.iter().filter(|light| punctual(light).is_none()).map(|light| light.name.as_str())
}

/// The light and its node.
fn punctual(light: &Light) -> Option<(Value, Value)> {
    if !light.is_plain() {
        return None;
    }
    let (mut json, strength, range, position, direction) = match light.shape {
        LightShape::Point { position, intensity, range } => {
            (json!({ "type": "point" }), intensity, range, Some(position), None)
        }
        LightShape::Spot { position, direction, intensity, inner, outer, range } => {
            // The format wants inner < outer <= pi / 2.
            let outer = outer.clamp(1e-4, std::f32::consts::FRAC_PI_2);
            let inner = inner.clamp(0.0, outer * 0.9999);
            let cone = json!({ "innerConeAngle": number(inner), "outerConeAngle": number(outer) });
            (json!({ "type": "spot", "spot": cone }), intensity, range, Some(position), Some(direction))
        }
        LightShape::Directional { direction, illuminance, .. } => {
            (json!({ "type": "directional" }), illuminance, None, None, Some(direction))
        }
        _ => return None,
    };
    let intensity = strength.max_element();
    let color = if intensity > 0.0 { (strength / intensity).clamp(Rgb::ZERO, Rgb::ONE) } else { Rgb::ONE };
    json["color"] = array(color.to_array());
    json["intensity"] = number(intensity.max(0.0));
    if let Some(range) = range.filter(|r| *r > 0.0) {
        json["range"] = number(range);
    }
    let mut node = json!({});
    if let Some(position) = position.filter(|p| *p != Vec3::ZERO) {
        node["translation"] = numbers(&position.to_array());
    }
    if let Some(direction) = direction.and_then(Vec3::try_normalize) {
        let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, direction).normalize();
        if rotation != Quat::IDENTITY {
            node["rotation"] = numbers(&rotation.to_array());
        }
    }
    Some((json, node))
}
