//! Accessors as blocks of bytes: read dense, picked from, and written back, whatever their component type is.

use super::document::{Document, Object, Target, index};
use crate::error::{Error, Result};
use crate::write::blend::Blend;
use crate::write::split::Sources;
use serde_json::Value;

/// Elements one after the other, without a stride.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The accessor's keys, without those that say where its data lie.
    keys: Object,
    layout: Layout,
    /// Bytes an element, the padding of matrix columns included.
    size: usize,
    bytes: Vec<u8>,
}

/// How a vertex attribute is blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Blending {
    /// The weighted sum. Integers are rounded: where positions are integers (KHR_mesh_quantization), a new vertex may lie half a
    /// step beside the straight edge that it cuts, for the triangles on both sides alike.
    Linear,
    /// The weighted sum, at the weighted mean of the lengths: a unit vector where all are. A fourth component is a sign, and that
    /// of the strongest vertex.
    Direction,
    /// That of the strongest vertex: a name or number that has nothing in between.
    Strongest,
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

    /// Its least and greatest number.
    fn range(self) -> (f64, f64) {
        match self {
            Self::I8 => (-128.0, 127.0),
            Self::U8 => (0.0, 255.0),
            Self::I16 => (-32768.0, 32767.0),
            Self::U16 => (0.0, 65535.0),
            Self::U32 => (0.0, f64::from(u32::MAX)),
            Self::F32 => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Writes `v`, rounded once to the closest number of this type, at the start of `bytes`, which hold at least `size` of them.
    fn write(self, bytes: &mut [u8], v: f64) {
        let (least, greatest) = self.range();
        let rounded = v.round().clamp(least, greatest);
        match self {
            Self::I8 => bytes[0] = rounded as i8 as u8,
            Self::U8 => bytes[0] = rounded as u8,
            Self::I16 => bytes[..2].copy_from_slice(&(rounded as i16).to_le_bytes()),
            Self::U16 => bytes[..2].copy_from_slice(&(rounded as u16).to_le_bytes()),
            Self::U32 => bytes[..4].copy_from_slice(&(rounded as u32).to_le_bytes()),
            Self::F32 => bytes[..4].copy_from_slice(&(v as f32).to_le_bytes()),
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

/// Where the numbers of an element lie.
#[derive(Clone, Copy, Debug)]
struct Layout {
    component: Component,
    columns: usize,
    rows: usize,
    /// Bytes a column: those of matrices start at multiples of 4.
    column: usize,
}

impl Layout {
    fn new(keys: &Object) -> Option<Self> {
        let component = Component::new(keys.get("componentType")?.as_u64()?)?;
        let (columns, rows) = shape(keys.get("type")?.as_str()?)?;
        let column = rows * component.size();
        Some(Self { component, columns, rows, column: if columns > 1 { column.next_multiple_of(4) } else { column } })
    }

    /// Numbers an element.
    fn width(&self) -> usize {
        self.columns * self.rows
    }

    /// Where number `c` of an element starts.
    fn offset(&self, c: usize) -> usize {
        c / self.rows * self.column + c % self.rows * self.component.size()
    }
}

/// Reads accessor `accessor`: strides, missing views (zeros) and sparse values resolved.
///
/// # Errors
/// `Invalid` where it is broken or reaches beyond its buffer.
pub fn read(doc: &Document, accessor: usize) -> Result<Elements> {
    let json = doc.item("accessors", accessor)?;
    let place = format!("{}: accessors[{accessor}]", doc.place);
    let broken = |what: &str| Error::invalid(&place, format!("{what}; export the file again"));
    let layout = Layout::new(json).ok_or_else(|| broken("has an unknown type"))?;
    let size = layout.columns * layout.column;
    let count = index(json, "count").ok_or_else(|| broken("has no count"))?;
    let total = count.checked_mul(size).filter(|n| u32::try_from(*n).is_ok()).ok_or_else(|| broken("is too large"))?;
    let mut bytes = vec![0; total];
    if let Some(view) = index(json, "bufferView") {
        let offset = index(json, "byteOffset").unwrap_or(0);
        let (data, stride) = view_bytes(doc, view)?;
        copy(&mut bytes, data.get(offset..).unwrap_or(&[]), size, stride.unwrap_or(size))
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
    Ok(Elements { keys, layout, size, bytes })
}

/// The vertex indices that accessor `accessor` holds.
///
/// # Errors
/// As [`read`]; `Invalid` where they are not unsigned integers.
pub fn read_indices(doc: &Document, accessor: usize) -> Result<Vec<u32>> {
    let elements = read(doc, accessor)?;
    match elements.layout {
        Layout { component: c @ (Component::U8 | Component::U16 | Component::U32), columns: 1, rows: 1, column } => {
            Ok(elements.bytes.chunks_exact(column).map(|b| c.read(b) as u32).collect())
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

/// Fills `to` with the elements of `from`.
fn copy(to: &mut [u8], from: &[u8], size: usize, stride: usize) -> Option<()> {
    for (i, to) in to.chunks_exact_mut(size).enumerate() {
        let start = i.checked_mul(stride)?;
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
        let bytes = rows.into_iter().flatten().flat_map(f32::to_le_bytes).collect();
        Self::new(Component::F32, 5126, N, bytes)
    }

    /// Elements of four 8-bit numbers that stand for 0..=1; what lies beyond is clamped.
    pub fn normalized_u8(rows: impl IntoIterator<Item = [f32; 4]>) -> Self {
        let bytes = rows.into_iter().flatten().map(|v| (f64::from(v) * 255.0).round() as u8).collect();
        Self::new(Component::U8, 5121, 4, bytes).normalized()
    }

    /// Elements of four 16-bit numbers that stand for 0..=1; what lies beyond is clamped.
    pub fn normalized_u16(rows: impl IntoIterator<Item = [f32; 4]>) -> Self {
        let number = |v: f32| ((f64::from(v) * 65535.0).round() as u16).to_le_bytes();
        Self::new(Component::U16, 5123, 4, rows.into_iter().flatten().flat_map(number).collect()).normalized()
    }

    fn new(component: Component, code: u32, width: usize, bytes: Vec<u8>) -> Self {
        let mut keys = Object::new();
        keys.insert("componentType".into(), code.into());
        keys.insert("type".into(), ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1].into());
        let size = width * component.size();
        Self { keys, layout: Layout { component, columns: 1, rows: width, column: size }, size, bytes }
    }

    fn normalized(mut self) -> Self {
        self.keys.insert("normalized".into(), true.into());
        self
    }

    /// True where integers stand for 0..=1 or -1..=1.
    pub fn is_normalized(&self) -> bool {
        self.keys.get("normalized").and_then(Value::as_bool) == Some(true)
    }

    /// True where they are floats.
    pub fn is_float(&self) -> bool {
        self.layout.component == Component::F32
    }

    /// The number that stands for 1.
    pub fn one(&self) -> f64 {
        if self.is_normalized() && !self.is_float() { self.layout.component.range().1 } else { 1.0 }
    }

    /// Numbers an element.
    pub fn width(&self) -> usize {
        self.layout.width()
    }

    /// Number `c` of element `i` as it is stored; both in range.
    pub fn number(&self, i: usize, c: usize) -> f64 {
        self.layout.component.read(&self.bytes[i * self.size + self.layout.offset(c)..])
    }

    /// Sets number `c` of element `i`, both in range, to the closest one to `v` that its type has.
    pub fn set_number(&mut self, i: usize, c: usize, v: f64) {
        self.layout.component.write(&mut self.bytes[i * self.size + self.layout.offset(c)..], v);
    }

    /// Elements of two components as numbers, normalized integers as 0..=1; `None` where they have another shape.
    pub fn pairs(&self) -> Option<Vec<[f32; 2]>> {
        if (self.layout.columns, self.layout.rows) != (1, 2) {
            return None;
        }
        let (one, least) = (self.one(), if self.is_normalized() { -1.0 } else { f64::MIN });
        let number = |i: usize, c: usize| (self.number(i, c) / one).max(least) as f32;
        Some((0..self.count()).map(|i| [number(i, 0), number(i, 1)]).collect())
    }

    /// Demands that `min` and `max` be written.
    pub fn with_bounds(mut self) -> Self {
        self.keys.insert("min".into(), Value::Null);
        self
    }

    /// The elements that `sources` name, in that order, byte for byte, and blends of them; `None` where one is out of range.
    pub fn gather(&self, sources: &Sources, blending: Blending) -> Option<Self> {
        let count = self.count();
        if sources.iter().any(|s| s.terms().any(|(v, _)| v as usize >= count)) {
            return None;
        }
        let bytes = vec![0; sources.len() * self.size];
        let mut gathered = Self { keys: self.keys.clone(), layout: self.layout, size: self.size, bytes };
        for (i, source) in sources.iter().enumerate() {
            let copied = match blending {
                Blending::Strongest => Some(source.strongest()),
                _ => source.as_vertex(),
            };
            match copied {
                Some(v) => {
                    let from = v as usize * self.size;
                    let bytes = &self.bytes[from..from + self.size];
                    gathered.bytes[i * self.size..(i + 1) * self.size].copy_from_slice(bytes);
                }
                None if blending == Blending::Direction => self.blend_direction(&source, i, &mut gathered),
                None => (0..self.width()).for_each(|c| gathered.set_number(i, c, self.sum(&source, c))),
            }
        }
        Some(gathered)
    }

    /// The weighted sum of the numbers `c`.
    fn sum(&self, source: &Blend, c: usize) -> f64 {
        source.sum(|v| [self.number(v as usize, c)])[0]
    }

    /// Element `i` of `to`: see [`Blending::Direction`].
    fn blend_direction(&self, source: &Blend, i: usize, to: &mut Self) {
        let vector = |v: usize| [0, 1, 2].map(|c| if c < self.width() { self.number(v, c) } else { 0.0 });
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let sum = source.sum(|v| vector(v as usize));
        let [wanted] = source.sum(|v| [length(vector(v as usize))]);
        let strongest = source.strongest() as usize;
        // Where they cancel no direction is better than another.
        let direction = if length(sum) > 1e-6 * wanted { sum } else { vector(strongest) };
        let scale = if length(direction) > 0.0 { wanted / length(direction) } else { 0.0 };
        let scaled = direction.map(|v| v * scale);
        let sign = (3..self.width()).map(|c| self.number(strongest, c));
        scaled.into_iter().take(self.width()).chain(sign).enumerate().for_each(|(c, v)| to.set_number(i, c, v));
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
        let mut bounds = vec![(f64::INFINITY, f64::NEG_INFINITY); self.width()];
        for i in 0..self.count() {
            for (c, bound) in bounds.iter_mut().enumerate() {
                let v = self.number(i, c);
                *bound = (bound.0.min(v), bound.1.max(v));
            }
        }
        // Integers are written without a fraction, as the validator wants them.
        let value = |v: f64| if self.is_float() { Value::from(v) } else { Value::from(v as i64) };
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
