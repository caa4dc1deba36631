//! Participating media: rays through them against closed forms and quadrature, and what files say of them.

use glam::{Affine3A, DVec3, EulerRot, Mat3, Quat, Vec3};
use lumel::color::Rgb;
use lumel::medium::{Flight, Media, Phase};
use lumel::sample::Numbers;
use lumel::sample::sequence::{Sequence, Stage};
use lumel::scene::{DensityGrid, Medium, MediumShape, Mesh, Role, Scene, Surface, SurfaceOrigin};
use lumel::trace::Ray;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Independent numbers, of which the test of chance may be asked: the sequences of bakes are too even. Counts what is drawn.
struct Random {
    sequence: Sequence,
    drawn: u32,
}

impl Random {
    fn new(seed: u64) -> Self {
        Self { sequence: Sequence::new(11, Stage::Path, seed), drawn: 0 }
    }
}

impl Numbers for Random {
    fn next(&mut self) -> f32 {
        self.drawn += 1;
        (self.sequence.hash(self.drawn) >> 8) as f32 / (1 << 24) as f32
    }
}

fn scene(media: Vec<Medium>) -> Scene {
    Scene { media, ..Scene::default() }
}

fn in_box(name: &str, low: Vec3, high: Vec3) -> Medium {
    Medium::new(name, MediumShape::between(low, high))
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray { origin: origin.into(), direction: Vec3::from(direction).normalize() }
}

fn assert_close(name: &str, found: Rgb, expected: Rgb, error: f32) {
    let off = (found - expected).abs().max_element();
    assert!(off <= error * expected.abs().max_element().max(1e-6), "{name}: {found} instead of {expected}");
}

/// Mean and standard error of values.
#[derive(Default)]
struct Tally {
    count: f64,
    sum: DVec3,
    squares: DVec3,
}

impl Tally {
    fn add(&mut self, value: Rgb) {
        let value = value.as_dvec3();
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    /// Holds the mean against `expected`: within 4.5 standard errors in every channel, of which there are a few hundred in all
    /// (chance of a false alarm: below 1 in 500), and within `error` of it, so that noise alone can't hide a mistake.
    fn assert_is(&self, name: &str, expected: DVec3, error: f64) {
        let mean = self.sum / self.count;
        let variance = (self.squares / self.count - mean * mean).max(DVec3::ZERO);
        for c in 0..3 {
            let sigma = (variance[c] / self.count).sqrt();
            let off = (mean[c] - expected[c]).abs();
            assert!(
                off <= 4.5 * sigma + 2e-4 * expected[c].abs(),
                "{name}, channel {c}: {mean} instead of {expected}, sigma {sigma}"
            );
            assert!(off <= error * expected[c].abs().max(1e-9), "{name}, channel {c}: {mean} instead of {expected}");
        }
    }
}

/// The chi-squared statistic of counts against expected ones stays below its 99.99 % quantile (Wilson, Hilferty).
fn assert_agrees(name: &str, counts: &[f64], expected: &[f64]) {
    let (mut statistic, mut k) = (0.0, -1.0f64);
    for (count, expected) in counts.iter().zip(expected).filter(|(_, e)| **e >= 5.0) {
        statistic += (count - expected).powi(2) / expected;
        k += 1.0;
    }
    let limit = k * (1.0 - 2.0 / (9.0 * k) + 3.72 * (2.0 / (9.0 * k)).sqrt()).powi(3);
    assert!(k > 3.0 && statistic < limit, "{name}: chi-squared {statistic:.1} over {limit:.1} at {k} degrees");
}

/// A cloud of uneven density over (0, 0, 0)..(2, 1, 1), with an empty side.
fn cloud() -> Arc<DensityGrid> {
    let size = [24, 9, 5];
    let mut values = Vec::new();
    for k in 0..size[2] {
        for j in 0..size[1] {
            for i in 0..size[0] {
                let wave = (i as f32 * 0.7).sin() + (j as f32 * 1.1 + k as f32).cos();
                values.push(if i < 8 { 0.0 } else { (0.9 + 0.6 * wave).max(0.0) });
            }
        }
    }
    Arc::new(DensityGrid::new(size, values).unwrap())
}

fn cloudy(name: &str) -> Medium {
    Medium { grid: Some(cloud()), ..in_box(name, Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0)) }
}

