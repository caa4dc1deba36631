//! Texels moved so that both sides of seams read the same: least squares after Iwanicki 2013, "Lighting Technology of The Last of Us".
//!
//! With d the changes of the texels around seams, the sum is minimized of
//!
//! - `SEAM` w_s (reading of the one side - of the other)^2 over the samples s of seams, bilinear as engines read;
//! - `STIFFNESS` (d_i - d_j)^2 over neighbouring texels of one chart, so that a change fades over a few texels;
//! - `PULL` a_i d_i^2, a_i being the area of the texel over the mean: texels stay where they were.
//!
//! The first two don't see a common change of all texels, so at the minimum the sum of a_i d_i is 0: no light is made or lost.
//! Readings that agree stay as they are to the bit. Everything is linear in the texels: parts of the light add up as before.
//! Conjugate gradients, preconditioned by the diagonal; sums run in a fixed order.

use super::{Place, Seams, taps};
use crate::color::Rgb;
use crate::light::Lit;
use crate::patch::NONE;
use crate::post::dilate::Canvas;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Weights of the three terms.
const SEAM: f32 = 4.0;
const STIFFNESS: f32 = 0.2;
const PULL: f32 = 0.03;

/// Texels in gutters and inside other geometry have no area that counts; this share of the pull keeps them in bounds.
const FREE: f32 = 1e-3;

/// The pull on texels whose light is known: they stay, and the other side comes to them.
const HELD: f32 = 1e4;

/// Rings of texels around seams that may move: `sqrt(STIFFNESS / PULL)` is the distance over which a change fades to 1 / e.
const RINGS: usize = 8;

/// Conjugate gradients end once the residual has fallen to this share, or after so many rounds.
const RESIDUAL: f64 = 1e-3;
const MOST_ROUNDS: usize = 200;

/// Readings that differ by less than this share of themselves are equal but for rounding.
const ROUNDING: f32 = 1e-6;

/// Values summed in one go.
const PART: usize = 1 << 12;

/// Closes `seams` on canvases whose charts and first ring of gutters are filled.
pub(in crate::post) fn stitch(lit: &Lit, seams: &Seams, canvases: &mut [Canvas]) {
    let system = System::new(lit, seams, canvases);
    if system.texels.is_empty() {
        return;
    }
    let changes = system.solve(&system.right_side(canvases));
    for (&[page, texel], change) in system.texels.iter().zip(changes) {
        canvases[page as usize].rgb[texel as usize] += change;
    }
}

/// The normal equations.
struct System {
    /// Page and texel of each unknown.
    texels: Vec<[u32; 2]>,
    /// Weight of each one's square.
    pull: Vec<f32>,
    /// Neighbours of each in its chart: of k, `links[first_link[k]..first_link[k + 1]]`.
    links: Vec<u32>,
    first_link: Vec<u32>,
    /// Per sample of a seam: eight unknowns with their shares in the difference of both sides, and the sample's weight.
    rows: Vec<([(u32, f32); 8], f32)>,
    /// Places in `rows` that each unknown stands at, row times 8 + tap: of k, `uses[first_use[k]..first_use[k + 1]]`.
    uses: Vec<u32>,
    first_use: Vec<u32>,
}

/// Unknowns under way.
struct Unknowns {
    /// By page and texel.
    number: Vec<Vec<u32>>,
    texels: Vec<[u32; 2]>,
}

impl Unknowns {
    fn number(&mut self, page: u32, texel: usize) -> u32 {
        let number = &mut self.number[page as usize][texel];
        if *number == NONE {
            *number = self.texels.len() as u32;
            self.texels.push([page, texel as u32]);
        }
        *number
    }
}

impl System {
    fn new(lit: &Lit, seams: &Seams, canvases: &[Canvas]) -> Self {
        let number = canvases.iter().map(|c| vec![NONE; c.rgb.len()]).collect();
        let mut unknowns = Unknowns { number, texels: Vec::new() };
        let mut rows = Vec::new();
        for sample in &seams.samples {
            let reading = |place: &Place| taps(canvases[place.page as usize].size, place.at);
            let sides = [reading(&sample.sides[0]), reading(&sample.sides[1])];
            let is_filled = |side: usize, (t, weight): (usize, f32)| {
                weight == 0.0 || canvases[sample.sides[side].page as usize].filled[t]
            };
            if !(0..2).all(|side| sides[side].iter().all(|tap| is_filled(side, *tap))) {
                continue;
            }
            let row = std::array::from_fn(|k| {
                let (side, (texel, weight)) = (k / 4, sides[k / 4][k % 4]);
                (unknowns.number(sample.sides[side].page, texel), if side == 0 { weight } else { -weight })
            });
            rows.push((row, SEAM * sample.length));
        }
        grow(lit, canvases, &mut unknowns);
        let Unknowns { number, texels } = unknowns;
        let charts: Vec<u32> = texels.par_iter().map(|&[p, t]| canvases[p as usize].owner(t as usize)).collect();
        let (links, first_link) = links(canvases, &number, &texels, &charts);
        let pull = pull(lit, &texels, &charts);
        let (uses, first_use) = uses(&rows, texels.len());
        Self { texels, pull, links, first_link, rows, uses, first_use }
    }

