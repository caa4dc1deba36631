//! Paths joined from both halves, by every strategy, and what each adds.

use super::super::world::attenuation;
use super::walk::{EyeWalk, LightWalk, Met, Node, Unused, facing};
use super::weight::{LightEnd, Place, weight};
use super::{Bidirectional, Streams};
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::scatter::Transport;
use glam::Vec3;
use std::f32::consts::PI;

/// Radiance or irradiance that a sample adds to a pixel.
pub type Added = (usize, Rgb);

/// A strategy: places drawn from the light's side, and from the eye's, a camera's own among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strategy {
    pub from_light: usize,
    pub from_eye: usize,
}

/// Both walks of a sample.
struct Pair<'w, 'a> {
    light: Option<&'w LightWalk<'a>>,
    eye: Option<&'w EyeWalk<'a>>,
    pixel: usize,
    /// What radiance or irradiance of the eye's walk counts with.
    worth: f32,
    /// The place on a camera's lens that light is seen through.
    lens: [f32; 2],
}

impl<'a> Bidirectional<'a> {
    /// One walk from `pixel`, one from a light, and all paths that join them. Means of what is added to `out` over samples whose pixels are
    /// drawn by their shares are the picture.
    pub fn sample<N: Numbers>(&self, pixel: usize, streams: &mut Streams<N>, out: &mut Vec<Added>) {
        let most = self.max_bounces.map_or(usize::MAX, |most| most as usize + 1);
        let share = self.shares.of(self.sensor, pixel);
        let start = self.sensor.start(pixel, &mut streams.eye);
        let area = self.sensor.area(pixel).max(f32::MIN_POSITIVE);
        let eye = start.map(|start| self.from_eye((pixel, start), share / area, most, &mut streams.eye));
        let light = self.from_light(most, &mut streams.light);
        let worth = 1.0 / share.max(f32::MIN_POSITIVE);
        let pair = Pair { light: light.as_ref(), eye: eye.as_ref(), pixel, worth, lens: streams.joins.pair() };
        let first = out.len();
        self.eye_alone(&pair, out);
        self.drawn_lights(&pair, &mut streams.joins, out);
        self.joined(&pair, most, out);
        self.light_alone(&pair, out);
        let sound = |added: &Added| added.1.is_finite() && added.1 != Rgb::ZERO;
        let mut kept = first;
        for k in first..out.len() {
            if sound(&out[k]) {
                out.swap(kept, k);
                kept += 1;
            }
        }
        out.truncate(kept);
    }

    /// True where `strategy` counts.
    fn counts(&self, strategy: Strategy) -> bool {
        self.only.is_none_or(|only| only == strategy)
    }

    /// The weight of a strategy, 1 where it stands alone.
    fn share_of(&self, end: &LightEnd, places: &[Place], from_light: usize) -> f32 {
        if self.only.is_some() { 1.0 } else { weight(end, places, from_light) }
    }

    /// What [`Self::light_alone`] comes to for a path to where `eye` started: nothing where none can.
    fn alone_to(&self, eye: &EyeWalk) -> f32 {
        if eye.is_seen { self.light_alone } else { 0.0 }
    }

    /// What the eye's walk met: no place from the light's side.
    fn eye_alone(&self, pair: &Pair, out: &mut Vec<Added>) {
        let Some(eye) = pair.eye else { return };
        let mut sum = Rgb::ZERO;
        let mut places = Vec::new();
        for met in &eye.met {
            if self.counts(Strategy { from_light: 0, from_eye: met.after + 1 + usize::from(eye.has_camera) }) {
                sum += met.light * self.met_weight(eye, met, &mut places);
            }
        }
        out.push((pair.pixel, sum * pair.worth));
    }

    fn met_weight(&self, eye: &EyeWalk, met: &Met, places: &mut Vec<Place>) -> f32 {
        // What a camera sees is seen by it alone.
        let Some(z) = eye.nodes[..met.after].last() else { return 1.0 };
        let densities = self.end_at(met.source, met.at, &z.vertex, met.towards);
        let density = z.density(z.vertex.back, met.towards, Transport::Radiance);
        let end = LightEnd { met: density, drawn: densities.drawn, emitted: densities.emitted };
        chain(&[], Some((eye, met.after)), places);
        places[0].from_light = densities.second;
        if met.after >= 2 {
            places[1].from_light = z.density(met.towards, z.vertex.back, Transport::Importance) * z.to_previous;
        }
        favour_eye(places, eye.has_camera, self.alone_to(eye));
        self.share_of(&end, places, 0)
    }

