//! Texel density and pages: how large everything is, and which page it goes on.

use super::chart::Chart;
use super::density::Share;
use super::mask::{Page, Spacing};
use super::pack::{self, Block, Order, Piece, Slot};
use super::pages::{Overflow, Paging, add_hidden, assign, cost, place_surfaces};
use super::{Density, UnwrapParams};
use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use glam::DVec2;
use rayon::prelude::*;

/// What a mesh brings to the pages.
#[derive(Debug)]
pub enum Content {
    /// Charts that pack freely; the mesh has one surface.
    Charts(Vec<Chart>),
    /// Charts in one rectangle, of which each surface gets its own.
    Shared(Vec<Chart>),
    /// Authored UVs in a rectangle for each surface: the size [m] of the box of the mesh's UVs.
    Authored { size: DVec2 },
    /// No surface uses it.
    Unused,
}

/// A mesh at some density.
#[derive(Clone, Debug, Default)]
pub struct Sized {
    /// What each surface places: a piece for each chart, or one rectangle.
    pub pieces: Vec<Piece>,
    /// Boxes of the charts [texels].
    pub charts: Vec<[u32; 2]>,
    /// Of a shared mesh.
    pub block: Option<Block>,
    /// Texels that each surface's charts touch.
    pub texels: u64,
}

/// Everything has its place.
#[derive(Debug)]
pub struct Layout {
    /// Page sizes [texels].
    pub pages: Vec<[u32; 2]>,
    /// Texels per metre, and before they were lowered.
    pub density: f64,
    pub asked: f64,
    /// Texels per metre of each mesh.
    pub densities: Vec<f64>,
    /// Empty texels between charts: those asked for, or as many as there is room for.
    pub padding: u32,
    /// By mesh.
    pub sized: Vec<Sized>,
    /// The page of each surface, and the slots of its mesh's pieces.
    pub surfaces: Vec<(u32, Vec<Slot>)>,
    /// Pages of shown surfaces, which come first.
    pub shown_pages: usize,
}

impl Layout {
    /// Texels of shown surfaces.
    pub fn texels(&self, subject: &Subject) -> u64 {
        subject.surfaces(true).into_iter().map(|s| self.sized[subject.meshes[s]].texels).sum()
    }
}

/// What is laid out.
#[derive(Debug)]
pub struct Subject<'a> {
    /// By mesh.
    pub contents: &'a [Content],
    /// The mesh of each surface.
    pub meshes: &'a [usize],
    /// The name of each surface.
    pub names: &'a [&'a str],
    /// Area of each surface [m²], times the square of the factor on its density that its charts have.
    pub areas: &'a [f64],
    /// Which surfaces lie on pages that are written.
    pub shown: &'a [bool],
    /// The density of each mesh.
    pub shares: &'a [Share],
}

impl Subject<'_> {
    /// The surfaces that are shown, or those that aren't.
    pub fn surfaces(&self, shown: bool) -> Vec<usize> {
        (0..self.meshes.len()).filter(|&s| self.shown[s] == shown).collect()
    }

    /// The density at which shown surfaces have about `count` texels.
    pub fn density_of(&self, count: f64) -> f64 {
        let shown = self.surfaces(true).into_iter();
        Share::density_of(shown.map(|s| (self.areas[s], self.shares[self.meshes[s]])), count)
    }
}

/// The density of meshes at some density of the bake.
pub struct Densities<'a> {
    pub shares: &'a [Share],
    /// That above which a mesh's charts don't fit a page.
    pub caps: &'a [f64],
    pub density: f64,
    /// Before it was lowered.
    pub asked: f64,
}

impl Densities<'_> {
    /// What mesh `mesh` is to have, whether it fits or not.
    fn wanted(&self, mesh: usize) -> f64 {
        self.shares[mesh].at(self.density, self.asked)
    }

    /// What mesh `mesh` has.
    pub fn of(&self, mesh: usize) -> f64 {
        self.wanted(mesh).min(self.caps[mesh])
    }

    /// What each mesh has.
    pub fn all(&self) -> Vec<f64> {
        (0..self.caps.len()).map(|mesh| self.of(mesh)).collect()
    }
}

