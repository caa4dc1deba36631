//! Which clusters are linked: pairs are refined while the power that a link between them may misplace exceeds a bound.
//!
//! The error of a link holds what kernel and visibility vary by between points of its ends, the noise of few samples, and a doubt
//! where they agree. Refinement goes from the root down, each subtree on its own, and finds the same links on any number of
//! threads.

use super::outline::Outlines;
use super::tree::Tree;
use super::{Effort, Elements, Probes, near};
use crate::Result;
use crate::patch::Ground;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use std::f64::consts::PI;

/// Clusters whose centres are nearer than this many times the sum of their radii are refined before they are sampled: the
/// kernel between them has no bound.
const NEAR: f32 = 1.25;

/// Samples of a pair at first, and where its error is not far above the bound.
const FIRST_SAMPLES: u32 = 4;
const MORE_SAMPLES: u32 = 16;
const NOT_FAR_ABOVE: f64 = 3.0;

/// Where `k` samples agree on visibility, this share of `1 / (k + 2)` of the pair is taken to be otherwise (`1 / (k + 2)` is the
/// rule of succession).
const DOUBT: f64 = 0.5;

/// Pairs whose unoccluded power lies below this share of the bound are linked without a look at their error.
const HARMLESS: f64 = 0.25;

/// How exactly the form factor of two elements that nearly touch is found.
const LEAF_EFFORT: Effort = Effort { relative_error: 0.1, floor: 0.05, first_samples: 4, most_samples: 64 };

/// Pairs of clusters that are refined in parallel at least.
const GRAIN: u32 = 64;

/// One link, both ways.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    pub ends: [u32; 2],
    /// `A_p F_pq` [m^2], and its error.
    pub exchange: f32,
    pub error: f32,
}

/// What refinement works with.
pub(super) struct Refiner<'a> {
    pub elements: &'a Elements,
    pub ground: &'a Ground<'a>,
    pub tree: &'a Tree,
    pub probes: &'a Probes<'a>,
    pub outlines: &'a Outlines<'a>,
    /// Radiosity by node, root mean square over its elements, brightest channel [lm/m^2].
    pub bright: &'a [f32],
    /// Power that a link may misplace [lm].
    pub bound: f64,
}

/// Links, and the segments they took.
#[derive(Default)]
pub(super) struct Found {
    pub links: Vec<Link>,
    pub segments: u64,
}

/// A sampled `A_p F_pq`.
struct Estimate {
    value: f64,
    error: f64,
    /// Pairs of points, and segments between those that face each other.
    samples: u32,
    segments: u32,
}

impl Found {
    fn joined(mut self, other: Self) -> Self {
        self.links.extend(other.links);
        Self { segments: self.segments + other.segments, ..self }
    }
}

