//! Every kind of form factor against closed forms, against each other, and against the error it states.
//!
//! Numbers such as C-11 are those of Howell's catalogue of radiation heat transfer configuration factors.

mod support;

use glam::Vec3;
use lumel::patch::reflectance::reflectance;
use lumel::patch::unocclude::{Exposure, unocclude};
use lumel::patch::{Ground, Patches, Reflectance, rasterize};
use lumel::progress::Silent;
use lumel::scene::Scene;
use lumel::trace::Tracer;
use lumel::transport::hemicube::{Hemicube, HemicubeParams};
use lumel::transport::{Effort, Elements, FormFactor, Method, Outline, analytic, area, form_factor};
use lumel::unwrap::Atlas;
use std::f64::consts::PI;
use support::{Quad, atlas, disc, mesh_atlas, mesh_scene, room, scene, sphere, triangles};

const METHODS: [Method; 4] = [Method::Area, Method::Analytic, Method::Hemicube, Method::Hemisphere];

/// A scene with all that elements are made from.
struct Place {
    scene: Scene,
    atlas: Atlas,
    tracer: Tracer,
    patches: Patches,
    reflectance: Reflectance,
    exposure: Exposure,
}

impl Place {
    fn new(scene: Scene, atlas: Atlas) -> Self {
        let tracer = Tracer::new(&scene);
        let patches = rasterize(&scene, &atlas, tracer.triangles(), &Silent).unwrap();
        let ground = Ground { scene: &scene, atlas: &atlas, tracer: &tracer, patches: &patches };
        let (reflectance, _) = reflectance(&ground, &Silent).unwrap();
        let exposure = unocclude(&ground, 0, &Silent).unwrap();
        Self { scene, atlas, tracer, patches, reflectance, exposure }
    }

    fn quads(quads: &[Quad], texels: u32) -> Self {
        Self::new(scene(quads), atlas(quads.len(), texels))
    }

    fn meshes(surfaces: &[Vec<[Vec3; 3]>], texels: u32) -> Self {
        Self::new(mesh_scene(surfaces), mesh_atlas(surfaces, texels))
    }

    fn ground(&self) -> Ground<'_> {
        Ground { scene: &self.scene, atlas: &self.atlas, tracer: &self.tracer, patches: &self.patches }
    }

    fn elements(&self, count: usize, seed: u32) -> Elements {
        Elements::new(&self.ground(), &self.exposure, &self.reflectance, count, seed)
    }
}

/// The room that closure is measured in.
fn closed_room() -> Place {
    Place::quads(&room([4.0, 3.0, 3.0]), 16)
}

/// The same with a block on its floor.
fn room_with_block() -> Place {
    let mut quads = room([4.0, 3.0, 3.0]);
    quads.extend(room([1.0, 1.5, 0.8]).into_iter().map(|mut q| {
        q.corner += Vec3::new(1.3, 0.4, 1.2);
        std::mem::swap(&mut q.u, &mut q.v);
        q
    }));
    Place::quads(&quads, 16)
}

/// `F_AB = sum over i in A of A_i sum over j in B of F_ij / A_A` between the surfaces `a` and `b`.
fn between(elements: &Elements, a: u32, b: u32, mut f: impl FnMut(usize, usize) -> f64) -> f64 {
    let of = |s: u32| (0..elements.len()).filter(move |&e| elements.surface[e] == s);
    let (mut sum, mut area) = (0.0, 0.0);
    for i in of(a) {
        let own = f64::from(elements.area[i]);
        sum += own * of(b).map(|j| f(i, j)).sum::<f64>();
        area += own;
    }
    sum / area
}

/// The share of element `j` in a row of hemicubes.
fn share(row: &[(u32, f32)], j: usize) -> f64 {
    row.binary_search_by_key(&(j as u32), |r| r.0).map_or(0.0, |k| f64::from(row[k].1))
}

fn fine() -> Effort {
    Effort { relative_error: 1e-4, ..Effort::default() }
}

/// The analytic form factors of all elements to all, row by row.
fn analytic_matrix(elements: &Elements, ground: &Ground, effort: &Effort) -> Vec<Vec<f64>> {
    let outlines = Outline::all(elements, ground);
    let n = elements.len();
    let row = |i: usize| {
        (0..n).map(|j| analytic::form_factor(elements, i, j, [&outlines[i], &outlines[j]], effort).value).collect()
    };
    (0..n).map(row).collect()
}

