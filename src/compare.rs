//! How far one baked page is from another: error figures over the texels that both cover, and an error image.
//!
//! With `a` the luminance of a texel of the page to judge, `b` that of the page to trust, `mean` the mean of `b`:
//!
//! ```text
//! bias      = sum(a - b) / sum(b)
//! rel_rmse  = sqrt(mean((a - b)^2)) / mean
//! relative  = |a - b| / max(b, 0.05 mean), of which p50, p95, p99 and max are given
//! ```
//!
//! The floor of 5 % of the mean keeps black corners, where any noise is a large share, from ruling the percentiles.
//! Cost: two pages in memory and one sort of their texels.

use crate::color::{Rgb, luminance};
use crate::error::{Error, Result};
use crate::post::Channels;
use crate::write::exr::channel_names;
use exr::prelude::attribute::AttributeValue;
use exr::prelude::{FlatImage, ReadChannels, ReadLayers};
use serde::Serialize;
use std::path::Path;

/// Share of the mean below which a texel's error is measured against the floor.
const FLOOR: f64 = 0.05;

/// A page as it was read; row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    pub width: usize,
    pub height: usize,
    /// Texel values in the page's quantity, row by row.
    pub rgb: Vec<Rgb>,
    /// The share of the texel that a surface covers, 0..=1; 1 where the file has no alpha.
    pub coverage: Vec<f32>,
}

/// Error figures; all but the counts are ratios (0.01 is 1 %).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Size of both pages [texels].
    pub width: usize,
    pub height: usize,
    /// Texels that both cover: those that the figures are over.
    pub texels: usize,
    /// Texels that the page to judge covers and the other doesn't.
    pub only_a: usize,
    /// Texels that the page to trust covers and the other doesn't.
    pub only_b: usize,
    /// Texels covered by both that are infinite or NaN in one of them; no figure counts them.
    pub not_finite: usize,
    /// Mean luminance of each page, in its own quantity.
    pub mean_a: f64,
    pub mean_b: f64,
    pub bias: f64,
    pub rel_rmse: f64,
    /// The same without the worst 1 % of texels.
    pub rel_rmse_trim: f64,
    pub p50: f64,
    pub p95: f64,
    pub p99: f64,
    pub max: f64,
    /// The texel (x, y from the top left) at which `max` was found.
    pub max_at: [usize; 2],
}

/// Compares page `a` with the page `b` that is trusted.
///
/// # Errors
/// `Invalid` where the sizes differ or no texel is covered by both; `place` is for its message.
pub fn compare(a: &Page, b: &Page, place: &str) -> Result<Comparison> {
    same_size(a, b, place)?;
    let (mut only_a, mut only_b, mut not_finite) = (0, 0, 0);
    let mut texels = Vec::new();
    for i in 0..a.rgb.len() {
        match (a.coverage[i] > 0.0, b.coverage[i] > 0.0) {
            (true, true) if a.rgb[i].is_finite() && b.rgb[i].is_finite() => texels.push(i),
            (true, true) => not_finite += 1,
            (true, false) => only_a += 1,
            (false, true) => only_b += 1,
            (false, false) => {}
        }
    }
    if texels.is_empty() {
        return Err(Error::invalid(place, "no texel is covered by both pages; they show different charts"));
    }
    let count = texels.len() as f64;
    let value = |page: &Page, i: usize| f64::from(luminance(page.rgb[i]));
    let mean_a = texels.iter().map(|&i| value(a, i)).sum::<f64>() / count;
    let mean_b = texels.iter().map(|&i| value(b, i)).sum::<f64>() / count;
    let mut squares: Vec<f64> = texels.iter().map(|&i| (value(a, i) - value(b, i)).powi(2)).collect();
    let rms = (squares.iter().sum::<f64>() / count).sqrt();
    squares.sort_by(f64::total_cmp);
    let kept = &squares[..(squares.len() * 99).div_ceil(100)];
    let trimmed = (kept.iter().sum::<f64>() / kept.len() as f64).sqrt();

    let mut relative: Vec<(f64, usize)> =
        texels.iter().map(|&i| (relative_error(value(a, i), value(b, i), mean_b).abs(), i)).collect();
    relative.sort_by(|x, y| x.0.total_cmp(&y.0).then(y.1.cmp(&x.1)));
    let worst = relative[relative.len() - 1];
    Ok(Comparison {
        width: a.width,
        height: a.height,
        texels: texels.len(),
        only_a,
        only_b,
        not_finite,
        mean_a,
        mean_b,
        bias: ratio(mean_a - mean_b, mean_b),
        rel_rmse: ratio(rms, mean_b),
        rel_rmse_trim: ratio(trimmed, mean_b),
        p50: percentile(&relative, 0.50),
        p95: percentile(&relative, 0.95),
        p99: percentile(&relative, 0.99),
        max: worst.0,
        max_at: [worst.1 % a.width, worst.1 / a.width],
    })
}

