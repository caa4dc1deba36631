//! Projectors as scene files and settings ask for them, turned into the light's own once the surfaces are known.

use crate::error::Warnings;
use crate::scene::projector::{TargetPlane, Throw};
use crate::scene::{LightShape, Picture, Projector, Scene};
use glam::Mat3;

/// A picture that a light is to throw.
#[derive(Clone, Debug)]
pub struct ProjectorRequest {
    /// Index into [`Scene::lights`].
    pub light: usize,
    /// Index into [`Scene::textures`].
    pub texture: usize,
    /// Full horizontal angle [rad]; none: that of the light's cone.
    pub fov: Option<f32>,
    /// Width over height; none: the picture's own.
    pub aspect: Option<f32>,
    pub target: Target,
}

/// What a picture is to land square on.
#[derive(Clone, Debug)]
pub enum Target {
    /// Nothing: it is thrown as a pinhole would.
    None,
    Plane(TargetPlane),
    /// Surfaces, by index; `up` as in [`TargetPlane`]. `name` is what the file calls them.
    Surfaces {
        name: String,
        surfaces: Vec<usize>,
    },
}

/// The angle of a projector on a light without a cone narrower than this [rad].
const WIDEST_CONE: f32 = 160.0 / 180.0 * std::f32::consts::PI;
const DEFAULT_FOV: f32 = 40.0 / 180.0 * std::f32::consts::PI;

impl ProjectorRequest {
    /// Puts the projector on its light. Where that can't be, the light stays as it is, with a warning.
    pub fn apply(&self, scene: &mut Scene, warnings: &mut Warnings) {
        let Some((light, picture)) = scene.lights.get(self.light).zip(scene.textures.get(self.texture)) else { return };
        let Some(position) = light.position() else {
            warnings.add(&light.name, "a directional light can't throw a picture; it shines without it");
            return;
        };
        let target = match &self.target {
            Target::None => None,
            Target::Plane(plane) => Some(*plane),
            Target::Surfaces { name, surfaces } => {
                let plane = TargetPlane::of_surfaces(scene, surfaces.iter().copied());
                if plane.is_none() {
                    let message =
                        "a projector's target is no surface with a side to it; the picture is thrown as it is";
                    warnings.add(format!("{}: {name}", light.name), message);
                }
                plane
            }
        };
        let cone = match &light.shape {
            LightShape::Spot { outer, .. } => Some(2.0 * outer),
            _ => light.shaping.map(|s| 2.0 * s.cone_angle),
        };
        let fov = self.fov.or(cone.filter(|c| *c < WIDEST_CONE)).unwrap_or(DEFAULT_FOV);
        let aspect = self.aspect.unwrap_or(picture.width as f32 / picture.height as f32);
        let axes: Mat3 = light.world_from_light;
        let throw = Throw { fov, aspect, target };
        // Without its target rather than not at all.
        let plain = || Projector::new(self.texture, position, axes, &Throw { target: None, ..throw });
        let projector = match Projector::new(self.texture, position, axes, &throw) {
            Ok(projector) => Ok(projector),
            Err(message) => {
                warnings.add(&light.name, message);
                plain()
            }
        };
        if let Ok(projector) = projector {
            scene.lights[self.light].picture = Some(Picture::Thrown(projector));
        }
    }
}
