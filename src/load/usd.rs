//! USD reader.

use super::Loaded;
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// What the layer writer needs of the stage that was read.
#[derive(Debug)]
pub struct UsdSource {
    pub path: PathBuf,
}

/// Reads a .usd, .usda, .usdc or .usdz stage.
pub fn load(path: &Path) -> Result<Loaded> {
    Err(Error::unsupported(path.display(), "not built yet"))
}
