//! The USD layer: written for scenes in memory over usda files, opened again with its sublayer.

mod usd_layer;

use glam::Vec3;
use lumel::post::Quantity;
use lumel::scene::{BakeMode, Environment, Light, LightShape, SurfaceOrigin, TextureSlot};
use lumel::write::BakedLights;
use openusd::gf::Vec3f;
use openusd::sdf::{AssetPath, Value};
use openusd::tf::Token;
use std::fs;
use usd_layer::*;

#[test]
fn gprims_get_uvs_rectangle_page_and_colours() {
    let usda = room(&format!("def Mesh \"Box\"\n{{{MESH}}}\ndef Mesh \"Lid\"\n{{{MESH}}}"));
    let mut bake = Bake::new("gprims", &usda);
    let mesh = bake.mesh(&COUNTS, &[2]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.125, 0.5]);
    bake.surface("/World/Lid", mesh, SurfaceOrigin::UsdPrim, 1, [0.0, 0.0]);
    // The lid's two faces disagree at the points that they share.
    bake.vertices.surfaces[1].triangles[2].values = [Vec3::splat(7.0); 3];
    let (stage, warnings) = bake.write();
    assert_eq!(warnings, [""; 0]);
    assert_eq!(fs::read_to_string(bake.input()).unwrap(), usda);

    let prim = stage.prim("/World/Box").unwrap();
    let uvs = flat(&prim, "primvars:st1");
    let expected: Vec<[f32; 2]> = (0..10).map(|c| if c < 7 { [c as f32 / 8.0, 0.75] } else { [0.0, 0.0] }).collect();
    assert_eq!(uvs, expected);
    assert_eq!(prim.attribute("primvars:st1").type_name().unwrap().unwrap().as_str(), "texCoord2f[]");
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "st1");
    assert_eq!(token(&prim, "lumel:quantity").unwrap(), "outgoing");
    // v down, 0.25 becomes 0.25 * 0.25 + 0.5; v up the same point is 0.75, and must become 1 - 0.5625.
    assert_eq!(rectangle(&prim, "primvars:lumel:scaleOffset"), Some([0.5, 0.25, 0.125, 0.25]));
    assert_eq!(0.75 * 0.25 + 0.25, 1.0 - 0.5625);
    assert_eq!(interpolation(&prim, "primvars:lumel:scaleOffset"), "constant");
    let page: AssetPath = get(&prim, "lumel:lightmap").unwrap();
    assert_eq!(page.as_str(), "./lightmaps/room_0.exr");
    assert!(page.resolved_path().unwrap().ends_with("room_baked/lightmaps/room_0.exr"));

    for name in ["primvars:displayColor", "primvars:lumel:irradiance"] {
        assert_eq!(interpolation(&prim, name), "vertex");
        let colors: Vec<Vec3f> = get(&prim, name).unwrap();
        let lit = Vec3f { x: 1.0, y: 0.5, z: 1e-6 };
        assert_eq!(colors, [lit, lit, lit, lit, lit, Vec3f { x: 0.0, y: 0.0, z: 0.0 }]);
    }
    let lid = stage.prim("/World/Lid").unwrap();
    assert_eq!(interpolation(&lid, "primvars:displayColor"), "faceVarying");
    let indices: Vec<i32> = get(&lid, "primvars:displayColor:indices").unwrap();
    assert_eq!(indices, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2]);
    let page: AssetPath = get(&lid, "lumel:lightmap").unwrap();
    assert_eq!(page.as_str(), "./lightmaps/room_1.exr");

    // Equal input, equal bytes.
    let first = bake.text();
    bake.write();
    assert_eq!(bake.text(), first);
}

