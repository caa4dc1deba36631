//! Lightmap values at the corners of triangles, for vertex colours.
//!
//! A corner's value is read from its page, then averaged over the corners at the same place of the surface that face the
//! same way: smooth surfaces show no cracks of colour at chart seams, and hard edges keep the light of each side.

use super::{LitMesh, VertexLight};
use crate::color::Rgb;
use crate::post::{Lightmap, PageImage, Quantity};
use crate::scene::{Mesh, Scene};
use crate::unwrap::Atlas;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Cosine of the largest angle between the flat faces of what still counts as one smooth surface: 30 degrees, as modelling
/// tools' smoothing has it by default.
const FLAT_COS: f32 = 0.866_025_4;
/// Cosine between authored normals that are one and the same: 1 degree, for quantized ones.
const SMOOTH_COS: f32 = 0.999_847_7;
/// How far [texels] a covered texel is looked for where none surrounds a corner.
const SEARCH: i64 = 4;

/// The lightmap's values at all triangle corners of all surfaces.
pub fn corner_light(scene: &Scene, atlas: &Atlas, lightmap: &Lightmap) -> VertexLight {
    let surface_colors = |surface: usize| {
        if !scene.surfaces[surface].role.receives {
            return LitMesh::default();
        }
        let mesh_index = scene.surfaces[surface].mesh;
        let mesh = &scene.meshes[mesh_index];
        let page = &lightmap.pages[atlas.placements[surface].page as usize];
        let mut colors: Vec<[Rgb; 3]> = (0..mesh.triangles.len())
            .map(|t| atlas.page_texels(surface, mesh_index, t).map(|at| sample(page, at)))
            .collect();
        // What leaves a surface changes with its material; what arrives doesn't.
        average(mesh, lightmap.quantity == Quantity::Radiosity, &mut colors);
        LitMesh::given(colors)
    };
    VertexLight { surfaces: (0..scene.surfaces.len()).into_par_iter().map(surface_colors).collect() }
}

/// Bilinear over the covered ones of the four texels around `at` [texels]; else the nearest covered texel within
/// [`SEARCH`]; else what dilation left there.
fn sample(page: &PageImage, at: Vec2) -> Rgb {
    let (width, height) = (i64::from(page.width), i64::from(page.height));
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let (x, y) = (corner.x as i64, corner.y as i64);
    let texel = |x: i64, y: i64| (y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize;
    let around = [(0, 0, 1.0 - f.x, 1.0 - f.y), (1, 0, f.x, 1.0 - f.y), (0, 1, 1.0 - f.x, f.y), (1, 1, f.x, f.y)];
    let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
    for (dx, dy, wx, wy) in around {
        let i = texel(x + dx, y + dy);
        if page.coverage[i] > 0.0 {
            sum += page.rgb[i] * (wx * wy);
            weights += wx * wy;
        }
    }
    // Below this the covered texels barely touch the corner, and the quotient would be rounding.
    if weights > 1e-4 {
        return sum / weights;
    }
    let (x, y) = (at.x.floor() as i64, at.y.floor() as i64);
    let distance = |x: i64, y: i64| (Vec2::new(x as f32, y as f32) + 0.5).distance_squared(at);
    let mut nearest: Option<(f32, usize)> = None;
    for v in (y - SEARCH).max(0)..=(y + SEARCH).min(height - 1) {
        for u in (x - SEARCH).max(0)..=(x + SEARCH).min(width - 1) {
            let (d, i) = (distance(u, v), texel(u, v));
            if page.coverage[i] > 0.0 && nearest.is_none_or(|(least, _)| d < least) {
                nearest = Some((d, i));
            }
        }
    }
    page.rgb[nearest.map_or(texel(x, y), |(_, i)| i)]
}

/// Averages `colors` over the corners that share a position and a direction, by their angles in the triangles.
fn average(mesh: &Mesh, by_material: bool, colors: &mut [[Rgb; 3]]) {
    let smooth = !mesh.normals.is_empty();
    let least_cos = if smooth { SMOOTH_COS } else { FLAT_COS };
    let normals: Vec<Vec3> =
        mesh.triangles.iter().map(|t| face_normal(t.map(|v| mesh.positions[v as usize]))).collect();
    let normal = |(t, k): (usize, usize)| if smooth { mesh.normals[mesh.triangles[t][k] as usize] } else { normals[t] };
    let material = |t: usize| if by_material { mesh.triangle_material[t] } else { 0 };
    let position = |(t, k): (usize, usize)| mesh.positions[mesh.triangles[t][k] as usize];
    let mut corners: Vec<(usize, usize)> = (0..colors.len()).flat_map(|t| [(t, 0), (t, 1), (t, 2)]).collect();
    // Adding zero makes -0 and 0 one place. The sort is stable: corners stay in the order of triangles.
    corners.sort_by_key(|c| ((position(*c) + 0.0).to_array().map(f32::to_bits), material(c.0)));
    for place in corners.chunk_by(|a, b| position(*a) == position(*b) && material(a.0) == material(b.0)) {
        let mut groups: Vec<(Vec3, Vec<(usize, usize)>)> = Vec::new();
        for corner in place {
            let n = normal(*corner);
            match groups.iter_mut().find(|(direction, _)| direction.dot(n) >= least_cos) {
                Some((_, members)) => members.push(*corner),
                None => groups.push((n, vec![*corner])),
            }
        }
        for (_, members) in groups.iter().filter(|(_, members)| members.len() > 1) {
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for (t, k) in members {
                let weight = f64::from(angle(mesh.triangles[*t].map(|v| mesh.positions[v as usize]), *k)).max(1e-6);
                sum += colors[*t][*k].as_dvec3() * weight;
                weights += weight;
            }
            let mean = (sum / weights).as_vec3();
            members.iter().for_each(|(t, k)| colors[*t][*k] = mean);
        }
    }
}

fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3()
}

