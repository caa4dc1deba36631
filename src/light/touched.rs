//! Whose direct light a change can touch: texels from which some lamp is, or was, behind the boxes of what changed.

use super::direct::{Arriving, Direct};
use super::{Lights, Lit, Shining};
use crate::color::Rgb;
use crate::scene::{LightShape, Scene};
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
    /// Within a box [m].
    Near([Vec3; 2]),
    /// A direction towards it (unit), and the tangent of the half angle under which it is seen.
    Far { towards: Vec3, spread: f32 },
}

/// True where what `shining` shines on, and is blocked by, is the same after `change` but for what that names: links are told by numbers
/// of surfaces.
pub fn keeps_links(scene: &Scene, shining: &[Shining], change: &Change) -> bool {
    !change.renumbers || !shining.iter().any(|one| one.is_linked(scene))
}

/// The ways between lamps and what has changed, or did before.
pub struct Shafts {
    lamps: Vec<Lamp>,
    boxes: Vec<[Vec3; 2]>,
    surfaces: Vec<bool>,
}

impl Shafts {
    /// Between `lights` and what `change` says; `None` where they go everywhere.
    pub fn new(lights: &Lights, change: &Change) -> Option<Self> {
        let lamps = lamps(lights)?;
        Some(Self { lamps, boxes: change.boxes.clone(), surfaces: change.surfaces.clone() })
    }

    /// True where they meet a box `around` a part of surface number `surface`, or that has changed itself.
    pub fn meet(&self, surface: u32, around: &[Vec3; 2]) -> bool {
        self.surfaces.get(surface as usize).is_none_or(|changed| *changed)
            || self.lamps.iter().any(|lamp| self.boxes.iter().any(|bounds| lamp.is_behind(bounds, around)))
    }
}

/// Whether a change can touch the light of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Touch {
    None,
    /// No, but that of a patch beside it.
    Beside,
    Whole,
}

/// What of the direct light of some lamps a change can touch.
pub(super) struct Extent {
    /// All of it is from lights that are no surface.
    is_other: bool,
    touched: Vec<Touch>,
}

impl Extent {
    /// Of the light `old`, which the lights of `lit` sent to `blocks` of patches before `change`; `None` where that may touch all of it.
    pub fn new(lit: &Lit, old: &Direct, change: &Change, blocks: &[Range<usize>]) -> Option<Self> {
        let lamps = lamps(lit.lights)?;
        let area = |i: usize| if lit.ground.casts(i) { lit.exposure.taking_area(i) } else { DVec3::ZERO };
        let all: DVec3 = old.transport.iter().enumerate().map(|(i, e): (usize, &Rgb)| e.as_dvec3() * area(i)).sum();
        let share = old.inflow.element_sum() / all.element_sum().max(f64::MIN_POSITIVE);
        let is_clear = !(CLEAR..=1.0 - CLEAR).contains(&share);
        let touched = || with_those_beside(lit, touched(lit, &lamps, change, blocks));
        is_clear.then(|| Self { is_other: share > 0.5, touched: touched() })
    }
}

/// Direct light that was found before a change, and where it is to be found anew.
pub(super) struct Kept<'a> {
    pub old: &'a Direct,
    /// The mean over each block of what arrived at a first look [lx].
    pub means: &'a [Rgb],
    pub extent: &'a Extent,
}

impl Kept<'_> {
    /// What arrived at patch `i`.
    pub fn arriving(&self, i: usize) -> Arriving {
        let transport = self.old.transport[i];
        let other = if self.extent.is_other { transport } else { Rgb::ZERO };
        Arriving { transport, shown: self.old.shown[i], other, ..Arriving::default() }
    }

    /// The same, but for patches whose light the change can touch: nothing.
    pub fn outside(&self, i: usize) -> Arriving {
        if self.extent.touched[i] == Touch::Whole { Arriving::default() } else { self.arriving(i) }
    }

    /// Whether the change can touch the light of each patch.
    pub fn touched(&self) -> &[Touch] {
        &self.extent.touched
    }
}

