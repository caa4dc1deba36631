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
//! Cost: 25 texels a scale, twice over. Charts are islands: no texel looks at another chart, nor past buried texels.

use crate::color::Rgb;
use crate::error::Result;
use crate::light::Lit;
use crate::plane::Plane;
use crate::progress::Progress;
use glam::{DVec3, IVec2, Vec2, Vec3};
use rayon::prelude::*;

/// The cubic B-spline's weights at 0, 1 and 2.
const SPLINE: [f32; 3] = [0.375, 0.25, 0.0625];

/// Neighbours whose normals differ by more than this cosine say nothing; those between count in part.
const APART: f32 = 0.7;

/// Slopes are held back by this share of the weights.
const RIDGE: f32 = 1e-3;

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

/// A texel of a neighbourhood, its weight, how far its normal agrees, and its place [texels].
#[derive(Clone, Copy, Default)]
struct Tap {
    patch: u32,
    weight: f32,
    alike: f32,
    offset: Vec2,
}

/// The taps of one neighbourhood, the texel itself first.
struct Taps {
    list: [Tap; 25],
    count: usize,
}

/// Which texels see one another at a scale.
struct Reach<'a> {
    lit: &'a Lit<'a>,
    scale: u32,
    /// By patch: bit k stands for the step (k % 5 - 2, k / 5 - 2).
    open: Vec<u32>,
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
        let mut targets: Vec<&mut Vec<Rgb>> = vec![light, difference];
        targets.extend(parts.iter_mut().map(|part| &mut **part));
        let had: Vec<DVec3> = fluxes(lit, targets[0]);
        let mut reach = Reach::new(lit);
        let squares: Vec<[f32; 2]> = targets[1].par_iter().map(|d| [d.length_squared(), 0.0]).collect();
        let noise: Vec<f32> = pool(&reach, &squares, |tap| tap.weight, |_, [square, _]| square);
        drop(squares);
        // Texel by texel, all quantities of one side by side.
        let width = targets.len();
        let mut values: Vec<Rgb> = (0..targets[0].len()).flat_map(|i| targets.iter().map(move |t| t[i])).collect();
        for scale in 0..self.count {
            progress.check()?;
            if scale > 0 {
                reach = reach.doubled();
            }
            let (smooth, squares) = planes(&reach, &values, width);
            let lost = pool(&reach, &squares, |tap| tap.alike, |i, pooled| self.lost(pooled, squares[i][0], noise[i]));
            drop(squares);
            for (k, target) in targets.iter_mut().enumerate() {
                let detail = |i: usize| values[i * width + k] - smooth[i * width + k];
                target.par_iter_mut().enumerate().for_each(|(i, t)| *t -= detail(i) * lost[i]);
            }
            values = smooth;
        }
        targets[0].par_iter_mut().for_each(|v| *v = v.max(Vec3::ZERO));
        give_back(lit, &had, &mut targets);
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

/// Planes through each texel's neighbourhood, of all `values`, `width` a texel; and the squares of what the first two leave over.
fn planes(reach: &Reach, values: &[Rgb], width: usize) -> (Vec<Rgb>, Vec<[f32; 2]>) {
    let side = (1u32 << reach.scale) as f32;
    let shares = |i: usize| -> Taps {
        let mut taps = reach.taps(i);
        let mut plane = Plane::default();
        taps.list[..taps.count].iter().for_each(|tap| plane.add(tap.weight, tap.offset));
        match plane.shares(RIDGE, side) {
            Some(shares) => {
                taps.list[..taps.count].iter_mut().for_each(|tap| tap.weight = shares.of(tap.weight, tap.offset));
            }
            None => taps.count = 1,
        }
        taps
    };
    let mut smooth = vec![Vec3::ZERO; values.len()];
    let mut squares = vec![[0.0; 2]; values.len() / width];
    let rows =
        smooth.par_chunks_mut(width).zip(&mut squares).zip(values.par_chunks(width)).enumerate().with_min_len(256);
    rows.for_each(|(i, ((row, squares), own))| {
        let taps = shares(i);
        row.copy_from_slice(own);
        for tap in &taps.list[1..taps.count] {
            let other = &values[tap.patch as usize * width..][..width];
            // Relative to the texel itself, so that what is even stays so to the bit.
            row.iter_mut().zip(other).zip(own).for_each(|((sum, other), own)| *sum += (*other - *own) * tap.weight);
        }
        *squares = [0, 1].map(|k| (own[k] - row[k]).length_squared());
    });
    (smooth, squares)
}

