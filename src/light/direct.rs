//! Direct light at every patch: what arrives from each light without occluders, exact or nearly so, times the share of the
//! light that is seen ([`shadow`](super::shadow)); brightness samples for what is sharp of a sky ([`sharp_sky`](super::sharp_sky)).
//!
//! A few shadow rays go from every patch to every light. Where they and those of the patches around agree, they are right,
//! and without noise. Where some see the light and some don't, a shadow's edge is near: the patch looks closely, with as
//! many rays as its share needs. What comes out of it may differ from the next patch again, so edges are followed.

use super::close::Close;
use super::emitter::{Emitter, Sight};
use super::first_look::{FirstLook, Looking, first_looks};
use super::receiver::Site;
use super::shadow::{Look, Volley, examine};
use super::sharp_sky::add_sky;
use super::skylight::{self, SkyLook};
use super::touched::Kept;
use super::{Lights, Lit};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::patch::{Footprint, NONE, Sparse};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;

pub use super::receiver::{Arriving, Receiver};

/// How much effort direct light gets.
#[derive(Clone, Debug)]
pub struct DirectParams {
    /// First shadow rays from a patch to each light, 1..=4.
    pub first_samples: u32,
    /// Standard error of the light from one emitter in a shadow, relative to all direct light around; more than 0.
    pub shadow_error: f32,
    /// Shadow samples shared among the clusters of a cut through many polygons, and of each polygon whose light varies. At least 1.
    pub cluster_samples: u32,
    /// Time that the whole bake may take [s]; none: as long as it needs. Past half of it shadows are looked at with few samples.
    pub time: Option<f64>,
    /// Whether irradiance is shown about the interpolated normal.
    pub shading_normals: bool,
    /// Whether stages find where their light comes from ([`crate::moments`]), too.
    pub moments: bool,
    pub seed: u32,
    /// Which of several units of lamps: each has shadow samples of its own, but the points are the same over which light is averaged that
    /// is known without shadows, as that of all must add up.
    pub unit: u32,
}

impl DirectParams {
    /// Samples of a close look at a light, at most.
    pub(super) fn most_samples(&self, progress: &dyn Progress) -> u32 {
        let is_late = |time: f64| progress.elapsed().as_secs_f64() > LATE * time;
        if self.time.is_some_and(is_late) { LATE_SAMPLES } else { MOST_SAMPLES }
    }
}

/// Irradiance straight from lights [lx], one a patch. Of the sky only what is sharp is in it ([`Sky::sharp`](super::Sky::sharp)).
#[derive(Clone, Debug)]
pub struct Direct {
    /// About the normal that is shown.
    pub shown: Sparse,
    /// About the geometric normal, for transport.
    pub transport: Arc<Vec<Rgb>>,
    /// The part of `transport` from lights that are no surface, as flux over all patches [lm].
    pub inflow: DVec3,
    /// Shadow rays that were traced.
    pub rays: u64,
}

impl Direct {
    /// No light on so many patches.
    pub fn dark(patches: usize) -> Self {
        let transport = Arc::new(vec![Rgb::ZERO; patches]);
        Self { shown: Sparse::same(Arc::clone(&transport)), transport, inflow: DVec3::ZERO, rays: 0 }
    }

    /// With `other` added.
    pub fn plus(self, other: &Self) -> Self {
        let sum = |a: &[Rgb], b: &dyn Fn(usize) -> Rgb| -> Vec<Rgb> { (0..a.len()).map(|i| a[i] + b(i)).collect() };
        let transport = Arc::new(sum(&self.transport, &|i| other.transport[i]));
        let shown = Sparse::new(Arc::clone(&transport), (0..transport.len()).map(|i| self.shown[i] + other.shown[i]));
        Self { shown, transport, inflow: self.inflow + other.inflow, rays: self.rays + other.rays }
    }

    /// The same with the numbers that patches have now, of which there are `patches`; those that had none are dark.
    pub(super) fn renumbered(&self, numbers: &[u32], patches: usize) -> Self {
        let (mut transport, mut shown) = (vec![Rgb::ZERO; patches], vec![Rgb::ZERO; patches]);
        for (before, &now) in numbers.iter().enumerate().filter(|(_, now)| **now != NONE) {
            (transport[now as usize], shown[now as usize]) = (self.transport[before], self.shown[before]);
        }
        let transport = Arc::new(transport);
        let shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
        Self { shown, transport, inflow: self.inflow, rays: self.rays }
    }
}

/// Blocks of 2^3 texels a side share a cut through the light tree and the rays of a glance.
pub(super) const BLOCK_LEVEL: u32 = 3;
/// Blocks that a thread takes at once, at most: those in a penumbra cost far more than others.
pub(super) const SHARE: usize = 8;
/// Shadow rays from a patch to one light, at most.
const MOST_SAMPLES: u32 = 1024;
/// The same past this share of the time that there is.
const LATE: f64 = 0.5;
const LATE_SAMPLES: u32 = 16;
/// The same from one of the several receivers of a surface that no texel shows.
pub(super) const MOST_ARRIVING: u32 = 64;
/// What neighbours take out of it, noise may be more at first.
pub(super) const GRAIN: f32 = 2.0;
/// Patches that keep more than this share of their difference to those around are looked at until they have no noise to speak of.
pub(super) const SHARP: f32 = 0.5;
/// How often shadow edges are followed to patches around; each time by one patch.
pub(super) const MOST_ROUNDS: usize = 16;

