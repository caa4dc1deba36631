//! Light that reaches a point straight from where it is emitted.
//!
//! Everything with an area (emissive triangles; rect, disk, sphere and cylinder lights) is a set of polygons in a light tree;
//! points, spots and suns are delta lights; the sky shines on whatever a ray escapes to.

mod at_block;
mod close;
pub mod delta;
pub mod direct;
pub mod emitter;
mod first_look;
pub mod incident;
pub mod kept;
pub mod mask;
pub mod parts;
mod penumbra;
mod picture_cells;
pub mod polygon;
pub mod portal;
pub mod receiver;
mod shadow;
mod sharp_sky;
pub mod sky;
mod skylight;
pub mod terminator;
pub mod touched;
pub mod tree;
pub mod units;

pub use direct::{Direct, direct};
pub use incident::incident;
pub use sky::Sky;

use crate::patch::{Emission, Ground, Reflectance, unocclude::Exposure};
use crate::scene::{BakeMode, Contribution, Environment, Light, Linked, Scene};
use crate::trace::{Hit, Tracer};
use delta::DeltaLight;
use direct::DirectParams;
use portal::Portal;
use tree::LightTree;

/// All that shines in a scene, ready to be sampled.
pub struct Lights {
    pub delta: Vec<DeltaLight>,
    pub polygons: LightTree,
    pub sky: Option<Sky>,
    /// Portals to skies with pictures.
    pub portals: Vec<Portal>,
    /// What blocks lights that only some surfaces block, by the number that they have; none: nothing at all.
    pub shades: Vec<Option<Tracer>>,
}

/// Something that shines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shining {
    /// A light, by its number in the scene.
    Light(usize),
    /// An emissive material, by its number.
    Material(usize),
    /// A sky, by its place in [`Environment::each`].
    Sky(usize),
}

impl Shining {
    /// What is said of its part in the bake.
    pub fn contribution(self, scene: &Scene) -> &Contribution {
        match self {
            Self::Light(l) => &scene.lights[l].contribution,
            Self::Material(m) => &scene.materials[m].contribution,
            Self::Sky(k) => {
                let sky = scene.environment.as_ref().and_then(|sky| sky.each().nth(k));
                &sky.expect("a sky of the scene").contribution
            }
        }
    }

    /// True where it shines on some surfaces alone, or is blocked by some alone: by their numbers.
    pub fn is_linked(self, scene: &Scene) -> bool {
        matches!(self, Self::Light(l) if !scene.lights[l].links.are_all())
    }
}

impl Lights {
    /// Prepares the lights of `scene` that take part in the bake.
    pub fn new(scene: &Scene) -> Self {
        Self::of(scene, |shining| shining.contribution(scene).mode() != BakeMode::Dynamic)
    }

    /// True where the lights of `scene` that light texels have a sky among them.
    pub fn has_sky(scene: &Scene) -> bool {
        let skies = scene.environment.iter().flat_map(Environment::each).count();
        (0..skies).any(|k| Shining::Sky(k).contribution(scene).mode() != BakeMode::Dynamic)
    }

    /// Prepares those that `holds` is true of.
    pub fn of(scene: &Scene, holds: impl Fn(Shining) -> bool) -> Self {
        let lights = || scene.lights.iter().enumerate().filter(|(l, _)| holds(Shining::Light(*l)));
        let mut blockers: Vec<&Linked> = Vec::new();
        for (_, light) in lights().filter(|(_, light)| light.links.blockers != Linked::All) {
            if !blockers.contains(&&light.links.blockers) && blockers.len() < usize::from(u16::MAX) {
                blockers.push(&light.links.blockers);
            }
        }
        let shade = |light: &Light| blockers.iter().position(|b| **b == light.links.blockers).map(|k| k as u16);
        let shades = blockers.iter().map(|blockers| {
            let blocks = |surface: usize| blockers.holds(surface as u32);
            (0..scene.surfaces.len()).any(blocks).then(|| Tracer::of(scene, blocks))
        });
        let number = |(l, light)| DeltaLight::new(l, light, shade(light));
        Self {
            delta: lights().filter_map(number).collect(),
            polygons: LightTree::new(polygon::polygons(scene, &holds, shade)),
            sky: sky_of(scene, &holds).map(|sky| Sky::new(scene, &sky)),
            portals: lights().filter_map(|(_, light)| Portal::new(scene, light, shade(light))).collect(),
            shades: shades.collect(),
        }
    }

    /// The same lights with nothing in the way of any.
    pub fn unblocked(mut self) -> Self {
        let free = Some(0);
        self.delta.iter_mut().for_each(|light| light.shade = free);
        self.polygons.polygons.iter_mut().for_each(|polygon| polygon.shade = free);
        self.portals.iter_mut().for_each(|portal| portal.set_shade(free));
        Self { shades: vec![None], ..self }
    }

    /// True where nothing shines.
    pub fn is_empty(&self) -> bool {
        self.delta.is_empty() && self.polygons.is_empty() && self.sky.is_none() && self.portals.is_empty()
    }

    /// True where some sky is found by brightness samples: what is sharp of the sky, and skies through portals.
    pub fn has_sharp_sky(&self) -> bool {
        self.sky.as_ref().is_some_and(Sky::is_sharp) || !self.portals.is_empty()
    }

    /// What is in the way of a light whose number among the shades is `shade`, in a scene that `tracer` knows.
    pub fn tracer<'a>(&'a self, tracer: &'a Tracer, shade: Option<u16>) -> Option<&'a Tracer> {
        match shade {
            None => Some(tracer),
            Some(k) => self.shades.get(usize::from(k)).and_then(Option::as_ref),
        }
    }
}

/// The skies of `scene` that `holds` is true of, as one.
fn sky_of(scene: &Scene, holds: impl Fn(Shining) -> bool) -> Option<Environment> {
    let skies = scene.environment.iter().flat_map(Environment::each).enumerate();
    let mut kept = skies.filter(|(k, _)| holds(Shining::Sky(*k))).map(|(_, sky)| sky.clone());
    let first = kept.next()?;
    Some(Environment { others: kept.map(|other| Environment { others: Vec::new(), ..other }).collect(), ..first })
}

/// A rasterized scene and all that its light depends on: what transport, solvers and gather work on.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    pub ground: &'a Ground<'a>,
    pub exposure: &'a Exposure,
    pub reflectance: &'a Reflectance,
    pub emission: &'a Emission,
    pub lights: &'a Lights,
    /// How light straight from lights is estimated.
    pub params: &'a DirectParams,
    /// By surface: true where the light is known already, so that its texels send it and none is found; `None`: nowhere.
    pub known: Option<&'a [bool]>,
}

impl Lit<'_> {
    /// True where light is to be found of patch `i`: some of it lies in the open, and it isn't known.
    pub fn is_wanted(&self, i: usize) -> bool {
        !self.exposure.is_buried(i) && !self.is_known(i)
    }

    /// True where the light of patch `i` is known already.
    pub fn is_known(&self, i: usize) -> bool {
        self.known.is_some_and(|known| known[self.ground.patches.surface(i) as usize])
    }

    /// The patch under a hit, where the side that was hit can send light back: not on the backs of single-sided surfaces, which are
    /// black, nor on the front of buried patches.
    pub fn reflecting(&self, hit: &Hit) -> Option<usize> {
        let patch = self.ground.patch_under(hit)?;
        let (surface, triangle) = self.ground.tracer.place(hit.triangle);
        let reflects = match hit.back {
            true => self.ground.scene.material(surface, triangle).double_sided,
            false => !self.exposure.is_buried(patch),
        };
        reflects.then_some(patch)
    }
}
