//! The wedges of all emitters past all silhouettes that show.

use super::chain::LEAST_PIECE;
use super::emitter::{Apex, Emitter, Hull, Shape};
use super::occluder::Edge;
use super::wedge::{Pass, Stripe, Wedge};
use super::{CriticalLine, Order, Stage};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The most pairs of emitter and edge that are looked at.
const MOST_PAIRS: usize = 100_000;
/// Shadows are at most so many times as long as their edges, of those worth a look.
const MAGNIFICATION: f64 = 4.0;
/// The most corners of an emitter of which planes inside penumbrae are followed.
const MOST_CURVED: usize = 8;
/// Outlines that bend less than this [rad] at a vertex are round.
const BENT: f64 = 0.35;
/// Places along an edge that are looked at first.
const PROBES: [f64; 3] = [0.5, 0.12, 0.88];

/// A silhouette edge as an emitter sees it.
#[derive(Clone, Copy)]
struct Pair {
    emitter: usize,
    edge: usize,
    /// What is at stake, to sort by.
    weight: f64,
    shadow: Shadow,
}

/// What is known of a shadow.
#[derive(Clone, Copy, Default)]
struct Shadow {
    /// Illuminance where it falls [lx].
    contrast: f64,
    /// The edge's shadow [m].
    length: f64,
    /// Penumbra [m].
    width: f64,
}

impl Shadow {
    fn or(self, other: Self) -> Self {
        Self {
            contrast: self.contrast.max(other.contrast),
            length: self.length.max(other.length),
            width: self.width.max(other.width),
        }
    }
}

/// The lines of shadows that change light by `least` [lx] or more.
pub fn shadows(stage: &Stage, emitters: &[Emitter], least: f64) -> Vec<CriticalLine> {
    let mut pairs = Vec::new();
    for e in 0..emitters.len() {
        pairs.extend(candidates(stage, emitters, e, least));
    }
    keep_heaviest(&mut pairs, MOST_PAIRS);
    let probed = pairs.par_iter().filter_map(|pair| {
        let shadow = probe(stage, &emitters[pair.emitter], &stage.occluders.edges[pair.edge])?;
        let shows = shadow.contrast >= least && shadow.length >= stage.params.length;
        shows.then_some(Pair { weight: shadow.contrast * shadow.length, shadow, ..*pair })
    });
    let mut pairs: Vec<Pair> = probed.collect();
    keep_heaviest(&mut pairs, stage.params.lines);
    let of_edges = pairs.par_iter().flat_map_iter(|pair| {
        let emitter = &emitters[pair.emitter];
        edge_lines(stage, emitter, &stage.occluders.edges[pair.edge], &pair.shadow)
    });
    let mut lines: Vec<CriticalLine> = of_edges.collect();
    // Vertices of soft shadows, by emitter and place.
    let mut vertices: BTreeMap<(usize, u32), Shadow> = BTreeMap::new();
    for pair in pairs.iter().filter(|pair| pair.shadow.width >= stage.params.width) {
        for place in stage.occluders.edges[pair.edge].ends {
            let shadow = vertices.entry((pair.emitter, place)).or_default();
            *shadow = shadow.or(pair.shadow);
        }
    }
    let vertices: Vec<_> = vertices.into_iter().collect();
    lines.par_extend(
        vertices
            .par_iter()
            .flat_map_iter(|((emitter, place), shadow)| vertex_lines(stage, &emitters[*emitter], *place, shadow)),
    );
    lines
}

/// Leaves the pairs of most weight, in the order in which they were.
fn keep_heaviest(pairs: &mut Vec<Pair>, most: usize) {
    if pairs.len() > most {
        pairs.sort_by(|a, b| b.weight.total_cmp(&a.weight).then((a.emitter, a.edge).cmp(&(b.emitter, b.edge))));
        pairs.truncate(most);
        pairs.sort_by_key(|pair| (pair.emitter, pair.edge));
    }
}

/// The edges that may be silhouettes seen from an emitter, and may cast a shadow that shows.
fn candidates(stage: &Stage, emitters: &[Emitter], number: usize, least: f64) -> Vec<Pair> {
    let (occluders, emitter) = (stage.occluders, &emitters[number]);
    let points = emitter.points();
    let shortest = stage.params.length / MAGNIFICATION;
    let candidate = |(i, edge): (usize, &Edge)| {
        let [a, b] = occluders.ends(edge);
        let middle = a.midpoint(b);
        if a.distance_squared(b) < shortest * shortest || !emitter.is_blocked_by(stage, edge) {
            return None;
        }
        let length = (b - a).cross(emitter.middle.way(middle).0).length();
        if length < shortest {
            return None;
        }
        let light = emitter.illuminance(stage.scene, stage.lights, middle);
        let is_silhouette = || points.iter().any(|p| occluders.free_side(edge, p.way(middle).0).is_some());
        let is_own = || match &emitter.shape {
            Shape::Hull(hull) => hull.points.contains(&a) && hull.points.contains(&b),
            _ => false,
        };
        (light >= least && is_silhouette() && !is_own()).then(|| Pair {
            emitter: number,
            edge: i,
            weight: light * length,
            shadow: Shadow::default(),
        })
    };
    occluders.edges.par_iter().enumerate().filter_map(candidate).collect()
}

