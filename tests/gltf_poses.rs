//! Skins, morph targets and animations of glTF: closed forms, and what stays of them in the baked GLB.

mod files;
mod glb;
mod gltf_document;

use glam::{Quat, Vec3, Vec4};
use glb::Glb;
use gltf_document::{Builder, Folder, TRIANGLE, first_mesh, load, load_gltf, one, warned};
use lumel::load::{LoadOptions, Loaded};
use serde_json::{Value, json};
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use std::process::Command;

fn load_at(folder: &Folder, bytes: &[u8], time: Option<f64>, animation: Option<&str>) -> lumel::Result<Loaded> {
    let options = LoadOptions { time, animation: animation.map(str::to_owned), ..LoadOptions::default() };
    lumel::load::load_with(&folder.write("test.gltf", bytes), &options)
}

fn near(a: Vec3, b: Vec3) -> bool {
    a.abs_diff_eq(b, 1e-5)
}

/// A strip along Y of three pairs of vertices at 0, 1 and 2, bound to a root and to a joint at y = 1, half to each in the
/// middle. Nodes: 0 the mesh, 1 the root, 2 the joint.
fn bent(b: &mut Builder) -> Value {
    let positions: Vec<[f32; 3]> = (0..6).map(|i| [(i % 2) as f32, (i / 2) as f32, 0.0]).collect();
    let positions = b.floats(&positions);
    let normals = b.floats(&[[0.0, 0.0, 1.0]; 6]);
    let indices = b.indices(&[0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4]);
    let view = b.view(&[0, 1, 0, 0].repeat(6), None);
    let joints = b.accessor(json!({ "bufferView": view, "componentType": 5121, "count": 6, "type": "VEC4" }));
    // 8-bit weights, whose sums are not quite 1; the last vertex has none and follows its first joint.
    let weights = [[255u8, 0, 0, 0], [255, 0, 0, 0], [127, 127, 0, 0], [127, 127, 0, 0], [0, 255, 0, 0], [0, 0, 0, 0]];
    let view = b.view(&weights.concat(), None);
    let weights = b
        .accessor(json!({ "bufferView": view, "componentType": 5121, "normalized": true, "count": 6, "type": "VEC4" }));
    let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.0f32];
    let mut down = identity;
    down[13] = -1.0;
    let bytes: Vec<u8> = [identity, down].concat().iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = b.view(&bytes, None);
    let inverse = b.accessor(json!({ "bufferView": view, "componentType": 5126, "count": 2, "type": "MAT4" }));
    json!({
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "name": "strip", "mesh": 0, "skin": 0, "translation": [50, 0, 0] },
            { "name": "root", "children": [2], "translation": [0, 0, 3] },
            { "name": "joint", "translation": [0, 1, 0], "rotation": [0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2] },
        ],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": positions, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights },
            "indices": indices,
        }] }],
        "skins": [{ "joints": [1, 2], "inverseBindMatrices": inverse }],
    })
}

#[test]
fn a_skin_moves_vertices_by_its_joints_alone() {
    let folder = Folder::new("skin");
    let mut b = Builder::default();
    let document = bent(&mut b);
    let loaded = load(&folder, &b.gltf(document));
    let surface = &loaded.scene.surfaces[0];
    assert_eq!(surface.name, "strip");
    let at = |v: usize| surface.world_from_local.transform_point3(first_mesh(&loaded).positions[v]);
    // The root is at z = 3, whatever the mesh's own node says.
    assert!(near(at(1), Vec3::new(1.0, 0.0, 3.0)), "{}", at(1));
    // About (0, 1): (1, 1) turns to (0, 2) and stays half; (0, 2) turns to (-1, 1).
    assert!(near(at(3), Vec3::new(0.5, 1.5, 3.0)), "{}", at(3));
    assert!(near(at(4), Vec3::new(-1.0, 1.0, 3.0)), "{}", at(4));
    assert!(near(at(5), Vec3::new(1.0, 2.0, 3.0)), "no weights: {}", at(5));
    assert!(first_mesh(&loaded).normals.iter().all(|n| near(*n, Vec3::Z)));
    assert!(loaded.warnings.is_empty());
}

#[test]
fn a_joint_that_mirrors_turns_triangles_round() {
    let folder = Folder::new("mirror");
    let mut b = Builder::default();
    let mut document = bent(&mut b);
    document["nodes"][1]["scale"] = json!([-1, 1, 1]);
    let loaded = load(&folder, &b.gltf(document));
    let mesh = first_mesh(&loaded);
    let [a, c, d] = mesh.triangles[0].map(|v| mesh.positions[v as usize]);
    assert!((c - a).cross(d - a).z > 0.0, "the front is still at +Z");
    assert!(near(mesh.normals[0], Vec3::Z));
    assert_eq!(mesh.origin[0].corners, [0, 2, 1]);
}

