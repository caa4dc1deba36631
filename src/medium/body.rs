//! One medium, made ready for rays.

use super::majorant::{Majorants, Walk};
use super::phase::Phase;
use crate::color::Rgb;
use crate::scene::{DensityGrid, Medium, MediumShape, Scene};
use crate::trace::Ray;
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A medium with its densities multiplied in.
///
/// One that scatters nothing is never met by chance: the light that passes is weighed by what it absorbs, without noise.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub name: String,
    unit_from_world: DAffine3,
    is_ball: bool,
    /// Scattering coefficient [1/m] at density 1 of the grid; so are the others.
    pub scattering: Rgb,
    /// Extinction of a medium that scatters; 0 of one that only absorbs.
    pub met: Rgb,
    /// Extinction of a medium that only absorbs; 0 of one that scatters.
    pub absorbed: Rgb,
    /// Radiance per metre [nit/m].
    pub emission: Rgb,
    pub phase: Phase,
    pub grid: Option<Grid>,
}

/// A grid with its majorants.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub density: Arc<DensityGrid>,
    pub majorants: Majorants,
}

/// A ray in the unit cube of a body: the same distances along it.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnitRay {
    pub origin: DVec3,
    pub direction: DVec3,
}

impl UnitRay {
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// The way of a ray through a body.
#[derive(Clone, Debug)]
pub(super) struct Crossing<'a> {
    pub body: &'a Body,
    pub ray: UnitRay,
    /// Where it enters and leaves [m], the first before the second.
    pub span: [f64; 2],
    /// Through the cells of its grid, where it has one.
    pub walk: Option<Walk<'a>>,
    /// Bound on the density over the stretch that is followed: 1 of homogeneous media, 0 where the ray isn't in it.
    pub bound: f32,
}

impl Body {
    /// `medium` of `scene`; none where it is at fault, or changes no light.
    pub fn new(scene: &Scene, medium: &Medium) -> Option<Self> {
        if medium.is_void() || medium.fault(scene).is_some() {
            return None;
        }
        let unit_from_world = medium.shape.world_from_unit(scene)?.inverse();
        let scattering = medium.scattering * medium.density;
        let extinction = medium.extinction();
        let scatters = scattering != Rgb::ZERO;
        Some(Self {
            name: medium.name.clone(),
            unit_from_world,
            is_ball: matches!(medium.shape, MediumShape::Ellipsoid { .. }),
            scattering,
            met: if scatters { extinction } else { Rgb::ZERO },
            absorbed: if scatters { Rgb::ZERO } else { extinction },
            emission: medium.emission * medium.density,
            phase: Phase { g: medium.anisotropy },
            grid: medium
                .grid
                .as_ref()
                .map(|density| Grid { density: density.clone(), majorants: Majorants::new(density) }),
        })
    }

    /// Extinction coefficient [1/m] at density 1 of the grid.
    pub fn extinction(&self) -> Rgb {
        self.met + self.absorbed
    }

    /// How `ray` crosses it within `distance` [m]; `None` where it doesn't.
    pub fn cross(&self, ray: &Ray, distance: f32) -> Option<Crossing<'_>> {
        let ray = UnitRay {
            origin: self.unit_from_world.transform_point3(ray.origin.as_dvec3()),
            direction: self.unit_from_world.transform_vector3(ray.direction.as_dvec3()),
        };
        let [near, far] = if self.is_ball { ball(&ray) } else { cube(&ray) }?;
        let span = [near.max(0.0), far.min(f64::from(distance))];
        // Neither where one is NaN.
        if span[0].partial_cmp(&span[1]) != Some(std::cmp::Ordering::Less) {
            return None;
        }
        let walk = self.grid.as_ref().map(|grid| grid.majorants.walk(&ray, span));
        Some(Crossing { body: self, ray, span, walk, bound: 0.0 })
    }

    /// The factor on its coefficients at a point of the world; none outside.
    pub fn density(&self, point: DVec3) -> Option<f32> {
        let place = self.unit_from_world.transform_point3(point);
        let is_inside = match self.is_ball {
            true => (place - 0.5).length_squared() <= 0.25,
            false => place.cmpge(DVec3::ZERO).all() && place.cmple(DVec3::ONE).all(),
        };
        is_inside.then(|| self.grid.as_ref().map_or(1.0, |grid| grid.density.at(place)))
    }
}

impl Crossing<'_> {
    /// The density of its grid at the distance `t`; 1 without one.
    pub fn density(&self, t: f64) -> f32 {
        self.body.grid.as_ref().map_or(1.0, |grid| grid.density.at(self.ray.at(t)))
    }
}

/// Where a line is in the unit cube.
fn cube(ray: &UnitRay) -> Option<[f64; 2]> {
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (ray.origin[axis], ray.direction[axis]);
        if d == 0.0 {
            if !(0.0..=1.0).contains(&o) {
                return None;
            }
            continue;
        }
        let (a, b) = (-o / d, (1.0 - o) / d);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    Some([near, far])
}

/// Where a line is in the ball that fits into the unit cube.
fn ball(ray: &UnitRay) -> Option<[f64; 2]> {
    let square = ray.direction.length_squared();
    let from = ray.origin - 0.5;
    // The point nearest to the middle, and half of the chord about it.
    let nearest = -from.dot(ray.direction) / square;
    let away = (from + ray.direction * nearest).length_squared();
    let half = ((0.25 - away) / square).sqrt();
    half.is_finite().then_some([nearest - half, nearest + half])
}
