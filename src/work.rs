//! Work that is the same wherever and whenever it is done: found in a store, or done and put there.
//!
//! A result is a function of what its key is the hash of, so that it doesn't matter who finds it. That one idea gives four: a bake finds
//! what an earlier one left (a cache); one that was killed goes on where it was (resume), as large work is put down part by part;
//! processes that share a store share the work, each starting at another part and taking over what the others haven't (shards); and
//! parts that were done on machines which share nothing can be brought together in one folder.

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::store::{Entry, Hasher, Key, Store};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long one waits for what others are doing before looking again.
const PAUSE: Duration = Duration::from_millis(50);

/// One of several processes that do one bake together.
///
/// Written `2/8`, from 1; `2/8 alone` where others work elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Shard {
    /// From 0.
    pub index: usize,
    pub count: usize,
    /// Others work elsewhere: only parts of its own are done, and what others do must be brought.
    pub alone: bool,
}

/// Shards at most.
pub const MOST_SHARDS: usize = 4096;

impl TryFrom<String> for Shard {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        let (numbers, alone) = match text.trim().strip_suffix("alone") {
            Some(numbers) => (numbers.trim_end(), true),
            None => (text.trim(), false),
        };
        let number = |text: &str| text.trim().parse::<usize>().ok().filter(|n| (1..=MOST_SHARDS).contains(n));
        let parts = numbers.split_once('/').and_then(|(index, count)| Some((number(index)?, number(count)?)));
        match parts {
            Some((index, count)) if index <= count => Ok(Self { index: index - 1, count, alone }),
            _ => Err(format!("`{text}` is no shard, as 1/8 to 8/8 are (at most {MOST_SHARDS})")),
        }
    }
}

/// What is otherwise than in a bake before.
#[derive(Clone, Debug, Default)]
pub struct Change {
    /// Which of the surfaces there are now have changed or moved, lie elsewhere on pages, or are new.
    pub surfaces: Vec<bool>,
    /// Boxes around each of them, before and now, and around what is gone: lowest and highest corners [m].
    pub boxes: Vec<[Vec3; 2]>,
    /// The patches that each surface had before, where they are those that it has now.
    pub runs: Vec<Option<Range<u32>>>,
    /// Patches before.
    pub patches: u32,
    /// Some surfaces that haven't changed have other numbers than before: what is by number may be about others.
    pub renumbers: bool,
}

impl Change {
    /// The number that each patch of before has now, where surfaces have the patches `now`: [`NONE`](Self::NONE) where it is gone.
    /// `None` where surfaces that haven't changed aren't of as many patches.
    pub fn numbers(&self, now: &[Range<u32>]) -> Option<Vec<u32>> {
        let mut numbers = vec![Self::NONE; self.patches as usize];
        for ((now, before), is_changed) in now.iter().zip(&self.runs).zip(&self.surfaces) {
            match before.as_ref().filter(|before| before.len() == now.len()) {
                Some(before) => {
                    let run = numbers.get_mut(before.start as usize..before.end as usize)?;
                    run.iter_mut().zip(now.clone()).for_each(|(number, i)| *number = i);
                }
                None if *is_changed => {}
                None => return None,
            }
        }
        (now.len() == self.runs.len()).then_some(numbers)
    }

    /// No patch.
    pub const NONE: u32 = u32::MAX;
}

/// Digits of a base that tell its parts from those of others.
const PREFIX: usize = 16;

/// A result that can be stored.
pub trait Stored: Sized {
    /// Its content.
    fn sections(&self) -> Vec<Cow<'_, [u8]>>;
    /// What has this content; `None` where nothing can have it.
    fn restore(entry: &Entry) -> Option<Self>;
}

/// Work that is done in parts, in any order.
pub trait Job {
    /// Does a part.
    ///
    /// # Errors
    /// `Cancelled`.
    fn make(&mut self, part: usize) -> Result<()>;
    /// What it takes to have a part done without doing it.
    fn write(&self, part: usize) -> Vec<u8>;
    /// Takes a part that was done before; `None` where it isn't one.
    fn read(&mut self, part: usize, bytes: &[u8]) -> Option<()>;
}

/// Results of one kind that were wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// Found in the store, and good enough.
    pub reused: u64,
    /// Found anew.
    pub anew: u64,
}

/// Where results are found and put, and which of the work is whose.
pub struct Work<'a> {
    store: Option<&'a Store>,
    /// What all results depend on.
    base: Key,
    shard: Option<Shard>,
    /// Work that took less altogether isn't worth putting down in parts.
    apart: Duration,
    since: Instant,
    /// There was no room.
    is_full: AtomicBool,
    /// What the results of the bake before depended on, and what has changed since.
    before: Option<(Key, Change)>,
    /// By kind: how many results were asked for, and made.
    counts: Mutex<BTreeMap<String, [u64; 2]>>,
}

