//! A GLB from the scene in memory, for sources that aren't glTF: metres, Y up, a node for each surface named by its path.

mod camera;
pub mod light;
mod material;
mod mesh;
mod picture;

use super::document::{Document, number, numbers};
use super::radiance::SurfaceLight;
use super::{extras, viewer_colors};
use crate::error::{Result, Warnings};
use crate::scene::{Environment, Material, Surface};
use crate::write::Baked;
use crate::write::pieces::Pieces;
use glam::{Affine3A, Vec3A};
use material::Materials;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// The number of the lightmap's UV set.
const LIGHTMAP_SET: usize = 1;

/// Builds the document: with lightmap UVs, or, given `lights` (one a surface), with baked vertex colours.
///
/// # Errors
/// `Invalid` where a picture can't be encoded.
pub fn build(baked: &Baked, lights: Option<&[SurfaceLight]>, warnings: &mut Warnings) -> Result<Document> {
    let scene = baked.scene;
    let mut doc = Document::empty("the scene".into());
    let mut materials = Materials::new(scene, lights.is_none().then_some(LIGHTMAP_SET));
    let shown = scene.surfaces.iter().enumerate().filter(|(i, _)| baked.atlas.is_shown(*i));
    let has_uvs: BTreeSet<usize> = shown.map(|(_, surface)| surface.mesh).collect();
    // Meshes that surfaces share, by index in the scene.
    let mut shared: BTreeMap<usize, usize> = BTreeMap::new();
    let mut nodes: Vec<Value> = Vec::new();
    for (i, surface) in scene.surfaces.iter().enumerate() {
        let mut node = json!({ "name": surface.name });
        let transform = placement(surface, &mut node);
        let mesh = match (lights, shared.get(&surface.mesh)) {
            (None, Some(mesh)) if transform.is_none() => *mesh,
            _ => {
                let source = mesh::Source { mesh: &scene.meshes[surface.mesh], transform };
                let mesh = match lights {
                    Some(_) if !surface.role.receives => source.write_plain(&mut doc, &mut materials, warnings)?,
                    None if !has_uvs.contains(&surface.mesh) => {
                        source.write_plain(&mut doc, &mut materials, warnings)?
                    }
                    None => {
                        let uvs = &baked.atlas.meshes[surface.mesh].corners;
                        let corners: Vec<_> = uvs.iter().map(|c| c.map(|uv| uv.to_array())).collect();
                        let (pieces, uvs) = (Pieces::whole(&corners), mesh::lightmap_attributes);
                        let class = |p: usize| (scene.meshes[surface.mesh].triangle_material[p], false);
                        source.write(&mut doc, &mut materials, &pieces, class, uvs, warnings)?
                    }
                    Some(lights) => {
                        let (light, pieces) = (&lights[i], lights[i].pieces());
                        let material = |p: usize| scene.meshes[surface.mesh].triangle_material[pieces.source(p)];
                        let class = |p: usize| (material(p), light.whole[p]);
                        let colors = |values: &[_]| viewer_colors::color_attributes(values, baked.vertex_colors).into();
                        source.write(&mut doc, &mut materials, &pieces, class, colors, warnings)?
                    }
                };
                if transform.is_none() {
                    shared.insert(surface.mesh, mesh);
                }
                mesh
            }
        };
        node["mesh"] = mesh.into();
        let node = doc.push("nodes", node);
        if lights.is_none() && baked.atlas.is_shown(i) {
            extras::write_placement(&mut doc, node, &baked.atlas.placements[i], LIGHTMAP_SET)?;
        }
        nodes.push(node.into());
    }
    nodes.extend(light::write(&mut doc, baked, warnings)?.into_iter().map(Value::from));
    nodes.extend(camera::write(&mut doc, scene, warnings).into_iter().map(Value::from));
    for sky in scene.environment.iter().flat_map(Environment::each) {
        warnings.add(&sky.name, "a sky can't be expressed in the GLB; its light is in the lightmap alone");
    }
    doc.root_mut().insert("scene".into(), 0.into());
    doc.push("scenes", json!({ "nodes": nodes }));
    Ok(doc)
}

/// Writes a surface's transform into its node as translation, rotation and scale; returns it where it is sheared, which a
/// node can't be: then the mesh takes it.
fn placement(surface: &Surface, node: &mut Value) -> Option<Affine3A> {
    let world = surface.world_from_local;
    let axes = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis].map(Vec3A::normalize_or_zero);
    let skew = axes[0].dot(axes[1]).abs().max(axes[1].dot(axes[2]).abs()).max(axes[2].dot(axes[0]).abs());
    // Well above the rounding of transforms that were multiplied together, well below a visible shear.
    if skew > 1e-5 {
        return Some(world);
    }
    let (scale, rotation, translation) = world.to_scale_rotation_translation();
    let rotation = rotation.normalize();
    if translation != glam::Vec3::ZERO {
        node["translation"] = numbers(&translation.to_array());
    }
    if rotation != glam::Quat::IDENTITY {
        node["rotation"] = rotation.to_array().map(number).to_vec().into();
    }
    if scale != glam::Vec3::ONE {
        node["scale"] = numbers(&scale.to_array());
    }
    None
}

/// The UV sets that a material's textures use, each once.
fn uv_sets(material: &Material) -> Vec<&str> {
    let mut sets: Vec<&str> = Vec::new();
    for slot in material.albedo_texture.iter().chain(&material.emission_texture) {
        if !sets.contains(&slot.uv_set.as_str()) {
            sets.push(&slot.uv_set);
        }
    }
    sets
}
