//! Walks from lights and from sensors: the two halves that paths are joined from.

use super::super::emit::{Emitted, Source, Sources};
use super::super::lamps::Lamp;
use super::super::vertex::Vertex;
use super::super::world::{Travelled, World, attenuation};
use super::Bidirectional;
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::scatter::Transport;
use crate::sensor::Start;
use crate::trace::Ray;
use glam::Vec3;
use std::f32::consts::PI;

/// Places after which Russian roulette may end a walk.
const ROULETTE_START: usize = 4;

/// Places that most walks have room for: they are large, and costly to move.
const PLACES: usize = 12;

/// The least probability of ending a walk that roulette decides on.
const LEAST_END: f32 = 0.02;

/// A place that a walk came to.
#[derive(Clone, Debug)]
pub struct Node<'a> {
    pub vertex: Vertex<'a>,
    /// The weight with which the walk came here: flux [lm] of light; of the eye's, what radiance counts with.
    pub carried: Rgb,
    /// Density with which its own walk drew it [1/m^2].
    pub ahead: f32,
    /// Density with which a walk that comes back the same way draws it [1/m^2]: known once two more places are.
    pub behind: f32,
    /// Makes a density of directions that lead to the place before one by area there [sr/m^2]; 1 where that is a light.
    pub to_previous: f32,
    /// A mirror or clear glass sent the walk on.
    pub is_delta: bool,
    /// What absorbs light on the way that led here [1/m].
    pub absorption: Rgb,
}

/// A walk from a light.
pub struct LightWalk<'a> {
    pub emitted: Emitted,
    pub nodes: Vec<Node<'a>>,
    /// Density [1/sr] with which a walk that comes back the same way finds the light from the first place.
    pub met: f32,
}

/// A walk from a sensor.
pub struct EyeWalk<'a> {
    /// Places on surfaces; the first is the sensor's own where it lies on one.
    pub nodes: Vec<Node<'a>>,
    pub met: Vec<Met>,
    /// It came from a camera, which is a place of its own before them.
    pub has_camera: bool,
    /// Light's walks may find where it started.
    pub is_seen: bool,
}

/// Something that shines and that the eye's walk met.
#[derive(Clone, Copy, Debug)]
pub struct Met {
    /// Places before it.
    pub after: usize,
    pub source: Source,
    /// Where on it.
    pub at: Vec3,
    /// Unit, the way of the walk.
    pub towards: Vec3,
    /// Radiance by what the walk carries.
    pub light: Rgb,
}

/// A walk under way.
struct Going {
    ray: Ray,
    carried: Rgb,
    /// Density of the direction [1/sr].
    pdf: f32,
    absorption: Rgb,
    spread: f32,
    /// What was carried at first: roulette is about what is left of it.
    first: f32,
}

impl Node<'_> {
    /// Makes a density of directions that lead here from `from` one by area here [sr/m^2].
    pub fn facing(&self, from: Vec3) -> f32 {
        facing(&self.vertex, from)
    }

    /// What a walk that leaves the way it came, or `towards` the other side, has around it [1/m].
    pub fn absorption(&self, world: &World, towards: Vec3) -> Rgb {
        let Some(on) = self.vertex.surface() else { return Rgb::ZERO };
        let stays = on.point.normal.dot(self.vertex.back) * on.point.normal.dot(towards) > 0.0;
        if stays { self.absorption } else { world.absorption(&self.vertex, towards) }
    }

    /// Density [1/sr] of leaving along `to` having come from `from`, both unit and away from here; by deltas the cosine, which makes
    /// them the same from both ends.
    pub fn density(&self, from: Vec3, to: Vec3, mode: Transport) -> f32 {
        if !self.is_delta {
            return self.vertex.pdf_between(from, to, mode);
        }
        self.vertex.surface().map_or(1.0, |on| on.point.normal.dot(to).abs())
    }
}

/// The cosine at `vertex` towards `from` over the square of the distance.
pub fn facing(vertex: &Vertex, from: Vec3) -> f32 {
    let way = from - vertex.position;
    let square = way.length_squared();
    let cos = vertex.surface().map_or(1.0, |on| on.point.normal.dot(way).abs() / square.sqrt());
    cos / square.max(f32::MIN_POSITIVE)
}

