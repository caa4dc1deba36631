//! Which material a prim is bound to (UsdShadeMaterialBindingAPI): direct and collection bindings, inherited down the
//! namespace, with strengths.
//!
//! The walk carries the bindings that it passed as a linked list, so that a prim costs no walk up the namespace. The
//! `preview` purpose is preferred, as its materials are the ones that are understood here, then the general one, then `full`.

use super::read::{self, Reading};
use openusd::sdf::{Path, Value};
use openusd::usd::{CollectionAPI, MembershipQuery, Prim, Stage};
use std::collections::HashMap;
use std::rc::Rc;

/// Purposes of bindings, the preferred ones first.
const PURPOSES: [&str; 3] = ["preview", "", "full"];

/// The bindings on one prim, and those above it.
pub struct Level {
    bindings: Vec<Binding>,
    above: Option<Rc<Level>>,
}

struct Binding {
    /// `preview`, `full`, or empty for all purposes.
    purpose: &'static str,
    material: Path,
    /// The collection that it binds; `None` for a direct binding.
    collection: Option<Path>,
    /// `strongerThanDescendants`.
    strong: bool,
}

/// Membership of the collections that were asked for.
#[derive(Default)]
pub struct Collections(HashMap<Path, Option<MembershipQuery>>);

/// The level of `prim`: `above` where it binds nothing of its own. `names` are its authored properties.
pub fn level(
    prim: &Prim,
    names: &[openusd::tf::Token],
    above: &Option<Rc<Level>>,
    warnings: &mut Reading,
) -> Option<Rc<Level>> {
    let mut bindings = Vec::new();
    for name in names {
        let Some(rest) = name.strip_prefix("material:binding") else { continue };
        let (purpose, is_collection) = match rest.split(':').collect::<Vec<_>>()[..] {
            [""] => ("", false),
            ["", "collection", _] => ("", true),
            ["", "collection", purpose, _] => (purpose, true),
            ["", purpose] => (purpose, false),
            _ => continue,
        };
        let Some(&purpose) = PURPOSES.iter().find(|known| **known == purpose) else { continue };
        let relationship = prim.relationship(name.as_str());
        let targets = match relationship.targets() {
            Ok(targets) => targets,
            Err(error) => {
                warnings.add(relationship.path(), format!("a material binding could not be read: {error}"));
                continue;
            }
        };
        let (collection, material) = match (&targets[..], is_collection) {
            ([collection, material], true) => (Some(collection.clone()), material.clone()),
            ([material], false) => (None, material.clone()),
            ([], _) => continue,
            _ => {
                let message =
                    "a material binding with other targets than one material (and a collection) binds nothing";
                warnings.add(relationship.path(), message);
                continue;
            }
        };
        let strength = relationship.get_metadata::<Value>("bindMaterialAs").ok().flatten().and_then(read::to_text);
        let strong = strength.as_deref() == Some("strongerThanDescendants");
        bindings.push(Binding { purpose, material, collection, strong });
    }
    if bindings.is_empty() {
        return above.clone();
    }
    // A collection binding beats a direct one on the same prim; among collections the property order decides.
    bindings.sort_by_key(|b| b.collection.is_none());
    Some(Rc::new(Level { bindings, above: above.clone() }))
}

/// The levels of `path`'s ancestors, without `path` itself.
pub fn levels_above(stage: &Stage, path: &Path, warnings: &mut Reading) -> Option<Rc<Level>> {
    let mut ancestors: Vec<Path> = path.strict_ancestors_below_root().collect();
    ancestors.reverse();
    let mut above = None;
    for ancestor in ancestors {
        if let Ok(prim) = stage.prim(ancestor) {
            let names = prim.authored_property_names().unwrap_or_default();
            above = level(&prim, &names, &above, warnings);
        }
    }
    above
}

/// The material that the prim at `path`, whose level is `level`, is bound to: the closest binding, unless one above it is
/// stronger than its descendants.
pub fn bound_material(
    stage: &Stage,
    path: &Path,
    level: &Option<Rc<Level>>,
    collections: &mut Collections,
) -> Option<Path> {
    PURPOSES.into_iter().find_map(|purpose| {
        let mut winner = None;
        let mut at = level.as_ref();
        while let Some(here) = at {
            let mut applicable = here.bindings.iter().filter(|b| b.purpose == purpose);
            if let Some(binding) = applicable.find(|b| collections.contains(stage, b.collection.as_ref(), path))
                && (winner.is_none() || binding.strong)
            {
                winner = Some(binding.material.clone());
            }
            at = here.above.as_ref();
        }
        winner
    })
}

impl Collections {
    /// True where `path` is in `collection`, or there is none that restricts the binding.
    fn contains(&mut self, stage: &Stage, collection: Option<&Path>, path: &Path) -> bool {
        let Some(collection) = collection else { return true };
        let query = self.0.entry(collection.clone()).or_insert_with(|| {
            let (prim, name) = CollectionAPI::instance_at_path(collection)?;
            let prim = stage.prim(prim).ok()?;
            CollectionAPI::from_prim_unchecked(prim, name).compute_membership_query().ok()
        });
        query.as_ref().is_some_and(|query| query.is_path_included(path))
    }
}
