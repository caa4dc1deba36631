//! Critical lines on one triangle: clipped, brought to its sides and corners, and thinned out where they run beside
//! each other.

use super::Face;
use crate::meshing::critical::{CriticalLine, Order};
use glam::DVec2;

/// The most lines of one triangle.
const MOST: usize = 1500;
/// Lines that stay within the tolerance of each other for more than so many tolerances, as those that cross at less
/// than 30 degrees do, run beside each other.
const BESIDE: f64 = 4.0;

/// Points within this share of the tolerance of a line lie on it.
pub const ON_LINE: f64 = 0.7;
/// How near others lines begin that ran beside them, less than [`ON_LINE`].
const JOINED: f64 = 0.6;

/// The lines of a triangle.
pub struct Drawing {
    pub triangle: usize,
    pub strokes: Vec<Stroke>,
    /// Parts of sides along which light jumps: the side, and where, as parts of the way along it.
    pub jumps: Vec<(usize, [f64; 2])>,
    /// Where lines end on sides.
    pub touches: Vec<(usize, f64)>,
}

/// A straight line from one place to another.
#[derive(Clone, Copy)]
pub struct Stroke {
    pub ends: [Spot; 2],
    pub jumps: bool,
}

/// A place in a triangle.
#[derive(Clone, Copy)]
pub enum Spot {
    Corner(usize),
    /// On side `k`, from corner `k` to the next, the part of the way along it.
    Side(usize, f64),
    /// In its plane [m].
    Inside(DVec2),
}

/// Draws lines on a triangle, those first that show most; `None` where nothing is left of them.
pub fn draw(face: &Face, lines: &[&CriticalLine], tolerance: f64) -> Option<Drawing> {
    let mut drawing = Drawing { triangle: face.triangle, strokes: Vec::new(), jumps: Vec::new(), touches: Vec::new() };
    // Nothing fits between sides that are nearer.
    if face.least_height() < 2.0 * tolerance {
        return None;
    }
    let mut taken: Vec<[DVec2; 2]> = (0..3).map(|k| face.side(k)).collect();
    for line in lines {
        if drawing.strokes.len() >= MOST {
            break;
        }
        let jumps = line.order == Order::Jump;
        let Some(ends) = clip(face, line.ends.map(|p| face.flat(p))) else { continue };
        let spots = ends.map(|p| settle(face, p, ends[1] - ends[0], tolerance));
        if let Some((k, [from, to])) = along_side(spots) {
            if jumps && from != to {
                drawing.jumps.push((k, [from.min(to), from.max(to)]));
                drawing.touches.extend([(k, from), (k, to)]);
            }
            continue;
        }
        let settled = spots.map(|s| s.place(face));
        for part in apart(settled, &taken, tolerance) {
            let spot = |end: usize| match part[end] {
                0.0 => spots[0],
                1.0 => spots[1],
                u => Spot::Inside(settled[0].lerp(settled[1], u)),
            };
            let stroke = Stroke { ends: [spot(0), spot(1)], jumps };
            let places = stroke.ends.map(|s| s.place(face));
            if places[0].distance(places[1]) < tolerance {
                continue;
            }
            taken.push(places);
            drawing.touches.extend(stroke.ends.iter().filter_map(|end| match end {
                Spot::Side(k, t) => Some((*k, *t)),
                _ => None,
            }));
            drawing.strokes.push(stroke);
        }
    }
    (!drawing.strokes.is_empty() || !drawing.jumps.is_empty()).then_some(drawing)
}

impl Spot {
    pub fn place(self, face: &Face) -> DVec2 {
        match self {
            Self::Corner(k) => face.corners[k],
            Self::Side(k, t) => face.corners[k].lerp(face.corners[(k + 1) % 3], t),
            Self::Inside(p) => p,
        }
    }
}

/// The part of a line inside a triangle.
fn clip(face: &Face, [a, b]: [DVec2; 2]) -> Option<[DVec2; 2]> {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let (from, to) = (face.depth(k, a), face.depth(k, b));
        // Rounding is no way out.
        let out = -1e-9 * face.twice_area().sqrt();
        match (from < out, to < out) {
            (true, true) => return None,
            (true, false) => low = low.max(from / (from - to)),
            (false, true) => high = high.min(from / (from - to)),
            (false, false) => {}
        }
    }
    (low < high).then(|| [a.lerp(b, low), a.lerp(b, high)])
}

