//! Where light comes from: answers known on paper, agreement of the methods, and irradiance about tilted normals against paths whose
//! shading normals are tilted.

mod support;

use glam::Vec3;
use lumel::blocks::shown_normals;
use lumel::color::{Rgb, luminance};
use lumel::illuminate::{Illuminated, illuminate};
use lumel::light::{Lights, Lit};
use lumel::load::load;
use lumel::patch::reflectance::reflectance;
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, rasterize};
use lumel::post::{Directional, Quantity};
use lumel::progress::Silent;
use lumel::scene::LightShape;
use lumel::settings::{Gather, Method, Normals, Quality, Settings};
use lumel::trace::Tracer;
use lumel::unwrap::unwrap;
use support::measure::{Case, room_with_a_block, round_column, sunroom};
use support::{Quad, room};

fn sh(quality: Quality) -> Settings {
    Settings { quality, directional: Directional::Sh, quantity: Quantity::Irradiance, ..Settings::default() }
}

/// Even light and that along X, Y and Z by patch.
fn coefficients(baked: &Illuminated) -> Vec<[Rgb; 4]> {
    let names: Vec<&str> = baked.lightmap.layers.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["sh0", "sh1x", "sh1y", "sh1z"]);
    let at = |i: usize| {
        let [page, texel] = baked.patches.texel(i);
        std::array::from_fn(|k| baked.lightmap.layers[k].pages[page as usize][texel as usize])
    };
    (0..baked.patches.len()).map(at).collect()
}

fn about([c, x, y, z]: &[Rgb; 4], n: Vec3) -> Rgb {
    *c + *x * n.x + *y * n.y + *z * n.z
}

/// Luminance of the light vector.
fn vector(c: &[Rgb; 4]) -> Vec3 {
    Vec3::new(luminance(c[1]), luminance(c[2]), luminance(c[3]))
}

fn open(baked: &Illuminated) -> impl Iterator<Item = usize> {
    (0..baked.patches.len()).filter(|&i| baked.exposure.area[i] > 0.0 && baked.gathered.irradiance[i].x > 0.0)
}

fn floor(texels: u32) -> Case {
    Case::of_quads("floor", &[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])], texels)
}

#[test]
fn one_sun_is_the_direction() {
    let towards = Vec3::new(0.6, 0.5, -0.3).normalize();
    let sun = LightShape::Directional { direction: -towards, illuminance: Rgb::new(100., 80., 50.), angle: 0.0 };
    let case = floor(8).light(sun);
    for method in [Method::Radiosity, Method::Path] {
        let samples = (method == Method::Path).then_some(64);
        let settings = Settings { method, samples, ..sh(Quality::Draft) };
        for (c, e) in coefficients(&case.bake(&settings)).iter().zip(&case.bake(&settings).gathered.irradiance) {
            assert!((vector(c).normalize() - towards).length() < 1e-4, "{method:?}: {}", vector(c));
            // E = scalar / 4 + vector . n / 2, scaled to E about the floor.
            let expected = *e / (0.25 + 0.5 * towards.y) * 0.25;
            assert!((c[0] / expected - 1.0).abs().max_element() < 1e-3, "{method:?}: {} against {expected}", c[0]);
        }
        let baked = case.bake(&Settings { directional: Directional::Dominant, ..settings });
        assert_eq!(baked.lightmap.layers[0].name, "dominant");
        for i in open(&baked) {
            let [page, texel] = baked.patches.texel(i);
            let dominant = baked.lightmap.layers[0].pages[page as usize][texel as usize];
            assert!((dominant - towards).length() < 1e-3, "{method:?}: {dominant}");
        }
    }
}

