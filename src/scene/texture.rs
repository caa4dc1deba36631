//! Decoded images, read in linear light.

use crate::color::linear_from_srgb;
use glam::{Vec2, Vec4};
use std::sync::OnceLock;

/// A decoded image; row 0 is the top.
#[derive(Clone, Debug)]
pub struct Texture {
    /// File name or URI, for messages.
    pub name: String,
    pub width: u32,
    pub height: u32,
    pub texels: Texels,
}

/// Texel storage, RGBA, `width * height` of them.
#[derive(Clone, Debug)]
pub enum Texels {
    /// 8 bit, RGB sRGB-encoded, alpha linear.
    Srgb8(Vec<[u8; 4]>),
    /// 8 bit, linear.
    Linear8(Vec<[u8; 4]>),
    /// Linear float.
    Float(Vec<[f32; 4]>),
}

/// What lies outside 0..1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    #[default]
    Repeat,
    Mirror,
    Clamp,
    /// Transparent black outside.
    Black,
}

impl Wrap {
    /// The texel index for `i` along an axis of `n` texels, `None` where the texture is black.
    fn apply(self, i: i64, n: i64) -> Option<i64> {
        match self {
            Self::Repeat => Some(i.rem_euclid(n)),
            Self::Clamp => Some(i.clamp(0, n - 1)),
            Self::Mirror => {
                let m = i.rem_euclid(2 * n);
                Some(if m < n { m } else { 2 * n - 1 - m })
            }
            Self::Black => (0..n).contains(&i).then_some(i),
        }
    }
}

impl Texture {
    /// Linear RGBA of texel (x, y); both must be in range.
    pub fn texel(&self, x: u32, y: u32) -> Vec4 {
        let i = y as usize * self.width as usize + x as usize;
        match &self.texels {
            Texels::Float(t) => Vec4::from_array(t[i]),
            Texels::Linear8(t) => Vec4::from_array(t[i].map(|v| f32::from(v) / 255.0)),
            Texels::Srgb8(t) => {
                let lut = srgb_table();
                let [r, g, b, a] = t[i];
                Vec4::new(lut[r as usize], lut[g as usize], lut[b as usize], f32::from(a) / 255.0)
            }
        }
    }

    /// Bilinear linear RGBA at `uv` (0..1 spans the image, v down).
    pub fn sample(&self, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
        Self::bilinear([self.width, self.height], uv, wrap, |x, y| self.texel(x, y))
    }

    /// The same of any picture of `size`, of which `texel` knows the texels.
    pub fn bilinear([w, h]: [u32; 2], uv: Vec2, wrap: [Wrap; 2], texel: impl Fn(u32, u32) -> Vec4) -> Vec4 {
        let (w, h) = (i64::from(w), i64::from(h));
        let at = uv * Vec2::new(w as f32, h as f32) - 0.5;
        let base = at.floor();
        let f = at - base;
        let at = |dx: i64, dy: i64| {
            let x = wrap[0].apply(base.x as i64 + dx, w);
            let y = wrap[1].apply(base.y as i64 + dy, h);
            x.zip(y).map_or(Vec4::ZERO, |(x, y)| texel(x as u32, y as u32))
        };
        let top = at(0, 0).lerp(at(1, 0), f.x);
        let bottom = at(0, 1).lerp(at(1, 1), f.x);
        top.lerp(bottom, f.y)
    }
}

fn srgb_table() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)))
}
