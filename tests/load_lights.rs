//! Lights as files and settings ask for them: profiles, projectors, links, domes, portals, the sun.

mod files;
mod support;

use files::Folder;
use glam::{Vec2, Vec3};
use lumel::added_light;
use lumel::color::{Rgb, luminance};
use lumel::load::{self, Loaded};
use lumel::scene::{LightShape, Linked, Picture};
use lumel::settings::{Settings, SkySetting};
use std::f32::consts::PI;
use support::{Quad, atlas, bake, draft, scene};

/// A stage in metres, Y up, with floor and wall meshes below /geo.
fn stage(folder: &Folder, lights: &str) -> Loaded {
    let mesh = |name: &str, points: &str| {
        format!(
            "def Mesh \"{name}\" {{ uniform token subdivisionScheme = \"none\"\n int[] faceVertexCounts = [4]\n \
             int[] faceVertexIndices = [0, 1, 2, 3]\n point3f[] points = [{points}] }}\n"
        )
    };
    let floor = mesh("floor", "(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)");
    let shelf = mesh("shelf", "(-0.3, 1, -0.3), (-0.3, 1, 0.3), (0.3, 1, 0.3), (0.3, 1, -0.3)");
    let text = format!(
        "#usda 1.0\n(\n metersPerUnit = 1\n upAxis = \"Y\"\n)\ndef Scope \"geo\" {{\n{floor}{shelf}}}\n{lights}"
    );
    load::load(&folder.write("stage.usda", text)).unwrap()
}

const IES: &str = "IES:LM-63-2019\nTILT=NONE\n1 -1 1 5 1 1 2 0 0 0\n1 1 10\n0 45 90 135 180\n0\n100 80 20 0 0\n";

