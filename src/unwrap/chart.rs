//! Flat charts in metres: made by projection or from an unwrapper, and made sound.
//!
//! A chart that leaves this module has triangles of positive UV area alone, none on top of another ([`super::overlap`]), a
//! total UV area equal to its area in space, and its smallest bounding box along the axes with a corner at the origin.

use super::overlap;
use super::shape::{Sets, Shape};
use glam::{DVec2, DVec3};
use std::collections::{HashMap, HashSet};

/// A chart: triangles of one mesh, flattened.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Triangle indices in the mesh.
    pub triangles: Vec<u32>,
    /// UVs [m] of each triangle's corners, in the order of the mesh's corners.
    pub uv: Vec<[DVec2; 3]>,
    /// Size of the bounding box [m]; both are positive.
    pub size: DVec2,
    /// Factor on the density of its mesh.
    pub factor: f64,
}

/// What an unwrapper leaves of a chart's shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Proportions {
    /// Its width and height are to scale.
    Kept,
    /// Both were scaled on their own.
    Lost,
}

impl Chart {
    /// Area [m²].
    pub fn area(&self) -> f64 {
        self.uv.iter().map(|t| signed_area(*t)).sum()
    }
}

/// Normals of a planar chart differ by at most about 0.3 degrees from their mean.
const PLANAR_COS: f64 = 1.0 - 1.5e-5;
/// A region that is projected onto a plane takes in polygons up to 25 degrees from its first one.
const REGION_COS: f64 = 0.9;
/// No triangle is projected at more than 72 degrees from the plane: that would shrink it to less than 0.3 of its area.
const PROJECT_COS: f64 = 0.3;
/// Triangles of a conformal map may be this many times larger or smaller than in space, in area; beyond it they are cut off.
const MAX_STRETCH: f64 = 10.0;
/// Authored triangles may be this many times smaller than their chart's mean, in area: artists save texels where nobody looks.
const LEAST_AUTHORED: f64 = 1e-3;

/// True where all `triangles`, which must be connected, lie in one plane.
pub fn is_flat(shape: &Shape, triangles: &[u32]) -> bool {
    let Some(normal) = mean_normal(shape, triangles) else { return false };
    triangles.iter().all(|&t| shape.cross(t).normalize_or_zero().dot(normal) >= PLANAR_COS)
}

/// Charts for `triangles` where they lie in one plane, else `None`. They must be connected.
pub fn planar(shape: &Shape, triangles: &[u32]) -> Option<Vec<Chart>> {
    let normal = mean_normal(shape, triangles)?;
    is_flat(shape, triangles).then(|| {
        let uv = triangles.iter().map(|&t| project(shape, t, normal)).collect();
        separate(shape, triangles.to_vec(), uv)
    })
}

/// Charts from an unwrapper's flattening, whose sign and scale are unknown. Triangles without UVs are attached to the rest
/// of their polygon. What was left flipped, far too small or far too large goes to `rejected`, polygon by polygon.
pub fn flattened(
    shape: &Shape,
    triangles: &[u32],
    uv: &[Option<[DVec2; 3]>],
    proportions: Proportions,
    rejected: &mut Vec<u32>,
) -> Vec<Chart> {
    if let Some(charts) = planar(shape, triangles) {
        return charts;
    }
    let Some(scale) = natural_scale(shape, triangles, uv, proportions) else {
        rejected.extend(triangles);
        return Vec::new();
    };
    let uv: Vec<_> = uv.iter().map(|t| t.map(|t| t.map(|p| p * scale))).collect();
    let uv = attach(shape, triangles, uv);
    let sound = |i: usize| {
        let stretch = signed_area(uv[i]) / shape.area(triangles[i]);
        let [a, b, c] = shape.corners(triangles[i]);
        let edges = [(0, 1, b - a), (1, 2, c - b), (2, 0, a - c)];
        (1.0 / MAX_STRETCH..MAX_STRETCH).contains(&stretch)
            && edges.iter().all(|&(i0, i1, e)| uv[i][i0].distance(uv[i][i1]) < MAX_STRETCH * e.length())
    };
    let mut bad: Vec<u32> =
        (0..triangles.len()).filter(|&i| !sound(i)).map(|i| shape.polygon[triangles[i] as usize]).collect();
    bad.sort_unstable();
    let (mut kept, mut kept_uv) = (Vec::new(), Vec::new());
    for (&t, &corners) in triangles.iter().zip(&uv) {
        if bad.binary_search(&shape.polygon[t as usize]).is_ok() {
            rejected.push(t);
        } else {
            kept.push(t);
            kept_uv.push(corners);
        }
    }
    if kept.is_empty() { Vec::new() } else { separate(shape, kept, kept_uv) }
}

