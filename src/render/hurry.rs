//! Pictures that there is no time for: where the first sample of each pixel would take much longer than the time that is left, squares of
//! pixels are sampled in their place.

use crate::progress::Progress;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The part of the time after which the rate so far is believed, and how late the first sample may be.
const TRUSTED: f64 = 0.25;
const LATEST: f64 = 1.3;

/// The part of the time left that one sample of each square is to take.
const AIM: f64 = 0.4;

/// The part of the whole time that is taken at least, where none is left.
const LEAST_LEFT: f64 = 0.1;

/// The side of squares where no rate is known, and the longest [pixels].
const BLIND: u32 = 4;
const LONGEST: u32 = 64;

/// Progress that ends the first sample of each pixel once it is seen to be much too late.
pub struct Hurry<'a> {
    progress: &'a dyn Progress,
    budget: Option<f64>,
    begun: f64,
    pixels: u64,
    done: AtomicU64,
}

impl<'a> Hurry<'a> {
    /// For `pixels`, from now on; without a `budget` [s] nothing is ended.
    pub fn new(progress: &'a dyn Progress, budget: Option<f64>, pixels: u64) -> Self {
        Self { progress, budget, begun: progress.elapsed().as_secs_f64(), pixels, done: AtomicU64::new(0) }
    }

    /// Whether the first sample of each pixel would be much too late.
    pub fn is_hopeless(&self) -> bool {
        let (Some(budget), done) = (self.budget, self.done.load(Ordering::Relaxed)) else { return false };
        if done >= self.pixels {
            return false;
        }
        let now = self.progress.elapsed().as_secs_f64();
        let (spent, left) = (now - self.begun, (budget - self.begun).max(0.0));
        let expected = spent * self.pixels as f64 / done as f64;
        // Methods that don't count their pixels tell nothing until they are through.
        if done == 0 { now > budget } else { spent > TRUSTED * left && expected > LATEST * left }
    }

    /// The side of the squares that there is time for [pixels].
    pub fn side(&self) -> u32 {
        let (Some(budget), done) = (self.budget, self.done.load(Ordering::Relaxed)) else { return 1 };
        if done == 0 {
            return BLIND;
        }
        let now = self.progress.elapsed().as_secs_f64();
        let rate = done as f64 / (now - self.begun).max(f64::MIN_POSITIVE);
        let squares = rate * AIM * (budget - now).max(LEAST_LEFT * budget);
        let side = (self.pixels as f64 / squares.max(1.0)).sqrt().ceil();
        (side as u32).clamp(2, LONGEST)
    }
}

impl Progress for Hurry<'_> {
    fn begin(&self, stage: &'static str, total: u64) {
        self.progress.begin(stage, total);
    }
    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
        self.progress.advance(units);
    }
    fn cancelled(&self) -> bool {
        self.progress.cancelled() || self.is_hopeless()
    }
    fn elapsed(&self) -> Duration {
        self.progress.elapsed()
    }
    fn ends_at(&self, end: Duration) {
        self.progress.ends_at(end);
    }
    fn keeps(&self, what: &str) {
        self.progress.keeps(what);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    /// A clock that is set.
    struct At(Mutex<f64>);

    impl Progress for At {
        fn begin(&self, _: &'static str, _: u64) {}
        fn advance(&self, _: u64) {}
        fn cancelled(&self) -> bool {
            false
        }
        fn elapsed(&self) -> Duration {
            Duration::from_secs_f64(*self.0.lock().unwrap())
        }
    }

    #[test]
    fn the_first_sample_ends_once_its_rate_is_known_to_be_too_low() {
        let clock = At(Mutex::new(1.0));
        let hurry = Hurry::new(&clock, Some(11.0), 1000);
        hurry.advance(20);
        *clock.0.lock().unwrap() = 2.0;
        assert!(!hurry.is_hopeless(), "too early to tell");
        *clock.0.lock().unwrap() = 4.0;
        hurry.advance(40);
        // 60 of 1000 pixels in 3 s of 10: 0.4 of 7 s are for 56 squares of 18 pixels each.
        assert!(hurry.is_hopeless() && hurry.side() == 5, "{}", hurry.side());
        hurry.advance(300);
        assert!(!hurry.is_hopeless(), "it would be through within the time");
        assert!(!Hurry::new(&clock, None, 1000).is_hopeless());
    }

    #[test]
    fn a_method_that_counts_nothing_has_all_of_the_time() {
        let clock = At(Mutex::new(0.0));
        let hurry = Hurry::new(&clock, Some(10.0), 1000);
        *clock.0.lock().unwrap() = 9.9;
        assert!(!hurry.is_hopeless());
        *clock.0.lock().unwrap() = 10.1;
        assert!(hurry.is_hopeless() && hurry.side() == BLIND);
    }
}
