//! Where area samples go: clusters of what shines, as a block sees them.
//!
//! What patches send is cut into runs of about equal power, as lightcuts cuts lamps (Walter et al. 2005); the sky adds the openings
//! that it is seen through ([`SkyCells`]). A block draws from those clusters that are bright against what it receives on average, in
//! proportion to `power cos cos / r^2` times the share of earlier samples from the same neighbourhood that got through; the
//! hemisphere finds the rest. In a hall lit by spots of sun, this is a factor of four in noise.

use super::block::Block;
use super::sky_cells::SkyCells;
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::sample::Discrete;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::Ray;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Clusters of patches, about.
const MOST_CLUSTERS: usize = 160;

/// Points kept on each cluster, a power of two.
const POINTS: u32 = 256;

/// A cluster is worth sampling where it is so many times as bright as what a block receives on average.
const BRIGHT: f32 = 2.0;

/// No cluster.
pub const NO_CLUSTER: u16 = u16::MAX;

/// Something that shines.
struct Cluster {
    centre: Vec3,
    normal: Vec3,
    radius: f32,
    /// Sine of the largest angle of its normals to the mean, about.
    spread: f32,
    /// Mean of what it sends [lm/m^2] and its flux [lm], luminance.
    radiosity: f32,
    flux: f32,
}

/// Clusters field by field: every block looks at all of them, several at a time.
#[derive(Default)]
struct Clusters {
    centre: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    radius: Vec<f32>,
    spread: Vec<f32>,
    radiosity: Vec<f32>,
    flux: Vec<f32>,
}

/// A point on a cluster, drawn in proportion to flux.
#[derive(Clone, Copy)]
struct Point {
    position: Vec3,
    normal: Vec3,
    patch: u32,
}

/// All that shines.
pub struct Guide {
    clusters: Clusters,
    /// The cluster of each patch.
    of_patch: Vec<u16>,
    /// What each patch sends over the flux of its cluster [1/m^2].
    density: Vec<f32>,
    /// [`POINTS`] on each cluster of patches.
    points: Vec<Point>,
    /// The sky's clusters follow those of patches.
    sky: SkyCells,
    sky_first: usize,
}

/// How a block draws from clusters.
#[derive(Clone, Debug)]
pub struct View {
    /// The clusters that are drawn, and the sums of their light up to and with each, relative to all.
    chosen: Vec<u16>,
    up_to: Vec<f32>,
    /// What it takes to find the probabilities again.
    pub recipe: Recipe,
}

/// The probabilities of a view without their table: a cluster that is brighter than `threshold` is drawn in proportion to what
/// arrives from it, of `arriving` in all.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// [lm/m^2], luminance.
    threshold: f32,
    /// About the irradiance that comes from all that are drawn [lx], luminance.
    pub arriving: f32,
}

/// Where an area sample looks.
pub enum Aim {
    Patch { patch: usize, position: Vec3, normal: Vec3 },
    Sky { direction: Vec3 },
}

/// What area sampling knows of a direction: the cluster, and the density [1/sr] with which that cluster would have been hit there.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub cluster: u16,
    pub pdf: f32,
}

impl Found {
    pub const NOTHING: Self = Self { cluster: NO_CLUSTER, pdf: 0.0 };
}

impl View {
    /// The cluster at `u` in [0, 1), and `u` rescaled within it.
    pub fn pick(&self, u: f32) -> (usize, f32) {
        let last = self.up_to.len() - 1;
        let at = u * self.up_to[last];
        let k = self.up_to.partition_point(|&sum| sum <= at).min(last);
        let low = if k == 0 { 0.0 } else { self.up_to[k - 1] };
        let rest = (at - low) / (self.up_to[k] - low).max(f32::MIN_POSITIVE);
        (self.chosen[k] as usize, rest.clamp(0.0, 1.0 - f32::EPSILON))
    }
}

