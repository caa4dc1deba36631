//! Photometric units at the border: exposure, colour temperature, normalized lights.
//!
//! UsdLux (26.x schema text): a light's luminance is `L = intensity * 2^exposure * color * temperature / sizeFactor`
//! [nit]. `sizeFactor` is 1 unless `normalize` is on; then it is the light's surface area in world space, in the stage's
//! own units of length, or the projected solid angle of a distant light.

use crate::color::{Rgb, luminance};
use glam::{DMat3, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The factor of `exposure` [stops].
pub fn exposure_scale(exposure: f32) -> f32 {
    exposure.exp2()
}

/// Blackbody colours in linear Rec.709, brightest channel 1, every 500 K from 1000 K to 10000 K: the knots of usd-core's
/// own spline (`UsdLuxBlackbodyTemperatureAsRgb`).
const BLACKBODY: [[f32; 3]; 19] = [
    [1.000000, 0.027490, 0.000000],
    [1.000000, 0.149664, 0.000000],
    [1.000000, 0.256644, 0.008095],
    [1.000000, 0.372033, 0.067450],
    [1.000000, 0.476725, 0.153601],
    [1.000000, 0.570376, 0.259196],
    [1.000000, 0.653480, 0.377155],
    [1.000000, 0.726878, 0.501606],
    [1.000000, 0.791543, 0.628050],
    [1.000000, 0.848462, 0.753228],
    [1.000000, 0.898581, 0.874905],
    [1.000000, 0.942771, 0.991642],
    [0.906947, 0.890456, 1.000000],
    [0.828247, 0.841838, 1.000000],
    [0.765791, 0.801896, 1.000000],
    [0.715255, 0.768579, 1.000000],
    [0.673683, 0.740423, 1.000000],
    [0.638992, 0.716359, 1.000000],
    [0.609681, 0.695588, 1.000000],
];

/// The colour of a blackbody of `kelvin` (clamped to 1000..=10000), luminance 1, as usd-core computes it: a Catmull-Rom
/// spline, divided by its luminance. 6500 K comes out as (1.043, 0.984, 1.035), not white; the reference code is followed.
pub fn blackbody_rgb(kelvin: f32) -> Rgb {
    let last = BLACKBODY.len() - 1;
    let at = if kelvin.is_finite() { (kelvin.clamp(1000.0, 10000.0) - 1000.0) / 500.0 } else { 11.0 };
    let i = (at.floor() as usize).min(last - 1);
    let t = at - i as f32;
    let knot = |k: usize| Rgb::from_array(BLACKBODY[k.min(last)]);
    let (a, b, c, d) = (knot(i.saturating_sub(1)), knot(i), knot(i + 1), knot(i + 2));
    let (t2, t3) = (t * t, t * t * t);
    let rgb = a * (-0.5 * t3 + t2 - 0.5 * t)
        + b * (1.5 * t3 - 2.5 * t2 + 1.0)
        + c * (-1.5 * t3 + 2.0 * t2 + 0.5 * t)
        + d * (0.5 * t3 - 0.5 * t2);
    (rgb / luminance(rgb)).max(Rgb::ZERO)
}

/// UsdLux' size factor of a distant light of full angle `degrees` (clamped to 0..=360): 1 for a sharp one, else the
/// projected solid angle of its disc.
pub fn distant_size_factor(degrees: f32) -> f64 {
    let theta = (f64::from(degrees).to_radians() / 2.0).clamp(0.0, PI);
    let sin2 = theta.sin().powi(2);
    if theta == 0.0 {
        1.0
    } else if theta <= FRAC_PI_2 {
        PI * sin2
    } else {
        PI * (2.0 - sin2)
    }
}

/// Illuminance at normal incidence [lx] from a distant light of unit luminance [nit] and full angle `degrees`: the
/// projected solid angle of its disc above the horizon. A sharp light's luminance is taken as its illuminance, as its size
/// factor of 1 implies.
pub fn distant_illuminance(degrees: f32) -> f64 {
    if f64::from(degrees).to_radians() / 2.0 <= FRAC_PI_2 { distant_size_factor(degrees) } else { PI }
}

/// Surface area of the unit sphere under `m`: the closed form where `m` scales uniformly, else a quadrature good to 1e-4.
pub fn ellipsoid_area(m: DMat3) -> f64 {
    const RINGS: usize = 128;
    // dA' = |cof(m) n| dA for the sphere's normal n.
    let cofactor = cofactor(m);
    let mut sum = 0.0;
    for ring in 0..RINGS {
        let z = (ring as f64 + 0.5) / RINGS as f64 * 2.0 - 1.0;
        let r = (1.0 - z * z).sqrt();
        for step in 0..2 * RINGS {
            let phi = (step as f64 + 0.5) / (2 * RINGS) as f64 * TAU;
            sum += (cofactor * DVec3::new(r * phi.cos(), r * phi.sin(), z)).length();
        }
    }
    sum * 4.0 * PI / (2 * RINGS * RINGS) as f64
}

/// Area of the side of the cylinder of radius 1 around X, -1..1 along it, under `m`.
pub fn cylinder_area(m: DMat3) -> f64 {
    const STEPS: usize = 1024;
    let sum: f64 = (0..STEPS)
        .map(|step| {
            let phi = (step as f64 + 0.5) / STEPS as f64 * TAU;
            m.x_axis.cross(m.z_axis * phi.cos() - m.y_axis * phi.sin()).length()
        })
        .sum();
    2.0 * TAU * sum / STEPS as f64
}

/// The cofactor matrix: what takes normals, scaled by area, along with `m`.
fn cofactor(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from usd-core's `UsdLux.BlackbodyTemperatureAsRgb`, on and between the knots.
    #[test]
    fn blackbody_agrees_with_usd_core() {
        let expected: [(f32, [f32; 3]); 9] = [
            (1000.0, [4.3055043, 0.11835831, 0.0]),
            (1234.0, [3.7318125, 0.28907123, 0.0]),
            (2700.0, [1.9353238, 0.80356574, 0.19168955]),
            (3333.0, [1.6258492, 0.8784268, 0.3614086]),
            (5000.0, [1.2135086, 0.9605443, 0.76214415]),
            (6500.0, [1.0433334, 0.98362446, 1.0346133]),
            (6700.0, [1.0278487, 0.9852259, 1.0643458]),
            (9900.0, [0.87390476, 0.9946527, 1.4242691]),
            (10000.0, [0.8718413, 0.9946879, 1.4299959]),
        ];
        for (kelvin, rgb) in expected {
            let got = blackbody_rgb(kelvin);
            assert!((got - Rgb::from_array(rgb)).abs().max_element() < 2e-5, "{kelvin} K: {got} is not {rgb:?}");
        }
        assert_eq!(blackbody_rgb(200.0), blackbody_rgb(1000.0));
        assert!(blackbody_rgb(f32::NAN).is_finite());
    }

    #[test]
    fn distant_light_of_the_schema_defaults() {
        assert!((50000.0 * distant_illuminance(0.53) - 3.36).abs() < 0.005);
        assert_eq!(distant_size_factor(0.0), 1.0);
        assert!((distant_size_factor(180.0) - PI).abs() < 1e-9);
        assert!((distant_size_factor(360.0) - 2.0 * PI).abs() < 1e-9);
        assert!((distant_illuminance(360.0) - PI).abs() < 1e-9);
    }

    #[test]
    fn areas_of_scaled_shapes() {
        let sphere = ellipsoid_area(DMat3::from_diagonal(DVec3::splat(0.5)));
        assert!((sphere - PI).abs() < 1e-9, "{sphere}");
        // Semi-axes 1, 2, 3: 48.8822 (elliptic integrals).
        let ellipsoid = ellipsoid_area(DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0)));
        assert!((ellipsoid / 48.8822 - 1.0).abs() < 1e-4, "{ellipsoid}");
        // Length 4, radius 0.5.
        let cylinder = cylinder_area(DMat3::from_diagonal(DVec3::new(2.0, 0.5, 0.5)));
        assert!((cylinder - 4.0 * PI).abs() < 1e-9, "{cylinder}");
    }
}