/// The rays of one apex past an edge.
fn past_edge<'a>(stage: &'a Stage, edge: &'a Edge, apex: Apex) -> Option<impl Fn(f64) -> Option<Pass> + use<'a>> {
    let [a, b] = stage.occluders.ends(edge);
    let free = stage.occluders.free_side(edge, apex.way(a.midpoint(b)).0)?;
    Some(move |s: f64| Some(Pass { apex, through: a.lerp(b, s), free }))
}

/// Looks at a few places whether an edge casts a shadow, and what it is like; `None` where none is found.
fn probe(stage: &Stage, emitter: &Emitter, edge: &Edge) -> Option<Shadow> {
    let [a, b] = stage.occluders.ends(edge);
    let points = emitter.points();
    // Of the middle, and of some points around it where that sees nothing.
    let around = points.iter().step_by(points.len().div_ceil(4)).copied();
    let mut found: Option<Shadow> = None;
    let middle = (emitter.middle, &PROBES[..]);
    for (apex, places) in [middle].into_iter().chain(around.map(|apex| (apex, &PROBES[..1]))) {
        let Some(pass) = past_edge(stage, edge, apex) else { continue };
        let wedge = Wedge { stage, emitter, pass: &pass };
        for s in places.iter().copied() {
            let Some(landing) = wedge.look(s) else { continue };
            let shadow = cast(stage, emitter, a.lerp(b, s), b - a, landing.triangle, landing.distance);
            found = Some(found.unwrap_or_default().or(shadow));
        }
        if found.is_some() {
            break;
        }
    }
    found
}

/// The shadow of a line of direction and length `along` [m] at `through`, on a triangle at a distance [m] behind it.
fn cast(stage: &Stage, emitter: &Emitter, through: DVec3, along: DVec3, triangle: u32, behind: f64) -> Shadow {
    let (way, before) = emitter.middle.way(through);
    let [p, q, r] = stage.occluders.corners[triangle as usize];
    let cos = -way.dot((q - p).cross(r - p).normalize_or_zero());
    let light = emitter.illuminance(stage.scene, stage.lights, through + way * behind);
    let width = emitter.width(through, along.normalize_or_zero());
    let (grows, width) = if before.is_finite() {
        ((before + behind) / before.max(f64::MIN_POSITIVE), width * behind / before.max(f64::MIN_POSITIVE))
    } else {
        (1.0, width * behind)
    };
    Shadow { contrast: light * cos.max(0.0), length: along.cross(way).length() * grows, width }
}

/// The lines of the wedges past an edge.
fn edge_lines(stage: &Stage, emitter: &Emitter, edge: &Edge, shadow: &Shadow) -> Vec<CriticalLine> {
    let [a, b] = stage.occluders.ends(edge);
    let along = (b - a).normalize();
    let planes: Vec<(Apex, Order)> = match &emitter.shape {
        _ if shadow.width < stage.params.width => vec![(emitter.middle, Order::Jump)],
        Shape::Point => vec![(emitter.middle, Order::Jump)],
        Shape::Ball(radius) => bends(on_ball(emitter.middle, *radius, a, along)),
        Shape::Disc(half) => bends(on_disc(emitter.middle, *half, along)),
        Shape::Hull(hull) => {
            let order = |p: &DVec3| {
                let order = if supports(hull, *p, along.cross(a - *p)) { Order::Bend } else { Order::Curve };
                (Apex::At(*p), order)
            };
            let is_followed = |(_, order): &(Apex, Order)| *order == Order::Bend || hull.follows_curves(stage);
            hull.points.iter().map(order).filter(is_followed).collect()
        }
    };
    let mut lines = Vec::new();
    for (apex, order) in planes {
        let Some(pass) = past_edge(stage, edge, apex) else { continue };
        let wedge = Wedge { stage, emitter, pass: &pass };
        for stripe in wedge.stripes(shadow.length) {
            lines.extend(line(stage, emitter, &stripe, a.lerp(b, stripe.middle), b - a, order));
        }
    }
    lines
}

