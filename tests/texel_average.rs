//! A texel that a sharp shadow's edge cuts holds the share of its area that is lit.

mod support;

use glam::{Vec2, Vec3};
use lumel::color::Rgb;
use lumel::illuminate::Illuminated;
use lumel::scene::{Light, LightShape};
use lumel::settings::{Quality, Settings};
use support::{Quad, atlas, bake, draft, scene};

/// Texels along each side of the floor of 2 m by 2 m.
const TEXELS: u32 = 40;
const TEXEL: f32 = 2.0 / TEXELS as f32;

/// The floor under a sun without an angle, which shines straight down, and `screens`: light alone that comes straight.
fn under_the_sun(screens: &[Quad]) -> Illuminated {
    let mut quads = vec![Quad::new([0., 0., 0.], [0., 0., 2.], [2., 0., 0.])];
    quads.extend(screens);
    let mut scene = scene(&quads);
    let shape = LightShape::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::ONE, angle: 0.0 };
    scene.lights.push(Light::new("sun", shape));
    let settings = Settings { quality: Quality::Medium, max_bounces: Some(0), ..draft() };
    bake(&scene, &atlas(quads.len(), TEXELS), &settings)
}

/// A screen 1 m above the floor, `width` wide from the line through the floor's middle at `angle` [rad] on.
fn screen(angle: f32, width: f32) -> Quad {
    let (along, across) = (Vec3::new(angle.cos(), 0.0, angle.sin()), Vec3::new(-angle.sin(), 0.0, angle.cos()));
    let corner = Vec3::new(1.0, 1.0, 1.0) - 3.0 * along;
    Quad { corner, ..Quad::new([0.; 3], (6.0 * along).into(), (width * across).into()).double_sided() }
}

/// The share of the texel around `centre` on the side of the half plane `normal . p >= distance`.
fn share(centre: Vec2, normal: Vec2, distance: f32) -> f32 {
    let half = TEXEL / 2.0;
    let square = [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| centre + Vec2::new(x, y));
    let height = |p: Vec2| normal.dot(p) - distance;
    let mut part = Vec::new();
    for (k, &a) in square.iter().enumerate() {
        let b = square[(k + 1) % 4];
        if height(a) >= 0.0 {
            part.push(a);
        }
        if (height(a) >= 0.0) != (height(b) >= 0.0) {
            part.push(a.lerp(b, height(a) / (height(a) - height(b))));
        }
    }
    let area: f32 = (0..part.len()).map(|k| part[k].perp_dot(part[(k + 1) % part.len()])).sum();
    area / 2.0 / (TEXEL * TEXEL)
}

/// Errors of the floor's texels that a strip of `width` from the line at `angle` on cuts: mean, largest, and how much of the
/// shadow's area is missing.
fn errors(angle: f32, width: f32) -> [f32; 3] {
    let baked = under_the_sun(&[screen(angle, width)]);
    let across = Vec2::new(-angle.sin(), angle.cos());
    let from = across.dot(Vec2::ONE);
    let (mut sum, mut worst, mut count, mut shadow, mut whole) = (0.0f32, 0.0f32, 0, 0.0, 0.0);
    for i in (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == 0) {
        let p = baked.patches.position[i];
        let at = Vec2::new(p.x, p.z);
        let dark = share(at, across, from) - share(at, across, from + width);
        let error = baked.direct.shown[i].x - (1.0 - dark);
        shadow += 1.0 - baked.direct.shown[i].x;
        whole += dark;
        if dark > 1e-3 && dark < 1.0 - 1e-3 {
            sum += error.abs();
            worst = worst.max(error.abs());
            count += 1;
        } else {
            // Planes through neighbours may take a trace from one texel to the next.
            assert!(error.abs() < 0.01, "{error} at {p}");
        }
    }
    assert!(count > 30, "{count} texels are cut");
    [sum / count as f32, worst, shadow / whole - 1.0]
}

#[test]
fn texels_cut_by_a_sun_edge_hold_the_share_that_is_lit() {
    for degrees in [0.3f32, 7.0, 18.4, 30.0, 45.0, 61.0, 89.0] {
        let [mean, worst, area] = errors(degrees.to_radians(), 4.0);
        println!("{degrees} degrees: mean {:.2} %, worst {:.2} %, area {:+.3} %", 1e2 * mean, 1e2 * worst, 1e2 * area);
        assert!(mean < 0.02, "{degrees} degrees: mean error {mean}");
        assert!(worst < 0.05, "{degrees} degrees: worst error {worst}");
        assert!(area.abs() < 0.002, "{degrees} degrees: {area} of the shadow's area");
    }
}

#[test]
fn a_rod_a_fifth_of_a_texel_wide_keeps_its_shadow() {
    for degrees in [2.0f32, 18.4, 45.0, 70.0] {
        let [mean, worst, area] = errors(degrees.to_radians(), TEXEL / 5.0);
        println!("{degrees} degrees: mean {:.2} %, worst {:.2} %, area {:+.3} %", 1e2 * mean, 1e2 * worst, 1e2 * area);
        // Each texel holds two edges, whose deviations add up.
        assert!(mean < 0.03, "{degrees} degrees: mean error {mean}");
        assert!(worst < 0.1, "{degrees} degrees: worst error {worst}");
        assert!(area.abs() < 0.03, "{degrees} degrees: {area} of the shadow's area");
    }
}
