//! Lumel bakes lightmaps: it reads a USD or glTF scene, gives it lightmap UVs, solves the radiosity equation over the
//! texels, and writes EXR pages, glTF and USD that hold the light.
//!
//! [`pipeline::bake`] does all of it and is where to start to read; [`illuminate::illuminate`] is the part for scenes in memory.

pub mod adaptive;
pub mod added_light;
pub mod blocks;
pub mod color;
pub mod compare;
pub mod contour;
pub mod digest;
pub mod energy;
pub mod error;
pub mod folder;
pub mod gather;
pub mod illuminate;
pub mod inspect;
pub mod integrate;
pub mod light;
pub mod limits;
pub mod load;
pub mod measure;
pub mod medium;
pub mod meshing;
pub mod moments;
pub mod openness;
pub mod patch;
pub mod pipeline;
pub mod plan;
mod plane;
pub mod post;
pub mod probe;
pub mod progress;
pub mod reference;
pub mod render;
pub mod report;
pub mod sample;
pub mod scatter;
pub mod scene;
pub mod sensor;
pub mod settings;
pub mod solve;
pub mod store;
pub mod subdivide;
pub mod trace;
pub mod transport;
pub mod unwrap;
pub mod view_factors;
pub mod work;
pub mod write;

pub use error::{Error, Result};
