//! Full materials as glTF and USD say them: each extension and input, what is matte, and values out of range.

mod files;
mod gltf_document;
mod usd_stage;

use files::Folder;
use gltf_document::{Builder, TRIANGLE, base64, one, png};
use lumel::color::Rgb;
use lumel::load::{LoadOptions, Loaded, load, load_with};
use lumel::scatter::{Scattering, Surfaces, Transport};
use lumel::scene::{Appearance, Channel, Dielectric, Walls};
use serde_json::{Value, json};
use std::path::Path;
use usd_stage::{METRES, SQUARE};

fn full(path: &Path) -> lumel::Result<Loaded> {
    load_with(path, &LoadOptions { appearance: true, ..LoadOptions::default() })
}

/// A glTF of one triangle with `material`, and the pictures 0 of an sRGB red and a dark green texel.
fn gltf(material: &Value) -> Vec<u8> {
    let mut builder = Builder::default();
    let positions = builder.floats(&TRIANGLE);
    let uvs = builder.floats(&[[0.25, 0.5], [0.25, 0.5], [0.25, 0.5f32]]);
    let mut document = one(json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "material": 0 }));
    document["materials"] = json!([material]);
    document["images"] = json!([{ "uri": format!("data:image/png;base64,{}", base64(&png())) }]);
    document["textures"] = json!([{ "source": 0 }]);
    builder.gltf(document)
}

fn load_gltf(name: &str, material: &Value) -> lumel::Result<Loaded> {
    let folder = Folder::new(name);
    full(&folder.write("test.gltf", gltf(material)))
}

fn look(name: &str, material: &Value) -> Option<Appearance> {
    load_gltf(name, material).unwrap().scene.materials[0].appearance.clone()
}

fn extended(extensions: Value) -> Value {
    json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0.3 }, "extensions": extensions })
}

