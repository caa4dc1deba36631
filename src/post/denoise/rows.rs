//! The texels of a page row by row, and filters along rows and columns.
//!
//! A neighbourhood of 5 x 5 texels is walked as 5 along the row and 5 along the column: what is found along the one is read along the other.
//! Charts are islands: no texel looks past the border of its chart, nor past buried texels. Along a line, both a straight line fitted by
//! least squares and a mean are sums over at most five texels; of flat charts the shares follow from how many texels are on either side.

use crate::light::Lit;
use crate::patch::NONE;
use glam::{Vec2, Vec4};
use rayon::prelude::*;

/// The cubic B-spline's weights at 0, 1 and 2.
pub const SPLINE: [f32; 3] = [0.375, 0.25, 0.0625];

/// Texels that differ in nothing but place.
pub const EVEN: [f32; 3] = [1.0; 3];

/// Neighbours whose normals differ by more than this cosine say nothing; those between count in part.
const APART: f32 = 0.7;

/// Charts whose normals all agree so far with the first count as flat.
const FLAT: f32 = 0.999;

/// Slopes are held back by this share of the weights.
const RIDGE: f32 = 1e-3;

/// Normals are kept as integers of this length.
const UNIT: f32 = 32767.0;

/// Texels that a thread takes at once.
const BATCH: usize = 1 << 12;

/// The texels of one page, numbered row by row: their *places*.
pub struct Rows {
    width: usize,
    /// The patch at each place.
    pub patch: Vec<u32>,
    /// The texel on the page, row by row, of each place.
    texel: Vec<u32>,
    /// The place of each texel, [`NONE`] where there is none.
    place: Vec<u32>,
    /// How many texels follow to the left, to the right, above and below, without a gap, in the same chart and none of them buried; 255:
    /// so many or more.
    clear: Vec<[u8; 4]>,
    /// The normal, and 1 where the chart is curved; empty where none is.
    normal: Vec<[i16; 4]>,
}

/// Along rows or along columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Along {
    Row,
    Column,
}

/// Weights or shares of the texels by -2 to 2 steps along a line.
type Line = [f32; 5];

/// Shares of flat lines, by the texels on either side.
type Shares = [[Line; 3]; 3];

impl Rows {
    /// The texels of page `page`; `curved` tells the curved charts.
    pub fn new(lit: &Lit, page: usize, curved: &[bool]) -> Self {
        let patches = lit.ground.patches;
        let [width, height] = lit.ground.atlas.pages[page].map(|n| n as usize);
        let mut rows = Self {
            width,
            patch: Vec::new(),
            texel: Vec::new(),
            place: vec![NONE; width * height],
            clear: Vec::new(),
            normal: Vec::new(),
        };
        for texel in 0..width * height {
            if let Some(i) = patches.at(page, texel).filter(|&i| lit.is_wanted(i)) {
                rows.place[texel] = rows.patch.len() as u32;
                rows.patch.push(i as u32);
                rows.texel.push(texel as u32);
            }
        }
        let chart = |place: u32| patches.chart[rows.patch[place as usize] as usize];
        rows.clear = clear(&rows.texel, &rows.place, width, chart);
        if rows.patch.iter().any(|&i| curved[patches.chart[i as usize] as usize]) {
            let normal = |&i: &u32| {
                let n = (patches.normal[i as usize] * UNIT).round();
                [n.x as i16, n.y as i16, n.z as i16, i16::from(curved[patches.chart[i as usize] as usize])]
            };
            rows.normal = rows.patch.par_iter().map(normal).collect();
        }
        rows
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.patch.len()
    }

    /// Straight lines through each place's neighbourhood along `along`, read at the place, into `out`. What is even stays so to the bit.
    pub fn fit(&self, along: Along, scale: u32, values: &[Vec4], out: &mut [Vec4]) {
        let shares = flat_shares();
        each(out, |p, out| {
            let [before, after] = self.sides(along, scale, p);
            let own = values[p];
            let shares = match self.is_curved(p) {
                false => shares[before][after],
                true => line_shares(&self.weights(along, scale, p, &SPLINE)),
            };
            let mut sum = Vec4::ZERO;
            for k in 2 - before..3 + after {
                // Relative to the texel itself.
                sum += (values[self.step(along, scale, p, k)] - own) * shares[k];
            }
            *out = own + sum;
        });
    }

    /// The mean of `value` over the neighbourhood of place `p` along `along`, by the weights `by` at 0, 1 and 2 steps.
    #[inline]
    pub fn mean(&self, along: Along, scale: u32, by: &[f32; 3], p: usize, value: impl Fn(usize) -> Vec2) -> Vec2 {
        let [before, after] = self.sides(along, scale, p);
        let weights = match self.is_curved(p) {
            false => [by[2], by[1], by[0], by[1], by[2]],
            true => self.weights(along, scale, p, by),
        };
        let (mut sum, mut whole) = (Vec2::ZERO, 0.0);
        for (k, weight) in weights.iter().enumerate().take(3 + after).skip(2 - before) {
            sum += value(self.step(along, scale, p, k)) * *weight;
            whole += weight;
        }
        sum / whole
    }

    /// Texels that are seen on either side of place `p`, 2 at most.
    #[inline]
    fn sides(&self, along: Along, scale: u32, p: usize) -> [usize; 2] {
        let [left, right, above, below] = self.clear[p];
        let sides = if along == Along::Row { [left, right] } else { [above, below] };
        sides.map(|n| usize::from(n >> scale).min(2))
    }

