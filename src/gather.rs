//! The final gather (Lischinski, Tampieri, Greenberg 1993; Christensen 1999): each texel collects the light that arrives over
//! its hemisphere, reading the solved radiosity where its rays land.
//!
//! Rays are cosine-distributed about the shown normal, from points over the footprint; two independent halves give the
//! noise. What is read at a hit is the texel's own direct light and albedo with the element's interreflected light, so
//! shadows and textures stay sharp as sources.

use crate::Result;
use crate::color::Rgb;
use crate::light::Lit;
use crate::light::direct::Direct;
use crate::moments::Moments;
use crate::patch::{Ground, NONE, Reflectance};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::solve::Solution;
use crate::trace::{Hit, Ray};
use crate::transport::{Elements, Probes};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Rays for the shares of elements' light that land, where no gather finds them.
const MOST_PROBE_RAYS: u64 = 1 << 23;

/// How much the gather does.
#[derive(Clone, Debug)]
pub struct GatherParams {
    /// Rays a texel, 2..=65536.
    pub samples: u32,
}

/// Irradiance of every patch.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// All of it, direct light included, about the shown normal [lx].
    pub irradiance: Vec<Rgb>,
    /// Standard error of `irradiance`, estimated from two halves of the rays; zero without a gather [lx].
    pub standard_error: Vec<Rgb>,
    /// Half the difference between the means of two independent halves of the samples, of `indirect` [lx]; empty where there
    /// are none, or nothing needs it.
    pub difference: Vec<Rgb>,
    /// The part that the gather found [lx]. This and `sky` and `standard_error` may be left empty where no layer needs them.
    pub indirect: Vec<Rgb>,
    /// The part of that which comes straight from the sky [lx].
    pub sky: Vec<Rgb>,
    /// The parts of it that were reflected once more than [`Solution::bounces`] [lx].
    pub parts: Vec<Vec<Rgb>>,
    /// What of `indirect` each source caused that was asked for on its own [lx]: by `blocks/separate` alone.
    pub groups: Vec<Vec<Rgb>>,
    /// Where the part that the gather found comes from, by patch; empty where it isn't asked for
    /// ([`DirectParams::moments`](crate::light::direct::DirectParams::moments)).
    pub moments: Vec<Moments>,
    /// Share of the rays that landed on something that can send light back.
    pub landed_share: Vec<f32>,
    /// Standard error of the gathered light over all patches, root mean square over mean irradiance (luminance).
    pub noise: f64,
    /// The sky's part that the gather found, as flux over all patches [lm].
    pub sky_inflow: glam::DVec3,
    pub rays: u64,
}

/// Light on the backs of double-sided surfaces, which no texel shows, by group of patches: for the energy balance.
#[derive(Clone, Debug, Default)]
pub struct Backs {
    /// The group of each patch's back, [`NONE`] where it has none or nothing sees it.
    pub of_patch: Vec<u32>,
    /// Area [m^2], mean albedo and irradiance [lx] of each group.
    pub area: Vec<f32>,
    pub albedo: Vec<Rgb>,
    /// What each stops of each channel of the light on it, over the mean.
    pub taking: Vec<Rgb>,
    pub irradiance: Vec<Rgb>,
    /// The share of the light leaving each that lands on something that can send light back.
    pub landed_share: Vec<f32>,
    /// Light straight from the sky and from lights that are no surface, as flux over all [lm].
    pub inflow: glam::DVec3,
}

impl Backs {
    /// Those among `elements`.
    pub fn of_elements(elements: &Elements, solution: &Solution) -> Self {
        let area = |e: usize| if elements.back[e] { elements.area[e] } else { 0.0 };
        Self {
            of_patch: elements.back_of.clone(),
            area: (0..elements.len()).map(area).collect(),
            albedo: elements.albedo.clone(),
            taking: elements.taking.clone(),
            irradiance: solution.irradiance.clone(),
            landed_share: solution.landed_share.clone(),
            inflow: solution.inflow,
        }
    }
}

/// What patches send out, as hits read it [lm/m^2].
pub struct Sources<'a> {
    elements: &'a Elements,
    reflectance: &'a Reflectance,
    front: Vec<Rgb>,
    /// Empty where no surface is double-sided.
    back: Vec<Rgb>,
    /// The parts of it whose light is wanted on its own, as irradiance by element [lx].
    parts: &'a [Vec<Rgb>],
}

/// What lies under a hit.
struct Under {
    patch: usize,
    element: usize,
    /// [lm/m^2].
    radiosity: Rgb,
}

