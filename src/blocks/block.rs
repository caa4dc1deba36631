//! Blocks: squares of texels of one region of one chart, the receivers of the light between surfaces.
//!
//! Patches lie in Morton order within a chart, so that the texels of a square of any level are one run of them. A block is such a
//! run, of one connected smooth region: it reaches neither across a wall that stands on its floor nor around a hard edge. Blocks
//! start at [`COARSE`] and are split into quarters where the light asks for it, down to single texels. Backs of double-sided
//! surfaces, which no texel shows, have coarser blocks of their own.

use crate::light::Lit;
use crate::patch::{NONE, region::regions};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Blocks start with 2^3 texels along each side.
const COARSE: u32 = 3;

/// Blocks on backs have 2^3 texels along each side, for good: they are sources alone.
const COARSE_BACK: u32 = 3;

/// Cosine of the angle between neighbouring texels that still belong to one smooth surface: 45 degrees.
const CREASE_COS: f32 = 0.707;

/// Blocks whose texels all face within this angle of their mean count as flat [rad].
pub const FLAT: f32 = 0.06;

/// A square of texels.
#[derive(Clone, Debug)]
pub struct Block {
    /// Its patches are `order[first..end]` of [`Blocks`].
    pub first: u32,
    pub end: u32,
    /// Texels along each side of its square: 2^level.
    pub level: u32,
    /// The connected part of a chart that it belongs to; unlike for fronts and backs.
    pub region: u32,
    pub page: u32,
    /// On the back of its surface.
    pub back: bool,
    /// Centroid on the page [texels].
    pub at: Vec2,
    /// Centroid [m], mean normal (unit) and area in the open [m^2].
    pub centre: Vec3,
    pub normal: Vec3,
    pub area: f32,
    /// Largest angle of a texel's normal to the mean [rad].
    pub spread: f32,
}

/// Where a block lies: what it takes to find the rest of it again.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// As in [`Block`].
    pub first: u32,
    pub end: u32,
    pub level: u32,
}

/// All blocks, sorted by their patches.
pub struct Blocks {
    pub list: Vec<Block>,
    /// Patches by region, in Morton order; those with a back a second time, at the end.
    pub order: Vec<u32>,
    /// Area in the open of the patches before each in that order, and of all [m^2].
    pub area_before: Vec<f64>,
    /// The blocks of each patch's front and back, [`NONE`] where it has none.
    pub front_of: Vec<u32>,
    pub back_of: Vec<u32>,
}

impl Block {
    /// True where one normal stands for all.
    pub fn is_flat(&self) -> bool {
        self.spread < FLAT
    }

    /// Length of its sides, about [m].
    pub fn side(&self) -> f32 {
        self.area.sqrt()
    }

    /// How much its value weighs beside that of `other`: slivers have fewer samples and texels.
    pub fn certainty(&self, other: &Self) -> f32 {
        (self.texels() as f32 / other.texels() as f32).clamp(0.1, 1.0)
    }

    /// A number of samples, a power of two: `each` for each texel, 8 at least and `most` at most.
    pub fn samples(&self, each: u32, most: u32) -> u32 {
        (each * self.texels() as u32).next_power_of_two().clamp(8, most)
    }

    /// Number of texels.
    pub fn texels(&self) -> usize {
        (self.end - self.first) as usize
    }
}

/// A texel's area is taken as this share of that of all at least: it would be lost in sums.
const LEAST_AREA: f64 = 1e-13;

