//! Where results go, and that they never replace an input.

use lumel::settings::Settings;
use lumel::{Error, Result};
use std::path::{Path, PathBuf};

/// The scene's file name without its extension, from which output names are made.
pub fn stem(scene: &Path) -> String {
    scene.file_stem().map_or_else(|| "scene".to_string(), |s| s.to_string_lossy().into_owned())
}

/// The output folder: the one that was asked for, or `./<stem>_baked`.
pub fn folder(scene: &Path, asked: Option<&Path>) -> PathBuf {
    asked.map_or_else(|| PathBuf::from(format!("{}_baked", stem(scene))), Path::to_path_buf)
}

/// The cache of bakes into `folder`, unless another is asked for.
pub fn cache(folder: &Path) -> PathBuf {
    folder.join(".lumel")
}

/// What that may hold [bytes]: nobody looks there, and each change of a scene adds to it.
const CACHE_LIMIT: u64 = 4 << 30;

/// Sets the cache of `settings` to that of bakes into `folder`, unless they have one.
pub fn set_cache(settings: &mut Settings, folder: &Path) {
    if settings.cache.is_none() {
        settings.cache = Some(cache(folder));
        settings.cache_limit.get_or_insert(CACHE_LIMIT);
    }
}

/// Refuses an output folder in which a result would replace one of `inputs`.
///
/// # Errors
/// `Invalid` naming the input.
pub fn refuse_replacing(scene: &Path, inputs: &[&Path], folder: &Path) -> Result<()> {
    // A folder that doesn't exist holds no input.
    let Ok(folder) = folder.canonicalize() else { return Ok(()) };
    let stem = stem(scene);
    let suffixes = ["glb", "vertex.glb", "lumel.usda", "vertex.usda"];
    let mut results: Vec<String> = suffixes.iter().map(|suffix| format!("{stem}.{suffix}")).collect();
    results.push("report.json".into());
    for input in inputs {
        let Ok(place) = input.canonicalize() else { continue };
        let Ok(inside) = place.strip_prefix(&folder) else { continue };
        let page = inside.parent() == Some(Path::new("lightmaps"))
            && inside.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
            && inside.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&format!("{stem}_")));
        // Some file systems don't tell upper from lower case.
        let named = results.iter().any(|r| inside.to_string_lossy().eq_ignore_ascii_case(r));
        if page || named {
            let message = format!("would be replaced by a result in {}; give another folder with -o", folder.display());
            return Err(Error::invalid(input.display(), message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_folder_is_named_after_the_scene() {
        assert_eq!(folder(Path::new("a/room.glb"), None), Path::new("room_baked"));
        assert_eq!(folder(Path::new("a/room.glb"), Some(Path::new("out"))), Path::new("out"));
    }

    #[test]
    fn a_result_never_replaces_the_scene() {
        let dir = std::env::temp_dir().join(format!("lumel-destination-{}", std::process::id()));
        std::fs::create_dir_all(dir.join("lightmaps")).unwrap();
        for name in ["room.glb", "room.gltf", "lightmaps/room_0.exr"] {
            std::fs::write(dir.join(name), b"x").unwrap();
        }
        let (glb, gltf, page) = (dir.join("room.glb"), dir.join("room.gltf"), dir.join("lightmaps/room_0.exr"));
        assert!(refuse_replacing(&glb, &[&glb], &dir).is_err());
        assert!(refuse_replacing(&gltf, &[&gltf], &dir).is_ok(), "a .gltf is not among the results");
        assert!(refuse_replacing(&gltf, &[&gltf, &page], &dir).is_err());
        assert!(refuse_replacing(&glb, &[&glb], &dir.join("baked")).is_ok());
        std::fs::remove_dir_all(dir).unwrap();
    }
}
