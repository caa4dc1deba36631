//! Scenes made of rectangles, with an atlas that needs no unwrapping, for tests with known answers.
#![allow(dead_code)]

use glam::{Affine3A, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::illuminate::{Illuminated, illuminate};
use lumel::progress::Silent;
use lumel::scene::{Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin};
use lumel::settings::{Normals, Settings};
use lumel::unwrap::{Atlas, MeshUvs, Placement};

/// A parallelogram from `corner` along `u` and `v`; its front is the side of `u x v`.
#[derive(Clone, Copy, Debug)]
pub struct Quad {
    pub corner: Vec3,
    pub u: Vec3,
    pub v: Vec3,
    pub albedo: f32,
    /// Radiance [nit].
    pub emission: f32,
    pub double_sided: bool,
}

impl Quad {
    pub fn new(corner: [f32; 3], u: [f32; 3], v: [f32; 3]) -> Self {
        let [corner, u, v] = [corner, u, v].map(Vec3::from);
        Self { corner, u, v, albedo: 0.5, emission: 0.0, double_sided: false }
    }

    pub fn albedo(self, albedo: f32) -> Self {
        Self { albedo, ..self }
    }

    pub fn emission(self, emission: f32) -> Self {
        Self { emission, ..self }
    }

    pub fn double_sided(self) -> Self {
        Self { double_sided: true, ..self }
    }
}

/// The six inner faces of the box from the origin to `size`.
pub fn room(size: [f32; 3]) -> Vec<Quad> {
    let [x, y, z] = size;
    vec![
        Quad::new([0., 0., 0.], [0., 0., z], [x, 0., 0.]),
        Quad::new([0., y, 0.], [x, 0., 0.], [0., 0., z]),
        Quad::new([0., 0., 0.], [0., y, 0.], [0., 0., z]),
        Quad::new([x, 0., 0.], [0., 0., z], [0., y, 0.]),
        Quad::new([0., 0., 0.], [x, 0., 0.], [0., y, 0.]),
        Quad::new([0., 0., z], [0., y, 0.], [x, 0., 0.]),
    ]
}

/// A surface for each quad.
pub fn scene(quads: &[Quad]) -> Scene {
    let mut scene = Scene::default();
    for (i, q) in quads.iter().enumerate() {
        scene.materials.push(Material {
            albedo: Rgb::splat(q.albedo),
            emission: Rgb::splat(q.emission),
            double_sided: q.double_sided,
            ..Material::default()
        });
        scene.meshes.push(Mesh {
            name: format!("quad{i}"),
            positions: vec![q.corner, q.corner + q.u, q.corner + q.u + q.v, q.corner + q.v],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_material: vec![i as u32; 2],
            origin: vec![TriangleOrigin::default(); 2],
            ..Mesh::default()
        });
        scene.surfaces.push(Surface {
            name: format!("quad{i}"),
            mesh: i,
            world_from_local: Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
        });
    }
    scene
}

/// Quads side by side on one page, `texels` along each side of each, two texels apart.
pub fn atlas(count: usize, texels: u32) -> Atlas {
    let columns = (count as f64).sqrt().ceil() as u32;
    let cell = texels + 2;
    let size = columns * cell + 2;
    let whole = size as f32;
    let mesh = |i: usize| {
        let (x, y) = (i as u32 % columns * cell + 2, i as u32 / columns * cell + 2);
        let at = |dx: u32, dy: u32| Vec2::new((x + dx) as f32 / whole, (y + dy) as f32 / whole);
        let [a, b, c, d] = [at(0, 0), at(texels, 0), at(texels, texels), at(0, texels)];
        MeshUvs { corners: vec![[a, b, c], [a, c, d]], chart: vec![0; 2], chart_count: 1, authored: None }
    };
    Atlas {
        pages: vec![[size, size]],
        meshes: (0..count).map(mesh).collect(),
        placements: vec![Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO }; count],
        density: 1.0,
        padding: 2,
    }
}

/// Bakes `scene` laid out by `atlas`.
pub fn bake(scene: &Scene, atlas: &Atlas, settings: &Settings) -> Illuminated {
    illuminate(scene, atlas, settings, &Silent).unwrap()
}

/// Bakes quads at `texels` along each side.
pub fn bake_quads(quads: &[Quad], texels: u32, settings: &Settings) -> Illuminated {
    bake(&scene(quads), &atlas(quads.len(), texels), settings)
}

/// Settings for tests: geometric normals, the draft preset.
pub fn draft() -> Settings {
    Settings { quality: lumel::settings::Quality::Draft, normals: Normals::Geometric, ..Settings::default() }
}
