//! Polygons to triangles.
//!
//! Triangles stay, quads take the diagonal that keeps both halves facing the polygon's way (the shorter one where both
//! do), convex polygons become a fan, and others lose one ear after another in the plane of their Newell normal
//! (Meisters 1975; O(n r) for r reflex corners).

use glam::{Vec2, Vec3};

/// Above this many corners a concave polygon becomes a fan: cutting ears would take too long.
pub const MAX_EARS: usize = 8192;

/// Appends the triangles of the polygon with the given corner positions to `out`, as indices into `corners`, each in the
/// polygon's own winding. Returns false where a fan had to stand in for a concave polygon of too many corners.
pub fn triangulate(corners: &[Vec3], out: &mut Vec<[u32; 3]>) -> bool {
    match corners {
        [] | [_] | [_, _] => true,
        [_, _, _] => {
            out.push([0, 1, 2]);
            true
        }
        [a, b, c, d] => {
            quad([*a, *b, *c, *d], out);
            true
        }
        _ => {
            let flat = project(corners);
            let convex = is_convex(&flat);
            if convex || corners.len() > MAX_EARS {
                out.extend((1..corners.len() as u32 - 1).map(|i| [0, i, i + 1]));
            } else {
                cut_ears(&flat, out);
            }
            convex || corners.len() <= MAX_EARS
        }
    }
}

/// The polygon's area vector times two (Newell): its direction is the polygon's normal.
pub fn area_vector(corners: &[Vec3]) -> Vec3 {
    let Some(&origin) = corners.first() else { return Vec3::ZERO };
    corners.windows(2).fold(Vec3::ZERO, |sum, edge| match edge {
        [a, b] => sum + (*a - origin).cross(*b - origin),
        _ => sum,
    })
}

fn quad([a, b, c, d]: [Vec3; 4], out: &mut Vec<[u32; 3]>) {
    let normal = area_vector(&[a, b, c, d]);
    let faces = |p: Vec3, q: Vec3, r: Vec3| (q - p).cross(r - p).dot(normal) > 0.0;
    let (first, second) = (faces(a, b, c) && faces(a, c, d), faces(b, c, d) && faces(b, d, a));
    // Equal diagonals take the first: a square's triangulation must not hang on rounding.
    let shorter_first = a.distance_squared(c) <= b.distance_squared(d) * (1.0 + 1e-4);
    if first && (shorter_first || !second) || !second && shorter_first {
        out.extend([[0, 1, 2], [0, 2, 3]]);
    } else {
        out.extend([[1, 2, 3], [1, 3, 0]]);
    }
}

/// The polygon in a plane, counter-clockwise.
fn project(corners: &[Vec3]) -> Vec<Vec2> {
    let normal = area_vector(corners).try_normalize().unwrap_or(Vec3::Z);
    let (x, y) = normal.any_orthonormal_pair();
    // (x, y, normal) must be right-handed for counter-clockwise to stay so.
    let y = if x.cross(y).dot(normal) < 0.0 { -y } else { y };
    let origin = corners.first().copied().unwrap_or(Vec3::ZERO);
    corners.iter().map(|p| Vec2::new((*p - origin).dot(x), (*p - origin).dot(y))).collect()
}

fn cross(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    (b - a).perp_dot(c - a)
}

fn is_convex(flat: &[Vec2]) -> bool {
    let n = flat.len();
    // A star that winds twice is locally convex too: the turning directions alone can't tell, so the fan is checked.
    let at = |i: usize| flat.get(i % n).copied().unwrap_or_default();
    (0..n).all(|i| cross(at(i), at(i + 1), at(i + 2)) >= 0.0)
        && (1..n - 1).all(|i| cross(at(0), at(i), at(i + 1)) >= 0.0)
}

fn cut_ears(flat: &[Vec2], out: &mut Vec<[u32; 3]>) {
    let point = |i: u32| flat.get(i as usize).copied().unwrap_or_default();
    let mut ring: Vec<u32> = (0..flat.len() as u32).collect();
    let mut at = 0;
    let mut failed = 0;
    while ring.len() > 3 {
        let n = ring.len();
        let corner = |k: usize| ring.get(k % n).copied().unwrap_or(0);
        let [a, b, c] = [corner(at + n - 1), corner(at), corner(at + 1)];
        let [pa, pb, pc] = [a, b, c].map(point);
        let is_ear = cross(pa, pb, pc) > 0.0
            && !ring.iter().any(|&i| {
                let p = point(i);
                let is_corner = p == pa || p == pb || p == pc;
                !is_corner && cross(pa, pb, p) >= 0.0 && cross(pb, pc, p) >= 0.0 && cross(pc, pa, p) >= 0.0
            });
        // A ring without ears is self-intersecting or flat: any corner goes, so that every input ends.
        if is_ear || failed >= n {
            out.push([a, b, c]);
            ring.remove(at % n);
            at = (at + n - 1) % (n - 1);
            failed = 0;
        } else {
            at = (at + 1) % n;
            failed += 1;
        }
    }
    if let [a, b, c] = ring[..] {
        out.push([a, b, c]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
        let normal = area_vector(corners).normalize();
        triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| corners[i as usize]);
                let signed = (b - a).cross(c - a).dot(normal) / 2.0;
                assert!(signed >= 0.0, "{t:?} is turned over");
                signed
            })
            .sum()
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        // An L of area 3, an arrow-shaped quad, a comb.
        let ell = [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
        let arrow = [[0., 0.], [2., 1.], [0., 2.], [0.5, 1.]];
        let mut comb = vec![[0.0, 0.0], [8.0, 0.0]];
        for i in (0..8).rev() {
            comb.extend([[i as f32 + 1.0, 1.0], [i as f32 + 0.5, 0.25]]);
        }
        comb.push([0.0, 1.0]);
        for polygon in [&ell[..], &arrow[..], &comb[..]] {
            for reversed in [false, true] {
                // In a tilted plane.
                let mut corners: Vec<Vec3> = polygon.iter().map(|&[x, y]| Vec3::new(x, y, 0.5 * x - y)).collect();
                if reversed {
                    corners.reverse();
                }
                let mut triangles = Vec::new();
                assert!(triangulate(&corners, &mut triangles));
                assert_eq!(triangles.len(), corners.len() - 2);
                let expected = area_vector(&corners).length() / 2.0;
                assert!((area(&corners, &triangles) / expected - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn hopeless_polygons_end() {
        let mut out = Vec::new();
        triangulate(&[Vec3::ZERO; 9], &mut out);
        triangulate(&[Vec3::NAN; 9], &mut out);
        let star: Vec<Vec3> = (0..7).map(|i| Vec3::from((Vec2::from_angle(i as f32 * 2.7), 0.0))).collect();
        triangulate(&star, &mut out);
        assert!(out.iter().flatten().all(|&i| i < 9));
    }
}
