//! How an atlas is made.

use super::mask::Spacing;
use super::volume::DensityVolume;
use serde::{Deserialize, Serialize};

/// How the atlas is made.
#[derive(Clone, Debug)]
pub struct UnwrapParams {
    pub density: Density,
    /// Page size [texels] where more than one page may be used; ignored by [`Density::FillPage`]. 16..=16384.
    pub page_size: u32,
    /// Most pages that may be used, at least 1; density falls, with a warning, where more would be needed.
    pub max_pages: u32,
    /// Which sizes pages may have.
    pub pages: PageSizes,
    /// Empty texels between charts, at least 1; fewer, with a warning, where even charts of the least size don't fit.
    pub padding: u32,
    /// Side of square blocks of texels [texels] of which none holds texels of two charts, nor of one chart and half the padding
    /// around another: 4 for textures compressed by block. A power of two up to 64 that divides the page size; 1: no blocks.
    pub align: u32,
    /// Least width and height of a chart [texels], at least 1; smaller ones are stretched.
    pub min_chart: u32,
    pub uv: UvMode,
    /// Name of the authored set to look for; by default `TEXCOORD_1`, then `st1`.
    pub uv_name: Option<String>,
    pub unwrapper: Unwrapper,
    /// Where the density is higher or lower.
    pub volumes: Vec<DensityVolume>,
    /// Which charts get more of the texels; none: all as much.
    pub importance: Option<Importance>,
}

impl UnwrapParams {
    /// What lies between charts.
    pub(super) fn spacing(&self) -> Spacing {
        Spacing { padding: self.padding, align: self.align.max(1), least: self.min_chart.max(1) }
    }

    /// The names of authored sets that are looked for, best first.
    pub(super) fn set_names(&self) -> Vec<&str> {
        self.uv_name.as_deref().map_or(vec!["TEXCOORD_1", "st1"], |n| vec![n])
    }
}

impl Default for UnwrapParams {
    /// About 2^18 texels of new or sound authored UVs, on pages of up to 2048 squared, 2 texels apart.
    fn default() -> Self {
        Self {
            density: Density::TexelCount(1 << 18),
            page_size: 2048,
            max_pages: 64,
            pages: PageSizes::default(),
            padding: 2,
            align: 1,
            min_chart: 1,
            uv: UvMode::default(),
            uv_name: None,
            unwrapper: Unwrapper::default(),
            volumes: Vec::new(),
            importance: None,
        }
    }
}

/// What sets the size of a texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// Texels per metre.
    TexelsPerMetre(f32),
    /// The whole scene has about this many texels of surface; pages of up to `page_size`.
    TexelCount(u64),
    /// Everything on one page of this many texels squared, filled as well as can be.
    FillPage(u32),
}

/// Which UVs are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UvMode {
    /// Authored lightmap UVs where they are sound, else new ones.
    #[default]
    Auto,
    /// Authored lightmap UVs; an error where they are missing or unsound.
    Keep,
    /// The charts of authored lightmap UVs, packed anew at the bake's density; new ones where there are none.
    Repack,
    /// New ones for every mesh.
    New,
}

/// What cuts meshes into charts and flattens these.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unwrapper {
    /// xatlas: conformal charts.
    #[default]
    Xatlas,
    /// The crate uvunwrap: charts as rigid as possible.
    Uvunwrap,
}

/// Which sizes pages may have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PageSizes {
    /// Powers of two, square or two to one.
    #[default]
    Pot,
    /// Multiples of 4 (of `align` where that is more), as small as holds the charts.
    Free,
}

/// A factor on the density of each chart, as light that varies much there asks for.
///
/// The number of texels that charts of shown surfaces touch stays what [`UnwrapParams::density`] makes it without factors, which count
/// relative to each other: the density is searched for at which it does. Where the pages have no room for 98 % of them, factors are
/// taken back. It is for charts that are packed anew; authored UVs that are kept have one factor a mesh, the root of the mean square
/// over its charts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Importance {
    /// By mesh, then by chart as [`super::MeshUvs::chart`] numbers them in an atlas of the same scene by the same unwrapper, whatever
    /// its density; each positive and finite. Meshes and charts beyond its end have 1, as have those of other values.
    pub factors: Vec<Vec<f32>>,
}

impl Importance {
    /// All factors to the power of `strength`.
    pub(super) fn to_the(&self, strength: f32) -> Self {
        let factors = self.factors.iter().map(|charts| charts.iter().map(|f| f.powf(strength)).collect());
        Self { factors: factors.collect() }
    }

    /// The factor of a chart.
    pub fn of(&self, mesh: usize, chart: usize) -> f64 {
        let factor = self.factors.get(mesh).and_then(|charts| charts.get(chart)).copied().unwrap_or(1.0);
        if factor.is_finite() && factor > 0.0 { f64::from(factor) } else { 1.0 }
    }
}
