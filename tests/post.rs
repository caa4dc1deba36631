//! From texel values to pages: noise is taken out and light stays, seams close and mean light stays, and what differs by right is
//! left alone.

mod support;

use glam::Vec3;
use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::light::{Lights, Lit};
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, rasterize, reflectance::reflectance};
use lumel::post::denoise::{Denoise, oidn::Oidn, scales::Scales};
use lumel::post::dilate::{Finish, fill};
use lumel::post::gutter::Gutter;
use lumel::post::seam::{SeamMode, bilinear};
use lumel::post::{PageImage, Quantity};
use lumel::progress::Silent;
use lumel::scene::{LightShape, Scene};
use lumel::settings::{Gather, Settings};
use lumel::trace::{Tracer, Triangles};
use lumel::unwrap::Atlas;
use std::path::Path;
use support::measure::{Case, room_with_a_block, sunroom};
use support::{Quad, atlas, draft, room, scene};

/// Calls `look` with all that light on the texels of `scene` depends on.
fn with_lit<T>(scene: &Scene, atlas: &Atlas, look: impl FnOnce(&Lit) -> T) -> T {
    let triangles = Triangles::new(scene);
    let tracer = Tracer::with(scene, triangles.clone());
    let patches = rasterize(scene, atlas, &triangles, &Silent).unwrap();
    let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
    let (reflectance, emission) = reflectance(&ground, &Silent).unwrap();
    let exposure = unocclude(&ground, 0, &Silent).unwrap();
    let (lights, params) = (Lights::new(scene), draft().direct_params());
    let lit = Lit {
        ground: &ground,
        exposure: &exposure,
        reflectance: &reflectance,
        emission: &emission,
        lights: &lights,
        params: &params,
        known: None,
    };
    look(&lit)
}

/// A number in -1..1 without pattern.
fn scatter(seed: u32, i: usize) -> f32 {
    let mut h = (i as u32).wrapping_mul(0x9e37_79b9) ^ seed.wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    h ^= h >> 16;
    h as f32 / (1u32 << 31) as f32 - 1.0
}

/// A unit square of 40 x 40 texels, and another one a metre above it.
fn squares() -> (Scene, Atlas) {
    let square = |y: f32| Quad::new([0., y, 0.], [0., 0., 1.], [1., 0., 0.]);
    (scene(&[square(0.0), square(1.0)]), atlas(2, 40))
}

/// Filters `truth` by patch with noise of `noise` in both halves; the light without and with noise, and filtered.
fn filtered(truth: impl Fn(&Lit, usize) -> f32, noise: f32) -> (Vec<f32>, Vec<f32>, Vec<f32>, Vec<bool>) {
    let (scene, atlas) = squares();
    with_lit(&scene, &atlas, |lit| {
        let n = lit.ground.patches.len();
        let truth: Vec<f32> = (0..n).map(|i| truth(lit, i)).collect();
        let half = |seed: u32, i: usize| truth[i] + noise * (scatter(seed, i) + scatter(seed + 2, i));
        let mut light: Vec<Rgb> = (0..n).map(|i| Rgb::splat(0.5 * (half(1, i) + half(2, i)))).collect();
        let mut difference: Vec<Rgb> = (0..n).map(|i| Rgb::splat(0.5 * (half(1, i) - half(2, i)))).collect();
        let noisy = light.iter().map(|v| v.x).collect();
        Scales::SINGLE.filter(lit, &mut light, &mut difference, &mut [], &Silent).unwrap();
        let border = (0..n).map(|i| lit.ground.neighbours(i).count() < 8).collect();
        (truth, noisy, light.iter().map(|v| v.x).collect(), border)
    })
}

