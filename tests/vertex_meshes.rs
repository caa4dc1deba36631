//! Meshes that were cut for the light: what vertex GLBs hold at new vertices, and that nothing tears.

mod cut;
mod files;
mod glb;
mod gltf_document;

use cut::{FACES, POINTS, assert_closed, cut, hidden};
use glam::{Affine3A, DVec3, Mat3A, Vec2, Vec3};
use glb::Glb;
use gltf_document::{Builder, Folder};
use lumel::color::Rgb;
use lumel::load::usd::UsdSource;
use lumel::load::{Loaded, Source};
use lumel::meshing::{LitMesh, LitTriangle, VertexLight};
use lumel::post::Quantity;
use lumel::scene::{Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin, UvSet};
use lumel::write::{Baked, BakedLights, GltfProfile, VertexColors};
use serde_json::{Value, json};

/// The vertex GLB of a scene whose surfaces have the light `light`.
fn write(scene: &Scene, source: &Source, light: &VertexLight, form: VertexColors) -> Glb {
    let folder = std::env::temp_dir().join(format!("lumel-vertex-meshes-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(format!("{:?}.glb", std::thread::current().id()));
    let atlas = hidden(scene);
    let baked = Baked {
        scene,
        source,
        atlas: &atlas,
        lightmap: None,
        vertices: Some(light),
        quantity: Quantity::Outgoing,
        page_uris: &[],
        encoded: &[],
        vertex_colors: form,
        lightmap_extension: None,
        folder: &folder,
        lights: BakedLights::Mark,
    };
    lumel::write::gltf::write(&path, &baked, GltfProfile::Vertex).unwrap();
    Glb::parse(&std::fs::read(&path).unwrap())
}

/// A glTF with every mesh cut, before and after.
struct Cut {
    loaded: Loaded,
    light: VertexLight,
    glb: Glb,
}

impl Cut {
    fn new(name: &str, builder: Builder, document: Value) -> Self {
        let folder = Folder::new(name);
        let loaded = gltf_document::load(&folder, &builder.gltf(document));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let meshes = loaded.scene.surfaces.iter().map(|s| cut(&loaded.scene.meshes[s.mesh]));
        let light = VertexLight { surfaces: meshes.collect() };
        let glb = write(&loaded.scene, &loaded.source, &light, VertexColors::Float);
        Self { loaded, light, glb }
    }

    fn mesh(&self) -> &Mesh {
        &self.loaded.scene.meshes[0]
    }

    /// The pieces of primitive `part`, in the order in which its triangles are written.
    fn pieces(&self, part: usize) -> Vec<LitTriangle> {
        let is_own = |t: &&LitTriangle| self.mesh().origin[t.source as usize].part as usize == part;
        self.light.surfaces[0].triangles.iter().filter(is_own).copied().collect()
    }

    /// For each corner of each written triangle: the written vertex, and the source's vertices with their weights.
    fn corners(&self, part: usize) -> Vec<(usize, Vec<(usize, f64)>)> {
        let indices = self.glb.unsigned(self.primitive(part)["indices"].as_u64().unwrap() as usize);
        let mesh = self.mesh();
        let blends = self.pieces(part).into_iter().flat_map(|piece| {
            let vertices = mesh.origin[piece.source as usize].corners;
            let positions = mesh.triangles[piece.source as usize].map(|v| mesh.positions[v as usize]);
            piece.corners.map(|c| c.terms(positions).map(|(k, w)| (vertices[k] as usize, w)).collect::<Vec<_>>())
        });
        let corners: Vec<_> = indices.iter().map(|i| *i as usize).zip(blends).collect();
        assert_eq!(corners.len(), indices.len());
        corners
    }

    fn primitive(&self, part: usize) -> &Value {
        &self.glb.json["meshes"][0]["primitives"][part]
    }

    fn attribute(&self, part: usize, name: &str) -> usize {
        self.primitive(part)["attributes"][name].as_u64().unwrap() as usize
    }

    fn rows(&self, part: usize, name: &str, width: usize) -> Vec<Vec<f32>> {
        self.glb.rows(self.attribute(part, name), width)
    }

    /// The written triangles of the parts, by their places.
    fn triangles(&self, parts: usize) -> Vec<[Vec3; 3]> {
        let of_part = |part| {
            let places = self.rows(part, "POSITION", 3);
            self.corners(part)
                .chunks(3)
                .map(|t| [0, 1, 2].map(|k| Vec3::from_slice(&places[t[k].0])))
                .collect::<Vec<_>>()
        };
        (0..parts).flat_map(of_part).collect()
    }
}

fn corner_rows<const N: usize>(of: impl Fn(usize, usize) -> [f32; N]) -> Vec<[f32; N]> {
    FACES.iter().enumerate().flat_map(|(f, corners)| corners.map(|p| of(f, p))).collect()
}

/// The weighted sum of rows in f64.
fn blend(terms: &[(usize, f64)], row: impl Fn(usize) -> Vec<f32>) -> Vec<f64> {
    let mut sum = vec![0.0; row(terms[0].0).len()];
    for (v, w) in terms {
        sum.iter_mut().zip(row(*v)).for_each(|(s, x)| *s += w * f64::from(x));
    }
    sum
}

#[test]
fn vertices_between_others_blend_all_that_they_hold() {
    let mut b = Builder::default();
    let places = corner_rows(|_, p| POINTS[p]);
    let normals = corner_rows(|f, p| (Vec3::from_array(POINTS[p]) - 1.0 + f as f32).normalize().to_array());
    let tangents = corner_rows(|f, p| {
        let side = if f % 2 == 0 { 1.0 } else { -1.0 };
        Vec3::new(p as f32 - 1.5, 1.0, f as f32).normalize().extend(side).to_array()
    });
    let uvs = corner_rows(|f, p| [f as f32 + 0.1, p as f32 / 3.0]);
    let colors = corner_rows(|_, p| [p as f32 / 4.0, 0.5, 0.25, 1.0 - p as f32 / 5.0]);
    let heat = corner_rows(|f, p| [10.0 * f as f32 + p as f32]);
    let [position, normal, tangent] = [b.floats(&places), b.floats(&normals), b.floats(&tangents)];
    let [uv, color, own] = [b.floats(&uvs), b.floats(&colors), b.floats(&heat)];
    let ids = b.view(&(0..48).map(|i| if i % 4 == 0 { 20 * (i / 4) } else { 0 }).collect::<Vec<u8>>(), Some(4));
    let id = b.accessor(json!({ "bufferView": ids, "componentType": 5121, "count": 12, "type": "SCALAR" }));
    let attributes = json!({ "POSITION": position, "NORMAL": normal, "TANGENT": tangent, "TEXCOORD_0": uv,
        "COLOR_0": color, "_HEAT": own, "_ID": id });
    let cut = Cut::new("blend", b, gltf_document::one(json!({ "attributes": attributes })));
    assert_closed(&cut.triangles(1), POINTS.map(Vec3::from_array));

    let written = |name, width| cut.rows(0, name, width);
    let (found_normals, found_tangents) = (written("NORMAL", 3), written("TANGENT", 4));
    let found = [("POSITION", 3), ("TEXCOORD_0", 2), ("_HEAT", 1)].map(|(name, width)| written(name, width));
    let found_ids = cut.glb.unsigned(cut.attribute(0, "_ID"));
    let (light, shown) = (written("_IRRADIANCE", 3), written("COLOR_0", 4));
    let scale = cut.glb.json["asset"]["extras"]["lumel"]["vertexScale"].as_f64().unwrap() as f32;
    let values = cut.pieces(0).into_iter().flat_map(|p| p.values);
    for ((vertex, terms), value) in cut.corners(0).iter().zip(values) {
        let sources: [&dyn Fn(usize) -> Vec<f32>; 3] =
            [&|v| places[v].to_vec(), &|v| uvs[v].to_vec(), &|v| heat[v].to_vec()];
        for (found, source) in found.iter().zip(sources) {
            let expected: Vec<f32> = blend(terms, source).into_iter().map(|v| v as f32).collect();
            assert_eq!(found[*vertex], expected);
        }
        let normal = DVec3::from_slice(&blend(terms, |v| normals[v].to_vec())).normalize();
        let found = Vec3::from_slice(&found_normals[*vertex]);
        assert!(found.as_dvec3().distance(normal) < 1e-6 && (found.length() - 1.0).abs() < 1e-6);
        let tangent = DVec3::from_slice(&blend(terms, |v| tangents[v][..3].to_vec())).normalize();
        assert!(Vec3::from_slice(&found_tangents[*vertex]).as_dvec3().distance(tangent) < 1e-6);
        assert_eq!(found_tangents[*vertex][3], tangents[terms[0].0][3]);
        // A number that names something is one of those there are.
        let strongest = terms.iter().map(|t| t.1).fold(0.0, f64::max);
        assert!(terms.iter().any(|(v, w)| *w == strongest && found_ids[*vertex] == 20 * *v as u32));
        assert_eq!(light[*vertex], value.to_array());
        let own = blend(terms, |v| colors[v].to_vec());
        for c in 0..3 {
            assert!((f64::from(shown[*vertex][c] * scale) - f64::from(value[c]) * own[c]).abs() < 1e-5);
        }
        assert!((f64::from(shown[*vertex][3]) - own[3]).abs() < 1e-6);
    }
    // 6 edges and 4 middles, on 12 vertices that share nothing: 3 edges and a middle for each face.
    assert_eq!(light.len(), 12 + 4 * 4);
}

/// A document of the tetrahedron with four shared vertices, all else given.
fn shared(position: usize, primitives: &[(usize, u32)], more: Value) -> Value {
    let primitive = |(indices, mode): &(usize, u32)| {
        let mut attributes = json!({ "POSITION": position });
        attributes.as_object_mut().unwrap().extend(more["attributes"].as_object().cloned().unwrap_or_default());
        let mut primitive = json!({ "attributes": attributes, "indices": indices, "mode": mode });
        if let Some(targets) = more.get("targets") {
            primitive["targets"] = targets.clone();
        }
        primitive
    };
    let primitives: Vec<Value> = primitives.iter().map(primitive).collect();
    json!({ "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": primitives }] })
}

