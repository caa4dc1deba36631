//! The path tracer against answers known on paper, against the radiosity bake, and against its own standard error.

mod support;

use glam::{Affine3A, DVec3, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::illuminate::Illuminated;
use lumel::light::{Lights, Lit};
use lumel::patch::reflectance::reflectance;
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, Patches, rasterize};
use lumel::progress::Silent;
use lumel::reference::{BATCHES, PathParams, Strategy, Traced, trace};
use lumel::scene::{Environment, Light, LightShape, Scene, Shaping, Texels, Texture, TextureSlot, UvSet};
use lumel::settings::{Gather, Method, Quality, Settings};
use lumel::trace::Tracer;
use lumel::unwrap::Atlas;
use std::f32::consts::PI;
use support::{Quad, atlas, bake, bake_quads, draft, room, scene};

fn params(samples: u32) -> PathParams {
    PathParams { samples, max_bounces: None, shading_normals: false, strategy: Strategy::Combined, seed: 0 }
}

fn traced(scene: &Scene, atlas: &Atlas, params: &PathParams) -> (Traced, Patches) {
    let tracer = Tracer::new(scene);
    let patches = rasterize(scene, atlas, tracer.triangles(), &Silent).unwrap();
    let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
    let (reflectance, emission) = &reflectance(&ground, &Silent).unwrap();
    let exposure = &unocclude(&ground, 0, &Silent).unwrap();
    let lights = &Lights::new(scene);
    let direct = draft().direct_params();
    let lit = Lit { ground: &ground, exposure, reflectance, emission, lights, params: &direct, known: None };
    (trace(&lit, params, &Silent).unwrap(), patches)
}

fn paths() -> Settings {
    Settings { method: Method::Path, samples: Some(256), ..draft() }
}

