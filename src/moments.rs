//! Where light comes from, to first order: moments of the incident radiance L over directions.
//!
//! The *scalar* moment `integral of L dw` and the *light vector* `integral of L w dw` (Gershun 1939, "The Light Field") are the
//! spherical harmonics of L up to order 1 but for constants: `L_00 = Y_0 scalar` with `Y_0 = sqrt(1 / (4 pi))`, and
//! `(L_1,1, L_1,-1, L_1,0) = Y_1 vector` with `Y_1 = sqrt(3 / (4 pi))`, for Z as the pole. Irradiance follows by convolution with the
//! clamped cosine, `A_0 = pi` and `A_1 = 2 pi / 3` (Ramamoorthi, Hanrahan 2001, "An Efficient Representation for Irradiance
//! Environment Maps", section 3.2): `E(n) = scalar / 4 + vector . n / 2`. That is exact for uniform light over a sphere, a hemisphere or
//! any sum of such, and a third off for a single direction that n faces.
//!
//! A surface has light over its hemisphere alone. What lies below its own horizon is taken as dark, as it is for every other sum.

use crate::color::{Rgb, luminance};
use glam::Vec3;
use std::ops::{Add, AddAssign, Mul};

/// Moments of the light that arrives at a place, by channel [lx].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// `integral of L dw`, at least as long as `vector`.
    pub scalar: Rgb,
    /// `integral of L w dw` along the world's X, Y and Z, `w` away from the place.
    pub vector: [Rgb; 3],
}

impl Moments {
    /// Numbers in all.
    pub const COUNT: usize = 12;

    /// Cosine-distributed directions flatter than this count as if they had it: one in ten thousand, which would outweigh the others.
    pub const LEAST_COS: f32 = 1e-2;

    /// Adds light that comes from the unit vector `towards`: radiance times solid angle [lx].
    #[inline]
    pub fn receive(&mut self, light: Rgb, towards: Vec3) {
        self.scalar += light;
        self.vector[0] += light * towards.x;
        self.vector[1] += light * towards.y;
        self.vector[2] += light * towards.z;
    }

    /// Uniform light over the hemisphere around `normal` (unit) whose irradiance is `irradiance` [lx].
    pub fn uniform(irradiance: Rgb, normal: Vec3) -> Self {
        Self { scalar: irradiance * 2.0, vector: normal.to_array().map(|n| irradiance * n) }
    }

    /// The light vector along `direction`: for a `direction` that all light comes from the front of, the irradiance about it [lx].
    pub fn along(&self, direction: Vec3) -> Rgb {
        self.vector[0] * direction.x + self.vector[1] * direction.y + self.vector[2] * direction.z
    }

    /// Irradiance about `normal` (unit) from these moments alone [lx]; below 0 at most by half of what `normal` would face turned round.
    pub fn irradiance(&self, normal: Vec3) -> Rgb {
        self.scalar * 0.25 + self.along(normal) * 0.5
    }

    /// Each channel times that of `factor`.
    pub fn times(&self, factor: Rgb) -> Self {
        Self { scalar: self.scalar * factor, vector: self.vector.map(|v| v * factor) }
    }

    /// The luminance of the light vector over that of the scalar: the mean direction, whose length, 0..=1, says how much light agrees
    /// on it. Zero in the dark.
    pub fn mean_direction(&self) -> Vec3 {
        let scalar = luminance(self.scalar);
        let vector = Vec3::from(self.vector.map(luminance));
        if scalar > 0.0 { (vector / scalar).clamp_length_max(1.0) } else { Vec3::ZERO }
    }

    /// What light can be: no channel's scalar below 0, nor its vector longer than that. Planes fitted to noise may leave that range.
    pub fn made_possible(&self) -> Self {
        let scalar = self.scalar.max(Rgb::ZERO);
        let [x, y, z] = self.vector;
        let length = (x * x + y * y + z * z).map(f32::sqrt);
        let factor = Rgb::select(length.cmpgt(scalar), scalar / length, Rgb::ONE);
        Self { scalar, ..self.times(factor) }
    }

    /// The numbers in a row: scalar, then X, Y, Z, each R, G, B.
    pub fn to_array(self) -> [f32; Self::COUNT] {
        let all = [self.scalar, self.vector[0], self.vector[1], self.vector[2]];
        std::array::from_fn(|k| all[k / 3][k % 3])
    }

    /// The same back.
    pub fn from_array(numbers: [f32; Self::COUNT]) -> Self {
        let rgb = |k: usize| Rgb::new(numbers[3 * k], numbers[3 * k + 1], numbers[3 * k + 2]);
        Self { scalar: rgb(0), vector: [rgb(1), rgb(2), rgb(3)] }
    }
}

impl Add for Moments {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let [x, y, z] = self.vector;
        let vector = [x + other.vector[0], y + other.vector[1], z + other.vector[2]];
        Self { scalar: self.scalar + other.scalar, vector }
    }
}

impl AddAssign for Moments {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<f32> for Moments {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        self.times(Rgb::splat(factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    #[test]
    fn uniform_hemisphere_has_its_irradiance_about_every_tilt() {
        // E = pi L (1 + cos) / 2: the lit part of a tilted plane's hemisphere.
        let moments = Moments::uniform(Rgb::splat(PI), Vec3::Z);
        for degrees in [0.0f32, 30.0, 60.0, 90.0, 180.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let e = moments.irradiance(Vec3::new(sin, 0.0, cos)).x;
            assert!((e - PI * (1.0 + cos) / 2.0).abs() < 1e-5, "{degrees}: {e}");
        }
    }

    #[test]
    fn one_direction_is_the_mean_direction() {
        let towards = Vec3::new(1.0, 2.0, -2.0) / 3.0;
        let mut moments = Moments::default();
        moments.receive(Rgb::new(1.0, 2.0, 3.0), towards);
        assert!((moments.mean_direction() - towards).length() < 1e-6);
        assert!((moments.along(towards) - Rgb::new(1.0, 2.0, 3.0)).length() < 1e-6);
        assert_eq!(Moments::from_array(moments.to_array()), moments);
    }

    #[test]
    fn a_vector_longer_than_its_scalar_is_cut() {
        let moments = Moments { scalar: Rgb::new(1.0, 4.0, -1.0), vector: [Rgb::splat(3.0), Rgb::ZERO, Rgb::ZERO] };
        let possible = moments.made_possible();
        assert_eq!(possible.scalar, Rgb::new(1.0, 4.0, 0.0));
        assert_eq!(possible.vector[0], Rgb::new(1.0, 3.0, 0.0));
    }
}
