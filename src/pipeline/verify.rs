//! A bake that used what is remembered, held against one that doesn't (`--verify`).
//!
//! All is found again in memory, on the same texels and by the same settings, seed included, so that what comes from the cache as it went
//! in is equal to the bit. What was found another way, by links that are kept over a change, of other light, or beside kept texels, differs
//! by noise. How much that may be follows from what the two bakes state themselves:
//!
//! ```text
//! noise = sqrt(e1^2 + e2^2 + (s / 2)^2)
//! rms  <= 1.5 noise                                   without the worst hundredth of the area
//! bias <= max(0.5 noise, min(3 spread sqrt(64 / texels), 0.2 light))   of the mean, and of that of every surface of a hundredth of the area
//! ```
//!
//! with the estimated errors e1 and e2 of the two and the tolerance s of a light in a shadow, of which penumbrae alone make use: where they
//! cover a quarter of all texels it adds s / 2 to the root mean square. Estimates of errors scatter by some tenth of themselves, and
//! two bakes that share samples are closer than they say. Means are over blocks of 64 texels at most whose noise is independent, the spread
//! being that of the differences about their mean, of which no more counts than three times the noise, lest what is wrong excuse itself: three
//! standard deviations. A fifth of a surface's own light is no noise. Half the noise leaves room for what interpolation misses,
//! which has one sign over a surface. Of a few texels beside kept ones the error estimate of a whole bake says little, and the standard errors
//! of these texels take its place.

use crate::color::{Rgb, luminance};
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

/// Standard deviations of a mean that are not surprising, and texels whose noise is one.
const DEVIATIONS: f64 = 3.0;
const TOGETHER: f64 = 64.0;

/// The spread that counts, over the noise of both bakes.
const MOST_SPREAD: f64 = 3.0;

/// The share of its own light by which a surface's mean may not be off, whatever its noise.
const MOST_OWN: f64 = 0.2;

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
    let settings = alone(settings, !baked.known.is_empty());
    let lit = illuminate(baked.scene, baked.atlas, &settings, &Within(progress))?;
    let mut again = estimated(&lit);
    let mean = baked.mean(&lit.gathered.irradiance, |_| true);
    if !baked.known.is_empty() {
        let errors = lit.gathered.standard_error.iter().map(|e| *e * *e).collect::<Vec<_>>();
        let square = baked.mean(&errors, |i| baked.is_compared(i));
        again = 100.0 * square.sqrt() / mean.max(f64::MIN_POSITIVE);
    }
    let lightmap = lit.lightmap;
    let shadow = IN_SHADOWS * 100.0 * f64::from(settings.direct_params().shadow_error);
    let noise = baked.estimated.hypot(again).hypot(shadow);
    Ok(compare(baked, &lightmap, noise))
}

/// The settings of a bake of all surfaces and of nothing beside the light, and `errors` of each texel where they are wanted. Light groups
/// stay: lamps are looked at in their order.
fn alone(settings: &Settings, errors: bool) -> Settings {
    let groups = settings.layers.iter().copied().filter(|kind| *kind == LayerKind::LightGroups);
    Settings {
        relight: None,
        only: Vec::new(),
        verify: false,
        layers: groups.chain(errors.then_some(LayerKind::Error)).collect(),
        directional: Directional::Off,
        probes: None,
        dump_stages: None,
        watch: None,
        watch_every: None,
        ..settings.clone()
    }
}

