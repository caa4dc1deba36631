//! Other light for a bake: as a bake in that light would have it, without tracing between surfaces, and never of anything else.

mod files;
mod support;

use files::Folder;
use glam::Vec3;
use lumel::color::{Rgb, luminance};
use lumel::compare::{Comparison, Page, compare, read_layers, read_page};
use lumel::illuminate::kept::{add_base, has_links};
use lumel::illuminate::{Illuminated, illuminate_with};
use lumel::load::units::blackbody_rgb;
use lumel::post::LayerKind;
use lumel::progress::Silent;
use lumel::scene::{Light, LightShape, Material, Scene, Texels, Texture};
use lumel::settings::{Gather, Normals, Relight, Settings};
use lumel::store::{Key, Store};
use lumel::unwrap::Atlas;
use lumel::work::{Tally, Work};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use support::measure::{Case, off, stated, sunroom};

/// Error that is asked for [%].
const ERROR: f64 = 2.0;

/// A room with sun, sky, two lamps, and a panel that glows.
fn world() -> Case {
    let mut case = sunroom(20);
    let lamp = |name: &str, position: [f32; 3], intensity: f32| {
        let position = Vec3::from(position);
        Light::new(name, LightShape::Point { position, intensity: Rgb::splat(intensity), range: None })
    };
    case.scene.lights.push(lamp("reading", [1.0, 1.5, 3.0], 30.0));
    case.scene.lights.push(lamp("candle", [3.0, 0.6, 1.0], 6.0));
    // The ceiling, whose quad is the second.
    case.scene.materials[1].emission = Rgb::splat(2.0);
    case
}

fn settings(seed: u32, error: f64) -> Settings {
    let (gather, normals) = (Gather::Blocks, Normals::Geometric);
    Settings { gather, normals, seed, error: Some(error), ..Settings::default() }
}

/// The light of `scene`, with what is in the store, and how much of it was.
fn light(
    scene: &Scene,
    atlas: &Atlas,
    settings: &Settings,
    store: &Store,
) -> lumel::Result<(Illuminated, BTreeMap<String, Tally>)> {
    let base = Key::of("base", |hasher| add_base(hasher, scene, atlas));
    let work = Work::new(store, base, None, Duration::MAX);
    let found = illuminate_with(scene, atlas, settings, &work, &Silent)?;
    Ok((found, work.tally()))
}

