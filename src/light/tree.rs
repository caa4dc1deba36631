//! A tree over polygons that shine, so that a point with thousands of them tests a few clusters.
//!
//! The cut through the tree is refined where the bound on a cluster's light is largest (Walter et al. 2005, "Lightcuts"); a
//! cluster that stays is sampled by drawing its polygons in proportion to power, so that nothing is lost, whatever the cut.

use super::polygon::Polygon;
use crate::color::luminance;
use glam::Vec3;

/// Polygons, and a binary tree over them.
pub struct LightTree {
    pub polygons: Vec<Polygon>,
    nodes: Vec<Node>,
    /// The node above each node, the root above itself; and the leaf of each polygon.
    parent: Vec<u32>,
    leaf: Vec<u32>,
}

/// A point for which one polygon is to be chosen.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    pub position: Vec3,
    /// Unit; what lies behind it sends nothing.
    pub normal: Vec3,
    /// Polygons in whose plane the point lies, to within this distance [m], send nothing.
    pub tolerance: f32,
}

/// A polygon that was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Choice {
    pub polygon: usize,
    /// Its probability, more than 0: [`LightTree::probability`].
    pub probability: f32,
    /// The random number that drew it, rescaled to [0, 1).
    pub u: f32,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    centre: Vec3,
    radius: f32,
    /// Radiance luminance times area over all polygons below [nit m^2].
    strength: f32,
    kind: Kind,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Leaf(u32),
    Inner(u32, u32),
}

/// A member of a cut.
#[derive(Clone, Copy, Debug)]
pub enum Cluster {
    /// One polygon.
    Polygon(usize),
    /// Several, below this node.
    Node(usize),
}

/// Clusters in a cut, at most.
pub const CUT_SIZE: usize = 32;

impl LightTree {
    /// Builds the tree; O(n log n).
    pub fn new(polygons: Vec<Polygon>) -> Self {
        let mut tree = Self { polygons, nodes: Vec::new(), parent: Vec::new(), leaf: Vec::new() };
        let mut order: Vec<u32> = (0..tree.polygons.len() as u32).collect();
        if !order.is_empty() {
            tree.build(&mut order);
        }
        tree.parent = vec![0; tree.nodes.len()];
        tree.leaf = vec![0; tree.polygons.len()];
        for (n, node) in tree.nodes.iter().enumerate() {
            match node.kind {
                Kind::Leaf(p) => tree.leaf[p as usize] = n as u32,
                Kind::Inner(l, r) => [l, r].into_iter().for_each(|child| tree.parent[child as usize] = n as u32),
            }
        }
        tree
    }

