//! Directions drawn from surfaces follow the densities that are told of them: chi-squared over a grid of the sphere.

mod finishes;

use finishes::{Finish, all, direction};
use glam::Vec3;
use lumel::sample::Sequence;
use lumel::sample::sequence::Stage;
use lumel::scatter::{Bsdf, Transport};
use std::f64::consts::TAU;

/// Cells by height (z from -1 to 1) and by azimuth.
const HEIGHTS: usize = 32;
const AZIMUTHS: usize = 24;
const DRAWN: u32 = 20_000;

/// Independent numbers: a sequence's stratification would make the statistic too small.
fn numbers(seed: u32, k: u32) -> [f32; 3] {
    std::array::from_fn(|d| {
        (Sequence::new(seed, Stage::Path, u64::from(k)).hash(d as u32) >> 8) as f32 / (1u32 << 24) as f32
    })
}

fn cell(d: Vec3) -> usize {
    let height = ((f64::from(d.z) + 1.0) * 0.5 * HEIGHTS as f64) as usize;
    let azimuth = (f64::from(d.y).atan2(f64::from(d.x)).rem_euclid(TAU) / TAU * AZIMUTHS as f64) as usize;
    height.min(HEIGHTS - 1) * AZIMUTHS + azimuth.min(AZIMUTHS - 1)
}

/// The integral of the density over each cell, by midpoints that double until they agree.
fn expected(bsdf: &Bsdf, wo: Vec3) -> Vec<f64> {
    let density = |z: f64, phi: f64| {
        let r = (1.0 - z * z).max(0.0).sqrt();
        let wi = Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32);
        f64::from(bsdf.pdf(wo, wi.normalize(), Transport::Radiance))
    };
    let (dz, dphi) = (2.0 / HEIGHTS as f64, TAU / AZIMUTHS as f64);
    let integral = |low: [f64; 2], n: usize| {
        let (hz, hp) = (dz / n as f64, dphi / n as f64);
        let mut sum = 0.0;
        for a in 0..n {
            for b in 0..n {
                sum += density(low[0] + (a as f64 + 0.5) * hz, low[1] + (b as f64 + 0.5) * hp);
            }
        }
        sum * hz * hp
    };
    let cells = (0..HEIGHTS * AZIMUTHS).map(|k| {
        let low = [-1.0 + (k / AZIMUTHS) as f64 * dz, (k % AZIMUTHS) as f64 * dphi];
        let (mut n, mut last) = (8, integral(low, 4));
        loop {
            let next = integral(low, n);
            if (next - last).abs() < 1e-3 * next + 1e-6 || n >= 256 {
                return next;
            }
            (n, last) = (2 * n, next);
        }
    });
    cells.collect()
}

/// The statistic over its own spread: cells of less than five expected directions are taken together.
fn deviation(expected: &[f64], counts: &[u32]) -> f64 {
    let (mut chi2, mut freedom) = (0.0, 0.0);
    let mut pool = (0.0, 0.0);
    for (share, count) in expected.iter().zip(counts) {
        let (e, c) = (share * f64::from(DRAWN), f64::from(*count));
        if e < 5.0 {
            pool = (pool.0 + e, pool.1 + c);
        } else {
            chi2 += (c - e).powi(2) / e;
            freedom += 1.0;
        }
    }
    if pool.0 >= 5.0 {
        chi2 += (pool.1 - pool.0).powi(2) / pool.0;
        freedom += 1.0;
    } else {
        assert!(pool.1 <= 25.0, "{} directions where {} are expected", pool.1, pool.0);
    }
    // Wilson and Hilferty 1931: the cube root is close to normal.
    let spread = 2.0 / (9.0 * freedom);
    ((chi2 / f64::max(freedom, 1.0)).cbrt() - (1.0 - spread)) / spread.sqrt()
}

#[test]
fn directions_follow_their_density() {
    // Narrow peaks can't be integrated cell by cell; they are the same code at another width.
    let wide = |f: &Finish| !f.name.ends_with(" 0.07");
    let mut tests = Vec::new();
    for (k, finish) in all().iter().filter(|f| wide(f)).enumerate() {
        let bsdf = finish.bsdf();
        for side in finish.sides() {
            for cos in [0.12f32, 0.5, 0.95] {
                let wo = direction(cos * side, 2.0);
                let mut counts = vec![0u32; HEIGHTS * AZIMUTHS];
                let mut single = 0u32;
                let mut lost = 0u32;
                for n in 0..DRAWN {
                    match bsdf.sample(wo, numbers(k as u32, n), Transport::Radiance) {
                        Some(s) if s.delta => single += 1,
                        Some(s) => counts[cell(s.direction)] += 1,
                        None => lost += 1,
                    }
                }
                let expected = expected(&bsdf, wo);
                let whole: f64 = expected.iter().sum::<f64>() + f64::from(single + lost) / f64::from(DRAWN);
                let at = format!("{} from cos {}", finish.name, wo.z);
                assert!((whole - 1.0).abs() < 0.02, "{at}: densities and single directions add up to {whole}");
                tests.push((deviation(&expected, &counts), at));
            }
        }
    }
    // Beyond 5.5 spreads lies one in 5e7: one in 1e5 for all 300 tests together (Bonferroni).
    let limit = 5.5;
    tests.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (worst, at) = &tests[0];
    assert!(*worst < limit, "{at}: {worst:.1} spreads, at most {limit:.1} over {} tests", tests.len());
}
