//! Photometric webs: luminous intensity by direction, as lamps are measured (IES LM-63, IES LM-75).
//!
//! A web is a grid over two angles, read bilinearly. What lies outside of its vertical angles is dark. The angles are those of
//! the three photometric systems, about a beam along +Z with +X to the right and +Y up, seen along the beam:
//!
//! - type C: vertical angle from the beam (0) to its opposite (pi); horizontal angle from +X towards +Y;
//! - type B: the polar axis is X: vertical angle about it from the beam towards +Y, horizontal angle towards +X;
//! - type A: the polar axis is Y: horizontal angle about it from the beam towards +X, vertical angle towards +Y.

use glam::{Mat3, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// The photometric system of a web's angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WebKind {
    A,
    B,
    C,
}

/// Luminous intensity by direction.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotometricWeb {
    /// The file that it was read from, for messages.
    pub name: String,
    pub kind: WebKind,
    /// Ascending, at least one [rad]: within 0..=pi (C), -pi/2..=pi/2 (A and B).
    pub vertical: Vec<f32>,
    /// Ascending, at least two [rad]. C: a whole turn, the last column equal to the first. A and B: within -pi/2..=pi/2.
    pub horizontal: Vec<f32>,
    /// Intensity [cd], a column of verticals for each horizontal angle; none is negative.
    pub candela: Vec<f32>,
    /// What the file states that the lamps give in all [lm]; none for absolute photometry.
    pub rated_lumens: Option<f64>,
    /// Pairs of a tilt of the luminaire from straight down [rad] and the factor on its light (TILT=INCLUDE), ascending.
    pub tilt: Vec<[f32; 2]>,
}

impl PhotometricWeb {
    /// The intensity [cd] along the unit vector `d` of the web's frame.
    pub fn intensity(&self, d: Vec3) -> f32 {
        let along = |c: f32| c.clamp(-1.0, 1.0);
        let (vertical, horizontal) = match self.kind {
            WebKind::C => {
                let first = self.horizontal[0];
                (along(d.z).acos(), first + (d.y.atan2(d.x) - first).rem_euclid(TAU))
            }
            WebKind::B => (d.y.atan2(d.z), along(d.x).asin()),
            WebKind::A => (along(d.y).asin(), d.x.atan2(d.z)),
        };
        let Some(((h, v), (s, t))) = place(&self.horizontal, horizontal)
            .zip(place(&self.vertical, vertical))
            .map(|((h, s), (v, t))| ((h, v), (s, t)))
        else {
            return 0.0;
        };
        let rows = self.vertical.len();
        let at = |h: usize, v: usize| self.candela[h.min(self.horizontal.len() - 1) * rows + v.min(rows - 1)];
        let low = at(h, v) + (at(h, v + 1) - at(h, v)) * t;
        let high = at(h + 1, v) + (at(h + 1, v + 1) - at(h + 1, v)) * t;
        low + (high - low) * s
    }

    /// The power of the web [lm]: the integral of the intensity over all directions, exact for what is read bilinearly.
    pub fn power(&self) -> f64 {
        let rows = self.vertical.len();
        let columns = self.horizontal.len();
        let at = |h: usize, v: usize| f64::from(self.candela[h * rows + v]);
        let (vertical, horizontal): (Vec<f64>, Vec<f64>) =
            (wide(&self.vertical).collect(), wide(&self.horizontal).collect());
        match self.kind {
            WebKind::C => {
                let column = |h: usize| integral(&vertical, |v| at(h, v), over_sine);
                integral(&horizontal, column, over_nothing)
            }
            WebKind::A => {
                let column = |h: usize| integral(&vertical, |v| at(h, v), over_cosine);
                integral(&horizontal, column, over_nothing)
            }
            WebKind::B => {
                let row = |v: usize| integral(&horizontal, |h| at(h, v), over_cosine);
                let rows: Vec<f64> = (0..rows).map(row).collect();
                debug_assert!(columns > 0);
                integral(&vertical, |v| rows[v], over_nothing)
            }
        }
    }

    /// The mean intensity [cd] over the sphere, or over a hemisphere where the verticals span no more than that: what a web is
    /// divided by to be normalized. The reference renderer of UsdLux has the same two cases.
    pub fn mean_intensity(&self) -> f64 {
        /// Verticals that span more than a right angle by this count as a sphere's [rad].
        const SLACK: f32 = 0.1;
        let span = self.vertical[self.vertical.len() - 1] - self.vertical[0];
        let solid_angle = if span > FRAC_PI_2 + SLACK { 4.0 } else { 2.0 };
        self.power() / (solid_angle * std::f64::consts::PI)
    }

