//! The store of results: nothing damaged is ever read, nothing half written is ever met, and what fails leaves nothing behind.

mod files;

use files::Folder;
use lumel::error::Error;
use lumel::progress::Silent;
use lumel::store::{FolderLock, Key, Output, Store};
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant, SystemTime};

fn key(n: u64) -> Key {
    Key::of("test 1", |h| h.add_u64(n))
}

/// Bytes without a pattern.
fn noise(n: usize) -> Vec<u8> {
    let mut state = 1u32;
    let next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    std::iter::repeat_with(next).take(n).collect()
}

/// The one file below a folder whose name is `key`'s.
fn file_of(store: &Store, kind: &str, key: Key) -> PathBuf {
    store.folder().unwrap().join("v1").join(kind).join(key.to_string())
}

/// The names of all files below a folder.
fn all_files(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        match entry.path().is_dir() {
            true => names.extend(all_files(&entry.path())),
            false => names.push(entry.file_name().into_string().unwrap()),
        }
    }
    names
}

fn used(path: &Path, seconds_ago: u64) {
    let time = SystemTime::now() - Duration::from_secs(seconds_ago);
    File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
}

#[test]
fn what_is_written_is_read() {
    let folder = Folder::new("read");
    let store = Store::open(&folder.0.join("a/cache")).unwrap();
    let floats = [1.0f32, -0.0, f32::NAN, 3.5];
    assert!(store.read("links", key(1)).unwrap().is_none());
    store.write("links", key(1), &[bytemuck::cast_slice(&floats), b"", b"abc"]).unwrap();
    assert!(store.contains("links", key(1)) && !store.contains("direct", key(1)));

    let entry = Store::open(&folder.0.join("a/cache")).unwrap().read("links", key(1)).unwrap().unwrap();
    assert_eq!(entry.section_count(), 3);
    assert_eq!(entry.slice::<f32>(0).unwrap().map_bits(), floats.map_bits());
    assert_eq!((entry.section(1), entry.section(2), entry.section(3)), (&b""[..], &b"abc"[..], &b""[..]));
    assert!(entry.slice::<u64>(1).unwrap().is_empty());
    let wrong = entry.slice::<u32>(2).unwrap_err().to_string();
    assert!(wrong.contains(&key(1).to_string()) && wrong.contains("section 2"), "{wrong}");
    assert!(entry.slice::<u8>(3).is_err());

    // Written anew, and removed: what was read stays as it was.
    store.write("links", key(1), &[b"other"]).unwrap();
    assert_eq!(store.read("links", key(1)).unwrap().unwrap().section(0), b"other");
    assert!(store.remove("links", key(1)).unwrap() && !store.remove("links", key(1)).unwrap());
    assert!(store.read("links", key(1)).unwrap().is_none());
    assert_eq!(entry.section(2), b"abc");
    assert!(store.take_warnings().is_empty());
}

trait Bits {
    fn map_bits(&self) -> Vec<u32>;
}

impl Bits for [f32] {
    fn map_bits(&self) -> Vec<u32> {
        self.iter().map(|v| v.to_bits()).collect()
    }
}

#[test]
fn no_store_holds_nothing() {
    let store = Store::none();
    store.write("links", key(1), &[b"abc"]).unwrap();
    assert!(store.is_none() && store.folder().is_none() && !store.contains("links", key(1)));
    assert!(store.read("links", key(1)).unwrap().is_none() && !store.remove("links", key(1)).unwrap());
    assert!(store.survey().unwrap().items.is_empty());
    assert_eq!(store.prune(0).unwrap().removed, 0);
}

/// Asks for a damaged entry: there is none, one warning says so, and it can be written again.
fn assert_replaced(store: &Store, what: &str) {
    assert!(store.read("part", key(1)).unwrap().is_none(), "{what}");
    let warnings = store.take_warnings();
    let [warning] = &warnings.iter().collect::<Vec<_>>()[..] else { panic!("{what}: {warnings:?}") };
    assert!(warning.message.contains("damaged") && warning.places[0].contains(&key(1).to_string()), "{warning:?}");
    assert!(!store.contains("part", key(1)), "{what}");
    assert!(store.read("part", key(1)).unwrap().is_none() && store.take_warnings().is_empty(), "told once");
}

