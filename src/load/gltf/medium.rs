//! Participating media, in the extras of nodes:
//!
//! ```json
//! "extras": { "lumel": { "medium": { "scattering": [0.2, 0.3, 0.5], "absorption": 0.01, "g": 0.6 } } }
//! ```
//!
//! [`crate::load::medium`] has the keys. A node without a mesh places a box with sides of 1 around its origin, one with a mesh the
//! mesh's bounding box, under its transform. Such a mesh only bounds the medium and is no surface, unless the node says
//! `"skip": false`. `"skip": true`, here or above, leaves the medium out. `grid` is a URI as images have them; its axes are the node's.

use super::document::Document;
use super::node::PlacedNode;
use super::uri::{Resource, resolve};
use crate::error::{Error, Result};
use crate::load::medium::{MediumKind, MediumRequest};
use crate::load::volume;
use crate::scene::{DensityGrid, MediumShape, Scene, SurfaceOrigin};
use glam::{Affine3A, DAffine3, DMat3, Vec3};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Arc;

/// What the extras of node `node` say of a medium.
pub(super) fn extras(document: &Document, node: usize) -> Option<&Value> {
    document.json.get("nodes")?.get(node)?.get("extras")?.get("lumel")?.get("medium")
}

/// Puts the media of `nodes` into `scene`, whose surfaces are there; returns the files that were read.
///
/// # Errors
/// `Invalid` where the extras are malformed or out of range, or a grid can't be read; `Io` where its file can't.
pub(super) fn read(document: &Document, nodes: &[PlacedNode], scene: &mut Scene) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for node in nodes {
        let Some(medium) = extras(document, node.index).filter(|_| node.role.skip != Some(true)) else { continue };
        let place = document.place("nodes", node.index);
        let invalid = |fault: String| Error::invalid(&place, format!("extras.lumel.medium: {fault}"));
        if !medium.is_object() {
            return Err(invalid("is no object; give it keys such as \"scattering\": 0.1".into()));
        }
        let request: MediumRequest = document.parse(medium, "nodes", node.index)?;
        if request.name.is_some() || request.center.is_some() || request.size.is_some() {
            return Err(invalid("name, center and size are the node's; leave them out".into()));
        }
        let grid = request.grid.as_ref().map(|uri| grid(document, &place, &uri.to_string_lossy(), &mut files));
        let grid = grid.transpose()?.map(Arc::new);
        for (name, shape) in shapes(node, scene, request.shape.unwrap_or(MediumKind::Box)) {
            let mut medium = request.medium(&name, shape).map_err(invalid)?;
            medium.grid = grid.clone();
            if let Some(fault) = medium.fault(scene) {
                return Err(invalid(fault));
            }
            scene.media.push(medium);
        }
        if node.role.skip.is_none() {
            let of_node = SurfaceOrigin::GltfNode(node.index);
            scene.surfaces.iter_mut().filter(|s| s.origin == of_node).for_each(|s| s.role.skip = true);
        }
    }
    Ok(files)
}

/// The names and places of a node's media: one for each place where its mesh stands.
fn shapes(node: &PlacedNode, scene: &Scene, kind: MediumKind) -> Vec<(String, MediumShape)> {
    let shape = |world_from_unit: Affine3A| match kind {
        MediumKind::Box => MediumShape::Box { world_from_unit },
        MediumKind::Ellipsoid => MediumShape::Ellipsoid { world_from_unit },
        MediumKind::Scene => MediumShape::Scene,
    };
    if node.mesh.is_none() || kind == MediumKind::Scene {
        let local_from_unit = DAffine3::from_translation(glam::DVec3::splat(-0.5));
        return vec![(node.name.clone(), shape((node.world_from_local * local_from_unit).as_affine3a()))];
    }
    let of_node = SurfaceOrigin::GltfNode(node.index);
    let surfaces = scene.surfaces.iter().filter(|s| s.origin == of_node);
    let boxed = surfaces.map(|surface| {
        let positions = scene.meshes[surface.mesh].positions.iter().filter(|p| p.is_finite());
        let none = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
        let [low, high] = positions.fold(none, |[low, high], p| [low.min(*p), high.max(*p)]).map(Vec3::as_dvec3);
        let local_from_unit = DAffine3::from_mat3_translation(DMat3::from_diagonal(high - low), low);
        (surface.name.clone(), shape(surface.world_from_local * local_from_unit.as_affine3a()))
    });
    boxed.collect()
}

/// The grid that `uri` names.
fn grid(document: &Document, place: &str, uri: &str, files: &mut Vec<PathBuf>) -> Result<DensityGrid> {
    let (place, bytes) = match resolve(&document.path, uri, place)? {
        Resource::Bytes(bytes) => (place.to_owned(), bytes),
        Resource::File(file) => {
            let bytes = document.access.read(&file)?;
            let name = file.display().to_string();
            files.push(file);
            (name, bytes)
        }
    };
    Ok(volume::read(&place, &bytes, None)?.grid)
}
