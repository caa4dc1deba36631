//! Scenes made of rectangles, with an atlas that needs no unwrapping, for tests with known answers.
#![allow(dead_code)]

pub mod measure;

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
            role: Default::default(),
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
        shown_pages: 1,
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

/// A surface for each list of world triangles, counter-clockwise seen from the front.
pub fn mesh_scene(surfaces: &[Vec<[Vec3; 3]>]) -> Scene {
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    for (i, triangles) in surfaces.iter().enumerate() {
        let mut positions = Vec::new();
        let mut known = std::collections::HashMap::new();
        let mut vertex = |p: Vec3| {
            *known.entry(p.to_array().map(f32::to_bits)).or_insert_with(|| {
                positions.push(p);
                positions.len() as u32 - 1
            })
        };
        let corners = triangles.iter().map(|t| t.map(&mut vertex)).collect();
        scene.meshes.push(Mesh {
            name: format!("mesh{i}"),
            positions,
            triangles: corners,
            triangle_material: vec![0; triangles.len()],
            origin: vec![TriangleOrigin::default(); triangles.len()],
            ..Mesh::default()
        });
        scene.surfaces.push(Surface {
            name: format!("mesh{i}"),
            mesh: i,
            world_from_local: Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
            role: Default::default(),
        });
    }
    scene
}

/// A chart for each triangle of a [`mesh_scene`]: half a square of `texels` along each side, two texels apart.
pub fn mesh_atlas(surfaces: &[Vec<[Vec3; 3]>], texels: u32) -> Atlas {
    let total: usize = surfaces.iter().map(Vec::len).sum();
    let columns = (total as f64).sqrt().ceil() as u32;
    let cell = texels + 2;
    let size = columns * cell + 2;
    let mut place = 0;
    let meshes = surfaces.iter().map(|triangles| {
        let corners = triangles.iter().map(|_| {
            let (x, y) = (place % columns * cell + 2, place / columns * cell + 2);
            place += 1;
            [(0, 0), (texels, 0), (0, texels)]
                .map(|(dx, dy)| Vec2::new((x + dx) as f32 / size as f32, (y + dy) as f32 / size as f32))
        });
        let corners: Vec<[Vec2; 3]> = corners.collect();
        let count = corners.len() as u32;
        MeshUvs { corners, chart: (0..count).collect(), chart_count: count, authored: None }
    });
    Atlas {
        pages: vec![[size, size]],
        meshes: meshes.collect(),
        placements: vec![Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO }; surfaces.len()],
        density: 1.0,
        padding: 2,
        shown_pages: 1,
    }
}

/// A sphere of `rows` by twice as many `columns`, its front outside (or inside).
pub fn sphere(centre: Vec3, radius: f32, rows: u32, inside: bool) -> Vec<[Vec3; 3]> {
    let columns = 2 * rows;
    let at = |x: u32, y: u32| {
        let polar = std::f64::consts::PI * f64::from(y) / f64::from(rows);
        let azimuth = std::f64::consts::TAU * f64::from(x % columns) / f64::from(columns);
        let p = glam::DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
        centre
            + radius
                * if y == 0 {
                    Vec3::Y
                } else if y == rows {
                    Vec3::NEG_Y
                } else {
                    p.as_vec3()
                }
    };
    let mut triangles = Vec::new();
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
        if y > 0 {
            triangles.push([a, b, d]);
        }
        if y + 1 < rows {
            triangles.push([a, d, c]);
        }
    }
    if inside {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    triangles
}

/// A level disc of `count` triangles, its front up (or down).
pub fn disc(centre: Vec3, radius: f32, count: u32, down: bool) -> Vec<[Vec3; 3]> {
    let at = |k: u32| {
        let a = std::f32::consts::TAU * (k % count) as f32 / count as f32;
        centre + radius * Vec3::new(a.cos(), 0.0, a.sin())
    };
    let triangle = |k: u32| if down { [centre, at(k), at(k + 1)] } else { [centre, at(k + 1), at(k)] };
    (0..count).map(triangle).collect()
}

/// The triangles of a quad.
pub fn triangles(q: &Quad) -> Vec<[Vec3; 3]> {
    let [a, b, c, d] = [q.corner, q.corner + q.u, q.corner + q.u + q.v, q.corner + q.v];
    vec![[a, b, c], [a, c, d]]
}
