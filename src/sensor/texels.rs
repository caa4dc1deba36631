//! The texels of an atlas, on the fronts of surfaces.

use super::{Seen, Sensor, Start};
use crate::patch::footprint::CellMask;
use crate::patch::{Ground, SurfacePoint, unocclude::Exposure};
use crate::sample::Numbers;
use crate::trace::Hit;
use glam::Vec3;

/// The texels of all pages as pixels, by patch number: buried ones measure nothing.
pub struct Texels<'a> {
    pub ground: &'a Ground<'a>,
    pub exposure: &'a Exposure,
    /// Whether light is measured about interpolated normals.
    pub shading_normals: bool,
}

impl Sensor for Texels<'_> {
    fn len(&self) -> usize {
        self.ground.patches.len()
    }

    fn start(&self, pixel: usize, numbers: &mut dyn Numbers) -> Option<Start> {
        let at = numbers.pair();
        if self.exposure.is_buried(pixel) {
            return None;
        }
        let mut footprint = self.ground.footprint(pixel);
        if footprint.is_empty() {
            return None;
        }
        footprint.restrict(self.exposure.cells[pixel]);
        let point = footprint.sample(at);
        Some(Start::Point(self.receives(point)))
    }

    fn see(&self, _: Vec3, _: [f32; 2]) -> Option<Seen> {
        None
    }

    fn direction_pdf(&self, _: Vec3) -> f32 {
        0.0
    }

    fn under(&self, hit: &Hit) -> Option<usize> {
        let patch = self.ground.patch_under(hit).filter(|_| !hit.back)?;
        (!self.exposure.is_buried(patch)).then_some(patch)
    }

    fn catches(&self, pixel: usize) -> bool {
        // Of a footprint that lies in the open in part, a hit doesn't tell in which.
        self.exposure.cells[pixel] == CellMask::ALL && self.ground.casts(pixel)
    }

    fn receives(&self, point: SurfacePoint) -> SurfacePoint {
        if self.shading_normals { point } else { point.flat() }
    }

    fn area(&self, pixel: usize) -> f32 {
        self.exposure.area[pixel]
    }
}
