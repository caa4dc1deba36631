//! Texel density and pages: how large everything is, and which page it goes on.

use super::chart::Chart;
use super::density::Share;
use super::mask::Page;
use super::pack::{self, Block, Order, Piece, Slot};
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
}

/// Everything has its place.
#[derive(Debug)]
pub struct Layout {
    /// Page sizes [texels].
    pub pages: Vec<[u32; 2]>,
    /// Texels per metre.
    pub density: f64,
    /// Empty texels between charts: those asked for, or as many as there is room for.
    pub padding: u32,
    /// By mesh.
    pub sized: Vec<Sized>,
    /// The page of each surface, and the slots of its mesh's pieces.
    pub surfaces: Vec<(u32, Vec<Slot>)>,
    /// Pages of shown surfaces, which come first.
    pub shown_pages: usize,
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
    /// Area of each surface [m²].
    pub areas: &'a [f64],
    /// Which surfaces lie on pages that are written.
    pub shown: &'a [bool],
    /// The density of each mesh.
    pub shares: &'a [Share],
}

impl Subject<'_> {
    /// The surfaces that are shown, or those that aren't.
    fn surfaces(&self, shown: bool) -> Vec<usize> {
        (0..self.meshes.len()).filter(|&s| self.shown[s] == shown).collect()
    }

    /// The density at which shown surfaces have about `count` texels.
    fn density_of(&self, count: f64) -> f64 {
        let shown = self.surfaces(true).into_iter();
        Share::density_of(shown.map(|s| (self.areas[s], self.shares[self.meshes[s]])), count)
    }
}

/// The density of meshes at some density of the bake.
struct Densities<'a> {
    shares: &'a [Share],
    /// That above which a mesh's charts don't fit a page.
    caps: &'a [f64],
    density: f64,
    /// Before it was lowered.
    asked: f64,
}

impl Densities<'_> {
    /// What mesh `mesh` is to have, whether it fits or not.
    fn wanted(&self, mesh: usize) -> f64 {
        self.shares[mesh].at(self.density, self.asked)
    }

    /// What mesh `mesh` has.
    fn of(&self, mesh: usize) -> f64 {
        self.wanted(mesh).min(self.caps[mesh])
    }
}

/// Why surfaces don't fit their pages.
enum Overflow {
    /// More than `max_pages` are needed; how many times the texels of all pages, about.
    Pages(f64),
    /// This surface alone fills more than a page.
    Surface(usize),
}

