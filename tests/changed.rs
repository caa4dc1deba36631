//! Objects that come, go and change: the others keep their places on pages and what is known of their light.

mod files;
mod support;

use files::Folder;
use glam::{Affine3A, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::kept::add_base;
use lumel::illuminate::state::State;
use lumel::illuminate::{Illuminated, illuminate, illuminate_with};
use lumel::pipeline::bake;
use lumel::progress::Silent;
use lumel::scene::{Light, LightShape, Scene};
use lumel::settings::{Method, Normals, Settings};
use lumel::store::{Key, Store};
use lumel::unwrap::{Atlas, Density, Earlier, Places, UnwrapParams, unwrap_after};
use lumel::work::Work;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use support::measure::{block, differences};
use support::{mesh_scene, room, sphere};

/// Something in the room: its name, the corner where it stands and its size [m]. A ball, which needs an unwrapper, is as wide as that.
type Thing = (&'static str, [f32; 3], [f32; 3]);

const TABLE: Thing = ("table", [1.0, 0.0, 1.0], [0.9, 0.6, 0.7]);
const STOOL: Thing = ("stool", [2.9, 0.0, 3.2], [0.4, 0.4, 0.4]);
const BALL: Thing = ("ball", [3.1, 0.5, 1.2], [0.5, 0.0, 0.0]);
const SHELF: Thing = ("shelf", [0.2, 0.0, 3.6], [0.3, 1.6, 1.0]);

fn triangles(quads: &[support::Quad]) -> Vec<[Vec3; 3]> {
    let two = |q: &support::Quad| {
        let [a, b, c, d] = [q.corner, q.corner + q.u, q.corner + q.u + q.v, q.corner + q.v];
        [[a, b, c], [a, c, d]]
    };
    quads.iter().flat_map(two).collect()
}

/// A room with `things` in it and a lamp.
fn furnished(things: &[Thing]) -> Scene {
    let mut surfaces: Vec<Vec<[Vec3; 3]>> = room([4.0, 3.0, 5.0]).iter().map(|q| triangles(&[*q])).collect();
    let walls = surfaces.len();
    surfaces.extend(things.iter().map(|(name, _, size)| match name.starts_with("ball") {
        true => sphere(Vec3::splat(0.5 * size[0]), 0.5 * size[0], 8, false),
        false => triangles(&block([0.0; 3], *size)),
    }));
    let mut scene = mesh_scene(&surfaces);
    for (surface, (name, at, _)) in scene.surfaces[walls..].iter_mut().zip(things) {
        surface.name = (*name).to_owned();
        surface.world_from_local = Affine3A::from_translation(Vec3::from(*at));
    }
    let lamp = LightShape::Sphere {
        world_from_unit: Affine3A::from_scale_rotation_translation(
            Vec3::splat(0.15),
            glam::Quat::IDENTITY,
            Vec3::new(2.4, 2.6, 2.8),
        ),
        radiance: Rgb::splat(100.0),
    };
    scene.lights.push(Light::new("lamp", lamp));
    scene
}

fn params() -> UnwrapParams {
    UnwrapParams { density: Density::TexelsPerMetre(12.0), page_size: 256, ..UnwrapParams::default() }
}

/// The atlas of `scene` after one `before`: also what a later one can keep, and how many surfaces kept their places.
fn laid_out(scene: &Scene, params: &UnwrapParams, before: Option<&Earlier>) -> (Atlas, Earlier, Option<usize>) {
    let made = unwrap_after(scene, params, before.unwrap_or(&Earlier::default()), &Silent).unwrap();
    (made.atlas, made.earlier, made.kept)
}

/// The page texels of surface `name`.
fn place(scene: &Scene, atlas: &Atlas, name: &str) -> (u32, Vec<[[f32; 2]; 3]>) {
    let s = scene.surfaces.iter().position(|surface| surface.name == name).unwrap();
    let mesh = scene.surfaces[s].mesh;
    let triangles = 0..scene.meshes[mesh].triangles.len();
    let texels = triangles.map(|t| atlas.page_texels(s, mesh, t).map(|p| p.to_array())).collect();
    (atlas.placements[s].page, texels)
}

/// Texels that two surfaces cover.
fn shared_texels(scene: &Scene, atlas: &Atlas) -> usize {
    let lit = illuminate(scene, atlas, &Settings { max_bounces: Some(0), ..settings() }, &Silent).unwrap();
    let mut texels: Vec<[u32; 2]> = (0..lit.patches.len()).map(|i| lit.patches.texel(i)).collect();
    texels.sort_unstable();
    texels.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

fn settings() -> Settings {
    Settings { normals: Normals::Geometric, error: Some(1.0), ..Settings::default() }
}

#[test]
fn the_same_again_lies_as_it_lay() {
    for density in [Density::TexelsPerMetre(12.0), Density::TexelCount(9000), Density::FillPage(128)] {
        let (scene, params) = (furnished(&[TABLE, STOOL, SHELF]), UnwrapParams { density, ..params() });
        let (first, earlier, kept) = laid_out(&scene, &params, None);
        assert_eq!(kept, None);
        let (again, of_again, kept) = laid_out(&scene, &params, Some(&earlier));
        assert_eq!(first, again, "{density:?}");
        assert_eq!(earlier, of_again);
        assert_eq!(kept, Some(scene.surfaces.len()));
        // By way of a file.
        let text = serde_json::to_string(&earlier.places).unwrap();
        assert_eq!(serde_json::from_str::<Option<Places>>(&text).unwrap(), earlier.places);
    }
}

#[test]
fn what_stays_keeps_its_place_when_other_things_come_and_go() {
    let before = furnished(&[TABLE, STOOL, SHELF]);
    let (first, earlier, _) = laid_out(&before, &params(), None);
    let walls = (0..6).map(|i| format!("mesh{i}"));
    let others: Vec<String> = walls.chain(["table".to_owned(), "shelf".to_owned()]).collect();
    let larger: Thing = ("stool", STOOL.1, [0.5, 0.45, 0.5]);
    let lamp: Thing = ("foot", [3.4, 0.0, 0.4], [0.2, 1.1, 0.2]);
    // Gone, larger, moved, one more, and in another order.
    let cases: [&[Thing]; 5] = [
        &[TABLE, SHELF],
        &[TABLE, larger, SHELF],
        &[TABLE, ("stool", [0.5, 0.0, 0.3], STOOL.2), SHELF],
        &[TABLE, STOOL, SHELF, lamp],
        &[SHELF, lamp, TABLE],
    ];
    for things in cases {
        let scene = furnished(things);
        let (atlas, next, kept) = laid_out(&scene, &params(), Some(&earlier));
        for name in &others {
            let places = [place(&before, &first, name), place(&scene, &atlas, name)];
            assert_eq!(places[0], places[1], "{name} in {things:?}");
        }
        assert!(kept.is_some_and(|kept| kept >= others.len()), "{kept:?}");
        assert_eq!(shared_texels(&scene, &atlas), 0, "{things:?}");
        // And back again: what was there before lies where it did.
        let (back, _, _) = laid_out(&before, &params(), Some(&next));
        others.iter().for_each(|name| assert_eq!(place(&before, &first, name), place(&before, &back, name)));
        assert_eq!(shared_texels(&before, &back), 0);
    }
}

#[test]
fn alike_things_stay_where_each_stands() {
    let stools: [Thing; 3] =
        [("stool", [0.5, 0.0, 0.5], STOOL.2), ("stool", [1.5, 0.0, 0.5], STOOL.2), ("stool", [2.5, 0.0, 0.5], STOOL.2)];
    let scene = furnished(&stools);
    let (first, earlier, _) = laid_out(&scene, &params(), None);
    let fewer = furnished(&stools[1..]);
    let (atlas, ..) = laid_out(&fewer, &params(), Some(&earlier));
    for (now, then) in [(6, 7), (7, 8)] {
        let texels = |atlas: &Atlas, s: usize, mesh: usize| atlas.page_texels(s, mesh, 0);
        assert_eq!(texels(&atlas, now, now), texels(&first, then, then));
    }
}

#[test]
fn much_that_came_is_laid_out_anew() {
    let before = furnished(&[STOOL]);
    let (_, earlier, _) = laid_out(&before, &params(), None);
    let hall: Thing = ("hall", [0.1, 0.0, 0.1], [3.0, 2.5, 4.0]);
    let scene = furnished(&[STOOL, hall]);
    let (atlas, _, kept) = laid_out(&scene, &params(), Some(&earlier));
    assert_eq!(kept, None);
    assert_eq!(atlas, laid_out(&scene, &params(), None).0);
    // Of other parameters it says nothing.
    let other = UnwrapParams { padding: 4, ..params() };
    assert_eq!(laid_out(&before, &other, Some(&earlier)).2, None);
}

fn base(scene: &Scene, atlas: &Atlas) -> Key {
    Key::of("base", |hasher| add_base(hasher, scene, atlas))
}

fn state(scene: &Scene, atlas: &Atlas, lit: &Illuminated) -> State {
    State::new(scene, atlas, base(scene, atlas), &lit.patches.runs(scene.surfaces.len()))
}

#[test]
fn the_light_around_what_came_and_went_is_found_anew_and_the_rest_kept() {
    let folder = Folder::new("light");
    let store = Store::open(&folder.0).unwrap();
    let before = furnished(&[STOOL, TABLE, BALL, SHELF]);
    let (atlas, earlier, _) = laid_out(&before, &params(), None);
    let work = Work::new(&store, base(&before, &atlas), None, Duration::MAX);
    let first = illuminate_with(&before, &atlas, &settings(), &work, &Silent).unwrap();
    let block: Thing = ("block", [2.6, 0.0, 0.6], [0.5, 0.9, 0.5]);
    let cases: [(&str, &[Thing], usize); 3] = [
        ("gone", &[TABLE, BALL, SHELF], 0),
        ("come", &[STOOL, ("ball of another size", [0.6, 1.2, 3.9], [0.3; 3]), TABLE, SHELF, BALL], 1),
        ("both, in another order", &[SHELF, block, BALL, TABLE], 1),
    ];
    for (what, things, changed) in cases {
        let scene = furnished(things);
        let (atlas, ..) = laid_out(&scene, &params(), Some(&earlier));
        let now = State::new(&scene, &atlas, base(&scene, &atlas), &[]);
        let (key, change) =
            now.since(&state(&before, &self::laid_out(&before, &params(), None).0, &first)).expect(what);
        assert_eq!(change.surfaces.iter().filter(|changed| **changed).count(), changed, "{what}");
        let work = Work::new(&store, base(&scene, &atlas), None, Duration::MAX).after(key, change);
        let again = illuminate_with(&scene, &atlas, &settings(), &work, &Silent).unwrap();
        let full = illuminate(&scene, &atlas, &settings(), &Silent).unwrap();
        let (rms, bias) = differences(&again, &full);
        let rays = |lit: &Illuminated| lit.direct.rays + lit.gathered.rays + lit.exposure.rays;
        println!("{what}: rms {:.3} %, bias {:+.3} %", 100.0 * rms, 100.0 * bias);
        assert!(rms < 0.02 && bias.abs() < 0.003, "{what}: {rms} {bias}");
        assert!((again.energy.imbalance - full.energy.imbalance).abs() < 0.005, "{what}");
        assert!(again.exposure.rays < full.exposure.rays / 2, "{what}: {} of {} rays", rays(&again), rays(&full));
        assert_eq!(again.exposure.cells, full.exposure.cells, "{what}: what lies in the open");
    }
}

#[test]
fn a_narrow_gap_beside_what_came_is_as_dark_as_anew() {
    let folder = Folder::new("gap");
    let store = Store::open(&folder.0).unwrap();
    let one: Thing = ("one", [1.4, 0.0, 1.6], [0.8, 0.8, 0.8]);
    let two: Thing = ("two", [2.25, 0.0, 1.6], [0.8, 0.8, 0.8]);
    let before = furnished(&[one, SHELF]);
    let (atlas, earlier, _) = laid_out(&before, &params(), None);
    let work = Work::new(&store, base(&before, &atlas), None, Duration::MAX);
    let first = illuminate_with(&before, &atlas, &settings(), &work, &Silent).unwrap();
    let scene = furnished(&[one, SHELF, two]);
    let (atlas_now, ..) = laid_out(&scene, &params(), Some(&earlier));
    let now = State::new(&scene, &atlas_now, base(&scene, &atlas_now), &[]);
    let (key, change) = now.since(&state(&before, &atlas, &first)).unwrap();
    let work = Work::new(&store, base(&scene, &atlas_now), None, Duration::MAX).after(key, change);
    let again = illuminate_with(&scene, &atlas_now, &settings(), &work, &Silent).unwrap();
    let full = illuminate(&scene, &atlas_now, &settings(), &Silent).unwrap();
    let paths = Settings { method: Method::Path, samples: Some(512), ..settings() };
    let truth = illuminate(&scene, &atlas_now, &paths, &Silent).unwrap();
    // The deepest third of the two faces, which see little but each other.
    let in_gap = |i: usize| {
        let p = full.patches.position[i];
        (2.19..2.26).contains(&p.x) && (0.2..0.5).contains(&p.y) && (1.9..2.1).contains(&p.z)
    };
    let mean = |lit: &Illuminated| {
        let open = (0..lit.patches.len()).filter(|&i| in_gap(i));
        let (sum, area) = open.fold((0.0, 0.0), |(sum, area), i| {
            let a = lit.patches.area[i];
            (sum + a * luminance(lit.gathered.irradiance[i]), area + a)
        });
        sum / area
    };
    let [again, full, truth] = [&again, &full, &truth].map(mean);
    println!("in the gap: {again} after, {full} anew, {truth} by paths");
    assert!(again < 1.5 * full.max(truth), "{again} {full} {truth}");
}

/// A folder with the scene `room.gltf`: a floor and cubes of the sizes given, each of its own mesh.
fn write_scene(folder: &Path, cubes: &[(&str, [f32; 3], f32)]) -> PathBuf {
    let mut bin: Vec<u8> = Vec::new();
    let corners: Vec<[f32; 3]> = (0..8).map(|k| [(k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2 & 1) as f32]).collect();
    let faces: [[u16; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    corners.iter().flatten().for_each(|v| bin.extend(v.to_le_bytes()));
    faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, a, c, d]).for_each(|i| bin.extend(i.to_le_bytes()));
    fs::write(folder.join("room.bin"), &bin).unwrap();
    let mesh = r#"{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}"#;
    let node = |(k, (name, at, side)): (usize, &(&str, [f32; 3], f32))| {
        format!(r#"{{"name":"{name}","mesh":{k},"translation":{at:?},"scale":[{side},{side},{side}]}}"#)
    };
    let nodes: Vec<String> = cubes.iter().enumerate().map(node).collect();
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_lights_punctual"],
        "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","intensity":400}}]}}}},
        "scene":0,"scenes":[{{"nodes":{numbers:?}}}],"meshes":[{meshes}],
        "nodes":[{nodes},{{"name":"lamp","translation":[2.0,4.5,1.0],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
        "materials":[{{"pbrMetallicRoughness":{{"metallicFactor":0}}}}],
        "buffers":[{{"uri":"room.bin","byteLength":{size}}}],
        "bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":72}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}},
        {{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}]}}"#,
        numbers = (0..=cubes.len()).collect::<Vec<_>>(),
        meshes = vec![mesh; cubes.len()].join(","),
        nodes = nodes.join(","),
        size = bin.len(),
    );
    let path = folder.join("room.gltf");
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_bake_after_objects_came_and_went_says_what_it_kept() {
    let folder = Folder::new("files");
    let floor = ("floor", [-4.0, -8.0, -4.0], 8.0);
    let (one, two, three) =
        (("one", [0.0, 0.0, 0.0], 1.0), ("two", [2.5, 0.0, 0.5], 0.7), ("three", [-2.0, 0.0, 1.0], 0.8));
    let settings = Settings { density: Some(6.0), cache: Some(folder.0.join("cache")), ..settings() };
    let out = folder.0.join("out");
    let run = |cubes: &[(&str, [f32; 3], f32)], settings: &Settings| {
        let scene = write_scene(&folder.0, cubes);
        let report = bake(&scene, &out, settings, &Silent).unwrap();
        (report, fs::read(out.join("lightmaps/room_0.exr")).unwrap())
    };
    let kept = |report: &lumel::pipeline::Report| report.reused.get("places").map(|t| [t.reused, t.anew]);
    let (first, page) = run(&[floor, one, two], &settings);
    assert_eq!(kept(&first), None, "nothing was there before");
    let (again, same) = run(&[floor, one, two], &settings);
    assert_eq!(kept(&again), Some([3, 0]));
    assert!(page == same, "the same scene is the same file");
    let (more, _) = run(&[floor, one, three, two], &settings);
    assert_eq!(kept(&more), Some([3, 1]));
    let (fewer, _) = run(&[floor, two], &settings);
    assert_eq!(kept(&fewer), Some([2, 0]));
    // What this bake didn't use goes once there is too much of it; what it did use stays.
    let kinds = |kind: &str| {
        Store::open(&folder.0.join("cache")).unwrap().survey().unwrap().items.iter().filter(|i| i.kind == kind).count()
    };
    assert_eq!(kinds("links"), 3);
    let (_, _) = run(&[floor, two], &Settings { cache_limit: Some(0), ..settings.clone() });
    assert_eq!([kinds("links"), kinds("state"), kinds("charts")], [1, 1, 1]);
    let (fresh, _) = run(&[floor, two], &Settings { fresh_places: true, ..settings.clone() });
    assert_eq!(kept(&fresh), None);
}
