//! What a sensor measures by one of the methods that follow rays, to as many samples, or in as much time, as settings say.

mod pace;

use crate::error::{Error, Result};
use crate::integrate::bidirectional::Bidirectional;
use crate::integrate::metropolis::Metropolis;
use crate::integrate::photon::{PhotonParams, Photons};
use crate::integrate::{BakedView, Integrator, Pixelwise, Walk, World};
use crate::load::baked::BakedLight;
use crate::progress::Progress;
use crate::sensor::{Film, Sensor};
use crate::settings::{Method, Settings};
use pace::Pace;
use std::time::Duration;

/// Samples a pixel, where neither they nor a time is asked for.
const SAMPLES: u32 = 64;

/// Makes passes until there are as many as asked for, or there is no time for another, one at least; calls `show` after each.
///
/// # Errors
/// `Invalid` where the method can't do what the scene holds; those of `show`; `Cancelled`.
pub fn measure(
    world: &World,
    sensor: &dyn Sensor,
    settings: &Settings,
    progress: &dyn Progress,
    show: impl FnMut(&Film) -> Result<()>,
) -> Result<Film> {
    let mut method = method(world, sensor, settings)?;
    expose(&mut *method, sensor.len(), settings, progress, show)
}

/// The same of a bake as a camera sees it, by a final gather where `gathers`.
///
/// # Errors
/// Those of `show`; `Cancelled`.
pub fn measure_bake(
    world: &World,
    light: &BakedLight,
    sensor: &dyn Sensor,
    gathers: bool,
    settings: &Settings,
    progress: &dyn Progress,
    show: impl FnMut(&Film) -> Result<()>,
) -> Result<Film> {
    let mut view = BakedView { world, sensor, light, gathers, seed: settings.seed };
    expose(&mut view, sensor.len(), settings, progress, show)
}

fn expose(
    method: &mut dyn Integrator,
    pixels: usize,
    settings: &Settings,
    progress: &dyn Progress,
    mut show: impl FnMut(&Film) -> Result<()>,
) -> Result<Film> {
    let budget = settings.time_budget.map(Duration::from_secs_f64);
    let most = samples(settings).map(u64::from);
    progress.begin(settings.method.name(), most.unwrap_or(0).saturating_mul(pixels as u64));
    if let Some(end) = budget {
        progress.ends_at(end);
    }
    let mut pace = Pace::new(budget, progress);
    let mut film = Film::new(pixels);
    while most.is_none_or(|most| film.passes() < most) && (film.passes() == 0 || pace.has_time()) {
        if !pace.pass(method, &mut film, pixels)? {
            break;
        }
        pace.show(|| show(&film))?;
    }
    Ok(film)
}

/// Samples a pixel; `None` where time alone bounds them.
fn samples(settings: &Settings) -> Option<u32> {
    settings.samples.or(settings.time_budget.is_none().then_some(SAMPLES))
}

/// The method that `settings` ask for.
fn method<'a>(world: &'a World<'a>, sensor: &'a dyn Sensor, settings: &Settings) -> Result<Box<dyn Integrator + 'a>> {
    let (max_bounces, seed) = (settings.max_bounces, settings.seed);
    let pixelwise = |method| Pixelwise { world, sensor, method, max_bounces, seed };
    let bidirectional = || Bidirectional::new(world, sensor, max_bounces, seed, settings.method.name());
    match settings.method {
        Method::Ray => {
            if let Some(medium) = world.media.names().next() {
                let message = "ray tracing knows no media, which scatter light; choose the method path or photon";
                return Err(Error::unsupported(medium, message));
            }
            Ok(Box::new(pixelwise(Walk::Ray)))
        }
        Method::Path => Ok(Box::new(pixelwise(Walk::Path))),
        Method::Bidirectional => Ok(Box::new(bidirectional()?)),
        Method::Metropolis => Ok(Box::new(Metropolis::new(bidirectional()?))),
        Method::Photon => {
            let walks = samples(settings).map(PhotonParams::walks_of);
            let params = PhotonParams { walks, max_bounces, seed, ..PhotonParams::default() };
            Ok(Box::new(Photons::new(world, sensor, params)?))
        }
        Method::Radiosity => Err(Error::invalid("method", "radiosity takes no pictures; choose path")),
    }
}
