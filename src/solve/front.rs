//! From direct light to the light between elements: what they send first, the solver that was asked for, and its result.

use super::system::{System, Watch};
use super::{Solution, SolveParams, Solver, full_matrix, hierarchical, progressive, sweep};
use crate::Result;
use crate::color::Rgb;
use crate::light::direct::{Arriving, DirectParams, Receiver, arrive};
use crate::light::{Direct, Lit};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use crate::transport::tree::Tree;
use crate::transport::{Elements, Exchanger, Method, Probes, Rows};
use rayon::prelude::*;

/// How often the direct light of a back is estimated: as an element is larger than a texel, so often more.
const BACK_SAMPLES: usize = 8;

/// The power of a bounce, relative to the first, below which bounces are no longer told apart.
const LEAST_BOUNCE: f64 = 1e-3;

/// Pairs of points that are looked at for occluders.
const BLOCKED_SAMPLES: u32 = 1 << 14;

/// Solves for the light on `elements`.
///
/// # Errors
/// `Cancelled`, `Invalid` where the solver can't take so many elements, and those of the watcher.
pub fn solve(
    elements: &Elements,
    lit: &Lit,
    probes: &Probes,
    direct: &Direct,
    params: &SolveParams,
    watch: Option<Watch>,
    progress: &dyn Progress,
) -> Result<Solution> {
    progress.begin("solve", 0);
    let has_sky = lit.lights.sky.is_some();
    probes.shoot(|i| has_sky || elements.back[i], progress)?;
    let backs = light_on_backs(elements, lit, progress)?;
    let sky = |e: usize| if has_sky { probes.of(e).sky } else { Rgb::ZERO };
    let start = starting_radiosity(elements, lit, direct, &sky, &backs);
    let mut inflow = glam::DVec3::ZERO;
    for e in (0..elements.len()).filter(|&e| elements.back[e]) {
        inflow += (sky(e) + backs[e].other).as_dvec3() * f64::from(elements.area[e]);
    }
    let irradiance =
        |received: &[Rgb]| (0..elements.len()).map(|e| received[e] + sky(e) + backs[e].transport).collect::<Vec<Rgb>>();
    let (every, show) = watch.map(|w| (w.every, w.show)).unzip();
    let mut show = show.map(|show| |iteration: u64, received: &[Rgb]| show(iteration, &irradiance(received)));
    let watch = show.as_mut().map(|show| Watch { every: every.flatten(), show });
    let mut tree = None;
    let mut rows = Rows::new(elements, lit.ground, probes, params.transport.clone());
    let system = System { elements, start: &start };
    let solver = params.solver.choose(elements.len());
    let mut links = None;
    let exchange = match solver {
        Solver::FullMatrix => full_matrix::solve(&system, &mut rows, progress)?,
        Solver::Jacobi => sweep::jacobi(&system, &mut rows, params, watch, progress)?,
        Solver::GaussSeidel => sweep::gauss_seidel(&system, &mut rows, params, watch, progress)?,
        Solver::Auto | Solver::Progressive => progressive::solve(&system, &mut rows, params, watch, progress)?,
        Solver::Hierarchical => {
            let tree = tree.insert(Tree::new(elements));
            let (found, exchange) = hierarchical::solve(&system, lit.ground, tree, probes, params, watch, progress)?;
            links = Some(found);
            exchange
        }
    };
    let exchanger: &mut dyn Exchanger = match &mut links {
        Some(links) => links,
        None => &mut rows,
    };
    let bounces = bounces(&system, exchanger, &exchange.received, params, progress)?;
    let segments = links.as_ref().map_or(rows.segments, |links| links.segments);
    let is_blind = params.transport.method == Method::Analytic && !elements.is_empty();
    let on_back = |e: usize| if elements.back[e] { probes.of(e).landed_share } else { 0.0 };
    Ok(Solution {
        irradiance: irradiance(&exchange.received),
        bounces,
        landed_share: (0..elements.len()).map(on_back).collect(),
        solver,
        exchange,
        segments,
        blocked_share: is_blind.then(|| blocked_share(elements, lit)).unwrap_or_default(),
        inflow,
        rays: segments + probes.traced() + backs.iter().map(|b| b.rays).sum::<u64>(),
    })
}

/// `received` by how often its light was reflected: once, twice, ..., the last with all that follow; each by a sweep of gathering.
fn bounces(
    system: &System,
    exchanger: &mut dyn Exchanger,
    received: &[Rgb],
    params: &SolveParams,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Rgb>>> {
    // The gather adds the last bounce.
    let most = params.max_bounces.map_or(params.bounces, |k| params.bounces.min(k.saturating_sub(1) as usize));
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

/// The share of segments between elements that face each other that something blocks: what analytic form factors don't know.
fn blocked_share(elements: &Elements, lit: &Lit) -> f64 {
    let n = elements.len() as u32;
    let pairs = Sequence::new(elements.seed, Stage::FormFactor, u64::MAX);
    let segments: Vec<Segment> = (0..BLOCKED_SAMPLES)
        .filter_map(|k| {
            let [i, j] = [2 * k, 2 * k + 1].map(|salt| pairs.hash(salt) % n);
            let (a, b) = (elements.kept_point(i as usize, k), elements.kept_point(j as usize, k));
            let way = b.position - a.position;
            let faces = i != j && way.dot(a.normal) > 0.0 && way.dot(b.normal) < 0.0;
            faces.then_some(Segment { from: a.position, to: b.position })
        })
        .collect();
    let mut blocked = vec![false; segments.len()];
    lit.ground.tracer.occluded(&segments, &mut blocked);
    blocked.iter().filter(|b| **b).count() as f64 / segments.len().max(1) as f64
}

/// Direct light on the elements that are backs, zero on the others.
fn light_on_backs(elements: &Elements, lit: &Lit, progress: &dyn Progress) -> Result<Vec<Arriving>> {
    // No texel shows a back; about its geometric normal is all that is asked.
    let params = DirectParams { shading_normals: false, ..lit.params.clone() };
    (0..elements.len())
        .into_par_iter()
        .map(|e| {
            progress.check()?;
            if !elements.back[e] {
                return Ok(Arriving::default());
            }
            let count = elements.kept_points();
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
                let arriving = arrive(lit.ground.scene, lit.ground.tracer, lit.lights, &receiver, &params);
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
    lit: &Lit,
    direct: &Direct,
    sky: &dyn Fn(usize) -> Rgb,
    backs: &[Arriving],
) -> Vec<Rgb> {
    let of_element = |e: usize| {
        if elements.back[e] {
            return elements.albedo[e] * (sky(e) + backs[e].transport);
        }
        let mut sum = glam::DVec3::ZERO;
        for &i in elements.members(e) {
            let i = i as usize;
            let sent = lit.reflectance.0[i] * direct.transport[i];
            sum += sent.as_dvec3() * f64::from(lit.exposure.area[i]);
        }
        elements.albedo[e] * sky(e) + (sum / f64::from(elements.area[e]).max(f64::MIN_POSITIVE)).as_vec3()
    };
    (0..elements.len()).map(of_element).collect()
}
