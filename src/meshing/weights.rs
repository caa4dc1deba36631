//! Places in a triangle, by weights of its corners.

use glam::{DVec3, Vec3};

/// A place in a triangle: weights of its corners, each in 0..=1, that add up to 1 within rounding.
///
/// A corner's weights are exactly 1 and 0, and a place on an edge weighs the corner opposite with exactly 0. Triangles that share
/// an edge have the same two numbers at each place of it, so that whatever they blend by [`Weights::terms`] is the same to the bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights(pub DVec3);

impl Weights {
    /// The corners of a triangle, in order.
    pub const CORNERS: [Self; 3] = [Self(DVec3::X), Self(DVec3::Y), Self(DVec3::Z)];

    /// The place the part `t` of the way from `self` to `other`.
    pub fn lerp(self, other: Self, t: f64) -> Self {
        Self(self.0 * (1.0 - t) + other.0 * t)
    }

    /// The corner that this is, where it is one.
    pub fn corner(self) -> Option<usize> {
        self.0.to_array().iter().position(|w| *w == 1.0)
    }

    /// The corners (0 to 2) that count, and their weights, in an order that depends on nothing but where they are: by the bits of
    /// `positions`, those of the triangle's corners. 1 to 3 terms.
    pub fn terms(self, positions: [Vec3; 3]) -> impl Iterator<Item = (usize, f64)> {
        let mut order = [0, 1, 2];
        order.sort_by_key(|k: &usize| (positions[*k] + 0.0).to_array().map(f32::to_bits));
        order.into_iter().map(move |k| (k, self.0[k])).filter(|(_, w)| *w != 0.0)
    }
}
