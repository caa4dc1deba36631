//! The bake in an output folder, as its report tells of it: where its scene is now, and its settings as a table that others are laid
//! over.

use super::config::{PATH_KEYS, TABLE_PATH_KEYS};
use lumel::report::Input;
use lumel::settings::Settings;
use lumel::{Error, Result};
use serde_json::Value as Json;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The largest report that is read [bytes].
const MOST_BYTES: u64 = 1 << 30;

/// Keys about how a bake ran, not what came of it.
const OF_THE_RUN: [&str; 6] = ["threads", "overwrite", "dump-stages", "watch", "watch-every", "only"];

/// An earlier bake.
#[derive(Debug)]
pub struct Earlier {
    /// Its output folder.
    pub folder: PathBuf,
    /// The scene file, where it is now.
    pub scene: PathBuf,
    /// Whether that is not, to the byte, what was baked.
    pub has_changed: bool,
    report: Json,
    /// What relative paths of the report are relative to.
    base: PathBuf,
}

impl Earlier {
    /// The bake whose output folder, report or GLB `baked` is; `scene` is where its scene is now, if it has moved.
    ///
    /// # Errors
    /// `Invalid` where there is no bake, or its scene isn't found; `Io`.
    pub fn read(baked: &Path, scene: Option<&Path>) -> Result<Self> {
        let found = std::fs::metadata(baked).map_err(|e| Error::io(baked, e))?;
        let beside = |file: &Path| match file.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let folder = if found.is_dir() { baked.to_path_buf() } else { beside(baked) };
        let path = folder.join("report.json");
        let no_bake = || Error::invalid(baked.display(), "is no output folder of a bake: no report.json tells of one");
        let size = std::fs::metadata(&path).map_err(|_| no_bake())?.len();
        let text = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
        let report: Json =
            if size <= MOST_BYTES { serde_json::from_slice(&text).unwrap_or_default() } else { Json::Null };
        let input = report.pointer("/inputs/0/path").and_then(Json::as_str).map(PathBuf::from).ok_or_else(no_bake)?;
        let hash = report.pointer("/inputs/0/sha256").and_then(Json::as_str);
        let base = base_of(&input, hash, &folder);
        let (scene, base) = match (scene, base) {
            (Some(scene), base) => (scene.to_path_buf(), base.unwrap_or_default()),
            (None, Some(base)) => (base.join(&input), base),
            (None, None) => {
                let message = "the scene of this bake isn't where it was; say where it is with --scene";
                return Err(Error::invalid(input.display(), message));
            }
        };
        let has_changed = Input::new(scene.clone()).sha256.as_deref() != hash;
        Ok(Self { folder, scene, has_changed, report, base })
    }

    /// The settings of the bake itself, whatever light it was given since.
    ///
    /// # Errors
    /// `Invalid` where the report tells of none.
    pub fn settings_of_bake(&self) -> Result<Table> {
        self.table(if self.report["relit"].is_object() { "relit" } else { "settings" })
    }

    /// The settings of the pages as they are.
    ///
    /// # Errors
    /// As [`settings_of_bake`](Self::settings_of_bake).
    pub fn settings(&self) -> Result<Table> {
        self.table("settings")
    }

    fn table(&self, key: &str) -> Result<Table> {
        let mut settings = self.report[key].clone();
        drop_nulls(&mut settings);
        let table = Table::try_from(&settings).ok().filter(|table| !table.is_empty());
        let mut table = table.ok_or_else(|| {
            Error::invalid(self.folder.join("report.json").display(), "tells no settings; bake the scene anew")
        })?;
        OF_THE_RUN.iter().for_each(|key| drop(table.remove(*key)));
        rebase(&mut table, &self.base);
        Ok(table)
    }

    /// The command line of the bake, as far as options tell it.
    ///
    /// # Errors
    /// As [`settings_of_bake`](Self::settings_of_bake).
    pub fn command(&self) -> Result<String> {
        let mut usual = serde_json::to_value(Settings::default()).unwrap_or_default();
        drop_nulls(&mut usual);
        let usual = Table::try_from(&usual).unwrap_or_default();
        let mut command = format!("lumel bake {} -o {}", self.scene.display(), self.folder.display());
        let (mut of_tables, table) = (Vec::new(), self.settings_of_bake()?);
        for (key, value) in table.iter().filter(|(key, value)| usual.get(*key) != Some(*value)) {
            match option(value) {
                Some(text) => command += &format!(" --{key}{text}"),
                None => of_tables.push(format!("[[{key}]]")),
            }
        }
        if !of_tables.is_empty() {
            command += &format!(" --config FILE, a file with {}", of_tables.join(", "));
        }
        Ok(command)
    }
}

