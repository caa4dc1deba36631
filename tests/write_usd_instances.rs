//! The USD layer over instances, stand-ins, and whole scenes as they were loaded.

mod files;
mod usd_layer;

use files::shared;
use glam::{Vec2, Vec3};
use lumel::load::{self, LoadOptions};
use lumel::meshing::{LitMesh, VertexLight};
use lumel::post::Quantity;
use lumel::scene::{SurfaceOrigin, TriangleOrigin};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use lumel::write::{Baked, BakedLights, usd};
use openusd::gf::{Vec3f, Vec4f};
use openusd::sdf::AssetPath;
use openusd::usd::Stage;
use std::fs;
use std::path::{Path, PathBuf};
use usd_layer::*;

/// Three chairs that are instances of one prototype, each with a seat and a back.
fn chairs() -> String {
    let chair =
        |name: &str| format!("def Xform \"{name}\" (\n instanceable = true\n references = </Chair>\n)\n{{ }}\n");
    let room = room(&["One", "Two", "Three"].map(chair).concat());
    let parts = format!("def Mesh \"Seat\"\n{{{MESH}}}\ndef Scope \"Geom\"\n{{\ndef Mesh \"Back\"\n{{{MESH}}}\n}}");
    format!("{room}\nclass Xform \"Chair\"\n{{\n{parts}\n}}\n")
}

