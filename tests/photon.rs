//! Photon mapping against answers known on paper, against paths, and caustics beside radiosity.

mod support;

use glam::Vec3;
use lumel::color::{Rgb, luminance};
use lumel::integrate::emit::Sources;
use lumel::integrate::photon::{PhotonParams, Photons, caustics};
use lumel::integrate::{Integrator, Pixelwise, Walk, World};
use lumel::light::Lights;
use lumel::medium::Media;
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, rasterize};
use lumel::progress::Silent;
use lumel::sample::{Drawn, sequence::Stage};
use lumel::scatter::{self, Scattering, Surfaces};
use lumel::scene::{Appearance, Camera, Light, LightShape, Linked, Material, Medium, MediumShape, Scene, Walls};
use lumel::sensor::{Film, Sensor, Texels, View};
use lumel::settings::{Method, Settings};
use lumel::trace::Tracer;
use lumel::unwrap::Atlas;
use std::f64::consts::PI;
use support::{Quad, atlas, bake, draft, measure, mesh_scene, room, scene, sphere, triangles};

fn with_world<T>(scene: &Scene, act: impl FnOnce(&World) -> T) -> T {
    let (tracer, lights) = (Tracer::new(scene), Lights::new(scene));
    let (scattering, media) = (Scattering::new(scene, Surfaces::Full), Media::new(scene));
    act(&World::new(scene, &tracer, &lights, &scattering, &media))
}

fn with_texels<T>(scene: &Scene, atlas: &Atlas, act: impl FnOnce(&World, &Texels) -> T) -> T {
    with_world(scene, |world| {
        let patches = rasterize(scene, atlas, world.tracer.triangles(), &Silent).unwrap();
        let ground = Ground { scene, atlas, tracer: world.tracer, patches: &patches };
        let exposure = unocclude(&ground, 0, &Silent).unwrap();
        act(world, &Texels { ground: &ground, exposure: &exposure, shading_normals: false })
    })
}

fn expose(mut method: impl Integrator, sensor: &dyn Sensor, passes: u64) -> Film {
    let mut film = Film::new(sensor.len());
    while film.passes() < passes {
        method.pass(&mut film, &Silent).unwrap();
    }
    film
}

fn photons(world: &World, sensor: &dyn Sensor, params: PhotonParams, passes: u64) -> Film {
    expose(Photons::new(world, sensor, params).unwrap(), sensor, passes)
}

fn paths(world: &World, sensor: &dyn Sensor, passes: u64) -> Film {
    expose(Pixelwise { world, sensor, method: Walk::Path, max_bounces: None, seed: 5 }, sensor, passes)
}

/// Mean luminance of a film and the standard error that its passes tell.
fn mean(film: &Film) -> (f64, f64) {
    let n = film.mean().len() as f64;
    let sum: f64 = film.mean().iter().map(|v| f64::from(luminance(*v))).sum();
    let squares: f64 = film.standard_error().iter().map(|e| f64::from(*e).powi(2)).sum();
    (sum / n, squares.sqrt() / n)
}

/// Mean irradiance of each surface.
fn surface_means(texels: &Texels, film: &Film) -> Vec<f64> {
    let (patches, values) = (texels.ground.patches, film.mean());
    let count = (0..patches.len()).map(|i| patches.surface(i)).max().unwrap() + 1;
    let of = |s: u32| {
        let own = (0..patches.len()).filter(|&i| patches.surface(i) == s);
        let (light, area) = own.fold((0.0, 0.0), |(light, area), i| {
            let a = f64::from(texels.exposure.area[i]);
            (light + a * f64::from(luminance(values[i])), area + a)
        });
        light / area
    };
    (0..count).map(of).collect()
}

fn glass() -> Material {
    let walls = Walls::Solid { absorption: Rgb::ZERO };
    let appearance = Some(Appearance { transmission: 1.0, walls, ..Appearance::default() });
    Material { appearance, albedo: Rgb::ZERO, ..Material::default() }
}

fn mirror() -> Material {
    let appearance = Some(Appearance { metallic: 1.0, base_color: Rgb::splat(0.9), ..Appearance::default() });
    Material { appearance, albedo: Rgb::splat(0.9), double_sided: true, ..Material::default() }
}

