//! Folders that tests write to, and the scenes that may lie beside the project.
#![allow(dead_code)] // each test file uses its own share

use std::path::{Path, PathBuf};

/// A folder of one test's own, removed at its end.
pub struct Folder(pub PathBuf);

impl Folder {
    /// `name` is unlike that of any other test of the same file.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("lumel-test-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file, in a folder of its own where `name` has one.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// The names of what it holds, sorted.
    pub fn entries(&self) -> Vec<String> {
        let names = std::fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The folder of shared scenes and references; `None`, with a line that says so, where it is absent.
pub fn shared() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let folder = std::env::var_os("LUMEL_REFERENCE").map_or(beside, PathBuf::from);
    if folder.join("scenes").is_dir() {
        return Some(folder);
    }
    println!("skipped: no scenes in {} (set LUMEL_REFERENCE)", folder.display());
    None
}
