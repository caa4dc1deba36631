//! Roles of surfaces, in the extras of nodes; what lies below a node inherits them:
//!
//! ```json
//! "extras": { "lumel": { "casts": false, "receives": true, "lightmapped": true, "skip": false,
//!                        "density": 32, "densityScale": 2 } }
//! ```
//!
//! `density` is in texels per metre; [`crate::scene::role`] says what the others mean.

use super::document::Document;
use crate::error::{Error, Result};
use crate::scene::{Contribution, RoleOpinion};

/// Keys that a bake writes into the same object of a node: they say nothing about a role.
pub const WRITTEN: [&str; 6] = ["page", "texCoord", "scale", "offset", "baked", "realtime"];

/// The key of a participating medium, see [`super::medium`].
const MEDIUM: &str = "medium";

/// The opinions of node `node`.
///
/// # Errors
/// `Invalid` where the object has an unknown key, or a value is of another type or out of range.
pub(super) fn opinion(document: &Document, node: usize) -> Result<RoleOpinion> {
    let extras = document.json.get("nodes").and_then(|n| n.get(node)).and_then(|n| n.get("extras"));
    let Some(lumel) = extras.and_then(|e| e.get("lumel")) else { return Ok(RoleOpinion::default()) };
    let place = || document.place("nodes", node);
    let Some(object) = lumel.as_object() else {
        return Err(Error::invalid(place(), "extras.lumel is no object; give it keys such as \"casts\": false"));
    };
    let known = || RoleOpinion::KEYS.into_iter().chain(Contribution::KEYS);
    let is_known = |key: &&String| known().chain(WRITTEN).chain([MEDIUM]).any(|k| k == key.as_str());
    if let Some(key) = object.keys().find(|key| !is_known(key)) {
        let known = known().chain([MEDIUM]).collect::<Vec<_>>().join(", ");
        let message = format!("extras.lumel has the unknown key {key}; known are {known}");
        return Err(Error::invalid(place(), message));
    }
    let opinion: RoleOpinion = document.parse(lumel, "nodes", node)?;
    match opinion.fault() {
        Some(fault) => Err(Error::invalid(place(), format!("extras.lumel: {fault}"))),
        None => Ok(opinion),
    }
}
