//! Light through cut-outs, blended surfaces and thin panes: answers known on paper, agreement of methods, energy.

mod support;

use glam::{Vec2, Vec3, Vec4};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::post::denoise::Denoise;
use lumel::scene::{Alpha, Light, LightShape, Material, Scene, Texels, Texture, TextureSlot, UvSet, Wrap};
use lumel::settings::{Gather, Method, Normals, Quality, Settings};
use lumel::trace::{Ray, Segment, Tracer};
use std::f32::consts::PI;
use support::{Quad, atlas, bake, draft, room, scene};

const LAMP: Vec3 = Vec3::new(0.0, 3.0, 0.0);

/// A floor from -1 to 1, and sheets over all of it at the heights `sheets`, in that order after it.
fn sheets_over_floor(sheets: &[(f32, Material)]) -> Scene {
    let level =
        |y: f32, half: f32| Quad::new([-half, y, -half], [0., 0., 2.0 * half], [2.0 * half, 0., 0.]).albedo(0.0);
    let mut quads = vec![level(0.0, 1.0)];
    quads.extend(sheets.iter().map(|(y, _)| level(*y, 2.0)));
    let mut scene = scene(&quads);
    for (k, (_, material)) in sheets.iter().enumerate() {
        scene.materials[k + 1] = Material { albedo: Rgb::ZERO, double_sided: true, ..material.clone() };
    }
    for mesh in &mut scene.meshes {
        let coords = vec![Vec2::ZERO, Vec2::Y, Vec2::ONE, Vec2::X];
        mesh.uvs.push(UvSet { name: "uv".into(), coords });
    }
    let shape = LightShape::Point { position: LAMP, intensity: Rgb::splat(100.0), range: None };
    scene.lights.push(Light::new("lamp", shape));
    scene
}

fn blend(opacity: f32) -> Material {
    Material { alpha: Alpha::Blend { opacity }, ..Material::default() }
}

fn pane(transmission: [f32; 3]) -> Material {
    Material { transmission: transmission.into(), ..Material::default() }
}

/// The floor's light over what arrives there without sheets in the way: place and share.
fn floor_shares(scene: &Scene, texels: u32) -> Vec<(Vec3, Rgb)> {
    let mut open = scene.clone();
    open.surfaces[1..].iter_mut().for_each(|s| s.world_from_local.translation.y = -10.0);
    let atlas = atlas(scene.surfaces.len(), texels);
    let [baked, open] = [scene, &open].map(|scene| bake(scene, &atlas, &draft()));
    let patches = &baked.patches;
    let on_floor = (0..patches.len()).filter(|&i| patches.surface(i) == 0);
    let share = |i: usize| {
        let way = LAMP - patches.position[i];
        let known = 100.0 * way.y / way.length().powi(3);
        assert!((open.direct.shown[i].x / known - 1.0).abs() < 0.02, "{} {known}", open.direct.shown[i]);
        (patches.position[i], baked.direct.shown[i] / open.direct.shown[i])
    };
    on_floor.map(share).collect()
}

fn assert_shares(sheets: &[(f32, Material)], expected: [f32; 3]) {
    for (at, share) in floor_shares(&sheets_over_floor(sheets), 16) {
        assert!((share - Rgb::from(expected)).abs().max_element() < 0.005, "{share} in place of {expected:?} at {at}");
    }
}

#[test]
fn a_blended_sheet_lets_the_rest_through_without_noise() {
    assert_shares(&[(1.0, blend(0.3))], [0.7; 3]);
}

#[test]
fn two_sheets_multiply_even_in_one_plane() {
    for second in [1.5, 1.0] {
        assert_shares(&[(1.0, blend(0.3)), (second, blend(0.5))], [0.35; 3]);
    }
}

