//! Scenes of unlike pieces, and two bakes of one scene side by side, texel by texel.

use super::{Quad, atlas, room, scene};
use glam::{Affine3A, Vec2, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::{Illuminated, illuminate};
use lumel::post::denoise::Denoise;
use lumel::progress::Silent;
use lumel::scene::{Environment, Light, LightShape, Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin};
use lumel::settings::{Gather, Method, Normals, Quality, Settings};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use std::f32::consts::TAU;

/// A scene with its texels.
pub struct Case {
    pub name: &'static str,
    pub scene: Scene,
    pub atlas: Atlas,
    pub normals: Normals,
}

impl Case {
    pub fn of_quads(name: &'static str, quads: &[Quad], texels: u32) -> Self {
        Self { name, scene: scene(quads), atlas: atlas(quads.len(), texels), normals: Normals::Geometric }
    }

    pub fn of_pieces(name: &'static str, pieces: &[Piece]) -> Self {
        let (scene, atlas) = pieces_scene(pieces);
        Self { name, scene, atlas, normals: Normals::Geometric }
    }

    pub fn light(mut self, shape: LightShape) -> Self {
        self.scene.lights.push(Light::new("lamp", shape));
        self
    }

    pub fn sky(mut self, radiance: f32) -> Self {
        self.scene.environment = Some(Environment::constant("sky", Rgb::splat(radiance)));
        self
    }

    pub fn bake(&self, settings: &Settings) -> Illuminated {
        let settings = Settings { normals: self.normals, ..settings.clone() };
        illuminate(&self.scene, &self.atlas, &settings, &Silent).unwrap()
    }

    /// By blocks, to `percent`.
    pub fn blocks(&self, percent: f64, seed: u32) -> Illuminated {
        self.bake(&Settings { gather: Gather::Blocks, error: Some(percent), seed, ..Settings::default() })
    }

    /// By the final gather, with so many rays a texel.
    pub fn gathered(&self, samples: u32) -> Illuminated {
        let quality = Quality::High;
        let base = Settings { gather: Gather::Final, quality, seed: 99, denoise: Denoise::Off, ..Settings::default() };
        self.bake(&Settings { samples: Some(samples), ..base })
    }

    pub fn paths(&self, samples: u32) -> Illuminated {
        let denoise = Denoise::Off;
        self.bake(&Settings { method: Method::Path, samples: Some(samples), seed: 77, denoise, ..Settings::default() })
    }
}

/// Differences of luminance, over the mean of the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Off {
    /// Root mean square without the worst 1 % of the area, less what the truth's own noise makes of it.
    pub rms: f64,
    /// Of the means.
    pub bias: f64,
    pub median: f64,
    pub p95: f64,
    pub worst: f64,
    /// Root mean square of all texels near the feature, less noise; and of the means there.
    pub near: f64,
    pub near_bias: f64,
}

impl std::fmt::Display for Off {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [rms, bias, median, p95, worst, near, near_bias] =
            [self.rms, self.bias, self.median, self.p95, self.worst, self.near, self.near_bias].map(|v| 100.0 * v);
        write!(f, "rms {rms:.2}, bias {bias:+.2}, median {median:.2}, p95 {p95:.2}, worst {worst:.1}")?;
        write!(f, ", near rms {near:.2}, near bias {near_bias:+.2} %")
    }
}

