//! Kinds of light against what is known on paper: profiles, pictures, projectors, portals, skies, links.

mod support;

use glam::{Affine3A, Mat3, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::contour::point_to_polygon;
use lumel::illuminate::Illuminated;
use lumel::scene::clear_sky::ClearSky;
use lumel::scene::projector::{TargetPlane, Throw};
use lumel::scene::web::WebKind;
use lumel::scene::{
    Environment, Light, LightShape, Linked, Links, PhotometricWeb, Picture, Profile, Projector, Scene, Shaping, Texels,
    Texture,
};
use lumel::settings::{Method, Quality, Settings};
use std::f32::consts::PI;
use std::sync::Arc;
use support::{Quad, atlas, bake, draft, scene};

/// Texels along each side of a floor.
const SIDE: u32 = 32;

/// A black floor of two metres around the origin, facing up.
fn floor() -> Quad {
    Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0)
}

/// Direct light alone: the floor is black.
fn lit(scene: &Scene) -> Illuminated {
    bake(scene, &atlas(scene.surfaces.len(), SIDE), &draft())
}

/// The largest difference of the texels of `surface` from `expected` of their middles, relative to the largest of those.
fn worst(baked: &Illuminated, surface: u32, expected: impl Fn(Vec3) -> f32) -> f32 {
    let patches = &baked.patches;
    let of = (0..patches.len()).filter(|&i| patches.surface(i) == surface);
    let all: Vec<(f32, f32)> = of.map(|i| (baked.gathered.irradiance[i].x, expected(patches.position[i]))).collect();
    let most = all.iter().map(|a| a.1).fold(0.0, f32::max);
    all.iter().map(|(found, expected)| (found - expected).abs()).fold(0.0, f32::max) / most.max(f32::MIN_POSITIVE)
}

fn mean(baked: &Illuminated, surface: u32) -> Rgb {
    let of: Vec<usize> = (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == surface).collect();
    of.iter().map(|&i| baked.gathered.irradiance[i]).sum::<Rgb>() / of.len() as f32
}

fn point(position: Vec3, intensity: f32) -> Light {
    Light::new("lamp", LightShape::Point { position, intensity: Rgb::splat(intensity), range: None })
}

/// Axes of a light that shines along `axis` with +Y of its picture towards `up`.
fn aimed(axis: Vec3, up: Vec3) -> Mat3 {
    let right = axis.cross(up).normalize();
    Mat3::from_cols(right, right.cross(axis), -axis)
}

/// A picture whose texel (x, y) has the grey `value`.
fn grey(width: u32, height: u32, value: impl Fn(u32, u32) -> f32) -> Texture {
    let texel = |k: u32| {
        let v = value(k % width, k / width);
        [v, v, v, 1.0]
    };
    Texture { name: "picture".into(), width, height, texels: Texels::Float((0..width * height).map(texel).collect()) }
}

/// A type C web that is round about the beam.
fn round_web(intensity: impl Fn(f32) -> f32) -> PhotometricWeb {
    let vertical: Vec<f32> = (0..=180).map(|d| (d as f32).to_radians()).collect();
    let column: Vec<f32> = vertical.iter().map(|v| intensity(*v)).collect();
    PhotometricWeb {
        name: "round".into(),
        kind: WebKind::C,
        horizontal: vec![0.0, 2.0 * PI],
        candela: [column.clone(), column].concat(),
        vertical,
        rated_lumens: None,
        tilt: Vec::new(),
    }
}

#[test]
fn a_profile_lights_a_plane_by_its_intensities() {
    let at = Vec3::new(0.2, 1.5, -0.1);
    // cos^2 over a sphere: 4 pi / 6 lm per cd, half of the sphere.
    let web = round_web(|v| 90.0 * v.cos().max(0.0).powi(2));
    assert!((web.power() / (90.0 * 2.0 * f64::from(PI) / 3.0) - 1.0).abs() < 1e-3);
    let mut lamp = point(at, 2.0);
    lamp.world_from_light = aimed(Vec3::NEG_Y, Vec3::Z);
    let web_from_light = Mat3::from_diagonal(Vec3::new(1.0, 1.0, -1.0));
    lamp.profile = Some(Profile { web: Arc::new(web), scale: 0.5, angle_scale: 0.0, web_from_light });
    let mut scene = scene(&[floor()]);
    scene.lights.push(lamp.clone());
    let expected = |p: Vec3| {
        let way = at - p;
        let cos = way.y / way.length();
        90.0 * cos * cos * cos / way.length_squared()
    };
    let off = worst(&lit(&scene), 0, expected);
    assert!(off < 0.005, "{off}");
    // Twice as wide: the intensity at an angle is that of half of it.
    if let Some(profile) = &mut scene.lights[0].profile {
        profile.angle_scale = 2.0;
    }
    let expected = |p: Vec3| {
        let way = at - p;
        let theta = (way.y / way.length()).acos();
        90.0 * (0.5 * theta).cos().powi(2) * theta.cos() / way.length_squared()
    };
    let off = worst(&lit(&scene), 0, expected);
    assert!(off < 0.005, "{off}");
}

