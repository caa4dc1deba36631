//! Lightmap UVs for every surface, packed on pages.

pub mod authored;
pub mod pack;
pub mod xatlas;

use crate::error::{Result, Warnings};
use crate::progress::Progress;
use crate::scene::Scene;
use glam::Vec2;

/// Where each surface's lightmap lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// Page sizes [texels].
    pub pages: Vec<[u32; 2]>,
    /// Lightmap UVs of each mesh of the scene, by mesh index.
    pub meshes: Vec<MeshUvs>,
    /// Place of each surface of the scene, by surface index.
    pub placements: Vec<Placement>,
    /// Texels per metre that were used.
    pub density: f32,
    /// Empty texels kept between charts and to the page's edge.
    pub padding: u32,
}

/// Lightmap UVs of a mesh, shared by all of its surfaces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshUvs {
    /// One UV a triangle corner, v down, in the order of `Mesh::triangles`.
    pub corners: Vec<[Vec2; 3]>,
    /// The chart of each triangle, numbered from 0 within the mesh. Charts don't span materials, and a polygon's triangles
    /// share one.
    pub chart: Vec<u32>,
    pub chart_count: u32,
    /// The mesh's own UV set that these are, where authored UVs are used as they stand.
    pub authored: Option<String>,
}

/// A surface's rectangle: page UV = mesh UV * scale + offset, v down, 0..1 over the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub page: u32,
    pub scale: Vec2,
    pub offset: Vec2,
}

/// How the atlas is made.
#[derive(Clone, Debug)]
pub struct UnwrapParams {
    pub density: Density,
    /// Page size [texels] where more than one page may be used; ignored by [`Density::FillPage`]. 16..=16384.
    pub page_size: u32,
    /// Most pages that may be used, at least 1; density falls, with a warning, where more would be needed.
    pub max_pages: u32,
    /// Empty texels between charts, at least 1.
    pub padding: u32,
    pub uv: UvMode,
    /// Name of the authored set to look for; by default `TEXCOORD_1`, then `st1`.
    pub uv_name: Option<String>,
}

/// What sets the size of a texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// Texels per metre.
    TexelsPerMetre(f32),
    /// The whole scene has about this many texels of surface; pages of up to `page_size`, square, power of two.
    TexelCount(u64),
    /// Everything on one page of this many texels squared, filled as well as can be.
    FillPage(u32),
}

/// Which UVs are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UvMode {
    /// Authored lightmap UVs where they are sound, else new ones.
    #[default]
    Auto,
    /// Authored lightmap UVs; an error where they are missing or unsound.
    Keep,
    /// New ones for every mesh.
    New,
}

/// Makes lightmap UVs for all surfaces of `scene`.
///
/// # Errors
/// `Invalid` where the scene doesn't fit the pages at any density, or authored UVs that must be kept are unsound;
/// `Cancelled`.
pub fn unwrap(scene: &Scene, params: &UnwrapParams, progress: &dyn Progress) -> Result<(Atlas, Warnings)> {
    let _ = (scene, params, progress);
    todo!()
}

impl Atlas {
    /// Page UVs of triangle `triangle` of `surface` (index), whose mesh is `mesh`.
    pub fn page_uv(&self, surface: usize, mesh: usize, triangle: usize) -> [Vec2; 3] {
        let p = self.placements[surface];
        self.meshes[mesh].corners[triangle].map(|uv| uv * p.scale + p.offset)
    }

    /// Page UVs in texels: (0, 0) is the page's top left corner.
    pub fn page_texels(&self, surface: usize, mesh: usize, triangle: usize) -> [Vec2; 3] {
        let [w, h] = self.pages[self.placements[surface].page as usize];
        self.page_uv(surface, mesh, triangle).map(|uv| uv * Vec2::new(w as f32, h as f32))
    }
}
