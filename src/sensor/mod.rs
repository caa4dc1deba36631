//! What measures light: the pixels of a camera and the texels of an atlas, behind one interface, so that every method does both.
//!
//! A pixel's value is the mean radiance [nit] over its square; a texel's is the irradiance [lx] averaged over its footprint.

mod film;
mod texels;
mod view;

pub use film::Film;
pub use texels::Texels;
pub use view::View;

use crate::patch::SurfacePoint;
use crate::sample::Numbers;
use crate::trace::{Hit, Ray};
use glam::Vec3;

/// A set of pixels, numbered from 0.
pub trait Sensor: Sync {
    /// Number of pixels.
    fn len(&self) -> usize;

    /// True where there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Width and height of a picture, whose pixels go row by row; `None` of sensors that lie on surfaces.
    fn size(&self) -> Option<[u32; 2]> {
        None
    }

    /// Where a walk from `pixel` starts, uniform over it; `None` where the pixel measures nothing.
    fn start(&self, pixel: usize, numbers: &mut dyn Numbers) -> Option<Start>;

    /// How light that leaves `position` straight towards the sensor is seen, through the place on its lens that `u` picks; `None`
    /// where it isn't, and of sensors that lie on surfaces.
    fn see(&self, position: Vec3, u: [f32; 2]) -> Option<Seen>;

    /// Density [1/sr] with which walks of all pixels together start along the unit vector `direction`; 0 of sensors that lie on
    /// surfaces.
    fn direction_pdf(&self, direction: Vec3) -> f32;

    /// The pixel that a hit lies in, of sensors that lie on surfaces.
    fn under(&self, hit: &Hit) -> Option<usize>;

    /// True where light that lands on `pixel` is what walks from it find: of all of it, and of no more.
    fn catches(&self, _pixel: usize) -> bool {
        false
    }

    /// The point of a surface as a sensor that lies on it measures there: about which normal.
    fn receives(&self, point: SurfacePoint) -> SurfacePoint {
        point
    }

    /// Area that `pixel` has on a surface [m^2]; 1 of a camera's.
    fn area(&self, pixel: usize) -> f32;
}

/// Where a walk starts.
#[derive(Clone, Copy, Debug)]
pub enum Start {
    /// Light that comes along the ray, against its direction, is measured [nit].
    Ray(Ray),
    /// Light that arrives at the point, about its shading normal, is measured [lx].
    Point(SurfacePoint),
}

/// How a place is seen by a sensor.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    pub pixel: usize,
    /// Where on the sensor [m].
    pub from: Vec3,
    /// What the flux that leaves the place towards the sensor per solid angle is multiplied by to give the pixel's value
    /// [1/m^2]: a point of intensity I adds I times this.
    pub weight: f32,
}
