//! Extensions of glTF: compressed views and pictures, variants, what passes through materials, lights and skies.

mod files;
mod glb;
mod gltf_document;

use glam::Vec3;
use glb::Glb;
use gltf_document::{Builder, Folder, TRIANGLE, base64, first_mesh, load, load_gltf, one, png, warned};
use lumel::color::Rgb;
use lumel::load::{LoadOptions, Loaded, Source};
use lumel::scene::{LightShape, Material};
use serde_json::{Value, json};
use std::f32::consts::FRAC_1_SQRT_2;
use std::process::Command;

const MESHOPT: &str = "EXT_meshopt_compression";

/// A grid of 9 x 9 vertices over the unit square.
fn grid() -> (Vec<[f32; 3]>, Vec<u32>) {
    let positions = (0..81).map(|i| [(i % 9) as f32 / 8.0, (i / 9) as f32 / 8.0, 0.0]).collect();
    let cells = (0..64u32).map(|i| i / 8 * 9 + i % 8);
    let indices = cells.flat_map(|c| [c, c + 1, c + 9, c + 1, c + 10, c + 9]).collect();
    (positions, indices)
}

/// A compressed view: stream, stride, count, mode, filter, accessor.
type View = (Vec<u8>, usize, usize, &'static str, Option<&'static str>, Value);

/// A document whose views are compressed, each in its mode.
fn compressed(extension: &str, views: &[View], primitive: Value) -> Value {
    let mut bin: Vec<u8> = Vec::new();
    let (mut json_views, mut accessors, mut fallback) = (Vec::new(), Vec::new(), 0);
    for (i, (stream, stride, count, mode, filter, accessor)) in views.iter().enumerate() {
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut inner = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": stream.len(), "byteStride": stride,
                                "count": count, "mode": mode });
        if let Some(filter) = filter {
            inner["filter"] = json!(filter);
        }
        bin.extend(stream);
        json_views.push(json!({ "buffer": 1, "byteOffset": fallback, "byteLength": stride * count,
                                "extensions": { extension: inner } }));
        if *mode == "ATTRIBUTES" {
            json_views[i]["byteStride"] = json!(stride);
        }
        fallback += (stride * count).next_multiple_of(4);
        let mut accessor = accessor.clone();
        accessor["bufferView"] = json!(i);
        accessor["count"] = json!(count);
        accessors.push(accessor);
    }
    let mut document = one(primitive);
    document["asset"] = json!({ "version": "2.0" });
    document["extensionsUsed"] = json!([extension, "KHR_mesh_quantization"]);
    document["extensionsRequired"] = json!([extension, "KHR_mesh_quantization"]);
    document["bufferViews"] = json!(json_views);
    document["accessors"] = json!(accessors);
    let uri = format!("data:application/octet-stream;base64,{}", base64(&bin));
    document["buffers"] = json!([{ "byteLength": bin.len(), "uri": uri },
                                 { "byteLength": fallback, "extensions": { extension: { "fallback": true } } }]);
    document
}

/// The grid with all three modes and three filters: f32 positions, octahedral normals, exponential texture coordinates.
fn compressed_grid(extension: &str) -> Value {
    let (positions, indices) = grid();
    let normals = vec![[0.6f32, 0.0, 0.8, 0.0]; 81];
    let uvs: Vec<[f32; 2]> = positions.iter().map(|p| [p[0] * 0.5, p[1]]).collect();
    let octahedral: Vec<[i8; 4]> = meshopt::encode_filter_oct(&normals, 8);
    let exponential = meshopt::encode_filter_exp::<2>(&uvs, 15, meshopt::EncodeExpMode::Separate);
    let colors: Vec<[u8; 4]> = (0..81).map(|i| [i, 2 * i, 255 - i, 255]).collect();
    let views = [
        (
            meshopt::encode_vertex_buffer(&positions).unwrap(),
            12,
            81,
            "ATTRIBUTES",
            None,
            json!({ "componentType": 5126, "type": "VEC3" }),
        ),
        (
            meshopt::encode_vertex_buffer(&octahedral).unwrap(),
            4,
            81,
            "ATTRIBUTES",
            Some("OCTAHEDRAL"),
            json!({ "componentType": 5120, "normalized": true, "type": "VEC3" }),
        ),
        (
            meshopt::encode_vertex_buffer(&exponential).unwrap(),
            8,
            81,
            "ATTRIBUTES",
            Some("EXPONENTIAL"),
            json!({ "componentType": 5126, "type": "VEC2" }),
        ),
        (
            meshopt::encode_vertex_buffer(&colors).unwrap(),
            4,
            81,
            "ATTRIBUTES",
            Some("NONE"),
            json!({ "componentType": 5121, "normalized": true, "type": "VEC4" }),
        ),
        (
            meshopt::encode_index_buffer(&indices, 81).unwrap(),
            2,
            indices.len(),
            "TRIANGLES",
            None,
            json!({ "componentType": 5123, "type": "SCALAR" }),
        ),
        (
            meshopt::encode_index_sequence(&indices[..6], 81).unwrap(),
            4,
            6,
            "INDICES",
            None,
            json!({ "componentType": 5125, "type": "SCALAR" }),
        ),
    ];
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3 });
    let mut document = compressed(extension, &views, json!({ "attributes": attributes, "indices": 4 }));
    let sequence = json!({ "attributes": attributes, "indices": 5 });
    document["meshes"][0]["primitives"].as_array_mut().unwrap().push(sequence);
    document
}

