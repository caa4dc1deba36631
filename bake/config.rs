//! From what was typed to what it means: `lumel.toml`, the command line over it, the library's defaults below both.
//!
//! Layers are merged as TOML tables and read by serde once, so that an absent flag never overrides a key, and the file and
//! the command line share one list of names and values.

#[cfg(test)]
mod tests;

use super::args::{BakeArgs, FormFactorArgs, InspectArgs, MixArgs, RelightArgs, RenderArgs, SceneArgs, UnwrapArgs};
use super::failure::Failure;
use lumel::settings::Settings;
use lumel::write::engines::Engine;
use lumel::{Error, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Name of the settings file that is read where it lies beside the scene.
const FILE_NAME: &str = "lumel.toml";

/// Keys that hold paths; relative ones are relative to the file in which they stand.
pub const PATH_KEYS: [&str; 5] = ["environment", "dump-stages", "watch", "confine", "cache"];

/// The same in arrays of tables.
pub const TABLE_PATH_KEYS: [(&str, &str); 2] = [("projectors", "picture"), ("medium", "grid")];

/// Arrays of tables of which each says something on its own.
const EDIT_KEYS: [&str; 5] = ["objects", "materials", "lamps", "projectors", "medium"];

/// Largest settings file [bytes].
const MOST_BYTES: u64 = 1 << 20;

/// Keys about the radiosity solver.
const SOLVER_KEYS: [&str; 11] = [
    "solver",
    "form-factors",
    "hemicube",
    "elements",
    "link-error",
    "iterations",
    "overshoot",
    "ambient",
    "gather",
    "watch",
    "watch-every",
];

/// Keys that take the place of others: `--resolution` on the command line drops `density` of the file, and so on.
const REPLACES: [(&str, &[&str]); 9] = [
    ("for", &["quantity", "encoding", "gltf-lightmap-ext"]),
    ("method", &SOLVER_KEYS),
    ("solver", &["overshoot", "ambient", "link-error"]),
    ("form-factors", &["hemicube"]),
    ("resolution", &["density", "page-size"]),
    ("density", &["resolution"]),
    ("page-size", &["resolution"]),
    ("sky", &["environment"]),
    ("environment", &["sky"]),
];

/// Keys of a file that say something of a picture, too: what the scene and its light are, and how light is followed. The others
/// are about bakes.
const PICTURE_KEYS: [&str; 21] = [
    "time",
    "animation",
    "variant",
    "subdivide",
    "purpose",
    "confine",
    "strict",
    "max-texture",
    "max-memory",
    "sky",
    "sun",
    "environment",
    "surfaces",
    "max-bounces",
    "seed",
    "threads",
    "projectors",
    "medium",
    "objects",
    "materials",
    "lamps",
];

/// Resolved settings, and the files that they came from.
#[derive(Debug)]
pub struct Resolved {
    pub settings: Settings,
    /// The config file that was read.
    pub file: Option<PathBuf>,
}

/// The command lines that carry settings.
pub trait Typed {
    /// The scene and its config.
    fn scene(&self) -> &SceneArgs;
    /// What was typed, with the keys of `lumel.toml`.
    fn table(&self) -> Result<Table>;
    /// The keys of a file that mean something to the command; none: all.
    fn keys(&self) -> Option<&'static [&'static str]> {
        None
    }
}

impl Typed for BakeArgs {
    fn scene(&self) -> &SceneArgs {
        &self.scene
    }
    fn table(&self) -> Result<Table> {
        let groups = [
            table(&self.scene)?,
            table(&self.texels)?,
            table(&self.adaptive)?,
            table(&self.uvs)?,
            table(&self.light)?,
            table(&self.solver)?,
            table(&self.effort)?,
            table(&self.results)?,
            table(&self.vertices)?,
            table(&self.running)?,
            table(&self.cache)?,
            table(&self.only)?,
            table(&self.verify)?,
        ];
        Ok(groups.into_iter().flatten().collect())
    }
}

