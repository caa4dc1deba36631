//! The data's way from file to files, in order: load, unwrap, [`illuminate`] (rasterize, direct, exchange, post), write.

mod mix;
mod only;
mod pages;
mod remembered;
mod verify;

pub use mix::{Weight, mix};
use remembered::{Remembered, relit};

use crate::added_light;
use crate::blocks::PARTS;
use crate::color::luminance;
use crate::error::{Error, Result};
use crate::folder;
use crate::illuminate::{Illuminated, illuminate_only, illuminate_with, needs_walks, share};
use crate::inspect::doubts;
use crate::light::mask::{MOST_MASKS, masked_lights};
use crate::limits;
use crate::load::{self, Loaded};
use crate::meshing::{self, MeshMode, VertexLight, VertexReport, vertex_light};
use crate::patch::Patches;
use crate::patch::reflectance::{MOST_ALBEDO, too_white};
use crate::patch::unocclude::Exposure;
use crate::post::{LayerKind, Lightmap};
use crate::probe::LightProbes;
use crate::progress::Progress;
use crate::report::{Clock, ErrorReport, Input, SolverReport, peak_memory, refuse_other_bake};
use crate::scatter;
use crate::scene::Scene;
use crate::settings::{Gather, Method, RESIDUAL, Settings};
use crate::store::FolderLock;
use crate::transport::Method as FormFactors;
use crate::unwrap::{self, Atlas};
use crate::view_factors::{Figures, view_factors};
use crate::write::{self, Baked, BakedLights, GltfProfile, output::Staging, view_factors::refuse_other, watch};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

pub use crate::report::Report;

/// The share of the light that may be missing or too much before a bake is called into question.
const MOST_IMBALANCE: f64 = 0.02;

/// The share of the light that may be lost on mirrors and glass before it is said.
const MOST_LOST: f64 = 0.002;

/// Samples a texel below which the energy balance is too noisy to call a bake into question.
const LEAST_SAMPLES: u32 = 64;

