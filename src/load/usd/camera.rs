//! UsdGeomCamera: aperture and focal length in tenths of the stage's unit, as their ratio, and a lens where an f-stop is given.

use super::read::{self, Reading};
use super::walk::{State, Walk};
use crate::scene::{Camera, Lens, Projection};
use glam::{DMat3, DVec3, Mat3, Vec2};
use openusd::usd::Prim;

/// UsdGeomCamera's fallbacks [tenths of the stage's unit].
const HORIZONTAL_APERTURE: f32 = 20.955;
const VERTICAL_APERTURE: f32 = 15.2908;
const FOCAL_LENGTH: f32 = 50.0;

/// Adds the camera `prim` to the scene.
pub fn read_camera(walk: &mut Walk, prim: &Prim, state: &State) {
    let metres = walk.metres_per_unit as f32;
    let w = &mut walk.warnings;
    let mut positive = |name: &str, fallback: f32| {
        let value = read::float(prim, name, w).unwrap_or(fallback);
        (value.is_finite() && value > 0.0).then_some(value)
    };
    let lengths = (
        positive("horizontalAperture", HORIZONTAL_APERTURE),
        positive("verticalAperture", VERTICAL_APERTURE),
        positive("focalLength", FOCAL_LENGTH),
    );
    let axes = DMat3::from_mat4(state.world);
    let (back, right) = (axes.z_axis.try_normalize(), axes.y_axis.cross(axes.z_axis).try_normalize());
    let (Some(back), Some(right)) = (back, right) else {
        w.add(prim.path(), "the camera's transform is flat; it was left out");
        return;
    };
    let (Some(width), Some(height), Some(focal)) = lengths else {
        w.add(prim.path(), "the camera's aperture or focal length is not positive; it was left out");
        return;
    };
    let is_orthographic = read::token(prim, "projection", w).as_deref() == Some("orthographic");
    let projection = if is_orthographic {
        // Apertures are in tenths of a unit here, too.
        Projection::Orthographic { half_height: 0.05 * height * metres }
    } else {
        let offset = |name: &str, extent: f32, w: &mut Reading| {
            read::float(prim, name, w).filter(|v| v.is_finite()).map_or(0.0, |v| 2.0 * v / extent)
        };
        let shift =
            Vec2::new(offset("horizontalApertureOffset", width, w), offset("verticalApertureOffset", height, w));
        Projection::Perspective { half_height: 0.5 * height / focal, shift }
    };
    let lens = lens(prim, focal, metres, w).filter(|_| !is_orthographic);
    let columns = [right, back.cross(right), back].map(|v: DVec3| v.as_vec3());
    walk.scene.cameras.push(Camera {
        name: prim.path().as_str().to_owned(),
        position: state.world.w_axis.truncate().as_vec3(),
        world_from_camera: Mat3::from_cols(columns[0], columns[1], columns[2]),
        projection,
        aspect: Some(width / height),
        lens,
    });
}

/// The lens where there is an f-stop, which is 0 where nothing is to blur.
fn lens(prim: &Prim, focal: f32, metres: f32, w: &mut Reading) -> Option<Lens> {
    let positive = |value: Option<f32>| value.filter(|v| v.is_finite() && *v > 0.0);
    let f_stop = positive(read::float(prim, "fStop", w))?;
    let focus = positive(read::float(prim, "focusDistance", w));
    if focus.is_none() {
        w.add(prim.path(), "the camera has an f-stop and no focus distance; it was taken as a pinhole");
    }
    Some(Lens { radius: 0.5 * 0.1 * focal / f_stop * metres, focus: focus? * metres })
}
