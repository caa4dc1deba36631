//! Which triangles lie on top of each other in UV space: exactly within a chart, by samples over a whole set.

use super::mask;
use glam::DVec2;
use std::ops::Range;

/// Which cells of a square grid are taken.
pub struct Cells {
    /// Words of 64 cells in a row.
    words: usize,
    taken: Vec<u64>,
}

impl Cells {
    /// A grid of `side` x `side` free cells.
    pub fn new(side: usize) -> Self {
        let words = side.div_ceil(64);
        Self { words, taken: vec![0; words * side] }
    }

    /// How many of the cells `first..end` of `row` are taken.
    pub fn count(&self, row: usize, first: usize, end: usize) -> usize {
        let line = &self.taken[row * self.words..][..self.words];
        masks(first, end).map(|(word, mask)| (line[word] & mask).count_ones() as usize).sum()
    }

    /// Takes them, and returns how many of them were free.
    pub fn take(&mut self, row: usize, first: usize, end: usize) -> usize {
        let line = &mut self.taken[row * self.words..][..self.words];
        let mut fresh = 0;
        for (word, mask) in masks(first, end) {
            fresh += (mask & !line[word]).count_ones() as usize;
            line[word] |= mask;
        }
        fresh
    }
}

/// The words that hold the bits `first..end`, with a mask for each.
fn masks(first: usize, end: usize) -> impl Iterator<Item = (usize, u64)> {
    (first / 64..end.div_ceil(64)).map(move |word| {
        let low = u64::MAX << first.saturating_sub(word * 64);
        let high = u64::MAX >> 64usize.saturating_sub(end - word * 64).min(63);
        (word, low & high)
    })
}

/// Calls `span(row, first, end)` for the cells of a grid whose centres lie in the triangle. Triangles that share an edge, with
/// the same coordinates for its ends, never both get a centre on it.
pub fn centers(triangle: [DVec2; 3], columns: usize, rows: usize, mut span: impl FnMut(usize, usize, usize)) {
    let low = triangle.iter().fold(f64::INFINITY, |m, p| m.min(p.y));
    let high = triangle.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.y));
    if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) {
        return;
    }
    let first = (low - 0.5).ceil().max(0.0) as usize;
    let end = ((high - 0.5).ceil().max(0.0) as usize).min(rows);
    for row in first..end {
        let y = row as f64 + 0.5;
        let (mut x0, mut x1) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (p, q) = (triangle[k], triangle[(k + 1) % 3]);
            // One order for both triangles of an edge, so that both find the very same crossing.
            let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
            if p.y <= y && y < q.y {
                let x = p.x + (y - p.y) * ((q.x - p.x) / (q.y - p.y));
                (x0, x1) = (x0.min(x), x1.max(x));
            }
        }
        if x0 < x1 {
            let first = (x0 - 0.5).ceil().max(0.0) as usize;
            let end = ((x1 - 0.5).ceil().max(0.0) as usize).min(columns);
            if first < end {
                span(row, first, end);
            }
        }
    }
}

/// Overlaps thinner than this share of a chart's longer side are let be: that is rounding in positions, about a hundredth of a
/// texel in a chart of a thousand.
const THIN: f64 = 1e-5;

