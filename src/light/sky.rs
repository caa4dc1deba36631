//! The sky: radiance by direction, and sampling where its picture is bright.
//!
//! A sky is split in two. What is bright and small in its picture, a sun, lamps, the glow around either, is *sharp*: direct light finds
//! it by brightness samples, as it finds lights. The rest is *smooth*, and found well enough by rays over the hemisphere that escape,
//! which block after block shares; a constant sky is all smooth. Of each cell of the picture a share is the one and the rest the other,
//! so that both add up to the sky.

use crate::color::{Rgb, luminance};
use crate::sample::Discrete;
use crate::scene::environment::WRAP;
use crate::scene::{Environment, Scene, Texture};
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, BTreeSet};
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
    /// What is sharp of them, sampled on its own: one table for each sky of which something is.
    sharp: Vec<Sharp>,
    sharp_choice: Option<Discrete>,
}

/// A sky's picture is sharp where it is brighter than this, over the mean of the smooth rest all round.
const SHARP: f64 = 4.0;

/// Rounds in which the mean of the rest is found; what is sharp all in all leaves no rest.
const SHARP_ROUNDS: usize = 64;

/// What is sharp of a sky's picture.
struct Sharp {
    table: Table,
    /// The share of each cell, row by row.
    share: Vec<f32>,
    /// All of it, cells that lie together as one.
    beams: Vec<Beam>,
}

/// Light from about one direction.
#[derive(Clone, Copy, Default)]
struct Beam {
    /// Illuminance across it [lx].
    illuminance: Rgb,
    /// Mean direction, not unit.
    towards: Vec3,
}

/// Beams of one picture, at most.
const MOST_BEAMS: usize = 256;

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
        let pictures = environment.each().enumerate();
        let pictures: Vec<Cells> = pictures.filter_map(|(k, sky)| Cells::new(scene, k, sky)).collect();
        let tables: Vec<Table> = pictures.iter().filter_map(Cells::table).collect();
        let sharp: Vec<Sharp> = pictures.iter().filter_map(|cells| Sharp::new(scene, environment, cells)).collect();
        let power = |table: &Table| {
            let factor = environment.each().nth(table.sky).map_or(0.0, |sky| luminance(sky.radiance));
            f64::from(factor) * table.rows.total() / f64::from(table.size[0] * table.size[1])
        };
        let choice = |powers: Vec<f64>| if powers.len() > 1 { Discrete::new(powers) } else { None };
        Self {
            environment: environment.clone(),
            choice: choice(tables.iter().map(power).collect()),
            tables,
            sharp_choice: choice(sharp.iter().map(|sharp| power(&sharp.table)).collect()),
            sharp,
        }
    }

    /// Radiance from the unit direction `d` [nit].
    pub fn radiance(&self, scene: &Scene, d: Vec3) -> Rgb {
        self.environment.radiance_from(scene, d)
    }

    /// True where brightness is worth sampling.
    pub fn has_picture(&self) -> bool {
        !self.tables.is_empty()
    }

    /// True where some of it is bright and small.
    pub fn is_sharp(&self) -> bool {
        !self.sharp.is_empty()
    }

    /// Radiance from the unit direction `d` [nit] without what is sharp: the part that is left to rays over the hemisphere.
    pub fn smooth(&self, scene: &Scene, d: Vec3) -> Rgb {
        let whole = self.environment.radiance_from(scene, d);
        if self.sharp.is_empty() { whole } else { (whole - self.sharp(scene, d)).max(Rgb::ZERO) }
    }

    /// Radiance from the unit direction `d` [nit] of what is sharp.
    pub fn sharp(&self, scene: &Scene, d: Vec3) -> Rgb {
        let of = |sharp: &Sharp| {
            let sky = self.environment.each().nth(sharp.table.sky)?;
            let share = sharp.share[sharp.table.cell(sky, d)];
            (share > 0.0).then(|| sky.own_radiance(scene, d) * share)
        };
        self.sharp.iter().filter_map(of).sum()
    }

    /// What arrives of what is sharp with nothing in its way [lx]: about the geometric normal `normal`, and about `shown` as far as it
    /// comes from before the former.
    pub fn sharp_irradiance(&self, normal: Vec3, shown: Vec3) -> [Rgb; 2] {
        let mut sum = [Rgb::ZERO; 2];
        for beam in self.sharp.iter().flat_map(|sharp| &sharp.beams) {
            let cos = normal.dot(beam.towards);
            if cos > 0.0 {
                sum[0] += beam.illuminance * cos;
                sum[1] += beam.illuminance * shown.dot(beam.towards).max(0.0);
            }
        }
        sum
    }

    /// A direction in proportion to the brightness of what is sharp, and its density [1/sr]; the third number chooses among several
    /// pictures.
    pub fn sample_sharp(&self, u: [f32; 3]) -> Option<(Vec3, f32)> {
        let k = self.sharp_choice.as_ref().map_or(0, |choice| choice.sample(u[2]).0);
        let table = &self.sharp.get(k)?.table;
        let d = table.sample(self.environment.each().nth(table.sky)?, [u[0], u[1]])?;
        let pdf = self.pdf_among(self.sharp.iter().map(|sharp| &sharp.table), self.sharp_choice.as_ref(), d);
        (pdf > 0.0).then_some((d, pdf))
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
        self.pdf_among(self.tables.iter(), self.choice.as_ref(), d)
    }

    fn pdf_among<'a>(&self, tables: impl Iterator<Item = &'a Table>, choice: Option<&Discrete>, d: Vec3) -> f32 {
        let part = |(k, table): (usize, &Table)| {
            let sky = self.environment.each().nth(table.sky)?;
            Some(choice.map_or(1.0, |choice| choice.pdf(k) as f32) * table.pdf(sky, d))
        };
        tables.enumerate().filter_map(part).sum()
    }
}

