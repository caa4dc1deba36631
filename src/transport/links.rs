//! Hierarchical transport (Hanrahan, Salzman, Aupperle 1991; clusters: Smits, Arvo, Greenberg 1994): light is exchanged by links
//! between clusters of a tree, each as large as its error allows.
//!
//! A link stands for all pairs of elements below its ends with one form factor. It is refined where the power that this may
//! misplace, the error of `A_p F_pq` times the radiosity of the brighter end, exceeds a bound. Kernel and visibility are
//! sampled between points of the two clusters, so the error holds what both vary by, and the noise. Links, and with them time
//! and memory, grow with what there is to tell apart, not with the square of the elements.

use super::tree::Tree;
use super::{Effort, Elements, Exchanger, Outline, Probes, near};
use crate::Result;
use crate::color::Rgb;
use crate::patch::Ground;
use crate::progress::Progress;
use crate::sample::sequence::{Sequence, Stage};
use crate::trace::Segment;
use rayon::prelude::*;
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

/// Clusters in which probes measure what lands, at most, and elements that are probed in each.
const MOST_CLOSED: usize = 2048;
const PROBES: usize = 4;

/// Rounds of balancing: a closed scene closes to a thousandth. Scales beyond the most are the fault of something else.
const BALANCING_ROUNDS: u32 = 10;
const MOST_SCALE: f32 = 3.0;

/// One link, both ways.
#[derive(Clone, Copy, Debug)]
struct Link {
    ends: [u32; 2],
    /// `A_p F_pq` [m^2], and its error.
    exchange: f32,
    error: f32,
}

/// Transport by links.
pub struct Links<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    tree: &'a Tree,
    links: Vec<Link>,
    /// Links of node i, as (other end, form factor to it): `ways[first[i]..first[i + 1]]`.
    ways: Vec<(u32, f32)>,
    first: Vec<u32>,
    /// What is multiplied to all that each element sends and receives, so that as much lands as probes saw land.
    scale: Vec<f32>,
    pub segments: u64,
}

/// What refinement works with.
struct Refiner<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    tree: &'a Tree,
    /// Radiosity by node, root mean square over its elements, brightest channel [lm/m^2].
    bright: &'a [f32],
    /// Power that a link may misplace [lm].
    bound: f64,
}

#[derive(Default)]
struct Found {
    links: Vec<Link>,
    segments: u64,
}

/// A sampled `A_p F_pq`.
struct Estimate {
    value: f64,
    error: f64,
    /// Pairs of points, and segments between those that face each other.
    samples: u32,
    segments: u32,
}

impl<'a> Links<'a> {
    /// Links for elements that send about `sent` [lm/m^2]; each may misplace `bound` [lm].
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn new(
        elements: &'a Elements,
        ground: &'a Ground<'a>,
        tree: &'a Tree,
        probes: &Probes,
        sent: &[Rgb],
        bound: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let bright = brightness(tree, sent);
        let refiner = Refiner { elements, ground, tree, bright: &bright, bound };
        let found = refiner.within(0, progress)?;
        let mut all = Self {
            elements,
            ground,
            tree,
            links: found.links,
            ways: Vec::new(),
            first: Vec::new(),
            scale: vec![1.0; elements.len()],
            segments: found.segments,
        };
        all.index();
        all.close(probes, progress)?;
        Ok(all)
    }

