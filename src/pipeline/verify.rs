//! A bake that used what is remembered, held against one that doesn't (`--verify`).
//!
//! All is found again in memory, on the same texels and by the same settings, seed included, so that what comes from the cache as it went
//! in is equal to the bit. What was found another way, by links that are kept over a change, of other light, or beside kept texels, differs
//! by noise. How much that may be follows from what the two bakes state themselves:
//!
//! ```text
//! noise   = sqrt(e1^2 + e2^2 + (s / 2)^2)
//! rms     <= 1.5 noise        without the worst hundredth of the area
//! bias    <= 0.5 noise        of the mean, and of the mean of every surface of a hundredth of the area at least
//! ```
//!
//! with the estimated errors e1 and e2 of the two and the tolerance s of a light in a shadow, of which penumbrae alone make use: where they
//! cover a quarter of all texels it adds s / 2 to the root mean square. Estimates of errors scatter by some tenth of themselves, and
//! two bakes that share samples are closer than they say. Means are over thousands of blocks whose noise is independent, and known many
//! times better; half the noise leaves room for what interpolation misses, which has one sign over a surface.

use crate::color::luminance;
use crate::error::Result;
use crate::illuminate::{Illuminated, illuminate};
use crate::patch::{Patches, unocclude::Exposure};
use crate::post::{Directional, LayerKind, Lightmap};
use crate::progress::{Progress, Within};
use crate::report::{Verified, WorstSurface};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::unwrap::Atlas;

/// How much the difference may be, over the noise of both bakes: of texels, and of means.
const MOST_RMS: f64 = 1.5;
const MOST_BIAS: f64 = 0.5;

/// The share of a light's tolerance in shadows that counts over all texels.
const IN_SHADOWS: f64 = 0.5;

/// The share of the area that isn't counted in the root mean square, and that a surface must have to be judged by itself.
const WORST: f64 = 0.01;

/// What is to be verified.
pub(super) struct Baked<'a> {
    pub scene: &'a Scene,
    pub atlas: &'a Atlas,
    pub patches: &'a Patches,
    pub exposure: &'a Exposure,
    pub lightmap: &'a Lightmap,
    /// By surface: those whose texels were kept and are not looked at; none where all were baked.
    pub known: &'a [bool],
    /// The error that it estimates itself [%].
    pub estimated: f64,
}

/// The error that `lit` estimates of itself: of blocks noise and bias, else the noise [%].
pub(super) fn estimated(lit: &Illuminated) -> f64 {
    100.0 * lit.exchanged.map_or(lit.gathered.noise, |e| e.noise.hypot(e.bias))
}

/// Bakes anew without anything that is remembered, and compares.
///
/// # Errors
/// Those of the stages.
pub(super) fn verify(baked: &Baked, settings: &Settings, progress: &dyn Progress) -> Result<Verified> {
    progress.begin("verify", 0);
    let settings = alone(settings);
    let lit = illuminate(baked.scene, baked.atlas, &settings, &Within(progress))?;
    let again = estimated(&lit);
    let lightmap = lit.lightmap;
    let shadow = IN_SHADOWS * 100.0 * f64::from(settings.direct_params().shadow_error);
    let noise = baked.estimated.hypot(again).hypot(shadow);
    Ok(compare(baked, &lightmap, noise))
}

/// The settings of a bake of all surfaces and of nothing beside the light. Light groups stay: lamps are looked at in their order.
fn alone(settings: &Settings) -> Settings {
    Settings {
        relight: None,
        only: Vec::new(),
        verify: false,
        layers: settings.layers.iter().copied().filter(|kind| *kind == LayerKind::LightGroups).collect(),
        directional: Directional::Off,
        probes: None,
        dump_stages: None,
        watch: None,
        watch_every: None,
        ..settings.clone()
    }
}

/// The differences of texels to `truth`, of which `noise` is expected [%].
fn compare(baked: &Baked, truth: &Lightmap, noise: f64) -> Verified {
    let Baked { scene, patches, exposure, lightmap, known, .. } = *baked;
    let is_compared = |i: &usize| {
        !exposure.is_buried(*i) && known.get(patches.surface(*i) as usize) != Some(&true) && exposure.area[*i] > 0.0
    };
    let read = |lightmap: &Lightmap, i: usize| {
        let [page, texel] = patches.texel(i).map(|n| n as usize);
        f64::from(luminance(lightmap.pages[page].rgb[texel]))
    };
    let mut surfaces = vec![[0.0; 3]; scene.surfaces.len()];
    let mut squares: Vec<(f64, f64)> = Vec::new();
    let (mut difference, mut light, mut whole) = (0.0, 0.0, 0.0);
    for i in (0..patches.len()).filter(is_compared) {
        let (area, was) = (f64::from(exposure.area[i]), read(truth, i));
        let off = read(lightmap, i) - was;
        (difference, light, whole) = (difference + area * off, light + area * was, whole + area);
        squares.push((off * off, area));
        let [sum, square, own] = &mut surfaces[patches.surface(i) as usize];
        (*sum, *square, *own) = (*sum + area * off, *square + area * off * off, *own + area);
    }
    let texels = squares.len();
    let mean = if light > 0.0 { light / whole } else { f64::MIN_POSITIVE };
    let percent = |value: f64| 100.0 * value / mean;
    let worst = surfaces.iter().enumerate().filter(|(_, s)| s[2] >= WORST * whole && s[2] > 0.0);
    let worst = worst.max_by(|a, b| (a.1[0] / a.1[2]).abs().total_cmp(&(b.1[0] / b.1[2]).abs()));
    let worst = worst.map(|(s, &[sum, square, area])| WorstSurface {
        name: scene.surfaces[s].name.clone(),
        bias: percent(sum / area),
        rms: percent((square / area).sqrt()),
    });
    let (bias, rms) = (percent(difference / whole.max(f64::MIN_POSITIVE)), percent(trimmed(squares, whole)));
    let of_worst = worst.as_ref().map_or(0.0, |w| w.bias);
    let (most_rms, most_bias) = (MOST_RMS * noise, MOST_BIAS * noise);
    let holds = rms <= most_rms && bias.abs() <= most_bias && of_worst.abs() <= most_bias;
    Verified { holds, texels, bias, rms, noise, most_rms, most_bias, worst }
}

/// The root of the mean of `squares` with their areas, `whole` in all, without the worst.
fn trimmed(mut squares: Vec<(f64, f64)>, whole: f64) -> f64 {
    squares.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sum, mut seen) = (0.0, 0.0);
    for (square, area) in squares {
        if seen + area > (1.0 - WORST) * whole {
            break;
        }
        (sum, seen) = (sum + square * area, seen + area);
    }
    (sum / f64::max(seen, f64::MIN_POSITIVE)).sqrt()
}
