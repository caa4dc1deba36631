//! Light from infinitely far away in every direction: the sky.

use super::contribution::Contribution;
use super::{Scene, Wrap};
use crate::color::Rgb;
use glam::{Mat3, Vec3};

/// A latlong picture closes around the horizon and ends at the poles.
pub const WRAP: [Wrap; 2] = [Wrap::Repeat, Wrap::Clamp];

/// A constant sky, or one with a latlong picture; and others, whose light adds to it.
#[derive(Clone, Debug)]
pub struct Environment {
    /// The source path or flag, for messages.
    pub name: String,
    /// Radiance factor [nit]; multiplied by the texture where there is one.
    pub radiance: Rgb,
    /// Index of a latlong texture into `Scene::textures`; row 0 is the zenith (+Y of the sky's frame), see
    /// [`Environment::uv`].
    pub texture: Option<usize>,
    /// World directions from the sky's own frame (a rotation).
    pub world_from_sky: Mat3,
    /// What of its light is baked, and its group.
    pub contribution: Contribution,
    /// Further skies, none of which has others of its own.
    pub others: Vec<Environment>,
}

impl Environment {
    /// A constant sky of `radiance` [nit].
    pub fn constant(name: impl Into<String>, radiance: Rgb) -> Self {
        Self {
            name: name.into(),
            radiance,
            texture: None,
            world_from_sky: Mat3::IDENTITY,
            contribution: Contribution::default(),
            others: Vec::new(),
        }
    }

    /// True where it is the same in every direction.
    pub fn is_constant(&self) -> bool {
        self.texture.is_none() && self.others.iter().all(Self::is_constant)
    }

    /// This sky and the others, in order.
    pub fn each(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.others)
    }

    /// Radiance from the unit direction `d` [nit], without the others.
    pub fn own_radiance(&self, scene: &Scene, d: Vec3) -> Rgb {
        match self.texture {
            Some(t) => {
                let texel = scene.textures[t].sample(self.uv(d), WRAP).truncate();
                (self.radiance * texel).max(Rgb::ZERO)
            }
            None => self.radiance,
        }
    }

    /// Radiance from the unit direction `d` [nit], the others included.
    pub fn radiance_from(&self, scene: &Scene, d: Vec3) -> Rgb {
        self.others.iter().fold(self.own_radiance(scene, d), |sum, sky| sum + sky.own_radiance(scene, d))
    }

    /// Texture coordinates (v down) of the world direction `d` (unit): u = 0.5 looks along +Z, u = 0.75 along -X, as
    /// UsdLux and OpenEXR's latlong layout have it.
    pub fn uv(&self, d: Vec3) -> glam::Vec2 {
        let l = self.world_from_sky.transpose() * d;
        let u = 0.5 - l.x.atan2(l.z) / std::f32::consts::TAU;
        glam::Vec2::new(u, l.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI)
    }

    /// The world direction (unit) of texture coordinates `uv`: the inverse of [`Environment::uv`].
    pub fn direction(&self, uv: glam::Vec2) -> Vec3 {
        let (azimuth, polar) = ((0.5 - uv.x) * std::f32::consts::TAU, uv.y * std::f32::consts::PI);
        self.world_from_sky * Vec3::new(polar.sin() * azimuth.sin(), polar.cos(), polar.sin() * azimuth.cos())
    }
}
