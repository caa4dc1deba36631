//! How a source of light takes part in a bake: what of its light goes into the lightmap, and which group it belongs to.
//!
//! | mode | in the lightmap | left to the engine |
//! |---|---|---|
//! | `baked` | all of its light | nothing: it is marked as baked, or removed |
//! | `indirect` | what was reflected at least once | its direct light and shadows |
//! | `dynamic` | nothing | everything |
//!
//! Files say it by `token lumel:bake` and `string lumel:group` in USD, and by `bake` and `group` of `extras.lumel` in glTF, for lights,
//! skies and emissive materials; settings by pattern. A material's glow is part of its surface and can't be dynamic.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What of a source's light is baked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BakeMode {
    /// All of it.
    #[default]
    Baked,
    /// What was reflected at least once.
    Indirect,
    /// Nothing.
    Dynamic,
}

impl BakeMode {
    /// The modes by the names that files and settings give them.
    pub const NAMES: [(&'static str, Self); 3] =
        [("baked", Self::Baked), ("indirect", Self::Indirect), ("dynamic", Self::Dynamic)];

    /// The mode called `name`.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, mode)| *mode)
    }

    /// Its name in files, settings and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baked => "baked",
            Self::Indirect => "indirect",
            Self::Dynamic => "dynamic",
        }
    }

    /// What an engine still has to add of the light: none, or `direct`, or `all`.
    pub fn left_to_engine(self) -> Option<&'static str> {
        match self {
            Self::Baked => None,
            Self::Indirect => Some("direct"),
            Self::Dynamic => Some("all"),
        }
    }
}

/// What is said of a source's part in the bake; what is absent is inherited, in the end from the bake's own default.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Contribution {
    pub mode: Option<BakeMode>,
    /// The light group: see [`group_fault`] for what a name may be.
    pub group: Option<Arc<str>>,
    /// Whether a shadow mask is made of it where masks are asked for; none: chosen by its mode.
    pub shadow_mask: Option<bool>,
}

impl Contribution {
    /// The names that glTF's extras give its parts; USD's attributes have `lumel:` before them.
    pub const KEYS: [&'static str; 3] = ["bake", "group", "shadowMask"];

    /// The mode, where nothing is said [`BakeMode::Baked`].
    pub fn mode(&self) -> BakeMode {
        self.mode.unwrap_or_default()
    }

    /// This over what is weaker.
    pub fn over(&self, weaker: &Self) -> Self {
        Self {
            mode: self.mode.or(weaker.mode),
            group: self.group.clone().or_else(|| weaker.group.clone()),
            shadow_mask: self.shadow_mask.or(weaker.shadow_mask),
        }
    }
}

/// Bytes of a group's name, at most: pages name channels by it.
const MOST_BYTES: usize = 64;

/// The group of what belongs to none.
pub const UNGROUPED: &str = "ungrouped";

/// What is wrong with a group's name, where something is.
pub fn group_fault(name: &str) -> Option<String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if name.is_empty() || name.len() > MOST_BYTES || !name.chars().all(is_plain) {
        return Some(format!(
            "the group {name:?} must be named by 1 to {MOST_BYTES} of the characters A-Z a-z 0-9 _ -"
        ));
    }
    (name == UNGROUPED).then(|| format!("the group {UNGROUPED} holds what belongs to none; choose another name"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_there_and_back() {
        for (name, mode) in BakeMode::NAMES {
            assert_eq!((BakeMode::from_name(name), mode.name()), (Some(mode), name));
        }
        assert_eq!(BakeMode::from_name("Baked"), None);
        assert!(group_fault("Key-light_2").is_none());
        for wrong in ["", "a.b", "a b", UNGROUPED, &"x".repeat(65)] {
            assert!(group_fault(wrong).is_some(), "{wrong}");
        }
    }

    #[test]
    fn the_nearest_word_holds() {
        let above = Contribution { mode: Some(BakeMode::Dynamic), group: Some("a".into()), shadow_mask: None };
        let below = Contribution { mode: Some(BakeMode::Indirect), ..Contribution::default() };
        let both = below.over(&above);
        assert_eq!((both.mode(), both.group.as_deref()), (BakeMode::Indirect, Some("a")));
        assert_eq!(Contribution::default().mode(), BakeMode::Baked);
    }
}
