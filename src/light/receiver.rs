//! Places that direct light is collected at, and what arrives there.

use crate::color::Rgb;
use crate::patch::SurfacePoint;
use crate::sample::sequence::Sequence;
use glam::Vec3;

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
    pub rays: u64,
}

/// Points that every receiver is given at once.
pub(super) const FIRST_POINTS: usize = 4;
/// Points over which what arrives unevenly is averaged.
const MORE_POINTS: u32 = 16;
/// Radii of a receiver beyond which what arrives at the centre of each of its flat parts stands for the whole: the rest is of
/// second order, a thousandth.
const FAR: f32 = 16.0;

/// How evenly something arrives over a receiver.
#[derive(Clone, Copy, Debug)]
pub(super) enum Evenness {
    /// From so far away [m] that the parts' centres may do, see [`FAR`].
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
    /// The centres of its flat parts and their shares of the whole; none where they are not known.
    parts: &'a [(SurfacePoint, f32)],
    /// For each point: the place on the receiver, and two more for the place on an emitter.
    first: [(SurfacePoint, [f32; 2]); FIRST_POINTS],
}

impl<'a> Site<'a> {
    /// `nearest` is the distance of the nearest polygon [m];
    /// `parts` are the centres of the receiver's flat parts and their shares of the whole; none where they are not known.
    pub fn new(receiver: &'a Receiver<'a>, nearest: f32, parts: &'a [(SurfacePoint, f32)]) -> Self {
        let mut site = Self { receiver, nearest, parts, first: [(SurfacePoint::NOWHERE, [0.0; 2]); FIRST_POINTS] };
        for (k, first) in site.first.iter_mut().enumerate() {
            *first = draw(receiver, k as u32, 0);
        }
        site
    }

    /// A point, and two random numbers for the other end of a shadow ray. Of the first points there is one set for all.
    pub fn draw(&self, index: u32, set: u32) -> (SurfacePoint, [f32; 2]) {
        match self.first.get(index as usize) {
            Some(first) if set == 0 => *first,
            _ => draw(self.receiver, index, set),
        }
    }

    /// True where something at `distance` [m] is told well enough by the centres of the parts.
    fn is_far(&self, distance: f32) -> bool {
        distance > FAR * self.receiver.radius && !self.parts.is_empty()
    }

    /// The mean over the receiver of `value`, which is told two random numbers.
    pub fn mean<const N: usize>(
        &self,
        evenness: Evenness,
        value: impl Fn(&SurfacePoint, [f32; 2]) -> [f32; N],
    ) -> [f32; N] {
        let count = match evenness {
            Evenness::From(distance) if self.is_far(distance) => {
                return self.parts.iter().fold([0.0; N], |sum, (centre, share)| {
                    let value = value(centre, [0.5; 2]);
                    std::array::from_fn(|k| sum[k] + share * value[k])
                });
            }
            Evenness::From(_) => FIRST_POINTS as u32,
            Evenness::Rough => MORE_POINTS,
        };
        let mut sum = [0.0f32; N];
        for index in 0..count {
            let (point, u) = self.draw(index, 0);
            let value = value(&point, u);
            sum = std::array::from_fn(|k| sum[k] + value[k]);
        }
        sum.map(|s| s / count as f32)
    }
}

fn draw(receiver: &Receiver, index: u32, set: u32) -> (SurfacePoint, [f32; 2]) {
    let [x, y, s, t] = receiver.sequence.point(index, set);
    ((receiver.sample)([x, y]), [s, t])
}
