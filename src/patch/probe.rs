//! A close look at the patches of one block: which cells of their footprints lie in the open.
//!
//! From each cell rays leave along cosine-distributed directions. A cell lies inside of something where all of them start inside,
//! unless those are backs that can be lit and nothing stands between it and a cell in the open: a sheet above is a roof.
//! What a cell keeps is then cut to size where something begins or ends within the patch:
//!
//! - **Covered** is what something lies right above, nearer than a small part of the texel: a carpet, a box that all but touches the
//!   floor. Nobody looks into such a crevice, and its darkness would show beside it.
//! - **Partly** covered cells are left out where others are whole: they would bring a part of the darkness with them.
//! - **Behind** a single-sided wall that parts the patch is what sees the wall's back on the way to the rest: the world outside of a
//!   room, which nobody looks at from there.

use super::footprint::CellMask;
use super::{Cutter, Footprint, Ground};
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray};
use glam::Vec3;
use std::ops::Range;

/// Rays that a cell gets in all before it counts as buried; and those that do where they show the same in all cells of a block.
const RAYS_A_CELL: u32 = 8;
const RAYS_ALIKE: u32 = 2;

/// Places of a cell from which something right above is looked for.
const PLACES: u32 = 4;

/// A gap narrower than this share of a texel's side is a crevice, unless it is wider than [`WIDEST_CREVICE`].
const CREVICE: f32 = 1.0 / 8.0;

/// A gap wider than this can be looked into [m].
const WIDEST_CREVICE: f32 = 0.02;

/// A crevice narrower than this share of the widest one here closes a chart that lies in it as a whole. In a wider one, as between books
/// on a shelf, such a chart has its own light.
const TIGHT: f32 = 1.0 / 4.0;

/// Patches of which less than this share lies in the open, without a whole cell, are filled from those around.
const SLIVER: f32 = 1.0 / 8.0;

/// What covers a place lies across its normal, by more than this cosine.
const OPPOSITE: f32 = 0.5;

/// A wall that parts a patch is seen from it nearer than this, in sides of the texel.
const PARTING: f32 = 2.0;

/// Height of sight lines between the cells of a patch, in sides of the texel: above crevices.
const LIFT: f32 = 1.0 / 6.0;

/// Cells at opposite corners, and those that others are looked at from: corners and two of the middle, one of which lies across any line
/// that parts a patch.
const DIAGONALS: [[u32; 2]; 2] = [[0, 15], [3, 12]];
const LOOKOUTS: [u32; 6] = [0, 3, 12, 15, 5, 10];

/// Cells of a patch that face further apart than this cosine say nothing about what lies between them.
const ALIKE: f32 = 0.9;

/// What lies in the open of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Opening {
    /// The cells that may be sampled.
    pub cells: CellMask,
    /// The share of its area, 0..=1, that is in the open, that of partly covered cells among it.
    pub share: f32,
    /// Nothing of it is in the open, as it lies in tight crevices.
    pub is_covered: bool,
}

impl Opening {
    pub const ALL: Self = Self { cells: CellMask::ALL, share: 1.0, is_covered: false };

    fn of(mask: u16) -> Self {
        Self { cells: CellMask(mask), share: mask.count_ones() as f32 / 16.0, is_covered: false }
    }
}

/// A ray from the place `u` of a footprint, along a cosine-distributed direction.
pub(super) fn leave(ground: &Ground, footprint: &Footprint, u: [f32; 2], direction: [f32; 2]) -> Ray {
    let point = footprint.sample(u);
    let origin = ground.tracer.off_surface(point.position, point.normal);
    Ray { origin, direction: frame(point.normal) * cosine_hemisphere(direction) }
}

/// The side of patch `i`'s texel on its surface [m].
fn side(ground: &Ground, i: usize) -> f32 {
    (ground.patches.area[i] / ground.patches.coverage[i].max(f32::MIN_POSITIVE)).sqrt()
}

/// True where a ray from patch `i` ends right above it, at something that faces it, and one straight up does: there is a crevice.
pub(super) fn ends_in_crevice(ground: &Ground, i: usize, ray: &Ray, hit: &Hit) -> bool {
    let normal = ground.patches.normal[i];
    // No ray is shorter than its height: most that end so low graze something further away.
    let height = hit.t * normal.dot(ray.direction);
    if height >= WIDEST_CREVICE || height >= crevice(ground, i) || !covers(ground, normal, hit) {
        return false;
    }
    let up = nearest(ground, &Ray { origin: ray.origin, direction: normal }, &mut 0);
    up.is_some_and(|up| up.t < crevice(ground, i) && covers(ground, normal, &up))
}

