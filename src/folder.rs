//! The output folder: which files a bake leaves, and their names.

use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::load::Source;
use crate::probe::LightProbes;
use crate::progress::Progress;
use crate::report::Report;
use crate::settings::Settings;
use crate::unwrap::Atlas;
use crate::write::exr::{PageHeader, write_page};
use crate::write::output::Staging;
use crate::write::{self, Baked, GltfProfile, gltf, usd};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The scene file's name without its extension.
fn stem(scene: &Path) -> String {
    scene.file_stem().map_or_else(|| "scene".to_string(), |s| s.to_string_lossy().into_owned())
}

/// Page files relative to the output folder, in page order; none for an unwrap without light.
pub fn page_uris(scene: &Path, atlas: &Atlas, is_lit: bool) -> Vec<String> {
    let count = if is_lit { atlas.shown_pages } else { 0 };
    (0..count).map(|page| format!("lightmaps/{}_{page}.exr", stem(scene))).collect()
}

/// Writes the pages, GLBs and the USD layer of a bake into a staging folder.
///
/// # Errors
/// Those of the writers, and `Cancelled`; nothing is left in the output folder then.
pub fn write(baked: &Baked, settings: &Settings, progress: &dyn Progress, warnings: &mut Warnings) -> Result<Staging> {
    let mut staging = Staging::new(baked.folder)?;
    let scene = baked.source.path();
    let pages = baked.page_uris.iter().map(|uri| staging.path(uri)).collect::<Result<Vec<PathBuf>>>()?;
    let mut glbs = Vec::new();
    for profile in settings.gltf_profiles() {
        let file = match profile {
            GltfProfile::Engine => format!("{}.glb", stem(scene)),
            // Without light there are no colours to write.
            GltfProfile::Vertex if baked.corners.is_none() => continue,
            GltfProfile::Vertex => format!("{}.vertex.glb", stem(scene)),
        };
        glbs.push((*profile, staging.path(file)?));
    }
    let layer = match baked.source {
        Source::Usd(_) => Some(staging.path(format!("{}.lumel.usda", stem(scene)))?),
        _ => None,
    };
    let write_glb = |(profile, path): &(GltfProfile, PathBuf)| {
        progress.check()?;
        gltf::write(path, baked, *profile)
    };
    let (of_pages, (of_glbs, of_layer)) = rayon::join(
        || write_pages(baked, &pages, settings, progress),
        || {
            rayon::join(
                || glbs.par_iter().map(write_glb).collect::<Result<Vec<Warnings>>>(),
                || layer.as_ref().map(|path| usd::write(path, baked)).transpose(),
            )
        },
    );
    warnings.extend(of_pages?);
    of_glbs?.into_iter().chain(of_layer?).for_each(|of_file| warnings.extend(of_file));
    Ok(staging)
}

/// Writes the pages to `paths`, one after the other: a page is held once more while it is written.
fn write_pages(baked: &Baked, paths: &[PathBuf], settings: &Settings, progress: &dyn Progress) -> Result<Warnings> {
    let mut warnings = Warnings::default();
    let Some(lightmap) = baked.lightmap else { return Ok(warnings) };
    let scene = baked.source.path().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    for (number, (page, path)) in lightmap.pages.iter().zip(paths).enumerate() {
        progress.check()?;
        let header = PageHeader {
            quantity: baked.quantity,
            page: number as u32,
            density: baked.atlas.density,
            scene: &scene,
            directional: settings.directional,
        };
        let layers: Vec<(&str, &[Rgb])> =
            lightmap.layers.iter().map(|l| (l.name.as_str(), l.pages[number].as_slice())).collect();
        let clamped = write_page(path, page, &layers, &header, settings.float)?;
        if clamped > 0 {
            let uri = &baked.page_uris[number];
            warnings.add(format!("{uri} ({clamped} texels)"), "too bright for half floats; bake with --float");
        }
    }
    Ok(warnings)
}

/// Writes the light probes, where there are any, into the staging folder.
///
/// # Errors
/// Those of the writer.
pub fn write_probes(probes: &LightProbes, staging: &mut Staging) -> Result<()> {
    if probes.list.is_empty() {
        return Ok(());
    }
    let [json, exr] = write::probes::FILES;
    write::probes::write(&staging.path(json)?, &staging.path(exr)?, probes)
}

/// Adds the report and moves everything into place.
///
/// # Errors
/// `Io` naming the file, `Cancelled`.
pub fn commit(mut staging: Staging, report: &Report, progress: &dyn Progress) -> Result<()> {
    let path = staging.path("report.json")?;
    let text = serde_json::to_vec_pretty(report).map_err(|e| Error::invalid(path.display(), e))?;
    std::fs::write(&path, text).map_err(|e| Error::io(&path, e))?;
    progress.check()?;
    staging.commit()
}