impl Sharp {
    /// Of the picture in `cells`, of one of the skies of `environment`; `None` where nothing is.
    fn new(scene: &Scene, environment: &Environment, cells: &Cells) -> Option<Self> {
        let threshold = cells.threshold();
        // What is left is as bright as what lies around: its shadows would be as sharp, and the gather can't show them.
        let share = |mean: f64| if mean > threshold { 1.0 - threshold / (SHARP * mean) } else { 0.0 };
        let table = cells.weighed(|mean| mean * share(mean))?;
        let share: Vec<f32> = cells.mean.iter().map(|mean| share(*mean) as f32).collect();
        let beams = beams(scene, environment.each().nth(cells.sky)?, &table, &share);
        Some(Self { table, share, beams })
    }
}

/// The light of the shares of cells of the picture of `sky`, cells that lie together in squares as one beam.
fn beams(scene: &Scene, sky: &Environment, table: &Table, share: &[f32]) -> Vec<Beam> {
    let columns = table.size[0] as usize;
    let cells = || share.iter().enumerate().filter(|(_, share)| **share > 0.0);
    let square = |cell: usize, level: u32| ((cell / columns) >> level, (cell % columns) >> level);
    let count = |level: u32| cells().map(|(cell, _)| square(cell, level)).collect::<BTreeSet<_>>().len();
    let level = (0..16).find(|level| count(*level) <= MOST_BEAMS).unwrap_or(16);
    let mut squares: BTreeMap<(usize, usize), (Rgb, Vec3, f32)> = BTreeMap::new();
    for (cell, share) in cells() {
        let (light, towards, weight) = squares.entry(square(cell, level)).or_default();
        table.each_part(scene, sky, cell, |direction, solid_angle| {
            let part = sky.own_radiance(scene, direction) * (*share * solid_angle);
            *light += part;
            *towards += direction * luminance(part);
            *weight += luminance(part);
        });
    }
    let beam = |(illuminance, towards, weight): (Rgb, Vec3, f32)| Beam { illuminance, towards: towards / weight };
    squares.into_values().filter(|square| square.2 > 0.0).map(beam).collect()
}

/// Mean brightness of a picture by cells of equal angles.
struct Cells {
    /// Whose picture it is, in the order of [`Environment::each`].
    sky: usize,
    size: [u32; 2],
    /// Row by row.
    mean: Vec<f64>,
}

impl Cells {
    /// Of the picture of `sky`, number `number`; `None` where there is none.
    fn new(scene: &Scene, number: usize, sky: &Environment) -> Option<Self> {
        let picture = &scene.textures[sky.texture?];
        let size = [TABLE[0].min(picture.width), TABLE[1].min(picture.height)];
        let mean = |x: u32, y: u32| {
            let mut sum = 0.0f64;
            let rows = span(y, size[1], picture.height);
            for py in rows.clone() {
                for px in span(x, size[0], picture.width) {
                    sum += brightness(picture, px, py);
                }
            }
            let count = rows.len() as f64 * span(x, size[0], picture.width).len() as f64;
            sum / count.max(1.0)
        };
        let mean = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
        Some(Self { sky: number, size, mean })
    }

    /// Each row's solid angle, to scale.
    fn sin(&self, row: usize) -> f64 {
        f64::from((PI * (row as f32 + 0.5) / self.size[1] as f32).sin())
    }

    /// The choice of cells in proportion to brightness times solid angle; `None` where all is black.
    fn table(&self) -> Option<Table> {
        self.weighed(|mean| mean)
    }

    /// The same by a `weight` that a cell's brightness has.
    fn weighed(&self, weight: impl Fn(f64) -> f64) -> Option<Table> {
        let rows = self.mean.chunks(self.size[0] as usize).enumerate();
        let row = |(y, row): (usize, &[f64])| Discrete::new(row.iter().map(|mean| weight(*mean) * self.sin(y)));
        let cells: Vec<Option<Discrete>> = rows.map(row).collect();
        let rows = Discrete::new(cells.iter().map(|row| row.as_ref().map_or(0.0, Discrete::total)))?;
        Some(Table { sky: self.sky, size: self.size, rows, cells })
    }

