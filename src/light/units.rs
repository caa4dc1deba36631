//! Direct light lamp by lamp, so that one of them may change and the others stay.
//!
//! Errors in a lamp's shadows are held against the light around: by itself, a weak lamp would cost as much as the sun beside it. So all lamps
//! get a first look, and each then a close one, beside all that are brighter. What was found of a lamp remembers how much light there was
//! beside it, and is found anew where there is far less now.
//!
//! Processes that share the work all have the first look; then one finds a lamp's light, and the others wait and read it.

use super::direct::{BLOCK_LEVEL, Direct, DirectParams, look_closely};
use super::first_look::{EACH, FirstLook, Looking, MOST_HELD, first_looks};
use super::kept::{KeptLight, means_over};
use super::touched::{Extent, Kept};
use super::{Lights, Lit, Shining};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::progress::Progress;
use crate::work::Change;
use std::ops::Range;

/// Lamps whose direct light is found on its own, at most, but for the sky: of more, several are taken together.
const MOST_UNITS: usize = 24;

/// Light is found anew where all light around it, over its own, has fallen below this share of what it was.
const LESS: f64 = 0.3;

/// Remembers the direct light of units of lamps.
pub trait Memory {
    /// The strength that the light of `unit` is a multiple of.
    fn strength(&self, unit: &[Shining]) -> Rgb;
    /// What was kept of it.
    ///
    /// # Errors
    /// `Io`.
    fn recall(&self, unit: &[Shining]) -> Result<Option<KeptLight>>;
    /// What was kept of it before a change, which says what the change is.
    ///
    /// # Errors
    /// `Io`.
    fn recall_before(&self, unit: &[Shining]) -> Result<Option<(KeptLight, &Change)>>;
    /// What was kept of it since, where it is `wanted`, or is being kept by another process that shares the work; else by `make`, to
    /// be kept for later.
    ///
    /// # Errors
    /// `Io`; `Cancelled`; those of `make`.
    fn once(
        &self,
        unit: &[Shining],
        wanted: &dyn Fn(&KeptLight) -> bool,
        make: &mut dyn FnMut() -> Result<KeptLight>,
    ) -> Result<KeptLight>;
}

/// `shining` cut into units: one a lamp, several where there are very many; the sky as a whole.
pub(super) fn units(shining: &[Shining]) -> Vec<Vec<Shining>> {
    let (skies, others): (Vec<Shining>, Vec<Shining>) = shining.iter().partition(|s| matches!(s, Shining::Sky(_)));
    let size = others.len().div_ceil(MOST_UNITS).max(1);
    others.chunks(size).map(<[Shining]>::to_vec).chain((!skies.is_empty()).then_some(skies)).collect()
}

/// A unit, and what is known of its light.
struct Unit {
    part: usize,
    shining: Vec<Shining>,
    /// From 0 in each part.
    number: u32,
    strength: Rgb,
    kept: Option<KeptLight>,
    /// The mean over each block of what arrives at a first look, at a strength of 1. Kept or not, the same to the bit.
    means: Vec<Rgb>,
}

/// What it takes to look at a unit of which nothing is kept.
struct Fresh<'a> {
    lights: Lights,
    params: DirectParams,
    /// Its light before a change, with the means over blocks, and how much other light there was.
    before: Option<(Direct, Vec<Rgb>, f64, &'a Change)>,
    /// What of that the change can touch; none: all.
    extent: Option<Extent>,
    look: Option<FirstLook>,
}

