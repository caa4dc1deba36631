//! Where the light ends on coarse meshes that are shown round.

mod support;

use glam::Vec3;
use lumel::color::Rgb;
use lumel::illuminate::Illuminated;
use lumel::scene::{Light, LightShape, Scene};
use lumel::settings::{Normals, Quality, Settings};
use support::{Quad, bake, draft, mesh_atlas, mesh_scene, sphere, triangles};

const RADIUS: f32 = 0.5;

/// A ball of 8 by 16 faces around the origin, and more surfaces, under a sun of 1 lx along `direction`.
fn ball(direction: Vec3, others: &[Vec<[Vec3; 3]>], with_normals: bool) -> (Scene, Vec<Vec<[Vec3; 3]>>) {
    let mut surfaces = vec![sphere(Vec3::ZERO, RADIUS, 8, false)];
    surfaces.extend_from_slice(others);
    let mut scene = mesh_scene(&surfaces);
    if with_normals {
        scene.meshes[0].normals = scene.meshes[0].positions.iter().map(|p| p.normalize()).collect();
    }
    let shape = LightShape::Directional { direction: direction.normalize(), illuminance: Rgb::ONE, angle: 0.0 };
    scene.lights.push(Light::new("sun", shape));
    (scene, surfaces)
}

fn lit(scene: &Scene, surfaces: &[Vec<[Vec3; 3]>], normals: Normals) -> Illuminated {
    let settings = Settings { quality: Quality::Medium, max_bounces: Some(0), normals, ..draft() };
    bake(scene, &mesh_atlas(surfaces, 16), &settings)
}

/// Mean and largest difference to a true ball's light over the patches of the coarse one.
fn errors(direction: Vec3, normals: Normals) -> [f32; 2] {
    let (scene, surfaces) = ball(direction, &[], true);
    let baked = lit(&scene, &surfaces, normals);
    let (mut sum, mut area, mut worst) = (0.0, 0.0, 0.0f32);
    for i in 0..baked.patches.len() {
        let expected = baked.patches.position[i].normalize().dot(-direction.normalize()).max(0.0);
        let error = (baked.direct.shown[i].x - expected).abs();
        sum += error * baked.patches.area[i];
        area += baked.patches.area[i];
        worst = worst.max(error);
    }
    [sum / area, worst]
}

#[test]
fn a_coarse_ball_is_lit_as_a_round_one() {
    for direction in [Vec3::new(0.0, -1.0, 0.0), Vec3::new(-1.0, -0.3, 0.2), Vec3::new(0.4, -0.7, 0.9)] {
        let [mean, worst] = errors(direction, Normals::Shading);
        let [flat_mean, flat_worst] = errors(direction, Normals::Geometric);
        println!("{direction}: mean {mean:.4}, worst {worst:.4}; flat {flat_mean:.4}, {flat_worst:.4}");
        assert!(mean < 0.01, "{mean}");
        // A facet that turns its back on the light all at once is off by 0.19.
        assert!(worst < 0.06, "{worst}");
        assert!(flat_worst > 0.1, "{flat_worst}");
    }
}

#[test]
fn geometric_normals_know_nothing_of_interpolated_ones() {
    let direction = Vec3::new(-1.0, -0.3, 0.2);
    let [with, without] = [true, false].map(|with| {
        let (scene, surfaces) = ball(direction, &[], with);
        let baked = lit(&scene, &surfaces, Normals::Geometric);
        (0..baked.patches.len()).map(|i| baked.direct.shown[i].to_array().map(f32::to_bits)).collect::<Vec<_>>()
    });
    assert!(with == without, "light about geometric normals depends on interpolated ones");
}

#[test]
fn no_light_comes_through_a_wall_that_the_round_ball_would_reach_through() {
    // The ball's corners poke through the wall, behind which the sun is; what a true ball would have beyond it, the mesh has not.
    let wall = 0.495;
    let wall_face = Quad::new([wall, -2., -2.], [0., 4., 0.], [0., 0., 4.]).double_sided();
    let (mut scene, surfaces) = ball(Vec3::NEG_X, &[triangles(&wall_face)], true);
    scene.materials[0].double_sided = true;
    let baked = lit(&scene, &surfaces, Normals::Shading);
    let (mut count, mut leak) = (0, 0.0f32);
    for i in (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == 0) {
        if (0.0..wall - 0.005).contains(&baked.patches.position[i].x) {
            count += 1;
            leak = leak.max(baked.direct.shown[i].x);
        }
    }
    assert!(count > 1000, "{count}");
    // Next to nothing, by planes through texels beside the wall.
    assert!(leak < 1e-3, "{leak}");
}
