//! Direct light at every patch: analytic form factors times sampled visibility for polygons, shadow rays for delta lights,
//! brightness samples for a sky with a picture.
//!
//! A polygon's unoccluded irradiance is exact ([`point_to_polygon`]); the visible share of it is estimated as a ratio of two
//! sums over the same samples (Heitz, Hill, McGuire 2018, "Combining analytic direct illumination and stochastic shadows"),
//! so that a receiver without shadows has no noise at all. More samples are taken where the first ones disagree.

use super::delta::{Arrival, DeltaLight};
use super::polygon::{Polygon, Source};
use super::tree::Cluster;
use super::{Lights, Lit};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::contour::point_to_polygon;
use crate::patch::{Footprint, Ground, SurfacePoint};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::cosine_hemisphere_pdf;
use crate::scene::Scene;
use crate::trace::{Ray, Segment, Tracer};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// How much effort direct light gets.
#[derive(Clone, Debug)]
pub struct DirectParams {
    /// Shadow samples shared among the polygons of a cut, at first; four times as many where they disagree. At least 1.
    pub polygon_samples: u32,
    /// Shadow rays for each delta light at first; eight times as many where they disagree. At least 1.
    pub delta_samples: u32,
    /// Brightness samples of a sky with a picture, for each ray of the final gather; 0 leaves the sky to the gather alone.
    pub sky_ratio: f32,
    /// Rays of the final gather.
    pub gather_samples: u32,
    /// Whether irradiance is shown about the interpolated normal.
    pub shading_normals: bool,
    pub seed: u32,
}

/// Irradiance straight from lights [lx], one a patch. The share of the sky that the gather finds is not in it.
#[derive(Clone, Debug)]
pub struct Direct {
    /// About the normal that is shown.
    pub shown: Vec<Rgb>,
    /// About the geometric normal, for transport.
    pub transport: Vec<Rgb>,
    /// The part of `transport` from lights that are no surface, as flux over all patches [lm].
    pub inflow: glam::DVec3,
    /// Shadow rays that were traced.
    pub rays: u64,
}

/// What arrives at one receiver.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arriving {
    pub shown: Rgb,
    pub transport: Rgb,
    /// The part of `transport` from lights that are no surface.
    pub other: Rgb,
    pub rays: u64,
}

/// A place that light is collected at: points drawn from it, and bounds on all of them.
pub struct Receiver<'a> {
    /// A point uniform over the receiver's area, from the unit square.
    pub sample: &'a (dyn Fn([f32; 2]) -> SurfacePoint + Sync),
    pub position: Vec3,
    pub normal: Vec3,
    /// Radius around `position` [m].
    pub radius: f32,
    pub sequence: Sequence,
}

/// Shadow samples that a polygon or cluster gets at least.
const LEAST_SAMPLES: u32 = 2;
/// Points over which the unoccluded irradiance of a polygon is averaged.
const ANALYTIC_POINTS: u32 = 4;
/// How often the first shadow samples are taken again where they disagree: polygons, and delta lights.
const POLYGON_REFINEMENT: u32 = 4;
const DELTA_REFINEMENT: u32 = 8;
/// Points over which the unshadowed light of a delta light is averaged.
const UNSHADOWED_POINTS: u32 = 16;

/// Direct light at every patch that is not buried.
///
/// # Errors
/// `Cancelled`.
pub fn direct(lit: &Lit, progress: &dyn Progress) -> Result<Direct> {
    let Lit { ground, exposure, lights, params, .. } = *lit;
    let patches = ground.patches;
    progress.begin("direct", patches.len() as u64);
    let arriving: Vec<Arriving> = (0..patches.len())
        .into_par_iter()
        .map(|i| {
            if i % 64 == 0 {
                progress.check()?;
                progress.advance(64.min(patches.len() - i) as u64);
            }
            if exposure.is_buried(i) {
                return Ok(Arriving::default());
            }
            let mut footprint = ground.footprint(i);
            if footprint.is_empty() {
                return Ok(Arriving::default());
            }
            footprint.restrict(exposure.cells[i]);
            Ok(at_patch(ground, lights, params, i, &footprint))
        })
        .collect::<Result<_>>()?;
    let mut inflow = glam::DVec3::ZERO;
    for (a, area) in arriving.iter().zip(&exposure.area) {
        inflow += a.other.as_dvec3() * f64::from(*area);
    }
    Ok(Direct {
        inflow,
        rays: arriving.iter().map(|a| a.rays).sum(),
        shown: arriving.iter().map(|a| a.shown).collect(),
        transport: arriving.into_iter().map(|a| a.transport).collect(),
    })
}

