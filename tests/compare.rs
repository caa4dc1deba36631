//! Known answers of the page comparison.

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, Layer, LayerAttributes, WritableImage};
use lumel::color::Rgb;
use lumel::compare::{Page, compare, error_image, read_page, write_png};
use std::path::PathBuf;

/// A folder of this test's own, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("lumel-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A fully covered 4 x 2 page of grey `values`.
fn page(values: [f32; 8]) -> Page {
    Page { width: 4, height: 2, rgb: values.map(Rgb::splat).to_vec(), coverage: vec![1.0; 8] }
}

#[test]
fn a_page_equals_itself() {
    let p = page([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.0]);
    let c = compare(&p, &p, "p").unwrap();
    assert_eq!((c.bias, c.rel_rmse, c.p50, c.p95, c.p99, c.max), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    assert_eq!((c.texels, c.only_a, c.only_b, c.not_finite), (8, 0, 0, 0));
    let black = page([0.0; 8]);
    assert_eq!(compare(&black, &black, "p").unwrap().rel_rmse, 0.0);
}

#[test]
fn figures_follow_their_definitions() {
    let b = page([1.0; 8]);
    let mut a = page([1.1; 8]);
    let c = compare(&a, &b, "p").unwrap();
    for figure in [c.bias, c.rel_rmse, c.p50, c.p99, c.max] {
        assert!((figure - 0.1).abs() < 1e-6, "{figure}");
    }
    a = b.clone();
    a.rgb[6] = Rgb::splat(0.2);
    let c = compare(&a, &b, "p").unwrap();
    assert!((c.bias + 0.1).abs() < 1e-6 && (c.max - 0.8).abs() < 1e-6 && c.p50 == 0.0);
    assert!((c.rel_rmse - (0.64f64 / 8.0).sqrt()).abs() < 1e-6);
    assert_eq!(c.max_at, [2, 1]);
}

#[test]
fn dark_texels_are_measured_against_the_floor() {
    // The mean of b is 1; its black texel counts as 0.05.
    let b = page([0.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut a = b.clone();
    a.rgb[0] = Rgb::splat(0.05);
    assert!((compare(&a, &b, "p").unwrap().max - 1.0).abs() < 1e-6);
}

#[test]
fn only_texels_that_both_cover_count() {
    let (mut a, mut b) = (page([1.0; 8]), page([1.0; 8]));
    a.coverage[0] = 0.0;
    b.coverage[1] = 0.0;
    (a.coverage[2], b.coverage[2]) = (0.0, 0.0);
    a.rgb[3].x = f32::NAN;
    (a.rgb[0], a.rgb[1]) = (Rgb::splat(9.0), Rgb::splat(9.0));
    let c = compare(&a, &b, "p").unwrap();
    assert_eq!((c.texels, c.only_a, c.only_b, c.not_finite, c.max), (4, 1, 1, 1, 0.0));
    let picture = error_image(&a, &b, 0.2, "p").unwrap();
    let colors = [0, 1, 2, 3].map(|x| picture.get_pixel(x, 0).0);
    assert_eq!(colors, [[255, 0, 255], [255, 0, 255], [0, 0, 0], [255, 255, 0]]);
    a.coverage.fill(0.0);
    assert!(compare(&a, &b, "p").unwrap_err().to_string().contains("no texel"));
}

#[test]
fn other_sizes_are_refused_with_both_sizes() {
    let a = page([1.0; 8]);
    let b = Page { width: 2, height: 4, ..a.clone() };
    let message = compare(&a, &b, "a and b").unwrap_err().to_string();
    assert!(message.contains("4 x 2") && message.contains("2 x 4"), "{message}");
}

#[test]
fn the_error_image_is_blue_where_darker_and_red_where_brighter() {
    let b = page([1.0; 8]);
    let a = page([1.0, 1.1, 1.2, 2.0, 0.9, 0.8, 0.0, 1.0]);
    let picture = error_image(&a, &b, 0.2, "p").unwrap();
    let at = |x, y| picture.get_pixel(x, y).0;
    assert_eq!(at(0, 0), [255, 255, 255]);
    assert_eq!(at(2, 0), at(3, 0), "beyond the range the colour stays");
    assert!(at(2, 0)[0] > at(2, 0)[2] && at(1, 1)[2] > at(1, 1)[0]);
    assert!(at(1, 0)[1] > at(2, 0)[1], "half the range is paler");
    assert!(error_image(&a, &b, 0.0, "p").is_err());

    let folder = Folder::new("error-image");
    let path = folder.0.join("error.png");
    write_png(&picture, &path).unwrap();
    assert_eq!(image::open(&path).unwrap().to_rgb8(), picture);
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 1, "nothing is left beside it");
    assert!(write_png(&picture, &folder.0.join("missing/error.png")).is_err());
}

#[test]
fn pages_are_read_from_half_and_float_channels_in_layers() {
    let folder = Folder::new("read-page");
    let half = |v: f32| FlatSamples::F16(vec![half::f16::from_f32(v); 6]);
    let float = |v: f32| FlatSamples::F32(vec![v; 6]);
    let write = |name: &str, channels: Vec<AnyChannel<FlatSamples>>| {
        let path = folder.0.join(name);
        let layer = Layer::new(
            (3, 2),
            LayerAttributes::named("page"),
            exr::prelude::Encoding::SMALL_LOSSLESS,
            AnyChannels::sort(channels.into()),
        );
        Image::from_layer(layer).write().to_file(&path).unwrap();
        path
    };
    let channel = AnyChannel::new;
    let plain = [channel("R", half(0.5)), channel("G", float(1.5)), channel("B", half(2.0)), channel("A", half(0.25))];
    let direct = [channel("direct.R", half(7.0)), channel("direct.G", half(7.0)), channel("direct.B", half(7.0))];
    let expected = Page { width: 3, height: 2, rgb: vec![Rgb::new(0.5, 1.5, 2.0); 6], coverage: vec![0.25; 6] };
    let both = write("both.exr", direct.iter().chain(&plain).cloned().collect());
    assert_eq!(read_page(&both).unwrap(), expected, "plain channels go before those of a layer");
    let layer = read_page(&write("layer.exr", direct.to_vec())).unwrap();
    assert_eq!((layer.rgb[0], layer.coverage[0]), (Rgb::splat(7.0), 1.0));

    let depth = read_page(&write("depth.exr", vec![channel("Z", float(1.0))])).unwrap_err().to_string();
    assert!(depth.contains("depth.exr") && depth.contains("R, G and B"), "{depth}");
    let text = folder.0.join("text.exr");
    std::fs::write(&text, "not an image").unwrap();
    assert!(read_page(&text).unwrap_err().to_string().contains("text.exr"));
    assert!(read_page(&folder.0.join("none.exr")).unwrap_err().to_string().contains("none.exr"));
}
