//! Where probes stand.

use glam::{UVec3, Vec3};

/// A set of probes that belong together.
#[derive(Clone, Debug, PartialEq)]
pub enum Placement {
    /// One at each position [m].
    Positions(Vec<Vec3>),
    Grid(Grid),
}

/// Probes at the middles of a box's cells, X the fastest, then Y, then Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The first probe [m].
    pub origin: Vec3,
    /// From one to the next along each axis [m].
    pub step: Vec3,
    /// Along each axis, at least 1.
    pub counts: UVec3,
}

impl Grid {
    /// Fills the box from `low` to `high` [m] with cells of at most `spacing` [m] a side.
    pub fn new(low: Vec3, high: Vec3, spacing: f32) -> Self {
        let size = (high - low).max(Vec3::ZERO);
        let counts = (size / spacing).ceil().max(Vec3::ONE);
        let step = size / counts;
        Self { origin: low + 0.5 * step, step, counts: counts.as_uvec3() }
    }

    /// Number of probes.
    pub fn len(&self) -> u64 {
        self.counts.to_array().into_iter().map(u64::from).fold(1, u64::saturating_mul)
    }

    /// Never: a grid has a cell at least.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The positions in order [m].
    pub fn positions(&self) -> impl Iterator<Item = Vec3> + use<> {
        let Self { origin, step, counts } = *self;
        let rows = (0..counts.z).flat_map(move |z| (0..counts.y).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| (0..counts.x).map(move |x| origin + step * UVec3::new(x, y, z).as_vec3()))
    }
}

impl Placement {
    /// Number of probes.
    pub fn len(&self) -> u64 {
        match self {
            Self::Positions(positions) => positions.len() as u64,
            Self::Grid(grid) => grid.len(),
        }
    }

    /// True without a probe.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The positions in order [m].
    pub fn positions(&self) -> Vec<Vec3> {
        match self {
            Self::Positions(positions) => positions.clone(),
            Self::Grid(grid) => grid.positions().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_fill_the_box_evenly() {
        let grid = Grid::new(Vec3::ZERO, Vec3::new(4.0, 2.5, 0.0), 1.0);
        assert_eq!((grid.counts, grid.len()), (UVec3::new(4, 3, 1), 12));
        let all: Vec<Vec3> = grid.positions().collect();
        assert_eq!(all.len(), 12);
        assert_eq!(all[1] - all[0], Vec3::X);
        assert!((all[11] - Vec3::new(3.5, 2.5 * 5.0 / 6.0, 0.0)).length() < 1e-6);
    }
}
