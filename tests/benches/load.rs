//! How fast a GLB of a million triangles is read, and how much memory that takes over what it holds:
//! `cargo bench --ignore-rust-version --bench load`.
//!
//! The grid is written plain and meshopt-compressed, and each file is read in a process of its own, whose greatest resident
//! size the system tells (Linux alone; elsewhere only times are printed).

use lumel::scene::Mesh;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Quads along an edge: 2 x 708^2 triangles, just over a million.
const SIDE: u32 = 708;

fn main() {
    let mut arguments = std::env::args().skip(1);
    if let (Some("read"), Some(file)) = (arguments.next().as_deref(), arguments.next()) {
        return read(Path::new(&file));
    }
    let folder = std::env::temp_dir().join(format!("lumel_load_{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    for (name, compressed) in [("plain", false), ("meshopt", true)] {
        let file = folder.join(format!("{name}.glb"));
        std::fs::write(&file, glb(compressed)).expect("a file");
        let done = Command::new(std::env::current_exe().expect("a program")).arg("read").arg(&file).status();
        println!("    {name}");
        assert!(done.is_ok_and(|s| s.success()));
    }
    let _ = std::fs::remove_dir_all(&folder);
}

fn read(file: &Path) {
    let before = resident();
    let start = Instant::now();
    let loaded = lumel::load::load(file).expect("a scene");
    let seconds = start.elapsed().as_secs_f64();
    let mesh = &loaded.scene.meshes[0];
    let decoded = bytes(mesh) as f64;
    let peak = resident().zip(before).map(|(after, before)| after.saturating_sub(before) as f64);
    print!("{} triangles in {seconds:.3} s, {:.0} MB decoded", mesh.triangles.len(), decoded / 1e6);
    match peak {
        Some(peak) => println!(", at most {:.0} MB more resident: {:.2} times", peak / 1e6, peak / decoded),
        None => println!(),
    }
}

/// Memory of a mesh [bytes].
fn bytes(mesh: &Mesh) -> usize {
    let vertex = 12 + 12 * usize::from(!mesh.normals.is_empty()) + 16 * usize::from(!mesh.colors.is_empty());
    mesh.positions.len() * (vertex + 8 * mesh.uvs.len()) + mesh.triangles.len() * (12 + 4 + 20)
}

/// Greatest resident size so far [bytes].
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// A wavy grid with normals and texture coordinates.
fn glb(compressed: bool) -> Vec<u8> {
    let row = SIDE + 1;
    let at = |i: u32| ((i % row) as f32 / SIDE as f32, (i / row) as f32 / SIDE as f32);
    let vertices = 0..row * row;
    let positions: Vec<[f32; 3]> = vertices.clone().map(at).map(|(u, v)| [u, (9.0 * u).sin() * 0.1, v]).collect();
    let normals: Vec<[f32; 3]> = vertices.clone().map(|_| [0.0, 1.0, 0.0]).collect();
    let uvs: Vec<[f32; 2]> = vertices.clone().map(at).map(|(u, v)| [u, v]).collect();
    let cells = (0..SIDE * SIDE).map(|i| i / SIDE * row + i % SIDE);
    let indices: Vec<u32> = cells.flat_map(|c| [c, c + row, c + 1, c + 1, c + row, c + row + 1]).collect();
    let (mut bin, mut views, mut fallback) = (Vec::new(), Vec::new(), 0);
    let mut view = |plain: Vec<u8>, stream: meshopt::Result<Vec<u8>>, stride: usize, mode: &str| {
        let length = plain.len();
        let data = if compressed { stream.expect("a stream") } else { plain };
        let mut view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": data.len() });
        if compressed {
            let mut inner = view.take();
            for (key, value) in
                [("byteStride", json!(stride)), ("count", json!(length / stride)), ("mode", json!(mode))]
            {
                inner[key] = value;
            }
            view = json!({ "buffer": 1, "byteOffset": fallback, "byteLength": length,
                           "extensions": { "EXT_meshopt_compression": inner } });
        }
        fallback += length;
        bin.extend(data);
        bin.resize(bin.len().next_multiple_of(4), 0);
        views.push(view);
    };
    let floats = |rows: &[[f32; 3]]| rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let uv_bytes = uvs.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let index_bytes = indices.iter().flat_map(|v| v.to_le_bytes()).collect();
    view(floats(&positions), meshopt::encode_vertex_buffer(&positions), 12, "ATTRIBUTES");
    view(floats(&normals), meshopt::encode_vertex_buffer(&normals), 12, "ATTRIBUTES");
    view(uv_bytes, meshopt::encode_vertex_buffer(&uvs), 8, "ATTRIBUTES");
    view(index_bytes, meshopt::encode_index_buffer(&indices, positions.len()), 4, "TRIANGLES");
    let accessor = |view: usize, kind: &str, component: u32, count: usize| json!({ "bufferView": view, "type": kind, "componentType": component, "count": count });
    let count = positions.len();
    let mut buffers = vec![json!({ "byteLength": bin.len() })];
    if compressed {
        buffers
            .push(json!({ "byteLength": fallback, "extensions": { "EXT_meshopt_compression": { "fallback": true } } }));
    }
    let document = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3 }] }],
        "accessors": [accessor(0, "VEC3", 5126, count), accessor(1, "VEC3", 5126, count), accessor(2, "VEC2", 5126, count),
                      accessor(3, "SCALAR", 5125, indices.len())],
        "bufferViews": views,
        "buffers": buffers,
    });
    container(&document, &bin)
}

/// A GLB of `document` and `bin`.
fn container(document: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}
