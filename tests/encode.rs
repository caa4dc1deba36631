//! Pages in the forms of engines: what is written is read back by other decoders, within the errors that are promised.

mod files;

use files::Folder;
use image::ImageDecoder;
use lumel::color::Rgb;
use lumel::post::{PageImage, Quantity};
use lumel::write::encode::{Encoding, Header, write_page};
use std::path::Path;

/// A page of a size that no block divides: a slope over three decades of light, of three hues, with an empty corner.
fn page() -> PageImage {
    let (width, height) = (61, 27);
    let texel = |i: u32| {
        let (x, y) = (i % width, i / width);
        if x < 3 && y < 3 {
            return (Rgb::ZERO, 0.0);
        }
        let level = 10f32.powf(1.4 - 3.0 * x as f32 / width as f32);
        (Rgb::new(level, level * (0.4 + 0.02 * y as f32), level * 0.5), 1.0 - 0.5 * f32::from(u8::from(y == 26)))
    };
    let (rgb, coverage) = (0..width * height).map(texel).unzip();
    PageImage { width, height, rgb, coverage }
}

fn header(encoding: Encoding, page: &PageImage, levels: u32) -> Header {
    let largest = page.rgb.iter().map(|c| c.max_element()).fold(0.0, f32::max);
    Header { quantity: Quantity::Outgoing, scale: encoding.scale(largest), levels }
}

/// Bytes of a page's file.
fn written(name: &str, page: &PageImage, encoding: Encoding, levels: u32) -> Vec<u8> {
    let folder = Folder::new(name);
    let path = folder.0.join(format!("page.{}", encoding.suffix()));
    assert_eq!(write_page(&path, page, encoding, &header(encoding, page, levels)).unwrap(), 0);
    std::fs::read(path).unwrap()
}

/// Bias and largest relative error of the brightest channel over lit texels.
fn errors(page: &PageImage, found: &[Rgb]) -> (f64, f64) {
    assert_eq!(found.len(), page.rgb.len());
    let lit: Vec<f64> = (page.rgb.iter().zip(found))
        .filter(|(c, _)| **c != Rgb::ZERO)
        .map(|(c, f)| f64::from(f.x) / f64::from(c.x) - 1.0)
        .collect();
    let dark = page.rgb.iter().zip(found).filter(|(c, _)| **c == Rgb::ZERO);
    dark.for_each(|(_, f)| assert_eq!(*f, Rgb::ZERO));
    (lit.iter().sum::<f64>() / lit.len() as f64, lit.iter().fold(0.0, |m, e| e.abs().max(m)))
}

#[test]
fn radiance_hdr_is_what_another_decoder_reads() {
    let mut page = page();
    // Runs and single bytes, and the longest run there is.
    page.rgb[100..400].fill(Rgb::new(1.0, 0.5, 0.25));
    let bytes = written("hdr", &page, Encoding::Hdr, 1);
    assert!(bytes.starts_with(b"#?RADIANCE\n"));
    let decoder = image::codecs::hdr::HdrDecoder::new(bytes.as_slice()).unwrap();
    assert_eq!(decoder.dimensions(), (61, 27));
    let read = image::DynamicImage::from_decoder(decoder).unwrap().into_rgb32f();
    let found: Vec<Rgb> = read.pixels().map(|p| Rgb::from_array(p.0)).collect();
    let (bias, worst) = errors(&page, &found);
    assert!(bias.abs() < 2e-4 && worst < 0.004, "bias {bias}, worst {worst}");
    assert!(bytes.len() < 61 * 27 * 4, "nothing was run-length encoded");
}

#[test]
fn narrow_hdr_pages_have_plain_scan_lines() {
    let page = PageImage { width: 2, height: 2, rgb: vec![Rgb::new(0.5, 1e-3, 255.9); 4], coverage: vec![1.0; 4] };
    let bytes = written("hdr-narrow", &page, Encoding::Hdr, 1);
    let read = image::load_from_memory_with_format(&bytes, image::ImageFormat::Hdr).unwrap().into_rgb32f();
    // The mantissa rounds up to 256, which takes the next exponent.
    assert_eq!(read.get_pixel(1, 1).0[2], 256.0);
}

/// Each curve as its engine's shader has it.
fn decoded(encoding: Encoding, texel: [u8; 4], scale: f32) -> Rgb {
    let [r, g, b, a] = texel.map(|v| f32::from(v) / 255.0);
    let linear = |v: f32| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    let value = |v: f32| match encoding {
        Encoding::Rgbm => (8.0 * a * v).powi(2),
        Encoding::RgbmSrgb => linear(8.0 * a * v),
        _ => v.powf(2.2) / a,
    };
    Rgb::new(value(r), value(g), value(b)) * scale
}

