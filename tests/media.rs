//! Participating media: rays through them against closed forms and quadrature, and what files say of them.

use glam::{Affine3A, DVec3, EulerRot, Mat3, Quat, Vec3};
use lumel::color::Rgb;
use lumel::medium::{Flight, Media};
use lumel::sample::Numbers;
use lumel::sample::sequence::{Sequence, Stage};
use lumel::scene::{DensityGrid, Medium, MediumShape, Scene};
use lumel::trace::Ray;
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
