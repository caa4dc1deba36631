//! The plane through weighed points that are nearest to it in the sense of least squares, as shares of the points' values: moving least
//! squares (Lancaster, Salkauskas 1981).

use glam::Vec2;

/// Sums over weighed points around the place where the plane is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plane {
    weight: f32,
    first: Vec2,
    /// Of x x, x y and y y.
    second: [f32; 3],
}

/// The first row of the inverse of the normal equations.
#[derive(Clone, Copy, Debug)]
pub struct Shares {
    constant: f32,
    slope: Vec2,
}

impl Plane {
    /// Adds a point at `d` from the place, of `weight`.
    pub fn add(&mut self, weight: f32, d: Vec2) {
        self.weight += weight;
        self.first += d * weight;
        self.second = [
            self.second[0] + weight * d.x * d.x,
            self.second[1] + weight * d.x * d.y,
            self.second[2] + weight * d.y * d.y,
        ];
    }

    /// The shares of the points; slopes are held back by `ridge`, relative to the weights times the square of `reach`: a row of points
    /// says nothing about the slope across it. `None` where nothing is there.
    pub fn shares(&self, ridge: f32, reach: f32) -> Option<Shares> {
        let ridge = ridge * self.weight * reach * reach;
        let [xx, xy, yy] = [self.second[0] + ridge, self.second[1], self.second[2] + ridge];
        let constant = xx * yy - xy * xy;
        let slope = Vec2::new(self.first.y * xy - self.first.x * yy, self.first.x * xy - self.first.y * xx);
        let determinant = self.weight * constant + self.first.dot(slope);
        let is_sound = determinant > 0.0 && determinant.is_finite();
        is_sound.then(|| Shares { constant: constant / determinant, slope: slope / determinant })
    }
}

impl Shares {
    /// The share of the point at `d` of `weight` in the plane's value.
    pub fn of(&self, weight: f32, d: Vec2) -> f32 {
        weight * (self.constant + self.slope.dot(d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_comes_back_from_its_points_on_one_side() {
        let points = [[1.0, 0.0], [2.0, 0.5], [1.0, 2.0], [3.0, 1.0], [2.0, 2.5]].map(Vec2::from);
        let mut plane = Plane::default();
        points.iter().for_each(|d| plane.add(1.0, *d));
        let shares = plane.shares(0.0, 1.0).unwrap();
        let value = |d: &Vec2| 5.0 - 2.0 * d.x + 0.5 * d.y;
        let sum: f32 = points.iter().map(|d| shares.of(1.0, *d) * value(d)).sum();
        assert!((sum - 5.0).abs() < 1e-4, "{sum}");
    }

    #[test]
    fn points_in_one_place_are_averaged_and_none_are_nothing() {
        let mut plane = Plane::default();
        assert!(plane.shares(0.1, 1.0).is_none());
        plane.add(1.0, Vec2::ZERO);
        plane.add(3.0, Vec2::ZERO);
        let shares = plane.shares(0.1, 1.0).unwrap();
        assert!((shares.of(1.0, Vec2::ZERO) - 0.25).abs() < 1e-6);
    }
}
