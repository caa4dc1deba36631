//! Brightness samples of one receiver: of what is sharp of a sky with a picture ([`Sky::sharp`]), and of skies through portals, which
//! are sampled over the portal as well; both strategies are combined by the power heuristic (Veach, Guibas 1995).
//!
//! What arrives of the sky with nothing in its way is known ([`Sky::sharp_irradiance`]): samples tell the share of it that is seen, a ratio
//! of two sums over them (Cochran 1977, "Sampling Techniques", chapter 6), and there is no noise without a shadow.

use super::emitter::Sight;
use super::portal::Portal;
use super::receiver::{Arriving, Receiver};
use super::shadow::Ballot;
use super::sky::Sky;
use crate::color::{Rgb, luminance};
use crate::patch::SurfacePoint;
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::scene::material::mean_share;
use crate::trace::Ray;
use glam::Vec3;
use std::f32::consts::PI;

/// Samples of a glance at each sky, and of a close look at first.
const FIRST_SAMPLES: u32 = 8;

/// Points whose normals stand for those of a curved receiver.
const CURVED: u32 = 16;

/// Errors are relative to this share of all that would arrive unoccluded where that is more than what does arrive.
const IN_THE_DARK: f32 = 0.25;

/// How closely skies are looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct SkyLook {
    /// True where shadows are near: that a few samples agree means little then.
    pub closely: bool,
    /// Mean luminance of the light around [lx], which errors are relative to.
    pub around: f32,
    /// Standard error of the light from each sky, relative to the light around.
    pub error: f32,
    /// Samples of each, at most.
    pub most_samples: u32,
}

impl SkyLook {
    /// The first samples alone.
    pub const FIRST: Self = Self { closely: false, around: 0.0, error: f32::INFINITY, most_samples: FIRST_SAMPLES };
}

/// What brightness samples found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SkyFound {
    pub arriving: Arriving,
    /// A bit for each sky; the last is shared by what is beyond.
    pub ballot: Ballot,
    /// Of what arrives [lx^2] (luminance).
    pub variance: f32,
}

