//! Which parts of a patch lie inside other geometry, and so see nothing but backs.
//!
//! A texel of the floor that reaches under a box holds, as its plain area average, the darkness inside the box, and shows it
//! as a dark rim outside. So each footprint is probed with rays from a 4 x 4 grid of cells; cells whose rays all hit backs
//! of triangles are left out of every later sample. Where all cells of a patch see backs alone, the whole patch is buried:
//! it is dark, and is filled from its neighbours when the page is finished.
//!
//! A room that was modelled inside out sees nothing but backs everywhere: a chart that is (almost) all buried is taken as
//! it is.

use super::{Ground, footprint::CellMask};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray};
use rayon::prelude::*;

/// Rays that a suspicious cell gets in all before it counts as buried.
const RAYS_A_CELL: u32 = 8;

/// A chart with more than this share of buried patches was not modelled with its front outside: nothing is repaired on it.
const INSIDE_OUT: f64 = 0.95;

/// The cells of each patch that may be sampled; empty for buried patches.
#[derive(Clone, Debug)]
pub struct Exposure {
    pub cells: Vec<CellMask>,
    /// Rays that were traced.
    pub rays: u64,
}

impl Exposure {
    /// True where no part of the patch is in the open.
    pub fn is_buried(&self, patch: usize) -> bool {
        self.cells[patch] == CellMask::EMPTY
    }

    /// Number of buried patches.
    pub fn buried_count(&self) -> usize {
        self.cells.iter().filter(|c| **c == CellMask::EMPTY).count()
    }

    /// The share of a patch's cells in the open, as a grey.
    pub fn share(&self, patch: usize) -> Rgb {
        Rgb::splat(self.cells[patch].0.count_ones() as f32 / 16.0)
    }
}

/// Probes every patch.
///
/// # Errors
/// `Cancelled`.
pub fn unocclude(ground: &Ground, seed: u32, progress: &dyn Progress) -> Result<Exposure> {
    let patches = ground.patches;
    let probed: Vec<(CellMask, u64)> = (0..patches.len())
        .into_par_iter()
        .map(|i| {
            if i % 256 == 0 {
                progress.check()?;
            }
            Ok(probe(ground, i, Sequence::new(seed, Stage::Unocclude, i as u64)))
        })
        .collect::<Result<_>>()?;
    let rays = probed.iter().map(|p| p.1).sum();
    let mut cells: Vec<CellMask> = probed.into_iter().map(|p| p.0).collect();
    let mut start = 0;
    for chart in patches.chart.chunk_by(|a, b| a == b) {
        let end = start + chart.len();
        let area = |all: bool| -> f64 {
            (start..end).filter(|&i| all || cells[i] == CellMask::EMPTY).map(|i| f64::from(patches.area[i])).sum()
        };
        if area(false) > INSIDE_OUT * area(true) {
            cells[start..end].fill(CellMask::ALL);
        }
        start = end;
    }
    Ok(Exposure { cells, rays })
}

fn probe(ground: &Ground, i: usize, sequence: Sequence) -> (CellMask, u64) {
    let footprint = ground.footprint(i);
    if footprint.is_empty() {
        return (CellMask::ALL, 0);
    }
    let side = CellMask::SIDE as f32;
    let mut traced = 0;
    let mut sees_back = |cell: u32, index: u32| {
        let [x, y, du, dv] = sequence.point(index * 16 + cell, 0);
        let u = [((cell % 4) as f32 + x) / side, ((cell / 4) as f32 + y) / side];
        let point = footprint.sample(u);
        let ray = Ray {
            origin: ground.tracer.off_surface(point.position, point.normal),
            direction: frame(point.normal) * cosine_hemisphere([du, dv]),
        };
        let mut hit: [Option<Hit>; 1] = [None];
        ground.tracer.closest(&[ray], &mut hit);
        traced += 1;
        hit[0].is_some_and(|h| h.back)
    };
    let mut open = 0u16;
    for cell in 0..16 {
        if (0..RAYS_A_CELL).any(|index| !sees_back(cell, index)) {
            open |= 1 << cell;
        }
    }
    (CellMask(open), traced)
}
