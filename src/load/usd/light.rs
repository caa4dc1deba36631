//! UsdLux lights; the photometry is in [`crate::load::units`].

use super::read::{self, Reading};
use super::texture::Textures;
use super::walk::{State, Walk};
use crate::color::Rgb;
use crate::load::image::ColorSpace;
use crate::load::units;
use crate::scene::{Environment, Light, LightShape, Shaping};
use glam::{Affine3A, DMat3, DMat4, DVec3, Mat3};
use openusd::sdf::Value;
use openusd::usd::Prim;
use std::f64::consts::PI;

/// True where prims of the type `kind` are lights of UsdLux.
pub fn is_light(kind: &str) -> bool {
    matches!(
        kind,
        "RectLight"
            | "DiskLight"
            | "SphereLight"
            | "CylinderLight"
            | "DistantLight"
            | "DomeLight"
            | "DomeLight_1"
            | "PortalLight"
            | "GeometryLight"
            | "PluginLight"
    )
}

/// Adds the light `prim` of type `kind` to the scene.
pub fn read_light(walk: &mut Walk, prim: &Prim, kind: &str, state: &State) {
    let name = prim.path().as_str().to_owned();
    if matches!(kind, "PortalLight" | "GeometryLight" | "PluginLight") {
        walk.warnings.add(name, format!("{kind} prims are not supported yet and were left out"));
        return;
    }
    report_unsupported(prim, kind, &mut walk.warnings);
    let luminance = luminance(prim, &mut walk.warnings);
    if luminance.max_element() <= 0.0 || !luminance.is_finite() {
        walk.warnings.add(name, "a light that shines nothing was left out");
        return;
    }
    if !state.world.is_finite() || DMat3::from_mat4(state.world).determinant() == 0.0 {
        walk.warnings.add(name, "the transform is not invertible; the light was left out");
        return;
    }
    if kind.starts_with("DomeLight") {
        read_dome(walk, prim, kind, state, luminance);
        return;
    }
    let placed = Placed {
        world: state.world,
        metres_per_unit: walk.metres_per_unit,
        normalize: read::boolean(prim, "inputs:normalize", &mut walk.warnings).unwrap_or(false),
        luminance,
    };
    let shape = shape(prim, kind, &placed, &mut walk.warnings);
    let shaping = if kind == "DistantLight" { None } else { shaping(prim, state.world, &mut walk.warnings) };
    walk.scene.lights.push(Light { name, shape, shaping, gltf_node: None });
}

/// `intensity * 2^exposure * color * temperature` [nit]. The `diffuse` multiplier counts too: a lightmap is diffuse light.
pub fn luminance(prim: &Prim, w: &mut Reading) -> Rgb {
    let mut float = |name: &str, default: f32| read::float(prim, name, w).unwrap_or(default);
    let scalar = float("inputs:intensity", 1.0)
        * units::exposure_scale(float("inputs:exposure", 0.0))
        * float("inputs:diffuse", 1.0);
    let kelvin = float("inputs:colorTemperature", 6500.0);
    let color = read::rgb(prim, "inputs:color", w).unwrap_or(Rgb::ONE);
    let tinted = read::boolean(prim, "inputs:enableColorTemperature", w).unwrap_or(false);
    let temperature = if tinted { units::blackbody_rgb(kelvin) } else { Rgb::ONE };
    color.max(Rgb::ZERO) * temperature * scalar.max(0.0)
}

/// A light's place and its luminance before normalization.
struct Placed {
    world: DMat4,
    metres_per_unit: f64,
    normalize: bool,
    luminance: Rgb,
}

impl Placed {
    /// The radiance [nit] of a shape of `area` [m^2]. `normalize` divides by the area in the stage's own units, as the
    /// schema and every renderer have it.
    fn radiance(&self, area: f64) -> Rgb {
        if self.normalize { self.normalized(area) } else { self.luminance }
    }

    fn normalized(&self, area: f64) -> Rgb {
        let stage_area = area / (self.metres_per_unit * self.metres_per_unit);
        if stage_area > 0.0 { self.luminance / stage_area as f32 } else { Rgb::ZERO }
    }

    fn linear(&self) -> DMat3 {
        DMat3::from_mat4(self.world)
    }
}