impl<'a> Bidirectional<'a> {
    /// Sets out from a light; `most` bounds the places beyond it.
    pub fn from_light(&self, most: usize, numbers: &mut impl Numbers) -> Option<LightWalk<'a>> {
        let emitted = self.sources.emit(self.world, numbers)?;
        let mut walk = LightWalk { emitted, nodes: Vec::new(), met: 0.0 };
        if most == 0 {
            return Some(walk);
        }
        let tracer = self.world.tracer;
        let leaves = !emitted.is_beyond && !emitted.is_point;
        let origin = if leaves { tracer.off_surface(emitted.position, emitted.normal) } else { emitted.position };
        let ray = Ray { origin, direction: emitted.direction };
        let going = Going {
            ray,
            carried: emitted.flux,
            pdf: emitted.direction_pdf,
            absorption: Rgb::ZERO,
            spread: 1.0,
            first: emitted.flux.max_element(),
        };
        let mut nodes = Vec::with_capacity(PLACES);
        let met = self.walk(&mut nodes, going, Transport::Importance, most, numbers, |_, _, _| {});
        if let Some(first) = nodes.first() {
            let distance = emitted.position.distance(first.vertex.position);
            let within = Sources::window(self.world, emitted.source, distance);
            let ahead = self.end_at(emitted.source, emitted.position, &first.vertex, -emitted.direction).second;
            nodes[0].ahead = ahead;
            if within < 1.0 {
                nodes.iter_mut().for_each(|node| node.carried *= within);
            }
        }
        (walk.nodes, walk.met) = (nodes, met);
        Some(walk)
    }

    /// Sets out from `pixel`, whose own place has the density `start_pdf` [1/m^2] where it lies on a surface. `most` bounds the
    /// places, without a camera's.
    pub fn from_eye(
        &self,
        (pixel, start): (usize, Start),
        start_pdf: f32,
        most: usize,
        numbers: &mut impl Numbers,
    ) -> EyeWalk<'a> {
        let world = self.world;
        let mut eye = EyeWalk { nodes: Vec::with_capacity(PLACES), met: Vec::new(), has_camera: false, is_seen: false };
        let EyeWalk { nodes, met, .. } = &mut eye;
        let has_camera = matches!(start, Start::Ray(_));
        let is_seen;
        let going = match start {
            Start::Ray(ray) => {
                let pdf = self.sensor.direction_pdf(ray.direction);
                is_seen = pdf > 0.0;
                // Of parallel rays nothing but themselves tells the density.
                let pdf = if is_seen { pdf } else { 1.0 };
                Some(Going { ray, carried: Rgb::ONE, pdf, absorption: Rgb::ZERO, spread: 1.0, first: 1.0 })
            }
            Start::Point(point) => {
                is_seen = self.sensor.catches(pixel);
                let vertex = world.receiver(point);
                nodes.push(Node {
                    vertex,
                    carried: Rgb::splat(PI),
                    ahead: start_pdf,
                    behind: 0.0,
                    to_previous: 0.0,
                    is_delta: false,
                    absorption: Rgb::ZERO,
                });
                let fresh = Going {
                    ray: Ray { origin: Vec3::ZERO, direction: Vec3::Z },
                    carried: Rgb::splat(PI),
                    pdf: 1.0,
                    absorption: Rgb::ZERO,
                    spread: 1.0,
                    first: PI,
                };
                self.leave(nodes, fresh, Transport::Radiance, &mut 0.0, numbers)
            }
        };
        if let Some(going) = going {
            let see = |after, going: &Going, travelled: &Travelled| self.meet(after, going, travelled, met);
            self.walk(nodes, going, Transport::Radiance, most, numbers, see);
        }
        (eye.has_camera, eye.is_seen) = (has_camera, is_seen);
        eye
    }

    /// Follows a walk until it ends, `visit` seeing each way and how many places are before it. Returns the density with which one coming back leaves the first place for where it set out.
    fn walk(
        &self,
        nodes: &mut Vec<Node<'a>>,
        mut going: Going,
        mode: Transport,
        most: usize,
        numbers: &mut impl Numbers,
        mut visit: impl FnMut(usize, &Going, &Travelled<'a>),
    ) -> f32 {
        let mut back_to_start = 0.0;
        loop {
            let travelled = self.world.travel(&going.ray, going.carried, going.absorption, numbers);
            visit(nodes.len(), &going, &travelled);
            let share = travelled.weight;
            let Some(vertex) = travelled.vertex else { return back_to_start };
            if nodes.len() >= most {
                return back_to_start;
            }
            let from = nodes.last().map_or(going.ray.origin, |node| node.vertex.position);
            nodes.push(Node {
                carried: going.carried * share,
                ahead: going.pdf * facing(&vertex, from),
                behind: 0.0,
                to_previous: nodes.last().map_or(1.0, |node| facing(&node.vertex, vertex.position)),
                is_delta: false,
                absorption: going.absorption,
                vertex,
            });
            going.carried *= share;
            let Some(next) = self.leave(nodes, going, mode, &mut back_to_start, numbers) else { return back_to_start };
            going = next;
        }
    }

    /// The walk on its way from the last of its places, whose predecessor learns how likely the way back is.
    fn leave(
        &self,
        nodes: &mut [Node<'a>],
        going: Going,
        mode: Transport,
        back_to_start: &mut f32,
        numbers: &mut impl Numbers,
    ) -> Option<Going> {
        let count = nodes.len();
        let (before, node) = nodes.split_at_mut(count.checked_sub(1)?);
        let node = &mut node[0];
        let (onward, chance) = (node.vertex.go_on(mode, numbers), numbers.next());
        let onward = onward?;
        node.is_delta = onward.pdf <= 0.0;
        let other = match mode {
            Transport::Radiance => Transport::Importance,
            Transport::Importance => Transport::Radiance,
        };
        let vertex = &node.vertex;
        let behind = node.density(onward.direction, vertex.back, other) * node.to_previous;
        let pdf = node.density(vertex.back, onward.direction, mode);
        let mut next = Going {
            ray: Ray { origin: vertex.origin(self.world.tracer, onward.direction), direction: onward.direction },
            carried: going.carried * onward.weight,
            pdf,
            ..going
        };
        if onward.transmitted
            && let Some(on) = vertex.surface()
        {
            let eta = on.bsdf.eta();
            let into = on.point.normal.dot(onward.direction) < 0.0;
            if mode == Transport::Radiance {
                next.spread *= if into { 1.0 / (eta * eta) } else { eta * eta };
            }
            next.absorption = self.world.absorption(vertex, onward.direction);
        }
        match before.last_mut() {
            None => *back_to_start = behind,
            Some(node) => node.behind = behind,
        }
        if next.carried == Rgb::ZERO || !next.carried.is_finite() {
            return None;
        }
        if count >= ROULETTE_START {
            let left = (next.carried / (next.spread * next.first)).max_element();
            let survival = left.min(1.0 - LEAST_END);
            if chance >= survival {
                return None;
            }
            next.carried /= survival;
        }
        Some(next)
    }

    /// Notes what shines along a way.
    fn meet(&self, after: usize, going: &Going, travelled: &Travelled, met: &mut Vec<Met>) {
        let world = self.world;
        let towards = going.ray.direction;
        world.lamps(&going.ray, travelled.t, &mut Unused, |lamp, distance, radiance| {
            let source = match lamp {
                Lamp::Polygon(number) => Source::Polygon(number),
                Lamp::Ball(number) => Source::Delta(number),
            };
            let light = radiance * attenuation(going.absorption, distance) * going.carried;
            met.push(Met { after, source, at: going.ray.origin + towards * distance, towards, light });
        });
        match &travelled.vertex {
            Some(vertex) => {
                let hit = vertex.surface().and_then(|on| on.hit);
                let Some((hit, number)) = hit.and_then(|hit| Some((hit, world.polygon_at(&hit)?))) else { return };
                let polygon = &world.lights.polygons.polygons[number];
                let light =
                    world.radiance_at(polygon, vertex.position, vertex.back, &hit) * travelled.weight * going.carried;
                met.push(Met { after, source: Source::Polygon(number), at: vertex.position, towards, light });
            }
            None => {
                let (sky, suns) = world.beyond(towards);
                let mut push = |source, radiance| {
                    met.push(Met { after, source, at: going.ray.origin, towards, light: radiance * going.carried });
                };
                if world.lights.sky.is_some() {
                    push(Source::Sky, sky);
                }
                suns.for_each(|(number, radiance)| push(Source::Delta(number), radiance));
            }
        }
    }
}

/// For what draws only where there are media.
pub struct Unused;

impl Numbers for Unused {
    fn next(&mut self) -> f32 {
        0.5
    }
}
