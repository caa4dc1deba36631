//! The light of every texel by path tracing: the same scene and the same assumptions as the radiosity bake, without its
//! elements, so its error is noise alone, which it states. The truth for scenes too large for a full matrix of form factors.
//!
//! Kajiya 1986, "The Rendering Equation"; Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation", chapters 9
//! and 10. A texel's paths are parted into [`BATCHES`] that are scrambled on their own: their means are independent, and tell
//! the standard error (Owen 1997) though the points of one batch are not.
//!
//! Diffuse surfaces as elsewhere: albedo by texel, backs of single-sided surfaces and buried texels black, transport about the
//! triangles' normals. Cost: samples x about 2 / (1 - albedo) rays a texel. Noise is largest where much light comes over small
//! bright places that nothing but rays find, such as a sunlit patch of floor, and close to area lights that are no surface,
//! which rays can't hit.

pub mod light;
pub mod path;

use crate::Result;
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::moments::Moments;
use crate::patch::{Ground, SurfacePoint, unocclude::Exposure};
use crate::progress::Progress;
use crate::sample::sequence::Stage;
use crate::transport::Elements;
use glam::DVec3;
use path::{Found, Key, PathTracer};
use rayon::prelude::*;

/// Independent batches that the paths of a texel are parted into. A mean over so few has a t-distribution of seven degrees of
/// freedom: of (mean - truth) / standard error the root mean square is 1.18, not 1.
pub const BATCHES: u32 = 8;

/// How paths are traced.
#[derive(Clone, Debug)]
pub struct PathParams {
    /// Paths a texel, [`BATCHES`]..=65536; rounded up to whole batches. Powers of two are the most even.
    pub samples: u32,
    /// Reflections counted, 0: direct light only. None: all, paths being ended by Russian roulette.
    pub max_bounces: Option<u32>,
    /// Whether irradiance is shown about the interpolated normal.
    pub shading_normals: bool,
    pub strategy: Strategy,
    pub seed: u32,
}

/// How light that both light sampling and a path's own rays can find is shared between them. The mean is the same for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strategy {
    /// By the power heuristic (Veach 1997, section 9.2.3).
    #[default]
    Combined,
    /// All by light sampling: noisy near large lights.
    Lights,
    /// All by the rays: noisy for small lights.
    Hemisphere,
}

impl Strategy {
    /// The weight of a direction that light sampling drew with density `light` > 0, and the rays would have with `hemisphere`.
    pub fn light_weight(self, light: f32, hemisphere: f32) -> f32 {
        match self {
            Self::Combined => 1.0 / (1.0 + (hemisphere / light).powi(2)),
            Self::Lights => 1.0,
            Self::Hemisphere => 0.0,
        }
    }

    /// The weight of a direction that a ray took with density `hemisphere` > 0, and light sampling would have with `light`.
    pub fn hemisphere_weight(self, light: f32, hemisphere: f32) -> f32 {
        match self {
            // What light sampling never draws is left to the rays, whatever the strategy.
            _ if light <= 0.0 => 1.0,
            Self::Combined => 1.0 / (1.0 + (light / hemisphere).powi(2)),
            Self::Lights => 0.0,
            Self::Hemisphere => 1.0,
        }
    }
}

/// The light of all patches, zero on buried ones.
#[derive(Clone, Debug)]
pub struct Traced {
    /// Irradiance about the shown normal [lx].
    pub irradiance: Vec<Rgb>,
    /// Standard error of `irradiance`, estimated from [`BATCHES`] means [lx].
    pub standard_error: Vec<Rgb>,
    /// Half the difference between the means of two independent halves of the paths, of what was reflected and of what comes
    /// straight from lights and the sky [lx].
    pub difference: [Vec<Rgb>; 2],
    /// The part of `irradiance` that comes straight from lights and the sky [lx].
    pub direct: Vec<Rgb>,
    /// Where `irradiance` comes from; empty where it isn't asked for
    /// ([`DirectParams::moments`](crate::light::direct::DirectParams::moments)).
    pub moments: Vec<Moments>,
    /// Share of the first rays that landed on something that can send light back.
    pub landed_share: Vec<f32>,
    /// Flux straight from the sky and from lights that are no surface, over all patches [lm].
    pub inflow: DVec3,
    /// Rays and shadow rays that were traced.
    pub rays: u64,
}