#[test]
fn broken_skins_are_errors() {
    let folder = Folder::new("bad_skin");
    let refuse = |change: &dyn Fn(&mut Value)| {
        let mut b = Builder::default();
        let mut document = bent(&mut b);
        change(&mut document);
        load_gltf(&folder.write("t.gltf", b.gltf(document))).unwrap_err().to_string()
    };
    assert!(refuse(&|d| d["skins"][0]["joints"] = json!([1])).contains("names a joint beyond the 1 of its skin"));
    assert!(refuse(&|d| d["skins"][0]["joints"] = json!([1, 9])).contains("no node"));
    assert!(refuse(&|d| d["skins"][0]["joints"] = json!([])).contains("no joints"));
    assert!(refuse(&|d| d["skins"][0]["joints"] = json!([0, 1, 2])).contains("inverse bind"));
    assert!(refuse(&|d| d["nodes"][0]["skin"] = json!(4)).contains("skins[4]"));
    let bare = |d: &mut Value| {
        d["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("WEIGHTS_0");
    };
    assert!(refuse(&bare).contains("joints with weights"));
    // Joints that hang in a loop outside of the scene.
    let looped = |d: &mut Value| {
        d["nodes"].as_array_mut().unwrap().extend([json!({ "children": [4] }), json!({ "children": [3] })]);
        d["skins"][0]["joints"] = json!([3, 2]);
    };
    assert!(refuse(&looped).contains("no node"));
}

/// A triangle with two targets: 0 lifts all by (0, 0, 2), quantized and sparse-free; 1 moves the first vertex by (-1, 0, 0)
/// through a sparse accessor without a view, and turns the normals.
fn morphed(b: &mut Builder) -> Value {
    let positions = b.floats(&TRIANGLE);
    let normals = b.floats(&[[0.0, 0.0, 1.0]; 3]);
    let uvs = b.floats(&[[0.0, 0.0]; 3]);
    let colors = b.floats(&[[0.25, 0.5, 0.5, 1.0]; 3]);
    // KHR_mesh_quantization: signed bytes as they stand, padded to 4.
    let view = b.view(&[0i8 as u8, 0, 2, 0].repeat(3), Some(4));
    let lift = b.accessor(json!({ "bufferView": view, "componentType": 5120, "count": 3, "type": "VEC3" }));
    let indices = b.view(&[0], None);
    let bytes: Vec<u8> = [-1.0f32, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = b.view(&bytes, None);
    let pull = b.accessor(json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
        "count": 1, "indices": { "bufferView": indices, "componentType": 5121 }, "values": { "bufferView": values } } }));
    let turn = b.floats(&[[1.0, 0.0, 0.0]; 3]);
    let slide = b.floats(&[[0.5, 0.25]; 3]);
    let tint = b.floats(&[[0.5, 0.0, 0.0, 0.0]; 3]);
    json!({
        "nodes": [{ "mesh": 0 }, { "mesh": 0, "weights": [0, 1] }, { "mesh": 0, "weights": [0.5, 0] }],
        "meshes": [{
            "weights": [0.5, 0],
            "primitives": [{
                "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "COLOR_0": colors },
                "targets": [{ "POSITION": lift },
                            { "POSITION": pull, "NORMAL": turn, "TEXCOORD_0": slide, "COLOR_0": tint }],
            }],
        }],
    })
}

#[test]
fn morph_targets_by_the_weights_of_node_or_mesh() {
    let folder = Folder::new("morph");
    let mut b = Builder::default();
    let document = morphed(&mut b);
    let loaded = load(&folder, &b.gltf(document));
    let scene = &loaded.scene;
    let meshes: Vec<usize> = scene.surfaces.iter().map(|s| s.mesh).collect();
    assert_eq!(meshes, [0, 1, 0], "nodes with one shape share their mesh");
    let (own, node) = (&scene.meshes[0], &scene.meshes[1]);
    assert_eq!(own.positions, TRIANGLE.map(|p| Vec3::from_array(p) + Vec3::Z));
    assert_eq!(own.normals, [Vec3::Z; 3]);
    assert_eq!(node.positions, [Vec3::NEG_X, Vec3::X, Vec3::Y]);
    assert!(near(node.normals[0], Vec3::new(FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2)));
    assert_eq!(node.uvs[0].coords[0].to_array(), [0.5, 0.25]);
    assert_eq!(node.colors[0], Vec4::new(0.75, 0.5, 0.5, 1.0));
    assert!(loaded.warnings.is_empty());
}

