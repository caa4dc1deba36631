//! Walks from the sensor to the places where photons are read.

use super::{Maps, is_matte};
use crate::color::Rgb;
use crate::integrate::direct::{Finder, From};
use crate::integrate::path::{Walk, lamps, leave, roulette};
use crate::integrate::{Kind, Vertex, World};
use crate::sample::Numbers;
use crate::sensor::Start;
use crate::trace::Segment;
use glam::Vec3;
use std::f32::consts::PI;

/// How close to a matte vertex photons are not read, in radii: the walk's next vertex takes its place.
const NEAR: f32 = 2.0;

/// The last vertex that scattered a walk, leaving aside mirrors and glass.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Last {
    /// There was none: light that the walk meets is seen.
    Nothing,
    /// Photons that came to it over mirrors and glass were read there; what shines is not counted after these again.
    Matte,
    Glossy,
}

/// A walk under way.
struct Eye<'a> {
    walk: Walk<'a>,
    last: Last,
    /// A matte vertex was left by a drawn direction: at the next one, photons of all ways are read.
    gathers: bool,
    /// The way since then [m].
    since: f32,
}

/// What one walk from `start` estimates by the photons in `maps`: radiance of a ray [nit], irradiance of a point [lx], but for what
/// photons over mirrors and glass alone bring to the point. `most` bounds how often light is scattered.
pub fn trace(world: &World, start: Start, maps: &Maps, most: Option<u32>, numbers: &mut impl Numbers) -> Rgb {
    let mut sum = Rgb::ZERO;
    let mut eye = match start {
        Start::Ray(ray) => {
            Some(Eye { walk: Walk::new(ray, Rgb::ONE), last: Last::Nothing, gathers: false, since: 0.0 })
        }
        Start::Point(point) => {
            let receiver = world.receiver(point);
            let walk = Walk::at_point(PI);
            sum += walk.weight * world.drawn(&receiver, Finder::Both, numbers);
            let next = leave(world, walk, receiver, numbers);
            next.map(|walk| Eye { walk, last: Last::Matte, gathers: true, since: 0.0 })
        }
    };
    let mut scattered = 0;
    while let Some(mut at) = eye.take() {
        let Some(vertex) = at.travel(world, &mut sum, numbers) else { break };
        if most.is_some_and(|most| scattered >= most) {
            break;
        }
        scattered += 1;
        let left = most.map(|most| most - scattered);
        let vertices = scattered + u32::from(matches!(start, Start::Point(_)));
        eye = at.scatter(world, vertex, maps, left, &mut sum, numbers).and_then(|eye| {
            let walk = roulette(eye.walk, vertices, numbers)?;
            Some(Eye { walk, ..eye })
        });
    }
    if sum.is_finite() { sum } else { Rgb::ZERO }
}

impl<'a> Eye<'a> {
    /// Goes to the next vertex, and adds what shines on the way to `sum`; `None` where the walk leaves the scene.
    fn travel(&mut self, world: &World<'a>, sum: &mut Rgb, numbers: &mut impl Numbers) -> Option<Vertex<'a>> {
        let walk = &mut self.walk;
        let travelled = world.travel(&walk.ray, walk.weight, walk.absorption, numbers);
        let is_after_single = walk.from.as_ref().is_some_and(|(_, pdf)| *pdf == 0.0);
        let counts = !is_after_single || self.last != Last::Matte;
        if counts {
            *sum += lamps(world, walk, travelled.t, numbers);
        }
        walk.weight *= travelled.weight;
        self.since += travelled.t;
        let from = walk.from.as_ref().map(|(vertex, pdf)| From { vertex, pdf: *pdf });
        let Some(vertex) = travelled.vertex else {
            if counts {
                *sum += walk.weight * world.met_beyond(from, walk.ray.direction);
            }
            return None;
        };
        if counts && let Some(hit) = vertex.surface().and_then(|on| on.hit) {
            *sum += walk.weight * world.met(from, &hit, &vertex);
        }
        Some(vertex)
    }

    /// Adds the light at `vertex` that goes back along the walk to `sum`, of photons that were scattered `left` times at most, and goes on
    /// to what isn't known of it yet.
    fn scatter(
        self,
        world: &World<'a>,
        vertex: Vertex<'a>,
        maps: &Maps,
        left: Option<u32>,
        sum: &mut Rgb,
        numbers: &mut impl Numbers,
    ) -> Option<Self> {
        let Self { walk, last, gathers, since } = self;
        if vertex.is_delta() {
            let walk = leave(world, walk, vertex, numbers)?;
            return Some(Self { walk, last, gathers, since });
        }
        let (all, caustic) = match &vertex.kind {
            Kind::Surface(_) => (&maps.all, &maps.caustic),
            Kind::Medium(_) => (&maps.all_in_media, &maps.caustic_in_media),
        };
        let is_matte = is_matte(&vertex);
        let is_far = is_matte && gathers && since >= NEAR * all.radius();
        let reads_all = is_far && (vertex.surface().is_some() || is_ball_whole(world, vertex.position, all.radius()));
        *sum += walk.weight
            * match (reads_all, is_matte) {
                (true, _) => all.read(&vertex, left),
                (false, true) => world.drawn(&vertex, Finder::Both, numbers) + caustic.read(&vertex, left),
                (false, false) => world.drawn(&vertex, Finder::Both, numbers),
            };
        let walk = leave(world, walk, vertex, numbers)?;
        let is_single = walk.from.as_ref().is_some_and(|(_, pdf)| *pdf == 0.0);
        match (is_single, is_matte) {
            (true, _) => Some(Self { walk, last, gathers, since }),
            (false, true) => (!reads_all).then_some(Self { walk, last: Last::Matte, gathers: true, since: 0.0 }),
            (false, false) => Some(Self { walk, last: Last::Glossy, gathers, since }),
        }
    }
}

/// True where the ball of `radius` [m] around a place in a medium reaches neither through surfaces nor out of what scatters: what is cut
/// off holds no photons, and a slab of fog ten radii thick was 3 % too dark. Six feelers along the axes meet any plane in reach.
fn is_ball_whole(world: &World, middle: Vec3, radius: f32) -> bool {
    let reach = 3f32.sqrt() * radius;
    let ends = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]).map(|d| middle + d * reach);
    let segments: Vec<Segment> = ends.map(|to| Segment { from: middle, to }).collect();
    if segments.iter().any(|feeler| world.media.at(feeler.to).scattering == Rgb::ZERO) {
        return false;
    }
    let mut passing = [Rgb::ONE; 6];
    world.tracer.transmittance(&segments, &mut passing);
    passing == [Rgb::ONE; 6]
}
