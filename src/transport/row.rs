//! Rows of form factors, computed when an element first shoots and kept from then on.

use super::{Effort, Elements, area, hemisphere::Probe};
use crate::patch::Ground;
use rayon::prelude::*;

/// The rows of F that have been asked for.
pub struct Rows<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    probes: &'a [Probe],
    effort: Effort,
    rows: Vec<Option<Row>>,
    /// Segments that were traced.
    pub segments: u64,
}

/// Form factors from one element to every element.
#[derive(Clone, Debug)]
pub struct Row {
    /// As estimated; symmetric in `A_i F_ij`.
    pub values: Vec<f32>,
    /// What all of them are multiplied by, so that their sum is what the element's probe saw land: in a closed scene exactly
    /// 1, and no power is made or lost by the noise of single form factors.
    pub scale: f32,
}

impl<'a> Rows<'a> {
    /// Nothing is computed yet. Memory: 4 bytes times the square of the number of elements once all rows are there.
    pub fn new(elements: &'a Elements, ground: &'a Ground<'a>, probes: &'a [Probe], effort: Effort) -> Self {
        Self { elements, ground, probes, effort, rows: vec![None; elements.len()], segments: 0 }
    }

    /// Form factors from element `i` to every element.
    pub fn row(&mut self, i: usize) -> &Row {
        if self.rows[i].is_none() {
            let (row, segments) = self.compute(i);
            self.segments += segments;
            self.rows[i] = Some(row);
        }
        self.rows[i].as_ref().expect("computed above")
    }

    /// The row of element `i` where it has been asked for.
    pub fn computed(&self, i: usize) -> Option<&Row> {
        self.rows[i].as_ref()
    }

    fn compute(&self, i: usize) -> (Row, u64) {
        let pairs: Vec<(f32, u32)> =
            (0..self.elements.len()).into_par_iter().with_min_len(32).map(|j| self.pair(i, j)).collect();
        let segments = pairs.iter().map(|p| u64::from(p.1)).sum();
        let sum: f64 = pairs.iter().map(|p| f64::from(p.0)).sum();
        let scale = if sum > 0.0 { f64::from(self.probes[i].landed_share) / sum } else { 0.0 };
        (Row { values: pairs.into_iter().map(|p| p.0).collect(), scale: scale as f32 }, segments)
    }

    /// The form factor from `i` to `j`, and the segments it took.
    fn pair(&self, i: usize, j: usize) -> (f32, u32) {
        if i == j {
            return (self.landed(i, i), 0);
        }
        let ratio = self.elements.area[j] / self.elements.area[i];
        if let Some(other) = &self.rows[j] {
            return (other.values[i] * ratio, 0);
        }
        if self.elements.are_near(i, j) {
            // Both elements' rays estimate the same A_i F_ij; in proportion to the areas they count alike.
            return (0.5 * (self.landed(i, j) + ratio * self.landed(j, i)), 0);
        }
        let f = area::form_factor(self.elements, self.ground, i, j, &self.effort);
        (f.value as f32, f.samples)
    }

    /// The share of element `i`'s probe rays that landed on `j`.
    fn landed(&self, i: usize, j: usize) -> f32 {
        let landed = &self.probes[i].landed;
        landed.binary_search_by_key(&(j as u32), |l| l.0).map_or(0.0, |k| landed[k].1)
    }
}
