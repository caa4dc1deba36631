//! What shines, as points and outlines that shadows start from.

use super::Stage;
use super::occluder::Edge;
use crate::color::luminance;
use crate::light::Lights;
use crate::light::delta::DeltaLight;
use crate::light::polygon::{Polygon, Source, ball};
use crate::scene::{LightShape, Linked, Scene};
use crate::trace::Ray;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Something that shines: a light, or connected polygons of a surface.
pub struct Emitter {
    pub shape: Shape,
    /// Middle [m], or the direction towards it.
    pub middle: Apex,
    /// Its number among the shades of the lights.
    pub shade: Option<u16>,
    /// The surfaces that block its light.
    blockers: Linked,
    strength: Strength,
}

/// Where light comes from.
#[derive(Clone, Copy, Debug)]
pub enum Apex {
    At(DVec3),
    /// Infinitely far: the unit vector towards it.
    Towards(DVec3),
}

/// What an emitter looks like.
pub enum Shape {
    /// Without size.
    Point,
    /// A ball of a radius [m].
    Ball(f64),
    /// A sun's disc of half an angle [rad].
    Disc(f64),
    Hull(Hull),
}

/// The convex hull of polygons that shine.
pub struct Hull {
    pub points: Vec<DVec3>,
    /// Its edges by the numbers of points; none where there are too many to follow.
    pub edges: Vec<[usize; 2]>,
    /// Flat ones shine along this unit vector, or to both sides.
    pub normal: Option<DVec3>,
    pub two_sided: bool,
    pub radius: f64,
}

/// How strong it is.
enum Strength {
    /// A light's number among the delta lights.
    Delta(usize),
    /// Radiance (luminance) times area [nit m^2], area [m^2], one of its polygons.
    Polygons { power: f64, area: f64, first: usize },
}

/// The most emitters that shadows are found of.
const MOST: usize = 48;
/// The most that are looked at with rays.
const MOST_SAMPLED: usize = 256;
/// Points on receivers that the mean light is taken of.
const SAMPLES: usize = 512;
/// The most points of a hull.
const MOST_POINTS: usize = 64;
/// The most edges that a hull without a plane is followed along.
const MOST_EDGES: usize = 24;
/// Suns wider than this [rad] cast no shadow with a border.
const WIDEST: f64 = 0.5;

/// All emitters.
pub fn emitters(scene: &Scene, lights: &Lights) -> Vec<Emitter> {
    let delta = lights.delta.iter().enumerate().filter_map(|(k, light)| from_delta(scene, k, light));
    let polygons = &lights.polygons.polygons;
    delta.chain(groups(polygons).iter().filter_map(|group| from_polygons(scene, polygons, group))).collect()
}

fn from_delta(scene: &Scene, number: usize, light: &DeltaLight) -> Option<Emitter> {
    let (shape, middle) = match light.shape() {
        LightShape::Point { position, .. } | LightShape::Spot { position, .. } => {
            (Shape::Point, Apex::At(position.as_dvec3()))
        }
        LightShape::Directional { direction, angle, .. } => {
            let half = 0.5 * f64::from(*angle);
            let shape = if half > 0.0 { Shape::Disc(half) } else { Shape::Point };
            (half <= WIDEST).then_some((shape, Apex::Towards(-direction.as_dvec3().normalize())))?
        }
        LightShape::Sphere { world_from_unit, .. } => {
            let (centre, radius) = ball(world_from_unit)?;
            (Shape::Ball(radius.into()), Apex::At(centre.as_dvec3()))
        }
        _ => return None,
    };
    let blockers = scene.lights[light.number()].links.blockers.clone();
    Some(Emitter { shape, middle, shade: light.shade, blockers, strength: Strength::Delta(number) })
}

/// Polygons that make up one emitter: those of one light, and connected triangles of one surface.
fn groups(polygons: &[Polygon]) -> Vec<Vec<usize>> {
    let mut root: Vec<usize> = (0..polygons.len()).collect();
    fn find(root: &mut [usize], mut i: usize) -> usize {
        while root[i] != i {
            root[i] = root[root[i]];
            i = root[i];
        }
        i
    }
    let mut known: HashMap<(bool, usize, [[u32; 3]; 2]), usize> = HashMap::new();
    for (i, polygon) in polygons.iter().enumerate() {
        let mut join = |key| {
            let other = *known.entry(key).or_insert(i);
            let (a, b) = (find(&mut root, i), find(&mut root, other));
            root[a.max(b)] = a.min(b);
        };
        match polygon.source {
            Source::Light { light, .. } => join((true, light, [[0; 3]; 2])),
            Source::Surface { surface, .. } => sides(polygon).for_each(|side| join((false, surface, side))),
        }
    }
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut place = HashMap::new();
    for i in 0..polygons.len() {
        let r = find(&mut root, i);
        let group = *place.entry(r).or_insert_with(|| {
            groups.push(Vec::new());
            groups.len() - 1
        });
        groups[group].push(i);
    }
    groups
}

