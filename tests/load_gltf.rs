//! The glTF reader: small documents with known answers, broken ones, and real files where the shared folder is there.

mod files;
mod gltf_document;

use glam::{Vec2, Vec3, Vec4};
use gltf_document::{Builder, Folder, TRIANGLE, area, base64, first_mesh, load, load_gltf, one, png, warned};
use lumel::error::Error;
use lumel::load::Source;
use lumel::scene::{Alpha, LightShape, Texels, Wrap};
use serde_json::{Value, json};

#[test]
fn transforms_multiply_down_the_hierarchy() {
    let folder = Folder::new("hierarchy");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let half_turn = std::f32::consts::FRAC_1_SQRT_2;
    let loaded = load(
        &folder,
        &b.gltf(json!({
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [
                { "name": "room", "translation": [1, 2, 3], "children": [1, 2, 3] },
                { "name": "table", "rotation": [0, 0, half_turn, half_turn], "scale": [2, 2, 2], "mesh": 0 },
                { "name": "table", "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 5,0,0,1], "mesh": 0 },
                { "mesh": 0 },
                { "name": "not in the scene", "mesh": 0 },
            ],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": positions } }] }],
        })),
    );
    let names: Vec<_> = loaded.scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["room/table", "room/table#2", "room/node_3"]);
    assert_eq!(loaded.scene.meshes.len(), 1, "the mesh stays shared");
    let [a, b, c] = loaded.scene.world_triangle(0, 0);
    assert!(a.abs_diff_eq(Vec3::new(1.0, 2.0, 3.0), 1e-6));
    assert!(b.abs_diff_eq(Vec3::new(1.0, 4.0, 3.0), 1e-6), "x turns to y, twice as long: {b}");
    assert!(c.abs_diff_eq(Vec3::new(-1.0, 2.0, 3.0), 1e-6));
    assert!(loaded.scene.world_triangle(1, 0)[0].abs_diff_eq(Vec3::new(6.0, 2.0, 3.0), 1e-6));
    assert!((area(&loaded.scene, 0) - 2.0).abs() < 1e-5);
}

#[test]
fn negative_scale_is_mirrored_and_keeps_its_front() {
    let folder = Folder::new("mirror");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let loaded = load(&folder, &b.gltf(document));
    assert!(loaded.scene.surfaces[0].is_mirrored());
    let [a, b, c] = loaded.scene.world_triangle(0, 0);
    assert!((b - a).cross(c - a).z > 0.0, "the front still faces +Z");
}

#[test]
fn sparse_values_replace_those_of_the_view_or_zeros() {
    let folder = Folder::new("sparse");
    for base in [true, false] {
        let mut b = Builder::default();
        let positions = b.floats(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 9.0, 0.0]]);
        let view = b.accessors[positions]["bufferView"].clone();
        let targets = b.view(&[1, 2], None);
        let new: Vec<u8> = [3.0f32, 0.0, 0.0, 0.0, 4.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let values = b.view(&new, None);
        let mut accessor = json!({
            "componentType": 5126, "count": 3, "type": "VEC3",
            "sparse": { "count": 2, "indices": { "bufferView": targets, "componentType": 5121 }, "values": { "bufferView": values } },
        });
        if base {
            accessor["bufferView"] = view;
        }
        let sparse = b.accessor(accessor);
        let loaded = load(&folder, &b.gltf(one(json!({ "attributes": { "POSITION": sparse } }))));
        let expected = [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0)];
        assert_eq!(first_mesh(&loaded).positions, expected);
    }
}

#[test]
fn interleaved_and_quantized_attributes() {
    let folder = Folder::new("interleaved");
    let mut b = Builder::default();
    let mut bytes = Vec::new();
    for (p, uv, c) in [
        ([0i16, 0, 0], [0u16, 0], [0u8, 0, 0]),
        ([200, 0, 0], [65535, 0], [255, 0, 0]),
        ([0, -100, 0], [0, 65535], [0, 51, 0]),
    ] {
        bytes.extend(p.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([0, 0]);
        bytes.extend(uv.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(c);
        bytes.push(0);
    }
    let view = b.view(&bytes, Some(16));
    let mut part = |offset: usize, component: u32, kind: &str, normalized: bool| {
        b.accessor(json!({ "bufferView": view, "byteOffset": offset, "componentType": component, "count": 3, "type": kind, "normalized": normalized }))
    };
    let (p, t, c) = (part(0, 5122, "VEC3", false), part(8, 5123, "VEC2", true), part(12, 5121, "VEC3", true));
    let mut document = one(json!({ "attributes": { "POSITION": p, "TEXCOORD_1": t, "COLOR_0": c } }));
    document["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let loaded = load(&folder, &b.gltf(document));
    let mesh = first_mesh(&loaded);
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::new(200.0, 0.0, 0.0), Vec3::new(0.0, -100.0, 0.0)]);
    assert_eq!(mesh.uv_set("TEXCOORD_1").unwrap(), [Vec2::ZERO, Vec2::X, Vec2::Y]);
    assert_eq!(mesh.colors, [Vec4::W, Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 0.2, 0.0, 1.0)]);
    assert!(loaded.warnings.is_empty());
}

