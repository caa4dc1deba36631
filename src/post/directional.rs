//! Lightmaps for materials with normal maps: what a texel would hold about another normal, as layers beside the pages.
//!
//! All is in the world space of the bake: right-handed, metres, Y up, as GLBs have it (of a USD scene with Z up, (x, y, z) stands for
//! (x, -z, y) there). `value` is the page's quantity (E / pi [nit], or E [lx]); n and n0 are unit, n0 the surface's own shading normal.
//!
//! **`sh`**: spherical harmonics of the incident radiance to order 1, convolved with the clamped cosine (Ramamoorthi, Hanrahan 2001,
//! "An Efficient Representation for Irradiance Environment Maps") and with the basis' constants folded in, so that by channel
//!
//! ```text
//! value(n) = sh0 + sh1x n.x + sh1y n.y + sh1z n.z
//! ```
//!
//! With the moments of [`crate::moments`], E(n) = scalar / 4 + vector . n / 2. Both are scaled by one factor, by channel, so that
//! value(n0) is the page's value exactly: a flat normal map changes nothing. `sh0` is at least 0 and `|sh1| <= 2 sh0`; where light
//! comes from one side, value(n) falls below 0 on the other, and is to be cut off there. Coefficients of radiance come back as
//! `L_00 = sh0 / Y_0` and `L_1 = 3 / 2 sh1 / Y_1`, `Y_0 = sqrt(1 / (4 pi))`, `Y_1 = sqrt(3 / (4 pi))`, up to that factor.
//!
//! Single directions come out too flat: their cosine is cut off at order 1. Nearer to the truth, as soon as light comes more from one
//! side than from the others, is the form that keeps the mean and the first moment and never falls below 0 (Joseph 2015, "Reconstructing
//! Diffuse Lighting from Spherical Harmonic Data"; Sloan, Silvennoinen 2018, "Directional Lightmap Encoding Insights"): by channel with
//! `r = |sh1| / (2 sh0)`, `q = (1 + n . sh1 / |sh1|) / 2`, `p = 1 + 2 r` and `a = (1 - r) / (1 + r)` it is
//! `f(n) = sh0 (a + (1 - a) (p + 1) q^p)`, and `value(n) = page f(n) / f(n0)`.
//!
//! In a room with a lamp in its ceiling, values about normals tilted by 15, 30 and 45 degrees are off by 5, 8 and 9 % of the mean, in the
//! second form by 3, 6 and 9 %; the page alone by 8, 14 and 31 % (root mean squares against paths).
//!
//! **`dominant`**: the mean direction that light comes from, over all channels by luminance: a vector whose length, 0..=1, says how much
//! light agrees on it, 1 for a single direction, 1/2 for uniform light over the hemisphere. The same linear form with one direction
//! for all channels:
//!
//! ```text
//! value(n) = page max(0, 1 + 2 dominant . n) / (1 + 2 dominant . n0)
//! ```
//!
//! again exact about n0; the denominator is at least 1/2.

use super::dilate::{Finish, fill};
use super::{Channels, Directional, Layer, Quantity};
use crate::color::Rgb;
use crate::moments::Moments;
use glam::Vec3;

/// Coefficients are scaled to the page by this factor at most; what is missing then is added evenly. About the geometric normal it is
/// 4 / 3 at most.
const MOST_SCALE: f32 = 2.0;

/// The least that the mean direction may have along the own normal: value(n0) would come from nearly nothing.
const LEAST_ALONG: f32 = -0.25;

