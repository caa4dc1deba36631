//! Progressive photon mapping: light is sent out from what shines and left where it lands, and walks from the sensor read it there
//! (Jensen 1996, "Global Illumination using Photon Maps"; Hachisuka, Ogaki, Jensen 2008, "Progressive Photon Mapping").
//!
//! A pass sends new photons, reads them within a radius, and forgets them; the radius shrinks from pass to pass, so that the mean of all
//! passes tends to the light as it is (Knaus, Zwicker 2011, "Progressive Photon Mapping: A Probabilistic Approach").
//!
//! A path from a light to the sensor is counted once, by the last bounces on its way (L: light, S: mirror or glass, D: anything else, x: the
//! first *matte* vertex that the sensor's walk comes to over mirrors, glass and gloss):
//!
//! | way to x | found by |
//! |---|---|
//! | L x | a place drawn on a light, or met by the walk's own next ray |
//! | L S+ x | photons within the radius at x, of those that came so; on texels, which photon hits which texel, without a radius |
//! | L ... D S* x | a ray drawn at x, over mirrors and glass; where it comes to a matte vertex, all photons within the radius there |
//!
//! Photons over mirrors and glass alone are aimed at what sends them there ([`aim`]): unaimed, most end at their first surface. Several
//! walks from each pixel read the photons of one pass, which cost more than a walk.
//!
//! A vertex is matte where no direction stands out in what it reflects ([`is_matte`]); at others the walk goes on as a path does, and so
//! it does close to x, where a radius would show. Where media scatter, vertices lie in space, and photons are read within a ball (Jensen,
//! Christensen 1998).
//!
//! Bias: light is spread over the radius, and where the disc around a place reaches over the edge of its surface, what is read there is too
//! dark, by up to a half on the edge itself; both vanish with the radius. Where the ball reaches out of a medium or through a surface,
//! the walk goes on instead, but for light over mirrors and glass alone. Light is never read through
//! walls: only photons on surfaces that face the same way, close to the plane, count.
//!
//! Limits: light over mirrors and glass from points, spots and sharp suns onto glossy surfaces is found as little as by paths. Surfaces
//! that don't cast meet no photons, and get no light over mirrors and glass straight from lights.

mod aim;
mod caustics;
mod map;
mod refuse;
mod shoot;
mod walk;

pub use caustics::{Caustics, caustics};

use super::emit::Sources;
use super::{Integrator, Kind, Vertex, World};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::sample::{Drawn, sequence::Stage};
use crate::scatter::Transport;
use crate::sensor::{Film, Sensor, Start};
use aim::Aim;
use map::{Map, Photon};
use rayon::prelude::*;
use shoot::{Lamps, Landing, Only, Shot, has_mirrors, shoot, take_aim};
use std::f32::consts::PI;

/// How photons are sent and read.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhotonParams {
    /// Photons a pass; none: by the sensor's pixels.
    pub photons: Option<u32>,
    /// The radius of the first pass [m]; none: such that it holds a few photons.
    pub radius: Option<f32>,
    /// Walks from each pixel that read the photons of one pass, and count as so many samples; none: [`PhotonParams::WALKS`].
    pub walks: Option<u32>,
    /// Reflections counted, 0: direct light only. None: all.
    pub max_bounces: Option<u32>,
    pub seed: u32,
}

impl PhotonParams {
    /// Walks a pixel and pass: photons of a pass cost about as much as these.
    pub const WALKS: u32 = 4;

    /// Of `samples`, how many share a pass, so that there are at least four passes, and all that are asked for.
    pub fn walks_of(samples: u32) -> u32 {
        (1..=Self::WALKS).rev().find(|walks| samples.is_multiple_of(*walks) && samples / walks >= 4).unwrap_or(1)
    }
}

/// Photon mapping, pass by pass.
pub struct Photons<'a> {
    world: &'a World<'a>,
    sensor: &'a dyn Sensor,
    params: PhotonParams,
    sources: Sources,
    /// Nowhere, and at what sends light over mirrors and glass alone, once it was learnt.
    even: Aim,
    aim: Option<Aim>,
    /// Radii of the first pass [m], by map, once there were photons to choose them by.
    first: [Option<f32>; MAPS],
}

/// What was left on surfaces, of all ways and of those over mirrors and glass alone, and the same of media.
struct Maps {
    all: Map,
    caustic: Map,
    all_in_media: Map,
    caustic_in_media: Map,
}

const MAPS: usize = 4;

/// Bounds on the photons of a pass.
const LEAST_PHOTONS: usize = 1 << 15;
const MOST_PHOTONS: usize = 1 << 18;

/// Photons over mirrors and glass alone, over those on all ways.
const CAUSTIC_PHOTONS: f32 = 3.0;

/// Photons that the median photon has within the first radius, of all and of those over mirrors and glass.
const NEIGHBOURS: [usize; MAPS] = [12, 150, 16, 150];

/// The share of the variance that a radius keeps from pass to pass: Knaus' and Zwicker's alpha.
const ALPHA: f64 = 2.0 / 3.0;

/// The least radius, over that of a ball around the scene: numbers of single precision tell no less.
const LEAST_RADIUS: f32 = 1e-6;

/// The radius of a map that no photon has come to yet, over that of a ball around the scene.
const UNKNOWN_RADIUS: f32 = 1e-2;

/// Pixels that are estimated before the caller is asked whether to stop.
const AT_ONCE: usize = 64;

/// Density over that of a matte surface, beyond which a direction stands out: GGX of a roughness of about 0.5.
const MATTE_PEAK: f32 = 4.0;

/// Mean cosine of phase functions, beyond which straight on stands out.
const MATTE_PHASE: f32 = 0.75;

