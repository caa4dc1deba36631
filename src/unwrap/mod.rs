//! Lightmap UVs for every surface, packed on pages.
//!
//! Authored UVs are kept where they are sound ([`authored`]), or their charts are packed anew ([`repack`]). Other meshes are cut into
//! charts ([`charting`], by [`xatlas`] or [`uvunwrap`]), the density is chosen ([`layout`]), surfaces are dealt out to pages
//! ([`pages`]), and charts are placed at whole texels ([`pack`]).
//!
//! Surfaces whose texels no file shows ([`crate::scene::role`]) lie on pages of their own behind the others. A surface may have
//! its own density, or a factor on it ([`density`]); volumes change it by place ([`volume`]), and a caller by chart
//! ([`Importance`]).
//!
//! What holds of the result: each triangle has UVs of positive area; no two charts touch a texel in common, and `padding`
//! texels lie between any two (authored page-space UVs excepted, which are warned about); a surface lies on one page. With
//! [`UnwrapParams::align`], no block of texels holds texels of two charts, or of one and half the padding around another. A UV is
//! rounded to single precision, so an edge that lies on a texel border may reach into the next texel by less than
//! [`mask::BORDER`].

pub mod authored;
mod chart;
mod charting;
mod density;
mod earlier;
mod findings;
mod layout;
pub mod mask;
mod overlap;
mod pack;
mod pages;
mod params;
mod part;
mod parts;
mod place;
mod repack;
mod shape;
mod split;
mod uvunwrap;
mod volume;
mod xatlas;

use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use crate::scene::Scene;
use authored::Set;
use chart::Chart;
use charting::Known;
use density::Factored;
pub use density::Share;
pub use earlier::Places;
pub use findings::{AuthoredUvs, Verdict};
use glam::{Affine3A, Vec2};
use layout::{Content, Layout, Subject};
pub use params::{Density, Importance, PageSizes, UnwrapParams, Unwrapper, UvMode};
pub use parts::Parts;
use rayon::prelude::*;
use shape::Shape;
pub use volume::DensityVolume;

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

/// An atlas, and what was found on the way to it.
#[derive(Clone, Debug)]
pub struct Unwrapping {
    pub atlas: Atlas,
    /// What authored UVs that are not used as they stand were like.
    pub authored: Vec<AuthoredUvs>,
    pub warnings: Warnings,
    /// What a later atlas can keep of this one.
    pub earlier: Earlier,
    /// Shown surfaces that lie where they did in the earlier atlas; none where it was of no use.
    pub kept: Option<usize>,
}

/// What an atlas keeps of an earlier one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Earlier {
    /// Where surfaces lay; none where authored UVs lie on the page as they stand, and where an importance moves charts.
    pub places: Option<Places>,
    /// What unwrappers made of the parts of meshes.
    pub parts: Parts,
}

/// The powers of factors that are tried until as many texels as without them find room, and the least share of these that counts as
/// many.
const STRENGTHS: [f32; 5] = [1.0, 0.85, 0.7, 0.5, 0.25];
const LEAST_TEXELS: f64 = 0.98;

/// Makes lightmap UVs for all surfaces of `scene`.
///
/// # Errors
/// `Invalid` where the scene doesn't fit the pages at any density, or authored UVs that must be kept are unsound;
/// `Cancelled`.
pub fn unwrap(scene: &Scene, params: &UnwrapParams, progress: &dyn Progress) -> Result<(Atlas, Warnings)> {
    unwrap_after(scene, params, &Earlier::default(), progress).map(|made| (made.atlas, made.warnings))
}

