//! The USD reader's shapes, refined surfaces, times, variants, purposes and materials against stages whose answer is known.

mod files;

use files::{Folder, shared};
use glam::Vec3;
use lumel::error::Error;
use lumel::load::{self, LoadOptions, Loaded, Purpose, Source};
use lumel::scene::{Alpha, Material, Scene};
use std::f64::consts::PI;
use std::path::PathBuf;

impl Folder {
    /// Writes a stage in metres, Y up.
    fn stage(&self, body: &str) -> PathBuf {
        let path = self.0.join("scene.usda");
        std::fs::write(&path, format!("#usda 1.0\n(\n metersPerUnit = 1\n upAxis = \"Y\"\n)\n{body}")).unwrap();
        path
    }
}

fn load_body(name: &str, body: &str, options: &LoadOptions) -> Loaded {
    let folder = Folder::new(name);
    load::load_with(&folder.stage(body), options).unwrap()
}

const SQUARE: &str = r#"
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
"#;

const CUBE: &str = r#"
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6]
    point3f[] points = [(-1, -1, -1), (1, -1, -1), (-1, 1, -1), (1, 1, -1), (-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1)]
"#;

fn warned(loaded: &Loaded, message: &str) -> bool {
    loaded.warnings.iter().any(|w| w.message.contains(message))
}

fn surface(scene: &Scene, name: &str) -> usize {
    scene.surfaces.iter().position(|s| s.name == name).unwrap_or_else(|| panic!("no surface {name}"))
}

fn area(scene: &Scene, surface: usize) -> f64 {
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let of = |[a, b, c]: [Vec3; 3]| f64::from((b - a).cross(c - a).length()) / 2.0;
    (0..mesh.triangles.len()).map(|t| of(scene.world_triangle(surface, t))).sum()
}

fn material<'a>(loaded: &'a Loaded, name: &str) -> &'a Material {
    let scene = &loaded.scene;
    scene.material(surface(scene, name), 0)
}

#[test]
fn shapes_have_their_area_place_and_normals() {
    let body = r#"
def Cube "cube" { double size = 3 }
def Sphere "sphere" { double radius = 2 }
def Cylinder "cylinder" { double radius = 0.5 double height = 4 uniform token axis = "Y" }
def Cylinder_1 "frustum" { double radiusTop = 0 double radiusBottom = 1 double height = 2 }
def Cone "cone" { double radius = 3 double height = 4 uniform token axis = "X" }
def Capsule "capsule" { double radius = 0.5 double height = 3 }
def Capsule_1 "drop" { double radiusTop = 0.25 double radiusBottom = 0.25 double height = 1 }
def Plane "plane" { double width = 2 double length = 5 uniform token axis = "Y" }
def Sphere "inside" { double radius = 1 uniform token orientation = "leftHanded" }
def Sphere "nothing" { double radius = -1 }
"#;
    let loaded = load_body("shapes", body, &LoadOptions::default());
    let scene = &loaded.scene;
    for (name, expected) in [
        ("/cube", 54.0),
        ("/sphere", 16.0 * PI),
        ("/cylinder", 4.5 * PI),
        ("/frustum", PI * (1.0 + 5f64.sqrt())),
        ("/cone", 24.0 * PI),
        ("/capsule", 4.0 * PI),
        ("/drop", 0.75 * PI),
        ("/plane", 10.0),
    ] {
        let found = area(scene, surface(scene, name));
        assert!((found / expected - 1.0).abs() < 0.005, "{name}: {found} is not {expected}");
    }
    assert!(!scene.surfaces.iter().any(|s| s.name == "/nothing") && warned(&loaded, "not positive"));
    let (low, high) = bounds(scene, surface(scene, "/cone"));
    assert!(low.distance(Vec3::new(-2.0, -3.0, -3.0)) < 1e-5 && high.distance(Vec3::new(2.0, 3.0, 3.0)) < 1e-5);
    let (low, high) = bounds(scene, surface(scene, "/plane"));
    assert!((high - low).distance(Vec3::new(2.0, 0.0, 5.0)) < 1e-5);
    // Outwards, as the triangles are, but for the one that is turned inside out.
    for (i, s) in scene.surfaces.iter().enumerate() {
        let mesh = &scene.meshes[s.mesh];
        let outwards = if s.name == "/inside" { -1.0 } else { 1.0 };
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = scene.world_triangle(i, t);
            let flat = (b - a).cross(c - a).normalize();
            assert!(corners.iter().all(|&v| mesh.normals[v as usize].dot(flat) > 0.9), "{}: a normal is off", s.name);
            assert!(s.name == "/plane" || flat.dot(a + b + c) * outwards > 0.0, "{} is turned over", s.name);
        }
        let st = mesh.uv_set("st").unwrap();
        assert!(st.iter().all(|uv| (-1e-6..=1.0 + 1e-6).contains(&uv.x) && (-1e-6..=1.0 + 1e-6).contains(&uv.y)));
    }
    let plane = surface(scene, "/plane");
    assert_eq!(scene.meshes[scene.surfaces[plane].mesh].normals[0], Vec3::Y);
    assert!(scene.material(plane, 0).double_sided, "the schema says that planes are");
    let Source::Usd(source) = &loaded.source else { panic!("not USD") };
    assert_eq!(source.remade.len(), scene.meshes.len());
}

