//! Samples of blocks: rays over the hemispheres of their texels, and ways to what shines, as links.

use super::block::Blocks;
use super::guide::{Aim, Found, Guide, View};
use super::link::{Drawn, Half, Link, Sight, SkyLink};
use crate::light::Lit;
use crate::light::direct::{Arriving, DirectParams, Receiver, glimpse};
use crate::patch::{Cutter, NONE, SurfacePoint};
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
    /// Weighs all links by the numbers of samples as they are now.
    pub fn weigh(&mut self, sight: &Sight) {
        let drawn = &self.drawn;
        for half in &mut self.halves {
            let form_factor = |(_, cos, w): (Vec3, f32, f32)| cos * w * FRAC_1_PI;
            half.weights.clear();
            half.weights.extend(half.links.iter().map(|link| form_factor(drawn.solid_angle(sight, link))));
            let sky: f32 = half.sky.iter().map(|link| form_factor(drawn.sky_solid_angle(sight, link))).sum();
            half.close(half.weights.iter().sum::<f32>() + sky, drawn);
            let scale = half.scale;
            half.weights.iter_mut().for_each(|weight| *weight *= scale);
        }
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

/// Who draws: every half of every block has its own sequences.
#[derive(Clone, Copy)]
pub struct Draw<'a> {
    pub lit: &'a Lit<'a>,
    pub blocks: &'a Blocks,
    pub seed: u32,
}

/// One sample: its half, the numbers that are left once its place is chosen, and that place.
struct Start {
    half: usize,
    u: [f32; 2],
    index: u32,
    point: SurfacePoint,
}

