//! What a surface looks like beyond its diffuse stand-in: the glossy half of glTF's and UsdPreviewSurface's materials.
//!
//! Radiosity sees [`super::Material`]'s diffuse fields alone; path tracing reads these as well. A layer of clear coat
//! lies over a mixture of a metal, `metallic`, and a dielectric; the dielectric mirrors on top of what is diffuse or,
//! by `transmission`, clear. Emission, opacity and sides are the material's.
//!
//! A material is *matte*, and has no appearance, where nothing of it is told from a diffuse surface on purpose: unlit,
//! without specular reflection, or a dielectric of roughness 1 without metal, transmission, clear coat, a specular
//! extension, or measured lobes. So a scene that means to be diffuse is diffuse for all methods.

use super::material::TextureSlot;
use crate::color::Rgb;

/// The look of a surface. Factors are multiplied by their textures where there are any.
#[derive(Clone, Debug)]
pub struct Appearance {
    /// Base colour, 0..=1: albedo of what is diffuse, reflectance of a metal seen head-on, tint of what passes. As the
    /// source says: not reduced by metal or transmission. Vertex colours multiply it.
    pub base_color: Rgb,
    pub base_color_texture: Option<TextureSlot>,
    /// Share of the surface that is a metal, 0..=1.
    pub metallic: f32,
    pub metallic_texture: Option<ChannelSlot>,
    /// Perceptual roughness, 0..=1: its square is the width of the GGX distribution.
    pub roughness: f32,
    pub roughness_texture: Option<ChannelSlot>,
    pub dielectric: Dielectric,
    /// Share of the dielectric that is clear instead of diffuse, 0..=1.
    pub transmission: f32,
    pub transmission_texture: Option<ChannelSlot>,
    /// What lies behind a clear surface.
    pub walls: Walls,
    /// Share of the surface that a clear coat of index 1.5 covers, 0..=1.
    pub clearcoat: f32,
    pub clearcoat_texture: Option<ChannelSlot>,
    /// Perceptual roughness of the coat, 0..=1.
    pub clearcoat_roughness: f32,
    pub clearcoat_roughness_texture: Option<ChannelSlot>,
    /// A measured reflection in place of all of the above.
    pub measured: Option<Lobes>,
}

/// How a dielectric mirrors: `specular * lerp(f0, 1, t)`, where f0 is the index's reflectance head-on times `color`,
/// and t rises from 0 head-on to 1 at grazing angles as Fresnel's equations have it (KHR_materials_specular, with the
/// exact curve).
#[derive(Clone, Debug)]
pub struct Dielectric {
    /// Index of refraction, 1..=[`Dielectric::MOST_IOR`]; 0: the colour itself is the reflectance head-on, as of
    /// specular workflows, and t is Schlick's (1 - cos)^5.
    pub ior: f32,
    /// Weight of the mirror reflection, 0..=1.
    pub specular: f32,
    pub specular_texture: Option<ChannelSlot>,
    /// Factor on f0, at least 0; f0 stays at most 1.
    pub color: Rgb,
    pub color_texture: Option<TextureSlot>,
}

/// What a clear surface bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Walls {
    /// Nothing: it is a thin sheet with air on both sides, and light goes straight on.
    #[default]
    Thin,
    /// A solid that refracts, whose inside, behind its triangles, absorbs `absorption` [1/m].
    Solid { absorption: Rgb },
}

/// One channel of a texture.
#[derive(Clone, Debug)]
pub struct ChannelSlot {
    pub slot: TextureSlot,
    pub channel: Channel,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    R,
    G,
    B,
    A,
}

/// A reflection as a sum of cosine lobes (Lafortune, Foo, Torrance, Greenberg 1997, "Non-Linear Approximation of
/// Reflectance Functions"): `diffuse / pi + sum max(0, x o_x i_x + y o_y i_y + z o_z i_z)^exponent`, by channel, with o
/// and i the unit directions away from the surface and the normal along z. x = y < 0 < z makes a mirror's lobe, x = y >
/// 0 one that shines back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lobes {
    /// Diffuse albedo, 0..=1.
    pub diffuse: Rgb,
    /// At most [`Lobes::MOST`].
    pub lobes: Vec<Lobe>,
}

/// One lobe; every vector holds one number a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    pub x: Rgb,
    pub y: Rgb,
    pub z: Rgb,
    /// 0..=[`Lobes::MOST_EXPONENT`]
    pub exponent: Rgb,
}

