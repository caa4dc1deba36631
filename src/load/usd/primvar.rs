//! Primvars: values spread over a mesh by face, point or corner, with or without indices.

use super::read::{self, Reading};
use openusd::sdf::Value;
use openusd::usd::Prim;

/// What a primvar has one value for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The whole mesh.
    Constant,
    /// Each face.
    Uniform,
    /// Each point; on a subdivision surface smoothed as the points are.
    Vertex,
    /// Each point; on a subdivision surface linear over each face.
    Varying,
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
    /// Values without indices, as many as `interpolation` asks for.
    pub fn new(values: Vec<T>, interpolation: Interpolation) -> Self {
        Self { values, indices: None, interpolation }
    }

    /// Values by index, as many indices as `interpolation` asks for.
    pub fn indexed(values: Vec<T>, indices: Vec<i32>, interpolation: Interpolation) -> Self {
        Self { values, indices: Some(indices), interpolation }
    }

    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The number of the value of `element` (a face, a point, a corner); equal indices share one.
    pub fn number(&self, element: usize) -> Option<usize> {
        match &self.indices {
            Some(indices) => usize::try_from(*indices.get(element)?).ok(),
            None => Some(element),
        }
    }

    /// True where elements share values by index.
    pub fn is_indexed(&self) -> bool {
        self.indices.is_some()
    }

    /// The value at `place`; `None` where an index is out of range.
    pub fn at(&self, place: Place) -> Option<T> {
        let element = match self.interpolation {
            Interpolation::Constant => 0,
            Interpolation::Uniform => place.face,
            Interpolation::Vertex | Interpolation::Varying => place.point,
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
    warnings: &mut Reading,
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
        Some("vertex") => Interpolation::Vertex,
        Some("varying") => Interpolation::Varying,
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
        Interpolation::Vertex | Interpolation::Varying => sizes.points,
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
