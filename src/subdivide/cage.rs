//! The mesh that is refined, and the rules that it is refined by.

use super::adjacency::{Adjacency, NO_FACE};

/// Sharpness from which an edge or vertex stays sharp for ever.
pub const INFINITE: f32 = 10.0;

/// How new vertices are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    CatmullClark,
    /// Triangles only.
    Loop,
    /// Faces are split, nothing is smoothed.
    Bilinear,
}

/// What edges of one face do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boundary {
    /// Faces at the boundary are hidden: they only shape the others.
    None,
    /// Boundary edges are sharp curves.
    EdgeOnly,
    /// So are vertices of one face sharp corners.
    #[default]
    EdgeAndCorner,
}

/// How Catmull-Clark treats triangles of the cage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TriangleRule {
    #[default]
    CatmullClark,
    /// Weights that make triangles smoother (the "smooth" rule of OpenSubdiv).
    Smooth,
}

/// The rules of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    pub scheme: Scheme,
    pub boundary: Boundary,
    pub triangles: TriangleRule,
}

/// Rows of `width` floats, one a vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    pub width: usize,
    pub data: Vec<f32>,
}

impl Values {
    /// Row `i`; it must be in range.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.width..(i + 1) * self.width]
    }

    /// `count` rows of zeros.
    pub(super) fn zeros(width: usize, count: usize) -> Self {
        Self { width, data: vec![0.0; width * count] }
    }

    pub(super) fn row_mut(&mut self, i: usize) -> &mut [f32] {
        &mut self.data[i * self.width..(i + 1) * self.width]
    }

    /// Adds `weight` times row `from` of `source` to row `to`.
    pub(super) fn add(&mut self, to: usize, source: &Values, from: usize, weight: f32) {
        for (a, b) in self.row_mut(to).iter_mut().zip(source.row(from)) {
            *a += weight * b;
        }
    }
}

/// A polygon mesh with sharpness, at any level.
#[derive(Clone, Debug)]
pub struct Cage {
    pub(super) rules: Rules,
    /// The first corner of each face, and the number of corners at the end.
    pub(super) first: Vec<u32>,
    /// The vertex of each corner.
    pub(super) corners: Vec<u32>,
    /// Sharpness of the edge from each corner to the next of its face.
    pub(super) edge_sharpness: Vec<f32>,
    pub(super) vertex_sharpness: Vec<f32>,
    /// The face of the first cage that each face lies in.
    pub(super) parents: Vec<u32>,
    /// Faces of the first cage that are not shown.
    pub(super) hidden: Vec<bool>,
}

impl Cage {
    /// The mesh of `counts.len()` faces with so many corners each, whose vertices are `corners`, below `vertex_count`.
    /// `creases`: pairs of vertices that an edge joins, and its sharpness; `sharp_vertices`: vertices and theirs; pairs
    /// and vertices that aren't there mean nothing. `holes`: faces that are not shown.
    ///
    /// `None` where a face has fewer than 3 corners, a corner is out of range, counts don't add up to the corners, or the
    /// scheme is Loop and a face is no triangle.
    pub fn new(
        rules: Rules,
        counts: &[u32],
        corners: Vec<u32>,
        vertex_count: usize,
        creases: &[([u32; 2], f32)],
        sharp_vertices: &[(u32, f32)],
        holes: &[u32],
    ) -> Option<Self> {
        let mut first = Vec::with_capacity(counts.len() + 1);
        let mut total = 0u32;
        for &count in counts {
            if count < 3 || rules.scheme == Scheme::Loop && count != 3 {
                return None;
            }
            first.push(total);
            total = total.checked_add(count)?;
        }
        first.push(total);
        if total as usize != corners.len() || corners.iter().any(|&v| v as usize >= vertex_count) {
            return None;
        }
        let mut hidden = vec![false; counts.len()];
        holes
            .iter()
            .filter_map(|&f| usize::try_from(f).ok())
            .for_each(|f| hidden.get_mut(f).into_iter().for_each(|h| *h = true));
        let mut vertex_sharpness = vec![0.0; vertex_count];
        for &(v, sharpness) in sharp_vertices {
            if let Some(known) = vertex_sharpness.get_mut(v as usize) {
                *known = sharpness.clamp(0.0, INFINITE);
            }
        }
        let mut cage = Self {
            rules,
            first,
            edge_sharpness: vec![0.0; corners.len()],
            corners,
            vertex_sharpness,
            parents: (0..counts.len() as u32).collect(),
            hidden,
        };
        cage.set_creases(creases);
        cage.sharpen_boundary();
        Some(cage)
    }

