//! glTF 2.0 reader.

use super::Loaded;
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// The document as it was read, for a writer that keeps everything untouched.
#[derive(Debug)]
pub struct GltfSource {
    pub path: PathBuf,
    /// The JSON, keys in file order.
    pub json: serde_json::Value,
    /// The bytes of each buffer.
    pub buffers: Vec<Vec<u8>>,
}

/// Reads a .gltf or .glb.
pub fn load(path: &Path) -> Result<Loaded> {
    Err(Error::unsupported(path.display(), "not built yet"))
}
