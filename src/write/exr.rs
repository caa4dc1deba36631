//! OpenEXR pages: linear Rec.709, half float by default, ZIP.
//!
//! Equal inputs give equal bytes: no date, path or thread count is written, the blocks stand in scan line order, and the
//! header's attributes are sorted by name (the exr crate keeps custom ones in a hash map, whose order changes from run to
//! run).

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::post::{Channels, Directional, Lightmap, PageImage, Quantity};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, LineOrder, Text, Vec2, WritableImage,
    attribute::{AttributeValue, Chromaticities},
    f16,
};
use exr::{compression::Compression, error::Error as ExrError};
use std::io::Cursor;
use std::path::Path;

/// The largest finite half float.
const HALF_MAX: f32 = 65504.0;

/// True where page `number` of `lightmap`, or a layer of it, holds a value that half floats can't.
pub fn exceeds_half(lightmap: &Lightmap, number: usize) -> bool {
    let layers = lightmap.layers.iter().map(|layer| &layer.pages[number]);
    let mut values = std::iter::once(&lightmap.pages[number].rgb).chain(layers).flatten();
    values.any(|c| c.to_array().into_iter().any(|v| v.is_finite() && v.abs() > HALF_MAX))
}

/// What a page's header says besides the size.
#[derive(Clone, Copy, Debug)]
pub struct PageHeader<'a> {
    /// What the texels hold; `lumel:quantity` and `lumel:unit`.
    pub quantity: Quantity,
    /// Number of the page, from 0; `lumel:page`.
    pub page: u32,
    /// Texels per metre; `lumel:texelDensity`.
    pub density: f32,
    /// File name of the scene, without folders; `lumel:scene`.
    pub scene: &'a str,
    /// How the layers about directions are read; `lumel:directional`, absent where there are none.
    pub directional: Directional,
}

/// A layer of a page.
#[derive(Clone, Copy, Debug)]
pub struct PageLayer<'a> {
    pub name: &'a str,
    pub channels: Channels,
    pub unit: &'a str,
    /// As [`PageImage::rgb`].
    pub values: &'a [Rgb],
}

/// Writes a page with the channels R, G, B and A (coverage, 0..=1), and `<layer>.R`, `.G` and `.B`, or `.Y`, or `.X`, `.Y` and `.Z` for
/// each of `layers`: half floats, or 32-bit ones with `float`. With layers, the header's `lumel:layers` is a JSON list of
/// `{"name", "channels", "unit"}`.
///
/// Returns how many texels had a value that half floats can't hold: beyond +-65504 (written as that) or NaN (written as
/// 0). Always 0 with `float`, which writes the values as they are.
///
/// # Errors
/// `Invalid` where the image's size and data disagree, `Io` where the file can't be written.
pub fn write_page(
    path: &Path,
    page: &PageImage,
    layers: &[PageLayer],
    header: &PageHeader,
    float: bool,
) -> Result<usize> {
    let texels = page.width as usize * page.height as usize;
    let is_whole = |rgb: &[Rgb]| rgb.len() == texels;
    if !is_whole(&page.rgb) || page.coverage.len() != texels || !layers.iter().all(|layer| is_whole(layer.values)) {
        return Err(Error::invalid(path.display(), "the page's size and its data disagree"));
    }
    let clamped = if float { 0 } else { page.rgb.iter().filter(|c| c.to_array().iter().any(|v| half(*v).1)).count() };
    let samples = if float { FlatSamples::F32 } else { half_samples };
    let mut channels = channels_of("", Channels::Rgb, &page.rgb, samples);
    channels.extend(layers.iter().flat_map(|layer| channels_of(layer.name, layer.channels, layer.values, samples)));
    channels.push(AnyChannel::new("A", samples(page.coverage.clone())));
    // UTF-8 as it stands: OpenEXR's own strings are bytes, and file names are UTF-8 nearly everywhere.
    let text = |s: &str| AttributeValue::Text(Text::from_slice_unchecked(s.as_bytes()));
    let mut attributes = vec![
        ("lumel:quantity", text(header.quantity.name())),
        ("lumel:unit", text(header.quantity.unit())),
        ("lumel:version", text(env!("CARGO_PKG_VERSION"))),
        ("lumel:page", AttributeValue::I32(i32::try_from(header.page).unwrap_or(i32::MAX))),
        ("lumel:texelDensity", AttributeValue::F32(header.density)),
        ("lumel:scene", text(header.scene)),
    ];
    let list = |layer: &PageLayer| {
        let PageLayer { name, channels, unit, .. } = layer;
        serde_json::json!({ "name": name, "channels": channel_names(name, *channels), "unit": unit })
    };
    if !layers.is_empty() {
        let list: Vec<_> = layers.iter().map(list).collect();
        attributes.push(("lumel:layers", text(&serde_json::Value::from(list).to_string())));
    }
    attributes.extend(header.directional.formula().map(|formula| ("lumel:directional", text(formula))));
    write(path, page.width, page.height, channels, &attributes)?;
    Ok(clamped)
}

