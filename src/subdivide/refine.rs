//! One level of refinement.
//!
//! The vertices of the next level are those of this one, then one an edge, then, but for Loop, one a face.

use super::adjacency::{Adjacency, Edge, NO_FACE};
use super::cage::{Cage, INFINITE, Scheme, TriangleRule, Values};
use std::f32::consts::TAU;

/// Weight of a triangle in the mask of its edges under [`TriangleRule::Smooth`]: it was fitted, not derived (OpenSubdiv's
/// documentation of the smooth rule).
const SMOOTH_TRIANGLE: f32 = 0.47;

/// A sharpness one level down.
fn softer(sharpness: f32) -> f32 {
    if sharpness >= INFINITE { INFINITE } else { (sharpness - 1.0).max(0.0) }
}

/// Weights of Loop's mask around a vertex of valence `n`: on each neighbour.
pub(super) fn loop_weight(n: usize) -> f32 {
    let c = 0.375 + 0.25 * (TAU / n as f32).cos();
    (0.625 - c * c) / n as f32
}

/// Which mask a vertex takes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Rule {
    /// No sharp edge, or the end of one.
    Smooth,
    Crease,
    Corner,
}

impl Rule {
    fn of(vertex_sharpness: f32, sharp_edges: u32) -> Self {
        match sharp_edges {
            _ if vertex_sharpness > 0.0 => Self::Corner,
            0 | 1 => Self::Smooth,
            2 => Self::Crease,
            _ => Self::Corner,
        }
    }
}

/// What the masks of a vertex need to know of the edges around it.
#[derive(Clone, Copy, Default)]
struct Around {
    edge_count: u32,
    /// Sharp edges now, and those of them that stay sharp on the next level.
    sharp: u32,
    still_sharp: u32,
    /// Sharpness of what is sharp now and smooth then, and how many there are.
    fading: f32,
    fading_count: u32,
}

impl Cage {
    /// The cage one level down, and `smooth` (values that follow the scheme) and `linear` ones (which are split alone)
    /// refined with it. Rows must be as many as vertices. `None` where indices would no longer fit.
    pub fn refine(&self, smooth: &mut [Values], linear: &mut [Values]) -> Option<Cage> {
        let adjacency = Adjacency::new(self);
        let faces = if self.rules.scheme == Scheme::Loop { 0 } else { self.face_count() };
        let count = self.vertex_count().checked_add(adjacency.edges.len())?.checked_add(faces)?;
        u32::try_from(count).ok().zip(u32::try_from(self.corners.len().checked_mul(4)?).ok())?;
        for values in smooth {
            *values = match self.rules.scheme {
                Scheme::Bilinear => self.split_values(values, &adjacency),
                _ => self.smooth_values(values, &adjacency),
            };
        }
        for values in linear {
            *values = self.split_values(values, &adjacency);
        }
        Some(self.split(&adjacency, count))
    }

    /// The topology one level down, of `vertex_count` vertices.
    fn split(&self, adjacency: &Adjacency, vertex_count: usize) -> Cage {
        let (vertices, edges) = (self.vertex_count() as u32, adjacency.edges.len() as u32);
        let mut next = Cage {
            rules: self.rules,
            first: vec![0],
            corners: Vec::with_capacity(self.corners.len() * 4),
            edge_sharpness: Vec::with_capacity(self.corners.len() * 4),
            vertex_sharpness: self.vertex_sharpness.iter().map(|&s| softer(s)).collect(),
            parents: Vec::with_capacity(self.corners.len()),
            hidden: self.hidden.clone(),
        };
        next.vertex_sharpness.resize(vertex_count, 0.0);
        for f in 0..self.face_count() {
            let edge_vertex = |corner: usize| vertices + adjacency.edge_of_corner[corner];
            let sharpness =
                |corner: usize| softer(adjacency.edges[adjacency.edge_of_corner[corner] as usize].sharpness);
            let mut push = |corners: &[u32], sharpness: &[f32]| {
                next.corners.extend(corners);
                next.edge_sharpness.extend(sharpness);
                next.first.push(next.corners.len() as u32);
                next.parents.push(self.parents[f]);
            };
            for corner in self.face(f) {
                let before = self.previous(f, corner);
                let [v, to, from] = [self.corners[corner], edge_vertex(corner), edge_vertex(before)];
                if self.rules.scheme == Scheme::Loop {
                    push(&[v, to, from], &[sharpness(corner), 0.0, sharpness(before)]);
                } else {
                    push(
                        &[v, to, vertices + edges + f as u32, from],
                        &[sharpness(corner), 0.0, 0.0, sharpness(before)],
                    );
                }
            }
            if self.rules.scheme == Scheme::Loop {
                let middle: Vec<u32> = self.face(f).map(edge_vertex).collect();
                push(&middle, &[0.0; 3]);
            }
        }
        next
    }

