//! Constrained Delaunay triangulation of a triangle with points on its sides, and what stands in for it where it fails.

use crate::meshing::fine::edge;
use glam::DVec2;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};
use std::collections::BTreeMap;

/// Triangulates points whose first ones are the border of a triangle, counter-clockwise, corners and points on sides;
/// `sides` has a bit for each side that each of these lies on. Edges that cross others are left out, those first that
/// are given last. Triangles are counter-clockwise, and cover the border exactly: what rounding puts between points of
/// one side is dropped. `None` where that can't be had.
pub fn triangulate(points: &[DVec2], sides: &[u8], edges: &[[u32; 2]]) -> Option<Vec<[u32; 3]>> {
    let mut mesh = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut handles = Vec::with_capacity(points.len());
    for (i, p) in points.iter().enumerate() {
        // Numbers too small for it are as good as zero.
        let [x, y] = p.to_array().map(|x| if x.abs() < 1e-100 { 0.0 } else { x });
        let handle = mesh.insert(Point2::new(x, y)).ok()?;
        if handle.index() != i {
            return None;
        }
        handles.push(handle);
    }
    let border = (0..sides.len() as u32).map(|i| [i, (i + 1) % sides.len() as u32]);
    for [a, b] in border.chain(edges.iter().copied()) {
        let (a, b) = (handles[a as usize], handles[b as usize]);
        if mesh.can_add_constraint(a, b) {
            mesh.add_constraint(a, b);
        }
    }
    let on_side = |v: u32| sides.get(v as usize).copied().unwrap_or(0);
    let triangles: Vec<[u32; 3]> = mesh
        .inner_faces()
        .map(|face| face.vertices().map(|v| v.fix().index() as u32))
        .filter(|[a, b, c]| on_side(*a) & on_side(*b) & on_side(*c) == 0)
        .collect();
    covers(points, sides, &triangles).then_some(triangles)
}

/// True where triangles fill the border once: each of its edges has one, all others two, all turn the same way.
fn covers(points: &[DVec2], sides: &[u8], triangles: &[[u32; 3]]) -> bool {
    let mut of_edge: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    let mut used = vec![false; points.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| points[v as usize]);
        if (b - a).perp_dot(c - a) <= 0.0 {
            return false;
        }
        for k in 0..3 {
            *of_edge.entry(edge(t[k], t[(k + 1) % 3])).or_default() += 1;
            used[t[k] as usize] = true;
        }
    }
    let count = sides.len() as u32;
    let border: BTreeMap<[u32; 2], i32> = (0..count).map(|i| (edge(i, (i + 1) % count), 1)).collect();
    let fits = |(e, n): (&[u32; 2], &i32)| border.get(e).copied().unwrap_or(2) == *n;
    of_edge.iter().all(fits) && border.keys().all(|e| of_edge.contains_key(e)) && used.iter().all(|u| *u)
}

/// The same of the border alone, by which sides its points lie on and by no number, so that it can't fail.
pub fn fan_out(sides: &[u8]) -> Vec<[u32; 3]> {
    let mut rest: Vec<u32> = (0..sides.len() as u32).collect();
    let on_one_side =
        |vertices: &mut dyn Iterator<Item = &u32>| vertices.fold(0b111, |common, v| common & sides[*v as usize]) != 0;
    let mut triangles = Vec::with_capacity(sides.len().saturating_sub(2));
    while rest.len() > 3 {
        let n = rest.len();
        let is_ear = |i: &usize| {
            let ear = [rest[(i + n - 1) % n], rest[*i], rest[(i + 1) % n]];
            !on_one_side(&mut ear.iter()) && !on_one_side(&mut rest.iter().filter(|v| **v != rest[*i]))
        };
        // A border of a triangle always has one.
        let Some(i) = (0..n).find(is_ear) else { break };
        triangles.push([rest[(i + n - 1) % n], rest[i], rest[(i + 1) % n]]);
        rest.remove(i);
    }
    if let [a, b, c] = rest[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_are_filled_without_numbers() {
        // Corners at 0, 1 and 5; two points on the second side, one on the third, none on the first.
        let corner = [0b101, 0b011, 0b110];
        let sides = [corner[0], corner[1], 0b010, 0b010, corner[2], 0b100];
        let at = |v: f64, w: f64| DVec2::new(v, w);
        let points = [at(0., 0.), at(1., 0.), at(0.7, 0.3), at(0.2, 0.8), at(0., 1.), at(0., 0.4)];
        let triangles = fan_out(&sides);
        assert_eq!(triangles.len(), 4);
        assert!(covers(&points, &sides, &triangles), "{triangles:?}");
        assert!(covers(&points, &sides, &triangulate(&points, &sides, &[[2, 5]]).unwrap()));
        // One side alone.
        let sides = [corner[0], 0b001, 0b001, corner[1], corner[2]];
        let points = [at(0., 0.), at(0.2, 0.), at(0.6, 0.), at(1., 0.), at(0., 1.)];
        assert!(covers(&points, &sides, &fan_out(&sides)));
    }
}
