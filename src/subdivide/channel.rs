//! Face-varying values as a mesh of their own.

use super::adjacency::{Adjacency, NO_FACE};
use super::cage::{Cage, INFINITE};
use std::collections::HashMap;

/// Where face-varying values are kept linear (UsdGeomMesh's faceVaryingLinearInterpolation).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Linear {
    /// Nowhere: boundaries of the values are smooth curves, corners too.
    None,
    /// Values of one face alone at a vertex stay where they are.
    CornersOnly,
    /// So do those at vertices where three or more values meet.
    #[default]
    CornersPlus1,
    /// So do both values at a vertex where one is a corner, and the ends of cuts.
    CornersPlus2,
    /// Along all boundaries of the values.
    Boundaries,
    /// Everywhere: such values are refined as linear ones.
    All,
}

/// What meets at a vertex of the mesh.
#[derive(Clone, Copy, Default)]
struct Meeting {
    values: u32,
    /// One of them belongs to one face alone.
    has_corner: bool,
}

impl Cage {
    /// The mesh of the face-varying values `value_of_corner` (any numbers that tell values apart) over this one, and for
    /// each of its vertices a corner that has its value. Values at different vertices of the mesh are different.
    pub fn channel(&self, value_of_corner: &[u32], linear: Linear) -> Option<(Cage, Vec<u32>)> {
        if value_of_corner.len() != self.corners.len() {
            return None;
        }
        let mut known: HashMap<(u32, u32), u32> = HashMap::with_capacity(self.vertex_count());
        let mut corner_of_value = Vec::with_capacity(self.vertex_count());
        let mut corners = Vec::with_capacity(self.corners.len());
        for (corner, (&vertex, &value)) in self.corners.iter().zip(value_of_corner).enumerate() {
            corners.push(*known.entry((vertex, value)).or_insert_with(|| {
                corner_of_value.push(corner as u32);
                corner_of_value.len() as u32 - 1
            }));
        }
        let mut cage = Cage { corners, vertex_sharpness: vec![0.0; corner_of_value.len()], ..self.clone() };
        cage.sharpen_values(self, &corner_of_value, linear);
        Some((cage, corner_of_value))
    }

    fn sharpen_values(&mut self, mesh: &Cage, corner_of_value: &[u32], linear: Linear) {
        let vertex_of = |value: usize| mesh.corners[corner_of_value[value] as usize] as usize;
        let adjacency = Adjacency::new(self);
        let mut at_boundary = vec![false; self.vertex_count()];
        for (corner, &edge) in adjacency.edge_of_corner.iter().enumerate() {
            let edge = &adjacency.edges[edge as usize];
            if edge.faces[1] == NO_FACE || edge.is_tangled {
                self.edge_sharpness[corner] = INFINITE;
                edge.ends.iter().for_each(|&v| at_boundary[v as usize] = true);
            }
        }
        let mut faces = vec![0u32; self.vertex_count()];
        self.corners.iter().for_each(|&value| faces[value as usize] += 1);
        let mut meetings = vec![Meeting::default(); mesh.vertex_count()];
        for (value, &count) in faces.iter().enumerate() {
            let meeting = &mut meetings[vertex_of(value)];
            meeting.values += 1;
            meeting.has_corner |= count == 1;
        }
        let mut mesh_boundary = vec![false; mesh.vertex_count()];
        for edge in Adjacency::new(mesh).edges.iter().filter(|e| e.faces[1] == NO_FACE || e.is_tangled) {
            edge.ends.iter().for_each(|&v| mesh_boundary[v as usize] = true);
        }
        for value in 0..self.vertex_count() {
            let vertex = vertex_of(value);
            let meeting = meetings[vertex];
            let is_corner = faces[value] == 1 && at_boundary[value];
            let is_dart = meeting.values == 1 && at_boundary[value] && !mesh_boundary[vertex];
            let is_kept = match linear {
                Linear::None => false,
                Linear::CornersOnly => is_corner,
                Linear::CornersPlus1 => is_corner || meeting.values > 2,
                Linear::CornersPlus2 => {
                    is_corner || meeting.values > 2 || meeting.values == 2 && meeting.has_corner || is_dart
                }
                Linear::Boundaries | Linear::All => at_boundary[value],
            };
            self.vertex_sharpness[value] = match meeting.values {
                _ if is_kept => INFINITE,
                1 => mesh.vertex_sharpness[vertex],
                _ => 0.0,
            };
        }
    }
}
