//! What pixels have measured so far.

use crate::color::{Rgb, luminance};
use glam::DVec3;

/// Means over passes, by pixel, with their standard errors. The sums are in double precision, in the order of the passes.
#[derive(Clone, Debug)]
pub struct Film {
    /// Sums over even and over odd passes.
    halves: [Vec<DVec3>; 2],
    /// Sums of squared luminances.
    squares: Vec<f64>,
    /// Independent estimates that were added.
    estimates: u64,
    passes: u64,
}

impl Film {
    /// A film of so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self {
            halves: [vec![DVec3::ZERO; pixels], vec![DVec3::ZERO; pixels]],
            squares: vec![0.0; pixels],
            estimates: 0,
            passes: 0,
        }
    }

    /// Puts independent estimates of every pixel, as they are after `passes` passes of a method whose passes depend on each
    /// other, in the place of all that was added.
    pub fn replace(&mut self, estimates: &[Vec<Rgb>], passes: u64) {
        *self = Self::new(self.squares.len());
        estimates.iter().for_each(|values| self.add(values));
        self.passes = passes;
    }

    /// Adds a pass that estimates every pixel.
    pub fn add(&mut self, values: &[Rgb]) {
        self.add_mean(values, 1);
    }

    /// Adds the mean of so many passes that depend on each other: they count as one estimate.
    pub fn add_mean(&mut self, values: &[Rgb], passes: u64) {
        let half = &mut self.halves[(self.estimates % 2) as usize];
        for ((sum, square), value) in half.iter_mut().zip(&mut self.squares).zip(values) {
            *sum += value.as_dvec3();
            *square += f64::from(luminance(*value)).powi(2);
        }
        self.estimates += 1;
        self.passes += passes;
    }

    /// Passes so far.
    pub fn passes(&self) -> u64 {
        self.passes
    }

    /// The mean of each pixel.
    pub fn mean(&self) -> Vec<Rgb> {
        let n = self.estimates.max(1) as f64;
        let [even, odd] = &self.halves;
        even.iter().zip(odd).map(|(a, b)| ((*a + *b) / n).as_vec3()).collect()
    }

    /// Half the difference between the means over even and over odd passes: noise as large as that of the mean, where passes
    /// are independent. Zero before the second pass.
    pub fn difference(&self) -> Vec<Rgb> {
        let [even, odd] = [self.estimates.div_ceil(2), self.estimates / 2].map(|n| n as f64);
        let [a, b] = &self.halves;
        if odd == 0.0 {
            return vec![Rgb::ZERO; a.len()];
        }
        a.iter().zip(b).map(|(a, b)| (0.5 * (*a / even - *b / odd)).as_vec3()).collect()
    }

    /// Standard error of each pixel's luminance, where passes are independent; zero before the second pass.
    pub fn standard_error(&self) -> Vec<f32> {
        let n = self.estimates as f64;
        if self.estimates < 2 {
            return vec![0.0; self.squares.len()];
        }
        let error = |(mean, square): (&Rgb, &f64)| {
            let mean = f64::from(luminance(*mean));
            ((square / n - mean * mean).max(0.0) / (n - 1.0)).sqrt() as f32
        };
        self.mean().iter().zip(&self.squares).map(error).collect()
    }

    /// Whether [`noise`](Self::noise) says something: of one pass, and of a black film, it doesn't.
    pub fn knows_noise(&self) -> bool {
        self.estimates >= 2 && !self.is_black()
    }

    /// True where no pixel has met any light.
    pub fn is_black(&self) -> bool {
        self.halves.iter().flatten().all(|sum| *sum == DVec3::ZERO)
    }

    /// Root mean square of the standard errors over the mean luminance; 0 of a black film.
    pub fn noise(&self) -> f64 {
        let errors = self.standard_error();
        let squares: f64 = errors.iter().map(|e| f64::from(*e).powi(2)).sum();
        let sum: f64 = self.mean().iter().map(|v| f64::from(luminance(*v))).sum();
        let n = errors.len().max(1) as f64;
        if sum > 0.0 { (squares / n).sqrt() / (sum / n) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_of_the_passes() {
        let mut film = Film::new(1);
        [1.0, 3.0, 2.0, 6.0].into_iter().for_each(|v| film.add(&[Rgb::splat(v)]));
        assert_eq!(film.mean(), [Rgb::splat(3.0)]);
        // Variance of the passes: (4 + 0 + 1 + 9) / 3; of their mean a quarter.
        assert!((film.standard_error()[0] - (14.0f32 / 12.0).sqrt()).abs() < 1e-5);
        assert_eq!(film.difference(), [Rgb::splat(-1.5)]);
    }

    #[test]
    fn nothing_is_known_of_the_noise_of_one_pass_or_of_black() {
        let mut film = Film::new(1);
        film.add(&[Rgb::ONE]);
        assert!(!film.knows_noise() && !film.is_black());
        film.add(&[Rgb::ONE]);
        assert!(film.knows_noise());
        let mut black = Film::new(1);
        (0..3).for_each(|_| black.add(&[Rgb::ZERO]));
        assert!(!black.knows_noise() && black.is_black());
    }
}
