//! Light probes that a user asks for: `--probes SPACING`, `probes = SPACING`, or `[[probes]]` in `lumel.toml`.

use crate::error::{Error, Result};
use crate::probe::{Grid, Placement};
use crate::scene::Scene;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Probes at most: 100 bytes each in memory, and several times that in the files.
const MOST_PROBES: u64 = 1 << 20;

/// Which probes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a spacing [m], or tables with positions, or with low, high and spacing")]
pub enum ProbeSetting {
    /// A grid over the bounds of the scene, at most so far apart [m].
    Spacing(f32),
    Sets(Vec<ProbeSet>),
}

/// One set: `positions`, or a box from `low` to `high` with `spacing`; in the world of the bake: metres, Y up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ProbeSet {
    /// [m].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub positions: Vec<[f32; 3]>,
    /// Corners of the box [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub low: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub high: Option<[f32; 3]>,
    /// Largest distance from one probe to the next along each axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spacing: Option<f32>,
}

impl ProbeSetting {
    /// Refuses what is out of range.
    pub(super) fn check(&self) -> Result<()> {
        match self {
            Self::Spacing(spacing) => check_spacing(*spacing),
            Self::Sets(sets) => {
                sets.iter().try_for_each(|set| refuse_many(&set.placement()?))?;
                let count: u64 = sets.iter().filter_map(|set| set.placement().ok()).map(|p| p.len()).sum();
                if count > MOST_PROBES { Err(too_many(count)) } else { Ok(()) }
            }
        }
    }

    /// Where the probes of `scene` stand.
    ///
    /// # Errors
    /// `Invalid` where they are too many, or out of range.
    pub fn placements(&self, scene: &Scene) -> Result<Vec<Placement>> {
        let sets = match self {
            Self::Spacing(spacing) => {
                let [low, high] = scene.bounds().unwrap_or_default();
                vec![Placement::Grid(Grid::new(low, high, *spacing))]
            }
            Self::Sets(sets) => sets.iter().map(ProbeSet::placement).collect::<Result<_>>()?,
        };
        sets.iter().try_for_each(refuse_many)?;
        Ok(sets)
    }
}

impl ProbeSet {
    fn placement(&self) -> Result<Placement> {
        let is_finite = |p: &[f32; 3]| p.iter().all(|v| v.is_finite());
        match (self.low, self.high, self.spacing) {
            (None, None, None) if !self.positions.is_empty() && self.positions.iter().all(is_finite) => {
                Ok(Placement::Positions(self.positions.iter().copied().map(Vec3::from).collect()))
            }
            (Some(low), Some(high), Some(spacing)) if self.positions.is_empty() => {
                check_spacing(spacing)?;
                let (low_v, high_v) = (Vec3::from(low), Vec3::from(high));
                if !(is_finite(&low) && is_finite(&high) && low_v.cmple(high_v).all()) {
                    return Err(Error::invalid("probes", "low and high must be finite, and low not above high [m]"));
                }
                Ok(Placement::Grid(Grid::new(low_v, high_v, spacing)))
            }
            _ => {
                let message = "a set has finite positions, or low, high and spacing; give either, not both";
                Err(Error::invalid("probes", message))
            }
        }
    }
}

fn check_spacing(spacing: f32) -> Result<()> {
    if (1e-3..=1e6).contains(&spacing) {
        return Ok(());
    }
    Err(Error::invalid("probes", format!("{spacing} is out of range; a spacing is 0.001 to 1000000 [m]")))
}

fn refuse_many(placement: &Placement) -> Result<()> {
    if placement.len() > MOST_PROBES { Err(too_many(placement.len())) } else { Ok(()) }
}

fn too_many(count: u64) -> Error {
    let message = format!("would be {count}; at most {MOST_PROBES} are allowed, so raise the spacing");
    Error::invalid("probes", message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> ProbeSetting {
        #[derive(Deserialize)]
        struct File {
            probes: ProbeSetting,
        }
        serde_json::from_str::<File>(text).unwrap().probes
    }

    #[test]
    fn a_number_is_a_spacing_and_a_list_are_sets() {
        assert_eq!(read(r#"{"probes": 2}"#), ProbeSetting::Spacing(2.0));
        let sets =
            read(r#"{"probes": [{"positions": [[0, 1, 0]]}, {"low": [0, 0, 0], "high": [4, 2, 4], "spacing": 1}]}"#);
        sets.check().unwrap();
        let placements = sets.placements(&Scene::default()).unwrap();
        assert_eq!(placements.iter().map(Placement::len).collect::<Vec<_>>(), [1, 32]);
    }

    #[test]
    fn what_is_out_of_range_is_refused() {
        for text in [
            r#"{"probes": 0}"#,
            r#"{"probes": [{}]}"#,
            r#"{"probes": [{"positions": [[0, 0, 0]], "spacing": 1}]}"#,
            r#"{"probes": [{"low": [0, 0, 0], "high": [-1, 1, 1], "spacing": 1}]}"#,
            r#"{"probes": [{"low": [0, 0, 0], "high": [1e6, 1e6, 1e6], "spacing": 0.001}]}"#,
        ] {
            assert!(read(text).check().is_err(), "{text}");
        }
    }
}
