//! From what was typed to what it means: `lumel.toml`, the command line over it, the library's defaults below both.
//!
//! Layers are merged as TOML tables and read by serde once, so that an absent flag never overrides a key, and the file and
//! the command line share one list of names and values.

use super::args::{BakeArgs, FormFactorArgs, InspectArgs, RenderArgs, SceneArgs, UnwrapArgs};
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
const PATH_KEYS: [&str; 4] = ["environment", "dump-stages", "watch", "confine"];

/// The same in arrays of tables.
const TABLE_PATH_KEYS: [(&str, &str); 2] = [("projectors", "picture"), ("medium", "grid")];

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
        // Pictures are taken by paths unless something else is asked for here: a file's method is the bake's.
        let method = [("method".to_string(), Value::from("path"))].into_iter().collect();
        let groups = [method, table(&self.scene)?, table(&self.walk)?, table(&self.light)?, table(&self.running)?];
        Ok(groups.into_iter().flatten().collect())
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
    let beside = scene.scene.with_file_name(FILE_NAME);
    let file = scene.config.clone().or_else(|| beside.is_file().then_some(beside));
    let lower = match &file {
        Some(path) => read(path).map_err(Failure::Usage)?,
        None => Table::new(),
    };
    let typed = args.table().map_err(Failure::Usage)?;
    if let (Some(path), Some(folder)) = (&file, &scene.limits.confine) {
        confine(path, &lower, folder).map_err(Failure::Usage)?;
    }
    let settings = settle(lower, typed).map_err(Failure::Usage)?;
    Ok(Resolved { settings, file })
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
    for (key, others) in REPLACES {
        if typed.contains_key(key) {
            for other in others {
                lower.remove(*other);
            }
        }
    }
    lower.extend(typed);
    choose_for_engine(&mut lower)?;
    let settings: Settings =
        Value::Table(lower).try_into().map_err(|e: toml::de::Error| Error::invalid("settings", e.message()))?;
    settings.check().map_err(|e| match e {
        Error::Invalid { place, message } => Error::invalid(format!("--{place}"), message),
        e => e,
    })?;
    Ok(settings)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Args, Command};
    use clap::Parser;
    use lumel::post::Quantity;
    use lumel::settings::{Quality, SkySetting};
    use lumel::unwrap::UvMode;
    use lumel::write::GltfProfile;
    use lumel::write::encode::Encoding;
    use lumel::write::engines::LightmapExtension;

    fn typed(line: &str) -> Table {
        let args =
            Args::try_parse_from(["lumel", "bake", "room.glb"].into_iter().chain(line.split_whitespace())).unwrap();
        let Command::Bake(bake) = args.command else { panic!("not a bake") };
        bake.table().unwrap()
    }

    fn layered(file: &str, line: &str) -> Settings {
        settle(parse(file, Path::new("lumel.toml")).unwrap(), typed(line)).unwrap()
    }

    fn complaint(file: &str) -> String {
        parse(file, Path::new("a/lumel.toml")).unwrap_err().to_string()
    }

    #[test]
    fn a_mistyped_key_is_told_its_nearest() {
        assert_eq!(complaint("sampels = 3\n"), "a/lumel.toml:1: unknown field `sampels`: did you mean `samples`?");
        assert!(complaint("wxyz = 3\n").contains("expected one of"), "{}", complaint("wxyz = 3\n"));
        assert_eq!(complaint("quality = \"hihg\"\n").split(": ").last(), Some("did you mean `high`?"));
        assert_eq!((edits("kitten", "sitting"), edits("", "abc"), edits("same", "same")), (3, 3, 0));
    }

    #[test]
    fn absent_flags_are_absent_keys() {
        assert!(typed("").is_empty());
    }

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_the_defaults() {
        let file = "quality = \"high\"\nseed = 7\nfloat = true\nmax-bounces = 3\nuv = \"new\"\n";
        let s = layered(file, "--seed 9 --float=false");
        assert_eq!((s.quality, s.seed, s.float, s.max_bounces, s.uv), (Quality::High, 9, false, Some(3), UvMode::New));
        assert_eq!(s.samples, None);
        let s = layered(file, "");
        assert_eq!((s.seed, s.float), (7, true));
    }

    #[test]
    fn every_setting_has_its_option() {
        let line = "--quality draft --resolution 256 --max-pages 2 --padding 3 --mips 2 --align 4 --min-chart 2 --unwrapper uvunwrap --uv keep --uv-name st1 --normals geometric \
                    --quantity irradiance --float --max-bounces 4 --seed 5 --threads 2 --sky 1,2,0.1 --sun 40,180,8e4 \
                    --gltf engine,vertex --vertex-colors u16 --lights remove --bake-lights indirect --ao-distance 2 --dump-stages d --overwrite --solver progressive --form-factors hemicube --hemicube 32 \
                    --elements 100 --iterations 7 --overshoot=false --ambient=false --caustics=false --gather auto --directional sh --probes 2 --layers direct,ao --watch w \
                    --watch-every 3 --variant /a:b=c --subdivide 1 --purpose proxy --confine d \
                    --strict --max-texture 9 --max-texels 9 --max-memory 4G --for bevy --encoding exr,ktx2-half \
                    --gltf-lightmap-ext moz --adaptive-density --denoise oidn --oidn-library f --seams surface --gutter padding";
        let mut keys: Vec<String> = typed(line).keys().cloned().collect();
        keys.extend(
            typed(
                "--density 2 --page-size 512 --pages free --environment e.hdr --method path --link-error 1e-6 --samples 64 \
                   --error 2% --time-budget 5 --surfaces diffuse --time 1.5 --animation walk --mesh adaptive --vertex-error 3% --max-triangles 9",
            )
            .keys()
            .cloned(),
        );
        keys.sort();
        keys.dedup();
        // Not through TOML: it has no null for a value that is absent.
        let all = serde_json::to_value(Settings::default()).unwrap();
        let mut expected: Vec<String> = all.as_object().unwrap().keys().cloned().collect();
        expected.sort();
        assert_eq!(keys, expected);
        let s = layered("", line);
        assert_eq!(s.sky, Some(SkySetting::Constant([1.0, 2.0, 0.1])));
        assert_eq!(s.gltf.as_deref(), Some([GltfProfile::Engine, GltfProfile::Vertex].as_slice()));
        assert_eq!(s.vertex_colors, lumel::write::VertexColors::U16);
        assert_eq!(s.threads, Some(2));
        assert_eq!((s.max_memory, s.strict), (Some(4 << 30), true));
    }

    #[test]
    fn an_engine_chooses_what_is_not_given() {
        let s = layered("", "--for needle");
        assert_eq!((s.quantity, s.encodings()), (Quantity::Irradiance, vec![Encoding::RgbmSrgb]));
        assert_eq!(s.gltf_lightmap_ext, Some(LightmapExtension::Needle));
        let s = layered("for = \"bevy\"", "--quantity irradiance");
        assert_eq!((s.quantity, s.encodings()), (Quantity::Irradiance, vec![Encoding::Ktx2Half]));
        let s = layered("quantity = \"irradiance\"\nencoding = [\"hdr\"]", "--for unity");
        assert_eq!((s.quantity, s.encodings()), (Quantity::Outgoing, vec![Encoding::Exr]));
        let s = layered("", "--gltf-lightmap-ext moz");
        assert_eq!(s.encodings(), [Encoding::Exr, Encoding::Hdr]);
    }

    #[test]
    fn an_option_takes_the_place_of_the_files_alternative() {
        let s = layered("density = 32.0\npage-size = 512", "--resolution 256");
        assert_eq!((s.resolution, s.density, s.page_size), (Some(256), None, None));
        let s = layered("solver = \"jacobi\"\niterations = 4\nwatch = \"w\"", "--method path");
        assert_eq!((s.solver, s.iterations, s.watch), (lumel::solve::Solver::Auto, None, None));
        let s = layered("overshoot = true\niterations = 4", "--solver jacobi");
        assert_eq!((s.overshoot, s.iterations), (false, Some(4)));
        let s = layered("sky = \"clear,2\"\nsun = [30.0, 90.0, 50000.0]", "");
        assert_eq!((s.sky, s.sun), (Some(SkySetting::Clear { turbidity: 2.0 }), Some([30.0, 90.0, 5e4])));
        assert!(complaint("sky = \"clear\"").contains("sun"));
        let s = layered("environment = \"sky.hdr\"", "--sky 1,1,1");
        assert!(s.environment.is_none() && s.sky.is_some());
    }

    #[test]
    fn a_mistake_in_the_file_names_file_line_and_key() {
        let e = complaint("seed = 1\nqualty = \"high\"\n");
        assert!(e.starts_with("a/lumel.toml:2: ") && e.contains("qualty"), "{e}");
        let e = complaint("# a comment\n\nresolution = \"big\"\n");
        assert!(e.starts_with("a/lumel.toml:3: resolution: "), "{e}");
        let e = complaint("seed = 1\nresolution = 4\n");
        assert!(e.starts_with("a/lumel.toml:2: resolution: 4 is out of range"), "{e}");
        let e = complaint("sky = [\n  1.0,\n  \"x\",\n  1.0]\n");
        assert!(e.contains("sky"), "{e}");
        let e = complaint("seed = = 1\n");
        assert!(e.starts_with("a/lumel.toml:1"), "{e}");
    }

    #[test]
    fn out_of_range_options_name_the_option() {
        let e = settle(Table::new(), typed("--resolution 4")).unwrap_err().to_string();
        assert!(e.starts_with("--resolution: 4 is out of range"), "{e}");
    }

    #[test]
    fn what_would_do_nothing_is_refused() {
        let e = settle(Table::new(), typed("--gltf engine --vertex-colors u8")).unwrap_err().to_string();
        assert!(e.starts_with("--vertex-colors: is for the GLB vertex"), "{e}");
        assert!(settle(Table::new(), typed("--gltf engine --vertex-colors float")).is_ok());
    }

    #[test]
    fn paths_in_the_file_are_relative_to_it() {
        let dir = std::env::temp_dir().join(format!("lumel-config-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let path = dir.join("lumel.toml");
        let projector = "[[projectors]]\nlight = \"*\"\npicture = \"slides/a.png\"\nfov = 30\n";
        let medium = "[[medium]]\ngrid = \"smoke.npz\"\nsigma_s = [1, 2, 3]\n";
        std::fs::write(&path, format!("environment = \"sky/day.hdr\"\n{projector}{medium}")).unwrap();
        let settings = settle(read(&path).unwrap(), typed("")).unwrap();
        assert_eq!(settings.environment, Some(dir.join("sky/day.hdr")));
        assert_eq!(settings.projectors[0].picture, dir.join("slides/a.png"));
        assert_eq!(settings.projectors[0].fov, Some(30.0));
        assert_eq!(settings.media[0].grid, Some(dir.join("smoke.npz")));
        std::fs::remove_dir_all(dir).unwrap();
    }
}
