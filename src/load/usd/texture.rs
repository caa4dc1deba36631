//! Texture nodes: UsdUVTexture with its UV chain, and the plain image nodes of MaterialX and Arnold.

use super::network::{self, Origin};
use super::read::{self, Reading};
use super::resolver::GuardedResolver;
use super::{package_file, udim};
use crate::color::linear_from_srgb;
use crate::load::access::Access;
use crate::load::image::ColorSpace;
use crate::scene::{Material, Mesh, Texels, Texture, TextureSlot, Wrap};
use glam::{Affine2, Mat2, Vec2, Vec4};
use openusd::sdf::{AssetPath, Value};
use openusd::tf::Token;
use openusd::usd::Prim;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

/// Pictures that were read, each once.
pub struct Textures {
    access: Access,
    /// What reads them, and other files that the stage names.
    pub resolver: GuardedResolver,
    pub textures: Vec<Texture>,
    /// The tiles of a picture in many files (UDIM), column and row from the lower left, by its first tile.
    pub tiles: HashMap<usize, BTreeMap<[u32; 2], usize>>,
    /// Pictures whose alpha is a channel of another's.
    by_channel: HashMap<(usize, usize), usize>,
    /// The files, packages included.
    pub files: Vec<PathBuf>,
    /// Index into `textures` by file and color space, or why it can't be read.
    by_file: HashMap<(String, &'static str), Result<usize, String>>,
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
        for slot in material.slots().chain(material.appearance.iter().flat_map(|look| look.slots())) {
            if mesh.uv_set(&slot.uv_set).is_none() {
                missing.push(format!("has no primvar {}, which its material's texture reads", slot.uv_set));
            }
        }
    }
    missing.dedup();
    missing
}

impl Textures {
    /// None yet, of those that `access` allows.
    pub fn new(access: &Access) -> Self {
        Self {
            access: access.clone(),
            resolver: GuardedResolver::new(access.clone()),
            textures: Vec::new(),
            tiles: HashMap::new(),
            by_channel: HashMap::new(),
            files: Vec::new(),
            by_file: HashMap::new(),
        }
    }

    /// Reads the texture node `shader`; `None` where it is another kind of node.
    pub fn sample(&mut self, shader: &Prim, warnings: &mut Reading) -> Option<Sampled> {
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
        let mut value = |name: &str| network::input(shader, name, warnings);
        let vec4 = |value: Option<Value>| value.and_then(read::to_vec4);
        let (fallback, scale, bias) = match preview {
            true => {
                let [fallback, scale, bias] = ["fallback", "scale", "bias"].map(|name| vec4(value(name)));
                (fallback, scale.unwrap_or(Vec4::ONE), bias.unwrap_or(Vec4::ZERO))
            }
            false => (value("default").and_then(read::to_vec3).map(|v| v.extend(1.0)), Vec4::ONE, Vec4::ZERO),
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
        let texture = file.and_then(|file| match udim::is_tiled(file.asset_path()) {
            true => self.load_tiles(shader, file_input, file.asset_path(), space, warnings),
            false => self.load(shader, &file, space, warnings),
        });
        let Some(texture) = texture else {
            return Some(Sampled::Missing(fallback));
        };
        let (uv_set, mut image_from_uv) = uv_chain(shader, preview, warnings);
        if id.starts_with("ND_tiledimage_") {
            image_from_uv = flipped(tiling(shader, warnings)) * image_from_uv;
        }
        Some(Sampled::Slot(TextureSlot { texture, uv_set, image_from_uv, wrap, scale, bias }))
    }

    /// The index of the picture `file`, read on first use; `None`, with a warning, where that fails.
    pub fn load(&mut self, prim: &Prim, file: &AssetPath, space: ColorSpace, warnings: &mut Reading) -> Option<usize> {
        let name = file.asset_path();
        if name.is_empty() {
            warnings.add(prim.path(), "a texture names no file");
            return None;
        }
        let Some(resolved) = file.resolved_path() else {
            let message = "a texture file was not found; what its input has without it is used";
            warnings.add_missing(format!("{}: {name}", prim.path()), message);
            return None;
        };
        let key = match space {
            ColorSpace::Srgb => "sRGB",
            ColorSpace::Linear => "raw",
            ColorSpace::Auto => "auto",
        };
        let key = (resolved.to_owned(), key);
        if !self.by_file.contains_key(&key) {
            let read = self.decode(resolved, space);
            self.by_file.insert(key.clone(), read);
        }
        match &self.by_file[&key] {
            Ok(index) => Some(*index),
            Err(error) => {
                let message = "a texture could not be read; what its input has without it is used";
                warnings.add_missing(format!("{}: {name}: {error}", prim.path()), message);
                None
            }
        }
    }

    /// Decodes the picture in the file `resolved`: its index, or why that can't be.
    fn decode(&mut self, resolved: &str, space: ColorSpace) -> Result<usize, String> {
        let bytes = self.resolver.read(resolved).map_err(|error| error.to_string())?;
        let decoded = self.access.decode(resolved_name(resolved), &bytes, space);
        let texture = decoded.map_err(|error| error.to_string())?;
        self.files.push(package_file(resolved));
        self.textures.push(Texture { name: resolved.to_owned(), ..texture });
        Ok(self.textures.len() - 1)
    }
}

impl Textures {
    /// Reads all tiles of the picture `name` that are there: the index of the first.
    fn load_tiles(
        &mut self,
        shader: &Prim,
        input: &str,
        name: &str,
        space: ColorSpace,
        warnings: &mut Reading,
    ) -> Option<usize> {
        let files = udim::files(&self.resolver, shader, input, name);
        if files.is_empty() {
            warnings.add_missing(format!("{}: {name}", shader.path()), "no tile of a UDIM texture was found");
        }
        let read = |(tile, file): ([u32; 2], AssetPath)| Some((tile, self.load(shader, &file, space, warnings)?));
        let tiles: BTreeMap<[u32; 2], usize> = files.into_iter().filter_map(read).collect();
        let first = *tiles.values().next()?;
        self.tiles.insert(first, tiles);
        Some(first)
    }

