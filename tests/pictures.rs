//! Methods that follow rays, through cameras and on texels: against radiances known on paper, and against the reference for
//! diffuse scenes.

mod support;

use glam::{Affine3A, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::integrate::World;
use lumel::light::Lights;
use lumel::measure::measure;
use lumel::medium::Media;
use lumel::progress::Silent;
use lumel::render::{CameraChoice, LightChoice, Picture, render};
use lumel::scatter::{self, Scattering, Surfaces};
use lumel::scene::appearance::{Appearance, Dielectric, Walls};
use lumel::scene::{Camera, Light, LightShape, Material, Medium, MediumShape, Scene};
use lumel::sensor::{Film, View};
use lumel::settings::{Method, Quality, Settings};
use lumel::trace::Tracer;
use support::{Quad, atlas, bake, draft, mesh_scene, room, scene, sphere};

fn by(method: Method, samples: u32) -> Settings {
    Settings { method, samples: Some(samples), ..draft() }
}

/// A picture of 24 x 24 pixels.
fn picture(mut scene: Scene, eye: [f32; 3], target: [f32; 3], settings: &Settings) -> Film {
    scatter::adapt(&mut scene, settings.surfaces);
    let tracer = Tracer::new(&scene);
    let lights = Lights::new(&scene);
    let scattering = Scattering::new(&scene, settings.surfaces);
    let media = Media::new(&scene);
    let world = World::new(&scene, &tracer, &lights, &scattering, &media);
    let camera = Camera::look_at(eye.into(), target.into(), 1.0).unwrap();
    measure(&world, &View::new(camera, 24, 24), settings, &Silent, |_| Ok(())).unwrap()
}

/// Adds a ball of a material to a scene.
fn add_ball(scene: &mut Scene, centre: [f32; 3], radius: f32, material: Material) {
    let mut ball = mesh_scene(&[sphere(centre.into(), radius, 16, false)]);
    let (mesh, index) = (scene.meshes.len(), scene.materials.len() as u32);
    ball.meshes[0].triangle_material.fill(index);
    ball.surfaces[0].mesh = mesh;
    ball.surfaces[0].name = format!("ball {mesh}");
    scene.materials.push(material);
    scene.meshes.append(&mut ball.meshes);
    scene.surfaces.append(&mut ball.surfaces);
}

fn looking_like(appearance: Appearance) -> Material {
    Material { albedo: Rgb::ZERO, appearance: Some(appearance), ..Material::default() }
}

fn glass(roughness: f32) -> Material {
    let walls = Walls::Solid { absorption: Rgb::ZERO };
    looking_like(Appearance { transmission: 1.0, roughness, walls, ..Appearance::default() })
}

fn metal(roughness: f32) -> Material {
    looking_like(Appearance { metallic: 1.0, roughness, ..Appearance::default() })
}

/// A closed room that shines evenly: everything in it, whatever it looks like, sends out M / (1 - albedo).
fn furnace() -> Scene {
    scene(&room([2., 2., 2.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect::<Vec<_>>())
}

#[test]
fn nothing_that_absorbs_nothing_is_seen_in_a_furnace() {
    let finishes = [
        ("mirror", metal(0.0)),
        ("rough metal", metal(0.6)),
        ("glass", glass(0.0)),
        ("rough glass", glass(0.5)),
        (
            "index 1.1",
            looking_like(Appearance {
                dielectric: Dielectric { ior: 1.1, ..Dielectric::default() },
                ..Appearance::default()
            }),
        ),
    ];
    for (name, material) in finishes {
        let is_white = name != "index 1.1";
        let mut scene = furnace();
        add_ball(&mut scene, [1.0, 1.0, 0.8], 0.5, material);
        let film = picture(scene, [1.0, 1.2, 1.9], [1.0, 1.0, 0.8], &by(Method::Path, 64));
        let mean = film.mean().iter().map(|c| c.x).sum::<f32>() / film.mean().len() as f32;
        println!("{name}: {mean} +- {}", film.noise());
        // Facets bend normals away from the triangles', and what would go through them ends.
        let most = if is_white { 0.02 } else { 0.05 };
        assert!((mean / 2.0 - 1.0).abs() < most, "{name}: {mean}");
    }
}

/// Mean over what lies open of each surface.
fn surface_means(baked: &Illuminated, surfaces: u32) -> Vec<f32> {
    let mean = |s: u32| {
        let members = (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == s);
        let (sum, area) = members.fold((0.0, 0.0), |(sum, area), i| {
            let open = if baked.exposure.is_buried(i) { 0.0 } else { baked.exposure.area[i] };
            (sum + open * luminance(baked.gathered.irradiance[i]), area + open)
        });
        sum / area
    };
    (0..surfaces).map(mean).collect()
}

const CEILING: usize = 1;
const LAMP: usize = 6;

/// A room with a lamp, a shelf over the floor and a point light, all diffuse.
fn lit_room() -> Scene {
    let mut quads: Vec<Quad> = room([4., 3., 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([1.5, 2.95, 1.5], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(20.0));
    quads.push(Quad::new([0.3, 1.2, 0.4], [0., 0., 3.], [2., 0., 0.]).albedo(0.7).double_sided());
    let mut scene = scene(&quads);
    let shape = LightShape::Point { position: Vec3::new(3.5, 2.0, 3.0), intensity: Rgb::splat(3.0), range: None };
    scene.lights.push(Light::new("point", shape));
    let radiance = Rgb::new(5.0, 4.0, 3.0);
    let ball = Affine3A::from_translation(Vec3::new(0.6, 2.4, 3.2)) * Affine3A::from_scale(Vec3::splat(0.15));
    scene.lights.push(Light::new("ball", LightShape::Sphere { world_from_unit: ball, radiance }));
    let (center, u, v) = (Vec3::new(3.0, 1.5, 1.0), Vec3::new(0.0, 0.0, 0.4), Vec3::new(0.0, 0.3, 0.0));
    scene.lights.push(Light::new("panel", LightShape::Rect { center, u, v, radiance }));
    scene
}

#[test]
fn texels_of_a_diffuse_scene_get_what_radiosity_and_the_reference_say() {
    let scene = lit_room();
    let count = scene.surfaces.len();
    // Texels as fine sources; their means are the same for all.
    let radiosity = bake(&scene, &atlas(count, 32), &Settings { quality: Quality::High, ..draft() });
    let reference = bake(&scene, &atlas(count, 6), &by(Method::Path, 2048));
    // A medium that does nothing asks for walks in place of the reference.
    let mut foggy = scene.clone();
    let nothing = Medium::new("nothing", MediumShape::Scene);
    foggy.media.push(Medium { scattering: Rgb::ZERO, absorption: Rgb::splat(1e-9), ..nothing });
    let walked = bake(&foggy, &atlas(count, 6), &by(Method::Path, 2048));
    let [walked, radiosity, reference] =
        [&walked, &radiosity, &reference].map(|baked| surface_means(baked, count as u32));
    for (s, walked) in walked.iter().enumerate() {
        println!("surface {s}: {walked}, radiosity {}, reference {}", radiosity[s], reference[s]);
        assert!((walked / reference[s] - 1.0).abs() < 0.01, "surface {s}: {walked} against {}", reference[s]);
        // What of the ceiling lies open behind the lamp's back is told by texel, and these differ in size.
        let is_told = ![CEILING, LAMP].contains(&s);
        assert!(
            !is_told || (walked / radiosity[s] - 1.0).abs() < 0.01,
            "surface {s}: {walked} against {}",
            radiosity[s]
        );
    }
}

#[test]
fn rays_give_direct_light() {
    let scene = lit_room();
    let atlas = atlas(scene.surfaces.len(), 6);
    let traced = bake(&scene, &atlas, &by(Method::Ray, 256));
    let paths = bake(&scene, &atlas, &Settings { max_bounces: Some(0), ..by(Method::Path, 256) });
    let [a, b] = [&traced, &paths].map(|baked| surface_means(baked, scene.surfaces.len() as u32));
    for (s, (a, b)) in a.iter().zip(&b).enumerate() {
        // What hangs below a lamp's plane sees none of it.
        assert!((a - b).abs() < 0.01 * b.max(0.1), "surface {s}: {a} against {b}");
    }
}

#[test]
fn lamps_show_in_mirrors_and_through_glass_panes() {
    // A panel before a mirror, seen in it alone, by both methods.
    let quads = [Quad::new([-2., -2., 0.], [4., 0., 0.], [0., 4., 0.]).albedo(0.0)];
    let mut scene = scene(&quads);
    scene.materials[0] = Material { appearance: metal(0.0).appearance, ..scene.materials[0].clone() };
    let (center, u, v) = (Vec3::new(0.0, 0.0, 3.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0));
    scene.lights.push(Light::new("panel", LightShape::Rect { center, u, v, radiance: Rgb::splat(7.0) }));
    for method in [Method::Path, Method::Ray] {
        let film = picture(scene.clone(), [0.0, 0.0, 2.0], [0.0, 0.0, 0.0], &by(method, 4));
        let middle = film.mean()[12 * 24 + 12];
        assert!((middle - Rgb::splat(7.0)).abs().max_element() < 1e-3, "{method:?}: {middle}");
        assert_eq!(film.mean()[0], Rgb::ZERO, "beside it");
    }
}

#[test]
fn fog_dims_what_lies_behind_it() {
    // A lamp of 2 m over a plane, in what absorbs 0.4 / m: E(0) of a point light is I exp(-0.8) / 4.
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0)]);
    let shape = LightShape::Point { position: Vec3::new(0.0, 2.0, 0.0), intensity: Rgb::splat(4.0), range: None };
    scene.lights.push(Light::new("lamp", shape));
    let corners = (Vec3::new(-2.0, -1.0, -2.0), Vec3::new(2.0, 3.0, 2.0));
    let medium = Medium::new("smoke", MediumShape::between(corners.0, corners.1));
    scene.media.push(Medium { scattering: Rgb::ZERO, absorption: Rgb::new(0.4, 0.2, 0.0), ..medium });
    // In the middle texel, 1 cm wide.
    let baked = bake(&scene, &atlas(1, 199), &by(Method::Path, 8));
    let middle = (0..baked.patches.len())
        .min_by(|&i, &j| {
            let [a, b] = [i, j].map(|i| baked.patches.position[i].length());
            a.total_cmp(&b)
        })
        .unwrap();
    let found = baked.gathered.irradiance[middle];
    let expected = Rgb::new((-0.8f32).exp(), (-0.4f32).exp(), 1.0);
    assert!((found - expected).abs().max_element() < 1e-3, "{found} instead of {expected}");
}

#[test]
fn even_fog_in_a_furnace_is_not_seen() {
    let mut scene = furnace();
    let medium = Medium::new("fog", MediumShape::Scene);
    scene.media.push(Medium { scattering: Rgb::new(2.0, 1.0, 0.1), absorption: Rgb::ZERO, ..medium });
    let film = picture(scene, [1.0, 1.2, 1.9], [1.0, 1.0, 0.8], &by(Method::Path, 64));
    let mean = film.mean().iter().sum::<Vec3>() / film.mean().len() as f32;
    assert!((mean / 2.0 - Rgb::ONE).abs().max_element() < 0.02, "{mean}");
}

#[test]
fn the_same_bits_whatever_the_threads() {
    let mut scene = lit_room();
    add_ball(&mut scene, [2.0, 1.8, 2.5], 0.4, glass(0.2));
    let take = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| picture(scene.clone(), [3.5, 1.5, 3.5], [2.0, 1.5, 2.0], &by(Method::Path, 2)).mean())
    };
    assert_eq!(take(1), take(3));
}

