//! Light over mirrors and glass, for radiosity: photons bring it to texels as if it came straight from lights.
//!
//! Light that comes to mirrors and glass straight from lights, or over others, is theirs to send on, and is taken off what radiosity sends on.
//! What comes to them off diffuse surfaces radiosity sends on itself, from diffuse stand-ins ([`crate::scatter::adapt_for_caustics`]).

use crate::Result;
use crate::color::Rgb;
use crate::integrate::World;
use crate::integrate::photon::{Caustics, caustics};
use crate::light::parts::{Apart, Part};
use crate::light::{Direct, Lights, Lit};
use crate::medium::Media;
use crate::patch::Sparse;
use crate::progress::Progress;
use crate::scatter::{Scattering, Surfaces};
use crate::scene::BakeMode;
use crate::sensor::Texels;
use crate::settings::Settings;
use std::sync::Arc;

/// Photons for each texel, and bounds on their number.
const PHOTONS_A_TEXEL: u64 = 64;
const LEAST_PHOTONS: u64 = 1 << 20;
const MOST_PHOTONS: u64 = 1 << 24;

/// What light over mirrors and glass changed.
#[derive(Default)]
pub struct Brought {
    /// What came to each patch, of what is shown [lx]; empty where it wasn't asked for.
    pub shown: Vec<Rgb>,
    /// Patches of mirrors and glass, and what came to each that photons sent on [lx].
    pub taken: Vec<(u32, Rgb)>,
}

/// Adds what comes over mirrors and glass to the direct light `apart`, each part's to its own, where that is asked for.
///
/// # Errors
/// `Unsupported` where a light sends out no photons; `Cancelled`.
pub fn add(
    lit: &Lit,
    parts: &[Part],
    apart: &mut Apart,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Brought> {
    if !settings.caustics {
        return Ok(Brought::default());
    }
    progress.begin("caustics", 0);
    let count = lit.ground.patches.len();
    let mut shown = vec![Rgb::ZERO; count];
    if parts.is_empty() {
        let found = send(lit, lit.lights, settings, progress)?;
        add_to(&mut apart.whole, &found, true);
        return Ok(Brought { shown: found.irradiance, taken: take(lit, apart) });
    }
    for (k, part) in parts.iter().enumerate() {
        let found = send(lit, &part.lights, settings, progress)?;
        let is_shown = part.mode == BakeMode::Baked;
        add_to(&mut apart.whole, &found, is_shown);
        if let Some(own) = apart.each.get_mut(k) {
            add_to(own, &found, true);
        }
        let sum = if is_shown { &mut shown } else { apart.left_out.get_or_insert_with(|| vec![Rgb::ZERO; count]) };
        sum.iter_mut().zip(&found.irradiance).for_each(|(sum, more)| *sum += *more);
    }
    Ok(Brought { shown, taken: take(lit, apart) })
}

/// Takes what photons send on off what radiosity does, of the whole and of each part; returns the whole's, by patch of mirrors and glass.
fn take(lit: &Lit, apart: &mut Apart) -> Vec<(u32, Rgb)> {
    let scene = lit.ground.scene;
    let is_single: Vec<bool> = scene
        .materials
        .iter()
        .map(|material| material.appearance.as_ref().is_some_and(|look| look.is_single() && !look.is_pane()))
        .collect();
    let is_on = |i: &usize| {
        lit.ground.patches.pieces(*i).next().is_some_and(|(triangle, _)| {
            let (surface, triangle) = lit.ground.tracer.place(triangle);
            is_single[scene.meshes[scene.surfaces[surface].mesh].triangle_material[triangle] as usize]
        })
    };
    let on: Vec<usize> = (0..lit.ground.patches.len()).filter(is_on).collect();
    let taken = on.iter().map(|&i| (i as u32, apart.whole.transport[i])).collect();
    if !on.is_empty() {
        std::iter::once(&mut apart.whole).chain(&mut apart.each).for_each(|direct| stop(direct, &on));
    }
    taken
}

/// Lets `patches` send on nothing of what `direct` brings to them; it is shown all the same.
fn stop(direct: &mut Direct, patches: &[usize]) {
    let shown: Vec<Rgb> = direct.shown.iter().copied().collect();
    let mut transport = direct.transport.to_vec();
    patches.iter().for_each(|&i| transport[i] = Rgb::ZERO);
    let transport = Arc::new(transport);
    direct.shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
    direct.transport = transport;
}

/// What photons of `lights` bring to texels over mirrors and glass.
fn send(lit: &Lit, lights: &Lights, settings: &Settings, progress: &dyn Progress) -> Result<Caustics> {
    let Lit { ground, exposure, .. } = *lit;
    let scattering = Scattering::new(ground.scene, Surfaces::Full);
    // Radiosity knows no media: light passes them here, too.
    let media = Media::default();
    let world = World::new(ground.scene, ground.tracer, lights, &scattering, &media);
    // Photons land about the triangles' normals, as light between surfaces does.
    let texels = Texels { ground, exposure, shading_normals: false };
    let photons = (PHOTONS_A_TEXEL * ground.patches.len() as u64).clamp(LEAST_PHOTONS, MOST_PHOTONS);
    caustics(&world, &texels, photons, settings.seed, progress)
}

/// Adds `found` to what `direct` sends on and, where it `is_shown`, shows.
fn add_to(direct: &mut Direct, found: &Caustics, is_shown: bool) {
    let sum = |(a, b): (&Rgb, &Rgb)| *a + *b;
    let transport = Arc::new(direct.transport.iter().zip(&found.irradiance).map(sum).collect::<Vec<_>>());
    let shown: Vec<Rgb> = match is_shown {
        true => direct.shown.iter().zip(&found.irradiance).map(sum).collect(),
        false => direct.shown.iter().copied().collect(),
    };
    direct.shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
    direct.transport = transport;
    direct.inflow += found.flux;
    direct.rays += found.photons;
}
