//! Contacts: where triangles touch or cut others, so that light jumps.

use super::wedge::chord;
use super::{CriticalLine, Order, Stage};
use glam::DVec3;
use rayon::prelude::*;

/// Triangles in the leaves of the tree.
const LEAF: usize = 4;

/// The lines along which triangles that block stand on, or cut through, the front of receivers; `light` is the scene's
/// mean [lx].
pub fn contacts(stage: &Stage, light: f64) -> Vec<CriticalLine> {
    let occluders = stage.occluders;
    let blocks = |t: &u32| occluders.blocks[*t as usize];
    let mut order: Vec<u32> = (0..occluders.corners.len() as u32).filter(blocks).collect();
    if order.is_empty() {
        return Vec::new();
    }
    let boxes: Vec<Bounds> = occluders.corners.par_iter().map(|t| Bounds::of(t).grown(stage.params.contact)).collect();
    let mut tree = Vec::new();
    build(&mut tree, &boxes, &mut order, 0);
    let of_receiver = |receiver: u32| {
        let (surface, triangle) = stage.tracer.place(receiver);
        let mut lines = Vec::new();
        if stage.scene.surfaces[surface].role.receives && occluders.blocks[receiver as usize] {
            let corners = &occluders.corners[receiver as usize];
            let longest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
            if longest >= stage.params.length {
                visit(&tree, &order, &boxes, &boxes[receiver as usize], &mut |other| {
                    if let Some(ends) = meet(stage, receiver, other) {
                        lines.push(CriticalLine {
                            surface: surface as u32,
                            triangle: triangle as u32,
                            ends,
                            order: Order::Jump,
                            contrast: light,
                            width: 0.0,
                        });
                    }
                });
            }
        }
        lines
    };
    (0..occluders.corners.len() as u32).into_par_iter().flat_map_iter(of_receiver).collect()
}

/// Where triangle `other` stands on triangle `receiver` or cuts it, of what lies before its front.
fn meet(stage: &Stage, receiver: u32, other: u32) -> Option<[DVec3; 2]> {
    let occluders = stage.occluders;
    let (r, o) = (receiver as usize, other as usize);
    if r == o || occluders.places[r].iter().any(|p| occluders.places[o].contains(p)) {
        return None;
    }
    let corners = &occluders.corners[r];
    let [a, b, c] = *corners;
    let normal = (b - a).cross(c - a).try_normalize()?;
    let touching = stage.params.contact;
    let p = occluders.corners[o];
    let height = p.map(|p| normal.dot(p - a)).map(|h| if h.abs() <= touching { 0.0 } else { h });
    // What is not before the receiver's front hides nothing from it.
    if height.iter().all(|h| *h <= 0.0) {
        return None;
    }
    let on_plane = |k: usize| p[k] - normal * normal.dot(p[k] - a);
    let mut ends: Vec<DVec3> = (0..3).filter(|k| height[*k] == 0.0).map(on_plane).collect();
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        if height[i] * height[j] < 0.0 {
            ends.push(p[i].lerp(p[j], height[i] / (height[i] - height[j])));
        }
    }
    let &[from, to] = ends.as_slice() else { return None };
    let way = to - from;
    if way.length_squared() <= touching * touching {
        return None;
    }
    let [low, high] = chord(corners, from, way)?;
    let (low, high) = (low.max(0.0), high.min(1.0));
    let ends = [from + way * low, from + way * high];
    (low < high && !is_along_crease(stage, r, ends)).then_some(ends)
}

/// True where a line lies along a side of a triangle at which its surface bends or ends: there is nothing to cut.
fn is_along_crease(stage: &Stage, triangle: usize, ends: [DVec3; 2]) -> bool {
    let (places, corners) = (stage.occluders.places[triangle], stage.occluders.corners[triangle]);
    (0..3).any(|k| {
        let (p, q) = (corners[k], corners[(k + 1) % 3]);
        let along = (q - p).normalize_or_zero();
        let side = [places[k].min(places[(k + 1) % 3]), places[k].max(places[(k + 1) % 3])];
        ends.iter().all(|e| (*e - p).reject_from(along).length() <= stage.params.contact)
            && stage.occluders.edges_at(side[0]).any(|edge| edge.ends == side)
    })
}

/// A box along the axes.
#[derive(Clone, Copy)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    fn of([a, b, c]: &[DVec3; 3]) -> Self {
        Self { low: a.min(*b).min(*c), high: a.max(*b).max(*c) }
    }

    fn grown(self, by: f64) -> Self {
        Self { low: self.low - by, high: self.high + by }
    }

    fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

/// A node of a tree of boxes in the order of a depth-first walk.
struct Node {
    bounds: Bounds,
    /// The node after all those below this one.
    next: u32,
    /// The triangles below, of a leaf.
    leaf: Option<[u32; 2]>,
}

/// Builds the tree over `order`, whose first is number `first` of all, by halves along the longest side.
fn build(tree: &mut Vec<Node>, boxes: &[Bounds], order: &mut [u32], first: u32) {
    let all = |order: &[u32]| order.iter().map(|t| boxes[*t as usize]).reduce(Bounds::with);
    let Some(bounds) = all(order) else { return };
    let at = tree.len();
    let count = order.len();
    let is_leaf = count <= LEAF;
    tree.push(Node { bounds, next: 0, leaf: is_leaf.then_some([first, first + count as u32]) });
    if !is_leaf {
        let axis = (bounds.high - bounds.low).max_position();
        let middle = |t: &u32| boxes[*t as usize].low[axis] + boxes[*t as usize].high[axis];
        order.select_nth_unstable_by(count / 2, |a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
        let (low, high) = order.split_at_mut(count / 2);
        build(tree, boxes, low, first);
        build(tree, boxes, high, first + count as u32 / 2);
    }
    tree[at].next = tree.len() as u32;
}

/// Calls `met` for every triangle whose box meets `bounds`.
fn visit(tree: &[Node], order: &[u32], boxes: &[Bounds], bounds: &Bounds, met: &mut dyn FnMut(u32)) {
    let mut at = 0;
    while let Some(node) = tree.get(at) {
        if !node.bounds.meets(bounds) {
            at = node.next as usize;
            continue;
        }
        if let Some([from, to]) = node.leaf {
            order[from as usize..to as usize]
                .iter()
                .filter(|t| boxes[**t as usize].meets(bounds))
                .for_each(|t| met(*t));
        }
        at += 1;
    }
}