#[test]
fn strips_fans_and_primitives_that_share_vertices_stay_closed() {
    // As a strip, as a list, and as a fan with a triangle beside it, over the same four vertices.
    let strip: (&[u16], u32) = (&[0, 2, 1, 3, 0, 2], 5);
    let list: (&[u16], u32) = (&[0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3], 4);
    let cases: [&[(&[u16], u32)]; 4] =
        [&[strip], &[list], &[(&[0, 2, 1, 3, 2], 6), (&[1, 2, 3], 4)], &[(&list.0[..6], 4), (&list.0[6..], 4)]];
    for (case, primitives) in cases.into_iter().enumerate() {
        let mut b = Builder::default();
        let position = b.floats(&POINTS);
        let primitives: Vec<_> = primitives.iter().map(|(indices, mode)| (b.indices(indices), *mode)).collect();
        let count = primitives.len();
        let cut = Cut::new(&format!("modes {case}"), b, shared(position, &primitives, json!({})));
        assert_closed(&cut.triangles(count), POINTS.map(Vec3::from_array));
        // Values agree at every place, so the four vertices, the six edges' and the four middles are all there are.
        let groups: std::collections::BTreeSet<usize> = (0..count).map(|p| cut.attribute(p, "POSITION")).collect();
        assert_eq!(groups.len(), 1, "they share their new vertices");
        assert_eq!(cut.rows(0, "POSITION", 3).len(), 4 + 6 + 4);
        for part in 0..count {
            assert_eq!(cut.primitive(part)["mode"], 4);
        }
    }
}

