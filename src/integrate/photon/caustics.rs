//! Light over mirrors and glass, straight from lights, for methods that see diffuse surfaces alone.

use super::refuse;
use super::shoot::{AT_ONCE, Lamps, Landing, Only, Way, follow, numbers, take_aim};
use crate::Result;
use crate::color::Rgb;
use crate::integrate::World;
use crate::integrate::emit::Sources;
use crate::progress::Progress;
use crate::sensor::Sensor;
use glam::DVec3;
use rayon::prelude::*;

/// What photons over mirrors and glass alone, one at least, bring to a sensor on surfaces.
#[derive(Clone, Debug)]
pub struct Caustics {
    /// By pixel [lx].
    pub irradiance: Vec<Rgb>,
    /// Half the difference between the means over even and over odd batches [lx]: noise as large as that of the irradiance.
    pub difference: Vec<Rgb>,
    /// Flux that landed [lm].
    pub flux: DVec3,
    /// Photons that were sent.
    pub photons: u64,
}

/// Photons of one batch.
const BATCH: u32 = 1 << 18;

/// Sends `photons` [1] out, and counts where they land.
///
/// # Errors
/// `Unsupported` where lights are portals, or linked to some surfaces; `Cancelled`.
pub fn caustics(
    world: &World,
    sensor: &dyn Sensor,
    photons: u64,
    seed: u32,
    progress: &dyn Progress,
) -> Result<Caustics> {
    refuse::check_lights(world)?;
    let sources = Sources::new(world);
    let lands = |landing: &Landing| landing.on_pixel(sensor).is_some();
    let aim = take_aim(world, &sources, (Only::Mirrors, None), seed, progress, lands)?;
    let lamps = Lamps { sources: &sources, aim: &aim };
    let batches = photons.div_ceil(u64::from(BATCH)).max(2);
    let mut halves = [vec![DVec3::ZERO; sensor.len()], vec![DVec3::ZERO; sensor.len()]];
    let mut flux = DVec3::ZERO;
    for batch in 0..batches {
        let landed = land(world, lamps, sensor, (seed, batch), progress)?;
        for (pixel, irradiance) in landed {
            halves[(batch % 2) as usize][pixel as usize] += irradiance.as_dvec3();
            flux += irradiance.as_dvec3() * f64::from(sensor.area(pixel as usize));
        }
        progress.advance(1);
    }
    let n = batches as f64;
    let [even, odd] = [batches.div_ceil(2), batches / 2].map(|n| n as f64);
    let [a, b] = halves;
    let mean = |(a, b): (&DVec3, &DVec3)| ((*a + *b) / n).as_vec3();
    let difference = |(a, b): (&DVec3, &DVec3)| (0.5 * (*a / even - *b / odd)).as_vec3();
    Ok(Caustics {
        irradiance: a.iter().zip(&b).map(mean).collect(),
        difference: a.iter().zip(&b).map(difference).collect(),
        flux: flux / n,
        photons: batches * u64::from(BATCH),
    })
}

/// Where the photons of a batch land, and what they bring [lx].
fn land(
    world: &World,
    lamps: Lamps,
    sensor: &dyn Sensor,
    run: (u32, u64),
    progress: &dyn Progress,
) -> Result<Vec<(u32, Rgb)>> {
    let chunks: Vec<Vec<(u32, Rgb)>> = (0..BATCH / AT_ONCE)
        .into_par_iter()
        .map(|chunk| {
            progress.check()?;
            let mut landed = Vec::new();
            for k in chunk * AT_ONCE..(chunk + 1) * AT_ONCE {
                let mut numbers = numbers(run, Only::Mirrors, k);
                let Some(emitted) = lamps.emit(world, &mut numbers) else { continue };
                let way = Way { flux: emitted.flux / BATCH as f32, most: None, only: Only::Mirrors };
                follow(world, &emitted, way, &mut numbers, |landing| {
                    if landing.caustic {
                        landed.extend(landing.on_pixel(sensor));
                    }
                });
            }
            Ok(landed)
        })
        .collect::<Result<_>>()?;
    Ok(chunks.into_iter().flatten().collect())
}
