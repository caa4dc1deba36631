//! Photons on their way from lights to where they are absorbed.

use super::aim::Aim;
use super::map::Photon;
use crate::Result;
use crate::color::Rgb;
use crate::integrate::emit::{Emitted, Source, Sources};
use crate::integrate::{Kind, Vertex, World};
use crate::progress::Progress;
use crate::sample::{Drawn, Numbers, sequence::Stage};
use crate::scatter::Transport;
use crate::scene::{Appearance, Scene};
use crate::sensor::Sensor;
use crate::trace::Ray;
use rayon::prelude::*;

/// What photons left behind.
#[derive(Default)]
pub struct Shot {
    pub photons: Vec<Photon>,
    /// Pixels that lie on surfaces, and what photons over mirrors and glass alone add to their irradiance [lx].
    pub landed: Vec<(u32, Rgb)>,
}

/// Photons that one thread follows before the caller is asked whether to stop.
pub(super) const AT_ONCE: u32 = 1024;

/// Scatterings after which a photon ends whatever it carries: between mirrors that absorb nothing it would never end.
const MOST_BOUNCES: u32 = 1000;

/// Where photons set out: from `sources`, drawn as `aim` says.
#[derive(Clone, Copy)]
pub struct Lamps<'a> {
    pub sources: &'a Sources,
    pub aim: &'a Aim,
}

impl Lamps<'_> {
    /// Light that sets out; `None` where what was drawn sends nothing.
    pub fn emit(&self, world: &World, numbers: &mut impl Numbers) -> Option<Emitted> {
        let (at, weight) = self.aim.draw(numbers);
        let emitted = self.sources.emit_by(world, at)?;
        Some(Emitted { flux: emitted.flux * weight, ..emitted })
    }
}

/// True where something may send light on in one direction.
pub fn has_mirrors(scene: &Scene) -> bool {
    scene.materials.iter().filter_map(|material| material.appearance.as_ref()).any(Appearance::may_be_single)
}

/// Learns where light has to set out for it to come over mirrors and glass alone, on ways of the kind `only`, to what `counts` is
/// true of.
///
/// # Errors
/// `Cancelled`.
pub fn take_aim(
    world: &World,
    sources: &Sources,
    (only, most): (Only, Option<u32>),
    seed: u32,
    progress: &dyn Progress,
    counts: impl Fn(&Landing) -> bool + Sync,
) -> Result<Aim> {
    if sources.is_empty() || !has_mirrors(world.scene) {
        return Ok(Aim::even());
    }
    Aim::learn(seed, progress, |at, numbers| {
        let Some(emitted) = sources.emit_by(world, at) else { return 0.0 };
        let mut sum = 0.0;
        follow(world, &emitted, Way { flux: emitted.flux, most, only }, numbers, |landing| {
            if landing.caustic && counts(&landing) {
                sum += landing.flux.max_element();
            }
        });
        sum
    })
}

/// Sends out `count` photons on ways of the kind `only`, of the run (seed, pass), which are scattered `most` times at most.
///
/// # Errors
/// `Cancelled`.
pub fn shoot(
    world: &World,
    lamps: Lamps,
    sensor: &dyn Sensor,
    count: u32,
    (only, most): (Only, Option<u32>),
    run: (u32, u64),
    progress: &dyn Progress,
) -> Result<Shot> {
    let chunks: Vec<Shot> = (0..count.div_ceil(AT_ONCE))
        .into_par_iter()
        .map(|chunk| {
            progress.check()?;
            let mut shot = Shot { photons: Vec::new(), landed: Vec::new() };
            for k in chunk * AT_ONCE..((chunk + 1) * AT_ONCE).min(count) {
                let mut numbers = numbers(run, only, k);
                let Some(emitted) = lamps.emit(world, &mut numbers) else { continue };
                let way = Way { flux: emitted.flux / count as f32, most, only };
                follow(world, &emitted, way, &mut numbers, |landing| {
                    if only == Only::Everything || landing.caustic {
                        shot.keep(world, sensor, (only, most), &landing);
                    }
                });
            }
            Ok(shot)
        })
        .collect::<Result<_>>()?;
    let photons = chunks.iter().flat_map(|shot| &shot.photons).copied().collect();
    Ok(Shot { photons, landed: chunks.into_iter().flat_map(|shot| shot.landed).collect() })
}

/// What photon `k` of a run draws from.
pub(super) fn numbers((seed, pass): (u32, u64), only: Only, k: u32) -> Drawn {
    Drawn::new(seed, Stage::Photon, 2 * pass + u64::from(only != Only::Everything), u64::from(k))
}

