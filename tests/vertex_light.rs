//! Light at vertices: it fits what a mesh can hold, and cut meshes follow what it can't, without a gap.

mod support;

use glam::{DVec3, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::meshing::fine::{FineMesh, edge};
use lumel::meshing::{LitMesh, MeshMode, MeshParams, Source, VertexLight, VertexReport, vertex_light};
use lumel::post::{Lightmap, PageImage, Quantity};
use lumel::progress::Silent;
use lumel::scene::Scene;
use lumel::scene::{Light, LightShape};
use lumel::unwrap::Atlas;
use std::collections::BTreeMap;
use support::{Quad, atlas, mesh_atlas, mesh_scene, room, scene, sphere};

/// A page that holds `light` of the world position under the middle of each texel; 0 between charts.
fn page(scene: &Scene, atlas: &Atlas, light: impl Fn(Vec3) -> f32) -> Lightmap {
    let [width, height] = atlas.pages[0];
    let mut page = PageImage {
        width,
        height,
        rgb: vec![Rgb::ZERO; (width * height) as usize],
        coverage: vec![0.0; (width * height) as usize],
    };
    for (s, surface) in scene.surfaces.iter().enumerate() {
        for t in 0..scene.meshes[surface.mesh].triangles.len() {
            let [a, b, c] = atlas.page_texels(s, surface.mesh, t);
            let world = scene.world_triangle(s, t);
            let twice = (b - a).perp_dot(c - a);
            for texel in 0..width * height {
                let p = Vec2::new((texel % width) as f32 + 0.5, (texel / width) as f32 + 0.5);
                let w = Vec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)) / twice;
                if w.min_element() >= -1e-4 {
                    page.rgb[texel as usize] = Rgb::splat(light(world[0] * w.x + world[1] * w.y + world[2] * w.z));
                    page.coverage[texel as usize] = 1.0;
                }
            }
        }
    }
    Lightmap { pages: vec![page], quantity: Quantity::Outgoing, layers: Vec::new() }
}

fn made(scene: &Scene, atlas: &Atlas, lightmap: &Lightmap, params: MeshParams) -> (VertexLight, VertexReport) {
    let source = Source { scene, atlas, lightmap, is_buried: &|_, _| false, mean: 1.0 };
    vertex_light(&source, &params, &Silent).unwrap()
}

const GIVEN: MeshParams = MeshParams { mode: MeshMode::Given, error: 0.05, max_triangles: None };
const ADAPTIVE: MeshParams = MeshParams { mode: MeshMode::Adaptive, ..GIVEN };

/// The root mean square of what `mesh` shows on quad 0 of `scene` less `light`, over a grid of points.
fn rms(scene: &Scene, mesh: &LitMesh, light: impl Fn(Vec3) -> f32) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for t in &mesh.triangles {
        let [a, b, c] = scene.world_triangle(0, t.source as usize).map(|p| p.as_dvec3());
        let corners = t.corners.map(|w| a * w.0.x + b * w.0.y + c * w.0.z);
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        for i in 0..10 {
            for j in 0..10 - i {
                let (u, v) = ((f64::from(i) + 1.0 / 3.0) / 10.0, (f64::from(j) + 1.0 / 3.0) / 10.0);
                let mix = |x: [DVec3; 3]| x[0] * u + x[1] * v + x[2] * (1.0 - u - v);
                let shown = mix(t.values.map(|v| v.as_dvec3())).x;
                sum += area * (shown - f64::from(light(mix(corners).as_vec3()))).powi(2);
                count += 1;
            }
        }
    }
    assert!(count > 0);
    (sum / 55.0).sqrt()
}