#[test]
fn morph_targets_are_blended_and_take_the_light_to_where_they_move() {
    let mut b = Builder::default();
    let position = b.floats(&POINTS);
    let indices = b.indices(&FACES.concat().iter().map(|v| *v as u16).collect::<Vec<_>>());
    let deltas = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.25], [0.1, 0.0, -0.3], [0.7, 0.7, 0.7]];
    let first = b.floats(&deltas);
    let (at, to) = (b.view(&[2, 0, 0, 0], None), b.view(&[0, 0, 64, 64, 0, 0, 0, 0, 0, 0, 128, 63], None));
    let second = b.accessor(json!({ "componentType": 5126, "count": 4, "type": "VEC3", "sparse": { "count": 1,
        "indices": { "bufferView": at, "componentType": 5121 }, "values": { "bufferView": to } } }));
    let sparse = [[0.0; 3], [0.0; 3], [3.0, 0.0, 1.0], [0.0; 3]];
    let targets = json!([{ "POSITION": first }, { "POSITION": second }]);
    let mut document = shared(position, &[(indices, 4)], json!({ "targets": targets }));
    document["meshes"][0]["weights"] = json!([0.25, 0.5]);
    let cut = Cut::new("morph", b, document);
    assert_eq!(cut.glb.json["meshes"][0]["weights"], json!([0.25, 0.5]));
    assert_closed(&cut.triangles(1), POINTS.map(Vec3::from_array));
    for (target, deltas) in [deltas, sparse].into_iter().enumerate() {
        let found = cut.glb.rows(cut.primitive(0)["targets"][target]["POSITION"].as_u64().unwrap() as usize, 3);
        for (vertex, terms) in cut.corners(0) {
            let expected: Vec<f32> = blend(&terms, |v| deltas[v].to_vec()).into_iter().map(|v| v as f32).collect();
            assert_eq!(found[vertex], expected, "target {target}");
        }
    }
}