fn at_patch(ground: &Ground, lights: &Lights, params: &DirectParams, i: usize, footprint: &Footprint) -> Arriving {
    let patches = ground.patches;
    let receiver = Receiver {
        sample: &|u| footprint.sample(u),
        position: patches.position[i],
        normal: patches.normal[i],
        radius: footprint.radius(patches.position[i]),
        sequence: Sequence::new(params.seed, Stage::Direct, i as u64),
    };
    arrive(ground.scene, ground.tracer, lights, &receiver, params)
}

/// Everything that arrives straight from lights at `receiver`.
pub fn arrive(scene: &Scene, tracer: &Tracer, lights: &Lights, receiver: &Receiver, params: &DirectParams) -> Arriving {
    let mut sum = Arriving::default();
    from_polygons(scene, tracer, lights, receiver, params, &mut sum);
    from_delta(tracer, lights, receiver, params, &mut sum);
    from_sky(scene, tracer, lights, receiver, params, &mut sum);
    if !params.shading_normals {
        sum.shown = sum.transport;
    }
    sum
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

/// The link to the point `to` of a polygon, for each unit of area there.
pub fn link(tracer: &Tracer, point: &SurfacePoint, polygon: &Polygon, to: Vec3) -> Link {
    let way = to - point.position;
    let square = way.length_squared().max(f32::MIN_POSITIVE);
    let towards = way / square.sqrt();
    let (cos, leaving) = (point.normal.dot(towards).max(0.0), polygon.cosine(-towards));
    let kernel = leaving / square;
    // The far end is moved off the emitter to the side that the receiver sees.
    let side = if polygon.normal.dot(towards) <= 0.0 { polygon.normal } else { -polygon.normal };
    Link {
        segment: Segment { from: tracer.off_surface(point.position, point.normal), to: tracer.off_surface(to, side) },
        towards,
        kernel,
        transport: kernel * cos,
        shown: if cos > 0.0 { kernel * point.shading.dot(towards).max(0.0) } else { 0.0 },
    }
}

fn from_polygons(
    scene: &Scene,
    tracer: &Tracer,
    lights: &Lights,
    receiver: &Receiver,
    params: &DirectParams,
    sum: &mut Arriving,
) {
    let tree = &lights.polygons;
    let cut = tree.cut(receiver.position, receiver.normal, receiver.radius);
    if cut.is_empty() {
        return;
    }
    let points: Vec<SurfacePoint> = (0..ANALYTIC_POINTS)
        .map(|k| {
            let [x, y, ..] = receiver.sequence.point(k, 0);
            (receiver.sample)([x, y])
        })
        .collect();
    // Unoccluded irradiance per unit of radiance about the two normals, or an estimate for a cluster.
    let weights: Vec<[f32; 2]> = cut
        .iter()
        .map(|cluster| match cluster {
            Cluster::Polygon(p) => unoccluded(tracer, &tree.polygons[*p], &points, params.shading_normals),
            Cluster::Node(n) => [tree.estimate(*n, receiver.position); 2],
        })
        .collect();
    let brightness = |k: usize| match cut[k] {
        Cluster::Polygon(p) => weights[k][0].max(weights[k][1]) * luminance(tree.polygons[p].radiance),
        Cluster::Node(_) => weights[k][0],
    };
    let total: f32 = (0..cut.len()).map(brightness).sum();
    for (k, cluster) in cut.iter().enumerate() {
        if weights[k] == [0.0; 2] {
            continue;
        }
        let share = if total > 0.0 { brightness(k) / total } else { 1.0 };
        let samples = ((params.polygon_samples as f32 * share).ceil() as u32).max(LEAST_SAMPLES);
        let draw = |index: u32| receiver.sequence.point(index, 1 + k as u32);
        let (arrived, rays, is_light) = match cluster {
            Cluster::Polygon(p) => {
                let polygon = &tree.polygons[*p];
                let (arrived, rays) = visible_polygon(scene, tracer, polygon, weights[k], receiver, samples, draw);
                (arrived, rays, matches!(polygon.source, Source::Light { .. }))
            }
            Cluster::Node(n) => {
                let (arrived, other, rays) = sampled_cluster(scene, tracer, lights, *n, receiver, samples, draw);
                sum.other += other;
                (arrived, rays, false)
            }
        };
        sum.transport += arrived[0];
        sum.shown += arrived[1];
        if is_light {
            sum.other += arrived[0];
        }
        sum.rays += rays;
    }
}

/// pi times the mean form factor of a polygon over `points`, about the geometric and the shading normals.
fn unoccluded(tracer: &Tracer, polygon: &Polygon, points: &[SurfacePoint], shading_normals: bool) -> [f32; 2] {
    let mut sum = [0.0f32; 2];
    for point in points {
        if polygon.faces(point.position, tracer.offset()) {
            let f = point_to_polygon(point.position, point.normal, &polygon.corners);
            sum[0] += f;
            sum[1] += if shading_normals && point.shading != point.normal {
                point_to_polygon(point.position, point.shading, &polygon.corners)
            } else {
                f
            };
        }
    }
    sum.map(|f| f * PI / points.len() as f32)
}

/// The irradiance of one polygon: unoccluded times the share of it that is seen.
fn visible_polygon(
    scene: &Scene,
    tracer: &Tracer,
    polygon: &Polygon,
    unoccluded: [f32; 2],
    receiver: &Receiver,
    samples: u32,
    draw: impl Fn(u32) -> [f32; 4],
) -> ([Rgb; 2], u64) {
    let (mut seen, mut whole) = ([Rgb::ZERO; 2], [0.0f32; 2]);
    let mut taken = 0;
    let (mut visible, mut facing) = (0, 0);
    let (mut links, mut segments, mut blocked) = (Vec::new(), Vec::new(), Vec::new());
    for end in [samples, samples * POLYGON_REFINEMENT] {
        if facing > 0 && (visible == 0 || visible == facing) {
            break;
        }
        links.clear();
        segments.clear();
        for index in taken..end {
            let [x, y, s, t] = draw(index);
            let point = (receiver.sample)([x, y]);
            let Some((to, area)) = polygon.sample_above(point.position, point.normal, [s, t]) else { continue };
            let mut link = link(tracer, &point, polygon, to);
            link.transport *= area;
            link.shown *= area;
            segments.push(link.segment);
            links.push((link, to));
        }
        blocked.clear();
        blocked.resize(segments.len(), false);
        tracer.occluded(&segments, &mut blocked);
        for ((link, to), blocked) in links.iter().zip(&blocked) {
            whole[0] += link.transport;
            whole[1] += link.shown;
            facing += u32::from(link.transport > 0.0);
            if !blocked && link.transport > 0.0 {
                visible += 1;
                let radiance = polygon.radiance_towards(scene, *to, -link.towards);
                seen[0] += radiance * link.transport;
                seen[1] += radiance * link.shown;
            }
        }
        taken = end;
    }
    let ratio = |k: usize| if whole[k] > 0.0 { seen[k] / whole[k] * unoccluded[k] } else { Rgb::ZERO };
    ([ratio(0), ratio(1)], u64::from(taken))
}

/// The irradiance of a cluster by plain area sampling, polygons drawn by power; and the part from lights that are no surface.
fn sampled_cluster(
    scene: &Scene,
    tracer: &Tracer,
    lights: &Lights,
    node: usize,
    receiver: &Receiver,
    samples: u32,
    draw: impl Fn(u32) -> [f32; 4],
) -> ([Rgb; 2], Rgb, u64) {
    let (mut sum, mut other) = ([Rgb::ZERO; 2], Rgb::ZERO);
    for index in 0..samples {
        let [x, y, s, t] = draw(index);
        let (p, probability, s) = lights.polygons.sample(node, s);
        let polygon = &lights.polygons.polygons[p];
        let to = polygon.sample([s, t]);
        let link = link(tracer, &(receiver.sample)([x, y]), polygon, to);
        let mut blocked = [false];
        tracer.occluded(&[link.segment], &mut blocked);
        if !blocked[0] {
            let value =
                polygon.radiance_towards(scene, to, -link.towards) * (polygon.area / (probability * samples as f32));
            sum[0] += value * link.transport;
            sum[1] += value * link.shown;
            if matches!(polygon.source, Source::Light { .. }) {
                other += value * link.transport;
            }
        }
    }
    (sum, other, u64::from(samples))
}

/// Illuminance of one delta light at one point about the geometric and the shading normal, and how it comes; `None` where the
/// point faces away from it.
pub fn unshadowed(light: &DeltaLight, point: &SurfacePoint, u: [f32; 2]) -> Option<([Rgb; 2], Arrival)> {
    let arrival = light.arrive(point.position, u)?;
    let cos = point.normal.dot(arrival.towards);
    let shading = point.shading.dot(arrival.towards).max(0.0);
    (cos > 0.0).then(|| ([arrival.illuminance * cos, arrival.illuminance * shading], arrival))
}

/// Whether something stands between `point` and the light that arrives there.
pub fn is_shadowed(tracer: &Tracer, point: &SurfacePoint, arrival: &Arrival) -> bool {
    let from = tracer.off_surface(point.position, point.normal);
    let mut blocked = [false];
    if arrival.distance.is_finite() {
        let to = point.position + arrival.towards * arrival.distance;
        tracer.occluded(&[Segment { from, to }], &mut blocked);
    } else {
        tracer.occluded_rays(&[Ray { origin: from, direction: arrival.towards }], &mut blocked);
    }
    blocked[0]
}

/// As for polygons: the unshadowed light over the footprint, which costs no ray, times the visible share of it.
fn from_delta(tracer: &Tracer, lights: &Lights, receiver: &Receiver, params: &DirectParams, sum: &mut Arriving) {
    for (k, light) in lights.delta.iter().enumerate() {
        let draw = |index: u32| {
            let [x, y, s, t] = receiver.sequence.point(index, 33 + k as u32);
            ((receiver.sample)([x, y]), [s, t])
        };
        let mut whole = [Rgb::ZERO; 2];
        for index in 0..UNSHADOWED_POINTS {
            let (point, u) = draw(index);
            if let Some((light, _)) = unshadowed(light, &point, u) {
                whole[0] += light[0];
                whole[1] += light[1];
            }
        }
        if whole[0] == Rgb::ZERO {
            continue;
        }
        let (mut seen, mut tried, mut visible, mut taken, mut facing) = ([0.0f32; 2], [0.0f32; 2], 0u32, 0u32, 0u32);
        let first = params.delta_samples * if light.is_soft() { 2 } else { 1 };
        for end in [first, first * DELTA_REFINEMENT] {
            if taken > 0 && (visible == 0 || visible == facing) && facing > 0 {
                break;
            }
            for index in taken..end {
                let (point, u) = draw(index);
                let Some((light, arrival)) = unshadowed(light, &point, u) else { continue };
                facing += 1;
                let blocked = is_shadowed(tracer, &point, &arrival);
                sum.rays += 1;
                visible += u32::from(!blocked);
                for k in 0..2 {
                    tried[k] += luminance(light[k]);
                    seen[k] += if blocked { 0.0 } else { luminance(light[k]) };
                }
            }
            taken = end;
        }
        let share = |k: usize| if tried[k] > 0.0 { seen[k] / tried[k] / UNSHADOWED_POINTS as f32 } else { 0.0 };
        sum.transport += whole[0] * share(0);
        sum.shown += whole[1] * share(1);
        sum.other += whole[0] * share(0);
    }
}

/// The share of a sky's picture that brightness samples carry; the gather carries the rest ([`hemisphere_weight`]).
fn from_sky(
    scene: &Scene,
    tracer: &Tracer,
    lights: &Lights,
    receiver: &Receiver,
    params: &DirectParams,
    sum: &mut Arriving,
) {
    let Some(sky) = lights.sky.as_ref().filter(|s| s.has_picture() && params.sky_ratio > 0.0) else { return };
    let samples = ((params.gather_samples as f32 * params.sky_ratio).ceil() as u32).max(1);
    for index in 0..samples {
        let [x, y, ..] = receiver.sequence.point(index, 62);
        let Some((towards, pdf)) = sky.sample(receiver.sequence.point(index, 61)) else { continue };
        let point = (receiver.sample)([x, y]);
        let cos = point.normal.dot(towards);
        if cos <= 0.0 {
            continue;
        }
        let mut blocked = [false];
        let origin = tracer.off_surface(point.position, point.normal);
        tracer.occluded_rays(&[Ray { origin, direction: towards }], &mut blocked);
        sum.rays += 1;
        if blocked[0] {
            continue;
        }
        let radiance = sky.radiance(scene, towards);
        let arrive = |cos: f32| {
            let weight = 1.0 - hemisphere_share(params.sky_ratio * pdf, cosine_hemisphere_pdf(cos));
            radiance * (cos * weight / (pdf * samples as f32))
        };
        sum.transport += arrive(cos);
        sum.other += arrive(cos);
        sum.shown += arrive(point.shading.dot(towards).max(0.0));
    }
}

/// The power heuristic (Veach, Guibas 1995): it leaves a small sun to the brightness samples nearly alone.
fn hemisphere_share(brightness: f32, hemisphere: f32) -> f32 {
    let (b, h) = (brightness * brightness, hemisphere * hemisphere);
    h / (b + h).max(f32::MIN_POSITIVE)
}

/// The weight of the sky's radiance on a ray of the gather (cosine-distributed about a normal at `cos`) that escapes
/// along `direction`: the other half of what brightness samples weigh.
pub fn hemisphere_weight(lights: &Lights, params: &DirectParams, direction: Vec3, cos: f32) -> f32 {
    match &lights.sky {
        Some(sky) if sky.has_picture() && params.sky_ratio > 0.0 => {
            hemisphere_share(params.sky_ratio * sky.pdf(direction), cosine_hemisphere_pdf(cos))
        }
        _ => 1.0,
    }
}
