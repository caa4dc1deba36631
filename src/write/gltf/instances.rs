//! EXT_mesh_gpu_instancing: a node that draws its mesh many times has a rectangle and a page for each instance, as instance
//! attributes `_LUMEL_RECT` (scale, then offset) and `_LUMEL_PAGE`.

use super::accessor::Elements;
use super::document::{Document, index};
use super::extras;
use crate::error::{Error, Result};
use crate::write::Baked;
use serde_json::Value;

const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// True where node `node` draws instances.
///
/// # Errors
/// `Invalid` where there is no such node.
pub fn are_in(doc: &Document, node: usize) -> Result<bool> {
    Ok(doc.item("nodes", node)?.get("extensions").is_some_and(|e| e.get(EXTENSION).is_some()))
}

/// Writes the rectangles of the node's surfaces, one an instance. Instances that the scene doesn't hold (their transforms
/// can't be inverted), or that have no lightmap, get an empty one.
///
/// # Errors
/// `Invalid` where the document is broken.
pub fn write_placements(
    doc: &mut Document,
    node: usize,
    baked: &Baked,
    surfaces: &[usize],
    tex_coord: usize,
) -> Result<()> {
    let broken = || Error::invalid(format!("nodes[{node}]"), "has broken instances; export the file again");
    let attributes = |doc: &Document| -> Result<Option<usize>> {
        let extension = doc.item("nodes", node)?.get("extensions").and_then(|e| e.get(EXTENSION));
        let attributes = extension.and_then(|e| e.get("attributes")).and_then(Value::as_object);
        Ok(attributes.and_then(|a| ["TRANSLATION", "ROTATION", "SCALE"].into_iter().find_map(|name| index(a, name))))
    };
    let accessor = attributes(doc)?.ok_or_else(broken)?;
    let count = index(doc.item("accessors", accessor)?, "count").ok_or_else(broken)?;
    let mut rectangles = vec![[0.0; 4]; count];
    let mut pages = vec![[0.0]; count];
    let shown = surfaces.iter().enumerate().filter(|(_, surface)| baked.atlas.is_shown(**surface));
    for (order, surface) in shown {
        // The loader names them by their number.
        let name = &baked.scene.surfaces[*surface].name;
        let number = name.rsplit_once('[').and_then(|(_, n)| n.strip_suffix(']')?.parse().ok()).unwrap_or(order);
        let placement = &baked.atlas.placements[*surface];
        if let (Some(rectangle), Some(page)) = (rectangles.get_mut(number), pages.get_mut(number)) {
            let (scale, offset) = (placement.scale, placement.offset);
            *rectangle = [scale.x, scale.y, offset.x, offset.y];
            // Exact up to 2^24 pages, and what every instancing shader can read.
            *page = [placement.page as f32];
        }
    }
    let written =
        [("_LUMEL_RECT", Elements::floats(rectangles).push(doc)), ("_LUMEL_PAGE", Elements::floats(pages).push(doc))];
    let node = doc.item_mut("nodes", node)?;
    let extension = node.get_mut("extensions").and_then(|e| e.get_mut(EXTENSION)).and_then(|e| e.get_mut("attributes"));
    let attributes = extension.and_then(Value::as_object_mut).ok_or_else(broken)?;
    for (name, accessor) in written {
        attributes.insert(name.into(), accessor.into());
    }
    extras::lumel(node).insert("texCoord".into(), tex_coord.into());
    Ok(())
}
