//! Results to files: EXR pages, GLBs, a USD layer, NPZ. Each file is complete or absent.

pub mod dump;
pub mod exr;
pub mod gltf;
pub mod npz;
pub mod output;
pub mod probes;
pub mod usd;
pub mod view_factors;
pub mod watch;

use crate::load::Source;
use crate::post::{Lightmap, Quantity, vertex::CornerColors};
use crate::scene::Scene;
use crate::unwrap::Atlas;
use std::path::Path;

/// All that the GLB and USD writers need of a bake.
pub struct Baked<'a> {
    pub scene: &'a Scene,
    pub source: &'a Source,
    pub atlas: &'a Atlas,
    /// None where UVs alone were made.
    pub lightmap: Option<&'a Lightmap>,
    pub corners: Option<&'a CornerColors>,
    /// What pages and colours hold.
    pub quantity: Quantity,
    /// The page files relative to the output folder, with `/`: `lightmaps/<stem>_0.exr`; none without light.
    pub page_uris: &'a [String],
    /// The output folder.
    pub folder: &'a Path,
    pub lights: BakedLights,
}

/// What happens to the lights that are baked in: an engine would light the scene twice.
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
