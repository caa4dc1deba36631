//! Light between blocks: `E_b = sky_b + sum over links of w B`, with `B = rho (E0 + E)` of the patch that a link sees.
//!
//! What a patch sends is its own albedo and direct light with its block's interreflected light: as a source, blocks are enough, but
//! shadows and textures stay sharp. Sweeps repeat until what one more would change is below a residual.

use super::block::Blocks;
use super::guide::Guide;
use super::link::{Half, Sight};
use super::reach::Reach;
use super::shoot::Sampled;
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::light::direct::hemisphere_weight;
use crate::patch::NONE;
use crate::progress::Progress;
use glam::Vec3;
use rayon::prelude::*;

/// Sweeps at most: at an albedo of 0.97 light falls to a thousandth in some 230.
const MOST_SWEEPS: u32 = 400;

/// What does not change from sweep to sweep.
pub struct System<'a> {
    pub lit: &'a Lit<'a>,
    pub blocks: &'a Blocks,
    pub sampled: &'a [Sampled],
    /// What shines and how far it reaches, once it is known.
    pub bright: Option<&'a (Guide, Reach)>,
    /// What patches send of their direct light, rho E0 [lm/m^2].
    pub sent: &'a [Rgb],
    /// Direct light on backs, as far as it is known [lx]; empty where they send none.
    pub on_backs: &'a [Option<[Rgb; 2]>],
    /// Irradiance of blocks from the sky [lx].
    pub base: &'a [Rgb],
}

/// How sweeps ended.
#[derive(Clone, Copy, Debug, Default)]
pub struct Swept {
    pub sweeps: u64,
    /// Estimated remaining change of irradiance, relative to its mean.
    pub residual: f64,
}

impl System<'_> {
    /// Block `b` and what it sees shine.
    pub fn sight(&self, b: usize) -> Sight<'_> {
        Sight { block: &self.blocks.list[b], bright: self.bright.map(|(guide, reach)| (guide, reach.of(b))) }
    }

    /// What a link's target sends [lm/m^2] while blocks receive `irradiance`.
    #[inline]
    pub fn radiosity(&self, patch: usize, back: bool, irradiance: &[Rgb]) -> Rgb {
        let albedo = self.lit.reflectance.0[patch];
        let of = if back { &self.blocks.back_of } else { &self.blocks.front_of };
        let own = match back {
            true => self.on_backs.get(patch).copied().flatten().map_or(Rgb::ZERO, |direct| albedo * direct[0]),
            false => self.sent[patch],
        };
        match of[patch] {
            NONE => own,
            b => own + albedo * irradiance[b as usize],
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
        let (sight, scale) = (self.sight(b), found.halves[k].scale);
        for (direction, mean, w) in found.halves[k].sky.iter().map(|link| found.drawn.sky_solid_angle(&sight, link)) {
            let cos = normal.map_or(mean, |n| n.dot(direction));
            if cos > 0.0 {
                let share = hemisphere_weight(self.lit.lights, self.lit.params, direction, cos);
                add(sky.radiance(self.lit.ground.scene, direction) * (share * cos * w * scale));
            }
        }
    }

    /// Irradiance of half `half` by links.
    pub fn collect(&self, half: &Half, irradiance: &[Rgb]) -> Rgb {
        let mut sum = Rgb::ZERO;
        for (link, weight) in half.links.iter().zip(&half.weights) {
            let (patch, back) = link.target();
            sum += self.radiosity(patch, back, irradiance) * *weight;
        }
        sum
    }

    /// Irradiance of every block after one more bounce.
    pub fn sweep(&self, irradiance: &[Rgb]) -> Vec<Rgb> {
        (0..self.blocks.list.len())
            .into_par_iter()
            .map(|b| {
                let [first, second] = &self.sampled[b].halves;
                self.base[b] + 0.5 * (self.collect(first, irradiance) + self.collect(second, irradiance))
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
        for sweep in 0..most.unwrap_or(MOST_SWEEPS) {
            progress.check()?;
            let next = self.sweep(irradiance);
            let (mut change, mut total) = (0.0f64, 0.0f64);
            for (b, block) in self.blocks.list.iter().enumerate() {
                let area = f64::from(block.area);
                change += f64::from(luminance((next[b] - irradiance[b]).abs())) * area;
                total += f64::from(luminance(next[b])) * area;
            }
            *irradiance = next;
            swept.sweeps = u64::from(sweep) + 1;
            if change <= 0.0 || total <= 0.0 {
                swept.residual = 0.0;
                break;
            }
            // Each bounce is a share r of the one before; what is left adds up to r / (1 - r) of the last one.
            let ratio = before.map_or(0.9, |b| (change / b).clamp(0.0, 0.99));
            swept.residual = change / total * ratio / (1.0 - ratio);
            before = Some(change);
            if swept.residual < residual && most.is_none() {
                break;
            }
        }
        Ok(swept)
    }
}
