//! What a bake takes over from earlier ones, and leaves for later ones.

use crate::adaptive::{self, AdaptiveReport, adapt, densities};
use crate::error::{Error, Result};
use crate::illuminate::kept::{add_base, has_links};
use crate::illuminate::state::State;
use crate::limits;
use crate::load::Loaded;
use crate::patch::Patches;
use crate::report::{Clock, Report};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::store::{Key, Store};
use crate::unwrap::{self, Atlas, Earlier, Parts, Places, UnwrapParams};
use crate::work::{Stored, Tally, Work};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Said where nothing stays where it was on the pages.
const ANEW: &str = "all objects have other places on the pages than in the bake before, and all light was found anew: a fifth of the texels or more \
                    has come or gone, or what is new has no room (with --resolution the one page is full; --density adds pages)";

/// The kind of entries that say what unwrappers made of meshes.
const CHARTS: &str = "charts";

/// The kind of entries by which bakes of one file know what the last one was of.
const STATE: &str = "state";

/// A store, and what it knows of the last bake of a scene file.
pub struct Remembered {
    pub store: Store,
    /// The scene file, wherever it is looked at from.
    file: PathBuf,
    /// What the last bake was of that had such texels.
    before: Option<State>,
}

impl Remembered {
    /// What the store that `settings` name knows of the scene file `file`; nothing where they name none.
    ///
    /// # Errors
    /// `Io`.
    pub fn open(file: &Path, settings: &Settings) -> Result<Self> {
        let store = settings.cache.as_deref().map_or_else(|| Ok(Store::none()), Store::open)?;
        let file = file.canonicalize().unwrap_or_else(|_| file.to_path_buf());
        let before = store.read(STATE, state_key(&file, settings))?.as_ref().and_then(State::restore);
        Ok(Self { store, file, before })
    }

    /// Makes lightmap UVs, and tells what a later bake can keep of their places. What is as it was in the bake before stays where it was.
    /// Where texels go where light varies, that is where it does in this light, or, with `as_before`, where the last bake of these
    /// texels found that it does, as far as the store knows.
    ///
    /// # Errors
    /// Those of [`unwrap::unwrap`]; `Io`; `Invalid` where the atlas is larger than the settings allow.
    pub fn lay_out(
        &self,
        loaded: &Loaded,
        settings: &Settings,
        as_before: bool,
        clock: &Clock,
        report: &mut Report,
    ) -> Result<(Atlas, Option<Places>)> {
        let (scene, store) = (&loaded.scene, &self.store);
        let is_adaptive = settings.adaptive_density.is_some_and(|strength| strength > 0.0);
        let known = if is_adaptive && as_before { adaptive::kept::recall(scene, settings, store)? } else { None };
        let adapted = match known {
            Some(known) => Some(known),
            None => adapt(scene, settings, &mut report.warnings, clock)?,
        };
        if let Some(adapted) = adapted.as_ref().filter(|_| !as_before) {
            adaptive::kept::keep(scene, settings, adapted, store)?;
        }
        let (importance, adaptive) = adapted.unzip();
        let params = UnwrapParams { importance, ..settings.unwrap_params() };
        let places = self.before.as_ref().and_then(State::places).filter(|_| !settings.fresh_places);
        let before = Earlier { places: places.cloned(), parts: self.parts()? };
        let made = unwrap::unwrap_after(scene, &params, &before, clock)?;
        let unwrap::Unwrapping { atlas, authored, warnings, earlier: Earlier { places, parts }, kept } = made;
        report.warnings.extend(warnings);
        if parts != before.parts {
            self.keep(CHARTS, charts_key(&self.file), &[&parts.to_bytes()]);
        }
        if before.places.is_some() && places.is_some() {
            let shown = scene.surfaces.iter().filter(|s| s.role.is_shown()).count();
            let reused = kept.unwrap_or(0);
            if kept.is_none() {
                report.warnings.add("unwrap", ANEW);
            }
            let tally = Tally { reused: reused as u64, anew: (shown - reused) as u64 };
            report.reused.insert("places".to_owned(), tally);
        }
        let of_charts = |adaptive| AdaptiveReport { densities: densities(scene, &atlas), ..adaptive };
        report.adaptive = adaptive.map(of_charts);
        report.authored_uvs = authored;
        limits::check_atlas(loaded, &atlas, settings)?;
        Ok((atlas, places))
    }