/// The light on the elements that are backs, zero on the others.
#[derive(Clone, Debug)]
pub struct TracedBacks {
    /// Irradiance [lx].
    pub irradiance: Vec<Rgb>,
    /// As in [`Traced`], but by element.
    pub landed_share: Vec<f32>,
    /// Flux straight from the sky and from lights that are no surface [lm].
    pub inflow: DVec3,
    pub rays: u64,
}

/// What one texel received.
#[derive(Clone, Default)]
struct Texel {
    moments: Option<Box<Moments>>,
    irradiance: DVec3,
    standard_error: DVec3,
    difference: [DVec3; 2],
    direct: DVec3,
    inflow: DVec3,
    landed_share: f32,
    rays: u64,
}

/// Traces the paths of all patches that are not buried.
///
/// # Errors
/// `Cancelled`.
pub fn trace(lit: &Lit, params: &PathParams, progress: &dyn Progress) -> Result<Traced> {
    let Lit { ground, exposure, .. } = *lit;
    const AT_ONCE: usize = 16;
    let n = ground.patches.len();
    progress.begin("path", n as u64);
    let tracer = PathTracer::new(*lit, params);
    let texels: Vec<Texel> = (0..n)
        .into_par_iter()
        .map(|i| {
            if i % AT_ONCE == 0 {
                progress.advance(AT_ONCE.min(n - i) as u64);
            }
            if exposure.is_buried(i) {
                return Ok(Texel::default());
            }
            at_patch(ground, exposure, &tracer, params, i, progress)
        })
        .collect::<Result<_>>()?;
    let rgb = |of: fn(&Texel) -> DVec3| texels.iter().map(|t| of(t).as_vec3()).collect();
    let moments = |t: &Texel| t.moments.as_deref().copied().unwrap_or_default();
    Ok(Traced {
        moments: if lit.params.moments { texels.iter().map(moments).collect() } else { Vec::new() },
        irradiance: rgb(|t| t.irradiance),
        standard_error: rgb(|t| t.standard_error),
        difference: [rgb(|t| t.difference[0]), rgb(|t| t.difference[1])],
        direct: rgb(|t| t.direct),
        landed_share: texels.iter().map(|t| t.landed_share).collect(),
        inflow: (texels.iter().enumerate())
            .filter(|(i, _)| lit.ground.casts(*i))
            .map(|(i, t)| t.inflow * exposure.taking_area(i))
            .sum(),
        rays: texels.iter().map(|t| t.rays).sum(),
    })
}

fn at_patch(
    ground: &Ground,
    exposure: &Exposure,
    tracer: &PathTracer,
    params: &PathParams,
    i: usize,
    progress: &dyn Progress,
) -> Result<Texel> {
    let mut footprint = ground.footprint(i);
    if footprint.is_empty() {
        return Ok(Texel::default());
    }
    footprint.restrict(exposure.cells[i]);
    let start = |_, u| {
        let point = footprint.sample(u);
        if params.shading_normals { point } else { point.flat() }
    };
    let batches = in_batches(tracer, Stage::Path, i, params.samples, start, progress)?;
    let b = batches.len() as f64;
    let mean = |of: fn(&Found) -> DVec3| batches.iter().map(of).sum::<DVec3>() / b;
    let irradiance = mean(|f| f.irradiance);
    let squares: DVec3 = batches.iter().map(|f| (f.irradiance - irradiance).map(|d| d * d)).sum();
    let (first, second) = batches.split_at(batches.len() / 2);
    let sum = |half: &[Found], of: fn(&Found) -> DVec3| half.iter().map(of).sum::<DVec3>();
    let half_difference = |of: fn(&Found) -> DVec3| (sum(first, of) - sum(second, of)) / b;
    let moments = batches.iter().map(|f| f.moments).reduce(|a, b| Some(a? + b?)).flatten();
    Ok(Texel {
        difference: [half_difference(|f| f.irradiance - f.direct), half_difference(|f| f.direct)],
        moments: moments.map(|m| Box::new(m * b.recip() as f32)),
        irradiance,
        standard_error: (squares / (b * (b - 1.0))).map(f64::sqrt),
        direct: mean(|f| f.direct),
        inflow: mean(|f| f.inflow),
        landed_share: (batches.iter().map(|f| f.landed_share).sum::<f64>() / b) as f32,
        rays: batches.iter().map(|f| f.rays).sum(),
    })
}

