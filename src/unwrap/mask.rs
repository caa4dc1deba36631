//! Bitmaps of charts and pages at texel resolution.

use glam::DVec2;
use std::ops::Range;

/// How far [texels] a triangle may reach into a texel without covering it: more than the rounding of a UV in single precision
/// on the largest page, so that an edge on a texel border covers the same texels before and after rounding.
pub const BORDER: f64 = 1e-3;

/// Up to this many places left in a row are looked at one by one.
const FEW_PLACES: u32 = 64;

/// The texels that a chart touches.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Size [texels].
    pub size: [u32; 2],
    /// The runs of touched texels: row, first column, length; widest first.
    runs: Vec<[u32; 3]>,
    /// Touched texels.
    pub texels: u64,
}

impl Mask {
    /// A mask without holes.
    pub fn full(size: [u32; 2]) -> Self {
        let runs = (0..size[1]).map(|row| [row, 0, size[0]]).collect();
        Self { size, runs, texels: u64::from(size[0]) * u64::from(size[1]) }
    }

    /// The texels that triangles (in texels, within 0..size) overlap at all.
    pub fn of_triangles(size: [u32; 2], triangles: impl Iterator<Item = [DVec2; 3]>) -> Self {
        let words = size[0].div_ceil(64) as usize;
        let mut bits = vec![0u64; words * size[1] as usize];
        for triangle in triangles {
            touched(triangle, size, |row, first, end| {
                set(&mut bits[row as usize * words..][..words], first as usize, end as usize);
            });
        }
        Self::of_bits(size, &bits)
    }

    fn of_bits(size: [u32; 2], bits: &[u64]) -> Self {
        let words = size[0].div_ceil(64) as usize;
        let mut runs = Vec::new();
        for row in 0..size[1] {
            let line = &bits[row as usize * words..][..words];
            let is_set = |x: u32| line[x as usize / 64] >> (x % 64) & 1 == 1;
            let mut x = 0;
            while x < size[0] {
                let first = x;
                while x < size[0] && is_set(x) {
                    x += 1;
                }
                if x > first {
                    runs.push([row, first, x - first]);
                }
                x += u32::from(x == first);
            }
        }
        let texels = runs.iter().map(|r| u64::from(r[2])).sum();
        // The widest runs rule out most places, so they are tried first.
        runs.sort_by_key(|&[row, first, length]| (std::cmp::Reverse(length), row, first));
        Self { size, runs, texels }
    }

    /// Without a hole.
    pub fn is_full(&self) -> bool {
        self.texels == u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Turned by 90 degrees: the texel (x, y) goes to (height - 1 - y, x).
    pub fn turned(&self) -> Self {
        let [w, h] = self.size;
        if self.is_full() {
            return Self::full([h, w]);
        }
        let words = h.div_ceil(64) as usize;
        let mut bits = vec![0u64; words * w as usize];
        for &[row, first, length] in &self.runs {
            let x = h - 1 - row;
            (first..first + length).for_each(|y| bits[y as usize * words + x as usize / 64] |= 1 << (x % 64));
        }
        Self::of_bits([h, w], &bits)
    }
}

/// Calls `span(row, first, end)` for the texels of a grid that a triangle overlaps by more than [`BORDER`]; at least one.
pub fn touched(triangle: [DVec2; 3], size: [u32; 2], span: impl FnMut(u32, u32, u32)) {
    touched_rows(triangle, size, &(0..size[1]), span);
}

/// The same in `rows` alone.
pub fn touched_rows(triangle: [DVec2; 3], size: [u32; 2], rows: &Range<u32>, span: impl FnMut(u32, u32, u32)) {
    scan(triangle, size, rows, BORDER, span);
}

/// The same where a texel that a triangle overlaps by no more than `border` is left out.
pub fn scan(triangle: [DVec2; 3], size: [u32; 2], rows: &Range<u32>, border: f64, mut span: impl FnMut(u32, u32, u32)) {
    let cell = |v: f64, limit: u32| (v.max(0.0) as u32).min(limit - 1);
    let low = triangle.iter().fold(f64::INFINITY, |m, p| m.min(p.y));
    let high = triangle.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.y));
    // Where the triangle is thinner than the borders, its middle decides.
    let inner = |low: f64, high: f64| {
        let (a, b) = (low + border, high - border);
        if a < b { (a, b) } else { (0.5 * (low + high), 0.5 * (low + high)) }
    };
    let (y0, y1) = inner(low, high);
    for row in cell(y0, size[1]).max(rows.start)..(cell(y1, size[1]) + 1).min(rows.end) {
        let (top, bottom) = (f64::from(row).max(low), f64::from(row + 1).min(high));
        let (mut x0, mut x1) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut take = |x: f64| (x0, x1) = (x0.min(x), x1.max(x));
        for k in 0..3 {
            let (p, q) = (triangle[k], triangle[(k + 1) % 3]);
            if (top..=bottom).contains(&p.y) {
                take(p.x);
            }
            for y in [top, bottom] {
                if (p.y < y && y < q.y) || (q.y < y && y < p.y) {
                    take(p.x + (y - p.y) * ((q.x - p.x) / (q.y - p.y)));
                }
            }
        }
        if x0 <= x1 {
            let (x0, x1) = inner(x0, x1);
            span(row, cell(x0, size[0]), cell(x1, size[0]) + 1);
        }
    }
}

