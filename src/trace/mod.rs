//! Rays and visibility over the triangles of all surfaces.
//!
//! Queries come in batches, so that packets, SIMD and other devices fit behind the same calls.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod path;
mod sheet;
#[cfg(test)]
mod tests;
mod tracer;
mod traverse;
mod watertight;
mod wide;

use glam::Vec3;

pub use tracer::{Tracer, Triangles};

/// A half line; `direction` is unit, so `t` is in metres.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

/// The nearest triangle along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance [m].
    pub t: f32,
    /// Number of the triangle over all surfaces ([`Tracer::place`] tells which it is).
    pub triangle: u32,
    /// Weights of the triangle's corners 1 and 2, in the mesh's order of corners.
    pub barycentric: [f32; 2],
    /// The triangle's back was hit.
    pub back: bool,
}

/// A stretch between two points, tested for anything in between.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    pub from: Vec3,
    pub to: Vec3,
}
