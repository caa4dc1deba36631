//! Lafortune lobes that fit a measured reflection (Lafortune et al. 1997, section 4): least squares by Levenberg and
//! Marquardt (Marquardt 1963), each channel on its own.
//!
//! Lobes are isotropic: C_x = C_y. With one lobe a channel has four coefficients, 12 in all. Residuals are weighed by
//! the cosines of both directions, as grazing ones, where measurements are least sure, would outweigh all others. Lobes
//! are added one at a time, each from several starts, mirrors and ones that shine back, and all are fitted again; so no
//! guess is needed.
//!
//! Cost: measurements times coefficients squared, a few hundred times. Directions are unit, and above the surface.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::scene::{Lobe, Lobes};
use glam::Vec3;
use nalgebra::{DMatrix, DVector};

/// The reflection in one pair of directions.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Unit directions away from the surface, whose normal is +Z.
    pub incoming: Vec3,
    pub outgoing: Vec3,
    /// The BRDF [1/sr].
    pub reflectance: Rgb,
}

/// Lobes, and how well they fit.
#[derive(Clone, Debug)]
pub struct Fitted {
    pub lobes: Lobes,
    /// Root mean square of the weighed residuals over that of the weighed measurements, by channel.
    pub error: Rgb,
}

/// Steps of one fit, at most.
const MOST_STEPS: usize = 200;
/// A fit has ended once a step changes its squared error by less than this share.
const SETTLED: f64 = 1e-9;
/// Damping that leaves no step to take.
const MOST_DAMPING: f64 = 1e12;
/// Coefficients of a lobe: C_x = C_y, C_z and the logarithm of the exponent; before them comes the diffuse albedo.
const OF_A_LOBE: usize = 3;
/// Where lobes are started: mirrors and one that shines back, broad and narrow.
const STARTS: [[f64; 2]; 6] = [[-1.0, 3.0], [-1.0, 12.0], [-1.0, 50.0], [-1.0, 200.0], [0.7, 3.0], [0.7, 20.0]];

/// Fits `lobe_count` lobes and a diffuse part to `measured`.
///
/// # Errors
/// `Invalid` where there are fewer measurements than coefficients, a direction is below the surface, a number is not
/// finite, or more than [`Lobes::MOST`] lobes are asked for.
pub fn fit(measured: &[Measurement], lobe_count: usize) -> Result<Fitted> {
    check(measured, lobe_count)?;
    let mut lobes = Lobes {
        diffuse: Rgb::ZERO,
        lobes: vec![Lobe { x: Rgb::ZERO, y: Rgb::ZERO, z: Rgb::ZERO, exponent: Rgb::ZERO }; lobe_count],
    };
    let mut error = Rgb::ZERO;
    for channel in 0..3 {
        let problem = Problem::new(measured, channel);
        let found = problem.solve(lobe_count);
        lobes.diffuse[channel] = found[0].clamp(0.0, 1.0) as f32;
        for (lobe, own) in lobes.lobes.iter_mut().zip(found.as_slice()[1..].chunks_exact(OF_A_LOBE)) {
            (lobe.x[channel], lobe.y[channel], lobe.z[channel]) = (own[0] as f32, own[0] as f32, own[1] as f32);
            lobe.exponent[channel] = own[2].exp() as f32;
        }
        error[channel] = (problem.squared_error(&found) / problem.squared_size().max(f64::MIN_POSITIVE)).sqrt() as f32;
    }
    Ok(Fitted { lobes, error })
}

fn check(measured: &[Measurement], lobe_count: usize) -> Result<()> {
    const PLACE: &str = "measured reflection";
    let needed = 1 + OF_A_LOBE * lobe_count;
    if lobe_count > Lobes::MOST {
        return Err(Error::invalid(PLACE, format!("{lobe_count} lobes are asked for; at most {} can be", Lobes::MOST)));
    }
    if measured.len() < needed {
        let message =
            format!("{} measurements can't tell {needed} coefficients; measure more directions", measured.len());
        return Err(Error::invalid(PLACE, message));
    }
    let is_sound = |m: &Measurement| {
        let is_above = |d: Vec3| d.is_finite() && d.z > 0.0 && (d.length() - 1.0).abs() < 1e-3;
        is_above(m.incoming) && is_above(m.outgoing) && m.reflectance.is_finite()
    };
    match measured.iter().position(|m| !is_sound(m)) {
        Some(k) => {
            Err(Error::invalid(PLACE, format!("measurement {k} is not finite or not above the surface; leave it out")))
        }
        None => Ok(()),
    }
}

/// One channel's measurements.
struct Problem {
    rows: Vec<Row>,
}

struct Row {
    /// o_x i_x + o_y i_y, and o_z i_z.
    along: f64,
    up: f64,
    weight: f64,
    value: f64,
}