#[test]
fn a_focus_is_a_power_of_the_cosine() {
    let at = Vec3::new(0.0, 1.5, 0.0);
    let mut lamp = point(at, 10.0);
    let shaping = Shaping { axis: Vec3::NEG_Y, cone_angle: PI, cone_softness: 0.0, focus: 3.0, focus_tint: Rgb::ZERO };
    lamp.shaping = Some(shaping);
    let mut scene = scene(&[floor()]);
    scene.lights.push(lamp);
    let expected = |p: Vec3| {
        let way = at - p;
        10.0 * (way.y / way.length()).powi(4) / way.length_squared()
    };
    let off = worst(&lit(&scene), 0, expected);
    assert!(off < 0.005, "{off}");
    // A white tint leaves the light as it is (UsdLux ShapingAPI, focusTint).
    assert_eq!(Shaping { focus_tint: Rgb::ONE, ..shaping }.factor(Vec3::X), Rgb::ONE);
}

#[test]
fn a_rect_light_shows_its_texture() {
    // Bright in its first quarter, which is at +X, +Y of the light.
    let mut scene = scene(&[floor()]);
    scene.textures.push(grey(16, 16, |x, y| if x < 4 && y < 6 { 5.0 } else { 0.25 + 0.01 * (x % 2) as f32 }));
    // Facing down, +X of the light is +X, +Y is -Z.
    let (center, u, v) = (Vec3::new(0.1, 0.8, 0.0), Vec3::X * 0.5, Vec3::NEG_Z * 0.4);
    let shape = LightShape::Rect { center, u, v, radiance: Rgb::new(2.0, 1.0, 0.5) };
    let mut lamp = Light::new("lamp", shape);
    lamp.picture = Some(Picture::OnLight(0));
    scene.lights.push(lamp);
    let n = 96;
    let picture = &scene.textures[0];
    let cells: Vec<(Vec3, f32)> = (0..n * n)
        .map(|k| {
            let (s, t) = ((k % n) as f32 + 0.5, (k / n) as f32 + 0.5);
            let uv = Vec2::new(s, t) / n as f32;
            let at = center + u * (1.0 - 2.0 * uv.x) + v * (1.0 - 2.0 * uv.y);
            let l = picture.sample(uv, [lumel::scene::Wrap::Clamp; 2]).x;
            (at, 2.0 * l * (4.0 * 0.5 * 0.4) / (n * n) as f32)
        })
        .collect();
    let expected = |p: Vec3| {
        let from = |(at, power): &(Vec3, f32)| {
            let way = *at - p;
            power * way.y * way.y / way.length_squared().powi(2)
        };
        cells.iter().map(from).sum::<f32>()
    };
    for method in [Method::Radiosity, Method::Path] {
        let settings = Settings { method, samples: (method == Method::Path).then_some(512), ..draft() };
        let baked = bake(&scene, &atlas(1, SIDE), &settings);
        let off = worst(&baked, 0, expected);
        let patches = &baked.patches;
        let sum: f32 = (0..patches.len()).map(|i| expected(patches.position[i])).sum();
        let bias = baked.gathered.irradiance.iter().map(|e| e.x).sum::<f32>() / sum - 1.0;
        println!("{method:?}: worst {off:.4}, bias {bias:+.5}");
        assert!(off < 0.12 && bias.abs() < 0.004, "{method:?}: worst {off}, bias {bias}");
        assert!(baked.gathered.irradiance.iter().all(|e| (e.y / e.x - 0.5).abs() < 1e-3));
    }
}

/// Where the light of `baked` lies on its floor: the mean of positions by illuminance.
fn centroid(baked: &Illuminated) -> Vec3 {
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for (p, e) in baked.patches.position.iter().zip(&baked.gathered.irradiance) {
        sum += *p * e.x;
        total += e.x;
    }
    sum / total
}

