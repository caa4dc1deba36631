//! Projectors: lights that throw a picture.
//!
//! Which texel a direction gets is a homography, as for a pinhole camera. Aimed askew at a plane, a plain picture lands as a
//! trapezium (keystone); given the plane, the picture is distorted beforehand so that it lands as a rectangle: the directions'
//! meeting points with the plane are linear in homogeneous coordinates, too.

use super::{Scene, Texture, Wrap};
use crate::color::Rgb;
use glam::{Mat3, Vec2, Vec3};

/// What stands on the light.
#[derive(Clone, Debug)]
pub enum Picture {
    /// A texture (index into [`Scene::textures`]) over a rect light, its first texel at +X, +Y of the light, its last at -X, -Y,
    /// as UsdLux has it: upright for whoever looks at the light.
    OnLight(usize),
    /// A picture that the light throws.
    Thrown(Projector),
}

/// A picture that a light throws: a factor on its intensity (or radiance) by direction. Outside of the picture it is dark.
#[derive(Clone, Debug)]
pub struct Projector {
    /// Index into [`Scene::textures`].
    pub texture: usize,
    /// (u w, v w, w) of the picture, v down, from a world direction; w > 0 in front.
    pub picture_from_direction: Mat3,
    /// Where a light of some size has its picture sharp, as a lens does; a point is sharp everywhere.
    pub focus: Option<Focus>,
}

/// The plane on which a picture is sharp.
#[derive(Clone, Copy, Debug)]
pub struct Focus {
    /// The middle of the light [m].
    pub centre: Vec3,
    /// A point of the plane [m], and its normal, unit.
    pub point: Vec3,
    pub normal: Vec3,
}

/// How wide a picture is thrown, and on what.
#[derive(Clone, Copy, Debug)]
pub struct Throw {
    /// Full horizontal angle [rad], between 0 and pi.
    pub fov: f32,
    /// Width over height of the picture where it lands, more than 0.
    pub aspect: f32,
    /// What it is to land square on.
    pub target: Option<TargetPlane>,
}

/// A plane that a picture is to land square on.
#[derive(Clone, Copy, Debug)]
pub struct TargetPlane {
    /// A point of it [m].
    pub point: Vec3,
    /// Normal, unit, to either side.
    pub normal: Vec3,
    /// Where the picture's top points to, as far as it lies in the plane; none: world up, on level planes the light's own up.
    pub up: Option<Vec3>,
}

/// A plane steeper than this to the world's horizon has an upper side: the sine of its tilt.
const LEVEL: f32 = 0.05;

/// The least cosine at which a projector can be aimed at its target.
const GRAZING: f32 = 1e-3;

impl Projector {
    /// A projector at `position` that looks along -Z of `world_from_light` (orthonormal, +Y its up).
    ///
    /// With a target, the picture's middle lands where the projector is aimed at, and the picture is as large as it would be
    /// on a screen across the beam at that distance.
    ///
    /// # Errors
    /// What is wrong, where the target lies behind the projector or along its beam, or the angle or aspect is out of range.
    pub fn new(texture: usize, position: Vec3, world_from_light: Mat3, throw: &Throw) -> Result<Self, &'static str> {
        let in_range = throw.fov > 0.0 && throw.fov < std::f32::consts::PI && throw.aspect > 0.0;
        if !in_range || !throw.aspect.is_finite() {
            return Err("a projector's angle must lie between 0 and 180 degrees and its aspect above 0");
        }
        let (right, up, axis) = (world_from_light.x_axis, world_from_light.y_axis, -world_from_light.z_axis);
        let half = (0.5 * throw.fov).tan();
        let Some(target) = throw.target else {
            // u = 1/2 + x / (2 half), v = 1/2 - y / (2 half / aspect), for x and y over the way along the axis.
            let u = right / (2.0 * half) + axis * 0.5;
            let v = up * (-throw.aspect / (2.0 * half)) + axis * 0.5;
            let picture_from_direction = Mat3::from_cols(u, v, axis).transpose();
            return Ok(Self { texture, picture_from_direction, focus: None });
        };
        let towards = target.normal * (target.point - position).dot(target.normal).signum();
        let height = (target.point - position).dot(towards);
        if axis.dot(towards) < GRAZING || height <= 0.0 {
            return Err("a projector's target lies behind it or along its beam; aim it at the target");
        }
        let distance = height / axis.dot(towards);
        let in_plane = |v: Vec3| v - towards * v.dot(towards);
        let wanted = target.up.unwrap_or(if in_plane(Vec3::Y).length() > LEVEL { Vec3::Y } else { up });
        let Some(top) = in_plane(wanted).try_normalize().or_else(|| in_plane(up).try_normalize()) else {
            return Err("a projector's target has no upper side; give its up vector");
        };
        // Seen from the projector.
        let side = towards.cross(top);
        let (width, middle) = (2.0 * distance * half, axis * distance);
        let lengthen = throw.aspect / width;
        // A direction d meets the plane at d height / (d . towards).
        let u = side * (height / width) + towards * (0.5 - middle.dot(side) / width);
        let v = top * (-height * lengthen) + towards * (0.5 + middle.dot(top) * lengthen);
        let focus = Focus { centre: position, point: target.point, normal: target.normal };
        Ok(Self { texture, picture_from_direction: Mat3::from_cols(u, v, towards).transpose(), focus: Some(focus) })
    }

    /// The place on the picture (v down, 0..1 within it) that lies in the world direction `d`; `None` behind the projector.
    pub fn uv(&self, d: Vec3) -> Option<Vec2> {
        let h = self.picture_from_direction * d;
        (h.z > 0.0).then(|| h.truncate() / h.z)
    }

    /// The picture's colour for light that leaves the place `at` on the light along the world direction `d` (unit).
    pub fn factor(&self, scene: &Scene, at: Vec3, d: Vec3) -> Rgb {
        let from_centre = match self.focus {
            Some(focus) => {
                let along = d.dot(focus.normal);
                let t = (focus.point - at).dot(focus.normal) / along;
                if along == 0.0 || t <= 0.0 {
                    return Rgb::ZERO;
                }
                at + d * t - focus.centre
            }
            None => d,
        };
        match self.uv(from_centre) {
            Some(uv) if uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all() => {
                look_up(&scene.textures[self.texture], uv)
            }
            _ => Rgb::ZERO,
        }
    }
}