impl Lobes {
    /// Lobes of one reflection, at most.
    pub const MOST: usize = 8;
    /// Beyond, a lobe is narrower than numbers tell.
    pub const MOST_EXPONENT: f32 = 1e5;
    /// Bound on the coefficients' sizes.
    pub const MOST_COEFFICIENT: f32 = 10.0;

    /// What is wrong with them, and what to do.
    pub fn fault(&self) -> Option<String> {
        let is_within = |v: Rgb, low: f32, high: f32| v.cmpge(Rgb::splat(low)).all() && v.cmple(Rgb::splat(high)).all();
        if self.lobes.len() > Self::MOST {
            return Some(format!("has {} lobes; at most {} are read", self.lobes.len(), Self::MOST));
        }
        if !is_within(self.diffuse, 0.0, 1.0) {
            return Some("diffuse must lie in 0..1".to_owned());
        }
        let most = Self::MOST_COEFFICIENT;
        let is_sound = |lobe: &Lobe| {
            [lobe.x, lobe.y, lobe.z].into_iter().all(|c| is_within(c, -most, most))
                && is_within(lobe.exponent, 0.0, Self::MOST_EXPONENT)
        };
        let index = self.lobes.iter().position(|lobe| !is_sound(lobe))?;
        let exponent = Self::MOST_EXPONENT;
        Some(format!("lobe {index}: x, y and z must lie in -{most}..{most}, the exponent in 0..{exponent}"))
    }
}

impl Dielectric {
    /// The highest index that is believed: germanium has 4 in the infrared.
    pub const MOST_IOR: f32 = 5.0;

    /// Reflectance head-on from outside, before colour and weight.
    pub fn f0(&self) -> f32 {
        // Squares of the same ratio: index 0 gives 1, as it should.
        let ratio = (self.ior - 1.0) / (self.ior + 1.0);
        ratio * ratio
    }
}

impl Default for Dielectric {
    fn default() -> Self {
        Self { ior: 1.5, specular: 1.0, specular_texture: None, color: Rgb::ONE, color_texture: None }
    }
}

impl Default for Appearance {
    /// A smooth white dielectric of index 1.5.
    fn default() -> Self {
        Self {
            base_color: Rgb::ONE,
            base_color_texture: None,
            metallic: 0.0,
            metallic_texture: None,
            roughness: 0.0,
            roughness_texture: None,
            dielectric: Dielectric::default(),
            transmission: 0.0,
            transmission_texture: None,
            walls: Walls::Thin,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            measured: None,
        }
    }
}

impl Appearance {
    /// Perceptual roughness below which a surface is a perfect mirror: its blur is less than 0.1 degrees.
    pub const SMOOTH: f32 = 0.03;

    /// True where the surface means to be diffuse; see the module. Textures count as what their factor allows.
    pub fn is_matte(&self) -> bool {
        let Dielectric { specular, specular_texture, color, color_texture, ior } = &self.dielectric;
        if self.measured.is_some() || self.metallic > 0.0 || self.transmission > 0.0 || self.clearcoat > 0.0 {
            return false;
        }
        if *specular == 0.0 || *color == Rgb::ZERO && *ior == 0.0 {
            return true;
        }
        let is_rough = self.roughness >= 1.0 && self.roughness_texture.is_none();
        let is_plain = *specular == 1.0 && specular_texture.is_none() && *color == Rgb::ONE && color_texture.is_none();
        is_rough && is_plain && *ior != 0.0
    }

    /// A thin sheet that can be seen through undistorted: a window pane.
    pub fn is_pane(&self) -> bool {
        let is_smooth = self.roughness < Self::SMOOTH;
        self.measured.is_none()
            && self.transmission > 0.0
            && self.metallic < 1.0
            && self.walls == Walls::Thin
            && is_smooth
    }

    /// A mirror or clear glass: all of it sends light on in single directions, wherever it is looked up.
    pub fn is_single(&self) -> bool {
        let is_smooth = self.roughness < Self::SMOOTH;
        let is_coat_smooth = self.clearcoat == 0.0 || self.clearcoat_roughness < Self::SMOOTH;
        let is_metal = self.metallic >= 1.0 && self.metallic_texture.is_none();
        let is_clear = self.transmission >= 1.0 && self.transmission_texture.is_none();
        self.measured.is_none() && is_smooth && is_coat_smooth && (is_metal || is_clear)
    }