/// Optical depths of `media` along `ray` up to each of `n` equal steps of `distance`, by the midpoint rule.
fn depths(media: &Media, ray: &Ray, distance: f64, n: usize) -> Vec<DVec3> {
    let step = distance / n as f64;
    let mut depth = DVec3::ZERO;
    let mut all = vec![depth];
    for i in 0..n {
        let at = ray.origin.as_dvec3() + ray.direction.as_dvec3() * ((i as f64 + 0.5) * step);
        depth += media.at(at.as_vec3()).extinction.as_dvec3() * step;
        all.push(depth);
    }
    all
}

#[test]
fn homogeneous_boxes_let_through_what_the_exponential_says_and_draw_nothing() {
    let sigma = Rgb::new(0.3, 1.0, 2.5);
    let one = Medium { absorption: sigma, ..in_box("one", Vec3::new(1.0, -1.0, -1.0), Vec3::new(3.0, 1.0, 1.0)) };
    let other = Medium {
        scattering: Rgb::splat(0.25),
        density: 2.0,
        ..in_box("other", Vec3::new(2.0, -1.0, -1.0), Vec3::new(6.0, 1.0, 1.0))
    };
    let alone = Media::new(&scene(vec![one.clone()]));
    let both = Media::new(&scene(vec![one, other]));
    let mut numbers = Random::new(0);
    let along = ray([0.0; 3], [1.0, 0.0, 0.0]);
    let mut check = |media: &Media, ray: &Ray, distance: f32, depth: Rgb| {
        let found = media.transmittance(ray, distance, &mut numbers);
        assert_close("transmittance", found, (-depth).exp(), 1e-5);
    };
    check(&alone, &along, f32::INFINITY, sigma * 2.0);
    check(&alone, &along, 2.5, sigma * 1.5);
    check(&alone, &along, 0.5, Rgb::ZERO);
    check(&alone, &ray([2.0, 0.0, 0.0], [0.0, 1.0, 0.0]), f32::INFINITY, sigma);
    check(&alone, &ray([2.0, 0.0, 0.0], [0.0, 1.0, 0.0]), 0.25, sigma * 0.25);
    check(&alone, &ray([4.0, 0.0, 0.0], [1.0, 0.0, 0.0]), f32::INFINITY, Rgb::ZERO);
    check(&alone, &ray([0.0, 1.5, 0.0], [1.0, 0.0, 0.0]), f32::INFINITY, Rgb::ZERO);
    check(&both, &along, f32::INFINITY, sigma * 2.0 + Rgb::splat(0.5 * 4.0));
    check(&both, &along, 2.5, sigma * 1.5 + Rgb::splat(0.5 * 0.5));
    assert_eq!(numbers.drawn, 0);
}

#[test]
fn turned_and_scaled_shapes_are_crossed_where_they_are() {
    // A box 2 x 1 x 1 turned by 30 degrees about Z: along its own X it is 2 long.
    let turn = Quat::from_euler(EulerRot::XYZ, 0.0, 0.0, 30f32.to_radians());
    let placed = |scale: Vec3, middle: Vec3| {
        let frame = Mat3::from_quat(turn) * Mat3::from_diagonal(scale);
        Affine3A::from_mat3_translation(frame, middle - frame * Vec3::splat(0.5))
    };
    let sigma = Rgb::splat(0.7);
    let middle = Vec3::new(3.0, 2.0, 1.0);
    let medium = |shape| Media::new(&scene(vec![Medium { absorption: sigma, ..Medium::new("m", shape) }]));
    let (scale, mut numbers) = (Vec3::new(2.0, 1.0, 1.0), Random::new(0));
    let mut depth = |media: &Media, from: Vec3, way: Vec3| {
        let ray = Ray { origin: from, direction: way.normalize() };
        -media.transmittance(&ray, f32::INFINITY, &mut numbers).x.ln() / sigma.x
    };
    let cuboid = medium(MediumShape::Box { world_from_unit: placed(scale, middle) });
    let mirrored = medium(MediumShape::Box { world_from_unit: placed(scale * Vec3::new(1.0, -1.0, 1.0), middle) });
    let ball = medium(MediumShape::Ellipsoid { world_from_unit: placed(scale, middle) });
    for (own, length) in [(Vec3::X, 2.0), (Vec3::Y, 1.0), (Vec3::Z, 1.0), (Vec3::new(1.0, 1.0, 0.0), 2f32.sqrt())] {
        let way = turn * own;
        for media in [&cuboid, &mirrored] {
            let found = depth(media, middle - way * 20.0, way);
            assert!((found - length).abs() < 1e-4, "box along {own}: {found} instead of {length}");
        }
        // A ray through the middle of an ellipsoid with half axes a: 2 / |own / a|.
        let chord = 2.0 / (own.normalize() / (0.5 * scale)).length();
        let found = depth(&ball, middle - way * 20.0, way);
        assert!((found - chord).abs() < 1e-4, "ellipsoid along {own}: {found} instead of {chord}");
        assert!((depth(&ball, middle, way) - 0.5 * chord).abs() < 1e-4);
    }
    // Beside the ellipsoid, but within its box.
    assert_eq!(depth(&ball, middle + turn * Vec3::new(-5.0, 0.45, 0.45), turn * Vec3::X), 0.0);
}

