//! GLBs of glTF sources: what is written is parsed again and compared with what went in.

mod glb;

use glam::{Affine3A, Vec2, Vec3};
use glb::Glb;
use lumel::color::Rgb;
use lumel::load::Source;
use lumel::load::access::Access;
use lumel::load::gltf::GltfSource;
use lumel::load::usd::UsdSource;
use lumel::meshing::{LitMesh, VertexLight};
use lumel::post::{Lightmap, PageImage, Quantity};
use lumel::scene::{
    BakeMode, Environment, Light, LightShape, Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin, UvSet,
};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use lumel::write::GltfProfile;
use lumel::write::encode::{Encoded, Encoding};
use lumel::write::engines::LightmapExtension;
use lumel::write::{Baked, BakedLights};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A unit square of two triangles (0 1 2, 0 2 3) and a degenerate third (0 1 1) that the loader drops, shared by two nodes;
/// a third node outside of the scene has it too. It has a sparse morph target, a custom attribute of odd size, and 8-bit
/// indices. Node 2 is a light.
fn source() -> GltfSource {
    let mut buffer: Vec<u8> = Vec::new();
    for v in SQUARE.iter().flatten() {
        buffer.extend(v.to_le_bytes());
    }
    buffer.extend([10, 11, 12, 13, 0, 0, 0, 0]); // 48: _ID
    buffer.extend([0, 1, 2, 0, 2, 3, 0, 1, 1, 0, 0, 0]); // 56: indices
    buffer.extend([2, 0, 0, 0]); // 68: sparse index
    [0.0f32, 0.0, 5.0].iter().for_each(|v| buffer.extend(v.to_le_bytes())); // 72: sparse value
    let json = json!({
        "asset": { "version": "2.0", "copyright": "somebody", "extras": { "own": [1, 2.5] } },
        "extensionsUsed": ["KHR_lights_punctual", "ACME_unknown"],
        "extensions": {
            "ACME_unknown": { "anything": { "z": 1, "a": null } },
            "KHR_lights_punctual": { "lights": [{ "type": "point", "name": "bulb" }] },
        },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2] }, { "nodes": [3] }],
        "nodes": [
            { "name": "left", "mesh": 0, "extras": { "tag": "kept" } },
            { "name": "right", "mesh": 0, "translation": [3, 0, 0], "extras": "a text" },
            { "name": "lamp", "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "name": "elsewhere", "mesh": 0 },
        ],
        "materials": [{ "name": "paint", "pbrMetallicRoughness": { "metallicFactor": 0.25 }, "extras": { "m": 1 } }],
        "meshes": [{
            "name": "square",
            "primitives": [{
                "attributes": { "POSITION": 0, "_ID": 1 },
                "indices": 2,
                "material": 0,
                "targets": [{ "POSITION": 3 }],
            }],
            "weights": [0.5],
        }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5121, "count": 9, "type": "SCALAR" },
            {
                "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 5],
                "sparse": {
                    "count": 1,
                    "indices": { "bufferView": 3, "componentType": 5121 },
                    "values": { "bufferView": 4 },
                },
            },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 4 },
            { "buffer": 0, "byteOffset": 56, "byteLength": 9 },
            { "buffer": 0, "byteOffset": 68, "byteLength": 1 },
            { "buffer": 0, "byteOffset": 72, "byteLength": 12 },
        ],
        "buffers": [{ "byteLength": buffer.len(), "uri": "square.bin" }],
        "animations": [],
    });
    GltfSource { path: PathBuf::from("square.gltf"), json, buffers: vec![buffer], access: Access::default() }
}

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// The scene that the loader makes of [`source`].
fn scene(material: Material) -> Scene {
    let triangle = |face, corners| TriangleOrigin { part: 0, face, corners };
    let mesh = Mesh {
        name: "square".into(),
        positions: SQUARE.map(Vec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_material: vec![0, 0],
        origin: vec![triangle(0, [0, 1, 2]), triangle(1, [0, 2, 3])],
        ..Mesh::default()
    };
    let surface = |name: &str, node| Surface {
        name: name.into(),
        mesh: 0,
        world_from_local: Affine3A::from_translation(Vec3::X * 3.0 * node as f32),
        origin: SurfaceOrigin::GltfNode(node),
        role: Default::default(),
    };
    Scene {
        meshes: vec![mesh],
        materials: vec![material],
        surfaces: vec![surface("left", 0), surface("right", 1)],
        lights: vec![Light {
            gltf_node: Some(2),
            ..Light::new(
                "lamp",
                LightShape::Point { position: Vec3::Y, intensity: Rgb::new(50.0, 100.0, 0.0), range: None },
            )
        }],
        ..Scene::default()
    }
}

/// UVs at the corners: one chart, or a seam along the diagonal.
fn uvs(seam: bool) -> Vec<[Vec2; 3]> {
    let v = Vec2::new;
    let second = if seam { [v(0.0, 0.5), v(1.0, 1.0), v(0.0, 1.0)] } else { [v(0.0, 0.0), v(1.0, 0.5), v(0.0, 0.5)] };
    vec![[v(0.0, 0.0), v(1.0, 0.0), v(1.0, 0.5)], second]
}

fn atlas(corners: Vec<[Vec2; 3]>, authored: Option<&str>) -> Atlas {
    let placement = |x: f32| Placement { page: 0, scale: Vec2::new(0.25, 0.5), offset: Vec2::new(x, 0.125) };
    Atlas {
        pages: vec![[64, 32]],
        meshes: vec![MeshUvs {
            chart: vec![0; corners.len()],
            chart_count: 1,
            corners,
            authored: authored.map(str::to_string),
        }],
        placements: vec![placement(0.1), placement(0.6)],
        density: 10.0,
        padding: 2,
        shown_pages: 1,
    }
}

fn lightmap(quantity: Quantity) -> Lightmap {
    let page = PageImage { width: 64, height: 32, rgb: vec![Rgb::ONE; 64 * 32], coverage: vec![1.0; 64 * 32] };
    Lightmap { pages: vec![page], quantity, layers: Vec::new() }
}

/// Everything that a writer takes, to be changed by a test.
struct Bake {
    scene: Scene,
    source: Source,
    atlas: Atlas,
    lightmap: Lightmap,
    vertices: VertexLight,
    lights: BakedLights,
    encoded: Vec<Encoded>,
    extension: Option<LightmapExtension>,
}

impl Bake {
    fn new(seam: bool) -> Self {
        // The left square is lit evenly, the right one differs at the corners of its second triangle.
        let even = vec![[Rgb::splat(2.0); 3]; 2];
        let uneven = vec![[Rgb::ONE; 3], [Rgb::splat(4.0), Rgb::ONE, Rgb::splat(0.5)]];
        Self {
            scene: scene(Material::default()),
            source: Source::Gltf(source()),
            atlas: atlas(uvs(seam), None),
            lightmap: lightmap(Quantity::Outgoing),
            vertices: VertexLight { surfaces: [even, uneven].map(LitMesh::given).into() },
            lights: BakedLights::Mark,
            encoded: Vec::new(),
            extension: None,
        }
    }

    /// The two squares on pages of their own, named by an extension.
    fn on_two_pages(extension: LightmapExtension, encoding: Encoding, scale: f32) -> Self {
        let mut bake = Self::new(false);
        bake.atlas.pages.push([64, 32]);
        bake.atlas.shown_pages = 2;
        bake.atlas.placements[1].page = 1;
        bake.lightmap.pages.push(bake.lightmap.pages[0].clone());
        let uris = (0..2).map(|page| format!("lightmaps/a square_{page}.{}", encoding.suffix())).collect();
        bake.encoded = vec![Encoded { encoding, scale, uris }];
        bake.extension = Some(extension);
        bake
    }

    fn write(&self, profile: GltfProfile) -> Glb {
        let folder = std::env::temp_dir().join(format!("lumel-write-gltf-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join(format!("{:?}.glb", std::thread::current().id()));
        let baked = Baked {
            scene: &self.scene,
            source: &self.source,
            atlas: &self.atlas,
            lightmap: Some(&self.lightmap),
            quantity: self.lightmap.quantity,
            vertices: Some(&self.vertices),
            page_uris: &["lightmaps/square_0.exr".to_string()],
            encoded: &self.encoded,
            vertex_colors: Default::default(),
            lightmap_extension: self.extension,
            folder: Path::new("out"),
            lights: self.lights,
        };
        lumel::write::gltf::write(&path, &baked, profile).unwrap();
        Glb::parse(&std::fs::read(&path).unwrap())
    }
}

fn strip(mut json: Value, keys: &[&str]) -> String {
    keys.iter().for_each(|k| drop(json.as_object_mut().unwrap().shift_remove(*k)));
    json.to_string()
}

#[test]
fn what_the_bake_does_not_touch_stays_byte_for_byte() {
    let glb = Bake::new(true).write(GltfProfile::Engine);
    let source = source().json;
    for key in ["scene", "scenes", "materials", "animations", "extensionsUsed"] {
        assert_eq!(glb.json[key].to_string(), source[key].to_string(), "{key}");
    }
    assert_eq!(glb.json["extensions"]["ACME_unknown"], source["extensions"]["ACME_unknown"]);
    assert_eq!(strip(glb.json["asset"].clone(), &["extras"]), strip(source["asset"].clone(), &["extras"]));
    assert_eq!(glb.json["asset"]["extras"]["own"].to_string(), "[1,2.5]");
    for (node, was) in glb.json["nodes"].as_array().unwrap().iter().zip(source["nodes"].as_array().unwrap()) {
        assert_eq!(strip(node.clone(), &["extras"]), strip(was.clone(), &["extras"]));
    }
    assert_eq!(glb.json["nodes"][3].to_string(), source["nodes"][3].to_string());
    assert_eq!(glb.json["meshes"][0]["weights"].to_string(), "[0.5]");
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&glb.json), keys(&source));
}

#[test]
fn extras_say_where_the_light_is() {
    let glb = Bake::new(true).write(GltfProfile::Engine);
    let lumel = &glb.json["asset"]["extras"]["lumel"];
    assert_eq!(lumel["quantity"], "outgoing");
    assert_eq!(lumel["unit"], "nit");
    assert_eq!(lumel["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(lumel["pages"], json!([{ "uri": "lightmaps/square_0.exr", "width": 64, "height": 32 }]));
    let rectangle = json!({ "page": 0, "texCoord": 1, "scale": [0.25, 0.5], "offset": [0.1, 0.125] });
    assert_eq!(glb.json["nodes"][0]["extras"], json!({ "tag": "kept", "lumel": rectangle }));
    assert_eq!(glb.json["nodes"][1]["extras"]["original"], "a text");
    assert_eq!(glb.json["nodes"][1]["extras"]["lumel"]["offset"], json!([0.6, 0.125]));
    // A shared mesh stays shared.
    assert_eq!((&glb.json["nodes"][0]["mesh"], &glb.json["nodes"][1]["mesh"]), (&json!(0), &json!(0)));
}

#[test]
fn without_a_seam_only_an_accessor_is_added() {
    let glb = Bake::new(false).write(GltfProfile::Engine);
    let source = source().json;
    let accessors = glb.json["accessors"].as_array().unwrap();
    assert_eq!(accessors.len(), 5);
    assert_eq!(accessors[..4], source["accessors"].as_array().unwrap()[..]);
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    // Sets must be numbered from 0 without a gap.
    assert_eq!(primitive["attributes"], json!({ "POSITION": 0, "_ID": 1, "TEXCOORD_0": 4, "TEXCOORD_1": 4 }));
    assert_eq!((&primitive["indices"], &primitive["targets"]), (&json!(2), &json!([{ "POSITION": 3 }])));
    assert_eq!(glb.floats(4), [0.0, 0.0, 1.0, 0.0, 1.0, 0.5, 0.0, 0.5]);
}

#[test]
fn vertices_at_a_seam_are_copied_with_all_they_hold() {
    let glb = Bake::new(true).write(GltfProfile::Engine);
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    let attribute = |name: &str| primitive["attributes"][name].as_u64().unwrap() as usize;
    // The degenerate triangle that no texel belongs to stays.
    let indices = glb.unsigned(primitive["indices"].as_u64().unwrap() as usize);
    assert_eq!(indices, [0, 1, 2, 4, 5, 3, 0, 1, 1]);
    let positions = glb.rows(attribute("POSITION"), 3);
    let uv = glb.rows(attribute("TEXCOORD_1"), 2);
    for (corner, (place, uv_wanted)) in
        [0, 1, 2, 0, 2, 3].into_iter().zip(uvs(true).concat()).enumerate().map(|(i, c)| (indices[i] as usize, c))
    {
        assert_eq!(positions[corner], SQUARE[place]);
        assert_eq!(uv[corner], uv_wanted.to_array());
    }
    assert_eq!(glb.unsigned(attribute("_ID")), [10, 11, 12, 13, 10, 12]);
    let target = glb.rows(primitive["targets"][0]["POSITION"].as_u64().unwrap() as usize, 3);
    assert_eq!(target.iter().map(|d| d[2]).collect::<Vec<_>>(), [0.0, 0.0, 5.0, 0.0, 0.0, 5.0]);
    let position = &glb.json["accessors"][attribute("POSITION")];
    assert_eq!((&position["min"], &position["max"]), (&json!([0.0, 0.0, 0.0]), &json!([1.0, 1.0, 0.0])));
    // Nothing is left of what was replaced: 5 accessors, none sparse.
    assert_eq!(glb.json["accessors"].as_array().unwrap().len(), 5);
    assert!(glb.json["accessors"].as_array().unwrap().iter().all(|a| a.get("sparse").is_none()));
}

#[test]
fn authored_uvs_are_left_where_they_are() {
    let mut bake = Bake::new(true);
    bake.atlas = atlas(uvs(true), Some("TEXCOORD_2"));
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["meshes"], source().json["meshes"]);
    assert_eq!(glb.json["nodes"][0]["extras"]["lumel"]["texCoord"], 2);
}

#[test]
fn a_set_that_a_texture_reads_is_not_replaced() {
    let mut bake = Bake::new(false);
    let mut source = source();
    source.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 0.into();
    source.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = 0.into();
    source.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0, "texCoord": 1 });
    bake.source = Source::Gltf(source);
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["nodes"][0]["extras"]["lumel"]["texCoord"], 2);
    assert_eq!(glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"], 0);
    assert_eq!(glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_2"], 4);
}

#[test]
fn baked_lights_are_marked_removed_or_kept() {
    let mut bake = Bake::new(false);
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["nodes"][2]["extras"]["lumel"], json!({ "baked": true }));
    assert_eq!(glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]["extras"]["lumel"]["baked"], true);
    bake.lights = BakedLights::Remove;
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["nodes"][2], json!({ "name": "lamp" }));
    assert_eq!(glb.json["extensionsUsed"], json!(["ACME_unknown"]));
    assert!(glb.json["extensions"].get("KHR_lights_punctual").is_none());
    bake.lights = BakedLights::Keep;
    assert_eq!(bake.write(GltfProfile::Engine).json["nodes"][2], source().json["nodes"][2]);
}

