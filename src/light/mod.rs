//! Light that reaches a point straight from where it is emitted.
//!
//! Everything with an area (emissive triangles; rect, disk, sphere and cylinder lights) is a set of polygons in a light tree;
//! points, spots and suns are delta lights; the sky shines on whatever a ray escapes to.

pub mod delta;
pub mod direct;
pub mod emitter;
mod penumbra;
pub mod polygon;
pub mod receiver;
mod shadow;
pub mod sky;
mod skylight;
pub mod tree;

pub use direct::{Direct, direct};
pub use sky::Sky;

use crate::patch::{Emission, Ground, Reflectance, unocclude::Exposure};
use crate::scene::Scene;
use delta::DeltaLight;
use direct::DirectParams;
use tree::LightTree;

/// All that shines in a scene, ready to be sampled.
pub struct Lights {
    pub delta: Vec<DeltaLight>,
    pub polygons: LightTree,
    pub sky: Option<Sky>,
}

impl Lights {
    /// Prepares the lights of `scene`.
    pub fn new(scene: &Scene) -> Self {
        Self {
            delta: scene.lights.iter().filter_map(DeltaLight::new).collect(),
            polygons: LightTree::new(polygon::polygons(scene)),
            sky: scene.environment.as_ref().map(|e| Sky::new(scene, e)),
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