/// The colour of a picture at `uv`, black where it is transparent.
pub fn look_up(picture: &Texture, uv: Vec2) -> Rgb {
    let texel = picture.sample(uv, [Wrap::Clamp; 2]);
    (texel.truncate() * texel.w).max(Rgb::ZERO)
}

impl TargetPlane {
    /// The plane through the middle of some surfaces, by the mean of their normals over the area; `None` where that is none.
    pub fn of_surfaces(scene: &Scene, surfaces: impl IntoIterator<Item = usize>) -> Option<Self> {
        let (mut normal, mut middle, mut area) = (glam::DVec3::ZERO, glam::DVec3::ZERO, 0.0);
        for s in surfaces {
            for t in 0..scene.meshes[scene.surfaces[s].mesh].triangles.len() {
                let [a, b, c] = scene.world_triangle(s, t).map(|p| p.as_dvec3());
                let twice = (b - a).cross(c - a);
                normal += twice;
                middle += (a + b + c) * (twice.length() / 3.0);
                area += twice.length();
            }
        }
        // Closed bodies have no side: their normals cancel.
        let facing = normal.length() > 1e-3 * area && area > 0.0;
        facing.then(|| Self { point: (middle / area).as_vec3(), normal: normal.normalize().as_vec3(), up: None })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looking down at a floor askew.
    fn frame() -> Mat3 {
        let axis = Vec3::new(0.3, -1.0, -0.8).normalize();
        let right = axis.cross(Vec3::Y).normalize();
        Mat3::from_cols(right, right.cross(axis), -axis)
    }

    #[test]
    fn a_plain_picture_is_a_pinhole_camera_s() {
        let throw = Throw { fov: 1.0, aspect: 2.0, target: None };
        let p = Projector::new(0, Vec3::ZERO, Mat3::IDENTITY, &throw).unwrap();
        let half = 0.5f32.tan();
        let near = |d: Vec3, uv: Vec2| assert!(p.uv(d).unwrap().distance(uv) < 1e-6, "{d}");
        near(Vec3::NEG_Z, Vec2::splat(0.5));
        near(Vec3::new(half, half / 2.0, -1.0), Vec2::new(1.0, 0.0));
        near(Vec3::new(-2.0 * half, -half, -2.0), Vec2::new(0.0, 1.0));
        assert!(p.uv(Vec3::Z).is_none());
    }

    #[test]
    fn a_picture_lands_square_on_its_target() {
        let position = Vec3::new(0.2, 3.0, 1.5);
        let target = TargetPlane { point: Vec3::ZERO, normal: Vec3::Y, up: Some(Vec3::NEG_Z) };
        let throw = Throw { fov: 0.6, aspect: 1.5, target: Some(target) };
        let p = Projector::new(0, position, frame(), &throw).unwrap();
        let axis = -frame().z_axis;
        let middle = position + axis * (position.y / -axis.y);
        let distance = middle.distance(position);
        let (width, height) = (2.0 * distance * 0.3f32.tan(), 2.0 * distance * 0.3f32.tan() / 1.5);
        // Right and up as someone sees them who looks down from the projector with the top to -Z.
        for (x, y) in [(0.0, 0.0), (0.5, 0.5), (-0.5, 0.5), (0.25, -0.4)] {
            let at = middle + Vec3::X * (x * width) + Vec3::NEG_Z * (y * height);
            let uv = p.uv(at - position).unwrap();
            assert!(uv.distance(Vec2::new(0.5 + x, 0.5 - y)) < 1e-5, "{x} {y}: {uv}");
        }
        // Behind, and along the beam.
        let behind = TargetPlane { point: Vec3::Y * 9.0, ..target };
        assert!(Projector::new(0, position, frame(), &Throw { target: Some(behind), ..throw }).is_err());
        let along = TargetPlane { normal: frame().x_axis, ..target };
        assert!(Projector::new(0, position, frame(), &Throw { target: Some(along), ..throw }).is_err());
    }
}