/// What lies between charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spacing {
    /// Empty texels between charts.
    pub padding: u32,
    /// Side of the blocks [texels] of which none holds two charts: a power of two up to 64; 1: charts lie anywhere.
    pub align: u32,
    /// Least side of a chart's box [texels], at least 1.
    pub least: u32,
}

impl Spacing {
    /// Texels around a chart that lie in blocks of its own.
    pub fn halo(self) -> u32 {
        self.padding.div_ceil(2)
    }

    /// Empty texels along the edges of a page.
    pub fn margin(self) -> u32 {
        if self.align == 1 { self.padding } else { self.halo() }
    }

    /// What a chart's side of `texels` takes up with its share of the padding.
    pub fn taken(self, texels: u32) -> u32 {
        match self.align {
            1 => texels + self.padding,
            align => (texels + 2 * self.halo()).next_multiple_of(align),
        }
    }
}

/// A page that fills up.
#[derive(Clone, Debug)]
pub struct Page {
    /// Size [texels].
    pub size: [u32; 2],
    spacing: Spacing,
    /// Places of pieces, modulo the alignment.
    phase: u32,
    words: usize,
    /// Texels that are taken or nearer than the padding to one that is.
    rows: Vec<u64>,
    /// The longest run of free texels in each row.
    widest: Vec<u32>,
}

impl Page {
    /// An empty page; charts keep their spacing from each other and `margin` texels from its edges. The first block begins as
    /// far beyond that as the halo is wide.
    pub fn new(size: [u32; 2], spacing: Spacing, margin: u32) -> Self {
        let words = size[0].div_ceil(64) as usize;
        let mut page = Self {
            size,
            spacing,
            phase: margin % spacing.align,
            words,
            rows: vec![0; words * size[1] as usize],
            widest: vec![size[0].saturating_sub(2 * margin); size[1] as usize],
        };
        let bits = words * 64;
        for y in 0..size[1] as usize {
            let line = &mut page.rows[y * words..][..words];
            let inside = y >= margin as usize && y + (margin as usize) < size[1] as usize;
            if inside && 2 * margin < size[0] {
                set(line, 0, margin as usize);
                set(line, (size[0] - margin) as usize, bits);
            } else {
                set(line, 0, bits);
                page.widest[y] = 0;
            }
        }
        page
    }

