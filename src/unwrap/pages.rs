//! Which page each surface goes on, and how large the pages are.

use super::layout::{Layout, Sized, Subject};
use super::mask::{Page, Spacing};
use super::pack::{self, Order, Piece, Slot};
use super::{PageSizes, UnwrapParams};
use crate::error::Result;
use crate::progress::Progress;

/// Why surfaces don't fit their pages.
pub enum Overflow {
    /// More than `max_pages` are needed; how many times the texels of all pages, about.
    Pages(f64),
    /// This surface alone fills more than a page.
    Surface(usize),
}

/// Which pages may be filled.
#[derive(Clone, Copy)]
pub struct Paging {
    pub page_size: u32,
    pub max_pages: u32,
    pub pages: PageSizes,
    pub spacing: Spacing,
}

/// Hidden pages at most; they cost memory alone.
const MOST_HIDDEN_PAGES: u32 = 1024;

impl Paging {
    /// Pages of up to `page_size` squared for surfaces that aren't shown, behind a `single` page or several.
    pub fn hidden(page_size: u32, params: &UnwrapParams, single: bool) -> Self {
        let pages = if single { PageSizes::Pot } else { params.pages };
        Self { page_size, max_pages: MOST_HIDDEN_PAGES, pages, spacing: params.spacing() }
    }
}

