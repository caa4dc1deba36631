//! Samplers against their densities (chi-squared), and rays against closed shells.

mod support;

use glam::{Affine3A, DVec2, DVec3, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::light::tree::Viewpoint;
use lumel::light::{Lights, Sky};
use lumel::sample::sequence::{Sequence, Stage};
use lumel::sample::warp;
use lumel::sample::{Discrete, SphericalTriangle};
use lumel::scene::{Environment, Material, Mesh, Scene, Surface, SurfaceOrigin, Texels, Texture, TriangleOrigin};
use lumel::trace::{Hit, Ray, Segment, Tracer};
use lumel::transport::near;
use lumel::transport::outline::{Outline, Polygon};
use std::f64::consts::{PI, TAU};

const SAMPLES: u32 = 1 << 16;

/// Independent numbers: the sequences are too even for a test of chance.
fn random(index: u32) -> [f32; 2] {
    let hash = |salt| Sequence::new(7, Stage::Probe, u64::from(index)).hash(salt) as f32 / (1u64 << 32) as f32;
    [hash(1), hash(2)]
}

/// The chi-squared statistic of counts against expected probabilities stays below the 99.9 % quantile (Wilson, Hilferty).
fn assert_agrees(name: &str, counts: &[u32], probabilities: &[f64]) {
    let n: u32 = counts.iter().sum();
    let total: f64 = probabilities.iter().sum();
    assert!((total - 1.0).abs() < 0.01, "{name}: the density integrates to {total}");
    let (mut statistic, mut degrees) = (0.0, -1.0);
    for (&count, &p) in counts.iter().zip(probabilities) {
        let expected = p / total * f64::from(n);
        if expected < 5.0 {
            continue;
        }
        statistic += (f64::from(count) - expected).powi(2) / expected;
        degrees += 1.0;
    }
    let k: f64 = degrees;
    let limit = k * (1.0 - 2.0 / (9.0 * k) + 3.09 * (2.0 / (9.0 * k)).sqrt()).powi(3);
    assert!(statistic < limit, "{name}: chi-squared {statistic:.1} over {limit:.1} at {k} degrees");
}

/// Counts directions in cells of cos theta and azimuth, and integrates `pdf` over the same cells.
fn assert_directions(name: &str, sample: impl Fn(u32) -> Option<Vec3>, pdf: impl Fn(Vec3) -> f64) {
    assert_directions_finely(name, 8, sample, pdf);
}

/// The same with `fine_count` squared values of the density a cell: where it has edges that cross cells.
fn assert_directions_finely(
    name: &str,
    fine_count: usize,
    sample: impl Fn(u32) -> Option<Vec3>,
    pdf: impl Fn(Vec3) -> f64,
) {
    const CELLS: [usize; 2] = [16, 32];
    let mut counts = vec![0u32; CELLS[0] * CELLS[1]];
    for d in (0..SAMPLES).filter_map(sample) {
        assert!((d.length() - 1.0).abs() < 1e-4);
        let y = ((f64::from(d.z) + 1.0) / 2.0 * CELLS[0] as f64).clamp(0.0, CELLS[0] as f64 - 1e-9) as usize;
        let azimuth = f64::from(d.y.atan2(d.x)).rem_euclid(TAU);
        let x = (azimuth / TAU * CELLS[1] as f64).min(CELLS[1] as f64 - 1e-9) as usize;
        counts[y * CELLS[1] + x] += 1;
    }
    let fine = [CELLS[0] * fine_count, CELLS[1] * fine_count];
    let mut expected = vec![0.0; counts.len()];
    for y in 0..fine[0] {
        for x in 0..fine[1] {
            let z = (y as f64 + 0.5) / fine[0] as f64 * 2.0 - 1.0;
            let a = (x as f64 + 0.5) / fine[1] as f64 * TAU;
            let r = (1.0 - z * z).sqrt();
            let d = Vec3::new((r * a.cos()) as f32, (r * a.sin()) as f32, z as f32);
            expected[y / fine_count * CELLS[1] + x / fine_count] +=
                pdf(d) * (2.0 / fine[0] as f64) * (TAU / fine[1] as f64);
        }
    }
    assert_agrees(name, &counts, &expected);
}

#[test]
fn directions_follow_their_densities() {
    assert_directions(
        "cosine hemisphere",
        |i| Some(warp::cosine_hemisphere(random(i))),
        |d| f64::from(warp::cosine_hemisphere_pdf(d.z)),
    );
    // The border of the cap lies on a border of cells.
    let cos_max = 0.5;
    assert_directions(
        "cap",
        |i| Some(warp::cap(random(i), cos_max)),
        |d| if d.z >= cos_max { f64::from(warp::cap_pdf(cos_max)) } else { 0.0 },
    );
}

#[test]
fn what_is_sharp_and_what_is_smooth_of_a_sky_add_up() {
    // An even sky with a lamp; one with a lamp alone; an even one.
    type Brightness<'a> = &'a dyn Fn(u32, u32) -> f32;
    let skies: [(Brightness, bool, f32); 3] = [
        (&|x, y| if (8..10).contains(&x) && (10..12).contains(&y) { 300.0 } else { 0.5 + 0.01 * y as f32 }, true, 4.0),
        (&|x, y| if (8..10).contains(&x) && (10..12).contains(&y) { 300.0 } else { 0.0 }, true, 0.0),
        (&|x, _| 1.0 + (x % 3) as f32, false, 4.0),
    ];
    for (value, is_sharp, most) in skies {
        let texels = (0..64 * 32).map(|i| [value(i % 64, i / 64); 3]).map(|[r, g, b]| [r, g, b, 1.0]).collect();
        let picture = Texture { name: String::new(), width: 64, height: 32, texels: Texels::Float(texels) };
        let scene = Scene { textures: vec![picture], ..Scene::default() };
        let environment = Environment { texture: Some(0), ..Environment::constant("sky", Rgb::ONE) };
        let sky = Sky::new(&scene, &environment);
        assert_eq!(sky.is_sharp(), is_sharp);
        for i in 0..4096 {
            let d = warp_sphere(random(i));
            let (whole, parts) = (sky.radiance(&scene, d), sky.smooth(&scene, d) + sky.sharp(&scene, d));
            assert!((whole - parts).abs().max_element() <= 1e-5 * whole.max_element(), "{whole} {parts}");
            // Between the lamp's cells and those beside it values are blended: a cell has one share.
            assert!(sky.smooth(&scene, d).x <= 3.0 * most.max(1e-4) + 1e-3, "{}", sky.smooth(&scene, d).x);
        }
        if is_sharp {
            let mut sum = 0.0f64;
            for i in 0..SAMPLES {
                let [u, v] = random(i);
                let (d, pdf) = sky.sample_sharp([u, v, 0.5]).unwrap();
                sum += f64::from(sky.sharp(&scene, d).x / pdf) / f64::from(SAMPLES);
            }
            let quadrature: f64 = (0..SAMPLES * 4)
                .map(|i| f64::from(sky.sharp(&scene, warp_sphere(random(i))).x) * 4.0 * PI / f64::from(SAMPLES * 4))
                .sum();
            assert!((sum / quadrature - 1.0).abs() < 0.05, "{sum} {quadrature}");
            for normal in [Vec3::Y, Vec3::X, Vec3::new(-0.6, 0.8, 0.0)] {
                let mut about = 0.0f64;
                for i in 0..SAMPLES {
                    let [u, v] = random(i);
                    let (d, pdf) = sky.sample_sharp([u, v, 0.5]).unwrap();
                    about += f64::from(sky.sharp(&scene, d).x * normal.dot(d).max(0.0) / pdf) / f64::from(SAMPLES);
                }
                let [known, shown] = sky.sharp_irradiance(normal, normal);
                assert_eq!(known, shown);
                assert!((about - f64::from(known.x)).abs() < 0.01 * sum, "{normal}: {about} {known}");
            }
        }
    }
}

/// A direction uniform over the sphere.
fn warp_sphere([u, v]: [f32; 2]) -> Vec3 {
    let (z, a) = (1.0 - 2.0 * u, std::f32::consts::TAU * v);
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * a.cos(), z, r * a.sin())
}

