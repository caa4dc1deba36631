//! Leaves out what the edits replaced: accessors and buffer views that nothing refers to any more, and their bytes.
//!
//! Indices of what the source had don't change: appended items move into the places that became free. An item stays where
//! an extension that isn't known here might refer to it.

use super::document::{Document, index};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// What a document referred to before it was edited.
pub struct Before {
    accessors: BTreeSet<usize>,
    views: BTreeSet<usize>,
    accessor_count: usize,
    view_count: usize,
}

/// Extensions that are known not to refer to accessors or views, or to do so where this module looks.
const KNOWN: [&str; 10] = [
    "EXT_lights_area",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_texture_transform",
    "MOZ_lightmap",
    "MOZ_texture_rgbe",
    "MX_lightmap",
    "NEEDLE_lightmaps",
];

impl Before {
    /// Notes what is referred to now.
    pub fn new(doc: &mut Document) -> Self {
        Self {
            accessors: used(doc, accessor_references),
            views: used(doc, view_references),
            accessor_count: doc.count("accessors"),
            view_count: doc.count("bufferViews"),
        }
    }

    /// Leaves out what has been replaced since.
    pub fn compact(&self, doc: &mut Document) {
        let mut numbers = BTreeSet::new();
        doc.root().values().for_each(|v| unknown_numbers(v, false, &mut numbers));
        let free = &(&self.accessors - &used(doc, accessor_references)) - &numbers;
        fill(doc, "accessors", self.accessor_count, free, accessor_references);
        let free = &(&self.views - &used(doc, view_references)) - &numbers;
        fill(doc, "bufferViews", self.view_count, free, view_references);
        drop_bytes(doc);
    }
}

/// Calls its second argument with every place of a document that holds an index of one kind.
type References = fn(&mut Document, &mut dyn FnMut(&mut Value));

fn used(doc: &mut Document, references: References) -> BTreeSet<usize> {
    let mut used = BTreeSet::new();
    references(doc, &mut |v| used.extend(v.as_u64().and_then(|v| usize::try_from(v).ok())));
    used
}

/// Moves the items of `list` from `first` on into the places `free`, and removes those that are left at the end.
fn fill(doc: &mut Document, list: &str, first: usize, free: BTreeSet<usize>, references: References) {
    let Some(items) = doc.root_mut().get_mut(list).and_then(Value::as_array_mut) else { return };
    let appended = items.split_off(first.min(items.len()));
    let mut free = free.into_iter();
    let mut moved = Vec::with_capacity(appended.len());
    for item in appended {
        match free.next() {
            Some(place) => {
                items[place] = item;
                moved.push(place);
            }
            None => {
                items.push(item);
                moved.push(items.len() - 1);
            }
        }
    }
    let rest: BTreeSet<usize> = free.collect();
    while items.len().checked_sub(1).is_some_and(|last| rest.contains(&last)) {
        items.pop();
    }
    // What can't be removed without renumbering at least holds no data.
    let len = items.len();
    for place in rest.into_iter().filter(|place| *place < len) {
        if list == "accessors"
            && let Some(item) = items[place].as_object_mut()
        {
            item.retain(|key, _| matches!(key.as_str(), "componentType" | "type" | "count" | "min" | "max"));
        }
    }
    references(doc, &mut |v| {
        let old = v.as_u64().and_then(|v| usize::try_from(v).ok()).and_then(|v| v.checked_sub(first));
        if let Some(new) = old.and_then(|old| moved.get(old)) {
            *v = (*new).into();
        }
    });
}

/// Calls `f` with every place that holds an accessor's index.
fn accessor_references(doc: &mut Document, f: &mut dyn FnMut(&mut Value)) {
    fn each(value: Option<&mut Value>) -> impl Iterator<Item = &mut Value> {
        value.and_then(Value::as_array_mut).into_iter().flatten()
    }
    fn all(value: Option<&mut Value>) -> impl Iterator<Item = &mut Value> {
        value.and_then(Value::as_object_mut).into_iter().flat_map(|o| o.values_mut())
    }
    let root = doc.root_mut();
    for mesh in each(root.get_mut("meshes")) {
        for primitive in each(mesh.get_mut("primitives")) {
            all(primitive.get_mut("attributes")).for_each(&mut *f);
            primitive.get_mut("indices").into_iter().for_each(&mut *f);
            each(primitive.get_mut("targets")).flat_map(|t| all(Some(t))).for_each(&mut *f);
        }
    }
    for animation in each(root.get_mut("animations")) {
        for sampler in each(animation.get_mut("samplers")) {
            ["input", "output"].into_iter().for_each(|k| sampler.get_mut(k).into_iter().for_each(&mut *f));
        }
    }
    for skin in each(root.get_mut("skins")) {
        skin.get_mut("inverseBindMatrices").into_iter().for_each(&mut *f);
    }
    for node in each(root.get_mut("nodes")) {
        let instancing = node.get_mut("extensions").and_then(|e| e.get_mut("EXT_mesh_gpu_instancing"));
        all(instancing.and_then(|i| i.get_mut("attributes"))).for_each(&mut *f);
    }
}

