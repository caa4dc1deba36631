//! Places on lights, as the strategies draw them.

use super::super::emit::{Source, Sources};
use super::super::vertex::Vertex;
use super::Bidirectional;
use super::walk::{Unused, facing};
use crate::color::{Rgb, luminance};
use crate::light::delta::Arrival;
use crate::light::polygon::ball;
use crate::sample::Numbers;
use crate::sample::warp::{cap_pdf, cosine_hemisphere_pdf};
use crate::scatter::Transport;
use crate::scene::LightShape;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Densities about a place on a light, as seen from the second place of a path.
#[derive(Clone, Copy, Debug)]
pub struct Densities {
    /// 1 where a walk may meet it; 0 of points and sharp suns.
    pub may_meet: f32,
    /// Drawn for the second place [1/sr].
    pub drawn: f32,
    /// Set out from [1/sr].
    pub emitted: f32,
    /// Of the second place, by light that sets out there [1/m^2].
    pub second: f32,
}

/// A place on a light that was drawn for a vertex.
#[derive(Clone, Copy, Debug)]
pub struct DrawnLight {
    pub source: Source,
    pub at: Vec3,
    /// Unit, from the vertex.
    pub towards: Vec3,
    /// Light that goes back along the path by it, over its density [nit].
    pub light: Rgb,
}