/// A black-backed floor below a lamp of flux pi [lm], with what `third` holds, of `material`, between.
fn below_a_lamp(third: Vec<[Vec3; 3]>, material: Material, side: f32) -> Scene {
    let (corner, half) = ([0.3 - 0.5 * side, 1.95, -0.5 * side], 1.0);
    let floor = Quad::new([-half, 0., -half], [0., 0., 2.], [2., 0., 0.]);
    let lamp = Quad::new(corner, [side, 0., 0.], [0., 0., side]);
    let mut scene = mesh_scene(&[triangles(&floor), triangles(&lamp), third]);
    let emission = Rgb::splat(1.0 / (side * side));
    scene.materials = vec![
        Material { albedo: Rgb::splat(0.5), ..Material::default() },
        Material { albedo: Rgb::ZERO, emission, ..Material::default() },
        material,
    ];
    for (mesh, material) in scene.meshes.iter_mut().zip(0..) {
        mesh.triangle_material.fill(material);
    }
    scene
}

/// A smooth ball of glass over the floor, and a view of the light that it gathers.
fn ball_of_glass() -> (Scene, View) {
    let middle = Vec3::new(0.0, 0.55, 0.0);
    let mut scene = below_a_lamp(sphere(middle, 0.3, 16, false), glass(), 0.3);
    let ball = &mut scene.meshes[2];
    ball.normals = ball.positions.iter().map(|p| (*p - middle).normalize()).collect();
    let camera = Camera::look_at(Vec3::new(-0.118, 0.35, 0.9), Vec3::new(-0.118, 0.0, 0.0), 0.3);
    (scene, View::new(camera.unwrap(), 12, 12))
}

/// A ring of mirrors on the floor, and a view into it.
fn ring_of_mirrors() -> (Scene, View) {
    let at = |k: u32, y: f32| {
        let turn = std::f32::consts::TAU * (k % 32) as f32 / 32.0;
        Vec3::new(0.5 * turn.cos(), y, 0.5 * turn.sin())
    };
    let wall = |k: u32| {
        let [a, b, c, d] = [at(k, 0.01), at(k + 1, 0.01), at(k + 1, 0.4), at(k, 0.4)];
        [[a, b, c], [a, c, d]]
    };
    let scene = below_a_lamp((0..32).flat_map(wall).collect(), mirror(), 0.3);
    let camera = Camera::look_at(Vec3::new(0.0, 1.5, 0.01), Vec3::ZERO, 0.4);
    (scene, View::new(camera.unwrap(), 12, 12))
}

fn fog(scattering: f32, absorption: f32) -> Medium {
    Medium {
        name: "fog".into(),
        shape: MediumShape::Scene,
        density: 1.0,
        scattering: Rgb::splat(scattering),
        absorption: Rgb::splat(absorption),
        emission: Rgb::ZERO,
        anisotropy: 0.0,
        grid: None,
    }
}

#[test]
fn what_sets_out_is_the_power_of_the_lights() {
    let mut scene = scene(&room([2., 2., 2.]));
    let power = |shape: LightShape, power: f64| (shape, power);
    let position = Vec3::ONE;
    let ball = glam::Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), glam::Quat::IDENTITY, position);
    let cone = |inner: f64, outer: f64| {
        // The ramp of squared shares of the cosine from inner to outer, by its integral: a third of the step.
        2.0 * PI * (1.0 - inner.cos() + (inner.cos() - outer.cos()) / 3.0)
    };
    let (inner, outer, direction) = (0.3, 0.7, Vec3::NEG_Y);
    let intensity = Rgb::splat(3.0);
    let (u, v) = (Vec3::X * 0.2, Vec3::Z * 0.3);
    let each = [
        power(LightShape::Point { position, intensity, range: None }, 12.0 * PI),
        power(
            LightShape::Spot { position, direction, intensity, inner, outer, range: None },
            3.0 * cone(f64::from(inner), f64::from(outer)),
        ),
        power(LightShape::Rect { center: position, u, v, radiance: Rgb::splat(5.0) }, 5.0 * PI * 0.24),
        power(LightShape::Sphere { world_from_unit: ball, radiance: Rgb::splat(2.0) }, 2.0 * PI * 4.0 * PI * 0.04),
    ];
    for (shape, power) in each {
        scene.lights = vec![Light::new("lamp", shape)];
        with_world(&scene, |world| {
            let sources = Sources::new(world);
            let n = 1 << 14;
            let flux =
                |k: u64| sources.emit(world, &mut Drawn::new(1, Stage::Photon, 0, k)).map_or(Rgb::ZERO, |e| e.flux);
            let sum: f64 = (0..n).map(|k| f64::from(flux(k).y)).sum();
            let found = sum / n as f64;
            assert!((found / power - 1.0).abs() < 0.005, "{found} lm of {power}: {:?}", scene.lights[0].shape);
        });
    }
}

