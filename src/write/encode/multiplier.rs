//! Eight bits a channel with a multiplier in alpha: what graphics processors without float textures filter, and PNG
//! holds.
//!
//! The three curves are those of the engines that read them:
//!
//! | curve | a texel's value over the scale | source |
//! |---|---|---|
//! | [`Curve::Square`] | (8 A RGB)^2 | PlayCanvas, shader chunk `decode`, `decodeRGBM` |
//! | [`Curve::Srgb`] | linear(8 A RGB), sRGB's curve also above 1 | Needle Engine, `engine_lightdata.ts` |
//! | [`Curve::Divisor`] | RGB^2.2 / A | Babylon.js, shader include `helperFunctions`, `fromRGBD` |
//!
//! A is the least step that can hold the texel's brightest channel, so that RGB use their range: neighbours of like
//! brightness have like A, and filtering both channels apart does no harm.

use crate::color::Rgb;
use crate::post::PageImage;
use image::{ExtendedColorType, ImageEncoder, ImageError, codecs::png::PngEncoder};

/// The multiplier's range in the curves that have one.
const RANGE: f32 = 8.0;

/// A scale stays 1 while the largest value is at least this share of the curve's: below, the multiplier has too few
/// steps left.
const LEAST_SHARE: f32 = 1.0 / 64.0;

/// How texels decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// A multiplier before a square.
    Square,
    /// A multiplier before the curve of sRGB (IEC 61966-2-1).
    Srgb,
    /// A divisor behind the power 2.2.
    Divisor,
}

impl Curve {
    /// The largest value that it holds.
    pub fn largest(self) -> f32 {
        match self {
            Self::Square => RANGE * RANGE,
            Self::Srgb => ((RANGE + 0.055) / 1.055).powf(2.4),
            Self::Divisor => 255.0,
        }
    }

    /// The texel of a color over the scale; what can't be held becomes the closest that can.
    pub fn encode(self, color: Rgb) -> [u8; 4] {
        let color = color.to_array().map(|v| if v > 0.0 { v.min(self.largest()) } else { 0.0 });
        let byte = |v: f32| (v * 255.0 + 0.5).clamp(0.0, 255.0) as u8;
        if self == Self::Divisor {
            let largest = color.into_iter().fold(0.0, f32::max);
            let a = (255.0 / largest.max(1.0)).floor().max(1.0);
            let [r, g, b] = color.map(|v| byte((v * a / 255.0).powf(1.0 / 2.2)));
            return [r, g, b, a as u8];
        }
        let curved = color.map(|v| self.inverse(v) / RANGE);
        let a = (curved.into_iter().fold(0.0, f32::max) * 255.0).ceil().clamp(1.0, 255.0);
        let [r, g, b] = curved.map(|v| byte(v * 255.0 / a));
        [r, g, b, a as u8]
    }

    /// What engines make of a texel, over the scale.
    pub fn decode(self, [r, g, b, a]: [u8; 4]) -> Rgb {
        let [r, g, b, a] = [r, g, b, a].map(|v| f32::from(v) / 255.0);
        let rgb = Rgb::new(r, g, b);
        match self {
            Self::Square => (rgb * a * RANGE) * (rgb * a * RANGE),
            Self::Srgb => Rgb::from_array((rgb * a * RANGE).to_array().map(linear_from_srgb)),
            Self::Divisor => Rgb::from_array(rgb.to_array().map(|v| v.powf(2.2))) / a,
        }
    }

    fn inverse(self, v: f32) -> f32 {
        match self {
            Self::Square => v.sqrt(),
            Self::Srgb if v <= 0.003_130_8 => 12.92 * v,
            Self::Srgb => 1.055 * v.powf(1.0 / 2.4) - 0.055,
            Self::Divisor => v.powf(1.0 / 2.2),
        }
    }
}

fn linear_from_srgb(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The power of two that a curve's values are multiplied by, so that `largest` can be held and the steps are used.
pub fn scale(curve: Curve, largest: f32) -> f32 {
    let share = largest / curve.largest();
    if !(share > 0.0 && share.is_finite()) || (LEAST_SHARE..=1.0).contains(&share) {
        return 1.0;
    }
    share.log2().ceil().clamp(-120.0, 120.0).exp2()
}

/// A PNG of the page, its values over `scale`.
///
/// # Errors
/// Those of the PNG encoder.
pub fn encode(page: &PageImage, curve: Curve, scale: f32) -> Result<Vec<u8>, ImageError> {
    let texels: Vec<u8> = page.rgb.iter().flat_map(|c| curve.encode(*c / scale)).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(&texels, page.width, page.height, ExtendedColorType::Rgba8)?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURVES: [Curve; 3] = [Curve::Square, Curve::Srgb, Curve::Divisor];

    /// The brightest channel comes back within 0.7 % over four decades below the largest value, without bias.
    #[test]
    fn texels_come_back() {
        for curve in CURVES {
            // The divisor's steps end at 1: below, eight bits are all there is.
            let decades = if curve == Curve::Divisor { 2.4 } else { 4.0 };
            let (mut worst, mut sum, count) = (0.0f32, 0.0f64, 4000);
            for i in 0..count {
                let v = curve.largest() * 10f32.powf(-decades * i as f32 / count as f32);
                let color = Rgb::new(v, 0.6 * v, 0.2 * v);
                let back = curve.decode(curve.encode(color));
                let error = back.x / v - 1.0;
                worst = worst.max(error.abs());
                sum += f64::from(error);
                assert!((back.y / color.y - 1.0).abs() < 0.012, "{curve:?} {v}: {back}");
                assert!((back.z / color.z - 1.0).abs() < 0.03, "{curve:?} {v}: {back}");
            }
            assert!(worst < 0.007, "{curve:?}: {worst}");
            assert!((sum / f64::from(count)).abs() < 2e-4, "{curve:?}: bias {}", sum / f64::from(count));
        }
    }

    #[test]
    fn what_can_not_be_held_becomes_the_closest() {
        for curve in CURVES {
            let peak = curve.decode(curve.encode(Rgb::splat(f32::INFINITY)));
            assert!((peak.x / curve.largest() - 1.0).abs() < 1e-3, "{curve:?}: {peak}");
            assert_eq!(curve.decode(curve.encode(Rgb::new(f32::NAN, -1.0, 0.0))), Rgb::ZERO);
        }
    }

    #[test]
    fn scales_are_powers_of_two_that_hold_the_largest_value() {
        for curve in CURVES {
            let largest = curve.largest();
            assert_eq!([scale(curve, largest), scale(curve, largest / 60.0), scale(curve, 0.0)], [1.0; 3]);
            assert_eq!(scale(curve, f32::INFINITY), 1.0);
            for v in [1e-6, 1e-3, 300.0, 5e4, 1e9] {
                let s = scale(curve, v);
                assert!(s.log2().fract() == 0.0 && s * largest >= v, "{curve:?} {v}: {s}");
                assert!(s == 1.0 || s * largest < 2.0 * v, "{curve:?} {v}: {s}");
            }
        }
    }
}
