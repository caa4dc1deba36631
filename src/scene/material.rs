//! Diffuse materials: what radiosity needs of a glTF or UsdPreviewSurface material.

use super::texture::Wrap;
use crate::color::Rgb;
use glam::{Affine2, Vec4};

/// A diffuse surface with emission.
#[derive(Clone, Debug)]
pub struct Material {
    pub name: String,
    /// Diffuse albedo factor, 0..=1; multiplied by the texture and vertex colours where there are any.
    pub albedo: Rgb,
    pub albedo_texture: Option<TextureSlot>,
    /// Emitted radiance factor [nit]; multiplied by the texture where there is one.
    pub emission: Rgb,
    pub emission_texture: Option<TextureSlot>,
    /// Share of the light that passes straight through, as through a thin pane, 0..=1: black lets nothing through (the
    /// default), white all. Multiplied by the texture where there is one. What passes isn't in the albedo any more: the two
    /// add up to 1 at most.
    pub transmission: Rgb,
    pub transmission_texture: Option<TextureSlot>,
    /// Reflects and emits on both sides; else the back is black and blocks light.
    pub double_sided: bool,
    /// Alpha of the albedo, and what it means.
    pub alpha: Alpha,
    /// Its alpha takes the place of the albedo texture's.
    pub opacity_texture: Option<TextureSlot>,
}

/// What a material's opacity does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    Opaque,
    /// Holes where opacity is below the cutoff.
    Mask {
        cutoff: f32,
        opacity: f32,
    },
    /// Blended by opacity.
    Blend {
        opacity: f32,
    },
}

/// A use of a texture by a material: which UVs, and how they and the values are transformed.
#[derive(Clone, Debug)]
pub struct TextureSlot {
    /// Index into `Scene::textures`.
    pub texture: usize,
    /// Name of the [`super::UvSet`] on the mesh.
    pub uv_set: String,
    /// Image coordinates (0..1, v down) from the mesh's.
    pub image_from_uv: Affine2,
    pub wrap: [Wrap; 2],
    /// Value = texel * scale + bias (UsdUVTexture), RGBA.
    pub scale: Vec4,
    pub bias: Vec4,
}

impl TextureSlot {
    /// A texture over `uv_set`, repeated, as it is.
    pub fn new(texture: usize, uv_set: impl Into<String>) -> Self {
        Self {
            texture,
            uv_set: uv_set.into(),
            image_from_uv: Affine2::IDENTITY,
            wrap: [Wrap::Repeat; 2],
            scale: Vec4::ONE,
            bias: Vec4::ZERO,
        }
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            albedo: Rgb::splat(0.5),
            albedo_texture: None,
            emission: Rgb::ZERO,
            emission_texture: None,
            double_sided: false,
            alpha: Alpha::Opaque,
            opacity_texture: None,
            transmission: Rgb::ZERO,
            transmission_texture: None,
        }
    }
}

impl Material {
    /// The textures in use.
    pub fn slots(&self) -> impl Iterator<Item = &TextureSlot> {
        [&self.albedo_texture, &self.emission_texture, &self.opacity_texture, &self.transmission_texture]
            .into_iter()
            .flatten()
    }

    /// True where the material can shine.
    pub fn is_emissive(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}
