//! Connected parts of charts: texels on either side of a wall that stands on a floor have little in common.

use super::{Ground, NONE};

/// The connected region of its chart that each of `patches` belongs to, named by its first patch. What keeps regions apart: patches
/// that are missing (buried ones), and neighbours that `is_joined` parts. By patch; [`NONE`] for the missing ones.
pub fn regions(ground: &Ground, patches: &[u32], is_joined: impl Fn(usize, usize) -> bool) -> Vec<u32> {
    let all = ground.patches;
    let mut parent = vec![NONE; all.len()];
    for &i in patches {
        parent[i as usize] = i;
    }
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for &i in patches {
        let [page, texel] = all.texel[i as usize];
        let [width, height] = ground.atlas.pages[page as usize];
        let (x, y) = (texel % width, texel / width);
        let right = (x + 1 < width).then_some(texel + 1);
        let below = (y + 1 < height).then_some(texel + width);
        for neighbour in [right, below].into_iter().flatten() {
            let Some(j) = all.at(page as usize, neighbour as usize) else { continue };
            if parent[j] != NONE && all.chart[j] == all.chart[i as usize] && is_joined(i as usize, j) {
                let (a, b) = (root(&mut parent, i), root(&mut parent, j as u32));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    for &i in patches {
        parent[i as usize] = root(&mut parent, i);
    }
    parent
}
