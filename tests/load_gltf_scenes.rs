//! The glTF reader on real files, where the shared folder is there.

mod files;
mod gltf_document;

use files::shared;
use glam::Vec3;
use gltf_document::area;
use lumel::scene::LightShape;
use std::path::{Path, PathBuf};

/// All .gltf and .glb files below `folder`, sorted.
fn gltf_files(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut stack = vec![folder.to_owned()];
    while let Some(folder) = stack.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            match path.extension().and_then(|e| e.to_str()) {
                _ if path.is_dir() => stack.push(path),
                Some("gltf" | "glb") => out.push(path),
                _ => {}
            }
        }
    }
    out.sort();
    out
}

#[test]
fn real_scenes_load() {
    let Some(shared) = shared() else { return };
    let mut files = Vec::new();
    for name in [
        "bevy_cornell_box",
        "godot_living_room",
        "godot_gi_zdm2",
        "playcanvas_house",
        "nvpro_cornell_box",
        "khr_core_features",
        "khr_milk_truck",
        "agen_positive",
        "blenderio_features",
    ] {
        files.extend(gltf_files(&shared.join("scenes").join(name)));
    }
    files.extend(gltf_files(&shared.join("reference")));
    assert!(files.len() > 80, "only {} files", files.len());
    let mut refused = Vec::new();
    for file in &files {
        match lumel::load::load(file) {
            Ok(loaded) => {
                let scene = &loaded.scene;
                let area: f32 = (0..scene.surfaces.len()).map(|s| area(scene, s)).sum();
                println!(
                    "{}: {} surfaces, {} triangles, {area:.3} m2, {} lights, {} textures",
                    file.strip_prefix(&shared).unwrap_or(file).display(),
                    scene.surfaces.len(),
                    scene.triangle_count(),
                    scene.lights.len(),
                    scene.textures.len()
                );
                for w in loaded.warnings.iter() {
                    println!("    {} x {}: {}", w.count, w.message, w.places.first().map_or("", String::as_str));
                }
                assert!(area.is_finite() && area > 0.0 && area < 1e9, "{}: {area} m2", file.display());
            }
            Err(e) => refused.push(e.to_string()),
        }
    }
    println!("refused:\n{}", refused.join("\n"));
}

#[test]
fn reference_rooms_have_their_known_areas_and_lights() {
    let Some(shared) = shared() else { return };
    // Areas [m2] added up from the files by a script of its own.
    for (name, expected, lights) in [("cornell_box", 1.9207, 0), ("living_room", 698.344, 3), ("atrium", 5648.28, 1)] {
        let file = shared.join("reference").join(name).join("scene.glb");
        let loaded = lumel::load::load(&file).unwrap_or_else(|e| panic!("{e}"));
        let scene = &loaded.scene;
        assert!(scene.has_light(), "{name} has a light");
        assert_eq!(scene.lights.len(), lights, "{name}");
        let area: f32 = (0..scene.surfaces.len()).map(|s| area(scene, s)).sum();
        assert!((area / expected - 1.0).abs() < 1e-3, "{name}: {area} m2");
        if name == "atrium" {
            let LightShape::Directional { direction, illuminance, .. } = &scene.lights[0].shape else { panic!() };
            assert!(direction.abs_diff_eq(Vec3::new(0.35, -0.8, 0.5).normalize(), 1e-4), "{direction}");
            assert!(illuminance.abs_diff_eq(Vec3::new(1.0, 0.95, 0.85) * 20.0, 1e-3), "{illuminance}");
        }
        if name == "living_room" {
            let panel = Vec3::new(420.0, 390.0, 330.0);
            assert!(
                scene.materials.iter().any(|m| m.emission.abs_diff_eq(panel, 0.01)),
                "the ceiling panel's radiance"
            );
        }
    }
}

#[test]
fn no_file_of_the_collection_panics() {
    let Some(shared) = shared() else { return };
    // validator_bad, assimp_bad and magnum_bad_gltf among them; errors are fine, and name a file.
    for file in gltf_files(&shared.join("scenes")) {
        if let Err(e) = lumel::load::load(&file) {
            println!("{e}");
            let folder = file.parent().unwrap().display().to_string();
            assert!(e.to_string().contains(&folder), "{}: {e}", file.display());
        }
    }
}
