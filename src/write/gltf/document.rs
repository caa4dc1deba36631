//! A glTF document that is being written: the JSON with its keys in order, and the one binary buffer.

use crate::error::{Error, Result};
use serde_json::{Map, Value, json};

/// A JSON object.
pub type Object = Map<String, Value>;

/// What a buffer view is for; the numbers are WebGL's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// No target: images and the like.
    None,
    Vertices,
    Indices,
}

/// The JSON and the binary chunk. Every top-level list that [`Document::new`] accepted is an array of objects.
#[derive(Debug)]
pub struct Document {
    root: Object,
    /// The bytes of buffer 0.
    pub(super) bin: Vec<u8>,
    /// Where the document came from, for messages.
    pub(super) place: String,
}

/// The top-level lists that the writers use.
const LISTS: [&str; 9] =
    ["accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "textures", "samplers"];

impl Document {
    /// Takes over a document's JSON; `bin` are the bytes of its only buffer.
    ///
    /// # Errors
    /// `Invalid` where the root, `asset` or a list of the document isn't of its type.
    pub fn new(json: Value, bin: Vec<u8>, place: String) -> Result<Self> {
        let Value::Object(root) = json else {
            return Err(Error::invalid(place, "is not a glTF document"));
        };
        for list in LISTS {
            if root.get(list).is_some_and(|v| !v.as_array().is_some_and(|a| a.iter().all(Value::is_object))) {
                return Err(Error::invalid(place, format!("{list} is not a list of objects; export the file again")));
            }
        }
        if !root.get("asset").is_some_and(Value::is_object) {
            return Err(Error::invalid(place, "asset is missing; export the file again"));
        }
        Ok(Self { root, bin, place })
    }

    /// A document with nothing in it.
    pub fn empty(place: String) -> Self {
        let mut root = Object::new();
        let generator = concat!("Lumel ", env!("CARGO_PKG_VERSION"));
        root.insert("asset".into(), json!({ "version": "2.0", "generator": generator }));
        Self { root, bin: Vec::new(), place }
    }

    /// The root object.
    pub fn root(&self) -> &Object {
        &self.root
    }

    /// The root object, to edit.
    pub fn root_mut(&mut self) -> &mut Object {
        &mut self.root
    }

    /// Number of items of the top-level list `list`.
    pub fn count(&self, list: &str) -> usize {
        self.root.get(list).and_then(Value::as_array).map_or(0, Vec::len)
    }

    /// Item `index` of the top-level list `list`.
    ///
    /// # Errors
    /// `Invalid` where there is no such item.
    pub fn item(&self, list: &str, index: usize) -> Result<&Object> {
        let item = self.root.get(list).and_then(|v| v.get(index)).and_then(Value::as_object);
        item.ok_or_else(|| missing(&self.place, list, index))
    }

    /// Item `index` of the top-level list `list`, to edit.
    ///
    /// # Errors
    /// `Invalid` where there is no such item.
    pub fn item_mut(&mut self, list: &str, index: usize) -> Result<&mut Object> {
        let item = self.root.get_mut(list).and_then(|v| v.get_mut(index)).and_then(Value::as_object_mut);
        item.ok_or_else(|| missing(&self.place, list, index))
    }

    /// Appends `item` to the top-level list `list`, which is made where it is missing; returns its index.
    pub fn push(&mut self, list: &str, item: Value) -> usize {
        let items = self.root.entry(list).or_insert_with(|| json!([]));
        match items.as_array_mut() {
            Some(items) => {
                items.push(item);
                items.len() - 1
            }
            None => {
                *items = json!([item]);
                0
            }
        }
    }

    /// Appends `bytes` to the buffer as a view of their own, 4-byte aligned; returns its index. `stride` [bytes] is given
    /// where elements are padded.
    pub fn push_view(&mut self, bytes: &[u8], target: Target, stride: Option<usize>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        self.bin.extend_from_slice(bytes);
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        match target {
            Target::None => {}
            Target::Vertices => view["target"] = 34962.into(),
            Target::Indices => view["target"] = 34963.into(),
        }
        self.push("bufferViews", view)
    }

    /// Names `extension` in `extensionsUsed`.
    pub fn use_extension(&mut self, extension: &str) {
        let used = self.root.entry("extensionsUsed").or_insert_with(|| json!([]));
        if let Some(used) = used.as_array_mut()
            && !used.iter().any(|e| e == extension)
        {
            used.push(extension.into());
        }
    }

    /// Takes `extension` out of the root and the lists of extensions.
    pub fn drop_extension(&mut self, extension: &str) {
        for list in ["extensionsUsed", "extensionsRequired"] {
            if let Some(names) = self.root.get_mut(list).and_then(Value::as_array_mut) {
                names.retain(|name| name != extension);
                if names.is_empty() {
                    self.root.shift_remove(list);
                }
            }
        }
        if let Some(extensions) = self.root.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.shift_remove(extension);
            if extensions.is_empty() {
                self.root.shift_remove("extensions");
            }
        }
    }

    /// The binary form: header, JSON chunk, BIN chunk.
    ///
    /// # Errors
    /// `Unsupported` where the file would be larger than the format's 4 GiB.
    pub fn into_glb(mut self) -> Result<Vec<u8>> {
        let mut buffer = match self.root.get_mut("buffers").and_then(|b| b.get_mut(0)).map(Value::take) {
            Some(Value::Object(buffer)) => buffer,
            _ => Object::new(),
        };
        buffer.shift_remove("uri");
        buffer.insert("byteLength".into(), self.bin.len().into());
        if self.bin.is_empty() {
            self.root.shift_remove("buffers");
        } else {
            self.root.insert("buffers".into(), json!([buffer]));
        }
        let mut text = serde_json::to_vec(&self.root)
            .map_err(|e| Error::invalid(&self.place, format!("the JSON can't be written: {e}")))?;
        text.resize(text.len().next_multiple_of(4), b' ');
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let bin_chunk = if self.bin.is_empty() { 0 } else { 8 + self.bin.len() };
        let total = u32::try_from(12 + 8 + text.len() + bin_chunk)
            .map_err(|_| Error::unsupported(&self.place, "a GLB can't be larger than 4 GiB; split the scene"))?;
        let mut glb = Vec::with_capacity(total as usize);
        let word = |glb: &mut Vec<u8>, w: u32| glb.extend_from_slice(&w.to_le_bytes());
        glb.extend_from_slice(b"glTF");
        word(&mut glb, 2);
        word(&mut glb, total);
        // Both fit: the total does.
        word(&mut glb, text.len() as u32);
        glb.extend_from_slice(b"JSON");
        glb.extend_from_slice(&text);
        if bin_chunk > 0 {
            word(&mut glb, self.bin.len() as u32);
            glb.extend_from_slice(b"BIN\0");
            glb.extend_from_slice(&self.bin);
        }
        Ok(glb)
    }
}

fn missing(place: &str, list: &str, index: usize) -> Error {
    Error::invalid(place, format!("{list}[{index}] is missing; export the file again"))
}

/// The unsigned integer under `key`.
pub fn index(object: &Object, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|v| usize::try_from(v).ok())
}

/// A number with the digits that an f32 has, not the long tail of its f64.
pub fn number(v: f32) -> Value {
    v.to_string().parse::<f64>().unwrap_or(f64::from(v)).into()
}

/// Numbers as [`number`] gives them.
pub fn numbers(values: &[f32]) -> Value {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().into()
}
