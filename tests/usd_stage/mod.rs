//! Small stages that tests read.
#![allow(dead_code)] // each test file uses its own share

use crate::files::Folder;
use glam::Vec3;
use lumel::load::{self, Loaded};

pub const METRES: &str = "#usda 1.0\n(\n metersPerUnit = 1\n upAxis = \"Y\"\n)\n";

/// A mesh of one unit square in the XY plane, facing +Z.
pub const SQUARE: &str = r#"
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
"#;

pub fn load_text(name: &str, text: &str) -> Loaded {
    let folder = Folder::new(name);
    load::load(&folder.write("scene.usda", text)).unwrap()
}

/// A stage in metres, Y up.
pub fn load_body(name: &str, body: &str) -> Loaded {
    load_text(name, &format!("{METRES}{body}"))
}

pub fn warned(loaded: &Loaded, message: &str, place: &str) -> bool {
    loaded.warnings.iter().any(|w| w.message.contains(message) && w.places.iter().any(|p| p.contains(place)))
}

pub fn assert_close(a: Vec3, b: Vec3) {
    assert!(a.distance(b) < 1e-5 * (1.0 + b.length()), "{a} is not {b}");
}
