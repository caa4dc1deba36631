//! Bidirectional path tracing: known radiance, every strategy by itself, and paths of the other method.

mod support;
mod walks;

use glam::Vec3;
use lumel::color::{Rgb, luminance};
use lumel::error::Error;
use lumel::integrate::bidirectional::{Bidirectional, Strategy};
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, Patches, rasterize};
use lumel::progress::Silent;
use lumel::scene::{Environment, Light, LightShape, Scene};
use lumel::sensor::{Sensor, Texels, View};
use lumel::settings::{Method, Settings};
use support::{Quad, atlas, bake_quads, draft, room, scene};
use walks::{Prepared, Runs, Standing, Way, blocks, cornell, film, furnace, passes_of, view};

/// Runs of `way` on `scene` through the view, 16 x 16 pixels in blocks of 4.
fn runs(scene: Scene, view: &View, way: Way, passes: u32, bounces: Option<u32>) -> Runs {
    let prepared = Prepared::new(scene);
    let world = prepared.world();
    Runs::of(12, |seed| blocks(&film(way, &world, view, passes, bounces, seed).mean(), 16, 4))
}

fn assert_agree(name: &str, a: &Runs, b: &Runs, most: f64) {
    assert_within(name, a, b, [1.7, 1.0, most]);
}

/// At most so much spread, mean of z and difference of the wholes.
fn assert_within(name: &str, a: &Runs, b: &Runs, most: [f64; 3]) {
    let [spread, mean, off] = a.against(b);
    println!("{name}: spread {spread:.2}, mean z {mean:+.2}, whole {:+.3} % of {:.4}", 100.0 * off, b.whole());
    assert!(spread < most[0] && mean.abs() < most[1] && off.abs() < most[2], "{name}: {spread} {mean} {off}");
}

#[test]
fn a_furnace_is_even() {
    let (prepared, view) = furnace();
    let film = film(Way::Bidirectional, &prepared.world(), &view, 64, None, 0);
    let mean = blocks(&film.mean(), 16, 16)[0];
    println!("{mean}");
    assert!((mean / 2.0 - 1.0).abs() < 0.01, "{mean}");
}

#[test]
fn pictures_agree_with_those_of_paths() {
    for standing in [Standing::Diffuse, Standing::Mirror, Standing::Glass, Standing::Glossy, Standing::Coated] {
        let view = view(16, 16);
        let paths = runs(cornell(standing), &view, Way::Path, 32, None);
        let both = runs(cornell(standing), &view, Way::Bidirectional, 10, None);
        assert_agree(&format!("{standing:?}"), &both, &paths, 0.02);
    }
}

#[test]
fn every_strategy_finds_all_light_by_itself() {
    // Light after one reflection, and after two: whoever finds it finds all of it.
    let prepared = Prepared::new(cornell(Standing::Diffuse));
    let (world, view) = (prepared.world(), view(16, 16));
    let alone = |from_light, from_eye, passes| {
        Runs::of(12, |seed| {
            let mut both = Bidirectional::new(&world, &view, None, seed, "").unwrap();
            both.only = Some(Strategy { from_light, from_eye });
            blocks(&passes_of(&mut both, &view, passes).mean(), 16, 4)
        })
    };
    for places in [3, 4, 5] {
        let drawn = alone(1, places - 1, 48);
        for from_light in (0..places).filter(|s| *s != 1) {
            let passes = if from_light == 0 || from_light + 1 == places { 64 } else { 24 };
            let name = format!("{from_light} from the light, {} from the eye", places - from_light);
            assert_agree(&name, &alone(from_light, places - from_light, passes), &drawn, 0.05);
        }
    }
}

