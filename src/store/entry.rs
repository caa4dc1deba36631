//! Entries that were read.

use super::format;
use super::key::Key;
use super::map::Map;
use crate::error::{Error, Result};
use bytemuck::AnyBitPattern;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// An entry, checked and mapped into memory. It stays as it is when it is removed from the store.
#[derive(Debug)]
pub struct Entry {
    path: PathBuf,
    map: Map,
    sections: Vec<Range<usize>>,
}

/// Why there is no entry.
pub(super) enum Fault {
    Missing,
    Damaged(&'static str),
    Io(io::Error),
}

impl Entry {
    /// Maps the file `path` and checks all of it.
    pub(super) fn open(path: &Path, kind: &str, key: Key) -> std::result::Result<Self, Fault> {
        let io = |e: io::Error| if e.kind() == ErrorKind::NotFound { Fault::Missing } else { Fault::Io(e) };
        let file = File::open(path).map_err(io)?;
        // An empty file can't be mapped on every system.
        if file.metadata().map_err(io)?.len() == 0 {
            return Err(Fault::Damaged("it is empty"));
        }
        let map = Map::new(&file).map_err(io)?;
        let sections = format::check(&map, kind, key).map_err(Fault::Damaged)?;
        Ok(Self { path: path.to_path_buf(), map, sections })
    }

    /// Sections in it.
    pub fn section_count(&self) -> usize {
        self.sections.len()
    }

    /// Section `k`, from a multiple of 64 bytes on; empty where there is none.
    pub fn section(&self, k: usize) -> &[u8] {
        self.sections.get(k).map_or(&[], |range| &self.map[range.clone()])
    }

    /// Section `k` as values.
    ///
    /// # Errors
    /// `Invalid` where there is no such section, or it doesn't hold a whole number of them.
    pub fn slice<T: AnyBitPattern>(&self, k: usize) -> Result<&[T]> {
        let fault = |what: &str| Error::invalid(self.path.display(), format!("section {k} {what}; delete this file"));
        if k >= self.sections.len() {
            return Err(fault("is missing"));
        }
        bytemuck::try_cast_slice(self.section(k)).map_err(|_| fault("doesn't hold what it should"))
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