    pub fn face_count(&self) -> usize {
        self.first.len() - 1
    }

    pub fn vertex_count(&self) -> usize {
        self.vertex_sharpness.len()
    }

    /// The corners of face `f`, as indices.
    pub fn face(&self, f: usize) -> std::ops::Range<usize> {
        self.first[f] as usize..self.first[f + 1] as usize
    }

    /// The vertex of each corner.
    pub fn corners(&self) -> &[u32] {
        &self.corners
    }

    /// The face of the first cage that each face lies in.
    pub fn parents(&self) -> &[u32] {
        &self.parents
    }

    /// True where refinement smooths nothing.
    pub fn is_flat(&self) -> bool {
        self.rules.scheme == Scheme::Bilinear
    }

    /// True where face `f` is not shown: it lies in a hole, or at a boundary of [`Boundary::None`].
    pub fn is_hidden(&self, f: usize) -> bool {
        self.hidden[self.parents[f] as usize]
    }

    /// The corner after `corner` in its face `f`.
    pub(super) fn next(&self, f: usize, corner: usize) -> usize {
        if corner + 1 == self.first[f + 1] as usize { self.first[f] as usize } else { corner + 1 }
    }

    /// The corner before `corner` in its face `f`.
    pub(super) fn previous(&self, f: usize, corner: usize) -> usize {
        if corner == self.first[f] as usize { self.first[f + 1] as usize - 1 } else { corner - 1 }
    }

    fn set_creases(&mut self, creases: &[([u32; 2], f32)]) {
        if creases.is_empty() {
            return;
        }
        let order = |[a, b]: [u32; 2]| (a.min(b), a.max(b));
        let known: std::collections::HashMap<_, _> = creases.iter().map(|&(pair, s)| (order(pair), s)).collect();
        for f in 0..self.face_count() {
            for corner in self.face(f) {
                let pair = [self.corners[corner], self.corners[self.next(f, corner)]];
                if let Some(&sharpness) = known.get(&order(pair)) {
                    self.edge_sharpness[corner] = sharpness.clamp(0.0, INFINITE);
                }
            }
        }
    }

    /// Edges that do not lie between two faces are sharp, and so are vertices of one face where the rules say so.
    fn sharpen_boundary(&mut self) {
        let adjacency = Adjacency::new(self);
        let mut face_count = vec![0u32; self.vertex_count()];
        self.corners.iter().for_each(|&v| face_count[v as usize] += 1);
        let mut at_boundary = vec![false; self.vertex_count()];
        for edge in adjacency.edges.iter().filter(|e| e.faces[1] == NO_FACE || e.is_tangled) {
            edge.ends.iter().for_each(|&v| at_boundary[v as usize] = true);
        }
        for (corner, &edge) in adjacency.edge_of_corner.iter().enumerate() {
            let edge = &adjacency.edges[edge as usize];
            if edge.faces[1] == NO_FACE || edge.is_tangled {
                self.edge_sharpness[corner] = INFINITE;
            }
        }
        match self.rules.boundary {
            Boundary::EdgeOnly => {}
            Boundary::EdgeAndCorner => {
                for (sharpness, _) in self.vertex_sharpness.iter_mut().zip(&face_count).filter(|(_, n)| **n == 1) {
                    *sharpness = INFINITE;
                }
            }
            Boundary::None => {
                for f in 0..self.face_count() {
                    let touches = self.face(f).any(|corner| at_boundary[self.corners[corner] as usize]);
                    self.hidden[f] |= touches;
                }
            }
        }
    }
}