    /// Number of links, each of which carries light both ways.
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// True where nothing sees anything.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Refines the links that may misplace more than `bound` [lm] now that elements send `sent`; how many there were.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn refine(&mut self, probes: &Probes, sent: &[Rgb], bound: f64, progress: &dyn Progress) -> Result<usize> {
        let bright = brightness(self.tree, sent);
        let refiner = Refiner { elements: self.elements, ground: self.ground, tree: self.tree, bright: &bright, bound };
        let old = std::mem::take(&mut self.links);
        let parts: Vec<(Found, usize)> = old
            .par_chunks(1024)
            .map(|links| {
                let (mut found, mut count) = (Found::default(), 0);
                for link in links {
                    let [p, q] = link.ends.map(|e| e as usize);
                    let is_split = f64::from(link.error) * refiner.weight(p, q) > bound && !refiner.is_last(p, q);
                    if is_split {
                        count += 1;
                        refiner.split(p, q, &mut found, progress)?;
                    } else {
                        found.links.push(*link);
                    }
                }
                Ok((found, count))
            })
            .collect::<Result<_>>()?;
        let mut count = 0;
        for (found, refined) in parts {
            self.links.extend(found.links);
            self.segments += found.segments;
            count += refined;
        }
        self.index();
        self.close(probes, progress)?;
        Ok(count)
    }

    /// The error of element irradiances that links leave, root mean square over all area relative to the mean, as far as links
    /// err independently, where elements send `sent`.
    pub fn error(&self, sent: &[Rgb]) -> f64 {
        let bright = brightness(self.tree, sent);
        let nodes = &self.tree.nodes;
        // Error of E squared, times area, over all links at each end; and the flux that arrives.
        let (mut squares, mut flux) = (0.0f64, 0.0f64);
        for link in &self.links {
            let [p, q] = link.ends.map(|e| e as usize);
            for (to, from) in [(p, q), (q, p)] {
                let area = f64::from(nodes[to].cluster.area);
                squares += (f64::from(link.error) * f64::from(bright[from])).powi(2) / area;
                flux += f64::from(link.exchange) * f64::from(bright[from]);
            }
        }
        let area = f64::from(nodes[0].cluster.area);
        if flux > 0.0 { (squares / area).sqrt() / (flux / area) } else { 0.0 }
    }

    /// Sorts links by their ends, so that each node finds its own.
    fn index(&mut self) {
        let n = self.tree.nodes.len();
        let mut first = vec![0u32; n + 1];
        let is_self = |l: &Link| l.ends[0] == l.ends[1];
        for link in &self.links {
            first[link.ends[0] as usize + 1] += 1;
            if !is_self(link) {
                first[link.ends[1] as usize + 1] += 1;
            }
        }
        for i in 0..n {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let mut ways = vec![(0u32, 0.0f32); first[n] as usize];
        for link in &self.links {
            let [p, q] = link.ends;
            let mut put = |from: u32, to: u32| {
                let slot = &mut next[from as usize];
                ways[*slot as usize] = (to, link.exchange / self.tree.nodes[from as usize].cluster.area);
                *slot += 1;
            };
            put(p, q);
            if !is_self(link) {
                put(q, p);
            }
        }
        (self.first, self.ways) = (first, ways);
    }

    /// Finds the scales that make all of an element's form factors add up to what probes saw land. As they work both ways,
    /// `A_i F_ij` stays symmetric, and power is kept for any light: in a closed scene all that is sent is received (a balancing of
    /// matrices after Sinkhorn and Knopp 1967).
    fn close(&mut self, probes: &Probes, progress: &dyn Progress) -> Result<()> {
        let n = self.elements.len();
        let landed = self.landed(probes, progress)?;
        self.scale = vec![1.0; n];
        for _ in 0..BALANCING_ROUNDS {
            let sums = self.irradiance(&vec![Rgb::ONE; n]);
            for ((scale, sum), landed) in self.scale.iter_mut().zip(&sums).zip(&landed) {
                if sum.x > 0.0 && *landed > 0.0 {
                    *scale = (*scale * (landed / sum.x).sqrt()).clamp(1.0 / MOST_SCALE, MOST_SCALE);
                }
            }
        }
        Ok(())
    }

    /// The share of each element's light that lands: the mean of a few probes in clusters of a size that can be afforded.
    fn landed(&self, probes: &Probes, progress: &dyn Progress) -> Result<Vec<f32>> {
        let clusters = self.tree.cut(MOST_CLOSED);
        let means: Vec<f32> = clusters
            .par_iter()
            .map(|&at| {
                progress.check()?;
                let node = &self.tree.nodes[at];
                let members = &self.tree.order[node.first as usize..node.end as usize];
                let (mut seen, mut area) = (0.0f64, 0.0f64);
                for &e in members.iter().step_by(members.len().div_ceil(PROBES)) {
                    let weight = f64::from(self.elements.area[e as usize]);
                    seen += weight * f64::from(probes.of(e as usize).landed_share);
                    area += weight;
                }
                Ok(if area > 0.0 { (seen / area) as f32 } else { 1.0 })
            })
            .collect::<Result<_>>()?;
        let mut landed = vec![1.0; self.elements.len()];
        for (&at, mean) in clusters.iter().zip(means) {
            let node = &self.tree.nodes[at];
            for &e in &self.tree.order[node.first as usize..node.end as usize] {
                landed[e as usize] = mean;
            }
        }
        Ok(landed)
    }

    fn irradiance(&self, sent: &[Rgb]) -> Vec<Rgb> {
        let sent: Vec<Rgb> = sent.iter().zip(&self.scale).map(|(b, s)| *b * *s).collect();
        let sent = self.tree.pull(&sent);
        let gathered: Vec<Rgb> = (0..self.tree.nodes.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let ways = &self.ways[self.first[i] as usize..self.first[i + 1] as usize];
                ways.iter().map(|&(j, f)| sent[j as usize] * f).sum()
            })
            .collect();
        let mut received = self.tree.push(gathered);
        received.iter_mut().zip(&self.scale).for_each(|(e, s)| *e *= *s);
        received
    }
}

impl Exchanger for Links<'_> {
    fn gather(&mut self, sent: &[Rgb], _: &dyn Progress) -> Result<Vec<Rgb>> {
        Ok(self.irradiance(sent))
    }
}

/// Root mean square over each node of the brightest channel of `sent`.
fn brightness(tree: &Tree, sent: &[Rgb]) -> Vec<f32> {
    let squares: Vec<Rgb> = sent.iter().map(|b| Rgb::splat(b.max_element().powi(2))).collect();
    tree.pull(&squares).into_iter().map(|b| b.x.sqrt()).collect()
}

impl Found {
    fn joined(mut self, other: Self) -> Self {
        self.links.extend(other.links);
        Self { segments: self.segments + other.segments, ..self }
    }
}

impl Refiner<'_> {
    fn weight(&self, p: usize, q: usize) -> f64 {
        f64::from(self.bright[p].max(self.bright[q]))
    }

    fn is_last(&self, p: usize, q: usize) -> bool {
        self.tree.nodes[p].is_leaf() && self.tree.nodes[q].is_leaf()
    }

    /// Links among the elements below `at`.
    fn within(&self, at: usize, progress: &dyn Progress) -> Result<Found> {
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
    fn split(&self, p: usize, q: usize, found: &mut Found, progress: &dyn Progress) -> Result<()> {
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
        let outlines = [i, j].map(|e| Outline::new(self.elements, self.ground, e));
        let f = near::form_factor(self.elements, self.ground, i, j, outlines.each_ref(), &LEAF_EFFORT);
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
