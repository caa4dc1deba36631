//! The USD layer of meshes that were cut for the light: written for loaded stages, opened again over them.

mod cut;
mod files;

use cut::{FACES, POINTS, assert_closed, cut, hidden};
use files::Folder;
use glam::Vec3;
use lumel::load::{LoadOptions, Loaded, load_with};
use lumel::meshing::{LitMesh, VertexLight};
use lumel::post::Quantity;
use lumel::write::{Baked, BakedLights, usd};
use openusd::gf::{Vec2f, Vec3f};
use openusd::sdf::FromValue;
use openusd::usd::{Prim, Stage};

/// The tetrahedron as a mesh, with texture coordinates that differ at every corner and a material subset.
fn mesh(name: &str, more: &str) -> String {
    let points: Vec<String> = POINTS.iter().map(|[x, y, z]| format!("({x}, {y}, {z})")).collect();
    let indices: Vec<String> = FACES.concat().iter().map(usize::to_string).collect();
    let coords: Vec<String> = (0..12).map(|k| format!("({}, 0.25)", k as f32 / 8.0)).collect();
    format!(
        r#"def Mesh "{name}" {{
    point3f[] points = [{}]
    int[] faceVertexCounts = [3, 3, 3, 3]
    int[] faceVertexIndices = [{}]
    texCoord2f[] primvars:st = [{}] ( interpolation = "faceVarying" )
    uniform token subdivisionScheme = "none"
    {more}
}}
"#,
        points.join(", "),
        indices.join(", "),
        coords.join(", ")
    )
}

fn stage(body: &str) -> String {
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 0.01\n    upAxis = \"Z\"\n)\ndef Xform \"World\"\n{{\n{body}\n}}\n"
    )
}

/// Loads `usda`, gives its surfaces the light that `light` makes of them, and opens both layers of the result.
fn layers(name: &str, usda: &str, light: impl Fn(&Loaded, usize) -> LitMesh) -> (Stage, Stage, Vec<String>) {
    let folder = Folder::new(&format!("vertex layer {name}"));
    let loaded = load_with(&folder.write("room.usda", usda), &LoadOptions::default()).unwrap();
    let scene = &loaded.scene;
    let atlas = hidden(scene);
    let vertices = VertexLight { surfaces: (0..scene.surfaces.len()).map(|s| light(&loaded, s)).collect() };
    let baked = Baked {
        scene,
        source: &loaded.source,
        atlas: &atlas,
        lightmap: None,
        vertices: Some(&vertices),
        quantity: Quantity::Outgoing,
        page_uris: &[],
        encoded: &[],
        vertex_colors: Default::default(),
        lightmap_extension: None,
        folder: &folder.0,
        lights: BakedLights::Mark,
    };
    let (pieces, given) = (folder.0.join("room.vertex.usda"), folder.0.join("room.lumel.usda"));
    let warnings = usd::write_refined(&pieces, &baked).unwrap();
    usd::write(&given, &baked).unwrap();
    let open = |path: &std::path::Path| {
        let registry = openusd_schemas::schema_registry();
        let stage = Stage::builder().schema_registry(registry).open(path.to_str().unwrap()).unwrap();
        assert!(stage.composition_errors().is_empty(), "{:?}", stage.composition_errors());
        stage
    };
    let warnings = warnings.iter().map(|w| format!("{}: {}", w.places[0], w.message)).collect();
    (open(&pieces), open(&given), warnings)
}

fn get<T: FromValue>(prim: &Prim, name: &str) -> Option<T>
where
    T::Error: Into<openusd::Error> + std::fmt::Debug,
{
    prim.attribute(name).get::<T>().unwrap()
}

fn vectors(prim: &Prim, name: &str) -> Vec<Vec3> {
    let values: Vec<Vec3f> = get(prim, name).unwrap_or_else(|| panic!("{}: no {name}", prim.path()));
    values.into_iter().map(|v| Vec3::new(v.x, v.y, v.z)).collect()
}

