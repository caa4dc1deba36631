//! The system that every solver takes, and what every solver returns.

use crate::Result;
use crate::color::{Rgb, luminance};
use crate::transport::Elements;

/// `B = start + rho F B` over elements.
pub struct System<'a> {
    pub elements: &'a Elements,
    /// The light that elements send on first, rho E0 [lm/m^2].
    pub start: &'a [Rgb],
}

/// Interreflected light as a solver found it.
#[derive(Clone, Debug, Default)]
pub struct Exchange {
    /// Irradiance from other elements [lx].
    pub received: Vec<Rgb>,
    /// Shots or sweeps that were made.
    pub iterations: u64,
    /// Estimated remaining change of the worst surface's mean radiosity, relative to it.
    pub residual: f64,
    /// Power that was not sent on [lm], luminance.
    pub unshot: f64,
    /// Links between clusters, and the error of irradiances that they leave, root mean square over the mean; hierarchical
    /// solver alone.
    pub links: Option<LinkReport>,
    pub steps: Vec<Step>,
}

/// How finely light is exchanged by links between clusters.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct LinkReport {
    pub count: usize,
    /// Estimated error of element irradiances, root mean square over the mean.
    pub error: f64,
}

/// How far a solver was after some iterations.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Step {
    /// Shots or sweeps so far.
    pub iteration: u64,
    /// See [`Exchange`].
    pub residual: f64,
    pub unshot: f64,
}

/// Someone who wants to see the light come up: after every so many iterations, what elements receive [lx].
pub struct Watch<'a> {
    /// Iterations between two views; none: a sweep, or so many shots that about thirty views show every element shoot once.
    pub every: Option<u64>,
    #[allow(clippy::type_complexity)]
    pub show: &'a mut dyn FnMut(u64, &[Rgb]) -> Result<()>,
}

impl Watch<'_> {
    /// Shows `received` after `iteration` where it is time to.
    ///
    /// # Errors
    /// Those of the watcher.
    pub fn see(&mut self, iteration: u64, default: u64, received: impl FnOnce() -> Vec<Rgb>) -> Result<()> {
        let every = self.every.unwrap_or(default).max(1);
        if iteration.is_multiple_of(every) { (self.show)(iteration, &received()) } else { Ok(()) }
    }
}

impl System<'_> {
    /// What each element sends once it has received `received` [lm/m^2].
    pub fn sent(&self, received: &[Rgb]) -> Vec<Rgb> {
        let albedo = self.elements.albedo.iter();
        self.start.iter().zip(albedo).zip(received).map(|((s, rho), e)| *s + *rho * *e).collect()
    }

    /// Power of the radiosities `values` by element [lm], luminance.
    pub fn power(&self, values: &[Rgb]) -> Vec<f64> {
        values.iter().zip(&self.elements.area).map(|(b, a)| f64::from(luminance(*b)) * f64::from(*a)).collect()
    }
}
