//! KHR_lights_punctual: point and spot lights in candela, directional ones in lux.

use super::document::Document;
use super::node::PlacedNode;
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::scene::{Light, LightShape};
use ::gltf::json::extensions::scene::khr_lights_punctual as punctual;
use ::gltf::json::validation::Checked;
use glam::DVec3;
use std::f32::consts::FRAC_PI_2;

/// The lights of the placed nodes. Lights shine along -Z of their node; its scale doesn't change their strength.
///
/// # Errors
/// `Invalid` where a node names a light that isn't there, or the light is malformed.
pub(super) fn lights(document: &Document, nodes: &[PlacedNode], warnings: &mut Warnings) -> Result<Vec<Light>> {
    let mut lights = Vec::new();
    for node in nodes {
        let Some(index) = node.light else { continue };
        let list = document.json.pointer("/extensions/KHR_lights_punctual/lights");
        let light = list.and_then(|l| l.get(index)).ok_or_else(|| {
            let message = format!("names light {index}, which isn't there; export the file again");
            Error::invalid(document.place("nodes", node.index), message)
        })?;
        let light: punctual::Light = document.parse(light, "nodes", node.index)?;
        if let Some(shape) = shape(&light, node, warnings) {
            let light = Light::new(&node.name, shape);
            let world_from_light = super::profile::axes(node).unwrap_or(light.world_from_light);
            lights.push(Light { world_from_light, gltf_node: Some(node.index), ..light });
        }
    }
    Ok(lights)
}

/// The light in world space; `None`, with a warning, where it can't shine.
fn shape(light: &punctual::Light, node: &PlacedNode, warnings: &mut Warnings) -> Option<LightShape> {
    let strength = Rgb::from_array(light.color).max(Rgb::ZERO) * light.intensity;
    if !strength.is_finite() || strength.max_element() <= 0.0 {
        warnings.add(&node.name, "the light has no positive, finite intensity and was left out");
        return None;
    }
    let position = node.world_from_local.translation.as_vec3();
    let direction = node.world_from_local.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
    if !position.is_finite() || !direction.is_normalized() {
        warnings.add(&node.name, "the light's transform is not invertible; the light was left out");
        return None;
    }
    let range = light.range.filter(|r| r.is_finite() && *r > 0.0);
    match light.type_ {
        Checked::Valid(punctual::Type::Point) => Some(LightShape::Point { position, intensity: strength, range }),
        Checked::Valid(punctual::Type::Directional) => {
            Some(LightShape::Directional { direction, illuminance: strength, angle: 0.0 })
        }
        Checked::Valid(punctual::Type::Spot) => {
            // A missing outer angle is pi/4 by the specification.
            let (inner, outer) =
                light.spot.as_ref().map_or((0.0, FRAC_PI_2 / 2.0), |s| (s.inner_cone_angle, s.outer_cone_angle));
            let outer_valid = outer.clamp(0.0, FRAC_PI_2);
            let inner_valid = inner.clamp(0.0, outer_valid);
            if (inner_valid, outer_valid) != (inner, outer) {
                let message = "spot angles must obey 0 <= inner <= outer <= pi/2; they were clamped";
                warnings.add(&node.name, message);
            }
            let (inner, outer) = (inner_valid, outer_valid);
            Some(LightShape::Spot { position, direction, intensity: strength, inner, outer, range })
        }
        Checked::Invalid => {
            warnings.add(&node.name, "the light is of an unknown type and was left out");
            None
        }
    }
}
