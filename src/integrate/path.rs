//! Path tracing: one direction from each vertex, drawn as the surface scatters (Kajiya 1986, "The Rendering Equation"; Veach 1997),
//! light drawn and met at each.

use super::direct::From;
use super::vertex::Vertex;
use super::world::World;
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::scatter::Transport;
use crate::sensor::Start;
use crate::trace::Ray;
use glam::Vec3;
use std::f32::consts::PI;

/// Vertices after which Russian roulette may end a path: before, most of the light is still to come.
const ROULETTE_START: u32 = 4;

/// The least probability of ending a path that roulette decides on: between mirrors that absorb nothing paths would never end.
const LEAST_END: f32 = 0.02;

/// A path under way.
pub(super) struct Walk<'a> {
    pub ray: Ray,
    pub weight: Rgb,
    /// The vertex that the ray left, and the density of its direction; none where it left a camera.
    pub from: Option<(Vertex<'a>, f32)>,
    /// What the medium around absorbs, inside of solids [1/m].
    pub absorption: Rgb,
    /// What refraction has multiplied the weight by: roulette is about light, not about how it is spread.
    spread: f32,
}

impl Walk<'_> {
    /// A walk along `ray`, from a camera.
    pub fn new(ray: Ray, weight: Rgb) -> Self {
        Self { ray, weight, from: None, absorption: Rgb::ZERO, spread: 1.0 }
    }

    /// A walk that is yet to leave a point, with `weight`.
    pub fn at_point(weight: f32) -> Self {
        Self::new(Ray { origin: Vec3::ZERO, direction: Vec3::Z }, Rgb::splat(weight))
    }
}

/// What one path from `start` estimates: radiance of a ray [nit], irradiance of a point [lx]. `most` bounds the reflections counted, 0:
/// direct light only.
pub fn trace(world: &World, start: Start, most: Option<u32>, numbers: &mut impl Numbers) -> Rgb {
    let mut sum = Rgb::ZERO;
    let mut walk = match start {
        Start::Ray(ray) => Some(Walk::new(ray, Rgb::ONE)),
        Start::Point(point) => {
            let receiver = world.receiver(point);
            let fresh = Walk::at_point(PI);
            sum += fresh.weight * world.drawn(&receiver, numbers);
            leave(world, fresh, receiver, numbers)
        }
    };
    // A receiver on a surface reflects nothing itself: what it gets from what others reflect once is its first bounce.
    let first = u32::from(matches!(start, Start::Point(_)));
    let mut vertices = first;
    while let Some(mut at) = walk.take() {
        let travelled = world.travel(&at.ray, at.weight, at.absorption, numbers);
        sum += at.weight * travelled.emitted;
        sum += lamps(world, &at, travelled.t, numbers);
        at.weight *= travelled.weight;
        let from = at.from.as_ref().map(|(vertex, pdf)| From { vertex, pdf: *pdf });
        let Some(vertex) = travelled.vertex else {
            sum += at.weight * world.met_beyond(from, at.ray.direction);
            break;
        };
        if let Some(hit) = vertex.surface().and_then(|on| on.hit) {
            sum += at.weight * world.met(from, &hit, &vertex);
        }
        if most.is_some_and(|most| vertices > most) {
            break;
        }
        vertices += 1;
        sum += at.weight * world.drawn(&vertex, numbers);
        walk = leave(world, at, vertex, numbers).and_then(|next| roulette(next, vertices, numbers));
    }
    if sum.is_finite() { sum } else { Rgb::ZERO }
}

/// What lamps on the way to `t` send.
pub(super) fn lamps(world: &World, walk: &Walk, t: f32, numbers: &mut impl Numbers) -> Rgb {
    let from = walk.from.as_ref().map(|(vertex, pdf)| From { vertex, pdf: *pdf });
    let mut sum = Rgb::ZERO;
    world.lamps(&walk.ray, t, numbers, |lamp, distance, radiance| {
        let dimmed = super::world::attenuation(walk.absorption, distance);
        sum += radiance * dimmed * world.met_lamp(from, lamp, walk.ray.direction, distance);
    });
    sum * walk.weight
}

/// The path `walk`, which came to `vertex`, on its way to the next one.
pub(super) fn leave<'a>(
    world: &World<'a>,
    walk: Walk<'a>,
    vertex: Vertex<'a>,
    numbers: &mut impl Numbers,
) -> Option<Walk<'a>> {
    let onward = vertex.go_on(Transport::Radiance, numbers)?;
    let mut next = Walk {
        ray: Ray { origin: vertex.origin(world.tracer, onward.direction), direction: onward.direction },
        weight: walk.weight * onward.weight,
        from: Some((vertex, onward.pdf)),
        ..walk
    };
    if onward.transmitted
        && let Some(on) = vertex.surface()
    {
        let eta = on.bsdf.eta();
        let into = on.point.normal.dot(onward.direction) < 0.0;
        next.spread *= if into { 1.0 / (eta * eta) } else { eta * eta };
        next.absorption = world.absorption(&vertex, onward.direction);
    }
    (next.weight != Rgb::ZERO).then_some(next)
}

/// Russian roulette by the weight that a path has left: what survives is worth what was given up.
pub(super) fn roulette<'a>(walk: Walk<'a>, vertices: u32, numbers: &mut impl Numbers) -> Option<Walk<'a>> {
    if vertices < ROULETTE_START {
        return Some(walk);
    }
    let survival = (walk.weight / walk.spread).max_element().min(1.0 - LEAST_END);
    (numbers.next() < survival).then(|| Walk { weight: walk.weight / survival, ..walk })
}
