//! Scene and atlas to patches: each triangle is clipped against the texel squares it overlaps.
//!
//! Charts are cut into tiles ([`tile`](super::tile)), which are rasterized by all threads and put together in order. Cost: about 0.2
//! microseconds a texel and triangle. Memory: that of the patches, and some tiles.

use super::clip::for_each_texel;
use super::palette::Builder;
use super::tile::{Entry, entries, jobs};
use super::{MANY, NONE, Patches};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::trace::Triangles;
use crate::unwrap::{Atlas, mask::BORDER};
use crate::{Error, Result};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Parts of a texel below this share of its square are rounding, not surface.
const SMALLEST_PART: f64 = 1e-9;

/// Texels that are rasterized in one go, about.
const JOB: u32 = 1 << 14;

/// Such goes for each thread before they are put together: what waits for that is all that is held twice.
const JOBS_A_THREAD: usize = 4;

/// One triangle's part of one texel.
#[derive(Clone, Copy)]
struct Part {
    morton: u32,
    /// Which of its tile's triangles it is.
    of: u32,
    area: f32,
    /// Share of the texel.
    coverage: f32,
    centroid: Vec3,
}

/// A triangle of a tile.
struct Source {
    /// Number over all surfaces.
    number: u32,
    normal: Vec3,
}

/// What is cut.
#[derive(Clone, Copy)]
struct Cloth<'a> {
    scene: &'a Scene,
    atlas: &'a Atlas,
    triangles: &'a Triangles,
}

/// Patches in order, not yet part of the whole.
#[derive(Default)]
struct Run {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    area: Vec<f32>,
    coverage: Vec<f32>,
    chart: Vec<u32>,
    texel: Vec<u32>,
    /// Number of pieces of each patch.
    count: Vec<u32>,
    pieces: Vec<(u32, f32)>,
}

/// Cuts the surfaces into patches.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered.
pub fn rasterize(scene: &Scene, atlas: &Atlas, triangles: &Triangles, progress: &dyn Progress) -> Result<Patches> {
    let mut chart_first = Vec::with_capacity(scene.surfaces.len());
    let mut charts: Vec<[u32; 2]> = Vec::new();
    for (s, (surface, placement)) in scene.surfaces.iter().zip(&atlas.placements).enumerate() {
        chart_first.push(charts.len() as u32);
        let count = atlas.meshes[surface.mesh].chart_count as usize;
        charts.resize(charts.len() + count, [s as u32, placement.page]);
    }
    let count = triangles.count();
    progress.begin("rasterize", count as u64);
    if count >= MANY as usize {
        return Err(Error::invalid("the scene", format!("has {count} triangles; at most {} can be baked", MANY - 1)));
    }
    let cloth = Cloth { scene, atlas, triangles };
    let entries = entries(scene, atlas, triangles, &chart_first, progress)?;
    let share = |entry: usize| (entry * count / entries.len()) as u64;
    let mut patches = Patches::new(atlas, charts);
    let mut normals = Builder::default();
    let jobs = jobs(&entries, JOB);
    let mut waiting: Vec<Run> = Vec::new();
    for wave in jobs.chunks(JOBS_A_THREAD * rayon::current_num_threads()) {
        let cut = |job: &std::ops::Range<usize>| {
            progress.check()?;
            progress.advance(share(job.end) - share(job.start));
            Ok(cloth.cut(&entries[job.clone()]))
        };
        let done = std::mem::take(&mut waiting);
        let (runs, ()) = rayon::join(
            || wave.par_iter().map(cut).collect::<Result<Vec<Run>>>(),
            || patches.append(done, &mut normals),
        );
        waiting = runs?;
    }
    patches.append(waiting, &mut normals);
    patches.normal = normals.finish();
    patches.close();
    if patches.is_empty() {
        return Err(Error::invalid("unwrap", "no texel is covered; raise the density or resolution"));
    }
    Ok(patches)
}

