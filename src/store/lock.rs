//! One process at a time in an output folder.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Holds a folder for this process, until it is dropped or the process ends in whatever way: the lock is the operating system's.
///
/// The file `.lumel.lock` says who holds it. On a file system that has no locks it holds nothing.
#[derive(Debug)]
pub struct FolderLock {
    path: PathBuf,
    file: File,
}

impl FolderLock {
    /// The file that is locked.
    pub const NAME: &str = ".lumel.lock";

    /// Takes the lock of `folder`, which must be there, without waiting.
    ///
    /// # Errors
    /// `Invalid` where another holds it, with its process and since when; `Io`.
    pub fn acquire(folder: &Path) -> Result<Self> {
        let path = folder.join(Self::NAME);
        loop {
            let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let mut file = open.map_err(|e| Error::io(&path, e))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => {}
                Err(TryLockError::Error(e)) => return Err(Error::io(&path, e)),
                Err(TryLockError::WouldBlock) => return Err(held(folder, &mut file)),
            }
            // Its last holder may have removed it between our opening and locking it: then it locks nothing.
            if is_at(&file, &path) {
                say_holder(&mut file).map_err(|e| Error::io(&path, e))?;
                return Ok(Self { path, file });
            }
        }
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // While it is locked: who opened it meanwhile sees that it isn't the folder's any more. Elsewhere a file in use keeps its name.
        if cfg!(unix) && is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
    }
}

/// Writes which process this is.
fn say_holder(file: &mut File) -> std::io::Result<()> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let text = format!("process {}, since {}\n", std::process::id(), utc(now));
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(text.as_bytes())
}

/// The error where another process holds the folder. Windows lets nobody else read a locked file: then it isn't named.
fn held(folder: &Path, file: &mut File) -> Error {
    const MOST: u64 = 200;
    let mut text = String::new();
    let known = file.take(MOST).read_to_string(&mut text).is_ok() && text.starts_with("process ");
    let holder = if known { format!("another bake ({})", text.trim()) } else { "another bake".to_string() };
    let message =
        format!("is being written by {holder}; wait until it is done, end it, or choose another output folder");
    Error::invalid(folder.display(), message)
}

/// True where `path` is the name of `file`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |m: fs::Metadata| (m.dev(), m.ino());
    matches!((file.metadata().map(id), fs::metadata(path).map(id)), (Ok(a), Ok(b)) if a == b)
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

/// Seconds since 1970 as `2026-01-31 23:59:59 UTC`.
fn utc(seconds: u64) -> String {
    let (days, time) = (seconds / 86_400, seconds % 86_400);
    // Civil date by eras of 400 years that start in March (Howard Hinnant, "chrono-Compatible Low-Level Date Algorithms").
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (time / 3600, time / 60 % 60, time % 60);
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, date) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_709_251_199, "2024-02-29 23:59:59 UTC"),
            (4_102_444_800, "2100-01-01 00:00:00 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(utc(seconds), date);
        }
    }
}