/// The layers of `form` in `quantity`: of patches with `irradiance` about `normal` [lx] that comes from where `moments` say [lx], all by
/// patch.
pub fn directional(
    to: &Finish,
    irradiance: &[Rgb],
    moments: &[Moments],
    normal: &dyn Fn(usize) -> Vec3,
    (form, quantity): (Directional, Quantity),
) -> Vec<Layer> {
    let layer = |name: &str, channels: Channels, value: &dyn Fn(usize) -> Rgb| Layer {
        name: name.into(),
        pages: fill(to, value).into_iter().map(|page| page.rgb).collect(),
        channels,
        unit: if channels == Channels::Rgb { quantity.unit() } else { "1" },
        of: None,
    };
    let albedo = &to.lit.reflectance.0;
    match form {
        Directional::Off => Vec::new(),
        Directional::Sh => {
            let coefficient =
                |k: usize| move |i: usize| quantity.of(harmonics(irradiance[i], &moments[i], normal(i))[k], albedo[i]);
            let names = ["sh0", "sh1x", "sh1y", "sh1z"].into_iter().enumerate();
            names.map(|(k, name)| layer(name, Channels::Rgb, &coefficient(k))).collect()
        }
        Directional::Dominant => vec![layer("dominant", Channels::Xyz, &|i| dominant(&moments[i], normal(i)))],
    }
}

/// The coefficients of `sh` for the irradiance `e` about `normal` (unit), all in the unit of `e`: even light, and along X, Y and Z.
pub fn harmonics(e: Rgb, moments: &Moments, normal: Vec3) -> [Rgb; 4] {
    let moments = moments.made_possible();
    let found = moments.irradiance(normal);
    let is_known = found.cmpgt(Rgb::ZERO);
    let scale = Rgb::select(is_known, (e / found).clamp(Rgb::ZERO, Rgb::splat(MOST_SCALE)), Rgb::ZERO);
    let [x, y, z] = moments.vector.map(|v| v * scale * 0.5);
    [e - (x * normal.x + y * normal.y + z * normal.z), x, y, z]
}

/// The mean direction, kept from pointing away from `normal` (unit).
pub fn dominant(moments: &Moments, normal: Vec3) -> Vec3 {
    let mean = moments.made_possible().mean_direction();
    let along = mean.dot(normal);
    if along < LEAST_ALONG { mean * (LEAST_ALONG / along) } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::warp::cosine_hemisphere;

    /// Light from `count` directions around Z, of one colour each.
    fn light(count: u32, seed: u32) -> Moments {
        let mut moments = Moments::default();
        for k in 0..count {
            let [x, y, r, g] = sobol_burley::sample_4d(k, 0, seed);
            moments.receive(Rgb::new(r, g, r * g), cosine_hemisphere([x, y]));
        }
        moments
    }

    #[test]
    fn the_value_about_the_own_normal_is_the_pages() {
        for seed in 0..50 {
            let moments = light(1 + seed % 7, seed);
            let [x, y, ..] = sobol_burley::sample_4d(seed, 1, 7);
            let normal = cosine_hemisphere([x, y]);
            let e = Rgb::new(0.0, 1.0, 3.0) * (seed as f32 + 0.5);
            let [c, x, y, z] = harmonics(e, &moments, normal);
            let value = c + x * normal.x + y * normal.y + z * normal.z;
            assert!((value - e).abs().max_element() <= 1e-6 * e.max_element(), "{value} against {e}");
            let length = (x * x + y * y + z * z).map(f32::sqrt);
            assert!(c.cmpge(Rgb::splat(-1e-4)).all() && length.cmple(c * 2.0 + 1e-3).all(), "{c} {length}");
            let d = dominant(&moments, normal);
            assert!(d.length() <= 1.0 + 1e-6 && 1.0 + 2.0 * d.dot(normal) >= 0.5 - 1e-6);
        }
    }

    #[test]
    fn even_light_of_a_hemisphere_is_exact_about_every_tilt() {
        let [c, _, _, z] = harmonics(Rgb::ONE, &Moments::uniform(Rgb::ONE, Vec3::Z), Vec3::Z);
        assert!((c - 0.5).abs().max_element() < 1e-6 && (z - 0.5).abs().max_element() < 1e-6);
    }

    #[test]
    fn dark_texels_have_no_direction() {
        assert_eq!(harmonics(Rgb::ZERO, &Moments::default(), Vec3::Z), [Rgb::ZERO; 4]);
        assert_eq!(dominant(&Moments::default(), Vec3::Z), Vec3::ZERO);
        // Light that was found by interpolation alone is even.
        assert_eq!(harmonics(Rgb::ONE, &Moments::default(), Vec3::Z), [Rgb::ONE, Rgb::ZERO, Rgb::ZERO, Rgb::ZERO]);
    }
}
