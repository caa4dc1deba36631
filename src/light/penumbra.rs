//! Penumbrae without grain.
//!
//! In a penumbra each patch has a share of its own of a light, from shadow rays of its own: grain, unless they are many. A plane through a
//! patch and those around it has a third of that noise, but blurs what is finer. How noisy each patch is follows from its samples,
//! so what the differences to the plane have beyond that is detail, and is kept in proportion (Wiener 1949): a soft shadow comes
//! out smooth with few rays, and the edge of a sharp one stays where it is.
//!
//! Where it is known what would arrive with nothing in the way, it is the visible share that is smoothed: light of one lamp alone varies in
//! ways that shadows have no part in, as close to it or in a corner, and a plane would cut them off.
//!
//! Buried patches have no light and say nothing. Patches that are partly buried lie at a wall or a contact, with other light beyond it:
//! they are looked at once more in place of being smoothed.

use super::receiver::Arriving;
use crate::color::luminance;
use crate::patch::footprint::CellMask;
use crate::patch::{Ground, unocclude::Exposure};
use crate::plane::Plane;
use glam::Vec2;
use rayon::prelude::*;

/// Neighbours that face further away than this cosine say nothing about a patch.
const ALIKE: f32 = 0.95;

/// Weights of neighbours at a side and at a corner, beside 1 for the patch itself.
const SIDE: f32 = 0.8;
const CORNER: f32 = 0.6;

/// Slopes are held back by this share of the weights.
const RIDGE: f32 = 0.02;

/// Planes through fewer patches than this say nothing.
const LEAST: usize = 5;

/// A patch without noise, among [`Penumbra::place`].
const CLEAR: u32 = u32::MAX;

/// What planes through the patches around say of noisy ones.
pub(super) struct Penumbra {
    /// The noisy patches, in order.
    pub patches: Vec<u32>,
    fits: Vec<Option<Fit>>,
    /// The share of each one's difference to its plane that is kept.
    pub kept: Vec<f32>,
}

/// What would arrive unoccluded may differ so many times between patches that share a plane.
const MOST_UNLIKE: f32 = 4.0;

/// What a plane says of a patch.
struct Fit {
    value: Arriving,
    /// Square of the difference to the patch's own, and what of it is to be expected of noise [lx^2].
    square: f32,
    noise: f32,
}

impl Penumbra {
    /// From what arrives at patches, and the `variance` of each [lx^2] (luminance), 0 where there is no noise.
    pub fn new(ground: &Ground, exposure: &Exposure, arriving: &[Arriving], variance: &[f32]) -> Self {
        let patches: Vec<u32> = (0..variance.len() as u32).filter(|&i| variance[i as usize] > 0.0).collect();
        let mut place = vec![CLEAR; variance.len()];
        patches.iter().enumerate().for_each(|(k, &i)| place[i as usize] = k as u32);
        let fits: Vec<Option<Fit>> =
            patches.par_iter().map(|&i| Fit::new(ground, exposure, arriving, variance, i as usize)).collect();
        let kept = |(k, &i): (usize, &u32)| {
            if exposure.cells[i as usize] != CellMask::ALL {
                return 1.0;
            }
            let around =
                ground.neighbours(i as usize).map(|j| place[j]).filter(|&k| k != CLEAR).map(|k| (k as usize, 1.0));
            let (mut square, mut noise) = (0.0, 0.0);
            for (fit, weight) in around.chain([(k, 2.0)]).filter_map(|(k, weight)| Some((fits[k].as_ref()?, weight))) {
                square += weight * fit.square;
                noise += weight * fit.noise;
            }
            if square > 0.0 { ((square - noise) / square).clamp(0.0, 1.0) } else { 0.0 }
        };
        let kept = patches.par_iter().enumerate().map(kept).collect();
        Self { patches, fits, kept }
    }

    /// Takes the noise out.
    pub fn settle(&self, arriving: &mut [Arriving]) {
        for ((&i, fit), kept) in self.patches.iter().zip(&self.fits).zip(&self.kept) {
            let Some(fit) = fit else { continue };
            let own = &mut arriving[i as usize];
            own.transport = fit.value.transport.lerp(own.transport, *kept);
            own.shown = fit.value.shown.lerp(own.shown, *kept);
            own.other = fit.value.other.lerp(own.other, *kept);
        }
    }
}

impl Fit {
    /// The plane through patch `i` and those around it; `None` where they are too few.
    fn new(ground: &Ground, exposure: &Exposure, arriving: &[Arriving], variance: &[f32], i: usize) -> Option<Self> {
        let normals = &ground.patches.normal;
        let at = |i: usize| Vec2::from(ground.column_row(i).map(|c| c as f32));
        let near = |j: usize| {
            let d = at(j) - at(i);
            (j, if d.x == 0.0 || d.y == 0.0 { SIDE } else { CORNER }, d)
        };
        let is_alike = |j: &usize| !exposure.is_buried(*j) && normals[*j].dot(normals[i]) > ALIKE;
        let alike = ground.neighbours(i).filter(is_alike).map(near);
        let mut all = [(i, 1.0, Vec2::ZERO); 9];
        let mut count = 1;
        for (slot, near) in all[1..].iter_mut().zip(alike) {
            *slot = near;
            count += 1;
        }
        if count < LEAST {
            return None;
        }
        let mut plane = Plane::default();
        all[..count].iter().for_each(|(_, weight, d)| plane.add(*weight, *d));
        let shares = plane.shares(RIDGE, 1.0)?;
        let mut ratios = [1.0; 9];
        for (ratio, (j, ..)) in ratios.iter_mut().zip(&all[..count]) {
            *ratio = arriving[i].whole / arriving[*j].whole;
        }
        let is_known = |ratio: &f32| (MOST_UNLIKE.recip()..=MOST_UNLIKE).contains(ratio);
        if !ratios[..count].iter().all(is_known) {
            ratios = [1.0; 9];
        }
        let (mut value, mut noise) = (Arriving::default(), 0.0);
        for ((j, weight, d), ratio) in all[..count].iter().zip(ratios) {
            let share = ratio * shares.of(*weight, *d);
            value.transport += arriving[*j].transport * share;
            value.shown += arriving[*j].shown * share;
            value.other += arriving[*j].other * share;
            let beside = if *j == i { 1.0 - share } else { share };
            noise += beside * beside * variance[*j];
        }
        value.transport = value.transport.max(glam::Vec3::ZERO);
        value.shown = value.shown.max(glam::Vec3::ZERO);
        value.other = value.other.max(glam::Vec3::ZERO);
        let difference = luminance(arriving[i].transport) - luminance(value.transport);
        Some(Self { value, square: difference * difference, noise })
    }
}
