//! The layer's metadata: what the input's root layer says about the stage, and what we say about the bake.
//!
//! A stage takes its metadata (up axis, units, time codes, default prim, ...) from its root layer alone, so as the new root
//! layer we repeat what the input has.

use super::layer::{self, Layer};
use crate::error::{Error, Result, Warnings};
use crate::load::Source;
use crate::load::usd::read::{to_float, to_text};
use crate::write::Baked;
use openusd::sdf::{self, AbstractData, AssetPath, Value};
use openusd::usda::TextWriter;
use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path, PathBuf};

/// Fields of a root layer that either compose through sublayers or are about that layer alone.
const NOT_COPIED: [&str; 11] = [
    "primChildren",
    "primOrder",
    "subLayers",
    "subLayerOffsets",
    "layerRelocates",
    "customLayerData",
    "comment",
    "documentation",
    "hasOwnedSubLayers",
    "owner",
    "sessionOwner",
];

/// Writes the sublayer, the metadata of the `input`'s root layer and `customLayerData.lumel` into `layer`. Relative asset paths
/// in them lead on to the same files, by way of `sublayer`: the input's path as seen from the output folder.
///
/// # Errors
/// `Unsupported` where a file's name can't be written as an asset path.
pub fn copy(
    layer: &mut Layer,
    input: &dyn AbstractData,
    sublayer: &str,
    baked: &Baked,
    warnings: &mut Warnings,
) -> Result<()> {
    let root = sdf::Path::abs_root();
    let field = |name: &str| Some(anchored(input.try_field(&root, name).ok()??.into_owned(), sublayer));
    let mut custom = match field("customLayerData") {
        Some(Value::Dictionary(entries)) => entries,
        _ => HashMap::new(),
    };
    custom.insert("lumel".into(), Value::Dictionary(bake_data(baked)?));
    let mut values = vec![("customLayerData".to_string(), Some(Value::Dictionary(custom)))];
    let mut names = input.list_fields(&root).unwrap_or_default();
    names.retain(|n| !NOT_COPIED.contains(&n.as_str()) && sdf::Path::is_valid_identifier(n));
    names.sort();
    values.extend(names.into_iter().map(|n| (n.clone(), field(&n))));
    for (name, value) in values {
        if let Some(expected) = value.as_ref().and_then(|value| unlike(&name, value)) {
            let message =
                format!("is not {expected}; the layer is without it, as readers refuse it or read something else");
            warnings.add(format!("{} ({name})", baked.source.path().display()), message);
            continue;
        }
        match value.and_then(|v| text(&v, &name, 1, warnings)) {
            Some(text) => layer.metadata.push((name, text)),
            None => warnings.add(name, NOT_WRITTEN),
        }
    }
    layer.metadata.push(("subLayers".into(), format!("[{}]", layer::asset(sublayer)?)));
    Ok(())
}

/// What field `name` of a root layer has to be, where `value` isn't: usd-core opens no text file with such framesPerSecond.
fn unlike(name: &str, value: &Value) -> Option<&'static str> {
    let number = match value {
        Value::Double(v) => Some(*v),
        value => to_float(value.clone()).map(f64::from),
    };
    let number = number.filter(|v| v.is_finite());
    let text = to_text(value.clone());
    let (is_valid, expected) = match name {
        "framesPerSecond" | "timeCodesPerSecond" | "metersPerUnit" | "kilogramsPerUnit" => {
            (number.is_some_and(|v| v > 0.0), "a positive number")
        }
        "startTimeCode" | "endTimeCode" => (number.is_some(), "a finite number"),
        "framePrecision" => (matches!(value, Value::Int(v) if *v >= 0), "an integer of 0 or more"),
        "upAxis" => (text.is_some_and(|axis| axis == "Y" || axis == "Z"), "Y or Z"),
        "defaultPrim" => (text.is_some_and(|prim| is_prim(&prim)), "the name or path of a prim"),
        _ => return None,
    };
    (!is_valid).then_some(expected)
}

/// True for the name of a root prim, and for an absolute path of any prim.
fn is_prim(text: &str) -> bool {
    text.strip_prefix('/').unwrap_or(text).split('/').all(sdf::Path::is_valid_identifier)
}

const NOT_WRITTEN: &str = "is metadata of the input that could not be repeated in the layer";

/// A value as usda text; `None` where it has none. `name` is its place, `depth` its indentation.
///
/// Dictionaries are written here, since the USD crate leaves a key such as `a:b` bare, which usd-core refuses.
fn text(value: &Value, name: &str, depth: usize, warnings: &mut Warnings) -> Option<String> {
    let Value::Dictionary(entries) = value else { return TextWriter::value_to_string(value).ok() };
    let indent = "    ".repeat(depth);
    let mut lines = String::from("{\n");
    for (key, value) in entries.iter().collect::<BTreeMap<_, _>>() {
        let kind = match value {
            Value::Dictionary(_) => Some("dictionary".to_string()),
            value => sdf::ValueKind::from(value).type_name().map(|t| t.as_str().to_string()),
        };
        let place = format!("{name}:{key}");
        match kind.zip(text(value, &place, depth + 1, warnings)) {
            Some((kind, value)) => lines += &format!("{indent}    {kind} {} = {value}\n", layer::quoted(key)),
            None => warnings.add(place, NOT_WRITTEN),
        }
    }
    Some(lines + &indent + "}")
}