/// The sum over the corners of two rectangles whose kernel's fourfold integral is `g`.
fn corners(x: [f64; 2], y: [f64; 2], u: [f64; 2], v: [f64; 2], g: impl Fn(f64, f64, f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for k in 0..16usize {
        let [i, j, l, m] = [k & 1, k >> 1 & 1, k >> 2 & 1, k >> 3];
        let sign = if (i + j + l + m) % 2 == 0 { 1.0 } else { -1.0 };
        sum += sign * g(x[i], y[j], u[l], v[m]);
    }
    sum / ((x[1] - x[0]) * (y[1] - y[0]))
}

/// C-13: parallel rectangles x by y and u by v, in planes `z` apart.
fn parallel(x: [f64; 2], y: [f64; 2], u: [f64; 2], v: [f64; 2], z: f64) -> f64 {
    corners(x, y, u, v, |x, y, u, v| {
        let (a, b) = (x - u, y - v);
        let (ra, rb) = (a.hypot(z), b.hypot(z));
        (b * ra * (b / ra).atan() + a * rb * (a / rb).atan() - 0.5 * z * z * (a * a + b * b + z * z).ln()) / (2.0 * PI)
    })
}

/// C-15: rectangles at right angles; `x` and `u` from the line where their planes meet, `y` and `v` along it.
fn perpendicular(x: [f64; 2], y: [f64; 2], u: [f64; 2], v: [f64; 2]) -> f64 {
    corners(x, y, u, v, |x, y, u, v| {
        let (r2, b) = (x * x + u * u, y - v);
        let r = r2.sqrt();
        let arc = if r > 0.0 { b * r * (b / r).atan() } else { 0.0 };
        let whole = r2 + b * b;
        let log = if whole > 0.0 { 0.25 * (r2 - b * b) * whole.ln() } else { 0.0 };
        (arc - log) / (2.0 * PI)
    })
}

/// C-14: rectangles at right angles with a common edge of length 1, `w` by 1 to `h` by 1.
fn with_common_edge(w: f64, h: f64) -> f64 {
    let (w2, h2) = (w * w, h * h);
    let r = (w2 + h2).sqrt();
    let log = ((1.0 + w2) * (1.0 + h2) / (1.0 + w2 + h2)).ln()
        + w2 * (w2 * (1.0 + w2 + h2) / ((1.0 + w2) * r * r)).ln()
        + h2 * (h2 * (1.0 + w2 + h2) / ((1.0 + h2) * r * r)).ln();
    (w * (1.0 / w).atan() + h * (1.0 / h).atan() - r * (1.0 / r).atan() + 0.25 * log) / (PI * w)
}

/// C-11: opposed parallel squares of edge `x` at distance 1.
fn opposed(x: f64) -> f64 {
    let s = (1.0 + x * x).sqrt();
    2.0 / (PI * x * x)
        * (((1.0 + x * x).powi(2) / (1.0 + 2.0 * x * x)).sqrt().ln() + 2.0 * x * s * (x / s).atan()
            - 2.0 * x * x.atan())
}

/// C-41: coaxial parallel discs of radii `r1` and `r2` at distance `h`.
fn discs(r1: f64, r2: f64, h: f64) -> f64 {
    let x = 1.0 + (h * h + r2 * r2) / (r1 * r1);
    0.5 * (x - (x * x - 4.0 * (r2 / r1).powi(2)).sqrt())
}

/// Pairs of rectangles with their form factors.
fn rectangles() -> Vec<(&'static str, Quad, Quad, f64)> {
    let floor = |x: [f32; 2], z: [f32; 2]| Quad::new([x[0], 0., z[0]], [0., 0., z[1] - z[0]], [x[1] - x[0], 0., 0.]);
    let ceiling =
        |x: [f32; 2], z: [f32; 2], y: f32| Quad::new([x[0], y, z[0]], [x[1] - x[0], 0., 0.], [0., 0., z[1] - z[0]]);
    // In the plane x = 0, facing +x.
    let wall = |y: [f32; 2], z: [f32; 2]| Quad::new([0., y[0], z[0]], [0., y[1] - y[0], 0.], [0., 0., z[1] - z[0]]);
    let unit = [0.0, 1.0];
    vec![
        ("opposed squares", floor(unit, unit), ceiling(unit, unit, 1.0), opposed(1.0)),
        ("opposed, close", floor(unit, unit), ceiling(unit, unit, 0.1), opposed(10.0)),
        ("opposed, far", floor(unit, unit), ceiling(unit, unit, 4.0), opposed(0.25)),
        (
            "parallel, unequal",
            floor([0.0, 2.0], unit),
            ceiling([1.5, 2.0], [-1.0, 3.0], 0.75),
            parallel([0.0, 2.0], [0.0, 1.0], [1.5, 2.0], [-1.0, 3.0], 0.75),
        ),
        ("common edge, squares", floor(unit, unit), wall(unit, unit), with_common_edge(1.0, 1.0)),
        ("common edge, unequal", floor([0.0, 0.5], unit), wall([0.0, 2.0], unit), with_common_edge(0.5, 2.0)),
        (
            "perpendicular, apart",
            floor([0.5, 1.5], unit),
            wall([0.25, 1.0], [0.5, 2.0]),
            perpendicular([0.5, 1.5], [0.0, 1.0], [0.25, 1.0], [0.5, 2.0]),
        ),
        (
            "perpendicular, a common corner",
            floor(unit, unit),
            wall(unit, [1.0, 2.0]),
            perpendicular([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], [1.0, 2.0]),
        ),
    ]
}

#[test]
fn closed_forms_agree_where_they_meet() {
    let unit = [0.0, 1.0];
    assert!((opposed(1.0) - 0.199825).abs() < 1e-6 && (with_common_edge(1.0, 1.0) - 0.200044).abs() < 1e-6);
    assert!((parallel(unit, unit, unit, unit, 1.0) - opposed(1.0)).abs() < 1e-12);
    let edge = perpendicular([0.0, 0.5], unit, [0.0, 2.0], unit);
    assert!((edge - with_common_edge(0.5, 2.0)).abs() < 1e-12, "{edge}");
}

#[test]
fn rectangles_by_every_method() {
    for (name, a, b, expected) in rectangles() {
        let place = Place::quads(&[a, b], 16);
        let elements = place.elements(2, 0);
        assert_eq!(elements.len(), 2);
        let f = |method, effort: &Effort| form_factor(&elements, &place.ground(), 0, 1, method, effort);
        let exact = f(Method::Analytic, &fine());
        println!("{name}: {expected:.6}, analytic {:+.1e} ({} points)", exact.value - expected, exact.samples);
        println!("    stated {:.1e}", exact.error);
        assert!((exact.value - expected).abs() < 1e-4, "{name}: {} against {expected}", exact.value);
        assert!((exact.value - expected).abs() <= exact.error + 1e-6, "{name}: stated {}", exact.error);
        for method in METHODS {
            let f = f(method, &Effort { relative_error: 0.005, ..Effort::default() });
            let off = f.value - expected;
            println!(
                "    {method:?}: {:+.3} %, stated {:.3} %, {} samples",
                100.0 * off / expected,
                100.0 * f.error / expected,
                f.samples
            );
            let allowed = if method == Method::Hemicube { 0.02 * expected } else { 4.0 * f.error + 1e-6 };
            assert!(off.abs() <= allowed, "{name} by {method:?}: {} against {expected}", f.value);
        }
    }
}

#[test]
fn elements_of_a_rectangle_add_up_to_it() {
    for (name, a, b, expected) in rectangles() {
        let place = Place::quads(&[a, b], 16);
        let elements = place.elements(24, 0);
        let f = analytic_matrix(&elements, &place.ground(), &fine());
        let sum = between(&elements, 0, 1, |i, j| f[i][j]);
        let back = between(&elements, 1, 0, |i, j| f[i][j]);
        let ratio = f64::from(a.u.cross(a.v).length() / b.u.cross(b.v).length());
        assert!((sum - expected).abs() < 1e-4, "{name}: {sum} against {expected}");
        assert!((back - expected * ratio).abs() < 1e-4 * ratio.max(1.0), "{name}: {back}");
        let mut cube = Hemicube::new(&HemicubeParams::default());
        let rows: Vec<_> = (0..elements.len()).map(|i| cube.row(&elements, &place.ground(), i)).collect();
        let by_rows = between(&elements, 0, 1, |i, j| share(&rows[i], j));
        println!("{name}: rows of hemicubes {:+.3} %", 100.0 * (by_rows / expected - 1.0));
        assert!((by_rows / expected - 1.0).abs() < 0.02, "{name}: {by_rows} by rows of hemicubes");
    }
}

#[test]
fn discs_converge_with_their_tessellation() {
    let expected = discs(1.0, 0.5, 0.8);
    let error = |count: u32| {
        let surfaces = [disc(Vec3::ZERO, 1.0, count, false), disc(Vec3::Y * 0.8, 0.5, count, true)];
        let place = Place::meshes(&surfaces, 2);
        let elements = place.elements(12, 0);
        let f = analytic_matrix(&elements, &place.ground(), &fine());
        (between(&elements, 0, 1, |i, j| f[i][j]) - expected).abs()
    };
    let errors = [error(12), error(24), error(96)];
    println!("{errors:?}");
    assert!(errors[1] < 0.5 * errors[0] && errors[2] < 1e-3, "{errors:?}");
}

#[test]
fn a_sphere_and_a_rectangle() {
    // The rectangle's share of the sphere of directions: its corner lies below the centre (Tripp, Hwang, Crank 1962,
    // in section C of the catalogue).
    let (d, l1, l2) = (1.0f64, 1.5f64, 0.8f64);
    let expected = (l1 * l2 / (d * (d * d + l1 * l1 + l2 * l2).sqrt())).atan() / (4.0 * PI);
    let error = |rows: u32| {
        let plate = Quad::new([0.0, -1.0, 0.0], [0.0, 0.0, 0.8], [1.5, 0.0, 0.0]);
        let surfaces = [sphere(Vec3::ZERO, 0.5, rows, false), triangles(&plate)];
        let place = Place::meshes(&surfaces, 2);
        let elements = place.elements(24, 0);
        let f = analytic_matrix(&elements, &place.ground(), &Effort { relative_error: 1e-3, ..Effort::default() });
        let value = between(&elements, 0, 1, |i, j| f[i][j]);
        println!("{rows} rows: {value:.6} against {expected:.6}");
        (value - expected).abs()
    };
    let (coarse, fine) = (error(6), error(24));
    assert!(fine < coarse && fine < 1e-3, "{coarse} {fine}");
}

#[test]
fn inside_a_sphere_every_element_sees_every_other_alike() {
    let place = Place::meshes(&[sphere(Vec3::ZERO, 1.0, 24, true)], 1);
    let elements = place.elements(48, 0);
    let ground = place.ground();
    let total: f64 = elements.area.iter().map(|a| f64::from(*a)).sum();
    let exact = analytic_matrix(&elements, &ground, &Effort { relative_error: 1e-3, ..Effort::default() });
    for (i, row) in exact.iter().enumerate() {
        assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-3);
        for (j, f) in row.iter().enumerate() {
            let expected = f64::from(elements.area[j]) / total;
            // What a facet would see of itself, were it round, the others get.
            let allowed = if i == j { 2e-3 } else { 1e-3 };
            assert!((f - expected).abs() < allowed, "analytic {i} {j}: {f} against {expected}");
        }
    }
    let effort = Effort { relative_error: 0.01, most_samples: 1 << 14, ..Effort::default() };
    for method in [Method::Area, Method::Hemicube, Method::Hemisphere] {
        for (i, j) in [(0, 1), (3, 40), (20, 21), (7, 30), (5, 5)] {
            let f = form_factor(&elements, &ground, i, j, method, &effort);
            let expected = f64::from(elements.area[j]) / total;
            let allowed = if i == j { 2e-3 } else { 1e-3 } + 3.0 * f.error;
            assert!((f.value - expected).abs() < allowed, "{method:?} {i} {j}: {f:?} against {expected}");
        }
    }
}