/// What follows the name of an option that has this value; `None` of tables.
fn option(value: &Value) -> Option<String> {
    let plain = |value: &Value| match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(_) | Value::Float(_) => Some(value.to_string()),
        _ => None,
    };
    match value {
        Value::Boolean(true) => Some(String::new()),
        Value::Boolean(false) => Some("=false".into()),
        Value::Array(list) => Some(format!(" {}", list.iter().map(plain).collect::<Option<Vec<_>>>()?.join(","))),
        value => plain(value).map(|text| format!(" {text}")),
    }
}

/// The folder that `path`, as the report of the bake in `folder` names it, is relative to: the current one, or else one that `folder` lies
/// in and where what was baked still is, by its hash. `None` where it is in none of them.
fn base_of(path: &Path, hash: Option<&str>, folder: &Path) -> Option<PathBuf> {
    let folder = folder.canonicalize().ok()?;
    // The GLB of a bake has the name of its scene.
    let is_result = |file: &Path| file.canonicalize().is_ok_and(|file| file.parent() == Some(&*folder));
    if path.is_file() && !(path.is_relative() && is_result(path)) {
        return Some(PathBuf::new());
    }
    let is_it = |base: &&Path| {
        let file = base.join(path);
        file.is_file() && hash.is_some() && Input::new(file).sha256.as_deref() == hash
    };
    folder.ancestors().skip(1).filter(|_| path.is_relative()).find(is_it).map(Path::to_path_buf)
}

/// Makes relative paths relative to the current folder that are so to `base`.
fn rebase(table: &mut Table, base: &Path) {
    let join = |value: &mut Value| {
        if let Value::String(path) = value {
            *path = base.join(&*path).to_string_lossy().into_owned();
        }
    };
    for key in PATH_KEYS {
        table.get_mut(key).into_iter().for_each(join);
    }
    for (tables, key) in TABLE_PATH_KEYS {
        let entries = table.get_mut(tables).and_then(Value::as_array_mut).into_iter().flatten();
        entries.filter_map(|entry| entry.get_mut(key)).for_each(join);
    }
}

/// Takes out what is null: TOML has no word for it.
fn drop_nulls(value: &mut Json) {
    match value {
        Json::Object(map) => {
            map.retain(|_, value| !value.is_null());
            map.values_mut().for_each(drop_nulls);
        }
        Json::Array(list) => list.iter_mut().for_each(drop_nulls),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RICH: &str = "quality = \"high\"\nerror = \"1.5%\"\nsky = \"clear,2.5\"\nsun = [40.0, 180.0, 8e4]\nresolution = 256\n\
        layers = [\"light-groups\", \"ao\"]\nfloat = true\nprobes = 1.5\n\
        [[lamps]]\nname = \"a\"\nadd = \"spot\"\nangle = 30.0\nposition = [1.0, 2.0, 3.0]\ntemperature = 3000.0\n\
        [[materials]]\nname = \"b\"\nemission = [1.0, 2.0, 3.0]\n\
        [[medium]]\nscattering = [0.1, 0.1, 0.1]\n\
        [[density-volumes]]\ncenter = [0.0, 1.0, 0.0]\nradius = 2.0\nfactor = 2.0\n";

    fn written(settings: &Settings) -> Table {
        let mut json = serde_json::to_value(settings).unwrap();
        drop_nulls(&mut json);
        Table::try_from(&json).unwrap()
    }

    #[test]
    fn settings_of_a_report_are_read_again() {
        for text in ["", RICH] {
            let settings: Settings = toml::from_str(text).unwrap();
            let again: Settings = Value::Table(written(&settings)).try_into().unwrap();
            assert_eq!(serde_json::to_value(&settings).unwrap(), serde_json::to_value(&again).unwrap());
        }
    }

    #[test]
    fn the_command_line_is_told() {
        let settings: Settings = toml::from_str(RICH).unwrap();
        let report = serde_json::json!({ "settings": settings });
        let [folder, scene] = ["out", "room.glb"].map(PathBuf::from);
        let earlier = Earlier { folder, scene, has_changed: false, report, base: PathBuf::new() };
        let command = earlier.command().unwrap();
        let told =
            ["lumel bake room.glb -o out", "--float", "--sky clear,2.5", "--layers light-groups,ao", "[[lamps]]"];
        told.iter().for_each(|part| assert!(command.contains(part), "{part}: {command}"));
        assert!(!command.contains("--seed"), "{command}");
    }
}