/// How near something lies that covers patch `i` [m]. Nothing covers what shines.
fn crevice(ground: &Ground, i: usize) -> f32 {
    let (surface, triangle) = ground.tracer.place(ground.patches.first_triangle(i));
    match ground.scene.material(surface, triangle).is_emissive() {
        true => 0.0,
        false => (CREVICE * side(ground, i)).min(WIDEST_CREVICE),
    }
}

/// True where what was hit faces a place with this normal, and doesn't shine on it.
fn covers(ground: &Ground, normal: Vec3, hit: &Hit) -> bool {
    let (surface, triangle) = ground.tracer.place(hit.triangle);
    let [a, b, c] = ground.scene.world_triangle(surface, triangle);
    let along = (b - a).cross(c - a).normalize_or_zero().dot(normal).abs();
    along > OPPOSITE && !ground.scene.material(surface, triangle).is_emissive()
}

/// A sight line from a cell to another one, and its length [m].
struct Line {
    cell: u32,
    ray: Ray,
    length: f32,
}

/// A patch that is probed.
struct Probed {
    footprint: Footprint,
    sequence: Sequence,
    /// The texel's side [m].
    side: f32,
    /// How near what covers it lies [m].
    crevice: f32,
    /// Cells from which something else than an inside is seen, and those from which something else than a black inside is.
    open: u16,
    lit: u16,
    /// Some ray ended right above.
    has_crevice: bool,
    /// Some ray met a black back near by.
    sees_wall: bool,
}

impl Probed {
    fn at(&self, cell: u32, [x, y]: [f32; 2]) -> [f32; 2] {
        let side = CellMask::SIDE as f32;
        [((cell % 4) as f32 + x) / side, ((cell / 4) as f32 + y) / side]
    }

    fn ray(&self, ground: &Ground, cell: u32, index: u32) -> Ray {
        let [x, y, du, dv] = self.sequence.point(index * 16 + cell, 0);
        leave(ground, &self.footprint, self.at(cell, [x, y]), [du, dv])
    }

    fn record(&mut self, cell: u32, seen: Seen) {
        self.open |= u16::from(seen == Seen::Open) << cell;
        self.lit |= u16::from(seen != Seen::BlackInside) << cell;
    }

    /// True where nothing tells the cells apart.
    fn is_alike(&self) -> bool {
        self.open == 0 && (self.lit == 0 || self.lit == u16::MAX)
    }

    /// The first ray of each cell.
    fn look_around(&mut self, ground: &Ground, traced: &mut u64) {
        let rays: Vec<Ray> = (0..16).map(|cell| self.ray(ground, cell, 0)).collect();
        let mut hits = vec![None; rays.len()];
        ground.tracer.closest_solid(&rays, &mut hits);
        *traced += 16;
        let normal = self.footprint.sample([0.5; 2]).normal;
        for (ray, hit) in rays.iter().zip(&hits).filter_map(|(ray, hit)| Some((ray, hit.as_ref()?))) {
            self.has_crevice |= hit.t * normal.dot(ray.direction) < self.crevice && covers(ground, normal, hit);
            self.sees_wall |= hit.t < PARTING * self.side && is_black_back(ground, hit);
        }
        // Many patches beside one that lies inside something see no back at all.
        if !hits.iter().flatten().any(|h| h.back) {
            self.open = u16::MAX;
            return;
        }
        for (cell, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            self.record(cell as u32, look(ground, ray, hit, traced));
        }
    }

    /// What is left after all rays.
    fn opening(&mut self, ground: &Ground, traced: &mut u64) -> Opening {
        if self.open == 0 {
            return Opening::of(self.lit);
        }
        self.open |= self.below_roofs(ground, traced);
        if self.open == u16::MAX && !self.has_crevice && !self.sees_wall {
            return Opening::ALL;
        }
        let mut open = Opening::of(self.open);
        if self.open != u16::MAX || self.has_crevice {
            open = self.uncover(ground, traced);
        }
        if self.sees_wall && open.cells != CellMask::EMPTY {
            let mask = self.in_front(ground, open.cells.0, traced);
            let left = mask.count_ones() as f32 / open.cells.0.count_ones() as f32;
            open = Opening { cells: CellMask(mask), share: open.share * left, ..open };
        }
        open
    }