fn triangles(prim: &Prim) -> Vec<[Vec3; 3]> {
    let points = vectors(prim, "points");
    let indices: Vec<i32> = get(prim, "faceVertexIndices").unwrap();
    let counts: Vec<i32> = get(prim, "faceVertexCounts").unwrap();
    assert!(counts.iter().all(|c| *c == 3) && counts.len() * 3 == indices.len());
    indices.chunks(3).map(|t| [0, 1, 2].map(|k| points[t[k] as usize])).collect()
}

fn all_cut(loaded: &Loaded, surface: usize) -> LitMesh {
    cut(&loaded.scene.meshes[loaded.scene.surfaces[surface].mesh])
}

#[test]
fn pieces_stand_where_the_mesh_was_and_the_rest_of_the_stage_is_live() {
    let subset = r#"double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float[] primvars:age = [1, 2, 3, 4] ( interpolation = "uniform" )
    Vec2f[] primvars:old = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "uniform" )
    string primvars:owner = "somebody"
    vector3f[] velocities = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]
    def GeomSubset "back" {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1, 3]
    }"#;
    let usda = stage(&(mesh("Cut", subset) + &mesh("Given", "") + "def Scope \"Other\" { custom int number = 7 }"));
    let light = |loaded: &Loaded, s: usize| match loaded.scene.surfaces[s].name.as_str() {
        "/World/Cut" => all_cut(loaded, s),
        _ => LitMesh::given(vec![[Vec3::new(0.5, 7.0, 0.25); 3]; 4]),
    };
    let (pieces, given, warnings) = layers("live", &usda, light);
    assert_eq!(
        warnings,
        ["/World/Cut (age, old): has primvars over faces that the Mesh in its place doesn't have; they were left out"]
    );

    let prim = pieces.prim("/World/Cut").unwrap();
    let written = triangles(&prim);
    assert_closed(&written, POINTS.map(Vec3::from_array));
    let light = vectors(&prim, "primvars:lumel:irradiance");
    assert_eq!(light.len(), vectors(&prim, "points").len());
    assert_eq!(vectors(&prim, "primvars:displayColor"), light);
    for (place, light) in vectors(&prim, "points").iter().zip(&light) {
        assert!((Vec3::new(1.0, 2.0, 3.0) + place.abs()).distance(*light) < 1e-5);
    }
    // Six pieces a face; the subset has those of its two faces, and texture coordinates are those of the places.
    let back: Vec<i32> = get(&pieces.prim("/World/Cut/back").unwrap(), "indices").unwrap();
    assert_eq!(back, (6..12).chain(18..24).collect::<Vec<i32>>());
    let coords: Vec<Vec2f> = get(&prim, "primvars:st").unwrap();
    let indices: Vec<i32> = get(&prim, "faceVertexIndices").unwrap();
    assert_eq!(coords.len(), light.len());
    for (corner, index) in indices.iter().enumerate() {
        let (face, u) = (corner / 18, 8.0 * coords[*index as usize].x);
        assert!(u > 3.0 * face as f32 - 1e-5 && u < 3.0 * face as f32 + 2.0 + 1e-5, "corner {corner}: {u}");
        assert!((coords[*index as usize].y - 0.25).abs() < 1e-6);
    }
    assert!(!prim.attribute("primvars:old").has_value().unwrap());
    assert!(get::<Vec<f32>>(&prim, "primvars:age").is_none() && get::<Vec<Vec3f>>(&prim, "velocities").is_none());
    assert_eq!(get::<String>(&prim, "primvars:owner").as_deref(), Some("somebody"));
    assert!(prim.attribute("xformOp:translate").has_authored_value().unwrap());
    assert_eq!(get::<i32>(&pieces.prim("/World/Other").unwrap(), "number"), Some(7));

    // A mesh that wasn't cut keeps its faces.
    let other = pieces.prim("/World/Given").unwrap();
    assert_eq!(get::<Vec<i32>>(&other, "faceVertexCounts").unwrap(), [3; 4]);
    assert_eq!(vectors(&other, "primvars:lumel:irradiance"), vec![Vec3::new(0.5, 7.0, 0.25); 4]);

    // The lightmap layer has the given mesh, and the light at its vertices.
    let whole = given.prim("/World/Cut").unwrap();
    assert_eq!(get::<Vec<i32>>(&whole, "faceVertexCounts").unwrap(), [3; 4]);
    for (point, light) in POINTS.iter().zip(vectors(&whole, "primvars:lumel:irradiance")) {
        assert_eq!(Vec3::new(1.0, 2.0, 3.0) + Vec3::from_array(*point).abs(), light);
    }
}