#[test]
fn spherical_triangles_follow_their_density() {
    let corners = [DVec3::new(1.0, 0.2, 0.1), DVec3::new(-0.3, 0.8, 0.2), DVec3::new(0.2, 0.1, 1.0)];
    // A large one, one seen from close to its edge, and both windings.
    let close = corners.map(|c| c - 0.999 * (0.7 * corners[0] + 0.3 * corners[1]));
    for corners in [corners, [corners[0], corners[2], corners[1]], close] {
        let triangle = SphericalTriangle::new(corners).unwrap();
        assert_directions_finely(
            "spherical triangle",
            64,
            |i| {
                let d = triangle.sample(random(i).map(f64::from));
                Some(d.as_vec3())
            },
            |d| triangle.pdf(d.as_dvec3()),
        );
    }
    // The positive octant has an eighth of all directions; a triangle in a plane with the point has none.
    let octant = SphericalTriangle::new([DVec3::X, DVec3::Y, DVec3::Z]).unwrap();
    assert!((octant.solid_angle - PI / 2.0).abs() < 1e-12);
    assert!(SphericalTriangle::new([DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)]).is_none());
    // A small one: every sample lies inside.
    let small = SphericalTriangle::new([DVec3::Z, DVec3::new(1e-3, 0.0, 1.0), DVec3::new(0.0, 2e-3, 1.0)]).unwrap();
    for i in 0..1000 {
        let d = small.sample(random(i).map(f64::from));
        let at = DVec2::new(d.x / d.z / 1e-3, d.y / d.z / 2e-3);
        assert!(at.x > -1e-4 && at.y > -1e-4 && at.x + at.y < 1.0 + 1e-4, "{at}");
    }
}

