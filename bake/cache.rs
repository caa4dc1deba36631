//! `lumel cache`: what bakes keep for later ones; listed, checked and pruned.

use super::args::{CacheArgs, CacheCommand, CachePlace};
use super::console::Console;
use super::destination;
use super::failure::Failure;
use super::interrupt;
use super::print::{self, Table, count, number, seconds};
use lumel::Error;
use lumel::store::{Item, Store, Survey};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

/// What entries of other versions of the program are listed as.
const OTHER: &str = "another version";

/// `lumel cache`.
///
/// # Errors
/// `Invalid` where there is no cache, or, of `verify`, a damaged entry; else the store's.
pub fn cache(args: &CacheArgs, console: &Console) -> Result<(), Failure> {
    match &args.command {
        CacheCommand::List { place, json } => list(&open(place)?, *json),
        CacheCommand::Verify { place, remove } => verify(&open(place)?, *remove, console),
        CacheCommand::Prune { place, max_size } => prune(&open(place)?, *max_size),
    }
}

fn open(place: &CachePlace) -> Result<Store, Error> {
    match (&place.cache, &place.output) {
        (Some(cache), _) => Store::open_existing(cache),
        (None, output) => Store::open_existing(&destination::cache(output.as_deref().unwrap_or(Path::new(".")))),
    }
}

fn list(store: &Store, as_json: bool) -> Result<(), Failure> {
    let survey = store.survey()?;
    let age = |item: &Item| SystemTime::now().duration_since(item.used).unwrap_or_default().as_secs_f64();
    if as_json {
        let entry = |item: &Item| {
            let key = item.key.map(|key| key.to_string());
            json!({"kind": item.kind, "key": key, "path": item.path, "size": item.size, "age": age(item)})
        };
        let entries: Vec<_> = survey.items.iter().map(entry).collect();
        return print::json(&json!({"folder": store.folder(), "size": survey.size(), "entries": entries}));
    }
    let mut entries = Table::new(&["kind", "key", ">size", ">last used"]);
    for item in &survey.items {
        let key = item.key.map_or_else(|| OTHER.to_string(), |key| key.to_string());
        entries.row(vec![item.kind.clone(), key, size(item.size), format!("{} ago", seconds(age(item)))]);
    }
    print::print(&format!("{}\n{}", entries.text(), totals(&survey)))
}

/// How many entries of each kind there are, and how large they are together.
fn totals(survey: &Survey) -> String {
    let mut kinds: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
    for item in &survey.items {
        let (entries, bytes) = kinds.entry(&item.kind).or_default();
        *entries += 1;
        *bytes += item.size;
    }
    let mut table = Table::new(&["kind", ">entries", ">size"]);
    for (kind, (entries, bytes)) in kinds {
        table.row(vec![kind.into(), count(entries), size(bytes)]);
    }
    table.row(vec!["all".into(), count(survey.items.len() as u64), size(survey.size())]);
    table.text()
}

fn verify(store: &Store, remove: bool, console: &Console) -> Result<(), Failure> {
    interrupt::install(console, console.cancel_flag(), None);
    let damaged = store.verify(console)?;
    console.finish();
    for (item, what) in &damaged {
        print::print(&format!("{}: {what}\n", item.path.display()))?;
        if remove {
            store.remove_item(item)?;
        }
    }
    let place = store.folder().unwrap_or(Path::new("")).display();
    let number = match damaged.len() {
        0 => return Ok(()),
        1 => "1 entry is damaged".to_string(),
        n => format!("{} entries are damaged", count(n as u64)),
    };
    let then = if remove { "taken away, and its work is done again" } else { "--remove takes away what is damaged" };
    Err(Error::invalid(place, format!("{number}; {then}")).into())
}

fn prune(store: &Store, max_size: u64) -> Result<(), Failure> {
    let pruned = store.prune(max_size)?;
    let mut table = Table::new(&["", ">files", ">size"]);
    table.row(vec!["removed".into(), count(pruned.removed as u64), size(pruned.freed)]);
    table.row(vec!["half written".into(), count(pruned.abandoned as u64), String::new()]);
    table.row(vec!["left".into(), count(store.survey()?.items.len() as u64), size(pruned.left)]);
    print::print(&table.text())
}

/// An amount of memory in the largest unit of which there is one.
fn size(bytes: u64) -> String {
    let units = [(1u64 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    match units.into_iter().find(|(unit, _)| bytes >= *unit) {
        Some((unit, name)) => format!("{} {name}", number(bytes as f64 / unit as f64)),
        None => format!("{bytes} B"),
    }
}
