//! Which parts of a patch lie inside other geometry, and so see nothing but backs.
//!
//! A texel of the floor that reaches under a box holds, as its plain area average, the darkness inside the box, and shows it
//! as a dark rim outside. So footprints are probed with rays from a 4 x 4 grid of cells; cells whose rays all start
//! inside of something ([`look`]) are left out of every later sample. Where all cells of a patch lie inside single-sided
//! solids, the whole patch is buried: it is dark, and is filled from its neighbours when the page is finished. Backs of
//! double-sided surfaces can be lit, as those of a box with a lamp inside, so a patch that sees only such stays as it is.
//!
//! Nearly all patches lie in the open. So a few rays from each look around first; patches are probed where rays of their
//! block or of one next to it met a back, and next to every block in which something buried was found.
//!
//! Nothing lies inside of sheets, which let light through: they are looked through here.
//!
//! A room that was modelled inside out sees nothing but backs everywhere: a chart that is (almost) all buried is taken as
//! it is.

use super::{Cutter, Footprint, Ground, Patches, Stops, footprint::CellMask, rasterize::morton};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray};
use rayon::prelude::*;
use std::ops::Range;

/// Blocks of 2^1 texels a side are probed together.
const BLOCK_LEVEL: u32 = 1;

/// First rays are stratified over squares of 2^2 texels a side.
const STRATA_LEVEL: u32 = 2;

/// Blocks whose first rays are traced together.
const BATCH: usize = 64;

/// Blocks that a thread probes at once, at most.
const SHARE: usize = 16;

/// Rays that a cell gets in all before it counts as buried; and those that do where they show the same in all cells of a block.
const RAYS_A_CELL: u32 = 8;
const RAYS_ALIKE: u32 = 2;

/// A chart with more than this share of buried patches was not modelled with its front outside: nothing is repaired on it.
const INSIDE_OUT: f64 = 0.95;

/// The cells of each patch that may be sampled; empty for buried patches.
#[derive(Clone, Debug)]
pub struct Exposure {
    pub cells: Vec<CellMask>,
    /// The area of each patch that is in the open and stops light [m^2]: what it receives and sends light with.
    pub area: Vec<f32>,
    /// What patches stop of the light that meets them; none where all stop all.
    pub stops: Option<Stops>,
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

    /// The share of the light on a patch, 0..=1, that it stops.
    pub fn stop(&self, patch: usize) -> f32 {
        self.stops.as_ref().map_or(1.0, |stops| stops.share(patch))
    }

    /// What a patch stops of each channel, over the mean.
    pub fn taking(&self, patch: usize) -> Rgb {
        self.stops.as_ref().map_or(Rgb::ONE, |stops| stops.taking(patch))
    }

    /// The area of a patch that stops light from each channel [m^2], as far as it is in the open.
    pub fn taking_area(&self, patch: usize) -> glam::DVec3 {
        self.taking(patch).as_dvec3() * f64::from(self.area[patch])
    }

    /// The area with which a patch's back receives and sends light [m^2].
    pub fn back_area(&self, patches: &Patches, patch: usize) -> f32 {
        patches.area[patch] * self.stop(patch)
    }

    /// The share of a patch's cells in the open, as a grey.
    pub fn share(&self, patch: usize) -> Rgb {
        Rgb::splat(self.cells[patch].0.count_ones() as f32 / 16.0)
    }
}

