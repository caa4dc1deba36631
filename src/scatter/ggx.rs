//! Rough interfaces of isotropic GGX microfacets (Walter, Marschner, Li, Torrance 2007, "Microfacet Models for
//! Refraction through Rough Surfaces"), with Smith's height-correlated shadowing (Heitz 2014) and normals drawn as they
//! are seen (Heitz 2018, in the form of Dupuy, Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps").
//!
//! Directions are unit, away from the surface, in a frame whose +Z is the normal; the direction `o` is above.

use crate::sample::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// A distribution of microfacets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Its width, more than 0.
    pub alpha: f32,
}

impl Ggx {
    /// Density of microfacet normals [1/sr].
    pub fn density(self, h: Vec3) -> f32 {
        let a2 = self.alpha * self.alpha;
        // sin^2 from the components themselves: 1 - cos^2 would drown narrow peaks in rounding.
        let d = h.x * h.x + h.y * h.y + a2 * h.z * h.z;
        a2 / (PI * d * d)
    }

    /// Smith's auxiliary function.
    fn lambda(self, w: Vec3) -> f32 {
        let (sin2, cos2) = (w.x * w.x + w.y * w.y, w.z * w.z);
        0.5 * ((1.0 + self.alpha * self.alpha * sin2 / cos2.max(f32::MIN_POSITIVE)).sqrt() - 1.0)
    }

    /// Share of the microfacets seen from `w` that nothing hides.
    pub fn masking(self, w: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// Share that is seen from both directions, on one side or both.
    pub fn shadowing(self, o: Vec3, i: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(o) + self.lambda(i))
    }

    /// A microfacet normal as seen from `o`. Density: [`visible`](Self::visible).
    pub fn sample(self, o: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(self.alpha * o.x, self.alpha * o.y, o.z).normalize();
        let z = (1.0 - u[1]) * (1.0 + stretched.z) - stretched.z;
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let h = Vec3::new(radius * cos, radius * sin, z) + stretched;
        Vec3::new(self.alpha * h.x, self.alpha * h.y, h.z.max(0.0)).normalize_or(Vec3::Z)
    }

    /// Density [1/sr] of microfacet normals as seen from `o`.
    pub fn visible(self, o: Vec3, h: Vec3) -> f32 {
        self.masking(o) * o.dot(h).max(0.0) * self.density(h) / o.z.max(f32::MIN_POSITIVE)
    }

    /// The reflection of a perfect mirror's facets, as a BSDF [1/sr], and its half vector. `i` above.
    pub fn reflect(self, o: Vec3, i: Vec3) -> (f32, Vec3) {
        let h = (o + i).normalize_or(Vec3::Z);
        let f = self.density(h) * self.shadowing(o, i) / (4.0 * o.z * i.z).max(f32::MIN_POSITIVE);
        (f, h)
    }

    /// Density [1/sr] of directions mirrored by facets from [`sample`](Self::sample).
    pub fn reflect_pdf(self, o: Vec3, i: Vec3) -> f32 {
        let h = (o + i).normalize_or(Vec3::Z);
        self.masking(o) * self.density(h) / (4.0 * o.z).max(f32::MIN_POSITIVE)
    }

    /// The refraction by facets that let everything through, as a BSDF that keeps power (Walter 2007, equation 21), and
    /// the cosine to the facet on o's side. `i` below, `eta`: index below over index above. `None` where no facet takes
    /// one to the other.
    pub fn refract(self, o: Vec3, i: Vec3, eta: f32) -> Option<(f32, f32)> {
        let (h, [ho, _], jacobian) = half(o, i, eta)?;
        let f = self.density(h) * self.shadowing(o, i) * ho * jacobian / (o.z * -i.z).max(f32::MIN_POSITIVE);
        Some((f, ho))
    }

    /// Density [1/sr] of directions refracted by facets from [`sample`](Self::sample), and the cosine to the facet on
    /// o's side.
    pub fn refract_pdf(self, o: Vec3, i: Vec3, eta: f32) -> Option<(f32, f32)> {
        let (h, [ho, _], jacobian) = half(o, i, eta)?;
        Some((self.visible(o, h) * jacobian, ho))
    }

    /// A direction above for light that has bounced between facets: what single scattering loses falls as (alpha /
    /// cos)^2 from cosines of alpha on, so cosines are drawn in proportion to 1 / (cos + alpha), and by Lambert's law
    /// as far as facets are rough.
    pub fn bounced(self, u: [f32; 2]) -> Vec3 {
        let a = self.alpha;
        if u[0] < a {
            return cosine_hemisphere([u[0] / a, u[1]]);
        }
        let cos = a * ((1.0 + a) / a).powf((u[0] - a) / (1.0 - a)) - a;
        let (cos, phi) = (cos.clamp(0.0, 1.0), TAU * u[1]);
        let sin = (1.0 - cos * cos).sqrt();
        Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
    }

    /// Density [1/sr] of [`bounced`](Self::bounced).
    pub fn bounced_pdf(self, cos: f32) -> f32 {
        let a = self.alpha;
        let grazing = 1.0 / (TAU * (cos + a) * ((1.0 + a) / a).ln());
        a * cosine_hemisphere_pdf(cos) + (1.0 - a) * grazing
    }
}

/// The normal of facets that refract `o` to `i`, its cosines to both, and the density of directions i over that of
/// normals.
fn half(o: Vec3, i: Vec3, eta: f32) -> Option<(Vec3, [f32; 2], f32)> {
    let h = (o + i * eta).try_normalize()?;
    let h = if h.z < 0.0 { -h } else { h };
    let (ho, hi) = (o.dot(h), i.dot(h));
    if ho <= 0.0 || hi >= 0.0 {
        return None;
    }
    let denominator = hi + ho / eta;
    (denominator != 0.0).then(|| (h, [ho, hi], -hi / (denominator * denominator)))
}

/// `o` mirrored about `h`.
pub fn mirrored(o: Vec3, h: Vec3) -> Vec3 {
    2.0 * o.dot(h) * h - o
}

/// `o` refracted at a facet of normal `h` on its side; `eta`: index beyond over this side's. `None` where all is
/// reflected.
pub fn refracted(o: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cos = o.dot(h);
    let sin2_t = (1.0 - cos * cos).max(0.0) / (eta * eta);
    if cos <= 0.0 || sin2_t >= 1.0 {
        return None;
    }
    Some((h * (cos / eta - (1.0 - sin2_t).sqrt()) - o / eta).normalize())
}