fn rms(a: &[f32], b: &[f32], which: impl Fn(usize) -> bool) -> f32 {
    let squares: Vec<f32> = (0..a.len()).filter(|i| which(*i)).map(|i| (a[i] - b[i]).powi(2)).collect();
    (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
}

#[test]
fn noise_goes_and_gradients_stay() {
    let slope = |lit: &Lit, i: usize| {
        let p = lit.ground.patches.position[i];
        2.0 + p.x - 0.5 * p.z
    };
    let (truth, noisy, light, border) = filtered(slope, 0.1);
    let all = rms(&light, &truth, |_| true) / rms(&noisy, &truth, |_| true);
    let at_border = rms(&light, &truth, |i| border[i]) / rms(&noisy, &truth, |i| border[i]);
    println!("noise left: {all:.3}, at borders {at_border:.3}");
    assert!(all < 0.3 && at_border < 0.5, "{all} {at_border}");
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    assert!((mean(&light) - mean(&noisy)).abs() < 2e-3, "{} {}", mean(&light), mean(&noisy));
}

#[test]
fn light_without_noise_stays_to_the_bit() {
    let (truth, noisy, light, _) = filtered(|_, i| 1.0 + scatter(7, i), 0.0);
    assert_eq!(truth, noisy);
    assert_eq!(light, noisy);
}

#[test]
fn even_light_stays_to_the_bit_whatever_the_noise() {
    let (scene, atlas) = squares();
    with_lit(&scene, &atlas, |lit| {
        let n = lit.ground.patches.len();
        let (even, other) = (Rgb::splat(0.7), |i: usize| Rgb::splat(1.0 + scatter(3, i)));
        // The other square's light is all noise: nothing of it may cross over.
        let is_own = |i: usize| lit.ground.patches.surface(i) == 0;
        let mut light: Vec<Rgb> = (0..n).map(|i| if is_own(i) { even } else { other(i) }).collect();
        let mut difference: Vec<Rgb> = (0..n).map(|i| Rgb::splat(scatter(4, i))).collect();
        Scales::SINGLE.filter(lit, &mut light, &mut difference, &mut [], &Silent).unwrap();
        assert!((0..n).filter(|i| is_own(*i)).all(|i| light[i] == even));
        let found: Vec<f32> = light.iter().map(|v| v.x).collect();
        let spread = rms(&found, &vec![1.0; n], |i| !is_own(i));
        assert!(spread < 0.2, "{spread}");
    });
}

#[test]
fn steps_stay_within_their_noise() {
    let step = |lit: &Lit, i: usize| if lit.ground.patches.position[i].x < 0.5 { 1.0 } else { 0.2 };
    let (truth, noisy, light, _) = filtered(step, 0.05);
    // Columns of 40 texels; the step lies between the 20th and the 21st.
    let near: Vec<bool> = with_lit(&squares().0, &squares().1, |lit| {
        (0..lit.ground.patches.len()).map(|i| (lit.ground.patches.position[i].x - 0.5).abs() < 0.05).collect()
    });
    let raw = rms(&noisy, &truth, |_| true);
    let (at_step, away) = (rms(&light, &truth, |i| near[i]), rms(&light, &truth, |i| !near[i]));
    println!("noise {raw:.4}, at the step {at_step:.4}, away {away:.4}");
    assert!(at_step < 1.1 * raw && away < 0.6 * raw, "{at_step} {away} of {raw}");
}

/// Rays of a final gather, filtered or not.
fn gathered(case: &Case, samples: u32, denoise: Denoise) -> Illuminated {
    let settings =
        Settings { gather: Gather::Final, samples: Some(samples), normals: case.normals, denoise, ..draft() };
    support::bake(&case.scene, &case.atlas, &settings)
}

#[test]
fn a_gather_of_few_rays_loses_more_than_half_of_its_noise() {
    for case in [room_with_a_block(24), sunroom(24)] {
        let truth = gathered(&case, 8192, Denoise::Off);
        let light =
            |baked: &Illuminated| -> Vec<f32> { baked.gathered.indirect.iter().map(|v| luminance(*v)).collect() };
        let truth = light(&truth);
        let (raw, clean) = (gathered(&case, 64, Denoise::Off), gathered(&case, 64, Denoise::Auto));
        assert_eq!(clean.denoised.as_ref().map(|d| d.filter.as_str()), Some("builtin"));
        assert!(raw.denoised.is_none());
        let (border, (raw, clean)) = (borders(&raw), (light(&raw), light(&clean)));
        let off = |which: &dyn Fn(usize) -> bool| rms(&clean, &truth, which) / rms(&raw, &truth, which);
        let (all, at_border) = (off(&|_| true), off(&|i| border[i]));
        println!("{}: error left {all:.3}, at borders {at_border:.3}", case.name);
        assert!(all < 0.5 && at_border < 0.9, "{}: {all} {at_border}", case.name);
    }
}

#[test]
fn open_image_denoise_filters_where_its_library_is() {
    let missing = Oidn::open(Some(Path::new("no/such/library.so"))).err().map(|e| e.to_string());
    assert!(missing.is_some_and(|e| e.contains("no/such/library.so")));
    if Oidn::open(None).is_err() {
        println!("skipped: no Open Image Denoise; give its library with LUMEL_OIDN");
        return;
    }
    let case = room_with_a_block(24);
    let light = |baked: &Illuminated| -> Vec<f32> { baked.gathered.indirect.iter().map(|v| luminance(*v)).collect() };
    let truth = light(&gathered(&case, 4096, Denoise::Off));
    let (raw, clean) = (gathered(&case, 64, Denoise::Off), gathered(&case, 64, Denoise::Oidn));
    assert!(clean.denoised.as_ref().is_some_and(|d| d.filter.starts_with("Open Image Denoise 2")));
    let left = rms(&light(&clean), &truth, |_| true) / rms(&light(&raw), &truth, |_| true);
    println!("error left {left:.3}");
    assert!(left < 0.8, "{left}");
}

/// Which patches have fewer than eight neighbours.
fn borders(baked: &Illuminated) -> Vec<bool> {
    let patches = &baked.patches;
    let page = &baked.lightmap.pages[0];
    let w = page.width as i64;
    let is_border = |i: usize| {
        let t = i64::from(patches.texel(i)[1]);
        let around = [-1, 1, -w, w, -w - 1, -w + 1, w - 1, w + 1];
        around.iter().any(|d| patches.at(0, (t + d) as usize).is_none_or(|j| patches.chart[j] != patches.chart[i]))
    };
    (0..patches.len()).map(is_border).collect()
}

/// Two unit squares side by side that turn by `degrees` where they meet, 0 and 1 as surfaces.
fn hinge(degrees: f32) -> Vec<Quad> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    vec![Quad::new([-1., 0., 0.], [0., 0., 1.], [1., 0., 0.]), Quad::new([0., 0., 0.], [0., 0., 1.], [cos, -sin, 0.])]
}

