//! Vertices that differ by a value at the corners of triangles: one vertex becomes several at chart and colour seams, and new
//! ones come in where triangles were cut.

use super::blend::Blend;
use std::collections::HashMap;

/// The vertices of a mesh, and the blends of them that pieces of its triangles have at their corners: these have the numbers
/// that follow.
#[derive(Clone, Debug)]
pub struct Vertices {
    own: usize,
    blends: Vec<Blend>,
    known: HashMap<([u32; 3], [u64; 3]), u32>,
}

impl Vertices {
    /// Those of a mesh of `own` vertices.
    pub fn new(own: usize) -> Self {
        Self { own, blends: Vec::new(), known: HashMap::new() }
    }

    /// How many are the mesh's own, the first ones.
    pub fn own(&self) -> usize {
        self.own
    }

    /// The number of `blend`, a new one where there is none like it.
    pub fn place(&mut self, blend: Blend) -> u32 {
        if let Some(vertex) = blend.as_vertex() {
            return vertex;
        }
        *self.known.entry(blend.key()).or_insert_with(|| {
            self.blends.push(blend);
            (self.own + self.blends.len() - 1) as u32
        })
    }

    /// What vertex `vertex` is made of.
    fn blend(&self, vertex: u32) -> Blend {
        (vertex as usize).checked_sub(self.own).map_or(Blend::vertex(vertex), |i| self.blends[i])
    }
}

/// What each vertex of a new list is made of.
#[derive(Clone, Debug)]
pub struct Sources {
    vertices: Vertices,
    numbers: Vec<u32>,
}

impl Sources {
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    pub fn iter(&self) -> impl Iterator<Item = Blend> {
        self.numbers.iter().map(|number| self.vertices.blend(*number))
    }

    /// True where they are vertices of the mesh alone.
    pub fn are_given(&self) -> bool {
        self.vertices.blends.is_empty()
    }
}

/// A vertex list in which each vertex has one value.
#[derive(Clone, Debug)]
pub struct Split<const N: usize> {
    /// What each vertex is made of.
    pub sources: Sources,
    /// The value of each vertex; zeros where no triangle uses it.
    pub values: Vec<[f32; N]>,
    /// The triangles, in the order given.
    pub triangles: Vec<[u32; 3]>,
    /// False where the vertices are the source's own, in their order: then nothing but the values has to be written.
    pub changed: bool,
}

/// Gives each vertex of `triangles`, among `vertices`, the value at its corners, and copies it where they differ. A source
/// vertex keeps its index, blends follow it, copies come at the end, unless most vertices aren't used at all (a buffer that
/// many meshes share): then the unused ones are left out. Corners without a value take that of their vertex.
pub fn split<const N: usize>(
    vertices: Vertices,
    triangles: &[[u32; 3]],
    corners: &[Option<[[f32; N]; 3]>],
) -> Split<N> {
    let count = vertices.own + vertices.blends.len();
    let mut used = vec![false; count];
    triangles.iter().flatten().for_each(|v| used[*v as usize] = true);
    let compact = used[..vertices.own].iter().filter(|u| **u).count() < vertices.own / 2;
    let mut numbers: Vec<u32> = (0..count as u32).filter(|v| !compact || used[*v as usize]).collect();
    let mut vertex_of_source = vec![0u32; count];
    numbers.iter().enumerate().for_each(|(i, v)| vertex_of_source[*v as usize] = i as u32);
    let mut values = vec![[0.0; N]; numbers.len()];
    let mut has_value = vec![false; numbers.len()];
    let mut copies: HashMap<(u32, [u32; N]), u32> = HashMap::new();
    let mut out = Vec::with_capacity(triangles.len());
    for (triangle, corners) in triangles.iter().zip(corners) {
        let mut triangle = triangle.map(|v| vertex_of_source[v as usize]);
        for (vertex, value) in triangle.iter_mut().zip(corners.iter().flatten()) {
            let first = *vertex as usize;
            // Adding zero makes -0 and 0 one value.
            let value = value.map(|v| v + 0.0);
            if !has_value[first] {
                has_value[first] = true;
                values[first] = value;
            } else if values[first] != value {
                *vertex = *copies.entry((*vertex, value.map(f32::to_bits))).or_insert_with(|| {
                    numbers.push(numbers[first]);
                    values.push(value);
                    values.len() as u32 - 1
                });
            }
        }
        out.push(triangle);
    }
    let changed = compact || numbers.len() > vertices.own;
    Split { sources: Sources { vertices, numbers }, values, triangles: out, changed }
}

