//! Lights that are no surface of the scene: they shine, but block nothing and hold no texels.

use super::contribution::Contribution;
use super::environment::Environment;
use super::link::Links;
use super::projector::{Picture, look_up};
use super::web::Profile;
use super::{Scene, Texture};
use crate::color::Rgb;
use glam::{Affine3A, Mat3, Vec2, Vec3};
use std::sync::Arc;

/// A light of the scene.
#[derive(Clone, Debug)]
pub struct Light {
    /// The source path, as in [`super::Surface::name`].
    pub name: String,
    pub shape: LightShape,
    /// Axes of the light, orthonormal: it shines along -Z, +Y is its up. It may mirror.
    pub world_from_light: Mat3,
    /// Restricts where an area light, sphere or point shines (UsdLux ShapingAPI); relative to `-Z` of its frame.
    pub shaping: Option<Shaping>,
    /// A measured distribution, as a factor on the intensity or radiance.
    pub profile: Option<Profile>,
    /// A picture on the light, or thrown by it.
    pub picture: Option<Picture>,
    pub links: Links,
    /// What of its light is baked, and its group.
    pub contribution: Contribution,
    /// glTF: the node's index.
    pub gltf_node: Option<usize>,
}

/// Geometry and strength. Radiance in nit, intensity in candela, illuminance in lux.
#[derive(Clone, Debug)]
pub enum LightShape {
    /// Shines alike in all directions.
    Point { position: Vec3, intensity: Rgb, range: Option<f32> },
    /// glTF spot: full inside `inner`, none outside `outer` (half angles [rad]), squared linear ramp of the cosines between.
    Spot { position: Vec3, direction: Vec3, intensity: Rgb, inner: f32, outer: f32, range: Option<f32> },
    /// From infinity along `direction` (the way the light travels, unit). `illuminance` at normal incidence [lx];
    /// `angle`: full angle of its disc [rad], 0 for a sharp one.
    Directional { direction: Vec3, illuminance: Rgb, angle: f32 },
    /// A parallelogram around `center` with half edges `u` and `v`; one-sided: it shines along `-(u x v)` (UsdLux: u is
    /// half the width along +X, v half the height along +Y, and the light shines along -Z).
    Rect { center: Vec3, u: Vec3, v: Vec3, radiance: Rgb },
    /// An ellipse with half axes `u` and `v`, one-sided as [`LightShape::Rect`] is.
    Disk { center: Vec3, u: Vec3, v: Vec3, radiance: Rgb },
    /// The unit sphere under `world_from_unit` (an ellipsoid where that is not uniform), shining outwards.
    Sphere { world_from_unit: Affine3A, radiance: Rgb },
    /// The side of the cylinder of radius 1 around X, -1..1 along it, under `world_from_unit`; no caps.
    Cylinder { world_from_unit: Affine3A, radiance: Rgb },
    /// A parallelogram as [`LightShape::Rect`] is, through which `sky` shines: along -(u x v), from behind. Whatever stands
    /// behind it blocks the sky, too.
    Portal { center: Vec3, u: Vec3, v: Vec3, sky: Arc<Environment> },
}

/// UsdLux ShapingAPI: zero beyond the cone, and a cosine power.
#[derive(Clone, Copy, Debug)]
pub struct Shaping {
    /// The light's axis in world space, unit.
    pub axis: Vec3,
    /// Cone half angle [rad]; pi for none.
    pub cone_angle: f32,
    /// 0 sharp .. 1 ramped over the whole cone.
    pub cone_softness: f32,
    /// Exponent on |cos| to the axis.
    pub focus: f32,
    /// Colour that off-axis light tends to with `focus`.
    pub focus_tint: Rgb,
}

