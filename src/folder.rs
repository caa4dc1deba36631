//! The output folder: which files a bake leaves, and their names.

use crate::error::{Error, Result, Warnings};
use crate::load::Source;
use crate::meshing::LitMesh;
use crate::post::{Layer, Lightmap};
use crate::probe::LightProbes;
use crate::progress::Progress;
use crate::report::{Input, Report};
use crate::settings::Settings;
use crate::unwrap::Atlas;
use crate::write::encode::{self, Encoded, Encoding};
use crate::write::exr::{PageHeader, PageLayer, exceeds_half, write_page};
use crate::write::output::Staging;
use crate::write::{self, Baked, GltfProfile, engines, gltf, usd};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What follows the scene's name in those of its files beside the pages.
const SUFFIXES: [&str; 5] = [GLB, VERTEX_GLB, LAYER, VERTEX_LAYER, NOTE];
const GLB: &str = "glb";
const VERTEX_GLB: &str = "vertex.glb";
const LAYER: &str = "lumel.usda";
const VERTEX_LAYER: &str = "vertex.usda";
const NOTE: &str = "loading.txt";

/// The name of the scene's file with the suffix `suffix`.
fn named(scene: &Path, suffix: &str) -> String {
    format!("{}.{suffix}", stem(scene))
}

/// The scene file's name without its extension.
fn stem(scene: &Path) -> String {
    scene.file_stem().map_or_else(|| "scene".to_string(), |s| s.to_string_lossy().into_owned())
}

/// The forms that the pages of a bake are written in, with their files relative to the output folder; none for an unwrap without
/// light.
pub fn encoded(scene: &Path, atlas: &Atlas, lightmap: Option<&Lightmap>, settings: &Settings) -> Vec<Encoded> {
    let Some(lightmap) = lightmap else { return Vec::new() };
    let pages = lightmap.pages.iter().take(atlas.shown_pages);
    let values = pages.flat_map(|p| &p.rgb).flat_map(|c| c.to_array());
    let largest = values.filter(|v| v.is_finite()).fold(0.0, f32::max);
    let form = |encoding: Encoding| {
        let uri = |page| format!("lightmaps/{}_{page}.{}", stem(scene), encoding.suffix());
        Encoded { encoding, scale: encoding.scale(largest), uris: (0..atlas.shown_pages).map(uri).collect() }
    };
    settings.encodings().into_iter().map(form).collect()
}

/// The page files that GLB and layer name: OpenEXR, else the first plain form, else the first.
pub fn page_uris(encoded: &[Encoded]) -> Vec<String> {
    let rank = |e: &&Encoded| (e.encoding != Encoding::Exr, !e.encoding.is_plain());
    encoded.iter().min_by_key(rank).map(|e| e.uris.clone()).unwrap_or_default()
}

/// What writes a USD layer.
type LayerWriter = fn(&Path, &Baked) -> Result<Warnings>;

/// Writes the pages, GLBs and the USD layers of a bake into a staging folder.
///
/// # Errors
/// Those of the writers, and `Cancelled`; nothing is left in the output folder then.
pub fn write(baked: &Baked, settings: &Settings, progress: &dyn Progress, warnings: &mut Warnings) -> Result<Staging> {
    let mut staging = Staging::new(baked.folder)?;
    let scene = baked.source.path();
    let mut pages = Vec::new();
    for form in baked.encoded {
        pages.push((form, form.uris.iter().map(|uri| staging.path(uri)).collect::<Result<Vec<PathBuf>>>()?));
    }
    if let Some(engine) = settings.engine.filter(|_| baked.lightmap.is_some()) {
        let glb = settings.gltf_profiles().contains(&GltfProfile::Engine).then(|| named(scene, GLB));
        let path = staging.path(named(scene, NOTE))?;
        let is_bright = |lightmap: &Lightmap| (0..lightmap.pages.len()).any(|page| exceeds_half(lightmap, page));
        let told = engines::Told {
            glb: glb.as_deref(),
            float: settings.float || baked.lightmap.is_some_and(is_bright),
            directional: settings.directional,
            probes: settings.probes.is_some(),
        };
        std::fs::write(&path, engines::note(engine, baked, &told)).map_err(|e| Error::io(&path, e))?;
    }
    let mut glbs = Vec::new();
    for profile in settings.gltf_profiles() {
        let file = match profile {
            GltfProfile::Engine => named(scene, GLB),
            // Without light there are no colours to write.
            GltfProfile::Vertex if baked.vertices.is_none() => continue,
            GltfProfile::Vertex => named(scene, VERTEX_GLB),
        };
        glbs.push((*profile, staging.path(file)?));
    }
    let mut layers: Vec<(LayerWriter, PathBuf)> = Vec::new();
    if let Source::Usd(_) = baked.source {
        layers.push((usd::write, staging.path(named(scene, LAYER))?));
        if baked.vertices.is_some_and(|v| !v.surfaces.iter().all(LitMesh::is_given)) {
            layers.push((usd::write_refined, staging.path(named(scene, VERTEX_LAYER))?));
        }
    }
    let write_glb = |(profile, path): &(GltfProfile, PathBuf)| {
        progress.check()?;
        gltf::write(path, baked, *profile)
    };
    let write_layer = |(write, path): &(LayerWriter, PathBuf)| {
        progress.check()?;
        write(path, baked)
    };
    let (of_pages, (of_glbs, of_layers)) = rayon::join(
        || write_pages(baked, &pages, settings, progress),
        || {
            rayon::join(
                || glbs.par_iter().map(write_glb).collect::<Result<Vec<Warnings>>>(),
                || layers.par_iter().map(write_layer).collect::<Result<Vec<Warnings>>>(),
            )
        },
    );
    warnings.extend(of_pages?);
    of_glbs?.into_iter().chain(of_layers?).for_each(|of_file| warnings.extend(of_file));
    Ok(staging)
}

