//! The tracer on the processor: surfaces and their triangles, numbered, and queries by batches.

use super::path::Path;
use super::sheet::{Passage, Sheets, chance};
use super::traverse::{self, Batch, Line, Nearest};
use super::wide::Wide;
use super::{Hit, Ray, Segment};
use crate::color::Rgb;
use crate::scene::Scene;
use crate::scene::material::mean_share;
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
    /// What is solid.
    wide: Wide,
    /// What lets some light through, where anything does.
    sheets: Option<Sheets>,
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
        let sheets = Sheets::new(scene, |number| triangles.place(number), &mut corners);
        let wide = Wide::new(&corners);
        let path = *Path::available().last().expect("the portable path at least");
        Self { wide, sheets, path, triangles, mirrored, offset: largest * ORIGIN_OFFSET, largest }
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

    /// The nearest hit of each ray; `hits` has the length of `rays`. Where sheets let light through, rays pass them with the mean
    /// share of it as their chance.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.closest_solid(rays, hits);
        self.through(rays, hits, |_, _| {});
    }

    /// The same, and the tint of what each ray stands for: `tints` has one a ray, or none where all are white.
    pub fn closest_tinted(&self, rays: &[Ray], hits: &mut [Option<Hit>], tints: &mut Vec<Rgb>) {
        self.closest_solid(rays, hits);
        self.whiten(rays.len(), tints);
        self.through(rays, hits, |i, tint| {
            if let Some(t) = tints.get_mut(i) {
                *t = tint;
            }
        });
    }

    /// White tints for `count` rays, or none where there is no other colour.
    fn whiten(&self, count: usize, tints: &mut Vec<Rgb>) {
        tints.clear();
        if self.sheets.as_ref().is_some_and(|s| s.is_tinted) {
            tints.resize(count, Rgb::ONE);
        }
    }

    /// Takes rays that end at a sheet to it, and calls `tint` for each ray.
    fn through(&self, rays: &[Ray], hits: &mut [Option<Hit>], mut tint: impl FnMut(usize, Rgb)) {
        let Some(sheets) = &self.sheets else { return };
        let mut layers = sheets.layers();
        for (i, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            let solid = hit.as_ref().map(|h| (h.t, h.triangle));
            tint(
                i,
                match sheets.pass(ray, self.largest, self.offset, solid, &mut layers) {
                    Passage::On(tint) => tint,
                    Passage::Ends(t, triangle, barycentric, back, tint) => {
                        *hit = Some(Hit { t, triangle, barycentric, back });
                        tint
                    }
                },
            );
        }
    }

    /// The nearest solid hit of each ray: sheets are looked through.
    pub fn closest_solid(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len());
        let query = |i: usize| (rays[i].origin, rays[i].direction, f32::INFINITY);
        self.path.each::<false>(&self.batch(rays.len()), query, |i, line, nearest| {
            hits[i] = nearest.is_some().then(|| self.hit(line, &nearest));
        });
    }

    /// Whether anything lies within each segment; `blocked` has the length of `segments`. Sheets are passed by chance, as in
    /// [`Tracer::closest`].
    pub fn occluded(&self, segments: &[Segment], blocked: &mut [bool]) {
        self.occluded_tinted(segments, blocked, &mut Vec::new());
    }

    /// Whether each ray hits anything at all; `blocked` has the length of `rays`. Sheets are passed by chance.
    pub fn occluded_rays(&self, rays: &[Ray], blocked: &mut [bool]) {
        self.occluded_rays_tinted(rays, blocked, &mut Vec::new());
    }

    /// As [`Tracer::occluded`], with the tint of what each open segment stands for: one a segment, or none where all are white.
    pub fn occluded_tinted(&self, segments: &[Segment], blocked: &mut [bool], tints: &mut Vec<Rgb>) {
        assert_eq!(segments.len(), blocked.len());
        self.solid_between(segments, |i, is| blocked[i] = is);
        self.whiten(segments.len(), tints);
        self.stop(|i| ray_of(&segments[i]), blocked, tints);
    }

    /// As [`Tracer::occluded_rays`], with tints.
    pub fn occluded_rays_tinted(&self, rays: &[Ray], blocked: &mut [bool], tints: &mut Vec<Rgb>) {
        assert_eq!(rays.len(), blocked.len());
        self.solid_along(rays, |i, is| blocked[i] = is);
        self.whiten(rays.len(), tints);
        self.stop(|i| (rays[i], f32::INFINITY), blocked, tints);
    }

    /// What gets through along each segment, by channel, without chance: 1 where nothing stands in the way, 0 where something solid
    /// does; `shares` has the length of `segments`.
    pub fn transmittance(&self, segments: &[Segment], shares: &mut [Rgb]) {
        assert_eq!(segments.len(), shares.len());
        self.solid_between(segments, |i, is| shares[i] = if is { Rgb::ZERO } else { Rgb::ONE });
        self.dim(|i| ray_of(&segments[i]), shares);
    }

    /// The same along rays without an end.
    pub fn transmittance_of_rays(&self, rays: &[Ray], shares: &mut [Rgb]) {
        assert_eq!(rays.len(), shares.len());
        self.solid_along(rays, |i, is| shares[i] = if is { Rgb::ZERO } else { Rgb::ONE });
        self.dim(|i| (rays[i], f32::INFINITY), shares);
    }

    /// Takes what sheets dim off the shares of light along the ways that `way` tells.
    fn dim(&self, way: impl Fn(usize) -> (Ray, f32), shares: &mut [Rgb]) {
        let Some(sheets) = &self.sheets else { return };
        let mut layers = sheets.layers();
        for (i, share) in shares.iter_mut().enumerate().filter(|(_, share)| **share != Rgb::ZERO) {
            let (ray, length) = way(i);
            *share = sheets.transmittance(&ray, length, self.largest, self.offset, &mut layers);
        }
    }

    /// Blocks ways by chance as sheets do.
    fn stop(&self, way: impl Fn(usize) -> (Ray, f32), blocked: &mut [bool], tints: &mut [Rgb]) {
        let Some(sheets) = &self.sheets else { return };
        let mut layers = sheets.layers();
        for (i, blocked) in blocked.iter_mut().enumerate().filter(|(_, blocked)| !**blocked) {
            let (ray, length) = way(i);
            let share = sheets.transmittance(&ray, length, self.largest, self.offset, &mut layers);
            let mean = mean_share(share);
            *blocked = chance(&ray) >= mean;
            if let Some(tint) = tints.get_mut(i).filter(|_| mean > 0.0) {
                *tint = share / mean;
            }
        }
    }

    /// Tells `answer` whether anything solid lies within each segment.
    fn solid_between(&self, segments: &[Segment], mut answer: impl FnMut(usize, bool)) {
        let query = |i: usize| {
            let (Ray { origin, direction }, length) = ray_of(&segments[i]);
            (origin, direction, length)
        };
        self.path.each::<true>(&self.batch(segments.len()), query, |i, _, nearest| answer(i, nearest.is_some()));
    }

    /// Tells `answer` whether each ray hits anything solid.
    fn solid_along(&self, rays: &[Ray], mut answer: impl FnMut(usize, bool)) {
        let query = |i: usize| (rays[i].origin, rays[i].direction, f32::INFINITY);
        self.path.each::<true>(&self.batch(rays.len()), query, |i, _, nearest| answer(i, nearest.is_some()));
    }

    /// Calls `visit(triangle, back)` for every solid triangle along a ray, in no order.
    pub fn crossings(&self, ray: &Ray, mut visit: impl FnMut(u32, bool)) {
        let line = Line::new(ray.origin, ray.direction, self.largest);
        let mut stack = traverse::stack(&self.wide);
        traverse::crossings(&self.wide, &line, f32::INFINITY, &mut stack, |number, crossing| {
            visit(number, !crossing.front);
        });
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

/// A segment as a ray, and its length [m].
#[inline(always)]
fn ray_of(segment: &Segment) -> (Ray, f32) {
    let way = segment.to - segment.from;
    let length = way.length();
    (Ray { origin: segment.from, direction: way / length }, length)
}
