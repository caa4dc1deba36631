//! What a surface does in a bake: whether it blocks, receives, has a lightmap, and how fine that is.
//!
//! | role | blocks, reflects, shines | has light of its own | texels on a written page | vertex colours |
//! |---|---|---|---|---|
//! | default | yes | yes | yes | yes |
//! | `receives = false` | yes | no | no | no |
//! | `lightmapped = false` | yes | yes | no | yes |
//! | `casts = false` | no | yes | yes | yes |
//!
//! What reflects needs to know the light on it: surfaces without texels on a written page have them on hidden pages, which
//! follow the shown ones in memory and which no file holds. Those that don't receive are laid out at [`HIDDEN_SCALE`] of the
//! density, unless they say another.

use serde::{Deserialize, Serialize};

/// Density of surfaces that no page shows and no colour needs, relative to that of the others: light that is reflected once
/// more is smooth, and a sixteenth of the texels tells it.
pub const HIDDEN_SCALE: f32 = 0.25;

/// The densities [texels per metre], and the factors on one, that can be asked for.
pub const DENSITIES: [f32; 2] = [1e-4, 1e5];
pub const DENSITY_SCALES: [f32; 2] = [1e-3, 1e3];

/// What a surface does in a bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Role {
    /// Not in the bake at all; [`crate::load::load_with`] removes such surfaces.
    pub skip: bool,
    /// Blocks light, reflects it, and shines where its material emits. Otherwise rays pass through it.
    pub casts: bool,
    /// Its own light is wanted.
    pub receives: bool,
    /// Its light is wanted on pages; otherwise as vertex colours alone.
    pub lightmapped: bool,
    /// Its own density [texels per metre]; none: that of the bake.
    pub density: Option<f32>,
    /// Factor on its density.
    pub density_scale: f32,
}

impl Default for Role {
    fn default() -> Self {
        Self { skip: false, casts: true, receives: true, lightmapped: true, density: None, density_scale: 1.0 }
    }
}

impl Role {
    /// True where its texels lie on a page that is written.
    pub fn is_shown(&self) -> bool {
        self.receives && self.lightmapped
    }

    /// In one word for tables: `lit`, or what differs.
    pub fn name(&self) -> &'static str {
        match (self.casts, self.receives, self.lightmapped) {
            (true, true, true) => "lit",
            (true, true, false) => "vertex colours",
            (true, false, _) => "casts only",
            (false, true, true) => "receives only",
            (false, true, false) => "receives vertex colours only",
            (false, false, _) => "none",
        }
    }
}

/// Opinions on a role; what is absent is inherited from above, in the end from [`Role::default`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct RoleOpinion {
    pub skip: Option<bool>,
    pub casts: Option<bool>,
    pub receives: Option<bool>,
    pub lightmapped: Option<bool>,
    /// Texels per metre.
    pub density: Option<f32>,
    pub density_scale: Option<f32>,
}

impl RoleOpinion {
    /// The names that files give the opinions.
    pub const KEYS: [&'static str; 6] = ["skip", "casts", "receives", "lightmapped", "density", "densityScale"];

    /// These opinions over weaker ones.
    pub fn over(self, weaker: Self) -> Self {
        Self {
            skip: self.skip.or(weaker.skip),
            casts: self.casts.or(weaker.casts),
            receives: self.receives.or(weaker.receives),
            lightmapped: self.lightmapped.or(weaker.lightmapped),
            density: self.density.or(weaker.density),
            density_scale: self.density_scale.or(weaker.density_scale),
        }
    }

    /// The role that `role` becomes by these opinions.
    pub fn apply(self, role: Role) -> Role {
        Role {
            skip: self.skip.unwrap_or(role.skip),
            casts: self.casts.unwrap_or(role.casts),
            receives: self.receives.unwrap_or(role.receives),
            lightmapped: self.lightmapped.unwrap_or(role.lightmapped),
            density: self.density.or(role.density),
            density_scale: self.density_scale.unwrap_or(role.density_scale),
        }
    }

    /// What is wrong with a number, where one is out of range.
    pub fn fault(&self) -> Option<String> {
        let fault = |name: &str, value: Option<f32>, [low, high]: [f32; 2], unit: &str| {
            let value = value.filter(|v| !(low..=high).contains(v))?;
            Some(format!("{name} {value} is out of range; allowed are {low} to {high}{unit}"))
        };
        fault("density", self.density, DENSITIES, " texels per metre")
            .or_else(|| fault("density scale", self.density_scale, DENSITY_SCALES, ""))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_opinion_holds() {
        let above = RoleOpinion { casts: Some(false), density: Some(4.0), ..RoleOpinion::default() };
        let below = RoleOpinion { casts: Some(true), density_scale: Some(2.0), ..RoleOpinion::default() };
        let role = below.over(above).apply(Role::default());
        assert_eq!(role, Role { density: Some(4.0), density_scale: 2.0, ..Role::default() });
        assert!(RoleOpinion { density: Some(0.0), ..above }.fault().is_some_and(|f| f.contains("0.0001")));
        assert!(RoleOpinion { density_scale: Some(f32::NAN), ..above }.fault().is_some());
    }
}
