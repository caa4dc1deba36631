//! The clear sky by day, as a picture: absolute luminance and colour by direction for a height of the sun and a turbidity.
//!
//! Preetham, Shirley, Smits 1999, "A Practical Analytic Model for Daylight": the distribution is that of Perez et al. 1993, its
//! coefficients, zenith luminance and zenith chromaticity are fitted to a simulation (appendix A.2). The sun's disc is not in it.
//!
//! The model's luminances are about twice those of measured clear skies (Zotti, Wilkie, Purgathofer 2007, "A Critical Review of
//! the Preetham Skylight Model"). They are scaled so that at a turbidity of 3 the illuminance of a horizontal plane is that of
//! the IES' clear sky, 0.8 + 15.5 sqrt(sin h) klx for a sun at height h (IES RP-21, 1984); haze changes it as the model has it.
//! Limits: fitted to turbidities of 2 to 6 or so and a sun above the horizon; below the horizon the picture is black, and it is
//! for the scene to have a ground.

use super::{Texels, Texture};
use crate::color::{Rgb, luminance};
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::PI;

/// A clear sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClearSky {
    towards_sun: Vec3,
    turbidity: f32,
    /// Factor on the model's luminance.
    scale: f32,
}

/// The turbidity of the sky that the scale comes from.
const CLEAR: f32 = 3.0;

/// Turbidities that the model is used for.
pub const TURBIDITY: [f32; 2] = [1.7, 10.0];

/// The picture's size [texels]: the luminance changes slowly, but for the sun's aureole, some degrees wide.
const SIZE: [u32; 2] = [1024, 512];

/// Towards a place in the sky, unit: `elevation` above the horizon, `azimuth` clockwise from north, which is -Z, to east, +X
/// \[degrees\].
pub fn towards(elevation: f32, azimuth: f32) -> Vec3 {
    let ((sin, cos), (east, north)) = (elevation.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
    Vec3::new(cos * east, sin, -cos * north)
}

/// The inverse of [`towards`], of a unit vector \[degrees\].
pub fn elevation_azimuth(towards: Vec3) -> (f32, f32) {
    (towards.y.clamp(-1.0, 1.0).asin().to_degrees(), towards.x.atan2(-towards.z).to_degrees())
}

/// The five coefficients of Perez' distribution for Y, x and y: a line in the turbidity each.
const PEREZ: [[[f32; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
];

/// Zenith chromaticity x and y: powers 2, 1, 0 of the turbidity by powers 3, 2, 1, 0 of the sun's angle to the zenith.
const ZENITH: [[[f32; 4]; 3]; 2] = [
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
];

impl ClearSky {
    /// The sky around a sun in the unit direction `towards_sun`, not below the horizon. `turbidity` says how hazy the air is: 2
    /// very clear, 3 clear, 6 hazy; see [`TURBIDITY`].
    pub fn new(towards_sun: Vec3, turbidity: f32) -> Self {
        let model = Self { towards_sun, turbidity: CLEAR, scale: 1.0 };
        let measured = 800.0 + 15_500.0 * towards_sun.y.max(0.0).sqrt();
        Self { towards_sun, turbidity, scale: measured / model.illuminance() }
    }

    /// Illuminance of a horizontal plane [lx], by a quadrature over the cosine.
    pub fn illuminance(&self) -> f32 {
        const SIDE: u32 = 128;
        let mut sum = 0.0;
        for (i, j) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))) {
            let [s, t] = [i, j].map(|k| (k as f32 + 0.5) / SIDE as f32);
            let (sin, cos) = (2.0 * PI * t).sin_cos();
            sum += f64::from(luminance(self.radiance(Vec3::new(s.sqrt() * cos, (1.0 - s).sqrt(), s.sqrt() * sin))));
        }
        PI * (sum / f64::from(SIDE * SIDE)) as f32
    }

    /// Radiance from the unit direction `d` [nit]; black below the horizon.
    pub fn radiance(&self, d: Vec3) -> Rgb {
        if d.y < 0.0 {
            return Rgb::ZERO;
        }
        let sun = self.towards_sun.y.clamp(0.0, 1.0).acos();
        let gamma = d.dot(self.towards_sun).clamp(-1.0, 1.0).acos();
        let zenith = self.zenith(sun);
        let [level, x, y] = std::array::from_fn(|k| {
            let c = PEREZ[k].map(|[slope, offset]| slope * self.turbidity + offset);
            zenith[k] * perez(&c, d.y, gamma) / perez(&c, 1.0, sun)
        });
        from_chromaticity(self.scale * level.max(0.0), x, y)
    }

    /// Luminance [nit] and chromaticity of the zenith for a sun at `sun` [rad] to it.
    fn zenith(&self, sun: f32) -> [f32; 3] {
        let t = self.turbidity;
        let chi = (4.0 / 9.0 - t / 120.0) * (PI - 2.0 * sun);
        let luminance = 1000.0 * ((4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192);
        let powers = |c: &[f32; 4]| ((c[0] * sun + c[1]) * sun + c[2]) * sun + c[3];
        let chromaticity = |k: usize| {
            let [a, b, c] = &ZENITH[k];
            (powers(a) * t + powers(b)) * t + powers(c)
        };
        [luminance.max(0.0), chromaticity(0), chromaticity(1)]
    }

    /// The sky as a latlong picture [nit], in the layout of [`super::Environment::uv`] without a rotation.
    pub fn picture(&self) -> Texture {
        let [width, height] = SIZE;
        let sky = super::Environment { world_from_sky: Mat3::IDENTITY, ..super::Environment::constant("", Rgb::ONE) };
        let mut texels = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let uv = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
                texels.push(self.radiance(sky.direction(uv)).extend(1.0).to_array());
            }
        }
        Texture { name: "clear sky".into(), width, height, texels: Texels::Float(texels) }
    }
}