#[test]
fn every_flipped_byte_of_a_small_entry_is_found() {
    let folder = Folder::new("flips");
    let store = Store::open(&folder.0).unwrap();
    store.write("part", key(1), &[b"abc", b"", &[5; 70]]).unwrap();
    let path = file_of(&store, "part", key(1));
    let sound = fs::read(&path).unwrap();
    for k in 0..sound.len() {
        let mut wrong = sound.clone();
        wrong[k] ^= 1 << (k % 8);
        fs::write(&path, &wrong).unwrap();
        assert_replaced(&store, &format!("byte {k}"));
    }
    for n in [0, 1, 63, 64, sound.len() - 64, sound.len() - 1] {
        fs::write(&path, &sound[..n]).unwrap();
        assert_replaced(&store, &format!("{n} bytes"));
    }
    for more in [&b"\0"[..], &[0; 64], b"more"] {
        fs::write(&path, [&sound, more].concat()).unwrap();
        assert_replaced(&store, "something follows");
    }
    // Another entry's file under this one's name, and one of another version.
    store.write("part", key(2), &[b"abc"]).unwrap();
    fs::rename(file_of(&store, "part", key(2)), &path).unwrap();
    assert_replaced(&store, "another entry");
    let mut newer = sound.clone();
    newer[8] = 2;
    fs::write(&path, &newer).unwrap();
    assert_replaced(&store, "another version");
    fs::write(&path, &sound).unwrap();
    assert!(store.read("part", key(1)).unwrap().is_some());
}

#[test]
fn flips_and_cuts_of_a_large_entry_are_found() {
    let folder = Folder::new("large");
    let store = Store::open(&folder.0).unwrap();
    let (a, b) = (noise(700_001), noise(300_000));
    store.write("part", key(1), &[&a, &b]).unwrap();
    let path = file_of(&store, "part", key(1));
    let sound = fs::read(&path).unwrap();
    for k in 0..200usize {
        let at = k.wrapping_mul(0x9E37_79B9_7F4A_7C15) % sound.len();
        let mut wrong = sound.clone();
        match k % 4 {
            0 => wrong.truncate(at),
            _ => wrong[at] ^= 1 << (k % 8),
        }
        fs::write(&path, &wrong).unwrap();
        assert_replaced(&store, &format!("{k}: byte {at}"));
    }
    fs::write(&path, &sound).unwrap();
    let entry = store.read("part", key(1)).unwrap().unwrap();
    assert!(entry.section(0) == a && entry.section(1) == b);
}

#[test]
fn folders_of_others_are_left_alone() {
    let folder = Folder::new("others");
    folder.write("mine/photo.png", b"png");
    let error = Store::open(&folder.0.join("mine")).unwrap_err().to_string();
    assert!(error.contains("mine") && error.contains("choose"), "{error}");
    assert_eq!(all_files(&folder.0), ["photo.png"]);
    folder.write("named/lumel-cache.txt", b"my notes\n");
    assert!(Store::open(&folder.0.join("named")).is_err());
    folder.write("file", b"");
    assert!(matches!(Store::open(&folder.0.join("file")), Err(Error::Io { .. })));
    assert!(Store::open_existing(&folder.0.join("mine")).is_err());
    assert!(Store::open_existing(&folder.0.join("nowhere")).is_err() && !folder.0.join("nowhere").exists());

    // A process that was killed over its first line left a part of it.
    folder.write("begun/lumel-cache.txt", b"Lumel ca");
    Store::open(&folder.0.join("begun")).unwrap();
    assert!(fs::read_to_string(folder.0.join("begun/lumel-cache.txt")).unwrap().ends_with("may be deleted.\n"));
}

