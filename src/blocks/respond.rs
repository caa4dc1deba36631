//! What a block receives, as a function of the normal.
//!
//! A block of a curved surface is a set of texels that each see a hemisphere of their own. Its links together are a mixture of all of
//! them, from which the irradiance about any normal in between follows by weighing each direction by that normal's cosine. It is
//! found at 3 x 3 normals and is quadratic in between.

use super::block::{Blocks, FLAT};
use super::sweep::{Radiosity, System};
use crate::color::{Rgb, luminance};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Values of a block or texel: irradiance by channel [lx], the sky's part of it [lx], half the difference between the two halves of
/// samples (luminance) [lx], and the share of the hemisphere that lands on something.
pub type Values = [f32; 8];

/// Which of them is the difference: it is an error, and may be negative.
pub const DIFFERENCE: usize = 6;
/// Which of them is the share that lands.
pub const LANDED: usize = 7;

/// Sines of the angles between the mean normal and the outer nodes, at least and at most: beyond, the corners would lie below the
/// horizon of the mean.
const REACH: [f32; 2] = [0.1, 0.65];

/// Values as a function of the normal.
#[derive(Clone, Debug)]
pub enum Response {
    Flat(Values),
    Curved(Box<Curved>),
}

/// Values at 3 x 3 normals around the mean, and quadratic in between.
#[derive(Clone, Debug)]
pub struct Curved {
    tangents: [Vec3; 2],
    /// Sine of the outer nodes' angles to the mean along each tangent.
    reach: f32,
    nodes: [Values; 9],
}

/// Luminance of the irradiance in `values` [lx].
pub fn light(values: &Values) -> f32 {
    luminance(irradiance(values))
}

/// The irradiance in `values` [lx].
pub fn irradiance(values: &Values) -> Rgb {
    Rgb::new(values[0], values[1], values[2])
}

/// The sky's part of it [lx].
pub fn sky(values: &Values) -> Rgb {
    Rgb::new(values[3], values[4], values[5])
}

impl Response {
    /// How block `b` answers while patches send `radiosity`; `normal` is the one that a patch shows.
    pub fn new(system: &System, radiosity: &Radiosity, normal: &dyn Fn(usize) -> Vec3, b: usize) -> Self {
        let (block, found) = (&system.blocks.list[b], &system.sampled[b]);
        let halves = [0, 1].map(|k| System::collect(&found.halves[k], radiosity));
        let skies = [0, 1].map(|k| system.sky(b, k, None));
        let landed = found.halves.iter().map(|h| h.weights.iter().sum::<f32>()).sum::<f32>() * 0.5;
        let mean = values(halves, skies, landed);
        // Shown normals may be spread where the surface is flat.
        let cos = |&i: &u32| block.normal.dot(normal(i as usize));
        let shown = system.blocks.members(b).iter().map(cos).fold(1.0, f32::min).clamp(-1.0, 1.0).acos();
        let spread = block.spread.max(shown);
        if spread < FLAT {
            return Self::Flat(mean);
        }
        let mut curved = Curved::new(system, radiosity, spread, b);
        curved.scale_to(&mean, system.blocks, normal, b);
        Self::Curved(Box::new(curved))
    }

    /// The values about `normal` (unit).
    pub fn at(&self, normal: Vec3) -> Values {
        match self {
            Self::Flat(values) => *values,
            Self::Curved(curved) => curved.at(normal),
        }
    }

    /// The response with its values `from` at the mean normal taken to `to`.
    pub fn moved(self, from: &Values, to: &Values) -> Self {
        match self {
            Self::Flat(_) => Self::Flat(*to),
            Self::Curved(mut curved) => {
                for k in 0..to.len() {
                    if k == DIFFERENCE || from[k] <= 0.0 {
                        curved.nodes.iter_mut().for_each(|n| n[k] += to[k] - from[k]);
                    } else {
                        let ratio = (to[k] / from[k]).clamp(0.0, 4.0);
                        curved.nodes.iter_mut().for_each(|n| n[k] *= ratio);
                    }
                }
                Self::Curved(curved)
            }
        }
    }
}

fn values(halves: [Rgb; 2], skies: [Rgb; 2], landed: f32) -> Values {
    let [first, second] = [halves[0] + skies[0], halves[1] + skies[1]];
    let (all, sky) = (0.5 * (first + second), 0.5 * (skies[0] + skies[1]));
    [all.x, all.y, all.z, sky.x, sky.y, sky.z, 0.5 * luminance(first - second), landed]
}

impl Curved {
    fn new(system: &System, radiosity: &Radiosity, spread: f32, b: usize) -> Self {
        let (block, found) = (&system.blocks.list[b], &system.sampled[b]);
        let reach = (1.2 * spread.min(1.0)).sin().clamp(REACH[0], REACH[1]);
        let (x, y) = block.normal.any_orthonormal_pair();
        let mut curved = Self { tangents: [x, y], reach, nodes: [[0.0; 8]; 9] };
        let normals: [Vec3; 9] = std::array::from_fn(|node| {
            let [u, v] = [node % 3, node / 3].map(|k| (k as f32 - 1.0) * reach);
            x * u + y * v + block.normal * (1.0 - u * u - v * v).max(0.0).sqrt()
        });
        let mut sums = [[Rgb::ZERO; 2]; 9];
        let mut landed = [0.0f32; 9];
        for (k, half) in found.halves.iter().enumerate() {
            for (link, weight, tint) in half.seen() {
                let direction = link.direction();
                let (_, w) = found.drawn.solid_angle(direction, weight);
                let radiance = radiosity.at(link.target()) * tint * FRAC_1_PI;
                for node in 0..9 {
                    let share = normals[node].dot(direction).max(0.0) * w;
                    sums[node][k] += radiance * share;
                    landed[node] += 0.5 * FRAC_1_PI * share;
                }
            }
        }
        for node in 0..9 {
            let skies = [0, 1].map(|k| system.sky(b, k, Some(normals[node])));
            curved.nodes[node] = values(sums[node], skies, landed[node]);
        }
        curved
    }

    fn at(&self, normal: Vec3) -> Values {
        let weights = |tangent: Vec3| {
            let x = (normal.dot(tangent) / self.reach).clamp(-1.0, 1.0);
            [0.5 * (x * x - x), 1.0 - x * x, 0.5 * (x * x + x)]
        };
        let [u, v] = self.tangents.map(weights);
        let mut sum = [0.0; 8];
        for (k, node) in self.nodes.iter().enumerate() {
            let w = u[k % 3] * v[k / 3];
            sum.iter_mut().zip(node).for_each(|(s, n)| *s += w * n);
        }
        sum
    }

    /// Scales the nodes so that the mean over the block's texels is `mean`: no light is made or lost by how it is shown.
    fn scale_to(&mut self, mean: &Values, blocks: &Blocks, normal: &dyn Fn(usize) -> Vec3, b: usize) {
        let block = &blocks.list[b];
        let mut shown = [0.0f32; 8];
        for (k, &i) in (block.first as usize..).zip(blocks.members(b)) {
            let share = blocks.area(k) / block.area.max(f32::MIN_POSITIVE);
            shown.iter_mut().zip(self.at(normal(i as usize))).for_each(|(s, v)| *s += v * share);
        }
        for k in (0..8).filter(|&k| k != DIFFERENCE && shown[k] > 0.0) {
            let ratio = (mean[k] / shown[k]).clamp(0.5, 2.0);
            self.nodes.iter_mut().for_each(|n| n[k] *= ratio);
        }
    }
}