/// Pages of the light that each quad has, and how far it jumps across seams before and after.
fn finished(quads: &[Quad], mode: SeamMode, value: impl Fn(u32, Vec3) -> f32) -> (Vec<PageImage>, [f64; 2], f64) {
    let (scene, atlas) = (scene(quads), atlas(quads.len(), 16));
    with_lit(&scene, &atlas, |lit| {
        let patches = lit.ground.patches;
        let of = |i: usize| Rgb::splat(value(patches.surface(i), patches.position[i]));
        let to = Finish::new(*lit, mode, Gutter::Padding, Quantity::Outgoing);
        let open = Finish::new(*lit, SeamMode::Off, Gutter::Padding, Quantity::Outgoing);
        let (before, after) = (fill(&open, of), fill(&to, of));
        let flux = |pages: &[PageImage]| -> f64 {
            let of = |i: usize| f64::from(pages[0].rgb[patches.texel(i)[1] as usize].x) * f64::from(patches.area[i]);
            (0..patches.len()).map(of).sum()
        };
        let lost = flux(&after) / flux(&before) - 1.0;
        let gaps = [to.seams.gap(&before), to.seams.gap(&after)];
        (after, gaps, lost)
    })
}

#[test]
fn charts_that_differ_meet_in_the_middle_and_keep_their_light() {
    let (pages, [before, after], lost) = finished(&hinge(0.0), SeamMode::All, |s, _| 1.0 + s as f32);
    println!("gap {before:.4} to {after:.4}, light {lost:+.1e}");
    assert!((before - 2.0 / 3.0).abs() < 1e-3, "{before}");
    assert!(after < 0.01, "{after}");
    assert!(lost.abs() < 1e-4, "{lost}");
    let (scene, atlas) = (scene(&hinge(0.0)), atlas(2, 16));
    let [a, b, _] = atlas.page_texels(1, scene.surfaces[1].mesh, 0);
    let middle = bilinear(&pages[0], a.lerp(b, 0.5)).x;
    assert!((middle - 1.5).abs() < 0.02, "{middle}");
}