/// The direct light of `parts` of what shines, each in turn: `take` is given its number and its light.
///
/// # Errors
/// Those of `memory`; `Cancelled`.
pub fn direct_of(
    lit: &Lit,
    parts: &[Vec<Shining>],
    memory: &dyn Memory,
    progress: &dyn Progress,
    take: &mut dyn FnMut(usize, Direct),
) -> Result<()> {
    let parts: Vec<Vec<Vec<Shining>>> = parts.iter().map(|shining| units(shining)).collect();
    let (count, looks) = (parts.len(), parts.iter().map(Vec::len).sum::<usize>());
    progress.begin("direct", (looks * lit.ground.patches.len()) as u64);
    let blocks = lit.ground.blocks(BLOCK_LEVEL);
    let area = |block: &Range<usize>| block.clone().map(|i| f64::from(lit.exposure.area[i])).sum();
    let areas: Vec<f64> = blocks.iter().map(area).collect();
    let mut all: Vec<Unit> = Vec::new();
    for (part, units) in parts.into_iter().enumerate() {
        for (shining, number) in units.into_iter().zip(0..) {
            let strength = memory.strength(&shining);
            let kept = memory.recall(&shining)?.filter(|kept| kept.means.len() == blocks.len());
            let means = kept.as_ref().map_or_else(Vec::new, |kept| kept.means.clone());
            all.push(Unit { part, shining, number, strength, kept, means });
        }
    }
    let mut fresh = look_at_fresh(lit, &mut all, &blocks, memory, progress)?;
    let fluxes: Vec<f64> = all.iter().map(|unit| unit.flux(&areas)).collect();
    let mut sums: Vec<Option<Direct>> = (0..count).map(|_| None).collect();
    let mut fresh = fresh.iter_mut();
    for (k, unit) in all.iter().enumerate() {
        let is_before = |other: usize| fluxes[other].total_cmp(&fluxes[k]).then(k.cmp(&other)).is_gt();
        let brighter: Vec<usize> = (0..all.len()).filter(|&other| is_before(other)).collect();
        let beside: f64 = brighter.iter().map(|&other| fluxes[other]).sum();
        let own = fluxes[k].max(f64::MIN_POSITIVE);
        let others =
            fluxes.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, flux)| flux).sum::<f64>() / own;
        let ratio = beside / own;
        let brighter = brighter.iter().map(|&other| &all[other]).collect();
        let looking = Close { lit, blocks: &blocks, brighter, ratio, others, unit };
        let own = if unit.kept.is_none() { fresh.next() } else { None };
        let found = looking.find(own, memory, progress)?;
        let sum = &mut sums[unit.part];
        *sum = Some(match sum.take() {
            None => found,
            Some(sum) => sum.plus(&found),
        });
        if all.get(k + 1).is_none_or(|next| next.part != unit.part)
            && let Some(sum) = sum.take()
        {
            take(unit.part, sum);
        }
    }
    Ok(())
}

/// Has a first look at those of `all` units of which nothing is kept, and notes their means. What it takes to look closer is of those, in order.
fn look_at_fresh<'a>(
    lit: &Lit,
    all: &mut [Unit],
    blocks: &[Range<usize>],
    memory: &'a dyn Memory,
    progress: &dyn Progress,
) -> Result<Vec<Fresh<'a>>> {
    let mut fresh = Vec::new();
    for unit in all.iter().filter(|unit| unit.kept.is_none()) {
        fresh.push(unit.fresh(lit, blocks, memory)?);
    }
    let (looks, is_held) = {
        let lits: Vec<Lit> = fresh.iter().map(|fresh| fresh.lit(lit)).collect();
        let kept: Vec<Option<Kept>> = fresh.iter().map(Fresh::kept).collect();
        let mut held = 0;
        let mut is_held = Vec::new();
        for kept in &kept {
            held += if kept.is_some() { 0 } else { EACH };
            is_held.push(held <= MOST_HELD);
        }
        let each = lits.iter().zip(&kept).zip(&is_held);
        let looking: Vec<Looking> =
            each.map(|((lit, kept), is_held)| Looking { lit: *lit, kept: kept.as_ref(), is_held: *is_held }).collect();
        (first_looks(lit, &looking, blocks, progress)?, is_held)
    };
    let unknown = all.iter_mut().filter(|unit| unit.kept.is_none());
    for (((unit, fresh), look), is_held) in unknown.zip(&mut fresh).zip(looks).zip(is_held) {
        unit.means = means_over(look.means.iter().map(|[lamps, sky]| *lamps + *sky), unit.strength);
        fresh.look = Some(look).filter(|_| is_held);
    }
    Ok(fresh)
}

impl Unit {
    /// About the flux that it sends to patches [lm], luminance, onto blocks of the areas `areas` [m^2].
    fn flux(&self, areas: &[f64]) -> f64 {
        let each = self.means.iter().zip(areas).map(|(mean, area)| f64::from(luminance(*mean * self.strength)) * area);
        each.sum()
    }

    fn is_sky(&self) -> bool {
        self.shining.iter().any(|shining| matches!(shining, Shining::Sky(_)))
    }

    /// What it takes to look at it.
    fn fresh<'a>(&self, lit: &Lit, blocks: &[Range<usize>], memory: &'a dyn Memory) -> Result<Fresh<'a>> {
        let before = memory.recall_before(&self.shining)?.and_then(|(kept, change)| {
            let numbers = change.numbers(&lit.ground.runs())?;
            let means = kept.means_of(&numbers, blocks).into_iter().map(|mean| mean * self.strength).collect();
            let light = kept.light(self.strength, numbers.len())?.renumbered(&numbers, lit.ground.patches.len());
            Some((light, means, kept.beside, change))
        });
        let mut fresh = Fresh {
            lights: Lights::of(lit.ground.scene, |shining| self.shining.contains(&shining)),
            // Points of its own: errors of lamps that shared them would add up.
            params: DirectParams { unit: self.number, ..lit.params.clone() },
            before,
            extent: None,
            look: None,
        };
        let extent =
            |(old, _, _, change): &(Direct, Vec<Rgb>, f64, &Change)| Extent::new(&fresh.lit(lit), old, change, blocks);
        fresh.extent = fresh.before.as_ref().and_then(extent);
        Ok(fresh)
    }
}

