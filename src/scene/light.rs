//! Lights that are no surface of the scene: they shine, but block nothing and hold no texels.

use crate::color::Rgb;
use glam::{Affine3A, Vec3};

/// A light of the scene.
#[derive(Clone, Debug)]
pub struct Light {
    /// The source path, as in [`super::Surface::name`].
    pub name: String,
    pub shape: LightShape,
    /// Restricts where an area light, sphere or point shines (UsdLux ShapingAPI); relative to `-Z` of its frame.
    pub shaping: Option<Shaping>,
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
        self.focus_tint.lerp(Rgb::ONE, focus) * focus.max(0.0) * ramp
    }
}