#[test]
fn a_projector_s_picture_lands_where_geometry_says() {
    let position = Vec3::new(0.1, 2.0, 1.2);
    let axis = (Vec3::new(0.05, 0.0, -0.1) - position).normalize();
    let axes = aimed(axis, Vec3::Y);
    let texel = 2.0 / 64.0;
    let target = TargetPlane { point: Vec3::ZERO, normal: Vec3::Y, up: Some(Vec3::NEG_Z) };
    for target in [None, Some(target)] {
        let throw = Throw { fov: 0.5, aspect: 1.0, target };
        let projector = Projector::new(0, position, axes, &throw).unwrap();
        for (x, y) in [(16, 16), (3, 4), (28, 5), (10, 27)] {
            let mut scene = scene(&[floor()]);
            // One bright texel of 32 x 32.
            scene.textures.push(grey(32, 32, |i, j| if (i, j) == (x, y) { 1.0 } else { 0.0 }));
            let mut lamp = point(position, 100.0);
            lamp.world_from_light = axes;
            lamp.picture = Some(Picture::Thrown(projector.clone()));
            scene.lights.push(lamp);
            let settings = Settings { quality: Quality::Medium, ..draft() };
            let found = centroid(&bake(&scene, &atlas(1, 64), &settings));
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / 32.0 - 0.5;
            let expected = match target {
                None => {
                    let half = 0.25f32.tan();
                    let d = axis + axes.x_axis * (2.0 * half * uv.x) - axes.y_axis * (2.0 * half * uv.y);
                    position + d * (position.y / -d.y)
                }
                Some(_) => {
                    // The picture's middle, and its size across the beam at that distance.
                    let distance = position.y / -axis.y;
                    let width = 2.0 * distance * 0.25f32.tan();
                    position + axis * distance + Vec3::X * (uv.x * width) + Vec3::Z * (uv.y * width)
                }
            };
            let off = found.distance(expected);
            assert!(off < texel, "{x} {y}, keystone {}: {found} is not {expected}", target.is_some());
        }
    }
}

#[test]
fn a_constant_sky_through_a_portal_is_a_rect_light() {
    // A portal above the floor that lets light down, half of it shut from above.
    let lid = Quad::new([0.0, 1.5, -1.5], [1.5, 0., 0.], [0., 0., 3.0]).albedo(0.0);
    let mut scene = scene(&[floor(), lid.double_sided()]);
    let sky = Arc::new(Environment::constant("dome", Rgb::splat(3.0)));
    // -(u x v) points down.
    let (center, u, v) = (Vec3::new(0.0, 1.0, 0.0), Vec3::X * 0.5, Vec3::NEG_Z * 0.5);
    scene.lights.push(Light::new("dome", LightShape::Portal { center, u, v, sky }));
    let fine = Settings { quality: Quality::High, ..draft() };
    let baked = bake(&scene, &atlas(2, SIDE), &fine);
    let corners = [center - u - v, center - u + v, center + u + v, center + u - v];
    // Straight below the middle: what goes to the left of the lid's edge as it is seen through the portal.
    let open = |p: Vec3| {
        let edge = p.x + (0.0 - p.x) * (1.0 - p.y) / (1.5 - p.y);
        let right = edge.clamp(-0.5, 0.5);
        let cut = [corners[0], corners[1], Vec3::new(right, 1.0, -0.5), Vec3::new(right, 1.0, 0.5)];
        3.0 * PI * point_to_polygon(p, Vec3::Y, &cut)
    };
    let off = worst(&baked, 0, open);
    assert!(off < 0.05, "{off}");
    // Whole portal: exact.
    scene.surfaces.pop();
    let off = worst(&bake(&scene, &atlas(1, SIDE), &draft()), 0, |p| 3.0 * PI * point_to_polygon(p, Vec3::Y, &corners));
    assert!(off < 0.015, "{off}");
    // From its other side nothing comes.
    if let LightShape::Portal { v, .. } = &mut scene.lights[0].shape {
        *v = -*v;
    }
    assert_eq!(mean(&bake(&scene, &atlas(1, SIDE), &draft()), 0), Rgb::ZERO);
}

/// A sky with a bright spot to one side.
fn sky_picture() -> Texture {
    grey(64, 32, |x, y| if (20..24).contains(&x) && (8..11).contains(&y) { 40.0 } else { 0.3 })
}