#[test]
fn lights_that_are_baked_in_part_stay_and_say_what_is_left() {
    let mut bake = Bake::new(false);
    for lights in [BakedLights::Mark, BakedLights::Remove] {
        bake.lights = lights;
        bake.scene.lights[0].contribution.mode = Some(BakeMode::Indirect);
        let glb = bake.write(GltfProfile::Engine);
        let left = json!({ "bake": "indirect", "realtime": "direct" });
        assert_eq!(glb.json["nodes"][2]["extras"]["lumel"], left);
        assert_eq!(glb.json["nodes"][2]["extensions"], source().json["nodes"][2]["extensions"]);
        assert_eq!(glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]["extras"]["lumel"], left);
        bake.scene.lights[0].contribution.mode = Some(BakeMode::Dynamic);
        assert_eq!(bake.write(GltfProfile::Engine).json["nodes"][2], source().json["nodes"][2]);
    }
}

#[test]
fn the_sky_that_is_baked_is_marked_or_removed() {
    const SKY: &str = "EXT_lights_image_based";
    let mut source = source();
    source.json["extensions"][SKY] = json!({ "lights": [{ "irradianceCoefficients": [] }] });
    source.json["scenes"][0]["extensions"] = json!({ SKY: { "light": 0 } });
    source.json["extensionsUsed"].as_array_mut().unwrap().push(SKY.into());
    let mut bake = Bake { source: Source::Gltf(source), ..Bake::new(false) };
    bake.scene.environment = Some(Environment::constant("sky", Rgb::ONE));
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["extensions"][SKY]["lights"][0]["extras"]["lumel"], json!({ "baked": true }));
    bake.lights = BakedLights::Remove;
    let glb = bake.write(GltfProfile::Engine);
    assert!(glb.json["extensions"].get(SKY).is_none() && glb.json["scenes"][0].get("extensions").is_none());
    assert_eq!(glb.json["extensionsUsed"], json!(["ACME_unknown"]));
    // One of which reflected light alone is baked stays.
    bake.scene.environment.as_mut().unwrap().contribution.mode = Some(BakeMode::Indirect);
    let light = &bake.write(GltfProfile::Engine).json["extensions"][SKY]["lights"][0];
    assert_eq!(light["extras"]["lumel"], json!({ "bake": "indirect", "realtime": "direct" }));
    // One from the command line is none of the file's.
    bake.scene.environment = Some(Environment::constant("--sky", Rgb::ONE));
    assert!(bake.write(GltfProfile::Engine).json["extensions"][SKY]["lights"][0].get("extras").is_none());
}

