//! EXR pages: what is written is read back, equal inputs give equal bytes, and nothing is lost in silence.

use exr::prelude::*;
use lumel::color::Rgb;
use lumel::post::{PageImage, Quantity};
use lumel::write::exr::{PageHeader, write_image, write_layers, write_page};
use std::path::PathBuf;

/// A file in a folder of the test's own.
fn file(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("lumel-write-exr-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

fn page() -> PageImage {
    let (width, height) = (37, 19);
    let rgb = (0..width * height).map(|i| Rgb::new(i as f32 * 0.25, 1.0 / (1.0 + i as f32), 0.5)).collect();
    let coverage = (0..width * height).map(|i| (i % 5) as f32 / 4.0).collect();
    PageImage { width, height, rgb, coverage }
}

const HEADER: PageHeader = PageHeader {
    quantity: Quantity::Outgoing,
    page: 3,
    density: 12.5,
    scene: "room.glb",
    directional: lumel::post::Directional::Off,
};

/// Channel `name` of the file's first layer, row by row from the top.
fn channel(path: &PathBuf, name: &str) -> Vec<f32> {
    let image = read_all_data_from_file(path).unwrap();
    let list = &image.layer_data[0].channel_data.list;
    let channel = list.iter().find(|c| c.name == *name).unwrap_or_else(|| panic!("channel {name}"));
    match &channel.sample_data {
        Levels::Singular(samples) => samples.values_as_f32().collect(),
        _ => panic!("one level"),
    }
}

#[test]
fn float_page_is_read_back_exactly() {
    let (path, page) = (file("float.exr"), page());
    assert_eq!(write_page(&path, &page, &[], &HEADER, true).unwrap(), 0);
    for (i, name) in ["R", "G", "B"].into_iter().enumerate() {
        assert_eq!(channel(&path, name), page.rgb.iter().map(|c| c[i]).collect::<Vec<_>>());
    }
    assert_eq!(channel(&path, "A"), page.coverage);
}

#[test]
fn half_page_keeps_three_digits_and_says_what_it_holds() {
    let (path, page) = (file("half.exr"), page());
    assert_eq!(write_page(&path, &page, &[], &HEADER, false).unwrap(), 0);
    for (read, written) in channel(&path, "G").iter().zip(&page.rgb) {
        assert!((read - written.y).abs() <= written.y / 2048.0, "{read} for {}", written.y);
    }
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let header = &meta.headers[0];
    assert_eq!(header.compression, Compression::ZIP16);
    let attribute = |name: &str| header.own_attributes.other.get(&Text::from(name)).cloned();
    assert_eq!(attribute("lumel:quantity"), Some(AttributeValue::Text("outgoing".into())));
    assert_eq!(attribute("lumel:unit"), Some(AttributeValue::Text("nit".into())));
    assert_eq!(attribute("lumel:version"), Some(AttributeValue::Text(env!("CARGO_PKG_VERSION").into())));
    assert_eq!(attribute("lumel:page"), Some(AttributeValue::I32(3)));
    assert_eq!(attribute("lumel:texelDensity"), Some(AttributeValue::F32(12.5)));
    assert_eq!(attribute("lumel:scene"), Some(AttributeValue::Text("room.glb".into())));
    assert_eq!(header.shared_attributes.chromaticities.map(|c| c.white), Some(Vec2(0.3127, 0.3290)));
}

#[test]
fn what_half_cannot_hold_is_counted() {
    let (path, mut page) = (file("clamped.exr"), page());
    page.rgb[0] = Rgb::new(1e6, 2e6, 1.0);
    page.rgb[1] = Rgb::new(1.0, f32::NAN, 1.0);
    page.rgb[2] = Rgb::splat(65504.0);
    assert_eq!(write_page(&path, &page, &[], &HEADER, false).unwrap(), 2);
    assert_eq!(channel(&path, "R")[..3], [65504.0, 1.0, 65504.0]);
    assert_eq!(channel(&path, "G")[1], 0.0);
    assert_eq!(write_page(&path, &page, &[], &HEADER, true).unwrap(), 0);
    assert_eq!(channel(&path, "R")[0], 1e6);
}

#[test]
fn equal_inputs_give_equal_bytes() {
    let page = page();
    let mut first = None;
    for i in 0..8 {
        let path = file(&format!("equal{i}.exr"));
        write_page(&path, &page, &[], &HEADER, false).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "file {i} differs");
    }
}

#[test]
fn pictures_and_layers() {
    let rgb: Vec<Rgb> = (0..6).map(|i| Rgb::splat(i as f32)).collect();
    let path = file("picture.exr");
    write_image(&path, 3, 2, &rgb).unwrap();
    assert_eq!(channel(&path, "B"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    write_layers(&path, 3, 2, &[("direct", &rgb), ("indirect", &rgb)]).unwrap();
    assert_eq!(channel(&path, "indirect.G")[5], 5.0);
}

#[test]
fn wrong_sizes_are_an_error() {
    let mut page = page();
    page.rgb.pop();
    assert!(write_page(&file("wrong.exr"), &page, &[], &HEADER, false).is_err());
    assert!(write_image(&file("wrong.exr"), 0, 0, &[]).is_err());
    assert!(write_page(&PathBuf::from("/nowhere/at/all.exr"), &self::page(), &[], &HEADER, false).is_err());
}
