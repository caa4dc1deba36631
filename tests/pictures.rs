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
use lumel::pipeline;
use lumel::progress::Silent;
use lumel::render::{CameraChoice, LightChoice, Picture, render};
use lumel::scatter::{self, Scattering, Surfaces};
use lumel::scene::appearance::{Appearance, Dielectric, Walls};
use lumel::scene::{Camera, Light, LightShape, Material, Medium, MediumShape, Projection, Scene};
use lumel::sensor::{Film, View};
use lumel::settings::{Method, Quality, Settings, SkySetting};
use lumel::trace::Tracer;
use lumel::unwrap::{Atlas, unwrap};
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
fn methods_that_know_no_media_name_those_that_do() {
    let mut scene = furnace();
    scene.media.push(Medium { scattering: Rgb::ONE, ..Medium::new("mist", MediumShape::Scene) });
    let (tracer, lights) = (Tracer::new(&scene), Lights::new(&scene));
    let (scattering, media) = (Scattering::new(&scene, Surfaces::Full), Media::new(&scene));
    let world = World::new(&scene, &tracer, &lights, &scattering, &media);
    let camera = Camera::look_at(Vec3::ONE, Vec3::ZERO, 1.0).unwrap();
    let view = View::new(camera, 2, 2);
    for method in [Method::Ray, Method::Bidirectional, Method::Metropolis] {
        let error = measure(&world, &view, &by(method, 1), &Silent, |_| Ok(())).unwrap_err().to_string();
        assert!(error.contains("mist") && error.contains("path or photon"), "{error}");
    }
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

/// A floor that fills what the first of two cameras of one name sees; the second looks away. The first has a lens and an offset, which
/// a GLB has no form for.
const WATCHED: &str = r#"#usda 1.0
( metersPerUnit = 1
  upAxis = "Y" )
def Mesh "floor"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)] ( interpolation = "constant" )
}
def Scope "a"
{
    def Camera "eye"
    {
        float horizontalAperture = 20
        float verticalAperture = 10
        float focalLength = 20
        double3 xformOp:translate = (0.1, 0.8, 0.2)
        float xformOp:rotateX = -90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
    }
}
def Scope "b"
{
    def Camera "eye"
    {
        token projection = "orthographic"
        float horizontalAperture = 30
        float verticalAperture = 10
        double3 xformOp:translate = (0, 3, 2)
        float3 xformOp:rotateXYZ = (-20, 30, 10)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }
}
"#;