impl Typed for UnwrapArgs {
    fn scene(&self) -> &SceneArgs {
        &self.scene
    }
    fn table(&self) -> Result<Table> {
        let groups = [
            table(&self.scene)?,
            table(&self.texels)?,
            table(&self.adaptive)?,
            table(&self.uvs)?,
            table(&self.running)?,
        ];
        Ok(groups.into_iter().flatten().collect())
    }
}

impl Typed for InspectArgs {
    fn scene(&self) -> &SceneArgs {
        &self.scene
    }
    fn table(&self) -> Result<Table> {
        Ok([table(&self.scene)?, table(&self.texels)?, table(&self.light)?].into_iter().flatten().collect())
    }
}

impl Typed for FormFactorArgs {
    fn scene(&self) -> &SceneArgs {
        &self.scene
    }
    fn table(&self) -> Result<Table> {
        // A file that says how a bake solves its light says nothing against finding form factors.
        let solver = [("method", "radiosity"), ("solver", "auto")];
        let solver = solver.map(|(key, value)| (key.to_string(), Value::from(value)));
        let groups = [
            solver.into_iter().collect(),
            table(&self.scene)?,
            table(&self.factors)?,
            table(&self.texels)?,
            table(&self.uvs)?,
            table(&self.running)?,
        ];
        Ok(groups.into_iter().flatten().collect())
    }
}

impl Typed for RenderArgs {
    fn scene(&self) -> &SceneArgs {
        &self.scene
    }
    fn table(&self) -> Result<Table> {
        // Pictures are taken by paths unless something else is asked for.
        let method = [("method".to_string(), Value::from("path"))].into_iter().collect();
        let groups = [method, table(&self.scene)?, table(&self.walk)?, table(&self.light)?, table(&self.running)?];
        Ok(groups.into_iter().flatten().collect())
    }
    fn keys(&self) -> Option<&'static [&'static str]> {
        Some(&PICTURE_KEYS)
    }
}

impl RelightArgs {
    /// What was typed, with the keys of `lumel.toml`.
    pub fn table(&self) -> Result<Table> {
        let groups = [
            table(&self.light)?,
            table(&self.results)?,
            table(&self.running)?,
            table(&self.cache)?,
            table(&self.verify)?,
        ];
        Ok(groups.into_iter().flatten().collect())
    }
}

impl MixArgs {
    /// What was typed, with the keys of `lumel.toml`.
    pub fn table(&self) -> Result<Table> {
        Ok([table(&self.running)?, table(&self.cache)?].into_iter().flatten().collect())
    }
}

/// An options group as a table; absent options are absent keys.
fn table(group: &impl Serialize) -> Result<Table> {
    Table::try_from(group).map_err(|e| Error::invalid("command line", e))
}

/// The settings of a run.
///
/// # Errors
/// `Usage`, naming file, line and key where the config file is wrong, else the option.
pub fn resolve(args: &impl Typed) -> std::result::Result<Resolved, Failure> {
    let scene = args.scene();
    let beside = scene.path().with_file_name(FILE_NAME);
    let file = scene.config.clone().or_else(|| beside.is_file().then_some(beside));
    let mut lower = match &file {
        Some(path) => read(path).map_err(Failure::Usage)?,
        None => Table::new(),
    };
    if let Some(keys) = args.keys() {
        lower.retain(|key, _| keys.contains(&key));
    }
    let typed = args.table().map_err(Failure::Usage)?;
    if let (Some(path), Some(folder)) = (&file, &scene.limits.confine) {
        confine(path, &lower, folder).map_err(Failure::Usage)?;
    }
    let settings = settle(lower, typed).map_err(Failure::Usage)?;
    Ok(Resolved { settings, file })
}

/// The settings that a process has of its own, and keys that say them.
const OWN_KEYS: [&str; 6] = ["cache", "cache-limit", "checkpoint", "shard", "threads", "overwrite"];

