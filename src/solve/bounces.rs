//! Interreflected light by how often it was reflected: the terms of the Neumann series, K^2 L_e, K^3 L_e, ...

use super::{SolveParams, System};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::transport::Exchanger;

/// The power of a bounce, relative to the first, below which bounces are no longer told apart.
const LEAST_BOUNCE: f64 = 1e-3;

/// `received` by how often its light was reflected: once, twice, ..., the last with all that follow; each by a sweep of gathering.
///
/// # Errors
/// `Cancelled`.
pub fn split(
    system: &System,
    exchanger: &mut dyn Exchanger,
    received: &[Rgb],
    params: &SolveParams,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Rgb>>> {
    let most = params.max_bounces.map_or(params.bounces, |k| params.bounces.min(k as usize));
    let mut all: Vec<Vec<Rgb>> = Vec::new();
    let mut rest = received.to_vec();
    let mut sent = system.start.to_vec();
    let first: f64 = system.power(&sent).iter().sum();
    while all.len() + 1 < most && system.power(&sent).iter().sum::<f64>() > LEAST_BOUNCE * first {
        let bounce = exchanger.gather(&sent, progress)?;
        sent = bounce.iter().zip(&system.elements.albedo).map(|(e, rho)| *e * *rho).collect();
        rest.iter_mut().zip(&bounce).for_each(|(rest, e)| *rest -= *e);
        all.push(bounce);
    }
    if most > 0 {
        all.push(rest);
    }
    Ok(all)
}
