//! What blocks see after some surfaces have moved or changed: what the change can't touch is kept.
//!
//! Of a block, the directions that a change can touch are those in which its old or new box lies. Links in these directions are dropped,
//! and samples are drawn as a bake anew would draw them, of which those in these directions alone are traced. Which directions they
//! are is known without tracing, so that both parts are what they would be of a bake anew: no light is made or lost between them.

use super::SHARE;
use super::block::{Block, Blocks};
use super::field::{Field, draw_view};
use super::kept::{Kept, OldBlocks};
use super::link::Sight;
use super::shoot::{Draw, Sampled, Samples, Scratch};
use super::sweep::BackLight;
use super::{BlockParams, Seen, kept};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::light::{Direct, Lit};
use crate::patch::NONE;
use crate::progress::Progress;
use crate::work::{Change, Work};
use glam::Vec3;
use rayon::prelude::*;

/// Samples in each half of blocks of which nothing is known.
const NEW: u32 = 64;

/// Quarterings from the coarsest blocks to single texels.
const LEVELS: usize = 3;

/// How far from its middle a block reaches, over its side.
const REACH: f32 = 1.0;

/// Directions in which what changed lies, or did.
#[derive(Clone, Copy)]
pub struct Towards<'a> {
    from: Vec3,
    reach: f32,
    boxes: &'a [[Vec3; 2]],
}

impl<'a> Towards<'a> {
    /// From `block`.
    pub fn new(block: &Block, boxes: &'a [[Vec3; 2]]) -> Self {
        Self { from: block.centre, reach: REACH * block.side(), boxes }
    }

    /// True where a ray along `direction` from somewhere on the block may meet one of the boxes.
    pub fn holds(&self, direction: Vec3) -> bool {
        let inverse = direction.recip();
        self.boxes.iter().any(|[low, high]| {
            let (a, b) = ((*low - self.reach - self.from) * inverse, (*high + self.reach - self.from) * inverse);
            // A ray along a side of the box makes a NaN, which both ignore.
            let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
            near <= far && far >= 0.0
        })
    }
}

/// Finds what blocks see, where it is known from `kept` but for a `change`; `None` where that is of other texels.
///
/// # Errors
/// `Cancelled`.
pub fn look_again(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    before: (&Kept, &Change),
    work: &Work,
    progress: &dyn Progress,
) -> Result<Option<Seen>> {
    progress.begin("links", 0);
    let (kept, change) = before;
    let Some(old) = kept.old_blocks(lit.ground.patches.len()) else { return Ok(None) };
    let normals = super::shown_normals(lit);
    let normal = |i: usize| normals.as_ref().map_or(lit.ground.patches.normal[i], |n| n[i]);
    let blocks = like(lit, &old);
    let is_changed =
        |b: &Block| change.surfaces[lit.ground.patches.surface(blocks.order[b.first as usize] as usize) as usize];
    // The old block that each is the same as.
    let same: Vec<Option<usize>> =
        (0..blocks.list.len()).map(|b| old.same_as(&blocks, b).filter(|_| !is_changed(&blocks.list[b]))).collect();
    let Some(mut sampled) = kept.sampled_of(lit, &blocks, &same) else { return Ok(None) };
    let irradiance = same.iter().enumerate().map(|(b, same)| match same.or_else(|| old.around(&blocks, b)) {
        Some(k) => kept.irradiance.get(k).copied().unwrap_or_default(),
        None => Rgb::ZERO,
    });
    let irradiance = irradiance.collect();
    // What is sampled anew, as closely as before.
    let counts: Vec<u32> = (0..blocks.list.len())
        .map(|b| match same[b] {
            Some(_) => sampled[b].drawn.samples(),
            None if blocks.list[b].back => 0,
            None => old.around(&blocks, b).and_then(|k| kept.samples(k)).unwrap_or(NEW),
        })
        .collect();
    let dropped = drop_touched(lit, &blocks, change, &mut sampled);
    let fronts = blocks.fronts();
    let mut field = Field::with(lit, direct, params, blocks, sampled, irradiance, work);
    let back_patches: Vec<u32> = kept.back_patches.iter().copied().filter(|&i| field.has_back(i)).collect();
    field.light_backs(&back_patches, progress)?;
    field.find_base();
    field.find_guide(progress)?;
    let seen = sample_touched(&mut field, &same, &counts, &dropped, change, progress)?;
    field.find_base();
    field.follow_backs(seen, progress)?;
    let known: Vec<usize> = (fronts..field.blocks.list.len()).filter(|&b| !field.sampled[b].is_empty()).collect();
    field.light_back_blocks(&known, progress)?;
    field.find_base();
    let kept = kept::keep(&field, kept.gain, &normal);
    let on_backs: BackLight = field.into_on_backs();
    Ok(Some(Seen::joined(kept, Some(on_backs))))
}