#[test]
fn grids_let_through_what_quadrature_says() {
    let medium = Medium { scattering: Rgb::new(1.0, 2.0, 0.2), absorption: Rgb::new(0.1, 0.5, 0.0), ..cloudy("cloud") };
    let absorber = Medium { scattering: Rgb::ZERO, ..medium.clone() };
    let haze = Medium { absorption: Rgb::splat(0.3), ..in_box("haze", Vec3::splat(-1.0), Vec3::splat(0.75)) };
    let turned = Medium {
        shape: MediumShape::Ellipsoid {
            world_from_unit: Affine3A::from_scale_rotation_translation(
                Vec3::new(1.5, 2.0, 1.0),
                Quat::from_rotation_y(0.6),
                Vec3::new(-0.2, -0.4, -0.1),
            ),
        },
        ..medium.clone()
    };
    let sets = [vec![medium.clone()], vec![absorber], vec![medium.clone(), haze.clone(), turned.clone()], vec![turned]];
    let rays = [
        (ray([-1.0, 0.4, 0.3], [1.0, 0.05, 0.1]), 5.0),
        (ray([3.0, 0.9, 0.8], [-1.0, -0.2, -0.1]), 5.0),
        (ray([1.2, 0.5, 0.5], [0.3, 0.4, 0.2]), 0.5),
        (ray([1.3, -1.0, 0.5], [0.0, 1.0, 0.0]), f32::INFINITY),
    ];
    for (s, set) in sets.into_iter().enumerate() {
        let media = Media::new(&scene(set));
        for (r, (ray, distance)) in rays.iter().enumerate() {
            let depth = *depths(&media, ray, f64::from(distance.min(8.0)), 40_000).last().unwrap();
            let mut tally = Tally::default();
            for i in 0..20_000 {
                tally.add(media.transmittance(ray, *distance, &mut Random::new(i)));
            }
            tally.assert_is(&format!("set {s}, ray {r}"), (-depth).exp(), 0.02);
        }
    }
}

#[test]
fn little_light_through_thick_grids_is_not_lost() {
    // Less passes than what ways are followed by chance at.
    let thick = Medium { absorption: Rgb::new(3.0, 2.5, 2.0), ..cloudy("thick") };
    let (media, along) = (Media::new(&scene(vec![thick])), ray([-1.0, 0.4, 0.3], [1.0, 0.05, 0.1]));
    let depth = *depths(&media, &along, 8.0, 40_000).last().unwrap();
    assert!(depth.min_element() > 1.5 && depth.max_element() < 6.0, "{depth}");
    let mut tally = Tally::default();
    for i in 0..80_000 {
        tally.add(media.transmittance(&along, f32::INFINITY, &mut Random::new(i)));
    }
    tally.assert_is("thick", (-depth).exp(), 0.06);
}

