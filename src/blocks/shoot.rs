//! Samples of blocks: rays over the hemispheres of their texels, and ways to what shines, as links.

use super::block::Blocks;
use super::guide::{Aim, Found, Guide, View};
use super::link::{Drawn, Half, Link, Sight, SkyLink};
use crate::color::Rgb;
use crate::light::direct::{Arriving, DirectParams, Receiver, glimpse};
use crate::light::{Lights, Lit};
use crate::patch::{Cutter, Footprint, Ground, NONE, SurfacePoint};
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Hit, Ray, Segment};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Normals that stand for those of a curved block.
const MOST_NORMALS: usize = 16;

/// What has been found about a block.
#[derive(Clone, Debug, Default)]
pub struct Sampled {
    pub halves: [Half; 2],
    /// What each of them drew.
    pub drawn: Drawn,
    /// Sum of the inverse distances [1/m] to what rays of the hemisphere met.
    pub inverse_distance: f32,
}

impl Sampled {
    /// Weighs all links by the numbers of samples as they are now. Their form factors have yet to be [closed](Self::close).
    pub fn weigh(&mut self, sight: &Sight) {
        let drawn = &self.drawn;
        for half in &mut self.halves {
            half.weights.clear();
            half.weights.reserve_exact(half.links.len());
            half.weights.extend(half.links.iter().map(|link| drawn.weigh(sight, &link)));
            half.sky_weights.clear();
            half.sky_weights.reserve_exact(half.sky.len());
            half.sky_weights.extend(half.sky.iter().map(|link| drawn.weigh_sky(sight, link)));
        }
    }

    /// Scales the form factors so that they add up to 1 with what is lost.
    pub fn close(&mut self) {
        self.halves.iter_mut().for_each(|half| half.close(&self.drawn));
    }

    /// True before the first sample.
    pub fn is_empty(&self) -> bool {
        self.drawn.samples() == 0
    }
}

/// How many samples each half of a block gets: over the hemisphere, and towards what shines.
#[derive(Clone, Copy)]
pub struct Samples<'a> {
    pub hemisphere: u32,
    pub areas: u32,
    /// What shines, once it is known; `view` where some of it is bright to the block.
    pub guide: Option<&'a Guide>,
    pub view: Option<&'a View>,
}

/// A sample in a given direction, from somewhere on the block.
#[derive(Clone, Copy)]
pub struct Aimed {
    pub half: usize,
    /// Where on the block.
    pub place: [f32; 2],
    /// Unit.
    pub direction: Vec3,
    /// Density with which all samples together are drawn that way [1/sr].
    pub expected: f32,
}

/// Who draws: every half of every block has its own sequences.
#[derive(Clone, Copy)]
pub struct Draw<'a> {
    pub lit: &'a Lit<'a>,
    pub blocks: &'a Blocks,
    pub seed: u32,
}

/// One sample: its half, its number in the sequence of its strategy, where it is taken, and the random numbers: two for the place,
/// two for what is done there.
#[derive(Clone, Copy)]
struct Start {
    half: usize,
    index: u32,
    point: SurfacePoint,
    u: [f32; 4],
}

/// What is at the end of a ray.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Seen {
    /// A patch that sends light, and whether its back is seen.
    Patch(usize, bool),
    Sky,
    /// Nothing that sends light.
    Nothing,
}

/// Memory that the samples of one block after the other are drawn in.
pub struct Scratch<'a> {
    cutter: Cutter<'a>,
    footprint: Footprint,
    starts: Vec<Start>,
    /// The member of the block that each sample falls on; the samples by member; and the ends of each member's run of them.
    members: Vec<u32>,
    order: Vec<u32>,
    ends: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    segments: Vec<Segment>,
    links: Vec<(usize, Link)>,
    halves: Vec<usize>,
    blocked: Vec<bool>,
    tints: Vec<Rgb>,
    weights: Vec<f32>,
    /// What arrives from each cluster [lx].
    pub arriving: Vec<f32>,
}