/// Mean and root mean square of `(value - truth) / error` where there is an error.
fn z_scores(values: impl Iterator<Item = (f64, f64, f64)>) -> (f64, f64) {
    let z: Vec<f64> = values.filter(|v| v.2 > 0.0).map(|(value, truth, error)| (value - truth) / error).collect();
    let n = z.len() as f64;
    (z.iter().sum::<f64>() / n, (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt())
}

/// Root mean square of a t-distributed number: what z scores by a standard error of so few batches come to.
fn expected_spread() -> f64 {
    let freedom = f64::from(BATCHES - 1);
    (freedom / (freedom - 2.0)).sqrt()
}

/// A room lit by a lamp in the ceiling, with a double-sided shelf that keeps it from half of the floor.
fn room_with_shelf() -> Vec<Quad> {
    let mut quads: Vec<Quad> = room([4., 3., 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([1.5, 2.95, 1.5], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(20.0));
    quads.push(Quad::new([0.3, 1.2, 0.4], [0., 0., 3.], [2., 0., 0.]).albedo(0.7).double_sided());
    quads
}

/// Mean irradiance of each surface (channel by channel).
fn surface_means(patches: &Patches, irradiance: &[Rgb]) -> Vec<DVec3> {
    let count = (0..patches.len()).map(|i| patches.surface(i)).max().unwrap() + 1;
    let mean = |s: u32| {
        let members: Vec<usize> = (0..patches.len()).filter(|&i| patches.surface(i) == s).collect();
        let area: f64 = members.iter().map(|&i| f64::from(patches.area[i])).sum();
        members.iter().map(|&i| irradiance[i].as_dvec3() * f64::from(patches.area[i])).sum::<DVec3>() / area
    };
    (0..count).map(mean).collect()
}

fn assert_means_agree(name: &str, test: &Illuminated, reference: &Illuminated, most: f64) {
    let [a, b] = [test, reference].map(|b| surface_means(&b.patches, &b.gathered.irradiance));
    for (s, (a, b)) in a.iter().zip(&b).enumerate().filter(|(_, (_, b))| b.max_element() > 0.0) {
        let off = ((*a - *b) / b.max_element()).abs().max_element();
        println!("{name}, surface {s}: {:+.3} % of {:.4}", 100.0 * off, b.y);
        assert!(off < most, "{name}, surface {s}: {a} against {b}");
    }
}

#[test]
fn furnace_is_uniform() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    let (scene, atlas) = (scene(&quads), atlas(6, 12));
    let expected = f64::from(PI) / (1.0 - 0.5);
    for strategy in [Strategy::Combined, Strategy::Hemisphere] {
        let (found, patches) = traced(&scene, &atlas, &PathParams { strategy, ..params(512) });
        assert!(found.landed_share.iter().all(|s| *s == 1.0), "rays slipped out of a closed box");
        let each = || found.irradiance.iter().zip(&found.standard_error).map(|(e, s)| (f64::from(e.x), f64::from(s.x)));
        let mean = each().map(|(e, _)| e).sum::<f64>() / patches.len() as f64;
        assert!((mean / expected - 1.0).abs() < 0.001, "{strategy:?}: {mean} against {expected}");
        let far = each().filter(|(e, s)| (e - expected).abs() > (4.0 * s).max(0.005 * expected)).count();
        let worst = each().map(|(e, _)| (e / expected - 1.0).abs()).fold(0.0, f64::max);
        let (mean, spread) = z_scores(each().map(|(e, s)| (e, expected, s)));
        println!("{strategy:?}: worst {:.3} %, z {mean:+.3}, spread {spread:.3}, {far} beyond 4", 100.0 * worst);
        // Of a t-distribution with seven degrees of freedom half a percent lies beyond 4; roulette is less even than that.
        assert!(far as f64 <= 0.04 * patches.len() as f64, "{strategy:?}: {far}");
        assert!(mean.abs() < 0.2 && (spread / expected_spread() - 1.0).abs() < 0.2, "{strategy:?}: {mean} {spread}");
    }
}

#[test]
fn point_light_over_a_floor() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    let position = Vec3::new(0.0, 1.5, 0.0);
    scene.lights.push(light(LightShape::Point { position, intensity: Rgb::new(100., 50., 25.), range: None }));
    let (found, patches) = traced(&scene, &atlas(1, 32), &params(64));
    let mean_over_texel = |centre: Vec3| {
        let at = |k: usize| (k as f32 + 0.5) / 8.0 - 0.5;
        let cells = (0..64).map(|k| {
            let way = position - centre - Vec3::new(at(k % 8), 0.0, at(k / 8)) * (2.0 / 32.0);
            f64::from(100.0 * way.y / way.length().powi(3))
        });
        cells.sum::<f64>() / 64.0
    };
    let each = || {
        (0..patches.len()).map(|i| {
            let e = found.irradiance[i];
            assert!((e.y / e.x - 0.5).abs() < 1e-5);
            (f64::from(e.x), mean_over_texel(patches.position[i]), f64::from(found.standard_error[i].x))
        })
    };
    assert!(each().all(|(e, truth, _)| (e / truth - 1.0).abs() < 0.005));
    let (mean, spread) = z_scores(each());
    println!("z {mean:+.3}, spread {spread:.3}");
    assert!(mean.abs() < 0.2 && (spread / expected_spread() - 1.0).abs() < 0.25, "{mean} {spread}");
}

#[test]
fn the_standard_error_is_honest() {
    // Real noise: one bright wall, light over many bounces, a shelf in between.
    let quads = room_with_shelf();
    let (scene, atlas) = (scene(&quads), atlas(quads.len(), 8));
    let (few, _) = traced(&scene, &atlas, &params(64));
    let (many, _) = traced(&scene, &atlas, &PathParams { seed: 1, ..params(2048) });
    let each = || {
        (0..few.irradiance.len()).map(|i| {
            let errors = [&few, &many].map(|t| f64::from(t.standard_error[i].x));
            (f64::from(few.irradiance[i].x), f64::from(many.irradiance[i].x), errors[0].hypot(errors[1]))
        })
    };
    let (mean, spread) = z_scores(each());
    let (off, square) = each().fold((0.0, 0.0), |(o, s), (a, b, error)| (o + a - b, s + error * error));
    println!("z {mean:+.3}, spread {spread:.3}; of the sum {:+.3}", off / square.sqrt());
    // Few paths are skewed: where they found little they think little of their error, so the mean is below 0, but not the sum.
    assert!(off.abs() < 4.0 * square.sqrt(), "{off} {square}");
    assert!(mean.abs() < 0.3 && (spread / expected_spread() - 1.0).abs() < 0.2, "{mean} {spread}");
}

#[test]
fn room_with_a_shelf_agrees_with_radiosity_and_keeps_its_energy() {
    let quads = room_with_shelf();
    let by_paths = bake_quads(&quads, 16, &paths());
    println!("{:?}", by_paths.energy);
    assert!(by_paths.energy.imbalance.abs() < 0.005, "{}", by_paths.energy.imbalance);
    assert!(by_paths.energy.absorbed_by_backs[0] > 0.0);
    let medium = Settings { quality: Quality::Medium, ..draft() };
    let by_elements = bake_quads(&quads, 16, &Settings { gather: Gather::Final, ..medium.clone() });
    assert_means_agree("elements", &by_elements, &by_paths, 0.01);
    let by_blocks = bake_quads(&quads, 16, &Settings { error: Some(1.0), ..medium });
    assert_means_agree("blocks", &by_blocks, &by_paths, 0.01);
}

fn light(shape: LightShape) -> Light {
    Light::new("light", shape)
}

/// A picture, bright in one place.
fn picture(brightest: f32) -> Texture {
    let mut texels = vec![[0.2f32, 0.3, 0.5, 1.0]; 32 * 16];
    for (x, y) in (8..11).flat_map(|y| (20..24).map(move |x| (x, y))) {
        texels[y * 32 + x] = [brightest, 0.8 * brightest, 0.4 * brightest, 1.0];
    }
    Texture { name: "picture".into(), width: 32, height: 16, texels: Texels::Float(texels) }
}

fn picture_sky(scene: &mut Scene) {
    scene.textures.push(picture(50.0));
    let mut environment = Environment::constant("sky", Rgb::ONE);
    environment.texture = Some(scene.textures.len() - 1);
    // The bright spot high up.
    environment.world_from_sky = glam::Mat3::from_rotation_x(0.6);
    scene.environment = Some(environment);
}

#[test]
fn every_kind_of_light_agrees_with_radiosity() {
    let centre = Vec3::new(0.3, 2.0, -0.2);
    // Downwards.
    let (u, v) = (Vec3::new(0., 0., 0.3), Vec3::new(0.4, 0., 0.));
    let radiance = Rgb::new(10.0, 20.0, 5.0);
    let world_from_unit =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), glam::Quat::from_rotation_y(0.5), centre);
    let stretched = world_from_unit * Affine3A::from_scale(Vec3::new(2.0, 1.0, 0.7));
    let direction = Vec3::new(-0.3, -1.0, 0.2).normalize();
    let mut shaped = light(LightShape::Rect { center: centre, u, v, radiance });
    shaped.shaping = Some(Shaping {
        axis: Vec3::NEG_Y,
        cone_angle: 0.8,
        cone_softness: 0.3,
        focus: 2.0,
        focus_tint: Rgb::new(0.1, 0.2, 0.3),
    });
    let lights = [
        ("sharp sun", light(LightShape::Directional { direction, illuminance: radiance, angle: 0.0 })),
        ("soft sun", light(LightShape::Directional { direction, illuminance: radiance, angle: 0.2 })),
        ("rect", light(LightShape::Rect { center: centre, u, v, radiance })),
        ("shaped rect", shaped),
        ("disk", light(LightShape::Disk { center: centre, u, v, radiance })),
        ("ball", light(LightShape::Sphere { world_from_unit, radiance })),
        ("ellipsoid", light(LightShape::Sphere { world_from_unit: stretched, radiance })),
        ("cylinder", light(LightShape::Cylinder { world_from_unit: stretched, radiance })),
    ];
    let quads = [
        Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]),
        Quad::new([-1., 0., -1.], [0., 2., 0.], [0., 0., 2.]),
        Quad::new([-0.3, 0.6, -0.5], [0., 0., 0.8], [0.8, 0., 0.]).double_sided(),
    ];
    let plain = scene(&quads);
    let mut scenes: Vec<(&str, Scene)> = Vec::new();
    for (name, light) in lights {
        let mut scene = plain.clone();
        scene.lights.push(light);
        scenes.push((name, scene));
    }
    let mut all = plain.clone();
    all.lights = scenes.iter().map(|(_, s)| s.lights[0].clone()).collect();
    picture_sky(&mut all);
    scenes.push(("all together under a sky", all));
    let mut open = plain.clone();
    picture_sky(&mut open);
    scenes.push(("picture of a sky", open));
    let mut constant = plain.clone();
    constant.environment = Some(Environment::constant("sky", radiance));
    scenes.push(("constant sky", constant));
    for (name, scene) in scenes {
        let atlas = atlas(scene.surfaces.len(), 12);
        let settings = |method| Settings { method, max_bounces: Some(1), samples: Some(128), ..draft() };
        let by_elements = bake(&scene, &atlas, &Settings { quality: Quality::Medium, ..settings(Method::Radiosity) });
        let by_paths = bake(&scene, &atlas, &settings(Method::Path));
        assert_means_agree(name, &by_paths, &by_elements, 0.015);
    }
}

