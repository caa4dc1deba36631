//! Gathering (Cohen, Greenberg 1985): sweeps over all elements, each of which collects what the others send along its row of F.
//!
//! Jacobi reads the values of the sweep before, so the k-th sweep adds the k-th bounce; Gauss-Seidel reads each value as soon
//! as it is found, which takes about half the sweeps.

use super::convergence::Groups;
use super::{Exchange, SolveParams, Step, System, Watch};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::transport::{Exchanger, Rows};

/// Sweeps after which the work is given up: it never comes to this unless albedos reach 1.
const MOST_SWEEPS: u64 = 2000;

/// Sweeps by Jacobi's order until the change that is still to come is small enough.
///
/// # Errors
/// `Cancelled`, and those of the watcher.
pub fn jacobi(
    system: &System,
    exchanger: &mut dyn Exchanger,
    params: &SolveParams,
    watch: Option<Watch>,
    progress: &dyn Progress,
) -> Result<Exchange> {
    sweeps(system, params, watch, progress, |sent, received| {
        *received = exchanger.gather(sent, progress)?;
        *sent = system.sent(received);
        Ok(())
    })
}

/// Sweeps by Gauss and Seidel's order until the change that is still to come is small enough.
///
/// # Errors
/// `Cancelled`, and those of the watcher.
pub fn gauss_seidel(
    system: &System,
    rows: &mut Rows,
    params: &SolveParams,
    watch: Option<Watch>,
    progress: &dyn Progress,
) -> Result<Exchange> {
    sweeps(system, params, watch, progress, |sent, received| {
        rows.complete(progress)?;
        for i in 0..received.len() {
            progress.check()?;
            received[i] = rows.row(i).gather(sent);
            sent[i] = system.start[i] + system.elements.albedo[i] * received[i];
        }
        Ok(())
    })
}

/// Calls `sweep(sent, received)` until it changes little.
fn sweeps(
    system: &System,
    params: &SolveParams,
    mut watch: Option<Watch>,
    progress: &dyn Progress,
    mut sweep: impl FnMut(&mut Vec<Rgb>, &mut Vec<Rgb>) -> Result<()>,
) -> Result<Exchange> {
    let groups = Groups::new(system.elements);
    let bounces = params.max_bounces.map_or(u64::MAX, u64::from);
    let most = params.iterations.unwrap_or(MOST_SWEEPS).min(bounces);
    let mut sent = system.start.to_vec();
    let mut change = system.power(&sent);
    let mut exchange = Exchange { received: vec![Rgb::ZERO; sent.len()], ..Exchange::default() };
    // Before the first sweep no more is known than that the light can grow by what albedos let through.
    exchange.residual = groups.remaining(&change, groups.mean_albedo(system.elements), &change);
    exchange.unshot = change.iter().sum();
    while exchange.iterations < most && exchange.residual > params.residual {
        progress.check()?;
        let before = sent.clone();
        sweep(&mut sent, &mut exchange.received)?;
        let difference: Vec<Rgb> = sent.iter().zip(&before).map(|(new, old)| *new - *old).collect();
        let last = std::mem::replace(&mut change, system.power(&difference));
        let total = |change: &[f64]| change.iter().map(|c| c.abs()).sum::<f64>();
        let ratio = total(&change) / total(&last).max(f64::MIN_POSITIVE);
        exchange.iterations += 1;
        exchange.residual = groups.remaining(&change, ratio, &system.power(&sent));
        exchange.unshot = change.iter().sum();
        let (iteration, residual, unshot) = (exchange.iterations, exchange.residual, exchange.unshot);
        exchange.steps.push(Step { iteration, residual, unshot });
        if let Some(watch) = &mut watch {
            watch.see(iteration, 1, || exchange.received.clone())?;
        }
    }
    Ok(exchange)
}
