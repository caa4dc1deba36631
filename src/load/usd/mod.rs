//! USD reader: .usda, .usdc, .usd and .usdz, composed by the openusd crate, into a scene.
//!
//! What is read, at the default time or the time code asked for: meshes (polygons triangulated, every UV primvar, normals,
//! display colours), subdivision surfaces (as cages, or refined), implicit shapes, GeomSubsets, skeletons and blend shapes,
//! materials (UsdPreviewSurface, and what is diffuse of others, UDIM included), native and point instances, UsdLux lights,
//! mesh lights, volumes. What is met and not read is a counted warning with its prim path.
//!
//! The stage's unit and up axis are folded into transforms; mesh positions stay as authored. UVs are flipped to v down.

mod appearance;
mod binding;
mod camera;
mod contribution;
mod crate_size;
mod dome;
mod geometry;
mod instancer;
mod light;
mod link;
mod material;
mod mesh;
mod network;
mod polygon;
mod primvar;
pub(crate) mod read;
pub mod resolver;
mod role;
mod shape;
mod shaping;
mod skel;
pub mod stage;
mod subdivision;
mod surface;
mod texture;
mod udim;
mod volume;
mod walk;
mod xform;

use super::access::Access;
use super::{LoadOptions, Loaded, Source};
use crate::error::{Error, Result};
use openusd::{ar, pcp};
use stage::VariantSelection;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What the layer writer needs of the stage that was read.
#[derive(Debug, Default)]
pub struct UsdSource {
    /// The root layer's file.
    pub path: PathBuf,
    /// The time code that was read; none: the default time.
    pub time: Option<f64>,
    /// Selections beside those of the files.
    pub variants: Vec<VariantSelection>,
    /// What may be read.
    pub access: Access,
    /// The meshes (indices into the scene's) whose faces are not their prim's own: implicit shapes and refined surfaces. Their
    /// triangles' `part` is the prim's own face, where it has any.
    pub remade: BTreeSet<usize>,
}

/// Stack of the reading thread [bytes]: parsing and composition recurse over the namespace, and a deep one must not end
/// the process. Untouched pages cost nothing.
const STACK: usize = 512 << 20;

/// Reads a .usd, .usda, .usdc or .usdz stage.
///
/// # Errors
/// `Io` where the file can't be read, `Invalid` where it is no USD file or has no such variant; both name it. A broken reference, payload or
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

fn read_stage(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let variants: Vec<VariantSelection> =
        options.variants.iter().map(|text| VariantSelection::parse(text)).collect::<Result<_>>()?;
    // One scope keeps a package's directory open for all of its layers and textures.
    let _scope = ar::CacheScope::begin();
    let access = Access::of_scene(path, options, false)?;
    let stage = stage::open(path, &variants, &access).or_else(|e| {
        access.finish()?;
        Err(e)
    })?;
    let mut walk = walk::Walk::new(stage.clone(), options, &access);
    walk.run();
    let walk::Output { scene, mut warnings, textures, remade } = walk.finish();
    // They come in any order.
    let mut errors: Vec<_> = stage.composition_errors().into_iter().collect();
    errors.sort_by_cached_key(ToString::to_string);
    errors.iter().for_each(|error| report(error, &mut warnings));
    access.finish()?;
    let mut inputs: Vec<PathBuf> = Vec::new();
    let layers = stage.layer_identifiers().into_iter().map(|id| package_file(&id));
    for input in layers.chain(textures) {
        if !inputs.contains(&input) && input.is_file() {
            inputs.push(input);
        }
    }
    let source = UsdSource { path: path.to_owned(), time: options.time, variants, access, remade };
    Ok(Loaded { scene, source: Source::Usd(source), inputs, warnings })
}

/// The file that holds `asset`, which may lie in a package: `a.usdz[b.usdc]` is in `a.usdz`.
fn package_file(asset: &str) -> PathBuf {
    match ar::split_package_relative_path_outer(asset) {
        Some((package, _)) => PathBuf::from(package),
        None => PathBuf::from(asset),
    }
}

/// A composition error as a warning that names the asset and the prim.
fn report(error: &pcp::CompositionDiagnostic, warnings: &mut crate::error::Warnings) {
    use pcp::CompositionDiagnostic as D;
    match error {
        D::UnresolvedLayer { asset_path, site_path, arc, .. } => {
            warnings.add_missing(
                format!("{site_path}: {asset_path}"),
                format!("a {arc:?} names a file that was not found"),
            );
        }
        D::MalformedLayer { asset_path, site_path, arc, reason, .. } => {
            let place = format!("{site_path}: {asset_path}: {reason}");
            warnings.add_missing(place, format!("a {arc:?} could not be read"));
        }
        D::UnresolvedSublayer { asset_path, introduced_by } => {
            warnings.add_missing(format!("{introduced_by}: {asset_path}"), "a sublayer was not found");
        }
        D::MalformedSublayer { asset_path, introduced_by, reason } => {
            warnings.add_missing(format!("{introduced_by}: {asset_path}: {reason}"), "a sublayer could not be read");
        }
        other => warnings.add("composition", other),
    }
}