impl<'a> Sources<'a> {
    /// A patch's own direct light and albedo with its element's interreflected light; nothing where no bounce is wanted.
    pub fn new(
        lit: &Lit<'a>,
        direct: &Direct,
        elements: &'a Elements,
        solution: &'a Solution,
        max_bounces: Option<u32>,
    ) -> Self {
        let reflectance = lit.reflectance;
        let n = reflectance.0.len();
        if max_bounces == Some(0) {
            return Self { elements, reflectance, front: vec![Rgb::ZERO; n], back: Vec::new(), parts: &[] };
        }
        let of = |e: u32| if e == NONE { Rgb::ZERO } else { solution.irradiance[e as usize] };
        let front = |i: usize| match elements.front_of[i] {
            NONE => Rgb::ZERO,
            e => reflectance.0[i] * (direct.transport[i] + of(e)),
        };
        let back = |i: usize| reflectance.0[i] * of(elements.back_of[i]);
        let has_backs = elements.back.iter().any(|b| *b);
        Self {
            elements,
            reflectance,
            front: (0..n).map(front).collect(),
            back: if has_backs { (0..n).map(back).collect() } else { Vec::new() },
            parts: &solution.bounces,
        }
    }

    /// What a hit reads; `None` on black backs and buried texels.
    fn under(&self, ground: &Ground, hit: &Hit) -> Option<Under> {
        let patch = ground.patch_under(hit)?;
        let (of, side) =
            if hit.back { (&self.elements.back_of, &self.back) } else { (&self.elements.front_of, &self.front) };
        let radiosity = side.get(patch).copied().unwrap_or_default();
        (of[patch] != NONE).then(|| Under { patch, element: of[patch] as usize, radiosity })
    }
}

/// What one patch collected.
#[derive(Clone, Default)]
struct Collected {
    halves: [Rgb; 2],
    sky: Rgb,
    landed: f32,
    /// By part of the sources.
    parts: Vec<Rgb>,
    /// Where it comes from, if asked for.
    moments: Option<Box<Moments>>,
}

/// Collects the light of all patches that are not buried.
///
/// # Errors
/// `Cancelled`.
pub fn gather(
    lit: &Lit,
    sources: &Sources,
    direct: &Direct,
    params: &GatherParams,
    progress: &dyn Progress,
) -> Result<Gathered> {
    let patches = lit.ground.patches;
    progress.begin("gather", patches.len() as u64);
    let collected: Vec<Collected> = (0..patches.len())
        .into_par_iter()
        .map(|i| {
            if i % 64 == 0 {
                progress.check()?;
                progress.advance(64.min(patches.len() - i) as u64);
            }
            if lit.exposure.is_buried(i) {
                return Ok(Collected::nothing(sources, lit.params.moments));
            }
            Ok(collect(lit, sources, params.samples, i))
        })
        .collect::<Result<_>>()?;
    let mut sky_inflow = glam::DVec3::ZERO;
    let (mut squares, mut sum) = (0.0f64, 0.0f64);
    for (i, c) in collected.iter().enumerate() {
        let area = f64::from(lit.exposure.area[i]);
        if lit.ground.casts(i) {
            sky_inflow += c.sky.as_dvec3() * area;
        }
        let error = 0.5 * f64::from(crate::color::luminance(c.halves[0] - c.halves[1]));
        squares += error * error * area;
        sum += f64::from(crate::color::luminance(direct.shown[i] + c.mean())) * area;
    }
    let area: f64 = lit.exposure.area.iter().map(|a| f64::from(*a)).sum();
    let noise = if sum > 0.0 { (squares / area).sqrt() / (sum / area) } else { 0.0 };
    Ok(Gathered {
        irradiance: collected.iter().zip(direct.shown.iter()).map(|(c, d)| *d + c.mean()).collect(),
        standard_error: collected.iter().map(|c| 0.5 * (c.halves[0] - c.halves[1]).abs()).collect(),
        difference: collected.iter().map(|c| 0.5 * (c.halves[0] - c.halves[1])).collect(),
        indirect: collected.iter().map(Collected::mean).collect(),
        sky: collected.iter().map(|c| c.sky).collect(),
        parts: (0..sources.parts.len()).map(|k| collected.iter().map(|c| c.parts[k]).collect()).collect(),
        groups: Vec::new(),
        moments: collected.iter().filter_map(|c| c.moments.as_deref().copied()).collect(),
        landed_share: collected.iter().map(|c| c.landed).collect(),
        noise,
        sky_inflow,
        rays: u64::from(params.samples) * (patches.len() - lit.exposure.buried_count()) as u64,
    })
}

