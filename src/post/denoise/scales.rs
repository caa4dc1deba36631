//! The built-in filter: noise told from detail scale by scale.
//!
//! A texel's light is the sum of what planes through its neighbourhood hold at a coarse scale, and of details d_k, what ever finer planes
//! hold beyond (the "a trous" pyramid: Holschneider et al. 1989; Dammertz et al. 2010 for light). Planes, where others take
//! means, leave gradients as they are, at a chart's border as well (first-order regression: Moon et al. 2014; Bitterli et
//! al. 2016).
//!
//! With A and B the means of two independent halves of the samples, each scale's filter is linear, so that of the detail of
//! (A + B) / 2 and of (A - B) / 2 the first holds light and noise, the second the same noise alone. Their squares, pooled over the
//! neighbourhood, tell the share of the detail that is light, and about so much of it is kept (Wiener 1949; the two halves as in
//! Rousselle, Knaus, Zwicker 2012): where noise is small against the detail, as at contact shadows, nothing happens. Filters weigh by
//! geometry alone, so the estimate has no bias of choice.
//!
//! Cost: ten texels a scale, twice over: planes and means are found along rows and then along columns ([`rows`](super::rows)), of one
//! page at a time. Charts are islands: no texel looks at another chart, nor past buried texels.

use super::rows::{Along, EVEN, Rows, SPLINE, curved_charts, each};
use crate::color::Rgb;
use crate::error::Result;
use crate::light::Lit;
use crate::progress::Progress;
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// The filter.
#[derive(Clone, Copy, Debug)]
pub struct Scales {
    /// Scales; the k-th looks 2 x 2^k texels far.
    pub count: u32,
    /// What noise is multiplied by before it is told from detail, 1 or more: squares are pooled over 25 texels at most, and chance makes
    /// detail of noise.
    pub caution: f32,
    /// Standard errors that a texel may be moved by at one scale, more than 0.
    pub most_moved: f32,
}

impl Scales {
    /// For texels that gather each on its own.
    pub const SINGLE: Self = Self { count: 5, caution: 1.5, most_moved: 2.5 };
    /// For texels read between blocks, which were smoothed: what noise is left is worth little detail.
    pub const BLOCKS: Self = Self { count: 5, caution: 1.2, most_moved: 1.0 };
}

impl Scales {
    /// Filters `light`, one value a patch, and half the difference of its two independent halves; and `parts` of the light in the
    /// same manner, so that sums hold.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn filter(
        &self,
        lit: &Lit,
        light: &mut Vec<Rgb>,
        difference: &mut Vec<Rgb>,
        parts: &mut [&mut Vec<Rgb>],
        progress: &dyn Progress,
    ) -> Result<()> {
        let had: Vec<DVec3> = fluxes(lit, light);
        let curved = curved_charts(lit);
        let is_gray = difference.par_iter().all(|d| d.x == d.y && d.y == d.z);
        let mut targets: Vec<&mut Vec<Rgb>> = vec![light, difference];
        targets.extend(parts.iter_mut().map(|part| &mut **part));
        for page in 0..lit.ground.atlas.pages.len() {
            let rows = Rows::new(lit, page, &curved);
            let mut layers = Layers::read(&rows, &targets, is_gray);
            self.filter_page(&rows, &mut layers, progress)?;
            layers.write(&rows, &mut targets);
        }
        targets[0].par_iter_mut().for_each(|v| *v = v.max(Vec3::ZERO));
        give_back(lit, &had, &mut targets);
        Ok(())
    }

    fn filter_page(&self, rows: &Rows, layers: &mut Layers, progress: &dyn Progress) -> Result<()> {
        let (n, is_gray) = (rows.len(), layers.is_gray);
        // Means along rows, of which those along columns are taken.
        let mut pooled = vec![Vec2::ZERO; n];
        let square = |p: usize| Vec2::new(noise_of(layers.is_gray, |k| layers.list[k][p]), 0.0);
        each(&mut pooled, |p, pooled| *pooled = rows.mean(Along::Row, 0, &SPLINE, p, square));
        let mut noise = vec![0.0f32; n];
        each(&mut noise, |p, noise| *noise = rows.mean(Along::Column, 0, &SPLINE, p, |q| pooled[q]).x);
        let mut line = vec![Vec4::ZERO; n];
        let mut smooth: Vec<Vec<Vec4>> = layers.list.iter().map(|layer| vec![Vec4::ZERO; layer.len()]).collect();
        let mut values = layers.list.clone();
        for scale in 0..self.count {
            progress.check()?;
            for (values, smooth) in values.iter().zip(&mut smooth) {
                rows.fit(Along::Row, scale, values, &mut line);
                rows.fit(Along::Column, scale, &line, smooth);
            }
            let detail = |k: usize, p: usize| values[k][p] - smooth[k][p];
            let squares = |p: usize| {
                let light = detail(0, p).truncate().length_squared();
                Vec2::new(light, noise_of(is_gray, |k| detail(k, p)))
            };
            each(&mut pooled, |p, pooled| *pooled = rows.mean(Along::Row, scale, &EVEN, p, squares));
            let lost = |p: usize| {
                let pooled = rows.mean(Along::Column, scale, &EVEN, p, |q| pooled[q]).to_array();
                self.lost(pooled, detail(0, p).truncate().length_squared(), noise[p])
            };
            for (k, left) in layers.list.iter_mut().enumerate() {
                each(left, |p, left| *left -= detail(k, p) * lost(p));
            }
            std::mem::swap(&mut values, &mut smooth);
        }
        Ok(())
    }

    /// The share of a texel's detail that is taken for noise: from the squares of detail and noise, pooled; that of its `own` detail; and
    /// the `variance` of the noise there. No texel is moved by more than its own noise explains: beside a bright and noisy place,
    /// dark ones stay dark.
    fn lost(&self, [whole, noise]: [f32; 2], own: f32, variance: f32) -> f32 {
        if whole <= 0.0 {
            return 0.0;
        }
        let most = if own > 0.0 { self.most_moved * (variance / own).sqrt() } else { 1.0 };
        (self.caution * noise / whole).min(most).min(1.0)
    }
}

