//! The container and the JSON document: chunks, buffers, and typed access to single items.

use super::uri::{Resource, resolve};
use super::{extension, meshopt, variant};
use crate::error::{Error, Result, Warnings};
use crate::load::access::Access;
use ::gltf::json;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A glTF file with its buffers.
pub(super) struct Document {
    pub path: PathBuf,
    pub json: Value,
    pub buffers: Vec<Vec<u8>>,
    /// The files that were read so far.
    pub inputs: Vec<PathBuf>,
    /// What may be read.
    pub access: Access,
    /// The file, for messages.
    place: String,
}

/// A part of a buffer.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub bytes: &'a [u8],
    /// Distance between elements [bytes]; `None` where they are packed.
    pub stride: Option<usize>,
}

impl Document {
    /// Reads the file and its buffers, and refuses what can't be read (see [`extension::check`]). Compressed views are
    /// decoded, and the materials of `variants` stand in the place of the default ones.
    pub fn open(path: &Path, variants: &[String], access: &Access, warnings: &mut Warnings) -> Result<Self> {
        let place = path.display().to_string();
        let mut bytes = access.read(path)?;
        let (json, bin) = if bytes.starts_with(b"glTF") { chunks(&bytes, &place)? } else { (0..bytes.len(), None) };
        let json = bytes.get(json).unwrap_or_default();
        // The specification forbids a byte order mark and allows readers to skip it.
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        if json.is_empty() {
            return Err(Error::invalid(&place, "the file is empty; export it again"));
        }
        let mut json: Value = serde_json::from_slice(json)
            .map_err(|e| Error::invalid(&place, format!("not a glTF document: {e}; export it again")))?;
        let version = json.pointer("/asset/version").and_then(Value::as_str);
        match version {
            Some(v) if v.starts_with("2.") => {}
            Some(v) => {
                return Err(Error::unsupported(&place, format!("glTF version {v}; export it as glTF 2.0")));
            }
            None => {
                return Err(Error::invalid(&place, "not a glTF document: asset.version is missing; export it again"));
            }
        }
        extension::check(&json, &place, warnings)?;
        extension::forget_draco_copies(&mut json);
        variant::choose(&mut json, variants, &place)?;
        // The file's own memory becomes that of buffer 0: a copy would be as large as the geometry.
        let bin = bin.map(|range| {
            bytes.truncate(range.end);
            bytes.drain(..range.start.min(bytes.len()));
            bytes
        });
        let (buffers, inputs, access) = (Vec::new(), vec![path.to_owned()], access.clone());
        let mut document = Self { path: path.to_owned(), json, buffers, inputs, access, place };
        document.read_buffers(bin)?;
        if meshopt::is_used(&document.json) {
            meshopt::decompress(&mut document)?;
        }
        Ok(document)
    }

    /// Number of items in a top-level list, such as `nodes`.
    pub fn count(&self, section: &str) -> usize {
        self.json.get(section).and_then(Value::as_array).map_or(0, Vec::len)
    }

    /// Item `index` of a top-level list.
    pub fn item<T: DeserializeOwned>(&self, section: &str, index: usize) -> Result<T> {
        let item = self.json.get(section).and_then(|s| s.get(index));
        let item = item.ok_or_else(|| {
            let message = format!("is referred to, but the file has {} of them; export it again", self.count(section));
            Error::invalid(self.place(section, index), message)
        })?;
        self.parse(item, section, index)
    }

    /// `value`, which belongs to item `index` of `section`, as a `T`.
    pub fn parse<T: DeserializeOwned>(&self, value: &Value, section: &str, index: usize) -> Result<T> {
        T::deserialize(value)
            .map_err(|e| Error::invalid(self.place(section, index), format!("{e}; export the file again")))
    }

    /// The file alone, for messages.
    pub fn file(&self) -> &str {
        &self.place
    }

