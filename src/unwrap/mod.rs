//! Lightmap UVs for every surface, packed on pages.
//!
//! Authored UVs are kept where they are sound ([`authored`]). Other meshes are cut into charts ([`charting`]), the density is
//! chosen and surfaces are dealt out to pages ([`layout`]), and charts are placed at whole texels ([`pack`]).
//!
//! Surfaces whose texels no file shows ([`crate::scene::role`]) lie on pages of their own behind the others. A surface may have
//! its own density, or a factor on it ([`density`]).
//!
//! What holds of the result: each triangle has UVs of positive area; no two charts touch a texel in common, and `padding`
//! texels lie between any two (authored page-space UVs excepted, which are warned about); a surface lies on one page. A UV is
//! rounded to single precision, so an edge that lies on a texel border may reach into the next texel by less than
//! [`mask::BORDER`].

pub mod authored;
mod chart;
mod charting;
mod density;
mod layout;
pub mod mask;
mod overlap;
mod pack;
mod shape;
mod split;
mod xatlas;

use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use crate::scene::Scene;
use authored::Set;
use chart::Chart;
pub use density::Share;
use glam::{DVec2, Vec2};
use layout::{Content, Layout, Subject};
use pack::Slot;
use rayon::prelude::*;
use shape::Shape;

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
    /// How many of the pages are written: the first ones. The others hold surfaces that only reflect, or whose light is
    /// written as vertex colours.
    pub shown_pages: usize,
}

/// Lightmap UVs of a mesh, shared by all of its surfaces; empty where none uses it.
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
    /// Empty texels between charts, at least 1; fewer, with a warning, where even charts of a texel each don't fit.
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
    let mut warnings = Warnings::default();
    let mut users: Vec<Vec<usize>> = vec![Vec::new(); scene.meshes.len()];
    for (s, surface) in scene.surfaces.iter().enumerate() {
        users[surface.mesh].push(s);
    }
    let used = |m: &usize| !users[*m].is_empty();
    let triangles = (0..users.len()).filter(used).map(|m| scene.meshes[m].triangles.len() as u64).sum();
    progress.begin("unwrap", triangles);

    let mut sets = authored::sets(scene, &users, params, &mut warnings, progress)?;
    let shown: Vec<bool> = scene.surfaces.iter().map(|s| s.role.is_shown()).collect();
    if !shown.contains(&true) {
        return Err(Error::invalid(
            "unwrap",
            "no surface both receives light and has a lightmap; there is nothing to bake",
        ));
    }
    let shares = density::shares(scene, &users, &mut warnings);
    let is_even = shares.iter().all(|s| *s == Share::default());
    if !shown.contains(&false) && is_even {
        if let Some(atlas) = authored::page_space(scene, &mut sets, params, &mut warnings) {
            return Ok((atlas, warnings));
        }
    } else if params.uv != UvMode::New && sets.iter().any(Option::is_some) {
        let message = "with objects of other roles or densities each surface gets a rectangle for its authored UVs";
        warnings.add("unwrap", message);
    }
    let fresh: Vec<usize> = (0..users.len()).filter(used).filter(|&m| sets[m].is_none()).collect();
    let shapes: Vec<Shape> = fresh.par_iter().map(|&m| Shape::new(scene, m, &users[m])).collect();
    let mut contents: Vec<Content> = sets.iter().map(|s| s.as_ref().map_or(Content::Unused, Set::content)).collect();
    for (&m, charts) in fresh.iter().zip(charting::charts(&shapes, progress)?) {
        contents[m] = if users[m].len() == 1 { Content::Charts(charts) } else { Content::Shared(charts) };
    }
    let subject = Subject {
        contents: &contents,
        meshes: &scene.surfaces.iter().map(|s| s.mesh).collect::<Vec<_>>(),
        names: &scene.surfaces.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(),
        areas: &areas(scene),
        shown: &shown,
        shares: &shares,
    };
    let layout = layout::layout(&subject, params, &mut warnings, progress)?;
    Ok((place(scene, contents, sets, layout), warnings))
}

/// Area of each surface [m²].
fn areas(scene: &Scene) -> Vec<f64> {
    (0..scene.surfaces.len()).into_par_iter().map(|s| surface_area(scene, s)).collect()
}