    /// Cells that see nothing but backs that can be lit, though nothing stands between them and open ones: they lie below a sheet, not
    /// inside of something.
    fn below_roofs(&self, ground: &Ground, traced: &mut u64) -> u16 {
        let of = |mask: u16| (0..16u32).filter(move |cell| mask & (1 << cell) != 0);
        let (doubted, open): (Vec<u32>, Vec<u32>) = (of(self.lit & !self.open).collect(), of(self.open).collect());
        let lines = self.lines(ground, &doubted, &open);
        let rays: Vec<Ray> = lines.iter().map(|line| line.ray).collect();
        let hits = nearest_of(ground, &rays, traced);
        let free = lines.iter().zip(hits).filter(|(line, hit)| hit.is_none_or(|hit| hit.t >= line.length));
        free.fold(0, |mask, (line, _)| mask | 1 << line.cell)
    }

    /// Leaves out of the open cells those that are covered, and partly covered ones where others are whole.
    fn uncover(&self, ground: &Ground, traced: &mut u64) -> Opening {
        let is_at_rim = |cell: u32| around(cell) & !self.open != 0;
        // Without a crevice, what covers a cell reaches out from one that is closed.
        let (cells, clear): (Vec<u32>, Vec<u32>) =
            (0..16).filter(|cell| self.open & (1 << cell) != 0).partition(|cell| self.has_crevice || is_at_rim(*cell));
        let up = |cell: &u32| {
            let cell = *cell;
            (0..PLACES).map(move |k| {
                // The four quarters of the cell, each at its middle.
                let place = [(k % 2) as f32 * 0.5 + 0.25, (k / 2) as f32 * 0.5 + 0.25];
                let point = self.footprint.sample(self.at(cell, place));
                let origin = ground.tracer.off_surface(point.position, point.normal);
                Ray { origin, direction: point.normal }
            })
        };
        let rays: Vec<Ray> = cells.iter().flat_map(up).collect();
        let hits = nearest_of(ground, &rays, traced);
        let (mut whole, mut part, mut free) = (self.open, self.open, clear.len() as u32 * PLACES);
        let mut is_tight = true;
        let places = rays.chunks(PLACES as usize).zip(hits.chunks(PLACES as usize));
        for (cell, (rays, hits)) in cells.into_iter().zip(places) {
            let mut crevices = 0;
            for (ray, hit) in rays.iter().zip(hits) {
                let is_crevice = hit.is_some_and(|hit| hit.t < self.crevice && covers(ground, ray.direction, &hit));
                crevices += u32::from(is_crevice);
                is_tight &= !is_crevice || hit.is_some_and(|hit| hit.t < TIGHT * self.crevice);
                let is_inside = match is_at_rim(cell) {
                    true => look(ground, ray, *hit, traced) != Seen::Open,
                    // What no ray has found overlapping solids around is inside of one at most.
                    false => hit.is_some_and(|hit| hit.back),
                };
                if is_crevice || is_inside {
                    whole &= !(1 << cell);
                } else {
                    free += 1;
                }
            }
            if crevices == PLACES {
                part &= !(1 << cell);
            }
        }
        let share = free as f32 / (16 * PLACES) as f32;
        match whole {
            // Too little to be told from what covers the rest.
            0 if free > 0 && share < SLIVER => Opening { is_covered: true, ..Opening::of(0) },
            // A roof's back over all of the patch is no cover.
            0 => Opening { is_covered: part == 0 && is_tight, ..Opening::of(part) },
            _ => Opening { share, ..Opening::of(whole) },
        }
    }

