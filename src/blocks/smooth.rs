//! Noise taken out of blocks by what their neighbours know.
//!
//! A plane fitted to a block and those around it has a third of the noise of the block alone, and misses what is finer than the fit.
//! How much of the difference between the two is noise is known: two independent halves of the samples tell the noise, and what the
//! difference has beyond it is detail. The difference is kept in the proportion of detail (Wiener 1949), block by block, with
//! both pooled over the neighbourhood. What error remains follows: the kept share of the noise.

use super::block::Blocks;
use super::respond::{DIFFERENCE, Response, Values, light};
use super::show::MOST_AROUND;
use crate::plane::Plane;
use glam::Vec2;
use rayon::prelude::*;

/// Neighbours that face further away than this cosine say nothing about a block.
const ALIKE: f32 = 0.8;

/// Blocks whose slope could not be told from few neighbours keep to the mean: a ridge, relative to the weights.
const RIDGE: f32 = 0.02;

/// What smoothing did, by front.
pub struct Smoothed {
    pub responses: Vec<Response>,
    /// Estimated mean square error [lx^2], luminance: what is left of the noise.
    pub error: Vec<f32>,
    /// Estimated mean square of the detail beyond a plane through the neighbours [lx^2], luminance; noise can make it negative.
    pub detail: Vec<f32>,
    /// Below this the detail can't be told from noise [lx^2].
    pub doubt: Vec<f32>,
}

/// Smooths the fronts among `blocks`; `around` lists each one and its neighbours.
pub fn smooth(blocks: &Blocks, around: &[Vec<u32>], responses: Vec<Response>) -> Smoothed {
    let own: Vec<Values> = responses.iter().zip(&blocks.list).map(|(r, b)| r.at(b.normal)).collect();
    let fit = |value: &(dyn Fn(usize, usize) -> Values + Sync)| -> Vec<Option<Values>> {
        (0..around.len()).into_par_iter().map(|b| fit(blocks, &around[b], b, |n| value(b, n))).collect()
    };
    let first = fit(&|b, n| if n == b { own[b] } else { responses[n].at(blocks.list[b].normal) });
    // A plane falls short of what is curved; what it misses is fitted in turn (Tukey 1977, "twicing").
    let missed = |b: usize| first[b].map_or([0.0; 8], |fitted| difference(&own[b], &fitted));
    let missed: Vec<Values> = (0..around.len()).map(missed).collect();
    let second = fit(&|_, n| missed[n]);
    let fits: Vec<Option<Values>> =
        first.iter().zip(&second).map(|(first, second)| Some(sum(first.as_ref()?, second.as_ref()?))).collect();
    // Squares of the residual, of its noise, and of the noise of the fit.
    let squares = |b: usize| {
        fits[b].as_ref().map(|fit| {
            let rest = difference(&own[b], fit);
            [light(&rest), rest[DIFFERENCE], fit[DIFFERENCE]].map(|v| v * v)
        })
    };
    let squares: Vec<Option<[f32; 3]>> = (0..around.len()).map(squares).collect();
    let settle = |(b, response): (usize, Response)| {
        let raw = own[b][DIFFERENCE] * own[b][DIFFERENCE];
        let Some(fit) = &fits[b] else { return (response, [raw, 0.0, f32::INFINITY]) };
        let (mut sums, mut count) = ([0.0f32; 3], 0.0f32);
        for &n in &around[b] {
            if let Some(square) = squares[n as usize] {
                let w = if n as usize == b { 2.0 } else { 1.0 };
                sums.iter_mut().zip(square).for_each(|(sum, square)| *sum += w * square);
                count += w;
            }
        }
        let [residual, noise, fitted] = sums.map(|sum| sum / count);
        let share = if residual > 0.0 { ((residual - noise) / residual).clamp(0.0, 1.0) } else { 0.0 };
        let mut target = *fit;
        target.iter_mut().zip(&own[b]).for_each(|(t, own)| *t += share * (own - *t));
        let detail = residual - noise;
        let lost = (1.0 - share) * (1.0 - share) * detail.max(0.0);
        let error = fitted + share * share * noise + lost;
        (response.moved(&own[b], &target), [error, detail, noise])
    };
    let settled: Vec<(Response, [f32; 3])> = responses.into_par_iter().enumerate().map(settle).collect();
    let column = |k: usize| settled.iter().map(|s| s.1[k]).collect();
    let (error, detail, doubt) = (column(0), column(1), column(2));
    let mut responses: Vec<Response> = settled.into_iter().map(|s| s.0).collect();
    give_back(blocks, &own, &mut responses);
    Smoothed { responses, error, detail, doubt }
}

