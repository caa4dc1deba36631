//! Light probes: answers known on paper, and agreement with small patches that are baked at the same place.

mod files;
mod support;

use glam::{Affine3A, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::probe::{Harmonics, Probe};
use lumel::scene::{LightShape, Scene};
use lumel::settings::{Gather, Method, ProbeSet, ProbeSetting, Quality, Settings};
use std::f32::consts::PI;
use support::measure::{Case, block, picture_sky};
use support::{Quad, bake, draft, room};

fn at(positions: &[[f32; 3]]) -> Settings {
    let sets = vec![ProbeSet { positions: positions.to_vec(), ..ProbeSet::default() }];
    Settings { probes: Some(ProbeSetting::Sets(sets)), ..draft() }
}

fn probes(baked: &Illuminated) -> &[Probe] {
    &baked.probes.list
}

#[test]
fn furnace_is_its_mean_alone() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    let case = Case::of_quads("furnace", &quads, 8);
    // L = 1 / (1 - 0.5); right beside a wall, in the middle and in a corner.
    for probe in probes(&case.bake(&at(&[[1., 0.5, 1.5], [1., 0.01, 1.5], [0.05, 0.05, 0.05]]))) {
        let [mean, rest @ ..] = probe.radiance.0;
        assert!((mean / (2.0 * (4.0 * PI).sqrt()) - 1.0).abs().max_element() < 3e-3, "{}: {mean}", probe.position);
        assert!(rest.iter().all(|c| c.abs().max_element() < 5e-3 * mean.x), "{}: {rest:?}", probe.position);
        let along = probe.radiance.irradiance(Vec3::X).x / (2.0 * PI);
        assert!((along - 1.0).abs() < 8e-3, "{}: {along}", probe.position);
        assert!(probe.is_valid() && probe.back_share == 0.0);
    }
}

#[test]
fn even_sky_is_exact() {
    let case = Case::of_quads("nothing", &[Quad::new([1e3, 0., 0.], [0., 0., 1e-2], [1e-2, 0., 0.])], 4).sky(3.0);
    let probe = probes(&case.bake(&at(&[[0., 5., 0.]])))[0];
    assert!((probe.radiance.0[0].x / (3.0 * (4.0 * PI).sqrt()) - 1.0).abs() < 1e-5);
    assert!(probe.radiance.0[1..].iter().all(|c| c.abs().max_element() < 1e-5), "{:?}", probe.radiance);
}

#[test]
fn a_sun_and_a_lamp_are_projected_as_they_are_and_walls_keep_them_out() {
    let wall = Quad::new([-5., 0., 1.], [10., 0., 0.], [0., 4., 0.]).albedo(0.0).double_sided();
    let towards = Vec3::new(0.6, 0.5, 0.3).normalize();
    let color = Rgb::new(100., 80., 50.);
    let sun = LightShape::Directional { direction: -towards, illuminance: color, angle: 0.0 };
    let case = Case::of_quads("wall", &[wall], 8).light(sun);
    let found = case.bake(&at(&[[0., 1., 3.], [0., 1., -0.5]]));
    let [open, shaded] = [0, 1].map(|k| probes(&found)[k]);
    let mut expected = Harmonics::default();
    expected.receive(color, towards);
    for (c, e) in open.radiance.0.iter().zip(expected.0) {
        assert!((*c - e).abs().max_element() < 1e-4, "{c} against {e}");
    }
    assert!(shaded.radiance.0.iter().all(|c| c.abs().max_element() < 1e-6), "{:?}", shaded.radiance);

    let lamp = LightShape::Point { position: Vec3::new(0., 2., 3.), intensity: color, range: None };
    let case = Case::of_quads("wall", &[wall], 8).light(lamp);
    let found = case.bake(&at(&[[0., 1., 3.], [0., 1., -3.]]));
    assert!((probes(&found)[0].radiance.irradiance(Vec3::Y) / color - 1.0625).abs().max_element() < 1e-4);
    assert_eq!(probes(&found)[1].radiance, Harmonics::default());
}

#[test]
fn light_that_grows_along_a_line_grows_evenly() {
    // Far from a lamp its light is nearly linear in place.
    let floor = Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0);
    let lamp = LightShape::Point { position: Vec3::new(0., 50., 0.), intensity: Rgb::splat(1e5), range: None };
    let case = Case::of_quads("floor", &[floor], 8).light(lamp);
    let found = case.bake(&at(&[[0., 1., 0.], [0., 1.5, 0.], [0., 2., 0.]]));
    let e: Vec<f32> = probes(&found).iter().map(|p| p.radiance.irradiance(Vec3::Y).x).collect();
    assert!(e[2] > e[0] && ((e[0] + e[2]) / (2.0 * e[1]) - 1.0).abs() < 1e-3, "{e:?}");
}