#[test]
fn another_version_is_kept_apart() {
    let folder = Folder::new("versions");
    folder.write("lumel-cache.txt", b"Lumel cache, format 9. Made by Lumel; may be deleted.\n");
    let theirs = folder.write(&format!("v9/links/{}", key(1)), noise(1000));
    used(&theirs, 100);
    let store = Store::open(&folder.0).unwrap();
    assert!(store.read("links", key(1)).unwrap().is_none() && store.take_warnings().is_empty());
    store.write("links", key(1), &[b"ours"]).unwrap();
    assert!(store.verify(&Silent).unwrap().is_empty());
    let items = store.survey().unwrap().items;
    assert_eq!(items.iter().map(|item| item.key).collect::<Vec<_>>(), [Some(key(1)), None]);
    // Room is room, whoever takes it.
    assert_eq!(store.prune(1000).unwrap().removed, 1);
    assert!(!theirs.exists() && store.read("links", key(1)).unwrap().is_some());
}

#[test]
fn many_writers_of_one_entry_leave_one_sound_file() {
    let folder = Folder::new("writers");
    let bytes = noise(50_000);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let store = Store::open(&folder.0).unwrap();
                for n in 0..10 {
                    store.write("part", key(n), &[&bytes]).unwrap();
                    let entry = store.read("part", key(n)).unwrap().expect("written before");
                    assert!(entry.section(0) == bytes);
                }
                assert!(store.take_warnings().is_empty());
            });
        }
    });
    assert_eq!(all_files(&folder.0).len(), 10 + 1, "ten entries and the marker");
}

#[test]
fn pruning_keeps_what_was_used_last() {
    let folder = Folder::new("prune");
    let store = Store::open(&folder.0).unwrap();
    for n in 0..6 {
        store.write(["links", "direct"][n as usize % 2], key(n), &[&noise(10_000)]).unwrap();
        used(&file_of(&store, ["links", "direct"][n as usize % 2], key(n)), 1000 - n);
    }
    // The oldest is read: that makes it the youngest.
    store.read("links", key(0)).unwrap().unwrap();
    let (size, one) = (store.survey().unwrap().size(), store.survey().unwrap().items[0].size);
    assert_eq!(size, 6 * one);
    assert_eq!(store.prune(size).unwrap().removed, 0);
    let pruned = store.prune(3 * one + 5).unwrap();
    assert_eq!((pruned.removed, pruned.freed, pruned.left), (3, 3 * one, 3 * one));
    let kept: Vec<u64> = (0..6).filter(|n| store.contains(["links", "direct"][*n as usize % 2], key(*n))).collect();
    assert_eq!(kept, [0, 4, 5]);
    let kinds: Vec<String> = store.survey().unwrap().items.into_iter().map(|item| item.kind).collect();
    assert_eq!(kinds, ["direct", "links", "links"]);
    assert_eq!(store.prune(0).unwrap().left, 0);
    assert_eq!(all_files(&folder.0), ["lumel-cache.txt"]);
}

#[test]
fn what_dead_writers_left_is_cleared() {
    let folder = Folder::new("dead");
    let store = Store::open(&folder.0).unwrap();
    store.write("part", key(1), &[b"abc"]).unwrap();
    let left = |n: u64, age: u64| {
        let path = folder.write(&format!("v1/part/.{}.77.0.tmp", key(n)), b"half");
        used(&path, age);
        path
    };
    let (young, old, ancient) = (left(1, 0), left(2, 60), left(3, 90_000));
    // Someone is at work on it, however old it is.
    let busy = left(4, 90_000);
    let lock = File::open(&busy).unwrap();
    lock.lock().unwrap();
    Store::open(&folder.0).unwrap();
    assert_eq!([&young, &old, &ancient, &busy].map(|p| p.exists()), [true, true, false, true]);
    assert_eq!(store.prune(u64::MAX).unwrap().abandoned, 1);
    assert_eq!([&young, &old, &busy].map(|p| p.exists()), [true, false, true]);
    assert_eq!(store.survey().unwrap().items.len(), 1);
}

