//! The scattering of light at a point of a surface (BSDF), in a frame whose +Z is the shading normal on the material's
//! front.

use super::lafortune::Measured;
use super::layered::{Clear, Layered, SINGLES};
use super::pane::Pane;
use super::{Scattered, Transport};
use crate::color::Rgb;
use crate::sample::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// A surface at a point. Directions are unit and point away from the surface; those with z < 0 are behind it or inside.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf<'a> {
    pub(super) lobes: Lobes<'a>,
    pub(super) back: Back,
    /// Factor on all of it: opacity over the share that is stopped (1 but for sheets).
    pub(super) share: f32,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Lobes<'a> {
    /// Lambert's, of this albedo.
    Diffuse(Rgb),
    Layered(Layered<'a>),
    Measured(&'a Measured),
    Pane(Pane),
}

/// What is seen from behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Back {
    Black,
    /// The same as from the front.
    Alike,
    /// The inside of a solid.
    Inside,
}

impl<'a> Bsdf<'a> {
    /// The BSDF [1/sr], without the cosine and without lobes that send light in one direction only; black where light
    /// doesn't go.
    pub fn evaluate(&self, wo: Vec3, wi: Vec3, mode: Transport) -> Rgb {
        let Some((lobes, o, i)) = self.turned(wo, wi) else { return Rgb::ZERO };
        let f = match &lobes {
            Lobes::Layered(layered) => layered.evaluate(o, i, mode),
            _ if i.z <= 0.0 => Rgb::ZERO,
            Lobes::Diffuse(albedo) => *albedo * FRAC_1_PI,
            Lobes::Measured(measured) => measured.evaluate(o, i),
            Lobes::Pane(pane) => pane.evaluate(o, i),
        };
        f * self.share
    }

    /// Density [1/sr] with which [`sample`](Self::sample) draws `wi`, but for lobes that send light in one direction
    /// only. It is the same for both modes.
    pub fn pdf(&self, wo: Vec3, wi: Vec3, _: Transport) -> f32 {
        let Some((lobes, o, i)) = self.turned(wo, wi) else { return 0.0 };
        match &lobes {
            Lobes::Layered(layered) => layered.pdf(o, i),
            _ if i.z <= 0.0 => 0.0,
            Lobes::Diffuse(_) => cosine_hemisphere_pdf(i.z),
            Lobes::Measured(measured) => measured.pdf(o, i),
            Lobes::Pane(pane) => pane.pdf(o, i),
        }
    }

    /// Draws a direction by `u`, each number in [0, 1); the third chooses the lobe. `None` where the light ends.
    pub fn sample(&self, wo: Vec3, u: [f32; 3], mode: Transport) -> Option<Scattered> {
        let (lobes, o, _) = self.turned(wo, wo)?;
        let drawn = match &lobes {
            Lobes::Layered(layered) => layered.sample(o, u, mode),
            Lobes::Diffuse(albedo) => {
                let direction = cosine_hemisphere([u[0], u[1]]);
                let pdf = cosine_hemisphere_pdf(direction.z);
                let is_sound = pdf > 0.0 && *albedo != Rgb::ZERO;
                is_sound.then_some(Scattered { direction, weight: *albedo, pdf, delta: false, transmitted: false })
            }
            Lobes::Measured(measured) => measured.sample(o, u, mode),
            Lobes::Pane(pane) => pane.sample(o, u, mode),
        }?;
        Some(self.back_in_place(wo, drawn))
    }

    /// All that it does goes in single directions: `evaluate` is black everywhere.
    pub fn is_delta(&self) -> bool {
        match &self.lobes {
            Lobes::Layered(layered) => layered.is_delta(),
            Lobes::Diffuse(albedo) => *albedo == Rgb::ZERO,
            Lobes::Measured(_) => false,
            Lobes::Pane(pane) => pane.is_delta(),
        }
    }

    /// Share of the light from `wo` that the diffuse lobe sends back.
    pub fn diffuse_albedo(&self, wo: Vec3) -> Rgb {
        let Some((lobes, o, _)) = self.turned(wo, wo) else { return Rgb::ZERO };
        let albedo = match &lobes {
            Lobes::Layered(layered) => layered.diffuse_albedo(o.z),
            Lobes::Diffuse(albedo) => *albedo,
            Lobes::Measured(measured) => measured.diffuse_albedo(),
            Lobes::Pane(pane) => pane.diffuse_albedo(o.z),
        };
        albedo * self.share
    }

    /// Share of the power from `wo` that is sent on by all lobes, from tables: within a few per cent, for Russian
    /// roulette.
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let Some((lobes, o, _)) = self.turned(wo, wo) else { return Rgb::ZERO };
        let albedo = match &lobes {
            Lobes::Layered(layered) => layered.whole_albedo(o.z),
            Lobes::Diffuse(albedo) => *albedo,
            Lobes::Measured(measured) => measured.whole_albedo(o.z),
            Lobes::Pane(pane) => pane.whole_albedo(o.z),
        };
        albedo * self.share
    }

    /// Index of refraction behind the surface over that before it; 1 where light that passes isn't bent.
    pub fn eta(&self) -> f32 {
        match &self.lobes {
            Lobes::Layered(layered) if layered.clear > 0.0 && layered.kind == Clear::Solid => layered.ior,
            _ => 1.0,
        }
    }

    /// Lambert's, of `albedo` on the front, and black behind.
    pub fn lambert(albedo: Rgb) -> Self {
        Self { lobes: Lobes::Diffuse(albedo), back: Back::Black, share: 1.0 }
    }

    /// Some light goes on to the other side.
    pub fn transmits(&self) -> bool {
        matches!(&self.lobes, Lobes::Layered(layered) if layered.clear > 0.0)
    }

    /// All single directions that light from `wo` is sent on in, each with the whole of its share.
    pub fn singles(&self, wo: Vec3, mode: Transport) -> [Option<Scattered>; SINGLES] {
        let Some((lobes, o, _)) = self.turned(wo, wo) else { return [None; SINGLES] };
        let singles = match &lobes {
            Lobes::Layered(layered) => layered.singles(o, mode),
            Lobes::Pane(pane) => [Some(pane.single(o)), None, None, None],
            Lobes::Diffuse(_) | Lobes::Measured(_) => [None; SINGLES],
        };
        singles.map(|single| single.map(|drawn| self.back_in_place(wo, drawn)))
    }

    /// What was drawn on the side of `wo`, in the frame of the front.
    fn back_in_place(&self, wo: Vec3, drawn: Scattered) -> Scattered {
        let z = if wo.z < 0.0 { -drawn.direction.z } else { drawn.direction.z };
        Scattered { direction: drawn.direction.with_z(z), weight: drawn.weight * self.share, ..drawn }
    }

    /// Both directions in the frame of the side that `wo` is on, and the lobes of that side; `None` where it is black.
    fn turned(&self, wo: Vec3, wi: Vec3) -> Option<(Lobes<'a>, Vec3, Vec3)> {
        if wo.z > 0.0 {
            return Some((self.lobes, wo, wi));
        }
        if wo.z == 0.0 || wo.z.is_nan() || self.back == Back::Black {
            return None;
        }
        let lobes = match self.lobes {
            Lobes::Layered(layered) => Lobes::Layered(Layered { inside: self.back == Back::Inside, ..layered }),
            other => other,
        };
        Some((lobes, wo.with_z(-wo.z), wi.with_z(-wi.z)))
    }
}
