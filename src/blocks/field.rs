//! The light of a scene as blocks have it, while it is being found.

use super::backs::{BackLamps, mean_on_back, params_of_backs};
use super::block::Blocks;
use super::guide::{Guide, View};
use super::kept::Kept;
use super::link::SkyLink;
use super::reach::Reach;
use super::respond::Response;
use super::sampling::{Sampling, Source};
use super::shoot::{Draw, Sampled};
use super::show::neighbours;
use super::sky_cells::{Escaped, SkyCells};
use super::sweep::{BackLight, Radiosity, Swept, System};
use super::{BlockParams, PARTS, SHARE};
use crate::color::{Rgb, luminance};
use crate::error::{Error, Result};
use crate::gather::Backs;
use crate::light::{Direct, Lit};
use crate::patch::NONE;
use crate::progress::Progress;
use crate::store::Hasher;
use crate::work::Work;
use glam::Vec3;
use rayon::prelude::*;

/// Samples in each half of a back that is seen from a front or shines, and of one that is seen from other backs alone.
const BACK_SAMPLES: u32 = 32;
const DEEP_SAMPLES: u32 = 8;

/// How often backs that are seen from backs are followed.
const BACK_ROUNDS: usize = 8;

/// Of the samples of a block that sees something bright, this share goes there: a quarter where that is at least [`DIM`] of its
/// light, half where it is [`BRIGHT`].
const DIM: f32 = 0.02;
const BRIGHT: f32 = 0.1;

/// Blocks, what was found about them, and their light.
pub struct Field<'a> {
    pub lit: &'a Lit<'a>,
    pub params: &'a BlockParams,
    pub blocks: Blocks,
    /// Each front with its neighbours.
    pub around: Vec<Vec<u32>>,
    pub sampled: Vec<Sampled>,
    /// Irradiance from all but direct light [lx].
    pub irradiance: Vec<Rgb>,
    /// What patches send of their direct light [lm/m^2].
    sent: Vec<Rgb>,
    /// Direct light on backs, and the lamps that it comes from.
    on_backs: BackLight,
    lamps: BackLamps,
    /// Irradiance from the sky [lx].
    base: Vec<Rgb>,
    bright: Option<(Guide, Reach)>,
    pub swept: Swept,
    pub rays: u64,
    work: &'a Work<'a>,
    /// How often blocks were sampled.
    step: u64,
}

impl<'a> Field<'a> {
    /// The coarsest blocks, in the dark.
    pub fn new(
        lit: &'a Lit<'a>,
        direct: &Direct,
        params: &'a BlockParams,
        lamps: BackLamps,
        work: &'a Work<'a>,
    ) -> Self {
        let blocks = Blocks::new(lit);
        let n = blocks.list.len();
        let (sampled, irradiance) = (vec![Sampled::default(); n], vec![Rgb::ZERO; n]);
        let mut field = Self::with(lit, direct, params, blocks, (sampled, irradiance), lamps, work);
        field.meet();
        field
    }

    /// The blocks and links that were kept, in other light, which goes on from where it was then; `lamps` light backs.
    ///
    /// # Errors
    /// `Cancelled`; `Io`; `Invalid` where what was kept is of other patches.
    pub fn kept(
        lit: &'a Lit<'a>,
        direct: &Direct,
        params: &'a BlockParams,
        kept: &Kept,
        lamps: BackLamps,
        work: &'a Work<'a>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let unlike = || Error::invalid("kept links", "they are of other texels; bake without the cache");
        let blocks = kept.blocks(lit).ok_or_else(unlike)?;
        let sampled = kept.sampled(lit, &blocks).ok_or_else(unlike)?;
        let n = blocks.list.len();
        let (fronts, patches) = (blocks.fronts(), lit.ground.patches.len());
        let back_blocks: Vec<usize> = kept.back_blocks.iter().map(|&b| b as usize).collect();
        let is_there = kept.irradiance.len() == n
            && back_blocks.iter().all(|b| (fronts..n).contains(b))
            && kept.back_patches.iter().all(|&i| (i as usize) < patches && blocks.back_of[i as usize] != NONE);
        if !is_there {
            return Err(unlike());
        }
        let irradiance = kept.irradiance.clone();
        let light = (sampled, irradiance);
        let mut field = Self { rays: kept.rays, ..Self::with(lit, direct, params, blocks, light, lamps, work) };
        field.light_backs(&kept.back_patches, progress)?;
        field.light_back_blocks(&back_blocks, progress)?;
        field.lamps.keep(work)?;
        field.find_base();
        let flux = field.flux();
        let ratio = |k: usize| if kept.flux[k] > 0.0 { (flux[k] / kept.flux[k]) as f32 } else { 1.0 };
        let ratio = Rgb::from_array(std::array::from_fn(ratio));
        field.irradiance.iter_mut().for_each(|e| *e *= ratio);
        field.meet();
        Ok(field)
    }

