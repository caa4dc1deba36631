//! Primvars: values spread over a mesh by face, point or corner, with or without indices.

use super::read;
use crate::error::Warnings;
use openusd::sdf::Value;
use openusd::usd::Prim;

/// What a primvar has one value for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The whole mesh.
    Constant,
    /// Each face.
    Uniform,
    /// Each point (vertex and varying: the same on a polygon mesh).
    Point,
    /// Each face corner.
    FaceVarying,
}

/// Values over a mesh; checked against its sizes.
pub struct Primvar<T> {
    values: Vec<T>,
    indices: Option<Vec<i32>>,
    pub interpolation: Interpolation,
}

/// The counts that primvars are checked against.
#[derive(Clone, Copy)]
pub struct Sizes {
    pub faces: usize,
    pub points: usize,
    pub corners: usize,
}

/// A place on a mesh.
#[derive(Clone, Copy)]
pub struct Place {
    pub face: usize,
    pub point: usize,
    /// Index into faceVertexIndices.
    pub corner: usize,
}

impl<T: Copy> Primvar<T> {
    /// The value at `place`; `None` where an index is out of range.
    pub fn at(&self, place: Place) -> Option<T> {
        let element = match self.interpolation {
            Interpolation::Constant => 0,
            Interpolation::Uniform => place.face,
            Interpolation::Point => place.point,
            Interpolation::FaceVarying => place.corner,
        };
        let index = match &self.indices {
            Some(indices) => usize::try_from(*indices.get(element)?).ok()?,
            None => element,
        };
        self.values.get(index).copied()
    }
}

/// Reads the attribute `name` of `prim` as a primvar. `convert` makes the values; `None` where nothing is authored. What
/// does not fit the mesh is left out, with a warning.
pub fn read_primvar<T: Copy>(
    prim: &Prim,
    name: &str,
    default: Interpolation,
    sizes: Sizes,
    convert: impl Fn(Value) -> Option<Vec<T>>,
    warnings: &mut Warnings,
) -> Option<Primvar<T>> {
    let attribute = prim.attribute(name);
    let values = convert(read::attribute_value(&attribute, warnings)?)?;
    if values.is_empty() {
        return None;
    }
    let place = attribute.path().to_string();
    let authored = attribute.get_metadata::<openusd::tf::Token>("interpolation").ok().flatten();
    let interpolation = match authored.as_ref().map(|t| t.as_str()) {
        Some("constant") => Interpolation::Constant,
        Some("uniform") => Interpolation::Uniform,
        Some("vertex" | "varying") => Interpolation::Point,
        Some("faceVarying") => Interpolation::FaceVarying,
        _ => default,
    };
    if attribute.get_metadata::<i32>("elementSize").ok().flatten().is_some_and(|n| n > 1) {
        warnings.add(place, "a primvar with elementSize above 1 was left out");
        return None;
    }
    let indices = read::value(prim, &format!("{name}:indices"), warnings).and_then(read::to_ints);
    let elements = match interpolation {
        Interpolation::Constant => 1,
        Interpolation::Uniform => sizes.faces,
        Interpolation::Point => sizes.points,
        Interpolation::FaceVarying => sizes.corners,
    };
    let given = indices.as_ref().map_or(values.len(), Vec::len);
    if given < elements {
        warnings.add(place, "a primvar has fewer values than its interpolation asks for, and was left out");
        return None;
    }
    if let Some(indices) = &indices
        && indices.iter().any(|&i| usize::try_from(i).map_or(true, |i| i >= values.len()))
    {
        warnings.add(place, "a primvar's indices are out of range; it was left out");
        return None;
    }
    Some(Primvar { values, indices, interpolation })
}
