//! Connected parts of charts: texels on either side of a wall that stands on a floor have little in common.

use super::{Ground, NONE};
use rayon::prelude::*;

/// Patches looked at in one go, about; charts stay whole.
const RUN: usize = 1 << 14;

/// The connected region of its chart that each of `patches`, in order, belongs to, named by its first patch. What keeps regions apart:
/// patches that are missing (buried ones), and neighbours that `is_joined` parts. By patch; [`NONE`] for the missing ones.
pub fn regions(ground: &Ground, patches: &[u32], is_joined: impl Fn(usize, usize) -> bool + Sync) -> Vec<u32> {
    debug_assert!(patches.is_sorted());
    let mut parent = vec![NONE; ground.patches.len()];
    let mut runs = Vec::new();
    let (mut first, mut rest, mut left) = (0, &mut parent[..], patches);
    while !rest.is_empty() {
        let mut length = rest.len().min(RUN);
        let chart = ground.patches.chart[first + length - 1];
        length += ground.patches.chart[first + length..].iter().take_while(|c| **c == chart).count();
        let (own, others) = rest.split_at_mut(length);
        let (members, more) = left.split_at(left.partition_point(|&i| (i as usize) < first + length));
        runs.push((first, own, members));
        (first, rest, left) = (first + length, others, more);
    }
    runs.into_par_iter().for_each(|(first, parent, members)| join(ground, first, parent, members, &is_joined));
    parent
}

/// Finds the regions of some whole charts, whose patches are numbered from `first` on.
fn join(
    ground: &Ground,
    first: usize,
    parent: &mut [u32],
    members: &[u32],
    is_joined: &(impl Fn(usize, usize) -> bool + Sync),
) {
    let all = ground.patches;
    for &i in members {
        parent[i as usize - first] = i;
    }
    let root = |parent: &mut [u32], mut i: u32| {
        loop {
            let above = parent[i as usize - first];
            if above == i {
                return i;
            }
            parent[i as usize - first] = parent[above as usize - first];
            i = parent[i as usize - first];
        }
    };
    for &i in members {
        let [page, texel] = all.texel(i as usize);
        let [width, height] = ground.atlas.pages[page as usize];
        let (x, y) = (texel % width, texel / width);
        let right = (x + 1 < width).then_some(texel + 1);
        let below = (y + 1 < height).then_some(texel + width);
        for neighbour in [right, below].into_iter().flatten() {
            let Some(j) = all.at(page as usize, neighbour as usize) else { continue };
            let is_here = all.chart[j] == all.chart[i as usize] && parent[j - first] != NONE;
            if is_here && is_joined(i as usize, j) {
                let (a, b) = (root(parent, i), root(parent, j as u32));
                parent[a.max(b) as usize - first] = a.min(b);
            }
        }
    }
    for &i in members {
        parent[i as usize - first] = root(parent, i);
    }
}
