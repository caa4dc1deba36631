//! The light between surfaces by links between blocks of texels: the way a bake goes unless another is asked for.
//!
//! A texel of its own would have to look around with thousands of rays to be without noise, as each of its neighbours would. So
//! texels look around together, as blocks ([`block`]): each has links to what it sees, found over the hemisphere and towards what
//! shines ([`shoot`], [`guide`], [`reach`]). Links know nothing of light, so that the same ones serve every bounce ([`sweep`]).
//! Blocks answer for any normal ([`respond`]), share what they know with their neighbours ([`smooth`]), and texels are read in between
//! ([`show`]). Samples go where the noise is and blocks are split where detail is, until the error that was asked for is reached
//! ([`effort`]). Links are kept in few bytes ([`kept`]), for other light as well. Light groups and bounces are told apart by the same links ([`separate`]).

pub mod backs;
mod bits;
pub mod block;
mod effort;
mod field;
pub mod guide;
mod incident;
pub mod kept;
pub mod link;
mod moved;
pub mod reach;
pub mod respond;
mod sampling;
pub mod separate;
pub mod shoot;
pub mod show;
pub mod sky_cells;
pub mod smooth;
pub mod sweep;

use crate::Result;
use crate::color::Rgb;
use crate::gather::{Backs, Gathered};
use crate::light::{Direct, Lit};
use crate::patch::{Cutter, SurfacePoint};
use crate::progress::Progress;
use crate::work::Work;
use backs::BackLamps;
use effort::{Left, Stakes, distances, too_coarse, too_near};
use field::Field;
use glam::{DVec3, Vec3};
use kept::Kept;
pub use moved::look_again;
use rayon::prelude::*;
use respond::{DIFFERENCE, LANDED, Response, Values};
use separate::{Separate, Wanted};
use show::show;
use smooth::{Smoothed, smooth};
use sweep::Swept;

/// What is asked of the exchange.
#[derive(Clone, Debug)]
pub struct BlockParams {
    /// Error that is aimed at: the root mean square of noise and bias together over the mean light, without the worst 1 % of
    /// texels; more than 0.
    pub error: f64,
    /// Samples at most, for each texel on average.
    pub most_samples: f64,
    /// Time that the whole bake may take [s]; none: as long as it needs.
    pub time: Option<f64>,
    /// Reflections counted; none: all. 0: light straight from lights and the sky alone.
    pub max_bounces: Option<u32>,
    /// Remaining change of the light, relative to it, at which sweeps end.
    pub residual: f64,
    /// Whether the sky's part and the standard error of each texel are wanted.
    pub layers: bool,
    /// Whether the gathered part of the light and the difference of its halves are wanted of each texel, as filters need them.
    pub halves: bool,
    pub seed: u32,
}

/// How it went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exchanged {
    pub blocks: usize,
    pub links: u64,
    pub sweeps: u64,
    /// Remaining change of the light, relative to it.
    pub residual: f64,
    /// Estimated errors over the mean light, without the worst 1 % of texels: noise, and what interpolation between blocks misses.
    pub noise: f64,
    pub bias: f64,
    /// The larger of both together and of the same over the light of each place, in part; and what that was where blocks were looked at.
    pub error: f64,
    pub error_before: f64,
}

/// How many times the error that was asked for may be estimated where what blocks see was found in other light, before they look
/// anew.
const ROUGHER: f64 = 1.2;

impl Exchanged {
    /// True where what blocks saw in other light tells too little of this one: where `error` was asked for, and no more than that was left
    /// then.
    pub fn is_rough(&self, error: f64) -> bool {
        self.error > ROUGHER * self.error_before.max(error)
    }
}

/// The kind of work that looks of blocks are, which may be done in parts.
pub const PARTS: &str = "look";

/// Blocks that a thread takes at once, at most: some cost far more than others, and none may wait for one thread's share.
const SHARE: usize = 128;

/// Samples in each half of a block's first look, at most; small blocks make do with one a texel.
const FIRST: u32 = 16;
/// Samples in each half of a block's second look, which knows what shines, at most; small blocks get four a texel.
const SECOND: u32 = 32;

/// Looks for one error, and the number of them after which blocks are split.
const ROUNDS: usize = 6;
const SPLITS: usize = 2;

/// Rounds with fewer samples than this share of all before bring nothing.
const WORTHWHILE: f64 = 0.05;

/// The share of the samples that are left which a look that goes part of the way may take: what is split after it starts anew.
const PART: f64 = 0.6;
/// Samples left, over all before, below which nothing is split: its parts would stay noisier than the whole was.
const LEAST_LEFT: f64 = 0.2;

/// Residual at which sweeps end between rounds.
const ROUGH: f64 = 0.01;

/// A block's side over the harmonic mean of the distances around it, for an error of 1: what varies over a distance misses by
/// its square.
const REACH: f32 = 3.5;

