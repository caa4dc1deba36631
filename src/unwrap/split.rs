//! Large connected parts cut into pieces that an unwrapper charts in good time.

use super::chart;
use super::shape::{Sets, Shape};
use glam::DVec3;
use std::collections::{HashMap, HashSet};

/// Most triangles of a piece for xatlas, whose charting and solver take about the square of them. At 1024, 134 000 triangles cost
/// seconds in place of minutes, and the added seams are few: such a piece is dozens of texels wide even at a texel a triangle.
pub const XATLAS_LIMIT: usize = 1024;
/// And for uvunwrap: its charts may grow long and ragged, as of a neon tube, and then hardly fill a page.
pub const UVUNWRAP_LIMIT: usize = 1 << 11;
/// Flat regions of more triangles than this are pieces of their own.
const FLAT_LIMIT: usize = 64;
/// Neighbours whose normals are nearer than 0.3 degrees stay together, so that no seam runs across a wall.
const FLAT_COS: f64 = 1.0 - 1.5e-5;

/// What isn't cut: a polygon, or flat neighbours.
struct Unit {
    triangles: Vec<u32>,
    center: DVec3,
}

/// Pieces of a connected part, each connected and of up to `limit` triangles, in a fixed order. Halves at the median along the
/// longest axis, again and again.
pub fn pieces(shape: &Shape, part: Vec<u32>, limit: usize) -> Vec<Vec<u32>> {
    if part.len() <= limit {
        return vec![part];
    }
    let neighbors = shape.neighbors(&part);
    let normals: Vec<DVec3> = part.iter().map(|&t| shape.cross(t).normalize_or_zero()).collect();
    let mut sets = Sets::new(part.len());
    for &[a, b] in &neighbors {
        let flat = normals[a as usize].dot(normals[b as usize]) >= FLAT_COS;
        if flat || shape.polygon[part[a as usize] as usize] == shape.polygon[part[b as usize] as usize] {
            sets.join(a, b);
        }
    }
    let mut finished = Vec::new();
    let mut units = Vec::new();
    for region in sets.groups(&part) {
        if region.len() <= FLAT_LIMIT {
            units.push(unit(shape, region));
        } else if chart::is_flat(shape, &region) {
            finished.push(region);
        } else {
            // Bends so gently that no two neighbours show it.
            units.extend(chart::polygons(shape, &region).into_iter().map(|p| unit(shape, p)));
        }
    }
    let mut halves = vec![units];
    while let Some(mut units) = halves.pop() {
        let count: usize = units.iter().map(|u| u.triangles.len()).sum();
        if count > limit && units.len() > 1 {
            let later = halve(&mut units, count);
            halves.push(later);
            halves.push(units);
        } else {
            let piece: Vec<u32> = units.into_iter().flat_map(|u| u.triangles).collect();
            let mut sets = Sets::new(piece.len());
            shape.neighbors(&piece).iter().for_each(|&[a, b]| sets.join(a, b));
            finished.extend(sets.groups(&piece));
        }
    }
    finished
}

/// Parts a piece into sheets without edges of more than two triangles, as uvunwrap joins none over such an edge. There, triangles
/// that run along the edge in opposite directions and bend least go together: so the two sides of a doubled wall part, and each
/// stays whole.
pub fn sheets(shape: &Shape, piece: Vec<u32>) -> Vec<Vec<u32>> {
    // Low vertex, high vertex, whether the triangle runs from high to low, its place in `piece`.
    let mut edges: Vec<(u32, u32, bool, u32)> = Vec::with_capacity(3 * piece.len());
    for (i, &t) in piece.iter().enumerate() {
        let v = shape.mesh.triangles[t as usize].map(|v| shape.welded[v as usize]);
        for [a, b] in [[v[0], v[1]], [v[1], v[2]], [v[2], v[0]]] {
            edges.push((a.min(b), a.max(b), a > b, i as u32));
        }
    }
    edges.sort_unstable();
    let around = |a: &(u32, u32, bool, u32), b: &(u32, u32, bool, u32)| (a.0, a.1) == (b.0, b.1);
    if edges.chunk_by(around).all(|edge| edge.len() <= 2) {
        return vec![piece];
    }
    let normal = |i: u32| shape.cross(piece[i as usize]).normalize_or_zero();
    let mut sets = Sets::new(piece.len());
    for edge in edges.chunk_by(around) {
        if let [a, b] = edge {
            // The two sides of a doubled wall meet at its rim, back to back.
            if normal(a.3).dot(normal(b.3)) > -FLAT_COS {
                sets.join(a.3, b.3);
            }
            continue;
        }
        let (up, down) = edge.split_at(edge.partition_point(|e| !e.2));
        let mut pairs: Vec<(f64, u32, u32)> =
            up.iter().flat_map(|a| down.iter().map(move |b| (normal(a.3).dot(normal(b.3)), a.3, b.3))).collect();
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut taken = HashSet::new();
        for (_, a, b) in pairs {
            if !taken.contains(&a) && !taken.contains(&b) {
                taken.extend([a, b]);
                sets.join(a, b);
            }
        }
    }
    // Polygons stay whole.
    let mut first = HashMap::new();
    for (i, &t) in piece.iter().enumerate() {
        sets.join(*first.entry(shape.polygon[t as usize]).or_insert(i as u32), i as u32);
    }
    sets.groups(&piece)
}

fn unit(shape: &Shape, triangles: Vec<u32>) -> Unit {
    let sum: DVec3 = triangles.iter().flat_map(|&t| shape.corners(t)).sum();
    let center = sum / (3 * triangles.len()) as f64;
    Unit { triangles, center }
}

/// Takes the upper half off, neither being empty.
fn halve(units: &mut Vec<Unit>, count: usize) -> Vec<Unit> {
    let low = units.iter().fold(DVec3::INFINITY, |m, u| m.min(u.center));
    let high = units.iter().fold(DVec3::NEG_INFINITY, |m, u| m.max(u.center));
    let axis = (high - low).max_position();
    units.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]).then(a.triangles[0].cmp(&b.triangles[0])));
    let mut sum = 0;
    let middle = units.iter().position(|u| {
        sum += u.triangles.len();
        2 * sum >= count
    });
    units.split_off(middle.map_or(1, |m| m + 1).clamp(1, units.len() - 1))
}
