//! Light through participating media: what passes ([`Media::transmittance`]), and how far a way goes before it is turned
//! ([`Media::fly`]).
//!
//! Homogeneous media are followed in closed form: `T = exp(-sigma_t t)`. Grids are followed by null collisions (Woodcock et al. 1965):
//! *ratio tracking* (Novak, Selle, Jarosz 2014) for what passes, *delta tracking* for where light is turned, both with local bounds on
//! the density. Nothing is stepped through at fixed widths, so that nothing is biased.
//!
//! Coefficients differ by channel, and one way serves all three. Whether it ends is drawn by the mixture of what each channel would
//! do, weighed by its share of the throughput: the balance heuristic over channels (Wilkie et al. 2014; for null collisions Kutz,
//! Habel, Li, Novak 2017; Miller, Georgiev, Jarosz 2019). The sum of the throughput over channels never grows, and stays as it is
//! where nothing is absorbed.
//!
//! Cost: a few arithmetic operations for a homogeneous medium, as many look-ups as the bound has mean free paths along the ray for a
//! grid. Limits: media don't shine on their own accord onto ways that come from lights; what they emit is found by ways that are
//! followed from the eye or a texel.

mod body;
mod fly;
mod majorant;
mod phase;
mod transmittance;

pub use fly::Flight;
pub use phase::Phase;

use crate::color::Rgb;
use crate::scene::Scene;
use body::Body;
use glam::Vec3;

/// The media of a scene, ready for rays.
#[derive(Clone, Debug, Default)]
pub struct Media {
    bodies: Vec<Body>,
}

/// What media do at a point, those that overlap there together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficients {
    /// sigma_s [1/m].
    pub scattering: Rgb,
    /// sigma_t [1/m].
    pub extinction: Rgb,
    /// Radiance per metre [nit/m].
    pub emission: Rgb,
}

impl Media {
    /// The media of `scene`. Those that do nothing, or are at fault ([`crate::scene::Medium::fault`]), are left out.
    pub fn new(scene: &Scene) -> Self {
        Self { bodies: scene.media.iter().filter_map(|medium| Body::new(scene, medium)).collect() }
    }

    /// True where light goes on unchanged everywhere.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Their names, in the scene's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.bodies.iter().map(|body| body.name.as_str())
    }

    /// What they do at a point of the world [m].
    pub fn at(&self, point: Vec3) -> Coefficients {
        let mut sum = Coefficients::default();
        for body in &self.bodies {
            let Some(density) = body.density(point.as_dvec3()) else { continue };
            sum.scattering += body.scattering * density;
            sum.extinction += body.extinction() * density;
            sum.emission += body.emission * density;
        }
        sum
    }
}
