//! Places that direct light is collected at, and what arrives there.

use crate::color::Rgb;
use crate::patch::{Footprint, SurfacePoint};
use crate::sample::sequence::Sequence;
use glam::Vec3;
use std::cell::OnceCell;

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

/// What arrives at one receiver.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arriving {
    pub shown: Rgb,
    pub transport: Rgb,
    /// The part of `transport` from lights that are no surface.
    pub other: Rgb,
    /// About what would arrive with nothing in its way (luminance); infinite where that isn't known, and 0 where it wasn't asked for.
    pub whole: f32,
    pub rays: u64,
}

/// Points that every receiver is given at once.
pub(super) const FIRST_POINTS: usize = 4;
/// Points over which what arrives unevenly is averaged.
const MORE_POINTS: u32 = 16;
/// Radii of a receiver beyond which what arrives at the centre of each of its flat parts stands for the whole: the rest is of
/// second order, a thousandth.
const FAR: f32 = 16.0;
/// Radii beyond which points that know the second order do: the rest is of fourth order, and random points would miss more.
const NEAR: f32 = 2.0;

/// How evenly something arrives over a receiver.
#[derive(Clone, Copy, Debug)]
pub(super) enum Evenness {
    /// From so far away [m] that a few chosen points may do, see [`FAR`] and [`NEAR`].
    From(f32),
    /// With edges in it, or from all over a disc at random.
    Rough,
}

/// A receiver with its first points and random numbers, which all emitters share.
pub(super) struct Site<'a> {
    pub receiver: &'a Receiver<'a>,
    /// The distance of the nearest polygon that shines [m]. All are averaged over the same points, so that those around a point
    /// add up exactly.
    pub nearest: f32,
    footprint: Option<&'a Footprint>,
    /// The centres of its flat parts and their shares of the whole; none where they are not known.
    parts: Vec<(SurfacePoint, f32)>,
    /// Points that stand for what is nearer, where they have been asked for.
    spread: OnceCell<Vec<(SurfacePoint, f32)>>,
    /// For each point: the place on the receiver, and two more for the place on an emitter. Known once they are asked for.
    first: OnceCell<[(SurfacePoint, [f32; 2]); FIRST_POINTS]>,
}

impl<'a> Site<'a> {
    /// `nearest` is the distance of the nearest polygon [m]; `footprint` is what the receiver's points are drawn from, where it is
    /// known.
    pub fn new(receiver: &'a Receiver<'a>, nearest: f32, footprint: Option<&'a Footprint>) -> Self {
        let parts = footprint.map_or(Vec::new(), Footprint::flat_parts);
        Self { receiver, nearest, footprint, parts, spread: OnceCell::new(), first: OnceCell::new() }
    }

    /// A point, and two random numbers for the other end of a shadow ray. Of the first set there is one for all; of others each unit of lamps
    /// has its own, by number.
    pub fn draw(&self, index: u32, set: u32, unit: u32) -> (SurfacePoint, [f32; 2]) {
        if set != 0 {
            return draw(self.receiver, self.receiver.sequence.apart(unit), index, set);
        }
        let of_first = |index: usize| draw(self.receiver, self.receiver.sequence, index as u32, 0);
        let first = self.first.get_or_init(|| std::array::from_fn(of_first));
        first.get(index as usize).copied().unwrap_or_else(|| of_first(index as usize))
    }

    /// Points and their shares of the whole that tell something at `distance` [m] well enough; none where there are none.
    fn chosen(&self, distance: f32) -> &[(SurfacePoint, f32)] {
        let radius = self.receiver.radius;
        if distance > FAR * radius {
            &self.parts
        } else if distance > NEAR * radius {
            self.spread.get_or_init(|| self.footprint.map_or(Vec::new(), Footprint::spread_parts))
        } else {
            &[]
        }
    }

    /// The mean over the receiver of `value`, which is told two random numbers.
    pub fn mean<const N: usize>(
        &self,
        evenness: Evenness,
        value: impl Fn(&SurfacePoint, [f32; 2]) -> [f32; N],
    ) -> [f32; N] {
        let (chosen, count) = match evenness {
            Evenness::From(distance) => (self.chosen(distance), FIRST_POINTS as u32),
            Evenness::Rough => (&[][..], MORE_POINTS),
        };
        if !chosen.is_empty() {
            return chosen.iter().fold([0.0; N], |sum, (point, share)| {
                let value = value(point, [0.5; 2]);
                std::array::from_fn(|k| sum[k] + share * value[k])
            });
        }
        let mut sum = [0.0f32; N];
        for index in 0..count {
            let (point, u) = self.draw(index, 0, 0);
            let value = value(&point, u);
            sum = std::array::from_fn(|k| sum[k] + value[k]);
        }
        sum.map(|s| s / count as f32)
    }
}

fn draw(receiver: &Receiver, sequence: Sequence, index: u32, set: u32) -> (SurfacePoint, [f32; 2]) {
    let [x, y, s, t] = sequence.point(index, set);
    ((receiver.sample)([x, y]), [s, t])
}
