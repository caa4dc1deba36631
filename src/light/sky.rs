//! The sky: radiance by direction, and sampling where its picture is bright.
//!
//! A constant sky is found well enough by the rays of the gather that escape. A sky with a picture is sampled by its
//! brightness too, and the two are combined by the power heuristic (Veach, Guibas 1995).

use crate::color::{Rgb, luminance};
use crate::sample::Discrete;
use crate::scene::{Environment, Scene, Texture, Wrap};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Cells of the brightness table, at most, along the equator and from pole to pole.
const TABLE: [u32; 2] = [512, 256];

/// A latlong picture closes around the horizon and ends at the poles.
const WRAP: [Wrap; 2] = [Wrap::Repeat, Wrap::Clamp];

/// The sky of a scene, ready to be sampled.
pub struct Sky {
    environment: Environment,
    table: Option<Table>,
}

/// Cells of equal angles, chosen by brightness times solid angle.
struct Table {
    size: [u32; 2],
    cells: Discrete,
}

impl Sky {
    /// Prepares `environment`; a picture's brightness is tabulated.
    pub fn new(scene: &Scene, environment: &Environment) -> Self {
        let table = environment.texture.and_then(|t| {
            let picture = &scene.textures[t];
            let size = [TABLE[0].min(picture.width), TABLE[1].min(picture.height)];
            let weights = (0..size[0] * size[1]).map(|i| {
                let (x, y) = (i % size[0], i / size[0]);
                let mut sum = 0.0f64;
                let rows = span(y, size[1], picture.height);
                for py in rows.clone() {
                    for px in span(x, size[0], picture.width) {
                        sum += brightness(picture, px, py);
                    }
                }
                let sin = (PI * (y as f32 + 0.5) / size[1] as f32).sin();
                let count = rows.len() as f64 * span(x, size[0], picture.width).len() as f64;
                sum / count.max(1.0) * f64::from(sin)
            });
            Discrete::new(weights).map(|cells| Table { size, cells })
        });
        Self { environment: environment.clone(), table }
    }

    /// Radiance from the unit direction `d` [nit].
    pub fn radiance(&self, scene: &Scene, d: Vec3) -> Rgb {
        match self.environment.texture {
            Some(t) => {
                let texel = scene.textures[t].sample(self.environment.uv(d), WRAP).truncate();
                (self.environment.radiance * texel).max(Rgb::ZERO)
            }
            None => self.environment.radiance,
        }
    }

    /// True where brightness is worth sampling.
    pub fn has_picture(&self) -> bool {
        self.table.is_some()
    }

    /// A direction in proportion to brightness, and its density [1/sr].
    pub fn sample(&self, u: [f32; 4]) -> Option<(Vec3, f32)> {
        let table = self.table.as_ref()?;
        let (cell, _) = table.cells.sample(u[0]);
        let (x, y) = (cell as u32 % table.size[0], cell as u32 / table.size[0]);
        let at = Vec2::new((x as f32 + u[1]) / table.size[0] as f32, (y as f32 + u[2]) / table.size[1] as f32);
        let d = self.environment.direction(at);
        let pdf = self.pdf(d);
        (pdf > 0.0).then_some((d, pdf))
    }

    /// Density [1/sr] of [`sample`](Self::sample) at the unit direction `d`; 0 for a constant sky.
    pub fn pdf(&self, d: Vec3) -> f32 {
        let Some(table) = &self.table else { return 0.0 };
        let uv = self.environment.uv(d);
        let x = ((uv.x.rem_euclid(1.0) * table.size[0] as f32) as u32).min(table.size[0] - 1);
        let y = ((uv.y * table.size[1] as f32) as u32).min(table.size[1] - 1);
        let probability = table.cells.pdf((y * table.size[0] + x) as usize) as f32;
        let sin = (PI * uv.y).sin().max(1e-6);
        probability * (table.size[0] * table.size[1]) as f32 / (TAU * PI * sin)
    }
}

/// Mean brightness of a texel's square as it is looked up, that is with its neighbours blended in: beside a small sun that is
/// far more than the texel itself.
fn brightness(picture: &Texture, x: u32, y: u32) -> f64 {
    let size = Vec2::new(picture.width as f32, picture.height as f32);
    let quarters = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
    let look_up = |(dx, dy)| {
        let uv = Vec2::new(x as f32 + dx, y as f32 + dy) / size;
        f64::from(luminance(picture.sample(uv, WRAP).truncate()).max(0.0))
    };
    quarters.into_iter().map(look_up).sum::<f64>() / 4.0
}

/// The texels of `n` that make up cell `i` of `cells`.
fn span(i: u32, cells: u32, n: u32) -> std::ops::Range<u32> {
    let at = |k: u32| (u64::from(k) * u64::from(n) / u64::from(cells)) as u32;
    at(i)..at(i + 1).max(at(i) + 1)
}