#[test]
fn a_closed_furnace_is_even_but_for_what_edges_lose() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    let expected = 2.0 * PI;
    let off = |radius: f32| {
        with_texels(&scene(&quads), &atlas(6, 8), |world, texels| {
            let params = PhotonParams { photons: Some(1 << 15), radius: Some(radius), ..PhotonParams::default() };
            let means = surface_means(texels, &photons(world, texels, params, 16));
            means.iter().sum::<f64>() / means.len() as f64 / expected - 1.0
        })
    };
    let (wide, narrow) = (off(0.3), off(0.05));
    println!("{:+.2} % at 0.3 m, {:+.2} % at 0.05 m", 100.0 * wide, 100.0 * narrow);
    // Discs over an edge of a wall are up to a half empty.
    assert!(narrow.abs() < 0.01 && wide < 0.01 && wide.abs() < 0.05, "{wide} {narrow}");
    assert!(wide < narrow - 0.005, "the bias doesn't shrink with the radius: {wide} {narrow}");
}

#[test]
fn light_under_a_point_is_as_on_paper_in_air_and_fog() {
    let quads = [Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0)];
    let position = Vec3::new(0.0, 1.5, 0.0);
    for sigma in [0.0, 0.7] {
        let mut scene = scene(&quads);
        scene
            .lights
            .push(Light::new("lamp", LightShape::Point { position, intensity: Rgb::splat(100.0), range: None }));
        if sigma > 0.0 {
            let world_from_unit = glam::Affine3A::from_translation(Vec3::new(-5., -1., -5.))
                * glam::Affine3A::from_scale(Vec3::new(10., 10., 10.));
            scene.media.push(Medium { shape: MediumShape::Box { world_from_unit }, ..fog(0.0, sigma) });
        }
        with_texels(&scene, &atlas(1, 16), |world, texels| {
            let film = photons(world, texels, PhotonParams { photons: Some(1000), ..PhotonParams::default() }, 16);
            for (value, at) in film.mean().iter().zip(&texels.ground.patches.position) {
                let way = position - *at;
                let t = way.length();
                let expected = 100.0 * way.y / t.powi(3) * (-sigma * t).exp();
                let off = value.x / expected - 1.0;
                assert!(off.abs() < 0.02, "sigma {sigma}: {} of {expected}", value.x);
            }
        });
    }
}

#[test]
fn rooms_agree_with_paths_within_a_bias_that_shrinks() {
    let case = measure::room_with_a_shelf(8);
    with_texels(&case.scene, &case.atlas, |world, texels| {
        let truth = surface_means(texels, &paths(world, texels, 512));
        let worst = |radius: f32| {
            let params = PhotonParams { photons: Some(1 << 16), radius: Some(radius), ..PhotonParams::default() };
            let means = surface_means(texels, &photons(world, texels, params, 32));
            let off = |(a, b): (&f64, &f64)| (a / b - 1.0).abs();
            // The lamp's own face is lit by what comes back to it alone, and small.
            means.iter().zip(&truth).map(off).fold(0.0, f64::max)
        };
        let (wide, narrow) = (worst(0.5), worst(0.08));
        println!("{:.2} % at 0.5 m, {:.2} % at 0.08 m", 100.0 * wide, 100.0 * narrow);
        assert!(narrow < 0.02 && wide < 0.12 && narrow < wide, "{wide} {narrow}");
    });
}

#[test]
fn light_that_glass_and_mirrors_gather_is_that_of_paths() {
    for (name, (scene, view)) in [("glass", ball_of_glass()), ("mirrors", ring_of_mirrors())] {
        with_world(&scene, |world| {
            let (truth, noise) = mean(&paths(world, &view, 2048));
            let params = PhotonParams { photons: Some(1 << 14), ..PhotonParams::default() };
            let (found, more) = mean(&photons(world, &view, params, 16));
            println!("{name}: {found:.4} +- {more:.4} of {truth:.4} +- {noise:.4}");
            let error = noise.hypot(more);
            assert!((found - truth).abs() < 4.0 * error + 0.01 * truth, "{name}: {found} of {truth} +- {error}");
            assert!(error < 0.05 * truth, "{name}: {error} of {truth} tells nothing");
        });
    }
}

