//! The way of a ray through the tree, nearest boxes first. This is the portable path; `avx2` and `avx512` do the same.
//!
//! Boxes must never lose a triangle that the watertight test would take, although both round (Ize 2013, "Robust BVH Ray
//! Traversal"). So the near planes of all boxes are moved towards the ray's origin and the far ones away from it, by more than
//! the rounding of either test: that costs nothing, as it is the same as another origin for each.

use super::watertight::{Crossing, Shear};
use super::wide::{Block, Child, Node, WIDTH, Wide};
use glam::Vec3;

/// What a ray needs on its way.
pub(super) struct Line {
    pub shear: Shear,
    /// Per axis, the origin that near and far planes are measured from, and 1 / direction.
    pub near: [f32; 3],
    pub far: [f32; 3],
    pub inverse: [f32; 3],
    /// Per axis, whether the ray runs against it: the side of a box that is met first.
    pub negative: [usize; 3],
}

/// The nearest triangle so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// Distance as it counts [m], or how far to look at all.
    pub t: f32,
    pub number: u32,
    pub block: usize,
    pub lane: usize,
}

/// What all rays of a batch share.
pub(super) struct Batch<'a> {
    pub wide: &'a Wide,
    /// Number of rays.
    pub count: usize,
    /// Distance by which backs count as farther, but for any hit [m].
    pub offset: f32,
    /// The scene's largest coordinate [m].
    pub largest: f32,
}

/// How far planes of boxes are moved, relative to the largest coordinate of the scene and of the ray's origin. A crossing's
/// place is off by at most 3 EPSILON of its distance from the origin, along an axis, and a plane's distance by 2.
const SLACK: f32 = 8.0 * f32::EPSILON;

/// Least component of a direction, so that distances to planes are finite: the way that it adds is far below [`SLACK`].
const LEAST: f32 = 1e-18;

impl Line {
    /// `largest` is the scene's largest coordinate.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3, largest: f32) -> Self {
        let slack = Vec3::splat(SLACK * (largest + origin.abs().max_element()));
        let inverse = direction.abs().max(Vec3::splat(LEAST)).recip().copysign(direction);
        let towards = slack.copysign(direction);
        Self {
            shear: Shear::new(origin, direction),
            near: (origin + towards).to_array(),
            far: (origin - towards).to_array(),
            inverse: inverse.to_array(),
            negative: [inverse.x, inverse.y, inverse.z].map(|i| usize::from(i < 0.0)),
        }
    }
}

impl Batch<'_> {
    /// Hands `answer` what `walk` finds for each ray that `query` gives: origin, direction and how far to look.
    #[inline(always)]
    pub fn each(
        &self,
        mut query: impl FnMut(usize) -> (Vec3, Vec3, f32),
        mut answer: impl FnMut(usize, &Line, Nearest),
        walk: impl Fn(&Line, f32, &mut [u64]) -> Nearest,
    ) {
        let mut stack = stack(self.wide);
        for i in 0..self.count {
            let (origin, direction, limit) = query(i);
            let line = Line::new(origin, direction, self.largest);
            let nearest = if limit > 0.0 { walk(&line, limit, &mut stack) } else { Nearest::none(limit) };
            answer(i, &line, nearest);
        }
    }
}

/// Subtrees yet to visit: all but one child of each level's node, and what SIMD writes beyond the last.
pub(super) fn stack(wide: &Wide) -> Vec<u64> {
    vec![0; WIDTH * (wide.depth + 1)]
}

/// Puts a subtree on the stack, farthest first from `first` on.
#[inline(always)]
pub(super) fn push(stack: &mut [u64], first: usize, top: &mut usize, near: f32, child: Child) {
    let key = u64::from(near.to_bits()) << 32 | u64::from(child.0);
    let mut place = *top;
    while place > first && stack[place - 1] < key {
        stack[place] = stack[place - 1];
        place -= 1;
    }
    stack[place] = key;
    *top += 1;
}

impl Nearest {
    pub fn none(limit: f32) -> Self {
        Self { t: limit, number: u32::MAX, block: 0, lane: 0 }
    }

    pub fn is_some(&self) -> bool {
        self.number != u32::MAX
    }

    /// Takes a crossing at distance `t`, as it counts, if it is nearer, of equally near ones that of the lowest number, whatever the
    /// tree's order.
    #[inline(always)]
    pub fn take<const ANY: bool>(&mut self, t: f32, block: &Block, index: usize, lane: usize) -> bool {
        let number = block.numbers[lane];
        let nearer = t < self.t || (!ANY && t == self.t && number < self.number);
        if nearer {
            *self = Self { t, number, block: index, lane };
        }
        nearer
    }

    /// Tests one triangle of a block.
    #[inline(always)]
    pub fn test<const ANY: bool>(
        &mut self,
        line: &Line,
        block: &Block,
        index: usize,
        lane: usize,
        offset: f32,
    ) -> bool {
        let Some(Crossing { t, front, .. }) = line.shear.intersect(&block.triangle(lane)) else { return false };
        self.take::<ANY>(if front || ANY { t } else { t + offset }, block, index, lane)
    }
}

/// The nearest triangle within `limit`, or, for any hit, one of them. Backs count as farther by `offset` [m], but for any hit.
pub(super) fn walk<const ANY: bool>(wide: &Wide, line: &Line, offset: f32, limit: f32, stack: &mut [u64]) -> Nearest {
    let mut best = Nearest::none(limit);
    let mut top = 1;
    stack[0] = 0;
    while top > 0 {
        top -= 1;
        let (near, child) = (f32::from_bits((stack[top] >> 32) as u32), Child(stack[top] as u32));
        if near > best.t {
            continue;
        }
        if child.is_block() {
            let block = &wide.blocks[child.index()];
            for lane in 0..WIDTH {
                if best.test::<ANY>(line, block, child.index(), lane, offset) && ANY {
                    return best;
                }
            }
            continue;
        }
        let node = &wide.nodes[child.index()];
        let first = top;
        for lane in 0..WIDTH {
            if let Some(near) = enter(node, lane, line, best.t) {
                push(stack, first, &mut top, near, node.children[lane]);
            }
        }
    }
    best
}

/// Where the ray enters the box of a child, if it does before `limit`.
fn enter(node: &Node, lane: usize, line: &Line, limit: f32) -> Option<f32> {
    let (mut near, mut far) = (0.0f32, limit);
    for axis in 0..3 {
        let side = line.negative[axis];
        let sides = &node.bounds[axis];
        near = near.max((sides[side][lane] - line.near[axis]) * line.inverse[axis]);
        far = far.min((sides[1 - side][lane] - line.far[axis]) * line.inverse[axis]);
    }
    (near <= far).then_some(near)
}

/// Calls `visit` for every triangle that the ray crosses, in no order, but for some of those beyond `limit` [m]; `stack` is one of
/// [`stack`].
pub(super) fn crossings(wide: &Wide, line: &Line, limit: f32, stack: &mut [u64], mut visit: impl FnMut(u32, Crossing)) {
    stack[0] = 0;
    let mut top = 1;
    while top > 0 {
        top -= 1;
        let child = Child(stack[top] as u32);
        if child.is_block() {
            let block = &wide.blocks[child.index()];
            for lane in 0..WIDTH {
                if let Some(crossing) = line.shear.intersect(&block.triangle(lane)) {
                    visit(block.numbers[lane], crossing);
                }
            }
            continue;
        }
        let node = &wide.nodes[child.index()];
        for lane in 0..WIDTH {
            if enter(node, lane, line, limit).is_some() {
                stack[top] = u64::from(node.children[lane].0);
                top += 1;
            }
        }
    }
}
