//! Skins: vertices moved by joints (glTF 2.0 section 3.7.3.3).
//!
//! A vertex goes to `sum_k w_k (world_from_joint_k * inverse_bind_k)` of itself: into world space, whatever the transform of
//! the mesh's own node is. Weights are scaled to a sum of 1; a vertex without any follows the first joint that it names.

use super::accessor::{self, Floats};
use super::document::Document;
use crate::error::{Error, Result};
use ::gltf::json::accessor::Type;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use rayon::prelude::*;
use serde::Deserialize;

/// A skin in the pose of its joints.
#[derive(Debug)]
pub(super) struct Skin {
    /// Index into the document's skins.
    pub index: usize,
    /// World space from the mesh's own, a joint.
    world_from_mesh: Vec<DAffine3>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Source {
    joints: Vec<usize>,
    inverse_bind_matrices: Option<usize>,
}

/// The joints and weights of a primitive's vertices; each set has four of them a vertex.
#[derive(Default)]
pub(super) struct Influences {
    pub joints: Vec<(u32, Floats)>,
    pub weights: Vec<(u32, Floats)>,
}

impl Skin {
    /// Reads skin `index`; `world_from_node` gives the transform of a node.
    ///
    /// # Errors
    /// `Invalid` where the skin is broken or a joint is no node.
    pub fn read(
        document: &Document,
        index: usize,
        mut world_from_node: impl FnMut(usize) -> Option<DAffine3>,
    ) -> Result<Self> {
        let source: Source = document.item("skins", index)?;
        let place = document.place("skins", index);
        let broken = |what: &str| Error::invalid(&place, format!("{what}; export the file again"));
        let inverse_bind: Vec<DAffine3> = match source.inverse_bind_matrices {
            Some(accessor) => {
                let matrices = accessor::floats(document, accessor, &[Type::Mat4], false)?;
                let affine = |m: [f32; 16]| DAffine3::from_mat4(DMat4::from_cols_array(&m.map(f64::from)));
                matrices.rows(0.0).map(affine).collect()
            }
            None => vec![DAffine3::IDENTITY; source.joints.len()],
        };
        if inverse_bind.len() < source.joints.len() {
            return Err(broken("has fewer inverse bind matrices than joints"));
        }
        let joints = source.joints.iter().zip(inverse_bind);
        let world_from_mesh = joints.map(|(&joint, inverse_bind)| {
            let world_from_joint = world_from_node(joint).ok_or_else(|| broken("names a joint that is no node"))?;
            Ok(world_from_joint * inverse_bind)
        });
        let world_from_mesh: Vec<DAffine3> = world_from_mesh.collect::<Result<_>>()?;
        if world_from_mesh.is_empty() {
            return Err(broken("has no joints"));
        }
        Ok(Self { index, world_from_mesh })
    }

    /// Moves `positions` and `normals` (as many, or none) into world space. Returns for each vertex whether its transform
    /// mirrors: the fronts of its triangles then show in the reversed order of corners.
    ///
    /// # Errors
    /// `Invalid` naming `place` where a vertex has no joints, or names one that the skin lacks.
    pub fn apply(
        &self,
        influences: &Influences,
        positions: &mut [Vec3],
        normals: &mut [Vec3],
        place: &str,
    ) -> Result<Vec<bool>> {
        let count = positions.len();
        let sets: Vec<(&Floats, &Floats)> = influences
            .joints
            .iter()
            .filter_map(|(set, joints)| {
                let weights = influences.weights.iter().find(|(s, _)| s == set)?;
                Some((joints, &weights.1))
            })
            .collect();
        if sets.is_empty() || sets.iter().any(|(j, w)| j.len() != count || w.len() != count) {
            let message = "is bound to a skin, but its vertices name no joints with weights; export the file again";
            return Err(Error::invalid(place, message));
        }
        // Blending twice is cheap; a transform a vertex would take more memory than the mesh.
        let moved = positions.par_iter_mut().enumerate().map(|(v, position)| {
            let transform = self.blend(&sets, v)?;
            *position = transform.transform_point3(position.as_dvec3()).as_vec3();
            Some(transform.matrix3.determinant() < 0.0)
        });
        let mirrored = moved.collect::<Option<Vec<bool>>>().ok_or_else(|| {
            let joints = self.world_from_mesh.len();
            Error::invalid(place, format!("names a joint beyond the {joints} of its skin; export the file again"))
        })?;
        normals.par_iter_mut().enumerate().for_each(|(v, normal)| {
            if let Some(transform) = self.blend(&sets, v) {
                *normal = (cofactor(transform.matrix3) * normal.as_dvec3()).normalize_or_zero().as_vec3();
            }
        });
        Ok(mirrored)
    }

    /// The weighted sum of the transforms of vertex `v`'s joints; `None` where one is out of range.
    fn blend(&self, sets: &[(&Floats, &Floats)], v: usize) -> Option<DAffine3> {
        let (mut matrix, mut translation, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        let mut first = None;
        for (joints, weights) in sets {
            for (joint, weight) in joints.row(v).iter().zip(weights.row(v)) {
                // Exact: joints are integers of up to 16 bits.
                let transform = self.world_from_mesh.get(*joint as usize);
                first = first.or(transform);
                let weight = f64::from(*weight);
                // NaN is no weight.
                if weight > 0.0 {
                    let transform = transform?;
                    matrix += transform.matrix3 * weight;
                    translation += transform.translation * weight;
                    sum += weight;
                }
            }
        }
        if sum > 0.0 {
            Some(DAffine3 { matrix3: matrix * (1.0 / sum), translation: translation / sum })
        } else {
            first.copied()
        }
    }
}

/// What takes normals along with `m`, sign included: the cofactor matrix, turned back where `m` mirrors, so that a normal
/// stays on the side of the surface that it was on.
fn cofactor(m: DMat3) -> DMat3 {
    let cofactor = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    if m.determinant() < 0.0 { cofactor * -1.0 } else { cofactor }
}