/// Finds density and places as `params` ask for; with `texels`, so that shown surfaces have as many, or as many of them as there
/// is room for. Where charts of the least size don't fit with the padding between them, there is
/// less of it, down to none, with a warning. Each search makes a fixed number of tries, so that equal input gives equal bits on
/// slow and fast machines.
///
/// # Errors
/// `Invalid` where nothing fits at any density and padding; `Cancelled`.
pub fn layout(
    subject: &Subject,
    params: &UnwrapParams,
    texels: Option<u64>,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Layout> {
    let mut padding = params.padding;
    loop {
        let params = UnwrapParams { padding, ..params.clone() };
        if let Some(layout) = lay_out(subject, &params, texels, warnings, progress)? {
            return Ok(layout);
        }
        if padding == 0 {
            return Err(no_room(subject, &params));
        }
        padding /= 2;
        let effect = match padding {
            0 => "charts touch, and a filter that reads between texels mixes them",
            _ => "coarse mip levels of the lightmap mix charts",
        };
        let message = format!(
            "{} charts don't fit with {} texels between them; the padding was lowered to {padding}: {effect}; allow \
             more or larger pages",
            least_pieces(subject),
            params.padding
        );
        warnings.add("unwrap", message);
    }
}

/// The layout with the padding of `params`; `None` where nothing fits at any density.
fn lay_out(
    subject: &Subject,
    params: &UnwrapParams,
    texels: Option<u64>,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Option<Layout>> {
    let pages = match params.density {
        Density::FillPage(side) => f64::from(side).powi(2),
        _ => f64::from(params.page_size).powi(2) * f64::from(params.max_pages),
    };
    // A chart of the least size, with its share of the padding.
    let spacing = params.spacing();
    let least = f64::from(spacing.taken(spacing.least)).powi(2) * least_pieces(subject) as f64;
    if least > pages {
        return Ok(None);
    }
    let asked = match params.density {
        Density::FillPage(side) => return fill(subject, side, texels, params, progress),
        Density::TexelsPerMetre(density) => f64::from(density),
        Density::TexelCount(count) => subject.density_of(count as f64),
    };
    let asked = match texels {
        Some(count) => {
            density_of_texels(subject, count, asked, &caps(subject, params.page_size, spacing), spacing, progress)?
        }
        None => asked,
    };
    spread(subject, asked, params, warnings, progress)
}

/// Steps in which a density is found, and the error of the number of texels at which that is enough.
const STEPS: usize = 12;
const CLOSE: f64 = 5e-4;

/// The density of the bake, about `density`, at which the charts of shown surfaces touch about `count` texels.
fn density_of_texels(
    subject: &Subject,
    count: u64,
    mut density: f64,
    caps: &[f64],
    spacing: Spacing,
    progress: &dyn Progress,
) -> Result<f64> {
    let shown = subject.surfaces(true);
    let mut best = (f64::INFINITY, density);
    for _ in 0..STEPS {
        progress.check()?;
        let densities = Densities { shares: subject.shares, caps, density, asked: density };
        let of_mesh = |(mesh, content): (usize, &Content)| touched(content, densities.of(mesh), spacing.least);
        let by_mesh: Vec<u64> = subject.contents.par_iter().enumerate().map(of_mesh).collect();
        let found: u64 = shown.iter().map(|&s| by_mesh[subject.meshes[s]]).sum();
        let ratio = count as f64 / found.max(1) as f64;
        let error = (ratio - 1.0).abs();
        if error < best.0 {
            best = (error, density);
        }
        if error < CLOSE {
            break;
        }
        density *= ratio.sqrt();
    }
    Ok(best.1)
}

/// The texels that a mesh's charts touch at `density`.
fn touched(content: &Content, density: f64, least: u32) -> u64 {
    let of_chart = |c: &Chart| pack::mask(c, pack::texel_size(c.size, density * c.factor, least)).texels;
    match content {
        Content::Charts(charts) | Content::Shared(charts) => charts.iter().map(of_chart).sum(),
        Content::Authored { size } => pack::texel_size(*size, density, least).map(u64::from).iter().product(),
        Content::Unused => 0,
    }
}

/// Charts of all surfaces.
fn least_pieces(subject: &Subject) -> usize {
    let charts = |mesh: usize| match &subject.contents[mesh] {
        Content::Charts(charts) | Content::Shared(charts) => charts.len(),
        Content::Authored { .. } => 1,
        Content::Unused => 0,
    };
    subject.meshes.iter().map(|&mesh| charts(mesh)).sum()
}

fn no_room(subject: &Subject, params: &UnwrapParams) -> Error {
    let pages = match params.density {
        Density::FillPage(side) => format!("a page of {side} x {side} texels"),
        _ => format!("{} page(s) of {} texels", params.max_pages, params.page_size),
    };
    let message = format!(
        "{} charts don't fit {pages} at any density, even without padding; ask for more or larger pages",
        least_pieces(subject)
    );
    Error::invalid("unwrap", message)
}

/// Packing trials of [`fill`] once some density fits.
const TRIALS: usize = 7;

/// Up to this many pieces, a page that one order overfills is tried with another.
const FEW: usize = 500;

/// One page of `side` squared, filled as well as bisection finds, or with `texels` where they fit; hidden surfaces on further ones.
/// `None` where nothing fits.
fn fill(
    subject: &Subject,
    side: u32,
    texels: Option<u64>,
    params: &UnwrapParams,
    progress: &dyn Progress,
) -> Result<Option<Layout>> {
    let spacing = params.spacing();
    let shown = subject.surfaces(true);
    let caps = caps(subject, side, spacing);
    let attempt = |density: f64| -> Result<Option<Layout>> {
        let densities = Densities { shares: subject.shares, caps: &caps, density, asked: density };
        let is_too_long = |&s: &usize| {
            let mesh = subject.meshes[s];
            subject.shares[mesh].own.is_none() && caps[mesh] < densities.wanted(mesh)
        };
        if shown.iter().any(is_too_long) {
            return Ok(None);
        }
        let sized = measure(subject, &densities, spacing, progress)?;
        let count: usize = shown.iter().map(|&s| sized[subject.meshes[s]].pieces.len()).sum();
        if cost(subject, &sized, &shown, spacing) > 1.1 * f64::from(side) * f64::from(side) {
            return Ok(None);
        }
        let orders = match (texels, count) {
            (Some(_), _) => &Order::ALL[..],
            (None, ..=FEW) => &[Order::Side, Order::Texels],
            (None, _) => &[Order::Side],
        };
        for &order in orders {
            let mut page = Page::new([side, side], spacing, spacing.margin());
            if let Some(slots) = place_surfaces(subject, &sized, &shown, &mut page, order, progress)? {
                let (pages, padding) = (vec![[side, side]], spacing.padding);
                let mut surfaces = vec![(0, Vec::new()); subject.meshes.len()];
                shown.iter().zip(slots).for_each(|(&s, slots)| surfaces[s] = (0, slots));
                let of_meshes = densities.all();
                let layout = Layout {
                    pages,
                    density,
                    asked: density,
                    densities: of_meshes,
                    padding,
                    sized,
                    surfaces,
                    shown_pages: 1,
                };
                let hidden = Paging::hidden(side, params, true);
                return Ok(add_hidden(subject, layout, &hidden, progress)?.ok());
            }
        }
        Ok(None)
    };
    // All texels of the page are more than can be used, a tenth of them is nearly always possible.
    let most = subject.density_of(f64::from(side).powi(2));
    let (mut high, mut low) = (most, 0.8 * most);
    if let Some(count) = texels {
        low = density_of_texels(subject, count, low, &caps, spacing, progress)?;
        high = low;
    }
    let mut best = None;
    for _ in 0..64 {
        best = attempt(low)?;
        if best.is_some() {
            break;
        }
        (high, low) = (low, if texels.is_some() { 0.97 * low } else { 0.8 * low });
    }
    let Some(mut best) = best else { return Ok(None) };
    // Where as many texels as were wanted fit at once, nothing is left to find.
    let trials = if low < high { TRIALS } else { 0 };
    for _ in 0..trials {
        let middle = (low * high).sqrt();
        match attempt(middle)? {
            Some(layout) => (best, low) = (layout, middle),
            None => high = middle,
        }
    }
    Ok(Some(best))
}

/// As many pages as `asked`, the density asked for, needs; `None` where nothing fits.
fn spread(
    subject: &Subject,
    asked: f64,
    params: &UnwrapParams,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Option<Layout>> {
    let (spacing, pages) = (params.spacing(), params.pages);
    let paging = Paging { page_size: params.page_size, max_pages: params.max_pages, pages, spacing };
    let hidden = Paging::hidden(params.page_size, params, false);
    let shown = subject.surfaces(true);
    let mut caps = caps(subject, params.page_size, spacing);
    let page_area = f64::from(params.page_size).powi(2);
    let mut density = asked;
    // Far beyond what fits, bitmaps needn't be made to know it.
    let demand = |density: f64, caps: &[f64]| {
        demand(subject, &shown, &Densities { shares: subject.shares, caps, density, asked })
    };
    while demand(density, &caps) > 3.0 * page_area * f64::from(params.max_pages) {
        density *= 0.9;
    }
    for _ in 0..200 {
        let densities = Densities { shares: subject.shares, caps: &caps, density, asked };
        let sized = measure(subject, &densities, spacing, progress)?;
        let shown_layout = assign(subject, &sized, &shown, &paging, progress)?;
        let costs_of = |surface: usize| cost(subject, &sized, &[surface], spacing);
        let overflow = match shown_layout {
            Ok((pages, surfaces)) => {
                // Too large ones among the hidden are found by their cost once the layout has taken the sizes.
                let costs: Vec<f64> = (0..subject.meshes.len()).map(costs_of).collect();
                let shown_pages = pages.len();
                let (padding, densities_of_meshes) = (params.padding, densities.all());
                let layout = Layout {
                    pages,
                    density,
                    asked,
                    densities: densities_of_meshes,
                    padding,
                    sized,
                    surfaces,
                    shown_pages,
                };
                match add_hidden(subject, layout, &hidden, progress)? {
                    Ok(layout) => {
                        warn_of_lowered(subject, &densities, params, warnings);
                        return Ok(Some(layout));
                    }
                    Err(Overflow::Surface(surface)) => (Overflow::Surface(surface), costs[surface]),
                    Err(overflow) => (overflow, 0.0),
                }
            }
            Err(Overflow::Surface(surface)) => (Overflow::Surface(surface), costs_of(surface)),
            Err(overflow) => (overflow, 0.0),
        };
        match overflow {
            (Overflow::Pages(ratio), _) => density *= ratio.sqrt().recip().clamp(0.5, 0.93),
            (Overflow::Surface(surface), cost) => {
                let (mesh, ratio) = (subject.meshes[surface], cost / (0.85 * page_area));
                caps[mesh] = densities.of(mesh) * ratio.sqrt().recip().clamp(0.25, 0.93);
            }
        }
    }
    Ok(None)
}

/// Says which densities are not what was asked for.
pub fn warn_of_lowered(subject: &Subject, densities: &Densities, params: &UnwrapParams, warnings: &mut Warnings) {
    let Densities { density, asked, caps, .. } = *densities;
    if density < asked {
        warnings.add(
            "unwrap",
            format!(
                "{} page(s) of {} texels don't hold the scene at {asked:.3} texels per metre; the density was lowered to \
                 {density:.3}",
                params.max_pages, params.page_size
            ),
        );
    }
    for (&mesh, name) in subject.meshes.iter().zip(subject.names).filter(|(m, _)| caps[**m] < densities.wanted(**m)) {
        warnings.add(
            format!("{name} ({:.3} texels per metre)", caps[mesh]),
            "the surface is larger than a page at this density; its own density was lowered",
        );
    }
}

/// The density of each mesh at which a chart is as long as a page of `side` squared, or all of them hold far more than
/// it.
pub fn caps(subject: &Subject, side: u32, spacing: Spacing) -> Vec<f64> {
    let side = f64::from(side.saturating_sub(2 * spacing.margin()).max(1));
    let cap = |sizes: &mut dyn Iterator<Item = DVec2>| {
        let (longest, area) = sizes.fold((0f64, 0.0), |(l, a), s| (l.max(s.max_element()), a + s.x * s.y));
        // Half a texel less than the side, since sizes are rounded; boxes may overlap, hence the 4.
        ((side + 0.49) / longest).min(2.0 * side / area.sqrt())
    };
    let content = subject.contents.iter().map(|content| match content {
        Content::Charts(charts) | Content::Shared(charts) => cap(&mut charts.iter().map(|c| c.size * c.factor)),
        Content::Authored { size } => cap(&mut std::iter::once(*size)),
        Content::Unused => f64::INFINITY,
    });
    content.collect()
}

/// Texels in the boxes of all charts of `surfaces`.
fn demand(subject: &Subject, surfaces: &[usize], densities: &Densities) -> f64 {
    let boxes = |mesh: usize| -> f64 {
        match &subject.contents[mesh] {
            Content::Charts(charts) | Content::Shared(charts) => {
                charts.iter().map(|c| c.size.x * c.size.y * c.factor.powi(2)).sum()
            }
            Content::Authored { size } => size.x * size.y,
            Content::Unused => 0.0,
        }
    };
    let boxes: Vec<f64> = (0..subject.contents.len()).map(boxes).collect();
    surfaces.iter().map(|&s| subject.meshes[s]).map(|m| boxes[m] * densities.of(m).powi(2)).sum()
}

/// Every mesh at its density.
pub fn measure(
    subject: &Subject,
    densities: &Densities,
    spacing: Spacing,
    progress: &dyn Progress,
) -> Result<Vec<Sized>> {
    let measure = |(mesh, content): (usize, &Content)| {
        progress.check()?;
        let density = densities.of(mesh);
        let size = |c: &Chart| pack::texel_size(c.size, density * c.factor, spacing.least);
        let boxes = |charts: &[Chart]| charts.iter().map(size).collect();
        let pieces = |charts: &[Chart]| charts.iter().map(|c| Piece::chart(c, size(c))).collect::<Vec<_>>();
        let texels = |pieces: &[Piece]| pieces.iter().map(|p| p.mask.texels).sum();
        Ok(match content {
            Content::Charts(charts) => {
                let pieces = pieces(charts);
                let texels = texels(&pieces);
                Sized { pieces, charts: boxes(charts), block: None, texels }
            }
            Content::Shared(charts) => {
                let inner = pieces(charts);
                let block = pack::block(&inner.iter().collect::<Vec<_>>(), spacing, progress)?;
                let texels = texels(&inner);
                Sized { pieces: vec![Piece::rectangle(block.size)], charts: boxes(charts), block: Some(block), texels }
            }
            Content::Authored { size } => {
                let pieces = vec![Piece::rectangle(pack::texel_size(*size, density, spacing.least))];
                let texels = texels(&pieces);
                Sized { pieces, texels, ..Sized::default() }
            }
            Content::Unused => Sized::default(),
        })
    };
    subject.contents.par_iter().enumerate().map(measure).collect()
}
