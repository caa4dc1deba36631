//! Materials: the diffuse albedo, emission, opacity and transmission of metallic-roughness, specular-glossiness and
//! unlit materials; `extension` tables what is done with each extension.
//!
//! Albedo = base colour factor x texture (x vertex colour, later). A metal has no diffuse part, but it does send light
//! on; its base colour stands in as a diffuse albedo, which keeps the energy and the tint, and is said.

use super::appearance::Look;
use super::contribution;
use super::document::Document;
use super::mesh::{default_material, uv_name};
use super::texture::{Images, read_picture, wrap};
use super::transmission::Transmission;
use crate::color::Rgb;
use crate::error::{Result, Warnings};
use crate::load::image::ColorSpace;
use crate::scene::{Alpha, Contribution, Material, Mesh, Texture, TextureSlot};
use ::gltf::json;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::Info;
use ::gltf::json::validation::Checked;
use glam::{Affine2, Vec2, Vec4};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// What a material of the document says, before its images are read.
struct Source {
    index: usize,
    material: json::Material,
    /// Base or diffuse colour, linear RGBA.
    color: Vec4,
    color_texture: Option<Info>,
    transmission: Option<Transmission>,
    contribution: Contribution,
    look: Option<Look>,
}

/// The scene's materials, one for each of the document and, where a mesh needs it, the default one at the end; the
/// textures that they use; and the files that were read. Materials that no mesh uses stay at their default.
/// `appearance`: what is not diffuse is read too.
pub(super) fn materials(
    document: &Document,
    meshes: &[Mesh],
    appearance: bool,
    warnings: &mut Warnings,
) -> Result<(Vec<Material>, Vec<Texture>, Vec<PathBuf>)> {
    let used: BTreeSet<u32> = meshes.iter().flat_map(|m| m.triangle_material.iter().copied()).collect();
    let default = default_material(document);
    let mut sources = Vec::new();
    for index in used.iter().map(|&m| m as usize).filter(|&m| m < default) {
        let mut source = Source::read(document, index, warnings)?;
        if appearance {
            source.look = source.read_look(document, warnings)?;
        }
        sources.push(source);
    }
    let infos = sources.iter().flat_map(|s| s.color_texture.iter().chain(s.emission_texture()));
    let infos = infos
        .map(|info| (info, ColorSpace::Srgb))
        .chain(sources.iter().flat_map(|s| s.look.iter().flat_map(Look::infos)));
    let mut images = Images::read(document, infos.map(|(info, space)| (info.index.value(), space)));

    let mut materials = vec![Material::default(); default];
    for source in &sources {
        let material = source.convert(document, &mut images, warnings);
        warn_missing_uvs(document, source.index, &material, meshes, warnings);
        if let Some(place) = materials.get_mut(source.index) {
            *place = material;
        }
    }
    if used.iter().any(|&m| m as usize == default) {
        // The specification's default: white. Its metallic factor of 1 is an accident of defaults, not a mirror.
        materials.push(Material { name: "default".to_owned(), albedo: Rgb::ONE, ..Material::default() });
    }
    Ok((materials, images.textures, images.files))
}

impl Source {
    fn read(document: &Document, index: usize, warnings: &mut Warnings) -> Result<Self> {
        let material: json::Material = document.item("materials", index)?;
        let place = document.place("materials", index);
        let pbr = &material.pbr_metallic_roughness;
        let others = material.extensions.as_ref().map(|e| &e.others);
        let specular_glossiness = others.and_then(|o| o.get("KHR_materials_pbrSpecularGlossiness"));
        let (color, color_texture) = match specular_glossiness {
            Some(extension) => {
                let factor = extension.get("diffuseFactor");
                let color = factor.map(|f| document.parse(f, "materials", index)).transpose()?.unwrap_or([1.0; 4]);
                let texture = extension.get("diffuseTexture");
                (color, texture.map(|t| document.parse(t, "materials", index)).transpose()?)
            }
            None => (pbr.base_color_factor.0, pbr.base_color_texture.clone()),
        };
        let unlit = material.extensions.as_ref().is_some_and(|e| e.unlit.is_some());
        if unlit {
            let message = "the material is unlit; its base colour was baked as a diffuse albedo";
            warnings.add(&place, message);
        } else if specular_glossiness.is_none() && pbr.metallic_factor.0 > 0.0 {
            warnings.add(
                &place,
                if pbr.metallic_roughness_texture.is_some() {
                    "the metallic texture is not read; all of the base colour was baked as a diffuse albedo"
                } else {
                    "metallic reflection is not diffuse; the base colour was baked as a diffuse albedo in its stead"
                },
            );
        }
        let color = Vec4::from_array(color);
        let within = color.clamp(Vec4::ZERO, Vec4::ONE);
        if color != within {
            warnings.add(&place, "colour factors must lie in 0..1; they were clamped");
        }
        let metallic = if unlit || specular_glossiness.is_some() { 0.0 } else { pbr.metallic_factor.0 };
        let transmission = Transmission::read(document, index, metallic)?;
        let json = document.json.get("materials").and_then(|materials| materials.get(index));
        let contribution = contribution::opinion(json, || document.place("materials", index))?;
        Ok(Self { index, material, color: within, color_texture, transmission, contribution, look: None })
    }

