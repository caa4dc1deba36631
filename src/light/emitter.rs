//! What a receiver gets light from: a polygon, a cluster of polygons, or a delta light; and shadow rays to it.

use super::Lights;
use super::delta::unshadowed;
use super::direct::DirectParams;
use super::polygon::{Polygon, Source};
use super::receiver::{Evenness, Site};
use super::terminator::origin;
use super::tree::Cluster;
use crate::color::{Rgb, luminance};
use crate::contour::point_to_polygon;
use crate::patch::SurfacePoint;
use crate::scene::Scene;
use crate::trace::{Ray, Segment, Tracer};
use glam::Vec3;
use std::f32::consts::PI;

/// All that direct light depends on.
#[derive(Clone, Copy)]
pub(super) struct Sight<'a> {
    pub scene: &'a Scene,
    pub tracer: &'a Tracer,
    pub lights: &'a Lights,
    pub params: &'a DirectParams,
}

/// One thing that shines.
#[derive(Clone, Copy, Debug)]
pub(super) enum Emitter {
    /// Its number in the tree.
    Polygon(usize),
    /// A node of the tree, and the samples that it gets.
    Cluster(usize, u32),
    /// Its number among the lights.
    Delta(usize),
}

/// Samples that a cluster gets at least.
const LEAST_CLUSTER_SAMPLES: u32 = 2;

/// A shadow ray, and what it brings where nothing is in its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    pub way: Way,
    /// About the geometric and the shading normal: the part that is known without rays, up to a factor.
    pub kernel: [f32; 2],
    /// The same times the emitter's light.
    pub light: [Rgb; 2],
    /// The light comes from no surface.
    pub is_light: bool,
    /// What blocks it: its number among [`Lights::shades`], none for every surface.
    pub shade: Option<u16>,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Way {
    To(Segment),
    Along(Ray),
}

impl Sight<'_> {
    /// The emitters that can light receivers within `radius` [m] of `position`; `normal` is zero where they face several ways.
    pub fn emitters(&self, position: Vec3, normal: Vec3, radius: f32) -> Vec<Emitter> {
        let tree = &self.lights.polygons;
        let cut = tree.cut(position, normal, radius);
        let estimate = |cluster: &Cluster| match cluster {
            Cluster::Polygon(_) => 0.0,
            Cluster::Node(n) => tree.estimate(*n, position),
        };
        let total: f32 = cut.iter().map(estimate).sum();
        let emitter = |cluster: &Cluster| match cluster {
            Cluster::Polygon(p) => Emitter::Polygon(*p),
            Cluster::Node(n) => {
                let share = self.params.cluster_samples as f32 * estimate(cluster) / total;
                Emitter::Cluster(*n, (share.ceil() as u32).max(LEAST_CLUSTER_SAMPLES))
            }
        };
        cut.iter().map(emitter).chain((0..self.lights.delta.len()).map(Emitter::Delta)).collect()
    }

    /// The distance from `position` of the nearest polygon among `emitters` [m].
    pub fn nearest(&self, emitters: &[Emitter], position: Vec3) -> f32 {
        let distance = |emitter: &Emitter| match emitter {
            Emitter::Polygon(p) => {
                let polygon = &self.lights.polygons.polygons[*p];
                polygon.centre.distance(position) - polygon.radius
            }
            Emitter::Cluster(..) | Emitter::Delta(_) => f32::INFINITY,
        };
        emitters.iter().map(distance).fold(f32::INFINITY, f32::min)
    }
}

impl Emitter {
    /// A number below 32 that tells emitters apart as far as it goes; clusters have none.
    fn number(self) -> Option<u32> {
        match self {
            Self::Polygon(p) => Some(p as u32 % 32),
            Self::Delta(k) => Some((k as u32 + 16) % 32),
            Self::Cluster(..) => None,
        }
    }

    /// The bit of the number.
    pub fn bit(self) -> u32 {
        self.number().map_or(0, |n| 1 << n)
    }

    /// The dimensions of random numbers that a close look at it draws; the first ones are for all.
    pub fn set(self) -> u32 {
        match self {
            Self::Cluster(n, _) => 33 + n as u32 % 28,
            _ => 1 + self.number().unwrap_or(0),
        }
    }

    /// True where its light differs over its area or by direction, so that it has noise without a shadow, too.
    pub fn is_varied(self, sight: &Sight) -> bool {
        let Self::Polygon(p) = self else { return false };
        match sight.lights.polygons.polygons[p].source {
            Source::Surface { textured, .. } => textured,
            Source::Light { varied, .. } => varied,
        }
    }

    /// True where its colour differs from place to place of a receiver, as of a picture that is thrown on it.
    pub fn is_colorful(self, sight: &Sight) -> bool {
        matches!(self, Self::Delta(k) if sight.lights.delta[k].is_colorful)
    }

    /// The light of one unit of the kernel, about.
    pub fn brightness(self, sight: &Sight) -> f32 {
        match self {
            Self::Polygon(p) => luminance(sight.lights.polygons.polygons[p].radiance),
            Self::Cluster(..) | Self::Delta(_) => 1.0,
        }
    }

