//! Light straight from lights at a probe.
//!
//! Delta lights are projected as they are. Polygons are sampled by area, by the cut through the tree of lights that patches have, too;
//! those that fill much of the view are left to the probe's own rays where they are surfaces. The bright parts of a sky's picture are
//! sampled by brightness, and combined with rays that escape by the power heuristic (Veach, Guibas 1995). Lights that are linked to some
//! surfaces alone don't shine on probes, which are none.

use super::harmonics::Harmonics;
use crate::color::Rgb;
use crate::light::delta::{Arrival, passing};
use crate::light::polygon::{Polygon, Source};
use crate::light::tree::Cluster;
use crate::light::{Lit, Sky};
use crate::patch::{NONE, SurfacePoint};
use crate::sample::sequence::Sequence;
use crate::trace::Segment;
use glam::Vec3;
use std::f32::consts::PI;

/// Shadow rays to each polygon or cluster of them, and to each light with a disc.
const AREA_SAMPLES: u32 = 32;
const DISC_SAMPLES: u32 = 16;

/// Solid angle [sr], about, from which on a probe's own rays find a polygon well enough.
const WIDE: f32 = 0.2;

/// Brightness samples of a sky's picture for each of the probe's rays.
const SKY_SHARE: f32 = 0.25;

/// Density [1/sr] of a direction over the sphere.
const UNIFORM: f32 = 1.0 / (4.0 * PI);

/// A probe and what it draws from.
pub struct Viewer<'a> {
    pub lit: &'a Lit<'a>,
    pub position: Vec3,
    pub sequence: Sequence,
    /// Rays over the sphere.
    pub rays: u32,
}

/// What came straight from lights.
#[derive(Default)]
pub struct Found {
    pub light: Harmonics,
    /// Polygons that are left to rays, ascending.
    pub wide: Vec<u32>,
    /// Shadow rays.
    pub rays: u64,
}

