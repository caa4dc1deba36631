//! Shadow rays from surfaces that are shown rounder than they are.
//!
//! Interpolated normals make a coarse mesh look round, but its facets still turn their backs on the light all at once, and hide it
//! from each other: shadows end in facets. So where light is shown about interpolated normals, shadow rays start from the
//! surface that those normals belong to, [`SurfacePoint::rounded`] (Hanika 2021, "Hacking the Shadow Terminator", Ray
//! Tracing Gems II, chapter 4), and light comes from wherever that surface faces, whichever way the facet does.
//! Concave parts stay where they are, and flat ones: only what the mesh cuts off a round body is put back.

use super::emitter::Sight;
use crate::patch::SurfacePoint;
use crate::trace::{Segment, Tracer};
use glam::Vec3;

/// Rises of less than this many offsets of ray origins pass through nothing.
const LOW: f32 = 4.0;

impl Sight<'_> {
    /// A point as light is shown on it: flat where that is about geometric normals.
    pub(super) fn as_shown(&self, point: &SurfacePoint) -> SurfacePoint {
        if self.params.shading_normals { *point } else { point.flat() }
    }
}

/// Where shadow rays from `point` start: off the rounded surface, unless something stands between it and the triangle, which would let
/// light in from behind.
pub fn origin(tracer: &Tracer, point: &SurfacePoint) -> Vec3 {
    let from = tracer.off_surface(point.position, point.normal);
    if point.rounded == point.position {
        return from;
    }
    let to = tracer.off_surface(point.rounded, point.normal);
    if from.distance_squared(to) < (LOW * tracer.offset()).powi(2) {
        return to;
    }
    let mut blocked = [false];
    tracer.occluded(&[Segment { from, to }], &mut blocked);
    if blocked[0] { from } else { to }
}