/// The light of all patches as their elements have it, without a final gather: what the solver itself found.
///
/// # Errors
/// `Cancelled`.
pub fn read_elements(
    lit: &Lit,
    elements: &Elements,
    probes: &Probes,
    direct: &Direct,
    solution: &Solution,
    progress: &dyn Progress,
) -> Result<Gathered> {
    progress.begin("gather", 0);
    // Neighbours share a probe where there are more elements than rays to spare: it serves the energy balance alone.
    let step = (elements.len() as u64 * u64::from(probes.rays())).div_ceil(MOST_PROBE_RAYS).max(1) as usize;
    let has_sky = lit.lights.sky.is_some();
    probes.shoot(|e| has_sky || e % step == 0, progress)?;
    let n = lit.ground.patches.len();
    let element = |i: usize| (elements.front_of[i] != NONE).then_some(elements.front_of[i] as usize);
    let read = |values: &[Rgb]| (0..n).map(|i| element(i).map_or(Rgb::ZERO, |e| values[e])).collect::<Vec<Rgb>>();
    let indirect = read(&solution.irradiance);
    let of_sky = |e: usize| if has_sky { probes.of(e).sky } else { Rgb::ZERO };
    let sky: Vec<Rgb> = (0..n).map(|i| element(i).map_or(Rgb::ZERO, of_sky)).collect();
    let share = |i: usize| if lit.ground.casts(i) { lit.exposure.taking_area(i) } else { glam::DVec3::ZERO };
    let flux = |i: usize| sky[i].as_dvec3() * share(i);
    Ok(Gathered {
        irradiance: indirect.iter().zip(direct.shown.iter()).map(|(i, d)| *i + *d).collect(),
        standard_error: vec![Rgb::ZERO; n],
        difference: Vec::new(),
        parts: solution.bounces.iter().skip(1).map(|bounce| read(bounce)).collect(),
        groups: Vec::new(),
        moments: Vec::new(),
        landed_share: (0..n).map(|i| element(i).map_or(0.0, |e| probes.of(e - e % step).landed_share)).collect(),
        noise: 0.0,
        sky_inflow: (0..n).map(flux).sum(),
        rays: 0,
        indirect,
        sky,
    })
}

impl Collected {
    fn nothing(sources: &Sources, moments: bool) -> Self {
        let moments = moments.then(Box::default);
        Self { parts: vec![Rgb::ZERO; sources.parts.len()], moments, ..Self::default() }
    }

    /// Adds what came along a ray, which stands for so much irradiance [lx], at `cos` to the normal.
    fn add_direction(&mut self, irradiance: Rgb, direction: Vec3, cos: f32) {
        if let Some(moments) = &mut self.moments {
            moments.receive(irradiance / cos.max(Moments::LEAST_COS), direction);
        }
    }

    fn mean(&self) -> Rgb {
        0.5 * (self.halves[0] + self.halves[1])
    }
}

fn collect(lit: &Lit, sources: &Sources, samples: u32, i: usize) -> Collected {
    let Lit { ground, lights, params, .. } = *lit;
    let mut collected = Collected::nothing(sources, params.moments);
    let mut footprint = ground.footprint(i);
    if footprint.is_empty() {
        return collected;
    }
    footprint.restrict(lit.exposure.cells[i]);
    let half = samples.div_ceil(2);
    let mut landed = 0u32;
    let mut rays = Vec::with_capacity(half as usize);
    let mut cosines = Vec::with_capacity(half as usize);
    let mut hits: Vec<Option<Hit>> = Vec::new();
    let mut tints = Vec::new();
    for k in 0..2 {
        let sequence = Sequence::new(params.seed, Stage::Gather, 2 * i as u64 + k as u64);
        rays.clear();
        cosines.clear();
        for index in 0..half {
            let [x, y, s, t] = sequence.point(index, 0);
            let point = footprint.sample([x, y]);
            let normal = if params.shading_normals { point.shading } else { point.normal };
            let local = cosine_hemisphere([s, t]);
            let direction = frame(normal) * local;
            // Below the triangle's own horizon there is nothing to see.
            if direction.dot(point.normal) > 0.0 {
                rays.push(Ray { origin: ground.tracer.off_surface(point.position, point.normal), direction });
                cosines.push(local.z);
            }
        }
        hits.clear();
        hits.resize(rays.len(), None);
        ground.tracer.closest_tinted(&rays, &mut hits, &mut tints);
        let (mut light, mut sky) = (Rgb::ZERO, Rgb::ZERO);
        for (n, ((ray, hit), cos)) in rays.iter().zip(&hits).zip(&cosines).enumerate() {
            let tint = tints.get(n).copied().unwrap_or(Rgb::ONE);
            match hit {
                Some(hit) => {
                    if let Some(under) = sources.under(ground, hit) {
                        light += under.radiosity * tint;
                        landed += 1;
                        collected.add_direction(under.radiosity * tint / (2 * half) as f32, ray.direction, *cos);
                        let albedo = sources.reflectance.0[under.patch];
                        for (sum, part) in collected.parts.iter_mut().zip(sources.parts) {
                            *sum += albedo * tint * part[under.element] / (2 * half) as f32;
                        }
                    }
                }
                None => {
                    if let Some(s) = &lights.sky {
                        let arriving = s.smooth(ground.scene, ray.direction) * tint * PI;
                        sky += arriving;
                        collected.add_direction(arriving / (2 * half) as f32, ray.direction, *cos);
                    }
                }
            }
        }
        // With cosine-distributed rays E = mean of B at hits, and pi times the mean of L where they escape.
        collected.halves[k] = (light + sky) / half as f32;
        collected.sky += sky / (2 * half) as f32;
    }
    collected.landed = landed as f32 / (2 * half) as f32;
    collected
}
