//! `lumel form-factors`: what is in the file, on closed forms, and what it never does.

mod files;

use files::Folder;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output};

impl Folder {
    /// With a closed unit cube, `cube.gltf`.
    fn with_cube(name: &str) -> Self {
        let folder = Self::new(name);
        std::fs::write(folder.0.join("cube.gltf"), quads(&cube(), false)).unwrap();
        folder
    }

    /// Runs `lumel form-factors` with few texels.
    fn run(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
        command.arg("form-factors").args(args).args(["--resolution", "128"]).current_dir(&self.0);
        for name in ["LUMEL_LOG", "RUST_LOG", "RUST_BACKTRACE"] {
            command.env_remove(name);
        }
        command.output().unwrap()
    }

    fn succeed(&self, args: &[&str]) -> Output {
        let output = self.run(args);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
        output
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.0.join(name)).unwrap()
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Corners, counter-clockwise as the front sees them.
type Quad = [[f32; 3]; 4];

/// The unit cube seen from inside: floor, ceiling, and four walls.
fn cube() -> Vec<Quad> {
    let quad = |o: [f32; 3], u: [f32; 3], v: [f32; 3]| {
        let at = |s: f32, t: f32| std::array::from_fn(|k| o[k] + s * u[k] + t * v[k]);
        [at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.)]
    };
    let (x, y, z) = ([1., 0., 0.], [0., 1., 0.], [0., 0., 1.]);
    vec![quad([0.; 3], z, x), quad(y, x, z), quad([0.; 3], y, z), quad(x, z, y), quad([0.; 3], x, y), quad(z, y, x)]
}

/// A glTF with a node `side k` for each quad, its buffer beside nothing: a data URI.
fn quads(quads: &[Quad], double_sided: bool) -> String {
    let mut bin: Vec<u8> = [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = bin.len();
    bin.extend(quads.iter().flatten().flatten().flat_map(|v| v.to_le_bytes()));
    let n = quads.len();
    let bounds = |of: fn(f32, f32) -> f32, q: &Quad, k: usize| q.iter().map(|p| p[k]).reduce(of).unwrap();
    let each = |f: &dyn Fn(usize) -> Value| (0..n).map(f).collect::<Vec<Value>>();
    let mut views = vec![serde_json::json!({"buffer": 0, "byteLength": indices})];
    views.extend(each(&|k| serde_json::json!({"buffer": 0, "byteOffset": indices + 48 * k, "byteLength": 48})));
    let mut accessors = vec![serde_json::json!({"bufferView": 0, "componentType": 5123, "count": 6, "type": "SCALAR"})];
    accessors.extend(each(&|k| {
        let [low, high]: [Vec<f32>; 2] = [f32::min, f32::max].map(|of| (0..3).map(|a| bounds(of, &quads[k], a)).collect());
        serde_json::json!({"bufferView": k + 1, "componentType": 5126, "count": 4, "type": "VEC3", "min": low, "max": high})
    }));
    serde_json::json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": (0..n).collect::<Vec<_>>()}],
        "nodes": each(&|k| serde_json::json!({"name": format!("side {k}"), "mesh": k})),
        "meshes": each(&|k| serde_json::json!({"primitives": [{"attributes": {"POSITION": k + 1}, "indices": 0, "material": 0}]})),
        "materials": [{"doubleSided": double_sided}],
        "buffers": [{"byteLength": bin.len(), "uri": format!("data:application/octet-stream;base64,{}", base64(&bin))}],
        "bufferViews": views,
        "accessors": accessors,
    })
    .to_string()
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for c in bytes.chunks(3) {
        let word = (0..3).fold(0u32, |w, k| w << 8 | u32::from(c.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            text.push(if k <= c.len() { DIGITS[(word >> (18 - 6 * k) & 63) as usize] as char } else { '=' });
        }
    }
    text
}

