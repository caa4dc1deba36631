//! Vertices that differ by a value at the corners of triangles: one vertex becomes several at chart and colour seams.

use std::collections::HashMap;

/// A vertex list in which each vertex has one value.
#[derive(Clone, Debug, PartialEq)]
pub struct Split<const N: usize> {
    /// The source vertex of each vertex.
    pub sources: Vec<u32>,
    /// The value of each vertex; zeros where no triangle uses it.
    pub values: Vec<[f32; N]>,
    /// The triangles, in the order given.
    pub triangles: Vec<[u32; 3]>,
    /// False where the vertices are the source's own, in their order: then nothing but the values has to be written.
    pub changed: bool,
}

/// Gives each vertex of `triangles` (indices below `vertex_count`) the value at its corners, and copies it where they
/// differ. A source vertex keeps its index and copies follow at the end, unless most vertices aren't used at all (a buffer
/// that many meshes share): then the unused ones are left out. Corners without a value take that of their vertex.
pub fn split<const N: usize>(
    vertex_count: usize,
    triangles: &[[u32; 3]],
    corners: &[Option<[[f32; N]; 3]>],
) -> Split<N> {
    let mut used = vec![false; vertex_count];
    triangles.iter().flatten().for_each(|v| used[*v as usize] = true);
    let compact = used.iter().filter(|u| **u).count() < vertex_count / 2;
    let sources: Vec<u32> = (0..vertex_count as u32).filter(|v| !compact || used[*v as usize]).collect();
    let mut vertex_of_source = vec![0u32; vertex_count];
    sources.iter().enumerate().for_each(|(i, v)| vertex_of_source[*v as usize] = i as u32);
    let mut split = Split { values: vec![[0.0; N]; sources.len()], sources, triangles: Vec::new(), changed: compact };
    let mut has_value = vec![false; split.sources.len()];
    let mut copies: HashMap<(u32, [u32; N]), u32> = HashMap::new();
    for (triangle, values) in triangles.iter().zip(corners) {
        let mut out = triangle.map(|v| vertex_of_source[v as usize]);
        for (vertex, value) in out.iter_mut().zip(values.iter().flatten()) {
            let first = *vertex as usize;
            // Adding zero makes -0 and 0 one value.
            let value = value.map(|v| v + 0.0);
            if !has_value[first] {
                has_value[first] = true;
                split.values[first] = value;
            } else if split.values[first] != value {
                *vertex = *copies.entry((*vertex, value.map(f32::to_bits))).or_insert_with(|| {
                    split.sources.push(split.sources[first]);
                    split.values.push(value);
                    split.changed = true;
                    split.values.len() as u32 - 1
                });
            }
        }
        split.triangles.push(out);
    }
    split
}

#[cfg(test)]
mod tests {
    use super::split;

    const QUAD: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

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
        assert_eq!(s.sources, [0, 1, 2, 3, 0, 2]);
        assert_eq!(s.triangles, [[0, 1, 2], [4, 5, 3]]);
        assert_eq!(s.values[4..], [[9.0], [9.0]]);
    }

    #[test]
    fn a_small_part_of_a_shared_buffer_is_taken_out() {
        let s = split(100, &[[7, 50, 9]], &[Some([[1.0], [2.0], [3.0]])]);
        assert_eq!(s.sources, [7, 9, 50]);
        assert_eq!(s.triangles, [[0, 2, 1]]);
        assert_eq!(s.values, [[1.0], [3.0], [2.0]]);
    }

    #[test]
    fn triangles_without_a_value_stay() {
        let s = split(4, &QUAD, &[None, Some([[1.0], [2.0], [3.0]])]);
        assert_eq!(s.triangles, QUAD);
        assert_eq!(s.values, [[1.0], [0.0], [2.0], [3.0]]);
    }
}