#[test]
fn multipliers_come_back_as_engines_decode_them() {
    for (encoding, most) in [(Encoding::Rgbm, 0.0045), (Encoding::RgbmSrgb, 0.006), (Encoding::Rgbd, 0.03)] {
        for factor in [1.0, 1e4, 1e-4] {
            let mut page = page();
            page.rgb.iter_mut().for_each(|c| *c *= factor);
            let scale = header(encoding, &page, 1).scale;
            assert_eq!(scale == 1.0, factor == 1.0, "{encoding:?}: {scale}");
            let png = image::load_from_memory(&written("multiplier", &page, encoding, 1)).unwrap();
            assert_eq!(png.color(), image::ColorType::Rgba8);
            let found: Vec<Rgb> = png.into_rgba8().pixels().map(|p| decoded(encoding, p.0, scale)).collect();
            let (bias, worst) = errors(&page, &found);
            assert!(bias.abs() < 1e-3 && worst < most, "{encoding:?} at {factor}: bias {bias}, worst {worst}");
        }
    }
}

#[test]
fn half_floats_hold_any_light_by_a_scale() {
    let mut page = page();
    assert_eq!([1.0, 65504.0].map(|v| Encoding::Ktx2Half.scale(v)), [1.0; 2]);
    assert_eq!([65505.0, 131_008.0, 2e5].map(|v| Encoding::Ktx2Bc6h.scale(v)), [2.0, 2.0, 4.0]);
    page.rgb.iter_mut().for_each(|c| *c *= 1e4);
    let scale = header(Encoding::Ktx2Half, &page, 1).scale;
    let bytes = written("bright", &page, Encoding::Ktx2Half, 1);
    let (levels, _) = levels(&bytes, ktx2::Format::R16G16B16A16_SFLOAT);
    let value = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32() * scale;
    let found: Vec<Rgb> = levels[0].chunks(8).map(|t| Rgb::new(value(t), value(&t[2..]), value(&t[4..]))).collect();
    let (bias, worst) = errors(&page, &found);
    assert!(scale > 1.0 && bias.abs() < 1e-4 && worst < 1e-3, "scale {scale}: bias {bias}, worst {worst}");
    let reader = ktx2::Reader::new(&bytes).unwrap();
    let told = reader.key_value_data().find(|(key, _)| *key == "lumel.scale").map(|(_, value)| value.to_vec());
    assert_eq!(told, Some(format!("{scale}\0").into_bytes()));
}

/// The format's own descriptor by the reader's tables, then the levels' bytes.
fn levels(bytes: &[u8], format: ktx2::Format) -> (Vec<Vec<u8>>, ktx2::Header) {
    let reader = ktx2::Reader::new(bytes).unwrap();
    let header = reader.header();
    assert_eq!(header.format, Some(format));
    let (expected, type_size) = ktx2::dfd::Basic::from_format(format).unwrap();
    assert_eq!(reader.basic_dfd(), Some(&expected));
    assert_eq!((header.type_size, reader.dfd_blocks().len()), (type_size, 1));
    assert_eq!((header.pixel_width, header.pixel_height), (61, 27));
    assert_eq!((header.pixel_depth, header.layer_count, header.face_count), (0, 0, 1));
    assert_eq!(header.supercompression_scheme, None);
    let pairs: Vec<(String, Vec<u8>)> =
        reader.key_value_data().map(|(key, value)| (key.to_string(), value.to_vec())).collect();
    assert!(pairs.is_sorted_by(|a, b| a.0 < b.0), "{pairs:?}");
    assert!(pairs.contains(&("KTXorientation".into(), b"rd\0".to_vec())), "{pairs:?}");
    assert!(pairs.contains(&("lumel.unit".into(), b"nit\0".to_vec())), "{pairs:?}");
    assert!(reader.writer().is_some_and(|w| w.starts_with("Lumel")));
    // Smallest level first, each at a multiple of its texel block.
    let block = if format == ktx2::Format::BC6H_UFLOAT_BLOCK { 16 } else { 8 };
    let index: Vec<u64> = (0..header.level_count as usize)
        .map(|k| u64::from_le_bytes(bytes[80 + 24 * k..88 + 24 * k].try_into().unwrap()))
        .collect();
    assert!(index.is_sorted_by(|a, b| a > b) && index.iter().all(|at| at % block == 0), "{index:?}");
    (reader.levels().map(|l| l.data.to_vec()).collect(), header)
}

