//! The layered surface of glTF and UsdPreviewSurface: a clear coat over a mixture of a metal, an opaque dielectric (a
//! mirror over something diffuse) and a clear one, which is thin or bounds a solid.
//!
//! Seen from outside, with m metallic, t transmission and b the base colour:
//!
//! ```text
//! f = coat + below * (m metal + (1 - m) ((1 - t) opaque + t clear))
//! metal  = GGX with F = b + (1 - b) (1 - cos)^5
//! opaque = GGX with F of `Dielectric` + b (1 - E(o)) (1 - E(i)) / (pi (1 - mean E)), E what mirrors above reflect
//! clear  = GGX with Fresnel's F, and b (1 - F) refracted, or straight on through a thin sheet, whose F is that of
//!          both faces, 2 F / (1 + F)
//! ```
//!
//! All facets have one roughness, so one mirror lobe has the sum of all F. What metal and clear facets lose to a second
//! bounce comes back as in [`super::energy`]. The coat takes `1 - max(E_c(o), E_c(i))` of what is below: reciprocal,
//! never more than what the coat leaves, and exact for mirrors and for what is diffuse; rough metals lose up to 5 % of
//! themselves below it.
//!
//! Directions are in a frame where `o` is above; [`Layered::inside`] tells on which side of a solid that is.

mod draw;

use super::Transport;
use super::energy::{Interface, Table, alpha};
use super::fresnel::{self, Rise};
use super::ggx::Ggx;
use crate::color::Rgb;
use crate::scene::Appearance;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Index of refraction of clear coats.
pub const COAT_IOR: f32 = 1.5;

/// Mean of (1 - cos)^5 over the hemisphere, weighed by the cosine.
const MEAN_SCHLICK: f32 = 1.0 / 21.0;

/// Tables that a surface reads.
#[derive(Clone, Copy, Debug)]
pub struct Energy<'a> {
    /// Facets that reflect everything.
    pub whole: &'a Table,
    /// Of metals.
    pub schlick: &'a Table,
    /// Of the coat.
    pub coat: &'a Table,
    /// Of the opaque dielectric.
    pub rise: &'a Table,
    /// Of the clear one, where it bounds a solid.
    pub interface: Option<&'a Interface>,
}

/// What clear parts are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clear {
    Thin,
    Solid,
}

/// A surface at a point.
#[derive(Clone, Copy, Debug)]
pub struct Layered<'a> {
    pub energy: Energy<'a>,
    /// Base colour, 0..=1, and the albedo of what is diffuse.
    pub base: Rgb,
    pub albedo: Rgb,
    /// Shares of the surface: metal, opaque dielectric, clear one.
    pub metal: f32,
    pub opaque: f32,
    pub clear: f32,
    pub kind: Clear,
    /// Perceptual.
    pub roughness: f32,
    /// Index of the clear part, at least 1.
    pub ior: f32,
    /// The opaque dielectric: curve, reflectance head-on, weight.
    pub rise: Rise,
    pub f0: Rgb,
    pub specular: f32,
    pub coat: f32,
    pub coat_roughness: f32,
    /// Found by [`Layered::new`].
    pub means: Means,
    /// The side that `o` is on is a solid's inside.
    pub inside: bool,
}

/// What holds for all directions.
#[derive(Clone, Copy, Debug, Default)]
pub struct Means {
    /// Mean of what mirrors above the diffuse part reflect.
    above: Rgb,
    /// Mean of what facets lose that reflect everything.
    lost: f32,
    /// Mean of what a solid's facets lose, and the share of it that crosses to the other side: from outside, from inside.
    lost_clear: [f32; 2],
    crossing: [f32; 2],
}

/// Strategies of sampling.
const COAT: usize = 0;
const MIRROR: usize = 1;
const CLEAR: usize = 2;
const DIFFUSE: usize = 3;
const AGAIN: usize = 4;
const CROSS: usize = 5;
const STRATEGIES: usize = 6;