#[test]
fn a_spot_shines_past_a_shelf() {
    let floor = Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0);
    let shelf = Quad::new([-0.3, 0.6, -0.5], [0., 0., 0.8], [0.8, 0., 0.]).albedo(0.0).double_sided();
    let mut scene = scene(&[floor, shelf]);
    let (position, direction) = (Vec3::new(0.3, 2.0, -0.2), Vec3::new(-0.2, -1.0, 0.1).normalize());
    let (inner, outer, range) = (0.3f32, 0.6f32, Some(9.0));
    scene.lights.push(light(LightShape::Spot { position, direction, intensity: Rgb::ONE, inner, outer, range }));
    let (found, patches) = traced(&scene, &atlas(2, 16), &params(128));
    // The integral over the floor, by a grid over it.
    const SIDE: usize = 1000;
    let at = |k: usize| (k as f32 + 0.5) * 2.0 / SIDE as f32 - 1.0;
    let cells = (0..SIDE * SIDE).map(|k| {
        let to = Vec3::new(at(k % SIDE), 0.0, at(k / SIDE));
        let way = to - position;
        let crossing = position + way * 0.7;
        let is_shadowed = (-0.3..=0.5).contains(&crossing.x) && (-0.5..=0.3).contains(&crossing.z);
        let (distance, cos) = (way.length(), way.normalize().dot(direction));
        let ramp = ((cos - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0).powi(2);
        let window = 1.0 - (distance / 9.0).powi(4);
        if is_shadowed { 0.0 } else { f64::from(ramp * window * -way.y / distance.powi(3)) }
    });
    let expected = cells.sum::<f64>() / (SIDE * SIDE) as f64;
    let mean = surface_means(&patches, &found.irradiance)[0].x;
    println!("{mean:.6} against {expected:.6}");
    assert!((mean / expected - 1.0).abs() < 0.002, "{mean} against {expected}");
}

