//! Accessors to numbers: all component types, normalized, interleaved, sparse.

use super::document::{Document, View};
use crate::error::{Error, Result};
use ::gltf::json;
use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;

/// Most elements of an accessor without a buffer view: its zeros take memory that no file size bounds.
const MAX_UNBACKED: usize = 1 << 22;

/// A checked accessor: its elements lie within its view.
struct Elements<'a> {
    view: Option<View<'a>>,
    count: usize,
    component: ComponentType,
    /// Components an element.
    width: usize,
    normalized: bool,
}

/// Numbers of an accessor, `width` an element.
#[derive(Debug)]
pub(super) struct Floats {
    width: usize,
    values: Vec<f32>,
}

impl Floats {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    /// The components of element `index`; none where it is out of range.
    pub fn row(&self, index: usize) -> &[f32] {
        self.values.get(index * self.width..(index + 1) * self.width).unwrap_or_default()
    }

    /// All components, one element after the other.
    pub fn into_values(self) -> Vec<f32> {
        self.values
    }

    /// The elements; those with fewer than `N` components are filled up with `fill`.
    pub fn rows<const N: usize>(&self, fill: f32) -> impl ExactSizeIterator<Item = [f32; N]> + '_ {
        self.values.chunks_exact(self.width).map(move |row| {
            let mut out = [fill; N];
            for (out, &value) in out.iter_mut().zip(row) {
                *out = value;
            }
            out
        })
    }
}

/// Number of elements that an accessor says it has, for checks before it is read.
pub(super) fn count(document: &Document, index: usize) -> Result<usize> {
    let accessor: json::accessor::Accessor = document.item("accessors", index)?;
    Ok(usize::try_from(accessor.count.0).unwrap_or(usize::MAX))
}

/// Checks that an accessor is of type `kind` and lies within its data, without reading it.
pub(super) fn check(document: &Document, index: usize, kind: Type) -> Result<()> {
    let place = document.place("accessors", index);
    let accessor: json::accessor::Accessor = document.item("accessors", index)?;
    if accessor.type_ != Checked::Valid(kind) {
        return Err(Error::invalid(place, "has the wrong type for its use; export the file again"));
    }
    Elements::new(document, &accessor, kind.multiplicity(), false, &place).map(drop)
}

/// The elements of an accessor whose type is one of `types`, as floats; normalized integers lie in -1..=1, other integers
/// are numbers (KHR_mesh_quantization). `colors`: integers are always normalized.
pub(super) fn floats(document: &Document, index: usize, types: &[Type], colors: bool) -> Result<Floats> {
    let place = document.place("accessors", index);
    let accessor: json::accessor::Accessor = document.item("accessors", index)?;
    let kind = match accessor.type_ {
        Checked::Valid(kind) if types.contains(&kind) => kind,
        _ => return Err(Error::invalid(place, "has the wrong type for its use; export the file again")),
    };
    let width = kind.multiplicity();
    let elements = Elements::new(document, &accessor, width, colors, &place)?;
    let mut values = match elements.view {
        Some(_) => elements.all_floats(),
        None => vec![0.0; elements.count * width],
    };
    if let Some(sparse) = &accessor.sparse {
        let (targets, replacement) = sparse_parts(document, sparse, &elements, &place)?;
        for (target, row) in targets.into_iter().zip(replacement.rows()) {
            let place = values.get_mut(target as usize * width..).unwrap_or_default();
            for (value, new) in place.iter_mut().zip(replacement.floats(row)) {
                *value = new;
            }
        }
    }
    Ok(Floats { width, values })
}

/// The elements of an accessor of vertex indices.
pub(super) fn indices(document: &Document, index: usize) -> Result<Vec<u32>> {
    let place = document.place("accessors", index);
    let accessor: json::accessor::Accessor = document.item("accessors", index)?;
    let scalar = matches!(accessor.type_, Checked::Valid(Type::Scalar));
    let elements = Elements::new(document, &accessor, 1, false, &place)?;
    if !scalar || !matches!(elements.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
        return Err(Error::invalid(place, "holds indices, but is no unsigned scalar; export the file again"));
    }
    let mut values = match elements.view {
        Some(_) => elements.all_unsigned(),
        None => vec![0; elements.count],
    };
    if let Some(sparse) = &accessor.sparse {
        let (targets, replacement) = sparse_parts(document, sparse, &elements, &place)?;
        for (target, row) in targets.into_iter().zip(replacement.rows()) {
            if let Some(value) = values.get_mut(target as usize) {
                *value = unsigned(row);
            }
        }
    }
    Ok(values)
}