#[test]
fn surfaces_can_be_taken_for_diffuse() {
    let mut scene = furnace();
    let material = Material { albedo: Rgb::splat(0.5), emission: Rgb::ONE, ..metal(0.1) };
    add_ball(&mut scene, [1.0, 1.0, 0.8], 0.5, material);
    let settings = Settings { surfaces: Surfaces::Diffuse, ..by(Method::Path, 64) };
    let film = picture(scene, [1.0, 1.2, 1.9], [1.0, 1.0, 0.8], &settings);
    let mean = film.mean().iter().map(|c| c.x).sum::<f32>() / film.mean().len() as f32;
    assert!((mean / 2.0 - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn lights_that_a_bake_leaves_out_shine_in_a_picture() {
    let folder = std::env::temp_dir().join(format!("lumel-pictures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("lamp.usda");
    let text = r#"#usda 1.0
( metersPerUnit = 1
  upAxis = "Y" )
def Mesh "floor"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
}
def SphereLight "lamp"
{
    float inputs:radius = 0.2
    float inputs:intensity = 500
    token lumel:bake = "dynamic"
    double3 xformOp:translate = (0, 2, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "above"
{
    float horizontalAperture = 20
    float verticalAperture = 10
    float focalLength = 20
    double3 xformOp:translate = (0, 1, 0)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
"#;
    std::fs::write(&file, text).unwrap();
    let output = folder.join("lamp.exr");
    let (camera, light) = (CameraChoice::First, LightChoice::Any);
    let asked = Picture { camera, width: 16, height: None, light, exposure: 0.0 };
    let taken = render(&file, &output, &by(Method::Path, 2), &asked, &Silent).unwrap();
    let png = image::open(&taken.files[1]).unwrap().to_rgb8();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!((taken.size, png.dimensions()), ([16, 8], (16, 8)), "as the camera's aperture is");
    assert!(png.pixels().all(|p| p.0[0] > 60), "the floor fills the picture, and is lit: {:?}", png.get_pixel(0, 0));
}
