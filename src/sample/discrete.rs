//! Choosing among weighted items.

/// A cumulative table over non-negative weights.
#[derive(Clone, Debug)]
pub struct Discrete {
    /// Running sums; the last is the total.
    sums: Vec<f64>,
}

impl Discrete {
    /// A table over `weights`; `None` where their sum is zero or not finite.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut total = 0.0;
        let sums: Vec<f64> = weights
            .into_iter()
            .map(|w| {
                total += w.max(0.0);
                total
            })
            .collect();
        (total > 0.0 && total.is_finite()).then_some(Self { sums })
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The item at `u` in [0, 1), and `u` rescaled to [0, 1) within the item. Probability: [`pdf`](Self::pdf).
    pub fn sample(&self, u: f32) -> (usize, f32) {
        let at = f64::from(u) * self.total();
        let i = self.sums.partition_point(|&s| s <= at).min(self.sums.len() - 1);
        let low = if i == 0 { 0.0 } else { self.sums[i - 1] };
        let width = self.sums[i] - low;
        let rest = if width > 0.0 { (at - low) / width } else { 0.0 };
        (i, (rest as f32).clamp(0.0, 1.0 - f32::EPSILON))
    }

    /// Probability of item `i`.
    pub fn pdf(&self, i: usize) -> f64 {
        let low = if i == 0 { 0.0 } else { self.sums[i - 1] };
        (self.sums[i] - low) / self.total()
    }
}
