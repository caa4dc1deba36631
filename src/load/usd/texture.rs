//! Texture nodes: UsdUVTexture with its UV chain, and the plain image nodes of MaterialX and Arnold.

use super::network::{self, Origin};
use super::{package_file, read};
use crate::error::Warnings;
use crate::load::image::{self, ColorSpace};
use crate::scene::{Material, Mesh, Texture, TextureSlot, Wrap};
use glam::{Affine2, Mat2, Vec2, Vec4};
use openusd::ar::{DefaultResolver, ResolvedPath, Resolver};
use openusd::sdf::{AssetPath, Value};
use openusd::tf::Token;
use openusd::usd::Prim;
use std::collections::HashMap;
use std::path::PathBuf;

/// Pictures that were read, each once.
#[derive(Default)]
pub struct Textures {
    pub textures: Vec<Texture>,
    /// The files, packages included.
    pub files: Vec<PathBuf>,
    by_file: HashMap<(String, &'static str), Option<usize>>,
}

/// A texture node on an input: the slot, or the value that stands in for a picture that can't be read.
pub enum Sampled {
    Slot(TextureSlot),
    /// The node's own fallback, where it has one.
    Missing(Option<Vec4>),
}

/// UV sets that the mesh's materials read and the mesh lacks, as messages.
pub fn missing_uv_sets(mesh: &Mesh, materials: &[Material]) -> Vec<String> {
    let mut used: Vec<u32> = mesh.triangle_material.clone();
    used.sort_unstable();
    used.dedup();
    let mut missing = Vec::new();
    for material in used.iter().filter_map(|&m| materials.get(m as usize)) {
        for slot in [&material.albedo_texture, &material.emission_texture].into_iter().flatten() {
            if mesh.uv_set(&slot.uv_set).is_none() {
                missing.push(format!("has no primvar {}, which its material's texture reads", slot.uv_set));
            }
        }
    }
    missing.dedup();
    missing
}

impl Textures {
    /// Reads the texture node `shader`; `None` where it is another kind of node.
    pub fn sample(&mut self, shader: &Prim, output: &str, warnings: &mut Warnings) -> Option<Sampled> {
        let id = network::shader_id(shader, warnings);
        let preview = id == "UsdUVTexture" || id.starts_with("ND_UsdUVTexture");
        let file_input = match id.as_str() {
            _ if preview => "file",
            _ if id.starts_with("ND_image_") || id.starts_with("ND_tiledimage_") || id.starts_with("ND_gltf_") => {
                "file"
            }
            "arnold:image" | "image" => "filename",
            _ => return None,
        };
        if matches!(output, "r" | "g" | "b") {
            warnings.add(shader.path(), "a single channel feeds a colour; the texture's RGB is used");
        }
        let mut value = |name: &str| network::input(shader, name, warnings);
        let mut vec4 = |name: &str| value(name).and_then(read::to_vec4);
        let (fallback, scale, bias) = match preview {
            true => (vec4("fallback"), vec4("scale").unwrap_or(Vec4::ONE), vec4("bias").unwrap_or(Vec4::ZERO)),
            false => (None, Vec4::ONE, Vec4::ZERO),
        };
        let mut text = |name: &str| network::input(shader, name, warnings).and_then(read::to_text);
        let space = match preview {
            true => color_space(text("sourceColorSpace").as_deref()),
            false => {
                let attribute = shader.attribute(format!("inputs:{file_input}"));
                let space = attribute.get_metadata::<Token>("colorSpace").ok().flatten();
                color_space(space.as_ref().map(|t| t.as_str()))
            }
        };
        let wrap_inputs = if preview { ["wrapS", "wrapT"] } else { ["uaddressmode", "vaddressmode"] };
        let wrap = wrap_inputs.map(|name| wrap(text(name).as_deref(), preview));
        let file = match network::trace(&shader.attribute(format!("inputs:{file_input}")), warnings) {
            Origin::Value(Some(Value::AssetPath(file))) => Some(file),
            Origin::Value(Some(Value::String(file))) => Some(AssetPath::new(file)),
            _ => None,
        };
        let Some(texture) = file.and_then(|file| self.load(shader, &file, space, warnings)) else {
            return Some(Sampled::Missing(fallback));
        };
        let (uv_set, image_from_uv) = uv_chain(shader, preview, warnings);
        Some(Sampled::Slot(TextureSlot { texture, uv_set, image_from_uv, wrap, scale, bias }))
    }