/// The same, with what authored UVs were like. Surfaces that are as they were in an atlas `before` of much the same scene, of the same
/// parameters, keep their places; without room for what is new, or where a fifth of the texels have come or gone, all is laid out anew.
///
/// # Errors
/// Those of [`unwrap`].
pub fn unwrap_after(
    scene: &Scene,
    params: &UnwrapParams,
    before: &Earlier,
    progress: &dyn Progress,
) -> Result<Unwrapping> {
    let mut warnings = Warnings::default();
    let mut users: Vec<Vec<usize>> = vec![Vec::new(); scene.meshes.len()];
    for (s, surface) in scene.surfaces.iter().enumerate() {
        users[surface.mesh].push(s);
    }
    let used = |m: &usize| !users[*m].is_empty();
    let triangles = (0..users.len()).filter(used).map(|m| scene.meshes[m].triangles.len() as u64).sum();
    progress.begin("unwrap", triangles);

    let (mut sets, mut authored) = authored::sets(scene, &users, params, &mut warnings, progress)?;
    let shown: Vec<bool> = scene.surfaces.iter().map(|s| s.role.is_shown()).collect();
    if !shown.contains(&true) {
        return Err(Error::invalid(
            "unwrap",
            "no surface both receives light and has a lightmap; there is nothing to bake",
        ));
    }
    let shares = density::shares(scene, &users, &mut warnings);
    let is_even = shares.iter().all(|s| *s == Share::default()) && params.volumes.is_empty();
    if !shown.contains(&false) && is_even && params.importance.is_none() {
        if let Some(atlas) = authored::page_space(scene, &mut sets, params, &mut warnings) {
            return Ok(Unwrapping { atlas, authored, warnings, earlier: Earlier::default(), kept: None });
        }
    } else if sets.iter().any(Option::is_some) {
        let message = "with objects of other roles or densities each surface gets a rectangle for its authored UVs";
        warnings.add("unwrap", message);
    }
    let fresh: Vec<usize> = (0..users.len()).filter(used).filter(|&m| sets[m].is_none()).collect();
    let mut contents: Vec<Content> = sets.iter().map(|s| s.as_ref().map_or(Content::Unused, Set::content)).collect();
    let mut known = Known { before: &before.parts, now: Parts::default() };
    for (m, charts) in charts(scene, &users, &fresh, params, (&mut authored, &mut known), progress)? {
        contents[m] = if users[m].len() == 1 { Content::Charts(charts) } else { Content::Shared(charts) };
    }
    let (areas, meshes) = (areas(scene), scene.surfaces.iter().map(|s| s.mesh).collect::<Vec<_>>());
    let names: Vec<&str> = scene.surfaces.iter().map(|s| s.name.as_str()).collect();
    let stands: Vec<Affine3A> = scene.surfaces.iter().map(|s| s.world_from_local).collect();
    // Where texels go by light, they go elsewhere with it.
    let before = before.places.as_ref().filter(|_| params.importance.is_none());
    let mut places = None;
    let layout = with_importance(params, &mut warnings, |params, texels, warnings| {
        let Factored { areas, shares } = density::factor(scene, &users, &areas, params, shares.clone(), &mut contents);
        let subject = Subject {
            contents: &contents,
            meshes: &meshes,
            names: &names,
            areas: &areas,
            shown: &shown,
            shares: &shares,
        };
        let kept = match before {
            Some(before) => before.keep(&subject, &stands, params, warnings, progress)?,
            None => None,
        };
        let (layout, kept) = match kept {
            Some((layout, kept)) => (layout, Some(kept)),
            None => (layout::layout(&subject, params, texels, warnings, progress)?, None),
        };
        let texels = layout.texels(&subject);
        let own = Places::new(&subject, &stands, &layout, params);
        places = Some((own.after(before.filter(|_| kept.is_some())), kept));
        Ok((layout, texels))
    })?;
    let (places, kept) = places.filter(|_| params.importance.is_none()).unzip();
    let atlas = place::place(scene, contents, sets, layout);
    let earlier = Earlier { places, parts: known.now };
    Ok(Unwrapping { atlas, authored, warnings, earlier, kept: kept.flatten() })
}

/// What `lay_out` makes of `params`; where those have an importance, as many texels as without it: factors that leave no room for so
/// many are taken back in part, in the end altogether. `lay_out` is given parameters and the texels that are wanted, and returns those
/// that there are.
fn with_importance(
    params: &UnwrapParams,
    warnings: &mut Warnings,
    mut lay_out: impl FnMut(&UnwrapParams, Option<u64>, &mut Warnings) -> Result<(Layout, u64)>,
) -> Result<Layout> {
    let (even, wanted) = lay_out(&UnwrapParams { importance: None, ..params.clone() }, None, warnings)?;
    let Some(importance) = &params.importance else { return Ok(even) };
    for strength in STRENGTHS {
        let mut of_trial = Warnings::default();
        let params = UnwrapParams { importance: Some(importance.to_the(strength)), ..params.clone() };
        let (layout, texels) = lay_out(&params, Some(wanted), &mut of_trial)?;
        if texels as f64 >= LEAST_TEXELS * wanted as f64 {
            warnings.extend(of_trial);
            return Ok(layout);
        }
    }
    Ok(even)
}

/// The charts of the meshes `fresh`: authored ones where those are to be packed anew, else new ones, as far as they aren't `known`. Says in
/// `authored` which were.
fn charts(
    scene: &Scene,
    users: &[Vec<usize>],
    fresh: &[usize],
    params: &UnwrapParams,
    (authored, known): (&mut Vec<AuthoredUvs>, &mut Known),
    progress: &dyn Progress,
) -> Result<Vec<(usize, Vec<Chart>)>> {
    let shapes: Vec<Shape> = fresh.par_iter().map(|&m| Shape::new(scene, m, &users[m])).collect();
    if params.uv != UvMode::Repack {
        let charts = charting::charts(&shapes, params.unwrapper, known, progress)?;
        return Ok(fresh.iter().copied().zip(charts).collect());
    }
    let repacked = repack::charts(scene, users, fresh, &shapes, params, progress)?;
    let (mut result, mut left, mut left_shapes) = (Vec::new(), Vec::new(), Vec::new());
    for ((&m, shape), repacked) in fresh.iter().zip(shapes).zip(repacked) {
        match repacked {
            Some((charts, finding)) => {
                authored.push(finding);
                result.push((m, charts));
            }
            None => {
                left.push(m);
                left_shapes.push(shape);
            }
        }
    }
    let charts = charting::charts(&left_shapes, params.unwrapper, known, progress)?;
    result.extend(left.into_iter().zip(charts));
    Ok(result)
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