/// Single directions at most.
pub(super) const SINGLES: usize = 4;

/// What a surface does to light of one direction, on the side that it is on: shares of energy.
#[derive(Clone, Copy)]
struct Sight {
    cos: f32,
    inside: bool,
    /// Facets that reflect everything.
    whole: f32,
    coat: f32,
    /// What mirrors above the diffuse part reflect.
    above: Rgb,
    /// Lost by the clear part, if it is solid.
    lost: f32,
}

impl<'a> Layered<'a> {
    /// Finishes a surface: its means.
    pub fn new(mut surface: Self) -> Self {
        let rough = surface.rough();
        surface.means.lost = if surface.is_smooth() { 0.0 } else { 1.0 - surface.energy.whole.mean(rough) };
        if surface.opaque > 0.0 && surface.coat > 0.0 {
            surface.means.above = surface.mean_coated();
        } else if surface.opaque > 0.0 {
            let (whole, rise) = (1.0 - surface.means.lost, surface.energy.rise.mean(rough));
            surface.means.above = surface.specular * (surface.f0 * whole + (Rgb::ONE - surface.f0) * rise);
        }
        if let Some(interface) = surface.energy.interface.filter(|_| surface.clear > 0.0 && !surface.is_smooth()) {
            surface.means.lost_clear = [0, 1].map(|k| interface.sides[k].mean_lost(rough));
            surface.means.crossing = interface.crossing(surface.ior, rough);
        }
        surface
    }

    /// Mean of the coat's and the mirror's reflection together, by Gauss and Legendre's five points in the squared
    /// cosine on two halves.
    fn mean_coated(&self) -> Rgb {
        const POINTS: [f32; 5] = [0.046_910_077, 0.230_765_34, 0.5, 0.769_234_66, 0.953_089_9];
        const WEIGHTS: [f32; 5] = [0.118_463_44, 0.239_314_34, 0.284_444_45, 0.239_314_34, 0.118_463_44];
        let mut sum = Rgb::ZERO;
        // Graded towards grazing angles, where reflection changes: the squared cosine is a fourth power of what is
        // spaced evenly.
        for (x, w) in POINTS.into_iter().zip(WEIGHTS) {
            for half in [0.0, 0.5] {
                let s = half + 0.5 * x;
                let jacobian = 4.0 * s * s * s;
                sum += self.above((s * s).min(1.0), self.coat_share(s * s)) * (0.5 * w * jacobian);
            }
        }
        sum
    }

    fn is_smooth(&self) -> bool {
        self.roughness < Appearance::SMOOTH
    }

    /// Roughness as tables know it: 0 for perfect mirrors.
    fn rough(&self) -> f32 {
        if self.is_smooth() { 0.0 } else { self.roughness }
    }

    fn ggx(&self) -> Ggx {
        Ggx { alpha: alpha(self.roughness) }
    }

    fn coat_ggx(&self) -> Ggx {
        Ggx { alpha: alpha(self.coat_roughness) }
    }

    fn is_coat_smooth(&self) -> bool {
        self.coat_roughness < Appearance::SMOOTH
    }

    /// The clear part sends light on in one direction only.
    fn is_clear_smooth(&self) -> bool {
        self.is_smooth() || self.kind == Clear::Solid && self.energy.interface.is_none()
    }

    /// Index beyond the surface over that on the side that `o` is on.
    fn eta(&self) -> f32 {
        if self.inside { 1.0 / self.ior } else { self.ior }
    }

    /// Share that the coat reflects.
    fn coat_share(&self, cos: f32) -> f32 {
        if self.coat == 0.0 {
            return 0.0;
        }
        let share = if self.is_coat_smooth() {
            fresnel::dielectric(cos, COAT_IOR)
        } else {
            let f0 = fresnel::head_on(COAT_IOR);
            let whole = self.energy.whole.at(cos, self.coat_roughness);
            f0 * whole + (1.0 - f0) * self.energy.coat.at(cos, self.coat_roughness)
        };
        self.coat * share
    }