fn shape(prim: &Prim, kind: &str, light: &Placed, w: &mut Reading) -> LightShape {
    let linear = light.linear();
    let center = light.world.w_axis.truncate().as_vec3();
    let mut length = |name: &str, default: f32| f64::from(read::float(prim, name, w).unwrap_or(default).max(0.0));
    match kind {
        "RectLight" => {
            let u = linear.x_axis * (length("inputs:width", 1.0) / 2.0);
            let v = linear.y_axis * (length("inputs:height", 1.0) / 2.0);
            let radiance = light.radiance(4.0 * u.cross(v).length());
            let (u, v) = facing(&linear, u, v);
            LightShape::Rect { center, u: u.as_vec3(), v: v.as_vec3(), radiance }
        }
        "DiskLight" => {
            let radius = length("inputs:radius", 0.5);
            let (u, v) = (linear.x_axis * radius, linear.y_axis * radius);
            let radiance = light.radiance(PI * u.cross(v).length());
            let (u, v) = facing(&linear, u, v);
            LightShape::Disk { center, u: u.as_vec3(), v: v.as_vec3(), radiance }
        }
        "CylinderLight" => {
            let (half, radius) = (length("inputs:length", 1.0) / 2.0, length("inputs:radius", 0.5));
            let unit = linear * DMat3::from_diagonal(DVec3::new(half, radius, radius));
            let world_from_unit = affine(unit, light.world);
            if read::boolean(prim, "treatAsLine", w).unwrap_or(false) {
                w.add(prim.path(), "treatAsLine is a hint that is not followed: the cylinder keeps its radius");
            }
            LightShape::Cylinder { world_from_unit, radiance: light.radiance(units::cylinder_area(unit)) }
        }
        "DistantLight" => {
            let angle = read::float(prim, "inputs:angle", w).unwrap_or(0.53).clamp(0.0, 360.0);
            let direction = (linear * DVec3::NEG_Z).normalize_or(DVec3::NEG_Y).as_vec3();
            let size = if light.normalize { units::distant_size_factor(angle) } else { 1.0 };
            let illuminance = light.luminance * (units::distant_illuminance(angle) / size) as f32;
            LightShape::Directional { direction, illuminance, angle: angle.to_radians() }
        }
        _ => {
            let radius = length("inputs:radius", 0.5);
            if radius > 0.0 && !read::boolean(prim, "treatAsPoint", w).unwrap_or(false) {
                let unit = linear * radius;
                let radiance = light.radiance(units::ellipsoid_area(unit));
                return LightShape::Sphere { world_from_unit: affine(unit, light.world), radiance };
            }
            LightShape::Point { position: center, intensity: point_intensity(prim, light, radius, w), range: None }
        }
    }
}

/// The intensity [cd] of a sphere that is treated as a point: its radiance times its mean projected area, a quarter of
/// its surface (Cauchy). A sphere of radius 0 is the limit of normalized ones.
fn point_intensity(prim: &Prim, light: &Placed, radius: f64, w: &mut Reading) -> Rgb {
    let square_metre = light.metres_per_unit * light.metres_per_unit;
    if radius > 0.0 && !light.normalize {
        let area = units::ellipsoid_area(light.linear() * radius);
        return light.luminance * (area / 4.0) as f32;
    }
    if radius == 0.0 && !light.normalize {
        let message = "a sphere light of radius 0 without normalize would shine nothing; it is taken as normalized";
        w.add(prim.path(), message);
    }
    light.luminance * (square_metre / 4.0) as f32
}

/// Half edges such that `-(u x v)` is the transformed -Z; a mirrored transform turns one of them over.
fn facing(linear: &DMat3, u: DVec3, v: DVec3) -> (DVec3, DVec3) {
    if linear.determinant() < 0.0 { (-u, v) } else { (u, v) }
}

fn affine(linear: DMat3, world: DMat4) -> Affine3A {
    Affine3A::from_mat3_translation(linear.as_mat3(), world.w_axis.truncate().as_vec3())
}

fn shaping(prim: &Prim, world: DMat4, w: &mut Reading) -> Option<Shaping> {
    let applied = prim.has_api_schema("ShapingAPI").unwrap_or(false);
    let authored = ["inputs:shaping:cone:angle", "inputs:shaping:cone:softness", "inputs:shaping:focus"];
    if !applied && !authored.iter().any(|name| read::is_authored(prim, name)) {
        return None;
    }
    if let Some(Value::AssetPath(file)) = read::value(prim, "inputs:shaping:ies:file", w)
        && !file.is_empty()
    {
        w.add(format!("{}: {file}", prim.path()), "IES profiles are not supported yet; the light shines without it");
    }
    let mut float = |name: &str, default: f32| read::float(prim, name, w).unwrap_or(default);
    let cone_angle = float("inputs:shaping:cone:angle", if applied { 90.0 } else { 180.0 });
    let cone_softness = float("inputs:shaping:cone:softness", 0.0).clamp(0.0, 1.0);
    let focus = float("inputs:shaping:focus", 0.0).max(0.0);
    let focus_tint = read::rgb(prim, "inputs:shaping:focusTint", w).unwrap_or(Rgb::ZERO);
    let axis = (DMat3::from_mat4(world) * DVec3::NEG_Z).normalize_or(DVec3::NEG_Y).as_vec3();
    let cone_angle = cone_angle.clamp(0.0, 180.0).to_radians();
    Some(Shaping { axis, cone_angle, cone_softness, focus, focus_tint })
}

