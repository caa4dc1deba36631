//! Light as it sets out: where paths from lights start, drawn in proportion to power.
//!
//! Light from beyond the scene, of the sky and of suns, sets out from a disc across its direction that covers the whole scene.

use super::world::World;
use crate::color::{Rgb, luminance};
use crate::light::delta::{range_share, spot_share};
use crate::light::polygon::{Polygon, ball};
use crate::sample::warp::{SPHERE_PDF, cap, cap_pdf, cosine_hemisphere, cosine_hemisphere_pdf, disc, frame, sphere};
use crate::sample::{Discrete, Numbers};
use crate::scene::{LightShape, Scene};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Numbers that light sets out by.
pub const CHOICES: usize = 6;

/// All that paths from lights set out from.
pub struct Sources {
    each: Vec<Source>,
    choice: Option<Discrete>,
    /// How many of them are polygons, which come first; delta lights follow, and the sky.
    polygons: usize,
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
        let bounds = ball_around(world.scene);
        let polygons = world.lights.polygons.polygons.len();
        let mut each: Vec<Source> = (0..polygons).map(Source::Polygon).collect();
        each.extend((0..world.lights.delta.len()).map(Source::Delta));
        each.extend(world.lights.sky.is_some().then_some(Source::Sky));
        let power = |source: &Source| f64::from(power(world, *source, bounds.1));
        Self { choice: Discrete::new(each.iter().map(power)), each, polygons, bounds }
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
        let index = match source {
            Source::Polygon(number) => number,
            Source::Delta(number) => self.polygons + number,
            Source::Sky => self.each.len() - 1,
        };
        choice.pdf(index) as f32
    }

    /// Light that sets out from one of the sources. `None` where what was drawn sends nothing that way.
    pub fn emit(&self, world: &World, numbers: &mut impl Numbers) -> Option<Emitted> {
        let (chosen, [a, b], [c, d, e]) = (numbers.next(), numbers.pair(), numbers.triple());
        self.emit_by(world, [chosen, a, b, c, d, e])
    }

    /// The same by numbers in [0, 1): of the source, of the place on it, and of the way. Light that is alike is near in them.
    pub fn emit_by(&self, world: &World, [chosen, a, b, c, d, e]: [f32; CHOICES]) -> Option<Emitted> {
        let (at, towards) = ([a, b], [c, d, e]);
        let (index, _) = self.choice.as_ref()?.sample(chosen);
        let source = self.each[index];
        let chance = self.choice.as_ref()?.pdf(index) as f32;
        match source {
            Source::Polygon(number) => {
                let polygon = &world.lights.polygons.polygons[number];
                of_polygon(world.scene, polygon, source, chance, at, towards)
            }
            Source::Delta(number) => self.of_delta(world, number, chance, at, towards),
            Source::Sky => self.of_sky(world, chance, at, towards),
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
            Some(sky) if sky.has_picture() => 0.5 * (sky.pdf(from) + SPHERE_PDF),
            Some(_) => SPHERE_PDF,
            None => 0.0,
        }
    }

    /// The share of the light of `source` that is left at `distance` [m]: points and spots may have a range.
    pub fn window(world: &World, source: Source, distance: f32) -> f32 {
        let Source::Delta(number) = source else { return 1.0 };
        match world.lights.delta[number].shape() {
            LightShape::Point { range, .. } | LightShape::Spot { range, .. } => range_share(distance, *range),
            _ => 1.0,
        }
    }

    fn of_sky(&self, world: &World, chance: f32, at: [f32; 2], u: [f32; 3]) -> Option<Emitted> {
        let sky = world.lights.sky.as_ref()?;
        // Half by brightness, half evenly: what a table calls dark may not be.
        let from = match sky.has_picture() && u[2] < 0.5 {
            true => sky.sample([u[0], u[1], 2.0 * u[2]])?.0,
            false => sphere([u[0], u[1]]),
        };
        let direction_pdf = Self::sky_pdf(world, from);
        let radiance = sky.radiance(world.scene, from);
        self.across(Source::Sky, -from, radiance / direction_pdf, chance, direction_pdf, at)
    }

    /// Light along `direction` over the scene's disc, `sent` [lx] across it.
    fn across(
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

    fn of_delta(&self, world: &World, number: usize, chance: f32, at: [f32; 2], u: [f32; 3]) -> Option<Emitted> {
        let delta = &world.lights.delta[number];
        let source = Source::Delta(number);
        let v = [u[0], u[1]];
        match delta.shape() {
            LightShape::Point { position, intensity, .. } => {
                of_point(world, source, *position, sphere(v), *intensity, (chance, SPHERE_PDF))
            }
            LightShape::Spot { position, direction, intensity, inner, outer, .. } => {
                let towards = frame(*direction) * cap(v, outer.cos());
                let intensity = *intensity * spot_share(direction.dot(towards), *inner, *outer);
                of_point(world, source, *position, towards, intensity, (chance, cap_pdf(outer.cos())))
            }
            LightShape::Directional { direction, illuminance, angle } if *angle <= 0.0 => {
                self.across(source, *direction, *illuminance, chance, 1.0, at)
            }
            LightShape::Directional { direction, angle, .. } => {
                let cos = (0.5 * angle.min(PI)).cos();
                let towards = frame(*direction) * cap(v, cos);
                let radiance = delta.disc_radiance(world.scene, Vec3::ZERO, towards);
                self.across(source, towards, radiance / cap_pdf(cos), chance, cap_pdf(cos), at)
            }
            LightShape::Sphere { world_from_unit, .. } => {
                let (centre, radius) = ball(world_from_unit)?;
                // The direction first, which all of the ball shares, then the place on the half that faces it: seen across, even, as
                // the cosine to the normal has it.
                let (direction, across) = (sphere(v), disc(at));
                let height = (1.0 - across.length_squared()).max(0.0).sqrt();
                let normal = (frame(direction) * across.extend(height)).normalize();
                let position = centre + normal * radius;
                let radiance = delta.disc_radiance(world.scene, position, direction);
                let place_pdf = chance * SPHERE_PDF / (radius * radius);
                let direction_pdf = cosine_hemisphere_pdf(normal.dot(direction));
                Emitted::from_area(source, (position, normal), direction, radiance * PI, (place_pdf, direction_pdf))
            }
            _ => None,
        }
    }
}

