//! From texel values to pages that can be shown: noise taken out, seams closed, gutters filled.

pub mod denoise;
pub mod dilate;
pub mod directional;
pub mod gutter;
pub mod layers;
pub mod seam;

use crate::color::Rgb;
use crate::patch::Patches;

/// Finished pages.
#[derive(Clone, Debug)]
pub struct Lightmap {
    pub pages: Vec<PageImage>,
    pub quantity: Quantity,
    pub layers: Vec<Layer>,
}

/// What pages tell of the directions that light comes from; [`directional`] defines each form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Directional {
    /// Nothing.
    #[default]
    Off,
    /// Spherical harmonics to order 1: the layers `sh0`, `sh1x`, `sh1y` and `sh1z`.
    Sh,
    /// One direction for all channels, as long as light agrees on it: the layer `dominant`.
    Dominant,
}

impl Directional {
    /// How a value about the unit normal `n` follows, for headers; none where nothing is told.
    pub fn formula(self) -> Option<&'static str> {
        match self {
            Self::Off => None,
            Self::Sh => Some("value(n) = sh0 + sh1x n.x + sh1y n.y + sh1z n.z; n in world space, right-handed, Y up"),
            Self::Dominant => Some(
                "value(n) = RGB max(0, 1 + 2 dominant . n) / (1 + 2 dominant . n0), n0 the vertex normal; world space, \
                 right-handed, Y up",
            ),
        }
    }
}

impl Lightmap {
    /// The irradiance that the texels of `patches` show [lx]; not of pages that hold radiosity.
    pub fn irradiance(&self, patches: &Patches) -> Vec<Rgb> {
        let factor = if self.quantity == Quantity::Outgoing { std::f32::consts::PI } else { 1.0 };
        let of_patch = |i: usize| {
            let [page, texel] = patches.texel(i);
            self.pages.get(page as usize).map_or(Rgb::ZERO, |page| page.rgb[texel as usize] * factor)
        };
        (0..patches.len()).map(of_patch).collect()
    }
}

/// A part of the light on its own.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Its name in the channels of pages: a word, or `shadow.` or `group.` and another.
    pub name: String,
    /// Texel values of each page, as [`PageImage::rgb`].
    pub pages: Vec<Vec<Rgb>>,
    pub channels: Channels,
    /// The unit of its values, `1` for shares and directions.
    pub unit: &'static str,
    /// The light or group that it is of.
    pub of: Option<String>,
}

/// What a layer's three values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// A colour.
    Rgb,
    /// One number, three times.
    Y,
    /// A direction in the world, Y up.
    Xyz,
}

impl Channels {
    /// What follows the layer's name in the channels of an EXR, in order.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Rgb => &["R", "G", "B"],
            Self::Y => &["Y"],
            Self::Xyz => &["X", "Y", "Z"],
        }
    }
}

/// Which layers are wanted beside the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LayerKind {
    /// Straight from lights.
    Direct,
    /// All that was reflected.
    Indirect,
    /// Light over mirrors and glass that counts as direct.
    Caustics,
    /// Emitted, and reflected no time, once, twice, ... before it arrives.
    Bounces,
    /// The estimated standard error of the whole.
    Error,
    /// What surfaces emit.
    Emission,
    /// Ambient occlusion: the share of the hemisphere with nothing near.
    Ao,
    /// The mean direction with nothing near, in the world.
    BentNormal,
    /// The share of the hemisphere in which the sky is seen.
    SkyVisibility,
    /// The visible share of each of some lights: see [`crate::light::mask`].
    ShadowMasks,
    /// The light that each light group causes.
    LightGroups,
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
    /// The value of the irradiance `e` [lx] on an albedo, without emission.
    pub fn of(self, e: Rgb, albedo: Rgb) -> Rgb {
        match self {
            Self::Outgoing => e / std::f32::consts::PI,
            Self::Irradiance => e,
            Self::Radiosity => albedo * e,
        }
    }

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