#[test]
fn half_ktx2_holds_the_page_and_its_levels() {
    let page = page();
    let (one, header) = levels(&written("half", &page, Encoding::Ktx2Half, 1), ktx2::Format::R16G16B16A16_SFLOAT);
    assert_eq!(header.level_count, 1);
    let halves: Vec<f32> = one[0].chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect();
    let found: Vec<Rgb> = halves.chunks_exact(4).map(Rgb::from_slice).collect();
    let (bias, worst) = errors(&page, &found);
    assert!(bias.abs() < 1e-4 && worst < 5e-4, "bias {bias}, worst {worst}");
    let alpha: Vec<f32> = halves.chunks_exact(4).map(|c| c[3]).collect();
    assert_eq!(alpha, page.coverage);
    let (all, header) =
        levels(&written("mips", &page, Encoding::Ktx2Half, u32::MAX), ktx2::Format::R16G16B16A16_SFLOAT);
    assert_eq!(header.level_count, 6);
    assert_eq!(all[0], one[0]);
    assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [61 * 27, 30 * 13, 15 * 6, 7 * 3, 3, 1].map(|n| n * 8));
}

/// Texels of BC6H blocks by another decoder.
fn from_blocks(blocks: &[u8], width: usize, height: usize) -> Vec<Rgb> {
    let columns = width.div_ceil(4);
    let mut found = vec![Rgb::ZERO; width * height];
    for (k, block) in blocks.chunks_exact(16).enumerate() {
        let mut texels = [0.0f32; 48];
        bcdec_rs::bc6h_float(block, &mut texels, 12, false);
        for (i, texel) in texels.chunks_exact(3).enumerate() {
            let (x, y) = (k % columns * 4 + i % 4, k / columns * 4 + i / 4);
            if x < width && y < height {
                found[y * width + x] = Rgb::from_slice(texel);
            }
        }
    }
    found
}

#[test]
fn bc6h_ktx2_shows_the_page() {
    let mut page = page();
    // Without the black corner, whose edge no block of 4 x 4 can hold exactly.
    page.rgb.iter_mut().filter(|c| **c == Rgb::ZERO).for_each(|c| *c = Rgb::splat(20.0));
    let bytes = written("bc6h", &page, Encoding::Ktx2Bc6h, u32::MAX);
    let (all, _) = levels(&bytes, ktx2::Format::BC6H_UFLOAT_BLOCK);
    assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [16 * 7, 8 * 4, 4 * 2, 2, 1, 1].map(|n| n * 16));
    let found = from_blocks(&all[0], 61, 27);
    let squares = |i: usize| f64::from((found[i] - page.rgb[i]).length_squared() / page.rgb[i].length_squared());
    let rms = ((0..found.len()).map(squares).sum::<f64>() / found.len() as f64).sqrt();
    let (bias, _) = errors(&page, &found);
    // The corner's block has an edge of hue and level, and the page's last row of blocks repeats texels.
    let smooth = (0..found.len()).filter(|i| i % 61 >= 4 || i / 61 >= 4);
    let worst = smooth.map(squares).fold(0.0, f64::max).sqrt();
    // Measured 0.0169, -0.0010 and 0.069: a slope of 12 % a texel is far steeper than light is but at hard shadows.
    assert!(rms < 0.02 && bias.abs() < 3e-3 && worst < 0.08, "rms {rms}, bias {bias}, worst {worst}");
    assert_eq!(bytes, written("bc6h", &page, Encoding::Ktx2Bc6h, u32::MAX), "equal pages give equal bytes");
}

#[test]
fn what_a_form_can_not_hold_is_counted() {
    let folder = Folder::new("misfits");
    let mut page = page();
    (page.rgb[7].x, page.rgb[8].y, page.rgb[9].z) = (f32::NAN, -1.0, 1e30);
    for (encoding, misfits) in [(Encoding::Hdr, 2), (Encoding::Ktx2Half, 3), (Encoding::Rgbm, 3)] {
        let header = Header { quantity: Quantity::Outgoing, scale: 1.0, levels: 1 };
        let path = folder.0.join("page");
        assert_eq!(write_page(&path, &page, encoding, &header).unwrap(), misfits, "{encoding:?}");
    }
    page.rgb.pop();
    let header = Header { quantity: Quantity::Outgoing, scale: 1.0, levels: 1 };
    assert!(write_page(Path::new("nowhere"), &page, Encoding::Hdr, &header).is_err());
}
