//! What passes through a material: KHR_materials_transmission, _diffuse_transmission and _volume as a thin, straight pane.
//!
//! With the base colour C, metalness m, transmission t (R of its texture), diffuse transmission d (A) of colour D, and the
//! attenuation a of the volume's thickness:
//!
//! ```text
//! albedo       = C (m + (1 - m) (1 - t) (1 - d))
//! transmission = a (1 - m) (C t + D (1 - t) d)
//! ```
//!
//! Metals count as diffuse here (see `material`), and let nothing through. Fresnel reflection, roughness and refraction are
//! left out: what would be reflected at the surface passes. Where textures of t, d or D lie on the mesh as the base colour's
//! does, both products are composed into textures; else the means of t, d and D stand for them.

use super::document::Document;
use crate::color::{Rgb, srgb_from_linear};
use crate::error::{Result, Warnings};
use crate::load::image::ColorSpace;
use crate::scene::{Material, Texels, Texture, TextureSlot, Wrap};
use ::gltf::json::texture::Info;
use glam::{DVec4, Vec2, Vec4};

/// A picture and where it lies on the mesh.
type Placed = (Texture, TextureSlot);

/// The pictures of t, d and D; white where there is none.
#[derive(Default)]
pub(super) struct Pictures {
    straight: Option<Placed>,
    diffuse: Option<Placed>,
    diffuse_color: Option<Placed>,
}

/// What the extensions of a material say.
pub(super) struct Transmission {
    /// t, 0..=1.
    straight: f32,
    straight_texture: Option<Info>,
    /// d, 0..=1.
    diffuse: f32,
    diffuse_texture: Option<Info>,
    /// D, 0..=1.
    diffuse_color: Rgb,
    diffuse_color_texture: Option<Info>,
    /// a, 0..=1.
    attenuation: Rgb,
    /// 1 - m.
    dielectric: f32,
}

impl Transmission {
    /// Reads the extensions of material `index`; `None` where nothing passes. `metallic`: m.
    ///
    /// # Errors
    /// `Invalid` where one is malformed.
    pub fn read(document: &Document, index: usize, metallic: f32) -> Result<Option<Self>> {
        let material = document.json.get("materials").and_then(|m| m.get(index));
        let extension = |name: &str| material?.get("extensions")?.get(name);
        let number = |name: &str, key: &str, default: f32| -> Result<f32> {
            let value = extension(name).and_then(|e| e.get(key));
            value.map_or(Ok(default), |v| document.parse(v, "materials", index))
        };
        let color = |name: &str, key: &str| -> Result<Rgb> {
            let value = extension(name).and_then(|e| e.get(key));
            let color: [f32; 3] = value.map_or(Ok([1.0; 3]), |v| document.parse(v, "materials", index))?;
            Ok(Rgb::from_array(color).clamp(Rgb::ZERO, Rgb::ONE))
        };
        let texture = |name: &str, key: &str| -> Result<Option<Info>> {
            let value = extension(name).and_then(|e| e.get(key));
            value.map(|v| document.parse(v, "materials", index)).transpose()
        };
        let (thin, diffuse, volume) =
            ("KHR_materials_transmission", "KHR_materials_diffuse_transmission", "KHR_materials_volume");
        let share = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
        let read = Self {
            straight: share(number(thin, "transmissionFactor", 0.0)?),
            straight_texture: texture(thin, "transmissionTexture")?,
            diffuse: share(number(diffuse, "diffuseTransmissionFactor", 0.0)?),
            diffuse_texture: texture(diffuse, "diffuseTransmissionTexture")?,
            diffuse_color: color(diffuse, "diffuseTransmissionColorFactor")?,
            diffuse_color_texture: texture(diffuse, "diffuseTransmissionColorTexture")?,
            attenuation: attenuation(
                color(volume, "attenuationColor")?,
                number(volume, "thicknessFactor", 0.0)?,
                number(volume, "attenuationDistance", f32::INFINITY)?,
            ),
            dielectric: 1.0 - share(metallic),
        };
        let passes = read.dielectric > 0.0 && (read.straight > 0.0 || read.diffuse > 0.0);
        Ok(passes.then_some(read))
    }

    /// The pictures that matter, each found by `find`.
    pub fn pictures(&self, mut find: impl FnMut(&Info, ColorSpace) -> Option<Placed>) -> Pictures {
        let mut picture = |info: &Option<Info>, factor: f32, space| {
            info.as_ref().filter(|_| factor > 0.0).and_then(|info| find(info, space))
        };
        Pictures {
            straight: picture(&self.straight_texture, self.straight, ColorSpace::Linear),
            diffuse: picture(&self.diffuse_texture, self.diffuse, ColorSpace::Linear),
            diffuse_color: picture(&self.diffuse_color_texture, self.diffuse, ColorSpace::Srgb),
        }
    }

