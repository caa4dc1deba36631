//! Whose direct light a change can touch: texels from which some lamp is, or was, behind the boxes of what changed.

use super::direct::{Arriving, Direct};
use super::{Lights, Lit};
use crate::color::Rgb;
use crate::scene::LightShape;
use crate::work::Change;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Polygons that are looked at one by one; of more, all that they reach is taken together.
const MOST_POLYGONS: usize = 64;

/// Shares that are as good as none and all.
const CLEAR: f64 = 0.01;

/// Where light comes from.
#[derive(Clone, Copy)]
enum Lamp {
    /// A ball [m].
    Near { centre: Vec3, radius: f32 },
    /// A direction towards it (unit), and the tangent of the half angle under which it is seen.
    Far { towards: Vec3, spread: f32 },
}

/// Direct light that was found before a change, and where it is to be found anew.
pub(super) struct Kept<'a> {
    old: &'a Direct,
    /// All of it is from lights that are no surface.
    is_other: bool,
    change: &'a Change,
    lamps: Vec<Lamp>,
}

impl<'a> Kept<'a> {
    /// Of `old`, which the lights of `lit` sent; `None` where the change may touch all of it.
    pub fn new(lit: &Lit, old: &'a Direct, change: &'a Change) -> Option<Self> {
        let lamps = lamps(lit.lights)?;
        let area = |i: usize| if lit.ground.casts(i) { lit.exposure.taking_area(i) } else { DVec3::ZERO };
        let all: DVec3 = old.transport.iter().enumerate().map(|(i, e): (usize, &Rgb)| e.as_dvec3() * area(i)).sum();
        let share = old.inflow.element_sum() / all.element_sum().max(f64::MIN_POSITIVE);
        let is_clear = !(CLEAR..=1.0 - CLEAR).contains(&share);
        is_clear.then_some(Self { old, is_other: share > 0.5, change, lamps })
    }

    /// What arrived at patch `i`.
    pub fn arriving(&self, i: usize) -> Arriving {
        let transport = self.old.transport[i];
        let other = if self.is_other { transport } else { Rgb::ZERO };
        Arriving { transport, shown: self.old.shown[i], other, rays: 0 }
    }

    /// The blocks among `blocks` of patches whose light the change can touch.
    pub fn touched(&self, lit: &Lit, blocks: &[Range<usize>]) -> Vec<bool> {
        let patches = lit.ground.patches;
        let is_touched = |block: &Range<usize>| {
            if block.clone().any(|i| self.change.surfaces[patches.surface(i) as usize]) {
                return true;
            }
            let positions = &patches.position[block.clone()];
            let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
            let reach = |i: usize| patches.position[i].distance(centre) + (2.0 * patches.area[i]).sqrt();
            let radius = block.clone().map(reach).fold(0.0, f32::max);
            self.lamps.iter().any(|lamp| self.change.boxes.iter().any(|bounds| lamp.is_behind(bounds, centre, radius)))
        };
        blocks.par_iter().map(is_touched).collect()
    }
}

impl Lamp {
    /// True where the box lies between it and somewhere in the ball around `centre`.
    fn is_behind(&self, bounds: &[Vec3; 2], centre: Vec3, radius: f32) -> bool {
        let (way, end, reach) = match *self {
            Self::Near { centre: lamp, radius: own } => (lamp - centre, 1.0, radius.max(own)),
            Self::Far { towards, spread } => {
                let middle = 0.5 * (bounds[0] + bounds[1]);
                let far = middle.distance(centre) + 0.5 * bounds[0].distance(bounds[1]);
                (towards, f32::INFINITY, radius + spread * far)
            }
        };
        let inverse = way.recip();
        let (a, b) = ((bounds[0] - reach - centre) * inverse, (bounds[1] + reach - centre) * inverse);
        let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
        near <= far && far >= 0.0 && near <= end
    }
}

/// Where `lights` are; `None` where they are all around.
fn lamps(lights: &Lights) -> Option<Vec<Lamp>> {
    if lights.has_sharp_sky() {
        return None;
    }
    let mut lamps: Vec<Lamp> = lights.delta.iter().map(|light| lamp(light.shape())).collect::<Option<_>>()?;
    let polygons = &lights.polygons.polygons;
    if polygons.len() <= MOST_POLYGONS {
        lamps.extend(polygons.iter().map(|p| Lamp::Near { centre: p.centre, radius: p.radius }));
    } else {
        let centre = polygons.iter().map(|p| p.centre).sum::<Vec3>() / polygons.len() as f32;
        let radius = polygons.iter().map(|p| p.centre.distance(centre) + p.radius).fold(0.0, f32::max);
        lamps.push(Lamp::Near { centre, radius });
    }
    Some(lamps)
}

fn lamp(shape: &LightShape) -> Option<Lamp> {
    match *shape {
        LightShape::Point { position, .. } | LightShape::Spot { position, .. } => {
            Some(Lamp::Near { centre: position, radius: 0.0 })
        }
        LightShape::Directional { direction, angle, .. } => {
            Some(Lamp::Far { towards: -direction, spread: (0.5 * angle).min(1.5).tan() })
        }
        LightShape::Sphere { world_from_unit, .. } => {
            let axes = world_from_unit.matrix3;
            let radius = axes.x_axis.length().max(axes.y_axis.length()).max(axes.z_axis.length());
            Some(Lamp::Near { centre: world_from_unit.translation.into(), radius })
        }
        LightShape::Rect { .. } | LightShape::Disk { .. } | LightShape::Cylinder { .. } | LightShape::Portal { .. } => {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_between_or_not() {
        let bounds = [Vec3::new(-1.0, 2.0, -1.0), Vec3::new(1.0, 3.0, 1.0)];
        let above = Lamp::Near { centre: Vec3::Y * 5.0, radius: 0.1 };
        assert!(above.is_behind(&bounds, Vec3::ZERO, 0.1));
        assert!(!above.is_behind(&bounds, Vec3::X * 4.0, 0.1), "the way passes by");
        assert!(!Lamp::Near { centre: Vec3::Y, radius: 0.1 }.is_behind(&bounds, Vec3::ZERO, 0.1), "it ends before");
        let sun = Lamp::Far { towards: Vec3::Y, spread: 0.0 };
        assert!(sun.is_behind(&bounds, Vec3::ZERO, 0.1) && !sun.is_behind(&bounds, Vec3::Y * 4.0, 0.1));
        assert!(!sun.is_behind(&bounds, Vec3::X * 1.2, 0.1));
        assert!(Lamp::Far { towards: Vec3::Y, spread: 0.2 }.is_behind(&bounds, Vec3::X * 1.2, 0.1), "its edge is");
    }
}
