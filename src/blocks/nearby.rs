//! Where something that has changed comes close to blocks that haven't: they see more detail there than when they were cut.

use super::block::Block;
use crate::light::Lit;
use crate::work::Change;
use glam::{IVec3, Vec3};
use std::collections::HashMap;

/// Sine of the least height above a flat block at which something is seen well.
const LOW: f32 = 0.1;

/// Patches of what has changed and casts, as it stands now, by cells of space.
pub struct Nearby {
    /// Length of a cell's sides [m].
    side: f32,
    /// The middles [m] and sizes [m] of patches.
    cells: HashMap<IVec3, Vec<(Vec3, f32)>>,
}

impl Nearby {
    /// Of what lies no further than `side` [m] from where it is asked for.
    pub fn new(lit: &Lit, change: &Change, side: f32) -> Self {
        let (patches, mut cells) = (lit.ground.patches, HashMap::new());
        for (run, _) in lit.ground.runs().into_iter().zip(&change.surfaces).filter(|(_, changed)| **changed) {
            for i in run.map(|i| i as usize).filter(|&i| lit.ground.casts(i)) {
                let (position, size) = (patches.position[i], patches.area[i].sqrt());
                cells.entry(cell(position, side)).or_insert_with(Vec::new).push((position, size));
            }
        }
        Self { side, cells }
    }

    /// How far from the middle of `block` the nearest is that it sees [m]; infinite where it is further than asked for.
    pub fn distance(&self, block: &Block) -> f32 {
        let middle = cell(block.centre, self.side);
        let around = (0..27).map(|k| middle + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let all = around.filter_map(|cell| self.cells.get(&cell)).flatten();
        let distance = |&(position, size): &(Vec3, f32)| {
            let way = position - block.centre;
            let is_seen = !block.is_flat() || way.dot(block.normal) > LOW * way.length();
            is_seen.then(|| (way.length() - 0.5 * size).max(0.0))
        };
        all.filter_map(distance).fold(f32::INFINITY, f32::min)
    }
}

fn cell(position: Vec3, side: f32) -> IVec3 {
    (position / side).floor().as_ivec3()
}
