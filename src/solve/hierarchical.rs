//! Hierarchical radiosity (Hanrahan, Salzman, Aupperle 1991): sweeps over links between clusters. Links are refined for the light
//! that is expected first, and again for the light that was found.

use super::system::{Exchange, LinkReport, System, Watch};
use super::{SolveParams, sweep};
use crate::Result;
use crate::color::Rgb;
use crate::patch::Ground;
use crate::progress::Progress;
use crate::transport::tree::Tree;
use crate::transport::{Links, Probes};

/// Refinements after the first solution: the second finds next to nothing.
const REFINEMENTS: u32 = 2;

/// Builds links over `tree` and solves by them.
///
/// # Errors
/// `Cancelled`, and those of the watcher.
pub fn solve<'a>(
    system: &System<'a>,
    ground: &'a Ground<'a>,
    tree: &'a Tree,
    probes: &Probes,
    params: &SolveParams,
    mut watch: Option<Watch>,
    progress: &dyn Progress,
) -> Result<(Links<'a>, Exchange)> {
    let mut sent = expected(system);
    let bound = |sent: &[Rgb]| {
        let power = sent.iter().zip(&system.elements.area).map(|(b, a)| f64::from(b.max_element() * a));
        params.link_error * power.sum::<f64>()
    };
    let mut links = Links::new(system.elements, ground, tree, probes, &sent, bound(&sent), progress)?;
    for _ in 0..REFINEMENTS {
        let exchange = sweep::jacobi(system, &mut links, params, None, progress)?;
        sent = system.sent(&exchange.received);
        if links.refine(probes, &sent, bound(&sent), progress)? == 0 {
            break;
        }
    }
    let mut exchange = sweep::jacobi(system, &mut links, params, watch.take(), progress)?;
    let error = links.error(&system.sent(&exchange.received));
    exchange.links = Some(LinkReport { count: links.len(), error });
    Ok((links, exchange))
}

/// The light that elements are expected to send: their own first, and all the rest as if it were spread evenly.
fn expected(system: &System) -> Vec<Rgb> {
    let elements = system.elements;
    let (mut power, mut reflected, mut area) = (glam::DVec3::ZERO, glam::DVec3::ZERO, 0.0f64);
    for (e, b) in system.start.iter().enumerate() {
        let a = f64::from(elements.area[e]);
        power += b.as_dvec3() * a;
        reflected += elements.albedo[e].as_dvec3() * a;
        area += a;
    }
    let mean_albedo = reflected / area.max(f64::MIN_POSITIVE);
    let ambient = power / area.max(f64::MIN_POSITIVE) / (glam::DVec3::ONE - mean_albedo);
    system.sent(&vec![ambient.as_vec3(); system.start.len()])
}
