//! Pages of a solution as it grows: an EXR and a small PNG of each, so that one can watch a scene light up.

use super::exr::{PageHeader, write_page};
use crate::color::{Rgb, luminance};
use crate::error::{Error, Result};
use crate::light::{Direct, Lit};
use crate::post::dilate::{Finish, finish};
use crate::post::{PageImage, Quantity};
use std::path::Path;

/// Longest side of a PNG [pixels].
const SIDE: u32 = 512;

/// The sRGB-linear value that the scene's mean comes to, about, once all light is there.
const MEAN_LEVEL: f32 = 0.35;

/// Makes the folder, and takes the pages of an earlier run out of it.
///
/// # Errors
/// `Io` naming the folder or file.
pub fn clear(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for entry in std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))? {
        let path = entry.map_err(|e| Error::io(folder, e))?.path();
        if is_ours(&path) {
            std::fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        }
    }
    Ok(())
}

/// True for `<six or more digits>_<page>.exr` and `.png`.
fn is_ours(path: &Path) -> bool {
    let is_picture = path.extension().is_some_and(|e| e == "exr" || e == "png");
    let stem = path.file_stem().and_then(|s| s.to_str()).and_then(|s| s.split_once('_'));
    let is_number = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    is_picture && stem.is_some_and(|(step, page)| step.len() >= 6 && is_number(step) && is_number(page))
}

/// A folder that pages are written into, `<iteration>_<page>.exr` and `.png`.
pub struct WatchFolder<'a> {
    folder: &'a Path,
    quantity: Quantity,
    /// Factor on page values, the same for all PNGs.
    exposure: f32,
}

impl<'a> WatchFolder<'a> {
    /// The exposure of the PNGs follows from the direct light of the scene and its mean albedo.
    pub fn new(folder: &'a Path, lit: &Lit, direct: &Direct, quantity: Quantity) -> Self {
        let (mut value, mut reflected, mut whole) = (0.0f64, 0.0f64, 0.0f64);
        for (i, area) in lit.exposure.area.iter().enumerate() {
            let area = f64::from(*area);
            value += area * f64::from(luminance(quantity.of(direct.shown[i], lit.reflectance.0[i])));
            reflected += area * f64::from(luminance(lit.reflectance.0[i]));
            whole += area;
        }
        let mean = value / whole.max(f64::MIN_POSITIVE) / (1.0 - reflected / whole.max(f64::MIN_POSITIVE));
        let exposure = if mean > 0.0 { MEAN_LEVEL / mean as f32 } else { 1.0 };
        Self { folder, quantity, exposure }
    }

    /// Writes pages of `irradiance` by patch [lx].
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn show(&self, iteration: u64, lit: &Lit, irradiance: impl Fn(usize) -> Rgb) -> Result<()> {
        let irradiance: Vec<Rgb> = (0..lit.ground.patches.len()).map(irradiance).collect();
        let pages = finish(&Finish::plain(*lit), &irradiance, self.quantity).0.pages;
        for (page, image) in pages.iter().enumerate().take(lit.ground.atlas.shown_pages) {
            let name = |extension: &str| self.folder.join(format!("{iteration:06}_{page}.{extension}"));
            let header = PageHeader {
                quantity: self.quantity,
                page: page as u32,
                density: lit.ground.atlas.density,
                scene: "",
                directional: Default::default(),
            };
            write_page(&name("exr"), image, &[], &header, true)?;
            self.write_png(&name("png"), image)?;
        }
        Ok(())
    }

    fn write_png(&self, path: &Path, page: &PageImage) -> Result<()> {
        let byte = |v: f32| {
            let v = (v * self.exposure).clamp(0.0, 1.0);
            let srgb = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
            (255.0 * srgb + 0.5) as u8
        };
        let texels = page.rgb.iter().flat_map(|c| c.to_array().map(byte)).collect();
        let whole = image::RgbImage::from_raw(page.width, page.height, texels).expect("a page holds all its texels");
        let shrink = f64::from(SIDE) / f64::from(page.width.max(page.height));
        let side = |n: u32| ((f64::from(n) * shrink).round() as u32).max(1);
        let small =
            if shrink < 1.0 { image::imageops::thumbnail(&whole, side(page.width), side(page.height)) } else { whole };
        small.save(path).map_err(|e| Error::io(path, std::io::Error::other(e)))
    }
}