/// The angle [rad] of a triangle at corner `k`.
fn angle(p: [Vec3; 3], k: usize) -> f32 {
    let (to_next, to_last) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
    to_next.normalize_or_zero().dot(to_last.normalize_or_zero()).clamp(-1.0, 1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Surface, SurfaceOrigin};
    use crate::unwrap::{MeshUvs, Placement};
    use glam::Affine3A;

    /// Two unit squares that meet at the y axis with an angle of `degrees` between their normals, each on its half of a
    /// 16 x 8 page with two empty columns between: left 1, right 3.
    fn hinge(degrees: f32, smooth: bool) -> Vec<[Rgb; 3]> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let quads = [
            [[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [cos, 0.0, -sin], [cos, 1.0, -sin], [0.0, 1.0, 0.0]],
        ];
        let uv = |u0: f32, u1: f32| {
            let [a, b, c, d] = [[u0, 0.0], [u1, 0.0], [u1, 1.0], [u0, 1.0]].map(Vec2::from_array);
            [[a, b, c], [a, c, d]]
        };
        let mesh = Mesh {
            positions: quads.concat().into_iter().map(Vec3::from_array).collect(),
            normals: if smooth { vec![Vec3::Z; 8] } else { Vec::new() },
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            triangle_material: vec![0; 4],
            origin: vec![Default::default(); 4],
            ..Mesh::default()
        };
        let scene = Scene {
            meshes: vec![mesh],
            materials: vec![Material::default()],
            surfaces: vec![Surface {
                name: "hinge".into(),
                mesh: 0,
                world_from_local: Affine3A::IDENTITY,
                origin: SurfaceOrigin::None,
                role: crate::scene::Role::default(),
            }],
            ..Scene::default()
        };
        let atlas = Atlas {
            pages: vec![[16, 8]],
            meshes: vec![MeshUvs {
                corners: [uv(0.0, 7.0 / 16.0), uv(9.0 / 16.0, 1.0)].concat(),
                chart: vec![0, 0, 1, 1],
                chart_count: 2,
                authored: None,
            }],
            placements: vec![Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO }],
            density: 8.0,
            padding: 2,
            shown_pages: 1,
        };
        let column = |x: usize| if x < 8 { 1.0 } else { 3.0 };
        let page = PageImage {
            width: 16,
            height: 8,
            rgb: (0..128).map(|i| Rgb::splat(column(i % 16))).collect(),
            coverage: (0..128).map(|i| if (7..9).contains(&(i % 16)) { 0.0 } else { 1.0 }).collect(),
        };
        let lightmap = Lightmap { pages: vec![page], quantity: Quantity::Outgoing, layers: Vec::new() };
        corner_light(&scene, &atlas, &lightmap).surfaces[0].triangles.iter().map(|t| t.values).collect()
    }

    #[test]
    fn a_bend_is_smooth_and_an_edge_is_hard() {
        let bend = hinge(20.0, false);
        assert_eq!(bend[0], [Rgb::ONE, Rgb::splat(2.0), Rgb::splat(2.0)]);
        assert_eq!(bend[3], [Rgb::splat(2.0), Rgb::splat(3.0), Rgb::splat(2.0)]);
        let edge = hinge(90.0, false);
        assert_eq!(edge, [[Rgb::ONE; 3], [Rgb::ONE; 3], [Rgb::splat(3.0); 3], [Rgb::splat(3.0); 3]]);
    }

    #[test]
    fn authored_normals_decide() {
        assert_eq!(hinge(90.0, true)[0][1], Rgb::splat(2.0));
    }

    #[test]
    fn corners_without_coverage_take_the_nearest_texel() {
        let mut page = PageImage { width: 8, height: 1, rgb: vec![Rgb::ZERO; 8], coverage: vec![0.0; 8] };
        page.rgb[5] = Rgb::ONE;
        assert_eq!(sample(&page, Vec2::new(2.5, 0.5)), Rgb::ZERO);
        page.coverage[5] = 0.1;
        assert_eq!(sample(&page, Vec2::new(2.5, 0.5)), Rgb::ONE);
        assert_eq!(sample(&page, Vec2::new(-9.0, 70.0)), Rgb::ZERO);
    }
}
