//! Lines that lie on one another as one line, the choice of those that show most, and the gaps between their ends.

use super::wedge::chord;
use super::{CriticalLine, CriticalParams, Order};
use crate::meshing::doubt::distance;
use crate::scene::Scene;
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::HashMap;

/// Lines nearer than this share of the least length lie on each other.
const SAME: f64 = 1e-2;

/// Lines shorter than this share of the least length are left out: outlines have corners that edges' own shadows leave
/// open. No more than what is one point where meshes are cut, so that nothing left out is a gap.
pub const LEAST_PIECE: f64 = 0.2;

/// Lines of one triangle that are looked at, those that show most: each is held against each. No more than a few seconds of work,
/// and far more than a triangle is cut along; grass on a floor of two triangles has a hundred thousand.
const MOST_JOINED: usize = 8192;

/// Ends of jumps nearer than this share of the least length to another jump meet it.
const MET: f64 = 0.1;

/// Joins lines of one triangle that lie on one straight line and touch, leaves out what is too short or shows too
/// little, closes the gaps that this leaves in jumps, and sorts by surface, triangle and how much each shows.
pub fn chain(mut lines: Vec<CriticalLine>, params: &CriticalParams, scene: &Scene) -> Vec<CriticalLine> {
    lines.retain(|line| line.ends.iter().all(|p| p.is_finite()));
    lines.par_sort_by(order);
    let triangles: Vec<&[CriticalLine]> =
        lines.chunk_by(|a, b| (a.surface, a.triangle) == (b.surface, b.triangle)).collect();
    let mut chained: Vec<CriticalLine> =
        triangles.par_iter().flat_map_iter(|lines| join(lines, SAME * params.length)).collect();
    chained.retain(|line| line.length() >= LEAST_PIECE * params.length);
    if chained.len() > params.lines {
        let mut kept = strongest(&chained, params.lines).into_iter();
        chained.retain(|_| kept.next() == Some(true));
    }
    let surfaces: Vec<&[CriticalLine]> = chained.chunk_by(|a, b| a.surface == b.surface).collect();
    let bridges: Vec<CriticalLine> =
        surfaces.par_iter().flat_map_iter(|lines| bridges(lines, params.length, scene)).collect();
    chained.extend(bridges);
    chained.par_sort_by(order);
    chained
}

/// Makes all jumps but the `most` that show most bends, which cut meshes as well, but whose vertices can go again.
pub fn soften(lines: &mut [CriticalLine], most: usize) {
    let mut jumps: Vec<&mut CriticalLine> = lines.iter_mut().filter(|line| line.order == Order::Jump).collect();
    let kept = strongest(&jumps.iter().map(|line| **line).collect::<Vec<_>>(), most);
    jumps.iter_mut().zip(kept).filter(|(_, kept)| !kept).for_each(|(line, _)| line.order = Order::Bend);
}

/// Which lines are among the `most` that show most.
fn strongest(lines: &[CriticalLine], most: usize) -> Vec<bool> {
    let mut ranks: Vec<(f64, usize)> = lines.iter().map(CriticalLine::rank).zip(0..).collect();
    ranks.par_sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut kept = vec![false; lines.len()];
    ranks.iter().take(most).for_each(|(_, i)| kept[*i] = true);
    kept
}

/// By surface, triangle and how much lines show; bits of places break ties, so that no order of work shows.
fn order(a: &CriticalLine, b: &CriticalLine) -> Ordering {
    let place = |line: &CriticalLine| (line.surface, line.triangle);
    let key = |line: &CriticalLine| line.ends.map(|p| p.to_array().map(f64::to_bits));
    place(a).cmp(&place(b)).then(b.rank().total_cmp(&a.rank())).then_with(|| key(a).cmp(&key(b)))
}

/// Lines that close gaps between jumps of one surface: between ends that meet no other jump and lie nearer to each other than
/// `length`, in one plane. The border of a hard shadow ends nowhere; what is missing is the shadow of an edge that was too
/// short to be looked for, as where the outline of a round table passes from the rim of its top to that of its underside. Light
/// that passes through such a gap is one value for both sides, and shows as a streak.
fn bridges(lines: &[CriticalLine], length: f64, scene: &Scene) -> Vec<CriticalLine> {
    let cell = |p: DVec3| (p / length).floor().to_array().map(|x| x as i64);
    let jumps: Vec<&CriticalLine> = lines.iter().filter(|line| line.order == Order::Jump).collect();
    let ends: Vec<(usize, DVec3)> = jumps.iter().enumerate().flat_map(|(k, line)| line.ends.map(|p| (k, p))).collect();
    let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    ends.iter().enumerate().for_each(|(i, (_, p))| cells.entry(cell(*p)).or_default().push(i));
    let nearest = |i: usize, of: &dyn Fn(usize) -> bool| {
        let (own, p) = ends[i];
        let [x, y, z] = cell(p);
        let offsets = (0..27).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]);
        let around =
            offsets.filter_map(|[a, b, c]| cells.get(&[x.saturating_add(a), y.saturating_add(b), z.saturating_add(c)]));
        let far = |j: usize| ends[j].1.distance(p);
        let found = around.flatten().copied().filter(|j| ends[*j].0 != own && of(*j) && far(*j) < length);
        found.map(|j| (far(j), j)).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    };
    let is_open: Vec<bool> =
        (0..ends.len()).map(|i| nearest(i, &|_| true).is_none_or(|(far, _)| far > MET * length)).collect();
    let nearest_open = |i: usize| nearest(i, &|j| is_open[j]).map(|(_, j)| j);
    let meets_none = |i: usize| {
        let (own, p) = ends[i];
        let others = jumps.iter().enumerate().filter(|(k, line)| *k != own && line.triangle == jumps[own].triangle);
        others.into_iter().all(|(_, line)| distance(line.ends, p) > MET * length)
    };
    let close = |i: usize| {
        let j = nearest_open(i).filter(|j| i < *j && nearest_open(*j) == Some(i))?;
        let (a, b) = (jumps[ends[i].0], jumps[ends[j].0]);
        let contrast = a.contrast.min(b.contrast);
        (meets_none(i) && meets_none(j))
            .then(|| [a, b].map(|line| CriticalLine { ends: [ends[i].1, ends[j].1], contrast, ..*line }))
    };
    let gaps =
        (0..ends.len()).filter_map(close).flat_map(|[a, b]| [Some(a), Some(b).filter(|b| b.triangle != a.triangle)]);
    gaps.flatten().filter_map(|line| clip(line, length, scene)).collect()
}