    /// The file and an item with its name, for messages.
    pub fn place(&self, section: &str, index: usize) -> String {
        let name = self.json.get(section).and_then(|s| s.get(index)).and_then(|i| i.get("name"));
        match name.and_then(Value::as_str) {
            Some(name) => format!("{}: {section}[{index}] \"{name}\"", self.place),
            None => format!("{}: {section}[{index}]", self.place),
        }
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<View<'_>> {
        let view: json::buffer::View = self.item("bufferViews", index)?;
        let start = view.byte_offset.map_or(Some(0), |o| usize::try_from(o.0).ok());
        let length = usize::try_from(view.byte_length.0).ok();
        let buffer = self.buffers.get(view.buffer.value());
        let bytes = start.zip(length).and_then(|(start, length)| buffer?.get(start..start.checked_add(length)?));
        let bytes = bytes.ok_or_else(|| {
            Error::invalid(self.place("bufferViews", index), "lies outside of its buffer; export the file again")
        })?;
        Ok(View { bytes, stride: view.byte_stride.map(|s| s.0).filter(|&s| s > 0) })
    }

    fn read_buffers(&mut self, mut bin: Option<Vec<u8>>) -> Result<()> {
        let compressed = meshopt::is_used(&self.json);
        for index in 0..self.count("buffers") {
            let buffer: json::buffer::Buffer = self.item("buffers", index)?;
            let place = self.place("buffers", index);
            let chunk = bin.take().filter(|_| index == 0);
            let in_json = self.json.get("buffers").and_then(|b| b.get(index));
            if compressed && (in_json.is_some_and(meshopt::is_fallback) || (buffer.uri.is_none() && chunk.is_none())) {
                self.buffers.push(Vec::new());
                continue;
            }
            let mut bytes = match (&buffer.uri, chunk) {
                (Some(uri), _) => match resolve(&self.path, uri, &place)? {
                    Resource::Bytes(bytes) => bytes,
                    Resource::File(file) => {
                        let bytes = self.access.read(&file)?;
                        self.inputs.push(file);
                        bytes
                    }
                },
                (None, Some(bin)) => bin,
                (None, None) => {
                    return Err(Error::invalid(place, "has neither a URI nor a GLB chunk; export it again"));
                }
            };
            let length = usize::try_from(buffer.byte_length.0).ok().filter(|&l| l <= bytes.len());
            let length = length.ok_or_else(|| {
                let message = format!(
                    "is cut off: {} bytes are there of {}; export or copy the file again",
                    bytes.len(),
                    buffer.byte_length.0
                );
                Error::invalid(&place, message)
            })?;
            bytes.truncate(length);
            self.buffers.push(bytes);
        }
        Ok(())
    }
}

/// Where the JSON and BIN chunks of a GLB are (glTF 2.0 section 4.4). Unknown chunks are skipped, as the specification asks; the
/// `gltf` crate's parser refuses them, and trusts the header's length.
fn chunks(bytes: &[u8], place: &str) -> Result<(Range<usize>, Option<Range<usize>>)> {
    let cut = || Error::invalid(place, "the GLB is cut off; export or copy it again");
    let word = |at: usize| {
        let bytes = bytes.get(at..at.checked_add(4)?)?;
        usize::try_from(u32::from_le_bytes(bytes.try_into().ok()?)).ok()
    };
    let version = word(4).ok_or_else(cut)?;
    if version != 2 {
        return Err(Error::unsupported(place, format!("GLB version {version}; export it as glTF 2.0")));
    }
    let length = word(8).filter(|&l| l <= bytes.len()).ok_or_else(cut)?;
    let (mut json, mut bin) = (None, None);
    let mut at = 12;
    while at < length {
        let (size, kind) = (word(at).ok_or_else(cut)?, bytes.get(at + 4..at + 8).ok_or_else(cut)?);
        let start = at + 8;
        let end = start.checked_add(size).filter(|&end| end <= length).ok_or_else(cut)?;
        match kind {
            b"JSON" if json.is_none() => json = Some(start..end),
            b"BIN\0" if bin.is_none() => bin = Some(start..end),
            _ => {}
        }
        at = end;
    }
    let json = json.ok_or_else(|| Error::invalid(place, "the GLB has no JSON chunk; export it again"))?;
    Ok((json, bin))
}