fn bounds(scene: &Scene, surface: usize) -> (Vec3, Vec3) {
    let count = scene.meshes[scene.surfaces[surface].mesh].triangles.len();
    let points = (0..count).flat_map(|t| scene.world_triangle(surface, t));
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

#[test]
fn subdivision_surfaces_are_refined_on_demand() {
    let body = format!(
        r#"def Mesh "cube" {{
    {CUBE}
    int[] holeIndices = [0]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "faceVarying" )
    int[] primvars:st:indices = [0,1,2,3, 0,1,2,3, 0,1,2,3, 0,1,2,3, 0,1,2,3, 0,1,2,3]
    color3f[] primvars:displayColor = [(1,0,0), (0,1,0), (0,0,1), (1,1,0), (0,1,1), (1,1,1)] ( interpolation = "uniform" )
}}
def Mesh "flat" {{ {CUBE} uniform token subdivisionScheme = "none" }}
def Mesh "loop" {{ {CUBE} uniform token subdivisionScheme = "loop" }}"#
    );
    let cage = load_body("cage", &body, &LoadOptions::default());
    assert!(warned(&cage, "taken as its control cage"));
    assert!((area(&cage.scene, surface(&cage.scene, "/cube")) - 20.0).abs() < 1e-5);
    let loaded = load_body("refined", &body, &LoadOptions { subdivide: 3, ..LoadOptions::default() });
    let scene = &loaded.scene;
    let mesh = &scene.meshes[scene.surfaces[surface(scene, "/cube")].mesh];
    assert_eq!(mesh.triangles.len(), 5 * 64 * 2, "a hole is no face");
    let farthest = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
    assert!((farthest - 68.0 / 81.0).abs() < 1e-5, "the middle of a face lies on the limit surface: {farthest}");
    // Each refined face has the colour and the square of its own.
    for (corners, origin) in mesh.triangles.iter().zip(&mesh.origin) {
        let colors = corners.map(|v| mesh.colors[v as usize].truncate());
        let own = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1., 1., 0.), Vec3::new(0., 1., 1.), Vec3::ONE];
        assert_eq!(colors, [own[origin.part as usize]; 3]);
        let outwards = corners.map(|v| mesh.normals[v as usize].dot(mesh.positions[v as usize].normalize()));
        assert!(outwards.iter().all(|&cos| cos > 0.9));
    }
    let flat = &scene.meshes[scene.surfaces[surface(scene, "/flat")].mesh];
    assert_eq!(flat.triangles.len(), 12);
    assert_eq!(scene.meshes[scene.surfaces[surface(scene, "/loop")].mesh].triangles.len(), 12);
    assert!(warned(&loaded, "Loop's with faces that are no triangles"));
    let Source::Usd(source) = &loaded.source else { panic!("not USD") };
    assert_eq!(source.remade.len(), 1);
}

