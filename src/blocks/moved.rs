//! What blocks see after some surfaces have moved or changed: what the change can't touch is kept.
//!
//! Of a block, a change can touch the links whose way, from the block's middle to that of a patch, passes near its old or new box: that is
//! told without tracing. These links are dropped, and others drawn from cones around the boxes, more closely than before, as nothing is
//! known of what shines; of those the ones stay of which the same is true. So each patch is seen by links of the one kind or of the
//! other, whichever way they were found, and no light is made or lost between them, however often things move.

use super::SHARE;
use super::backs::BackLamps;
use super::block::{Block, Blocks};
use super::field::Field;
use super::kept::{GONE, Kept, OldBlocks, Targets};
use super::link::{Half, Link, Sight};
use super::respond::is_curved;
use super::shoot::{Aimed, Draw, Sampled, Samples, Scratch};
use super::{BlockParams, REACH, Seen, kept};
use crate::Result;
use crate::color::Rgb;
use crate::light::{Direct, Lit};
use crate::patch::NONE;
use crate::progress::Progress;
use crate::sample::sequence::Stage;
use crate::sample::warp::{cap, frame};
use crate::work::{Change, Work};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Samples in each half of blocks of which nothing is known.
const NEW: u32 = 128;

/// How many times as many samples there are as a hemisphere of them has in the same directions.
const CLOSER: f32 = 2.0;

/// Samples in each half towards a box, at least.
const LEAST: u32 = 4;

/// Numbers of points from here on are those of samples towards boxes.
const FIRST_POINT: u32 = 1 << 20;

/// How many times as many links there may be as when all blocks were last looked at.
const MOST_LINKS: u64 = 2;

/// Samples in each half of the parts of blocks that are split, at least.
const FEWEST: u32 = 32;

/// Blocks may be split where what changed is nearer than so many times their side.
const NEAR: f32 = 2.0;

/// Quarterings from the coarsest blocks to single texels.
const LEVELS: usize = 3;

/// How far beyond what the change can touch samples are drawn, over how far a block reaches: what is seen there is told by the middles of
/// block and patch, and both reach beyond these.
const MARGIN: f32 = 1.0;

/// Where what changed lies, or did, as a block sees it.
#[derive(Clone, Copy)]
pub struct Towards<'a> {
    from: Vec3,
    /// How far from its middle the block reaches [m].
    reach: f32,
    boxes: &'a [[Vec3; 2]],
}

impl<'a> Towards<'a> {
    /// From block `b`.
    pub fn new(lit: &Lit, blocks: &Blocks, b: usize, boxes: &'a [[Vec3; 2]]) -> Self {
        let patches = lit.ground.patches;
        let from = blocks.list[b].centre;
        let reach = |&i: &u32| patches.position[i as usize].distance(from) + patches.area[i as usize].sqrt();
        Self { from, reach: blocks.members(b).iter().map(reach).fold(0.0, f32::max), boxes }
    }

    /// Directions near the boxes, of block `b`, as close as `count` in each half over the hemisphere are, and closer.
    fn aim(&self, draw: &Draw, b: usize, count: u32) -> Vec<Aimed> {
        let wanted = |cone: Cone| {
            let wanted = (CLOSER * count as f32 * cone.solid_angle / PI).ceil() as u32;
            (cone, wanted.clamp(LEAST, 2 * count.max(LEAST)))
        };
        let cones: Vec<(Cone, u32)> = self.boxes.iter().map(|bounds| wanted(self.cone(bounds))).collect();
        let density = |(cone, samples): &(Cone, u32)| *samples as f32 / cone.solid_angle;
        let mut aimed = Vec::new();
        for half in 0..2 {
            let sequence = draw.sequence(Stage::Block, b, half);
            let mut index = FIRST_POINT;
            for (cone, samples) in &cones {
                let frame = frame(cone.axis);
                for _ in 0..*samples {
                    let [x, y, u, v] = sequence.point(index, 0);
                    index += 1;
                    let direction = frame * cap([u, v], cone.cos);
                    if self.is_near(direction) {
                        let expected = cones.iter().filter(|(cone, _)| cone.holds(direction)).map(density).sum();
                        aimed.push(Aimed { half, place: [x, y], direction, expected });
                    }
                }
            }
        }
        aimed
    }

