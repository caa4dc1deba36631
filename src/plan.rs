//! A bake that is laid out for several processes, on one machine or many: which scene, by which settings, in how many shards.
//!
//! All of them read one file, so that all of them do parts of the same bake; it holds hashes of what the bake reads, and a shard that
//! finds other content, or is another version of Lumel, refuses to start: its parts would be of another bake. Paths below the folder of
//! the plan, or of the scene, are kept relative to it, so that both may be mounted anywhere.

mod openjd;

use crate::added_light;
use crate::error::{Error, Result, Warnings};
use crate::inspect::{Estimate, estimate_of};
use crate::limits;
use crate::load;
use crate::pipeline::refuse_darkness;
use crate::progress::Progress;
use crate::report::Input;
use crate::settings::Settings;
use crate::work::{MOST_SHARDS, Shard};
use crate::write::output::Staging;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The version of the file's form.
const SCHEMA: u32 = 1;

/// The file's name in the folder of a plan, and that of the template beside it.
pub const PLAN_FILE: &str = "plan.json";
pub const TEMPLATE_FILE: &str = "template.yaml";

/// The cache and the output of a plan that says nothing else, within its folder.
const CACHE: &str = "cache";
const OUTPUT: &str = "baked";

/// Largest plan [bytes].
const MOST_BYTES: u64 = 16 << 20;

/// A bake in shards, with all paths as this process finds them.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where the plan is, or is to be.
    pub folder: PathBuf,
    pub scene: PathBuf,
    /// What the bake reads, the scene first.
    pub inputs: Vec<Input>,
    /// Without cache and shard.
    pub settings: Settings,
    pub cache: PathBuf,
    /// 1..=4096.
    pub shards: usize,
    pub estimate: Estimate,
}

/// The file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    schema: u32,
    /// Version of Lumel.
    lumel: String,
    /// Relative to the plan's folder, as the cache.
    scene: PathBuf,
    /// Relative to the scene's folder, as all paths in the settings.
    inputs: Vec<Input>,
    settings: Settings,
    cache: PathBuf,
    shards: usize,
    estimate: Estimate,
    commands: Commands,
}

/// What is to be run in the plan's folder, word by word.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Commands {
    shards: Vec<Vec<String>>,
    merge: Vec<String>,
}

/// What of the file tells whether the rest can be read.
#[derive(Deserialize)]
struct Head {
    schema: u32,
    lumel: String,
}

impl Plan {
    /// Lays out the bake of the scene file `scene` by `settings`, whose cache stands in `folder` unless they name one, for so many shards,
    /// 1..=4096, after everything was checked that a bake checks before its work begins. Nothing is written.
    ///
    /// # Errors
    /// Those of a bake; `Invalid` where the work can't be shared out.
    pub fn new(
        scene: &Path,
        folder: &Path,
        settings: &Settings,
        shards: usize,
        progress: &dyn Progress,
    ) -> Result<(Self, Warnings)> {
        let (scene, folder) = (absolute(scene)?, absolute(folder)?);
        let mut settings = settings.clone();
        for path in settings.paths_mut() {
            *path = absolute(path)?;
        }
        let cache = settings.cache.take().map_or_else(|| Ok(folder.join(CACHE)), |cache| absolute(&cache))?;
        Self::check(&settings, shards)?;
        progress.begin("load", 0);
        let mut loaded = load::load_with(&scene, &settings.load_options())?;
        added_light::add(&mut loaded, &settings)?;
        limits::check_scene(&loaded, &settings)?;
        refuse_darkness(&loaded, &settings)?;
        settings.probe_params(&loaded.scene)?;
        let mut inputs = vec![Input::new(scene.clone())];
        inputs.extend(loaded.inputs.iter().filter(|p| **p != scene).cloned().map(Input::new));
        // What a machine has of its own.
        settings.threads = None;
        settings.overwrite = false;
        let estimate = estimate_of(&loaded.scene, &settings);
        Ok((Self { folder, scene, inputs, settings, cache, shards, estimate }, loaded.warnings))
    }