/// What `judge` says of the means over each texel's neighbourhood by `weight`.
fn pool(
    reach: &Reach,
    squares: &[[f32; 2]],
    weight: impl Fn(&Tap) -> f32 + Sync,
    judge: impl Fn(usize, [f32; 2]) -> f32 + Sync,
) -> Vec<f32> {
    let mean = |i: usize| {
        let taps = reach.taps(i);
        let (mut sums, mut weights) = ([0.0f32; 2], 0.0);
        for tap in &taps.list[..taps.count] {
            let (square, weight) = (squares[tap.patch as usize], weight(tap));
            sums = [sums[0] + weight * square[0], sums[1] + weight * square[1]];
            weights += weight;
        }
        judge(i, sums.map(|sum| sum / weights))
    };
    (0..squares.len()).into_par_iter().with_min_len(256).map(mean).collect()
}

/// The step of bit `k`.
fn step(k: usize) -> IVec2 {
    IVec2::new(k as i32 % 5 - 2, k as i32 / 5 - 2)
}

/// The bit of the texel itself.
const OWN: usize = 12;

impl<'a> Reach<'a> {
    /// The finest scale: texels of one chart, with no gap and nothing buried between them.
    fn new(lit: &'a Lit<'a>) -> Self {
        let mut reach = Self { lit, scale: 0, open: Vec::new() };
        let mask = |i: usize| {
            let is_open = |k: &usize| {
                let (to, halfway) = (step(*k), step(*k) / 2);
                *k != OWN && reach.at(i, to).is_some() && (halfway == IVec2::ZERO || reach.at(i, halfway).is_some())
            };
            (0..25).filter(is_open).map(|k| 1 << k).sum()
        };
        let open = (0..lit.ground.patches.len()).into_par_iter().map(mask).collect();
        reach.open = open;
        reach
    }

    /// The scale above: a step of it is two of this one in a row.
    fn doubled(&self) -> Self {
        let mask = |i: usize| {
            let is_open = |k: &usize| {
                let here = self.open[i] >> k & 1 == 1;
                here && self.at(i, step(*k) << self.scale).is_some_and(|j| self.open[j] >> k & 1 == 1)
            };
            (0..25).filter(is_open).map(|k| 1 << k).sum()
        };
        let open = (0..self.open.len()).into_par_iter().map(mask).collect();
        Self { lit: self.lit, scale: self.scale + 1, open }
    }

    /// The patch by `offset` from patch `i`, if it is of the same chart and neither is buried.
    fn at(&self, i: usize, offset: IVec2) -> Option<usize> {
        let (ground, patches) = (self.lit.ground, self.lit.ground.patches);
        let page = patches.page(i) as usize;
        let [width, height] = ground.atlas.pages[page].map(|n| n as i32);
        let p = IVec2::from(ground.column_row(i).map(|c| c as i32)) + offset;
        let is_on = p.x >= 0 && p.y >= 0 && p.x < width && p.y < height && !self.lit.exposure.is_buried(i);
        let patch = if is_on { patches.at(page, (p.y * width + p.x) as usize) } else { None };
        patch.filter(|&j| patches.chart[j] == patches.chart[i] && !self.lit.exposure.is_buried(j))
    }

    /// The texels around patch `i` that have something to say about it.
    fn taps(&self, i: usize) -> Taps {
        let mut taps = Taps { list: [Tap::default(); 25], count: 1 };
        taps.list[0] = Tap { patch: i as u32, weight: SPLINE[0] * SPLINE[0], alike: 1.0, offset: Vec2::ZERO };
        let patches = self.lit.ground.patches;
        let page = patches.page(i) as usize;
        let width = i64::from(self.lit.ground.atlas.pages[page][0]);
        let (own, normal) = (i64::from(patches.texel(i)[1]), patches.normal[i]);
        let mut open = self.open[i];
        while open != 0 {
            let step = step(open.trailing_zeros() as usize);
            open &= open - 1;
            let offset = step << self.scale;
            let texel = own + i64::from(offset.y) * width + i64::from(offset.x);
            let Some(j) = patches.at(page, texel as usize) else { continue };
            let alike = ((patches.normal[j].dot(normal) - APART) / (1.0 - APART)).clamp(0.0, 1.0);
            if alike > 0.0 {
                let weight = SPLINE[step.x.unsigned_abs() as usize] * SPLINE[step.y.unsigned_abs() as usize] * alike;
                taps.list[taps.count] = Tap { patch: j as u32, weight, alike, offset: offset.as_vec2() };
                taps.count += 1;
            }
        }
        taps
    }
}