impl Cloth<'_> {
    /// The patches of whole tiles.
    fn cut(&self, entries: &[Entry]) -> Run {
        let mut run = Run::default();
        let (mut parts, mut sources) = (Vec::new(), Vec::new());
        for tile in entries.chunk_by(Entry::is_beside) {
            parts.clear();
            sources.clear();
            tile.iter().for_each(|entry| self.cut_triangle(entry, &mut sources, &mut parts));
            parts.sort_unstable_by_key(|p| (p.morton, p.of));
            let (surface, _) = self.triangles.place(tile[0].triangle);
            let width = self.atlas.pages[self.atlas.placements[surface].page as usize][0];
            for group in parts.chunk_by(|p, q| p.morton == q.morton) {
                run.push(group, &sources, tile[0].chart, width);
            }
        }
        run
    }

    /// The parts of a triangle in all texels of a tile that it overlaps.
    fn cut_triangle(&self, entry: &Entry, sources: &mut Vec<Source>, parts: &mut Vec<Part>) {
        let Self { scene, atlas, triangles } = *self;
        let (surface, triangle) = triangles.place(entry.triangle);
        let order = Scene::corner_order(&scene.surfaces[surface]);
        let world = scene.world_triangle(surface, triangle);
        let texels = texel_triangle(scene, atlas, surface, triangle);
        let texels = order.map(|k| texels[k]);
        let cross = (world[1] - world[0]).as_dvec3().cross((world[2] - world[0]).as_dvec3());
        let world_area = 0.5 * cross.length();
        let [a, b, c] = texels;
        let whole = (b - a).perp_dot(c - a);
        if whole == 0.0 || !whole.is_finite() {
            return;
        }
        let of = sources.len() as u32;
        sources.push(Source { number: entry.triangle, normal: cross.normalize_or_zero().as_vec3() });
        let window = entry.window(atlas.pages[atlas.placements[surface].page as usize]);
        for_each_texel(texels, window, |x, y, part| {
            let area = part.area().abs();
            if area < SMALLEST_PART {
                return;
            }
            let at = part.centroid() - a;
            let (v, w) = (at.perp_dot(c - a) / whole, (b - a).perp_dot(at) / whole);
            let centroid = world[0] + (world[1] - world[0]) * v as f32 + (world[2] - world[0]) * w as f32;
            let share = area / (0.5 * whole.abs());
            let (area, coverage) = ((share * world_area) as f32, area as f32);
            parts.push(Part { morton: morton(x, y), of, area, coverage, centroid });
        });
    }
}

impl Run {
    /// Adds the patch of `group`, the parts in one texel of a page `width` texels wide.
    fn push(&mut self, group: &[Part], sources: &[Source], chart: u32, width: u32) {
        let source = |p: &Part| &sources[p.of as usize];
        let (x, y) = from_morton(group[0].morton);
        let area: f64 = group.iter().map(|p| f64::from(p.area)).sum();
        let mean = |f: &dyn Fn(&Part) -> Vec3| {
            let sum: DVec3 = group.iter().map(|p| f(p).as_dvec3() * f64::from(p.area)).sum();
            sum / area.max(f64::MIN_POSITIVE)
        };
        let largest = group.iter().max_by(|p, q| p.area.total_cmp(&q.area)).map_or(Vec3::Y, |p| source(p).normal);
        self.count.push(group.len() as u32);
        self.pieces.extend(group.iter().map(|p| (source(p).number, p.area)));
        self.position.push(mean(&|p| p.centroid).as_vec3());
        self.normal.push(mean(&|p| source(p).normal).as_vec3().try_normalize().unwrap_or(largest));
        self.area.push(area as f32);
        self.coverage.push(group.iter().map(|p| p.coverage).sum::<f32>().min(1.0));
        self.texel.push(y * width + x);
        self.chart.push(chart);
    }
}

impl Patches {
    /// None yet, on the pages of `atlas`; `charts` tells the surface and page of each chart.
    fn new(atlas: &Atlas, charts: Vec<[u32; 2]>) -> Self {
        Self {
            position: Vec::new(),
            normal: std::iter::empty().collect(),
            area: Vec::new(),
            coverage: Vec::new(),
            chart: Vec::new(),
            texel: Vec::new(),
            charts,
            piece: Vec::new(),
            many: Vec::new(),
            many_pieces: Vec::new(),
            page_patch: atlas.pages.iter().map(|[w, h]| vec![NONE; *w as usize * *h as usize]).collect(),
        }
    }

