//! Diffuse materials: what radiosity needs of a glTF or UsdPreviewSurface material.

use super::appearance::Appearance;
use super::contribution::Contribution;
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
    /// What of its emission's light is baked (never dynamic), and its group.
    pub contribution: Contribution,
    /// What it looks like beyond its diffuse stand-in above; `None` where it is matte. Radiosity doesn't read it.
    pub appearance: Option<Appearance>,
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

impl Alpha {
    /// The opacity, 0..=1, where the texture's alpha times the vertex colours' is `alpha`.
    pub fn share(self, alpha: f32) -> f32 {
        match self {
            Self::Opaque => 1.0,
            Self::Mask { cutoff, opacity } => f32::from(u8::from(opacity * alpha >= cutoff)),
            Self::Blend { opacity } => (opacity * alpha).clamp(0.0, 1.0),
        }
    }
}

/// What passes of light, by channel, where a surface of `opacity` lets `transmission` through itself, each 0..=1.
pub fn passing(opacity: f32, transmission: Rgb) -> Rgb {
    Rgb::splat(1.0 - opacity) + transmission.clamp(Rgb::ZERO, Rgb::ONE) * opacity
}

/// The mean over the channels of the shares `passes`: whole shares stay whole.
pub fn mean_share(passes: Rgb) -> f32 {
    if passes == Rgb::splat(passes.x) { passes.x } else { passes.element_sum() / 3.0 }
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
            contribution: Contribution::default(),
            appearance: None,
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

    /// Where the alpha is read from that its factor is multiplied by: nowhere where alpha means nothing.
    pub fn opacity_slot(&self) -> Option<&TextureSlot> {
        let slot = self.opacity_texture.as_ref().or(self.albedo_texture.as_ref());
        slot.filter(|_| self.alpha != Alpha::Opaque)
    }

    /// True where light may pass: holes, blended or thin surfaces.
    pub fn lets_light_through(&self) -> bool {
        self.alpha != Alpha::Opaque || self.transmission.max_element() > 0.0
    }

    /// True where the material can shine.
    pub fn is_emissive(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}
