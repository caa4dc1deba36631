//! Who is at which work: so that several processes don't do the same.

use super::{Key, Store};
use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::PathBuf;

/// The end of the names of files by which work is claimed.
pub const CLAIM: &str = ".claim";

/// Work that is this process's, until it is dropped or the process ends in whatever way. On a file system without locks everybody
/// may claim everything: work is then done twice, and comes out the same.
#[derive(Debug)]
pub struct Claim {
    path: PathBuf,
    file: File,
}

impl Store {
    /// Claims the work on an entry; `None` where another process is at it.
    ///
    /// # Errors
    /// `Io`.
    pub fn claim(&self, kind: &str, key: Key) -> Result<Option<Claim>> {
        let Some(entry) = self.path(kind, key) else { return Ok(None) };
        let path = entry.with_file_name(format!(".{key}{CLAIM}"));
        let open = || {
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            OpenOptions::new().write(true).create(true).truncate(false).open(&path)
        };
        // Another process may have removed the folder between the two.
        let file = match open() {
            Err(e) if e.kind() == ErrorKind::NotFound => open(),
            other => other,
        };
        let file = file.map_err(|e| Error::io(&path, e))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Claim { path, file })),
            Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => Ok(Some(Claim { path, file })),
            Err(TryLockError::Error(e)) => Err(Error::io(&path, e)),
            Err(TryLockError::WouldBlock) => Ok(None),
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Another may open the name just now and claim what has gone: then two do the same work, which harms nothing.
        let _ = fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}
