//! Bakes and form factors whose answer is known on paper.

mod support;

use lumel::color::Rgb;
use lumel::patch::reflectance::reflectance;
use lumel::patch::unocclude::unocclude;
use lumel::patch::{Ground, rasterize};
use lumel::progress::Silent;
use lumel::scene::{Environment, Light, LightShape};
use lumel::settings::{Gather, Settings};
use lumel::trace::Tracer;
use lumel::transport::{Effort, Elements, Method, form_factor};
use std::f32::consts::PI;
use support::{Quad, atlas, bake, bake_quads, draft, room, scene};

/// The form factor from the first to the second of two quads, each one element, at default effort.
fn between(a: Quad, b: Quad) -> f64 {
    let scene = scene(&[a, b]);
    let atlas = atlas(2, 16);
    let tracer = Tracer::new(&scene);
    let patches = rasterize(&scene, &atlas, tracer.triangles(), &Silent).unwrap();
    let ground = Ground { scene: &scene, atlas: &atlas, tracer: &tracer, patches: &patches };
    let (reflectance, _) = reflectance(&ground, &Silent).unwrap();
    let exposure = unocclude(&ground, 0, &Silent).unwrap();
    let elements = Elements::new(&ground, &exposure, &reflectance, 2, 0);
    assert_eq!(elements.len(), 2);
    form_factor(&elements, &ground, 0, 1, Method::Area, &Effort::default()).value
}

#[test]
fn opposed_and_adjacent_unit_squares() {
    let floor = Quad::new([0., 0., 0.], [0., 0., 1.], [1., 0., 0.]);
    let ceiling = Quad::new([0., 1., 0.], [1., 0., 0.], [0., 0., 1.]);
    let wall = Quad::new([0., 0., 0.], [0., 1., 0.], [0., 0., 1.]);
    for (name, other, expected) in [("opposed", ceiling, 0.199825), ("adjacent", wall, 0.200044)] {
        let f = between(floor, other);
        println!("{name}: {f:.6} ({:+.3} %)", 100.0 * (f / expected - 1.0));
        assert!((f / expected - 1.0).abs() < 0.005, "{name}: {f} against {expected}");
    }
}

#[test]
fn distant_squares_by_area_sampling() {
    // Opposed parallel squares at distance c: Howell's catalogue, C-11.
    let c = 4.0f64;
    let x = 1.0 / c;
    let s = (1.0 + x * x).sqrt();
    let expected = 2.0 / (PI as f64 * x * x)
        * (((1.0 + x * x).powi(2) / (1.0 + 2.0 * x * x)).sqrt().ln() + 2.0 * x * s * (x / s).atan()
            - 2.0 * x * x.atan());
    let floor = Quad::new([0., 0., 0.], [0., 0., 1.], [1., 0., 0.]);
    let ceiling = Quad::new([0., c as f32, 0.], [1., 0., 0.], [0., 0., 1.]);
    let f = between(floor, ceiling);
    println!("{f:.6} against {expected:.6}");
    assert!((f / expected - 1.0).abs() < 0.005, "{f} against {expected}");
}

#[test]
fn furnace_is_uniform() {
    // Every wall emits M = pi L and reflects rho: B = M / (1 - rho), so E = B everywhere.
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    // By elements, which blocks don't have; blocks have a furnace of their own.
    let baked = bake_quads(&quads, 16, &Settings { gather: Gather::Final, ..draft() });
    let expected = PI / (1.0 - 0.5);
    let worst = baked.gathered.irradiance.iter().map(|e| (e.x / expected - 1.0).abs()).fold(0.0, f32::max);
    let deviation = |values: &mut dyn Iterator<Item = f32>| values.map(|e| (e / PI - 1.0).abs()).fold(0.0, f32::max);
    let direct = deviation(&mut baked.direct.shown.iter().map(|e| e.x));
    let elements = deviation(&mut baked.solution.irradiance.iter().map(|e| e.x));
    println!("direct {:.4} %, elements {:.4} %", 100.0 * direct, 100.0 * elements);
    println!("worst texel {:.4} %, balance {:+.4} %", 100.0 * worst, 100.0 * baked.energy.imbalance);
    assert!(baked.gathered.landed_share.iter().all(|s| *s == 1.0), "rays slipped out of a closed box");
    assert!(worst < 0.005, "{worst}");
    assert!(baked.energy.imbalance.abs() < 0.005);
}

