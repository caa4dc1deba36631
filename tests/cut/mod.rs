//! A tetrahedron, and a way to cut meshes that tests know by heart.
#![allow(dead_code)] // each test file uses its own share

use glam::{DVec3, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::meshing::{LitMesh, LitTriangle, Weights};
use lumel::scene::{Mesh, Scene};
use lumel::unwrap::{Atlas, Placement};
use std::collections::HashMap;

/// A tetrahedron's corners: numbers whose blends need rounding.
pub const POINTS: [[f32; 3]; 4] = [[0.1, 0.2, 0.3], [1.7, 0.3, -0.1], [0.4, 2.3, 0.7], [0.9, 0.6, 3.1]];
/// Its faces, outward.
pub const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

/// Where edges are cut, seen from the end that comes first by the bits of its place.
const PART: f64 = 0.3;

/// Cuts a triangle into six pieces: one at each corner, three around the middle. The light is a function of the place.
fn pieces(source: u32, p: [Vec3; 3]) -> Vec<LitTriangle> {
    let bits = |k: usize| (p[k] + 0.0).to_array().map(f32::to_bits);
    let edge = |a: usize, b: usize| {
        let (a, b) = if bits(a) < bits(b) { (a, b) } else { (b, a) };
        Weights::CORNERS[a].lerp(Weights::CORNERS[b], PART)
    };
    let [a, b, c] = Weights::CORNERS;
    let (ab, bc, ca) = (edge(0, 1), edge(1, 2), edge(2, 0));
    let middle = Weights(DVec3::new(0.25, 0.5, 0.25));
    let all = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, middle], [bc, ca, middle], [ca, ab, middle]];
    let light = |place: Weights| {
        let at: DVec3 = place.terms(p).map(|(k, w)| p[k].as_dvec3() * w).sum();
        Rgb::new(1.0, 2.0, 3.0) + at.as_vec3().abs()
    };
    all.into_iter().map(|corners| LitTriangle { source, corners, values: corners.map(light) }).collect()
}

/// An atlas without pages: every surface is hidden, and has vertex colours alone.
pub fn hidden(scene: &Scene) -> Atlas {
    let placement = Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO };
    Atlas {
        pages: Vec::new(),
        meshes: Vec::new(),
        placements: vec![placement; scene.surfaces.len()],
        density: 1.0,
        padding: 2,
        shown_pages: 0,
    }
}

pub fn cut(mesh: &Mesh) -> LitMesh {
    let of = |(t, triangle): (usize, &[u32; 3])| pieces(t as u32, triangle.map(|v| mesh.positions[v as usize]));
    LitMesh { triangles: mesh.triangles.iter().enumerate().flat_map(of).collect() }
}

/// Asserts that each edge has exactly one that runs the other way, by the bits of its ends, and that the volume is the
/// tetrahedron's but for rounding.
pub fn assert_closed(triangles: &[[Vec3; 3]], points: [Vec3; 4]) {
    assert_eq!(triangles.len(), 24);
    let bits = |p: Vec3| p.to_array().map(f32::to_bits);
    let mut edges: HashMap<_, i32> = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (bits(t[k]), bits(t[(k + 1) % 3]));
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { 1 << 16 };
        }
    }
    assert!(edges.values().all(|count| *count == 1 + (1 << 16)), "an edge is torn");
    let volume = |[a, b, c]: [Vec3; 3]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0;
    let whole: f64 = FACES.iter().map(|f| volume(f.map(|k| points[k]))).sum();
    let found: f64 = triangles.iter().map(|t| volume(*t)).sum();
    assert!(whole > 0.0 && (found - whole).abs() < 1e-4 * whole, "{found} of {whole}");
}
