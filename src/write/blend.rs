//! Vertices of meshes that were cut: a vertex is one of the source's, or a blend of those at the corners of a triangle.
//!
//! Blends are summed in f64 in the order of [`Weights::terms`] and rounded once, so that triangles on both sides of an edge have
//! the same bits at each place of it.

use crate::meshing::Weights;
use glam::{Vec2, Vec3, Vec4};

/// One to three vertices of the source, and what each weighs; those beyond the last term weigh 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend {
    vertices: [u32; 3],
    weights: [f64; 3],
}

impl Blend {
    /// Vertex `vertex` as it is.
    pub fn vertex(vertex: u32) -> Self {
        Self { vertices: [vertex; 3], weights: [1.0, 0.0, 0.0] }
    }

    /// The place `place` of a triangle with vertices `corners` at `positions`.
    pub fn at(place: Weights, corners: [u32; 3], positions: [Vec3; 3]) -> Self {
        if let Some(corner) = place.corner() {
            return Self::vertex(corners[corner]);
        }
        let mut blend = Self { vertices: [0; 3], weights: [0.0; 3] };
        for (slot, (k, weight)) in place.terms(positions).enumerate() {
            (blend.vertices[slot], blend.weights[slot]) = (corners[k], weight);
        }
        blend
    }

    /// The vertex that this is, where it is one.
    pub fn as_vertex(&self) -> Option<u32> {
        (self.weights[0] == 1.0).then_some(self.vertices[0])
    }

    /// The vertices and their weights.
    pub fn terms(&self) -> impl Iterator<Item = (u32, f64)> {
        self.vertices.into_iter().zip(self.weights).filter(|(_, weight)| *weight != 0.0)
    }

    /// The vertex that weighs most; of equals the first.
    pub fn strongest(&self) -> u32 {
        let stronger = |best: usize, k: usize| if self.weights[k] > self.weights[best] { k } else { best };
        self.vertices[(1..3).fold(0, stronger)]
    }

    /// What tells blends apart: the same for both triangles at an edge.
    pub fn key(&self) -> ([u32; 3], [u64; 3]) {
        (self.vertices, self.weights.map(f64::to_bits))
    }

    /// The weighted sum of values of the vertices.
    pub fn sum<const N: usize>(&self, value: impl Fn(u32) -> [f64; N]) -> [f64; N] {
        let mut sum = [0.0; N];
        for (vertex, weight) in self.terms() {
            sum.iter_mut().zip(value(vertex)).for_each(|(sum, v)| *sum += v * weight);
        }
        sum
    }

    /// The blend of `values`, one a vertex; a vertex's own as it is.
    fn of<const N: usize>(&self, value: impl Fn(u32) -> [f32; N]) -> [f32; N] {
        match self.as_vertex() {
            Some(vertex) => value(vertex),
            None => self.sum(|v| value(v).map(f64::from)).map(|v| v as f32),
        }
    }

    /// The blend of `points`, one a vertex.
    pub fn point(&self, points: &[Vec3]) -> Vec3 {
        Vec3::from_array(self.of(|v| points[v as usize].to_array()))
    }

    /// The blend of unit vectors, one a vertex, as a unit vector; that of the strongest vertex where they cancel.
    pub fn direction(&self, directions: &[Vec3]) -> Vec3 {
        if let Some(vertex) = self.as_vertex() {
            return directions[vertex as usize];
        }
        let sum = glam::DVec3::from_array(self.sum(|v| directions[v as usize].to_array().map(f64::from)));
        sum.try_normalize().map_or(directions[self.strongest() as usize], |n| n.as_vec3())
    }

    /// The blend of texture coordinates, one pair a vertex.
    pub fn coords(&self, coords: &[Vec2]) -> Vec2 {
        Vec2::from_array(self.of(|v| coords[v as usize].to_array()))
    }

    /// The blend of colours, one a vertex.
    pub fn color(&self, colors: &[Vec4]) -> Vec4 {
        Vec4::from_array(self.of(|v| colors[v as usize].to_array()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_has_the_same_bits_from_both_sides() {
        let points = [[0.1, 0.7, 0.3], [5.3, 0.2, -7.7], [2.0, 9.1, 0.4], [-3.0, 1.0, 1.1]].map(Vec3::from_array);
        let at = |triangle: [u32; 3], place: [f64; 3]| {
            let positions = triangle.map(|v| points[v as usize]);
            Blend::at(Weights(place.into()), triangle, positions)
        };
        for t in [0.3, 0.5, 0.123_456_789] {
            let (left, right) = (at([0, 1, 2], [1.0 - t, t, 0.0]), at([3, 1, 0], [0.0, t, 1.0 - t]));
            assert_eq!(left.key(), right.key());
            let [left, right] = [left, right].map(|blend| blend.point(&points).to_array().map(f32::to_bits));
            assert_eq!(left, right);
        }
    }

    #[test]
    fn corners_are_vertices_and_directions_stay_unit() {
        let points = [Vec3::X, Vec3::Y, -Vec3::X];
        assert_eq!(Blend::at(Weights::CORNERS[1], [4, 5, 6], points).as_vertex(), Some(5));
        let half = Blend::at(Weights([0.5, 0.5, 0.0].into()), [0, 1, 2], points);
        assert_eq!(half.as_vertex(), None);
        assert!((half.direction(&points).length() - 1.0).abs() < 1e-6);
        let opposite = Blend::at(Weights([0.25, 0.0, 0.75].into()), [0, 1, 2], [points[0], points[1], Vec3::Z]);
        assert_eq!(opposite.strongest(), 2);
        let even = Blend::at(Weights([0.5, 0.0, 0.5].into()), [0, 1, 2], [points[0], points[1], Vec3::Z]);
        assert_eq!(even.direction(&points), points[even.strongest() as usize]);
    }
}