/// Panics where the pieces of `mesh` leave a gap, or meet an edge that another piece has a point on.
fn assert_watertight(scene: &Scene, surface: usize, mesh: &LitMesh) {
    let given = FineMesh::new(scene, surface);
    let placed = &scene.surfaces[surface];
    let local = &scene.meshes[placed.mesh];
    // Places as a writer finds them.
    let place = |t: u32, w: lumel::meshing::Weights| {
        let corners = local.triangles[t as usize].map(|v| local.positions[v as usize]);
        let sum: DVec3 = w.terms(corners).map(|(k, w)| corners[k].as_dvec3() * w).sum();
        (sum.as_vec3() + 0.0).to_array().map(f32::to_bits)
    };
    let mut edges: BTreeMap<[[u32; 3]; 2], u32> = BTreeMap::new();
    let mut area = vec![0.0; local.triangles.len()];
    for t in &mesh.triangles {
        let p = t.corners.map(|w| place(t.source, w));
        for k in 0..3 {
            let mut ends = [p[k], p[(k + 1) % 3]];
            ends.sort_unstable();
            *edges.entry(ends).or_default() += 1;
        }
        let m = glam::DMat3::from_cols(t.corners[0].0, t.corners[1].0, t.corners[2].0);
        assert!(m.determinant() > 0.0, "a piece is turned over");
        area[t.source as usize] += m.determinant();
    }
    area.iter().for_each(|a| assert!((a - 1.0).abs() < 1e-9, "pieces cover {a} of their triangle"));
    // Edges of one piece alone lie on the border of the mesh.
    let at_edges = given.pieces_at_edges();
    let border = at_edges.iter().filter(|(_, pieces)| pieces.len() == 1).map(|(edge, _)| edge);
    let border: Vec<[DVec3; 2]> = border.map(|e| e.map(|p| given.points[p as usize])).collect();
    let world =
        |bits: [u32; 3]| placed.world_from_local.transform_point3(Vec3::from(bits.map(f32::from_bits))).as_dvec3();
    let mut length = 0.0;
    for (ends, count) in &edges {
        assert!(*count <= 2, "{count} pieces at an edge");
        if *count == 1 {
            let [a, b] = ends.map(world);
            let is_on = |[p, q]: &[DVec3; 2]| {
                let way = (q - p).normalize();
                [a, b].iter().all(|x| (x - p).cross(way).length() < 1e-5)
            };
            assert!(border.iter().any(is_on), "an edge inside has one piece");
            length += a.distance(b);
        }
    }
    let whole: f64 = border.iter().map(|[p, q]| p.distance(*q)).sum();
    assert!((length - whole).abs() < 1e-4 * whole.max(1.0), "the border is {length} m long in place of {whole}");
}

fn floor() -> (Scene, Atlas) {
    (scene(&[Quad::new([0.; 3], [0., 0., 2.], [2., 0., 0.])]), atlas(1, 128))
}

#[test]
fn what_is_linear_is_held_as_it_is() {
    let (scene, atlas) = floor();
    let light = |p: Vec3| 1.0 + 0.5 * p.x + 0.25 * p.z;
    let (vertices, report) = made(&scene, &atlas, &page(&scene, &atlas, light), ADAPTIVE);
    assert!(vertices.surfaces[0].is_given());
    for (t, lit) in vertices.surfaces[0].triangles.iter().enumerate() {
        for (p, v) in scene.world_triangle(0, t).iter().zip(lit.values) {
            // By the share of the Laplacian.
            assert!((v.x - light(*p)).abs() < 4e-3, "{v} at {p}");
        }
    }
    assert!(report.within > 99.99 && report.p95 < 0.4, "{report:?}");
}

/// What `mesh` shows on surface 0 of `scene`, over its area.
fn mean_of(scene: &Scene, mesh: &LitMesh) -> f64 {
    let (mut sum, mut whole) = (0.0, 0.0);
    for t in &mesh.triangles {
        let [a, b, c] = scene.world_triangle(0, t.source as usize).map(|p| p.as_dvec3());
        let [a, b, c] = t.corners.map(|w| a * w.0.x + b * w.0.y + c * w.0.z);
        let area = 0.5 * (b - a).cross(c - a).length();
        sum += area * t.values.iter().map(|v| f64::from(v.x)).sum::<f64>() / 3.0;
        whole += area;
    }
    sum / whole
}

#[test]
fn a_patch_of_sun_on_few_triangles_keeps_its_light() {
    let (scene, atlas) = floor();
    for (side, corner) in [(0.5, [0.1, 0.1]), (0.3, [1.5, 0.2]), (0.8, [0.6, 0.6])] {
        let sun = |p: Vec3| {
            let inside = [p.x, p.z].iter().zip(corner).all(|(p, low)| (low..low + side).contains(p));
            if inside { 8.0 } else { 0.05 }
        };
        let lightmap = page(&scene, &atlas, sun);
        let texels = lightmap.pages[0].rgb.iter().zip(&lightmap.pages[0].coverage).filter(|(_, c)| **c > 0.0);
        let (sum, count) = texels.fold((0.0, 0.0), |(sum, count), (v, _)| (sum + f64::from(v.x), count + 1.0));
        let (vertices, _) = made(&scene, &atlas, &lightmap, GIVEN);
        let mesh = &vertices.surfaces[0];
        let off = mean_of(&scene, mesh) / (sum / count) - 1.0;
        // But for texels along the border, which are shared by the triangles.
        assert!(off.abs() < 4e-3, "{side} {corner:?}: {off}");
        let values = mesh.triangles.iter().flat_map(|t| t.values);
        assert!(values.clone().all(|v| v.min_element() >= 0.0), "{:?}", values.collect::<Vec<_>>());
    }
}