/// Writes the pages in all of their forms, one after the other: a page is held once more while it is written.
fn write_pages(
    baked: &Baked,
    forms: &[(&Encoded, Vec<PathBuf>)],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Warnings> {
    let mut warnings = Warnings::default();
    let Some(lightmap) = baked.lightmap else { return Ok(warnings) };
    for (form, paths) in forms {
        for (number, (page, path)) in lightmap.pages.iter().zip(paths).enumerate() {
            progress.check()?;
            let place = |misfits: usize| format!("{} ({misfits} texels)", form.uris[number]);
            if form.encoding == Encoding::Exr {
                let clamped = write_exr(baked, lightmap, number, path, settings)?;
                if clamped > 0 {
                    warnings.add(place(clamped), "not a number: 0 was written");
                }
                continue;
            }
            let header =
                encode::Header { quantity: baked.quantity, scale: form.scale, levels: settings.mips.unwrap_or(1) };
            let misfits = encode::write_page(path, page, form.encoding, &header)?;
            if misfits > 0 {
                let message =
                    format!("not a value that {} can hold: the closest one was written", form.encoding.name());
                warnings.add(place(misfits), message);
            }
        }
    }
    Ok(warnings)
}

/// Layer `layer` of page `page`.
fn page_layer(layer: &Layer, page: usize) -> PageLayer<'_> {
    let Layer { name, pages, channels, unit, .. } = layer;
    PageLayer { name, channels: *channels, unit, values: &pages[page] }
}

/// Writes page `number` with all layers, as 32-bit floats where half floats can't hold it; returns how many texels were no numbers.
fn write_exr(baked: &Baked, lightmap: &Lightmap, number: usize, path: &Path, settings: &Settings) -> Result<usize> {
    let scene = baked.source.path().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let header = PageHeader {
        quantity: baked.quantity,
        page: number as u32,
        density: baked.atlas.density,
        scene: &scene,
        directional: settings.directional,
    };
    let layers: Vec<PageLayer> = lightmap.layers.iter().map(|layer| page_layer(layer, number)).collect();
    let float = settings.float || exceeds_half(lightmap, number);
    write_page(path, &lightmap.pages[number], &layers, &header, float)
}

/// Writes the light probes into the staging folder, where there are any.
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

/// Lets the files of earlier runs go that this one doesn't replace: an engine would take them for its own. They are those that the
/// report in the output folder lists, by names that a bake of this scene gives, and none of the `inputs`: what is none of these is
/// somebody else's. Without light nothing goes, as pages take long to bake. Returns what the folder holds then, for the report.
pub fn retire(baked: &Baked, inputs: &[Input], staging: &mut Staging) -> Vec<String> {
    let mut files: Vec<String> = staging.files().map(|file| file.to_string_lossy().into_owned()).collect();
    let is_input = |file: &str| {
        let place = baked.folder.join(file).canonicalize().ok();
        place.is_some_and(|place| inputs.iter().any(|input| input.path.canonicalize().is_ok_and(|i| i == place)))
    };
    for file in earlier(baked.folder, &stem(baked.source.path())) {
        if files.contains(&file) || is_input(&file) {
            continue;
        }
        if baked.lightmap.is_some() {
            staging.remove(file);
        } else {
            files.push(file);
        }
    }
    files
}

/// The files of a scene named `stem` that the report in `folder` lists.
fn earlier(folder: &Path, stem: &str) -> Vec<String> {
    let text = std::fs::read(folder.join("report.json")).unwrap_or_default();
    let report: serde_json::Value = serde_json::from_slice(&text).unwrap_or_default();
    let listed = report["files"].as_array().into_iter().flatten().filter_map(|file| file.as_str());
    listed.filter(|file| is_of_a_bake(file, stem)).map(str::to_owned).collect()
}

/// True for the names, relative to the output folder, that [`write`] and [`write_probes`] give to files of a scene named `stem`.
fn is_of_a_bake(file: &str, stem: &str) -> bool {
    if write::probes::FILES.contains(&file) {
        return true;
    }
    if let Some(page) = file.strip_prefix("lightmaps/").and_then(|page| page.strip_prefix(stem)?.strip_prefix('_')) {
        let (number, suffix) = page.split_once('.').unwrap_or_default();
        let is_number = number.parse::<u32>().is_ok_and(|n| n.to_string() == number);
        return is_number && Encoding::ALL.iter().any(|encoding| encoding.suffix() == suffix);
    }
    let suffix = file.strip_prefix(stem).and_then(|rest| rest.strip_prefix('.'));
    suffix.is_some_and(|suffix| SUFFIXES.contains(&suffix))
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

#[cfg(test)]
mod tests {
    use super::is_of_a_bake;

    #[test]
    fn names_of_a_bake_are_told_from_others() {
        let own = ["a.b.glb", "a.b.vertex.usda", "lightmaps/a.b_0.exr", "lightmaps/a.b_12.rgbm-srgb.png", "probes.exr"];
        own.iter().for_each(|name| assert!(is_of_a_bake(name, "a.b"), "{name}"));
        let others = [
            "a.b.usda",
            "a.glb",
            "c.glb",
            "report.json",
            "lightmaps/a.b_01.exr",
            "lightmaps/a.b_.exr",
            "lightmaps/a.b_0.tif",
            "lightmaps/../a.b_0.exr",
            "lightmaps/a.b_0/../../x.exr",
            "../a.b.glb",
            "/a.b.glb",
            "",
        ];
        others.iter().for_each(|name| assert!(!is_of_a_bake(name, "a.b"), "{name}"));
    }
}
