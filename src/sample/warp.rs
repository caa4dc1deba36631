//! Maps from the unit square to directions and shapes, each with its density.

use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4, TAU};

/// The unit disc, uniformly; concentric, so that stratification survives (Shirley, Chiu 1997). Density 1 / pi.
pub fn disc(u: [f32; 2]) -> Vec2 {
    let v = Vec2::new(2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if v == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, theta) =
        if v.x.abs() > v.y.abs() { (v.x, FRAC_PI_4 * (v.y / v.x)) } else { (v.y, FRAC_PI_2 - FRAC_PI_4 * (v.x / v.y)) };
    r * Vec2::new(theta.cos(), theta.sin())
}

/// All directions, uniformly. Density [`SPHERE_PDF`].
pub fn sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let (sin, cos) = (TAU * u[1]).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

/// Density [1/sr] of [`sphere`].
pub const SPHERE_PDF: f32 = 0.25 * FRAC_1_PI;

/// The hemisphere around +Z, in proportion to the cosine (Malley). Density [`cosine_hemisphere_pdf`].
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = disc(u);
    d.extend((1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Density [1/sr] of [`cosine_hemisphere`] for a direction at `cos` to the axis.
pub fn cosine_hemisphere_pdf(cos: f32) -> f32 {
    cos.max(0.0) * FRAC_1_PI
}

/// Barycentric weights of corners 1 and 2 of a point uniform in a triangle.
pub fn triangle(u: [f32; 2]) -> Vec2 {
    let s = u[0].sqrt();
    Vec2::new(1.0 - s, u[1] * s)
}

/// The cap of directions within the angle whose cosine is `cos_max` around +Z, uniformly. Density [`cap_pdf`].
pub fn cap(u: [f32; 2], cos_max: f32) -> Vec3 {
    let d = disc(u);
    let r2 = d.length_squared();
    // The disc's r^2 is uniform in 0..1, as 1 - cos is over the cap; the azimuth is the disc's.
    let h = r2 * (1.0 - cos_max);
    let scale = if r2 > 0.0 { (h * (2.0 - h) / r2).max(0.0).sqrt() } else { 0.0 };
    (d * scale).extend(1.0 - h)
}

/// Density [1/sr] of [`cap`] inside it.
pub fn cap_pdf(cos_max: f32) -> f32 {
    1.0 / (TAU * (1.0 - cos_max))
}

/// A rotation that takes +Z to the unit vector `n` (Duff et al. 2017).
pub fn frame(n: Vec3) -> Mat3 {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    Mat3::from_cols(
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
        n,
    )
}
