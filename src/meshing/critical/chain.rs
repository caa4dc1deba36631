//! Lines that lie on one another as one line, and the choice of those that show most.

use super::{CriticalLine, CriticalParams};
use glam::DVec3;
use rayon::prelude::*;

/// Lines nearer than this share of the least length lie on each other.
const SAME: f64 = 1e-2;

/// Lines shorter than this share of the least length are left out: outlines have corners that edges' own shadows leave
/// open.
pub const LEAST_PIECE: f64 = 0.25;

/// Joins lines of one triangle that lie on one straight line and touch, leaves out what is too short or shows too
/// little, and sorts by surface, triangle and how much each shows.
pub fn chain(mut lines: Vec<CriticalLine>, params: &CriticalParams) -> Vec<CriticalLine> {
    lines.retain(|line| line.ends.iter().all(|p| p.is_finite()));
    // Bits of places break ties, so that no order of work shows.
    let key = |line: &CriticalLine| line.ends.map(|p| p.to_array().map(f64::to_bits));
    lines.par_sort_by(|a, b| {
        let place = |line: &CriticalLine| (line.surface, line.triangle);
        place(a).cmp(&place(b)).then(b.rank().total_cmp(&a.rank())).then_with(|| key(a).cmp(&key(b)))
    });
    let triangles: Vec<&[CriticalLine]> =
        lines.chunk_by(|a, b| (a.surface, a.triangle) == (b.surface, b.triangle)).collect();
    let mut chained: Vec<CriticalLine> =
        triangles.par_iter().flat_map_iter(|lines| join(lines, SAME * params.length)).collect();
    chained.retain(|line| line.length() >= LEAST_PIECE * params.length);
    if chained.len() > params.lines {
        let mut ranks: Vec<(f64, usize)> = chained.iter().map(CriticalLine::rank).zip(0..).collect();
        ranks.par_sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept = vec![false; chained.len()];
        ranks[..params.lines].iter().for_each(|(_, i)| kept[*i] = true);
        let mut kept = kept.into_iter();
        chained.retain(|_| kept.next() == Some(true));
    }
    chained
}

/// The lines of one triangle, those that touch along one straight line as one.
fn join(lines: &[CriticalLine], tolerance: f64) -> Vec<CriticalLine> {
    let mut joined: Vec<CriticalLine> = Vec::new();
    for line in lines {
        let mut line = *line;
        // A line may close the gap between several.
        while let Some(k) = joined.iter().position(|other| union(other, &line, tolerance).is_some()) {
            let other = joined.remove(k);
            line = union(&other, &line, tolerance).unwrap_or(line);
        }
        joined.push(line);
    }
    joined.sort_by(|a, b| b.rank().total_cmp(&a.rank()));
    joined
}

/// Two lines as one, where they lie on one straight line and touch.
fn union(a: &CriticalLine, b: &CriticalLine, tolerance: f64) -> Option<CriticalLine> {
    let (long, short) = if a.length() >= b.length() { (a, b) } else { (b, a) };
    let [from, to] = long.ends;
    let length = long.length();
    let along = (to - from) / length.max(f64::MIN_POSITIVE);
    let off = |p: DVec3| (p - from).reject_from(along).length();
    if short.ends.iter().any(|p| off(*p) > tolerance) {
        return None;
    }
    let [s, t] = short.ends.map(|p| (p - from).dot(along));
    let (low, high) = (s.min(t), s.max(t));
    if low > length + tolerance || high < -tolerance {
        return None;
    }
    // Those of different orders where the lower one covers the other.
    if long.order != short.order && (short.order < long.order || low < -tolerance || high > length + tolerance) {
        return None;
    }
    let end = |at: f64, own: DVec3, others: [(f64, DVec3); 2]| {
        others.into_iter().find(|(x, _)| *x == at).map_or(own, |(_, p)| p)
    };
    let others = [(s, short.ends[0]), (t, short.ends[1])];
    let ends =
        [if low < 0.0 { end(low, from, others) } else { from }, if high > length { end(high, to, others) } else { to }];
    let first = if a.order <= b.order { a } else { b };
    Some(CriticalLine { ends, order: first.order, width: first.width, contrast: a.contrast.max(b.contrast), ..*a })
}