#[test]
fn furnace_is_uniform_over_the_hemisphere() {
    // Of a hemisphere of radiance 1 half of the irradiance is even, half is along the normal.
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    let case = Case::of_quads("furnace", &quads, 12);
    let with = |method, gather, samples| Settings { method, gather, samples, ..sh(Quality::Medium) };
    for (settings, most) in [
        (with(Method::Radiosity, Gather::Blocks, None), 0.03),
        (with(Method::Radiosity, Gather::Final, Some(1024)), 0.03),
        (with(Method::Path, Gather::Auto, Some(1024)), 0.10),
    ] {
        let baked = case.bake(&settings);
        let (mut square, mut count) = (0.0, 0.0);
        for (i, c) in coefficients(&baked).iter().enumerate() {
            let n = baked.patches.normal[i];
            let e = baked.gathered.irradiance[i].x;
            let off = [c[0].x - 0.5 * e, c[1].x - 0.5 * e * n.x, c[2].x - 0.5 * e * n.y, c[3].x - 0.5 * e * n.z];
            square += off.iter().map(|d| (d / e).powi(2)).sum::<f32>() / 4.0;
            count += 1.0;
        }
        let off = (square / count).sqrt();
        println!("{:?} {:?}: {:.2} %", settings.method, settings.gather, 100.0 * off);
        assert!(off < most, "{:?}: {off}", settings.method);
    }
}

#[test]
fn lamp_at_a_wall_is_told_in_closed_form() {
    // A lamp 1 x 1 at x = 1, upright, seen from a floor: its moments by a fine grid over it.
    let lamp = Quad::new([1., 0.2, -0.5], [0., 0., 1.], [0., 1., 0.]).albedo(0.0).emission(10.0);
    let quads = [Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.5), lamp];
    let case = Case::of_quads("lamp", &quads, 24);
    let baked = case.bake(&Settings { max_bounces: Some(0), ..sh(Quality::Medium) });
    let all = coefficients(&baked);
    let mut worst = 0.0f32;
    for i in open(&baked).filter(|&i| baked.patches.surface(i) == 0) {
        let (at, side) = (baked.patches.position[i], 64);
        if at.x > 0.7 {
            continue;
        }
        let (mut scalar, mut sum) = (0.0, Vec3::ZERO);
        for (u, v) in (0..side).flat_map(|u| (0..side).map(move |v| (u, v))) {
            let [u, v] = [u, v].map(|k| (k as f32 + 0.5) / side as f32);
            let way = lamp.corner + lamp.u * u + lamp.v * v - at;
            let solid = way.x.abs() / way.length().powi(3) / (side * side) as f32;
            scalar += solid;
            sum += way.normalize() * solid;
        }
        let expected = sum / (scalar * 0.5);
        let found = vector(&all[i]) / luminance(all[i][0]);
        worst = worst.max((found - expected).length());
        assert!(found.x > 0.0, "the lamp stands at +X: {found}");
    }
    println!("worst {worst:.4}");
    // Over texels of 8 cm, against their middles.
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn what_is_asked_for_changes_no_page_and_threads_change_nothing() {
    let case = sunroom(12);
    let plain = case.blocks(5.0, 3);
    let settings = |threads: usize| {
        let settings = Settings { gather: Gather::Blocks, error: Some(5.0), seed: 3, ..sh(Quality::Medium) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| case.bake(&Settings { normals: Normals::Geometric, ..settings }))
    };
    let [one, three] = [1, 3].map(settings);
    let bits = |values: &[Rgb]| values.iter().flat_map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<u32>>();
    assert_eq!(bits(&plain.gathered.irradiance), bits(&one.gathered.irradiance));
    for (a, b) in one.lightmap.layers.iter().zip(&three.lightmap.layers) {
        assert_eq!(bits(&a.pages[0]), bits(&b.pages[0]), "{}", a.name);
    }
}

