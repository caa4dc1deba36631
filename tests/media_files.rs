//! What files and settings say of participating media: glTF, USD, OpenVDB, NumPy, lumel.toml.

mod files;
mod gltf_document;
mod usd_stage;

use files::Folder;
use glam::{DVec3, Vec3};
use gltf_document::{Builder, TRIANGLE, base64};
use lumel::color::Rgb;
use lumel::load::{self, Loaded, volume};
use lumel::medium::Media;
use lumel::sample::{Drawn, sequence::Stage};
use lumel::scene::MediumShape;
use lumel::settings::{Method, Settings};
use lumel::trace::Ray;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use usd_stage::{METRES, SQUARE, load_body, load_text, warned};

/// What passes along a ray, of media without grids.
fn passed(loaded: &Loaded, origin: Vec3, direction: Vec3) -> Rgb {
    let media = Media::new(&loaded.scene);
    media.transmittance(&Ray { origin, direction }, f32::INFINITY, &mut Drawn::new(0, Stage::Path, 0, 0))
}

fn assert_depth(name: &str, passed: Rgb, depth: Rgb) {
    let found = -passed.map(f32::ln);
    assert!(found.distance(depth) < 1e-4 * (1.0 + depth.length()), "{name}: depth {found} instead of {depth}");
}

/// A document with a triangle as a floor and one more node.
fn document(node: Value) -> Vec<u8> {
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let cube = b.floats(&[[-1.0, 0.0, 0.0], [3.0, 0.0, 1.0], [0.0, 2.0, 0.5]]);
    b.gltf(json!({
        "nodes": [{ "mesh": 0 }, node],
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": positions } }] },
            { "primitives": [{ "attributes": { "POSITION": cube } }] },
        ],
    }))
}

fn load_node(name: &str, node: Value) -> lumel::Result<Loaded> {
    let folder = Folder::new(name);
    load::load(&folder.write("fog.gltf", document(node)))
}

#[test]
fn gltf_nodes_place_media() {
    let medium = json!({ "medium": { "sigma_s": [0.1, 0.2, 0.3], "absorption": 0.5, "g": 0.6, "emission": 2 } });
    let node = json!({ "name": "fog", "translation": [0, 5, 0], "scale": [2, 4, 6], "extras": { "lumel": medium } });
    let loaded = load_node("gltf-box", node).unwrap();
    let fog = &loaded.scene.media[0];
    assert_eq!((fog.name.as_str(), fog.anisotropy, fog.emission), ("fog", 0.6, Rgb::splat(2.0)));
    assert_eq!((loaded.scene.media.len(), loaded.scene.surfaces.len()), (1, 1));
    let extinction = Rgb::new(0.6, 0.7, 0.8);
    // The unit box around the node's origin, scaled.
    assert_depth("along X", passed(&loaded, Vec3::new(-9.0, 6.9, 2.9), Vec3::X), extinction * 2.0);
    assert_depth("beside", passed(&loaded, Vec3::new(-9.0, 7.1, 0.0), Vec3::X), Rgb::ZERO);
    assert_depth("along Y", passed(&loaded, Vec3::ZERO, Vec3::Y), extinction * 4.0);

    // A mesh bounds its medium and is no surface, unless it is asked to be.
    let medium = json!({ "extinction": 2, "albedo": [0.5, 0.25, 1], "density": 3 });
    for (skip, surfaces, media) in [(None, 1, 1), (Some(false), 2, 1), (Some(true), 1, 0)] {
        let mut lumel = json!({ "medium": medium });
        if let Some(skip) = skip {
            lumel["skip"] = json!(skip);
        }
        let loaded = load_node("gltf-mesh", json!({ "mesh": 1, "extras": { "lumel": lumel } })).unwrap();
        assert_eq!((loaded.scene.surfaces.len(), loaded.scene.media.len()), (surfaces, media), "skip {skip:?}");
        if media > 0 {
            let fog = &loaded.scene.media[0];
            assert_eq!((fog.scattering, fog.absorption), (Rgb::new(1.0, 0.5, 2.0), Rgb::new(1.0, 1.5, 0.0)));
            assert_depth("mesh", passed(&loaded, Vec3::new(-9.0, 1.0, 0.5), Vec3::X), Rgb::splat(24.0));
        }
    }
}