/// Free flights along `along` in `media` against quadrature: where they end, what passes, what is emitted, all three channels.
fn check_flights(name: &str, media: &Media, along: &Ray, distance: f32, throughput: Rgb) {
    const CELLS: usize = 12;
    const STEPS: usize = 3000;
    let length = f64::from(distance.min(8.0));
    let depth = depths(media, along, length, CELLS * STEPS);
    let step = length / (CELLS * STEPS) as f64;
    let (mut scattered, mut emitted) = (vec![DVec3::ZERO; CELLS], DVec3::ZERO);
    for i in 0..CELLS * STEPS {
        let at = along.origin.as_dvec3() + along.direction.as_dvec3() * ((i as f64 + 0.5) * step);
        let here = media.at(at.as_vec3());
        let passed = (-0.5 * (depth[i] + depth[i + 1])).exp();
        scattered[i / STEPS] += passed * here.scattering.as_dvec3() * step;
        emitted += passed * here.emission.as_dvec3() * step;
    }
    let mut cells: Vec<Tally> = (0..CELLS).map(|_| Tally::default()).collect();
    let (mut passed, mut light) = (Tally::default(), Tally::default());
    for i in 0..40_000 {
        let flight = media.fly(along, distance, throughput, &mut Random::new(i));
        let carried = (throughput * flight.weight()).element_sum() / throughput.element_sum();
        assert!(carried <= 1.0 + 1e-4, "{name}: a flight carries {carried} times what it began with");
        light.add(flight.emitted());
        let (at, weight) = match flight {
            Flight::Passed { weight, .. } => (CELLS, weight),
            Flight::Scattered { t, weight, .. } => ((f64::from(t) / length * CELLS as f64) as usize, weight),
        };
        passed.add(if at == CELLS { weight } else { Rgb::ZERO });
        cells.iter_mut().enumerate().for_each(|(c, tally)| tally.add(if c == at { weight } else { Rgb::ZERO }));
    }
    passed.assert_is(&format!("{name}: passed"), (-*depth.last().unwrap()).exp(), 0.25);
    light.assert_is(&format!("{name}: emitted"), emitted, 0.05);
    for (c, (tally, expected)) in cells.iter().zip(&scattered).enumerate() {
        tally.assert_is(&format!("{name}: scattered in cell {c}"), *expected, 0.5);
    }
}

#[test]
fn flights_weigh_what_quadrature_says_in_every_channel() {
    let colored = Medium {
        scattering: Rgb::new(0.2, 1.0, 3.0),
        absorption: Rgb::new(0.4, 0.1, 0.3),
        emission: Rgb::new(3.0, 1.0, 0.0),
        ..in_box("colored", Vec3::new(0.5, -1.0, -1.0), Vec3::new(2.0, 1.0, 1.0))
    };
    let grey = Medium { scattering: Rgb::splat(0.8), ..in_box("grey", Vec3::splat(-1.0), Vec3::splat(1.2)) };
    let pure = Medium { scattering: Rgb::new(2.0, 0.0, 0.0), ..grey.clone() };
    let ink = Medium { absorption: Rgb::new(0.5, 0.1, 0.0), ..in_box("ink", Vec3::splat(-1.0), Vec3::splat(3.0)) };
    let fire = Medium { emission: Rgb::new(5.0, 2.0, 0.5), ..cloudy("fire") };
    let cloud = Medium { scattering: Rgb::new(1.0, 2.0, 0.3), absorption: Rgb::new(0.1, 0.0, 0.5), ..fire.clone() };
    let smoke = Medium { absorption: Rgb::new(1.0, 0.3, 0.0), ..fire.clone() };
    let (along, even) = (ray([-0.5, 0.4, 0.3], [1.0, 0.05, 0.1]), Rgb::ONE);
    let check = |name: &str, set: Vec<Medium>, throughput: Rgb| {
        check_flights(name, &Media::new(&scene(set.clone())), &along, f32::INFINITY, throughput);
        check_flights(&format!("{name}, cut off"), &Media::new(&scene(set)), &along, 2.1, throughput);
    };
    check("colored", vec![colored.clone()], even);
    check("colored, uneven", vec![colored.clone()], Rgb::new(0.2, 1.0, 0.5));
    check("overlapping", vec![grey.clone(), colored.clone(), ink.clone(), pure], even);
    check("only absorbed", vec![ink.clone()], even);
    check("cloud", vec![cloud.clone()], even);
    check("cloud, uneven", vec![cloud.clone()], Rgb::new(0.2, 1.0, 0.5));
    check("smoke", vec![smoke.clone()], even);
    check("fire", vec![fire], even);
    check("all", vec![cloud, grey, ink, colored, smoke], even);
}