#[test]
fn value_about_the_own_normal_is_the_pages() {
    for case in [round_column(true), sunroom(12)] {
        let settings = Settings { normals: case.normals, ..sh(Quality::Draft) };
        let baked = case.bake(&settings);
        let tracer = Tracer::new(&case.scene);
        let patches = rasterize(&case.scene, &case.atlas, tracer.triangles(), &Silent).unwrap();
        let ground = Ground { scene: &case.scene, atlas: &case.atlas, tracer: &tracer, patches: &patches };
        let (reflectance, emission) = &reflectance(&ground, &Silent).unwrap();
        let exposure = &unocclude(&ground, 0, &Silent).unwrap();
        let (lights, params) = (&Lights::new(&case.scene), &settings.direct_params());
        let lit = Lit { ground: &ground, exposure, reflectance, emission, lights, params, known: None };
        let normals = shown_normals(&lit);
        let all = coefficients(&baked);
        for i in open(&baked) {
            let normal = normals.as_ref().map_or(patches.normal[i], |n| n[i]);
            let [page, texel] = baked.patches.texel(i);
            let value = baked.lightmap.pages[page as usize].rgb[texel as usize];
            let read = about(&all[i], normal);
            assert!((read - value).abs().max_element() < 1e-4 * value.max_element(), "{}: {read}, {value}", case.name);
        }
    }
}

/// Root mean square over the mean of `truth` on `surface`, by area in the open, less the noise of the truth.
fn off_by(truth: &Illuminated, surface: u32, value: impl Fn(usize) -> f32) -> f32 {
    let (mut square, mut sum, mut area) = (0.0, 0.0, 0.0);
    for i in open(truth).filter(|&i| truth.patches.surface(i) == surface) {
        let e = luminance(truth.gathered.irradiance[i]);
        let noise = luminance(truth.gathered.standard_error[i]).powi(2);
        square += ((value(i) - e).powi(2) - noise) * truth.exposure.area[i];
        sum += e * truth.exposure.area[i];
        area += truth.exposure.area[i];
    }
    (square / area).max(0.0).sqrt() / (sum / area)
}

/// The form that keeps the mean and the first moment, see `post::directional`.
fn rounded([c, x, y, z]: &[Rgb; 4], n: Vec3) -> Vec3 {
    let of = |k: usize| {
        let v = Vec3::new(x[k], y[k], z[k]);
        let r = (0.5 * v.length() / c[k].max(f32::MIN_POSITIVE)).min(1.0);
        let q = 0.5 * (1.0 + n.dot(v.normalize_or_zero()));
        let (p, a) = (1.0 + 2.0 * r, (1.0 - r) / (1.0 + r));
        c[k] * (a + (1.0 - a) * (p + 1.0) * q.powf(p))
    };
    Vec3::new(of(0), of(1), of(2))
}

#[test]
fn tilted_normals_show_what_paths_find_about_them() {
    // Of a wall and a floor: irradiance about normals tilted by so many degrees, off by at most so much of the mean as layers are read,
    // and in the form that is never below 0.
    let case = room_with_a_block(10);
    let baked = case.bake(&Settings { normals: Normals::Geometric, ..sh(Quality::High) });
    let all = coefficients(&baked);
    for (surface, axis) in [(0, Vec3::X), (0, -Vec3::Z), (2, Vec3::Y), (2, Vec3::Z)] {
        for (degrees, most) in [(15.0f32, [0.055, 0.035]), (30.0, [0.085, 0.065]), (45.0, [0.11, 0.10])] {
            let normal = baked.patches.normal[open(&baked).find(|&i| baked.patches.surface(i) == surface).unwrap()];
            let (sin, cos) = degrees.to_radians().sin_cos();
            let tilted = (normal * cos + axis * sin).normalize();
            let mut scene = case.scene.clone();
            let mesh = &mut scene.meshes[scene.surfaces[surface as usize].mesh];
            mesh.normals = vec![tilted; mesh.positions.len()];
            let paths = Settings { method: Method::Path, samples: Some(256), ..Settings::default() };
            let truth = illuminate(&scene, &case.atlas, &paths, &Silent).unwrap();
            let plain = off_by(&truth, surface, |i| luminance(baked.gathered.irradiance[i]));
            let off = off_by(&truth, surface, |i| luminance(about(&all[i], tilted).max(Vec3::ZERO)));
            let rounded = off_by(&truth, surface, |i| {
                let ratio = rounded(&all[i], tilted) / rounded(&all[i], normal);
                luminance(baked.gathered.irradiance[i] * ratio)
            });
            let percent = [plain, off, rounded].map(|v| 100.0 * v);
            println!(
                "{surface} {axis} {degrees}: plain {:.1}, sh {:.1}, rounded {:.1} %",
                percent[0], percent[1], percent[2]
            );
            assert!(
                off < most[0] && rounded < most[1] && off < 0.7 * plain,
                "{surface} {axis} {degrees}: {off}, without directions {plain}"
            );
        }
    }
}