#[test]
fn even_light_and_gradients_across_a_seam_stay() {
    let (pages, gaps, _) = finished(&hinge(0.0), SeamMode::All, |_, _| 0.3);
    assert_eq!(gaps, [0.0; 2]);
    assert!(pages[0].rgb.iter().all(|v| v.x == 0.0 || v.x == 0.3));
    // Both sides read the nearest middle of a texel at first: half a texel of the gradient apart on either side.
    let (_, [before, after], lost) = finished(&hinge(0.0), SeamMode::All, |_, p| 2.0 + p.x);
    assert!(before < 0.04 && after < 1e-3 && lost.abs() < 1e-4, "{before} {after} {lost}");
}

#[test]
fn hard_edges_other_surfaces_and_walls_stay() {
    let differ = |s: u32, _: Vec3| 1.0 + s as f32;
    // Means by coverage are whole but for rounding.
    let is_whole = |page: &PageImage| {
        let covered = page.rgb.iter().zip(&page.coverage).filter(|(_, coverage)| **coverage > 0.0);
        covered.map(|(v, _)| (v.x - v.x.round()).abs()).fold(0.0, f32::max) < 1e-6
    };
    for (quads, mode, why) in [
        (hinge(60.0), SeamMode::All, "a hard edge"),
        (hinge(0.0), SeamMode::Surface, "two surfaces"),
        (hinge(0.0), SeamMode::Off, "off"),
    ] {
        let (pages, gaps, _) = finished(&quads, mode, differ);
        assert_eq!(gaps, [0.0; 2], "{why}");
        assert!(is_whole(&pages[0]), "{why}");
    }
    // A wall stands on the seam: the floors on its sides lie in two rooms.
    let wall = Quad::new([0., 0., 0.], [0., 0., 1.], [0., 1., 0.]).double_sided();
    let (pages, ..) = finished(&[hinge(0.0), vec![wall]].concat(), SeamMode::All, differ);
    assert!(is_whole(&pages[0]));
}

#[test]
fn charts_that_nobody_looks_at_get_no_light_of_others() {
    // The underside of a box that all but touches the floor of a bright room.
    let mut quads: Vec<Quad> = room([2., 2., 2.]);
    quads.push(Quad::new([0.7, 0.002, 0.7], [0.6, 0., 0.], [0., 0., 0.6]));
    quads.push(Quad::new([0.7, 0.6, 0.7], [0., 0., 0.6], [0.6, 0., 0.]));
    let lamp = LightShape::Point { position: Vec3::new(1., 1.7, 0.4), intensity: Rgb::splat(10.0), range: None };
    let baked = Case::of_quads("underside", &quads, 8).light(lamp).bake(&draft());
    let patches = &baked.patches;
    let of_surface = |surface: u32| (0..patches.len()).filter(move |&i| patches.surface(i) == surface);
    let shown = |i: usize| {
        let [page, texel] = baked.patches.texel(i);
        baked.lightmap.pages[page as usize].rgb[texel as usize]
    };
    assert!(of_surface(6).count() > 0 && of_surface(6).all(|i| baked.exposure.is_buried(i)));
    assert!(of_surface(6).all(|i| shown(i) == Rgb::ZERO));
    assert!(of_surface(7).all(|i| shown(i).x > 0.1));
}

#[test]
fn seams_and_filters_have_the_same_bits_on_any_number_of_threads() {
    let bits = |threads: usize| -> Vec<[u32; 3]> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let baked = pool.install(|| gathered(&sunroom(16), 16, Denoise::Builtin));
        baked.lightmap.pages[0].rgb.iter().map(|v| v.to_array().map(f32::to_bits)).collect()
    };
    assert_eq!(bits(1), bits(5));
}
