//! Pages in forms that engines load, beside OpenEXR: Radiance HDR, 8-bit PNG with a shared multiplier (RGBM, RGBD), and
//! KTX2 with half floats or BC6H blocks.
//!
//! | name | file | a texel's value | largest | error of a texel's brightest channel |
//! |---|---|---|---|---|
//! | `exr` | `.exr` | as it stands, half float | 65504 | 0.05 % |
//! | `hdr` | `.hdr` | RGBE ([`hdr`]) | 1.7e38 | 0.4 % |
//! | `rgbm` | `.rgbm.png` | scale * (8 A RGB)^2, as PlayCanvas decodes it | 64 | 0.4 % |
//! | `rgbm-srgb` | `.rgbm-srgb.png` | scale * linear(8 A RGB) by the curve of sRGB, as Needle Engine decodes it | 131 | 0.5 % |
//! | `rgbd` | `.rgbd.png` | scale * RGB^2.2 / A, as Babylon.js decodes it | 255 | 0.6 % |
//! | `ktx2-half` | `.half.ktx2` | scale * half float | 65504 | 0.05 % |
//! | `ktx2-bc6h` | `.bc6h.ktx2` | scale * half float, in blocks of 4 x 4 | 65504 | 1.7 % on average and 7 % at most on a slope of 12 % a texel |
//!
//! The largest values are those at scale 1. The 8-bit forms and KTX2 have one *scale* for all pages of a bake, a power of two,
//! so that an engine needs one number: it is 1 unless a bake is too bright for the form, or so dark that the 8-bit ones would lose
//! their steps ([`multiplier`]). OpenEXR holds what is too bright for half floats as 32-bit floats. Values are rounded to the nearest step and not dithered: a step of the 8-bit forms is
//! below 1 %, which is about where an eye begins to see one, and noise in a multiplier would be magnified by filtering.
//! Alpha is the multiplier in the 8-bit forms, coverage in `exr` and `ktx2-half`, and absent in the others.

mod bc6h;
pub mod hdr;
pub mod ktx2;
pub mod mips;
pub mod multiplier;

use crate::error::{Error, Result};
use crate::post::{PageImage, Quantity};
use ktx2::{Format, Level};
use multiplier::Curve;
use std::path::Path;

/// The largest finite half float.
const HALF_MAX: f32 = 65504.0;

/// The form of a page's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// OpenEXR: the one that holds layers and says what it holds.
    Exr,
    /// Radiance HDR.
    Hdr,
    /// PNG: a multiplier in alpha, squared.
    Rgbm,
    /// PNG: a multiplier in alpha, then the curve of sRGB.
    RgbmSrgb,
    /// PNG: a divisor in alpha.
    Rgbd,
    /// KTX2 of half floats.
    Ktx2Half,
    /// KTX2 of BC6H blocks.
    Ktx2Bc6h,
}

impl Encoding {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Exr, Self::Hdr, Self::Rgbm, Self::RgbmSrgb, Self::Rgbd, Self::Ktx2Half, Self::Ktx2Bc6h];

    /// Its name in settings, extras and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Hdr => "hdr",
            Self::Rgbm => "rgbm",
            Self::RgbmSrgb => "rgbm-srgb",
            Self::Rgbd => "rgbd",
            Self::Ktx2Half => "ktx2-half",
            Self::Ktx2Bc6h => "ktx2-bc6h",
        }
    }

    /// What follows the page's number in a file name.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Hdr => "hdr",
            Self::Rgbm => "rgbm.png",
            Self::RgbmSrgb => "rgbm-srgb.png",
            Self::Rgbd => "rgbd.png",
            Self::Ktx2Half => "half.ktx2",
            Self::Ktx2Bc6h => "bc6h.ktx2",
        }
    }

    /// Its media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Exr => "image/x-exr",
            Self::Hdr => "image/vnd.radiance",
            Self::Rgbm | Self::RgbmSrgb | Self::Rgbd => "image/png",
            Self::Ktx2Half | Self::Ktx2Bc6h => "image/ktx2",
        }
    }

    /// True where texels are the values themselves, so that any program that opens the file shows them.
    pub fn is_plain(self) -> bool {
        self.curve().is_none()
    }

    /// True where it can hold mip levels.
    pub fn has_mips(self) -> bool {
        matches!(self, Self::Ktx2Half | Self::Ktx2Bc6h)
    }

    /// How the 8-bit forms decode.
    fn curve(self) -> Option<Curve> {
        match self {
            Self::Rgbm => Some(Curve::Square),
            Self::RgbmSrgb => Some(Curve::Srgb),
            Self::Rgbd => Some(Curve::Divisor),
            _ => None,
        }
    }

    /// The number that decoded texels are multiplied by: a power of two for the 8-bit forms and KTX2, so that `largest`, the
    /// largest value of any channel of any page, can be held; 1 for the others.
    pub fn scale(self, largest: f32) -> f32 {
        match (self, self.curve()) {
            (_, Some(curve)) => multiplier::scale(curve, largest),
            // Half floats lose nothing by a power of two but what is far too dark to be seen beside such light.
            (Self::Ktx2Half | Self::Ktx2Bc6h, _) if largest > HALF_MAX => (largest / HALF_MAX).log2().ceil().exp2(),
            _ => 1.0,
        }
    }
}