#[test]
fn targets_of_another_length_are_errors() {
    let folder = Folder::new("bad_morph");
    let mut b = Builder::default();
    let mut document = morphed(&mut b);
    let short = b.floats(&[[0.0, 0.0, 1.0]; 2]);
    document["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = json!(short);
    let error = load_gltf(&folder.write("t.gltf", b.gltf(document))).unwrap_err();
    assert!(error.to_string().contains("3 vertices and a morph target of 2"), "{error}");
}

/// A node that moves, turns and grows; another whose weights move; and a second animation.
fn animated(b: &mut Builder) -> Value {
    let mut document = morphed(b);
    let times = b.floats(&[[0.0], [2.0]]);
    let translation = b.floats(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]);
    let scale = b.floats(&[[1.0, 1.0, 1.0], [9.0, 9.0, 9.0]]);
    // A quarter turn about Z as normalized shorts.
    let quarter = (FRAC_1_SQRT_2 * 32767.0).round() as i16;
    let bytes: Vec<u8> = [0, 0, 0, 32767, 0, 0, quarter, quarter].iter().flat_map(|v: &i16| v.to_le_bytes()).collect();
    let view = b.view(&bytes, None);
    let rotation = b
        .accessor(json!({ "bufferView": view, "componentType": 5122, "normalized": true, "count": 2, "type": "VEC4" }));
    // Cubic: 0 to 1 with level tangents, for each of two weights.
    let weights = b.floats(&[[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [1.0], [1.0], [0.0], [0.0]]);
    let channel = |sampler: usize, node: usize, path: &str| json!({ "sampler": sampler, "target": { "node": node, "path": path } });
    document["nodes"] = json!([{ "name": "moved", "children": [1] }, { "mesh": 0 }]);
    document["scenes"] = json!([{ "nodes": [0] }]);
    document["animations"] = json!([
        { "name": "walk",
          "channels": [channel(0, 0, "translation"), channel(1, 0, "rotation"), channel(2, 0, "scale"), channel(3, 1, "weights"),
                       { "sampler": 0, "target": { "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": "/x" } } } }],
          "samplers": [{ "input": times, "output": translation },
                       { "input": times, "output": rotation, "interpolation": "LINEAR" },
                       { "input": times, "output": scale, "interpolation": "STEP" },
                       { "input": times, "output": weights, "interpolation": "CUBICSPLINE" }] },
        { "name": "jump", "channels": [channel(0, 0, "translation")], "samplers": [{ "input": times, "output": scale }] },
        { "channels": "broken, and of no concern" },
    ]);
    document
}

#[test]
fn animations_are_read_at_a_time() {
    let folder = Folder::new("animation");
    let mut b = Builder::default();
    let document = animated(&mut b);
    let bytes = b.gltf(document);
    let at = |time, name: Option<&str>| load_at(&folder, &bytes, time, name).unwrap();

    let rest = at(None, None);
    assert_eq!(Vec3::from(rest.scene.surfaces[0].world_from_local.translation), Vec3::ZERO);

    let half = at(Some(1.0), None);
    let world = half.scene.surfaces[0].world_from_local;
    assert!(near(world.translation.into(), Vec3::new(2.0, 0.0, 0.0)));
    let (_, rotation, _) = world.to_scale_rotation_translation();
    assert!(rotation.angle_between(Quat::from_rotation_z(FRAC_PI_2 / 2.0)) < 1e-3, "half of a quarter turn, unscaled");
    // Both weights are 1/2 halfway: up by 1, and the first vertex pulled by 1/2.
    assert!(near(first_mesh(&half).positions[0], Vec3::new(-0.5, 0.0, 1.0)));
    assert!(warned(&half, "channels of \"pointer\" are not read"));

    let end = at(Some(7.0), None).scene.surfaces[0].world_from_local;
    assert!(near(end.transform_vector3(Vec3::X), Vec3::Y * 9.0));

    let jump = at(Some(1.0), Some("jump")).scene.surfaces[0].world_from_local;
    assert!(near(jump.translation.into(), Vec3::splat(5.0)));
    assert_eq!(at(Some(1.0), Some("1")).scene.surfaces[0].world_from_local, jump, "by number");
    let first = at(None, Some("jump")).scene.surfaces[0].world_from_local;
    assert!(near(first.translation.into(), Vec3::ONE), "a name alone: at 0 s");

    let error = load_at(&folder, &bytes, Some(1.0), Some("run")).unwrap_err().to_string();
    assert!(error.contains("no animation \"run\"") && error.contains("0 \"walk\", 1 \"jump\""), "{error}");
}