#[test]
fn what_fog_scatters_is_that_of_paths() {
    let mut quads: Vec<Quad> = room([2., 2., 2.]).into_iter().map(|q| q.albedo(0.5)).collect();
    quads.push(Quad::new([0.7, 1.95, 0.7], [0.6, 0., 0.], [0., 0., 0.6]).albedo(0.0).emission(10.0));
    let mut scene = scene(&quads);
    scene.media.push(fog(0.4, 0.2));
    let camera = Camera::look_at(Vec3::new(1.0, 1.0, 0.05), Vec3::new(1.0, 0.9, 2.0), 1.2).unwrap();
    let view = View::new(camera, 8, 8);
    with_world(&scene, |world| {
        let (truth, noise) = mean(&paths(world, &view, 4096));
        let params = PhotonParams { photons: Some(1 << 14), ..PhotonParams::default() };
        let (found, more) = mean(&photons(world, &view, params, 64));
        println!("{found:.4} +- {more:.4} of {truth:.4} +- {noise:.4}");
        let error = noise.hypot(more);
        assert!((found - truth).abs() < 4.0 * error + 0.02 * truth, "{found} of {truth} +- {error}");
    });
}

#[test]
fn light_of_every_lamp_over_a_mirror_is_as_on_paper() {
    // A level mirror of 2 x 2 m below a wide ceiling; where the sun stands, it comes in past the ceiling's edge.
    let floor = Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]);
    let ceiling = Quad::new([-1., 2., -30.], [60., 0., 0.], [0., 0., 60.]).albedo(0.0);
    let over_all = Quad::new([-30., 2., -30.], [60., 0., 0.], [0., 0., 60.]).albedo(0.0);
    let height = 0.8f32;
    let position = Vec3::new(0.0, height, 0.0);
    let ball = glam::Affine3A::from_scale_rotation_translation(Vec3::splat(0.1), glam::Quat::IDENTITY, position);
    let h = f64::from(height);
    let solid_angle = 4.0 * (1.0 / (h * (2.0 + h * h).sqrt())).atan();
    let slope = (1.0 + h * h).sqrt();
    let factor = 4.0 / PI / slope * slope.recip().atan();
    let direction = Vec3::new(1.0, -1.0, 0.0).normalize();
    let sun = LightShape::Directional { direction, illuminance: Rgb::splat(10.0), angle: 0.0 };
    let (u, v) = (Vec3::X * 0.01, Vec3::NEG_Z * 0.01);
    let cases = [
        (LightShape::Point { position, intensity: Rgb::splat(100.0), range: None }, 100.0 * solid_angle),
        (LightShape::Sphere { world_from_unit: ball, radiance: Rgb::splat(1000.0) }, 10.0 * PI * solid_angle),
        (LightShape::Rect { center: position, u, v, radiance: Rgb::splat(1e5) }, 1e5 * PI * 4e-4 * factor),
        (sun, 40.0 * 0.5f64.sqrt()),
    ];
    for (shape, onto) in cases {
        let is_sun = matches!(shape, LightShape::Directional { .. });
        let mut scene = scene(&[floor, if is_sun { ceiling } else { over_all }]);
        scene.materials[0] = mirror();
        scene.lights.push(Light::new("lamp", shape));
        with_texels(&scene, &atlas(2, 4), |world, texels| {
            let found = caustics(world, texels, 1 << 19, 3, &Silent).unwrap().flux.x / onto;
            println!("{found:.4} of what comes to the mirror: {:?}", scene.lights[0].shape);
            // Schlick: from 0.9 head-on to 0.92 seen from the corners.
            assert!((found / 0.903 - 1.0).abs() < 0.01, "{found}: {:?}", scene.lights[0].shape);
        });
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let (mut scene, view) = ball_of_glass();
    scene.media.push(fog(0.2, 0.1));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            with_world(&scene, |world| {
                let params = PhotonParams { photons: Some(5000), seed: 3, ..PhotonParams::default() };
                photons(world, &view, params, 2).mean()
            })
        })
    };
    let bits = |film: Vec<Rgb>| film.iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(run(1)), bits(run(2)));
}

