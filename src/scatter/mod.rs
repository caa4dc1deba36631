//! How surfaces scatter light: the BSDF at any point of a scene, for methods that follow rays.
//!
//! [`Scattering`] is prepared once a scene; [`Scattering::at`] looks a material up at a point and gives its [`Bsdf`],
//! which evaluates, samples and tells densities. Matte materials are Lambert's, with the albedo that radiosity uses;
//! others are as `layered` and, where they were measured, `lafortune` describe them.
//!
//! Light that passes surfaces goes three ways. Cut-outs, blended surfaces and *panes*, thin and smooth, are sheets:
//! rays pass them by chance ([`crate::trace`]), and the BSDF is that of what they stop, over the share that they stop.
//! Solids, and thin sheets that are rough, refract or spread light by their BSDF; [`adapt`] makes rays end at them.
//!
//! | file | what it holds |
//! |---|---|
//! | `bsdf` | the scattering at a point |
//! | `layered` | clear coat, metal, dielectric, glass |
//! | `pane` | what window panes stop |
//! | `lafortune`, `fit` | lobes of measured surfaces, and how they are found |
//! | `ggx`, `fresnel`, `energy` | microfacets, smooth interfaces, and what facets lose |

mod bsdf;
mod energy;
pub mod fit;
mod fresnel;
mod ggx;
mod lafortune;
mod layered;
mod pane;

pub use bsdf::Bsdf;

use crate::color::Rgb;
use crate::scene::look::{albedo_at, bounded, look_up, passing_at, vertex_color};
use crate::scene::material::mean_share;
use crate::scene::{Appearance, Channel, ChannelSlot, Material, Mesh, Scene, TextureSlot, Walls};
use bsdf::{Back, Lobes};
use energy::{Interface, Table};
use fresnel::Rise;
use glam::{Vec2, Vec3};
use lafortune::Measured;
use layered::{COAT_IOR, Clear, Energy, Layered, Means, both_faces};
use pane::Pane;
use serde::{Deserialize, Serialize};

/// What of materials is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Surfaces {
    /// Everything.
    #[default]
    Full,
    /// Their diffuse stand-ins, as radiosity sees them.
    Diffuse,
}

/// What paths carry: refraction squeezes radiance by the square of the index, and keeps power (Veach 1997, "Robust
/// Monte Carlo Methods for Light Transport Simulation", section 5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Paths from the eye: `wo` points back to it.
    Radiance,
    /// Paths from lights: `wo` points back to them.
    Importance,
}

/// A direction drawn from a [`Bsdf`].
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    /// Unit, away from the surface, in the local frame.
    pub direction: Vec3,
    /// BSDF times cosine over density.
    pub weight: Rgb,
    /// Density [1/sr] over all lobes but those that send light in one direction only; of such a one the chance that it
    /// was chosen.
    pub pdf: f32,
    /// The lobe that was drawn sends light in this direction only.
    pub delta: bool,
    /// It goes on to the other side.
    pub transmitted: bool,
}

impl Scattered {
    /// A lobe in one direction, which gets `share` of the light, chosen by `chance`.
    fn single(direction: Vec3, share: Rgb, chance: f32) -> Self {
        Self { direction, weight: share / chance, pdf: chance, delta: true, transmitted: direction.z < 0.0 }
    }
}

/// The share of light that patches and panes stop at least, that nothing is divided by 0.
const LEAST_STOP: f32 = 1e-4;

/// Indices of refraction below this bend nothing.
const LEAST_IOR: f32 = 1.01;

/// What is prepared of a scene: energy tables, and lobes ready to be sampled.
#[derive(Debug)]
pub struct Scattering {
    /// One a material.
    finishes: Vec<Finish>,
    tables: Option<Tables>,
}

/// How a material is looked up.
#[derive(Debug)]
enum Finish {
    Matte,
    Pane,
    /// Indices of the dielectric's curve and of the solid's interface.
    Layered {
        rise: usize,
        interface: Option<usize>,
    },
    Measured(Measured),
}

