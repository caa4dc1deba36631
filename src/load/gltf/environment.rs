//! EXT_lights_image_based: the sky of the scene, from a cube map or from spherical harmonics.
//!
//! The sharpest of the prefiltered cube maps is taken as radiance [nit], times the light's intensity, and resampled to a
//! latlong picture. Texels are sRGB; those of PNGs with alpha are RGBD, colour over alpha. Faces are those of OpenGL's cube
//! maps, flipped about their vertical axis as the extension asks: each looks as it does from inside. Where the faces can't
//! be read, the irradiance coefficients give a smooth sky: L_lm = E_lm / A_l, with A = pi, 2 pi / 3, pi / 4 (Ramamoorthi
//! and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001), below zero cut off.

use super::contribution;
use super::document::Document;
use super::texture::read_image;
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::load::image::ColorSpace;
use crate::scene::{Environment, Texels, Texture, Wrap};
use glam::{Mat3, Quat, Vec2, Vec3, Vec4};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;
use std::f32::consts::PI;

const EXTENSION: &str = "EXT_lights_image_based";
/// Least and most texels down a latlong picture: a coarse one would blur the edges of even a coarse cube.
const HEIGHTS: [u32; 2] = [64, 2048];
/// Texels down the picture of a sky that is given by coefficients.
const SMOOTH_HEIGHT: u32 = 64;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Source {
    #[serde(default)]
    name: Option<String>,
    #[serde(default = "no_rotation")]
    rotation: [f32; 4],
    #[serde(default = "one")]
    intensity: f32,
    #[serde(default)]
    irradiance_coefficients: Vec<[f32; 3]>,
    #[serde(default)]
    specular_images: Vec<[usize; 6]>,
}

