//! Every solver of the radiosity system against the others, and against answers known on paper.

mod support;

use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::post::{LayerKind, Quantity};
use lumel::settings::{Gather, Method, Quality, Settings};
use lumel::solve::Solver;
use lumel::transport::Method as FormFactors;
use std::f32::consts::PI;
use support::{Quad, atlas, bake, bake_quads, draft, room, scene};

const SOLVERS: [Solver; 5] =
    [Solver::FullMatrix, Solver::Jacobi, Solver::GaussSeidel, Solver::Progressive, Solver::Hierarchical];

/// A room with a lamp in the ceiling, a red wall and a block in the middle.
fn room_with_a_block() -> Vec<Quad> {
    let mut quads: Vec<Quad> = room([3., 3., 3.]).into_iter().map(|q| q.albedo(0.7)).collect();
    quads.push(Quad::new([1., 2.99, 1.], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(10.0));
    quads.extend(room([0.8, 1.4, 0.8]).into_iter().map(|mut q| {
        q.corner += glam::Vec3::new(0.6, 0.01, 1.3);
        std::mem::swap(&mut q.u, &mut q.v);
        q.albedo(0.6)
    }));
    quads
}

/// Root mean square difference of the elements' irradiances by area, relative to the mean of `b`.
fn difference(a: &Illuminated, b: &Illuminated) -> f64 {
    let (mut squares, mut sum, mut area) = (0.0f64, 0.0f64, 0.0f64);
    for e in 0..a.elements.len() {
        let weight = f64::from(a.elements.area[e]);
        let value = |l: &Illuminated| f64::from(luminance(l.solution.irradiance[e]));
        squares += weight * (value(a) - value(b)).powi(2);
        sum += weight * value(b);
        area += weight;
    }
    (squares / area).sqrt() / (sum / area)
}

/// Flux on all elements [lm].
fn total(baked: &Illuminated) -> f64 {
    let flux = |(e, area): (&Rgb, &f32)| f64::from(luminance(*e)) * f64::from(*area);
    baked.solution.irradiance.iter().zip(&baked.elements.area).map(flux).sum()
}

#[test]
fn all_solvers_agree_with_the_full_matrix() {
    let run = |solver| {
        bake_quads(&room_with_a_block(), 24, &Settings { solver, elements: Some(600), gather: Gather::None, ..draft() })
    };
    let truth = run(Solver::FullMatrix);
    for solver in [Solver::Jacobi, Solver::GaussSeidel, Solver::Progressive] {
        let d = difference(&run(solver), &truth);
        println!("{}: {:.4} %", solver.name(), 100.0 * d);
        assert!(d < 0.005, "{}: {d}", solver.name());
    }
    let hierarchical = run(Solver::Hierarchical);
    let stated = hierarchical.solution.exchange.links.unwrap().error;
    let d = difference(&hierarchical, &truth);
    println!("hierarchical: {:.3} %, stated {:.3} %", 100.0 * d, 100.0 * stated);
    assert!(d < stated, "{d} is more than the {stated} that it states");
    assert!(stated < 0.04, "{stated}");
}

#[test]
fn a_lower_bound_on_links_brings_the_hierarchy_to_the_full_matrix() {
    let base = Settings { elements: Some(600), gather: Gather::None, ..draft() };
    let run = |settings| bake_quads(&room_with_a_block(), 24, &settings);
    let truth = run(Settings { solver: Solver::FullMatrix, ..base.clone() });
    let with = |bound| run(Settings { solver: Solver::Hierarchical, link_error: Some(bound), ..base.clone() });
    let (coarse, fine) = (with(1e-3), with(1e-6));
    let (a, b) = (difference(&coarse, &truth), difference(&fine, &truth));
    println!("{:.3} % with 1e-3, {:.3} % with 1e-6", 100.0 * a, 100.0 * b);
    assert!(b < 0.65 * a && b < 0.02, "{a} to {b}");
    let links = |l: &Illuminated| l.solution.exchange.links.unwrap();
    assert!(links(&coarse).count * 4 < links(&fine).count);
    assert!(links(&coarse).error > links(&fine).error);
}

#[test]
fn every_solver_keeps_the_furnace_and_the_energy() {
    // Every wall emits M = pi L and reflects half: E = 2 M everywhere.
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.emission(1.0)).collect();
    for solver in SOLVERS {
        for gather in [Gather::Final, Gather::None] {
            let baked = bake_quads(&quads, 16, &Settings { solver, gather, ..draft() });
            let deviation = |e: &Rgb| (e.x / (2.0 * PI) - 1.0).abs();
            let worst = baked.gathered.irradiance.iter().map(deviation).fold(0.0, f32::max);
            println!("{}: {:.3} %, {:+.3} %", solver.name(), 100.0 * worst, 100.0 * baked.energy.imbalance);
            assert!(worst < 0.005, "{}, {gather:?}: {worst}", solver.name());
            assert!(baked.energy.imbalance.abs() < 0.005, "{}", solver.name());
        }
    }
}

