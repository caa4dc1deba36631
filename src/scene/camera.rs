//! Cameras: where a picture is taken from, and how.

use glam::{Mat3, Vec2, Vec3};

/// A camera of the scene.
#[derive(Clone, Debug)]
pub struct Camera {
    /// The source path, as in [`super::Surface::name`].
    pub name: String,
    /// Where it stands [m].
    pub position: Vec3,
    /// Its axes, orthonormal: it looks along -Z, +Y is up in the picture and +X to its right.
    pub world_from_camera: Mat3,
    pub projection: Projection,
    /// Width over height of what it sees; `None` where the picture decides.
    pub aspect: Option<f32>,
    /// The opening of its lens; none: a pinhole.
    pub lens: Option<Lens>,
}

/// How directions, or places, come to lie in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// `half_height`: the tangent of half the vertical angle of view; `shift`: how far the picture's middle lies from the axis,
    /// of its half width and half height.
    Perspective { half_height: f32, shift: Vec2 },
    /// `half_height` [m]: half of the picture's height in the scene.
    Orthographic { half_height: f32 },
}

/// A thin lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of its opening [m].
    pub radius: f32,
    /// Distance along the axis at which things are sharp [m].
    pub focus: f32,
}

impl Camera {
    /// A pinhole camera at `eye` that looks at `target`, +Y up, with the vertical angle of view `angle` [rad]. `None` where the two
    /// places are one, or the angle lies outside of 0 to pi.
    pub fn look_at(eye: Vec3, target: Vec3, angle: f32) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        // Straight up or down, north is up in the picture.
        let right = forward.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
        let half_height = (0.5 * angle).tan();
        let is_angle = angle > 0.0 && angle < std::f32::consts::PI && half_height.is_finite();
        is_angle.then(|| Self {
            name: "camera".into(),
            position: eye,
            world_from_camera: Mat3::from_cols(right, right.cross(forward), -forward),
            projection: Projection::Perspective { half_height, shift: Vec2::ZERO },
            aspect: None,
            lens: None,
        })
    }
}
