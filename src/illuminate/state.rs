//! What a bake was of: what the next one compares itself with, to see what has changed.

use crate::digest;
use crate::scene::{Scene, Surface};
use crate::store::{Entry, Key};
use crate::unwrap::{Atlas, Places};
use crate::work::{Change, Stored};
use glam::Vec3;
use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;

/// Where more than this share of the patches has changed, all is found anew.
const MOST_CHANGED: f64 = 0.5;

/// Boxes around what changed, at most; looking in the directions of more of them costs more than it saves.
const MOST_BOXES: usize = 32;

/// Boxes are joined where the one around both has no more than so many times the area of both: more where they touch, as the sides of
/// one thing do.
const JOINED: f32 = 1.2;
const TOUCHING: f32 = 2.4;

/// What a bake was of.
#[derive(Clone, Debug)]
pub struct State {
    /// What its results depended on.
    base: Key,
    surfaces: Vec<Known>,
    /// Where surfaces lay, as far as a later atlas can keep that.
    places: Option<Places>,
}

/// What is known of a surface.
#[derive(Clone, Debug)]
struct Known {
    /// Its shape, where it stands, and what of it decides where light passes.
    what: Key,
    /// Its name and shape, wherever it stands.
    who: Key,
    /// The texels that it covers.
    place: Key,
    /// Around it [m].
    bounds: [Vec3; 2],
    patches: Range<u32>,
}

/// What tells a surface from others, with its texels or without.
type Mark = fn(&Known) -> (Key, Option<Key>);

impl State {
    /// The state of `scene` with lightmap UVs, of which results depend on `base`; `patches` are those of each surface, where they are known.
    pub fn new(scene: &Scene, atlas: &Atlas, base: Key, patches: &[Range<u32>]) -> Self {
        let shapes: Vec<Key> = scene.meshes.iter().map(digest::mesh).collect();
        let who = |surface: &Surface| {
            Key::of("who 1", |hasher| {
                hasher.add_str(&surface.name);
                hasher.add_key(shapes[surface.mesh]);
            })
        };
        let known = |(s, (what, place)): (usize, (Key, Key))| Known {
            what,
            who: who(&scene.surfaces[s]),
            place,
            bounds: scene.surface_bounds(s).unwrap_or([Vec3::ZERO; 2]),
            patches: patches.get(s).cloned().unwrap_or_default(),
        };
        let keys = digest::surfaces(scene).into_iter().zip(digest::places(scene, atlas));
        Self { base, surfaces: keys.enumerate().map(known).collect(), places: None }
    }

    /// The same with what a later atlas can keep of this one's `places`.
    pub fn laid_out(self, places: Option<Places>) -> Self {
        Self { places, ..self }
    }

    /// What a later atlas can keep.
    pub fn places(&self) -> Option<&Places> {
        self.places.as_ref()
    }

    /// What is otherwise than in the bake `before`: its base, and the change; `None` where that one is of no use.
    pub fn since(&self, before: &Self) -> Option<(Key, Change)> {
        if self.base == before.base {
            return None;
        }
        let pairs = self.pairs(before);
        let mut change = Change { patches: before.patches(), ..Change::default() };
        let mut boxes = Vec::new();
        let mut is_gone = vec![true; before.surfaces.len()];
        let mut same = 0;
        for (s, (now, &pair)) in self.surfaces.iter().zip(&pairs).enumerate() {
            let old = pair.map(|k| &before.surfaces[k]);
            let is_same = old.is_some_and(|old| old.what == now.what && old.place == now.place);
            if let Some(k) = pair {
                is_gone[k] = false;
            }
            if !is_same {
                boxes.extend(old.map(|old| old.bounds).into_iter().chain([now.bounds]));
            }
            same += old.filter(|_| is_same).map_or(0, |old| old.patches.len());
            change.renumbers |= is_same && pair != Some(s);
            change.surfaces.push(!is_same);
            change.runs.push(old.filter(|old| old.place == now.place).map(|old| old.patches.clone()));
        }
        boxes.extend(before.surfaces.iter().zip(&is_gone).filter(|(_, gone)| **gone).map(|(old, _)| old.bounds));
        change.boxes = joined(boxes);
        let is_useful = change.boxes.len() <= MOST_BOXES
            && !change.boxes.is_empty()
            && same as f64 >= (1.0 - MOST_CHANGED) * f64::from(change.patches);
        is_useful.then_some((before.base, change))
    }

