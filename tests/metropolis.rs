//! Metropolis light transport: known radiance, and paths of the other methods.

mod support;
mod walks;

use lumel::integrate::bidirectional::Bidirectional;
use lumel::integrate::metropolis::Metropolis;
use walks::{Prepared, Runs, Standing, Way, blocks, cornell, film, furnace, passes_of, view};

#[test]
fn a_furnace_is_even() {
    let (prepared, view) = furnace();
    let film = film(Way::Metropolis, &prepared.world(), &view, 64, None, 0);
    let values = film.mean();
    let mean = blocks(&values, 16, 16)[0];
    let rough = blocks(&values, 16, 4);
    println!("{mean}, blocks {rough:.3?}");
    assert!((mean / 2.0 - 1.0).abs() < 0.01, "{mean}");
    // Chains come to every part of the picture as often, but for chance.
    assert!(rough.iter().all(|v| (v / 2.0 - 1.0).abs() < 0.25), "{rough:?}");
}

#[test]
fn pictures_agree_with_those_of_paths() {
    for standing in [Standing::Diffuse, Standing::Mirror, Standing::Glass, Standing::Glossy] {
        let prepared = Prepared::new(cornell(standing));
        let (world, view) = (prepared.world(), view(16, 16));
        let runs =
            |way, passes| Runs::of(12, |seed| blocks(&film(way, &world, &view, passes, None, seed).mean(), 16, 4));
        let (paths, chains) = (runs(Way::Path, 32), runs(Way::Metropolis, 48));
        let [spread, mean, off] = chains.against(&paths);
        println!("{standing:?}: spread {spread:.2}, mean z {mean:+.2}, whole {:+.3} %", 100.0 * off);
        assert!(spread < 1.7 && mean.abs() < 1.0 && off.abs() < 0.02, "{standing:?}: {spread} {mean} {off}");
    }
}

#[test]
fn groups_tell_an_honest_error() {
    // Errors against the truth are as large as groups say.
    let prepared = Prepared::new(cornell(Standing::Diffuse));
    let (world, view) = (prepared.world(), view(16, 16));
    let truth = blocks(&film(Way::Bidirectional, &world, &view, 384, None, 9).mean(), 16, 1);
    let (mut squares, mut expected) = (0.0, 0.0);
    for seed in 0..8 {
        let film = film(Way::Metropolis, &world, &view, 64, None, seed);
        let values = blocks(&film.mean(), 16, 1);
        squares += values.iter().zip(&truth).map(|(v, t)| (v - t).powi(2)).sum::<f64>();
        expected += film.standard_error().iter().map(|e| f64::from(*e).powi(2)).sum::<f64>();
    }
    let ratio = (squares / expected).sqrt();
    println!("error over what groups say: {ratio:.3}");
    assert!((0.85..1.2).contains(&ratio), "{ratio}");
}

#[test]
fn the_same_bits_for_one_and_two_threads() {
    let prepared = Prepared::new(cornell(Standing::Glass));
    let (world, view) = (prepared.world(), view(24, 16));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let film = pool.install(|| {
            let both = Bidirectional::new(&world, &view, None, 7, "").unwrap();
            passes_of(&mut Metropolis::new(both), &view, 3)
        });
        assert_eq!(film.passes(), 3);
        film.mean().iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(2));
}