impl Viewer<'_> {
    /// The light from all lights but what rays find.
    pub fn look(&self) -> Found {
        let mut found = Found::default();
        let lights = self.lit.lights;
        let cut = lights.polygons.cut(self.position, Vec3::ZERO, 0.0);
        for (number, cluster) in cut.into_iter().enumerate() {
            self.add_cluster(number as u32, cluster, &mut found);
        }
        self.add_delta(&mut found);
        self.add_sky(&mut found);
        self.add_portals(&mut found);
        found.wide.sort_unstable();
        found
    }

    /// The probe as a place that nothing lies under.
    fn point(&self) -> SurfacePoint {
        SurfacePoint { position: self.position, ..SurfacePoint::NOWHERE }
    }

    fn add_cluster(&self, number: u32, cluster: Cluster, found: &mut Found) {
        let tree = &self.lit.lights.polygons;
        if let Cluster::Polygon(p) = cluster {
            let polygon = &tree.polygons[p];
            if !polygon.faces(self.position, self.lit.ground.tracer.offset()) {
                return;
            }
            let is_plain = matches!(polygon.source, Source::Surface { textured: false, .. });
            if is_plain && polygon.area > WIDE * polygon.centre.distance_squared(self.position) {
                found.wide.push(p as u32);
                return;
            }
        }
        for index in 0..AREA_SAMPLES {
            let [s, t, ..] = self.sequence.point(index, 1 + number % 32);
            let (p, probability, s) = match cluster {
                Cluster::Polygon(p) => (p, 1.0, s),
                Cluster::Node(n) => tree.sample(n, s),
            };
            self.add_polygon(&tree.polygons[p], [s, t], (AREA_SAMPLES as f32 * probability).recip(), found);
        }
    }

    /// One sample of a polygon, of which `share` counts.
    fn add_polygon(&self, polygon: &Polygon, u: [f32; 2], share: f32, found: &mut Found) {
        let tracer = self.lit.ground.tracer;
        let to = polygon.sample(u);
        let way = to - self.position;
        let square = way.length_squared();
        let Some(towards) = way.try_normalize() else { return };
        let leaving = polygon.cosine(-towards);
        if leaving <= 0.0 || !polygon.lit.holds(NONE) {
            return;
        }
        let radiance = polygon.radiance_towards(self.lit.ground.scene, to, -towards);
        let light = radiance * (leaving * polygon.area * share / square);
        if polygon.is_portal() {
            let arrival = Arrival { towards, distance: f32::INFINITY, illuminance: light };
            self.arrive(&arrival, polygon.shade, 1.0, found);
            return;
        }
        found.rays += 1;
        let mut passing = [Rgb::ONE];
        if let Some(tracer) = self.lit.lights.tracer(tracer, polygon.shade) {
            let side = if polygon.normal.dot(towards) <= 0.0 { polygon.normal } else { -polygon.normal };
            let segment = Segment { from: self.position, to: tracer.off_surface(to, side) };
            tracer.transmittance(&[segment], &mut passing);
        }
        found.light.receive(light * passing[0], towards);
    }

    fn add_delta(&self, found: &mut Found) {
        let scene = self.lit.ground.scene;
        for (number, light) in self.lit.lights.delta.iter().enumerate().filter(|(_, light)| light.shines_on(NONE)) {
            let count = if light.is_point() { 1 } else { DISC_SAMPLES };
            for index in 0..count {
                let [s, t, ..] = self.sequence.point(index, 33 + number as u32 % 27);
                if let Some(arrival) = light.arrive(scene, self.position, [s, t]) {
                    self.arrive(&arrival, light.shade, 1.0 / count as f32, found);
                }
            }
        }
    }

    /// Adds `share` of what arrives, as far as nothing is in its way.
    fn arrive(&self, arrival: &Arrival, shade: Option<u16>, share: f32, found: &mut Found) {
        found.rays += 1;
        let blockers = self.lit.lights.tracer(self.lit.ground.tracer, shade);
        let passing = passing(self.lit.ground.tracer, blockers, &self.point(), arrival);
        found.light.receive(arrival.illuminance * passing * share, arrival.towards);
    }

    /// Brightness samples, as far as they count beside the probe's rays.
    fn add_sky(&self, found: &mut Found) {
        let Some(sky) = self.lit.lights.sky.as_ref().filter(|sky| sky.has_picture()) else { return };
        let count = self.sky_samples();
        for index in 0..count {
            let [u, v, choice, _] = self.sequence.point(index, 61);
            let Some((towards, pdf)) = sky.sample([u, v, choice]) else { continue };
            let weight = (1.0 - self.escaped_share(sky, towards)) / (pdf * count as f32);
            let illuminance = sky.radiance(self.lit.ground.scene, towards) * weight;
            self.arrive(&Arrival { towards, distance: f32::INFINITY, illuminance }, None, 1.0, found);
        }
    }

    fn sky_samples(&self) -> u32 {
        ((self.rays as f32 * SKY_SHARE) as u32).max(1)
    }

    /// The share of the sky's radiance along `towards` that rays carry which escape.
    pub fn escaped_share(&self, sky: &Sky, towards: Vec3) -> f32 {
        if !sky.has_picture() {
            return 1.0;
        }
        let rays = self.rays as f32 * UNIFORM;
        let other = self.sky_samples() as f32 * sky.pdf(towards);
        rays * rays / (rays * rays + other * other)
    }

    fn add_portals(&self, found: &mut Found) {
        for portal in &self.lit.lights.portals {
            for index in 0..AREA_SAMPLES {
                let [u, v, ..] = self.sequence.point(index / 2, 62);
                let Some(drawn) = portal.sample(&self.point(), [u, v], index % 2 == 1) else { continue };
                // Half of the samples go either way: twice the light of each.
                let radiance = drawn.sky.radiance(self.lit.ground.scene, drawn.towards);
                let illuminance = radiance * (2.0 * drawn.weight / AREA_SAMPLES as f32);
                let arrival = Arrival { towards: drawn.towards, distance: f32::INFINITY, illuminance };
                self.arrive(&arrival, portal.shade(), 1.0, found);
            }
        }
    }
}
