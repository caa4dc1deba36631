//! Form factors by the hemicube (Cohen, Greenberg 1985, "The Hemi-Cube"): the scene is drawn on half a cube over a point, and
//! the delta form factors of the cells that show an element add up to the point's form factor to it.
//!
//! The top and four half sides are item buffers with depth. Edge functions are taken in homogeneous form, `E = (a x b) . d` of
//! a cell's direction d (Olano, Greer 1997): nothing is clipped, what lies behind never covers a cell, and two triangles that
//! share an edge compute it from the same corners to the same number, so no cell falls between them. Delta form factors are
//! those of whole cells (Howell's catalogue, B-3 and B-4, by corners), and add up to 1.
//!
//! Cells are looked at in their middle: what is smaller than a cell is found or missed, and the pattern of it shows (aliasing).
//! Each cube is turned about the normal by chance, so that such errors don't line up between elements.
//!
//! Cost: triangles + cells (3 resolution^2) a point: at resolution 64 about 1 ms for 5000 triangles. Limits: as fine as a cell;
//! memory 24 bytes a cell.

use super::batches::error_of_mean;
use super::{Effort, Elements, FormFactor};
use crate::patch::{Ground, NONE, SurfacePoint};
use crate::sample::sequence::{Sequence, Stage};
use crate::sample::warp::frame;
use crate::scene::Scene;
use glam::{DMat3, DVec3, Vec2};
use std::f64::consts::TAU;
use std::ops::Range;

/// How hemicubes are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HemicubeParams {
    /// Cells along an edge of the top: even, 8..=1024.
    pub resolution: u32,
    /// Hemicubes an element, on points spread over it; at least 1.
    pub points: u32,
    /// Turns each cube about the normal by chance; without, all of one plane lie alike, and their aliasing lines up.
    pub rotate: bool,
}

impl Default for HemicubeParams {
    fn default() -> Self {
        Self { resolution: 64, points: 16, rotate: true }
    }
}

/// Sides, the top first.
const FACES: usize = 5;

/// The triangle of a cell that shows none.
const EMPTY: u32 = u32::MAX;

/// A pair's estimate may take a cube for every row of cells' worth of the samples allowed, and this many in any case.
const FEWEST_CUBES: u32 = 16;

/// A hemicube that can be set over any point.
#[derive(Clone)]
pub struct Hemicube {
    params: HemicubeParams,
    /// Delta form factors of the top's cells, then of one side's, row by row from the horizon.
    top: Vec<f32>,
    side: Vec<f32>,
    /// By face and cell: what is seen there.
    items: Vec<Item>,
    /// Positions of one surface in the cube's frame, and on which side of the faces' borders they lie.
    turned: Vec<(DVec3, u16)>,
}

/// What a cell shows.
#[derive(Clone, Copy)]
struct Item {
    triangle: u32,
    back: bool,
    /// Along the axis of its face [m].
    depth: f32,
    /// Weights of corners 1 and 2, in the mesh's order.
    barycentric: [f32; 2],
}

const NOTHING: Item = Item { triangle: EMPTY, back: false, depth: f32::INFINITY, barycentric: [0.0; 2] };

impl Hemicube {
    /// Buffers and delta form factors.
    pub fn new(params: &HemicubeParams) -> Self {
        let n = params.resolution as usize;
        assert!(
            (8..=1024).contains(&n) && n.is_multiple_of(2),
            "a hemicube has 8 to 1024 cells an edge, even; not {n}"
        );
        assert!(params.points > 0, "no points for a hemicube");
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let cells = |rows: Range<usize>, corner: &dyn Fn(f64, f64) -> f64| -> Vec<f32> {
            let whole = |x: usize, y: usize| {
                let (x0, x1, y0, y1) = (at(x), at(x + 1), at(y), at(y + 1));
                (corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)) as f32
            };
            rows.flat_map(|y| (0..n).map(move |x| (x, y))).map(|(x, y)| whole(x, y)).collect()
        };
        let top = cells(0..n, &|x, y| {
            let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
            (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / TAU
        });
        // Across the side x, over the horizon z, at distance 1.
        let side = cells(n / 2..n, &|x, z| {
            let r = (1.0 + z * z).sqrt();
            (x.atan() - (x / r).atan() / r) / TAU
        });
        let items = vec![NOTHING; top.len() + 4 * side.len()];
        Self { params: *params, top, side, items, turned: Vec::new() }
    }

