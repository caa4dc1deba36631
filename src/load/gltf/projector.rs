//! Projectors, in the extras of nodes that hold a light:
//!
//! ```json
//! "extras": { "lumel_projector": { "picture": "slide.png", "fov": 40, "aspect": 1.5, "target": "Backdrop" } }
//! ```
//!
//! `picture` is a URI as images have them. `fov` is the full horizontal angle [degrees] (default: that of a spot's cone), `aspect`
//! width over height (default: the picture's). `target` names a node (the last part of its path, or the whole) that the picture
//! lands square on; in its place `"plane": { "point": [..], "normal": [..], "up": [..] }` gives a plane in the scene's space.

use super::document::Document;
use super::uri::{Resource, resolve};
use crate::error::{Result, Warnings};
use crate::load::image::ColorSpace;
use crate::load::projector::{ProjectorRequest, Target};
use crate::scene::projector::TargetPlane;
use crate::scene::{Scene, Texture};
use glam::Vec3;
use serde::Deserialize;
use std::path::PathBuf;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Slide {
    picture: String,
    fov: Option<f32>,
    aspect: Option<f32>,
    target: Option<String>,
    plane: Option<Plane>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Plane {
    point: [f32; 3],
    normal: [f32; 3],
    up: Option<[f32; 3]>,
}

/// Puts the projectors on the lights of `scene`; returns the files that were read. A picture that can't be read is a warning.
///
/// # Errors
/// `Invalid` where the extras are malformed.
pub(super) fn read(document: &Document, scene: &mut Scene, warnings: &mut Warnings) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for light in 0..scene.lights.len() {
        let Some(node) = scene.lights[light].gltf_node else { continue };
        let Some(slide) = document.json.pointer(&format!("/nodes/{node}/extras/lumel_projector")) else { continue };
        let slide: Slide = document.parse(slide, "nodes", node)?;
        let picture = match picture(document, node, &slide.picture, &mut files) {
            Ok(picture) => picture,
            Err(e) => {
                warnings.add_missing(e, "a projector's picture can't be read; the light shines without it");
                continue;
            }
        };
        scene.textures.push(picture);
        let request = ProjectorRequest {
            light,
            texture: scene.textures.len() - 1,
            fov: slide.fov.map(f32::to_radians),
            aspect: slide.aspect,
            target: target(&slide, scene),
        };
        request.apply(scene, warnings);
    }
    Ok(files)
}

fn target(slide: &Slide, scene: &Scene) -> Target {
    if let Some(plane) = &slide.plane
        && let Some(normal) = Vec3::from_array(plane.normal).try_normalize()
    {
        return Target::Plane(TargetPlane { point: plane.point.into(), normal, up: plane.up.map(Vec3::from) });
    }
    let Some(name) = slide.target.clone() else { return Target::None };
    let is_named = |path: &str| path == name || path.strip_suffix(&name).is_some_and(|above| above.ends_with('/'));
    let surfaces = (0..scene.surfaces.len()).filter(|&s| is_named(&scene.surfaces[s].name)).collect();
    Target::Surfaces { name, surfaces }
}

fn picture(document: &Document, node: usize, uri: &str, files: &mut Vec<PathBuf>) -> Result<Texture> {
    let place = document.place("nodes", node);
    match resolve(&document.path, uri, &place)? {
        Resource::Bytes(bytes) => document.access.decode(&place, &bytes, ColorSpace::Auto),
        Resource::File(file) => {
            let bytes = document.access.read(&file)?;
            let texture = document.access.decode(&file.display().to_string(), &bytes, ColorSpace::Auto)?;
            files.push(file);
            Ok(texture)
        }
    }
}