/// A skinned, animated tetrahedron of which the vertices have up to `sets` x 4 joints; weights as `weights` makes them.
fn skinned(
    b: &mut Builder,
    joints: &[[[u8; 4]; 4]],
    weights: impl Fn(&mut Builder, usize) -> usize,
    joint_count: usize,
) -> Value {
    let position = b.floats(&POINTS);
    let indices = b.indices(&FACES.concat().iter().map(|v| *v as u16).collect::<Vec<_>>());
    let mut attributes = json!({});
    for (set, joints) in joints.iter().enumerate() {
        let view = b.view(&joints.concat(), None);
        let joints = json!({ "bufferView": view, "componentType": 5121, "count": 4, "type": "VEC4" });
        attributes[format!("JOINTS_{set}")] = b.accessor(joints).into();
        attributes[format!("WEIGHTS_{set}")] = weights(b, set).into();
    }
    let mut document = shared(position, &[(indices, 4)], json!({ "attributes": attributes }));
    let (times, turns) = (b.floats(&[[0.0], [1.0]]), b.floats(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.6, 0.0, 0.8]]));
    b.accessors[times]["min"] = json!([0]);
    b.accessors[times]["max"] = json!([1]);
    document["animations"] = json!([{ "samplers": [{ "input": times, "output": turns }],
        "channels": [{ "sampler": 0, "target": { "node": 1, "path": "rotation" } }] }]);
    document["skins"] = json!([{ "joints": (1..=joint_count).collect::<Vec<_>>() }]);
    document["nodes"][0]["skin"] = 0.into();
    document["scenes"][0]["nodes"] = (0..=joint_count).collect::<Vec<_>>().into();
    document["nodes"].as_array_mut().unwrap().extend((0..joint_count).map(|_| json!({})));
    document
}

