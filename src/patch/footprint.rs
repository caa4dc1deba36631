//! The footprint of a patch: the convex pieces, triangle by texel square, from which area sampling draws.

use super::Ground;
use super::clip::Convex;
use super::rasterize::texel_triangle;
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec2, Vec3, Vec3A};

/// A point on a surface, on its front.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// World position [m].
    pub position: Vec3,
    /// The triangle's front normal, unit.
    pub normal: Vec3,
    /// The interpolated normal where the mesh has normals, else the triangle's; unit, on the front's side.
    pub shading: Vec3,
    /// Where it would lie on the round surface that the interpolated normals belong to [m]: as far as the mesh is convex there, in the
    /// tangent planes of the corners (Hanika 2021, "Hacking the Shadow Terminator"); the point itself where it is flat.
    pub rounded: Vec3,
    /// The surface that it lies on.
    pub surface: u32,
}

impl SurfacePoint {
    /// A point that is none.
    pub const NOWHERE: Self = Self::on(super::NONE, Vec3::ZERO, Vec3::ZERO);

    /// A point of `surface` that is shown as flat as it is.
    pub const fn on(surface: u32, position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, shading: normal, rounded: position, surface }
    }

    /// The same point without what interpolated normals say.
    pub fn flat(self) -> Self {
        Self::on(self.surface, self.position, self.normal)
    }
}

/// A placed triangle, ready to be evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    /// Surface, and triangle of its mesh.
    pub surface: usize,
    pub triangle: usize,
    /// Corner 0, and the edges from it to corners 1 and 2 (mesh order) [m].
    origin: Vec3,
    edges: [Vec3; 2],
    /// Front normal, unit.
    normal: Vec3,
    /// World shading normals of the corners, where the mesh has normals that are not the triangle's.
    shading: Option<[Vec3; 3]>,
}

/// One triangle's part of a texel.
#[derive(Clone, Debug)]
pub struct Piece {
    pub facet: Facet,
    /// Weights of the triangle's corners 1 and 2 at the corners of the convex part (at most seven).
    corners: [Vec2; 8],
    count: usize,
    /// It is the whole texel.
    is_square: bool,
    /// Area [m^2].
    pub area: f32,
}

/// The pieces of one patch, ready to be sampled.
#[derive(Clone, Debug, Default)]
pub struct Footprint {
    pub pieces: Vec<Piece>,
    total: f32,
    /// Cells of the unit square that samples may fall into, see [`Footprint::restrict`].
    cells: CellMask,
}

/// A 4 x 4 grid over the unit square of a footprint's samples; bit `4 y + x` is set where the cell may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellMask(pub u16);

impl Default for CellMask {
    fn default() -> Self {
        Self::ALL
    }
}

impl CellMask {
    /// Cells along each side.
    pub const SIDE: u32 = 4;
    pub const ALL: Self = Self(u16::MAX);
    pub const EMPTY: Self = Self(0);

    /// Moves `u` into the allowed cells, uniform over them: the cells of the square, each from left to right, are one long strip, which
    /// is pressed together to the length of the allowed ones.
    fn place(self, u: [f32; 2]) -> [f32; 2] {
        if self == Self::ALL || self == Self::EMPTY {
            return u;
        }
        let (side, allowed) = (Self::SIDE as f32, self.0.count_ones());
        let x = (u[0] * side).min(side - 1e-3);
        let y = (u[1] * side).min(side - 1e-3);
        let along = ((y as u32 * Self::SIDE) as f32 + x) * (allowed as f32 / 16.0);
        let wanted = (along as u32).min(allowed - 1);
        let mut bits = self.0;
        for _ in 0..wanted {
            bits &= bits - 1;
        }
        let chosen = bits.trailing_zeros();
        let within = |v: f32, c: u32| (c as f32 + v.min(1.0)) / side;
        [within(along - wanted as f32, chosen % Self::SIDE), within(y.fract(), chosen / Self::SIDE)]
    }
}

/// Cuts footprints and keeps the triangles of the last ones at hand: patches in order share them.
pub struct Cutter<'a> {
    ground: &'a Ground<'a>,
    /// By triangle number modulo their count.
    recent: [Option<Cut>; RECENT],
}

/// Triangles that a [`Cutter`] keeps.
const RECENT: usize = 16;

/// A triangle on its page, ready to be cut.
#[derive(Clone, Copy)]
struct Cut {
    number: u32,
    facet: Facet,
    /// Corners [texels].
    corners: [DVec2; 3],
}

