//! When to stop: an estimate of how much the light that is still unshot can change each surface.
//!
//! What the shots so far carried from group to group of elements is a coarse transport matrix T; the change to come is the
//! unshot power u carried on by it, `T u + T^2 u + ...`. A group from which nothing was shot yet is taken to send all it has
//! to every group at once, so a dim room behind a door is not forgotten.

use crate::color::{Rgb, luminance};
use crate::transport::Elements;

/// Groups at most: neighbouring elements of a surface are counted together beyond.
const MOST_GROUPS: usize = 256;

/// Means below this share of the scene's count as this share: nobody sees a relative error in the dark.
const FLOOR: f64 = 1e-3;

/// Neighbouring elements of a surface, counted together.
pub struct Groups {
    /// Group of each element.
    group: Vec<u32>,
    area: Vec<f64>,
    /// By element [m^2].
    element_area: Vec<f64>,
}

/// A shrinking change that a sweep found is taken to go on shrinking by this factor at best and at worst: below, noise would
/// rule; at 1 the sum would have no end.
const SHRINKING: std::ops::RangeInclusive<f64> = 0.01..=0.99;

impl Groups {
    /// Groups the elements, which are sorted by surface and place.
    pub fn new(elements: &Elements) -> Self {
        let size = elements.len().div_ceil(MOST_GROUPS / 2).max(1);
        let mut group = Vec::with_capacity(elements.len());
        let (mut current, mut members) = (0u32, 0);
        for e in 0..elements.len() {
            let same =
                e == 0 || elements.surface[e] == elements.surface[e - 1] && elements.back[e] == elements.back[e - 1];
            // Small surfaces beyond the limit share the last group.
            if e > 0 && (!same || members >= size) && (current as usize) < MOST_GROUPS - 1 {
                current += 1;
                members = 0;
            }
            members += 1;
            group.push(current);
        }
        let count = group.last().map_or(0, |g| *g as usize + 1);
        let element_area = elements.area.iter().map(|a| f64::from(*a)).collect();
        let mut groups = Self { area: vec![0.0; count], group, element_area };
        groups.area = groups.sums(&groups.element_area);
        groups
    }

    /// Sums of `values` by element.
    fn sums(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.area.len()];
        for (value, &g) in values.iter().zip(&self.group) {
            sums[g as usize] += value;
        }
        sums
    }

    /// The mean albedo (luminance) of all elements.
    pub fn mean_albedo(&self, elements: &Elements) -> f64 {
        let reflected = elements.albedo.iter().zip(&elements.area).map(|(rho, a)| f64::from(luminance(*rho) * a));
        reflected.sum::<f64>() / self.area.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The largest change of a group's mean radiosity that is still to come, relative to that mean, where the last sweep
    /// changed the power of elements by `change`, `ratio` of what the sweep before did, to `power` [lm].
    pub fn remaining(&self, change: &[f64], ratio: f64, power: &[f64]) -> f64 {
        let ratio = ratio.clamp(*SHRINKING.start(), *SHRINKING.end());
        let change: Vec<f64> = self.sums(change).iter().map(|c| c.abs() * ratio / (1.0 - ratio)).collect();
        self.worst(&change, &self.sums(power))
    }

    /// The largest `change` of a group relative to its `power`, both by group.
    fn worst(&self, change: &[f64], power: &[f64]) -> f64 {
        let scene: f64 = power.iter().sum::<f64>() / self.area.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let relative = |g: usize| {
            let area = self.area[g].max(f64::MIN_POSITIVE);
            let floor = (power[g] / area).max(FLOOR * scene);
            if floor > 0.0 { change[g] / area / floor } else { 0.0 }
        };
        (0..self.area.len()).map(relative).fold(0.0, f64::max)
    }
}

/// What shots carried, by groups.
pub struct Convergence {
    groups: Groups,
    albedo: Vec<f64>,
    /// Power shot from each group, and what of it each group sent on (row by row) [lm].
    shot: Vec<f64>,
    carried: Vec<f64>,
}

impl Convergence {
    /// Nothing was shot yet.
    pub fn new(elements: &Elements) -> Self {
        let groups = Groups::new(elements);
        let count = groups.area.len();
        let reflected = |e: usize| f64::from(elements.area[e]) * f64::from(luminance(elements.albedo[e]));
        let reflected: Vec<f64> = (0..elements.len()).map(reflected).collect();
        let reflected = groups.sums(&reflected);
        let albedo = reflected.iter().zip(&groups.area).map(|(r, a)| r / a.max(f64::MIN_POSITIVE));
        Self { albedo: albedo.collect(), shot: vec![0.0; count], carried: vec![0.0; count * count], groups }
    }

    /// Element `i` shot `power` [lm].
    pub fn shot(&mut self, i: usize, power: Rgb) {
        self.shot[self.groups.group[i] as usize] += f64::from(luminance(power));
    }

    /// Element `j` will send on `power` [lm] of what `i` shot.
    pub fn received(&mut self, i: usize, j: usize, power: Rgb) {
        let group = &self.groups.group;
        let at = group[i] as usize * self.shot.len() + group[j] as usize;
        self.carried[at] += f64::from(luminance(power));
    }

    /// The largest remaining change of a group's mean radiosity, relative to that mean, for the `unshot` power and the power
    /// that is sent out so far, both by element [lm].
    pub fn remaining(&self, unshot: &[f64], sent: &[f64]) -> f64 {
        let count = self.shot.len();
        let unshot: Vec<f64> = unshot.iter().map(|p| p.abs()).collect();
        let mut wave = self.groups.sums(&unshot);
        let mut change = vec![0.0; count];
        let total: f64 = wave.iter().sum();
        // Each round carries the wave one bounce on; it dies out with the albedos.
        for _ in 0..100 {
            let mut next = vec![0.0; count];
            for (a, &power) in wave.iter().enumerate().filter(|(_, power)| **power > 0.0) {
                let carried = &self.carried[a * count..(a + 1) * count];
                for ((next, carried), albedo) in next.iter_mut().zip(carried).zip(&self.albedo) {
                    *next += power * if self.shot[a] > 0.0 { carried / self.shot[a] } else { *albedo };
                }
            }
            // Groups that have not shot send to all at once: power is bounded by what there was.
            let sum: f64 = next.iter().sum();
            let before: f64 = wave.iter().sum();
            let excess = if sum > before { before / sum } else { 1.0 };
            for (c, n) in change.iter_mut().zip(&mut next) {
                *c += *n;
                *n *= excess;
            }
            wave = next;
            if wave.iter().sum::<f64>() <= 1e-6 * total {
                break;
            }
        }
        // A shower of light from all sides is as bright as the brightest that sends it, and no surface gets more.
        let radiosity =
            unshot.iter().zip(&self.groups.element_area).map(|(power, area)| power / area.max(f64::MIN_POSITIVE));
        let brightest = radiosity.fold(0.0, f64::max);
        for ((change, albedo), area) in change.iter_mut().zip(&self.albedo).zip(&self.groups.area) {
            *change = change.min(albedo * area * brightest / (1.0 - albedo).max(1e-3));
        }
        self.groups.worst(&change, &self.groups.sums(sent))
    }
}