#[test]
fn point_light_over_a_floor() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.5)]);
    let position = glam::Vec3::new(0.0, 1.5, 0.0);
    scene
        .lights
        .push(Light::new("lamp", LightShape::Point { position, intensity: Rgb::new(100., 50., 25.), range: None }));
    let baked = bake(&scene, &atlas(1, 32), &draft());
    for (i, p) in baked.patches.position.iter().enumerate() {
        let way = position - *p;
        let expected = 100.0 * way.y / way.length().powi(3);
        let e = baked.gathered.irradiance[i];
        assert!((e.x / expected - 1.0).abs() < 0.01, "{e} against {expected}");
        assert!((e.y / e.x - 0.5).abs() < 1e-5);
    }
}

#[test]
fn a_near_point_light_is_averaged_over_each_texel() {
    // Half a metre above texels of a sixteenth of a metre, eleven radii away: a lamp of 1 cd brings a rectangle as many lumens as the
    // solid angle that the rectangle has from there.
    let height = 0.5f32;
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.]).albedo(0.0)]);
    let position = glam::Vec3::new(0.0, height, 0.0);
    scene.lights.push(Light::new("lamp", LightShape::Point { position, intensity: Rgb::ONE, range: None }));
    let baked = bake(&scene, &atlas(1, 32), &draft());
    let corner = |x: f64, z: f64| (x * z / (f64::from(height) * f64::hypot(x, z).hypot(f64::from(height)))).atan();
    let mut worst = 0.0f64;
    for (i, p) in baked.patches.position.iter().enumerate().filter(|(i, _)| baked.patches.coverage[*i] > 0.999) {
        let half = 0.5 * f64::from(baked.patches.area[i]).sqrt();
        let [[x0, x1], [z0, z1]] = [p.x, p.z].map(|c| [f64::from(c) - half, f64::from(c) + half]);
        let solid_angle = corner(x1, z1) - corner(x0, z1) - corner(x1, z0) + corner(x0, z0);
        let expected = solid_angle / f64::from(baked.patches.area[i]);
        worst = worst.max((f64::from(baked.gathered.irradiance[i].x) / expected - 1.0).abs());
    }
    println!("worst texel {:.4} %", 100.0 * worst);
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn open_floor_under_a_constant_sky() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    scene.environment = Some(Environment::constant("sky", Rgb::new(1.0, 2.0, 3.0)));
    let baked = bake(&scene, &atlas(1, 8), &draft());
    for e in &baked.gathered.irradiance {
        assert!((*e - PI * Rgb::new(1.0, 2.0, 3.0)).abs().max_element() < 1e-4, "{e}");
    }
    assert!(baked.energy.imbalance.abs() < 1e-3, "{}", baked.energy.imbalance);
}

#[test]
fn patch_areas_add_up_to_the_surface() {
    // Slanted quads in odd places of the page, at an odd size.
    let quads = [
        Quad::new([0., 0., 0.], [1.3, 0.2, 0.1], [0.1, 0.9, -0.4]),
        Quad::new([2., 0., 0.], [0.013, 0.002, 0.001], [0.1, 0.9, -0.4]),
    ];
    let expected: f64 = quads.iter().map(|q| f64::from(q.u.cross(q.v).length())).sum();
    let scene = scene(&quads);
    let mut atlas = atlas(2, 37);
    for uvs in &mut atlas.meshes {
        for corner in uvs.corners.iter_mut().flatten() {
            *corner = *corner * 0.913 + 0.0217;
        }
    }
    let tracer = Tracer::new(&scene);
    let patches = rasterize(&scene, &atlas, tracer.triangles(), &Silent).unwrap();
    let sum: f64 = patches.area.iter().map(|a| f64::from(*a)).sum();
    assert!((sum / expected - 1.0).abs() < 1e-4, "{sum} against {expected}");
}

