//! Monte Carlo area sampling of a form factor (Wallace, Elmquist, Haines 1989): points on both elements, the kernel between
//! them, and a segment for visibility; doubled until the standard error is small enough.

use super::{Effort, Elements, FormFactor};
use crate::patch::Ground;
use crate::trace::Segment;
use std::f64::consts::PI;

/// The form factor from element `i` to `j`, which must not touch.
///
/// Symmetric: `A_i F_ij` comes out the same for (j, i), so a caller computes each pair once.
pub fn form_factor(elements: &Elements, ground: &Ground, i: usize, j: usize, effort: &Effort) -> FormFactor {
    let (low, high) = (i.min(j), i.max(j));
    let area = f64::from(elements.area[j]);
    let (mut sum, mut squares) = (0.0f64, 0.0f64);
    let mut taken = 0u32;
    let mut end = effort.first_samples.clamp(2, effort.most_samples.max(2));
    let (mut segments, mut kernels, mut blocked) = (Vec::new(), Vec::new(), Vec::new());
    let mut rays = 0;
    loop {
        segments.clear();
        kernels.clear();
        for index in taken..end {
            let a = elements.point(ground, low, index);
            let b = elements.point(ground, high, index);
            let way = b.position - a.position;
            let square = f64::from(way.length_squared());
            let cos = f64::from(way.dot(a.normal)).max(0.0) * f64::from(-way.dot(b.normal)).max(0.0);
            if cos > 0.0 {
                kernels.push(area * cos / (PI * square * square));
                segments.push(Segment { from: a.position, to: b.position });
            }
        }
        blocked.clear();
        blocked.resize(segments.len(), false);
        ground.tracer.occluded(&segments, &mut blocked);
        rays += segments.len() as u32;
        for (kernel, _) in kernels.iter().zip(&blocked).filter(|(_, blocked)| !**blocked) {
            sum += kernel;
            squares += kernel * kernel;
        }
        taken = end;
        let n = f64::from(taken);
        let mean = sum / n;
        let error = ((squares / n - mean * mean).max(0.0) / (n - 1.0)).sqrt();
        // All samples at nought say that the pair doesn't see itself: as far as can be told, to the tolerance.
        let enough = if sum == 0.0 { taken >= 2 * effort.first_samples } else { error <= effort.tolerance(mean) };
        if enough || taken >= effort.most_samples {
            return FormFactor { value: mean, error, samples: rays };
        }
        end = taken * 2;
    }
}