impl Problem {
    fn new(measured: &[Measurement], channel: usize) -> Self {
        let rows = measured.iter().map(|m| {
            let (o, i) = (m.outgoing.as_dvec3(), m.incoming.as_dvec3());
            let (along, up) = (o.x * i.x + o.y * i.y, o.z * i.z);
            Row { along, up, weight: up, value: f64::from(m.reflectance[channel]) }
        });
        Self { rows: rows.collect() }
    }

    /// Adds lobes one at a time, each from the start that ends best.
    fn solve(&self, lobe_count: usize) -> DVector<f64> {
        let mean = self.rows.iter().map(|r| r.value).sum::<f64>() / self.rows.len() as f64;
        let mut best = self.descend(DVector::from_element(1, mean * std::f64::consts::PI));
        for _ in 0..lobe_count {
            let mut ends: Vec<DVector<f64>> = Vec::new();
            for [across, exponent] in STARTS {
                let mut start = best.as_slice().to_vec();
                start.extend([across * 0.9, 0.9, f64::ln(exponent)]);
                ends.push(self.descend(DVector::from_vec(start)));
            }
            ends.sort_by(|a, b| self.squared_error(a).total_cmp(&self.squared_error(b)));
            best = ends.swap_remove(0);
        }
        best
    }

    /// Goes downhill from `at` (Levenberg, Marquardt), within the coefficients' bounds.
    fn descend(&self, mut at: DVector<f64>) -> DVector<f64> {
        let mut error = self.squared_error(&at);
        let mut damping = 1e-3;
        for _ in 0..MOST_STEPS {
            let (normal, gradient) = self.normal_equations(&at);
            let mut settled = true;
            while damping < MOST_DAMPING {
                let mut damped = normal.clone();
                for k in 0..at.len() {
                    damped[(k, k)] += damping * (normal[(k, k)] + 1e-12);
                }
                let next = damped.cholesky().map(|c| bounded(&at - c.solve(&gradient)));
                let better = next.map(|next| (self.squared_error(&next), next)).filter(|(e, _)| *e < error);
                if let Some((e, next)) = better {
                    settled = error - e < SETTLED * error;
                    (at, error) = (next, e);
                    damping = (damping * 0.2).max(1e-12);
                    break;
                }
                damping *= 4.0;
            }
            if settled {
                break;
            }
        }
        at
    }

    /// The Jacobian's square, and the gradient.
    fn normal_equations(&self, at: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let n = at.len();
        let (mut normal, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut slope = vec![0.0; n];
        for row in &self.rows {
            let residual = (row.model(at, Some(&mut slope)) - row.value) * row.weight;
            for a in 0..n {
                let sa = slope[a] * row.weight;
                gradient[a] += sa * residual;
                for b in 0..n {
                    normal[(a, b)] += sa * slope[b] * row.weight;
                }
            }
        }
        (normal, gradient)
    }

    fn squared_error(&self, at: &DVector<f64>) -> f64 {
        self.rows.iter().map(|row| ((row.model(at, None) - row.value) * row.weight).powi(2)).sum()
    }

    fn squared_size(&self) -> f64 {
        self.rows.iter().map(|row| (row.value * row.weight).powi(2)).sum()
    }
}

impl Row {
    /// The model's value, and its slope by each coefficient.
    fn model(&self, at: &DVector<f64>, mut slope: Option<&mut Vec<f64>>) -> f64 {
        const INVERSE: f64 = std::f64::consts::FRAC_1_PI;
        let mut value = at[0] * INVERSE;
        if let Some(slope) = &mut slope {
            slope[0] = INVERSE;
        }
        for (k, own) in at.as_slice()[1..].chunks_exact(OF_A_LOBE).enumerate() {
            let (base, n) = ((own[0] * self.along + own[1] * self.up).max(0.0), own[2].exp());
            let lobe = base.powf(n);
            value += lobe;
            if let Some(slope) = &mut slope {
                let by_base = if base > 0.0 { n * lobe / base } else { 0.0 };
                let by_exponent = if base > 0.0 { n * lobe * base.ln() } else { 0.0 };
                let first = 1 + k * OF_A_LOBE;
                slope[first..first + OF_A_LOBE].copy_from_slice(&[
                    by_base * self.along,
                    by_base * self.up,
                    by_exponent,
                ]);
            }
        }
        value
    }
}

/// Coefficients within what [`Lobes`] allow.
fn bounded(mut at: DVector<f64>) -> DVector<f64> {
    let most = f64::from(Lobes::MOST_COEFFICIENT);
    at[0] = at[0].clamp(0.0, 1.0);
    for own in at.as_mut_slice()[1..].chunks_exact_mut(OF_A_LOBE) {
        own[0] = own[0].clamp(-most, most);
        own[1] = own[1].clamp(-most, most);
        own[2] = own[2].clamp(f64::ln(0.1), f64::ln(1e4));
    }
    at
}