#[test]
fn phase_functions_add_up_to_one_and_turn_by_their_mean_cosine() {
    for g in [-0.99, -0.9, -0.3, -1e-5, 0.0, 2e-4, 0.1, 0.5, 0.85, 0.99] {
        let phase = Phase { g };
        // Closely spaced towards the lobe: cos = 1 - 2 s^4 (or its mirror image).
        let (mut sum, mut mean, n) = (0.0, 0.0, 200_000);
        for i in 0..n {
            let s = (f64::from(i) + 0.5) / f64::from(n);
            let cos = (1.0 - 2.0 * s.powi(4)) * f64::from(1f32.copysign(g));
            let share = f64::from(phase.evaluate(cos as f32)) * TAU * 8.0 * s.powi(3) / f64::from(n);
            sum += share;
            mean += share * cos;
        }
        assert!((sum - 1.0).abs() < 2e-3, "g {g}: adds up to {sum}");
        assert!((mean - f64::from(g)).abs() < 2e-3, "g {g}: mean cosine {mean}");
    }
    assert_eq!(Phase::ISOTROPIC.evaluate(0.3), (0.25 / PI) as f32);
    // Both directions point away: straight on is opposite.
    let forwards = Phase { g: 0.8 };
    assert_eq!(forwards.between(Vec3::X, -Vec3::X), forwards.evaluate(1.0));
    assert!(forwards.between(Vec3::X, -Vec3::X) > 100.0 * forwards.between(Vec3::X, Vec3::X));
}

#[test]
fn phase_functions_draw_directions_as_they_say() {
    const CELLS: [usize; 2] = [24, 16];
    const SAMPLES: u32 = 100_000;
    for (g, wo) in [(0.0, Vec3::Z), (0.7, Vec3::new(0.48, -0.6, 0.64)), (-0.5, -Vec3::Z), (0.95, Vec3::X)] {
        let (phase, frame) = (Phase { g }, lumel::sample::warp::frame(-wo));
        let (mut counts, mut numbers) = (vec![0.0; CELLS[0] * CELLS[1]], Random::new(5));
        let mut mean = 0.0;
        for _ in 0..SAMPLES {
            let (wi, pdf) = phase.sample(wo, numbers.pair());
            assert!((wi.length() - 1.0).abs() < 1e-5);
            let turned = frame.transpose() * wi;
            assert!((pdf / phase.between(wo, wi) - 1.0).abs() < 2e-2, "g {g}: {pdf}, {}", phase.between(wo, wi));
            let row = ((f64::from(turned.z) + 1.0) * 0.5 * CELLS[0] as f64).clamp(0.0, CELLS[0] as f64 - 1.0);
            let azimuth = f64::from(turned.y.atan2(turned.x)).rem_euclid(TAU) / TAU;
            counts[row as usize * CELLS[1] + ((azimuth * CELLS[1] as f64) as usize).min(CELLS[1] - 1)] += 1.0;
            mean += f64::from(turned.z) / f64::from(SAMPLES);
        }
        // The integral of the function over a row has a closed form: its antiderivative in the cosine.
        let g = f64::from(g);
        let below = |cos: f64| match g == 0.0 {
            true => 0.5 * (cos + 1.0),
            false => (1.0 - g * g) / (2.0 * g) * ((1.0 + g * g - 2.0 * g * cos).sqrt().recip() - 1.0 / (1.0 + g)),
        };
        let edge = |row: usize| below(row as f64 / CELLS[0] as f64 * 2.0 - 1.0);
        let expected: Vec<f64> = (0..counts.len())
            .map(|i| {
                let row = i / CELLS[1];
                (edge(row + 1) - edge(row)) / CELLS[1] as f64 * f64::from(SAMPLES)
            })
            .collect();
        assert_agrees(&format!("g {g}"), &counts, &expected);
        assert!((mean - g).abs() < 4.5 / f64::from(SAMPLES).sqrt(), "g {g}: mean cosine {mean}");
    }
}