/// The key of a result of `kind` that depends on `base` and on what `add` adds.
fn key(kind: &str, base: Key, add: impl FnOnce(&mut Hasher)) -> Key {
    Key::of(kind, |hasher| {
        hasher.add_key(base);
        add(hasher);
    })
}

impl<'a> Work<'a> {
    /// Nothing is found, and nothing put anywhere.
    pub fn unstored() -> Self {
        Self::within(None, Key::from_bytes([0; Key::BYTES]), None, Duration::MAX)
    }

    /// For results that all depend on `base`. Parts are put down once work has taken `apart`, or at once where others wait for them.
    pub fn new(store: &'a Store, base: Key, shard: Option<Shard>, apart: Duration) -> Self {
        Self::within(Some(store).filter(|store| !store.is_none()), base, shard, apart)
    }

    fn within(store: Option<&'a Store>, base: Key, shard: Option<Shard>, apart: Duration) -> Self {
        let (since, is_full) = (Instant::now(), AtomicBool::new(false));
        Self { store, base, shard, apart, since, is_full, before: None, counts: Mutex::default() }
    }

    /// The same, which can start from results that depended on `base`, where no more than `change` has changed since.
    pub fn after(self, base: Key, change: Change) -> Self {
        Self { before: Some((base, change)), ..self }
    }

    /// Results that were wanted so far, by kind; none without a store.
    pub fn tally(&self) -> BTreeMap<String, Tally> {
        let counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        let tally = |&[asked, made]: &[u64; 2]| Tally { reused: asked.saturating_sub(made), anew: made };
        counts.iter().map(|(kind, counts)| (kind.clone(), tally(counts))).collect()
    }

    /// True where some result was found that was remembered, or may have been made from those of a bake before.
    pub fn has_reused(&self) -> bool {
        self.before.is_some() || self.tally().values().any(|tally| tally.reused > 0)
    }

    /// Counts a result of `kind` as asked for.
    pub fn ask(&self, kind: &str) {
        self.count(kind, 1, 0);
    }

    /// Counts results of `kind` that were asked for, and made.
    fn count(&self, kind: &str, asked: u64, made: u64) {
        if self.store.is_none() {
            return;
        }

        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = counts.entry(kind.to_string()).or_default();
        *counts = [counts[0] + asked, counts[1] + made];
    }

    /// True where there is a result of `kind` that depends on the base and on what `add` adds. It isn't read.
    pub fn has(&self, kind: &str, add: impl FnOnce(&mut Hasher)) -> bool {
        self.store.is_some_and(|store| store.contains(kind, self.key(kind, add)))
    }

    /// Which of the work is this process's; none: all of it.
    pub fn shard(&self) -> Option<Shard> {
        self.shard
    }

    fn key(&self, kind: &str, add: impl FnOnce(&mut Hasher)) -> Key {
        key(kind, self.base, add)
    }

    /// As [`find`](Self::find), of the bake before, and what has changed since.
    ///
    /// # Errors
    /// `Io` where the store can't be read.
    pub fn find_before<T: Stored>(&self, kind: &str, add: impl FnOnce(&mut Hasher)) -> Result<Option<(T, &Change)>> {
        let (Some(store), Some((base, change))) = (self.store, &self.before) else { return Ok(None) };
        let entry = store.read(kind, key(kind, *base, add))?;
        Ok(entry.as_ref().and_then(T::restore).map(|found| (found, change)))
    }

    /// The result of `kind` that depends on the base and on what `add` adds, where there is one.
    ///
    /// # Errors
    /// `Io` where the store can't be read.
    pub fn find<T: Stored>(&self, kind: &str, add: impl FnOnce(&mut Hasher)) -> Result<Option<T>> {
        self.ask(kind);
        self.read(kind, add)
    }

    fn read<T: Stored>(&self, kind: &str, add: impl FnOnce(&mut Hasher)) -> Result<Option<T>> {
        let Some(store) = self.store else { return Ok(None) };
        Ok(store.read(kind, self.key(kind, add))?.as_ref().and_then(T::restore))
    }

    /// Keeps `result` so that [`find`](Self::find) finds it.
    ///
    /// # Errors
    /// `Io` where others wait for it.
    pub fn keep<T: Stored>(&self, kind: &str, add: impl FnOnce(&mut Hasher), result: &T) -> Result<()> {
        let Some(store) = self.store else { return Ok(()) };
        self.count(kind, 0, 1);
        self.put(store, kind, self.key(kind, add), &result.sections())
    }

    /// The result of `kind` that depends on the base and on what `add` adds: from the store, else by `make`.
    ///
    /// # Errors
    /// Those of `make`; `Io`.
    pub fn once<T: Stored>(
        &self,
        kind: &str,
        add: impl Fn(&mut Hasher),
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        match self.find(kind, &add)? {
            Some(found) => Ok(found),
            None => self.renew(kind, add, make),
        }
    }

