//! Implicit shapes (UsdGeomCube, Sphere, Cylinder, Cone, Capsule, Plane and their second versions) as polygons.
//!
//! Vertices lie on the shape; round ones have [`SEGMENTS`] sides around their axis and half as many from pole to pole, so
//! that areas and volumes are at most 0.5 % short (a disc, the worst: 1 - sin(2 pi / n) / (2 pi / n) = 0.29 %). Normals are
//! the shape's own. The UVs `st` cover 0..1: each face of a cube and a plane as a whole; round shapes have u around the axis
//! and v along the outline by its length, caps included, so that nothing overlaps.

use super::geometry::{Attributes, Geometry, Topology, is_left_handed};
use super::primvar::{Interpolation, Primvar};
use super::read::{self, Reading};
use glam::{Vec2, Vec3};
use openusd::usd::Prim;
use std::collections::HashSet;
use std::f32::consts::{FRAC_PI_2, TAU};

/// Sides of a round shape around its axis.
const SEGMENTS: u32 = 48;

/// True where prims of the type `kind` are implicit shapes.
pub fn is_shape(kind: &str) -> bool {
    matches!(kind, "Cube" | "Sphere" | "Cylinder" | "Cone" | "Capsule" | "Plane" | "Cylinder_1" | "Capsule_1")
}

/// The polygons of the shape `prim` of type `kind`; `None`, with a warning, where a measure is not positive.
pub fn read(prim: &Prim, kind: &str, reading: &mut Reading) -> Option<Geometry> {
    let mut broken = false;
    let mut length = |name: &str, default: f64, may_be_zero: bool| {
        let value = read::float(prim, name, reading).map_or(default, f64::from) as f32;
        broken |= !value.is_finite() || value < 0.0 || value == 0.0 && !may_be_zero;
        value
    };
    let mut shape = Shape::default();
    let mut is_cube = false;
    match kind {
        "Cube" => {
            is_cube = true;
            shape.cube(length("size", 2.0, false));
        }
        "Plane" => shape.plane(length("width", 2.0, false), length("length", 2.0, false)),
        "Sphere" => shape.revolve(&sphere(length("radius", 1.0, false))),
        "Cylinder" | "Cylinder_1" => {
            let radii = match kind {
                "Cylinder" => [length("radius", 1.0, false); 2],
                _ => [length("radiusBottom", 1.0, true), length("radiusTop", 1.0, true)],
            };
            shape.revolve(&cylinder(radii, length("height", 2.0, false)));
        }
        "Cone" => shape.revolve(&cylinder([length("radius", 1.0, false), 0.0], length("height", 2.0, false))),
        _ => {
            let radii = match kind {
                "Capsule" => [length("radius", 0.5, false); 2],
                _ => [length("radiusBottom", 0.5, true), length("radiusTop", 0.5, true)],
            };
            shape.revolve(&capsule(radii, length("height", 1.0, true)));
        }
    }
    if broken || shape.counts.is_empty() {
        reading.add(prim.path(), "an implicit shape with a measure that is not positive was left out");
        return None;
    }
    let axis = if is_cube { None } else { read::token(prim, "axis", reading) };
    shape.turn(axis.as_deref().unwrap_or("Z"), kind == "Plane");
    let left_handed = is_left_handed(prim, reading);
    Some(shape.into_geometry(left_handed))
}

/// A ring around the axis, and the outline's normal there (away from the axis, along it).
#[derive(Clone, Copy)]
struct Rim {
    radius: f32,
    height: f32,
    normal: Vec2,
}

/// A piece of outline between two rims, from the bottom of the axis to its top.
type Band = [Rim; 2];

fn cap(radius: f32, height: f32, up: f32) -> Band {
    let normal = Vec2::new(0.0, up);
    let [middle, edge] = [0.0, radius].map(|radius| Rim { radius, height, normal });
    if up < 0.0 { [middle, edge] } else { [edge, middle] }
}

/// Part of a circle around (0, `height`), between two angles above the equator.
fn arc(radius: f32, height: f32, from: f32, to: f32, pieces: u32) -> impl Iterator<Item = Band> {
    let rim = move |i: u32| {
        let angle = from + (to - from) * i as f32 / pieces as f32;
        // The poles exactly.
        let normal = if angle.abs() >= FRAC_PI_2 { Vec2::new(0.0, angle.signum()) } else { Vec2::from_angle(angle) };
        Rim { radius: radius * normal.x, height: height + radius * normal.y, normal }
    };
    (0..pieces).map(move |i| [rim(i), rim(i + 1)])
}

