//! Selected objects baked anew (`--only`), beside those whose texels are kept as an earlier bake left them in the output folder.

use super::pages::Pages;
use crate::digest;
use crate::error::{Error, Result};
use crate::illuminate::Illuminated;
use crate::illuminate::only::{Earlier, lacks};
use crate::light::parts::parts;
use crate::load::pattern::{Pattern, near};
use crate::post::{Directional, LayerKind};
use crate::report::{OnlyReport, Report, place_in_report};
use crate::scene::{BakeMode, Scene};
use crate::settings::Settings;
use crate::unwrap::Atlas;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// An earlier bake, and how it was written.
pub(super) struct Kept {
    pub bake: Earlier,
    /// In 32-bit floats.
    pub is_float: bool,
}

/// Which surfaces of `scene` the patterns select.
///
/// # Errors
/// `Invalid` where one of them selects nothing, or all of them everything; where light is of no use as pages show it.
pub(super) fn select(scene: &Scene, patterns: &[String]) -> Result<Vec<bool>> {
    let mut selected = vec![false; scene.surfaces.len()];
    for text in patterns {
        let pattern = Pattern::new(text).map_err(|e| Error::invalid("only", format!("{text:?} {e}")))?;
        let mut found = false;
        for (selected, surface) in selected.iter_mut().zip(&scene.surfaces) {
            let holds = pattern.holds(&surface.name);
            (*selected, found) = (*selected || holds, found || holds);
        }
        if !found {
            let near = near(text, scene.surfaces.iter().map(|s| s.name.as_str()));
            return Err(Error::invalid("only", format!("{text} matches no object; {near}")));
        }
    }
    if !selected.contains(&false) {
        let message = format!("{} matches every object; bake all of them, without --only", patterns.join(", "));
        return Err(Error::invalid("only", message));
    }
    if parts(scene, false).iter().any(|part| part.mode == BakeMode::Indirect) {
        let message = "pages don't show the direct light of what is baked as indirect light alone, which the kept objects send on; \
                       bake all objects, without --only";
        return Err(Error::invalid("only", message));
    }
    Ok(selected)
}

/// The earlier bake in `folder`, of which the texels of all but the `selected` surfaces are kept. Surfaces that no written page shows are
/// baked in any case, as nothing tells their light.
///
/// # Errors
/// `Invalid` where there is none, or another one than `settings` ask for; `Io`.
pub(super) fn earlier(
    folder: &Path,
    scene: &Scene,
    atlas: &Atlas,
    selected: &[bool],
    settings: &Settings,
) -> Result<Kept> {
    let advice = "bake all objects with --encoding exr among others, then --only some";
    if !folder.join("report.json").is_file() {
        return Err(Error::invalid(
            folder.display(),
            "holds no bake whose texels could be kept; bake all objects first, without --only",
        ));
    }
    let read = Pages::read(folder, advice)?;
    check_settings(&read, folder, settings)?;
    let known: Vec<bool> = (0..selected.len()).map(|s| !selected[s] && atlas.is_shown(s)).collect();
    let as_before = lie_as_before(&read.report, scene, atlas);
    let sizes = &atlas.pages[..atlas.shown_pages];
    let fits = read.begin(sizes);
    let moved = (0..known.len()).find(|&s| known[s] && !(fits && as_before[s]));
    if let Some(surface) = moved {
        let message = format!(
            "its texels don't lie where the bake in {} has them: meshes, objects, resolution or what else decides on lightmap UVs have changed \
             since; bake all objects anew, without --only",
            folder.display()
        );
        return Err(Error::invalid(&scene.surfaces[surface].name, message));
    }
    let is_float = read.is_float();
    Ok(Kept { bake: Earlier { lightmap: read.into_lightmap(settings.quantity, sizes), known }, is_float })
}

/// Of each surface (index), whether its texels lie where the bake that `report` is of had those of one of its name.
fn lie_as_before(report: &Value, scene: &Scene, atlas: &Atlas) -> Vec<bool> {
    let listed = report["surfaces"].as_array().map_or(&[][..], Vec::as_slice);
    let told = |s: &Value| Some((s["name"].as_str()?.to_owned(), s["page"].as_u64()?, s["place"].as_str()?.to_owned()));
    let before: BTreeSet<(String, u64, String)> = listed.iter().filter_map(told).collect();
    let places = digest::places(scene, atlas).into_iter().map(place_in_report);
    let own = scene.surfaces.iter().zip(&atlas.placements).zip(places);
    own.map(|((s, placement), place)| before.contains(&(s.name.clone(), placement.page.into(), place))).collect()
}

/// Refuses pages that hold another thing than `settings` ask for.
fn check_settings(read: &Pages, folder: &Path, settings: &Settings) -> Result<()> {
    let before = &read.report["settings"];
    let now = serde_json::to_value(settings).map_err(|e| Error::invalid("settings", e))?;
    for key in ["quantity", "normals", "caustics"] {
        if before[key] != now[key] {
            let message = format!(
                "is {} in {}, and {} is asked for: texels side by side would hold different things; give it as it was, or bake all objects",
                before[key],
                folder.display(),
                now[key]
            );
            return Err(Error::invalid(key, message));
        }
    }
    let has = |name: &str| match name.strip_suffix('*') {
        Some(start) => read.names().any(|layer| layer.starts_with(start)),
        None => read.names().any(|layer| layer == name),
    };
    let of_kinds = settings.layers.iter().map(|kind| layer_name(*kind));
    let directional = match settings.directional {
        Directional::Off => None,
        Directional::Sh => Some("sh0"),
        Directional::Dominant => Some("dominant"),
    };
    match of_kinds.chain(directional).find(|name| !has(name)) {
        Some(name) => Err(lacks(name.trim_end_matches(".*"))),
        None => Ok(()),
    }
}

/// What layers of a kind are called: with a star where it begins the names of several.
fn layer_name(kind: LayerKind) -> &'static str {
    match kind {
        LayerKind::Direct => "direct",
        LayerKind::Indirect => "indirect",
        LayerKind::Caustics => "caustics",
        LayerKind::Bounces => "bounce0",
        LayerKind::Error => "error",
        LayerKind::Emission => "emission",
        LayerKind::Ao => "ao",
        LayerKind::BentNormal => "bent-normal",
        LayerKind::SkyVisibility => "sky-visibility",
        LayerKind::ShadowMasks => "shadow.*",
        LayerKind::LightGroups => "group.*",
    }
}

/// Says in `report` what of `lit` was baked and what was kept, and which layers went.
pub(super) fn describe(report: &mut Report, earlier: &Earlier, lit: &Illuminated, settings: &Settings) {
    let patches = &lit.patches;
    let kept = (0..patches.len()).filter(|&i| earlier.known[patches.surface(i) as usize]).count();
    report.only = Some(OnlyReport {
        patterns: settings.only.clone(),
        surfaces: earlier.known.iter().filter(|known| !**known).count(),
        baked_texels: patches.len() - kept,
        kept_texels: kept,
    });
    let is_left = |name: &str| lit.lightmap.layers.iter().any(|layer| layer.name == name);
    for layer in earlier.lightmap.layers.iter().filter(|layer| !is_left(&layer.name)) {
        report.warnings.add(&layer.name, "a layer of the bake before that isn't asked for now is left out");
    }
}
