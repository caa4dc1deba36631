//! What shapes a light: UsdLux ShapingAPI with its IES profile, a rect light's texture, and projectors.
//!
//! A projector is no part of UsdLux. A light throws the picture of the attribute `asset lumel:projector`; beside it
//! `float lumel:projector:fov` is the full horizontal angle [degrees] (default: that of the shaping cone), and
//! `float lumel:projector:aspect` width over height (default: the picture's). `rel lumel:projector:target` names a prim that the
//! picture lands square on: the mean plane of the meshes below it. Or a plane is given in the light's parent's space:
//! `point3f lumel:projector:plane:point`, `normal3f lumel:projector:plane:normal`, `vector3f lumel:projector:plane:up` (optional).

use super::light::{boolean, float, input, rgb};
use super::read::{self, Reading};
use super::walk::{State, Walk};
use crate::color::Rgb;
use crate::load::ies;
use crate::load::image::ColorSpace;
use crate::load::projector::{ProjectorRequest, Target};
use crate::scene::projector::TargetPlane;
use crate::scene::web::WebKind;
use crate::scene::{Light, Picture, Profile, Shaping};
use glam::{DMat3, DMat4, DVec3, Mat3, Vec3};
use openusd::sdf::{AssetPath, Value};
use openusd::usd::Prim;
use std::sync::Arc;

/// Cone and focus, where the light has them.
pub fn shaping(prim: &Prim, world: DMat4, w: &mut Reading) -> Option<Shaping> {
    let applied = prim.has_api_schema("ShapingAPI").unwrap_or(false);
    let authored = ["inputs:shaping:cone:angle", "inputs:shaping:cone:softness", "inputs:shaping:focus"];
    if !applied && !authored.iter().any(|name| read::is_authored(prim, name)) {
        return None;
    }
    let mut value = |name: &str, default: f32| float(prim, name, w).unwrap_or(default);
    let cone_angle = value("inputs:shaping:cone:angle", if applied { 90.0 } else { 180.0 });
    let cone_softness = value("inputs:shaping:cone:softness", 0.0).clamp(0.0, 1.0);
    let focus = value("inputs:shaping:focus", 0.0).max(0.0);
    let focus_tint = rgb(prim, "inputs:shaping:focusTint", w).unwrap_or(Rgb::ZERO);
    let axis = (DMat3::from_mat4(world) * DVec3::NEG_Z).normalize_or(DVec3::NEG_Y).as_vec3();
    let cone_angle = cone_angle.clamp(0.0, 180.0).to_radians();
    Some(Shaping { axis, cone_angle, cone_softness, focus, focus_tint })
}

/// The asset that the input `name` holds, where it names a file.
fn asset(prim: &Prim, name: &str, w: &mut Reading) -> Option<AssetPath> {
    match input(prim, name, w) {
        Some(Value::AssetPath(file)) if !file.is_empty() => Some(file),
        _ => None,
    }
}

