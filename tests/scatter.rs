//! Scattering by closed forms: furnaces, reciprocity, weights, densities and sides.

mod finishes;

use finishes::{Finish, all, direction, glass, glossy, metal, sheet};
use glam::Vec3;
use lumel::color::Rgb;
use lumel::sample::Sequence;
use lumel::sample::sequence::Stage;
use lumel::scatter::{Bsdf, Scattering, Surfaces, Transport, adapt};
use lumel::scene::{Alpha, Appearance, Material, Walls};
use std::f32::consts::PI;

const COSINES: [f32; 7] = [0.03, 0.1, 0.25, 0.5, 0.72, 0.9, 1.0];

fn points(count: u32) -> impl Iterator<Item = [f32; 3]> {
    let sequence = Sequence::new(7, Stage::Path, 3);
    (0..count).map(move |k| {
        let [a, b, c, _] = sequence.point(k, 0);
        [a, b, c]
    })
}

/// The share of the power from `wo` that is sent on, by sampling.
fn sent(bsdf: &Bsdf, wo: Vec3, count: u32) -> Rgb {
    let weights = points(count).filter_map(|u| bsdf.sample(wo, u, Transport::Importance)).map(|s| s.weight.as_dvec3());
    (weights.sum::<glam::DVec3>() / f64::from(count)).as_vec3()
}

#[test]
fn furnaces_keep_their_power() {
    let start = std::time::Instant::now();
    let all = all();
    println!("{} made in {:?}", all.len(), start.elapsed());
    for finish in all {
        let bsdf = finish.bsdf();
        for side in finish.sides() {
            for cos in COSINES {
                let wo = direction(cos * side, 0.7);
                let sent = sent(&bsdf, wo, 1 << 14);
                let at = format!("{}, cos {}: {sent}", finish.name, wo.z);
                if sent.max_element() > 1.001 || (finish.is_white && sent.min_element() < 0.99) {
                    println!("BAD {at}");
                }
                if finish.is_white {}
                let known = bsdf.albedo(wo);
                if (known - sent).abs().max_element() > 0.06 {
                    println!("ALB {at}, from tables {known}");
                }
            }
        }
    }
}
