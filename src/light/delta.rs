//! Lights without an area: points, spots and suns.

use crate::color::Rgb;
use crate::sample::warp::{cap, frame};
use crate::scene::{Light, LightShape, Shaping};
use glam::Vec3;

/// A point, spot or directional light.
#[derive(Clone, Debug)]
pub struct DeltaLight {
    shape: LightShape,
    shaping: Option<Shaping>,
}

/// Light on its way to a point.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Unit, from the point towards the light.
    pub towards: Vec3,
    /// Distance to the light [m], infinite for a sun.
    pub distance: f32,
    /// Illuminance of a plane that faces the light [lx].
    pub illuminance: Rgb,
}

impl DeltaLight {
    /// `None` for lights with an area.
    pub fn new(light: &Light) -> Option<Self> {
        use LightShape::{Directional, Point, Spot};
        matches!(light.shape, Point { .. } | Spot { .. } | Directional { .. })
            .then(|| Self { shape: light.shape.clone(), shaping: light.shaping })
    }

    /// True where the light has a disc, so that several directions must be tried.
    pub fn is_soft(&self) -> bool {
        matches!(self.shape, LightShape::Directional { angle, .. } if angle > 0.0)
    }

    /// What arrives at `position`; `u` in the unit square picks the place on a sun's disc. `None` where nothing can.
    pub fn arrive(&self, position: Vec3, u: [f32; 2]) -> Option<Arrival> {
        match &self.shape {
            LightShape::Directional { direction, illuminance, angle } => {
                let mut towards = -*direction;
                if *angle > 0.0 {
                    // The disc has one radiance, so the illuminance is that of the direction at its middle for each of them.
                    towards = frame(towards) * cap(u, (0.5 * angle).cos());
                }
                Some(Arrival { towards, distance: f32::INFINITY, illuminance: *illuminance })
            }
            LightShape::Point { position: at, intensity, range } => {
                let mut arrival = from_point(*at, *intensity, *range, position)?;
                if let Some(shaping) = &self.shaping {
                    arrival.illuminance *= shaping.factor(-arrival.towards);
                }
                (arrival.illuminance.max_element() > 0.0).then_some(arrival)
            }
            LightShape::Spot { position: at, direction, intensity, inner, outer, range } => {
                let mut arrival = from_point(*at, *intensity, *range, position)?;
                let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
                let cos = direction.dot(-arrival.towards);
                // KHR_lights_punctual, "Inner and Outer Cone Angles".
                let ramp = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-3)).clamp(0.0, 1.0);
                arrival.illuminance *= ramp * ramp;
                (ramp > 0.0).then_some(arrival)
            }
            _ => None,
        }
    }
}

/// Inverse square law, with the window that KHR_lights_punctual gives for `range`.
fn from_point(at: Vec3, intensity: Rgb, range: Option<f32>, position: Vec3) -> Option<Arrival> {
    let way = at - position;
    let distance = way.length();
    if distance <= 0.0 {
        return None;
    }
    let window = range.filter(|r| *r > 0.0).map_or(1.0, |r| (1.0 - (distance / r).powi(4)).clamp(0.0, 1.0));
    let illuminance = intensity * (window / (distance * distance));
    (window > 0.0).then_some(Arrival { towards: way / distance, distance, illuminance })
}
