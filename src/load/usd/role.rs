//! Roles of surfaces, as attributes of prims; what lies below a prim inherits them, as constant primvars are:
//!
//! | attribute | |
//! |---|---|
//! | `bool lumel:skip` | left out of the bake, with lights and all |
//! | `bool lumel:casts` | blocks, reflects and shines |
//! | `bool lumel:receives` | its own light is wanted |
//! | `bool lumel:lightmapped` | on pages, not as vertex colours alone |
//! | `float lumel:density` | texels per metre |
//! | `float lumel:densityScale` | factor on the density |
//!
//! Instances inherit what is said on the way to them and within their prototype; those of a point instancer what is said of the
//! instancer. [`crate::scene::role`] says what the roles mean.

use super::read::{self, Reading};
use crate::scene::{Contribution, RoleOpinion};
use openusd::tf::Token;
use openusd::usd::Prim;

/// What else begins with `lumel:` beside what says how lights are baked: what a bake writes, projectors, lobes of materials and media.
const OTHERS: [&str; 9] =
    ["lightmap", "lightmaps", "uvName", "quantity", "baked", "realtime", "projector", "lobes", "medium"];

/// The opinions of `prim`, whose authored properties are `names`, over those that it inherits. Wrong ones are warnings.
pub fn opinion(prim: &Prim, names: &[Token], above: RoleOpinion, w: &mut Reading) -> RoleOpinion {
    let ours = || names.iter().filter_map(|name| name.as_str().strip_prefix("lumel:"));
    if ours().next().is_none() {
        return above;
    }
    for name in ours() {
        let base = name.split(':').next().unwrap_or(name);
        let keys = || RoleOpinion::KEYS.into_iter().chain(Contribution::KEYS);
        if !OTHERS.contains(&base) && !keys().any(|key| key == name) {
            let keys = keys().map(|key| format!("lumel:{key}")).collect::<Vec<_>>().join(", ");
            w.add(format!("{}.lumel:{name}", prim.path()), format!("is no known attribute; known are {keys}"));
        }
    }
    let mut wrong = Vec::new();
    let mut own = RoleOpinion::default();
    for name in ours() {
        let attribute = format!("lumel:{name}");
        let mut flag = |w: &mut Reading| {
            let value = read::boolean(prim, &attribute, w);
            wrong.extend(value.is_none().then(|| attribute.clone()));
            value
        };
        match name {
            "skip" => own.skip = flag(w),
            "casts" => own.casts = flag(w),
            "receives" => own.receives = flag(w),
            "lightmapped" => own.lightmapped = flag(w),
            "density" | "densityScale" => {
                let value = read::float(prim, &attribute, w);
                wrong.extend(value.is_none().then(|| attribute.clone()));
                let slot = if name == "density" { &mut own.density } else { &mut own.density_scale };
                *slot = value;
            }
            _ => {}
        }
    }
    for attribute in wrong {
        w.add(format!("{}.{attribute}", prim.path()), "has no value of its type and was ignored");
    }
    if let Some(fault) = own.fault() {
        w.add(prim.path(), format!("{fault}; what is inherited holds"));
        (own.density, own.density_scale) = (None, None);
    }
    own.over(above)
}