/// One form that the pages of a bake are written in.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoded {
    pub encoding: Encoding,
    /// Decoded texels times this are the values.
    pub scale: f32,
    /// Page files relative to the output folder, in page order.
    pub uris: Vec<String>,
}

/// What goes into the file besides the texels.
#[derive(Clone, Copy, Debug)]
pub struct Header {
    pub quantity: Quantity,
    /// Decoded texels times this are the values; from [`Encoding::scale`].
    pub scale: f32,
    /// Mip levels that KTX2 gets, the full size among them, at least 1; as many as there are down to 1 x 1.
    pub levels: u32,
}

/// Writes a page in a form other than OpenEXR. Returns how many texels had a value that the form can't hold: too
/// bright, below zero, or not a number; they are written as the closest that it can.
///
/// # Errors
/// `Invalid` where the image's size and data disagree or the form can't hold its size, `Io` where the file can't be
/// written.
///
/// # Panics
/// With [`Encoding::Exr`], which [`super::exr::write_page`] writes.
pub fn write_page(path: &Path, page: &PageImage, encoding: Encoding, header: &Header) -> Result<usize> {
    let texels = page.width as usize * page.height as usize;
    if page.rgb.len() != texels || page.coverage.len() != texels || texels == 0 {
        return Err(Error::invalid(path.display(), "the page's size and its data disagree"));
    }
    let largest = match encoding.curve() {
        Some(curve) => curve.largest() * header.scale,
        None if encoding == Encoding::Hdr => hdr::LARGEST,
        None => HALF_MAX * header.scale,
    };
    // Negative half floats exist, but no light is one: what is below zero is rounding, or an error to be told of.
    let fits = |v: f32| (0.0..=largest).contains(&v);
    let misfits = page.rgb.iter().filter(|c| !c.to_array().into_iter().all(fits)).count();
    let bytes = match encoding {
        Encoding::Exr => panic!("OpenEXR has a writer of its own"),
        Encoding::Hdr => hdr::encode(page),
        Encoding::Rgbm | Encoding::RgbmSrgb | Encoding::Rgbd => {
            let curve = encoding.curve().expect("an 8-bit form has a curve");
            multiplier::encode(page, curve, header.scale)
                .map_err(|e| Error::invalid(path.display(), format!("the PNG can't be written: {e}")))?
        }
        Encoding::Ktx2Half => ktx2_of(page, header, Format::Rgba16Float, half_bytes),
        Encoding::Ktx2Bc6h => ktx2_of(page, header, Format::Bc6hUfloat, bc6h::encode),
    };
    std::fs::write(path, bytes).map_err(|e| Error::io(path, e))?;
    Ok(misfits)
}

/// A KTX2 file of the page, each level by `texels`.
fn ktx2_of(page: &PageImage, header: &Header, format: Format, texels: impl Fn(&PageImage) -> Vec<u8>) -> Vec<u8> {
    let scaled: PageImage;
    let page = if header.scale == 1.0 {
        page
    } else {
        scaled = PageImage { rgb: page.rgb.iter().map(|c| *c / header.scale).collect(), ..page.clone() };
        &scaled
    };
    let smaller = mips::smaller(page, header.levels.saturating_sub(1) as usize);
    let levels: Vec<Level> = [page].into_iter().chain(&smaller).map(|level| Level { bytes: texels(level) }).collect();
    let scale = header.scale.to_string();
    let mut own = vec![("lumel.quantity", header.quantity.name()), ("lumel.unit", header.quantity.unit())];
    if header.scale != 1.0 {
        // Keys stand in order.
        own.insert(1, ("lumel.scale", &scale));
    }
    ktx2::file(format, [page.width, page.height], &levels, &own)
}

/// R, G, B and coverage as half floats, row by row from the top.
fn half_bytes(page: &PageImage) -> Vec<u8> {
    let texels = page.rgb.iter().zip(&page.coverage);
    texels.flat_map(|(c, a)| [c.x, c.y, c.z, *a]).flat_map(|v| half(v).to_le_bytes()).collect()
}

/// The nearest half float that is a light's: 0 for what is below or not a number.
fn half(v: f32) -> half::f16 {
    half::f16::from_f32(if v > 0.0 { v.min(HALF_MAX) } else { 0.0 })
}