/// At least `samples` paths of a receiver, in [`BATCHES`] that know nothing of each other.
fn in_batches(
    tracer: &PathTracer,
    stage: Stage,
    receiver: usize,
    samples: u32,
    start: impl Fn(u32, [f32; 2]) -> SurfacePoint,
    progress: &dyn Progress,
) -> Result<Vec<Found>> {
    let count = samples.div_ceil(BATCHES);
    (0..BATCHES)
        .map(|batch| {
            progress.check()?;
            let key = Key { stage, receiver: u64::from(BATCHES) * receiver as u64 + u64::from(batch) };
            Ok(tracer.trace(key, count, |index, u| start(batch * count + index, u)))
        })
        .collect()
}

/// Traces the paths of the elements on backs of double-sided surfaces: no texel shows them, but they take part in the balance of
/// energy.
///
/// # Errors
/// `Cancelled`.
pub fn trace_backs(
    lit: &Lit,
    elements: &Elements,
    params: &PathParams,
    progress: &dyn Progress,
) -> Result<TracedBacks> {
    let tracer = PathTracer::new(*lit, params);
    let backs: Vec<Vec<Found>> = (0..elements.len())
        .into_par_iter()
        .map(|e| {
            if !elements.back[e] {
                return Ok(Vec::new());
            }
            let start = |index, _| {
                let point = elements.point(lit.ground, e, index);
                point.flat()
            };
            in_batches(&tracer, Stage::BackPath, e, params.samples, start, progress)
        })
        .collect::<Result<_>>()?;
    let mean = |of: fn(&Found) -> DVec3| -> Vec<DVec3> {
        backs.iter().map(|b| b.iter().map(of).sum::<DVec3>() / b.len().max(1) as f64).collect()
    };
    Ok(TracedBacks {
        irradiance: mean(|f| f.irradiance).into_iter().map(|e| e.as_vec3()).collect(),
        landed_share: mean(|f| DVec3::splat(f.landed_share)).into_iter().map(|share| share.x as f32).collect(),
        inflow: mean(|f| f.inflow).iter().zip(&elements.area).map(|(e, area)| *e * f64::from(*area)).sum(),
        rays: backs.iter().flatten().map(|f| f.rays).sum(),
    })
}

impl Traced {
    /// Standard error over all patches, root mean square over mean irradiance (luminance). At most that: the channels' errors
    /// are taken to agree.
    pub fn noise(&self, exposure: &Exposure) -> f64 {
        let (mut squares, mut sum, mut whole) = (0.0, 0.0, 0.0);
        for ((e, error), area) in self.irradiance.iter().zip(&self.standard_error).zip(&exposure.area) {
            let area = f64::from(*area);
            squares += f64::from(luminance(*error)).powi(2) * area;
            sum += f64::from(luminance(*e)) * area;
            whole += area;
        }
        if sum > 0.0 { (squares / whole).sqrt() / (sum / whole) } else { 0.0 }
    }
}