/// The error image of [`compare`]'s relative error, one pixel a texel, false colours: white where equal, towards red where
/// `a` is brighter, towards blue where it is darker, in full colour from `range` on (a ratio above 0; 0.2 is 20 %). Black
/// where neither page has a surface, magenta where only one has, yellow where a value is infinite or NaN.
///
/// # Errors
/// As [`compare`]; `Invalid` where `range` is not above 0.
pub fn error_image(a: &Page, b: &Page, range: f64, place: &str) -> Result<image::RgbImage> {
    if !(range.is_finite() && range > 0.0) {
        return Err(Error::invalid("range", format!("{range} is out of range; it must be above 0")));
    }
    let mean = compare(a, b, place)?.mean_b;
    let mut picture = image::RgbImage::new(a.width as u32, a.height as u32);
    for (i, pixel) in picture.pixels_mut().enumerate() {
        pixel.0 = match (a.coverage[i] > 0.0, b.coverage[i] > 0.0) {
            (false, false) => [0, 0, 0],
            (true, true) if !(a.rgb[i].is_finite() && b.rgb[i].is_finite()) => [255, 255, 0],
            (true, true) => {
                let (a, b) = (f64::from(luminance(a.rgb[i])), f64::from(luminance(b.rgb[i])));
                false_color(relative_error(a, b, mean) / range)
            }
            _ => [255, 0, 255],
        };
    }
    Ok(picture)
}

/// Writes an error image as PNG; the file appears complete or not at all.
///
/// # Errors
/// `Io` naming the file.
pub fn write_png(picture: &image::RgbImage, path: &Path) -> Result<()> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).map_err(|e| Error::invalid(path.display(), e))?;
    let mut partial = path.as_os_str().to_owned();
    partial.push(".lumel-partial");
    let partial = Path::new(&partial);
    std::fs::write(partial, bytes.into_inner()).and_then(|()| std::fs::rename(partial, path)).map_err(|e| {
        // Whether there was anything to remove doesn't matter.
        let _ = std::fs::remove_file(partial);
        Error::io(path, e)
    })
}

/// All channels of a file.
fn read_image(path: &Path) -> Result<FlatImage> {
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    let builder = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    builder.all_attributes().from_buffered(std::io::BufReader::new(file)).map_err(|e| match e {
        exr::error::Error::Io(e) => Error::io(path, e),
        e => Error::invalid(path.display(), e),
    })
}

/// Reads a page: the R, G, B and, where there is one, A channel of the first layer that has the colours, half or float.
///
/// # Errors
/// `Io` where the file can't be read, `Invalid` where it is no EXR or holds no colours.
pub fn read_page(path: &Path) -> Result<Page> {
    let image = read_image(path)?;
    // Channels of a layer that lives in its names: `R`, or `direct.R`. The plain ones come first.
    let mut found = None;
    for layer in &image.layer_data {
        let channels = &layer.channel_data.list;
        let prefixes = channels.iter().filter_map(|c| c.name.to_string().strip_suffix('R').map(str::to_string));
        let prefixes = prefixes.filter(|p| p.is_empty() || p.ends_with('.'));
        for prefix in prefixes {
            let channel = |letter: &str| channels.iter().find(|c| c.name.to_string() == format!("{prefix}{letter}"));
            let Some(rgb) = channel("R").zip(channel("G")).zip(channel("B")) else { continue };
            let plain = prefix.is_empty();
            if found.is_none() || plain {
                found = Some((layer.size, rgb, channel("A")));
            }
            if plain {
                break;
            }
        }
        if found.is_some() {
            break;
        }
    }
    let Some((size, ((r, g), b), alpha)) = found else {
        return Err(Error::invalid(path.display(), "holds no channels R, G and B"));
    };
    let count = size.width() * size.height();
    if [Some(r), Some(g), Some(b), alpha].into_iter().flatten().any(|c| c.sample_data.len() != count) {
        return Err(Error::unsupported(path.display(), "has subsampled channels; save it as RGB"));
    }
    let rgb = r.sample_data.values_as_f32().zip(g.sample_data.values_as_f32()).zip(b.sample_data.values_as_f32());
    Ok(Page {
        width: size.width(),
        height: size.height(),
        rgb: rgb.map(|((r, g), b)| Rgb::new(r, g, b)).collect(),
        coverage: alpha.map_or_else(|| vec![1.0; count], |a| a.sample_data.values_as_f32().collect()),
    })
}