#[test]
fn gltf_nodes_stretch_grids_over_their_box() {
    let folder = Folder::new("gltf-grid");
    folder.write("smoke.npy", npy("<f4", "(1, 2, 3)", &floats(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0])));
    let uri = format!("data:application/octet-stream;base64,{}", base64(&npy("|u1", "(1, 1, 2)", &[1, 3])));
    for (uri, size, last) in [("smoke.npy", [3, 2, 1], 5.0), (uri.as_str(), [2, 1, 1], 3.0)] {
        let lumel = json!({ "medium": { "density": 0.5, "albedo": 0.9, "grid": uri } });
        let path = folder.write("fog.gltf", document(json!({ "extras": { "lumel": lumel } })));
        let loaded = load::load(&path).unwrap();
        let grid = loaded.scene.media[0].grid.as_ref().unwrap();
        assert_eq!((grid.size(), grid.most(), grid.voxel([size[0] - 1, size[1] - 1, 0])), (size, last, last));
    }
}

#[test]
fn wrong_media_of_gltf_nodes_name_the_node() {
    for (medium, word) in [
        (json!({ "scatering": 1 }), "scatering"),
        (json!({ "scattering": "much" }), "nodes[1]"),
        (json!({ "scattering": -1 }), "scattering"),
        (json!({ "scattering": [1, 2] }), "nodes[1]"),
        (json!({ "scattering": 1, "albedo": 0.5 }), "not both"),
        (json!({ "density": 1, "albedo": 1.5 }), "albedo"),
        (json!({ "density": 1, "g": 1 }), "g 1"),
        (json!({ "density": 1e30 }), "density"),
        (json!({}), "says nothing"),
        (json!({ "density": 1, "center": [0, 0, 0] }), "node's"),
        (json!({ "density": 1, "grid": "gone.npz" }), "gone.npz"),
        (json!({ "density": 1, "grid": "../up.npz" }), "leaves"),
        (json!([1]), "nodes[1]"),
    ] {
        let shown = medium.to_string();
        let error = load_node("gltf-wrong", json!({ "name": "fog", "extras": { "lumel": { "medium": medium } } }));
        let error = error.err().unwrap_or_else(|| panic!("{shown} was read")).to_string();
        assert!(error.contains(word), "{shown}: {error}");
    }
    let flat = json!({ "scale": [1, 0, 1], "extras": { "lumel": { "medium": { "density": 1 } } } });
    let error = load_node("gltf-flat", flat).unwrap_err().to_string();
    assert!(error.contains("nodes[1]") && error.contains("no volume"), "{error}");
}

/// A `.npy` file.
fn npy(kind: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values);
    bytes
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn npz(members: &[(&str, Vec<u8>)], method: zip::CompressionMethod) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in members {
        zip.start_file(*name, zip::write::SimpleFileOptions::default().compression_method(method)).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn numpy_arrays_run_along_x_last() {
    let (a, b) =
        (npy("<f4", "(1, 2, 3)", &floats(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0])), npy("<f4", "(1, 1, 1)", &floats(&[9.0])));
    for method in [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated] {
        let both = npz(&[("other.npy", b.clone()), ("density.npy", a.clone())], method);
        for (bytes, field, size) in [
            (a.clone(), None, [3, 2, 1]),
            (both.clone(), None, [3, 2, 1]),
            (both.clone(), Some("other"), [1, 1, 1]),
            (npz(&[("smoke.npy", a.clone())], method), None, [3, 2, 1]),
        ] {
            let grid = volume::read("smoke", &bytes, field).unwrap().grid;
            assert_eq!(grid.size(), size);
            if size == [3, 2, 1] {
                assert_eq!([grid.voxel([1, 0, 0]), grid.voxel([0, 1, 0]), grid.voxel([2, 1, 0])], [1.0, 3.0, 5.0]);
                // Middles of voxels, halfway between two, and beyond the last one.
                let at = |x: f64, y: f64| grid.at(DVec3::new(x, y, 0.3));
                assert_eq!([at(0.5, 0.25), at(0.5, 0.5), at(1.0, 1.0), at(0.0, 0.0)], [1.0, 2.5, 5.0, 0.0]);
            }
        }
    }
    let halves: Vec<u8> = [0.5f32, 2.0].iter().flat_map(|v| half::f16::from_f32(*v).to_le_bytes()).collect();
    let doubles: Vec<u8> = [0.5f64, 2.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    for (kind, bytes) in [("<f2", halves), ("<f8", doubles)] {
        let grid = volume::read("smoke", &npy(kind, "(2, 1, 1)", &bytes), None).unwrap().grid;
        assert_eq!([grid.voxel([0, 0, 0]), grid.voxel([0, 0, 1])], [0.5, 2.0]);
    }
}

#[test]
fn broken_grids_are_refused_with_what_is_wrong() {
    let four = floats(&[1.0; 4]);
    let fortran = String::from_utf8_lossy(&npy("<f4", "(1, 2, 2)", &[])).replace("False", "True ");
    let mut fortran = fortran.into_bytes();
    fortran.splice(0..3, *b"\x93");
    for (bytes, word) in [
        (npy("<f4", "(2, 2)", &four), "three axes"),
        (npy("<f4", "(1, 2, 3)", &four), "ends before"),
        (npy("<f4", "(1000000, 1000000, 1000000)", &four), "too large"),
        (npy("<f4", "(99999999999999999999, 1, 1)", &four), "three axes"),
        (npy("<f4", "(0, 2, 2)", &four), "no voxels"),
        (npy(">f4", "(1, 2, 2)", &four), "float32"),
        (npy("|O", "(1, 2, 2)", &four), "float32"),
        (npy("<f4", "(1, 1, 1)", &floats(&[f32::NAN])), "NaN"),
        (npy("<f4", "(1, 1, 1)", &floats(&[-1.0])), "-1"),
        (fortran, "ascontiguousarray"),
        (b"\x93NUMPY\x01\x00\xff\xff{".to_vec(), "NumPy"),
        (b"PK\x03\x04".to_vec(), ".npz"),
        (Vec::new(), ".npz"),
        (npz(&[("a.npy", four.clone()), ("b.npy", four.clone())], zip::CompressionMethod::Stored), "a, b"),
        (npz(&[("a.npy", four.clone())], zip::CompressionMethod::Stored), "NumPy"),
    ] {
        let error = volume::read("smoke.npz", &bytes, None).unwrap_err().to_string();
        assert!(error.starts_with("smoke.npz") && error.contains(word), "{word}: {error}");
    }
}

/// What OpenVDB 10 wrote: `tests/vdb`. Voxel (i, j, k) of 4..15 x 6..11 x 3..12 is i / 4 + j / 2 + k, but for one in five; there is a
/// tile of 1/2 at (16, 8, 0)..(24, 16, 8). Voxels are 0.1 x 0.2 x 0.3 large, the first one lies at (1, 2, 3).
fn vdb(name: &str) -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vdb").join(name)).unwrap()
}