    /// Brightness beyond which the picture is sharp: [`SHARP`] times the mean of the picture all round with what is brighter cut
    /// off there. It falls to 0 where all the light comes from a small part of the sky.
    fn threshold(&self) -> f64 {
        let width = self.size[0] as usize;
        let whole: f64 = (0..self.size[1] as usize).map(|y| self.sin(y)).sum::<f64>() * width as f64;
        let mean_below = |threshold: f64| {
            let rows = self.mean.chunks(width).enumerate();
            rows.map(|(y, row)| row.iter().map(|m| m.min(threshold)).sum::<f64>() * self.sin(y)).sum::<f64>() / whole
        };
        let mut threshold = f64::INFINITY;
        for _ in 0..SHARP_ROUNDS {
            let next = SHARP * mean_below(threshold);
            if next > 0.999 * threshold {
                return threshold.min(next);
            }
            threshold = next;
        }
        0.0
    }
}

impl Table {
    /// A direction of its picture.
    fn sample(&self, sky: &Environment, u: [f32; 2]) -> Option<Vec3> {
        let (y, v) = self.rows.sample(u[0]);
        let (x, u) = self.cells[y].as_ref()?.sample(u[1]);
        Some(sky.direction(Vec2::new((x as f32 + u) / self.size[0] as f32, (y as f32 + v) / self.size[1] as f32)))
    }

    /// Density [1/sr] of [`sample`](Self::sample).
    fn pdf(&self, sky: &Environment, d: Vec3) -> f32 {
        let (x, y) = self.place(sky, d);
        let cell = self.cells[y].as_ref().map_or(0.0, |row| row.pdf(x));
        let probability = (self.rows.pdf(y) * cell) as f32;
        let sin = (PI * sky.uv(d).y).sin().max(1e-6);
        probability * (self.size[0] * self.size[1]) as f32 / (TAU * PI * sin)
    }

    /// Calls `add` with directions of the cell number `cell`, and the solid angle of each [sr]: the quarters of the picture's texels,
    /// over each of which what is looked up changes linearly along both axes.
    fn each_part(&self, scene: &Scene, sky: &Environment, cell: usize, mut add: impl FnMut(Vec3, f32)) {
        let Some(picture) = sky.texture.map(|t| &scene.textures[t]) else { return };
        let (x, y) = ((cell % self.size[0] as usize) as u32, (cell / self.size[0] as usize) as u32);
        let size = Vec2::new(picture.width as f32, picture.height as f32);
        let part = TAU * PI / (4.0 * size.element_product());
        for py in span(y, self.size[1], picture.height) {
            for px in span(x, self.size[0], picture.width) {
                for (dx, dy) in QUARTERS {
                    let uv = Vec2::new(px as f32 + dx, py as f32 + dy) / size;
                    add(sky.direction(uv), part * (PI * uv.y).sin());
                }
            }
        }
    }

    /// Column and row of the cell that the direction `d` falls into.
    fn place(&self, sky: &Environment, d: Vec3) -> (usize, usize) {
        let uv = sky.uv(d);
        let x = ((uv.x.rem_euclid(1.0) * self.size[0] as f32) as u32).min(self.size[0] - 1);
        let y = ((uv.y * self.size[1] as f32) as u32).min(self.size[1] - 1);
        (x as usize, y as usize)
    }

    /// Number of the cell that the direction `d` falls into.
    fn cell(&self, sky: &Environment, d: Vec3) -> usize {
        let (x, y) = self.place(sky, d);
        y * self.size[0] as usize + x
    }
}

/// Middles of the quarters of a texel.
const QUARTERS: [(f32, f32); 4] = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];

/// Mean brightness of a texel's square as it is looked up, that is with its neighbours blended in: beside a small sun that is
/// far more than the texel itself.
fn brightness(picture: &Texture, x: u32, y: u32) -> f64 {
    let size = Vec2::new(picture.width as f32, picture.height as f32);
    let look_up = |(dx, dy)| {
        let uv = Vec2::new(x as f32 + dx, y as f32 + dy) / size;
        f64::from(luminance(picture.sample(uv, WRAP).truncate()).max(0.0))
    };
    QUARTERS.into_iter().map(look_up).sum::<f64>() / 4.0
}

/// The texels of `n` that make up cell `i` of `cells`.
fn span(i: u32, cells: u32, n: u32) -> std::ops::Range<u32> {
    let at = |k: u32| (u64::from(k) * u64::from(n) / u64::from(cells)) as u32;
    at(i)..at(i + 1).max(at(i) + 1)
}