/// An authored chart, scaled to its area in space; more than one where it overlaps itself. Polygons with a triangle that is mirrored
/// against most of the chart, or has next to no area beside what it has in space, go to `rejected`.
pub fn authored(shape: &Shape, triangles: Vec<u32>, mut uv: Vec<[DVec2; 3]>, rejected: &mut Vec<u32>) -> Vec<Chart> {
    let signed: f64 = uv.iter().map(|t| signed_area(*t)).sum();
    if signed < 0.0 {
        uv.iter_mut().flatten().for_each(|p| p.x = -p.x);
    }
    let flat: f64 = uv.iter().map(|t| signed_area(*t).abs()).sum();
    let area: f64 = triangles.iter().map(|t| shape.area(*t)).sum();
    let is_bad = |i: usize| signed_area(uv[i]) * area <= LEAST_AUTHORED * shape.area(triangles[i]) * flat;
    let bad: HashSet<u32> =
        (0..triangles.len()).filter(|i| is_bad(*i)).map(|i| shape.polygon[triangles[i] as usize]).collect();
    let is_kept = |t: &u32| !bad.contains(&shape.polygon[*t as usize]);
    rejected.extend(triangles.iter().filter(|t| !is_kept(t)));
    let (kept, kept_uv): (Vec<u32>, Vec<_>) = triangles.into_iter().zip(uv).filter(|(t, _)| is_kept(t)).unzip();
    if kept.is_empty() { Vec::new() } else { separate(shape, kept, kept_uv) }
}

/// Charts for any triangles, by projection of connected regions with similar normals onto planes.
pub fn projected(shape: &Shape, triangles: &[u32]) -> Vec<Chart> {
    let mut charts = Vec::new();
    for region in regions(shape, triangles) {
        if project_all(shape, &region, &mut charts) {
            continue;
        }
        for polygon in polygons(shape, &region) {
            if project_all(shape, &polygon, &mut charts) {
                continue;
            }
            // A polygon so bent that no plane shows all of it: its triangles part.
            for t in polygon {
                let [a, b, c] = shape.corners(t);
                let u = (b - a).length();
                let along = (c - a).dot(b - a) / u;
                let uv = [DVec2::ZERO, DVec2::new(u, 0.0), DVec2::new(along, 2.0 * shape.area(t) / u)];
                charts.extend(separate(shape, vec![t], vec![uv]));
            }
        }
    }
    charts
}

/// Appends charts of `triangles` projected along their mean normal; false where that shows one of them too slanted.
fn project_all(shape: &Shape, triangles: &[u32], charts: &mut Vec<Chart>) -> bool {
    let Some(normal) = mean_normal(shape, triangles) else { return false };
    if triangles.iter().any(|&t| shape.cross(t).normalize_or_zero().dot(normal) < PROJECT_COS) {
        return false;
    }
    let uv = triangles.iter().map(|&t| project(shape, t, normal)).collect();
    charts.extend(separate(shape, triangles.to_vec(), uv));
    true
}

/// Connected regions of polygons with one material, whose normals are near that of the region's largest polygon.
fn regions(shape: &Shape, triangles: &[u32]) -> Vec<Vec<u32>> {
    let units = polygons(shape, triangles);
    let mut unit_of = HashMap::new();
    for (u, unit) in units.iter().enumerate() {
        unit.iter().for_each(|&t| {
            unit_of.insert(t, u);
        });
    }
    let mut adjacent = vec![Vec::new(); units.len()];
    for [a, b] in shape.neighbors(triangles) {
        let (a, b) = (triangles[a as usize], triangles[b as usize]);
        let (ua, ub) = (unit_of[&a], unit_of[&b]);
        if ua != ub && shape.mesh.triangle_material[a as usize] == shape.mesh.triangle_material[b as usize] {
            adjacent[ua].push(ub);
            adjacent[ub].push(ua);
        }
    }
    let cross: Vec<DVec3> = units.iter().map(|u| u.iter().map(|&t| shape.cross(t)).sum()).collect();
    let mut order: Vec<usize> = (0..units.len()).collect();
    order.sort_by(|&a, &b| cross[b].length_squared().total_cmp(&cross[a].length_squared()).then(a.cmp(&b)));
    let mut done = vec![false; units.len()];
    let mut regions = Vec::new();
    for seed in order {
        if std::mem::replace(&mut done[seed], true) {
            continue;
        }
        let normal = cross[seed].normalize_or_zero();
        let (mut region, mut next) = (Vec::new(), vec![seed]);
        while let Some(u) = next.pop() {
            region.extend(&units[u]);
            for &v in &adjacent[u] {
                if !done[v] && cross[v].normalize_or_zero().dot(normal) >= REGION_COS {
                    done[v] = true;
                    next.push(v);
                }
            }
        }
        regions.push(region);
    }
    regions
}