/// The part of a line that lies on its triangle; none where it leaves the triangle's plane.
fn clip(line: CriticalLine, length: f64, scene: &Scene) -> Option<CriticalLine> {
    let corners = scene.world_triangle(line.surface as usize, line.triangle as usize).map(|p| p.as_dvec3());
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    if line.ends.iter().any(|p| (*p - corners[0]).dot(normal).abs() > SAME * length) {
        return None;
    }
    let way = line.ends[1] - line.ends[0];
    let [low, high] = chord(&corners, line.ends[0], way)?;
    let (low, high) = (low.max(0.0), high.min(1.0));
    (low < high).then(|| CriticalLine { ends: [low, high].map(|u| line.ends[0] + way * u), ..line })
}

/// The lines of one triangle, of which those come first that show most; those that touch along one straight line as one.
fn join(lines: &[CriticalLine], tolerance: f64) -> Vec<CriticalLine> {
    let mut joined: Vec<CriticalLine> = Vec::new();
    for line in lines.iter().take(MOST_JOINED) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Surface, SurfaceOrigin};
    use glam::{Affine3A, Vec3};

    fn line([from, to]: [[f64; 2]; 2], contrast: f64) -> CriticalLine {
        let ends = [from, to].map(|[x, z]| DVec3::new(x, 0.0, z));
        CriticalLine { surface: 0, triangle: 0, ends, order: Order::Jump, contrast, width: 0.0 }
    }

    /// A triangle in the plane y = 0 that holds all lines of gaps.
    fn plane() -> Scene {
        let positions = [[-9., 0., -9.], [0., 0., 9.], [9., 0., -9.]].map(Vec3::from_array).to_vec();
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let surface = Surface {
            name: "plane".into(),
            mesh: 0,
            world_from_local: Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
            role: Default::default(),
        };
        Scene { meshes: vec![mesh], surfaces: vec![surface], ..Scene::default() }
    }

    fn chain(lines: Vec<CriticalLine>, params: &CriticalParams) -> Vec<CriticalLine> {
        super::chain(lines, params, &plane())
    }

    fn params() -> CriticalParams {
        CriticalParams { length: 0.1, lines: usize::MAX, ..CriticalParams::of_density(10.0) }
    }

    #[test]
    fn of_very_many_lines_on_a_triangle_those_stay_that_show_most() {
        let blade = |k: usize| {
            let [x, z] = [(k % 300) as f64, (k / 300) as f64];
            line([[x, z], [x + 0.2, z + 0.1]], 1.0 + (k * 7919 % 60_000) as f64)
        };
        let chained = chain((0..60_000).map(blade).collect(), &params());
        assert_eq!(chained.len(), MOST_JOINED);
        let least = chained.iter().map(|l| l.contrast).fold(f64::MAX, f64::min);
        assert_eq!(least, 60_000.0 - MOST_JOINED as f64 + 1.0);
    }

    #[test]
    fn gaps_are_closed_between_free_ends_alone() {
        let corner = [line([[0.0, 0.0], [1.0, 0.0]], 3.0), line([[1.05, 0.02], [2.0, 1.0]], 2.0)];
        let closed = chain(corner.to_vec(), &params());
        assert_eq!(closed.len(), 3);
        let bridge = closed.iter().find(|line| line.ends[0].x == 1.0).unwrap();
        assert!(bridge.ends[1].distance(DVec3::new(1.05, 0.0, 0.02)) < 1e-12, "{bridge:#?}");
        // A third line that one of the ends lies on, ends that are too far apart, and what is no jump.
        let wall = line([[1.0, -1.0], [1.0, 1.0]], 9.0);
        assert_eq!(chain([&corner[..], &[wall]].concat(), &params()).len(), 3);
        assert_eq!(chain(vec![corner[0], line([[1.2, 0.0], [2.0, 1.0]], 2.0)], &params()).len(), 2);
        assert_eq!(chain(vec![corner[0], CriticalLine { order: Order::Bend, ..corner[1] }], &params()).len(), 2);
    }
}
