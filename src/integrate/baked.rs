//! A bake seen through a camera: as its pages have it, or by a final gather, which looks from every point of the picture over the
//! hemisphere and reads the pages where rays land (Christensen 1999, "Faster Photon Map Global Illumination"; with radiosity
//! Lischinski et al. 1993): detail finer than a texel comes back.

use super::direct::{Finder, From};
use super::vertex::Vertex;
use super::world::World;
use crate::color::Rgb;
use crate::load::baked::BakedLight;
use crate::sample::Numbers;
use crate::scatter::Transport;
use crate::trace::Ray;

/// What comes along `ray` from a bake [nit].
pub fn trace(world: &World, light: &BakedLight, ray: &Ray, gathers: bool, numbers: &mut impl Numbers) -> Rgb {
    let (hit, tint) = world.closest(ray);
    let t = hit.map_or(f32::INFINITY, |hit| hit.t);
    let mut sum = Rgb::ZERO;
    world.lamps(ray, t, numbers, |_, _, radiance| sum += radiance);
    let Some(hit) = hit else { return sum + tint * world.met_beyond(None, ray.direction) };
    let vertex = world.vertex(&hit, -ray.direction);
    let emitted = if light.holds_emission() && !gathers { Rgb::ZERO } else { world.met(None, &hit, &vertex) };
    let reflected = if gathers { gathered(world, light, vertex, numbers) } else { shown(world, light, &vertex) };
    sum + tint * (emitted + reflected)
}

/// What the page under `vertex` says that it reflects.
fn shown(world: &World, light: &BakedLight, vertex: &Vertex) -> Rgb {
    let Some((on, hit)) = vertex.surface().and_then(|on| Some((on, on.hit?))) else { return Rgb::ZERO };
    let albedo = on.bsdf.diffuse_albedo(on.world_from_local.transpose() * vertex.back);
    let (surface, triangle) = world.tracer.place(hit.triangle);
    // Pages are of fronts; the backs of double-sided surfaces show theirs.
    light.reflected(world.scene, surface, triangle, hit.barycentric.into(), albedo)
}

/// Light straight from what shines, and one ray's worth of what the pages send.
fn gathered(world: &World, light: &BakedLight, vertex: Vertex, numbers: &mut impl Numbers) -> Rgb {
    let mut sum = world.drawn(&vertex, Finder::Both, numbers);
    let Some(onward) = vertex.go_on(Transport::Radiance, numbers) else { return sum };
    let ray = Ray { origin: vertex.origin(world.tracer, onward.direction), direction: onward.direction };
    let from = Some(From { vertex: &vertex, pdf: onward.pdf });
    let (hit, tint) = world.closest(&ray);
    let mut seen = Rgb::ZERO;
    world.lamps(&ray, hit.map_or(f32::INFINITY, |h| h.t), numbers, |lamp, t, radiance| {
        seen += radiance * world.met_lamp(from, lamp, ray.direction, t);
    });
    seen += tint
        * match hit {
            None => world.met_beyond(from, ray.direction),
            Some(hit) => {
                let there = world.vertex(&hit, -ray.direction);
                let emitted = world.met(from, &hit, &there);
                // Radiosity holds what is emitted, which was counted.
                let doubled = if light.holds_emission() { world.met(None, &hit, &there) } else { Rgb::ZERO };
                emitted + (shown(world, light, &there) - doubled).max(Rgb::ZERO)
            }
        };
    sum += onward.weight * seen;
    sum
}