/// Writes a 32-bit picture with the channels R, G and B, row 0 at the top, for dumps of stages.
///
/// # Errors
/// `Invalid` where `rgb` doesn't hold `width * height` texels, `Io` where the file can't be written.
pub fn write_image(path: &Path, width: u32, height: u32, rgb: &[Rgb]) -> Result<()> {
    write_layers(path, width, height, &[("", rgb)])
}

/// Writes 32-bit layers of one size as the channels `<layer>.R`, `.G` and `.B`; a layer without a name gives plain R, G
/// and B.
///
/// # Errors
/// `Invalid` where a layer doesn't hold `width * height` texels, `Io` where the file can't be written.
pub fn write_layers(path: &Path, width: u32, height: u32, layers: &[(&str, &[Rgb])]) -> Result<()> {
    let texels = width as usize * height as usize;
    if layers.iter().any(|(_, rgb)| rgb.len() != texels) {
        return Err(Error::invalid(path.display(), "the picture's size and its data disagree"));
    }
    let channels =
        layers.iter().flat_map(|(name, rgb)| channels_of(name, Channels::Rgb, rgb, FlatSamples::F32)).collect();
    write(path, width, height, channels, &[("lumel:version", AttributeValue::Text(env!("CARGO_PKG_VERSION").into()))])
}

/// The names of the channels of a layer; of one without a name, those alone.
pub fn channel_names(layer: &str, channels: Channels) -> Vec<String> {
    let name = |channel: &&str| if layer.is_empty() { channel.to_string() } else { format!("{layer}.{channel}") };
    channels.names().iter().map(name).collect()
}

/// The channels of `values` under the layer name `layer`.
fn channels_of(
    layer: &str,
    channels: Channels,
    values: &[Rgb],
    samples: impl Fn(Vec<f32>) -> FlatSamples,
) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |(i, name): (usize, String)| {
        AnyChannel::new(Text::from(name.as_str()), samples(values.iter().map(|v| v[i]).collect()))
    };
    channel_names(layer, channels).into_iter().enumerate().map(channel).collect()
}

fn half_samples(values: Vec<f32>) -> FlatSamples {
    FlatSamples::F16(values.into_iter().map(|v| half(v).0).collect())
}

/// The nearest half float, and whether `v` lies outside what half floats hold.
fn half(v: f32) -> (f16, bool) {
    if v.is_nan() {
        return (f16::ZERO, true);
    }
    (f16::from_f32(v.clamp(-HALF_MAX, HALF_MAX)), v.abs() > HALF_MAX)
}

fn write(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<AnyChannel<FlatSamples>>,
    attributes: &[(&str, AttributeValue)],
) -> Result<()> {
    if width == 0 || height == 0 || channels.is_empty() {
        return Err(Error::invalid(path.display(), "an empty picture can't be written"));
    }
    let size = Vec2(width as usize, height as usize);
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let own = LayerAttributes {
        other: attributes.iter().map(|(name, value)| (Text::from(*name), value.clone())).collect(),
        ..LayerAttributes::default()
    };
    let layer = Layer::new(size, own, encoding, AnyChannels::sort(channels.into_iter().collect()));
    let mut shared = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    // Rec.709 primaries and D65, as ITU-R BT.709 states them.
    shared.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    });
    let mut bytes = Cursor::new(Vec::new());
    let image = Image::empty(shared).with_layer(layer);
    image.write().to_buffered(&mut bytes).map_err(|e| exr_error(path, e))?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes)
        .ok_or_else(|| Error::invalid(path.display(), "the EXR header could not be put in order"))?;
    std::fs::write(path, bytes).map_err(|e| Error::io(path, e))
}

fn exr_error(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(source) => Error::io(path, source),
        other => Error::invalid(path.display(), other),
    }
}

/// Sorts the attributes of a single-part file by name. The header's length stays, so the chunk offsets behind it hold.
fn sort_attributes(bytes: &mut [u8]) -> Option<()> {
    const START: usize = 8; // magic number and version
    let text_end = |bytes: &[u8], from: usize| bytes.get(from..)?.iter().position(|b| *b == 0).map(|n| from + n);
    let mut attributes = Vec::new();
    let mut at = START;
    while *bytes.get(at)? != 0 {
        let name = text_end(bytes, at)?;
        let kind = text_end(bytes, name + 1)?;
        let length = bytes.get(kind + 1..kind + 5)?.try_into().map(u32::from_le_bytes).ok()? as usize;
        let end = kind + 5 + length;
        attributes.push((bytes[at..name].to_vec(), bytes.get(at..end)?.to_vec()));
        at = end;
    }
    attributes.sort();
    let sorted = attributes.into_iter().flat_map(|(_, bytes)| bytes).collect::<Vec<_>>();
    bytes[START..at].copy_from_slice(&sorted);
    Some(())
}