    /// True where nothing with an area shines.
    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// Adds the subtree over `order` and returns its node. Halving keeps the depth at log2 of the count.
    fn build(&mut self, order: &mut [u32]) -> u32 {
        let index = self.nodes.len();
        if let [only] = order {
            let p = &self.polygons[*only as usize];
            let strength = luminance(p.radiance) * p.area;
            self.nodes.push(Node { centre: p.centre, radius: p.radius, strength, kind: Kind::Leaf(*only) });
            return index as u32;
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &i in order.iter() {
            low = low.min(self.polygons[i as usize].centre);
            high = high.max(self.polygons[i as usize].centre);
        }
        let size = high - low;
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let polygons = &self.polygons;
        let half = order.len() / 2;
        order.select_nth_unstable_by(half, |&a, &b| {
            let key = |i: u32| polygons[i as usize].centre[axis];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        self.nodes.push(Node { centre: Vec3::ZERO, radius: 0.0, strength: 0.0, kind: Kind::Leaf(0) });
        let (left, right) = order.split_at_mut(half);
        let (l, r) = (self.build(left), self.build(right));
        let (a, b) = (self.nodes[l as usize], self.nodes[r as usize]);
        let centre = (a.centre + b.centre) * 0.5;
        let radius = (a.centre.distance(centre) + a.radius).max(b.centre.distance(centre) + b.radius);
        self.nodes[index] = Node { centre, radius, strength: a.strength + b.strength, kind: Kind::Inner(l, r) };
        index as u32
    }

    /// The clusters that can light a receiver of `radius` [m] around `position` with mean normal `normal`.
    pub fn cut(&self, position: Vec3, normal: Vec3, radius: f32) -> Vec<Cluster> {
        let mut cut: Vec<(f32, usize)> = Vec::with_capacity(CUT_SIZE);
        if self.nodes.is_empty() {
            return Vec::new();
        }
        let add = |cut: &mut Vec<(f32, usize)>, n: u32| {
            let bound = self.bound(n as usize, position, normal, radius);
            if bound > 0.0 {
                cut.push((bound, n as usize));
            }
        };
        add(&mut cut, 0);
        while cut.len() < CUT_SIZE {
            let inner = |n: usize| matches!(self.nodes[n].kind, Kind::Inner(..));
            let widest = (0..cut.len()).filter(|&i| inner(cut[i].1)).max_by(|&i, &j| cut[i].0.total_cmp(&cut[j].0));
            let Some(i) = widest else { break };
            let (_, n) = cut.swap_remove(i);
            if let Kind::Inner(l, r) = self.nodes[n].kind {
                add(&mut cut, l);
                add(&mut cut, r);
            }
        }
        cut.into_iter()
            .map(|(_, n)| match self.nodes[n].kind {
                Kind::Leaf(p) => Cluster::Polygon(p as usize),
                Kind::Inner(..) => Cluster::Node(n),
            })
            .collect()
    }

    /// An upper bound on a node's illuminance [lx] up to a constant factor; 0 only where none of it can arrive.
    fn bound(&self, n: usize, position: Vec3, normal: Vec3, radius: f32) -> f32 {
        let node = &self.nodes[n];
        let way = node.centre - position;
        let reach = node.radius + radius;
        // A texel on a curved surface has normals beside its mean: half its reach again is left for them.
        if way.dot(normal) + 1.5 * reach <= 0.0 {
            return 0.0;
        }
        let distance = way.length();
        // Inside or next to the cluster the bound is as large as its own size allows.
        let near = (distance - reach).max(0.1 * reach).max(1e-6);
        node.strength / (near * near)
    }

    /// An estimate of a node's illuminance [lx] for sharing out samples.
    pub fn estimate(&self, n: usize, position: Vec3) -> f32 {
        let node = &self.nodes[n];
        node.strength / node.centre.distance_squared(position).max(node.radius * node.radius)
    }

    /// A polygon below node `n` in proportion to its strength, its probability, and `u` rescaled to [0, 1).
    pub fn sample(&self, n: usize, mut u: f32) -> (usize, f32, f32) {
        let (mut at, mut probability) = (n, 1.0f32);
        loop {
            match self.nodes[at].kind {
                Kind::Leaf(p) => return (p as usize, probability, u.clamp(0.0, 1.0 - f32::EPSILON)),
                Kind::Inner(l, r) => {
                    let (a, b) = (self.nodes[l as usize].strength, self.nodes[r as usize].strength);
                    let left = if a + b > 0.0 { a / (a + b) } else { 0.5 };
                    (at, probability, u) = if u < left {
                        (l as usize, probability * left, u / left)
                    } else {
                        (r as usize, probability * (1.0 - left), (u - left) / (1.0 - left))
                    };
                }
            }
        }
    }

    /// One polygon of all, by descending the tree in proportion to what either half can send to `view` (Conty Estevez, Kulla
    /// 2018, "Importance Sampling of Many Lights"). `None` where nothing can arrive, or the descent ended where nothing can.
    pub fn choose(&self, view: &Viewpoint, mut u: f32) -> Option<Choice> {
        if self.is_empty() || self.importance(0, view) <= 0.0 {
            return None;
        }
        let (mut at, mut probability) = (0, 1.0f32);
        loop {
            match self.nodes[at].kind {
                Kind::Leaf(p) => {
                    let u = u.clamp(0.0, 1.0 - f32::EPSILON);
                    return (probability > 0.0).then_some(Choice { polygon: p as usize, probability, u });
                }
                Kind::Inner(l, r) => {
                    let left = self.left_share(l, r, view)?;
                    (at, probability, u) = if u < left {
                        (l as usize, probability * left, u / left)
                    } else {
                        (r as usize, probability * (1.0 - left), (u - left) / (1.0 - left))
                    };
                }
            }
        }
    }

    /// The probability with which [`choose`](Self::choose) takes `polygon`.
    pub fn probability(&self, view: &Viewpoint, polygon: usize) -> f32 {
        if self.importance(0, view) <= 0.0 {
            return 0.0;
        }
        let (mut at, mut probability) = (self.leaf[polygon], 1.0f32);
        while at != 0 && probability > 0.0 {
            let parent = self.parent[at as usize];
            if let Kind::Inner(l, r) = self.nodes[parent as usize].kind {
                let share = |left: f32| if at == l { left } else { 1.0 - left };
                probability *= self.left_share(l, r, view).map_or(0.0, share);
            }
            at = parent;
        }
        probability
    }

    /// The probability of the left of two nodes; `None` where neither can send anything.
    fn left_share(&self, left: u32, right: u32, view: &Viewpoint) -> Option<f32> {
        let (a, b) = (self.importance(left as usize, view), self.importance(right as usize, view));
        (a + b > 0.0).then(|| a / (a + b))
    }

    /// About what a node can send to `view` [lx], up to a constant factor; 0 only where none of it can arrive.
    fn importance(&self, n: usize, view: &Viewpoint) -> f32 {
        let node = &self.nodes[n];
        let way = node.centre - view.position;
        if way.dot(view.normal) + node.radius <= 0.0 {
            return 0.0;
        }
        if let Kind::Leaf(p) = node.kind
            && !self.polygons[p as usize].faces(view.position, view.tolerance)
        {
            return 0.0;
        }
        node.strength / way.length_squared().max(node.radius * node.radius).max(f32::MIN_POSITIVE)
    }
}
