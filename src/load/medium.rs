//! Media as files and settings describe them, turned into the scene's own.
//!
//! | key | |
//! |---|---|
//! | `scattering`, `absorption` | sigma_s and sigma_a [1/m]; also `sigma_s`, `sigma_a` |
//! | `extinction`, `albedo` | sigma_t [1/m] (also `sigma_t`) and the share of it that scatters, in place of those |
//! | `density` | factor on them (default 1); with an albedo and no extinction it is the extinction [1/m] itself |
//! | `emission` | radiance per metre at density 1 [nit/m] |
//! | `g` | mean cosine, -0.99 to 0.99 (default 0: isotropic) |
//! | `shape` | `box`, `ellipsoid` that fits into it, or `scene`: the whole scene |
//! | `grid` | densities by place, from a .npz, .npy or .vdb file |
//!
//! What has a value for each channel takes one number for all or three for red, green and blue.

use crate::color::Rgb;
use crate::scene::{Medium, MediumShape};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A number for all channels, or one for each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Channels {
    Grey(f32),
    Rgb([f32; 3]),
}

impl Channels {
    fn rgb(self) -> Rgb {
        match self {
            Self::Grey(v) => Rgb::splat(v),
            Self::Rgb(v) => v.into(),
        }
    }
}

/// What a medium fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MediumKind {
    Box,
    Ellipsoid,
    Scene,
}

/// A medium as it is asked for; [`crate::load::medium`] says what the keys mean.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct MediumRequest {
    #[serde(alias = "sigma_s")]
    pub scattering: Option<Channels>,
    #[serde(alias = "sigma_a")]
    pub absorption: Option<Channels>,
    #[serde(alias = "sigma_t")]
    pub extinction: Option<Channels>,
    pub albedo: Option<Channels>,
    pub density: Option<f32>,
    pub emission: Option<Channels>,
    pub g: Option<f32>,
    pub shape: Option<MediumKind>,
    /// A path or URI.
    pub grid: Option<PathBuf>,
    /// Settings only: what messages call it.
    pub name: Option<String>,
    /// Settings only: the middle of its box [m]; none: it fills the whole scene, or with a .vdb grid the grid's own box.
    pub center: Option<[f32; 3]>,
    /// Settings only: the sides of its box along the axes [m].
    pub size: Option<[f32; 3]>,
}

impl MediumRequest {
    /// The medium in `shape`, without its grid.
    ///
    /// # Errors
    /// What is wrong, where keys contradict each other; numbers out of range are found by [`Medium::fault`].
    pub fn medium(&self, name: &str, shape: MediumShape) -> Result<Medium, String> {
        let direct = self.scattering.or(self.absorption).is_some();
        if direct && (self.extinction.is_some() || self.albedo.is_some()) {
            return Err("give scattering and absorption, or extinction and albedo, not both".into());
        }
        let rgb = |channels: Option<Channels>, default: f32| channels.map_or(Rgb::splat(default), Channels::rgb);
        let (scattering, absorption) = if direct {
            (rgb(self.scattering, 0.0), rgb(self.absorption, 0.0))
        } else if self.extinction.is_none()
            && self.albedo.is_none()
            && self.density.is_none()
            && self.emission.is_some()
        {
            // It only shines.
            (Rgb::ZERO, Rgb::ZERO)
        } else {
            let (extinction, albedo) = (rgb(self.extinction, 1.0), rgb(self.albedo, 1.0));
            if !albedo.to_array().iter().all(|a| (0.0..=1.0).contains(a)) {
                return Err(format!("albedo {albedo} is out of range; allowed are 0 to 1"));
            }
            (extinction * albedo, extinction * (Rgb::ONE - albedo))
        };
        if !direct && self.extinction.is_none() && self.density.is_none() && self.emission.is_none() {
            return Err(
                "says nothing of how dense it is; give scattering and absorption, extinction, or density".into()
            );
        }
        Ok(Medium {
            density: self.density.unwrap_or(1.0),
            scattering,
            absorption,
            emission: rgb(self.emission, 0.0),
            anisotropy: self.g.unwrap_or(0.0),
            ..Medium::new(name, shape)
        })
    }

    /// The shape that settings ask for.
    ///
    /// # Errors
    /// What is wrong, where a box lacks its middle or sides, or the whole scene is given any.
    pub fn own_shape(&self) -> Result<MediumShape, String> {
        match (self.shape, self.center, self.size) {
            (None | Some(MediumKind::Scene), None, None) => Ok(MediumShape::Scene),
            (None | Some(MediumKind::Box), Some(center), Some(size)) => Ok(boxed(center, size)),
            (Some(MediumKind::Ellipsoid), Some(center), Some(size)) => match boxed(center, size) {
                MediumShape::Box { world_from_unit } => Ok(MediumShape::Ellipsoid { world_from_unit }),
                other => Ok(other),
            },
            (Some(MediumKind::Scene), ..) => Err("fills the whole scene; leave out center and size".into()),
            _ => Err("needs center and size [m], or the shape scene".into()),
        }
    }
}

/// A box around `center` with the sides `size` [m].
fn boxed(center: [f32; 3], size: [f32; 3]) -> MediumShape {
    let (center, half) = (glam::Vec3::from(center), 0.5 * glam::Vec3::from(size));
    MediumShape::between(center - half, center + half)
}