/// The sides of a polygon by the bits of their ends.
fn sides(polygon: &Polygon) -> impl Iterator<Item = [[u32; 3]; 2]> {
    let bits = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
    let n = polygon.corners.len();
    (0..n).map(move |k| {
        let (a, b) = (bits(polygon.corners[k]), bits(polygon.corners[(k + 1) % n]));
        [a.min(b), a.max(b)]
    })
}

fn from_polygons(scene: &Scene, polygons: &[Polygon], group: &[usize]) -> Option<Emitter> {
    let first = &polygons[*group.first()?];
    let members = || group.iter().map(|i| &polygons[*i]);
    let area: f64 = members().map(|p| f64::from(p.area)).sum();
    let power: f64 = members().map(|p| f64::from(p.area * luminance(p.radiance))).sum();
    let middle = members().map(|p| p.centre.as_dvec3() * f64::from(p.area)).sum::<DVec3>() / area;
    let mut points: Vec<DVec3> = members().flat_map(|p| p.corners.iter().map(|c| c.as_dvec3())).collect();
    points.sort_by_key(|p| p.to_array().map(|x| (x + 0.0).to_bits()));
    points.dedup();
    let radius = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
    let normal = first.normal.as_dvec3().normalize();
    let is_flat = members().all(|p| p.normal.dot(first.normal) > 1.0 - 1e-4)
        && points.iter().all(|p| (*p - middle).dot(normal).abs() <= 1e-3 * radius);
    let (points, edges) = if is_flat {
        let points = flat_hull(&points, normal);
        let edges = (0..points.len()).map(|k| [k, (k + 1) % points.len()]).collect();
        (points, edges)
    } else {
        (extremes(points), Vec::new())
    };
    let mut hull = Hull { points, edges, normal: is_flat.then_some(normal), two_sided: first.two_sided, radius };
    if !is_flat {
        hull.edges = solid_edges(&hull.points);
    }
    let strength = Strength::Polygons { power, area, first: group[0] };
    let blockers = match first.source {
        Source::Light { light, .. } => scene.lights[light].links.blockers.clone(),
        Source::Surface { .. } => Linked::All,
    };
    Some(Emitter { shape: Shape::Hull(hull), middle: Apex::At(middle), shade: first.shade, blockers, strength })
}

/// The corners of the convex hull of points in a plane, counter-clockwise about `normal` (Andrew's monotone chain,
/// 1979).
fn flat_hull(points: &[DVec3], normal: DVec3) -> Vec<DVec3> {
    let (x, y) = normal.any_orthonormal_pair();
    let mut flat: Vec<(DVec2, DVec3)> = points.iter().map(|p| (DVec2::new(p.dot(x), p.dot(y)), *p)).collect();
    flat.sort_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y)));
    let size = flat.last().map_or(0.0, |l| l.0.distance(flat[0].0));
    let half = |points: &mut dyn Iterator<Item = &(DVec2, DVec3)>| {
        let mut hull: Vec<(DVec2, DVec3)> = Vec::new();
        for p in points {
            while let [.., a, b] = hull[..]
                && (b.0 - a.0).perp_dot(p.0 - b.0) <= 1e-6 * size * size
            {
                hull.pop();
            }
            hull.push(*p);
        }
        hull.pop();
        hull
    };
    let mut hull = half(&mut flat.iter());
    hull.extend(half(&mut flat.iter().rev()));
    let every = hull.len().div_ceil(MOST_POINTS).max(1);
    hull.into_iter().map(|(_, p)| p).step_by(every).collect()
}

/// Those of many points that lie farthest in some direction.
fn extremes(points: Vec<DVec3>) -> Vec<DVec3> {
    if points.len() <= MOST_EDGES {
        return points;
    }
    let golden = PI * (3.0 - 5f64.sqrt());
    let farthest = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / MOST_POINTS as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let direction = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
        let distance = |i: &usize| points[*i].dot(direction);
        (0..points.len()).max_by(|a, b| distance(a).total_cmp(&distance(b)).then(b.cmp(a)))
    };
    let mut chosen: Vec<usize> = (0..MOST_POINTS).filter_map(farthest).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|i| points[i]).collect()
}

