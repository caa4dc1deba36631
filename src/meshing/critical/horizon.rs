//! Horizons: where the planes of flat emitters cut receivers. What lies behind gets nothing of them, and light bends
//! there.

use super::emitter::{Emitter, Hull, Shape, is_open};
use super::{CriticalLine, Order, Stage};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::FRAC_1_SQRT_2;

/// Light of an emitter grows from its horizon to about this share of the distance from it.
const REACH: f64 = 0.25;
/// Rays along an emitter's plane keep this share of its radius off it, so that what frames it isn't in their way.
const LIFT: f64 = 0.02;

/// The lines along which emitters sink below their own planes, of those that bring `least` [lx] or more close by.
pub fn horizons(stage: &Stage, emitters: &[Emitter], least: f64) -> Vec<CriticalLine> {
    let mut lines = Vec::new();
    for emitter in emitters {
        let Shape::Hull(hull) = &emitter.shape else { continue };
        let Some(normal) = hull.normal else { continue };
        let on = |number: u32| of_triangle(stage, emitter, hull, normal, number, least);
        lines.par_extend((0..stage.occluders.corners.len() as u32).into_par_iter().flat_map_iter(on));
    }
    lines
}

fn of_triangle(
    stage: &Stage,
    emitter: &Emitter,
    hull: &Hull,
    normal: DVec3,
    number: u32,
    least: f64,
) -> Vec<CriticalLine> {
    let corners = stage.occluders.corners[number as usize];
    let height = corners.map(|p| normal.dot(p - hull.points[0]));
    let crosses = height.iter().any(|h| *h > 0.0) && height.iter().any(|h| *h < 0.0);
    if !crosses {
        return Vec::new();
    }
    let cuts = [(0, 1), (1, 2), (2, 0)].into_iter().filter(|(i, j)| (height[*i] > 0.0) != (height[*j] > 0.0));
    let ends: Vec<DVec3> =
        cuts.map(|(i, j)| corners[i].lerp(corners[j], height[i] / (height[i] - height[j]))).collect();
    let &[from, to] = ends.as_slice() else { return Vec::new() };
    let (surface, triangle) = stage.tracer.place(number);
    let [a, b, c] = corners;
    let facing = (b - a).cross(c - a).normalize_or_zero();
    // A receiver nearly in the plane has its horizon everywhere.
    let is_shown = stage.scene.surfaces[surface].role.receives
        && from.distance(to) >= stage.params.length
        && facing.dot(normal).abs() < FRAC_1_SQRT_2
        && emitter.shines_on(stage.lights, surface as u32);
    if !is_shown {
        return Vec::new();
    }
    let light = |p: DVec3| {
        let (way, distance) = emitter.middle.way(p);
        let above = p + normal * (REACH * distance);
        (-way.dot(facing)).max(0.0) * emitter.illuminance(stage.scene, stage.lights, above)
    };
    let count = (from.distance(to) / (5.0 * stage.params.length)).ceil().clamp(3.0, 24.0) as usize;
    let place = |k: usize| from.lerp(to, (k as f64 + 0.5) / count as f64);
    let lift = normal * (LIFT * hull.radius);
    let shows: Vec<bool> = (0..count)
        .map(|k| light(place(k)) >= least && is_open(stage, emitter, place(k) + lift, facing, lift))
        .collect();
    let mut lines = Vec::new();
    let mut first = 0;
    for run in shows.chunk_by(|a, b| a == b) {
        let end = first + run.len();
        if run[0] {
            let ends = [first, end].map(|k| from.lerp(to, k as f64 / count as f64));
            let middle = place((first + end) / 2);
            lines.push(CriticalLine {
                surface: surface as u32,
                triangle: triangle as u32,
                ends,
                order: Order::Bend,
                contrast: light(middle),
                width: REACH * emitter.middle.way(middle).1,
            });
        }
        first = end;
    }
    lines
}