/// The lines of the wedges of an emitter's edges past a vertex.
fn vertex_lines(stage: &Stage, emitter: &Emitter, place: u32, shadow: &Shadow) -> Vec<CriticalLine> {
    let Shape::Hull(hull) = &emitter.shape else { return Vec::new() };
    let occluders = stage.occluders;
    let vertex = occluders.points[place as usize];
    let mut lines = Vec::new();
    for [a, b] in hull.edges.iter().map(|edge| edge.map(|k| hull.points[k])) {
        let normal = (b - a).cross(vertex - a).normalize_or_zero();
        let length = shadow.width * a.distance(b) / (2.0 * hull.radius);
        if normal == DVec3::ZERO || length < LEAST_PIECE * stage.params.length {
            continue;
        }
        if hull.normal.is_none() && !supports(hull, a, normal) {
            continue;
        }
        let silhouettes = |way: DVec3| {
            let side = move |edge: &'_ Edge| occluders.free_side(edge, way).map(|free| (*edge, free));
            occluders.edges_at(place).filter_map(side)
        };
        let way = Apex::At(a.midpoint(b)).way(vertex).0;
        let to_end = |p: u32| (occluders.points[p as usize] - vertex).normalize_or_zero();
        let levers: Vec<DVec3> =
            silhouettes(way).map(|(e, _)| to_end(e.ends[usize::from(e.ends[0] == place)])).collect();
        let is_above = levers.iter().any(|lever| normal.dot(*lever) > 1e-6);
        let is_below = levers.iter().any(|lever| normal.dot(*lever) < -1e-6);
        let order = if is_above && is_below { Order::Curve } else { Order::Bend };
        if order == Order::Curve && !(hull.follows_curves(stage) && is_bent(&levers, way)) {
            continue;
        }
        let pass = |s: f64| {
            let apex = Apex::At(a.lerp(b, s));
            let free: DVec3 = silhouettes(apex.way(vertex).0).map(|(_, free)| free).sum();
            free.try_normalize().map(|free| Pass { apex, through: vertex, free })
        };
        let wedge = Wedge { stage, emitter, pass: &pass };
        for stripe in wedge.stripes(length) {
            lines.extend(line(stage, emitter, &stripe, vertex, b - a, order));
        }
    }
    lines
}

/// True where an outline, from a vertex to the ends of `levers` (unit) as seen along `way`, bends there by more than
/// [`BENT`]. The vertices of what is meant to be round would fill its penumbra with lines that nobody can see.
fn is_bent(levers: &[DVec3], way: DVec3) -> bool {
    let &[a, b] = levers else { return true };
    let [a, b] = [a, b].map(|lever| lever.reject_from(way).normalize_or_zero());
    a.dot(b) > -BENT.cos()
}

/// The line of a stripe, past the point `through` of an occluder; `along` lies in the plane of the wedge, across the
/// light.
fn line(
    stage: &Stage,
    emitter: &Emitter,
    stripe: &Stripe,
    through: DVec3,
    along: DVec3,
    order: Order,
) -> Option<CriticalLine> {
    let corners = stage.occluders.corners[stripe.triangle as usize];
    let longest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
    if longest < stage.params.length {
        return None;
    }
    let middle = stripe.ends[0].midpoint(stripe.ends[1]);
    let shadow = cast(stage, emitter, through, along, stripe.triangle, through.distance(middle));
    let (surface, triangle) = stage.tracer.place(stripe.triangle);
    Some(CriticalLine {
        surface: surface as u32,
        triangle: triangle as u32,
        ends: stripe.ends,
        order,
        contrast: shadow.contrast,
        width: if order == Order::Jump { 0.0 } else { shadow.width },
    })
}

impl Hull {
    /// True where planes inside penumbrae are looked for.
    fn follows_curves(&self, stage: &Stage) -> bool {
        stage.params.curves && self.normal.is_some() && self.points.len() <= MOST_CURVED
    }
}

/// True where a plane through `at`, a point of a hull, has all of the hull on one side.
fn supports(hull: &Hull, at: DVec3, normal: DVec3) -> bool {
    let normal = normal.normalize_or_zero();
    let tolerance = 1e-6 * hull.radius;
    let heights = || hull.points.iter().map(|p| normal.dot(*p - at));
    heights().all(|h| h >= -tolerance) || heights().all(|h| h <= tolerance)
}

fn bends(apexes: Option<[Apex; 2]>) -> Vec<(Apex, Order)> {
    apexes.into_iter().flatten().map(|apex| (apex, Order::Bend)).collect()
}

/// Where the two planes through a line touch a ball; `None` where the line meets it.
fn on_ball(centre: Apex, radius: f64, point: DVec3, along: DVec3) -> Option<[Apex; 2]> {
    let Apex::At(centre) = centre else { return None };
    let to_centre = (centre - point).reject_from(along);
    let distance = to_centre.length();
    if distance <= radius * (1.0 + 1e-6) {
        return None;
    }
    let foot = centre - to_centre;
    let towards = to_centre / distance;
    let across = along.cross(towards);
    let middle = foot + towards * (distance - radius * radius / distance);
    let aside = across * (radius / distance * (distance * distance - radius * radius).sqrt());
    Some([Apex::At(middle + aside), Apex::At(middle - aside)])
}

/// The directions in which the two planes along a line touch a sun's disc of half an angle [rad]; `None` where the line
/// meets it.
fn on_disc(middle: Apex, half: f64, along: DVec3) -> Option<[Apex; 2]> {
    let Apex::Towards(towards) = middle else { return None };
    let across = towards.reject_from(along);
    let length = across.length();
    let cos = half.sin() / length.max(f64::MIN_POSITIVE);
    if cos >= 1.0 - 1e-6 {
        return None;
    }
    let (across, aside) = (across / length, along.cross(across / length));
    let sin = (1.0 - cos * cos).sqrt();
    Some([cos, -cos].map(|cos| {
        let normal = across * cos + aside * sin;
        Apex::Towards(towards.reject_from(normal).normalize())
    }))
}
