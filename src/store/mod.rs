//! A store of files by what they were made from: results of stages that need not be found twice.
//!
//! An entry is found by its [`Key`], the hash of all that its content depends on, so it is never out of date: a change asks for
//! another key. It is a list of sections of bytes ([`format`](self::format) gives the layout), which are mapped into memory and
//! checked whole when it is read. Damage of any kind is told as a warning, and the entry taken away: its work is done again.
//!
//! Entries are written under another name, synced and renamed, so that no reader ever meets half of one, and never changed
//! afterwards. Any number of processes may use a store at once; two that write one key write the same bytes, and the later one stays.
//!
//! ```text
//! <folder>/lumel-cache.txt          says whose folder it is
//! <folder>/v1/<kind>/<key>          an entry
//! <folder>/v1/<kind>/.<key>.*.tmp   one that is being written
//! ```
//!
//! Another layout of files gets another subfolder, so that no version reads what it doesn't know. Sections hold numbers as the machine
//! has them, and big-endian machines have a subfolder of their own.

mod claim;
mod entry;
mod format;
mod key;
mod lock;
mod map;
mod output;
mod survey;

pub use claim::Claim;
pub use entry::Entry;
pub use key::{Hasher, Key};
pub use lock::FolderLock;
pub use output::{Create, Output};
pub use survey::{Item, Pruned, Survey};

use crate::error::{Error, Result, Warnings};
use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// The subfolder of this layout.
const LAYOUT: &str = if cfg!(target_endian = "little") { "v1" } else { "v1-be" };

/// The file that says whose folder it is, and what stands in it.
const MARKER: &str = "lumel-cache.txt";
const MARKER_TEXT: &str = "Lumel cache, format 1. Made by Lumel; may be deleted.\n";

/// How old a half-written file must be for its writer to be dead, where locks can't tell.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);

/// A folder of entries, or none. Shared between threads as it is.
pub struct Store {
    /// The folder of this layout's entries, below the one that was opened.
    folder: Option<PathBuf>,
    create: Box<Create>,
    warnings: Mutex<Warnings>,
}

impl Store {
    /// No store: reads find nothing, and writes do nothing.
    pub fn none() -> Self {
        Self { folder: None, create: Box::new(output::create), warnings: Mutex::default() }
    }

    /// The store in `folder`, which is made where it is missing. Files that writers left half done more than a day ago are cleared.
    ///
    /// # Errors
    /// `Invalid` where the folder holds other things and no store; `Io`.
    pub fn open(folder: &Path) -> Result<Self> {
        Self::open_with(folder, Box::new(output::create))
    }