fn is_there(blocks: &Blocks, (patch, back): (usize, bool)) -> bool {
    (if back { blocks.back_of[patch] } else { blocks.front_of[patch] }) != NONE
}

/// The blocks of `lit`, split as the old ones were.
fn like(lit: &Lit, old: &OldBlocks) -> Blocks {
    let mut blocks = Blocks::new(lit);
    for _ in 0..LEVELS {
        let is_finer = |b: usize| {
            let block = &blocks.list[b];
            blocks
                .members(b)
                .iter()
                .any(|&i| old.level(i as usize, block.back).is_some_and(|level| level < block.level))
        };
        let wanted: Vec<bool> = (0..blocks.fronts()).map(is_finer).collect();
        if !wanted.contains(&true) {
            break;
        }
        blocks.split(lit, &wanted);
    }
    blocks
}

/// Drops the links in directions that the change can touch, those to what changed, and those to what is buried now. Returns the form
/// factors that each half of each block lost by it, added up.
fn drop_touched(lit: &Lit, blocks: &Blocks, change: &Change, sampled: &mut [Sampled]) -> Vec<[f32; 2]> {
    let patches = lit.ground.patches;
    let drop = |(b, found): (usize, &mut Sampled)| {
        let block = &blocks.list[b];
        let towards = Towards::new(block, &change.boxes);
        found.halves.each_mut().map(|half| {
            half.retain(
                |link| {
                    let (patch, back) = link.target();
                    let direction = kept::way(block, patches.position[patch]);
                    is_there(blocks, (patch, back))
                        && !change.surfaces[patches.surface(patch) as usize]
                        && !towards.holds(direction)
                },
                |link| !towards.holds(link.direction()),
            )
        })
    };
    sampled.par_iter_mut().enumerate().with_max_len(SHARE).map(drop).collect()
}

/// Samples blocks that aren't the `same` as before as a whole, and others in the directions that the change can touch: `counts` samples
/// for each half, in place of links that had the form factors `dropped`. Returns the patches whose backs were seen.
fn sample_touched(
    field: &mut Field,
    same: &[Option<usize>],
    counts: &[u32],
    dropped: &[[f32; 2]],
    change: &Change,
    progress: &dyn Progress,
) -> Result<Vec<u32>> {
    let mut sampled = std::mem::take(&mut field.sampled);
    let (blocks, lit) = (&field.blocks, field.lit);
    let draw = Draw { lit, blocks, seed: field.params.seed };
    let bright = field.bright();
    let one = |b: usize, found: &mut Sampled, scratch: &mut Scratch| -> Vec<u32> {
        let count = counts[b];
        let mut arriving = std::mem::take(&mut scratch.arriving);
        let view = bright.filter(|_| !blocks.list[b].back).and_then(|(guide, reach)| {
            guide.arriving(&blocks.list[b], reach.of(b), &mut arriving);
            draw_view(guide, luminance(field.irradiance[b]), &arriving, count)
        });
        let areas = view.as_ref().map_or(0, |v| v.1);
        let towards = same[b].map(|_| Towards::new(&blocks.list[b], &change.boxes));
        let samples = Samples {
            hemisphere: count - areas,
            areas,
            guide: bright.map(|b| &b.0),
            view: view.as_ref().map(|v| &v.0),
            towards: towards.as_ref(),
        };
        let mut fresh = Sampled::default();
        fresh.drawn.normals = std::mem::take(&mut found.drawn.normals);
        draw.sample(b, samples, &mut fresh, scratch);
        let sight = match bright {
            Some((guide, _)) => Sight::new(guide, &fresh.drawn, arriving),
            None => Sight::default(),
        };
        fresh.weigh(&sight);
        scratch.arriving = sight.expected;
        let backs = fresh.halves.iter().flat_map(|half| half.links.iter().map(|link| link.target()));
        let backs = backs.filter(|(_, back)| *back).map(|(patch, _)| patch as u32).collect();
        match same[b] {
            Some(_) => found.join(fresh, dropped[b]),
            None => {
                fresh.close();
                *found = fresh;
            }
        }
        backs
    };
    let seen: Result<Vec<Vec<u32>>> = sampled
        .par_iter_mut()
        .enumerate()
        .with_max_len(SHARE)
        .filter(|(b, _)| counts[*b] > 0)
        .map_init(
            || Scratch::new(lit.ground),
            |scratch, (b, found)| {
                progress.check()?;
                Ok(one(b, found, scratch))
            },
        )
        .collect();
    field.sampled = sampled;
    let mut seen = seen?.concat();
    seen.sort_unstable();
    seen.dedup();
    field.rays += seen.len() as u64;
    Ok(seen)
}