impl Draw<'_> {
    /// Adds `samples` to both halves of block `b`.
    pub fn sample(&self, b: usize, samples: Samples, found: &mut Sampled) {
        let Samples { hemisphere, areas, guide, view } = samples;
        let mut us: Vec<(usize, u32, [f32; 4])> = Vec::with_capacity(2 * (hemisphere + areas) as usize);
        for (stage, count) in [(Stage::Block, hemisphere), (Stage::BlockArea, areas)] {
            let first = if stage == Stage::Block { found.drawn.hemisphere } else { found.drawn.areas };
            for k in 0..2 {
                let sequence = self.sequence(stage, b, k);
                us.extend((first..first + count).map(|index| (k, index, sequence.point(index, 0))));
            }
        }
        let points = self.points(b, us.iter().map(|(_, _, u)| [u[0], u[1]]));
        let start = |((half, index, u), point): (&(usize, u32, [f32; 4]), &SurfacePoint)| Start {
            half: *half,
            u: [u[2], u[3]],
            index: *index,
            point: *point,
        };
        let starts: Vec<Start> = us.iter().zip(&points).map(start).collect();
        let (over_hemisphere, to_areas) = starts.split_at(2 * hemisphere as usize);
        if found.drawn.normals.0.is_empty() {
            let block = &self.blocks.list[b];
            found.drawn.normals.0 = if block.is_flat() {
                vec![block.normal]
            } else {
                over_hemisphere.iter().take(MOST_NORMALS).map(|s| s.point.normal).collect()
            };
        }
        self.hemisphere(over_hemisphere, guide, found);
        found.drawn.hemisphere += hemisphere;
        if let (Some(guide), Some(view)) = (guide, view) {
            self.areas(b, to_areas, guide, view, found);
            found.drawn.expect(view, areas);
        }
    }

    /// Points on block `b` at each of `us`; on backs their normals point away from the back.
    fn points(&self, b: usize, us: impl Iterator<Item = [f32; 2]>) -> Vec<SurfacePoint> {
        let Lit { ground, exposure, .. } = *self.lit;
        let block = &self.blocks.list[b];
        let mut picks: Vec<(u32, u32, [f32; 2])> = us
            .enumerate()
            .map(|(index, [x, y])| {
                let (k, rest) = self.blocks.pick(b, x);
                (k as u32, index as u32, [rest, y])
            })
            .collect();
        // Those of one texel in a row, so that its footprint is cut once.
        picks.sort_unstable_by_key(|p| (p.0, p.1));
        let surface = ground.patches.surface[self.blocks.order[block.first as usize] as usize];
        let middle = SurfacePoint { position: block.centre, normal: block.normal, shading: block.normal, surface };
        let mut points = vec![middle; picks.len()];
        let mut cutter = Cutter::new(ground);
        let side = if block.back { -1.0 } else { 1.0 };
        for group in picks.chunk_by(|p, q| p.0 == q.0) {
            let patch = self.blocks.order[group[0].0 as usize] as usize;
            let mut footprint = cutter.footprint(patch);
            if footprint.is_empty() {
                continue;
            }
            if !block.back {
                footprint.restrict(exposure.cells[patch]);
            }
            for &(_, index, u) in group {
                let point = footprint.sample(u);
                points[index as usize] = SurfacePoint { normal: point.normal * side, ..point };
            }
        }
        points
    }

    fn hemisphere(&self, starts: &[Start], guide: Option<&Guide>, found: &mut Sampled) {
        let Lit { ground, .. } = *self.lit;
        let has_sky = self.lit.lights.sky.is_some();
        let ray = |s: &Start| Ray {
            origin: ground.tracer.off_surface(s.point.position, s.point.normal),
            direction: frame(s.point.normal) * cosine_hemisphere(s.u),
        };
        let rays: Vec<Ray> = starts.iter().map(ray).collect();
        let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
        ground.tracer.closest(&rays, &mut hits);
        for ((start, ray), hit) in starts.iter().zip(&rays).zip(&hits) {
            let half = &mut found.halves[start.half];
            let Some(hit) = hit else {
                if has_sky {
                    let known = guide.map_or(Found::NOTHING, |g| g.find_sky(ray.origin, ray.direction));
                    half.sky.push(SkyLink::new(ray.direction, known));
                } else {
                    half.lost += 1;
                }
                continue;
            };
            found.inverse_distance += 1.0 / hit.t;
            let of = if hit.back { &self.blocks.back_of } else { &self.blocks.front_of };
            let Some(patch) = ground.patch_under(hit).filter(|&patch| of[patch] != NONE) else {
                half.lost += 1;
                continue;
            };
            let known = guide.filter(|g| !hit.back && g.holds(patch)).map_or(0.0, |guide| {
                let (surface, triangle) = ground.tracer.place(hit.triangle);
                let [a, b, c] = ground.scene.world_triangle(surface, triangle);
                let cos = -ray.direction.dot((b - a).cross(c - a).normalize_or_zero());
                guide.pdf(patch, hit.t * hit.t, cos)
            });
            half.links.push(Link::new(patch, hit.back, ray.direction, known));
        }
    }

    fn areas(&self, b: usize, starts: &[Start], guide: &Guide, view: &View, found: &mut Sampled) {
        let tracer = self.lit.ground.tracer;
        let sequences = [0, 1].map(|k| self.sequence(Stage::BlockArea, b, k));
        let (mut segments, mut links) = (Vec::new(), Vec::new());
        let (mut rays, mut halves) = (Vec::new(), Vec::new());
        for start in starts {
            let origin = tracer.off_surface(start.point.position, start.point.normal);
            let (cluster, rest) = view.pick(start.u[0]);
            // A place takes two numbers: one is what is left of the choice of the cluster, shifted by a number of its own.
            let shift = sequences[start.half].point(start.index, 1)[0];
            match guide.aim(cluster, origin, [(rest + shift).fract(), start.u[1]]) {
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
        let mut blocked = vec![false; segments.len().max(rays.len())];
        tracer.occluded(&segments, &mut blocked[..segments.len()]);
        for ((half, link), _) in links.into_iter().zip(&blocked).filter(|(_, blocked)| !**blocked) {
            found.halves[half].links.push(link);
        }
        tracer.occluded_rays(&rays, &mut blocked[..rays.len()]);
        for ((ray, half), _) in rays.iter().zip(halves).zip(&blocked).filter(|(_, blocked)| !**blocked) {
            found.halves[half].sky.push(SkyLink::new(ray.direction, guide.find_sky(ray.origin, ray.direction)));
        }
    }

    /// Direct light on the back of patch `i`.
    pub fn direct_on_back(&self, i: usize) -> Arriving {
        let Lit { ground, lights, params, .. } = *self.lit;
        let footprint = ground.footprint(i);
        if footprint.is_empty() {
            return Arriving::default();
        }
        let sample = |u: [f32; 2]| {
            let point = footprint.sample(u);
            SurfacePoint { normal: -point.normal, shading: -point.normal, ..point }
        };
        let position = ground.patches.position[i];
        let receiver = Receiver {
            sample: &sample,
            position,
            normal: -ground.patches.normal[i],
            radius: footprint.radius(position),
            sequence: Sequence::new(self.seed, Stage::Back, i as u64),
        };
        let params = DirectParams { shading_normals: false, first_samples: 1, gather_samples: 1, ..params.clone() };
        glimpse(ground.scene, ground.tracer, lights, &receiver, &params)
    }

    fn sequence(&self, stage: Stage, b: usize, k: usize) -> Sequence {
        let block = &self.blocks.list[b];
        Sequence::new(self.seed, stage, u64::from(block.first) << 8 | u64::from(block.level) << 4 | k as u64)
    }
}
