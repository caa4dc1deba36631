//! A bounding volume hierarchy eight children wide, laid out for SIMD.
//!
//! obvhs joins triangles to a binary tree from below (Meister, Bittner 2018, "Parallel Locally-Ordered Clustering for Bounding
//! Volume Hierarchy Construction") and moves what lies badly (the same, "Parallel Reinsertion for Bounding Volume Hierarchy
//! Optimization"). That is collapsed to the cheapest tree of wide nodes and blocks of triangles, by dynamic programming over the
//! number of subtrees that a subtree is split into: Ylitie, Karras, Laine 2017, "Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs", section 3.1. Our nodes aren't compressed. All on one thread, so the same for any number of them.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Children of a node, and triangles in a block: the lanes of AVX2.
pub(super) const WIDTH: usize = 8;

/// The boxes of up to eight children, by axis, lower and upper side, and child. A child that is absent has an empty box.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    pub children: [Child; WIDTH],
}

/// Up to eight triangles, by corner, axis and triangle: a leaf. Triangles that are absent have corners that no ray hits, NaN.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    pub corners: [[[f32; WIDTH]; 3]; 3],
    /// Number of each triangle over all surfaces.
    pub numbers: [u32; WIDTH],
}

/// The index of a node, or of a block where the highest bit is set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct Child(pub u32);

/// The tree.
#[derive(Debug)]
pub(super) struct Wide {
    /// Parents before children; the first is the root, even over a single block or nothing.
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    /// Levels of nodes.
    pub depth: usize,
}

/// Share of the binary tree's nodes that are moved to where they cost less, in the first of sixteen ever smaller rounds. With half
/// of it the reference atrium's tree costs 0.7 % more, with twice 0.2 % less in nearly twice the time of building.
const REINSERTED: f32 = 0.2;

/// What it costs to test a block, beside a node: it decides how many triangles share one.
const BLOCK_COST: f32 = 1.0;

impl Child {
    pub const ROOT: Self = Self(0);
    const BLOCK: u32 = 1 << 31;

    pub fn is_block(self) -> bool {
        self.0 & Self::BLOCK != 0
    }

    pub fn index(self) -> usize {
        (self.0 & !Self::BLOCK) as usize
    }
}

impl Block {
    #[inline(always)]
    pub fn triangle(&self, lane: usize) -> [[f32; 3]; 3] {
        let [a, b, c] = &self.corners;
        let of = |corner: &[[f32; WIDTH]; 3]| [corner[0][lane], corner[1][lane], corner[2][lane]];
        [of(a), of(b), of(c)]
    }
}

impl Wide {
    /// The tree over triangles given by their corners.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        let tree = binary(triangles);
        let collapse = Collapse::new(&tree, triangles);
        let mut wide = Self { nodes: Vec::new(), blocks: Vec::new(), depth: 0 };
        let children = match tree.nodes.len() {
            0 => vec![],
            _ if collapse.is_block(0) => vec![0],
            _ => collapse.children(0),
        };
        collapse.emit(&children, 1, &mut wide);
        wide
    }
}

/// The binary tree over triangles, one a leaf, parents before children. Those with a corner that is not finite stay out.
fn binary(triangles: &[[[f32; 3]; 3]]) -> Bvh2 {
    let finite = |t: &[[f32; 3]; 3]| t.as_flattened().iter().all(|x| x.is_finite());
    let numbers: Vec<u32> = (0..).zip(triangles).filter(|(_, t)| finite(t)).map(|(n, _)| n).collect();
    let corners = || numbers.iter().map(|&n| triangles[n as usize].map(Vec3A::from_array));
    // The clusters' order along the Morton curve wraps round at the scene's upper bounds: a box whose middle lies there comes
    // first along the axis, not last. Were walls flat, those at either end of a scene would be joined.
    let largest = corners().flatten().fold(0.0f32, |m, p| m.max(p.abs().max_element()));
    let thickness = Vec3A::splat(f32::EPSILON * largest);
    let boxes: Vec<Aabb> =
        corners().map(|[a, b, c]| Aabb::new(a.min(b).min(c) - thickness, a.max(b).max(c) + thickness)).collect();
    // Leaves name boxes by the numbers given here, and primitive_indices says what they stand for: were numbers left out in between,
    // the two would not fit.
    let places = (0..boxes.len() as u32).collect();
    let mut tree = PlocBuilder::new().build(PlocSearchDistance::Low, &boxes, places, SortPrecision::U64, 1);
    ReinsertionOptimizer::default().run(&mut tree, REINSERTED, None);
    tree.reorder_in_stack_traversal_order();
    tree.primitive_indices = numbers;
    tree
}

/// The least costs of the subtrees of a binary tree.
struct Collapse<'a> {
    tree: &'a Bvh2,
    triangles: &'a [[[f32; 3]; 3]],
    /// Triangles below each node.
    count: Vec<usize>,
    /// `cost[n][k - 1]`: the least cost of node n's triangles as at most k subtrees, each a wide node or a block.
    cost: Vec<[f32; WIDTH]>,
}