#[test]
fn meshopt_streams_of_every_mode_and_filter() {
    let folder = Folder::new("meshopt");
    let (positions, indices) = grid();
    for extension in [MESHOPT, "KHR_meshopt_compression"] {
        let loaded = load(&folder, &serde_json::to_vec(&compressed_grid(extension)).unwrap());
        let mesh = first_mesh(&loaded);
        assert_eq!(mesh.positions, positions.iter().map(|p| Vec3::from_array(*p)).collect::<Vec<_>>(), "shared, once");
        assert!(mesh.normals.iter().all(|n| n.abs_diff_eq(Vec3::new(0.6, 0.0, 0.8), 0.02)), "{}", mesh.normals[0]);
        for (uv, p) in mesh.uvs[0].coords.iter().zip(&positions) {
            assert!((uv.x - p[0] * 0.5).abs() < 1e-3 && (uv.y - p[1]).abs() < 1e-3);
        }
        assert_eq!(mesh.colors[80].x, 80.0 / 255.0);
        // The codec may turn a triangle's corners, keeping its side.
        let turned = |t: &[u32]| {
            let k = (0..3).min_by_key(|k| t[*k]).unwrap();
            [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
        };
        let expected: Vec<[u32; 3]> = indices.chunks(3).chain(indices[..6].chunks(3)).map(turned).collect();
        assert_eq!(mesh.triangles.iter().map(|t| turned(t)).collect::<Vec<_>>(), expected);
        let Source::Gltf(source) = loaded.source else { panic!() };
        assert!(!source.json.to_string().contains("meshopt"), "nothing compressed is left");
        assert_eq!(source.json["extensionsRequired"], json!(["KHR_mesh_quantization"]));
    }
}

#[test]
fn broken_meshopt_streams_are_errors_that_name_the_view() {
    let folder = Folder::new("bad_meshopt");
    let refuse = |pointer: &str, value: Value| {
        let mut document = compressed_grid(MESHOPT);
        *document.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        let error = load_gltf(&folder.write("t.gltf", serde_json::to_vec(&document).unwrap())).unwrap_err().to_string();
        assert!(error.contains("bufferViews["), "{pointer}: {error}");
        error
    };
    let inner = |view: usize, key: &str| format!("/bufferViews/{view}/extensions/{MESHOPT}/{key}");
    assert!(refuse(&inner(0, "count"), json!(82)).contains("its size"));
    assert!(refuse(&inner(0, "mode"), json!("POINTS")).contains("mode POINTS"));
    assert!(refuse(&inner(0, "byteLength"), json!(1 << 20)).contains("outside of its buffer"));
    assert!(refuse(&inner(0, "byteLength"), json!(20)).contains("can't be decoded"));
    assert!(refuse(&inner(1, "filter"), json!("QUATERNION")).contains("stride of 4"));
    assert!(refuse(&inner(4, "mode"), json!("INDICES")).contains("can't be decoded"));
    assert!(refuse(&inner(5, "count"), json!(-1)).contains("invalid value"));
    // A size that no stream of its length can have.
    let mut document = compressed_grid(MESHOPT);
    document["bufferViews"][0]["extensions"][MESHOPT]["count"] = json!(1u64 << 40);
    document["bufferViews"][0]["byteLength"] = json!(12 * (1u64 << 40));
    let error = load_gltf(&folder.write("t.gltf", serde_json::to_vec(&document).unwrap())).unwrap_err().to_string();
    assert!(error.contains("too short for what it should hold"), "{error}");
}

/// Damages each byte of the streams in turn: any result but a panic will do.
#[test]
fn damaged_meshopt_streams_never_panic() {
    let folder = Folder::new("fuzz_meshopt");
    let document = compressed_grid(MESHOPT);
    let uri = document["buffers"][0]["uri"].as_str().unwrap().to_owned();
    let start = uri.find(',').unwrap() + 1;
    let (mut read, mut refused) = (0, 0);
    for at in (start..uri.len() - 4).step_by(3) {
        let mut damaged = uri.clone().into_bytes();
        damaged[at] = if damaged[at] == b'/' { b'A' } else { b'/' };
        let mut document = document.clone();
        document["buffers"][0]["uri"] = json!(String::from_utf8(damaged).unwrap());
        match load_gltf(&folder.write("t.gltf", serde_json::to_vec(&document).unwrap())) {
            Ok(_) => read += 1,
            Err(_) => refused += 1,
        }
    }
    assert!(read > 0 && refused > 0, "{read} read, {refused} refused");
}

fn bake(folder: &Folder, document: &Value, options: &[&str]) -> Glb {
    let scene = folder.write("scene.gltf", serde_json::to_vec(document).unwrap());
    let out = folder.0.join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
    command.args(["bake", "--quality", "draft", "--resolution", "64", "--sky", "1", "--overwrite"]).args(options);
    let done = command.arg(&scene).arg("-o").arg(&out).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    Glb::parse(&std::fs::read(out.join("scene.glb")).unwrap())
}

#[test]
fn compressed_input_is_written_decoded() {
    let folder = Folder::new("write_meshopt");
    let glb = bake(&folder, &compressed_grid(MESHOPT), &[]);
    assert!(!glb.json.to_string().contains("meshopt"));
    assert_eq!(glb.json["buffers"].as_array().unwrap().len(), 1);
    let attributes = &glb.json["meshes"][0]["primitives"][0]["attributes"];
    let positions = glb.rows(attributes["POSITION"].as_u64().unwrap() as usize, 3);
    let expected: Vec<Vec<f32>> = grid().0.iter().map(|p| p.to_vec()).collect();
    assert_eq!(positions[..81], expected);
    // Decoded once, nothing of the streams left: 81 vertices of 36 bytes at most, and indices.
    assert!(glb.bin.len() < 81 * 40 + 2 * 400 + 200, "{} bytes", glb.bin.len());
}

/// A textured triangle whose texture is `texture` and whose images are `images`.
fn textured(texture: Value, images: Value) -> Vec<u8> {
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let uvs = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let mut document = one(json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "material": 0 }));
    document["materials"] =
        json!([{ "pbrMetallicRoughness": { "metallicFactor": 0, "baseColorTexture": { "index": 0 } } }]);
    document["textures"] = json!([texture]);
    document["images"] = images;
    b.gltf(document)
}

