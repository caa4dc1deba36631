//! How far a mean over quasi-random points may be off.
//!
//! The variance of single values says nothing of it: points that fill the domain evenly do better than chance by far. So the
//! points are dealt into consecutive batches, each an evenly spread set of its own; the batches' means differ by what such a
//! set leaves open. All points together do better still, so the estimate is on the safe side.

/// Batches; a power of two, so that each is evenly spread where their number of points is.
const BATCHES: usize = 8;

/// Few batches tell little of their own spread, and work ends where they happen to agree: 95 % lie within 1.96 of this many times
/// it (Student's t at seven degrees of freedom).
const STUDENT: f64 = 2.36 / 1.96;

/// The standard error of the mean of `values`, in the order they were drawn; at least two of them.
pub(super) fn error_of_mean(values: &[f64]) -> f64 {
    let batches = BATCHES.min(values.len());
    if batches < 2 {
        return f64::INFINITY;
    }
    let size = values.len() / batches;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let means: Vec<f64> = values.chunks_exact(size).take(batches).map(mean).collect();
    let whole = mean(&means);
    let squares: f64 = means.iter().map(|m| (m - whole).powi(2)).sum();
    let n = batches as f64;
    STUDENT * (squares / (n * (n - 1.0))).sqrt()
}