/// Bakes the scene file `scene` into the folder `folder`.
///
/// # Errors
/// Those of the stages; nothing is written unless the whole bake succeeds.
pub fn bake(scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let (clock, start) = (Clock::new(progress), SystemTime::now());
    let (mut report, mut loaded, _lock) = open(scene, folder, settings, &clock)?;
    refuse_darkness(&loaded, settings)?;
    let selected = if settings.only.is_empty() { None } else { Some(only::select(&loaded.scene, &settings.only)?) };
    // Too many probes are found out now, too.
    settings.probe_params(&loaded.scene)?;
    if let Some(folder) = &settings.watch {
        watch::clear(folder)?;
    }
    let remembered = Remembered::open(scene, settings)?;
    let as_before = settings.relight.is_some() || selected.is_some();
    let (atlas, places) = remembered.lay_out(&loaded, settings, as_before, &clock, &mut report)?;
    let earlier = selected.map(|selected| only::earlier(folder, &loaded.scene, &atlas, &selected, settings));
    let earlier = earlier.transpose()?;
    if earlier.is_some() {
        for name in remembered.changed(&loaded.scene, &atlas) {
            report.warnings.add(name, "has come, moved or changed since all was baked; shadows and light on kept texels are as they were then");
        }
    }
    if needs_walks(&loaded.scene, settings) {
        scatter::adapt(&mut loaded.scene, settings.surfaces);
    }
    if settings.caustics {
        scatter::adapt_for_caustics(&mut loaded.scene);
    }
    let work = remembered.work(&loaded.scene, &atlas, settings);
    let settings = &relit(settings, &work, &loaded)?;
    report.relit = settings.relight.as_ref().map(|relight| relight.baked.clone());
    if settings.shard.is_some() {
        share(&loaded.scene, &atlas, settings, &work, &clock)?;
        report.warnings.extend(remembered.store.take_warnings());
        report.reused.extend(work.tally());
        report.stages = clock.stages();
        return Ok(report);
    }
    let lit = match &earlier {
        None => illuminate_with(&loaded.scene, &atlas, settings, &work, &clock)?,
        Some(earlier) => illuminate_only(&loaded.scene, &atlas, settings, &earlier.bake, &work, &clock)?,
    };
    if earlier.is_none() {
        work.forget_parts(PARTS);
        remembered.keep_state((&loaded.scene, &atlas, &lit.patches), places, settings);
        remembered.prune(start, settings);
    }
    report.warnings.extend(remembered.store.take_warnings());
    report.reused.extend(work.tally());
    describe_light(&mut report, &lit, settings);
    report.warnings.extend(doubts(&loaded.scene));
    warn_of_light(&loaded.scene, &lit, &mut report, settings);
    let settings = &match &earlier {
        // What is kept may be more than half floats hold.
        Some(earlier) => Settings { float: settings.float || earlier.is_float, ..settings.clone() },
        None => settings.clone(),
    };
    report.settings.float = settings.float;
    if let Some(earlier) = &earlier {
        only::describe(&mut report, &earlier.bake, &lit, settings);
    }
    let known = earlier.map_or(Vec::new(), |earlier| earlier.bake.known);
    let estimated = verify::estimated(&lit);
    // Nothing else of the light is needed any more.
    let (patches, exposure, lightmap, probes) = lit.into_shown();
    if settings.verify && (settings.relight.is_some() || !known.is_empty() || work.has_reused()) {
        let (patches, exposure, lightmap) = (&patches, &exposure, &lightmap);
        let baked = verify::Baked {
            scene: &loaded.scene,
            atlas: &atlas,
            patches,
            exposure,
            lightmap,
            known: &known,
            estimated,
        };
        let verified = verify::verify(&baked, settings, &clock)?;
        report.warnings.extend(verified.warning());
        report.verified = Some(verified);
    }
    let shown = Shown { patches: &patches, exposure: &exposure, lightmap: &lightmap, probes: &probes };
    finish(&loaded, &atlas, Some(shown), folder, settings, &clock, report)
}

/// Says in `report` how the light was found.
fn describe_light(report: &mut Report, lit: &Illuminated, settings: &Settings) {
    report.texels = lit.patches.len();
    report.buried_texels = lit.exposure.buried_count();
    let of_light = lit.direct.rays + lit.solution.rays + lit.gathered.rays;
    report.rays = lit.exposure.rays + of_light + lit.layer_rays + lit.probes.rays;
    report.noise = lit.gathered.noise;
    report.solver = solver_report(lit, settings);
    report.error = lit.exchanged.map(|e| ErrorReport {
        aimed: 100.0 * settings.block_params().error,
        estimated: 100.0 * e.noise.hypot(e.bias),
        noise: 100.0 * e.noise,
        bias: 100.0 * e.bias,
        is_rough: e.is_rough(settings.block_params().error),
    });
    report.denoise = lit.denoised.clone();
    report.seams = (lit.seams.texels > 0.0).then_some(lit.seams);
    report.energy = lit.energy;
    report.describe_probes(&lit.probes);
}

/// Says where the light is not what it seems.
fn warn_of_light(scene: &Scene, lit: &Illuminated, report: &mut Report, settings: &Settings) {
    if lit.solution.blocked_share > 0.0 {
        let message =
            "analytic form factors know no occluders, and light goes through these; choose --form-factors area";
        let share = 100.0 * lit.solution.blocked_share;
        report.warnings.add(format!("{share:.2} % of the ways between elements are blocked"), message);
    }
    for material in too_white(scene) {
        report.warnings.add(&material.name, format!("an albedo above {MOST_ALBEDO} was baked as {MOST_ALBEDO}"));
    }
    if settings.gather() == Gather::None && scene.surfaces.iter().any(|s| !s.role.casts) {
        report
            .warnings
            .add("gather none", "objects that don't cast have no elements to read; they show direct light alone");
    }
    warn_of_panes(scene, report, settings);
    warn_of_masks(scene, report, settings);
    warn_of_doubts(report, settings);
    warn_of_idle_settings(scene, report, settings);
}