fn data(mime: &str, bytes: &[u8]) -> Value {
    json!({ "uri": format!("data:{mime};base64,{}", base64(bytes)) })
}

#[test]
fn webp_goes_before_the_ordinary_picture() {
    let folder = Folder::new("webp");
    let picture = image::RgbaImage::from_raw(1, 1, vec![0, 0, 255, 255]).unwrap();
    let mut webp = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
    let images = json!([data("image/png", &png()), data("image/webp", &webp.into_inner())]);
    let texture = json!({ "source": 0, "extensions": { "EXT_texture_webp": { "source": 1 } } });
    let loaded = load(&folder, &textured(texture, images.clone()));
    assert_eq!(loaded.scene.textures[0].texel(0, 0).to_array(), [0.0, 0.0, 1.0, 1.0]);
    let alone = load(&folder, &textured(json!({ "extensions": { "EXT_texture_webp": { "source": 1 } } }), images));
    assert_eq!(alone.scene.textures[0].texel(0, 0).z, 1.0);
}

#[test]
fn basis_universal_falls_back_or_is_named() {
    let folder = Folder::new("basis");
    let basis = json!({ "KHR_texture_basisu": { "source": 1 } });
    let images = json!([data("image/png", &png()), data("image/ktx2", b"\xabKTX 20\xbb")]);
    let beside = load(&folder, &textured(json!({ "source": 0, "extensions": basis }), images.clone()));
    assert_eq!(beside.scene.textures.len(), 1);
    let alone = load(&folder, &textured(json!({ "extensions": basis }), images));
    assert!(alone.scene.textures.is_empty() && warned(&alone, "Basis Universal alone"));
}

