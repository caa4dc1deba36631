//! Parts of the light as layers of their own. Those of bounces are the terms of the Neumann series L_e, K L_e, K^2 L_e, ...
//! of the rendering equation, the last with all that follow. They add up to the page, `emitted` included where the quantity is
//! radiosity, and without it where it is not.

use super::dilate::{Finish, fill};
use super::{Layer, LayerKind, Quantity};
use crate::color::Rgb;
use crate::gather::Gathered;
use crate::light::Direct;
use std::f32::consts::PI;

/// The layers `wanted` of a bake, in the quantity of its pages.
pub fn layers(
    to: &Finish,
    direct: &Direct,
    gathered: &Gathered,
    wanted: &[LayerKind],
    quantity: Quantity,
) -> Vec<Layer> {
    if wanted.is_empty() {
        return Vec::new();
    }
    let lit = &to.lit;
    let n = gathered.irradiance.len();
    let straight: Vec<Rgb> = (0..n).map(|i| direct.shown[i] + gathered.sky[i]).collect();
    let reflected: Vec<Rgb> = (0..n).map(|i| gathered.indirect[i] - gathered.sky[i]).collect();
    let pages = |value: &dyn Fn(usize) -> Rgb| fill(to, value).into_iter().map(|page| page.rgb).collect::<Vec<_>>();
    let layer = |name: String, irradiance: &[Rgb]| Layer {
        name,
        pages: pages(&|i| quantity.of(irradiance[i], lit.reflectance.0[i])),
    };
    let mut all = Vec::new();
    for kind in wanted {
        match kind {
            LayerKind::Direct => all.push(layer("direct".into(), &straight)),
            LayerKind::Indirect => all.push(layer("indirect".into(), &reflected)),
            LayerKind::Error => all.push(layer("error".into(), &gathered.standard_error)),
            LayerKind::Bounces => {
                let emitted = |i: usize| lit.emission.0[i] * if quantity == Quantity::Outgoing { 1.0 } else { PI };
                all.push(Layer { name: "emitted".into(), pages: pages(&emitted) });
                all.push(layer("bounce0".into(), &straight));
                // What is reflected once is read at the texels themselves.
                let once = |i: usize| reflected[i] - gathered.parts.iter().map(|p| p[i]).sum::<Rgb>();
                all.push(layer("bounce1".into(), &(0..n).map(once).collect::<Vec<Rgb>>()));
                for (k, part) in gathered.parts.iter().enumerate() {
                    let is_last = k + 1 == gathered.parts.len();
                    all.push(layer(if is_last { "rest".into() } else { format!("bounce{}", k + 2) }, part));
                }
            }
        }
    }
    all
}
