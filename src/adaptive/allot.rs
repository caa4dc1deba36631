//! Texels dealt out to charts so that the error over all of them is least.
//!
//! The mean square of what is missed in chart c falls with the factor f on its density as e_c / f + s_c / f⁴: along sharp edges of
//! shadows, and where light is smooth and read bilinearly. How much of it is which follows from what squares of two and of four
//! texels miss. Of sum A_c (e_c / f_c + s_c / f_c⁴) at a fixed number of texels, sum n_c f_c², the least has
//! e_c f_c^-3 + 4 s_c f_c^-6 = lambda (Lagrange), a quadratic equation in f_c^-3, with lambda such that the texels add up.
//!
//! Texels of another size than the others' (by roles, volumes, or as the chart is of the least size) are taken to be wanted so: e_c and
//! s_c are what would be missed at the size that texels have on average, and factors come on top.

use super::detail::Details;

/// Factors go this far, either way: 6 took 1 % more of the error of a living room than 3 did.
const MOST: f64 = 4.0;

/// Texels for which a chart is taken to be like all others together, on top of its own.
const PRIOR_TEXELS: f64 = 16.0;

/// Of the light's mean, what is missed everywhere that the quick bake can't tell from nothing; and the share of what is missed on
/// average.
const LEAST_MISSED: f64 = 0.003;
const LEAST_SHARE: f64 = 0.03;

/// What is missed of a chart's light by coarser texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Need {
    pub mesh: usize,
    /// The chart of the mesh; none: all of them have one factor.
    pub chart: Option<u32>,
    /// Area [m^2] and texels, of all instances.
    pub area: f64,
    pub texels: f64,
    /// Squares of what is missed by squares of two and of four texels a side, times area [lx^2 m^2].
    pub missed: [f64; 2],
}

impl Need {
    /// That of a chart of which nothing is known yet.
    pub fn none(mesh: usize, chart: Option<u32>) -> Self {
        Self { mesh, chart, area: 0.0, texels: 0.0, missed: [0.0; 2] }
    }
}

/// How texels were dealt out.
#[derive(Clone, Debug, PartialEq)]
pub struct Allotted {
    /// Factors on the density, by need.
    pub factors: Vec<f64>,
    /// What is missed with all factors 1, and with these: root mean square over the mean light.
    pub even_error: f64,
    pub error: f64,
}

/// The error of a chart over the factor f on its density: `edge` / f + `smooth` / f^4 [lx^2].
#[derive(Clone, Copy, Debug)]
struct Model {
    edge: f64,
    smooth: f64,
}

/// The factors at which least is missed, where the texels that `found` is about are `coarser` times as dense as those to be dealt out.
pub fn allot(found: &Details, coarser: f64) -> Allotted {
    let needs = &found.needs;
    let (area, texels) = needs.iter().fold((0.0, 0.0), |(a, t), n| (a + n.area, t + n.texels));
    if !(area > 0.0 && texels > 0.0 && found.mean > 0.0) {
        return Allotted { factors: vec![1.0; needs.len()], even_error: 0.0, error: 0.0 };
    }
    let average = [0, 1].map(|level| needs.iter().map(|n| n.missed[level]).sum::<f64>().max(0.0) / area);
    let models: Vec<Model> = needs.iter().map(|n| model(n, average, texels / area, coarser, found.mean)).collect();
    let factors_at = |lambda: f64| -> Vec<f64> { models.iter().map(|m| m.factor(lambda)).collect() };
    let spent = |factors: &[f64]| needs.iter().zip(factors).map(|(n, f)| n.texels * f * f).sum::<f64>();
    let steepest = models.iter().map(|m| m.edge + 4.0 * m.smooth).fold(0.0, f64::max);
    let (mut low, mut high) = ((1e-30 * steepest).ln(), (1e6 * steepest).ln());
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if spent(&factors_at(middle.exp())) > texels { low = middle } else { high = middle }
    }
    let factors = factors_at((0.5 * (low + high)).exp());
    let error = |factor: &dyn Fn(usize) -> f64| {
        let missed = |(k, (n, m)): (usize, (&Need, &Model))| n.area * m.missed(factor(k));
        (needs.iter().zip(&models).enumerate().map(missed).sum::<f64>() / area).sqrt() / found.mean
    };
    Allotted { even_error: error(&|_| 1.0), error: error(&|k| factors[k]), factors }
}