impl<'a> Cutter<'a> {
    /// A cutter for the patches of `ground`.
    pub fn new(ground: &'a Ground<'a>) -> Self {
        Self { ground, recent: [None; RECENT] }
    }

    /// The footprint of patch `i`.
    pub fn footprint(&mut self, i: usize) -> Footprint {
        let mut footprint = Footprint::default();
        self.cut(i, &mut footprint);
        footprint
    }

    /// The footprint of patch `i` in place of what `footprint` is, whose memory it takes.
    pub fn cut(&mut self, i: usize, footprint: &mut Footprint) {
        let ground = self.ground;
        footprint.pieces.clear();
        (footprint.total, footprint.cells) = (0.0, CellMask::ALL);
        let [page, texel] = ground.patches.texel(i);
        let width = ground.atlas.pages[page as usize][0];
        let low = DVec2::new(f64::from(texel % width), f64::from(texel / width));
        let pieces = ground.patches.pieces(i);
        footprint.pieces.reserve_exact(pieces.len());
        for (number, area) in pieces {
            let Cut { facet, corners: [a, b, c], .. } = *self.triangle(number);
            let whole = (b - a).perp_dot(c - a);
            let weights = |p: DVec2| {
                let at = p - a;
                Vec2::new((at.perp_dot(c - a) / whole) as f32, ((b - a).perp_dot(at) / whole) as f32)
            };
            let mut corners = [Vec2::ZERO; 8];
            // Most texels lie inside one triangle: there is nothing to clip.
            let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|d| weights(low + d));
            let is_square = square.iter().all(|w| w.x >= 0.0 && w.y >= 0.0 && w.x + w.y <= 1.0);
            let count = if is_square {
                corners[..4].copy_from_slice(&square);
                4
            } else {
                let part = Convex::triangle([a, b, c]).band(1, low.y).band(0, low.x);
                for (corner, p) in corners.iter_mut().zip(part.corners()) {
                    *corner = weights(*p);
                }
                part.corners().len()
            };
            if count >= 3 {
                footprint.pieces.push(Piece { facet, corners, count, is_square, area });
                footprint.total += area;
            }
        }
    }

    fn triangle(&mut self, number: u32) -> &Cut {
        let slot = &mut self.recent[number as usize % RECENT];
        if slot.is_none_or(|cut| cut.number != number) {
            *slot = None;
        }
        slot.get_or_insert_with(|| {
            let Ground { scene, atlas, tracer, .. } = *self.ground;
            let (surface, triangle) = tracer.place(number);
            let corners = texel_triangle(scene, atlas, surface, triangle);
            Cut { number, facet: Facet::new(scene, surface, triangle), corners }
        })
    }
}

impl Ground<'_> {
    /// The footprint of patch `i`.
    pub fn footprint(&self, i: usize) -> Footprint {
        Cutter::new(self).footprint(i)
    }

    /// The part of triangle `number` in the texels from `low` up to and without `high` of its page: world corners [m] of a
    /// convex polygon of at most seven, none where the triangle lies elsewhere. Its winding is that of the UVs.
    pub fn cut(&self, number: u32, low: [u32; 2], high: [u32; 2]) -> Vec<DVec3> {
        let (surface, triangle) = self.tracer.place(number);
        let order = Scene::corner_order(&self.scene.surfaces[surface]);
        let texels = texel_triangle(self.scene, self.atlas, surface, triangle);
        let [a, b, c] = order.map(|k| texels[k]);
        let world = self.scene.world_triangle(surface, triangle).map(Vec3::as_dvec3);
        let mut part = Convex::triangle([a, b, c]);
        for axis in [1, 0] {
            part = part.between(axis, f64::from(low[axis]), f64::from(high[axis]));
        }
        let whole = (b - a).perp_dot(c - a);
        let place = |p: &DVec2| {
            let at = *p - a;
            let (v, w) = (at.perp_dot(c - a) / whole, (b - a).perp_dot(at) / whole);
            world[0] + (world[1] - world[0]) * v + (world[2] - world[0]) * w
        };
        if part.corners().len() >= 3 { part.corners().iter().map(place).collect() } else { Vec::new() }
    }
}

/// Difference from the triangle's own normal below which a shading normal is the same, in each component.
const FLAT: f32 = 1e-6;

/// How far a surface rises over a triangle at most, of an edge's length times the difference of the normals at its ends: a third over
/// the middle of a ball's facet.
const MOST_RISE: f32 = 0.5;

