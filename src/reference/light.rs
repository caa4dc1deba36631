//! Light at a vertex of a path, by two strategies that multiple importance sampling combines (Veach 1997, chapter 9): a place on
//! a light is drawn and tested for shadow, and the vertex' own ray finds what it hits.
//!
//! Both estimate the same integral over directions; each is weighed by the power heuristic from the densities [1/sr] with which
//! the two would have drawn the direction. Points, spots, suns, balls and area lights that are no surface can't be hit, so light
//! sampling carries them alone; a constant sky has no better density than the cosine, so rays carry it alone.

use super::Strategy;
use crate::color::{Rgb, luminance};
use crate::light::Lights;
use crate::light::delta::{Arrival, passing, unshadowed};
use crate::light::emitter::link;
use crate::light::polygon::{Polygon, Source};
use crate::light::tree::Viewpoint;
use crate::moments::Moments;
use crate::patch::reflectance::passing_at;
use crate::patch::{Ground, NONE, SurfacePoint};
use crate::sample::warp::cosine_hemisphere_pdf;
use crate::scene::material::mean_share;
use crate::trace::{Hit, Ray, Tracer};
use glam::{Vec2, Vec3};

/// The lights of a scene as a path meets them.
pub struct Emitters<'a> {
    ground: &'a Ground<'a>,
    lights: &'a Lights,
    strategy: Strategy,
    /// The polygon that each triangle is; [`NONE`] where it doesn't shine.
    polygon_of: Vec<u32>,
}

/// Random numbers in [0, 1) for [`Emitters::sample`].
#[derive(Clone, Copy, Debug)]
pub struct LightDraw {
    /// Which polygon, and the place on it.
    pub polygon: [f32; 2],
    /// Which delta light.
    pub delta: f32,
    /// The place on a delta light's disc.
    pub disc: [f32; 2],
    /// A direction of the sky.
    pub sky: [f32; 3],
}

/// Irradiance at a vertex straight from lights, as far as light sampling carries it [lx].
#[derive(Clone, Copy, Debug, Default)]
pub struct Lit {
    pub irradiance: Rgb,
    /// The part of it that comes from the sky and from lights that are no surface.
    pub other: Rgb,
    /// Shadow rays that were traced.
    pub rays: u64,
    /// Where it comes from, if asked for.
    pub moments: Option<Moments>,
}

impl Lit {
    /// Adds `irradiance` that comes from `towards` at `cos` to the shading normal.
    fn add(&mut self, irradiance: Rgb, is_surface: bool, towards: Vec3, cos: f32) {
        self.irradiance += irradiance;
        self.other += if is_surface { Rgb::ZERO } else { irradiance };
        if let Some(moments) = &mut self.moments {
            moments.receive(irradiance / cos.max(f32::MIN_POSITIVE), towards);
        }
    }
}

impl<'a> Emitters<'a> {
    /// The lights of the scene that `ground` lies in.
    pub fn new(ground: &'a Ground<'a>, lights: &'a Lights, strategy: Strategy) -> Self {
        let mut polygon_of = vec![NONE; ground.tracer.triangle_count()];
        for (p, polygon) in lights.polygons.polygons.iter().enumerate() {
            if let Source::Surface { surface, triangle, .. } = polygon.source {
                polygon_of[ground.tracer.number(surface, triangle) as usize] = p as u32;
            }
        }
        Self { ground, lights, strategy, polygon_of }
    }

    /// Estimates the light at `point` about its shading normal from one polygon, one delta light and one direction of a sky with
    /// a picture, whichever there are; with `moments` where it comes from, too.
    pub fn sample(&self, point: &SurfacePoint, draw: &LightDraw, moments: bool) -> Lit {
        let mut lit = Lit { moments: moments.then(Moments::default), ..Lit::default() };
        self.sample_polygon(point, draw.polygon, &mut lit);
        self.sample_delta(point, draw.delta, draw.disc, &mut lit);
        self.sample_sky(point, draw.sky, &mut lit);
        self.sample_portals(point, draw.sky, draw.delta, &mut lit);
        lit
    }