impl Blocks {
    /// The coarsest blocks.
    pub fn new(lit: &Lit) -> Self {
        let patches = lit.ground.patches;
        let n = patches.len() as u32;
        // Those whose light is known gather none.
        let open: Vec<u32> = (0..n).filter(|&i| lit.is_wanted(i as usize)).collect();
        let region = regions(lit.ground, &open, |i, j| patches.normal[i].dot(patches.normal[j]) > CREASE_COS);
        let mut order = open;
        order.par_sort_unstable_by_key(|&i| (region[i as usize], i));
        let fronts = order.len();
        order.extend((0..n).filter(|&i| has_back(lit, i as usize)));
        let area = |(k, &i): (usize, &u32)| {
            let i = i as usize;
            f64::from(if k < fronts { lit.exposure.area[i] } else { lit.exposure.back_area(patches, i) })
        };
        let least = LEAST_AREA * order.iter().enumerate().map(area).sum::<f64>();
        let mut area_before = Vec::with_capacity(order.len() + 1);
        area_before.push(0.0);
        for member in order.iter().enumerate() {
            area_before.push(area_before[member.0] + area(member).max(least));
        }
        let none = vec![NONE; patches.len()];
        let mut blocks = Self { list: Vec::new(), order, area_before, front_of: none.clone(), back_of: none };
        let mut list = blocks.cut(lit, 0..fronts, COARSE, false, |i| region[i]);
        // Regions are named by patches, and backs by charts beyond them.
        list.extend(blocks.cut(lit, fronts..blocks.order.len(), COARSE_BACK, true, |i| n + patches.chart[i]));
        blocks.adopt(list);
        blocks
    }

    /// Blocks of these shapes, in order; `None` where they aren't parts of the coarsest blocks of `lit`.
    pub fn shaped(lit: &Lit, shapes: &[Shape]) -> Option<Self> {
        let mut blocks = Self::new(lit);
        let mut end = 0;
        let describe = |shape: &Shape| {
            let whole = blocks.list.partition_point(|block| block.end <= shape.first);
            let whole = blocks.list.get(whole).filter(|whole| whole.first <= shape.first && shape.end <= whole.end)?;
            let is_part = shape.first < shape.end && shape.level <= whole.level;
            let range = shape.first as usize..shape.end as usize;
            is_part.then(|| blocks.describe(lit, range, shape.level, whole.back, whole.region))
        };
        let in_order = |shape: &Shape| shape.first >= std::mem::replace(&mut end, shape.end);
        let list =
            shapes.iter().all(in_order).then(|| shapes.par_iter().map(describe).collect::<Option<Vec<Block>>>())??;
        let patches: u32 = list.iter().map(|block| block.end - block.first).sum();
        if patches as usize != blocks.order.len() {
            return None;
        }
        blocks.adopt(list);
        Some(blocks)
    }

    /// Splits the blocks that are `wanted`, if they have more than one texel, into quarters. Returns the block that each of the new
    /// ones is part of, and whether it is the whole.
    pub fn split(&mut self, lit: &Lit, wanted: &[bool]) -> Vec<(u32, bool)> {
        let parts: Vec<(Vec<Block>, bool)> = self
            .list
            .par_iter()
            .enumerate()
            .map(|(b, block)| {
                if wanted.get(b) != Some(&true) || block.texels() < 2 || block.level == 0 {
                    return (vec![block.clone()], true);
                }
                let range = block.first as usize..block.end as usize;
                (self.cut(lit, range, block.level - 1, block.back, |_| block.region), false)
            })
            .collect();
        let mut list = Vec::with_capacity(self.list.len());
        let mut origin = Vec::with_capacity(self.list.len());
        for (b, (blocks, is_whole)) in parts.into_iter().enumerate() {
            list.extend(blocks);
            origin.resize(list.len(), (b as u32, is_whole));
        }
        self.adopt(list);
        origin
    }

    /// Area in the open of the patch at place `k` of the order [m^2].
    pub fn area(&self, k: usize) -> f32 {
        (self.area_before[k + 1] - self.area_before[k]) as f32
    }

    /// Number of blocks that are no backs; they come first.
    pub fn fronts(&self) -> usize {
        self.list.partition_point(|b| !b.back)
    }

    /// Number of texels that have fronts.
    pub fn front_texels(&self) -> usize {
        self.fronts().checked_sub(1).map_or(0, |last| self.list[last].end as usize)
    }

