//! Where light has to set out for it to come over mirrors and glass: a density over the numbers that it sets out by.
//!
//! What light sets out by is a place in the unit cube of [`CHOICES`] dimensions (which source, where on it, which way), whatever
//! the source: quads, spheres, points, suns and the sky are one to it. Trials tell what comes of places; cells of the cube are halved where
//! the halves differ, and are drawn by the root of the mean square of what comes of them, which makes the noise least. As in the
//! primary sample space of Kelemen et al. (2002), photons that are found are sent to again (Hachisuka, Jensen 2011, "Robust
//! Adaptive Photon Tracing using Photon Path Visibility"), but by a density that is known and fixed, as that of Mueller, Gross, Novak
//! (2017, "Practical Path Guiding", section 3), so that each photon stands for itself.
//!
//! Unbiased: the density is even within each cell, and a share of the draws, [`DEFENCE`], goes evenly over the cube: what no trial found
//! is found still. Reproducible: trials depend on the seed alone. Cost: [`ROUNDS`] of [`ROUND`] trials, most of which end at once.

use crate::Result;
use crate::integrate::emit::CHOICES;
use crate::progress::Progress;
use crate::sample::{Discrete, Drawn, Numbers, sequence::Stage};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::RangeInclusive;

/// A density over what light sets out by.
pub struct Aim {
    cells: Vec<Cell>,
    choice: Option<Discrete>,
    /// The even density over that of each cell.
    weights: Vec<f32>,
}

/// A place in the cube.
pub type Place = [f32; CHOICES];

/// A box within the cube.
struct Cell {
    low: Place,
    width: Place,
    trials: Vec<Trial>,
    /// Mean square of what came of the cell's parent: one more trial, so that no few make a cell black.
    prior: f64,
}

/// A place that was tried.
#[derive(Clone, Copy)]
struct Trial {
    at: Place,
    /// The square of what came of it.
    square: f32,
}

/// Trials of a round.
const ROUND: u32 = 1 << 15;

/// Rounds; beyond the first number only while fewer than [`ENOUGH`] trials brought anything.
const ROUNDS: RangeInclusive<u64> = 6..=24;
const ENOUGH: usize = 1000;

/// The share of what is sent that goes evenly over the cube, and that of trials.
const DEFENCE: f64 = 0.15;
const DEFENCE_OF_TRIALS: f64 = 0.5;

/// Cells, at most, and trials of a cell that is halved, at least.
const MOST_CELLS: usize = 1 << 13;
const LEAST_TRIALS: usize = 32;

/// Difference between the means of halves, over its standard error, from which it isn't taken for chance.
const CERTAIN: f64 = 3.0;

/// The least width of a cell that is halved: numbers have 24 bits.
const LEAST_WIDTH: f32 = 1.0 / (1 << 16) as f32;

/// Where the numbers of trials begin among those of photons.
const TRIALS: u64 = 1 << 39;

impl Aim {
    /// Aims at nothing.
    pub fn even() -> Self {
        Self { cells: vec![Cell::whole()], choice: Discrete::new([1.0]), weights: vec![1.0] }
    }

