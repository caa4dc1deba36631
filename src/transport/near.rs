//! The form factor between near or touching elements: the analytic one times the visibility that segments find.
//!
//! `F_ij = F_analytic * sum of g V / sum of g` over segments from points uniform on one element to points on the other, drawn
//! uniformly over the solid angle that its triangles cover, where `g = cos(theta) * solid angle / pi` has the kernel as its
//! mean. Nothing in it grows without bounds as the points meet, which the kernel over areas does. Where nothing blocks, there
//! is no noise at all; elsewhere only that of what is blocked (a ratio estimate: its bias falls as 1/n, below the noise).
//!
//! Elements that are buried in part have no analytic form factor of what is in the open, and where both have many polygons, as
//! on finely modelled curves, it would cost more than it saves; for them it is the mean of g V.
//!
//! Cost: that of [`analytic`](super::analytic), and half a microsecond and a segment for each sample.

use super::batches::error_of_mean;
use super::outline::Outline;
use super::{Effort, Elements, FormFactor, analytic};
use crate::patch::Ground;
use crate::sample::SphericalTriangle;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use glam::DVec3;
use std::f64::consts::PI;

/// Share of the tolerance that the quadrature may take.
const QUADRATURE: f32 = 0.1;

/// Pairs of polygons up to which the quadrature is worth it: 7 points a pair, about 0.2 ms in all.
const MOST_POLYGON_PAIRS: usize = 256;

/// True where this method is worth its time: no part is buried and polygons are few. With many, each sample costs as much as a
/// probe's ray for each of them.
pub fn is_quick(outlines: [&Outline; 2]) -> bool {
    outlines.iter().all(|o| o.whole) && outlines[0].polygons.len() * outlines[1].polygons.len() <= MOST_POLYGON_PAIRS
}

/// The form factor from element `i` to `j`, whose outlines are `outlines`; `samples` counts segments. `A_i F_ij` is the same for
/// (j, i) at the same tolerance.
pub fn form_factor(
    elements: &Elements,
    ground: &Ground,
    i: usize,
    j: usize,
    outlines: [&Outline; 2],
    effort: &Effort,
) -> FormFactor {
    let areas = [elements.area[i], elements.area[j]];
    let i_is_outer = (areas[0], i) <= (areas[1], j);
    let (outer, inner, polygons) = if i_is_outer { (i, j, outlines[1]) } else { (j, i, outlines[0]) };
    // The quadrature costs next to nothing beside the segments, so it takes little of what is allowed.
    let exact = Effort { relative_error: QUADRATURE * effort.relative_error, ..*effort };
    // Of what is seen of an element in front of things, its outline knows; what it lets through goes on.
    let stop = f64::from(elements.stop[inner]);
    let unoccluded = is_quick(outlines).then(|| analytic::form_factor(elements, i, j, outlines, &exact));
    if let Some(dark) = unoccluded.filter(|f| f.value <= 0.0) {
        return FormFactor { samples: 0, ..dark };
    }
    // From the outer element's form factor to the one asked for.
    let scale = f64::from(elements.area[outer]) / f64::from(areas[0]);
    let sequence = Sequence::new(elements.seed, Stage::FormFactor, ((outer as u64) << 28) | inner as u64);
    let mut end = effort.first_samples.clamp(2, effort.most_samples.max(2));
    let (mut kernels, mut visible): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let (mut drawn, mut segments, mut blocked) = (Vec::new(), Vec::new(), Vec::new());
    let mut rays = 0;
    loop {
        drawn.clear();
        segments.clear();
        for index in kernels.len() as u32..end {
            let from = elements.point(ground, outer, index);
            let [pick, u, v, _] = sequence.point(index, 0);
            let towards = towards(polygons, from.position.as_dvec3(), [pick, u, v].map(f64::from));
            let cos =
                |t: &Towards| (t.point - from.position.as_dvec3()).normalize_or_zero().dot(from.normal.as_dvec3());
            match towards.map(|t| (cos(&t), t)).filter(|(cos, _)| *cos > 0.0) {
                Some((cos, t)) => {
                    kernels.push(cos / (PI * t.pdf));
                    drawn.push(kernels.len() - 1);
                    let to = ground.tracer.off_surface(t.point.as_vec3(), t.normal.as_vec3());
                    segments.push(Segment { from: from.position, to });
                }
                None => kernels.push(0.0),
            }
        }
        visible.resize(kernels.len(), 0.0);
        blocked.clear();
        blocked.resize(segments.len(), false);
        ground.tracer.occluded(&segments, &mut blocked);
        rays += segments.len() as u32;
        for (&k, _) in drawn.iter().zip(&blocked).filter(|(_, blocked)| !**blocked) {
            visible[k] = kernels[k];
        }
        let n = kernels.len() as f64;
        let (all, seen) = (kernels.iter().sum::<f64>() / n, visible.iter().sum::<f64>() / n);
        let (value, error) = match unoccluded {
            Some(unoccluded) if all > 0.0 => {
                let ratio = seen / all;
                let residuals: Vec<f64> = kernels.iter().zip(&visible).map(|(g, gv)| gv - ratio * g).collect();
                let noise = error_of_mean(&residuals) * unoccluded.value / all;
                // The quadrature's error is a bound: anywhere within it, it has a third of its square for a variance.
                (ratio * unoccluded.value, noise.hypot(ratio * unoccluded.error / 3f64.sqrt()))
            }
            _ => (seen * scale * stop, error_of_mean(&visible) * scale * stop),
        };
        // Nothing seen says that the pair doesn't see itself: as far as can be told, to the tolerance.
        let enough =
            if seen == 0.0 { n >= 2.0 * f64::from(effort.first_samples) } else { error <= effort.tolerance(value) };
        if enough || end >= effort.most_samples {
            return FormFactor { value, error, samples: rays };
        }
        end = kernels.len() as u32 * 2;
    }
}

