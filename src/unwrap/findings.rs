//! What authored UVs are like that aren't used as they stand, for the report.

use super::overlap::{Cells, bounds, centers};
use crate::scene::Scene;
use glam::{DVec2, Vec2};
use serde::Serialize;

/// Samples along a side of the overlap measure.
const SAMPLES: usize = 2048;

/// What became of a mesh's authored UVs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// New ones were made.
    Refused,
    /// Its charts were packed anew.
    Repacked,
}

/// Authored UVs that aren't used as they stand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AuthoredUvs {
    /// The first surface that has the mesh.
    pub surface: String,
    /// Name of the UV set.
    pub set: String,
    pub verdict: Verdict,
    /// Why they were refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Share of the area of the UVs that lies on top of other triangles, by 2048 x 2048 samples over their bounds [0..1].
    pub overlap: f64,
    /// Least and greatest coordinates.
    pub range: [[f64; 2]; 2],
    /// Texels per metre of the 95th percentile of the area, over those of the 5th: 1 where all have the same, 0 where a twentieth
    /// or more has no texels at all.
    pub density_spread: f64,
}

impl AuthoredUvs {
    /// Measures the UVs `coords` (one a vertex) of `surface`. Triangles whose coordinates aren't finite are left out.
    pub fn measure(scene: &Scene, surface: usize, set: &str, coords: &[Vec2], verdict: Verdict) -> Self {
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        let (mut uv, mut densities) = (Vec::new(), Vec::new());
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let corners = corners.map(|v| coords[v as usize].as_dvec2());
            if !corners.iter().all(|p| p.is_finite()) {
                continue;
            }
            let [a, b, c] = scene.world_triangle(surface, t).map(|p| p.as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            if area > 0.0 {
                densities.push(((super::chart::signed_area(corners).abs() / area).sqrt(), area));
            }
            uv.push(corners);
        }
        let (low, high) = if uv.is_empty() { (DVec2::ZERO, DVec2::ZERO) } else { bounds(&uv) };
        Self {
            surface: scene.surfaces[surface].name.clone(),
            set: set.to_owned(),
            verdict,
            reason: None,
            overlap: overlap(&uv, low, high),
            range: [low.to_array(), high.to_array()],
            density_spread: spread(densities),
        }
    }

    /// In a few words, for a warning.
    pub fn summary(&self) -> String {
        let [low, high] = self.range;
        format!(
            "{:.1} % overlap, range {:.3} {:.3} to {:.3} {:.3}, density spread {:.2}",
            100.0 * self.overlap,
            low[0],
            low[1],
            high[0],
            high[1],
            self.density_spread
        )
    }
}

/// Share of the samples within triangles that lie in more than one.
fn overlap(uv: &[[DVec2; 3]], low: DVec2, high: DVec2) -> f64 {
    let scale = DVec2::splat(SAMPLES as f64) / (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let (mut taken, mut doubled, mut covered) = (Cells::new(SAMPLES), 0, 0);
    for t in uv {
        centers(t.map(|p| (p - low) * scale), SAMPLES, SAMPLES, |row, first, end| {
            doubled += end - first - taken.take(row, first, end);
            covered += end - first;
        });
    }
    if covered > 0 { doubled as f64 / covered as f64 } else { 0.0 }
}

/// The 95th percentile over the 5th, by area; 0 where the latter is 0.
fn spread(mut densities: Vec<(f64, f64)>) -> f64 {
    densities.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = densities.iter().map(|d| d.1).sum();
    let percentile = |share: f64| {
        let mut sum = 0.0;
        let at = densities.iter().find(|d| {
            sum += d.1;
            sum >= share * total
        });
        at.map_or(0.0, |d| d.0)
    };
    let low = percentile(0.05);
    if low > 0.0 { percentile(0.95) / low } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_by_area() {
        // A tenth at half the density, the rest at one; the last hundredth, far denser, is beyond the percentile.
        assert_eq!(spread(vec![(1.0, 0.89), (0.5, 0.1), (100.0, 0.01)]), 2.0);
        assert_eq!(spread(vec![(0.0, 0.5), (1.0, 0.5)]), 0.0);
        assert_eq!(spread(Vec::new()), 0.0);
    }

    #[test]
    fn overlap_is_the_share_that_lies_on_others() {
        let lower = [DVec2::ZERO, DVec2::X, DVec2::ONE];
        let upper = [DVec2::ZERO, DVec2::ONE, DVec2::Y];
        assert_eq!(overlap(&[lower, upper], DVec2::ZERO, DVec2::ONE), 0.0);
        assert!((overlap(&[lower, upper, lower], DVec2::ZERO, DVec2::ONE) - 1.0 / 3.0).abs() < 1e-3);
    }
}
