//! Files mapped into memory.
//!
//! An entry of 200 MB is there, mapped and checked by its hash, in 14 ms on two cores; `fs::read` alone takes 105 ms, and hashing what it
//! read another 12 (both from the system's cache; `tests/store.rs`, `time_reading`).
#![allow(unsafe_code)]

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::ops::Deref;

/// The bytes of a file, from a multiple of the page's size on.
#[derive(Debug)]
pub struct Map(Mmap);

impl Map {
    /// Maps a file that nobody changes in place.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn new(file: &File) -> io::Result<Self> {
        // SAFETY: the bytes behind a shared slice must not change, and a file that is cut while it is mapped ends the process. Files of
        // the store are written under another name, synced and renamed, and never changed or cut afterwards: a new version is another
        // file of the same name, and a removed one stays until the last map of it is gone. Whoever edits a store by hand while
        // a bake runs breaks this, as with the program's own file.
        unsafe { Mmap::map(file) }.map(Self)
    }
}

impl Deref for Map {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}
