//! How much of what shines reaches each neighbourhood: found by shooting from the clusters, as progressive refinement shoots.
//!
//! From a dark corner of a hall hardly one way in a hundred to a bright spot is open, so a block that tried clusters by power and
//! geometry alone would waste nearly all of its samples. Rays from the clusters land where their light does, so a few hundred thousand of
//! them tell for every neighbourhood which clusters it sees.

use super::block::{Block, Blocks};
use super::guide::Guide;
use crate::Result;
use crate::light::Lit;
use crate::patch::NONE;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::{Hit, Ray};
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Neighbourhoods, about.
const NEIGHBOURHOODS: f32 = 1000.0;

/// Rays from each cluster, at most and at least; in between, about four for each texel in all.
const MOST_RAYS: u32 = 2048;
const LEAST_RAYS: u32 = 256;

/// A cluster that no ray found to reach a neighbourhood is still taken to do so by this share: what is drawn too seldom is noise
/// where it is seen after all.
const LEAST: f32 = 0.2;

/// Beyond this share the estimate without occluders must be off.
const MOST: f32 = 2.0;

/// The share of each cluster's light that gets through to each neighbourhood: parts of space, by the way that blocks there face.
pub struct Reach {
    /// The neighbourhood of each block.
    of_block: Vec<u32>,
    clusters: usize,
    /// By neighbourhood and cluster.
    share: Vec<f32>,
    pub rays: u64,
}

impl Reach {
    /// Shoots.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn new(lit: &Lit, blocks: &Blocks, guide: &Guide, seed: u32, progress: &dyn Progress) -> Result<Self> {
        let total: f64 = blocks.list.iter().filter(|b| !b.back).map(|b| f64::from(b.area)).sum();
        let mut side = (total as f32 / NEIGHBOURHOODS).sqrt().max(f32::MIN_POSITIVE);
        let mut number = numbered(blocks, side);
        // Foliage has far more surface to itself than walls have.
        while number.1 > 4 * NEIGHBOURHOODS as usize && side.is_finite() {
            side *= 2.0;
            number = numbered(blocks, side);
        }
        let (of_block, count_of) = number;
        let clusters = guide.len();
        let count = (4 * lit.ground.patches.len() / clusters.max(1)) as u32;
        let count = count.clamp(LEAST_RAYS, MOST_RAYS);
        let landed: Vec<Vec<u32>> = (0..clusters)
            .into_par_iter()
            .with_max_len(1)
            .map(|c| {
                progress.check()?;
                Ok(shoot(lit, blocks, guide, c, count, seed))
            })
            .collect::<Result<_>>()?;
        let mut arrived = vec![0.0f32; count_of * clusters];
        let mut unoccluded = vec![0.0f32; count_of * clusters];
        for (c, hits) in landed.iter().enumerate() {
            let flux = guide.flux(c) / count as f32;
            for &b in hits {
                arrived[of_block[b as usize] as usize * clusters + c] += flux;
            }
        }
        let (open, mut arriving) = (vec![1.0f32; clusters], Vec::new());
        for (b, block) in blocks.list.iter().enumerate().filter(|(_, b)| !b.back) {
            let row = of_block[b] as usize * clusters;
            guide.arriving(block, &open, &mut arriving);
            let sums = &mut unoccluded[row..row + clusters];
            sums.iter_mut().zip(&arriving).for_each(|(sum, arriving)| *sum += arriving * block.area);
        }
        let share = arrived
            .iter()
            .zip(&unoccluded)
            .map(
                |(arrived, unoccluded)| {
                    if *unoccluded > 0.0 { (arrived / unoccluded).clamp(LEAST, MOST) } else { LEAST }
                },
            )
            .collect();
        Ok(Self { of_block, clusters, share, rays: clusters as u64 * u64::from(count) })
    }

    /// The share of each cluster that gets through to block `b`.
    pub fn of(&self, b: usize) -> &[f32] {
        let row = self.of_block[b] as usize * self.clusters;
        &self.share[row..row + self.clusters]
    }

    /// Keeps to the neighbourhoods when blocks are split; `origin` is what each new block was part of.
    pub fn follow(&mut self, origin: &[u32]) {
        self.of_block = origin.iter().map(|&o| self.of_block[o as usize]).collect();
    }
}

/// The neighbourhood of each block where they are cubes of `side` [m], and how many there are.
fn numbered(blocks: &Blocks, side: f32) -> (Vec<u32>, usize) {
    let mut numbers: BTreeMap<([i32; 3], usize), u32> = BTreeMap::new();
    let of = |block: &Block| {
        let cell: IVec3 = (block.centre / side).floor().as_ivec3();
        let next = numbers.len() as u32;
        *numbers.entry((cell.to_array(), way(block.normal))).or_insert(next)
    };
    let of_block = blocks.list.iter().map(of).collect();
    (of_block, numbers.len())
}

/// The blocks in which rays from cluster `c` land.
fn shoot(lit: &Lit, blocks: &Blocks, guide: &Guide, c: usize, count: u32, seed: u32) -> Vec<u32> {
    let sequence = Sequence::new(seed, Stage::Reach, c as u64);
    let rays: Vec<Ray> = (0..count).map(|index| guide.emit(c, sequence.point(index, 0))).collect();
    let tracer = lit.ground.tracer;
    let mut hidden = vec![false; rays.len()];
    if guide.is_sky(c) {
        // The sky must be seen from where the ray starts.
        let back: Vec<Ray> = rays.iter().map(|r| Ray { origin: r.origin, direction: -r.direction }).collect();
        tracer.occluded_rays(&back, &mut hidden);
    }
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    tracer.closest(&rays, &mut hits);
    let block_of = |(hit, hidden): (&Option<Hit>, &bool)| {
        let hit = hit.as_ref().filter(|hit| !hit.back && !hidden)?;
        let b = blocks.front_of[lit.ground.patch_under(hit)?];
        (b != NONE).then_some(b)
    };
    hits.iter().zip(&hidden).filter_map(block_of).collect()
}

/// Which of the six ways of the axes `normal` points to most.
fn way(normal: Vec3) -> usize {
    let axis = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(0);
    2 * axis + usize::from(normal[axis] < 0.0)
}