    /// Lights drawn for each place of the eye's walk: one place from the light's side.
    fn drawn_lights(&self, pair: &Pair, numbers: &mut impl Numbers, out: &mut Vec<Added>) {
        let Some(eye) = pair.eye else { return };
        let mut sum = Rgb::ZERO;
        let mut places = Vec::new();
        for (k, z) in eye.nodes.iter().enumerate() {
            let strategy = Strategy { from_light: 1, from_eye: k + 1 + usize::from(eye.has_camera) };
            if z.vertex.is_delta() || !self.counts(strategy) {
                continue;
            }
            self.draw(&z.vertex, numbers, |drawn| {
                if drawn.light == Rgb::ZERO {
                    return;
                }
                let densities = self.end_at(drawn.source, drawn.at, &z.vertex, drawn.towards);
                let met = z.vertex.pdf(drawn.towards, Transport::Radiance) * densities.may_meet;
                let end = LightEnd { met, drawn: densities.drawn, emitted: densities.emitted };
                chain(&[], Some((eye, k + 1)), &mut places);
                places[0].from_light = densities.second;
                places[0].joins = true;
                if k >= 1 {
                    let back = z.vertex.pdf_between(drawn.towards, z.vertex.back, Transport::Importance);
                    places[1].from_light = back * z.to_previous;
                }
                favour_eye(&mut places, eye.has_camera, self.alone_to(eye));
                let way = drawn.at.distance(z.vertex.position);
                let left = attenuation(z.absorption(self.world, drawn.towards), way);
                sum += z.carried * drawn.light * left * self.share_of(&end, &places, 1);
            });
        }
        out.push((pair.pixel, sum * pair.worth));
    }

    /// Places of both walks joined by a straight way.
    fn joined(&self, pair: &Pair, most: usize, out: &mut Vec<Added>) {
        let (Some(eye), Some(light)) = (pair.eye, pair.light) else { return };
        let Some(first) = light.nodes.first() else { return };
        let start = self.end_at(light.emitted.source, light.emitted.position, &first.vertex, -light.emitted.direction);
        let mut sum = Rgb::ZERO;
        let mut places = Vec::new();
        for (a, y) in light.nodes.iter().enumerate().filter(|(_, y)| !y.vertex.is_delta()) {
            for (b, z) in eye.nodes.iter().enumerate().filter(|(_, z)| !z.vertex.is_delta()) {
                let strategy = Strategy { from_light: a + 2, from_eye: b + 1 + usize::from(eye.has_camera) };
                if a + b + 2 > most || !self.counts(strategy) {
                    continue;
                }
                let Some((d, value)) = reached(y, z) else { continue };
                chain(&light.nodes[..=a], Some((eye, b + 1)), &mut places);
                let back = y.vertex.pdf_between(d, y.vertex.back, Transport::Radiance);
                let met = if a == 0 { back } else { light.met } * start.may_meet;
                if a > 0 {
                    places[a - 1].from_eye = back * y.to_previous;
                }
                let to_y = z.vertex.pdf(-d, Transport::Radiance);
                places[a].from_eye = to_y * facing(&y.vertex, z.vertex.position);
                let to_z = y.vertex.pdf(d, Transport::Importance);
                places[a + 1].from_light = to_z * facing(&z.vertex, y.vertex.position);
                (places[a].joins, places[a + 1].joins) = (true, true);
                if b > 0 {
                    let back = z.vertex.pdf_between(-d, z.vertex.back, Transport::Importance);
                    places[a + 2].from_light = back * z.to_previous;
                }
                favour_eye(&mut places, eye.has_camera, self.alone_to(eye));
                let end = LightEnd { met, drawn: start.drawn, emitted: start.emitted };
                let value = value * self.share_of(&end, &places, a + 2);
                if value != Rgb::ZERO {
                    sum += value * self.between(y, z, d);
                }
            }
        }
        out.push((pair.pixel, sum * pair.worth));
    }

    /// What passes from `y` along `d` to `z`.
    fn between(&self, y: &Node, z: &Node, d: Vec3) -> Rgb {
        let tracer = self.world.tracer;
        let from = y.vertex.origin(tracer, d);
        let way = z.vertex.origin(tracer, -d) - from;
        let length = way.length();
        if length <= 0.0 {
            return Rgb::ZERO;
        }
        let left = attenuation(y.absorption(self.world, d), length);
        self.world.passing(from, way / length, length, None, &mut Unused) * left
    }

    /// The light's walk as the sensor sees it: no place from the eye's side but a camera's own.
    fn light_alone(&self, pair: &Pair, out: &mut Vec<Added>) {
        let Some(light) = pair.light else { return };
        let Some(first) = light.nodes.first() else { return };
        let start = self.end_at(light.emitted.source, light.emitted.position, &first.vertex, -light.emitted.direction);
        let mut places = Vec::new();
        for (a, y) in light.nodes.iter().enumerate() {
            let counts = |from_eye| self.counts(Strategy { from_light: a + 2, from_eye });
            let end = |back: f32| {
                let met = if a == 0 { back } else { light.met } * start.may_meet;
                LightEnd { met, drawn: start.drawn, emitted: start.emitted }
            };
            if counts(1) && !y.vertex.is_delta() {
                out.extend(self.seen(&light.nodes[..=a], pair.lens, end, &mut places));
            }
            if counts(0) {
                out.extend(self.landed(&light.nodes[..=a], end, &mut places));
            }
        }
    }