#[test]
fn instances_are_taken_apart_and_differ() {
    let instance =
        |name: &str| format!("def Xform \"{name}\" (\n instanceable = true\n references = </Chair>\n)\n{{ }}\n");
    let usda =
        stage(&(instance("A") + &instance("B"))) + &format!("class Xform \"Chair\" {{\n{}}}\n", mesh("Seat", ""));
    let light = |loaded: &Loaded, s: usize| {
        let mut lit = all_cut(loaded, s);
        let factor = if loaded.scene.surfaces[s].name.starts_with("/World/B") { 2.0 } else { 1.0 };
        lit.triangles.iter_mut().flat_map(|t| &mut t.values).for_each(|v| *v *= factor);
        lit
    };
    let (pieces, given, warnings) = layers("instances", &usda, light);
    assert_eq!(warnings, [""; 0]);
    let [a, b] = ["/World/A", "/World/B"].map(|root| {
        assert!(!pieces.prim(root).unwrap().is_instance().unwrap());
        assert!(given.prim(root).unwrap().is_instance().unwrap());
        let seat = pieces.prim(format!("{root}/Seat").as_str()).unwrap();
        assert_closed(&triangles(&seat), POINTS.map(Vec3::from_array));
        vectors(&seat, "primvars:lumel:irradiance")
    });
    assert!(!a.is_empty() && a.iter().zip(&b).all(|(a, b)| *a * 2.0 == *b));
}

#[test]
fn shapes_become_meshes_and_point_instancers_have_no_light() {
    let instancer = r#"def PointInstancer "Trees" {
    rel prototypes = </World/Trees/Tree>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (9, 0, 0)]
"#;
    let usda = stage(&format!("def Cube \"Box\" {{ }}\n{instancer}{}}}\n", mesh("Tree", "")));
    let (pieces, _, warnings) = layers("shapes", &usda, all_cut);
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].starts_with("/World/Trees: what a point instancer draws"), "{warnings:?}");
    let cube = pieces.prim("/World/Box").unwrap();
    assert_eq!(cube.type_name().unwrap().unwrap().as_str(), "Mesh");
    assert_eq!(triangles(&cube).len(), 6 * 12);
    let area: f32 = triangles(&cube).iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
    assert!((area - 24.0).abs() < 1e-3, "{area}");
    assert!(vectors(&cube, "normals").iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
}

#[test]
fn blend_shapes_do_not_move_points_that_they_were_not_made_for() {
    let shape = r#"uniform token[] skel:blendShapes = ["bulge"]
    rel skel:blendShapeTargets = </World/Face/bulge>
    def BlendShape "bulge" {
        uniform vector3f[] offsets = [(5, 0, 0)]
        uniform int[] pointIndices = [2]
    }"#;
    let (pieces, given, warnings) = layers("blend shapes", &stage(&mesh("Face", shape)), all_cut);
    let expected = "/World/Face: was refined in its pose: the Mesh in its place no longer moves with its skeleton";
    assert_eq!(warnings, [expected]);
    let names = |stage: &Stage| {
        let face = stage.prim("/World/Face").unwrap();
        face.attribute("skel:blendShapes").has_value().unwrap()
    };
    assert!(names(&given) && !names(&pieces));
}
