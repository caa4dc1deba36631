//! The built-in filter: noise told from detail scale by scale.
//!
//! A texel's light is the sum of what planes through its neighbourhood hold at a coarse scale, and of details d_k, what ever finer planes
//! hold beyond (the "a trous" pyramid: Holschneider et al. 1989; Dammertz et al. 2010 for light). Planes, where others take
//! means, leave gradients as they are, at a chart's border as well (first-order regression: Moon et al. 2014; Bitterli et
//! al. 2016).
//!
//! With A and B the means of two independent halves of the samples, each scale's filter is linear, so that of the detail of
//! (A + B) / 2 and of (A - B) / 2 the first holds light and noise, the second the same noise alone. Their squares, pooled over the
//! neighbourhood, tell the share of the detail that is light, and so much of it is kept (Wiener 1949; the two halves as in
//! Rousselle, Knaus, Zwicker 2012): where noise is small against the detail, as at contact shadows, nothing happens. Filters weigh by
//! geometry alone, so the estimate has no bias of choice.
//!
//! Cost: 25 texels a scale, three times. Charts are islands: no texel looks at another chart, nor past buried texels.

use crate::color::Rgb;
use crate::error::Result;
use crate::light::Lit;
use crate::plane::Plane;
use crate::progress::Progress;
use glam::{IVec2, Vec2, Vec3};
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
}

impl Default for Scales {
    fn default() -> Self {
        Self { count: 5 }
    }
}

/// A texel of a neighbourhood, its weight and its place [texels].
#[derive(Clone, Copy, Default)]
struct Tap {
    patch: u32,
    weight: f32,
    offset: Vec2,
}

/// The taps of one neighbourhood, the texel itself first.
struct Taps {
    list: [Tap; 25],
    count: usize,
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
        let mut values: Vec<Vec<Rgb>> = vec![light.clone(), difference.clone()];
        values.extend(parts.iter().map(|part| (**part).clone()));
        let mut targets: Vec<&mut Vec<Rgb>> = vec![light, difference];
        targets.extend(parts.iter_mut().map(|part| &mut **part));
        for scale in 0..self.count {
            progress.check()?;
            let (smooth, squares) = planes(lit, &values, scale);
            let squares = pool(lit, &pool(lit, &squares, scale), scale);
            let lost = |[whole, noise]: &[f32; 2]| if *whole > 0.0 { (noise / whole).min(1.0) } else { 0.0 };
            let lost: Vec<f32> = squares.par_iter().map(lost).collect();
            for (k, target) in targets.iter_mut().enumerate() {
                let (value, smooth) = (&values[k], &smooth[k]);
                target.par_iter_mut().enumerate().for_each(|(i, t)| *t -= (value[i] - smooth[i]) * lost[i]);
            }
            values = smooth;
        }
        targets[0].par_iter_mut().for_each(|v| *v = v.max(Vec3::ZERO));
        Ok(())
    }
}

/// Planes through each texel's neighbourhood at `scale`, of all `values`; and the squares of what the first two leave over.
fn planes(lit: &Lit, values: &[Vec<Rgb>], scale: u32) -> (Vec<Vec<Rgb>>, Vec<[f32; 2]>) {
    let reach = (1u32 << scale) as f32;
    let shares = |i: usize| -> Taps {
        let mut taps = Taps::new(lit, i, scale);
        let mut plane = Plane::default();
        taps.list[..taps.count].iter().for_each(|tap| plane.add(tap.weight, tap.offset));
        match plane.shares(RIDGE, reach) {
            Some(shares) => {
                taps.list[..taps.count].iter_mut().for_each(|tap| tap.weight = shares.of(tap.weight, tap.offset));
            }
            None => taps.count = 1,
        }
        taps
    };
    // By texel, so that neighbourhoods are found once.
    let width = values.len();
    let mut smooth = vec![Vec3::ZERO; width * values[0].len()];
    let mut squares = vec![[0.0; 2]; values[0].len()];
    let rows = smooth.par_chunks_mut(width).zip(&mut squares).enumerate().with_min_len(256);
    rows.for_each(|(i, (row, squares))| {
        let taps = shares(i);
        for (slot, value) in row.iter_mut().zip(values) {
            let centre = value[i];
            // Relative to the texel itself, so that what is even stays so to the bit.
            let around = taps.list[1..taps.count].iter();
            *slot = centre + around.map(|tap| (value[tap.patch as usize] - centre) * tap.weight).sum::<Vec3>();
        }
        *squares = [0, 1].map(|k| (values[k][i] - row[k]).length_squared());
    });
    let column = |k: usize| smooth.par_iter().skip(k).step_by(width).copied().collect();
    ((0..width).map(column).collect(), squares)
}

/// Means over each texel's neighbourhood.
fn pool(lit: &Lit, squares: &[[f32; 2]], scale: u32) -> Vec<[f32; 2]> {
    let mean = |i: usize| {
        let taps = Taps::new(lit, i, scale);
        let (mut sums, mut weights) = ([0.0f32; 2], 0.0);
        for tap in &taps.list[..taps.count] {
            let square = squares[tap.patch as usize];
            sums = [sums[0] + tap.weight * square[0], sums[1] + tap.weight * square[1]];
            weights += tap.weight;
        }
        sums.map(|sum| if weights > 0.0 { sum / weights } else { 0.0 })
    };
    (0..squares.len()).into_par_iter().with_min_len(256).map(mean).collect()
}

impl Taps {
    /// The texels around patch `i` at `scale` that have something to say about it.
    fn new(lit: &Lit, i: usize, scale: u32) -> Self {
        let mut taps = Self { list: [Tap::default(); 25], count: 1 };
        taps.list[0] = Tap { patch: i as u32, weight: SPLINE[0] * SPLINE[0], offset: Vec2::ZERO };
        let (ground, patches) = (lit.ground, lit.ground.patches);
        if lit.exposure.is_buried(i) {
            return taps;
        }
        let page = patches.page(i) as usize;
        let [width, height] = ground.atlas.pages[page].map(|n| n as i32);
        let here = IVec2::from(ground.column_row(i).map(|c| c as i32));
        let at = |p: IVec2| {
            let is_on = p.x >= 0 && p.y >= 0 && p.x < width && p.y < height;
            let patch = if is_on { patches.at(page, (p.y * width + p.x) as usize) } else { None };
            patch.filter(|&j| patches.chart[j] == patches.chart[i] && !lit.exposure.is_buried(j))
        };
        for k in (0..25).filter(|k| *k != 12) {
            let step = IVec2::new(k % 5 - 2, k / 5 - 2);
            let offset = step * (1 << scale);
            let Some(j) = at(here + offset) else { continue };
            let alike = ((patches.normal[j].dot(patches.normal[i]) - APART) / (1.0 - APART)).clamp(0.0, 1.0);
            if alike == 0.0 || !is_joined(here, offset, &at) {
                continue;
            }
            let weight = SPLINE[step.x.unsigned_abs() as usize] * SPLINE[step.y.unsigned_abs() as usize] * alike;
            taps.list[taps.count] = Tap { patch: j as u32, weight, offset: offset.as_vec2() };
            taps.count += 1;
        }
        taps
    }
}

/// True where the texels on the way from `here` by `offset` are of the chart, too.
fn is_joined(here: IVec2, offset: IVec2, at: &impl Fn(IVec2) -> Option<usize>) -> bool {
    let steps = offset.abs().max_element();
    (1..steps).all(|step| {
        // Rounded to the nearest texel.
        let p = here + (2 * offset * step + steps).div_euclid(IVec2::splat(2 * steps));
        at(p).is_some()
    })
}