    /// The last of `nodes` as a camera sees it.
    fn seen(
        &self,
        nodes: &[Node],
        lens: [f32; 2],
        end: impl Fn(f32) -> LightEnd,
        places: &mut Vec<Place>,
    ) -> Option<Added> {
        let (y, a) = (nodes.last()?, nodes.len() - 1);
        let seen = self.sensor.see(y.vertex.position, lens)?;
        let way = seen.from - y.vertex.position;
        let d = way.try_normalize()?;
        let value = y.carried * y.vertex.respond(d, Transport::Importance) * seen.weight;
        if value == Rgb::ZERO {
            return None;
        }
        chain(nodes, None, places);
        let back = y.vertex.pdf_between(d, y.vertex.back, Transport::Radiance);
        if a > 0 {
            places[a - 1].from_eye = back * y.to_previous;
        }
        places[a].from_eye = self.sensor.direction_pdf(-d) * facing(&y.vertex, seen.from);
        places[a].joins = true;
        places.push(Place { from_light: 0.0, from_eye: 1.0, joins: true });
        favour_eye(places, true, self.light_alone);
        let value = value * self.share_of(&end(back), places, a + 2);
        let from = y.vertex.origin(self.world.tracer, d);
        let way = seen.from - from;
        let length = way.length();
        let left = attenuation(y.absorption(self.world, d), length);
        let passing = self.world.passing(from, way / length, length, None, &mut Unused);
        Some((seen.pixel, value * passing * left))
    }

    /// The last of `nodes` as it lies on a texel.
    fn landed(&self, nodes: &[Node], end: impl Fn(f32) -> LightEnd, places: &mut Vec<Place>) -> Option<Added> {
        let (y, a) = (nodes.last()?, nodes.len() - 1);
        let on = y.vertex.surface()?;
        let pixel = self.sensor.under(&on.hit?).filter(|&pixel| self.sensor.catches(pixel))?;
        let area = self.sensor.area(pixel);
        if area <= 0.0 {
            return None;
        }
        let receiver = self.world.receiver(self.sensor.receives(on.point));
        let towards = y.vertex.back;
        let crosswise = on.point.normal.dot(towards);
        let value = y.carried * receiver.respond(towards, Transport::Radiance) * (PI / (crosswise * area));
        chain(nodes, None, places);
        let back = receiver.pdf(towards, Transport::Radiance);
        if a > 0 {
            places[a - 1].from_eye = back * y.to_previous;
        }
        places[a].from_eye = self.shares.of(self.sensor, pixel) / area;
        places[a].joins = true;
        favour_eye(places, false, self.light_alone);
        Some((pixel, value * self.share_of(&end(back), places, a + 2)))
    }
}

/// The direction from `y` to `z`, and what a way between them would carry.
fn reached(y: &Node, z: &Node) -> Option<(Vec3, Rgb)> {
    let way = z.vertex.position - y.vertex.position;
    let d = way.try_normalize()?;
    let leaves = y.carried * y.vertex.respond(d, Transport::Importance);
    if leaves == Rgb::ZERO {
        return None;
    }
    let value = leaves * z.carried * z.vertex.respond(-d, Transport::Radiance) / way.length_squared();
    (value != Rgb::ZERO).then_some((d, value))
}

/// The places of a path of the light's `light` and the first so many of the eye's, as their walks drew them.
fn chain(light: &[Node], eye: Option<(&EyeWalk, usize)>, places: &mut Vec<Place>) {
    places.clear();
    places.extend(light.iter().map(|y| Place { from_light: y.ahead, from_eye: y.behind, joins: !y.is_delta }));
    let Some((eye, count)) = eye else { return };
    places.extend(eye.nodes[..count].iter().rev().map(|z| Place {
        from_light: z.behind,
        from_eye: z.ahead,
        joins: !z.is_delta,
    }));
    if eye.has_camera {
        places.push(Place { from_light: 0.0, from_eye: 1.0, joins: eye.is_seen });
    }
}

/// Makes the light's walk find the sensor by itself with `share` of its density: what it finds so comes at the last place on a surface.
fn favour_eye(places: &mut [Place], has_camera: bool, share: f32) {
    let last = places.len().checked_sub(1 + usize::from(has_camera));
    if let Some(last) = last {
        places[last].from_light *= share;
    }
}
