//! What a bake does with what earlier ones left.

use super::Settings;
use std::time::Duration;

/// Other light for an earlier bake.
#[derive(Clone, Debug, Default)]
pub struct Relight {
    /// The settings of that bake, for the report.
    pub baked: Box<Settings>,
    /// What to do where nothing that fits is remembered.
    pub advice: String,
    /// Bakes where what blocks saw isn't remembered, or is of something else.
    pub or_bake: bool,
}

/// After how much work parts of it are put into the cache [s].
const CHECKPOINT: f64 = 60.0;

impl Settings {
    /// After how much work parts of it are put into the cache.
    pub fn checkpoint(&self) -> Duration {
        Duration::from_secs_f64(self.checkpoint.unwrap_or(CHECKPOINT))
    }
}