/// Ratios beyond which the light of a chart must have been all noise.
const RATIO: [f32; 2] = [0.8, 1.25];

/// The light of each chart, all over its area.
fn fluxes(lit: &Lit, values: &[Rgb]) -> Vec<DVec3> {
    let mut first = 0;
    let of_chart = |chart: &[u32]| {
        let range = first..first + chart.len();
        first = range.end;
        range.map(|i| values[i].as_dvec3() * f64::from(lit.exposure.area[i])).sum()
    };
    lit.ground.patches.chart.chunk_by(|a, b| a == b).map(of_chart).collect()
}

/// Gives back to each chart what the filter took from its light in all, all of `targets` alike: peaks, which are noisy, lose more than
/// hollows. `had` is what charts had of the first of `targets`, without bias.
fn give_back(lit: &Lit, had: &[DVec3], targets: &mut [&mut Vec<Rgb>]) {
    let has = fluxes(lit, targets[0]);
    let mut first = 0;
    for ((chart, had), has) in lit.ground.patches.chart.chunk_by(|a, b| a == b).zip(had).zip(has) {
        let range = first..first + chart.len();
        first = range.end;
        let ratio = DVec3::select(has.cmpgt(DVec3::ZERO), had / has.max(DVec3::splat(f64::MIN_POSITIVE)), DVec3::ONE);
        let ratio = ratio.as_vec3().clamp(Vec3::splat(RATIO[0]), Vec3::splat(RATIO[1]));
        if ratio != Vec3::ONE {
            targets.iter_mut().for_each(|target| target[range.clone()].iter_mut().for_each(|v| *v *= ratio));
        }
    }
}

/// Values by place that are filtered alike, four numbers side by side: the light and, where it is gray, the difference of its halves;
/// else that in a layer of its own; then the parts of the light.
struct Layers {
    list: Vec<Vec<Vec4>>,
    is_gray: bool,
}

/// The square of the difference of the halves that `value` of the layers has, all channels together.
fn noise_of(is_gray: bool, value: impl Fn(usize) -> Vec4) -> f32 {
    if is_gray { 3.0 * value(0).w.powi(2) } else { value(1).truncate().length_squared() }
}

impl Layers {
    /// Reads `targets`, by patch: the light, the difference of its halves, and parts.
    fn read(rows: &Rows, targets: &[&mut Vec<Rgb>], is_gray: bool) -> Self {
        let layer = |k: usize, fourth: Option<usize>| -> Vec<Vec4> {
            let of = |&i: &u32| targets[k][i as usize].extend(fourth.map_or(0.0, |k| targets[k][i as usize].x));
            rows.patch.par_iter().map(of).collect()
        };
        let mut list = vec![layer(0, is_gray.then_some(1))];
        list.extend((if is_gray { 2 } else { 1 }..targets.len()).map(|k| layer(k, None)));
        Self { list, is_gray }
    }

    /// Writes them to `targets`.
    fn write(&self, rows: &Rows, targets: &mut [&mut Vec<Rgb>]) {
        let shift = usize::from(self.is_gray);
        for (p, &i) in rows.patch.iter().enumerate() {
            for (k, target) in targets.iter_mut().enumerate() {
                target[i as usize] = match k {
                    0 => self.list[0][p].truncate(),
                    1 if self.is_gray => Rgb::splat(self.list[0][p].w),
                    _ => self.list[k - shift][p].truncate(),
                };
            }
        }
    }
}