/// Refuses a scene in which nothing shines: unless its lights are left to the engine, and layers such as shadow masks are wanted.
///
/// # Errors
/// `Invalid`.
pub(crate) fn refuse_darkness(loaded: &Loaded, settings: &Settings) -> Result<()> {
    let scene = &loaded.scene;
    let is_live = !scene.lights.is_empty() || scene.environment.is_some();
    let message = match (scene.has_light(), is_live, settings.layers.is_empty()) {
        (true, ..) | (false, true, false) => return Ok(()),
        (false, true, true) => "every light is dynamic, so that nothing would be baked; bake some, or ask for --layers",
        (false, false, _) => added_light::NO_LIGHT,
    };
    Err(Error::invalid(loaded.path().display(), message))
}

/// How the light between surfaces was solved; `None` where paths were traced.
fn solver_report(lit: &Illuminated, settings: &Settings) -> Option<SolverReport> {
    if settings.method != Method::Radiosity {
        return None;
    }
    if let Some(exchanged) = &lit.exchanged {
        return Some(SolverReport {
            name: "links",
            elements: exchanged.blocks,
            samples: exchanged.links,
            iterations: exchanged.sweeps,
            residual: exchanged.residual,
            ..SolverReport::default()
        });
    }
    let exchange = &lit.solution.exchange;
    Some(SolverReport {
        name: lit.solution.solver.name(),
        form_factors: settings.form_factors,
        elements: lit.elements.len(),
        samples: lit.solution.segments,
        iterations: exchange.iterations,
        residual: exchange.residual,
        unshot: exchange.unshot,
        links: exchange.links,
        steps: exchange.steps.clone(),
    })
}

/// Says what light between elements takes for other than it is: rays alone know sheets and their colours.
fn warn_of_panes(scene: &Scene, report: &mut Report, settings: &Settings) {
    if settings.method != Method::Radiosity || settings.gather() == Gather::Blocks {
        return;
    }
    let is_solid = matches!(settings.form_factors, FormFactors::Analytic | FormFactors::Hemicube);
    let used = scene.surfaces.iter().flat_map(|s| &scene.meshes[s.mesh].triangle_material);
    let used: std::collections::BTreeSet<u32> = used.copied().collect();
    for material in used.into_iter().map(|m| &scene.materials[m as usize]).filter(|m| m.lets_light_through()) {
        if is_solid {
            let message = "lets light through, but is solid to these form factors; choose --form-factors area";
            report.warnings.add(&material.name, message);
        } else if material.transmission.max_element() > 0.0 {
            let message =
                "light between elements passes it without its colour; choose --gather blocks, or --method path";
            report.warnings.add(&material.name, message);
        }
    }
}

/// Says which lights have no shadow mask as there are too many, or that there are none at all.
fn warn_of_masks(scene: &Scene, report: &mut Report, settings: &Settings) {
    if settings.layers.contains(&LayerKind::ShadowMasks) {
        let (masked, beyond) = masked_lights(scene);
        if masked.is_empty() {
            report.warnings.add("shadow-masks", "no light of the scene has a shadow mask; there are none in the pages");
        }
        for light in beyond {
            let message = format!("has no shadow mask: there are more than {MOST_MASKS}; choose by shadow-mask");
            report.warnings.add(&scene.lights[light].name, message);
        }
    }
}