/// The influences of each vertex by joint.
fn influences(joints: &[u32], weights: &[f64], count: usize, joint_count: usize) -> Vec<Vec<f64>> {
    let mut all = vec![vec![0.0; joint_count]; count];
    for (i, (joint, weight)) in joints.iter().zip(weights).enumerate() {
        all[i / 4][*joint as usize] += weight;
    }
    all
}

#[test]
fn influences_of_joints_are_blended_and_add_up_to_one() {
    let joints = [[0, 1, 0, 0], [1, 2, 0, 0], [2, 0, 1, 0], [3, 0, 0, 0]];
    let bytes: [[u8; 4]; 4] = [[200, 55, 0, 0], [128, 127, 0, 0], [85, 85, 85, 0], [255, 0, 0, 0]];
    for quantized in [false, true] {
        let mut b = Builder::default();
        let weights = |b: &mut Builder, _| {
            if quantized {
                let view = b.view(&bytes.concat(), None);
                let keys = json!({ "bufferView": view, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC4" });
                b.accessor(keys)
            } else {
                b.floats(&bytes.map(|row| row.map(|v| f32::from(v) / 255.0)))
            }
        };
        let document = skinned(&mut b, &[joints], weights, 4);
        let animated: Vec<Value> = document["animations"].as_array().unwrap().clone();
        let before = Glb { json: json!({ "accessors": b.accessors, "bufferViews": b.views }), bin: b.bin.clone() };
        let cut = Cut::new(&format!("skin {quantized}"), b, document);
        assert_closed(&cut.triangles(1), POINTS.map(Vec3::from_array));

        let (accessor, one) = (cut.attribute(0, "WEIGHTS_0"), if quantized { 255.0 } else { 1.0 });
        let found: Vec<f64> = if quantized {
            assert_eq!(cut.glb.json["accessors"][accessor]["normalized"], true);
            cut.glb.unsigned(accessor).into_iter().map(f64::from).collect()
        } else {
            cut.glb.floats(accessor).into_iter().map(f64::from).collect()
        };
        for row in found.chunks(4) {
            let sum: f64 = row.iter().sum();
            assert!(if quantized { sum == 255.0 } else { (sum - 1.0).abs() < 2e-7 }, "{row:?}");
        }
        let found_joints = cut.glb.unsigned(cut.attribute(0, "JOINTS_0"));
        let by_joint = influences(&found_joints, &found, found.len() / 4, 4);
        let flat: Vec<f64> = bytes.concat().iter().map(|v| f64::from(*v) / 255.0 * one).collect();
        let source = influences(&joints.concat().iter().map(|j| u32::from(*j)).collect::<Vec<_>>(), &flat, 4, 4);
        for (vertex, terms) in cut.corners(0) {
            for joint in 0..4 {
                let expected: f64 = terms.iter().map(|(v, w)| w * source[*v][joint]).sum();
                let error = (by_joint[vertex][joint] - expected).abs();
                assert!(error < if quantized { 1.0 } else { 1e-6 }, "{:?} {expected}", by_joint[vertex]);
            }
        }
        // What moves it is what it was.
        assert_eq!(cut.glb.json["animations"], json!(animated));
        assert_eq!(cut.glb.json["skins"], json!([{ "joints": [1, 2, 3, 4] }]));
        let sampler = &animated[0]["samplers"][0];
        for key in ["input", "output"] {
            let accessor = sampler[key].as_u64().unwrap() as usize;
            assert_eq!(cut.glb.floats(accessor), before.floats(accessor));
        }
    }
}

#[test]
fn the_strongest_joints_are_kept_in_as_many_sets_as_there_were() {
    // The four vertices have 13 joints between them; a face's middle is moved by up to ten.
    let joints = [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 0], [11, 12, 0, 0]];
    let weights = [[0.4, 0.3, 0.2, 0.1], [0.7, 0.1, 0.1, 0.1], [0.25; 4], [0.9, 0.1, 0.0, 0.0]];
    let mut b = Builder::default();
    let document = skinned(&mut b, &[joints], |b, _| b.floats(&weights), 13);
    let cut = Cut::new("many joints", b, document);
    let found = cut.rows(0, "WEIGHTS_0", 4);
    let found_joints = cut.glb.unsigned(cut.attribute(0, "JOINTS_0"));
    for (vertex, terms) in cut.corners(0) {
        let mut by_joint = [0.0f64; 13];
        for (v, w) in &terms {
            (0..4).for_each(|c| by_joint[joints[*v][c] as usize] += w * f64::from(weights[*v][c]));
        }
        let mut sorted = by_joint;
        sorted.sort_by(|a, b| b.total_cmp(a));
        let kept: f64 = sorted[..4].iter().sum();
        assert!((found[vertex].iter().sum::<f32>() - 1.0).abs() < 2e-7);
        for c in 0..4 {
            let expected =
                if terms.len() == 1 { by_joint[found_joints[4 * vertex + c] as usize] } else { sorted[c] / kept };
            assert!(terms.len() == 1 || (f64::from(found[vertex][c]) - expected).abs() < 1e-6, "{terms:?}");
        }
    }
}

#[test]
fn integers_are_rounded_alike_on_both_sides() {
    let mut b = Builder::default();
    let steps: [[i16; 4]; 4] = [[100, -200, 301, 0], [17001, 303, -111, 0], [407, 23003, 700, 0], [901, 603, 31007, 0]];
    let view = b.view(&steps.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>(), Some(8));
    let position = b.accessor(json!({ "bufferView": view, "componentType": 5122, "count": 4, "type": "VEC3",
        "min": [100, -200, -111], "max": [17001, 23003, 31007] }));
    let normals: [[i8; 4]; 4] = [[-73, -73, -73, 0], [127, 0, 0, 0], [0, 127, 0, 0], [0, 0, 127, 0]];
    let view = b.view(&normals.concat().iter().map(|v| *v as u8).collect::<Vec<_>>(), Some(4));
    let keys = json!({ "bufferView": view, "componentType": 5120, "normalized": true, "count": 4, "type": "VEC3" });
    let normal = b.accessor(keys);
    let indices = b.indices(&FACES.concat().iter().map(|v| *v as u16).collect::<Vec<_>>());
    let mut document = shared(position, &[(indices, 4)], json!({ "attributes": { "NORMAL": normal } }));
    document["nodes"][0]["scale"] = json!([0.001, 0.001, 0.001]);
    document["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let cut = Cut::new("quantized", b, document);

    let keys = &cut.glb.json["accessors"][cut.attribute(0, "POSITION")];
    assert_eq!(
        (&keys["componentType"], &keys["min"], &keys["max"]),
        (&json!(5122), &json!([100, -200, -111]), &json!([17001, 23003, 31007]))
    );
    let signed = |name: &str, bits: u32| -> Vec<f32> {
        let numbers = cut.glb.unsigned(cut.attribute(0, name));
        numbers.into_iter().map(|v| (v << (32 - bits)) as i32 >> (32 - bits)).map(|v| v as f32).collect()
    };
    let (places, directions) = (signed("POSITION", 16), signed("NORMAL", 8));
    let mut triangles = Vec::new();
    for (vertex, terms) in cut.corners(0) {
        let place = Vec3::from_slice(&places[3 * vertex..]);
        let exact = blend(&terms, |v| steps[v][..3].iter().map(|v| f32::from(*v)).collect());
        assert!((0..3).all(|c| f64::from(place[c]) == exact[c].round()), "{place} {exact:?}");
        let length = Vec3::from_slice(&directions[3 * vertex..]).length();
        assert!((length - 127.0).abs() < 1.0, "{length}");
        triangles.push(place);
    }
    let triangles: Vec<[Vec3; 3]> = triangles.chunks(3).map(|t| [t[0], t[1], t[2]]).collect();
    let volume = |[a, b, c]: [Vec3; 3]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3()));
    assert!(triangles.iter().map(|t| volume(*t)).sum::<f64>() > 0.0);
    assert_closed(&triangles, steps.map(|s| Vec3::new(s[0].into(), s[1].into(), s[2].into())));
}

