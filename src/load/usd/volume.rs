//! Participating media: UsdVol's Volume prims with the field `density`.
//!
//! A `field:density` relationship leads to an OpenVDBAsset, whose `filePath` and `fieldName` name a grid (.vdb; also .npz and .npy,
//! which fill the volume's box). Without a field the volume is homogeneous: its box is its `extent`, or the unit cube around its
//! origin.
//!
//! What the medium does is said by attributes of the Volume, else by the bound material's volume shader (inputs `scattering`,
//! `absorption`, `anisotropy`, `emission`, per unit of the stage, as MaterialX' `anisotropic_vdf` has them); else all of its density
//! [1/m] scatters, with a warning:
//!
//! | attribute | |
//! |---|---|
//! | `lumel:medium:scattering`, `:absorption`, `:extinction`, `:albedo`, `:emission` | `float` or `color3f`, [1/m], [nit/m] |
//! | `lumel:medium:density`, `:g` | `float` |
//! | `lumel:medium:shape` | `token`: `box`, `ellipsoid` or `scene` |
//!
//! [`crate::load::medium`] says what they mean. Limits: other fields, velocity and temperature among them; volumes below point
//! instancers.

use super::binding;
use super::network::{self, Origin};
use super::package_file;
use super::read::{self, Reading};
use super::walk::{State, Walk};
use crate::load::medium::{Channels, MediumKind, MediumRequest};
use crate::load::volume::{self, Volume};
use crate::scene::MediumShape;
use glam::{DAffine3, DMat3, DVec3};
use openusd::sdf::Value;
use openusd::usd::Prim;
use std::sync::Arc;

/// What the attributes begin with.
const PREFIX: &str = "lumel:medium:";

/// The outputs of materials that lead to a volume shader, and the inputs that lead on from MaterialX' `volume`.
const OUTPUTS: [&str; 2] = ["outputs:volume", "outputs:mtlx:volume"];
const VDF: &str = "inputs:vdf";

/// True for the fields of volumes, which the volume reads itself.
pub fn is_field(kind: &str) -> bool {
    matches!(kind, "OpenVDBAsset" | "Field3DAsset")
}

/// Makes a medium of the Volume `prim`.
pub fn read_volume(walk: &mut Walk, prim: &Prim, state: &State) {
    let place = prim.path().as_str().to_owned();
    let Some(volume) = field(walk, prim) else { return };
    let request = match attributes(prim, &mut walk.warnings) {
        Some(request) => request,
        None => material(walk, prim, state).unwrap_or_else(|| {
            let message =
                "a volume without coefficients scatters all of its density [1/m]; give lumel:medium:scattering";
            walk.warnings.add(&place, message);
            MediumRequest { density: Some(1.0), ..MediumRequest::default() }
        }),
    };
    let local_from_unit = volume.as_ref().and_then(|(volume, _)| volume.file_from_unit);
    let local_from_unit = local_from_unit.unwrap_or_else(|| extent(prim, &mut walk.warnings));
    // A field may be moved within its volume.
    let local_from_field = volume.as_ref().map_or(DAffine3::IDENTITY, |(_, placed)| *placed);
    let world_from_unit = (DAffine3::from_mat4(state.world) * local_from_field * local_from_unit).as_affine3a();
    let shape = match request.shape {
        None | Some(MediumKind::Box) => MediumShape::Box { world_from_unit },
        Some(MediumKind::Ellipsoid) => MediumShape::Ellipsoid { world_from_unit },
        Some(MediumKind::Scene) => MediumShape::Scene,
    };
    match request.medium(&place, shape) {
        Ok(mut medium) => {
            medium.grid = volume.map(|(volume, _)| Arc::new(volume.grid));
            walk.scene.media.push(medium);
        }
        Err(fault) => walk.warnings.add(&place, format!("a medium was left out: {fault}")),
    }
}

/// The grid of the volume's density and where its field lies in the volume; `Some(None)` where it has no such field, `None`, with a
/// warning, where that can't be read.
fn field(walk: &mut Walk, prim: &Prim) -> Option<Option<(Volume, DAffine3)>> {
    let names = prim.authored_property_names().unwrap_or_default();
    let fields: Vec<&str> = names.iter().filter_map(|n| n.as_str().strip_prefix("field:")).collect();
    if fields.is_empty() {
        return Some(None);
    }
    let w = &mut walk.warnings;
    for other in fields.iter().filter(|name| **name != "density") {
        w.add(prim.path(), format!("of a volume's fields density alone is read; {other} was left out"));
    }
    let targets = prim.relationship("field:density").targets().unwrap_or_default();
    let asset = targets.first().and_then(|target| walk.stage.prim(target.clone()).ok());
    let Some(asset) = asset.filter(|asset| asset.is_valid().unwrap_or(false)) else {
        w.add_missing(prim.path(), "a volume without the field density was left out");
        return None;
    };
    let Some(Value::AssetPath(file)) = read::value(&asset, "filePath", w) else {
        w.add_missing(asset.path(), "a field without a filePath; its volume was left out");
        return None;
    };
    let Some(resolved) = file.resolved_path() else {
        let place = format!("{}: {}", asset.path(), file.asset_path());
        w.add_missing(place, "a field's file was not found; its volume was left out");
        return None;
    };
    let name = read::token(&asset, "fieldName", w).filter(|name| !name.is_empty());
    let placed = super::xform::local_xform(&asset, w).parent_from_local;
    let textures = walk.materials.textures();
    let found = textures.resolver.read(resolved).map_err(|e| e.to_string());
    match found.and_then(|bytes| volume::read(resolved, &bytes, name.as_deref()).map_err(|e| e.to_string())) {
        Ok(volume) => {
            textures.files.push(package_file(resolved));
            Some(Some((volume, DAffine3::from_mat4(placed))))
        }
        Err(fault) => {
            let place = format!("{}: {fault}", asset.path());
            walk.warnings.add_missing(place, "a field's file could not be read; its volume was left out");
            None
        }
    }
}

