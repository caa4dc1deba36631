//! Light at a vertex straight from what shines, by two strategies that multiple importance sampling combines (Veach 1997, chapter
//! 9): a place on a light is drawn and tested for shadow, and the path's own next direction meets a light by chance.
//!
//! Each is weighed by the power heuristic from the densities [1/sr] with which the two would have drawn the direction. Points,
//! spots and sharp suns can't be met, so drawing carries them alone; a constant sky is met alone, as no density fits it better than
//! the surface's own.

use super::lamps::Lamp;
use super::vertex::Vertex;
use super::world::World;
use crate::color::{Rgb, luminance};
use crate::light::delta::{Arrival, DeltaLight};
use crate::light::polygon::Polygon;
use crate::light::tree::Viewpoint;
use crate::patch::{NONE, SurfacePoint};
use crate::sample::{Numbers, warp::cap_pdf};
use crate::scatter::Transport;
use crate::scene::LightShape;
use crate::trace::Hit;
use glam::Vec3;

/// The least share of all choices that a light whose middle sends nothing gets, of those that send from elsewhere, too.
const LEAST_SHARE: f32 = 0.02;

/// A vertex with the density of a direction that was drawn from it.
#[derive(Clone, Copy, Debug)]
pub struct From<'v, 'a> {
    pub vertex: &'v Vertex<'a>,
    /// Density of the direction [1/sr]; 0 for deltas, whose light nothing else finds.
    pub pdf: f32,
}

/// The weight of a strategy of density `own` beside one of density `other`.
pub fn power(own: f32, other: f32) -> f32 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

/// Who finds light that both drawing and the path's next direction could find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finder {
    /// Both, each its share.
    Both,
    /// Drawing alone.
    Drawing,
}

impl Finder {
    /// The weight of what was drawn with density `own`, and would have been met with `other`.
    fn drawn(self, own: f32, other: f32) -> f32 {
        match self {
            Self::Both => power(own, other),
            Self::Drawing => 1.0,
        }
    }
}