    /// Share that the opaque dielectric's mirror reflects.
    fn mirror_share(&self, cos: f32) -> Rgb {
        let (whole, rise) = match self.is_smooth() {
            true => (1.0, self.rise.at(cos)),
            false => (self.energy.whole.at(cos, self.roughness), self.energy.rise.at(cos, self.roughness)),
        };
        self.specular * (self.f0 * whole + (Rgb::ONE - self.f0) * rise)
    }

    fn above(&self, cos: f32, coat: f32) -> Rgb {
        (Rgb::splat(coat) + (1.0 - coat) * self.mirror_share(cos)).min(Rgb::ONE)
    }

    fn sight(&self, cos: f32, inside: bool) -> Sight {
        let whole = if self.is_smooth() { 1.0 } else { self.energy.whole.at(cos, self.roughness) };
        let coat = if inside { 0.0 } else { self.coat_share(cos) };
        let above = if self.opaque > 0.0 && !inside { self.above(cos, coat) } else { Rgb::ONE };
        let lost = match self.energy.interface {
            Some(interface) if self.clear > 0.0 && !self.is_clear_smooth() => {
                interface.sides[usize::from(inside)].lost(cos, self.roughness)
            }
            _ => 0.0,
        };
        Sight { cos, inside, whole, coat, above, lost }
    }

    /// What a clear facet reflects at `cos` to it.
    fn clear_fresnel(&self, cos: f32, inside: bool) -> f32 {
        match self.kind {
            Clear::Solid => fresnel::dielectric(cos, if inside { 1.0 / self.ior } else { self.ior }),
            Clear::Thin => both_faces(fresnel::dielectric(cos, self.ior)),
        }
    }

    /// What a facet of the metal and the opaque dielectric reflects at `cos` to it.
    fn facet(&self, cos: f32) -> Rgb {
        if self.inside || self.metal + self.opaque == 0.0 {
            return Rgb::ZERO;
        }
        let metal = self.metal * (self.base + (Rgb::ONE - self.base) * fresnel::schlick(cos));
        let opaque = self.opaque * self.specular * (self.f0 + (Rgb::ONE - self.f0) * self.rise.at(cos));
        metal + opaque
    }

    /// What a facet of the clear part reflects, as a share of the whole surface.
    fn clear_facet(&self, cos: f32) -> f32 {
        if self.clear == 0.0 { 0.0 } else { self.clear * self.clear_fresnel(cos, self.inside) }
    }

    /// The chance with which light on a clear facet that reflects `fresnel` is mirrored where it is sampled.
    fn mirror_chance(&self, fresnel: f32) -> f32 {
        let passes = (1.0 - fresnel) * self.base.element_sum() / 3.0;
        if fresnel + passes > 0.0 { fresnel / (fresnel + passes) } else { 1.0 }
    }

    /// Of what a thin sheet's facets lose, the share that comes back to the side it came from.
    fn thin_back(&self) -> f32 {
        // The mean of F' over the hemisphere is close to F' at 60 degrees.
        both_faces(fresnel::dielectric(0.5, self.ior))
    }

    /// What metal facets send on of light that bounces between them (Kulla, Conty 2017).
    fn metal_again(&self) -> Rgb {
        let lost = self.means.lost;
        let fresnel = self.base + (Rgb::ONE - self.base) * MEAN_SCHLICK;
        fresnel * fresnel * (1.0 - lost) / (Rgb::ONE - fresnel * lost)
    }

    /// The lobe of what facets that lose nothing send back after several bounces.
    fn again(&self, o: &Sight, i: &Sight) -> f32 {
        if self.means.lost <= 0.0 {
            return 0.0;
        }
        (1.0 - o.whole).max(0.0) * (1.0 - i.whole).max(0.0) * FRAC_1_PI / self.means.lost
    }