/// Of the error that is aimed at, the part that noise may take, and that the interpolation of a single block may.
const NOISE_PART: f64 = 0.8;
const DETAIL_PART: f32 = 0.5;

/// Estimates are uncertain: the error that is aimed at is this share of the one that was asked for.
const CAUTION: f64 = 0.95;

/// What independent samples' variance becomes by stratification and smoothing, before it is measured.
const GAIN: f32 = 0.3;

/// Errors aimed at one after the other where only a time is given: the first, and each over the one before.
const LADDER: [f64; 2] = [0.08, 0.6];

/// Of the time that may be taken, the part kept for what follows, and for each texel [s].
const KEPT_TIME: [f64; 2] = [0.06, 1.5e-6];

/// A look, judged.
struct Judged {
    smoothed: Smoothed,
    stakes: Stakes,
    left: Left,
}

/// What blocks see.
pub struct Seen {
    pub kept: Kept,
    /// The lamps that light the backs among it.
    pub lamps: BackLamps,
}

/// Finds what blocks see, as closely as the light of `lit` asks for.
///
/// # Errors
/// `Cancelled`.
pub fn look(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    lamps: BackLamps,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Seen> {
    progress.begin("links", 0);
    let normals = shown_normals(lit);
    let normal = |i: usize| normals.as_ref().map_or(lit.ground.patches.normal[i], |n| n[i]);
    let mut run = Run::new(Field::new(lit, direct, params, lamps, work), direct, &normal, progress)?;
    let mut aim = if params.time.is_some() { LADDER[0].max(params.error) } else { params.error };
    let mut left = run.reach(aim)?;
    while aim > params.error && !run.is_late() {
        aim = (aim * LADDER[1]).max(params.error);
        left = run.reach(aim)?;
    }
    let kept = kept::keep(&run.field, run.gain, (left.error(), run.field.links()), &normal);
    tracing::debug!(bytes = kept.links.len(), links = run.field.links(), "kept");
    Ok(Seen { kept, lamps: run.field.into_lamps() })
}

/// Finds the light between surfaces that have `seen` one another, and what is `wanted` of it on its own. The light may be another than
/// the one that they were looked at in.
///
/// # Errors
/// `Cancelled`; `Invalid` where what was seen is of other texels.
pub fn exchange(
    lit: &Lit,
    direct: &Direct,
    params: &BlockParams,
    wanted: Wanted,
    seen: Seen,
    work: &Work,
    progress: &dyn Progress,
) -> Result<(Gathered, Backs, Exchanged)> {
    progress.begin("exchange", 0);
    let normals = shown_normals(lit);
    let normal = |i: usize| normals.as_ref().map_or(lit.ground.patches.normal[i], |n| n[i]);
    let Seen { kept, lamps } = seen;
    let (gain, error_before) = (kept.gain, kept.error);
    let mut field = Field::kept(lit, direct, params, &kept, lamps, work, progress)?;
    drop(kept);
    field.solve(params.residual, progress)?;
    let radiosity = field.system().radiosity(&field.irradiance);
    let backs = field.backs(&radiosity);
    let (responses, variance) = field.responses(&radiosity, &normal);
    let moments = if lit.params.moments { incident::incident(&field, &radiosity) } else { Vec::new() };
    let stakes = Stakes::new(&field, &variance, direct, gain);
    drop(radiosity);
    let (blocks, links) = (field.blocks.list.len(), field.links());
    let separate = Separate::find(&field, wanted, &normal, progress)?;
    // Nothing looks along links any more; they are most of what there is.
    field.forget_links();
    let smoothed = smooth(&field.blocks, &field.around, responses);
    let left = Left::new(&field, &stakes, &smoothed);
    let (noise, bias, error) = (left.noise, left.bias, left.error());
    let Swept { sweeps, residual } = field.swept;
    let exchanged = Exchanged { blocks, links, sweeps, residual, noise, bias, error, error_before };
    let mut gathered = show_all(&field, direct, smoothed, &normal);
    separate.put(&mut gathered);
    Ok((Gathered { noise, moments, ..gathered }, backs, exchanged))
}

/// The exchange under way.
struct Run<'a> {
    field: Field<'a>,
    direct: &'a Direct,
    normal: &'a (dyn Fn(usize) -> Vec3 + Sync),
    progress: &'a dyn Progress,
    /// Harmonic mean of the distances around each front [m].
    distance: Vec<f32>,
    /// Variance of one sample of each front [lx^2]; empty before the second look.
    variance: Vec<f32>,
    gain: f32,
    /// Samples a second, once known.
    rate: Option<f64>,
}

