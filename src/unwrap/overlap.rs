//! Which triangles of a flattened chart lie on top of each other, found by sampling.

use glam::DVec2;

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

/// Sorts groups of triangles (polygons) into layers in which none overlaps another: each goes into the first layer where all
/// of its sample points are free. Usually that is one layer for all.
///
/// `groups` are ranges of `uv`, in the order that they are placed. The grid grows with the number of triangles, 32² to 1024²
/// samples over their bounds, so smaller overlaps go unseen. Returns each group's layer.
pub fn layers(uv: &[[DVec2; 3]], groups: &[std::ops::Range<usize>]) -> Vec<usize> {
    if groups.len() < 2 {
        return vec![0; groups.len()];
    }
    let (low, high) = bounds(uv);
    let side = ((64 * uv.len()) as f64).sqrt().clamp(32.0, 1024.0) as usize;
    let scale = DVec2::splat(side as f64) / (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let mut taken: Vec<Vec<bool>> = vec![vec![false; side * side]];
    let mut layer_of = Vec::with_capacity(groups.len());
    let mut cells = Vec::new();
    for group in groups {
        cells.clear();
        for t in &uv[group.clone()] {
            centers(t.map(|p| (p - low) * scale), side, side, |row, first, end| {
                cells.extend((first..end).map(|x| row * side + x));
            });
        }
        let layer = taken.iter().position(|l| cells.iter().all(|&c| !l[c])).unwrap_or(taken.len());
        if layer == taken.len() {
            taken.push(vec![false; side * side]);
        }
        cells.iter().for_each(|&c| taken[layer][c] = true);
        layer_of.push(layer);
    }
    layer_of
}

/// The least and greatest coordinates.
pub fn bounds(uv: &[[DVec2; 3]]) -> (DVec2, DVec2) {
    uv.iter().flatten().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

#[cfg(test)]
mod tests {
    use super::*;

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
