//! Participating media: what absorbs, scatters and emits light between surfaces.
//!
//! At a point of density `d` (a factor, times that of the grid where there is one) a medium has the coefficients `d sigma_s` and
//! `d sigma_a` [1/m], per channel, and sends out `d epsilon` [nit/m] (radiance per metre; Chandrasekhar 1960, section 6). Media that
//! overlap add up. They take no part in radiosity, which knows surfaces alone.
//!
//! Absorption within glass belongs to its material, not here.

use super::Scene;
use crate::color::Rgb;
use glam::{Affine3A, DAffine3, DVec3, Vec3};
use std::sync::Arc;

/// A participating medium.
#[derive(Clone, Debug)]
pub struct Medium {
    /// The source path, as in [`super::Surface::name`].
    pub name: String,
    pub shape: MediumShape,
    /// Factor on the coefficients and on what it emits, 0..=[`MOST_COEFFICIENT`].
    pub density: f32,
    /// Scattering coefficient sigma_s [1/m] at density 1, per channel, 0..=[`MOST_COEFFICIENT`].
    pub scattering: Rgb,
    /// Absorption coefficient sigma_a [1/m] at density 1, per channel, 0..=[`MOST_COEFFICIENT`].
    pub absorption: Rgb,
    /// Radiance sent out per metre at density 1 [nit/m], 0 or more.
    pub emission: Rgb,
    /// Mean cosine g of the angle by which light is turned (Henyey, Greenstein 1941), within +-[`MOST_ANISOTROPY`]: 0 scatters
    /// evenly, more than 0 forwards.
    pub anisotropy: f32,
    /// Densities over the shape's unit cube; none: 1 everywhere.
    pub grid: Option<Arc<DensityGrid>>,
}

/// Where a medium is. A unit cube has its corners at 0 and 1, and is placed by its transform, which may mirror, shear and scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MediumShape {
    /// The box around all surfaces, grown by [`SCENE_MARGIN`] of its diagonal on every side. A medium without an end would take all
    /// light of a sky or sun away.
    Scene,
    /// A unit cube.
    Box { world_from_unit: Affine3A },
    /// The ball that fits into a unit cube: an ellipsoid in the world.
    Ellipsoid { world_from_unit: Affine3A },
}

/// How far a medium in the whole scene reaches beyond the box around it, over the diagonal of that box.
pub const SCENE_MARGIN: f32 = 0.05;

/// The largest density factor, and coefficient [1/m].
pub const MOST_COEFFICIENT: f32 = 1e6;

/// The largest emission [nit/m].
pub const MOST_EMISSION: f32 = 1e12;

/// The largest |g|: beyond, the phase function is a needle.
pub const MOST_ANISOTROPY: f32 = 0.99;

/// Voxels of a grid, at most: 1 GiB.
pub const MOST_VOXELS: u64 = 1 << 28;

/// The largest density of a voxel.
pub const MOST_DENSITY: f32 = 1e6;

/// The largest optical depth along the diagonal of a grid if all of it were as dense as its densest voxel: the steps that a way
/// through it may take.
pub const MOST_DEPTH: f64 = 1e6;

/// Transforms that make more than this out of a metre, or less than one over it, are none.
const MOST_SIZE: f64 = 1e9;

/// A dense grid of densities. Voxel (i, j, k) has its value at its middle, ((i + 1/2) / nx, (j + 1/2) / ny, (k + 1/2) / nz) of the
/// unit cube; between middles values are interpolated trilinearly, beyond the outermost ones they go on as they are.
#[derive(Clone, Debug, PartialEq)]
pub struct DensityGrid {
    size: [usize; 3],
    /// x runs fastest: an array of shape (nz, ny, nx) in C's order.
    values: Vec<f32>,
    most: f32,
}

impl DensityGrid {
    /// A grid of `size` voxels (nx, ny, nz), `values` with x fastest.
    ///
    /// # Errors
    /// What is wrong, where the size is 0 or too large, isn't that of the values, or a value is negative, too large or not finite.
    pub fn new(size: [usize; 3], values: Vec<f32>) -> Result<Self, String> {
        let count = Self::voxel_count(size)?;
        if count != values.len() {
            return Err(format!("a grid of {} voxels holds {} values", count, values.len()));
        }
        if let Some(wrong) = values.iter().find(|v| !(0.0..=MOST_DENSITY).contains(*v)) {
            return Err(format!("a grid holds the density {wrong}; allowed are 0 to {MOST_DENSITY}"));
        }
        let most = values.iter().copied().fold(0.0, f32::max);
        Ok(Self { size, values, most })
    }

    /// The voxels of a grid of `size`, to be asked before memory is taken for them.
    ///
    /// # Errors
    /// What is wrong, where there are none or too many.
    pub fn voxel_count(size: [usize; 3]) -> Result<usize, String> {
        let count = size.iter().try_fold(1u64, |n, &s| n.checked_mul(s as u64)).filter(|n| *n <= MOST_VOXELS);
        match count {
            Some(0) => Err("a grid has no voxels".into()),
            Some(count) => Ok(count as usize),
            None => Err(format!("a grid of {size:?} voxels is too large; up to {MOST_VOXELS} can be read")),
        }
    }

    /// Voxels along x, y and z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The density of voxel (i, j, k).
    pub fn voxel(&self, [i, j, k]: [usize; 3]) -> f32 {
        self.values[(k * self.size[1] + j) * self.size[0] + i]
    }