impl Guide {
    /// Clusters what patches send, `sent` [lm/m^2], and the sky's openings.
    pub fn new(lit: &Lit, region: &[u32], sent: &[Rgb], sky: SkyCells, seed: u32) -> Self {
        let patches = lit.ground.patches;
        let flux = |i: u32| f64::from(luminance(sent[i as usize])) * f64::from(lit.exposure.area[i as usize]);
        let mut order: Vec<u32> = (0..patches.len() as u32).filter(|&i| flux(i) > 0.0).collect();
        let mut guide = Self {
            clusters: Clusters::default(),
            of_patch: vec![NO_CLUSTER; patches.len()],
            density: vec![0.0; patches.len()],
            points: Vec::new(),
            sky_first: 0,
            sky,
        };
        let runs = cut(lit, region, sent, &mut order);
        for run in &runs {
            let members = &order[run.clone()];
            let cluster = Cluster::new(lit, members, &flux);
            for &i in members {
                guide.of_patch[i as usize] = guide.clusters.flux.len() as u16;
                guide.density[i as usize] = luminance(sent[i as usize]) / cluster.flux;
            }
            guide.clusters.push(cluster);
        }
        guide.points = runs
            .par_iter()
            .enumerate()
            .flat_map_iter(|(c, run)| {
                let members = &order[run.clone()];
                let table = Discrete::new(members.iter().map(|&i| flux(i)));
                let sequence = Sequence::new(seed, Stage::Guide, c as u64);
                (0..POINTS).map(move |index| {
                    let [pick, x, y, _] = sequence.point(index, 0);
                    let patch = members[table.as_ref().map_or(0, |t| t.sample(pick).0)];
                    let mut footprint = lit.ground.footprint(patch as usize);
                    if footprint.is_empty() {
                        let (position, normal) = (patches.position[patch as usize], patches.normal[patch as usize]);
                        return Point { position, normal, patch };
                    }
                    footprint.restrict(lit.exposure.cells[patch as usize]);
                    let point = footprint.sample([x, y]);
                    Point {
                        position: lit.ground.tracer.off_surface(point.position, point.normal),
                        normal: point.normal,
                        patch,
                    }
                })
            })
            .collect();
        guide.sky_first = guide.len();
        let openings = guide.sky.openings().map(|o| Cluster {
            centre: o.centre,
            normal: o.normal,
            radius: o.radius,
            spread: 0.0,
            radiosity: o.radiance * PI,
            flux: o.radiance * PI * o.area,
        });
        openings.for_each(|opening| guide.clusters.push(opening));
        guide
    }

    /// Flux of cluster `c` [lm], luminance.
    pub fn flux(&self, c: usize) -> f32 {
        self.clusters.flux[c]
    }

    /// True where cluster `c` is a part of the sky.
    pub fn is_sky(&self, c: usize) -> bool {
        c >= self.sky_first
    }

    /// About the irradiance [lx] of `block` by each cluster, of which the share `open` gets through.
    pub fn arriving(&self, block: &Block, open: &[f32], arriving: &mut Vec<f32>) {
        self.clusters.arriving(block, arriving);
        arriving.iter_mut().zip(open).for_each(|(arriving, open)| *arriving *= open);
    }

    /// A ray of cluster `c`'s light.
    pub fn emit(&self, c: usize, u: [f32; 4]) -> Ray {
        let (origin, normal) = if self.is_sky(c) {
            let opening = self.sky.opening(c - self.sky_first);
            (self.sky.point(c - self.sky_first, [u[0], u[1]]), opening.normal)
        } else {
            let at = c * POINTS as usize + ((u[0] * POINTS as f32) as usize).min(POINTS as usize - 1);
            (self.points[at].position, self.points[at].normal)
        };
        Ray { origin, direction: frame(normal) * cosine_hemisphere([u[2], u[3]]) }
    }

