//! The USD reader against stages whose answer is known, and real scenes where the shared folder is present.

mod files;
mod usd_stage;

use files::{Folder, shared};
use glam::{Vec2, Vec3};
use lumel::error::Error;
use lumel::load::{self};
use lumel::scene::{Scene, SurfaceOrigin};
use usd_stage::{METRES, SQUARE, assert_close, load_body, load_text, warned};

/// World triangles with their first corner smallest, sorted.
fn world_triangles(scene: &Scene) -> Vec<[[i32; 3]; 3]> {
    let mut all: Vec<_> = (0..scene.surfaces.len())
        .flat_map(|s| (0..scene.meshes[scene.surfaces[s].mesh].triangles.len()).map(move |t| (s, t)))
        .map(|(s, t)| {
            let mut corners = scene.world_triangle(s, t).map(|p| (p * 1e4).round().as_ivec3().to_array());
            let smallest = (0..3).min_by_key(|&i| corners[i]).unwrap();
            corners.rotate_left(smallest);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

fn normal(scene: &Scene, surface: usize, triangle: usize) -> Vec3 {
    let [a, b, c] = scene.world_triangle(surface, triangle);
    (b - a).cross(c - a).normalize()
}

#[test]
fn units_and_axis_are_folded_into_the_transform() {
    let y_up = load_body("metres", &format!("def Mesh \"m\" {{ {SQUARE} }}"));
    let z_up = load_text(
        "centimetres",
        r#"#usda 1.0
( metersPerUnit = 0.01
  upAxis = "Z" )
def Xform "x" {
    def Mesh "m" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (100, 0, 0), (100, 0, 100), (0, 0, 100)]
    }
}"#,
    );
    assert_eq!(world_triangles(&y_up.scene), world_triangles(&z_up.scene));
    assert_eq!(z_up.scene.surfaces[0].name, "/x/m");
    assert_eq!(z_up.scene.surfaces[0].origin, SurfaceOrigin::UsdPrim);
    assert_close(normal(&z_up.scene, 0, 0), Vec3::Z);
    // Without metadata: centimetres, Y up.
    let bare = load_text("bare", &format!("#usda 1.0\ndef Mesh \"m\" {{ {SQUARE} }}"));
    assert_eq!(world_triangles(&bare.scene)[0][1], [100, 0, 0]);
}

#[test]
fn transforms_compose() {
    let loaded = load_body(
        "xforms",
        &format!(
            r#"def Xform "a" {{
    double3 xformOp:translate = (10, 0, 0)
    float3 xformOp:rotateXYZ = (0, 90, 0)
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    def Mesh "m" {{ {SQUARE} }}
    def Mesh "reset" {{
        {SQUARE}
        double3 xformOp:translate.timeSamples = {{ 4: (0, 7, 0), 8: (0, 9, 0) }}
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
    }}
    def Mesh "hidden" {{ {SQUARE} token visibility = "invisible" }}
    def Mesh "proxy" {{ {SQUARE} uniform token purpose = "proxy" }}
    def Mesh "inactive" ( active = false ) {{ {SQUARE} }}
    over "undefined" {{ {SQUARE} }}
}}"#
        ),
    );
    let scene = &loaded.scene;
    let names: Vec<&str> = scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["/a/m", "/a/reset"]);
    assert_close(scene.surfaces[0].world_from_local.transform_point3(Vec3::X), Vec3::new(10.0, 0.0, -2.0));
    assert_close(scene.surfaces[1].world_from_local.transform_point3(Vec3::X), Vec3::new(1.0, 7.0, 0.0));
}

#[test]
fn polygons_are_triangulated() {
    let loaded = load_body(
        "ngon",
        r#"def Mesh "m" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [6, 3, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 0, 1, 2, 0, 1, 2, 3]
    int[] holeIndices = [1]
    point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)]
    uniform bool doubleSided = 1
}"#,
    );
    let mesh = &loaded.scene.meshes[0];
    assert_eq!(mesh.triangles.len(), 6, "an L of 6 corners, a hole, a quad");
    let area = |face: u32| -> f32 {
        let triangles = (0..6).filter(|&t| mesh.origin[t].face == face);
        triangles
            .map(|t| {
                let [a, b, c] = loaded.scene.world_triangle(0, t);
                assert!((b - a).cross(c - a).z > 0.0);
                (b - a).cross(c - a).z / 2.0
            })
            .sum()
    };
    assert!((area(0) - 3.0).abs() < 1e-6 && (area(2) - 1.5).abs() < 1e-6);
    for (triangle, origin) in mesh.triangles.iter().zip(&mesh.origin) {
        let offset = if origin.face == 0 { 0 } else { 9 };
        for (&v, corner) in triangle.iter().zip(origin.corners) {
            let point = [0, 1, 2, 3, 4, 5, 0, 1, 2, 0, 1, 2, 3][corner as usize];
            assert!(corner >= offset && mesh.positions[v as usize] == mesh.positions[point as usize]);
        }
    }
    assert!(loaded.scene.material(0, 0).double_sided);
}

