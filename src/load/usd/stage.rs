//! Opening a stage with the variants that the user chose, for the reader and the layer's writer alike.

use super::resolver::GuardedResolver;
use crate::error::{Error, Result};
use crate::load::access::Access;
use openusd::sdf::{Path as PrimPath, Value};
use openusd::usd::Stage;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A variant selection: `PRIM:SET=NAME`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VariantSelection {
    /// The prim's path.
    pub prim: String,
    pub set: String,
    pub name: String,
}

impl VariantSelection {
    /// Reads `PRIM:SET=NAME`; the prim's path is absolute, and no part is empty.
    ///
    /// # Errors
    /// `Invalid` where the text has another form.
    pub fn parse(text: &str) -> Result<Self> {
        let (place, name) = text.split_once('=').unwrap_or((text, ""));
        let (prim, set) = place.split_once(':').unwrap_or((place, ""));
        let is_sound = prim.starts_with('/') && prim.len() > 1 && !set.is_empty() && !name.is_empty();
        if !is_sound || !PrimPath::new(prim).is_ok_and(|path| path.is_prim_path()) {
            let message =
                format!("{text} is no selection; of a USD stage give /PRIM:SET=NAME, as in /World/Car:paint=red");
            return Err(Error::invalid("variant", message));
        }
        Ok(Self { prim: prim.to_owned(), set: set.to_owned(), name: name.to_owned() })
    }
}

/// Opens the stage at `path`, whose files `access` allows, with `selections`, which are stronger than any in the files; the files stay as they are.
///
/// # Errors
/// `Io` where the file can't be read, `Invalid` where it is no USD file, or has no such prim, set or variant: then the
/// message lists those that it has.
pub fn open(path: &Path, selections: &[VariantSelection], access: &Access) -> Result<Stage> {
    let name = path.to_str().ok_or_else(|| Error::invalid(path.display(), "the path is not UTF-8; rename the file"))?;
    let stage = Stage::builder()
        .resolver(GuardedResolver::new(access.clone()))
        .schema_registry(openusd_schemas::schema_registry())
        .open(name)
        .map_err(|error| open_error(path, error))?;
    for selection in selections {
        select(&stage, path, selection)?;
    }
    Ok(stage)
}

fn open_error(path: &Path, error: openusd::Error) -> Error {
    match error {
        openusd::Error::Io(source) => Error::io(path, source),
        error => {
            let mut message = error.to_string();
            let mut source = std::error::Error::source(&error);
            while let Some(cause) = source {
                message = format!("{message}: {cause}");
                source = cause.source();
            }
            // The parser draws the source line; one line is enough here.
            let message = message.split_whitespace().collect::<Vec<&str>>().join(" ");
            let remedy = "usdcat may read it all the same and write a binary file: usdcat in.usda -o out.usdc";
            Error::invalid(path.display(), format!("is no sound USD file: {message} ({remedy})"))
        }
    }
}

/// The variants of each set of the prim at `path`, by the set's name.
fn variant_sets(stage: &Stage, path: &PrimPath) -> BTreeMap<String, BTreeSet<String>> {
    let mut sets: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let sites = stage.prim(path.clone()).ok().and_then(|prim| prim.prim_stack().ok()).unwrap_or_default();
    for site in sites {
        let Some(layer) = stage.layer(&site.layer) else { continue };
        let children = |path: &PrimPath, field: &str| match layer.data().try_field(path, field) {
            Ok(Some(value)) => match value.into_owned() {
                Value::TokenVec(names) => names.iter().map(|n| n.as_str().to_owned()).collect(),
                Value::StringVec(names) => names,
                _ => Vec::new(),
            },
            _ => Vec::new(),
        };
        for set in children(&site.path, "variantSetChildren") {
            let variants = site.path.append_variant_selection(&set, "").map(|path| children(&path, "variantChildren"));
            sets.entry(set).or_default().extend(variants.unwrap_or_default());
        }
    }
    sets
}

fn select(stage: &Stage, file: &Path, selection: &VariantSelection) -> Result<()> {
    let VariantSelection { prim, set, name } = selection;
    let invalid = |message: String| Error::invalid(format!("{}: {prim}", file.display()), message);
    let path = PrimPath::new(prim).map_err(|e| invalid(e.to_string()))?;
    let found = stage.prim(path.clone()).ok().filter(|prim| prim.is_valid().unwrap_or(false));
    let Some(found) = found else {
        return Err(invalid(format!("is no prim of the stage; {}", prims_with_variants(stage))));
    };
    if found.is_instance_proxy().unwrap_or(false) {
        let message = "lies below an instance, where USD takes no selection; select a variant of the instance itself";
        return Err(invalid(message.into()));
    }
    let sets = variant_sets(stage, &path);
    let listed = |names: &mut dyn Iterator<Item = &String>| names.cloned().collect::<Vec<_>>().join(", ");
    let Some(variants) = sets.get(set) else {
        let known = listed(&mut sets.keys());
        return Err(invalid(match known.as_str() {
            "" => format!("has no variant set {set}, nor any other; {}", prims_with_variants(stage)),
            known => format!("has no variant set {set}; it has {known}"),
        }));
    };
    if !variants.contains(name) {
        return Err(invalid(format!("has no variant {name} of {set}; it has {}", listed(&mut variants.iter()))));
    }
    let chosen = |known: Option<Value>| {
        let mut selections = match known {
            Some(Value::VariantSelectionMap(selections)) => selections,
            _ => Default::default(),
        };
        selections.insert(set.clone(), name.clone());
        Some(Value::VariantSelectionMap(selections))
    };
    // In the root layer as it stands in memory, which no one saves.
    found.update_metadata("variantSelection", chosen).map_err(|e| invalid(e.to_string()))?;
    Ok(())
}

/// The stage's prims with variant sets, for a message.
fn prims_with_variants(stage: &Stage) -> String {
    const MOST: usize = 20;
    let mut paths = Vec::new();
    let _ = stage.traverse(openusd::usd::PrimPredicate::DEFAULT, |path| paths.push(path.clone()));
    let with_sets = paths.into_iter().filter_map(|path| {
        let sets: Vec<String> = variant_sets(stage, &path).into_keys().collect();
        (!sets.is_empty()).then(|| format!("{path} ({})", sets.join(", ")))
    });
    let found: Vec<String> = with_sets.take(MOST).collect();
    match found.is_empty() {
        true => "no prim of it has variant sets".into(),
        false => format!("those with variant sets are {}", found.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_name_prim_set_and_variant() {
        let read = VariantSelection::parse("/World/Car:paint=dark red").unwrap();
        assert_eq!((&*read.prim, &*read.set, &*read.name), ("/World/Car", "paint", "dark red"));
        for broken in ["red", "/Car:paint", "/Car=red", "Car:paint=red", "/:paint=red", "/Car:=red", "/Car:paint="] {
            assert!(VariantSelection::parse(broken).is_err(), "{broken}");
        }
    }
}