fn no_rotation() -> [f32; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

fn one() -> f32 {
    1.0
}

/// The sky of the default scene, its picture added to `textures`; `None` where it has none, or, with a warning, where it
/// can't be read.
///
/// # Errors
/// `Invalid` where the scene names a light that isn't there, or it is malformed.
pub(super) fn read(
    document: &mut Document,
    textures: &mut Vec<Texture>,
    warnings: &mut Warnings,
) -> Result<Option<Environment>> {
    let scene = document.json.get("scene").and_then(Value::as_u64).and_then(|s| usize::try_from(s).ok()).unwrap_or(0);
    let extension =
        document.json.get("scenes").and_then(|s| s.get(scene)?.get("extensions")?.get(EXTENSION)?.get("light"));
    let Some(index) = extension.and_then(Value::as_u64).and_then(|i| usize::try_from(i).ok()) else { return Ok(None) };
    let light = document.json.get("extensions").and_then(|e| e.get(EXTENSION)?.get("lights")?.get(index));
    let light = light.ok_or_else(|| {
        let message = format!("names light {index} of {EXTENSION}, which isn't there; export the file again");
        Error::invalid(document.place("scenes", scene), message)
    })?;
    let source: Source = document.parse(light, "scenes", scene)?;
    let contribution = contribution::opinion(Some(light), || document.place("scenes", scene))?;
    let name = source.name.clone().unwrap_or_else(|| EXTENSION.to_owned());
    let place = format!("{}: {name}", document.file());
    if !(source.intensity.is_finite() && source.intensity > 0.0) {
        warnings.add(place, "the sky has no positive, finite intensity and was left out");
        return Ok(None);
    }
    let picture = match source.specular_images.first().map(|faces| Cube::read(document, faces)) {
        Some(Ok(cube)) => Some(cube.to_latlong(&name)),
        Some(Err(e)) => {
            warnings.add_missing(e, "the sky's cube map can't be read; its irradiance coefficients were used");
            smooth(&source.irradiance_coefficients, &name)
        }
        None => smooth(&source.irradiance_coefficients, &name),
    };
    let Some(picture) = picture else {
        warnings.add_missing(place, "the sky has neither images nor coefficients that can be read and was left out");
        return Ok(None);
    };
    textures.push(picture);
    let rotation = Quat::from_array(source.rotation);
    let usable = rotation.is_finite() && rotation.length_squared() > 0.0;
    Ok(Some(Environment {
        name,
        radiance: Rgb::splat(source.intensity),
        texture: Some(textures.len() - 1),
        world_from_sky: if usable { Mat3::from_quat(rotation.normalize()) } else { Mat3::IDENTITY },
        contribution,
        others: Vec::new(),
    }))
}

/// A latlong picture `width = 2 height` of what `radiance` gives for a direction of the sky's frame.
fn latlong(name: &str, height: u32, radiance: impl Fn(Vec3) -> Rgb + Sync) -> Texture {
    let width = 2 * height;
    let frame = Environment::constant("", Rgb::ONE);
    let texel = |i: u32| {
        let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        let color = radiance(frame.direction(at / Vec2::new(width as f32, height as f32)));
        color.extend(1.0).to_array()
    };
    let texels = (0..width * height).into_par_iter().map(texel).collect();
    Texture { name: name.to_owned(), width, height, texels: Texels::Float(texels) }
}

/// The sky whose irradiance has `coefficients` (bands 0 to 2, each from -l to l); `None` where there aren't nine.
fn smooth(coefficients: &[[f32; 3]], name: &str) -> Option<Texture> {
    let coefficients: [Vec3; 9] =
        coefficients.iter().map(|c| Vec3::from_array(*c)).collect::<Vec<_>>().try_into().ok()?;
    if !coefficients.iter().all(|c| c.is_finite()) {
        return None;
    }
    let radiance = |d: Vec3| {
        let basis = [
            0.282_095,
            0.488_603 * d.y,
            0.488_603 * d.z,
            0.488_603 * d.x,
            1.092_548 * d.x * d.y,
            1.092_548 * d.y * d.z,
            0.315_392 * (3.0 * d.z * d.z - 1.0),
            1.092_548 * d.x * d.z,
            0.546_274 * (d.x * d.x - d.y * d.y),
        ];
        let per_band = |i: usize| match i {
            0 => PI,
            1..4 => 2.0 * PI / 3.0,
            _ => PI / 4.0,
        };
        let sum: Vec3 = (0..9).map(|i| coefficients[i] * (basis[i] / per_band(i))).sum();
        sum.max(Rgb::ZERO)
    };
    Some(latlong(name, SMOOTH_HEIGHT, radiance))
}

/// A cube map: +X, -X, +Y, -Y, +Z, -Z.
struct Cube {
    faces: [Texture; 6],
}

impl Cube {
    /// Reads its images.
    fn read(document: &mut Document, images: &[usize; 6]) -> Result<Self> {
        let mut faces = Vec::new();
        for &image in images {
            let (texture, file) = read_image(document, image, ColorSpace::Srgb)?;
            document.inputs.extend(file);
            faces.push(texture);
        }
        let faces = faces.try_into().map_err(|_| Error::invalid(document.file(), "the sky has no six faces"))?;
        Ok(Self { faces })
    }

    /// A texel's radiance: alpha divides (RGBD), and is 1 in ordinary pictures.
    fn decode(texel: Vec4) -> Rgb {
        if texel.w > 0.0 { texel.truncate() / texel.w } else { Rgb::ZERO }
    }

    /// Radiance from direction `d` (unit).
    fn radiance(&self, d: Vec3) -> Rgb {
        let a = d.abs();
        let (face, major, s, t) = if a.x >= a.y && a.x >= a.z {
            if d.x > 0.0 { (0, a.x, d.z, -d.y) } else { (1, a.x, -d.z, -d.y) }
        } else if a.y >= a.z {
            if d.y > 0.0 { (2, a.y, -d.x, d.z) } else { (3, a.y, -d.x, -d.z) }
        } else if d.z > 0.0 {
            (4, a.z, -d.x, -d.y)
        } else {
            (5, a.z, d.x, -d.y)
        };
        let uv = (Vec2::new(s, t) / major + 1.0) / 2.0;
        Self::decode(self.faces[face].sample(uv, [Wrap::Clamp; 2]))
    }

    /// A latlong picture with about as many texels around the horizon as four faces have.
    fn to_latlong(&self, name: &str) -> Texture {
        let side = self.faces.iter().map(|f| f.width).max().unwrap_or(1);
        latlong(name, (2 * side).clamp(HEIGHTS[0], HEIGHTS[1]), |d| self.radiance(d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The direction that texel (s, t) of a face shows from inside; written down from the extension's picture, not from
    /// [`Cube::radiance`].
    fn direction(face: usize, s: f32, t: f32) -> Vec3 {
        // Looking along each axis: what is right, and what is down.
        let (forward, right, down) = [
            (Vec3::X, Vec3::Z, Vec3::NEG_Y),
            (Vec3::NEG_X, Vec3::NEG_Z, Vec3::NEG_Y),
            (Vec3::Y, Vec3::NEG_X, Vec3::Z),
            (Vec3::NEG_Y, Vec3::NEG_X, Vec3::NEG_Z),
            (Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y),
            (Vec3::NEG_Z, Vec3::X, Vec3::NEG_Y),
        ][face];
        (forward + right * (2.0 * s - 1.0) + down * (2.0 * t - 1.0)).normalize()
    }

    fn face(of: impl Fn(f32, f32) -> Rgb) -> Texture {
        let side = 32;
        let texels = (0..side * side).map(|i| {
            let at = |k: u32| (k as f32 + 0.5) / side as f32;
            of(at(i % side), at(i / side)).extend(1.0).to_array()
        });
        Texture { name: String::new(), width: side, height: side, texels: Texels::Float(texels.collect()) }
    }

    #[test]
    fn a_cube_map_shows_the_sky_it_was_taken_of() {
        let sky = |d: Vec3| Rgb::new(1.0 + d.x, 1.0 + d.y, 1.0 + d.z);
        let cube = Cube { faces: std::array::from_fn(|f| face(|s, t| sky(direction(f, s, t)))) };
        let picture = cube.to_latlong("");
        let frame = Environment::constant("", Rgb::ONE);
        for (x, y) in (0..picture.width).step_by(5).flat_map(|x| (0..picture.height).step_by(3).map(move |y| (x, y))) {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / Vec2::new(picture.width as f32, picture.height as f32);
            let (got, expected) = (picture.texel(x, y).truncate(), sky(frame.direction(at)));
            assert!((got - expected).abs().max_element() < 0.05, "{x} {y}: {got} is not {expected}");
        }
    }

    #[test]
    fn coefficients_of_irradiance_give_back_the_radiance() {
        // L = 2 + y: E = 2 pi + 2 pi / 3 y.
        let mut coefficients = [[0.0; 3]; 9];
        coefficients[0] = [2.0 * PI / 0.282_095; 3];
        coefficients[1] = [2.0 * PI / 3.0 / 0.488_603; 3];
        let picture = smooth(&coefficients, "").unwrap();
        for y in 0..picture.height {
            let up = ((y as f32 + 0.5) / picture.height as f32 * PI).cos();
            let got = picture.texel(7, y).x;
            assert!((got - (2.0 + up)).abs() < 1e-4, "{got} at {up}");
        }
        assert!(smooth(&coefficients[..8], "").is_none());
    }
}