#[test]
fn a_double_sided_shelf_passes_light_on_below() {
    // A lamp under a shelf lights its lower side, which lights the floor in turn: nothing but its back can do that.
    let lamp = |sided: bool| {
        let shelf = Quad::new([-2., 1., -2.], [0., 0., 4.], [4., 0., 0.]).albedo(0.8);
        let shelf = if sided { shelf.double_sided() } else { shelf };
        let floor = Quad::new([-2., 0., -2.], [0., 0., 4.], [4., 0., 0.]).albedo(0.0);
        let mut scene = scene(&[shelf, floor]);
        scene.lights.push(Light::new(
            "lamp",
            LightShape::Point { position: glam::Vec3::new(0., 0.5, 0.), intensity: Rgb::ONE, range: None },
        ));
        let baked = bake(&scene, &atlas(2, 16), &draft());
        let floor = (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == 1);
        floor.map(|i| (baked.gathered.irradiance[i] - baked.direct.shown[i]).x).sum::<f32>()
    };
    assert_eq!(lamp(false), 0.0);
    assert!(lamp(true) > 1.0);
}

#[test]
fn two_rooms_and_a_slit_reach_the_dim_one() {
    // The second room gets light through a slit alone; its surfaces must converge to a thousandth all the same.
    let mut quads = room([2., 2., 2.]);
    quads.extend(room([2., 2., 2.]).into_iter().map(|mut q| {
        q.corner.x += 2.0;
        q
    }));
    // The wall between them leaves a slit of 5 cm, on either side.
    quads[3] = Quad::new([2., 0., 0.], [0., 0., 1.95], [0., 2., 0.]);
    quads[8] = Quad::new([2., 0., 0.], [0., 2., 0.], [0., 0., 1.95]);
    quads[1].emission = 10.0;
    // Both ways: converged, and balanced.
    let blocks = bake_quads(&quads, 16, &Settings { gather: Gather::Blocks, ..draft() });
    let exchanged = blocks.exchanged.unwrap();
    println!("blocks: residual {}, balance {}", exchanged.residual, blocks.energy.imbalance);
    assert!(exchanged.residual <= 1e-3);
    assert!(blocks.energy.imbalance.abs() < 0.01, "{}", blocks.energy.imbalance);
    let settings = Settings { gather: Gather::Final, ..draft() };
    let baked = bake_quads(&quads, 16, &settings);
    println!(
        "residual {}, shots {}, balance {}",
        baked.solution.exchange.residual, baked.solution.exchange.iterations, baked.energy.imbalance
    );
    assert!(baked.solution.exchange.residual <= 1e-3);
    assert!(baked.energy.imbalance.abs() < 0.005, "{}", baked.energy.imbalance);
}

#[test]
fn the_same_bits_for_one_and_two_threads() {
    let mut quads: Vec<Quad> = room([2., 1., 3.]);
    quads[1].emission = 5.0;
    quads.push(Quad::new([0.5, 0.5, 0.5], [0., 0., 1.], [1., 0., 0.]).double_sided());
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bake_quads(&quads, 16, &draft())).lightmap
    };
    let (one, two) = (run(1), run(2));
    assert!(
        one.pages[0]
            .rgb
            .iter()
            .zip(&two.pages[0].rgb)
            .all(|(a, b)| a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits))
    );
}

#[test]
fn zero_bounces_leave_direct_light_alone() {
    let mut quads = room([2., 2., 2.]);
    quads[1].emission = 3.0;
    let baked = bake_quads(&quads, 8, &Settings { max_bounces: Some(0), ..draft() });
    assert_eq!(baked.gathered.irradiance, baked.direct.shown.to_vec());
    let one = bake_quads(&quads, 8, &Settings { max_bounces: Some(1), ..draft() });
    let all = bake_quads(&quads, 8, &draft());
    let sum = |b: &lumel::illuminate::Illuminated| b.gathered.irradiance.iter().map(|e| e.x).sum::<f32>();
    assert!(sum(&baked) < sum(&one) && sum(&one) < sum(&all));
}

