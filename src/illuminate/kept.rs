//! What of the light of a scene is remembered from bake to bake: openings of texels, the direct light of each lamp, and what blocks see.

use crate::blocks::kept::Kept;
use crate::blocks::{BlockParams, Seen, look};
use crate::color::Rgb;
use crate::digest;
use crate::error::Result;
use crate::light::direct::DirectParams;
use crate::light::kept::KeptLight;
use crate::light::units::Memory;
use crate::light::{Direct, Lit, Shining};
use crate::patch::Ground;
use crate::patch::unocclude::{Exposure, Openings};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::store::Hasher;
use crate::unwrap::Atlas;
use crate::work::Work;

/// What all that is remembered depends on: the ways of rays and the places of texels.
pub fn add_base(hasher: &mut Hasher, scene: &Scene, atlas: &Atlas) {
    hasher.add_str(env!("CARGO_PKG_VERSION"));
    hasher.add_key(digest::geometry(scene));
    hasher.add_key(digest::atlas(atlas));
}

/// What of patches lies in the open.
///
/// # Errors
/// `Cancelled`; `Io`.
pub fn expose(ground: &Ground, seed: u32, work: &Work, progress: &dyn Progress) -> Result<Exposure> {
    let add = |hasher: &mut Hasher| hasher.add_u64(u64::from(seed));
    let fits = |openings: &Openings| openings.fit(ground.patches.len());
    let find = || Openings::find(ground, seed, progress);
    Ok(work.once_in_all("openings", add, fits, find, progress)?.expose(ground))
}

/// Remembers the direct light of lamps.
pub struct Lamps<'a> {
    pub lit: &'a Lit<'a>,
    pub work: &'a Work<'a>,
    pub progress: &'a dyn Progress,
}

/// The kind of results that the direct light of lamps is.
const DIRECT: &str = "direct";

impl Lamps<'_> {
    /// Adds what the light of `unit` at a strength of 1 depends on.
    fn add(&self, unit: &[Shining], hasher: &mut Hasher) {
        let each: Vec<_> = unit.iter().map(|&shining| digest::shining(self.lit.ground.scene, shining)).collect();
        hasher.add_debug(&DirectParams { moments: false, ..self.lit.params.clone() });
        // A channel that is dark tells nothing of what it would be.
        hasher.add_debug(&self.strength(unit).cmpgt(Rgb::ZERO));
        for (key, own) in &each {
            hasher.add_key(*key);
            if each.len() > 1 {
                hasher.add_slice(&own.to_array());
            }
        }
    }
}

impl Memory for Lamps<'_> {
    fn strength(&self, unit: &[Shining]) -> Rgb {
        // Several lamps have no strength in common.
        if let [shining] = *unit { digest::shining(self.lit.ground.scene, shining).1 } else { Rgb::ONE }
    }

    fn recall(&self, unit: &[Shining]) -> Result<Option<KeptLight>> {
        self.work.find(DIRECT, |hasher| self.add(unit, hasher))
    }

    fn once(
        &self,
        unit: &[Shining],
        wanted: &dyn Fn(&KeptLight) -> bool,
        make: &dyn Fn() -> Result<KeptLight>,
    ) -> Result<KeptLight> {
        self.work.once_in_all(DIRECT, |hasher| self.add(unit, hasher), wanted, make, self.progress)
    }
}

/// What blocks see, and whether it was found just now, in the light of `lit`.
pub struct Sight {
    pub seen: Seen,
    pub is_fresh: bool,
}

/// What blocks see: remembered, unless it is to be found `anew`.
///
/// # Errors
/// `Cancelled`; `Io`; `Awaited`.
pub fn see(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    anew: bool,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Sight> {
    // What is wanted of the light, and how often it is reflected, changes nothing of what is seen.
    let base = BlockParams { layers: false, halves: false, max_bounces: None, ..params.clone() };
    let add = |hasher: &mut Hasher| {
        hasher.add_debug(&base);
        hasher.add_u64(u64::from(lit.params.shading_normals));
    };
    let mut fresh = None;
    let make = || -> Result<Kept> {
        let (kept, on_backs) = look(lit, direct, params, work, progress)?.parted();
        fresh = Some(on_backs);
        Ok(kept)
    };
    let kept = if anew { work.renew("links", add, make)? } else { work.once("links", add, make)? };
    let is_fresh = fresh.is_some();
    Ok(Sight { seen: Seen::joined(kept, fresh.flatten()), is_fresh })
}
