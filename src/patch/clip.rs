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

/// Calls `visit(x, y, part)` for each texel square that the triangle overlaps, with the part in it, row by row.
pub(super) fn for_each_texel(triangle: [DVec2; 3], size: [u32; 2], mut visit: impl FnMut(u32, u32, &Convex)) {
    let whole = Convex::triangle(triangle);
    let cells = |(low, high): (f64, f64), n: u32| {
        let last = f64::from(n) - 1.0;
        (low.floor().clamp(0.0, last) as u32, (high.ceil() - 1.0).clamp(0.0, last) as u32)
    };
    let (top, bottom) = cells(whole.range(1), size[1]);
    for y in top..=bottom {
        let row = whole.band(1, f64::from(y));
        if row.corners().len() < 3 {
            continue;
        }
        let (left, right) = cells(row.range(0), size[0]);
        for x in left..=right {
            let part = row.band(0, f64::from(x));
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
        for_each_texel(triangle, [16, 16], |x, y, part| {
            let c = part.centroid();
            assert!(c.x >= f64::from(x) && c.x <= f64::from(x + 1) && c.y >= f64::from(y) && c.y <= f64::from(y + 1));
            sum += part.area();
        });
        assert!((sum - Convex::triangle(triangle).area()).abs() < 1e-12);
    }
}
