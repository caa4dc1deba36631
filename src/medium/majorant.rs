//! Bounds on a grid's density, cell by coarse cell, and the walk of a ray through them (Amanatides, Woo 1987).
//!
//! Delta and ratio tracking step by the bound: where the grid is empty or thin they take few steps or none.

use super::body::UnitRay;
use crate::scene::DensityGrid;

/// Voxels along the side of a cell.
const VOXELS: usize = 4;

/// Cells along an axis, at most.
const MOST_CELLS: usize = 128;

/// The largest density within each of a coarse grid of cells.
#[derive(Clone, Debug)]
pub(super) struct Majorants {
    size: [usize; 3],
    /// x runs fastest.
    most: Vec<f32>,
}

impl Majorants {
    pub fn new(grid: &DensityGrid) -> Self {
        let size = grid.size().map(|n| n.div_ceil(VOXELS).min(MOST_CELLS));
        // The voxels that interpolation reads within cell `c`, and half a voxel beyond: more than any rounding on the way.
        let reach = |axis: usize, c: usize| {
            let (n, cells) = (grid.size()[axis], size[axis]);
            let first = (c * n / cells).saturating_sub(1);
            let last = ((c + 1) * n).div_ceil(cells).min(n - 1);
            first..=last
        };
        let mut most = Vec::with_capacity(size.iter().product());
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let mut bound = 0.0f32;
                    for k in reach(2, z) {
                        for j in reach(1, y) {
                            bound = reach(0, x).map(|i| grid.voxel([i, j, k])).fold(bound, f32::max);
                        }
                    }
                    most.push(bound);
                }
            }
        }
        Self { size, most }
    }

    /// The walk of `ray` over `span`, which lies within the unit cube.
    pub fn walk(&self, ray: &UnitRay, span: [f64; 2]) -> Walk<'_> {
        let start = ray.at(span[0]);
        let (mut cell, mut step, mut next, mut width) = ([0; 3], [0; 3], [f64::INFINITY; 3], [f64::INFINITY; 3]);
        for axis in 0..3 {
            let n = self.size[axis] as f64;
            let at = (start[axis] * n).clamp(0.0, n - 1.0);
            cell[axis] = at as i32;
            let speed = ray.direction[axis] * n;
            if speed != 0.0 {
                step[axis] = speed.signum() as i32;
                let border = f64::from(cell[axis] + i32::from(speed > 0.0));
                next[axis] = (border - ray.origin[axis] * n) / speed;
                width[axis] = 1.0 / speed.abs();
            }
        }
        Walk { majorants: self, cell, step, next, width, end: span[1], leaves: span[0] }
    }
}

/// A ray's way from cell to cell.
#[derive(Clone, Debug)]
pub(super) struct Walk<'a> {
    majorants: &'a Majorants,
    cell: [i32; 3],
    step: [i32; 3],
    /// Where the next border across each axis is met [m].
    next: [f64; 3],
    /// The way between two borders across each axis [m].
    width: [f64; 3],
    end: f64,
    /// Where the cell that was asked for last is left.
    leaves: f64,
}

impl Walk<'_> {
    /// The bound on the density just after the distance `t`, within the walk's span, and how far it holds, more than `t`. Distances
    /// must not fall from call to call.
    pub fn bound(&mut self, t: f64) -> (f32, f64) {
        loop {
            let axis = (0..3).fold(0, |least, axis| if self.next[axis] < self.next[least] { axis } else { least });
            let border = self.next[axis];
            if border > t || !border.is_finite() {
                self.leaves = border.min(self.end);
                break;
            }
            let further = border + self.width[axis];
            // Seen from far away, cells may be narrower than distances can tell.
            self.next[axis] = if further > border { further } else { f64::INFINITY };
            // The last cell goes on to the end: rounding must not lead out of the grid.
            let last = self.majorants.size[axis] as i32 - 1;
            self.cell[axis] = (self.cell[axis] + self.step[axis]).clamp(0, last);
        }
        let [x, y, z] = self.cell.map(|c| c as usize);
        let [nx, ny, _] = self.majorants.size;
        let end = if self.leaves > t { self.leaves } else { t.next_up() };
        (self.majorants.most[(z * ny + y) * nx + x], end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn bounds_hold_everywhere_along_a_ray() {
        // A lone dense voxel here and there, along sides that cells divide unevenly.
        let size = [23, 9, 5];
        let values = (0..size.iter().product()).map(|i| if i % 89 == 0 { 1.0 + (i % 7) as f32 } else { 0.0 }).collect();
        let grid = DensityGrid::new(size, values).unwrap();
        let majorants = Majorants::new(&grid);
        for k in 0..400 {
            let wave = |a: f64| (f64::from(k) * a).sin() * 0.5 + 0.5;
            let (from, to) = (DVec3::new(wave(1.1), wave(2.3), wave(3.7)), DVec3::new(wave(4.1), wave(5.3), wave(6.7)));
            let ray = UnitRay { origin: from, direction: to - from };
            let mut walk = majorants.walk(&ray, [0.0, 1.0]);
            let mut t = 0.0;
            while t < 1.0 {
                let (bound, border) = walk.bound(t);
                assert!(border > t);
                let ends = border.min(1.0);
                for step in 0..=20 {
                    let density = grid.at(ray.at(t + (ends - t) * f64::from(step) / 20.0));
                    assert!(density <= bound, "{density} over {bound} at {t} of ray {k}");
                }
                t = border;
            }
        }
    }
}
