//! Light as it sets out: where paths from lights start, drawn in proportion to power.
//!
//! Light from beyond the scene, of the sky and of suns, sets out from a disc across its direction that covers the whole scene.

use super::world::World;
use crate::color::{Rgb, luminance};
use crate::light::polygon::{Polygon, ball};
use crate::sample::warp::{cap, cap_pdf, cosine_hemisphere, cosine_hemisphere_pdf, disc, frame};
use crate::sample::{Discrete, Numbers};
use crate::scene::{LightShape, Scene};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// All that paths from lights set out from.
pub struct Sources {
    each: Vec<Source>,
    choice: Option<Discrete>,
    /// A ball around all that is lit: middle and radius [m].
    bounds: (Vec3, f32),
}

/// Something that shines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Polygon of the light tree, by number.
    Polygon(usize),
    /// A delta light, by number.
    Delta(usize),
    Sky,
}

/// Light on its way out.
#[derive(Clone, Copy, Debug)]
pub struct Emitted {
    pub source: Source,
    /// Where it sets out [m]: on the light, or on the disc across its direction.
    pub position: Vec3,
    /// The light's normal there; of points and of light from beyond the direction.
    pub normal: Vec3,
    /// Unit, the way that light goes.
    pub direction: Vec3,
    /// Flux that the path carries [lm]: radiance times cosine over all densities.
    pub flux: Rgb,
    /// Density of the place by area [1/m^2], the choice of the source included; of a point light the chance of the choice.
    pub place_pdf: f32,
    /// Density of the direction [1/sr], given the place; of a sharp sun 1. Of light from beyond without the choice of the source.
    pub direction_pdf: f32,
    /// All of its light comes from one place.
    pub is_point: bool,
    /// It comes from beyond the scene: the direction was drawn first.
    pub is_beyond: bool,
    /// It comes in one direction.
    pub is_parallel: bool,
}

impl Sources {
    /// Prepares what `world` holds.
    pub fn new(world: &World) -> Self {
        let bounds = bounds(world.scene);
        let mut each: Vec<Source> = (0..world.lights.polygons.polygons.len()).map(Source::Polygon).collect();
        each.extend((0..world.lights.delta.len()).map(Source::Delta));
        each.extend(world.lights.sky.is_some().then_some(Source::Sky));
        let power = |source: &Source| f64::from(power(world, *source, bounds.1));
        Self { choice: Discrete::new(each.iter().map(power)), each, bounds }
    }

    /// True where nothing sets out.
    pub fn is_empty(&self) -> bool {
        self.choice.is_none()
    }

    /// The disc that light from beyond sets out from: middle of the scene, and radius [m].
    pub fn bounds(&self) -> (Vec3, f32) {
        self.bounds
    }

    /// The chance that `source` is chosen.
    pub fn chance(&self, source: Source) -> f32 {
        let Some(choice) = &self.choice else { return 0.0 };
        let polygons = self.each.iter().take_while(|s| matches!(s, Source::Polygon(_))).count();
        let index = match source {
            Source::Polygon(number) => number,
            Source::Delta(number) => polygons + number,
            Source::Sky => self.each.len() - 1,
        };
        choice.pdf(index) as f32
    }

    /// Light that sets out from one of the sources. `None` where what was drawn sends nothing that way.
    pub fn emit(&self, world: &World, numbers: &mut impl Numbers) -> Option<Emitted> {
        let (chosen, at, towards) = (numbers.next(), numbers.pair(), numbers.triple());
        let (index, _) = self.choice.as_ref()?.sample(chosen);
        let source = self.each[index];
        let chance = self.choice.as_ref()?.pdf(index) as f32;
        match source {
            Source::Polygon(number) => {
                let polygon = &world.lights.polygons.polygons[number];
                from_polygon(world.scene, polygon, source, chance, at, towards)
            }
            Source::Delta(number) => self.from_delta(world, number, chance, at, towards),
            Source::Sky => self.from_sky(world, chance, at, towards),
        }
    }

    /// Density [1/sr] with which light that leaves `polygon` takes `direction`, given its place.
    pub fn polygon_direction_pdf(polygon: &Polygon, direction: Vec3) -> f32 {
        let sides = if polygon.two_sided { 0.5 } else { 1.0 };
        cosine_hemisphere_pdf(polygon.cosine(direction)) * sides
    }

