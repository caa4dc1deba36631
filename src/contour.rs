//! The form factor of a polygon as seen from a point, without occluders: Lambert's contour integral.
//!
//! `F = 1 / (2 pi) * sum over edges of angle(v_k, v_k+1) * (unit normal of the edge's plane through the point) . n`, over the
//! polygon clipped at the point's horizon (Lambert 1760; Baum, Rushmeier, Winget 1989, section 3). Exact up to rounding.

use glam::{DVec3, Vec3};

/// The most corners a polygon may have: a disc light's.
pub const MOST_CORNERS: usize = 32;

/// The share of the cosine-weighted hemisphere around `normal` (unit) at `position` that the planar polygon `corners` covers:
/// 0..=1, whatever its winding. The polygon has 3 to [`MOST_CORNERS`] corners; a point in its plane sees 0.
pub fn point_to_polygon(position: Vec3, normal: Vec3, corners: &[Vec3]) -> f32 {
    let clipped = above_horizon(position, normal, corners);
    let clipped = clipped.corners();
    let mut sum = 0.0f64;
    for (k, corner) in clipped.iter().enumerate() {
        sum += edge(corner.as_dvec3(), clipped[(k + 1) % clipped.len()].as_dvec3(), normal.as_dvec3());
    }
    ((sum / std::f64::consts::TAU).abs() as f32).min(1.0)
}

/// The light vector `integral of w dw` [sr] at `position` of the part of the planar polygon `corners` above the horizon of `normal` (unit)
/// where it has a radiance of 1 (Lambert 1760: pi times the form factor is its part along the normal), and the solid angle [sr] of that
/// part (Van Oosterom, Strackee 1983).
pub fn light_vector(position: Vec3, normal: Vec3, corners: &[Vec3]) -> (Vec3, f32) {
    let clipped = above_horizon(position, normal, corners);
    let [first, rest @ ..] = clipped.corners() else { return (Vec3::ZERO, 0.0) };
    let mut vector = DVec3::ZERO;
    for (k, corner) in clipped.corners().iter().enumerate() {
        let next = clipped.corners()[(k + 1) % clipped.corners().len()];
        vector += edge_vector(corner.as_dvec3(), next.as_dvec3());
    }
    let vector = 0.5 * vector.as_vec3();
    let fan = rest.windows(2).map(|pair| solid_angle([*first, pair[0], pair[1]].map(Vec3::as_dvec3)));
    let solid_angle = fan.sum::<f64>().abs() as f32;
    (if vector.dot(normal) < 0.0 { -vector } else { vector }, solid_angle)
}

/// The signed solid angle of a triangle seen from the origin.
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let lengths = [a, b, c].map(DVec3::length);
    let across = a.dot(b.cross(c));
    let along =
        lengths[0] * lengths[1] * lengths[2] + a.dot(b) * lengths[2] + a.dot(c) * lengths[1] + b.dot(c) * lengths[0];
    if across == 0.0 { 0.0 } else { 2.0 * across.atan2(along) }
}

/// As [`point_to_polygon`], in double precision and for any number of corners: for integrals over the point, whose error
/// estimates would take single precision's rounding for detail.
pub fn point_to_polygon_f64(position: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let Some(&last) = corners.last() else { return 0.0 };
    let mut sum = 0.0;
    let (mut first, mut previous): (Option<DVec3>, Option<DVec3>) = (None, None);
    let mut keep = |p: DVec3| {
        if let Some(before) = previous {
            sum += edge(before, p, normal);
        }
        first.get_or_insert(p);
        previous = Some(p);
    };
    let mut p = last - position;
    let mut hp = p.dot(normal);
    for &corner in corners {
        let q = corner - position;
        let hq = q.dot(normal);
        if (hp > 0.0 && hq < 0.0) || (hp < 0.0 && hq > 0.0) {
            keep(p + (q - p) * (hp / (hp - hq)));
        }
        if hq >= 0.0 {
            keep(q);
        }
        (p, hp) = (q, hq);
    }
    if let (Some(first), Some(last)) = (first, previous) {
        sum += edge(last, first, normal);
    }
    (sum / std::f64::consts::TAU).abs().min(1.0)
}

/// What the edge from `p` to `q`, relative to the point, adds to the integral. Edges through the point add nothing: their plane
/// is not defined, and its limit has no height over the horizon.
fn edge(p: DVec3, q: DVec3, normal: DVec3) -> f64 {
    let cross = p.cross(q);
    let length = cross.length();
    if length > 0.0 { length.atan2(p.dot(q)) / length * cross.dot(normal) } else { 0.0 }
}

/// The same before it is laid along a normal.
fn edge_vector(p: DVec3, q: DVec3) -> DVec3 {
    let cross = p.cross(q);
    let length = cross.length();
    if length > 0.0 { cross * (length.atan2(p.dot(q)) / length) } else { DVec3::ZERO }
}

/// The part of a polygon above a point's horizon.
pub struct Clipped {
    corners: [Vec3; 2 * MOST_CORNERS],
    count: usize,
}

