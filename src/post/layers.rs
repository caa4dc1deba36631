//! Parts of the light, and of what it depends on, as layers of their own beside the whole.
//!
//! Those of bounces are the terms of the Neumann series L_e, K L_e, K^2 L_e, ... of the rendering equation, the last with all that
//! follow. They add up to the page, `emitted` included where the quantity is radiosity, and without it where it is not. Light groups
//! add up to the page in any quantity: of radiosity each has what its own materials emit.

use super::dilate::{Finish, fill};
use super::{Channels, Layer, LayerKind, Quantity};
use crate::Result;
use crate::color::Rgb;
use crate::gather::Gathered;
use crate::light::mask::{masked_lights, shadow_mask};
use crate::light::{Direct, Lit};
use crate::openness::{Openness, OpennessParams, openness};
use crate::progress::Progress;
use crate::scene::contribution::UNGROUPED;
use glam::Vec3;
use std::collections::BTreeSet;
use std::f32::consts::PI;

/// What the names of layers of light groups begin with.
pub const GROUP: &str = "group.";

/// The light of one group.
#[derive(Clone, Debug)]
pub struct Group {
    pub name: String,
    /// What its lights, materials and skies cause, by patch [lx].
    pub irradiance: Vec<Rgb>,
}

/// Lets `groups`, the parts of the irradiance `from`, add up to `to`, texel by texel and channel by channel: each by the share that it had
/// there, or an even one where nothing had any.
pub fn follow(groups: &mut [Group], from: &[Rgb], to: &[Rgb]) {
    let even = Rgb::splat(1.0 / groups.len().max(1) as f32);
    for group in groups {
        for ((own, from), to) in group.irradiance.iter_mut().zip(from).zip(to) {
            *own = *to * Rgb::select(from.cmpgt(Rgb::ZERO), *own / *from, even);
        }
    }
}

/// The light that layers are made of.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub to: &'a Finish<'a>,
    pub direct: &'a Direct,
    pub gathered: &'a Gathered,
    pub groups: &'a [Group],
    /// Light over mirrors and glass that counts as direct [lx], by patch; empty where there is none.
    pub caustics: &'a [Rgb],
}

/// What is asked of layers.
#[derive(Clone, Debug)]
pub struct LayerParams {
    pub wanted: Vec<LayerKind>,
    /// That of the pages.
    pub quantity: Quantity,
    /// Rays a texel that look at the surroundings.
    pub samples: u32,
    /// How far away things occlude [m]; `None`: however far.
    pub ao_distance: Option<f32>,
    pub seed: u32,
}

/// The layers that `params` ask for, and the rays that they took.
///
/// # Errors
/// `Cancelled`.
pub fn layers(sources: &Sources, params: &LayerParams, progress: &dyn Progress) -> Result<(Vec<Layer>, u64)> {
    if params.wanted.is_empty() {
        return Ok((Vec::new(), 0));
    }
    let has = |kind| params.wanted.contains(&kind);
    let (near, sky) = (has(LayerKind::Ao) || has(LayerKind::BentNormal), has(LayerKind::SkyVisibility));
    let open = match near || sky {
        true => {
            let LayerParams { samples, ao_distance: distance, seed, .. } = *params;
            openness(&sources.to.lit, &OpennessParams { samples, distance, near, sky, seed }, progress)?
        }
        false => Openness::default(),
    };
    let mut rays = open.rays;
    let mut all = Vec::new();
    for kind in &params.wanted {
        match kind {
            LayerKind::Ao => all.push(share(sources.to, "ao", &open.ambient)),
            LayerKind::SkyVisibility => all.push(share(sources.to, "sky-visibility", &open.sky)),
            LayerKind::BentNormal => all.push(directions(sources.to, "bent-normal", &open.bent)),
            LayerKind::ShadowMasks => rays += shadow_masks(sources.to, &mut all, progress)?,
            kind => sources.light(*kind, params.quantity, &mut all),
        }
    }
    Ok((all, rays))
}

