//! Lightmap texels as radiosity patches: the part of each surface that a texel covers, exactly.

pub mod block;
mod clip;
pub mod footprint;
pub mod rasterize;
pub mod reflectance;
pub mod region;
pub mod unocclude;

pub use footprint::{Cutter, Footprint, SurfacePoint};
pub use rasterize::rasterize;
pub use reflectance::{Emission, Reflectance};

use crate::scene::Scene;
use crate::trace::{Hit, Tracer};
use crate::unwrap::Atlas;
use glam::{Vec2, Vec3};

/// No patch.
pub const NONE: u32 = u32::MAX;

/// All covered texels, geometry alone, in Morton order within each chart.
///
/// A patch is the part of one chart that lies in one texel's square. Its footprint, the triangles clipped by the square, is
/// recomputed where it is needed ([`Footprint`]); the areas of all footprints add up to the area of the surfaces.
#[derive(Clone, Debug)]
pub struct Patches {
    /// Centroid [m].
    pub position: Vec<Vec3>,
    /// Area-weighted mean of the geometric normals, unit.
    pub normal: Vec<Vec3>,
    /// Area [m^2].
    pub area: Vec<f32>,
    /// Page, and texel on it (row by row).
    pub texel: Vec<[u32; 2]>,
    /// The share of the texel's square that is covered, 0..=1.
    pub coverage: Vec<f32>,
    /// Chart number over all surfaces.
    pub chart: Vec<u32>,
    pub surface: Vec<u32>,
    /// Pieces of patch i are `first_piece[i]..first_piece[i + 1]`.
    first_piece: Vec<u32>,
    /// Triangle number (over all surfaces) and area [m^2] of each piece.
    pieces: Vec<(u32, f32)>,
    /// By page and texel: the patch, [`NONE`] where there is none.
    page_patch: Vec<Vec<u32>>,
}

/// What patches are cut from: needed to find footprints and the patch under a hit.
#[derive(Clone, Copy)]
pub struct Ground<'a> {
    pub scene: &'a Scene,
    pub atlas: &'a Atlas,
    pub tracer: &'a Tracer,
    pub patches: &'a Patches,
}

impl Patches {
    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// True where nothing is covered.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// Pieces of patch `i`: triangle number and area [m^2].
    pub fn pieces(&self, i: usize) -> &[(u32, f32)] {
        &self.pieces[self.first_piece[i] as usize..self.first_piece[i + 1] as usize]
    }

    /// The patch in a texel of a page.
    pub fn at(&self, page: usize, texel: usize) -> Option<usize> {
        let i = self.page_patch[page][texel];
        (i != NONE).then_some(i as usize)
    }
}

impl Ground<'_> {
    /// The patch under a hit. `None` only where a triangle's UVs are so thin that no texel was covered.
    pub fn patch_under(&self, hit: &Hit) -> Option<usize> {
        let (surface, triangle) = self.tracer.place(hit.triangle);
        let [a, b, c] = self.atlas.page_texels(surface, self.scene.surfaces[surface].mesh, triangle);
        let at = a + (b - a) * hit.barycentric[0] + (c - a) * hit.barycentric[1];
        self.patch_near(self.atlas.placements[surface].page as usize, at)
    }

    /// The patch in the texel that `at` [texels] lies in, or else in the nearest of its neighbours.
    pub fn patch_near(&self, page: usize, at: Vec2) -> Option<usize> {
        let [w, h] = self.atlas.pages[page].map(|n| n as i64);
        // No chart lies at negative coordinates, so that cutting off is rounding down; it costs no call.
        let (x, y) = (at.x as i64, at.y as i64);
        let get = |x: i64, y: i64| {
            if x < 0 || y < 0 || x >= w || y >= h {
                return None;
            }
            self.patches.at(page, (y * w + x) as usize)
        };
        get(x, y).or_else(|| {
            let mut best: Option<(f32, usize)> = None;
            for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
                if let Some(patch) = get(x + dx, y + dy) {
                    let centre = Vec2::new((x + dx) as f32 + 0.5, (y + dy) as f32 + 0.5);
                    let distance = centre.distance_squared(at);
                    if best.is_none_or(|(d, _)| distance < d) {
                        best = Some((distance, patch));
                    }
                }
            }
            best.map(|(_, patch)| patch)
        })
    }
}