/// Ratios beyond which the light of a region must have been all noise.
const RATIO: [f32; 2] = [0.8, 1.25];

/// Gives back to each region what smoothing took from its light in all: peaks are cut off more than hollows are filled. What blocks had
/// of their `own` is without bias.
fn give_back(blocks: &Blocks, own: &[Values], responses: &mut [Response]) {
    let fronts = &blocks.list[..responses.len()];
    let mut first = 0;
    for region in fronts.chunk_by(|a, b| a.region == b.region) {
        let (own, responses) = (&own[first..][..region.len()], &mut responses[first..][..region.len()]);
        first += region.len();
        let smoothed: Vec<Values> = responses.iter().zip(region).map(|(r, block)| r.at(block.normal)).collect();
        let sum = |values: &[Values], k: usize| -> f32 { region.iter().zip(values).map(|(b, v)| b.area * v[k]).sum() };
        let ratio: Values = std::array::from_fn(|k| {
            let (whole, left) = (sum(own, k), sum(&smoothed, k));
            let is_light = k != DIFFERENCE && left > 0.0;
            if is_light { (whole / left).clamp(RATIO[0], RATIO[1]) } else { 1.0 }
        });
        for (response, smoothed) in responses.iter_mut().zip(&smoothed) {
            let kept: Values = std::array::from_fn(|k| ratio[k] * smoothed[k]);
            *response = std::mem::replace(response, Response::Flat(kept)).moved(smoothed, &kept);
        }
    }
}

/// The plane through the `value`s of block `b` and those around it, at the place of the block; `None` where they are too few.
pub(super) fn fit<const N: usize>(
    blocks: &Blocks,
    around: &[u32],
    b: usize,
    value: impl Fn(usize) -> [f32; N],
) -> Option<[f32; N]> {
    let block = &blocks.list[b];
    let side = (1u32 << block.level) as f32;
    let mut near = [(0usize, 0.0f32, Vec2::ZERO); MOST_AROUND];
    let mut count = 0;
    let mut plane = Plane::default();
    let mut furthest = 0.0f32;
    let alike = around.iter().map(|&n| n as usize).filter(|&n| blocks.list[n].normal.dot(block.normal) > ALIKE);
    for (slot, n) in near.iter_mut().zip(alike) {
        let other = &blocks.list[n];
        let d = other.at - block.at;
        let (reach, distance) = (1.0 + 0.5 * (side + (1u32 << other.level) as f32), d.length());
        let tent = (1.0 - distance / (1.6 * reach)).max(0.05);
        let weight = tent * other.certainty(block);
        *slot = (n, weight, d);
        plane.add(weight, d);
        furthest = furthest.max(distance);
        count += 1;
    }
    if count < 3 {
        return None;
    }
    let shares = plane.shares(RIDGE, furthest)?;
    let mut values = [0.0f32; N];
    for (n, weight, d) in &near[..count] {
        let share = shares.of(*weight, *d);
        values.iter_mut().zip(value(*n)).for_each(|(sum, v)| *sum += share * v);
    }
    Some(values)
}

fn difference(a: &Values, b: &Values) -> Values {
    std::array::from_fn(|k| a[k] - b[k])
}

fn sum(a: &Values, b: &Values) -> Values {
    std::array::from_fn(|k| a[k] + b[k])
}
