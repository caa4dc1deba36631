//! Scene and atlas to patches: each triangle is clipped against the texel squares it overlaps.
//!
//! Cost: about 0.2 microseconds a texel and triangle; one sort over all pieces.

use super::clip::for_each_texel;
use super::{NONE, Patches};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::trace::Tracer;
use crate::unwrap::{Atlas, mask::BORDER};
use crate::{Error, Result};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Parts of a texel below this share of its square are rounding, not surface.
const SMALLEST_PART: f64 = 1e-9;

/// Triangles handled between two looks at the caller's wish to stop.
const CHUNK: usize = 1024;

/// One triangle's part of one texel.
#[derive(Clone, Copy)]
struct Part {
    chart: u32,
    morton: u32,
    triangle: u32,
    area: f32,
    /// Share of the texel.
    coverage: f32,
    centroid: Vec3,
    normal: Vec3,
}

/// Cuts the surfaces into patches.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered.
pub fn rasterize(scene: &Scene, atlas: &Atlas, tracer: &Tracer, progress: &dyn Progress) -> Result<Patches> {
    let triangles = tracer.triangle_count();
    progress.begin("rasterize", triangles as u64);
    let mut chart_first = Vec::with_capacity(scene.surfaces.len());
    let mut charts = 0u32;
    for s in &scene.surfaces {
        chart_first.push(charts);
        charts += atlas.meshes[s.mesh].chart_count;
    }
    let numbers: Vec<u32> = (0..triangles as u32).collect();
    let chunks: Vec<Vec<Part>> = numbers
        .par_chunks(CHUNK)
        .map(|chunk| {
            progress.check()?;
            let mut parts = Vec::new();
            for &number in chunk {
                cut(scene, atlas, tracer, &chart_first, number, &mut parts);
            }
            progress.advance(chunk.len() as u64);
            Ok(parts)
        })
        .collect::<Result<_>>()?;
    let mut parts: Vec<Part> = chunks.into_iter().flatten().collect();
    parts.par_sort_unstable_by_key(|p| (p.chart, p.morton, p.triangle));
    progress.check()?;
    let patches = gather_parts(scene, atlas, tracer, &parts);
    if patches.is_empty() {
        return Err(Error::invalid("unwrap", "no texel is covered; raise the density or resolution"));
    }
    Ok(patches)
}

/// The parts of triangle `number` in all texels it overlaps.
fn cut(scene: &Scene, atlas: &Atlas, tracer: &Tracer, chart_first: &[u32], number: u32, parts: &mut Vec<Part>) {
    let (surface, triangle) = tracer.place(number);
    let placed = &scene.surfaces[surface];
    let mesh = placed.mesh;
    let order = Scene::corner_order(placed);
    let world = scene.world_triangle(surface, triangle);
    let texels = texel_triangle(scene, atlas, surface, triangle);
    let texels = order.map(|k| texels[k]);
    let cross = (world[1] - world[0]).as_dvec3().cross((world[2] - world[0]).as_dvec3());
    let world_area = 0.5 * cross.length();
    let normal = cross.normalize_or_zero().as_vec3();
    let [a, b, c] = texels;
    let whole = (b - a).perp_dot(c - a);
    if whole == 0.0 || !whole.is_finite() {
        return;
    }
    let page = atlas.placements[surface].page as usize;
    let chart = chart_first[surface] + atlas.meshes[mesh].chart[triangle];
    for_each_texel(texels, atlas.pages[page], |x, y, part| {
        let area = part.area().abs();
        if area < SMALLEST_PART {
            return;
        }
        let at = part.centroid() - a;
        let (v, w) = (at.perp_dot(c - a) / whole, (b - a).perp_dot(at) / whole);
        let centroid = world[0] + (world[1] - world[0]) * v as f32 + (world[2] - world[0]) * w as f32;
        let share = area / (0.5 * whole.abs());
        parts.push(Part {
            chart,
            morton: morton(x, y),
            triangle: number,
            area: (share * world_area) as f32,
            coverage: area as f32,
            centroid,
            normal,
        });
    });
}

/// Parts in order to patches.
fn gather_parts(scene: &Scene, atlas: &Atlas, tracer: &Tracer, parts: &[Part]) -> Patches {
    let mut patches = Patches {
        position: Vec::new(),
        normal: Vec::new(),
        area: Vec::new(),
        texel: Vec::new(),
        coverage: Vec::new(),
        chart: Vec::new(),
        surface: Vec::new(),
        first_piece: Vec::new(),
        pieces: Vec::with_capacity(parts.len()),
        page_patch: atlas.pages.iter().map(|[w, h]| vec![NONE; *w as usize * *h as usize]).collect(),
    };
    debug_assert_eq!(scene.surfaces.len(), atlas.placements.len());
    for group in parts.chunk_by(|p, q| (p.chart, p.morton) == (q.chart, q.morton)) {
        let (surface, _) = tracer.place(group[0].triangle);
        let page = atlas.placements[surface].page;
        let (x, y) = from_morton(group[0].morton);
        let texel = y * atlas.pages[page as usize][0] + x;
        let area: f64 = group.iter().map(|p| f64::from(p.area)).sum();
        let mean = |f: fn(&Part) -> Vec3| {
            let sum: glam::DVec3 = group.iter().map(|p| f(p).as_dvec3() * f64::from(p.area)).sum();
            sum / area.max(f64::MIN_POSITIVE)
        };
        let largest = group.iter().max_by(|p, q| p.area.total_cmp(&q.area)).map_or(Vec3::Y, |p| p.normal);
        let index = patches.area.len() as u32;
        patches.first_piece.push(patches.pieces.len() as u32);
        patches.pieces.extend(group.iter().map(|p| (p.triangle, p.area)));
        patches.position.push(mean(|p| p.centroid).as_vec3());
        patches.normal.push(mean(|p| p.normal).as_vec3().try_normalize().unwrap_or(largest));
        patches.area.push(area as f32);
        patches.coverage.push(group.iter().map(|p| p.coverage).sum::<f32>().min(1.0));
        patches.texel.push([page, texel]);
        patches.chart.push(group[0].chart);
        patches.surface.push(surface as u32);
        // Where authored UVs let two charts share a texel, the one that covers more of it is found by hits.
        let slot = &mut patches.page_patch[page as usize][texel as usize];
        if *slot == NONE || patches.coverage[*slot as usize] < patches.coverage[index as usize] {
            *slot = index;
        }
    }
    patches.first_piece.push(patches.pieces.len() as u32);
    patches
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

fn from_morton(code: u32) -> (u32, u32) {
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
