//! Which surfaces a light shines on, and which stand in its way.

use std::sync::Arc;

/// The surfaces that a light is linked to (UsdLux: the collections `lightLink` and `shadowLink` of LightAPI).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Links {
    /// Surfaces that the light shines on.
    pub lit: Linked,
    /// Surfaces that block the light.
    pub blockers: Linked,
}

/// A set of surfaces, by index into [`super::Scene::surfaces`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Linked {
    /// Every surface.
    #[default]
    All,
    /// Those for which it says true; one a surface.
    Only(Arc<[bool]>),
}

impl Links {
    /// True where the light knows every surface.
    pub fn are_all(&self) -> bool {
        self.lit == Linked::All && self.blockers == Linked::All
    }

    /// Follows the removal of the surfaces for which `keep`, one a surface, is false.
    pub fn retain(&mut self, keep: &[bool]) {
        self.lit.retain(keep);
        self.blockers.retain(keep);
    }
}

impl Linked {
    /// Those for which `members`, one a surface, is true.
    pub fn only(members: Vec<bool>) -> Self {
        if members.iter().all(|m| *m) { Self::All } else { Self::Only(members.into()) }
    }

    /// No surface.
    pub fn none(surfaces: usize) -> Self {
        Self::Only(vec![false; surfaces].into())
    }

    /// True where `surface` is one of them.
    #[inline]
    pub fn holds(&self, surface: u32) -> bool {
        match self {
            Self::All => true,
            Self::Only(members) => members.get(surface as usize).copied().unwrap_or(false),
        }
    }

    /// How many they are, of `surfaces`.
    pub fn count(&self, surfaces: usize) -> usize {
        match self {
            Self::All => surfaces,
            Self::Only(members) => members.iter().filter(|m| **m).count(),
        }
    }

    fn retain(&mut self, keep: &[bool]) {
        if let Self::Only(members) = self {
            *members = members.iter().zip(keep).filter(|(_, keep)| **keep).map(|(member, _)| *member).collect();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_follow_surfaces_that_are_removed() {
        let mut links = Links { lit: Linked::only(vec![true, false, true]), blockers: Linked::All };
        links.retain(&[false, true, true]);
        assert!(!links.lit.holds(0) && links.lit.holds(1) && !links.lit.holds(2));
        assert!(links.blockers.holds(7));
        assert_eq!(Linked::only(vec![true; 3]), Linked::All);
    }
}