#[test]
fn a_time_without_an_animation_is_said() {
    let folder = Folder::new("still");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let bytes = b.gltf(one(json!({ "attributes": { "POSITION": positions } })));
    assert!(warned(&load_at(&folder, &bytes, Some(1.0), None).unwrap(), "no animation"));
    assert!(load_at(&folder, &bytes, None, Some("walk")).unwrap_err().to_string().contains("there is: none"));
}

#[test]
fn broken_animations_are_errors_where_they_are_asked_for() {
    let folder = Folder::new("bad_animation");
    for (pointer, value, part) in [
        ("/animations/0/samplers/0/input", json!(99), "accessors[99]"),
        ("/animations/0/channels/0/sampler", json!(9), "no sampler 9"),
        ("/animations/0/samplers/0/output", json!(0), "other numbers of times and values"),
        ("/animations/0/samplers/1/output", json!(0), "wrong type"),
        ("/animations/0/samplers/0/interpolation", json!("SINE"), "SINE"),
    ] {
        let mut b = Builder::default();
        let mut document = animated(&mut b);
        match document.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => document["animations"][0]["samplers"][0]["interpolation"] = value,
        }
        let bytes = b.gltf(document);
        let error = load_at(&folder, &bytes, Some(1.0), None).unwrap_err().to_string();
        assert!(error.contains(part), "{pointer}: {error}");
        assert!(load_at(&folder, &bytes, None, None).is_ok(), "at rest it doesn't matter");
    }
}

/// The baked GLB of `bytes`, and what went in.
fn bake(folder: &Folder, bytes: &[u8], options: &[&str]) -> Glb {
    let scene = folder.write("posed.glb", bytes);
    let out = folder.0.join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
    command.args(["bake", "--quality", "draft", "--resolution", "64", "--sky", "1", "--overwrite"]).args(options);
    let done = command.arg(&scene).arg("-o").arg(&out).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    Glb::parse(&std::fs::read(out.join("posed.glb")).unwrap())
}

#[test]
fn the_baked_glb_keeps_skin_and_animation_and_gains_uvs() {
    let folder = Folder::new("keep_skin");
    let mut b = Builder::default();
    let mut document = bent(&mut b);
    let times = b.floats(&[[0.0], [2.0]]);
    let lift = b.floats(&[[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]]);
    document["animations"] = json!([{ "channels": [{ "sampler": 0, "target": { "node": 2, "path": "translation" } }],
                                      "samplers": [{ "input": times, "output": lift }] }]);
    document["scene"] = json!(0);
    let before = document.clone();
    let glb = bake(&folder, &b.glb(document), &["--time", "1"]);
    for key in ["skins", "animations"] {
        assert_eq!(glb.json[key], before[key], "{key}");
    }
    let attributes = &glb.json["meshes"][0]["primitives"][0]["attributes"];
    let number = |name: &str| attributes[name].as_u64().unwrap_or_else(|| panic!("no {name}")) as usize;
    // The bind pose, not the baked one; seams copy vertices, and those carry their joints with them.
    let positions = glb.rows(number("POSITION"), 3);
    let joints = glb.unsigned(number("JOINTS_0"));
    assert_eq!(joints.len(), 4 * positions.len());
    for (i, p) in positions.iter().enumerate().take(6) {
        assert_eq!(p[..], [(i % 2) as f32, (i / 2) as f32, 0.0]);
        assert_eq!(joints[4 * i..4 * i + 4], [0, 1, 0, 0]);
    }
    assert_eq!(glb.floats(number("TEXCOORD_1")).len(), 2 * positions.len());
    assert_eq!(glb.json["nodes"][0]["skin"], 0);
    assert!(glb.json["nodes"][0]["extras"]["lumel"]["scale"].is_array());
}

#[test]
fn nodes_with_unlike_shapes_get_meshes_of_their_own() {
    let folder = Folder::new("keep_morph");
    let mut b = Builder::default();
    let mut document = morphed(&mut b);
    for (i, node) in document["nodes"].as_array_mut().unwrap().iter_mut().enumerate() {
        node["translation"] = json!([3 * i, 0, 0]);
    }
    document["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    let glb = bake(&folder, &b.glb(document), &[]);
    let meshes: Vec<u64> = (0..3).map(|i| glb.json["nodes"][i]["mesh"].as_u64().unwrap()).collect();
    assert_eq!((meshes[0], meshes[0] == meshes[1]), (meshes[2], false));
    for mesh in &meshes {
        let primitive = &glb.json["meshes"][*mesh as usize]["primitives"][0];
        assert_eq!(primitive["targets"].as_array().unwrap().len(), 2, "targets stay");
        assert!(primitive["attributes"]["TEXCOORD_1"].is_u64());
    }
    assert_eq!(glb.json["nodes"][1]["weights"], json!([0, 1]));
}