#[test]
fn concentric_spheres() {
    let (r1, r2) = (0.5f64, 1.0f64);
    let surfaces = [sphere(Vec3::ZERO, r1 as f32, 24, false), sphere(Vec3::ZERO, r2 as f32, 24, true)];
    let place = Place::meshes(&surfaces, 1);
    let elements = place.elements(60, 0);
    let ground = place.ground();
    let expected = [(0, 0, 0.0), (0, 1, 1.0), (1, 0, (r1 / r2).powi(2)), (1, 1, 1.0 - (r1 / r2).powi(2))];
    let mut cube = Hemicube::new(&HemicubeParams { points: 32, ..HemicubeParams::default() });
    let rows: Vec<Vec<(u32, f32)>> = (0..elements.len()).map(|i| cube.row(&elements, &ground, i)).collect();
    let effort = Effort { relative_error: 0.02, floor: 0.01, first_samples: 32, most_samples: 1 << 11 };
    for (a, b, expected) in expected {
        let by_cube = between(&elements, a, b, |i, j| share(&rows[i], j));
        let by = |method, effort: &Effort| {
            between(&elements, a, b, |i, j| form_factor(&elements, &ground, i, j, method, effort).value)
        };
        let (area, rays) = (by(Method::Area, &effort), by(Method::Hemisphere, &Effort { most_samples: 256, ..effort }));
        println!("{a} to {b}: {expected:.4}, area {area:.4}, hemicube {by_cube:.4}, hemisphere {rays:.4}");
        for (name, f) in [("area", area), ("hemicube", by_cube), ("hemisphere", rays)] {
            assert!((f - expected).abs() < 0.005, "{name} {a} to {b}: {f} against {expected}");
        }
    }
}

