//! How a running stage tells its caller where it is, and learns that it should stop.

use crate::error::{Error, Result};
use std::time::Duration;

/// Receives progress and answers whether to stop. Called from many threads at once.
pub trait Progress: Sync {
    /// A stage (`load`, `unwrap`, `direct`, ...) begins; it has `total` units of work, 0 where unknown.
    fn begin(&self, stage: &'static str, total: u64);
    /// `units` more of the current stage's work are done.
    fn advance(&self, units: u64);
    /// True once the caller wants the run to end. Stages look at it at least every 100 ms.
    fn cancelled(&self) -> bool;

    /// Time since the run began; zero where it isn't known. Without a default, so that no sink forgets it: budgets of time are kept by
    /// it.
    fn elapsed(&self) -> Duration;

    /// The current stage ends once [`elapsed`](Self::elapsed) says `end`, however much of it is done by then.
    fn ends_at(&self, _end: Duration) {}

    /// What lies in the place of the result by now, in words, should the run be interrupted.
    fn keeps(&self, _what: &str) {}

    /// `Err(Cancelled)` once the caller wants the run to end.
    fn check(&self) -> Result<()> {
        if self.cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// Reports nothing and never stops.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        false
    }
    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }
}

/// One stage, whatever stages go on within it.
pub struct Within<'a>(pub &'a dyn Progress);

impl Progress for Within<'_> {
    fn begin(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
    fn elapsed(&self) -> Duration {
        self.0.elapsed()
    }
}
