//! What of the light of a scene is remembered from bake to bake: openings of texels, the direct light of each lamp, and what blocks see.

use crate::blocks::kept::Kept;
use crate::blocks::{BlockParams, Seen, look};
use crate::color::Rgb;
use crate::digest;
use crate::error::{Error, Result};
use crate::light::direct::DirectParams;
use crate::light::kept::KeptLight;
use crate::light::units::Memory;
use crate::light::{Direct, Lit, Shining};
use crate::patch::Ground;
use crate::patch::unocclude::{Exposure, Openings};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::settings::Settings;
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
    let find = || Openings::find(ground, seed, progress);
    let openings = work.once("openings", |hasher| hasher.add_u64(u64::from(seed)), find)?;
    let openings = if openings.fit(ground.patches.len()) { openings } else { find()? };
    Ok(openings.expose(ground))
}

/// Remembers the direct light of lamps.
pub struct Lamps<'a> {
    pub lit: &'a Lit<'a>,
    pub work: &'a Work<'a>,
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

    fn keep(&self, unit: &[Shining], light: &KeptLight) -> Result<()> {
        self.work.keep(DIRECT, |hasher| self.add(unit, hasher), light)
    }
}

/// What blocks see, and whether it was found just now, in the light of `lit`.
pub struct Sight {
    pub seen: Seen,
    pub is_fresh: bool,
}

/// Whether what blocks see may be remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// It must be.
    Never,
    /// It may.
    Once,
    /// It mustn't.
    Anew,
}

/// The kind of results that what blocks see is.
const LINKS: &str = "links";

/// Adds what links depend on beside the base; `shading`: irradiance is about interpolated normals.
fn add_links(hasher: &mut Hasher, params: &BlockParams, shading: bool) {
    // What is wanted of the light, and how often it is reflected, changes nothing of what is seen.
    hasher.add_debug(&BlockParams { layers: false, halves: false, max_bounces: None, ..params.clone() });
    hasher.add_u64(u64::from(shading));
}

/// True where it is remembered what blocks see in a bake of these settings.
pub fn has_links(work: &Work, settings: &Settings) -> bool {
    let shading = settings.direct_params().shading_normals;
    work.has(LINKS, |hasher| add_links(hasher, &settings.block_params(), shading))
}

/// What blocks see, found by tracing or remembered as `how` says.
///
/// # Errors
/// `Cancelled`; `Io`; `Awaited`; `Invalid` where it must be remembered and isn't.
pub fn see(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    how: Look,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Sight> {
    let add = |hasher: &mut Hasher| add_links(hasher, params, lit.params.shading_normals);
    let mut fresh = None;
    let make = || -> Result<Kept> {
        let (kept, on_backs) = look(lit, direct, params, work, progress)?.parted();
        fresh = Some(on_backs);
        Ok(kept)
    };
    let damaged = || Error::invalid("relight", "what blocks saw can't be read from the cache any more; bake anew");
    let kept = match how {
        Look::Never => work.find(LINKS, add)?.ok_or_else(damaged)?,
        Look::Once => work.once(LINKS, add, make)?,
        Look::Anew => work.renew(LINKS, add, make)?,
    };
    let is_fresh = fresh.is_some();
    Ok(Sight { seen: Seen::joined(kept, fresh.flatten()), is_fresh })
}
