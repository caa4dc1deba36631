//! Direct light lamp by lamp, so that one of them may change and the others stay.
//!
//! Errors in a lamp's shadows are held against all light around. So the brightest lamps come first, and those after them are looked at
//! as closely as the light that is there by then asks for: each by itself, a weak lamp would cost as much as the sun beside it. What was
//! found of a lamp remembers how much light there was beside it, and is found anew where there is far less now.
//!
//! So each lamp's light depends on that of all brighter ones, and processes that share the work can't take different lamps at once: one
//! finds a lamp's light, the others wait and read it.

use super::direct::{Direct, DirectParams, direct_beside, glimpse_flux};
use super::kept::{KeptLight, over_strength};
use super::touched::Kept;
use super::{Lights, Lit, Shining};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::progress::Progress;
use crate::work::Change;
use glam::DVec3;

/// Lamps whose direct light is found on its own, at most, but for the sky: of more, several are taken together.
const MOST_UNITS: usize = 24;

/// Light is found anew where the share of other light beside it has fallen below this share of what it was.
const LESS: f64 = 0.5;

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
        make: &dyn Fn() -> Result<KeptLight>,
    ) -> Result<KeptLight>;
}

/// `shining` cut into units: one a lamp, several where there are very many; the sky as a whole.
fn units(shining: &[Shining]) -> Vec<Vec<Shining>> {
    let (skies, others): (Vec<Shining>, Vec<Shining>) = shining.iter().partition(|s| matches!(s, Shining::Sky(_)));
    let size = others.len().div_ceil(MOST_UNITS).max(1);
    others.chunks(size).map(<[Shining]>::to_vec).chain((!skies.is_empty()).then_some(skies)).collect()
}

/// A unit, and what is known of its light.
struct Unit {
    shining: Vec<Shining>,
    /// From 0.
    number: u32,
    strength: Rgb,
    kept: Option<KeptLight>,
    /// About the flux that it sends to patches at a strength of 1 [lm], by channel.
    flux: DVec3,
}

impl Unit {
    /// About the flux that it sends to patches [lm], luminance. The same to the bit whether it was kept or not: it decides the order.
    fn light(&self) -> f64 {
        f64::from(luminance((self.flux * self.strength.as_dvec3()).as_vec3()))
    }
}

/// Light that is there already.
#[derive(Clone, Default)]
pub struct Beside {
    /// On each patch [lx]; empty: none.
    pub irradiance: Vec<Rgb>,
    /// About its flux to patches [lm], luminance.
    pub flux: f64,
}

/// The direct light of `shining`, the brightest first, `beside` what is there already: that is added to.
///
/// # Errors
/// Those of `memory`; `Cancelled`.
pub fn direct_of(
    lit: &Lit,
    shining: &[Shining],
    beside: &mut Beside,
    memory: &dyn Memory,
    progress: &dyn Progress,
) -> Result<Direct> {
    let lights_of = |unit: &[Shining]| Lights::of(lit.ground.scene, |shining| unit.contains(&shining));
    let mut all: Vec<Unit> = Vec::new();
    for (shining, number) in units(shining).into_iter().zip(0..) {
        let (strength, kept) = (memory.strength(&shining), memory.recall(&shining)?);
        let flux = match &kept {
            Some(kept) => kept.flux(),
            None => over_strength(glimpse_flux(&Lit { lights: &lights_of(&shining), ..*lit }, progress)?, strength),
        };
        all.push(Unit { shining, number, strength, kept, flux });
    }
    all.sort_by(|a, b| b.light().total_cmp(&a.light()));
    let patches = lit.ground.patches.len();
    let mut sum: Option<Direct> = None;
    for unit in all {
        let light = unit.light();
        let Unit { shining, number, strength, kept, flux } = unit;
        let ratio = beside.flux / light.max(f64::MIN_POSITIVE);
        let is_close = |kept: &KeptLight| LESS * kept.beside <= ratio.max(LESS);
        let look = || {
            let lights = lights_of(&shining);
            // Points of its own: errors of lamps that shared them would add up.
            let params = DirectParams { unit: number, ..lit.params.clone() };
            let lit = Lit { lights: &lights, params: &params, ..*lit };
            let before = memory.recall_before(&shining)?.filter(|(kept, _)| is_close(kept));
            let before = before.and_then(|(kept, change)| {
                let numbers = change.numbers(&lit.ground.runs())?;
                Some((kept.light(strength, numbers.len())?.renumbered(&numbers, patches), change))
            });
            let kept = before.as_ref().and_then(|(old, change)| Kept::new(&lit, old, change));
            direct_beside(&lit, &beside.irradiance, kept.as_ref(), progress)
        };
        let make = || Ok(KeptLight::new(&look()?, strength, flux, ratio));
        let kept = match kept.filter(is_close) {
            Some(kept) => kept,
            None => memory.once(&shining, &is_close, &make)?,
        };
        let found = match kept.light(strength, patches) {
            Some(found) => found,
            None => look()?,
        };
        beside.add(&found, light);
        sum = Some(match sum {
            None => found,
            Some(sum) => sum.plus(&found),
        });
    }
    sum.map_or_else(|| direct_beside(lit, &beside.irradiance, None, progress), Ok)
}

impl Beside {
    /// Adds `direct`, of about so much flux [lm].
    fn add(&mut self, direct: &Direct, flux: f64) {
        self.irradiance.resize(direct.transport.len(), Rgb::ZERO);
        self.irradiance.iter_mut().zip(direct.transport.iter()).for_each(|(sum, e)| *sum += *e);
        self.flux += flux;
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
