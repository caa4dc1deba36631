//! Results to files: pages as EXR and in the forms of engines, GLBs, a USD layer, NPZ. Each file is complete or absent.

mod blend;
pub mod dump;
pub mod encode;
pub mod engines;
pub mod exr;
pub mod gltf;
pub mod npz;
pub mod output;
pub mod picture;
mod pieces;
pub mod probes;
mod split;
pub mod usd;
pub mod view_factors;
pub mod watch;

use crate::load::Source;
use crate::meshing::VertexLight;
use crate::post::{Lightmap, Quantity};
use crate::scene::Scene;
use crate::unwrap::Atlas;
use encode::Encoded;
use engines::LightmapExtension;
use std::path::Path;

/// All that the GLB and USD writers need of a bake.
pub struct Baked<'a> {
    pub scene: &'a Scene,
    pub source: &'a Source,
    pub atlas: &'a Atlas,
    /// None where UVs alone were made.
    pub lightmap: Option<&'a Lightmap>,
    /// The light at vertices; none without light.
    pub vertices: Option<&'a VertexLight>,
    /// What pages and colours hold.
    pub quantity: Quantity,
    /// The page files that GLB and layer name, relative to the output folder, with `/`: `lightmaps/<stem>_0.exr`; none without
    /// light. They are those of the first plain form ([`encode::Encoding::is_plain`]), OpenEXR before others.
    pub page_uris: &'a [String],
    /// All forms of the pages.
    pub encoded: &'a [Encoded],
    /// The form of the vertex GLB's `COLOR_0`.
    pub vertex_colors: VertexColors,
    /// By what extension the engine GLB names pages, besides its extras.
    pub lightmap_extension: Option<LightmapExtension>,
    /// The output folder.
    pub folder: &'a Path,
    pub lights: BakedLights,
}

/// What happens to the lights that are baked in: an engine would light the scene twice. Lights that are not wholly baked
/// ([`crate::scene::contribution`]) are never removed: marks say what the engine has to add of those of which indirect light alone is
/// baked, and dynamic ones stay as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BakedLights {
    /// Kept, and marked as baked.
    #[default]
    Mark,
    Remove,
    Keep,
}

/// Form of a GLB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GltfProfile {
    /// Materials untouched, lightmap UVs and extras added.
    Engine,
    /// Baked vertex colours, unlit.
    Vertex,
}

/// Form of `COLOR_0` in the vertex GLB: the light over the file's `vertexScale`, linear, 0..=1. Its `_IRRADIANCE` is always float.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VertexColors {
    /// 8 bits a channel, 4 bytes a vertex: steps of 1/255 of the brightest light show in dark places.
    U8,
    /// 16 bits a channel, 8 bytes a vertex.
    U16,
    /// 32-bit floats, 12 bytes a vertex, or 16 with alpha.
    #[default]
    Float,
}
