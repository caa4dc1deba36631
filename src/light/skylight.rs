//! Light from the bright parts of a sky with a picture, as far as brightness samples find it.
//!
//! The rays of the final gather find the rest; the two strategies are combined by the power heuristic (Veach, Guibas 1995).

use super::Lights;
use super::direct::DirectParams;
use super::emitter::Sight;
use super::receiver::{Arriving, Receiver};
use crate::sample::warp::cosine_hemisphere_pdf;
use crate::trace::Ray;
use glam::Vec3;

/// The share of a sky's picture that brightness samples carry; the gather carries the rest ([`hemisphere_weight`]).
pub(super) fn from_sky(sight: &Sight, receiver: &Receiver, sum: &mut Arriving) {
    let Sight { scene, tracer, lights, params } = *sight;
    let Some(sky) = lights.sky.as_ref().filter(|s| s.has_picture() && params.sky_ratio > 0.0) else { return };
    let samples = ((params.gather_samples as f32 * params.sky_ratio).ceil() as u32).max(1);
    for index in 0..samples {
        let [x, y, ..] = receiver.sequence.point(index, 62);
        let Some((towards, pdf)) = sky.sample(receiver.sequence.point(index, 61)) else { continue };
        let point = (receiver.sample)([x, y]);
        let cos = point.normal.dot(towards);
        if cos <= 0.0 {
            continue;
        }
        let mut blocked = [false];
        let origin = tracer.off_surface(point.position, point.normal);
        tracer.occluded_rays(&[Ray { origin, direction: towards }], &mut blocked);
        sum.rays += 1;
        if blocked[0] {
            continue;
        }
        let radiance = sky.radiance(scene, towards);
        let arrive = |cos: f32| {
            let weight = 1.0 - hemisphere_share(params.sky_ratio * pdf, cosine_hemisphere_pdf(cos));
            radiance * (cos * weight / (pdf * samples as f32))
        };
        sum.transport += arrive(cos);
        sum.other += arrive(cos);
        let shown = if params.shading_normals { point.shading.dot(towards).max(0.0) } else { cos };
        sum.shown += arrive(shown);
    }
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