impl Clipped {
    /// Corners relative to the point [m]; none where less than a triangle is left.
    pub fn corners(&self) -> &[Vec3] {
        if self.count < 3 { &[] } else { &self.corners[..self.count] }
    }
}

/// Clips the polygon `corners` (3 to [`MOST_CORNERS`]) at the horizon of a point.
pub fn above_horizon(position: Vec3, normal: Vec3, corners: &[Vec3]) -> Clipped {
    let count = corners.len();
    assert!((3..=MOST_CORNERS).contains(&count), "a polygon has 3 to {MOST_CORNERS} corners, not {count}");
    // A convex polygon gains one corner at most; others can gain one for each pair.
    let mut clipped = Clipped { corners: [Vec3::ZERO; 2 * MOST_CORNERS], count: 0 };
    let mut keep = |p: Vec3| {
        clipped.corners[clipped.count] = p;
        clipped.count += 1;
    };
    for (k, &corner) in corners.iter().enumerate() {
        let p = corner - position;
        let q = corners[(k + 1) % count] - position;
        let (hp, hq) = (p.dot(normal), q.dot(normal));
        if hp >= 0.0 {
            keep(p);
        }
        if (hp > 0.0 && hq < 0.0) || (hp < 0.0 && hq > 0.0) {
            keep(p + (q - p) * (hp / (hp - hq)));
        }
    }
    clipped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_square_above_its_corner_matches_the_closed_form() {
        // Howell's catalogue, B-3: element under the corner of a rectangle a x b at height c.
        let (x, y) = (1.0f64, 1.0f64);
        let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        let expected = (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / std::f64::consts::TAU;
        let square = [Vec3::new(0., 1., 0.), Vec3::new(1., 1., 0.), Vec3::new(1., 1., 1.), Vec3::new(0., 1., 1.)];
        let f = point_to_polygon(Vec3::ZERO, Vec3::Y, &square);
        assert!((f64::from(f) - expected).abs() < 1e-6, "{f} against {expected}");
        let f = point_to_polygon_f64(DVec3::ZERO, DVec3::Y, &square.map(Vec3::as_dvec3));
        assert!((f - expected).abs() < 1e-12, "{f} against {expected}");
    }

    #[test]
    fn both_precisions_clip_at_the_horizon_alike() {
        let corners =
            [Vec3::new(1., -1., -0.5), Vec3::new(1.5, 0.3, -1.), Vec3::new(0.7, 2., 0.1), Vec3::new(0.2, 0.1, 1.)];
        let (position, normal) = (Vec3::new(0.1, 0.0, 0.2), Vec3::new(0.1, 1.0, 0.2).normalize());
        let single = point_to_polygon(position, normal, &corners);
        let double = point_to_polygon_f64(position.as_dvec3(), normal.as_dvec3(), &corners.map(Vec3::as_dvec3));
        assert!((f64::from(single) - double).abs() < 1e-6, "{single} against {double}");
    }

    #[test]
    fn light_vector_is_that_of_sampled_directions() {
        let corners = [Vec3::new(1., -1., -0.5), Vec3::new(1.5, 0.3, -1.), Vec3::new(0.2, 0.1, 1.)];
        let (position, normal) = (Vec3::new(0.1, 0.0, 0.2), Vec3::new(0.1, 1.0, 0.2).normalize());
        let (vector, angle) = light_vector(position, normal, &corners);
        let (across, mut sum, mut whole) = ((corners[1] - corners[0]).cross(corners[2] - corners[0]), DVec3::ZERO, 0.0);
        let side = 1000;
        for (x, y) in (0..side).flat_map(|x| (0..side - x).map(move |y| (x, y))) {
            // The centroids of both halves of each cell below the diagonal.
            for third in [1.0f32, 2.0].into_iter().take(if x + y + 1 < side { 2 } else { 1 }) {
                let [u, v] = [x, y].map(|k| (k as f32 + third / 3.0) / side as f32);
                let way = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v - position;
                if way.dot(normal) > 0.0 {
                    let area = 0.5 * across.length() / (side * side) as f32;
                    let solid = area * way.dot(across.normalize()).abs() / way.length().powi(3);
                    sum += (way.normalize() * solid).as_dvec3();
                    whole += f64::from(solid);
                }
            }
        }
        assert!((vector.as_dvec3() - sum).length() < 1e-3 * sum.length(), "{vector} against {sum}");
        assert!((f64::from(angle) / whole - 1.0).abs() < 1e-3, "{angle} against {whole}");
        let factor = point_to_polygon(position, normal, &corners) * std::f32::consts::PI;
        assert!((vector.dot(normal) - factor).abs() < 1e-5);
    }

    #[test]
    fn half_space_wall_covers_half() {
        let far = 1e4;
        let wall =
            [Vec3::new(1., -far, -far), Vec3::new(1., far, -far), Vec3::new(1., far, far), Vec3::new(1., -far, far)];
        let f = point_to_polygon(Vec3::ZERO, Vec3::Y, &wall);
        assert!((f - 0.5).abs() < 1e-3, "{f}");
    }
}