#[test]
fn a_closed_double_sided_lamp_keeps_its_energy() {
    // Its backs shine into its own inside, which must absorb that; its fronts light the room.
    let mut quads: Vec<Quad> = room([4., 3., 4.]);
    let lamp = room([1., 0.2, 1.]).into_iter().map(|mut q| {
        q.corner += glam::Vec3::new(1.5, 2.0, 1.5);
        std::mem::swap(&mut q.u, &mut q.v);
        q.emission(10.0).double_sided()
    });
    quads.extend(lamp);
    // A ceiling slab right above it, whose dark inside faces the same ways as the lamp's bright one.
    quads.extend(room([3.6, 0.1, 3.6]).into_iter().map(|mut q| {
        q.corner += glam::Vec3::new(0.2, 2.4, 0.2);
        std::mem::swap(&mut q.u, &mut q.v);
        q.double_sided()
    }));
    let blocks = bake_quads(&quads, 16, &draft());
    println!("blocks: {:?}", blocks.energy);
    assert!(blocks.energy.imbalance.abs() < 0.01, "{}", blocks.energy.imbalance);
    let baked = bake_quads(&quads, 16, &Settings { gather: Gather::Final, ..draft() });
    println!("{:?}", baked.energy);
    assert!(baked.energy.imbalance.abs() < 0.01, "{}", baked.energy.imbalance);
    // The lamp's inside is a furnace: each of its backs receives pi L / (1 - rho).
    let expected = PI * 10.0 / (1.0 - 0.5);
    for e in
        (0..baked.elements.len()).filter(|&e| baked.elements.back[e] && (6..12).contains(&baked.elements.surface[e]))
    {
        let irradiance = baked.solution.irradiance[e].x;
        assert!((irradiance / expected - 1.0).abs() < 0.02, "{irradiance} against {expected}");
    }
}

/// The room of `room([4, 3, 3])` built of six closed slabs that overlap at the edges.
fn slab_room() -> Vec<Quad> {
    let slabs = [
        ([-0.1, -0.1, -0.1], [4.2, 0.1, 3.2]),
        ([-0.1, 3.0, -0.1], [4.2, 0.1, 3.2]),
        ([-0.1, -0.1, -0.1], [0.1, 3.2, 3.2]),
        ([4.0, -0.1, -0.1], [0.1, 3.2, 3.2]),
        ([-0.1, -0.1, -0.1], [4.2, 3.2, 0.1]),
        ([-0.1, -0.1, 3.0], [4.2, 3.2, 0.1]),
    ];
    let outward = |(corner, size): ([f32; 3], [f32; 3])| {
        room(size).into_iter().map(move |mut q| {
            q.corner += glam::Vec3::from(corner);
            std::mem::swap(&mut q.u, &mut q.v);
            q.albedo(0.7)
        })
    };
    slabs.into_iter().flat_map(outward).collect()
}

fn lamp(shape: LightShape) -> Light {
    Light::new("lamp", shape)
}

#[test]
fn a_room_of_overlapping_slabs_is_as_bright_as_one_box() {
    let position = glam::Vec3::new(2.0, 2.5, 1.5);
    let mean_of_floor = |quads: Vec<Quad>| {
        let mut scene = scene(&quads);
        scene.lights.push(lamp(LightShape::Point { position, intensity: Rgb::ONE, range: None }));
        let baked = bake(&scene, &atlas(quads.len(), 48), &draft());
        assert!(baked.energy.imbalance.abs() < 0.01, "{}", baked.energy.imbalance);
        let inside = |i: &usize| {
            let p = baked.patches.position[*i];
            let in_room = p.x > 0.2 && p.x < 3.8 && p.z > 0.2 && p.z < 2.8;
            p.y.abs() < 1e-3 && baked.patches.normal[*i].y > 0.9 && in_room
        };
        let floor: Vec<usize> = (0..baked.patches.len()).filter(inside).collect();
        // The interreflected light: it varies little, so that it doesn't matter where texels lie.
        floor.iter().map(|&i| (baked.gathered.irradiance[i] - baked.direct.shown[i]).x).sum::<f32>()
            / floor.len() as f32
    };
    let (whole, slabs) =
        (mean_of_floor(room([4., 3., 3.]).into_iter().map(|q| q.albedo(0.7)).collect()), mean_of_floor(slab_room()));
    // Texels as wide as the walls are thick: a few percent is what they can do.
    assert!((slabs / whole - 1.0).abs() < 0.03, "{slabs} against {whole}");
}

