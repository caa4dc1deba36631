//! A judge of atlases: everything that one promises, found another way than the unwrapper's own: by clipping triangles, in double
//! precision, texel by texel and pair by pair.
#![allow(dead_code)] // each test file uses its own share

pub mod scenes;

use glam::{DVec2, DVec3};
use lumel::scene::Scene;
use lumel::unwrap::Atlas;
use std::collections::{BTreeSet, HashMap};

/// Overlaps thinner than this are rounding [texels].
pub const THIN: f64 = 0.05;
/// Cells of the grid that pairs are found by [texels].
const CELL: f64 = 8.0;

/// A triangle on its page.
struct Placed {
    surface: usize,
    chart: u32,
    triangle: usize,
    /// Texels.
    corners: [DVec2; 3],
}

/// What an atlas is like.
#[derive(Clone, Debug, Default)]
pub struct Judgement {
    pub charts: usize,
    pub pages: usize,
    /// Texels that two charts touch.
    pub shared_texels: usize,
    /// Texels nearer to another chart than the padding.
    pub near_texels: usize,
    /// Area in which triangles lie on each other by more than [`THIN`], of the area of all [0..1].
    pub overlap: f64,
    /// Texels that charts touch, of all texels of all pages.
    pub touched: f64,
    /// Area of the surfaces at the atlas' density, of all texels of all pages.
    pub filled: f64,
    /// L2 stretch (Sander et al. 2001), 1 for a map that keeps lengths.
    pub stretch_l2: f64,
    /// Greatest stretch, but for the worst thousandth of the area.
    pub stretch_max: f64,
    /// Length of edges at which charts part, without open borders [m].
    pub seams: f64,
    /// Area [m^2].
    pub area: f64,
}

/// Judges an atlas of `scene`.
pub fn judge(scene: &Scene, atlas: &Atlas) -> Judgement {
    let mut found = Judgement { pages: atlas.pages.len(), seams: seams(scene, atlas), ..Judgement::default() };
    let mut numbers: HashMap<(usize, u32), u32> = HashMap::new();
    let mut stretches: Vec<(f64, f64, f64)> = Vec::new();
    let (mut texels, mut uv_area, mut doubled, mut touched) = (0.0, 0.0, 0.0, 0);
    for (page, &size) in atlas.pages.iter().enumerate() {
        let placed = placed(scene, atlas, page);
        for p in &placed {
            let count = numbers.len() as u32;
            numbers.entry((p.surface, p.chart)).or_insert(count + 1);
            let area = signed_area(p.corners).abs();
            uv_area += area;
            let [a, b, c] = scene.world_triangle(p.surface, p.triangle).map(|p| p.as_dvec3());
            found.area += 0.5 * (b - a).cross(c - a).length();
            stretches.push(stretch(p.corners, [a, b, c]));
        }
        let owners = owners(&placed, &numbers, size, &mut found.shared_texels);
        touched += owners.iter().filter(|o| **o > 0).count();
        found.near_texels += near(&owners, size, atlas.padding);
        doubled += overlap(&placed);
        texels += f64::from(size[0]) * f64::from(size[1]);
    }
    found.charts = numbers.len();
    found.overlap = doubled / uv_area;
    found.touched = touched as f64 / texels;
    found.filled = found.area * f64::from(atlas.density).powi(2) / texels;
    (found.stretch_l2, found.stretch_max) = stretch_of(stretches, uv_area, found.area);
    found
}

/// The triangles on a page.
fn placed(scene: &Scene, atlas: &Atlas, page: usize) -> Vec<Placed> {
    let mut placed = Vec::new();
    for (s, surface) in scene.surfaces.iter().enumerate() {
        if atlas.placements[s].page as usize != page {
            continue;
        }
        for triangle in 0..scene.meshes[surface.mesh].triangles.len() {
            let corners = atlas.page_texels(s, surface.mesh, triangle).map(|p| p.as_dvec2());
            placed.push(Placed { surface: s, chart: atlas.meshes[surface.mesh].chart[triangle], triangle, corners });
        }
    }
    placed
}