/// An array of an NPZ: its type, shape and bytes.
struct Array {
    kind: String,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Array {
    fn numbers(&self) -> Vec<f64> {
        let number = |b: &[u8]| match self.kind.as_str() {
            "<f4" => f64::from(f32::from_le_bytes(b.try_into().unwrap())),
            "<f8" => f64::from_le_bytes(b.try_into().unwrap()),
            "<i4" => f64::from(i32::from_le_bytes(b.try_into().unwrap())),
            "|b1" => f64::from(b[0]),
            kind => panic!("{kind} is no number"),
        };
        let size = self.kind[2..].parse().unwrap();
        self.bytes.chunks(size).map(number).collect()
    }

    fn texts(&self) -> Vec<String> {
        let width: usize = self.kind.strip_prefix("<U").unwrap().parse().unwrap();
        let char_of = |b: &[u8]| char::from_u32(u32::from_le_bytes(b.try_into().unwrap())).unwrap();
        let text = |b: &[u8]| b.chunks(4).map(char_of).filter(|c| *c != '\0').collect();
        self.bytes.chunks(4 * width).map(text).collect()
    }
}

/// The arrays of an NPZ, their headers read as NumPy does.
fn load(path: &Path) -> BTreeMap<String, Array> {
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut arrays = BTreeMap::new();
    for k in 0..zip.len() {
        let mut file = zip.by_index(k).unwrap();
        let name = file.name().strip_suffix(".npy").unwrap().to_string();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00", "{name}");
        let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = String::from_utf8(bytes[10..data].to_vec()).unwrap();
        let between =
            |start: &str, end: &str| header.split(start).nth(1).unwrap().split(end).next().unwrap().to_string();
        let shape = between("'shape': (", ")").split(',').filter_map(|n| n.trim().parse().ok()).collect();
        let kind = between("'descr': '", "'");
        assert!(header.contains("'fortran_order': False"), "{name}");
        arrays.insert(name, Array { kind, shape, bytes: bytes[data..].to_vec() });
    }
    arrays
}

#[test]
fn a_closed_cube_has_its_known_form_factors_by_every_method() {
    let f = Folder::with_cube("cube");
    for (method, tolerance) in [("area", 0.005), ("analytic", 0.005), ("hemicube", 0.02), ("hemisphere", 0.02)] {
        let file = format!("{method}.npz");
        f.succeed(&["cube.gltf", "-o", &file, "--form-factors", method, "--quality", "draft"]);
        let arrays = load(&f.0.join(&file));
        let numbers = |name: &str| arrays[name].numbers();
        let n = arrays["area"].shape[0];
        assert!(n >= 128, "{n}");
        for (name, kind, shape) in [
            ("form_factors", "<f4", &[n, n][..]),
            ("scale", "<f8", &[n]),
            ("closure", "<f8", &[n]),
            ("landed", "<f8", &[n]),
            ("area", "<f8", &[n]),
            ("centre", "<f4", &[n, 3]),
            ("normal", "<f4", &[n, 3]),
            ("surface", "<i4", &[n]),
            ("back", "|b1", &[n]),
            ("surface_area", "<f8", &[6]),
            ("surface_back", "|b1", &[6]),
            ("surface_form_factors", "<f8", &[6, 6]),
            ("reciprocity_error", "<f8", &[]),
            ("escaping", "<f8", &[]),
            ("relative_error", "<f8", &[]),
        ] {
            let array = &arrays[name];
            assert_eq!((array.kind.as_str(), array.shape.as_slice()), (kind, shape), "{name}");
        }
        assert_eq!(arrays.contains_key("error"), method != "hemicube");
        assert_eq!(arrays["method"].texts(), [method]);
        assert_eq!(arrays["scene"].texts(), ["cube.gltf"]);
        let names: Vec<String> = (0..6).map(|k| format!("side {k}")).collect();
        assert_eq!(arrays["surface_names"].texts(), names);

        let (matrix, area, closure) = (numbers("form_factors"), numbers("area"), numbers("closure"));
        assert!((area.iter().sum::<f64>() - 6.0).abs() < 1e-4);
        for (i, row) in matrix.chunks(n).enumerate() {
            let sum: f64 = row.iter().sum();
            assert!((sum - 1.0).abs() < 0.02 && (sum - closure[i]).abs() < 1e-6, "{method}: row {i} adds up to {sum}");
        }
        let mean = closure.iter().zip(&area).map(|(c, a)| c * a).sum::<f64>() / 6.0;
        assert!((mean - 1.0).abs() < 0.005, "{method}: {mean}");
        // A ray in a million that starts within its origin's offset of an edge may meet a back.
        assert!(numbers("landed").iter().all(|v| *v > 0.998) && numbers("escaping")[0].abs() < 1e-5, "{method}");
        let reciprocity = numbers("reciprocity_error")[0];
        assert!(
            reciprocity < if matches!(method, "area" | "analytic") { 1e-6 } else { 0.4 },
            "{method}: {reciprocity}"
        );

        for (a, row) in numbers("surface_form_factors").chunks(6).enumerate() {
            for (b, f) in row.iter().enumerate() {
                // C-11 and C-14 of Howell's catalogue.
                let exact = if a == b {
                    0.0
                } else if a / 2 == b / 2 {
                    0.199825
                } else {
                    0.200044
                };
                assert!((f - exact).abs() <= tolerance * exact, "{method}: from {a} to {b} {f}, not {exact}");
            }
        }
    }
}

#[test]
fn equal_bytes_on_every_run_and_for_any_number_of_threads() {
    let f = Folder::with_cube("equal");
    for (file, threads) in [("a.npz", "1"), ("b.npz", "2"), ("c.npz", "2")] {
        f.succeed(&["cube.gltf", "-o", file, "--elements", "48", "--threads", threads]);
    }
    assert!(f.bytes("a.npz") == f.bytes("b.npz") && f.bytes("b.npz") == f.bytes("c.npz"));
    f.succeed(&["cube.gltf", "-o", "a.npz", "--elements", "48", "--form-factors", "hemisphere", "--seed", "1"]);
    f.succeed(&["cube.gltf", "-o", "b.npz", "--elements", "48", "--form-factors", "hemisphere", "--seed", "2"]);
    assert!(f.bytes("a.npz") != f.bytes("b.npz"));
    assert_eq!(f.entries(), ["a.npz", "b.npz", "c.npz", "cube.gltf"]);
}

#[test]
fn every_surface_has_rows_of_its_own_and_backs_have_theirs() {
    let f = Folder::new("backs");
    let small: Vec<Quad> = cube()[..2].iter().map(|q| q.map(|p| p.map(|v| 0.1 * v))).collect();
    let scene = [cube()[..1].to_vec(), small].concat();
    std::fs::write(f.0.join("open.gltf"), quads(&scene, true)).unwrap();
    f.succeed(&["open.gltf", "--elements", "1"]);
    let arrays = load(&f.0.join("open_form_factors.npz"));
    let names = arrays["surface_names"].texts();
    assert_eq!(names.len(), 6);
    assert_eq!(names[..2], ["side 0", "side 0 (back)"]);
    assert_eq!(arrays["surface_back"].numbers(), [0., 1., 0., 1., 0., 1.]);
    let (surface, back) = (arrays["surface"].numbers(), arrays["back"].numbers());
    assert_eq!((surface, back), (vec![0., 1., 2., 3., 4., 5.], vec![0., 1., 0., 1., 0., 1.]));
    assert!(arrays["escaping"].numbers()[0] > 0.5);
}

#[test]
fn json_holds_the_figures_and_the_matrix_between_surfaces() {
    let f = Folder::with_cube("json");
    let output = f.succeed(&["cube.gltf", "--json", "--elements", "24", "--form-factors", "analytic"]);
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&figures["method"], &figures["elements"]), (&"analytic".into(), &24.into()));
    assert_eq!(figures["surfaces"].as_array().unwrap().len(), 6);
    assert!((figures["surface_form_factors"][0][1].as_f64().unwrap() - 0.199825).abs() < 0.002);
    assert!((figures["row_sums"]["mean"].as_f64().unwrap() - 1.0).abs() < 0.01);
    assert!(stderr(&output).contains("knows no occluders"), "{}", stderr(&output));
    let text = f.succeed(&["cube.gltf", "--elements", "24"]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    for word in ["reciprocity", "escaping", "side 5", "to 6", "area"] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn a_matrix_has_its_limit() {
    let f = Folder::with_cube("limit");
    for elements in ["20001", "0"] {
        let output = f.run(&["cube.gltf", "--elements", elements]);
        assert_eq!(output.status.code(), Some(2));
        assert!(
            stderr(&output).contains("--elements") && stderr(&output).contains("allowed are"),
            "{}",
            stderr(&output)
        );
    }
    assert_eq!(f.entries(), ["cube.gltf"]);
}

#[test]
fn limits_refuse_before_the_work() {
    let f = Folder::with_cube("limits");
    for (limit, value, lower) in [("--max-texels", "1000", "--resolution"), ("--max-memory", "1G", "--elements")] {
        let output = f.run(&["cube.gltf", "--elements", "20000", limit, value]);
        let text = stderr(&output);
        assert!(output.status.code() == Some(1) && text.contains(limit) && text.contains(lower), "{text}");
    }
    assert_eq!(f.entries(), ["cube.gltf"]);
    f.succeed(&["cube.gltf", "--elements", "64", "--max-texels", "16384", "--max-memory", "1G"]);
}

#[test]
fn only_form_factors_of_the_same_scene_are_replaced() {
    let f = Folder::with_cube("replace");
    let scene = f.bytes("cube.gltf");
    std::fs::copy(f.0.join("cube.gltf"), f.0.join("other.gltf")).unwrap();
    std::fs::write(f.0.join("notes"), "mine").unwrap();
    std::fs::write(f.0.join("lumel.toml"), "method = \"path\"\nelements = 24\n").unwrap();
    std::fs::create_dir(f.0.join("folder")).unwrap();
    f.succeed(&["other.gltf", "-o", "other.npz"]);
    f.succeed(&["other.gltf", "-o", "other.npz"]);
    let before = f.entries();
    for (output, overwrite) in [
        ("cube.gltf", true),
        ("./folder/../cube.gltf", true),
        ("lumel.toml", true),
        ("folder", true),
        ("missing/a.npz", true),
        ("notes", false),
        ("other.npz", false),
    ] {
        let mut args = vec!["cube.gltf", "-o", output];
        args.extend(overwrite.then_some("--overwrite"));
        let run = f.run(&args);
        let text = stderr(&run);
        assert_eq!(run.status.code(), Some(1), "{output}: {text}");
        assert!(text.lines().last().unwrap().starts_with("error: ") && text.contains("-o"), "{output}: {text}");
        assert_eq!(f.entries(), before, "{output}");
    }
    assert_eq!((f.bytes("cube.gltf"), f.bytes("notes")), (scene, b"mine".to_vec()));
    for output in ["notes", "other.npz"] {
        f.succeed(&["cube.gltf", "-o", output, "--overwrite"]);
        assert_eq!(load(&f.0.join(output))["scene"].texts(), ["cube.gltf"]);
    }
    assert_eq!(f.entries(), before);
}