/// A point drawn on an outline.
#[derive(Clone, Copy, Debug)]
pub struct Towards {
    /// World position [m].
    pub point: DVec3,
    /// Of the surface there, unit.
    pub normal: DVec3,
    /// Density over the solid angle [1/sr].
    pub pdf: f64,
}

/// A point of `outline` as seen from `from`, uniform over the solid angle of all of its triangles whose fronts are seen. `u`
/// chooses one of them, then the direction. None where none is seen.
pub fn towards(outline: &Outline, from: DVec3, [pick, u, v]: [f64; 3]) -> Option<Towards> {
    let seen = || triangles(outline, from);
    let total: f64 = seen().map(|(_, t)| t.solid_angle).sum();
    let mut at = pick * total;
    let mut chosen = None;
    for (k, triangle) in seen() {
        chosen = Some((k, triangle));
        if at < triangle.solid_angle {
            break;
        }
        at -= triangle.solid_angle;
    }
    let (k, triangle) = chosen?;
    let polygon = &outline.polygons[k];
    let direction = triangle.sample([u, v]);
    let t = -polygon.height(from) / direction.dot(polygon.normal);
    (t > 0.0 && t.is_finite()).then(|| Towards {
        point: from + direction * t,
        normal: polygon.normal,
        pdf: total.recip(),
    })
}

/// Density [1/sr] of [`towards`] in the unit direction `d`.
pub fn towards_pdf(outline: &Outline, from: DVec3, d: DVec3) -> f64 {
    let (sum, total) = triangles(outline, from)
        .fold((0.0, 0.0), |(sum, total), (_, t)| (sum + t.pdf(d) * t.solid_angle, total + t.solid_angle));
    if total > 0.0 { sum / total } else { 0.0 }
}

/// The triangles of `outline` whose fronts `from` sees, with the polygon that each is part of.
fn triangles(outline: &Outline, from: DVec3) -> impl Iterator<Item = (usize, SphericalTriangle)> + '_ {
    let front = move |(_, p): &(usize, &super::outline::Polygon)| p.height(from) > 1e-9 * p.radius;
    outline.polygons.iter().enumerate().filter(front).flat_map(move |(k, p)| {
        let relative = move |t: [DVec3; 3]| SphericalTriangle::new(t.map(|c| c - from)).map(|t| (k, t));
        p.triangles().filter_map(relative)
    })
}