#[test]
fn a_red_pane_passes_red_and_a_blend_of_it_less() {
    assert_shares(&[(1.0, pane([0.9, 0.1, 0.0]))], [0.9, 0.1, 0.0]);
    let half = Material { alpha: Alpha::Blend { opacity: 0.5 }, ..pane([0.8, 0.2, 0.0]) };
    assert_shares(&[(1.0, half)], [0.9, 0.6, 0.5]);
}

/// A texture of `n` by `n` fields, every other one a hole.
fn checker(n: u32, each: u32) -> Texture {
    let side = n * each;
    let texel = |i: u32| {
        let is_hole = (i % side / each + i / side / each) & 1 == 0;
        [255, 255, 255, if is_hole { 0 } else { 255 }]
    };
    Texture {
        name: "checker".into(),
        width: side,
        height: side,
        texels: Texels::Srgb8((0..side * side).map(texel).collect()),
    }
}

fn cut_out() -> Material {
    let slot = TextureSlot { wrap: [Wrap::Clamp; 2], ..TextureSlot::new(0, "uv") };
    Material { alpha: Alpha::Mask { cutoff: 0.5, opacity: 1.0 }, albedo_texture: Some(slot), ..Material::default() }
}

#[test]
fn a_checker_casts_its_fields_where_they_belong() {
    let mut scene = sheets_over_floor(&[(1.5, cut_out())]);
    scene.textures.push(checker(8, 16));
    let shares = floor_shares(&scene, 64);
    let (mut near_edges, mut sum) = (0, 0.0);
    for (at, share) in &shares {
        sum += share.x;
        // Half way up to the lamp: twice as large on the floor. Fields are 0.5 m wide there: 1 m on the floor.
        let field = (*at * 0.5 + Vec3::splat(2.0)) / 0.5;
        let edge = [field.x, field.z].map(|f| (f - f.round()).abs()).into_iter().fold(1.0, f32::min);
        if edge < 0.05 {
            near_edges += 1;
            continue;
        }
        let is_hole = (field.x.floor() + field.z.floor()) as i32 % 2 == 0;
        assert_eq!(share.x > 0.5, is_hole, "{share} at {at}");
        assert!((share.x - f32::from(u8::from(is_hole))).abs() < 0.004, "{share} at {at}");
    }
    assert!(near_edges < shares.len() / 4);
    assert!((sum / shares.len() as f32 - 0.5).abs() < 0.02, "{}", sum / shares.len() as f32);
}

#[test]
fn vertex_alpha_and_an_opacity_texture_count() {
    let mut faint = sheets_over_floor(&[(1.0, blend(0.5))]);
    faint.meshes[1].colors = vec![Vec4::new(1.0, 1.0, 1.0, 0.5); 4];
    let grey = Texture { name: "grey".into(), width: 1, height: 1, texels: Texels::Linear8(vec![[0, 0, 0, 51]]) };
    let mut textured = sheets_over_floor(&[(1.0, blend(1.0))]);
    textured.textures.push(grey);
    textured.materials[1].opacity_texture = Some(TextureSlot::new(0, "uv"));
    for (scene, expected) in [(faint, 0.75), (textured, 0.8)] {
        let tracer = Tracer::new(&scene);
        let mut share = [Rgb::ZERO];
        tracer.transmittance(&[Segment { from: Vec3::new(0.1, 0.5, 0.2), to: LAMP }], &mut share);
        assert!((share[0] - Rgb::splat(expected)).abs().max_element() < 1e-5, "{} {expected}", share[0]);
    }
}

