//! Cameras of the scene as glTF has them: on nodes that look along -Z.

use super::super::document::{Document, number, numbers};
use crate::error::Warnings;
use crate::scene::{Camera, Projection, Scene};
use glam::{Quat, Vec2, Vec3};
use serde_json::{Value, json};

/// The near plane [m]; rays know none, and what is nearer is cut off by engines alone.
const NEAR: f32 = 0.01;

/// The far plane of orthographic cameras, over the distance to the far side of a ball around the scene: the format wants one.
const FAR_FACTOR: f32 = 1.1;

/// Writes a node for each camera, in the scene's order; returns the nodes. What of a camera the format has no form for is named in a
/// warning.
pub fn write(doc: &mut Document, scene: &Scene, warnings: &mut Warnings) -> Vec<usize> {
    let mut nodes = Vec::new();
    for camera in &scene.cameras {
        let json = lens(camera, scene, warnings);
        let index = doc.push("cameras", json);
        let mut node = json!({ "name": camera.name, "camera": index });
        if camera.position != Vec3::ZERO {
            node["translation"] = numbers(&camera.position.to_array());
        }
        let rotation = Quat::from_mat3(&camera.world_from_camera).normalize();
        if rotation != Quat::IDENTITY {
            node["rotation"] = numbers(&rotation.to_array());
        }
        nodes.push(doc.push("nodes", node));
    }
    nodes
}

/// The camera without its place.
fn lens(camera: &Camera, scene: &Scene, warnings: &mut Warnings) -> Value {
    if camera.lens.is_some() {
        warnings.add(&camera.name, "a camera's lens can't be expressed in the GLB; there it is a pinhole");
    }
    match camera.projection {
        Projection::Perspective { half_height, shift } => {
            if shift != Vec2::ZERO {
                warnings.add(&camera.name, "a camera's aperture offset can't be expressed in the GLB; it was left out");
            }
            let mut perspective = json!({ "yfov": number(2.0 * half_height.atan()), "znear": number(NEAR) });
            if let Some(aspect) = camera.aspect {
                perspective["aspectRatio"] = number(aspect);
            }
            json!({ "name": camera.name, "type": "perspective", "perspective": perspective })
        }
        Projection::Orthographic { half_height } => {
            let [low, high] = scene.bounds().unwrap_or_default();
            let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
            let far = FAR_FACTOR * (camera.position.distance(middle) + radius);
            let xmag = half_height * camera.aspect.unwrap_or(1.0);
            let size = json!({
                "xmag": number(xmag), "ymag": number(half_height),
                "znear": 0.0, "zfar": number(far.max(1.0)),
            });
            json!({ "name": camera.name, "type": "orthographic", "orthographic": size })
        }
    }
}