/// `triangles` grouped by polygon, in order of the polygons' first triangles.
pub fn polygons(shape: &Shape, triangles: &[u32]) -> Vec<Vec<u32>> {
    let mut first = HashMap::new();
    let mut sets = Sets::new(triangles.len());
    for (i, &t) in triangles.iter().enumerate() {
        let f = *first.entry(shape.polygon[t as usize]).or_insert(i as u32);
        sets.join(f, i as u32);
    }
    sets.groups(triangles)
}

/// Splits where triangles overlap, sets the scale and turns each chart: the last step of every way to a chart.
fn separate(shape: &Shape, triangles: Vec<u32>, uv: Vec<[DVec2; 3]>) -> Vec<Chart> {
    let units = polygons(shape, &triangles);
    let position: HashMap<u32, usize> = triangles.iter().enumerate().map(|(i, &t)| (t, i)).collect();
    let mut ordered = Vec::with_capacity(uv.len());
    let mut groups = Vec::with_capacity(units.len());
    for unit in &units {
        let first = ordered.len();
        ordered.extend(unit.iter().map(|t| uv[position[t]]));
        groups.push(first..ordered.len());
    }
    let layer = overlap::layers(&ordered, &groups);
    (0..layer.iter().max().map_or(0, |m| m + 1))
        .map(|l| {
            let (mut triangles, mut corners) = (Vec::new(), Vec::new());
            for (i, unit) in units.iter().enumerate().filter(|&(i, _)| layer[i] == l) {
                triangles.extend(unit);
                corners.extend(&ordered[groups[i].clone()]);
            }
            finish(shape, triangles, corners)
        })
        .collect()
}

/// Scales a chart to its area in space and turns it into its smallest bounding box.
fn finish(shape: &Shape, triangles: Vec<u32>, mut uv: Vec<[DVec2; 3]>) -> Chart {
    let area: f64 = triangles.iter().map(|&t| shape.area(t)).sum();
    let flat: f64 = uv.iter().map(|&t| signed_area(t)).sum();
    let scale = if flat > 0.0 { (area / flat).sqrt() } else { 1.0 };
    let axis = smallest_box_axis(uv.iter().flatten().copied());
    for p in uv.iter_mut().flatten() {
        *p = DVec2::new(p.dot(axis), p.dot(axis.perp())) * scale;
    }
    let (low, high) = overlap::bounds(&uv);
    uv.iter_mut().flatten().for_each(|p| *p -= low);
    // A chart too thin for its coordinates still has a size to divide by.
    let size = (high - low).max(DVec2::splat(1e-6 * (high - low).max_element().max(f64::MIN_POSITIVE)));
    Chart { triangles, uv, size, factor: 1.0 }
}