#[test]
fn verifying_finds_the_damaged_and_changes_nothing() {
    let folder = Folder::new("verify");
    let store = Store::open(&folder.0).unwrap();
    (0..4).for_each(|n| store.write("part", key(n), &[&noise(100)]).unwrap());
    let path = file_of(&store, "part", key(2));
    let mut bytes = fs::read(&path).unwrap();
    bytes[200] ^= 1;
    fs::write(&path, bytes).unwrap();
    let damaged = store.verify(&Silent).unwrap();
    assert_eq!(damaged.iter().map(|(item, _)| item.key).collect::<Vec<_>>(), [Some(key(2))]);
    assert!(path.exists());
    store.remove_item(&damaged[0].0).unwrap();
    assert!(store.verify(&Silent).unwrap().is_empty());
}

/// A file of which the write that reaches `room` bytes fails, or else the sync.
struct Failing {
    file: File,
    room: usize,
}

impl Write for Failing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.room.checked_sub(bytes.len()) {
            Some(room) => {
                self.room = room;
                self.file.write(bytes)
            }
            None => Err(ErrorKind::StorageFull.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Output for Failing {
    fn sync(&mut self) -> io::Result<()> {
        Err(ErrorKind::StorageFull.into())
    }
}

#[test]
fn a_folder_that_goes_while_an_entry_is_written_is_made_again() {
    let folder = Folder::new("gone");
    let made = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&made);
    let create = move |path: &Path| -> io::Result<Box<dyn Output>> {
        // Another bake lets go of the parts of its work, in the same folder.
        if count.fetch_add(1, Ordering::Relaxed) == 0 {
            fs::remove_dir_all(path.parent().unwrap())?;
        }
        Ok(Box::new(File::create_new(path)?))
    };
    let store = Store::open_with(&folder.0, Box::new(create)).unwrap();
    store.write("part", key(1), &[b"abc"]).unwrap();
    assert_eq!(made.load(Ordering::Relaxed), 2);
    assert_eq!(store.read("part", key(1)).unwrap().unwrap().section(0), b"abc");
}

#[test]
fn a_write_that_fails_leaves_nothing_behind() {
    let folder = Folder::new("failing");
    let (sections, made): ([&[u8]; 2], _) = ([&[1; 100], &[2; 100]], Arc::new(AtomicUsize::new(0)));
    let sound = Store::open(&folder.0).unwrap();
    sound.write("part", key(0), &sections).unwrap();
    let length = fs::metadata(file_of(&sound, "part", key(0))).unwrap().len() as usize;
    // After every byte, and at last in the sync alone.
    for room in 0..=length {
        let count = Arc::clone(&made);
        let create = move |path: &Path| -> io::Result<Box<dyn Output>> {
            count.fetch_add(1, Ordering::Relaxed);
            Ok(Box::new(Failing { file: File::create_new(path)?, room }))
        };
        let store = Store::open_with(&folder.0, Box::new(create)).unwrap();
        let error = store.write("part", key(1), &sections).unwrap_err().to_string();
        assert!(error.contains(&key(1).to_string()) && error.contains("make room"), "{error}");
        // An entry that was there stays as it was.
        store.write("part", key(0), &[b"other"]).unwrap_err();
        assert_eq!(all_files(&folder.0).len(), 2, "the marker and the entry: {:?}", all_files(&folder.0));
        assert!(!store.contains("part", key(1)));
        assert_eq!(store.read("part", key(0)).unwrap().unwrap().section(1), sections[1]);
    }
    assert_eq!(made.load(Ordering::Relaxed), 2 * (length + 1));
}

/// A small disk, while it is mounted.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn new(path: PathBuf) -> Option<Self> {
        fs::create_dir_all(&path).unwrap();
        let options = ["-t", "tmpfs", "-o", "size=256k", "lumel-test"];
        let mounted = Command::new("mount").args(options).arg(&path).stderr(Stdio::null()).status();
        mounted.is_ok_and(|status| status.success()).then_some(Self(path))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_told_and_left_clean() {
    let folder = Folder::new("full");
    let Some(disk) = SmallDisk::new(folder.0.join("disk")) else {
        println!("skipped: no small disk can be mounted here");
        return;
    };
    let store = Store::open(&disk.0.join("cache")).unwrap();
    store.write("part", key(0), &[&noise(100_000)]).unwrap();
    let error = store.write("part", key(1), &[&noise(300_000)]).unwrap_err().to_string();
    assert!(error.contains(&key(1).to_string()) && error.contains("make room"), "{error}");
    assert_eq!(all_files(&disk.0).len(), 2);
    assert!(store.read("part", key(0)).unwrap().is_some());
    // With room again it works.
    store.prune(0).unwrap();
    store.write("part", key(1), &[&noise(100_000)]).unwrap();
    assert!(store.read("part", key(1)).unwrap().is_some());
}

/// Not a test: the other process of the one below, which writes to the store in `LUMEL_TEST_STORE` until it is killed.
#[test]
#[ignore = "a process of another test"]
fn write_on() {
    let Some(folder) = std::env::var_os("LUMEL_TEST_STORE") else { return };
    let store = Store::open(Path::new(&folder)).unwrap();
    let bytes = noise(3 << 20);
    println!("begins");
    for n in 0..u64::MAX {
        store.write("part", key(n % 3), &[&bytes, &n.to_le_bytes()]).unwrap();
    }
}

#[test]
fn a_writer_that_is_killed_leaves_no_half_entry() {
    let folder = Folder::new("killed");
    let mut halves = 0;
    for k in 0..12 {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--ignored", "--exact", "write_on", "--nocapture"]).env("LUMEL_TEST_STORE", &folder.0);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap().contains("begins")));
        std::thread::sleep(Duration::from_millis(5 + 3 * k));
        child.kill().unwrap();
        child.wait().unwrap();
        let store = Store::open(&folder.0).unwrap();
        assert!(store.verify(&Silent).unwrap().is_empty());
        let temporary = all_files(&folder.0).into_iter().filter(|name| name.ends_with(".tmp"));
        temporary.for_each(|name| used(&folder.0.join("v1/part").join(name), 60));
        halves += store.prune(u64::MAX).unwrap().abandoned;
        assert!(all_files(&folder.0).len() <= 3 + 1, "{:?}", all_files(&folder.0));
    }
    println!("{halves} of 12 were killed over a file");
}

/// Not a test: the other process of the one below, which takes the lock of the folder in `LUMEL_TEST_LOCK`, says so, and sleeps.
#[test]
#[ignore = "a process of another test"]
fn hold_a_lock() {
    let Some(folder) = std::env::var_os("LUMEL_TEST_LOCK") else { return };
    let lock = FolderLock::acquire(Path::new(&folder)).unwrap();
    println!("held");
    // Until its stdin is closed.
    let _ = io::stdin().read(&mut [0]);
    drop(lock);
    println!("given back");
}

/// Another process that holds the lock of `folder`.
fn holder(folder: &Path) -> (Child, BufReader<std::process::ChildStdout>) {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--ignored", "--exact", "hold_a_lock", "--nocapture"]).env("LUMEL_TEST_LOCK", folder);
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    while !line.contains("held") {
        line.clear();
        assert!(lines.read_line(&mut line).unwrap() > 0, "the other process holds nothing");
    }
    (child, lines)
}

#[test]
fn a_folder_is_one_process_s() {
    let folder = Folder::new("lock");
    let (mut child, _) = holder(&folder.0);
    let error = FolderLock::acquire(&folder.0).unwrap_err().to_string();
    for part in [&folder.0.display().to_string(), &format!("process {}", child.id()), "since 2", "wait"] {
        assert!(cfg!(windows) || error.contains(part), "{error}");
    }
    // Killed without a word.
    child.kill().unwrap();
    child.wait().unwrap();
    let lock = FolderLock::acquire(&folder.0).unwrap();
    let error = FolderLock::acquire(&folder.0).unwrap_err().to_string();
    assert!(cfg!(windows) || error.contains(&format!("process {}", std::process::id())), "{error}");
    drop(lock);
    assert!(cfg!(windows) || folder.entries().is_empty(), "{:?}", folder.entries());

    // Given back in order.
    let (mut child, mut lines) = holder(&folder.0);
    drop(child.stdin.take());
    lines.read_to_string(&mut String::new()).unwrap();
    assert!(child.wait().unwrap().success());
    FolderLock::acquire(&folder.0).unwrap();
    assert!(FolderLock::acquire(&folder.0.join("missing")).is_err());
}

#[test]
fn a_lock_is_never_held_twice() {
    let folder = Folder::new("contend");
    let holders = AtomicUsize::new(0);
    let taken = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..500 {
                    let Ok(lock) = FolderLock::acquire(&folder.0) else { continue };
                    assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                    taken.fetch_add(1, Ordering::SeqCst);
                    holders.fetch_sub(1, Ordering::SeqCst);
                    drop(lock);
                }
            });
        }
    });
    assert!(taken.into_inner() > 0);
}

