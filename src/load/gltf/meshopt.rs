//! EXT_meshopt_compression and KHR_meshopt_compression: compressed buffer views to plain ones.
//!
//! Each compressed view gets a buffer of its own that holds it decoded, and the extension leaves the document: readers and
//! writers after this see an ordinary file. Sizes, modes and filters are checked before memory is taken, and the number of
//! elements against the least bytes that a stream of them can have.

use super::document::Document;
use crate::error::{Error, Result};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};

/// Both names; the bitstreams tell their version themselves.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Most decoded bytes a byte of an attribute stream: a control byte stands for four bytes of up to 256 elements.
const MOST_RATIO: usize = 1024;
/// Decoded bytes that any stream may have, for streams too short for their ratio to mean anything.
const SMALL: usize = 1 << 16;

/// The extension's object on a buffer view.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: String,
    #[serde(default)]
    filter: Option<String>,
}

/// The extension's object on a view or buffer.
fn extension(item: &Value) -> Option<&Value> {
    EXTENSIONS.iter().find_map(|name| item.get("extensions")?.get(name))
}

/// True for a buffer that only stands in for what compressed views hold: it is not read.
pub(super) fn is_fallback(buffer: &Value) -> bool {
    extension(buffer).and_then(|e| e.get("fallback")) == Some(&Value::Bool(true))
}

/// True where a view is compressed.
pub(super) fn is_used(json: &Value) -> bool {
    let views = json.get("bufferViews").and_then(Value::as_array);
    views.is_some_and(|views| views.iter().any(|v| extension(v).is_some()))
}

/// Decodes all compressed views of `document`, in parallel.
///
/// # Errors
/// `Invalid` naming the view whose description or stream is broken.
pub(super) fn decompress(document: &mut Document) -> Result<()> {
    let views: Vec<usize> = (0..document.count("bufferViews"))
        .filter(|&i| document.json.get("bufferViews").and_then(|v| extension(v.get(i)?)).is_some())
        .collect();
    let shared: &Document = document;
    let decoded: Vec<Vec<u8>> = views.par_iter().map(|&view| decode_view(shared, view)).collect::<Result<_>>()?;
    for (view, bytes) in views.into_iter().zip(decoded) {
        let buffer = document.buffers.len();
        let length = bytes.len();
        document.buffers.push(bytes);
        if let Some(buffers) = document.json.get_mut("buffers").and_then(Value::as_array_mut) {
            buffers.push(json!({ "byteLength": length }));
        }
        let view = document.json.get_mut("bufferViews").and_then(|v| v.get_mut(view)).and_then(Value::as_object_mut);
        if let Some(view) = view {
            view.insert("buffer".to_owned(), buffer.into());
            view.shift_remove("byteOffset");
        }
    }
    forget(&mut document.json);
    Ok(())
}

/// Takes the extensions out of the document.
fn forget(json: &mut Value) {
    for section in ["bufferViews", "buffers"] {
        for item in json.get_mut(section).and_then(Value::as_array_mut).into_iter().flatten() {
            let Some(item) = item.as_object_mut() else { continue };
            let Some(extensions) = item.get_mut("extensions").and_then(Value::as_object_mut) else { continue };
            EXTENSIONS.iter().for_each(|name| drop(extensions.shift_remove(*name)));
            if extensions.is_empty() {
                item.shift_remove("extensions");
            }
        }
    }
    super::extension::forget(json, &EXTENSIONS);
}

/// The decoded bytes of view `index`.
fn decode_view(document: &Document, index: usize) -> Result<Vec<u8>> {
    let view: Value = document.item("bufferViews", index)?;
    let place = document.place("bufferViews", index);
    let broken = |what: &str| Error::invalid(&place, format!("{what}; export the file again"));
    let compressed: Compressed = document.parse(extension(&view).unwrap_or(&Value::Null), "bufferViews", index)?;
    let Compressed { byte_stride: stride, count, .. } = compressed;
    let length =
        stride.checked_mul(count).filter(|l| view.get("byteLength").and_then(Value::as_u64) == Some(*l as u64));
    let length = length.ok_or_else(|| broken("is compressed, and its size is not that of what it holds"))?;
    let end = compressed.byte_offset.checked_add(compressed.byte_length);
    let buffer = document.buffers.get(compressed.buffer);
    let stream = end.and_then(|end| buffer?.get(compressed.byte_offset..end));
    let stream = stream.ok_or_else(|| broken("is compressed, and its stream lies outside of its buffer"))?;
    let filter = compressed.filter.as_deref().unwrap_or("NONE");
    let unknown = || {
        Error::invalid(
            &place,
            format!(
                "is compressed by mode {} and filter {filter} with a stride of {stride}, which no version of the extension allows; \
         export the file again",
                compressed.mode
            ),
        )
    };
    let most = match compressed.mode.as_str() {
        "ATTRIBUTES" => stream.len().saturating_mul(MOST_RATIO),
        // A byte a triangle, and a byte an index.
        "TRIANGLES" => stream.len().saturating_mul(3 * stride),
        _ => stream.len().saturating_mul(stride),
    };
    if length > most.saturating_add(SMALL) {
        return Err(broken("is compressed, and its stream is too short for what it should hold"));
    }
    let bytes = match (compressed.mode.as_str(), filter, stride) {
        ("ATTRIBUTES", _, _) => attributes(stream, count, stride, filter).ok_or_else(unknown)?,
        ("TRIANGLES", "NONE", 2) if count.is_multiple_of(3) => meshopt::decode_index_buffer::<u16>(stream, count)
            .map(|v| v.into_iter().flat_map(u16::to_le_bytes).collect()),
        ("TRIANGLES", "NONE", 4) if count.is_multiple_of(3) => meshopt::decode_index_buffer::<u32>(stream, count)
            .map(|v| v.into_iter().flat_map(u32::to_le_bytes).collect()),
        ("INDICES", "NONE", 2) => meshopt::decode_index_sequence::<u16>(stream, count)
            .map(|v| v.into_iter().flat_map(u16::to_le_bytes).collect()),
        ("INDICES", "NONE", 4) => meshopt::decode_index_sequence::<u32>(stream, count)
            .map(|v| v.into_iter().flat_map(u32::to_le_bytes).collect()),
        _ => return Err(unknown()),
    };
    bytes.map_err(|_| broken("is compressed, and its stream can't be decoded"))
}

