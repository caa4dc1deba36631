//! Where direct light comes from: its moments over directions at every patch.
//!
//! How much arrives is known by now ([`direct`](super::direct)). What is left is its distribution over directions: the light vector and
//! solid angle of a polygon in closed form (Lambert 1760), delta lights as they are, a sky's picture and clusters of many polygons by
//! samples. Where one light alone can reach a patch that is all; where there are several, shadow rays tell the part of each. The whole
//! is scaled to what arrives, so that penumbrae are as smooth as they are on the page. Of a light that is partly hidden, what is seen is
//! taken to come from where all of it does.
//!
//! Cost: about that of direct light without its close looks; none where it isn't asked for.

use super::Lit;
use super::at_block::at_block;
use super::direct::{BLOCK_LEVEL, Direct, GRAIN, MOST_ARRIVING, SHARE};
use super::emitter::{Emitter, Shot, Sight, Way};
use super::receiver::{Evenness, Receiver, Site};
use super::shadow::{Look, Volley, examine};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::contour::light_vector;
use crate::moments::Moments;
use crate::patch::SurfacePoint;
use crate::progress::Progress;
use crate::trace::Ray;
use glam::Vec3;
use rayon::prelude::*;

/// Directions towards a sky's picture, and through each portal, that a patch looks along.
const SKY_SAMPLES: u32 = 64;

/// Moments of a white light of some strength about a receiver, and its irradiance of the same strength.
#[derive(Clone, Copy, Debug, Default)]
struct Beam {
    vector: Vec3,
    scalar: f32,
    irradiance: f32,
}

