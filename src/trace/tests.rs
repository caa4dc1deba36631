//! All paths beside each other and beside a look at every triangle.

use super::path::Path;
use super::traverse::Line;
use super::wide::Wide;
use super::{Hit, Ray, Segment, Tracer};
use crate::sample::sequence::{Sequence, Stage};
use crate::scene::{Mesh, Scene, Surface, SurfaceOrigin};
use glam::{Affine3A, Vec3};
use std::f32::consts::{PI, TAU};

fn tracer(triangles: &[[Vec3; 3]]) -> Tracer {
    let mut scene = Scene::default();
    scene.meshes.push(Mesh {
        positions: triangles.iter().flatten().copied().collect(),
        triangles: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..Mesh::default()
    });
    scene.surfaces.push(Surface {
        name: String::new(),
        mesh: 0,
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Default::default(),
    });
    Tracer::new(&scene)
}

fn random(set: u64) -> impl FnMut() -> [f32; 4] {
    let sequence = Sequence::new(0, Stage::Gather, set);
    let mut index = 0;
    move || {
        index += 1;
        sequence.point(index - 1, 0)
    }
}

/// A sphere of radius `size` of `2 n^2` triangles, seen from either side; the rows at the poles are degenerate by half.
fn sphere(n: usize, size: f32) -> Vec<[Vec3; 3]> {
    let at = |i: usize, j: usize| {
        let (theta, phi) = (PI * i as f32 / n as f32, TAU * (j % n) as f32 / n as f32);
        size * Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
    };
    let quads = (0..n * n).map(|k| (k / n, k % n));
    quads
        .flat_map(|(i, j)| [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]])
        .collect()
}

/// Triangles of all sizes in a cube of side 2 `size`, a tenth of them on coordinate planes, some degenerate, some twice.
fn soup(count: usize, size: f32) -> Vec<[Vec3; 3]> {
    let mut u = random(1);
    let mut triangles = Vec::new();
    for i in 0..count {
        let [x, y, z, s] = u();
        let middle = Vec3::new(x, y, z) * 2.0 - 1.0;
        let mut corners = [(); 3].map(|()| {
            let [x, y, z, _] = u();
            size * (middle + (Vec3::new(x, y, z) - 0.5) * s.powi(4)).clamp(Vec3::NEG_ONE, Vec3::ONE)
        });
        match i % 20 {
            0 | 1 => corners = corners.map(|p| p.with_y(corners[0].y)),
            2 => corners[2] = corners[1],
            3 => corners = corners.map(|p| (p * 4.0 / size).round() * size / 4.0),
            _ => {}
        }
        triangles.push(corners);
        if i % 10 == 0 {
            triangles.push(corners);
        }
    }
    triangles
}

/// Rays within the cube: in all directions, along axes, in coordinate planes, and at corners and edges of the triangles.
fn rays(triangles: &[[Vec3; 3]], count: usize, size: f32) -> Vec<Ray> {
    let mut u = random(2);
    (0..count)
        .map(|i| {
            let [x, y, z, w] = u();
            let [a, b, c, _] = u();
            let mut origin = size * (Vec3::new(x, y, z) * 2.4 - 1.2);
            let mut direction = Vec3::new(a, b, c) - 0.5;
            let target = triangles.get(i % triangles.len().max(1)).copied().unwrap_or_default();
            match i % 8 {
                0 => direction = Vec3::AXES[i / 8 % 3] * if w < 0.5 { -1.0 } else { 1.0 },
                1 => direction[i / 8 % 3] = 0.0,
                2 => direction = target[i / 8 % 3] - origin,
                3 => direction = target[0].lerp(target[1], w) - origin,
                4 => {
                    origin = (origin * 4.0 / size).round() * size / 4.0;
                    direction = Vec3::AXES[i / 8 % 3];
                }
                5 => origin = target[0].lerp(target[1], w),
                _ => {}
            }
            Ray { origin, direction: direction.normalize_or(Vec3::X) }
        })
        .collect()
}

/// The answers of one path, to the bit.
fn answers(tracer: &mut Tracer, path: Path, rays: &[Ray], reach: f32) -> Vec<(Option<Hit>, bool, bool)> {
    tracer.path = path;
    let segments: Vec<Segment> =
        rays.iter().map(|r| Segment { from: r.origin, to: r.origin + reach * r.direction }).collect();
    let (mut hits, mut within, mut any) = (vec![None; rays.len()], vec![false; rays.len()], vec![false; rays.len()]);
    tracer.closest(rays, &mut hits);
    tracer.occluded(&segments, &mut within);
    tracer.occluded_rays(rays, &mut any);
    hits.into_iter().zip(within).zip(any).map(|((h, w), a)| (h, w, a)).collect()
}

/// The same by looking at every triangle.
fn every(tracer: &Tracer, triangles: &[[Vec3; 3]], ray: &Ray, reach: f32) -> (Option<Hit>, bool, bool) {
    let crossings = |ray: &Ray| {
        let line = Line::new(ray.origin, ray.direction, 0.0);
        let crossing = move |(n, t): (u32, &[Vec3; 3])| {
            let c = line.shear.intersect(&t.map(|p| p.to_array()))?;
            let t = if c.front { c.t } else { c.t + tracer.offset() };
            Some((c.t, Hit { t, triangle: n, barycentric: c.barycentric, back: !c.front }))
        };
        (0..).zip(triangles).filter_map(crossing).collect::<Vec<_>>()
    };
    let all = crossings(ray);
    let nearest = all.iter().map(|(_, h)| *h).min_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
    let way = ray.origin + reach * ray.direction - ray.origin;
    let segment = Ray { origin: ray.origin, direction: way / way.length() };
    let within = crossings(&segment).iter().any(|(t, _)| *t < way.length());
    (nearest, within, !all.is_empty())
}