impl<'a> Run<'a> {
    /// A first look around over the hemisphere alone, which tells how near everything is and about how bright, and what shines.
    fn new(
        mut field: Field<'a>,
        direct: &'a Direct,
        normal: &'a (dyn Fn(usize) -> Vec3 + Sync),
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        let fronts = &field.blocks.list[..field.blocks.fronts()];
        let first: Vec<u32> = fronts.iter().map(|b| b.samples(1, FIRST)).collect();
        field.glance(&first, progress)?;
        field.solve(ROUGH, progress)?;
        let distance = distances(&field);
        field.find_bright(progress)?;
        Ok(Self { field, direct, normal, progress, distance, variance: Vec::new(), gain: GAIN, rate: None })
    }

    /// Splits and samples until the error is estimated to be `aim`, or neither brings anything, or time is up.
    fn reach(&mut self, aim: f64) -> Result<Left> {
        // Single texels are three quarterings away.
        let mut is_split = false;
        for _ in 0..3 {
            let near = too_near(&self.field, &self.distance, REACH * aim.sqrt() as f32);
            is_split |= self.split(&near);
        }
        if is_split {
            self.field.meet();
        }
        let mut plan = self.plan(aim, true);
        let mut round = 1;
        loop {
            let judged = self.look(&plan)?;
            if round == ROUNDS || judged.left.error() < CAUTION * aim || self.is_late() {
                return Ok(judged.left);
            }
            let coarse = too_coarse(&self.field, &judged.stakes, &judged.smoothed, DETAIL_PART * aim as f32);
            let can_split = round <= SPLITS && self.samples_left() > LEAST_LEFT * self.field.rays as f64;
            let is_split = can_split && self.split(&coarse);
            if is_split {
                self.field.meet();
            }
            // What has been split may have to be split again, and a first look tells little of how much noise is left when samples
            // become many: the next one goes part of the way.
            plan = self.plan(aim, round == 1 || is_split && round < SPLITS);
            let wanted: u64 = plan.iter().map(|&samples| 2 * u64::from(samples)).sum();
            if !is_split && (wanted as f64) < WORTHWHILE * self.field.rays as f64 {
                return Ok(judged.left);
            }
            round += 1;
        }
    }

    /// Samples for each half of each front: to a first glimpse where nothing is known, else towards the error `aim`, all the way or
    /// part of it.
    fn plan(&self, aim: f64, part: bool) -> Vec<u32> {
        if self.variance.is_empty() {
            let fronts = &self.field.blocks.list[..self.field.blocks.fronts()];
            return fronts.iter().map(|b| b.samples(4, SECOND)).collect();
        }
        let stakes = Stakes::new(&self.field, &self.variance, self.direct, self.gain);
        let target = (NOISE_PART * aim / effort::LOCAL_PART).powi(2) * if part { 2.0 } else { 1.0 };
        stakes.plan(&self.field, target, self.samples_left() * if part { PART } else { 1.0 })
    }

    /// Samples that may still be taken, in the time that is left.
    fn samples_left(&self) -> f64 {
        let texels = self.field.blocks.front_texels() as f64;
        let in_time = self.time_left().zip(self.rate).map_or(f64::INFINITY, |(time, rate)| time * rate);
        (self.field.params.most_samples * texels - self.field.rays as f64).max(0.0).min(in_time)
    }

    /// Looks, solves and judges.
    fn look(&mut self, plan: &[u32]) -> Result<Judged> {
        let (start, rays) = (self.progress.elapsed(), self.field.rays);
        self.field.look(plan, self.progress)?;
        self.field.solve(ROUGH, self.progress)?;
        let radiosity = self.field.system().radiosity(&self.field.irradiance);
        let (responses, variance) = self.field.responses(&radiosity, self.normal);
        self.variance = variance;
        let smoothed = smooth(&self.field.blocks, &self.field.around, responses);
        let stakes = Stakes::new(&self.field, &self.variance, self.direct, self.gain);
        let left = Left::new(&self.field, &stakes, &smoothed);
        let independent = stakes.independent_noise(&self.field);
        if independent > 0.0 {
            self.gain = ((left.local_noise * left.local_noise / independent) as f32).clamp(0.01, 2.0);
        }
        let time = (self.progress.elapsed() - start).as_secs_f64();
        self.rate = Some((self.field.rays - rays) as f64 / time.max(1e-3));
        tracing::debug!(
            blocks = self.field.blocks.list.len(),
            rays = self.field.rays,
            noise = left.noise,
            bias = left.bias,
            local = left.local,
            gain = self.gain,
            "looked"
        );
        Ok(Judged { smoothed, stakes, left })
    }

    /// Splits the fronts that are `wanted`; true where there were any. They have yet to meet.
    fn split(&mut self, wanted: &[bool]) -> bool {
        if !wanted.contains(&true) {
            return false;
        }
        let origin = self.field.split(wanted);
        let follow = |values: &[f32]| -> Vec<f32> {
            if values.is_empty() {
                return Vec::new();
            }
            origin[..self.field.blocks.fronts()].iter().map(|&o| values[o as usize]).collect()
        };
        (self.distance, self.variance) = (follow(&self.distance), follow(&self.variance));
        true
    }