/// Two unit squares that meet at the y axis with an angle of `degrees` between their normals, in light 1 and 3.
fn hinge(degrees: f32, normals: bool) -> [LitMesh; 1] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let at = |x: f32, y: f32| if x <= 0.0 { Vec3::new(x, y, 0.0) } else { Vec3::new(x * cos, y, -x * sin) };
    let quad = |x0: f32, x1: f32| [[at(x0, 0.), at(x1, 0.), at(x1, 1.)], [at(x0, 0.), at(x1, 1.), at(x0, 1.)]];
    let surfaces = [[quad(-1., 0.), quad(0., 1.)].concat()];
    let (mut scene, atlas) = (mesh_scene(&surfaces), mesh_atlas(&surfaces, 16));
    if normals {
        scene.meshes[0].normals = vec![Vec3::Z; scene.meshes[0].positions.len()];
    }
    let mut lightmap = page(&scene, &atlas, |_| 0.0);
    for (t, value) in [1.0, 1.0, 3.0, 3.0].into_iter().enumerate() {
        let [a, b, c] = atlas.page_texels(0, 0, t);
        let page = &mut lightmap.pages[0];
        for y in a.y as u32..=c.y as u32 {
            for x in a.x as u32..=b.x as u32 {
                page.rgb[(y * page.width + x) as usize] = Rgb::splat(value);
            }
        }
    }
    made(&scene, &atlas, &lightmap, GIVEN).0.surfaces.try_into().unwrap()
}

#[test]
fn a_bend_is_smooth_and_an_edge_is_hard() {
    let values = |mesh: &LitMesh| mesh.triangles.iter().map(|t| t.values.map(|v| v.x)).collect::<Vec<_>>();
    let [bend] = hinge(20.0, false);
    let v = values(&bend);
    assert_eq!((v[0][1], v[0][2]), (v[2][0], v[3][2]), "both sides of a bend have one light");
    assert!(v[0][1] > 1.2 && v[0][1] < 2.8);
    let [edge] = hinge(90.0, false);
    let v = values(&edge);
    assert!(
        v[..2].iter().flatten().all(|v| (v - 1.0).abs() < 1e-3)
            && v[2..].iter().flatten().all(|v| (v - 3.0).abs() < 1e-3)
    );
    let [authored] = hinge(90.0, true);
    let v = values(&authored);
    assert_eq!((v[0][1], v[0][2]), (v[2][0], v[3][2]), "authored normals decide");
}

/// A shadow with a soft, round edge in falling light.
fn shadow(p: Vec3) -> f32 {
    let r = Vec2::new(p.x - 0.9, p.z - 1.1).length();
    (1.5 - 0.3 * p.x) * (0.2 + 0.8 * ((r - 0.4) / 0.15).clamp(0.0, 1.0))
}

#[test]
fn cut_meshes_hold_a_shadow_to_the_error_asked_for() {
    let (scene, atlas) = floor();
    let lightmap = page(&scene, &atlas, shadow);
    for error in [0.2, 0.1, 0.05] {
        let (vertices, report) = made(&scene, &atlas, &lightmap, MeshParams { error, ..ADAPTIVE });
        let mesh = &vertices.surfaces[0];
        assert_watertight(&scene, 0, mesh);
        assert!(report.within >= 95.0, "{report:?}");
        assert_eq!(report.triangles, mesh.triangles.len() as u64);
        // By points of our own, not by the texels that it was made from.
        let off = rms(&scene, mesh, shadow);
        assert!(off < 0.7 * error, "{off} at {error} with {} triangles", mesh.triangles.len());
    }
}

