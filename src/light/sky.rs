//! The sky: radiance by direction, and sampling where its picture is bright.
//!
//! A constant sky is found well enough by the rays of the gather that escape. A sky with a picture is sampled by its
//! brightness too, and the two are combined by the power heuristic (Veach, Guibas 1995).

use crate::color::{Rgb, luminance};
use crate::sample::Discrete;
use crate::scene::environment::WRAP;
use crate::scene::{Environment, Scene, Texture};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Cells of the brightness table, at most, along the equator and from pole to pole.
const TABLE: [u32; 2] = [512, 256];

/// The sky of a scene, ready to be sampled.
pub struct Sky {
    environment: Environment,
    /// One for each sky with a picture.
    tables: Vec<Table>,
    /// The choice among several tables, by their power.
    choice: Option<Discrete>,
}

/// Cells of equal angles, chosen by brightness times solid angle.
struct Table {
    /// Whose picture it is of, in the order of [`Environment::each`].
    sky: usize,
    size: [u32; 2],
    /// The choice of a row, and of a cell in it: two numbers that are spread evenly over the square are spread evenly over the
    /// brightness. None where a row is black.
    rows: Discrete,
    cells: Vec<Option<Discrete>>,
}

impl Sky {
    /// Prepares `environment`; a picture's brightness is tabulated.
    pub fn new(scene: &Scene, environment: &Environment) -> Self {
        let tables: Vec<Table> =
            environment.each().enumerate().filter_map(|(k, sky)| Table::new(scene, k, sky)).collect();
        let power = |table: &Table| {
            let factor = environment.each().nth(table.sky).map_or(0.0, |sky| luminance(sky.radiance));
            f64::from(factor) * table.rows.total() / f64::from(table.size[0] * table.size[1])
        };
        let choice = if tables.len() > 1 { Discrete::new(tables.iter().map(power)) } else { None };
        Self { environment: environment.clone(), tables, choice }
    }

    /// Radiance from the unit direction `d` [nit].
    pub fn radiance(&self, scene: &Scene, d: Vec3) -> Rgb {
        self.environment.radiance_from(scene, d)
    }

    /// True where brightness is worth sampling.
    pub fn has_picture(&self) -> bool {
        !self.tables.is_empty()
    }

    /// A direction in proportion to brightness, and its density [1/sr]; the third number chooses among several pictures.
    pub fn sample(&self, u: [f32; 3]) -> Option<(Vec3, f32)> {
        let k = self.choice.as_ref().map_or(0, |choice| choice.sample(u[2]).0);
        let table = self.tables.get(k)?;
        let d = table.sample(self.environment.each().nth(table.sky)?, [u[0], u[1]])?;
        let pdf = self.pdf(d);
        (pdf > 0.0).then_some((d, pdf))
    }

    /// Density [1/sr] of [`sample`](Self::sample) at the unit direction `d`; 0 for a constant sky.
    pub fn pdf(&self, d: Vec3) -> f32 {
        match (&self.tables[..], &self.choice) {
            ([], _) => 0.0,
            ([table], None) => self.environment.each().nth(table.sky).map_or(0.0, |sky| table.pdf(sky, d)),
            (tables, choice) => {
                let part = |(k, (table, sky)): (usize, (&Table, &Environment))| {
                    choice.as_ref().map_or(0.0, |choice| choice.pdf(k) as f32) * table.pdf(sky, d)
                };
                let skies = tables.iter().filter_map(|table| Some((table, self.environment.each().nth(table.sky)?)));
                skies.enumerate().map(part).sum()
            }
        }
    }
}

impl Table {
    /// The table of the picture of `sky`, number `number`; `None` where there is none, or it is black.
    fn new(scene: &Scene, number: usize, sky: &Environment) -> Option<Self> {
        let picture = &scene.textures[sky.texture?];
        let size = [TABLE[0].min(picture.width), TABLE[1].min(picture.height)];
        let weight = |x: u32, y: u32| {
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
        };
        let cells: Vec<Option<Discrete>> =
            (0..size[1]).map(|y| Discrete::new((0..size[0]).map(|x| weight(x, y)))).collect();
        let rows = Discrete::new(cells.iter().map(|row| row.as_ref().map_or(0.0, Discrete::total)))?;
        Some(Self { sky: number, size, rows, cells })
    }

    /// A direction of its picture.
    fn sample(&self, sky: &Environment, u: [f32; 2]) -> Option<Vec3> {
        let (y, v) = self.rows.sample(u[0]);
        let (x, u) = self.cells[y].as_ref()?.sample(u[1]);
        Some(sky.direction(Vec2::new((x as f32 + u) / self.size[0] as f32, (y as f32 + v) / self.size[1] as f32)))
    }

    /// Density [1/sr] of [`sample`](Self::sample).
    fn pdf(&self, sky: &Environment, d: Vec3) -> f32 {
        let uv = sky.uv(d);
        let x = ((uv.x.rem_euclid(1.0) * self.size[0] as f32) as u32).min(self.size[0] - 1);
        let y = ((uv.y * self.size[1] as f32) as u32).min(self.size[1] - 1);
        let cell = self.cells[y as usize].as_ref().map_or(0.0, |row| row.pdf(x as usize));
        let probability = (self.rows.pdf(y as usize) * cell) as f32;
        let sin = (PI * uv.y).sin().max(1e-6);
        probability * (self.size[0] * self.size[1]) as f32 / (TAU * PI * sin)
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