    /// Parts what `material` sends back from what passes. `textures` are the scene's and gain what is composed.
    pub fn apply(
        &self,
        pictures: &Pictures,
        material: &mut Material,
        textures: &mut Vec<Texture>,
        place: &str,
        warnings: &mut Warnings,
    ) {
        let base = material.albedo_texture.clone();
        let slots: Vec<&TextureSlot> = base.iter().chain(pictures.all().map(|(_, slot)| slot)).collect();
        // Without a share that varies, the factors can be split, as long as what passes has one texture at most.
        let is_plain =
            pictures.straight.is_none() && pictures.diffuse.is_none() && (self.diffuse == 0.0 || slots.is_empty());
        match slots.first() {
            Some(first) if !is_plain && slots.iter().all(|s| lie_alike(first, s)) => {
                let placement = (*first).clone();
                let base = base.as_ref().and_then(|b| textures.get(b.texture));
                let [albedo, passes] = self.compose(material.albedo, base, pictures);
                textures.extend([albedo, passes]);
                let slot = |back: usize| Some(TextureSlot { texture: textures.len() - back, ..placement.clone() });
                (material.albedo_texture, material.transmission_texture) = (slot(2), slot(1));
                (material.albedo, material.transmission) = (Rgb::ONE, Rgb::ONE);
            }
            _ => {
                if !is_plain {
                    let message =
                        "its textures of what passes lie otherwise than the base colour's; their means were used";
                    warnings.add(place, message);
                }
                let mean = |placed: &Option<Placed>| placed.as_ref().map_or(Vec4::ONE, |(texture, _)| mean(texture));
                let (t, d) = (self.straight * mean(&pictures.straight).x, self.diffuse * mean(&pictures.diffuse).w);
                let color = self.diffuse_color * mean(&pictures.diffuse_color).truncate();
                (material.albedo, material.transmission) = self.split(material.albedo, t, d, color);
                // The base colour's texture tints what passes straight; where more is spread, its own colour prevails.
                if t >= (1.0 - t) * d {
                    material.transmission_texture = base;
                }
            }
        }
    }

    /// The albedo and the transmission of one point.
    fn split(&self, base: Rgb, t: f32, d: f32, diffuse_color: Rgb) -> (Rgb, Rgb) {
        let kept = 1.0 - self.dielectric * (1.0 - (1.0 - t) * (1.0 - d));
        (base * kept, self.attenuation * self.dielectric * (base * t + diffuse_color * (1.0 - t) * d))
    }

    /// Both products as textures of the size of the largest input, factors included.
    fn compose(&self, factor: Rgb, base: Option<&Texture>, pictures: &Pictures) -> [Texture; 2] {
        let all = || base.into_iter().chain(pictures.all().map(|(texture, _)| texture));
        let width = all().map(|t| t.width).max().unwrap_or(1);
        let height = all().map(|t| t.height).max().unwrap_or(1);
        let name = all().next().map_or_else(String::new, |t| t.name.clone());
        let sample =
            |texture: Option<&Texture>, uv: Vec2| texture.map_or(Vec4::ONE, |t| t.sample(uv, [Wrap::Clamp; 2]));
        let at = |placed: &Option<Placed>, uv: Vec2| sample(placed.as_ref().map(|(texture, _)| texture), uv);
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| Vec2::new(x as f32, y as f32) + 0.5));
        let (albedo, passes) = texels
            .map(|center| {
                let uv = center / Vec2::new(width as f32, height as f32);
                let base = sample(base, uv);
                let (t, d) = (self.straight * at(&pictures.straight, uv).x, self.diffuse * at(&pictures.diffuse, uv).w);
                let color = self.diffuse_color * at(&pictures.diffuse_color, uv).truncate();
                let (albedo, passes) = self.split(base.truncate() * factor, t, d, color);
                (encode(albedo, base.w), encode(passes, 1.0))
            })
            .unzip();
        [(albedo, "albedo"), (passes, "transmission")].map(|(texels, what)| Texture {
            name: format!("{name} ({what})"),
            width,
            height,
            texels: Texels::Srgb8(texels),
        })
    }
}

impl Pictures {
    fn all(&self) -> impl Iterator<Item = &Placed> {
        [&self.straight, &self.diffuse, &self.diffuse_color].into_iter().flatten()
    }
}

/// What is left of light after `thickness` of a volume (Beer and Lambert, KHR_materials_volume): `color` after `distance`.
fn attenuation(color: Rgb, thickness: f32, distance: f32) -> Rgb {
    let depth = thickness / distance;
    if depth.is_finite() && depth > 0.0 { color.powf(depth) } else { Rgb::ONE }
}

/// True where two textures lie on a mesh in the same way.
fn lie_alike(a: &TextureSlot, b: &TextureSlot) -> bool {
    a.uv_set == b.uv_set && a.image_from_uv == b.image_from_uv && a.wrap == b.wrap
}

/// The mean texel.
fn mean(texture: &Texture) -> Vec4 {
    let mut sum = DVec4::ZERO;
    for y in 0..texture.height {
        for x in 0..texture.width {
            sum += texture.texel(x, y).as_dvec4();
        }
    }
    (sum / (f64::from(texture.width) * f64::from(texture.height))).as_vec4()
}

/// sRGB bytes of a linear colour.
fn encode(color: Rgb, alpha: f32) -> [u8; 4] {
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let [r, g, b] = color.to_array().map(|v| byte(srgb_from_linear(v.clamp(0.0, 1.0))));
    [r, g, b, byte(alpha)]
}