#[test]
fn what_moves_is_read_at_the_time_code() {
    let body = format!(
        r#"def Xform "x" {{
    double3 xformOp:translate.timeSamples = {{ 0: (0, 0, 0), 10: (20, 0, 0) }}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "m" {{ {SQUARE} color3f[] primvars:displayColor.timeSamples = {{ 0: [(0, 0, 0)], 10: [(1, 0.5, 0)] }} }}
    def Mesh "late" {{ {SQUARE} token visibility.timeSamples = {{ 0: "invisible", 6: "inherited" }} }}
    def Sphere "ball" {{ double radius = 7 double radius.timeSamples = {{ 0: 1, 10: 2 }} }}
}}
def SphereLight "light" {{ float inputs:intensity.timeSamples = {{ 0: 0, 10: 10 }} float inputs:radius = 1 }}"#
    );
    let at = |time: f64| load_body("time", &body, &LoadOptions { time: Some(time), ..LoadOptions::default() });
    let loaded = at(5.0);
    let scene = &loaded.scene;
    assert_eq!(scene.surfaces[surface(scene, "/x/m")].world_from_local.translation.x, 10.0);
    assert_eq!(material(&loaded, "/x/m").albedo, Vec3::new(0.5, 0.25, 0.0));
    assert!(scene.surfaces.iter().all(|s| s.name != "/x/late"), "a token is held, not interpolated");
    let radius = area(scene, surface(scene, "/x/ball")) / (4.0 * PI);
    assert!((radius.sqrt() - 1.5).abs() < 0.005, "samples are stronger than the default beside them");
    let lumel::scene::LightShape::Sphere { radiance, .. } = scene.lights[0].shape else { panic!("no sphere") };
    assert_eq!(radiance, Vec3::splat(5.0));
    assert_eq!(at(99.0).scene.surfaces.len(), 3);
    // The default time: the default, else the earliest sample.
    let still = load_body("still", &body, &LoadOptions::default());
    assert_eq!(still.scene.surfaces[0].world_from_local.translation.x, 0.0);
    assert!((area(&still.scene, surface(&still.scene, "/x/ball")) / (4.0 * PI * 49.0) - 1.0).abs() < 0.005);
}

#[test]
fn variants_are_chosen_by_name() {
    let body = format!(
        r#"def Xform "car" ( variants = {{ string paint = "red" }} prepend variantSets = "paint" ) {{
    def Mesh "m" {{ {SQUARE} }}
    variantSet "paint" = {{
        "red" {{ over "m" {{ color3f[] primvars:displayColor = [(1, 0, 0)] }} }}
        "deep_blue" {{
            over "m" {{ color3f[] primvars:displayColor = [(0, 0, 1)] }}
            def Mesh "stripe" {{ {SQUARE} }}
        }}
    }}
}}"#
    );
    let folder = Folder::new("variants");
    let path = folder.stage(&body);
    let before = std::fs::read(&path).unwrap();
    let with = |variant: &str| {
        load::load_with(&path, &LoadOptions { variants: vec![variant.to_owned()], ..LoadOptions::default() })
    };
    let loaded = with("/car:paint=deep_blue").unwrap();
    assert_eq!(material(&loaded, "/car/m").albedo, Vec3::Z);
    assert!(loaded.scene.surfaces.iter().any(|s| s.name == "/car/stripe"));
    assert_eq!(material(&load::load(&path).unwrap(), "/car/m").albedo, Vec3::X);
    assert_eq!(std::fs::read(&path).unwrap(), before, "the file is left alone");
    for (variant, needed) in [
        ("/car:paint=green", "deep_blue, red"),
        ("/car:wheels=big", "it has paint"),
        ("/bus:paint=red", "/car (paint)"),
        ("/car/m:paint=red", "/car (paint)"),
        ("paint=red", "/PRIM:SET=NAME"),
    ] {
        match with(variant) {
            Err(Error::Invalid { message, .. }) => assert!(message.contains(needed), "{variant}: {message}"),
            other => panic!("{variant}: {:?}", other.map(|_| ())),
        }
    }
}

