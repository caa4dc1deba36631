//! Looks beyond the diffuse: what metallic-roughness and specular-glossiness materials and their extensions say of
//! mirrors, glass and coats, read where [`crate::load::LoadOptions::appearance`] asks for it.
//!
//! | source | what is made of it |
//! |---|---|
//! | pbrMetallicRoughness | base colour, metallic (B), roughness (G) |
//! | KHR_materials_pbrSpecularGlossiness | reflectance head-on = specular, roughness = 1 - glossiness |
//! | KHR_materials_ior | index of refraction; 0 as the extension has it: the specular colour is the reflectance head-on |
//! | KHR_materials_specular | weight (A) and colour of the dielectric's mirror; clear parts keep Fresnel's equations |
//! | KHR_materials_transmission | share that is clear (R), thin unless there is a volume |
//! | KHR_materials_volume | a solid where thicknessFactor > 0; absorption = -ln(attenuationColor) / attenuationDistance |
//! | KHR_materials_clearcoat | share (R) and roughness (G) of the coat; its normal texture isn't read |
//! | KHR_materials_unlit | matte |
//! | `extras.lumel.lobes` | a measured reflection, see [`Lobes`] |
//!
//! ```json
//! "extras": { "lumel": { "lobes": { "diffuse": [0.2, 0.2, 0.2], "lobes": [
//!     { "x": [-1, -1, -1], "y": [-1, -1, -1], "z": [0.9, 0.9, 0.9], "exponent": [20, 20, 20] } ] } } }
//! ```

use super::document::Document;
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::load::image::ColorSpace;
use crate::scene::{Appearance, Channel, ChannelSlot, Dielectric, Lobe, Lobes, TextureSlot, Walls};
use ::gltf::json;
use ::gltf::json::texture::Info;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// What a material says, before its images are read: factors are in the appearance, and the textures that multiply them
/// here.
pub(super) struct Look {
    factors: Appearance,
    base_color: Option<Info>,
    metallic_roughness: Option<Info>,
    /// Specular colour, and glossiness in A.
    specular_glossiness: Option<Info>,
    specular: Option<Info>,
    specular_color: Option<Info>,
    transmission: Option<Info>,
    clearcoat: Option<Info>,
    clearcoat_roughness: Option<Info>,
}

/// The extensions of one material.
struct Extensions<'a> {
    document: &'a Document,
    index: usize,
    all: Option<&'a Value>,
}

impl Extensions<'_> {
    fn has(&self, name: &str) -> bool {
        self.all.is_some_and(|all| all.get(name).is_some())
    }

    /// The value `key` of the extension `name`, where it is there.
    fn get<T: DeserializeOwned>(&self, name: &str, key: &str) -> Result<Option<T>> {
        let value = self.all.and_then(|all| all.get(name)?.get(key));
        value.map(|v| self.document.parse(v, "materials", self.index)).transpose()
    }

    fn number(&self, name: &str, key: &str, default: f32) -> Result<f32> {
        Ok(self.get(name, key)?.unwrap_or(default))
    }

    fn color(&self, name: &str, key: &str) -> Result<Rgb> {
        Ok(Rgb::from_array(self.get(name, key)?.unwrap_or([1.0; 3])))
    }
}