/// Tables of all materials, each index once.
#[derive(Debug)]
struct Tables {
    whole: Table,
    schlick: Table,
    coat: Table,
    rises: Vec<(Rise, Table)>,
    interfaces: Vec<(f32, Interface)>,
}

impl Scattering {
    /// Prepares the materials of `scene`; some tens of milliseconds for each index of refraction.
    pub fn new(scene: &Scene, surfaces: Surfaces) -> Self {
        let mut tables = None;
        let finishes = scene.materials.iter().map(|material| match (&material.appearance, surfaces) {
            (None, _) | (_, Surfaces::Diffuse) => Finish::Matte,
            (Some(appearance), Surfaces::Full) => Finish::new(appearance, &mut tables),
        });
        Self { finishes: finishes.collect(), tables }
    }

    /// The scattering at a point of `triangle` of `surface`: weights of its corners 1 and 2, in the order of the mesh.
    /// `scene` is the one it was prepared for.
    pub fn at(&self, scene: &Scene, surface: usize, triangle: usize, barycentric: [f32; 2]) -> Bsdf<'_> {
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        let index = mesh.triangle_material[triangle] as usize;
        let point = Point { scene, mesh, triangle, at: Vec2::from(barycentric) };
        let material = &scene.materials[index];
        let back = if material.double_sided { Back::Alike } else { Back::Black };
        let diffuse = || Lobes::Diffuse(albedo_at(scene, mesh, triangle, point.at));
        let Some(appearance) = &material.appearance else {
            return Bsdf { lobes: diffuse(), back, share: point.stopped_share(material) };
        };
        let (lobes, back) = match (&self.finishes[index], &self.tables) {
            (Finish::Measured(measured), _) => (Lobes::Measured(measured), back),
            (Finish::Pane, _) => (Lobes::Pane(point.pane(material, appearance)), Back::Alike),
            (Finish::Layered { rise, interface }, Some(tables)) => {
                let layered = point.layered(appearance, tables, *rise, *interface);
                let back = match (layered.clear > 0.0, layered.kind) {
                    (true, Clear::Solid) => Back::Inside,
                    (true, Clear::Thin) => Back::Alike,
                    (false, _) => back,
                };
                (Lobes::Layered(layered), back)
            }
            (Finish::Matte | Finish::Layered { .. }, _) => (diffuse(), back),
        };
        // The albedo and panes are of what meets the surface, all else of what it stops.
        let is_of_all = matches!(lobes, Lobes::Diffuse(_) | Lobes::Pane(_));
        Bsdf { lobes, back, share: if is_of_all { point.stopped_share(material) } else { 1.0 } }
    }

    /// Whether material `material` is a window pane, which rays pass by chance.
    pub fn is_pane(&self, material: usize) -> bool {
        matches!(self.finishes.get(material), Some(Finish::Pane))
    }
}

impl Finish {
    fn new(appearance: &Appearance, tables: &mut Option<Tables>) -> Self {
        if let Some(lobes) = &appearance.measured {
            return Self::Measured(Measured::new(lobes));
        }
        if appearance.is_matte() {
            return Self::Matte;
        }
        if appearance.is_pane() {
            return Self::Pane;
        }
        let tables = tables.get_or_insert_with(Tables::new);
        let rise = tables.rise(Rise::new(appearance.dielectric.ior));
        let refracts = appearance.absorption().is_some();
        let ior = clear_ior(appearance);
        Self::Layered { rise, interface: (refracts && ior >= LEAST_IOR).then(|| tables.interface(ior)) }
    }
}

/// The index of what is clear; specular workflows, which have none, get glass.
fn clear_ior(appearance: &Appearance) -> f32 {
    match appearance.dielectric.ior {
        0.0 => 1.5,
        ior if ior < LEAST_IOR => 1.0,
        ior => ior,
    }
}

impl Tables {
    fn new() -> Self {
        let [whole, schlick, coat] = energy::mirrors(Rise::Index(COAT_IOR));
        Self { whole, schlick, coat, rises: Vec::new(), interfaces: Vec::new() }
    }

