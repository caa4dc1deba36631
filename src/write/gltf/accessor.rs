//! Accessors as blocks of bytes: read dense, picked from, and written back, whatever their component type is.

use super::document::{Document, Object, Target, index};
use crate::error::{Error, Result};
use serde_json::Value;

/// Elements one after the other, without a stride.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The accessor's keys, without those that say where its data lie.
    keys: Object,
    /// Bytes an element, the padding of matrix columns included.
    size: usize,
    bytes: Vec<u8>,
}

/// Numbers of a vertex attribute or of indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn new(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The number at the start of `bytes`, which hold at least `size` of them.
    fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }
}

/// Columns and rows of an accessor type.
fn shape(name: &str) -> Option<(usize, usize)> {
    Some(match name {
        "SCALAR" => (1, 1),
        "VEC2" => (1, 2),
        "VEC3" => (1, 3),
        "VEC4" => (1, 4),
        "MAT2" => (2, 2),
        "MAT3" => (3, 3),
        "MAT4" => (4, 4),
        _ => return None,
    })
}

/// Component type, columns, rows, and bytes a column: those of matrices start at multiples of 4.
fn layout(keys: &Object) -> Option<(Component, usize, usize, usize)> {
    let component = Component::new(keys.get("componentType")?.as_u64()?)?;
    let (columns, rows) = shape(keys.get("type")?.as_str()?)?;
    let column = rows * component.size();
    Some((component, columns, rows, if columns > 1 { column.next_multiple_of(4) } else { column }))
}

/// Reads accessor `accessor`: strides, missing views (zeros) and sparse values resolved.
///
/// # Errors
/// `Invalid` where it is broken or reaches beyond its buffer.
pub fn read(doc: &Document, accessor: usize) -> Result<Elements> {
    let json = doc.item("accessors", accessor)?;
    let place = format!("{}: accessors[{accessor}]", doc.place);
    let broken = |what: &str| Error::invalid(&place, format!("{what}; export the file again"));
    let (_, columns, _, column) = layout(json).ok_or_else(|| broken("has an unknown type"))?;
    let size = columns * column;
    let count = index(json, "count").ok_or_else(|| broken("has no count"))?;
    let total = count.checked_mul(size).filter(|n| u32::try_from(*n).is_ok()).ok_or_else(|| broken("is too large"))?;
    let mut bytes = vec![0; total];
    if let Some(view) = index(json, "bufferView") {
        let offset = index(json, "byteOffset").unwrap_or(0);
        let (data, stride) = view_bytes(doc, view)?;
        copy(&mut bytes, data.get(offset..).unwrap_or(&[]), size, stride.unwrap_or(size), Some)
            .ok_or_else(|| broken("reaches beyond its buffer"))?;
    }
    if let Some(sparse) = json.get("sparse").and_then(Value::as_object) {
        let part = |name: &str| {
            let part = sparse.get(name).and_then(Value::as_object)?;
            Some((part, index(part, "bufferView")?, index(part, "byteOffset").unwrap_or(0)))
        };
        let replaced = index(sparse, "count").unwrap_or(0);
        let (Some((indices, indices_view, indices_offset)), Some((_, values_view, values_offset))) =
            (part("indices"), part("values"))
        else {
            return Err(broken("has broken sparse values"));
        };
        let kind = indices.get("componentType").and_then(Value::as_u64).and_then(Component::new);
        let kind = kind.filter(|k| *k != Component::F32).ok_or_else(|| broken("has broken sparse indices"))?;
        let indices = view_bytes(doc, indices_view)?.0.get(indices_offset..).unwrap_or(&[]);
        let targets: Vec<usize> =
            indices.chunks_exact(kind.size()).take(replaced).map(|b| kind.read(b) as usize).collect();
        let values = view_bytes(doc, values_view)?.0.get(values_offset..).unwrap_or(&[]);
        let values = values.get(..replaced.saturating_mul(size)).filter(|_| targets.len() == replaced);
        for (target, value) in
            targets.iter().zip(values.ok_or_else(|| broken("has broken sparse values"))?.chunks(size))
        {
            let place = bytes.get_mut(target * size..(target + 1) * size);
            place.ok_or_else(|| broken("has sparse indices out of range"))?.copy_from_slice(value);
        }
    }
    let mut keys = json.clone();
    for key in ["bufferView", "byteOffset", "sparse", "count"] {
        keys.shift_remove(key);
    }
    Ok(Elements { keys, size, bytes })
}

/// The vertex indices that accessor `accessor` holds.
///
/// # Errors
/// As [`read`]; `Invalid` where they are not unsigned integers.
pub fn read_indices(doc: &Document, accessor: usize) -> Result<Vec<u32>> {
    let elements = read(doc, accessor)?;
    match layout(&elements.keys) {
        Some((c @ (Component::U8 | Component::U16 | Component::U32), 1, 1, size)) => {
            Ok(elements.bytes.chunks_exact(size).map(|b| c.read(b) as u32).collect())
        }
        _ => Err(Error::invalid(&doc.place, format!("accessors[{accessor}] holds no indices; export the file again"))),
    }
}

/// The bytes of view `view`, and its stride.
fn view_bytes(doc: &Document, view: usize) -> Result<(&[u8], Option<usize>)> {
    let json = doc.item("bufferViews", view)?;
    let offset = index(json, "byteOffset").unwrap_or(0);
    let length = index(json, "byteLength").unwrap_or(0);
    let bytes = offset.checked_add(length).and_then(|end| doc.bin.get(offset..end));
    let place = || format!("{}: bufferViews[{view}]", doc.place);
    let bytes = bytes.ok_or_else(|| Error::invalid(place(), "reaches beyond its buffer; export the file again"))?;
    Ok((bytes, index(json, "byteStride").filter(|s| *s > 0)))
}