    /// Averages of the corners of each face.
    fn face_values(&self, values: &Values) -> Values {
        let mut out = Values::zeros(values.width, self.face_count());
        for f in 0..self.face_count() {
            let weight = 1.0 / self.face(f).len() as f32;
            self.face(f).for_each(|corner| out.add(f, values, self.corners[corner] as usize, weight));
        }
        out
    }

    fn split_values(&self, values: &Values, adjacency: &Adjacency) -> Values {
        let mut out = Values { width: values.width, data: values.data.clone() };
        for edge in &adjacency.edges {
            let [a, b] = edge.ends.map(|v| v as usize);
            out.data.extend(values.row(a).iter().zip(values.row(b)).map(|(a, b)| 0.5 * (a + b)));
        }
        if self.rules.scheme != Scheme::Loop {
            out.data.extend(self.face_values(values).data);
        }
        out
    }

    fn smooth_values(&self, values: &Values, adjacency: &Adjacency) -> Values {
        let face_values = if self.rules.scheme == Scheme::Loop { Values::default() } else { self.face_values(values) };
        let mut out = self.vertex_values(values, &face_values, adjacency);
        let mut smooth = Values::zeros(values.width, 1);
        for edge in &adjacency.edges {
            let [a, b] = edge.ends.map(|v| v as usize);
            let crease = if edge.faces[1] == NO_FACE || edge.is_tangled { 1.0 } else { edge.sharpness.clamp(0.0, 1.0) };
            smooth.data.fill(0.0);
            if crease < 1.0 {
                self.edge_mask(edge, values, &face_values, &mut smooth);
            }
            let middle = values.row(a).iter().zip(values.row(b)).map(|(a, b)| 0.5 * (a + b));
            out.data.extend(middle.zip(&smooth.data).map(|(m, s)| crease * m + (1.0 - crease) * s));
        }
        out.data.extend(face_values.data);
        out
    }

    /// The smooth mask of `edge`, between two faces, into the only row of `out`.
    fn edge_mask(&self, edge: &Edge, values: &Values, face_values: &Values, out: &mut Values) {
        let [a, b] = edge.ends.map(|v| v as usize);
        if self.rules.scheme == Scheme::Loop {
            [a, b].iter().for_each(|&v| out.add(0, values, v, 0.375));
            for (&f, &corner) in edge.faces.iter().zip(&edge.corners) {
                let opposite = self.corners[self.previous(f as usize, corner as usize)];
                out.add(0, values, opposite as usize, 0.125);
            }
            return;
        }
        let is_smoothed = |f: u32| self.rules.triangles == TriangleRule::Smooth && self.face(f as usize).len() == 3;
        let of_face = edge.faces.map(|f| if is_smoothed(f) { SMOOTH_TRIANGLE } else { 0.25 });
        let face_weight = 0.5 * (of_face[0] + of_face[1]);
        [a, b].iter().for_each(|&v| out.add(0, values, v, 0.5 - face_weight));
        edge.faces.iter().for_each(|&f| out.add(0, face_values, f as usize, face_weight));
    }

