//! Adaptive density: more texels where light varies, at the same number of texels in all.
//!
//! Adaptive meshing for radiosity (Cohen, Greenberg, Immel, Brock 1986; Lischinski, Tampieri, Greenberg 1992) refines the mesh where
//! the light that was found is not what its elements can show. Of a lightmap the charts are what can be refined: a quick bake finds
//! the light, [`detail`] tells what coarser texels would miss of it in each chart, and [`allot`] deals the texels out so that the
//! error over all charts is least. The unwrap stage packs the same charts a second time, by the factors that come of it
//! ([`crate::unwrap::Importance`]).
//!
//! Light alone counts: irradiance, not the albedo that it falls on. All instances of a mesh share their texels, and what they need on
//! average is what it gets. Authored UVs that are kept have one factor a mesh; where there are no others, nothing can be moved.
//!
//! Cost: a second unwrapping, and a bake of half the texels at a loose error.

pub mod allot;
pub mod detail;
pub mod kept;

use crate::error::{Result, Warnings};
use crate::illuminate::illuminate;
use crate::post::denoise::Denoise;
use crate::post::{Directional, LayerKind, seam::SeamMode};
use crate::progress::{Progress, Within};
use crate::scene::Scene;
use crate::settings::{Gather, Method, Quality, Settings};
use crate::solve::Solver;
use crate::transport::Method as FormFactors;
use crate::unwrap::{Atlas, Density, Importance, UnwrapParams, unwrap};
use allot::{Need, allot};
use detail::details;
use serde::Serialize;

/// Texels of the quick bake over those of the bake.
const QUICK_TEXELS: f64 = 0.5;

/// Share of a page that charts fill, about.
const FILLED: f64 = 0.8;

/// What the quick bake told.
#[derive(Clone, Debug, Serialize)]
pub struct AdaptiveReport {
    /// How far factors go of what the least error asks for, 0..=1.
    pub strength: f32,
    /// Texels of the quick bake, and the time that it took, its unwrapping included [s].
    pub quick_texels: usize,
    pub quick_s: f64,
    /// What texels are expected to miss of the light at an even density, and as they are dealt out: root mean square over the mean
    /// light, without what the worst 1 % of the area has beyond it [%].
    pub even_error: f64,
    pub error: f64,
    /// Texels per metre of the shown charts that came out.
    pub densities: Densities,
}

/// Texels per metre of charts: least, middle by area, most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Densities {
    pub charts: usize,
    pub least: f32,
    pub median: f32,
    pub most: f32,
}

