//! Light from the bright parts of a sky with a picture, as far as brightness samples find it.
//!
//! Samples are taken until their error is as small as that of shadows has to be: where the sun of a picture is half hidden, more
//! than in the open. The rays of the final gather find the rest; the two strategies are combined by the power heuristic (Veach, Guibas 1995).

use super::Lights;
use super::direct::DirectParams;
use super::emitter::Sight;
use super::portal::Drawn;
use super::receiver::{Arriving, Receiver};
use super::sky::Sky;
use crate::color::{Rgb, luminance};
use crate::patch::SurfacePoint;
use crate::sample::warp::cosine_hemisphere_pdf;
use crate::scene::material::mean_share;
use crate::trace::Ray;
use glam::Vec3;

/// Brightness samples at first, of which the deviation is told.
const FIRST_SAMPLES: u32 = 16;

/// The same, at most.
const MOST_SAMPLES: u32 = 1024;

/// Errors are relative to this share of all that would arrive unoccluded where that is more than what does arrive.
const IN_THE_DARK: f32 = 0.25;

/// Sums over brightness samples.
#[derive(Clone, Copy, Default)]
struct Tally {
    arriving: Arriving,
    /// Luminance that would arrive unoccluded, its square, and the part that arrives.
    whole: f64,
    squares: f64,
    seen: f64,
    count: u32,
    /// Samples before the horizon, and the shares of the sky that get through to them, added up.
    facing: u32,
    visible: f64,
}

impl Tally {
    /// Samples that bring the standard error down to the share `error` of what arrives: of the visible share, and of what
    /// arrives unoccluded. Directions and places together have too many dimensions for stratification to help.
    fn wanted(&self, error: f32) -> f32 {
        let n = f64::from(self.count);
        let whole = self.whole / n;
        if whole <= 0.0 {
            return 0.0;
        }
        // As if one more had seen it and one more had not: a share of the first samples is never sure.
        let p = (self.visible + 1.0) / f64::from(self.facing + 2);
        let uneven = (self.squares / n - whole * whole).max(0.0).sqrt();
        let deviation = ((p * (1.0 - p)).sqrt() * whole).hypot(p * uneven);
        let around = (self.seen / n).max(f64::from(IN_THE_DARK) * whole);
        ((deviation / (around * f64::from(error))) as f32).powi(2)
    }
}

impl Tally {
    /// A sample that would bring `light` about the geometric and the shading normal from the direction `towards` unoccluded.
    fn add(&mut self, sight: &Sight, point: &SurfacePoint, towards: Vec3, light: [Rgb; 2], shade: Option<u16>) {
        let level = f64::from(luminance(light[0]));
        self.facing += 1;
        self.whole += level;
        self.squares += level * level;
        let mut passing = [Rgb::ONE];
        if let Some(tracer) = sight.lights.tracer(sight.tracer, shade) {
            let origin = sight.tracer.off_surface(point.position, point.normal);
            tracer.transmittance_of_rays(&[Ray { origin, direction: towards }], &mut passing);
        }
        self.arriving.rays += 1;
        let share = f64::from(mean_share(passing[0]));
        self.visible += share;
        self.seen += level * share;
        self.arriving.transport += light[0] * passing[0];
        self.arriving.other += light[0] * passing[0];
        self.arriving.shown += light[1] * passing[0];
    }

    /// A sample of a portal, which stands for `factor` of them.
    fn shoot(&mut self, sight: &Sight, point: &SurfacePoint, drawn: &Drawn, factor: f32, shade: Option<u16>) {
        let cos = point.normal.dot(drawn.towards);
        if cos <= 0.0 {
            return;
        }
        let shown = if sight.params.shading_normals { point.shading.dot(drawn.towards).max(0.0) } else { cos };
        let radiance = drawn.sky.radiance(sight.scene, drawn.towards) * (factor * drawn.weight);
        self.add(sight, point, drawn.towards, [radiance * cos, radiance * shown], shade);
    }

    /// Adds the mean of the samples to `sum`.
    fn arrive(&self, sum: &mut Arriving) {
        let share = 1.0 / self.count.max(1) as f32;
        sum.transport += self.arriving.transport * share;
        sum.other += self.arriving.other * share;
        sum.shown += self.arriving.shown * share;
        sum.rays += self.arriving.rays;
    }
}