    /// Form factors from element `i` to all that its hemicubes see: ascending element, share. Their sum is 1 where the scene is
    /// closed and no back is black.
    pub fn row(&mut self, elements: &Elements, ground: &Ground, i: usize) -> Vec<(u32, f32)> {
        let mut shares = vec![0.0f64; elements.len()];
        for index in 0..self.params.points {
            self.draw(elements, ground, i, index);
            self.for_each_element(elements, ground, |e, share| shares[e as usize] += f64::from(share));
        }
        let n = f64::from(self.params.points);
        let seen = shares.iter().enumerate().filter(|(_, share)| **share > 0.0);
        seen.map(|(e, share)| (e as u32, (share / n) as f32)).collect()
    }

    /// The form factor from element `i` to `j`: hemicubes are doubled until the standard error is small enough; `samples`
    /// counts them.
    pub fn pair(&mut self, elements: &Elements, ground: &Ground, i: usize, j: usize, effort: &Effort) -> FormFactor {
        let most = (effort.most_samples / self.params.resolution).max(FEWEST_CUBES);
        let mut values: Vec<f64> = Vec::new();
        let mut end = self.params.points.min(most);
        loop {
            for index in values.len() as u32..end {
                self.draw(elements, ground, i, index);
                let mut sum = 0.0;
                self.for_each_element(elements, ground, |e, share| {
                    if e as usize == j {
                        sum += f64::from(share);
                    }
                });
                values.push(sum);
            }
            let value = values.iter().sum::<f64>() / values.len() as f64;
            let error = error_of_mean(&values);
            if end >= most || error <= effort.tolerance(value) {
                return FormFactor { value, error, samples: end };
            }
            end = (2 * end).min(most);
        }
    }

    /// Calls `visit(element, share)` for each cell that shows an element.
    fn for_each_element(&self, elements: &Elements, ground: &Ground, mut visit: impl FnMut(u32, f32)) {
        let deltas = self.top.iter().chain((1..FACES).flat_map(|_| &self.side));
        // Neighbouring cells mostly show one triangle: where it lies on its page is looked up once.
        let mut shown = EMPTY;
        let (mut page, mut texels) = (0, [Vec2::ZERO; 3]);
        for (item, &share) in self.items.iter().zip(deltas).filter(|(item, _)| item.triangle != EMPTY) {
            if item.triangle != shown {
                shown = item.triangle;
                let (surface, triangle) = ground.tracer.place(shown);
                page = ground.atlas.placements[surface].page as usize;
                texels = ground.atlas.page_texels(surface, ground.scene.surfaces[surface].mesh, triangle);
            }
            let [a, b, c] = texels;
            let at = a + (b - a) * item.barycentric[0] + (c - a) * item.barycentric[1];
            let Some(patch) = ground.patch_near(page, at) else { continue };
            let side = if item.back { &elements.back_of } else { &elements.front_of };
            if side[patch] != NONE {
                visit(side[patch], share);
            }
        }
    }

    /// Draws the scene over point `index` of element `i`.
    fn draw(&mut self, elements: &Elements, ground: &Ground, i: usize, index: u32) {
        let point = elements.point(ground, i, index);
        let turn = if self.params.rotate {
            TAU * f64::from(Sequence::new(elements.seed, Stage::Hemicube, i as u64).point(index, 0)[0])
        } else {
            0.0
        };
        self.items.fill(NOTHING);
        let cube_from_world = basis(&point, turn).transpose();
        let offset = f64::from(ground.tracer.offset());
        for (s, surface) in ground.scene.surfaces.iter().enumerate() {
            let mesh = &ground.scene.meshes[surface.mesh];
            // Positions as `Scene::world_triangle` rounds them: corners that surfaces share stay one.
            let place = |p: &glam::Vec3| surface.world_from_local.transform_point3(*p).as_dvec3();
            let eye = point.position.as_dvec3();
            self.turned.clear();
            self.turned.extend(mesh.positions.iter().map(|p| {
                let turned = cube_from_world * (place(p) - eye);
                (turned, sides(turned))
            }));
            let order = Scene::corner_order(surface);
            let mirrored = surface.is_mirrored();
            let first = ground.tracer.number(s, 0);
            for (t, corners) in mesh.triangles.iter().enumerate() {
                let [a, b, c] = order.map(|k| self.turned[corners[k] as usize]);
                let common = a.1 & b.1 & c.1;
                if common & BELOW != 0 {
                    continue;
                }
                let triangle = Triangle { number: first + t as u32, mirrored, offset };
                for face in (0..FACES).filter(|&face| common & OUTSIDE[face] == 0) {
                    self.draw_face(face, [a, b, c].map(|p| face_from_cube(face, p.0)), &triangle);
                }
            }
        }
    }

