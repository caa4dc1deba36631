//! Probes of elements, shot when they are first asked for: a solver that touches few elements pays for few.

use super::hemisphere::{Probe, probe};
use super::{Elements, FormFactor};
use crate::Result;
use crate::light::Lit;
use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::OnceLock;

/// A probe of each element, as far as it was asked for.
pub struct Probes<'a> {
    elements: &'a Elements,
    lit: Lit<'a>,
    rays: u32,
    found: Vec<OnceLock<Probe>>,
}

impl<'a> Probes<'a> {
    /// No ray is traced yet; `rays` (a power of two) will be for each probe.
    pub fn new(elements: &'a Elements, lit: Lit<'a>, rays: u32) -> Self {
        Self { elements, lit, rays, found: vec![OnceLock::new(); elements.len()] }
    }

    /// What the rays of element `i` found.
    pub fn of(&self, i: usize) -> &Probe {
        self.found[i].get_or_init(|| probe(self.elements, &self.lit, self.rays, i))
    }

    /// The form factor from element `i` to `j` by the rays of both: they estimate the same A_i F_ij, and in proportion to the
    /// areas they count alike.
    pub fn between(&self, i: usize, j: usize) -> FormFactor {
        let landed = |from: usize, to: usize| {
            let landed = &self.of(from).landed;
            landed.binary_search_by_key(&(to as u32), |l| l.0).map_or(0.0, |k| f64::from(landed[k].1))
        };
        let ratio = f64::from(self.elements.area[j]) / f64::from(self.elements.area[i]);
        let value = 0.5 * (landed(i, j) + ratio * landed(j, i));
        let error = (value * (1.0 + ratio) / (4.0 * f64::from(self.rays))).sqrt();
        FormFactor { value, error, samples: 0 }
    }

    /// Shoots the probes of `wanted` elements.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn shoot(&self, wanted: impl Fn(usize) -> bool + Sync, progress: &dyn Progress) -> Result<()> {
        (0..self.elements.len()).into_par_iter().filter(|&i| wanted(i)).try_for_each(|i| {
            progress.check()?;
            self.of(i);
            Ok(())
        })
    }

    /// Rays of each probe.
    pub fn rays(&self) -> u32 {
        self.rays
    }

    /// Rays that were traced so far.
    pub fn traced(&self) -> u64 {
        u64::from(self.rays) * self.found.iter().filter(|p| p.get().is_some()).count() as u64
    }
}