#[test]
fn every_solver_keeps_the_energy_of_a_room_with_a_block() {
    for solver in SOLVERS {
        let baked = bake_quads(&room_with_a_block(), 24, &Settings { solver, ..draft() });
        println!("{}: {:+.3} %", solver.name(), 100.0 * baked.energy.imbalance);
        assert!(baked.energy.imbalance.abs() < 0.01, "{}: {}", solver.name(), baked.energy.imbalance);
    }
}

#[test]
fn form_factors_that_see_occluders_give_one_answer() {
    let run = |form_factors| {
        let settings = Settings { form_factors, elements: Some(400), gather: Gather::None, ..draft() };
        bake_quads(&room_with_a_block(), 24, &settings)
    };
    let area = run(FormFactors::Area);
    assert_eq!(area.solution.blocked_share, 0.0);
    for method in [FormFactors::Hemicube, FormFactors::Hemisphere] {
        let d = difference(&run(method), &area);
        println!("{method:?}: {:.2} %", 100.0 * d);
        assert!(d < 0.05, "{method:?}: {d}");
    }
    // Blind to the block: it says so, and the light does not grow without end.
    let blind = run(FormFactors::Analytic);
    assert!(blind.solution.blocked_share > 0.05);
    // A quarter of the ways are blocked; light that goes through them brightens what lay in the shade, no more.
    assert!((1.0..1.2).contains(&(total(&blind) / total(&area))), "{}", total(&blind) / total(&area));
    let open: Vec<Quad> = room([3., 3., 3.]).into_iter().map(|q| q.emission(1.0)).collect();
    let open = bake_quads(&open, 16, &Settings { form_factors: FormFactors::Analytic, ..draft() });
    assert_eq!(open.solution.blocked_share, 0.0);
}

#[test]
fn a_sweep_of_jacobi_is_a_bounce() {
    let base = Settings { solver: Solver::Jacobi, gather: Gather::None, ..draft() };
    let run = |settings: &Settings| bake_quads(&room_with_a_block(), 16, settings);
    for k in [1u32, 2, 5] {
        let sweeps = run(&Settings { iterations: Some(u64::from(k)), ..base.clone() });
        let bounces = run(&Settings { max_bounces: Some(k), ..base.clone() });
        assert_eq!(sweeps.solution.irradiance, bounces.solution.irradiance);
        assert_eq!(sweeps.solution.exchange.iterations, u64::from(k));
        let shot = run(&Settings { solver: Solver::Progressive, ..Settings { max_bounces: Some(k), ..base.clone() } });
        // Columns have the noise of single form factors; the whole has not.
        let d = difference(&shot, &bounces);
        assert!(d < 0.05, "{k} bounces by shooting differ by {d}");
        let (a, b) = (total(&shot), total(&bounces));
        assert!((a / b - 1.0).abs() < 0.005, "{k} bounces by shooting are {a}, not {b}");
    }
}

#[test]
fn bounces_are_counted_alike_with_and_without_a_gather() {
    let run = |max_bounces, gather| {
        let settings = Settings { max_bounces: Some(max_bounces), gather, elements: Some(1 << 20), ..draft() };
        let baked = bake_quads(&room_with_a_block(), 12, &Settings { solver: Solver::Jacobi, ..settings });
        let area = |i: usize| f64::from(baked.exposure.area[i]);
        (0..baked.patches.len()).map(|i| area(i) * f64::from(luminance(baked.gathered.irradiance[i]))).sum::<f64>()
    };
    let mut last = 0.0;
    for bounces in [0, 1, 2, 4] {
        let (a, b) = (run(bounces, Gather::Final), run(bounces, Gather::None));
        assert!((a / b - 1.0).abs() < 0.01, "{bounces}: {a} with, {b} without");
        assert!(a > 1.02 * last, "{bounces}: {a} after {last}");
        last = a;
    }
}

#[test]
fn gauss_seidel_takes_fewer_sweeps_and_residuals_fall() {
    let run = |solver| bake_quads(&room_with_a_block(), 16, &Settings { solver, gather: Gather::None, ..draft() });
    let (jacobi, seidel) = (run(Solver::Jacobi), run(Solver::GaussSeidel));
    let (a, b) = (&jacobi.solution.exchange, &seidel.solution.exchange);
    assert!(b.iterations < a.iterations, "{} against {}", b.iterations, a.iterations);
    for exchange in [a, b] {
        assert_eq!(exchange.steps.len() as u64, exchange.iterations);
        assert!(exchange.steps.windows(2).skip(1).all(|s| s[1].residual < s[0].residual));
        assert!(exchange.residual <= 1e-3);
    }
}