    fn sample_polygon(&self, point: &SurfacePoint, [s, t]: [f32; 2], lit: &mut Lit) {
        let tree = &self.lights.polygons;
        let Some(choice) = tree.choose(&view(self.ground.tracer, point), s) else { return };
        let polygon = &tree.polygons[choice.polygon];
        let is_surface = matches!(polygon.source, Source::Surface { .. });
        let to = polygon.sample([choice.u, t]);
        let link = link(self.ground.tracer, point, polygon, to);
        if link.shown <= 0.0 {
            return;
        }
        // By area, and by solid angle as the other strategy has it.
        let density = choice.probability / polygon.area;
        let weight = if is_surface {
            // Rays below the triangle's own horizon are not followed.
            let is_above = point.normal.dot(link.towards) > 0.0;
            let hemisphere = if is_above { cosine_hemisphere_pdf(point.shading.dot(link.towards)) } else { 0.0 };
            self.strategy.light_weight(density / link.kernel, hemisphere)
        } else {
            1.0
        };
        if weight <= 0.0 {
            return;
        }
        lit.rays += 1;
        let mut passing = [Rgb::ONE];
        if let Some(tracer) = self.lights.tracer(self.ground.tracer, polygon.shade) {
            if polygon.is_portal() {
                let ray = Ray { origin: link.segment.from, direction: link.towards };
                tracer.transmittance_of_rays(&[ray], &mut passing);
            } else {
                tracer.transmittance(&[link.segment], &mut passing);
            }
        }
        if passing[0] != Rgb::ZERO {
            let radiance = polygon.radiance_towards(self.ground.scene, to, -link.towards) * passing[0];
            let cos = point.shading.dot(link.towards);
            lit.add(radiance * (link.shown * weight / density), is_surface, link.towards, cos);
        }
    }

    /// One of the delta lights, drawn in proportion to what they send unshadowed: a single light has no noise but its shadow's.
    /// The cost grows with their number, without rays.
    fn sample_delta(&self, point: &SurfacePoint, mut u: f32, disc: [f32; 2], lit: &mut Lit) {
        let (mut total, mut drawn) = (0.0f32, None);
        for light in &self.lights.delta {
            let Some(([_, shown], arrival)) = unshadowed(self.ground.scene, light, point, disc) else { continue };
            let weight = luminance(shown);
            if weight <= 0.0 {
                continue;
            }
            // A reservoir of one (Chao 1982): each is kept with its share of the total so far.
            total += weight;
            let share = weight / total;
            if u < share {
                drawn = Some((shown / weight, arrival, light.shade));
                u /= share;
            } else {
                u = (u - share) / (1.0 - share);
            }
        }
        let Some((color, arrival, shade)) = drawn else { return };
        lit.rays += 1;
        let blockers = self.lights.tracer(self.ground.tracer, shade);
        let irradiance = color * total * passing(self.ground.tracer, blockers, point, &arrival);
        lit.add(irradiance, false, arrival.towards, point.shading.dot(arrival.towards));
    }

    fn sample_sky(&self, point: &SurfacePoint, u: [f32; 3], lit: &mut Lit) {
        let Some(sky) = self.lights.sky.as_ref().filter(|s| s.has_picture()) else { return };
        let Some((towards, pdf)) = sky.sample(u) else { return };
        let cos = point.shading.dot(towards);
        if cos <= 0.0 || point.normal.dot(towards) <= 0.0 {
            return;
        }
        let weight = self.strategy.light_weight(pdf, cosine_hemisphere_pdf(cos));
        if weight <= 0.0 {
            return;
        }
        lit.rays += 1;
        let mut passing = [Rgb::ONE];
        let origin = self.ground.tracer.off_surface(point.position, point.normal);
        self.ground.tracer.transmittance_of_rays(&[Ray { origin, direction: towards }], &mut passing);
        if passing[0] != Rgb::ZERO {
            let irradiance = sky.radiance(self.ground.scene, towards) * passing[0] * (cos * weight / pdf);
            lit.add(irradiance, false, towards, cos);
        }
    }

