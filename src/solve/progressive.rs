//! Progressive refinement (Cohen, Chen, Wallace, Greenberg 1988): the element with the most unshot power sends it to all
//! others through a column of F, until what is left can't change any surface by more than a thousandth.
//!
//! Overshooting (Feda, Purgathofer 1992) sends ahead what the shooter is about to receive, and takes it off again as it comes.

use super::SolveParams;
use super::convergence::Convergence;
use super::system::{Exchange, Step, System, Watch};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::progress::Progress;
use crate::transport::{Elements, Row, Rows};
use rayon::prelude::*;

/// Sweeps of gathering after the last shot: enough to bring a furnace within half a percent at every element.
const POLISHING_SWEEPS: u32 = 3;

/// Shots after which the work is given up, for each element: it never comes to this unless albedos reach 1.
const MOST_SHOTS: u64 = 2000;

/// Views of a watcher until every element could have shot once.
const VIEWS: u64 = 32;

/// Shoots until the change that is still to come is small enough.
///
/// # Errors
/// `Cancelled`, and those of the watcher.
pub fn solve(
    system: &System,
    rows: &mut Rows,
    params: &SolveParams,
    mut watch: Option<Watch>,
    progress: &dyn Progress,
) -> Result<Exchange> {
    let n = system.elements.len();
    let mut shooting = Shooting::new(system.elements, system.start, params);
    let mut convergence = Convergence::new(system.elements);
    let check_every = (n as u64 / 8).max(32);
    let most = params.iterations.unwrap_or(MOST_SHOTS * n as u64);
    let mut steps: Vec<Step> = Vec::new();
    let mut shots = 0;
    loop {
        progress.check()?;
        let shooter = if shots < most { shooting.brightest() } else { None };
        let is_last = shooter.is_none();
        if is_last || shots % check_every == 0 {
            let unshot = shooting.unshot_power();
            let residual = convergence.remaining(&unshot, &system.power(&system.sent(&shooting.received)));
            steps.push(Step { iteration: shots, residual, unshot: unshot.iter().sum() });
            if is_last || residual <= params.residual {
                break;
            }
        }
        let Some(i) = shooter else { break };
        shooting.shoot(i, &rows.row(i), &mut convergence);
        shots += 1;
        progress.advance(1);
        if let Some(watch) = &mut watch {
            watch.see(shots, n as u64 / VIEWS, || shooting.shown(params.ambient))?;
        }
    }
    let Step { residual, unshot, .. } = steps.last().copied().unwrap_or_default();
    // A sweep would add a bounce, or undo that the work was stopped early.
    let is_whole = params.max_bounces.is_none() && params.iterations.is_none();
    let received = if is_whole { polish(system, rows, shooting.received) } else { shooting.shown(params.ambient) };
    Ok(Exchange { received, iterations: shots, residual, unshot, links: None, steps })
}

/// Ends the work with sweeps of gathering along the rows that were computed for shooting. What an element received by columns
/// adds up to what lands but for the noise of each form factor; along its own row it does so exactly, as rows are scaled to.
fn polish(system: &System, rows: &Rows, mut received: Vec<Rgb>) -> Vec<Rgb> {
    for _ in 0..POLISHING_SWEEPS {
        let sent = system.sent(&received);
        received = received
            .into_par_iter()
            .enumerate()
            // Without a row it never had anything to send: what it receives is next to nothing, or its albedo is.
            .map(|(e, received)| rows.kept(e).map_or(received, |row| row.gather(&sent)))
            .collect();
    }
    received
}

/// The state of the shooting.
struct Shooting<'a> {
    elements: &'a Elements,
    /// Irradiance received from shots [lx].
    received: Vec<Rgb>,
    /// Radiosity not shot yet, by bounce; one level for all where bounces are not limited. Below zero where more was shot ahead
    /// than has come.
    unshot: Vec<Vec<Rgb>>,
    endless: bool,
    overshoot: bool,
    /// Mean albedo by area, and the whole area [m^2].
    mean_albedo: Rgb,
    area: f32,
}

