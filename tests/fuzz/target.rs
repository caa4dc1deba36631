//! The readers that are fed, each behind one call.

use lumel::error::Warnings;
use lumel::load::image::ColorSpace;
use lumel::load::{LoadOptions, ies, image, load_with};
use std::path::Path;

/// A reader.
pub struct Target {
    pub name: &'static str,
    /// Of the files that it is given, and of the seeds in shared corpora.
    pub extension: &'static str,
    /// Seeds are GLBs whose JSON is changed value by value.
    pub is_json: bool,
    /// Reads bytes, by way of a file in the folder; true where they were sound.
    pub read: fn(&Path, &[u8]) -> bool,
}

/// Writes the bytes to a file and loads it as a scene.
fn load(folder: &Path, extension: &str, bytes: &[u8]) -> bool {
    let path = folder.join(format!("scene.{extension}"));
    std::fs::write(&path, bytes).unwrap();
    match load_with(&path, &LoadOptions::default()) {
        Ok(_) => true,
        Err(error) => {
            let text = error.to_string();
            let is_named = text.contains("scene.") || text.contains(&*folder.to_string_lossy());
            assert!(is_named, "the message names no file: {text}");
            false
        }
    }
}

const TARGETS: [Target; 7] = [
    Target { name: "glb", extension: "glb", is_json: false, read: |folder, bytes| load(folder, "glb", bytes) },
    Target { name: "accessors", extension: "glb", is_json: true, read: |folder, bytes| load(folder, "glb", bytes) },
    Target { name: "usdz", extension: "usdz", is_json: false, read: |folder, bytes| load(folder, "usdz", bytes) },
    Target { name: "usdc", extension: "usdc", is_json: false, read: |folder, bytes| load(folder, "usdc", bytes) },
    Target { name: "usda", extension: "usda", is_json: false, read: |folder, bytes| load(folder, "usda", bytes) },
    Target {
        name: "image",
        extension: "png",
        is_json: false,
        read: |_, bytes| match image::decode("picture", bytes, ColorSpace::Auto) {
            Ok(texture) => {
                let corner = texture.texel(texture.width - 1, texture.height - 1);
                assert!(corner.is_finite(), "a texel is not finite");
                true
            }
            Err(_) => false,
        },
    },
    Target {
        name: "ies",
        extension: "ies",
        is_json: false,
        read: |_, bytes| match ies::read("light.ies", bytes, &mut Warnings::default()) {
            Ok(web) => {
                assert!(web.mean_intensity().is_finite(), "a web without a finite mean");
                true
            }
            Err(_) => false,
        },
    },
];

/// The target called `name`.
pub fn named(name: &str) -> Target {
    TARGETS.into_iter().find(|t| t.name == name).unwrap_or_else(|| panic!("no target {name}"))
}