    /// The vertices of this level on the next.
    fn vertex_values(&self, values: &Values, face_values: &Values, adjacency: &Adjacency) -> Values {
        let n = self.vertex_count();
        let around = self.around(adjacency);
        // Sums over neighbours along edges: all, sharp ones, those that stay sharp; and over faces.
        let mut sums = [(); 4].map(|()| Values::zeros(values.width, n));
        let [all, sharp, still_sharp, of_faces] = &mut sums;
        for edge in adjacency.edges.iter().filter(|e| e.ends[0] != e.ends[1]) {
            for (v, other) in [(edge.ends[0], edge.ends[1]), (edge.ends[1], edge.ends[0])] {
                let (v, other) = (v as usize, other as usize);
                all.add(v, values, other, 1.0);
                if edge.sharpness > 0.0 {
                    sharp.add(v, values, other, 1.0);
                }
                if softer(edge.sharpness) > 0.0 {
                    still_sharp.add(v, values, other, 1.0);
                }
            }
        }
        if self.rules.scheme != Scheme::Loop {
            for f in 0..self.face_count() {
                self.face(f).for_each(|corner| of_faces.add(self.corners[corner] as usize, face_values, f, 1.0));
            }
        }
        let mut out = Values::zeros(values.width, n);
        for (v, near) in around.iter().enumerate() {
            let before = Rule::of(self.vertex_sharpness[v], near.sharp);
            let after = Rule::of(softer(self.vertex_sharpness[v]), near.still_sharp);
            let share = if before == after || near.fading_count == 0 {
                1.0
            } else {
                (near.fading / near.fading_count as f32).min(1.0)
            };
            for (rule, weight, creases) in [(before, share, &*sharp), (after, 1.0 - share, &*still_sharp)] {
                if weight > 0.0 {
                    self.vertex_mask(v, rule, weight, near, values, [all, creases, of_faces], &mut out);
                }
            }
        }
        out
    }

    /// Adds `weight` times the mask of vertex `v` to its row of `out`. `sums`: over neighbours, those along sharp edges,
    /// and faces.
    #[expect(clippy::too_many_arguments, reason = "one mask, its vertex and its sums")]
    fn vertex_mask(
        &self,
        v: usize,
        rule: Rule,
        weight: f32,
        near: &Around,
        values: &Values,
        [all, creases, of_faces]: [&Values; 3],
        out: &mut Values,
    ) {
        let n = near.edge_count as f32;
        match rule {
            Rule::Crease => {
                out.add(v, values, v, 0.75 * weight);
                out.add(v, creases, v, 0.125 * weight);
            }
            Rule::Smooth if near.edge_count >= 2 && self.rules.scheme == Scheme::Loop => {
                let each = loop_weight(near.edge_count as usize);
                out.add(v, values, v, (1.0 - n * each) * weight);
                out.add(v, all, v, each * weight);
            }
            Rule::Smooth if near.edge_count >= 2 => {
                out.add(v, values, v, (n - 2.0) / n * weight);
                out.add(v, all, v, weight / (n * n));
                out.add(v, of_faces, v, weight / (n * n));
            }
            Rule::Corner | Rule::Smooth => out.add(v, values, v, weight),
        }
    }

    /// What lies around each vertex.
    fn around(&self, adjacency: &Adjacency) -> Vec<Around> {
        let mut around = vec![Around::default(); self.vertex_count()];
        for edge in &adjacency.edges {
            let still_sharp = softer(edge.sharpness) > 0.0;
            // An edge from a vertex to itself is none.
            for v in edge.ends.iter().filter(|_| edge.ends[0] != edge.ends[1]) {
                let near = &mut around[*v as usize];
                near.edge_count += 1;
                near.sharp += u32::from(edge.sharpness > 0.0);
                near.still_sharp += u32::from(still_sharp);
                if edge.sharpness > 0.0 && !still_sharp {
                    near.fading += edge.sharpness;
                    near.fading_count += 1;
                }
            }
        }
        for (near, &sharpness) in around.iter_mut().zip(&self.vertex_sharpness) {
            if sharpness > 0.0 && softer(sharpness) == 0.0 {
                near.fading += sharpness;
                near.fading_count += 1;
            }
        }
        around
    }
}
