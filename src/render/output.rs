//! Where a picture goes: an OpenEXR file and a PNG, whole or not at all, as it grows and at the end.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sensor::Film;
use crate::write::output::Staging;
use crate::write::picture::{Tone, write_picture};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The least time from one preview to the next; and over the time that it takes to write one, so that large pictures are not
/// written over and over.
const PREVIEW: Duration = Duration::from_secs(2);
const PREVIEW_SHARE: u32 = 10;

/// Where a picture goes.
pub struct Output {
    folder: PathBuf,
    pub files: [PathBuf; 2],
    size: [u32; 2],
    exposure: f32,
    /// Passes in what was written last, when that was, and how long it took.
    last: Option<(u64, Instant, Duration)>,
}

impl Output {
    /// Makes sure that the folder can be made and written.
    ///
    /// # Errors
    /// `Invalid` where `output` is no OpenEXR file; `Io`.
    pub fn new(output: &Path, size: [u32; 2], exposure: f32) -> Result<Self> {
        let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        if output.file_name().is_none() || output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("exr")) {
            return Err(Error::invalid(output.display(), "is no .exr file; give one with -o"));
        }
        Staging::new(&folder)?;
        Ok(Self { folder, files: [output.to_path_buf(), output.with_extension("png")], size, exposure, last: None })
    }

    /// Writes what is on `film` where it is time for that, the first pass at once.
    ///
    /// # Errors
    /// As [`Output::write`].
    pub fn show(&mut self, film: &Film, taken: [u32; 2], progress: &dyn Progress) -> Result<()> {
        let is_due = |(_, at, took): (u64, Instant, Duration)| at.elapsed() >= PREVIEW.max(took * PREVIEW_SHARE);
        if self.last.is_none_or(is_due) { self.write(film, taken, progress) } else { Ok(()) }
    }

    /// Puts what is on `film`, of `taken` pixels, in the place of what was there, unless it is there already.
    ///
    /// # Errors
    /// `Io` where a file can't be written.
    pub fn write(&mut self, film: &Film, taken: [u32; 2], progress: &dyn Progress) -> Result<()> {
        if self.last.is_some_and(|(passes, ..)| passes == film.passes()) {
            return Ok(());
        }
        let begun = Instant::now();
        let rgb = spread(film.mean(), taken, self.size);
        let mut staging = Staging::new(&self.folder)?;
        let mut place = |file: &PathBuf| staging.path(file.file_name().unwrap_or_default());
        let (exr, png) = (place(&self.files[0])?, place(&self.files[1])?);
        write_picture(&exr, &png, self.size, &rgb, Tone::of(&rgb, self.exposure))?;
        staging.commit()?;
        progress.keeps(&format!(
            "the picture so far, of {} sample(s) a pixel, is {}",
            film.passes(),
            self.files[0].display()
        ));
        self.last = Some((film.passes(), Instant::now(), begun.elapsed()));
        Ok(())
    }
}

/// A picture of `from` pixels in `to` pixels: each shows the one that its middle lies in.
fn spread(rgb: Vec<Rgb>, from: [u32; 2], to: [u32; 2]) -> Vec<Rgb> {
    if from == to {
        return rgb;
    }
    let at =
        |k: u32, axis: usize| ((2 * u64::from(k) + 1) * u64::from(from[axis]) / (2 * u64::from(to[axis]))) as usize;
    let row = |y: u32| (0..to[0]).map(move |x| (x, y));
    (0..to[1]).flat_map(row).map(|(x, y)| rgb[at(y, 1) * from[0] as usize + at(x, 0)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_spread_over_their_pixels() {
        let rgb = [1.0, 2.0].map(Rgb::splat).to_vec();
        let spread = spread(rgb, [2, 1], [3, 2]);
        assert_eq!(spread.iter().map(|c| c.x).collect::<Vec<_>>(), [1.0, 2.0, 2.0, 1.0, 2.0, 2.0]);
    }
}
