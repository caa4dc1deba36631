//! A tree over elements: clusters of neighbouring elements that face one way, and clusters of those, up to the whole scene.
//!
//! Built from the top by halving: across the longest side of the cluster's box in place and normal together, so that walls part
//! before they are cut. Cost: n log n.

use super::Elements;
use super::cluster::Cluster;
use crate::color::Rgb;
use crate::patch::SurfacePoint;
use glam::Vec3;

/// A unit of difference between normals counts as much as this share of the cluster's diagonal.
const NORMAL_WEIGHT: f32 = 0.5;

/// A cluster of elements.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    pub cluster: Cluster,
    /// Its elements are `order[first..end]`.
    pub first: u32,
    pub end: u32,
    /// How many of them belong to its left child; 0 in a leaf.
    left: u32,
}

/// The tree, parents before their children.
pub struct Tree {
    pub nodes: Vec<Node>,
    /// Elements in the order of leaves.
    pub order: Vec<u32>,
    /// Area of the elements before each in that order, and of all [m^2].
    area_before: Vec<f64>,
}

/// Place and normal of an element.
#[derive(Clone, Copy)]
struct Item {
    element: u32,
    place: [f32; 6],
}

impl Node {
    /// True where it is one element.
    pub fn is_leaf(&self) -> bool {
        self.left == 0
    }

    /// The children of node number `at`.
    pub fn children(&self, at: usize) -> [usize; 2] {
        // The left subtree of m leaves has 2 m - 1 nodes.
        [at + 1, at + 2 * self.left as usize]
    }
}

impl Tree {
    /// The tree over `elements`, of which there is at least one.
    pub fn new(elements: &Elements) -> Self {
        let n = elements.len();
        let item = |e: usize| {
            let Cluster { centre, axis: normal, .. } = elements.cluster[e];
            Item { element: e as u32, place: [centre.x, centre.y, centre.z, normal.x, normal.y, normal.z] }
        };
        let mut items: Vec<Item> = (0..n).map(item).collect();
        let mut lefts = vec![0u32; 2 * n - 1];
        split(&mut items, &mut lefts);
        let order: Vec<u32> = items.iter().map(|i| i.element).collect();
        let mut area_before = vec![0.0f64; n + 1];
        for (k, &e) in order.iter().enumerate() {
            area_before[k + 1] = area_before[k] + f64::from(elements.area[e as usize]);
        }
        let mut tree = Self { nodes: Vec::with_capacity(2 * n - 1), order, area_before };
        tree.place_nodes(&lefts, n);
        let mut boxes = vec![[Vec3::ZERO; 2]; tree.nodes.len()];
        for at in (0..tree.nodes.len()).rev() {
            let node = tree.nodes[at];
            tree.nodes[at] = if node.is_leaf() {
                let cluster = elements.cluster[tree.order[node.first as usize] as usize];
                boxes[at] = [cluster.centre - cluster.radius, cluster.centre + cluster.radius];
                Node { cluster, ..node }
            } else {
                let [l, r] = node.children(at);
                boxes[at] = [boxes[l][0].min(boxes[r][0]), boxes[l][1].max(boxes[r][1])];
                let mut cluster = tree.nodes[l].cluster.joined(&tree.nodes[r].cluster);
                let corner = (boxes[at][1] - cluster.centre).max(cluster.centre - boxes[at][0]);
                cluster.radius = cluster.radius.min(corner.length());
                Node { cluster, ..node }
            };
        }
        tree
    }

    /// Numbers the nodes and tells which elements they hold.
    fn place_nodes(&mut self, lefts: &[u32], n: usize) {
        let mut open = vec![(0u32, n as u32)];
        while let Some((first, end)) = open.pop() {
            let left = lefts[self.nodes.len()];
            // Bounds follow, children before their parents.
            self.nodes.push(Node { cluster: Cluster::new(0.0, Vec3::ZERO, 0.0, Vec3::Z, 0.0), first, end, left });
            if left > 0 {
                open.push((first + left, end));
                open.push((first, first + left));
            }
        }
    }