    /// Refuses settings, and numbers of shards, with which the work can't be shared out.
    ///
    /// # Errors
    /// `Invalid`, naming the setting.
    pub fn check(settings: &Settings, shards: usize) -> Result<()> {
        if !(1..=MOST_SHARDS).contains(&shards) {
            return Err(Error::invalid("shards", format!("{shards} is out of range; allowed are 1 to {MOST_SHARDS}")));
        }
        let shard = Some(Shard { index: 0, count: shards, alone: false });
        Settings { cache: Some(PathBuf::from(CACHE)), shard, ..settings.clone() }.check()
    }

    /// Writes the plan and its template into its folder, which is made where it is missing.
    ///
    /// # Errors
    /// `Invalid` where the folder holds a file of that name that is no plan; `Io`.
    pub fn write(&self) -> Result<()> {
        let place = self.folder.join(PLAN_FILE);
        let is_free = |path: &Path| !path.exists();
        if !(is_free(&place) && is_free(&self.folder.join(TEMPLATE_FILE)) || head(&place).is_ok()) {
            let message =
                format!("holds a {PLAN_FILE} or {TEMPLATE_FILE} that is no plan of Lumel's; choose another folder");
            return Err(Error::invalid(self.folder.display(), message));
        }
        let text = serde_json::to_string_pretty(&self.form()).map_err(|e| Error::invalid(place.display(), e))?;
        let mut staging = Staging::new(&self.folder)?;
        for (file, text) in [(TEMPLATE_FILE, openjd::template(self)), (PLAN_FILE, text + "\n")] {
            let path = staging.path(file)?;
            std::fs::write(&path, text).map_err(|e| Error::io(&path, e))?;
        }
        staging.commit()
    }