    /// As [`once`](Self::once) for work that isn't parted, of which only what is `wanted` counts as found: of several processes that share
    /// the work one makes it, and the others wait for it, or for its end without a result. That it was [asked](Self::ask) for is not
    /// counted.
    ///
    /// # Errors
    /// Those of `make`; `Io`; `Cancelled`.
    pub fn once_in_all<T: Stored>(
        &self,
        kind: &str,
        add: impl Fn(&mut Hasher),
        wanted: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T>,
        progress: &dyn Progress,
    ) -> Result<T> {
        loop {
            // Claimed before it is looked for: who had it may have ended between the two.
            let claim = match self.store.filter(|_| self.shard.is_some()) {
                Some(store) => store.claim(kind, self.key(kind, &add))?,
                None => None,
            };
            if let Some(found) = self.read(kind, &add)?.filter(&wanted) {
                return Ok(found);
            }
            if claim.is_some() || self.shard.is_none() || self.store.is_none() {
                return self.renew(kind, add, make);
            }
            progress.check()?;
            std::thread::sleep(PAUSE);
        }
    }

    /// As [`once`](Self::once), by `make` in any case, in place of what there was.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn renew<T: Stored>(
        &self,
        kind: &str,
        add: impl FnOnce(&mut Hasher),
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let made = make()?;
        self.keep(kind, add, &made)?;
        Ok(made)
    }

    /// Puts a result down. A bake doesn't fail for want of room for what only saves time, unless others wait for it.
    fn put(&self, store: &Store, kind: &str, key: Key, sections: &[Cow<[u8]>]) -> Result<()> {
        if self.is_full.load(Ordering::Relaxed) {
            return Ok(());
        }
        let sections: Vec<&[u8]> = sections.iter().map(AsRef::as_ref).collect();
        match store.write(kind, key, &sections) {
            Err(Error::Io { place, source }) if self.shard.is_none() => {
                self.is_full.store(true, Ordering::Relaxed);
                store.warn(place, format!("{source}: from here on nothing is kept for later bakes"));
                Ok(())
            }
            other => other,
        }
    }

    /// The kind of entries that parts of work of `kind` are, on what the base is of: they can go all at once.
    fn kind_of_parts(&self, kind: &str) -> String {
        format!("{kind}-{}", &self.base.to_string()[..PREFIX])
    }

    /// Lets the parts of work of `kind` go, which nobody needs once what they are for has been found.
    pub fn forget_parts(&self, kind: &str) {
        if let Some(store) = self.store
            && let Err(error) = store.remove_kind(&self.kind_of_parts(kind))
        {
            store.warn("cache", error);
        }
    }

    /// Does the `count` parts of `job`, which depends on the base and on what `add` adds: those that are in the store are taken from
    /// there, those that another process is at are waited for.
    ///
    /// # Errors
    /// Those of the job; `Awaited` where parts of others are to be brought; `Io`.
    pub fn share(
        &self,
        kind: &str,
        add: impl FnOnce(&mut Hasher),
        count: usize,
        job: &mut dyn Job,
        progress: &dyn Progress,
    ) -> Result<()> {
        let Some(store) = self.store else { return (0..count).try_for_each(|part| job.make(part)) };
        let key = self.key(kind, add);
        let parts = &self.kind_of_parts(kind);
        let key = |part: usize| {
            Key::of(kind, |hasher| {
                hasher.add_key(key);
                hasher.add_slice(&[part as u64, count as u64]);
            })
        };
        let first = self.shard.map_or(0, |shard| shard.index * count / shard.count);
        let own = self.shard.map_or(0..count, |shard| first..(shard.index + 1) * count / shard.count);
        let mut left: Vec<usize> = (0..count).map(|k| (first + k) % count).collect();
        loop {
            let mut others = Vec::new();
            for part in left {
                progress.check()?;
                if let Some(entry) = store.read(parts, key(part))?
                    && job.read(part, entry.section(0)).is_some()
                {
                    self.count(kind, 1, 0);
                    continue;
                }
                let is_own = !self.shard.is_some_and(|shard| shard.alone) || own.contains(&part);
                let claim = if is_own && self.shard.is_some() { store.claim(parts, key(part))? } else { None };
                // Who had it may have ended between the two looks.
                if !is_own || self.shard.is_some() && claim.is_none() || store.contains(parts, key(part)) {
                    others.push(part);
                    continue;
                }
                job.make(part)?;
                self.count(kind, 1, 1);
                if self.shard.is_some() || self.since.elapsed() >= self.apart {
                    self.put(store, parts, key(part), &[Cow::Owned(job.write(part))])?;
                }
            }
            if others.is_empty() {
                return Ok(());
            }
            if self.shard.is_some_and(|shard| shard.alone) {
                return Err(Error::Awaited { parts: others.len(), of: count });
            }
            left = others;
            std::thread::sleep(PAUSE);
        }
    }
}
