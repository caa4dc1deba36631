//! A picture that shines, cut into rectangles of about even brightness: each becomes a polygon of its own, so that the light
//! tree draws them in proportion to their power, and what arrives unoccluded is known for each.
//!
//! A quadtree, refined where the brightness deviates most, times the area.

use crate::color::{Rgb, luminance};
use crate::scene::projector::look_up;
use crate::scene::{Light, Texture};
use glam::{DVec3, UVec2, Vec2, Vec3};

/// Rectangles of a picture, at most; together they fit into a cut through the light tree.
const MOST_CELLS: usize = 24;

/// A cell whose brightness deviates by less than this share of the picture's mean is even.
const EVEN: f64 = 0.02;

/// A part of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Its first texel, and the one after its last.
    low: UVec2,
    high: UVec2,
    /// The picture's size [texels].
    size: UVec2,
    pub mean: Rgb,
    /// Root mean square deviation of the luminance from its mean.
    deviation: f64,
}

/// The cells of `picture`, which cover it; those that are black are left out.
pub fn cells(picture: &Texture) -> Vec<Cell> {
    let size = UVec2::new(picture.width, picture.height);
    let mut all = vec![Cell::new(picture, UVec2::ZERO, size, size)];
    let least = EVEN * f64::from(luminance(all[0].mean));
    while all.len() + 3 <= MOST_CELLS {
        let weight =
            |c: &Cell| if c.is_single() { 0.0 } else { c.deviation * f64::from((c.high - c.low).element_product()) };
        let uneven = (0..all.len()).filter(|&k| all[k].deviation > least && !all[k].is_single());
        let Some(k) = uneven.max_by(|&i, &j| weight(&all[i]).total_cmp(&weight(&all[j])).then(j.cmp(&i))) else {
            break;
        };
        let parent = all.swap_remove(k);
        all.extend(parent.split(picture));
    }
    all.retain(|c| c.mean.max_element() > 0.0);
    all
}

impl Cell {
    fn new(picture: &Texture, low: UVec2, high: UVec2, size: UVec2) -> Self {
        let (mut sum, mut squares) = (DVec3::ZERO, 0.0);
        for y in low.y..high.y {
            for x in low.x..high.x {
                // As it is looked up, its neighbours blended in, so that all of a bright texel's light is counted.
                let quarters = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
                for (dx, dy) in quarters {
                    let color = look_up(picture, Vec2::new(x as f32 + dx, y as f32 + dy) / size.as_vec2());
                    sum += color.as_dvec3();
                    squares += f64::from(luminance(color)).powi(2);
                }
            }
        }
        let n = 4.0 * f64::from((high - low).element_product());
        let mean = (sum / n).as_vec3();
        let deviation = (squares / n - f64::from(luminance(mean)).powi(2)).max(0.0).sqrt();
        Self { low, high, size, mean, deviation }
    }

    fn is_single(&self) -> bool {
        self.high - self.low == UVec2::ONE
    }

    /// Its quarters, or halves where it is one texel wide or high.
    fn split(self, picture: &Texture) -> Vec<Self> {
        let middle = (self.low + self.high) / 2;
        let halves = |low: u32, middle: u32, high: u32| {
            if high - low > 1 { vec![(low, middle), (middle, high)] } else { vec![(low, high)] }
        };
        let columns = halves(self.low.x, middle.x, self.high.x);
        let rows = halves(self.low.y, middle.y, self.high.y);
        let cell = |&(top, bottom): &(u32, u32)| {
            columns.iter().map(move |&(left, right)| {
                Self::new(picture, UVec2::new(left, top), UVec2::new(right, bottom), self.size)
            })
        };
        rows.iter().flat_map(cell).collect()
    }

    /// Its corners on the rect `light`, in the order of a rect light's polygon.
    pub fn corners(&self, light: &Light, center: Vec3, u: Vec3, v: Vec3) -> Vec<Vec3> {
        let (low, high) = (self.low.as_vec2() / self.size.as_vec2(), self.high.as_vec2() / self.size.as_vec2());
        // The picture's first texel is at +X, +Y; the half edge of a mirrored light is turned over.
        let turned = u.dot(light.world_from_light.x_axis) < 0.0;
        let along = |x: f32| if turned { 2.0 * x - 1.0 } else { 1.0 - 2.0 * x };
        let (a, b) = (along(low.x), along(high.x));
        let (s, t) = ((a.min(b), a.max(b)), (1.0 - 2.0 * high.y, 1.0 - 2.0 * low.y));
        let at = |s: f32, t: f32| center + u * s + v * t;
        vec![at(s.0, t.0), at(s.0, t.1), at(s.1, t.1), at(s.1, t.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LightShape, Texels};

    #[test]
    fn cells_cover_the_picture_and_keep_its_power() {
        let texels = (0..64 * 32u32).map(|i| {
            let (x, y) = (i % 64, i / 64);
            let bright = if (40..44).contains(&x) && (8..10).contains(&y) { 50.0 } else { 0.1 * (x % 3) as f32 };
            [bright, 0.5 * bright, 0.2, 1.0]
        });
        let texels = Texels::Float(texels.collect());
        let picture = Texture { name: "lamp".into(), width: 64, height: 32, texels };
        let all = cells(&picture);
        assert!(all.len() > 8 && all.len() <= MOST_CELLS);
        let whole = Cell::new(&picture, UVec2::ZERO, UVec2::new(64, 32), UVec2::new(64, 32));
        let (mut area, mut power) = (0, Rgb::ZERO);
        for c in &all {
            let n = (c.high - c.low).element_product();
            area += n;
            power += c.mean * n as f32;
        }
        assert_eq!(area, 64 * 32);
        assert!((power / (64.0 * 32.0) / whole.mean - 1.0).abs().max_element() < 1e-4);
        // Their brightest one lies where the picture is bright, half way up on the left of whoever looks at it.
        let shape = LightShape::Rect { center: Vec3::ZERO, u: Vec3::X, v: Vec3::Y, radiance: Rgb::ONE };
        let light = Light::new("l", shape);
        let brightest = all.iter().max_by(|a, b| a.mean.x.total_cmp(&b.mean.x)).unwrap();
        let corners = brightest.corners(&light, Vec3::ZERO, Vec3::X, Vec3::Y);
        let middle = corners.iter().sum::<Vec3>() / 4.0;
        assert!(
            (middle.x - (1.0 - 2.0 * 42.0 / 64.0)).abs() < 0.1 && (middle.y - (1.0 - 2.0 * 9.0 / 32.0)).abs() < 0.1
        );
    }
}