impl<'a> Shooting<'a> {
    fn new(elements: &'a Elements, start: &[Rgb], params: &SolveParams) -> Self {
        let n = elements.len();
        let levels = params.max_bounces.map_or(1, |k| k as usize);
        let mut unshot = vec![vec![Rgb::ZERO; n]; levels];
        if let Some(first) = unshot.first_mut() {
            first.copy_from_slice(start);
        }
        let area: f64 = elements.area.iter().map(|a| f64::from(*a)).sum();
        let reflected: glam::DVec3 =
            elements.albedo.iter().zip(&elements.area).map(|(rho, a)| rho.as_dvec3() * f64::from(*a)).sum();
        Self {
            elements,
            received: vec![Rgb::ZERO; n],
            unshot,
            endless: params.max_bounces.is_none(),
            overshoot: params.overshoot,
            mean_albedo: (reflected / area.max(f64::MIN_POSITIVE)).as_vec3(),
            area: area as f32,
        }
    }

    /// Unshot power of an element [lm], the brightest channel's.
    fn power(&self, e: usize) -> f32 {
        self.unshot.iter().map(|level| level[e]).sum::<Rgb>().abs().max_element() * self.elements.area[e]
    }

    /// The element with the most unshot power; `None` when nothing is left.
    fn brightest(&self) -> Option<usize> {
        let mut best = (0.0f32, None);
        for e in 0..self.elements.len() {
            let power = self.power(e);
            if power > best.0 {
                best = (power, Some(e));
            }
        }
        best.1
    }

    /// The ambient term: irradiance by unshot light if it were spread evenly over all surfaces, and reflected on and on [lx].
    fn ambient(&self) -> Rgb {
        let of = |e: usize| self.unshot.iter().map(|level| level[e]).sum::<Rgb>() * self.elements.area[e];
        let unshot: glam::DVec3 = (0..self.elements.len()).map(|e| of(e).as_dvec3()).sum();
        (unshot / f64::from(self.area)).as_vec3() / (Rgb::ONE - self.mean_albedo)
    }

    /// What has been received, with the ambient term where it is wanted.
    fn shown(&self, ambient: bool) -> Vec<Rgb> {
        let more = if ambient { self.ambient() } else { Rgb::ZERO };
        self.received.iter().map(|e| *e + more).collect()
    }

    fn shoot(&mut self, i: usize, row: &Row, convergence: &mut Convergence) {
        let elements = self.elements;
        let ahead = if self.overshoot { elements.albedo[i] * self.ambient().max(Rgb::ZERO) } else { Rgb::ZERO };
        let mut shots: Vec<Rgb> = self.unshot.iter_mut().map(|level| std::mem::take(&mut level[i])).collect();
        if ahead != Rgb::ZERO {
            shots[0] += ahead;
            self.unshot[0][i] = -ahead;
        }
        let total: Rgb = shots.iter().sum();
        convergence.shot(i, total * elements.area[i]);
        for &(j, f) in &row.links {
            let j = j as usize;
            // F_ji = F_ij A_i / A_j.
            let share = f * row.scale * elements.area[i] / elements.area[j];
            self.received[j] += total * share;
            convergence.received(i, j, elements.albedo[j] * total * (share * elements.area[j]));
            for (level, shot) in shots.iter().enumerate() {
                let next = if self.endless { level } else { level + 1 };
                if let Some(unshot) = self.unshot.get_mut(next) {
                    unshot[j] += elements.albedo[j] * *shot * share;
                }
            }
        }
    }

    /// Unshot power by element [lm], luminance.
    fn unshot_power(&self) -> Vec<f64> {
        let of = |e: usize| self.unshot.iter().map(|level| level[e]).sum::<Rgb>();
        (0..self.elements.len()).map(|e| f64::from(luminance(of(e))) * f64::from(self.elements.area[e])).collect()
    }
}