    /// One direction through each portal to a sky with a picture, by brightness or over the portal as `choice` says.
    fn sample_portals(&self, point: &SurfacePoint, [u, v, _]: [f32; 3], choice: f32, lit: &mut Lit) {
        for portal in &self.lights.portals {
            let Some(drawn) = portal.sample(point, [u, v], choice < 0.5) else { continue };
            let cos = point.shading.dot(drawn.towards);
            if cos <= 0.0 || point.normal.dot(drawn.towards) <= 0.0 {
                continue;
            }
            lit.rays += 1;
            let arrival = Arrival { towards: drawn.towards, distance: f32::INFINITY, illuminance: Rgb::ZERO };
            let blockers = self.lights.tracer(self.ground.tracer, portal.shade());
            let passing = passing(self.ground.tracer, blockers, point, &arrival);
            if passing != Rgb::ZERO {
                let radiance = drawn.sky.radiance(self.ground.scene, drawn.towards) * passing;
                lit.add(radiance * (2.0 * cos * drawn.weight), false, drawn.towards, cos);
            }
        }
    }

    /// Radiance that meets a cosine-distributed ray of `point` along `direction` (unit) from the place `at` of its hit, as far as
    /// hemisphere sampling carries it [nit].
    pub fn emitted(&self, point: &SurfacePoint, direction: Vec3, hit: &Hit, at: Vec3) -> Rgb {
        let number = self.polygon_of[hit.triangle as usize];
        if number == NONE {
            return Rgb::ZERO;
        }
        let tree = &self.lights.polygons;
        let polygon: &Polygon = &tree.polygons[number as usize];
        if hit.back && !polygon.two_sided {
            return Rgb::ZERO;
        }
        let probability = tree.probability(&view(self.ground.tracer, point), number as usize);
        let hemisphere = cosine_hemisphere_pdf(point.shading.dot(direction));
        let weight = if probability > 0.0 {
            let kernel = polygon.cosine(-direction) / at.distance_squared(point.position);
            self.strategy.hemisphere_weight(probability / (polygon.area * kernel), hemisphere)
        } else {
            self.strategy.hemisphere_weight(0.0, hemisphere)
        };
        polygon.radiance_towards(self.ground.scene, at, -direction) * (weight / self.stopped(hit))
    }

    /// The share of light that ends where `hit` is: as often do rays that come there find it.
    fn stopped(&self, hit: &Hit) -> f32 {
        let (surface, triangle) = self.ground.tracer.place(hit.triangle);
        let scene = self.ground.scene;
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        let (_, passes) = passing_at(scene, mesh, triangle, Vec2::from(hit.barycentric));
        (1.0 - mean_share(passes)).max(f32::MIN_POSITIVE)
    }

    /// The sky's radiance on a cosine-distributed ray of `point` that escapes along `direction` (unit), as far as hemisphere
    /// sampling carries it [nit].
    pub fn escaped(&self, point: &SurfacePoint, direction: Vec3) -> Rgb {
        let Some(sky) = &self.lights.sky else { return Rgb::ZERO };
        let hemisphere = cosine_hemisphere_pdf(point.shading.dot(direction));
        sky.radiance(self.ground.scene, direction) * self.strategy.hemisphere_weight(sky.pdf(direction), hemisphere)
    }
}

/// Where a path's vertex chooses its polygon from.
fn view(tracer: &Tracer, point: &SurfacePoint) -> Viewpoint {
    Viewpoint { position: point.position, normal: point.shading, tolerance: tracer.offset() }
}
