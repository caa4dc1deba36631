//! Clipping triangles to texel squares, in texel coordinates and f64, so that areas add up.

use glam::DVec2;

/// A triangle clipped by four half planes has at most seven corners.
const MOST: usize = 8;

/// A small convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Convex {
    corners: [DVec2; MOST],
    count: usize,
}

impl Convex {
    pub fn triangle(corners: [DVec2; 3]) -> Self {
        let mut all = [DVec2::ZERO; MOST];
        all[..3].copy_from_slice(&corners);
        Self { corners: all, count: 3 }
    }

    pub fn corners(&self) -> &[DVec2] {
        &self.corners[..self.count]
    }

    /// Keeps the part where `sign * (coordinate[axis] - limit) >= 0` (Sutherland, Hodgman 1974).
    fn clip(&self, axis: usize, limit: f64, sign: f64) -> Self {
        let mut out = Self { corners: [DVec2::ZERO; MOST], count: 0 };
        let side = |p: DVec2| sign * (p[axis] - limit);
        for (i, &p) in self.corners().iter().enumerate() {
            let q = self.corners[if i + 1 < self.count { i + 1 } else { 0 }];
            let (sp, sq) = (side(p), side(q));
            if sp >= 0.0 {
                out.push(p);
            }
            if (sp > 0.0 && sq < 0.0) || (sp < 0.0 && sq > 0.0) {
                let mut cut = p + (q - p) * (sp / (sp - sq));
                cut[axis] = limit;
                out.push(cut);
            }
        }
        out
    }

    fn push(&mut self, p: DVec2) {
        debug_assert!(self.count < MOST);
        if self.count < MOST {
            self.corners[self.count] = p;
            self.count += 1;
        }
    }

    /// The part with `low <= coordinate[axis] <= low + 1`.
    pub fn band(&self, axis: usize, low: f64) -> Self {
        self.between(axis, low, low + 1.0)
    }

    /// The part with `low <= coordinate[axis] <= high`.
    pub fn between(&self, axis: usize, low: f64, high: f64) -> Self {
        let (least, most) = self.range(axis);
        let mut part = *self;
        if least < low {
            part = part.clip(axis, low, 1.0);
        }
        if most > high {
            part = part.clip(axis, high, -1.0);
        }
        part
    }

    /// The square of side 1 from `low` on; it turns from +x to +y where `turn`, else the other way round.
    fn square(low: DVec2, turn: bool) -> Self {
        let [second, last] = if turn { [DVec2::X, DVec2::Y] } else { [DVec2::Y, DVec2::X] };
        let mut corners = [DVec2::ZERO; MOST];
        corners[..4].copy_from_slice(&[low, low + second, low + DVec2::ONE, low + last]);
        Self { corners, count: 4 }
    }

    /// Of a polygon with two corners at the height `y` and two at `y + 1`: the x between which it covers all of that row.
    fn within(&self, y: f64) -> Option<(f64, f64)> {
        let [a, b, c, d] = *self.corners() else { return None };
        let of = |height: f64| {
            let mut at = [a, b, c, d].into_iter().filter(|p| p.y == height).map(|p| p.x);
            match (at.next(), at.next(), at.next()) {
                (Some(p), Some(q), None) => Some((p.min(q), p.max(q))),
                _ => None,
            }
        };
        let (top, bottom) = (of(y)?, of(y + 1.0)?);
        Some((top.0.max(bottom.0), top.1.min(bottom.1)))
    }

    /// Signed area, positive for a turn from +x to +y.
    pub fn area(&self) -> f64 {
        let Some((&o, rest)) = self.corners().split_first() else { return 0.0 };
        0.5 * rest.windows(2).map(|w| (w[0] - o).perp_dot(w[1] - o)).sum::<f64>()
    }

    pub fn centroid(&self) -> DVec2 {
        let Some((&o, rest)) = self.corners().split_first() else { return DVec2::ZERO };
        let (mut sum, mut area) = (DVec2::ZERO, 0.0);
        for w in rest.windows(2) {
            let a = (w[0] - o).perp_dot(w[1] - o);
            sum += (o + w[0] + w[1]) / 3.0 * a;
            area += a;
        }
        if area == 0.0 { o } else { sum / area }
    }

    /// Smallest and largest coordinate along `axis`.
    pub fn range(&self, axis: usize) -> (f64, f64) {
        self.corners().iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[axis]), h.max(p[axis])))
    }
}