/// Pairs of few points between which the hull has an edge: a plane through both has all others on one side.
fn solid_edges(points: &[DVec3]) -> Vec<[usize; 2]> {
    if points.len() > MOST_EDGES / 2 {
        return Vec::new();
    }
    let mut edges = Vec::new();
    for a in 0..points.len() {
        for b in a + 1..points.len() {
            let along = (points[b] - points[a]).normalize();
            let rest: Vec<DVec3> = points.iter().map(|p| (*p - points[a]).reject_from(along)).collect();
            let is_hull = |n: DVec3| rest.iter().all(|r| r.dot(n) <= 1e-6 * r.length());
            // The faces beside an edge turn by more than nothing: two planes support it.
            let planes = rest.iter().filter_map(|r| along.cross(*r).try_normalize());
            let supporting = planes.flat_map(|n| [n, -n]).filter(|n| is_hull(*n));
            let mut first = None;
            if supporting.into_iter().any(|n| n.dot(*first.get_or_insert(n)) < 1.0 - 1e-6) {
                edges.push([a, b]);
            }
        }
    }
    if edges.len() > MOST_EDGES { Vec::new() } else { edges }
}

impl Apex {
    /// The unit vector in which its light travels at `position`, and how far it has come [m].
    pub fn way(self, position: DVec3) -> (DVec3, f64) {
        match self {
            Self::At(at) => {
                let way = position - at;
                let length = way.length();
                (way / length.max(f64::MIN_POSITIVE), length)
            }
            Self::Towards(towards) => (-towards, f64::INFINITY),
        }
    }
}

impl Emitter {
    /// Illuminance of what faces it at `position`, with nothing in its way, about [lx].
    pub fn illuminance(&self, scene: &Scene, lights: &Lights, position: DVec3) -> f64 {
        match self.strength {
            Strength::Delta(k) => {
                let arrival = lights.delta[k].arrive(scene, position.as_vec3(), [0.5; 2]);
                arrival.map_or(0.0, |a| luminance(a.illuminance).into())
            }
            Strength::Polygons { power, area, first } => {
                let (way, distance) = self.middle.way(position);
                let Shape::Hull(hull) = &self.shape else { return 0.0 };
                let cos = hull.normal.map_or(0.25, |n| if hull.two_sided { n.dot(way).abs() } else { n.dot(way) });
                let polygon = &lights.polygons.polygons[first];
                let power = match polygon.source {
                    Source::Light { varied: true, portal: false, .. } => {
                        area * f64::from(luminance(polygon.radiance_towards(scene, polygon.centre, way.as_vec3())))
                    }
                    _ => power,
                };
                // Nearer than its own size it fills no more than the whole hemisphere.
                power * cos.max(0.0) / (distance * distance).max(area / PI)
            }
        }
    }

    /// True where it is linked to `surface`.
    pub fn shines_on(&self, lights: &Lights, surface: u32) -> bool {
        match self.strength {
            Strength::Delta(k) => lights.delta[k].shines_on(surface),
            Strength::Polygons { first, .. } => lights.polygons.polygons[first].lit.holds(surface),
        }
    }

    /// True where an edge belongs to what blocks its light.
    pub fn is_blocked_by(&self, stage: &Stage, edge: &Edge) -> bool {
        self.blockers.holds(stage.tracer.place(edge.triangle).0 as u32)
    }

    /// Where light may come from: the points that wedges are laid through.
    pub fn points(&self) -> Vec<Apex> {
        match &self.shape {
            Shape::Hull(hull) => hull.points.iter().map(|p| Apex::At(*p)).collect(),
            _ => vec![self.middle],
        }
    }

    /// How far short of it a ray ends [m], so that it isn't its own shadow.
    pub fn margin(&self) -> f64 {
        match &self.shape {
            Shape::Point | Shape::Disc(_) => 0.0,
            Shape::Ball(radius) => 0.1 * radius,
            Shape::Hull(hull) if hull.normal.is_some() => 0.0,
            Shape::Hull(hull) => 0.1 * hull.radius,
        }
    }

    /// Length across `along` (unit) of what is seen of it from `position` [m at its distance]; of a sun [rad].
    pub fn width(&self, position: DVec3, along: DVec3) -> f64 {
        match &self.shape {
            Shape::Point => 0.0,
            Shape::Ball(radius) => 2.0 * radius,
            Shape::Disc(half) => 2.0 * half.tan(),
            Shape::Hull(hull) => {
                let across = along.cross(self.middle.way(position).0).normalize_or_zero();
                let spread = hull.points.iter().map(|p| across.dot(*p));
                let (low, high) = spread.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
                high - low
            }
        }
    }
}

