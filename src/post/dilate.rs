//! Patch values to pages, and their extension into gutters, so that bilinear look-ups at a chart's border read its own light.

use super::gutter::{Gutter, push_pull};
use super::seam::{SeamMode, SeamReport, Seams, stitch::stitch, taps};
use super::{Lightmap, PageImage, Quantity};
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::patch::{NONE, Patches};
use crate::unwrap::Atlas;
use glam::Vec2;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Rounds of averaging over filled buried texels.
const SMOOTHING_ROUNDS: usize = 16;

/// The first rings of a buried region, which bilinear look-ups beside it read, keep what they took from their own side: under a
/// thin wall the other side is another room.
const UNTOUCHED_RINGS: usize = 2;

/// A page while it is being filled.
pub(super) struct Canvas {
    pub size: [usize; 2],
    pub rgb: Vec<Rgb>,
    coverage: Vec<f32>,
    /// Chart of each texel, [`NONE`] in the gutter.
    pub chart: Vec<u32>,
    pub filled: Vec<bool>,
}

/// How patch values come to pages: the same for the whole light and for every part of it, so that parts add up.
pub struct Finish<'a> {
    pub lit: Lit<'a>,
    pub seams: Seams,
    pub gutter: Gutter,
}

impl<'a> Finish<'a> {
    /// Seams as `mode` has them, for values of `quantity`.
    pub fn new(lit: Lit<'a>, mode: SeamMode, gutter: Gutter, quantity: Quantity) -> Self {
        Self { lit, seams: Seams::new(&lit, mode, quantity), gutter }
    }

    /// Values as they are, and the padding alone: for pages that are looked at along the way.
    pub fn plain(lit: Lit<'a>) -> Self {
        Self { lit, seams: Seams::default(), gutter: Gutter::Padding }
    }
}

impl Finish<'_> {
    /// The same with seams left as they are: for what is no light, and may well jump from chart to chart.
    pub fn without_seams(&self) -> Self {
        Self { lit: self.lit, seams: Seams::default(), gutter: self.gutter }
    }
}

/// Makes finished pages: patch irradiance [lx] as `quantity`, buried texels filled from their own chart, seams closed, gutters
/// filled. With them, how far light jumps across seams before and after.
pub fn finish(to: &Finish, irradiance: &[Rgb], quantity: Quantity) -> (Lightmap, SeamReport) {
    let lit = &to.lit;
    let (pages, seams) = fill_measured(to, |i| {
        let value = quantity.of(irradiance[i], lit.reflectance.0[i]);
        if quantity == Quantity::Radiosity { value + lit.emission.0[i] * PI } else { value }
    });
    (Lightmap { pages, quantity, layers: Vec::new() }, seams)
}

/// Patch values on finished pages. Where no value is negative, none becomes so.
pub fn fill(to: &Finish, value: impl Fn(usize) -> Rgb) -> Vec<PageImage> {
    fill_measured(to, value).0
}

fn fill_measured(to: &Finish, value: impl Fn(usize) -> Rgb) -> (Vec<PageImage>, SeamReport) {
    let Finish { lit, seams, gutter } = to;
    let atlas = lit.ground.atlas;
    let mut canvases = paint(atlas, lit.ground.patches, value, |i| !lit.exposure.is_buried(i));
    for canvas in &mut canvases {
        let buried = canvas.spread(usize::MAX, true);
        canvas.smooth(&buried);
        canvas.close_charts();
        // What bilinear look-ups at a chart's border read.
        canvas.spread(1, false);
    }
    let mut report = SeamReport::default();
    if !seams.samples.is_empty() {
        let gap = |canvases: &[Canvas]| 100.0 * seams.measure(|place| canvases[place.page as usize].read(place.at));
        let signed: Vec<bool> = canvases.par_iter().map(Canvas::is_signed).collect();
        report.texels = seams.texels();
        report.before = gap(&canvases);
        stitch(lit, seams, &mut canvases);
        for (canvas, _) in canvases.iter_mut().zip(signed).filter(|(_, signed)| !signed) {
            canvas.rgb.par_iter_mut().for_each(|v| *v = v.max(Rgb::ZERO));
        }
        report.after = gap(&canvases);
    }
    for canvas in &mut canvases {
        canvas.spread((atlas.padding as usize).saturating_sub(1), false);
        if *gutter == Gutter::All {
            push_pull(canvas.size, &mut canvas.rgb, &canvas.filled);
        }
    }
    (canvases.into_iter().map(Canvas::into_page).collect(), report)
}

/// Patch values on pages as they are, gutters black: for looking at a stage.
pub fn plain(atlas: &Atlas, patches: &Patches, value: impl Fn(usize) -> Rgb) -> Vec<PageImage> {
    paint(atlas, patches, value, |_| true).into_iter().map(Canvas::into_page).collect()
}