/// A sky that is found by brightness samples.
enum Source<'a> {
    Sharp(&'a Sky),
    Portal(usize, &'a Portal),
}

/// Sums over brightness samples.
#[derive(Clone, Copy, Default)]
struct Tally {
    arriving: Arriving,
    /// What would arrive unoccluded about both normals.
    unoccluded: [Rgb; 2],
    /// Its luminance, and that of what arrives; squares of both, and their product.
    whole: f64,
    seen: f64,
    squares: f64,
    seen_squares: f64,
    products: f64,
    count: u32,
    /// Samples before the horizon, and the shares of the sky that get through to them, added up.
    facing: u32,
    visible: f64,
    /// Whether some got through, and whether some were blocked.
    passed: bool,
    blocked: bool,
}

impl Tally {
    /// Standard deviation of a sample [lx], of the share that is seen alone where the whole `is_known`. Directions and places
    /// together have too many dimensions for stratification to help.
    fn deviation(&self, closely: bool, is_known: bool) -> f64 {
        let n = f64::from(self.count.max(1));
        let whole = self.whole / n;
        // Near shadows as if one more had seen it and one more had not: a share of the first samples is never sure.
        let unsure = if closely { 1.0 } else { 0.0 };
        if is_known {
            let each = self.whole / f64::from(self.facing.max(1)) * unsure;
            let (whole, seen) = (self.whole + 2.0 * each, self.seen + each);
            let share = if whole > 0.0 { seen / whole } else { 0.0 };
            let (square, product) = (each * each, self.products + each * each);
            let squares =
                self.seen_squares + square - 2.0 * share * product + share * share * (self.squares + 2.0 * square);
            return (squares.max(0.0) / n).sqrt();
        }
        let p = (self.visible + unsure) / (f64::from(self.facing) + 2.0 * unsure).max(1.0);
        let uneven = (self.squares / n - whole * whole).max(0.0).sqrt();
        ((p * (1.0 - p)).max(0.0).sqrt() * whole).hypot(p * uneven)
    }

    /// Samples that bring the standard error down to what `look` asks for.
    fn wanted(&self, look: SkyLook, is_known: bool) -> f32 {
        let n = f64::from(self.count.max(1));
        let around = (f64::from(look.around) + self.seen / n).max(f64::from(IN_THE_DARK) * self.whole / n);
        if around <= 0.0 {
            return 0.0;
        }
        ((self.deviation(look.closely, is_known) / (around * f64::from(look.error))) as f32).powi(2)
    }

    /// A sample that would bring `light` about the geometric and the shading normal from the direction `towards` unoccluded.
    fn add(&mut self, sight: &Sight, point: &SurfacePoint, towards: Vec3, light: [Rgb; 2], shade: Option<u16>) {
        let level = f64::from(luminance(light[0]));
        self.facing += 1;
        self.unoccluded[0] += light[0];
        self.unoccluded[1] += light[1];
        self.whole += level;
        self.squares += level * level;
        let mut passing = [Rgb::ONE];
        if let Some(tracer) = sight.lights.tracer(sight.tracer, shade) {
            let origin = sight.tracer.off_surface(point.position, point.normal);
            tracer.transmittance_of_rays(&[Ray { origin, direction: towards }], &mut passing);
        }
        self.arriving.rays += 1;
        let share = f64::from(mean_share(passing[0]));
        self.passed |= share > 0.0;
        self.blocked |= share < 1.0;
        self.visible += share;
        self.seen += level * share;
        self.seen_squares += (level * share).powi(2);
        self.products += level * level * share;
        self.arriving.transport += light[0] * passing[0];
        self.arriving.shown += light[1] * passing[0];
    }

    /// Adds the mean of the samples to `found`, as what sky number `number` brings; the seen share of the `whole`, where that is known.
    fn arrive(&self, number: usize, closely: bool, whole: Option<[Rgb; 2]>, found: &mut SkyFound) {
        let mean = 1.0 / self.count.max(1) as f32;
        let of = |k: usize, seen: Rgb| match whole {
            Some(whole) => {
                let is_known = self.unoccluded[k].cmpgt(Rgb::ZERO);
                Rgb::select(is_known, whole[k] * seen / self.unoccluded[k], Rgb::ZERO)
            }
            None => seen * mean,
        };
        let transport = of(0, self.arriving.transport);
        let sum = &mut found.arriving;
        sum.transport += transport;
        sum.other += transport;
        sum.shown += of(1, self.arriving.shown);
        sum.rays += self.arriving.rays;
        let bit = 1 << number.min(31);
        let bit_if = |is_so: bool| if is_so { bit } else { 0 };
        found.ballot = found.ballot.or(Ballot { seen: bit_if(self.passed), blocked: bit_if(self.blocked) });
        found.variance += (self.deviation(closely, whole.is_some()).powi(2) / f64::from(self.count.max(1))) as f32;
    }
}

/// What arrives at `receiver` of skies that are found by brightness samples.
pub(super) fn look(sight: &Sight, receiver: &Receiver, look: SkyLook) -> SkyFound {
    let mut found = SkyFound::default();
    let sharp = sight.lights.sky.iter().filter(|sky| sky.is_sharp()).map(Source::Sharp);
    let portals = sight.lights.portals.iter().enumerate().map(|(k, portal)| Source::Portal(k, portal));
    for (number, source) in sharp.chain(portals).enumerate() {
        let whole = source.unoccluded(sight, receiver);
        if whole == Some([Rgb::ZERO; 2]) {
            continue;
        }
        let mut tally = Tally::default();
        let mut count = FIRST_SAMPLES.min(look.most_samples);
        while count > tally.count {
            for index in tally.count..count {
                source.sample(sight, receiver, index, &mut tally);
            }
            tally.count = count;
            // The points of a whole power of two are spread most evenly.
            let wanted = tally.wanted(look, whole.is_some()).min(look.most_samples as f32) as u32;
            count = if wanted > count { wanted.next_power_of_two().min(look.most_samples) } else { count };
        }
        tally.arrive(number, look.closely, whole, &mut found);
    }
    found
}

/// About what comes from the smooth part of the sky along ray number `index` of `receiver` [lx] (luminance): its mean is the
/// irradiance.
pub(super) fn smooth_glimpse(sight: &Sight, receiver: &Receiver, index: u32) -> f32 {
    let Some(sky) = &sight.lights.sky else { return 0.0 };
    let [x, y, u, v] = receiver.sequence.point(index, 60);
    let point = (receiver.sample)([x, y]);
    let direction = frame(point.normal) * cosine_hemisphere([u, v]);
    let light = PI * luminance(sky.smooth(sight.scene, direction));
    if light <= 0.0 {
        return 0.0;
    }
    let mut passing = [Rgb::ONE];
    let origin = sight.tracer.off_surface(point.position, point.normal);
    sight.tracer.transmittance_of_rays(&[Ray { origin, direction }], &mut passing);
    light * mean_share(passing[0])
}

impl Source<'_> {
    /// What would arrive with nothing in its way [lx], about the geometric and the shading normal, where it is known.
    fn unoccluded(&self, sight: &Sight, receiver: &Receiver) -> Option<[Rgb; 2]> {
        let Self::Sharp(sky) = self else { return None };
        let point = |index: u32| {
            let [x, y, ..] = receiver.sequence.point(index, 60);
            let point = (receiver.sample)([x, y]);
            (point.normal, if sight.params.shading_normals { point.shading } else { point.normal })
        };
        let first = point(0);
        // What is flat has one normal, and what is curved many.
        let count = if (1..4).all(|index| point(index) == first) { 1 } else { CURVED };
        let mut mean = [Rgb::ZERO; 2];
        for index in 0..count {
            let (normal, shading) = point(index);
            let whole = sky.sharp_irradiance(normal, shading);
            mean = [mean[0] + whole[0] / count as f32, mean[1] + whole[1] / count as f32];
        }
        Some(mean)
    }

    /// Adds sample number `index` to `tally`.
    fn sample(&self, sight: &Sight, receiver: &Receiver, index: u32, tally: &mut Tally) {
        match self {
            Self::Sharp(sky) => from_direction(sight, sky, receiver, index, tally),
            Self::Portal(k, portal) => through_portal(sight, *k, portal, receiver, index, tally),
        }
    }
}