#[test]
fn left_handed_faces_are_turned() {
    let text = format!("def Mesh \"m\" {{ {SQUARE} uniform token orientation = \"leftHanded\" }}");
    let loaded = load_body("left", &text);
    assert_close(normal(&loaded.scene, 0, 0), Vec3::NEG_Z);
    assert_eq!(loaded.scene.meshes[0].origin[0].corners, [0, 2, 1]);
}

#[test]
fn indexed_face_varying_uvs() {
    let loaded = load_body(
        "st",
        r#"def Mesh "m" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    normal3f[] normals = [(0, 0, 2), (0, 0, 2), (0, 0, 2), (0, 0, 2)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 0.25), (0.5, 0.5)] ( interpolation = "faceVarying" )
    int[] primvars:st:indices = [0, 1, 2, 3, 2, 0]
    float2[] primvars:st1 = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
    texCoord2f[] primvars:short = [(0, 0)] ( interpolation = "vertex" )
}"#,
    );
    let mesh = &loaded.scene.meshes[0];
    assert_eq!(mesh.positions.len(), 5, "point 0 has two UVs, the others one");
    let st = mesh.uv_set("st").unwrap();
    let uv = |t: usize, k: usize| st[mesh.triangles[t][k] as usize];
    assert_eq!(uv(0, 0), Vec2::new(0.0, 1.0), "v points down");
    assert_eq!(uv(0, 2), Vec2::new(1.0, 0.75));
    assert_eq!(uv(1, 0), Vec2::new(0.5, 0.5));
    assert_eq!(mesh.uv_set("st1").unwrap()[mesh.triangles[1][2] as usize], Vec2::new(0.0, 0.0));
    assert!(mesh.normals.iter().all(|&n| n == Vec3::Z));
    assert!(mesh.uv_set("short").is_none() && warned(&loaded, "fewer values", "/m.primvars:short"));
}

const MATERIALS: &str = r#"
def Scope "looks" {
    def Material "red" {
        token outputs:surface.connect = </looks/red/s.outputs:surface>
        color3f inputs:tint = (0.7, 0.1, 0.2)
        def Shader "s" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </looks/red.inputs:tint>
            token outputs:surface
        }
    }
    def Material "lamp" {
        token outputs:surface.connect = </looks/lamp/s.outputs:surface>
        def Shader "s" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            color3f inputs:emissiveColor = (5, 6, 7)
            float inputs:metallic = 1
            float inputs:opacity = 0.5
            token outputs:surface
        }
    }
}
"#;

#[test]
fn subsets_and_inherited_bindings() {
    let loaded = load_body(
        "subset",
        &format!(
            r#"{MATERIALS}
def Xform "x" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    rel material:binding = </looks/red>
    def Mesh "m" {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        def GeomSubset "part" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </looks/lamp>
        }}
    }}
    def Mesh "strong" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
        {SQUARE}
        rel material:binding = </looks/lamp>
    }}
    def Mesh "gone" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
        {SQUARE}
        color3f[] primvars:displayColor = [(0.1, 0.2, 0.3)]
        rel material:binding = </looks/nothing>
    }}
}}"#
        ),
    );
    let scene = &loaded.scene;
    assert_close(scene.material(0, 0).albedo, Vec3::new(0.7, 0.1, 0.2));
    assert_close(scene.material(0, 1).emission, Vec3::new(5.0, 6.0, 7.0));
    assert_eq!(scene.material(1, 0).name, "/looks/lamp");
    assert_close(scene.material(2, 0).albedo, Vec3::new(0.1, 0.2, 0.3));
    assert!(!warned(&loaded, "opacity", "/looks/lamp") && warned(&loaded, "metal", "/looks/lamp"));
    assert!(warned(&loaded, "was not found", "/looks/nothing"));
}

