//! Scenes that reach where they should not, or ask for more than there is: refused by name, before memory is taken.
#![cfg(unix)]

mod files;
mod gltf_document;

use gltf_document::{Builder, Folder, TRIANGLE, one, png};
use lumel::load::{LoadOptions, Loaded, load_with};
use serde_json::{Value, json};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A triangle whose buffer and picture are files.
fn write_scene(folder: &Folder, buffer: &str, picture: &str) -> PathBuf {
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let uvs = b.view(&[0; 24], None);
    let uvs = b.accessor(json!({ "bufferView": uvs, "componentType": 5126, "count": 3, "type": "VEC2" }));
    let mut document = one(json!({
        "attributes": { "POSITION": positions, "TEXCOORD_0": uvs },
        "material": 0,
    }));
    document["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    document["textures"] = json!([{ "source": 0 }]);
    document["images"] = json!([{ "uri": picture }]);
    let bin = b.bin.clone();
    let mut document: Value = serde_json::from_slice(&b.gltf(document)).unwrap();
    document["buffers"] = json!([{ "uri": buffer, "byteLength": bin.len() }]);
    if !buffer.contains("link") {
        folder.write(&format!("scene/{buffer}"), &bin);
    }
    folder.write("elsewhere/data.bin", &bin);
    folder.write("scene/scene.gltf", serde_json::to_vec(&document).unwrap())
}

fn confined(folder: &Path) -> LoadOptions {
    LoadOptions { confine: Some(folder.to_owned()), ..LoadOptions::default() }
}

fn refusal(result: lumel::Result<Loaded>) -> String {
    result.expect_err("must be refused").to_string()
}

fn lumel(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lumel")).args(arguments).output().unwrap()
}

#[test]
fn links_that_leave_the_folder_of_a_gltf_are_refused() {
    let folder = Folder::new("links");
    let scene = write_scene(&folder, "link.bin", "a.png");
    folder.write("scene/a.png", png());
    symlink(folder.0.join("elsewhere/data.bin"), folder.0.join("scene/link.bin")).unwrap();
    let error = refusal(load_with(&scene, &LoadOptions::default()));
    assert!(error.contains("link.bin") && error.contains("outside"), "{error}");
    // A folder that holds both lets it.
    assert!(load_with(&scene, &confined(&folder.0)).is_ok());
}

#[test]
fn a_confined_picture_is_an_error_and_an_unconfined_one_a_warning() {
    let folder = Folder::new("picture");
    let scene = write_scene(&folder, "data.bin", "link.png");
    folder.write("elsewhere/secret.png", png());
    symlink(folder.0.join("elsewhere/secret.png"), folder.0.join("scene/link.png")).unwrap();
    let loaded = load_with(&scene, &LoadOptions::default()).unwrap();
    assert!(loaded.scene.textures.is_empty());
    assert!(loaded.warnings.iter().any(|w| w.places.iter().any(|p| p.contains("link.png"))));
    let error = refusal(load_with(&scene, &confined(&folder.0.join("scene"))));
    assert!(error.contains("link.png") && error.contains("outside"), "{error}");
    let error = refusal(load_with(&scene, &confined(&folder.0.join("elsewhere"))));
    assert!(error.contains("scene.gltf"), "the scene itself lies outside: {error}");
}

#[test]
fn pipes_and_devices_are_no_files() {
    let folder = Folder::new("pipe");
    let scene = write_scene(&folder, "data.bin", "pipe.png");
    let made = Command::new("mkfifo").arg(folder.0.join("scene/pipe.png")).status().unwrap();
    assert!(made.success());
    let loaded = load_with(&scene, &LoadOptions::default()).unwrap();
    assert!(loaded.warnings.iter().any(|w| w.places.iter().any(|p| p.contains("no regular file"))));
    let body = "#usda 1.0\n(\n subLayers = [@/dev/zero@]\n)\ndef Sphere \"Ball\" {}\n";
    let loaded = load_with(&folder.write("zero.usda", body.as_bytes()), &LoadOptions::default()).unwrap();
    assert!(loaded.warnings.iter().any(|w| w.is_missing && w.places.iter().any(|p| p.contains("/dev/zero"))));
}

/// A stage in `inside/` that pulls in one thing by `line`, and a layer and a picture outside.
fn stage(folder: &Folder, name: &str, line: &str) -> PathBuf {
    folder.write("outside/part.usda", b"#usda 1.0\n(\n defaultPrim = \"Part\"\n)\ndef Sphere \"Part\" {}\n");
    folder.write("outside/a.png", png());
    let text = format!("#usda 1.0\ndef Sphere \"Ball\" {{}}\n{line}\n");
    folder.write(&format!("inside/{name}.usda"), text.as_bytes())
}

#[test]
fn layers_and_assets_of_a_confined_stage_stay_inside() {
    let folder = Folder::new("stage");
    let reference = "def \"Part\" (references = @../outside/part.usda@) {}";
    let sky = "def DomeLight \"Sky\" { asset inputs:texture:file = @../outside/a.png@ }";
    let linked = "def \"Part\" (references = @./link.usda@) {}";
    let inside = folder.0.join("inside");
    for (name, line, outside) in
        [("reference", reference, "part.usda"), ("sky", sky, "a.png"), ("linked", linked, "part.usda")]
    {
        let scene = stage(&folder, name, line);
        if name == "linked" {
            symlink(folder.0.join("outside/part.usda"), inside.join("link.usda")).unwrap();
        }
        assert!(load_with(&scene, &LoadOptions::default()).is_ok(), "{name}");
        let error = refusal(load_with(&scene, &confined(&inside)));
        assert!(error.contains(outside) && error.contains("outside of"), "{name}: {error}");
        assert!(load_with(&scene, &confined(&folder.0)).is_ok(), "{name}");
    }
}

#[test]
fn a_stage_that_refers_to_itself_ends() {
    let folder = Folder::new("itself");
    let text = "#usda 1.0\n(\n defaultPrim = \"A\"\n subLayers = [@./self.usda@]\n)\n\
                def Xform \"A\" (references = @./self.usda@)\n{\n def Sphere \"Ball\" {}\n}\n";
    let loaded = load_with(&folder.write("self.usda", text.as_bytes()), &LoadOptions::default()).unwrap();
    assert!(loaded.warnings.iter().any(|w| w.message.contains("cycle")), "{:?}", loaded.warnings);
}

#[test]
fn deep_layers_are_refused_before_they_are_parsed() {
    let folder = Folder::new("deep");
    for (name, open, close) in [("prims", "def \"a\" {", "}"), ("lists", "(", ")")] {
        for (depth, is_read) in [(200_000, false), (3000, true)] {
            let head = if name == "lists" { "double x = " } else { "" };
            let text = format!("#usda 1.0\n{head}{}{}", open.repeat(depth), close.repeat(depth));
            let error = refusal(load_with(&folder.write("deep.usda", text.as_bytes()), &LoadOptions::default()));
            assert_eq!(error.contains("nests"), !is_read, "{name} {depth}: {error}");
        }
    }
}

#[test]
fn a_package_of_more_entries_than_it_can_hold_is_refused() {
    use std::io::{Cursor, Write};
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    archive.start_file("a.usda", stored).unwrap();
    archive.write_all(b"#usda 1.0\ndef Sphere \"Ball\" {}\n").unwrap();
    let mut bytes = archive.finish().unwrap().into_inner();
    let folder = Folder::new("entries");
    assert!(load_with(&folder.write("a.usdz", &bytes), &LoadOptions::default()).is_ok());
    let end = bytes.len() - 22;
    bytes[end + 8..end + 12].copy_from_slice(&[0xff, 0xf0, 0xff, 0xf0]);
    let error = refusal(load_with(&folder.write("b.usdz", &bytes), &LoadOptions::default()));
    assert!(error.contains("b.usdz") && error.contains("entries"), "{error}");
}

#[test]
fn pictures_are_measured_before_they_are_decoded() {
    let folder = Folder::new("measured");
    let scene = write_scene(&folder, "data.bin", "a.png");
    folder.write("scene/a.png", png());
    let load = |options: LoadOptions| load_with(&scene, &options);
    assert_eq!(load(LoadOptions::default()).unwrap().scene.textures.len(), 1);
    assert_eq!(load(LoadOptions { max_texture: Some(2), ..LoadOptions::default() }).unwrap().scene.textures.len(), 1);
    let small = LoadOptions { max_texture: Some(1), ..LoadOptions::default() };
    let loaded = load(small.clone()).unwrap();
    assert!(loaded.scene.textures.is_empty());
    assert!(loaded.warnings.iter().any(|w| w.is_missing && w.places.iter().any(|p| p.contains("2 x 1 texels"))));
    let error = refusal(load(LoadOptions { strict: true, ..small }));
    assert!(error.contains("a.png") && error.contains("--strict"), "{error}");
    // Two texels of four bytes.
    assert!(load(LoadOptions { max_memory: Some(8), ..LoadOptions::default() }).is_ok());
    let error = refusal(load(LoadOptions { max_memory: Some(7), ..LoadOptions::default() }));
    assert!(error.contains("a.png") && error.contains("--max-memory"), "{error}");
}

#[test]
fn strict_bakes_end_before_they_begin_where_input_is_missing() {
    let folder = Folder::new("strict");
    let scene = write_scene(&folder, "data.bin", "missing.png");
    let out = folder.0.join("out");
    let arguments = ["unwrap", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--resolution", "16"];
    let output = lumel(&[&arguments[..], &["--strict"]].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("missing.png") && !out.exists(), "{text}");
    let output = lumel(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn limits_refuse_before_the_bake() {
    let folder = Folder::new("limits");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.glb");
    let out = folder.0.join("out");
    let bake = |limits: &[&str]| {
        let arguments = ["bake", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--quality", "draft"];
        let output = lumel(&[&arguments[..], limits].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = bake(&["--resolution", "4096", "--max-texels", "100000"]);
    assert!(code == Some(1) && text.contains("--max-texels") && text.contains("--resolution"), "{text}");
    let (code, text) = bake(&["--resolution", "4096", "--max-memory", "1G"]);
    assert!(code == Some(1) && text.contains("--max-memory") && text.contains("1024 MiB"), "{text}");
    assert!(!out.exists());
    let (code, text) = bake(&["--resolution", "32", "--max-memory", "1G", "--max-texels", "100000"]);
    assert_eq!(code, Some(0), "{text}");
    let (code, _) = bake(&["--resolution", "32", "--max-memory", "1Q"]);
    assert_eq!(code, Some(2));
}

#[test]
fn a_settings_file_beside_a_confined_scene_reaches_no_further() {
    let folder = Folder::new("settings");
    let scene = write_scene(&folder, "data.bin", "a.png");
    folder.write("scene/a.png", png());
    let inside = folder.0.join("scene");
    let unwrap = |toml: &str| {
        folder.write("scene/lumel.toml", toml.as_bytes());
        let out = folder.0.join("out");
        let arguments = ["unwrap", scene.to_str().unwrap(), "-o", out.to_str().unwrap()];
        let output = lumel(&[&arguments[..], &["--resolution", "16", "--confine", inside.to_str().unwrap()]].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = unwrap("watch = \"../elsewhere\"\n");
    assert!(code == Some(2) && text.contains("elsewhere") && text.contains("--confine"), "{text}");
    let (code, text) = unwrap("environment = \"/etc/hostname\"\n");
    assert!(code == Some(2) && text.contains("/etc/hostname"), "{text}");
    let (code, text) = unwrap("dump-stages = \"not/there/yet\"\nseed = 3\n");
    assert_eq!(code, Some(0), "{text}");
}

#[test]
fn numbers_out_of_range_never_panic() {
    let folder = Folder::new("numbers");
    let zero = 0.0f32;
    for (name, values) in [
        ("nan", [f32::NAN, zero, zero]),
        ("infinite", [f32::INFINITY, zero, zero]),
        ("huge", [3e38, 3e38, -3e38]),
        ("tiny", [1e-42, 1e-42, zero]),
        ("far", [1e20, zero, zero]),
    ] {
        let mut b = Builder::default();
        let mut corners = TRIANGLE;
        corners[1] = values;
        let positions = b.floats(&corners);
        let glb = folder.write(&format!("{name}.glb"), b.glb(one(json!({ "attributes": { "POSITION": positions } }))));
        let out = folder.0.join(name);
        let arguments = ["bake", glb.to_str().unwrap(), "-o", out.to_str().unwrap(), "--quality", "draft"];
        let output = lumel(&[&arguments[..], &["--resolution", "32", "--sky", "1"]].concat());
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!text.contains("internal error"), "{name}: {text}");
        assert!(matches!(output.status.code(), Some(0 | 1)), "{name}: {text}");
    }
}
