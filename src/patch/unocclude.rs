//! Which parts of a patch lie inside other geometry, and so see nothing but backs.
//!
//! A texel of the floor that reaches under a box holds, as its plain area average, the darkness inside the box, and shows it
//! as a dark rim outside. So each footprint is probed with rays from a 4 x 4 grid of cells; cells whose rays all start
//! inside of something ([`look`]) are left out of every later sample. Where all cells of a patch lie inside single-sided solids, the whole patch is buried: it is dark, and is filled from its neighbours when the page is finished. Backs of
//! double-sided surfaces can be lit, as those of a box with a lamp inside, so a patch that sees only such stays as it is.
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
    /// The area of each patch that is in the open [m^2]: what it receives and sends light with.
    pub area: Vec<f32>,
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
    progress.begin("unocclude", patches.len() as u64);
    let probed: Vec<(CellMask, u64)> = (0..patches.len())
        .into_par_iter()
        .map(|i| {
            if i % 256 == 0 {
                progress.check()?;
                progress.advance(256.min(patches.len() - i) as u64);
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
    let open = |(area, cells): (&f32, &CellMask)| area * cells.0.count_ones() as f32 / 16.0;
    let area = patches.area.iter().zip(&cells).map(open).collect();
    Ok(Exposure { cells, area, rays })
}

fn probe(ground: &Ground, i: usize, sequence: Sequence) -> (CellMask, u64) {
    let footprint = ground.footprint(i);
    if footprint.is_empty() {
        return (CellMask::ALL, 0);
    }
    let side = CellMask::SIDE as f32;
    let mut traced = 0;
    let ray = |cell: u32, index: u32| {
        let [x, y, du, dv] = sequence.point(index * 16 + cell, 0);
        let u = [((cell % 4) as f32 + x) / side, ((cell / 4) as f32 + y) / side];
        let point = footprint.sample(u);
        let origin = ground.tracer.off_surface(point.position, point.normal);
        Ray { origin, direction: frame(point.normal) * cosine_hemisphere([du, dv]) }
    };
    // Most patches see no back at all.
    let first: Vec<Ray> = (0..16).map(|cell| ray(cell, 0)).collect();
    let mut hits = vec![None; first.len()];
    ground.tracer.closest(&first, &mut hits);
    traced += 16;
    if !hits.iter().flatten().any(|h: &Hit| h.back) {
        return (CellMask::ALL, traced);
    }
    // Cells from which something else than an inside is seen, and those from which something else than a black inside is.
    let (mut open, mut lit) = (0u16, 0u16);
    for cell in 0..16 {
        for index in 0..RAYS_A_CELL {
            match look(ground, ray(cell, index), &mut traced) {
                Seen::Open => {
                    open |= 1 << cell;
                    lit |= 1 << cell;
                    break;
                }
                Seen::Inside => lit |= 1 << cell,
                Seen::BlackInside => {}
            }
        }
    }
    (CellMask(if open == 0 { lit } else { open }), traced)
}

/// What a ray says about where it starts.
enum Seen {
    /// In the open.
    Open,
    /// Inside something double-sided.
    Inside,
    /// Inside something single-sided.
    BlackInside,
}

/// A ray that first meets a back starts inside. So does one that leaves more solids than it enters: solids that overlap or touch,
/// as the walls of a room at its corners, show each other's fronts inside.
fn look(ground: &Ground, ray: Ray, traced: &mut u64) -> Seen {
    let is_double_sided = |number: u32| {
        let (surface, triangle) = ground.tracer.place(number);
        ground.scene.material(surface, triangle).double_sided
    };
    let mut hit: [Option<Hit>; 1] = [None];
    ground.tracer.closest(&[ray], &mut hit);
    *traced += 1;
    if let Some(hit) = hit[0].filter(|h| h.back) {
        let (surface, triangle) = ground.tracer.place(hit.triangle);
        let material = ground.scene.material(surface, triangle);
        return match (material.double_sided, material.is_emissive()) {
            (false, _) => Seen::BlackInside,
            (true, false) => Seen::Inside,
            // In front of a back that shines, as between a lamp and its ceiling, nothing is in the dark.
            (true, true) => Seen::Open,
        };
    }
    let (mut left, mut black) = (0, false);
    ground.tracer.crossings(&ray, |triangle, back| {
        left += if back { 1 } else { -1 };
        black |= back && !is_double_sided(triangle);
    });
    *traced += 1;
    match (left > 0, black) {
        (false, _) => Seen::Open,
        (true, false) => Seen::Inside,
        (true, true) => Seen::BlackInside,
    }
}
