//! Lights with their units and power.

use super::{LightInfo, PictureInfo, ProfileInfo};
use crate::color::{Rgb, luminance};
use crate::scene::{Light, LightShape, Linked, Picture, Scene};
use glam::{Affine3A, DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// What is known of a light without tracing a ray.
pub(super) fn light_info(scene: &Scene, light: &Light) -> LightInfo {
    let area_light = |area: f64, radiance: &Rgb| {
        let power = PI * area * f64::from(luminance(*radiance));
        (*radiance, "nit", Some(area), Some(power))
    };
    let (kind, (value, unit, area, power)) = match &light.shape {
        LightShape::Point { intensity, .. } => {
            ("point", (*intensity, "cd", None, Some(2.0 * TAU * f64::from(luminance(*intensity)))))
        }
        LightShape::Spot { intensity, inner, outer, .. } => {
            // Full inside; outside it the square of a ramp linear in the cosine, whose mean is a third.
            let (inner, outer) = (f64::from(*inner).cos(), f64::from(*outer).cos());
            let solid_angle = TAU * ((1.0 - inner) + (inner - outer) / 3.0);
            ("spot", (*intensity, "cd", None, Some(solid_angle * f64::from(luminance(*intensity)))))
        }
        LightShape::Directional { illuminance, .. } => ("directional", (*illuminance, "lx", None, None)),
        LightShape::Rect { u, v, radiance, .. } => ("rect", area_light(4.0 * parallelogram(*u, *v), radiance)),
        LightShape::Disk { u, v, radiance, .. } => ("disk", area_light(PI * parallelogram(*u, *v), radiance)),
        LightShape::Sphere { world_from_unit, radiance } => {
            ("sphere", area_light(sphere_area(world_from_unit), radiance))
        }
        LightShape::Portal { u, v, sky, .. } => {
            ("portal", (sky.radiance, "nit", Some(4.0 * parallelogram(*u, *v)), None))
        }
        LightShape::Cylinder { world_from_unit, radiance } => {
            ("cylinder", area_light(cylinder_area(world_from_unit), radiance))
        }
    };
    let share = if light.is_plain() { 1.0 } else { mean_factor(scene, light) };
    let surfaces = scene.surfaces.len();
    let some = |linked: &Linked| (*linked != Linked::All).then(|| linked.count(surfaces));
    LightInfo {
        name: light.name.clone(),
        kind,
        value: value.to_array(),
        unit,
        area,
        power: power.map(|p| p * share),
        shaped: light.shaping.is_some(),
        profile: light.profile.as_ref().map(|p| ProfileInfo {
            name: p.web.name.clone(),
            power: p.web.power(),
            rated_lumens: p.web.rated_lumens,
        }),
        picture: light.picture.as_ref().and_then(|picture| picture_info(scene, picture)),
        lights_surfaces: some(&light.links.lit),
        blocking_surfaces: some(&light.links.blockers),
        bake: light.contribution.mode(),
        group: light.contribution.group.as_deref().map(str::to_owned),
    }
}

fn picture_info(scene: &Scene, picture: &Picture) -> Option<PictureInfo> {
    let (texture, thrown, keystone) = match picture {
        Picture::OnLight(texture) => (*texture, false, false),
        Picture::Thrown(projector) => (projector.texture, true, projector.focus.is_some()),
    };
    let texture = scene.textures.get(texture)?;
    Some(PictureInfo { name: texture.name.clone(), size: [texture.width, texture.height], thrown, keystone })
}

/// The mean of a light's factor (luminance) over where it shines to and from, by a quadrature: what remains of its power.
fn mean_factor(scene: &Scene, light: &Light) -> f64 {
    const STEPS: u32 = 256;
    let (place, cone) = match &light.shape {
        // Of a flat light by the cosine, of a spot by its own cone.
        LightShape::Rect { center, u, v, .. } | LightShape::Disk { center, u, v, .. } => ((*center, *u, *v), true),
        _ => ((light.position().unwrap_or(Vec3::ZERO), Vec3::ZERO, Vec3::ZERO), false),
    };
    let spot = match &light.shape {
        LightShape::Spot { inner, outer, .. } => Some((inner.cos(), outer.cos())),
        _ => None,
    };
    let (mut sum, mut weights) = (0.0, 0.0);
    for i in 0..STEPS {
        for j in 0..STEPS {
            let (s, t) = ((i as f32 + 0.5) / STEPS as f32, (j as f32 + 0.5) / STEPS as f32);
            // Over the sphere of directions about -Z; over the area in another order, so that both are covered evenly.
            let z = if cone { -s.sqrt() } else { 2.0 * s - 1.0 };
            let (sin, cos) = (std::f32::consts::TAU * t).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            let k = i * STEPS + j;
            let (a, b) = ((k as f32 * 0.754_877_7).fract(), (k as f32 * 0.569_840_3).fract());
            let at = place.0 + place.1 * (2.0 * a - 1.0) + place.2 * (2.0 * b - 1.0);
            let weight =
                spot.map_or(1.0, |(inner, outer)| ((-z - outer) / (inner - outer).max(1e-3)).clamp(0.0, 1.0).powi(2));
            let direction = light.world_from_light * Vec3::new(r * cos, r * sin, z);
            if weight > 0.0 {
                sum += f64::from(weight * luminance(light.factor(scene, at, direction)));
            }
            weights += f64::from(weight);
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// |u x v|.
fn parallelogram(u: Vec3, v: Vec3) -> f64 {
    u.as_dvec3().cross(v.as_dvec3()).length()
}

fn linear_part(m: &Affine3A) -> DMat3 {
    let columns = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
    let [x, y, z] = columns.map(|c| Vec3::from(c).as_dvec3());
    DMat3::from_cols(x, y, z)
}

/// Area of the unit sphere under a linear map M: the integral of |cof(M) n| over its normals, by the midpoint rule (within
/// 1e-4 for half axes up to 4 : 1).
fn sphere_area(world_from_unit: &Affine3A) -> f64 {
    let m = linear_part(world_from_unit);
    // cof(M) n as cross products of M's columns: right for a flat ellipsoid, too, which has no inverse.
    let (xy, yz, zx) = (m.x_axis.cross(m.y_axis), m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis));
    let (rows, columns) = (256, 256);
    let mut sum = 0.0;
    for i in 0..rows {
        let z = -1.0 + (f64::from(i) + 0.5) * 2.0 / f64::from(rows);
        let r = (1.0 - z * z).sqrt();
        for j in 0..columns {
            let (sin, cos) = ((f64::from(j) + 0.5) * TAU / f64::from(columns)).sin_cos();
            let n = DVec3::new(r * cos, r * sin, z);
            sum += (yz * n.x + zx * n.y + xy * n.z).length();
        }
    }
    sum * 2.0 * TAU / f64::from(rows * columns)
}

/// Area of the side of the cylinder of radius 1 along X, -1..1, under a linear map.
fn cylinder_area(world_from_unit: &Affine3A) -> f64 {
    let m = linear_part(world_from_unit);
    let steps = 1024;
    let side: f64 = (0..steps)
        .map(|j| {
            let (sin, cos) = ((f64::from(j) + 0.5) * TAU / f64::from(steps)).sin_cos();
            m.x_axis.cross(m.z_axis * cos - m.y_axis * sin).length()
        })
        .sum();
    2.0 * side * TAU / f64::from(steps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    #[test]
    fn curved_lights_have_their_closed_form_areas() {
        let turned = Quat::from_rotation_z(0.3) * Quat::from_rotation_x(1.1);
        let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), turned, Vec3::ONE);
        assert!((sphere_area(&ball) / (16.0 * PI) - 1.0).abs() < 1e-6);
        // A spheroid of half axes 1, 1, 2: 2 pi (1 + 2 / e asin e), e = sqrt(3) / 2.
        let long = Affine3A::from_scale_rotation_translation(Vec3::new(1.0, 1.0, 2.0), turned, Vec3::ZERO);
        let e = 0.75f64.sqrt();
        assert!((sphere_area(&long) / (TAU * (1.0 + 2.0 / e * e.asin())) - 1.0).abs() < 1e-4);
        let tube = Affine3A::from_scale_rotation_translation(Vec3::new(1.5, 0.5, 0.5), turned, Vec3::ZERO);
        assert!((cylinder_area(&tube) / (TAU * 0.5 * 3.0) - 1.0).abs() < 1e-6);
    }
}