    /// The index of the table of a curve.
    fn rise(&mut self, rise: Rise) -> usize {
        self.rises.iter().position(|known| known.0 == rise).unwrap_or_else(|| {
            let table = match rise {
                Rise::Schlick => self.schlick.clone(),
                Rise::Index(ior) if ior == COAT_IOR => self.coat.clone(),
                Rise::Index(_) => energy::rising(rise),
            };
            self.rises.push((rise, table));
            self.rises.len() - 1
        })
    }

    fn interface(&mut self, ior: f32) -> usize {
        self.interfaces.iter().position(|known| known.0 == ior).unwrap_or_else(|| {
            self.interfaces.push((ior, Interface::new(ior)));
            self.interfaces.len() - 1
        })
    }
}

/// A point of a triangle, to look materials up at.
struct Point<'s> {
    scene: &'s Scene,
    mesh: &'s Mesh,
    triangle: usize,
    at: Vec2,
}

impl Point<'_> {
    fn color(&self, factor: Rgb, slot: Option<&TextureSlot>) -> Rgb {
        factor * slot.map_or(Rgb::ONE, |slot| look_up(self.scene, self.mesh, self.triangle, slot, self.at).truncate())
    }

    /// A share, 0..=1.
    fn share(&self, factor: f32, channel: Option<&ChannelSlot>) -> f32 {
        let texel = channel.map_or(1.0, |ChannelSlot { slot, channel }| {
            let texel = look_up(self.scene, self.mesh, self.triangle, slot, self.at);
            match channel {
                Channel::R => texel.x,
                Channel::G => texel.y,
                Channel::B => texel.z,
                Channel::A => texel.w,
            }
        });
        (factor * texel).clamp(0.0, 1.0)
    }

    /// Opacity over the mean share of light that is stopped: 1 where nothing passes.
    fn stopped_share(&self, material: &Material) -> f32 {
        if !material.lets_light_through() {
            return 1.0;
        }
        let (opacity, passes) = passing_at(self.scene, self.mesh, self.triangle, self.at);
        opacity / (1.0 - mean_share(passes)).max(LEAST_STOP)
    }

    fn base_color(&self, appearance: &Appearance) -> Rgb {
        let color = self.color(appearance.base_color, appearance.base_color_texture.as_ref());
        (color * vertex_color(self.mesh, self.triangle, self.at)).clamp(Rgb::ZERO, Rgb::ONE)
    }

    fn pane(&self, material: &Material, appearance: &Appearance) -> Pane {
        let passes = self.color(material.transmission, material.transmission_texture.as_ref());
        let diffuse = albedo_at(self.scene, self.mesh, self.triangle, self.at);
        Pane::new(passes, clear_ior(appearance), diffuse)
    }

    fn layered<'a>(&self, look: &Appearance, tables: &'a Tables, rise: usize, interface: Option<usize>) -> Layered<'a> {
        let (curve, rise) = &tables.rises[rise];
        let base = self.base_color(look);
        let metal = self.share(look.metallic, look.metallic_texture.as_ref());
        let transmission = self.share(look.transmission, look.transmission_texture.as_ref());
        let clear = (1.0 - metal) * transmission;
        let dielectric = &look.dielectric;
        let color = self.color(dielectric.color, dielectric.color_texture.as_ref());
        Layered::new(Layered {
            energy: Energy {
                whole: &tables.whole,
                schlick: &tables.schlick,
                coat: &tables.coat,
                rise,
                interface: interface.map(|k| &tables.interfaces[k].1),
            },
            base,
            albedo: bounded(base),
            metal,
            opaque: (1.0 - metal) * (1.0 - transmission),
            clear,
            kind: if look.walls == Walls::Thin { Clear::Thin } else { Clear::Solid },
            roughness: self.share(look.roughness, look.roughness_texture.as_ref()),
            ior: clear_ior(look),
            rise: *curve,
            f0: (color * dielectric.f0()).clamp(Rgb::ZERO, Rgb::ONE),
            specular: self.share(dielectric.specular, dielectric.specular_texture.as_ref()),
            coat: self.share(look.clearcoat, look.clearcoat_texture.as_ref()),
            coat_roughness: self.share(look.clearcoat_roughness, look.clearcoat_roughness_texture.as_ref()),
            means: Means::default(),
            inside: false,
        })
    }
}