#[test]
fn points_towards_an_element_follow_their_density() {
    // Two panels at an angle, and a third that turns its back.
    let panels = [
        support::Quad::new([1., 0., 0.], [0., 0., 1.], [0., 1., 0.]),
        support::Quad::new([0., 1.5, 0.], [1., 0., 0.], [0., 0., 1.]),
        support::Quad::new([0., 0., 2.], [1., 0., 0.], [0., 1., 0.]),
    ];
    let polygons = panels.iter().map(|q| {
        let corners = [q.corner, q.corner + q.u, q.corner + q.u + q.v, q.corner + q.v];
        Polygon::new(corners.map(Vec3::as_dvec3).to_vec(), q.u.cross(q.v).as_dvec3())
    });
    let outline = Outline { polygons: polygons.collect(), area: 3.0, whole: true };
    let from = DVec3::new(0.3, 0.2, 0.4);
    assert_directions_finely(
        "towards",
        64,
        |i| {
            let [[a, b], [c, _]] = [random(i), random(i + SAMPLES)];
            let towards = near::towards(&outline, from, [a, b, c].map(f64::from))?;
            let direction = (towards.point - from).normalize();
            // In single precision a direction on an edge may fall beside it.
            let pdf = near::towards_pdf(&outline, from, direction);
            assert!(pdf == 0.0 || (towards.pdf / pdf - 1.0).abs() < 1e-6);
            assert!(direction.dot(towards.normal) < 0.0);
            Some(direction.as_vec3())
        },
        |d| near::towards_pdf(&outline, from, d.as_dvec3()),
    );
}

#[test]
fn triangles_and_discs_are_filled_evenly() {
    let mut counts = vec![0u32; 16];
    for i in 0..SAMPLES {
        let w = warp::triangle(random(i));
        assert!(w.x >= 0.0 && w.y >= 0.0 && w.x + w.y <= 1.0 + 1e-6);
        // Four equal strips by each of two barycentric coordinates make classes of known area.
        let strip = |v: f32| (v * 4.0).min(3.0) as usize;
        counts[strip(w.x) * 4 + strip(w.y)] += 1;
    }
    let area = |i: usize, j: usize| match i + j {
        0..=2 => 2.0 / 16.0,
        3 => 1.0 / 16.0,
        _ => 0.0,
    };
    let expected: Vec<f64> = (0..16).map(|k| area(k / 4, k % 4)).collect();
    assert_agrees("triangle", &counts, &expected);
    let mut rings = vec![0u32; 8];
    for i in 0..SAMPLES {
        let r2 = warp::disc(random(i)).length_squared();
        rings[((r2 * 8.0) as usize).min(7)] += 1;
    }
    assert_agrees("disc", &rings, &[0.125; 8]);
}

