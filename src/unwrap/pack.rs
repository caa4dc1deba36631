//! Charts to places on pages: bottom-left packing of bitmaps.
//!
//! Charts are placed from large to small, each at the place (of two orientations) where it reaches down least, found by
//! shifting whole rows of the page against the chart's runs. A chart's box is a whole number of texels, so that an edge along
//! an axis lies on a texel border and leaves no texel half covered; that stretches it by up to half a texel.

use super::chart::Chart;
use super::mask::{Mask, Page, Spacing};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Boxes of up to this many texels are packed as boxes: their shape gains little, and equal boxes pack much faster.
const SMALL: u64 = 36;

/// Something to place.
#[derive(Clone, Debug)]
pub struct Piece {
    pub mask: Mask,
    /// The mask turned by 90 degrees, where that is allowed.
    pub turned: Option<Mask>,
}

/// Where a piece went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slot {
    /// Its top left texel.
    pub at: [u32; 2],
    pub turned: bool,
}

/// What comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The longest side.
    Side,
    /// The most texels.
    Texels,
    /// The longest sum of both sides.
    Round,
    /// The longest shorter side.
    Width,
}

impl Order {
    /// All there are.
    pub const ALL: [Self; 4] = [Self::Side, Self::Texels, Self::Round, Self::Width];
}

impl Piece {
    /// A chart in a box of `size` texels.
    pub fn chart(chart: &Chart, size: [u32; 2]) -> Self {
        let mask = mask(chart, size);
        let turned = (size[0] != size[1] || !mask.is_full()).then(|| mask.turned());
        Self { mask, turned }
    }

    /// A rectangle that keeps its orientation.
    pub fn rectangle(size: [u32; 2]) -> Self {
        Self { mask: Mask::full(size), turned: None }
    }

    /// Texels that it takes up with its share of the padding, about.
    pub fn cost(&self, spacing: Spacing) -> f64 {
        let [w, h] = self.mask.size;
        let around = f64::from(spacing.taken(w)) * f64::from(spacing.taken(h)) - f64::from(w) * f64::from(h);
        self.mask.texels as f64 + around
    }
}

/// The box of a chart or rectangle of `size` [m] at `density` [texels/m]: whole texels, at least `least` each way.
pub fn texel_size(size: DVec2, density: f64, least: u32) -> [u32; 2] {
    // 2^20 texels are beyond any page, and keep sums of sizes in range.
    (size * density).to_array().map(|s| s.round().clamp(f64::from(least), 1048576.0) as u32)
}

/// The texels that a chart touches in a box of `size` texels.
pub fn mask(chart: &Chart, size: [u32; 2]) -> Mask {
    let mask = Mask::full(size);
    if mask.texels <= SMALL {
        return mask;
    }
    let scale = scale(chart, size);
    Mask::of_triangles(size, chart.uv.iter().map(|t| t.map(|p| p * scale)))
}

fn scale(chart: &Chart, size: [u32; 2]) -> DVec2 {
    DVec2::new(f64::from(size[0]), f64::from(size[1])) / chart.size
}

/// Texel coordinates of a chart's UVs when its box is `size` texels and lies at `slot`.
pub fn texels(chart: &Chart, size: [u32; 2], slot: Slot) -> impl Iterator<Item = [DVec2; 3]> {
    let [w, h] = size.map(f64::from);
    let at = DVec2::new(f64::from(slot.at[0]), f64::from(slot.at[1]));
    chart.uv.iter().map(move |t| {
        t.map(|p| {
            // Divided first: what lies on the box's far side comes out there exactly.
            let p = p / chart.size * DVec2::new(w, h);
            at + if slot.turned { DVec2::new(h - p.y, p.x) } else { p }
        })
    })
}