#[test]
fn free_paths_are_distributed_as_the_medium_says() {
    const CELLS: usize = 40;
    const STEPS: usize = 200;
    const SAMPLES: u32 = 50_000;
    let fog = Medium { scattering: Rgb::splat(1.1), ..in_box("fog", Vec3::splat(-1.0), Vec3::splat(2.5)) };
    let cloud = Medium { scattering: Rgb::splat(3.0), absorption: Rgb::splat(1.0), ..cloudy("cloud") };
    for (name, set) in [("fog", vec![fog.clone()]), ("cloud", vec![cloud.clone()]), ("both", vec![fog, cloud])] {
        let (media, along) = (Media::new(&scene(set)), ray([-0.5, 0.4, 0.3], [1.0, 0.05, 0.1]));
        let depth = depths(&media, &along, 4.0, CELLS * STEPS);
        let mut expected: Vec<f64> = (0..CELLS)
            .map(|c| ((-depth[c * STEPS].x).exp() - (-depth[(c + 1) * STEPS].x).exp()) * f64::from(SAMPLES))
            .collect();
        expected.push((-depth[CELLS * STEPS].x).exp() * f64::from(SAMPLES));
        let mut counts = vec![0.0; CELLS + 1];
        for i in 0..u64::from(SAMPLES) {
            // Grey media: every flight weighs its albedo, or 1.
            match media.fly(&along, 4.0, Rgb::ONE, &mut Random::new(i)) {
                Flight::Passed { weight, .. } => {
                    assert_close(name, weight, Rgb::ONE, 1e-4);
                    counts[CELLS] += 1.0;
                }
                Flight::Scattered { t, weight, .. } => {
                    assert!(weight.x <= 1.0001 && weight.x > 0.74, "{name}: {weight}");
                    counts[(f64::from(t) / 4.0 * CELLS as f64) as usize] += 1.0;
                }
            }
        }
        assert_agrees(name, &counts, &expected);
    }
}

#[test]
fn light_of_a_point_scattered_once_is_what_quadrature_says() {
    let (sigma_s, sigma_a, g) = (Rgb::new(0.6, 0.3, 1.2), Rgb::new(0.1, 0.4, 0.0), 0.6);
    let fog = Medium {
        scattering: sigma_s,
        absorption: sigma_a,
        anisotropy: g,
        ..in_box("fog", Vec3::ZERO, Vec3::new(4.0, 2.0, 2.0))
    };
    let (media, phase) = (Media::new(&scene(vec![fog])), Phase { g });
    let (eye, lamp, intensity) = (ray([-1.0, 0.8, 1.0], [1.0, 0.05, 0.0]), Vec3::new(3.0, 1.7, 1.2), 10.0);
    // Radiance that reaches the eye from the point at distance t, per metre.
    let sigma_t = (sigma_s + sigma_a).as_dvec3();
    let at = |t: f64| {
        let point = eye.origin.as_dvec3() + eye.direction.as_dvec3() * t;
        let way = lamp.as_dvec3() - point;
        let turned = phase.between(-eye.direction, way.normalize().as_vec3());
        let seen = t - 1.0 / f64::from(eye.direction.x);
        (-sigma_t * (seen + way.length())).exp() * sigma_s.as_dvec3() * f64::from(turned * intensity)
            / way.length_squared()
    };
    let (from, to) = (1.0 / f64::from(eye.direction.x), 5.0 / f64::from(eye.direction.x));
    let n = 20_000;
    let step = (to - from) / f64::from(n);
    let expected: DVec3 = (0..n).map(|i| at(from + (f64::from(i) + 0.5) * step) * step).sum();
    let mut tally = Tally::default();
    for i in 0..60_000 {
        let mut numbers = Random::new(i);
        let flight = media.fly(&eye, f32::INFINITY, Rgb::ONE, &mut numbers);
        tally.add(match flight {
            Flight::Passed { .. } => Rgb::ZERO,
            Flight::Scattered { t, weight, phase, .. } => {
                let point = eye.origin + eye.direction * t;
                let (way, distance) = ((lamp - point).normalize(), lamp.distance(point));
                let passed = media.transmittance(&Ray { origin: point, direction: way }, distance, &mut numbers);
                let turned = phase.between(-eye.direction, way);
                weight * passed * (turned * intensity / (distance * distance))
            }
        });
    }
    tally.assert_is("single scattering", expected, 0.02);
}

#[test]
fn overlapping_media_turn_light_in_proportion_to_what_they_scatter() {
    let medium = |name: &str, scattering: Rgb, anisotropy| Medium {
        scattering,
        anisotropy,
        ..in_box(name, Vec3::ZERO, Vec3::splat(3.0))
    };
    let (one, other) = (medium("one", Rgb::new(1.0, 0.5, 0.0), 0.5), medium("other", Rgb::new(0.5, 0.5, 2.0), -0.2));
    let media = Media::new(&scene(vec![one, other]));
    let along = ray([-1.0, 1.0, 1.0], [1.0, 0.0, 0.0]);
    let mut first = Tally::default();
    let mut all = Tally::default();
    for i in 0..40_000 {
        if let Flight::Scattered { weight, phase, .. } = media.fly(&along, f32::INFINITY, Rgb::ONE, &mut Random::new(i))
        {
            first.add(if phase.g == 0.5 { weight } else { Rgb::ZERO });
            all.add(weight);
        } else {
            first.add(Rgb::ZERO);
            all.add(Rgb::ZERO);
        }
    }
    let turned = 1.0 - (-3.0 * DVec3::new(1.5, 1.0, 2.0)).exp();
    all.assert_is("all", turned, 0.02);
    first.assert_is("the first", turned * DVec3::new(1.0 / 1.5, 0.5, 0.0), 0.05);
}