#[test]
fn variants_by_name() {
    let folder = Folder::new("variants");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let mut document = one(json!({
        "attributes": { "POSITION": positions }, "material": 0,
        "extensions": { "KHR_materials_variants": { "mappings": [
            { "material": 1, "variants": [0, 2] }, { "material": 2, "variants": [1] }] } },
    }));
    document["extensions"] = json!({ "KHR_materials_variants": { "variants": [
        { "name": "beach" }, { "name": "midnight" }, { "name": "dusk" }] } });
    let paint = |v: f32| json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "baseColorFactor": [v, v, v, 1] } });
    document["materials"] = json!([paint(0.1), paint(0.2), paint(0.3)]);
    document["extensionsUsed"] = json!(["KHR_materials_variants"]);
    let path = folder.write("test.gltf", b.gltf(document));
    let with = |names: &[&str]| {
        let variants = names.iter().map(|n| n.to_string()).collect();
        lumel::load::load_with(&path, &LoadOptions { variants, ..LoadOptions::default() })
    };
    for (names, albedo) in [(&[][..], 0.1), (&["dusk"], 0.2), (&["midnight"], 0.3), (&["midnight", "beach"], 0.2)] {
        let loaded = with(names).unwrap();
        assert_eq!(loaded.scene.material(0, 0).albedo, Rgb::splat(albedo), "{names:?}");
        assert!(loaded.warnings.is_empty());
    }
    let error = with(&["noon"]).unwrap_err().to_string();
    assert!(error.contains("\"beach\", \"midnight\", \"dusk\""), "{error}");
    let Source::Gltf(source) = with(&["midnight"]).unwrap().source else { panic!() };
    let primitive = &source.json["meshes"][0]["primitives"][0];
    assert_eq!(primitive["material"], 2, "what is written shows what was baked");
    assert!(primitive["extensions"]["KHR_materials_variants"].is_object());
}

/// The material that `extensions` make of a base colour of (0.8, 0.4, 0.2), with `textures` over one set of UVs.
fn material(folder: &Folder, metallic: f32, base: Option<usize>, extensions: Value, pictures: &[[u8; 4]]) -> Loaded {
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let uvs = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs, "TEXCOORD_1": uvs });
    let mut document = one(json!({ "attributes": attributes, "material": 0 }));
    let mut pbr = json!({ "metallicFactor": metallic, "baseColorFactor": [0.8, 0.4, 0.2, 1] });
    if let Some(base) = base {
        pbr["baseColorTexture"] = json!({ "index": base });
    }
    document["materials"] = json!([{ "pbrMetallicRoughness": pbr, "extensions": extensions }]);
    let picture = |texel: &[u8; 4]| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture = image::RgbaImage::from_raw(1, 1, texel.to_vec()).unwrap();
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        data("image/png", &bytes.into_inner())
    };
    document["images"] = pictures.iter().map(picture).collect();
    document["textures"] = (0..pictures.len()).map(|i| json!({ "source": i })).collect();
    load(folder, &b.gltf(document))
}

/// What the material sends back and lets through at any point.
fn both(loaded: &Loaded) -> (Rgb, Rgb) {
    let m: &Material = &loaded.scene.materials[0];
    let value = |factor: Rgb, slot: &Option<lumel::scene::TextureSlot>| {
        let texel = slot.as_ref().map(|s| loaded.scene.textures[s.texture].texel(0, 0).truncate());
        factor * texel.unwrap_or(Rgb::ONE)
    };
    (value(m.albedo, &m.albedo_texture), value(m.transmission, &m.transmission_texture))
}

