//! UsdLux lights; the photometry is in [`crate::load::units`].
//!
//! What needs the surfaces or other prims (links, projectors' targets, portals) is kept until the whole stage was walked.

use super::dome::{self, Domes};
use super::link;
use super::network::{self, Origin};
use super::read::{self, Reading};
use super::shaping;
use super::walk::{State, Walk};
use crate::color::Rgb;
use crate::load::projector::ProjectorRequest;
use crate::load::units;
use crate::scene::{Light, LightShape, Scene};
use glam::{Affine3A, DMat3, DMat4, DVec3, Mat3};
use openusd::sdf::Value;
use openusd::usd::Prim;
use std::f64::consts::PI;

/// What lights wait for until the stage was walked.
#[derive(Default)]
pub struct Pending {
    /// Lights that not all surfaces know.
    pub linked: Vec<(usize, Prim)>,
    pub projectors: Vec<(ProjectorRequest, Option<String>)>,
    pub domes: Domes,
}

impl Pending {
    /// Finishes the lights of `scene`, whose surfaces have the prim paths `surfaces`.
    pub fn settle(self, scene: &mut Scene, surfaces: &[String], reading: &mut Reading) {
        self.domes.settle(scene, &mut reading.warnings);
        for (light, prim) in self.linked {
            scene.lights[light].links = link::links(&prim, surfaces, reading);
        }
        for (mut request, target) in self.projectors {
            if let Some(name) = target {
                request.target = shaping::surfaces_below(name, surfaces);
            }
            request.apply(scene, &mut reading.warnings);
        }
    }
}

/// The value of the input `name` of a light, wherever it is connected to.
pub fn input(prim: &Prim, name: &str, w: &mut Reading) -> Option<Value> {
    let attribute = prim.attribute(name);
    if !attribute.has_authored_connections().unwrap_or(false) {
        return read::attribute_value(&attribute, w);
    }
    match network::trace(&attribute, w) {
        Origin::Value(Some(value)) => Some(value),
        Origin::Value(None) => read::attribute_value(&attribute, w),
        Origin::Shader { shader, output } => {
            let message = "a light's input is fed by a shader, which is not supported; its own value is used";
            w.add(format!("{}: {}.outputs:{output}", attribute.path(), shader.path()), message);
            read::attribute_value(&attribute, w)
        }
    }
}

pub fn float(prim: &Prim, name: &str, w: &mut Reading) -> Option<f32> {
    input(prim, name, w).and_then(read::to_float)
}

pub fn boolean(prim: &Prim, name: &str, w: &mut Reading) -> Option<bool> {
    input(prim, name, w).and_then(read::to_bool)
}

pub fn rgb(prim: &Prim, name: &str, w: &mut Reading) -> Option<Rgb> {
    input(prim, name, w).and_then(read::to_vec3)
}

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
    match kind {
        "GeometryLight" => {
            let message = "GeometryLight prims are deprecated and were left out; use MeshLightAPI on the geometry";
            walk.warnings.add(name, message);
            return;
        }
        "PluginLight" => {
            walk.warnings.add(name, "PluginLight prims shine as a renderer's plugin says, and were left out");
            return;
        }
        "PortalLight" => {
            dome::read_portal(walk, prim, state);
            return;
        }
        _ => {}
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
        dome::read_dome(walk, prim, kind, state, luminance);
        return;
    }
    let placed = Placed {
        world: state.world,
        metres_per_unit: walk.metres_per_unit,
        normalize: boolean(prim, "inputs:normalize", &mut walk.warnings).unwrap_or(false),
        luminance,
    };
    let shape = shape(prim, kind, &placed, &mut walk.warnings);
    let mut light = Light {
        world_from_light: axes(&placed.linear()),
        contribution: state.contribution.clone(),
        ..Light::new(name, shape)
    };
    let number = walk.scene.lights.len();
    if kind != "DistantLight" {
        light.shaping = shaping::shaping(prim, state.world, &mut walk.warnings);
        light.profile = shaping::profile(walk, prim, &light);
        light.picture = shaping::picture(walk, prim, kind);
    }
    if let Some(request) = shaping::projector(walk, prim, number, state) {
        walk.pending.projectors.push(request);
    }
    if link::is_restricted(prim, &mut walk.warnings) {
        walk.pending.linked.push((number, prim.clone()));
    }
    walk.scene.lights.push(light);
}

/// The light's axes in the world, orthonormal: -Z first, then +Y; mirrored where the transform mirrors.
pub fn axes(linear: &DMat3) -> Mat3 {
    let z = linear.z_axis.normalize_or(DVec3::Z);
    let y = (linear.y_axis - z * linear.y_axis.dot(z)).normalize_or(z.any_orthonormal_vector());
    let x = y.cross(z) * if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(x, y, z).as_mat3()
}

/// `intensity * 2^exposure * color * temperature` [nit]. The `diffuse` multiplier counts too: a lightmap is diffuse light.
pub fn luminance(prim: &Prim, w: &mut Reading) -> Rgb {
    let mut value = |name: &str, default: f32| float(prim, name, w).unwrap_or(default);
    let scalar = value("inputs:intensity", 1.0)
        * units::exposure_scale(value("inputs:exposure", 0.0))
        * value("inputs:diffuse", 1.0);
    let kelvin = value("inputs:colorTemperature", 6500.0);
    let color = rgb(prim, "inputs:color", w).unwrap_or(Rgb::ONE);
    let tinted = boolean(prim, "inputs:enableColorTemperature", w).unwrap_or(false);
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
    let mut length = |name: &str, default: f32| f64::from(float(prim, name, w).unwrap_or(default).max(0.0));
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
            let angle = float(prim, "inputs:angle", w).unwrap_or(0.53).clamp(0.0, 360.0);
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
pub fn facing(linear: &DMat3, u: DVec3, v: DVec3) -> (DVec3, DVec3) {
    if linear.determinant() < 0.0 { (-u, v) } else { (u, v) }
}

fn affine(linear: DMat3, world: DMat4) -> Affine3A {
    Affine3A::from_mat3_translation(linear.as_mat3(), world.w_axis.truncate().as_vec3())
}

/// Names what this light has and a bake does not follow.
fn report_unsupported(prim: &Prim, kind: &str, w: &mut Reading) {
    let path = prim.path();
    let has_targets = |name: &str| prim.relationship(name).has_authored_targets().unwrap_or(false);
    if has_targets("light:filters") {
        w.add(path, "light filters are not supported yet; the light shines unfiltered");
    }
    if kind.starts_with("DomeLight") && link::is_restricted(prim, w) {
        w.add(path, "a dome's links are not supported yet; it shines on everything, and everything blocks it");
    }
    let other = |name: &str, default: f32, w: &mut Reading| float(prim, name, w).is_some_and(|v| v != default);
    let has_distance = other("inputs:shadow:distance", -1.0, w) || other("inputs:shadow:falloff", -1.0, w);
    if has_distance || rgb(prim, "inputs:shadow:color", w).is_some_and(|c| c != Rgb::ZERO) {
        w.add(path, "the colour, distance and falloff of shadows are not followed: they are as dark as they would be");
    }
    if kind == "DistantLight" && prim.has_api_schema("ShapingAPI").unwrap_or(false) {
        w.add(path, "shaping means nothing to a distant light and was left out");
    }
}
