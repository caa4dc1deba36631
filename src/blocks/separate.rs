//! Parts of the light between surfaces on their own: that of light groups, and that of each bounce.
//!
//! Links hold no light, and light adds up: each part is solved by sweeps over the links of the whole, so that nothing is traced again
//! but for the direct light on backs. Every part is smoothed by its own noise, as it is to be shown alone. Smoothing is not linear, so
//! the parts of a texel, channel by channel, are scaled in the end to add up to its whole: the same few percent for all of them.

use super::field::{Alone, Field};
use super::respond::{self, Response};
use super::show::show;
use super::smooth::smooth;
use super::sweep::{Radiosity, System};
use super::{SHARE, kept_means};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::gather::Gathered;
use crate::light::{Direct, Lights, Lit};
use crate::progress::Progress;
use glam::Vec3;
use rayon::prelude::*;

/// Lights whose interreflected light is wanted on its own, and what comes straight from them.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    pub lights: &'a Lights,
    pub direct: &'a Direct,
    /// Whether what comes straight from its sky is shown.
    pub shows_sky: bool,
}

/// What is wanted on its own.
#[derive(Clone, Copy, Default)]
pub struct Wanted<'a> {
    /// All sources of the bake, or none.
    pub sources: &'a [Source<'a>],
    /// Bounces that are told apart, at most; the last one holds the rest. 0: none are.
    pub bounces: usize,
}

/// Parts of the light, by patch [lx].
pub struct Separate {
    /// One a source.
    groups: Vec<Vec<Rgb>>,
    /// What was reflected once, twice, ..., and the rest.
    bounces: Vec<Vec<Rgb>>,
    /// Whether each patch's sky is in the groups.
    shows_sky: bool,
}

impl Separate {
    /// Finds what is `wanted` of the light of `field`, which is at rest; `normal` is the one that a patch shows.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn find(
        field: &Field,
        wanted: Wanted,
        normal: &(dyn Fn(usize) -> Vec3 + Sync),
        progress: &dyn Progress,
    ) -> Result<Self> {
        let of_source = |source: &Source| {
            let lit = Lit { lights: source.lights, ..*field.lit };
            let alone = Alone::new(field, &lit, source.direct, progress)?;
            let system = alone.system(field, &lit);
            let irradiance = alone.solve(field, &system, progress)?;
            Ok(show_alone(field, &system, &system.radiosity(&irradiance), source.shows_sky, normal))
        };
        let groups = wanted.sources.iter().map(of_source).collect::<Result<_>>()?;
        let bounces = if wanted.bounces > 0 { bounces(field, wanted.bounces, normal, progress)? } else { Vec::new() };
        Ok(Self { groups, bounces, shows_sky: wanted.sources.iter().all(|source| source.shows_sky) })
    }

    /// Scales the parts so that they add up to the whole, and puts them there.
    pub fn put(mut self, gathered: &mut Gathered) {
        if !self.groups.is_empty() {
            let sky = |i: usize| if self.shows_sky { Rgb::ZERO } else { gathered.sky[i] };
            scale(&mut self.groups, |i| gathered.indirect[i] - sky(i));
            gathered.groups = self.groups;
        }
        if !self.bounces.is_empty() {
            scale(&mut self.bounces, |i| gathered.indirect[i] - gathered.sky[i]);
            // What was reflected once is what the others leave of the whole.
            gathered.parts = self.bounces.split_off(1);
        }
    }
}

/// Scales `parts` by patch and channel so that they add up to `whole`; where all are black, they share it alike.
fn scale(parts: &mut [Vec<Rgb>], whole: impl Fn(usize) -> Rgb) {
    let count = parts.len() as f32;
    for i in 0..parts.first().map_or(0, Vec::len) {
        let (sum, whole) = (parts.iter().map(|part| part[i]).sum::<Rgb>(), whole(i).max(Rgb::ZERO));
        for k in 0..3 {
            for part in parts.iter_mut() {
                part[i][k] = if sum[k] > 0.0 { part[i][k] / sum[k] * whole[k] } else { whole[k] / count };
            }
        }
    }
}

/// What patches receive by links while others send `radiosity`, and straight from the sky of `system` where `shows_sky` [lx].
fn show_alone(
    field: &Field,
    system: &System,
    radiosity: &Radiosity,
    shows_sky: bool,
    normal: &(dyn Fn(usize) -> Vec3 + Sync),
) -> Vec<Rgb> {
    let respond = |b: usize| Response::new(system, radiosity, &normal, b).0;
    let responses = (0..field.blocks.fronts()).into_par_iter().with_max_len(SHARE).map(respond).collect();
    let smoothed = smooth(&field.blocks, &field.around, responses);
    let responses = kept_means(field, smoothed.responses, normal);
    let mut shown = vec![Rgb::ZERO; field.lit.ground.patches.len()];
    show(field.lit, &field.blocks, &field.around, &responses, normal, |i, values| {
        let sky = if shows_sky { Rgb::ZERO } else { respond::sky(values) };
        shown[i] = (respond::irradiance(values) - sky).max(Rgb::ZERO);
    });
    shown
}

/// Light by the number of its reflections: once, twice, ..., and all that follow; up to `most` and the rest.
fn bounces(
    field: &Field,
    most: usize,
    normal: &(dyn Fn(usize) -> Vec3 + Sync),
    progress: &dyn Progress,
) -> Result<Vec<Vec<Rgb>>> {
    let limit = field.params.max_bounces.map_or(usize::MAX, |bounces| bounces as usize);
    if limit == 0 {
        return Ok(Vec::new());
    }
    let lights = Lights::of(field.lit.ground.scene, |_| false);
    let lit = Lit { lights: &lights, ..*field.lit };
    let dark = Alone::dark(field);
    let system = dark.system(field, &lit);
    let light = |irradiance: &[Rgb]| -> f64 {
        let blocks = field.blocks.list.iter().zip(irradiance);
        blocks.map(|(block, e)| f64::from(luminance(*e)) * f64::from(block.area)).sum()
    };
    let all = light(&field.irradiance);
    // What blocks hold of the light that is still to be shown after one more reflection.
    let mut rest: Vec<Rgb> = field.irradiance.iter().zip(field.sky_irradiance()).map(|(e, sky)| *e - *sky).collect();
    let mut radiosity = field.system().radiosity(field.sky_irradiance());
    let mut shown = vec![show_alone(field, &system, &radiosity, false, normal)];
    while shown.len() < most.min(limit) {
        progress.check()?;
        let next = system.sweep(&radiosity);
        if light(&next) <= field.params.residual * all {
            break;
        }
        rest.iter_mut().zip(&next).for_each(|(rest, next)| *rest = (*rest - *next).max(Rgb::ZERO));
        radiosity = system.radiosity(&next);
        shown.push(show_alone(field, &system, &radiosity, false, normal));
    }
    if shown.len() < limit {
        shown.push(show_alone(field, &system, &system.radiosity(&rest), false, normal));
    }
    Ok(shown)
}