/// Places all pieces on `page`, or `None` where they don't fit; the page is then half filled.
///
/// # Errors
/// `Cancelled`.
pub fn place(page: &mut Page, pieces: &[&Piece], order: Order, progress: &dyn Progress) -> Result<Option<Vec<Slot>>> {
    let mut sequence: Vec<usize> = (0..pieces.len()).collect();
    sequence.sort_by_key(|&i| {
        let mask = &pieces[i].mask;
        let [long, short] = [mask.size[0].max(mask.size[1]), mask.size[0].min(mask.size[1])].map(u64::from);
        let keys = match order {
            Order::Side => [long, mask.texels],
            Order::Texels => [mask.texels, long],
            Order::Round => [long + short, mask.texels],
            Order::Width => [short, long],
        };
        (std::cmp::Reverse(keys), std::cmp::Reverse(mask.size), i)
    });
    // Rows above which a box of this size found no place; pages only fill up, so it won't later.
    let mut start: HashMap<[u32; 2], u32> = HashMap::new();
    let mut slots = vec![Slot::default(); pieces.len()];
    for (n, &i) in sequence.iter().enumerate() {
        if n % 64 == 0 {
            progress.check()?;
        }
        let mut best: Option<(u32, u32, Slot)> = None;
        for (turned, mask) in [(false, Some(&pieces[i].mask)), (true, pieces[i].turned.as_ref())] {
            let Some(mask) = mask else { continue };
            let known = if mask.is_full() { start.get(&mask.size).copied().unwrap_or(0) } else { 0 };
            // Further down than the other orientation it is of no use.
            let end = best.map_or(page.size[1], |(reach, ..)| (reach + 1).saturating_sub(mask.size[1]));
            let found = page.find(mask, known, end);
            if mask.is_full() {
                start.insert(mask.size, found.map_or(end.max(known), |at| at[1]));
            }
            if let Some(at) = found {
                let reach = at[1] + mask.size[1];
                if best.is_none_or(|(r, x, _)| (reach, at[0]) < (r, x)) {
                    best = Some((reach, at[0], Slot { at, turned }));
                }
            }
        }
        let Some((_, _, slot)) = best else { return Ok(None) };
        let mask = if slot.turned { pieces[i].turned.as_ref().unwrap_or(&pieces[i].mask) } else { &pieces[i].mask };
        page.take(mask, slot.at);
        slots[i] = slot;
    }
    Ok(Some(slots))
}

/// The charts of a shared mesh in a rectangle of their own.
#[derive(Clone, Debug)]
pub struct Block {
    /// Size [texels].
    pub size: [u32; 2],
    pub slots: Vec<Slot>,
}

/// Packs pieces into the smallest rectangle that a few widths give, without a margin.
///
/// # Errors
/// `Cancelled`.
pub fn block(pieces: &[&Piece], spacing: Spacing, progress: &dyn Progress) -> Result<Block> {
    let cost: f64 = pieces.iter().map(|p| p.cost(spacing)).sum();
    let sides = |k: usize| pieces.iter().map(move |p| p.mask.size[k]);
    let longest = sides(0).chain(sides(1)).max().unwrap_or(1);
    let shortest = pieces.iter().map(|p| p.mask.size[0].min(p.mask.size[1])).max().unwrap_or(1);
    let mut best: Option<Block> = None;
    for aspect in [0.7, 0.85, 1.0, 1.15, 1.4] {
        let width = ((cost * aspect).sqrt().ceil() as u32).max(shortest);
        // High enough for all on top of each other, in steps so that a usual bitmap stays small.
        let mut height = ((cost / f64::from(width) * 1.5) as u32).max(longest) + spacing.padding;
        let slots = loop {
            let mut page = Page::new([width, height], spacing, 0);
            if let Some(slots) = place(&mut page, pieces, Order::Side, progress)? {
                break slots;
            }
            height *= 2;
        };
        let size = reach(pieces, &slots);
        let padded = |s: [u32; 2]| u64::from(spacing.taken(s[0])) * u64::from(spacing.taken(s[1]));
        if best.as_ref().is_none_or(|b| padded(size) < padded(b.size)) {
            best = Some(Block { size, slots });
        }
    }
    Ok(best.expect("at least one width was tried"))
}

/// The first column and row that no piece reaches.
pub fn reach(pieces: &[&Piece], slots: &[Slot]) -> [u32; 2] {
    slots.iter().zip(pieces).fold([1, 1], |[w, h], (slot, piece)| {
        let [a, b] = piece.mask.size;
        let [a, b] = if slot.turned { [b, a] } else { [a, b] };
        [w.max(slot.at[0] + a), h.max(slot.at[1] + b)]
    })
}
