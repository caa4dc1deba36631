//! Monte Carlo area sampling of a form factor (Wallace, Elmquist, Haines 1989): points on both elements, the kernel between
//! them, and a segment for visibility; doubled until the standard error is small enough.
//!
//! Form factors too small to matter are looked at once ([`glance`]), and only at times, in proportion to their size: what is then
//! seen counts for as much more (Russian roulette; Arvo, Kirk 1990). The mean stays the same.

use super::batches::error_of_mean;
use super::{Effort, Elements, FormFactor};
use crate::patch::Ground;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use std::f64::consts::PI;

/// The form factor from element `i` to `j`, which must not touch.
///
/// Symmetric: `A_i F_ij` comes out the same for (j, i) at the same tolerance, so a caller computes each pair once.
pub fn form_factor(elements: &Elements, ground: &Ground, i: usize, j: usize, effort: &Effort) -> FormFactor {
    let (low, high) = (i.min(j), i.max(j));
    let area = f64::from(elements.area[j]);
    let mut end = effort.first_samples.clamp(2, effort.most_samples.max(2));
    let mut values: Vec<f64> = Vec::with_capacity(end as usize);
    let (mut segments, mut drawn, mut blocked) = (Vec::new(), Vec::new(), Vec::new());
    let mut rays = 0;
    loop {
        segments.clear();
        drawn.clear();
        for index in values.len() as u32..end {
            values.push(0.0);
            let a = elements.point(ground, low, index);
            let b = elements.point(ground, high, index);
            let way = b.position - a.position;
            let square = f64::from(way.length_squared());
            let cos = f64::from(way.dot(a.normal)).max(0.0) * f64::from(-way.dot(b.normal)).max(0.0);
            if cos <= 0.0 {
                continue;
            }
            let kernel = area * cos / (PI * square * square);
            drawn.push((values.len() - 1, kernel));
            segments.push(Segment { from: a.position, to: b.position });
        }
        blocked.clear();
        blocked.resize(segments.len(), false);
        ground.tracer.occluded(&segments, &mut blocked);
        rays += segments.len() as u32;
        for (&(k, kernel), _) in drawn.iter().zip(&blocked).filter(|(_, blocked)| !**blocked) {
            values[k] = kernel;
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let error = error_of_mean(&values);
        // All samples at nought say that the pair doesn't see itself: as far as can be told, to the tolerance.
        let enough = if mean == 0.0 { end >= 2 * effort.first_samples } else { error <= effort.tolerance(mean) };
        if enough || end >= effort.most_samples {
            return FormFactor { value: mean, error, samples: rays };
        }
        end = values.len() as u32 * 2;
    }
}

/// The form factor from element `i` to `j`, which is at most `most`, by one sample: small enough for that
/// ([`Effort::is_small`]).
///
/// Symmetric: `A_i F_ij` is the same for (j, i).
pub fn glance(elements: &Elements, ground: &Ground, i: usize, j: usize, most: f32, effort: &Effort) -> FormFactor {
    let (low, high) = (i.min(j), i.max(j));
    let chance = Sequence::new(elements.seed, Stage::FormFactor, ((low as u64) << 28) | high as u64).hash(0);
    // Drawn before the points are looked up, which takes longer than all the rest.
    let area = f64::from(elements.area[j]);
    let threshold = effort.tolerance(0.0) * area / f64::from(elements.area[high]);
    let passing = threshold * f64::from(chance >> 16) / 65536.0;
    let nothing = |kernel: f64| FormFactor { value: 0.0, error: 0.5 * kernel, samples: 0 };
    if f64::from(most) <= passing {
        return nothing(f64::from(most));
    }
    let a = elements.kept_point(low, chance & 0xff);
    let b = elements.kept_point(high, (chance >> 8) & 0xff);
    let way = b.position - a.position;
    let square = f64::from(way.length_squared());
    let cos = f64::from(way.dot(a.normal)).max(0.0) * f64::from(-way.dot(b.normal)).max(0.0);
    let kernel = area * cos / (PI * square * square);
    if kernel <= passing {
        return nothing(kernel);
    }
    let mut blocked = [false];
    ground.tracer.occluded(&[Segment { from: a.position, to: b.position }], &mut blocked);
    let value = if blocked[0] { 0.0 } else { kernel.max(threshold) };
    FormFactor { value, error: 0.5 * value, samples: 1 }
}