fn from_direction(sight: &Sight, sky: &Sky, receiver: &Receiver, index: u32, tally: &mut Tally) {
    let [u, v, x, y] = receiver.sequence.point(index, 61);
    let [choice, ..] = receiver.sequence.point(index, 62);
    let Some((towards, pdf)) = sky.sample_sharp([u, v, choice]) else { return };
    let point = (receiver.sample)([x, y]);
    let radiance = sky.sharp(sight.scene, towards) / pdf;
    receive(sight, &point, towards, radiance, None, tally);
}

fn through_portal(sight: &Sight, number: usize, portal: &Portal, receiver: &Receiver, index: u32, tally: &mut Tally) {
    // Brightness and place in turn; each stands for half of the samples.
    let [u, v, x, y] = receiver.sequence.point(index / 2, 63 - number as u32 % 2);
    let point = (receiver.sample)([x, y]);
    let by_place = index % 2 == 1;
    let Some(drawn) = portal.sample(&point, [u, v], by_place) else { return };
    // Half of the samples: twice the light of each.
    let radiance = drawn.sky.radiance(sight.scene, drawn.towards) * (2.0 * drawn.weight);
    receive(sight, &point, drawn.towards, radiance, portal.shade(), tally);
}

/// Adds what arrives of `radiance` over its density [nit sr] to `tally`.
fn receive(sight: &Sight, at: &SurfacePoint, towards: Vec3, radiance: Rgb, shade: Option<u16>, tally: &mut Tally) {
    let cos = at.normal.dot(towards);
    if cos > 0.0 {
        let shown = if sight.params.shading_normals { at.shading.dot(towards).max(0.0) } else { cos };
        tally.add(sight, at, towards, [radiance * cos, radiance * shown], shade);
    }
}
