//! Bilinear look-ups in pages.

use crate::color::Rgb;
use crate::post::PageImage;
use glam::Vec2;

/// How far [texels] a covered texel is looked for where none surrounds a place.
const SEARCH: i64 = 4;

/// Bilinear over the covered ones of the four texels around `at` [texels]; else the nearest covered texel within
/// [`SEARCH`]; else what dilation left there.
pub fn sample_page(page: &PageImage, at: Vec2) -> Rgb {
    let (width, height) = (i64::from(page.width), i64::from(page.height));
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let (x, y) = (corner.x as i64, corner.y as i64);
    let texel = |x: i64, y: i64| (y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize;
    let around = [(0, 0, 1.0 - f.x, 1.0 - f.y), (1, 0, f.x, 1.0 - f.y), (0, 1, 1.0 - f.x, f.y), (1, 1, f.x, f.y)];
    let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
    for (dx, dy, wx, wy) in around {
        let i = texel(x + dx, y + dy);
        if page.coverage[i] > 0.0 {
            sum += page.rgb[i] * (wx * wy);
            weights += wx * wy;
        }
    }
    // Below this the covered texels barely touch the corner, and the quotient would be rounding.
    if weights > 1e-4 {
        return sum / weights;
    }
    let (x, y) = (at.x.floor() as i64, at.y.floor() as i64);
    let distance = |x: i64, y: i64| (Vec2::new(x as f32, y as f32) + 0.5).distance_squared(at);
    let mut nearest: Option<(f32, usize)> = None;
    for v in (y - SEARCH).max(0)..=(y + SEARCH).min(height - 1) {
        for u in (x - SEARCH).max(0)..=(x + SEARCH).min(width - 1) {
            let (d, i) = (distance(u, v), texel(u, v));
            if page.coverage[i] > 0.0 && nearest.is_none_or(|(least, _)| d < least) {
                nearest = Some((d, i));
            }
        }
    }
    page.rgb[nearest.map_or(texel(x, y), |(_, i)| i)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_without_coverage_take_the_nearest_texel() {
        let mut page = PageImage { width: 8, height: 1, rgb: vec![Rgb::ZERO; 8], coverage: vec![0.0; 8] };
        page.rgb[5] = Rgb::ONE;
        assert_eq!(sample_page(&page, Vec2::new(2.5, 0.5)), Rgb::ZERO);
        page.coverage[5] = 0.1;
        assert_eq!(sample_page(&page, Vec2::new(2.5, 0.5)), Rgb::ONE);
        assert_eq!(sample_page(&page, Vec2::new(-9.0, 70.0)), Rgb::ZERO);
    }
}