#[test]
fn discrete_choice_follows_its_weights() {
    let weights = [1.0, 0.0, 3.0, 0.5, 7.5];
    let table = Discrete::new(weights).unwrap();
    let mut counts = vec![0u32; weights.len()];
    for i in 0..SAMPLES {
        let (item, rest) = table.sample(random(i)[0]);
        assert!((0.0..1.0).contains(&rest));
        counts[item] += 1;
    }
    assert_eq!(counts[1], 0);
    let expected: Vec<f64> = (0..weights.len()).map(|k| table.pdf(k)).collect();
    assert_agrees("discrete", &counts, &expected);
    assert!(Discrete::new([0.0, 0.0]).is_none());
}

#[test]
fn a_sky_is_sampled_by_its_picture() {
    let texels = (0..32 * 16).map(|i| [(i % 7) as f32, 1.0 + (i % 32) as f32, 0.2, 1.0]).collect();
    let picture = Texture { name: "sky".into(), width: 32, height: 16, texels: Texels::Float(texels) };
    let mut environment = Environment::constant("sky", Rgb::ONE);
    environment.texture = Some(0);
    // The poles lie along z here, as the cells of the test do.
    environment.world_from_sky = glam::Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2);
    let scene = Scene { textures: vec![picture], environment: Some(environment.clone()), ..Scene::default() };
    let sky = Sky::new(&scene, &environment);
    let sample = |i: u32| {
        let ([a, b], [c, _]) = (random(i), random(i + SAMPLES));
        let (direction, pdf) = sky.sample([a, b, c])?;
        assert!((pdf / sky.pdf(direction) - 1.0).abs() < 1e-3);
        Some(direction)
    };
    assert_directions("sky", sample, |d| f64::from(sky.pdf(d)));
    for uv in [Vec2::new(0.1, 0.3), Vec2::new(0.9, 0.8)] {
        assert!((environment.uv(environment.direction(uv)) - uv).length() < 1e-4);
    }
}

#[test]
fn polygons_are_chosen_by_their_probability() {
    // Emitters of several sizes and brightnesses all around, some behind the viewpoint, some that face away, one in its plane.
    let quads: Vec<support::Quad> = (0..12)
        .map(|i| {
            let (x, size) = (i as f32 * 0.4 - 2.0, 0.1 + 0.05 * (i % 4) as f32);
            let corner = [x, (i % 5) as f32 * 0.5 - 0.5, (i % 3) as f32 - 1.0];
            let quad = support::Quad::new(corner, [size, 0., 0.], [0., 0.02 * i as f32, size]);
            let quad = quad.emission(1.0 + (i % 6) as f32);
            if i % 2 == 0 { quad.double_sided() } else { quad }
        })
        .collect();
    let lights = Lights::new(&support::scene(&quads));
    let tree = &lights.polygons;
    for (position, normal) in [(Vec3::ZERO, Vec3::Y), (Vec3::new(1.0, 3.0, 0.5), Vec3::NEG_Y), (-Vec3::Z, Vec3::X)] {
        let view = Viewpoint { position, normal, tolerance: 1e-5 };
        let mut counts = vec![0u32; tree.polygons.len()];
        for i in 0..SAMPLES {
            let Some(choice) = tree.choose(&view, random(i)[0]) else { continue };
            assert!((0.0..1.0).contains(&choice.u));
            let twin = tree.probability(&view, choice.polygon);
            assert!((choice.probability / twin - 1.0).abs() < 1e-4, "{} against {twin}", choice.probability);
            counts[choice.polygon] += 1;
        }
        let expected: Vec<f64> = (0..counts.len()).map(|p| f64::from(tree.probability(&view, p))).collect();
        // The descent can end where nothing shines to the viewpoint: of what is left the shares must agree.
        let chosen = f64::from(counts.iter().sum::<u32>()) / f64::from(SAMPLES);
        let total: f64 = expected.iter().sum();
        assert!((chosen / total - 1.0).abs() < 0.02, "{chosen} against {total}");
        let shares: Vec<f64> = expected.iter().map(|p| p / total).collect();
        assert_agrees("polygons", &counts, &shares);
        for (p, polygon) in tree.polygons.iter().enumerate() {
            let reaches = polygon.corners.iter().any(|c| (*c - position).dot(normal) > 0.0);
            assert!(expected[p] > 0.0 || !reaches || !polygon.faces(position, 1e-5), "polygon {p} is never chosen");
        }
    }
}