/// Where sparse values go (all below the accessor's count), and the values.
fn sparse_parts<'a>(
    document: &'a Document,
    sparse: &json::accessor::sparse::Sparse,
    base: &Elements,
    place: &str,
) -> Result<(Vec<u32>, Elements<'a>)> {
    let outside = || Error::invalid(place, "has sparse values that lie outside of it; export the file again");
    let count = usize::try_from(sparse.count.0).ok().filter(|&c| c <= base.count).ok_or_else(outside)?;
    let Checked::Valid(json::accessor::IndexComponentType(component)) = sparse.indices.component_type else {
        return Err(Error::invalid(place, "has sparse indices of an unknown type; export the file again"));
    };
    let part = |view: usize, offset: u64, component, width, normalized| {
        let view = packed(document.view(view)?, offset).ok_or_else(outside)?;
        Elements { view: Some(view), count, component, width, normalized }.checked().ok_or_else(outside)
    };
    let (i, v) = (&sparse.indices, &sparse.values);
    let targets = part(i.buffer_view.value(), i.byte_offset.0, component, 1, false)?;
    let values = part(v.buffer_view.value(), v.byte_offset.0, base.component, base.width, base.normalized)?;
    let targets: Vec<u32> = targets.rows().map(unsigned).collect();
    if targets.iter().any(|&t| t as usize >= base.count) {
        return Err(outside());
    }
    Ok((targets, values))
}

/// `view` from `offset` on, without a stride.
fn packed(view: View<'_>, offset: u64) -> Option<View<'_>> {
    Some(View { bytes: view.bytes.get(usize::try_from(offset).ok()?..)?, stride: None })
}

impl<'a> Elements<'a> {
    fn new(
        document: &'a Document,
        accessor: &json::accessor::Accessor,
        width: usize,
        colors: bool,
        place: &str,
    ) -> Result<Self> {
        let Checked::Valid(json::accessor::GenericComponentType(component)) = accessor.component_type else {
            return Err(Error::invalid(place, "has an unknown component type; export the file again"));
        };
        let outside = || Error::invalid(place, "reaches beyond its buffer view; export the file again");
        let count = usize::try_from(accessor.count.0).map_err(|_| outside())?;
        let view = match accessor.buffer_view {
            Some(view) => {
                let view = document.view(view.value())?;
                let start = accessor.byte_offset.map_or(0, |o| o.0);
                Some(View { stride: view.stride, ..packed(view, start).ok_or_else(outside)? })
            }
            None if count > MAX_UNBACKED => {
                let message = format!("has {count} elements and no data; export the file again");
                return Err(Error::invalid(place, message));
            }
            None => None,
        };
        let normalized = accessor.normalized || colors;
        Self { view, count, component, width, normalized }.checked().ok_or_else(outside)
    }

    /// Size of an element [bytes].
    fn size(&self) -> usize {
        self.width * self.component.size()
    }

    fn stride(&self) -> usize {
        self.view.and_then(|v| v.stride).unwrap_or(self.size())
    }

    /// Itself, where every element lies within the view and elements don't overlap.
    fn checked(self) -> Option<Self> {
        if let (Some(view), true) = (self.view, self.count > 0) {
            let end = (self.count - 1).checked_mul(self.stride())?.checked_add(self.size())?;
            if end > view.bytes.len() || self.stride() < self.size() {
                return None;
            }
        }
        Some(self)
    }

    /// The bytes of each element.
    fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let (stride, size) = (self.stride(), self.size());
        let bytes = self.view.map_or(&[][..], |v| v.bytes);
        (0..self.count).filter_map(move |i| bytes.get(i * stride..i * stride + size))
    }

    /// The components of all elements.
    fn all_floats(&self) -> Vec<f32> {
        let mut values = Vec::with_capacity(self.count * self.width);
        if self.component == ComponentType::F32 {
            for row in self.rows() {
                values.extend(row.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
            }
        } else {
            for row in self.rows() {
                values.extend(self.floats(row));
            }
        }
        values
    }

    /// All elements, each an unsigned integer.
    fn all_unsigned(&self) -> Vec<u32> {
        let mut values = Vec::with_capacity(self.count);
        match self.component {
            ComponentType::U32 => {
                values.extend(self.rows().filter_map(|row| Some(u32::from_le_bytes(*row.first_chunk()?))));
            }
            ComponentType::U16 => {
                values.extend(self.rows().filter_map(|row| Some(u32::from(u16::from_le_bytes(*row.first_chunk()?)))));
            }
            _ => values.extend(self.rows().map(unsigned)),
        }
        values
    }

    /// The components of an element.
    fn floats(&self, row: &'a [u8]) -> impl Iterator<Item = f32> + use<'a> {
        let (component, normalized) = (self.component, self.normalized);
        row.chunks_exact(component.size()).map(move |bytes| float(bytes, component, normalized))
    }
}

/// A component as a number (glTF 2.0, section 3.6.2.2 and, for normalized ones, 2.1.1 of KHR_mesh_quantization).
fn float(bytes: &[u8], component: ComponentType, normalized: bool) -> f32 {
    let (value, one) = match (component, bytes) {
        (ComponentType::I8, &[a]) => (f32::from(a as i8), 127.0),
        (ComponentType::U8, &[a]) => (f32::from(a), 255.0),
        (ComponentType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (ComponentType::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (ComponentType::U32, &[a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as f32, u32::MAX as f32),
        (ComponentType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        _ => (0.0, 1.0),
    };
    if normalized { (value / one).max(-1.0) } else { value }
}

/// An unsigned little-endian integer of 1, 2 or 4 bytes.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| (value << 8) | u32::from(byte))
}