    /// Those of the cells `mask` that are behind no wall; all where that leaves none.
    fn in_front(&self, ground: &Ground, mask: u16, traced: &mut u64) -> u16 {
        let has = |cell: &u32| mask & (1 << cell) != 0;
        let lookouts: Vec<u32> = LOOKOUTS.into_iter().filter(has).collect();
        // A wall that comes right through lies between the ends of a diagonal.
        if DIAGONALS.iter().flatten().all(has) {
            let is_parted = |[a, b]: &[u32; 2]| {
                self.behind(ground, &[*a], &[*b], traced) != 0 || self.behind(ground, &[*b], &[*a], traced) != 0
            };
            if !DIAGONALS.iter().any(is_parted) {
                return mask;
            }
        }
        let cells: Vec<u32> = (0..16).filter(has).collect();
        let left = mask & !self.behind(ground, &cells, &lookouts, traced);
        if left == 0 { mask } else { left }
    }

    /// Those of `cells` from which a black back stands before one of `others`, as a mask.
    fn behind(&self, ground: &Ground, cells: &[u32], others: &[u32], traced: &mut u64) -> u16 {
        let lines = self.lines(ground, cells, others);
        let rays: Vec<Ray> = lines.iter().map(|line| line.ray).collect();
        let hits = nearest_of(ground, &rays, traced);
        let is_behind = |hit: Option<Hit>, length: f32| hit.is_some_and(|h| h.t < length && is_black_back(ground, &h));
        let behind = lines.iter().zip(hits).filter(|(line, hit)| is_behind(*hit, line.length));
        behind.fold(0, |mask, (line, _)| mask | 1 << line.cell)
    }

    /// Sight lines from each of `cells` to each of `others` that faces the same way, above crevices.
    fn lines(&self, ground: &Ground, cells: &[u32], others: &[u32]) -> Vec<Line> {
        let lifted = |cell: &u32| {
            let point = self.footprint.sample(self.at(*cell, [0.5; 2]));
            (point.position + point.normal * (LIFT * self.side), point.normal)
        };
        let others: Vec<(Vec3, Vec3)> = others.iter().map(lifted).collect();
        let mut lines = Vec::new();
        for &cell in cells {
            let (origin, normal) = lifted(&cell);
            for (to, _) in others.iter().filter(|(_, other)| other.dot(normal) > ALIKE) {
                let length = to.distance(origin);
                if length > ground.tracer.offset() {
                    lines.push(Line { cell, ray: Ray { origin, direction: (*to - origin) / length }, length });
                }
            }
        }
        lines
    }
}

/// The cell and those that touch it, as a mask.
fn around(cell: u32) -> u16 {
    let (x, y) = (cell % CellMask::SIDE, cell / CellMask::SIDE);
    let near = |a: u32, b: u32| a.abs_diff(b) <= 1;
    let touches = |other: &u32| near(other % CellMask::SIDE, x) && near(other / CellMask::SIDE, y);
    (0..16).filter(touches).fold(0, |mask, other| mask | 1 << other)
}

/// What lies open of the patches of one block; counts the rays in `traced`.
pub(super) fn probe(ground: &Ground, block: Range<usize>, seed: u32, traced: &mut u64) -> Vec<Opening> {
    let mut cutter = Cutter::new(ground);
    let patch = |i: usize| Probed {
        footprint: cutter.footprint(i),
        sequence: Sequence::new(seed, Stage::Unocclude, i as u64),
        side: side(ground, i),
        crevice: crevice(ground, i),
        open: 0,
        lit: 0,
        has_crevice: false,
        sees_wall: false,
    };
    let mut patches: Vec<Probed> = block.map(patch).collect();
    for patch in &mut patches {
        if patch.footprint.is_empty() {
            patch.open = u16::MAX;
            continue;
        }
        patch.look_around(ground, traced);
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
    patches.iter_mut().map(|patch| patch.opening(ground, traced)).collect()
}

fn nearest(ground: &Ground, ray: &Ray, traced: &mut u64) -> Option<Hit> {
    nearest_of(ground, std::slice::from_ref(ray), traced)[0]
}

fn nearest_of(ground: &Ground, rays: &[Ray], traced: &mut u64) -> Vec<Option<Hit>> {
    let mut hits = vec![None; rays.len()];
    ground.tracer.closest_solid(rays, &mut hits);
    *traced += rays.len() as u64;
    hits
}

/// True at the back of something single-sided.
fn is_black_back(ground: &Ground, hit: &Hit) -> bool {
    let (surface, triangle) = ground.tracer.place(hit.triangle);
    hit.back && !ground.scene.material(surface, triangle).double_sided
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
