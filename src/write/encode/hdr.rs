//! Radiance HDR: RGBE texels in run-length encoded scan lines (Ward, *Real Pixels*, Graphics Gems II, 1991; Radiance's
//! `color.c`).
//!
//! A texel is (R, G, B) 2^(E - 136): mantissas are rounded to the nearest, so that readers that take them as they are
//! (stb_image, Bevy, Blender) see no bias. Radiance itself adds half a step, 0.2 % on average, and three.js divides by
//! 255 in place of 256, which is 0.4 %.

use crate::color::Rgb;
use crate::post::PageImage;

/// Widths that run-length encoded scan lines can have.
const RUN_WIDTHS: std::ops::RangeInclusive<u32> = 8..=32767;

/// The largest value: mantissa 255 at the last exponent.
pub const LARGEST: f32 = 1.694_806e38;

/// The shortest run that is worth one.
const LEAST_RUN: usize = 4;

/// Longest run, and longest stretch of single bytes.
const MOST_RUN: usize = 127;
const MOST_SINGLE: usize = 128;

/// The file's bytes; negative values and NaN become 0.
pub fn encode(page: &PageImage) -> Vec<u8> {
    let (width, height) = (page.width, page.height);
    let mut file = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
    for row in page.rgb.chunks_exact(width as usize) {
        let texels: Vec<[u8; 4]> = row.iter().map(|c| rgbe(*c)).collect();
        if !RUN_WIDTHS.contains(&width) {
            file.extend(texels.concat());
            continue;
        }
        file.extend([2, 2, (width >> 8) as u8, width as u8]);
        for channel in 0..4 {
            let bytes: Vec<u8> = texels.iter().map(|t| t[channel]).collect();
            runs(&bytes, &mut file);
        }
    }
    file
}

/// Mantissas and the exponent they share.
pub fn rgbe(color: Rgb) -> [u8; 4] {
    let color = color.to_array().map(|v| if v > 0.0 { v.min(LARGEST) } else { 0.0 });
    let largest = color.into_iter().fold(0.0, f32::max);
    // Below this the exponent's byte would be less than 1.
    if largest < 1e-37 {
        return [0; 4];
    }
    // largest = m 2^e with m in 0.5..1; a mantissa that rounds up to 256 needs the next exponent.
    let exponent = |v: f32| i32::from((v.to_bits() >> 23) as u8) - 126;
    let mantissa = |v: f32, e: i32| (f64::from(v) * 2f64.powi(8 - e)).round();
    let mut e = exponent(largest);
    if mantissa(largest, e) > 255.0 {
        e += 1;
    }
    let [r, g, b] = color.map(|v| mantissa(v, e) as u8);
    [r, g, b, (e + 128) as u8]
}

/// Appends one channel of a scan line: counts above 128 repeat the byte that follows, others copy so many bytes.
fn runs(bytes: &[u8], file: &mut Vec<u8>) {
    let run_at = |at: usize| bytes[at..].iter().take(MOST_RUN).take_while(|b| **b == bytes[at]).count();
    let mut at = 0;
    while at < bytes.len() {
        let run = run_at(at);
        if run >= LEAST_RUN {
            file.extend([128 + run as u8, bytes[at]]);
            at += run;
            continue;
        }
        let mut end = at + run;
        while end < bytes.len() && end - at < MOST_SINGLE && run_at(end) < LEAST_RUN {
            end += 1;
        }
        file.push((end - at) as u8);
        file.extend(&bytes[at..end]);
        at = end;
    }
}