impl Baked<'_> {
    /// True where patch `i` shows light that was baked.
    fn is_compared(&self, i: usize) -> bool {
        let is_known = self.known.get(self.patches.surface(i) as usize) == Some(&true);
        self.is_open(i) && !is_known
    }

    fn is_open(&self, i: usize) -> bool {
        !self.exposure.is_buried(i) && self.exposure.area[i] > 0.0
    }

    /// The mean luminance of `values` over the area of those patches in the open that are `wanted`.
    fn mean(&self, values: &[Rgb], wanted: impl Fn(usize) -> bool) -> f64 {
        let (mut sum, mut whole) = (0.0, 0.0);
        for i in (0..values.len()).filter(|&i| self.is_open(i) && wanted(i)) {
            let area = f64::from(self.exposure.area[i]);
            (sum, whole) = (sum + area * f64::from(luminance(values[i])), whole + area);
        }
        sum / f64::max(whole, f64::MIN_POSITIVE)
    }
}

/// Sums over the differences of texels.
#[derive(Clone, Copy, Default)]
struct Sums {
    difference: f64,
    square: f64,
    /// Of the light that is expected.
    light: f64,
    area: f64,
    texels: usize,
}

impl Sums {
    /// Adds a texel that is `off` from its `light`.
    fn add(&mut self, off: f64, light: f64, area: f64) {
        self.light += area * light;
        self.difference += area * off;
        self.square += area * off * off;
        self.area += area;
        self.texels += 1;
    }

    fn mean(&self) -> f64 {
        self.difference / self.area.max(f64::MIN_POSITIVE)
    }

    fn rms(&self) -> f64 {
        (self.square / self.area.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// How far the mean may be off by `noise`.
    fn most(&self, noise: f64) -> f64 {
        let spread = (self.rms().powi(2) - self.mean().powi(2)).max(0.0).sqrt().min(MOST_SPREAD * noise);
        let by_chance = DEVIATIONS * spread * (TOGETHER / self.texels.max(1) as f64).sqrt();
        let own = MOST_OWN * self.light / self.area.max(f64::MIN_POSITIVE);
        by_chance.min(own).max(MOST_BIAS * noise)
    }
}

/// The differences of texels to `truth`, of which `noise` is expected [%].
fn compare(baked: &Baked, truth: &Lightmap, noise: f64) -> Verified {
    let Baked { scene, patches, exposure, lightmap, .. } = *baked;
    let read = |lightmap: &Lightmap, i: usize| {
        let [page, texel] = patches.texel(i).map(|n| n as usize);
        lightmap.pages[page].rgb[texel]
    };
    let shown: Vec<Rgb> = (0..patches.len()).map(|i| read(truth, i)).collect();
    // In percent of the mean light of all.
    let scale = 100.0 / baked.mean(&shown, |_| true).max(f64::MIN_POSITIVE);
    let mut surfaces = vec![Sums::default(); scene.surfaces.len()];
    let (mut all, mut squares) = (Sums::default(), Vec::new());
    for i in (0..patches.len()).filter(|&i| baked.is_compared(i)) {
        let area = f64::from(exposure.area[i]);
        let light = scale * f64::from(luminance(shown[i]));
        let off = scale * f64::from(luminance(read(lightmap, i))) - light;
        all.add(off, light, area);
        surfaces[patches.surface(i) as usize].add(off, light, area);
        squares.push((off * off, area));
    }
    let surprise = |s: &Sums| s.mean().abs() / s.most(noise).max(f64::MIN_POSITIVE);
    let judged = surfaces.iter().enumerate().filter(|(_, s)| s.area > 0.0 && s.area >= WORST * all.area);
    let worst = judged.max_by(|a, b| surprise(a.1).total_cmp(&surprise(b.1)));
    let worst = worst.map(|(s, sums)| WorstSurface {
        name: scene.surfaces[s].name.clone(),
        bias: sums.mean(),
        rms: sums.rms(),
        most_bias: sums.most(noise),
    });
    let (texels, bias, rms) = (all.texels, all.mean(), trimmed(squares, all.area));
    let (most_rms, most_bias) = (MOST_RMS * noise, all.most(noise));
    let is_explained = |w: &WorstSurface| w.bias.abs() <= w.most_bias;
    let holds = rms <= most_rms && bias.abs() <= most_bias && worst.as_ref().is_none_or(is_explained);
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
