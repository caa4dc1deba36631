//! The data's way, in order: load, unwrap, rasterize, direct, solve, gather, post, write.

use crate::error::Result;
use crate::progress::Progress;
use crate::settings::Settings;
use std::path::Path;

/// Bakes the scene file `scene` into the folder `folder`.
///
/// # Errors
/// Those of the stages; nothing is written unless the whole bake succeeds.
pub fn bake(scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let _ = (scene, folder, settings, progress);
    todo!()
}

/// What a bake did; written as `report.json`.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {}