    /// Reads the plan in the file `path`, of the scene where it was, or in the file `scene`.
    ///
    /// # Errors
    /// `Invalid` where it is no plan, another version's, or the scene is another by now; `Io`.
    pub fn read(path: &Path, scene: Option<&Path>) -> Result<Self> {
        let Head { schema, lumel } = head(path)?;
        let own = env!("CARGO_PKG_VERSION");
        if schema != SCHEMA || lumel != own {
            let message = format!(
                "was made by Lumel {lumel}, and this is {own}: plan the bake anew, by the version that all machines have"
            );
            return Err(Error::invalid(path.display(), message));
        }
        let form: Form = serde_json::from_slice(&bytes_of(path)?).map_err(|e| Error::invalid(path.display(), e))?;
        let folder = absolute(path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
        let scene = scene.map_or_else(|| Ok(folder.join(&form.scene)), absolute)?;
        let beside = scene.parent().unwrap_or(Path::new("")).to_path_buf();
        let Form { mut settings, mut inputs, cache, shards, estimate, .. } = form;
        settings.paths_mut().into_iter().for_each(|path| *path = beside.join(&*path));
        if let Some(first) = inputs.first_mut() {
            first.path = scene.clone();
        }
        inputs.iter_mut().for_each(|input| input.path = beside.join(&input.path));
        settings.check()?;
        let plan = Self { cache: folder.join(cache), folder, scene, inputs, settings, shards, estimate };
        plan.refuse_change(path)?;
        Ok(plan)
    }

    /// Where the bake is written to unless another folder is named.
    pub fn output(&self) -> PathBuf {
        self.folder.join(OUTPUT)
    }

    /// Refuses files that aren't what they were. What can't be read is left to the loader, which says whether it is needed.
    fn refuse_change(&self, path: &Path) -> Result<()> {
        for input in &self.inputs {
            let now = Input::new(input.path.clone());
            let is_other = now.sha256.is_some() && input.sha256.is_some() && now.sha256 != input.sha256;
            if is_other {
                let message = format!("is another file than when {} was made: plan the bake anew", path.display());
                return Err(Error::invalid(input.path.display(), message));
            }
        }
        Ok(())
    }

    fn form(&self) -> Form {
        let beside = self.scene.parent().unwrap_or(Path::new(""));
        let mut settings = self.settings.clone();
        settings.paths_mut().into_iter().for_each(|path| *path = below(beside, path));
        let input = |input: &Input| Input { path: below(beside, &input.path), sha256: input.sha256.clone() };
        let words = |words: &[&str]| words.iter().map(ToString::to_string).collect::<Vec<_>>();
        let shard = |k| words(&["lumel", "bake", "--plan", PLAN_FILE, "--shard", &format!("{k}/{}", self.shards)]);
        Form {
            schema: SCHEMA,
            lumel: env!("CARGO_PKG_VERSION").to_string(),
            scene: below(&self.folder, &self.scene),
            inputs: self.inputs.iter().map(input).collect(),
            settings,
            cache: below(&self.folder, &self.cache),
            shards: self.shards,
            estimate: self.estimate,
            commands: Commands {
                shards: (1..=self.shards).map(shard).collect(),
                merge: words(&["lumel", "merge", PLAN_FILE]),
            },
        }
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>> {
    let found = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if !found.is_file() || found.len() > MOST_BYTES {
        return Err(Error::invalid(path.display(), format!("is no plan: no file of up to {MOST_BYTES} bytes")));
    }
    std::fs::read(path).map_err(|e| Error::io(path, e))
}

/// The head of the plan in `path`.
fn head(path: &Path) -> Result<Head> {
    serde_json::from_slice(&bytes_of(path)?)
        .map_err(|e| Error::invalid(path.display(), format!("is no plan of a bake: {e}")))
}

fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).map_err(|e| Error::io(path, e))
}

/// `path` relative to `folder` where it lies below it.
fn below(folder: &Path, path: &Path) -> PathBuf {
    path.strip_prefix(folder).unwrap_or(path).to_path_buf()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the command line and files can say is what a plan gives back.
    #[test]
    fn settings_come_back_from_a_plan() {
        let text = r#"{
            "quality": "high", "time": 1.5, "animation": "walk", "variant": ["a", "b"], "purpose": ["render", "proxy"],
            "max-memory": "4G", "adaptive-density": 0.5, "density": 3.7, "pages": "free", "uv": "repack",
            "unwrapper": "uvunwrap", "normals": "geometric", "quantity": "irradiance", "for": "unity", "encoding": ["exr", "ktx2-half"],
            "caustics": true, "denoise": "builtin", "seams": "surface", "gutter": "padding", "layers": ["ao", "light-groups"],
            "directional": "sh", "probes": 1.5, "error": "2%", "sun": [40.1, 180, 80000], "sky": "clear,2.5",
            "environment": "sky.exr", "gltf": ["engine"], "gltf-lightmap-ext": "moz", "mesh": "given", "vertex-error": 3,
            "lights": "mark", "bake-lights": "indirect", "projectors": [{"light": "a*", "picture": "p.png", "fov": 30}],
            "medium": [{"scattering": [0.1, 0.1, 0.1], "grid": "fog.vdb"}],
            "density-volumes": [{"center": [0, 1.5, 0], "radius": 4, "factor": 2, "falloff": 6}],
            "objects": [{"path": "Trees/**", "receives": false}], "materials": [{"name": "Glow*", "emission-scale": 0.5}],
            "lamps": [{"name": "/World/Moon", "skip": true}, {"name": "Torch*", "bake": "indirect", "group": "fire"}]
        }"#;
        let settings: Settings = serde_json::from_str(text).unwrap();
        for settings in [settings, Settings::default()] {
            let written = serde_json::to_string(&settings).unwrap();
            let read: Settings = serde_json::from_str(&written).unwrap();
            assert_eq!(format!("{read:?}"), format!("{settings:?}"), "{written}");
        }
    }

    #[test]
    fn paths_below_a_folder_move_with_it() {
        assert_eq!(below(Path::new("/a/job"), Path::new("/a/job/cache")), Path::new("cache"));
        assert_eq!(below(Path::new("/a/job"), Path::new("/a/jobs")), Path::new("/a/jobs"));
        assert_eq!(Path::new("/other").join(below(Path::new("/a"), Path::new("/b"))), Path::new("/b"));
    }
}
