//! Seams: where charts meet in space and lie apart on pages, their light should meet as well.
//!
//! Both sides are read as engines read them, bilinearly, at samples along each shared edge, and the texels around are moved so that
//! the two readings agree in the sense of least squares ([`stitch`]). Which edges are shared is found by place ([`border`]): edges of charts
//! that lie on one another, of one surface or of two (modular walls, tiles), whose faces go on on the other side, and whose
//! shown normals agree. Edges with something standing on them stay apart: light differs across them by right.

pub mod border;
pub mod stitch;

use super::{PageImage, Quantity};
use crate::color::{Rgb, luminance};
use crate::light::Lit;
use crate::patch::Ground;
use crate::trace::Segment;
use border::{Border, Grid};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Which seams are closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeamMode {
    /// Those between charts of any surfaces.
    #[default]
    All,
    /// Those between charts of one surface.
    Surface,
    /// None.
    Off,
}

/// How far light jumps across seams: the mean difference of the two sides' luminance over their mean, 0 where nothing does.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct SeamReport {
    /// Length of the seams, each side counted [texels].
    pub texels: f64,
    /// Before and after they were closed [%].
    pub before: f64,
    pub after: f64,
}

/// A place on a page [texels].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub page: u32,
    pub at: Vec2,
}

/// The same point of a seam on both of its sides, and the length of the seam that it stands for [texels].
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    pub sides: [Place; 2],
    pub length: f32,
}

/// The seams of a scene.
#[derive(Clone, Debug, Default)]
pub struct Seams {
    pub samples: Vec<Sample>,
}

/// Samples of a seam for each texel along it.
const SAMPLES: f32 = 2.0;

/// Samples along one edge, at most.
const MOST_SAMPLES: f32 = 1e5;

/// Where something is looked for that stands on a seam: so far to either side and above it [texels].
const ASIDE: f32 = 0.75;
const ABOVE: f32 = 0.5;

impl Seams {
    /// Finds the seams of all surfaces that receive light. Where `quantity` holds the surfaces' own albedo, only those between equal
    /// materials.
    pub fn new(lit: &Lit, mode: SeamMode, quantity: Quantity) -> Self {
        if mode == SeamMode::Off {
            return Self::default();
        }
        let borders = border::borders(lit);
        let grid = Grid::new(&borders);
        let is_one = |a: &Border, b: &Border| {
            (mode == SeamMode::All || a.surface == b.surface)
                && (quantity != Quantity::Radiosity || a.material == b.material)
        };
        let of_border = |e: usize| along(lit, &borders, &grid, e, &is_one);
        let samples: Vec<Vec<Sample>> = (0..borders.len()).into_par_iter().with_min_len(16).map(of_border).collect();
        Self { samples: samples.concat() }
    }

    /// Mean difference across the seams of `pages` over the mean there (luminance).
    pub fn gap(&self, pages: &[PageImage]) -> f64 {
        let read = |place: &Place| luminance(bilinear(&pages[place.page as usize], place.at));
        self.measure(read)
    }

    /// The same with another way to read.
    pub(super) fn measure(&self, read: impl Fn(&Place) -> f32 + Sync) -> f64 {
        let part = |samples: &[Sample]| {
            samples.iter().fold([0.0f64; 2], |[difference, sum], sample| {
                let [a, b] = [0, 1].map(|side| f64::from(read(&sample.sides[side])));
                let length = f64::from(sample.length);
                [difference + length * (a - b).abs(), sum + 0.5 * length * (a.abs() + b.abs())]
            })
        };
        let parts: Vec<[f64; 2]> = self.samples.par_chunks(1 << 12).map(part).collect();
        let [difference, sum] = parts.iter().fold([0.0; 2], |all, part| [all[0] + part[0], all[1] + part[1]]);
        if sum > 0.0 { difference / sum } else { 0.0 }
    }

    /// Length of the seams, each side counted [texels].
    pub fn texels(&self) -> f64 {
        self.samples.iter().map(|s| 2.0 * f64::from(s.length)).sum()
    }
}

/// The four texels that a bilinear look-up at `at` [texels] of a page of `size` reads, clamped to the page, with their weights.
pub fn taps(size: [usize; 2], at: Vec2) -> [(usize, f32); 4] {
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let column = |x: f32| (x.max(0.0) as usize).min(size[0] - 1);
    let row = |y: f32| (y.max(0.0) as usize).min(size[1] - 1);
    let (x, y) = ([column(corner.x), column(corner.x + 1.0)], [row(corner.y), row(corner.y + 1.0)]);
    [
        (y[0] * size[0] + x[0], (1.0 - f.x) * (1.0 - f.y)),
        (y[0] * size[0] + x[1], f.x * (1.0 - f.y)),
        (y[1] * size[0] + x[0], (1.0 - f.x) * f.y),
        (y[1] * size[0] + x[1], f.x * f.y),
    ]
}

/// What an engine reads of a page at `at` [texels].
pub fn bilinear(page: &PageImage, at: Vec2) -> Rgb {
    taps([page.width as usize, page.height as usize], at).iter().map(|&(t, weight)| page.rgb[t] * weight).sum()
}

/// The samples along border `e` that have another side.
fn along(
    lit: &Lit,
    borders: &[Border],
    grid: &Grid,
    e: usize,
    is_one: &dyn Fn(&Border, &Border) -> bool,
) -> Vec<Sample> {
    let own = &borders[e];
    let texels = own.at[0].distance(own.at[1]);
    let count = (texels * SAMPLES).ceil().clamp(1.0, MOST_SAMPLES) as usize;
    let mut found: Vec<(Sample, Segment)> = Vec::new();
    for k in 0..count {
        let s = (k as f32 + 0.5) / count as f32;
        let point = own.point(s);
        let Some((f, t)) = grid.facing(borders, e, s, point, is_one) else { continue };
        let other = &borders[f];
        let sides = [own.place(s), other.place(t)];
        // Each pair is met from both of its sides.
        let sample = Sample { sides, length: 0.5 * texels / count as f32 };
        let step = |b: &Border, n: Vec3| point + b.inward * (ASIDE * b.texel) + n * (ABOVE * own.texel.max(b.texel));
        found.push((sample, Segment { from: step(own, own.face), to: step(other, other.face) }));
    }
    let segments: Vec<Segment> = found.iter().map(|f| f.1).collect();
    let mut blocked = vec![false; segments.len()];
    lit.ground.tracer.occluded(&segments, &mut blocked);
    let is_open = |sample: &Sample| sample.sides.iter().all(|place| shows_light(lit.ground, lit, place));
    found
        .into_iter()
        .zip(blocked)
        .filter(|((sample, _), b)| !b && is_open(sample))
        .map(|((sample, _), _)| sample)
        .collect()
}

/// True where a place lies on a texel with light of its own.
fn shows_light(ground: &Ground, lit: &Lit, place: &Place) -> bool {
    ground.patch_near(place.page as usize, place.at).is_some_and(|i| !lit.exposure.is_buried(i))
}