    /// A slot whose alpha is the channel `output` of the picture of `slot`.
    pub fn with_alpha(&mut self, mut slot: TextureSlot, output: &str) -> TextureSlot {
        let channel = match output {
            "a" => return slot,
            "g" => 1,
            "b" => 2,
            _ => 0,
        };
        (slot.scale.w, slot.bias.w) = (slot.scale[channel], slot.bias[channel]);
        if let Some(tiles) = self.tiles.get(&slot.texture).cloned() {
            let tiles: BTreeMap<[u32; 2], usize> =
                tiles.into_iter().map(|(tile, texture)| (tile, self.channel_as_alpha(texture, channel))).collect();
            slot.texture = tiles.values().next().copied().unwrap_or(slot.texture);
            self.tiles.insert(slot.texture, tiles);
        } else {
            slot.texture = self.channel_as_alpha(slot.texture, channel);
        }
        slot
    }

    fn channel_as_alpha(&mut self, texture: usize, channel: usize) -> usize {
        if let Some(&known) = self.by_channel.get(&(texture, channel)) {
            return known;
        }
        let Some(source) = self.textures.get(texture) else { return texture };
        let byte = |v: f32| (v * 255.0).round() as u8;
        let of_byte = |t: &[u8; 4], linear: &dyn Fn(u8) -> u8| [255, 255, 255, linear(t[channel])];
        let texels = match &source.texels {
            Texels::Float(texels) => Texels::Float(texels.iter().map(|t| [1.0, 1.0, 1.0, t[channel]]).collect()),
            Texels::Linear8(texels) => Texels::Linear8(texels.iter().map(|t| of_byte(t, &|v| v)).collect()),
            Texels::Srgb8(texels) => {
                let linear = |v: u8| byte(linear_from_srgb(f32::from(v) / 255.0));
                Texels::Linear8(texels.iter().map(|t| of_byte(t, &linear)).collect())
            }
        };
        let made = Texture { name: source.name.clone(), texels, ..*source };
        self.textures.push(made);
        self.by_channel.insert((texture, channel), self.textures.len() - 1);
        self.textures.len() - 1
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
fn uv_chain(shader: &Prim, preview: bool, warnings: &mut Reading) -> (String, Affine2) {
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

/// MaterialX' tiledimage: UVs times uvtiling, less uvoffset, in tiles of a real size (v up).
fn tiling(node: &Prim, warnings: &mut Reading) -> Affine2 {
    let mut pair = |name: &str, default: Vec2| {
        let found = network::input(node, name, warnings).and_then(read::to_vec2);
        found.filter(|v| v.is_finite()).unwrap_or(default)
    };
    let (tiling, offset) = (pair("uvtiling", Vec2::ONE), pair("uvoffset", Vec2::ZERO));
    let size = pair("realworldtilesize", Vec2::ONE) / pair("realworldimagesize", Vec2::ONE);
    let size = if size.is_finite() { size } else { Vec2::ONE };
    Affine2::from_scale(size) * Affine2::from_translation(-offset) * Affine2::from_scale(tiling)
}

/// UsdTransform2d: scale, then rotation (counter-clockwise, degrees), then translation, v up.
fn transform2d(node: &Prim, warnings: &mut Reading) -> Affine2 {
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
