//! Light between blocks: `E_b = sky_b + sum over links of w B`, with `B = rho (E0 + E)` of the patch that a link sees.
//!
//! What a patch sends is its own albedo and direct light with its block's interreflected light: as a source, blocks are enough, but
//! shadows and textures stay sharp. Sweeps repeat until what one more would change is below a residual.

use super::backs::List;
use super::block::{Block, Blocks};
use super::link::Half;
use super::shoot::Sampled;
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::patch::NONE;
use crate::progress::Progress;
use glam::Vec3;
use rayon::prelude::*;

/// Sweeps at most: at an albedo of 0.97 light falls to a thousandth in some 230.
const MOST_SWEEPS: u32 = 400;

/// What is left may be so many times as much of the light of each place as of all light: a room beside a bright outside has its own. What has less
/// than a share of the mean light counts as if it had that.
const LOCAL: f64 = 4.0;
const DARK: f64 = 1e-3;

/// Patches that a thread takes at least, and blocks that it takes at most.
const BATCH: usize = 4096;

/// What does not change from sweep to sweep.
pub struct System<'a> {
    pub lit: &'a Lit<'a>,
    pub blocks: &'a Blocks,
    pub sampled: &'a [Sampled],
    /// What patches send of their direct light, rho E0 [lm/m^2].
    pub sent: &'a [Rgb],
    /// Direct light on backs; `None` where they send none.
    pub on_backs: Option<&'a BackLight>,
    /// Irradiance of blocks from the sky [lx].
    pub base: &'a [Rgb],
}

/// Direct light on the backs that something sees [lx].
#[derive(Clone, Debug, Default)]
pub struct BackLight {
    /// Of patches that are seen from a front.
    pub of_patch: List<Rgb>,
    /// The mean over each back block from all lights, and from those that are no surface; backs are numbered from 0.
    pub of_block: Vec<Option<[Rgb; 2]>>,
}

/// What patches send [lm/m^2].
#[derive(Default)]
pub struct Radiosity {
    fronts: Vec<Rgb>,
    /// Empty where nothing is double-sided.
    backs: Vec<Rgb>,
}

impl Radiosity {
    /// What is sent where a link ends.
    #[inline]
    pub fn at(&self, (patch, back): (usize, bool)) -> Rgb {
        if back { self.backs[patch] } else { self.fronts[patch] }
    }
}

/// What a half of a block's samples brings [lx].
#[derive(Clone, Copy, Default)]
pub struct Gleaned {
    pub links: Rgb,
    pub sky: Rgb,
    /// The squares of all samples' luminances, added up [lx^2].
    squares: f32,
}

impl Gleaned {
    /// Variance of one of `count` samples [lx^2]; 0 where they are too few to tell.
    pub fn variance(&self, count: u32) -> f32 {
        let (sum, count) = (luminance(self.links + self.sky), count as f32);
        if count < 2.0 { 0.0 } else { (self.squares - sum * sum / count).max(0.0) * count }
    }
}

/// How sweeps ended.
#[derive(Clone, Copy, Debug, Default)]
pub struct Swept {
    pub sweeps: u64,
    /// Estimated remaining change of irradiance, relative to its mean.
    pub residual: f64,
}