#[test]
fn caustics_are_added_to_radiosity_once() {
    // A level mirror that throws the light of a lamp at a wall on to the ceiling; all of it stands for itself.
    let floor = Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]);
    let ceiling = Quad::new([-1., 2., -1.], [2., 0., 0.], [0., 0., 2.]).albedo(0.5);
    let mut scene = scene(&[floor, ceiling]);
    scene.materials[0] = mirror();
    let intensity = Rgb::splat(100.0);
    let position = Vec3::new(0.2, 1.0, 0.1);
    scene.lights.push(Light::new("lamp", LightShape::Point { position, intensity, range: None }));
    let atlas = atlas(2, 8);
    let plain = bake(&scene, &atlas, &draft());
    let mut adapted = scene.clone();
    scatter::adapt_for_caustics(&mut adapted);
    assert_eq!(adapted.materials[0].albedo, Rgb::ZERO, "a mirror would reflect as a diffuse surface, too");
    let settings = Settings { caustics: true, ..draft() };
    let lit = bake(&adapted, &atlas, &settings);
    let image = Vec3::new(position.x, -position.y, position.z);
    let mut off = 0.0f64;
    let mut of = 0.0f64;
    for i in (0..lit.patches.len()).filter(|&i| lit.patches.surface(i) == 1) {
        let from = |at: Vec3| {
            let way = at - lit.patches.position[i];
            100.0 * way.y.abs() / way.length().powi(3)
        };
        // Nearly head-on a metal of base colour 0.9 reflects by 0.9, Schlick's rise aside.
        let way = (lit.patches.position[i] - image).normalize();
        let share = 0.9 + 0.1 * (1.0 - way.y).powi(5);
        let expected = from(position) + share * from(image);
        off += f64::from(lit.gathered.irradiance[i].x - expected);
        of += f64::from(expected);
    }
    println!("{:+.3} % on the ceiling", 100.0 * off / of);
    assert!((off / of).abs() < 0.01, "{off} of {of}");
    assert!(plain.direct.shown[0] == lit.direct.shown[0], "the mirror itself gets what it got");
    let mixed = Settings { method: Method::Photon, caustics: true, ..draft() };
    assert!(mixed.check().unwrap_err().to_string().contains("caustics"));
}

#[test]
fn what_photons_cannot_follow_is_refused_by_name() {
    let quads = room([2., 2., 2.]);
    let refused = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene(&quads);
        let lamp = LightShape::Point { position: Vec3::ONE, intensity: Rgb::ONE, range: None };
        scene.lights.push(Light::new("lamp over the desk", lamp));
        change(&mut scene);
        with_texels(&scene, &atlas(6, 4), |world, texels| {
            let result = Photons::new(world, texels, PhotonParams::default());
            result.err().map(|error| error.to_string()).unwrap_or_default()
        })
    };
    assert_eq!(refused(&|_| ()), "");
    let linked = refused(&|scene| scene.lights[0].links.lit = Linked::only(vec![true, false, true, true, true, true]));
    assert!(linked.contains("lamp over the desk") && linked.contains("path"), "{linked}");
    let glowing = refused(&|scene| scene.media.push(Medium { emission: Rgb::ONE, ..fog(0.1, 0.1) }));
    assert!(glowing.contains("fog"), "{glowing}");
    let sky = std::sync::Arc::new(lumel::scene::Environment::constant("sky", Rgb::ONE));
    let shape = LightShape::Portal { center: Vec3::ONE, u: Vec3::X * 0.1, v: Vec3::Z * 0.1, sky };
    let portal = refused(&|scene| scene.lights.push(Light::new("window", shape.clone())));
    assert!(portal.contains("window"), "{portal}");
    let scene = scene(&quads);
    with_texels(&scene, &atlas(6, 4), |world, texels| {
        for params in [
            PhotonParams { radius: Some(0.0), ..PhotonParams::default() },
            PhotonParams { radius: Some(f32::NAN), ..PhotonParams::default() },
            PhotonParams { photons: Some(0), ..PhotonParams::default() },
        ] {
            assert!(Photons::new(world, texels, params).is_err(), "{params:?}");
        }
        assert!(caustics(world, texels, 1, 0, &Silent).unwrap().irradiance.iter().all(|e| *e == Rgb::ZERO));
    });
}