#[test]
fn collection_bindings_and_strength() {
    let loaded = load_body(
        "collection",
        &format!(
            r#"{MATERIALS}
def Xform "x" ( prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:lit"] ) {{
    rel collection:lit:includes = </x/a>
    rel material:binding:collection:lit = [</x.collection:lit>, </looks/lamp>]
    rel material:binding = </looks/red> ( bindMaterialAs = "strongerThanDescendants" )
    def Mesh "a" {{ {SQUARE} }}
    def Mesh "b" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
        {SQUARE}
        rel material:binding = </looks/lamp>
    }}
}}"#
        ),
    );
    assert_eq!(loaded.scene.material(0, 0).name, "/looks/lamp");
    assert_eq!(loaded.scene.material(1, 0).name, "/looks/red");
}

#[test]
fn display_colors_without_a_material() {
    let loaded = load_body(
        "display",
        &format!(
            r#"def Mesh "varying" {{
    {SQUARE}
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] ( interpolation = "vertex" )
}}
def Xform "x" {{
    color3f[] primvars:displayColor = [(0.3, 0.4, 0.5)]
    def Mesh "inherits" {{ {SQUARE} }}
}}"#
        ),
    );
    let scene = &loaded.scene;
    assert_close(scene.material(0, 0).albedo, Vec3::ONE);
    assert_close(scene.meshes[0].colors[1].truncate(), Vec3::Y);
    assert!(scene.meshes[1].colors.is_empty());
    assert_close(scene.material(1, 0).albedo, Vec3::new(0.3, 0.4, 0.5));
}

#[test]
fn variants_references_payloads_sublayers() {
    let folder = Folder::new("composition");
    folder.write("leaf.usda", format!("#usda 1.0\n( defaultPrim = \"leaf\" )\ndef Mesh \"leaf\" {{ {SQUARE} }}"));
    folder.write("sub.usda", format!("#usda 1.0\ndef Mesh \"under\" {{ {SQUARE} }}"));
    let root = folder.write(
        "scene.usda",
        format!(
            r#"#usda 1.0
( metersPerUnit = 1
  subLayers = [@./sub.usda@, @./lost_layer.usda@] )
def "r" ( references = @./leaf.usda@ ) {{}}
def "p" ( payload = @./leaf.usda@ ) {{}}
def "v" (
    variants = {{ string size = "big" }}
    prepend variantSets = "size"
) {{
    variantSet "size" = {{
        "small" {{ def Mesh "small" {{ {SQUARE} }} }}
        "big" {{ def Mesh "big" {{ {SQUARE} }} }}
    }}
}}
def "lost" ( references = @./lost.usda@ ) {{}}
over "under" {{ double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"] }}"#
        ),
    );
    let loaded = load::load(&root).unwrap();
    let mut names: Vec<&str> = loaded.scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["/p", "/r", "/under", "/v/big"]);
    let under = loaded.scene.surfaces.iter().find(|s| s.name == "/under").unwrap();
    assert_close(under.world_from_local.translation.into(), Vec3::new(0.0, 0.0, 5.0));
    assert!(warned(&loaded, "not found", "lost.usda") && warned(&loaded, "not found", "lost_layer.usda"));
    let mut inputs: Vec<_> = loaded.inputs.iter().map(|p| p.file_name().unwrap().to_str().unwrap()).collect();
    inputs.sort_unstable();
    assert_eq!(inputs, ["leaf.usda", "scene.usda", "sub.usda"]);
}

#[test]
fn native_instances_share_a_mesh() {
    let loaded = load_body(
        "instances",
        &format!(
            r#"class "proto" {{ def Xform "part" {{ def Mesh "m" {{ {SQUARE} }} }} }}
def "a" ( instanceable = true
    inherits = </proto> ) {{}}
def Xform "b" ( instanceable = true
    inherits = </proto> ) {{
    double3 xformOp:translate = (3, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"] }}"#
        ),
    );
    let scene = &loaded.scene;
    assert_eq!((scene.meshes.len(), scene.surfaces.len()), (1, 2));
    let names: Vec<&str> = scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["/a/part/m", "/b/part/m"]);
    assert_eq!(scene.surfaces[1].origin, SurfaceOrigin::UsdInstance { root: "/b".into(), prim: "part/m".into() });
    assert_close(scene.surfaces[1].world_from_local.translation.into(), Vec3::new(3.0, 0.0, 0.0));
}

#[test]
fn point_instancers_place_prototypes() {
    let loaded = load_body(
        "points",
        &format!(
            r#"def PointInstancer "field" {{
    rel prototypes = [</field/protos/leaf>, </field/protos/tree>]
    int[] protoIndices = [0, 1, 0, 1]
    int64[] ids = [10, 11, 12, 13]
    int64[] invisibleIds = [12]
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0), (0.7071, 0, 0.7071, 0)]
    float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1), (2, 2, 2)]
    double3 xformOp:translate = (0, 5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    over "protos" {{
        def Mesh "leaf" {{ {SQUARE} }}
        def Xform "tree" {{
            double3 xformOp:translate = (0, 1, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            def Mesh "crown" {{ {SQUARE} }}
        }}
    }}
}}"#
        ),
    );
    let scene = &loaded.scene;
    let names: Vec<&str> = scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["/field[0]/leaf", "/field[1]/tree/crown", "/field[3]/tree/crown"]);
    assert_eq!(scene.meshes.len(), 2);
    let prim = "/field/protos/tree/crown".to_owned();
    let origin = SurfaceOrigin::UsdPoint { instancer: "/field".into(), index: 3, prim };
    assert_eq!(scene.surfaces[2].origin, origin);
    let corner = scene.surfaces[2].world_from_local.transform_point3(Vec3::X);
    assert!(corner.distance(Vec3::new(3.0, 7.0, -2.0)) < 2e-3, "{corner}");
}