    /// The largest density.
    pub fn most(&self) -> f32 {
        self.most
    }

    /// The density at a place of the unit cube.
    pub fn at(&self, place: DVec3) -> f32 {
        let (mut low, mut high, mut share) = ([0; 3], [0; 3], [0.0; 3]);
        for axis in 0..3 {
            let last = self.size[axis] - 1;
            let at = (place[axis] * self.size[axis] as f64 - 0.5).clamp(0.0, last as f64);
            low[axis] = at as usize;
            high[axis] = (low[axis] + 1).min(last);
            share[axis] = (at - low[axis] as f64) as f32;
        }
        let mix = |a: f32, b: f32, s: f32| a + (b - a) * s;
        let row = |j, k| mix(self.voxel([low[0], j, k]), self.voxel([high[0], j, k]), share[0]);
        let plane = |k| mix(row(low[1], k), row(high[1], k), share[1]);
        mix(plane(low[2]), plane(high[2]), share[2])
    }
}

impl Medium {
    /// A medium of density 1 in `shape` that does nothing yet.
    pub fn new(name: impl Into<String>, shape: MediumShape) -> Self {
        Self {
            name: name.into(),
            shape,
            density: 1.0,
            scattering: Rgb::ZERO,
            absorption: Rgb::ZERO,
            emission: Rgb::ZERO,
            anisotropy: 0.0,
            grid: None,
        }
    }

    /// What is wrong with it, where something is; `scene` gives the box of one that fills it.
    pub fn fault(&self, scene: &Scene) -> Option<String> {
        let within = |c: Rgb, most: f32| c.to_array().iter().all(|v| (0.0..=most).contains(v));
        let most = MOST_COEFFICIENT;
        if !(0.0..=most).contains(&self.density) {
            return Some(format!("density {} is out of range; allowed are 0 to {most}", self.density));
        }
        for (name, value) in [("scattering", self.scattering), ("absorption", self.absorption)] {
            if !within(value, most) || !within(value * self.density, most) {
                return Some(format!(
                    "{name} {value} is out of range; allowed are 0 to {most} [1/m], density included"
                ));
            }
        }
        if !within(self.emission, MOST_EMISSION) || !within(self.emission * self.density, MOST_EMISSION) {
            return Some(format!(
                "emission {} is out of range; allowed are 0 to {MOST_EMISSION} [nit/m]",
                self.emission
            ));
        }
        if !(-MOST_ANISOTROPY..=MOST_ANISOTROPY).contains(&self.anisotropy) {
            let message = "is out of range; allowed are";
            return Some(format!("g {} {message} -{MOST_ANISOTROPY} to {MOST_ANISOTROPY}", self.anisotropy));
        }
        let Some(world_from_unit) = self.shape.world_from_unit(scene) else {
            return Some("its box has no volume, or none that can be measured; give it three sides".into());
        };
        let grid = self.grid.as_ref()?;
        let extinction = f64::from(((self.scattering + self.absorption) * self.density).max_element());
        let diagonal = (world_from_unit.matrix3 * DVec3::ONE).length();
        let depth = extinction * f64::from(grid.most()) * diagonal;
        (depth > MOST_DEPTH).then(|| {
            format!("its grid has an optical depth of up to {depth:.3e}; lower its density, up to {MOST_DEPTH:e} can be followed")
        })
    }

    /// The extinction coefficient sigma_t [1/m], density included.
    pub fn extinction(&self) -> Rgb {
        (self.scattering + self.absorption) * self.density
    }

    /// True where it changes no light.
    pub fn is_void(&self) -> bool {
        let coefficients = (self.scattering + self.absorption + self.emission) * self.density;
        coefficients == Rgb::ZERO || self.grid.as_ref().is_some_and(|grid| grid.most() == 0.0)
    }
}

impl MediumShape {
    /// A box with its sides along the axes [m].
    pub fn between(low: Vec3, high: Vec3) -> Self {
        let world_from_unit = Affine3A::from_mat3_translation(glam::Mat3::from_diagonal(high - low), low);
        Self::Box { world_from_unit }
    }

    /// The transform of its unit cube, exact where the box is the scene's; `None` where it has no volume that can be measured.
    pub fn world_from_unit(&self, scene: &Scene) -> Option<DAffine3> {
        let placed = match self {
            Self::Box { world_from_unit } | Self::Ellipsoid { world_from_unit } => world_from_unit.as_daffine3(),
            Self::Scene => {
                let [low, high] = scene.bounds()?.map(Vec3::as_dvec3);
                let margin = DVec3::splat(f64::from(SCENE_MARGIN) * (high - low).length());
                let matrix3 = glam::DMat3::from_diagonal(high - low + 2.0 * margin);
                DAffine3 { matrix3, translation: low - margin }
            }
        };
        let sides = [placed.matrix3.x_axis, placed.matrix3.y_axis, placed.matrix3.z_axis].map(DVec3::length);
        // Flatter than this, the inverse is noise.
        let solid = placed.matrix3.determinant().abs() > 1e-9 * sides.iter().product::<f64>();
        let is_measured = |side: &f64| (1.0 / MOST_SIZE..=MOST_SIZE).contains(side);
        (placed.is_finite() && solid && sides.iter().all(is_measured)).then_some(placed)
    }
}
