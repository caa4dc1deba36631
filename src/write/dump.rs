//! Numbered EXR files of the stages in between, for finding out where a bake goes wrong.

use super::exr::write_image;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::patch::Ground;
use crate::post::dilate::plain;
use std::cell::Cell;
use std::path::Path;

/// Writes stages into a folder, or does nothing where none was asked for.
pub struct Dump<'a> {
    folder: Option<&'a Path>,
    number: Cell<u32>,
}

impl<'a> Dump<'a> {
    /// Dumps into `folder`, which is made where it is missing.
    pub fn new(folder: Option<&'a Path>) -> Self {
        Self { folder, number: Cell::new(1) }
    }

    /// Writes a value of each patch as `<number>_<name>_<page>.exr`, empty texels black.
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn patches(&self, name: &str, ground: &Ground, value: impl Fn(usize) -> Rgb) -> Result<()> {
        let Some(folder) = self.folder else { return Ok(()) };
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let number = self.number.replace(self.number.get() + 1);
        for (page, image) in plain(ground.atlas, ground.patches, value).iter().enumerate() {
            let path = folder.join(format!("{number:02}_{name}_{page}.exr"));
            write_image(&path, image.width, image.height, &image.rgb)?;
        }
        Ok(())
    }
}
