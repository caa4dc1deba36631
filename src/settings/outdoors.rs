//! Sun, sky and projectors that a user adds to a scene.

use crate::error::{Error, Result};
use crate::scene::clear_sky::TURBIDITY;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::path::PathBuf;
use std::str::FromStr;

/// A sky: a constant radiance, or the clear sky around the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SkySetting {
    /// Linear Rec.709 [nit].
    Constant([f32; 3]),
    /// The analytic clear sky of this turbidity, see [`crate::scene::clear_sky`].
    Clear { turbidity: f32 },
}

/// The turbidity of `clear` alone: a clear day.
const CLEAR_DAY: f32 = 3.0;

impl FromStr for SkySetting {
    type Err = String;

    /// `R,G,B` or one number for all three [nit], `clear` or `clear,TURBIDITY`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let numbers: std::result::Result<Vec<f32>, _> = parts.iter().map(|p| p.parse::<f32>()).collect();
        match (&parts[..], numbers.as_deref()) {
            (["clear"], _) => Ok(Self::Clear { turbidity: CLEAR_DAY }),
            (["clear", turbidity], _) => {
                let turbidity = turbidity.parse().map_err(|_| format!("{turbidity} is no turbidity, as in clear,3"))?;
                Ok(Self::Clear { turbidity })
            }
            (_, Ok([r, g, b])) => Ok(Self::Constant([*r, *g, *b])),
            (_, Ok([v])) => Ok(Self::Constant([*v; 3])),
            _ => Err("expected three numbers [nit] separated by commas, as in 1,1,1, or clear".to_string()),
        }
    }
}

/// As a file has it.
#[derive(Deserialize)]
#[serde(untagged)]
enum Form {
    Rgb([f32; 3]),
    Text(String),
}

impl<'de> Deserialize<'de> for SkySetting {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        match Form::deserialize(from)? {
            Form::Rgb(rgb) => Ok(Self::Constant(rgb)),
            Form::Text(text) => text.parse().map_err(serde::de::Error::custom),
        }
    }
}

impl Serialize for SkySetting {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Constant(rgb) => rgb.serialize(to),
            Self::Clear { turbidity } => to.serialize_str(&format!("clear,{turbidity}")),
        }
    }
}

/// A picture that lights are to throw (`[[projectors]]` in `lumel.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ProjectorSetting {
    /// Names of the lights; `*` stands for anything, `?` for one character.
    pub light: String,
    /// .png .jpg .exr .hdr; relative to the file in which it stands.
    pub picture: PathBuf,
    /// Full horizontal angle [degrees], between 0 and 180; none: that of the light's cone.
    pub fov: Option<f32>,
    /// Width over height; none: the picture's own.
    pub aspect: Option<f32>,
    /// Names of the surfaces that it is to land square on, as for `light`; none: it is thrown as a pinhole would.
    pub target: Option<String>,
}

/// Refuses what is out of range: `sun` is elevation, azimuth [degrees] and illuminance [lx].
pub(super) fn check(sky: Option<SkySetting>, sun: Option<[f32; 3]>, projectors: &[ProjectorSetting]) -> Result<()> {
    match sky {
        Some(SkySetting::Constant(rgb)) if rgb.iter().any(|v| !v.is_finite() || *v < 0.0) => {
            return Err(Error::invalid("sky", "radiance must be finite and not negative [nit]"));
        }
        Some(SkySetting::Clear { turbidity }) => {
            let [low, high] = TURBIDITY;
            if !(low..=high).contains(&turbidity) {
                let message = format!("turbidity {turbidity} is out of range; allowed are {low} to {high}");
                return Err(Error::invalid("sky", message));
            }
            if sun.is_none() {
                return Err(Error::invalid("sky", "a clear sky lies around the sun; give sun as well"));
            }
        }
        _ => {}
    }
    if let Some([elevation, azimuth, lux]) = sun
        && !((0.0..=90.0).contains(&elevation) && (-360.0..=360.0).contains(&azimuth) && (0.0..=1e9).contains(&lux))
    {
        let message = "elevation must lie within 0..90 and azimuth within -360..360 degrees, and lux be 0 or more";
        return Err(Error::invalid("sun", message));
    }
    for p in projectors {
        let fov = p.fov.unwrap_or(1.0);
        let aspect = p.aspect.unwrap_or(1.0);
        if !(fov > 0.0 && fov < 180.0 && aspect > 0.0 && aspect.is_finite()) {
            let message = "fov must lie between 0 and 180 degrees and aspect above 0";
            return Err(Error::invalid("projectors", message));
        }
    }
    Ok(())
}
