//! Form factors: how much of what leaves one element arrives at another.
//!
//! `F_ij = 1/A_i * integral over A_i, A_j of cos cos V / (pi r^2)`. Pairs that are far apart for their size are found by Monte
//! Carlo area sampling ([`area`]); near and touching ones, where that kernel is singular, by hemisphere sampling
//! ([`hemisphere`]), which has no singularity and the visibility built in. They estimate the same, so the border between them
//! is a matter of noise.

pub mod area;
pub mod element;
pub mod hemisphere;
pub mod links;
pub mod probes;
pub mod row;
pub mod tree;

pub use element::Elements;
pub use links::Links;
pub use probes::Probes;
pub use row::{Row, Rows, TransportParams};

use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;

/// How form factors are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Monte Carlo area sampling; near pairs by the analytic kernel times sampled visibility.
    #[default]
    Area,
    /// Lambert's contour integral, as if nothing stood in between.
    Analytic,
    /// The scene rasterised on half cubes over the element.
    Hemicube,
    /// Cosine-distributed rays from the element.
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

/// The form factor from element `i` to element `j`.
pub fn form_factor(
    elements: &Elements,
    ground: &crate::patch::Ground,
    i: usize,
    j: usize,
    effort: &Effort,
) -> FormFactor {
    if elements.are_near(i, j) {
        hemisphere::form_factor(elements, ground, i, j, effort)
    } else {
        area::form_factor(elements, ground, i, j, effort)
    }
}
