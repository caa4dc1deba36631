//! glTF 2.0 reader: .gltf and .glb to a [`Scene`].
//!
//! The `gltf` crate's JSON types are used item by item, so that parts of a file that a bake doesn't need (animations,
//! cameras, unknown extensions) can't make it fail; accessors, buffers and images are decoded here, with every offset and
//! count checked before memory is taken.
//!
//! What is read: node trees, triangles of every kind, sparse and quantized accessors, base colour and emission with
//! their textures, lights, light profiles, projectors, instances. Limits: skins and morph targets stay in their bind pose, Draco and meshopt
//! compression are refused; each is said.

mod accessor;
mod document;
mod extension;
mod light;
mod material;
mod mesh;
mod node;
mod profile;
mod projector;
mod texture;
pub(crate) mod uri;

use super::{LoadOptions, Loaded, Source};
use crate::error::{Result, Warnings};
use crate::scene::{Scene, Surface, SurfaceOrigin};
use document::Document;
use std::path::{Path, PathBuf};

/// The document as it was read, for a writer that keeps everything untouched.
#[derive(Debug)]
pub struct GltfSource {
    pub path: PathBuf,
    /// The JSON, keys in file order.
    pub json: serde_json::Value,
    /// The bytes of each buffer, as many as its `byteLength` says.
    pub buffers: Vec<Vec<u8>>,
}

/// Reads a .gltf or .glb.
///
/// Each node with a mesh becomes a surface, its mesh's primitives merged into one; `Scene::meshes` holds only meshes that
/// are used. Materials keep their index; one is added at the end for primitives that name none.
///
/// # Errors
/// `Io` where the file or a buffer can't be read, `Invalid` where it is broken, `Unsupported` where it needs an
/// extension that changes geometry and isn't read. Each names the file and the item. Pictures that can't be read are
/// warnings.
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Loaded> {
    let mut warnings = Warnings::default();
    let mut document = Document::open(path, &mut warnings)?;
    let nodes = node::flatten(&document, &mut warnings)?;
    let mut lights = light::lights(&document, &nodes, &mut warnings)?;
    let profiles = profile::lights(&document, &nodes, &mut lights, &mut warnings)?;
    document.inputs.extend(profiles);
    let mut meshes = mesh::MeshReader::new(&document);
    let mut surfaces = Vec::new();
    for node in &nodes {
        let Some(index) = node.mesh else { continue };
        let mesh = meshes.read(index, &mut warnings)?;
        for (name, world_from_local) in node.placements() {
            surfaces.push(Surface { name, mesh, world_from_local, origin: SurfaceOrigin::GltfNode(node.index) });
        }
    }
    let meshes = meshes.into_meshes();
    let (materials, textures, pictures) = material::materials(&document, &meshes, &mut warnings)?;
    document.inputs.extend(pictures);
    let mut scene = Scene { meshes, materials, textures, surfaces, lights, environment: None };
    let slides = projector::read(&document, &mut scene, &mut warnings)?;
    document.inputs.extend(slides);
    let Document { path, json, buffers, inputs, .. } = document;
    Ok(Loaded { scene, source: Source::Gltf(GltfSource { path, json, buffers }), inputs, warnings })
}
