//! From texel values to pages that can be shown: gutters, vertex colours.

pub mod dilate;
pub mod vertex;

use crate::color::Rgb;

/// Finished pages.
#[derive(Clone, Debug)]
pub struct Lightmap {
    pub pages: Vec<PageImage>,
    pub quantity: Quantity,
}

/// One page; row 0 is the top.
#[derive(Clone, Debug)]
pub struct PageImage {
    pub width: u32,
    pub height: u32,
    /// Texel values in the lightmap's quantity, row by row.
    pub rgb: Vec<Rgb>,
    /// The share of the texel that a surface covers, 0..=1: 0 in gutters and empty space.
    pub coverage: Vec<f32>,
}

/// What a texel holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// E / pi [nit]: the radiance a white diffuse surface sends out.
    #[default]
    Outgoing,
    /// E [lx].
    Irradiance,
    /// B [lm/m^2], emission included.
    Radiosity,
}

impl Quantity {
    /// Name in headers, extras and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Outgoing => "outgoing",
            Self::Irradiance => "irradiance",
            Self::Radiosity => "radiosity",
        }
    }

    /// Unit in headers, extras and reports.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Outgoing => "nit",
            Self::Irradiance => "lx",
            Self::Radiosity => "lm/m^2",
        }
    }
}
