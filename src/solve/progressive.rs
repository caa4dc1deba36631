//! Progressive refinement (Cohen, Chen, Wallace, Greenberg 1988): the element with the most unshot power sends it to all
//! others through a column of F, until what is left can't change any surface by more than a thousandth.
//!
//! Light straight from emitters is in E0 already, so what is shot first is the light it leaves behind: rho E0.

use super::convergence::Convergence;
use crate::Result;
use crate::color::Rgb;
use crate::light::direct::{Arriving, DirectParams, Receiver, arrive};
use crate::light::{Direct, Lights};
use crate::patch::{Ground, Reflectance, unocclude::Exposure};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::transport::hemisphere::{Probe, probe};
use crate::transport::{Effort, Elements, Rows};
use rayon::prelude::*;

/// How the system is solved.
#[derive(Clone, Debug)]
pub struct SolveParams {
    /// Rays that probe each element; a power of two.
    pub probe_rays: u32,
    pub effort: Effort,
    /// Interreflections in the final result: the gather adds the last of them, this stage those before. None: all.
    pub max_bounces: Option<u32>,
    /// Estimated remaining change of each surface's mean radiosity, relative to it, at which to stop.
    pub residual: f64,
}

/// The light on elements.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Irradiance that the gather reads beyond a patch's own direct light [lx]: interreflected light and the sky's; on backs
    /// direct light too.
    pub irradiance: Vec<Rgb>,
    /// Share of the light leaving each element that lands on elements; the rest escapes or falls on black backs.
    pub landed_share: Vec<f32>,
    /// Shots that were made.
    pub shots: u64,
    /// Estimated remaining change of the worst surface's mean radiosity, relative to it.
    pub residual: f64,
    /// Power that was not shot [lm], luminance.
    pub unshot: f64,
    /// Light on backs straight from the sky and from lights that are no surface, as flux [lm].
    pub inflow: glam::DVec3,
    pub rays: u64,
}

/// How often the direct light of a back is estimated: as an element is larger than a texel, so often more.
const BACK_SAMPLES: usize = 8;

/// Sweeps of gathering after the last shot: enough to bring a furnace within half a percent at every element.
const POLISHING_SWEEPS: u32 = 3;

/// Shots after which the work is given up, for each element: it never comes to this unless albedos reach 1.
const MOST_SHOTS: u64 = 2000;

/// Solves for the light on `elements`.
///
/// # Errors
/// `Cancelled`.
pub fn solve(
    elements: &Elements,
    ground: &Ground,
    exposure: &Exposure,
    lights: &Lights,
    reflectance: &Reflectance,
    direct: &Direct,
    direct_params: &DirectParams,
    params: &SolveParams,
    progress: &dyn Progress,
) -> Result<Solution> {
    progress.begin("solve", 0);
    let n = elements.len();
    let probes = probe(elements, ground, lights, direct_params, params.probe_rays, progress)?;
    let backs = light_on_backs(elements, ground, lights, direct_params, progress)?;
    let start = starting_radiosity(elements, exposure, reflectance, direct, &probes, &backs);
    let mut inflow = glam::DVec3::ZERO;
    for e in 0..n {
        if elements.back[e] {
            inflow += (probes[e].sky + backs[e].other).as_dvec3() * f64::from(elements.area[e]);
        }
    }
    let mut shooting = Shooting::new(elements, &start, params.max_bounces);
    let mut rows = Rows::new(elements, ground, &probes, params.effort);
    let mut convergence = Convergence::new(elements);
    let check_every = (n as u64 / 8).max(32);
    let mut shots = 0;
    let mut residual = f64::INFINITY;
    while let Some(i) = shooting.brightest() {
        progress.check()?;
        if shots % check_every == 0 {
            residual = convergence.remaining(&shooting.unshot_power(), &shooting.reflected_power(&start));
            if residual <= params.residual {
                break;
            }
        }
        if shots >= MOST_SHOTS * n as u64 {
            break;
        }
        shooting.shoot(i, rows.row(i), &mut convergence);
        shots += 1;
        progress.advance(1);
    }
    if residual > params.residual || shots % check_every != 0 {
        residual = convergence.remaining(&shooting.unshot_power(), &shooting.reflected_power(&start));
    }
    let received = if params.max_bounces.is_none() {
        polish(elements, &rows, &start, std::mem::take(&mut shooting.received))
    } else {
        // A sweep would add a bounce.
        std::mem::take(&mut shooting.received)
    };
    let irradiance = (0..n).map(|e| received[e] + probes[e].sky + backs[e].transport).collect();
    Ok(Solution {
        irradiance,
        landed_share: probes.iter().map(|p| p.landed_share).collect(),
        shots,
        residual,
        unshot: shooting.unshot_power().iter().sum(),
        inflow,
        rays: rows.segments + n as u64 * u64::from(params.probe_rays) + backs.iter().map(|b| b.rays).sum::<u64>(),
    })
}

