//! Directions into a triangle, uniform over the solid angle that it covers.
//!
//! Arvo 1995, "Stratified Sampling of Spherical Triangles". In double precision: the angles of small triangles nearly cancel.

use glam::DVec3;

/// A triangle as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct SphericalTriangle {
    /// Unit directions to the corners.
    corners: [DVec3; 3],
    /// Solid angle [sr], 0..=2 pi.
    pub solid_angle: f64,
}

impl SphericalTriangle {
    /// The triangle of `corners`, relative to the point. None where the point lies in its plane or all but sees none of it.
    pub fn new(corners: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(DVec3::normalize_or_zero);
        // Van Oosterom, Strackee 1983.
        let solid_angle = 2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        (solid_angle > SMALLEST).then_some(Self { corners: [a, b, c], solid_angle })
    }

    /// A unit direction at `u` of the unit square. Density [1/sr] inside: 1 / `solid_angle`.
    pub fn sample(&self, u: [f64; 2]) -> DVec3 {
        let [a, b, c] = self.corners;
        let (ab, ac) = (a.cross(b), a.cross(c));
        // The angle at a, between the planes of the two arcs that meet there.
        let (sin_alpha, cos_alpha) = {
            let (s, k) = (ab.cross(ac).length(), ab.dot(ac));
            let length = s.hypot(k).max(f64::MIN_POSITIVE);
            (s / length, k / length)
        };
        let alpha = sin_alpha.atan2(cos_alpha);
        let cos_c = a.dot(b);
        // The corner that leaves a triangle of the share u[0] on b's side.
        let (sin_phi, cos_phi) = (u[0] * self.solid_angle - alpha).sin_cos();
        let across = cos_phi - cos_alpha;
        let along = sin_phi + sin_alpha * cos_c;
        let above = (along * cos_phi - across * sin_phi) * cos_alpha - along;
        let below = (along * sin_phi + across * cos_phi) * sin_alpha;
        let q = if below == 0.0 { 1.0 } else { (above / below).clamp(-1.0, 1.0) };
        let towards = |from: DVec3, to: DVec3| (to - from * to.dot(from)).normalize_or_zero();
        let corner = a * q + towards(a, c) * (1.0 - q * q).max(0.0).sqrt();
        let z = 1.0 - u[1] * (1.0 - corner.dot(b));
        (b * z + towards(b, corner) * (1.0 - z * z).max(0.0).sqrt()).normalize_or_zero()
    }

    /// Density [1/sr] of [`sample`](Self::sample) in the direction `d`.
    pub fn pdf(&self, d: DVec3) -> f64 {
        let [a, b, c] = self.corners;
        let side = a.dot(b.cross(c)).signum();
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(p, q)| side * p.cross(*q).dot(d) >= 0.0);
        if inside { self.solid_angle.recip() } else { 0.0 }
    }
}

/// Solid angles below this drown in rounding [sr].
const SMALLEST: f64 = 1e-9;