#[test]
fn the_ambient_term_and_overshooting_bring_early_solutions_nearer() {
    let base = Settings { solver: Solver::Progressive, gather: Gather::None, ..draft() };
    let run = |settings: Settings| bake_quads(&room_with_a_block(), 16, &settings);
    let truth = run(Settings { solver: Solver::FullMatrix, ..base.clone() });
    let few = Settings { iterations: Some(60), ..base.clone() };
    let plain = difference(&run(few.clone()), &truth);
    let ambient = difference(&run(Settings { ambient: true, ..few }), &truth);
    println!("plain {plain:.3}, ambient {ambient:.3}");
    assert!(ambient < 0.7 * plain, "{ambient} against {plain}");
    let (slow, fast) = (run(base.clone()), run(Settings { overshoot: true, ..base }));
    let shots = |l: &Illuminated| l.solution.exchange.iterations;
    println!("{} shots, {} with overshooting", shots(&slow), shots(&fast));
    assert!(difference(&fast, &truth) < 0.005);
    assert!(shots(&fast) < shots(&slow));
}

#[test]
fn layers_of_bounces_add_up_to_the_page() {
    for (solver, quantity) in [
        (Solver::Progressive, Quantity::Outgoing),
        (Solver::Hierarchical, Quantity::Irradiance),
        (Solver::Jacobi, Quantity::Radiosity),
    ] {
        let settings = Settings {
            solver,
            quantity,
            layers: vec![LayerKind::Bounces, LayerKind::Direct, LayerKind::Indirect],
            float: true,
            ..draft()
        };
        let baked = bake_quads(&room_with_a_block(), 16, &settings);
        let layers = &baked.lightmap.layers;
        let of = |name: &str| &layers.iter().find(|l| l.name == name).unwrap_or_else(|| panic!("{name}")).pages[0];
        let is_shown = quantity == Quantity::Radiosity;
        let is_bounce = |name: &str| name.starts_with("bounce") || name == "rest" || (is_shown && name == "emitted");
        let emitted = |t: usize| if is_shown { of("emitted")[t] } else { Rgb::ZERO };
        for (t, whole) in baked.lightmap.pages[0].rgb.iter().enumerate() {
            let sum: Rgb = layers.iter().filter(|l| is_bounce(&l.name)).map(|l| l.pages[0][t]).sum();
            let tolerance = 1e-4 * whole.max_element().max(0.1);
            assert!((sum - *whole).abs().max_element() < tolerance, "{sum} against {whole}");
            assert!((emitted(t) + of("direct")[t] + of("indirect")[t] - *whole).abs().max_element() < tolerance);
        }
        assert_eq!(of("bounce0"), of("direct"));
        // Each bounce carries less than the one before.
        let power = |name: &str| of(name).iter().map(|c| c.x).sum::<f32>();
        assert!(power("bounce1") > power("bounce2") && power("bounce2") > power("bounce3"));
        assert!(power("rest").abs() < 0.2 * power("bounce1"));
        assert!(power("emitted") > 0.0);
    }
}

#[test]
fn many_elements_go_to_the_hierarchy_by_themselves() {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.emission(1.0)).collect();
    let run =
        |elements| bake_quads(&quads, 48, &Settings { elements, gather: Gather::None, ..draft() }).solution.solver;
    assert_eq!(run(None), Solver::Progressive);
    assert_eq!(run(Some(usize::MAX >> 44)), Solver::Hierarchical);
    // What only rows have keeps them.
    let rows =
        Settings { form_factors: FormFactors::Hemisphere, elements: Some(1 << 20), iterations: Some(2), ..draft() };
    assert_eq!(bake_quads(&quads, 48, &rows).solution.solver, Solver::Progressive);
}