#[test]
fn vdb_grids_are_read_as_openvdb_wrote_them() {
    for (name, field) in [("two.vdb", None), ("two.vdb", Some("density")), ("half.vdb", None)] {
        let volume = volume::read(name, &vdb(name), field).unwrap();
        let file_from_unit = volume.file_from_unit.unwrap();
        let size = volume.grid.size();
        let mut on = 0;
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let middle = (DVec3::new(i as f64, j as f64, k as f64) + 0.5)
                        / DVec3::new(size[0] as f64, size[1] as f64, size[2] as f64);
                    let place = file_from_unit.transform_point3(middle) - DVec3::new(1.0, 2.0, 3.0);
                    let [x, y, z] = (place / DVec3::new(0.1, 0.2, 0.3)).to_array().map(|v| v.round() as i32);
                    let is_voxel = (4..15).contains(&x) && (6..11).contains(&y) && (3..12).contains(&z);
                    let is_tile = (16..24).contains(&x) && (8..16).contains(&y) && (0..8).contains(&z);
                    let expected = match (is_voxel && (x + 2 * y + 3 * z) % 5 != 0, is_tile) {
                        (true, _) => 0.25 * x as f32 + 0.5 * y as f32 + z as f32,
                        (_, true) => 0.5,
                        _ => 0.0,
                    };
                    on += usize::from(expected > 0.0);
                    assert_eq!(volume.grid.voxel([i, j, k]), expected, "{name}: voxel ({x}, {y}, {z})");
                }
            }
        }
        assert_eq!(on, 11 * 5 * 9 * 4 / 5 + 512, "{name}");
    }
    let one = volume::read("two.vdb", &vdb("two.vdb"), Some("temperature")).unwrap();
    assert_eq!(one.grid.most(), 7.0);
}

#[test]
fn broken_vdb_files_are_refused() {
    let whole = vdb("two.vdb");
    let refused = |bytes: &[u8], field| volume::read("smoke.vdb", bytes, field).unwrap_err().to_string();
    assert!(refused(&whole, Some("fire")).contains("temperature, density"));
    assert!(refused(&vdb("level_set.vdb"), None).contains("level set"));
    // Cut off anywhere, and with any byte changed: an error or another grid, but never a panic.
    for length in (8..whole.len()).step_by(97) {
        assert!(refused(&whole[..length], None).starts_with("smoke.vdb"));
    }
    for (at, change) in (8..whole.len()).step_by(5).zip([0x01, 0x80, 0xff].into_iter().cycle()) {
        let mut bytes = whole.clone();
        bytes[at] ^= change;
        let _ = volume::read("smoke.vdb", &bytes, None);
    }
}

