//! The polygons of an element: what its texels cover of each triangle, in as few convex pieces as there can be.
//!
//! A cluster of texels is a rectangle of the page or nearly so. So the part of a triangle in the box of the cluster's texels
//! is tried first; where it is larger than what the cluster has of the triangle, the box is halved (a quadtree's idea with
//! boxes that fit). A rectangle of a thousand texels on a quad becomes two triangles' parts.
//!
//! Cost: about a microsecond a texel, once an element. Limits: whole footprints count, their buried parts too.

use super::Elements;
use crate::patch::Ground;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// A convex planar polygon.
#[derive(Clone, Debug)]
pub struct Polygon {
    /// World corners [m], 3 to 7.
    pub corners: Vec<DVec3>,
    /// Unit, to the side that shines.
    pub normal: DVec3,
    /// Area [m^2].
    pub area: f64,
    /// Centroid [m].
    pub centre: DVec3,
    /// The largest distance of a corner from the centre [m].
    pub radius: f64,
}

/// All polygons of one element.
#[derive(Clone, Debug, Default)]
pub struct Outline {
    pub polygons: Vec<Polygon>,
    /// Area of all polygons [m^2]; the element's own, but for buried parts.
    pub area: f64,
    /// True where nothing of the element is buried.
    pub whole: bool,
}

/// Of the area in a box, this much may belong to other elements before the box is halved: rounding, no texel.
const TOLERANCE: f64 = 1e-5;

/// How far corners in single precision may lie off their plane, relative to the largest coordinate.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// One piece of a patch.
#[derive(Clone, Copy)]
struct Part {
    triangle: u32,
    texel: [u32; 2],
    area: f64,
}

impl Polygon {
    /// The polygon of `corners`, convex and in order, either way round.
    pub fn new(corners: Vec<DVec3>, normal: DVec3) -> Self {
        let o = corners[0];
        let (mut area, mut centre) = (0.0, DVec3::ZERO);
        for w in corners[1..].windows(2) {
            let a = 0.5 * (w[0] - o).cross(w[1] - o).length();
            area += a;
            centre += (o + w[0] + w[1]) / 3.0 * a;
        }
        let centre = if area > 0.0 { centre / area } else { o };
        let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
        Self { corners, normal, area, centre, radius }
    }

    /// The height of `point` over the plane [m].
    pub fn height(&self, point: DVec3) -> f64 {
        (point - self.centre).dot(self.normal)
    }

    /// Triangles that make it up.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.corners[1..].windows(2).map(|w| [self.corners[0], w[0], w[1]])
    }

    /// True where some of each lies in front of the other, by more than the rounding of the scene's positions.
    pub fn faces(&self, other: &Self) -> bool {
        let size = |p: &Self| p.centre.abs().max_element() + p.radius;
        let rounding = ROUNDING * size(self).max(size(other));
        let above = |a: &Self, b: &Self| b.corners.iter().any(|&c| a.height(c) > rounding);
        above(self, other) && above(other, self)
    }
}

impl Outline {
    /// The polygons of element `e`.
    pub fn new(elements: &Elements, ground: &Ground, e: usize) -> Self {
        let mut parts = Vec::new();
        for &patch in elements.members(e) {
            let [page, texel] = ground.patches.texel(patch as usize);
            let width = ground.atlas.pages[page as usize][0];
            let texel = [texel % width, texel / width];
            let pieces = ground.patches.pieces(patch as usize);
            parts.extend(pieces.map(|(triangle, area)| Part { triangle, texel, area: f64::from(area) }));
        }
        parts.sort_by_key(|p| p.triangle);
        let mut outline = Self::default();
        for group in parts.chunk_by_mut(|a, b| a.triangle == b.triangle) {
            let (surface, triangle) = ground.tracer.place(group[0].triangle);
            let [a, b, c] = ground.scene.world_triangle(surface, triangle).map(Vec3::as_dvec3);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            outline.add(ground, if elements.back[e] { -normal } else { normal }, group);
        }
        outline.area = outline.polygons.iter().map(|p| p.area).sum();
        outline.whole = f64::from(elements.area[e]) > 0.999 * outline.area;
        outline
    }

    /// The outlines of all elements.
    pub fn all(elements: &Elements, ground: &Ground) -> Vec<Self> {
        (0..elements.len()).into_par_iter().map(|e| Self::new(elements, ground, e)).collect()
    }

    /// Adds the parts of one triangle, as one polygon if they are all of it in their box.
    fn add(&mut self, ground: &Ground, normal: DVec3, parts: &mut [Part]) {
        let [mut low, mut high] = [[u32::MAX; 2], [0; 2]];
        for part in parts.iter() {
            for k in 0..2 {
                low[k] = low[k].min(part.texel[k]);
                high[k] = high[k].max(part.texel[k] + 1);
            }
        }
        let corners = ground.cut(parts[0].triangle, low, high);
        if corners.len() < 3 {
            return;
        }
        let polygon = Polygon::new(corners, normal);
        let area: f64 = parts.iter().map(|p| p.area).sum();
        let size = [high[0] - low[0], high[1] - low[1]];
        if polygon.area <= area * (1.0 + TOLERANCE) || size == [1, 1] {
            self.polygons.push(polygon);
            return;
        }
        let axis = usize::from(size[1] > size[0]);
        let middle = low[axis] + size[axis] / 2;
        parts.sort_by_key(|p| p.texel[axis] >= middle);
        let split = parts.partition_point(|p| p.texel[axis] < middle);
        let (left, right) = parts.split_at_mut(split);
        self.add(ground, normal, left);
        self.add(ground, normal, right);
    }
}

/// The outlines of elements, made when they are first asked for.
pub struct Outlines<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    made: Vec<OnceLock<Outline>>,
}

impl<'a> Outlines<'a> {
    /// None is made yet.
    pub fn new(elements: &'a Elements, ground: &'a Ground<'a>) -> Self {
        Self { elements, ground, made: vec![OnceLock::new(); elements.len()] }
    }

    /// The outline of element `e`.
    pub fn of(&self, e: usize) -> &Outline {
        self.made[e].get_or_init(|| Outline::new(self.elements, self.ground, e))
    }
}
