//! What a loader is asked for beside the file.

use super::edits::Edits;
use std::path::PathBuf;

/// How a scene file is read. The default is the file as it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// The moment that moving parts are read at: seconds in glTF, a time code in USD. None: at rest in glTF, the
    /// default time in USD.
    pub time: Option<f64>,
    /// glTF: name of the animation that is read, or its number from 0; none: the first one, where there is a `time`.
    /// With a name alone the time is 0.
    pub animation: Option<String>,
    /// What is chosen of what the file offers in several forms. glTF: names of KHR_materials_variants, of which a later
    /// one goes before an earlier one. USD: `PRIM:SET=NAME`.
    pub variants: Vec<String>,
    /// Levels that USD's subdivision surfaces are refined to; 0: their control cages.
    pub subdivide: u32,
    /// USD's purposes that are drawn beside the default one; none: render.
    pub purpose: Vec<Purpose>,
    /// What is changed of the scene once it is read.
    pub edits: Edits,
    /// Folder that the scene and everything it pulls in must lie in, symbolic links resolved; none: glTF keeps to the
    /// scene's own folder, USD reads from anywhere.
    pub confine: Option<PathBuf>,
    /// Texels of a picture, at most; none: [`super::image::MOST_TEXELS`].
    pub max_texture: Option<u64>,
    /// Memory of all decoded pictures, at most [bytes]; none: no limit.
    pub max_memory: Option<u64>,
    /// What materials look like beyond the diffuse is read too, with its textures: [`crate::scene::Material::appearance`].
    pub appearance: bool,
    /// Input that is missing or can't be read is an error in place of a warning.
    pub strict: bool,
}

/// What a part of a USD scene is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Purpose {
    /// What has none: always drawn.
    Default,
    Render,
    Proxy,
    Guide,
}

impl LoadOptions {
    /// The purposes that are drawn.
    pub fn purposes(&self) -> Vec<Purpose> {
        if self.purpose.is_empty() { vec![Purpose::Default, Purpose::Render] } else { self.purpose.clone() }
    }
}