impl<'a> Collapse<'a> {
    fn new(tree: &'a Bvh2, triangles: &'a [[[f32; 3]; 3]]) -> Self {
        let (count, cost) = (vec![1; tree.nodes.len()], vec![[0.0; WIDTH]; tree.nodes.len()]);
        let mut collapse = Self { tree, triangles, count, cost };
        for i in (0..tree.nodes.len()).rev() {
            let area = collapse.area(i);
            let Some([l, r]) = collapse.halves(i) else {
                collapse.cost[i] = [area * BLOCK_COST; WIDTH];
                continue;
            };
            let [left, right] = [collapse.cost[l], collapse.cost[r]];
            let split = |k: usize| (1..k).map(|j| left[j - 1] + right[k - j - 1]).fold(f32::INFINITY, f32::min);
            let mut least = area + split(WIDTH);
            collapse.count[i] = collapse.count[l] + collapse.count[r];
            if collapse.count[i] <= WIDTH {
                least = least.min(area * BLOCK_COST);
            }
            collapse.cost[i][0] = least;
            for k in 2..=WIDTH {
                least = least.min(split(k));
                collapse.cost[i][k - 1] = least;
            }
        }
        collapse
    }

    /// Half the surface of node `i`'s box.
    fn area(&self, i: usize) -> f32 {
        self.tree.nodes[i].aabb().half_area()
    }

    /// The halves of node `i`; none for a leaf.
    fn halves(&self, i: usize) -> Option<[usize; 2]> {
        let node = &self.tree.nodes[i];
        (!node.is_leaf()).then(|| [node.first_index as usize, node.first_index as usize + 1])
    }

    /// As one subtree, node `i` is a block.
    fn is_block(&self, i: usize) -> bool {
        self.count[i] <= WIDTH && self.cost[i][0] == self.area(i) * BLOCK_COST
    }

    /// The binary nodes that become the children of wide node `i`.
    fn children(&self, i: usize) -> Vec<usize> {
        let mut children = Vec::with_capacity(WIDTH);
        self.split(i, WIDTH, &mut children);
        // Any hit visits the last child first: blocks, the largest one first, which are the likeliest to end the search.
        children.sort_by(|&a, &b| self.is_block(a).cmp(&self.is_block(b)).then(self.area(a).total_cmp(&self.area(b))));
        children
    }

    /// Splits node `i` into `k` subtrees, at the least cost.
    fn split(&self, i: usize, k: usize, out: &mut Vec<usize>) {
        let Some([l, r]) = self.halves(i) else { return out.push(i) };
        let cost = |j: usize| self.cost[l][j - 1] + self.cost[r][k - j - 1];
        let j = (1..k).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).expect("at least two subtrees");
        for (half, mut k) in [(l, j), (r, k - j)] {
            while k > 1 && self.cost[half][k - 2] <= self.cost[half][k - 1] {
                k -= 1;
            }
            if k == 1 { out.push(half) } else { self.split(half, k, out) }
        }
    }

    /// Writes the wide node with these children and all below it.
    fn emit(&self, children: &[usize], depth: usize, wide: &mut Wide) -> Child {
        let index = wide.nodes.len();
        let mut bounds = [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3];
        for (lane, &c) in children.iter().enumerate() {
            let aabb = self.tree.nodes[c].aabb();
            for (axis, [low, high]) in bounds.iter_mut().enumerate() {
                (low[lane], high[lane]) = (aabb.min[axis], aabb.max[axis]);
            }
        }
        wide.nodes.push(Node { bounds, children: [Child::default(); WIDTH] });
        wide.depth = wide.depth.max(depth);
        for (lane, &c) in children.iter().enumerate() {
            let child =
                if self.is_block(c) { self.block(c, wide) } else { self.emit(&self.children(c), depth + 1, wide) };
            wide.nodes[index].children[lane] = child;
        }
        Child(index as u32)
    }

    fn block(&self, i: usize, wide: &mut Wide) -> Child {
        let mut block = Block { corners: [[[f32::NAN; WIDTH]; 3]; 3], numbers: [u32::MAX; WIDTH] };
        let (mut below, mut lane) = (vec![i], 0);
        while let Some(i) = below.pop() {
            if let Some(halves) = self.halves(i) {
                below.extend(halves);
                continue;
            }
            let number = self.tree.primitive_indices[self.tree.nodes[i].first_index as usize];
            for (corner, position) in block.corners.iter_mut().zip(&self.triangles[number as usize]) {
                for (axis, coordinate) in corner.iter_mut().zip(position) {
                    axis[lane] = *coordinate;
                }
            }
            block.numbers[lane] = number;
            lane += 1;
        }
        wide.blocks.push(block);
        Child(Child::BLOCK | (wide.blocks.len() - 1) as u32)
    }
}
