//! Lights that are found by one direction at a time: points, spots, suns and balls.

use super::polygon::ball;
use super::receiver::Evenness;
use super::terminator::origin;
use crate::color::Rgb;
use crate::patch::SurfacePoint;
use crate::sample::warp::{cap, frame};
use crate::scene::{Light, LightShape, Linked, Picture, Scene};
use crate::trace::{Ray, Segment, Tracer};
use glam::Vec3;
use std::f32::consts::PI;

/// A point, spot, directional or ball-shaped light.
#[derive(Clone, Debug)]
pub struct DeltaLight {
    shape: LightShape,
    /// Its number among the scene's lights.
    light: usize,
    /// It shines alike in all directions, as its shape says.
    is_plain: bool,
    /// It throws a picture, so that its colour differs, too.
    pub(super) is_colorful: bool,
    /// The surfaces that it shines on.
    lit: Linked,
    /// Its number among [`super::Lights::shades`]; none where every surface blocks it.
    pub shade: Option<u16>,
}

/// Light on its way to a point.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Unit, from the point towards the light.
    pub towards: Vec3,
    /// Distance to the light [m], infinite for a sun.
    pub distance: f32,
    /// Illuminance of a plane that faces that way [lx]; of a light with a disc as if all of it lay there.
    pub illuminance: Rgb,
}

impl DeltaLight {
    /// Light number `number`; `None` for lights that are polygons.
    pub fn new(number: usize, light: &Light, shade: Option<u16>) -> Option<Self> {
        let is_ours = match &light.shape {
            LightShape::Point { .. } | LightShape::Spot { .. } | LightShape::Directional { .. } => true,
            LightShape::Sphere { world_from_unit, .. } => ball(world_from_unit).is_some(),
            LightShape::Rect { .. }
            | LightShape::Disk { .. }
            | LightShape::Cylinder { .. }
            | LightShape::Portal { .. } => false,
        };
        is_ours.then(|| Self {
            shape: light.shape.clone(),
            light: number,
            is_plain: light.is_plain(),
            is_colorful: matches!(light.picture, Some(Picture::Thrown(_))),
            lit: light.links.lit.clone(),
            shade,
        })
    }

    /// Its number among the scene's lights.
    pub fn number(&self) -> usize {
        self.light
    }

    /// Its geometry.
    pub fn shape(&self) -> &LightShape {
        &self.shape
    }

    /// How evenly it shines on a receiver of `radius` [m] around `position`.
    pub(super) fn evenness(&self, position: Vec3, radius: f32) -> Evenness {
        match self.shape {
            LightShape::Directional { angle, .. } if angle < SMALL_SUN => Evenness::From(f32::INFINITY),
            LightShape::Point { position: at, .. } if self.is_plain => Evenness::From(at.distance(position)),
            LightShape::Spot { position: at, direction, inner, outer, .. } if self.is_plain => {
                let way = position - at;
                let (angle, margin) = (way.angle_between(direction), (radius / way.length()).atan());
                let is_on_edge = angle + margin > inner && angle - margin < outer;
                if is_on_edge { Evenness::Rough } else { Evenness::From(way.length()) }
            }
            _ => Evenness::Rough,
        }
    }

    /// True where all of its light comes from one direction.
    pub fn is_point(&self) -> bool {
        match self.shape {
            LightShape::Directional { angle, .. } => angle <= 0.0,
            LightShape::Point { .. } | LightShape::Spot { .. } => true,
            _ => false,
        }
    }

    /// True where it is linked to `surface`; of what is no surface, where it is linked to all.
    pub fn shines_on(&self, surface: u32) -> bool {
        self.lit.holds(surface)
    }

    /// The factor on what it sends from `at` along the unit vector `direction`.
    fn factor(&self, scene: &Scene, at: Vec3, direction: Vec3) -> Rgb {
        if self.is_plain { Rgb::ONE } else { scene.lights[self.light].factor(scene, at, direction) }
    }

    /// Radiance of a sun's disc, or of a ball from its place `at`, along the unit vector `direction` [nit]; black of what has no
    /// disc.
    pub fn disc_radiance(&self, scene: &Scene, at: Vec3, direction: Vec3) -> Rgb {
        match &self.shape {
            LightShape::Directional { illuminance, angle, .. } if *angle > 0.0 => {
                let sin = (0.5 * angle.min(PI)).sin();
                *illuminance / (PI * sin * sin)
            }
            LightShape::Sphere { radiance, .. } => *radiance * self.factor(scene, at, direction),
            _ => Rgb::ZERO,
        }
    }

