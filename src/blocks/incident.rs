//! Where the light between surfaces comes from: its moments over directions, by block and then by patch.
//!
//! Links know their directions, and the solid angle that each stands for, so the moments follow from the links that the light itself
//! comes by. Flat links count for more than in irradiance, which weighs them by their cosine: blocks are smoothed by planes through their
//! neighbours as their light is ([`super::smooth`]), by what the two halves of the samples say of the noise of all moments together,
//! and read in between ([`super::show`]). Curved blocks keep moments at 3 x 3 normals: what lies below the horizon of each is dark to it.

use super::block::{Block, Blocks};
use super::field::Field;
use super::respond::Grid;
use super::show::read_between;
use super::smooth::fit;
use super::sweep::{Radiosity, System};
use crate::color::{Rgb, luminance};
use crate::moments::Moments;
use crate::patch::NONE;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Blocks that a thread takes at once, at most.
const SHARE: usize = 64;

/// Moments in a row.
type Row = [f32; Moments::COUNT];

/// Moments of a block, and half the difference between its two halves of samples, in a row.
const BOTH: usize = 2 * Moments::COUNT;

/// Moments of a block as a function of the normal.
enum Incident {
    Flat(Row),
    Curved(Box<(Grid, [Row; 9])>),
}

impl Incident {
    fn at(&self, normal: Vec3) -> Row {
        match self {
            Self::Flat(row) => *row,
            Self::Curved(curved) => curved.0.read(&curved.1, normal),
        }
    }

    /// With `by` added about every normal.
    fn moved(self, by: &Row) -> Self {
        match self {
            Self::Flat(row) => Self::Flat(add(&row, by, 1.0)),
            Self::Curved(mut curved) => {
                curved.1.iter_mut().for_each(|node| *node = add(node, by, 1.0));
                Self::Curved(curved)
            }
        }
    }
}

/// Moments of the light that comes to every patch along links [lx], while patches send `radiosity`; zero on buried ones.
pub fn incident(field: &Field, radiosity: &Radiosity) -> Vec<Moments> {
    let blocks = &field.blocks;
    let system = field.system();
    let found = |b: usize| find(&system, radiosity, b);
    let found: Vec<(Incident, Row)> = (0..blocks.fronts()).into_par_iter().with_max_len(SHARE).map(found).collect();
    let smoothed = smooth(blocks, &field.around, found);
    let patches = field.lit.ground.patches;
    let of_patch = |i: usize| {
        let b = match blocks.front_of[i] {
            NONE => return Moments::default(),
            b => b as usize,
        };
        let normal = patches.normal[i];
        let mut sum = [0.0; Moments::COUNT];
        let read = |n: usize, share: f32| sum = add(&sum, &smoothed[n].at(normal), share);
        if !read_between(field.lit, blocks, &field.around[b], b, i, read) {
            sum = smoothed[b].at(normal);
        }
        Moments::from_array(sum).made_possible()
    };
    (0..patches.len()).into_par_iter().map(of_patch).collect()
}

/// `a + share b`.
fn add<const N: usize>(a: &[f32; N], b: &[f32; N], share: f32) -> [f32; N] {
    std::array::from_fn(|k| a[k] + share * b[k])
}

/// Moments of block `b`, and half the difference of its halves about its mean normal.
fn find(system: &System, radiosity: &Radiosity, b: usize) -> (Incident, Row) {
    let block = &system.blocks.list[b];
    let (normals, grid) = if block.is_flat() {
        (vec![block.normal], None)
    } else {
        let grid = Grid::new(block.normal, block.spread);
        (grid.normals(block.normal).to_vec(), Some(grid))
    };
    let [first, second] = [0, 1].map(|half| of_half(system, radiosity, b, half, &normals));
    let mean = |k: usize| add(&first[k].to_array(), &second[k].to_array(), 1.0).map(|v| 0.5 * v);
    let middle = normals.len() / 2;
    let difference = add(&first[middle].to_array(), &second[middle].to_array(), -1.0).map(|v| 0.5 * v);
    let incident = match grid {
        None => Incident::Flat(mean(0)),
        Some(grid) => Incident::Curved(Box::new((grid, std::array::from_fn(mean)))),
    };
    (incident, difference)
}