/// Direct light at every patch that is not buried.
///
/// # Errors
/// `Cancelled`.
pub fn direct(lit: &Lit, progress: &dyn Progress) -> Result<Direct> {
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    let unit = Looking { lit: *lit, kept: None, is_held: true };
    let first = first_looks(lit, &[unit], &blocks, progress)?.pop().unwrap_or_default();
    // What a sky brings is added to it where it is found.
    let around: Vec<f32> = first.means.iter().map(|[lamps, _]| luminance(*lamps)).collect();
    look_closely(lit, lit.lights, &blocks, &around, first, None, progress)
}

/// The direct light of the lamps of `lit` from a `first` look at them: shadows are looked at closely as the mean light `around` each block [lx]
/// asks for. Of what is `kept` from before a change, that alone is found anew which the change can touch. `all` are the lamps that patches
/// are cut for.
///
/// # Errors
/// `Cancelled`.
pub(super) fn look_closely(
    lit: &Lit,
    all: &Lights,
    blocks: &[Range<usize>],
    around: &[f32],
    first: FirstLook,
    kept: Option<&Kept>,
    progress: &dyn Progress,
) -> Result<Direct> {
    let (mut arriving, ballots) = first.on_patches(blocks, kept);
    let close = Close { lit, all, blocks, around, touched: kept.map(Kept::touched), progress };
    let noise = close.follow(ballots, &mut arriving)?;
    close.settle(noise, &mut arriving)?;
    if lit.lights.has_sharp_sky() {
        add_sky(lit, blocks, around, &mut arriving, progress)?;
    }
    let mut inflow = DVec3::ZERO;
    for (i, a) in arriving.iter().enumerate().filter(|(i, _)| lit.ground.casts(*i)) {
        inflow += a.other.as_dvec3() * lit.exposure.taking_area(i);
    }
    let rays = arriving.iter().map(|a| a.rays).sum();
    let transport: Arc<Vec<Rgb>> = Arc::new(arriving.iter().map(|a| a.transport).collect());
    let shown = match lit.params.shading_normals {
        true => Sparse::new(Arc::clone(&transport), arriving.iter().map(|a| a.shown)),
        false => Sparse::same(Arc::clone(&transport)),
    };
    Ok(Direct { shown, transport, inflow, rays })
}

/// Everything that arrives straight from lights at `receiver`.
pub fn arrive(scene: &Scene, tracer: &Tracer, lights: &Lights, receiver: &Receiver, params: &DirectParams) -> Arriving {
    let sight = Sight { scene, tracer, lights, params };
    look_at(&sight, receiver, u32::MAX)
}

/// What arrives at `receiver`, of which the `footprint` is known, from each of several lots of lamps, by the first shadow rays alone: noisy in
/// penumbrae, for receivers that are only seen among many others.
pub fn glimpse(
    scene: &Scene,
    tracer: &Tracer,
    lamps: &[(&Lights, &DirectParams)],
    receiver: &Receiver,
    footprint: &Footprint,
) -> Vec<Arriving> {
    let sight = |&(lights, params): &(_, _)| -> Sight { Sight { scene, tracer, lights, params } };
    let emitters = |sight: &Sight| sight.emitters(receiver.position, receiver.normal, receiver.radius);
    let all: Vec<(Sight, Vec<Emitter>)> = lamps.iter().map(sight).map(|sight| (sight, emitters(&sight))).collect();
    let nearest = all.iter().map(|(sight, emitters)| sight.nearest(emitters, receiver.position));
    let site = Site::new(receiver, nearest.fold(f32::INFINITY, f32::min), Some(footprint));
    let mut volley = Volley::default();
    all.iter().map(|(sight, emitters)| look_from(sight, emitters, &site, 0, &mut volley)).collect()
}

/// What arrives at `receiver`; the lights whose bits are set in `closely` are looked at closely.
fn look_at(sight: &Sight, receiver: &Receiver, closely: u32) -> Arriving {
    let emitters = sight.emitters(receiver.position, receiver.normal, receiver.radius);
    let site = Site::new(receiver, 0.0, None);
    look_from(sight, &emitters, &site, closely, &mut Volley::default())
}

/// The same at a `site`, from its `emitters`.
fn look_from(sight: &Sight, emitters: &[Emitter], site: &Site, closely: u32, volley: &mut Volley) -> Arriving {
    // Of the light around nothing is known.
    let error = sight.params.shadow_error;
    let look = Look { closely, around: 0.0, error, most_samples: MOST_ARRIVING, evenly: false };
    let mut sum = examine(sight, emitters, site, look, volley).arriving;
    let sky = match closely {
        0 => SkyLook::FIRST,
        _ => SkyLook { closely: true, around: luminance(sum.transport), error, most_samples: MOST_ARRIVING },
    };
    let sky = skylight::look(sight, site.receiver, sky).arriving;
    sum.transport += sky.transport;
    sum.shown += sky.shown;
    sum.other += sky.other;
    sum.rays += sky.rays;
    sum
}