/// Finds the open cells of every patch.
///
/// # Errors
/// `Cancelled`.
pub fn unocclude(ground: &Ground, seed: u32, progress: &dyn Progress) -> Result<Exposure> {
    let patches = ground.patches;
    progress.begin("unocclude", patches.len() as u64);
    let blocks = ground.blocks(BLOCK_LEVEL);
    let mut rays = patches.len() as u64;
    let mut suspects = glance(ground, &blocks, seed, progress)?;
    let mut cells = vec![CellMask::ALL; patches.len()];
    let mut is_probed = vec![false; blocks.len()];
    // What lies inside goes on into the next block, wherever it was found: it is followed to its end.
    while !suspects.is_empty() {
        let grid = Grid::new(ground, &blocks, &suspects);
        let is_near = |b: &usize| !is_probed[*b] && grid.is_near(ground, &blocks[*b]);
        let near: Vec<usize> = (0..blocks.len()).into_par_iter().filter(is_near).collect();
        let probed: Vec<(Vec<CellMask>, u64)> = near
            .par_iter()
            .with_max_len(SHARE)
            .map(|&b| {
                progress.check()?;
                let mut traced = 0;
                let cells = probe(ground, blocks[b].clone(), seed, &mut traced);
                Ok((cells, traced))
            })
            .collect::<Result<_>>()?;
        suspects.clear();
        for (&b, (found, traced)) in near.iter().zip(probed) {
            is_probed[b] = true;
            rays += traced;
            if found.iter().any(|c| *c != CellMask::ALL) {
                suspects.push(b);
            }
            cells[blocks[b].clone()].copy_from_slice(&found);
        }
    }
    leave_inside_out_charts(ground, &mut cells);
    let open = |(area, cells): (&f32, &CellMask)| area * cells.0.count_ones() as f32 / 16.0;
    let mut area: Vec<f32> = patches.area.iter().zip(&cells).map(open).collect();
    let stops = Stops::new(ground);
    if let Some(stops) = &stops {
        area.iter_mut().enumerate().for_each(|(i, area)| *area *= stops.share(i));
    }
    Ok(Exposure { cells, area, stops, rays })
}

fn leave_inside_out_charts(ground: &Ground, cells: &mut [CellMask]) {
    let patches = ground.patches;
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
}

/// The blocks from which some ray meets a back.
fn glance(ground: &Ground, blocks: &[Range<usize>], seed: u32, progress: &dyn Progress) -> Result<Vec<usize>> {
    let meets_backs: Vec<Vec<usize>> = (0..blocks.len().div_ceil(BATCH))
        .into_par_iter()
        .with_max_len(1)
        .map(|batch| {
            progress.check()?;
            let batch = batch * BATCH..blocks.len().min((batch + 1) * BATCH);
            let mut cutter = Cutter::new(ground);
            let (mut rays, mut owner, mut footprint) = (Vec::new(), Vec::new(), Footprint::default());
            for b in batch.clone() {
                for i in blocks[b].clone() {
                    cutter.cut(i, &mut footprint);
                    if !footprint.is_empty() {
                        rays.push(first_ray(ground, i, &footprint, seed));
                        owner.push(b);
                    }
                }
            }
            let mut hits = vec![None; rays.len()];
            ground.tracer.closest_solid(&rays, &mut hits);
            progress.advance(batch.map(|b| blocks[b].len() as u64).sum());
            let is_back = |hit: &Option<Hit>| hit.is_some_and(|h| h.back);
            let mut found: Vec<usize> = hits.iter().zip(owner).filter(|(h, _)| is_back(h)).map(|(_, b)| b).collect();
            found.dedup();
            Ok(found)
        })
        .collect::<Result<_>>()?;
    Ok(meets_backs.concat())
}

/// One ray from a patch: where on the patch it starts and where it goes are stratified over the patches around.
fn first_ray(ground: &Ground, i: usize, footprint: &Footprint, seed: u32) -> Ray {
    let [x, y] = ground.column_row(i);
    let (code, bits) = (morton(x, y), 2 * STRATA_LEVEL);
    let square = (1 << 40) | u64::from(ground.patches.page(i)) << 32 | u64::from(code >> bits);
    let [x, y, du, dv] = Sequence::new(seed, Stage::Unocclude, square).point(code & ((1 << bits) - 1), 0);
    leave(ground, footprint, [x, y], [du, dv])
}

/// Which blocks of the pages are suspicious.
struct Grid {
    /// Blocks along a row of each page, and a mark for each block of a page.
    pages: Vec<(u32, Vec<bool>)>,
}

impl Grid {
    fn new(ground: &Ground, blocks: &[Range<usize>], suspects: &[usize]) -> Self {
        let count = |n: u32| n.div_ceil(1 << BLOCK_LEVEL);
        let empty = |[w, h]: &[u32; 2]| (count(*w), vec![false; (count(*w) * count(*h)) as usize]);
        let mut grid = Self { pages: ground.atlas.pages.iter().map(empty).collect() };
        for &b in suspects {
            let (page, [x, y]) = Self::place(ground, &blocks[b]);
            let (width, marks) = &mut grid.pages[page];
            marks[(y * *width + x) as usize] = true;
        }
        grid
    }

    fn place(ground: &Ground, block: &Range<usize>) -> (usize, [u32; 2]) {
        (ground.patches.page(block.start) as usize, ground.column_row(block.start).map(|c| c >> BLOCK_LEVEL))
    }

