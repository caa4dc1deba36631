//! Textures that are missing or can't be read: their factor or fallback alone is baked, and each use is told with material and file.

mod files;
mod gltf_document;
mod usd_stage;

use files::Folder;
use glam::Vec3;
use gltf_document::{Builder, load_gltf};
use lumel::load::{self, Loaded};
use lumel::scene::{Alpha, Material};
use serde_json::json;
use usd_stage::{METRES, SQUARE};

/// How often `message` was met, and where.
fn met<'a>(loaded: &'a Loaded, message: &str) -> (usize, &'a [String]) {
    let found = loaded.warnings.iter().find(|w| w.message.contains(message));
    found.map_or((0, &[][..]), |w| (w.count, &w.places[..]))
}

#[test]
fn gltf_materials_keep_their_factors() {
    let folder = Folder::new("missing-gltf");
    folder.write("broken.png", b"\x89PNG\r\n\x1a\nno more");
    let mut b = Builder::default();
    let positions = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let uvs = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
    let primitives: Vec<_> = (0..3).map(|m| json!({ "attributes": attributes, "material": m })).collect();
    let colored = |factor: [f32; 4]| json!({ "baseColorFactor": factor, "baseColorTexture": { "index": 0 }, "metallicFactor": 0 });
    let document = b.gltf(json!({
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": primitives }],
        "images": [{ "uri": "gone.png" }, { "uri": "broken.png" }],
        "textures": [{ "source": 0 }, { "source": 1 }],
        "materials": [
            { "name": "wall", "pbrMetallicRoughness": colored([0.5, 0.25, 0.125, 1.0]) },
            { "name": "leaf", "alphaMode": "BLEND", "pbrMetallicRoughness": colored([0.25, 0.5, 0.125, 0.75]) },
            {
                "name": "lamp", "emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": { "index": 1 },
                "pbrMetallicRoughness": { "metallicFactor": 0 },
                "extensions": {
                    "KHR_materials_emissive_strength": { "emissiveStrength": 8 },
                    "KHR_materials_transmission": { "transmissionFactor": 0.5, "transmissionTexture": { "index": 0 } },
                },
            },
        ],
    }));
    let loaded = load_gltf(&folder.write("scene.gltf", document)).unwrap();
    let [wall, leaf, lamp] = &loaded.scene.materials[..] else { panic!() };
    assert_eq!((wall.albedo, wall.albedo_texture.is_none()), (Vec3::new(0.5, 0.25, 0.125), true));
    assert_eq!((leaf.alpha, leaf.opacity_slot().is_none()), (Alpha::Blend { opacity: 0.75 }, true));
    assert_eq!((lamp.emission, lamp.emission_texture.is_none()), (Vec3::new(8.0, 4.0, 2.0), true));
    assert!(lamp.transmission == Vec3::splat(0.5) && lamp.transmission_texture.is_none(), "{}", lamp.transmission);
    let (count, places) = met(&loaded, "the factor alone was used");
    assert_eq!(count, 4, "each use, not each picture: {places:?}");
    for (material, file) in [("wall", "gone.png"), ("leaf", "gone.png"), ("lamp", "broken.png"), ("lamp", "gone.png")] {
        assert!(places.iter().any(|p| p.contains(material) && p.contains(file)), "{material} {file}: {places:?}");
    }
}

/// A material's name, its inputs, and its texture nodes as pairs of name and body.
type Look<'a> = (&'a str, &'a str, &'a [(&'a str, &'a str)]);

/// A square for each material.
fn load_usd(name: &str, materials: &[Look]) -> Loaded {
    let folder = Folder::new(name);
    folder.write("broken.png", b"\x89PNG\r\n\x1a\nno more");
    let mut body = String::new();
    for (material, inputs, textures) in materials {
        let nodes: String = textures
            .iter()
            .map(|(node, inputs)| {
                let outputs = "float outputs:r float outputs:a float3 outputs:rgb";
                format!("def Shader \"{node}\" {{ uniform token info:id = \"UsdUVTexture\" {inputs} {outputs} }}\n")
            })
            .collect();
        body += &format!(
            r#"def Mesh "on_{material}" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{ {SQUARE} rel material:binding = </{material}> }}
def Material "{material}" {{
    token outputs:surface.connect = </{material}/s.outputs:surface>
    def Shader "s" {{ uniform token info:id = "UsdPreviewSurface" {inputs} token outputs:surface }}
    {nodes}
}}
"#
        );
    }
    load::load(&folder.write("scene.usda", format!("{METRES}{body}"))).unwrap()
}