fn paint(
    atlas: &Atlas,
    patches: &Patches,
    value: impl Fn(usize) -> Rgb,
    is_valid: impl Fn(usize) -> bool,
) -> Vec<Canvas> {
    let mut canvases: Vec<Canvas> = atlas
        .pages
        .iter()
        .map(|&[w, h]| {
            let n = w as usize * h as usize;
            let (rgb, coverage) = (vec![Rgb::ZERO; n], vec![0.0; n]);
            Canvas { size: [w as usize, h as usize], rgb, coverage, chart: vec![NONE; n], filled: vec![false; n] }
        })
        .collect();
    for i in 0..patches.len() {
        let [page, texel] = patches.texel(i);
        let (canvas, texel) = (&mut canvases[page as usize], texel as usize);
        canvas.chart[texel] = patches.chart[i];
        if is_valid(i) {
            // Where authored UVs let charts share a texel it shows their mean by coverage.
            let (old, new) = (if canvas.filled[texel] { canvas.coverage[texel] } else { 0.0 }, patches.coverage[i]);
            let total = (old + new).max(f32::MIN_POSITIVE);
            canvas.rgb[texel] = (canvas.rgb[texel] * old + value(i) * new) / total;
            canvas.filled[texel] = true;
        }
        canvas.coverage[texel] = (canvas.coverage[texel] + patches.coverage[i]).min(1.0);
    }
    canvases
}

impl Canvas {
    /// Fills, ring by ring and `rings` wide, the texels next to filled ones with their mean: those of charts from their own
    /// chart alone, or those of the gutter. Returns the texels of the rings from [`UNTOUCHED_RINGS`] on.
    fn spread(&mut self, rings: usize, within_charts: bool) -> Vec<usize> {
        let is_wanted = |canvas: &Self, t: usize| !canvas.filled[t] && (canvas.chart[t] != NONE) == within_charts;
        // Only texels beside filled ones can be in the first ring.
        let is_first = |t: &usize| is_wanted(self, *t) && self.around(*t).any(|n| self.filled[n]);
        let mut border: Vec<usize> = (0..self.filled.len()).into_par_iter().filter(is_first).collect();
        let mut deep = Vec::new();
        for ring in 0..rings {
            let found: Vec<(usize, Rgb)> = border.par_iter().filter_map(|&t| Some((t, self.mean_around(t)?))).collect();
            if found.is_empty() {
                break;
            }
            for &(t, value) in &found {
                self.rgb[t] = value;
                self.filled[t] = true;
            }
            // The next ring lies around this one.
            let around = found.par_iter().flat_map_iter(|&(t, _)| self.around(t));
            border = around.filter(|&t| is_wanted(self, t)).collect();
            border.par_sort_unstable();
            border.dedup();
            if ring >= UNTOUCHED_RINGS {
                deep.extend(found.into_iter().map(|f| f.0));
            }
        }
        deep
    }

    /// Evens out what the rings left as streaks: nobody sees the middle of a buried region, but mip levels read it.
    fn smooth(&mut self, texels: &[usize]) {
        for _ in 0..SMOOTHING_ROUNDS {
            let means: Vec<Rgb> = texels.par_iter().map(|&t| self.mean_around(t).unwrap_or(self.rgb[t])).collect();
            for (&t, mean) in texels.iter().zip(means) {
                self.rgb[t] = mean;
            }
        }
    }

    /// The up to four texels at the sides of texel `t`.
    pub fn beside(&self, t: usize) -> impl Iterator<Item = usize> + use<> {
        let [w, h] = self.size;
        let (x, y) = (t % w, t / w);
        let is_there = [x > 0, x + 1 < w, y > 0, y + 1 < h];
        let texels = [t.wrapping_sub(1), t + 1, t.wrapping_sub(w), t + w];
        texels.into_iter().zip(is_there).filter(|(_, there)| *there).map(|(n, _)| n)
    }

    /// The chart that a texel belongs to, or in whose gutter it lies; [`NONE`] where there are several or none.
    pub fn owner(&self, t: usize) -> u32 {
        if self.chart[t] != NONE {
            return self.chart[t];
        }
        let mut charts = self.around(t).map(|n| self.chart[n]).filter(|c| *c != NONE);
        let first = charts.next().unwrap_or(NONE);
        if charts.all(|c| c == first) { first } else { NONE }
    }

    /// Luminance as engines read it at `at` [texels].
    fn read(&self, at: Vec2) -> f32 {
        taps(self.size, at).iter().map(|&(t, weight)| luminance(self.rgb[t]) * weight).sum()
    }

    /// Takes what nothing of its own chart could fill for black, as in a crevice: no light of other charts is to come there.
    fn close_charts(&mut self) {
        self.filled.par_iter_mut().zip(&self.chart).for_each(|(filled, chart)| *filled |= *chart != NONE);
    }

    fn is_signed(&self) -> bool {
        self.rgb.iter().any(|v| v.min_element() < 0.0)
    }

    /// The texel and its up to eight neighbours.
    fn around(&self, t: usize) -> impl Iterator<Item = usize> + use<> {
        let [w, h] = self.size;
        let (x, y) = (t % w, t / w);
        let columns = x.saturating_sub(1)..(x + 2).min(w);
        (y.saturating_sub(1)..(y + 2).min(h)).flat_map(move |ny| columns.clone().map(move |nx| ny * w + nx))
    }

    /// Mean of the filled neighbours, those along edges twice; for a chart's texel of its own chart alone.
    fn mean_around(&self, t: usize) -> Option<Rgb> {
        let w = self.size[0];
        let (mut sum, mut weight) = (Rgb::ZERO, 0.0);
        for n in self.around(t) {
            if self.filled[n] && (self.chart[t] == NONE || self.chart[n] == self.chart[t]) {
                let k = if n % w == t % w || n / w == t / w { 2.0 } else { 1.0 };
                sum += self.rgb[n] * k;
                weight += k;
            }
        }
        (weight > 0.0).then(|| sum / weight)
    }

    fn into_page(self) -> PageImage {
        let [width, height] = self.size.map(|n| n as u32);
        PageImage { width, height, rgb: self.rgb, coverage: self.coverage }
    }
}
