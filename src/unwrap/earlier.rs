//! Places as an earlier atlas had them: what hasn't changed stays where it is while other things come, go and change.
//!
//! Surfaces are known by name, and by the sizes of their charts in texels at the earlier density; of several that are alike, those that
//! stand where one stood come first. Others get what room there is between them, or pages behind theirs. Whether a place is free is
//! told by the bitmaps of the charts, so that nothing depends on what the names say.

use super::layout::{Densities, Layout, Sized, Subject, caps, measure, warn_of_lowered};
use super::mask::Page;
use super::pack::{Order, Slot};
use super::pages::{Paging, add_hidden, assign, cost, place_surfaces};
use super::{Density, UnwrapParams};
use crate::error::{Result, Warnings};
use crate::progress::Progress;
use glam::Affine3A;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// How much of the scene's texels may have come or gone before all is laid out anew, at another density.
const LEAST_SHARE: f64 = 0.8;
const MOST_SHARE: f64 = 1.25;

/// The least share of the texels that must keep their places, or all is laid out anew.
const LEAST_KEPT: f64 = 0.5;

/// How an atlas was laid out, as far as a later one keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Places {
    /// The parameters, as they are printed.
    params: String,
    /// Sizes of the shown pages [texels].
    pages: Vec<[u32; 2]>,
    /// Texels per metre, and before it was lowered.
    density: f64,
    asked: f64,
    padding: u32,
    /// The density at which the shown surfaces had one texel in all when all was laid out.
    one: f64,
    /// Of shown surfaces.
    surfaces: Vec<Place>,
}

/// The place of a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Place {
    name: String,
    stand: [f32; 12],
    /// Texels per metre of its own.
    density: f64,
    /// Sizes of its pieces [texels].
    sizes: Vec<[u32; 2]>,
    page: u32,
    slots: Vec<Slot>,
}

fn told(params: &UnwrapParams) -> String {
    format!("{params:?}")
}

fn sizes(sized: &Sized) -> Vec<[u32; 2]> {
    sized.pieces.iter().map(|piece| piece.mask.size).collect()
}

impl Places {
    /// What later atlases may keep of `layout`; `stands` are the places of surfaces in space.
    pub(super) fn new(subject: &Subject, stands: &[Affine3A], layout: &Layout, params: &UnwrapParams) -> Self {
        let place = |s: usize| {
            let (mesh, (page, slots)) = (subject.meshes[s], layout.surfaces[s].clone());
            let (density, sizes) = (layout.densities[mesh], sizes(&layout.sized[mesh]));
            Place { name: subject.names[s].to_owned(), stand: stands[s].to_cols_array(), density, sizes, page, slots }
        };
        Self {
            params: told(params),
            pages: layout.pages[..layout.shown_pages].to_vec(),
            density: layout.density,
            asked: layout.asked,
            padding: layout.padding,
            one: subject.density_of(1.0),
            surfaces: subject.surfaces(true).into_iter().map(place).collect(),
        }
    }

    /// The same, of an atlas that kept places of one `before`: how much has come and gone is counted from the first of them on.
    pub(super) fn after(self, before: Option<&Self>) -> Self {
        Self { one: before.map_or(self.one, |before| before.one), ..self }
    }

    /// True where it is of an atlas made as `params` say, of about as many texels.
    fn fits(&self, subject: &Subject, params: &UnwrapParams) -> bool {
        let texels = (self.one / subject.density_of(1.0)).powi(2);
        self.params == told(params) && self.padding == params.padding && (LEAST_SHARE..=MOST_SHARE).contains(&texels)
    }

    /// Which of the earlier places each surface has, if any: of those of its name and its charts' sizes the one where it stands, else the
    /// first that is left.
    fn of_surfaces(&self, subject: &Subject, stands: &[Affine3A], sized: &[Sized]) -> Vec<Option<usize>> {
        let mut left: HashMap<(&str, &[[u32; 2]]), Vec<usize>> = HashMap::new();
        for (k, place) in self.surfaces.iter().enumerate().rev() {
            left.entry((&place.name, &place.sizes)).or_default().push(k);
        }
        let sizes: Vec<Vec<[u32; 2]>> = sized.iter().map(sizes).collect();
        let mut found = vec![None; subject.meshes.len()];
        for stands_there in [true, false] {
            for s in subject.surfaces(true) {
                if found[s].is_some() {
                    continue;
                }
                let Some(left) = left.get_mut(&(subject.names[s], &sizes[subject.meshes[s]][..])) else { continue };
                let stand = stands[s].to_cols_array();
                let fits = |k: &usize| !stands_there || self.surfaces[*k].stand == stand;
                found[s] = left.iter().rposition(fits).map(|at| left.remove(at));
            }
        }
        found
    }

    /// The caps on the densities of meshes: those that their surfaces had then, where that is less.
    fn caps(&self, subject: &Subject, mut caps: Vec<f64>) -> Vec<f64> {
        let known: HashMap<&str, f64> = self.surfaces.iter().map(|p| (p.name.as_str(), p.density)).collect();
        for (&mesh, name) in subject.meshes.iter().zip(subject.names) {
            if let Some(density) =
                known.get(name).filter(|density| **density < subject.shares[mesh].at(self.density, self.asked))
            {
                caps[mesh] = caps[mesh].min(*density);
            }
        }
        caps
    }

