//! Small glTF documents that tests write, and folders for them.
#![allow(dead_code)] // each test file uses its own share

pub use crate::files::Folder;
use lumel::load::gltf::load as load_with;
use lumel::load::{LoadOptions, Loaded};
use lumel::scene::{Mesh, Scene};
use serde_json::{Value, json};
use std::path::Path;

/// Reads a file as it stands.
pub fn load_gltf(path: &Path) -> lumel::Result<Loaded> {
    load_with(path, &LoadOptions::default())
}

/// The area of a surface [m^2].
pub fn area(scene: &Scene, surface: usize) -> f32 {
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let triangle = |t| {
        let [a, b, c] = scene.world_triangle(surface, t);
        (b - a).cross(c - a).length() / 2.0
    };
    (0..mesh.triangles.len()).map(triangle).sum()
}

/// A document under construction: one buffer, with a view and an accessor for each list of numbers.
#[derive(Default)]
pub struct Builder {
    pub bin: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
}

impl Builder {
    /// A buffer view over `bytes`.
    pub fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        self.bin.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    pub fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    pub fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.accessor(json!({ "bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind }))
    }

    pub fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        self.accessor(json!({ "bufferView": view, "componentType": 5123, "count": values.len(), "type": "SCALAR" }))
    }

    /// `document` with the asset, buffers and accessors added, the buffer as a data URI.
    pub fn gltf(self, document: Value) -> Vec<u8> {
        let uri = format!("data:application/octet-stream;base64,{}", base64(&self.bin));
        let length = self.bin.len();
        serde_json::to_vec(&self.finish(document, json!({ "uri": uri, "byteLength": length }))).unwrap()
    }

    pub fn glb(self, document: Value) -> Vec<u8> {
        let bin = self.bin.clone();
        let mut json = serde_json::to_vec(&self.finish(document, json!({ "byteLength": bin.len() }))).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = bin;
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
            out.extend((chunk.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(chunk);
        }
        out
    }

    pub fn finish(self, mut document: Value, buffer: Value) -> Value {
        document["asset"] = json!({ "version": "2.0" });
        if !self.bin.is_empty() {
            document["buffers"] = json!([buffer]);
            document["bufferViews"] = json!(self.views);
        }
        document["accessors"] = json!(self.accessors);
        document
    }
}

pub fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |b, i| b << 8 | u32::from(chunk.get(i).copied().unwrap_or(0)));
        for i in 0..4 {
            let digit = ALPHABET[(bits >> (18 - 6 * i)) as usize & 63] as char;
            out.push(if i <= chunk.len() { digit } else { '=' });
        }
    }
    out
}

/// A right triangle of area 1/2 in the XY plane, facing +Z.
pub const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

pub fn load(folder: &Folder, bytes: &[u8]) -> Loaded {
    let path = folder.write("test.gltf", bytes);
    let loaded = load_gltf(&path).unwrap_or_else(|e| panic!("{e}"));
    lumel::load::load(&path).map(|_| loaded).unwrap_or_else(|e| panic!("{e}"))
}

pub fn warned(loaded: &Loaded, part: &str) -> bool {
    loaded.warnings.iter().any(|w| w.message.contains(part))
}

/// The document of one node with one mesh of one primitive.
pub fn one(primitive: Value) -> Value {
    json!({ "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": [primitive] }] })
}

pub fn first_mesh(loaded: &Loaded) -> &Mesh {
    &loaded.scene.meshes[0]
}

pub fn png() -> Vec<u8> {
    let picture = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 128, 0, 255]).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
