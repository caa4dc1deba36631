//! What of a light, dome or emissive material is baked, as attributes of its prim; what lies below a prim inherits them:
//!
//! | attribute | |
//! |---|---|
//! | `token lumel:bake` | `baked`, `indirect` or `dynamic` |
//! | `string lumel:group` | its light group |
//! | `bool lumel:shadowMask` | whether a shadow mask is made of it |
//!
//! [`crate::scene::contribution`] says what they mean.

use super::read::{self, Reading};
use crate::scene::contribution::{BakeMode, Contribution, group_fault};
use openusd::tf::Token;
use openusd::usd::Prim;

/// What `prim`, whose authored properties are `names`, says, over what it inherits. Wrong values are warnings.
pub fn opinion(prim: &Prim, names: &[Token], above: &Contribution, w: &mut Reading) -> Contribution {
    let has = |key: &str| names.iter().any(|name| name.as_str().strip_prefix("lumel:") == Some(key));
    if !Contribution::KEYS.iter().any(|key| has(key)) {
        return above.clone();
    }
    let mut own = Contribution::default();
    let place = |attribute: &str| format!("{}.{attribute}", prim.path());
    if has("bake") {
        own.mode = read::token(prim, "lumel:bake", w).as_deref().and_then(BakeMode::from_name);
        if own.mode.is_none() {
            w.add(place("lumel:bake"), "is none of baked, indirect and dynamic, and was ignored");
        }
    }
    if has("group") {
        match read::token(prim, "lumel:group", w) {
            None => w.add(place("lumel:group"), "has no value of its type and was ignored"),
            Some(name) => match group_fault(&name) {
                Some(fault) => w.add(place("lumel:group"), format!("{fault}; it was ignored")),
                None => own.group = Some(name.as_str().into()),
            },
        }
    }
    if has("shadowMask") {
        own.shadow_mask = read::boolean(prim, "lumel:shadowMask", w);
        if own.shadow_mask.is_none() {
            w.add(place("lumel:shadowMask"), "has no value of its type and was ignored");
        }
    }
    own.over(above)
}
