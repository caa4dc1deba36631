//! A scene as paths go through it: rays, what they meet and what is in their way.

use super::lamps::{Lamp, Lamps};
use super::vertex::{Kind, Vertex};
use crate::color::Rgb;
use crate::light::Lights;
use crate::light::polygon::{Polygon, Source};
use crate::medium::{Flight, Media};
use crate::patch::footprint::Facet;
use crate::patch::reflectance::passing_at;
use crate::patch::{NONE, SurfacePoint};
use crate::sample::Numbers;
use crate::scatter::{Bsdf, Scattering};
use crate::scene::Scene;
use crate::scene::material::mean_share;
use crate::trace::{Hit, Ray, Segment, Tracer};
use glam::Vec3;

/// Everything that a path may meet.
pub struct World<'a> {
    pub scene: &'a Scene,
    pub tracer: &'a Tracer,
    pub lights: &'a Lights,
    pub scattering: &'a Scattering,
    pub media: &'a Media,
    pub lamps: Lamps,
    /// The polygon that each triangle is; [`NONE`] where it doesn't shine.
    polygon_of: Vec<u32>,
}

/// What a ray came to.
pub struct Travelled<'a> {
    /// The next vertex; `None` where the ray left the scene.
    pub vertex: Option<Vertex<'a>>,
    /// Distance to it [m]; infinite where there is none.
    pub t: f32,
    /// What the path's weight is multiplied by.
    pub weight: Rgb,
    /// Radiance from media on the way [nit], to be multiplied by the path's weight before the way.
    pub emitted: Rgb,
}

impl<'a> World<'a> {
    /// Prepares the lights of a scene whose materials were [adapted](crate::scatter::adapt).
    pub fn new(
        scene: &'a Scene,
        tracer: &'a Tracer,
        lights: &'a Lights,
        scattering: &'a Scattering,
        media: &'a Media,
    ) -> Self {
        let mut polygon_of = vec![NONE; tracer.triangle_count()];
        for (p, polygon) in lights.polygons.polygons.iter().enumerate() {
            if let Source::Surface { surface, triangle, .. } = polygon.source {
                polygon_of[tracer.number(surface, triangle) as usize] = p as u32;
            }
        }
        Self { scene, tracer, lights, scattering, media, lamps: Lamps::new(lights), polygon_of }
    }