    /// True where the block or one that touches it is marked.
    fn is_near(&self, ground: &Ground, block: &Range<usize>) -> bool {
        let (page, [x, y]) = Self::place(ground, block);
        let (width, marks) = &self.pages[page];
        let height = marks.len() as u32 / width;
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let columns = x.saturating_sub(1)..(x + 2).min(*width);
        rows.into_iter().any(|y| columns.clone().any(|x| marks[(y * width + x) as usize]))
    }
}

/// A ray from the place `u` of a footprint, along a cosine-distributed direction.
fn leave(ground: &Ground, footprint: &Footprint, u: [f32; 2], direction: [f32; 2]) -> Ray {
    let point = footprint.sample(u);
    let origin = ground.tracer.off_surface(point.position, point.normal);
    Ray { origin, direction: frame(point.normal) * cosine_hemisphere(direction) }
}

/// A patch that is probed.
struct Probed {
    footprint: Footprint,
    sequence: Sequence,
    /// Cells from which something else than an inside is seen, and those from which something else than a black inside is.
    open: u16,
    lit: u16,
}

impl Probed {
    fn ray(&self, ground: &Ground, cell: u32, index: u32) -> Ray {
        let side = CellMask::SIDE as f32;
        let [x, y, du, dv] = self.sequence.point(index * 16 + cell, 0);
        leave(ground, &self.footprint, [((cell % 4) as f32 + x) / side, ((cell / 4) as f32 + y) / side], [du, dv])
    }

    fn record(&mut self, cell: u32, seen: Seen) {
        self.open |= u16::from(seen == Seen::Open) << cell;
        self.lit |= u16::from(seen != Seen::BlackInside) << cell;
    }

    /// True where nothing tells the cells apart.
    fn is_alike(&self) -> bool {
        self.open == 0 && (self.lit == 0 || self.lit == u16::MAX)
    }

    fn cells(&self) -> CellMask {
        CellMask(if self.open == 0 { self.lit } else { self.open })
    }
}

/// The open cells of the patches of one block.
fn probe(ground: &Ground, block: Range<usize>, seed: u32, traced: &mut u64) -> Vec<CellMask> {
    let mut cutter = Cutter::new(ground);
    let patch = |i: usize| {
        let sequence = Sequence::new(seed, Stage::Unocclude, i as u64);
        Probed { footprint: cutter.footprint(i), sequence, open: 0, lit: 0 }
    };
    let mut patches: Vec<Probed> = block.map(patch).collect();
    for patch in &mut patches {
        if patch.footprint.is_empty() {
            patch.open = u16::MAX;
            continue;
        }
        let rays: Vec<Ray> = (0..16).map(|cell| patch.ray(ground, cell, 0)).collect();
        let mut hits = vec![None; rays.len()];
        ground.tracer.closest_solid(&rays, &mut hits);
        *traced += 16;
        // Many patches beside one that lies inside something see no back at all.
        if !hits.iter().flatten().any(|h: &Hit| h.back) {
            patch.open = u16::MAX;
            continue;
        }
        for (cell, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            patch.record(cell as u32, look(ground, ray, hit, traced));
        }
    }
    for index in 1..RAYS_A_CELL {
        if index >= RAYS_ALIKE && patches.iter().all(Probed::is_alike) {
            break;
        }
        for patch in &mut patches {
            let closed = !patch.open;
            for cell in (0..16).filter(|cell| closed & (1 << cell) != 0) {
                let ray = patch.ray(ground, cell, index);
                let hit = nearest(ground, &ray, traced);
                patch.record(cell, look(ground, &ray, hit, traced));
            }
        }
    }
    patches.iter().map(Probed::cells).collect()
}

fn nearest(ground: &Ground, ray: &Ray, traced: &mut u64) -> Option<Hit> {
    let mut hit = [None];
    ground.tracer.closest_solid(std::slice::from_ref(ray), &mut hit);
    *traced += 1;
    hit[0]
}

/// What a ray says about where it starts.
#[derive(PartialEq)]
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
fn look(ground: &Ground, ray: &Ray, hit: Option<Hit>, traced: &mut u64) -> Seen {
    let is_double_sided = |number: u32| {
        let (surface, triangle) = ground.tracer.place(number);
        ground.scene.material(surface, triangle).double_sided
    };
    if let Some(hit) = hit.filter(|h| h.back) {
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
    ground.tracer.crossings(ray, |triangle, back| {
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