/// Adds pages for the surfaces that aren't shown to the layout of those that are.
pub fn add_hidden(
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

/// Page sizes, and the page and slots of each surface.
pub type Places = (Vec<[u32; 2]>, Vec<(u32, Vec<Slot>)>);

/// Fills page after page with the surfaces `which`.
pub fn assign(
    subject: &Subject,
    sized: &[Sized],
    which: &[usize],
    paging: &Paging,
    progress: &dyn Progress,
) -> Result<std::result::Result<Places, Overflow>> {
    let Paging { page_size, max_pages, spacing, .. } = *paging;
    let costs: Vec<f64> = (0..subject.meshes.len()).map(|s| cost(subject, sized, &[s], spacing)).collect();
    let mut left: Vec<usize> = which.to_vec();
    left.sort_by(|&a, &b| costs[b].total_cmp(&costs[a]).then(a.cmp(&b)));
    let page_area = f64::from(page_size).powi(2);
    let mut pages = Vec::new();
    let mut surfaces = vec![(0, Vec::new()); costs.len()];
    let mut is_placed = vec![false; costs.len()];
    while !left.is_empty() {
        let total: f64 = left.iter().map(|&s| costs[s]).sum();
        if pages.len() == max_pages as usize || total > 1.2 * page_area * f64::from(max_pages) {
            let missing = total / page_area / f64::from(max_pages);
            return Ok(Err(Overflow::Pages((missing + pages.len() as f64 / f64::from(max_pages)) * 1.1)));
        }
        let number = pages.len() as u32;
        if let Some((size, slots)) = last_page(subject, sized, &left, total, paging, progress)? {
            left.drain(..).zip(slots).for_each(|(s, slots)| surfaces[s] = (number, slots));
            pages.push(size);
            break;
        }
        let Some((size, placed)) = full_page(subject, sized, &left, &costs, paging, progress)? else {
            return Ok(Err(Overflow::Surface(left[0])));
        };
        for (s, slots) in placed {
            surfaces[s] = (number, slots);
            is_placed[s] = true;
        }
        left.retain(|&s| !is_placed[s]);
        pages.push(size);
    }
    Ok(Ok((pages, surfaces)))
}

/// A surface and its slots.
type Placed = (usize, Vec<Slot>);

/// The size of a page, and what lies on it.
type Filled<T> = ([u32; 2], Vec<T>);

/// All of `left`, which take up about `total` texels, on one page, as small a one as holds them; `None` where none does.
fn last_page(
    subject: &Subject,
    sized: &[Sized],
    left: &[usize],
    total: f64,
    paging: &Paging,
    progress: &dyn Progress,
) -> Result<Option<Filled<Vec<Slot>>>> {
    let spacing = paging.spacing;
    let attempt = |size: [u32; 2]| -> Result<_> {
        let mut page = Page::new(size, spacing, spacing.margin());
        let slots = place_surfaces(subject, sized, left, &mut page, Order::Side, progress)?;
        Ok(slots.map(|slots| (size, slots)))
    };
    if paging.pages == PageSizes::Pot {
        let sizes = page_sizes(paging.page_size);
        for size in sizes.filter(|s| f64::from(s[0]) * f64::from(s[1]) > 0.95 * total).take(5) {
            if let Some(found) = attempt(size)? {
                return Ok(Some(found));
            }
        }
        return Ok(None);
    }
    // Sides of squares: up from what the charts take in growing steps, then by bisection; and what is left over is cut off.
    let step = paging.spacing.align.max(FREE_STEP);
    let most = (paging.page_size / step).max(1);
    let mut low = (((0.9 * total).sqrt() / f64::from(step)) as u32).clamp(1, most);
    let (mut high, mut stride) = (most + 1, low / 16 + 1);
    let mut best = None;
    while low < high {
        let middle = if best.is_none() { (low + stride).min(most) } else { (low + high) / 2 };
        stride *= 2;
        match attempt([middle * step; 2])? {
            Some(found) => (best, high) = (Some(found), middle),
            None => low = middle + 1,
        }
    }
    Ok(best.map(|(size, slots)| (cropped(subject, sized, left, &slots, size, paging), slots)))
}

/// As many of the largest of `left` as fit a full page, then what else finds room between them; `None` where the largest alone
/// doesn't fit.
fn full_page(
    subject: &Subject,
    sized: &[Sized],
    left: &[usize],
    costs: &[f64],
    paging: &Paging,
    progress: &dyn Progress,
) -> Result<Option<Filled<Placed>>> {
    let full = [paging.page_size; 2];
    let page_area = f64::from(paging.page_size).powi(2);
    let empty = || Page::new(full, paging.spacing, paging.spacing.margin());
    let mut page = empty();
    let mut count = 0;
    let mut placed: Option<Vec<(usize, Vec<Slot>)>> = None;
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
        page = empty();
        if let Some(slots) = place_surfaces(subject, sized, &left[..count], &mut page, Order::Side, progress)? {
            placed = Some(left[..count].iter().copied().zip(slots).collect());
            break;
        }
    }
    let Some(mut placed) = placed else { return Ok(None) };
    let mut failures = 0;
    for &s in &left[count..] {
        if failures == 16 {
            break;
        }
        let mut trial = page.clone();
        match place_surfaces(subject, sized, &[s], &mut trial, Order::Side, progress)? {
            Some(mut slots) => {
                page = trial;
                placed.push((s, slots.pop().unwrap_or_default()));
            }
            None => failures += 1,
        }
    }
    let (which, slots): (Vec<usize>, Vec<Vec<Slot>>) = placed.into_iter().unzip();
    let size = match paging.pages {
        PageSizes::Pot => full,
        PageSizes::Free => cropped(subject, sized, &which, &slots, full, paging),
    };
    Ok(Some((size, which.into_iter().zip(slots).collect())))
}

/// What is left of a page of `size` without the rows and columns that `surfaces` leave free beyond their margin.
fn cropped(
    subject: &Subject,
    sized: &[Sized],
    surfaces: &[usize],
    slots: &[Vec<Slot>],
    size: [u32; 2],
    paging: &Paging,
) -> [u32; 2] {
    let step = paging.spacing.align.max(FREE_STEP);
    let pieces: Vec<&Piece> = surfaces.iter().flat_map(|&s| &sized[subject.meshes[s]].pieces).collect();
    let reach = pack::reach(&pieces, &slots.concat());
    [0, 1].map(|k| (reach[k] + paging.spacing.margin()).next_multiple_of(step).min(size[k]))
}

/// Free page sizes are multiples of this [texels]: blocks of compressed textures are 4 wide.
const FREE_STEP: u32 = 4;

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

/// Texels that `surfaces` take up, about.
pub fn cost(subject: &Subject, sized: &[Sized], surfaces: &[usize], spacing: Spacing) -> f64 {
    surfaces.iter().flat_map(|&s| &sized[subject.meshes[s]].pieces).map(|p| p.cost(spacing)).sum()
}

/// The slots of each surface, or `None` where they don't all fit the page.
pub fn place_surfaces(
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
