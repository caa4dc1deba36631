//! The final gather (Lischinski, Tampieri, Greenberg 1993; Christensen 1999): each texel collects the light that arrives over
//! its hemisphere, reading the solved radiosity where its rays land.
//!
//! Rays are cosine-distributed about the shown normal, from points over the footprint; two independent halves give the
//! noise. What is read at a hit is the texel's own direct light and albedo with the element's interreflected light, so
//! shadows and textures stay sharp as sources.

use crate::Result;
use crate::color::Rgb;
use crate::light::Lights;
use crate::light::direct::{Direct, DirectParams, hemisphere_weight};
use crate::patch::{Ground, NONE, Reflectance, unocclude::Exposure};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::solve::Solution;
use crate::trace::{Hit, Ray};
use crate::transport::Elements;
use rayon::prelude::*;
use std::f32::consts::PI;

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
    /// The part that the gather found [lx].
    pub indirect: Vec<Rgb>,
    /// Share of the rays that landed on something that can send light back.
    pub landed_share: Vec<f32>,
    /// Standard error of the gathered light over all patches, root mean square over mean irradiance (luminance).
    pub noise: f64,
    /// The sky's part that the gather found, as flux over all patches [lm].
    pub sky_inflow: glam::DVec3,
    pub rays: u64,
}

/// What patches send out, as hits read it [lm/m^2].
pub struct Sources<'a> {
    elements: &'a Elements,
    front: Vec<Rgb>,
    /// Empty where no surface is double-sided.
    back: Vec<Rgb>,
}

impl<'a> Sources<'a> {
    /// A patch's own direct light and albedo with its element's interreflected light; nothing where no bounce is wanted.
    pub fn new(
        reflectance: &Reflectance,
        direct: &Direct,
        elements: &'a Elements,
        solution: &Solution,
        max_bounces: Option<u32>,
    ) -> Self {
        let n = reflectance.0.len();
        if max_bounces == Some(0) {
            return Self { elements, front: vec![Rgb::ZERO; n], back: Vec::new() };
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
            front: (0..n).map(front).collect(),
            back: if has_backs { (0..n).map(back).collect() } else { Vec::new() },
        }
    }

    /// What a hit reads; `None` on black backs and buried texels.
    fn under(&self, ground: &Ground, hit: &Hit) -> Option<Rgb> {
        let patch = ground.patch_under(hit)?;
        let (of, side) =
            if hit.back { (&self.elements.back_of, &self.back) } else { (&self.elements.front_of, &self.front) };
        (of[patch] != NONE).then(|| side.get(patch).copied().unwrap_or_default())
    }
}

/// What one patch collected.
#[derive(Clone, Copy, Default)]
struct Collected {
    halves: [Rgb; 2],
    sky: Rgb,
    landed: f32,
}

/// Collects the light of all patches that are not buried.
///
/// # Errors
/// `Cancelled`.
#[allow(clippy::too_many_arguments)]
pub fn gather(
    ground: &Ground,
    exposure: &Exposure,
    lights: &Lights,
    sources: &Sources,
    direct: &Direct,
    direct_params: &DirectParams,
    params: &GatherParams,
    progress: &dyn Progress,
) -> Result<Gathered> {
    let patches = ground.patches;
    progress.begin("gather", patches.len() as u64);
    let collected: Vec<Collected> = (0..patches.len())
        .into_par_iter()
        .map(|i| {
            if i % 64 == 0 {
                progress.check()?;
                progress.advance(64.min(patches.len() - i) as u64);
            }
            if exposure.is_buried(i) {
                return Ok(Collected::default());
            }
            Ok(collect(ground, exposure, lights, direct_params, sources, params.samples, i))
        })
        .collect::<Result<_>>()?;
    let mut sky_inflow = glam::DVec3::ZERO;
    let (mut squares, mut sum) = (0.0f64, 0.0f64);
    for (i, c) in collected.iter().enumerate() {
        let area = f64::from(exposure.area[i]);
        sky_inflow += c.sky.as_dvec3() * area;
        let error = 0.5 * f64::from(crate::color::luminance(c.halves[0] - c.halves[1]));
        squares += error * error * area;
        sum += f64::from(crate::color::luminance(direct.shown[i] + c.mean())) * area;
    }
    let area: f64 = exposure.area.iter().map(|a| f64::from(*a)).sum();
    let noise = if sum > 0.0 { (squares / area).sqrt() / (sum / area) } else { 0.0 };
    Ok(Gathered {
        irradiance: collected.iter().zip(&direct.shown).map(|(c, d)| *d + c.mean()).collect(),
        indirect: collected.iter().map(Collected::mean).collect(),
        landed_share: collected.iter().map(|c| c.landed).collect(),
        noise,
        sky_inflow,
        rays: u64::from(params.samples) * (patches.len() - exposure.buried_count()) as u64,
    })
}

impl Collected {
    fn mean(&self) -> Rgb {
        0.5 * (self.halves[0] + self.halves[1])
    }
}

fn collect(
    ground: &Ground,
    exposure: &Exposure,
    lights: &Lights,
    direct_params: &DirectParams,
    sources: &Sources,
    samples: u32,
    i: usize,
) -> Collected {
    let mut footprint = ground.footprint(i);
    if footprint.is_empty() {
        return Collected::default();
    }
    footprint.restrict(exposure.cells[i]);
    let half = samples.div_ceil(2);
    let mut collected = Collected::default();
    let mut landed = 0u32;
    let mut rays = Vec::with_capacity(half as usize);
    let mut cosines = Vec::with_capacity(half as usize);
    let mut hits: Vec<Option<Hit>> = Vec::new();
    for k in 0..2 {
        let sequence = Sequence::new(direct_params.seed, Stage::Gather, 2 * i as u64 + k as u64);
        rays.clear();
        cosines.clear();
        for index in 0..half {
            let [x, y, s, t] = sequence.point(index, 0);
            let point = footprint.sample([x, y]);
            let normal = if direct_params.shading_normals { point.shading } else { point.normal };
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
        ground.tracer.closest(&rays, &mut hits);
        let (mut light, mut sky) = (Rgb::ZERO, Rgb::ZERO);
        for ((ray, hit), cos) in rays.iter().zip(&hits).zip(&cosines) {
            match hit {
                Some(hit) => {
                    if let Some(b) = sources.under(ground, hit) {
                        light += b;
                        landed += 1;
                    }
                }
                None => {
                    if let Some(s) = &lights.sky {
                        let weight = hemisphere_weight(lights, direct_params, ray.direction, *cos);
                        sky += s.radiance(ground.scene, ray.direction) * (weight * PI);
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