/// A sphere of 2048 triangles around `centre`, seen from inside.
fn shell(centre: Vec3, radius: f32) -> Scene {
    let (rows, columns) = (32u32, 32u32);
    let mut mesh = Mesh { name: "shell".into(), ..Mesh::default() };
    for y in 0..=rows {
        for x in 0..columns {
            let (a, b) = (PI * f64::from(y) / f64::from(rows), TAU * f64::from(x) / f64::from(columns));
            let p = glam::DVec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin()).as_vec3();
            mesh.positions.push(centre + radius * p);
        }
    }
    for y in 0..rows {
        for x in 0..columns {
            let [a, b] = [y * columns + x, y * columns + (x + 1) % columns];
            let [c, d] = [a + columns, b + columns];
            mesh.triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    mesh.origin = vec![TriangleOrigin::default(); mesh.triangles.len()];
    let surface = Surface {
        name: "shell".into(),
        mesh: 0,
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Default::default(),
    };
    Scene { meshes: vec![mesh], materials: vec![Material::default()], surfaces: vec![surface], ..Scene::default() }
}

#[test]
fn no_ray_slips_out_of_a_shell() {
    // Towards every corner and along every edge, where plain tests let rays through; off the origin, where rounding is worse.
    let scene = shell(Vec3::new(100.0, -40.0, 7.0), 3.0);
    let tracer = Tracer::new(&scene);
    let mesh = &scene.meshes[0];
    let origin = Vec3::new(100.3, -39.8, 6.9);
    let mut lost = 0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        for k in 0..=8 {
            let s = k as f32 / 8.0;
            for target in [a.lerp(b, s), b.lerp(c, s), c.lerp(a, s)] {
                let ray = Ray { origin, direction: (target - origin).normalize() };
                let mut hit: [Option<Hit>; 1] = [None];
                tracer.closest(&[ray], &mut hit);
                let mut blocked = [false];
                tracer.occluded(&[Segment { from: origin, to: origin + ray.direction * 10.0 }], &mut blocked);
                lost += u32::from(hit[0].is_none()) + u32::from(!blocked[0]);
            }
        }
    }
    assert_eq!(lost, 0);
}

#[test]
fn of_two_walls_in_one_plane_the_one_that_faces_is_hit() {
    let near = support::Quad::new([0., 0., 0.], [0., 1., 0.], [0., 0., 1.]);
    let far = support::Quad::new([0., 0., 0.], [0., 0., 1.], [0., 1., 0.]);
    for quads in [[near, far], [far, near]] {
        let tracer = Tracer::new(&support::scene(&quads));
        for x in [1.0, -1.0] {
            let rays: Vec<Ray> = (0..100)
                .map(|i| {
                    let origin = Vec3::new(x, 0.3, 0.6);
                    let target = Vec3::new(0.0, 0.05 + 0.009 * i as f32, 0.1 + 0.007 * i as f32);
                    Ray { origin, direction: (target - origin).normalize() }
                })
                .collect();
            let mut hits = vec![None; rays.len()];
            tracer.closest(&rays, &mut hits);
            assert!(hits.iter().all(|h: &Option<Hit>| h.is_some_and(|h| !h.back)));
        }
    }
}

#[test]
fn a_wall_right_beside_the_origin_is_not_missed() {
    // In metres no box is too near to count.
    let floor = support::Quad::new([0., 0., 0.], [0., 0., 3.], [2., 0., 0.]);
    let tracer = Tracer::new(&support::scene(&[floor]));
    for height in [1e-1, 1e-2, 1e-3, 1e-4, 6e-5] {
        let ray = Ray { origin: Vec3::new(0.4, height, 2.7), direction: Vec3::new(0.42, -0.75, 0.51).normalize() };
        let mut hit: [Option<Hit>; 1] = [None];
        tracer.closest(&[ray], &mut hit);
        assert!(hit[0].is_some(), "missed from {height} m");
    }
}