    /// The kernel over the whole emitter without occluders, mean over the receiver, about the geometric and the shading normal:
    /// of polygons pi times the form factor, of delta lights the luminance. None of clusters.
    pub fn unoccluded(self, sight: &Sight, site: &Site) -> Option<[f32; 2]> {
        match self {
            Self::Cluster(..) => None,
            Self::Polygon(p) => {
                let polygon = &sight.lights.polygons.polygons[p];
                let evenness = Evenness::From(site.nearest);
                Some(site.mean(evenness, |point, _| form_factors(sight.tracer, polygon, &sight.as_shown(point))))
            }
            Self::Delta(k) => {
                let light = &sight.lights.delta[k];
                let kernel = |point: &SurfacePoint, u| {
                    unshadowed(sight.scene, light, &sight.as_shown(point), u)
                        .map_or([0.0; 2], |(e, _)| e.map(luminance))
                };
                Some(site.mean(light.evenness(site.receiver.position, site.receiver.radius), kernel))
            }
        }
    }

    /// A shadow ray from `point`; `u` picks the place on the emitter. None where nothing can arrive.
    pub fn shot(self, sight: &Sight, point: &SurfacePoint, [s, t]: [f32; 2]) -> Option<Shot> {
        let Sight { scene, tracer, lights, .. } = *sight;
        let tree = &lights.polygons;
        let point = &sight.as_shown(point);
        let to_polygon = |polygon: &Polygon, to: Vec3, area: f32| {
            let link = link(tracer, point, polygon, to);
            let kernel = [link.transport * area, link.shown * area];
            let radiance = polygon.radiance_towards(scene, to, -link.towards);
            let is_light = matches!(polygon.source, Source::Light { .. });
            let way = if polygon.is_portal() {
                Way::Along(Ray { origin: link.segment.from, direction: link.towards })
            } else {
                Way::To(link.segment)
            };
            let shot = Shot { way, kernel, light: kernel.map(|k| radiance * k), is_light, shade: polygon.shade };
            (link.transport > 0.0 || link.shown > 0.0).then_some(shot)
        };
        match self {
            Self::Polygon(p) => {
                let polygon = &tree.polygons[p];
                // What is below one of the horizons may be above the other.
                let (to, area) = match point.shading == point.normal {
                    true => polygon.sample_above(point.position, point.normal, [s, t])?,
                    false => (polygon.sample([s, t]), polygon.area),
                };
                to_polygon(polygon, to, area)
            }
            Self::Cluster(n, _) => {
                let (p, probability, s) = tree.sample(n, s);
                let polygon = &tree.polygons[p];
                to_polygon(polygon, polygon.sample([s, t]), polygon.area / probability)
            }
            Self::Delta(k) => {
                let delta = &lights.delta[k];
                let (light, arrival) = unshadowed(scene, delta, point, [s, t])?;
                let from = origin(tracer, point);
                let way = if arrival.distance.is_finite() {
                    Way::To(Segment { from, to: point.position + arrival.towards * arrival.distance })
                } else {
                    Way::Along(Ray { origin: from, direction: arrival.towards })
                };
                Some(Shot { way, kernel: light.map(luminance), light, is_light: true, shade: delta.shade })
            }
        }
    }
}

/// pi times the form factor of a polygon about the geometric and the shading normal of a point.
fn form_factors(tracer: &Tracer, polygon: &Polygon, point: &SurfacePoint) -> [f32; 2] {
    if !polygon.lit.holds(point.surface) || !polygon.faces(point.position, tracer.offset()) {
        return [0.0; 2];
    }
    let f = PI * point_to_polygon(point.position, point.normal, &polygon.corners);
    if point.shading != point.normal {
        [f, PI * point_to_polygon(point.position, point.shading, &polygon.corners)]
    } else {
        [f; 2]
    }
}

/// The geometry between a receiver's point and a polygon's.
pub struct Link {
    pub segment: Segment,
    /// Unit, from the receiver.
    pub towards: Vec3,
    /// Solid angle for each unit of area on the polygon, cos / r^2 [sr/m^2].
    pub kernel: f32,
    /// cos cos / r^2 about the geometric and the shading normal [1/m^2].
    pub transport: f32,
    pub shown: f32,
}

/// The link to the point `to` of a polygon, for each unit of area there; nothing goes to a surface that it is not linked to.
pub fn link(tracer: &Tracer, point: &SurfacePoint, polygon: &Polygon, to: Vec3) -> Link {
    let way = to - point.position;
    let square = way.length_squared().max(f32::MIN_POSITIVE);
    let towards = way / square.sqrt();
    let (cos, leaving) = (point.normal.dot(towards).max(0.0), polygon.cosine(-towards));
    let kernel = if polygon.lit.holds(point.surface) { leaving / square } else { 0.0 };
    // The far end is moved off the emitter to the side that the receiver sees.
    let side = if polygon.normal.dot(towards) <= 0.0 { polygon.normal } else { -polygon.normal };
    Link {
        segment: Segment { from: origin(tracer, point), to: tracer.off_surface(to, side) },
        towards,
        kernel,
        transport: kernel * cos,
        shown: kernel * point.shading.dot(towards).max(0.0),
    }
}