/// The number of the chart that touches each texel, and how many texels a second one touches.
fn owners(placed: &[Placed], numbers: &HashMap<(usize, u32), u32>, [w, h]: [u32; 2], shared: &mut usize) -> Vec<u32> {
    let mut owners = vec![0; w as usize * h as usize];
    for p in placed {
        let number = numbers[&(p.surface, p.chart)];
        for [x, y] in covered(p.corners) {
            assert!(x < w as usize && y < h as usize, "a chart leaves its page at {x} {y}");
            let owner = &mut owners[y * w as usize + x];
            *shared += usize::from(*owner != 0 && *owner != number);
            *owner = number;
        }
    }
    owners
}

/// Texels with another chart nearer than `padding` texels, either way along both axes.
fn near(owners: &[u32], [w, h]: [u32; 2], padding: u32) -> usize {
    let (w, h, p) = (w as usize, h as usize, padding as usize);
    let is_near = |i: usize| {
        let (x, y) = (i % w, i / w);
        let rows = y.saturating_sub(p)..(y + p + 1).min(h);
        rows.flat_map(|ny| (x.saturating_sub(p)..(x + p + 1).min(w)).map(move |nx| ny * w + nx))
            .any(|n| owners[n] != 0 && owners[n] != owners[i])
    };
    (0..owners.len()).filter(|&i| owners[i] != 0 && is_near(i)).count()
}

/// By page, the number of the chart that touches each texel, from 1; 0: none.
pub fn chart_maps(scene: &Scene, atlas: &Atlas) -> Vec<Vec<u32>> {
    let mut numbers = HashMap::new();
    let page = |page: usize| {
        let placed = placed(scene, atlas, page);
        for p in &placed {
            let count = numbers.len() as u32;
            numbers.entry((p.surface, p.chart)).or_insert(count + 1);
        }
        owners(&placed, &numbers, atlas.pages[page], &mut 0)
    };
    (0..atlas.pages.len()).map(page).collect()
}

/// Texels that a triangle overlaps, but for slivers of a thousandth of a texel: by clipping, another way than the packer's.
pub fn covered(triangle: [DVec2; 3]) -> Vec<[usize; 2]> {
    let border = 1e-3;
    let low = triangle[0].min(triangle[1]).min(triangle[2]).floor();
    let high = triangle[0].max(triangle[1]).max(triangle[2]);
    let mut result = Vec::new();
    let mut y = low.y;
    while y < high.y {
        let row = half_plane(&triangle, DVec2::Y, y + border);
        let row = half_plane(&row, DVec2::NEG_Y, -(y + 1.0 - border));
        let x0 = row.iter().fold(f64::INFINITY, |m, p| m.min(p.x));
        let x1 = row.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.x));
        let mut x = x0.floor();
        while x < x1 {
            if x1.min(x + 1.0) - x0.max(x) > border {
                result.push([x.max(0.0) as usize, y.max(0.0) as usize]);
            }
            x += 1.0;
        }
        y += 1.0;
    }
    result
}

/// The part of a polygon with `normal` · p > `limit` (Sutherland and Hodgman 1974).
fn half_plane(polygon: &[DVec2], normal: DVec2, limit: f64) -> Vec<DVec2> {
    let mut out = Vec::new();
    for k in 0..polygon.len() {
        let (p, q) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (dp, dq) = (p.dot(normal) - limit, q.dot(normal) - limit);
        if dp > 0.0 {
            out.push(p);
        }
        if (dp > 0.0) != (dq > 0.0) {
            out.push(p + (q - p) * (dp / (dp - dq)));
        }
    }
    out
}

/// Area [texels] in which pairs of triangles of a page overlap by more than [`THIN`].
fn overlap(placed: &[Placed]) -> f64 {
    let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    let bounds = |p: &Placed| {
        let [a, b, c] = p.corners;
        (a.min(b).min(c), a.max(b).max(c))
    };
    let cell = |p: DVec2| [(p.x / CELL) as i64, (p.y / CELL) as i64];
    let mut sum = 0.0;
    for (i, p) in placed.iter().enumerate() {
        let (low, high) = bounds(p);
        let ([x0, y0], [x1, y1]) = (cell(low), cell(high));
        for y in y0..=y1 {
            for x in x0..=x1 {
                let others = cells.entry([x, y]).or_default();
                for &o in others.iter() {
                    let (other_low, other_high) = bounds(&placed[o]);
                    let (both_low, both_high) = (low.max(other_low), high.min(other_high));
                    // Each pair once: in the cell where the box of both begins.
                    if both_low.cmplt(both_high).all() && cell(both_low) == [x, y] {
                        sum += common_area(p.corners, placed[o].corners);
                    }
                }
                others.push(i);
            }
        }
    }
    sum
}