#[test]
fn gltf_materials_are_read() {
    let found = look(
        "look_plain",
        &json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.8, 0.5, 0.1, 1],
        "metallicFactor": 0.75, "roughnessFactor": 0.25 } }),
    );
    let found = found.unwrap();
    assert_eq!((found.base_color, found.metallic, found.roughness), (Rgb::new(0.8, 0.5, 0.1), 0.75, 0.25));
    assert_eq!((found.dielectric.ior, found.transmission, found.walls), (1.5, 0.0, Walls::Thin));

    let all = extended(json!({
        "KHR_materials_ior": { "ior": 1.33 },
        "KHR_materials_transmission": { "transmissionFactor": 0.9 },
        "KHR_materials_volume": { "thicknessFactor": 0.01, "attenuationDistance": 0.5,
            "attenuationColor": [0.5, 1, 0.25] },
        "KHR_materials_clearcoat": { "clearcoatFactor": 0.4, "clearcoatRoughnessFactor": 0.2 },
    }));
    let found = look("look_all", &all).unwrap();
    assert_eq!((found.dielectric.ior, found.transmission), (1.33, 0.9));
    assert_eq!((found.clearcoat, found.clearcoat_roughness), (0.4, 0.2));
    // Half is left after half a metre.
    let absorption = found.absorption().unwrap();
    assert!(absorption.distance(Rgb::new(2.0 * 2f32.ln(), 0.0, 4.0 * 2f32.ln())) < 1e-5, "{absorption}");
    assert!(!found.is_pane());

    let thin = json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 },
        "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } } });
    let found = look("look_thin", &thin).unwrap();
    assert!(found.is_pane() && found.absorption().is_none());

    let specular =
        extended(json!({ "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1, 2, 0.5] } }));
    let found = look("look_specular", &specular).unwrap().dielectric;
    assert_eq!((found.specular, found.color), (0.5, Rgb::new(1.0, 2.0, 0.5)));
}

#[test]
fn specular_glossiness_is_read() {
    let extension = json!({ "diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.2, 0.3, 0.4],
        "glossinessFactor": 0.75,
        "specularGlossinessTexture": { "index": 0 } });
    let loaded =
        load_gltf("look_gloss", &json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": extension } }))
            .unwrap();
    let found = loaded.scene.materials[0].appearance.as_ref().unwrap();
    assert_eq!((found.dielectric.ior, found.dielectric.color, found.metallic), (0.0, Rgb::new(0.2, 0.3, 0.4), 0.0));
    // A texel of full alpha: roughness is one less the factor.
    let gloss = found.roughness_texture.as_ref().unwrap();
    assert_eq!((gloss.channel, gloss.slot.scale.w, gloss.slot.bias.w, found.roughness), (Channel::A, -0.75, 1.0, 1.0));
    assert!(found.dielectric.color_texture.is_some());
}

#[test]
fn textures_of_numbers_are_linear() {
    let textures = json!({ "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 0 } });
    let material = json!({ "pbrMetallicRoughness": textures });
    let loaded = load_gltf("look_textures", &material).unwrap();
    let found = loaded.scene.materials[0].appearance.as_ref().unwrap();
    let (rough, metal) = (found.roughness_texture.as_ref().unwrap(), found.metallic_texture.as_ref().unwrap());
    assert_eq!((rough.channel, metal.channel), (Channel::G, Channel::B));
    // One picture, decoded once for each meaning of its numbers: the second texel's green is 128.
    let green = |texture: usize| loaded.scene.textures[texture].texel(1, 0).y;
    assert!((green(rough.slot.texture) - 128.0 / 255.0).abs() < 1e-6);
    assert!((green(found.base_color_texture.as_ref().unwrap().texture) - 0.215_86).abs() < 1e-4);
    // Without the option no picture is decoded for it, and materials are as they were.
    let folder = Folder::new("look_textures_off");
    let plain = load(&folder.write("test.gltf", gltf(&material))).unwrap();
    assert!(plain.scene.materials[0].appearance.is_none());
    assert_eq!((plain.scene.textures.len(), loaded.scene.textures.len()), (1, 2));
    assert_eq!(plain.scene.materials[0].albedo, loaded.scene.materials[0].albedo);
}

#[test]
fn lobes_are_read_or_refused() {
    let lobe = json!({ "x": [-1, -1, -1], "y": [-1, -1, -1], "z": [0.5, 0.6, 0.7], "exponent": [10, 20, 30] });
    let with = |lobes: Value| json!({ "extras": { "lumel": { "lobes": lobes } } });
    let found =
        look("look_lobes", &with(json!({ "diffuse": [0.1, 0.2, 0.3], "lobes": [lobe] }))).unwrap().measured.unwrap();
    assert_eq!((found.diffuse, found.lobes.len()), (Rgb::new(0.1, 0.2, 0.3), 1));
    assert_eq!((found.lobes[0].z, found.lobes[0].exponent), (Rgb::new(0.5, 0.6, 0.7), Rgb::new(10.0, 20.0, 30.0)));
    let negative = json!({ "x": [0, 0, 0], "y": [0, 0, 0], "z": [1, 1, 1], "exponent": [-1, 1, 1] });
    for wrong in [json!({ "diffuse": [2, 0, 0] }), json!({ "lobes": [negative] }), json!({ "lobe": 1 }), json!(3)] {
        let error = load_gltf("look_lobes_wrong", &with(wrong)).unwrap_err().to_string();
        assert!(error.contains("materials[0]"), "{error}");
    }
}

#[test]
fn diffuse_materials_are_matte() {
    let rough = |metallic: f32, extensions: Value| {
        let pbr = json!({ "metallicFactor": metallic, "roughnessFactor": 1 });
        json!({ "pbrMetallicRoughness": pbr, "extensions": extensions })
    };
    let none = json!({});
    assert!(look("matte_rough", &rough(0.0, none.clone())).is_none());
    assert!(look("matte_unlit", &rough(1.0, json!({ "KHR_materials_unlit": {} }))).is_none());
    let dull = json!({ "KHR_materials_specular": { "specularFactor": 0 } });
    assert!(look("matte_dull", &extended(dull)).is_none());
    let black = json!({ "KHR_materials_pbrSpecularGlossiness": { "specularFactor": [0, 0, 0] } });
    assert!(look("matte_black", &json!({ "extensions": black })).is_none());
    let spread = json!({ "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.5 } });
    assert!(look("matte_spread", &rough(0.0, spread)).is_none());
    // And what isn't.
    assert!(look("not_matte_metal", &rough(0.1, none)).is_some());
    let coat = json!({ "KHR_materials_clearcoat": { "clearcoatFactor": 0.5 } });
    assert!(look("not_matte_coat", &rough(0.0, coat)).is_some());
    let tinted = json!({ "KHR_materials_specular": { "specularColorFactor": [1, 0, 0] } });
    assert!(look("not_matte_tinted", &rough(0.0, tinted)).is_some());
    let picture =
        json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "metallicRoughnessTexture": { "index": 0 } } });
    assert!(look("not_matte_picture", &picture).is_some());
}

#[test]
fn values_out_of_range_are_bounded() {
    let material = json!({
        "pbrMetallicRoughness": { "metallicFactor": -3, "roughnessFactor": 1e30 },
        "extensions": {
            "KHR_materials_ior": { "ior": 0.5 },
            "KHR_materials_transmission": { "transmissionFactor": 7 },
            "KHR_materials_volume": { "thicknessFactor": 1, "attenuationDistance": -1, "attenuationColor": [-1, 0, 9] },
            "KHR_materials_clearcoat": { "clearcoatFactor": -1, "clearcoatRoughnessFactor": 1e38 },
            "KHR_materials_specular": { "specularFactor": 3, "specularColorFactor": [-1, 1e38, 0] },
        },
    });
    let loaded = load_gltf("look_hostile", &material).unwrap();
    for part in ["metallic", "roughness", "transmission", "clearcoat", "specular", "index of refraction"] {
        assert!(loaded.warnings.iter().any(|w| w.message.contains(part) && w.message.contains("clamped")), "{part}");
    }
    let found = loaded.scene.materials[0].appearance.as_ref().unwrap();
    assert_eq!((found.metallic, found.roughness, found.transmission, found.dielectric.ior), (0.0, 1.0, 1.0, 1.0));
    assert_eq!(found.absorption(), Some(Rgb::ZERO));

    let hostile = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1e38, 0.0, 1e-30];
    for a in hostile {
        for b in hostile {
            let mut look = Appearance {
                base_color: Rgb::new(a, b, a),
                metallic: a,
                roughness: b,
                dielectric: Dielectric { ior: a, specular: b, color: Rgb::new(b, a, b), ..Dielectric::default() },
                transmission: b,
                walls: Walls::Solid { absorption: Rgb::splat(a) },
                clearcoat: b,
                clearcoat_roughness: a,
                ..Appearance::default()
            };
            look.bound();
            assert!(look.bound().is_empty(), "{a} {b}: bounds hold at once");
            let mut scene = loaded.scene.clone();
            scene.materials[0].appearance = Some(look);
            let scattering = Scattering::new(&scene, Surfaces::Full);
            let bsdf = scattering.at(&scene, 0, 0, [0.3, 0.3]);
            for wo in [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [f32::NAN; 3]] {
                let drawn = bsdf.sample(wo.into(), [0.2, 0.7, 0.5], Transport::Radiance);
                let weight = drawn.map_or(Rgb::ZERO, |s| s.weight);
                assert!(weight.is_finite() && weight.min_element() >= 0.0, "{a} {b} {wo:?}: {weight}");
            }
        }
    }
}

/// The look of a square with a material of the surface shader `body`, and the loaded scene.
fn usd(name: &str, shader: &str, extra: &str) -> (Option<Appearance>, Loaded) {
    let folder = Folder::new(name);
    let text = format!(
        "{METRES}def Mesh \"square\" (apiSchemas = [\"MaterialBindingAPI\"]) {{ {SQUARE}\n \
         rel material:binding = </look>\n \
         texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"vertex\") }}\n\
         def Material \"look\" {{ {extra}\n token outputs:surface.connect = </look/shader.outputs:surface>\n\
         def Shader \"shader\" {{ {shader}\n token outputs:surface }}\n\
         def Shader \"uv\" {{ uniform token info:id = \"UsdPrimvarReader_float2\"\n\
         string inputs:varname = \"st\"\n float2 outputs:result }}\n\
         def Shader \"picture\" {{ uniform token info:id = \"UsdUVTexture\"\n asset inputs:file = @picture.png@\n\
         token inputs:sourceColorSpace = \"raw\"\n\
         float2 inputs:st.connect = </look/uv.outputs:result>\n float outputs:g }} }}\n"
    );
    folder.write("picture.png", png());
    let loaded = full(&folder.write("scene.usda", text)).unwrap();
    (loaded.scene.materials[0].appearance.clone(), loaded)
}

#[test]
fn usd_surfaces_are_read() {
    let preview = "uniform token info:id = \"UsdPreviewSurface\"\n";
    let (found, _) = usd("usd_plain", &format!("{preview} color3f inputs:diffuseColor = (0.5, 0.25, 1)"), "");
    let found = found.unwrap();
    assert_eq!((found.base_color, found.roughness, found.metallic), (Rgb::new(0.5, 0.25, 1.0), 0.5, 0.0));
    assert_eq!((found.dielectric.ior, found.clearcoat), (1.5, 0.0));

    let all = "float inputs:metallic = 0.5\n float inputs:roughness.connect = </look/picture.outputs:g>\n\
               float inputs:ior = 1.7\n\
               float inputs:clearcoat = 0.3\n float inputs:clearcoatRoughness = 0.1";
    let (found, loaded) = usd("usd_all", &format!("{preview}{all}"), "");
    let found = found.unwrap();
    assert_eq!((found.metallic, found.dielectric.ior), (0.5, 1.7));
    assert_eq!((found.clearcoat, found.clearcoat_roughness), (0.3, 0.1));
    let rough = found.roughness_texture.as_ref().unwrap();
    assert_eq!((rough.channel, loaded.scene.textures.len()), (Channel::G, 1));

    let workflow = "int inputs:useSpecularWorkflow = 1\n color3f inputs:specularColor = (0.2, 0.3, 0.4)\n\
                    float inputs:metallic = 1";
    let (found, _) = usd("usd_workflow", &format!("{preview}{workflow}"), "");
    let found = found.unwrap();
    assert_eq!((found.metallic, found.dielectric.ior, found.dielectric.color), (0.0, 0.0, Rgb::new(0.2, 0.3, 0.4)));

    let (found, _) = usd("usd_matte", &format!("{preview} float inputs:roughness = 1"), "");
    assert!(found.is_none());
    let glass = "uniform token info:id = \"ND_gltf_pbr_surfaceshader\"\n float inputs:metallic = 0\n\
                 float inputs:roughness = 0\n\
                 float inputs:transmission = 1\n float inputs:thickness = 1\n float inputs:attenuation_distance = 2\n\
                 color3f inputs:attenuation_color = (0.5, 1, 1)";
    let (found, _) = usd("usd_glass", glass, "");
    let absorption = found.unwrap().absorption().unwrap();
    assert!(absorption.distance(Rgb::new(2f32.ln() / 2.0, 0.0, 0.0)) < 1e-6, "{absorption}");
}

#[test]
fn usd_lobes_are_read_or_ignored() {
    let preview = "uniform token info:id = \"UsdPreviewSurface\"\n float inputs:roughness = 1";
    let lobes = "custom float[] lumel:lobes = [0.1, 0.2, 0.3, -1, -1, -1, -1, -1, -1, 0.5, 0.6, 0.7, 10, 20, 30]";
    let (found, loaded) = usd("usd_lobes", preview, lobes);
    let found = found.unwrap().measured.unwrap();
    assert_eq!((found.diffuse, found.lobes.len()), (Rgb::new(0.1, 0.2, 0.3), 1));
    assert_eq!((found.lobes[0].x, found.lobes[0].exponent), (Rgb::NEG_ONE, Rgb::new(10.0, 20.0, 30.0)));
    assert!(loaded.warnings.iter().all(|w| !w.message.contains("known attribute")));
    for wrong in ["[1, 2]", "[0.1, 0.1, 9]"] {
        let (found, loaded) = usd("usd_lobes_wrong", preview, &format!("custom float[] lumel:lobes = {wrong}"));
        assert!(found.is_none() && loaded.warnings.iter().any(|w| w.message.contains("ignored")), "{wrong}");
    }
}

#[test]
fn usd_values_out_of_range_are_bounded() {
    let hostile = "uniform token info:id = \"UsdPreviewSurface\"\n float inputs:roughness = -5\n\
                   float inputs:metallic = nan\n\
                   float inputs:ior = inf\n float inputs:clearcoat = 1e30";
    let (found, loaded) = usd("usd_hostile", hostile, "");
    let found = found.unwrap();
    assert_eq!((found.roughness, found.metallic, found.clearcoat), (0.0, 0.0, 1.0));
    assert!(loaded.warnings.iter().any(|w| w.message.contains("roughness must lie in 0..1")));
}
