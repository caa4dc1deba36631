//! How open the surroundings of a texel are: ambient occlusion, bent normal and sky visibility.
//!
//! Over the hemisphere above a point, with V(w) = 1 where nothing lies along w within a distance, else 0:
//!
//! - ambient occlusion, the open share `1/pi int V cos dw` (Zhukov, Iones, Kronin 1998, "An Ambient Light Illumination Model");
//! - the bent normal, the mean open direction `int V w cos dw`, unit (Landis 2002, "Production-Ready Global Illumination");
//! - sky visibility, the same share as the first without a bound on the distance: the form factor to the sky.
//!
//! Rays are cosine-distributed about the shown normal, from points over the footprint. Those below the triangle's own horizon, which
//! smooth normals have, count for nothing: a plane is wholly open whatever its normals. Cost: so many rays a texel; noise of the
//! shares about `0.5 samples^-3/4`, as of stratified samples of an area that an edge parts.

use crate::Result;
use crate::light::Lit;
use crate::patch::{Cutter, Footprint};
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::{cosine_hemisphere, frame};
use crate::trace::{Ray, Segment};
use glam::Vec3;
use rayon::prelude::*;

/// Patches that a thread takes at once, at most.
const SHARE: usize = 256;

/// What is looked for.
#[derive(Clone, Copy, Debug)]
pub struct OpennessParams {
    /// Rays a texel, 1..=65536.
    pub samples: u32,
    /// How far away things occlude [m]; `None`: however far.
    pub distance: Option<f32>,
    /// Whether the near surroundings are wanted, and whether the sky is.
    pub near: bool,
    pub sky: bool,
    pub seed: u32,
}

/// The surroundings of every patch; buried ones have the defaults.
#[derive(Clone, Debug, Default)]
pub struct Openness {
    /// The share of the hemisphere, weighed by the cosine, with nothing near, 0..=1; empty unless wanted.
    pub ambient: Vec<f32>,
    /// The mean direction with nothing near, in the world, unit: the shown normal where there is none. Empty unless wanted.
    pub bent: Vec<Vec3>,
    /// The share of the hemisphere, weighed by the cosine, in which the sky is seen, 0..=1; empty unless wanted.
    pub sky: Vec<f32>,
    pub rays: u64,
}

/// Looks around from every patch.
///
/// # Errors
/// `Cancelled`.
pub fn openness(lit: &Lit, params: &OpennessParams, progress: &dyn Progress) -> Result<Openness> {
    let count = lit.ground.patches.len();
    progress.begin("openness", count as u64);
    let look = |look: &mut Look, i: usize| {
        if i.is_multiple_of(64) {
            progress.check()?;
            progress.advance(64.min(count - i) as u64);
        }
        Ok(look.around(i))
    };
    let found: Vec<Around> = (0..count)
        .into_par_iter()
        .with_max_len(SHARE)
        .map_init(|| Look::new(lit, params), look)
        .collect::<Result<_>>()?;
    let wanted = |is: bool| if is { &found[..] } else { &[] };
    Ok(Openness {
        ambient: wanted(params.near).iter().map(|a| a.ambient).collect(),
        bent: wanted(params.near).iter().map(|a| a.bent).collect(),
        sky: wanted(params.sky).iter().map(|a| a.sky).collect(),
        rays: found.iter().map(|a| a.rays).sum(),
    })
}

/// What one patch found.
#[derive(Clone, Copy)]
struct Around {
    ambient: f32,
    bent: Vec3,
    sky: f32,
    rays: u64,
}

/// One thread's looks, and the memory for them.
struct Look<'a> {
    lit: &'a Lit<'a>,
    params: &'a OpennessParams,
    cutter: Cutter<'a>,
    footprint: Footprint,
    rays: Vec<Ray>,
    segments: Vec<Segment>,
    near: Vec<bool>,
    hidden: Vec<bool>,
}

impl<'a> Look<'a> {
    fn new(lit: &'a Lit<'a>, params: &'a OpennessParams) -> Self {
        Self {
            lit,
            params,
            cutter: Cutter::new(lit.ground),
            footprint: Footprint::default(),
            rays: Vec::new(),
            segments: Vec::new(),
            near: Vec::new(),
            hidden: Vec::new(),
        }
    }

    fn around(&mut self, i: usize) -> Around {
        let mut around = Around { ambient: 0.0, bent: self.lit.ground.patches.normal[i], sky: 0.0, rays: 0 };
        if !self.lit.is_wanted(i) {
            return around;
        }
        self.cutter.cut(i, &mut self.footprint);
        if self.footprint.is_empty() {
            return around;
        }
        self.footprint.restrict(self.lit.exposure.cells[i]);
        let shown = self.draw(i);
        let tracer = self.lit.ground.tracer;
        let drawn = self.rays.len().max(1) as f32;
        let share = |blocked: &[bool]| blocked.iter().filter(|blocked| !**blocked).count() as f32 / drawn;
        self.hidden.clear();
        self.hidden.resize(self.rays.len(), false);
        if self.params.sky || self.params.distance.is_none() {
            tracer.occluded_rays(&self.rays, &mut self.hidden);
            around.rays += self.rays.len() as u64;
            around.sky = share(&self.hidden);
        }
        if self.params.near {
            self.near.clone_from(&self.hidden);
            if let Some(distance) = self.params.distance {
                let segment = |ray: &Ray| Segment { from: ray.origin, to: ray.origin + ray.direction * distance };
                self.segments.clear();
                self.segments.extend(self.rays.iter().map(segment));
                tracer.occluded(&self.segments, &mut self.near);
                around.rays += self.rays.len() as u64;
            }
            around.ambient = share(&self.near);
            let open = self.rays.iter().zip(&self.near).filter(|(_, blocked)| !**blocked);
            around.bent = open.map(|(ray, _)| ray.direction).sum::<Vec3>().try_normalize().unwrap_or(shown);
        }
        around
    }

    /// Draws the rays of patch `i`, and returns the mean of their normals.
    fn draw(&mut self, i: usize) -> Vec3 {
        let (params, tracer) = (self.lit.params, self.lit.ground.tracer);
        let sequence = Sequence::new(self.params.seed, Stage::Openness, i as u64);
        let mut sum = Vec3::ZERO;
        self.rays.clear();
        for index in 0..self.params.samples {
            let [x, y, s, t] = sequence.point(index, 0);
            let point = self.footprint.sample([x, y]);
            let normal = if params.shading_normals { point.shading } else { point.normal };
            sum += normal;
            let direction = frame(normal) * cosine_hemisphere([s, t]);
            if direction.dot(point.normal) > 0.0 {
                self.rays.push(Ray { origin: tracer.off_surface(point.position, point.normal), direction });
            }
        }
        sum.try_normalize().unwrap_or(self.lit.ground.patches.normal[i])
    }
}