/// `test` against `truth`, weighed by the area in the open.
pub fn off(test: &Illuminated, truth: &Illuminated, near: &dyn Fn(Vec3) -> bool) -> Off {
    let light = |b: &Illuminated, i: usize| f64::from(luminance(b.gathered.irradiance[i]));
    let noise = |i: usize| f64::from(luminance(truth.gathered.standard_error[i])).powi(2);
    let open: Vec<usize> = (0..truth.patches.len()).filter(|&i| truth.exposure.area[i] > 0.0).collect();
    let area = |i: usize| f64::from(truth.exposure.area[i]);
    let whole: f64 = open.iter().map(|&i| area(i)).sum();
    let mean = open.iter().map(|&i| area(i) * light(truth, i)).sum::<f64>() / whole;
    let mut all: Vec<(f64, f64, f64, bool)> = open
        .iter()
        .map(|&i| (light(test, i) - light(truth, i), area(i), noise(i), near(truth.patches.position[i])))
        .collect();
    all.sort_unstable_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let (mut seen, mut square, mut off) = (0.0, 0.0, Off::default());
    let (mut near_area, mut near_square, mut near_sum) = (0.0, 0.0, 0.0);
    for &(d, a, noise, is_near) in &all {
        if seen < 0.99 * whole {
            square += a * (d * d - noise);
        }
        if seen < 0.5 * whole {
            off.median = d.abs() / mean;
        }
        if seen < 0.95 * whole {
            off.p95 = d.abs() / mean;
        }
        seen += a;
        off.bias += a * d / whole / mean;
        off.worst = d.abs() / mean;
        if is_near {
            near_area += a;
            near_square += a * (d * d - noise);
            near_sum += a * d;
        }
    }
    off.rms = (square / (0.99 * whole)).max(0.0).sqrt() / mean;
    if near_area > 0.0 {
        off.near = (near_square / near_area).max(0.0).sqrt() / mean;
        off.near_bias = near_sum / near_area / mean;
    }
    off
}

/// Root mean square of the differences of luminance between two bakes of the same texels, over the mean, and that of the means.
pub fn differences(a: &Illuminated, b: &Illuminated) -> (f64, f64) {
    let (mut square, mut bias, mut sum, mut area) = (0.0, 0.0, 0.0, 0.0);
    for i in 0..a.patches.len() {
        let w = f64::from(b.patches.area[i]);
        let [x, y] = [a, b].map(|lit| f64::from(luminance(lit.gathered.irradiance[i])));
        (square, bias) = (square + w * (x - y).powi(2), bias + w * (x - y));
        (sum, area) = (sum + w * y, area + w);
    }
    ((square / area).sqrt() / (sum / area), bias / sum)
}

/// Error that a bake by blocks states.
pub fn stated(baked: &Illuminated) -> f64 {
    let exchanged = baked.exchanged.expect("no blocks");
    exchanged.noise.hypot(exchanged.bias)
}

/// A mesh of one chart, `size` texels, with texture coordinates in the unit square.
pub struct Piece {
    pub mesh: Mesh,
    pub uv: Vec<[Vec2; 3]>,
    pub size: [u32; 2],
    pub albedo: f32,
    pub emission: f32,
}

/// A quad with its texels along `u` and `v`.
pub fn flat(q: &Quad, size: [u32; 2]) -> Piece {
    let [a, b, c, d] = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(Vec2::from);
    Piece {
        mesh: Mesh {
            positions: vec![q.corner, q.corner + q.u, q.corner + q.u + q.v, q.corner + q.v],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_material: vec![0; 2],
            origin: vec![TriangleOrigin::default(); 2],
            ..Mesh::default()
        },
        uv: vec![[a, b, c], [a, c, d]],
        size,
        albedo: q.albedo,
        emission: q.emission,
    }
}