#[test]
fn a_medium_in_the_whole_scene_ends_beyond_its_box() {
    // A corner that no triangle has is no part of the floor.
    let positions = vec![Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 3.0, Vec3::Y * 9.0];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let floor = Surface {
        name: "floor".into(),
        mesh: 0,
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Role::default(),
    };
    let fog = Medium { absorption: Rgb::ONE, ..Medium::new("fog", MediumShape::Scene) };
    let media = Media::new(&Scene { meshes: vec![mesh], surfaces: vec![floor], media: vec![fog], ..Scene::default() });
    let up = ray([1.0, 0.0, 1.0], [0.0, 1.0, 0.0]);
    // The diagonal is 5 m: the medium goes 0.25 m beyond.
    let passed = media.transmittance(&up, f32::INFINITY, &mut Random::new(0));
    assert_close("towards the sky", passed, Rgb::splat((-0.25f32).exp()), 1e-4);
}

#[test]
fn equal_numbers_give_equal_bits() {
    let medium = Medium { scattering: Rgb::new(1.0, 2.0, 0.2), emission: Rgb::X, ..cloudy("cloud") };
    let media = [(); 2].map(|()| Media::new(&scene(vec![medium.clone()])));
    let along = ray([-1.0, 0.4, 0.3], [1.0, 0.05, 0.1]);
    for i in 0..100 {
        let [a, b] = [0, 1].map(|k| media[k].fly(&along, 5.0, Rgb::ONE, &mut Random::new(i)));
        assert_eq!(a, b);
        let [a, b] = [0, 1].map(|k| media[k].transmittance(&along, 5.0, &mut Random::new(i)));
        assert_eq!(a, b);
    }
}

#[test]
fn nothing_stands_in_the_way_of_rays_that_miss_and_of_void_media() {
    let cloud = Medium { scattering: Rgb::ONE, ..cloudy("cloud") };
    let void = [
        Medium { density: 0.0, ..cloud.clone() },
        Medium { scattering: Rgb::ZERO, ..cloud.clone() },
        Medium { grid: Some(Arc::new(DensityGrid::new([2, 1, 1], vec![0.0; 2]).unwrap())), ..cloud.clone() },
    ];
    assert!(Media::new(&scene(void.to_vec())).is_empty());
    let media = Media::new(&scene(vec![cloud]));
    assert_eq!(media.names().collect::<Vec<_>>(), ["cloud"]);
    let mut numbers = Random::new(0);
    let infinite = f32::INFINITY;
    for (ray, distance) in [
        (ray([0.0, 2.0, 0.0], [1.0, 0.0, 0.0]), infinite),
        (ray([3.0, 0.5, 0.5], [1.0, 0.0, 0.0]), infinite),
        (ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]), 0.9),
        (ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]), 0.0),
        (Ray { origin: Vec3::NAN, direction: Vec3::X }, infinite),
        (Ray { origin: -Vec3::X, direction: Vec3::ZERO }, 1.0),
    ] {
        assert_eq!(media.transmittance(&ray, distance, &mut numbers), Rgb::ONE);
        let passed = Flight::Passed { weight: Rgb::ONE, emitted: Rgb::ZERO };
        assert_eq!(media.fly(&ray, distance, Rgb::ONE, &mut numbers), passed);
    }
    assert_eq!(numbers.drawn, 0);
}

