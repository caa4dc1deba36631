//! PNG, JPEG, EXR and HDR pictures to textures.
//!
//! 8-bit pictures keep their bytes (a quarter of the memory of floats); all others become linear floats. What the
//! numbers mean follows from the [`ColorSpace`]; EXR and HDR are linear by definition.

use super::access::Access;
use crate::color::linear_from_srgb;
use crate::error::{Error, Result};
use crate::scene::{Texels, Texture};
use ::image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use rayon::prelude::*;
use std::io::Cursor;
use std::path::Path;

/// Largest width and height that is read [texels].
pub const MAX_SIDE: u32 = 16384;

/// Most memory that a decoder may take [bytes]: a picture of `MAX_SIDE` squared at 8 bit RGBA, twice.
const MAX_BYTES: u64 = 2 << 30;

/// Texels of a picture, at most, where nothing else is asked for.
pub const MOST_TEXELS: u64 = 1 << 28;

/// What a float texel that is not finite becomes where it is infinite: the largest half float.
const INFINITY_STAND_IN: f32 = 65504.0;

/// How integer texels are encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorSpace {
    /// RGB is sRGB-encoded, alpha linear.
    Srgb,
    /// Numbers as they stand.
    Linear,
    /// UsdUVTexture's `auto`: sRGB for 8-bit pictures of 3 or 4 channels, linear for all others.
    #[default]
    Auto,
}

/// Decodes the picture in `bytes`, whose format is told by its content (by `name`'s extension where the content has no
/// mark). Grey pictures come out as RGB, and alpha is 1 where there is none. Float texels that are NaN become 0,
/// infinite ones the largest half float, so that one bad texel can't fill a bake.
///
/// # Errors
/// `Invalid` naming `name` where the picture is broken or larger than [`MAX_SIDE`]; `Unsupported` for other formats.
pub fn decode(name: &str, bytes: &[u8], space: ColorSpace) -> Result<Texture> {
    let picture = reader(name, bytes)?.decode().map_err(|e| picture_error(name, e))?;
    let (width, height) = (picture.width(), picture.height());
    if width == 0 || height == 0 {
        return Err(Error::invalid(name, "the picture has no texels; export it again"));
    }
    Ok(Texture { name: name.to_owned(), width, height, texels: texels(picture, space) })
}

/// Reads a picture's header: the memory that [`decode`] gives its texels [bytes].
///
/// # Errors
/// As [`decode`], and `Invalid` where there are more than `most` texels.
pub fn measure(name: &str, bytes: &[u8], most: u64) -> Result<u64> {
    let decoder = reader(name, bytes)?.into_decoder().map_err(|e| picture_error(name, e))?;
    let (width, height) = decoder.dimensions();
    let count = u64::from(width) * u64::from(height);
    if count > most {
        let message =
            format!("has {width} x {height} texels, more than {most}; make it smaller, or raise --max-texture");
        return Err(Error::invalid(name, message));
    }
    let color = decoder.color_type();
    Ok(count * if color.bytes_per_pixel() == color.channel_count() { 4 } else { 16 })
}

/// A decoder of `bytes` whose memory is bounded.
fn reader<'a>(name: &str, bytes: &'a [u8]) -> Result<ImageReader<Cursor<&'a [u8]>>> {
    let mut reader = ImageReader::new(Cursor::new(bytes));
    if let Ok(format) = ::image::ImageFormat::from_path(name) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(|e| Error::invalid(name, e))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_BYTES);
    reader.limits(limits);
    Ok(reader)
}

fn picture_error(name: &str, error: ::image::ImageError) -> Error {
    match error {
        ::image::ImageError::Unsupported(e) => {
            Error::unsupported(name, format!("{e}; convert the picture to PNG, JPEG, EXR or HDR"))
        }
        ::image::ImageError::Limits(e) => {
            Error::invalid(name, format!("{e}; pictures of up to {MAX_SIDE} x {MAX_SIDE} texels can be read"))
        }
        e => Error::invalid(name, format!("{e}; export the picture again")),
    }
}

/// Reads and decodes the picture at `path`; see [`decode`].
///
/// # Errors
/// As [`decode`], and `Io` where the file can't be read.
pub fn load_file(path: &Path, space: ColorSpace) -> Result<Texture> {
    let bytes = Access::default().read(path)?;
    decode(&path.display().to_string(), &bytes, space)
}

fn texels(picture: DynamicImage, space: ColorSpace) -> Texels {
    use DynamicImage::{
        ImageLuma8, ImageLuma16, ImageLumaA8, ImageLumaA16, ImageRgb8, ImageRgb16, ImageRgba8, ImageRgba16,
    };
    match picture {
        ImageLuma8(_) | ImageLumaA8(_) | ImageRgb8(_) | ImageRgba8(_) => {
            let grey = matches!(picture, ImageLuma8(_) | ImageLumaA8(_));
            let bytes = picture.into_rgba8().into_raw();
            let rgba = bytes.as_chunks().0.to_vec();
            match space {
                ColorSpace::Linear => Texels::Linear8(rgba),
                ColorSpace::Auto if grey => Texels::Linear8(rgba),
                ColorSpace::Srgb | ColorSpace::Auto => Texels::Srgb8(rgba),
            }
        }
        ImageLuma16(_) | ImageLumaA16(_) | ImageRgb16(_) | ImageRgba16(_) => {
            let decode = |v: f32| if space == ColorSpace::Srgb { linear_from_srgb(v) } else { v };
            let values = picture.into_rgba16().into_raw();
            let texel = |t: &[u16; 4]| {
                let [r, g, b, a] = t.map(|v| f32::from(v) / 65535.0);
                [decode(r), decode(g), decode(b), a]
            };
            Texels::Float(values.as_chunks().0.par_iter().map(texel).collect())
        }
        float => {
            let mut values = float.into_rgba32f().into_raw();
            for v in values.iter_mut().filter(|v| !v.is_finite()) {
                *v = if v.is_nan() { 0.0 } else { INFINITY_STAND_IN.copysign(*v) };
            }
            Texels::Float(values.as_chunks().0.to_vec())
        }
    }
}