    /// The cone that all directions near a box are in.
    fn cone(&self, [low, high]: &[Vec3; 2]) -> Cone {
        let way = 0.5 * (*low + *high) - self.from;
        let (distance, radius) = (way.length(), 0.5 * low.distance(*high) + SQRT_3 * (1.0 + MARGIN) * self.reach);
        let cos = if radius < distance { (1.0 - (radius / distance).powi(2)).sqrt() } else { -1.0 };
        Cone { axis: way.try_normalize().unwrap_or(Vec3::Z), cos, solid_angle: TAU * (1.0 - cos) }
    }

    /// True where some of the boxes lie above the horizon of `block`.
    fn is_above(&self, block: &Block) -> bool {
        let n = block.normal;
        let highest = |[low, high]: &[Vec3; 2]| (Vec3::select(n.cmpgt(Vec3::ZERO), *high, *low) - self.from).dot(n);
        !block.is_flat() || self.boxes.iter().any(|bounds| highest(bounds) > -self.reach)
    }

    /// True where a way from somewhere on the block to what its middle sees along `direction` may meet one of the boxes.
    fn holds(&self, direction: Vec3) -> bool {
        self.meets(direction, self.reach)
    }

    /// True where something that is seen along `direction` from anywhere on the block may lie where the boxes [do](Self::holds).
    fn is_near(&self, direction: Vec3) -> bool {
        self.meets(direction, (1.0 + MARGIN) * self.reach)
    }

    /// True where a ray along `direction` from the block's middle meets one of the boxes with `more` around it.
    fn meets(&self, direction: Vec3, more: f32) -> bool {
        let inverse = direction.recip();
        self.boxes.iter().any(|[low, high]| {
            let (a, b) = ((*low - more - self.from) * inverse, (*high + more - self.from) * inverse);
            // A ray along a side of the box makes a NaN, which both ignore.
            let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
            near <= far && far >= 0.0
        })
    }

    /// Keeps those links of a half that lead where the change can touch them, or else the others; of those to patches, what is `wanted`.
    fn retain(&self, half: &mut Half, touched: bool, lit: &Lit, block: &Block, wanted: impl Fn(&Link) -> bool) {
        let position = &lit.ground.patches.position;
        let leads = |link: &Link| self.holds(kept::way(block, position[link.target().0]));
        half.retain(|link| wanted(link) && leads(link) == touched, |link| self.holds(link.direction()) == touched);
    }
}

/// Directions around an axis.
struct Cone {
    axis: Vec3,
    /// Cosine of the largest angle to it.
    cos: f32,
    /// [sr]
    solid_angle: f32,
}

/// Cosines are taken as this much less: what is drawn at the rim must count as within.
const RIM: f32 = 1e-5;

impl Cone {
    fn holds(&self, direction: Vec3) -> bool {
        direction.dot(self.axis) >= self.cos - RIM
    }
}

/// Half the diagonal of a cube of side 2.
const SQRT_3: f32 = 1.732_050_8;