#[test]
fn purposes_are_drawn_as_asked() {
    let body = format!(
        r#"def Mesh "plain" {{ {SQUARE} }}
def Scope "s" {{ uniform token purpose = "proxy" def Mesh "m" {{ {SQUARE} }} def Mesh "own" {{ {SQUARE} uniform token purpose = "render" }} }}
def Mesh "guide" {{ {SQUARE} uniform token purpose = "guide" }}
def Mesh "odd" {{ {SQUARE} uniform token purpose = "other" }}
def Mesh "unseen" ( prepend apiSchemas = ["VisibilityAPI"] ) {{
    {SQUARE} uniform token purpose = "render" uniform token renderVisibility = "invisible"
}}"#
    );
    let names = |purpose: &[Purpose]| {
        let loaded = load_body("purposes", &body, &LoadOptions { purpose: purpose.to_vec(), ..LoadOptions::default() });
        assert!(warned(&loaded, "unknown purpose"));
        loaded.scene.surfaces.iter().map(|s| s.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(names(&[]), ["/plain", "/s/own"]);
    assert_eq!(names(&[Purpose::Default]), ["/plain"]);
    assert_eq!(names(&[Purpose::Proxy, Purpose::Guide]), ["/plain", "/s/m", "/guide"]);
}

/// Meshes with a material each; `shaders` are the bodies of their surface shaders.
fn with_materials(name: &str, shaders: &[(&str, &str)], files: &[(&str, [u8; 4])]) -> Loaded {
    let folder = Folder::new(name);
    for (file, color) in files {
        let picture = image::RgbaImage::from_pixel(2, 2, image::Rgba(*color));
        picture.save(folder.0.join(file)).unwrap();
    }
    let mut body = String::new();
    for (name, shader) in shaders {
        body += &format!(
            r#"def Mesh "{name}" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{ {SQUARE} rel material:binding = </looks/{name}> }}
def "looks" {{ def Material "{name}" {{
    token outputs:surface.connect = </looks/{name}/s.outputs:surface>
    {shader}
}} }}
"#
        );
    }
    load::load_with(&folder.stage(&body.replace("def \"looks\"", "over \"looks\"")), &LoadOptions::default()).unwrap()
}

#[test]
fn networks_of_constants_products_and_textures() {
    let shaders = [
        (
            "glass",
            r#"def Shader "s" {
    uniform token info:id = "ND_standard_surface_surfaceshader"
    color3f inputs:base_color = (0.5, 1, 0.25) float inputs:base = 0.8
    float inputs:transmission = 0.75 color3f inputs:transmission_color = (1, 0.5, 0)
    float inputs:emission = 3 color3f inputs:emission_color = (1, 2, 0)
    color3f inputs:opacity = (0.5, 0.5, 0.5)
    token outputs:surface
}"#,
        ),
        (
            "product",
            r#"def Shader "s" {
    uniform token info:id = "ND_open_pbr_surface_surfaceshader"
    color3f inputs:base_color.connect = </looks/product/m.outputs:out>
    float inputs:geometry_opacity.connect = </looks/product/o.outputs:out>
    token outputs:surface
}
def Shader "m" {
    uniform token info:id = "ND_multiply_color3"
    color3f inputs:in1.connect = </looks/product/i.outputs:out> color3f inputs:in2 = (1, 0.5, 0.25)
    color3f outputs:out
}
def Shader "i" { uniform token info:id = "ND_tiledimage_color3" asset inputs:file = @white.png@ float2 inputs:uvtiling = (2, 3) color3f outputs:out }
def Shader "o" { uniform token info:id = "ND_constant_float" float inputs:value = 0.25 float outputs:out }"#,
        ),
        (
            "leaf",
            r#"def Shader "s" {
    uniform token info:id = "ND_gltf_pbr_surfaceshader"
    float inputs:alpha = 0.5 int inputs:alpha_mode = 1 float inputs:alpha_cutoff = 0.75
    color3f inputs:emissive = (1, 0, 0) float inputs:emissive_strength = 4
    token outputs:surface
}"#,
        ),
        (
            "wall",
            r#"def Shader "s" { uniform token info:id = "ND_gltf_pbr_surfaceshader" float inputs:alpha = 0.5 token outputs:surface }"#,
        ),
        (
            "cutout",
            r#"def Shader "s" {
    uniform token info:id = "UsdPreviewSurface"
    color3f inputs:diffuseColor.connect = </looks/cutout/t.outputs:rgb>
    float inputs:opacity.connect = </looks/cutout/t.outputs:a>
    float inputs:opacityThreshold = 0.3
    token outputs:surface
}
def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @white.png@ float3 outputs:rgb float outputs:a }"#,
        ),
        (
            "other",
            r#"def Shader "s" {
    uniform token info:id = "UsdPreviewSurface"
    color3f inputs:diffuseColor.connect = </looks/other/t.outputs:rgb>
    float inputs:opacity.connect = </looks/other/o.outputs:g>
    token outputs:surface
}
def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @white.png@ float3 outputs:rgb }
def Shader "o" { uniform token info:id = "UsdUVTexture" asset inputs:file = @mask.png@ token inputs:sourceColorSpace = "raw" float outputs:g }"#,
        ),
    ];
    let files = [("white.png", [255, 255, 255, 102]), ("mask.png", [10, 51, 30, 255])];
    let loaded = with_materials("networks", &shaders, &files);
    let glass = material(&loaded, "/glass");
    assert!(glass.albedo.distance(Vec3::new(0.1, 0.2, 0.05)) < 1e-6, "{}", glass.albedo);
    assert_eq!(glass.transmission, Vec3::new(0.75, 0.375, 0.0));
    assert_eq!((glass.emission, glass.alpha), (Vec3::new(3.0, 6.0, 0.0), Alpha::Blend { opacity: 0.5 }));
    let product = material(&loaded, "/product");
    assert_eq!((product.albedo, product.alpha), (Vec3::new(1.0, 0.5, 0.25), Alpha::Blend { opacity: 0.25 }));
    let slot = product.albedo_texture.as_ref().unwrap();
    // (u, v) from the lower left: two times, three times.
    assert_eq!(slot.image_from_uv.transform_point2(glam::Vec2::new(0.5, 0.75)), glam::Vec2::new(1.0, 0.25));
    let leaf = material(&loaded, "/leaf");
    assert_eq!((leaf.alpha, leaf.emission), (Alpha::Mask { cutoff: 0.75, opacity: 0.5 }, Vec3::new(4.0, 0.0, 0.0)));
    assert_eq!((material(&loaded, "/wall").alpha, material(&loaded, "/wall").albedo), (Alpha::Opaque, Vec3::ONE));
    let cutout = material(&loaded, "/cutout");
    assert_eq!(cutout.alpha, Alpha::Mask { cutoff: 0.3, opacity: 1.0 });
    assert!(cutout.opacity_texture.is_none() && cutout.albedo_texture.as_ref().unwrap().scale.w == 1.0);
    let other = material(&loaded, "/other");
    let (color, mask) = (other.albedo_texture.as_ref().unwrap(), other.opacity_texture.as_ref().unwrap());
    assert_eq!((color.scale.w, color.bias.w), (0.0, 1.0), "the colour's own alpha is none");
    let alpha = loaded.scene.textures[mask.texture].texel(0, 0) * mask.scale + mask.bias;
    assert!((alpha.w - 0.2).abs() < 1e-6);
}

