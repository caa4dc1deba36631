//! Light that reaches a point straight from where it is emitted.
//!
//! Everything with an area (emissive triangles; rect, disk, sphere and cylinder lights) is a set of polygons in a light tree;
//! points, spots and suns are delta lights; the sky shines on whatever a ray escapes to.

pub mod delta;
pub mod direct;
pub mod emitter;
mod penumbra;
mod picture_cells;
pub mod polygon;
pub mod portal;
pub mod receiver;
mod shadow;
pub mod sky;
mod skylight;
pub mod terminator;
pub mod tree;

pub use direct::{Direct, direct};
pub use sky::Sky;

use crate::patch::{Emission, Ground, Reflectance, unocclude::Exposure};
use crate::scene::{Light, Linked, Scene};
use crate::trace::Tracer;
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

impl Lights {
    /// Prepares the lights of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let mut blockers: Vec<&Linked> = Vec::new();
        for light in scene.lights.iter().filter(|light| light.links.blockers != Linked::All) {
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
            delta: scene.lights.iter().enumerate().filter_map(number).collect(),
            polygons: LightTree::new(polygon::polygons(scene, shade)),
            sky: scene.environment.as_ref().map(|e| Sky::new(scene, e)),
            portals: scene.lights.iter().filter_map(|light| Portal::new(scene, light, shade(light))).collect(),
            shades: shades.collect(),
        }
    }

    /// What is in the way of a light whose number among the shades is `shade`, in a scene that `tracer` knows.
    pub fn tracer<'a>(&'a self, tracer: &'a Tracer, shade: Option<u16>) -> Option<&'a Tracer> {
        match shade {
            None => Some(tracer),
            Some(k) => self.shades.get(usize::from(k)).and_then(Option::as_ref),
        }
    }
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
}