    /// Draws a triangle on one face: x and y across it, z away from the point.
    fn draw_face(&mut self, face: usize, [a, b, c]: [DVec3; 3], triangle: &Triangle) {
        let low_y = if face == 0 { -1.0 } else { 0.0 };
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let determinant = a.dot(bc);
        if determinant == 0.0 {
            return;
        }
        let n = self.params.resolution as usize;
        let half = 0.5 * n as f64;
        let rows = if face == 0 { n } else { n / 2 };
        let (xs, ys) = match bounds([a, b, c], low_y) {
            Some([x0, y0, x1, y1]) => {
                let cell = |v: f64, low: f64| ((v - low) * half - 0.5).clamp(-1.0, n as f64);
                let range = |low: f64, high: f64, edge: f64, n: usize| {
                    let first = cell(low, edge).floor().max(0.0) as usize;
                    first..((cell(high, edge).ceil() + 1.0).max(0.0) as usize).min(n)
                };
                (range(x0, x1, -1.0, n), range(y0, y1, low_y, rows))
            }
            None => return,
        };
        let start = if face == 0 { 0 } else { self.top.len() + (face - 1) * self.side.len() };
        // Fronts turn clockwise about the point in this frame's sense: their determinant is negative.
        let (sign, back) = (determinant.signum(), determinant > 0.0);
        let size = determinant.abs();
        // As the tracer has it: of walls in one plane, the one that faces is seen.
        let behind = if back { triangle.offset } else { 0.0 };
        let step = 1.0 / half;
        for row in ys {
            let first = DVec3::new(0.5 * step - 1.0, (row as f64 + 0.5) * step + low_y, 1.0);
            let edges = [bc, ca, ab].map(|e| (e.dot(first) * sign, e.x * sign * step));
            let span = if xs.len() > WIDE { span(&edges, &xs) } else { xs.clone() };
            let items = &mut self.items[start + row * n..start + (row + 1) * n];
            for (column, item) in items.iter_mut().enumerate().take(span.end).skip(span.start) {
                // The same numbers but for their signs in both triangles of an edge: no cell is left out.
                let [u, v, w] = edges.map(|(at, by)| at + by * column as f64);
                if u < 0.0 || v < 0.0 || w < 0.0 {
                    continue;
                }
                let sum = u + v + w;
                // Along the face's depth; nought where all edges pass through the cell's middle.
                let depth = (size / sum + behind) as f32;
                if depth < item.depth {
                    let [v, w] = [(v / sum) as f32, (w / sum) as f32];
                    let barycentric = if triangle.mirrored { [w, v] } else { [v, w] };
                    *item = Item { triangle: triangle.number, back, depth, barycentric };
                }
            }
        }
    }
}

/// Form factors from element `i`, see [`Hemicube::row`].
pub fn row(elements: &Elements, ground: &Ground, i: usize, params: &HemicubeParams) -> Vec<(u32, f32)> {
    Hemicube::new(params).row(elements, ground, i)
}

/// What the cells that a triangle covers need of it.
struct Triangle {
    number: u32,
    mirrored: bool,
    offset: f64,
}

