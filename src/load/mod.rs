//! Files to a [`Scene`]: glTF and USD readers, images, units. Third-party formats end here.

pub mod access;
pub mod baked;
pub mod edits;
pub mod gltf;
pub mod ies;
pub mod image;
pub mod medium;
pub mod npz;
pub mod options;
pub mod pattern;
pub mod projector;
pub mod sky_layout;
pub mod units;
pub mod usd;
pub mod vdb;
pub mod volume;

use crate::error::{Error, Result, Warnings};
use crate::scene::{Scene, validate::validate};
use std::path::{Path, PathBuf};

pub use edits::{Edits, LampEdit, LampKind, MaterialEdit, ObjectEdit};
pub use options::{LoadOptions, Purpose};

/// What a loader gives: the scene, what the writers need of its source, and what was met on the way.
#[derive(Debug)]
pub struct Loaded {
    pub scene: Scene,
    pub source: Source,
    /// Every file that was read (scene, layers, buffers, textures), for the report's hashes.
    pub inputs: Vec<PathBuf>,
    pub warnings: Warnings,
}

/// The source as its writer needs it.
#[derive(Debug)]
pub enum Source {
    Gltf(gltf::GltfSource),
    Usd(usd::UsdSource),
}

impl Source {
    /// The scene file.
    pub fn path(&self) -> &Path {
        match self {
            Self::Gltf(source) => &source.path,
            Self::Usd(source) => &source.path,
        }
    }
}

impl Loaded {
    /// The scene file.
    pub fn path(&self) -> &Path {
        self.source.path()
    }
}

/// Turns the first warning about input that is missing or can't be read into an error.
///
/// # Errors
/// `Invalid` naming its place.
fn refuse_missing(warnings: &Warnings) -> Result<()> {
    let missing: Vec<_> = warnings.iter().filter(|w| w.is_missing).collect();
    let Some(first) = missing.first() else { return Ok(()) };
    let count: usize = missing.iter().map(|w| w.count).sum();
    let place = first.places.first().map_or("scene", String::as_str);
    let all = if count > 1 { format!(", the first of {count} such parts") } else { String::new() };
    Err(Error::invalid(place, format!("{} (--strict{all}; without it a warning)", first.message)))
}

/// Reads a scene of any format as it stands; see [`load_with`].
///
/// # Errors
/// As [`load_with`].
pub fn load(path: &Path) -> Result<Loaded> {
    load_with(path, &LoadOptions::default())
}

/// Reads a scene of any format, chosen by its extension: .gltf .glb .usd .usda .usdc .usdz.
///
/// # Errors
/// `Io` where a file can't be read, `Invalid` where it is broken, `Unsupported` for another extension; each names the file.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    if path.is_dir() {
        return Err(Error::invalid(path.display(), "is a directory; name the scene file in it"));
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let mut loaded = match extension.as_str() {
        "gltf" | "glb" => gltf::load(path, options)?,
        "usd" | "usda" | "usdc" | "usdz" => {
            let mut loaded = usd::load(path, options)?;
            if options.animation.is_some() {
                loaded.warnings.add(path.display(), "a USD stage has one timeline; the animation's name was ignored");
            }
            loaded
        }
        _ => {
            let message = "is not a scene format that can be read (.gltf .glb .usd .usda .usdc .usdz)";
            return Err(Error::unsupported(path.display(), message));
        }
    };
    if options.strict {
        refuse_missing(&loaded.warnings)?;
    }
    let place = path.display().to_string();
    options.edits.apply(&mut loaded.scene, &place, &mut loaded.warnings)?;
    validate(&mut loaded.scene, &place, &mut loaded.warnings)?;
    Ok(loaded)
}
