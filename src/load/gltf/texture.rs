//! Images of textures: where their bytes are, and decoding them in parallel.
//!
//! A picture in WebP (EXT_texture_webp) goes before the ordinary one beside it. Basis Universal (KHR_texture_basisu) isn't
//! decoded: the one crate that does, basis-universal, compiles the whole encoder too (a minute more to build) and knows no KTX2; the ordinary picture
//! is used.

use super::document::Document;
use super::uri::{Resource, resolve};
use crate::error::{Error, Result, Warnings};
use crate::load::image::ColorSpace;
use crate::scene::{Texture, Wrap};
use ::gltf::json;
use ::gltf::json::texture::WrappingMode;
use ::gltf::json::validation::Checked;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The decoded images of a document.
pub(super) struct Images {
    /// Index into `textures` by image of the document and whether its numbers are linear, or why it can't be read.
    by_image: BTreeMap<(bool, usize), std::result::Result<usize, String>>,
    pub textures: Vec<Texture>,
    /// Files that were read.
    pub files: Vec<PathBuf>,
}

impl Images {
    /// Decodes the images of `textures` (indices of the document's), each once for each meaning of its numbers.
    pub fn read(document: &Document, textures: impl Iterator<Item = (usize, ColorSpace)>) -> Self {
        let mut images: Vec<(bool, usize)> =
            textures.filter_map(|(t, space)| Some((space == ColorSpace::Linear, image(document, t)?))).collect();
        images.sort_unstable();
        images.dedup();
        let space = |is_linear| if is_linear { ColorSpace::Linear } else { ColorSpace::Srgb };
        let decoded: Vec<_> = images.par_iter().map(|&(l, i)| read_image(document, i, space(l))).collect();
        let mut out = Self { by_image: BTreeMap::new(), textures: Vec::new(), files: Vec::new() };
        for (image, result) in images.into_iter().zip(decoded) {
            let index = result.map(|(texture, file)| {
                out.textures.push(texture);
                out.files.extend(file);
                out.textures.len() - 1
            });
            out.by_image.insert(image, index.map_err(|e| e.to_string()));
        }
        out
    }

    /// The scene's index of texture `texture` of the document; `None`, with a warning that names `user` and the file, where its
    /// image can't be read.
    pub fn of(
        &self,
        document: &Document,
        (texture, space): (usize, ColorSpace),
        user: &str,
        warnings: &mut Warnings,
    ) -> Option<usize> {
        let key = |image| (space == ColorSpace::Linear, image);
        match image(document, texture).and_then(|image| self.by_image.get(&key(image))) {
            Some(Ok(index)) => return Some(*index),
            Some(Err(error)) => warnings.add_missing(format!("{user}: {error}"), UNREADABLE),
            None => warnings.add_missing(user, missing_message(document, texture)),
        }
        None
    }
}

/// What is said of a texture whose image can't be read.
const UNREADABLE: &str = "the texture can't be read; the factor alone was used";

/// The image of a texture; `None` where it has only one of a format that can't be read.
fn image(document: &Document, texture: usize) -> Option<usize> {
    let texture = document.json.get("textures")?.get(texture)?;
    let webp = texture.get("extensions").and_then(|e| e.get("EXT_texture_webp")?.get("source"));
    let source = webp.or_else(|| texture.get("source"))?.as_u64()?;
    usize::try_from(source).ok().filter(|&i| i < document.count("images"))
}

/// What is said of a texture without an image.
fn missing_message(document: &Document, texture: usize) -> &'static str {
    let texture = document.json.get("textures").and_then(|t| t.get(texture));
    let is_basis = texture.and_then(|t| t.get("extensions")?.get("KHR_texture_basisu")).is_some();
    if is_basis {
        "the texture is in Basis Universal alone (KHR_texture_basisu), which can't be decoded; the factor alone was used: \
         convert it to PNG, JPEG or WebP (gltf-transform png)"
    } else {
        "the texture has no image that can be read (PNG, JPEG or WebP); the factor alone was used"
    }
}

/// The picture of texture `texture` of `user`, for numbers that aren't the scene's textures; a warning where it can't be read. Adds
/// the file that it came from to `files`.
pub(super) fn read_picture(
    document: &Document,
    texture: usize,
    space: ColorSpace,
    user: &str,
    files: &mut Vec<PathBuf>,
    warnings: &mut Warnings,
) -> Option<Texture> {
    let Some(image) = image(document, texture) else {
        warnings.add_missing(user, missing_message(document, texture));
        return None;
    };
    match read_image(document, image, space) {
        Ok((picture, file)) => {
            files.extend(file);
            Some(picture)
        }
        Err(e) => {
            warnings.add_missing(format!("{user}: {e}"), UNREADABLE);
            None
        }
    }
}

/// How a texture goes on outside of 0..1.
pub(super) fn wrap(document: &Document, texture: usize) -> [Wrap; 2] {
    let mode = |mode| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    };
    let texture: Option<json::Texture> = document.item("textures", texture).ok();
    let sampler: Option<json::texture::Sampler> =
        texture.and_then(|t| t.sampler).and_then(|s| document.item("samplers", s.value()).ok());
    sampler.map_or([Wrap::Repeat; 2], |s| [mode(s.wrap_s), mode(s.wrap_t)])
}

/// Decodes image `index`, whose numbers mean `space`; base colour and emission are both sRGB-encoded.
pub(super) fn read_image(document: &Document, index: usize, space: ColorSpace) -> Result<(Texture, Option<PathBuf>)> {
    let image: json::Image = document.item("images", index)?;
    let place = document.place("images", index);
    match (image.buffer_view, image.uri) {
        (Some(view), _) => Ok((document.access.decode(&place, document.view(view.value())?.bytes, space)?, None)),
        (None, Some(uri)) => match resolve(&document.path, &uri, &place)? {
            Resource::Bytes(bytes) => Ok((document.access.decode(&place, &bytes, space)?, None)),
            Resource::File(file) => {
                let bytes = document.access.read(&file)?;
                let texture = document.access.decode(&file.display().to_string(), &bytes, space)?;
                Ok((texture, Some(file)))
            }
        },
        (None, None) => Err(Error::invalid(place, "has neither a URI nor a buffer view")),
    }
}