#[test]
fn metadata_is_that_of_the_input() {
    let usda = r#"#usda 1.0
(
    "a comment that is about the input alone"
    customLayerData = {
        asset icon = @./icon.png@
        string author = "she said \"hello\""
        dictionary "render settings" = {
            double "rtx:light:intensity" = 0.5
        }
    }
    colorConfiguration = @./ocio/config.ocio@
    defaultPrim = "World"
    endTimeCode = 48
    framesPerSecond = 30
    kilogramsPerUnit = 0.001
    metersPerUnit = 0.0254
    startTimeCode = 1
    subLayers = [@./sub.usda@]
    timeCodesPerSecond = 60
    upAxis = "Z"
)
def Xform "World" { }
"#;
    let mut bake = Bake::new("metadata", usda);
    fs::write(bake.folder.join("sub.usda"), "#usda 1.0\n(\n upAxis = \"Y\"\n)\n").unwrap();
    bake.quantity = Quantity::Irradiance;
    let (stage, _) = bake.write();
    let number = |name: &str| match stage.stage_metadata(name).unwrap() {
        Some(Value::Double(v)) => v,
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(number("metersPerUnit"), 0.0254);
    assert_eq!(number("kilogramsPerUnit"), 0.001);
    assert_eq!((stage.start_time_code(), stage.end_time_code()), (1.0, 48.0));
    assert_eq!((stage.time_codes_per_second(), stage.frames_per_second()), (60.0, 30.0));
    assert_eq!(stage.default_prim().unwrap().as_str(), "World");
    assert_eq!(stage.stage_metadata("upAxis").unwrap(), Some(Value::token("Z")));
    let text = bake.text();
    assert!(text.contains("colorConfiguration = @../ocio/config.ocio@"), "{text}");
    assert!(text.contains("subLayers = [@../room.usda@]"), "{text}");
    assert!(!text.contains("a comment"), "{text}");
    let Some(Value::Dictionary(data)) = stage.custom_layer_data().unwrap() else { panic!("no customLayerData") };
    assert_eq!(data["icon"], Value::AssetPath("../icon.png".into()));
    assert_eq!(data["author"], Value::String("she said \"hello\"".into()));
    let Value::Dictionary(settings) = &data["render settings"] else { panic!("no settings") };
    assert_eq!(settings["rtx:light:intensity"], Value::Double(0.5));
    assert!(text.contains("double \"rtx:light:intensity\" = 0.5"), "usd-core reads no bare key with a colon: {text}");
    let Value::Dictionary(lumel) = &data["lumel"] else { panic!("no lumel") };
    assert_eq!(lumel["version"], Value::String(env!("CARGO_PKG_VERSION").into()));
    assert_eq!(lumel["quantity"], Value::String("irradiance".into()));
    assert_eq!(lumel["unit"], Value::String("lx".into()));
    assert_eq!(lumel["pages"], Value::AssetPathVec(PAGES.map(|p| format!("./{p}").into()).into()));
}

#[test]
fn metadata_that_no_stage_may_have_is_left_out() {
    let usda = r#"#usda 1.0
(
    defaultPrim = "World/Box"
    endTimeCode = inf
    framePrecision = -1
    framesPerSecond = -1
    kilogramsPerUnit = nan
    metersPerUnit = 0
    startTimeCode = -7
    timeCodesPerSecond = 0
    upAxis = "X"
)
def Xform "World" { def Xform "Box" { } }
"#;
    let bake = Bake::new("invalid metadata", usda);
    let (stage, warnings) = bake.write();
    // Of fields that are to be alike, warnings name the first.
    let named = [
        ("endTimeCode", "a finite number"),
        ("framePrecision", "an integer of 0 or more"),
        ("framesPerSecond", "a positive number"),
        ("upAxis", "Y or Z"),
    ];
    let file = bake.input().display().to_string();
    let expected = named.map(|(name, what)| {
        format!("{file} ({name}): is not {what}; the layer is without it, as readers refuse it or read something else")
    });
    assert_eq!(warnings, expected);
    let text = bake.text();
    let alike = ["kilogramsPerUnit", "metersPerUnit", "timeCodesPerSecond"];
    let mut left_out = named.iter().map(|(name, _)| *name).chain(alike);
    assert!(!left_out.any(|name| text.contains(name)), "{text}");
    assert_eq!(stage.start_time_code(), -7.0);
    assert_eq!(stage.default_prim().unwrap().as_str(), "World/Box");
}

#[test]
fn uvs_avoid_a_name_that_a_texture_reads() {
    let shader = r#"
    def Material "Paint"
    {
        def Shader "Uvs"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st2"
        }
    }"#;
    let mut bake = Bake::new("names", &room(&format!("def Mesh \"Box\"\n{{{MESH}}}\n{shader}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    // One is read by a texture of the scene, one by a shader that the scene doesn't know.
    bake.scene.materials[0].albedo_texture = Some(TextureSlot::new(0, "st1"));
    let (stage, warnings) = bake.write();
    let prim = stage.prim("/World/Box").unwrap();
    assert_eq!(flat(&prim, "primvars:st3").len(), 10);
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "st3");
    assert!(warnings[0].starts_with("st3: "), "{warnings:?}");
}

#[test]
fn authored_uvs_are_named_and_not_written_again() {
    let uvs = "texCoord2f[] primvars:lightmap = [(0, 0)] (\n interpolation = \"constant\"\n)\n";
    let mut bake = Bake::new("authored", &room(&format!("def Mesh \"Box\"\n{{{MESH}{uvs}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.atlas.meshes[mesh].authored = Some("lightmap".into());
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    let (stage, _) = bake.write();
    let prim = stage.prim("/World/Box").unwrap();
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "lightmap");
    assert!(!bake.text().contains("st1"));
    assert!(rectangle(&prim, "primvars:lumel:scaleOffset").is_some());
}

#[test]
fn display_color_stays_where_the_look_depends_on_it() {
    let material = r#"
    def Material "Reads"
    {
        token outputs:surface.connect = </World/Reads/Color.outputs:result>
        def Shader "Color"
        {
            uniform token info:id = "UsdPrimvarReader_float3"
            string inputs:varname = "displayColor"
            float3 outputs:result
        }
    }
    def Material "Plain" { }"#;
    let red = "color3f[] primvars:displayColor = [(1, 0, 0)]\n int[] primvars:displayColor:indices = [0]\n";
    let prim = |name: &str, rest: &str| format!("def Mesh \"{name}\"\n{{{MESH}{rest}}}\n");
    let meshes = [
        prim("Bound", "rel material:binding = </World/Reads>\n"),
        prim("Unbound", red),
        prim("Covered", &format!("{red}rel material:binding = </World/Plain>\n")),
        prim("Subset", "def GeomSubset \"Part\"\n{\nrel material:binding = </World/Reads>\n}\n"),
    ];
    let mut bake = Bake::new("display_color", &room(&format!("{material}\n{}", meshes.concat())));
    let mesh = bake.mesh(&COUNTS, &[]);
    for name in ["Bound", "Unbound", "Covered", "Subset"] {
        bake.surface(&format!("/World/{name}"), mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    }
    let (stage, warnings) = bake.write();
    let colors =
        |name: &str| get::<Vec<Vec3f>>(&stage.prim(format!("/World/{name}")).unwrap(), "primvars:displayColor");
    assert_eq!(colors("Bound"), None);
    assert_eq!(colors("Unbound").unwrap(), [Vec3f { x: 1.0, y: 0.0, z: 0.0 }]);
    assert_eq!(colors("Covered").unwrap().len(), 6);
    assert_eq!(colors("Subset"), None);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    // The input's indices are for one value, not for ours.
    let covered = stage.prim("/World/Covered").unwrap();
    assert_eq!(get::<Vec<i32>>(&covered, "primvars:displayColor:indices"), None);
}

#[test]
fn lights_are_marked_removed_or_kept() {
    let lights = "def RectLight \"Lamp\"\n{\n}\ndef DomeLight \"Sky\"\n{\n}";
    let lamp = format!("{}class Xform \"Lantern\"\n{{\ndef SphereLight \"Bulb\"\n{{\n}}\n}}\n", {
        room(&format!("{lights}\n{}", ["Left", "Right"].map(|n| instance_of(n, "Lantern")).concat()))
    });
    let mut bake = Bake::new("lights", &lamp);
    for name in ["/World/Lamp", "/World/Left/Bulb", "/World/Gone", "not a path"] {
        let shape = LightShape::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range: None };
        bake.scene.lights.push(Light::new(name, shape));
    }
    bake.scene.environment = Some(Environment::constant("/World/Sky", Vec3::ONE));
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let baked = |path: &str| get::<bool>(&stage.prim(path).unwrap(), "lumel:baked");
    for path in ["/World/Lamp", "/World/Sky", "/World/Left/Bulb", "/World/Right/Bulb"] {
        assert_eq!(baked(path), Some(true), "{path}");
    }
    assert!(stage.prim("/World/Left").unwrap().is_instance().unwrap());

    bake.lights = BakedLights::Remove;
    let (stage, _) = bake.write();
    for path in ["/World/Lamp", "/World/Sky", "/World/Left/Bulb"] {
        assert!(!stage.prim(path).unwrap().is_active().unwrap(), "{path}");
    }
    bake.lights = BakedLights::Keep;
    bake.scene.environment = Some(Environment::constant("--sky", Vec3::ONE));
    bake.write();
    assert!(!bake.text().contains("over"));
}

#[test]
fn lights_that_are_baked_in_part_stay_and_say_what_is_left() {
    let lights = ["Live", "Mixed", "Lamp"].map(|name| format!("def SphereLight \"{name}\"\n{{\n}}\n")).concat();
    let mut bake = Bake::new("partial lights", &room(&format!("{lights}def DomeLight \"Sky\"\n{{\n}}")));
    let modes = [("Live", BakeMode::Dynamic), ("Mixed", BakeMode::Indirect), ("Lamp", BakeMode::Baked)];
    for (name, mode) in modes {
        let shape = LightShape::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range: None };
        let mut light = Light::new(format!("/World/{name}"), shape);
        light.contribution.mode = Some(mode);
        bake.scene.lights.push(light);
    }
    let mut sky = Environment::constant("/World/Sky", Vec3::ONE);
    sky.contribution.mode = Some(BakeMode::Indirect);
    bake.scene.environment = Some(sky);
    for lights in [BakedLights::Mark, BakedLights::Remove] {
        bake.lights = lights;
        let (stage, _) = bake.write();
        let prim = |name: &str| stage.prim(format!("/World/{name}").as_str()).unwrap();
        let token = |name: &str, attribute: &str| get::<Token>(&prim(name), attribute).map(|t| t.as_str().to_owned());
        for name in ["Mixed", "Sky"] {
            assert!(prim(name).is_active().unwrap());
            assert_eq!(token(name, "lumel:bake").as_deref(), Some("indirect"));
            assert_eq!(token(name, "lumel:realtime").as_deref(), Some("direct"));
            assert_eq!(get::<bool>(&prim(name), "lumel:baked"), None);
        }
        assert!(prim("Live").is_active().unwrap() && !bake.text().contains("\"Live\""));
        assert_eq!(prim("Lamp").is_active().unwrap(), lights == BakedLights::Mark);
    }
}

#[test]
fn what_the_stage_does_not_hold_is_a_warning() {
    let mut bake = Bake::new("missing", &room(&format!("def Cube \"Cube\"\n{{\n}}\ndef Mesh \"Box\"\n{{{MESH}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    let larger = bake.mesh(&[4, 4, 4], &[]);
    bake.surface("/World/Cube", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("/World/Gone", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("no path", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("/World/Box", larger, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.point("/World/Nobody", usize::MAX, "/World/Box", mesh, 0, [0.0; 2]);
    bake.point("/World", usize::MAX, "/World/Box", mesh, 0, [0.0; 2]);
    let (_, warnings) = bake.write();
    assert!(warnings.len() >= 4, "{warnings:?}");

    fs::write(bake.input(), "#usda 1.0\ndef {{{").unwrap();
    let error = bake.try_write().unwrap_err().to_string();
    assert!(error.contains("room.usda"), "{error}");
    fs::remove_file(bake.input()).unwrap();
    assert!(bake.try_write().is_err());
}

#[test]
fn a_bake_of_a_bake_writes_its_own_colours_again() {
    let mut bake = Bake::new("again", &room(&format!("def Mesh \"Box\"\n{{{MESH}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.write();
    fs::copy(bake.output(), bake.folder.join("second.usda")).unwrap();
    let first = fs::read_to_string(bake.output()).unwrap().replace("@../room.usda@", "@./below.usda@");
    fs::rename(bake.input(), bake.folder.join("below.usda")).unwrap();
    fs::write(bake.input(), first).unwrap();
    bake.vertices.surfaces[0].triangles.iter_mut().for_each(|t| t.values = [Vec3::splat(9.0); 3]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings, [""; 0]);
    let colors: Vec<Vec3f> = get(&stage.prim("/World/Box").unwrap(), "primvars:displayColor").unwrap();
    assert_eq!(colors[0], Vec3f { x: 9.0, y: 9.0, z: 9.0 });
}