/// A 2 x 1 PNG, red then blue.
fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::RgbImage::from_raw(2, 1, vec![255, 0, 0, 0, 0, 255]).unwrap();
    picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

#[test]
fn textures_are_bound() {
    let folder = Folder::new("texture");
    folder.write("picture.png", png());
    let material = |name: &str, file: &str| {
        format!(
            r#"def Material "{name}" {{
    token inputs:stName = "uvmap"
    token outputs:surface.connect = </{name}/s.outputs:surface>
    def Shader "s" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </{name}/tex.outputs:rgb>
        token outputs:surface
    }}
    def Shader "tex" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "clamp"
        float4 inputs:scale = (0.5, 0.5, 0.5, 1)
        float4 inputs:fallback = (0.2, 0.3, 0.4, 1)
        float2 inputs:st.connect = </{name}/move.outputs:result>
        float3 outputs:rgb
    }}
    def Shader "move" {{
        uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = (2, 3)
        float2 inputs:translation = (0.25, 0.5)
        float2 inputs:in.connect = </{name}/uv.outputs:result>
        float2 outputs:result
    }}
    def Shader "uv" {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname.connect = </{name}.inputs:stName>
        float2 outputs:result
    }}
}}"#
        )
    };
    let root = folder.write(
        "scene.usda",
        format!(
            r#"{METRES}{}{}
def Mesh "m" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    {SQUARE}
    texCoord2f[] primvars:uvmap = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
    rel material:binding = </good>
}}
def Mesh "n" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{ {SQUARE}
    rel material:binding = </lost> }}"#,
            material("good", "./picture.png"),
            material("lost", "./lost.png")
        ),
    );
    let loaded = load::load(&root).unwrap();
    let slot = loaded.scene.material(0, 0).albedo_texture.as_ref().unwrap();
    assert_eq!(slot.uv_set, "uvmap");
    assert_eq!(slot.wrap, [lumel::scene::Wrap::Repeat, lumel::scene::Wrap::Clamp]);
    assert_eq!(slot.scale.x, 0.5);
    // USD's (0.5, 0.5) becomes (1.25, 2.0) with v up: (1.25, -1.0) with v down.
    let image_uv = slot.image_from_uv.transform_point2(Vec2::new(0.5, 1.0 - 0.5));
    assert!(image_uv.distance(Vec2::new(1.25, -1.0)) < 1e-5, "{image_uv}");
    let texture = &loaded.scene.textures[slot.texture];
    assert_close(texture.texel(1, 0).truncate(), Vec3::Z);
    assert_close(loaded.scene.material(1, 0).albedo, Vec3::new(0.2, 0.3, 0.4));
    assert!(warned(&loaded, "texture file was not found", "lost.png"));
    assert!(loaded.inputs.iter().any(|p| p.ends_with("picture.png")));
}

#[test]
fn unsupported_prims_are_named() {
    let loaded = load_body(
        "unsupported",
        &format!(
            r#"def BasisCurves "hair" {{}}
def Points "dust" {{}}
def MagicThing "magic" {{}}
def Mesh "smooth" {{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)]
}}
def Mesh "broken" {{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3, -4]
    int[] faceVertexIndices = [0, 1, 2, 0, 1, 99]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}}