#[test]
fn triangles_go_where_they_are_needed_most() {
    let (scene, atlas) = floor();
    let lightmap = page(&scene, &atlas, shadow);
    let mut last = f64::INFINITY;
    for most in [32, 128, 512] {
        let params = MeshParams { error: 1e-3, max_triangles: Some(most), ..ADAPTIVE };
        let (vertices, report) = made(&scene, &atlas, &lightmap, params);
        assert!(report.triangles <= most && report.triangles > most * 3 / 4, "{report:?} of {most}");
        let off = rms(&scene, &vertices.surfaces[0], shadow);
        // A uniform mesh of as many triangles: n x n squares, each in two, with values at their corners.
        let n = (most as f64 / 2.0).sqrt().floor() as usize;
        let uniform = uniform(n);
        let (even, _) = made(&uniform.0, &uniform.1, &page(&uniform.0, &uniform.1, shadow), GIVEN);
        let even = rms(&uniform.0, &even.surfaces[0], shadow);
        assert!(off < last, "{off} at {most}");
        if most > 100 {
            assert!(off < 0.5 * even, "{off} against {even} of a uniform mesh at {most}");
        }
        last = off;
    }
}

#[test]
fn jumps_don_t_take_more_triangles_than_there_may_be() {
    // Slats under a sun: a jump for each of their edges.
    let mut quads = vec![Quad::new([0.; 3], [0., 0., 2.], [2., 0., 0.])];
    quads.extend((0..24).map(|k| {
        let x = 0.05 + 0.075 * k as f32;
        Quad::new([x, 0.5, 0.1], [0., 0., 1.8], [0.04, 0., 0.]).double_sided()
    }));
    let mut scene = scene(&quads);
    let sun = LightShape::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::splat(10.0), angle: 0.0 };
    scene.lights.push(Light::new("sun", sun));
    scene.surfaces[1..].iter_mut().for_each(|slat| slat.role.receives = false);
    let mut atlas = atlas(quads.len(), 128);
    atlas.density = 64.0;
    let is_dark = |p: Vec3| (0.1..1.9).contains(&p.z) && (0.0..0.04).contains(&((p.x - 0.05).rem_euclid(0.075)));
    let lightmap = page(&scene, &atlas, |p| if p.x < 1.85 && is_dark(p) { 0.2 } else { 3.0 });
    let mut off = f64::INFINITY;
    for most in [40, 150, 1000] {
        let params = MeshParams { mode: MeshMode::Discontinuity, max_triangles: Some(most), ..GIVEN };
        let (vertices, report) = made(&scene, &atlas, &lightmap, params);
        assert!(report.triangles <= most, "{report:?} of {most}");
        assert_watertight(&scene, 0, &vertices.surfaces[0]);
        assert!(report.p95 <= off, "{report:?} after {off}");
        off = report.p95;
    }
}

#[test]
fn light_does_not_seep_across_a_jump() {
    // A hard, round shadow without a gap, and texels that hold what of them is lit.
    let disc = |k: u32| {
        let (sin, cos) = (k as f32 / 40.0 * std::f32::consts::TAU + 0.03).sin_cos();
        Vec3::new(0.93 + 0.61 * sin, 0.5, 1.07 + 0.61 * cos)
    };
    let quads = [Quad::new([0.; 3], [0., 0., 2.], [2., 0., 0.]), Quad::new([0.; 3], [1., 0., 0.], [0., 0., 1.])];
    let mut scene = scene(&quads);
    let mesh = &mut scene.meshes[1];
    mesh.positions = (0..40).map(disc).collect();
    mesh.triangles = (1..39).map(|k| [0, k, k + 1]).collect();
    mesh.triangle_material = vec![0; 38];
    mesh.origin = vec![Default::default(); 38];
    mesh.uvs.clear();
    let sun = LightShape::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::splat(10.0), angle: 0.0 };
    scene.lights.push(Light::new("sun", sun));
    scene.surfaces[1].role.receives = false;
    let is_dark = |p: Vec3| {
        let side = |k: u32| {
            let [a, b] = [disc(k), disc(k + 1)];
            (b.z - a.z) * (p.x - a.x) - (b.x - a.x) * (p.z - a.z)
        };
        (0..40).all(|k| side(k) <= 0.0) || (0..40).all(|k| side(k) >= 0.0)
    };
    let mut atlas = atlas(2, 64);
    atlas.density = 32.0;
    let of_disc = &mut atlas.meshes[1];
    (of_disc.corners, of_disc.chart) = (vec![of_disc.corners[0]; 38], vec![0; 38]);
    let texel = 2.0 / 64.0;
    let share = |p: Vec3| {
        let at = |i: u32| ((i as f32 + 0.5) / 8.0 - 0.5) * texel;
        let dark = (0..64).filter(|k| is_dark(p + Vec3::new(at(k % 8), 0.0, at(k / 8)))).count();
        if p.y == 0.0 { 3.0 - 2.8 * dark as f32 / 64.0 } else { 0.0 }
    };
    let lightmap = page(&scene, &atlas, share);
    let params = MeshParams { mode: MeshMode::Discontinuity, ..GIVEN };
    let (vertices, _) = made(&scene, &atlas, &lightmap, params);
    let values = vertices.surfaces[0].triangles.iter().flat_map(|t| t.values).map(|v| v.x);
    let off = values.map(|v| (v - 0.2).abs().min((v - 3.0).abs())).fold(0.0, f32::max);
    assert!(off < 0.05, "a value is {off} off both sides");
}