/// Area that two triangles share, where it is wider than [`THIN`].
fn common_area(a: [DVec2; 3], b: [DVec2; 3]) -> f64 {
    let mut polygon = a.to_vec();
    let sign = signed_area(b).signum();
    for k in 0..3 {
        let inward = (b[(k + 1) % 3] - b[k]).perp() * sign;
        polygon = half_plane(&polygon, inward, b[k].dot(inward));
    }
    let area: f64 =
        0.5 * (0..polygon.len()).map(|k| polygon[k].perp_dot(polygon[(k + 1) % polygon.len()])).sum::<f64>();
    let longest = polygon.iter().flat_map(|p| polygon.iter().map(move |q| p.distance(*q))).fold(0.0, f64::max);
    if area.abs() > THIN * longest { area.abs() } else { 0.0 }
}

/// Singular values' greatest and mean square of the map from texels to space, and the triangle's area (Sander et al. 2001,
/// section 3).
fn stretch(uv: [DVec2; 3], [a, b, c]: [DVec3; 3]) -> (f64, f64, f64) {
    let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
    let twice = d1.perp_dot(d2);
    let ss = ((b - a) * d2.y - (c - a) * d1.y) / twice;
    let st = ((c - a) * d1.x - (b - a) * d2.x) / twice;
    let (aa, bb, cc) = (ss.dot(ss), ss.dot(st), st.dot(st));
    let greatest = (0.5 * (aa + cc + ((aa - cc).powi(2) + 4.0 * bb * bb).sqrt())).sqrt();
    (greatest, 0.5 * (aa + cc), 0.5 * (b - a).cross(c - a).length())
}

/// L2 and greatest stretch of all, relative to a map of even density.
fn stretch_of(mut each: Vec<(f64, f64, f64)>, uv_area: f64, area: f64) -> (f64, f64) {
    let scale = (uv_area / area).sqrt();
    let sum: f64 = each.iter().map(|s| s.1 * s.2).sum();
    each.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut worse = 0.0;
    let greatest = each.iter().find(|s| {
        worse += s.2;
        worse > 1e-3 * area
    });
    ((sum / area).sqrt() * scale, greatest.map_or(0.0, |s| s.0 * scale))
}

/// Length [m] of edges at which charts part: of three, twice.
fn seams(scene: &Scene, atlas: &Atlas) -> f64 {
    let mut sum = 0.0;
    for (s, surface) in scene.surfaces.iter().enumerate() {
        let (mesh, uvs) = (&scene.meshes[surface.mesh], &atlas.meshes[surface.mesh]);
        let key = |v: u32| (mesh.positions[v as usize] + 0.0).to_array().map(f32::to_bits);
        let mut sides: HashMap<[[u32; 3]; 2], Vec<(usize, usize)>> = HashMap::new();
        for (t, corners) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (key(corners[k]), key(corners[(k + 1) % 3]));
                sides.entry([a.min(b), a.max(b)]).or_default().push((t, k));
            }
        }
        for side in sides.values().filter(|s| s.len() > 1) {
            let (t, k) = side[0];
            let corners = scene.world_triangle(s, t);
            let charts: BTreeSet<u32> = side.iter().map(|(t, _)| uvs.chart[*t]).collect();
            sum += (charts.len() - 1) as f64 * f64::from(corners[k].distance(corners[(k + 1) % 3]));
        }
    }
    sum
}

/// Positive where corners turn from +u to +v.
pub fn signed_area([a, b, c]: [DVec2; 3]) -> f64 {
    0.5 * (b - a).perp_dot(c - a)
}