const VOLUME: &str = "def Volume \"fog\"";

fn volume_prim(body: &str) -> String {
    format!("def Mesh \"m\" {{ {SQUARE} }}\n{VOLUME} {{ {body} }}\n")
}

#[test]
fn usd_volumes_are_media() {
    let body = r#"
    color3f lumel:medium:scattering = (0.1, 0.2, 0.3)
    float lumel:medium:absorption = 0.5
    float lumel:medium:g = -0.3
    float3[] extent = [(-1, 0, 0), (1, 3, 1)]
    double3 xformOp:translate = (0, 100, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]"#;
    let stage = "#usda 1.0\n(\n metersPerUnit = 0.5\n upAxis = \"Z\"\n)\n";
    let loaded = load_text("usd-volume", &format!("{stage}{}", volume_prim(body)));
    let fog = &loaded.scene.media[0];
    assert_eq!((fog.name.as_str(), fog.anisotropy, fog.scattering), ("/fog", -0.3, Rgb::new(0.1, 0.2, 0.3)));
    let extinction = Rgb::new(0.6, 0.7, 0.8);
    // Y of the stage is -Z of the scene, units are half metres, coefficients per metre all the same.
    assert_depth("along Z", passed(&loaded, Vec3::new(0.0, 0.25, 0.0), -Vec3::Z), extinction * 1.5);
    assert_depth("beside", passed(&loaded, Vec3::new(0.0, -0.25, 0.0), -Vec3::Z), Rgb::ZERO);
    assert!(!warned(&loaded, "", "/fog"), "{:?}", loaded.warnings);
}

#[test]
fn usd_materials_tell_what_volumes_do() {
    let body = r#"rel material:binding = </mat>"#;
    let material = r#"def Material "mat" {
    token outputs:volume.connect = </mat/volume.outputs:out>
    def Shader "volume" {
        uniform token info:id = "ND_volume"
        token inputs:vdf.connect = </mat/vdf.outputs:out>
        token outputs:out
    }
    def Shader "vdf" {
        uniform token info:id = "ND_anisotropic_vdf"
        color3f inputs:scattering = (1, 2, 3)
        color3f inputs:absorption = (0.5, 0.5, 0.5)
        float inputs:anisotropy = 0.25
        token outputs:out
    }
}"#;
    let stage = "#usda 1.0\n(\n metersPerUnit = 0.01\n upAxis = \"Y\"\n)\n";
    let loaded = load_text("usd-material", &format!("{stage}{}{material}", volume_prim(body)));
    let fog = &loaded.scene.media[0];
    // Per centimetre.
    assert!(fog.scattering.distance(Rgb::new(100.0, 200.0, 300.0)) < 1e-3, "{}", fog.scattering);
    assert!(fog.absorption.distance(Rgb::splat(50.0)) < 1e-3 && fog.anisotropy == 0.25);
    // A cube of 1 cm.
    assert_depth("cube", passed(&loaded, -Vec3::X, Vec3::X), Rgb::new(1.5, 2.5, 3.5));
}