impl<'a> Photons<'a> {
    /// Prepares the photons of `world`, for what `sensor` measures.
    ///
    /// # Errors
    /// `Unsupported` where the scene holds portals, lights that are linked to some surfaces, or media that shine; `Invalid` where the radius
    /// is no length, or there are no photons.
    pub fn new(world: &'a World<'a>, sensor: &'a dyn Sensor, params: PhotonParams) -> Result<Self> {
        refuse::check(world, &params)?;
        let (sources, even) = (Sources::new(world), Aim::even());
        Ok(Self { sources, even, aim: None, world, sensor, params, first: [None; MAPS] })
    }

    /// Photons of a pass.
    fn count(&self) -> u32 {
        let by_pixels = (2 * self.sensor.len()).clamp(LEAST_PHOTONS, MOST_PHOTONS);
        self.params.photons.unwrap_or(by_pixels as u32)
    }

    /// The maps of pass `index`, from 0, of photons on ways of all kinds and over mirrors and glass alone.
    fn maps(&mut self, everything: Vec<Photon>, caustic: Vec<Photon>, index: u64) -> Maps {
        let scale = self.sources.bounds().1;
        let least = LEAST_RADIUS * scale;
        let mut map = |k: usize, photons: Vec<Photon>| {
            let chosen = || map::radius_of(&photons, NEIGHBOURS[k]);
            let first = self.first[k].or(self.params.radius).or_else(chosen).map(|radius| radius.clamp(least, scale));
            self.first[k] = first;
            let dimensions = if k < 2 { 2.0 } else { 3.0 };
            let shrunk = shrink(index, dimensions) * f64::from(first.unwrap_or(UNKNOWN_RADIUS * scale));
            Map::new(photons, (shrunk as f32).max(least))
        };
        let apart = |photons: Vec<Photon>| -> (Vec<Photon>, Vec<Photon>) {
            photons.into_iter().partition(Photon::is_in_medium)
        };
        let ((all_within, all_on), (within, on)) = (apart(everything), apart(caustic));
        Maps {
            all: map(0, all_on),
            caustic: map(1, on),
            all_in_media: map(2, all_within),
            caustic_in_media: map(3, within),
        }
    }

    /// Sends out the photons of pass `index`: those on ways of all kinds, and those over mirrors and glass alone.
    fn shoot(&mut self, index: u64, progress: &dyn Progress) -> Result<(Shot, Shot)> {
        let most = self.params.max_bounces.map(|most| most.saturating_add(1));
        let (world, sources, seed) = (self.world, &self.sources, self.params.seed);
        if self.aim.is_none() {
            let is_kept = |landing: &Landing| !landing.vertex.is_delta();
            self.aim = Some(take_aim(world, sources, (Only::Single, most), seed, progress, is_kept)?);
        }
        let send = |only: Only, aim: &Aim, count: u32| {
            shoot(world, Lamps { sources, aim }, self.sensor, count, (only, most), (seed, index), progress)
        };
        let everything = send(Only::Everything, &self.even, self.count())?;
        let caustic = match self.aim.as_ref().filter(|_| has_mirrors(world.scene)) {
            Some(aim) => send(Only::Single, aim, (self.count() as f32 * CAUSTIC_PHOTONS) as u32)?,
            None => Shot::default(),
        };
        Ok((everything, caustic))
    }
}

/// The factor on the radius in pass `index`, from 0, of kernels of so many dimensions.
fn shrink(index: u64, dimensions: f64) -> f64 {
    let product: f64 = (1..=index).map(|k| (k as f64 + ALPHA) / (k as f64 + 1.0)).product();
    product.powf(dimensions.recip())
}

impl Integrator for Photons<'_> {
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
        let walks = u64::from(self.params.walks.unwrap_or(PhotonParams::WALKS).max(1));
        let index = film.passes() / walks;
        let (everything, caustic) = self.shoot(index, progress)?;
        let maps = self.maps(everything.photons, caustic.photons, index);
        let mut values = vec![Rgb::ZERO; self.sensor.len()];
        values.par_chunks_mut(AT_ONCE).enumerate().try_for_each(|(chunk, values)| {
            progress.check()?;
            for (k, value) in values.iter_mut().enumerate() {
                let estimate = |walk| self.estimate(chunk * AT_ONCE + k, index * walks + walk, &maps);
                *value = (0..walks).map(estimate).sum::<Rgb>() / walks as f32;
            }
            Ok(())
        })?;
        for (pixel, irradiance) in caustic.landed {
            values[pixel as usize] += irradiance;
        }
        film.add_mean(&values, walks);
        Ok(())
    }
}

impl Photons<'_> {
    fn estimate(&self, pixel: usize, walk: u64, maps: &Maps) -> Rgb {
        let mut numbers = Drawn::new(self.params.seed, Stage::Walk, pixel as u64, walk);
        let Some(start) = self.sensor.start(pixel, &mut numbers) else { return Rgb::ZERO };
        let limit = self.params.max_bounces.map(|most| match start {
            // What a camera sees was reflected once to it already.
            Start::Ray(_) => most.saturating_add(1),
            Start::Point(_) => most,
        });
        walk::trace(self.world, start, maps, limit, &mut numbers)
    }
}

/// True where no direction stands out in what `vertex` scatters, so that light may be read from photons around it.
fn is_matte(vertex: &Vertex) -> bool {
    match &vertex.kind {
        Kind::Medium(phase) => phase.g.abs() <= MATTE_PHASE,
        Kind::Surface(on) => {
            let normal = on.point.shading;
            let mirrored = normal * (2.0 * normal.dot(vertex.back)) - vertex.back;
            !on.bsdf.transmits() && vertex.pdf(mirrored, Transport::Radiance) <= MATTE_PEAK / PI
        }
    }
}