    /// The layout in which surfaces that are as they were keep their places, and how many do; `None` where too much has changed, or what
    /// is new finds no room.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn keep(
        &self,
        subject: &Subject,
        stands: &[Affine3A],
        params: &UnwrapParams,
        warnings: &mut Warnings,
        progress: &dyn Progress,
    ) -> Result<Option<(Layout, usize)>> {
        if !self.fits(subject, params) {
            return Ok(None);
        }
        let spacing = params.spacing();
        let (page_size, is_single) = match params.density {
            Density::FillPage(side) => (side, true),
            _ => (params.page_size, false),
        };
        let caps = self.caps(subject, caps(subject, page_size, spacing));
        let densities = Densities { shares: subject.shares, caps: &caps, density: self.density, asked: self.asked };
        let sized = measure(subject, &densities, spacing, progress)?;
        let mut pages: Vec<Page> = self.pages.iter().map(|&size| Page::new(size, spacing, spacing.margin())).collect();
        let mut surfaces = vec![(0, Vec::new()); subject.meshes.len()];
        let places = self.of_surfaces(subject, stands, &sized);
        let (mut kept, mut moved) = (Vec::new(), Vec::new());
        for s in subject.surfaces(true) {
            let of = places[s].map(|k| &self.surfaces[k]);
            match of.filter(|place| take(&sized[subject.meshes[s]], place, &mut pages)) {
                Some(place) => {
                    surfaces[s] = (place.page, place.slots.clone());
                    kept.push(s);
                }
                None => moved.push(s),
            }
        }
        let texels = |surfaces: &[usize]| cost(subject, &sized, surfaces, spacing);
        if texels(&kept) < LEAST_KEPT * (texels(&kept) + texels(&moved)) {
            return Ok(None);
        }
        moved.sort_by(|&a, &b| texels(&[b]).total_cmp(&texels(&[a])).then(a.cmp(&b)));
        let max_pages = if is_single { 0 } else { params.max_pages.saturating_sub(pages.len() as u32) };
        let behind = Paging { page_size, max_pages, pages: params.pages, spacing };
        let Some(more) = settle(subject, &sized, moved, &mut pages, &behind, &mut surfaces, progress)? else {
            return Ok(None);
        };
        let mut sizes = self.pages.clone();
        sizes.extend(more);
        let Some(shown_pages) = filled(subject, &surfaces, sizes.len()) else { return Ok(None) };
        sizes.truncate(shown_pages);
        let of_meshes = densities.all();
        let layout = Layout {
            pages: sizes,
            density: self.density,
            asked: self.asked,
            densities: of_meshes,
            padding: self.padding,
            sized,
            surfaces,
            shown_pages,
        };
        let Ok(layout) = add_hidden(subject, layout, &Paging::hidden(page_size, params, is_single), progress)? else {
            return Ok(None);
        };
        if !is_single {
            warn_of_lowered(subject, &densities, params, warnings);
        }
        Ok(Some((layout, kept.len())))
    }
}

/// Takes the texels of a surface at its earlier place; false where they aren't free.
fn take(sized: &Sized, place: &Place, pages: &mut [Page]) -> bool {
    let Some(page) = pages.get_mut(place.page as usize) else { return false };
    let masks = || {
        let masks = sized.pieces.iter().zip(&place.slots);
        masks.map(|(piece, slot)| Some((if slot.turned { piece.turned.as_ref()? } else { &piece.mask }, slot.at)))
    };
    let is_free = place.slots.len() == sized.pieces.len()
        && masks().all(|mask| mask.is_some_and(|(mask, at)| page.is_free(mask, at)));
    if is_free {
        masks().flatten().for_each(|(mask, at)| page.take(mask, at));
    }
    is_free
}

/// The page, and the slots on it, of a surface that finds room between others.
fn between(
    subject: &Subject,
    sized: &[Sized],
    surface: usize,
    pages: &mut [Page],
    progress: &dyn Progress,
) -> Result<Option<(u32, Vec<Slot>)>> {
    for (page, number) in pages.iter_mut().zip(0..) {
        let mut trial = page.clone();
        if let Some(mut slots) = place_surfaces(subject, sized, &[surface], &mut trial, Order::Side, progress)? {
            *page = trial;
            return Ok(Some((number, slots.pop().unwrap_or_default())));
        }
    }
    Ok(None)
}

/// Finds room for the surfaces `moved`, in `surfaces`: between others on `pages`, else on pages `behind` those. The sizes of the latter;
/// `None` where there is no room.
fn settle(
    subject: &Subject,
    sized: &[Sized],
    moved: Vec<usize>,
    pages: &mut [Page],
    behind: &Paging,
    surfaces: &mut [(u32, Vec<Slot>)],
    progress: &dyn Progress,
) -> Result<Option<Vec<[u32; 2]>>> {
    let mut rest = Vec::new();
    for s in moved {
        match between(subject, sized, s, pages, progress)? {
            Some(found) => surfaces[s] = found,
            None => rest.push(s),
        }
    }
    if rest.is_empty() {
        return Ok(Some(Vec::new()));
    }
    let assigned = if behind.max_pages > 0 { assign(subject, sized, &rest, behind, progress)?.ok() } else { None };
    let Some((more, mut places)) = assigned else { return Ok(None) };
    for s in rest {
        let (page, slots) = std::mem::take(&mut places[s]);
        surfaces[s] = (pages.len() as u32 + page, slots);
    }
    Ok(Some(more))
}

/// How many of `count` pages are needed; `None` where one before the last of them would be empty.
fn filled(subject: &Subject, surfaces: &[(u32, Vec<Slot>)], count: usize) -> Option<usize> {
    let mut is_used = vec![false; count];
    subject.surfaces(true).into_iter().for_each(|s| is_used[surfaces[s].0 as usize] = true);
    let needed = is_used.iter().rposition(|used| *used)? + 1;
    is_used[..needed].iter().all(|used| *used).then_some(needed)
}