def Mesh "m" {{ {SQUARE} }}"#
        ),
    );
    for place in ["/hair", "/dust", "/magic", "/smooth", "/broken"] {
        assert!(warned(&loaded, "", place), "{place} is not named in {:?}", loaded.warnings);
    }
    assert!(loaded.scene.meshes[0].normals.is_empty());
    assert_eq!(loaded.scene.meshes[1].triangles.len(), 1);
}

#[test]
fn broken_files_are_errors() {
    let folder = Folder::new("broken");
    let cases: [(&str, &[u8]); 7] = [
        ("empty.usda", b""),
        ("noise.usda", b"\xff\xfe\x00garbage"),
        ("cut.usda", b"#usda 1.0\ndef Mesh \"m\" {"),
        ("cut.usdc", b"PXR-USDC\x00\x08\x00\x00\x00\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\x7f"),
        ("noise.usdz", b"PK\x03\x04 and nothing else"),
        ("noise.usd", b"neither text nor binary"),
        ("nothing.usda", b"#usda 1.0\ndef Xform \"x\" {}"),
    ];
    for (name, bytes) in cases {
        let path = folder.write(name, bytes);
        match load::load(&path) {
            Err(Error::Invalid { place, .. }) => assert!(place.contains(name), "{place}"),
            other => panic!("{name}: {other:?}"),
        }
    }
    assert!(
        matches!(load::load(&folder.0.join("absent.usda")), Err(Error::Io { place, .. }) if place.contains("absent"))
    );
}

#[test]
fn deep_nesting_and_cycles_end() {
    let folder = Folder::new("deep");
    let depth = 3000;
    let text = format!("{METRES}{}{}", "def \"x\" {".repeat(depth), "}".repeat(depth));
    let _ = load::load(&folder.write("deep.usda", text));
    folder.write("self.usda", "#usda 1.0\ndef \"a\" ( references = @./self.usda@</a> ) {}");
    let _ = load::load(&folder.0.join("self.usda"));
    let instancer = r#"def PointInstancer "p" {
    rel prototypes = </p>
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 0)]
}"#;
    let loaded = load_body("self_instancer", &format!("{instancer}\ndef Mesh \"m\" {{ {SQUARE} }}"));
    assert!(warned(&loaded, "its own prototype", "/p"));
}

#[test]
fn real_scenes_load() {
    let Some(shared) = shared() else { return };
    let scenes = [
        ("scenes/usdwg_standard_shader_ball/StandardShaderBall/standard_shader_ball_scene.usda", 15_000),
        ("scenes/usdwg_teapot/Teapot/Teapot.usd", 2_000),
        ("scenes/pablode_shoe_variants/materials-variants-shoe/MaterialsVariantsShoe.usdc", 5_000),
        ("scenes/arnold_point_instancer/test_0135/data/test.usda", 1),
        ("scenes/arnold_point_instancer/test_0185/data/scene.usd", 1),
        ("reference/atrium/scene.usdc", 200_000),
    ];
    for (scene, triangles) in scenes {
        let start = std::time::Instant::now();
        let loaded = load::load(&shared.join(scene)).unwrap();
        let count = loaded.scene.triangle_count();
        println!("{scene}: {count} triangles in {:.2?}, {} surfaces", start.elapsed(), loaded.scene.surfaces.len());
        for warning in loaded.warnings.iter() {
            println!("    {} x {}: {:?}", warning.count, warning.message, &warning.places);
        }
        assert!(count >= triangles, "{scene}: {count}");
    }
}

/// Every stage of the shared folder loads or fails with an error: no panic, no hang.
#[test]
fn no_scene_panics() {
    let Some(shared) = shared() else { return };
    let mut folders = vec![shared.join("scenes")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            match path.extension().and_then(|e| e.to_str()) {
                _ if path.is_dir() => folders.push(path),
                Some("usd" | "usda" | "usdc" | "usdz") => files.push(path),
                _ => {}
            }
        }
    }
    files.sort();
    for file in &files {
        let start = std::time::Instant::now();
        let result = load::load(file);
        if let Err(Error::Invalid { place, message }) = &result {
            println!("{place}: {message}");
            assert!(!message.contains("reader failed"), "a panic inside the reader: {place}");
        }
        let seconds = start.elapsed().as_secs_f32();
        assert!(seconds < 30.0, "{} took {seconds} s", file.display());
    }
    println!("{} files", files.len());
}
