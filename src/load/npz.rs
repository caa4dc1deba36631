//! Grids of densities from NumPy's files: `.npy` (NEP 1, formats 1 to 3) and `.npz`, the zip archive of them, stored or deflated.
//!
//! An array has the shape (nz, ny, nx) in C's order: its last axis runs along X. Its numbers are of 16, 32 or 64 bits of floating
//! point, or bytes, little-endian. Nothing is taken at its word: memory grows with what is read, up to what the shape says.

use crate::error::{Error, Result};
use crate::scene::DensityGrid;
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Longest header [bytes]: one of three axes takes about a hundred.
const MOST_HEADER: usize = 1 << 16;

/// The name of the array that holds densities, of an archive with several.
const DENSITY: &str = "density";

/// Values read at a time.
const CHUNK: usize = 1 << 14;

/// A type of number, and how its bytes are read.
#[derive(Clone, Copy)]
struct Scalar {
    size: usize,
    read: fn(&[u8]) -> f32,
}

/// The grid in the bytes of a `.npy` or `.npz` file; `field` names the array of an archive, none: `density`, or the only one.
///
/// # Errors
/// `Invalid` naming `place` and what is wrong.
pub fn grid(place: &str, bytes: &[u8], field: Option<&str>) -> Result<DensityGrid> {
    let invalid = |message: String| Error::invalid(place, message);
    if bytes.starts_with(b"\x93NUMPY") {
        return array(bytes).map_err(invalid);
    }
    let broken =
        |e: zip::result::ZipError| Error::invalid(place, format!("can't be read as .npz ({e}); save it again"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(broken)?;
    let names: Vec<String> =
        archive.file_names().map(|name| name.strip_suffix(".npy").unwrap_or(name).to_owned()).collect();
    let wanted = field.unwrap_or(DENSITY);
    let name = match names.iter().find(|name| *name == wanted) {
        Some(name) => name,
        None if field.is_none() && names.len() == 1 => &names[0],
        None => {
            let known = names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
            return Err(invalid(format!("has no array {wanted}; it has {known}")));
        }
    };
    let index = archive.index_for_name(&format!("{name}.npy")).or_else(|| archive.index_for_name(name));
    let member = archive.by_index(index.unwrap_or(0)).map_err(broken)?;
    array(member).map_err(|message| Error::invalid(format!("{place}: {name}"), message))
}

/// The array that `reader` gives.
fn array(mut reader: impl Read) -> std::result::Result<DensityGrid, String> {
    let header = header(&mut reader).map_err(|e| format!("is no array of NumPy's ({e}); save it again"))?;
    let kind = value(&header, "descr").unwrap_or_default();
    let scalar = match kind.trim_matches(['\'', '"', ' ']) {
        "<f4" => Scalar { size: 4, read: |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]) },
        "<f8" => {
            Scalar { size: 8, read: |b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32 }
        }
        "<f2" => Scalar { size: 2, read: |b| half::f16::from_le_bytes([b[0], b[1]]).to_f32() },
        "|u1" => Scalar { size: 1, read: |b| f32::from(b[0]) },
        other => return Err(format!("holds numbers of the type {other}; save it as float32")),
    };
    if value(&header, "fortran_order").is_none_or(|order| order.trim() != "False") {
        return Err("is in Fortran's order; save it by numpy.ascontiguousarray".into());
    }
    let shape = value(&header, "shape").unwrap_or_default();
    let axes: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect();
    let Some([nz, ny, nx]) = axes.as_deref() else {
        return Err(format!("has the shape ({shape}); a grid has three axes: (nz, ny, nx)"));
    };
    let size = [*nx, *ny, *nz];
    let count = DensityGrid::voxel_count(size)?;
    let mut values: Vec<f32> = Vec::new();
    let mut bytes = vec![0; CHUNK * scalar.size];
    while values.len() < count {
        let part = &mut bytes[..CHUNK.min(count - values.len()) * scalar.size];
        reader.read_exact(part).map_err(|e| format!("ends before its {count} values ({e}); save it again"))?;
        values.extend(part.chunks_exact(scalar.size).map(scalar.read));
    }
    DensityGrid::new(size, values)
}

/// The dictionary at the start of a `.npy` file.
fn header(reader: &mut impl Read) -> std::io::Result<String> {
    let invalid = |what: &str| std::io::Error::new(std::io::ErrorKind::InvalidData, what);
    let mut start = [0; 8];
    reader.read_exact(&mut start)?;
    if !start.starts_with(b"\x93NUMPY") {
        return Err(invalid("it doesn't begin as one"));
    }
    // Format 1 has a length of two bytes, later ones of four.
    let mut length = [0; 4];
    let size = if start[6] == 1 { 2 } else { 4 };
    reader.read_exact(&mut length[..size])?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MOST_HEADER {
        return Err(invalid("its header is too long"));
    }
    let mut text = vec![0; length];
    reader.read_exact(&mut text)?;
    String::from_utf8(text).map_err(|_| invalid("its header is no text"))
}

/// The value of `key` in a dictionary as Python writes it, without the brackets of a tuple.
fn value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = header.split_once(&format!("'{key}'"))?;
    let rest = rest.trim_start().strip_prefix(':')?.trim_start();
    match rest.strip_prefix('(') {
        Some(tuple) => tuple.split_once(')').map(|(inside, _)| inside),
        None => rest.split([',', '}']).next(),
    }
}