#[test]
fn baking_the_output_again_replaces_its_extras() {
    let mut bake = Bake::new(true);
    let first = bake.write(GltfProfile::Engine);
    let json = first.json.clone();
    let mesh = &mut bake.scene.meshes[0];
    // The loader would find the copied vertices.
    mesh.origin[1].corners = [4, 5, 3];
    bake.source = Source::Gltf(GltfSource {
        path: "square.glb".into(),
        json: first.json,
        buffers: vec![first.bin.clone()],
        access: Access::default(),
    });
    bake.atlas.placements.swap(0, 1);
    let again = bake.write(GltfProfile::Engine);
    assert_eq!(again.json["nodes"][0]["extras"]["lumel"]["offset"], json!([0.6, 0.125]));
    assert_eq!(again.json["nodes"][0]["extras"]["tag"], "kept");
    assert_eq!(again.json["meshes"], json["meshes"]);
    assert_eq!(again.bin.len(), first.bin.len());
    assert_eq!(again.floats(4), Glb { json, bin: first.bin }.floats(4));
    bake.lights = BakedLights::Keep;
    assert!(bake.write(GltfProfile::Engine).json["nodes"][2].get("extras").is_none());
}

#[test]
fn vertex_colors_are_the_light_over_one_scale() {
    let glb = Bake::new(false).write(GltfProfile::Vertex);
    let lumel = &glb.json["asset"]["extras"]["lumel"];
    assert_eq!(lumel["vertexScale"], 4.0);
    // Each node has a mesh of its own, and the node outside of the scene the one it had.
    let meshes: Vec<u64> = (0..2).map(|n| glb.json["nodes"][n]["mesh"].as_u64().unwrap()).collect();
    assert_ne!(meshes[0], meshes[1]);
    assert!(!meshes.contains(&0));
    assert_eq!(glb.json["meshes"][0], source().json["meshes"][0]);
    let primitive = |node: usize| &glb.json["meshes"][meshes[node] as usize]["primitives"][0];
    let rows = |node: usize, name: &str| glb.rows(primitive(node)["attributes"][name].as_u64().unwrap() as usize, 3);
    assert_eq!(rows(0, "COLOR_0"), vec![[0.5; 3]; 4]);
    assert_eq!(rows(0, "_IRRADIANCE"), vec![[2.0; 3]; 4]);
    let indices = glb.unsigned(primitive(1)["indices"].as_u64().unwrap() as usize);
    let color = |corner: usize| rows(1, "COLOR_0")[indices[corner] as usize][0];
    assert_eq!([0, 1, 2, 3, 4, 5].map(color), [0.25, 0.25, 0.25, 1.0, 0.25, 0.125]);
    assert_eq!(rows(1, "_IRRADIANCE")[indices[3] as usize], [4.0; 3]);
    assert_eq!(glb.json["materials"][0]["extensions"], json!({ "KHR_materials_unlit": {} }));
    assert!(glb.json["extensionsUsed"].as_array().unwrap().contains(&json!("KHR_materials_unlit")));
}

