//! Adaptive density: texels go where light varies, their number stays, and what they miss falls; judged by light known in closed form.

mod support;

use glam::{Vec2, Vec3};
use lumel::adaptive::{adapt, densities};
use lumel::color::luminance;
use lumel::error::Warnings;
use lumel::illuminate::illuminate;
use lumel::post::Quantity;
use lumel::progress::Silent;
use lumel::scene::{Light, LightShape, Scene, UvSet};
use lumel::settings::Settings;
use lumel::unwrap::{Atlas, Importance, UnwrapParams, UvMode, unwrap};
use support::{Quad, draft, room, scene};

const LAMP: Vec3 = Vec3::new(2.0, 2.0, 2.0);
const INTENSITY: f32 = 100.0;
/// The slats above the floor: the low corner of the first and the sides of all of them, the way from one to the next, and their number.
const SLAT: [Vec3; 2] = [Vec3::new(1.3, 0.4, 1.3), Vec3::new(0.11, 0.0, 0.9)];
const NEXT: f32 = 0.22;
const SLATS: usize = 7;

/// A room of 4 x 3 x 4 m, and slats in it that throw sharp shadows on the floor, quad 0: their edges take more of the area than the
/// hundredth that doesn't count.
fn quads() -> Vec<Quad> {
    let [low, size] = SLAT;
    let slat = |k: usize| {
        let corner = low + Vec3::X * (NEXT * k as f32);
        Quad::new(corner.to_array(), [0.0, 0.0, size.z], [size.x, 0.0, 0.0]).double_sided()
    };
    room([4.0, 3.0, 4.0]).into_iter().chain((0..SLATS).map(slat)).collect()
}

fn shadowed() -> Scene {
    let mut scene = scene(&quads());
    let intensity = Vec3::splat(INTENSITY);
    scene.lights.push(Light::new("lamp", LightShape::Point { position: LAMP, intensity, range: None }));
    scene
}

/// Light straight from the lamp alone.
fn settings() -> Settings {
    Settings {
        density: Some(20.0),
        page_size: Some(512),
        max_bounces: Some(0),
        uv: UvMode::New,
        quantity: Quantity::Irradiance,
        adaptive_density: Some(1.0),
        ..draft()
    }
}

fn factors(scene: &Scene, settings: &Settings) -> Importance {
    adapt(scene, settings, &mut Warnings::default(), &Silent).unwrap().expect("charts can be made denser").0
}

fn laid_out(scene: &Scene, settings: &Settings, importance: Option<Importance>) -> Atlas {
    unwrap(scene, &UnwrapParams { importance, ..settings.unwrap_params() }, &Silent).unwrap().0
}

/// Texels of the shown surfaces.
fn texels(scene: &Scene, atlas: &Atlas) -> f64 {
    let all = (0..scene.surfaces.len()).filter(|s| atlas.is_shown(*s)).flat_map(|s| [(s, 0), (s, 1)]);
    all.map(|(s, t)| {
        let [a, b, c] = atlas.page_texels(s, scene.surfaces[s].mesh, t);
        0.5 * f64::from((b - a).perp_dot(c - a).abs())
    })
    .sum()
}

/// Irradiance at `point` about `normal` [lx].
fn truth(point: Vec3, normal: Vec3) -> f32 {
    let way = LAMP - point;
    let at = point + way * ((SLAT[0].y - point.y) / way.y);
    let is_on = |k: usize| {
        let on = (at - SLAT[0] - Vec3::X * (NEXT * k as f32)) / SLAT[1].with_y(1.0);
        on.x.clamp(0.0, 1.0) == on.x && on.z.clamp(0.0, 1.0) == on.z
    };
    if point.y < SLAT[0].y - 1e-4 && (0..SLATS).any(is_on) {
        return 0.0;
    }
    INTENSITY * way.normalize().dot(normal).max(0.0) / way.length_squared()
}

/// What a bake on `atlas` misses of the light in the room as an engine reads it: root mean square over the mean.
fn missed(scene: &Scene, atlas: &Atlas, settings: &Settings) -> f64 {
    let lit = illuminate(scene, atlas, settings, &Silent).unwrap();
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for (s, quad) in quads().iter().enumerate().take(6) {
        let page = &lit.lightmap.pages[atlas.placements[s].page as usize];
        let [width, height] = [page.width, page.height];
        let (columns, rows) = ((quad.u.length() * 47.0) as u32, (quad.v.length() * 47.0) as u32);
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            let [u, v] = [(x as f32 + 0.5) / columns as f32, (y as f32 + 0.5) / rows as f32];
            let (triangle, weights) = if u >= v { (0, [1.0 - u, u - v, v]) } else { (1, [1.0 - v, u, v - u]) };
            let corners = atlas.page_texels(s, scene.surfaces[s].mesh, triangle);
            let at: Vec2 = (0..3).map(|k| corners[k] * weights[k]).sum::<Vec2>() - 0.5;
            let low = at.floor();
            let part = at - low;
            let texel = |dx: u32, dy: u32| {
                let x = (low.x as u32 + dx).min(width - 1);
                let y = (low.y as u32 + dy).min(height - 1);
                luminance(page.rgb[(y * width + x) as usize])
            };
            let [top, bottom] = [0, 1].map(|dy| texel(0, dy) * (1.0 - part.x) + texel(1, dy) * part.x);
            let read = top * (1.0 - part.y) + bottom * part.y;
            let known = truth(quad.corner + quad.u * u + quad.v * v, quad.u.cross(quad.v).normalize());
            squares += f64::from(read - known).powi(2);
            sum += f64::from(known);
            count += 1.0;
        }
    }
    (squares / f64::from(count as f32)).sqrt() / (sum / count)
}