/// The contents of `customLayerData.lumel`; `time` is there where a time code was asked for.
fn bake_data(baked: &Baked) -> Result<HashMap<String, Value>> {
    let quantity = baked.quantity;
    let mut pages = Vec::with_capacity(baked.page_uris.len());
    for uri in baked.page_uris {
        let path = page_path(uri);
        layer::asset(&path)?;
        pages.push(AssetPath::new(path));
    }
    let time = match baked.source {
        Source::Usd(source) => source.time.map(|time| ("time".to_string(), Value::Double(time))),
        Source::Gltf(_) => None,
    };
    let entries = [
        ("version".to_string(), Value::String(env!("CARGO_PKG_VERSION").to_string())),
        ("quantity".to_string(), Value::String(quantity.name().to_string())),
        ("unit".to_string(), Value::String(quantity.unit().to_string())),
        ("pages".to_string(), Value::AssetPathVec(pages)),
    ];
    Ok(entries.into_iter().chain(time).collect())
}

/// A page's asset path: `./` makes it relative to the layer, and not to a search path.
pub fn page_path(uri: &str) -> String {
    format!("./{uri}")
}

/// `value` with its relative asset paths, at any depth, rewritten from the input's place to ours.
fn anchored(value: Value, sublayer: &str) -> Value {
    let anchor = |path: AssetPath| AssetPath::new(anchored_path(path.as_str(), sublayer));
    match value {
        Value::AssetPath(path) => Value::AssetPath(anchor(path)),
        Value::AssetPathVec(paths) => Value::AssetPathVec(paths.into_iter().map(anchor).collect()),
        Value::Dictionary(entries) => {
            Value::Dictionary(entries.into_iter().map(|(k, v)| (k, anchored(v, sublayer))).collect())
        }
        value => value,
    }
}

/// Only `./x` and `../x` are surely relative to the layer; anything else may be a search path, an URI or an expression.
fn anchored_path(path: &str, sublayer: &str) -> String {
    if !path.starts_with("./") && !path.starts_with("../") {
        return path.to_string();
    }
    if sublayer.to_ascii_lowercase().ends_with(".usdz") {
        return format!("{sublayer}[{}]", path.trim_start_matches("./"));
    }
    match sublayer.rfind('/') {
        Some(end) => format!("{}/{}", &sublayer[..end], path.strip_prefix("./").unwrap_or(path)),
        None => path.to_string(),
    }
}

/// The asset path, relative with forward slashes, that leads from a layer in `folder` to `file`; absolute where they share
/// no root (Windows drives).
///
/// # Errors
/// `Io` where the working folder or `file` can't be looked up, `Unsupported` where the path is no Unicode.
pub fn relative(file: &Path, folder: &Path) -> Result<String> {
    let absolute = |p: &Path| std::path::absolute(p).map_err(|e| Error::io(p, e));
    let (lexical_file, lexical_folder) = (normal(&absolute(file)?), normal(&absolute(folder)?));
    // USD resolves `..` in the text of a path, the operating system in the folders themselves. Where a link makes the two
    // differ, real places are the better guess: a tool that was given the folder by another name may still find the file.
    let real_file = lexical_file.canonicalize().map_err(|e| Error::io(file, e))?;
    let steps = match steps(&lexical_file, &lexical_folder) {
        Some(s) if lexical_folder.join(&s).canonicalize().is_ok_and(|found| found == real_file) => Some(s),
        // A folder that is not there yet can't be a link.
        Some(s) if !lexical_folder.exists() => Some(s),
        _ => lexical_folder.canonicalize().ok().and_then(|real| self::steps(&real_file, &real)),
    };
    let path = steps.unwrap_or(real_file);
    let text = path.to_str().ok_or_else(|| Error::unsupported(path.display(), "the path is not Unicode; rename it"))?;
    let text = if cfg!(windows) { text.replace('\\', "/") } else { text.to_string() };
    Ok(if path.is_absolute() || text.starts_with("../") { text } else { format!("./{text}") })
}

/// The way from `folder` to `file`, both absolute; `None` where they share no root.
fn steps(file: &Path, folder: &Path) -> Option<PathBuf> {
    let (file, folder): (Vec<_>, Vec<_>) = (file.components().collect(), folder.components().collect());
    let shared = file.iter().zip(&folder).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return None;
    }
    let up = folder[shared..].iter().map(|_| Component::ParentDir);
    Some(up.chain(file[shared..].iter().copied()).collect())
}

/// `path` without `.` and `..` as far as its text goes.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => {
                out.pop();
            }
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_from_the_folder_to_the_file() {
        let way = |file: &str, folder: &str| steps(&normal(Path::new(file)), &normal(Path::new(folder)));
        assert_eq!(way("/a/b/s.usd", "/a/b/s_baked"), Some("../s.usd".into()));
        assert_eq!(way("/a/b/s.usd", "/a/b"), Some("s.usd".into()));
        assert_eq!(way("/a/b/../s.usd", "/c/./d"), Some("../../a/s.usd".into()));
    }

    #[test]
    fn asset_paths_keep_their_file() {
        assert_eq!(anchored_path("./ocio/config.ocio", "../in/s.usda"), "../in/ocio/config.ocio");
        assert_eq!(anchored_path("../config.ocio", "./s.usda"), "./../config.ocio");
        assert_eq!(anchored_path("config.ocio", "../s.usda"), "config.ocio");
        assert_eq!(anchored_path("./config.ocio", "../s.usdz"), "../s.usdz[config.ocio]");
    }
}