/// A wall of `height` over the line through `profile` (x, z), its front on the right of the way seen from below; `normals` as
/// vertices have them.
pub fn strip(profile: &[Vec2], height: f32, size: [u32; 2], normals: Option<Vec<Vec3>>) -> Piece {
    let n = profile.len();
    let at = |k: usize, top: f32| Vec3::new(profile[k].x, top * height, profile[k].y);
    let uv = |k: usize, top: f32| Vec2::new(k as f32 / (n - 1) as f32, top);
    let mut mesh = Mesh::default();
    for k in 0..n {
        mesh.positions.extend([at(k, 0.0), at(k, 1.0)]);
        if let Some(normals) = &normals {
            mesh.normals.extend([normals[k]; 2]);
        }
    }
    let mut corners = Vec::new();
    for k in 0..n - 1 {
        let v = 2 * k as u32;
        mesh.triangles.extend([[v, v + 2, v + 3], [v, v + 3, v + 1]]);
        corners.push([uv(k, 0.0), uv(k + 1, 0.0), uv(k + 1, 1.0)]);
        corners.push([uv(k, 0.0), uv(k + 1, 1.0), uv(k, 1.0)]);
    }
    mesh.triangle_material = vec![0; corners.len()];
    mesh.origin = vec![TriangleOrigin::default(); corners.len()];
    Piece { mesh, uv: corners, size, albedo: 0.5, emission: 0.0 }
}

/// A column around (0, 0), fronts outside, of `sides` and a radius that depends on the turn (0 to 1).
pub fn column(sides: u32, radius: impl Fn(f32) -> f32, height: f32, size: [u32; 2], smooth: bool) -> Piece {
    let around = |k: u32| Vec2::from_angle(-TAU * k as f32 / sides as f32);
    let profile: Vec<Vec2> = (0..=sides).map(|k| around(k) * radius(k as f32 / sides as f32)).collect();
    let normals = smooth.then(|| (0..=sides).map(|k| Vec3::new(around(k).x, 0.0, around(k).y)).collect());
    strip(&profile, height, size, normals)
}

fn pieces_scene(pieces: &[Piece]) -> (Scene, Atlas) {
    let mut scene = Scene::default();
    let width = 4 + pieces.iter().map(|p| p.size[0]).max().unwrap();
    let height = 2 + pieces.iter().map(|p| p.size[1] + 2).sum::<u32>();
    let (mut top, mut meshes) = (2, Vec::new());
    for (k, piece) in pieces.iter().enumerate() {
        let [albedo, emission] = [piece.albedo, piece.emission].map(Rgb::splat);
        scene.materials.push(Material { albedo, emission, ..Material::default() });
        let mut mesh = piece.mesh.clone();
        mesh.name = format!("piece{k}");
        mesh.triangle_material.fill(k as u32);
        scene.meshes.push(mesh);
        scene.surfaces.push(Surface {
            name: format!("piece{k}"),
            mesh: k,
            world_from_local: Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
            role: Default::default(),
        });
        let size = Vec2::new(piece.size[0] as f32, piece.size[1] as f32);
        let place = |uv: Vec2| (uv * size + Vec2::new(2.0, top as f32)) / Vec2::new(width as f32, height as f32);
        let count = piece.uv.len();
        meshes.push(MeshUvs {
            corners: piece.uv.iter().map(|t| t.map(place)).collect(),
            chart: vec![0; count],
            chart_count: 1,
            authored: None,
        });
        top += piece.size[1] + 2;
    }
    let placements = vec![Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO }; pieces.len()];
    (scene, Atlas { pages: vec![[width, height]], meshes, placements, density: 1.0, padding: 2, shown_pages: 1 })
}

/// A closed box from `corner`, fronts outside.
pub fn block(corner: [f32; 3], size: [f32; 3]) -> Vec<Quad> {
    let outward = |mut q: Quad| {
        q.corner += Vec3::from(corner);
        std::mem::swap(&mut q.u, &mut q.v);
        q
    };
    room(size).into_iter().map(outward).collect()
}