impl Facet {
    /// Triangle `triangle` of `surface`.
    pub fn new(scene: &Scene, surface: usize, triangle: usize) -> Self {
        let placed = &scene.surfaces[surface];
        let mesh = &scene.meshes[placed.mesh];
        let corners = mesh.triangles[triangle];
        let [a, b, c] = corners.map(|v| placed.world_from_local.transform_point3(mesh.positions[v as usize]));
        let flip = if placed.is_mirrored() { -1.0 } else { 1.0 };
        let normal = ((b - a).cross(c - a) * flip).normalize_or_zero();
        let shading = (!mesh.normals.is_empty()).then(|| {
            let to_world = placed.world_from_local.matrix3.inverse().transpose();
            corners.map(|v| Vec3::from(to_world * Vec3A::from(mesh.normals[v as usize])).normalize_or_zero())
        });
        // The normals of a flat triangle are its own to rounding, and need not be blended.
        let shading = shading.filter(|normals| normals.iter().any(|n| !n.abs_diff_eq(normal, FLAT)));
        Self { surface, triangle, origin: a, edges: [b - a, c - a], normal, shading }
    }

    /// The point with weights `at` of corners 1 and 2.
    pub fn point(&self, at: Vec2) -> SurfacePoint {
        let shading = self.shading.and_then(|[a, b, c]| {
            let n = a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
            // A normal that points behind its own triangle says nothing about the front.
            n.try_normalize().filter(|n| n.dot(self.normal) > 0.0)
        });
        let position = self.origin + self.edges[0] * at.x + self.edges[1] * at.y;
        let flat = SurfacePoint::on(self.surface as u32, position, self.normal);
        match shading {
            Some(shading) => SurfacePoint { shading, rounded: self.rounded(position, at), ..flat },
            None => flat,
        }
    }

    /// The mean of a point's projections into the tangent planes of the corners that it lies below, no further than those normals
    /// diverge: where all of them lean the same way, the triangle is meant to be flat.
    fn rounded(&self, position: Vec3, at: Vec2) -> Vec3 {
        let Some(normals) = self.shading else { return position };
        let corners = [self.origin, self.origin + self.edges[0], self.origin + self.edges[1]];
        let weights = [1.0 - at.x - at.y, at.x, at.y];
        let rise = |k: usize| {
            let depth = (corners[k] - position).dot(normals[k]);
            if normals[k].dot(self.normal) > 0.0 { normals[k] * (depth.max(0.0) * weights[k]) } else { Vec3::ZERO }
        };
        let bend = |i: usize, j: usize| corners[i].distance(corners[j]) * normals[i].distance(normals[j]);
        let most = MOST_RISE * bend(0, 1).max(bend(1, 2)).max(bend(2, 0));
        position + (rise(0) + rise(1) + rise(2)).clamp_length_max(most)
    }

    /// True where it is shown rounder than it is.
    pub fn is_round(&self) -> bool {
        self.shading.is_some()
    }
}

/// Samples keep away from the rim by this share of the way to the middle: a point exactly on the edge of two walls lies in
/// the plane of both, and a ray from it can leave through the other one.
const EDGE_MARGIN: f32 = 1e-3;

/// Pieces that get points of their own, at most.
const MOST_SPREAD: usize = 4;

impl Piece {
    /// The piece's share of its triangle's area.
    pub fn share(&self) -> f32 {
        let o = self.corners[0];
        (1..self.count - 1).map(|k| (self.corners[k] - o).perp_dot(self.corners[k + 1] - o).abs()).sum()
    }

    /// The weights at the centre of area.
    fn centroid(&self) -> Vec2 {
        let o = self.corners[0];
        let (mut sum, mut total) = (Vec2::ZERO, 0.0);
        for k in 1..self.count - 1 {
            let (p, q) = (self.corners[k] - o, self.corners[k + 1] - o);
            let area = p.perp_dot(q);
            sum += (p + q) * (area / 3.0);
            total += area;
        }
        if total == 0.0 { o } else { o + sum / total }
    }

