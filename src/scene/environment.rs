//! Light from infinitely far away in every direction: the sky.

use crate::color::Rgb;
use glam::{Mat3, Vec3};

/// A constant sky, or one with a latlong picture.
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
}

impl Environment {
    /// A constant sky of `radiance` [nit].
    pub fn constant(name: impl Into<String>, radiance: Rgb) -> Self {
        Self { name: name.into(), radiance, texture: None, world_from_sky: Mat3::IDENTITY }
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
