//! Vertices that the light doesn't need are taken out again: a cut point moves onto a neighbour, and the pieces between them go.
//!
//! A point within a triangle of the source may move onto any neighbour, one on an edge of such a triangle along that edge alone, for
//! all triangles that have it: the mesh stays watertight. A point goes where what is left around it holds the light as exactly as
//! asked, or, where there are too many triangles, where that costs the least.

use super::MeshParams;
use super::fine::Piece;
use super::refine::{Work, deal};
use super::sample::{Source, Within};
use crate::Result;
use crate::progress::Progress;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Passes, at most: in each, points that are no neighbours go at once.
const PASSES: usize = 64;
/// The part of the error asked for that is left around a point that goes: less than all, so that a new fit doesn't ask for it again.
const PART: f64 = 0.8;
/// The share of a piece's area whose error may be larger.
const SHARE: f64 = 0.03;
/// The least determinant of a piece's weights, which is its share of its triangle.
const LEAST_SHARE: f64 = 1e-9;

/// A point that may go.
struct Removal {
    /// How much squared error that adds, by the weights of the fit.
    cost: f64,
    /// What is left is as exact as asked.
    is_free: bool,
    point: u32,
    onto: u32,
    /// The pieces around the point, by number, that stay, and what they become.
    new: Vec<(usize, Piece)>,
    /// Their samples.
    members: Vec<Vec<u32>>,
    /// The pieces that go.
    gone: Vec<usize>,
}

/// Takes out the points that the light doesn't need, and then, while there are more than `most` triangles, those that cost least.
///
/// # Errors
/// `Cancelled`.
pub fn coarsen(
    works: &mut [Work],
    source: &Source,
    params: &MeshParams,
    most: Option<u64>,
    progress: &dyn Progress,
) -> Result<()> {
    for _ in 0..PASSES {
        progress.check()?;
        works.par_iter_mut().for_each(|w| w.fit(source.mean));
        let count: u64 = works.iter().map(|w| w.fine.pieces.len() as u64).sum();
        let removals: Vec<Vec<Removal>> = works.par_iter().map(|w| w.removals(params, source.mean)).collect();
        let dear = most.map_or(f64::NEG_INFINITY, |most| threshold(&removals, count.saturating_sub(most)));
        let gone: usize = works
            .par_iter_mut()
            .zip(removals)
            .map(|(w, removals)| w.remove(source, removals.into_iter().filter(|r| r.is_free || r.cost <= dear)))
            .sum();
        // The last few are not worth another pass.
        let is_done = most.is_none_or(|most| count - gone as u64 <= most);
        if gone == 0 || is_done && (gone as u64) * 100 < count {
            break;
        }
    }
    Ok(())
}

/// The cost up to which points have to go for `excess` triangles to go.
fn threshold(removals: &[Vec<Removal>], excess: u64) -> f64 {
    if excess == 0 {
        return f64::NEG_INFINITY;
    }
    let mut costs: Vec<(f64, u64)> = removals.iter().flatten().map(|r| (r.cost, r.gone.len() as u64)).collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0;
    let enough = costs.iter().find(|(_, gone)| {
        sum += gone;
        sum >= excess
    });
    enough.map_or(f64::INFINITY, |(cost, _)| *cost)
}

impl Work {
    /// What taking out each cut point would cost, the cheapest way.
    fn removals(&self, params: &MeshParams, mean: f32) -> Vec<Removal> {
        let mut around: Vec<Vec<u32>> = vec![Vec::new(); self.fine.points.len() - self.fine.own];
        for (number, piece) in (0..).zip(&self.fine.pieces) {
            for p in piece.points.iter().filter(|p| **p as usize >= self.fine.own) {
                around[*p as usize - self.fine.own].push(number);
            }
        }
        let broken: BTreeSet<u32> = self.fine.breaks.iter().flatten().copied().collect();
        let best = |(k, star): (usize, &Vec<u32>)| {
            let point = (k + self.fine.own) as u32;
            if star.is_empty() || broken.contains(&point) {
                return None;
            }
            let before: f64 = star.iter().map(|p| self.squares(*p as usize, mean)).sum();
            let options = self.neighbours(point, star);
            let all = options.into_iter().filter_map(|onto| self.removal(point, onto, star, before, params, mean));
            all.min_by(|a, b| (!a.is_free).cmp(&!b.is_free).then(a.cost.total_cmp(&b.cost)))
        };
        around.par_iter().enumerate().filter_map(best).collect()
    }

