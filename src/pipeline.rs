//! The data's way, in order: load, unwrap, rasterize, direct, solve, gather, post, write.

use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use crate::settings::Settings;
use std::path::Path;

/// Bakes the scene file `scene` into the folder `folder`.
///
/// # Errors
/// Those of the stages; nothing is written unless the whole bake succeeds.
pub fn bake(scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let _ = (folder, settings);
    progress.begin("load", 0);
    crate::load::load(scene)?;
    Err(Error::unsupported(scene.display(), "not built yet"))
}

/// Makes lightmap UVs for the scene file `scene` and writes them into the folder `folder`, without light.
///
/// # Errors
/// As [`bake`].
pub fn unwrap(scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    bake(scene, folder, settings, progress)
}

/// What a bake did; written as `report.json`.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// What was met on the way.
    pub warnings: Warnings,
}

impl Report {
    /// The result in a few lines for people.
    pub fn summary(&self) -> Vec<String> {
        Vec::new()
    }
}