    /// Density [1/sr] with which light from beyond, of the sky, comes from the unit vector `from`.
    pub fn sky_pdf(world: &World, from: Vec3) -> f32 {
        match &world.lights.sky {
            Some(sky) if sky.has_picture() => 0.5 * sky.pdf(from) + 0.5 * (2.0 * TAU).recip(),
            Some(_) => (2.0 * TAU).recip(),
            None => 0.0,
        }
    }

    /// What is left of `emitted` at `position`: points and spots may have a range (KHR_lights_punctual).
    pub fn window(&self, world: &World, emitted: &Emitted, position: Vec3) -> f32 {
        let Source::Delta(number) = emitted.source else { return 1.0 };
        let (LightShape::Point { range, .. } | LightShape::Spot { range, .. }) = world.lights.delta[number].shape()
        else {
            return 1.0;
        };
        let distance = emitted.position.distance(position);
        range.filter(|r| *r > 0.0).map_or(1.0, |r| (1.0 - (distance / r).powi(4)).clamp(0.0, 1.0))
    }

    fn from_sky(&self, world: &World, chance: f32, at: [f32; 2], u: [f32; 3]) -> Option<Emitted> {
        let sky = world.lights.sky.as_ref()?;
        // Half by brightness, half evenly: what a table calls dark may not be.
        let evenly = |u: f32, v: f32| {
            let z = 1.0 - 2.0 * u;
            let (sin, cos) = (TAU * v).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vec3::new(r * cos, r * sin, z)
        };
        let from = match (sky.has_picture(), u[2] < 0.5) {
            (true, true) => sky.sample([u[0], u[1], 2.0 * u[2]])?.0,
            (true, false) | (false, _) => evenly(u[0], u[1]),
        };
        let direction_pdf = Self::sky_pdf(world, from);
        let radiance = sky.radiance(world.scene, from);
        self.from_beyond(Source::Sky, -from, radiance / direction_pdf, chance, direction_pdf, at)
    }

    /// Light along `direction` over the scene's disc, `sent` [lx] across it.
    fn from_beyond(
        &self,
        source: Source,
        direction: Vec3,
        sent: Rgb,
        chance: f32,
        direction_pdf: f32,
        at: [f32; 2],
    ) -> Option<Emitted> {
        let (middle, radius) = self.bounds;
        let on_disc = disc(at) * radius;
        let position = middle + frame(direction) * on_disc.extend(-radius);
        let place_pdf = chance / (PI * radius * radius);
        let is_parallel = direction_pdf == 1.0 && source != Source::Sky;
        (sent != Rgb::ZERO).then_some(Emitted {
            source,
            position,
            normal: direction,
            direction,
            flux: sent / place_pdf,
            place_pdf,
            direction_pdf,
            is_point: false,
            is_beyond: true,
            is_parallel,
        })
    }

    fn from_delta(&self, world: &World, number: usize, chance: f32, at: [f32; 2], u: [f32; 3]) -> Option<Emitted> {
        let delta = &world.lights.delta[number];
        let light = &world.scene.lights[delta.number()];
        let source = Source::Delta(number);
        let point = |position: Vec3, direction: Vec3, intensity: Rgb, direction_pdf: f32| Emitted {
            source,
            position,
            normal: direction,
            direction,
            flux: intensity * light.factor(world.scene, position, direction) / (chance * direction_pdf),
            place_pdf: chance,
            direction_pdf,
            is_point: true,
            is_beyond: false,
            is_parallel: false,
        };
        let emitted = match delta.shape() {
            LightShape::Point { position, intensity, .. } => {
                let z = 1.0 - 2.0 * u[0];
                let (sin, cos) = (TAU * u[1]).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                point(*position, Vec3::new(r * cos, r * sin, z), *intensity, (2.0 * TAU).recip())
            }
            LightShape::Spot { position, direction, intensity, inner, outer, .. } => {
                let cos_outer = outer.cos();
                let towards = frame(*direction) * cap([u[0], u[1]], cos_outer);
                let (cos, cos_inner) = (direction.dot(towards), inner.cos());
                let ramp = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-3)).clamp(0.0, 1.0);
                point(*position, towards, *intensity * ramp * ramp, cap_pdf(cos_outer))
            }
            LightShape::Directional { direction, illuminance, angle } if *angle <= 0.0 => {
                return self.from_beyond(source, *direction, *illuminance, chance, 1.0, at);
            }
            LightShape::Directional { direction, illuminance, angle } => {
                let half = 0.5 * angle.min(PI);
                let towards = frame(*direction) * cap([u[0], u[1]], half.cos());
                let radiance = *illuminance / (PI * half.sin().powi(2));
                let pdf = cap_pdf(half.cos());
                return self.from_beyond(source, towards, radiance / pdf, chance, pdf, at);
            }
            LightShape::Sphere { world_from_unit, radiance } => {
                let (centre, radius) = ball(world_from_unit)?;
                let z = 1.0 - 2.0 * at[0];
                let (sin, cos) = (TAU * at[1]).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                let normal = Vec3::new(r * cos, r * sin, z);
                let position = centre + normal * radius;
                let towards = frame(normal) * cosine_hemisphere([u[0], u[1]]);
                let place_pdf = chance / (2.0 * TAU * radius * radius);
                Emitted {
                    source,
                    position,
                    normal,
                    direction: towards,
                    flux: *radiance * light.factor(world.scene, position, towards) * (PI / place_pdf),
                    place_pdf,
                    direction_pdf: cosine_hemisphere_pdf(normal.dot(towards)),
                    is_point: false,
                    is_beyond: false,
                    is_parallel: false,
                }
            }
            _ => return None,
        };
        (emitted.flux != Rgb::ZERO).then_some(emitted)
    }
}

