//! What passes through media: closed forms, and ratio tracking through grids (Novak, Selle, Jarosz 2014).
//!
//! The transmittances of media that overlap multiply, and so do independent estimates of them: each is followed on its own.

use super::Media;
use super::body::Crossing;
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::trace::Ray;

/// What is left below this share is followed on by chance: each further step would change next to nothing.
const LITTLE: f32 = 0.05;

impl Media {
    /// The share of the light along `ray` that passes over `distance` [m], which may be infinite, per channel: an estimate without bias,
    /// never more than 1. Exact, and without a number drawn, where no grid lies in the way.
    pub fn transmittance(&self, ray: &Ray, distance: f32, numbers: &mut impl Numbers) -> Rgb {
        let mut passed = Rgb::ONE;
        let mut depth = Rgb::ZERO;
        for crossing in self.bodies.iter().filter_map(|body| body.cross(ray, distance)) {
            match crossing.walk {
                None => depth += crossing.body.extinction() * crossing.length(),
                Some(_) => passed *= track(crossing, numbers),
            }
        }
        passed * attenuation(depth)
    }
}

/// `exp(-depth)`, per channel.
pub(super) fn attenuation(depth: Rgb) -> Rgb {
    (-depth).exp()
}

/// The distance to the next collision in mean free paths.
pub(super) fn free_path(numbers: &mut impl Numbers) -> f64 {
    -f64::from(1.0 - numbers.next()).ln()
}

/// An estimate of what passes through a grid: at each collision with the bound, the share that the bound is too high.
fn track(mut crossing: Crossing, numbers: &mut impl Numbers) -> Rgb {
    let extinction = crossing.body.extinction();
    let strongest = f64::from(extinction.max_element());
    let Some(mut walk) = crossing.walk.take().filter(|_| strongest > 0.0) else { return Rgb::ONE };
    let [mut t, end] = crossing.span;
    let mut passed = Rgb::ONE;
    // Mean free paths to go.
    let mut rest = free_path(numbers);
    while t < end {
        let (bound, border) = walk.bound(t);
        let rate = f64::from(bound) * strongest;
        let steps = (border.min(end) - t) * rate;
        if rest >= steps {
            rest -= steps;
            t = border;
            continue;
        }
        t = (t + rest / rate).max(t.next_up());
        passed *= (1.0 - extinction * (f64::from(crossing.density(t)) / rate) as f32).max(Rgb::ZERO);
        let most = passed.max_element();
        if most < LITTLE {
            // Raised to what it is followed on with, or ended.
            if numbers.next() * LITTLE >= most {
                return Rgb::ZERO;
            }
            passed *= LITTLE / most;
        }
        rest = free_path(numbers);
    }
    passed
}

impl Crossing<'_> {
    /// How long it is [m].
    pub fn length(&self) -> f32 {
        (self.span[1] - self.span[0]) as f32
    }
}