/// Finds what blocks see, where it is known from `kept` but for a `change`; where that is of other texels, the `lamps` come back.
///
/// # Errors
/// `Cancelled`.
pub fn look_again(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    before: (&Kept, &Change),
    lamps: BackLamps,
    work: &Work,
    progress: &dyn Progress,
) -> Result<std::result::Result<Seen, BackLamps>> {
    progress.begin("links", 0);
    let (kept, change) = before;
    let Some(numbers) = change.numbers(&lit.ground.runs()) else { return Ok(Err(lamps)) };
    let Some(old) = kept.old_blocks(&numbers, lit.ground.patches.len()) else { return Ok(Err(lamps)) };
    let normals = super::shown_normals(lit);
    let normal = |i: usize| normals.as_ref().map_or(lit.ground.patches.normal[i], |n| n[i]);
    let blocks = like(lit, &old);
    let is_changed =
        |b: &Block| change.surfaces[lit.ground.patches.surface(blocks.order[b.first as usize] as usize) as usize];
    // The old block that each is the same as.
    let mut same: Vec<Option<usize>> =
        (0..blocks.list.len()).map(|b| old.same_as(&blocks, b).filter(|_| !is_changed(&blocks.list[b]))).collect();
    let targets = Targets { patches: numbers.len(), numbers: Some(&numbers) };
    let Some(mut sampled) = kept.sampled_of(&blocks, &same, targets) else { return Ok(Err(lamps)) };
    // Where less of it lies in the open than before, what is left of a block may be curved, and needs ways that weren't kept.
    for (b, found) in sampled.iter_mut().enumerate() {
        if is_curved(&blocks, b, &normal) && !found.halves.iter().all(|half| half.links.have_ways()) {
            (*found, same[b]) = (Sampled::default(), None);
        }
    }
    let irradiance = same.iter().enumerate().map(|(b, same)| match same.or_else(|| old.around(&blocks, b)) {
        Some(k) => kept.irradiance.get(k).copied().unwrap_or_default(),
        None => Rgb::ZERO,
    });
    let irradiance = irradiance.collect();
    // What is sampled anew, as closely as before.
    let counts: Vec<u32> = (0..blocks.list.len())
        .map(|b| match same[b] {
            Some(_) if !Towards::new(lit, &blocks, b, &change.boxes).is_above(&blocks.list[b]) => 0,
            Some(_) => sampled[b].drawn.samples(),
            None if blocks.list[b].back => 0,
            None => old.around(&blocks, b).and_then(|k| kept.drawn(k)).map_or(NEW, as_closely),
        })
        .collect();
    drop_touched(lit, &blocks, change, &mut sampled);
    let mut field = Field::with(lit, direct, params, blocks, (sampled, irradiance), lamps, work);
    let number = |before: &u32| numbers.get(*before as usize).copied();
    let back_patches = kept.back_patches.iter().filter_map(number).filter(|&i| field.has_back(i));
    let mut back_patches: Vec<u32> = back_patches.collect();
    back_patches.sort_unstable();
    field.light_backs(&back_patches, progress)?;
    let mut seen = sample_touched(&mut field, &same, &counts, change, progress)?;
    seen.extend(split_near(&mut field, change, progress)?);
    seen.sort_unstable();
    seen.dedup();
    field.follow_backs(seen, progress)?;
    let fronts = field.blocks.fronts();
    let known: Vec<usize> = (fronts..field.blocks.list.len()).filter(|&b| !field.sampled[b].is_empty()).collect();
    field.light_back_blocks(&known, progress)?;
    // Blocks stay small where things have been: in the end it costs less to look at all of them.
    if field.links() > MOST_LINKS * kept.links_at_first {
        return Ok(Err(field.into_lamps()));
    }
    field.find_base();
    let kept = kept::keep(&field, kept.gain, (kept.error, kept.links_at_first), &normal);
    Ok(Ok(Seen { kept, lamps: field.into_lamps() }))
}

/// Splits fronts that are too large for how near something is that changed, as a bake anew would, and samples their parts. Returns the patches whose
/// backs were seen.
fn split_near(field: &mut Field, change: &Change, progress: &dyn Progress) -> Result<Vec<u32>> {
    let reach = REACH * (field.params.error.sqrt() as f32);
    let mut seen = Vec::new();
    for _ in 0..LEVELS {
        let wanted: Vec<bool> =
            (0..field.blocks.fronts()).into_par_iter().map(|b| is_too_near(field, b, change, reach)).collect();
        if !wanted.contains(&true) {
            break;
        }
        let before: Vec<(u32, usize)> = (0..wanted.len())
            .map(|b| {
                let drawn = &field.sampled[b].drawn;
                (as_closely([drawn.hemisphere, drawn.areas]), field.blocks.list[b].texels())
            })
            .collect();
        let origin = field.split(&wanted);
        // Each part has its share, by the root of the area.
        let share = |(b, &o): (usize, &u32)| {
            let (samples, texels) = before[o as usize];
            let share = (field.blocks.list[b].texels() as f32 / texels as f32).sqrt();
            if wanted[o as usize] { ((share * samples as f32) as u32).max(samples.min(FEWEST)) } else { 0 }
        };
        let plan: Vec<u32> = origin.iter().enumerate().take(field.blocks.fronts()).map(share).collect();
        seen.extend(field.glance(&plan, progress)?);
    }
    Ok(seen)
}

