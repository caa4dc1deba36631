//! What of a light is baked, and its group, as files and settings say it.

mod files;
mod gltf_document;
mod usd_stage;

use files::Folder;
use lumel::load::{Edits, LampEdit, LoadOptions, MaterialEdit, load_with};
use lumel::scene::contribution::BakeMode;
use lumel::scene::{Contribution, Environment};
use serde_json::{Value, json};
use usd_stage::{METRES, SQUARE, load_text, warned};

/// A square with a glowing material, and a lamp on a node below another one, each with extras.
fn document(f: &Folder, [node, light, below, material]: [Value; 4]) -> Value {
    let mut builder = gltf_document::Builder::default();
    let positions = builder.floats(&[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    f.write("lamp.bin", &builder.bin);
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "extras": light }] } },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "name": "floor", "mesh": 0 },
            { "name": "lamps", "children": [2], "extras": node },
            { "name": "lamp", "extensions": { "KHR_lights_punctual": { "light": 0 } }, "extras": below },
        ],
        "materials": [{ "name": "glow", "emissiveFactor": [1, 1, 1], "extras": material }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": positions }, "material": 0 }] }],
        "accessors": builder.accessors,
        "bufferViews": builder.views,
        "buffers": [{ "byteLength": builder.bin.len(), "uri": "lamp.bin" }],
    })
}

fn lumel(value: Value) -> Value {
    json!({ "lumel": value })
}

fn summary(contribution: &Contribution) -> (BakeMode, Option<&str>) {
    (contribution.mode(), contribution.group.as_deref())
}

#[test]
fn extras_of_nodes_go_before_those_of_lights() {
    let f = Folder::new("extras");
    let load = |extras: [Value; 4], edits: Edits| {
        let path = f.write("lamp.gltf", document(&f, extras).to_string());
        load_with(&path, &LoadOptions { edits, ..LoadOptions::default() })
    };
    let light = lumel(json!({ "bake": "dynamic", "group": "far" }));
    let node = lumel(json!({ "bake": "indirect", "realtime": "direct", "baked": true }));
    let own = lumel(json!({ "group": "near", "shadowMask": true }));
    let none = || json!({});
    let glow = lumel(json!({ "group": "glow" }));
    for (node, below, expected) in [
        (none(), none(), (BakeMode::Dynamic, Some("far"))),
        (node.clone(), none(), (BakeMode::Indirect, Some("far"))),
        (node.clone(), own.clone(), (BakeMode::Indirect, Some("near"))),
    ] {
        let loaded = load([node, light.clone(), below, glow.clone()], Edits::default()).unwrap();
        assert_eq!(summary(&loaded.scene.lights[0].contribution), expected);
        assert_eq!(summary(&loaded.scene.materials[0].contribution), (BakeMode::Baked, Some("glow")));
    }
    // Patterns go before the file.
    let lamp = LampEdit { name: "lamp".into(), bake: Some(BakeMode::Baked), ..LampEdit::default() };
    let edits = Edits {
        lamps: vec![lamp],
        materials: vec![MaterialEdit { name: "glow".into(), group: Some("other".into()), ..MaterialEdit::default() }],
        ..Edits::default()
    };
    let loaded = load([node, none(), own, glow], edits).unwrap();
    assert_eq!(summary(&loaded.scene.lights[0].contribution), (BakeMode::Baked, Some("near")));
    assert_eq!(loaded.scene.lights[0].contribution.shadow_mask, Some(true));
    assert_eq!(summary(&loaded.scene.materials[0].contribution), (BakeMode::Baked, Some("other")));
    // A glow can't be left out.
    let dynamic = lumel(json!({ "bake": "dynamic" }));
    let loaded = load([none(), none(), none(), dynamic], Edits::default()).unwrap();
    assert!(loaded.warnings.iter().any(|w| w.message.contains("not dynamic")));
    assert_eq!(loaded.scene.materials[0].contribution.mode(), BakeMode::Baked);
    for (wrong, said) in [
        (json!({ "bake": "sometimes" }), "indirect"),
        (json!({ "bake": 1 }), "indirect"),
        (json!({ "group": "a/b" }), "characters"),
        (json!({ "group": 3 }), "no name"),
        (json!({ "shadowMask": "yes" }), "true or false"),
    ] {
        let error = load([lumel(wrong.clone()), none(), none(), none()], Edits::default()).unwrap_err();
        assert!(error.to_string().contains(said), "{wrong}: {error}");
    }
}

#[test]
fn attributes_of_prims_are_inherited() {
    let lamps = r#"def Scope "lamps" {
    token lumel:bake = "indirect"
    string lumel:group = "hall"
    def SphereLight "a" { }
    def SphereLight "b" { token lumel:bake = "dynamic" bool lumel:shadowMask = 0 }
    def SphereLight "c" { string lumel:group = "a.b" token lumel:bake = "never" }
}
def DomeLight "sky" { token lumel:bake = "indirect" }
def DomeLight "other" { string lumel:group = "night" }
"#;
    let loaded = load_text("contributions", &format!("{METRES}{lamps}\ndef Mesh \"m\" {{ {SQUARE} }}"));
    let of = |name: &str| {
        let light = loaded.scene.lights.iter().find(|l| l.name == format!("/lamps/{name}")).unwrap();
        summary(&light.contribution)
    };
    assert_eq!(of("a"), (BakeMode::Indirect, Some("hall")));
    assert_eq!(of("b"), (BakeMode::Dynamic, Some("hall")));
    assert_eq!(of("c"), (BakeMode::Indirect, Some("hall")));
    assert!(warned(&loaded, "characters", "/lamps/c") && warned(&loaded, "none of baked", "/lamps/c"));
    // Domes stay apart, each with its name, so that each can be marked.
    let skies: Vec<(&str, BakeMode)> = loaded
        .scene
        .environment
        .iter()
        .flat_map(Environment::each)
        .map(|s| (&*s.name, s.contribution.mode()))
        .collect();
    assert_eq!(skies, [("/sky", BakeMode::Indirect), ("/other", BakeMode::Baked)]);
}

#[test]
fn wrong_settings_are_refused() {
    let complaint = |edits: Edits| edits.check().unwrap_err().to_string();
    let lamp = LampEdit { name: "*".into(), group: Some("a b".into()), ..LampEdit::default() };
    assert!(complaint(Edits { lamps: vec![lamp], ..Edits::default() }).contains("characters"));
    let glow = MaterialEdit { name: "*".into(), bake: Some(BakeMode::Dynamic), ..MaterialEdit::default() };
    assert!(complaint(Edits { materials: vec![glow], ..Edits::default() }).contains("not dynamic"));
}