/// The patches whose light a `change` can touch that comes from `lamps`.
fn touched(lit: &Lit, lamps: &[Lamp], change: &Change, blocks: &[Range<usize>]) -> Vec<Touch> {
    let patches = lit.ground.patches;
    let of_block = |block: &Range<usize>| -> Vec<Touch> {
        if change.surfaces[patches.surface(block.start) as usize] {
            return vec![Touch::Whole; block.len()];
        }
        let [low, high] = block
            .clone()
            .map(|i| patches.around(i))
            .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |sum, own| [sum[0].min(own[0]), sum[1].max(own[1])]);
        let pairs = lamps.iter().flat_map(|lamp| change.boxes.iter().map(move |bounds| (lamp, bounds)));
        let near: Vec<(&Lamp, &[Vec3; 2])> =
            pairs.filter(|(lamp, bounds)| lamp.is_behind(bounds, &[low, high])).collect();
        let of_patch = |i: usize| {
            let around = patches.around(i);
            let is_touched = near.iter().any(|(lamp, bounds)| lamp.is_behind(bounds, &around));
            if is_touched { Touch::Whole } else { Touch::None }
        };
        if near.is_empty() { vec![Touch::None; block.len()] } else { block.clone().map(of_patch).collect() }
    };
    let by_block: Vec<Vec<Touch>> = blocks.par_iter().map(of_block).collect();
    by_block.concat()
}

/// `touched` with the patches next to those.
fn with_those_beside(lit: &Lit, mut touched: Vec<Touch>) -> Vec<Touch> {
    for i in 0..touched.len() {
        if touched[i] == Touch::Whole {
            for j in lit.ground.neighbours(i) {
                if touched[j] == Touch::None {
                    touched[j] = Touch::Beside;
                }
            }
        }
    }
    touched
}

impl Lamp {
    /// True where the box `bounds` lies between it and somewhere in the box `from`.
    fn is_behind(&self, bounds: &[Vec3; 2], from: &[Vec3; 2]) -> bool {
        match *self {
            Self::Near(lamp) => is_between(from, &lamp, bounds),
            Self::Far { towards, spread } => {
                let middle = |[low, high]: &[Vec3; 2]| 0.5 * (*low + *high);
                let size = bounds[0].distance(bounds[1]) + from[0].distance(from[1]);
                let far = middle(bounds).distance(middle(from)) + 0.5 * size;
                let end = [from[0] + towards * far - spread * far, from[1] + towards * far + spread * far];
                is_between(from, &end, bounds)
            }
        }
    }
}

/// True where some line from the box `from` to the box `to` meets the box `bounds` (Haines, Wallace 1991, "Shaft Culling for Efficient
/// Ray-Traced Radiosity").
fn is_between(from: &[Vec3; 2], to: &[Vec3; 2], bounds: &[Vec3; 2]) -> bool {
    // The lines fill the boxes that grow linearly from one to the other: those at shares of the way in which all sides overlap.
    let (mut first, mut last) = (0.0f32, 1.0f32);
    for axis in 0..3 {
        let below = [from[0][axis] - bounds[1][axis], to[0][axis] - bounds[1][axis]];
        let above = [bounds[0][axis] - from[1][axis], bounds[0][axis] - to[1][axis]];
        for [start, end] in [below, above] {
            // What is more than 0 lies beyond the side.
            match (start > 0.0, end > 0.0) {
                (true, true) => return false,
                (true, false) => first = first.max(start / (start - end)),
                (false, true) => last = last.min(start / (start - end)),
                (false, false) => {}
            }
        }
    }
    first <= last
}

/// Where `lights` are; `None` where they are all around.
fn lamps(lights: &Lights) -> Option<Vec<Lamp>> {
    if lights.has_sharp_sky() {
        return None;
    }
    let mut lamps: Vec<Lamp> = lights.delta.iter().map(|light| lamp(light.shape())).collect::<Option<_>>()?;
    let polygons = &lights.polygons.polygons;
    if polygons.len() <= MOST_POLYGONS {
        lamps.extend(polygons.iter().map(|p| Lamp::Near(around(p.corners.iter().copied()))));
    } else {
        lamps.push(Lamp::Near(around(polygons.iter().flat_map(|p| p.corners.iter().copied()))));
    }
    Some(lamps)
}

