//! Adaptive meshing: triangles are cut where values between vertices miss the light.
//!
//! In rounds, values are fitted to the mesh as it is, pieces that miss too much each ask for one edge to be cut, and all pieces that
//! have such an edge are cut with it, so that none is left with a point in the middle of an edge. Of a piece's edges the one is
//! asked for whose new vertex takes away the most of the squared error: the gain of a hat of the new vertex, in closed form. Long
//! thin pieces along a shadow come about by themselves.

use super::MeshParams;
use super::doubt::doubt_beside_breaks;
use super::fine::{Edge, FineMesh, Piece, edge};
use super::fit::{Groups, fit, relative_error};
use super::sample::{Sample, Samples, Source, Within};
use crate::Result;
use crate::color::Rgb;
use crate::post::Quantity;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// A surface while its mesh is made.
pub struct Work {
    pub surface: usize,
    pub fine: FineMesh,
    pub samples: Samples,
    /// By piece: the numbers of the samples in it.
    pub members: Vec<Vec<u32>>,
    pub groups: Groups,
    /// By group.
    pub values: Vec<Rgb>,
}

/// Pieces with fewer samples than this hold no more than can be told.
const LEAST_SAMPLES: usize = 8;
/// Samples that are off from which a piece is looked at however small a share they are: a small shadow in the middle of a floor.
const FEATURE: usize = 12;
/// What a cut must gain, as a multiple of what noise alone would make it seem to gain.
const SIGNIFICANT: f64 = 4.0;
/// A piece that is wrong over this share is cut whatever is gained: what lies even about its middle shows in no edge.
const WRONG: f64 = 0.3;
/// The least height that pieces are cut to, in distances between samples.
const LEAST_HEIGHT: f64 = 1.0;
/// Rounds, at most: each halves an edge.
const ROUNDS: usize = 64;
/// How much of the mesh one round may add where triangles are counted, so that they go where they are needed most.
const GROWTH: f64 = 0.15;

/// A piece that asks to be cut.
struct Request {
    edge: Edge,
    /// Squared error beyond what is asked for, by the weights of the fit.
    priority: f64,
}

impl Work {
    /// The surface `surface`, of which `fine` is the mesh to begin with.
    pub fn new(source: &Source, surface: usize, fine: FineMesh) -> Self {
        let mesh = &source.scene.meshes[source.scene.surfaces[surface].mesh];
        let mut samples = Samples::new(source, surface);
        let mut members = vec![Vec::new(); fine.pieces.len()];
        let mut start = 0;
        for pieces in fine.pieces.chunk_by(|a, b| a.source == b.source) {
            let of = samples.of(pieces[0].source as usize);
            deal(of, &samples, pieces, &mut members[start..start + pieces.len()]);
            start += pieces.len();
        }
        for (piece, members) in fine.pieces.iter().zip(&mut members).filter(|(_, members)| members.is_empty()) {
            members.push(samples.push(source, surface, piece));
        }
        let groups = Groups::new(&fine, mesh, source.lightmap.quantity == Quantity::Radiosity);
        let texel = 1.0 / f64::from(source.atlas.surface_density(source.scene, surface));
        doubt_beside_breaks(&fine, &groups, &mut samples, &members, texel);
        Self { surface, fine, samples, members, groups, values: Vec::new() }
    }

    /// Fits the values anew.
    pub fn fit(&mut self) {
        let start =
            (self.values.len() == self.groups.count).then(|| self.values.iter().map(|v| v.as_dvec3()).collect());
        self.values = fit(&self.fine, &self.groups, &self.samples, &self.members, start);
    }

    /// Cuts `edges`; values become those of what was there.
    pub fn bisect(&mut self, source: &Source, edges: &BTreeSet<Edge>) {
        if edges.is_empty() {
            return;
        }
        let parents = self.fine.bisect(edges);
        let mut old = std::mem::take(&mut self.members);
        let mut members = vec![Vec::new(); parents.len()];
        let mut start = 0;
        for parts in parents.chunk_by(|a, b| a == b) {
            let of = std::mem::take(&mut old[parts[0] as usize]);
            let range = start..start + parts.len();
            if parts.len() == 1 {
                members[start] = of;
            } else {
                deal(of.into_iter(), &self.samples, &self.fine.pieces[range.clone()], &mut members[range]);
            }
            start += parts.len();
        }
        self.members = members;
        self.regroup(source);
    }

    /// Finds the groups of corners anew.
    pub fn regroup(&mut self, source: &Source) {
        let mesh = &source.scene.meshes[source.scene.surfaces[self.surface].mesh];
        self.groups = Groups::new(&self.fine, mesh, source.lightmap.quantity == Quantity::Radiosity);
        self.values.clear();
    }

    /// The values at the corners of piece `piece`.
    pub fn corners(&self, piece: usize) -> [DVec3; 3] {
        self.groups.of[piece].map(|g| self.values[g as usize].as_dvec3())
    }

    /// Calls `found` with each sample of piece `piece` that is judged: see [`Samples::each_error`].
    pub fn each_error(&self, piece: usize, found: impl FnMut(&Sample, DVec3, DVec3)) {
        let corners = &self.fine.pieces[piece].corners;
        self.samples.each_error(corners, &self.corners(piece), &self.members[piece], found);
    }

