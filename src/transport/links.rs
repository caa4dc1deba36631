//! Hierarchical transport (Hanrahan, Salzman, Aupperle 1991; clusters: Smits, Arvo, Greenberg 1994): light is exchanged by links
//! between clusters of a tree, each as large as its error allows.
//!
//! A link stands for all pairs of elements below its ends with one form factor. It is refined where the power that this may
//! misplace, the error of `A_p F_pq` times the radiosity of the brighter end, exceeds a bound. Kernel and visibility are
//! sampled between points of the two clusters, so the error holds what both vary by, and the noise. Links, and with them time
//! and memory, grow with what there is to tell apart, not with the square of the elements.

use super::outline::Outlines;
use super::refine::{Found, Link, Refiner};
use super::tree::Tree;
use super::{Elements, Exchanger, Probes};
use crate::Result;
use crate::color::Rgb;
use crate::patch::Ground;
use crate::progress::Progress;
use rayon::prelude::*;

/// Clusters in which probes measure what lands, at most, and elements that are probed in each.
const MOST_CLOSED: usize = 2048;
const PROBES: usize = 4;

/// Rounds of balancing: a closed scene closes to a thousandth. Scales beyond the most are the fault of something else.
const BALANCING_ROUNDS: u32 = 10;
const MOST_SCALE: f32 = 3.0;

/// Links don't err quite independently, and light that they misplace is reflected on: against the full matrix the error was 0.7
/// to 1.2 times the sum over them.
const CAUTION: f64 = 1.5;

/// Transport by links.
pub struct Links<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    tree: &'a Tree,
    outlines: Outlines<'a>,
    links: Vec<Link>,
    /// Links of node i, as (other end, form factor to it): `ways[first[i]..first[i + 1]]`.
    ways: Vec<(u32, f32)>,
    first: Vec<u32>,
    /// What is multiplied to all that each element sends and receives, so that as much lands as probes saw land.
    scale: Vec<f32>,
    pub segments: u64,
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
        let outlines = Outlines::new(elements, ground);
        let refiner = Refiner { elements, ground, tree, probes, outlines: &outlines, bright: &bright, bound };
        let found = refiner.within(0, progress)?;
        let mut all = Self {
            elements,
            ground,
            tree,
            outlines,
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
        let refiner = Refiner {
            elements: self.elements,
            ground: self.ground,
            tree: self.tree,
            probes,
            outlines: &self.outlines,
            bright: &bright,
            bound,
        };
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
        if flux > 0.0 { CAUTION * (squares / area).sqrt() / (flux / area) } else { 0.0 }
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