    /// True where nothing shines.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.clusters.flux.len()
    }

    /// How a block that receives about `irradiance` [lx] (luminance) in all, and `arriving` from each cluster, draws from what is bright
    /// to it. `None` where nothing is.
    pub fn view(&self, irradiance: f32, arriving: &[f32]) -> Option<View> {
        let threshold = BRIGHT * irradiance;
        let mut view = View { chosen: Vec::new(), up_to: Vec::new(), recipe: Recipe { threshold, arriving: 0.0 } };
        for (c, (radiosity, arriving)) in self.clusters.radiosity.iter().zip(arriving).enumerate() {
            if *radiosity > threshold && *arriving > 0.0 {
                view.recipe.arriving += arriving;
                view.chosen.push(c as u16);
                view.up_to.push(view.recipe.arriving);
            }
        }
        (!view.chosen.is_empty()).then_some(view)
    }

    /// How many samples a block to which `arriving` [lx] comes from each cluster is expected to have drawn from each, by `recipes` so
    /// many times each: what replaces `arriving`.
    pub fn expected(&self, recipes: &[(Recipe, u32)], arriving: &mut [f32]) {
        for (radiosity, arriving) in self.clusters.radiosity.iter().zip(arriving) {
            let drawn = recipes.iter().filter(|(recipe, _)| *radiosity > recipe.threshold);
            *arriving *= drawn.map(|(recipe, samples)| *samples as f32 / recipe.arriving).sum::<f32>();
        }
    }

    /// The cluster numbered `cluster` as seen from `origin`: a point at `u`; `None` where the sky can't be seen that way.
    pub fn aim(&self, cluster: usize, origin: Vec3, u: [f32; 2]) -> Option<Aim> {
        if cluster >= self.sky_first {
            let direction = self.sky.sample(cluster - self.sky_first, origin, u)?;
            return Some(Aim::Sky { direction });
        }
        let at = cluster * POINTS as usize + ((u[0] * POINTS as f32) as usize).min(POINTS as usize - 1);
        let Point { position, normal, patch } = self.points[at];
        Some(Aim::Patch { patch: patch as usize, position, normal })
    }

    /// The cluster of `patch`, [`NO_CLUSTER`] where it has none.
    pub fn cluster(&self, patch: usize) -> u16 {
        self.of_patch[patch]
    }

    /// True where `patch` belongs to a cluster.
    pub fn holds(&self, patch: usize) -> bool {
        self.of_patch[patch] != NO_CLUSTER
    }

    /// The density [1/sr] with which its cluster is hit in `patch`, at distance squared `square` [m^2] under `cos` to the normal.
    pub fn pdf(&self, patch: usize, square: f32, cos: f32) -> f32 {
        self.density[patch] * square / cos.max(1e-4)
    }

    /// What area sampling knows of the sky from `origin` along `direction`.
    pub fn find_sky(&self, origin: Vec3, direction: Vec3) -> Found {
        match self.sky.find(origin, direction) {
            Some((cell, pdf)) => Found { cluster: (self.sky_first + cell) as u16, pdf },
            None => Found::NOTHING,
        }
    }
}

impl Cluster {
    fn new(lit: &Lit, members: &[u32], flux: &dyn Fn(u32) -> f64) -> Self {
        let patches = lit.ground.patches;
        let area = |i: u32| f64::from(lit.exposure.area[i as usize]);
        let total: f64 = members.iter().map(|&i| flux(i)).sum();
        let mean = |of: &dyn Fn(usize) -> Vec3| -> Vec3 {
            let sum: glam::DVec3 = members.iter().map(|&i| of(i as usize).as_dvec3() * flux(i)).sum();
            (sum / total.max(f64::MIN_POSITIVE)).as_vec3()
        };
        let centre = mean(&|i| patches.position[i]);
        let normal = mean(&|i| patches.normal[i]).try_normalize().unwrap_or(patches.normal[members[0] as usize]);
        let least = members.iter().map(|&i| normal.dot(patches.normal[i as usize])).fold(1.0, f32::min).max(0.0);
        // A few far patches must not blow it up: one and a half standard deviations.
        let squares: f64 =
            members.iter().map(|&i| f64::from(patches.position[i as usize].distance_squared(centre)) * flux(i)).sum();
        let radius = 1.5 * ((squares / total.max(f64::MIN_POSITIVE)) as f32).sqrt();
        Self {
            centre,
            normal,
            radius,
            spread: (1.0 - least * least).sqrt(),
            radiosity: (total / members.iter().map(|&i| area(i)).sum::<f64>().max(f64::MIN_POSITIVE)) as f32,
            flux: total as f32,
        }
    }
}

