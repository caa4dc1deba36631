//! Form factors: how much of what leaves one element arrives at another.
//!
//! `F_ij = 1/A_i * integral over A_i, A_j of cos cos V / (pi r^2)`, by any [`Method`] on the same elements, so that each checks
//! the others:
//!
//! | method | far pairs | near and touching pairs | occluders | noise |
//! |---|---|---|---|---|
//! | [`area`] | points on both, a segment between them | analytic times sampled visibility ([`near`]) | yes | falls as asked |
//! | [`analytic`] | Lambert's contour integral, adaptive quadrature | the same | none | none |
//! | [`hemicube`] | the scene drawn over points of the shooter | the same | yes | aliasing |
//! | [`hemisphere`] | the share of cosine-distributed rays that land | the same | yes | the most |

pub mod analytic;
pub mod area;
mod batches;
pub mod cluster;
pub mod element;
pub mod hemicube;
pub mod hemisphere;
pub mod links;
pub mod near;
pub mod outline;
pub mod probes;
mod refine;
pub mod row;
pub mod tree;

pub use element::Elements;
pub use links::Links;
pub use outline::Outline;
pub use probes::Probes;
pub use row::{Row, Rows, TransportParams};

use crate::Result;
use crate::color::Rgb;
use crate::patch::Ground;
use crate::progress::Progress;
use hemicube::{Hemicube, HemicubeParams};

/// How form factors are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Points on both elements and the visibility between them, to the error asked for.
    #[default]
    Area,
    /// Contour integrals and quadrature: exact where nothing blocks; occluders are not seen.
    Analytic,
    /// The scene rasterised on half a cube.
    Hemicube,
    /// Cosine-distributed rays.
    Hemisphere,
}

/// Carries light from all elements to all elements.
pub trait Exchanger {
    /// Irradiance of every element by what all of them send [lx].
    ///
    /// # Errors
    /// `Cancelled`.
    fn gather(&mut self, sent: &[Rgb], progress: &dyn Progress) -> Result<Vec<Rgb>>;
}

/// How exactly a form factor is wanted.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Standard error that is aimed at, relative to the form factor.
    pub relative_error: f32,
    /// Form factors below this are wanted to `relative_error * floor` absolutely: what is small need not be exact.
    pub floor: f32,
    /// Samples before the first look at the error, at least 2. A pair whose first samples agree is believed, so fewer of them
    /// make small occluders count for less.
    pub first_samples: u32,
    /// Samples a pair gets at most; a power of two, 2..=65536.
    pub most_samples: u32,
}

impl Default for Effort {
    /// For one form factor on its own: 0.2 %.
    fn default() -> Self {
        Self { relative_error: 0.002, floor: 0.0, first_samples: 32, most_samples: 1 << 16 }
    }
}

impl Effort {
    /// The standard error that is good enough for a form factor of about `f`.
    fn tolerance(&self, f: f64) -> f64 {
        f64::from(self.relative_error) * f.max(f64::from(self.floor))
    }

    /// True where a form factor of at most `f` may be found by one sample: whether that sees its way or not, it is off by half
    /// of `f` at most, as a standard deviation.
    fn is_small(&self, f: f32) -> bool {
        0.5 * f64::from(f) <= self.tolerance(0.0)
    }
}

/// An estimated form factor.
#[derive(Clone, Copy, Debug, Default)]
pub struct FormFactor {
    pub value: f64,
    /// Estimated standard error.
    pub error: f64,
    /// Segments or rays that were spent on it.
    pub samples: u32,
}

/// The form factor from element `i` to element `j` by `method`. What `samples` counts is the method's: segments, points, cubes
/// or rays. Elements that see themselves (i = j) go by the hemisphere where the method is `Area`.
pub fn form_factor(
    elements: &Elements,
    ground: &Ground,
    i: usize,
    j: usize,
    method: Method,
    effort: &Effort,
) -> FormFactor {
    let outlines = || [i, j].map(|e| Outline::new(elements, ground, e));
    match method {
        Method::Area if i == j => hemisphere::form_factor(elements, ground, i, j, effort),
        Method::Area if elements.are_near(i, j) => {
            near::form_factor(elements, ground, i, j, outlines().each_ref(), effort)
        }
        Method::Area => area::form_factor(elements, ground, i, j, effort),
        Method::Analytic => analytic::form_factor(elements, i, j, outlines().each_ref(), effort),
        Method::Hemicube => Hemicube::new(&HemicubeParams::default()).pair(elements, ground, i, j, effort),
        Method::Hemisphere => hemisphere::form_factor(elements, ground, i, j, effort),
    }
}