#[test]
fn hostile_media_are_told_and_left_out() {
    let sound = Medium { scattering: Rgb::ONE, ..cloudy("m") };
    let flat = |scale: Vec3| MediumShape::Box { world_from_unit: Affine3A::from_scale(scale) };
    let dense = Arc::new(DensityGrid::new([1, 1, 1], vec![1e6]).unwrap());
    let hostile: [(&str, Medium); 13] = [
        ("scattering", Medium { scattering: Rgb::splat(-1.0), ..sound.clone() }),
        ("scattering", Medium { scattering: Rgb::splat(f32::NAN), ..sound.clone() }),
        ("absorption", Medium { absorption: Rgb::new(0.0, f32::INFINITY, 0.0), ..sound.clone() }),
        ("scattering", Medium { density: 1e6, scattering: Rgb::splat(1e6), ..sound.clone() }),
        ("density", Medium { density: f32::NAN, ..sound.clone() }),
        ("emission", Medium { emission: Rgb::splat(-1.0), ..sound.clone() }),
        ("g ", Medium { anisotropy: 1.0, ..sound.clone() }),
        ("no volume", Medium { shape: flat(Vec3::new(1.0, 0.0, 1.0)), ..sound.clone() }),
        ("no volume", Medium { shape: flat(Vec3::new(1e30, 1.0, 1.0)), ..sound.clone() }),
        ("no volume", Medium { shape: flat(Vec3::splat(f32::NAN)), ..sound.clone() }),
        ("no volume", Medium { shape: MediumShape::between(Vec3::ONE, Vec3::ONE), ..sound.clone() }),
        // A scene without surfaces.
        ("no volume", Medium { shape: MediumShape::Scene, ..sound.clone() }),
        ("optical depth", Medium { grid: Some(dense), scattering: Rgb::splat(100.0), ..sound.clone() }),
    ];
    assert_eq!(sound.fault(&scene(vec![])), None);
    for (word, medium) in hostile {
        let fault = medium.fault(&scene(vec![])).unwrap_or_default();
        assert!(fault.contains(word), "{word}: {fault:?}");
        assert!(Media::new(&scene(vec![medium])).is_empty(), "{word}");
    }
    for (size, values, word) in [
        ([0, 1, 1], vec![], "no voxels"),
        ([1, 1, 2], vec![0.0], "holds 1 values"),
        ([1, 1, 1], vec![-1.0], "density -1"),
        ([1, 1, 1], vec![f32::NAN], "density NaN"),
        ([usize::MAX, 2, 2], vec![], "too large"),
        ([1 << 20, 1 << 20, 1], vec![], "too large"),
    ] {
        let fault = DensityGrid::new(size, values).unwrap_err();
        assert!(fault.contains(word), "{word}: {fault:?}");
    }
}

#[test]
fn odd_shapes_end_every_way() {
    // A needle of a box seen from far away, colours that differ by a million, a voxel among empty ones.
    let mut values = vec![0.0; 1000];
    values[555] = 1.0;
    let spark = Arc::new(DensityGrid::new([10; 3], values).unwrap());
    let needle = MediumShape::between(Vec3::new(1e6, 0.0, 0.0), Vec3::new(1e6 + 1.0, 1e-6, 1e-6));
    let mut numbers = Random::new(0);
    for shape in [needle, MediumShape::between(Vec3::splat(-1e3), Vec3::splat(1e3))] {
        for grid in [None, Some(spark.clone())] {
            let medium =
                Medium { scattering: Rgb::new(250.0, 1e-4, 0.0), emission: Rgb::ONE, grid, ..Medium::new("m", shape) };
            let haze = Medium { scattering: Rgb::new(1e6, 1.0, 0.0), grid: None, ..medium.clone() };
            let media = Media::new(&scene(vec![medium, haze]));
            for direction in [[1.0, 0.0, 0.0], [1.0, 1e-7, 1e-7], [-1.0, 0.1, -0.1], [1.0, 1.0, 1.0]] {
                for origin in [[0.0, 5e-7, 5e-7], [-1e6, 0.0, 0.0], [1e6, 5e-7, 5e-7]] {
                    let along = ray(origin, direction);
                    for throughput in [Rgb::ONE, Rgb::X, Rgb::Z, Rgb::ZERO, Rgb::new(1e-30, 1.0, 1e30)] {
                        let flight = media.fly(&along, f32::INFINITY, throughput, &mut numbers);
                        let carried = throughput * flight.weight();
                        assert!(carried.is_finite() && flight.emitted().is_finite(), "{flight:?}");
                    }
                    let passed = media.transmittance(&along, f32::INFINITY, &mut numbers);
                    assert!(passed.min_element() >= 0.0 && passed.is_finite(), "{passed}");
                }
            }
        }
    }
}
