//! The tracer on the processor: obvhs' compressed wide BVH with our watertight triangles.

use super::watertight::Shear;
use super::{Hit, Ray, Segment};
use crate::scene::Scene;
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::{Ray as BoxRay, RayHit};
use obvhs::{Boundable, BvhBuildParams};
use std::time::Duration;

/// All triangles of a scene, ready to be hit.
pub struct Tracer {
    bvh: CwBvh,
    /// World corners in the BVH's leaf order, counter-clockwise seen from the front.
    corners: Vec<[[f32; 3]; 3]>,
    /// Leaf order to triangle number.
    number: Vec<u32>,
    /// The first triangle number of each surface, and the count at the end.
    first: Vec<u32>,
    /// Surface of each triangle number.
    surface: Vec<u32>,
    mirrored: Vec<bool>,
    /// Distance by which ray origins are kept off surfaces [m].
    offset: f32,
    /// BVH units per metre, a power of two.
    scale: f32,
}

/// The padding of a triangle's box, relative to the scene's largest coordinate: a few units in the last place, so that the
/// box test, which rounds, never loses a ray that the exact triangle test would take.
const BOX_PADDING: f32 = 4.0 * f32::EPSILON;

/// The offset of ray origins, relative to the scene's largest coordinate: well above the rounding of a point computed from
/// corners and weights (about 4 ulp), well below anything a lightmap texel shows.
const ORIGIN_OFFSET: f32 = 64.0 * f32::EPSILON;

/// The scene's largest coordinate in the BVH's units, about. obvhs takes no box that a ray leaves before t = 1e-4: in these
/// units that is a tenth of [`ORIGIN_OFFSET`], in metres it would lose walls right beside a ray's origin.
const BOX_EXTENT: f32 = 128.0;

struct PaddedBox(Aabb);

impl Boundable for PaddedBox {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Tracer {
    /// Builds the BVH over the surfaces of `scene`. Cost: about a second a million triangles.
    pub fn new(scene: &Scene) -> Self {
        let mut first = Vec::with_capacity(scene.surfaces.len() + 1);
        let (mut corners, mut surface) = (Vec::new(), Vec::new());
        for (s, placed) in scene.surfaces.iter().enumerate() {
            first.push(corners.len() as u32);
            for t in 0..scene.meshes[placed.mesh].triangles.len() {
                corners.push(scene.world_triangle(s, t).map(|p| p.to_array()));
                surface.push(s as u32);
            }
        }
        first.push(corners.len() as u32);
        let largest = corners.iter().flatten().flatten().fold(0.0f32, |m, c| m.max(c.abs()));
        let scale = (BOX_EXTENT / largest.max(f32::MIN_POSITIVE)).log2().ceil().clamp(-100.0, 100.0).exp2();
        let padding = Vec3A::splat(largest * scale * BOX_PADDING);
        let boxes: Vec<PaddedBox> = corners
            .iter()
            .map(|t| {
                let mut aabb = Aabb::from_points(&t.map(|p| Vec3A::from_array(p) * scale));
                aabb.min -= padding;
                aabb.max += padding;
                PaddedBox(aabb)
            })
            .collect();
        let bvh = build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        let number = bvh.primitive_indices.clone();
        let corners = number.iter().map(|&i| corners[i as usize]).collect();
        let mirrored = scene.surfaces.iter().map(|s| s.is_mirrored()).collect();
        Self { bvh, corners, number, first, surface, mirrored, offset: largest * ORIGIN_OFFSET, scale }
    }

    /// Triangle count over all surfaces.
    pub fn triangle_count(&self) -> usize {
        self.surface.len()
    }

    /// Surface, and triangle within its mesh, of triangle number `triangle`.
    pub fn place(&self, triangle: u32) -> (usize, usize) {
        let s = self.surface[triangle as usize];
        (s as usize, (triangle - self.first[s as usize]) as usize)
    }

    /// Number of triangle `triangle` of `surface`'s mesh.
    pub fn number(&self, surface: usize, triangle: usize) -> u32 {
        self.first[surface] + triangle as u32
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
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_one(ray);
        }
    }

    /// Whether anything lies within each segment; `blocked` has the length of `segments`.
    pub fn occluded(&self, segments: &[Segment], blocked: &mut [bool]) {
        assert_eq!(segments.len(), blocked.len());
        for (segment, blocked) in segments.iter().zip(blocked) {
            let way = segment.to - segment.from;
            let length = way.length();
            *blocked = length > 0.0 && self.any_within(segment.from, way / length, length);
        }
    }

    /// Whether each ray hits anything at all; `blocked` has the length of `rays`.
    pub fn occluded_rays(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len());
        for (ray, blocked) in rays.iter().zip(blocked) {
            *blocked = self.any_within(ray.origin, ray.direction, f32::INFINITY);
        }
    }

    /// Calls `visit(triangle, back)` for every triangle along a ray, in no order.
    pub fn crossings(&self, ray: &Ray, mut visit: impl FnMut(u32, bool)) {
        let shear = Shear::new(ray.origin, ray.direction);
        self.bvh.ray_traverse_anyhit(self.box_ray(ray.origin, ray.direction, f32::INFINITY), |_, leaf| {
            if let Some(crossing) = shear.intersect(&self.corners[leaf]) {
                visit(self.number[leaf], !crossing.front);
            }
        });
    }

    fn closest_one(&self, ray: &Ray) -> Option<Hit> {
        let shear = Shear::new(ray.origin, ray.direction);
        let box_ray = self.box_ray(ray.origin, ray.direction, f32::INFINITY);
        let mut best: Option<Hit> = None;
        self.bvh.ray_traverse(box_ray, &mut RayHit::none(), |_, leaf| {
            let Some(crossing) = shear.intersect(&self.corners[leaf]) else { return f32::INFINITY };
            let triangle = self.number[leaf];
            // Walls of two rooms back to back lie in one plane; a ray in either room must meet the wall that faces it. So
            // backs count as a little farther. Of triangles at one distance the lowest number wins, whatever the tree's order.
            let t = if crossing.front { crossing.t } else { crossing.t + self.offset };
            let nearer = best.is_none_or(|b| t < b.t || (t == b.t && triangle < b.triangle));
            if !nearer {
                return f32::INFINITY;
            }
            let [v, w] = crossing.barycentric;
            let barycentric = if self.mirrored[self.surface[triangle as usize] as usize] { [w, v] } else { [v, w] };
            best = Some(Hit { t, triangle, barycentric, back: !crossing.front });
            t * self.scale
        });
        best
    }

    /// A ray in the BVH's units.
    fn box_ray(&self, origin: Vec3, direction: Vec3, length: f32) -> BoxRay {
        BoxRay::new((origin * self.scale).into(), direction.into(), 0.0, length * self.scale)
    }

    fn any_within(&self, origin: Vec3, direction: Vec3, length: f32) -> bool {
        let shear = Shear::new(origin, direction);
        let box_ray = self.box_ray(origin, direction, length);
        !self.bvh.ray_traverse_miss(box_ray, |_, leaf| match shear.intersect(&self.corners[leaf]) {
            Some(crossing) if crossing.t < length => crossing.t * self.scale,
            _ => f32::INFINITY,
        })
    }
}