#[test]
fn meshes_that_were_not_cut_stay_byte_for_byte() {
    let mut b = Builder::default();
    let (position, uv) = (b.floats(&POINTS), b.floats(&[[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8]]));
    let indices = b.indices(&FACES.concat().iter().map(|v| *v as u16).collect::<Vec<_>>());
    let primitive = json!({ "attributes": { "POSITION": position, "TEXCOORD_0": uv }, "indices": indices });
    let document = json!({ "nodes": [{ "mesh": 0 }, { "mesh": 1, "translation": [5, 0, 0] }],
        "meshes": [{ "primitives": [primitive.clone()] }, { "primitives": [primitive] }] });
    let (accessors, bin) = (b.accessors.clone(), b.bin.clone());
    let folder = Folder::new("untouched");
    let loaded = gltf_document::load(&folder, &b.gltf(document.clone()));
    let mesh = &loaded.scene.meshes[loaded.scene.surfaces[0].mesh];
    let given = LitMesh::given(vec![[Rgb::ONE; 3]; 4]);
    let light = VertexLight { surfaces: vec![cut(mesh), given] };
    let glb = write(&loaded.scene, &loaded.source, &light, VertexColors::Float);
    let other = &glb.json["meshes"][1]["primitives"][0];
    for (name, accessor) in [("POSITION", position), ("TEXCOORD_0", uv)] {
        assert_eq!(other["attributes"][name], accessor);
    }
    assert_eq!(other["indices"], indices);
    let before = Glb { json: json!({ "accessors": accessors, "bufferViews": glb.json["bufferViews"] }), bin };
    for accessor in [position, uv] {
        assert_eq!(glb.json["accessors"][accessor], before.json["accessors"][accessor]);
        assert_eq!(glb.floats(accessor), before.floats(accessor));
    }
    assert_ne!(glb.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"], position);
}

#[test]
fn colours_come_in_8_and_16_bits() {
    let mut b = Builder::default();
    let position = b.floats(&POINTS);
    let indices = b.indices(&FACES.concat().iter().map(|v| *v as u16).collect::<Vec<_>>());
    let cut = Cut::new("forms", b, shared(position, &[(indices, 4)], json!({})));
    let exact = cut.rows(0, "COLOR_0", 3);
    for (form, kind, one, stride) in [(VertexColors::U8, 5121, 255.0, 4), (VertexColors::U16, 5123, 65535.0, 8)] {
        let glb = write(&cut.loaded.scene, &cut.loaded.source, &cut.light, form);
        let attributes = &glb.json["meshes"][0]["primitives"][0]["attributes"];
        let accessor = attributes["COLOR_0"].as_u64().unwrap() as usize;
        let keys = &glb.json["accessors"][accessor];
        assert_eq!(
            (&keys["componentType"], &keys["normalized"], &keys["type"]),
            (&json!(kind), &json!(true), &json!("VEC4"))
        );
        let view = &glb.json["bufferViews"][keys["bufferView"].as_u64().unwrap() as usize];
        assert_eq!(view["byteLength"].as_u64().unwrap() as usize, stride * exact.len());
        for (found, exact) in glb.unsigned(accessor).chunks(4).zip(&exact) {
            for c in 0..3 {
                assert_eq!(f64::from(found[c]), (f64::from(exact[c]) * one).round());
            }
            assert_eq!(f64::from(found[3]), one);
        }
        let light = glb.rows(attributes["_IRRADIANCE"].as_u64().unwrap() as usize, 3);
        assert_eq!(light, cut.rows(0, "_IRRADIANCE", 3));
    }
}

#[test]
fn a_scene_from_elsewhere_is_cut_and_closed_under_any_transform() {
    let corners = |of: fn(usize) -> Vec3| FACES.concat().into_iter().map(of).collect::<Vec<_>>();
    let mesh = Mesh {
        name: "tetrahedron".into(),
        positions: corners(|p| Vec3::from_array(POINTS[p])),
        normals: corners(|p| (Vec3::from_array(POINTS[p]) - 1.0).normalize()),
        uvs: vec![UvSet { name: "st".into(), coords: (0..12).map(|v| Vec2::new(0.1 * v as f32, 0.3)).collect() }],
        triangles: (0..4).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
        triangle_material: vec![0, 1, 0, 1],
        origin: vec![TriangleOrigin::default(); 4],
        ..Mesh::default()
    };
    let surface = |name: &str, matrix: Mat3A| Surface {
        name: name.into(),
        mesh: 0,
        world_from_local: Affine3A { matrix3: matrix, translation: [0.3, 0.7, -5.1].into() },
        origin: SurfaceOrigin::UsdPrim,
        role: Default::default(),
    };
    let sheared = Mat3A::from_cols([-1.1, 0.2, 0.0].into(), [0.3, 1.3, 0.1].into(), [0.0, 0.5, 0.9].into());
    let scene = Scene {
        materials: vec![Material::default(); 2],
        surfaces: vec![surface("/plain", Mat3A::IDENTITY), surface("/sheared", sheared)],
        meshes: vec![mesh],
        ..Scene::default()
    };
    let light = VertexLight { surfaces: vec![cut(&scene.meshes[0]); 2] };
    let source = Source::Usd(UsdSource { path: "tetrahedron.usda".into(), ..UsdSource::default() });
    let glb = write(&scene, &source, &light, VertexColors::Float);
    for node in 0..2 {
        let mesh = &glb.json["meshes"][glb.json["nodes"][node]["mesh"].as_u64().unwrap() as usize];
        let mut triangles = Vec::new();
        for primitive in mesh["primitives"].as_array().unwrap() {
            let accessor = |name: &str| primitive["attributes"][name].as_u64().unwrap() as usize;
            let places = glb.rows(accessor("POSITION"), 3);
            let indices = glb.unsigned(primitive["indices"].as_u64().unwrap() as usize);
            triangles.extend(indices.chunks(3).map(|t| [0, 1, 2].map(|k| Vec3::from_slice(&places[t[k] as usize]))));
            for normal in glb.rows(accessor("NORMAL"), 3) {
                assert!((Vec3::from_slice(&normal).length() - 1.0).abs() < 1e-5);
            }
            assert_eq!(glb.floats(accessor("_IRRADIANCE")).len(), 3 * places.len());
        }
        let transform = scene.surfaces[node].world_from_local;
        let points = POINTS.map(Vec3::from_array);
        assert_eq!(mesh["primitives"].as_array().unwrap().len(), 2);
        match node {
            0 => assert_closed(&triangles, points),
            // Mirrored: the mesh takes the transform, and its faces turn round to stay outward.
            _ => {
                assert!(transform.matrix3.determinant() < 0.0);
                let turned: Vec<[Vec3; 3]> = triangles
                    .iter()
                    .map(|[a, b, c]| [*a, *c, *b])
                    .map(|t| t.map(|p| transform.inverse().transform_point3(p)))
                    .collect();
                let bits = |p: Vec3| p.to_array().map(f32::to_bits);
                let places: std::collections::BTreeSet<_> = triangles.iter().flatten().map(|p| bits(*p)).collect();
                assert_eq!(places.len(), 4 + 6 + 4, "every edge is cut at one place");
                let volume = |[a, b, c]: [Vec3; 3]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0;
                let whole: f64 = FACES.iter().map(|f| volume(f.map(|k| points[k]))).sum();
                let found: f64 = turned.iter().map(|t| volume(*t)).sum();
                assert!((found - whole).abs() < 1e-4 * whole, "{found} of {whole}");
            }
        }
    }
}