#[test]
fn a_picture_that_shines_is_sampled_as_it_is() {
    let floor = Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]);
    let lamp = Quad::new([-0.4, 0.6, -0.5], [0.8, 0., 0.], [0., 0., 1.]).albedo(0.0).emission(1.0).double_sided();
    let mut scene = scene(&[floor, lamp]);
    scene.textures.push(picture(50.0));
    scene.materials[1].emission_texture = Some(TextureSlot::new(0, "uv"));
    let corners = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    scene.meshes[1].uvs.push(UvSet { name: "uv".into(), coords: corners });
    let (found, patches) = traced(&scene, &atlas(2, 16), &PathParams { max_bounces: Some(0), ..params(2048) });
    // The integral over the lamp, by a grid over it.
    const SIDE: usize = 128;
    let slot = scene.materials[1].emission_texture.as_ref().unwrap();
    let at = |k: usize| (k as f32 + 0.5) / SIDE as f32;
    let cells: Vec<(Vec3, Rgb)> = (0..SIDE * SIDE)
        .map(|k| {
            let uv = Vec2::new(at(k % SIDE), at(k / SIDE));
            let radiance = scene.textures[0].sample(uv, slot.wrap).truncate();
            (lamp.corner + lamp.u * uv.x + lamp.v * uv.y, radiance * (0.8 / (SIDE * SIDE) as f32))
        })
        .collect();
    let truth = |position: Vec3| {
        let from = |(at, power): &(Vec3, Rgb)| {
            let way = *at - position;
            (*power * (way.y * way.y / way.length_squared().powi(2))).as_dvec3()
        };
        cells.iter().map(from).sum::<DVec3>()
    };
    let floor: Vec<usize> = (0..patches.len()).filter(|&i| patches.surface(i) == 0).collect();
    let (mut sum, mut expected) = (DVec3::ZERO, DVec3::ZERO);
    for &i in &floor {
        sum += found.irradiance[i].as_dvec3();
        expected += truth(patches.position[i]);
    }
    // Few texels of the picture are bright: the mean is noisy, and says by how much.
    let squares: DVec3 = floor.iter().map(|&i| found.standard_error[i].as_dvec3().powf(2.0)).sum();
    let error = squares.powf(0.5);
    println!("{}, standard error {}", sum / expected, error / expected);
    assert!(((sum - expected).abs() - 4.0 * error).max_element() < 0.0, "{sum} against {expected}, error {error}");
    assert!((error / expected).max_element() < 0.03, "{error}");
}

