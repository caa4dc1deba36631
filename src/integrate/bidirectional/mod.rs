//! Bidirectional path tracing: walks from the sensor and from lights, joined at every place of either (Lafortune, Willems 1993, "Bi-directional
//! Path Tracing"; Veach 1997, chapter 10).
//!
//! A path of k places is found by k + 1 strategies, from the eye's walk that meets a light to the light's walk that lands on a texel. Each
//! finds some light well and some badly: light that comes through a gap of a door is found from the light's side. The power heuristic
//! over all of them (`weight`) leaves what each does well.
//!
//! | file | what it holds |
//! |---|---|
//! | `walk` | both walks, with the densities that either side draws each place with |
//! | `ends` | places on lights: drawn for a vertex, met, and set out from |
//! | `join` | the strategies, and what each adds |
//! | `weight` | the power heuristic |

mod ends;
mod join;
mod walk;
mod weight;

pub use join::{Added, Strategy};

use super::Integrator;
use super::emit::Sources;
use super::world::World;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sample::{Drawn, sequence::Stage};
use crate::scene::LightShape;
use crate::sensor::{Film, Sensor};
use rayon::prelude::*;

/// What one walk from each pixel, and as many from lights, tell together.
pub struct Bidirectional<'a> {
    pub world: &'a World<'a>,
    pub sensor: &'a dyn Sensor,
    pub sources: Sources,
    /// Reflections counted, 0: direct light only. None: all.
    pub max_bounces: Option<u32>,
    pub seed: u32,
    /// How often pixels are walked from.
    pub shares: Shares,
    /// The factor on the density with which light's walks find the sensor by themselves, as weights see it: 1 where a sample's pixel
    /// matters no more than where its light goes.
    pub light_alone: f32,
    /// One strategy by itself, unweighted: for those who want to see what it finds.
    pub only: Option<Strategy>,
}

/// The share of all walks from the sensor that start at a pixel.
#[derive(Clone, Copy, Debug)]
pub enum Shares {
    /// One over the number of pixels.
    Even(f32),
    /// Pixels by area, the sum of which is given [m^2].
    ByArea(f32),
}

/// Numbers for each part of a sample: so that one that takes more doesn't shift those of the others.
pub struct Streams<N> {
    pub eye: N,
    pub light: N,
    pub joins: N,
}

/// Samples that a thread takes at a time, and those that are merged at a time.
const AT_ONCE: usize = 64;
const MERGED: usize = 1 << 14;

impl Shares {
    /// The share of `pixel`.
    pub fn of(self, sensor: &dyn Sensor, pixel: usize) -> f32 {
        match self {
            Self::Even(share) => share,
            Self::ByArea(total) => sensor.area(pixel) / total,
        }
    }
}

impl<'a> Bidirectional<'a> {
    /// Prepares the lights of `world`.
    ///
    /// # Errors
    /// `Unsupported` where the scene holds media, portals, or lights that don't know every surface.
    pub fn new(
        world: &'a World<'a>,
        sensor: &'a dyn Sensor,
        max_bounces: Option<u32>,
        seed: u32,
        method: &str,
    ) -> Result<Self> {
        refuse(world, method)?;
        let shares = Shares::Even(1.0 / sensor.len().max(1) as f32);
        Ok(Self {
            world,
            sensor,
            sources: Sources::new(world),
            max_bounces,
            seed,
            shares,
            light_alone: 1.0,
            only: None,
        })
    }

    fn streams(&self, pixel: usize, index: u64) -> Streams<Drawn> {
        // Three receivers for each pixel.
        let stream = |stage, k: u64| Drawn::new(self.seed, stage, 2 * pixel as u64 + k, index);
        Streams { eye: stream(Stage::Walk, 0), light: stream(Stage::LightWalk, 0), joins: stream(Stage::Walk, 1) }
    }
}

impl Integrator for Bidirectional<'_> {
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
        let (index, pixels) = (film.passes(), self.sensor.len());
        let mut values = vec![Rgb::ZERO; pixels];
        for first in (0..pixels).step_by(MERGED) {
            let end = (first + MERGED).min(pixels);
            let chunks: Vec<usize> = (first..end).step_by(AT_ONCE).collect();
            let added = chunks.par_iter().map(|&chunk| {
                progress.check()?;
                let mut out = Vec::new();
                for pixel in chunk..(chunk + AT_ONCE).min(end) {
                    self.sample(pixel, &mut self.streams(pixel, index), &mut out);
                }
                progress.advance(((chunk + AT_ONCE).min(end) - chunk) as u64);
                Ok(out)
            });
            let added: Vec<Vec<Added>> = added.collect::<Result<_>>()?;
            for (pixel, value) in added.into_iter().flatten() {
                values[pixel] += value / pixels as f32;
            }
        }
        film.add(&values);
        Ok(())
    }
}

/// Refuses what is not followed from both sides.
fn refuse(world: &World, method: &str) -> Result<()> {
    if let Some(medium) = world.media.names().next() {
        let message =
            format!("the method {method} knows no media, which scatter light; choose the method path or photon");
        return Err(Error::unsupported(medium, message));
    }
    for light in &world.scene.lights {
        if matches!(light.shape, LightShape::Portal { .. }) {
            let message =
                format!("the method {method} knows no portals; choose the method path, or take the portal away");
            return Err(Error::unsupported(&light.name, message));
        }
        if !light.links.are_all() {
            let message = format!(
                "the method {method} knows no lights that some surfaces alone are linked to; choose the method path"
            );
            return Err(Error::unsupported(&light.name, message));
        }
    }
    Ok(())
}