#[test]
fn transmission_leaves_the_albedo() {
    let folder = Folder::new("transmission");
    let base = Rgb::new(0.8, 0.4, 0.2);
    let thin = |t: f32| json!({ "KHR_materials_transmission": { "transmissionFactor": t } });
    let check = |loaded: &Loaded, albedo: Rgb, passes: Rgb| {
        let (a, t) = both(loaded);
        assert!(a.abs_diff_eq(albedo, 4e-3) && t.abs_diff_eq(passes, 4e-3), "{a} {t}, not {albedo} {passes}");
    };
    check(&material(&folder, 0.0, None, thin(0.75), &[]), base * 0.25, base * 0.75);
    check(&material(&folder, 0.0, None, json!({}), &[]), base, Rgb::ZERO);
    // Metal lets nothing through.
    check(&material(&folder, 1.0, None, thin(1.0), &[]), base, Rgb::ZERO);
    check(&material(&folder, 0.5, None, thin(1.0), &[]), base * 0.5, base * 0.5);
    // Half of what isn't transmitted is spread behind, in its own colour.
    let mut all = thin(0.5);
    all["KHR_materials_diffuse_transmission"] =
        json!({ "diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [0, 1, 0] });
    check(&material(&folder, 0.0, None, all, &[]), base * 0.25, base * 0.5 + Rgb::Y * 0.25);
    // Beer: two attenuation distances.
    let mut volume = thin(1.0);
    volume["KHR_materials_volume"] =
        json!({ "thicknessFactor": 2, "attenuationDistance": 1, "attenuationColor": [0.5, 1, 1] });
    check(&material(&folder, 0.0, None, volume, &[]), Rgb::ZERO, base * Rgb::new(0.25, 1.0, 1.0));
    // A base texture (sRGB 188 is 0.503) colours both, untouched; a texture of shares is composed with it.
    let grey = 0.502_886;
    let plain = material(&folder, 0.0, Some(0), thin(0.5), &[[188, 188, 188, 255]]);
    assert_eq!(plain.scene.textures.len(), 1);
    check(&plain, base * grey * 0.5, base * grey * 0.5);
    let mut shares = thin(1.0);
    shares["KHR_materials_transmission"]["transmissionTexture"] = json!({ "index": 1 });
    let composed = material(&folder, 0.0, Some(0), shares.clone(), &[[188, 188, 188, 255], [51, 255, 255, 255]]);
    check(&composed, base * grey * 0.8, base * grey * 0.2);
    // The same over other UVs: by its mean, said.
    shares["KHR_materials_transmission"]["transmissionTexture"]["texCoord"] = json!(1);
    let apart = material(&folder, 0.0, Some(0), shares, &[[188, 188, 188, 255], [51, 255, 255, 255]]);
    check(&apart, base * grey * 0.8, base * grey * 0.2);
    assert!(warned(&apart, "means were used") && !warned(&composed, "means were used"));
}

/// A triangle and a node that shines.
fn lit(node: Value, extensions: Value, scene: Value) -> Vec<u8> {
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["nodes"].as_array_mut().unwrap().push(node);
    document["extensions"] = extensions;
    document["scenes"] = json!([scene]);
    document["scenes"][0]["nodes"] = json!([0, 1]);
    b.gltf(document)
}

#[test]
fn area_lights_are_rectangles_and_disks() {
    let folder = Folder::new("area_lights");
    let lights = json!({ "EXT_lights_area": { "lights": [
        { "type": "rect", "size": 2, "rect": { "aspect": 1.5 }, "intensity": 10, "color": [1, 0.5, 0] },
        { "type": "disk", "size": 1 }] } });
    let node = |light: usize| {
        // A quarter turn about X: what shone along -Z shines along +Y.
        json!({ "name": "lamp", "translation": [0, 3, 0], "rotation": [FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2],
                "scale": [1, -3, 2], "extensions": { "EXT_lights_area": { "light": light } } })
    };
    let loaded = load(&folder, &lit(node(0), lights.clone(), json!({})));
    let LightShape::Rect { center, u, v, radiance } = loaded.scene.lights[0].shape else { panic!() };
    assert_eq!((center, radiance), (Vec3::Y * 3.0, Rgb::new(10.0, 5.0, 0.0)));
    // The largest scale is 3: 6 high and 9 wide; it shines along -(u x v).
    assert!((u.length() - 4.5).abs() < 1e-5 && (v.length() - 3.0).abs() < 1e-5, "{u} {v}");
    assert!((-u.cross(v).normalize()).abs_diff_eq(Vec3::Y, 1e-5), "{}", u.cross(v));
    let disk = load(&folder, &lit(node(1), lights.clone(), json!({})));
    let LightShape::Disk { u, v, radiance, .. } = disk.scene.lights[0].shape else { panic!() };
    assert!((u.length() - 1.5).abs() < 1e-5 && (v.length() - 1.5).abs() < 1e-5);
    assert_eq!(radiance, Rgb::splat(1000.0));
    let error = load_gltf(&folder.write("t.gltf", lit(node(2), lights, json!({})))).unwrap_err().to_string();
    assert!(error.contains("light 2 of EXT_lights_area"), "{error}");
}

#[test]
fn a_cube_map_is_the_sky() {
    let folder = Folder::new("sky");
    let face = |texel: [u8; 4]| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture = image::RgbaImage::from_raw(1, 1, texel.to_vec()).unwrap();
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        data("image/png", &bytes.into_inner())
    };
    // +X red, RGBD of 1/4; all others black.
    let mut faces = vec![face([255, 0, 0, 51])];
    faces.extend((0..5).map(|_| face([0, 0, 0, 255])));
    // A quarter turn about Y: the sky's +X looks along the world's -Z.
    let light = json!({ "intensity": 2, "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2],
                        "irradianceCoefficients": [[1, 1, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0],
                                                   [0, 0, 0], [0, 0, 0]],
                        "specularImageSize": 1, "specularImages": [[0, 1, 2, 3, 4, 5]] });
    let document = |images: Vec<Value>| {
        let extensions = json!({ "EXT_lights_image_based": { "lights": [light] } });
        let scene = json!({ "extensions": { "EXT_lights_image_based": { "light": 0 } } });
        let mut document: Value = serde_json::from_slice(&lit(json!({}), extensions, scene)).unwrap();
        document["images"] = json!(images);
        serde_json::to_vec(&document).unwrap()
    };
    let loaded = load(&folder, &document(faces));
    let sky = loaded.scene.environment.as_ref().unwrap();
    let texture = &loaded.scene.textures[sky.texture.unwrap()];
    let towards = |d: Vec3| sky.radiance * texture.sample(sky.uv(d), [Default::default(); 2]).truncate();
    assert!(towards(Vec3::NEG_Z).abs_diff_eq(Rgb::X * 10.0, 1e-3), "{}", towards(Vec3::NEG_Z));
    assert_eq!(towards(Vec3::Z), Rgb::ZERO);
    assert!((sky.world_from_sky * Vec3::X).abs_diff_eq(Vec3::NEG_Z, 1e-6));
    // Without its pictures: E = 0.282 everywhere is L = E / pi.
    let smooth = load(&folder, &document(vec![json!({ "uri": "gone.png" }); 6]));
    let sky = smooth.scene.environment.as_ref().unwrap();
    let texel = smooth.scene.textures[sky.texture.unwrap()].texel(3, 3).x;
    assert!((texel - 0.282_095 / std::f32::consts::PI).abs() < 1e-5, "{texel}");
    assert!(warned(&smooth, "irradiance coefficients were used"));
}

#[test]
fn instances_may_be_quantized_and_carry_attributes_of_their_own() {
    let folder = Folder::new("quantized_instances");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let quarter = (FRAC_1_SQRT_2 * 127.0).round() as i8;
    let view = b.view(&[0, 0, quarter as u8, quarter as u8, 0, 0, 0, 127], None);
    let rotation = b
        .accessor(json!({ "bufferView": view, "componentType": 5120, "normalized": true, "count": 2, "type": "VEC4" }));
    let scale = b.floats(&[[2.0, 2.0, 2.0], [1.0, 1.0, 1.0]]);
    let id = b.floats(&[[7.0], [8.0]]);
    let mut document = one(json!({ "attributes": { "POSITION": positions } }));
    document["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": {
        "attributes": { "ROTATION": rotation, "SCALE": scale, "_ID": id } } });
    let loaded = load(&folder, &b.gltf(document));
    assert_eq!(loaded.scene.surfaces.len(), 2);
    let turned = loaded.scene.surfaces[0].world_from_local.transform_vector3(Vec3::X);
    assert!(turned.abs_diff_eq(Vec3::Y * 2.0, 1e-2), "{turned}");
}

