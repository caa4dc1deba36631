//! Lobes fitted to measured reflections: what lobes made comes back, and the sample of a paint within its stated error.

use glam::Vec3;
use lumel::color::Rgb;
use lumel::load::{LoadOptions, load_with};
use lumel::scatter::fit::{Measurement, fit};
use lumel::scene::{Lobe, Lobes};
use std::f32::consts::{FRAC_1_PI, PI};
use std::path::Path;

/// Directions at polar angles in degrees and an azimuth between them.
fn pair(incoming: f32, outgoing: f32, azimuth: f32) -> (Vec3, Vec3) {
    let at = |polar: f32, azimuth: f32| {
        let ((s, c), (sp, cp)) = (polar.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
        Vec3::new(s * cp, s * sp, c)
    };
    (at(incoming, 0.0), at(outgoing, azimuth))
}

fn grid() -> Vec<(f32, f32, f32)> {
    let polar = || (0..6).map(|k| 15.0 * k as f32);
    let azimuths = || (0..13).map(|k| 15.0 * k as f32);
    polar().flat_map(|i| polar().flat_map(move |o| azimuths().map(move |a| (i, o, a)))).collect()
}

fn value(lobes: &Lobes, i: Vec3, o: Vec3) -> Rgb {
    let lobe = |l: &Lobe| {
        let base = (l.x * (o.x * i.x) + l.y * (o.y * i.y) + l.z * (o.z * i.z)).max(Rgb::ZERO);
        Rgb::new(base.x.powf(l.exponent.x), base.y.powf(l.exponent.y), base.z.powf(l.exponent.z))
    };
    lobes.diffuse * FRAC_1_PI + lobes.lobes.iter().map(lobe).sum::<Rgb>()
}

#[test]
fn lobes_come_back() {
    let lobe = Lobe {
        x: Rgb::new(-0.9, -0.8, 0.6),
        y: Rgb::new(-0.9, -0.8, 0.6),
        z: Rgb::new(0.8, 0.9, 0.7),
        exponent: Rgb::new(12.0, 5.0, 8.0),
    };
    let made = Lobes { diffuse: Rgb::new(0.3, 0.1, 0.5), lobes: vec![lobe] };
    let measured = grid().into_iter().map(|(i, o, a)| {
        let (incoming, outgoing) = pair(i, o, a);
        Measurement { incoming, outgoing, reflectance: value(&made, incoming, outgoing) }
    });
    let found = fit(&measured.collect::<Vec<_>>(), 1).unwrap();
    assert!(found.error.max_element() < 1e-4, "{}", found.error);
    assert!(found.lobes.diffuse.distance(made.diffuse) < 1e-3, "{:?}", found.lobes);
    let own = found.lobes.lobes[0];
    assert!((own.exponent / lobe.exponent - 1.0).abs().max_element() < 1e-2, "{own:?}");
    assert!(own.x.distance(lobe.x) < 1e-2 && own.z.distance(lobe.z) < 1e-2, "{own:?}");
}

/// The sample's closed form: Ward 1992, "Measuring and Modeling Anisotropic Reflection", equation 5a with both widths
/// alike.
fn ward(i: Vec3, o: Vec3) -> Rgb {
    const DIFFUSE: Rgb = Rgb::new(0.08, 0.16, 0.38);
    const SPECULAR: f32 = 0.06;
    const ALPHA: f32 = 0.25;
    let h = (i + o).normalize();
    let tan2 = (1.0 - h.z * h.z) / (h.z * h.z);
    let a2 = ALPHA * ALPHA;
    DIFFUSE / PI + Rgb::splat(SPECULAR * (-tan2 / a2).exp() / (4.0 * PI * a2 * (i.z * o.z).sqrt()))
}

const TABLE: &str = include_str!("../samples/lobes/paint.csv");

fn table() -> Vec<Measurement> {
    let rows = TABLE.lines().filter(|line| !line.starts_with('#') && !line.starts_with("theta"));
    let rows = rows.map(|line| {
        let numbers: Vec<f32> = line.split(',').map(|n| n.trim().parse().unwrap()).collect();
        let (incoming, outgoing) = pair(numbers[0], numbers[1], numbers[2]);
        Measurement { incoming, outgoing, reflectance: Rgb::from_slice(&numbers[3..6]) }
    });
    rows.collect()
}

#[test]
fn a_paint_is_fitted() {
    let measured = table();
    assert_eq!(measured.len(), grid().len());
    for m in &measured {
        let expected = ward(m.incoming, m.outgoing);
        assert!((m.reflectance - expected).abs().max_element() < 1e-4, "{} {expected}", m.reflectance);
    }
    // Twelve coefficients for 468 directions; what is missed is most of the rise at grazing angles.
    let found = fit(&measured, 1).unwrap();
    assert!(found.error.cmple(Rgb::new(0.05, 0.037, 0.021)).all(), "{}", found.error);
    let two = fit(&measured, 2).unwrap();
    assert!(two.error.cmple(0.9 * found.error).all(), "{} {}", two.error, found.error);

    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/lobes/paint.gltf");
    let options = LoadOptions { appearance: true, ..LoadOptions::default() };
    let loaded = load_with(&path, &options).unwrap();
    let kept = loaded.scene.materials[0].appearance.as_ref().and_then(|a| a.measured.clone()).unwrap();
    assert!(kept.diffuse.distance(found.lobes.diffuse) < 1e-4, "{kept:?}");
    let (kept, own) = (kept.lobes[0], found.lobes.lobes[0]);
    assert!(kept.x.distance(own.x) < 1e-3 && kept.z.distance(own.z) < 1e-3, "{kept:?} {own:?}");
    assert!(kept.exponent.distance(own.exponent) < 1e-2, "{kept:?} {own:?}");
}

#[test]
fn what_cant_be_fitted_is_refused() {
    let sound = Measurement { incoming: Vec3::Z, outgoing: Vec3::Z, reflectance: Rgb::ONE };
    for (measured, lobes, part) in [
        (vec![sound; 3], 1, "measure more"),
        (vec![sound; 300], 99, "lobes are asked for"),
        (vec![Measurement { incoming: -Vec3::Z, ..sound }; 9], 1, "measurement 0"),
        (vec![Measurement { reflectance: Rgb::splat(f32::NAN), ..sound }; 9], 1, "measurement 0"),
    ] {
        let error = fit(&measured, lobes).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    // The same direction over and over tells nothing, and does no harm.
    assert!(fit(&vec![sound; 9], 1).unwrap().lobes.fault().is_none());
}