#[test]
fn every_path_finds_what_a_look_at_every_triangle_finds() {
    let scenes = [0, 1, 2, 9, 700].into_iter().flat_map(|n| [1e-6, 1.0, 1e6].map(|size| (soup(n, size), size)));
    for (triangles, size) in scenes.chain([(sphere(20, 3.0), 3.0)]) {
        let mut tracer = tracer(&triangles);
        let rays = rays(&triangles, 2000, size);
        let expected: Vec<_> = rays.iter().map(|r| every(&tracer, &triangles, r, 0.3 * size)).collect();
        let hit = expected.iter().filter(|e| e.0.is_some()).count();
        assert!(triangles.len() < 100 || hit > 500, "{hit} of 2000 rays hit {} triangles", triangles.len());
        for path in Path::available() {
            for (i, (found, expected)) in
                answers(&mut tracer, path, &rays, 0.3 * size).iter().zip(&expected).enumerate()
            {
                let case = || format!("{path:?}, {} triangles of {size}, ray {i}: {:?}", triangles.len(), rays[i]);
                assert_eq!(found, expected, "{}", case());
            }
        }
    }
}

#[test]
fn crossings_are_all_there_are() {
    let triangles = soup(700, 1.0);
    let tracer = tracer(&triangles);
    for ray in rays(&triangles, 500, 1.0) {
        let mut found = Vec::new();
        tracer.crossings(&ray, |triangle, back| found.push((triangle, back)));
        found.sort_unstable();
        let line = Line::new(ray.origin, ray.direction, 0.0);
        let crossing = |(n, t): (u32, &[Vec3; 3])| Some((n, !line.shear.intersect(&t.map(|p| p.to_array()))?.front));
        let expected: Vec<(u32, bool)> = (0..).zip(&triangles).filter_map(crossing).collect();
        assert_eq!(found, expected, "{ray:?}");
    }
}

#[test]
fn nothing_leaves_a_closed_sphere() {
    let triangles = sphere(300, 1.0);
    let mut tracer = tracer(&triangles);
    let mut u = random(3);
    let rays: Vec<Ray> = (0..20_000)
        .map(|i| {
            let [x, y, z, w] = u();
            let origin = (Vec3::new(x, y, z) - 0.5) * 0.9;
            // Every other one straight at an edge or corner.
            let [a, b, _] = triangles[(w * triangles.len() as f32) as usize];
            let target = if i % 2 == 0 { a.lerp(b, (i % 5) as f32 / 4.0) } else { Vec3::new(y, z, w) - 0.5 };
            Ray { origin, direction: (target - origin).normalize() }
        })
        .collect();
    for path in Path::available() {
        let answers = answers(&mut tracer, path, &rays, 4.0);
        assert!(answers.iter().all(|(hit, within, any)| hit.is_some() && *within && *any), "{path:?}");
    }
}

#[test]
fn neither_order_nor_batch_shows() {
    let triangles = soup(700, 1.0);
    let mut tracer = tracer(&triangles);
    let rays = rays(&triangles, 1000, 1.0);
    let reversed: Vec<Ray> = rays.iter().rev().copied().collect();
    for path in Path::available() {
        let whole = answers(&mut tracer, path, &rays, 0.3);
        let mut turned = answers(&mut tracer, path, &reversed, 0.3);
        turned.reverse();
        let mut parts = Vec::new();
        for part in rays.chunks(7) {
            parts.extend(answers(&mut tracer, path, part, 0.3));
        }
        assert!(whole == turned && whole == parts, "{path:?}");
    }
}

#[test]
fn walls_at_either_end_of_a_scene_share_no_box() {
    let wall = |x: f32| {
        let at = move |i: usize, j: usize| Vec3::new(x, i as f32, j as f32);
        let quads = (0..64 * 64).map(|k| (k / 64, k % 64));
        quads.flat_map(move |(i, j)| {
            [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]]
        })
    };
    let triangles: Vec<_> = wall(0.0).chain(wall(64.0)).map(|t| t.map(|p| p.to_array())).collect();
    let wide = Wide::new(&triangles);
    for node in &wide.nodes {
        let [low, high] = &node.bounds[0];
        assert!(low.iter().zip(high).all(|(l, h)| h - l < 1.0), "{low:?} {high:?}");
    }
}

#[test]
fn triangles_without_finite_corners_keep_the_others_numbers() {
    let at = |x: f32| [Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 0.0, 0.0), Vec3::new(x, 0.0, 1.0)];
    let mut all: Vec<[Vec3; 3]> = (0..40).map(|k| at(k as f32)).collect();
    for k in (0..40).step_by(3) {
        all[k] = [Vec3::NAN; 3];
    }
    let tracer = tracer(&all);
    for k in 0..40 {
        let ray = Ray { origin: Vec3::new(k as f32 + 0.3, 1.0, 0.3), direction: Vec3::NEG_Y };
        let mut hits = [None];
        tracer.closest(&[ray], &mut hits);
        let found = hits[0].map(|h: Hit| h.triangle as usize);
        assert_eq!(found, (k % 3 != 0).then_some(k));
    }
}