#[test]
fn strips_and_fans_keep_one_side_in_front() {
    let folder = Folder::new("strip");
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    for (mode, order, triangles) in
        [(5, [0, 1, 2, 3], [[0, 1, 2], [1, 3, 2]]), (6, [0, 1, 3, 2], [[1, 3, 0], [3, 2, 0]])]
    {
        let mut b = Builder::default();
        let positions = b.floats(&square);
        let indices = b.indices(&order);
        let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices, "mode": mode });
        let loaded = load(&folder, &b.gltf(one(primitive)));
        assert_eq!(first_mesh(&loaded).triangles, triangles);
        assert!((area(&loaded.scene, 0) - 1.0).abs() < 1e-6);
        for t in 0..2 {
            let [a, b, c] = loaded.scene.world_triangle(0, t);
            assert!((b - a).cross(c - a).z > 0.0);
        }
    }
}

#[test]
fn primitives_merge_into_one_mesh() {
    let folder = Folder::new("merge");
    let mut b = Builder::default();
    let positions = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let normals = b.floats(&[[0.0, 0.0, 1.0]; 4]);
    let uvs = b.floats(&[[0.5, 0.25]; 4]);
    let first = b.indices(&[0, 1, 2]);
    let second = b.indices(&[0, 2, 3, 0, 3, 1]);
    let bare = b.floats(&[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    let all = json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs });
    let loaded = load(
        &folder,
        &b.gltf(json!({
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [
                { "attributes": all, "indices": first, "material": 1 },
                { "attributes": { "POSITION": positions }, "mode": 1 },
                { "attributes": all, "indices": second },
                { "attributes": { "POSITION": bare }, "material": 0 },
            ] }],
            "materials": [{ "name": "a" }, { "name": "b" }],
        })),
    );
    let mesh = first_mesh(&loaded);
    assert_eq!(mesh.positions.len(), 7, "primitives over the same accessors share their vertices");
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [4, 5, 6]]);
    assert_eq!(mesh.triangle_material, [1, 2, 2, 0], "no material is the default one, after all others");
    assert_eq!(loaded.scene.materials[2].albedo, Vec3::ONE);
    let origins: Vec<_> = mesh.origin.iter().map(|o| (o.part, o.face, o.corners)).collect();
    assert_eq!(origins, [(0, 0, [0, 1, 2]), (2, 0, [0, 2, 3]), (2, 1, [0, 3, 1]), (3, 0, [0, 1, 2])]);
    assert_eq!(mesh.normals[..4], [Vec3::Z; 4]);
    assert_eq!(mesh.normals[4..], [Vec3::Y; 3], "flat normals where others have them");
    assert_eq!(mesh.uv_set("TEXCOORD_0").unwrap()[4..], [Vec2::ZERO; 3]);
    assert!(warned(&loaded, "points and lines"));
}