#[test]
fn other_quantities_show_the_same_light() {
    let mut bake = Bake::new(false);
    bake.lightmap.quantity = Quantity::Irradiance;
    for value in bake.vertices.surfaces.iter_mut().flat_map(|s| &mut s.triangles).flat_map(|t| &mut t.values) {
        *value *= std::f32::consts::PI;
    }
    let glb = bake.write(GltfProfile::Vertex);
    let scale = glb.json["asset"]["extras"]["lumel"]["vertexScale"].as_f64().unwrap();
    assert!((scale - 4.0).abs() < 1e-5, "{scale}");
    assert_eq!(glb.json["asset"]["extras"]["lumel"]["unit"], "lx");
}

#[test]
fn a_shining_surface_shows_all_that_leaves_it() {
    let mut bake = Bake::new(false);
    let emission = Rgb::new(1.0, 0.5, 0.0);
    bake.scene = scene(Material { albedo: Rgb::splat(0.5), emission, ..Material::default() });
    bake.vertices.surfaces[1] = LitMesh::given([[Rgb::splat(2.0); 3]; 2]);
    let glb = bake.write(GltfProfile::Vertex);
    let mesh = glb.json["nodes"][0]["mesh"].as_u64().unwrap() as usize;
    let primitive = &glb.json["meshes"][mesh]["primitives"][0];
    let material = &glb.json["materials"][primitive["material"].as_u64().unwrap() as usize];
    assert_eq!(material["pbrMetallicRoughness"]["baseColorFactor"], json!([1.0, 1.0, 1.0, 1.0]));
    assert_eq!(material["name"], "paint");
    let scale = glb.json["asset"]["extras"]["lumel"]["vertexScale"].as_f64().unwrap() as f32;
    let shown = glb.rows(primitive["attributes"]["COLOR_0"].as_u64().unwrap() as usize, 3).remove(0);
    assert_eq!(Rgb::from_slice(&shown) * scale, Rgb::splat(0.5 * 2.0) + emission);
    assert_eq!(glb.rows(primitive["attributes"]["_IRRADIANCE"].as_u64().unwrap() as usize, 3)[0], [2.0; 3]);
}