/// Says which settings did nothing.
fn warn_of_idle_settings(scene: &Scene, report: &mut Report, settings: &Settings) {
    // The sun that settings add is in no file.
    if settings.lights == BakedLights::Remove && scene.lights.iter().all(|light| light.name == "--sun") {
        report.warnings.add("lights remove", "the scene has no lights that could be removed; it did nothing");
    }
    if settings.vertex_error.is_some() && settings.mesh == MeshMode::Given {
        let message =
            "is about meshes that follow the light and did nothing; choose the mesh adaptive or discontinuity";
        report.warnings.add("vertex-error", message);
    }
}

/// Says where a bake should not be trusted as it is.
fn warn_of_doubts(report: &mut Report, settings: &Settings) {
    let is_rough = |error: &&ErrorReport| settings.relight.is_some() && error.is_rough;
    if let Some(ErrorReport { aimed, estimated, .. }) = report.error.as_ref().filter(is_rough) {
        let message = "what blocks saw in the light of the bake tells less of this one than was asked for, over all or where there was little \
                       light before; a bake with these lights looks closer";
        report.warnings.add(format!("estimated error {estimated:.2} % ({aimed} % was asked for)"), message);
    }
    let is_free = settings.max_bounces.is_none() && settings.iterations.is_none();
    if let Some(residual) = report.solver.as_ref().map(|s| s.residual).filter(|r| is_free && *r > RESIDUAL) {
        let message = "the solver stopped before it converged; albedos this high keep light for very long";
        report.warnings.add(format!("residual {:.2} %", 100.0 * residual), message);
    }
    if report.energy.lost_share() > MOST_LOST {
        let message = "ends on mirrors and glass: beside --caustics those that are double-sided mirrors, and all under a sky, are black to what \
                       comes to them off other surfaces; --method photon or path sends it on";
        report.warnings.add(format!("up to {:.1} % of the light", 100.0 * report.energy.lost_share()), message);
    }
    // Where light escapes is seen by the same samples: few of them say little.
    let is_sampled = settings.samples.is_none_or(|n| n >= LEAST_SAMPLES);
    if is_free && is_sampled && report.energy.imbalance.abs() > MOST_IMBALANCE {
        let message = "the energy balance does not close: look at the pages, and try a higher density or quality";
        report.warnings.add(format!("balance {:+.1} %", 100.0 * report.energy.imbalance), message);
    }
}

/// Makes lightmap UVs for the scene file `scene` and writes them into the folder `folder`, without light.
///
/// # Errors
/// As [`bake`].
pub fn unwrap(scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let clock = Clock::new(progress);
    let (mut report, loaded, _lock) = open(scene, folder, settings, &clock)?;
    let remembered = Remembered::open(scene, &Settings { cache: None, ..settings.clone() })?;
    let (atlas, _) = remembered.lay_out(&loaded, settings, false, &clock, &mut report)?;
    finish(&loaded, &atlas, None, folder, settings, &clock, report)
}

/// Finds the form factors of the scene file `scene` and writes them to the file `output`.
///
/// # Errors
/// Those of the stages; `Invalid` where `output` is one of the inputs, or holds something else that isn't to be overwritten.
pub fn form_factors(scene: &Path, output: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Figures> {
    settings.check()?;
    let params = settings.view_factor_params()?;
    if !settings.only.is_empty() {
        let message =
            "selects whose light is baked, and form factors are between all objects; leave it out, or objects by skip";
        return Err(Error::invalid("only", message));
    }
    refuse_input(output, scene)?;
    refuse_other(output, scene, settings.overwrite)?;
    let file = output.file_name().ok_or_else(|| Error::invalid(output.display(), "is no file; give one with -o"))?;
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::invalid(folder.display(), "is no folder; make it first, or give another file with -o"));
    }
    progress.begin("load", 0);
    let mut loaded = load::load_with(scene, &settings.load_options())?;
    keep_casters(&mut loaded)?;
    limits::check_form_factors(&loaded, None, params.elements, settings)?;
    loaded.inputs.iter().try_for_each(|input| refuse_input(output, input))?;
    // A folder that can't be written is found out now, not after hours of work.
    Staging::new(folder)?;
    let (atlas, of_atlas) = unwrap::unwrap(&loaded.scene, &settings.unwrap_params(), progress)?;
    limits::check_form_factors(&loaded, Some(&atlas), params.elements, settings)?;
    let found = view_factors(&loaded.scene, &atlas, &params, progress)?;
    progress.begin("write", 0);
    let mut staging = Staging::new(folder)?;
    write::view_factors::write(&staging.path(file)?, scene, &found)?;
    progress.check()?;
    staging.commit()?;
    let mut figures = found.figures();
    let mut warnings = loaded.warnings;
    warnings.extend(of_atlas);
    warnings.extend(std::mem::take(&mut figures.warnings));
    Ok(Figures { warnings, ..figures })
}