#[test]
fn flat_normals_split_shared_vertices() {
    let folder = Folder::new("flat");
    let mut b = Builder::default();
    let positions = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let normals = b.floats(&[[0.0, 0.0, 1.0]; 4]);
    let indices = b.indices(&[0, 1, 2, 0, 3, 1]);
    let mut document = one(json!({}));
    document["meshes"][0]["primitives"] = json!([
        { "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices },
        { "attributes": { "POSITION": positions }, "indices": indices },
    ]);
    let loaded = load(&folder, &b.gltf(document));
    let mesh = first_mesh(&loaded);
    assert_eq!(mesh.triangles[2..], [[4, 5, 6], [7, 8, 9]]);
    assert_eq!(mesh.normals[4..7], [Vec3::Z; 3]);
    assert_eq!(mesh.normals[7..10], [Vec3::Y; 3]);
    assert_eq!(mesh.origin[3].corners, [0, 3, 1], "corners are still the primitive's vertices");
}

#[test]
fn lights_keep_their_units_and_directions() {
    let folder = Folder::new("lights");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "spot", "color": [1, 0.5, 0], "intensity": 10, "range": 7, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.4 } },
        { "type": "directional", "intensity": 3 },
        { "type": "point" },
        { "type": "spot", "spot": {} },
    ] } });
    let turn = std::f32::consts::FRAC_1_SQRT_2;
    let light = |i: usize, mut node: Value| {
        node["extensions"] = json!({ "KHR_lights_punctual": { "light": i } });
        node
    };
    let lamp = json!({ "name": "lamp", "translation": [1, 2, 3], "rotation": [-turn, 0, 0, turn], "scale": [2, 2, 2] });
    let bare = || json!({});
    document["nodes"] = json!([{ "mesh": 0 }, light(0, lamp), light(1, bare()), light(2, bare()), light(3, bare())]);
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let loaded = load(&folder, &b.gltf(document));
    let lights = &loaded.scene.lights;
    assert_eq!((lights[0].name.as_str(), lights[0].gltf_node), ("lamp", Some(1)));
    let LightShape::Spot { position, direction, intensity, inner, outer, range } = &lights[0].shape else { panic!() };
    assert_eq!(*position, Vec3::new(1.0, 2.0, 3.0));
    assert!(direction.abs_diff_eq(Vec3::NEG_Y, 1e-6), "{direction}");
    assert_eq!(*intensity, Vec3::new(10.0, 5.0, 0.0));
    assert_eq!((*inner, *outer, *range), (0.1, 0.4, Some(7.0)));
    let LightShape::Directional { direction, illuminance, .. } = &lights[1].shape else { panic!() };
    assert_eq!((*direction, *illuminance), (Vec3::NEG_Z, Vec3::splat(3.0)));
    assert!(matches!(lights[2].shape, LightShape::Point { intensity: Vec3::ONE, range: None, .. }));
    let LightShape::Spot { inner, outer, .. } = &lights[3].shape else { panic!() };
    assert_eq!((*inner, *outer), (0.0, std::f32::consts::FRAC_PI_4));
}