/// A box without a lid under each kind of light.
fn open_box(lights: Vec<LightShape>, sky: Option<Environment>) -> Scene {
    let mut quads: Vec<Quad> = room([2.0; 3]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.remove(1);
    let mut scene = scene(&quads);
    scene.lights = lights.into_iter().map(|shape| Light::new("lamp", shape)).collect();
    scene.environment = sky;
    scene
}

#[test]
fn light_of_every_kind_sets_out_as_it_is_drawn() {
    let position = Vec3::new(0.7, 1.6, 0.9);
    let (intensity, radiance) = (Rgb::splat(3.0), Rgb::splat(5.0));
    let down = Vec3::new(0.3, -1.0, 0.1).normalize();
    let axes = glam::Affine3A::from_translation(position) * glam::Affine3A::from_scale(Vec3::splat(0.2));
    let kinds: Vec<(&str, Vec<LightShape>, Option<Environment>)> = vec![
        ("point", vec![LightShape::Point { position, intensity, range: Some(2.0) }], None),
        (
            "spot",
            vec![LightShape::Spot { position, direction: down, intensity, inner: 0.3, outer: 0.7, range: None }],
            None,
        ),
        ("sun", vec![LightShape::Directional { direction: down, illuminance: intensity, angle: 0.0 }], None),
        ("wide sun", vec![LightShape::Directional { direction: down, illuminance: intensity, angle: 0.4 }], None),
        ("rect", vec![LightShape::Rect { center: position, u: Vec3::X * 0.3, v: Vec3::Z * -0.3, radiance }], None),
        ("ball", vec![LightShape::Sphere { world_from_unit: axes, radiance }], None),
        ("sky", Vec::new(), Some(Environment::constant("sky", Rgb::ONE))),
        (
            "all",
            vec![
                LightShape::Point { position, intensity, range: None },
                LightShape::Directional { direction: down, illuminance: intensity, angle: 0.4 },
                LightShape::Sphere { world_from_unit: axes, radiance },
            ],
            Some(Environment::constant("sky", Rgb::ONE)),
        ),
    ];
    for (name, lights, sky) in kinds {
        let view = view(16, 16);
        let paths = runs(open_box(lights.clone(), sky.clone()), &view, Way::Path, 32, None);
        let both = runs(open_box(lights.clone(), sky.clone()), &view, Way::Bidirectional, 10, None);
        assert_agree(name, &both, &paths, 0.02);
        // Set out alone, as far as weights go unasked: two reflections, joined from a light's second place.
        let prepared = Prepared::new(open_box(lights, sky));
        let world = prepared.world();
        let alone = |from_light, from_eye| {
            Runs::of(12, |seed| {
                let mut both = Bidirectional::new(&world, &view, None, seed, "").unwrap();
                both.only = Some(Strategy { from_light, from_eye });
                blocks(&passes_of(&mut both, &view, 32).mean(), 16, 4)
            })
        };
        if name != "sky" && name != "all" {
            // Unweighed, joins in corners have no finite variance: z says less.
            assert_within(&format!("{name}, set out"), &alone(2, 2), &alone(1, 3), [2.5, 1.5, 0.05]);
        }
    }
}

#[test]
fn bounces_are_counted_alike() {
    for bounces in [0, 1, 3] {
        let view = view(16, 16);
        let paths = runs(cornell(Standing::Diffuse), &view, Way::Path, 32, Some(bounces));
        let both = runs(cornell(Standing::Diffuse), &view, Way::Bidirectional, 10, Some(bounces));
        assert_agree(&format!("{bounces} bounces"), &both, &paths, 0.02);
    }
}

#[test]
fn the_same_bits_for_one_and_two_threads() {
    let prepared = Prepared::new(cornell(Standing::Glossy));
    let (world, view) = (prepared.world(), view(24, 16));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let film = pool.install(|| film(Way::Bidirectional, &world, &view, 3, None, 7));
        film.mean().iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn what_is_not_followed_from_both_sides_is_refused_by_name() {
    let mut scene = open_box(vec![LightShape::Point { position: Vec3::ONE, intensity: Rgb::ONE, range: None }], None);
    scene.lights[0].links.lit = lumel::scene::Linked::only(vec![true, false, true, true, true]);
    let prepared = Prepared::new(scene);
    let (world, view) = (prepared.world(), view(4, 4));
    let refused = Bidirectional::new(&world, &view, None, 0, "bidirectional").err().unwrap();
    assert!(matches!(&refused, Error::Unsupported { place, .. } if place == "lamp"), "{refused}");
}

/// A room with a lamp in the ceiling and a shelf that keeps its light from half of the floor.
fn room_with_shelf() -> Vec<Quad> {
    let mut quads: Vec<Quad> = room([4., 3., 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([1.5, 2.95, 1.5], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(20.0));
    quads.push(Quad::new([0.3, 1.2, 0.4], [0., 0., 3.], [2., 0., 0.]).albedo(0.7).double_sided());
    quads
}

#[test]
fn texels_agree_with_radiosity() {
    let quads = room_with_shelf();
    let means = |settings: &Settings| {
        let baked = bake_quads(&quads, 12, settings);
        surface_means(&baked.patches, &baked.gathered.irradiance, |_| true)
    };
    let radiosity = means(&Settings { error: Some(0.5), ..draft() });
    for (method, samples) in [(Method::Bidirectional, 24), (Method::Metropolis, 192)] {
        let runs = Runs::of(6, |seed| means(&Settings { method, samples: Some(samples), seed, ..draft() }));
        for (s, truth) in radiosity.iter().enumerate() {
            let [off, error] = [runs.mean[s] / truth - 1.0, runs.error[s] / truth];
            println!("{method:?}, surface {s}: {:+.3} % of {truth:.3}, +- {:.3} %", 100.0 * off, 100.0 * error);
            // Radiosity has an error of its own; chains tell small surfaces less well, as their runs say themselves.
            assert!(off.abs() < 0.01_f64.max(3.0 * error), "{method:?}, surface {s}: {off} +- {error}");
            assert!(error < 0.02, "{method:?}, surface {s}: {error}");
        }
    }
}

#[test]
fn every_strategy_lights_texels() {
    let scene = scene(&room_with_shelf());
    let prepared = Prepared::new(scene);
    let world = prepared.world();
    let atlas = atlas(prepared.scene.surfaces.len(), 6);
    let patches = rasterize(&prepared.scene, &atlas, prepared.tracer.triangles(), &Silent).unwrap();
    let ground = Ground { scene: &prepared.scene, atlas: &atlas, tracer: &prepared.tracer, patches: &patches };
    let exposure = &unocclude(&ground, 0, &Silent).unwrap();
    let texels = Texels { ground: &ground, exposure, shading_normals: false };
    // Right behind the lamp, and under it where a texel is partly covered, light doesn't land on all that is measured.
    assert!((0..patches.len()).any(|pixel| !texels.catches(pixel)));
    let alone = |from_light, from_eye| {
        Runs::of(12, |seed| {
            let mut both = Bidirectional::new(&world, &texels, None, seed, "").unwrap();
            both.only = Some(Strategy { from_light, from_eye });
            surface_means(&patches, &passes_of(&mut both, &texels, 48).mean(), |pixel| texels.catches(pixel))
        })
    };
    for places in [2, 3, 4] {
        let drawn = alone(1, places - 1);
        for from_light in (0..=places).filter(|s| *s != 1) {
            let name = format!("{from_light} from the light, {} from texels", places - from_light);
            let found = alone(from_light, places - from_light);
            if from_light > 1 && from_light + 1 == places {
                // Joined to the texel's own place: the square of the distance below leaves no finite variance to tell an error by.
                let off = found.against(&drawn)[2];
                println!("{name}: whole {:+.3} %", 100.0 * off);
                assert!(off.abs() < 0.04, "{name}: {off}");
            } else {
                assert_agree(&name, &found, &drawn, 0.05);
            }
        }
    }
}

/// Mean irradiance of each surface, over the texels that count.
fn surface_means(patches: &Patches, irradiance: &[Rgb], counts: impl Fn(usize) -> bool) -> Vec<f64> {
    let count = (0..patches.len()).map(|i| patches.surface(i)).max().unwrap() as usize + 1;
    let mut sums = vec![(0.0, 0.0); count];
    for i in (0..patches.len()).filter(|i| counts(*i)) {
        let (sum, area) = &mut sums[patches.surface(i) as usize];
        *sum += f64::from(luminance(irradiance[i]) * patches.area[i]);
        *area += f64::from(patches.area[i]);
    }
    sums.iter().map(|(sum, area)| sum / area.max(f64::MIN_POSITIVE)).collect()
}
