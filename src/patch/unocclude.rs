//! Which parts of a patch lie inside other geometry, and so see nothing but backs; or in its crevices, or behind its walls.
//!
//! A texel of the floor that reaches under a box holds, as its plain area average, the darkness inside the box, and shows it
//! as a dark rim outside. So footprints are probed with rays from a 4 x 4 grid of cells; cells whose rays all start
//! inside of something ([`probe`](super::probe)) are left out of every later sample. Where all cells of a patch lie inside single-sided
//! solids, the whole patch is buried: it is dark, and is filled from its neighbours when the page is finished. Backs of
//! double-sided surfaces can be lit, as those of a box with a lamp inside, so a patch that sees only such stays as it is.
//!
//! Nearly all patches lie in the open. So a few rays from each look around first; patches are probed where rays of their
//! block or of one next to it met a back or a face right above, and next to every block in which something buried was found.
//!
//! Nothing lies inside of sheets, which let light through: they are looked through here.
//!
//! A room that was modelled inside out sees nothing but backs everywhere: a chart that is (almost) all buried is taken as
//! it is.

use super::probe::{Opening, ends_in_crevice, leave, probe};
use super::{Cutter, Footprint, Ground, Patches, Stops, footprint::CellMask, rasterize::morton};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::store::Entry;
use crate::trace::{Hit, Ray};
use crate::work::{Change, Stored};
use glam::Vec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// Blocks of 2^1 texels a side are probed together.
const BLOCK_LEVEL: u32 = 1;

/// First rays are stratified over squares of 2^2 texels a side.
const STRATA_LEVEL: u32 = 2;

/// Blocks whose first rays are traced together.
const BATCH: usize = 64;

/// Blocks that a thread probes at once, at most.
const SHARE: usize = 16;

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

/// Set where a patch is covered.
const COVERED: u32 = 1 << 16;

fn code(opening: &Opening) -> u32 {
    u32::from(opening.cells.0) | if opening.is_covered { COVERED } else { 0 }
}

/// How far around what changed patches may lie in it, over their side.
const NEAR: f32 = 4.0;

/// Finds the open cells of every patch.
///
/// # Errors
/// `Cancelled`.
pub fn unocclude(ground: &Ground, seed: u32, progress: &dyn Progress) -> Result<Exposure> {
    Ok(Openings::find(ground, seed, progress)?.expose(ground))
}

/// What lies in the open of those patches that don't as a whole.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Openings {
    /// Ascending patches, and their open cells, with [`COVERED`].
    cells: Vec<[u32; 2]>,
    /// The share of the area of each.
    shares: Vec<f32>,
    rays: u64,
}

impl Openings {
    /// The exposure of the patches of `ground`.
    pub fn expose(&self, ground: &Ground) -> Exposure {
        let patches = ground.patches;
        let mut area = patches.area.clone();
        let mut cells = vec![CellMask::ALL; patches.len()];
        for (&[i, open], share) in self.cells.iter().zip(&self.shares) {
            cells[i as usize] = CellMask(open as u16);
            area[i as usize] *= share;
        }
        let stops = Stops::new(ground);
        if let Some(stops) = &stops {
            area.iter_mut().enumerate().for_each(|(i, area)| *area *= stops.share(i));
        }
        Exposure { cells, area, stops, rays: self.rays }
    }

    /// True where all are of `patches` patches.
    pub fn fit(&self, patches: usize) -> bool {
        self.cells.len() == self.shares.len() && self.cells.last().is_none_or(|last| (last[0] as usize) < patches)
    }

    /// Finds them.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn find(ground: &Ground, seed: u32, progress: &dyn Progress) -> Result<Self> {
        let all = |_: usize| true;
        Ok(Self::of(find(ground, seed, vec![Opening::ALL; ground.patches.len()], &all, progress)?))
    }

    /// Finds them after a `change`, where it can have changed them; all, where these are of other patches.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn find_again(&self, ground: &Ground, seed: u32, change: &Change, progress: &dyn Progress) -> Result<Self> {
        let patches = ground.patches;
        let Some(numbers) = change.numbers(&ground.runs()).filter(|_| self.fit(change.patches as usize)) else {
            return Self::find(ground, seed, progress);
        };
        let is_near = |i: usize| {
            let reach = NEAR * patches.area[i].sqrt();
            let position = patches.position[i];
            let is_in = |b: &[Vec3; 2]| position.cmpge(b[0] - reach).all() && position.cmple(b[1] + reach).all();
            change.surfaces[patches.surface(i) as usize] || change.boxes.iter().any(is_in)
        };
        let mut openings = vec![Opening::ALL; patches.len()];
        for (&[before, open], &share) in self.cells.iter().zip(&self.shares) {
            let i = numbers[before as usize] as usize;
            if i < patches.len() && !is_near(i) {
                openings[i] = Opening { cells: CellMask(open as u16), share, is_covered: open & COVERED != 0 };
            }
        }
        Ok(Self::of(find(ground, seed, openings, &is_near, progress)?))
    }

    fn of((openings, rays): (Vec<Opening>, u64)) -> Self {
        let partly = || openings.iter().zip(0..).filter(|(opening, _)| **opening != Opening::ALL);
        Self {
            cells: partly().map(|(opening, i)| [i, code(opening)]).collect(),
            shares: partly().map(|(opening, _)| opening.share).collect(),
            rays,
        }
    }
}