    /// The index of the picture `file`, read on first use; `None`, with a warning, where that fails.
    pub fn load(&mut self, prim: &Prim, file: &AssetPath, space: ColorSpace, warnings: &mut Warnings) -> Option<usize> {
        let name = file.asset_path();
        if name.is_empty() {
            warnings.add(prim.path(), "a texture names no file");
            return None;
        }
        if name.contains("<UDIM>") || name.contains("<udim>") {
            warnings.add(format!("{}: {name}", prim.path()), "UDIM textures are not supported yet; no tile was read");
            return None;
        }
        let Some(resolved) = file.resolved_path() else {
            warnings.add(format!("{}: {name}", prim.path()), "a texture file was not found");
            return None;
        };
        let key = match space {
            ColorSpace::Srgb => "sRGB",
            ColorSpace::Linear => "raw",
            ColorSpace::Auto => "auto",
        };
        if let Some(&known) = self.by_file.get(&(resolved.to_owned(), key)) {
            return known;
        }
        let decoded = DefaultResolver::new()
            .open_asset(&ResolvedPath::new(resolved))
            .and_then(|mut asset| asset.read_all())
            .map_err(|error| error.to_string())
            .and_then(|bytes| image::decode(resolved_name(resolved), &bytes, space).map_err(|error| error.to_string()));
        let index = match decoded {
            Ok(mut texture) => {
                texture.name = resolved.to_owned();
                self.files.push(package_file(resolved));
                self.textures.push(texture);
                Some(self.textures.len() - 1)
            }
            Err(error) => {
                warnings.add(format!("{}: {name}", prim.path()), format!("a texture could not be read: {error}"));
                None
            }
        };
        self.by_file.insert((resolved.to_owned(), key), index);
        index
    }
}

/// The picture's own name, its extension last: `b.png` for `a.usdz[b.png]`.
fn resolved_name(resolved: &str) -> &str {
    resolved.rsplit('[').next().unwrap_or(resolved).trim_end_matches(']')
}

fn color_space(name: Option<&str>) -> ColorSpace {
    match name {
        Some("sRGB" | "srgb_texture" | "srgb_rec709_scene") => ColorSpace::Srgb,
        Some("raw" | "Raw" | "lin_rec709" | "lin_rec709_scene" | "linear" | "data") => ColorSpace::Linear,
        _ => ColorSpace::Auto,
    }
}

/// `preview`: UsdUVTexture's default, useMetadata, means black where the file says nothing; MaterialX repeats.
fn wrap(name: Option<&str>, preview: bool) -> Wrap {
    match name {
        Some("repeat" | "periodic") => Wrap::Repeat,
        Some("mirror") => Wrap::Mirror,
        Some("clamp") => Wrap::Clamp,
        Some("black" | "constant") => Wrap::Black,
        _ if preview => Wrap::Black,
        _ => Wrap::Repeat,
    }
}

/// The UV set that the texture node reads, and how it is transformed (v down).
fn uv_chain(shader: &Prim, preview: bool, warnings: &mut Warnings) -> (String, Affine2) {
    let mut image_from_uv = Affine2::IDENTITY;
    let mut at = shader.attribute(if preview { "inputs:st" } else { "inputs:texcoord" });
    // Each transform node stands behind another; more than a few are a circle.
    for _ in 0..16 {
        let Origin::Shader { shader: node, .. } = network::trace(&at, warnings) else { break };
        let id = network::shader_id(&node, warnings);
        if id.contains("UsdTransform2d") {
            image_from_uv *= flipped(transform2d(&node, warnings));
            at = node.attribute("inputs:in");
            continue;
        }
        let name_input = match id.as_str() {
            "ND_geompropvalue_vector2" => "geomprop",
            _ if id.contains("UsdPrimvarReader") => "varname",
            _ if id.starts_with("ND_texcoord") => return ("st".to_owned(), image_from_uv),
            _ => {
                warnings.add(node.path(), format!("the UV node {id} is not supported; the UVs st are used"));
                break;
            }
        };
        let name = network::input(&node, name_input, warnings).and_then(read::to_text).filter(|n| !n.is_empty());
        return (name.unwrap_or_else(|| "st".to_owned()), image_from_uv);
    }
    ("st".to_owned(), image_from_uv)
}

/// UsdTransform2d: scale, then rotation (counter-clockwise, degrees), then translation, v up.
fn transform2d(node: &Prim, warnings: &mut Warnings) -> Affine2 {
    let mut value = |name: &str| network::input(node, name, warnings);
    let scale = value("scale").and_then(read::to_vec2).unwrap_or(Vec2::ONE);
    let rotation = value("rotation").and_then(read::to_float).unwrap_or(0.0);
    let translation = value("translation").and_then(read::to_vec2).unwrap_or(Vec2::ZERO);
    Affine2::from_mat2_translation(Mat2::from_angle(rotation.to_radians()) * Mat2::from_diagonal(scale), translation)
}

/// A map between v-up coordinates as one between v-down ones.
fn flipped(map: Affine2) -> Affine2 {
    let flip = Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(1.0, -1.0)), Vec2::Y);
    flip * map * flip
}