    /// The patches of block `b`.
    pub fn members(&self, b: usize) -> &[u32] {
        &self.order[self.list[b].first as usize..self.list[b].end as usize]
    }

    /// The member of block `b` at `u` in [0, 1) by area, as an index into `order`, and `u` rescaled within it.
    pub fn pick(&self, b: usize, u: f32) -> (usize, f32) {
        let (first, end) = (self.list[b].first as usize, self.list[b].end as usize);
        let low = self.area_before[first];
        let wanted = low + f64::from(u) * (self.area_before[end] - low);
        let k = first + self.area_before[first + 1..end].partition_point(|&a| a <= wanted);
        let rest =
            (wanted - self.area_before[k]) / (self.area_before[k + 1] - self.area_before[k]).max(f64::MIN_POSITIVE);
        (k, (rest as f32).clamp(0.0, 1.0 - f32::EPSILON))
    }

    /// The run `range` of the order as blocks of `level`.
    fn cut(
        &self,
        lit: &Lit,
        range: std::ops::Range<usize>,
        level: u32,
        back: bool,
        region: impl Fn(usize) -> u32 + Sync,
    ) -> Vec<Block> {
        let cell = |&i: &u32| {
            let [x, y] = lit.ground.column_row(i as usize);
            (region(i as usize), x >> level, y >> level)
        };
        let mut first = range.start;
        let runs = self.order[range].chunk_by(|a, b| cell(a) == cell(b)).map(|run| {
            first += run.len();
            (first - run.len()..first, region(run[0] as usize))
        });
        let runs: Vec<(std::ops::Range<usize>, u32)> = runs.collect();
        let describe = |(run, region)| self.describe(lit, run, level, back, region);
        // Few blocks are the parts of one that is split, among many that are.
        if runs.len() <= 4 {
            runs.into_iter().map(describe).collect()
        } else {
            runs.into_par_iter().map(describe).collect()
        }
    }

    fn describe(&self, lit: &Lit, range: std::ops::Range<usize>, level: u32, back: bool, region: u32) -> Block {
        let patches = lit.ground.patches;
        let (mut at, mut centre, mut normal, mut area) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
        for k in range.clone() {
            let i = self.order[k] as usize;
            let a = self.area_before[k + 1] - self.area_before[k];
            let [x, y] = lit.ground.column_row(i);
            at += DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0) * a;
            centre += patches.position[i].as_dvec3() * a;
            normal += patches.normal[i].as_dvec3() * a;
            area += a;
        }
        let first = self.order[range.start] as usize;
        let whole = area.max(f64::MIN_POSITIVE);
        let normal = normal.as_vec3().try_normalize().unwrap_or(patches.normal[first]);
        let least =
            self.order[range.clone()].iter().map(|&i| normal.dot(patches.normal[i as usize])).fold(1.0, f32::min);
        Block {
            first: range.start as u32,
            end: range.end as u32,
            level,
            region,
            page: patches.page(first),
            back,
            at: (at / whole).truncate().as_vec2(),
            centre: (centre / whole).as_vec3(),
            normal: if back { -normal } else { normal },
            area: area as f32,
            spread: least.clamp(-1.0, 1.0).acos(),
        }
    }

    /// Makes `list` the blocks.
    fn adopt(&mut self, list: Vec<Block>) {
        for (b, block) in list.iter().enumerate() {
            let of = if block.back { &mut self.back_of } else { &mut self.front_of };
            for &i in &self.order[block.first as usize..block.end as usize] {
                of[i as usize] = b as u32;
            }
        }
        self.list = list;
    }
}

fn has_back(lit: &Lit, i: usize) -> bool {
    let (surface, triangle) = lit.ground.tracer.place(lit.ground.patches.first_triangle(i));
    lit.ground.casts(i) && lit.ground.scene.material(surface, triangle).double_sided
}
