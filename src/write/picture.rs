//! Pictures that cameras take: OpenEXR, and a tone-mapped PNG of it.

use super::exr::write_image;
use crate::color::{Rgb, luminance, srgb_from_linear};
use crate::error::{Error, Result};
use std::path::Path;

/// The level that the middle of a picture's brightness comes to (Reinhard et al. 2002, section 3.1).
const KEY: f64 = 0.18;

/// The luminance that becomes white, of the level that the picture is scaled to.
const WHITE: f32 = 4.0;

/// How linear values become what a screen shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Factor on all values.
    pub exposure: f32,
}

impl Tone {
    /// The exposure that brings the log-average luminance of a picture to a middle grey (Reinhard et al. 2002, "Photographic Tone
    /// Reproduction for Digital Images", equation 1), `stops` brighter than that.
    pub fn of(rgb: &[Rgb], stops: f32) -> Self {
        let lit = rgb.iter().map(|c| f64::from(luminance(*c))).filter(|l| l.is_finite() && *l > 0.0);
        let (sum, count) = lit.fold((0.0, 0u64), |(sum, count), l| (sum + l.ln(), count + 1));
        let mean = if count > 0 { (sum / count as f64).exp() } else { KEY };
        Self { exposure: (KEY / mean) as f32 * stops.exp2() }
    }

    /// The sRGB value of a colour, 0..=1: luminances of [`WHITE`] become white, small ones stay (equation 4).
    pub fn map(self, c: Rgb) -> Rgb {
        let scaled = c.max(Rgb::ZERO) * self.exposure;
        let level = luminance(scaled);
        if level.is_nan() || level <= 0.0 {
            return Rgb::ZERO;
        }
        let mapped = (level / (1.0 + level)) * (1.0 + level / (WHITE * WHITE));
        (scaled * (mapped / level)).clamp(Rgb::ZERO, Rgb::ONE).to_array().map(srgb_from_linear).into()
    }
}

/// Writes `rgb`, row by row from the top, as the 32-bit OpenEXR picture `exr` [nit] and the 8-bit `png`.
///
/// # Errors
/// `Invalid` where `rgb` doesn't hold `width * height` pixels, `Io` where a file can't be written.
pub fn write_picture(exr: &Path, png: &Path, size: [u32; 2], rgb: &[Rgb], tone: Tone) -> Result<()> {
    write_image(exr, size[0], size[1], rgb)?;
    let bytes = rgb.iter().flat_map(|c| tone.map(*c).to_array().map(|v| (255.0 * v + 0.5) as u8)).collect();
    let picture = image::RgbImage::from_raw(size[0], size[1], bytes)
        .ok_or_else(|| Error::invalid(png.display(), "the picture's size and its data disagree"))?;
    let format = image::ImageFormat::Png;
    picture.save_with_format(png, format).map_err(|e| Error::io(png, std::io::Error::other(e)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_comes_to_a_middle_grey_and_nothing_is_lost_beyond_white() {
        let rgb = [Rgb::splat(50.0), Rgb::splat(200.0)];
        let tone = Tone::of(&rgb, 0.0);
        assert!((tone.exposure * 100.0 - 0.18).abs() < 1e-5);
        assert!((tone.map(Rgb::splat(1e9)) - Rgb::ONE).abs().max_element() < 1e-5);
        assert_eq!(tone.map(Rgb::ZERO), Rgb::ZERO);
        assert!((Tone { exposure: 1.0 }.map(Rgb::splat(4.0)).x - 1.0).abs() < 1e-5);
        let [dark, bright] = rgb.map(|c| tone.map(c).x);
        assert!(dark < bright && bright < 1.0);
        assert_eq!(Tone::of(&[Rgb::ZERO], 1.0).exposure, 2.0);
    }
}
