//! A module imports only modules of lower rank: the table in `src/README.md`, enforced.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The table's rows: `| 3 | patch |`.
fn ranks() -> BTreeMap<String, u32> {
    let readme = include_str!("../src/README.md");
    let mut ranks = BTreeMap::new();
    for line in readme.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if let [_, rank, modules, ..] = cells[..]
            && let Ok(rank) = rank.parse()
        {
            for module in modules.split(',') {
                ranks.insert(module.trim().trim_matches('`').to_string(), rank);
            }
        }
    }
    ranks
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

#[test]
fn modules_import_only_lower_ranks() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let ranks = ranks();
    let mut offences = Vec::new();
    for file in sources(&root) {
        let relative = file.strip_prefix(&root).unwrap();
        let first = relative.components().next().unwrap().as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs").to_string();
        if module == "lib" {
            continue;
        }
        let rank = *ranks.get(&module).unwrap_or_else(|| panic!("{module} has no rank in src/README.md"));
        let text = std::fs::read_to_string(&file).unwrap();
        let code: Vec<&str> = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect();
        for import in imported(&code.join("\n")) {
            match ranks.get(&import) {
                Some(_) if import == module => {}
                Some(other) if *other < rank => {}
                Some(other) => {
                    offences.push(format!("{}: {module} ({rank}) imports {import} ({other})", relative.display()));
                }
                // A type or alias that the crate's root re-exports.
                None => {}
            }
        }
    }
    assert!(offences.is_empty(), "imports against the ranks:\n{}", offences.join("\n"));
}

/// The top-level modules that a text names behind `crate::`, brace lists over several lines included.
fn imported(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for rest in text.split("crate::").skip(1) {
        if let Some(list) = rest.strip_prefix('{') {
            let list = list.split('}').next().unwrap_or("");
            found.extend(list.split(',').map(|item| name(item.trim())));
        } else {
            found.push(name(rest));
        }
    }
    found
}

fn name(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}
