//! The coarser level of patches between which light is exchanged: clusters of neighbouring texels that face one way.
//!
//! A texel solver would touch every pair of a million texels; as a source, blocks of texels are enough (Lischinski et al.
//! 1993 gather from such a solution). Elements are found by halving: the largest one is cut across its longest side until
//! there are as many as wanted. Texels on the back of double-sided surfaces have elements of their own.

use super::cluster::Cluster;
use crate::color::Rgb;
use crate::patch::{
    Ground, NONE, Reflectance, SurfacePoint, footprint::CellMask, region::regions, unocclude::Exposure,
};
use crate::sample::Discrete;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Hit;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Points kept on each element, at most and at least; in between, about [`ALL_POINTS`] over all elements.
const MOST_POINTS: u32 = 32;
const LEAST_POINTS: u32 = 4;
const ALL_POINTS: u32 = 1 << 21;

/// Distances along the way that texels face count this much more when the longest side is chosen: it keeps a table's top
/// apart from the floor below it.
const LAYER_SEPARATION: f32 = 4.0;

/// Elements whose centres are nearer than this many times the sum of their radii count as near.
const NEAR: f32 = 1.25;

/// Clusters of patches, sorted by surface and place.
#[derive(Default)]
pub struct Elements {
    /// Area [m^2].
    pub area: Vec<f32>,
    /// Area-weighted centre [m].
    pub centre: Vec<Vec3>,
    /// Largest distance of a texel from the centre [m].
    pub radius: Vec<f32>,
    /// All of that, and which ways it faces.
    pub cluster: Vec<Cluster>,
    /// Mean albedo, 0..=1.
    pub albedo: Vec<Rgb>,
    /// The share of the light on each that it stops, 1 but for sheets; and what it stops of each channel over that mean.
    pub stop: Vec<f32>,
    pub taking: Vec<Rgb>,
    /// True on the back of its surface.
    pub back: Vec<bool>,
    /// The surface that most of it belongs to.
    pub surface: Vec<u32>,
    /// Elements of each patch's front and back; [`NONE`] where it has none.
    pub front_of: Vec<u32>,
    pub back_of: Vec<u32>,
    pub seed: u32,
    /// The parts of each patch that may be sampled, by patch.
    cells: Vec<CellMask>,
    /// Patches of element i: `members[first[i]..first[i + 1]]`, with a table by area.
    members: Vec<u32>,
    first: Vec<u32>,
    by_area: Vec<Option<Discrete>>,
    /// `points_each` points on each, moved off the surface, normals outwards (on backs: away from the back).
    points: Vec<SurfacePoint>,
    points_each: u32,
}

/// What no element reaches across.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Limits {
    /// Large regions and large surfaces; small ones share elements.
    Regions,
    /// Every surface.
    Surfaces,
}

/// A set of patches that may be cut further.
struct Block {
    area: f64,
    range: std::ops::Range<usize>,
    axis: usize,
}

impl PartialEq for Block {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Block {}
impl PartialOrd for Block {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Block {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        // The largest first; of equals the one that starts earlier, so that the order never depends on chance.
        self.area.total_cmp(&other.area).then(other.range.start.cmp(&self.range.start))
    }
}

impl Elements {
    /// Clusters the patches in the open into about `count` elements, and half as many again for backs where there are
    /// double-sided surfaces.
    pub fn new(ground: &Ground, exposure: &Exposure, reflectance: &Reflectance, count: usize, seed: u32) -> Self {
        Self::with_limits(ground, exposure, reflectance, count, seed, Limits::Regions)
    }

    /// As [`new`](Self::new), but no element reaches from one surface to another: at least one for each way of the axes that a
    /// surface faces, however many are asked for.
    pub fn within_surfaces(
        ground: &Ground,
        exposure: &Exposure,
        reflectance: &Reflectance,
        count: usize,
        seed: u32,
    ) -> Self {
        Self::with_limits(ground, exposure, reflectance, count, seed, Limits::Surfaces)
    }

    fn with_limits(
        ground: &Ground,
        exposure: &Exposure,
        reflectance: &Reflectance,
        count: usize,
        seed: u32,
        limits: Limits,
    ) -> Self {
        let patches = ground.patches;
        let is_open = |&i: &u32| !exposure.is_buried(i as usize) && ground.casts(i as usize);
        let open: Vec<u32> = (0..patches.len() as u32).filter(is_open).collect();
        let has_back = |&i: &u32| {
            let (surface, triangle) = ground.tracer.place(patches.first_triangle(i as usize));
            ground.casts(i as usize) && ground.scene.material(surface, triangle).double_sided
        };
        let backs: Vec<u32> = (0..patches.len() as u32).filter(has_back).collect();
        let mut clusters: Vec<(bool, Vec<u32>)> = Vec::new();
        clusters.extend(cluster(ground, open, count, limits).into_iter().map(|c| (false, c)));
        clusters.extend(cluster(ground, backs, count.div_ceil(2), limits).into_iter().map(|c| (true, c)));
        Self::from_clusters(ground, exposure, reflectance, clusters, seed)
    }