#[test]
fn a_flat_emitter_never_lights_itself() {
    let tilted = Quad::new([0.3, 0.1, 0.7], [0.71, 0.33, 0.12], [-0.21, 0.52, 0.83]).emission(1.0);
    for quad in [tilted, tilted.double_sided()] {
        let baked = bake_quads(&[quad], 32, &draft());
        assert!(baked.gathered.irradiance.iter().all(|e| *e == Rgb::ZERO));
    }
}

#[test]
fn a_ball_of_light_has_its_closed_form() {
    // pi L (r / d)^2 cos, where all of it is above the horizon.
    let (centre, radius) = (glam::Vec3::new(0.0, 1.5, 0.0), 0.25);
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    let place = glam::Affine3A::from_translation(centre) * glam::Affine3A::from_scale(glam::Vec3::splat(radius));
    scene.lights.push(lamp(LightShape::Sphere { world_from_unit: place, radiance: Rgb::ONE }));
    let baked = bake(&scene, &atlas(1, 32), &draft());
    for (p, e) in baked.patches.position.iter().zip(&baked.gathered.irradiance) {
        let way = centre - *p;
        let expected = PI * radius * radius * way.y / way.length().powi(3);
        assert!((e.x / expected - 1.0).abs() < 0.02, "{} against {expected}", e.x);
    }
}

#[test]
fn a_wide_sun_gives_its_illuminance() {
    for degrees in [0.53f32, 10.0, 60.0, 170.0] {
        let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
        let direction = glam::Vec3::NEG_Y;
        scene.lights.push(lamp(LightShape::Directional {
            direction,
            illuminance: Rgb::ONE,
            angle: degrees.to_radians(),
        }));
        let baked = bake(&scene, &atlas(1, 8), &draft());
        let mean = baked.gathered.irradiance.iter().map(|e| e.x).sum::<f32>() / baked.patches.len() as f32;
        assert!((mean - 1.0).abs() < 0.01, "{degrees} degrees: {mean}");
    }
}

#[test]
fn strips_across_the_horizon_lose_no_light() {
    // Emissive strips that stand half below the floor's plane, with nothing in between: the floor sees their upper halves.
    let floor = Quad::new([-0.5, 0., -0.5], [0., 0., 1.], [1., 0., 0.]).albedo(0.0);
    let strips = |from: f32, height: f32| {
        (0..16)
            .map(move |i| Quad::new([-2. + 0.25 * i as f32, from, -2.], [0.25, 0., 0.], [0., height, 0.]).emission(1.0))
    };
    let mean = |strips: Vec<Quad>| {
        let quads: Vec<Quad> = std::iter::once(floor).chain(strips).collect();
        let baked = bake_quads(&quads, 8, &draft());
        let floor: Vec<usize> = (0..baked.patches.len()).filter(|&i| baked.patches.surface(i) == 0).collect();
        floor.iter().map(|&i| baked.gathered.irradiance[i].x).sum::<f32>() / floor.len() as f32
    };
    let (whole, upper) = (mean(strips(-1.0, 2.0).collect()), mean(strips(0.0, 1.0).collect()));
    assert!((whole / upper - 1.0).abs() < 0.005, "{whole} against {upper}");
}

#[test]
fn a_box_with_a_lamp_inside_keeps_its_inside_lit() {
    // Double-sided, fronts outwards, as exported by default: what its floor sees are backs, and yet it is in the light.
    let floor = Quad::new([-1., 0., -1.], [0., 0., 6.], [6., 0., 0.]);
    let mut quads = vec![floor];
    quads.extend(room([2., 2., 2.]).into_iter().skip(1).map(|mut q| {
        std::mem::swap(&mut q.u, &mut q.v);
        q.double_sided()
    }));
    let mut scene = scene(&quads);
    let position = glam::Vec3::new(1.0, 1.0, 1.0);
    scene.lights.push(lamp(LightShape::Point { position, intensity: Rgb::ONE, range: None }));
    let baked = bake(&scene, &atlas(quads.len(), 24), &draft());
    let inside = (0..baked.patches.len()).filter(|&i| {
        let p = baked.patches.position[i];
        baked.patches.surface(i) == 0 && p.x > 0.3 && p.x < 1.7 && p.z > 0.3 && p.z < 1.7
    });
    assert!(inside.map(|i| baked.gathered.irradiance[i].x).all(|e| e > 0.2));
}