#[test]
fn a_scene_from_elsewhere_becomes_a_node_for_each_surface() {
    let mut bake = Bake::new(true);
    bake.source = Source::Usd(UsdSource { path: "square.usda".into(), ..UsdSource::default() });
    bake.scene.meshes[0].uvs = vec![UvSet { name: "st".into(), coords: vec![Vec2::ZERO; 4] }];
    bake.scene.surfaces[0].name = "/room/left".into();
    let glb = bake.write(GltfProfile::Engine);
    assert_eq!(glb.json["nodes"][0]["name"], "/room/left");
    assert_eq!(glb.json["nodes"][1]["translation"], json!([3.0, 0.0, 0.0]));
    assert_eq!((&glb.json["nodes"][0]["mesh"], &glb.json["nodes"][1]["mesh"]), (&json!(0), &json!(0)));
    assert_eq!(glb.json["nodes"][1]["extras"]["lumel"]["texCoord"], 1);
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    let indices = glb.unsigned(primitive["indices"].as_u64().unwrap() as usize);
    let uv = glb.rows(primitive["attributes"]["TEXCOORD_1"].as_u64().unwrap() as usize, 2);
    let written: Vec<_> = indices.iter().map(|i| Vec2::from_slice(&uv[*i as usize])).collect();
    assert_eq!(written, uvs(true).concat());
    let light = &glb.json["extensions"]["KHR_lights_punctual"]["lights"][0];
    assert_eq!((&light["intensity"], &light["color"]), (&json!(100.0), &json!([0.5, 1.0, 0.0])));
    assert_eq!(light["extras"]["lumel"]["baked"], true);
    let vertex = bake.write(GltfProfile::Vertex);
    assert_eq!(vertex.json["meshes"].as_array().unwrap().len(), 2);
}