/// The box of a volume that no file gives one.
fn extent(prim: &Prim, w: &mut Reading) -> DAffine3 {
    let authored = read::value(prim, "extent", w).and_then(read::to_vec3s);
    let [low, high] = match authored.as_deref() {
        Some([low, high]) => [low.as_dvec3(), high.as_dvec3()],
        _ => [DVec3::splat(-0.5), DVec3::splat(0.5)],
    };
    DAffine3::from_mat3_translation(DMat3::from_diagonal(high - low), low)
}

/// What `lumel:medium:*` says; `None` where nothing of it is there.
fn attributes(prim: &Prim, w: &mut Reading) -> Option<MediumRequest> {
    let names = prim.authored_property_names().unwrap_or_default();
    let ours: Vec<&str> = names.iter().filter_map(|n| n.as_str().strip_prefix(PREFIX)).collect();
    if ours.is_empty() {
        return None;
    }
    let mut request = MediumRequest::default();
    for name in ours {
        let attribute = format!("{PREFIX}{name}");
        let value = read::value(prim, &attribute, w);
        let is_known = match name {
            "density" => set(&mut request.density, value.and_then(read::to_float)),
            "g" => set(&mut request.g, value.and_then(read::to_float)),
            "shape" => set(&mut request.shape, value.and_then(read::to_text).and_then(|kind| shape(&kind))),
            "scattering" => set(&mut request.scattering, value.and_then(channels)),
            "absorption" => set(&mut request.absorption, value.and_then(channels)),
            "extinction" => set(&mut request.extinction, value.and_then(channels)),
            "albedo" => set(&mut request.albedo, value.and_then(channels)),
            "emission" => set(&mut request.emission, value.and_then(channels)),
            _ => {
                let known = "scattering, absorption, extinction, albedo, emission, density, g and shape";
                w.add(format!("{}.{attribute}", prim.path()), format!("is no known attribute; known are {known}"));
                continue;
            }
        };
        if !is_known {
            w.add(format!("{}.{attribute}", prim.path()), "has no value of its type and was ignored");
        }
    }
    Some(request)
}

/// What the volume shader of the bound material says.
fn material(walk: &mut Walk, prim: &Prim, state: &State) -> Option<MediumRequest> {
    let bound = binding::bound_material(&walk.stage, prim.path(), &state.bindings, &mut walk.collections)?;
    let material = walk.stage.prim(bound).ok()?;
    let per_metre = (1.0 / walk.metres_per_unit) as f32;
    let w = &mut walk.warnings;
    let mut shader = OUTPUTS.iter().find_map(|output| match network::trace(&material.attribute(*output), w) {
        Origin::Shader { shader, .. } => Some(shader),
        Origin::Value(_) => None,
    })?;
    if let Origin::Shader { shader: vdf, .. } = network::trace(&shader.attribute(VDF), w) {
        shader = vdf;
    }
    let mut input = |name: &str| network::input(&shader, name, w);
    let mut scaled = |name: &str| {
        input(name).and_then(channels).map(|c| match c {
            Channels::Grey(v) => Channels::Grey(v * per_metre),
            Channels::Rgb(v) => Channels::Rgb(v.map(|v| v * per_metre)),
        })
    };
    let (scattering, absorption, emission) = (scaled("scattering"), scaled("absorption"), scaled("emission"));
    let g = input("anisotropy").and_then(read::to_float);
    scattering.or(absorption).or(emission)?;
    Some(MediumRequest { scattering, absorption, emission, g, ..MediumRequest::default() })
}

/// Puts a value that is there into its slot; true where it is.
fn set<T>(slot: &mut Option<T>, value: Option<T>) -> bool {
    *slot = value;
    slot.is_some()
}

fn channels(value: Value) -> Option<Channels> {
    read::to_float(value.clone()).map(Channels::Grey).or_else(|| read::to_vec3(value).map(|v| Channels::Rgb(v.into())))
}

fn shape(kind: &str) -> Option<MediumKind> {
    Some(match kind {
        "box" => MediumKind::Box,
        "ellipsoid" => MediumKind::Ellipsoid,
        "scene" => MediumKind::Scene,
        _ => return None,
    })
}
