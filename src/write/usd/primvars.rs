//! Values at triangle corners as USD primvars: one value for each entry of faceVertexIndices, indexed.

use super::input::Topology;
use super::layer::{Attribute, array, tuple};
use crate::color::Rgb;
use crate::unwrap::{MeshUvs, Placement};
use glam::Vec2;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::hash::BuildHasherDefault;

/// The primvar `name` that holds a mesh's lightmap UVs (0..1, v up as USD has it; before the surface's rectangle); corners
/// of faces that hold no triangle of ours get (0, 0). `None` where the mesh doesn't fit `topology`.
pub fn uvs(name: &str, uvs: &MeshUvs, topology: &Topology) -> Option<[Attribute; 2]> {
    let flip = |uv: Vec2| [uv.x, 1.0 - uv.y];
    let corners = scatter(topology, uvs.corners.iter().map(|c| c.map(flip)))?;
    let corners: Vec<[f32; 2]> = corners.into_iter().map(Option::unwrap_or_default).collect();
    Some(indexed("texCoord2f[]", name, &corners))
}

/// The primvar `name` that holds `colors` (three a triangle, not clamped, any unit): `vertex` where all corners of each
/// point agree, else faceVarying. Points and corners without a triangle of ours get black. `None` as in [`uvs`].
/// `was_indexed`: a weaker layer indexes the primvar of that name, so that its indices must be blocked.
pub fn colors(name: &str, colors: &[[Rgb; 3]], topology: &Topology, was_indexed: bool) -> Option<Vec<Attribute>> {
    let corners = scatter(topology, colors.iter().map(|c| c.map(|v| v.to_array())))?;
    if let Some(points) = by_point(&corners, topology) {
        let value = array(&points, |text, v| tuple(text, v));
        let mut attributes = vec![Attribute::primvar("color3f[]", name, "vertex", value)];
        if was_indexed {
            attributes.push(indices(name, "None".into()));
        }
        return Some(attributes);
    }
    let corners: Vec<[f32; 3]> = corners.into_iter().map(Option::unwrap_or_default).collect();
    Some(indexed("color3f[]", name, &corners).into())
}

/// A placement as (scale x, scale y, offset x, offset y) for UVs whose v points up.
///
/// With v' = 1 - v on mesh and page: page v' = 1 - (v * s + o) = v' * s + (1 - s - o).
pub fn scale_offset(placement: &Placement) -> [f32; 4] {
    let (s, o) = (placement.scale, placement.offset);
    [s.x, s.y, o.x, 1.0 - s.y - o.y]
}

/// Values of triangle corners at their places in faceVertexIndices, `None` where no triangle has the corner.
fn scatter<T: Copy>(topology: &Topology, triangles: impl ExactSizeIterator<Item = [T; 3]>) -> Option<Vec<Option<T>>> {
    if triangles.len() != topology.triangles.len() {
        return None;
    }
    let mut corners = vec![None; topology.corner_point.len()];
    for (places, values) in topology.triangles.iter().zip(triangles) {
        for (&corner, value) in places.iter().zip(values) {
            *corners.get_mut(corner as usize)? = Some(value);
        }
    }
    Some(corners)
}

/// One value a point, where all of its corners have the same.
fn by_point(corners: &[Option<[f32; 3]>], topology: &Topology) -> Option<Vec<[f32; 3]>> {
    let mut points = vec![None; topology.point_count];
    for (corner, &point) in corners.iter().zip(&topology.corner_point) {
        let slot: &mut Option<[f32; 3]> = points.get_mut(usize::try_from(point).ok()?)?;
        match (*slot, *corner) {
            (Some(a), Some(b)) if a != b => return None,
            (None, Some(b)) => *slot = Some(b),
            _ => {}
        }
    }
    Some(points.into_iter().map(Option::unwrap_or_default).collect())
}

/// A face-varying primvar and its indices: each value once, in the order of first appearance.
fn indexed<const N: usize>(type_name: &'static str, name: &str, corners: &[[f32; N]]) -> [Attribute; 2] {
    let mut values: Vec<[f32; N]> = Vec::new();
    let mut known: HashMap<[u32; N], u32, BuildHasherDefault<Fnv>> = HashMap::default();
    let index: Vec<u32> = corners
        .iter()
        .map(|v| {
            // +0 and -0 are one value.
            let bits = v.map(|x| (x + 0.0).to_bits());
            *known.entry(bits).or_insert_with(|| {
                values.push(*v);
                values.len() as u32 - 1
            })
        })
        .collect();
    let value = array(&values, |text, v| tuple(text, v));
    let index = array(&index, |text, i| {
        // Writing to a String does not fail.
        let _ = write!(text, "{i}");
    });
    [Attribute::primvar(type_name, name, "faceVarying", value), indices(name, index)]
}

/// The indices of the primvar `name`; the value `None` blocks those of weaker layers.
pub fn indices(name: &str, value: String) -> Attribute {
    let name = format!("primvars:{name}:indices");
    Attribute { custom: false, type_name: "int[]", name, value, interpolation: None, baked: false }
}

/// FNV-1a over whole words: the keys are few bytes and come from no adversary.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl std::hash::Hasher for Fnv {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}