/// A room with a lamp in the ceiling and a block in the middle.
pub fn room_with_a_block(texels: u32) -> Case {
    let mut quads: Vec<Quad> = room([3., 3., 3.]).into_iter().map(|q| q.albedo(0.7)).collect();
    quads.push(Quad::new([1., 2.99, 1.], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(10.0));
    quads.extend(block([0.6, 0.01, 1.3], [0.8, 1.4, 0.8]).into_iter().map(|q| q.albedo(0.6)));
    Case::of_quads("room with a block", &quads, texels)
}

/// A room that sun and sky shine into through a window.
pub fn sunroom(texels: u32) -> Case {
    let mut quads = room([4., 3., 4.]);
    quads.remove(3);
    for [z, y, width, height] in [[0., 0., 4., 1.], [0., 2.2, 4., 0.8], [0., 1., 1.2, 1.2], [2.8, 1., 1.2, 1.2]] {
        quads.push(Quad::new([4., y, z], [0., 0., width], [0., height, 0.]));
    }
    let quads: Vec<Quad> = quads.into_iter().map(|q| q.albedo(0.6)).collect();
    let direction = Vec3::new(-1.0, -0.8, 0.2).normalize();
    Case::of_quads("sunroom", &quads, texels)
        .light(LightShape::Directional { direction, illuminance: Rgb::splat(100.0), angle: 0.0093 })
        .sky(5.0)
}

/// A lamp in the ceiling, and a thin double-sided shelf that keeps it from half of the floor.
pub fn room_with_a_shelf(texels: u32) -> Case {
    let mut quads: Vec<Quad> = room([4., 3., 4.]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([1.5, 2.95, 1.5], [1., 0., 0.], [0., 0., 1.]).albedo(0.0).emission(20.0));
    quads.push(Quad::new([0.3, 1.2, 0.4], [0., 0., 3.], [2., 0., 0.]).albedo(0.7).double_sided());
    Case::of_quads("room with a shelf", &quads, texels)
}

/// A point light on one side of a thin double-sided wall: what lies behind it is lit around its end alone.
pub fn divided_room(texels: u32) -> Case {
    let mut quads: Vec<Quad> = room([4., 2.5, 3.]).into_iter().map(|q| q.albedo(0.7)).collect();
    quads.push(Quad::new([2., 0., 0.], [0., 0., 2.], [0., 2.5, 0.]).albedo(0.5).double_sided());
    let position = Vec3::new(3.2, 1.9, 0.8);
    Case::of_quads("divided room", &quads, texels).light(LightShape::Point {
        position,
        intensity: Rgb::splat(50.0),
        range: None,
    })
}

/// A round column on a floor, beside a wall, under a sky.
pub fn round_column(smooth: bool) -> Case {
    let floor = Quad::new([-1.5, 0., -1.5], [0., 0., 3.], [3., 0., 0.]).albedo(0.6);
    let wall = Quad::new([-1.5, 0., -1.2], [3., 0., 0.], [0., 2., 0.]).albedo(0.8);
    let name = if smooth { "smooth column" } else { "flat column" };
    let pieces = [flat(&floor, [32, 32]), flat(&wall, [32, 24]), column(24, |_| 0.4, 1.6, [48, 24], smooth)];
    let normals = if smooth { Normals::Shading } else { Normals::Geometric };
    Case { normals, ..Case::of_pieces(name, &pieces).sky(1.0) }
}

/// A block on a floor under a picture of the sky: blue, brighter towards the horizon, with a small sun.
pub fn picture_sky(texels: u32) -> Case {
    let (width, height) = (64, 32);
    let mut picture = Vec::new();
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let sky = 0.5 + y as f32 / 32.0;
        let is_sun = (8..10).contains(&y) && (20..22).contains(&x);
        picture.push(if is_sun { [600., 550., 450., 1.] } else { [0.6 * sky, 0.8 * sky, sky, 1.] });
    }
    let mut quads = vec![Quad::new([-1.5, 0., -1.5], [0., 0., 3.], [3., 0., 0.])];
    quads.extend(block([-0.4, 0.002, -0.3], [0.7, 0.9, 0.7]));
    let mut case = Case::of_quads("picture sky", &quads, texels).sky(1.0);
    let texels = lumel::scene::Texels::Float(picture);
    case.scene.textures.push(lumel::scene::Texture { name: "sky".into(), width, height, texels });
    case.scene.environment.as_mut().unwrap().texture = Some(0);
    case
}
