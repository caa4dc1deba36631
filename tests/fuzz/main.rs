//! Readers fed with broken files: no panic, no hang, no memory out of proportion. See README.md beside this file.

#[path = "../files/mod.rs"]
mod files;
#[path = "../gltf_document/mod.rs"]
mod gltf_document;
mod mutate;
mod seeds;
mod target;

use mutate::{Random, mutate, mutate_json};
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use target::Target;

/// Longest that one broken file may take.
const MOST_TIME: Duration = Duration::from_secs(20);

/// Most memory of the process over all that it reads [bytes]; seeds have up to a few megabytes.
const MOST_MEMORY: u64 = 3 << 30;

/// Broken files of the short run.
const SHORT: u64 = 400;

/// The number in the environment variable `name`.
fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

/// The most memory that this process held [bytes].
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    line.and_then(|l| l.split_whitespace().nth(1)?.parse::<u64>().ok()).map_or(0, |kib| kib << 10)
}

/// Keeps a file that broke a reader, and says where.
fn keep(target: &Target, bytes: &[u8]) -> PathBuf {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/fuzz");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(format!("{}-{:016x}.{}", target.name, hasher.finish(), target.extension));
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Reads one broken file, and fails with its place where the reader does more than refuse it.
fn read(target: &Target, folder: &Path, bytes: &[u8]) {
    let start = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| (target.read)(folder, bytes)));
    assert!(outcome.is_ok(), "{}: the reader panicked on {}", target.name, keep(target, bytes).display());
    let spent = start.elapsed();
    assert!(spent < MOST_TIME, "{}: {spent:?} for {}", target.name, keep(target, bytes).display());
    let memory = peak_memory();
    assert!(memory < MOST_MEMORY, "{}: {memory} bytes at {}", target.name, keep(target, bytes).display());
}

/// Feeds a reader with mutations of its seeds: a fixed number of them, or as long as LUMEL_FUZZ_SECONDS says.
fn fuzz(name: &str, share: u64) {
    let target = target::named(name);
    let folder = gltf_document::Folder::new(&format!("fuzz-{name}"));
    let seeds = seeds::of(&target);
    assert!(!seeds.is_empty(), "{name} has no seeds");
    for seed in seeds.iter().filter(|s| s.is_ours) {
        assert!((target.read)(&folder.0, &seed.bytes), "{name}: a seed of our own is not read");
    }
    for kept in seeds::findings(&target) {
        read(&target, &folder.0, &kept);
    }
    let end = number("LUMEL_FUZZ_SECONDS").map(|s| Instant::now() + Duration::from_secs(s));
    let mut random = Random::new(number("LUMEL_FUZZ_SEED").unwrap_or(1));
    let mut count = 0u64;
    while end.map_or(count < SHORT / share, |end| Instant::now() < end) {
        let seed = &seeds[random.below(seeds.len())];
        let other = &seeds[random.below(seeds.len())];
        let bytes = match target.is_json {
            true => mutate_json(&seed.bytes, &mut random),
            false => mutate(&seed.bytes, &other.bytes, &mut random),
        };
        read(&target, &folder.0, &bytes);
        count += 1;
    }
    println!("{name}: {count} broken files from {} seeds", seeds.len());
}

#[test]
fn glb() {
    fuzz("glb", 1);
}

#[test]
fn gltf_accessors() {
    fuzz("accessors", 1);
}

#[test]
fn usdz() {
    fuzz("usdz", 2);
}

#[test]
fn usdc() {
    fuzz("usdc", 2);
}

#[test]
fn usda() {
    fuzz("usda", 2);
}

#[test]
fn image() {
    fuzz("image", 1);
}

#[test]
fn ies() {
    fuzz("ies", 1);
}