#[cfg(test)]
mod tests {
    use super::{Blend, Split, Vertices};
    use crate::meshing::Weights;
    use glam::Vec3;

    const QUAD: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

    fn split(vertex_count: usize, triangles: &[[u32; 3]], corners: &[Option<[[f32; 1]; 3]>]) -> Split<1> {
        super::split(Vertices::new(vertex_count), triangles, corners)
    }

    fn vertices(split: &Split<1>) -> Vec<u32> {
        split.sources.iter().map(|s| s.as_vertex().unwrap()).collect()
    }

    #[test]
    fn equal_values_change_nothing() {
        let s = split(4, &QUAD, &[Some([[0.0], [1.0], [2.0]]), Some([[0.0], [2.0], [3.0]])]);
        assert!(!s.changed);
        assert_eq!(s.values, [[0.0], [1.0], [2.0], [3.0]]);
        assert_eq!(s.triangles, QUAD);
    }

    #[test]
    fn seams_copy_vertices_once() {
        let s = split(4, &QUAD, &[Some([[0.0], [1.0], [2.0]]), Some([[9.0], [9.0], [3.0]])]);
        assert_eq!(vertices(&s), [0, 1, 2, 3, 0, 2]);
        assert_eq!(s.triangles, [[0, 1, 2], [4, 5, 3]]);
        assert_eq!(s.values[4..], [[9.0], [9.0]]);
    }

    #[test]
    fn a_small_part_of_a_shared_buffer_is_taken_out() {
        let s = split(100, &[[7, 50, 9]], &[Some([[1.0], [2.0], [3.0]])]);
        assert_eq!(vertices(&s), [7, 9, 50]);
        assert_eq!(s.triangles, [[0, 2, 1]]);
        assert_eq!(s.values, [[1.0], [3.0], [2.0]]);
    }

    #[test]
    fn triangles_without_a_value_stay() {
        let s = split(4, &QUAD, &[None, Some([[1.0], [2.0], [3.0]])]);
        assert_eq!(s.triangles, QUAD);
        assert_eq!(s.values, [[1.0], [0.0], [2.0], [3.0]]);
    }

    /// Both triangles of the quad are cut from their outer corner to the middle of the diagonal.
    #[test]
    fn a_cut_edge_has_one_vertex_unless_values_differ() {
        let points = [Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y];
        let half = |t: [u32; 3], w: [f64; 3]| Blend::at(Weights(w.into()), t, t.map(|v| points[v as usize]));
        let mut vertices = Vertices::new(4);
        let middle = vertices.place(half(QUAD[0], [0.5, 0.0, 0.5]));
        assert_eq!((middle, vertices.place(half(QUAD[1], [0.5, 0.5, 0.0]))), (4, 4));
        assert_eq!(vertices.place(Blend::vertex(3)), 3);
        let triangles = [[0, 1, middle], [1, 2, middle], [2, 3, middle], [3, 0, middle]];
        let cut = |right: f32| {
            let corners = [2.0, 2.0, right, right].map(|middle| Some([[1.0], [1.0], [middle]]));
            super::split(vertices.clone(), &triangles, &corners)
        };
        let smooth = cut(2.0);
        assert!(smooth.changed && smooth.sources.len() == 5);
        assert_eq!(smooth.triangles, triangles);
        let torn = cut(3.0);
        assert_eq!(torn.triangles, [[0, 1, 4], [1, 2, 4], [2, 3, 5], [3, 0, 5]]);
        assert_eq!(torn.sources.iter().nth(4), torn.sources.iter().nth(5));
    }
}
