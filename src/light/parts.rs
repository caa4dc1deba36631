//! Direct light told apart by light group and by what of it is baked.
//!
//! Each part has lights of its own, so that every shadow ray to a light is shot once, whichever parts there are; the whole is the sum
//! of the parts, in order. Without groups, and with everything baked, there are no parts, and nothing differs from a bake that knows
//! none.

use super::direct::Direct;
use super::units::{Memory, direct_of, units};
use super::{Lights, Lit, Shining};
use crate::Result;
use crate::color::Rgb;
use crate::patch::Sparse;
use crate::progress::Progress;
use crate::scene::contribution::UNGROUPED;
use crate::scene::{BakeMode, Contribution, Environment, Scene};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Lights of one group and mode.
pub struct Part {
    /// `None`: of no group.
    pub group: Option<Arc<str>>,
    /// Baked or indirect.
    pub mode: BakeMode,
    /// What shines in it.
    pub shining: Vec<Shining>,
    pub lights: Lights,
}

impl Part {
    /// The name of its group.
    pub fn group(&self) -> &str {
        self.group.as_deref().unwrap_or(UNGROUPED)
    }
}

/// The parts of the light of `scene`, none where all of it is one: by group where `by_group`, in the order of the groups' names, what
/// has none last. All skies together are one: how much of them is found by brightness depends on all of them.
pub fn parts(scene: &Scene, by_group: bool) -> Vec<Part> {
    type Key = (bool, Option<Arc<str>>, BakeMode);
    let key = |shining: Shining| -> Key {
        let contribution = shining.contribution(scene);
        let group = contribution.group.clone().filter(|_| by_group);
        (group.is_none(), group, contribution.mode())
    };
    let sky_key = first_sky(scene).map(|k| key(Shining::Sky(k)));
    let lights = (0..scene.lights.len()).map(Shining::Light);
    let glowing = (0..scene.materials.len()).filter(|&m| scene.materials[m].is_emissive()).map(Shining::Material);
    let keys: BTreeSet<Key> = lights.chain(glowing).map(&key).chain(sky_key.clone()).collect();
    if !by_group && keys.iter().all(|key| key.2 != BakeMode::Indirect) {
        return Vec::new();
    }
    let part = |own: Key| {
        let holds = |shining: Shining| match shining {
            Shining::Sky(_) => {
                sky_key.as_ref() == Some(&own) && shining.contribution(scene).mode() != BakeMode::Dynamic
            }
            other => key(other) == own,
        };
        let lights = Lights::of(scene, holds);
        let shining = all_shining(scene).filter(|shining| holds(*shining)).collect();
        let (_, group, mode) = own;
        (!lights.is_empty()).then_some(Part { group, mode, shining, lights })
    };
    keys.into_iter().filter(|key| key.2 != BakeMode::Dynamic).filter_map(part).collect()
}

/// What shines in each of `parts`, or in all of `scene` where there are none.
fn of_parts(scene: &Scene, parts: &[Part]) -> Vec<Vec<Shining>> {
    if parts.is_empty() {
        let takes_part = |shining: &Shining| shining.contribution(scene).mode() != BakeMode::Dynamic;
        return vec![all_shining(scene).filter(takes_part).collect()];
    }
    parts.iter().map(|part| part.shining.clone()).collect()
}

/// All lamps of `parts` of the light of `scene`, cut into those whose direct light is found on its own.
pub fn all_units(scene: &Scene, parts: &[Part]) -> Vec<Vec<Shining>> {
    of_parts(scene, parts).iter().flat_map(|shining| units(shining)).collect()
}

/// Everything that shines in `scene`.
fn all_shining(scene: &Scene) -> impl Iterator<Item = Shining> {
    let glowing = (0..scene.materials.len()).filter(|&m| scene.materials[m].is_emissive()).map(Shining::Material);
    let skies = scene.environment.iter().flat_map(Environment::each).enumerate().map(|(k, _)| Shining::Sky(k));
    (0..scene.lights.len()).map(Shining::Light).chain(glowing).chain(skies)
}

/// The first sky that takes part in the bake: the others are taken as it is.
fn first_sky(scene: &Scene) -> Option<usize> {
    let mut skies = scene.environment.iter().flat_map(Environment::each);
    skies.position(|sky| sky.contribution.mode() != BakeMode::Dynamic)
}

/// Gives all skies that take part in the bake the group and mode of the first of them, as they are baked as one. Returns the names of
/// those that had others.
pub fn unite_skies(scene: &mut Scene) -> Vec<String> {
    let Some(sky) = &mut scene.environment else { return Vec::new() };
    let mut skies: Vec<(&String, &mut Contribution)> = vec![(&sky.name, &mut sky.contribution)];
    skies.extend(sky.others.iter_mut().map(|other| (&other.name, &mut other.contribution)));
    let mut skies = skies.into_iter().filter(|(_, contribution)| contribution.mode() != BakeMode::Dynamic);
    let Some((_, first)) = skies.next() else { return Vec::new() };
    let mut unlike = Vec::new();
    for (name, own) in skies {
        if (own.mode(), &own.group) != (first.mode(), &first.group) {
            unlike.push(name.clone());
            (own.mode, own.group) = (first.mode, first.group.clone());
        }
    }
    unlike
}

/// Direct light, and its parts.
pub struct Apart {
    /// What all parts add up to; what it shows leaves out the parts of which indirect light alone is baked.
    pub whole: Direct,
    /// What of it is shown nowhere [lx], by patch; `None` where nothing is left out.
    pub left_out: Option<Vec<Rgb>>,
    /// One a part; empty unless they were asked for.
    pub each: Vec<Direct>,
}

/// The direct light of `parts`, each on its own where `keep`; `memory` remembers that of lamps.
///
/// # Errors
/// Those of `memory`; `Cancelled`.
pub fn direct_apart(
    lit: &Lit,
    parts: &[Part],
    keep: bool,
    memory: &dyn Memory,
    progress: &dyn Progress,
) -> Result<Apart> {
    let count = lit.ground.patches.len();
    let all = of_parts(lit.ground.scene, parts);
    if parts.is_empty() {
        let mut whole = None;
        direct_of(lit, &all, memory, progress, &mut |_, found| whole = Some(found))?;
        return Ok(Apart { whole: whole.unwrap_or_else(|| Direct::dark(count)), left_out: None, each: Vec::new() });
    }
    let (mut transport, mut shown) = (vec![Rgb::ZERO; count], vec![Rgb::ZERO; count]);
    let mut left_out = None;
    let (mut inflow, mut rays, mut each) = (DVec3::ZERO, 0, Vec::new());
    direct_of(lit, &all, memory, progress, &mut |k, found| {
        add(&mut transport, |i| found.transport[i]);
        let slot = match parts[k].mode {
            BakeMode::Indirect => left_out.get_or_insert_with(|| vec![Rgb::ZERO; count]),
            BakeMode::Baked | BakeMode::Dynamic => &mut shown,
        };
        add(slot, |i| found.shown[i]);
        (inflow, rays) = (inflow + found.inflow, rays + found.rays);
        if keep {
            each.push(found);
        }
    })?;
    let transport = Arc::new(transport);
    let shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
    Ok(Apart { whole: Direct { shown, transport, inflow, rays }, left_out, each })
}

fn add(sum: &mut [Rgb], value: impl Fn(usize) -> Rgb + Sync) {
    sum.par_iter_mut().enumerate().with_min_len(4096).for_each(|(i, sum)| *sum += value(i));
}