/// The box around some points.
fn around(points: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

fn lamp(shape: &LightShape) -> Option<Lamp> {
    match *shape {
        LightShape::Point { position, .. } | LightShape::Spot { position, .. } => Some(Lamp::Near([position; 2])),
        LightShape::Directional { direction, angle, .. } => {
            Some(Lamp::Far { towards: -direction, spread: (0.5 * angle).min(1.5).tan() })
        }
        LightShape::Sphere { world_from_unit, .. } => {
            let axes = world_from_unit.matrix3;
            let radius = axes.x_axis.length().max(axes.y_axis.length()).max(axes.z_axis.length());
            let centre = Vec3::from(world_from_unit.translation);
            Some(Lamp::Near([centre - radius, centre + radius]))
        }
        LightShape::Rect { .. } | LightShape::Disk { .. } | LightShape::Cylinder { .. } | LightShape::Portal { .. } => {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(centre: Vec3, radius: f32) -> [Vec3; 2] {
        [centre - radius, centre + radius]
    }

    #[test]
    fn a_box_is_between_or_not() {
        let bounds = [Vec3::new(-1.0, 2.0, -1.0), Vec3::new(1.0, 3.0, 1.0)];
        let here = |at: Vec3| ball(at, 0.1);
        let above = Lamp::Near(ball(Vec3::Y * 5.0, 0.1));
        assert!(above.is_behind(&bounds, &here(Vec3::ZERO)));
        assert!(!above.is_behind(&bounds, &here(Vec3::X * 4.0)), "the way passes by");
        assert!(!Lamp::Near(ball(Vec3::Y, 0.1)).is_behind(&bounds, &here(Vec3::ZERO)), "it ends before");
        assert!(above.is_behind(&bounds, &here(Vec3::new(0.0, 2.5, 0.0))), "within");
        let wide = Lamp::Near([Vec3::new(-9.0, 5.0, -0.1), Vec3::new(9.0, 5.0, 0.1)]);
        assert!(wide.is_behind(&bounds, &here(Vec3::X * 4.0)), "one end is hidden");
        assert!(!wide.is_behind(&bounds, &here(Vec3::Z * 3.0)), "thin as it is");
        let sun = Lamp::Far { towards: Vec3::Y, spread: 0.0 };
        assert!(sun.is_behind(&bounds, &here(Vec3::ZERO)) && !sun.is_behind(&bounds, &here(Vec3::Y * 4.0)));
        assert!(!sun.is_behind(&bounds, &here(Vec3::X * 1.2)));
        assert!(Lamp::Far { towards: Vec3::Y, spread: 0.2 }.is_behind(&bounds, &here(Vec3::X * 1.2)), "its edge is");
    }

    #[test]
    fn what_lines_meet_is_between() {
        // Every line that is drawn must be found, and of boxes that none meets few are taken for met.
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let (mut met, mut taken) = (0, 0);
        for _ in 0..2000 {
            let mut point = || Vec3::new(random(), random(), random());
            let mut small = || {
                let low = 4.0 * point();
                [low, low + 0.5 * point()]
            };
            let [from, to, bounds] = [small(), small(), small()];
            let on = |[low, high]: [Vec3; 2], u: Vec3| low + (high - low) * u;
            let is_met = (0..200).any(|_| {
                let (a, b) = (on(from, point()), on(to, point()));
                let inverse = (b - a).recip();
                let (p, q) = ((bounds[0] - a) * inverse, (bounds[1] - a) * inverse);
                p.min(q).max_element().max(0.0) <= p.max(q).min_element().min(1.0)
            });
            let is_taken = is_between(&from, &to, &bounds);
            assert!(is_taken || !is_met);
            met += usize::from(is_met);
            taken += usize::from(is_taken);
        }
        assert!(met > 20 && taken <= 3 * met, "{met} {taken}");
    }
}