/// Sorts groups of triangles (polygons) into layers in which none overlaps another: each goes into the first layer where it
/// overlaps nothing by more than [`THIN`]. Usually that is one layer for all.
///
/// `groups` are ranges of `uv`, in the order that they are placed. Returns each group's layer. Triangles are held against those of
/// the same cells of a grid, by separating axes; those of one group aren't held against each other.
pub fn layers(uv: &[[DVec2; 3]], groups: &[Range<usize>]) -> Vec<usize> {
    if groups.len() < 2 {
        return vec![0; groups.len()];
    }
    let (low, high) = bounds(uv);
    let side = (uv.len() as f64).sqrt().clamp(1.0, 1024.0) as u32;
    let scale = DVec2::splat(f64::from(side)) / (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let thin = THIN * (high - low).max_element();
    // Layer and triangle of what lies in each cell.
    let mut cells: Vec<Vec<[u32; 2]>> = vec![Vec::new(); (side * side) as usize];
    let mut layer_of = Vec::with_capacity(groups.len());
    let mut count = 0;
    for group in groups {
        let mut blocked = vec![false; count];
        let mut own = Vec::new();
        for t in group.clone() {
            mask::scan(uv[t].map(|p| (p - low) * scale), [side; 2], &(0..side), 0.0, |row, first, end| {
                for cell in row * side + first..row * side + end {
                    own.push((cell, t as u32));
                    for &[layer, other] in &cells[cell as usize] {
                        if !blocked[layer as usize] && depth(&uv[t], &uv[other as usize]) > thin {
                            blocked[layer as usize] = true;
                        }
                    }
                }
            });
        }
        let layer = blocked.iter().position(|b| !b).unwrap_or(count);
        count = count.max(layer + 1);
        own.into_iter().for_each(|(cell, t)| cells[cell as usize].push([layer as u32, t]));
        layer_of.push(layer);
    }
    layer_of
}

/// How far one triangle would have to be moved off the other, along the best of the normals of their edges; negative where they
/// lie apart.
fn depth(a: &[DVec2; 3], b: &[DVec2; 3]) -> f64 {
    let extent = |t: &[DVec2; 3], axis: DVec2| {
        let [p, q, r] = t.map(|p| p.dot(axis));
        [p.min(q).min(r), p.max(q).max(r)]
    };
    let mut least = f64::INFINITY;
    let along = |axis: DVec2| {
        let ([a0, a1], [b0, b1]) = (extent(a, axis), extent(b, axis));
        (a1 - b0).min(b1 - a0)
    };
    // Boxes first: most pairs lie apart.
    for axis in [DVec2::X, DVec2::Y] {
        least = least.min(along(axis));
    }
    for t in [a, b] {
        for k in 0..3 {
            if least <= 0.0 {
                return least;
            }
            if let Some(edge) = (t[(k + 1) % 3] - t[k]).try_normalize() {
                least = least.min(along(edge.perp()));
            }
        }
    }
    least
}

/// The least and greatest coordinates.
pub fn bounds(uv: &[[DVec2; 3]]) -> (DVec2, DVec2) {
    uv.iter().flatten().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_part_into_layers_and_shared_edges_do_not() {
        let at = |x: f64, y: f64| DVec2::new(x, y);
        let lower = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)];
        let upper = [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        // Reaches over the diagonal by a ten-thousandth, which no grid of samples would see.
        let over = [at(0.1, 0.1), at(0.9, 0.9), at(0.5001, 0.4999)];
        assert_eq!(layers(&[lower, upper], &[0..1, 1..2]), [0, 0]);
        assert_eq!(layers(&[lower, upper, over], &[0..1, 1..2, 2..3]), [0, 0, 1]);
        assert_eq!(layers(&[upper, over, lower], &[0..1, 1..2, 2..3]), [0, 0, 1]);
        assert_eq!(layers(&[lower; 3], &[0..1, 1..2, 2..3]), [0, 1, 2]);
        // A group may overlap itself.
        assert_eq!(layers(&[lower, lower, upper], &[0..2, 2..3]), [0, 0]);
    }

    #[test]
    fn cells_are_counted_as_they_are_taken() {
        let mut cells = Cells::new(200);
        assert_eq!(cells.take(3, 10, 190), 180);
        assert_eq!(cells.take(3, 0, 64), 10);
        assert_eq!(cells.take(3, 64, 128), 0);
        assert_eq!([cells.count(3, 0, 200), cells.count(3, 189, 200), cells.count(2, 0, 200)], [190, 1, 0]);
        assert_eq!([cells.count(3, 63, 65), cells.count(3, 64, 64), cells.count(3, 128, 129)], [2, 0, 1]);
    }
}