#[test]
fn rays_end_at_sheets_as_often_as_they_should() {
    let sheets = [(1.0, pane([0.8, 0.4, 0.0])), (2.0, blend(0.25))];
    let scene = sheets_over_floor(&sheets);
    let tracer = Tracer::new(&scene);
    let n = 40_000;
    let ray = |k: u32| {
        let at = Vec3::new((k % 200) as f32 / 200.0 - 0.5, 0.1, (k / 200) as f32 / 200.0 - 0.5);
        Ray { origin: at, direction: Vec3::Y }
    };
    let rays: Vec<Ray> = (0..n).map(ray).collect();
    let (mut hits, mut tints) = (vec![None; rays.len()], Vec::new());
    tracer.closest_tinted(&rays, &mut hits, &mut tints);
    let mut sums = [Rgb::ZERO; 3];
    for (hit, tint) in hits.iter().zip(&tints) {
        sums[hit.as_ref().map_or(2, |h| if h.t < 1.5 { 0 } else { 1 })] += *tint / n as f32;
    }
    // What ends counts by the mean share that is stopped; patches' albedos go with it.
    let first = Rgb::new(0.8, 0.4, 0.0);
    let expected = [Rgb::splat(0.6), first * 0.25, first * 0.75];
    for (sum, expected) in sums.iter().zip(expected) {
        assert!((*sum - expected).abs().max_element() < 0.01, "{sum} in place of {expected}");
    }
}

/// A furnace: all that is there emits and reflects alike, sheets in the room as much as they are opaque.
fn furnace(material: &Material) -> Scene {
    let mut quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    quads.push(Quad::new([0.4, 0.1, 1.1], [1.1, 0., 0.2], [0., 0.8, 0.1]).emission(1.0).double_sided());
    let mut scene = scene(&quads);
    let sheet = &mut scene.materials[6];
    (sheet.alpha, sheet.albedo_texture) = (material.alpha, material.albedo_texture.clone());
    scene.textures.push(checker(4, 8));
    let coords = vec![Vec2::ZERO, Vec2::Y, Vec2::ONE, Vec2::X];
    scene.meshes[6].uvs.push(UvSet { name: "uv".into(), coords });
    scene
}

#[test]
fn a_furnace_with_sheets_in_it_stays_uniform() {
    for material in [Material::default(), blend(0.4), cut_out()] {
        let scene = furnace(&material);
        let atlas = atlas(7, 16);
        let blocks = Settings { quality: Quality::High, ..draft() };
        let gather = Settings { gather: Gather::Final, quality: Quality::High, ..draft() };
        let paths = Settings { method: Method::Path, samples: Some(512), ..draft() };
        for (name, settings, most) in [("blocks", blocks, 0.0055), ("gather", gather, 0.0055), ("paths", paths, 0.02)] {
            let baked = bake(&scene, &atlas, &settings);
            let shown: Vec<usize> = (0..baked.patches.len()).filter(|&i| !baked.exposure.is_buried(i)).collect();
            let off: Vec<f32> = shown.iter().map(|&i| baked.gathered.irradiance[i].x / (2.0 * PI) - 1.0).collect();
            let n = off.len() as f32;
            let (mean, rms) = (off.iter().sum::<f32>() / n, (off.iter().map(|o| o * o).sum::<f32>() / n).sqrt());
            let balance = baked.energy.imbalance;
            println!("{:?} {name}: rms {rms:.5}, mean {mean:.5}, balance {balance:.5}", material.alpha);
            assert!(rms < most && mean.abs() < 0.001, "{name}: {rms}, {mean}");
            assert!(balance.abs() < 0.002, "{name}: {balance}");
        }
    }
}

/// A room lit through a tinted window in one wall, with a blended screen in it, `gap` away from the walls and the floor.
fn tinted_room(gap: f32) -> Scene {
    let [x, y, z] = [2.0, 1.5, 3.0];
    let mut quads = room([x, y, z]);
    // The wall at x = 0 becomes a pane, with the lamp behind it in a box of its own.
    quads.push(Quad::new([gap, gap, 1.8], [x - 2.0 * gap, 0., 0.2], [0., 0.9, 0.]).double_sided());
    quads.push(Quad::new([-0.8, 0.2, 0.6], [0., 1.0, 0.], [0., 0., 1.4]).emission(20.0));
    let mut scene = scene(&quads);
    scene.materials[2] = Material { albedo: Rgb::splat(0.1), double_sided: true, ..pane([0.7, 0.4, 0.2]) };
    scene.materials[6].alpha = Alpha::Blend { opacity: 0.6 };
    scene
}