/// Finds density and places as `params` ask for. Where charts of the least size, a texel each, don't fit with the
/// padding between them, there is less of it, down to none, with a warning.
///
/// # Errors
/// `Invalid` where nothing fits at any density and padding; `Cancelled`.
pub fn layout(
    subject: &Subject,
    params: &UnwrapParams,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Layout> {
    let mut padding = params.padding;
    loop {
        let params = UnwrapParams { padding, ..params.clone() };
        if let Some(layout) = lay_out(subject, &params, warnings, progress)? {
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
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Option<Layout>> {
    let pages = match params.density {
        Density::FillPage(side) => f64::from(side).powi(2),
        _ => f64::from(params.page_size).powi(2) * f64::from(params.max_pages),
    };
    // A chart of one texel, with its share of the padding.
    let least = f64::from(1 + params.padding).powi(2) * least_pieces(subject) as f64;
    if least > pages {
        return Ok(None);
    }
    match params.density {
        Density::FillPage(side) => fill(subject, side, params, progress),
        Density::TexelsPerMetre(density) => spread(subject, f64::from(density), params, warnings, progress),
        Density::TexelCount(count) => spread(subject, subject.density_of(count as f64), params, warnings, progress),
    }
}

/// Charts of all surfaces: each takes a texel at least.
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

/// One page of `side` squared, filled as well as bisection finds; hidden surfaces on further ones. `None` where nothing fits.
fn fill(subject: &Subject, side: u32, params: &UnwrapParams, progress: &dyn Progress) -> Result<Option<Layout>> {
    let padding = params.padding;
    let shown = subject.surfaces(true);
    let caps = caps(subject, side, padding);
    let attempt = |density: f64| -> Result<Option<Layout>> {
        let densities = Densities { shares: subject.shares, caps: &caps, density, asked: density };
        let is_too_long = |&s: &usize| {
            let mesh = subject.meshes[s];
            subject.shares[mesh].own.is_none() && caps[mesh] < densities.wanted(mesh)
        };
        if shown.iter().any(is_too_long) {
            return Ok(None);
        }
        let sized = measure(subject, &densities, padding, progress)?;
        let count: usize = shown.iter().map(|&s| sized[subject.meshes[s]].pieces.len()).sum();
        if cost(subject, &sized, &shown, padding) > 1.1 * f64::from(side) * f64::from(side) {
            return Ok(None);
        }
        let orders: &[Order] = if count <= FEW { &[Order::Side, Order::Texels] } else { &[Order::Side] };
        for &order in orders {
            let mut page = Page::new([side, side], padding, padding);
            if let Some(slots) = place_surfaces(subject, &sized, &shown, &mut page, order, progress)? {
                let mut layout =
                    Layout { pages: vec![[side, side]], density, padding, sized, surfaces: Vec::new(), shown_pages: 1 };
                layout.surfaces = vec![(0, Vec::new()); subject.meshes.len()];
                shown.iter().zip(slots).for_each(|(&s, slots)| layout.surfaces[s] = (0, slots));
                let hidden = Paging { page_size: side, max_pages: MOST_HIDDEN_PAGES, padding };
                return Ok(add_hidden(subject, layout, &hidden, progress)?.ok());
            }
        }
        Ok(None)
    };
    // All texels of the page are more than can be used, a tenth of them is nearly always possible.
    let most = subject.density_of(f64::from(side).powi(2));
    let (mut high, mut low) = (most, 0.8 * most);
    let mut best = None;
    for _ in 0..64 {
        best = attempt(low)?;
        if best.is_some() {
            break;
        }
        (high, low) = (low, 0.8 * low);
    }
    let Some(mut best) = best else { return Ok(None) };
    for _ in 0..TRIALS {
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
    let paging = Paging { page_size: params.page_size, max_pages: params.max_pages, padding: params.padding };
    let hidden = Paging { max_pages: MOST_HIDDEN_PAGES, ..paging };
    let shown = subject.surfaces(true);
    let mut caps = caps(subject, params.page_size, params.padding);
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
        let sized = measure(subject, &densities, params.padding, progress)?;
        let shown_layout = assign(subject, &sized, &shown, &paging, progress)?;
        let costs_of = |surface: usize| cost(subject, &sized, &[surface], params.padding);
        let overflow = match shown_layout {
            Ok((pages, surfaces)) => {
                // Too large ones among the hidden are found by their cost once the layout has taken the sizes.
                let costs: Vec<f64> = (0..subject.meshes.len()).map(costs_of).collect();
                let shown_pages = pages.len();
                let padding = params.padding;
                let layout = Layout { pages, density, padding, sized, surfaces, shown_pages };
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
fn warn_of_lowered(subject: &Subject, densities: &Densities, params: &UnwrapParams, warnings: &mut Warnings) {
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

/// Hidden pages at most; they cost memory alone.
const MOST_HIDDEN_PAGES: u32 = 1024;

/// Which pages may be filled.
#[derive(Clone, Copy)]
struct Paging {
    page_size: u32,
    max_pages: u32,
    padding: u32,
}

/// Adds pages for the surfaces that aren't shown to the layout of those that are.
fn add_hidden(
    subject: &Subject,
    mut layout: Layout,
    paging: &Paging,
    progress: &dyn Progress,
) -> Result<std::result::Result<Layout, Overflow>> {
    let hidden = subject.surfaces(false);
    if hidden.is_empty() {
        return Ok(Ok(layout));
    }
    let first = layout.pages.len() as u32;
    Ok(assign(subject, &layout.sized, &hidden, paging, progress)?.map(|(pages, mut surfaces)| {
        layout.pages.extend(pages);
        for s in hidden {
            let (page, slots) = std::mem::take(&mut surfaces[s]);
            layout.surfaces[s] = (first + page, slots);
        }
        layout
    }))
}

type Places = (Vec<[u32; 2]>, Vec<(u32, Vec<Slot>)>);

/// Fills page after page with the surfaces `which`.
fn assign(
    subject: &Subject,
    sized: &[Sized],
    which: &[usize],
    paging: &Paging,
    progress: &dyn Progress,
) -> Result<std::result::Result<Places, Overflow>> {
    let Paging { page_size, max_pages, padding } = *paging;
    let costs: Vec<f64> = (0..subject.meshes.len()).map(|s| cost(subject, sized, &[s], padding)).collect();
    let mut left: Vec<usize> = which.to_vec();
    left.sort_by(|&a, &b| costs[b].total_cmp(&costs[a]).then(a.cmp(&b)));
    let full = [page_size; 2];
    let page_area = f64::from(page_size).powi(2);
    let mut pages = Vec::new();
    let mut surfaces = vec![(0, Vec::new()); costs.len()];
    while !left.is_empty() {
        let total: f64 = left.iter().map(|&s| costs[s]).sum();
        if pages.len() == max_pages as usize || total > 1.2 * page_area * f64::from(max_pages) {
            let missing = total / page_area / f64::from(max_pages);
            return Ok(Err(Overflow::Pages((missing + pages.len() as f64 / f64::from(max_pages)) * 1.1)));
        }
        let number = pages.len() as u32;
        // All of the rest on one page, as small a one as holds it.
        let mut done = false;
        for size in page_sizes(page_size).filter(|s| f64::from(s[0]) * f64::from(s[1]) > 0.95 * total).take(5) {
            let mut page = Page::new(size, padding, padding);
            if let Some(slots) = place_surfaces(subject, sized, &left, &mut page, Order::Side, progress)? {
                left.drain(..).zip(slots).for_each(|(s, slots)| surfaces[s] = (number, slots));
                pages.push(size);
                done = true;
                break;
            }
        }
        if done {
            break;
        }
        // As many of the largest as fit, then what else finds room between them.
        let mut page = Page::new(full, padding, padding);
        let mut count = 0;
        for share in [0.95, 0.85, 0.75, 0.65, 0.5, 0.35, 0.0] {
            let mut sum = 0.0;
            let next = left.iter().take_while(|&&s| {
                sum += costs[s];
                sum <= share * page_area
            });
            let next = next.count().max(1);
            if next == count {
                continue;
            }
            count = next;
            page = Page::new(full, padding, padding);
            if let Some(slots) = place_surfaces(subject, sized, &left[..count], &mut page, Order::Side, progress)? {
                left.drain(..count).zip(slots).for_each(|(s, slots)| surfaces[s] = (number, slots));
                done = true;
                break;
            }
        }
        if !done {
            return Ok(Err(Overflow::Surface(left[0])));
        }
        let mut failures = 0;
        let mut kept = Vec::new();
        for s in left {
            if failures < 16 {
                let mut trial = page.clone();
                if let Some(mut slots) = place_surfaces(subject, sized, &[s], &mut trial, Order::Side, progress)? {
                    page = trial;
                    surfaces[s] = (number, slots.pop().unwrap_or_default());
                    continue;
                }
                failures += 1;
            }
            kept.push(s);
        }
        left = kept;
        pages.push(full);
    }
    Ok(Ok((pages, surfaces)))
}

/// Page sizes up to `largest`, small ones first: powers of two from 16 on, square or two to one.
fn page_sizes(largest: u32) -> impl Iterator<Item = [u32; 2]> {
    let mut sizes = vec![[largest; 2]];
    let mut side = 16;
    while side <= largest {
        sizes.push([side, side]);
        if side * 2 <= largest {
            sizes.push([side * 2, side]);
        }
        side *= 2;
    }
    sizes.sort_unstable_by_key(|s| s[0] * s[1]);
    sizes.dedup();
    sizes.into_iter()
}

/// The density of each mesh at which a chart is as long as a page of `side` squared, or all of them hold far more than
/// it.
fn caps(subject: &Subject, side: u32, padding: u32) -> Vec<f64> {
    let side = f64::from(side.saturating_sub(2 * padding).max(1));
    let cap = |sizes: &mut dyn Iterator<Item = DVec2>| {
        let (longest, area) = sizes.fold((0f64, 0.0), |(l, a), s| (l.max(s.max_element()), a + s.x * s.y));
        // Half a texel less than the side, since sizes are rounded; boxes may overlap, hence the 4.
        ((side + 0.49) / longest).min(2.0 * side / area.sqrt())
    };
    let content = subject.contents.iter().map(|content| match content {
        Content::Charts(charts) | Content::Shared(charts) => cap(&mut charts.iter().map(|c| c.size)),
        Content::Authored { size } => cap(&mut std::iter::once(*size)),
        Content::Unused => f64::INFINITY,
    });
    content.collect()
}

/// Texels in the boxes of all charts of `surfaces`.
fn demand(subject: &Subject, surfaces: &[usize], densities: &Densities) -> f64 {
    let boxes = |mesh: usize| -> f64 {
        match &subject.contents[mesh] {
            Content::Charts(charts) | Content::Shared(charts) => charts.iter().map(|c| c.size.x * c.size.y).sum(),
            Content::Authored { size } => size.x * size.y,
            Content::Unused => 0.0,
        }
    };
    let boxes: Vec<f64> = (0..subject.contents.len()).map(boxes).collect();
    surfaces.iter().map(|&s| subject.meshes[s]).map(|m| boxes[m] * densities.of(m).powi(2)).sum()
}

/// Every mesh at its density.
fn measure(subject: &Subject, densities: &Densities, padding: u32, progress: &dyn Progress) -> Result<Vec<Sized>> {
    let measure = |(mesh, content): (usize, &Content)| {
        progress.check()?;
        let density = densities.of(mesh);
        let boxes = |charts: &[Chart]| charts.iter().map(|c| pack::texel_size(c.size, density)).collect();
        let pieces = |charts: &[Chart]| charts.iter().map(|c| Piece::chart(c, density)).collect::<Vec<_>>();
        Ok(match content {
            Content::Charts(charts) => Sized { pieces: pieces(charts), charts: boxes(charts), block: None },
            Content::Shared(charts) => {
                let inner = pieces(charts);
                let block = pack::block(&inner.iter().collect::<Vec<_>>(), padding, progress)?;
                Sized { pieces: vec![Piece::rectangle(block.size)], charts: boxes(charts), block: Some(block) }
            }
            Content::Authored { size } => {
                Sized { pieces: vec![Piece::rectangle(pack::texel_size(*size, density))], ..Sized::default() }
            }
            Content::Unused => Sized::default(),
        })
    };
    subject.contents.par_iter().enumerate().map(measure).collect()
}

/// Texels that `surfaces` take up, about.
fn cost(subject: &Subject, sized: &[Sized], surfaces: &[usize], padding: u32) -> f64 {
    surfaces.iter().flat_map(|&s| &sized[subject.meshes[s]].pieces).map(|p| p.cost(padding)).sum()
}

/// The slots of each surface, or `None` where they don't all fit the page.
fn place_surfaces(
    subject: &Subject,
    sized: &[Sized],
    surfaces: &[usize],
    page: &mut Page,
    order: Order,
    progress: &dyn Progress,
) -> Result<Option<Vec<Vec<Slot>>>> {
    let pieces: Vec<&Piece> = surfaces.iter().flat_map(|&s| &sized[subject.meshes[s]].pieces).collect();
    let Some(slots) = pack::place(page, &pieces, order, progress)? else { return Ok(None) };
    let mut slots = slots.into_iter();
    let counts = surfaces.iter().map(|&s| sized[subject.meshes[s]].pieces.len());
    Ok(Some(counts.map(|n| slots.by_ref().take(n).collect()).collect()))
}