    /// The place by `k - 2` steps from place `p`; it must be seen from there.
    #[inline]
    fn step(&self, along: Along, scale: u32, p: usize, k: usize) -> usize {
        match along {
            Along::Row => p + (k << scale) - (2 << scale),
            Along::Column => {
                let texel = self.texel[p] as usize + (k << scale) * self.width - (2 << scale) * self.width;
                self.place[texel] as usize
            }
        }
    }

    #[inline]
    fn is_curved(&self, p: usize) -> bool {
        self.normal.get(p).is_some_and(|n| n[3] != 0)
    }

    /// The weights `by` of what is seen from place `p`, less where normals differ.
    fn weights(&self, along: Along, scale: u32, p: usize, by: &[f32; 3]) -> Line {
        let ([before, after], own) = (self.sides(along, scale, p), self.normal[p]);
        let mut weights = [0.0; 5];
        for (k, weight) in weights.iter_mut().enumerate().take(3 + after).skip(2 - before) {
            let other = self.normal[self.step(along, scale, p, k)];
            let dot: i32 = (0..3).map(|c| i32::from(own[c]) * i32::from(other[c])).sum();
            let alike = ((dot as f32 / (UNIT * UNIT) - APART) / (1.0 - APART)).clamp(0.0, 1.0);
            *weight = by[k.abs_diff(2)] * if k == 2 { 1.0 } else { alike };
        }
        weights
    }
}

/// Calls `find` with every place and what is to be found there.
pub fn each<T: Send>(out: &mut [T], find: impl Fn(usize, &mut T) + Sync) {
    out.par_chunks_mut(BATCH).enumerate().for_each(|(batch, out)| {
        out.iter_mut().enumerate().for_each(|(k, out)| find(batch * BATCH + k, out));
    });
}

/// Which charts are curved.
pub fn curved_charts(lit: &Lit) -> Vec<bool> {
    let patches = lit.ground.patches;
    let mut curved = vec![false; patches.chart.iter().max().map_or(0, |&c| c as usize + 1)];
    let mut first = 0;
    for chart in patches.chart.chunk_by(|a, b| a == b) {
        let normal = patches.normal[first];
        curved[chart[0] as usize] = (first..first + chart.len()).any(|i| patches.normal[i].dot(normal) < FLAT);
        first += chart.len();
    }
    curved
}

/// How many texels follow each place to the left, to the right, above and below, of the same `chart`.
fn clear(texel: &[u32], place: &[u32], width: usize, chart: impl Fn(u32) -> u32) -> Vec<[u8; 4]> {
    let mut clear = vec![[0u8; 4]; texel.len()];
    // The neighbour by `-step` texels, where there is one of the same chart.
    let before = |p: usize, step: usize| -> Option<usize> {
        let at = texel[p] as usize;
        let is_on = if step == 1 { !at.is_multiple_of(width) } else { at >= width };
        let q = if is_on { place[at - step] } else { NONE };
        (q != NONE && chart(q) == chart(p as u32)).then_some(q as usize)
    };
    for p in 0..texel.len() {
        for (side, step) in [(0, 1), (2, width)] {
            clear[p][side] = before(p, step).map_or(0, |q| clear[q][side].saturating_add(1));
        }
    }
    for p in (0..texel.len()).rev() {
        for (side, step) in [(1, 1), (3, width)] {
            if let Some(q) = before(p, step) {
                clear[q][side] = clear[p][side].saturating_add(1);
            }
        }
    }
    clear
}

/// The shares of points of such weights, a step apart, in the value in the middle of the straight line that is nearest to them in the sense of
/// least squares.
fn line_shares(weights: &Line) -> Line {
    let [mut whole, mut first, mut second] = [0.0f32; 3];
    for (k, weight) in weights.iter().enumerate() {
        let d = k as f32 - 2.0;
        whole += weight;
        first += weight * d;
        second += weight * d * d;
    }
    second += RIDGE * whole;
    let determinant = whole * second - first * first;
    let [constant, slope] = [second / determinant, -first / determinant];
    std::array::from_fn(|k| weights[k] * (constant + slope * (k as f32 - 2.0)))
}

/// The same by the spline's weights, for so many points on either side.
fn flat_shares() -> Shares {
    std::array::from_fn(|before| {
        std::array::from_fn(|after| {
            let is_seen = |k: usize| k + before >= 2 && k <= 2 + after;
            line_shares(&std::array::from_fn(|k| if is_seen(k) { SPLINE[k.abs_diff(2)] } else { 0.0 }))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_lines_come_back_however_few_points_there_are() {
        for (before, by_before) in flat_shares().iter().enumerate() {
            for (after, shares) in by_before.iter().enumerate() {
                let value: f32 = shares.iter().enumerate().map(|(k, s)| s * (7.0 + 0.5 * (k as f32 - 2.0))).sum();
                assert!((value - 7.0).abs() < 2e-2, "{before} {after}: {value}");
                let whole: f32 = shares.iter().sum();
                assert!((whole - 1.0).abs() < 1e-2, "{before} {after}: {whole}");
            }
        }
        // In the middle of a chart the spline's own weights.
        assert!((flat_shares()[2][2][1] - SPLINE[1]).abs() < 1e-6);
    }

    #[test]
    fn lines_end_at_gaps_and_at_other_charts() {
        // Two rows of four texels: `0 0 1 1` above `0 . 1 1`.
        let texel = [0, 1, 2, 3, 4, 6, 7];
        let place = [0, 1, 2, 3, 4, NONE, 5, 6];
        let clear = clear(&texel, &place, 4, |p| [0, 0, 1, 1, 0, 1, 1][p as usize]);
        assert_eq!(clear[0], [0, 1, 0, 1]);
        assert_eq!(clear[1], [1, 0, 0, 0]);
        assert_eq!(clear[4], [0, 0, 1, 0]);
        assert_eq!(clear[6], [1, 0, 1, 0]);
    }
}