    fn read_look(&self, document: &Document, warnings: &mut Warnings) -> Result<Option<Look>> {
        let color = (self.color.truncate(), self.color_texture.as_ref());
        Look::read(document, self.index, &self.material, color, warnings)
    }

    /// The emission's texture, where it has an effect.
    fn emission_texture(&self) -> Option<&Info> {
        self.material.emissive_texture.as_ref().filter(|_| self.material.emissive_factor.0.iter().any(|&v| v > 0.0))
    }

    fn convert(&self, document: &Document, images: &mut Images, warnings: &mut Warnings) -> Material {
        let source = &self.material;
        let place = document.place("materials", self.index);
        let mut slot = |info: &Info, space| slot(document, images, (info, space), &place, warnings);
        let albedo_texture = self.color_texture.as_ref().and_then(|info| slot(info, ColorSpace::Srgb));
        let emission_texture = self.emission_texture().and_then(|info| slot(info, ColorSpace::Srgb));
        let appearance = self.look.as_ref().map(|look| look.finish(slot));
        let strength = source.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
        let mut emission = (Rgb::from_array(source.emissive_factor.0) * strength).max(Rgb::ZERO);
        if !emission.is_finite() {
            warnings.add(&place, "the emission is not finite and was left out");
            emission = Rgb::ZERO;
        }
        let opacity = self.color.w;
        let alpha = match source.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => {
                Alpha::Mask { cutoff: source.alpha_cutoff.unwrap_or_default().0, opacity }
            }
            Checked::Valid(AlphaMode::Blend) => Alpha::Blend { opacity },
            Checked::Valid(AlphaMode::Opaque) | Checked::Invalid => Alpha::Opaque,
        };
        let mut material = Material {
            name: source.name.clone().unwrap_or_else(|| format!("material_{}", self.index)),
            albedo: self.color.truncate(),
            albedo_texture,
            emission,
            emission_texture,
            double_sided: source.double_sided,
            alpha,
            contribution: self.contribution.clone(),
            appearance,
            ..Material::default()
        };
        if let Some(transmission) = &self.transmission {
            let pictures = transmission.pictures(|info, space| {
                let picture = read_picture(document, info.index.value(), space, &place, &mut images.files, warnings)?;
                Some((picture, placement(document, info, 0, &place, warnings)))
            });
            transmission.apply(&pictures, &mut material, &mut images.textures, &place, warnings);
        }
        material
    }
}

/// A texture's use, where its image could be read.
fn slot(
    document: &Document,
    images: &Images,
    (info, space): (&Info, ColorSpace),
    place: &str,
    warnings: &mut Warnings,
) -> Option<TextureSlot> {
    let index = images.of(document, (info.index.value(), space), place, warnings)?;
    Some(placement(document, info, index, place, warnings))
}

/// Where texture `index` of the scene lies on meshes.
fn placement(document: &Document, info: &Info, index: usize, place: &str, warnings: &mut Warnings) -> TextureSlot {
    let texture = info.index.value();
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    let set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
    let mut slot = TextureSlot::new(index, uv_name(set));
    slot.wrap = wrap(document, texture);
    if let Some(t) = transform {
        // Counter-clockwise as seen, with v down: the angle is reversed.
        let (scale, offset) = (Vec2::from_array(t.scale.0), Vec2::from_array(t.offset.0));
        let image_from_uv = Affine2::from_scale_angle_translation(scale, -t.rotation.0, offset);
        if image_from_uv.is_finite() {
            slot.image_from_uv = image_from_uv;
        } else {
            warnings.add(place, "the texture transform is not finite and was left out");
        }
    }
    slot
}

/// Names materials whose textures can't be placed on a mesh that uses them.
fn warn_missing_uvs(document: &Document, index: usize, material: &Material, meshes: &[Mesh], warnings: &mut Warnings) {
    let slots = [&material.albedo_texture, &material.emission_texture, &material.transmission_texture];
    let beyond = material.appearance.iter().flat_map(|look| look.slots());
    for slot in slots.into_iter().flatten().chain(beyond) {
        for mesh in meshes.iter().filter(|m| m.uv_set(&slot.uv_set).is_none()) {
            if mesh.triangle_material.iter().any(|&m| m as usize == index) {
                let place = format!("{} on {}", document.place("materials", index), mesh.name);
                warnings.add(place, format!("the mesh has no {}, by which a texture is placed", slot.uv_set));
            }
        }
    }
}