    /// Adds `runs`, which follow what there is; their normals go to `normals`.
    fn append(&mut self, runs: Vec<Run>, normals: &mut Builder) {
        for run in runs {
            let first = self.area.len();
            let mut pieces = &run.pieces[..];
            for &count in &run.count {
                let (own, rest) = pieces.split_at(count as usize);
                pieces = rest;
                self.piece.push(match own {
                    [(triangle, _)] => *triangle,
                    _ => MANY | self.many.len() as u32,
                });
                if own.len() > 1 {
                    self.many.push(self.many_pieces.len() as u32);
                    self.many_pieces.extend(own);
                }
            }
            self.position.extend(run.position);
            normals.extend(run.normal);
            self.area.extend(run.area);
            self.coverage.extend(run.coverage);
            self.chart.extend(run.chart);
            self.texel.extend(run.texel);
            for index in first..self.area.len() {
                let [page, texel] = self.texel(index);
                // Where authored UVs let two charts share a texel, the one that covers more of it is found by hits.
                let slot = &mut self.page_patch[page as usize][texel as usize];
                if *slot == NONE || self.coverage[*slot as usize] < self.coverage[index] {
                    *slot = index as u32;
                }
            }
        }
    }

    /// All are there.
    fn close(&mut self) {
        self.many.push(self.many_pieces.len() as u32);
        self.position.shrink_to_fit();
        for values in [&mut self.area, &mut self.coverage] {
            values.shrink_to_fit();
        }
        for numbers in [&mut self.chart, &mut self.texel, &mut self.piece, &mut self.many] {
            numbers.shrink_to_fit();
        }
        self.many_pieces.shrink_to_fit();
    }
}

/// Interleaves the bits of x and y (each below 2^16), so that neighbours in the plane are neighbours in order.
pub(super) fn morton(x: u32, y: u32) -> u32 {
    let spread = |v: u32| {
        let v = (v | (v << 8)) & 0x00ff_00ff;
        let v = (v | (v << 4)) & 0x0f0f_0f0f;
        let v = (v | (v << 2)) & 0x3333_3333;
        (v | (v << 1)) & 0x5555_5555
    };
    spread(x) | (spread(y) << 1)
}

pub(super) fn from_morton(code: u32) -> (u32, u32) {
    let pack = |v: u32| {
        let v = v & 0x5555_5555;
        let v = (v | (v >> 1)) & 0x3333_3333;
        let v = (v | (v >> 2)) & 0x0f0f_0f0f;
        let v = (v | (v >> 4)) & 0x00ff_00ff;
        (v | (v >> 8)) & 0xffff
    };
    (pack(code), pack(code >> 1))
}

/// A triangle's page coordinates [texels], corners in mesh order. Charts are laid out on texel borders, and f32 UVs miss them by
/// a little; a corner that close to a border lies on it, so that no sliver of the chart reaches into the next texel.
pub(super) fn texel_triangle(scene: &Scene, atlas: &Atlas, surface: usize, triangle: usize) -> [DVec2; 3] {
    let snap = |v: f64| if (v - v.round()).abs() < BORDER { v.round() } else { v };
    let corners = atlas.page_texels(surface, scene.surfaces[surface].mesh, triangle).map(|p| p.as_dvec2());
    let snapped = corners.map(|p| DVec2::new(snap(p.x), snap(p.y)));
    let area = |[a, b, c]: [DVec2; 3]| (b - a).perp_dot(c - a);
    // A triangle smaller than the border keeps its shape.
    if area(snapped) * area(corners) > 0.0 { snapped } else { corners }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_codes_come_back() {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (16383, 5), (12345, 16383)] {
            assert_eq!(from_morton(morton(x, y)), (x, y));
        }
    }
}