/// A PNG of 2 x 1: red, half green.
#[test]
fn materials_with_textures_from_every_place() {
    let folder = Folder::new("materials");
    folder.write("my textures/a.png", png());
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let uvs = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let view = b.view(&png(), None);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs, "TEXCOORD_3": uvs });
    let textured = |texture: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture }, "metallicFactor": 0 } });
    let loaded = load(
        &folder,
        &b.gltf(json!({
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": (0..8).map(|m| json!({ "attributes": attributes, "material": m })).collect::<Vec<_>>() }],
            "images": [
                { "uri": "my%20textures/a.png" },
                { "uri": format!("data:image/png;base64,{}", base64(&png())) },
                { "bufferView": view, "mimeType": "image/png" },
                { "uri": "missing.png" },
                { "uri": "../../etc/passwd" },
            ],
            "samplers": [{ "wrapS": 33071, "wrapT": 33648 }],
            "textures": [{ "source": 0, "sampler": 0 }, { "source": 1 }, { "source": 2 }, { "source": 3 }, { "source": 4 }],
            "materials": [
                {
                    "name": "all", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.25,
                    "pbrMetallicRoughness": {
                        "baseColorFactor": [0.5, 0.25, 1, 0.75], "metallicFactor": 0,
                        "baseColorTexture": { "index": 0, "texCoord": 7, "extensions": { "KHR_texture_transform": {
                            "offset": [0.5, 0.25], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2, 3], "texCoord": 3 } } },
                    },
                    "emissiveFactor": [1, 0.5, 0], "emissiveTexture": { "index": 1 },
                    "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 40 } },
                },
                textured(2), textured(3), textured(4), textured(9),
                { "name": "metal", "pbrMetallicRoughness": { "baseColorFactor": [0.9, 0.6, 0.3, 1] } },
                { "extensions": { "KHR_materials_pbrSpecularGlossiness": {
                    "diffuseFactor": [0.1, 0.2, 0.3, 0.4], "diffuseTexture": { "index": 2 } } }, "alphaMode": "BLEND" },
                { "extensions": { "KHR_materials_unlit": {} } },
            ],
        })),
    );
    let m = &loaded.scene.materials;
    assert_eq!(loaded.scene.textures.len(), 3, "each image once");
    assert_eq!((m[0].albedo, m[0].double_sided), (Vec3::new(0.5, 0.25, 1.0), true));
    assert_eq!(m[0].alpha, Alpha::Mask { cutoff: 0.25, opacity: 0.75 });
    assert_eq!(m[0].emission, Vec3::new(40.0, 20.0, 0.0));
    let slot = m[0].albedo_texture.as_ref().unwrap();
    assert_eq!((slot.uv_set.as_str(), slot.wrap), ("TEXCOORD_3", [Wrap::Clamp, Wrap::Mirror]));
    // Scale, then a quarter turn counter-clockwise as seen (v down: x goes to -y), then the offset.
    let moved = slot.image_from_uv.transform_point2(Vec2::new(1.0, 1.0));
    assert!(moved.abs_diff_eq(Vec2::new(0.5 + 3.0, 0.25 - 2.0), 1e-5), "{moved}");
    let emission = m[0].emission_texture.as_ref().unwrap();
    assert_eq!((emission.texture, emission.uv_set.as_str()), (1, "TEXCOORD_0"));
    assert!(m[1].albedo_texture.is_some());
    assert!((2..5).all(|i| m[i].albedo_texture.is_none()));
    let unread: usize = loaded.warnings.iter().filter(|w| w.message.contains("factor alone")).map(|w| w.count).sum();
    assert_eq!(unread, 3);
    assert_eq!(m[5].albedo, Vec3::new(0.9, 0.6, 0.3));
    assert!(warned(&loaded, "metallic reflection is not diffuse"));
    assert_eq!((m[6].albedo, m[6].alpha), (Vec3::new(0.1, 0.2, 0.3), Alpha::Blend { opacity: 0.4 }));
    assert_eq!(m[6].albedo_texture.as_ref().unwrap().texture, 2);
    assert!(warned(&loaded, "unlit"));
    let green = loaded.scene.textures[0].texel(1, 0);
    assert!((green.y - 0.2158605).abs() < 1e-6, "sRGB 128 in linear light: {green}");
    assert!(loaded.inputs.iter().any(|p| p.ends_with("my textures/a.png")));
}