/// The cube's axes, z along the normal, turned about it.
fn basis(point: &SurfacePoint, turn: f64) -> DMat3 {
    let frame = frame(point.normal).as_dmat3();
    // Single precision leaves the axes a little off: the frame only has to be one, not this one.
    let z = frame.z_axis.normalize();
    let x = (frame.x_axis - z * frame.x_axis.dot(z)).normalize();
    let y = z.cross(x);
    let (sin, cos) = turn.sin_cos();
    DMat3::from_cols(x * cos + y * sin, y * cos - x * sin, z)
}

/// Below the horizon.
const BELOW: u16 = 1;

/// By face: bits of [`sides`] for the outside of each of its borders. What has one of them at all corners isn't seen on it.
const OUTSIDE: [u16; FACES] = [
    1 << 1 | 1 << 3 | 1 << 5 | 1 << 7,
    BELOW | 1 << 2 | 1 << 10 | 1 << 11,
    BELOW | 1 << 4 | 1 << 9 | 1 << 12,
    BELOW | 1 << 6 | 1 << 9 | 1 << 11,
    BELOW | 1 << 8 | 1 << 10 | 1 << 12,
];

/// On which sides of the planes between the faces a position lies, a bit for each.
fn sides(p: DVec3) -> u16 {
    let DVec3 { x, y, z } = p;
    let [xz, yz, xy] = [[x - z, -x - z], [y - z, -y - z], [x - y, -x - y]];
    let planes = [-z, xz[0], -xz[0], xz[1], -xz[1], yz[0], -yz[0], yz[1], -yz[1], xy[0], -xy[0], xy[1], -xy[1]];
    planes.iter().enumerate().fold(0, |bits, (k, &side)| bits | u16::from(side > 0.0) << k)
}

/// Turns the cube so that `face` looks along z: the top as it is, sides with the cube's z up. All are rotations.
fn face_from_cube(face: usize, p: DVec3) -> DVec3 {
    match face {
        0 => p,
        1 => DVec3::new(p.y, p.z, p.x),
        2 => DVec3::new(-p.y, p.z, -p.x),
        3 => DVec3::new(-p.x, p.z, p.y),
        _ => DVec3::new(p.x, p.z, -p.y),
    }
}

/// Rows of more cells than this are narrowed before their cells are looked at.
const WIDE: usize = 12;

/// The cells of a row, within `all`, that may lie inside of all three edges; a cell too many at either end.
fn span(edges: &[(f64, f64); 3], all: &Range<usize>) -> Range<usize> {
    let (mut low, mut high) = (all.start as f64, all.end as f64);
    for &(at, by) in edges {
        let border = -at / by;
        if by > 0.0 {
            low = low.max(border - 1.0);
        } else if by < 0.0 {
            high = high.min(border + 2.0);
        }
    }
    if low < high { low as usize..high as usize } else { 0..0 }
}

/// The bounds on a face of the part of a triangle that it shows, as low x, low y, high x, high y; None where it shows none.
fn bounds(triangle: [DVec3; 3], low_y: f64) -> Option<[f64; 4]> {
    let grow = |b: Option<[f64; 4]>, p: DVec3| {
        // Corners at the point itself, where all faces meet, lie anywhere.
        if p.z <= 0.0 {
            return Some([-1.0, low_y, 1.0, 1.0]);
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        let [x0, y0, x1, y1] = b.unwrap_or([x, y, x, y]);
        Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    };
    if triangle.iter().all(|p| p.z > 0.0) {
        return triangle.iter().fold(None, |b, &p| grow(b, p));
    }
    let planes: [&dyn Fn(DVec3) -> f64; 4] = [&|p| p.z - p.x, &|p| p.z + p.x, &|p| p.z - p.y, &|p| p.y - low_y * p.z];
    let mut polygon = triangle.to_vec();
    for side in planes {
        let mut kept = Vec::with_capacity(8);
        for (k, &p) in polygon.iter().enumerate() {
            let q = polygon[(k + 1) % polygon.len()];
            let (sp, sq) = (side(p), side(q));
            if sp >= 0.0 {
                kept.push(p);
            }
            if (sp > 0.0 && sq < 0.0) || (sp < 0.0 && sq > 0.0) {
                kept.push(p + (q - p) * (sp / (sp - sq)));
            }
        }
        polygon = kept;
    }
    polygon.into_iter().fold(None, grow)
}