    /// What piece `piece` asks for, where it misses more of the light than it may.
    fn request(&self, piece: usize, params: &MeshParams, share: f64, mean: f32) -> Option<Request> {
        if self.members[piece].len() < LEAST_SAMPLES {
            return None;
        }
        let (mut area, mut wrong, mut beyond, mut squares) = (0.0, 0.0, 0.0, 0.0);
        let (mut count, mut wrong_count) = (0usize, 0usize);
        // By edge: products of its hat with the error, and with itself.
        let mut gains = [(DVec3::ZERO, 0.0); 3];
        self.each_error(piece, |s, w, difference| {
            let (a, level) = (f64::from(s.area), s.level(mean));
            let error = relative_error(difference, level);
            let weight = s.weight(mean);
            area += a;
            squares += weight * difference.length_squared();
            count += 1;
            if error > params.error {
                wrong += a;
                wrong_count += 1;
                beyond += weight * (difference.abs().max_element() - params.error * level).powi(2);
            }
            for (k, gain) in gains.iter_mut().enumerate() {
                let hat = 2.0 * w[k].min(w[(k + 1) % 3]);
                *gain = (gain.0 + difference * (weight * hat), gain.1 + weight * hat * hat);
            }
        });
        let is_feature = wrong_count >= FEATURE;
        if area == 0.0 || (wrong <= share * area && !is_feature) {
            return None;
        }
        let p = self.fine.pieces[piece].points;
        let at = p.map(|p| self.fine.points[p as usize]);
        let length = [0, 1, 2].map(|k| at[k].distance(at[(k + 1) % 3]));
        let twice = (at[1] - at[0]).cross(at[2] - at[0]).length();
        let longest = length.into_iter().fold(0.0, f64::max);
        let spacing = (area / count as f64).sqrt();
        let noise = squares / count as f64;
        let mut best: Option<(f64, usize)> = None;
        for k in 0..3 {
            let gained = if gains[k].1 > 0.0 { gains[k].0.length_squared() / gains[k].1 } else { 0.0 };
            // Both halves have half the area over the longest of their edges: two old ones, and the new one, no longer than those.
            let is_thin = 0.5 * twice < LEAST_HEIGHT * spacing * longest && length[k] < longest;
            let is_short = length[k] < 2.0 * LEAST_HEIGHT * spacing;
            if is_short || is_thin || (gained < SIGNIFICANT * noise && wrong < WRONG * area) {
                continue;
            }
            let score = (gained + 1e-3 * squares) * length[k] / longest;
            if best.is_none_or(|(most, _)| score > most) {
                best = Some((score, k));
            }
        }
        best.map(|(_, k)| Request { edge: edge(p[k], p[(k + 1) % 3]), priority: beyond })
    }
}

/// Deals samples out to the pieces of one triangle that hold them.
pub fn deal(of: impl Iterator<Item = u32>, samples: &Samples, pieces: &[Piece], members: &mut [Vec<u32>]) {
    if let [members] = members {
        members.extend(of);
        return;
    }
    let within: Vec<Option<Within>> = pieces.iter().map(|p| Within::new(&p.corners)).collect();
    for s in of {
        let weights = samples.all[s as usize].weights();
        let depth = |w: &Option<Within>| w.map_or(f64::NEG_INFINITY, |w| w.weights(weights).min_element());
        let mut best = (0, f64::NEG_INFINITY);
        for (k, w) in within.iter().enumerate() {
            let depth = depth(w);
            if depth > best.1 {
                best = (k, depth);
            }
            if depth >= 0.0 {
                break;
            }
        }
        members[best.0].push(s);
    }
}

/// Cuts the meshes until they hold the light as exactly as asked but for the part `share` of each piece's area, or have as many
/// triangles as they may.
///
/// # Errors
/// `Cancelled`.
pub fn refine(
    works: &mut [Work],
    source: &Source,
    params: &MeshParams,
    share: f64,
    progress: &dyn Progress,
) -> Result<()> {
    for _ in 0..ROUNDS {
        progress.check()?;
        works.par_iter_mut().for_each(|w| w.fit());
        let requests: Vec<Vec<Request>> = works
            .par_iter()
            .map(|w| {
                let pieces = (0..w.fine.pieces.len()).into_par_iter().with_min_len(64);
                pieces.filter_map(|p| w.request(p, params, share, source.mean)).collect()
            })
            .collect();
        let chosen = choose(works, &requests, params);
        if chosen.iter().all(BTreeSet::is_empty) {
            break;
        }
        works.par_iter_mut().zip(&chosen).for_each(|(w, edges)| w.bisect(source, edges));
    }
    works.par_iter_mut().for_each(|w| w.fit());
    Ok(())
}

/// The edges to cut in a round: all that are asked for, or the most important ones within the triangles that are left.
fn choose(works: &[Work], requests: &[Vec<Request>], params: &MeshParams) -> Vec<BTreeSet<Edge>> {
    let mut chosen = vec![BTreeSet::new(); works.len()];
    let Some(most) = params.max_triangles else {
        for (edges, requests) in chosen.iter_mut().zip(requests) {
            edges.extend(requests.iter().map(|r| r.edge));
        }
        return chosen;
    };
    let now: u64 = works.iter().map(|w| w.fine.pieces.len() as u64).sum();
    let left = most.saturating_sub(now).min((now as f64 * GROWTH) as u64 + 16);
    let mut all: Vec<(f64, usize, Edge)> = Vec::new();
    for (w, requests) in requests.iter().enumerate() {
        // What several pieces ask for counts for all of them.
        let mut of_edge: BTreeMap<Edge, f64> = BTreeMap::new();
        requests.iter().for_each(|r| *of_edge.entry(r.edge).or_default() += r.priority);
        all.extend(of_edge.into_iter().map(|(edge, priority)| (priority, w, edge)));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let at_edges: Vec<_> = works.par_iter().map(|w| w.fine.pieces_at_edges()).collect();
    let mut added = 0;
    for (_, w, edge) in all {
        let adds = at_edges[w].get(&edge).map_or(0, Vec::len) as u64;
        if added + adds > left {
            break;
        }
        added += adds;
        chosen[w].insert(edge);
    }
    chosen
}
