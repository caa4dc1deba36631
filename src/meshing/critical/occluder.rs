//! Triangles that block light, welded across surfaces, and the edges that may be silhouettes.

use crate::scene::Scene;
use crate::trace::Tracer;
use glam::DVec3;
use rayon::prelude::*;

/// Faces that bend less than this [rad] at an edge are one plane: their edge is no silhouette.
const FLAT: f64 = 1e-4;

/// The triangles of a scene with the points that they share.
pub struct Occluders {
    /// World corners [m] of each triangle by the tracer's number, counter-clockwise.
    pub corners: Vec<[DVec3; 3]>,
    /// Numbers of the places where the corners lie, the same for all corners at one place.
    pub places: Vec<[u32; 3]>,
    /// Whether the triangle stops light.
    pub blocks: Vec<bool>,
    /// Position of each place [m].
    pub points: Vec<DVec3>,
    /// Edges that bend or end, by the numbers of their places.
    pub edges: Vec<Edge>,
    /// For each place, where the numbers of its edges begin in `edges_at`; one more at the end.
    first_edge: Vec<u32>,
    edges_at: Vec<u32>,
    /// Places opposite the edges.
    opposite: Vec<u32>,
}

/// An edge of triangles that block.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// The places of its ends, the lower number first.
    pub ends: [u32; 2],
    /// One of its triangles, by the tracer's number.
    pub triangle: u32,
    first: u32,
    count: u32,
}

impl Occluders {
    /// Gathers the triangles that `tracer` knows. Cost: O(n log n), about 0.3 s of processor time for 250,000
    /// triangles.
    pub fn new(scene: &Scene, tracer: &Tracer) -> Self {
        let count = tracer.triangle_count();
        let corners: Vec<[glam::Vec3; 3]> = (0..count as u32)
            .into_par_iter()
            .map(|number| {
                let (surface, triangle) = tracer.place(number);
                // Adding zero makes -0 and 0 one place.
                scene.world_triangle(surface, triangle).map(|p| p + 0.0)
            })
            .collect();
        let clear: Vec<bool> = scene.materials.iter().map(|m| m.lets_light_through()).collect();
        let stops = |number: u32| {
            let (surface, triangle) = tracer.place(number);
            let placed = &scene.surfaces[surface];
            placed.role.casts && !clear[scene.meshes[placed.mesh].triangle_material[triangle] as usize]
        };
        let blocks: Vec<bool> = (0..count as u32).into_par_iter().map(stops).collect();
        let (places, points) = weld(&corners);
        let corners = corners.into_par_iter().map(|t| t.map(|p| p.as_dvec3())).collect();
        let mut occluders = Self {
            corners,
            places,
            blocks,
            points,
            edges: Vec::new(),
            first_edge: Vec::new(),
            edges_at: Vec::new(),
            opposite: Vec::new(),
        };
        occluders.find_edges();
        occluders
    }

    fn find_edges(&mut self) {
        let sides = |number: usize| {
            let t = self.places[number];
            let side = move |k: usize| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                (a.min(b), a.max(b), t[(k + 2) % 3], number as u32)
            };
            (0..3).map(side).filter(|(a, b, ..)| a != b)
        };
        let mut all: Vec<(u32, u32, u32, u32)> =
            (0..self.places.len()).into_par_iter().filter(|t| self.blocks[*t]).flat_map_iter(sides).collect();
        all.par_sort_unstable();
        for group in all.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let (a, b, _, triangle) = group[0];
            if let [x, y] = group
                && self.is_flat([a, b], [x.2, y.2])
            {
                continue;
            }
            let first = self.opposite.len() as u32;
            self.opposite.extend(group.iter().map(|side| side.2));
            self.edges.push(Edge { ends: [a, b], triangle, first, count: group.len() as u32 });
        }
        let mut first = vec![0u32; self.points.len() + 1];
        self.edges.iter().flat_map(|e| e.ends).for_each(|p| first[p as usize + 1] += 1);
        for p in 1..first.len() {
            first[p] += first[p - 1];
        }
        let mut next = first.clone();
        self.edges_at = vec![0; 2 * self.edges.len()];
        for (i, p) in self.edges.iter().enumerate().flat_map(|(i, e)| e.ends.map(|p| (i, p))) {
            self.edges_at[next[p as usize] as usize] = i as u32;
            next[p as usize] += 1;
        }
        self.first_edge = first;
    }

    /// True where two faces at an edge go on in one plane.
    fn is_flat(&self, ends: [u32; 2], opposite: [u32; 2]) -> bool {
        let [a, b] = ends.map(|p| self.points[p as usize]);
        let along = (b - a).normalize_or_zero();
        let [x, y] = opposite.map(|p| (self.points[p as usize] - a).reject_from(along));
        x.cross(y).length() <= FLAT * x.length() * y.length() && x.dot(y) < 0.0
    }

    /// The ends of an edge [m].
    pub fn ends(&self, edge: &Edge) -> [DVec3; 2] {
        edge.ends.map(|p| self.points[p as usize])
    }

    /// The edges that meet at a place.
    pub fn edges_at(&self, place: u32) -> impl Iterator<Item = &Edge> {
        let [from, to] = [place, place + 1].map(|p| self.first_edge[p as usize] as usize);
        self.edges_at[from..to].iter().map(|i| &self.edges[*i as usize])
    }

    /// The places opposite an edge, of all its triangles.
    pub fn opposite(&self, edge: &Edge) -> impl Iterator<Item = DVec3> {
        let range = edge.first as usize..(edge.first + edge.count) as usize;
        self.opposite[range].iter().map(|p| self.points[*p as usize])
    }

    /// The unit normal of the plane through `edge` whose light travels along `way` (any length) there, away from the
    /// edge's faces; `None` where the edge is no silhouette seen so, or is seen end on.
    pub fn free_side(&self, edge: &Edge, way: DVec3) -> Option<DVec3> {
        let [a, b] = self.ends(edge);
        let along = (b - a).normalize_or_zero();
        let across = along.cross(way.normalize_or_zero());
        let normal = across.try_normalize().filter(|_| across.length_squared() > 1e-10)?;
        let mut side = 0.0f64;
        for opposite in self.opposite(edge) {
            let lever = opposite - a;
            let height = normal.dot(lever);
            // A face in the plane of the wedge is on neither side.
            if height.abs() <= 1e-6 * lever.reject_from(along).length() {
                continue;
            }
            if side * height < 0.0 {
                return None;
            }
            side = height.signum();
        }
        (side != 0.0).then(|| normal * -side)
    }
}

/// Numbers the places where corners lie, in the order of their bits.
fn weld(corners: &[[glam::Vec3; 3]]) -> (Vec<[u32; 3]>, Vec<DVec3>) {
    let mut order: Vec<([u32; 3], u32)> = corners
        .as_flattened()
        .par_iter()
        .enumerate()
        .map(|(i, p)| (p.to_array().map(f32::to_bits), i as u32))
        .collect();
    order.par_sort_unstable();
    let (mut places, mut points) = (vec![[0; 3]; corners.len()], Vec::new());
    for place in order.chunk_by(|a, b| a.0 == b.0) {
        for (_, corner) in place {
            places[*corner as usize / 3][*corner as usize % 3] = points.len() as u32;
        }
        points.push(corners.as_flattened()[place[0].1 as usize].as_dvec3());
    }
    (places, points)
}
