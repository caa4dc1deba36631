//! From blocks to texels.
//!
//! A texel shows a plane fitted to its block and the blocks around it, weighed by distance (moving least squares): inside a chart
//! that is bilinear interpolation, and at a chart's border it goes on as the light does. Blocks of curved surfaces answer for any
//! normal ([`Response`]), so that a column is round however large its blocks are.

use super::block::Blocks;
use super::respond::{DIFFERENCE, LANDED, Response, Values};
use crate::light::Lit;
use crate::plane::Plane;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Blocks whose texels are found before they are handed on.
const BATCH: usize = 512;

/// Blocks that a thread takes at once, at most.
const SHARE: usize = 16;

/// Calls `put` with the values of every patch that has a block, block by block. `around` lists each front and its neighbours, `normal`
/// is the one that a patch shows.
pub fn show(
    lit: &Lit,
    blocks: &Blocks,
    around: &[Vec<u32>],
    responses: &[Response],
    normal: &(dyn Fn(usize) -> Vec3 + Sync),
    mut put: impl FnMut(usize, &Values),
) {
    let of_block = |b: usize| -> Vec<Values> {
        let of_patch = |&i: &u32| blend(lit, blocks, responses, &around[b], b, i as usize, normal(i as usize));
        blocks.members(b).iter().map(of_patch).collect()
    };
    for first in (0..around.len()).step_by(BATCH) {
        let batch = first..(first + BATCH).min(around.len());
        let shown: Vec<Vec<Values>> = batch.clone().into_par_iter().with_max_len(SHARE).map(of_block).collect();
        for (b, shown) in batch.zip(&shown) {
            blocks.members(b).iter().zip(shown).for_each(|(&i, values)| put(i as usize, values));
        }
    }
}

/// Block `b` and those that touch it, of the same region.
pub fn neighbours(lit: &Lit, blocks: &Blocks, b: usize) -> Vec<u32> {
    let block = &blocks.list[b];
    let first = blocks.members(b)[0] as usize;
    let ([x, y], page) = (lit.ground.column_row(first), block.page);
    let side = 1i64 << block.level;
    let low = [i64::from(x) & !(side - 1), i64::from(y) & !(side - 1)];
    let [width, height] = lit.ground.atlas.pages[page as usize].map(i64::from);
    let mut found = Vec::with_capacity(4 * side as usize + 5);
    found.push(b as u32);
    let mut look = |x: i64, y: i64| {
        if x < 0 || y < 0 || x >= width || y >= height {
            return;
        }
        if let Some(i) = lit.ground.patches.at(page as usize, (y * width + x) as usize)
            && let Some(other) = blocks.list.get(blocks.front_of[i] as usize)
            && other.region == block.region
            && found.last() != Some(&blocks.front_of[i])
        {
            found.push(blocks.front_of[i]);
        }
    };
    for k in -1..=side {
        look(low[0] + k, low[1] - 1);
        look(low[0] + k, low[1] + side);
    }
    for k in 0..side {
        look(low[0] - 1, low[1] + k);
        look(low[0] + side, low[1] + k);
    }
    found[1..].sort_unstable();
    found.dedup();
    found.shrink_to_fit();
    found
}

/// Slopes are held back by this share of the weights.
const RIDGE: f32 = 0.05;

/// Blocks that a texel is read between, at most: one of 8 x 8 texels has 36 single ones around it.
pub(super) const MOST_AROUND: usize = 64;

fn blend(
    lit: &Lit,
    blocks: &Blocks,
    responses: &[Response],
    around: &[u32],
    b: usize,
    i: usize,
    normal: Vec3,
) -> Values {
    let mut sum = [0.0f32; 8];
    let is_between = read_between(lit, blocks, around, b, i, |n, share| {
        sum.iter_mut().zip(responses[n].at(normal)).for_each(|(s, v)| *s += share * v);
    });
    if !is_between {
        return responses[b].at(normal);
    }
    for (k, s) in sum.iter_mut().enumerate().filter(|(k, _)| *k != DIFFERENCE) {
        *s = s.clamp(0.0, if k == LANDED { 1.0 } else { f32::MAX });
    }
    sum
}

/// Calls `add` with the blocks that patch `i` of block `b` is read between, those `around` and itself, and the share of each; shares
/// add up to 1. False, and no call, where it is read from its own block alone.
pub(super) fn read_between(
    lit: &Lit,
    blocks: &Blocks,
    around: &[u32],
    b: usize,
    i: usize,
    mut add: impl FnMut(usize, f32),
) -> bool {
    if around.len() == 1 {
        return false;
    }
    let [x, y] = lit.ground.column_row(i);
    let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    let own = (1u32 << blocks.list[b].level) as f32;
    let mut plane = Plane::default();
    let mut weights = [(0.0f32, Vec2::ZERO); MOST_AROUND];
    let around = &around[..around.len().min(MOST_AROUND)];
    let mut reach = 0.0f32;
    for (slot, &n) in weights.iter_mut().zip(around) {
        let block = &blocks.list[n as usize];
        let side = own.max((1u32 << block.level) as f32);
        let d = block.at - at;
        let tent = (Vec2::ONE - d.abs() / side).max(Vec2::ZERO).element_product();
        // Blocks that are cut off by their chart's border count by what is there.
        let weight = tent * block.texels() as f32 / (1u32 << (2 * block.level)) as f32;
        plane.add(weight, d);
        *slot = (weight, d);
        reach = reach.max(side);
    }
    let Some(shares) = plane.shares(RIDGE, reach) else { return false };
    for ((weight, d), &n) in weights.iter().zip(around).filter(|((weight, _), _)| *weight > 0.0) {
        add(n as usize, shares.of(*weight, *d));
    }
    true
}