/// Not a check, but the figures of `src/store/map.rs`.
#[test]
#[ignore = "a measurement"]
fn time_reading() {
    let folder = Folder::new("time");
    let store = Store::open(&folder.0).unwrap();
    let bytes = noise(200 << 20);
    let time = |what: &str, run: &dyn Fn() -> usize| {
        for _ in 0..3 {
            let start = Instant::now();
            let n = run();
            println!("{what}: {:.1} ms ({n})", start.elapsed().as_secs_f64() * 1e3);
        }
    };
    time("write", &|| {
        store.write("part", key(1), &[&bytes]).unwrap();
        0
    });
    let path = file_of(&store, "part", key(1));
    time("read, mapped and checked", &|| store.read("part", key(1)).unwrap().unwrap().section(0).len());
    time("fs::read", &|| fs::read(&path).unwrap().len());
    time("fs::read and hash", &|| {
        let file = fs::read(&path).unwrap();
        Key::of("x", |h| h.add_bytes(&file)).as_bytes().len()
    });
}

fn lumel(args: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_lumel")).args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn the_command_lists_checks_and_prunes() {
    let folder = Folder::new("command");
    let (output, cache) = (folder.0.display().to_string(), folder.0.join(".lumel"));
    let (code, _, stderr) = lumel(&["cache", "list", &output]);
    assert!(code == Some(1) && stderr.contains("no cache") && !cache.exists(), "{stderr}");
    for usage in [&["cache", "list"][..], &["cache", "prune", &output], &["cache", "prune", &output, "--max-size", "x"]]
    {
        assert_eq!(lumel(usage).0, Some(2), "{usage:?}");
    }

    let store = Store::open(&cache).unwrap();
    store.write("links", key(1), &[&noise(3000)]).unwrap();
    store.write("direct", key(2), &[&noise(1000)]).unwrap();
    used(&file_of(&store, "direct", key(2)), 7300);
    let (code, stdout, _) = lumel(&["cache", "list", &output]);
    assert_eq!(code, Some(0));
    for part in ["links", "direct", &key(1).to_string(), "2 h 01 min ago", "KiB", "all"] {
        assert!(stdout.contains(part), "{part}: {stdout}");
    }
    let (_, stdout, _) = lumel(&["cache", "list", "--json", "--cache", &cache.display().to_string()]);
    let listed: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(listed["entries"][0]["key"], key(2).to_string());
    assert_eq!(listed["size"], store.survey().unwrap().size());

    assert_eq!(lumel(&["--quiet", "cache", "verify", &output]), (Some(0), String::new(), String::new()));
    let path = file_of(&store, "links", key(1));
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[1..]).unwrap();
    for (args, stays) in [(&["cache", "verify", &output][..], true), (&["cache", "verify", "--remove", &output], false)]
    {
        let (code, stdout, stderr) = lumel(args);
        assert!(code == Some(1) && stdout.contains(&key(1).to_string()) && stderr.contains("1 entry"), "{stderr}");
        assert_eq!(path.exists(), stays);
    }
    assert_eq!(lumel(&["cache", "verify", &output]).0, Some(0));
    let (code, stdout, _) = lumel(&["cache", "prune", "--max-size", "1K", &output]);
    assert!(code == Some(0) && stdout.contains("removed") && !store.contains("direct", key(2)), "{stdout}");
}