/// The emitters that light the receivers of the scene most, at most [`MOST`], and the mean direct light of these [lx].
pub fn mean_light(stage: &Stage, mut emitters: Vec<Emitter>) -> (Vec<Emitter>, f64) {
    let samples = receiver_samples(stage);
    if samples.is_empty() {
        return (Vec::new(), 0.0);
    }
    let open = |e: &Emitter, (surface, p, n): &(u32, DVec3, DVec3)| {
        let cos = -e.middle.way(*p).0.dot(*n);
        if cos <= 0.0 || !e.shines_on(stage.lights, *surface) {
            return 0.0;
        }
        cos * e.illuminance(stage.scene, stage.lights, *p)
    };
    let keep = |emitters: Vec<Emitter>, light: Vec<f64>, most: usize| {
        let mut order: Vec<usize> = (0..emitters.len()).filter(|i| light[*i] > 0.0).collect();
        order.sort_by(|a, b| light[*b].total_cmp(&light[*a]).then(a.cmp(b)));
        order.truncate(most);
        order.sort_unstable();
        let mut kept = order.into_iter().peekable();
        let chosen = emitters.into_iter().enumerate().filter(|(i, _)| kept.next_if_eq(i).is_some());
        chosen.map(|(_, e)| e).collect::<Vec<_>>()
    };
    let unshadowed = emitters.par_iter().map(|e| samples.iter().map(|s| open(e, s)).sum()).collect();
    emitters = keep(emitters, unshadowed, MOST_SAMPLED);
    let sums = |pairs: Vec<[f64; 2]>| pairs.iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
    let shadowed = |e: &Emitter| -> Vec<[f64; 2]> {
        let light = samples.iter().map(|s| (open(e, s), s));
        light
            .map(|(light, s)| {
                [light, if light > 0.0 && is_open(stage, e, s.1, s.2, DVec3::ZERO) { light } else { 0.0 }]
            })
            .collect()
    };
    let light: Vec<[f64; 2]> = emitters.par_iter().map(|e| sums(shadowed(e))).collect();
    let mean = light.iter().map(|[_, seen]| seen).sum::<f64>() / samples.len() as f64;
    // What comes in through a small opening may be missed by all samples.
    let light = light.iter().map(|[open, seen]| seen.max(0.01 * open)).collect();
    (keep(emitters, light, MOST), mean)
}

/// True where nothing solid is between a receiver and the middle of an emitter, moved by `lift` [m].
pub fn is_open(stage: &Stage, emitter: &Emitter, position: DVec3, normal: DVec3, lift: DVec3) -> bool {
    let Some(tracer) = stage.lights.tracer(stage.tracer, emitter.shade) else { return true };
    let origin = tracer.off_surface(position.as_vec3(), normal.as_vec3());
    let (way, distance) = emitter.middle.way(origin.as_dvec3() - lift);
    let mut hit = [None];
    tracer.closest_solid(&[Ray { origin, direction: -way.as_vec3() }], &mut hit);
    let reach = distance - emitter.margin() - 4.0 * f64::from(tracer.offset());
    hit[0].is_none_or(|h| f64::from(h.t) >= reach * (1.0 - 1e-4))
}

/// Places on receivers, even over their area: surface, position [m], unit normal.
fn receiver_samples(stage: &Stage) -> Vec<(u32, DVec3, DVec3)> {
    let occluders = stage.occluders;
    let mut sums = Vec::with_capacity(occluders.corners.len());
    let mut total = 0.0;
    for (number, [a, b, c]) in (0..).zip(&occluders.corners) {
        if stage.scene.surfaces[stage.tracer.place(number).0].role.receives {
            total += 0.5 * (*b - *a).cross(*c - *a).length();
        }
        sums.push(total);
    }
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let sample = |k: usize| {
        let number = sums.partition_point(|s| *s <= total * (k as f64 + 0.5) / SAMPLES as f64).min(sums.len() - 1);
        let [a, b, c] = occluders.corners[number];
        // The R2 sequence (Roberts 2018), folded into the triangle.
        let (mut u, mut v) = ((0.5 + 0.754_877_666 * k as f64).fract(), (0.5 + 0.569_840_291 * k as f64).fract());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let normal = (b - a).cross(c - a).normalize_or_zero();
        (stage.tracer.place(number as u32).0 as u32, a + (b - a) * u + (c - a) * v, normal)
    };
    (0..SAMPLES).map(sample).collect()
}
