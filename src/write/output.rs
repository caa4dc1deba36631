//! An output folder whose files appear complete or not at all.

use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Name of the folder inside the output folder in which files are prepared.
pub const STAGING_NAME: &str = ".lumel-partial";

/// A set of files on their way into an output folder. They are written below `<folder>/.lumel-partial` and moved into place
/// by [`commit`](Self::commit); dropped without it, nothing of them is left, and a folder that had to be made is removed.
#[derive(Debug)]
pub struct Staging {
    folder: PathBuf,
    files: Vec<PathBuf>,
    /// What earlier runs left and goes with [`commit`](Self::commit).
    removed: Vec<PathBuf>,
}

impl Staging {
    /// Prepares to write into `folder`, which is made where it is missing.
    ///
    /// # Errors
    /// `Io` where it can't be made or written to.
    pub fn new(folder: &Path) -> Result<Self> {
        let staging = folder.join(STAGING_NAME);
        // What an interrupted run may have left there is of no use to anybody.
        if staging.exists() {
            std::fs::remove_dir_all(&staging).map_err(|e| Error::io(&staging, e))?;
        }
        std::fs::create_dir_all(&staging).map_err(|e| {
            let message = format!("the output folder can't be made or written to ({e}); choose another one with -o");
            Error::io(folder, std::io::Error::new(e.kind(), message))
        })?;
        Ok(Self { folder: folder.to_path_buf(), files: Vec::new(), removed: Vec::new() })
    }

    /// The path at which to write the file that becomes `<folder>/<relative>`; its parent folder is made.
    ///
    /// # Errors
    /// `Io` where the parent can't be made.
    pub fn path(&mut self, relative: impl AsRef<Path>) -> Result<PathBuf> {
        let relative = relative.as_ref().to_path_buf();
        let path = self.folder.join(STAGING_NAME).join(&relative);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
        }
        self.files.push(relative);
        Ok(path)
    }

    /// The files that were asked for, relative to the output folder.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(PathBuf::as_path)
    }

    /// Lets `<folder>/<relative>`, which an earlier run left, go once all files are in place.
    pub fn remove(&mut self, relative: impl AsRef<Path>) {
        self.removed.push(relative.as_ref().to_path_buf());
    }

    /// Flushes every file to disk and moves it to its place, in the order in which they were asked for.
    ///
    /// # Errors
    /// `Io` naming the file; those before it are in place by then, the others are not.
    pub fn commit(self) -> Result<()> {
        let staging = self.folder.join(STAGING_NAME);
        for file in &self.files {
            let path = staging.join(file);
            std::fs::File::open(&path).and_then(|f| f.sync_all()).map_err(|e| Error::io(&path, e))?;
        }
        for file in &self.files {
            let place = self.folder.join(file);
            if let Some(parent) = place.parent() {
                std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
            }
            std::fs::rename(staging.join(file), &place).map_err(|e| Error::io(&place, e))?;
        }
        for file in &self.removed {
            let place = self.folder.join(file);
            match std::fs::remove_file(&place) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&place, e)),
                _ => {}
            }
        }
        Ok(())
    }

    /// Removes what an unfinished run left in `folder`: the staging folder, and `folder` itself where it is empty then.
    pub fn discard(folder: &Path) {
        // Best effort: there is nobody to tell where the removal itself fails, and the next run does it again.
        let _ = std::fs::remove_dir_all(folder.join(STAGING_NAME));
        let _ = std::fs::remove_dir(folder);
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        Self::discard(&self.folder);
    }
}
