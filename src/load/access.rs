//! Which files a scene may pull in, and how much memory their contents may take.
//!
//! A scene may come from anywhere. What it names must be a regular file (a pipe or a device never ends), of a size that
//! is read at once, and, symbolic links resolved, lie in the folder that it is confined to: that of
//! [`LoadOptions::confine`], or else, for glTF, the scene's own. A USD stage refers to layers in other folders by
//! design, so it is confined only where that is asked for. Pictures are measured before they are decoded.
//!
//! The check and the reading that follows are two steps: whoever can swap a link between them can escape. Confine to a
//! folder that no one else writes to.

use super::LoadOptions;
use super::image::{self, ColorSpace};
use crate::error::{Error, Result};
use crate::scene::Texture;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest file that is read [bytes].
pub const MAX_FILE_BYTES: u64 = 8 << 30;

/// What a scene may pull in. Clones count together.
#[derive(Clone, Debug)]
pub struct Access {
    /// Canonical.
    folder: Option<PathBuf>,
    /// The folder was asked for: what lies outside is an error, not a warning.
    is_strict: bool,
    /// Texels of a picture, at most.
    most_texels: u64,
    /// Memory of all pictures, at most [bytes].
    most_bytes: u64,
    tally: Arc<Tally>,
}

#[derive(Debug, Default)]
struct Tally {
    /// Memory of the pictures read so far [bytes].
    bytes: AtomicU64,
    /// The first refusal that ends the reading.
    refusal: Mutex<Option<Error>>,
}

impl Default for Access {
    /// Anything of any size that can be read.
    fn default() -> Self {
        Self {
            folder: None,
            is_strict: false,
            most_texels: image::MOST_TEXELS,
            most_bytes: u64::MAX,
            tally: Arc::default(),
        }
    }
}

impl Access {
    /// The access of the scene file `scene`, which is checked itself. `in_own_folder`: without a folder to confine it
    /// to, the scene keeps to its own.
    ///
    /// # Errors
    /// `Io` where a folder can't be resolved, `Invalid` where the scene lies outside of what it is confined to.
    pub fn of_scene(scene: &Path, options: &LoadOptions, in_own_folder: bool) -> Result<Self> {
        let own = || scene.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = options.confine.as_deref().or_else(|| in_own_folder.then(own));
        let folder = folder.map(|f| f.canonicalize().map_err(|e| Error::io(f, e))).transpose()?;
        let access = Self {
            folder,
            is_strict: options.confine.is_some(),
            most_texels: options.max_texture.unwrap_or(image::MOST_TEXELS),
            most_bytes: options.max_memory.unwrap_or(u64::MAX),
            tally: Arc::default(),
        };
        if access.is_strict {
            access.check(scene)?;
        }
        Ok(access)
    }

    /// Refuses a file that can't be read to its end, or lies outside, and gives its size [bytes].
    ///
    /// # Errors
    /// `Io` where it isn't there, `Invalid` naming it otherwise.
    pub fn check(&self, file: &Path) -> Result<u64> {
        let found = std::fs::metadata(file).map_err(|e| Error::io(file, e))?;
        if !found.is_file() {
            return Err(Error::invalid(file.display(), "is no regular file; put a copy of its contents in its place"));
        }
        if found.len() > MAX_FILE_BYTES {
            let message = format!("has {} bytes; files of up to {MAX_FILE_BYTES} can be read", found.len());
            return Err(Error::invalid(file.display(), message));
        }
        if let Some(folder) = &self.folder {
            let place = file.canonicalize().map_err(|e| Error::io(file, e))?;
            if !place.starts_with(folder) {
                return Err(self.refuse(Error::invalid(
                    file.display(),
                    format!(
                        "lies outside of {}; copy it there, or name a folder that holds both (--confine DIR)",
                        folder.display()
                    ),
                )));
            }
        }
        Ok(found.len())
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// As [`Access::check`].
    pub fn read(&self, file: &Path) -> Result<Vec<u8>> {
        self.check(file)?;
        std::fs::read(file).map_err(|e| Error::io(file, e))
    }

    /// Decodes a picture, as [`image::decode`] does, within the limits of this access.
    ///
    /// # Errors
    /// As [`image::decode`].
    pub fn decode(&self, name: &str, bytes: &[u8], space: ColorSpace) -> Result<Texture> {
        let size = image::measure(name, bytes, self.most_texels)?;
        let held = self.tally.bytes.fetch_add(size, Ordering::Relaxed).saturating_add(size);
        if held > self.most_bytes {
            let message = format!(
                "with this picture the scene's pictures take more than the {} bytes of --max-memory; make pictures smaller, or \
                 raise it",
                self.most_bytes
            );
            return Err(self.end(Error::invalid(name, message)));
        }
        image::decode(name, bytes, space)
    }

    /// What was refused so that there is no scene.
    ///
    /// # Errors
    /// The refusal.
    pub fn finish(&self) -> Result<()> {
        self.tally.refusal.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }

    /// Keeps a refusal of a place where that was asked for.
    fn refuse(&self, error: Error) -> Error {
        if self.is_strict { self.end(error) } else { error }
    }

    /// Keeps `error` for [`Access::finish`]: callers may take it for a warning.
    fn end(&self, error: Error) -> Error {
        let copy = Error::invalid("refused", &error);
        let mut refusal = self.tally.refusal.lock().unwrap_or_else(PoisonError::into_inner);
        refusal.get_or_insert(error);
        copy
    }
}
