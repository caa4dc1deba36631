//! A binary bounding volume hierarchy by the surface area heuristic.
//!
//! Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies": from the top down, triangles are counted in bins
//! along each axis by the middles of their boxes, and parted between the two bins where the areas of the halves, each times its
//! triangles, add up to least. Leaves hold one triangle; where it pays, a block takes a whole subtree later (`wide`).
//! Cost: n log n; a million triangles take about a second of processor time, the collapse in `wide` included.

use glam::Vec3A;

/// Most bins along an axis.
const BINS: usize = 32;
/// Below as many triangles fewer bins do.
const FEW: usize = 64;
/// From so many triangles on, the halves are built at the same time.
const PARALLEL: usize = 4096;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aabb {
    pub low: Vec3A,
    pub high: Vec3A,
}

/// A triangle's box.
#[derive(Clone, Copy, Debug)]
struct Item {
    aabb: Aabb,
    number: u32,
}

/// A node; its first half comes right behind it, its second after all that is below the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub aabb: Aabb,
    /// Triangles below, and how many of them are in the first half.
    pub count: u32,
    pub first_half: u32,
    /// The triangle, in a leaf.
    pub triangle: u32,
}

impl Aabb {
    const EMPTY: Self = Self { low: Vec3A::INFINITY, high: Vec3A::NEG_INFINITY };

    fn around(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Half its surface, nothing for an empty box.
    pub fn half_area(self) -> f32 {
        let side = (self.high - self.low).max(Vec3A::ZERO);
        side.x * side.y + side.y * side.z + side.z * side.x
    }

    /// Twice its middle.
    fn middle(self) -> Vec3A {
        self.low + self.high
    }
}

impl Node {
    /// The halves of the node at `index`; none for a leaf.
    pub fn halves(&self, index: usize) -> Option<[usize; 2]> {
        (self.count > 1).then(|| [index + 1, index + 2 * self.first_half as usize])
    }
}

/// The nodes over triangles given by their corners, parents before children; none without triangles.
pub(super) fn build(triangles: &[[[f32; 3]; 3]]) -> Vec<Node> {
    let mut items: Vec<Item> = (0..)
        .zip(triangles)
        .map(|(number, corners)| {
            let [a, b, c] = corners.map(Vec3A::from_array);
            Item { aabb: Aabb { low: a.min(b).min(c), high: a.max(b).max(c) }, number }
        })
        .collect();
    let nothing = Node { aabb: Aabb::EMPTY, count: 0, first_half: 0, triangle: 0 };
    let mut nodes = vec![nothing; (2 * items.len()).saturating_sub(1)];
    if !items.is_empty() {
        grow(&mut items, &mut nodes);
    }
    nodes
}

/// Fills `nodes`, twice as many as `items` less one.
fn grow(items: &mut [Item], nodes: &mut [Node]) {
    let count = items.len();
    let (mut aabb, mut middles) = (Aabb::EMPTY, Aabb::EMPTY);
    for item in &*items {
        aabb = aabb.around(item.aabb);
        let middle = item.aabb.middle();
        middles = middles.around(Aabb { low: middle, high: middle });
    }
    let half = match count {
        1 => 0,
        2 => 1,
        _ => part(items, middles),
    };
    nodes[0] = Node { aabb, count: count as u32, first_half: half as u32, triangle: items[0].number };
    if count == 1 {
        return;
    }
    let (first, second) = items.split_at_mut(half);
    let (left, right) = nodes[1..].split_at_mut(2 * half - 1);
    if count < PARALLEL {
        grow(first, left);
        grow(second, right);
    } else {
        rayon::join(|| grow(first, left), || grow(second, right));
    }
}

/// Brings the items of the first half to the front and returns how many they are, some on either side.
fn part(items: &mut [Item], middles: Aabb) -> usize {
    let bins = if items.len() < FEW { BINS / 4 } else { BINS };
    let extent = middles.high - middles.low;
    // What doesn't spread along an axis falls into the first bin.
    let per_bin = Vec3A::select(extent.cmpgt(Vec3A::ZERO), bins as f32 * (1.0 - f32::EPSILON) / extent, Vec3A::ZERO);
    let bin = |item: &Item| {
        ((item.aabb.middle() - middles.low) * per_bin).as_uvec3().min(glam::UVec3::splat(bins as u32 - 1))
    };
    let mut boxes = [[Aabb::EMPTY; BINS]; 3];
    let mut counts = [[0u32; BINS]; 3];
    for item in &*items {
        for (axis, b) in bin(item).to_array().into_iter().enumerate() {
            boxes[axis][b as usize] = boxes[axis][b as usize].around(item.aabb);
            counts[axis][b as usize] += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        let (boxes, counts) = (&boxes[axis], &counts[axis]);
        let mut above = [0.0f32; BINS];
        let (mut aabb, mut count) = (Aabb::EMPTY, 0);
        for b in (1..bins).rev() {
            aabb = aabb.around(boxes[b]);
            count += counts[b];
            above[b] = aabb.half_area() * count as f32;
        }
        let (mut aabb, mut count) = (Aabb::EMPTY, 0);
        for b in 1..bins {
            aabb = aabb.around(boxes[b - 1]);
            count += counts[b - 1];
            let cost = aabb.half_area() * count as f32 + above[b];
            if cost < best.0 && count > 0 && (count as usize) < items.len() {
                best = (cost, axis, b as u32);
            }
        }
    }
    let (cost, axis, border) = best;
    // All middles coincide, or areas leave f32's range: any halves do.
    if cost == f32::INFINITY {
        return items.len() / 2;
    }
    let mut first = 0;
    for i in 0..items.len() {
        if bin(&items[i]).to_array()[axis] < border {
            items.swap(i, first);
            first += 1;
        }
    }
    first
}