#[test]
fn bad_settings_are_refused_with_what_is_allowed() {
    let base = Settings { quality: Quality::Draft, ..Settings::default() };
    let complaint = |settings: Settings| settings.check().unwrap_err().to_string();
    let full = Settings { solver: Solver::FullMatrix, ..base.clone() };
    assert!(full.check().is_ok());
    for (settings, said) in [
        (Settings { elements: Some(5001), ..full.clone() }, "1 to 5000"),
        (Settings { iterations: Some(3), ..full.clone() }, "iterations"),
        (Settings { max_bounces: Some(3), ..full.clone() }, "max-bounces"),
        (Settings { elements: Some(0), ..base.clone() }, "1 to"),
        (Settings { iterations: Some(0), ..base.clone() }, "1 to"),
        (Settings { samples: Some(0), ..base.clone() }, "2 to 65536"),
        (Settings { density: Some(-1.0), ..base.clone() }, "allowed are"),
        (Settings { hemicube: Some(9), form_factors: FormFactors::Hemicube, ..base.clone() }, "even"),
        (Settings { hemicube: Some(64), ..base.clone() }, "hemicube"),
        (Settings { link_error: Some(0.0), ..base.clone() }, "allowed are"),
        (Settings { solver: Solver::Jacobi, ambient: true, ..base.clone() }, "ambient"),
        (Settings { solver: Solver::Jacobi, overshoot: true, ..base.clone() }, "overshoot"),
        (Settings { watch_every: Some(3), ..base.clone() }, "watch"),
        (Settings { ambient: true, ..base.clone() }, "iterations"),
        (Settings { link_error: Some(1e-4), ..base.clone() }, "hierarchical"),
        (Settings { layers: vec![LayerKind::Direct; 2], ..base.clone() }, "twice"),
        (Settings { layers: vec![LayerKind::Error], gather: Gather::None, ..base.clone() }, "error"),
        (Settings { layers: vec![LayerKind::Bounces], iterations: Some(3), ..base.clone() }, "iterations"),
        (Settings { method: Method::Path, gather: Gather::None, ..base.clone() }, "methods that follow rays"),
        (Settings { method: Method::Path, samples: Some(0), ..base.clone() }, "1 to 65536"),
    ] {
        let e = complaint(settings);
        assert!(e.contains(said), "{e:?} does not say {said:?}");
    }
    // Backs come on top of what the settings say: refused before any light is found.
    let quads: Vec<Quad> = room([2., 2., 2.]).into_iter().map(|q| q.double_sided().emission(1.0)).collect();
    let settings = Settings { elements: Some(4000), ..full };
    let (scene, atlas) = (scene(&quads), atlas(6, 32));
    let e = lumel::illuminate::illuminate(&scene, &atlas, &settings, &lumel::progress::Silent).err().unwrap();
    assert!(e.to_string().contains("1 to 5000"), "{e}");
}

#[test]
fn a_sphere_from_inside_is_known_exactly() {
    // Between any two points of a sphere's inside the kernel is 1 / A: each element receives the mean of all, whatever the light.
    let (cap, rest) = support::sphere(glam::Vec3::ZERO, 1.0, 24, true)
        .into_iter()
        .partition(|t| t.iter().map(|p| p.y).sum::<f32>() > 1.0);
    let surfaces = [cap, rest];
    let (mut scene, atlas) = (support::mesh_scene(&surfaces), support::mesh_atlas(&surfaces, 3));
    scene.materials.push(lumel::scene::Material { emission: Rgb::ONE, ..scene.materials[0].clone() });
    scene.meshes[0].triangle_material.fill(1);
    let mean_of = |baked: &Illuminated, value: &dyn Fn(usize) -> f32| -> f64 {
        let area = |i: usize| f64::from(baked.exposure.area[i]);
        let n = baked.patches.len();
        (0..n).map(|i| area(i) * f64::from(value(i))).sum::<f64>() / (0..n).map(area).sum::<f64>()
    };
    for solver in SOLVERS {
        let baked = bake(&scene, &atlas, &Settings { solver, elements: Some(500), ..draft() });
        // A third of it shines: with rho the same all over, E = mean M / (1 - rho) at every point.
        let emittance = mean_of(&baked, &|i| PI * baked.emission.0[i].x);
        let expected = emittance / (1.0 - f64::from(baked.reflectance.0[0].x));
        let mean = mean_of(&baked, &|i| baked.gathered.irradiance[i].x);
        let worst = mean_of(&baked, &|i| (baked.gathered.irradiance[i].x - expected as f32).powi(2)).sqrt() / expected;
        println!("{}: mean {:+.3} %, RMS {:.3} %", solver.name(), 100.0 * (mean / expected - 1.0), 100.0 * worst);
        assert!((mean / expected - 1.0).abs() < 0.005, "{}: {mean} against {expected}", solver.name());
        assert!(worst < 0.03, "{}: {worst}", solver.name());
    }
}

#[test]
fn every_solver_gives_the_same_bits_for_one_and_two_threads() {
    for solver in SOLVERS {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = Settings { solver, elements: Some(600), gather: Gather::None, ..draft() };
            let values = pool.install(|| bake_quads(&room_with_a_block(), 24, &settings)).solution.irradiance;
            values.iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(2), "{}", solver.name());
    }
}