    /// Time that is left for samples [s]; none: any.
    fn time_left(&self) -> Option<f64> {
        let time = self.field.params.time?;
        let texels = self.field.lit.ground.patches.len() as f64;
        let kept = KEPT_TIME[0] * time + KEPT_TIME[1] * texels;
        Some((time - kept - self.progress.elapsed().as_secs_f64()).max(0.0))
    }

    /// True where there is not enough time for a look worth the name.
    fn is_late(&self) -> bool {
        self.field.params.time.zip(self.time_left()).is_some_and(|(time, left)| left < 0.1 * time)
    }
}

/// Blocks to texels.
fn show_all(field: &Field, direct: &Direct, smoothed: Smoothed, normal: &(dyn Fn(usize) -> Vec3 + Sync)) -> Gathered {
    let n = direct.shown.len();
    let responses = kept_means(field, smoothed.responses, normal);
    let (layers, halves) = (field.params.layers, field.params.halves || field.params.layers);
    let none = |wanted: bool| if wanted { vec![Rgb::ZERO; n] } else { Vec::new() };
    let mut gathered = Gathered {
        irradiance: direct.shown.to_vec(),
        standard_error: none(layers),
        difference: none(halves),
        indirect: none(halves),
        sky: none(layers),
        parts: Vec::new(),
        groups: Vec::new(),
        moments: Vec::new(),
        landed_share: vec![0.0; n],
        noise: 0.0,
        sky_inflow: DVec3::ZERO,
        rays: field.rays,
    };
    show(field.lit, &field.blocks, &field.around, &responses, normal, |i, values| {
        gathered.irradiance[i] += respond::irradiance(values);
        gathered.landed_share[i] = values[LANDED];
        if field.lit.ground.casts(i) {
            gathered.sky_inflow += respond::sky(values).as_dvec3() * field.lit.exposure.taking_area(i);
        }
        if halves {
            gathered.difference[i] = Rgb::splat(values[DIFFERENCE]);
            gathered.indirect[i] = respond::irradiance(values);
        }
        if layers {
            let b = field.blocks.front_of[i] as usize;
            gathered.standard_error[i] = Rgb::splat(smoothed.error[b].max(0.0).sqrt());
            gathered.sky[i] = respond::sky(values);
        }
    });
    gathered
}

/// Responses so that the mean over a block's texels, read in between, is about that of the block: peaks and hollows would be cut
/// off, and with them light.
fn kept_means(field: &Field, responses: Vec<Response>, normal: &(dyn Fn(usize) -> Vec3 + Sync)) -> Vec<Response> {
    let blocks = &field.blocks;
    let mut lost: Vec<Values> = responses.iter().zip(&blocks.list).map(|(r, b)| r.at(b.normal)).collect();
    let own = lost.clone();
    let area = &field.lit.exposure.area;
    let whole = |b: usize| blocks.members(b).iter().map(|&i| area[i as usize]).sum::<f32>().max(f32::MIN_POSITIVE);
    let whole: Vec<f32> = (0..own.len()).map(whole).collect();
    show(field.lit, blocks, &field.around, &responses, normal, |i, values| {
        let b = blocks.front_of[i] as usize;
        let share = area[i] / whole[b];
        lost[b].iter_mut().zip(values).for_each(|(lost, value)| *lost -= share * value);
    });
    let keep = |((response, own), lost): ((Response, &Values), &Values)| {
        let kept = std::array::from_fn(|k| if k == DIFFERENCE { own[k] } else { (own[k] + lost[k]).max(0.0) });
        response.moved(own, &kept)
    };
    responses.into_iter().zip(&own).zip(&lost).map(keep).collect()
}

/// The shading normal of every patch, at the middles of its pieces; `None` where irradiance is about the geometric one.
pub fn shown_normals(lit: &Lit) -> Option<Vec<Vec3>> {
    let scene = lit.ground.scene;
    if !lit.params.shading_normals || scene.meshes.iter().all(|m| m.normals.is_empty()) {
        return None;
    }
    let patches = lit.ground.patches;
    let of = |cutter: &mut Cutter, i: usize| {
        let footprint = cutter.footprint(i);
        let mut sum = Vec3::ZERO;
        for piece in &footprint.pieces {
            let SurfacePoint { shading, .. } = piece.facet.point(piece.sample([0.5, 0.5]));
            sum += shading * piece.area;
        }
        sum.try_normalize().unwrap_or(patches.normal[i])
    };
    Some((0..patches.len()).into_par_iter().map_init(|| Cutter::new(lit.ground), of).collect())
}
