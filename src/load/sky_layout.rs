//! Pictures of skies in layouts other than latlong, brought to latlong.
//!
//! The dome's schema leaves open where these pictures look; the light-probe pages of Debevec say: a picture's middle at +Z, its
//! right at +X, its top at +Y, as a mirrored ball shows it. With (u, v) from -1 to 1 and D the direction:
//!
//! - mirrored ball: (u, v) is the ball's normal that reflects D towards +Z, its x and y;
//! - angular: (u, v) = (Dx, Dy) r, r = acos(Dz) / (pi sqrt(Dx^2 + Dy^2));
//! - vertical cross: three by four squares; down the middle +Y, +Z, -Y and -Z (upside down), -X and +X beside +Z.

use crate::color::Rgb;
use crate::scene::{Environment, Texels, Texture, Wrap};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// How a picture shows all directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyLayout {
    MirroredBall,
    Angular,
    VerticalCross,
}

/// Rows of a latlong picture at most [texels].
const MOST_ROWS: u32 = 4096;

/// Looks along each side of a texel.
const SIDE: u32 = 2;

impl SkyLayout {
    /// The layout that UsdLux calls `token`.
    pub fn from_token(token: &str) -> Option<Self> {
        match token {
            "mirroredBall" => Some(Self::MirroredBall),
            "angular" => Some(Self::Angular),
            "cubeMapVerticalCross" => Some(Self::VerticalCross),
            _ => None,
        }
    }

    /// The picture as latlong, about as fine as it is.
    pub fn latlong(self, picture: &Texture) -> Texture {
        let rows = match self {
            // Half a turn from top to bottom of two squares.
            Self::VerticalCross => picture.height / 2,
            Self::MirroredBall | Self::Angular => picture.height,
        };
        let height = rows.clamp(1, MOST_ROWS);
        let width = 2 * height;
        let sky = Environment::constant("", Rgb::ONE);
        let texel = |k: u32| {
            let (x, y) = (k % width, k / width);
            let mut sum = Vec3::ZERO;
            for (i, j) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))) {
                let at = Vec2::new(x as f32, y as f32) + (Vec2::new(i as f32, j as f32) + 0.5) / SIDE as f32;
                sum += self.look_up(picture, sky.direction(at / Vec2::new(width as f32, height as f32)));
            }
            (sum / (SIDE * SIDE) as f32).extend(1.0).to_array()
        };
        let texels = (0..width * height).into_par_iter().map(texel).collect();
        Texture { name: picture.name.clone(), width, height, texels: Texels::Float(texels) }
    }

    /// The colour of the unit direction `d`.
    fn look_up(self, picture: &Texture, d: Vec3) -> Rgb {
        let on_disc =
            |p: Vec2| picture.sample(Vec2::new(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y), [Wrap::Clamp; 2]).truncate();
        match self {
            Self::MirroredBall => on_disc((d + Vec3::Z).normalize_or_zero().truncate()),
            Self::Angular => {
                let across = d.truncate();
                on_disc(across.normalize_or_zero() * (across.length().atan2(d.z) / std::f32::consts::PI))
            }
            Self::VerticalCross => {
                let (square, within) = on_cross(d);
                // Not beyond the square's own texels: what lies beside may be no part of the sky.
                let size = Vec2::new(picture.width as f32 / 3.0, picture.height as f32 / 4.0);
                let margin = (0.5 / size).min(Vec2::splat(0.5));
                let at = (square + within.clamp(margin, 1.0 - margin)) / Vec2::new(3.0, 4.0);
                picture.sample(at, [Wrap::Clamp; 2]).truncate()
            }
        }
    }
}

/// The square (column, row) of a vertical cross that shows `d`, and the place within it, down and to the right.
fn on_cross(d: Vec3) -> (Vec2, Vec2) {
    let a = d.abs();
    let (square, x, y) = if a.z >= a.x && a.z >= a.y {
        let (x, y) = (d.x / a.z, d.y / a.z);
        if d.z > 0.0 { ((1.0, 1.0), x, -y) } else { ((1.0, 3.0), x, y) }
    } else if a.x >= a.y {
        let (y, z) = (d.y / a.x, d.z / a.x);
        if d.x > 0.0 { ((2.0, 1.0), -z, -y) } else { ((0.0, 1.0), z, -y) }
    } else {
        let (x, z) = (d.x / a.y, d.z / a.y);
        if d.y > 0.0 { ((1.0, 0.0), x, z) } else { ((1.0, 2.0), x, -z) }
    };
    (Vec2::from(square), Vec2::new(x, y) * 0.5 + 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of `size` texels whose colour is `color` of the place (0..1, down).
    fn picture(size: [u32; 2], color: impl Fn(Vec2) -> Vec3) -> Texture {
        let at = |k: u32| {
            (Vec2::new((k % size[0]) as f32, (k / size[0]) as f32) + 0.5) / Vec2::new(size[0] as f32, size[1] as f32)
        };
        let texels = (0..size[0] * size[1]).map(|k| color(at(k)).extend(1.0).to_array()).collect();
        Texture { name: "sky".into(), width: size[0], height: size[1], texels: Texels::Float(texels) }
    }

    /// The colour of a sky: smooth, and different in every direction.
    fn color(d: Vec3) -> Vec3 {
        d * 0.5 + 0.5
    }

    fn check(layout: SkyLayout, picture: &Texture, tolerance: f32) {
        let latlong = layout.latlong(picture);
        let sky = Environment::constant("", Rgb::ONE);
        let mut worst = 0.0f32;
        for k in 0..2000 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 2000.0;
            let (sin, cos) = (k as f32 * 2.399_963_2).sin_cos();
            let d = Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z;
            // A ball shows what is behind it at its rim alone.
            if d.z > -0.95 {
                let seen = latlong.sample(sky.uv(d), crate::scene::environment::WRAP).truncate();
                worst = worst.max(seen.distance(color(d)));
            }
        }
        assert!(worst < tolerance, "{layout:?}: {worst}");
    }

    #[test]
    fn every_layout_shows_the_same_sky() {
        let ball = picture([512, 512], |p| {
            let n = Vec2::new(2.0 * p.x - 1.0, 1.0 - 2.0 * p.y);
            let normal = n.extend((1.0 - n.length_squared()).max(0.0).sqrt());
            color(normal * (2.0 * normal.z) - Vec3::Z)
        });
        check(SkyLayout::MirroredBall, &ball, 0.03);
        let angular = picture([512, 512], |p| {
            let n = Vec2::new(2.0 * p.x - 1.0, 1.0 - 2.0 * p.y);
            let (sin, cos) = (n.length() * std::f32::consts::PI).sin_cos();
            color((n.normalize_or_zero() * sin).extend(cos))
        });
        check(SkyLayout::Angular, &angular, 0.03);
        let cross = picture([384, 512], |p| {
            let (column, row) = ((p.x * 3.0).floor(), (p.y * 4.0).floor());
            let (x, y) = (2.0 * (p.x * 3.0).fract() - 1.0, 2.0 * (p.y * 4.0).fract() - 1.0);
            let d = match (column as u32, row as u32) {
                (1, 0) => Vec3::new(x, 1.0, y),
                (0, 1) => Vec3::new(-1.0, -y, x),
                (1, 1) => Vec3::new(x, -y, 1.0),
                (2, 1) => Vec3::new(1.0, -y, -x),
                (1, 2) => Vec3::new(x, -1.0, -y),
                (1, 3) => Vec3::new(x, y, -1.0),
                _ => return Vec3::splat(9.0),
            };
            color(d.normalize())
        });
        check(SkyLayout::VerticalCross, &cross, 0.03);
    }
}
