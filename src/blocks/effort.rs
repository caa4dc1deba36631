//! Effort where the error is: how many samples each block gets, and what error is left.
//!
//! For a given number of samples the noise over all blocks is least where each gets them in proportion to the standard deviation of
//! one sample times the root of its area. Errors are weighed against a mean of the block's light and the scene's, so that dark
//! rooms are not left in the dark.

use super::block::Block;
use super::field::Field;
use super::smooth::Smoothed;
use crate::color::luminance;
use crate::light::{Direct, Lit};
use rayon::prelude::*;

/// Samples of a half of a block, at least and at most.
const LEAST: u32 = 8;
const MOST: u32 = 1024;

/// Stratification gains as samples become more: their variance falls with this power of their number beyond the first.
const STRATIFIED: f32 = 0.15;

/// Fronts whose demands are summed by one thread, and how closely the scale of a plan is found.
const PART: usize = 2048;
const PRECISION: f32 = 1.001;

/// The share of blocks, by area, whose errors don't count: the worst.
const WORST: f64 = 0.01;

/// Blocks darker than this share of the mean are held to no less absolutely.
const DARKEST: f32 = 0.02;

/// Errors are weighed against `own^OWN mean^(1 - OWN)` of the block's light and the scene's: at 1 dark corners would take all samples, at 0
/// they would be left to the noise.
const OWN: f32 = 0.7;

/// Of errors so weighed, the part that counts beside those over the mean light.
pub const LOCAL_PART: f64 = 0.82;

/// What the error of a block with the light `own` is weighed against where the scene has `mean` [lx].
fn level(own: f32, mean: f32) -> f32 {
    if mean > 0.0 { mean * (own / mean).max(DARKEST).powf(OWN) } else { f32::MIN_POSITIVE }
}

/// How much each block matters, and what is known of its noise.
pub struct Stakes {
    /// Variance of one sample [lx^2] (luminance), the mean over the neighbourhood.
    pub variance: Vec<f32>,
    /// The light that its error is held against [lx].
    pub level: Vec<f32>,
    /// Mean light of the scene [lx], direct light included.
    pub mean: f32,
    /// What the sequences' stratification and smoothing leave of the variance of independent samples.
    pub gain: f32,
}

/// Root mean squares of the errors that are left.
#[derive(Clone, Copy, Debug, Default)]
pub struct Left {
    /// Noise, and what interpolation between blocks misses, relative to the scene's mean light.
    pub noise: f64,
    pub bias: f64,
    /// Both together, and noise alone, relative to the level of each block.
    pub local: f64,
    pub local_noise: f64,
}

/// A block of detail beyond the plane through its neighbours shows, interpolated, errors of this share of it: for a constant
/// second derivative 0.4.
const INTERPOLATED: f32 = 0.4;

impl Stakes {
    /// From what is known now.
    pub fn new(field: &Field, variance: &[f32], direct: &Direct, gain: f32) -> Self {
        let blocks = &field.blocks.list;
        let (of_patches, direct) = (direct, direct_light(field, direct));
        let all = |b: usize| luminance(field.irradiance[b]) + direct[b];
        let (mut sum, mut area) = (0.0f64, 0.0f64);
        for (b, block) in blocks[..direct.len()].iter().enumerate() {
            sum += f64::from(all(b)) * f64::from(block.area);
            area += f64::from(block.area);
        }
        let Lit { ground, exposure, .. } = *field.lit;
        for i in (0..ground.patches.len()).filter(|&i| field.lit.is_known(i)) {
            let a = f64::from(exposure.area[i]);
            (sum, area) = (sum + a * f64::from(luminance(of_patches.shown[i])), area + a);
        }
        let mean = (sum / area.max(f64::MIN_POSITIVE)) as f32;
        let pooled = |b: usize| {
            let around = &field.around[b];
            around.iter().map(|&n| variance[n as usize]).sum::<f32>() / around.len() as f32
        };
        Self {
            variance: (0..direct.len()).into_par_iter().map(pooled).collect(),
            level: (0..direct.len()).map(|b| level(all(b), mean)).collect(),
            mean,
            gain,
        }
    }