/// Calls `f` with every place that holds a buffer view's index: `bufferView` keys, wherever they stand.
fn view_references(doc: &mut Document, f: &mut dyn FnMut(&mut Value)) {
    fn walk(value: &mut Value, f: &mut dyn FnMut(&mut Value)) {
        match value {
            Value::Object(object) => {
                for (key, value) in object.iter_mut().filter(|(key, _)| *key != "extras") {
                    if key == "bufferView" { f(value) } else { walk(value, f) }
                }
            }
            Value::Array(items) => items.iter_mut().for_each(|v| walk(v, f)),
            _ => {}
        }
    }
    doc.root_mut().iter_mut().filter(|(key, _)| *key != "extras").for_each(|(_, value)| walk(value, f));
}

/// All integers inside extensions that might be references.
fn unknown_numbers(value: &Value, inside: bool, numbers: &mut BTreeSet<usize>) {
    match value {
        Value::Object(object) => {
            for (key, value) in object.iter().filter(|(key, _)| *key != "extras") {
                match value.as_object().filter(|_| !inside && key == "extensions") {
                    Some(extensions) => {
                        let known = |name: &str| KNOWN.contains(&name) || name.starts_with("KHR_materials_");
                        extensions
                            .iter()
                            .filter(|(name, _)| !known(name))
                            .for_each(|(_, v)| unknown_numbers(v, true, numbers));
                    }
                    None => unknown_numbers(value, inside, numbers),
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|v| unknown_numbers(v, inside, numbers)),
        value if inside => numbers.extend(value.as_u64().and_then(|v| usize::try_from(v).ok())),
        _ => {}
    }
}

/// Leaves out bytes of the buffer that no view covers.
fn drop_bytes(doc: &mut Document) {
    // Ranges that overlap or touch stay together, so that views over shared bytes keep sharing them.
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    each_range(doc, &mut |range| {
        let start = index(range, "byteOffset").unwrap_or(0);
        ranges.push((start, start.saturating_add(index(range, "byteLength").unwrap_or(0))));
    });
    ranges.sort_unstable();
    let mut kept: Vec<(usize, usize)> = Vec::new();
    for (start, end) in ranges {
        let end = end.min(doc.bin.len());
        match kept.last_mut() {
            Some(last) if start <= last.1 => last.1 = last.1.max(end),
            _ if start < end => kept.push((start, end)),
            _ => {}
        }
    }
    let mut bin = Vec::with_capacity(doc.bin.len());
    let mut places = Vec::with_capacity(kept.len());
    for (start, end) in kept {
        // The same alignment as before, whatever it was.
        while bin.len() % 16 != start % 16 {
            bin.push(0);
        }
        places.push((start, bin.len()));
        bin.extend_from_slice(&doc.bin[start..end]);
    }
    if bin.len() >= doc.bin.len() {
        return;
    }
    each_range(doc, &mut |range| {
        let start = index(range, "byteOffset").unwrap_or(0);
        let after = places.partition_point(|(old, _)| *old <= start);
        if let Some((old, new)) = after.checked_sub(1).and_then(|i| places.get(i))
            && (start != 0 || range.contains_key("byteOffset") || *new != 0)
        {
            range.insert("byteOffset".into(), json!(start - old + new));
        }
    });
    doc.bin = bin;
}

/// Calls `f` with every object that is a range of the buffer: views, and what extensions of views name.
fn each_range(doc: &mut Document, f: &mut dyn FnMut(&mut super::document::Object)) {
    let views = doc.root_mut().get_mut("bufferViews").and_then(Value::as_array_mut);
    for view in views.into_iter().flatten().filter_map(Value::as_object_mut) {
        f(view);
        let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
        let inner = extensions.into_iter().flat_map(|e| e.values_mut()).filter_map(Value::as_object_mut);
        inner.filter(|e| e.contains_key("buffer")).for_each(&mut *f);
    }
}