    /// Follows `ray`, whose path has the weight `throughput`, to its next vertex, through what absorbs `absorption` [1/m].
    pub fn travel(&self, ray: &Ray, throughput: Rgb, absorption: Rgb, numbers: &mut impl Numbers) -> Travelled<'a> {
        let (hit, tint) = self.closest(ray);
        let t = hit.map_or(f32::INFINITY, |hit| hit.t);
        let mut emitted = Rgb::ZERO;
        let mut passed = tint;
        if !self.media.is_empty() {
            match self.media.fly(ray, t, throughput, numbers) {
                Flight::Passed { weight, emitted: on_the_way } => {
                    passed *= weight;
                    emitted = on_the_way;
                }
                Flight::Scattered { t, weight, phase, emitted } => {
                    let position = ray.origin + ray.direction * t;
                    let vertex = Vertex { position, back: -ray.direction, kind: Kind::Medium(phase) };
                    return Travelled { vertex: Some(vertex), t, weight: tint * weight, emitted };
                }
            }
        }
        if absorption != Rgb::ZERO && t.is_finite() {
            passed *= attenuation(absorption, t);
        }
        let vertex = hit.map(|hit| self.vertex(&hit, -ray.direction));
        Travelled { vertex, t, weight: passed, emitted }
    }

    /// The nearest hit, and the tint of what the ray stands for.
    pub fn closest(&self, ray: &Ray) -> (Option<Hit>, Rgb) {
        let (mut hit, mut tints) = ([None], Vec::new());
        self.tracer.closest_tinted(std::slice::from_ref(ray), &mut hit, &mut tints);
        (hit[0], tints.first().copied().unwrap_or(Rgb::ONE))
    }

    /// The place of a hit that is met along `-back`.
    pub fn vertex(&self, hit: &Hit, back: Vec3) -> Vertex<'a> {
        let (surface, triangle) = self.tracer.place(hit.triangle);
        let point = Facet::new(self.scene, surface, triangle).point(hit.barycentric.into());
        let bsdf = self.scattering.at(self.scene, surface, triangle, hit.barycentric);
        Vertex::on_surface(point, bsdf, back, Some(*hit))
    }

    /// The vertex that a sensor on a surface is: what arrives at `point` about its shading normal leaves as radiance, a pi-th of
    /// the irradiance.
    pub fn receiver(&self, point: SurfacePoint) -> Vertex<'a> {
        Vertex::on_surface(point, Bsdf::lambert(Rgb::ONE), point.shading, None)
    }

    /// What gets from `from` over `length` [m] (it may be infinite) along `towards`, by channel, past surfaces that block what
    /// has the number `shade`, and media.
    pub fn passing(
        &self,
        from: Vec3,
        towards: Vec3,
        length: f32,
        shade: Option<u16>,
        numbers: &mut impl Numbers,
    ) -> Rgb {
        let mut share = [Rgb::ONE];
        let ray = Ray { origin: from, direction: towards };
        if let Some(tracer) = self.lights.tracer(self.tracer, shade) {
            if length.is_finite() {
                tracer.transmittance(&[Segment { from, to: from + towards * length }], &mut share);
            } else {
                tracer.transmittance_of_rays(&[ray], &mut share);
            }
        }
        if share[0] != Rgb::ZERO && !self.media.is_empty() {
            share[0] *= self.media.transmittance(&ray, length, numbers);
        }
        share[0]
    }

    /// What absorbs light on the way from `vertex` along `direction`, inside of a solid [1/m].
    pub fn absorption(&self, vertex: &Vertex, direction: Vec3) -> Rgb {
        let hit = vertex.surface().filter(|on| on.point.normal.dot(direction) < 0.0).and_then(|on| on.hit);
        let Some(hit) = hit else { return Rgb::ZERO };
        let (surface, triangle) = self.tracer.place(hit.triangle);
        let appearance = self.scene.material(surface, triangle).appearance.as_ref();
        appearance.and_then(|appearance| appearance.absorption()).unwrap_or(Rgb::ZERO)
    }

    /// The polygon that shines where `hit` is, seen from the side that was hit, by number.
    pub fn polygon_at(&self, hit: &Hit) -> Option<usize> {
        let number = self.polygon_of[hit.triangle as usize];
        let polygon = self.lights.polygons.polygons.get(number as usize)?;
        (!hit.back || polygon.two_sided).then_some(number as usize)
    }

    /// Radiance of `polygon` from its point `at` along `direction`, where a ray found it by `hit` [nit]: what lets light through
    /// is found that much less often.
    pub fn radiance_at(&self, polygon: &Polygon, at: Vec3, direction: Vec3, hit: &Hit) -> Rgb {
        let (surface, triangle) = self.tracer.place(hit.triangle);
        let mesh = &self.scene.meshes[self.scene.surfaces[surface].mesh];
        let (_, passes) = passing_at(self.scene, mesh, triangle, hit.barycentric.into());
        let stopped = (1.0 - mean_share(passes)).max(f32::MIN_POSITIVE);
        polygon.radiance_towards(self.scene, at, direction) / stopped
    }

    /// Radiance of the sky and of suns with a disc, apart, from the unit vector `direction` [nit].
    pub fn beyond(&self, direction: Vec3) -> (Rgb, impl Iterator<Item = (usize, Rgb)>) {
        let sky = self.lights.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.radiance(self.scene, direction));
        let suns = self.lamps.suns(direction);
        let radiance = move |k: usize| self.lights.delta[k].disc_radiance(self.scene, Vec3::ZERO, -direction);
        (sky, suns.map(move |k| (k, radiance(k))))
    }

    /// Calls `visit` with the lamps along `ray` up to `t`, their distance, and their radiance as far as it arrives [nit].
    pub fn lamps(&self, ray: &Ray, t: f32, numbers: &mut impl Numbers, mut visit: impl FnMut(Lamp, f32, Rgb)) {
        self.lamps.along(ray, t, self.lights, |lamp, distance| {
            let at = ray.origin + ray.direction * distance;
            let radiance = match lamp {
                Lamp::Polygon(number) => {
                    self.lights.polygons.polygons[number].radiance_towards(self.scene, at, -ray.direction)
                }
                Lamp::Ball(number) => self.lights.delta[number].disc_radiance(self.scene, at, -ray.direction),
            };
            let passing = match self.media.is_empty() {
                true => Rgb::ONE,
                false => self.media.transmittance(ray, distance, numbers),
            };
            visit(lamp, distance, radiance * passing);
        });
    }
}

/// What is left over `t` [m] of what absorbs `absorption` [1/m].
pub fn attenuation(absorption: Rgb, t: f32) -> Rgb {
    (-absorption * t).exp()
}