#[test]
fn instances_are_surfaces_of_their_own() {
    let folder = Folder::new("instances");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let translations = b.floats(&[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["nodes"][0] = json!({ "name": "tree", "mesh": 0, "translation": [0, 5, 0],
        "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations } } } });
    let loaded = load(&folder, &b.gltf(document));
    let places: Vec<_> =
        loaded.scene.surfaces.iter().map(|s| (s.name.as_str(), Vec3::from(s.world_from_local.translation))).collect();
    assert_eq!(places, [("tree[0]", Vec3::new(1.0, 5.0, 0.0)), ("tree[1]", Vec3::new(2.0, 5.0, 0.0))]);
    assert!(warned(&loaded, "EXT_mesh_gpu_instancing"));
}

#[test]
fn the_source_is_kept_as_it_was() {
    let folder = Folder::new("source");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let bin = b.bin.clone();
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["extras"] = json!({ "z": 1, "a": 0.1 });
    let path = folder.write("test.glb", b.glb(document));
    let Source::Gltf(source) = load_gltf(&path).unwrap().source else { panic!() };
    assert_eq!(source.buffers, [bin]);
    assert_eq!(source.json["extras"].to_string(), r#"{"z":1,"a":0.1}"#);
}

#[test]
fn compressed_and_unknown_geometry_is_refused_by_name() {
    let folder = Folder::new("extensions");
    let document = |required: bool, name: &str, place: &str| {
        let mut b = Builder::default();
        let positions = b.floats(&TRIANGLE);
        let mut document = one(json!({ "attributes": { "POSITION": positions } }));
        document["materials"] = json!([{}]);
        document["extensionsUsed"] = json!([name]);
        if required {
            document["extensionsRequired"] = json!([name]);
        }
        let mut document: Value = serde_json::from_slice(&b.gltf(document)).unwrap();
        document[place][0]["extensions"] = json!({ name: {} });
        load_gltf(&folder.write("test.gltf", serde_json::to_vec(&document).unwrap()))
    };
    for (name, place) in [("KHR_draco_mesh_compression", "meshes"), ("VENDOR_bent_space", "nodes")] {
        let error = document(true, name, place).unwrap_err();
        assert!(matches!(&error, Error::Unsupported { message, .. } if message.contains(name)), "{error}");
    }
    assert!(warned(&document(true, "VENDOR_paint", "materials").unwrap(), "VENDOR_paint"));
    assert!(warned(&document(false, "VENDOR_bent_space", "nodes").unwrap(), "VENDOR_bent_space"));
    assert!(document(false, "KHR_materials_ior", "materials").unwrap().warnings.is_empty());
}

#[test]
fn cycles_and_deep_trees_end() {
    let folder = Folder::new("trees");
    let mesh = json!([{ "primitives": [{ "attributes": { "POSITION": 0 } }] }]);
    let document = |nodes: Value, scene: Value| {
        let mut b = Builder::default();
        b.floats(&TRIANGLE);
        load_gltf(
            &folder.write("t.gltf", b.gltf(json!({ "nodes": nodes, "meshes": mesh, "scenes": [{ "nodes": scene }] }))),
        )
    };
    for (nodes, scene) in [
        (json!([{ "children": [1] }, { "children": [0], "mesh": 0 }]), json!([0])),
        (json!([{ "children": [0], "mesh": 0 }]), json!([0])),
        (json!([{ "children": [2] }, { "children": [2] }, { "mesh": 0 }]), json!([0, 1])),
        (json!([{ "children": [7] }]), json!([0])),
        (json!([{ "mesh": 0 }]), json!([4])),
    ] {
        let error = document(nodes.clone(), scene).expect_err(&nodes.to_string());
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
    }
    // A child that the scene lists too.
    let twice = document(json!([{ "mesh": 0 }, { "children": [0], "translation": [0, 0, 1] }]), json!([0, 1])).unwrap();
    assert_eq!(twice.scene.surfaces.len(), 1);
    assert_eq!(twice.scene.surfaces[0].world_from_local.translation.z, 1.0);
    assert!(warned(&twice, "more than once"));
    let count = 50_000;
    let nodes: Vec<_> = (0..count)
        .map(|i| if i + 1 < count { json!({ "children": [i + 1], "mesh": 0 }) } else { json!({ "mesh": 0 }) })
        .collect();
    assert_eq!(document(json!(nodes), json!([0])).unwrap().scene.surfaces.len(), count);
}

#[test]
fn huge_counts_and_offsets_are_errors() {
    let folder = Folder::new("huge");
    let edits: [(&str, Value); 12] = [
        ("/accessors/0/count", json!(4)),
        ("/accessors/0/count", json!(u64::MAX)),
        ("/accessors/0/count", json!(1u64 << 61)),
        ("/accessors/0/byteOffset", json!(u64::MAX)),
        ("/accessors/0/byteOffset", json!(4)),
        ("/accessors/0/componentType", json!(1)),
        ("/accessors/0/type", json!("VEC2")),
        ("/accessors/0/bufferView", json!(8)),
        ("/bufferViews/0/byteLength", json!(1u64 << 40)),
        ("/bufferViews/0/byteStride", json!(u64::MAX)),
        ("/bufferViews/0/buffer", json!(1)),
        ("/buffers/0/byteLength", json!(1u64 << 50)),
    ];
    for (pointer, value) in edits {
        let mut b = Builder::default();
        let positions = b.floats(&TRIANGLE);
        b.accessors[0]["byteOffset"] = json!(0);
        b.views[0]["byteStride"] = json!(12);
        let mut document: Value =
            serde_json::from_slice(&b.gltf(one(json!({ "attributes": { "POSITION": positions } })))).unwrap();
        *document.pointer_mut(pointer).unwrap() = value.clone();
        let path = folder.write("test.gltf", serde_json::to_vec(&document).unwrap());
        let error = load_gltf(&path).expect_err(&format!("{pointer} = {value}"));
        assert!(matches!(error, Error::Invalid { .. }) && error.to_string().contains("test.gltf"), "{error}");
    }
    // Zeros without data, as many as fit in no memory.
    let mut b = Builder::default();
    let zeros = b.accessor(json!({ "componentType": 5126, "count": 1u64 << 40, "type": "VEC3" }));
    let bytes = b.gltf(one(json!({ "attributes": { "POSITION": zeros } })));
    assert!(load_gltf(&folder.write("test.gltf", &bytes)).is_err());
    // An index beyond the vertices.
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let indices = b.indices(&[0, 1, 3]);
    let bytes = b.gltf(one(json!({ "attributes": { "POSITION": positions }, "indices": indices })));
    assert!(load_gltf(&folder.write("test.gltf", &bytes)).is_err());
}

#[test]
fn a_glb_cut_or_damaged_anywhere_never_panics() {
    let folder = Folder::new("cut");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let indices = b.indices(&[0, 1, 2]);
    let glb = b.glb(one(json!({ "attributes": { "POSITION": positions }, "indices": indices })));
    assert!(load_gltf(&folder.write("test.glb", &glb)).is_ok());
    for length in 0..glb.len() {
        let error = load_gltf(&folder.write("test.glb", &glb[..length])).expect_err("a cut file");
        assert!(error.to_string().contains("test.glb"), "{error}");
    }
    for at in 0..glb.len() {
        for value in [0, 0xff, glb[at] ^ 1, b'9'] {
            let mut damaged = glb.clone();
            damaged[at] = value;
            let _ = load_gltf(&folder.write("test.glb", &damaged));
        }
    }
    for garbage in [&b""[..], b"glTF", b"{", b"[]", b"null", b"\xff\xfe\0", b"{\"asset\":{\"version\":\"1.0\"}}"] {
        assert!(load_gltf(&folder.write("test.gltf", garbage)).is_err());
    }
    assert!(matches!(load_gltf(&folder.0.join("none.glb")), Err(Error::Io { .. })));
}

#[test]
fn pictures_of_every_depth() {
    use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, LumaA, Rgb, Rgb32FImage, Rgba};
    use lumel::load::image::{ColorSpace, decode};
    let encode = |picture: DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let grey = encode(ImageBuffer::from_pixel(1, 1, Luma([128u8])).into(), ImageFormat::Png);
    let texture = decode("grey.png", &grey, ColorSpace::Auto).unwrap();
    assert!(matches!(&texture.texels, Texels::Linear8(t) if t[0] == [128, 128, 128, 255]));
    assert!(matches!(decode("grey.png", &grey, ColorSpace::Srgb).unwrap().texels, Texels::Srgb8(_)));
    let grey_alpha = encode(ImageBuffer::from_pixel(1, 1, LumaA([10u8, 20])).into(), ImageFormat::Png);
    let texture = decode("a", &grey_alpha, ColorSpace::Linear).unwrap();
    assert!(matches!(&texture.texels, Texels::Linear8(t) if t[0] == [10, 10, 10, 20]));
    let rgb = encode(ImageBuffer::from_pixel(1, 1, Rgb([1u8, 2, 3])).into(), ImageFormat::Png);
    assert!(matches!(decode("a", &rgb, ColorSpace::Auto).unwrap().texels, Texels::Srgb8(_)));
    let deep = encode(ImageBuffer::from_pixel(1, 1, Rgba([65535u16, 32896, 0, 65535])).into(), ImageFormat::Png);
    assert!((decode("a", &deep, ColorSpace::Auto).unwrap().texel(0, 0).y - 0.501_960_8).abs() < 1e-6);
    assert!((decode("a", &deep, ColorSpace::Srgb).unwrap().texel(0, 0).y - 0.2158605).abs() < 1e-6);
    let bright: Rgb32FImage = ImageBuffer::from_pixel(2, 1, Rgb([120_000.0f32, 0.5, 0.0]));
    for format in [ImageFormat::OpenExr, ImageFormat::Hdr] {
        let bytes = encode(bright.clone().into(), format);
        let texel = decode("sky", &bytes, ColorSpace::Srgb).unwrap().texel(1, 0);
        assert!((texel.x / 120_000.0 - 1.0).abs() < 0.01 && texel.w == 1.0, "{texel}");
    }
    let bad: Rgb32FImage = ImageBuffer::from_pixel(1, 1, Rgb([f32::NAN, f32::INFINITY, 1.0]));
    let texel = decode("sky", &encode(bad.into(), ImageFormat::OpenExr), ColorSpace::Auto).unwrap().texel(0, 0);
    assert_eq!(texel, Vec4::new(0.0, 65504.0, 1.0, 1.0));
    for length in 0..deep.len() {
        let _ = decode("cut.png", &deep[..length], ColorSpace::Auto);
    }
    assert!(decode("x.png", b"GIF89a", ColorSpace::Auto).is_err());
    // A header that asks for 2^31 texels squared.
    let mut huge = rgb;
    huge[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    assert!(decode("huge.png", &huge, ColorSpace::Auto).is_err());
}