/// Texels of a page: columns and rows, each from the first to the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub low: [u32; 2],
    pub last: [u32; 2],
}

impl Window {
    /// All of a page of `size` texels.
    pub fn page(size: [u32; 2]) -> Self {
        Self { low: [0; 2], last: size.map(|n| n - 1) }
    }

    /// The first and the last column (`axis` 0) or row (1) of those that the range from `low` to `high` [texels] reaches into.
    pub fn cells(&self, axis: usize, (low, high): (f64, f64)) -> (u32, u32) {
        let [first, last] = [self.low[axis], self.last[axis]].map(f64::from);
        (low.floor().clamp(first, last) as u32, (high.ceil() - 1.0).clamp(first, last) as u32)
    }
}

/// Calls `visit(x, y, part)` for each texel square of `window` that the triangle overlaps, with the part in it, row by row.
pub(super) fn for_each_texel(triangle: [DVec2; 3], window: Window, mut visit: impl FnMut(u32, u32, &Convex)) {
    let whole = Convex::triangle(triangle);
    let turn = whole.area() > 0.0;
    let (top, bottom) = window.cells(1, whole.range(1));
    for y in top..=bottom {
        let row = whole.band(1, f64::from(y));
        if row.corners().len() < 3 {
            continue;
        }
        let (left, right) = window.cells(0, row.range(0));
        let within = row.within(f64::from(y));
        for x in left..=right {
            let low = DVec2::new(f64::from(x), f64::from(y));
            // Most texels of large triangles lie inside: the same corners without clipping.
            let is_inside = within.is_some_and(|(first, last)| first < low.x && low.x + 1.0 < last);
            let part = if is_inside { Convex::square(low, turn) } else { row.band(0, low.x) };
            if part.corners().len() >= 3 {
                visit(x, y, &part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_triangle_add_up_to_it() {
        let triangle = [DVec2::new(0.3, 0.2), DVec2::new(9.7, 3.1), DVec2::new(4.4, 8.8)];
        let mut sum = 0.0;
        for_each_texel(triangle, Window::page([16, 16]), |x, y, part| {
            let c = part.centroid();
            assert!(c.x >= f64::from(x) && c.x <= f64::from(x + 1) && c.y >= f64::from(y) && c.y <= f64::from(y + 1));
            sum += part.area();
        });
        assert!((sum - Convex::triangle(triangle).area()).abs() < 1e-12);
    }

    #[test]
    fn whole_texels_have_the_numbers_that_clipping_gives() {
        for triangle in [
            [DVec2::new(0.3, 0.2), DVec2::new(29.7, 3.1), DVec2::new(4.4, 28.8)],
            [DVec2::new(0.0, 30.0), DVec2::new(30.0, 30.0), DVec2::new(0.0, 0.0)],
            [DVec2::new(0.3, 0.2), DVec2::new(4.4, 28.8), DVec2::new(29.7, 3.1)],
        ] {
            let mut whole = 0;
            for_each_texel(triangle, Window::page([32, 32]), |x, y, part| {
                let clipped = Convex::triangle(triangle).band(1, f64::from(y)).band(0, f64::from(x));
                assert_eq!([part.area(), part.centroid().x, part.centroid().y], {
                    [clipped.area(), clipped.centroid().x, clipped.centroid().y]
                });
                whole += usize::from(part.area().abs() == 1.0);
            });
            assert!(whole > 200, "{whole}");
        }
    }

    #[test]
    fn windows_show_the_same_parts_as_the_page() {
        let triangle = [DVec2::new(0.3, 0.2), DVec2::new(15.7, 3.1), DVec2::new(4.4, 15.8)];
        let parts = |window: Window| {
            let mut parts = Vec::new();
            for_each_texel(triangle, window, |x, y, part| parts.push((y, x, part.area(), part.centroid().to_array())));
            parts.retain(|p| p.2.abs() > 1e-9);
            parts
        };
        let mut tiled = Vec::new();
        for (x, y) in [(0, 0), (8, 0), (0, 8), (8, 8)] {
            tiled.extend(parts(Window { low: [x, y], last: [x + 7, y + 7] }));
        }
        tiled.sort_by_key(|p| (p.0, p.1));
        assert_eq!(tiled, parts(Window::page([16, 16])));
    }
}
