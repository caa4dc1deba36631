//! What a bake holds: bytes a texel above the scene, as `report.json` tells the most that the process held.
#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Bytes a texel that a bake of the sample Cornell box may take at its default error, above what its scene takes.
const MOST: f64 = 256.0;

/// Texels covered, and the most memory held [bytes], of a bake of the sample Cornell box on one page of `side` squared.
fn bake(folder: &Path, side: &str) -> (f64, f64) {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.glb");
    let out = folder.join(side);
    let status = Command::new(env!("CARGO_BIN_EXE_lumel"))
        .args(["bake", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--resolution", side])
        .args(["--threads", "2", "--error", "5%", "--gltf", "engine"])
        .output()
        .unwrap();
    assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    (report["texels"].as_f64().unwrap(), report["peak_memory_bytes"].as_f64().unwrap())
}

#[test]
fn a_texel_takes_few_bytes() {
    let folder: PathBuf = std::env::temp_dir().join(format!("lumel-memory-{}", std::process::id()));
    let (_, scene) = bake(&folder, "64");
    let (texels, most) = bake(&folder, "768");
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(texels > 250_000.0, "{texels} texels are too few to tell");
    let bytes = (most - scene) / texels;
    assert!(bytes < MOST, "{bytes:.0} bytes a texel");
    // So little would mean that nothing was measured: positions, albedos and light alone take more.
    assert!(bytes > 50.0, "{bytes:.0} bytes a texel");
}
