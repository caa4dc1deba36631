//! Methods other than radiosity: each measures the same light by a camera's pixels or an atlas' texels, with full materials.
//!
//! All of them walk through one [`World`]. A method makes passes: each estimates every pixel once, independently of the others
//! unless it says otherwise, so that a film tells the noise.

mod baked;
pub mod bidirectional;
mod direct;
pub mod emit;
mod lamps;
pub mod metropolis;
mod path;
pub mod photon;
mod vertex;
mod whitted;
mod world;

pub use lamps::Lamp;
pub use vertex::{Kind, OnSurface, Onward, Vertex};
pub use world::World;

use crate::Result;
use crate::color::Rgb;
use crate::load::baked::BakedLight;
use crate::progress::Progress;
use crate::sample::{Drawn, sequence::Stage};
use crate::sensor::{Film, Sensor, Start};
use rayon::prelude::*;

/// A way to estimate what a sensor measures.
pub trait Integrator {
    /// Adds one more estimate of every pixel to `film`; what it counts on the way are pixels.
    ///
    /// # Errors
    /// `Cancelled`; then `film` is as it was.
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()>;
}

/// A bake as a camera sees it.
pub struct BakedView<'a> {
    pub world: &'a World<'a>,
    pub sensor: &'a dyn Sensor,
    pub light: &'a BakedLight,
    /// By a final gather.
    pub gathers: bool,
    pub seed: u32,
}

/// What one walk from each pixel tells, by itself.
pub struct Pixelwise<'a> {
    pub world: &'a World<'a>,
    pub sensor: &'a dyn Sensor,
    pub method: Walk,
    /// Reflections counted, 0: direct light only. None: all.
    pub max_bounces: Option<u32>,
    pub seed: u32,
}

/// A method whose pixels know nothing of each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// Path tracing.
    Path,
    /// Ray tracing: light straight from what shines, and mirrors and glass.
    Ray,
}

/// Pixels that are estimated before the caller is asked whether to stop.
const AT_ONCE: usize = 64;

impl Integrator for Pixelwise<'_> {
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
        each(self.sensor, self.seed, film, progress, |start, numbers| match self.method {
            Walk::Path => path::trace(self.world, start, self.max_bounces, numbers),
            Walk::Ray => whitted::trace(self.world, start, self.max_bounces, numbers),
        })
    }
}

impl Integrator for BakedView<'_> {
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
        each(self.sensor, self.seed, film, progress, |start, numbers| match start {
            Start::Ray(ray) => baked::trace(self.world, self.light, &ray, self.gathers, numbers),
            // A texel of a bake would read itself.
            Start::Point(_) => Rgb::ZERO,
        })
    }
}

/// Adds a pass in which `walk` estimates each pixel on its own.
fn each(
    sensor: &dyn Sensor,
    seed: u32,
    film: &mut Film,
    progress: &dyn Progress,
    walk: impl Fn(Start, &mut Drawn) -> Rgb + Sync,
) -> Result<()> {
    let index = film.passes();
    let mut values = vec![Rgb::ZERO; sensor.len()];
    values.par_chunks_mut(AT_ONCE).enumerate().try_for_each(|(chunk, values)| {
        progress.check()?;
        for (k, value) in values.iter_mut().enumerate() {
            let pixel = chunk * AT_ONCE + k;
            let mut numbers = Drawn::new(seed, Stage::Walk, pixel as u64, index);
            *value = sensor.start(pixel, &mut numbers).map_or(Rgb::ZERO, |start| walk(start, &mut numbers));
        }
        progress.advance(values.len() as u64);
        Ok(())
    })?;
    film.add(&values);
    Ok(())
}
