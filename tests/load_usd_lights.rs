//! The USD reader's lights against what UsdLux says of them.

mod files;
mod usd_stage;

use glam::{Vec2, Vec3};
use lumel::scene::LightShape;
use usd_stage::{METRES, SQUARE, assert_close, load_text, warned};

fn load_light(name: &str, stage: &str, light: &str) -> LightShape {
    let loaded = load_text(name, &format!("{stage}{light}\ndef Mesh \"m\" {{ {SQUARE} }}"));
    loaded.scene.lights[0].shape.clone()
}

const CENTIMETRES_Z: &str = "#usda 1.0\n(\n metersPerUnit = 0.01\n upAxis = \"Z\"\n)\n";

#[test]
fn area_lights() {
    let rect = r#"def RectLight "l" {
    float inputs:width = 200
    float inputs:height = 100
    float inputs:intensity = 3
    float inputs:exposure = 2
    color3f inputs:color = (1, 0.5, 0)
    double3 xformOp:translate = (0, 0, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}"#;
    let LightShape::Rect { center, u, v, radiance } = load_light("rect", CENTIMETRES_Z, rect) else { panic!() };
    assert_close(center, Vec3::new(0.0, 3.0, 0.0));
    assert_close(radiance, Vec3::new(12.0, 6.0, 0.0));
    assert_close(-u.cross(v), Vec3::new(0.0, -0.5, 0.0));
    assert_close(u, Vec3::X);

    // Normalized: over the area in stage units, scale included; mirrored, it still shines along its own -Z.
    let disk = r#"def DiskLight "l" {
    float inputs:radius = 2
    bool inputs:normalize = 1
    float3 xformOp:scale = (3, 1, -1)
    uniform token[] xformOpOrder = ["xformOp:scale"]
}"#;
    let LightShape::Disk { u, v, radiance, .. } = load_light("disk", METRES, disk) else { panic!() };
    assert!((radiance.x * 12.0 * std::f32::consts::PI - 1.0).abs() < 1e-5);
    assert!((-u.cross(v)).z > 0.0 && (u.cross(v).length() - 12.0).abs() < 1e-4);

    let sphere = "def SphereLight \"l\" { float inputs:radius = 50\n bool inputs:normalize = 1 }";
    let LightShape::Sphere { world_from_unit, radiance } = load_light("sphere", CENTIMETRES_Z, sphere) else {
        panic!()
    };
    assert!((radiance.x * 4.0 * std::f32::consts::PI * 2500.0 - 1.0).abs() < 1e-5);
    assert!((world_from_unit.transform_vector3(Vec3::X).length() - 0.5).abs() < 1e-6);

    let cylinder = "def CylinderLight \"l\" { float inputs:radius = 0.5\n float inputs:length = 4 }";
    let LightShape::Cylinder { world_from_unit, .. } = load_light("cylinder", METRES, cylinder) else { panic!() };
    assert_close(world_from_unit.transform_vector3(Vec3::ONE), Vec3::new(2.0, 0.5, 0.5));
}

#[test]
fn points_and_the_sun() {
    let point =
        "def SphereLight \"l\" { float inputs:radius = 2\n bool treatAsPoint = 1\n float inputs:intensity = 5 }";
    let LightShape::Point { intensity, .. } = load_light("point", METRES, point) else { panic!() };
    assert!((intensity.x - 5.0 * 4.0 * std::f32::consts::PI).abs() < 1e-3, "L pi r^2: {intensity}");
    let zero =
        "def SphereLight \"l\" { float inputs:radius = 0\n bool inputs:normalize = 1\n float inputs:intensity = 8 }";
    let LightShape::Point { intensity, .. } = load_light("zero", METRES, zero) else { panic!() };
    assert!((intensity.x - 2.0).abs() < 1e-5);
    // The schema's defaults: 50000 nit, 0.53 degrees.
    let sun = load_light("sun", CENTIMETRES_Z, "def DistantLight \"l\" {}");
    let LightShape::Directional { direction, illuminance, angle } = sun else { panic!() };
    assert_close(direction, Vec3::NEG_Y);
    assert!((illuminance.x - 3.36).abs() < 0.005 && (angle - 0.53_f32.to_radians()).abs() < 1e-6);
    let lux =
        "def DistantLight \"l\" { bool inputs:normalize = 1\n float inputs:intensity = 700\n float inputs:angle = 10\n
        bool inputs:enableColorTemperature = 1\n float inputs:colorTemperature = 6500 }";
    let LightShape::Directional { illuminance, .. } = load_light("lux", METRES, lux) else { panic!() };
    assert!((illuminance / 700.0 - Vec3::new(1.0433334, 0.98362446, 1.0346133)).abs().max_element() < 1e-4);
}

#[test]
fn shaping_and_domes() {
    let loaded = load_text(
        "shaping",
        &format!(
            r#"{CENTIMETRES_Z}
def SphereLight "spot" ( prepend apiSchemas = ["ShapingAPI"] ) {{
    float inputs:shaping:cone:angle = 30
    float inputs:shaping:cone:softness = 0.5
    float inputs:shaping:focus = 2
    asset inputs:shaping:ies:file = @lamp.ies@
}}
def DomeLight_1 "sky" {{ float inputs:intensity = 2 }}
def PortalLight "portal" {{}}
def Mesh "m" {{ {SQUARE} }}"#
        ),
    );
    let shaping = loaded.scene.lights[0].shaping.unwrap();
    assert_close(shaping.axis, Vec3::NEG_Y);
    assert!((shaping.cone_angle - 30f32.to_radians()).abs() < 1e-6);
    assert_eq!((shaping.cone_softness, shaping.focus), (0.5, 2.0));
    let sky = loaded.scene.environment.as_ref().unwrap();
    assert_close(sky.radiance, Vec3::splat(2.0));
    // Z up, pole on the up axis: the picture's top is up, its middle looks along the stage's -Y, which is +Z here.
    assert!(sky.uv(Vec3::Y).y < 1e-3);
    assert!((sky.uv(Vec3::Z) - Vec2::splat(0.5)).abs().max_element() < 1e-5);
    assert!((sky.uv(Vec3::X) - Vec2::new(0.25, 0.5)).abs().max_element() < 1e-5);
    assert!(warned(&loaded, "IES", "/spot: lamp.ies") && warned(&loaded, "no dome light names this portal", "/portal"));
}
