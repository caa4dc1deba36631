//! USD reader: .usda, .usdc, .usd and .usdz, composed by the openusd crate, into a scene.
//!
//! What is read, at the default time: meshes (polygons triangulated, every UV primvar, normals, display colours),
//! GeomSubsets, materials (UsdPreviewSurface, and the base colour and emission of others), native and point instances,
//! UsdLux lights. What is met and not read is a counted warning with its prim path.
//!
//! The stage's unit and up axis are folded into transforms; mesh positions stay as authored. UVs are flipped to v down.

mod binding;
mod dome;
mod instancer;
mod light;
mod link;
mod material;
mod mesh;
mod network;
mod polygon;
mod primvar;
mod read;
mod shaping;
mod surface;
mod texture;
mod walk;
mod xform;

use super::{LoadOptions, Loaded, Source};
use crate::error::{Error, Result};
use openusd::{ar, pcp, usd};
use std::path::{Path, PathBuf};

/// What the layer writer needs of the stage that was read.
#[derive(Debug)]
pub struct UsdSource {
    /// The root layer's file.
    pub path: PathBuf,
}

/// Stack of the reading thread [bytes]: parsing and composition recurse over the namespace, and a deep one must not end
/// the process. Untouched pages cost nothing.
const STACK: usize = 512 << 20;

/// Reads a .usd, .usda, .usdc or .usdz stage.
///
/// # Errors
/// `Io` where the file can't be read, `Invalid` where it is no USD file; both name it. A broken reference, payload or
/// sublayer is a warning.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    std::fs::File::open(path).map_err(|error| Error::io(path, error))?;
    // The one place where a panic of the openusd crate on a malformed file becomes an error: `join` returns it.
    let reader = std::thread::Builder::new().name("usd reader".into()).stack_size(STACK);
    let thread = std::thread::scope(|scope| {
        let handle =
            reader.spawn_scoped(scope, || read_stage(path, options)).map_err(|error| Error::io(path, error))?;
        handle
            .join()
            .map_err(|_| Error::invalid(path.display(), "the USD reader failed on this file; check it with usdchecker"))
    });
    thread?
}

fn read_stage(path: &Path, _options: &LoadOptions) -> Result<Loaded> {
    let name = path.to_str().ok_or_else(|| Error::invalid(path.display(), "the path is not UTF-8; rename the file"))?;
    // One scope keeps a package's directory open for all of its layers and textures.
    let _scope = ar::CacheScope::begin();
    let stage = usd::Stage::builder()
        .schema_registry(openusd_schemas::schema_registry())
        .open(name)
        .map_err(|error| open_error(path, error))?;
    let mut walk = walk::Walk::new(stage.clone());
    walk.run();
    let walk::Output { scene, mut warnings, textures } = walk.finish();
    for error in stage.composition_errors() {
        report(&error, &mut warnings);
    }
    let mut inputs: Vec<PathBuf> = Vec::new();
    let layers = stage.layer_identifiers().into_iter().map(|id| package_file(&id));
    for input in layers.chain(textures) {
        if !inputs.contains(&input) && input.is_file() {
            inputs.push(input);
        }
    }
    Ok(Loaded { scene, source: Source::Usd(UsdSource { path: path.to_owned() }), inputs, warnings })
}

/// The file that holds `asset`, which may lie in a package: `a.usdz[b.usdc]` is in `a.usdz`.
fn package_file(asset: &str) -> PathBuf {
    match ar::split_package_relative_path_outer(asset) {
        Some((package, _)) => PathBuf::from(package),
        None => PathBuf::from(asset),
    }
}

fn open_error(path: &Path, error: openusd::Error) -> Error {
    match error {
        openusd::Error::Io(source) => Error::io(path, source),
        error => {
            let mut message = error.to_string();
            let mut source = std::error::Error::source(&error);
            while let Some(cause) = source {
                message = format!("{message}: {cause}");
                source = cause.source();
            }
            // The parser draws the source line; one line is enough here.
            let message: Vec<&str> = message.split_whitespace().collect();
            Error::invalid(path.display(), format!("is no sound USD file: {}", message.join(" ")))
        }
    }
}

/// A composition error as a warning that names the asset and the prim.
fn report(error: &pcp::CompositionDiagnostic, warnings: &mut crate::error::Warnings) {
    use pcp::CompositionDiagnostic as D;
    match error {
        D::UnresolvedLayer { asset_path, site_path, arc, .. } => {
            warnings.add(format!("{site_path}: {asset_path}"), format!("a {arc:?} names a file that was not found"));
        }
        D::MalformedLayer { asset_path, site_path, arc, reason, .. } => {
            let place = format!("{site_path}: {asset_path}: {reason}");
            warnings.add(place, format!("a {arc:?} could not be read"));
        }
        D::UnresolvedSublayer { asset_path, introduced_by } => {
            warnings.add(format!("{introduced_by}: {asset_path}"), "a sublayer was not found");
        }
        D::MalformedSublayer { asset_path, introduced_by, reason } => {
            warnings.add(format!("{introduced_by}: {asset_path}: {reason}"), "a sublayer could not be read");
        }
        other => warnings.add("composition", other),
    }
}