impl Bidirectional<'_> {
    /// The densities about the place `at` of `source`, in the direction `towards` from `vertex`.
    pub fn end_at(&self, source: Source, at: Vec3, vertex: &Vertex, towards: Vec3) -> Densities {
        let (world, sources) = (self.world, &self.sources);
        let chance = sources.chance(source);
        let cos = vertex.surface().map_or(1.0, |on| on.point.normal.dot(towards).abs());
        let (_, radius) = sources.bounds();
        let across = cos / (PI * radius * radius);
        let here = facing(vertex, at);
        match source {
            Source::Sky => {
                let sky = world.lights.sky.as_ref().filter(|sky| sky.has_picture());
                Densities {
                    may_meet: 1.0,
                    drawn: sky.map_or(0.0, |sky| sky.pdf(towards)),
                    emitted: chance * Sources::sky_pdf(world, towards),
                    second: across,
                }
            }
            Source::Polygon(number) => {
                let tree = &world.lights.polygons;
                let polygon = &tree.polygons[number];
                let kernel = polygon.cosine(-towards) / at.distance_squared(vertex.position);
                let by_area = (polygon.area * kernel).max(f32::MIN_POSITIVE);
                Densities {
                    may_meet: 1.0,
                    drawn: tree.probability(&world.view(vertex), number) / by_area,
                    emitted: chance / by_area,
                    second: Sources::polygon_direction_pdf(polygon, -towards) * here,
                }
            }
            Source::Delta(number) => {
                let light = &world.lights.delta[number];
                let share = world.delta_share(vertex, number);
                let disc = world.disc_pdf(light, vertex.position);
                let drawn = share * disc.unwrap_or(1.0);
                let may_meet = if disc.is_some() { 1.0 } else { 0.0 };
                let (emitted, second) = match light.shape() {
                    LightShape::Directional { .. } => (chance * disc.unwrap_or(1.0), across),
                    LightShape::Spot { outer, .. } => (chance, cap_pdf(outer.cos()) * here),
                    LightShape::Sphere { world_from_unit, .. } => {
                        let (centre, radius) = ball(world_from_unit).unwrap_or((at, 1.0));
                        let cos = (at - centre).dot(-towards) / radius;
                        let kernel = cos.max(f32::MIN_POSITIVE) / at.distance_squared(vertex.position);
                        (chance / (2.0 * TAU * radius * radius * kernel), cosine_hemisphere_pdf(cos) * here)
                    }
                    _ => (chance, (2.0 * TAU).recip() * here),
                };
                Densities { may_meet, drawn, emitted, second }
            }
        }
    }

    /// Draws a place on each kind of light for `vertex`; always as many numbers.
    pub fn draw(&self, vertex: &Vertex, numbers: &mut impl Numbers, mut visit: impl FnMut(DrawnLight)) {
        let lights = self.world.lights;
        if !lights.polygons.is_empty() {
            let (choice, at) = (numbers.next(), numbers.next());
            self.draw_polygon(vertex, choice, at).into_iter().for_each(&mut visit);
        }
        if !lights.delta.is_empty() {
            let (choice, disc) = (numbers.next(), numbers.pair());
            self.draw_delta(vertex, choice, disc).into_iter().for_each(&mut visit);
        }
        if lights.sky.as_ref().is_some_and(|sky| sky.has_picture()) {
            self.draw_sky(vertex, numbers.triple()).into_iter().for_each(&mut visit);
        }
    }

    fn draw_polygon(&self, vertex: &Vertex, choice: f32, at: f32) -> Option<DrawnLight> {
        let world = self.world;
        let tree = &world.lights.polygons;
        let choice = tree.choose(&world.view(vertex), choice)?;
        let polygon = &tree.polygons[choice.polygon];
        let to = polygon.sample([choice.u, at]);
        let way = to - vertex.position;
        let towards = way.try_normalize()?;
        let kernel = polygon.cosine(-towards) / way.length_squared();
        let response = vertex.respond(towards, Transport::Radiance);
        if kernel <= 0.0 || response == Rgb::ZERO {
            return None;
        }
        let from = vertex.shadow_origin(world.tracer, towards);
        let side = if polygon.normal.dot(towards) <= 0.0 { polygon.normal } else { -polygon.normal };
        let way = world.tracer.off_surface(to, side) - from;
        let length = way.length();
        let passing = world.passing(from, way / length, length, None, &mut Unused);
        let radiance = polygon.radiance_towards(world.scene, to, -towards);
        let light = response * radiance * passing * (polygon.area * kernel / choice.probability);
        Some(DrawnLight { source: Source::Polygon(choice.polygon), at: to, towards, light })
    }

    fn draw_delta(&self, vertex: &Vertex, mut u: f32, disc: [f32; 2]) -> Option<DrawnLight> {
        let world = self.world;
        let total: f32 = (0..world.lights.delta.len()).map(|k| world.delta_weight(vertex, k)).sum();
        let mut chosen = None;
        for k in 0..world.lights.delta.len() {
            let share = world.delta_weight(vertex, k) / total;
            if share > 0.0 {
                chosen = Some((k, share));
                if u < share {
                    break;
                }
                u -= share;
            }
        }
        let (k, share) = chosen?;
        let Arrival { towards, distance, illuminance } =
            world.lights.delta[k].arrive(world.scene, vertex.position, disc)?;
        let response = vertex.respond(towards, Transport::Radiance);
        if response == Rgb::ZERO {
            return None;
        }
        let passing = world.arriving(vertex, &Arrival { towards, distance, illuminance }, None, &mut Unused);
        let at = if distance.is_finite() { vertex.position + towards * distance } else { vertex.position };
        Some(DrawnLight { source: Source::Delta(k), at, towards, light: response * illuminance * passing / share })
    }

    fn draw_sky(&self, vertex: &Vertex, u: [f32; 3]) -> Option<DrawnLight> {
        let world = self.world;
        let sky = world.lights.sky.as_ref()?;
        let (towards, pdf) = sky.sample(u)?;
        let response = vertex.respond(towards, Transport::Radiance);
        let radiance = sky.radiance(world.scene, towards);
        if luminance(response * radiance) <= 0.0 {
            return None;
        }
        let origin = vertex.origin(world.tracer, towards);
        let passing = world.passing(origin, towards, f32::INFINITY, None, &mut Unused);
        Some(DrawnLight {
            source: Source::Sky,
            at: vertex.position,
            towards,
            light: response * radiance * passing / pdf,
        })
    }
}