impl Fresh<'_> {
    fn lit<'a>(&'a self, lit: &Lit<'a>) -> Lit<'a> {
        Lit { lights: &self.lights, params: &self.params, ..*lit }
    }

    fn kept(&self) -> Option<Kept<'_>> {
        let (old, means, ..) = self.before.as_ref()?;
        Some(Kept { old, means, extent: self.extent.as_ref()? })
    }
}

/// A close look at a unit.
struct Close<'a> {
    lit: &'a Lit<'a>,
    blocks: &'a [Range<usize>],
    /// The units that are brighter, and how many times as much light they send.
    brighter: Vec<&'a Unit>,
    ratio: f64,
    /// The same of all other units.
    others: f64,
    unit: &'a Unit,
}

impl Close<'_> {
    /// The light of the unit: what is kept of it, or is found by what is `fresh`.
    fn find<'f>(
        &self,
        fresh: Option<&mut Fresh<'f>>,
        memory: &'f dyn Memory,
        progress: &dyn Progress,
    ) -> Result<Direct> {
        let Unit { shining, strength, means, .. } = self.unit;
        let patches = self.lit.ground.patches.len();
        let is_close = |kept: &KeptLight| self.is_close(kept.beside);
        if let Some(light) =
            self.unit.kept.as_ref().filter(|kept| is_close(kept)).and_then(|k| k.light(*strength, patches))
        {
            return Ok(light);
        }
        let mut own = None;
        let fresh = match fresh {
            Some(fresh) => fresh,
            None => own.insert(self.unit.fresh(self.lit, self.blocks, memory)?),
        };
        let firsts = || self.blocks.iter().map(|block| block.start as u32).collect();
        let mut make = || {
            let found = self.look(fresh, progress)?;
            Ok(KeptLight::new(&found, *strength, (firsts(), means.clone()), self.ratio))
        };
        let kept = memory.once(shining, &is_close, &mut make)?;
        match kept.light(*strength, patches) {
            Some(found) => Ok(found),
            None => self.look(fresh, progress),
        }
    }

    /// True where what was found with `beside` times as much other light around is close enough now.
    fn is_close(&self, beside: f64) -> bool {
        LESS * (1.0 + beside) <= 1.0 + self.others
    }

    fn look(&self, fresh: &mut Fresh, progress: &dyn Progress) -> Result<Direct> {
        let look = fresh.look.take();
        let fresh = &*fresh;
        let lit = fresh.lit(self.lit);
        let mut kept = fresh.kept();
        let mut look = look;
        if fresh.before.as_ref().is_some_and(|(.., beside, _)| !self.is_close(*beside)) {
            (kept, look) = (None, None);
        }
        let first = match look {
            Some(look) => look,
            None => {
                let looking = [Looking { lit, kept: kept.as_ref(), is_held: true }];
                first_looks(self.lit, &looking, self.blocks, progress)?.pop().unwrap_or_default()
            }
        };
        let around = self.around();
        look_closely(&lit, self.lit.lights, self.blocks, &around, first, kept.as_ref(), progress)
    }

    /// The mean light around each block [lx] (luminance): its own, and that of brighter units. What a sky brings is added to it where it is
    /// found.
    fn around(&self) -> Vec<f32> {
        let own = Some(self.unit).filter(|unit| !unit.is_sky());
        let mut around = vec![0.0; self.blocks.len()];
        for unit in self.brighter.iter().copied().chain(own) {
            let light = unit.means.iter().map(|mean| luminance(*mean * unit.strength));
            around.iter_mut().zip(light).for_each(|(sum, light)| *sum += light);
        }
        around
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn very_many_lamps_share_units_and_the_sky_is_one() {
        let lamps: Vec<Shining> = (0..100).map(Shining::Light).chain((0..3).map(Shining::Sky)).collect();
        let units = units(&lamps);
        assert!(units.len() <= MOST_UNITS + 1);
        assert_eq!(units.concat(), lamps);
        assert_eq!(units.last().map(Vec::len), Some(3));
        assert_eq!(super::units(&lamps[..3]).len(), 3);
    }
}