impl Look {
    /// Reads material `index`, whose base or diffuse colour is `base_color` and its texture; `None` where it is matte.
    ///
    /// # Errors
    /// `Invalid` where an extension or the lobes are malformed.
    pub fn read(
        document: &Document,
        index: usize,
        material: &json::Material,
        (base_color, texture): (Rgb, Option<&Info>),
        warnings: &mut Warnings,
    ) -> Result<Option<Self>> {
        let json = document.json.get("materials").and_then(|m| m.get(index));
        let extensions = Extensions { document, index, all: json.and_then(|m| m.get("extensions")) };
        let measured = lobes(document, index, json)?;
        if extensions.has("KHR_materials_unlit") && measured.is_none() {
            return Ok(None);
        }
        let factors = Appearance { base_color, measured, ..Appearance::default() };
        let mut look = Self {
            factors,
            base_color: texture.cloned(),
            metallic_roughness: None,
            specular_glossiness: None,
            specular: None,
            specular_color: None,
            transmission: None,
            clearcoat: None,
            clearcoat_roughness: None,
        };
        look.read_mirror(&extensions, material)?;
        look.read_clear(&extensions)?;
        look.read_coat(&extensions)?;
        let place = document.place("materials", index);
        if look.factors.transmission > 0.0 && extensions.has("KHR_materials_specular") {
            warnings.add(&place, "KHR_materials_specular doesn't reach what is clear; it reflects by its index alone");
        }
        look.factors.bound().into_iter().for_each(|fault| warnings.add(&place, fault));
        let mut whole = look.factors.clone();
        if look.metallic_roughness.is_some() || look.specular_glossiness.is_some() {
            // Whatever the picture says, it isn't rough everywhere on purpose.
            whole.roughness = whole.roughness.min(0.5);
        }
        Ok((!whole.is_matte()).then_some(look))
    }

    /// Metal, roughness and the dielectric's mirror.
    fn read_mirror(&mut self, extensions: &Extensions, material: &json::Material) -> Result<()> {
        const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";
        const SPECULAR: &str = "KHR_materials_specular";
        let factors = &mut self.factors;
        if extensions.has(GLOSSINESS) {
            factors.roughness = 1.0 - extensions.number(GLOSSINESS, "glossinessFactor", 1.0)?;
            let color = extensions.color(GLOSSINESS, "specularFactor")?;
            factors.dielectric = Dielectric { ior: 0.0, color, ..Dielectric::default() };
            self.specular_glossiness = extensions.get(GLOSSINESS, "specularGlossinessTexture")?;
            return Ok(());
        }
        let pbr = &material.pbr_metallic_roughness;
        (factors.metallic, factors.roughness) = (pbr.metallic_factor.0, pbr.roughness_factor.0);
        self.metallic_roughness = pbr.metallic_roughness_texture.clone();
        factors.dielectric = Dielectric {
            ior: extensions.number("KHR_materials_ior", "ior", 1.5)?,
            specular: extensions.number(SPECULAR, "specularFactor", 1.0)?,
            color: extensions.color(SPECULAR, "specularColorFactor")?,
            ..Dielectric::default()
        };
        self.specular = extensions.get(SPECULAR, "specularTexture")?;
        self.specular_color = extensions.get(SPECULAR, "specularColorTexture")?;
        Ok(())
    }

    fn read_clear(&mut self, extensions: &Extensions) -> Result<()> {
        const TRANSMISSION: &str = "KHR_materials_transmission";
        const VOLUME: &str = "KHR_materials_volume";
        self.factors.transmission = extensions.number(TRANSMISSION, "transmissionFactor", 0.0)?;
        self.transmission = extensions.get(TRANSMISSION, "transmissionTexture")?;
        if extensions.number(VOLUME, "thicknessFactor", 0.0)? > 0.0 {
            let distance = extensions.number(VOLUME, "attenuationDistance", f32::INFINITY)?;
            let color = extensions.color(VOLUME, "attenuationColor")?;
            self.factors.walls = Walls::Solid { absorption: absorption(color, distance) };
        }
        Ok(())
    }

    fn read_coat(&mut self, extensions: &Extensions) -> Result<()> {
        const CLEARCOAT: &str = "KHR_materials_clearcoat";
        self.factors.clearcoat = extensions.number(CLEARCOAT, "clearcoatFactor", 0.0)?;
        self.factors.clearcoat_roughness = extensions.number(CLEARCOAT, "clearcoatRoughnessFactor", 0.0)?;
        self.clearcoat = extensions.get(CLEARCOAT, "clearcoatTexture")?;
        self.clearcoat_roughness = extensions.get(CLEARCOAT, "clearcoatRoughnessTexture")?;
        Ok(())
    }