#[test]
fn broken_documents_are_errors() {
    for broken in ["/accessors/0/count", "/bufferViews/0/byteLength", "/meshes/0/primitives/0/attributes/POSITION"] {
        let mut source = source();
        *source.json.pointer_mut(broken).unwrap() = 1_000_000.into();
        let bake = Bake { source: Source::Gltf(source), ..Bake::new(true) };
        let baked = Baked {
            scene: &bake.scene,
            source: &bake.source,
            atlas: &bake.atlas,
            lightmap: Some(&bake.lightmap),
            quantity: bake.lightmap.quantity,
            vertices: Some(&bake.vertices),
            page_uris: &[],
            encoded: &[],
            vertex_colors: Default::default(),
            lightmap_extension: None,
            folder: Path::new("out"),
            lights: bake.lights,
        };
        let path = std::env::temp_dir().join("lumel-never-written.glb");
        assert!(lumel::write::gltf::write(&path, &baked, GltfProfile::Engine).is_err(), "{broken}");
        assert!(!path.exists());
    }
}

/// The texture's picture, by the place of its index.
fn picture_of<'a>(glb: &'a Glb, texture: &Value, rgbe: bool) -> &'a Value {
    let texture = &glb.json["textures"][texture.as_u64().unwrap() as usize];
    let source = if rgbe { &texture["extensions"]["MOZ_texture_rgbe"]["source"] } else { &texture["source"] };
    &glb.json["images"][source.as_u64().unwrap() as usize]
}

