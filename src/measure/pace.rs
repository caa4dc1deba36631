//! How passes keep to a time: none begins that would end too late by the time of the last, and one that takes longer than that all
//! the same is cut off and forgotten.

use crate::error::{Error, Result};
use crate::integrate::Integrator;
use crate::progress::Progress;
use crate::sensor::Film;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Over the budget: where a pass may end by what is expected, and where it is cut off.
const EXPECTED: f64 = 1.02;
const LATEST: f64 = 1.05;

/// The time that passes may take, and that they took.
pub struct Pace<'a> {
    progress: &'a dyn Progress,
    /// When measuring began, by the run's clock and by our own, which goes on where that one doesn't.
    before: Duration,
    start: Instant,
    budget: Option<Duration>,
    /// The last pass, and the longest time in which what was measured was shown.
    pass: Duration,
    show: Duration,
}

impl<'a> Pace<'a> {
    /// The clock begins now; `budget` counts from where the run began.
    pub fn new(budget: Option<Duration>, progress: &'a dyn Progress) -> Self {
        let (pass, show) = (Duration::ZERO, Duration::ZERO);
        Self { progress, before: progress.elapsed(), start: Instant::now(), budget, pass, show }
    }

    fn elapsed(&self) -> Duration {
        self.before + self.start.elapsed()
    }

    /// Whether a pass as long as the last would end in time, with what was measured shown once more.
    pub fn has_time(&self) -> bool {
        self.budget.is_none_or(|budget| self.elapsed() + self.pass + self.show <= budget.mul_f64(EXPECTED))
    }

    /// Whether the budget is used up.
    pub fn is_late(&self) -> bool {
        self.budget.is_some_and(|budget| self.elapsed() > budget.mul_f64(LATEST))
    }

    /// Makes a pass over `pixels`; false where it was cut off, and `film` is as it was. The first pass is never cut off: it is the least
    /// that there is to show.
    ///
    /// # Errors
    /// Those of the method; `Cancelled` where the caller wants to end.
    pub fn pass(&mut self, method: &mut dyn Integrator, film: &mut Film, pixels: usize) -> Result<bool> {
        let begun = Instant::now();
        let before = film.passes();
        let is_first = before == 0;
        let pass = Pass { pace: self, pixels: pixels as u64, done: AtomicU64::new(0), is_first };
        match method.pass(film, &pass) {
            Err(Error::Cancelled) if !self.progress.cancelled() => Ok(false),
            Err(error) => Err(error),
            Ok(()) => {
                // Some methods make several samples of a pixel at once.
                let made = (film.passes() - before).saturating_mul(pixels as u64);
                let rest = made.saturating_sub(pass.done.into_inner().min(pass.pixels));
                self.progress.advance(rest);
                self.pass = begun.elapsed();
                Ok(true)
            }
        }
    }

    /// Shows what was measured, and learns how long that takes.
    ///
    /// # Errors
    /// Those of `show`.
    pub fn show(&mut self, show: impl FnOnce() -> Result<()>) -> Result<()> {
        let begun = Instant::now();
        show()?;
        self.show = self.show.max(begun.elapsed());
        Ok(())
    }
}

/// The progress of a pass: its pixels are units of the whole's, whether its method counts them or not.
struct Pass<'p, 'a> {
    pace: &'p Pace<'a>,
    pixels: u64,
    done: AtomicU64,
    is_first: bool,
}

impl Progress for Pass<'_, '_> {
    fn begin(&self, _: &'static str, _: u64) {}

    fn advance(&self, units: u64) {
        let before = self.done.fetch_add(units, Ordering::Relaxed);
        self.pace.progress.advance(units.min(self.pixels.saturating_sub(before)));
    }

    fn cancelled(&self) -> bool {
        // Methods that don't count their pixels look here often: what is known so far is shown all the same.
        self.pace.progress.advance(0);
        self.pace.progress.cancelled() || !self.is_first && self.pace.is_late()
    }

    fn elapsed(&self) -> Duration {
        self.pace.elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::progress::Silent;

    /// Each pass takes as long as the last one times its factor, and looks every millisecond whether to end.
    struct Slow(Duration, u32);

    impl Integrator for Slow {
        fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
            let begun = Instant::now();
            while begun.elapsed() < self.0 {
                progress.check()?;
                std::thread::sleep(Duration::from_millis(1));
            }
            self.0 *= self.1;
            film.add(&[Rgb::ONE]);
            Ok(())
        }
    }

    fn passes(mut method: Slow, budget: Duration) -> (u64, Duration) {
        let begun = Instant::now();
        let mut pace = Pace::new(Some(budget), &Silent);
        let mut film = Film::new(1);
        while film.passes() == 0 || pace.has_time() {
            if !pace.pass(&mut method, &mut film, 1).unwrap() {
                break;
            }
        }
        (film.passes(), begun.elapsed())
    }

    #[test]
    fn passes_end_within_the_budget_without_a_clock_of_the_callers() {
        let (done, took) = passes(Slow(Duration::from_millis(20), 1), Duration::from_millis(200));
        assert!((2..=10).contains(&done) && took < Duration::from_millis(350), "{done} in {took:?}");
    }

    #[test]
    fn a_pass_that_takes_longer_than_expected_is_cut_off() {
        // 40 ms, then what would be 40 s.
        let (done, took) = passes(Slow(Duration::from_millis(40), 1000), Duration::from_millis(300));
        assert!(done == 1 && took < Duration::from_secs(2), "{done} in {took:?}");
    }

    #[test]
    fn the_first_pass_is_whole_whatever_it_takes() {
        let (done, took) = passes(Slow(Duration::from_millis(60), 1), Duration::from_millis(10));
        assert!(done == 1 && took >= Duration::from_millis(60), "{done} in {took:?}");
    }
}
