//! The density of charts as it is kept: other light for a bake needs the texels of that bake, not those that it would ask for itself.

use super::{AdaptiveReport, Densities};
use crate::digest::geometry;
use crate::error::Result;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::store::{Entry, Key, Store};
use crate::unwrap::Importance;

/// The kind of results that it is.
const DENSITY: &str = "density";

/// What it depends on, but for the light.
fn key(scene: &Scene, settings: &Settings) -> Key {
    Key::of(DENSITY, |h| {
        h.add_str(env!("CARGO_PKG_VERSION"));
        h.add_key(geometry(scene));
        h.add_debug(&settings.unwrap_params());
        h.add_debug(&(settings.adaptive_density, settings.seed, settings.normals));
    })
}

/// Keeps what the last bake of these texels was given.
///
/// # Errors
/// `Io`.
pub fn keep(
    scene: &Scene,
    settings: &Settings,
    (importance, report): &(Importance, AdaptiveReport),
    store: &Store,
) -> Result<()> {
    let ends = importance.factors.iter().scan(0u64, |end, charts| {
        *end += charts.len() as u64;
        Some(*end)
    });
    let ends: Vec<u64> = ends.collect();
    let errors = [report.even_error, report.error];
    let factors = importance.factors.concat();
    let sections = [bytemuck::cast_slice(&ends), bytemuck::cast_slice(&factors), bytemuck::cast_slice(&errors)];
    store.write(DENSITY, key(scene, settings), &sections)
}

/// What [`keep`] kept.
///
/// # Errors
/// `Io`.
pub fn recall(scene: &Scene, settings: &Settings, store: &Store) -> Result<Option<(Importance, AdaptiveReport)>> {
    let entry = store.read(DENSITY, key(scene, settings))?;
    Ok(entry.and_then(|entry| restored(&entry, settings)))
}

fn restored(entry: &Entry, settings: &Settings) -> Option<(Importance, AdaptiveReport)> {
    let (ends, all) = (entry.slice::<u64>(0).ok()?, entry.slice::<f32>(1).ok()?);
    let &[even_error, error] = entry.slice::<f64>(2).ok()? else { return None };
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let charts = starts.zip(ends).map(|(start, end)| Some(all.get(start as usize..*end as usize)?.to_vec()));
    let factors: Vec<Vec<f32>> = charts.collect::<Option<_>>()?;
    let strength = settings.adaptive_density?;
    let densities = Densities::default();
    Some((
        Importance { factors },
        AdaptiveReport { strength, quick_texels: 0, quick_s: 0.0, even_error, error, densities },
    ))
}
