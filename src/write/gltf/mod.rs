//! GLBs: the baked scene for engines (lightmap UVs, rectangles, pages beside it) and for viewers (baked vertex colours).
//!
//! A glTF source is edited, not rebuilt: its JSON keeps its keys in order and whatever the bake did not have to touch; data
//! is appended to its one buffer. A mesh that was baked in a pose keeps its own vertices, skin, morph targets and animations,
//! and gains the lightmap UVs of that pose: it can go on moving, under light that stands still. Compressed views come decoded
//! from the loader. A USD source is written anew from the scene in memory.

mod accessor;
mod compact;
mod document;
mod engine;
mod extras;
mod import;
mod influences;
mod instances;
mod lightmap_ext;
mod primitive;
mod radiance;
mod scene;
mod viewer_colors;

use super::Baked;
use crate::error::{Error, Result, Warnings};
use crate::load::Source;
use crate::scene::{Scene, SurfaceOrigin};
use crate::write::GltfProfile;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes the baked scene as a GLB to `path`; URIs in it are relative to `baked.folder`.
///
/// # Errors
/// `Invalid` where the source is broken, `Unsupported` where it can't be edited or the file would pass 4 GiB, `Io`.
pub fn write(path: &Path, baked: &Baked, profile: GltfProfile) -> Result<Warnings> {
    let mut warnings = Warnings::default();
    let doc = match baked.source {
        Source::Gltf(source) => {
            let mut doc = import::import(source, baked.folder, &mut warnings)?;
            let before = compact::Before::new(&mut doc);
            extras::strip(&mut doc);
            lightmap_ext::strip(&mut doc);
            match profile {
                GltfProfile::Engine => {
                    engine::write(&mut doc, baked, &mut warnings)?;
                    extras::write_asset(&mut doc, baked, None);
                    name_pages(&mut doc, baked, &mut warnings)?;
                }
                GltfProfile::Vertex => {
                    let (lights, scale) = radiance::surface_lights(baked);
                    viewer_colors::write(&mut doc, baked, &lights, &mut warnings)?;
                    extras::write_asset(&mut doc, baked, Some(scale));
                }
            }
            extras::write_lights(&mut doc, baked.scene, baked.lights)?;
            before.compact(&mut doc);
            doc
        }
        Source::Usd(_) => {
            let colors = (profile == GltfProfile::Vertex).then(|| radiance::surface_lights(baked));
            let lights = colors.as_ref().map(|(lights, _)| lights.as_slice());
            let mut doc = scene::build(baked, lights, &mut warnings)?;
            extras::write_asset(&mut doc, baked, colors.as_ref().map(|(_, scale)| *scale));
            if profile == GltfProfile::Engine {
                name_pages(&mut doc, baked, &mut warnings)?;
            }
            doc
        }
    };
    std::fs::write(path, doc.into_glb()?).map_err(|e| Error::io(path, e))?;
    Ok(warnings)
}

/// Names the pages by the extension that the bake asks for, where it asks for one and has pages.
fn name_pages(doc: &mut document::Document, baked: &Baked, warnings: &mut Warnings) -> Result<()> {
    match baked.lightmap_extension.filter(|_| baked.lightmap.is_some()) {
        Some(extension) => lightmap_ext::write(doc, baked, extension, warnings),
        None => Ok(()),
    }
}

/// The nodes of a glTF scene and their surfaces in order: one, or many where the node draws instances.
fn nodes(scene: &Scene) -> BTreeMap<usize, Vec<usize>> {
    let mut nodes: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, surface) in scene.surfaces.iter().enumerate() {
        if let SurfaceOrigin::GltfNode(node) = surface.origin {
            nodes.entry(node).or_default().push(i);
        }
    }
    nodes
}