/// A photon that comes to a vertex.
pub struct Landing<'v, 'a> {
    pub vertex: &'v Vertex<'a>,
    /// What lands [lm].
    pub flux: Rgb,
    pub bounces: u32,
    /// It came over mirrors and glass alone, one at least.
    pub caustic: bool,
}

impl Landing<'_, '_> {
    /// The pixel of a sensor on surfaces that it lands in, and what it adds there [lx].
    pub fn on_pixel(&self, sensor: &dyn Sensor) -> Option<(u32, Rgb)> {
        let on = self.vertex.surface()?;
        let pixel = sensor.under(on.hit.as_ref()?)?;
        let area = sensor.area(pixel);
        (area > 0.0).then(|| (pixel as u32, self.flux / area))
    }
}

impl Shot {
    fn keep(&mut self, world: &World, sensor: &dyn Sensor, (only, most): (Only, Option<u32>), landing: &Landing) {
        let Landing { vertex, flux, bounces, .. } = *landing;
        // What a camera sees of it is reflected once more.
        if only != Only::Everything && most.is_none_or(|most| bounces < most) {
            self.landed.extend(landing.on_pixel(sensor));
        }
        if vertex.is_delta() {
            return;
        }
        let (position, towards) = (vertex.position, vertex.back);
        let photon = match &vertex.kind {
            Kind::Surface(on) => Photon { position, towards, normal: on.front_towards(towards), flux, bounces },
            Kind::Medium(_) => {
                let scattering = world.media.at(position).scattering;
                let over = |flux: f32, sigma: f32| if sigma > 0.0 { flux / sigma } else { 0.0 };
                let flux = Rgb::new(over(flux.x, scattering.x), over(flux.y, scattering.y), over(flux.z, scattering.z));
                Photon { position, towards, normal: glam::Vec3::ZERO, flux, bounces }
            }
        };
        if photon.flux.is_finite() {
            self.photons.push(photon);
        }
    }
}

/// How a photon is followed.
#[derive(Clone, Copy)]
pub struct Way {
    /// What it carries [lm].
    pub flux: Rgb,
    /// How often it is scattered, at most.
    pub most: Option<u32>,
    pub only: Only,
}

/// Ways that photons are followed on.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Only {
    Everything,
    /// Over what sends light on in one direction.
    Single,
    /// Over [mirrors and glass](crate::scene::Appearance::is_single) that do nothing else.
    Mirrors,
}

/// Follows light that was `emitted`, and calls `land` at each vertex that it comes to. Russian roulette by the share that is scattered
/// keeps what each photon carries.
pub fn follow(world: &World, emitted: &Emitted, way: Way, numbers: &mut impl Numbers, mut land: impl FnMut(Landing)) {
    let side = if emitted.normal.dot(emitted.direction) < 0.0 { -emitted.normal } else { emitted.normal };
    let is_surface = matches!(emitted.source, Source::Polygon(_));
    let origin = if is_surface { world.tracer.off_surface(emitted.position, side) } else { emitted.position };
    let mut ray = Ray { origin, direction: emitted.direction };
    let (mut flux, mut absorption, mut only_single, mut bounces) = (way.flux, Rgb::ZERO, true, 0);
    loop {
        let travelled = world.travel(&ray, flux, absorption, numbers);
        flux *= travelled.weight;
        if bounces == 0 {
            flux *= Sources::window(world, emitted.source, travelled.t);
        }
        let Some(vertex) = travelled.vertex.filter(|_| flux.max_element() > 0.0) else { return };
        land(Landing { vertex: &vertex, flux, bounces, caustic: only_single && bounces > 0 });
        if bounces >= way.most.unwrap_or(MOST_BOUNCES) {
            return;
        }
        let Some(onward) = vertex.go_on(Transport::Importance, numbers) else { return };
        only_single &= onward.pdf == 0.0 && (way.only != Only::Mirrors || is_single(world, &vertex));
        let sent = flux * onward.weight;
        let survival = (sent.max_element() / flux.max_element()).min(1.0);
        let goes_on = numbers.next() < survival;
        if !goes_on || way.only != Only::Everything && !only_single {
            return;
        }
        flux = sent / survival;
        if onward.transmitted {
            absorption = world.absorption(&vertex, onward.direction);
        }
        ray = Ray { origin: vertex.origin(world.tracer, onward.direction), direction: onward.direction };
        bounces += 1;
    }
}

/// True where the material at `vertex` is all mirror or glass.
fn is_single(world: &World, vertex: &Vertex) -> bool {
    let hit = vertex.surface().and_then(|on| on.hit);
    hit.is_some_and(|hit| {
        let (surface, triangle) = world.tracer.place(hit.triangle);
        world.scene.material(surface, triangle).appearance.as_ref().is_some_and(|look| look.is_single())
    })
}