/// A layer of a page as it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadLayer {
    pub name: String,
    pub channels: Channels,
    /// As [`crate::post::Layer::unit`].
    pub unit: &'static str,
    /// As [`Page::rgb`].
    pub values: Vec<Rgb>,
}

/// Reads a page with the layers that its header tells of.
///
/// # Errors
/// As [`read_page`]; `Invalid` where the header tells of layers that aren't there.
pub fn read_layers(path: &Path) -> Result<(Page, Vec<ReadLayer>)> {
    let page = read_page(path)?;
    let image = read_image(path)?;
    let Some(layer) = image.layer_data.first() else { return Ok((page, Vec::new())) };
    let told = layer.attributes.other.iter().find(|(name, _)| *name == "lumel:layers");
    let Some((_, AttributeValue::Text(told))) = told else { return Ok((page, Vec::new())) };
    let wrong = || Error::invalid(path.display(), "its header tells of layers that it doesn't hold; bake anew");
    let told: serde_json::Value = serde_json::from_str(&told.to_string()).map_err(|_| wrong())?;
    let count = page.rgb.len();
    let values = |name: &str| {
        let channel = layer.channel_data.list.iter().find(|c| c.name.to_string() == name)?;
        (channel.sample_data.len() == count).then(|| channel.sample_data.values_as_f32().collect::<Vec<f32>>())
    };
    let read = |told: &serde_json::Value| {
        let name = told["name"].as_str()?;
        let names: Vec<&str> = told["channels"].as_array()?.iter().map(|c| c.as_str()).collect::<Option<_>>()?;
        let is = |channels: &Channels| channel_names(name, *channels) == names;
        let channels = [Channels::Rgb, Channels::Y, Channels::Xyz].into_iter().find(is)?;
        let unit = ["nit", "lx", "lm/m^2", "1"].into_iter().find(|unit| told["unit"].as_str() == Some(unit))?;
        let each: Vec<Vec<f32>> = names.iter().map(|name| values(name)).collect::<Option<_>>()?;
        let value = |i: usize| Rgb::from_array(std::array::from_fn(|k| each[k.min(each.len() - 1)][i]));
        Some(ReadLayer { name: name.to_owned(), channels, unit, values: (0..count).map(value).collect() })
    };
    let layers = told.as_array().into_iter().flatten().map(read).collect::<Option<_>>().ok_or_else(wrong)?;
    Ok((page, layers))
}

fn same_size(a: &Page, b: &Page, place: &str) -> Result<()> {
    if (a.width, a.height) == (b.width, b.height) {
        return Ok(());
    }
    let sizes = format!("{} x {} and {} x {}", a.width, a.height, b.width, b.height);
    Err(Error::invalid(place, format!("the pages are {sizes} texels; only equal sizes can be compared")))
}

/// Signed error of `a` against `b`, relative to `b` or the floor.
fn relative_error(a: f64, b: f64, mean: f64) -> f64 {
    ratio(a - b, b.max(FLOOR * mean))
}

/// `n / d`, and 0 / 0 = 0: two black pages agree.
fn ratio(n: f64, d: f64) -> f64 {
    if n == 0.0 { 0.0 } else { n / d }
}

/// The value below which the share `p` of the sorted values lies, linear between neighbours (as numpy has it).
fn percentile(sorted: &[(f64, usize)], p: f64) -> f64 {
    let at = p * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize].0, sorted[at.ceil() as usize].0);
    // Not by a weighted sum alone: infinity times a weight of 0 is no number.
    if low == high { low } else { low + (high - low) * at.fract() }
}

/// -1 blue, 0 white, 1 red; the ends are ColorBrewer's RdBu, which people who confuse red and green can read.
fn false_color(t: f64) -> [u8; 3] {
    let end = if t < 0.0 { [33.0, 102.0, 172.0] } else { [178.0, 24.0, 43.0] };
    let t = t.abs().min(1.0);
    end.map(|e: f64| (255.0 + (e - 255.0) * t).round() as u8)
}
