//! `--verify`: bakes from memory held against ones that remember nothing.

mod command;
mod support;

use command::{Folder, stderr};
use lumel::color::Rgb;
use lumel::light::kept::KeptLight;
use lumel::store::Store;
use lumel::work::Stored;
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::sync::Arc;

const BASE: [&str; 8] = ["bake", "box.glb", "-o", "baked", "--resolution", "96", "--error", "2%"];

/// A folder with the Cornell box, which is baked.
fn baked(name: &str) -> Folder {
    let folder = Folder::new(name);
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.glb");
    folder.write("box.glb", std::fs::read(sample).unwrap());
    let output = folder.run(&[&BASE[..], &["--verify"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("nothing to verify"), "{}", stderr(&output));
    assert!(report(&folder)["verified"].is_null());
    folder
}

fn report(folder: &Folder) -> Value {
    serde_json::from_slice(&std::fs::read(folder.0.join("baked/report.json")).unwrap()).unwrap()
}

#[track_caller]
fn verified(folder: &Folder, output: &Output, holds: bool) -> [f64; 2] {
    let text = stderr(output);
    let told = report(folder)["verified"].clone();
    println!("{}", text.lines().find(|l| l.contains("erified:")).unwrap_or_default());
    assert_eq!(output.status.code(), Some(if holds { 0 } else { 3 }), "{text}");
    assert_eq!(told["holds"], holds, "{told}");
    assert_eq!(text.contains("NOT verified"), !holds, "{text}");
    assert_eq!(text.contains("warning: ") && text.contains("than noise explains"), !holds, "{text}");
    assert!(told["worst"]["name"].is_string() && told["noise"].as_f64().unwrap() > 0.5, "{told}");
    ["bias", "rms"].map(|figure| told[figure].as_f64().unwrap())
}

#[test]
fn a_warm_bake_is_verified_to_the_bit() {
    let folder = baked("warm");
    let output = folder.run(&[&BASE[..], &["--verify"]].concat());
    assert_eq!(verified(&folder, &output, true), [0.0, 0.0]);
}

#[test]
fn wrong_light_in_the_cache_is_found_though_its_checksum_is_right() {
    let folder = baked("tampered");
    let store = Store::open(&folder.0.join("baked/.lumel")).unwrap();
    let items = store.survey().unwrap().items;
    let texels = report(&folder)["texels"].as_u64().unwrap() as usize;
    let mut tampered = 0;
    for (kind, key) in items.into_iter().filter(|i| i.kind == "direct").map(|i| (i.kind, i.key.unwrap())) {
        let kept = store.read(&kind, key).unwrap().as_ref().and_then(KeptLight::restore).unwrap();
        let mut direct = kept.light(Rgb::ONE, texels).unwrap();
        // By less than anyone sees.
        direct.transport = Arc::new(direct.transport.iter().map(|e| *e * 1.03).collect());
        direct.shown = lumel::patch::Sparse::same(Arc::clone(&direct.transport));
        let wrong = KeptLight::new(&direct, Rgb::ONE, (kept.firsts.clone(), kept.means.clone()), kept.beside);
        let sections = wrong.sections();
        store.write(&kind, key, &sections.iter().map(AsRef::as_ref).collect::<Vec<&[u8]>>()).unwrap();
        tampered += 1;
    }
    assert!(tampered > 0 && store.verify(&lumel::progress::Silent).unwrap().is_empty(), "checksums are right");
    let output = folder.run(&[&BASE[..], &["--verify"]].concat());
    let [bias, _] = verified(&folder, &output, false);
    assert!((2.0..4.0).contains(&bias), "{bias}");
    // Without being asked it isn't looked at.
    assert_eq!(folder.run(&BASE).status.code(), Some(0));
}

#[test]
fn other_light_is_verified() {
    let folder = baked("relit");
    folder.write("dim.toml", "[[materials]]\nname = \"lamp\"\nemission = [6.0, 9.0, 14.0]\n");
    let output = folder.run(&["relight", "baked", "--config", "dim.toml", "--verify"]);
    let [bias, rms] = verified(&folder, &output, true);
    assert!(bias.abs() < 1.0 && rms > 0.0, "{bias} {rms}");
}

#[test]
fn of_selected_objects_these_alone_are_verified_and_stale_light_around_them_is_found() {
    let folder = baked("selected");
    let output = folder.run(&[&BASE[..], &["--only", "tall_block", "--verify"]].concat());
    verified(&folder, &output, true);
    let told = report(&folder);
    assert_eq!(told["verified"]["texels"].as_u64(), told["only"]["baked_texels"].as_u64());
    assert_eq!(told["verified"]["worst"]["name"], "tall_block");
    // The lamp has changed, and the pages of all that is kept have not.
    folder.write("bright.toml", "[[materials]]\nname = \"lamp\"\nemission-scale = 2.0\n");
    let output = folder.run(&[&BASE[..], &["--only", "tall_block", "--verify", "--config", "bright.toml"]].concat());
    let [bias, _] = verified(&folder, &output, false);
    assert!(bias < -5.0, "{bias}");
    // Nor is it verified in a given time.
    let output = folder.run(&[&BASE[..], &["--verify", "--time-budget", "5"]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
}