/// The IES profile of `light`, whose prim is `prim`. It multiplies the radiance by its intensities [cd], as the schema has it, or
/// with `shaping:ies:normalize` by them over their mean: then the light keeps its power.
pub fn profile(walk: &mut Walk, prim: &Prim, light: &Light) -> Option<Profile> {
    let w = &mut walk.warnings;
    let file = asset(prim, "inputs:shaping:ies:file", w)?;
    let name = file.asset_path().to_owned();
    let place = format!("{}: {name}", prim.path());
    let Some(resolved) = file.resolved_path() else {
        w.add_missing(place, "an IES profile was not found; the light shines without it");
        return None;
    };
    let read = walk
        .materials
        .textures()
        .resolver
        .read(resolved)
        .map_err(|error| error.to_string())
        .and_then(|bytes| ies::read(resolved, &bytes, &mut w.warnings).map_err(|error| error.to_string()));
    let web = match read {
        Ok(web) => web,
        Err(error) => {
            w.add_missing(format!("{place}: {error}"), "an IES profile can't be read; the light shines without it");
            return None;
        }
    };
    walk.profiles.push(super::package_file(resolved));
    let normalize = boolean(prim, "inputs:shaping:ies:normalize", w).unwrap_or(false);
    let mean = web.mean_intensity() as f32;
    if normalize && mean <= 0.0 {
        w.add(place, "an IES profile without light can't be normalized; the light shines without it");
        return None;
    }
    // The reference renderer of UsdLux reads type C with 0 degrees at -X, turning towards -Y, seen from behind the light. Types A
    // and B look along the beam with +X to the right.
    let web_from_light = match web.kind {
        WebKind::C => -Mat3::IDENTITY,
        WebKind::A | WebKind::B => Mat3::from_diagonal(Vec3::new(1.0, 1.0, -1.0)),
    };
    let tilt = (-light.world_from_light.z_axis).dot(Vec3::NEG_Y).clamp(-1.0, 1.0).acos();
    let scale = web.tilt_factor(tilt) / if normalize { mean } else { 1.0 };
    let angle_scale = float(prim, "inputs:shaping:ies:angleScale", w).filter(|s| s.is_finite()).unwrap_or(0.0);
    Some(Profile { web: Arc::new(web), scale, angle_scale, web_from_light })
}

/// The texture of a rect light.
pub fn picture(walk: &mut Walk, prim: &Prim, kind: &str) -> Option<Picture> {
    if kind != "RectLight" {
        return None;
    }
    let file = asset(prim, "inputs:texture:file", &mut walk.warnings)?;
    let texture = walk.materials.textures().load(prim, &file, ColorSpace::Auto, &mut walk.warnings)?;
    Some(Picture::OnLight(texture))
}

/// The picture that light number `light` is to throw, and the prim that it is to land on.
pub fn projector(
    walk: &mut Walk,
    prim: &Prim,
    light: usize,
    state: &State,
) -> Option<(ProjectorRequest, Option<String>)> {
    let file = asset(prim, "lumel:projector", &mut walk.warnings)?;
    let texture = walk.materials.textures().load(prim, &file, ColorSpace::Auto, &mut walk.warnings)?;
    let w = &mut walk.warnings;
    let fov = read::float(prim, "lumel:projector:fov", w).map(f32::to_radians);
    let aspect = read::float(prim, "lumel:projector:aspect", w);
    let plane = plane(prim, state, w).map_or(Target::None, Target::Plane);
    let targets = prim.relationship("lumel:projector:target").targets().unwrap_or_default();
    if targets.len() > 1 {
        w.add(prim.path(), "a projector has several targets; the first is used");
    }
    let target = targets.first().map(|path| path.as_str().to_owned());
    Some((ProjectorRequest { light, texture, fov, aspect, target: plane }, target))
}

/// The plane that a projector's attributes give, in the world.
fn plane(prim: &Prim, state: &State, w: &mut Reading) -> Option<TargetPlane> {
    let mut vector = |name: &str| read::rgb(prim, &format!("lumel:projector:plane:{name}"), w).map(Vec3::as_dvec3);
    let (point, normal, up) = (vector("point")?, vector("normal")?, vector("up"));
    let world_from_parent = state.parent;
    let linear = DMat3::from_mat4(world_from_parent);
    let inverse = linear.inverse().transpose();
    let normal = (inverse * normal).try_normalize()?.as_vec3();
    let point = world_from_parent.transform_point3(point).as_vec3();
    Some(TargetPlane { point, normal, up: up.map(|up| (linear * up).as_vec3()) })
}

/// The surfaces at or below the prim path `name`.
pub fn surfaces_below(name: String, surfaces: &[String]) -> Target {
    let is_below = |path: &str| path.strip_prefix(&name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    let surfaces = (0..surfaces.len()).filter(|&s| is_below(&surfaces[s])).collect();
    Target::Surfaces { name, surfaces }
}