/// The end `p` of a line of direction `way`, at a corner or side where one is near.
fn settle(face: &Face, p: DVec2, way: DVec2, tolerance: f64) -> Spot {
    if let Some(k) = (0..3).find(|k| face.corners[*k].distance(p) < tolerance) {
        return Spot::Corner(k);
    }
    let nearest = (0..3).min_by(|a, b| face.depth(*a, p).total_cmp(&face.depth(*b, p))).unwrap_or(0);
    let depth = face.depth(nearest, p);
    if depth >= tolerance {
        return Spot::Inside(p);
    }
    let [a, b] = face.side(nearest);
    let along = (b - a).normalize();
    // On along the line where that isn't far, so that it goes on straight.
    let slope = along.perp_dot(way.normalize_or_zero());
    let on = if slope.abs() > 0.3 { p - way.normalize_or_zero() * (depth / slope) } else { p };
    let t = (on - a).dot(along) / a.distance(b);
    let near = tolerance / a.distance(b);
    match t {
        t if t < near => Spot::Corner(nearest),
        t if t > 1.0 - near => Spot::Corner((nearest + 1) % 3),
        t => Spot::Side(nearest, t),
    }
}

/// The side that both ends lie on, and where.
fn along_side(spots: [Spot; 2]) -> Option<(usize, [f64; 2])> {
    let on = |spot: Spot, k: usize| match spot {
        Spot::Corner(c) if c == k => Some(0.0),
        Spot::Corner(c) if c == (k + 1) % 3 => Some(1.0),
        Spot::Side(s, t) if s == k => Some(t),
        _ => None,
    };
    (0..3).find_map(|k| Some((k, [on(spots[0], k)?, on(spots[1], k)?])))
}

/// The parts of a line, as intervals of 0..=1, that don't run beside any of `taken`.
fn apart(line: [DVec2; 2], taken: &[[DVec2; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    let length = line[0].distance(line[1]);
    let mut parts = vec![[0.0, 1.0]];
    for other in taken {
        let Some([from, to]) = near(line, *other, tolerance) else { continue };
        if (to - from) * length <= BESIDE * tolerance {
            continue;
        }
        // What goes on begins so near that it is joined to the other.
        let [from, to] = near(line, *other, JOINED * tolerance).unwrap_or([from, to]);
        let cut = |[low, high]: [f64; 2]| {
            let kept = [[low, high.min(from)], [low.max(to), high]];
            kept.into_iter().filter(|[low, high]| (high - low) * length > tolerance)
        };
        parts = parts.into_iter().flat_map(cut).collect();
        if parts.is_empty() {
            break;
        }
    }
    parts
}

/// Where a line lies within the tolerance of another: one interval of its 0..=1, as what is near a segment is convex.
fn near([a, b]: [DVec2; 2], [p, q]: [DVec2; 2], tolerance: f64) -> Option<[f64; 2]> {
    let (way, along) = (b - a, (q - p).normalize_or_zero());
    let length = p.distance(q);
    let mut found: Option<[f64; 2]> = None;
    let mut add = |low: f64, high: f64| {
        let (low, high) = (low.max(0.0), high.min(1.0));
        if low < high {
            found = Some(found.map_or([low, high], |[l, h]| [l.min(low), h.max(high)]));
        }
    };
    // Between the ends of the other: a band, and within it a stretch.
    let (height, climb) = (along.perp_dot(a - p), along.perp_dot(way));
    let (place, pace) = ((a - p).dot(along), way.dot(along));
    let band = within(height, climb, -tolerance, tolerance);
    let stretch = within(place, pace, 0.0, length);
    if let (Some(band), Some(stretch)) = (band, stretch) {
        add(band[0].max(stretch[0]), band[1].min(stretch[1]));
    }
    // And around each end.
    for end in [p, q] {
        let (c, square) = (end - a, way.length_squared());
        let middle = c.dot(way) / square;
        let rest = tolerance * tolerance - (c - way * middle).length_squared();
        if rest > 0.0 {
            let half = (rest / square).sqrt();
            add(middle - half, middle + half);
        }
    }
    found
}

/// Where `start + slope u` is between two bounds.
fn within(start: f64, slope: f64, low: f64, high: f64) -> Option<[f64; 2]> {
    if slope == 0.0 {
        return (low <= start && start <= high).then_some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let (a, b) = ((low - start) / slope, (high - start) / slope);
    Some([a.min(b), a.max(b)])
}