#[test]
fn instances_stay_instances_of_one_prototype() {
    let mut bake = Bake::new("instances", &chairs());
    let (seat, back) = (bake.mesh(&COUNTS, &[]), bake.mesh(&COUNTS, &[2]));
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/One", "Geom/Back", back, 1, [0.0, 0.5]);
    bake.instance("/World/Two", "Seat", seat, 0, [0.5, 0.25]);
    bake.instance("/World/Two", "Geom/Back", back, 0, [0.25, 0.25]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let names = ["One", "Two", "Three"].map(|n| stage.prim(format!("/World/{n}")).unwrap());
    assert!(names.iter().all(|p| p.is_instance().unwrap()));
    let prototypes = names.clone().map(|p| p.prototype().unwrap().unwrap());
    assert!(prototypes.iter().all(|p| *p == prototypes[0]), "{prototypes:?}");

    for instance in ["One", "Two", "Three"] {
        let seat = stage.prim(format!("/World/{instance}/Seat")).unwrap();
        let back = stage.prim(format!("/World/{instance}/Geom/Back")).unwrap();
        assert_eq!(flat(&seat, "primvars:st1")[9], [9.0 / 8.0, 0.75]);
        assert_eq!(flat(&back, "primvars:st1")[9], [0.0, 0.0]);
        assert_eq!(get::<Vec<Vec3f>>(&seat, "primvars:displayColor"), None);
    }
    let [one, two, three] = names;
    assert_eq!(rectangle(&one, "primvars:lumel:scaleOffset:Seat"), Some([0.5, 0.25, 0.0, 0.75]));
    assert_eq!(rectangle(&two, "primvars:lumel:scaleOffset:Seat"), Some([0.5, 0.25, 0.5, 0.5]));
    assert_eq!(rectangle(&two, "primvars:lumel:scaleOffset:Geom:Back"), Some([0.5, 0.25, 0.25, 0.5]));
    assert_eq!(rectangle(&three, "primvars:lumel:scaleOffset:Seat"), None);
    let page = |name: &str| get::<AssetPath>(&one, name).unwrap().as_str().to_string();
    assert_eq!(page("lumel:lightmap:Seat"), "./lightmaps/room_0.exr");
    assert_eq!(page("lumel:lightmap:Geom:Back"), "./lightmaps/room_1.exr");
}

#[test]
fn instances_of_one_gprim_have_a_plain_rectangle() {
    let mut bake = Bake::new("instances_plain", &chairs());
    let seat = bake.mesh(&COUNTS, &[]);
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/Three", "Seat", seat, 1, [0.0, 0.5]);
    let (stage, _) = bake.write();
    let three = stage.prim("/World/Three").unwrap();
    assert_eq!(rectangle(&three, "primvars:lumel:scaleOffset"), Some([0.5, 0.25, 0.0, 0.25]));
    assert_eq!(get::<AssetPath>(&three, "lumel:lightmap").unwrap().as_str(), "./lightmaps/room_1.exr");
    assert_eq!(token(&three, "lumel:quantity").unwrap(), "outgoing");
}

#[test]
fn instances_of_different_uvs_get_classes_of_their_own() {
    let mut bake = Bake::new("instances_differ", &chairs());
    let (seat, other) = (bake.mesh(&COUNTS, &[]), bake.mesh(&COUNTS, &[2]));
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/Two", "Seat", other, 0, [0.0, 0.5]);
    let (stage, _) = bake.write();
    let last = |name: &str| flat(&stage.prim(format!("/World/{name}/Seat")).unwrap(), "primvars:st1")[9];
    assert_eq!((last("One"), last("Two"), last("Three")), ([1.125, 0.75], [0.0, 0.0], [1.125, 0.75]));
    assert!(stage.prim("/World/Two").unwrap().is_instance().unwrap());
}

/// Two sets that are instances of one prototype, which holds two instances of another.
fn sets() -> String {
    format!(
        "{}\nclass Xform \"Set\"\n{{\n{}\n}}\nclass Xform \"Leg\"\n{{\ndef Mesh \"Bar\"\n{{{MESH}}}\n}}\n",
        room(&["A", "B"].map(|n| instance_of(n, "Set")).concat()),
        ["Left", "Right"].map(|n| instance_of(n, "Leg")).concat(),
    )
}

#[test]
fn nested_instances_hold_uvs() {
    let mut bake = Bake::new("instances_nested", &sets());
    let bar = bake.mesh(&COUNTS, &[]);
    let mut x = 0.0;
    for root in ["/World/A", "/World/B"] {
        for leg in ["Left", "Right"] {
            bake.instance(root, &format!("{leg}/Bar"), bar, 0, [x, 0.0]);
            x += 0.125;
        }
    }
    let (stage, _) = bake.write();
    for (root, x) in [("/World/A", 0.0), ("/World/B", 0.25)] {
        let instance = stage.prim(root).unwrap();
        assert!(instance.is_instance().unwrap());
        assert_eq!(rectangle(&instance, "primvars:lumel:scaleOffset:Right:Bar"), Some([0.5, 0.25, x + 0.125, 0.75]));
        for leg in ["Left", "Right"] {
            assert!(stage.prim(format!("{root}/{leg}")).unwrap().is_instance().unwrap());
            let bar = stage.prim(format!("{root}/{leg}/Bar")).unwrap();
            assert_eq!(flat(&bar, "primvars:st1")[3], [0.375, 0.75]);
        }
    }
}

/// An instancer of four points, the second of them hidden, and two prototypes of which one has two gprims.
fn trees() -> String {
    let tree = format!("def Mesh \"Trunk\"\n{{{MESH}}}\ndef Mesh \"Crown\"\n{{{MESH}}}\n");
    room(&format!(
        "def PointInstancer \"Trees\"
        {{
            rel prototypes = [</World/Trees/Kinds/Tree>, </World/Trees/Kinds/Bush>]
            int[] protoIndices = [0, 1, 1, 1]
            point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
            int64[] invisibleIds = [1]
            def Scope \"Kinds\"
            {{
                def Xform \"Tree\"\n{{\n{tree}}}
                def Mesh \"Bush\"\n{{{MESH}}}
            }}
        }}"
    ))
}

#[test]
fn point_instancers_have_a_rectangle_for_each_point() {
    let kinds = "/World/Trees/Kinds";
    let mut bake = Bake::new("points", &trees());
    let bush = bake.mesh(&COUNTS, &[]);
    bake.point("/World/Trees", 2, &format!("{kinds}/Bush"), bush, 0, [0.0, 0.0]);
    bake.point("/World/Trees", 3, &format!("{kinds}/Bush"), bush, 1, [0.5, 0.0]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let instancer = stage.prim("/World/Trees").unwrap();
    let none = Vec4f { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
    let rectangles: Vec<Vec4f> = get(&instancer, "primvars:lumel:scaleOffset").unwrap();
    let at = |x: f32| Vec4f { x: 0.5, y: 0.25, z: x, w: 0.75 };
    assert_eq!(rectangles, [none, none, at(0.0), at(0.5)]);
    assert_eq!(interpolation(&instancer, "primvars:lumel:scaleOffset"), "vertex");
    assert_eq!(get::<Vec<i32>>(&instancer, "primvars:lumel:page").unwrap(), [-1, -1, 0, 1]);
    assert_eq!(get::<Vec<AssetPath>>(&instancer, "lumel:lightmaps").unwrap().len(), 2);
    let bush = stage.prim(format!("{kinds}/Bush")).unwrap();
    assert_eq!(flat(&bush, "primvars:st1")[2], [0.25, 0.75]);
    assert_eq!(rectangle(&bush, "primvars:lumel:scaleOffset"), None);
}

#[test]
fn prototypes_of_several_gprims_name_their_rectangles() {
    let kinds = "/World/Trees/Kinds";
    let mut bake = Bake::new("points_many", &trees());
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.point("/World/Trees", 0, &format!("{kinds}/Tree/Trunk"), mesh, 0, [0.0, 0.0]);
    bake.point("/World/Trees", 0, &format!("{kinds}/Tree/Crown"), mesh, 1, [0.25, 0.0]);
    let (stage, _) = bake.write();
    let instancer = stage.prim("/World/Trees").unwrap();
    let crown = "World:Trees:Kinds:Tree:Crown";
    let pages: Vec<i32> = get(&instancer, &format!("primvars:lumel:page:{crown}")).unwrap();
    assert_eq!(pages, [1, -1, -1, -1]);
    let rectangles: Vec<Vec4f> = get(&instancer, &format!("primvars:lumel:scaleOffset:{crown}")).unwrap();
    assert_eq!(rectangles[0].z, 0.25);
}

/// UVs that tell the face-varying corners of a mesh apart, v down.
fn uv_of_corner(corner: u32) -> Vec2 {
    Vec2::new((corner % 1021) as f32 / 1024.0, (corner / 1021 % 1021) as f32 / 1024.0)
}

/// Writes a layer for a scene as loaded, with made-up UVs, opens it, and compares each mesh that takes opinions of its own.
fn layer_over(input: &Path, folder: &Path, options: &LoadOptions) {
    // Many files of the collection are layers without geometry, or broken on purpose.
    let Ok(loaded) = load::load_with(input, options) else { return };
    let scene = &loaded.scene;
    let meshes = scene.meshes.iter().map(|m| MeshUvs {
        corners: m.origin.iter().map(|o| o.corners.map(uv_of_corner)).collect(),
        chart: vec![0; m.triangles.len()],
        chart_count: 1,
        authored: None,
    });
    let place = |i: usize| Placement { page: 0, scale: Vec2::splat(0.5), offset: Vec2::new(i as f32, 0.0) };
    let atlas = Atlas {
        pages: vec![[64, 64]],
        meshes: meshes.collect(),
        placements: (0..scene.surfaces.len()).map(place).collect(),
        density: 1.0,
        padding: 2,
        shown_pages: 1,
    };
    let color = |o: &TriangleOrigin| o.corners.map(|c| Vec3::splat((c % 7) as f32));
    let colors = scene.surfaces.iter().map(|s| scene.meshes[s.mesh].origin.iter().map(color));
    let baked = Baked {
        scene,
        source: &loaded.source,
        atlas: &atlas,
        lightmap: None,
        quantity: Quantity::Outgoing,
        vertices: Some(&VertexLight { surfaces: colors.map(LitMesh::given).collect() }),
        page_uris: &["lightmaps/scene_0.exr".to_string()],
        encoded: &[],
        vertex_colors: Default::default(),
        lightmap_extension: None,
        folder,
        lights: BakedLights::Mark,
    };
    fs::create_dir_all(folder.join("lightmaps")).unwrap();
    fs::write(folder.join("lightmaps/scene_0.exr"), "").unwrap();
    let output = folder.join("scene.lumel.usda");
    let start = std::time::Instant::now();
    let warnings = usd::write(&output, &baked).unwrap();
    let size = fs::metadata(&output).unwrap().len();
    println!(
        "{}: {} triangles, {} KB in {:.2?}",
        input.display(),
        scene.triangle_count(),
        size / 1024,
        start.elapsed()
    );
    for warning in warnings.iter() {
        println!("    {} x {} {:?}", warning.count, warning.message, warning.places);
    }

    let registry = openusd_schemas::schema_registry();
    let stage = Stage::builder().schema_registry(registry).open(output.to_str().unwrap()).unwrap();
    for (i, surface) in scene.surfaces.iter().enumerate() {
        let path = match &surface.origin {
            SurfaceOrigin::UsdPrim => surface.name.clone(),
            SurfaceOrigin::UsdInstance { root, prim } => format!("{root}/{prim}"),
            SurfaceOrigin::UsdPoint { prim, .. } => prim.clone(),
            _ => continue,
        };
        let prim = stage.prim(path.as_str()).unwrap();
        let name = token(&prim, "lumel:uvName").unwrap_or_else(|| panic!("{path}: no UVs"));
        let uvs = flat(&prim, &format!("primvars:{name}"));
        for corner in scene.meshes[surface.mesh].origin.iter().flat_map(|o| o.corners) {
            let uv = uv_of_corner(corner);
            assert_eq!(uvs[corner as usize], [uv.x, 1.0 - uv.y], "{path}");
        }
        if surface.origin == SurfaceOrigin::UsdPrim {
            assert_eq!(rectangle(&prim, "primvars:lumel:scaleOffset"), Some([0.5, 0.5, i as f32, 0.5]), "{path}");
        }
    }
}

#[test]
fn loaded_instances_take_a_layer() {
    for (name, usda) in [("chairs", chairs()), ("sets", sets()), ("trees", trees())] {
        let bake = Bake::new(&format!("loaded_{name}"), &usda);
        layer_over(&bake.input(), &bake.folder.join("room_baked"), &LoadOptions::default());
        let text = fs::read_to_string(bake.folder.join("room_baked/scene.lumel.usda")).unwrap();
        assert!(text.contains("primvars:lumel:scaleOffset:"), "{text}");
    }
}

#[test]
fn meshes_stand_in_for_shapes_and_refined_surfaces() {
    let usda = room(
        r#"def Sphere "Ball" { double radius = 2 color3f[] primvars:displayColor = [(1, 0, 0)] }
def Xform "Holder" (
    prepend variantSets = "form"
    variants = { string form = "none" }
)
{
    variantSet "form" = {
        "none" { }
        "cage" {
            def Mesh "Soft" {
                int[] faceVertexCounts = [4, 4]
                int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
                point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 1), (2, 1, 1)]
                float[] primvars:age = [1, 2] ( interpolation = "uniform" )
                def GeomSubset "second" {
                    uniform token elementType = "face"
                    uniform token familyName = "materialBind"
                    int[] indices = [1]
                }
            }
        }
    }
}"#,
    );
    let bake = Bake::new("stand_in", &usda);
    let variants = vec!["/World/Holder:form=cage".to_owned()];
    let options = LoadOptions { subdivide: 1, variants, ..LoadOptions::default() };
    let folder = bake.folder.join("room_baked");
    layer_over(&bake.input(), &folder, &options);
    let registry = openusd_schemas::schema_registry();
    let path = folder.join("scene.lumel.usda");
    let stage = Stage::builder().schema_registry(registry).open(path.to_str().unwrap()).unwrap();
    for (path, triangles) in [("/World/Ball", 2 * 48 * 23), ("/World/Holder/Soft", 16)] {
        let prim = stage.prim(path).unwrap();
        assert_eq!(prim.type_name().unwrap().unwrap().as_str(), "Mesh", "{path}");
        let counts: Vec<i32> = get(&prim, "faceVertexCounts").unwrap();
        assert_eq!(counts, vec![3; triangles], "{path}");
        let points: Vec<Vec3f> = get(&prim, "points").unwrap();
        let indices: Vec<i32> = get(&prim, "faceVertexIndices").unwrap();
        assert!(indices.iter().all(|&i| (i as usize) < points.len()));
    }
    let soft = stage.prim("/World/Holder/Soft").unwrap();
    assert!(get::<Vec<f32>>(&soft, "primvars:age").is_none(), "two values for sixteen faces");
    let second: Vec<i32> = get(&stage.prim("/World/Holder/Soft/second").unwrap(), "indices").unwrap();
    assert_eq!(second, (8..16).collect::<Vec<i32>>());
    let ball: Vec<Vec3f> = get(&stage.prim("/World/Ball").unwrap(), "primvars:displayColor").unwrap();
    assert_eq!(ball.len(), 1, "a colour that the look depends on stays");
}

#[test]
fn whole_scenes_take_a_layer() {
    let Some(shared) = shared() else { return };
    let mut files = Vec::new();
    find_stages(&shared.join("scenes"), &mut files);
    find_stages(&shared.join("reference"), &mut files);
    files.sort();
    assert!(!files.is_empty());
    for (i, file) in files.iter().enumerate() {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("write_usd_scenes").join(i.to_string());
        layer_over(file, &folder, &LoadOptions::default());
    }
}

/// Appends every USD file below `folder`.
fn find_stages(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            find_stages(&path, files);
        } else if path.extension().is_some_and(|e| ["usd", "usda", "usdc", "usdz"].map(Some).contains(&e.to_str())) {
            files.push(path);
        }
    }
}