impl Sources<'_> {
    /// Adds the layers of a kind of light.
    fn light(&self, kind: LayerKind, quantity: Quantity, all: &mut Vec<Layer>) {
        let Self { to, direct, gathered, groups, caustics } = *self;
        let lit = &to.lit;
        let straight = |i: usize| direct.shown[i] + gathered.sky[i];
        let reflected = |i: usize| gathered.indirect[i] - gathered.sky[i];
        let layer = |name: &str, irradiance: &dyn Fn(usize) -> Rgb| {
            light(to, name, quantity.unit(), |i| quantity.of(irradiance(i), lit.reflectance.0[i]))
        };
        match kind {
            LayerKind::Direct => all.push(layer("direct", &straight)),
            LayerKind::Indirect => all.push(layer("indirect", &reflected)),
            LayerKind::Caustics => {
                all.push(layer("caustics", &|i| caustics.get(i).copied().unwrap_or(Rgb::ZERO)));
            }
            LayerKind::Error => all.push(layer("error", &|i| gathered.standard_error[i])),
            LayerKind::Emission => all.push(emission(&to.without_seams(), "emission", quantity)),
            LayerKind::Bounces => {
                // Pages of radiosity have it in them, and go through their seams with it.
                let apart = to.without_seams();
                let to = if quantity == Quantity::Radiosity { to } else { &apart };
                all.push(emission(to, "emitted", quantity));
                all.push(layer("bounce0", &straight));
                // What is reflected once is read at the texels themselves.
                let once = |i: usize| reflected(i) - gathered.parts.iter().map(|p| p[i]).sum::<Rgb>();
                all.push(layer("bounce1", &once));
                for (k, part) in gathered.parts.iter().enumerate() {
                    let name = if k + 1 == gathered.parts.len() { "rest".into() } else { format!("bounce{}", k + 2) };
                    all.push(layer(&name, &|i| part[i]));
                }
            }
            LayerKind::LightGroups => {
                let emitting = emitting_groups(lit, groups, quantity);
                for (k, group) in groups.iter().enumerate() {
                    let glow = |i: usize| {
                        let is_own = emitting.get(i) == Some(&(k as u32));
                        if is_own { lit.emission.0[i] * PI } else { Rgb::ZERO }
                    };
                    let value = |i: usize| quantity.of(group.irradiance[i], lit.reflectance.0[i]) + glow(i);
                    let layer = light(to, &format!("{GROUP}{}", group.name), quantity.unit(), value);
                    all.push(Layer { of: Some(group.name.clone()), ..layer });
                }
            }
            LayerKind::Ao | LayerKind::BentNormal | LayerKind::SkyVisibility | LayerKind::ShadowMasks => {}
        }
    }
}

/// The group that each patch emits in, by place among `groups`; empty where emission is not in the quantity.
fn emitting_groups(lit: &Lit, groups: &[Group], quantity: Quantity) -> Vec<u32> {
    if quantity != Quantity::Radiosity || groups.is_empty() {
        return Vec::new();
    }
    let place = |name: &str| groups.iter().position(|g| g.name == name).unwrap_or(groups.len() - 1) as u32;
    let materials = &lit.ground.scene.materials;
    let of_material: Vec<u32> =
        materials.iter().map(|m| place(m.contribution.group.as_deref().unwrap_or(UNGROUPED))).collect();
    let of_patch = |i: usize| {
        let (surface, triangle) = lit.ground.tracer.place(lit.ground.patches.first_triangle(i));
        let mesh = &lit.ground.scene.meshes[lit.ground.scene.surfaces[surface].mesh];
        of_material[mesh.triangle_material[triangle] as usize]
    };
    (0..lit.ground.patches.len()).map(of_patch).collect()
}

/// A layer of light.
fn light(to: &Finish, name: &str, unit: &'static str, value: impl Fn(usize) -> Rgb) -> Layer {
    let pages = fill(to, value).into_iter().map(|page| page.rgb).collect();
    Layer { name: name.into(), pages, channels: Channels::Rgb, unit, of: None }
}

/// What surfaces emit: radiance, or where pages hold densities of flux, emittance.
fn emission(to: &Finish, name: &str, quantity: Quantity) -> Layer {
    let (factor, unit) = if quantity == Quantity::Outgoing { (1.0, "nit") } else { (PI, "lm/m^2") };
    light(to, name, unit, |i| to.lit.emission.0[i] * factor)
}

/// A layer of shares, 0..=1.
fn share(to: &Finish, name: &str, values: &[f32]) -> Layer {
    Layer { channels: Channels::Y, ..light(to, name, "1", |i| Rgb::splat(values[i])) }
}

/// A layer of unit vectors in the world; what is filled in between is made unit again.
fn directions(to: &Finish, name: &str, values: &[Vec3]) -> Layer {
    let mut layer = Layer { channels: Channels::Xyz, ..light(to, name, "1", |i| values[i]) };
    layer.pages.iter_mut().flatten().for_each(|v| *v = v.normalize_or_zero());
    layer
}

/// Adds the mask of each chosen light, and returns the rays that took.
fn shadow_masks(to: &Finish, all: &mut Vec<Layer>, progress: &dyn Progress) -> Result<u64> {
    let mut rays = 0;
    let mut names = BTreeSet::new();
    for l in masked_lights(to.lit.ground.scene).0 {
        let (mask, traced) = shadow_mask(&to.lit, l, progress)?;
        rays += traced;
        let light = &to.lit.ground.scene.lights[l].name;
        let name = channel_name(light, &mut names);
        all.push(Layer { of: Some(light.clone()), ..share(to, &format!("shadow.{name}"), &mask) });
    }
    Ok(rays)
}

/// A name for channels of the light `name` that none in `taken` has: in EXR a dot parts layers, and few programs like a slash.
fn channel_name(name: &str, taken: &mut BTreeSet<String>) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let base: String = name.trim_start_matches('/').chars().map(plain).collect();
    let numbered = (2..).map(|n| format!("{base}_{n}"));
    let free = std::iter::once(base.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or(base.clone());
    taken.insert(free.clone());
    free
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_of_lights_have_names_of_their_own() {
        let mut taken = BTreeSet::new();
        let mut name = |of: &str| channel_name(of, &mut taken);
        assert_eq!(name("/World/Key.1"), "World_Key_1");
        assert_eq!(name("World/Key 1"), "World_Key_1_2");
        assert_eq!(name("World/Key/1"), "World_Key_1_3");
    }
}
