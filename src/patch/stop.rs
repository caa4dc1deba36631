//! What patches that light passes stop of it.
//!
//! A patch of which a share q of the light ends, and 1 - q goes on, counts with q of its area wherever light is received, sent or drawn:
//! a leaf cut out of its card counts as the leaf. Its albedo and emission are those of what is stopped, so that area times albedo is
//! what it sends back. Where it passes one channel more than another, q is the mean, and `taking` has the rest.

use super::Ground;
use super::footprint::Piece;
use super::reflectance::{grid, passing_at};
use crate::color::Rgb;
use crate::scene::material::mean_share;
use rayon::prelude::*;

/// The share of light that each patch stops.
#[derive(Clone, Debug)]
pub struct Stops {
    share: Vec<f32>,
    /// Of patches that stop some channels more than others, ascending: what each stops more than the mean.
    hue: Vec<(u32, Rgb)>,
}

/// Patches that let (almost) everything through are taken to stop this share: nothing is divided by 0, and no more light is lost.
pub const LEAST_STOP: f32 = 1e-4;

impl Stops {
    /// Averages over all footprints; `None` where no material lets light through.
    pub fn new(ground: &Ground) -> Option<Self> {
        let scene = ground.scene;
        let clear: Vec<bool> = scene.materials.iter().map(|m| m.lets_light_through()).collect();
        let is_clear = |triangle: u32| {
            let (surface, triangle) = ground.tracer.place(triangle);
            clear[scene.meshes[scene.surfaces[surface].mesh].triangle_material[triangle] as usize]
        };
        if !clear.contains(&true) {
            return None;
        }
        let of = |i: usize| match ground.patches.pieces(i).any(|(triangle, _)| is_clear(triangle)) {
            true => average(ground, i),
            false => (1.0, Rgb::ZERO),
        };
        let (share, hues): (Vec<f32>, Vec<Rgb>) = (0..ground.patches.len()).into_par_iter().map(of).unzip();
        let hue = (0..).zip(hues).filter(|(_, hue)| *hue != Rgb::ZERO).collect();
        Some(Self { share, hue })
    }

    /// The mean share over the channels that patch `i` stops, more than 0.
    pub fn share(&self, i: usize) -> f32 {
        self.share[i]
    }

    /// What patch `i` stops of each channel, over the mean.
    pub fn taking(&self, i: usize) -> Rgb {
        let hue = self.hue.binary_search_by_key(&(i as u32), |h| h.0).map_or(Rgb::ZERO, |k| self.hue[k].1);
        Rgb::ONE + hue / self.share[i]
    }
}

fn average(ground: &Ground, i: usize) -> (f32, Rgb) {
    let (mut sum, mut area) = (Rgb::ZERO, 0.0);
    for piece in &ground.footprint(i).pieces {
        sum += average_piece(ground, piece) * piece.area;
        area += piece.area;
    }
    let passes = if area > 0.0 { sum / area } else { Rgb::ZERO };
    let mean = mean_share(passes);
    ((1.0 - mean).max(LEAST_STOP), Rgb::splat(mean) - passes)
}

fn average_piece(ground: &Ground, piece: &Piece) -> Rgb {
    let (scene, triangle) = (ground.scene, piece.facet.triangle);
    let mesh = &scene.meshes[scene.surfaces[piece.facet.surface].mesh];
    let (mut sum, mut count) = (Rgb::ZERO, 0.0f32);
    grid(scene, piece, |at| {
        sum += passing_at(scene, mesh, triangle, at).1;
        count += 1.0;
    });
    sum / count
}
