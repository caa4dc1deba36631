//! The scene in memory: metres, Y up, right-handed, triangles with counter-clockwise fronts, linear Rec.709.
//!
//! Loaders make a [`Scene`], [`validate`](validate::validate) checks its postconditions, and every later stage relies on
//! them: all indices are in range, all numbers finite, no triangle is degenerate in its mesh's space.

pub mod appearance;
pub mod camera;
pub mod clear_sky;
pub mod contribution;
pub mod environment;
pub mod light;
pub mod link;
pub mod look;
pub mod material;
pub mod medium;
pub mod mesh;
pub mod projector;
pub mod role;
pub mod texture;
pub mod validate;
pub mod web;

pub use appearance::{Appearance, Channel, ChannelSlot, Dielectric, Lobe, Lobes, Walls};
pub use camera::{Camera, Lens, Projection};
pub use contribution::{BakeMode, Contribution};
pub use environment::Environment;
pub use light::{Light, LightShape, Shaping};
pub use link::{Linked, Links};
pub use material::{Alpha, Material, TextureSlot};
pub use medium::{DensityGrid, Medium, MediumShape};
pub use mesh::{Mesh, TriangleOrigin, UvSet};
pub use projector::{Picture, Projector};
pub use role::{Role, RoleOpinion};
pub use texture::{Texels, Texture, Wrap};
pub use web::{PhotometricWeb, Profile};

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

/// A whole scene. Meshes, materials and textures are shared by index.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    pub meshes: Vec<Mesh>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub surfaces: Vec<Surface>,
    pub lights: Vec<Light>,
    pub environment: Option<Environment>,
    pub cameras: Vec<Camera>,
    pub media: Vec<Medium>,
}

/// One placed mesh: a glTF node with its mesh, or a USD gprim (an instance of one, too).
#[derive(Clone, Debug)]
pub struct Surface {
    /// The source path: USD prim path, or the glTF node's names from the root joined by `/`. Unique in the scene.
    pub name: String,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    pub world_from_local: Affine3A,
    /// The object of the source file that this is; what it means is known to the loader and writer of that format.
    pub origin: SurfaceOrigin,
    /// What it does in the bake.
    pub role: Role,
}

/// Where a surface came from, for the writers.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceOrigin {
    /// Made in memory.
    None,
    /// Index of the glTF node.
    GltfNode(usize),
    /// A USD gprim that can hold opinions of its own.
    UsdPrim,
    /// A gprim below a native instance: `root` is the instance prim's path, `prim` the gprim's path relative to it.
    UsdInstance { root: String, prim: String },
    /// A gprim below a point instancer's prototype: instance `index` of `instancer`, `prim` the prototype's gprim path.
    UsdPoint { instancer: String, index: usize, prim: String },
}

impl Surface {
    /// Mirrored by its transform: the world-space front of a triangle is then given by the reversed corner order.
    pub fn is_mirrored(&self) -> bool {
        self.world_from_local.matrix3.determinant() < 0.0
    }
}

/// The box around two.
fn join(a: [Vec3; 2], b: [Vec3; 2]) -> [Vec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Scene {
    /// The world positions of triangle `triangle` of surface `surface`, counter-clockwise seen from its front (mirrored
    /// transforms swap the last two corners; [`Scene::corner_order`] gives the order).
    pub fn world_triangle(&self, surface: usize, triangle: usize) -> [Vec3; 3] {
        let s = &self.surfaces[surface];
        let t = self.meshes[s.mesh].triangles[triangle];
        Self::corner_order(s).map(|k| s.world_from_local.transform_point3(self.meshes[s.mesh].positions[t[k] as usize]))
    }

    /// The corners of a surface's triangles in the order that is counter-clockwise in world space.
    pub fn corner_order(surface: &Surface) -> [usize; 3] {
        if surface.is_mirrored() { [0, 2, 1] } else { [0, 1, 2] }
    }

    /// The corners of the box around the triangles of all surfaces [m]; `None` where there are none.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        (0..self.surfaces.len()).into_par_iter().filter_map(|s| self.surface_bounds(s)).reduce_with(join)
    }

    /// The same of surface `surface`.
    pub fn surface_bounds(&self, surface: usize) -> Option<[Vec3; 2]> {
        let triangles = 0..self.meshes[self.surfaces[surface].mesh].triangles.len();
        let points = triangles.flat_map(|t| self.world_triangle(surface, t)).filter(|p| p.is_finite());
        points.map(|p| [p; 2]).reduce(join)
    }

    /// The material of a triangle.
    pub fn material(&self, surface: usize, triangle: usize) -> &Material {
        let mesh = &self.meshes[self.surfaces[surface].mesh];
        &self.materials[mesh.triangle_material[triangle] as usize]
    }

    /// Triangles over all surfaces, instances counted each.
    pub fn triangle_count(&self) -> usize {
        self.surfaces.iter().map(|s| self.meshes[s.mesh].triangles.len()).sum()
    }

    /// Keeps the surfaces for which `keep`, one a surface, is true; lights stay linked to the same ones.
    pub fn retain_surfaces(&mut self, keep: &[bool]) {
        let mut kept = keep.iter();
        self.surfaces.retain(|_| *kept.next().expect("one flag a surface"));
        self.lights.iter_mut().for_each(|light| light.links.retain(keep));
    }

    /// True where something shines in the bake: a light or sky that is not dynamic, an emissive material that a surface uses, or an
    /// emissive medium.
    pub fn has_light(&self) -> bool {
        let is_baked = |contribution: &Contribution| contribution.mode() != BakeMode::Dynamic;
        self.environment.iter().flat_map(Environment::each).any(|sky| is_baked(&sky.contribution))
            || self.lights.iter().any(|light| is_baked(&light.contribution))
            || self.media.iter().any(|medium| medium.emission != crate::color::Rgb::ZERO)
            || self.surfaces.iter().filter(|s| s.role.casts).any(|s| {
                self.meshes[s.mesh].triangle_material.iter().any(|&m| self.materials[m as usize].is_emissive())
            })
    }
}