    /// Four points of equal shares with the piece's centre and second moments: the mean of what varies quadratically over it is exact.
    fn spread(&self) -> [Vec2; 4] {
        let (o, centre) = (self.corners[0], self.centroid());
        let (mut second, mut total) = ([0.0f32; 3], 0.0f32);
        for k in 1..self.count - 1 {
            let [a, b, c] = [o, self.corners[k], self.corners[k + 1]].map(|p| p - centre);
            let area = (b - a).perp_dot(c - a);
            total += area;
            // Of a triangle: a twelfth of its area, times the sum over its corners and over their sum.
            for v in [a, b, c, a + b + c] {
                second = [second[0] + area * v.x * v.x, second[1] + area * v.x * v.y, second[2] + area * v.y * v.y];
            }
        }
        let [xx, xy, yy] = if total == 0.0 { [0.0; 3] } else { second.map(|s| s / (12.0 * total)) };
        // Along the columns of the Cholesky root, as far as makes two of four points the whole of each.
        let x = xx.max(0.0).sqrt();
        let slope = if x > 0.0 { xy / x } else { 0.0 };
        let [first, second] = [Vec2::new(x, slope), Vec2::new(0.0, (yy - slope * slope).max(0.0).sqrt())]
            .map(|v| v * std::f32::consts::SQRT_2);
        [centre + first, centre - first, centre + second, centre - second]
    }

    /// The weights at `u` of the unit square, uniform over the piece.
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        let o = self.corners[0];
        if self.is_square {
            let [x, y] = u.map(|u| u + (0.5 - u) * EDGE_MARGIN);
            return o + (self.corners[1] - o) * x + (self.corners[3] - o) * y;
        }
        let fan = |k: usize| (self.corners[k] - o).perp_dot(self.corners[k + 1] - o).abs();
        let total: f32 = (1..self.count - 1).map(fan).sum();
        let mut at = u[0] * total;
        let mut k = 1;
        while k < self.count - 2 && at >= fan(k) {
            at -= fan(k);
            k += 1;
        }
        let width = fan(k);
        let u0 = if width > 0.0 { (at / width).clamp(0.0, 1.0) } else { 0.0 };
        let w = crate::sample::warp::triangle([u0, u[1]]);
        let at = o + (self.corners[k] - o) * w.x + (self.corners[k + 1] - o) * w.y;
        let middle = self.corners[..self.count].iter().sum::<Vec2>() / self.count as f32;
        at.lerp(middle, EDGE_MARGIN)
    }
}

impl Footprint {
    /// Limits samples to the cells of `mask`.
    pub fn restrict(&mut self, mask: CellMask) {
        self.cells = mask;
    }

    /// The piece and the weights on its triangle at `u` of the unit square; uniform over the (allowed) area.
    pub fn sample_piece(&self, u: [f32; 2]) -> (&Piece, Vec2) {
        let u = self.cells.place(u);
        let mut at = u[0] * self.total;
        let mut k = 0;
        while k + 1 < self.pieces.len() && at >= self.pieces[k].area {
            at -= self.pieces[k].area;
            k += 1;
        }
        let piece = &self.pieces[k];
        (piece, piece.sample([(at / piece.area).clamp(0.0, 1.0 - f32::EPSILON), u[1]]))
    }

    /// A point uniform over the (allowed) area.
    pub fn sample(&self, u: [f32; 2]) -> SurfacePoint {
        let (piece, at) = self.sample_piece(u);
        piece.facet.point(at)
    }

    /// Turns it over: what it was the front of is its back, as flat as it is.
    pub fn turn(&mut self) {
        for Piece { facet, .. } in &mut self.pieces {
            (facet.normal, facet.shading) = (-facet.normal, None);
        }
    }

    /// The largest distance of the footprint from `centre` [m].
    pub fn radius(&self, centre: Vec3) -> f32 {
        let corners = self.pieces.iter().flat_map(|p| p.corners[..p.count].iter().map(|c| p.facet.point(*c).position));
        corners.map(|c| c.distance(centre)).fold(0.0, f32::max)
    }

    /// The middles of the pieces and their shares of the area; none where some cells are left out.
    pub fn flat_parts(&self) -> Vec<(SurfacePoint, f32)> {
        let pieces = if self.cells == CellMask::ALL { &self.pieces[..] } else { &[] };
        pieces.iter().map(|p| (p.facet.point(p.centroid()), p.area / self.total)).collect()
    }

    /// Points of the pieces and their shares of the area, so that the mean of what varies quadratically over each piece is exact; none
    /// where some cells are left out, or where random points are cheaper.
    pub fn spread_parts(&self) -> Vec<(SurfacePoint, f32)> {
        let is_known = self.cells == CellMask::ALL && self.pieces.len() <= MOST_SPREAD;
        let pieces = if is_known { &self.pieces[..] } else { &[] };
        let points = |p: &Piece| p.spread().map(|at| (p.facet.point(at), 0.25 * p.area / self.total));
        pieces.iter().flat_map(points).collect()
    }

    /// True where no piece is left.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }
}