#[test]
fn a_picture_through_a_portal_agrees_with_paths_and_with_an_opening() {
    let (center, u, v) = (Vec3::new(0.0, 1.0, 0.0), Vec3::X * 0.6, Vec3::NEG_Z * 0.6);
    let mut scene = scene(&[floor()]);
    scene.textures.push(sky_picture());
    let sky = Environment { texture: Some(0), ..Environment::constant("dome", Rgb::ONE) };
    let mut through = scene.clone();
    through.lights.push(Light::new("dome", LightShape::Portal { center, u, v, sky: Arc::new(sky.clone()) }));
    let by_blocks = mean(&bake(&through, &atlas(1, SIDE), &Settings { quality: Quality::High, ..draft() }), 0);
    let paths = Settings { method: Method::Path, samples: Some(512), ..draft() };
    let by_paths = mean(&bake(&through, &atlas(1, SIDE), &paths), 0);
    // The same as a hole in a wide black roof.
    let hole = |corner: [f32; 3], a: [f32; 3], b: [f32; 3]| Quad::new(corner, a, b).albedo(0.0).double_sided();
    let (w, h) = (40.0, 0.6);
    let roof = [
        hole([-w, 1., -w], [w - h, 0., 0.], [0., 0., 2. * w]),
        hole([h, 1., -w], [w - h, 0., 0.], [0., 0., 2. * w]),
        hole([-h, 1., -w], [2. * h, 0., 0.], [0., 0., w - h]),
        hole([-h, 1., h], [2. * h, 0., 0.], [0., 0., w - h]),
    ];
    let mut open = support::scene(&[floor(), roof[0], roof[1], roof[2], roof[3]]);
    open.textures.push(sky_picture());
    open.environment = Some(sky);
    let by_hole = mean(&bake(&open, &atlas(5, SIDE), &paths), 0);
    println!("{} {} {}", by_blocks.x, by_paths.x, by_hole.x);
    assert!((by_blocks.x / by_hole.x - 1.0).abs() < 0.02, "{by_blocks} {by_hole}");
    assert!((by_paths.x / by_hole.x - 1.0).abs() < 0.02, "{by_paths} {by_hole}");
}

#[test]
fn skies_add_up() {
    let plain = scene(&[floor(), Quad::new([-0.3, 0.5, -0.3], [0., 0., 0.6], [0.6, 0., 0.]).double_sided()]);
    let settings = Settings { quality: Quality::High, ..draft() };
    let with = |skies: Vec<Environment>| {
        let mut scene = plain.clone();
        scene.textures = vec![sky_picture(), grey(32, 16, |x, _| 0.1 * x as f32)];
        let mut skies = skies.into_iter();
        let mut first = skies.next().unwrap();
        first.others = skies.collect();
        scene.environment = Some(first);
        [Method::Radiosity, Method::Path].map(|method| {
            let samples = (method == Method::Path).then_some(256);
            mean(&bake(&scene, &atlas(2, 16), &Settings { method, samples, ..settings.clone() }), 0)
        })
    };
    let a = Environment { texture: Some(0), ..Environment::constant("a", Rgb::new(1.0, 0.5, 0.2)) };
    let turned = Mat3::from_rotation_x(0.7) * Mat3::from_rotation_y(1.0);
    let b = Environment { texture: Some(1), world_from_sky: turned, ..Environment::constant("b", Rgb::ONE) };
    let c = Environment::constant("c", Rgb::new(0.1, 0.2, 0.4));
    let all = with(vec![a.clone(), b.clone(), c.clone()]);
    let parts = [with(vec![a]), with(vec![b]), with(vec![c])];
    for k in 0..2 {
        let sum: Rgb = parts.iter().map(|p| p[k]).sum();
        let off = (all[k] / sum - 1.0).abs().max_element();
        println!("{} {sum}: {off:.4}", all[k]);
        assert!(off < 0.01, "{} {sum}", all[k]);
    }
}