    /// The topmost, then leftmost free place for a mask at or below row `start` and above row `end`.
    pub fn find(&self, mask: &Mask, start: u32, end: u32) -> Option<[u32; 2]> {
        let [w, h] = mask.size;
        if w > self.size[0] || h > self.size[1] {
            return None;
        }
        let end = end.min(self.size[1] - h + 1);
        let full = mask.is_full();
        let mut blocked = vec![0u64; self.words];
        let mut line = vec![0u64; self.words];
        // Columns at which no piece may begin, the same in each word.
        let align = self.spacing.align;
        let between = (0..64).filter(|x| x % align != self.phase).fold(0u64, |bits, x| bits | 1 << x);
        'rows: for y in (start..end).filter(|y| y % align == self.phase) {
            let fits = |r: &[u32; 3]| self.widest[(y + r[0]) as usize] >= r[2];
            if full {
                // Rows far down first: where those are full, so is all above, mostly.
                if !(0..h).rev().all(|r| fits(&[r, 0, w])) {
                    continue;
                }
            } else if !mask.runs.iter().take(8).all(fits) {
                continue;
            }
            blocked.fill(between);
            // Beyond the last place that keeps the mask within the page.
            set(&mut blocked, (self.size[0] - w) as usize + 1, self.words * 64);
            if full {
                line.fill(0);
                for r in 0..h {
                    or(&mut line, self.row(y + r));
                }
                smear(&mut line, w as usize);
                or(&mut blocked, &line);
            } else {
                for (k, &[row, first, length]) in mask.runs.iter().enumerate() {
                    line.fill(0);
                    or_shifted(&mut line, self.row(y + row), first as usize);
                    smear(&mut line, length as usize);
                    or(&mut blocked, &line);
                    // The widest runs leave few places: those are looked at one by one.
                    if blocked.iter().map(|b| b.count_zeros()).sum::<u32>() <= FEW_PLACES {
                        match self.first_free(&blocked, &mask.runs[k + 1..], y) {
                            Some(x) => return Some([x, y]),
                            None => continue 'rows,
                        }
                    }
                }
            }
            if let Some(word) = blocked.iter().position(|&b| b != u64::MAX) {
                return Some([word as u32 * 64 + blocked[word].trailing_ones(), y]);
            }
        }
        None
    }

    /// The first of the columns that are not `blocked` at which all of `runs` are free, the mask's top being at row `y`.
    fn first_free(&self, blocked: &[u64], runs: &[[u32; 3]], y: u32) -> Option<u32> {
        for (word, &bits) in blocked.iter().enumerate() {
            let mut open = !bits;
            while open != 0 {
                let x = word as u32 * 64 + open.trailing_zeros();
                let is_free = |&[row, first, length]: &[u32; 3]| {
                    is_clear(self.row(y + row), (x + first) as usize, (x + first + length) as usize)
                };
                if runs.iter().all(is_free) {
                    return Some(x);
                }
                open &= open - 1;
            }
        }
        None
    }

    /// True where `mask` fits with its top left texel at a place.
    pub fn is_free(&self, mask: &Mask, [x, y]: [u32; 2]) -> bool {
        let is_within = [x, y].iter().zip(mask.size).zip(self.size).all(|((at, side), size)| {
            at.checked_add(side).is_some_and(|end| end <= size) && at % self.spacing.align == self.phase
        });
        is_within
            && mask.runs.iter().all(|&[row, first, length]| {
                is_clear(self.row(y + row), (x + first) as usize, (x + first + length) as usize)
            })
    }

    /// Takes the texels of `mask` at a place, and those around them that no other chart may touch.
    pub fn take(&mut self, mask: &Mask, [x, y]: [u32; 2]) {
        for &[row, first, length] in &mask.runs {
            let columns = self.kept_free(x + first, x + first + length, self.size[0]);
            for r in self.kept_free(y + row, y + row + 1, self.size[1]) {
                set(&mut self.rows[r * self.words..][..self.words], columns.start, columns.end);
            }
        }
        for r in self.kept_free(y, y + mask.size[1], self.size[1]) {
            self.widest[r] = widest_gap(&self.rows[r * self.words..][..self.words], self.size[0]);
        }
    }

    /// What texels `begin..end` of a chart along an axis keep free of others, on a page of `size` texels: the padding; where
    /// blocks are kept apart, the blocks that the chart's halo touches, and as much again as the halo of another is wide.
    fn kept_free(&self, begin: u32, end: u32, size: u32) -> Range<usize> {
        let Spacing { padding, align, .. } = self.spacing;
        let (mut begin, mut end) = (i64::from(begin), i64::from(end));
        if align == 1 {
            (begin, end) = (begin - i64::from(padding), end + i64::from(padding));
        } else {
            let (halo, align) = (i64::from(self.spacing.halo()), i64::from(align));
            // The first block begins a halo before the first place.
            let origin = i64::from(self.phase) - halo;
            begin = (begin - halo - origin).div_euclid(align) * align + origin - halo;
            end = (end + halo - origin + align - 1).div_euclid(align) * align + origin + halo;
        }
        begin.max(0) as usize..end.min(i64::from(size)) as usize
    }

    fn row(&self, y: u32) -> &[u64] {
        &self.rows[y as usize * self.words..][..self.words]
    }
}