    /// What arrives at `position`; `u` in the unit square picks the place on a sun's or ball's disc. `None` where nothing can.
    pub fn arrive(&self, scene: &Scene, position: Vec3, u: [f32; 2]) -> Option<Arrival> {
        match &self.shape {
            LightShape::Directional { direction, illuminance, angle } => {
                if *angle <= 0.0 {
                    return Some(Arrival { towards: -*direction, distance: f32::INFINITY, illuminance: *illuminance });
                }
                // Directions over the disc meet a plane that faces its middle at a mean cosine of (1 + cos) / 2; of discs wider
                // than a hemisphere the part behind that plane adds nothing.
                let cos = (0.5 * angle.min(std::f32::consts::TAU)).cos();
                let whole = if cos >= 0.0 { 2.0 / (1.0 + cos) } else { 2.0 * (1.0 - cos) };
                let towards = frame(-*direction) * cap(u, cos);
                Some(Arrival { towards, distance: f32::INFINITY, illuminance: *illuminance * whole })
            }
            LightShape::Sphere { world_from_unit, radiance } => {
                let (centre, radius) = ball(world_from_unit)?;
                let way = centre - position;
                let distance = way.length();
                if distance <= radius {
                    return None;
                }
                let sin = radius / distance;
                // 1 - cos without cancellation for a small ball far away.
                let height = sin * sin / (1.0 + (1.0 - sin * sin).max(0.0).sqrt());
                let towards = frame(way / distance) * cap(u, 1.0 - height);
                let along = towards.dot(way);
                let half_chord = (radius * radius - (distance * distance - along * along)).max(0.0).sqrt();
                let factor = self.factor(scene, position + towards * (along - half_chord), -towards);
                let illuminance = *radiance * factor * (std::f32::consts::TAU * height);
                Some(Arrival { towards, distance: along - half_chord, illuminance })
            }
            LightShape::Point { position: at, intensity, range } => {
                let mut arrival = from_point(*at, *intensity, *range, position)?;
                if !self.is_plain {
                    arrival.illuminance *= self.factor(scene, *at, -arrival.towards);
                }
                (arrival.illuminance.max_element() > 0.0).then_some(arrival)
            }
            LightShape::Spot { position: at, direction, intensity, inner, outer, range } => {
                let mut arrival = from_point(*at, *intensity, *range, position)?;
                let share = spot_share(direction.dot(-arrival.towards), *inner, *outer);
                arrival.illuminance *= share;
                if !self.is_plain {
                    arrival.illuminance *= self.factor(scene, *at, -arrival.towards);
                }
                (share > 0.0).then_some(arrival)
            }
            _ => None,
        }
    }
}

/// Angular diameter of a sun [rad] whose middle stands for its disc: the mean cosine differs by 1e-4.
const SMALL_SUN: f32 = 0.04;

/// Illuminance of one delta light at one point about the geometric and the shading normal, and how it comes; `None` where the
/// point faces away from it about both, or the light is not linked to its surface.
pub fn unshadowed(scene: &Scene, light: &DeltaLight, point: &SurfacePoint, u: [f32; 2]) -> Option<([Rgb; 2], Arrival)> {
    if !light.lit.holds(point.surface) {
        return None;
    }
    let arrival = light.arrive(scene, point.position, u)?;
    let cos = point.normal.dot(arrival.towards).max(0.0);
    let shading = point.shading.dot(arrival.towards).max(0.0);
    (cos > 0.0 || shading > 0.0).then(|| ([arrival.illuminance * cos, arrival.illuminance * shading], arrival))
}

/// What gets through, by channel, past all that `blockers` knows of the light that arrives at `point`.
pub fn passing(tracer: &Tracer, blockers: Option<&Tracer>, point: &SurfacePoint, arrival: &Arrival) -> Rgb {
    let from = origin(tracer, point);
    let mut passing = [Rgb::ONE];
    let Some(tracer) = blockers else { return Rgb::ONE };
    if arrival.distance.is_finite() {
        let to = point.position + arrival.towards * arrival.distance;
        tracer.transmittance(&[Segment { from, to }], &mut passing);
    } else {
        tracer.transmittance_of_rays(&[Ray { origin: from, direction: arrival.towards }], &mut passing);
    }
    passing[0]
}

/// The share of a spot's intensity at `cos` to its axis, between the half angles [rad] (KHR_lights_punctual, "Inner and Outer Cone
/// Angles").
pub fn spot_share(cos: f32, inner: f32, outer: f32) -> f32 {
    let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
    let ramp = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-3)).clamp(0.0, 1.0);
    ramp * ramp
}

/// The share of a point's or spot's light that is left at `distance` [m] by its range (KHR_lights_punctual, "Range Property").
pub fn range_share(distance: f32, range: Option<f32>) -> f32 {
    range.filter(|r| *r > 0.0).map_or(1.0, |r| (1.0 - (distance / r).powi(4)).clamp(0.0, 1.0))
}

/// Inverse square law, with the window that KHR_lights_punctual gives for `range`.
fn from_point(at: Vec3, intensity: Rgb, range: Option<f32>, position: Vec3) -> Option<Arrival> {
    let way = at - position;
    let distance = way.length();
    if distance <= 0.0 {
        return None;
    }
    let window = range_share(distance, range);
    let illuminance = intensity * (window / (distance * distance));
    (window > 0.0).then_some(Arrival { towards: way / distance, distance, illuminance })
}
