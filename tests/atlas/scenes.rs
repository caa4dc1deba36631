//! Small scenes to unwrap.

use glam::{Affine3A, Quat, Vec3};
use lumel::scene::{Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin};

/// A mesh of polygons over `positions`, fanned; each polygon has a material.
pub fn mesh(positions: Vec<Vec3>, polygons: &[(Vec<u32>, u32)]) -> Mesh {
    let mut mesh = Mesh { positions, ..Mesh::default() };
    for (face, (polygon, material)) in polygons.iter().enumerate() {
        for k in 1..polygon.len() - 1 {
            let corners = [polygon[0], polygon[k], polygon[k + 1]];
            mesh.triangles.push(corners);
            mesh.triangle_material.push(*material);
            mesh.origin.push(TriangleOrigin { part: 0, face: face as u32, corners });
        }
    }
    mesh
}

pub fn quads(polygons: &[[u32; 4]]) -> Vec<(Vec<u32>, u32)> {
    polygons.iter().map(|q| (q.to_vec(), 0)).collect()
}

pub fn cube(size: Vec3) -> Mesh {
    let positions = (0..8).map(|i| size * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    mesh(positions, &quads(&faces))
}

/// A sphere of quads (triangles at the poles), smooth enough to need curved charts.
pub fn sphere(radius: f32, segments: u32, rings: u32) -> Mesh {
    let mut positions = vec![Vec3::new(0.0, radius, 0.0)];
    for r in 1..rings {
        for s in 0..segments {
            let (theta, phi) =
                (std::f32::consts::PI * r as f32 / rings as f32, std::f32::consts::TAU * s as f32 / segments as f32);
            positions.push(radius * Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin()));
        }
    }
    positions.push(Vec3::new(0.0, -radius, 0.0));
    let at = |r: u32, s: u32| 1 + (r - 1) * segments + s % segments;
    let mut polygons = Vec::new();
    for s in 0..segments {
        polygons.push((vec![0, at(1, s), at(1, s + 1)], 0));
        for r in 1..rings - 1 {
            polygons.push((vec![at(r, s), at(r + 1, s), at(r + 1, s + 1), at(r, s + 1)], 0));
        }
        polygons.push((vec![at(rings - 1, s), positions.len() as u32 - 1, at(rings - 1, s + 1)], 0));
    }
    mesh(positions, &polygons)
}

pub fn surface(name: &str, mesh: usize, world_from_local: Affine3A) -> Surface {
    Surface { name: name.into(), mesh, world_from_local, origin: SurfaceOrigin::None, role: Default::default() }
}

pub fn scene(meshes: Vec<Mesh>) -> Scene {
    let surfaces = (0..meshes.len()).map(|m| surface(&format!("/s{m}"), m, Affine3A::IDENTITY)).collect();
    Scene { meshes, surfaces, materials: vec![Material::default(), Material::default()], ..Scene::default() }
}

/// Five walls and two turned boxes: the shape of the Cornell box.
pub fn cornell() -> Scene {
    let s = 0.55;
    let walls = cube(Vec3::splat(s));
    let mut faces: Vec<[u32; 4]> = vec![[0, 1, 3, 2], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let room = mesh(walls.positions, &quads(&std::mem::take(&mut faces)));
    let mut scene = scene(vec![room, cube(Vec3::new(0.165, 0.33, 0.165)), cube(Vec3::splat(0.165))]);
    scene.surfaces[1].world_from_local =
        Affine3A::from_rotation_translation(Quat::from_rotation_y(0.3), Vec3::new(0.1, 0.0, 0.2));
    scene.surfaces[2].world_from_local =
        Affine3A::from_rotation_translation(Quat::from_rotation_y(-0.3), Vec3::new(0.3, 0.0, 0.3));
    scene
}
