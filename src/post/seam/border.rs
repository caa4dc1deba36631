//! The edges of charts in space, and which of them lie on one another.

use super::Place;
use crate::light::Lit;
use crate::scene::Mesh;
use crate::unwrap::MeshUvs;
use glam::{IVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Cosine of the largest angle between shown normals of what looks like one smooth surface: 10 degrees.
const SMOOTH_COS: f32 = 0.984_807_7;

/// Faces that meet at a seam go on on its other side: cosine between the directions into them, at most.
const OPPOSITE: f32 = -0.2;

/// How far apart edges may lie that are taken for one [texels].
const TOUCHING: f32 = 0.05;

/// An edge of a chart.
#[derive(Clone, Debug)]
pub struct Border {
    pub surface: u32,
    pub material: u32,
    page: u32,
    /// World positions of the ends [m].
    ends: [Vec3; 2],
    /// The ends on their page [texels].
    pub at: [Vec2; 2],
    /// Into the triangle, along its plane, unit.
    pub inward: Vec3,
    /// Geometric normal, unit.
    pub face: Vec3,
    /// Shown normals at the ends, unit.
    normals: [Vec3; 2],
    /// Size of a texel along the edge [m].
    pub texel: f32,
}

impl Border {
    /// The point at `s`, 0..=1, along the edge [m].
    pub fn point(&self, s: f32) -> Vec3 {
        self.ends[0].lerp(self.ends[1], s)
    }

    /// Where that lies on its page.
    pub fn place(&self, s: f32) -> Place {
        Place { page: self.page, at: self.at[0].lerp(self.at[1], s) }
    }

    fn normal(&self, s: f32) -> Vec3 {
        self.normals[0].lerp(self.normals[1], s).normalize_or_zero()
    }

    /// The place along the edge that is nearest to `point`, and how far it is.
    fn nearest(&self, point: Vec3) -> (f32, f32) {
        let along = self.ends[1] - self.ends[0];
        let s = ((point - self.ends[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (s, self.point(s).distance(point))
    }
}

/// The edges of all charts of surfaces that receive light.
pub fn borders(lit: &Lit) -> Vec<Border> {
    let (scene, atlas) = (lit.ground.scene, lit.ground.atlas);
    let used: Vec<bool> =
        (0..scene.meshes.len()).map(|m| scene.surfaces.iter().any(|s| s.mesh == m && s.role.receives)).collect();
    let edges: Vec<Vec<(usize, usize)>> = (scene.meshes.par_iter().zip(&atlas.meshes).zip(&used))
        .map(|((mesh, uvs), used)| if *used { edges(mesh, uvs) } else { Vec::new() })
        .collect();
    let of_surface = |s: usize| -> Vec<Border> {
        let surface = &scene.surfaces[s];
        if !surface.role.receives {
            return Vec::new();
        }
        edges[surface.mesh].iter().filter_map(|&(t, k)| border(lit, s, t, k)).collect()
    };
    (0..scene.surfaces.len()).into_par_iter().map(of_surface).collect::<Vec<_>>().concat()
}

/// The edges (triangle, its first corner) of a mesh that only one triangle of a chart has.
fn edges(mesh: &Mesh, uvs: &MeshUvs) -> Vec<(usize, usize)> {
    let key = |t: usize, k: usize| {
        let corner = |k: usize| uvs.corners[t][k % 3].to_array().map(f32::to_bits);
        let (a, b) = (corner(k), corner(k + 1));
        (uvs.chart[t], a.min(b), a.max(b))
    };
    let all = || (0..mesh.triangles.len().min(uvs.corners.len())).flat_map(|t| [(t, 0), (t, 1), (t, 2)]);
    let mut count: HashMap<_, u32> = HashMap::new();
    for (t, k) in all() {
        *count.entry(key(t, k)).or_default() += 1;
    }
    all().filter(|&(t, k)| count[&key(t, k)] == 1).collect()
}

/// The edge from corner `k` of triangle `t` of a surface; `None` where it has no length.
fn border(lit: &Lit, s: usize, t: usize, k: usize) -> Option<Border> {
    let (scene, atlas) = (lit.ground.scene, lit.ground.atlas);
    let surface = &scene.surfaces[s];
    let mesh = &scene.meshes[surface.mesh];
    let corner = |k: usize| mesh.triangles[t][k % 3] as usize;
    let world = |k: usize| surface.world_from_local.transform_point3(mesh.positions[corner(k)]);
    let [a, b, c] = [world(k), world(k + 1), world(k + 2)];
    let page_texels = atlas.page_texels(s, surface.mesh, t);
    let at = [page_texels[k], page_texels[(k + 1) % 3]];
    let along = (b - a).try_normalize()?;
    let inward = (c - a).reject_from(along).try_normalize()?;
    let side = if surface.is_mirrored() { -1.0 } else { 1.0 };
    let face = side * (b - a).cross(c - a).try_normalize()?;
    let matrix = Mat3::from(surface.world_from_local.matrix3);
    let to_normal = matrix.inverse().transpose();
    let normal = |k: usize| {
        let authored = mesh.normals.get(corner(k)).filter(|_| lit.params.shading_normals);
        authored.and_then(|n| (to_normal * *n).try_normalize()).unwrap_or(face)
    };
    let (length, texels) = (a.distance(b), at[0].distance(at[1]));
    (length > 0.0 && texels > 0.0).then(|| Border {
        surface: s as u32,
        material: mesh.triangle_material[t],
        page: atlas.placements[s].page,
        ends: [a, b],
        at,
        inward,
        face,
        normals: [normal(k), normal(k + 1)],
        texel: length / texels,
    })
}

/// Side of a cell over the mean length of edges.
const CELL: f64 = 0.125;

/// Edges by the cells of space that they pass through.
pub struct Grid {
    cell: f32,
    edges: HashMap<IVec3, Vec<u32>>,
}

impl Grid {
    /// Sorts `borders` into cells of [`CELL`] times their mean length.
    pub fn new(borders: &[Border]) -> Self {
        let total: f64 = borders.iter().map(|b| f64::from(b.ends[0].distance(b.ends[1]))).sum();
        let widest = borders.iter().map(|b| b.texel).fold(0.0, f32::max);
        let largest = borders.iter().flat_map(|b| b.ends).map(|p| p.abs().max_element()).fold(0.0, f32::max);
        // Cells must hold what touches, and be counted in whole numbers; long edges pass through many, so that small ones have few beside
        // them.
        let least = (4.0 * TOUCHING * widest).max(largest * 1e-6).max(f32::MIN_POSITIVE);
        let cell = ((CELL * total / borders.len().max(1) as f64) as f32).max(least);
        let mut edges: HashMap<IVec3, Vec<u32>> = HashMap::new();
        for (e, border) in borders.iter().enumerate() {
            let steps = (2.0 * border.ends[0].distance(border.ends[1]) / cell).ceil().max(1.0) as usize;
            for step in 0..=steps {
                let place = (border.point(step as f32 / steps as f32) / cell).floor().as_ivec3();
                let list = edges.entry(place).or_default();
                if list.last() != Some(&(e as u32)) {
                    list.push(e as u32);
                }
            }
        }
        Self { cell, edges }
    }

    /// The border that lies on border `e` at its `point` at `s` and goes on on the other side, and where along it; of several the
    /// one whose normal differs least.
    pub fn facing(
        &self,
        borders: &[Border],
        e: usize,
        s: f32,
        point: Vec3,
        is_one: &dyn Fn(&Border, &Border) -> bool,
    ) -> Option<(usize, f32)> {
        let own = &borders[e];
        let normal = own.normal(s);
        let first = (point / self.cell - 0.5).floor().as_ivec3();
        let mut best: Option<(f32, usize, f32)> = None;
        for corner in 0..8 {
            let cell = first + IVec3::new(corner & 1, (corner >> 1) & 1, corner >> 2);
            for f in self.edges.get(&cell).into_iter().flatten().map(|f| *f as usize) {
                let other = &borders[f];
                if f == e || !is_one(own, other) || own.inward.dot(other.inward) > OPPOSITE {
                    continue;
                }
                let (t, distance) = other.nearest(point);
                if distance > TOUCHING * own.texel.min(other.texel) {
                    continue;
                }
                let alike = normal.dot(other.normal(t));
                let is_better = best.is_none_or(|(a, g, _)| alike > a || alike == a && f < g);
                if alike >= SMOOTH_COS && is_better {
                    best = Some((alike, f, t));
                }
            }
        }
        best.map(|(_, f, t)| (f, t))
    }
}
