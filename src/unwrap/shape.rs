//! A mesh as the unwrapper sees it: welded, in metres, cut into polygons and connected parts.

use crate::scene::{Mesh, Scene};
use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// A mesh in the space that its charts are measured in.
#[derive(Debug)]
pub struct Shape<'a> {
    pub mesh: &'a Mesh,
    /// Vertex positions [m]: in world directions where one surface uses the mesh, else in local ones times the scale of the
    /// largest surface. The origin is the mesh's own.
    pub positions: Vec<DVec3>,
    /// Vertices with equal positions have equal numbers here: that of the first.
    pub welded: Vec<u32>,
    /// The polygon of each triangle, counted from 0 (see [`crate::scene::TriangleOrigin`]).
    pub polygon: Vec<u32>,
}

impl<'a> Shape<'a> {
    /// The shape of mesh `mesh` (index), used by `surfaces` (indices, at least one).
    pub fn new(scene: &'a Scene, mesh: usize, surfaces: &[usize]) -> Self {
        let source = &scene.meshes[mesh];
        let local: Vec<_> = source.positions.iter().map(|p| p.as_dvec3()).collect();
        let matrix = |s: usize| {
            let m = scene.surfaces[s].world_from_local.matrix3;
            DMat3::from_cols(m.x_axis.as_dvec3(), m.y_axis.as_dvec3(), m.z_axis.as_dvec3())
        };
        let area = |m: DMat3| -> f64 {
            let corners = source.triangles.iter().map(|t| t.map(|v| local[v as usize]));
            corners.map(|[a, b, c]| 0.5 * (m * (b - a)).cross(m * (c - a)).length()).sum()
        };
        let space = match surfaces {
            [one] => matrix(*one),
            _ => {
                let own = area(DMat3::IDENTITY);
                let largest = surfaces.iter().map(|&s| area(matrix(s))).fold(0.0, f64::max);
                DMat3::from_diagonal(DVec3::splat((largest / own).sqrt()))
            }
        };
        let positions = local.iter().map(|&p| space * p).collect();
        Self { mesh: source, positions, welded: weld(source), polygon: polygons(source) }
    }

    /// The corners of a triangle [m].
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.mesh.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// Twice the area of a triangle [m²] times its unit normal.
    pub fn cross(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// The area of a triangle [m²].
    pub fn area(&self, triangle: u32) -> f64 {
        0.5 * self.cross(triangle).length()
    }

    /// Pairs of positions in `triangles` that share an edge.
    pub fn neighbors(&self, triangles: &[u32]) -> Vec<[u32; 2]> {
        let mut edges = Vec::with_capacity(triangles.len() * 3);
        for (i, &t) in triangles.iter().enumerate() {
            let v = self.mesh.triangles[t as usize].map(|v| self.welded[v as usize]);
            for [a, b] in [[v[0], v[1]], [v[1], v[2]], [v[2], v[0]]] {
                edges.push((a.min(b), a.max(b), i as u32));
            }
        }
        edges.sort_unstable();
        edges.windows(2).filter(|w| w[0].0 == w[1].0 && w[0].1 == w[1].1).map(|w| [w[0].2, w[1].2]).collect()
    }

    /// The triangles cut into parts that are connected by edges and have one material, in order of their first triangle.
    pub fn parts(&self) -> Vec<Vec<u32>> {
        let all: Vec<u32> = (0..self.mesh.triangles.len() as u32).collect();
        let material = |t: u32| self.mesh.triangle_material[t as usize];
        let mut sets = Sets::new(all.len());
        // Three triangles at an edge can have two materials in turn, so that neighbours in the list don't tell it all; what
        // is missed only makes for more parts.
        for [a, b] in self.neighbors(&all) {
            if material(a) == material(b) {
                sets.join(a, b);
            }
        }
        sets.groups(&all)
    }
}

/// Disjoint sets of numbers.
pub struct Sets(Vec<u32>);

impl Sets {
    /// `count` sets of one number each.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The smallest number in `i`'s set.
    pub fn find(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            self.0[i as usize] = self.0[self.0[i as usize] as usize];
            i = self.0[i as usize];
        }
        i
    }

    /// Unites two sets.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// `items`, item i in the group of number i, groups in order of their first item.
    pub fn groups(&mut self, items: &[u32]) -> Vec<Vec<u32>> {
        let mut group_of = vec![u32::MAX; items.len()];
        let mut groups: Vec<Vec<u32>> = Vec::new();
        for (i, &item) in items.iter().enumerate() {
            let root = self.find(i as u32) as usize;
            if group_of[root] == u32::MAX {
                group_of[root] = groups.len() as u32;
                groups.push(Vec::new());
            }
            groups[group_of[root] as usize].push(item);
        }
        groups
    }
}

fn weld(mesh: &Mesh) -> Vec<u32> {
    let mut first = HashMap::with_capacity(mesh.positions.len());
    // Adding zero makes -0 and 0 one.
    let key = |i: usize| (mesh.positions[i] + 0.0).to_array().map(f32::to_bits);
    (0..mesh.positions.len()).map(|i| *first.entry(key(i)).or_insert(i as u32)).collect()
}

fn polygons(mesh: &Mesh) -> Vec<u32> {
    let mut number = HashMap::new();
    let mut polygon = Vec::with_capacity(mesh.origin.len());
    for o in &mesh.origin {
        let next = number.len() as u32;
        polygon.push(*number.entry((o.part, o.face)).or_insert(next));
    }
    polygon
}