    fn links_of(&self, k: usize) -> &[u32] {
        &self.links[self.first_link[k] as usize..self.first_link[k + 1] as usize]
    }

    fn uses_of(&self, k: usize) -> impl Iterator<Item = (usize, f32, f32)> {
        self.uses[self.first_use[k] as usize..self.first_use[k + 1] as usize].iter().map(|&place| {
            let (row, tap) = (place as usize / 8, place as usize % 8);
            let (taps, weight) = &self.rows[row];
            (row, taps[tap].1, *weight)
        })
    }

    /// What makes the sides differ, against the gradient.
    fn right_side(&self, canvases: &[Canvas]) -> Vec<Vec3> {
        let value = |k: u32| {
            let [page, texel] = self.texels[k as usize];
            canvases[page as usize].rgb[texel as usize]
        };
        let gap = |(taps, _): &([(u32, f32); 8], f32)| {
            // Relative to one of the texels, so that what is even has no gap at all.
            let centre = value(taps[0].0);
            let sum = |taps: &[(u32, f32)]| taps.iter().map(|&(k, w)| (value(k) - centre) * w).sum::<Vec3>();
            let gap = sum(taps);
            let scale = taps.iter().map(|&(k, _)| value(k).abs()).fold(Vec3::ZERO, Vec3::max);
            Vec3::select(gap.abs().cmple(scale * ROUNDING), Vec3::ZERO, gap)
        };
        let gaps: Vec<Rgb> = self.rows.par_iter().map(gap).collect();
        let down = |k: usize| -self.uses_of(k).map(|(row, share, weight)| gaps[row] * (share * weight)).sum::<Vec3>();
        (0..self.texels.len()).into_par_iter().map(down).collect()
    }

    /// The equations' left side at `d`.
    fn apply(&self, d: &[Vec3]) -> Vec<Vec3> {
        let read = |(taps, _): &([(u32, f32); 8], f32)| taps.iter().map(|&(k, w)| d[k as usize] * w).sum();
        let readings: Vec<Vec3> = self.rows.par_iter().map(read).collect();
        let left = |k: usize| {
            let links = self.links_of(k);
            let around: Vec3 = links.iter().map(|&n| d[n as usize]).sum();
            let seam: Vec3 = self.uses_of(k).map(|(row, share, weight)| readings[row] * (share * weight)).sum();
            d[k] * self.pull[k] + (d[k] * links.len() as f32 - around) * STIFFNESS + seam
        };
        (0..d.len()).into_par_iter().map(left).collect()
    }

    /// Conjugate gradients from 0 on (Hestenes, Stiefel 1952), each channel on its own.
    fn solve(&self, right: &[Vec3]) -> Vec<Vec3> {
        let n = right.len();
        let inverse = |k: usize| {
            let seam: f32 = self.uses_of(k).map(|(_, share, weight)| share * share * weight).sum();
            1.0 / (self.pull[k] + STIFFNESS * self.links_of(k).len() as f32 + seam).max(f32::MIN_POSITIVE)
        };
        let inverse: Vec<f32> = (0..n).into_par_iter().map(inverse).collect();
        let scaled = |r: &[Vec3]| -> Vec<Vec3> { r.par_iter().zip(&inverse).map(|(r, i)| *r * *i).collect() };
        let (mut d, mut residual) = (vec![Vec3::ZERO; n], right.to_vec());
        let mut z = scaled(&residual);
        let mut way = z.clone();
        let mut square = dot(&residual, &z);
        let goal = square * RESIDUAL * RESIDUAL;
        for _ in 0..MOST_ROUNDS {
            if square.cmple(goal).all() {
                break;
            }
            let image = self.apply(&way);
            let step = ratio(square, dot(&way, &image)).as_vec3();
            d.par_iter_mut().zip(&way).for_each(|(d, way)| *d += *way * step);
            residual.par_iter_mut().zip(&image).for_each(|(r, image)| *r -= *image * step);
            z = scaled(&residual);
            let next = dot(&residual, &z);
            let turn = ratio(next, square).as_vec3();
            way.par_iter_mut().zip(&z).for_each(|(way, z)| *way = *z + *way * turn);
            square = next;
        }
        d
    }
}