    /// What patches send of their direct light and blocks get of the sky, by channel [lm].
    pub fn flux(&self) -> [f64; 3] {
        let area = &self.lit.exposure.area;
        let sent = self.sent.iter().zip(area).map(|(sent, area)| sent.as_dvec3() * f64::from(*area));
        let sky = self.base.iter().zip(&self.blocks.list).map(|(e, block)| e.as_dvec3() * f64::from(block.area));
        sent.chain(sky).sum::<glam::DVec3>().to_array()
    }

    /// Patches and blocks of whose backs the direct light is known, ascending.
    pub fn lit_backs(&self) -> (Vec<u32>, Vec<u32>) {
        let patches = self.on_backs.of_patch.keys().to_vec();
        let fronts = self.blocks.fronts() as u32;
        let blocks = (fronts..).zip(&self.on_backs.of_block).filter(|(_, known)| known.is_some());
        (patches, blocks.map(|(b, _)| b).collect())
    }

    /// The lamps that light backs, which is all that is left of the field.
    pub fn into_lamps(self) -> BackLamps {
        self.lamps
    }

    /// The equations of the light.
    pub fn system(&self) -> System<'_> {
        let sends = self.params.max_bounces != Some(0);
        System {
            lit: self.lit,
            blocks: &self.blocks,
            sampled: &self.sampled,
            sent: &self.sent,
            on_backs: sends.then_some(&self.on_backs),
            base: &self.base,
        }
    }

    /// Blocks that have `sampled` what they see, and have about the light `irradiance` [lx]; backs are dark, and what shines is not known
    /// yet.
    pub fn with(
        lit: &'a Lit<'a>,
        direct: &Direct,
        params: &'a BlockParams,
        blocks: Blocks,
        (sampled, irradiance): (Vec<Sampled>, Vec<Rgb>),
        lamps: BackLamps,
        work: &'a Work<'a>,
    ) -> Self {
        let n = blocks.list.len();
        Self {
            lit,
            params,
            around: Vec::new(),
            sampled,
            irradiance,
            sent: sent(lit, direct, params),
            on_backs: BackLight { of_block: vec![None; n - blocks.fronts()], ..BackLight::default() },
            lamps,
            base: vec![Rgb::ZERO; n],
            bright: None,
            swept: Swept::default(),
            rays: 0,
            work,
            step: 0,
            blocks,
        }
    }

    /// True where patch `i` has a back.
    pub fn has_back(&self, i: u32) -> bool {
        self.blocks.back_of.get(i as usize).is_some_and(|b| *b != NONE)
    }

    /// Finds what the sky sends along the links that there are.
    pub fn find_base(&mut self) {
        self.base = (0..self.blocks.list.len()).into_par_iter().with_max_len(SHARE).map(|b| self.base_of(b)).collect();
    }

    /// Adds `plan` samples to each half of the fronts, by block, and follows what they see of backs.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn look(&mut self, plan: &[u32], progress: &dyn Progress) -> Result<()> {
        let seen = self.glance(plan, progress)?;
        self.follow_backs(seen, progress)
    }

    /// Lights the backs of the patches `seen`, and samples what they see in turn.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn follow_backs(&mut self, mut seen: Vec<u32>, progress: &dyn Progress) -> Result<()> {
        self.light_backs(&seen, progress)?;
        let fronts = self.blocks.fronts();
        let mut plan = vec![0; self.blocks.list.len()];
        for round in 0..BACK_ROUNDS {
            let samples = if round == 0 { BACK_SAMPLES } else { DEEP_SAMPLES };
            plan.fill(0);
            for b in seen.into_iter().map(|i| self.blocks.back_of[i as usize] as usize) {
                plan[b] = samples.saturating_sub(self.sampled[b].drawn.samples());
            }
            if plan.iter().all(|&samples| samples == 0) {
                break;
            }
            seen = self.sample(&plan, progress)?;
        }
        let dark = |&b: &usize| !self.sampled[b].is_empty() && self.on_backs.of_block[b - fronts].is_none();
        let dark: Vec<usize> = (fronts..self.blocks.list.len()).filter(dark).collect();
        self.light_back_blocks(&dark, progress)
    }

    /// Adds `plan` samples to each half of the fronts, and returns the patches whose backs were seen. They stay dark.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn glance(&mut self, plan: &[u32], progress: &dyn Progress) -> Result<Vec<u32>> {
        let mut plan = plan.to_vec();
        plan.resize(self.blocks.list.len(), 0);
        // What a back emits lands somewhere, whether another surface sees the back or not.
        let shines = |&i: &u32| self.lit.emission.0[i as usize] != Rgb::ZERO;
        for (b, samples) in plan.iter_mut().enumerate().skip(self.blocks.fronts()) {
            if self.sampled[b].is_empty() && self.blocks.members(b).iter().any(shines) {
                *samples = BACK_SAMPLES;
            }
        }
        self.sample(&plan, progress)
    }

    /// Samples, and returns the patches whose backs were seen.
    fn sample(&mut self, plan: &[u32], progress: &dyn Progress) -> Result<Vec<u32>> {
        let sampled = std::mem::take(&mut self.sampled);
        let source = Source {
            lit: self.lit,
            params: self.params,
            blocks: &self.blocks,
            irradiance: &self.irradiance,
            bright: self.bright.as_ref(),
            progress,
        };
        let mut sampling = Sampling::new(source, sampled, plan);
        let (parts, step) = (sampling.parts(), self.step);
        // All that samples depend on beside the ground: the light so far decides where they go.
        let add = |hasher: &mut Hasher| {
            hasher.add_u64(step);
            hasher.add_debug(self.params);
            hasher.add_slice(plan);
            hasher.add_slice(&self.irradiance);
            hasher.add_slice(&self.base);
            hasher.add_slice(&self.sent);
        };
        self.work.share(PARTS, add, parts, &mut sampling, progress)?;
        let Sampling { sampled, backs: mut seen, rays, .. } = sampling;
        self.sampled = sampled;
        self.step += 1;
        self.rays += rays;
        let wanted: Vec<usize> = (0..plan.len()).filter(|&b| plan[b] > 0).collect();
        let base: Vec<Rgb> = wanted.par_iter().map(|&b| self.base_of(b)).collect();
        for (b, base) in wanted.into_iter().zip(base) {
            self.base[b] = base;
        }
        seen.sort_unstable();
        seen.dedup();
        Ok(seen)
    }

    fn base_of(&self, b: usize) -> Rgb {
        let system = self.system();
        0.5 * (system.sky(b, 0, None) + system.sky(b, 1, None))
    }

    /// Irradiance of blocks from the sky [lx].
    pub fn sky_irradiance(&self) -> &[Rgb] {
        &self.base
    }

    /// Finds the direct light on those backs of `patches`, ascending, where it isn't known yet.
    pub fn light_backs(&mut self, patches: &[u32], progress: &dyn Progress) -> Result<()> {
        let known = self.on_backs.of_patch.get(patches);
        let fresh: Vec<u32> = patches.iter().zip(known).filter(|(_, known)| known.is_none()).map(|(i, _)| *i).collect();
        let draw = Draw { lit: self.lit, blocks: &self.blocks, seed: self.params.seed };
        let (light, rays) = self.lamps.light(&draw, &fresh, progress)?;
        self.rays += rays;
        self.on_backs.of_patch.add(fresh.into_iter().zip(light));
        Ok(())
    }

    /// Finds the mean direct light on the backs `list`.
    pub fn light_back_blocks(&mut self, list: &[usize], progress: &dyn Progress) -> Result<()> {
        let draw = Draw { lit: self.lit, blocks: &self.blocks, seed: self.params.seed };
        let (means, rays) = self.lamps.light_blocks(&draw, list, progress)?;
        self.rays += rays;
        let fronts = self.blocks.fronts();
        for (&b, mean) in list.iter().zip(means) {
            self.on_backs.of_block[b - fronts] = Some(mean);
        }
        Ok(())
    }

    /// Sweeps until the light is at rest.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn solve(&mut self, residual: f64, progress: &dyn Progress) -> Result<()> {
        let mut irradiance = std::mem::take(&mut self.irradiance);
        // A texel adds the last bounce itself.
        let most = self.params.max_bounces.map(|n| n.saturating_sub(1));
        match self.params.max_bounces {
            None => {}
            Some(0) => irradiance.fill(Rgb::ZERO),
            Some(_) => irradiance.clone_from(&self.base),
        }
        let swept = self.system().solve(&mut irradiance, residual, most, progress);
        self.irradiance = irradiance;
        self.swept = swept?;
        Ok(())
    }

    /// Finds what shines, and how far it reaches. Links that there are don't know how likely they would have been found by that, and are
    /// let go.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn find_bright(&mut self, progress: &dyn Progress) -> Result<()> {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &position in &self.lit.ground.patches.position {
            low = low.min(position);
            high = high.max(position);
        }
        let escaped = self.escaped();
        let sky = if escaped.is_empty() { SkyCells::none() } else { SkyCells::new(low, high, &escaped) };
        let mut region = vec![NONE; self.lit.ground.patches.len()];
        for b in 0..self.blocks.fronts() {
            let number = self.blocks.list[b].region;
            self.blocks.members(b).iter().for_each(|&i| region[i as usize] = number);
        }
        let guide = Guide::new(self.lit, &region, &self.sent, sky, self.params.seed);
        if guide.is_empty() {
            return Ok(());
        }
        let reach = Reach::new(self.lit, &self.blocks, &guide, self.params.seed, progress)?;
        self.rays += reach.rays;
        self.bright = Some((guide, reach));
        self.sampled.iter_mut().for_each(|found| *found = Sampled::default());
        Ok(())
    }

    /// The rays of fronts that met nothing.
    fn escaped(&self) -> Vec<Escaped> {
        let Some(sky) = &self.lit.lights.sky else { return Vec::new() };
        let mut all = Vec::new();
        for (block, found) in self.blocks.list[..self.blocks.fronts()].iter().zip(&self.sampled) {
            for half in &found.halves {
                for direction in half.sky.iter().map(SkyLink::direction) {
                    let radiance = luminance(sky.smooth(self.lit.ground.scene, direction));
                    all.push(Escaped { origin: block.centre, direction, radiance });
                }
            }
        }
        all
    }

    /// Splits the blocks that are `wanted`; their parts start anew, with the light of the whole, and have yet to [meet](Self::meet).
    /// Returns what each block is part of.
    pub fn split(&mut self, wanted: &[bool]) -> Vec<u32> {
        let parts = self.blocks.split(self.lit, wanted);
        let origin: Vec<u32> = parts.iter().map(|p| p.0).collect();
        let sampled = &mut self.sampled;
        let keep = |&(o, is_whole): &(u32, bool)| {
            if is_whole { std::mem::take(&mut sampled[o as usize]) } else { Sampled::default() }
        };
        self.sampled = parts.iter().map(keep).collect();
        self.irradiance = origin.iter().map(|&o| self.irradiance[o as usize]).collect();
        self.base = origin.iter().map(|&o| self.base[o as usize]).collect();
        if let Some((_, reach)) = &mut self.bright {
            reach.follow(&origin);
        }
        self.around.clear();
        origin
    }

    /// Finds the neighbours of each front.
    pub fn meet(&mut self) {
        let fronts = self.blocks.fronts();
        self.around = (0..fronts).into_par_iter().map(|b| neighbours(self.lit, &self.blocks, b)).collect();
    }

    /// How fronts answer to normals, and the variance of one sample of each [lx^2]; `normal` is the one that a patch shows.
    pub fn responses(
        &self,
        radiosity: &Radiosity,
        normal: &(dyn Fn(usize) -> Vec3 + Sync),
    ) -> (Vec<Response>, Vec<f32>) {
        let system = self.system();
        let respond = |b: usize| Response::new(&system, radiosity, &normal, b);
        (0..self.blocks.fronts()).into_par_iter().with_max_len(SHARE).map(respond).unzip()
    }

    /// Number of links to patches.
    pub fn links(&self) -> u64 {
        self.sampled.iter().flat_map(|found| &found.halves).map(|half| half.links.len() as u64).sum()
    }

    /// Forgets what was seen, and what patches send.
    pub fn forget_links(&mut self) {
        (self.sampled, self.sent, self.bright) = (Vec::new(), Vec::new(), None);
    }

    /// The light on backs that something sees, while patches send `radiosity`.
    pub fn backs(&self, radiosity: &Radiosity) -> Backs {
        let fronts = self.blocks.fronts();
        let mut backs = Backs { of_patch: vec![NONE; self.blocks.back_of.len()], ..Backs::default() };
        for b in (fronts..self.blocks.list.len()).filter(|&b| !self.sampled[b].is_empty()) {
            let (block, found) = (&self.blocks.list[b], &self.sampled[b]);
            let number = backs.area.len() as u32;
            let (mut albedo, mut taking) = (Rgb::ZERO, Rgb::ZERO);
            for (k, &i) in (block.first as usize..).zip(self.blocks.members(b)) {
                backs.of_patch[i as usize] = number;
                albedo += self.lit.reflectance.0[i as usize] * self.blocks.area(k);
                taking += self.lit.exposure.taking(i as usize) * self.blocks.area(k);
            }
            backs.area.push(block.area);
            backs.albedo.push(albedo / block.area.max(f32::MIN_POSITIVE));
            let taking = match self.lit.exposure.stops {
                Some(_) => taking / block.area.max(f32::MIN_POSITIVE),
                None => Rgb::ONE,
            };
            backs.taking.push(taking);
            let [direct, other] = self.on_backs.of_block[b - fronts].unwrap_or_default();
            let reflected = found.halves.iter().map(|half| System::collect(half, radiosity)).sum::<Rgb>();
            backs.irradiance.push(self.base[b] + 0.5 * reflected + direct);
            backs.landed_share.push(0.5 * found.halves.iter().flat_map(|h| &h.weights).sum::<f32>());
            backs.inflow += ((other + self.base[b]) * taking).as_dvec3() * f64::from(block.area);
        }
        backs
    }
}

