//! Textures of the scene as embedded PNGs.

use super::super::document::{Document, Target};
use crate::color::srgb_from_linear;
use crate::error::{Error, Result, Warnings};
use crate::scene::{Texels, Texture};
use glam::Vec4;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::json;
use std::collections::HashMap;

/// How texels become 8-bit values: (texel * scale + bias) / peak, sRGB-encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoding {
    pub scale: Vec4,
    pub bias: Vec4,
    /// The colour value that becomes 1.
    pub peak: f32,
    /// The alpha channel is kept.
    pub alpha: bool,
}

/// A texture, how it is encoded (as bits), and how it is repeated.
type Key = (usize, [u32; 9], bool);

/// Pictures and textures that were written, each once.
#[derive(Default)]
pub struct Pictures {
    images: HashMap<Key, usize>,
    textures: HashMap<(usize, [u32; 2]), usize>,
}

impl Pictures {
    /// The document's index of a texture with these `wrap` modes (WebGL's numbers).
    ///
    /// # Errors
    /// `Invalid` where the picture can't be encoded.
    pub fn write(
        &mut self,
        doc: &mut Document,
        textures: &[Texture],
        texture: usize,
        encoding: Encoding,
        wrap: [u32; 2],
        warnings: &mut Warnings,
    ) -> Result<usize> {
        let mut bits = [encoding.peak.to_bits(); 9];
        bits[..4].copy_from_slice(&encoding.scale.to_array().map(f32::to_bits));
        bits[4..8].copy_from_slice(&encoding.bias.to_array().map(f32::to_bits));
        let key = (texture, bits, encoding.alpha);
        let image = match self.images.get(&key) {
            Some(image) => *image,
            None => {
                let source = &textures[texture];
                let png = png(source, &encoding, warnings)?;
                let view = doc.push_view(&png, Target::None, None);
                let image = json!({ "name": source.name, "bufferView": view, "mimeType": "image/png" });
                let image = doc.push("images", image);
                self.images.insert(key, image);
                image
            }
        };
        Ok(*self.textures.entry((image, wrap)).or_insert_with(|| {
            let sampler = json!({ "wrapS": wrap[0], "wrapT": wrap[1] });
            let known = doc.root().get("samplers").and_then(|s| s.as_array()?.iter().position(|s| *s == sampler));
            let sampler = known.unwrap_or_else(|| doc.push("samplers", sampler));
            doc.push("textures", json!({ "source": image, "sampler": sampler }))
        }))
    }
}

fn png(texture: &Texture, encoding: &Encoding, warnings: &mut Warnings) -> Result<Vec<u8>> {
    let plain = encoding.scale == Vec4::ONE && encoding.bias == Vec4::ZERO && encoding.peak == 1.0;
    let mut clipped = false;
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let texels: Vec<[u8; 4]> = match &texture.texels {
        // The common case keeps its bytes.
        Texels::Srgb8(texels) if plain => texels.clone(),
        _ => (0..texture.height)
            .flat_map(|y| (0..texture.width).map(move |x| (x, y)))
            .map(|(x, y)| {
                let v = texture.texel(x, y) * encoding.scale + encoding.bias;
                let color = v.truncate() / encoding.peak;
                clipped |= color.max_element() > 1.001;
                [
                    byte(srgb_from_linear(color.x)),
                    byte(srgb_from_linear(color.y)),
                    byte(srgb_from_linear(color.z)),
                    byte(v.w),
                ]
            })
            .collect(),
    };
    if clipped {
        warnings.add(&texture.name, "values above 1 were clipped where the texture was made a PNG for the GLB");
    }
    let (bytes, kind): (Vec<u8>, _) = if encoding.alpha && texels.iter().any(|t| t[3] < 255) {
        (texels.concat(), ExtendedColorType::Rgba8)
    } else {
        (texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect(), ExtendedColorType::Rgb8)
    };
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(&bytes, texture.width, texture.height, kind)
        .map_err(|e| Error::invalid(&texture.name, format!("the picture can't be encoded: {e}")))?;
    Ok(png)
}