/// An element of `N` 32-bit words.
#[derive(Clone)]
#[repr(transparent)]
struct Element<const N: usize>([u32; N]);

impl<const N: usize> Default for Element<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// Decodes `count` elements of `stride` bytes and applies `filter`; `None` where the stride doesn't fit.
fn attributes(stream: &[u8], count: usize, stride: usize, filter: &str) -> Option<meshopt::Result<Vec<u8>>> {
    let fits = match filter {
        "NONE" | "EXPONENTIAL" => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        "OCTAHEDRAL" | "COLOR" => stride == 4 || stride == 8,
        "QUATERNION" => stride == 8,
        _ => false,
    };
    if !fits {
        return None;
    }
    let bytes = match elements(stream, count, stride / 4)? {
        Ok(bytes) => bytes,
        Err(e) => return Some(Err(e)),
    };
    Some(Ok(match (filter, stride) {
        ("OCTAHEDRAL", 4) => {
            filtered(&bytes, |b: [u8; 1]| i8::from_le_bytes(b), meshopt::decode_filter_oct, i8::to_le_bytes)
        }
        ("OCTAHEDRAL", _) => filtered(&bytes, i16::from_le_bytes, meshopt::decode_filter_oct, i16::to_le_bytes),
        ("COLOR", 4) => filtered(&bytes, |b: [u8; 1]| b[0], meshopt::decode_filter_color, u8::to_le_bytes),
        ("COLOR", _) => filtered(&bytes, u16::from_le_bytes, meshopt::decode_filter_color, u16::to_le_bytes),
        ("QUATERNION", _) => filtered(&bytes, i16::from_le_bytes, meshopt::decode_filter_quat, i16::to_le_bytes),
        ("EXPONENTIAL", _) => {
            let mut words: Vec<[u32; 1]> = bytes.as_chunks().0.iter().map(|b| [u32::from_le_bytes(*b)]).collect();
            meshopt::decode_filter_exp(&mut words);
            words.into_iter().flat_map(|w| w[0].to_le_bytes()).collect()
        }
        _ => bytes,
    }))
}

/// Applies a filter over rows of four components of `SIZE` bytes.
fn filtered<T: Copy + Default, const SIZE: usize>(
    bytes: &[u8],
    read: impl Fn([u8; SIZE]) -> T,
    filter: impl Fn(&mut [[T; 4]]),
    write: impl Fn(T) -> [u8; SIZE],
) -> Vec<u8> {
    let components: Vec<T> = bytes.as_chunks().0.iter().map(|b| read(*b)).collect();
    let mut rows: Vec<[T; 4]> = components.as_chunks().0.to_vec();
    filter(&mut rows);
    rows.into_iter().flatten().flat_map(write).collect()
}

/// Decodes `count` elements of `words` 32-bit words, 1 to 64; the decoder takes the size from a type.
fn elements(stream: &[u8], count: usize, words: usize) -> Option<meshopt::Result<Vec<u8>>> {
    fn decode<const N: usize>(stream: &[u8], count: usize) -> meshopt::Result<Vec<u8>> {
        let elements = meshopt::decode_vertex_buffer::<Element<N>>(stream, count)?;
        // The decoder wrote bytes: words are in the machine's own order.
        let mut bytes = Vec::with_capacity(count * N * 4);
        elements.iter().flat_map(|e| &e.0).for_each(|word| bytes.extend_from_slice(&word.to_ne_bytes()));
        Ok(bytes)
    }
    macro_rules! of_size {
        ($($n:literal)*) => { match words { $($n => Some(decode::<$n>(stream, count)),)* _ => None } };
    }
    of_size!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}
