//! What of a light is baked, in the extras of its node, of the light itself or of a material; what lies below a node inherits it:
//!
//! ```json
//! "extras": { "lumel": { "bake": "indirect", "group": "lamps", "shadowMask": true } }
//! ```
//!
//! [`crate::scene::contribution`] says what they mean.

use crate::error::{Error, Result};
use crate::scene::contribution::{BakeMode, Contribution, group_fault};
use serde_json::Value;

/// What the extras of `object`, at `place`, say.
///
/// # Errors
/// `Invalid` where a value is of another type, or no mode or name.
pub(super) fn opinion(object: Option<&Value>, place: impl Fn() -> String) -> Result<Contribution> {
    let Some(lumel) = object.and_then(|o| o.get("extras")?.get("lumel")) else { return Ok(Contribution::default()) };
    let refuse = |message: String| Err(Error::invalid(place(), format!("extras.lumel: {message}")));
    let mode = match lumel.get("bake") {
        None => None,
        Some(value) => match value.as_str().and_then(BakeMode::from_name) {
            Some(mode) => Some(mode),
            None => return refuse(format!("bake is {value}; it can be \"baked\", \"indirect\" or \"dynamic\"")),
        },
    };
    let group = match lumel.get("group") {
        None => None,
        Some(Value::String(name)) => match group_fault(name) {
            None => Some(name.as_str().into()),
            Some(fault) => return refuse(fault),
        },
        Some(value) => return refuse(format!("group is {value}, which is no name")),
    };
    let shadow_mask = match lumel.get("shadowMask") {
        None => None,
        Some(Value::Bool(is)) => Some(*is),
        Some(value) => return refuse(format!("shadowMask is {value}; it can be true or false")),
    };
    Ok(Contribution { mode, group, shadow_mask })
}