#[test]
fn bindings_for_full_renders_are_better_than_none() {
    let look = |name: &str, color: &str| {
        format!(
            r#"def Material "{name}" {{
    token outputs:surface.connect = </{name}/s.outputs:surface>
    def Shader "s" {{ uniform token info:id = "UsdPreviewSurface" color3f inputs:diffuseColor = {color} token outputs:surface }}
}}
"#
        )
    };
    let mesh = |name: &str, bindings: &str| {
        format!("def Mesh \"{name}\" ( prepend apiSchemas = [\"MaterialBindingAPI\"] ) {{ {SQUARE} {bindings} }}\n")
    };
    let body = [
        look("red", "(1, 0, 0)"),
        look("green", "(0, 1, 0)"),
        mesh("full", "rel material:binding:full = </red>"),
        mesh("both", "rel material:binding:full = </red> rel material:binding = </green>"),
    ];
    let loaded = load_body("full", &body.concat(), &LoadOptions::default());
    assert_eq!((material(&loaded, "/full").albedo, material(&loaded, "/both").albedo), (Vec3::X, Vec3::Y));
}

#[test]
fn tiles_of_pictures_go_to_their_faces() {
    let folder = Folder::new("udim");
    for (tile, color) in [(1001, [255, 0, 0, 255]), (1002, [0, 255, 0, 255]), (1011, [0, 0, 255, 255])] {
        let picture = image::RgbaImage::from_pixel(1, 1, image::Rgba(color));
        picture.save(folder.0.join(format!("paint.{tile}.png"))).unwrap();
    }
    let body = r#"def Mesh "m" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8, 7]
    point3f[] points = [(0,0,0), (1,0,0), (2,0,0), (0,1,0), (1,1,0), (2,1,0), (0,2,0), (1,2,0), (2,2,0)]
    texCoord2f[] primvars:st = [(0,0), (1,0), (2,0), (0,1), (1,1), (2,1), (0,2), (1,2), (2,2)] ( interpolation = "vertex" )
    rel material:binding = </look>
}
def Material "look" {
    token outputs:surface.connect = </look/s.outputs:surface>
    def Shader "s" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </look/t.outputs:rgb>
        token outputs:surface
    }
    def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @./paint.<UDIM>.png@ float3 outputs:rgb }
}"#;
    let loaded = load::load(&folder.stage(body)).unwrap();
    let mesh = &loaded.scene.meshes[0];
    let color = |face: u32| {
        let triangle = mesh.origin.iter().position(|o| o.face == face).unwrap();
        let slot = loaded.scene.material(0, triangle).albedo_texture.as_ref()?;
        let uv = slot.image_from_uv.transform_point2(mesh.uv_set("st").unwrap()[mesh.triangles[triangle][0] as usize]);
        assert!((0.0..=1.0).contains(&uv.x) && (0.0..=1.0).contains(&uv.y), "{uv} is outside its tile");
        Some(loaded.scene.textures[slot.texture].texel(0, 0).truncate())
    };
    assert_eq!((0..4).map(color).collect::<Vec<_>>(), [Some(Vec3::X), Some(Vec3::Y), Some(Vec3::Z), None]);
    assert!(warned(&loaded, "no picture for") && loaded.inputs.iter().any(|p| p.ends_with("paint.1011.png")));
}

