//! Ray tracing: at each surface light straight from what shines, and the reflected and the refracted ray, as a tree (Whitted 1980, "An
//! Improved Illumination Model for Shaded Display"). Light that goes another way than over mirrors and glass is left out.

use super::direct::Finder;
use super::vertex::Vertex;
use super::world::{World, attenuation};
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::scatter::Transport;
use crate::sensor::Start;
use crate::trace::Ray;
use std::f32::consts::PI;

/// Levels of the tree, at most, unless fewer are asked for: between two panes of glass it doubles with each.
const MOST_LEVELS: u32 = 16;

/// Branches that carry less than this share of the light are cut off.
const LEAST_SHARE: f32 = 1e-3;

/// What `start` measures over `most` mirrors at most.
pub fn trace(world: &World, start: Start, most: Option<u32>, numbers: &mut impl Numbers) -> Rgb {
    let levels = most.unwrap_or(MOST_LEVELS).min(MOST_LEVELS);
    match start {
        Start::Ray(ray) => follow(world, &ray, Rgb::ONE, Rgb::ZERO, levels, numbers),
        // A receiver on a surface gathers what shines on it, and mirrors send it nothing that this method could find.
        Start::Point(point) => lit(world, &world.receiver(point), numbers) * PI,
    }
}

/// The light that comes along `ray` and carries the share `weight`, through what absorbs `absorption` [1/m].
fn follow(world: &World, ray: &Ray, weight: Rgb, absorption: Rgb, levels: u32, numbers: &mut impl Numbers) -> Rgb {
    let (hit, tint) = world.closest(ray);
    let t = hit.map_or(f32::INFINITY, |hit| hit.t);
    let mut sum = Rgb::ZERO;
    world.lamps(ray, t, numbers, |_, distance, radiance| sum += radiance * attenuation(absorption, distance));
    let Some(hit) = hit else { return weight * (sum + tint * world.met_beyond(None, ray.direction)) };
    let vertex = world.vertex(&hit, -ray.direction);
    let dimmed = tint * if absorption == Rgb::ZERO { Rgb::ONE } else { attenuation(absorption, t) };
    let here = world.met(None, &hit, &vertex) + lit(world, &vertex, numbers);
    let mut whole = weight * (sum + dimmed * here);
    if levels > 0 {
        whole += branches(world, &vertex, weight * dimmed, absorption, levels - 1, numbers);
    }
    whole
}

/// Light at `vertex` straight from what shines. A constant sky, which nothing draws, is looked for in one direction.
fn lit(world: &World, vertex: &Vertex, numbers: &mut impl Numbers) -> Rgb {
    let drawn = world.drawn(vertex, Finder::Drawing, numbers);
    let Some(sky) = world.lights.sky.as_ref().filter(|sky| !sky.has_picture()) else { return drawn };
    let Some(onward) = vertex.go_on(Transport::Radiance, numbers).filter(|onward| onward.pdf > 0.0) else {
        return drawn;
    };
    let from = vertex.origin(world.tracer, onward.direction);
    let passing = world.passing(from, onward.direction, f32::INFINITY, None, numbers);
    drawn + onward.weight * passing * sky.radiance(world.scene, onward.direction)
}

fn branches(
    world: &World,
    vertex: &Vertex,
    weight: Rgb,
    absorption: Rgb,
    levels: u32,
    numbers: &mut impl Numbers,
) -> Rgb {
    let mut sum = Rgb::ZERO;
    for onward in vertex.mirrors(Transport::Radiance) {
        let carried = weight * onward.weight;
        if carried.max_element() < LEAST_SHARE {
            continue;
        }
        let origin = vertex.origin(world.tracer, onward.direction);
        let inside = if onward.transmitted { world.absorption(vertex, onward.direction) } else { absorption };
        sum += follow(world, &Ray { origin, direction: onward.direction }, carried, inside, levels, numbers);
    }
    sum
}
