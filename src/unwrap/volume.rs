//! Density volumes: boxes and spheres in which surfaces get finer or coarser texels.
//!
//! A chart has one density. Of a volume that reaches only part of it, it gets as many texels as if the density varied within it: its
//! factor is the root of the mean square over its area, F² = 1/A ∫ f(x)² dA. So what lies within a volume is never coarser than its
//! share of the texels, and no texel is spent twice.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Points on a triangle's side, at most.
const MOST_POINTS: u32 = 32;

/// A box or a sphere with a factor on the density, `[[density-volumes]]` in `lumel.toml`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct DensityVolume {
    /// Its middle [m], in the scene's space as it is loaded: Y up, right-handed.
    pub center: [f32; 3],
    /// A sphere's radius [m], 0 or more.
    pub radius: Option<f32>,
    /// A box's sides along the axes [m], each 0 or more.
    pub size: Option<[f32; 3]>,
    /// Factor on the density within [0.001..1000]; volumes that overlap multiply.
    pub factor: f32,
    /// Distance from the volume over which the factor goes smoothly to 1 [m], 0 or more; 0: it ends at the volume.
    #[serde(default)]
    pub falloff: f32,
}

impl DensityVolume {
    /// What is wrong with it, where something is.
    pub fn fault(&self) -> Option<String> {
        let lengths = self.size.iter().flatten().chain(&self.radius).chain([&self.falloff]);
        let is_length = |v: &f32| v.is_finite() && *v >= 0.0;
        if self.radius.is_some() == self.size.is_some() {
            return Some("needs either radius (a sphere) or size (a box) [m]".into());
        }
        if !self.center.iter().all(|v| v.is_finite()) || !lengths.into_iter().all(is_length) {
            return Some("center, radius, size and falloff must be finite, lengths 0 or more [m]".into());
        }
        let [low, high] = crate::scene::role::DENSITY_SCALES;
        let fault = format!("factor {} is out of range; allowed are {low} to {high}", self.factor);
        (!(low..=high).contains(&self.factor)).then_some(fault)
    }

    /// The factor at a point [m].
    pub fn at(&self, point: Vec3) -> f64 {
        let from = point - Vec3::from(self.center);
        let distance = match self.size {
            Some(size) => (from.abs() - 0.5 * Vec3::from(size)).max(Vec3::ZERO).length(),
            None => (from.length() - self.radius.unwrap_or(0.0)).max(0.0),
        };
        let share = if self.falloff > 0.0 { (distance / self.falloff).min(1.0) } else { f32::from(distance > 0.0) };
        // Smoothstep over the logarithm: factors 4 and 1/4 fall off alike.
        let weight = f64::from(1.0 - share * share * (3.0 - 2.0 * share));
        f64::from(self.factor).powf(weight)
    }

    /// Lengths [m] over which the factor varies.
    fn grain(&self) -> f32 {
        let inner = self.size.map_or(self.radius.unwrap_or(0.0), |s| Vec3::from(s).min_element());
        inner.max(self.falloff)
    }
}

/// The mean over a triangle's area of the square of what all `volumes` make of the density, by points at most a sixteenth of the
/// smallest volume apart, [`MOST_POINTS`] a side at most.
pub fn mean_square(volumes: &[DensityVolume], [a, b, c]: [Vec3; 3]) -> f64 {
    let grain = volumes.iter().map(DensityVolume::grain).fold(f32::INFINITY, f32::min);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let n = ((16.0 * longest / grain).ceil().max(1.0) as u32).min(MOST_POINTS);
    let mut sum = 0.0;
    let mut add = |i: f32, j: f32| {
        let point = a + (b - a) * (i / n as f32) + (c - a) * (j / n as f32);
        let factor: f64 = volumes.iter().map(|v| v.at(point)).product();
        sum += factor * factor;
    };
    // The middles of n² equal triangles: upright ones and, between them, turned ones.
    for i in 0..n {
        for j in 0..n - i {
            add(i as f32 + 1.0 / 3.0, j as f32 + 1.0 / 3.0);
            if i + j + 1 < n {
                add(i as f32 + 2.0 / 3.0, j as f32 + 2.0 / 3.0);
            }
        }
    }
    sum / f64::from(n * n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere() -> DensityVolume {
        DensityVolume { radius: Some(1.0), factor: 4.0, falloff: 2.0, ..DensityVolume::default() }
    }

    #[test]
    fn the_factor_falls_smoothly_to_one() {
        let at = |x: f32| sphere().at(Vec3::new(x, 0.0, 0.0));
        assert_eq!([at(0.0), at(1.0), at(3.0), at(9.0)], [4.0, 4.0, 1.0, 1.0]);
        // Half way: the root.
        assert!((at(2.0) - 2.0).abs() < 1e-6);
        let sharp = DensityVolume { size: Some([2.0, 2.0, 2.0]), radius: None, falloff: 0.0, ..sphere() };
        assert_eq!([sharp.at(Vec3::splat(0.99)), sharp.at(Vec3::new(0.0, 1.01, 0.0))], [4.0, 1.0]);
    }

    #[test]
    fn a_triangle_gets_the_mean_square_over_its_area() {
        // A box over half of a triangle's area: x below 1 - 1/sqrt 2 in the unit triangle.
        let x = 1.0 - 0.5f32.sqrt();
        let half = DensityVolume {
            center: [x - 1.0, 0.0, 0.0],
            size: Some([2.0, 4.0, 4.0]),
            factor: 3.0,
            ..DensityVolume::default()
        };
        let found = mean_square(&[half], [Vec3::ZERO, Vec3::X, Vec3::Y]);
        assert!((found - 5.0).abs() < 0.2, "{found}");
        assert_eq!(mean_square(&[sphere()], [Vec3::ZERO, 0.1 * Vec3::X, 0.1 * Vec3::Y]), 16.0);
    }

    #[test]
    fn wrong_volumes_say_what_is_wrong() {
        assert_eq!(sphere().fault(), None);
        assert!(DensityVolume { radius: None, ..sphere() }.fault().unwrap().contains("radius"));
        assert!(DensityVolume { size: Some([1.0; 3]), ..sphere() }.fault().unwrap().contains("either"));
        assert!(DensityVolume { factor: 0.0, ..sphere() }.fault().unwrap().contains("factor"));
        assert!(DensityVolume { falloff: -1.0, ..sphere() }.fault().unwrap().contains("falloff"));
    }
}