/// Moments of the light straight from lights at every patch [lx]: their vector along the patch's normal is `direct.transport`. Zero
/// on buried patches.
///
/// # Errors
/// `Cancelled`.
pub fn incident(lit: &Lit, direct: &Direct, progress: &dyn Progress) -> Result<Vec<Moments>> {
    let patches = lit.ground.patches;
    progress.begin("directions", patches.len() as u64);
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    let has_sky = lit.lights.has_sharp_sky();
    let of_block = |block: &std::ops::Range<usize>| {
        progress.check()?;
        progress.advance(block.len() as u64);
        let all: Vec<usize> = block.clone().collect();
        let arriving = &direct.transport[block.clone()];
        let around = arriving.iter().map(|e| luminance(*e)).sum::<f32>() / arriving.len() as f32;
        let mut found = at_block(lit, lit.lights, block, &all, |sight, emitters, sites| {
            let mut volley = Volley::default();
            sites.iter().map(|site| at_site(sight, emitters, site, around, has_sky, &mut volley)).collect()
        });
        for (moments, &i) in found.iter_mut().zip(&all) {
            *moments = scaled_to(moments, direct.transport[i], patches.normal[i]);
        }
        Ok(found)
    };
    let found: Vec<Vec<Moments>> = blocks.par_iter().with_max_len(SHARE).map(of_block).collect::<Result<_>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// `moments` so that the vector along `normal` is `irradiance`; uniform over the hemisphere where they say nothing of a channel.
fn scaled_to(moments: &Moments, irradiance: Rgb, normal: Vec3) -> Moments {
    let found = moments.along(normal);
    let known = found.cmpgt(Rgb::ZERO) & irradiance.cmpgt(Rgb::ZERO);
    let factor = Rgb::select(known, irradiance / found, Rgb::ZERO);
    moments.times(factor) + Moments::uniform(Rgb::select(known, Rgb::ZERO, irradiance), normal)
}

/// What arrives at one site, to scale where more than one light does.
fn at_site(
    sight: &Sight,
    emitters: &[Emitter],
    site: &Site,
    around: f32,
    has_sky: bool,
    volley: &mut Volley,
) -> Moments {
    let beams = emitters.iter().map(|e| (*e, beam(sight, *e, site))).filter(|(_, beam)| beam.irradiance > 0.0);
    let beams: Vec<(Emitter, Beam)> = beams.collect();
    let mut sum = Moments::default();
    if let ([(_, beam)], false) = (&beams[..], has_sky) {
        sum.add_beam(beam, Rgb::ONE);
        return sum;
    }
    let error = GRAIN * sight.params.shadow_error;
    let look = Look { closely: u32::MAX, around, error, most_samples: MOST_ARRIVING, evenly: false };
    for (emitter, beam) in &beams {
        let arriving = examine(sight, &[*emitter], site, look, volley).arriving.transport;
        sum.add_beam(beam, arriving);
    }
    if has_sky {
        from_sky(sight, site.receiver, &mut sum);
        through_portals(sight, site.receiver, &mut sum);
    }
    sum
}

impl Moments {
    /// Adds the `irradiance` [lx] that comes along `beam`.
    fn add_beam(&mut self, beam: &Beam, irradiance: Rgb) {
        let unit = irradiance / beam.irradiance;
        self.scalar += unit * beam.scalar;
        self.vector.iter_mut().zip(beam.vector.to_array()).for_each(|(sum, along)| *sum += unit * along);
    }
}

/// The mean over `site` of an emitter's moments without occluders; zero where nothing can arrive.
fn beam(sight: &Sight, emitter: Emitter, site: &Site) -> Beam {
    let at_point = |point: &SurfacePoint, towards: Vec3, light: f32| {
        let v = towards * light;
        [v.x, v.y, v.z, light, v.dot(point.normal)]
    };
    let [x, y, z, scalar, irradiance] = match emitter {
        Emitter::Polygon(p) => {
            let polygon = &sight.lights.polygons.polygons[p];
            site.mean(Evenness::From(site.nearest), |point, _| {
                if !polygon.lit.holds(point.surface) || !polygon.faces(point.position, sight.tracer.offset()) {
                    return [0.0; 5];
                }
                let (v, angle) = light_vector(point.position, point.normal, &polygon.corners);
                [v.x, v.y, v.z, angle, v.dot(point.normal)]
            })
        }
        Emitter::Delta(k) => {
            let light = &sight.lights.delta[k];
            let evenness = light.evenness(site.receiver.position, site.receiver.radius);
            site.mean(evenness, |point, u| {
                super::delta::unshadowed(sight.scene, light, point, u)
                    .map_or([0.0; 5], |(_, arrival)| at_point(point, arrival.towards, luminance(arrival.illuminance)))
            })
        }
        Emitter::Cluster(_, samples) => {
            let mut sum = [0.0; 5];
            for index in 0..samples {
                let (point, u) = site.draw(index, emitter.set(), sight.params.unit);
                let Some(shot) = emitter.shot(sight, &point, u) else { continue };
                let towards = direction(&shot);
                let light = luminance(shot.light[0]) / towards.dot(point.normal).max(f32::EPSILON);
                let one = at_point(&point, towards, light);
                sum = std::array::from_fn(|k| sum[k] + one[k] / samples as f32);
            }
            sum
        }
    };
    Beam { vector: Vec3::new(x, y, z), scalar, irradiance }
}

/// Where a shot goes, unit.
fn direction(shot: &Shot) -> Vec3 {
    match shot.way {
        Way::To(segment) => (segment.to - segment.from).normalize_or_zero(),
        Way::Along(ray) => ray.direction,
    }
}

/// What is sharp of a sky's picture.
fn from_sky(sight: &Sight, receiver: &Receiver, sum: &mut Moments) {
    let Sight { lights, scene, .. } = *sight;
    let Some(sky) = lights.sky.as_ref().filter(|sky| sky.is_sharp()) else { return };
    for index in 0..SKY_SAMPLES {
        let [u, v, x, y] = receiver.sequence.point(index, 61);
        let [choice, ..] = receiver.sequence.point(index, 62);
        let Some((towards, pdf)) = sky.sample_sharp([u, v, choice]) else { continue };
        let point = (receiver.sample)([x, y]);
        if point.normal.dot(towards) > 0.0 {
            let light = sky.sharp(scene, towards) / (pdf * SKY_SAMPLES as f32);
            sum.receive(light * passing(sight, &point, towards, None), towards);
        }
    }
}

/// Light of skies with pictures through portals.
fn through_portals(sight: &Sight, receiver: &Receiver, sum: &mut Moments) {
    for (k, portal) in sight.lights.portals.iter().enumerate() {
        for index in 0..SKY_SAMPLES {
            let [u, v, x, y] = receiver.sequence.point(index / 2, 63 - k as u32 % 2);
            let point = (receiver.sample)([x, y]);
            let Some(drawn) = portal.sample(&point, [u, v], index % 2 == 1) else { continue };
            if point.normal.dot(drawn.towards) > 0.0 {
                // Half of the samples go either way: twice the light of each.
                let radiance = drawn.sky.radiance(sight.scene, drawn.towards);
                let light = radiance * (2.0 * drawn.weight / SKY_SAMPLES as f32);
                sum.receive(light * passing(sight, &point, drawn.towards, portal.shade()), drawn.towards);
            }
        }
    }
}

/// What gets through from the sky along `towards`.
fn passing(sight: &Sight, point: &SurfacePoint, towards: Vec3, shade: Option<u16>) -> Rgb {
    let Some(tracer) = sight.lights.tracer(sight.tracer, shade) else { return Rgb::ONE };
    let origin = sight.tracer.off_surface(point.position, point.normal);
    let mut passing = [Rgb::ZERO];
    tracer.transmittance_of_rays(&[Ray { origin, direction: towards }], &mut passing);
    passing[0]
}
