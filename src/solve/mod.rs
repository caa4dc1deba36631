//! Solving the balance `B_i = M_i + rho_i (E0_i + sum_j F_ij B_j)` over elements, by any of several solvers.
//!
//! Light straight from emitters is in E0 already, so what elements exchange starts with the light it leaves behind: rho E0.

pub mod bounces;
pub mod convergence;
pub mod front;
pub mod full_matrix;
pub mod hierarchical;
pub mod progressive;
pub mod sweep;
pub mod system;

pub use front::solve;
pub use system::{Exchange, LinkReport, Step, System, Watch};

use crate::color::Rgb;
use crate::transport::{Method, TransportParams};

/// How the system is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// [`Solver::Progressive`] for few elements, [`Solver::Hierarchical`] for many.
    #[default]
    Auto,
    /// LU decomposition of I - F rho: the truth for small scenes.
    FullMatrix,
    /// Gathering; the k-th sweep adds the k-th bounce.
    Jacobi,
    /// Gathering that uses each value as soon as it is found.
    GaussSeidel,
    /// Shooting in the order of unshot power.
    Progressive,
    /// Gathering by links between clusters of elements.
    Hierarchical,
}

/// Elements that the full matrix takes at most: 600 MB and about a minute.
pub const MOST_FULL_MATRIX: usize = 5000;

/// Elements up to which [`Solver::Auto`] shoots: beyond, links between clusters reach the same error sooner.
const MOST_PROGRESSIVE: usize = 10_000;

impl SolveParams {
    /// True where something is asked for that only rows of form factors have.
    fn needs_rows(&self) -> bool {
        self.transport.method != Method::Area || self.overshoot || self.ambient
    }
}

impl Solver {
    /// The solver that stands for `self` with `elements` elements, where `rows` says that something is asked for that links of
    /// the hierarchy don't have.
    pub fn choose(self, elements: usize, rows: bool) -> Self {
        match self {
            Self::Auto if elements > MOST_PROGRESSIVE && !rows => Self::Hierarchical,
            Self::Auto => Self::Progressive,
            // A tree has at least one leaf.
            Self::Hierarchical if elements == 0 => Self::Progressive,
            chosen => chosen,
        }
    }

    /// Its name in options and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::FullMatrix => "full-matrix",
            Self::Jacobi => "jacobi",
            Self::GaussSeidel => "gauss-seidel",
            Self::Progressive => "progressive",
            Self::Hierarchical => "hierarchical",
        }
    }
}

/// What is solved for, and how far.
#[derive(Clone, Debug)]
pub struct SolveParams {
    pub solver: Solver,
    pub transport: TransportParams,
    /// Interreflections between elements. None: all.
    pub max_bounces: Option<u32>,
    /// Shots or sweeps after which to stop, converged or not. None: until converged.
    pub iterations: Option<u64>,
    /// Estimated remaining change of each surface's mean radiosity, relative to it, at which to stop.
    pub residual: f64,
    /// Power that a link of the hierarchy may misplace, relative to all power.
    pub link_error: f64,
    /// Progressive refinement shoots ahead what the shooter is about to receive.
    pub overshoot: bool,
    /// Adds the ambient term for what progressive refinement has not shot.
    pub ambient: bool,
    /// Interreflections wanted one by one, at most; 0: none.
    pub bounces: usize,
}

/// The light on elements.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Irradiance that the gather reads beyond a patch's own direct light [lx]: interreflected light and the sky's; on backs
    /// direct light too.
    pub irradiance: Vec<Rgb>,
    /// The part of it that is reflected once, twice, ... on its way between elements [lx], as far as it was asked for.
    pub bounces: Vec<Vec<Rgb>>,
    /// On backs, the share of the light leaving them that lands on elements; the rest escapes or falls on black backs.
    pub landed_share: Vec<f32>,
    /// The solver that was used.
    pub solver: Solver,
    /// How it came about; what elements received from each other is part of `irradiance`.
    pub exchange: Exchange,
    /// Segments that were traced for form factors.
    pub segments: u64,
    /// Share of the ways between elements that something blocks, unknown to analytic form factors; 0 for the others.
    pub blocked_share: f64,
    /// Light on backs straight from the sky and from lights that are no surface, as flux [lm].
    pub inflow: glam::DVec3,
    pub rays: u64,
}