fn sphere(radius: f32) -> Vec<Band> {
    arc(radius, 0.0, -FRAC_PI_2, FRAC_PI_2, SEGMENTS / 2).collect()
}

fn side([bottom, top]: [f32; 2], height: f32) -> Band {
    let normal = Vec2::new(height, bottom - top).normalize_or(Vec2::X);
    let half = height / 2.0;
    [Rim { radius: bottom, height: -half, normal }, Rim { radius: top, height: half, normal }]
}

/// A cylinder, a cone (a radius of 0) or a frustum.
fn cylinder(radii: [f32; 2], height: f32) -> Vec<Band> {
    let half = height / 2.0;
    vec![cap(radii[0], -half, -1.0), side(radii, height), cap(radii[1], half, 1.0)]
}

/// Half spheres at both ends of a cylinder or frustum of the given height.
fn capsule(radii: [f32; 2], height: f32) -> Vec<Band> {
    let half = height / 2.0;
    let bottom = arc(radii[0], -half, -FRAC_PI_2, 0.0, SEGMENTS / 4);
    let top = arc(radii[1], half, 0.0, FRAC_PI_2, SEGMENTS / 4);
    bottom.chain([side(radii, height)]).chain(top).collect()
}

/// Polygons in the making, around Z.
#[derive(Default)]
struct Shape {
    points: Vec<Vec3>,
    counts: Vec<i32>,
    indices: Vec<i32>,
    /// One a corner each.
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
}

impl Shape {
    fn face<const N: usize>(&mut self, points: [usize; N], normals: [Vec3; N], uvs: [Vec2; N]) {
        self.counts.push(N as i32);
        self.indices.extend(points.map(|p| p as i32));
        self.normals.extend(normals);
        self.uvs.extend(uvs);
    }

    fn cube(&mut self, size: f32) {
        let half = size / 2.0;
        let signs = [-half, half];
        self.points = (0..8).map(|i| Vec3::new(signs[i & 1], signs[i >> 1 & 1], signs[i >> 2])).collect();
        let st = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        for (points, normal) in [
            ([0, 4, 6, 2], Vec3::NEG_X),
            ([1, 3, 7, 5], Vec3::X),
            ([0, 1, 5, 4], Vec3::NEG_Y),
            ([2, 6, 7, 3], Vec3::Y),
            ([0, 2, 3, 1], Vec3::NEG_Z),
            ([4, 5, 7, 6], Vec3::Z),
        ] {
            self.face(points, [normal; 4], st);
        }
    }