#[test]
fn meshes_shine_by_their_lights_inputs() {
    let light = "float inputs:intensity = 2 float inputs:exposure = 1 color3f inputs:color = (1, 0.5, 0)";
    let look = r#"def Material "lamp" {
    token outputs:surface.connect = </lamp/s.outputs:surface>
    def Shader "s" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.5, 0.5, 0.5) color3f inputs:emissiveColor = (0.5, 1, 1)
        token outputs:surface
    }
}"#;
    let mesh = |name: &str, more: &str| {
        let apis = r#"prepend apiSchemas = ["MeshLightAPI", "MaterialBindingAPI"]"#;
        format!("def Mesh \"{name}\" ( {apis} ) {{ {SQUARE} {light} {more} }}\n")
    };
    let bound = "rel material:binding = </lamp>";
    let body = [
        look,
        &mesh("tinted", bound),
        &mesh("free", &format!("{bound} uniform token light:materialSyncMode = \"independent\"")),
        &mesh("black", &format!("{bound} uniform token light:materialSyncMode = \"noMaterialResponse\"")),
        &mesh("bare", ""),
        &mesh("spread", "bool inputs:normalize = 1 float3 xformOp:scale = (2, 4, 1) uniform token[] xformOpOrder = [\"xformOp:scale\"]"),
    ]
    .concat();
    let loaded = load_body("mesh_lights", &body, &LoadOptions::default());
    let emission = |name: &str| material(&loaded, name).emission;
    assert_eq!(emission("/tinted"), Vec3::new(2.0, 2.0, 0.0));
    assert_eq!(emission("/free"), Vec3::new(4.0, 2.0, 0.0));
    assert_eq!((emission("/black"), material(&loaded, "/black").albedo), (Vec3::new(4.0, 2.0, 0.0), Vec3::ZERO));
    assert_eq!((emission("/bare"), material(&loaded, "/free").albedo), (Vec3::new(4.0, 2.0, 0.0), Vec3::splat(0.5)));
    assert_eq!(emission("/spread"), Vec3::new(0.5, 0.25, 0.0), "8 square metres");
    assert!(warned(&loaded, "no emission to tint"));
}