fn read_dome(walk: &mut Walk, prim: &Prim, kind: &str, state: &State, radiance: Rgb) {
    let name = prim.path().as_str().to_owned();
    let texture = dome_texture(prim, walk.materials.textures(), &mut walk.warnings);
    if let Some(sky) = &mut walk.scene.environment {
        if texture.is_none() && sky.texture.is_none() {
            sky.radiance += radiance;
        } else {
            walk.warnings.add(name, "a second dome light with a texture is not supported yet and was left out");
        }
        return;
    }
    let axis = (kind == "DomeLight_1").then(|| read::token(prim, "poleAxis", &mut walk.warnings)).flatten();
    let pole_is_z = match axis.as_deref() {
        Some("Z") => true,
        Some("Y") => false,
        _ => kind == "DomeLight_1" && walk.z_up,
    };
    // The dome's own frame has its pole on +Y and the middle of the picture on +Z; with a Z pole that middle lies on -Y.
    let dome_from_sky = if pole_is_z { DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y) } else { DMat3::IDENTITY };
    let world_from_sky = rotation(DMat3::from_mat4(state.world)) * dome_from_sky.as_mat3();
    walk.scene.environment = Some(Environment { name, radiance, texture, world_from_sky });
}

fn dome_texture(prim: &Prim, textures: &mut Textures, w: &mut Reading) -> Option<usize> {
    let Some(Value::AssetPath(file)) = read::value(prim, "inputs:texture:file", w) else { return None };
    if file.is_empty() {
        return None;
    }
    let format = read::token(prim, "inputs:texture:format", w).unwrap_or_default();
    if !matches!(format.as_str(), "" | "automatic" | "latlong") {
        w.add(prim.path(), format!("a dome texture of the format {format} is not supported yet; the dome is plain"));
        return None;
    }
    textures.load(prim, &file, ColorSpace::Auto, w)
}

/// The rotation nearest to `m`'s axes; scale and mirroring mean nothing for a sky.
fn rotation(m: DMat3) -> Mat3 {
    let y = m.y_axis.normalize_or(DVec3::Y);
    let z = (m.z_axis - y * m.z_axis.dot(y)).normalize_or(y.any_orthonormal_vector());
    DMat3::from_cols(y.cross(z), y, z).as_mat3()
}

/// Names what this light has and a bake does not follow.
fn report_unsupported(prim: &Prim, kind: &str, w: &mut Reading) {
    let path = prim.path();
    if kind == "RectLight"
        && let Some(Value::AssetPath(file)) = read::value(prim, "inputs:texture:file", w)
        && !file.is_empty()
    {
        w.add(format!("{path}: {file}"), "a rect light's texture is not supported yet; the light is plain");
    }
    let has_targets = |name: &str| prim.relationship(name).has_authored_targets().unwrap_or(false);
    if has_targets("light:filters") {
        w.add(path, "light filters are not supported yet; the light shines unfiltered");
    }
    if has_targets("portals") {
        w.add(path, "portals are not supported yet; the dome shines everywhere");
    }
    for link in ["lightLink", "shadowLink"] {
        let collection = |field: &str| format!("collection:{link}:{field}");
        let restricted = has_targets(&collection("excludes"))
            || has_targets(&collection("includes"))
            || read::is_authored(prim, &collection("membershipExpression"))
            || read::boolean(prim, &collection("includeRoot"), w) == Some(false);
        if restricted {
            w.add(path, format!("{link} collections are not supported yet; the light is linked to everything"));
        }
    }
    if read::boolean(prim, "inputs:shadow:enable", w) == Some(false) {
        w.add(path, "a light without shadows casts them all the same");
    }
    let inputs = prim.authored_property_names().unwrap_or_default();
    for name in inputs.iter().filter(|name| name.starts_with("inputs:")) {
        if prim.attribute(name.as_str()).has_authored_connections().unwrap_or(false) {
            w.add(
                prim.attribute(name.as_str()).path(),
                "a light's connected input is not supported; its value is used",
            );
        }
    }
    if kind == "DistantLight" && prim.has_api_schema("ShapingAPI").unwrap_or(false) {
        w.add(path, "shaping means nothing to a distant light and was left out");
    }
}