#[test]
fn usd_fields_lead_to_files() {
    let folder = Folder::new("usd-field");
    folder.write("two.vdb", vdb("two.vdb"));
    folder.write("smoke.npy", npy("<f4", "(1, 1, 2)", &floats(&[1.0, 3.0])));
    let load = |file: &str, more: &str| {
        let body = format!(
            "rel field:density = </fog/d>\nfloat lumel:medium:extinction = 2\n{more}\ndef OpenVDBAsset \"d\" {{ asset filePath = \
             @{file}@\n token fieldName = \"density\" }}"
        );
        load::load(&folder.write("scene.usda", format!("{METRES}{}", volume_prim(&body)))).unwrap()
    };
    let loaded = load("./two.vdb", "");
    let fog = &loaded.scene.media[0];
    assert!(!warned(&loaded, "", "/fog"), "{:?}", loaded.warnings);
    assert!(loaded.inputs.iter().any(|file| file.ends_with("two.vdb")));
    let MediumShape::Box { world_from_unit } = fog.shape else { panic!("no box") };
    // Leaves from voxel 0, one voxel of rim, half a voxel beyond its middle.
    let low = world_from_unit.transform_point3(Vec3::ZERO);
    assert!(low.distance(Vec3::new(1.0 - 0.15, 2.0 - 0.3, 3.0 - 0.45)) < 1e-5, "{low}");
    let middle = Vec3::new(1.0 + 0.1 * 6.0, 2.0 + 0.2 * 8.0, 3.0 + 0.3 * 5.0);
    let expected = 0.25 * 6.0 + 0.5 * 8.0 + 5.0;
    assert!((Media::new(&loaded.scene).at(middle).extinction.x - 2.0 * expected).abs() < 1e-3);
    // Without a place of its own a grid fills the volume's box.
    let loaded = load("./smoke.npy", "float3[] extent = [(0, 0, 0), (4, 1, 1)]");
    assert_eq!(Media::new(&loaded.scene).at(Vec3::new(3.0, 0.5, 0.5)).extinction, Rgb::splat(6.0));

    let loaded = load("./gone.vdb", "");
    assert!(loaded.scene.media.is_empty() && warned(&loaded, "was not found", "/fog/d"));
    folder.write("broken.vdb", &vdb("two.vdb")[..3000]);
    let loaded = load("./broken.vdb", "");
    assert!(loaded.scene.media.is_empty() && warned(&loaded, "could not be read", "/fog/d"));
    let loaded = load("./two.vdb", "rel field:temperature = </fog/d>");
    assert!(loaded.scene.media.len() == 1 && warned(&loaded, "temperature was left out", "/fog"));
}

#[test]
fn wrong_usd_volumes_are_warnings_with_their_path() {
    for (body, message) in [
        ("", "scatters all of its density"),
        ("float lumel:medium:scattering = -1", "scattering"),
        ("float lumel:medium:scattering = nan", "scattering"),
        ("float lumel:medium:scattring = 1\nfloat lumel:medium:density = 1", "no known attribute"),
        ("string lumel:medium:density = \"x\"", "no value of its type"),
        ("float lumel:medium:density = 1\nfloat3[] extent = [(0, 0, 0), (1, 0, 1)]", "no volume"),
        ("float lumel:medium:density = 1\nfloat lumel:medium:albedo = 7", "albedo"),
        ("rel field:density = </nowhere>", "without the field"),
    ] {
        let loaded = load_body("usd-wrong", &volume_prim(body));
        assert!(warned(&loaded, message, "/fog"), "{body}: {:?}", loaded.warnings);
    }
}

#[test]
fn settings_add_media() {
    let folder = Folder::new("settings");
    let scene = folder.write("room.gltf", document(json!({})));
    let smoke = folder.write("two.vdb", vdb("two.vdb"));
    let settings = |medium: Value| -> Settings { serde_json::from_value(json!({ "medium": [medium] })).unwrap() };
    let add = |settings: &Settings| {
        settings.check()?;
        let mut loaded = load::load(&scene)?;
        lumel::added_light::add(&mut loaded, settings).map(|()| loaded)
    };
    let path = Settings { method: Method::Path, ..settings(json!({ "density": 0.1, "albedo": [0.9, 0.8, 0.7] })) };
    let loaded = add(&path).unwrap();
    assert!(loaded.scene.media[0].shape == MediumShape::Scene && loaded.warnings.is_empty());
    let boxed = settings(json!({ "name": "haze", "center": [0, 1, 0], "size": [2, 4, 6], "scattering": 0.5 }));
    let loaded = add(&boxed).unwrap();
    assert_depth("box", passed(&loaded, Vec3::new(0.0, -9.0, 0.0), Vec3::Y), Rgb::splat(2.0));
    assert!(usd_stage::warned(&loaded, "radiosity sees no media", "haze"));
    let loaded = add(&settings(json!({ "density": 1, "grid": smoke }))).unwrap();
    assert!(matches!(loaded.scene.media[0].shape, MediumShape::Box { .. }) && loaded.inputs.contains(&smoke));
    for (medium, word) in [
        (json!({ "scattering": 1, "center": [0, 0, 0] }), "size"),
        (json!({ "scattering": 1, "shape": "scene", "size": [1, 1, 1] }), "whole scene"),
        (json!({ "scattering": 1, "center": [0, 0, 0], "size": [1, 0, 1] }), "no volume"),
        (json!({ "scattering": 1e9 }), "out of range"),
        (json!({ "scattering": 1, "grid": "/nowhere/gone.npz" }), "gone.npz"),
    ] {
        let error = add(&settings(medium)).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(word), "{word}: {error}");
    }
    assert!(serde_json::from_value::<Settings>(json!({ "medium": [{ "sigma": 1 }] })).is_err());
}
