//! EXT_lights_ies: points that shine as a photometric profile says.

use super::document::Document;
use super::node::PlacedNode;
use super::uri::{Resource, resolve};
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::load::ies;
use crate::scene::{Light, LightShape, PhotometricWeb, Profile};
use glam::{DMat3, DVec3, Mat3, Vec3};
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

const EXTENSION: &str = "EXT_lights_ies";

/// A node's use of a profile.
#[derive(Deserialize)]
struct Instance {
    light: usize,
    #[serde(default = "one")]
    multiplier: f32,
    #[serde(default = "white")]
    color: [f32; 3],
}

fn one() -> f32 {
    1.0
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

/// Where a profile lies.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Source {
    uri: Option<String>,
    buffer_view: Option<usize>,
}

/// Adds the profiled lights of the placed nodes to `lights`; returns the files that were read. A light points along -Z of its
/// node; type C has its 0 degrees at +X and turns towards +Y. A profile that can't be read is a warning.
///
/// # Errors
/// `Invalid` where a node names a profile that isn't there, or one is malformed.
pub(super) fn lights(
    document: &Document,
    nodes: &[PlacedNode],
    lights: &mut Vec<Light>,
    warnings: &mut Warnings,
) -> Result<Vec<PathBuf>> {
    let (mut files, mut webs) = (Vec::new(), BTreeMap::new());
    for node in nodes {
        let Some(instance) = document.json.pointer(&format!("/nodes/{}/extensions/{EXTENSION}", node.index)) else {
            continue;
        };
        let instance: Instance = document.parse(instance, "nodes", node.index)?;
        let web = match webs.get(&instance.light) {
            Some(web) => Option::clone(web),
            None => {
                let web = read(document, node.index, instance.light, &mut files, warnings)?.map(Arc::new);
                webs.insert(instance.light, web.clone());
                web
            }
        };
        let Some(web) = web else { continue };
        let intensity = Rgb::from_array(instance.color).clamp(Rgb::ZERO, Rgb::ONE) * instance.multiplier.max(0.0);
        let axes = axes(node);
        let position = node.world_from_local.translation.as_vec3();
        if !intensity.is_finite() || intensity.max_element() <= 0.0 || axes.is_none() || !position.is_finite() {
            warnings.add(&node.name, "a light profile without light or an invertible transform was left out");
            continue;
        }
        let world_from_light = axes.unwrap_or(Mat3::IDENTITY);
        let tilt = (-world_from_light.z_axis).dot(Vec3::NEG_Y).clamp(-1.0, 1.0).acos();
        let scale = web.tilt_factor(tilt);
        let web_from_light = Mat3::from_diagonal(Vec3::new(1.0, 1.0, -1.0));
        // A node can hold a punctual light as well.
        let name = if node.light.is_some() { format!("{} (profile)", node.name) } else { node.name.clone() };
        lights.push(Light {
            world_from_light,
            profile: Some(Profile { web, scale, angle_scale: 0.0, web_from_light }),
            contribution: node.contribution.clone(),
            gltf_node: Some(node.index),
            ..Light::new(name, LightShape::Point { position, intensity, range: None })
        });
    }
    Ok(files)
}

/// The axes of a node, orthonormal: -Z first, then +Y; `None` where it has no direction.
pub(super) fn axes(node: &PlacedNode) -> Option<Mat3> {
    let m = node.world_from_local.matrix3;
    let z = m.z_axis.try_normalize()?;
    let y = (m.y_axis - z * m.y_axis.dot(z)).try_normalize().unwrap_or(z.any_orthonormal_vector());
    let x: DVec3 = y.cross(z) * if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    Some(DMat3::from_cols(x, y, z).as_mat3()).filter(|m| m.is_finite())
}

/// Profile `index` of the document; `None`, with a warning, where its file can't be read.
fn read(
    document: &Document,
    node: usize,
    index: usize,
    files: &mut Vec<PathBuf>,
    warnings: &mut Warnings,
) -> Result<Option<PhotometricWeb>> {
    let list = document.json.pointer(&format!("/extensions/{EXTENSION}/lights"));
    let source: &Value = list.and_then(|l| l.get(index)).ok_or_else(|| {
        let message = format!("names light profile {index}, which isn't there; export the file again");
        Error::invalid(document.place("nodes", node), message)
    })?;
    let source: Source = document.parse(source, "nodes", node)?;
    let place = format!("{}: light profile {index}", document.file());
    let mut web = || -> Result<PhotometricWeb> {
        match (source.buffer_view, &source.uri) {
            (Some(view), _) => ies::read(&place, document.view(view)?.bytes, warnings),
            (None, Some(uri)) => match resolve(&document.path, uri, &place)? {
                Resource::Bytes(bytes) => ies::read(&place, &bytes, warnings),
                Resource::File(file) => {
                    let bytes = document.access.read(&file)?;
                    let web = ies::read(&file.display().to_string(), &bytes, warnings)?;
                    files.push(file);
                    Ok(web)
                }
            },
            (None, None) => Err(Error::invalid(&place, "has neither a URI nor a buffer view")),
        }
    };
    Ok(web().map_err(|e| warnings.add_missing(e, "a light profile can't be read; its lights were left out")).ok())
}