#[test]
fn rows_of_a_closed_room_add_up_to_one() {
    let place = closed_room();
    let elements = place.elements(100, 0);
    let ground = place.ground();
    let outlines = Outline::all(&elements, &ground);
    let effort = Effort { relative_error: 0.01, floor: 0.01, most_samples: 1 << 13, ..Effort::default() };
    let mut cube = Hemicube::new(&HemicubeParams::default());
    for method in METHODS {
        let (mut squares, mut worst) = (0.0, 0.0f64);
        let some: Vec<usize> = (0..elements.len()).step_by(5).collect();
        for &i in &some {
            let sum: f64 = match method {
                Method::Hemicube => cube.row(&elements, &ground, i).iter().map(|r| f64::from(r.1)).sum(),
                Method::Analytic => (0..elements.len())
                    .map(|j| analytic::form_factor(&elements, i, j, [&outlines[i], &outlines[j]], &effort).value)
                    .sum(),
                _ => (0..elements.len())
                    .filter(|&j| j != i)
                    .map(|j| form_factor(&elements, &ground, i, j, method, &effort).value)
                    .sum(),
            };
            squares += (1.0 - sum).powi(2);
            worst = worst.max((1.0 - sum).abs());
        }
        let rms = (squares / some.len() as f64).sqrt();
        println!("{method:?}: 1 - sum RMS {:.4} %, at most {:.4} %", 100.0 * rms, 100.0 * worst);
        assert!(rms <= 0.005 && worst <= 0.02, "{method:?}: {rms} {worst}");
        if method == Method::Hemicube {
            assert!(worst < 1e-5, "a cell saw nothing: {worst}");
        }
    }
}

