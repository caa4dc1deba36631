//! Shadows and buried texels where a first look may miss them.

mod support;

use glam::Vec3;
use lumel::color::Rgb;
use lumel::contour::point_to_polygon;
use lumel::illuminate::Illuminated;
use lumel::patch::footprint::CellMask;
use lumel::scene::{Light, LightShape};
use lumel::settings::{Quality, Settings};
use std::f32::consts::PI;
use support::{Quad, atlas, bake, bake_quads, draft, scene};

/// A floor of 2 m by 2 m.
fn floor() -> Quad {
    Quad::new([0., 0., 0.], [0., 0., 2.], [2., 0., 0.])
}

fn direct_only(quality: Quality) -> Settings {
    Settings { quality, max_bounces: Some(0), ..draft() }
}

/// The patches of the floor.
fn on_floor(baked: &Illuminated) -> impl Iterator<Item = usize> {
    (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == 0)
}

#[test]
fn a_bar_narrower_than_a_texel_casts_its_whole_shadow() {
    // A third of a texel wide, slanted so that it passes through texels at every place.
    let (texels, width) = (32, 0.02f32);
    let bar = Quad::new([-1.0, 1.0, 0.4], [4.0, 0.0, 1.1], [0.0, 0.0, width]).double_sided();
    let mut scene = scene(&[floor(), bar]);
    let direction = Vec3::new(0.01, -1.0, 0.02).normalize();
    let full = -direction.y;
    let shape = LightShape::Directional { direction, illuminance: Rgb::ONE, angle: 0.0 };
    scene.lights.push(Light::new("sun", shape));
    let baked = bake(&scene, &atlas(2, texels), &direct_only(Quality::Draft));
    // At every x the bar covers the same width.
    let mut dark = vec![0.0f32; texels as usize];
    for i in on_floor(&baked) {
        let column = (baked.patches.position[i].x * texels as f32 / 2.0) as usize;
        dark[column] += (1.0 - baked.direct.shown[i].x / full) * 2.0 / texels as f32;
    }
    let mean = dark.iter().sum::<f32>() / texels as f32;
    println!("shadow {mean:.5} of {width}; columns {dark:.3?}");
    // A texel's standard error is 4 % of full light, a column's about 18 % of its shadow, and their mean's 3 %.
    assert!((mean / width - 1.0).abs() < 0.08, "{mean} against {width}");
    assert!(dark.iter().all(|d| (d / width - 1.0).abs() < 0.7), "{dark:?}");
}

#[test]
fn the_penumbra_of_a_rectangle_has_the_error_that_is_asked_for() {
    // Half the ceiling's light is hidden by a half plane at half its height: from x, the part beyond -x is seen.
    let lamp = Quad::new([0.7, 2.0, 0.6], [0.6, 0., 0.], [0., 0., 0.8]).emission(10.0);
    let screen = Quad::new([-20., 1.0, -20.], [0., 0., 40.], [21., 0., 0.]).double_sided();
    let error = |quality| {
        let baked = bake_quads(&[floor(), lamp, screen], 32, &direct_only(quality));
        let (mut square, mut mean, mut count) = (0.0f32, 0.0f32, 0.0f32);
        for i in on_floor(&baked) {
            let p = baked.patches.position[i];
            // The screen ends at x = 1; straight lines past its edge reach the lamp's height at 2 - x.
            let from = (2.0 - p.x).clamp(0.7, 1.3);
            let corners = [(from, 0.6), (1.3, 0.6), (1.3, 1.4), (from, 1.4)].map(|(x, z)| Vec3::new(x, 2.0, z));
            let expected = 10.0 * PI * point_to_polygon(p, Vec3::Y, &corners);
            if expected > 0.0 && from > 0.7 {
                square += (baked.direct.shown[i].x - expected).powi(2);
                mean += expected;
                count += 1.0;
            }
        }
        (square / count).sqrt() / (mean / count)
    };
    let (draft, high) = (error(Quality::Draft), error(Quality::High));
    println!("draft {:.2} %, high {:.2} %", 100.0 * draft, 100.0 * high);
    // Two triangles of the lamp, each to 4 % and 0.8 % of the light around, which is more than the mean in the penumbra.
    assert!(draft < 0.08, "{draft}");
    assert!(high < 0.02, "{high}");
}

/// The five upper faces of a box with fronts outside.
fn box_on_floor(low: [f32; 3], size: [f32; 3]) -> Vec<Quad> {
    let [x, y, z] = low;
    let [w, h, d] = size;
    vec![
        Quad::new([x, y + h, z], [0., 0., d], [w, 0., 0.]),
        Quad::new([x, y, z], [0., 0., d], [0., h, 0.]),
        Quad::new([x + w, y, z], [0., h, 0.], [0., 0., d]),
        Quad::new([x, y, z], [0., h, 0.], [w, 0., 0.]),
        Quad::new([x, y, z + d], [w, 0., 0.], [0., h, 0.]),
    ]
}

#[test]
fn one_buried_texel_of_sixteen_is_found_and_so_is_its_rim() {
    // Texels of 1/16 m: the box stands on one of them, and on half of the next.
    let texel = 1.0 / 16.0;
    let mut quads = vec![floor()];
    quads.extend(box_on_floor([13.0 * texel, -0.01, 9.0 * texel], [1.5 * texel, 0.3, texel]));
    let baked = bake_quads(&quads, 32, &draft());
    for i in on_floor(&baked) {
        let p = baked.patches.position[i] / texel;
        let cells = baked.exposure.cells[i].0.count_ones();
        let expected = match (p.x as u32, p.z as u32) {
            (13, 9) => 0..=0,
            (14, 9) => 6..=10,
            _ => 16..=16,
        };
        assert!(expected.contains(&cells), "{cells} cells open at {p}");
    }
}

#[test]
fn a_wall_narrower_than_a_texel_is_followed_to_its_end() {
    let texel = 1.0 / 16.0;
    let mut quads = vec![floor()];
    quads.extend(box_on_floor([2.0 * texel, -0.01, 10.25 * texel], [28.0 * texel, 0.5, 0.5 * texel]));
    let baked = bake_quads(&quads, 32, &draft());
    for i in on_floor(&baked) {
        let p = baked.patches.position[i] / texel;
        let is_under = (2.0..30.0).contains(&p.x) && p.z as u32 == 10;
        let is_whole = baked.exposure.cells[i] == CellMask::ALL;
        assert_ne!(is_under, is_whole, "{:016b} at {p}", baked.exposure.cells[i].0);
    }
}