/// What is typed beside a plan: where and how the work is done on this machine.
///
/// # Errors
/// `Usage` where something else is typed, which is the plan's to say, or a value is wrong.
pub fn beside_plan(args: &BakeArgs) -> std::result::Result<Settings, Failure> {
    let typed = args.table().map_err(Failure::Usage)?;
    let config = args.scene.config.as_ref().map(|_| "config");
    if let Some(key) = typed.keys().map(String::as_str).chain(config).find(|key| !OWN_KEYS.contains(key)) {
        let message = "is the plan's to say; leave it out, or plan the bake anew";
        return Err(Failure::Usage(Error::invalid(format!("--{key}"), message)));
    }
    let own = Value::Table(typed).try_into::<Settings>();
    own.map_err(|e| Failure::Usage(Error::invalid("settings", e.message())))
}

/// The settings `baked` of an earlier bake with a config file and what was typed over them. Tables of edits (`[[lamps]]` and so on) of
/// the file come after those of the bake.
///
/// # Errors
/// As [`resolve`].
pub fn resolve_over(baked: Table, file: Option<&Path>, typed: Table) -> std::result::Result<Resolved, Failure> {
    let config = file.map_or_else(|| Ok(Table::new()), read).map_err(Failure::Usage)?;
    let settings = settle(laid_over(baked, config), typed).map_err(Failure::Usage)?;
    Ok(Resolved { settings, file: file.map(Path::to_path_buf) })
}

/// `upper` laid over `lower`; arrays of tables are joined.
fn laid_over(mut lower: Table, mut upper: Table) -> Table {
    replace(&mut lower, &upper);
    for key in EDIT_KEYS {
        if let (Some(Value::Array(below)), Some(Value::Array(above))) = (lower.get(key), upper.get_mut(key)) {
            above.splice(0..0, below.iter().cloned());
        }
    }
    lower.extend(upper);
    lower
}

/// Takes out what `upper` takes the place of.
fn replace(lower: &mut Table, upper: &Table) {
    for (_, others) in REPLACES.iter().filter(|(key, _)| upper.contains_key(*key)) {
        others.iter().for_each(|other| drop(lower.remove(*other)));
    }
}

/// Refuses a config file that lies outside of `folder`, or names paths there: it may have come with the scene, and says
/// nothing about what it is confined to.
fn confine(path: &Path, table: &Table, folder: &Path) -> Result<()> {
    let root = folder.canonicalize().map_err(|e| Error::io(folder, e))?;
    let tables = |key: &str| table.get(key).and_then(Value::as_array).into_iter().flatten();
    let files = TABLE_PATH_KEYS.into_iter().flat_map(|(table, key)| tables(table).filter_map(move |t| t.get(key)));
    let own = PATH_KEYS.iter().filter(|key| **key != "confine").filter_map(|key| table.get(*key));
    let named = own.chain(files).filter_map(Value::as_str).map(Path::new);
    for named in named.chain([path]) {
        // What isn't there yet lies where its closest folder does.
        let there = named.ancestors().find_map(|p| if p.as_os_str().is_empty() { None } else { p.canonicalize().ok() });
        let climbs = named.components().any(|c| c == std::path::Component::ParentDir) && !named.exists();
        if climbs || !there.is_some_and(|p| p.starts_with(&root)) {
            let message = format!("names {}, which lies outside of {} (--confine)", named.display(), folder.display());
            return Err(Error::invalid(path.display(), message));
        }
    }
    Ok(())
}

/// The text of a config file.
fn text_of(path: &Path) -> Result<String> {
    let found = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if !found.is_file() || found.len() > MOST_BYTES {
        return Err(Error::invalid(path.display(), format!("is no settings file of up to {MOST_BYTES} bytes")));
    }
    std::fs::read_to_string(path).map_err(|e| Error::io(path, e))
}