/// Leaves surfaces that don't cast out of what form factors are of: nothing lands on them.
fn keep_casters(loaded: &mut Loaded) -> Result<()> {
    let keep: Vec<bool> = loaded.scene.surfaces.iter().map(|s| s.role.casts).collect();
    if !keep.contains(&true) {
        let message = "no surface casts, and form factors are between those that do; leave out casts = false";
        return Err(Error::invalid(loaded.path().display(), message));
    }
    for surface in loaded.scene.surfaces.iter().filter(|s| !s.role.casts) {
        loaded.warnings.add(&surface.name, "a surface that doesn't cast has no form factors and was left out");
    }
    loaded.scene.retain_surfaces(&keep);
    // Without light there is nothing to show, only elements: all surfaces have them alike.
    loaded.scene.surfaces.iter_mut().for_each(|s| (s.role.receives, s.role.lightmapped) = (true, true));
    Ok(())
}

/// Refuses an output that is one of the inputs, whatever its name.
fn refuse_input(output: &Path, input: &Path) -> Result<()> {
    match (output.canonicalize(), input.canonicalize()) {
        (Ok(a), Ok(b)) if a == b => {
            Err(Error::invalid(input.display(), "would be replaced by the result; give another file with -o"))
        }
        _ => Ok(()),
    }
}

/// The output folder, held for this process alone. A folder in which nothing came to lie goes with it.
struct Held {
    lock: Option<FolderLock>,
    folder: PathBuf,
}

impl Drop for Held {
    fn drop(&mut self) {
        drop(self.lock.take());
        // One that isn't empty stays.
        let _ = std::fs::remove_dir(&self.folder);
    }
}

/// Holds the output folder. One that can't be written to is found out now, not after hours of work.
fn hold(folder: &Path) -> Result<Held> {
    let lock = match std::fs::create_dir_all(folder) {
        Ok(()) => FolderLock::acquire(folder),
        Err(e) => Err(Error::io(folder, e)),
    };
    match lock {
        // Staging says what to do about it.
        Err(error @ Error::Io { .. }) => Err(Staging::new(folder).err().unwrap_or(error)),
        Err(error) => Err(error),
        Ok(lock) => {
            let held = Held { lock: Some(lock), folder: folder.to_path_buf() };
            Staging::new(folder).map(|_| held)
        }
    }
}

/// Checks the settings, reads the scene and adds the sky that the settings ask for. The output folder is held, unless nothing is
/// written there.
fn open(scene: &Path, folder: &Path, settings: &Settings, clock: &Clock) -> Result<(Report, Loaded, Option<Held>)> {
    settings.check()?;
    refuse_other_bake(scene, folder, settings.overwrite)?;
    clock.begin("load", 0);
    let mut loaded = load::load_with(scene, &settings.load_options())?;
    let lock = if settings.shard.is_none() { Some(hold(folder)?) } else { None };
    added_light::add(&mut loaded, settings)?;
    limits::check_scene(&loaded, settings)?;
    let mut inputs = vec![Input::new(scene.to_path_buf())];
    inputs.extend(loaded.inputs.iter().filter(|p| *p != scene).cloned().map(Input::new));
    let warnings = std::mem::take(&mut loaded.warnings);
    let version = env!("CARGO_PKG_VERSION");
    Ok((Report { version, inputs, settings: settings.clone(), warnings, ..Report::default() }, loaded, lock))
}