    /// The part of the BSDF that is spread over the hemisphere of `o`: diffuse, and bounced between facets.
    fn spread(&self, o: &Sight, i: &Sight) -> Rgb {
        let below = 1.0 - o.coat.max(i.coat);
        let mut f = Rgb::ZERO;
        if self.metal > 0.0 && !self.inside {
            f += self.metal * below * self.again(o, i) * self.metal_again();
        }
        if self.opaque > 0.0 && !self.inside {
            f += self.opaque * self.diffuse(o, i);
        }
        if self.clear > 0.0 && !self.is_clear_smooth() {
            f += Rgb::splat(self.clear * below * self.clear_again(o, i));
        }
        f
    }

    fn diffuse(&self, o: &Sight, i: &Sight) -> Rgb {
        let rest = (Rgb::ONE - self.means.above).max(Rgb::splat(1e-6));
        self.albedo * (Rgb::ONE - o.above) * (Rgb::ONE - i.above) * FRAC_1_PI / rest
    }

    /// The lobe of light between clear facets that ends on the side it came from, per unit of the clear part.
    fn clear_again(&self, o: &Sight, i: &Sight) -> f32 {
        match self.kind {
            Clear::Thin => self.thin_back() * self.again(o, i),
            Clear::Solid => {
                let side = usize::from(o.inside);
                let mean = self.means.lost_clear[side];
                if mean > 0.0 { (1.0 - self.means.crossing[side]) * o.lost * i.lost * FRAC_1_PI / mean } else { 0.0 }
            }
        }
    }

    /// The lobe of light between clear facets that ends on the other side.
    fn cross(&self, o: &Sight, i: &Sight) -> f32 {
        match self.kind {
            Clear::Thin => (1.0 - self.thin_back()) * self.again(o, i),
            Clear::Solid => {
                let mean = self.means.lost_clear[usize::from(i.inside)];
                let crossing = self.means.crossing[usize::from(o.inside)];
                if mean > 0.0 { crossing * o.lost * i.lost * FRAC_1_PI / mean } else { 0.0 }
            }
        }
    }

    /// What the radiance of light that passes is multiplied by beside its power.
    fn compression(&self, mode: Transport) -> f32 {
        match (mode, self.kind) {
            (Transport::Radiance, Clear::Solid) => 1.0 / (self.eta() * self.eta()),
            _ => 1.0,
        }
    }

    /// The BSDF [1/sr], without what goes in one direction only.
    pub fn evaluate(&self, o: Vec3, i: Vec3, mode: Transport) -> Rgb {
        let seen = self.sight(o.z, self.inside);
        if i.z > 0.0 { self.reflection(&seen, o, i) } else { self.transmission(&seen, o, i, mode) }
    }

    fn reflection(&self, seen: &Sight, o: Vec3, i: Vec3) -> Rgb {
        let lit = self.sight(i.z, self.inside);
        let mut f = self.spread(seen, &lit);
        if !self.is_smooth() {
            let (mirror, h) = self.ggx().reflect(o, i);
            let facet = self.facet(o.dot(h)) + Rgb::splat(self.clear_facet(o.dot(h)));
            f += facet * (mirror * (1.0 - seen.coat.max(lit.coat)));
        }
        if self.coat > 0.0 && !self.inside && !self.is_coat_smooth() {
            let (mirror, h) = self.coat_ggx().reflect(o, i);
            f += Rgb::splat(self.coat * fresnel::dielectric(o.dot(h), COAT_IOR) * mirror);
        }
        f
    }

    fn transmission(&self, seen: &Sight, o: Vec3, i: Vec3, mode: Transport) -> Rgb {
        if self.clear == 0.0 || self.is_clear_smooth() {
            return Rgb::ZERO;
        }
        let lit = self.sight(-i.z, self.beyond());
        let through = match self.kind {
            Clear::Thin => {
                let i = i.with_z(-i.z);
                let (mirror, h) = self.ggx().reflect(o, i);
                (1.0 - self.clear_fresnel(o.dot(h), false)) * mirror
            }
            Clear::Solid => self
                .ggx()
                .refract(o, i, self.eta())
                .map_or(0.0, |(f, cos)| (1.0 - self.clear_fresnel(cos, self.inside)) * f),
        };
        let below = 1.0 - seen.coat.max(lit.coat);
        self.base * (self.clear * below * self.compression(mode) * (through + self.cross(seen, &lit)))
    }