impl Refiner<'_> {
    /// The radiosity that an error of the exchange between `p` and `q` is weighed by [lm/m^2].
    pub fn weight(&self, p: usize, q: usize) -> f64 {
        f64::from(self.bright[p].max(self.bright[q]))
    }

    /// True where neither end can be refined.
    pub fn is_last(&self, p: usize, q: usize) -> bool {
        self.tree.nodes[p].is_leaf() && self.tree.nodes[q].is_leaf()
    }

    /// Links among the elements below `at`.
    pub fn within(&self, at: usize, progress: &dyn Progress) -> Result<Found> {
        let node = &self.tree.nodes[at];
        if node.is_leaf() {
            return Ok(Found::default());
        }
        let [l, r] = node.children(at);
        let between = || {
            let mut found = Found::default();
            self.between(l, r, &mut found, progress)?;
            Ok::<Found, crate::Error>(found)
        };
        let inside = || {
            let (a, b) = rayon::join(|| self.within(l, progress), || self.within(r, progress));
            Ok::<Found, crate::Error>(a?.joined(b?))
        };
        let (a, b) = if node.end - node.first > GRAIN { rayon::join(between, inside) } else { (between(), inside()) };
        Ok(a?.joined(b?))
    }

    /// Links between the elements below `p` and those below `q`.
    fn between(&self, p: usize, q: usize, found: &mut Found, progress: &dyn Progress) -> Result<()> {
        let [a, b] = [p, q].map(|at| &self.tree.nodes[at].cluster);
        let cosines = f64::from(a.most_cosine(b)) * f64::from(b.most_cosine(a));
        if cosines <= 0.0 || !a.can_see(b) {
            return Ok(());
        }
        let distance = f64::from(a.centre.distance(b.centre));
        let reach = f64::from(a.radius + b.radius);
        let smaller = f64::from(a.area.min(b.area));
        let is_near = distance < f64::from(NEAR) * reach;
        let most = if distance > reach {
            let gap = distance - reach;
            (f64::from(a.area) * f64::from(b.area) * cosines / (PI * gap * gap)).min(smaller)
        } else {
            smaller
        };
        let weight = self.weight(p, q);
        let is_harmless = most * weight <= HARMLESS * self.bound;
        if is_near && !is_harmless {
            if !self.is_last(p, q) {
                return self.split(p, q, found, progress);
            }
            return self.between_leaves(p, q, found);
        }
        let mut estimate = self.sample(p, q, 0..FIRST_SAMPLES, None);
        if !is_harmless {
            let misplaced = estimate.error * weight;
            if misplaced > self.bound && (misplaced < NOT_FAR_ABOVE * self.bound || self.is_last(p, q)) {
                estimate = self.sample(p, q, FIRST_SAMPLES..MORE_SAMPLES, Some(estimate));
            }
            if self.is_last(p, q) {
                // What is left is noise: nothing below its ends varies.
                estimate.error /= f64::from(estimate.samples).sqrt();
            } else if estimate.error * weight > self.bound {
                found.segments += u64::from(estimate.segments);
                return self.split(p, q, found, progress);
            }
        }
        self.keep(p, q, &estimate, found);
        Ok(())
    }

    fn keep(&self, p: usize, q: usize, estimate: &Estimate, found: &mut Found) {
        found.segments += u64::from(estimate.segments);
        if estimate.value > 0.0 {
            let (exchange, error) = (estimate.value as f32, estimate.error as f32);
            found.links.push(Link { ends: [p as u32, q as u32], exchange, error });
        }
    }

    /// Refines the larger end.
    pub fn split(&self, p: usize, q: usize, found: &mut Found, progress: &dyn Progress) -> Result<()> {
        progress.check()?;
        let [a, b] = [p, q].map(|at| &self.tree.nodes[at]);
        if b.is_leaf() || (!a.is_leaf() && a.cluster.radius >= b.cluster.radius) {
            for child in a.children(p) {
                self.between(child, q, found, progress)?;
            }
        } else {
            for child in b.children(q) {
                self.between(p, child, found, progress)?;
            }
        }
        Ok(())
    }

    /// Two elements that nearly touch.
    fn between_leaves(&self, p: usize, q: usize, found: &mut Found) -> Result<()> {
        let [i, j] = [p, q].map(|at| self.tree.order[self.tree.nodes[at].first as usize] as usize);
        let outlines = [i, j].map(|e| self.outlines.of(e));
        let f = if near::is_quick(outlines) {
            near::form_factor(self.elements, self.ground, i, j, outlines, &LEAF_EFFORT)
        } else {
            self.probes.between(i, j)
        };
        let area = f64::from(self.elements.area[i]);
        let estimate =
            Estimate { value: f.value * area, error: f.error * area, samples: f.samples, segments: f.samples };
        self.keep(p, q, &estimate, found);
        Ok(())
    }

    /// Area sampling between two clusters, going on from `before`.
    fn sample(&self, p: usize, q: usize, range: std::ops::Range<u32>, before: Option<Estimate>) -> Estimate {
        let [a, b] = [p, q].map(|at| &self.tree.nodes[at].cluster);
        let key = ((p.min(q) as u64) << 32) | p.max(q) as u64;
        let sequence = Sequence::new(self.elements.seed, Stage::FormFactor, key);
        let areas = f64::from(a.area) * f64::from(b.area);
        // A disc's own size keeps the kernel of near pairs in bounds; far ones don't feel it.
        let soft = if a.centre.distance(b.centre) < NEAR * (a.radius + b.radius) { a.area.max(b.area) } else { 0.0 };
        let count = range.len();
        let mut values = Vec::with_capacity(count);
        let mut segments = Vec::with_capacity(count);
        for index in range.clone() {
            let [s, t, u, v] = sequence.point(index, 0);
            let x = self.tree.point(self.elements, p, [s, t]);
            let y = self.tree.point(self.elements, q, [u, v]);
            let way = y.position - x.position;
            let square = f64::from(way.length_squared());
            let cosines = f64::from(way.dot(x.normal)).max(0.0) * f64::from(-way.dot(y.normal)).max(0.0);
            if cosines > 0.0 {
                values.push(areas * cosines / (square * (PI * square + f64::from(soft))));
                segments.push(Segment { from: x.position, to: y.position });
            }
        }
        let mut blocked = vec![false; segments.len()];
        self.ground.tracer.occluded(&segments, &mut blocked);
        let (n, traced) = (f64::from(range.end), segments.len() as u32);
        let (mut whole, mut seen, mut squares, mut visible) = (0.0f64, 0.0f64, 0.0f64, 0);
        for (value, blocked) in values.iter().zip(&blocked) {
            whole += value;
            if !blocked {
                seen += value;
                squares += value * value;
                visible += 1;
            }
        }
        let agree = visible == 0 || visible == values.len();
        let mean = seen / count as f64;
        let deviation = (squares / count as f64 - mean * mean).max(0.0).sqrt();
        let doubt = if agree { DOUBT * whole / count as f64 / (count as f64 + 2.0) } else { 0.0 };
        let error = deviation.hypot(doubt);
        match before {
            None => Estimate { value: mean, error, samples: range.end, segments: traced },
            Some(first) => {
                // Weighted by their counts.
                let share = f64::from(range.start) / n;
                Estimate {
                    value: first.value * share + mean * (1.0 - share),
                    error: first.error * share + error * (1.0 - share),
                    samples: range.end,
                    segments: first.segments + traced,
                }
            }
        }
    }
}