/// What files show of the light.
#[derive(Clone, Copy)]
struct Shown<'a> {
    patches: &'a Patches,
    exposure: &'a Exposure,
    lightmap: &'a Lightmap,
    probes: &'a LightProbes,
}

/// The light at vertices, where a file holds it.
fn light_vertices(
    loaded: &Loaded,
    atlas: &Atlas,
    lit: Shown,
    settings: &Settings,
    clock: &Clock,
) -> Result<Option<(VertexLight, VertexReport)>> {
    let is_usd = matches!(loaded.source, load::Source::Usd(_));
    if !is_usd && !settings.gltf_profiles().contains(&GltfProfile::Vertex) {
        return Ok(None);
    }
    let patches = lit.patches;
    let is_buried = |page: usize, texel: usize| patches.at(page, texel).is_some_and(|i| lit.exposure.is_buried(i));
    let shown = |i: &usize| !lit.exposure.is_buried(*i);
    let (light, area) = (0..patches.len()).filter(shown).fold((0.0, 0.0), |(light, area), i| {
        let [page, texel] = patches.texel(i).map(|n| n as usize);
        let page = lit.lightmap.pages.get(page);
        let value = page.map_or(0.0, |page| luminance(page.rgb[texel]));
        let a = f64::from(patches.area[i]);
        (light + a * f64::from(value), area + a)
    });
    let mean = if area > 0.0 { (light / area) as f32 } else { 0.0 };
    let source = meshing::Source { scene: &loaded.scene, atlas, lightmap: lit.lightmap, is_buried: &is_buried, mean };
    vertex_light(&source, &settings.mesh_params(), clock).map(Some)
}

/// Writes everything, the report last.
fn finish(
    loaded: &Loaded,
    atlas: &Atlas,
    lit: Option<Shown>,
    folder: &Path,
    settings: &Settings,
    clock: &Clock,
    mut report: Report,
) -> Result<Report> {
    let lightmap = lit.map(|lit| lit.lightmap);
    let vertices = lit.map(|lit| light_vertices(loaded, atlas, lit, settings, clock)).transpose()?.flatten();
    let vertices = vertices.map(|(vertices, of_vertices)| {
        if let Some(most) = settings.max_triangles.filter(|most| *most < of_vertices.given_triangles) {
            let message =
                "fewer than the meshes have as they are, and none of those is taken away: no triangle was cut";
            report.warnings.add(format!("max-triangles {most} (given: {})", of_vertices.given_triangles), message);
        }
        report.vertices = Some(of_vertices);
        vertices
    });
    clock.begin("write", 0);
    let encoded = folder::encoded(loaded.path(), atlas, lightmap, settings);
    let page_uris = folder::page_uris(&encoded);
    let baked = Baked {
        scene: &loaded.scene,
        source: &loaded.source,
        atlas,
        lightmap,
        vertices: vertices.as_ref(),
        quantity: settings.quantity,
        page_uris: &page_uris,
        encoded: &encoded,
        vertex_colors: settings.vertex_colors,
        lightmap_extension: settings.gltf_lightmap_ext,
        folder,
        lights: settings.lights,
    };
    report.describe(&baked);
    let mut staging = folder::write(&baked, settings, clock, &mut report.warnings)?;
    if let Some(lit) = lit {
        folder::write_probes(lit.probes, &mut staging)?;
    }
    report.files = folder::retire(&baked, &report.inputs, &mut staging);
    report.stages = clock.stages();
    report.peak_memory_bytes = peak_memory();
    folder::commit(staging, &report, clock)?;
    Ok(report)
}
