//! The light of a surface at many places of each triangle: what values at vertices are fitted to and judged by.

use super::Weights;
use super::fine::Piece;
use super::page::sample_page;
use crate::color::{Rgb, luminance};
use crate::post::Lightmap;
use crate::scene::Scene;
use crate::unwrap::Atlas;
use glam::{DVec2, DVec3, Vec2};

/// What the light at vertices is made from.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    pub scene: &'a Scene,
    pub atlas: &'a Atlas,
    pub lightmap: &'a Lightmap,
    /// True for texels (page, and texel row by row) inside of other geometry: nobody sees them, and their light is made up.
    pub is_buried: &'a (dyn Fn(usize, usize) -> bool + Sync),
    /// Mean luminance of the light over all surfaces.
    pub mean: f32,
}

/// The light at a place of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// The place, as weights of the first two corners of the mesh's triangle.
    place: [f32; 2],
    /// The lightmap's value.
    pub value: Rgb,
    /// The area that it stands for [m^2].
    pub area: f32,
    /// Buried, or across a jump of the light within a texel: counts little, and is not judged.
    pub is_doubtful: bool,
}

impl Sample {
    /// The place as weights of the triangle's corners.
    pub fn weights(&self) -> DVec3 {
        let [a, b] = self.place.map(f64::from);
        DVec3::new(a, b, 1.0 - a - b)
    }

    /// What an error of the value is held against: its luminance, or [`LEAST_LEVEL`] of the mean one where that is more.
    pub fn level(&self, mean: f32) -> f64 {
        f64::from(luminance(self.value).max(LEAST_LEVEL * mean).max(f32::MIN_POSITIVE))
    }

    /// How much its squared error shows: its area, over its level and the mean one.
    pub fn weight(&self, mean: f32) -> f64 {
        f64::from(self.area) / (self.level(mean) * f64::from(mean.max(f32::MIN_POSITIVE)))
    }
}

/// The part of the mean light below which errors are not held against the light itself.
pub const LEAST_LEVEL: f32 = 0.05;

/// Places of a triangle that holds the middles of few texels: each stands for a fourth of it.
const FEW: [[f32; 2]; 4] = [[1.0 / 3.0; 2], [2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0], [1.0 / 6.0; 2]];

/// Weights nearer to 0 are those of a place on an edge: rounding must not deal it to both sides as a whole, or to none.
const ON_EDGE: f64 = 1e-9;

/// Samples of all triangles of a surface, one triangle after the other.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    pub all: Vec<Sample>,
    /// Those of triangle t are `all[first[t]..first[t + 1]]`; 4 or more.
    first: Vec<u32>,
}

impl Samples {
    /// The light at the middles of the texels of each triangle of `surface`, or at four places of it by bilinear look-ups.
    pub fn new(source: &Source, surface: usize) -> Self {
        let scene = source.scene;
        let placed = &scene.surfaces[surface];
        let count = scene.meshes[placed.mesh].triangles.len();
        let mut samples = Self { all: Vec::with_capacity(4 * count), first: Vec::with_capacity(count + 1) };
        for t in 0..count {
            samples.first.push(samples.all.len() as u32);
            samples.add(source, surface, placed.mesh, t);
        }
        samples.first.push(samples.all.len() as u32);
        samples
    }

    fn add(&mut self, source: &Source, surface: usize, mesh: usize, triangle: usize) {
        let number = source.atlas.placements[surface].page as usize;
        let page = &source.lightmap.pages[number];
        let corners = source.atlas.page_texels(surface, mesh, triangle);
        let [a, b, c] = source.scene.world_triangle(surface, triangle).map(|p| p.as_dvec3());
        let area = 0.5 * (b - a).cross(c - a).length();
        // Mirrored surfaces swap corners in the world, not in the mesh; the area is the same.
        let start = self.all.len();
        each_middle(corners, |x, y, weights| {
            if x < page.width && y < page.height {
                let texel = (y * page.width + x) as usize;
                let place = [weights.x as f32, weights.y as f32];
                let is_doubtful = page.coverage[texel] <= 0.0 || (source.is_buried)(number, texel);
                // Of a texel whose middle lies on an edge, half is the triangle's: the diagonals of squares run along such texels.
                let share = if weights.min_element() < ON_EDGE { 0.5 } else { 1.0 };
                self.all.push(Sample { place, value: page.rgb[texel], area: share, is_doubtful });
            }
        });
        if self.all.len() - start < FEW.len() {
            self.all.truncate(start);
            self.all.extend(FEW.map(|place| Sample { area: 1.0, ..look_up(source, surface, triangle, place) }));
        }
        let shares: f64 = self.all[start..].iter().map(|s| f64::from(s.area)).sum();
        self.all[start..].iter_mut().for_each(|s| s.area = (area * f64::from(s.area) / shares) as f32);
    }

