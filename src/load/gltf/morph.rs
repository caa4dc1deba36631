//! Morph targets: weighted displacements of vertices (glTF 2.0 section 3.7.2.2).

use super::accessor;
use super::document::Document;
use super::mesh::Vertices;
use crate::error::{Error, Result};
use ::gltf::json::accessor::Type;
use glam::{Vec2, Vec3, Vec4};
use serde_json::Value;

/// Adds `targets` (a primitive's own JSON) by their `weights` to its vertices: positions, normals, texture coordinates and
/// colours. Targets of weight 0 are not read, those of attributes that the primitive lacks are skipped.
///
/// # Errors
/// `Invalid` naming `place` where a target has another number of vertices, or is broken.
pub(super) fn apply(
    document: &Document,
    targets: &[Value],
    weights: &[f32],
    vertices: &mut Vertices,
    place: &str,
) -> Result<()> {
    let weighted = targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
    let mut turned = false;
    for (target, &weight) in weighted {
        for (name, accessor) in target.as_object().into_iter().flatten() {
            let accessor = accessor.as_u64().and_then(|a| usize::try_from(a).ok()).ok_or_else(|| {
                Error::invalid(place, format!("has a morph target whose {name} is no accessor; export the file again"))
            })?;
            let read = |types: &[Type], count: usize, colors: bool| {
                let floats = accessor::floats(document, accessor, types, colors)?;
                if floats.len() != count {
                    let message =
                        format!("has {count} vertices and a morph target of {}; export the file again", floats.len());
                    return Err(Error::invalid(place, message));
                }
                Ok(floats)
            };
            match name.as_str() {
                "POSITION" => {
                    let moved = read(&[Type::Vec3], vertices.positions.len(), false)?;
                    for (position, by) in vertices.positions.iter_mut().zip(moved.rows(0.0)) {
                        *position += Vec3::from_array(by) * weight;
                    }
                }
                "NORMAL" if !vertices.normals.is_empty() => {
                    let moved = read(&[Type::Vec3], vertices.normals.len(), false)?;
                    for (normal, by) in vertices.normals.iter_mut().zip(moved.rows(0.0)) {
                        *normal += Vec3::from_array(by) * weight;
                    }
                    turned = true;
                }
                "COLOR_0" if !vertices.colors.is_empty() => {
                    let moved = read(&[Type::Vec3, Type::Vec4], vertices.colors.len(), true)?;
                    for (color, by) in vertices.colors.iter_mut().zip(moved.rows(0.0)) {
                        *color = (*color + Vec4::from_array(by) * weight).clamp(Vec4::ZERO, Vec4::ONE);
                    }
                }
                _ => {
                    let set = name.strip_prefix("TEXCOORD_").and_then(|n| n.parse::<u32>().ok());
                    let Some(coords) = set.and_then(|set| vertices.uvs.get_mut(&set)) else { continue };
                    let moved = read(&[Type::Vec2], coords.len(), false)?;
                    for (uv, by) in coords.iter_mut().zip(moved.rows(0.0)) {
                        *uv += Vec2::from_array(by) * weight;
                    }
                }
            }
        }
    }
    if turned {
        vertices.normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    }
    Ok(())
}