/// The same by what blocks saw in other light alone.
fn relit(scene: &Scene, atlas: &Atlas, store: &Store) -> lumel::Result<(Illuminated, BTreeMap<String, Tally>)> {
    light(scene, atlas, &Settings { relight: Some(Relight::default()), ..settings(0, ERROR) }, store)
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        match entry.path().is_dir() {
            true => copy(&entry.path(), &to.join(entry.file_name())),
            false => drop(fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}

fn strength(light: &mut Light) -> &mut Rgb {
    match &mut light.shape {
        LightShape::Point { intensity, .. } => intensity,
        LightShape::Directional { illuminance, .. } => illuminance,
        other => panic!("{other:?}"),
    }
}

fn reused(tally: &BTreeMap<String, Tally>, kind: &str) -> [u64; 2] {
    let Tally { reused, anew } = tally.get(kind).copied().unwrap_or_default();
    [reused, anew]
}

/// A name, what becomes of the light, and how many units of direct light are traced for it.
type Change = (&'static str, fn(&mut Scene), u64);

const CHANGES: [Change; 10] = [
    ("nothing", |_| (), 0),
    ("a sun of another colour and strength", |scene| *strength(&mut scene.lights[0]) = Rgb::new(400.0, 250.0, 90.0), 0),
    // Of no light there is nothing to trace.
    ("a lamp that is off", |scene| *strength(&mut scene.lights[2]) = Rgb::ZERO, 1),
    ("a lamp of another temperature", |scene| *strength(&mut scene.lights[1]) = blackbody_rgb(2400.0) * 60.0, 0),
    ("another glow", |scene| scene.materials[1].emission = Rgb::new(1.8, 1.3, 0.9), 0),
    ("a darker floor", |scene| scene.materials[0].albedo = Rgb::new(0.3, 0.2, 0.1), 0),
    ("a sky with a picture", sky_with_a_picture, 1),
    ("a moved lamp", |scene| shift(&mut scene.lights[1], Vec3::new(1.5, 0.4, -1.0)), 1),
    (
        "a new lamp",
        |scene| {
            let (u, v) = (Vec3::X * 0.4, Vec3::Z * -0.3);
            let center = Vec3::new(2.0, 2.2, 2.0);
            scene.lights.push(Light::new("new", LightShape::Rect { center, u, v, radiance: Rgb::splat(150.0) }));
        },
        1,
    ),
    (
        "all at once",
        |scene| {
            *strength(&mut scene.lights[0]) *= 0.7;
            *strength(&mut scene.lights[2]) *= 3.0;
            scene.materials[2].albedo = Rgb::new(0.1, 0.5, 0.7);
            shift(&mut scene.lights[1], Vec3::X);
        },
        1,
    ),
];

fn shift(light: &mut Light, by: Vec3) {
    let LightShape::Point { position, .. } = &mut light.shape else { panic!("no point") };
    *position += by;
}

fn sky_with_a_picture(scene: &mut Scene) {
    let (width, height) = (32, 16);
    let texel = |k: u32| [4.0, 5.0, 2.0 + 8.0 * (k / width) as f32 / 16.0, 1.0];
    let texels = Texels::Float((0..width * height).map(texel).collect());
    scene.textures.push(Texture { name: "sky".into(), width, height, texels });
    let sky = scene.environment.as_mut().unwrap();
    (sky.texture, sky.radiance) = (Some(0), Rgb::ONE);
}

#[test]
fn a_sky_that_was_not_there_is_seen_and_one_that_goes_needs_no_new_look() {
    let (folder, case) = (Folder::new("sky"), world());
    let store = Store::open(&folder.0).unwrap();
    let mut without = case.scene.clone();
    without.environment = None;
    light(&without, &case.atlas, &settings(0, ERROR), &store).unwrap();
    assert!(relit(&case.scene, &case.atlas, &store).is_err(), "what blocks saw ends where the sky would be");
    let (warm, _) = light(&case.scene, &case.atlas, &settings(0, ERROR), &store).unwrap();
    let fine = Settings { layers: vec![LayerKind::Error], ..settings(5, ERROR / 3.0) };
    let (truth, _) = light(&case.scene, &case.atlas, &fine, &Store::none()).unwrap();
    let off = off(&warm, &truth, &|_| false);
    println!("a sky that came: {off}");
    assert!(off.rms < 0.04 && off.bias.abs() < 0.01, "{off}");
    // Two looks now: that without a sky, and that with one, which any other serves.
    let mut other = case.scene.clone();
    other.environment = Some(lumel::scene::Environment::constant("other", Rgb::splat(30.0)));
    assert!(relit(&other, &case.atlas, &store).is_ok());
    let folder = Folder::new("sky-gone");
    let store = Store::open(&folder.0).unwrap();
    light(&case.scene, &case.atlas, &settings(0, ERROR), &store).unwrap();
    let (dark, tally) = relit(&without, &case.atlas, &store).unwrap();
    let (truth, _) = light(&without, &case.atlas, &fine, &Store::none()).unwrap();
    assert_eq!(reused(&tally, "links"), [1, 0]);
    let off = support::measure::off(&dark, &truth, &|_| false);
    println!("a sky that went: {off}");
    assert!(off.rms < 0.05 && off.bias.abs() < 0.015, "{off}");
}

#[test]
fn every_change_is_as_a_bake_in_that_light() {
    let (folder, case) = (Folder::new("changes"), world());
    let first = folder.0.join("first");
    light(&case.scene, &case.atlas, &settings(0, ERROR), &Store::open(&first).unwrap()).unwrap();
    for (name, change, traced) in CHANGES {
        let copied = folder.0.join(name);
        copy(&first, &copied);
        let mut scene = case.scene.clone();
        change(&mut scene);
        let (found, tally) = relit(&scene, &case.atlas, &Store::open(&copied).unwrap()).unwrap();
        assert_eq!(reused(&tally, "links"), [1, 0], "{name}: nothing looks around");
        assert_eq!(reused(&tally, "openings"), [1, 0], "{name}");
        assert!(!tally.contains_key("look"), "{name}: {tally:?}");
        let [kept, anew] = reused(&tally, "direct");
        let fine = Settings { layers: vec![LayerKind::Error], ..settings(5, ERROR / 3.0) };
        let (truth, _) = light(&scene, &case.atlas, &fine, &Store::none()).unwrap();
        let (off, stated, balance) = (off(&found, &truth, &|_| false), stated(&found), found.energy.imbalance);
        println!("{name}: {off}; stated {:.2}, balance {:+.2} %; {kept} kept", 100.0 * stated, 100.0 * balance);
        assert_eq!(anew, traced, "{name}: direct light of {kept} kept");
        assert!(off.rms < 1.25 * stated + 0.002 && off.bias.abs() < 0.01, "{name}: {off}, stated {stated}");
        assert!(balance.abs() < 0.01, "{name}: {balance}");
        assert!(stated < 2.0 * ERROR / 100.0, "{name}: {stated}");
    }
}

fn bits(found: &Illuminated) -> Vec<[u32; 3]> {
    found.lightmap.pages[0].rgb.iter().map(|v| v.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_lamp_off_and_on_again_is_as_it_was() {
    let (folder, case) = (Folder::new("again"), world());
    let store = Store::open(&folder.0).unwrap();
    let (first, _) = light(&case.scene, &case.atlas, &settings(0, ERROR), &store).unwrap();
    let mut dark = case.scene.clone();
    *strength(&mut dark.lights[2]) = Rgb::ZERO;
    let (without, _) = relit(&dark, &case.atlas, &store).unwrap();
    assert_ne!(bits(&without), bits(&first));
    let (again, tally) = relit(&case.scene, &case.atlas, &store).unwrap();
    assert_eq!(reused(&tally, "direct")[1], 0);
    assert_eq!(bits(&again), bits(&first));
}

#[test]
fn nothing_is_read_of_anything_else() {
    let (folder, case) = (Folder::new("else"), world());
    let store = Store::open(&folder.0).unwrap();
    light(&case.scene, &case.atlas, &settings(0, ERROR), &store).unwrap();
    let is_known = |scene: &Scene, atlas: &Atlas, settings: &Settings| {
        let base = Key::of("base", |hasher| add_base(hasher, scene, atlas));
        has_links(scene, &Work::new(&store, base, None, Duration::MAX), settings)
    };
    let own = settings(0, ERROR);
    assert!(is_known(&case.scene, &case.atlas, &own));
    let mut moved = case.scene.clone();
    moved.meshes[0].positions[0].y += 1e-3;
    let mut denser = case.atlas.clone();
    denser.placements[0].offset.x += 1e-3;
    let mut two_sided = case.scene.clone();
    two_sided.materials[0] = Material { double_sided: true, ..two_sided.materials[0].clone() };
    for (what, scene, atlas) in
        [("geometry", &moved, &case.atlas), ("texels", &case.scene, &denser), ("sides", &two_sided, &case.atlas)]
    {
        assert!(!is_known(scene, atlas, &own), "{what}");
        let error = relit(scene, atlas, &store).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("bake anew"), "{what}: {error}");
    }
    for (what, other) in [
        ("seed", settings(1, ERROR)),
        ("error", settings(0, 1.9)),
        ("normals", Settings { normals: Normals::Shading, ..own.clone() }),
    ] {
        assert!(!is_known(&case.scene, &case.atlas, &other), "{what}");
    }
    // What changes nothing of what is seen.
    let wants = Settings { max_bounces: Some(1), bake_lights: lumel::scene::BakeMode::Indirect, ..own };
    assert!(is_known(&case.scene, &case.atlas, &wants));
}

fn lumel(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_lumel")).args(args).current_dir(folder).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[track_caller]
fn done(folder: &Path, args: &[&str]) {
    let (code, stderr) = lumel(folder, args);
    assert_eq!(code, Some(0), "{args:?}: {stderr}");
}

#[track_caller]
fn refused(folder: &Path, args: &[&str], words: &[&str]) {
    let (code, stderr) = lumel(folder, args);
    assert_eq!(code, Some(1), "{args:?}: {stderr}");
    words.iter().for_each(|word| assert!(stderr.contains(word), "{args:?}: {word}: {stderr}"));
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap()
}

/// A copy of the Cornell box in `folder`.
fn cornell_box(folder: &Folder) -> PathBuf {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.glb");
    folder.write("box.glb", fs::read(sample).unwrap())
}

const BAKE: [&str; 8] = ["bake", "box.glb", "-o", "baked", "--resolution", "64", "--error", "5%"];
const PAGE: &str = "lightmaps/box_0.exr";

#[test]
fn the_command_relights_a_folder() {
    let folder = Folder::new("command");
    cornell_box(&folder);
    let (dir, baked) = (folder.0.as_path(), folder.0.join("baked"));
    done(dir, &BAKE);
    let first = fs::read(baked.join(PAGE)).unwrap();
    folder.write(
        "evening.toml",
        "[[materials]]\nname = \"lamp\"\nemission-scale = 0.25\n[[materials]]\nname = \"red\"\nalbedo = [0.1, 0.1, 0.6]\n\
         [[lamps]]\nname = \"lantern\"\nadd = \"spot\"\nposition = [0.0, 0.9, 1.0]\ndirection = [0.0, -1.0, -1.0]\n\
         intensity = 2.0\ntemperature = 2700.0\n",
    );
    let relight = ["relight", "baked", "--config", "evening.toml"];
    done(dir, &relight);
    let (evening, told) = (fs::read(baked.join(PAGE)).unwrap(), report(&baked));
    assert_ne!(evening, first);
    assert_eq!(told["reused"]["links"], serde_json::json!({ "reused": 1, "anew": 0 }), "{}", told["reused"]);
    assert_eq!(told["reused"]["direct"], serde_json::json!({ "reused": 1, "anew": 1 }), "{}", told["reused"]);
    assert!(told["stages"].as_array().unwrap().iter().all(|stage| stage["name"] != "links"));
    assert!(told["relit"].is_object() && told["error"]["estimated"].as_f64().unwrap() > 0.0);
    assert!(told["energy"]["imbalance"].as_f64().unwrap().abs() < 0.02, "{}", told["energy"]);

    // The same again is the same, and no other light is the first: tables don't heap up.
    done(dir, &relight);
    assert!(fs::read(baked.join(PAGE)).unwrap() == evening);
    done(dir, &["relight", "baked/report.json"]);
    assert!(fs::read(baked.join(PAGE)).unwrap() == first);
    // Into another folder, by the GLB; the bake stays as it is.
    done(dir, &["relight", "baked/box.glb", "--config", "evening.toml", "-o", "evening"]);
    assert!(fs::read(folder.0.join("evening").join(PAGE)).unwrap() == evening);
    assert!(fs::read(baked.join(PAGE)).unwrap() == first);

    // Light from where the bake had none is found too roughly, which is told.
    folder.write(
        "corner.toml",
        "[[materials]]\nname = \"lamp\"\nemission-scale = 0.0\n[[lamps]]\nname = \"corner\"\nadd = \"point\"\n\
         position = [0.02, 0.02, 0.02]\nintensity = 5.0\n",
    );
    done(dir, &["relight", "baked", "--config", "corner.toml", "-o", "corner"]);
    let told = report(&folder.0.join("corner"));
    assert!(told["error"]["estimated"].as_f64().unwrap() > 6.0, "{}", told["error"]);
    assert!(told["warnings"].to_string().contains("less of this one than was asked for"), "{}", told["warnings"]);

    // As a bake of these settings has it, which knows what the relit one knew.
    done(dir, &["bake", "box.glb", "-o", "full", "--resolution", "64", "--error", "1%", "--config", "evening.toml"]);
    let pages = ["evening", "full"].map(|name| read_page(&folder.0.join(name).join(PAGE)).unwrap());
    let off = figures(&pages[0], &pages[1]);
    assert!(off.rel_rmse_trim < 0.06 && off.bias.abs() < 0.02, "{off:?}");
}

#[test]
fn the_command_says_what_is_missing() {
    let folder = Folder::new("missing");
    let scene = cornell_box(&folder);
    let dir = folder.0.as_path();
    refused(dir, &["relight", "."], &["report.json"]);
    done(dir, &BAKE);
    refused(dir, &["relight", "baked", "--seams", "off", "--normals", "geometric"], &["bake first", "--normals"]);
    folder.write("other.toml", "method = \"path\"\n");
    let (code, stderr) = lumel(dir, &["relight", "baked", "--config", "other.toml"]);
    assert!(code != Some(0) && stderr.contains("error"), "{stderr}");

    fs::rename(folder.0.join("baked/.lumel"), folder.0.join("kept")).unwrap();
    refused(dir, &["relight", "baked"], &["bake first", "lumel bake box.glb -o baked", "--resolution 64", "--or-bake"]);
    done(dir, &["relight", "baked", "--cache", "kept"]);
    // Paths of the report are found from below the folder in which the bake was run.
    fs::create_dir_all(folder.0.join("a/b")).unwrap();
    done(&folder.0.join("a/b"), &["relight", "../../baked", "--cache", "../../kept"]);
    done(dir, &["relight", "baked", "--or-bake", "-o", "other"]);
    assert!(report(&folder.0.join("other"))["relit"].is_null(), "a bake");

    // A vertex that moved: the positions come first in the file's binary part.
    let mut bytes = fs::read(&scene).unwrap();
    let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    bytes[20 + json + 8 + 2] ^= 0x10;
    fs::write(&scene, bytes).unwrap();
    refused(dir, &["relight", "baked", "--cache", "kept"], &["has changed", "bake anew"]);
    // The GLB of the bake, which has its name, isn't taken for the scene.
    fs::rename(&scene, folder.0.join("moved.glb")).unwrap();
    refused(&folder.0.join("baked"), &["relight", "."], &["box.glb", "--scene"]);
    refused(dir, &["relight", "baked"], &["box.glb", "--scene"]);
}

fn figures(a: &Page, b: &Page) -> Comparison {
    compare(a, b, "pages").unwrap()
}

/// Two lamps beside the box's own, in groups.
fn groups(fill: f32, color: &str, sun: f32) -> String {
    format!(
        "layers = [\"light-groups\", \"ao\", \"direct\"]\nencoding = [\"exr\", \"rgbm\"]\n\
         [[lamps]]\nname = \"fill\"\nadd = \"point\"\nposition = [0.3, 0.5, 0.8]\nintensity = {fill}\ncolor = {color}\n\
         group = \"lamps\"\n[[lamps]]\nname = \"sun\"\nadd = \"sun\"\ndirection = [0.2, -0.4, -1.0]\nintensity = {sun}\n\
         group = \"day\"\n"
    )
}

#[test]
fn the_command_mixes_light_groups() {
    let folder = Folder::new("mix");
    cornell_box(&folder);
    let dir = folder.0.as_path();
    folder.write("bright.toml", groups(2.0, "[1.0, 1.0, 1.0]", 4.0));
    let bake = |output: &'static str, config: &'static str| {
        done(dir, &["bake", "box.glb", "-o", output, "--resolution", "64", "--error", "2%", "--config", config]);
    };
    bake("baked", "bright.toml");
    let page = |name: &str| read_layers(&folder.0.join(name).join(PAGE)).unwrap();
    let (whole, layers) = page("baked");
    refused(dir, &["mix", "baked", "--weight", "lamp=1", "-o", "m"], &["lamp:", "day, lamps, ungrouped"]);
    refused(dir, &["mix", "baked", "-o", "baked"], &["another folder"]);

    // Weights of 1 are the page, but for what half floats leave of a few parts.
    done(dir, &["mix", "baked", "-o", "same"]);
    let (same, mixed) = page("same");
    for (i, (a, b)) in same.rgb.iter().zip(&whole.rgb).enumerate() {
        assert!((*a - *b).abs().max_element() <= 2e-3 * b.max_element() + 1e-6, "texel {i}: {a} is not {b}");
    }
    let names: Vec<&str> = mixed.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["group.day", "group.lamps", "group.ungrouped", "ao"]);
    let ao = |layers: &[lumel::compare::ReadLayer]| layers.iter().find(|l| l.name == "ao").unwrap().values.clone();
    assert_eq!(ao(&mixed), ao(&layers));
    let told = report(&folder.0.join("same"));
    assert!(told["warnings"].to_string().contains("direct"), "{}", told["warnings"]);
    assert_eq!(told["encodings"][0]["name"], "rgbm");
    for file in told["files"].as_array().unwrap() {
        assert!(folder.0.join("same").join(file.as_str().unwrap()).is_file(), "{file}");
    }

    // As a bake of lamps that are so strong. Luminance 1 of a colour is its weight by channel over its luminance.
    done(
        dir,
        &[
            "mix",
            "baked",
            "--weight",
            "lamps=0.5,0.25,0.125",
            "--weight",
            "day=0",
            "--weight",
            "ungrouped=2",
            "-o",
            "m",
        ],
    );
    let weight = luminance(Rgb::new(0.5, 0.25, 0.125));
    let own = "[[materials]]\nname = \"lamp\"\nemission-scale = 2.0\n";
    folder.write("dim.toml", groups(2.0 * weight, "[0.5, 0.25, 0.125]", 0.0) + own);
    bake("dim", "dim.toml");
    let off = figures(&page("m").0, &page("dim").0);
    assert!(off.rel_rmse_trim < 0.03 && off.bias.abs() < 0.01, "{off:?}");
    // What was mixed can be mixed again, of what it is now.
    done(dir, &["mix", "m", "--weight", "ungrouped=0.5", "-o", "again"]);
    let (day, again) = (page("m").0, page("again"));
    let lamps = &again.1.iter().find(|l| l.name == "group.lamps").unwrap().values;
    let expected = |i: usize| 0.5 * (day.rgb[i] - lamps[i]) + lamps[i];
    let worst = (0..day.rgb.len())
        .map(|i| (again.0.rgb[i] - expected(i)).abs().max_element() / day.rgb[i].max_element().max(1e-3));
    assert!(worst.fold(0.0, f32::max) < 5e-3);
    assert_eq!(report(&folder.0.join("m"))["mixed"][1]["group"], "day");
}