impl Clusters {
    fn push(&mut self, cluster: Cluster) {
        for k in 0..3 {
            self.centre[k].push(cluster.centre[k]);
            self.normal[k].push(cluster.normal[k]);
        }
        self.radius.push(cluster.radius);
        self.spread.push(cluster.spread);
        self.radiosity.push(cluster.radiosity);
        self.flux.push(cluster.flux);
    }

    /// About the irradiance [lx] of `block` by each cluster if nothing stood between.
    fn arriving(&self, block: &Block, arriving: &mut Vec<f32>) {
        let n = self.flux.len();
        let ([x, y, z], [nx, ny, nz]) =
            (self.centre.each_ref().map(|v| &v[..n]), self.normal.each_ref().map(|v| &v[..n]));
        let (radius, spread, flux) = (&self.radius[..n], &self.spread[..n], &self.flux[..n]);
        let (centre, normal) = (block.centre, block.normal);
        let (own_reach, own_spread) = (0.7 * block.side(), block.spread.min(1.5).sin());
        let within = |share: f32| if share > 0.0 { if share < 1.0 { share } else { 1.0 } } else { 0.0 };
        arriving.clear();
        arriving.resize(n, 0.0);
        // No calls and no branches: the compiler takes several clusters at a time.
        for (c, arriving) in arriving.iter_mut().enumerate() {
            let (dx, dy, dz) = (x[c] - centre.x, y[c] - centre.y, z[c] - centre.z);
            let reach = radius[c] + own_reach;
            let (square, least) = (dx * dx + dy * dy + dz * dz, reach * reach);
            let square = if square > least { square } else { least };
            let inverse = 1.0 / square.sqrt();
            // Parts of both may face better than their centres do.
            let margin = reach * inverse;
            let receive = (dx * normal.x + dy * normal.y + dz * normal.z) * inverse + margin + own_spread;
            let send = margin + spread[c] - (dx * nx[c] + dy * ny[c] + dz * nz[c]) * inverse;
            *arriving = flux[c] * FRAC_1_PI * within(receive) * within(send) * (inverse * inverse);
        }
    }
}

/// Runs of `order` of about equal flux, sorted so that none reaches across a region or from dark to bright.
fn cut(lit: &Lit, region: &[u32], sent: &[Rgb], order: &mut [u32]) -> Vec<std::ops::Range<usize>> {
    let flux = |i: u32| f64::from(luminance(sent[i as usize])) * f64::from(lit.exposure.area[i as usize]);
    let most = order.iter().map(|&i| flux(i)).sum::<f64>() / MOST_CLUSTERS as f64;
    let class =
        |i: u32| (region[i as usize], (luminance(sent[i as usize]).max(f32::MIN_POSITIVE).log2() * 0.5).floor() as i32);
    order.sort_unstable_by_key(|&i| (class(i), i));
    let mut runs: Vec<(f64, std::ops::Range<usize>)> = Vec::new();
    let mut last = None;
    for (k, &i) in order.iter().enumerate() {
        let flux = flux(i);
        match runs.last_mut().filter(|(sum, _)| last == Some(class(i)) && sum + flux <= most) {
            Some((sum, run)) => (*sum, run.end) = (*sum + flux, k + 1),
            None => runs.push((flux, k..k + 1)),
        }
        last = Some(class(i));
    }
    // What sends next to nothing is left to the hemisphere.
    runs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.start.cmp(&b.1.start)));
    runs.truncate(2 * MOST_CLUSTERS);
    runs.retain(|(flux, _)| *flux > 0.0);
    runs.sort_by_key(|r| r.1.start);
    runs.into_iter().map(|r| r.1).collect()
}