    /// The work on the scene with lightmap UVs, as far as it is remembered.
    pub fn work(&self, scene: &Scene, atlas: &Atlas, settings: &Settings) -> Work<'_> {
        if self.store.is_none() {
            return Work::unstored();
        }
        let base = base(scene, atlas);
        let work = Work::new(&self.store, base, settings.shard, settings.checkpoint());
        // What one process has seen before, another may not.
        let before = self.before.as_ref().filter(|_| settings.shard.is_none());
        match before.and_then(|before| State::new(scene, atlas, base, &[]).since(before)) {
            Some((base, change)) => work.after(base, change),
            None => work,
        }
    }

    /// The names of surfaces that have moved, changed or come since the last bake of all.
    pub fn changed<'s>(&self, scene: &'s Scene, atlas: &Atlas) -> Vec<&'s str> {
        let since = |before| State::new(scene, atlas, base(scene, atlas), &[]).since(before);
        let changed = self.before.as_ref().and_then(since).map_or_else(Vec::new, |(_, change)| change.surfaces);
        scene.surfaces.iter().zip(changed).filter(|(_, changed)| *changed).map(|(s, _)| s.name.as_str()).collect()
    }

    /// Notes what a bake was of, for the next one.
    pub fn keep_state(
        &self,
        (scene, atlas, patches): (&Scene, &Atlas, &Patches),
        places: Option<Places>,
        settings: &Settings,
    ) {
        let state = State::new(scene, atlas, base(scene, atlas), &patches.runs(scene.surfaces.len())).laid_out(places);
        let sections = state.sections();
        let sections: Vec<&[u8]> = sections.iter().map(AsRef::as_ref).collect();
        self.keep(STATE, state_key(&self.file, settings), &sections);
    }

    /// Lets go of what a bake that began at `start` left unused, where there is too much of it.
    pub fn prune(&self, start: SystemTime, settings: &Settings) {
        if let Some(limit) = settings.cache_limit
            && let Err(error) = self.store.prune_unused(limit, Some(start))
        {
            self.store.warn("cache", error);
        }
    }

    /// What is known of the parts of the file's meshes.
    fn parts(&self) -> Result<Parts> {
        let entry = self.store.read(CHARTS, charts_key(&self.file))?;
        Ok(entry.and_then(|entry| Parts::from_bytes(entry.section(0))).unwrap_or_default())
    }

    /// Keeps what saves later bakes time. Where that can't be, it is said, and this one goes on.
    fn keep(&self, kind: &str, key: Key, sections: &[&[u8]]) {
        if self.store.is_none() {
            return;
        }
        if let Err(error) = self.store.write(kind, key, sections) {
            self.store.warn("cache", error);
        }
    }
}

/// The key of all that results depend on of a scene with lightmap UVs.
fn base(scene: &Scene, atlas: &Atlas) -> Key {
    Key::of("base", |hasher| add_base(hasher, scene, atlas))
}

// Keys of results have the version in them, and what is found by way of these must not be of another.
fn charts_key(file: &Path) -> Key {
    Key::of("charts 1", |hasher| {
        hasher.add_str(env!("CARGO_PKG_VERSION"));
        hasher.add_str(&file.to_string_lossy());
    })
}

fn state_key(file: &Path, settings: &Settings) -> Key {
    Key::of("state 2", |hasher| {
        hasher.add_str(env!("CARGO_PKG_VERSION"));
        hasher.add_str(&file.to_string_lossy());
        hasher.add_debug(&settings.unwrap_params());
    })
}

/// The settings with which other light is found, or a bake made where nothing is remembered and that is asked for.
///
/// # Errors
/// `Invalid` where it isn't asked for.
pub fn relit(settings: &Settings, work: &Work, loaded: &Loaded) -> Result<Settings> {
    let is_unfit = settings.relight.is_some() && !has_links(&loaded.scene, work, settings);
    match settings.relight.as_ref().filter(|_| is_unfit) {
        None => Ok(settings.clone()),
        Some(relight) if relight.or_bake => Ok(Settings { relight: None, ..settings.clone() }),
        Some(relight) => {
            let cache = settings.cache.as_deref().unwrap_or(Path::new("")).display();
            let message = format!(
                "nothing that is remembered in {cache} fits these surfaces and texels at this --error, --seed and --normals (nor a sky, where the bake had none); {}",
                relight.advice
            );
            Err(Error::invalid(loaded.path().display(), message))
        }
    }
}