impl<'a> Scratch<'a> {
    /// For blocks of `ground`.
    pub fn new(ground: &'a Ground<'a>) -> Self {
        Self {
            cutter: Cutter::new(ground),
            footprint: Footprint::default(),
            starts: Vec::new(),
            members: Vec::new(),
            order: Vec::new(),
            ends: Vec::new(),
            rays: Vec::new(),
            hits: Vec::new(),
            segments: Vec::new(),
            links: Vec::new(),
            halves: Vec::new(),
            blocked: Vec::new(),
            tints: Vec::new(),
            weights: Vec::new(),
            arriving: Vec::new(),
        }
    }
}

impl Draw<'_> {
    /// Adds `samples` to both halves of block `b`.
    pub fn sample(&self, b: usize, samples: Samples, found: &mut Sampled, scratch: &mut Scratch) {
        let Samples { hemisphere, areas, guide, view } = samples;
        let mut starts = std::mem::take(&mut scratch.starts);
        starts.clear();
        for (stage, count) in [(Stage::Block, hemisphere), (Stage::BlockArea, areas)] {
            let first = if stage == Stage::Block { found.drawn.hemisphere } else { found.drawn.areas };
            for half in 0..2 {
                let sequence = self.sequence(stage, b, half);
                let start = |index| Start { half, index, point: SurfacePoint::NOWHERE, u: sequence.point(index, 0) };
                starts.extend((first..first + count).map(start));
            }
        }
        self.place(b, &mut starts, scratch);
        // Exactly as much as may come: vectors that grow by themselves are copied time and again.
        found.halves.iter_mut().for_each(|half| half.links.reserve_exact((hemisphere + areas) as usize));
        let (over_hemisphere, to_areas) = starts.split_at(2 * hemisphere as usize);
        if found.drawn.normals.0.is_empty() {
            let block = &self.blocks.list[b];
            found.drawn.normals.0 = if block.is_flat() {
                vec![block.normal]
            } else {
                over_hemisphere.iter().take(MOST_NORMALS).map(|s| s.point.normal).collect()
            };
        }
        self.hemisphere(over_hemisphere, guide, found, scratch);
        found.drawn.hemisphere += hemisphere;
        if let (Some(guide), Some(view)) = (guide, view) {
            self.areas(b, to_areas, guide, view, found, scratch);
            found.drawn.expect(view, areas);
        }
        scratch.starts = starts;
    }

    /// Finds the points of `starts` on block `b`; on backs their normals point away from the back.
    fn place(&self, b: usize, starts: &mut [Start], scratch: &mut Scratch) {
        let Lit { ground, exposure, .. } = *self.lit;
        let block = &self.blocks.list[b];
        let Scratch { cutter, footprint, members, order, ends, .. } = scratch;
        members.clear();
        ends.clear();
        ends.resize(block.texels(), 0);
        for start in starts.iter_mut() {
            let (k, rest) = self.blocks.pick(b, start.u[0]);
            start.u[0] = rest;
            members.push(k as u32 - block.first);
            ends[k - block.first as usize] += 1;
        }
        // Those of one texel in a row, so that its footprint is cut once: counted, then laid out from the last to the first.
        let mut sum = 0;
        for end in ends.iter_mut() {
            sum += *end;
            *end = sum;
        }
        order.clear();
        order.resize(starts.len(), 0);
        for (at, &member) in members.iter().enumerate().rev() {
            let end = &mut ends[member as usize];
            *end -= 1;
            order[*end as usize] = at as u32;
        }
        let surface = ground.patches.surface(self.blocks.order[block.first as usize] as usize);
        let middle = SurfacePoint::on(surface, block.centre, block.normal);
        let side = if block.back { -1.0 } else { 1.0 };
        let mut last = None;
        for &at in order.iter() {
            let member = members[at as usize];
            if last != Some(member) {
                let patch = self.blocks.order[(block.first + member) as usize] as usize;
                cutter.cut(patch, footprint);
                if !block.back {
                    footprint.restrict(exposure.cells[patch]);
                }
                last = Some(member);
            }
            let start = &mut starts[at as usize];
            start.point = middle;
            if !footprint.is_empty() {
                let point = footprint.sample([start.u[0], start.u[1]]);
                start.point = SurfacePoint { normal: point.normal * side, ..point };
            }
        }
    }

    /// Adds what `aimed` samples of block `b` find, with their form factors. They count as none of those that were drawn.
    pub fn along(&self, b: usize, aimed: &[Aimed], found: &mut Sampled, scratch: &mut Scratch) {
        let tracer = self.lit.ground.tracer;
        let mut starts = std::mem::take(&mut scratch.starts);
        starts.clear();
        let start = |a: &Aimed| Start {
            half: a.half,
            index: 0,
            point: SurfacePoint::NOWHERE,
            u: [a.place[0], a.place[1], 0.0, 0.0],
        };
        starts.extend(aimed.iter().map(start));
        self.place(b, &mut starts, scratch);
        let Scratch { rays, halves, hits, tints, weights, .. } = scratch;
        rays.clear();
        halves.clear();
        weights.clear();
        for (start, aimed) in starts.iter().zip(aimed) {
            let cos = aimed.direction.dot(start.point.normal);
            if cos > 0.0 {
                let origin = tracer.off_surface(start.point.position, start.point.normal);
                rays.push(Ray { origin, direction: aimed.direction });
                halves.push(aimed.half);
                weights.push(FRAC_1_PI * cos / aimed.expected);
            }
        }
        hits.clear();
        hits.resize(rays.len(), None);
        tracer.closest_tinted(rays, hits, tints);
        for (k, ((half, ray), hit)) in halves.iter().zip(&*rays).zip(&*hits).enumerate() {
            let half = &mut found.halves[*half];
            match self.seen(hit.as_ref()) {
                Seen::Patch(patch, back) => {
                    half.push(Link::new(patch, back, ray.direction, 0.0), tint(tints, k));
                    half.weights.push(weights[k]);
                }
                Seen::Sky => {
                    half.push_sky(SkyLink::new(ray.direction, Found::NOTHING), tint(tints, k));
                    half.sky_weights.push(weights[k]);
                }
                Seen::Nothing => half.lost += 1,
            }
        }
        scratch.starts = starts;
    }

    /// What a ray meets.
    fn seen(&self, hit: Option<&Hit>) -> Seen {
        let Some(hit) = hit else {
            return if self.lit.lights.sky.is_some() { Seen::Sky } else { Seen::Nothing };
        };
        // A front whose light is known has no block.
        let sends = |patch: &usize| match hit.back {
            true => self.blocks.back_of[*patch] != NONE,
            false => !self.lit.exposure.is_buried(*patch),
        };
        match self.lit.ground.patch_under(hit).filter(sends) {
            Some(patch) => Seen::Patch(patch, hit.back),
            None => Seen::Nothing,
        }
    }

    fn hemisphere(&self, starts: &[Start], guide: Option<&Guide>, found: &mut Sampled, scratch: &mut Scratch) {
        let Lit { ground, .. } = *self.lit;
        let Scratch { rays, hits, tints, .. } = scratch;
        let ray = |s: &Start| Ray {
            origin: ground.tracer.off_surface(s.point.position, s.point.normal),
            direction: frame(s.point.normal) * cosine_hemisphere([s.u[2], s.u[3]]),
        };
        rays.clear();
        rays.extend(starts.iter().map(ray));
        hits.clear();
        hits.resize(rays.len(), None);
        ground.tracer.closest_tinted(rays, hits, tints);
        for (k, ((start, ray), hit)) in starts.iter().zip(&*rays).zip(&*hits).enumerate() {
            let tint = tint(tints, k);
            let half = &mut found.halves[start.half];
            let seen = self.seen(hit.as_ref());
            if seen == Seen::Sky {
                let known = guide.map_or(Found::NOTHING, |g| g.find_sky(ray.origin, ray.direction));
                half.push_sky(SkyLink::new(ray.direction, known), tint);
            }
            let Some(hit) = hit else {
                half.lost += u32::from(seen == Seen::Nothing);
                continue;
            };
            found.inverse_distance += 1.0 / hit.t;
            let Seen::Patch(patch, _) = seen else {
                half.lost += 1;
                continue;
            };
            let known = guide.filter(|g| !hit.back && g.holds(patch)).map_or(0.0, |guide| {
                let (surface, triangle) = ground.tracer.place(hit.triangle);
                let [a, b, c] = ground.scene.world_triangle(surface, triangle);
                let cos = -ray.direction.dot((b - a).cross(c - a).normalize_or_zero());
                guide.pdf(patch, hit.t * hit.t, cos)
            });
            half.push(Link::new(patch, hit.back, ray.direction, known), tint);
        }
    }

    fn areas(
        &self,
        b: usize,
        starts: &[Start],
        guide: &Guide,
        view: &View,
        found: &mut Sampled,
        scratch: &mut Scratch,
    ) {
        let tracer = self.lit.ground.tracer;
        let sequences = [0, 1].map(|k| self.sequence(Stage::BlockArea, b, k));
        let Scratch { rays, segments, links, halves, blocked, tints, .. } = scratch;
        segments.clear();
        links.clear();
        rays.clear();
        halves.clear();
        for start in starts {
            let origin = tracer.off_surface(start.point.position, start.point.normal);
            let (cluster, rest) = view.pick(start.u[2]);
            // A place takes two numbers: one is what is left of the choice of the cluster, shifted by a number of its own.
            let shift = sequences[start.half].point(start.index, 1)[0];
            match guide.aim(cluster, origin, [(rest + shift).fract(), start.u[3]]) {
                Some(Aim::Patch { patch, position, normal }) => {
                    let way = position - origin;
                    let square = way.length_squared();
                    let direction = way / square.sqrt();
                    let cos = -direction.dot(normal);
                    if square > 0.0 && direction.dot(start.point.normal) > 0.0 && cos > 0.0 {
                        segments.push(Segment { from: origin, to: position });
                        links.push((start.half, Link::new(patch, false, direction, guide.pdf(patch, square, cos))));
                    }
                }
                Some(Aim::Sky { direction }) if direction.dot(start.point.normal) > 0.0 => {
                    rays.push(Ray { origin, direction });
                    halves.push(start.half);
                }
                _ => {}
            }
        }
        blocked.clear();
        blocked.resize(segments.len().max(rays.len()), false);
        tracer.occluded_tinted(segments, &mut blocked[..segments.len()], tints);
        for (k, ((half, link), _)) in links.iter().zip(&*blocked).enumerate().filter(|(_, (_, blocked))| !**blocked) {
            found.halves[*half].push(*link, tint(tints, k));
        }
        tracer.occluded_rays_tinted(rays, &mut blocked[..rays.len()], tints);
        for (k, ((ray, half), _)) in rays.iter().zip(&*halves).zip(&*blocked).enumerate().filter(|(_, x)| !x.1) {
            let link = SkyLink::new(ray.direction, guide.find_sky(ray.origin, ray.direction));
            found.halves[*half].push_sky(link, tint(tints, k));
        }
    }

    /// Direct light on the back of patch `i` from each of several lots of lamps.
    pub fn direct_on_back(&self, i: usize, lamps: &[(&Lights, &DirectParams)]) -> Vec<Arriving> {
        let ground = self.lit.ground;
        let mut footprint = ground.footprint(i);
        if footprint.is_empty() {
            return vec![Arriving::default(); lamps.len()];
        }
        footprint.turn();
        let position = ground.patches.position[i];
        let receiver = Receiver {
            sample: &|u| footprint.sample(u),
            position,
            normal: -ground.patches.normal[i],
            radius: footprint.radius(position),
            sequence: Sequence::new(self.seed, Stage::Back, i as u64),
        };
        glimpse(ground.scene, ground.tracer, lamps, &receiver, &footprint)
    }

    pub fn sequence(&self, stage: Stage, b: usize, k: usize) -> Sequence {
        let block = &self.blocks.list[b];
        Sequence::new(self.seed, stage, u64::from(block.first) << 8 | u64::from(block.level) << 4 | k as u64)
    }
}

/// The tint of sample `k`: white where there are none.
fn tint(tints: &[Rgb], k: usize) -> Rgb {
    tints.get(k).copied().unwrap_or(Rgb::ONE)
}