#[test]
fn each_bounce_in_a_furnace_adds_its_power_of_albedo() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    for bounces in 0..4u32 {
        let baked = bake_quads(&quads, 8, &Settings { max_bounces: Some(bounces), ..draft() });
        let expected = PI * (0..=bounces).map(|k| 0.5f32.powi(k as i32)).sum::<f32>();
        let mean = baked.gathered.irradiance.iter().map(|e| e.x).sum::<f32>() / baked.patches.len() as f32;
        assert!((mean / expected - 1.0).abs() < 0.005, "{bounces} bounces: {mean} against {expected}");
    }
}

#[test]
fn a_small_bright_spot_is_found_by_every_element() {
    // A spotlight on the floor lights the room by its reflection alone; the ceiling's light must not depend on chance.
    let mut scene = scene(&room([4., 3., 5.]));
    scene.lights.push(lamp(LightShape::Spot {
        position: glam::Vec3::new(1.3, 2.9, 1.7),
        direction: glam::Vec3::NEG_Y,
        intensity: Rgb::splat(100.0),
        inner: 0.1,
        outer: 0.12,
        range: None,
    }));
    let atlas = atlas(6, 24);
    let of_ceiling = |seed| {
        let baked = bake(&scene, &atlas, &Settings { seed, gather: Gather::Final, ..draft() });
        let elements = (0..baked.elements.len()).filter(|&e| baked.elements.surface[e] == 1);
        let (sum, area) = elements.fold((0.0, 0.0), |(sum, area), e| {
            (sum + baked.solution.irradiance[e].x * baked.elements.area[e], area + baked.elements.area[e])
        });
        sum / area
    };
    let means: Vec<f32> = (0..6).map(of_ceiling).collect();
    let mean = means.iter().sum::<f32>() / 6.0;
    let deviation = (means.iter().map(|m| (m - mean).powi(2)).sum::<f32>() / 5.0).sqrt();
    assert!(deviation / mean < 0.03, "{means:?}");
}

#[test]
fn a_small_sun_in_a_picture_of_the_sky_is_not_left_to_chance() {
    // A dark sky with a sun of 4 x 4 texels: every texel of an open floor receives the same.
    let mut texels = vec![[0.1f32, 0.1, 0.1, 1.0]; 64 * 32];
    for (x, y) in (8..12).flat_map(|y| (20..24).map(move |x| (x, y))) {
        texels[y * 64 + x] = [2000.0, 2000.0, 2000.0, 1.0];
    }
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    let texels = lumel::scene::Texels::Float(texels);
    scene.textures.push(lumel::scene::Texture { name: "sky".into(), width: 64, height: 32, texels });
    let mut environment = Environment::constant("sky", Rgb::ONE);
    environment.texture = Some(0);
    scene.environment = Some(environment);
    // The picture's own integral: radiance x cosine over its texels, bilinear look-ups keep it.
    let (dx, dy) = (2.0 * PI / 64.0, PI / 32.0);
    let row = |y: usize| ((y as f32 + 0.5) * dy, (0.5 * dy).sin() * 2.0 * dx);
    let sun: f32 = (8..12).map(row).map(|(polar, cell)| 4.0 * cell * polar.sin() * polar.cos()).sum();
    let expected = 0.1 * PI + 1999.9 * sun;
    // By texels at draft; by blocks, of which so few look at the sky that all of them are off alike, within the error asked for.
    for settings in [Settings { gather: Gather::Final, ..draft() }, Settings { error: Some(1.0), ..draft() }] {
        let baked = bake(&scene, &atlas(1, 16), &settings);
        let values: Vec<f32> = baked.gathered.irradiance.iter().map(|e| e.x).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt();
        assert!(deviation / mean < 0.1, "{}", deviation / mean);
        assert!((mean / expected - 1.0).abs() < 0.02, "{mean} against {expected}");
    }
}