#[test]
fn usd_and_gltf_profiles_shine_as_their_file_says() {
    let folder = Folder::new("profiles");
    folder.write("lamp.ies", IES);
    let light = |more: &str| {
        format!(
            "def SphereLight \"lamp\" (prepend apiSchemas = [\"ShapingAPI\"]) {{ bool treatAsPoint = 1\n \
             float inputs:radius = 0.1\n float inputs:intensity = 3\n float inputs:shaping:cone:angle = 180\n \
             asset inputs:shaping:ies:file = @lamp.ies@\n{more}\n \
             float3 xformOp:rotateXYZ = (-90, 0, 0)\n uniform token[] xformOpOrder = [\"xformOp:rotateXYZ\"] }}"
        )
    };
    let plain = stage(&folder, &light(""));
    assert!(plain.warnings.iter().all(|w| !w.message.contains("IES")), "{:?}", plain.warnings);
    assert!(plain.inputs.iter().any(|p| p.ends_with("lamp.ies")));
    let lamp = &plain.scene.lights[0];
    // The schema: the candelas multiply the luminance. Straight down 100, level 20.
    let down = lamp.factor(&plain.scene, Vec3::ZERO, Vec3::NEG_Y).x;
    let level = lamp.factor(&plain.scene, Vec3::ZERO, Vec3::X).x;
    assert!((down - 100.0).abs() < 0.01 && (level - 20.0).abs() < 0.01, "{down} {level}");
    // Normalized, its mean over all directions is 1, so that the light keeps its power.
    let normal = stage(&folder, &light("bool inputs:shaping:ies:normalize = 1"));
    let lamp = &normal.scene.lights[0];
    let profile = lamp.profile.as_ref().unwrap();
    assert!((profile.power() / (4.0 * f64::from(PI)) - 1.0).abs() < 1e-5);

    let gltf = |source: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["EXT_lights_ies"],
            "extensions":{{"EXT_lights_ies":{{"lights":[{{{source}}}]}}}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
            "nodes":[{{"mesh":0}},{{"name":"lamp","translation":[0,2,0],"rotation":[-0.70710678,0,0,0.70710678],
              "extensions":{{"EXT_lights_ies":{{"light":0,"multiplier":2,"color":[1,0.5,0.25]}}}}}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],
            "buffers":[{{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}}]}}"#
        )
    };
    let loaded = load::load(&folder.write("lamp.gltf", gltf(r#""uri":"lamp.ies""#))).unwrap();
    let [lamp] = &loaded.scene.lights[..] else { panic!("{:?}", loaded.warnings) };
    let LightShape::Point { position, intensity, .. } = &lamp.shape else { panic!() };
    assert_eq!((*position, *intensity), (Vec3::Y * 2.0, Rgb::new(2.0, 1.0, 0.5)));
    let down = lamp.factor(&loaded.scene, *position, Vec3::NEG_Y).x;
    assert!((down - 100.0).abs() < 0.01, "{down}");
    let broken = load::load(&folder.write("broken.gltf", gltf(r#""uri":"none.ies""#))).unwrap();
    assert!(broken.scene.lights.is_empty() && broken.warnings.iter().any(|w| w.message.contains("light profile")));
    assert!(load::load(&folder.write("bad.gltf", gltf("").replace("\"light\":0", "\"light\":5"))).is_err());
}

#[test]
fn projectors_are_asked_for_in_usd_gltf_and_settings() {
    let folder = Folder::new("projectors");
    folder.write("slide.png", PNG);
    let lamp = |more: &str| {
        format!(
            "def SphereLight \"beam\" (prepend apiSchemas = [\"ShapingAPI\"]) {{ bool treatAsPoint = 1\n \
             float inputs:shaping:cone:angle = 20\n{more}\n double3 xformOp:translate = (0, 3, 2)\n \
             float3 xformOp:rotateXYZ = (-56, 0, 0)\n \
             uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:rotateXYZ\"] }}"
        )
    };
    let usd = stage(&folder, &lamp("asset lumel:projector = @slide.png@\nrel lumel:projector:target = </geo/floor>"));
    let Some(Picture::Thrown(by_prim)) = &usd.scene.lights[0].picture else { panic!("{:?}", usd.warnings) };
    assert!(by_prim.focus.is_some());
    let plane = "point3f lumel:projector:plane:point = (0, 0, 0)\nnormal3f lumel:projector:plane:normal = (0, 1, 0)";
    let given = stage(&folder, &lamp(&format!("asset lumel:projector = @slide.png@\n{plane}")));
    let Some(Picture::Thrown(by_plane)) = &given.scene.lights[0].picture else { panic!("{:?}", given.warnings) };
    assert!(by_prim.picture_from_direction.abs_diff_eq(by_plane.picture_from_direction, 1e-5));
    // The same by settings; the cone's angle is the picture's.
    let mut plain = stage(&folder, &lamp(""));
    let projector = lumel::settings::ProjectorSetting {
        light: "*/beam".into(),
        picture: folder.0.join("slide.png"),
        fov: None,
        aspect: None,
        target: Some("/geo/fl*".into()),
    };
    added_light::add(&mut plain, &Settings { projectors: vec![projector], ..draft() }).unwrap();
    let Some(Picture::Thrown(by_setting)) = &plain.scene.lights[0].picture else { panic!("{:?}", plain.warnings) };
    assert_eq!(by_prim.picture_from_direction, by_setting.picture_from_direction);
    // A target behind the light is said, and the picture is thrown all the same.
    let behind = plane.replace("(0, 0, 0)", "(0, 9, 0)");
    let behind = stage(&folder, &lamp(&format!("asset lumel:projector = @slide.png@\n{behind}")));
    assert!(matches!(&behind.scene.lights[0].picture, Some(Picture::Thrown(p)) if p.focus.is_none()));
    assert!(behind.warnings.iter().any(|w| w.message.contains("behind")));

    let gltf = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual"],
        "extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","intensity":9,"spot":{"outerConeAngle":0.34906585}}]}},
        "scene":0,"scenes":[{"nodes":[0,1]}],
        "nodes":[{"mesh":0,"name":"screen"},{"name":"beam","translation":[0.3,0.3,3],"extensions":{"KHR_lights_punctual":{"light":0}},
          "extras":{"lumel_projector":{"picture":"slide.png","target":"screen"}}}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;
    let loaded = load::load(&folder.write("beam.gltf", gltf)).unwrap();
    let Some(Picture::Thrown(p)) = &loaded.scene.lights[0].picture else { panic!("{:?}", loaded.warnings) };
    // Straight at the screen: as without a target. The right edge lies at the cone's angle.
    let right = Vec3::new(0.34906585f32.tan(), 0.0, -1.0);
    assert!(p.uv(right).unwrap().distance(Vec2::new(1.0, 0.5)) < 1e-5);
    let missing = gltf.replace("slide.png", "none.png");
    let missing = load::load(&folder.write("missing.gltf", missing)).unwrap();
    assert!(missing.scene.lights[0].picture.is_none() && !missing.warnings.is_empty());
    assert!(load::load(&folder.write("bad.gltf", gltf.replace("\"target\"", "\"goal\""))).is_err());
}

/// A grey PNG of one texel, 128 of 255.
#[rustfmt::skip]
const PNG: &[u8] = &[
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00, 0x01,
    0x00, 0x00, 0x00, 0x01, 0x08, 0x00, 0x00, 0x00, 0x00, 0x3a, 0x7e, 0x9b, 0x55, 0x00, 0x00, 0x00, 0x0a, 0x49, 0x44, 0x41,
    0x54, 0x78, 0x9c, 0x63, 0x68, 0x00, 0x00, 0x00, 0x82, 0x00, 0x81, 0x77, 0xcd, 0x72, 0xb6, 0x00, 0x00, 0x00, 0x00, 0x49,
    0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
];

#[test]
fn usd_collections_link_lights() {
    let folder = Folder::new("links");
    let lamps = r#"
        def SphereLight "all" { }
        def SphereLight "include" { rel collection:lightLink:includes = </geo/shelf>
            uniform bool collection:lightLink:includeRoot = 0 }
        def SphereLight "exclude" { rel collection:lightLink:excludes = </geo/floor> }
        def SphereLight "shadow" { rel collection:shadowLink:excludes = </geo/shelf> }
        def SphereLight "explicit" { rel collection:lightLink:includes = </geo>
            uniform token collection:lightLink:expansionRule = "explicitOnly"
            uniform bool collection:lightLink:includeRoot = 0 }
        def SphereLight "expression" { uniform bool collection:lightLink:includeRoot = 0
            uniform pathExpression collection:lightLink:membershipExpression = "/geo//s*" }
        def SphereLight "shadowless" { bool inputs:shadow:enable = 0 }
    "#;
    let loaded = stage(&folder, lamps);
    let paths: Vec<&str> = loaded.scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(paths, ["/geo/floor", "/geo/shelf"]);
    let both = |linked: &Linked| [linked.holds(0), linked.holds(1)];
    let expected = [
        ("/all", [true, true], [true, true]),
        ("/include", [false, true], [true, true]),
        ("/exclude", [false, true], [true, true]),
        ("/shadow", [true, true], [true, false]),
        ("/explicit", [false, false], [true, true]),
        ("/expression", [false, true], [true, true]),
        ("/shadowless", [true, true], [false, false]),
    ];
    assert_eq!(loaded.scene.lights.len(), expected.len(), "{:?}", loaded.warnings);
    for (light, (name, lit, blockers)) in loaded.scene.lights.iter().zip(expected) {
        assert_eq!(light.name, name);
        assert_eq!((both(&light.links.lit), both(&light.links.blockers)), (lit, blockers), "{name}");
    }
    assert!(loaded.scene.lights[0].links.are_all());
}

#[test]
fn usd_domes_portals_and_connected_inputs() {
    let folder = Folder::new("domes");
    folder.write("sky.png", PNG);
    let lights = r#"
        def DomeLight "plain" { float inputs:intensity = 2 }
        def DomeLight "picture" { asset inputs:texture:file = @sky.png@
            token inputs:texture:format = "mirroredBall" }
        def DomeLight_1 "other" { asset inputs:texture:file = @sky.png@ }
        def DomeLight "window" { float inputs:intensity = 7
            rel portals = [</hole>, </missing>] }
        def PortalLight "hole" { float inputs:width = 2
            double3 xformOp:translate = (0, 2, 0)
            float3 xformOp:rotateXYZ = (-90, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"] }
        def PortalLight "unused" { }
        def GeometryLight "old" { }
        def Material "m" { float inputs:level = 5
            def Shader "s" { float outputs:out } }
        def SphereLight "wired" { float inputs:intensity.connect = </m.inputs:level> }
        def SphereLight "shader" { float inputs:intensity = 3
            float inputs:intensity.connect = </m/s.outputs:out> }
    "#;
    let loaded = stage(&folder, lights);
    let sky = loaded.scene.environment.as_ref().unwrap();
    assert_eq!(sky.each().count(), 3);
    assert_eq!(sky.radiance, Rgb::splat(2.0));
    let total = sky.radiance_from(&loaded.scene, Vec3::new(0.48, 0.6, 0.64));
    assert!((total.x - (2.0 + 2.0 * loaded.scene.textures[0].texel(0, 0).x)).abs() < 1e-3, "{total}");
    let portal = loaded.scene.lights.iter().find(|l| l.name == "/window").unwrap();
    let LightShape::Portal { center, u, v, sky } = &portal.shape else { panic!() };
    assert_eq!(*center, Vec3::Y * 2.0);
    assert!(u.distance(Vec3::X) < 1e-6 && u.cross(*v).normalize().distance(Vec3::Y) < 1e-6);
    assert_eq!(sky.radiance, Rgb::splat(7.0));
    let radiance = |name: &str| match loaded.scene.lights.iter().find(|l| l.name == name).unwrap().shape {
        LightShape::Sphere { radiance, .. } => radiance.x,
        _ => panic!(),
    };
    assert_eq!((radiance("/wired"), radiance("/shader")), (5.0, 3.0));
    for (message, place) in [
        ("PortalLight of the stage", "/missing"),
        ("no dome", "/unused"),
        ("deprecated", "/old"),
        ("shader", "/shader"),
    ] {
        let is = |w: &lumel::error::Warning| w.message.contains(message) && w.places.iter().any(|p| p.contains(place));
        assert!(loaded.warnings.iter().any(is), "{message} {place}: {:?}", loaded.warnings);
    }
}

#[test]
fn a_sun_and_a_clear_sky_by_settings() {
    let folder = Folder::new("sun");
    let bake_with = |settings: &Settings| {
        let mut loaded = stage(&folder, "");
        added_light::add(&mut loaded, settings).unwrap();
        // A black floor: direct light alone.
        let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0)]);
        (scene.lights, scene.textures, scene.environment) =
            (loaded.scene.lights, loaded.scene.textures, loaded.scene.environment);
        let found = bake(&scene, &atlas(1, 32), &draft()).gathered.irradiance;
        luminance(found.iter().sum::<Rgb>() / found.len() as f32)
    };
    let sun = Settings { sun: Some([30.0, 200.0, 80_000.0]), ..draft() };
    let e = bake_with(&sun);
    assert!((e / 40_000.0 - 1.0).abs() < 0.001, "{e}");
    let clear = Settings { sun: Some([30.0, 200.0, 0.0]), sky: Some(SkySetting::Clear { turbidity: 3.0 }), ..draft() };
    let e = bake_with(&clear);
    let expected = 800.0 + 15_500.0 * 0.5f32.sqrt();
    assert!((e / expected - 1.0).abs() < 0.02, "{e} against {expected}");
    // North is -Z, east +X.
    let mut loaded = stage(&folder, "");
    added_light::add(&mut loaded, &Settings { sun: Some([0.0, 90.0, 1.0]), ..draft() }).unwrap();
    let LightShape::Directional { direction, angle, .. } = loaded.scene.lights[0].shape else { panic!() };
    assert!(direction.distance(Vec3::NEG_X) < 1e-6 && (angle.to_degrees() - 0.53).abs() < 1e-4);
}
