//! How far a whole run is, told from the stage that runs.

/// Stages of a bake in their order, and the share of the time that has passed where each begins: about, by the defaults on a living room.
/// Of the ways to find light, which exclude one another, each has the whole middle.
const COURSE: [(&str, f64); 19] = [
    ("load", 0.0),
    ("adapt", 0.01),
    ("unwrap", 0.02),
    ("rasterize", 0.05),
    ("unocclude", 0.06),
    ("direct", 0.10),
    ("caustics", 0.35),
    ("links", 0.40),
    ("path", 0.10),
    ("solve", 0.40),
    ("gather", 0.60),
    ("exchange", 0.86),
    ("probes", 0.90),
    ("denoise", 0.91),
    ("post", 0.94),
    ("verify", 0.95),
    ("vertices", 0.96),
    ("write", 0.98),
    ("", 1.0),
];

/// The share of a run that has passed where `stage` has done so much of its work; 0 of a stage that isn't known.
pub fn whole(stage: &str, done: u64, total: u64) -> f64 {
    let Some((_, begin)) = COURSE.iter().find(|(name, _)| *name == stage) else { return 0.0 };
    let end = COURSE.iter().map(|(_, begin)| *begin).filter(|next| next > begin).fold(1.0, f64::min);
    let share = if total > 0 { done.min(total) as f64 / total as f64 } else { 0.0 };
    begin + share * (end - begin)
}

#[cfg(test)]
mod tests {
    use super::whole;

    #[test]
    fn a_stage_ends_where_the_next_begins() {
        assert_eq!(whole("load", 0, 0), 0.0);
        assert!((whole("direct", 7, 7) - whole("caustics", 0, 7)).abs() < 1e-12);
        assert!((whole("write", 3, 6) - 0.99).abs() < 1e-12);
        assert_eq!(whole("write", 9, 6), 1.0);
        assert_eq!(whole("something else", 1, 1), 0.0);
    }
}