    /// Adds one in the middle of `piece`; returns its number.
    pub fn push(&mut self, source: &Source, surface: usize, piece: &Piece) -> u32 {
        let triangle = piece.source as usize;
        let w = (piece.corners[0].0 + piece.corners[1].0 + piece.corners[2].0) / 3.0;
        let sample = look_up(source, surface, triangle, [w.x as f32, w.y as f32]);
        let whole: f32 = self.of(triangle).map(|s| self.all[s as usize].area).sum();
        let area = (f64::from(whole) * piece.share()) as f32;
        self.all.push(Sample { area, ..sample });
        self.all.len() as u32 - 1
    }

    /// Calls `found` with each of `members` that is judged, in a piece with the corners `corners` and `values` there: the sample, its
    /// weights in the piece, and what is shown there less its value.
    pub fn each_error(
        &self,
        corners: &[Weights; 3],
        values: &[DVec3; 3],
        members: &[u32],
        mut found: impl FnMut(&Sample, DVec3, DVec3),
    ) {
        let Some(within) = Within::new(corners) else { return };
        for s in members.iter().map(|s| &self.all[*s as usize]).filter(|s| !s.is_doubtful) {
            let w = within.weights(s.weights());
            let shown = values[0] * w.x + values[1] * w.y + values[2] * w.z;
            found(s, w, shown - s.value.as_dvec3());
        }
    }

    /// The numbers of the samples of triangle `triangle`.
    pub fn of(&self, triangle: usize) -> std::ops::Range<u32> {
        self.first[triangle]..self.first[triangle + 1]
    }
}

/// The light at `place` of a triangle by bilinear look-up, for no area yet; doubtful within a texel that tells none.
fn look_up(source: &Source, surface: usize, triangle: usize, place: [f32; 2]) -> Sample {
    let number = source.atlas.placements[surface].page as usize;
    let page = &source.lightmap.pages[number];
    let corners = source.atlas.page_texels(surface, source.scene.surfaces[surface].mesh, triangle);
    let at = corners[0] * place[0] + corners[1] * place[1] + corners[2] * (1.0 - place[0] - place[1]);
    let tells = |texel: usize| page.coverage[texel] > 0.0 && !(source.is_buried)(number, texel);
    let x = (at.x.max(0.0) as u32).min(page.width - 1);
    let y = (at.y.max(0.0) as u32).min(page.height - 1);
    let texel = (y * page.width + x) as usize;
    let value = sample_page(page, at, tells).unwrap_or(page.rgb[texel]);
    Sample { place, value, area: 0.0, is_doubtful: !tells(texel) }
}

/// Calls `found` with each texel whose middle lies in the triangle `corners` [texels] or on its edges, and the middle's weights.
fn each_middle(corners: [Vec2; 3], mut found: impl FnMut(u32, u32, DVec3)) {
    let [a, b, c] = corners.map(|p| p.as_dvec2());
    let twice = (b - a).perp_dot(c - a);
    if twice == 0.0 {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    if high.min_element() < 0.5 {
        return;
    }
    let range = |low: f64, high: f64| (low - 0.5).ceil().max(0.0) as u32..=(high - 0.5).floor() as u32;
    for y in range(low.y, high.y) {
        for x in range(low.x, high.x) {
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let weights = DVec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)) / twice;
            if weights.min_element() >= -ON_EDGE {
                found(x, y, weights);
            }
        }
    }
}

/// The weights of a piece's corners, where a place has weights of the corners of the triangle that the piece is part of.
#[derive(Clone, Copy, Debug)]
pub struct Within(glam::DMat3);

impl Within {
    /// The piece with the corners `corners`; `None` where it has no area.
    pub fn new(corners: &[Weights; 3]) -> Option<Self> {
        let matrix = glam::DMat3::from_cols(corners[0].0, corners[1].0, corners[2].0);
        // The share of the triangle that the piece covers.
        (matrix.determinant().abs() > 1e-14).then(|| Self(matrix.inverse()))
    }

    /// The weights in the piece of the place with the weights `of_triangle`; negative outside of it.
    pub fn weights(&self, of_triangle: DVec3) -> DVec3 {
        self.0 * of_triangle
    }
}