#[test]
fn color_and_quaternion_filters() {
    let folder = Folder::new("filters");
    let mut b = Builder::default();
    b.floats(&TRIANGLE);
    let colors = [[1.0f32, 0.5, 0.25, 1.0], [0.0, 0.0, 1.0, 1.0], [0.25, 0.25, 0.25, 0.5]];
    let turns = [[0.0f32, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2], [0.0, 0.0, 0.0, 1.0]];
    let encoded: [Vec<u8>; 2] = [
        meshopt::encode_vertex_buffer(&meshopt::encode_filter_color::<u8>(&colors, 8)).unwrap(),
        meshopt::encode_vertex_buffer(&meshopt::encode_filter_quat(&turns, 16)).unwrap(),
    ];
    for (stream, stride, count, filter) in [(&encoded[0], 4, 3, "COLOR"), (&encoded[1], 8, 2, "QUATERNION")] {
        let view = b.view(stream, None);
        let inner = json!({ "buffer": 0, "byteOffset": b.views[view]["byteOffset"], "byteLength": stream.len(),
                            "byteStride": stride, "count": count, "mode": "ATTRIBUTES", "filter": filter });
        b.views[view] =
            json!({ "buffer": 1, "byteLength": stride * count, "extensions": { "KHR_meshopt_compression": inner } });
    }
    b.accessor(json!({ "bufferView": 1, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC4" }));
    b.accessor(json!({ "bufferView": 2, "componentType": 5122, "normalized": true, "count": 2, "type": "VEC4" }));
    let mut document = one(json!({ "attributes": { "POSITION": 0, "COLOR_0": 1 } }));
    document["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "ROTATION": 2 } } });
    let mut document: Value = serde_json::from_slice(&b.gltf(document)).unwrap();
    document["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 16 }));
    let loaded = load(&folder, &serde_json::to_vec(&document).unwrap());
    for (got, expected) in first_mesh(&loaded).colors.iter().zip(colors) {
        assert!(got.abs_diff_eq(expected.into(), 0.02), "{got} is not {expected:?}");
    }
    let turned = loaded.scene.surfaces[0].world_from_local.transform_vector3(Vec3::X);
    assert!(turned.abs_diff_eq(Vec3::Y, 1e-3), "{turned}");
}

#[test]
fn an_uncompressed_copy_stands_in_for_draco() {
    let folder = Folder::new("draco_copy");
    let mut b = Builder::default();
    let positions = b.floats(&TRIANGLE);
    let stream = b.view(&[1, 2, 3, 4], None);
    let draco = json!({ "KHR_draco_mesh_compression": { "bufferView": stream, "attributes": { "POSITION": 0 } } });
    let mut document = one(json!({ "attributes": { "POSITION": positions }, "extensions": draco }));
    document["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let document: Value = serde_json::from_slice(&b.gltf(document)).unwrap();
    let loaded = load(&folder, &serde_json::to_vec(&document).unwrap());
    assert!(warned(&loaded, "the uncompressed copy of the geometry was used"));
    let glb = bake(&folder, &document, &[]);
    assert!(!glb.json.to_string().contains("draco"), "a copy with other UVs would contradict the stream");
}

#[test]
fn a_scene_without_triangles_says_why() {
    let folder = Folder::new("points");
    let refuse = |document: Value| {
        let mut b = Builder::default();
        b.floats(&TRIANGLE);
        lumel::load::load(&folder.write("t.gltf", b.gltf(document))).unwrap_err().to_string()
    };
    let points = one(json!({ "attributes": { "POSITION": 0 }, "mode": 0 }));
    assert!(refuse(points).contains("points and lines have no surface"));
    let mut unplaced = one(json!({ "attributes": { "POSITION": 0 } }));
    unplaced["nodes"] = json!([{}]);
    assert!(refuse(unplaced).contains("no visible node of its scene shows one"));
}