    fn from_clusters(
        ground: &Ground,
        exposure: &Exposure,
        reflectance: &Reflectance,
        mut clusters: Vec<(bool, Vec<u32>)>,
        seed: u32,
    ) -> Self {
        let patches = ground.patches;
        // Patches are sorted by chart and place, so the first member tells where a cluster lies.
        clusters.iter_mut().for_each(|(_, c)| c.sort_unstable());
        clusters.sort_by_key(|(back, c)| (patches.surface(c[0] as usize), *back, c[0]));
        let n = clusters.len();
        let mut all = Self {
            area: Vec::with_capacity(n),
            centre: Vec::with_capacity(n),
            radius: Vec::with_capacity(n),
            cluster: Vec::with_capacity(n),
            albedo: Vec::with_capacity(n),
            stop: Vec::with_capacity(n),
            taking: Vec::with_capacity(n),
            back: Vec::with_capacity(n),
            surface: Vec::with_capacity(n),
            front_of: vec![NONE; patches.len()],
            back_of: vec![NONE; patches.len()],
            seed,
            cells: exposure.cells.clone(),
            members: Vec::new(),
            first: vec![0],
            by_area: Vec::with_capacity(n),
            points: Vec::new(),
            points_each: (ALL_POINTS / n.max(1) as u32).clamp(LEAST_POINTS, MOST_POINTS).next_power_of_two(),
        };
        for (e, (back, members)) in clusters.iter().enumerate() {
            let area_of = |&i: &u32| {
                let i = i as usize;
                f64::from(if *back { exposure.back_area(patches, i) } else { exposure.area[i] })
            };
            let area: f64 = members.iter().map(area_of).sum();
            let mean = |f: &dyn Fn(usize) -> Vec3| {
                let sum: glam::DVec3 = members.iter().map(|i| f(*i as usize).as_dvec3() * area_of(i)).sum();
                (sum / area.max(f64::MIN_POSITIVE)).as_vec3()
            };
            let centre = mean(&|i| patches.position[i]);
            let far = members
                .iter()
                .map(|&i| patches.position[i as usize].distance(centre) + (0.5 * patches.area[i as usize]).sqrt());
            let radius = far.fold(0.0, f32::max);
            let (axis, spread) = facing(ground, *back, members);
            all.cluster.push(Cluster::new(area as f32, centre, radius, axis, spread));
            all.radius.push(radius);
            all.area.push(area as f32);
            all.centre.push(centre);
            all.albedo.push(mean(&|i| reflectance.0[i]));
            all.taking.push(exposure.stops.as_ref().map_or(Rgb::ONE, |stops| mean(&|i| stops.taking(i))));
            all.stop.push(exposure.stops.as_ref().map_or(1.0, |stops| {
                let whole: f64 = members.iter().map(|i| area_of(i) / f64::from(stops.share(*i as usize))).sum();
                (area / whole.max(f64::MIN_POSITIVE)) as f32
            }));
            all.back.push(*back);
            all.surface.push(patches.surface(members[members.len() / 2] as usize));
            for &i in members {
                let slot = if *back { &mut all.back_of } else { &mut all.front_of };
                slot[i as usize] = e as u32;
            }
            all.members.extend(members);
            all.first.push(all.members.len() as u32);
            all.by_area.push(Discrete::new(members.iter().map(area_of)));
        }
        all.points = (0..n)
            .into_par_iter()
            .flat_map_iter(|e| (0..all.points_each).map(move |k| (e, k)))
            .map(|(e, k)| all.draw(ground, e, k))
            .collect();
        all
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// The patches of element `e`, ascending.
    pub fn members(&self, e: usize) -> &[u32] {
        &self.members[self.first[e] as usize..self.first[e + 1] as usize]
    }

    /// True where the kernel between points of the two can vary without bounds or nearly so.
    pub fn are_near(&self, i: usize, j: usize) -> bool {
        let reach = NEAR * (self.radius[i] + self.radius[j]);
        self.centre[i].distance_squared(self.centre[j]) < reach * reach
    }

    /// Point `index` of a sequence of points uniform over element `e`, off the surface on the side that shines.
    pub fn point(&self, ground: &Ground, e: usize, index: u32) -> SurfacePoint {
        if index < self.points_each {
            return self.points[e * self.points_each as usize + index as usize];
        }
        self.draw(ground, e, index)
    }

    /// One of the kept points, in turn.
    pub fn kept_point(&self, e: usize, index: u32) -> SurfacePoint {
        self.points[e * self.points_each as usize + (index % self.points_each) as usize]
    }

    /// Points that are kept on each element, a power of two.
    pub fn kept_points(&self) -> u32 {
        self.points_each
    }

    fn draw(&self, ground: &Ground, e: usize, index: u32) -> SurfacePoint {
        let [pick, x, y, _] = Sequence::new(self.seed, Stage::Element, e as u64).point(index, 0);
        let member = self.by_area[e].as_ref().map_or(0, |table| table.sample(pick).0);
        let patch = self.members(e)[member] as usize;
        let mut footprint = ground.footprint(patch);
        if !self.back[e] {
            footprint.restrict(self.cells[patch]);
        }
        let mut point = if footprint.is_empty() {
            let (position, normal) = (ground.patches.position[patch], ground.patches.normal[patch]);
            SurfacePoint::on(ground.patches.surface(patch), position, normal)
        } else {
            footprint.sample([x, y])
        };
        if self.back[e] {
            point.normal = -point.normal;
            point.shading = -point.shading;
        }
        point.position = ground.tracer.off_surface(point.position, point.normal);
        point
    }

    /// The value of the element that a patch's front belongs to, of `values` by element; zero where it has none.
    pub fn read(&self, values: &[Rgb], patch: usize) -> Rgb {
        match self.front_of[patch] {
            NONE => Rgb::ZERO,
            e => values[e as usize],
        }
    }

    /// The element under a hit: `None` on black backs and buried texels.
    pub fn element_under(&self, ground: &Ground, hit: &Hit) -> Option<u32> {
        let patch = ground.patch_under(hit)?;
        let e = if hit.back { self.back_of[patch] } else { self.front_of[patch] };
        (e != NONE).then_some(e)
    }
}

/// Mean normal of an element, and the largest angle of a patch's normal to it.
fn facing(ground: &Ground, back: bool, members: &[u32]) -> (Vec3, f32) {
    let patches = ground.patches;
    let sum: Vec3 = members.iter().map(|&i| patches.normal[i as usize] * patches.area[i as usize]).sum();
    let mean = sum.normalize_or(patches.normal[members[0] as usize]);
    let least = members.iter().map(|&i| mean.dot(patches.normal[i as usize])).fold(1.0f32, f32::min);
    (if back { -mean } else { mean }, least.clamp(-1.0, 1.0).acos())
}

/// Cuts `patches` into about `count` clusters, each facing one of the six ways of the axes. Regions large enough for a cluster of
/// their own don't share one: the inside of a lamp and of the ceiling above it have nothing in common, nor have the floors on
/// either side of a wall.
fn cluster(ground: &Ground, mut patches: Vec<u32>, count: usize, limits: Limits) -> Vec<Vec<u32>> {
    let all = ground.patches;
    let way = |i: u32| {
        let n = all.normal[i as usize];
        let size = n.abs();
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        2 * axis + usize::from(n[axis] < 0.0)
    };
    let region = regions(ground, &patches, |_, _| true);
    let mut region_area = vec![0.0f64; all.len()];
    for &i in &patches {
        region_area[region[i as usize] as usize] += f64::from(all.area[i as usize]);
    }
    let mut surface_area = vec![0.0f64; ground.scene.surfaces.len()];
    for &i in &patches {
        surface_area[all.surface(i as usize) as usize] += f64::from(all.area[i as usize]);
    }
    let large = region_area.iter().sum::<f64>() / count.max(1) as f64;
    // Small regions share elements with those of their own surface, and only small surfaces with others.
    let owner = |i: u32| {
        let (r, s) = (region[i as usize], all.surface(i as usize));
        if region_area[r as usize] >= large {
            u64::from(r)
        } else if limits == Limits::Surfaces || surface_area[s as usize] >= large {
            all.len() as u64 + u64::from(s)
        } else {
            u64::MAX
        }
    };
    patches.sort_by_key(|&i| (owner(i), way(i), i));
    let area = |range: &std::ops::Range<usize>, patches: &[u32]| -> f64 {
        patches[range.clone()].iter().map(|&i| f64::from(all.area[i as usize])).sum()
    };
    let mut heap = BinaryHeap::new();
    let mut start = 0;
    for group in patches.chunk_by(|&a, &b| (owner(a), way(a)) == (owner(b), way(b))) {
        let range = start..start + group.len();
        start = range.end;
        heap.push(Block { area: area(&range, &patches), axis: way(group[0]) / 2, range });
    }
    let mut done: Vec<Block> = Vec::new();
    while heap.len() + done.len() < count {
        let Some(block) = heap.pop() else { break };
        if block.range.len() < 2 {
            done.push(block);
            continue;
        }
        let members = &mut patches[block.range.clone()];
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &i in members.iter() {
            low = low.min(all.position[i as usize]);
            high = high.max(all.position[i as usize]);
        }
        let mut size = high - low;
        size[block.axis] *= LAYER_SEPARATION;
        let longest = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let half = members.len() / 2;
        members.select_nth_unstable_by(half, |&a, &b| {
            let key = |i: u32| all.position[i as usize][longest];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        let middle = block.range.start + half;
        for range in [block.range.start..middle, middle..block.range.end] {
            heap.push(Block { area: area(&range, &patches), axis: block.axis, range });
        }
    }
    heap.into_iter().chain(done).map(|b| patches[b.range].to_vec()).collect()
}