impl Light {
    /// A light that shines as its shape says on everything, with axes that follow from the shape.
    pub fn new(name: impl Into<String>, shape: LightShape) -> Self {
        let along = |axis: Vec3| {
            let right = axis.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
            Mat3::from_cols(right, right.cross(axis), -axis)
        };
        let world_from_light = match &shape {
            LightShape::Spot { direction, .. } | LightShape::Directional { direction, .. } => along(*direction),
            LightShape::Rect { u, v, .. } | LightShape::Disk { u, v, .. } | LightShape::Portal { u, v, .. } => {
                let (x, z) = (u.normalize_or(Vec3::X), u.cross(*v).normalize_or(Vec3::Z));
                Mat3::from_cols(x, z.cross(x), z)
            }
            LightShape::Point { .. } | LightShape::Sphere { .. } | LightShape::Cylinder { .. } => Mat3::IDENTITY,
        };
        Self {
            name: name.into(),
            shape,
            world_from_light,
            shaping: None,
            profile: None,
            picture: None,
            links: Links::default(),
            contribution: Contribution::default(),
            gltf_node: None,
        }
    }

    /// True where it shines alike from every place on it in every direction (of a spot: as its cone says).
    pub fn is_plain(&self) -> bool {
        let sky_is_plain = match &self.shape {
            LightShape::Portal { sky, .. } => sky.is_constant(),
            _ => true,
        };
        self.shaping.is_none() && self.profile.is_none() && self.picture.is_none() && sky_is_plain
    }

    /// The middle of the light [m]; `None` of a directional one.
    pub fn position(&self) -> Option<Vec3> {
        match &self.shape {
            LightShape::Point { position, .. } | LightShape::Spot { position, .. } => Some(*position),
            LightShape::Directional { .. } => None,
            LightShape::Rect { center, .. } | LightShape::Disk { center, .. } | LightShape::Portal { center, .. } => {
                Some(*center)
            }
            LightShape::Sphere { world_from_unit, .. } | LightShape::Cylinder { world_from_unit, .. } => {
                Some(world_from_unit.translation.into())
            }
        }
    }

    /// The factor on intensity or radiance for light that leaves the place `at` on the light along the unit vector `direction`.
    pub fn factor(&self, scene: &Scene, at: Vec3, direction: Vec3) -> Rgb {
        let mut factor = self.shaping.map_or(Rgb::ONE, |shaping| shaping.factor(direction));
        if let Some(profile) = &self.profile {
            factor *= profile.intensity(self.world_from_light.transpose() * direction);
        }
        match &self.picture {
            Some(Picture::OnLight(texture)) => factor *= self.on_light(&scene.textures[*texture], at),
            Some(Picture::Thrown(projector)) => factor *= projector.factor(scene, at, direction),
            None => {}
        }
        factor
    }

    /// The colour of a picture over the light at `at`.
    fn on_light(&self, picture: &Texture, at: Vec3) -> Rgb {
        let LightShape::Rect { center, u, v, .. } = &self.shape else { return Rgb::ONE };
        // Coordinates along the half edges, which need not be at right angles.
        let n = u.cross(*v);
        let way = at - *center;
        let square = n.length_squared().max(f32::MIN_POSITIVE);
        let (s, t) = (way.cross(*v).dot(n) / square, u.cross(way).dot(n) / square);
        // A mirrored light has its half edge turned over, so that it faces the right way.
        let s = if u.dot(self.world_from_light.x_axis) < 0.0 { -s } else { s };
        look_up(picture, Vec2::new(0.5 - 0.5 * s, 0.5 - 0.5 * t))
    }
}

impl Shaping {
    /// The factor on radiance for light that leaves along `direction` (unit).
    pub fn factor(&self, direction: Vec3) -> Rgb {
        let cos = direction.dot(self.axis).clamp(-1.0, 1.0);
        let theta = cos.acos();
        if theta > self.cone_angle {
            return Rgb::ZERO;
        }
        let start = self.cone_angle * (1.0 - self.cone_softness.clamp(0.0, 1.0));
        let ramp = if theta <= start || start >= self.cone_angle {
            1.0
        } else {
            let t = (theta - start) / (self.cone_angle - start);
            1.0 - t * t * (3.0 - 2.0 * t)
        };
        let focus = if self.focus > 0.0 { cos.abs().powf(self.focus) } else { 1.0 };
        self.focus_tint.lerp(Rgb::ONE, focus) * ramp
    }
}
