//! Mip levels of a page: each texel is the mean of the up to 2 x 2 (3 where a side is odd) below it, weighted by
//! coverage.
//!
//! Weights keep charts' own light: a texel that is half of a chart and half of a gutter is that of the chart. Where no
//! surface lies, gutters that dilation filled count among themselves, so that charts don't fade to black at their
//! borders. Charts closer than two texels of a level share texels there: the same setting keeps them that far apart.

use crate::color::Rgb;
use crate::post::PageImage;

/// Weight of a filled gutter's texel beside covered ones.
const GUTTER_WEIGHT: f32 = 1e-4;

/// The levels below the page's own, `most` at most, down to 1 x 1.
pub fn smaller(page: &PageImage, most: usize) -> Vec<PageImage> {
    let mut levels: Vec<PageImage> = Vec::new();
    loop {
        let last = levels.last().unwrap_or(page);
        if levels.len() == most || (last.width <= 1 && last.height <= 1) {
            return levels;
        }
        levels.push(half(last));
    }
}

/// The page at half the size, rounded down.
fn half(page: &PageImage) -> PageImage {
    let (width, height) = ((page.width / 2).max(1), (page.height / 2).max(1));
    // The texels under texel `i` of `n`: an odd side's last texel has a share in the last one.
    let under = |i: u32, n: u32, of: u32| if n == 1 { 0..of } else { 2 * i..if i + 1 == n { of } else { 2 * i + 2 } };
    let count = (width * height) as usize;
    let mut level = PageImage { width, height, rgb: Vec::with_capacity(count), coverage: Vec::with_capacity(count) };
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut weights, mut coverage, mut texels) = (Rgb::ZERO, 0.0f32, 0.0f32, 0.0f32);
            for v in under(y, height, page.height) {
                for u in under(x, width, page.width) {
                    let i = v as usize * page.width as usize + u as usize;
                    let is_filled = page.rgb[i] != Rgb::ZERO;
                    let weight = page.coverage[i] + if is_filled { GUTTER_WEIGHT } else { 0.0 };
                    sum += page.rgb[i] * weight;
                    weights += weight;
                    coverage += page.coverage[i];
                    texels += 1.0;
                }
            }
            level.rgb.push(if weights > 0.0 { sum / weights } else { Rgb::ZERO });
            level.coverage.push(coverage / texels);
        }
    }
    level
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_keep_the_light_of_what_is_covered() {
        // A chart of light 3 on the left, an empty right, an odd height.
        let (width, height) = (8u32, 5u32);
        let is_chart = |i: u32| i % width < 3;
        let page = PageImage {
            width,
            height,
            rgb: (0..width * height).map(|i| if is_chart(i) { Rgb::splat(3.0) } else { Rgb::ZERO }).collect(),
            coverage: (0..width * height).map(|i| if is_chart(i) { 1.0 } else { 0.0 }).collect(),
        };
        let levels = smaller(&page, usize::MAX);
        assert_eq!(smaller(&page, 1).len(), 1);
        let sizes: Vec<_> = levels.iter().map(|l| (l.width, l.height)).collect();
        assert_eq!(sizes, [(4, 2), (2, 1), (1, 1)]);
        for level in &levels {
            for (color, coverage) in level.rgb.iter().zip(&level.coverage) {
                let expected = if *coverage > 0.0 { 3.0 } else { 0.0 };
                assert!((color.x - expected).abs() < 1e-5, "{level:?}");
            }
        }
        assert!((levels[2].coverage[0] - 3.0 / 8.0).abs() < 0.02, "{:?}", levels[2]);
    }
}