    /// Mean square of the noise relative to `level` if samples were independent and blocks not smoothed.
    pub fn independent_noise(&self, field: &Field) -> f64 {
        let (mut sum, mut area) = (0.0f64, 0.0f64);
        for (b, (variance, block)) in self.variance.iter().zip(&field.blocks.list).enumerate() {
            let n = field.sampled[b].drawn.samples().max(1);
            sum += f64::from(variance / (self.level[b] * self.level[b])) / f64::from(2 * n) * f64::from(block.area);
            area += f64::from(block.area);
        }
        sum / area.max(f64::MIN_POSITIVE)
    }

    /// Samples for each half of each front so that the noise, relative to `level`, has the mean square `target`: those to be added to
    /// what there is. At most `most` in all.
    pub fn plan(&self, field: &Field, target: f64, most: f64) -> Vec<u32> {
        let blocks = &field.blocks.list[..self.level.len()];
        let whole: f64 = blocks.iter().map(|b| f64::from(b.area)).sum();
        let demand = |(b, block): (usize, &Block)| {
            let relative = self.variance[b] / (self.level[b] * self.level[b]);
            let have = field.sampled[b].drawn.samples();
            Demand {
                wish: (relative * block.area).sqrt(),
                have,
                noise: 0.5 * self.gain * relative * (f64::from(block.area) / whole.max(f64::MIN_POSITIVE)) as f32,
                gained: (have.max(LEAST) as f32).powf(STRATIFIED),
            }
        };
        let demands: Vec<Demand> = blocks.par_iter().enumerate().map(demand).collect();
        let gain: Vec<f32> = (0..=MOST / LEAST).map(|groups| ((groups * LEAST) as f32).powf(-STRATIFIED)).collect();
        // Sums of parts, always the same ones: as many threads as there are find the same.
        let outcome = |scale: f32| {
            let part = |part: &[Demand]| {
                let add = |(noise, samples): (f64, f64), demand: &Demand| {
                    let (left, added) = demand.outcome(scale, &gain);
                    (noise + f64::from(left), samples + f64::from(added))
                };
                part.iter().fold((0.0, 0.0), add)
            };
            let parts: Vec<(f64, f64)> = demands.par_chunks(PART).map(part).collect();
            parts.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
        };
        let largest = demands.iter().map(|d| d.wish).fold(f32::MIN_POSITIVE, f32::max);
        let (mut low, mut high) = (LEAST as f32 / largest, 1e9f32.max(LEAST as f32 / largest));
        while high > PRECISION * low {
            let middle = low.sqrt() * high.sqrt();
            let (noise, samples) = outcome(middle);
            if noise > target && samples < most { low = middle } else { high = middle }
        }
        let scale = if outcome(high).1 <= most { high } else { low };
        demands.iter().map(|demand| demand.count(scale) - demand.have).collect()
    }
}

/// What a front asks of a plan.
struct Demand {
    /// Samples in proportion to this are worth the most.
    wish: f32,
    /// Samples that each half has.
    have: u32,
    /// Mean square noise of one sample over the whole scene, relative to `level`.
    noise: f32,
    /// What stratification has brought.
    gained: f32,
}

impl Demand {
    /// Samples of each half where `scale` times its wish is to be met.
    fn count(&self, scale: f32) -> u32 {
        let ideal = (scale * self.wish).clamp(LEAST as f32, MOST as f32);
        // Whole groups of points are well distributed.
        let groups = (ideal / LEAST as f32 + 0.5) as u32;
        (groups * LEAST).max(self.have)
    }

    /// The noise that is then left, and the samples to be added to both halves. `gain` is what stratification leaves, by groups.
    fn outcome(&self, scale: f32, gain: &[f32]) -> (f32, u32) {
        let count = self.count(scale);
        let groups = (count / LEAST) as usize;
        let left = gain[groups.min(gain.len() - 1)] * self.gained;
        (left.min(1.0) * self.noise / count as f32, 2 * (count - self.have))
    }
}