    /// Whether the other side is a solid's inside.
    fn beyond(&self) -> bool {
        self.kind == Clear::Solid && !self.inside
    }

    /// Shares of the light that each strategy's lobes send on.
    fn shares(&self, o: &Sight) -> [Rgb; STRATEGIES] {
        let below = 1.0 - o.coat;
        let mut shares = [Rgb::ZERO; STRATEGIES];
        shares[COAT] = Rgb::splat(o.coat);
        let lost = (1.0 - o.whole).max(0.0);
        if !o.inside {
            let rise = match self.is_smooth() {
                true => fresnel::schlick(o.cos),
                false => self.energy.schlick.at(o.cos, self.roughness),
            };
            let metal = self.base * o.whole + (Rgb::ONE - self.base) * rise;
            shares[MIRROR] += below * self.metal * metal;
            shares[AGAIN] += below * self.metal * self.metal_again() * lost;
            if self.opaque > 0.0 {
                shares[MIRROR] += below * self.opaque * self.mirror_share(o.cos);
                shares[DIFFUSE] += self.opaque * self.diffuse_share(o);
            }
        }
        if self.clear > 0.0 {
            let (back, on, again, cross) = self.clear_shares(o, lost);
            shares[CLEAR] += below * self.clear * (Rgb::splat(back) + self.base * on);
            shares[AGAIN] += Rgb::splat(below * self.clear * again);
            shares[CROSS] += self.base * (below * self.clear * cross);
        }
        shares
    }

    /// Of light on clear facets: mirrored, passed, and after several bounces back and beyond.
    fn clear_shares(&self, o: &Sight, lost: f32) -> (f32, f32, f32, f32) {
        let fresnel = self.clear_fresnel(o.cos, o.inside);
        match self.energy.interface {
            _ if self.is_clear_smooth() => (fresnel, 1.0 - fresnel, 0.0, 0.0),
            Some(interface) if self.kind == Clear::Solid => {
                let side = &interface.sides[usize::from(o.inside)];
                let crossing = self.means.crossing[usize::from(o.inside)];
                let (back, on) = (side.reflected.at(o.cos, self.roughness), side.transmitted.at(o.cos, self.roughness));
                (back, on, (1.0 - crossing) * o.lost, crossing * o.lost)
            }
            _ => {
                let back = self.thin_back();
                (fresnel * o.whole, (1.0 - fresnel) * o.whole, back * lost, (1.0 - back) * lost)
            }
        }
    }

    fn diffuse_share(&self, o: &Sight) -> Rgb {
        self.albedo * (Rgb::ONE - o.above)
    }

    /// Share of the light at `cos` that the diffuse part sends back.
    pub fn diffuse_albedo(&self, cos: f32) -> Rgb {
        if self.inside || self.opaque == 0.0 {
            return Rgb::ZERO;
        }
        self.opaque * self.diffuse_share(&self.sight(cos, false))
    }

    /// Share of the light at `cos` that is sent on in all.
    pub fn whole_albedo(&self, cos: f32) -> Rgb {
        self.shares(&self.sight(cos, self.inside)).into_iter().sum()
    }

    /// All that it does goes in single directions.
    pub fn is_delta(&self) -> bool {
        let is_coat_smooth = self.coat == 0.0 || self.inside || self.is_coat_smooth();
        let is_bare = self.opaque == 0.0 || self.inside || self.albedo == Rgb::ZERO;
        self.is_smooth() && is_coat_smooth && is_bare
    }
}

/// What a thin sheet reflects whose faces reflect `f` each, all passes between them together.
pub fn both_faces(f: f32) -> f32 {
    2.0 * f / (1.0 + f)
}