fn from_polygon(
    scene: &Scene,
    polygon: &Polygon,
    source: Source,
    chance: f32,
    at: [f32; 2],
    u: [f32; 3],
) -> Option<Emitted> {
    let position = polygon.sample(at);
    let normal = if polygon.two_sided && u[2] < 0.5 { -polygon.normal } else { polygon.normal };
    let direction = frame(normal) * cosine_hemisphere([u[0], u[1]]);
    let sides = if polygon.two_sided { 2.0 } else { 1.0 };
    let place_pdf = chance / polygon.area;
    let radiance = polygon.radiance_towards(scene, position, direction);
    (radiance != Rgb::ZERO).then_some(Emitted {
        source,
        position,
        normal,
        direction,
        flux: radiance * (PI * sides / place_pdf),
        place_pdf,
        direction_pdf: Sources::polygon_direction_pdf(polygon, direction),
        is_point: false,
        is_beyond: false,
        is_parallel: false,
    })
}

/// Flux of a source [lm], about, for the choice among them: never 0 where it shines.
fn power(world: &World, source: Source, radius: f32) -> f32 {
    let across = PI * radius * radius;
    match source {
        Source::Polygon(number) => {
            let polygon = &world.lights.polygons.polygons[number];
            let sides = if polygon.two_sided { 2.0 } else { 1.0 };
            if polygon.is_portal() { 0.0 } else { luminance(polygon.radiance) * polygon.area * PI * sides }
        }
        Source::Delta(number) => match world.lights.delta[number].shape() {
            LightShape::Point { intensity, .. } => luminance(*intensity) * 2.0 * TAU,
            LightShape::Spot { intensity, outer, .. } => luminance(*intensity) * TAU * (1.0 - outer.cos()),
            LightShape::Directional { illuminance, .. } => luminance(*illuminance) * across,
            LightShape::Sphere { world_from_unit, radiance } => {
                ball(world_from_unit).map_or(0.0, |(_, r)| luminance(*radiance) * PI * 2.0 * TAU * r * r)
            }
            _ => 0.0,
        },
        Source::Sky => {
            let mean = (0..64).map(|k| {
                // Directions of a Fibonacci lattice.
                let z = 1.0 - (2.0 * k as f32 + 1.0) / 64.0;
                let (sin, cos) = (k as f32 * TAU * 0.618_034).sin_cos();
                let r = (1.0 - z * z).sqrt();
                world
                    .lights
                    .sky
                    .as_ref()
                    .map_or(0.0, |sky| luminance(sky.radiance(world.scene, Vec3::new(r * cos, z, r * sin))))
            });
            mean.sum::<f32>() / 64.0 * 2.0 * TAU * across
        }
    }
}

/// A ball around all surfaces.
fn bounds(scene: &Scene) -> (Vec3, f32) {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for surface in &scene.surfaces {
        for position in &scene.meshes[surface.mesh].positions {
            let p = surface.world_from_local.transform_point3(*position);
            (low, high) = (low.min(p), high.max(p));
        }
    }
    if low.x > high.x {
        (Vec3::ZERO, 1.0)
    } else {
        (0.5 * (low + high), (0.5 * (high - low).length()).max(1e-6) * 1.01)
    }
}