/// The share of a sky's picture that brightness samples carry, as exactly as shadows are asked for; the gather carries the rest
/// ([`hemisphere_weight`]).
pub(super) fn from_sky(sight: &Sight, receiver: &Receiver, is_close: bool, sum: &mut Arriving) {
    let Sight { lights, params, .. } = *sight;
    let Some(sky) = lights.sky.as_ref().filter(|s| s.has_picture() && params.sky_ratio > 0.0) else { return };
    let least = ((params.gather_samples as f32 * params.sky_ratio).ceil() as u32).max(1);
    let mut tally = Tally::default();
    let mut count = if is_close { FIRST_SAMPLES.max(least.min(MOST_SAMPLES)) } else { least };
    while count > tally.count {
        for index in tally.count..count {
            from_direction(sight, sky, receiver, index, &mut tally);
        }
        tally.count = count;
        if is_close {
            // The points of a whole power of two are spread most evenly.
            let wanted = tally.wanted(params.shadow_error).min(MOST_SAMPLES as f32) as u32;
            count = if wanted > count { wanted.next_power_of_two().min(MOST_SAMPLES) } else { count };
        }
    }
    tally.arrive(sum);
}

/// Light of skies with pictures through portals: brightness samples, and as many over the portal, by the power heuristic.
pub(super) fn through_portals(sight: &Sight, receiver: &Receiver, is_close: bool, sum: &mut Arriving) {
    for (k, portal) in sight.lights.portals.iter().enumerate() {
        let mut tally = Tally::default();
        let mut count = FIRST_SAMPLES;
        while count > tally.count {
            for index in tally.count..count {
                // Brightness and place in turn; each stands for half of the samples.
                let [u, v, x, y] = receiver.sequence.point(index / 2, 63 - k as u32 % 2);
                let point = (receiver.sample)([x, y]);
                let by_place = index % 2 == 1;
                let Some(drawn) = portal.sample(&point, [u, v], by_place) else { continue };
                // Half of the samples: twice the light of each.
                tally.shoot(sight, &point, &drawn, 2.0, portal.shade());
            }
            tally.count = count;
            if is_close {
                let wanted = tally.wanted(sight.params.shadow_error).min(MOST_SAMPLES as f32) as u32;
                count = if wanted > count { wanted.next_power_of_two().min(MOST_SAMPLES) } else { count };
            }
        }
        tally.arrive(sum);
    }
}

/// Brightness sample number `index`.
fn from_direction(sight: &Sight, sky: &Sky, receiver: &Receiver, index: u32, tally: &mut Tally) {
    let Sight { scene, params, .. } = *sight;
    let [u, v, x, y] = receiver.sequence.point(index, 61);
    let [choice, ..] = receiver.sequence.point(index, 62);
    let Some((towards, pdf)) = sky.sample([u, v, choice]) else { return };
    let point = (receiver.sample)([x, y]);
    let cos = point.normal.dot(towards);
    if cos <= 0.0 {
        return;
    }
    let weigh = |cos: f32| (1.0 - hemisphere_share(params.sky_ratio * pdf, cosine_hemisphere_pdf(cos))) / pdf;
    let radiance = sky.radiance(scene, towards);
    let shown = if params.shading_normals { point.shading.dot(towards).max(0.0) } else { cos };
    tally.add(sight, &point, towards, [radiance * (cos * weigh(cos)), radiance * (shown * weigh(shown))], None);
}

/// The power heuristic (Veach, Guibas 1995): it leaves a small sun to the brightness samples nearly alone.
fn hemisphere_share(brightness: f32, hemisphere: f32) -> f32 {
    let (b, h) = (brightness * brightness, hemisphere * hemisphere);
    h / (b + h).max(f32::MIN_POSITIVE)
}

/// The weight of the sky's radiance on a ray of the gather (cosine-distributed about a normal at `cos`) that escapes
/// along `direction`: the other half of what brightness samples weigh.
pub fn hemisphere_weight(lights: &Lights, params: &DirectParams, direction: Vec3, cos: f32) -> f32 {
    match &lights.sky {
        Some(sky) if sky.has_picture() && params.sky_ratio > 0.0 => {
            hemisphere_share(params.sky_ratio * sky.pdf(direction), cosine_hemisphere_pdf(cos))
        }
        _ => 1.0,
    }
}
