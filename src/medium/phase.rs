//! Phase functions: how a medium spreads the light that it scatters.

use crate::sample::warp::frame;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Henyey and Greenstein's phase function (1941), `p(cos) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))`; g = 0 is isotropic.
///
/// The cosine is that of the angle by which light is turned: 1 is straight on. Light and importance follow the same function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// Mean cosine, within -1..1 exclusive.
    pub g: f32,
}

/// Below this |g| the inverse of the distribution loses digits, and the function is even to as many.
const EVEN: f32 = 1e-4;

impl Phase {
    /// The same in all directions.
    pub const ISOTROPIC: Self = Self { g: 0.0 };

    /// The share of the scattered light that is turned by an angle of cosine `cos`, per solid angle [1/sr]; also the density with which
    /// [`Phase::sample`] draws directions there.
    pub fn evaluate(&self, cos: f32) -> f32 {
        let g = self.g;
        // As 1 + g^2 - 2 g cos, but without cancelling where both g and cos are near 1.
        let square = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos.clamp(-1.0, 1.0));
        0.25 * FRAC_1_PI * (1.0 - g * g) / (square * square.sqrt())
    }

    /// [`Phase::evaluate`] for unit directions that both point away from the place where light is scattered, as those of surfaces do:
    /// `wo` back to where the way came from, `wi` to where it goes on.
    pub fn between(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.evaluate(-wo.dot(wi))
    }

    /// A unit direction to go on in, where `wo` (unit) points back to where the way came from, and its density [1/sr]. The weight of what
    /// goes on is 1.
    pub fn sample(&self, wo: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let g = self.g;
        let cos = if g.abs() < EVEN {
            1.0 - 2.0 * u[0]
        } else {
            let s = (1.0 - g * g) / (1.0 + g - 2.0 * g * u[0]);
            ((1.0 + g * g - s * s) / (2.0 * g)).clamp(-1.0, 1.0)
        };
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let azimuth = TAU * u[1];
        let turned = Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
        ((frame(-wo) * turned).normalize(), self.evaluate(cos))
    }
}