fn surface_means(baked: &Illuminated) -> Vec<Rgb> {
    let patches = &baked.patches;
    let of = |s: u32| {
        let (mut sum, mut area) = (Rgb::ZERO, 0.0);
        for i in (0..patches.len()).filter(|&i| patches.surface(i) == s) {
            sum += baked.gathered.irradiance[i] * patches.area[i];
            area += patches.area[i];
        }
        sum / area
    };
    (0..8).map(of).collect()
}

/// Light as it was found: denoising moves light between texels.
fn exact() -> Settings {
    Settings { normals: Normals::Geometric, quality: Quality::High, denoise: Denoise::Off, ..Settings::default() }
}

#[test]
fn methods_agree_behind_a_tinted_window() {
    let scene = tinted_room(0.25);
    let atlas = atlas(8, 16);
    let settings = exact();
    let paths = bake(&scene, &atlas, &Settings { method: Method::Path, samples: Some(1024), ..settings.clone() });
    let truth = surface_means(&paths);
    println!("paths: balance {:+.5}", paths.energy.imbalance);
    assert!(paths.energy.imbalance.abs() < 0.005, "{}", paths.energy.imbalance);
    for gather in [Gather::Blocks, Gather::Final] {
        let baked = bake(&scene, &atlas, &Settings { gather, ..settings.clone() });
        let means = surface_means(&baked);
        println!("{gather:?}: balance {:+.5}", baked.energy.imbalance);
        for (s, (mean, truth)) in means.iter().zip(&truth).enumerate().filter(|(_, (_, t))| t.x > 1e-3) {
            let off = (*mean / *truth - Rgb::ONE).abs().max_element();
            println!("  surface {s}: {mean} {truth} off {off:.4}");
            assert!(off < if gather == Gather::Blocks { 0.015 } else { 0.03 }, "{gather:?}, surface {s}: {off}");
        }
        let most = if gather == Gather::Blocks { 0.005 } else { 0.01 };
        assert!(baked.energy.imbalance.abs() < most, "{gather:?}: {}", baked.energy.imbalance);
    }
    let floor = truth[0];
    assert!(luminance(floor) > 0.1 && floor.x > 1.5 * floor.y && floor.y > 1.5 * floor.z, "{floor}");
}

/// A screen that touches the walls stands in the middle of their texels, whose light is one number for both of its sides: its dark
/// side gets too much by what those texels are of all that it sees. Neither the tint nor the sheet has a part in that: it halves with
/// the texels, and turns round with the screen.
#[test]
fn what_a_screen_gets_from_texels_that_it_cuts_shrinks_with_them() {
    let scene = tinted_room(0.0);
    let paths = Settings { method: Method::Path, samples: Some(2048), ..exact() };
    let truth = luminance(surface_means(&bake(&scene, &atlas(8, 8), &paths))[6]);
    let excess = |texels: u32| luminance(surface_means(&bake(&scene, &atlas(8, texels), &exact()))[6]) / truth - 1.0;
    let [coarse, fine] = [8, 24].map(excess);
    println!("{coarse:+.4} at 8 texels, {fine:+.4} at 24");
    assert!(coarse > 0.012 && fine < 0.6 * coarse && fine.abs() < 0.025, "{coarse} {fine}");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let scene = tinted_room(0.0);
    let atlas = atlas(8, 12);
    let of = |threads: usize, method: Method| -> Vec<[u32; 3]> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = Settings { method, samples: (method == Method::Path).then_some(32), ..draft() };
        let baked = pool.install(|| bake(&scene, &atlas, &settings));
        baked.gathered.irradiance.iter().map(|e| e.to_array().map(f32::to_bits)).collect()
    };
    for method in [Method::Radiosity, Method::Path] {
        assert_eq!(of(1, method), of(3, method), "{method:?}");
    }
}