#[test]
fn all_methods_agree_on_the_cornell_box() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/cornell_box/cornell_box.glb");
    let scene = load(std::path::Path::new(file)).unwrap().scene;
    let base = Settings { resolution: Some(64), normals: Normals::Geometric, ..sh(Quality::High) };
    let (atlas, _) = unwrap(&scene, &base.unwrap_params(), &Silent).unwrap();
    let bake = |settings: Settings| illuminate(&scene, &atlas, &settings, &Silent).unwrap();
    let truth = bake(Settings { method: Method::Path, samples: Some(1024), ..base.clone() });
    let known = coefficients(&truth);
    let blocks = bake(base.clone());
    let gathered = bake(Settings { gather: Gather::Final, samples: Some(1024), ..base });
    // Runs of 16 texels of one chart: paths are noisy.
    let patches: Vec<usize> = open(&truth).collect();
    let runs: Vec<&[usize]> = patches
        .chunk_by(|&a, &b| truth.patches.chart[a] == truth.patches.chart[b])
        .flat_map(|chart| chart.chunks_exact(16))
        .collect();
    let mean = |of: &[[Rgb; 4]], k: usize, channel: usize| -> Vec<f32> {
        runs.iter().map(|run| run.iter().map(|&i| of[i][k][channel]).sum::<f32>() / 16.0).collect()
    };
    let rms = |values: &mut dyn Iterator<Item = f32>| (values.map(|v| v * v).sum::<f32>() / runs.len() as f32).sqrt();
    for (name, baked, most) in [("blocks", &blocks, 0.03), ("gather", &gathered, 0.03)] {
        let found = coefficients(baked);
        for (k, coefficient) in ["sh0", "sh1x", "sh1y", "sh1z"].into_iter().enumerate() {
            for (channel, color) in ["R", "G", "B"].into_iter().enumerate() {
                let (test, expected) = (mean(&found, k, channel), mean(&known, k, channel));
                let whole = rms(&mut mean(&known, 0, channel).into_iter());
                let off = rms(&mut test.iter().zip(&expected).map(|(a, b)| a - b)) / whole;
                let bias = test.iter().zip(&expected).map(|(a, b)| a - b).sum::<f32>() / runs.len() as f32 / whole;
                println!("{name} {coefficient}.{color}: rms {:.2}, bias {:+.2} %", 100.0 * off, 100.0 * bias);
                assert!(off < most && bias.abs() < 0.01, "{name} {coefficient}.{color}: {off}, {bias}");
            }
        }
    }
}

#[test]
fn a_texel_that_two_sides_light_has_no_favourite() {
    // Two lamps alike on either side: the mean direction stands upright between them.
    let lamp =
        |x: f32| LightShape::Point { position: Vec3::new(x, 1.0, 0.0), intensity: Rgb::splat(10.0), range: None };
    let case = floor(9).light(lamp(-0.8)).light(lamp(0.8));
    let baked = case.bake(&Settings { directional: Directional::Dominant, ..sh(Quality::Draft) });
    let middle = open(&baked).find(|&i| baked.patches.position[i].length() < 1e-3).unwrap();
    let [page, texel] = baked.patches.texel(middle);
    let dominant = baked.lightmap.layers[0].pages[page as usize][texel as usize];
    assert!(dominant.x.abs() < 1e-3 && (dominant.y - 1.0 / 1.64f32.sqrt()).abs() < 0.02, "{dominant}");
}
