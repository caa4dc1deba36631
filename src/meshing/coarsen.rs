//! Vertices that the light doesn't need are taken out again: a cut point moves onto a neighbour, and the pieces between them go.
//!
//! A point within a triangle of the source may move onto any neighbour, one on an edge of such a triangle along that edge alone, for
//! all triangles that have it: the mesh stays watertight. A point goes where what is left around it holds the light as exactly as
//! asked, or, where there are too many triangles, where that costs the least.

use super::MeshParams;
use super::Weights;
use super::fine::Piece;
use super::fit::relative_error;
use super::refine::{Work, deal};
use super::sample::{Source, Within};
use crate::Result;
use crate::progress::Progress;
use glam::DVec3;
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

/// The pieces around a point that moves onto a neighbour.
struct Retriangulation {
    onto: u32,
    /// How much the light at the point changes, relative to what it is.
    change: f64,
    /// The pieces that stay, by number, what they become, and the values at their corners.
    new: Vec<(usize, Piece)>,
    values: Vec<[DVec3; 3]>,
    /// The pieces that go.
    gone: Vec<usize>,
}

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
        works.par_iter_mut().for_each(|w| w.fit());
        let count: u64 = works.iter().map(|w| w.fine.pieces.len() as u64).sum();
        let is_over = most.is_some_and(|most| count > most);
        let removals: Vec<Vec<Removal>> = works.par_iter().map(|w| w.removals(params, is_over, source.mean)).collect();
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
    /// What taking out each cut point would cost, the way that changes the least; without those that the light needs, unless there are
    /// too many triangles (`is_over`).
    fn removals(&self, params: &MeshParams, is_over: bool, mean: f32) -> Vec<Removal> {
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
            let moves =
                self.neighbours(point, star).into_iter().filter_map(|onto| self.retriangulation(point, onto, star));
            let best = moves.min_by(|a, b| a.change.total_cmp(&b.change))?;
            // What is far off at the point itself is far off around it.
            if !is_over && best.change > 2.0 * params.error {
                return None;
            }
            self.removal(point, star, best, params, mean)
        };
        around.par_iter().enumerate().filter_map(best).collect()
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

    /// The pieces around `point` where it moves onto `onto`; `None` where one would be turned over or flattened.
    fn retriangulation(&self, point: u32, onto: u32, star: &[u32]) -> Option<Retriangulation> {
        let pieces = &self.fine.pieces;
        // By triangle of the source: where the neighbour lies in it, and its value there; where the point lies, and its value.
        let mut target: BTreeMap<u32, (Weights, u32)> = BTreeMap::new();
        let mut origin: BTreeMap<u32, (Weights, u32)> = BTreeMap::new();
        let mut made = Retriangulation { onto, change: 0.0, new: Vec::new(), values: Vec::new(), gone: Vec::new() };
        for &p in star {
            let (piece, groups) = (&pieces[p as usize], self.groups.of[p as usize]);
            let k = piece.points.iter().position(|q| *q == point)?;
            origin.insert(piece.source, (piece.corners[k], groups[k]));
            if let Some(j) = piece.points.iter().position(|q| *q == onto) {
                target.insert(piece.source, (piece.corners[j], groups[j]));
                made.gone.push(p as usize);
            }
        }
        for p in star.iter().map(|p| *p as usize).filter(|p| !made.gone.contains(p)) {
            let (mut piece, mut groups) = (pieces[p], self.groups.of[p]);
            let k = piece.points.iter().position(|q| *q == point)?;
            let (weights, group) = *target.get(&piece.source)?;
            (piece.points[k], piece.corners[k], groups[k]) = (onto, weights, group);
            if piece.share() < LEAST_SHARE {
                return None;
            }
            let values = groups.map(|g| self.values[g as usize].as_dvec3());
            let (place, before) = origin[&piece.source];
            let w = Within::new(&piece.corners)?.weights(place.0);
            if w.min_element() > -1e-9 {
                let after = values[0] * w.x + values[1] * w.y + values[2] * w.z;
                let before = self.values[before as usize].as_dvec3();
                let change = (after - before).abs().max_element() / before.max_element().max(f64::MIN_POSITIVE);
                made.change = made.change.max(change);
            }
            made.new.push((p, piece));
            made.values.push(values);
        }
        self.is_fit(&made.new, star).then_some(made)
    }

    /// What a retriangulation around `point` costs; `None` where a triangle of the source would be left without a piece.
    fn removal(
        &self,
        point: u32,
        star: &[u32],
        made: Retriangulation,
        params: &MeshParams,
        mean: f32,
    ) -> Option<Removal> {
        let pieces = &self.fine.pieces;
        let Retriangulation { onto, new, values, gone, .. } = made;
        let mut members = vec![Vec::new(); new.len()];
        let sources: BTreeSet<u32> = star.iter().map(|p| pieces[*p as usize].source).collect();
        for source in sources {
            let of: Vec<usize> = (0..new.len()).filter(|k| new[*k].1.source == source).collect();
            let parts: Vec<Piece> = of.iter().map(|k| new[*k].1).collect();
            if parts.is_empty() {
                return None;
            }
            let mut dealt = vec![Vec::new(); of.len()];
            let from = star.iter().map(|p| *p as usize).filter(|p| pieces[*p].source == source);
            deal(from.flat_map(|p| self.members[p].iter().copied()), &self.samples, &parts, &mut dealt);
            of.into_iter().zip(dealt).for_each(|(k, dealt)| members[k] = dealt);
        }
        let error = PART * params.error;
        let was = |p: usize| self.judge(&pieces[p], &self.corners(p), &self.members[p], error, mean).0;
        let before: f64 = star.iter().map(|p| was(*p as usize)).sum();
        let (mut after, mut is_free) = (0.0, true);
        for (((_, piece), values), members) in new.iter().zip(&values).zip(&members) {
            let (squares, wrong) = self.judge(piece, values, members, error, mean);
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
        let (mut squares, mut wrong, mut area) = (0.0, 0.0, 0.0);
        self.samples.each_error(&piece.corners, values, members, |s, _, difference| {
            squares += s.weight(mean) * difference.length_squared();
            area += f64::from(s.area);
            if relative_error(difference, s.level(mean)) > error {
                wrong += f64::from(s.area);
            }
        });
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
