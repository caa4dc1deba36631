//! What a store holds, whether it is sound, and less of it.

use super::entry::{Entry, Fault};
use super::key::Key;
use super::output::TEMPORARY;
use super::{LAYOUT, Store};
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::fs::{self, DirEntry, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// How old a file without a lock must be for its writer to be dead: a living one locks it as soon as it is made.
const UNLOCKED: Duration = Duration::from_secs(10);

/// A file of the store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// The entry's kind.
    pub kind: String,
    /// Its key; `None` of files that are no entries of this version.
    pub key: Option<Key>,
    pub path: PathBuf,
    /// [bytes]
    pub size: u64,
    /// When it was last read or written.
    pub used: SystemTime,
}

/// All files of a store.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Survey {
    /// By kind, in each the one that was used last first. Half-written files aren't among them.
    pub items: Vec<Item>,
}

/// What pruning did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Entries that were removed, and their size [bytes].
    pub removed: usize,
    pub freed: u64,
    /// What is left [bytes].
    pub left: u64,
    /// Half-written files of dead processes that were removed.
    pub abandoned: usize,
}

impl Survey {
    /// Size of all [bytes].
    pub fn size(&self) -> u64 {
        self.items.iter().map(|item| item.size).sum()
    }
}

impl Store {
    /// Lists what it holds, entries of other versions among them.
    ///
    /// # Errors
    /// `Io`.
    pub fn survey(&self) -> Result<Survey> {
        let mut items = Vec::new();
        for layout in self.layouts()? {
            let is_ours = layout.file_name().is_some_and(|name| name == LAYOUT);
            for (kind, file) in files(&layout)? {
                let name = file.file_name().to_string_lossy().into_owned();
                if name.ends_with(TEMPORARY) {
                    continue;
                }
                // It may have gone since.
                let Ok(metadata) = file.metadata() else { continue };
                let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                let key = name.parse().ok().filter(|_| is_ours);
                items.push(Item { kind, key, path: file.path(), size: metadata.len(), used });
            }
        }
        items.sort_by(|a, b| (&a.kind, b.used, &a.path).cmp(&(&b.kind, a.used, &b.path)));
        Ok(Survey { items })
    }

    /// Checks every entry of this version; returns the damaged ones, each with what is wrong. Nothing is changed.
    ///
    /// # Errors
    /// `Io` where a file can't be read; `Cancelled`.
    pub fn verify(&self, progress: &dyn Progress) -> Result<Vec<(Item, &'static str)>> {
        let survey = self.survey()?;
        progress.begin("verify", survey.size());
        let mut damaged = Vec::new();
        for item in survey.items {
            progress.check()?;
            let size = item.size;
            if let Some(key) = item.key {
                match Entry::open(&item.path, &item.kind, key) {
                    Ok(_) | Err(Fault::Missing) => {}
                    Err(Fault::Damaged(what)) => damaged.push((item, what)),
                    Err(Fault::Io(e)) => return Err(Error::io(&item.path, e)),
                }
            }
            progress.advance(size);
        }
        Ok(damaged)
    }

    /// Removes what was used least recently, entries of other versions among them, until no more than `max_size` [bytes] is left, and
    /// what dead processes left half written.
    ///
    /// # Errors
    /// `Io`.
    pub fn prune(&self, max_size: u64) -> Result<Pruned> {
        self.prune_unused(max_size, None)
    }

    /// The same, but for what was used `since` then.
    ///
    /// # Errors
    /// `Io`.
    pub fn prune_unused(&self, max_size: u64, since: Option<SystemTime>) -> Result<Pruned> {
        let abandoned = self.clear_abandoned(UNLOCKED);
        let mut items = self.survey()?.items;
        items.sort_by(|a, b| (a.used, &a.path).cmp(&(b.used, &b.path)));
        let left = items.iter().map(|item| item.size).sum();
        let mut pruned = Pruned { left, abandoned, ..Pruned::default() };
        for item in items {
            if pruned.left <= max_size || since.is_some_and(|since| item.used >= since) {
                break;
            }
            match fs::remove_file(&item.path) {
                Ok(()) => {
                    pruned.removed += 1;
                    pruned.freed += item.size;
                }
                Err(e) if e.kind() == ErrorKind::NotFound => {}
                Err(e) => return Err(Error::io(&item.path, e)),
            }
            pruned.left -= item.size;
        }
        Ok(pruned)
    }

    /// Removes a file of the survey; gone already is as good.
    ///
    /// # Errors
    /// `Io`.
    pub fn remove_item(&self, item: &Item) -> Result<()> {
        match fs::remove_file(&item.path) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(Error::io(&item.path, e)),
            _ => Ok(()),
        }
    }

    /// Removes half-written files whose writer is dead; says how many. A file whose lock can be had has no writer once it is `unlocked`
    /// old; where there are no locks, it is dead after a day. What can't be removed stays.
    pub(super) fn clear_abandoned(&self, unlocked: Duration) -> usize {
        let found = self.folder.as_deref().map(files).and_then(Result::ok).unwrap_or_default();
        let temporary = found.iter().filter(|(_, f)| f.file_name().to_string_lossy().ends_with(TEMPORARY));
        temporary.filter(|(_, f)| is_abandoned(&f.path(), unlocked) && fs::remove_file(f.path()).is_ok()).count()
    }

    /// The folders of this and of other versions' entries.
    fn layouts(&self) -> Result<Vec<PathBuf>> {
        let Some(folder) = self.folder() else { return Ok(Vec::new()) };
        let is_layout = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.strip_prefix('v').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit())) && path.is_dir()
        };
        Ok(read_folder(folder)?.iter().map(DirEntry::path).filter(is_layout).collect())
    }
}

fn is_abandoned(path: &Path, unlocked: Duration) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let age = file.metadata().and_then(|m| m.modified()).ok().and_then(|time| time.elapsed().ok()).unwrap_or_default();
    match file.try_lock() {
        Ok(()) => age >= unlocked,
        Err(TryLockError::WouldBlock) => false,
        Err(TryLockError::Error(_)) => age >= super::ABANDONED,
    }
}

/// The files of a layout's folder, each with its kind: `kind/file`.
fn files(layout: &Path) -> Result<Vec<(String, DirEntry)>> {
    let mut files = Vec::new();
    for kind in read_folder(layout)? {
        if !kind.file_type().is_ok_and(|t| t.is_dir()) {
            continue;
        }
        let name = kind.file_name().to_string_lossy().into_owned();
        let is_file = |f: &DirEntry| f.file_type().is_ok_and(|t| t.is_file());
        files.extend(read_folder(&kind.path())?.into_iter().filter(is_file).map(|f| (name.clone(), f)));
    }
    Ok(files)
}

/// What a folder holds; nothing where it has gone.
fn read_folder(folder: &Path) -> Result<Vec<DirEntry>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.collect::<std::io::Result<_>>().map_err(|e| Error::io(folder, e)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(e) => Err(Error::io(folder, e)),
    }
}