    /// The factor on the light of a luminaire tilted by `angle` [rad] from straight down; 1 where the file has none.
    pub fn tilt_factor(&self, angle: f32) -> f32 {
        let (Some(first), Some(last)) = (self.tilt.first(), self.tilt.last()) else { return 1.0 };
        let next = self.tilt.partition_point(|pair| pair[0] <= angle);
        match (next.checked_sub(1).and_then(|k| self.tilt.get(k)), self.tilt.get(next)) {
            (Some([a, p]), Some([b, q])) => p + (q - p) * (angle - a) / (b - a),
            (None, _) => first[1],
            (_, None) => last[1],
        }
    }
}

/// The interval of `angles` that holds `at`, and the place in it, 0..=1; `None` outside.
fn place(angles: &[f32], at: f32) -> Option<(usize, f32)> {
    /// Angles of a file in degrees, turned to radians, round by less than this.
    const ROUNDING: f32 = 1e-5;
    let (first, last) = (angles[0], angles[angles.len() - 1]);
    if !(first - ROUNDING..=last + ROUNDING).contains(&at) {
        return None;
    }
    let k = angles.partition_point(|&a| a <= at).clamp(1, angles.len().max(2) - 1) - 1;
    let Some(next) = angles.get(k + 1) else { return Some((k, 0.0)) };
    Some((k, ((at - angles[k]) / (next - angles[k])).clamp(0.0, 1.0)))
}

fn wide(values: &[f32]) -> impl Iterator<Item = f64> {
    values.iter().map(|v| f64::from(*v))
}

/// The integral of what is linear between `value`s at `angles`, times a weight: `weighed` tells the integrals of 1 and of
/// the way from the start, times the weight, over an interval.
fn integral(angles: &[f64], value: impl Fn(usize) -> f64, weighed: impl Fn(f64, f64) -> [f64; 2]) -> f64 {
    angles.windows(2).enumerate().fold(0.0, |sum, (k, pair)| {
        let (p, q) = (value(k), value(k + 1));
        let [whole, way] = weighed(pair[0], pair[1]);
        sum + p * whole + (q - p) / (pair[1] - pair[0]) * way
    })
}

fn over_nothing(a: f64, b: f64) -> [f64; 2] {
    [b - a, 0.5 * (b - a).powi(2)]
}

fn over_sine(a: f64, b: f64) -> [f64; 2] {
    [a.cos() - b.cos(), b.sin() - a.sin() - (b - a) * b.cos()]
}

fn over_cosine(a: f64, b: f64) -> [f64; 2] {
    [b.sin() - a.sin(), (b - a) * b.sin() + b.cos() - a.cos()]
}

/// A web on a light.
#[derive(Clone, Debug)]
pub struct Profile {
    pub web: Arc<PhotometricWeb>,
    /// Factor on the intensity.
    pub scale: f32,
    /// UsdLux `shaping:ies:angleScale`: 0 leaves the angles to the beam as they are.
    pub angle_scale: f32,
    /// The web's frame from the light's, in which the light shines along -Z. It may mirror.
    pub web_from_light: Mat3,
}

impl Profile {
    /// The intensity [cd] along the unit vector `direction` of the light's frame, `scale` included.
    pub fn intensity(&self, direction: Vec3) -> f32 {
        let d = self.web_from_light * direction;
        if self.angle_scale == 0.0 {
            return self.scale * self.web.intensity(d);
        }
        // UsdLux ShapingAPI, `shaping:ies:angleScale`.
        let theta = d.z.clamp(-1.0, 1.0).acos();
        let scaled = match self.angle_scale {
            s if s > 0.0 => theta / s,
            s => (theta - PI) / -s + PI,
        };
        if !(0.0..=PI).contains(&scaled) {
            return 0.0;
        }
        let around = d.truncate().normalize_or(glam::Vec2::X);
        self.scale * self.web.intensity((around * scaled.sin()).extend(scaled.cos()))
    }

    /// What the light would give as a point that shines with these intensities [lm]: a quadrature where angles are scaled.
    pub fn power(&self) -> f64 {
        if self.angle_scale == 0.0 {
            return f64::from(self.scale) * self.web.power();
        }
        const STEPS: u32 = 256;
        let mut sum = 0.0;
        for i in 0..STEPS {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / STEPS as f32;
            for j in 0..STEPS {
                let (sin, cos) = (TAU * (j as f32 + 0.5) / STEPS as f32).sin_cos();
                let r = (1.0 - z * z).sqrt();
                sum += f64::from(self.intensity(Vec3::new(r * cos, r * sin, z)));
            }
        }
        sum * 4.0 * std::f64::consts::PI / f64::from(STEPS * STEPS)
    }
}