/// True where none of the bits first..end is set.
fn is_clear(line: &[u64], first: usize, end: usize) -> bool {
    let (w0, w1) = (first / 64, (end - 1) / 64);
    let (head, tail) = (u64::MAX << (first % 64), u64::MAX >> (63 - (end - 1) % 64));
    if w0 == w1 {
        return line[w0] & head & tail == 0;
    }
    line[w0] & head == 0 && line[w1] & tail == 0 && line[w0 + 1..w1].iter().all(|&word| word == 0)
}

/// Sets the bits first..end.
fn set(line: &mut [u64], first: usize, end: usize) {
    if first >= end {
        return;
    }
    let (w0, w1) = (first / 64, (end - 1) / 64);
    let (head, tail) = (u64::MAX << (first % 64), u64::MAX >> (63 - (end - 1) % 64));
    if w0 == w1 {
        line[w0] |= head & tail;
    } else {
        line[w0] |= head;
        line[w0 + 1..w1].fill(u64::MAX);
        line[w1] |= tail;
    }
}

fn or(line: &mut [u64], other: &[u64]) {
    line.iter_mut().zip(other).for_each(|(a, b)| *a |= b);
}

/// `line[x] |= other[x + by]`; bits from beyond the end count as set.
fn or_shifted(line: &mut [u64], other: &[u64], by: usize) {
    let (words, bits) = (by / 64, by % 64);
    let inside = line.len().saturating_sub(words);
    line[inside..].fill(u64::MAX);
    let other = &other[line.len() - inside..];
    if bits == 0 {
        or(line, other);
        return;
    }
    // Word by word with the next one, the last with what lies beyond.
    for (out, pair) in line.iter_mut().zip(other.windows(2)) {
        *out |= pair[0] >> bits | pair[1] << (64 - bits);
    }
    if let Some(last) = other.last() {
        line[inside - 1] |= last >> bits | u64::MAX << (64 - bits);
    }
}

/// Sets each bit where any of the `length` bits from it on is set.
fn smear(line: &mut [u64], length: usize) {
    let mut done = 1;
    while done < length {
        let step = done.min(length - done);
        let (words, bits) = (step / 64, step % 64);
        let inside = line.len().saturating_sub(words);
        if bits == 0 {
            (0..inside).for_each(|i| line[i] |= line[i + words]);
        } else {
            // What is read lies ahead of what is written.
            (0..inside.saturating_sub(1))
                .for_each(|i| line[i] |= line[i + words] >> bits | line[i + words + 1] << (64 - bits));
            if inside > 0 {
                line[inside - 1] |= line[inside - 1 + words] >> bits | u64::MAX << (64 - bits);
            }
        }
        line[inside..].fill(u64::MAX);
        done += step;
    }
}

/// The longest run of clear bits among the first `width`.
fn widest_gap(line: &[u64], width: u32) -> u32 {
    let (mut best, mut run) = (0, 0);
    let mut left = width;
    for &word in line {
        let bits = left.min(64);
        left -= bits;
        if word == u64::MAX {
            (best, run) = (best.max(run), 0);
            continue;
        }
        if word == 0 {
            run += bits;
            continue;
        }
        for b in 0..bits {
            if word >> b & 1 == 1 {
                (best, run) = (best.max(run), 0);
            } else {
                run += 1;
            }
        }
    }
    best.max(run)
}
