//! Shadow masks: the visible share of one light at every patch, for engines that add the light itself in real time.
//!
//! The share is what arrives over what would arrive if nothing blocked it, both found as all direct light is, so that it is exactly 1
//! without a shadow and as smooth as the baked shadow is. Where the light doesn't reach a patch at all, behind its horizon or outside of
//! a cone, it is 0.

use super::direct::direct;
use super::{Lights, Lit, Shining};
use crate::Result;
use crate::color::luminance;
use crate::progress::Progress;
use crate::scene::{BakeMode, Scene};

/// Masks of one bake, at most: each is a channel of every page.
pub const MOST_MASKS: usize = 16;

/// The lights of `scene` that masks are made of, by number: those that say so, and besides, unless they refuse, those that are not
/// wholly baked; where there are none of either, all that don't refuse. At most [`MOST_MASKS`]; the second list is of those beyond.
pub fn masked_lights(scene: &Scene) -> (Vec<usize>, Vec<usize>) {
    let said = |l: usize| scene.lights[l].contribution.shadow_mask;
    let is_live = |l: usize| scene.lights[l].contribution.mode() != BakeMode::Baked;
    let all = 0..scene.lights.len();
    let mut chosen: Vec<usize> = all.clone().filter(|&l| said(l).unwrap_or_else(|| is_live(l))).collect();
    if chosen.is_empty() {
        chosen = all.filter(|&l| said(l) != Some(false)).collect();
    }
    let beyond = chosen.split_off(MOST_MASKS.min(chosen.len()));
    (chosen, beyond)
}

/// The visible share of light number `light` at every patch, 0..=1, and the rays that took.
///
/// # Errors
/// `Cancelled`.
pub fn shadow_mask(lit: &Lit, light: usize, progress: &dyn Progress) -> Result<(Vec<f32>, u64)> {
    let scene = lit.ground.scene;
    let own = || Lights::of(scene, |shining| matches!(shining, Shining::Light(l) if l == light));
    let seen = direct(&Lit { lights: &own(), ..*lit }, progress)?;
    let whole = direct(&Lit { lights: &own().unblocked(), ..*lit }, progress)?;
    let share = |(seen, whole): (&_, &_)| {
        let (seen, whole) = (luminance(*seen), luminance(*whole));
        if whole > 0.0 { (seen / whole).clamp(0.0, 1.0) } else { 0.0 }
    };
    Ok((seen.transport.iter().zip(whole.transport.iter()).map(share).collect(), seen.rays))
}