impl World<'_> {
    /// An estimate of the light that goes back along the path from `vertex`, of what is drawn from all that shines [nit].
    pub fn drawn(&self, vertex: &Vertex, finder: Finder, numbers: &mut impl Numbers) -> Rgb {
        if vertex.is_delta() {
            return Rgb::ZERO;
        }
        let mut sum = Rgb::ZERO;
        if !self.lights.polygons.is_empty() {
            sum += self.draw_polygon(vertex, finder, numbers);
        }
        if !self.lights.delta.is_empty() {
            sum += self.draw_delta(vertex, finder, numbers);
        }
        if self.lights.sky.as_ref().is_some_and(|sky| sky.has_picture()) {
            sum += self.draw_sky(vertex, finder, numbers);
        }
        if !self.lights.portals.is_empty() {
            sum += self.draw_portals(vertex, numbers);
        }
        sum
    }

    fn draw_polygon(&self, vertex: &Vertex, finder: Finder, numbers: &mut impl Numbers) -> Rgb {
        let (choice, at) = (numbers.next(), numbers.next());
        let tree = &self.lights.polygons;
        let Some(choice) = tree.choose(&self.view(vertex), choice) else { return Rgb::ZERO };
        let polygon = &tree.polygons[choice.polygon];
        let to = polygon.sample([choice.u, at]);
        let way = to - vertex.position;
        let distance = way.length();
        let towards = way / distance.max(f32::MIN_POSITIVE);
        if !polygon.lit.holds(surface(vertex)) || distance <= 0.0 {
            return Rgb::ZERO;
        }
        let kernel = polygon.cosine(-towards) / (distance * distance);
        let response = vertex.respond(towards, Transport::Radiance);
        if kernel <= 0.0 || response == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let density = choice.probability / (polygon.area * kernel);
        // Portals are seen through, not met.
        let met = if polygon.is_portal() { 0.0 } else { vertex.pdf(towards, Transport::Radiance) };
        let from = vertex.shadow_origin(self.tracer, towards);
        let passing = if polygon.is_portal() {
            self.passing(from, towards, f32::INFINITY, polygon.shade, numbers)
        } else {
            let side = if polygon.normal.dot(towards) <= 0.0 { polygon.normal } else { -polygon.normal };
            let way = self.tracer.off_surface(to, side) - from;
            let length = way.length();
            self.passing(from, way / length, length, polygon.shade, numbers)
        };
        if passing == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let radiance = polygon.radiance_towards(self.scene, to, -towards);
        response * radiance * passing * (finder.drawn(density, met) / density)
    }

    /// One of the delta lights, drawn by about what each sends here.
    fn draw_delta(&self, vertex: &Vertex, finder: Finder, numbers: &mut impl Numbers) -> Rgb {
        let mut u = numbers.next();
        let disc = numbers.pair();
        let total: f32 = (0..self.lights.delta.len()).map(|k| self.delta_weight(vertex, k)).sum();
        let mut chosen = None;
        for k in 0..self.lights.delta.len() {
            let share = self.delta_weight(vertex, k) / total;
            if share > 0.0 {
                chosen = Some((k, share));
                if u < share {
                    break;
                }
                u -= share;
            }
        }
        let Some((k, share)) = chosen else { return Rgb::ZERO };
        let light = &self.lights.delta[k];
        let Some(arrival) = light.arrive(self.scene, vertex.position, disc) else { return Rgb::ZERO };
        let response = vertex.respond(arrival.towards, Transport::Radiance);
        if response == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let weight = match self.disc_pdf(light, vertex.position) {
            Some(pdf) => finder.drawn(share * pdf, vertex.pdf(arrival.towards, Transport::Radiance)),
            None => 1.0,
        };
        let passing = self.arriving(vertex, &arrival, light.shade, numbers);
        response * arrival.illuminance * passing * (weight / share)
    }

    /// What delta light `k` is drawn in proportion to: what its middle sends.
    pub(super) fn delta_weight(&self, vertex: &Vertex, k: usize) -> f32 {
        let light = &self.lights.delta[k];
        if !light.shines_on(surface(vertex)) {
            return 0.0;
        }
        let plain = |light: &DeltaLight| match light.shape() {
            LightShape::Sphere { radiance, .. } => luminance(*radiance),
            LightShape::Directional { illuminance, .. } => luminance(*illuminance),
            _ => 0.0,
        };
        let sent = light.arrive(self.scene, vertex.position, [0.5; 2]).map_or(0.0, |a| luminance(a.illuminance));
        // The rest of a disc may shine, or face the surface, where its middle doesn't.
        sent.max(LEAST_SHARE * plain(light))
    }

    /// The share with which delta light `k` is drawn at `vertex`.
    pub(super) fn delta_share(&self, vertex: &Vertex, k: usize) -> f32 {
        let total: f32 = (0..self.lights.delta.len()).map(|k| self.delta_weight(vertex, k)).sum();
        self.delta_weight(vertex, k) / total
    }

    /// Density [1/sr] of directions over the disc that a light shows to `position`; `None` of points and sharp suns.
    pub(super) fn disc_pdf(&self, light: &DeltaLight, position: Vec3) -> Option<f32> {
        match light.shape() {
            LightShape::Directional { angle, .. } if *angle > 0.0 => {
                Some(cap_pdf((0.5 * angle.min(std::f32::consts::TAU)).cos()))
            }
            LightShape::Sphere { world_from_unit, .. } => {
                let (centre, radius) = crate::light::polygon::ball(world_from_unit)?;
                let sin2 = radius * radius / centre.distance_squared(position);
                // 1 - cos without cancellation.
                let height = sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt());
                Some((std::f32::consts::TAU * height).recip())
            }
            _ => None,
        }
    }

    pub(super) fn arriving(
        &self,
        vertex: &Vertex,
        arrival: &Arrival,
        shade: Option<u16>,
        numbers: &mut impl Numbers,
    ) -> Rgb {
        let from = vertex.shadow_origin(self.tracer, arrival.towards);
        if arrival.distance.is_infinite() {
            return self.passing(from, arrival.towards, f32::INFINITY, shade, numbers);
        }
        let way = vertex.position + arrival.towards * arrival.distance - from;
        let length = way.length().max(f32::MIN_POSITIVE);
        self.passing(from, way / length, length, shade, numbers)
    }

    fn draw_sky(&self, vertex: &Vertex, finder: Finder, numbers: &mut impl Numbers) -> Rgb {
        let u = numbers.triple();
        let Some(sky) = &self.lights.sky else { return Rgb::ZERO };
        let Some((towards, pdf)) = sky.sample(u) else { return Rgb::ZERO };
        let response = vertex.respond(towards, Transport::Radiance);
        if response == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let weight = finder.drawn(pdf, vertex.pdf(towards, Transport::Radiance)) / pdf;
        let origin = vertex.origin(self.tracer, towards);
        let passing = self.passing(origin, towards, f32::INFINITY, None, numbers);
        response * sky.radiance(self.scene, towards) * passing * weight
    }

    /// One direction through each portal, by brightness or over the portal.
    fn draw_portals(&self, vertex: &Vertex, numbers: &mut impl Numbers) -> Rgb {
        let (u, by_place) = (numbers.pair(), numbers.next() < 0.5);
        let point = match vertex.surface() {
            Some(on) => on.point,
            None => SurfacePoint::on(NONE, vertex.position, Vec3::ZERO),
        };
        let mut sum = Rgb::ZERO;
        for portal in &self.lights.portals {
            let Some(drawn) = portal.sample(&point, u, by_place) else { continue };
            let response = vertex.respond(drawn.towards, Transport::Radiance);
            if response != Rgb::ZERO {
                let from = vertex.shadow_origin(self.tracer, drawn.towards);
                let passing = self.passing(from, drawn.towards, f32::INFINITY, portal.shade(), numbers);
                sum += response * drawn.sky.radiance(self.scene, drawn.towards) * passing * (2.0 * drawn.weight);
            }
        }
        sum
    }

    /// Radiance that comes from a surface which a ray from `from` met by `hit` at `at`, as far as rays carry it [nit]. Paths that
    /// start at a sensor see all of it.
    pub fn met(&self, from: Option<From>, hit: &Hit, at: &Vertex) -> Rgb {
        let Some(number) = self.polygon_at(hit) else { return Rgb::ZERO };
        let polygon = &self.lights.polygons.polygons[number];
        let weight = from.map_or(1.0, |from| self.polygon_share(&from, number, at.position, -at.back));
        self.radiance_at(polygon, at.position, at.back, hit) * weight
    }

    /// The same of a lamp at the distance `t` along `towards`, whose radiance is known.
    pub fn met_lamp(&self, from: Option<From>, lamp: Lamp, towards: Vec3, t: f32) -> f32 {
        let Some(from) = from else { return 1.0 };
        match lamp {
            Lamp::Polygon(number) => {
                if !self.lights.polygons.polygons[number].lit.holds(surface(from.vertex)) {
                    return 0.0;
                }
                self.polygon_share(&from, number, from.vertex.position + towards * t, towards)
            }
            Lamp::Ball(number) => self.disc_share(&from, number),
        }
    }

    /// Radiance from beyond the scene along `towards`, as far as rays carry it [nit].
    pub fn met_beyond(&self, from: Option<From>, towards: Vec3) -> Rgb {
        let (sky, suns) = self.beyond(towards);
        let weight = match (&from, &self.lights.sky) {
            (Some(from), Some(lit)) if from.pdf > 0.0 => power(from.pdf, lit.pdf(towards)),
            _ => 1.0,
        };
        suns.fold(sky * weight, |sum, (number, radiance)| {
            sum + radiance * from.map_or(1.0, |from| self.disc_share(&from, number))
        })
    }

    /// The weight of having met a polygon, beside having drawn the place `at` on it.
    fn polygon_share(&self, from: &From, number: usize, at: Vec3, towards: Vec3) -> f32 {
        if from.pdf <= 0.0 {
            return 1.0;
        }
        let tree = &self.lights.polygons;
        let polygon: &Polygon = &tree.polygons[number];
        let probability = tree.probability(&self.view(from.vertex), number);
        let kernel = polygon.cosine(-towards) / at.distance_squared(from.vertex.position);
        power(from.pdf, probability / (polygon.area * kernel))
    }

    /// The weight of having met a ball or a sun, by number among the delta lights.
    fn disc_share(&self, from: &From, number: usize) -> f32 {
        let light = &self.lights.delta[number];
        if !light.shines_on(surface(from.vertex)) {
            return 0.0;
        }
        match self.disc_pdf(light, from.vertex.position) {
            Some(pdf) if from.pdf > 0.0 => power(from.pdf, pdf * self.delta_share(from.vertex, number)),
            _ => 1.0,
        }
    }

    pub(super) fn view(&self, vertex: &Vertex) -> Viewpoint {
        Viewpoint { position: vertex.position, normal: vertex.facing(), tolerance: self.tracer.offset() }
    }
}

/// The surface that a vertex lies on, by number.
fn surface(vertex: &Vertex) -> u32 {
    vertex.surface().map_or(NONE, |on| on.point.surface)
}
