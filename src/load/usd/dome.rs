//! Dome lights as skies, and the portals that restrict them.
//!
//! A dome with portals is seen through them alone: each is a light of its own, through which the sky shines along its -Z. Domes
//! without portals add up to the scene's sky.

use super::light::{axes, facing, float, input};
use super::read;
use super::walk::{State, Walk};
use crate::color::Rgb;
use crate::error::Warnings;
use crate::load::image::ColorSpace;
use crate::load::sky_layout::SkyLayout;
use crate::scene::{Environment, Light, LightShape, Scene};
use glam::{DMat3, DVec3, Mat3, Vec3};
use openusd::sdf::Value;
use openusd::usd::Prim;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Domes with portals, and the portals, until both are known.
#[derive(Default)]
pub struct Domes {
    domes: Vec<(Environment, Vec<String>)>,
    portals: BTreeMap<String, Portal>,
}

/// A portal in the world: its middle, half edges and axes.
struct Portal {
    center: Vec3,
    u: Vec3,
    v: Vec3,
    axes: Mat3,
}

/// Adds the dome `prim` to the sky, or keeps it for its portals.
pub fn read_dome(walk: &mut Walk, prim: &Prim, kind: &str, state: &State, radiance: Rgb) {
    let name = prim.path().as_str().to_owned();
    let texture = texture(walk, prim);
    let axis = (kind == "DomeLight_1").then(|| read::token(prim, "poleAxis", &mut walk.warnings)).flatten();
    let pole_is_z = match axis.as_deref() {
        Some("Z") => true,
        Some("Y") => false,
        _ => kind == "DomeLight_1" && walk.z_up,
    };
    // The dome's own frame has its pole on +Y and the middle of the picture on +Z; with a Z pole that middle lies on -Y.
    let dome_from_sky = if pole_is_z { DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y) } else { DMat3::IDENTITY };
    let world_from_sky = rotation(DMat3::from_mat4(state.world)) * dome_from_sky.as_mat3();
    let contribution = state.contribution.clone();
    let sky = Environment { texture, world_from_sky, contribution, ..Environment::constant(name, radiance) };
    let portals = prim.relationship("portals").forwarded_targets().unwrap_or_default();
    if !portals.is_empty() {
        let portals = portals.iter().map(|path| path.as_str().to_owned()).collect();
        walk.pending.domes.domes.push((sky, portals));
        return;
    }
    match &mut walk.scene.environment {
        None => walk.scene.environment = Some(sky),
        Some(first) => first.others.push(sky),
    }
}

/// Keeps the portal `prim` for the domes that name it.
pub fn read_portal(walk: &mut Walk, prim: &Prim, state: &State) {
    let w = &mut walk.warnings;
    let linear = DMat3::from_mat4(state.world);
    if !state.world.is_finite() || linear.determinant() == 0.0 {
        w.add(prim.path(), "the transform is not invertible; the portal was left out");
        return;
    }
    let mut half = |name: &str| f64::from(float(prim, name, w).unwrap_or(1.0).max(0.0)) / 2.0;
    let (u, v) = (linear.x_axis * half("inputs:width"), linear.y_axis * half("inputs:height"));
    let (u, v) = facing(&linear, u, v);
    let center = state.world.w_axis.truncate().as_vec3();
    let portal = Portal { center, u: u.as_vec3(), v: v.as_vec3(), axes: axes(&linear) };
    walk.pending.domes.portals.insert(prim.path().as_str().to_owned(), portal);
}

impl Domes {
    /// Makes a light of each portal of each dome.
    pub fn settle(self, scene: &mut Scene, w: &mut Warnings) {
        let mut unused: Vec<&String> = self.portals.keys().collect();
        for (sky, paths) in self.domes {
            let sky = Arc::new(sky);
            for path in &paths {
                let Some(Portal { center, u, v, axes }) = self.portals.get(path) else {
                    w.add(
                        format!("{}: {path}", sky.name),
                        "a dome's portal is no PortalLight of the stage; it stays shut",
                    );
                    continue;
                };
                unused.retain(|other| *other != path);
                let shape = LightShape::Portal { center: *center, u: *u, v: *v, sky: Arc::clone(&sky) };
                let contribution = sky.contribution.clone();
                scene.lights.push(Light { world_from_light: *axes, contribution, ..Light::new(&sky.name, shape) });
            }
        }
        for path in unused {
            w.add(path, "no dome light names this portal; it was left out");
        }
    }
}

/// The dome's picture as latlong.
fn texture(walk: &mut Walk, prim: &Prim) -> Option<usize> {
    let Some(Value::AssetPath(file)) = input(prim, "inputs:texture:file", &mut walk.warnings) else { return None };
    if file.is_empty() {
        return None;
    }
    let format = read::token(prim, "inputs:texture:format", &mut walk.warnings).unwrap_or_default();
    let textures = walk.materials.textures();
    let texture = textures.load(prim, &file, ColorSpace::Auto, &mut walk.warnings)?;
    match format.as_str() {
        "" | "automatic" | "latlong" => Some(texture),
        token => match SkyLayout::from_token(token) {
            Some(layout) => {
                let latlong = layout.latlong(&textures.textures[texture]);
                textures.textures.push(latlong);
                Some(textures.textures.len() - 1)
            }
            None => {
                walk.warnings
                    .add(prim.path(), format!("the dome texture's format {token} is unknown; latlong is taken"));
                Some(texture)
            }
        },
    }
}

/// The rotation nearest to `m`'s axes; scale and mirroring mean nothing for a sky.
fn rotation(m: DMat3) -> Mat3 {
    let y = m.y_axis.normalize_or(DVec3::Y);
    let z = (m.z_axis - y * m.z_axis.dot(y)).normalize_or(y.any_orthonormal_vector());
    DMat3::from_cols(y.cross(z), y, z).as_mat3()
}