    /// Learns where places lie that `value` is not 0 of.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn learn(seed: u32, progress: &dyn Progress, value: impl Fn(Place, &mut Drawn) -> f32 + Sync) -> Result<Self> {
        let mut aim = Self::even();
        let mut found = 0;
        for round in 0..*ROUNDS.end() {
            if round >= *ROUNDS.start() && found >= ENOUGH {
                break;
            }
            progress.check()?;
            let trials: Vec<(usize, Trial)> = (0..ROUND)
                .into_par_iter()
                .map(|k| {
                    let mut numbers = Drawn::new(seed, Stage::Photon, TRIALS + round, u64::from(k));
                    let (cell, at) = aim.place(&mut numbers);
                    let square = value(at, &mut numbers).powi(2);
                    (cell, Trial { at, square: if square.is_finite() { square } else { 0.0 } })
                })
                .collect();
            for (cell, trial) in trials {
                found += usize::from(trial.square > 0.0);
                aim.cells[cell].trials.push(trial);
            }
            aim.cells = halved(aim.cells);
            aim.weigh(DEFENCE_OF_TRIALS);
        }
        aim.weigh(DEFENCE);
        aim.cells.iter_mut().for_each(|cell| cell.trials = Vec::new());
        Ok(aim)
    }

    /// A place, and what is sent from it over what would be if all places were as likely.
    pub fn draw(&self, numbers: &mut impl Numbers) -> (Place, f32) {
        let (cell, at) = self.place(numbers);
        (at, self.weights[cell])
    }

    fn place(&self, numbers: &mut impl Numbers) -> (usize, Place) {
        let (chosen, [a, b, c], [d, e, f]) = (numbers.next(), numbers.triple(), numbers.triple());
        let cell = self.choice.as_ref().map_or(0, |choice| choice.sample(chosen).0);
        let Cell { low, width, .. } = &self.cells[cell];
        let mut at = [a, b, c, d, e, f];
        for (k, u) in at.iter_mut().enumerate() {
            *u = (low[k] + width[k] * *u).min(1.0 - f32::EPSILON);
        }
        (cell, at)
    }

    /// Draws cells anew by what came of them, but for the share `defence`.
    fn weigh(&mut self, defence: f64) {
        let [volumes, shares]: [Vec<f64>; 2] = [
            self.cells.iter().map(Cell::volume).collect(),
            self.cells.iter().map(|cell| cell.volume() * cell.square().sqrt()).collect(),
        ];
        let total: f64 = shares.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            *self = Self { cells: std::mem::take(&mut self.cells), ..Self::even() };
            self.choice = Discrete::new(volumes);
            self.weights = vec![1.0; self.cells.len()];
            return;
        }
        let chance = |(volume, share): (&f64, &f64)| defence * volume + (1.0 - defence) * share / total;
        self.choice = Discrete::new(volumes.iter().zip(&shares).map(chance));
        // What the table says, not what it was asked for: rounding must not bias.
        let of = |(k, volume): (usize, &f64)| self.choice.as_ref().map_or(1.0, |choice| volume / choice.pdf(k)) as f32;
        self.weights = volumes.iter().enumerate().map(of).collect();
    }
}

/// The cells, each halved for as long as its halves differ.
fn halved(cells: Vec<Cell>) -> Vec<Cell> {
    let (mut queue, mut done) = (VecDeque::from(cells), Vec::new());
    while let Some(cell) = queue.pop_front() {
        let has_room = done.len() + queue.len() + 2 <= MOST_CELLS;
        match cell.best_axis().filter(|_| has_room) {
            Some(axis) => queue.extend(cell.halves(axis)),
            None => done.push(cell),
        }
    }
    done
}

/// Sums over the trials of a half.
#[derive(Clone, Copy, Default)]
struct Half {
    count: f64,
    squares: f64,
}

impl Cell {
    fn whole() -> Self {
        Self { low: [0.0; CHOICES], width: [1.0; CHOICES], trials: Vec::new(), prior: 0.0 }
    }

    fn volume(&self) -> f64 {
        self.width.iter().map(|w| f64::from(*w)).product()
    }

    /// Mean square of what comes of it.
    fn square(&self) -> f64 {
        let sum: f64 = self.trials.iter().map(|trial| f64::from(trial.square)).sum();
        (sum + self.prior) / (self.trials.len() + 1) as f64
    }

    fn middle(&self, axis: usize) -> f32 {
        self.low[axis] + 0.5 * self.width[axis]
    }

