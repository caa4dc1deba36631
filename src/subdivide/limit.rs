//! The limit surface at the vertices of a level, and normals there.

use super::adjacency::Adjacency;
use super::cage::{Cage, INFINITE, Scheme, Values};
use super::refine::loop_weight;
use glam::Vec3;

/// Normals at corners: `values[index[corner]]`.
#[derive(Clone, Debug, Default)]
pub struct Normals {
    pub values: Vec<Vec3>,
    pub index: Vec<u32>,
}

impl Cage {
    /// Moves `values` to where infinite refinement would take them. What is still sharp counts as sharp for ever. The cage
    /// must have been refined once at least, so that Catmull-Clark's faces are quads; otherwise, and for bilinear
    /// refinement, nothing is moved.
    pub fn push_to_limit(&self, values: &mut Values) {
        let is_quads = (0..self.face_count()).all(|f| self.face(f).len() == 4);
        let is_loop = self.rules.scheme == Scheme::Loop;
        if self.rules.scheme == Scheme::Bilinear || !is_loop && !is_quads {
            return;
        }
        let n = self.vertex_count();
        let [mut all, mut sharp, mut diagonal] = [(); 3].map(|()| Values::zeros(values.width, n));
        let (mut edge_count, mut sharp_count) = (vec![0u32; n], vec![0u32; n]);
        for edge in Adjacency::new(self).edges.iter().filter(|e| e.ends[0] != e.ends[1]) {
            for (v, other) in [(edge.ends[0], edge.ends[1]), (edge.ends[1], edge.ends[0])] {
                let (v, other) = (v as usize, other as usize);
                edge_count[v] += 1;
                all.add(v, values, other, 1.0);
                if edge.sharpness > 0.0 {
                    sharp_count[v] += 1;
                    sharp.add(v, values, other, 1.0);
                }
            }
        }
        if !is_loop {
            for f in 0..self.face_count() {
                for (corner, opposite) in self.face(f).zip(self.face(f).cycle().skip(2)) {
                    diagonal.add(self.corners[corner] as usize, values, self.corners[opposite] as usize, 1.0);
                }
            }
        }
        let mut out = Values::zeros(values.width, n);
        for v in 0..n {
            let valence = edge_count[v] as f32;
            let is_corner = self.vertex_sharpness[v] > 0.0 || sharp_count[v] > 2 || edge_count[v] < 2;
            if is_corner {
                out.add(v, values, v, 1.0);
            } else if sharp_count[v] == 2 {
                out.add(v, values, v, 2.0 / 3.0);
                out.add(v, &sharp, v, 1.0 / 6.0);
            } else if is_loop {
                let each = 1.0 / (0.375 / loop_weight(edge_count[v] as usize) + valence);
                out.add(v, values, v, 1.0 - valence * each);
                out.add(v, &all, v, each);
            } else {
                let whole = valence * (valence + 5.0);
                out.add(v, values, v, valence * valence / whole);
                out.add(v, &all, v, 4.0 / whole);
                out.add(v, &diagonal, v, 1.0 / whole);
            }
        }
        *values = out;
    }
}

/// Unit normals of the mesh at `points` (3 floats a vertex): those of the faces around each vertex, weighed by their angle
/// there, on each side of edges that stay sharp. They tend to the limit surface's own with the square of the edge length.
pub fn smooth_normals(cage: &Cage, points: &Values) -> Normals {
    let mut group: Vec<u32> = (0..cage.corners.len() as u32).collect();
    for edge in Adjacency::new(cage).edges.iter().filter(|e| e.sharpness < INFINITE && !e.is_tangled) {
        let [f, g] = edge.faces.map(|f| f as usize);
        let [c, d] = edge.corners.map(|c| c as usize);
        let (c_next, d_next) = (cage.next(f, c), cage.next(g, d));
        // Corners at the same end; faces of opposite windings run the same way along the edge.
        let pairs =
            if cage.corners[c] == cage.corners[d] { [(c, d), (c_next, d_next)] } else { [(c, d_next), (c_next, d)] };
        pairs.iter().for_each(|&(a, b)| join(&mut group, a, b));
    }
    let point = |corner: usize| Vec3::from_slice(points.row(cage.corners[corner] as usize));
    let mut sums = vec![Vec3::ZERO; cage.corners.len()];
    for f in 0..cage.face_count() {
        for corner in cage.face(f) {
            let (to, from) =
                (point(cage.next(f, corner)) - point(corner), point(cage.previous(f, corner)) - point(corner));
            let normal = to.cross(from).normalize_or_zero();
            let angle = to.angle_between(from);
            if angle.is_finite() {
                sums[root(&mut group, corner)] += angle * normal;
            }
        }
    }
    let mut normals = Normals { values: Vec::new(), index: vec![0; cage.corners.len()] };
    let mut known = vec![u32::MAX; cage.corners.len()];
    for corner in 0..cage.corners.len() {
        let root = root(&mut group, corner);
        if known[root] == u32::MAX {
            known[root] = normals.values.len() as u32;
            normals.values.push(sums[root].normalize_or_zero());
        }
        normals.index[corner] = known[root];
    }
    normals
}

/// The first corner of a corner's group.
fn root(group: &mut [u32], corner: usize) -> usize {
    let mut at = corner;
    while group[at] as usize != at {
        group[at] = group[group[at] as usize];
        at = group[at] as usize;
    }
    at
}

fn join(group: &mut [u32], a: usize, b: usize) {
    let (a, b) = (root(group, a), root(group, b));
    group[a.max(b)] = a.min(b) as u32;
}