/// Perez' distribution at `cos` to the zenith and the angle `gamma` [rad] to the sun.
fn perez(c: &[f32; 5], cos: f32, gamma: f32) -> f32 {
    // At the horizon itself 1 / cos is infinite; a tenth of a degree above it the sky is as bright.
    let cos_gamma = gamma.cos();
    (1.0 + c[0] * (c[1] / cos.max(2e-3)).exp()) * (1.0 + c[2] * (c[3] * gamma).exp() + c[4] * cos_gamma * cos_gamma)
}

/// Linear Rec.709 of a luminance and CIE 1931 chromaticity (IEC 61966-2-1, D65), so that its luminance is kept; colours out of
/// gamut are brought to its border.
fn from_chromaticity(y_luminance: f32, x: f32, y: f32) -> Rgb {
    let y = y.max(1e-4);
    let (big_x, big_z) = (y_luminance * x / y, y_luminance * (1.0 - x - y) / y);
    let rgb = Rgb::new(
        3.240_97 * big_x - 1.537_383_2 * y_luminance - 0.498_610_76 * big_z,
        -0.969_243_64 * big_x + 1.875_967_5 * y_luminance + 0.041_555_06 * big_z,
        0.055_630_08 * big_x - 0.203_976_96 * y_luminance + 1.056_971_5 * big_z,
    )
    .max(Rgb::ZERO);
    let clipped = luminance(rgb);
    if clipped > 0.0 { rgb * (y_luminance / clipped) } else { Rgb::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_follow_the_compass() {
        assert!(towards(0.0, 0.0).distance(Vec3::NEG_Z) < 1e-6);
        assert!(towards(0.0, 90.0).distance(Vec3::X) < 1e-6);
        assert!(towards(90.0, 123.0).distance(Vec3::Y) < 1e-6);
    }

    #[test]
    fn the_zenith_has_the_model_s_luminance() {
        // Sun 30 degrees from the zenith, turbidity 3: chi = (4/9 - 3/120) (pi - pi/3) = 0.878482, tan = 1.205933, so that
        // Y = (12.1359 - 4.9710) 1.205933 - 0.6465 + 2.4192 = 10.41309 kcd/m^2.
        let model = ClearSky { towards_sun: towards(60.0, 40.0), turbidity: 3.0, scale: 1.0 };
        let zenith = luminance(model.radiance(Vec3::Y));
        assert!((zenith / 10_413.1 - 1.0).abs() < 1e-3, "{zenith}");
    }

    #[test]
    fn the_sky_is_as_skies_are() {
        let sky = ClearSky::new(towards(60.0, 40.0), 3.0);
        // Blue above, brighter and paler round the sun and at the horizon, symmetric about the sun's plane, black below.
        let up = sky.radiance(Vec3::Y);
        assert!(up.z > up.x && up.min_element() > 0.0);
        assert!(luminance(sky.radiance(towards(55.0, 40.0))) > luminance(up));
        let (left, right) = (sky.radiance(towards(20.0, 10.0)), sky.radiance(towards(20.0, 70.0)));
        assert!((left - right).abs().max_element() < 1e-3 * luminance(left));
        assert_eq!(sky.radiance(towards(-1.0, 0.0)), Rgb::ZERO);
        // Measured zeniths, (1.376 T - 1.81) tan h + 0.38 kcd/m^2 (Karayel et al. 1984): within half of it.
        let measured = 1000.0 * ((1.376 * 3.0 - 1.81) * 60f32.to_radians().tan() + 0.38);
        assert!((luminance(up) / measured - 1.0).abs() < 0.5, "{} {measured}", luminance(up));
        // More haze, more light from the sky.
        assert!(ClearSky::new(towards(60.0, 40.0), 5.0).illuminance() > sky.illuminance());
    }

    #[test]
    fn its_picture_gives_the_illuminance_of_a_clear_day() {
        for height in [15.0f32, 60.0] {
            let picture = ClearSky::new(towards(height, 0.0), 3.0).picture();
            let sky = super::super::Environment::constant("", Rgb::ONE);
            let (mut sum, rows, columns) = (0.0f64, 512, 1024);
            for y in 0..rows / 2 {
                for x in 0..columns {
                    let uv = Vec2::new((x as f32 + 0.5) / columns as f32, (y as f32 + 0.5) / rows as f32);
                    let l = picture.texel(x, y).truncate();
                    let solid_angle = (PI / rows as f32) * (2.0 * PI / columns as f32) * (PI * uv.y).sin();
                    sum += f64::from(luminance(l) * sky.direction(uv).y * solid_angle);
                }
            }
            let expected = f64::from(800.0 + 15_500.0 * height.to_radians().sin().sqrt());
            println!("{height}: {sum:.0} lx");
            assert!((sum / expected - 1.0).abs() < 0.01, "{sum} against {expected}");
        }
    }
}