#[test]
fn what_stands_inside_of_something_is_marked() {
    let mut quads: Vec<Quad> = room([3., 3., 3.]).into_iter().map(|q| q.emission(1.0)).collect();
    quads.extend(block([1., 0.01, 1.], [1., 1., 1.]));
    let case = Case::of_quads("block", &quads, 8);
    // In the block, behind a wall, and in the room.
    let found = case.bake(&at(&[[1.5, 0.5, 1.5], [-0.2, 1., 1.], [0.5, 0.5, 0.5]]));
    let valid: Vec<bool> = probes(&found).iter().map(Probe::is_valid).collect();
    assert_eq!(valid, [false, false, true]);
    assert_eq!(probes(&found)[0].back_share, 1.0);
    assert_eq!(probes(&found)[0].radiance, Harmonics::default());
}

/// `case` with a small patch about `normal` at `place` that takes no part in the light.
fn with_patch(case: &Case, place: Vec3, normal: Vec3) -> (Scene, lumel::unwrap::Atlas) {
    let (u, v) = normal.any_orthonormal_pair();
    let (u, v) = (u * 0.01, v * 0.01);
    let corner = place - 0.5 * (u + v);
    let quad = Quad::new(corner.to_array(), u.to_array(), v.to_array());
    let (mut scene, mut atlas) = (case.scene.clone(), case.atlas.clone());
    let (mut other, own) = (support::scene(&[quad]), support::atlas(1, 2));
    let mesh = scene.meshes.len();
    other.meshes[0].triangle_material.fill(scene.materials.len() as u32);
    scene.materials.append(&mut other.materials);
    scene.meshes.append(&mut other.meshes);
    let mut surface = other.surfaces.remove(0);
    (surface.mesh, surface.role.casts, surface.world_from_local) = (mesh, false, Affine3A::IDENTITY);
    scene.surfaces.push(surface);
    atlas.pages.extend(&own.pages);
    atlas.meshes.extend(own.meshes);
    let mut placement = own.placements[0];
    placement.page = 1;
    atlas.placements.push(placement);
    atlas.shown_pages = 2;
    (scene, atlas)
}