impl Stored for Openings {
    fn sections(&self) -> Vec<Cow<'_, [u8]>> {
        let bytes = [bytemuck::cast_slice(&self.cells), bytemuck::cast_slice(&self.shares)];
        bytes.map(Cow::Borrowed).into_iter().chain([Cow::Owned(self.rays.to_le_bytes().to_vec())]).collect()
    }

    fn restore(entry: &Entry) -> Option<Self> {
        let cells = entry.slice::<[u32; 2]>(0).ok()?.to_vec();
        let &[rays] = entry.slice::<u64>(2).ok()? else { return None };
        cells.is_sorted().then_some(Self { cells, shares: entry.slice::<f32>(1).ok()?.to_vec(), rays })
    }
}

/// Finds the openings of patches that are `wanted`, and of those around that follow from them; `openings` are those of the others.
fn find(
    ground: &Ground,
    seed: u32,
    mut openings: Vec<Opening>,
    wanted: &(dyn Fn(usize) -> bool + Sync),
    progress: &dyn Progress,
) -> Result<(Vec<Opening>, u64)> {
    let patches = ground.patches;
    progress.begin("unocclude", patches.len() as u64);
    let blocks = ground.blocks(BLOCK_LEVEL);
    let is_wanted = |block: &Range<usize>| block.clone().any(wanted);
    let numbers: Vec<usize> = (0..blocks.len()).into_par_iter().filter(|&b| is_wanted(&blocks[b])).collect();
    let some: Vec<Range<usize>> = numbers.iter().map(|&b| blocks[b].clone()).collect();
    let mut rays = some.iter().map(|block| block.len() as u64).sum();
    let suspects = glance(ground, &some, seed, progress)?;
    let mut suspects: Vec<usize> = suspects.into_iter().map(|k| numbers[k]).collect();
    let mut is_probed = vec![false; blocks.len()];
    // What lies inside goes on into the next block, wherever it was found: it is followed to its end.
    while !suspects.is_empty() {
        let grid = Grid::new(ground, &blocks, &suspects);
        let is_near = |b: &usize| !is_probed[*b] && grid.is_near(ground, &blocks[*b]);
        let near: Vec<usize> = (0..blocks.len()).into_par_iter().filter(is_near).collect();
        let probed: Vec<(Vec<Opening>, u64)> = near
            .par_iter()
            .with_max_len(SHARE)
            .map(|&b| {
                progress.check()?;
                let mut traced = 0;
                let found = probe(ground, blocks[b].clone(), seed, &mut traced);
                Ok((found, traced))
            })
            .collect::<Result<_>>()?;
        suspects.clear();
        for (&b, (found, traced)) in near.iter().zip(probed) {
            is_probed[b] = true;
            rays += traced;
            if found.iter().any(|o| *o != Opening::ALL) {
                suspects.push(b);
            }
            openings[blocks[b].clone()].copy_from_slice(&found);
        }
    }
    leave_inside_out_charts(ground, &mut openings);
    Ok((openings, rays))
}

fn leave_inside_out_charts(ground: &Ground, openings: &mut [Opening]) {
    let patches = ground.patches;
    let mut start = 0;
    for chart in patches.chart.chunk_by(|a, b| a == b) {
        let end = start + chart.len();
        let area = |all: bool| -> f64 {
            (start..end)
                .filter(|&i| all || openings[i].cells == CellMask::EMPTY)
                .map(|i| f64::from(patches.area[i]))
                .sum()
        };
        if area(false) > INSIDE_OUT * area(true) {
            // What nobody looks into is black, whichever way it was modelled.
            openings[start..end].iter_mut().filter(|o| !o.is_covered).for_each(|o| *o = Opening::ALL);
        }
        start = end;
    }
}

/// The blocks from which some ray meets a back, or a face right above.
fn glance(ground: &Ground, blocks: &[Range<usize>], seed: u32, progress: &dyn Progress) -> Result<Vec<usize>> {
    let suspicious: Vec<Vec<usize>> = (0..blocks.len().div_ceil(BATCH))
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
                        owner.push((b, i));
                    }
                }
            }
            let mut hits = vec![None; rays.len()];
            ground.tracer.closest_solid(&rays, &mut hits);
            progress.advance(batch.map(|b| blocks[b].len() as u64).sum());
            let suspect = |((ray, hit), (b, i)): ((&Ray, &Option<Hit>), (usize, usize))| {
                let hit = hit.as_ref()?;
                (hit.back || ends_in_crevice(ground, i, ray, hit)).then_some(b)
            };
            let mut found: Vec<usize> = rays.iter().zip(&hits).zip(owner).filter_map(suspect).collect();
            found.dedup();
            Ok(found)
        })
        .collect::<Result<_>>()?;
    Ok(suspicious.concat())
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
