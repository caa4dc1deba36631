//! Charts cut into tiles: which triangles reach into which square of texels. Each tile is a run of Morton order of its chart, so that
//! tiles can be rasterized in any order and come out sorted when they are put in theirs.

use super::clip::{Convex, Window};
use super::rasterize::{morton, texel_triangle};
use crate::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::trace::Triangles;
use crate::unwrap::Atlas;
use glam::DVec2;
use rayon::prelude::*;
use std::ops::Range;

/// Tiles have 2^7 texels along each side: small enough to share out a single large wall, large enough that triangles are seldom in
/// several.
const LEVEL: u32 = 7;

/// How far [texels] a triangle is taken to reach beyond what clipping says: far more than rounding, so that no tile is missed.
const MARGIN: f64 = 1e-6;

/// Triangles handled between two looks at the caller's wish to stop.
const CHUNK: usize = 1024;

/// A triangle in a tile of its chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry {
    /// Chart number over all surfaces.
    pub chart: u32,
    /// Morton code of the tile on its page.
    tile: u32,
    /// Triangle number over all surfaces.
    pub triangle: u32,
    /// Texels of the tile that the triangle's box reaches into.
    texels: u32,
}

impl Entry {
    /// True for the same tile of the same chart.
    pub fn is_beside(&self, other: &Self) -> bool {
        (self.chart, self.tile) == (other.chart, other.tile)
    }

    /// Texels of the tile on a page of `size`.
    pub fn window(&self, size: [u32; 2]) -> Window {
        let low = super::rasterize::from_morton(self.tile);
        let low = [low.0 << LEVEL, low.1 << LEVEL];
        let last = [0, 1].map(|k| (low[k] + (1 << LEVEL)).min(size[k]) - 1);
        Window { low, last }
    }
}

/// The triangles of all charts by chart, tile and number; `chart_first` is the number of each surface's first chart.
///
/// # Errors
/// `Cancelled`.
pub(super) fn entries(
    scene: &Scene,
    atlas: &Atlas,
    triangles: &Triangles,
    chart_first: &[u32],
    progress: &dyn Progress,
) -> Result<Vec<Entry>> {
    let count = triangles.count();
    let chunks: Vec<Vec<Entry>> = (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .with_max_len(1)
        .map(|chunk| {
            progress.check()?;
            let mut found = Vec::new();
            for number in (chunk * CHUNK..count.min((chunk + 1) * CHUNK)).map(|n| n as u32) {
                let (surface, triangle) = triangles.place(number);
                let mesh = scene.surfaces[surface].mesh;
                let size = atlas.pages[atlas.placements[surface].page as usize];
                let chart = chart_first[surface] + atlas.meshes[mesh].chart[triangle];
                each_tile(texel_triangle(scene, atlas, surface, triangle), size, |tile, texels| {
                    found.push(Entry { chart, tile, triangle: number, texels });
                });
            }
            Ok(found)
        })
        .collect::<Result<_>>()?;
    let mut all = chunks.concat();
    all.par_sort_unstable();
    Ok(all)
}

/// Calls `visit(tile, texels)` for the tiles of a page of `size` that a triangle reaches into.
fn each_tile(triangle: [DVec2; 3], size: [u32; 2], mut visit: impl FnMut(u32, u32)) {
    if !triangle.iter().all(|p| p.is_finite()) {
        return;
    }
    let (page, whole) = (Window::page(size), Convex::triangle(triangle));
    let widen = |(low, high): (f64, f64)| (low - MARGIN, high + MARGIN);
    let (top, bottom) = page.cells(1, widen(whole.range(1)));
    for y in top >> LEVEL..=bottom >> LEVEL {
        let (first, end) = ((y << LEVEL).max(top), ((y + 1) << LEVEL).min(bottom + 1));
        let row = whole.between(1, f64::from(y << LEVEL), f64::from((y + 1) << LEVEL));
        if row.corners().len() < 3 {
            continue;
        }
        let (left, right) = page.cells(0, widen(row.range(0)));
        for x in left >> LEVEL..=right >> LEVEL {
            let columns = ((x + 1) << LEVEL).min(right + 1) - (x << LEVEL).max(left);
            visit(morton(x, y), columns * (end - first));
        }
    }
}

/// `entries` cut between tiles into jobs of about `texels` texels each.
pub(super) fn jobs(entries: &[Entry], texels: u32) -> Vec<Range<usize>> {
    let mut jobs: Vec<Range<usize>> = Vec::new();
    let (mut end, mut sum) = (0, texels);
    for tile in entries.chunk_by(Entry::is_beside) {
        // Triangles of one tile overlap in their boxes, not in its texels.
        let weight = tile.iter().fold(0, |sum: u32, e| sum.saturating_add(e.texels)).min(1 << (2 * LEVEL));
        match jobs.last_mut() {
            Some(job) if sum < texels => job.end += tile.len(),
            _ => {
                jobs.push(end..end + tile.len());
                sum = 0;
            }
        }
        sum += weight;
        end += tile.len();
    }
    jobs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_of_a_triangle_hold_all_of_it() {
        let triangle = [DVec2::new(3.0, 2.0), DVec2::new(600.5, 128.0), DVec2::new(120.0, 511.9)];
        let mut tiles = Vec::new();
        each_tile(triangle, [640, 512], |tile, texels| {
            assert!(texels > 0 && texels <= 1 << (2 * LEVEL));
            tiles.push(tile);
        });
        super::super::clip::for_each_texel(triangle, Window::page([640, 512]), |x, y, _| {
            assert!(tiles.contains(&morton(x >> LEVEL, y >> LEVEL)), "{x}, {y}");
        });
        // The box has 20 tiles; those at the corners away from the triangle hold nothing of it.
        assert!(tiles.len() < 20);
    }

    #[test]
    fn jobs_part_between_tiles_alone() {
        let entry = |chart, tile| Entry { chart, tile, triangle: 0, texels: 10 };
        let entries = [entry(0, 0), entry(0, 0), entry(0, 1), entry(1, 1), entry(1, 1), entry(1, 2)];
        assert_eq!(jobs(&entries, 25), [0..3, 3..6]);
        assert_eq!(jobs(&entries, 1), [0..2, 2..3, 3..5, 5..6]);
        assert!(jobs(&[], 25).is_empty());
    }
}