/// Ends the work with sweeps of gathering along the rows that were computed for shooting. What an element received by columns
/// adds up to what lands but for the noise of each form factor; along its own row it does so exactly, as rows are scaled to.
fn polish(elements: &Elements, rows: &Rows, start: &[Rgb], mut received: Vec<Rgb>) -> Vec<Rgb> {
    for _ in 0..POLISHING_SWEEPS {
        let sent: Vec<Rgb> = (0..elements.len()).map(|e| start[e] + elements.albedo[e] * received[e]).collect();
        received = (0..elements.len())
            .into_par_iter()
            .map(|e| match rows.computed(e) {
                Some(row) => row.values.iter().zip(&sent).map(|(&f, &b)| b * f).sum::<Rgb>() * row.scale,
                // It never had anything to send: what it receives is next to nothing, or its albedo is.
                None => received[e],
            })
            .collect();
    }
    received
}

/// Direct light on the elements that are backs, zero on the others.
fn light_on_backs(
    elements: &Elements,
    ground: &Ground,
    lights: &Lights,
    params: &DirectParams,
    progress: &dyn Progress,
) -> Result<Vec<Arriving>> {
    // No texel shows a back; about its geometric normal is all that is asked.
    let params = DirectParams { shading_normals: false, ..params.clone() };
    (0..elements.len())
        .into_par_iter()
        .map(|e| {
            progress.check()?;
            if !elements.back[e] {
                return Ok(Arriving::default());
            }
            let count = crate::transport::element::POINTS;
            let mut sum = Arriving::default();
            for k in 0..BACK_SAMPLES {
                let receiver = Receiver {
                    sample: &|u| elements.kept_point(e, (u[0] * count as f32) as u32),
                    position: elements.centre[e],
                    // Its points face several ways: no light may be left out for lying behind one of them.
                    normal: glam::Vec3::ZERO,
                    radius: elements.radius[e],
                    sequence: Sequence::new(params.seed, Stage::Direct, (1 << 40) + (e * BACK_SAMPLES + k) as u64),
                };
                let arriving = arrive(ground.scene, ground.tracer, lights, &receiver, &params);
                sum.transport += arriving.transport / BACK_SAMPLES as f32;
                sum.other += arriving.other / BACK_SAMPLES as f32;
                sum.rays += arriving.rays;
            }
            Ok(sum)
        })
        .collect()
}

/// The first light that each element sends on, rho E0 [lm/m^2]: the mean over its patches of albedo times direct light, and the
/// sky's.
fn starting_radiosity(
    elements: &Elements,
    exposure: &Exposure,
    reflectance: &Reflectance,
    direct: &Direct,
    probes: &[Probe],
    backs: &[Arriving],
) -> Vec<Rgb> {
    (0..elements.len())
        .map(|e| {
            if elements.back[e] {
                return elements.albedo[e] * (probes[e].sky + backs[e].transport);
            }
            let mut sum = glam::DVec3::ZERO;
            for &i in elements.members(e) {
                let i = i as usize;
                let sent = reflectance.0[i] * direct.transport[i];
                sum += sent.as_dvec3() * f64::from(exposure.area[i]);
            }
            elements.albedo[e] * probes[e].sky + (sum / f64::from(elements.area[e]).max(f64::MIN_POSITIVE)).as_vec3()
        })
        .collect()
}

/// The state of the shooting.
struct Shooting<'a> {
    elements: &'a Elements,
    /// Irradiance received from shots [lx].
    received: Vec<Rgb>,
    /// Radiosity not shot yet, by bounce; one level for all where bounces are not limited.
    unshot: Vec<Vec<Rgb>>,
    endless: bool,
}

impl<'a> Shooting<'a> {
    fn new(elements: &'a Elements, start: &[Rgb], max_bounces: Option<u32>) -> Self {
        let n = elements.len();
        // The gather is the last bounce, and reads rho E0 by itself: of k bounces k - 1 are shot.
        let levels = max_bounces.map_or(1, |k| k.saturating_sub(1) as usize);
        let mut unshot = vec![vec![Rgb::ZERO; n]; levels];
        if let Some(first) = unshot.first_mut() {
            for (e, value) in first.iter_mut().enumerate() {
                *value = start[e];
            }
        }
        Self { elements, received: vec![Rgb::ZERO; n], unshot, endless: max_bounces.is_none() }
    }

    /// Unshot power of an element [lm], the brightest channel's.
    fn power(&self, e: usize) -> f32 {
        self.unshot.iter().map(|level| level[e]).sum::<Rgb>().max_element() * self.elements.area[e]
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

    fn shoot(&mut self, i: usize, row: &crate::transport::row::Row, convergence: &mut Convergence) {
        let elements = self.elements;
        let shots: Vec<Rgb> = self.unshot.iter_mut().map(|level| std::mem::take(&mut level[i])).collect();
        let total: Rgb = shots.iter().sum();
        convergence.shot(i, total * elements.area[i]);
        for (j, &f) in row.values.iter().enumerate() {
            if f == 0.0 {
                continue;
            }
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
        (0..self.elements.len())
            .map(|e| {
                let all: Rgb = self.unshot.iter().map(|level| level[e]).sum();
                f64::from(crate::color::luminance(all)) * f64::from(self.elements.area[e])
            })
            .collect()
    }

    /// Power that each element sends out so far [lm], luminance: (rho E0 + rho received) A.
    fn reflected_power(&self, start: &[Rgb]) -> Vec<f64> {
        (0..self.elements.len())
            .map(|e| {
                let b = start[e] + self.elements.albedo[e] * self.received[e];
                f64::from(crate::color::luminance(b)) * f64::from(self.elements.area[e])
            })
            .collect()
    }
}