    /// The same, with entries written to what `create` makes: for tests of disks that fail.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn open_with(folder: &Path, create: Box<Create>) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        mark(folder)?;
        let entries = folder.join(LAYOUT);
        fs::create_dir_all(&entries).map_err(|e| Error::io(&entries, e))?;
        let store = Self { folder: Some(entries), create, warnings: Mutex::default() };
        store.clear_abandoned(ABANDONED);
        Ok(store)
    }

    /// The store in `folder` where there is one: nothing is made.
    ///
    /// # Errors
    /// `Invalid` where there is none; `Io`.
    pub fn open_existing(folder: &Path) -> Result<Self> {
        if !folder.join(MARKER).is_file() {
            return Err(Error::invalid(folder.display(), format!("is no cache of Lumel: it holds no {MARKER}")));
        }
        Self::open(folder)
    }

    /// True of [`none`](Self::none).
    pub fn is_none(&self) -> bool {
        self.folder.is_none()
    }

    /// The folder that was opened.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref().and_then(Path::parent)
    }

    /// The entry `key` of `kind` (a word of a-z, 0-9 and -), checked whole; `None` where there is none, or where it was damaged: then it
    /// is taken away, with a warning. Reading counts as use.
    ///
    /// # Errors
    /// `Io` where a file is there and can't be read.
    pub fn read(&self, kind: &str, key: Key) -> Result<Option<Entry>> {
        let Some(path) = self.path(kind, key) else { return Ok(None) };
        match Entry::open(&path, kind, key) {
            Ok(entry) => {
                touch(&path);
                Ok(Some(entry))
            }
            Err(entry::Fault::Missing) => Ok(None),
            Err(entry::Fault::Io(e)) => Err(Error::io(&path, e)),
            Err(entry::Fault::Damaged(what)) => {
                self.discard(&path, what);
                Ok(None)
            }
        }
    }

    /// True where there is such an entry. It isn't checked, and this doesn't count as use.
    pub fn contains(&self, kind: &str, key: Key) -> bool {
        self.path(kind, key).is_some_and(|path| path.is_file())
    }

    /// Writes an entry in place of the one that may be there. It is on the disk when this returns; where it fails, nothing is left of it.
    ///
    /// # Errors
    /// `Io`, with the file's name.
    pub fn write(&self, kind: &str, key: Key, sections: &[&[u8]]) -> Result<()> {
        let Some(path) = self.path(kind, key) else { return Ok(()) };
        output::write(&path, &self.create, |out| format::write(out, kind, key, sections))
    }

    /// Removes an entry; false where there was none.
    ///
    /// # Errors
    /// `Io`.
    pub fn remove(&self, kind: &str, key: Key) -> Result<bool> {
        let Some(path) = self.path(kind, key) else { return Ok(false) };
        match fs::remove_file(&path) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(false),
            Err(e) => Err(Error::io(&path, e)),
        }
    }

    /// Removes all entries of `kind`, and claims on them.
    ///
    /// # Errors
    /// `Io`.
    pub fn remove_kind(&self, kind: &str) -> Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        assert!(is_kind(kind), "{kind:?} is no kind of entry");
        let folder = folder.join(kind);
        match fs::remove_dir_all(&folder) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(Error::io(&folder, e)),
            _ => Ok(()),
        }
    }

    /// Tells of something that is no error.
    pub fn warn(&self, place: impl fmt::Display, message: impl fmt::Display) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).add(place, message);
    }

    /// What was met since it was last asked.
    pub fn take_warnings(&self) -> Warnings {
        std::mem::take(&mut self.warnings.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn path(&self, kind: &str, key: Key) -> Option<PathBuf> {
        assert!(is_kind(kind), "{kind:?} is no kind of entry");
        Some(self.folder.as_ref()?.join(kind).join(key.to_string()))
    }

    /// Takes a damaged file away, and says so.
    fn discard(&self, path: &Path, what: &str) {
        let left = match fs::remove_file(path) {
            Err(e) if e.kind() != ErrorKind::NotFound => format!(", but can't be removed ({e})"),
            _ => String::new(),
        };
        let message = format!("a damaged entry of the cache ({what}) is done again{left}");
        self.warn(path.display(), message);
    }
}

impl fmt::Debug for Store {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Store").field("folder", &self.folder).finish_non_exhaustive()
    }
}

/// True of words that may name a kind and its folder.
fn is_kind(kind: &str) -> bool {
    let is_plain = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-';
    (1..=format::KIND_BYTES).contains(&kind.len()) && kind.bytes().all(is_plain)
}

/// Sees to it that `folder` says that it is a store. The marker comes first of all that a store holds: a folder that holds anything
/// else and not that isn't one.
fn mark(folder: &Path) -> Result<()> {
    let marker = folder.join(MARKER);
    let is_empty = fs::read_dir(folder).map_err(|e| Error::io(folder, e))?.next().is_none();
    match fs::read(&marker) {
        // A process that was killed here may have left a part of it.
        Ok(text) if text.starts_with(b"Lumel cache") && text.ends_with(b"\n") => return Ok(()),
        Ok(text) if MARKER_TEXT.as_bytes().starts_with(&text) => {}
        Ok(_) => {
            return Err(Error::invalid(
                marker.display(),
                "isn't Lumel's, or is damaged; choose another folder for the cache, or delete this one if it is a cache: nothing but time is lost",
            ));
        }
        Err(e) if e.kind() == ErrorKind::NotFound && is_empty => {}
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let message = format!(
                "holds other things than a cache (it has no {MARKER}); choose an empty or a new folder for the cache, or delete this one if it is a cache: nothing but time is lost"
            );
            return Err(Error::invalid(folder.display(), message));
        }
        Err(e) => return Err(Error::io(&marker, e)),
    }
    fs::write(&marker, MARKER_TEXT).map_err(|e| Error::io(&marker, e))
}

/// Sets the time of a file's last use. It is worth no error: a store that can't be written to can still be read.
fn touch(path: &Path) {
    let touched: io::Result<()> =
        OpenOptions::new().append(true).open(path).and_then(|file: File| file.set_modified(SystemTime::now()));
    let _ = touched;
}
