//! glTF 2.0 reader: .gltf and .glb to a [`Scene`].
//!
//! The `gltf` crate's JSON types are used item by item, so that parts of a file that a bake doesn't need (animations,
//! unknown extensions) can't make it fail; accessors, buffers and images are decoded here, with every offset and
//! count checked before memory is taken.
//!
//! What is read: node trees, triangles of every kind, sparse, quantized and meshopt-compressed accessors, morph targets and
//! skins at rest or at a moment of an animation, base colour, emission, opacity and transmission with their textures and
//! variants, lights, light profiles, projectors, the sky, cameras, instances. Limits: Draco and Basis Universal can't be decoded; each is said. The table of
//! `extension` has the rest.

mod accessor;
mod animation;
mod appearance;
mod camera;
mod contribution;
mod document;
mod environment;
mod extension;
mod light;
mod material;
mod medium;
mod mesh;
mod meshopt;
mod morph;
mod node;
mod profile;
mod projector;
pub mod role;
mod skin;
mod texture;
mod transmission;
pub(crate) mod uri;
mod variant;

use super::access::Access;
use super::{LoadOptions, Loaded, Source};
use crate::error::{Result, Warnings};
use crate::scene::{Role, Scene, Surface, SurfaceOrigin};
use document::Document;
use std::path::{Path, PathBuf};

/// The document for a writer that keeps everything untouched: as it was read, but for compressed views, which stand
/// decoded, and the materials of chosen variants, which are the primitives' own.
#[derive(Debug)]
pub struct GltfSource {
    pub path: PathBuf,
    /// The JSON, keys in file order.
    pub json: serde_json::Value,
    /// The bytes of each buffer, as many as its `byteLength` says.
    pub buffers: Vec<Vec<u8>>,
    /// What may be read beside.
    pub access: Access,
}

/// Reads a .gltf or .glb, at rest or at the moment of `options`.
///
/// Each node with a mesh becomes a surface, its mesh's primitives merged into one; `Scene::meshes` holds only meshes that
/// are used, once for each shape that morph weights and skins give them (skinned ones in world space). Materials keep their index; one is added at the end for primitives that name none.
///
/// # Errors
/// `Io` where the file or a buffer can't be read, `Invalid` where it is broken or lacks an animation or variant that is asked
/// for, `Unsupported` where it needs an
/// extension that changes geometry and isn't read. Each names the file and the item. Pictures that can't be read are
/// warnings.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let mut warnings = Warnings::default();
    let access = Access::of_scene(path, options, true)?;
    let mut document = Document::open(path, &options.variants, &access, &mut warnings).or_else(|e| {
        access.finish()?;
        Err(e)
    })?;
    let pose = animation::pose(&document, options, &mut warnings)?;
    let nodes = node::flatten(&document, &pose, &mut warnings)?;
    let mut lights = light::lights(&document, &nodes, &mut warnings)?;
    let cameras = camera::cameras(&document, &nodes, &mut warnings)?;
    let profiles = profile::lights(&document, &nodes, &mut lights, &mut warnings)?;
    document.inputs.extend(profiles);
    let mut meshes = mesh::MeshReader::new(&document);
    let mut surfaces = Vec::new();
    for node in &nodes {
        let Some(index) = node.mesh else { continue };
        let mesh = meshes.read(index, &node.weights, node.skin.as_deref(), &mut warnings)?;
        for (name, world_from_local) in node.placements() {
            let (origin, role) = (SurfaceOrigin::GltfNode(node.index), node.role.apply(Role::default()));
            surfaces.push(Surface { name, mesh, world_from_local, origin, role });
        }
    }
    if surfaces.is_empty() && document.count("meshes") > 0 {
        warnings.add(document.file(), "the file has meshes, but no visible node of its scene shows one");
    }
    let meshes = meshes.into_meshes();
    let (materials, mut textures, pictures) =
        material::materials(&document, &meshes, options.appearance, &mut warnings)?;
    document.inputs.extend(pictures);
    let environment = environment::read(&mut document, &mut textures, &mut warnings)?;
    let mut scene = Scene { meshes, materials, textures, surfaces, lights, environment, cameras, media: Vec::new() };
    let slides = projector::read(&document, &mut scene, &mut warnings)?;
    document.inputs.extend(slides);
    document.inputs.extend(medium::read(&document, &nodes, &mut scene)?);
    access.finish()?;
    let Document { path, json, buffers, inputs, .. } = document;
    Ok(Loaded { scene, source: Source::Gltf(GltfSource { path, json, buffers, access }), inputs, warnings })
}