    /// The squared error of a piece, by the weights of the fit.
    fn squares(&self, piece: usize, mean: f32) -> f64 {
        let mut sum = 0.0;
        self.each_error(piece, |s, _, difference| sum += s.weight(mean) * difference.length_squared());
        sum
    }

    /// The points that `point` may move onto.
    fn neighbours(&self, point: u32, star: &[u32]) -> Vec<u32> {
        let mut found = BTreeSet::new();
        for piece in star.iter().map(|p| &self.fine.pieces[*p as usize]) {
            let Some(k) = piece.points.iter().position(|p| *p == point) else { continue };
            // On an edge of the source's triangle: the corner opposite has no weight.
            let on_edge = |w: DVec3, corner: usize| w[corner] == 0.0;
            let edges: Vec<usize> = (0..3).filter(|c| on_edge(piece.corners[k].0, *c)).collect();
            for j in [(k + 1) % 3, (k + 2) % 3] {
                if edges.iter().all(|c| on_edge(piece.corners[j].0, *c)) {
                    found.insert(piece.points[j]);
                }
            }
        }
        found.into_iter().collect()
    }

    /// The removal of `point`, moved onto `onto`, from the pieces `star` around it, whose squared error is `before`; `None` where a
    /// piece would be turned over or flattened.
    fn removal(
        &self,
        point: u32,
        onto: u32,
        star: &[u32],
        before: f64,
        params: &MeshParams,
        mean: f32,
    ) -> Option<Removal> {
        let pieces = &self.fine.pieces;
        // By triangle of the source: where the neighbour lies in it, and its value there.
        let mut target: BTreeMap<u32, (super::Weights, u32)> = BTreeMap::new();
        let mut gone = Vec::new();
        for &p in star {
            let piece = &pieces[p as usize];
            if let Some(j) = piece.points.iter().position(|q| *q == onto) {
                target.insert(piece.source, (piece.corners[j], self.groups.of[p as usize][j]));
                gone.push(p as usize);
            }
        }
        let mut new = Vec::with_capacity(star.len() - gone.len());
        let mut values = Vec::with_capacity(new.capacity());
        for p in star.iter().map(|p| *p as usize).filter(|p| !gone.contains(p)) {
            let mut piece = pieces[p];
            let k = piece.points.iter().position(|q| *q == point)?;
            let (weights, group) = *target.get(&piece.source)?;
            (piece.points[k], piece.corners[k]) = (onto, weights);
            let share = DMat3::from_cols(piece.corners[0].0, piece.corners[1].0, piece.corners[2].0).determinant();
            if share < LEAST_SHARE {
                return None;
            }
            let mut groups = self.groups.of[p];
            groups[k] = group;
            new.push((p, piece));
            values.push(groups.map(|g| self.values[g as usize].as_dvec3()));
        }
        if !self.is_fit(&new, star) {
            return None;
        }
        let mut members = vec![Vec::new(); new.len()];
        for source in target.keys() {
            let of: Vec<usize> = (0..new.len()).filter(|k| new[*k].1.source == *source).collect();
            let parts: Vec<Piece> = of.iter().map(|k| new[*k].1).collect();
            let mut dealt = vec![Vec::new(); of.len()];
            let from = star.iter().map(|p| *p as usize).filter(|p| pieces[*p].source == *source);
            let samples: Vec<u32> = from.flat_map(|p| self.members[p].iter().copied()).collect();
            if of.is_empty() && !samples.is_empty() {
                return None;
            }
            deal(samples.into_iter(), &self.samples, &parts, &mut dealt);
            of.into_iter().zip(dealt).for_each(|(k, dealt)| members[k] = dealt);
        }
        let (mut after, mut is_free) = (0.0, true);
        for (((_, piece), values), members) in new.iter().zip(&values).zip(&members) {
            let (squares, wrong) = self.judge(piece, values, members, PART * params.error, mean);
            after += squares;
            is_free &= wrong <= SHARE;
        }
        Some(Removal { cost: after - before, is_free, point, onto, new, members, gone })
    }

