//! Texels that a jump of the light runs through hold some of both sides: what values on either side must not be fitted to.

use super::fine::{FineMesh, Piece};
use super::fit::Groups;
use super::sample::{Samples, Within};
use glam::DVec3;
use std::collections::HashMap;

/// How far from a jump a texel holds some of both sides, in distances between samples: half of its diagonal, and some more.
const MIXED: f64 = 0.75;
/// The part of a narrow strip's depth from which on its samples have to do.
const MIDDLE: f64 = 0.6;
/// The most that samples stand for, in sides of a mean texel: those of triangles that have next to no texels stand for more.
const LARGEST: f64 = 4.0;

/// Marks the samples that hold light of both sides of a break, of whatever piece it is an edge. Of strips as narrow as a texel, where
/// no corner has anything else to go by, what lies in their middle has to do. `members`: the samples of each piece; `texel`: the
/// side of the surface's texels [m].
pub fn doubt_beside_breaks(fine: &FineMesh, groups: &Groups, samples: &mut Samples, members: &[Vec<u32>], texel: f64) {
    if fine.breaks.is_empty() {
        return;
    }
    // Of a texel on an edge a sample stands for a half, and of one that a small piece has for itself for less.
    let reach = |piece: &Piece| {
        let of_triangle = samples.of(piece.source as usize);
        let largest = of_triangle.map(|s| samples.all[s as usize].area).fold(0.0, f32::max);
        MIXED * f64::from(largest).sqrt().min(LARGEST * texel)
    };
    let mut reaches: Vec<f64> = Vec::with_capacity(fine.pieces.len());
    for parts in fine.pieces.chunk_by(|a, b| a.source == b.source) {
        reaches.resize(reaches.len() + parts.len(), reach(&parts[0]));
    }
    let breaks = Breaks::new(fine, reaches.iter().copied().fold(0.0, f64::max));
    let mut is_told = vec![false; groups.count];
    let mut depths: Vec<Vec<f64>> = Vec::with_capacity(members.len());
    for (k, members) in members.iter().enumerate() {
        depths.push(breaks.depths(fine, &fine.pieces[k], samples, members));
        let is_certain = |(s, depth): (&u32, &f64)| !samples.all[*s as usize].is_doubtful && *depth >= reaches[k];
        if members.iter().zip(&depths[k]).any(is_certain) {
            groups.of[k].iter().for_each(|g| is_told[*g as usize] = true);
        }
    }
    for (k, members) in members.iter().enumerate() {
        let is_strip = !groups.of[k].iter().any(|g| is_told[*g as usize]);
        let middle = if is_strip { MIDDLE * depths[k].iter().copied().fold(0.0, f64::max) } else { f64::INFINITY };
        for (s, depth) in members.iter().zip(&depths[k]) {
            samples.all[*s as usize].is_doubtful |= *depth < reaches[k].min(middle);
        }
    }
}

/// Breaks by the cells of a grid around them.
struct Breaks {
    lines: Vec<[DVec3; 2]>,
    cells: HashMap<[i64; 3], Vec<u32>>,
    /// Side of a cell [m].
    side: f64,
}

impl Breaks {
    /// Those of `fine`, to be found from places within `reach` [m] of them.
    fn new(fine: &FineMesh, reach: f64) -> Self {
        let lines: Vec<[DVec3; 2]> = fine.breaks.iter().map(|e| e.map(|p| fine.points[p as usize])).collect();
        let mut breaks = Self { lines, cells: HashMap::new(), side: 2.0 * reach.max(f64::MIN_POSITIVE) };
        for (number, [a, b]) in (0..).zip(breaks.lines.clone()) {
            let steps = (a.distance(b) / reach.max(f64::MIN_POSITIVE)).ceil().clamp(1.0, 1e6) as usize;
            for step in 0..=steps {
                // A place within reach of the line is within one and a half of it from a step.
                let [x, y, z] = breaks.cell(a.lerp(b, step as f64 / steps as f64));
                for [i, j, k] in (0..27).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]) {
                    let cell = [x.saturating_add(i), y.saturating_add(j), z.saturating_add(k)];
                    let known = breaks.cells.entry(cell).or_default();
                    if known.last() != Some(&number) {
                        known.push(number);
                    }
                }
            }
        }
        breaks
    }

    fn cell(&self, p: DVec3) -> [i64; 3] {
        (p / self.side).floor().to_array().map(|x| x as i64)
    }

    /// How far each of `members`, samples of `piece`, is from the nearest break [m]; infinite where none is near.
    fn depths(&self, fine: &FineMesh, piece: &Piece, samples: &Samples, members: &[u32]) -> Vec<f64> {
        let Some(within) = Within::new(&piece.corners) else { return vec![f64::INFINITY; members.len()] };
        let [a, b, c] = piece.points.map(|p| fine.points[p as usize]);
        let depth = |s: &u32| {
            let w = within.weights(samples.all[*s as usize].weights());
            let place = a * w.x + b * w.y + c * w.z;
            let near = self.cells.get(&self.cell(place)).into_iter().flatten();
            near.map(|line| distance(self.lines[*line as usize], place)).fold(f64::INFINITY, f64::min)
        };
        members.iter().map(depth).collect()
    }
}

/// How far `p` is from the line between two points [m].
pub fn distance([a, b]: [DVec3; 2], p: DVec3) -> f64 {
    let way = b - a;
    let along = (p - a).dot(way) / way.length_squared().max(f64::MIN_POSITIVE);
    p.distance(a.lerp(b, along.clamp(0.0, 1.0)))
}
