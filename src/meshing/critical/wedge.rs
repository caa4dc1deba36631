//! A wedge of light past an occluder, and where it lands.

use super::Stage;
use super::emitter::{Apex, Emitter, Shape};
use crate::trace::Ray;
use glam::{DVec3, Vec3};

/// Rays keep off what they pass by as many times the tracer's own distance from surfaces.
const KEEP_OFF: f64 = 4.0;
/// The most places of a wedge that are looked at.
const MOST_LOOKS: usize = 192;
/// How near the ends of a wedge the outermost looks are, of its width.
const END: f64 = 1e-3;

/// A ray of a wedge.
pub struct Pass {
    /// Where its light comes from.
    pub apex: Apex,
    /// The point of the occluder that it passes [m].
    pub through: DVec3,
    /// The unit vector away from the occluder there.
    pub free: DVec3,
}

/// Where a ray of a wedge lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// The tracer's number of the triangle.
    pub triangle: u32,
    /// Distance from the occluder [m].
    pub distance: f64,
}

/// A wedge: rays in one plane, by a number in 0..=1.
pub struct Wedge<'a> {
    pub stage: &'a Stage<'a>,
    pub emitter: &'a Emitter,
    pub pass: &'a (dyn Fn(f64) -> Option<Pass> + 'a),
}

/// A piece of the wedge's plane on a triangle.
pub struct Stripe {
    pub triangle: u32,
    pub ends: [DVec3; 2],
    /// The place of the wedge in the middle of it.
    pub middle: f64,
}

/// A place of the wedge, and the triangle that it lands on.
type Look = (f64, Option<u32>);

impl Wedge<'_> {
    /// What the ray at `s` lands on, past its occluder: the front of what the light shines on; `None` where it gets not
    /// so far.
    pub fn look(&self, s: f64) -> Option<Landing> {
        let pass = (self.pass)(s)?;
        let (way, distance) = pass.apex.way(pass.through);
        let Stage { scene, tracer, lights, .. } = *self.stage;
        let off = KEEP_OFF * f64::from(tracer.offset());
        if distance <= 2.0 * off || !self.emitter.sends(way) {
            return None;
        }
        let origin = (pass.through + pass.free * off).as_vec3();
        if let Some(tracer) = lights.tracer(tracer, self.emitter.shade) {
            let (back, reach) = self.emitter.inside(pass.apex, way, off).way(origin.as_dvec3());
            let blocked = nearest(tracer, origin, -back);
            if blocked.is_some_and(|h| f64::from(h.t) < (reach - self.emitter.margin()) * (1.0 - 1e-5)) {
                return None;
            }
        }
        let hit = nearest(tracer, origin, way)?;
        let (surface, _) = tracer.place(hit.triangle);
        let lands = !hit.back
            && f64::from(hit.t) > 4.0 * off
            && scene.surfaces[surface].role.receives
            && self.emitter.shines_on(lights, surface as u32);
        lands.then_some(Landing { triangle: hit.triangle, distance: hit.t.into() })
    }

    /// Where the wedge lands, as pieces of lines; its shadow is about `length` [m] long.
    pub fn stripes(&self, length: f64) -> Vec<Stripe> {
        let shortest = self.stage.params.length;
        let count = (length / (5.0 * shortest)).ceil().clamp(2.0, 24.0) as usize;
        let step = (0.5 * shortest / length).clamp(1e-3, 0.1);
        let inner = (0..count).map(|i| (i as f64 + 0.5) / count as f64);
        let places = [END].into_iter().chain(inner).chain([1.0 - END]);
        let at = |s: f64| (s, self.look(s).map(|l| l.triangle));
        let mut looks: Vec<Look> = Vec::new();
        for s in places {
            let next = at(s);
            if let Some(last) = looks.last().copied() {
                self.split(last, next, step, &mut looks);
            }
            looks.push(next);
        }
        let mut stripes = Vec::new();
        let mut first = 0;
        for run in looks.chunk_by(|a, b| a.1 == b.1) {
            let end = first + run.len();
            if let Some(triangle) = run[0].1 {
                let before = first.checked_sub(1).map_or(0.0, |k| looks[k].0);
                let after = looks.get(end).map_or(1.0, |l| l.0);
                stripes.extend(self.stripe(triangle, [before, run[0].0, run[run.len() - 1].0, after]));
            }
            first = end;
        }
        stripes
    }

    /// Looks between two places until neighbours are nearer than `step` or land on one triangle.
    fn split(&self, low: Look, high: Look, step: f64, looks: &mut Vec<Look>) {
        if low.1 == high.1 || high.0 - low.0 < step || looks.len() >= MOST_LOOKS {
            return;
        }
        let s = 0.5 * (low.0 + high.0);
        let middle = (s, self.look(s).map(|l| l.triangle));
        self.split(low, middle, step, looks);
        looks.push(middle);
        self.split(middle, high, step, looks);
    }

    /// The part of a triangle that the wedge lands on: surely between the inner two of `places`, not beyond the outer
    /// ones.
    fn stripe(&self, triangle: u32, places: [f64; 4]) -> Option<Stripe> {
        let corners = self.stage.occluders.corners[triangle as usize];
        let [before, first, last, after] = places;
        let start = self.place(before, &corners).or_else(|| self.place(first, &corners))?;
        let end = self.place(after, &corners).or_else(|| self.place(last, &corners))?;
        let way = end - start;
        let square = way.length_squared();
        if square.is_nan() || square <= 0.0 {
            return None;
        }
        let chord = chord(&corners, start, way)?;
        let along = |s: f64| self.place(s, &corners).map(|p| (p - start).dot(way) / square);
        let (from, to) = (along(first)?, along(last)?);
        // The triangle ends first, or light does.
        let low = match chord[0] {
            c if c >= 0.0 => c,
            c if before == 0.0 => c.max(0.0),
            c => along(self.border(triangle, first, before)).unwrap_or(from).max(c),
        };
        let high = match chord[1] {
            c if c <= 1.0 => c,
            c if after == 1.0 => c.min(1.0),
            c => along(self.border(triangle, last, after)).unwrap_or(to).min(c),
        };
        let ends = [start + way * low, start + way * high];
        (low < high).then_some(Stripe { triangle, ends, middle: 0.5 * (first + last) })
    }

    /// The last place, from `inside` to `outside`, that lands on a triangle.
    fn border(&self, triangle: u32, mut inside: f64, mut outside: f64) -> f64 {
        for _ in 0..7 {
            let s = 0.5 * (inside + outside);
            if self.look(s).is_some_and(|l| l.triangle == triangle) {
                inside = s;
            } else {
                outside = s;
            }
        }
        0.5 * (inside + outside)
    }

    /// Where the ray at `s` meets the plane of a triangle, beyond the occluder.
    fn place(&self, s: f64, corners: &[DVec3; 3]) -> Option<DVec3> {
        let pass = (self.pass)(s)?;
        let way = pass.apex.way(pass.through).0;
        let [a, b, c] = *corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let cos = way.dot(normal);
        let t = (a - pass.through).dot(normal) / cos;
        (cos.abs() > 1e-6 && t >= 0.0 && t.is_finite()).then(|| pass.through + way * t)
    }
}