impl Emitted {
    /// Light that leaves a place on an area, its normal given, along `direction`; `sent` is radiance times cosine over the density
    /// of the direction [lm/m^2].
    fn from_area(
        source: Source,
        (position, normal): (Vec3, Vec3),
        direction: Vec3,
        sent: Rgb,
        (place_pdf, direction_pdf): (f32, f32),
    ) -> Option<Self> {
        (sent != Rgb::ZERO).then(|| Self {
            source,
            position,
            normal,
            direction,
            flux: sent / place_pdf,
            place_pdf,
            direction_pdf,
            is_point: false,
            is_beyond: false,
            is_parallel: false,
        })
    }
}

/// Light of `intensity` [cd] from a point.
fn of_point(
    world: &World,
    source: Source,
    position: Vec3,
    direction: Vec3,
    intensity: Rgb,
    (chance, direction_pdf): (f32, f32),
) -> Option<Emitted> {
    let Source::Delta(number) = source else { return None };
    let light = &world.scene.lights[world.lights.delta[number].number()];
    let sent = intensity * light.factor(world.scene, position, direction) / direction_pdf;
    let emitted = Emitted::from_area(source, (position, direction), direction, sent, (chance, direction_pdf))?;
    Some(Emitted { is_point: true, ..emitted })
}

fn of_polygon(
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
    let direction_pdf = Sources::polygon_direction_pdf(polygon, direction);
    Emitted::from_area(source, (position, normal), direction, radiance * (PI * sides), (place_pdf, direction_pdf))
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
            const DIRECTIONS: usize = 64;
            // A Fibonacci lattice.
            let lattice = |k: usize| [(k as f32 + 0.5) / DIRECTIONS as f32, (k as f32 * 0.618_034).fract()];
            let radiance = |d: Vec3| world.lights.sky.as_ref().map_or(0.0, |s| luminance(s.radiance(world.scene, d)));
            let sum: f32 = (0..DIRECTIONS).map(|k| radiance(sphere(lattice(k)))).sum();
            sum / (DIRECTIONS as f32 * SPHERE_PDF) * across
        }
    }
}

/// A ball around all surfaces: middle and radius [m].
fn ball_around(scene: &Scene) -> (Vec3, f32) {
    let Some([low, high]) = scene.bounds() else { return (Vec3::ZERO, 1.0) };
    (0.5 * (low + high), (0.5 * (high - low).length()).max(1e-6) * 1.01)
}