/// True where block `b` is larger than `reach` times the harmonic mean of the distances of what it sees, and something that changed is about as
/// near as it is large.
fn is_too_near(field: &Field, b: usize, change: &Change, reach: f32) -> bool {
    let block = &field.blocks.list[b];
    let near = NEAR * block.side();
    let distance = |[low, high]: &[Vec3; 2]| block.centre.distance(block.centre.clamp(*low, *high));
    if block.texels() == 1 || !change.boxes.iter().any(|bounds| distance(bounds) < near) {
        return false;
    }
    let position = &field.lit.ground.patches.position;
    let (mut sum, mut inverse) = (0.0, 0.0);
    for half in &field.sampled[b].halves {
        for ((patch, _), weight) in half.links.targets().zip(&half.weights) {
            sum += weight;
            inverse += weight / position[patch].distance(block.centre).max(f32::MIN_POSITIVE);
        }
    }
    block.side() * inverse > reach * sum
}

/// Samples of a hemisphere that stand for so many over it and towards what shines, of which nothing is known here.
fn as_closely([hemisphere, areas]: [u32; 2]) -> u32 {
    let closer = if areas > 0 { CLOSER } else { 1.0 };
    (closer * (hemisphere + areas) as f32) as u32
}

fn is_there(blocks: &Blocks, (patch, back): (usize, bool)) -> bool {
    patch != GONE && (if back { blocks.back_of[patch] } else { blocks.front_of[patch] }) != NONE
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

/// Drops the links that the change can touch, those to what changed, and those to what is buried now.
fn drop_touched(lit: &Lit, blocks: &Blocks, change: &Change, sampled: &mut [Sampled]) {
    let patches = lit.ground.patches;
    let is_kept = |link: &Link| {
        let (patch, back) = link.target();
        is_there(blocks, (patch, back)) && !change.surfaces[patches.surface(patch) as usize]
    };
    let drop = |(b, found): (usize, &mut Sampled)| {
        let block = &blocks.list[b];
        let towards = Towards::new(lit, blocks, b, &change.boxes);
        if towards.is_above(block) || !found.halves.iter().all(|half| half.links.iter().all(|link| is_kept(&link))) {
            found.halves.iter_mut().for_each(|half| towards.retain(half, false, lit, block, is_kept));
        }
    };
    sampled.par_iter_mut().enumerate().with_max_len(SHARE).for_each(drop);
}

/// Samples blocks that aren't the `same` as before as a whole, and others in the directions that the change can touch: `counts` samples
/// for each half. Returns the patches whose backs were seen.
fn sample_touched(
    field: &mut Field,
    same: &[Option<usize>],
    counts: &[u32],
    change: &Change,
    progress: &dyn Progress,
) -> Result<Vec<u32>> {
    let mut sampled = std::mem::take(&mut field.sampled);
    let (blocks, lit) = (&field.blocks, field.lit);
    let draw = Draw { lit, blocks, seed: field.params.seed };
    let one = |b: usize, found: &mut Sampled, scratch: &mut Scratch| -> Vec<u32> {
        let from = found.halves.each_ref().map(|half| half.links.len());
        match same[b] {
            Some(_) => {
                let towards = Towards::new(lit, blocks, b, &change.boxes);
                let aimed = towards.aim(&draw, b, counts[b]);
                let mut fresh = Sampled::default();
                draw.along(b, &aimed, &mut fresh, scratch);
                for (half, mut fresh) in found.halves.iter_mut().zip(fresh.halves) {
                    // As links are told apart when they are dropped.
                    towards.retain(&mut fresh, true, lit, &blocks.list[b], |_| true);
                    half.join(fresh);
                }
            }
            None => {
                let hemisphere = counts[b];
                draw.sample(b, Samples { hemisphere, areas: 0, guide: None, view: None }, found, scratch);
                found.weigh(&Sight::default());
                found.close();
            }
        }
        let new = found.halves.iter().zip(from).flat_map(|(half, from)| half.links.targets().skip(from));
        new.filter(|(_, back)| *back).map(|(patch, _)| patch as u32).collect()
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
    Ok(seen)
}