/// The factors that `settings` ask for on the densities of the charts of `scene`, found by a quick bake. `None` where nothing can be
/// moved, with a warning.
///
/// # Errors
/// Those of the stages that a bake goes through; `Cancelled`.
pub fn adapt(
    scene: &Scene,
    settings: &Settings,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Option<(Importance, AdaptiveReport)>> {
    let strength = settings.adaptive_density.unwrap_or(0.0);
    if strength <= 0.0 {
        return Ok(None);
    }
    progress.begin("adapt", 0);
    let (start, quick) = (progress.elapsed(), Within(progress));
    let (atlas, _) = unwrap(scene, &quick_params(&settings.unwrap_params()), &quick)?;
    let is_movable = |m: usize| atlas.meshes[m].authored.is_none();
    if !scene.surfaces.iter().any(|s| s.role.is_shown() && is_movable(s.mesh)) {
        let message =
            "authored UVs stay as they are, so that no chart can be made denser; choose --uv new or --uv repack";
        warnings.add("adaptive-density", message);
        return Ok(None);
    }
    let lit = illuminate(scene, &atlas, &quick_settings(settings), &quick)?;
    let coarser = QUICK_TEXELS.sqrt();
    let found = details(scene, &atlas, &lit, coarser);
    let allotted = allot(&found, coarser);
    let factors = by_mesh(scene, &atlas, &found.needs, &allotted.factors, strength);
    let report = AdaptiveReport {
        strength,
        quick_texels: lit.patches.len(),
        quick_s: (progress.elapsed() - start).as_secs_f64(),
        even_error: 100.0 * allotted.even_error,
        error: 100.0 * allotted.error,
        densities: Densities::default(),
    };
    Ok(Some((Importance { factors }, report)))
}

/// A layout of fewer texels.
fn quick_params(params: &UnwrapParams) -> UnwrapParams {
    let (density, page_size) = match params.density {
        Density::TexelsPerMetre(density) => {
            (Density::TexelsPerMetre(density * QUICK_TEXELS.sqrt() as f32), params.page_size)
        }
        Density::TexelCount(count) => (Density::TexelCount((count as f64 * QUICK_TEXELS) as u64), params.page_size),
        Density::FillPage(side) => {
            let texels = QUICK_TEXELS * FILLED * f64::from(side).powi(2);
            (Density::TexelCount(texels as u64), side)
        }
    };
    let max_pages = if matches!(params.density, Density::FillPage(_)) { 4 } else { params.max_pages };
    UnwrapParams { density, page_size, max_pages, importance: None, ..params.clone() }
}

/// A bake for a first look at the same light.
fn quick_settings(settings: &Settings) -> Settings {
    Settings {
        quality: Quality::Draft,
        method: Method::Radiosity,
        gather: Gather::Blocks,
        solver: Solver::Auto,
        form_factors: FormFactors::Area,
        error: None,
        time_budget: None,
        samples: None,
        iterations: None,
        elements: None,
        hemicube: None,
        link_error: None,
        overshoot: false,
        ambient: false,
        denoise: Denoise::Builtin,
        // Keeps the halves of the samples.
        layers: vec![LayerKind::Error],
        directional: Directional::Off,
        seams: SeamMode::Off,
        probes: None,
        watch: None,
        dump_stages: None,
        ..settings.clone()
    }
}

/// By mesh and chart, the factors of `needs`, in part where `strength` is below 1.
fn by_mesh(scene: &Scene, atlas: &Atlas, needs: &[Need], factors: &[f64], strength: f32) -> Vec<Vec<f32>> {
    let mut result: Vec<Vec<f32>> = atlas.meshes.iter().map(|m| vec![1.0; m.chart_count as usize]).collect();
    for (need, factor) in needs.iter().zip(factors) {
        let factor = factor.powf(f64::from(strength)) as f32;
        match need.chart {
            Some(chart) => result[need.mesh][chart as usize] = factor,
            None => result[need.mesh].fill(factor),
        }
    }
    debug_assert_eq!(result.len(), scene.meshes.len());
    result
}

/// The densities of the charts of `atlas` that pages show.
pub fn densities(scene: &Scene, atlas: &Atlas) -> Densities {
    let mut charts: Vec<(f32, f64)> = Vec::new();
    for (s, surface) in scene.surfaces.iter().enumerate().filter(|(s, _)| atlas.is_shown(*s)) {
        let uvs = &atlas.meshes[surface.mesh];
        let mut sums = vec![(0.0, 0.0); uvs.chart_count as usize];
        for (t, &chart) in uvs.chart.iter().enumerate() {
            let [a, b, c] = scene.world_triangle(s, t).map(|p| p.as_dvec3());
            let [u, v, w] = atlas.page_texels(s, surface.mesh, t).map(|p| p.as_dvec2());
            let sum = &mut sums[chart as usize];
            sum.0 += 0.5 * (v - u).perp_dot(w - u).abs();
            sum.1 += 0.5 * (b - a).cross(c - a).length();
        }
        let density = |(texels, area): (f64, f64)| (area > 0.0).then(|| ((texels / area).sqrt() as f32, area));
        charts.extend(sums.into_iter().filter_map(density));
    }
    charts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * charts.iter().map(|c| c.1).sum::<f64>();
    let mut sum = 0.0;
    let median = charts.iter().find(|(_, area)| {
        sum += area;
        sum >= half
    });
    let density = |chart: Option<&(f32, f64)>| chart.map_or(0.0, |c| c.0);
    Densities {
        charts: charts.len(),
        least: density(charts.first()),
        median: density(median),
        most: density(charts.last()),
    }
}
