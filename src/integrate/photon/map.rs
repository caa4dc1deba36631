//! Photons in space, and what they say of the light at a place: a grid of cells two radii wide, in a table by hash.

use crate::color::Rgb;
use crate::integrate::{Kind, Vertex};
use crate::scatter::Transport;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Light that landed.
#[derive(Clone, Copy, Debug)]
pub struct Photon {
    /// World position [m].
    pub position: Vec3,
    /// Unit, back to where it came from.
    pub towards: Vec3,
    /// The triangle's normal on the side that it came from; zero in media.
    pub normal: Vec3,
    /// On a surface the flux that landed [lm]; in a medium the flux that was scattered over the scattering coefficient [lm m].
    pub flux: Rgb,
    /// How often it was scattered before.
    pub bounces: u32,
}

impl Photon {
    /// True where it was left in space.
    pub fn is_in_medium(&self) -> bool {
        self.normal == Vec3::ZERO
    }
}

/// Photons of one kind, all on surfaces or all in media, in the order of the cells that they lie in.
pub struct Map {
    photons: Vec<Photon>,
    /// Where each row of the table begins among the photons; one more than there are rows.
    starts: Vec<u32>,
    radius: f32,
}

/// The least cosine between the normals of a photon and of the place that it is read at.
const LIKE: f32 = 0.8;

/// How far photons lie off the plane of the place, over the radius, at most.
const THICKNESS: f32 = 0.25;

/// The least cosine that the density of photons is divided by.
const LEAST_COSINE: f32 = 1e-3;

/// Photons whose neighbours choose the first radius.
const ASKED: usize = 64;

impl Map {
    /// A map that is read within `radius` [m].
    pub fn new(photons: Vec<Photon>, radius: f32) -> Self {
        let rows = photons.len().next_power_of_two();
        let row: Vec<u32> = photons.par_iter().map(|photon| row(cell(photon.position, radius), rows)).collect();
        let mut starts = vec![0; rows + 1];
        for &row in &row {
            starts[row as usize + 1] += 1;
        }
        for k in 0..rows {
            starts[k + 1] += starts[k];
        }
        let mut place = starts.clone();
        let mut order = vec![0; photons.len()];
        for (k, &row) in row.iter().enumerate() {
            order[place[row as usize] as usize] = k;
            place[row as usize] += 1;
        }
        let photons = order.into_par_iter().map(|k| photons[k]).collect();
        Self { photons, starts, radius }
    }

    /// The radius [m].
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// The light that photons around `vertex` bring and that goes back along its path [nit], of those that were scattered `most` times
    /// before, at most.
    ///
    /// Silverman's kernels (1986, section 4.2.1): 2 / (pi r^2) (1 - d^2 / r^2) over a disc, 15 / (8 pi r^3) (1 - d^2 / r^2) over a ball.
    pub fn read(&self, vertex: &Vertex, most: Option<u32>) -> Rgb {
        if self.photons.is_empty() {
            return Rgb::ZERO;
        }
        let (square, mut sum) = (self.radius * self.radius, Rgb::ZERO);
        let is_counted = |photon: &Photon| most.is_none_or(|most| photon.bounces <= most);
        match &vertex.kind {
            Kind::Medium(_) => {
                self.around(vertex.position, |photon, distance| {
                    if is_counted(photon) {
                        let phase = vertex.respond(photon.towards, Transport::Radiance);
                        sum += photon.flux * phase * (1.0 - distance / square);
                    }
                });
                sum * (15.0 / (8.0 * PI * square * self.radius))
            }
            Kind::Surface(on) => {
                let normal = on.front_towards(vertex.back);
                self.around(vertex.position, |photon, distance| {
                    let height = (photon.position - vertex.position).dot(normal).abs();
                    let is_like = photon.normal.dot(normal) >= LIKE && height <= THICKNESS * self.radius;
                    if is_like && is_counted(photon) {
                        // The density of photons holds the cosine already.
                        let cosine = photon.normal.dot(photon.towards).abs().max(LEAST_COSINE);
                        let reflected = vertex.respond(photon.towards, Transport::Radiance) / cosine;
                        sum += photon.flux * reflected * (1.0 - distance / square);
                    }
                });
                sum * (2.0 / (PI * square))
            }
        }
    }

    /// Calls `visit` with each photon within the radius of `at`, and its squared distance [m^2], in a fixed order.
    fn around(&self, at: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let square = self.radius * self.radius;
        let low = cell(at - self.radius, self.radius);
        let rows = self.starts.len() - 1;
        // Cells of one row are looked at once.
        let mut seen = [u32::MAX; 8];
        for k in 0..8 {
            let row = row([0, 1, 2].map(|axis| low[axis].wrapping_add(k as i32 >> axis & 1)), rows);
            if seen[..k].contains(&row) {
                continue;
            }
            seen[k] = row;
            let [start, end] = [0, 1].map(|next| self.starts[row as usize + next] as usize);
            for photon in &self.photons[start..end] {
                let distance = photon.position.distance_squared(at);
                if distance < square {
                    visit(photon, distance);
                }
            }
        }
    }
}

/// The cell that a position lies in.
fn cell(position: Vec3, radius: f32) -> [i32; 3] {
    (position / (2.0 * radius)).floor().to_array().map(|n| n as i32)
}

/// The row of a cell (Teschner et al. 2003, "Optimized Spatial Hashing"), of a power of two of them.
fn row(cell: [i32; 3], rows: usize) -> u32 {
    let [x, y, z] = cell.map(|n| n as u32);
    let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
    (hash ^ hash >> 15) & (rows - 1) as u32
}

/// The radius [m] within which the median photon has `neighbours` others that face as it does; `None` where there are fewer photons.
pub fn radius_of(photons: &[Photon], neighbours: usize) -> Option<f32> {
    if photons.len() <= neighbours {
        return None;
    }
    let asked = photons.len().min(ASKED);
    let mut distances: Vec<f32> = (0..asked)
        .into_par_iter()
        .map(|k| {
            let own = &photons[k * photons.len() / asked];
            let is_like = |other: &&Photon| own.is_in_medium() || own.normal.dot(other.normal) >= LIKE;
            let distance = |other: &Photon| own.position.distance_squared(other.position);
            let mut squares: Vec<f32> = photons.iter().filter(is_like).map(distance).collect();
            let nth = neighbours.min(squares.len() - 1);
            squares.select_nth_unstable_by(nth, f32::total_cmp).1.sqrt()
        })
        .collect();
    let middle = asked / 2;
    Some(*distances.select_nth_unstable_by(middle, f32::total_cmp).1)
}