#[test]
fn lights_reach_and_are_blocked_by_linked_surfaces_alone() {
    // A floor, a second floor beside it, and a shelf between a lamp and the first one.
    let shelf = Quad::new([-0.3, 0.8, -0.3], [0., 0., 0.6], [0.6, 0., 0.]).albedo(0.0).double_sided();
    let beside = Quad::new([1.5, 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0);
    let at = Vec3::new(0.0, 1.6, 0.0);
    let unblocked = |p: Vec3| {
        let way = at - p;
        5.0 * way.y / way.length().powi(3)
    };
    let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(0.05), glam::Quat::IDENTITY, at);
    let tube = ball * Affine3A::from_scale(Vec3::new(1.0, 0.3, 0.3));
    let radiance = Rgb::splat(100.0);
    let (u, v) = (Vec3::X * 0.05, Vec3::NEG_Z * 0.05);
    let lamps = [
        point(at, 5.0),
        Light::new("ball", LightShape::Sphere { world_from_unit: ball, radiance }),
        Light::new("tube", LightShape::Cylinder { world_from_unit: tube, radiance }),
        Light::new("rect", LightShape::Rect { center: at, u, v, radiance }),
        Light::new("sun", LightShape::Directional { direction: Vec3::NEG_Y, illuminance: radiance, angle: 0.01 }),
    ];
    for lamp in lamps {
        let with = |links: Links, method: Method| {
            let mut scene = scene(&[floor(), beside, shelf]);
            scene.lights.push(Light { links, ..lamp.clone() });
            let samples = (method == Method::Path).then_some(64);
            bake(&scene, &atlas(3, SIDE), &Settings { method, samples, ..draft() })
        };
        for method in [Method::Radiosity, Method::Path] {
            let all = with(Links::default(), method);
            // Linked to the first floor: the second gets nothing, the first what it had.
            let only = Links { lit: Linked::only(vec![true, false, false]), blockers: Linked::All };
            let only = with(only, method);
            assert_eq!(mean(&only, 1), Rgb::ZERO, "{}", lamp.name);
            assert_eq!(mean(&only, 2), Rgb::ZERO, "{}", lamp.name);
            assert!((mean(&only, 0) / mean(&all, 0) - 1.0).abs().max_element() < 1e-4, "{}", lamp.name);
            assert!(mean(&all, 1).x > 0.0);
            // Blocked by the floors alone: the shelf throws no shadow.
            let free = Links { lit: Linked::All, blockers: Linked::only(vec![true, true, false]) };
            let free = with(free, method);
            assert!(mean(&free, 0).x > 1.05 * mean(&all, 0).x, "{}", lamp.name);
            if lamp.name == "lamp" {
                let off = worst(&free, 0, unblocked);
                assert!(off < 0.01, "{off}");
                let none = with(Links { lit: Linked::All, blockers: Linked::none(3) }, method);
                assert_eq!(none.gathered.irradiance, free.gathered.irradiance);
            }
        }
    }
}

#[test]
fn what_is_even_in_a_sky_s_picture_takes_few_samples() {
    // A clear sky's glow and a horizon brighter than the zenith, and a shelf's shadow, in which every patch used to take a thousand samples.
    let shelf = Quad::new([-0.6, 0.4, -0.5], [0., 0., 1.0], [1.2, 0., 0.]).albedo(0.5).double_sided();
    let mut scene = scene(&[floor(), shelf]);
    let towards = lumel::scene::clear_sky::towards(40.0, 120.0);
    scene.textures.push(ClearSky::new(towards, 3.0).picture());
    scene.environment = Some(Environment { texture: Some(0), ..Environment::constant("sky", Rgb::ONE) });
    let baked = bake(&scene, &atlas(2, 24), &Settings { error: Some(2.0), ..draft() });
    let paths = bake(&scene, &atlas(2, 24), &Settings { method: Method::Path, samples: Some(2048), ..draft() });
    let (a, b) = (mean(&baked, 0).x, mean(&paths, 0).x);
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    let rays = baked.direct.rays as f64 / baked.patches.len() as f64;
    println!("{rays:.0} rays a patch, {:.2} %", 100.0 * (a / b - 1.0));
    assert!(rays < 100.0, "{rays} rays a patch");
}

#[test]
fn light_straight_from_a_picture_s_sun_is_as_exact_as_asked() {
    // A sun of a few texels behind the edge of a shelf: penumbrae that brightness samples find.
    let shelf = Quad::new([-0.6, 0.5, -0.5], [0., 0., 1.0], [0.7, 0., 0.]).albedo(0.0).double_sided();
    let mut scene = scene(&[floor(), shelf]);
    scene.textures.push(grey(
        256,
        128,
        |x, y| if (60..68).contains(&x) && (28..36).contains(&y) { 900.0 } else { 0.05 },
    ));
    scene.environment = Some(Environment { texture: Some(0), ..Environment::constant("sky", Rgb::ONE) });
    let truth = bake(&scene, &atlas(2, 24), &Settings { method: Method::Path, samples: Some(4096), ..draft() });
    let baked = bake(&scene, &atlas(2, 24), &Settings { error: Some(5.0), ..draft() });
    let of: Vec<usize> = (0..truth.patches.len()).filter(|&i| truth.patches.surface(i) == 0).collect();
    let (mut squares, mut sum) = (0.0f64, 0.0f64);
    for &i in &of {
        let (a, b) = (baked.gathered.irradiance[i].x, truth.gathered.irradiance[i].x);
        squares += f64::from(a - b).powi(2);
        sum += f64::from(b);
    }
    let rms = (squares / of.len() as f64).sqrt() / (sum / of.len() as f64);
    println!("rms {:.2} %  rays {}", 100.0 * rms, baked.direct.rays / baked.patches.len() as u64);
    assert!(rms < 0.03, "{rms}");
}