    /// Which surface of `before` each is: one that is just the same, else one that stands there with other texels, else one of that name and
    /// shape with the same texels.
    fn pairs(&self, before: &Self) -> Vec<Option<usize>> {
        let mut pairs = vec![None; self.surfaces.len()];
        let mut is_taken = vec![false; before.surfaces.len()];
        let keys: [Mark; 4] = [
            |known| (known.what, Some(known.place)),
            |known| (known.what, None),
            |known| (known.who, Some(known.place)),
            |known| (known.who, None),
        ];
        for key in keys {
            let mut left: HashMap<(Key, Option<Key>), Vec<usize>> = HashMap::new();
            for (k, old) in before.surfaces.iter().enumerate().rev().filter(|(k, _)| !is_taken[*k]) {
                left.entry(key(old)).or_default().push(k);
            }
            for (pair, now) in pairs.iter_mut().zip(&self.surfaces).filter(|(pair, _)| pair.is_none()) {
                *pair = left.get_mut(&key(now)).and_then(Vec::pop);
                if let Some(k) = *pair {
                    is_taken[k] = true;
                }
            }
        }
        pairs
    }

    fn patches(&self) -> u32 {
        self.surfaces.iter().map(|known| known.patches.end).max().unwrap_or(0)
    }
}

/// Boxes around the same, fewer of them where they lie close together.
fn joined(boxes: Vec<[Vec3; 2]>) -> Vec<[Vec3; 2]> {
    let around = |[a, b]: [Vec3; 2], [c, d]: [Vec3; 2]| [a.min(c), b.max(d)];
    let area = |[low, high]: [Vec3; 2]| {
        let side = high - low;
        side.x * side.y + side.y * side.z + side.z * side.x
    };
    let touches = |[a, b]: [Vec3; 2], [c, d]: [Vec3; 2]| a.cmple(d).all() && c.cmple(b).all();
    let is_joined = |a: [Vec3; 2], b: [Vec3; 2]| {
        let most = if touches(a, b) { TOUCHING } else { JOINED };
        area(around(a, b)) <= most * (area(a) + area(b))
    };
    let mut all: Vec<[Vec3; 2]> = Vec::new();
    for mut next in boxes {
        while let Some(k) = all.iter().position(|other| is_joined(next, *other)) {
            next = around(next, all.swap_remove(k));
        }
        all.push(next);
    }
    all
}

impl Stored for State {
    fn sections(&self) -> Vec<Cow<'_, [u8]>> {
        let of_surface = |known: &Known| [known.what, known.who, known.place];
        let keys = [self.base].into_iter().chain(self.surfaces.iter().flat_map(of_surface));
        let keys: Vec<u8> = keys.flat_map(|key| *key.as_bytes()).collect();
        let bounds: Vec<f32> =
            self.surfaces.iter().flat_map(|s| s.bounds).flat_map(|corner| corner.to_array()).collect();
        let ends: Vec<u32> = self.surfaces.iter().map(|known| known.patches.end).collect();
        let places = serde_json::to_vec(&self.places).unwrap_or_default();
        vec![
            Cow::Owned(keys),
            Cow::Owned(bytemuck::cast_slice(&bounds).to_vec()),
            Cow::Owned(bytemuck::cast_slice(&ends).to_vec()),
            Cow::Owned(places),
        ]
    }

    fn restore(entry: &Entry) -> Option<Self> {
        let mut keys = entry.slice::<[u8; Key::BYTES]>(0).ok()?.iter().map(|bytes| Key::from_bytes(*bytes));
        let base = keys.next()?;
        let (bounds, ends) = (entry.slice::<[[f32; 3]; 2]>(1).ok()?, entry.slice::<u32>(2).ok()?);
        let mut first = 0;
        let mut surfaces = Vec::new();
        for (bounds, &end) in bounds.iter().zip(ends) {
            let [what, who, place] = [keys.next()?, keys.next()?, keys.next()?];
            if end < first {
                return None;
            }
            surfaces.push(Known { what, who, place, bounds: bounds.map(Vec3::from_array), patches: first..end });
            first = end;
        }
        let is_whole = surfaces.len() == bounds.len() && surfaces.len() == ends.len() && keys.next().is_none();
        let places = serde_json::from_slice(entry.section(3)).ok()?;
        is_whole.then_some(Self { base, surfaces, places })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_that_lie_close_are_one() {
        let cube = |at: f32| [Vec3::splat(at), Vec3::splat(at + 1.0)];
        assert_eq!(joined(vec![cube(0.0), cube(0.1), cube(9.0)]).len(), 2);
        assert_eq!(joined(vec![cube(0.0), cube(5.0), cube(10.0)]).len(), 3);
        // The sides of a box.
        let (o, x, y, z) = (Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z);
        let sides = [[o, x + y], [o, y + z], [o, z + x], [x, Vec3::ONE], [y, Vec3::ONE], [z, Vec3::ONE]];
        assert_eq!(joined(sides.to_vec()), [[o, Vec3::ONE]]);
        let [low, high] = joined(vec![cube(0.0), cube(0.1)])[0];
        assert_eq!([low, high], [Vec3::ZERO, Vec3::splat(1.1)]);
    }
}