/// Reads and checks a config file on its own, so that a mistake in it is found at its line.
fn read(path: &Path) -> Result<Table> {
    let text = text_of(path)?;
    let mut table = parse(&text, path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    for key in PATH_KEYS {
        if let Some(Value::String(p)) = table.get_mut(key) {
            *p = folder.join(&*p).to_string_lossy().into_owned();
        }
    }
    for (tables, key) in TABLE_PATH_KEYS {
        for entry in table.get_mut(tables).and_then(Value::as_array_mut).into_iter().flatten() {
            if let Some(Value::String(p)) = entry.get_mut(key) {
                *p = folder.join(&*p).to_string_lossy().into_owned();
            }
        }
    }
    Ok(table)
}

/// A config file's text as a table with known keys, and values of the right kind and range. `path` is for messages.
fn parse(text: &str, path: &Path) -> Result<Table> {
    let at = |span: Option<std::ops::Range<usize>>, e: &str| {
        let e = &suggested(e);
        let offset = span.map_or(0, |s| s.start).min(text.len());
        let (line, key) = line_and_key(text, offset);
        let place = format!("{}:{line}", path.display());
        match key {
            Some(key) if !e.contains(&format!("`{key}`")) => Error::invalid(format!("{place}: {key}"), e),
            _ => Error::invalid(place, e),
        }
    };
    let settings: Settings = toml::from_str(text).map_err(|e| at(e.span(), e.message()))?;
    if let Err(e) = settings.check() {
        // Its place is the key.
        if let Error::Invalid { place: key, message } = &e {
            let line = text.lines().position(|l| key_of(l) == Some(key)).map_or(1, |i| i + 1);
            return Err(Error::invalid(format!("{}:{line}: {key}", path.display()), message));
        }
        return Err(e);
    }
    toml::from_str(text).map_err(|e| at(e.span(), e.message()))
}

/// `message` about an unknown key or value, with the nearest of the known ones in the place of all of them where one is near.
fn suggested(message: &str) -> String {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let [unknown, known @ ..] = &names[..] else { return message.to_string() };
    let is_list = message.starts_with("unknown ") && !known.is_empty();
    let Some(nearest) = known.iter().min_by_key(|name| edits(unknown, name)).filter(|_| is_list) else {
        return message.to_string();
    };
    if edits(unknown, nearest) > unknown.len().div_ceil(2).min(3) {
        return message.to_string();
    }
    let what = message.split('`').next().unwrap_or_default();
    format!("{what}`{unknown}`: did you mean `{nearest}`?")
}

/// Letters to insert, take out or replace until `a` is `b` (Levenshtein 1966).
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut above = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = above + usize::from(x != *y);
            above = row[j + 1];
            row[j + 1] = replaced.min(above + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// The number of the line at byte `offset`, from 1, and the key that is set there or begins above it.
fn line_and_key(text: &str, offset: usize) -> (usize, Option<&str>) {
    // Bytes: an offset need not lie between two characters.
    let line = text.as_bytes()[..offset].iter().filter(|&&b| b == b'\n').count() + 1;
    let key = text.lines().take(line).collect::<Vec<_>>().into_iter().rev().find_map(key_of);
    (line, key)
}

/// The key that a line sets, where it sets one.
fn key_of(line: &str) -> Option<&str> {
    let key = line.split_once('=')?.0.trim().trim_matches('"');
    (!key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')).then_some(key)
}

/// Lays `typed` over `lower` and reads the result.
fn settle(mut lower: Table, typed: Table) -> Result<Settings> {
    replace(&mut lower, &typed);
    lower.extend(typed);
    choose_for_engine(&mut lower)?;
    let settings = settings(lower)?;
    settings.check().map_err(|e| match e {
        Error::Invalid { place, message } => Error::invalid(format!("--{place}"), message),
        e => e,
    })?;
    Ok(settings)
}

/// A table as settings, whatever their range.
///
/// # Errors
/// `Invalid` where it is none.
pub fn settings(table: Table) -> Result<Settings> {
    Value::Table(table).try_into().map_err(|e: toml::de::Error| Error::invalid("settings", e.message()))
}

/// Fills in what the engine of `for` wants, where nothing else is said.
fn choose_for_engine(table: &mut Table) -> Result<()> {
    let Some(name) = table.get("for") else { return Ok(()) };
    let engine: Engine = name.clone().try_into().map_err(|e: toml::de::Error| Error::invalid("for", e.message()))?;
    let mut choose = |key: &str, value: Value| {
        table.entry(key).or_insert(value);
    };
    choose("quantity", engine.quantity().name().into());
    choose("encoding", vec![engine.encoding().name()].into());
    if let Some(extension) = engine.lightmap_extension() {
        choose("gltf-lightmap-ext", extension.name().into());
    }
    Ok(())
}