impl Emitter {
    /// True where it sends light along `way` (unit).
    fn sends(&self, way: DVec3) -> bool {
        let Shape::Hull(hull) = &self.shape else { return true };
        hull.normal.is_none_or(|n| n.dot(way) > 1e-3 || (hull.two_sided && n.dot(way) < -1e-3))
    }

    /// A point of it a little inwards from `apex`, and `off` [m] from its plane on the side to which light travels along
    /// `way`, so that rays to it graze neither the emitter nor what frames it.
    fn inside(&self, apex: Apex, way: DVec3, off: f64) -> Apex {
        match (&self.shape, apex, self.middle) {
            (Shape::Hull(hull), Apex::At(at), Apex::At(middle)) => {
                let lift = hull.normal.map_or(DVec3::ZERO, |n| n * (n.dot(way).signum() * off));
                Apex::At(at.lerp(middle, 0.01) + lift)
            }
            _ => apex,
        }
    }
}

fn nearest(tracer: &crate::trace::Tracer, origin: Vec3, direction: DVec3) -> Option<crate::trace::Hit> {
    let mut hit = [None];
    tracer.closest_solid(&[Ray { origin, direction: direction.as_vec3().normalize_or_zero() }], &mut hit);
    hit[0]
}

/// The part of the line `start + u way` that lies in a triangle, as an interval of `u`; the line lies in its plane.
pub fn chord(corners: &[DVec3; 3], start: DVec3, way: DVec3) -> Option<[f64; 2]> {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let inward = normal.cross(b - a).normalize_or_zero();
        let (height, slope) = (inward.dot(start - a), inward.dot(way));
        // Along the side: in or out as a whole.
        if slope.abs() <= 1e-9 * way.length() {
            if height < -1e-9 * (b - a).length() {
                return None;
            }
            continue;
        }
        let u = -height / slope;
        if slope > 0.0 { low = low.max(u) } else { high = high.min(u) }
    }
    (low < high && low.is_finite() && high.is_finite()).then_some([low, high])
}