#[test]
fn irradiance_is_that_of_a_patch_at_the_same_place() {
    let mut quads: Vec<Quad> = room([3., 2.5, 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads[1] = quads[1].emission(5.0);
    quads.extend(block([0.5, 0.0, 1.0], [0.6, 0.8, 0.9]).into_iter().map(|q| q.albedo(0.4)));
    let indoors = Case::of_quads("room", &quads, 16);
    let outdoors = picture_sky(16);
    for (case, place) in [(&indoors, [1.8, 1.1, 2.2]), (&outdoors, [0.6, 0.7, 0.9])] {
        for normal in [Vec3::Y, Vec3::X, -Vec3::Z, Vec3::new(1., 1., 1.).normalize()] {
            let (scene, atlas) = with_patch(case, place.into(), normal);
            let settings = Settings { quality: Quality::High, gather: Gather::Final, ..at(&[place]) };
            let baked = bake(&scene, &atlas, &settings);
            let last = scene.surfaces.len() as u32 - 1;
            let patches: Vec<usize> = (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == last).collect();
            let light = |i: &usize| luminance(baked.gathered.irradiance[*i]);
            let patch = patches.iter().map(light).sum::<f32>() / patches.len() as f32;
            let probe = luminance(probes(&baked)[0].radiance.irradiance(normal));
            println!("{} {normal}: {probe:.3} against {patch:.3}, {:+.1} %", case.name, 100.0 * (probe / patch - 1.0));
            // Of a single direction, as that of the picture's sun, a cosine to order 2 is off by a sixteenth.
            let whole = luminance(probes(&baked)[0].radiance.0[0]) * (4.0 * PI).sqrt();
            let most = if case.name == "room" { 0.03 * patch } else { 0.07 * whole };
            assert!((probe - patch).abs() < most, "{} {normal}: {probe} against {patch}", case.name);
        }
    }
}

#[test]
fn all_methods_and_any_threads_give_the_same_probes() {
    let mut quads: Vec<Quad> = room([3., 2.5, 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([1., 2.4, 1.5], [0.6, 0., 0.], [0., 0., 0.6]).albedo(0.0).emission(20.0));
    let case = Case::of_quads("room", &quads, 12);
    let settings = Settings { quality: Quality::Medium, ..at(&[[1., 1., 1.], [2.5, 0.3, 3.5]]) };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let blocks = pool(1).install(|| case.bake(&settings));
    let threads = pool(3).install(|| case.bake(&settings));
    let paths = case.bake(&Settings { method: Method::Path, samples: Some(512), ..settings });
    for ((a, b), c) in probes(&blocks).iter().zip(probes(&threads)).zip(probes(&paths)) {
        assert_eq!(a.radiance, b.radiance);
        for (a, c) in a.radiance.0.iter().zip(c.radiance.0) {
            assert!((*a - c).abs().max_element() < 0.02 * blocks.probes.list[0].radiance.0[0].x, "{a} against {c}");
        }
    }
}

#[test]
fn a_spacing_fills_the_scene() {
    let case = Case::of_quads("room", &room([3., 2., 4.]), 4).sky(1.0);
    let settings = Settings { probes: Some(ProbeSetting::Spacing(1.0)), ..draft() };
    let baked = case.bake(&settings);
    assert_eq!(baked.probes.list.len(), 3 * 2 * 4);
    assert!((baked.probes.list[0].position - Vec3::splat(0.5)).length() < 1e-5);
}

#[test]
fn files_say_what_they_hold() {
    let folder = files::Folder::new("probes");
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/furnace/furnace.glb");
    let sets = r#"{"quality": "draft", "resolution": 32, "directional": "sh", "float": true,
        "probes": [{"positions": [[0.5, 0.4, 0.6]]}, {"low": [0, 0, 0], "high": [1, 0.8, 1.2], "spacing": 0.6}]}"#;
    let settings: Settings = serde_json::from_str(sets).unwrap();
    lumel::pipeline::bake(&scene, &folder.0, &settings, &lumel::progress::Silent).unwrap();
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.0.join(name)).unwrap()).unwrap()
    };
    let report = read("report.json");
    let listed = serde_json::json!({ "count": 9, "invalid": 0, "files": ["probes.json", "probes.exr"] });
    assert_eq!(report["probes"], listed);
    assert_eq!(report["settings"]["directional"], "sh");
    let probes = read("probes.json");
    assert_eq!(probes["sets"][1]["counts"], serde_json::json!([2, 2, 2]));
    assert_eq!((&probes["sets"][1]["first"], &probes["unit"]), (&serde_json::json!(1), &serde_json::json!("nit")));
    let mean = probes["probes"][8]["coefficients"][0][1].as_f64().unwrap();
    assert!((mean * 0.282_094_8 / 2.0 - 1.0).abs() < 0.01, "{mean}");

    let image = exr::prelude::read_first_flat_layer_from_file(folder.0.join("probes.exr")).unwrap();
    assert_eq!((image.layer_data.size.0, image.layer_data.size.1), (9, 9));
    let page = exr::prelude::read_first_flat_layer_from_file(folder.0.join("lightmaps/furnace_0.exr")).unwrap();
    let names: Vec<String> = page.layer_data.channel_data.list.iter().map(|c| c.name.to_string()).collect();
    assert!(["sh0.R", "sh1x.G", "sh1y.B", "sh1z.R"].iter().all(|n| names.iter().any(|m| m == n)), "{names:?}");
    assert!(page.layer_data.attributes.other.contains_key(&exr::prelude::Text::from("lumel:directional")));
    let baked = std::fs::read(folder.0.join("furnace.glb")).unwrap();
    assert!(String::from_utf8_lossy(&baked).contains(r#""layers":["sh0","sh1x","sh1y","sh1z"]"#));
}

#[test]
fn probes_of_an_earlier_bake_go_and_files_of_others_stay() {
    let folder = files::Folder::new("stale_probes");
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/furnace/furnace.glb");
    let bake = |probes: Option<ProbeSetting>| {
        let settings = Settings { resolution: Some(32), probes, ..draft() };
        lumel::pipeline::bake(&scene, &folder.0, &settings, &lumel::progress::Silent).unwrap();
    };
    let stand = || ["probes.json", "probes.exr"].map(|name| folder.0.join(name).exists());
    bake(Some(ProbeSetting::Spacing(1.0)));
    assert_eq!(stand(), [true; 2]);
    bake(None);
    assert_eq!(stand(), [false; 2]);
    // No report says that these are a bake's.
    std::fs::write(folder.0.join("probes.json"), "mine").unwrap();
    bake(None);
    assert_eq!(stand(), [true, false]);
}