    /// True where no new piece is flatter than half of the flattest around, as seen in the world.
    fn is_fit(&self, new: &[(usize, Piece)], star: &[u32]) -> bool {
        let height = |piece: &Piece| {
            let [a, b, c] = piece.points.map(|p| self.fine.points[p as usize]);
            let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
            (b - a).cross(c - a).length() / longest.sqrt().max(f64::MIN_POSITIVE)
        };
        let least = star.iter().map(|p| height(&self.fine.pieces[*p as usize])).fold(f64::INFINITY, f64::min);
        new.iter().all(|(_, piece)| height(piece) >= 0.5 * least)
    }

    /// The squared error of a piece with `values` at its corners, and the share of its area that is off by more than `error`.
    fn judge(&self, piece: &Piece, values: &[DVec3; 3], members: &[u32], error: f64, mean: f32) -> (f64, f64) {
        let Some(within) = Within::new(&piece.corners) else { return (f64::INFINITY, 1.0) };
        let (mut squares, mut wrong, mut area) = (0.0, 0.0, 0.0);
        for s in members.iter().map(|s| &self.samples.all[*s as usize]).filter(|s| !s.is_doubtful) {
            let w = within.weights(s.weights());
            let difference = values[0] * w.x + values[1] * w.y + values[2] * w.z - s.value.as_dvec3();
            squares += s.weight(mean) * difference.length_squared();
            area += f64::from(s.area);
            if super::fit::relative_error(difference, s.level(mean)) > error {
                wrong += f64::from(s.area);
            }
        }
        (squares, if area > 0.0 { wrong / area } else { 0.0 })
    }

    /// Applies `removals`, the cheapest first, of points that have no piece in common; returns how many pieces went.
    fn remove(&mut self, source: &Source, removals: impl Iterator<Item = Removal>) -> usize {
        let mut removals: Vec<Removal> = removals.collect();
        if removals.is_empty() {
            return 0;
        }
        removals.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(a.point.cmp(&b.point)));
        let mut is_touched = vec![false; self.fine.points.len()];
        let mut is_gone = vec![false; self.fine.pieces.len()];
        for removal in removals {
            let points = || removal.new.iter().flat_map(|(_, piece)| piece.points).chain([removal.point, removal.onto]);
            let others = removal.gone.iter().flat_map(|p| self.fine.pieces[*p].points);
            if points().chain(others.clone()).any(|p| is_touched[p as usize]) {
                continue;
            }
            points().chain(others).for_each(|p| is_touched[p as usize] = true);
            removal.gone.iter().for_each(|p| is_gone[*p] = true);
            for ((p, piece), members) in removal.new.into_iter().zip(removal.members) {
                self.fine.pieces[p] = piece;
                self.members[p] = members;
            }
        }
        let count = is_gone.iter().filter(|g| **g).count();
        let mut stays = is_gone.iter().map(|g| !g);
        self.fine.pieces.retain(|_| stays.next().unwrap_or(true));
        let mut stays = is_gone.iter().map(|g| !g);
        self.members.retain(|_| stays.next().unwrap_or(true));
        self.regroup(source);
        count
    }
}