    /// A rectangle in XY that faces Z.
    fn plane(&mut self, width: f32, length: f32) {
        let (x, y) = (width / 2.0, length / 2.0);
        self.points = [[-x, -y], [x, -y], [x, y], [-x, y]].map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        self.face([0, 1, 2, 3], [Vec3::Z; 4], [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
    }

    /// Turns an outline around Z. A rim on the axis is one point.
    fn revolve(&mut self, bands: &[Band]) {
        let length = |[a, b]: &Band| Vec2::new(b.radius - a.radius, b.height - a.height).length();
        let whole: f32 = bands.iter().map(length).sum();
        let mut along = 0.0;
        for band in bands.iter().filter(|band| length(band) > 0.0) {
            let v = [along / whole, (along + length(band)) / whole];
            along += length(band);
            let [from, to] = band.map(|rim| self.ring(&rim));
            for k in 0..SEGMENTS as usize {
                let place = |end: usize, step: usize| {
                    let (rim, ring) = (&band[end], [from, to][end]);
                    let point = if rim.radius == 0.0 { ring } else { ring + (k + step) % SEGMENTS as usize };
                    // The point of a cone has as many normals as faces; each takes the one of its middle.
                    let turn = k as f32 + if rim.radius == 0.0 { 0.5 } else { step as f32 };
                    let (sin, cos) = (turn * TAU / SEGMENTS as f32).sin_cos();
                    let normal = Vec3::new(rim.normal.x * cos, rim.normal.x * sin, rim.normal.y);
                    (point, normal, Vec2::new(turn / SEGMENTS as f32, v[end]))
                };
                let corners = [place(0, 0), place(0, 1), place(1, 1), place(1, 0)];
                match [band[0].radius == 0.0, band[1].radius == 0.0] {
                    [true, _] => self.corners([corners[0], corners[2], corners[3]]),
                    [_, true] => self.corners([corners[0], corners[1], corners[2]]),
                    _ => self.corners(corners),
                }
            }
        }
    }

    fn corners<const N: usize>(&mut self, corners: [(usize, Vec3, Vec2); N]) {
        self.face(corners.map(|c| c.0), corners.map(|c| c.1), corners.map(|c| c.2));
    }

    /// The first point of a ring, made where it is not the newest one.
    fn ring(&mut self, rim: &Rim) -> usize {
        let count = if rim.radius == 0.0 { 1 } else { SEGMENTS as usize };
        let points: Vec<Vec3> = (0..count)
            .map(|k| {
                let (sin, cos) = (k as f32 * TAU / SEGMENTS as f32).sin_cos();
                Vec3::new(rim.radius * cos, rim.radius * sin, rim.height)
            })
            .collect();
        let newest = self.points.len().saturating_sub(count);
        if self.points[newest..] == points[..] {
            return newest;
        }
        self.points.extend(points);
        self.points.len() - count
    }

    /// Turns Z to `axis`. A plane keeps its width along X, or Z where that is its axis, and its length along Y, or Z.
    fn turn(&mut self, axis: &str, is_plane: bool) {
        let turned = |v: Vec3| match (axis, is_plane) {
            ("X", true) => Vec3::new(v.z, v.y, -v.x),
            ("Y", true) => Vec3::new(v.x, v.z, -v.y),
            ("X", false) => Vec3::new(v.z, v.x, v.y),
            ("Y", false) => Vec3::new(v.y, v.z, v.x),
            _ => v,
        };
        self.points.iter_mut().chain(&mut self.normals).for_each(|v| *v = turned(*v));
    }

    fn into_geometry(self, left_handed: bool) -> Geometry {
        let turned = if left_handed { -1.0 } else { 1.0 };
        let normals = self.normals.into_iter().map(|n| turned * n).collect();
        let faces = self.counts.len() as u32;
        Geometry {
            topology: Topology { points: self.points, counts: self.counts, indices: self.indices },
            attributes: Attributes {
                normals: Some(Primvar::new(normals, Interpolation::FaceVarying)),
                uvs: vec![("st".to_owned(), Primvar::new(self.uvs, Interpolation::FaceVarying))],
                ..Attributes::default()
            },
            holes: HashSet::new(),
            left_handed,
            remade: Some((0..faces).collect()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measures(bands: &[Band]) -> (f64, f64) {
        let mut shape = Shape::default();
        shape.revolve(bands);
        let (mut area, mut volume, mut first) = (0.0, 0.0, 0);
        for &count in &shape.counts {
            let corner = |k: usize| shape.points[shape.indices[first + k] as usize].as_dvec3();
            for k in 1..count as usize - 1 {
                let [a, b, c] = [corner(0), corner(k), corner(k + 1)];
                let cross = (b - a).cross(c - a);
                assert!(cross.dot(shape.normals[first + k].as_dvec3()) > 0.0, "a face is turned inwards");
                area += cross.length() / 2.0;
                volume += a.dot(cross) / 6.0;
            }
            first += count as usize;
        }
        (area, volume)
    }

    #[test]
    fn areas_and_volumes_are_those_of_the_shapes() {
        let pi = std::f64::consts::PI;
        for (name, bands, area, volume) in [
            ("sphere", sphere(2.0), 16.0 * pi, 32.0 / 3.0 * pi),
            ("cylinder", cylinder([0.5, 0.5], 3.0), 3.5 * pi, 0.75 * pi),
            ("cone", cylinder([3.0, 0.0], 4.0), 24.0 * pi, 12.0 * pi),
            ("capsule", capsule([0.5, 0.5], 1.0), 2.0 * pi, (0.25 + 1.0 / 6.0) * pi),
        ] {
            let (found, filled) = measures(&bands);
            assert!((found / area - 1.0).abs() < 0.005, "{name}: area {found} is not {area}");
            assert!((filled / volume - 1.0).abs() < 0.01, "{name}: volume {filled} is not {volume}");
        }
    }
}