/// What a block that receives `all` [lx] (luminance), and `arriving` from each cluster, sees shine, and how many of `count` samples go
/// there; `None` where none do.
pub fn draw_view(guide: &Guide, all: f32, arriving: &[f32], count: u32) -> Option<(View, u32)> {
    let view = guide.view(all, arriving)?;
    let share = view.recipe.arriving / all.max(f32::MIN_POSITIVE);
    let areas = if share > BRIGHT {
        count / 2
    } else if share > DIM {
        count / 4
    } else {
        0
    };
    (areas > 0).then_some((view, areas))
}

/// What patches send of their direct light [lm/m^2]: nothing where no reflection counts.
fn sent(lit: &Lit, direct: &Direct, params: &BlockParams) -> Vec<Rgb> {
    let sends = params.max_bounces != Some(0);
    let send = |(rho, e): (&Rgb, &Rgb)| if sends { *rho * *e } else { Rgb::ZERO };
    lit.reflectance.0.iter().zip(direct.transport.iter()).map(send).collect()
}

/// The light of some lights alone, over the links of a field.
pub struct Alone {
    sent: Vec<Rgb>,
    on_backs: BackLight,
    base: Vec<Rgb>,
}

impl Alone {
    /// That of the lights of `lit`, from which `direct` comes straight.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn new(field: &Field, lit: &Lit, direct: &Direct, progress: &dyn Progress) -> Result<Self> {
        let mut alone = Self { sent: sent(lit, direct, field.params), ..Self::dark(field) };
        let params = params_of_backs(lit.params);
        let lamps = [(lit.lights, &params)];
        let draw = Draw { lit, blocks: &field.blocks, seed: field.params.seed };
        let patches = field.on_backs.of_patch.keys().to_vec();
        let on_patch = |&i: &u32| -> Result<Rgb> {
            progress.check()?;
            Ok(draw.direct_on_back(i as usize, &lamps).iter().map(|arriving| arriving.transport).sum())
        };
        let light: Vec<Rgb> = patches.par_iter().with_max_len(SHARE).map(on_patch).collect::<Result<_>>()?;
        alone.on_backs.of_patch.add(patches.into_iter().zip(light));
        let (fronts, known) = (field.blocks.fronts(), &field.on_backs.of_block);
        let list: Vec<usize> = (0..known.len()).filter(|&k| known[k].is_some()).map(|k| fronts + k).collect();
        let on_block = |&b: &usize| -> Result<Vec<([Rgb; 2], u64)>> {
            progress.check()?;
            Ok(mean_on_back(&draw, b, &lamps))
        };
        let means: Vec<_> = list.par_iter().with_max_len(SHARE).map(on_block).collect::<Result<_>>()?;
        for (b, mean) in list.into_iter().zip(means.concat()) {
            alone.on_backs.of_block[b - fronts] = Some(mean.0);
        }
        let base: Vec<Rgb> = {
            let system = alone.system(field, lit);
            let of_block = |b: usize| 0.5 * (system.sky(b, 0, None) + system.sky(b, 1, None));
            (0..field.blocks.list.len()).into_par_iter().with_max_len(SHARE).map(of_block).collect()
        };
        Ok(Self { base, ..alone })
    }

    /// No light at all.
    pub fn dark(field: &Field) -> Self {
        let of_block = vec![None; field.blocks.list.len() - field.blocks.fronts()];
        Self {
            sent: vec![Rgb::ZERO; field.sent.len()],
            on_backs: BackLight { of_block, ..BackLight::default() },
            base: vec![Rgb::ZERO; field.base.len()],
        }
    }

    /// Its equations; `lit` has its lights.
    pub fn system<'a>(&'a self, field: &'a Field, lit: &'a Lit<'a>) -> System<'a> {
        let sends = field.params.max_bounces != Some(0);
        System {
            lit,
            blocks: &field.blocks,
            sampled: &field.sampled,
            sent: &self.sent,
            on_backs: sends.then_some(&self.on_backs),
            base: &self.base,
        }
    }

    /// The irradiance of blocks [lx], swept until it is at rest.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn solve(&self, field: &Field, system: &System, progress: &dyn Progress) -> Result<Vec<Rgb>> {
        let most = field.params.max_bounces.map(|n| n.saturating_sub(1));
        let mut irradiance = match field.params.max_bounces {
            Some(0) => vec![Rgb::ZERO; self.base.len()],
            _ => self.base.clone(),
        };
        system.solve(&mut irradiance, field.params.residual, most, progress)?;
        Ok(irradiance)
    }
}
