//! What of the light of a scene is remembered from bake to bake: openings of texels, the direct light of each lamp, and what blocks see.

use crate::blocks::backs::{BackLamps, Told};
use crate::blocks::kept::Kept;
use crate::blocks::{BlockParams, Seen, look, look_again};
use crate::color::Rgb;
use crate::digest;
use crate::error::{Error, Result};
use crate::light::direct::DirectParams;
use crate::light::kept::KeptLight;
use crate::light::parts::{Part, all_units};
use crate::light::touched::keeps_links;
use crate::light::units::Memory;
use crate::light::{Direct, Lights, Lit, Shining};
use crate::patch::Ground;
use crate::patch::unocclude::{Exposure, Openings};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::store::{Hasher, Key};
use crate::unwrap::Atlas;
use crate::work::{Change, Work};

/// What all that is remembered depends on: the ways of rays and the places of texels.
pub fn add_base(hasher: &mut Hasher, scene: &Scene, atlas: &Atlas) {
    hasher.add_str(env!("CARGO_PKG_VERSION"));
    hasher.add_key(digest::geometry(scene));
    hasher.add_key(digest::atlas(atlas));
}

/// The kind of results that openings of texels are.
const OPENINGS: &str = "openings";

/// What of patches lies in the open.
///
/// # Errors
/// `Cancelled`; `Io`.
pub fn expose(ground: &Ground, seed: u32, work: &Work, progress: &dyn Progress) -> Result<Exposure> {
    let add = |hasher: &mut Hasher| hasher.add_u64(u64::from(seed));
    let fits = |openings: &Openings| openings.fit(ground.patches.len());
    let find = || match work.find_before::<Openings>(OPENINGS, add)? {
        Some((openings, change)) => openings.find_again(ground, seed, change, progress),
        None => Openings::find(ground, seed, progress),
    };
    work.ask(OPENINGS);
    Ok(work.once_in_all(OPENINGS, add, fits, find, progress)?.expose(ground))
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

    fn recall_before(&self, unit: &[Shining]) -> Result<Option<(KeptLight, &Change)>> {
        let before = self.work.find_before(DIRECT, |hasher| self.add(unit, hasher))?;
        Ok(before.filter(|(_, change)| keeps_links(self.lit.ground.scene, unit, change)))
    }

    fn once(
        &self,
        unit: &[Shining],
        wanted: &dyn Fn(&KeptLight) -> bool,
        make: &mut dyn FnMut() -> Result<KeptLight>,
    ) -> Result<KeptLight> {
        self.work.once_in_all(DIRECT, |hasher| self.add(unit, hasher), wanted, make, self.progress)
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

/// Adds what links depend on beside the base: which normals irradiance is about, whether directions are wanted, too, and whether there is a
/// sky that ways can end in.
fn add_links(hasher: &mut Hasher, params: &BlockParams, direct: &DirectParams, sky: bool) {
    // What is wanted of the light, and how often it is reflected, changes nothing of what is seen.
    hasher.add_debug(&BlockParams { layers: false, halves: false, max_bounces: None, ..params.clone() });
    hasher.add_debug(&[direct.shading_normals, direct.moments, sky]);
}

/// Whether there was a sky where links were found that are of use where there `is` one or not: what escapes is of none without one.
fn skies(is: bool) -> &'static [bool] {
    if is { &[true] } else { &[false, true] }
}

/// True where it is remembered what blocks see in a bake of `scene` by these settings.
pub fn has_links(scene: &Scene, work: &Work, settings: &Settings) -> bool {
    let (params, direct) = (settings.block_params(), settings.direct_params());
    let has = |sky: &bool| work.has(LINKS, |hasher| add_links(hasher, &params, &direct, *sky));
    skies(Lights::has_sky(scene)).iter().any(has)
}

/// What blocks see, found by tracing or remembered as `how` says.
///
/// # Errors
/// `Cancelled`; `Io`; `Awaited`; `Invalid` where it must be remembered and isn't.
pub fn see(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    parts: &[Part],
    how: Look,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Sight> {
    let has_sky = lit.lights.sky.is_some();
    let add = |sky: bool| move |hasher: &mut Hasher| add_links(hasher, params, lit.params, sky);
    let lamps = BackLamps::recall(lit, told(lit, params, parts, work, progress), work)?;
    let fit = |sky: bool| skies(sky).iter().copied().find(|sky| work.has(LINKS, add(*sky))).unwrap_or(sky);
    let known = if how == Look::Anew { None } else { work.find::<Kept>(LINKS, add(fit(has_sky)))? };
    if let Some(kept) = known {
        return Ok(Sight { seen: Seen { kept, lamps }, is_fresh: false });
    }
    if how == Look::Never {
        let message = "what blocks saw can't be read from the cache any more; bake anew";
        return Err(Error::invalid("relight", message));
    }
    let mut before = None;
    for &sky in skies(has_sky).iter().filter(|_| how != Look::Anew) {
        before = before.or(work.find_before::<Kept>(LINKS, add(sky))?);
    }
    let seen = match &before {
        Some((kept, change)) => look_again(lit, direct, params, (kept, change), lamps, work, progress)?,
        None => Err(lamps),
    };
    let is_fresh = seen.is_err();
    let mut seen = match seen {
        Ok(seen) => seen,
        Err(lamps) => look(lit, direct, params, lamps, work, progress)?,
    };
    work.keep(LINKS, add(has_sky), &seen.kept)?;
    seen.lamps.keep(work)?;
    Ok(Sight { seen, is_fresh })
}

/// The lamps of `parts`, as the light on backs is remembered by them.
fn told(lit: &Lit, params: &BlockParams, parts: &[Part], work: &Work, progress: &dyn Progress) -> Vec<Told> {
    let lamps = Lamps { lit, work, progress };
    let told = |shining: Vec<Shining>| {
        let key = Key::of("back light 1", |hasher| {
            hasher.add_u64(u64::from(params.seed));
            lamps.add(&shining, hasher);
        });
        Told { key, strength: lamps.strength(&shining), shining }
    };
    all_units(lit.ground.scene, parts).into_iter().map(told).collect()
}