/// Prepares `scene` for light over mirrors and glass beside methods that see diffuse surfaces alone: as [`adapt`] does, and what
/// [stands in](stands_in) for a mirror or glass sends on diffusely what comes to it off other surfaces, since light straight from lights
/// is followed over it. Glass sends on what a mean way through it leaves. What can't stand in sends nothing on.
pub fn adapt_for_caustics(scene: &mut Scene) {
    adapt(scene, Surfaces::Full);
    let has_sky = scene.environment.is_some();
    for index in 0..scene.materials.len() {
        let material = &scene.materials[index];
        let Some(look) = material.appearance.as_ref().filter(|look| look.is_single()) else { continue };
        let sends = stands_in(material) && !has_sky;
        let glass = sends.then(|| look.absorption()).flatten().map(|absorption| {
            let left = (-absorption * mean_chord(scene, index)).exp();
            (bounded(look.base_color * left), look.base_color_texture.clone())
        });
        let material = &mut scene.materials[index];
        match glass {
            Some((albedo, texture)) => {
                (material.albedo, material.albedo_texture) = (albedo, texture);
                // Nothing looks at it from within.
                material.double_sided = false;
            }
            None if sends => {}
            None => material.albedo = Rgb::ZERO,
        }
    }
}

/// Whether a mirror or solid glass may send on diffusely what comes to it off other surfaces: light straight from lights can be kept
/// apart on its front alone. Window panes need no stand-in, as rays pass them.
pub fn stands_in(material: &Material) -> bool {
    let is_solid = |look: &Appearance| look.absorption().is_some() || !material.double_sided;
    material.appearance.as_ref().is_some_and(|look| look.is_single() && !look.is_pane() && is_solid(look))
}

/// The mean length of straight ways through what is made of material `index` [m]: four volumes over the surface (Cauchy).
fn mean_chord(scene: &Scene, index: usize) -> f32 {
    let (mut volume, mut area) = (0.0f64, 0.0f64);
    for surface in &scene.surfaces {
        let mesh = &scene.meshes[surface.mesh];
        let own = mesh.triangles.iter().zip(&mesh.triangle_material).filter(|(_, m)| **m as usize == index);
        // About a corner of its own, or numbers far from the origin would cancel.
        let place = |v: u32| surface.world_from_local.transform_point3(mesh.positions[v as usize]).as_dvec3();
        let Some(origin) = own.clone().next().map(|(t, _)| place(t[0])) else { continue };
        let mut part = 0.0;
        for (corners, _) in own {
            let [a, b, c] = corners.map(|v| place(v) - origin);
            part += a.dot(b.cross(c)) / 6.0;
            area += 0.5 * (b - a).cross(c - a).length();
        }
        volume += part.abs();
    }
    if area > 0.0 { (4.0 * volume / area) as f32 } else { 0.0 }
}

/// Prepares `scene` for rays that meet [`Surfaces::Full`]: they pass panes as far as both faces, head-on, don't mirror,
/// and end at whatever refracts or spreads what passes. Cut-outs and blended surfaces stay as they are, and so does
/// [`Surfaces::Diffuse`].
pub fn adapt(scene: &mut Scene, surfaces: Surfaces) {
    if surfaces == Surfaces::Diffuse {
        return;
    }
    for material in &mut scene.materials {
        let Some(appearance) = &material.appearance else { continue };
        if appearance.refracts() {
            (material.transmission, material.transmission_texture) = (Rgb::ZERO, None);
        } else if appearance.is_pane() {
            material.transmission *= 1.0 - both_faces(fresnel::head_on(clear_ior(appearance)));
        }
    }
}
