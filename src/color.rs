//! Colours: linear Rec.709 RGB triples inside, sRGB only in image files.

use glam::Vec3;

/// A linear Rec.709 RGB triple; its unit is that of the quantity it holds.
pub type Rgb = Vec3;

/// Relative luminance of linear Rec.709 (ITU-R BT.709).
pub fn luminance(c: Rgb) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// sRGB-encoded value in 0..=1 to linear light (IEC 61966-2-1).
pub fn linear_from_srgb(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Linear light to the sRGB-encoded value; clamps to 0..=1 first.
pub fn srgb_from_linear(v: f32) -> f32 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}
