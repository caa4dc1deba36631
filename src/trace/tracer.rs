//! The tracer on the processor: surfaces and their triangles, numbered, and queries by batches.

use super::path::Path;
use super::traverse::{self, Batch, Line, Nearest};
use super::wide::Wide;
use super::{Hit, Ray, Segment};
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// The triangles of all surfaces, numbered one surface after the other.
#[derive(Clone, Debug)]
pub struct Triangles {
    /// The first triangle number of each surface.
    first: Vec<u32>,
    /// Surface of each triangle number.
    surface: Vec<u32>,
}

impl Triangles {
    /// Numbers the triangles of `scene`.
    pub fn new(scene: &Scene) -> Self {
        Self::of(scene, |_| true)
    }

    /// Numbers those of the surfaces that `keep` holds.
    fn of(scene: &Scene, keep: impl Fn(usize) -> bool) -> Self {
        let (mut first, mut surface) = (Vec::with_capacity(scene.surfaces.len()), Vec::new());
        for (s, placed) in scene.surfaces.iter().enumerate() {
            first.push(surface.len() as u32);
            if !keep(s) {
                continue;
            }
            surface.resize(surface.len() + scene.meshes[placed.mesh].triangles.len(), s as u32);
        }
        Self { first, surface }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.surface.len()
    }

    /// Surface, and triangle within its mesh, of triangle number `triangle`.
    pub fn place(&self, triangle: u32) -> (usize, usize) {
        let s = self.surface[triangle as usize];
        (s as usize, (triangle - self.first[s as usize]) as usize)
    }
}

/// All triangles of a scene, ready to be hit.
pub struct Tracer {
    wide: Wide,
    pub(super) path: Path,
    triangles: Triangles,
    /// Whether each surface is mirrored; empty where none is, so that hits needn't look up theirs.
    mirrored: Vec<bool>,
    /// Distance by which ray origins are kept off surfaces [m].
    offset: f32,
    /// Largest coordinate of the scene [m].
    largest: f32,
}

/// The offset of ray origins, relative to the scene's largest coordinate: well above the rounding of a point computed from
/// corners and weights (about 4 ulp), well below anything a lightmap texel shows.
const ORIGIN_OFFSET: f32 = 64.0 * f32::EPSILON;

impl Tracer {
    /// Builds the BVH over the surfaces of `scene`. Cost: about a second a million triangles.
    pub fn new(scene: &Scene) -> Self {
        Self::with(scene, Triangles::new(scene))
    }

    /// The same over those surfaces alone, by index, that `keep` holds; at least one of them has triangles.
    pub fn of(scene: &Scene, keep: impl Fn(usize) -> bool) -> Self {
        Self::with(scene, Triangles::of(scene, keep))
    }

    /// The same over triangles that are numbered already.
    pub fn with(scene: &Scene, triangles: Triangles) -> Self {
        let corners = |number| {
            let (surface, triangle) = triangles.place(number);
            scene.world_triangle(surface, triangle).map(|p| p.to_array())
        };
        let mut corners: Vec<[[f32; 3]; 3]> = (0..triangles.count() as u32).into_par_iter().map(corners).collect();
        let largest = corners.iter().flatten().flatten().fold(0.0f32, |m, c| m.max(c.abs()));
        // Rays pass through what doesn't cast: the tree leaves out triangles that are not finite, and keeps their numbers.
        for (number, triangle) in corners.iter_mut().enumerate() {
            if !scene.surfaces[triangles.surface[number] as usize].role.casts {
                *triangle = [[f32::NAN; 3]; 3];
            }
        }
        let mut mirrored: Vec<bool> = scene.surfaces.iter().map(|s| s.is_mirrored()).collect();
        if !mirrored.contains(&true) {
            mirrored.clear();
        }
        let wide = Wide::new(&corners);
        let path = *Path::available().last().expect("the portable path at least");
        Self { wide, path, triangles, mirrored, offset: largest * ORIGIN_OFFSET, largest }
    }

    /// How the triangles are numbered.
    pub fn triangles(&self) -> &Triangles {
        &self.triangles
    }

    /// Triangle count over all surfaces.
    pub fn triangle_count(&self) -> usize {
        self.triangles.count()
    }

    /// Surface, and triangle within its mesh, of triangle number `triangle`.
    pub fn place(&self, triangle: u32) -> (usize, usize) {
        self.triangles.place(triangle)
    }

    /// Number of triangle `triangle` of `surface`'s mesh.
    pub fn number(&self, surface: usize, triangle: usize) -> u32 {
        self.triangles.first[surface] + triangle as u32
    }

    /// The distance by which [`Tracer::off_surface`] moves a point [m]: what lies nearer than this lies in one plane.
    pub fn offset(&self) -> f32 {
        self.offset
    }

    /// A ray origin (or segment end) for a surface point, moved off the surface to the side that `normal` (unit) points to.
    pub fn off_surface(&self, position: Vec3, normal: Vec3) -> Vec3 {
        position + normal * self.offset
    }

    /// The nearest hit of each ray; `hits` has the length of `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len());
        let query = |i: usize| (rays[i].origin, rays[i].direction, f32::INFINITY);
        self.path.each::<false>(&self.batch(rays.len()), query, |i, line, nearest| {
            hits[i] = nearest.is_some().then(|| self.hit(line, &nearest));
        });
    }

    /// Whether anything lies within each segment; `blocked` has the length of `segments`.
    pub fn occluded(&self, segments: &[Segment], blocked: &mut [bool]) {
        assert_eq!(segments.len(), blocked.len());
        let query = |i: usize| {
            let way = segments[i].to - segments[i].from;
            let length = way.length();
            (segments[i].from, way / length, length)
        };
        self.path.each::<true>(&self.batch(segments.len()), query, |i, _, nearest| blocked[i] = nearest.is_some());
    }

    /// Whether each ray hits anything at all; `blocked` has the length of `rays`.
    pub fn occluded_rays(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len());
        let query = |i: usize| (rays[i].origin, rays[i].direction, f32::INFINITY);
        self.path.each::<true>(&self.batch(rays.len()), query, |i, _, nearest| blocked[i] = nearest.is_some());
    }

    /// Calls `visit(triangle, back)` for every triangle along a ray, in no order.
    pub fn crossings(&self, ray: &Ray, mut visit: impl FnMut(u32, bool)) {
        let line = Line::new(ray.origin, ray.direction, self.largest);
        traverse::crossings(&self.wide, &line, |number, crossing| visit(number, !crossing.front));
    }

    fn batch(&self, count: usize) -> Batch<'_> {
        Batch { wide: &self.wide, count, offset: self.offset, largest: self.largest }
    }

    #[inline(always)]
    fn hit(&self, line: &Line, nearest: &Nearest) -> Hit {
        let triangle = self.wide.blocks[nearest.block].triangle(nearest.lane);
        let crossing = line.shear.intersect(&triangle).expect("a triangle that was hit");
        let [v, w] = crossing.barycentric;
        let mirrored =
            !self.mirrored.is_empty() && self.mirrored[self.triangles.surface[nearest.number as usize] as usize];
        let barycentric = if mirrored { [w, v] } else { [v, w] };
        Hit { t: nearest.t, triangle: nearest.number, barycentric, back: !crossing.front }
    }
}