    /// A point uniform over node `at`, off the surface: `u` chooses the element and one of its kept points.
    pub fn point(&self, elements: &Elements, at: usize, u: [f32; 2]) -> SurfacePoint {
        let node = &self.nodes[at];
        let (first, end) = (node.first as usize, node.end as usize);
        let (low, high) = (self.area_before[first], self.area_before[end]);
        let wanted = low + f64::from(u[0]) * (high - low);
        let k = first + self.area_before[first + 1..end].partition_point(|&a| a <= wanted);
        elements.kept_point(self.order[k] as usize, (u[1] * elements.kept_points() as f32) as u32)
    }

    /// Nodes that hold all elements between them, about `count`.
    pub fn cut(&self, count: usize) -> Vec<usize> {
        let most = (2 * self.order.len()).div_ceil(count).max(1) as u32;
        let (mut cut, mut open) = (Vec::new(), vec![0]);
        while let Some(at) = open.pop() {
            let node = &self.nodes[at];
            if node.end - node.first <= most { cut.push(at) } else { open.extend(node.children(at)) }
        }
        cut
    }

    /// The mean by area of `values` by element, over each node.
    pub fn pull(&self, values: &[Rgb]) -> Vec<Rgb> {
        let mut all = vec![Rgb::ZERO; self.nodes.len()];
        for (at, node) in self.nodes.iter().enumerate().rev() {
            all[at] = if node.is_leaf() {
                values[self.order[node.first as usize] as usize]
            } else {
                let [l, r] = node.children(at);
                let (a, b) = (self.nodes[l].cluster.area, self.nodes[r].cluster.area);
                (all[l] * a + all[r] * b) / (a + b).max(f32::MIN_POSITIVE)
            };
        }
        all
    }

    /// Adds to every node what was found at its ancestors; the sums of the leaves by element.
    pub fn push(&self, mut values: Vec<Rgb>) -> Vec<Rgb> {
        let mut of_elements = vec![Rgb::ZERO; self.order.len()];
        for (at, node) in self.nodes.iter().enumerate() {
            if node.is_leaf() {
                of_elements[self.order[node.first as usize] as usize] = values[at];
            } else {
                for child in node.children(at) {
                    let more = values[at];
                    values[child] += more;
                }
            }
        }
        of_elements
    }
}

/// Sorts `items` into the order of leaves; `lefts` receives the size of each node's left child, parents first.
fn split(items: &mut [Item], lefts: &mut [u32]) {
    let n = items.len();
    if n < 2 {
        return;
    }
    let (mut low, mut high) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for item in items.iter() {
        for k in 0..6 {
            low[k] = low[k].min(item.place[k]);
            high[k] = high[k].max(item.place[k]);
        }
    }
    let extent = |k: usize| high[k] - low[k];
    let diagonal = (0..3).map(|k| extent(k) * extent(k)).sum::<f32>().sqrt();
    let weight = |k: usize| if k < 3 { 1.0 } else { NORMAL_WEIGHT * diagonal };
    let axis = (0..6).max_by(|&a, &b| (extent(a) * weight(a)).total_cmp(&(extent(b) * weight(b)))).unwrap_or(0);
    let by_place = |a: &Item, b: &Item| a.place[axis].total_cmp(&b.place[axis]).then(a.element.cmp(&b.element));
    let mut left = n / 2;
    if axis >= 3 {
        // Ways of facing are few and equal: between them, not through the middle one.
        let middle = 0.5 * (low[axis] + high[axis]);
        items.sort_unstable_by(by_place);
        left = items.partition_point(|i| i.place[axis] < middle).clamp(1, n - 1);
    } else {
        items.select_nth_unstable_by(left, by_place);
    }
    lefts[0] = left as u32;
    let (a, b) = items.split_at_mut(left);
    let (of_a, of_b) = lefts[1..].split_at_mut(2 * left - 1);
    rayon::join(|| split(a, of_a), || split(b, of_b));
}
