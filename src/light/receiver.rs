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
/// Points over which unoccluded light is averaged where it differs among the first by more than a share of its mean.
const MORE_POINTS: u32 = 16;
const UNEVEN: f32 = 0.1;
/// Radii of a flat receiver beyond which what arrives at its centre stands for the whole: the rest is of second order, a
/// thousandth.
const FAR: f32 = 16.0;

/// A receiver with its first points and random numbers, which all emitters share.
pub(super) struct Site<'a> {
    pub receiver: &'a Receiver<'a>,
    /// The centre of a flat receiver.
    centre: Option<SurfacePoint>,
    /// For each point: the place on the receiver, and two more for the place on an emitter.
    first: [(SurfacePoint, [f32; 2]); FIRST_POINTS],
}

impl<'a> Site<'a> {
    /// `flat` is the normal of a receiver that is flat, evenly shaded, and whole.
    pub fn new(receiver: &'a Receiver<'a>, flat: Option<Vec3>) -> Self {
        let centre = flat.map(|normal| SurfacePoint { position: receiver.position, normal, shading: normal });
        let mut site = Self { receiver, centre, first: std::array::from_fn(|_| (SurfacePoint::NOWHERE, [0.0; 2])) };
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

    /// The mean over the receiver of `value`, which is told two random numbers; of something at `distance` [m] that is as good as
    /// a point in those numbers, the value at the centre.
    pub fn mean(&self, distance: f32, value: impl Fn(&SurfacePoint, [f32; 2]) -> [f32; 2]) -> [f32; 2] {
        if let Some(centre) = self.centre.filter(|_| distance > FAR * self.receiver.radius) {
            return value(&centre, [0.5; 2]);
        }
        let (mut sum, mut low, mut high) = ([0.0f32; 2], f32::INFINITY, 0.0f32);
        let mut add = |(point, u): (SurfacePoint, [f32; 2])| {
            let [transport, shown] = value(&point, u);
            sum[0] += transport;
            sum[1] += shown;
            (low, high) = (low.min(transport), high.max(transport));
            (sum, high - low)
        };
        let mut count = FIRST_POINTS as u32;
        let (mut total, mut spread) = ([0.0; 2], 0.0);
        for first in self.first {
            (total, spread) = add(first);
        }
        if spread * count as f32 > UNEVEN * total[0] {
            for index in count..MORE_POINTS {
                (total, _) = add(draw(self.receiver, index, 0));
            }
            count = MORE_POINTS;
        }
        total.map(|t| t / count as f32)
    }
}

fn draw(receiver: &Receiver, index: u32, set: u32) -> (SurfacePoint, [f32; 2]) {
    let [x, y, s, t] = receiver.sequence.point(index, set);
    ((receiver.sample)([x, y]), [s, t])
}