#[test]
fn moz_lightmaps_have_uvs_of_the_page_and_a_material_for_each() {
    let bake = Bake::on_two_pages(LightmapExtension::Moz, Encoding::Hdr, 1.0);
    let glb = bake.write(GltfProfile::Engine);
    for name in ["MOZ_lightmap", "MOZ_texture_rgbe"] {
        assert!(glb.json["extensionsUsed"].as_array().unwrap().contains(&json!(name)), "{name}");
    }
    let mut materials = Vec::new();
    for node in 0..2 {
        let object = &glb.json["nodes"][node];
        let primitive = &glb.json["meshes"][object["mesh"].as_u64().unwrap() as usize]["primitives"][0];
        let uv = glb.rows(primitive["attributes"]["TEXCOORD_1"].as_u64().unwrap() as usize, 2);
        let indices = glb.unsigned(primitive["indices"].as_u64().unwrap() as usize);
        let placement = &bake.atlas.placements[node];
        for (corner, index) in uvs(false).concat().iter().zip(&indices) {
            let expected = *corner * placement.scale + placement.offset;
            assert!(Vec2::from_slice(&uv[*index as usize]).distance(expected) < 1e-6);
        }
        let lumel = &object["extras"]["lumel"];
        assert_eq!((&lumel["scale"], &lumel["offset"]), (&json!([1.0, 1.0]), &json!([0.0, 0.0])));
        let material = primitive["material"].as_u64().unwrap() as usize;
        let lightmap = &glb.json["materials"][material]["extensions"]["MOZ_lightmap"];
        // E / pi in a slot for E.
        assert!((lightmap["intensity"].as_f64().unwrap() - std::f64::consts::PI).abs() < 1e-6);
        assert_eq!((&lightmap["texCoord"], &glb.json["materials"][material]["name"]), (&json!(1), &json!("paint")));
        let picture = picture_of(&glb, &lightmap["index"], true);
        assert_eq!(picture["uri"], format!("lightmaps/a%20square_{node}.hdr"));
        materials.push(material);
    }
    // The node outside of the scene keeps the mesh and the material without a lightmap.
    let elsewhere = glb.json["nodes"][3]["mesh"].as_u64().unwrap() as usize;
    let plain = glb.json["meshes"][elsewhere]["primitives"][0]["material"].as_u64().unwrap() as usize;
    assert!(!materials.contains(&plain) && materials[0] != materials[1]);
    assert_eq!(glb.json["materials"][plain], source().json["materials"][0]);
}