    /// The textures that are read, and what their numbers mean.
    pub fn infos(&self) -> impl Iterator<Item = (&Info, ColorSpace)> {
        let colors = [&self.base_color, &self.specular_glossiness, &self.specular_color];
        let numbers =
            [&self.metallic_roughness, &self.specular, &self.transmission, &self.clearcoat, &self.clearcoat_roughness];
        let colors = colors.into_iter().flatten().map(|info| (info, ColorSpace::Srgb));
        colors.chain(numbers.into_iter().flatten().map(|info| (info, ColorSpace::Linear)))
    }

    /// The appearance, with each texture where `slot` finds it.
    pub fn finish(&self, mut slot: impl FnMut(&Info, ColorSpace) -> Option<TextureSlot>) -> Appearance {
        let mut look = self.factors.clone();
        let mut color = |info: &Option<Info>| info.as_ref().and_then(|info| slot(info, ColorSpace::Srgb));
        look.base_color_texture = color(&self.base_color);
        look.dielectric.color_texture = color(&self.specular_color);
        if let Some(picture) = color(&self.specular_glossiness) {
            // Roughness = 1 - glossiness, of which the factor is in the roughness already.
            let mut gloss = picture.clone();
            (gloss.scale.w, gloss.bias.w) = (look.roughness - 1.0, 1.0);
            look.roughness = 1.0;
            look.roughness_texture = Some(ChannelSlot { slot: gloss, channel: Channel::A });
            look.dielectric.color_texture = Some(picture);
        }
        let mut number = |info: &Option<Info>, channel: Channel| {
            let slot = info.as_ref().and_then(|info| slot(info, ColorSpace::Linear))?;
            Some(ChannelSlot { slot, channel })
        };
        if let Some(found) = number(&self.metallic_roughness, Channel::B) {
            look.roughness_texture = Some(ChannelSlot { slot: found.slot.clone(), channel: Channel::G });
            look.metallic_texture = Some(found);
        }
        look.dielectric.specular_texture = number(&self.specular, Channel::A);
        look.transmission_texture = number(&self.transmission, Channel::R);
        look.clearcoat_texture = number(&self.clearcoat, Channel::R);
        look.clearcoat_roughness_texture = number(&self.clearcoat_roughness, Channel::G);
        look
    }
}

/// Absorption [1/m] of a volume that leaves `color` after `distance` [m] (KHR_materials_volume); black counts as a
/// millionth.
fn absorption(color: Rgb, distance: f32) -> Rgb {
    let left = color.clamp(Rgb::splat(1e-6), Rgb::ONE);
    let absorption = -Rgb::new(left.x.ln(), left.y.ln(), left.z.ln()) / distance;
    if distance > 0.0 && absorption.is_finite() { absorption.max(Rgb::ZERO) } else { Rgb::ZERO }
}

/// The lobes in the extras of a material.
fn lobes(document: &Document, index: usize, json: Option<&Value>) -> Result<Option<Lobes>> {
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Source {
        #[serde(default)]
        diffuse: [f32; 3],
        #[serde(default)]
        lobes: Vec<SourceLobe>,
    }
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct SourceLobe {
        x: [f32; 3],
        y: [f32; 3],
        z: [f32; 3],
        exponent: [f32; 3],
    }
    let Some(value) = json.and_then(|m| m.get("extras")?.get("lumel")?.get("lobes")) else { return Ok(None) };
    let source: Source = document.parse(value, "materials", index)?;
    let lobe = |l: SourceLobe| Lobe { x: l.x.into(), y: l.y.into(), z: l.z.into(), exponent: l.exponent.into() };
    let lobes = Lobes { diffuse: source.diffuse.into(), lobes: source.lobes.into_iter().map(lobe).collect() };
    match lobes.fault() {
        Some(fault) => Err(Error::invalid(document.place("materials", index), format!("extras.lumel.lobes: {fault}"))),
        None => Ok(Some(lobes)),
    }
}