/// Bakes [`WATCHED`] by `settings` in a folder of its own, and gives `judge` the scene file and the GLB.
fn with_watched(name: &str, settings: &Settings, judge: impl FnOnce(&std::path::Path, &std::path::Path)) {
    let folder = std::env::temp_dir().join(format!("lumel-pictures-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let scene = folder.join("watched.usda");
    std::fs::write(&scene, WATCHED).unwrap();
    let baked = folder.join("baked");
    pipeline::bake(&scene, &baked, settings, &Silent).unwrap();
    judge(&scene, &baked.join("watched.glb"));
    std::fs::remove_dir_all(&folder).unwrap();
}

fn watched(camera: CameraChoice, light: LightChoice) -> Picture {
    Picture { camera, width: 16, height: None, light, exposure: 0.0 }
}

#[test]
fn cameras_of_a_stage_are_in_its_glb() {
    let sky = Some(SkySetting::Constant([1.0; 3]));
    with_watched("cameras", &Settings { sky, ..draft() }, |scene, glb| {
        let [of_stage, of_glb] = [scene, glb].map(|file| lumel::load::load(file).unwrap().scene.cameras);
        assert_eq!((of_stage.len(), of_glb.len()), (2, 2));
        for (a, b) in of_stage.iter().zip(&of_glb) {
            assert_eq!(a.name, b.name);
            assert!(a.position.distance(b.position) < 1e-6);
            assert!(a.world_from_camera.abs_diff_eq(b.world_from_camera, 1e-5), "{b:?}");
            assert!((a.aspect.unwrap() - b.aspect.unwrap()).abs() < 1e-5, "{b:?}");
            let half = |camera: &Camera| match camera.projection {
                Projection::Perspective { half_height, .. } => (0, half_height),
                Projection::Orthographic { half_height } => (1, half_height),
            };
            assert!(half(a).0 == half(b).0 && (half(a).1 - half(b).1).abs() < 1e-5, "{b:?}");
        }
        let output = scene.with_file_name("a.exr");
        let named = watched(CameraChoice::Named("eye".into()), LightChoice::Any);
        let taken = render(glb, &output, &by(Method::Path, 1), &named, &Silent).unwrap();
        let said: Vec<&str> = taken.warnings.iter().map(|w| w.message.as_str()).collect();
        assert!(
            said.iter().any(|m| m.starts_with("2 cameras have this name") && m.contains("/a/eye was taken")),
            "{said:?}"
        );
        let whole = watched(CameraChoice::Named("/b/eye".into()), LightChoice::Any);
        let taken = render(glb, &output, &by(Method::Path, 1), &whole, &Silent).unwrap();
        assert!(!taken.warnings.iter().any(|w| w.message.contains("have this name")), "a whole name is one camera's");
    });
}

#[test]
fn the_sky_of_a_bake_lights_pictures_of_its_glb() {
    let sky = Some(SkySetting::Constant([4.0, 2.0, 1.0]));
    with_watched("sky", &Settings { sky, ..draft() }, |scene, glb| {
        let output = scene.with_file_name("a.exr");
        for light in [LightChoice::Traced, LightChoice::Gathered] {
            let taken =
                render(glb, &output, &by(Method::Path, 64), &watched(CameraChoice::First, light), &Silent).unwrap();
            assert_eq!(taken.size, [16, 8]);
            assert!(taken.warnings.iter().all(|w| !w.message.contains("sky")), "{:?}", taken.warnings);
            let (mean, expected) = (mean_of(&output), Rgb::new(2.0, 1.0, 0.5));
            assert!((mean / expected - Rgb::ONE).abs().max_element() < 0.03, "{light:?}: {mean}");
        }
        let asked = Settings { sky: Some(SkySetting::Constant([1.0; 3])), ..by(Method::Path, 64) };
        render(glb, &output, &asked, &watched(CameraChoice::First, LightChoice::Traced), &Silent).unwrap();
        assert!((mean_of(&output) / 0.5 - Rgb::ONE).abs().max_element() < 0.03, "a sky that is given comes first");
    });
}

#[test]
fn a_sky_that_a_glb_cannot_hold_is_named() {
    let settings =
        Settings { sky: Some(SkySetting::Clear { turbidity: 3.0 }), sun: Some([40.0, 180.0, 1e5]), ..draft() };
    with_watched("clear-sky", &settings, |scene, glb| {
        let output = scene.with_file_name("a.exr");
        let said = |light: LightChoice| {
            let taken = render(glb, &output, &by(Method::Path, 1), &watched(CameraChoice::First, light), &Silent);
            taken.unwrap().warnings.iter().map(|w| w.message.clone()).collect::<Vec<_>>().join("; ")
        };
        let traced = said(LightChoice::Traced);
        assert!(
            traced.contains("(--sky clear) isn't in the file") && traced.contains("give it with --sky"),
            "{traced}"
        );
        assert!(said(LightChoice::Gathered).contains("(--sky clear) isn't in the file"));
        assert!(!said(LightChoice::Any).contains("isn't in the file"), "the lightmaps hold its light");
    });
}

/// An atlas of one page.
fn unwrapped(scene: &Scene, resolution: u32) -> Atlas {
    let settings = Settings { resolution: Some(resolution), ..draft() };
    unwrap(scene, &settings.unwrap_params(), &Silent).unwrap().0
}

/// The mean of a picture.
fn mean_of(exr: &std::path::Path) -> Rgb {
    let picture = image::open(exr).unwrap().to_rgb32f();
    let sum: Rgb = picture.pixels().map(|p| Rgb::from(p.0)).sum();
    sum / (picture.width() * picture.height()) as f32
}

#[test]
fn caustics_lose_no_light_on_glass_and_mirrors() {
    // A large ball in a closed room, which sends on what comes to it off the walls, too.
    let mut quads: Vec<Quad> = room([2., 2., 2.]).into_iter().map(|q| q.albedo(0.75)).collect();
    quads.push(Quad::new([0.6, 1.98, 0.6], [0.8, 0., 0.], [0., 0., 0.8]).albedo(0.0).emission(10.0));
    for (name, mut look) in [("glass", glass(0.0)), ("mirror", metal(0.0))] {
        if name == "mirror" {
            // As readers have metals: their base colour stands in.
            look.albedo = Rgb::ONE;
        }
        let mut scene = scene(&quads);
        add_ball(&mut scene, [1.0, 0.8, 1.0], 0.6, look);
        let mut lit_by_sky = scene.clone();
        lit_by_sky.environment = Some(lumel::scene::Environment::constant("sky", Rgb::splat(1e-6)));
        let radiosity = |mut scene: Scene| {
            scatter::adapt_for_caustics(&mut scene);
            let settings = Settings { caustics: true, quality: Quality::Medium, ..draft() };
            bake(&scene, &unwrapped(&scene, 160), &settings)
        };
        let (found, black) = (radiosity(scene.clone()), radiosity(lit_by_sky));
        let mut traced = scene.clone();
        scatter::adapt(&mut traced, Surfaces::Full);
        let reference = bake(&traced, &unwrapped(&traced, 48), &by(Method::Path, 512));
        // The walls, floor and ceiling.
        let mean = |baked: &Illuminated| surface_means(baked, 6).iter().sum::<f32>() / 6.0;
        let [off, off_black] = [&found, &black].map(|baked| mean(baked) / mean(&reference) - 1.0);
        let (balance, lost) = (&found.energy, black.energy.lost_share());
        println!("{name}: {off:+.4}, black {off_black:+.4}, imbalance {:+.4}, lost {lost:.4}", balance.imbalance);
        assert!(off.abs() < 0.02, "{name}: {off}");
        assert!(balance.imbalance.abs() < 0.02 && black.energy.imbalance.abs() < 0.02, "{name}: {balance:?}");
        assert_eq!(balance.lost_share(), 0.0, "{name}");
        // Nothing is hidden where they are black: what is lost is told, about as much as the walls lack.
        assert!(off_black < -0.03 && lost > 0.03, "{name}: {off_black}, {lost}");
    }
}
