//! From direct light to the light between elements: what they send first, the solver that was asked for, and its result.

use super::system::{System, Watch};
use super::{Solution, SolveParams, Solver, bounces, full_matrix, hierarchical, progressive, sweep};
use crate::Result;
use crate::color::Rgb;
use crate::light::direct::{Arriving, DirectParams, Receiver, arrive};
use crate::light::{Direct, Lit};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::transport::analytic;
use crate::transport::tree::Tree;
use crate::transport::{Elements, Exchanger, Method, Probes, Rows};
use rayon::prelude::*;

/// How often the direct light of a back is estimated: as an element is larger than a texel, so often more.
const BACK_SAMPLES: usize = 8;

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
    // Links borrow the tree; both live until the bounces are told apart.
    let mut tree = None;
    let mut rows = Rows::new(elements, lit.ground, probes, params.transport.clone());
    let system = System { elements, start: &start };
    let solver = params.solver.choose(elements.len(), params.needs_rows());
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
    let bounces = bounces::split(&system, exchanger, &exchange.received, params, progress)?;
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
        blocked_share: if is_blind { analytic::blocked_share(elements, lit.ground) } else { 0.0 },
        inflow,
        rays: segments + probes.traced() + backs.iter().map(|b| b.rays).sum::<u64>(),
    })
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