fn look<'a>(loaded: &'a Loaded, name: &str) -> &'a Material {
    loaded.scene.materials.iter().find(|m| m.name == name).unwrap_or_else(|| panic!("no material {name}"))
}

#[test]
fn usd_inputs_take_their_fallback_or_default() {
    let gone = "asset inputs:file = @gone.png@";
    let held = "asset inputs:file = @gone.png@ float4 inputs:fallback = (0.5, 0.25, 0.125, 0.75)";
    let broken = "asset inputs:file = @broken.png@";
    let loaded = load_usd(
        "missing-usd",
        &[
            ("plain", "color3f inputs:diffuseColor.connect = </plain/t.outputs:rgb>", &[("t", gone)]),
            ("again", "color3f inputs:diffuseColor.connect = </again/t.outputs:rgb>", &[("t", broken)]),
            ("twice", "color3f inputs:diffuseColor.connect = </twice/t.outputs:rgb>", &[("t", broken)]),
            (
                "held",
                "color3f inputs:diffuseColor.connect = </held/t.outputs:rgb>
                float inputs:opacity.connect = </held/t.outputs:a>
                color3f inputs:emissiveColor.connect = </held/e.outputs:rgb>",
                &[("t", held), ("e", held)],
            ),
            (
                "lamp",
                "color3f inputs:emissiveColor.connect = </lamp/t.outputs:rgb>
                float inputs:opacity.connect = </lamp/t.outputs:r>",
                &[("t", gone)],
            ),
        ],
    );
    for name in ["/plain", "/again", "/twice"] {
        let material = look(&loaded, name);
        assert_eq!((material.albedo, material.albedo_texture.is_none()), (Vec3::splat(0.18), true), "{name}");
    }
    let held = look(&loaded, "/held");
    assert_eq!(held.albedo, Vec3::new(0.5, 0.25, 0.125));
    assert_eq!(held.emission, Vec3::new(0.5, 0.25, 0.125));
    assert_eq!(held.alpha, Alpha::Blend { opacity: 0.75 }, "the channel that is read, not the mean of all");
    let lamp = look(&loaded, "/lamp");
    assert_eq!((lamp.emission, lamp.alpha), (Vec3::ZERO, Alpha::Opaque), "dark and solid, as without a texture");

    let (count, places) = met(&loaded, "a texture file was not found");
    assert!(
        count >= 4
            && ["/plain/t", "/held/t", "/held/e", "/lamp/t"]
                .iter()
                .all(|t| { places.iter().any(|p| p.starts_with(t) && p.contains("gone.png")) }),
        "{count}: {places:?}"
    );
    let (count, places) = met(&loaded, "a texture could not be read");
    assert_eq!(count, 2, "{places:?}");
    for (place, node) in places.iter().zip(["/again/t", "/twice/t"]) {
        assert!(place.starts_with(node) && place.contains("broken.png"), "{place}");
    }
}

#[test]
fn a_binding_of_several_materials_binds_none() {
    // As usd-core: ComputeBoundMaterial is invalid where a direct binding has other than one target.
    let folder = Folder::new("several-materials");
    let body = format!(
        r#"def Mesh "m" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    {SQUARE}
    rel material:binding = [</red>, </blue>]
    color3f[] primvars:displayColor = [(0, 0.5, 0)]
}}
def Material "red" {{
    token outputs:surface.connect = </red/s.outputs:surface>
    def Shader "s" {{ uniform token info:id = "UsdPreviewSurface" color3f inputs:diffuseColor = (0.5, 0, 0) token outputs:surface }}
}}
def Material "blue" {{ }}
"#
    );
    let loaded = load::load(&folder.write("scene.usda", format!("{METRES}{body}"))).unwrap();
    assert_eq!(loaded.scene.material(0, 0).albedo, Vec3::new(0.0, 0.5, 0.0));
    let (count, places) = met(&loaded, "binds nothing");
    assert!(count > 0 && places[0].contains("/m.material:binding"), "{places:?}");
}