#[test]
fn skeletons_move_what_they_hold() {
    let skin = r#"rel skel:skeleton = </rig/skel>
        int[] primvars:skel:jointIndices = [0, 0, 1, 1] ( elementSize = 1 interpolation = "vertex" )
        float[] primvars:skel:jointWeights = [1, 1, 1, 1] ( elementSize = 1 interpolation = "vertex" )"#;
    let body = format!(
        r#"def SkelRoot "rig" {{
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Skeleton "skel" {{
        uniform token[] joints = ["a", "a/b"]
        uniform matrix4d[] bindTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,1,0,1) )]
        uniform matrix4d[] restTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,1,0,1) )]
        rel skel:animationSource = </rig/anim>
    }}
    def SkelAnimation "anim" {{
        uniform token[] joints = ["a/b"]
        float3[] translations.timeSamples = {{ 0: [(0, 1, 0)], 2: [(0, 3, 0)] }}
        quatf[] rotations = [(1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1)]
    }}
    def Mesh "m" {{ {SQUARE} {skin} }}
    def Mesh "short" {{ {SQUARE} rel skel:skeleton = </rig/skel> int[] primvars:skel:jointIndices = [0, 7] ( interpolation = "vertex" ) float[] primvars:skel:jointWeights = [1] ( interpolation = "vertex" ) }}
}}"#
    );
    let at = |time| load_body("skel", &body, &LoadOptions { time, ..LoadOptions::default() });
    let top = |loaded: &Loaded| bounds(&loaded.scene, surface(&loaded.scene, "/rig/m")).1;
    assert!(top(&at(Some(1.0))).distance(Vec3::new(1.0, 2.0, 5.0)) < 1e-6);
    assert!(top(&at(Some(2.0))).distance(Vec3::new(1.0, 3.0, 5.0)) < 1e-6);
    let still = at(None);
    assert!(top(&still).distance(Vec3::new(1.0, 1.0, 5.0)) < 1e-6 && warned(&still, "joint influences don't fit"));
}

#[test]
fn shared_scenes_draw_as_many_gprims_as_usd_core_does() {
    let Some(shared) = shared() else { return };
    // Counted by usd-core: active, visible gprims of the default and render purpose, instances each.
    for (scene, count) in [
        ("usdwg_standard_shader_ball/StandardShaderBall/standard_shader_ball_scene.usda", 12),
        ("usdwg_foundation/test_assets/foundation/stage_composition/purpose.usda", 1),
    ] {
        assert_eq!(load::load(&shared.join("scenes").join(scene)).unwrap().scene.surfaces.len(), count, "{scene}");
    }
}
