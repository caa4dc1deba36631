//! Light and shadow linking: the collections `lightLink` and `shadowLink` of a light, by relationships or by an expression.

use super::light::boolean;
use super::read::{self, Reading};
use crate::scene::{Linked, Links};
use openusd::sdf::Path;
use openusd::usd::{CollectionAPI, MembershipQuery, PathRule, Prim};

/// True where a light is not simply linked to everything.
pub fn is_restricted(prim: &Prim, w: &mut Reading) -> bool {
    ["lightLink", "shadowLink"].iter().any(|link| is_link_restricted(prim, link, w)) || casts_none(prim, w)
}

fn is_link_restricted(prim: &Prim, link: &str, w: &mut Reading) -> bool {
    let collection = |field: &str| format!("collection:{link}:{field}");
    let has_targets = |name: &str| prim.relationship(name).has_authored_targets().unwrap_or(false);
    has_targets(&collection("excludes"))
        || has_targets(&collection("includes"))
        || read::is_authored(prim, &collection("membershipExpression"))
        || read::boolean(prim, &collection("includeRoot"), w) == Some(false)
}

/// `inputs:shadow:enable` is off.
fn casts_none(prim: &Prim, w: &mut Reading) -> bool {
    boolean(prim, "inputs:shadow:enable", w) == Some(false)
}

/// The links of the light `prim` to surfaces with the prim paths `surfaces`.
pub fn links(prim: &Prim, surfaces: &[String], w: &mut Reading) -> Links {
    let lit = members(prim, "lightLink", surfaces, w);
    let blockers =
        if casts_none(prim, w) { Linked::none(surfaces.len()) } else { members(prim, "shadowLink", surfaces, w) };
    if lit.count(surfaces.len()) == 0 {
        w.add(prim.path(), "a light is linked to no surface and lights nothing");
    }
    Links { lit, blockers }
}

/// The surfaces in the collection `name` of `prim`: all where it can't be read.
fn members(prim: &Prim, name: &str, surfaces: &[String], w: &mut Reading) -> Linked {
    if !is_link_restricted(prim, name, w) {
        return Linked::All;
    }
    let collection = CollectionAPI::from_prim_unchecked(prim.clone(), name);
    let query = match collection.compute_membership_query() {
        Ok(query) => query,
        Err(error) => {
            w.add(
                format!("{}: {error}", prim.path()),
                format!("the collection {name} could not be read; it holds all"),
            );
            return Linked::All;
        }
    };
    let expression = format!("collection:{name}:membershipExpression");
    if read::is_authored(prim, &expression)
        && !query.uses_path_expansion_rule_map()
        && query.expression_evaluator().is_none()
    {
        w.add(prim.attribute(expression).path(), "a membership expression could not be read; it holds nothing");
    }
    let is_member = |path: &String| Path::new(path).is_ok_and(|path| holds(&query, &path));
    Linked::only(surfaces.iter().map(is_member).collect())
}

/// Whether `query` holds `path`. As in usd-core, an ancestor that is a member on its own alone says nothing of what lies below it:
/// the ancestors above it do.
fn holds(query: &MembershipQuery, path: &Path) -> bool {
    if !query.uses_path_expansion_rule_map() {
        return query.is_path_included(path);
    }
    let mut at = Some(path.clone());
    while let Some(ancestor) = at {
        match query.rule_map().get(&ancestor) {
            Some(PathRule::Exclude) => return false,
            Some(PathRule::ExplicitOnly) if ancestor != *path => {}
            Some(_) => return true,
            None => {}
        }
        at = ancestor.parent();
    }
    false
}
