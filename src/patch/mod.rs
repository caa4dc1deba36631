//! Lightmap texels as radiosity patches: the part of each surface that a texel covers, exactly.

pub mod block;
mod clip;
pub mod footprint;
pub mod palette;
mod probe;
pub mod rasterize;
pub mod reflectance;
pub mod region;
pub mod sparse;
pub mod stop;
mod tile;
pub mod unocclude;

pub use footprint::{Cutter, Footprint, SurfacePoint};
pub use palette::Palette;
pub use rasterize::rasterize;
pub use reflectance::{Emission, Reflectance};
pub use sparse::Sparse;
pub use stop::Stops;

use crate::scene::Scene;
use crate::trace::{Hit, Tracer};
use crate::unwrap::Atlas;
use glam::{Vec2, Vec3};
use std::ops::Range;

/// No patch.
pub const NONE: u32 = u32::MAX;

/// All covered texels, geometry alone, in Morton order within each chart.
///
/// A patch is the part of one chart that lies in one texel's square. Its footprint, the triangles clipped by the square, is
/// recomputed where it is needed ([`Footprint`]); the areas of all footprints add up to the area of the surfaces.
///
/// About 45 bytes a texel, so what can be told from something else is: a patch's chart knows its surface and page, and most
/// patches lie in one triangle and have its area.
#[derive(Clone, Debug)]
pub struct Patches {
    /// Centroid [m].
    pub position: Vec<Vec3>,
    /// Area-weighted mean of the geometric normals, unit.
    pub normal: Palette,
    /// Area [m^2].
    pub area: Vec<f32>,
    /// The share of the texel's square that is covered, 0..=1.
    pub coverage: Vec<f32>,
    /// Chart number over all surfaces.
    pub chart: Vec<u32>,
    /// Texel on its page, row by row.
    texel: Vec<u32>,
    /// Surface and page of each chart.
    charts: Vec<[u32; 2]>,
    /// The triangle that each patch lies in, or [`MANY`] and the place in `many` of its pieces.
    piece: Vec<u32>,
    /// The pieces of patches with several: those of place k are `many_pieces[many[k]..many[k + 1]]`.
    many: Vec<u32>,
    /// Triangle number (over all surfaces) and area [m^2].
    many_pieces: Vec<(u32, f32)>,
    /// By page and texel: the patch, [`NONE`] where there is none.
    page_patch: Vec<Vec<u32>>,
}

/// Slivers of texels are taken to cover this share of them at least.
const LEAST_COVERAGE: f32 = 1e-3;

/// Marks a patch of several pieces.
const MANY: u32 = 1 << 31;

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

    /// Page and texel on it (row by row) of patch `i`.
    pub fn texel(&self, i: usize) -> [u32; 2] {
        [self.page(i), self.texel[i]]
    }

    /// The page that patch `i` lies on.
    pub fn page(&self, i: usize) -> u32 {
        self.charts[self.chart[i] as usize][1]
    }

    /// The surface that patch `i` is a part of.
    pub fn surface(&self, i: usize) -> u32 {
        self.surface_of_chart(self.chart[i])
    }

    /// The surface that a chart (number over all surfaces) is a part of.
    pub fn surface_of_chart(&self, chart: u32) -> u32 {
        self.charts[chart as usize][0]
    }

    /// The patches of each of `surfaces` surfaces: runs, one after the other.
    pub fn runs(&self, surfaces: usize) -> Vec<Range<u32>> {
        let mut runs = vec![0..0; surfaces];
        let mut end = 0;
        for (s, run) in runs.iter_mut().enumerate() {
            let first = end;
            let own = self.chart[first..].partition_point(|chart| self.charts[*chart as usize][0] as usize <= s);
            end = first + own;
            *run = first as u32..end as u32;
        }
        runs
    }

    /// A box around patch `i` [m].
    pub fn around(&self, i: usize) -> [Vec3; 2] {
        // It reaches beyond its middle by a texel's diagonal at most.
        let reach = (2.0 * self.area[i] / self.coverage[i].clamp(LEAST_COVERAGE, 1.0)).sqrt();
        [self.position[i] - reach, self.position[i] + reach]
    }

    /// Pieces of patch `i`, at least one: triangle number over all surfaces, in order, and area [m^2].
    pub fn pieces(&self, i: usize) -> impl ExactSizeIterator<Item = (u32, f32)> {
        let piece = self.piece[i];
        let (single, many) = match piece & MANY {
            0 => (Some((piece, self.area[i])), 0..0),
            _ => {
                let k = (piece & !MANY) as usize;
                (None, self.many[k] as usize..self.many[k + 1] as usize)
            }
        };
        let first = many.start;
        (0..single.map_or(many.len(), |_| 1)).map(move |k| single.unwrap_or_else(|| self.many_pieces[first + k]))
    }

    /// The first triangle, by number over all surfaces, that patch `i` has a piece of.
    pub fn first_triangle(&self, i: usize) -> u32 {
        match self.piece[i] {
            piece if piece & MANY == 0 => piece,
            piece => self.many_pieces[self.many[(piece & !MANY) as usize] as usize].0,
        }
    }

    /// The patch in a texel of a page.
    pub fn at(&self, page: usize, texel: usize) -> Option<usize> {
        let i = self.page_patch[page][texel];
        (i != NONE).then_some(i as usize)
    }
}

impl Ground<'_> {
    /// The patches of each surface.
    pub fn runs(&self) -> Vec<Range<u32>> {
        self.patches.runs(self.scene.surfaces.len())
    }

    /// True where patch `i` takes part in the exchange of light; others receive, and rays pass through them.
    pub fn casts(&self, i: usize) -> bool {
        self.scene.surfaces[self.patches.surface(i) as usize].role.casts
    }

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