/// Takes the texels around those that seams read among the unknowns.
fn grow(lit: &Lit, canvases: &[Canvas], unknowns: &mut Unknowns) {
    let (mut first, is_free) = (0, |page: u32, t: usize| {
        let patch = lit.ground.patches.at(page as usize, t);
        patch.is_some_and(|i| !lit.exposure.is_buried(i))
    });
    for _ in 0..RINGS {
        let last = unknowns.texels.len();
        for k in first..last {
            let [page, texel] = unknowns.texels[k];
            let canvas = &canvases[page as usize];
            let chart = canvas.chart[texel as usize];
            for n in canvas.beside(texel as usize) {
                if chart != NONE && canvas.chart[n] == chart && is_free(page, n) {
                    unknowns.number(page, n);
                }
            }
        }
        first = last;
    }
}

/// The unknowns beside each, of the same chart or of its gutter.
fn links(canvases: &[Canvas], number: &[Vec<u32>], texels: &[[u32; 2]], charts: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut links, mut first) = (Vec::with_capacity(4 * texels.len()), vec![0]);
    for (&[page, texel], &chart) in texels.iter().zip(charts) {
        let beside = canvases[page as usize].beside(texel as usize).map(|n| number[page as usize][n]);
        links.extend(beside.filter(|&n| n != NONE && chart != NONE && charts[n as usize] == chart));
        first.push(links.len() as u32);
    }
    (links, first)
}

/// How strongly each unknown is held: by the area that shows it; `charts` are those that they belong to.
fn pull(lit: &Lit, texels: &[[u32; 2]], charts: &[u32]) -> Vec<f32> {
    let patches = lit.ground.patches;
    let area = |&[page, texel]: &[u32; 2]| {
        let patch = patches.at(page as usize, texel as usize).filter(|&i| !lit.exposure.is_buried(i));
        patch.map_or(0.0, |i| patches.area[i])
    };
    let areas: Vec<f32> = texels.iter().map(area).collect();
    let whole: f64 = areas.iter().map(|a| f64::from(*a)).sum();
    let mean = (whole / areas.iter().filter(|a| **a > 0.0).count().max(1) as f64).max(f64::MIN_POSITIVE);
    let is_held = |chart: u32| {
        lit.known.is_some_and(|known| chart != NONE && known[lit.ground.patches.surface_of_chart(chart) as usize])
    };
    let hold = |(area, chart): (&f32, &u32)| match is_held(*chart) {
        true => HELD,
        false => PULL * ((f64::from(*area) / mean) as f32).max(FREE),
    };
    areas.iter().zip(charts).map(hold).collect()
}

/// Where each unknown stands in the rows.
fn uses(rows: &[([(u32, f32); 8], f32)], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0u32; count + 1];
    let taps =
        || rows.iter().enumerate().flat_map(|(r, row)| row.0.iter().enumerate().map(move |(k, tap)| (r, k, tap)));
    taps().for_each(|(_, _, tap)| first[tap.0 as usize + 1] += 1);
    for k in 0..count {
        first[k + 1] += first[k];
    }
    let (mut next, mut uses) = (first.clone(), vec![0; 8 * rows.len()]);
    for (r, k, tap) in taps() {
        let slot = &mut next[tap.0 as usize];
        uses[*slot as usize] = (8 * r + k) as u32;
        *slot += 1;
    }
    (uses, first)
}

/// Sum of the products by channel, in a fixed order.
fn dot(a: &[Vec3], b: &[Vec3]) -> DVec3 {
    let part = |(a, b): (&[Vec3], &[Vec3])| a.iter().zip(b).map(|(a, b)| a.as_dvec3() * b.as_dvec3()).sum::<DVec3>();
    a.par_chunks(PART).zip(b.par_chunks(PART)).map(part).collect::<Vec<_>>().into_iter().sum()
}

/// By channel, 0 where there is nothing to divide by.
fn ratio(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::select(b.cmpgt(DVec3::ZERO), a / b.max(DVec3::splat(f64::MIN_POSITIVE)), DVec3::ZERO)
}