#[test]
fn what_arrives_goes_both_ways() {
    let place = room_with_block();
    let elements = place.elements(60, 0);
    let ground = place.ground();
    let effort = Effort { relative_error: 0.02, most_samples: 1 << 13, ..Effort::default() };
    for method in METHODS {
        let (mut beyond, mut pairs) = (0, 0);
        for (i, j) in
            (0..elements.len()).step_by(7).flat_map(|i| (i + 1..elements.len()).step_by(5).map(move |j| (i, j)))
        {
            let [one, other] = [(i, j), (j, i)].map(|(i, j)| {
                let f = form_factor(&elements, &ground, i, j, method, &effort);
                let area = f64::from(elements.area[i]);
                (f.value * area, f.error * area)
            });
            if one.0.max(other.0) < 1e-4 {
                continue;
            }
            pairs += 1;
            let allowed = 2.0 * one.1.hypot(other.1) + 1e-6;
            beyond += u32::from((one.0 - other.0).abs() > allowed);
        }
        println!("{method:?}: {beyond} of {pairs} pairs differ by more than two standard errors");
        assert!(pairs > 20 && f64::from(beyond) <= 0.1 * f64::from(pairs), "{method:?}: {beyond} of {pairs}");
    }
}

#[test]
fn stated_errors_are_honest() {
    // Far, near, and partly hidden pairs of a room with a block: how often many seeds lie within 1.96 of their stated errors of
    // the truth, and how the stated ones compare with the actual ones.
    let place = room_with_block();
    let ground = place.ground();
    let exact = Effort { relative_error: 2e-4, first_samples: 1 << 14, ..Effort::default() };
    let effort = Effort { relative_error: 0.05, ..Effort::default() };
    let truth = place.elements(60, 1000);
    let n = truth.len();
    let seeds: Vec<Elements> = (0..12).map(|seed| place.elements(60, seed)).collect();
    for method in [Method::Area, Method::Hemisphere] {
        let (mut within, mut all, mut squares, mut stated) = ([0, 0], [0, 0], [0.0; 2], [0.0; 2]);
        let some = (0..n).step_by(4).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
        for (i, j) in some.filter(|&(i, j)| truth.are_near(i, j) || (i % 8 == 0 && j % 7 == i % 7 + 1)) {
            let expected = form_factor(&truth, &ground, i, j, Method::Area, &exact);
            if expected.value < 1e-3 {
                continue;
            }
            let near = usize::from(truth.are_near(i, j));
            for elements in &seeds {
                let f: FormFactor = form_factor(elements, &ground, i, j, method, &effort);
                let off = f.value - expected.value;
                let sure = expected.error + 1e-4 * expected.value;
                within[near] += u32::from(off.abs() <= 1.96 * f.error + sure);
                all[near] += 1;
                squares[near] += (off / expected.value).powi(2);
                stated[near] += (f.error / expected.value).powi(2);
            }
        }
        for (k, name) in ["far", "near"].into_iter().enumerate() {
            let share = f64::from(within[k]) / f64::from(all[k]);
            let [actual, stated] = [squares[k], stated[k]].map(|s| (s / f64::from(all[k])).sqrt());
            println!(
                "{method:?}, {name}: {:.1} % within of {}, RMS error {:.3} %, stated {:.3} %",
                100.0 * share,
                all[k],
                100.0 * actual,
                100.0 * stated
            );
            assert!(all[k] > 100 && share >= 0.9, "{method:?}, {name}: {share} of {}", all[k]);
            assert!(stated < 5.0 * actual + 1e-3, "{method:?}, {name}: stated {stated}, actual {actual}");
        }
    }
}