/// The floor as n x n squares.
fn uniform(n: usize) -> (Scene, Atlas) {
    let (mut scene, mut atlas) = floor();
    let at = |i: usize, j: usize| Vec2::new(i as f32, j as f32) / n as f32;
    let [low, _, high] = atlas.meshes[0].corners[0];
    let mesh = &mut scene.meshes[0];
    (mesh.positions, mesh.triangles) = (Vec::new(), Vec::new());
    let mut corners = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            mesh.positions.push(Vec3::new(2.0 * at(i, j).x, 0.0, 2.0 * at(i, j).y));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let v = |i: usize, j: usize| (j * (n + 1) + i) as u32;
            // As the quad: u along z, v along x.
            let uv = |i: usize, j: usize| low + (high - low) * Vec2::new(at(i, j).y, at(i, j).x);
            let [a, b, c, d] = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)];
            for t in [[a, b, c], [a, c, d]] {
                mesh.triangles.push(t.map(|(i, j)| v(i, j)));
                corners.push(t.map(|(i, j)| uv(i, j)));
            }
        }
    }
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    mesh.origin = vec![Default::default(); mesh.triangles.len()];
    atlas.meshes[0].chart = vec![0; corners.len()];
    atlas.meshes[0].corners = corners;
    (scene, atlas)
}

#[test]
fn balls_and_rooms_stay_watertight() {
    let ball = [sphere(Vec3::ZERO, 1.0, 8, false)];
    let (ball, of_ball) = (mesh_scene(&ball), mesh_atlas(&ball, 24));
    let light = |p: Vec3| 1.0 + (4.0 * p.x).sin() * (3.0 * p.y).cos() * 0.8;
    let (vertices, report) = made(&ball, &of_ball, &page(&ball, &of_ball, light), ADAPTIVE);
    assert!(report.triangles > 2 * report.given_triangles, "{report:?}");
    assert_watertight(&ball, 0, &vertices.surfaces[0]);
    let quads = room([2., 2., 2.]);
    let (room, of_room) = (scene(&quads), atlas(6, 64));
    let (vertices, _) = made(&room, &of_room, &page(&room, &of_room, |p| 1.0 + (5.0 * (p.x + p.y)).sin()), ADAPTIVE);
    (0..6).for_each(|s| assert_watertight(&room, s, &vertices.surfaces[s]));
}

#[test]
fn jumps_part_the_values_of_a_point() {
    let (scene, _) = floor();
    let mut fine = FineMesh::new(&scene, 0);
    fine.breaks.insert(edge(0, 2));
    let groups = lumel::meshing::fit::Groups::new(&fine, &scene.meshes[0], false);
    assert_eq!(groups.count, 6, "{groups:?}");
    fine.breaks.clear();
    assert_eq!(lumel::meshing::fit::Groups::new(&fine, &scene.meshes[0], false).count, 4);
}

#[test]
fn threads_don_t_matter() {
    let quads = room([2., 2., 2.]);
    let (room, of_room) = (scene(&quads), atlas(6, 48));
    let lightmap = page(&room, &of_room, |p| 1.0 + (5.0 * (p.x + p.y)).sin());
    let params = MeshParams { max_triangles: Some(700), error: 0.01, ..ADAPTIVE };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| made(&room, &of_room, &lightmap, params).0)
    };
    let (one, three) = (with(1), with(3));
    assert!(one.surfaces.iter().zip(&three.surfaces).all(|(a, b)| a.triangles == b.triangles));
}