/// The x axis (unit) of the smallest box around `points` that has a side along their convex hull.
fn smallest_box_axis(points: impl Iterator<Item = DVec2>) -> DVec2 {
    let hull = convex_hull(points.collect());
    let (mut best, mut best_area) = (DVec2::X, f64::INFINITY);
    for i in 0..hull.len() {
        let axis = (hull[(i + 1) % hull.len()] - hull[i]).normalize_or_zero();
        let extent = |a: DVec2| {
            let along = hull.iter().map(|p| p.dot(a));
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        let area = extent(axis) * extent(axis.perp());
        // The margin keeps the choice between equal boxes from hanging on rounding.
        if axis != DVec2::ZERO && area < best_area * (1.0 - 1e-9) {
            (best, best_area) = (axis, area);
        }
    }
    best
}

/// Andrew's monotone chain, counter-clockwise.
fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    for pass in 0..2 {
        let base = hull.len();
        for &p in &points {
            while hull.len() >= base + 2
                && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp_dot(p - hull[hull.len() - 2]) <= 0.0
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}

/// Gives triangles without UVs those of their polygon's corners, and where a corner has none, unfolds the triangle over an edge
/// that has. What can't be reached gets zeros.
fn attach(shape: &Shape, triangles: &[u32], uv: Vec<Option<[DVec2; 3]>>) -> Vec<[DVec2; 3]> {
    let mut open: Vec<usize> = (0..uv.len()).filter(|&i| uv[i].is_none()).collect();
    let mut known = HashMap::new();
    let key = |i: usize, k: usize| {
        let t = triangles[i] as usize;
        (shape.polygon[t], shape.welded[shape.mesh.triangles[t][k] as usize])
    };
    let mut result: Vec<_> = uv.iter().map(|t| t.unwrap_or_default()).collect();
    if open.is_empty() {
        return result;
    }
    for (i, t) in uv.iter().enumerate() {
        if let Some(t) = t {
            (0..3).for_each(|k| {
                known.insert(key(i, k), t[k]);
            });
        }
    }
    loop {
        let before = open.len();
        open.retain(|&i| {
            let found = [0, 1, 2].map(|k| known.get(&key(i, k)).copied());
            let p = shape.corners(triangles[i]);
            let corners = match found {
                [Some(a), Some(b), Some(c)] => [a, b, c],
                _ => {
                    let Some(third) = (0..3)
                        .find(|&k| found[k].is_none() && found[(k + 1) % 3].is_some() && found[(k + 2) % 3].is_some())
                    else {
                        return true;
                    };
                    let (a, b) = ((third + 1) % 3, (third + 2) % 3);
                    let (ua, ub) = (found[a].unwrap_or_default(), found[b].unwrap_or_default());
                    // The triangle's own shape, by the similarity that takes its edge to the edge in UVs.
                    let edge = p[b] - p[a];
                    let along = (p[third] - p[a]).dot(edge) / edge.length_squared();
                    let aside = 2.0 * shape.area(triangles[i]) / edge.length_squared();
                    let mut corners = [DVec2::ZERO; 3];
                    (corners[a], corners[b]) = (ua, ub);
                    corners[third] = ua + (ub - ua) * along + (ub - ua).perp() * aside;
                    corners
                }
            };
            (0..3).for_each(|k| {
                known.insert(key(i, k), corners[k]);
            });
            result[i] = corners;
            false
        });
        if open.len() == before || open.is_empty() {
            return result;
        }
    }
}

/// The factors on u and v that make an unwrapper's UVs a chart in metres: the total area of space, the sign that most of the area
/// has, and where proportions are lost, the aspect ratio of least Dirichlet energy, which is the most conformal one.
fn natural_scale(
    shape: &Shape,
    triangles: &[u32],
    uv: &[Option<[DVec2; 3]>],
    proportions: Proportions,
) -> Option<DVec2> {
    let mut energy = DVec2::ZERO;
    let (mut area, mut flat, mut signed) = (0.0, 0.0, 0.0);
    for (&t, uv) in triangles.iter().zip(uv) {
        let Some(uv) = uv else { continue };
        let [a, b, c] = shape.corners(t);
        let (e1, e2) = (b - a, c - a);
        let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
        let own = shape.area(t);
        // A |grad u|² = |du1 e2 - du2 e1|² / (4 A)
        let u = (d1.x * e2 - d2.x * e1).length_squared() / (4.0 * own);
        let v = (d1.y * e2 - d2.y * e1).length_squared() / (4.0 * own);
        if !(u.is_finite() && v.is_finite()) {
            continue;
        }
        energy += DVec2::new(u, v);
        area += own;
        signed += signed_area(*uv);
        flat += signed_area(*uv).abs();
    }
    let aspect = match proportions {
        Proportions::Kept => 1.0,
        Proportions::Lost => (energy.y / energy.x).sqrt().sqrt(),
    };
    let scale = (area / flat).sqrt();
    let scale = DVec2::new(scale * aspect * f64::signum(signed), scale / aspect);
    (scale.is_finite() && scale.x != 0.0 && scale.y != 0.0).then_some(scale)
}

/// The direction that most of the triangles' area faces; none where it cancels out.
fn mean_normal(shape: &Shape, triangles: &[u32]) -> Option<DVec3> {
    triangles.iter().map(|&t| shape.cross(t)).sum::<DVec3>().try_normalize()
}

/// A triangle's UVs [m] on the plane through the origin with this normal.
fn project(shape: &Shape, triangle: u32, normal: DVec3) -> [DVec2; 3] {
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    shape.corners(triangle).map(|p| DVec2::new(p.dot(u), p.dot(v)))
}

/// The area of a triangle, positive where its corners turn from +u to +v.
pub fn signed_area([a, b, c]: [DVec2; 3]) -> f64 {
    0.5 * (b - a).perp_dot(c - a)
}
