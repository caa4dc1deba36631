//! Files that appear complete or not at all.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes `path` through `fill`: into a file beside it first, which is flushed to disk and then renamed into place. The old
/// file stays as it was until then, and whatever fails leaves no partial file.
///
/// # Errors
/// `Io` naming `path`, or what `fill` returns.
pub fn write_file(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    let part = partial_path(path);
    let written = File::create(&part).map_err(|e| Error::io(path, e)).and_then(|file| {
        let mut out = BufWriter::new(file);
        fill(&mut out)?;
        out.flush().map_err(|e| Error::io(path, e))?;
        out.get_ref().sync_all().map_err(|e| Error::io(path, e))
    });
    let placed = written.and_then(|()| std::fs::rename(&part, path).map_err(|e| Error::io(path, e)));
    if placed.is_err() {
        // Nothing more can be done where even the removal fails; the error that is returned says what came first.
        let _ = std::fs::remove_file(&part);
    }
    placed
}

/// The file beside `path` that is renamed to it when complete.
fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    path.with_file_name(name)
}
