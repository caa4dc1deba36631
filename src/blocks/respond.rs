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
    grid: Grid,
    nodes: [Values; 9],
}

/// 3 x 3 normals around a mean.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    tangents: [Vec3; 2],
    /// Sine of the outer nodes' angles to the mean along each tangent.
    reach: f32,
}

impl Grid {
    /// Around `mean` (unit), for normals that are spread by so much [rad].
    pub fn new(mean: Vec3, spread: f32) -> Self {
        let reach = (1.2 * spread.min(1.0)).sin().clamp(REACH[0], REACH[1]);
        let (x, y) = mean.any_orthonormal_pair();
        Self { tangents: [x, y], reach }
    }

    /// The nodes around `mean`, unit.
    pub fn normals(&self, mean: Vec3) -> [Vec3; 9] {
        let [x, y] = self.tangents;
        std::array::from_fn(|node| {
            let [u, v] = [node % 3, node / 3].map(|k| (k as f32 - 1.0) * self.reach);
            x * u + y * v + mean * (1.0 - u * u - v * v).max(0.0).sqrt()
        })
    }

    /// What is read between `nodes` about `normal`.
    pub fn read<const N: usize>(&self, nodes: &[[f32; N]; 9], normal: Vec3) -> [f32; N] {
        let weights = |tangent: Vec3| {
            let x = (normal.dot(tangent) / self.reach).clamp(-1.0, 1.0);
            [0.5 * (x * x - x), 1.0 - x * x, 0.5 * (x * x + x)]
        };
        let [u, v] = self.tangents.map(weights);
        let mut sum = [0.0; N];
        for (k, node) in nodes.iter().enumerate() {
            let w = u[k % 3] * v[k / 3];
            sum.iter_mut().zip(node).for_each(|(s, n)| *s += w * n);
        }
        sum
    }
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

/// Largest angle of a normal of block `b` to the mean [rad], of those that are shown, too: they may be spread where the surface is flat.
fn spread(blocks: &Blocks, b: usize, normal: &dyn Fn(usize) -> Vec3) -> f32 {
    let block = &blocks.list[b];
    let cos = |&i: &u32| block.normal.dot(normal(i as usize));
    let shown = blocks.members(b).iter().map(cos).fold(1.0, f32::min).clamp(-1.0, 1.0).acos();
    block.spread.max(shown)
}

/// True where one value doesn't do for all normals of block `b`. Backs, which nobody shows, have one.
pub fn is_curved(blocks: &Blocks, b: usize, normal: &dyn Fn(usize) -> Vec3) -> bool {
    !blocks.list[b].back && spread(blocks, b, normal) >= FLAT
}

impl Response {
    /// How block `b` answers while patches send `radiosity`, and the variance of one of its samples [lx^2] (luminance); `normal` is the one
    /// that a patch shows.
    pub fn new(system: &System, radiosity: &Radiosity, normal: &dyn Fn(usize) -> Vec3, b: usize) -> (Self, f32) {
        let found = &system.sampled[b];
        let gleaned = [0, 1].map(|k| system.glean(b, k, radiosity));
        let variance = 0.5 * gleaned.iter().map(|half| half.variance(found.drawn.samples())).sum::<f32>();
        let (halves, skies) = (gleaned.map(|half| half.links), gleaned.map(|half| half.sky));
        let landed = found.halves.iter().map(|h| h.weights.iter().sum::<f32>()).sum::<f32>() * 0.5;
        let mean = values(halves, skies, landed);
        let spread = spread(system.blocks, b, normal);
        if spread < FLAT {
            return (Self::Flat(mean), variance);
        }
        let mut curved = Curved::new(system, radiosity, spread, b);
        curved.scale_to(&mean, system.blocks, normal, b);
        (Self::Curved(Box::new(curved)), variance)
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
        let grid = Grid::new(block.normal, spread);
        let normals = grid.normals(block.normal);
        let mut curved = Self { grid, nodes: [[0.0; 8]; 9] };
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
        self.grid.read(&self.nodes, normal)
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