#[test]
fn a_glance_keeps_the_mean() {
    // Of 400 elements on opposite walls most form factors are below what a tenth of 5 % can tell.
    let place = room_with_block();
    let ground = place.ground();
    let elements = place.elements(400, 0);
    let effort = Effort { relative_error: 1.0, floor: 0.02, first_samples: 16, most_samples: 16 };
    let (mut once, mut often, mut rays, mut pairs) = (0.0, 0.0, 0, 0);
    for i in 0..elements.len() {
        for j in (0..elements.len()).filter(|&j| !elements.are_near(i, j)) {
            let most = elements.cluster[i].most_form_factor(&elements.cluster[j]);
            let whole = area::form_factor(&elements, &ground, i, j, &effort);
            assert!(whole.value <= 1.001 * f64::from(most), "{} is more than {most}", whole.value);
            let glance = area::glance(&elements, &ground, i, j, most, &effort);
            once += glance.value * f64::from(elements.area[i]);
            often += whole.value * f64::from(elements.area[i]);
            rays += glance.samples;
            pairs += u32::from(whole.samples > 0);
        }
    }
    println!("{once:.4} by {rays} rays over {pairs} pairs, {often:.4} by sixteen each");
    assert!((once / often - 1.0).abs() < 0.02, "{once} against {often}");
    assert!(2 * rays < pairs, "{rays} rays for {pairs} pairs");
}

#[test]
fn hemicubes_can_be_turned_or_not() {
    let place = closed_room();
    let elements = place.elements(100, 0);
    let row = |rotate, i| {
        Hemicube::new(&HemicubeParams { resolution: 16, points: 1, rotate }).row(&elements, &place.ground(), i)
    };
    assert_ne!(row(true, 0), row(false, 0));
    for rotate in [true, false] {
        let sum: f32 = row(rotate, 0).iter().map(|r| r.1).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
    }
    assert_eq!(row(true, 3), row(true, 3));
}