/// Moments that half `half` of the samples of block `b` finds over the hemispheres of `normals`.
fn of_half(system: &System, radiosity: &Radiosity, b: usize, half: usize, normals: &[Vec3]) -> Vec<Moments> {
    let (found, lit) = (&system.sampled[b], system.lit);
    let half = &found.halves[half];
    // One normal stands for all of a flat block, whatever lies below it by a little.
    let is_flat = normals.len() == 1;
    let mut sums = vec![Moments::default(); normals.len()];
    let mut even = Moments::default();
    let mut put = |radiance: Rgb, solid_angle: f32, direction: Vec3| {
        for (sum, normal) in sums.iter_mut().zip(normals) {
            if is_flat || normal.dot(direction) > 0.0 {
                sum.receive(radiance * solid_angle, direction);
            }
        }
        even.receive(Rgb::splat(solid_angle), direction);
    };
    for (link, weight, tint) in half.seen() {
        let direction = link.direction();
        let (_, solid_angle) = found.drawn.solid_angle(direction, weight);
        put(radiosity.at(link.target()) * tint * FRAC_1_PI, solid_angle, direction);
    }
    for (link, weight, tint) in half.sky_seen() {
        let direction = link.direction();
        let (_, solid_angle) = found.drawn.solid_angle(direction, weight);
        let radiance = lit.lights.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.smooth(lit.ground.scene, direction));
        put(radiance * tint, solid_angle, direction);
    }
    if let ([sum], [normal], 0) = (&mut sums[..], normals, half.lost) {
        evened(sum, &even, *normal);
    }
    sums
}

/// Takes out of `sum` what samples do to even light: the moments that they find of a radiance of 1 all round, `even`, are known. A control
/// variate (Owen 2013, "Monte Carlo Theory, Methods and Examples", section 8.9) that leaves the noise of the differences to the mean
/// radiance. The light about `normal` stays as it is.
fn evened(sum: &mut Moments, even: &Moments, normal: Vec3) {
    let missed = Moments::uniform(Rgb::splat(PI), normal) + *even * -1.0;
    *sum += missed.times(sum.along(normal) * FRAC_1_PI);
}

/// Takes out the noise that neighbours tell, as [`super::smooth::smooth`] does from light.
fn smooth(blocks: &Blocks, around: &[Vec<u32>], found: Vec<(Incident, Row)>) -> Vec<Incident> {
    let both = |row: &Row, difference: &Row| -> [f32; BOTH] {
        std::array::from_fn(|k| if k < row.len() { row[k] } else { difference[k - row.len()] })
    };
    let about = |n: usize, block: &Block| both(&found[n].0.at(block.normal), &found[n].1);
    let own: Vec<[f32; BOTH]> =
        blocks.list[..found.len()].iter().enumerate().map(|(b, block)| about(b, block)).collect();
    let plane = |value: &(dyn Fn(usize, usize) -> [f32; BOTH] + Sync)| -> Vec<Option<[f32; BOTH]>> {
        (0..around.len()).into_par_iter().map(|b| fit(blocks, &around[b], b, |n| value(b, n))).collect()
    };
    // Twice, to what the first plane misses as well.
    let first = plane(&|b, n| about(n, &blocks.list[b]));
    let missed = |b: usize| first[b].map_or([0.0; BOTH], |fitted| add(&own[b], &fitted, -1.0));
    let missed: Vec<[f32; BOTH]> = (0..around.len()).map(missed).collect();
    let second = plane(&|_, n| missed[n]);
    let fits: Vec<Option<[f32; BOTH]>> =
        first.iter().zip(&second).map(|(a, b)| Some(add(a.as_ref()?, b.as_ref()?, 1.0))).collect();
    let squares = |b: usize| fits[b].map(|fit| squares(&add(&own[b], &fit, -1.0)));
    let squares: Vec<Option<[f32; 2]>> = (0..around.len()).map(squares).collect();
    let step = |b: usize| -> Row {
        let Some(fit) = &fits[b] else { return [0.0; Moments::COUNT] };
        let mut sums = [0.0f32; 2];
        for &n in &around[b] {
            let weight = if n as usize == b { 2.0 } else { 1.0 };
            sums = add(&sums, &squares[n as usize].unwrap_or_default(), weight);
        }
        let [residual, noise] = sums;
        let kept = if residual > 0.0 { ((residual - noise) / residual).clamp(0.0, 1.0) } else { 0.0 };
        std::array::from_fn(|k| (1.0 - kept) * (fit[k] - own[b][k]))
    };
    let steps: Vec<Row> = (0..around.len()).into_par_iter().map(step).collect();
    found.into_iter().zip(&steps).map(|((incident, _), step)| incident.moved(step)).collect()
}

/// Squares (of luminances, over all moments) of what is left of a block's moments, and of its noise.
fn squares(rest: &[f32; BOTH]) -> [f32; 2] {
    let square = |from: usize| -> f32 {
        let rgb = |k: usize| Rgb::new(rest[from + k], rest[from + k + 1], rest[from + k + 2]);
        (0..Moments::COUNT).step_by(3).map(|k| luminance(rgb(k)).powi(2)).sum()
    };
    [square(0), square(Moments::COUNT)]
}