/// Area of surface `surface` [m²].
fn surface_area(scene: &Scene, surface: usize) -> f64 {
    let triangles = 0..scene.meshes[scene.surfaces[surface].mesh].triangles.len();
    let area = |t: usize| {
        let [a, b, c] = scene.world_triangle(surface, t).map(|p| p.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    triangles.map(area).sum()
}

/// The layout as UVs and placements.
fn place(scene: &Scene, contents: Vec<Content>, sets: Vec<Option<Set>>, layout: Layout) -> Atlas {
    let mut meshes = vec![MeshUvs::default(); scene.meshes.len()];
    let mut placements = Vec::with_capacity(scene.surfaces.len());
    let vector = |size: [u32; 2]| DVec2::new(f64::from(size[0]), f64::from(size[1]));
    for (surface, (page, slots)) in scene.surfaces.iter().zip(&layout.surfaces) {
        let m = surface.mesh;
        let sized = &layout.sized[m];
        let page_size = vector(layout.pages[*page as usize]);
        let mut placement = Placement { page: *page, scale: Vec2::ONE, offset: Vec2::ZERO };
        // The rectangle of a shared mesh or of authored UVs.
        let mut rectangle = |low: DVec2, size: DVec2| {
            let scale = vector(sized.pieces[0].mask.size) / size;
            placement.scale = (scale / page_size).as_vec2();
            placement.offset = ((vector(slots[0].at) - low * scale) / page_size).as_vec2();
        };
        match &contents[m] {
            Content::Charts(charts) => meshes[m] = mesh_uvs(scene, m, charts, &sized.charts, slots, page_size),
            Content::Shared(charts) => {
                rectangle(DVec2::ZERO, DVec2::ONE);
                if let (true, Some(block)) = (meshes[m].corners.is_empty(), &sized.block) {
                    meshes[m] = mesh_uvs(scene, m, charts, &sized.charts, &block.slots, vector(block.size));
                }
            }
            Content::Authored { .. } => {
                if let Some(set) = &sets[m] {
                    rectangle(set.low, set.high - set.low);
                }
            }
            Content::Unused => {}
        }
        placements.push(placement);
    }
    for (mesh, set) in meshes.iter_mut().zip(sets) {
        if let Some(set) = set {
            *mesh = set.uvs;
        }
    }
    let Layout { pages, density, padding, shown_pages, .. } = layout;
    Atlas { pages, meshes, placements, density: density as f32, padding, shown_pages }
}

/// UVs of a mesh whose charts have boxes of `boxes` texels at `slots` of a rectangle of `size` texels.
fn mesh_uvs(scene: &Scene, mesh: usize, charts: &[Chart], boxes: &[[u32; 2]], slots: &[Slot], size: DVec2) -> MeshUvs {
    let count = scene.meshes[mesh].triangles.len();
    let mut uvs = MeshUvs {
        corners: vec![[Vec2::ZERO; 3]; count],
        chart: vec![0; count],
        chart_count: charts.len() as u32,
        authored: None,
    };
    for (number, ((chart, &texels), &slot)) in charts.iter().zip(boxes).zip(slots).enumerate() {
        for (&t, corners) in chart.triangles.iter().zip(pack::texels(chart, texels, slot)) {
            uvs.corners[t as usize] = rounded(corners, size);
            uvs.chart[t as usize] = number as u32;
        }
    }
    uvs
}

/// UVs in single precision of a triangle in texels, which still has area: a sliver that rounding would flatten is widened,
/// by less than [`mask::BORDER`].
fn rounded(corners: [DVec2; 3], size: DVec2) -> [Vec2; 3] {
    let round = |corners: [DVec2; 3]| corners.map(|p| (p / size).as_vec2());
    let has_area = |uv: [Vec2; 3]| chart::signed_area(uv.map(|p| p.as_dvec2())) > 0.0;
    let uv = round(corners);
    if has_area(uv) {
        return uv;
    }
    // The corner between the two others, and the way from them that gives area.
    let length = |k: usize| corners[(k + 1) % 3].distance_squared(corners[(k + 2) % 3]);
    let middle = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let along = corners[(middle + 2) % 3] - corners[(middle + 1) % 3];
    let aside = along.try_normalize().unwrap_or(DVec2::X).perp();
    for step in 1..8 {
        let by = aside * mask::BORDER * f64::from(step) / 8.0;
        let mut moved = corners;
        moved[middle] += by;
        let within = moved[middle].cmpge(DVec2::ZERO).all() && moved[middle].cmple(size).all();
        if !within {
            // Off the page: the others move the other way, so that the sliver stays between them.
            moved = corners.map(|p| p - by);
            moved[middle] = corners[middle];
        }
        let uv = round(moved);
        if has_area(uv) {
            return uv.map(|p| p.clamp(Vec2::ZERO, Vec2::ONE));
        }
    }
    uv
}

impl Atlas {
    /// True where `surface` (index) lies on a page that is written.
    pub fn is_shown(&self, surface: usize) -> bool {
        (self.placements[surface].page as usize) < self.shown_pages
    }

    /// Texels per metre of `surface` (index), on average over its area; 0 for one without area.
    pub fn surface_density(&self, scene: &Scene, surface: usize) -> f32 {
        let mesh = scene.surfaces[surface].mesh;
        let texels = |t: usize| {
            let [a, b, c] = self.page_texels(surface, mesh, t).map(|p| p.as_dvec2());
            0.5 * (b - a).perp_dot(c - a).abs()
        };
        let texels: f64 = (0..scene.meshes[mesh].triangles.len()).map(texels).sum();
        let area = surface_area(scene, surface);
        if area > 0.0 { (texels / area).sqrt() as f32 } else { 0.0 }
    }

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