    /// The axis along which halves differ the most; `None` where they may be alike.
    fn best_axis(&self) -> Option<usize> {
        if self.trials.len() < LEAST_TRIALS {
            return None;
        }
        let n = self.trials.len() as f64;
        let (mut sum, mut fourth, mut low) = (0.0, 0.0, [Half::default(); CHOICES]);
        for trial in &self.trials {
            let square = f64::from(trial.square);
            sum += square;
            fourth += square * square;
            for (axis, half) in low.iter_mut().enumerate() {
                if trial.at[axis] < self.middle(axis) {
                    half.count += 1.0;
                    half.squares += square;
                }
            }
        }
        let variance = fourth / n - (sum / n).powi(2);
        let gain = |axis: usize| {
            let Half { count, squares } = low[axis];
            if count == 0.0 || count == n || self.width[axis] < LEAST_WIDTH {
                return None;
            }
            let [a, b] = [squares / count, (sum - squares) / (n - count)];
            let error = (variance * (count.recip() + (n - count).recip())).sqrt();
            // Noise falls as the mean of roots falls below the root of the mean.
            ((a - b).abs() > CERTAIN * error).then(|| (0.5 * (a + b)).sqrt() - 0.5 * (a.sqrt() + b.sqrt()))
        };
        let gains = (0..CHOICES).filter_map(|axis| Some((axis, gain(axis)?)));
        gains.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(axis, _)| axis)
    }

    fn halves(self, axis: usize) -> [Self; 2] {
        let (prior, middle) = (self.square(), self.middle(axis));
        let mut width = self.width;
        width[axis] *= 0.5;
        let mut above = self.low;
        above[axis] = middle;
        let (low, high) = self.trials.into_iter().partition(|trial| trial.at[axis] < middle);
        [Self { low: self.low, width, trials: low, prior }, Self { low: above, width, trials: high, prior }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// Mean and standard error of `value` by places that `aim` draws, and the share of them that it isn't 0 of.
    fn integral(aim: &Aim, value: impl Fn(Place) -> f32) -> (f64, f64, f64) {
        let n = 1 << 16;
        let (mut sum, mut square, mut found) = (0.0, 0.0, 0.0);
        for k in 0..n {
            let (at, weight) = aim.draw(&mut Drawn::new(9, Stage::Photon, 0, k));
            let term = f64::from(value(at) * weight);
            sum += term;
            square += term * term;
            found += f64::from(u8::from(term > 0.0));
        }
        let n = n as f64;
        (sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt(), found / n)
    }

    #[test]
    fn what_is_small_is_found_and_its_integral_is_exact() {
        // A ball in four of the dimensions: 5e-4 of the cube.
        let middle = [0.3, 0.62, 0.81, 0.44];
        let radius = 0.1f32;
        let ball = |at: Place| {
            let square: f32 = middle.iter().zip(&at[1..]).map(|(m, u)| (m - u).powi(2)).sum();
            if square < radius * radius { 2.0 } else { 0.0 }
        };
        let aim = Aim::learn(1, &Silent, |at, _| ball(at)).unwrap();
        let exact = 2.0 * std::f64::consts::PI.powi(2) / 2.0 * f64::from(radius).powi(4);
        let (found, error, share) = integral(&aim, ball);
        println!("{found:.4e} +- {error:.1e} of {exact:.4e}, {:.0} % hit, {} cells", 100.0 * share, aim.cells.len());
        assert!((found - exact).abs() < 4.0 * error && error < 0.02 * exact, "{found} +- {error} of {exact}");
        // Unaided, one of 2,000 would.
        assert!(share > 0.2, "only {share} of what is sent hits");
    }

    #[test]
    fn what_no_trial_found_is_not_lost() {
        // Trials see one half of what counts.
        let (seen, all) = (|at: Place| f32::from(at[2] < 0.01), |at: Place| f32::from((at[2] - 0.5).abs() > 0.49));
        let aim = Aim::learn(1, &Silent, |at, _| seen(at)).unwrap();
        let (found, error, _) = integral(&aim, all);
        assert!((found - 0.02).abs() < 4.0 * error && error < 1e-3, "{found} +- {error}");
        let blind = Aim::learn(1, &Silent, |_, _| 0.0).unwrap();
        assert_eq!(integral(&blind, |_| 1.0).0, 1.0);
    }
}
