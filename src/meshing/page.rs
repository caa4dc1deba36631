//! Bilinear look-ups in pages.

use crate::color::Rgb;
use crate::post::PageImage;
use glam::Vec2;

/// How far [texels] a texel is looked for where none surrounds a place.
const SEARCH: i64 = 4;

/// Bilinear over those of the four texels around `at` [texels] of which `counts` is true; else the nearest such texel within
/// [`SEARCH`]; else none.
pub fn sample_page(page: &PageImage, at: Vec2, counts: impl Fn(usize) -> bool) -> Option<Rgb> {
    let (width, height) = (i64::from(page.width), i64::from(page.height));
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let (x, y) = (corner.x as i64, corner.y as i64);
    let texel = |x: i64, y: i64| (y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize;
    let around = [(0, 0, 1.0 - f.x, 1.0 - f.y), (1, 0, f.x, 1.0 - f.y), (0, 1, 1.0 - f.x, f.y), (1, 1, f.x, f.y)];
    let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
    for (dx, dy, wx, wy) in around {
        let i = texel(x + dx, y + dy);
        if counts(i) {
            sum += page.rgb[i] * (wx * wy);
            weights += wx * wy;
        }
    }
    // Below this the texels barely touch the place, and the quotient would be rounding.
    if weights > 1e-4 {
        return Some(sum / weights);
    }
    let (x, y) = (at.x.floor() as i64, at.y.floor() as i64);
    let distance = |x: i64, y: i64| (Vec2::new(x as f32, y as f32) + 0.5).distance_squared(at);
    let mut nearest: Option<(f32, usize)> = None;
    for v in (y - SEARCH).max(0)..=(y + SEARCH).min(height - 1) {
        for u in (x - SEARCH).max(0)..=(x + SEARCH).min(width - 1) {
            let (d, i) = (distance(u, v), texel(u, v));
            if counts(i) && nearest.is_none_or(|(least, _)| d < least) {
                nearest = Some((d, i));
            }
        }
    }
    nearest.map(|(_, i)| page.rgb[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_between_texels_that_don_t_count_take_the_nearest_one_that_does() {
        let mut page = PageImage { width: 8, height: 1, rgb: vec![Rgb::ZERO; 8], coverage: vec![0.0; 8] };
        page.rgb[5] = Rgb::ONE;
        assert_eq!(sample_page(&page, Vec2::new(2.5, 0.5), |_| false), None);
        assert_eq!(sample_page(&page, Vec2::new(2.5, 0.5), |i| i == 5), Some(Rgb::ONE));
        assert_eq!(sample_page(&page, Vec2::new(5.75, 0.5), |i| i >= 5), Some(Rgb::splat(0.75)));
        assert_eq!(sample_page(&page, Vec2::new(-9.0, 70.0), |i| i == 5), None);
    }
}
