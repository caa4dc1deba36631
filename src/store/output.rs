//! Files that are there whole or not at all.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The end of the names of files that are being written.
pub const TEMPORARY: &str = ".tmp";

/// What an entry is written to.
pub trait Output: Write {
    /// Returns once all that was written is on the disk.
    ///
    /// # Errors
    /// Those of the operating system.
    fn sync(&mut self) -> io::Result<()>;
}

/// Makes a file that must not be there yet.
pub type Create = dyn Fn(&Path) -> io::Result<Box<dyn Output>> + Send + Sync;

impl Output for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}

/// A file of the disk, locked for as long as it is written: so others see that its writer is alive.
pub fn create(path: &Path) -> io::Result<Box<dyn Output>> {
    let file = OpenOptions::new().write(true).create_new(true).open(path)?;
    // Where there are no locks, age tells.
    let _ = file.try_lock();
    Ok(Box::new(file))
}

/// Times that a file is written whose folder another process removes meanwhile.
const TRIES: u32 = 3;

/// Writes the file `path` by `write`, in place of the one that may be there. Where it fails, nothing is left.
///
/// # Errors
/// `Io`, with the file's name.
pub fn write(path: &Path, create: &Create, write: impl Fn(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let mut tries = 1;
    loop {
        match write_once(path, create, &write) {
            Err(e) if e.kind() == ErrorKind::NotFound && tries < TRIES => tries += 1,
            written => return written.map_err(|e| failed(path, e)),
        }
    }
}

fn write_once(path: &Path, create: &Create, write: impl Fn(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let (temporary, mut out) = make_temporary(path, create)?;
    let written = write(&mut *out).and_then(|()| out.flush()).and_then(|()| out.sync());
    // Closed before it is renamed: Windows wants it so.
    drop(out);
    let kept = written.and_then(|()| put(&temporary, path)).and_then(|()| sync_folder(folder));
    kept.inspect_err(|_| {
        let _ = fs::remove_file(&temporary);
    })
}

/// Gives a file its name.
fn put(temporary: &Path, path: &Path) -> io::Result<()> {
    fs::rename(temporary, path).or_else(|e| match e.kind() {
        // Windows keeps a file in place while someone has it mapped. It was made from the same: it may stay.
        ErrorKind::PermissionDenied if cfg!(windows) && path.is_file() => fs::remove_file(temporary),
        _ => Err(e),
    })
}

/// A file beside `path` under a name of its own: no other process or thread writes it.
fn make_temporary(path: &Path, create: &Create) -> io::Result<(PathBuf, Box<dyn Output>)> {
    const NAMES: u32 = 1000;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let process = std::process::id();
    let mut last = io::Error::from(ErrorKind::AlreadyExists);
    for k in 0..NAMES {
        let temporary = path.with_file_name(format!(".{name}.{process}.{k}{TEMPORARY}"));
        match create(&temporary) {
            Ok(out) => return Ok((temporary, out)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => last = e,
            Err(e) => return Err(e),
        }
    }
    Err(last)
}

/// A new name is on the disk once its folder is.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

fn failed(path: &Path, e: io::Error) -> Error {
    let full = matches!(e.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
    let e = if full { io::Error::new(e.kind(), format!("{e}; make room, or prune the cache")) } else { e };
    Error::io(path, e)
}