/// What a chart misses, by what is known of it and, as far as that is little, of all charts: `average` [lx^2], with `density` texels
/// per square metre.
fn model(need: &Need, average: [f64; 2], density: f64, coarser: f64, mean: f64) -> Model {
    let own = need.texels / (need.texels + PRIOR_TEXELS);
    let known = |level: usize| {
        let missed = if need.area > 0.0 { (need.missed[level] / need.area).max(0.0) } else { 0.0 };
        own * missed + (1.0 - own) * average[level]
    };
    let least = LEAST_SHARE * average[0] + (LEAST_MISSED * mean).powi(2);
    let [two, four] = [known(0) + least, known(1) + least * 4.0];
    // From texels of twice the quick bake's side, or of another side by role, to those of the bake.
    let side = if need.area > 0.0 { (need.texels / need.area / density).sqrt() } else { 1.0 };
    let side = coarser * side;
    // What is e side + s side⁴ of squares whose sides are two and four; of edges, or of smooth light alone where one would be negative.
    let (edge, smooth) = ((16.0 * two - four) / 28.0, (four - 2.0 * two) / 224.0);
    let (edge, smooth) = match (edge > 0.0, smooth > 0.0) {
        (true, true) => (edge, smooth),
        (true, false) => (two / 2.0, 0.0),
        (false, _) => (0.0, two / 16.0),
    };
    Model { edge: edge * side, smooth: smooth * side.powi(4) }
}

impl Model {
    /// [lx^2].
    fn missed(&self, factor: f64) -> f64 {
        self.edge / factor + self.smooth / factor.powi(4)
    }

    /// Where edge f^-3 + 4 smooth f^-6 = `lambda`, in the form that loses no digits where `smooth` is next to nothing.
    fn factor(&self, lambda: f64) -> f64 {
        let y = 2.0 * lambda / (self.edge + (self.edge.powi(2) + 16.0 * self.smooth * lambda).sqrt());
        y.cbrt().recip().clamp(MOST.recip(), MOST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn need(area: f64, two: f64, four: f64) -> Need {
        Need { area, texels: 1e4 * area, missed: [two * area, four * area], ..Need::none(0, Some(0)) }
    }

    fn spent(needs: &[Need], factors: &[f64]) -> f64 {
        needs.iter().zip(factors).map(|(n, f)| n.texels * f * f).sum()
    }

    #[test]
    fn equal_needs_get_equal_texels() {
        let needs = vec![need(1.0, 0.01, 0.02), need(5.0, 0.01, 0.02), need(2.0, 0.01, 0.02)];
        let found = allot(&Details { needs, mean: 1.0 }, 1.0);
        assert!(found.factors.iter().all(|f| (f - 1.0).abs() < 1e-6), "{:?}", found.factors);
        assert!((found.error / found.even_error - 1.0).abs() < 1e-6);
    }

    #[test]
    fn no_other_split_of_the_texels_misses_less() {
        // Edges of which one is eight times the other: densities of 2 to 1.
        let needs = vec![need(1.0, 0.08, 0.16), need(1.0, 0.01, 0.02)];
        let found = allot(&Details { needs: needs.clone(), mean: 1.0 }, 1.0);
        let texels = spent(&needs, &[1.0; 2]);
        assert!((spent(&needs, &found.factors) / texels - 1.0).abs() < 1e-6);
        let ratio = found.factors[0] / found.factors[1];
        assert!((1.8..2.0).contains(&ratio), "{ratio}");
        assert!(found.error < 0.98 * found.even_error, "{found:?}");
    }

    #[test]
    fn moving_texels_between_any_two_charts_misses_more() {
        // Edges, smooth light, both.
        let needs = vec![need(1.0, 0.02, 0.04), need(3.0, 0.01, 0.16), need(2.0, 0.02, 0.1), need(0.5, 0.001, 0.002)];
        let details = Details { needs: needs.clone(), mean: 1.0 };
        let average = [0, 1].map(|level| needs.iter().map(|n| n.missed[level]).sum::<f64>() / 6.5);
        let models: Vec<Model> = needs.iter().map(|n| model(n, average, 1e4, 1.0, 1.0)).collect();
        let total = |factors: &[f64]| -> f64 {
            needs.iter().zip(&models).zip(factors).map(|((n, m), f)| n.area * m.missed(*f)).sum()
        };
        let found = allot(&details, 1.0).factors;
        assert!(found.iter().all(|f| (1.01 / MOST..0.99 * MOST).contains(f)), "{found:?}");
        for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            for by in [-0.02, 0.02] {
                let mut moved = found.clone();
                moved[a] *= 1.0 + by;
                let left = spent(&needs, &found) - spent(&needs, &moved);
                moved[b] = (moved[b].powi(2) + left / needs[b].texels).sqrt();
                assert!((spent(&needs, &moved) / spent(&needs, &found) - 1.0).abs() < 1e-9);
                assert!(total(&moved) > total(&found), "{a} {b} {by}");
            }
        }
    }

    #[test]
    fn dark_scenes_and_flat_light_stay_even() {
        let dark = allot(&Details { needs: vec![need(1.0, 0.0, 0.0); 3], mean: 0.0 }, 1.0);
        assert_eq!(dark.factors, [1.0; 3]);
        let needs = vec![need(1.0, 1e-9, 0.0), need(1.0, 0.0, 1e-9), need(0.0, 0.0, 0.0), need(1.0, -1e-9, 0.0)];
        let flat = allot(&Details { needs, mean: 1.0 }, 1.0);
        assert!(flat.factors.iter().all(|f| (f - 1.0).abs() < 1e-3), "{:?}", flat.factors);
    }
}
