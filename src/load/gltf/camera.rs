//! Cameras of placed nodes: they look along -Z of their node, whose scale means nothing to them.

use super::document::Document;
use super::node::PlacedNode;
use crate::error::{Result, Warnings};
use crate::scene::{Camera, Projection};
use ::gltf::json;
use ::gltf::json::camera::Type;
use ::gltf::json::validation::Checked;
use glam::{DVec3, Mat3, Vec2};
use std::f32::consts::PI;

/// The cameras of `nodes`; those that see nothing are left out with a warning.
///
/// # Errors
/// `Invalid` where a node names a camera that isn't there, or one is malformed.
pub(super) fn cameras(document: &Document, nodes: &[PlacedNode], warnings: &mut Warnings) -> Result<Vec<Camera>> {
    let mut cameras = Vec::new();
    for node in nodes {
        let Some(index) = node.camera else { continue };
        let source: json::Camera = document.item("cameras", index)?;
        let place = || document.place("cameras", index);
        let Some((projection, aspect)) = projection(&source) else {
            warnings.add(place(), "the camera's angle or extent is not positive and finite; it was left out");
            continue;
        };
        let axes = node.world_from_local.matrix3;
        let (Some(back), Some(right)) = (axes.z_axis.try_normalize(), axes.y_axis.cross(axes.z_axis).try_normalize())
        else {
            warnings.add(place(), "the camera's transform is flat; it was left out");
            continue;
        };
        let columns = [right, back.cross(right), back].map(|v: DVec3| v.as_vec3());
        cameras.push(Camera {
            name: node.name.clone(),
            position: node.world_from_local.translation.as_vec3(),
            world_from_camera: Mat3::from_cols(columns[0], columns[1], columns[2]),
            projection,
            aspect,
            lens: None,
        });
    }
    Ok(cameras)
}

/// The projection and the ratio of width to height, where they are sound.
fn projection(camera: &json::Camera) -> Option<(Projection, Option<f32>)> {
    let is_size = |v: f32| v.is_finite() && v > 0.0;
    match (&camera.type_, &camera.perspective, &camera.orthographic) {
        (Checked::Valid(Type::Perspective), Some(p), _) => {
            let half_height = (0.5 * p.yfov).tan();
            let is_sound = p.yfov > 0.0 && p.yfov < PI && is_size(half_height);
            let projection = Projection::Perspective { half_height, shift: Vec2::ZERO };
            is_sound.then_some((projection, p.aspect_ratio.filter(|a| is_size(*a))))
        }
        (Checked::Valid(Type::Orthographic), _, Some(o)) => {
            let is_sound = is_size(o.xmag) && is_size(o.ymag);
            is_sound.then_some((Projection::Orthographic { half_height: o.ymag }, Some(o.xmag / o.ymag)))
        }
        _ => None,
    }
}