    /// May send light on in single directions somewhere, alone or beside others.
    pub fn may_be_single(&self) -> bool {
        let is_smooth = self.roughness < Self::SMOOTH || self.roughness_texture.is_some();
        let is_coat_smooth = self.clearcoat_roughness < Self::SMOOTH || self.clearcoat_roughness_texture.is_some();
        self.measured.is_none() && (is_smooth || self.clearcoat > 0.0 && is_coat_smooth)
    }

    /// Lets light through in a way that a surface's scattering has to tell: rough, refracting, or both.
    pub fn refracts(&self) -> bool {
        self.measured.is_none() && self.transmission > 0.0 && !self.is_pane()
    }

    /// What its inside absorbs [1/m]; `None` where it has no inside.
    pub fn absorption(&self) -> Option<Rgb> {
        match self.walls {
            Walls::Solid { absorption } if self.refracts() => Some(absorption),
            _ => None,
        }
    }

    /// The textures in use.
    pub fn slots(&self) -> impl Iterator<Item = &TextureSlot> {
        let colors = [&self.base_color_texture, &self.dielectric.color_texture].into_iter().flatten();
        let channels = [
            &self.metallic_texture,
            &self.roughness_texture,
            &self.dielectric.specular_texture,
            &self.transmission_texture,
            &self.clearcoat_texture,
            &self.clearcoat_roughness_texture,
        ];
        colors.chain(channels.into_iter().flatten().map(|channel| &channel.slot))
    }

    /// Calls `keep` with each texture in use, in the order of [`slots`](Self::slots), and takes those out for which it
    /// is false.
    pub fn retain_slots(&mut self, mut keep: impl FnMut(&mut TextureSlot) -> bool) {
        for place in [&mut self.base_color_texture, &mut self.dielectric.color_texture] {
            if place.as_mut().is_some_and(|slot| !keep(slot)) {
                *place = None;
            }
        }
        let channels = [
            &mut self.metallic_texture,
            &mut self.roughness_texture,
            &mut self.dielectric.specular_texture,
            &mut self.transmission_texture,
            &mut self.clearcoat_texture,
            &mut self.clearcoat_roughness_texture,
        ];
        for place in channels {
            if place.as_mut().is_some_and(|channel| !keep(&mut channel.slot)) {
                *place = None;
            }
        }
    }

    /// Brings numbers into their ranges; says of each that was not what it is.
    pub fn bound(&mut self) -> Vec<&'static str> {
        let mut faults = Vec::new();
        let mut share = |value: &mut f32, unless: f32, what: &'static str| {
            let within = if value.is_nan() { unless } else { value.clamp(0.0, 1.0) };
            if *value != within {
                faults.push(what);
            }
            *value = within;
        };
        share(&mut self.metallic, 0.0, "metallic must lie in 0..1; it was clamped");
        share(&mut self.roughness, 1.0, "roughness must lie in 0..1; it was clamped");
        share(&mut self.transmission, 0.0, "transmission must lie in 0..1; it was clamped");
        share(&mut self.clearcoat, 0.0, "clearcoat must lie in 0..1; it was clamped");
        share(&mut self.clearcoat_roughness, 0.0, "the clearcoat's roughness must lie in 0..1; it was clamped");
        share(&mut self.dielectric.specular, 1.0, "specular must lie in 0..1; it was clamped");
        let mut color = |value: &mut Rgb, most: f32, what: &'static str| {
            let within = Rgb::from_array(value.to_array().map(|v| if v.is_nan() { 1.0 } else { v.clamp(0.0, most) }));
            if within != *value {
                faults.push(what);
            }
            *value = within;
        };
        color(&mut self.base_color, 1.0, "colour factors must lie in 0..1; they were clamped");
        color(&mut self.dielectric.color, 1e6, "a specular colour must be at least 0; it was clamped");
        if let Walls::Solid { absorption } = &mut self.walls {
            color(absorption, 1e9, "an attenuation must be finite and at least 0; it was clamped");
        }
        let ior = &mut self.dielectric.ior;
        let within = if ior.is_nan() { 1.5 } else { ior.clamp(1.0, Dielectric::MOST_IOR) };
        if *ior != 0.0 && *ior != within {
            faults.push("an index of refraction must be 0 or lie in 1..5; it was clamped");
            *ior = within;
        }
        faults
    }
}