#[test]
fn mx_and_needle_lightmaps_have_rectangles_on_nodes() {
    let bake = Bake::on_two_pages(LightmapExtension::Mx, Encoding::Rgbm, 4.0);
    let glb = bake.write(GltfProfile::Engine);
    let mx = &glb.json["nodes"][1]["extensions"]["MX_lightmap"];
    assert_eq!((&mx["scale"], &mx["offset"]), (&json!([0.25, 0.5]), &json!([0.6, 0.125])));
    assert!((mx["intensity"].as_f64().unwrap() - 4.0 * std::f64::consts::PI).abs() < 1e-5);
    assert_eq!(picture_of(&glb, &mx["lightMapTexture"]["index"], false)["uri"], "lightmaps/a%20square_1.rgbm.png");

    let mut bake = Bake::on_two_pages(LightmapExtension::Needle, Encoding::RgbmSrgb, 1.0);
    bake.lightmap.quantity = Quantity::Irradiance;
    let glb = bake.write(GltfProfile::Engine);
    let textures = glb.json["extensions"]["NEEDLE_lightmaps"]["textures"].as_array().unwrap();
    assert_eq!((&textures[1]["type"], &textures[1]["index"]), (&json!(0), &json!(1)));
    let pointer = textures[1]["pointer"].as_str().unwrap().strip_prefix("/textures/").unwrap();
    let picture = picture_of(&glb, &pointer.parse::<u64>().unwrap().into(), false);
    assert_eq!(picture["uri"], "lightmaps/a%20square_1.rgbm-srgb.png");
    let renderer = &glb.json["nodes"][1]["extensions"]["NEEDLE_components"]["builtin_components"][0];
    assert_eq!((&renderer["name"], &renderer["lightmapIndex"]), (&json!("MeshRenderer"), &json!(1)));
    // v up: w = 1 - 0.5 - 0.125.
    assert_eq!(renderer["lightmapScaleOffset"], json!({ "x": 0.25, "y": 0.5, "z": 0.6, "w": 0.375 }));
}

#[test]
fn a_baked_file_loses_the_lightmaps_of_its_earlier_bake() {
    let mut old = source();
    old.json["materials"][0]["extensions"] = json!({ "MOZ_lightmap": { "index": 0, "texCoord": 1 } });
    old.json["nodes"][0]["extensions"] = json!({ "MX_lightmap": { "lightMapTexture": { "index": 0 } } });
    old.json["extensionsUsed"] = json!(["MOZ_lightmap", "MX_lightmap"]);
    let bake = Bake { source: Source::Gltf(old), ..Bake::new(false) };
    let text = bake.write(GltfProfile::Engine).json.to_string();
    assert!(!text.contains("MOZ_lightmap") && !text.contains("MX_lightmap"), "{text}");
}