impl Left {
    /// What is left after smoothing, without the worst blocks.
    pub fn new(field: &Field, stakes: &Stakes, smoothed: &Smoothed) -> Self {
        let of_block = |b: usize| {
            let noise = smoothed.error[b].max(0.0);
            (noise, INTERPOLATED * INTERPOLATED * smoothed.detail[b], field.blocks.list[b].area, stakes.level[b])
        };
        let mut all: Vec<(f32, f32, f32, f32)> = (0..smoothed.error.len()).map(of_block).collect();
        all.sort_unstable_by(|a, b| (a.0 + a.1.max(0.0)).total_cmp(&(b.0 + b.1.max(0.0))));
        let area: f64 = all.iter().map(|a| f64::from(a.2)).sum();
        let (mut left, mut seen) = (Self::default(), 0.0);
        for (noise, bias, area_of, level) in all {
            let a = f64::from(area_of);
            if seen + a > (1.0 - WORST) * area {
                break;
            }
            seen += a;
            left.noise += f64::from(noise) * a;
            left.bias += f64::from(bias) * a;
            left.local += f64::from((noise + bias) / (level * level)) * a;
            left.local_noise += f64::from(noise / (level * level)) * a;
        }
        let (whole, mean) = (seen.max(f64::MIN_POSITIVE), f64::from(stakes.mean).max(f64::MIN_POSITIVE));
        let share = |sum: f64, against: f64| (sum / whole).max(0.0).sqrt() / against;
        Self {
            noise: share(left.noise, mean),
            bias: share(left.bias, mean),
            local: share(left.local, 1.0),
            local_noise: share(left.local_noise, 1.0),
        }
    }

    /// The larger of the errors against the scene's light and against each block's own.
    pub fn error(&self) -> f64 {
        self.noise.hypot(self.bias).max(LOCAL_PART * self.local)
    }
}

/// Which fronts to split: those whose detail, interpolated, is off by more than `tolerance` relative to `level`, where it can be told
/// from noise; and those with too few neighbours to know.
pub fn too_coarse(field: &Field, stakes: &Stakes, smoothed: &Smoothed, tolerance: f32) -> Vec<bool> {
    (0..smoothed.detail.len())
        .map(|b| {
            let block = &field.blocks.list[b];
            let limit = tolerance * stakes.level[b];
            let detail = INTERPOLATED * INTERPOLATED * smoothed.detail[b];
            // Where there are too few neighbours to tell, the block's own parts must.
            let is_alone = smoothed.doubt[b].is_infinite();
            block.texels() > 1 && (is_alone || detail > limit * limit && smoothed.detail[b] > smoothed.doubt[b])
        })
        .collect()
}

/// Which fronts are too large for how near the surfaces around them are: their sides may be up to `reach` times the harmonic mean of
/// the distances (Ward, Rubinstein, Clear 1988).
pub fn too_near(field: &Field, distance: &[f32], reach: f32) -> Vec<bool> {
    (0..distance.len())
        .map(|b| {
            let block = &field.blocks.list[b];
            block.texels() > 1 && block.side() > reach * distance[b]
        })
        .collect()
}

/// Harmonic mean of the distances that each front's rays went [m].
pub fn distances(field: &Field) -> Vec<f32> {
    (0..field.blocks.fronts())
        .map(|b| {
            let found = &field.sampled[b];
            2.0 * found.drawn.hemisphere as f32 / found.inverse_distance.max(f32::MIN_POSITIVE)
        })
        .collect()
}

/// Direct light of each front [lx], luminance.
fn direct_light(field: &Field, direct: &Direct) -> Vec<f32> {
    let blocks = &field.blocks;
    let of = |b: usize| {
        let block = &blocks.list[b];
        let each = (block.first as usize..).zip(blocks.members(b));
        let sum: f32 = each.map(|(k, &i)| luminance(direct.shown[i as usize]) * blocks.area(k)).sum();
        sum / block.area.max(f32::MIN_POSITIVE)
    };
    (0..blocks.fronts()).into_par_iter().map(of).collect()
}