impl System<'_> {
    /// What patches send while blocks receive `irradiance`: links read it in one place.
    pub fn radiosity(&self, irradiance: &[Rgb]) -> Radiosity {
        let mut radiosity = Radiosity::default();
        self.send(irradiance, &mut radiosity);
        radiosity
    }

    /// The same in place.
    fn send(&self, irradiance: &[Rgb], radiosity: &mut Radiosity) {
        let (albedo, blocks) = (&self.lit.reflectance.0, self.blocks);
        let of_front = |i: usize| match blocks.front_of[i] {
            NONE => self.sent[i],
            b => self.sent[i] + albedo[i] * irradiance[b as usize],
        };
        (0..albedo.len()).into_par_iter().with_min_len(BATCH).map(of_front).collect_into_vec(&mut radiosity.fronts);
        let fronts = blocks.fronts();
        if fronts == blocks.list.len() {
            return;
        }
        let of_back = |i: usize| match blocks.back_of[i] {
            NONE => Rgb::ZERO,
            b => {
                let direct = self.on_backs.and_then(|on_backs| on_backs.of_block[b as usize - fronts]);
                albedo[i] * (direct.map_or(Rgb::ZERO, |d| d[0]) + irradiance[b as usize])
            }
        };
        (0..albedo.len()).into_par_iter().with_min_len(BATCH).map(of_back).collect_into_vec(&mut radiosity.backs);
        for (i, direct) in self.on_backs.iter().flat_map(|on_backs| on_backs.of_patch.iter()) {
            let i = i as usize;
            radiosity.backs[i] = albedo[i] * (direct + irradiance[blocks.back_of[i] as usize]);
        }
    }

    /// Irradiance of half `k` of block `b` from the sky [lx]: the mean over the block, or about `normal`.
    pub fn sky(&self, b: usize, k: usize, normal: Option<Vec3>) -> Rgb {
        let mut sum = Rgb::ZERO;
        self.each_sky(b, k, normal, |light| sum += light);
        sum
    }

    /// Calls `add` with what each link to the sky brings.
    pub fn each_sky(&self, b: usize, k: usize, normal: Option<Vec3>, mut add: impl FnMut(Rgb)) {
        let Some(sky) = &self.lit.lights.sky else { return };
        let found = &self.sampled[b];
        for (link, weight, tint) in found.halves[k].sky_seen() {
            let direction = link.direction();
            let (mean, w) = found.drawn.solid_angle(direction, weight);
            let cos = normal.map_or(mean, |n| n.dot(direction));
            if cos > 0.0 {
                add(sky.smooth(self.lit.ground.scene, direction) * tint * (cos * w));
            }
        }
    }

    /// Irradiance of half `half` by links.
    pub fn collect(half: &Half, radiosity: &Radiosity) -> Rgb {
        // Most have no tints; what they take off is cheaper than to look for them at each link.
        let white: Rgb =
            half.links.targets().zip(&half.weights).map(|(seen, weight)| radiosity.at(seen) * *weight).sum();
        let taken = half.tints.iter().map(|&(k, tint)| {
            let k = k as usize;
            radiosity.at(half.links.get(k).target()) * (tint - Rgb::ONE) * half.weights[k]
        });
        white + taken.sum::<Rgb>()
    }

    /// What half `k` of block `b` brings, sample by sample.
    pub fn glean(&self, b: usize, k: usize, radiosity: &Radiosity) -> Gleaned {
        let half = &self.sampled[b].halves[k];
        let mut gleaned = Gleaned::default();
        if half.tints.is_empty() {
            for (seen, weight) in half.links.targets().zip(&half.weights) {
                let light = radiosity.at(seen) * *weight;
                gleaned.links += light;
                gleaned.squares += luminance(light).powi(2);
            }
        } else {
            for (link, weight, tint) in half.seen() {
                let light = radiosity.at(link.target()) * tint * weight;
                gleaned.links += light;
                gleaned.squares += luminance(light).powi(2);
            }
        }
        self.each_sky(b, k, None, |light| {
            gleaned.sky += light;
            gleaned.squares += luminance(light).powi(2);
        });
        gleaned
    }

    /// Irradiance of every block after one more bounce.
    pub fn sweep(&self, radiosity: &Radiosity) -> Vec<Rgb> {
        (0..self.blocks.list.len())
            .into_par_iter()
            .with_max_len(BATCH)
            .map(|b| {
                let [first, second] = &self.sampled[b].halves;
                self.base[b] + 0.5 * (Self::collect(first, radiosity) + Self::collect(second, radiosity))
            })
            .collect()
    }

    /// Sweeps from `irradiance` on until the remaining change is below `residual` of the mean, or `most` times.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn solve(
        &self,
        irradiance: &mut Vec<Rgb>,
        residual: f64,
        most: Option<u32>,
        progress: &dyn Progress,
    ) -> Result<Swept> {
        let mut swept = Swept::default();
        let mut before: Option<f64> = None;
        let mut radiosity = Radiosity::default();
        for sweep in 0..most.unwrap_or(MOST_SWEEPS) {
            progress.check()?;
            self.send(irradiance, &mut radiosity);
            let next = self.sweep(&radiosity);
            let (mut change, mut total, mut whole) = (0.0f64, 0.0f64, 0.0f64);
            for (b, block) in self.blocks.list.iter().enumerate() {
                let area = f64::from(block.area);
                change += f64::from(luminance((next[b] - irradiance[b]).abs())) * area;
                total += f64::from(luminance(next[b])) * area;
                whole += area;
            }
            let dark = DARK * total / whole.max(f64::MIN_POSITIVE);
            let local = |(b, block): (usize, &Block)| {
                let level = f64::from(luminance(next[b])).max(dark).max(f64::MIN_POSITIVE);
                f64::from(luminance((next[b] - irradiance[b]).abs())) / level * f64::from(block.area)
            };
            let local = self.blocks.list.iter().enumerate().map(local).sum::<f64>() / whole.max(f64::MIN_POSITIVE);
            *irradiance = next;
            swept.sweeps = u64::from(sweep) + 1;
            if change <= 0.0 || total <= 0.0 {
                swept.residual = 0.0;
                break;
            }
            // Each bounce is a share r of the one before; what is left adds up to r / (1 - r) of the last one. It is swept, not leapt to: between
            // surfaces that face each other closely changes alternate, and a leap along them would grow without end.
            let ratio = before.map_or(0.9, |before| (change / before).clamp(0.0, 0.99));
            swept.residual = change / total * ratio / (1.0 - ratio);
            before = Some(change);
            let is_at_rest = swept.residual < residual && local * ratio / (1.0 - ratio) < LOCAL * residual;
            if is_at_rest && most.is_none() {
                break;
            }
        }
        Ok(swept)
    }
}
