//! KHR_lights_punctual: point and spot lights in candela, directional ones in lux. EXT_lights_area (draft): rectangles and
//! disks in nit.

use super::contribution;
use super::document::Document;
use super::node::PlacedNode;
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::scene::{Contribution, Light, LightShape};
use ::gltf::json::extensions::scene::khr_lights_punctual as punctual;
use ::gltf::json::validation::Checked;
use glam::DVec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::f32::consts::FRAC_PI_2;

/// The lights of the placed nodes. Lights shine along -Z of their node; its scale doesn't change their strength.
///
/// # Errors
/// `Invalid` where a node names a light that isn't there, or the light is malformed.
pub(super) fn lights(document: &Document, nodes: &[PlacedNode], warnings: &mut Warnings) -> Result<Vec<Light>> {
    let mut lights = Vec::new();
    for node in nodes {
        let mut add = |shape, own: Contribution| {
            let light = Light::new(&node.name, shape);
            let world_from_light = super::profile::axes(node).unwrap_or(light.world_from_light);
            // What the node says goes before what its light says, which several nodes may share.
            let contribution = node.contribution.over(&own);
            lights.push(Light { world_from_light, contribution, gltf_node: Some(node.index), ..light });
        };
        if let Some(index) = node.light {
            let (light, own): (punctual::Light, _) = item(document, "KHR_lights_punctual", index, node)?;
            shape(&light, node, warnings).into_iter().for_each(|shape| add(shape, own.clone()));
        }
        if let Some(index) = node.area_light {
            let (light, own): (AreaLight, _) = item(document, "EXT_lights_area", index, node)?;
            area_shape(&light, node, warnings).into_iter().for_each(|shape| add(shape, own.clone()));
        }
    }
    Ok(lights)
}

/// Light `index` of those of `extension`, which `node` names, and what its extras say.
fn item<T: DeserializeOwned>(
    document: &Document,
    extension: &str,
    index: usize,
    node: &PlacedNode,
) -> Result<(T, Contribution)> {
    let light = document.json.get("extensions").and_then(|e| e.get(extension)?.get("lights")?.get(index));
    let light = light.ok_or_else(|| {
        let message = format!("names light {index} of {extension}, which isn't there; export the file again");
        Error::invalid(document.place("nodes", node.index), message)
    })?;
    let own = contribution::opinion(Some(light), || document.place("nodes", node.index))?;
    Ok((document.parse(light, "nodes", node.index)?, own))
}

/// A light of EXT_lights_area.
#[derive(Deserialize)]
struct AreaLight {
    #[serde(default = "white")]
    color: [f32; 3],
    /// Luminance [nit].
    #[serde(default = "thousand")]
    intensity: f32,
    #[serde(rename = "type")]
    kind: String,
    /// Height of a rectangle or diameter of a disk [the node's units].
    #[serde(default = "one")]
    size: f32,
    #[serde(default)]
    rect: Rect,
}

/// The shape of a rectangle: its width over its height.
#[derive(Deserialize)]
#[serde(default)]
struct Rect {
    aspect: f32,
}

impl Default for Rect {
    fn default() -> Self {
        Self { aspect: 1.0 }
    }
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn thousand() -> f32 {
    1000.0
}

fn one() -> f32 {
    1.0
}

/// The area light in world space, scaled by the largest of its node's scales; `None`, with a warning, where it can't shine.
fn area_shape(light: &AreaLight, node: &PlacedNode, warnings: &mut Warnings) -> Option<LightShape> {
    let radiance = Rgb::from_array(light.color).max(Rgb::ZERO) * light.intensity;
    if !radiance.is_finite() || radiance.max_element() <= 0.0 {
        warnings.add(&node.name, "the light has no positive, finite intensity and was left out");
        return None;
    }
    let world = node.world_from_local;
    let scale = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis].map(DVec3::length);
    let scale = scale.into_iter().fold(0.0, f64::max);
    let half = f64::from(light.size) / 2.0 * scale;
    // The rotation alone, whatever the scales are: -Z, and Y as far as it is upright to it.
    let forward = world.matrix3.z_axis.normalize_or_zero();
    let up = world.matrix3.y_axis.reject_from_normalized(forward).normalize_or_zero();
    let across = up.cross(forward);
    let (width, height) = (half * f64::from(light.rect.aspect), half);
    let valid = width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite();
    if !valid || across == DVec3::ZERO || !world.translation.is_finite() {
        warnings.add(&node.name, "the light has no area, or its transform is not invertible; it was left out");
        return None;
    }
    let center = world.translation.as_vec3();
    let axes = |u: f64, v: f64| ((across * u).as_vec3(), (up * v).as_vec3());
    match light.kind.as_str() {
        "rect" => {
            let (u, v) = axes(width, height);
            Some(LightShape::Rect { center, u, v, radiance })
        }
        "disk" => {
            let (u, v) = axes(half, half);
            Some(LightShape::Disk { center, u, v, radiance })
        }
        _ => {
            warnings.add(&node.name, "the light is of an unknown type and was left out");
            None
        }
    }
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
