//! Reads back GLBs that tests wrote.
#![allow(dead_code)] // each test file uses its own share

use serde_json::Value;

/// The two chunks of a GLB.
pub struct Glb {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Glb {
    /// Parses a file; panics where it isn't well formed.
    pub fn parse(bytes: &[u8]) -> Self {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((word(4), word(8)), (2, bytes.len()));
        assert_eq!(&bytes[16..20], b"JSON");
        let end = 20 + word(12);
        assert_eq!(end % 4, 0);
        assert_eq!(&bytes[end + 4..end + 8], b"BIN\0");
        assert_eq!(end + 8 + word(end), bytes.len());
        let json = serde_json::from_slice(&bytes[20..end]).unwrap();
        Self { json, bin: bytes[end + 8..].to_vec() }
    }

    /// The components of accessor `accessor` as the bytes of each; its elements must have a view.
    fn components(&self, accessor: usize) -> Vec<&[u8]> {
        let a = &self.json["accessors"][accessor];
        let view = &self.json["bufferViews"][a["bufferView"].as_u64().unwrap() as usize];
        let number = |v: &Value| v.as_u64().unwrap_or(0) as usize;
        let width = match a["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => panic!("{other}"),
        };
        let size = match number(&a["componentType"]) {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        };
        let stride = view["byteStride"].as_u64().map_or(width * size, |s| s as usize);
        let start = number(&view["byteOffset"]) + number(&a["byteOffset"]);
        let element = |i: usize| (0..width).map(move |k| start + i * stride + k * size);
        (0..number(&a["count"])).flat_map(element).map(|at| &self.bin[at..at + size]).collect()
    }

    /// The numbers of a float accessor.
    pub fn floats(&self, accessor: usize) -> Vec<f32> {
        assert_eq!(self.json["accessors"][accessor]["componentType"], 5126);
        self.components(accessor).iter().map(|b| f32::from_le_bytes((*b).try_into().unwrap())).collect()
    }

    /// The elements of a float accessor of `width` components.
    pub fn rows(&self, accessor: usize, width: usize) -> Vec<Vec<f32>> {
        self.floats(accessor).chunks(width).map(<[f32]>::to_vec).collect()
    }

    /// The numbers of an accessor of unsigned integers.
    pub fn unsigned(&self, accessor: usize) -> Vec<u32> {
        let number = |b: &[u8]| b.iter().rev().fold(0, |n, b| n << 8 | u32::from(*b));
        self.components(accessor).into_iter().map(number).collect()
    }
}