/// Fills `to` with the elements of `from` that `pick` names.
fn copy(to: &mut [u8], from: &[u8], size: usize, stride: usize, pick: impl Fn(usize) -> Option<usize>) -> Option<()> {
    for (i, to) in to.chunks_exact_mut(size).enumerate() {
        let start = pick(i)?.checked_mul(stride)?;
        to.copy_from_slice(from.get(start..start.checked_add(size)?)?);
    }
    Some(())
}

impl Elements {
    /// Number of elements.
    pub fn count(&self) -> usize {
        self.bytes.len() / self.size
    }

    /// Elements of 32-bit floats, one `[f32; N]` each; `N` 1 to 4.
    pub fn floats<const N: usize>(rows: impl IntoIterator<Item = [f32; N]>) -> Self {
        let mut keys = Object::new();
        keys.insert("componentType".into(), 5126.into());
        keys.insert("type".into(), ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1].into());
        let bytes = rows.into_iter().flatten().flat_map(f32::to_le_bytes).collect();
        Self { keys, size: 4 * N, bytes }
    }

    /// Elements of two components as numbers, normalized integers as 0..=1; `None` where they have another shape.
    pub fn pairs(&self) -> Option<Vec<[f32; 2]>> {
        let (component, 1, 2, size) = layout(&self.keys)? else { return None };
        let is_normalized = self.keys.get("normalized").and_then(Value::as_bool) == Some(true);
        let most = match component {
            Component::I8 => 127.0,
            Component::U8 => 255.0,
            Component::I16 => 32767.0,
            Component::U16 => 65535.0,
            Component::U32 | Component::F32 => 1.0,
        };
        let most = if is_normalized { most } else { 1.0 };
        let number =
            |bytes: &[u8]| (component.read(bytes) / most).max(if is_normalized { -1.0 } else { f64::MIN }) as f32;
        let pair = |bytes: &[u8]| [number(bytes), number(&bytes[component.size()..])];
        Some(self.bytes.chunks_exact(size).map(pair).collect())
    }

    /// Demands that `min` and `max` be written.
    pub fn with_bounds(mut self) -> Self {
        self.keys.insert("min".into(), Value::Null);
        self
    }

    /// The elements that `sources` name, in that order; all must be in range.
    pub fn gather(&self, sources: &[u32]) -> Option<Self> {
        let mut bytes = vec![0; sources.len() * self.size];
        copy(&mut bytes, &self.bytes, self.size, self.size, |i| Some(sources[i] as usize))?;
        Some(Self { keys: self.keys.clone(), size: self.size, bytes })
    }

    /// Appends them to `doc` as a vertex attribute; returns the accessor's index. Bounds are found anew where there were
    /// any.
    pub fn push(&self, doc: &mut Document) -> usize {
        let stride = self.size.next_multiple_of(4);
        let view = if stride == self.size {
            doc.push_view(&self.bytes, Target::Vertices, None)
        } else {
            let mut padded = vec![0; self.count() * stride];
            for (to, from) in padded.chunks_exact_mut(stride).zip(self.bytes.chunks_exact(self.size)) {
                to[..self.size].copy_from_slice(from);
            }
            doc.push_view(&padded, Target::Vertices, Some(stride))
        };
        let mut accessor = Object::new();
        accessor.insert("bufferView".into(), view.into());
        accessor.insert("count".into(), self.count().into());
        accessor.extend(self.keys.clone());
        if self.keys.contains_key("min") || self.keys.contains_key("max") {
            let (min, max) = self.bounds();
            accessor.insert("min".into(), min);
            accessor.insert("max".into(), max);
        }
        doc.push("accessors", accessor.into())
    }

    /// Least and greatest value of each component.
    fn bounds(&self) -> (Value, Value) {
        let Some((component, columns, rows, column)) = layout(&self.keys) else {
            return (Value::Null, Value::Null);
        };
        let offsets = || (0..columns).flat_map(|c| (0..rows).map(move |r| c * column + r * component.size()));
        let mut bounds = vec![(f64::INFINITY, f64::NEG_INFINITY); columns * rows];
        for element in self.bytes.chunks_exact(self.size) {
            for (bound, offset) in bounds.iter_mut().zip(offsets()) {
                let v = component.read(&element[offset..]);
                *bound = (bound.0.min(v), bound.1.max(v));
            }
        }
        // Integers are written without a fraction, as the validator wants them.
        let value = |v: f64| if component == Component::F32 { Value::from(v) } else { Value::from(v as i64) };
        (bounds.iter().map(|b| value(b.0)).collect(), bounds.iter().map(|b| value(b.1)).collect())
    }
}

/// Appends triangles' indices to `doc`: 16 bits where `vertex_count` allows (65535 restarts primitives), else 32.
pub fn push_triangles(doc: &mut Document, triangles: &[[u32; 3]], vertex_count: usize) -> usize {
    let flat = triangles.iter().flatten();
    let (bytes, kind): (Vec<u8>, u32) = if vertex_count <= usize::from(u16::MAX) {
        (flat.flat_map(|v| (*v as u16).to_le_bytes()).collect(), 5123)
    } else {
        (flat.flat_map(|v| v.to_le_bytes()).collect(), 5125)
    };
    let view = doc.push_view(&bytes, Target::Indices, None);
    let count = triangles.len() * 3;
    doc.push(
        "accessors",
        serde_json::json!({ "bufferView": view, "componentType": kind, "count": count, "type": "SCALAR" }),
    )
}
