//! What a bake leaves in its folder, and what of earlier bakes goes.

mod files;
mod support;

use files::Folder;
use lumel::meshing::MeshMode;
use lumel::progress::Silent;
use lumel::settings::Settings;
use lumel::write::GltfProfile;
use lumel::write::encode::Encoding;
use std::path::{Path, PathBuf};
use support::draft;

fn scene() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.usda")
}

/// The files below `folder`, relative to it with forward slashes, sorted.
fn stands(folder: &Folder) -> Vec<String> {
    let mut found = folder.entries();
    found.retain(|name| name != "lightmaps");
    let pages = std::fs::read_dir(folder.0.join("lightmaps")).into_iter().flatten();
    found.extend(pages.map(|e| format!("lightmaps/{}", e.unwrap().file_name().to_str().unwrap())));
    found.sort();
    found
}

/// What the report in `folder` says that stands there beside it.
fn listed(folder: &Folder) -> Vec<String> {
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.0.join("report.json")).unwrap()).unwrap();
    let mut files: Vec<String> = serde_json::from_value(report["files"].clone()).unwrap();
    files.push("report.json".into());
    files.sort();
    files
}

/// Many small pages in two forms, both GLBs, and a mesh that is cut.
fn rich() -> Settings {
    Settings {
        page_size: Some(32),
        density: Some(20.0),
        encoding: Some(vec![Encoding::Exr, Encoding::Hdr]),
        mesh: MeshMode::Adaptive,
        ..draft()
    }
}

/// One page, one GLB, meshes as they are.
fn plain() -> Settings {
    Settings { resolution: Some(64), gltf: Some(vec![GltfProfile::Engine]), ..draft() }
}

#[test]
fn what_a_bake_does_not_write_goes_and_files_of_others_stay() {
    let folder = Folder::new("retired");
    let bake = |settings: &Settings| lumel::pipeline::bake(&scene(), &folder.0, settings, &Silent).unwrap();
    bake(&rich());
    let first = stands(&folder);
    assert_eq!(listed(&folder), first);
    for name in [
        "cornell_box.vertex.usda",
        "cornell_box.vertex.glb",
        "lightmaps/cornell_box_1.exr",
        "lightmaps/cornell_box_0.hdr",
    ] {
        assert!(first.iter().any(|f| f == name), "{first:?}");
    }
    // By names of a bake's and by others, and none that a report lists.
    let others = ["lightmaps/cornell_box_77.exr", "cornell_box.loading.txt", "cornell_box.png", "lightmaps/notes.txt"];
    others.iter().for_each(|name| drop(folder.write(name, "mine")));
    bake(&plain());
    let mut expected = vec!["cornell_box.glb", "cornell_box.lumel.usda", "lightmaps/cornell_box_0.exr", "report.json"];
    assert_eq!(listed(&folder), expected);
    expected.extend(others);
    expected.sort_unstable();
    assert_eq!(stands(&folder), expected);
}

#[test]
fn an_unwrap_leaves_pages_and_the_next_bake_still_knows_them() {
    let folder = Folder::new("unwrapped between");
    lumel::pipeline::bake(&scene(), &folder.0, &rich(), &Silent).unwrap();
    let first = stands(&folder);
    lumel::pipeline::unwrap(&scene(), &folder.0, &plain(), &Silent).unwrap();
    assert_eq!(stands(&folder), first);
    assert_eq!(listed(&folder), first);
    lumel::pipeline::bake(&scene(), &folder.0, &plain(), &Silent).unwrap();
    assert_eq!(stands(&folder).len(), 4);
}

#[test]
fn neither_an_input_nor_a_path_out_of_the_folder_goes_whatever_a_report_lists() {
    let folder = Folder::new("listed inputs");
    // The scene has the name of a file that an earlier bake of it would have left.
    let input = folder.write("room.vertex.usda", std::fs::read(scene()).unwrap());
    let outside = folder.write("outside.glb", "mine");
    let into = folder.0.join("baked");
    let link = into.join("room.vertex.vertex.usda");
    std::fs::create_dir_all(&into).unwrap();
    std::fs::write(&link, "").unwrap();
    let report = serde_json::json!({ "inputs": [{ "path": input }],
        "files": ["../outside.glb", outside, "../room.vertex.usda", "room.vertex.vertex.usda", 7, null] });
    folder.write("baked/report.json", report.to_string());
    lumel::pipeline::bake(&input, &into, &plain(), &Silent).unwrap();
    assert!(input.exists() && outside.exists() && !link.exists());

    let own = Folder::new("own inputs");
    let input = own.write("room.glb", std::fs::read(scene().with_extension("glb")).unwrap());
    let report = serde_json::json!({ "inputs": [{ "path": input }], "files": ["room.glb"] });
    own.write("report.json", report.to_string());
    let settings = Settings { gltf: Some(vec![GltfProfile::Vertex]), ..plain() };
    lumel::pipeline::bake(&input, &own.0, &settings, &Silent).unwrap();
    assert!(input.exists());
}