#[test]
fn shading_normals_see_no_further_than_the_horizon() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    let tilt = 0.7f32;
    scene.meshes[0].normals = vec![Vec3::new(tilt.sin(), tilt.cos(), 0.0); 4];
    let direction = Vec3::new(-0.6, -0.8, 0.0);
    scene.lights.push(light(LightShape::Directional { direction, illuminance: Rgb::splat(2.0), angle: 0.0 }));
    scene.environment = Some(Environment::constant("sky", Rgb::ONE));
    let mean = |shading_normals| {
        let (found, _) = traced(&scene, &atlas(1, 8), &PathParams { shading_normals, ..params(1024) });
        found.irradiance.iter().map(|e| e.x).sum::<f32>() / found.irradiance.len() as f32
    };
    // The sky above the floor, seen by a plane that is tilted against it; what the plane sees below the floor is not there.
    let shown = PI * (1.0 + tilt.cos()) / 2.0 + 2.0 * (0.6 * tilt.sin() + 0.8 * tilt.cos());
    let geometric = PI + 2.0 * 0.8;
    for (found, expected) in [(mean(true), shown), (mean(false), geometric)] {
        println!("{found} against {expected}");
        assert!((found / expected - 1.0).abs() < 0.002, "{found} against {expected}");
    }
}

#[test]
fn strategies_agree() {
    let quads = room_with_shelf();
    let mut scene = scene(&quads);
    // One wall is open to the sky.
    scene.surfaces.remove(5);
    picture_sky(&mut scene);
    let mut atlas = atlas(quads.len(), 8);
    atlas.placements.remove(5);
    let run = |strategy| traced(&scene, &atlas, &PathParams { strategy, ..params(1024) });
    let (reference, patches) = run(Strategy::Combined);
    let mut noise = vec![reference.standard_error.iter().map(|s| f64::from(s.x).powi(2)).sum::<f64>()];
    for strategy in [Strategy::Lights, Strategy::Hemisphere] {
        let (found, _) = run(strategy);
        for s in 0..scene.surfaces.len() as u32 {
            let members: Vec<usize> = (0..patches.len()).filter(|&i| patches.surface(i) == s).collect();
            let sum = |t: &Traced| members.iter().map(|&i| f64::from(t.irradiance[i].x)).sum::<f64>();
            let square = |t: &Traced| members.iter().map(|&i| f64::from(t.standard_error[i].x).powi(2)).sum::<f64>();
            let (a, b, error) = (sum(&found), sum(&reference), (square(&found) + square(&reference)).sqrt());
            println!("{strategy:?}, surface {s}: {:+.3} %, z {:+.2}", 100.0 * (a / b - 1.0), (a - b) / error);
            assert!((a - b).abs() < 4.0 * error, "{strategy:?}, surface {s}: {a} against {b}");
        }
        noise.push(found.standard_error.iter().map(|s| f64::from(s.x).powi(2)).sum::<f64>());
    }
    println!("{noise:?}");
    assert!(noise[0] < noise[1] && noise[0] < noise[2], "{noise:?}");
}

#[test]
fn each_bounce_in_a_furnace_adds_its_power_of_albedo() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    for bounces in 0..6u32 {
        let baked = bake_quads(&quads, 8, &Settings { max_bounces: Some(bounces), ..paths() });
        let expected = PI * (0..=bounces).map(|k| 0.5f32.powi(k as i32)).sum::<f32>();
        let mean = baked.gathered.irradiance.iter().map(|e| e.x).sum::<f32>() / baked.patches.len() as f32;
        assert!((mean / expected - 1.0).abs() < 0.003, "{bounces} bounces: {mean} against {expected}");
    }
}

#[test]
fn long_paths_do_not_repeat_themselves() {
    // At this albedo paths outlive the dimensions of one sequence.
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.95).emission(1.0)).collect();
    let (found, patches) = traced(&scene(&quads), &atlas(6, 8), &params(256));
    let mean = found.irradiance.iter().map(|e| e.x).sum::<f32>() / patches.len() as f32;
    let expected = PI / 0.05;
    println!("{:+.3} %", 100.0 * (mean / expected - 1.0));
    assert!((mean / expected - 1.0).abs() < 0.01, "{mean} against {expected}");
}

#[test]
fn the_same_bits_for_one_and_two_threads() {
    let quads = room_with_shelf();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bake_quads(&quads, 12, &Settings { samples: Some(32), ..paths() }))
    };
    let (one, two) = (run(1), run(2));
    let bits = |b: &Illuminated| -> Vec<[u32; 3]> {
        b.gathered.irradiance.iter().map(|e| e.to_array().map(f32::to_bits)).collect()
    };
    assert_eq!(bits(&one), bits(&two));
    assert_eq!(one.energy.imbalance.to_bits(), two.energy.imbalance.to_bits());
}