#[test]
fn sharp_shadows_get_more_texels_and_the_error_falls() {
    let (scene, settings) = (shadowed(), settings());
    let importance = factors(&scene, &settings);
    let even = laid_out(&scene, &settings, None);
    let varied = laid_out(&scene, &settings, Some(importance));
    let ratio = texels(&scene, &varied) / texels(&scene, &even);
    assert!((0.99..1.01).contains(&ratio), "as many texels: {ratio}");
    let gain = |s: usize| varied.surface_density(&scene, s) / even.surface_density(&scene, s);
    assert!(gain(0) > 1.2, "the floor has the shadows: {}", gain(0));
    assert!((1..6).all(|s| gain(s) < 1.0), "walls pay for it: {:?}", (1..6).map(gain).collect::<Vec<_>>());
    let found = densities(&scene, &varied);
    assert!(found.charts == 6 + SLATS && found.least <= found.median && found.most > 1.2 * 20.0, "{found:?}");
    let [before, after] = [&even, &varied].map(|atlas| missed(&scene, atlas, &settings));
    assert!(after < 0.9 * before, "{after} after {before}");
}

#[test]
fn a_filled_page_has_as_many_texels() {
    let scene = shadowed();
    for side in [128, 200, 256] {
        let settings = Settings { density: None, page_size: None, resolution: Some(side), ..settings() };
        let importance = factors(&scene, &settings);
        assert!(importance.of(0, 0) > 1.2, "{importance:?}");
        let [even, varied] = [None, Some(importance)].map(|i| laid_out(&scene, &settings, i));
        assert_eq!(varied.pages, [[side, side]]);
        let ratio = texels(&scene, &varied) / texels(&scene, &even);
        assert!((0.98..1.01).contains(&ratio), "{side}: {ratio}");
        let gain = varied.surface_density(&scene, 0) / even.surface_density(&scene, 0);
        assert!(gain > 1.05, "{side}: {gain}");
    }
}

#[test]
fn strength_goes_part_of_the_way() {
    let scene = shadowed();
    let [whole, half] = [1.0, 0.5].map(|strength| {
        let settings = Settings { adaptive_density: Some(strength), ..settings() };
        factors(&scene, &settings).of(0, 0)
    });
    assert!(whole > 1.2 && (half * half / whole - 1.0).abs() < 1e-4, "{half} of {whole}");
    let off = Settings { adaptive_density: Some(0.0), ..settings() };
    assert!(adapt(&scene, &off, &mut Warnings::default(), &Silent).unwrap().is_none());
}

#[test]
fn a_furnace_stays_even() {
    let walls: Vec<Quad> = room([4.0, 3.0, 4.0]).into_iter().map(|q| q.emission(1.0)).collect();
    let settings = Settings { max_bounces: None, ..settings() };
    let found = factors(&scene(&walls), &settings);
    let all: Vec<f64> = (0..6).map(|m| found.of(m, 0)).collect();
    assert!(all.iter().all(|f| (f - 1.0).abs() < 0.05), "{all:?}");
}

#[test]
fn noise_is_not_taken_for_detail() {
    // A small lamp in a room lights the rest by way of its ceiling: smooth, and found with few samples. No factor may follow the noise.
    let mut walls = room([4.0, 3.0, 4.0]);
    walls.iter_mut().for_each(|q| q.albedo = 0.7);
    let mut scene = scene(&walls);
    let intensity = Vec3::splat(INTENSITY);
    scene.lights.push(Light::new("lamp", LightShape::Point { position: LAMP, intensity, range: None }));
    let found = [0, 1, 2].map(|seed| {
        let settings = Settings { max_bounces: None, seed, ..settings() };
        let found = factors(&scene, &settings);
        (0..6).map(|m| found.of(m, 0)).collect::<Vec<f64>>()
    });
    for chart in 0..6 {
        let [a, b, c] = [0, 1, 2].map(|k| found[k][chart]);
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        assert!(most / least < 1.15, "chart {chart}: {found:?}");
    }
}

#[test]
fn instances_have_one_factor_and_hidden_surfaces_their_texels() {
    let mut scene = shadowed();
    // The west wall twice, once where the east wall was, turned to the room; the ceiling is not shown.
    scene.surfaces[3].mesh = 2;
    scene.surfaces[3].world_from_local = glam::Affine3A::from_translation(Vec3::X * 4.0);
    scene.surfaces[1].role.lightmapped = false;
    let settings = settings();
    let importance = factors(&scene, &settings);
    assert_eq!(importance.factors[1], [1.0]);
    let varied = laid_out(&scene, &settings, Some(importance));
    let density = |s: usize| varied.surface_density(&scene, s);
    assert!((density(2) / density(3) - 1.0).abs() < 1e-3);
    let even = laid_out(&scene, &settings, None);
    let ratio = texels(&scene, &varied) / texels(&scene, &even);
    assert!((0.99..1.01).contains(&ratio), "as many shown texels: {ratio}");
}

#[test]
fn authored_uvs_are_left_with_a_warning() {
    let mut scene = shadowed();
    for mesh in &mut scene.meshes {
        let coords = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].to_vec();
        mesh.uvs.push(UvSet { name: "TEXCOORD_1".into(), coords });
    }
    let mut warnings = Warnings::default();
    let kept = Settings { uv: UvMode::Keep, ..settings() };
    assert!(adapt(&scene, &kept, &mut warnings, &Silent).unwrap().is_none());
    assert!(warnings.iter().any(|w| w.message.contains("--uv new")), "{warnings:?}");
}

#[test]
fn factors_are_equal_at_any_number_of_threads() {
    let scene = shadowed();
    let settings = Settings { max_bounces: None, ..settings() };
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| factors(&scene, &settings))
    });
    assert_eq!(one, three);
}
