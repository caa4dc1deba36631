//! Critical curves against what is known on paper, and meshes that are cut along them.

mod support;

use glam::{Affine3A, DVec3, Mat3A, Vec3};
use lumel::color::Rgb;
use lumel::light::Lights;
use lumel::meshing::constrain::{ConstrainParams, constrain};
use lumel::meshing::critical::{CriticalLine, CriticalParams, Order, critical_lines};
use lumel::meshing::fine::{FineMesh, edge};
use lumel::scene::{Light, LightShape, Scene};
use lumel::trace::Tracer;
use std::collections::BTreeMap;
use support::{Quad, scene};

/// A floor of 6 m by 6 m around the origin.
fn floor() -> Quad {
    Quad::new([-3., 0., -3.], [0., 0., 6.], [6., 0., 0.])
}

/// A square around the y axis, `half` [m] to each side, that faces up or down.
fn square(half: f32, y: f32, up: bool) -> Quad {
    let (u, v) = ([0., 0., 2. * half], [2. * half, 0., 0.]);
    if up { Quad::new([-half, y, -half], u, v) } else { Quad::new([-half, y, -half], v, u) }
}

/// The outer faces of a box.
fn block(low: [f32; 3], high: [f32; 3]) -> Vec<Quad> {
    let [a, b] = [Vec3::from(low), Vec3::from(high)];
    let (x, y, z) = (Vec3::X * (b - a), Vec3::Y * (b - a), Vec3::Z * (b - a));
    let quad = |corner: Vec3, u: Vec3, v: Vec3| Quad::new(corner.into(), u.into(), v.into());
    vec![quad(a, x, z), quad(a + y, z, x), quad(a, z, y), quad(a + x, y, z), quad(a, y, x), quad(a + z, x, y)]
}

fn params() -> CriticalParams {
    CriticalParams { length: 0.02, width: 0.01, contact: 1e-3, contrast: 0.01, curves: true, lines: 10_000 }
}

fn lines_of(scene: &Scene, params: &CriticalParams) -> Vec<CriticalLine> {
    critical_lines(scene, &Tracer::new(scene), &Lights::new(scene), params)
}

fn light(scene: &mut Scene, shape: LightShape) {
    scene.lights.push(Light::new("light", shape));
}

/// The stretches of lines at `x` (axis 0) or `z` (axis 2) on the floor, one where they touch.
fn covered(lines: &[CriticalLine], axis: usize, at: f64) -> Vec<[f64; 2]> {
    let across = 2 - axis;
    let is_there = |line: &&CriticalLine| line.ends.iter().all(|p| (p[axis] - at).abs() < 1e-4);
    let stretch = |line: &CriticalLine| line.ends.map(|p| p[across]);
    let mut stretches: Vec<[f64; 2]> = lines.iter().filter(is_there).map(stretch).collect();
    stretches.iter_mut().for_each(|s| s.sort_by(f64::total_cmp));
    stretches.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for s in stretches {
        match joined.last_mut() {
            Some(last) if s[0] <= last[1] + 1e-3 => last[1] = last[1].max(s[1]),
            _ => joined.push(s),
        }
    }
    joined
}

/// Lines that are cover `from` to `to` and nothing else, to `tolerance`.
fn assert_covers(lines: &[CriticalLine], axis: usize, at: f64, [from, to]: [f64; 2], tolerance: f64) {
    let found = covered(lines, axis, at);
    assert!(found.len() == 1, "axis {axis} at {at}: {found:?}\n{lines:#?}");
    let off = (found[0][0] - from).abs().max((found[0][1] - to).abs());
    assert!(off < tolerance, "axis {axis} at {at}: {found:?}, not {from}..{to}");
}

fn on_floor(lines: &[CriticalLine], order: Order) -> Vec<CriticalLine> {
    lines.iter().filter(|l| l.surface == 0 && l.order == order).copied().collect()
}

/// A lamp of 0.6 m at 3 m, a table of 1 m at 1 m.
fn table() -> Vec<Quad> {
    vec![floor(), square(0.5, 1.0, true).double_sided(), square(0.3, 3.0, false).emission(100.0)]
}

#[test]
fn a_table_under_a_lamp_has_an_umbra_and_a_penumbra() {
    let lines = lines_of(&scene(&table()), &params());
    let bends = on_floor(&lines, Order::Bend);
    // Planes past the table's edges from the lamp's far and near edges; both go on as far as the penumbra does.
    let (outer, inner) = (0.5 + 0.8 * 0.5, 0.5 + 0.2 * 0.5);
    for axis in [0, 2] {
        for at in [outer, inner, -outer, -inner] {
            assert_covers(&bends, axis, at, [-outer, outer], 2e-3);
        }
    }
    let on_lines = |l: &CriticalLine| {
        [0, 2]
            .iter()
            .any(|axis| l.ends.iter().all(|p| [outer, inner].iter().any(|at| (p[*axis].abs() - at).abs() < 1e-4)))
    };
    assert!(bends.iter().all(on_lines), "{bends:#?}");
    assert!(on_floor(&lines, Order::Jump).is_empty());
    // The lamp's light without a table: pi L times a form factor of 0.0125, about.
    assert!(bends.iter().all(|l| l.contrast > 2.0 && l.contrast < 4.5), "{bends:#?}");
    assert!(bends.iter().all(|l| (l.width - 0.3).abs() < 0.02), "{bends:#?}");
}

#[test]
fn lights_of_rectangles_are_as_surfaces_that_shine() {
    let mut lit = scene(&table()[..2]);
    let (u, v) = (Vec3::X * 0.3, Vec3::Z * 0.3);
    // Along -(u x v), which is down.
    light(&mut lit, LightShape::Rect { center: Vec3::Y * 3.0, u: v, v: u, radiance: Rgb::splat(100.0) });
    let bends = on_floor(&lines_of(&lit, &params()), Order::Bend);
    [0.6, 0.9].iter().for_each(|at| assert_covers(&bends, 0, *at, [-0.9, 0.9], 2e-3));
}

#[test]
fn a_turned_lamp_has_lines_inside_its_penumbra() {
    let mut turned = table();
    let h = 0.3;
    turned[2] = Quad::new([-h, 3., 0.], [h, 0., -h], [h, 0., h]).emission(100.0);
    // It faces down where u x v does.
    assert!(turned[2].u.cross(turned[2].v).y < 0.0);
    let lines = lines_of(&scene(&turned), &params());
    let curves = on_floor(&lines, Order::Curve);
    // The two corners in the middle: planes through them and an edge of the table.
    assert_covers(&curves, 0, 0.5 + 0.5 * 0.5, covered(&curves, 0, 0.75)[0], 1e-3);
    let bends = on_floor(&lines, Order::Bend);
    assert!(!covered(&bends, 0, 0.5 + 0.8 * 0.5).is_empty() && !covered(&bends, 0, 0.5 + 0.2 * 0.5).is_empty());
}

/// A disc of `n` corners around the y axis with a rim that is `thick` [m], its top at 1 m.
fn plate(scene: &mut Scene, radius: f32, thick: f32, n: u32) {
    let rim = |k: u32| {
        let (sin, cos) = ((k % n) as f32 / n as f32 * std::f32::consts::TAU + 0.01).sin_cos();
        Vec3::new(radius * sin, if k < n { 1.0 } else { 1.0 - thick }, radius * cos)
    };
    let mesh = &mut scene.meshes[1];
    mesh.positions = (0..2 * n).map(rim).collect();
    let top = (1..n - 1).map(|k| [0, k, k + 1]);
    let bottom = (1..n - 1).map(|k| [n, n + k + 1, n + k]);
    let side = (0..n).flat_map(|k| {
        let next = (k + 1) % n;
        [[k, n + k, n + next], [k, n + next, next]]
    });
    mesh.triangles = top.chain(bottom).chain(side).collect();
    mesh.normals.clear();
    mesh.uvs.clear();
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    mesh.origin = vec![Default::default(); mesh.triangles.len()];
}

#[test]
fn the_border_of_a_hard_shadow_has_no_gap() {
    // The shadow's outline passes from the upper rim to the lower one along two edges whose shadows are 14 mm long, less than
    // what is looked for.
    let mut round = scene(&table()[..2]);
    plate(&mut round, 0.5, 0.014, 48);
    let direction = Vec3::new(0.6, -0.6, 0.2).normalize();
    light(&mut round, LightShape::Directional { direction, illuminance: Rgb::splat(100.0), angle: 0.0 });
    let jumps = on_floor(&lines_of(&round, &params()), Order::Jump);
    assert!(jumps.len() >= 48, "{}", jumps.len());
    let ends: Vec<(usize, DVec3)> = jumps.iter().enumerate().flat_map(|(k, l)| l.ends.map(|p| (k, p))).collect();
    for (own, p) in &ends {
        let next = ends.iter().filter(|(k, _)| k != own).map(|(_, q)| q.distance(*p)).fold(f64::MAX, f64::min);
        // What is nearer is one point where meshes are cut.
        assert!(next < 0.2 * params().length, "{p} is {next} m from the next end");
    }
}

#[test]
fn a_round_table_does_not_fill_its_penumbra() {
    let mut round = scene(&table());
    let n = 48u32;
    let rim = |k: u32| {
        let (sin, cos) = (k as f32 / n as f32 * std::f32::consts::TAU + 0.01).sin_cos();
        Vec3::new(0.5 * sin, 1.0, 0.5 * cos)
    };
    let mesh = &mut round.meshes[1];
    mesh.positions = (0..n).map(rim).collect();
    mesh.triangles = (1..n - 1).map(|k| [0, k, k + 1]).collect();
    mesh.triangle_material = vec![1; n as usize - 2];
    mesh.origin = vec![Default::default(); n as usize - 2];
    let lines = lines_of(&round, &params());
    let curves = on_floor(&lines, Order::Curve);
    // Planes through corners of the lamp follow the rim; planes through its sides would run along x and z.
    let is_along_side = |l: &CriticalLine| (l.ends[1] - l.ends[0]).normalize().abs().max_element() > 1.0 - 1e-6;
    assert!(curves.len() > 40 && !curves.iter().any(is_along_side), "{curves:#?}");
    // The penumbra's border has straight parts as long as the lamp is wide, seen past the rim.
    let straight: Vec<CriticalLine> =
        on_floor(&lines, Order::Bend).into_iter().filter(|l| is_along_side(l) && l.length() > 0.2).collect();
    assert!(straight.len() >= 4, "{straight:#?}");
}

#[test]
fn a_point_light_draws_the_outline_of_a_box() {
    let mut lit = scene(&[vec![floor()], block([-0.5, 0.5, -0.5], [0.5, 1.0, 0.5])].concat());
    light(&mut lit, LightShape::Point { position: Vec3::Y * 3.0, intensity: Rgb::splat(100.0), range: None });
    let lines = lines_of(&lit, &params());
    let jumps = on_floor(&lines, Order::Jump);
    for axis in [0, 2] {
        [-0.75, 0.75].iter().for_each(|at| assert_covers(&jumps, axis, *at, [-0.75, 0.75], 2e-3));
    }
    let inside = |p: &DVec3| (p.x.abs().max(p.z.abs()) - 0.75).abs() < 1e-4;
    assert!(jumps.iter().all(|l| l.ends.iter().all(inside)), "{jumps:#?}");
    assert_eq!(lines.len(), jumps.len());
}

#[test]
fn a_sun_has_a_penumbra_as_wide_as_its_disc() {
    let mut lit = scene(&table()[..2]);
    let angle = 0.2f32;
    light(&mut lit, LightShape::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::splat(10.0), angle });
    let bends = on_floor(&lines_of(&lit, &params()), Order::Bend);
    let half = (0.5 * f64::from(angle)).tan();
    for axis in [0, 2] {
        for at in [0.5 + half, 0.5 - half, -0.5 + half, -0.5 - half] {
            assert_covers(&bends, axis, at, [-0.5, 0.5], 2e-3);
        }
    }
    // One without a disc, and one whose disc hardly shows, have an outline.
    for angle in [0.0, 0.005] {
        lit.lights[0].shape = LightShape::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::splat(10.0), angle };
        let lines = lines_of(&lit, &params());
        assert_covers(&on_floor(&lines, Order::Jump), 0, 0.5, [-0.5, 0.5], 2e-3);
        assert!(on_floor(&lines, Order::Bend).is_empty());
    }
}

#[test]
fn a_ball_has_planes_that_touch_it() {
    let mut lit = scene(&table()[..2]);
    let ball = Affine3A::from_translation(Vec3::Y * 3.0) * Affine3A::from_scale(Vec3::splat(0.2));
    light(&mut lit, LightShape::Sphere { world_from_unit: ball, radiance: Rgb::splat(100.0) });
    let bends = on_floor(&lines_of(&lit, &params()), Order::Bend);
    // Across the edge at (0.5, 1): the centre is at (-0.5, 2) from it; tangents turn by asin(r / distance).
    let turn = (0.2 / 4.25f64.sqrt()).asin();
    for turn in [turn, -turn] {
        let slope = ((-0.5f64).atan2(2.0) + turn).tan();
        let x = 0.5 - slope;
        assert!(!covered(&bends, 0, x).is_empty(), "{x}: {bends:#?}");
    }
}

#[test]
fn a_lamp_sets_on_walls_at_its_own_height() {
    // A wall at x = -1, and a post before it that hides the lamp from a part of the line.
    let wall = Quad::new([-1., 0., -1.], [0., 4., 0.], [0., 0., 2.]);
    let post = Quad::new([-0.6, 0., 0.1], [0., 4., 0.], [0., 0., 0.2]).double_sided();
    let lamp = square(0.1, 3.0, false).emission(100.0);
    let on_wall = |quads: &[Quad]| {
        let lines = lines_of(&scene(quads), &params());
        let level = |l: &CriticalLine| l.surface == 0 && l.ends.iter().all(|p| (p.y - 3.0).abs() < 1e-6);
        let mut level: Vec<[f64; 2]> = lines.into_iter().filter(level).map(|l| l.ends.map(|p| p.z)).collect();
        level.iter_mut().for_each(|l| l.sort_by(f64::total_cmp));
        level.sort_by(|a, b| a[0].total_cmp(&b[0]));
        level
    };
    let whole = on_wall(&[wall, lamp]);
    assert!((whole.iter().map(|l| l[1] - l[0]).sum::<f64>() - 2.0).abs() < 1e-6, "{whole:?}");
    // From the middle of the lamp the post hides 0.1 / 0.6 to 0.3 / 0.6.
    let parted = on_wall(&[wall, lamp, post]);
    let open: f64 = parted.iter().map(|l| l[1] - l[0]).sum();
    assert!((open - (2.0 - 0.2 / 0.6)).abs() < 0.1, "{parted:?}");
    assert!(parted.iter().all(|l| l[1] < 0.22 || l[0] > 0.45), "{parted:?}");
}

#[test]
fn a_box_touches_the_floor_in_a_square() {
    let standing = scene(&[vec![floor()], block([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5])].concat());
    let jumps = on_floor(&lines_of(&standing, &params()), Order::Jump);
    for axis in [0, 2] {
        [-0.5, 0.5].iter().for_each(|at| assert_covers(&jumps, axis, *at, [-0.5, 0.5], 1e-6));
    }
    assert!(jumps.iter().all(|l| l.ends.iter().all(|p| (p.x.abs().max(p.z.abs()) - 0.5).abs() < 1e-6)));
    // Hardly above it as well; clearly above it not.
    for (gap, touches) in [(5e-4, true), (5e-3, false)] {
        let above = scene(&[vec![floor()], block([-0.5, gap, -0.5], [0.5, 1.0, 0.5])].concat());
        assert_eq!(!on_floor(&lines_of(&above, &params()), Order::Jump).is_empty(), touches, "{gap}");
    }
}

#[test]
fn a_wall_cuts_a_floor() {
    let wall = Quad::new([0.3, -1., -1.], [0., 2., 0.], [0., 0., 2.]);
    let lines = lines_of(&scene(&[floor(), wall]), &params());
    assert_covers(&on_floor(&lines, Order::Jump), 0, 0.3, [-1.0, 1.0], 1e-6);
    // Of the wall, the floor is its own line; below it nothing differs.
    let of_wall: Vec<&CriticalLine> = lines.iter().filter(|l| l.surface == 1).collect();
    assert!(of_wall.iter().all(|l| l.ends.iter().all(|p| p.y.abs() < 1e-6)), "{of_wall:#?}");
    assert!((of_wall.iter().map(|l| l.length()).sum::<f64>() - 2.0).abs() < 1e-6);
    // Where floors meet walls at their ends, there is nothing to cut.
    assert!(lines_of(&scene(&support::room([3.0, 2.0, 4.0])), &params()).is_empty());
}

#[test]
fn a_shelf_hides_a_part_of_a_line() {
    // Below the table a shelf that catches the shadow of its edge at x = 0.5 for z > 0.2.
    let shelf = Quad::new([-1.0, 0.5, 0.2], [0., 0., 1.3], [2.0, 0., 0.]).double_sided();
    let mut lit = scene(&[floor(), square(0.5, 1.0, true).double_sided(), shelf]);
    let direction = Vec3::NEG_Y;
    light(&mut lit, LightShape::Directional { direction, illuminance: Rgb::splat(10.0), angle: 0.0 });
    let lines = lines_of(&lit, &params());
    assert_covers(&on_floor(&lines, Order::Jump), 0, 0.5, [-0.5, 0.2], 2e-3);
    let on_shelf: Vec<CriticalLine> = lines.iter().filter(|l| l.surface == 2).copied().collect();
    assert_covers(&on_shelf, 0, 0.5, [0.2, 0.5], 2e-3);
}

#[test]
fn lines_are_the_same_at_any_number_of_threads() {
    let lit = scene(&[table(), block([1.0, 0.0, 0.2], [1.4, 0.7, 0.9])].concat());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let lines = lines_of(&lit, &params());
            let mut mesh = FineMesh::new(&lit, 0);
            constrain(&mut mesh, CriticalLine::of_surface(&lines, 0), &ConstrainParams { tolerance: 0.01 });
            (lines, mesh.points, mesh.pieces, mesh.breaks)
        })
    };
    assert!(with(1) == with(3));
}

/// Random numbers in 0..1, always the same.
fn random() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A sheet of `n` by `n` squares of one mesh over 0..size in x and z, that bends upwards; vertices are shared.
fn hill(n: u32, size: f32, mirrored: bool) -> Scene {
    let mut hill = scene(&[floor()]);
    let mesh = &mut hill.meshes[0];
    let at = |i: u32, k: u32| {
        let (x, z) = (i as f32 / n as f32, k as f32 / n as f32);
        Vec3::new(x, 0.2 * (3.0 * x).sin() * (2.0 * z).cos(), z) * size
    };
    mesh.positions = (0..=n).flat_map(|k| (0..=n).map(move |i| at(i, k))).collect();
    let v = |i: u32, k: u32| k * (n + 1) + i;
    let cells = (0..n * n).map(|c| (c % n, c / n));
    let square = |(i, k)| [[v(i, k), v(i, k + 1), v(i + 1, k)], [v(i + 1, k), v(i, k + 1), v(i + 1, k + 1)]];
    mesh.triangles = cells.flat_map(square).collect();
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    mesh.origin = vec![Default::default(); mesh.triangles.len()];
    if mirrored {
        hill.surfaces[0].world_from_local.matrix3 = Mat3A::from_diagonal(Vec3::new(-1.0, 1.0, 1.0));
    }
    hill
}

/// Lines between random places of random triangles, and some that are no good.
fn scribbles(mesh: &FineMesh, count: usize) -> Vec<CriticalLine> {
    let mut u = random();
    let mut lines = Vec::new();
    for i in 0..count {
        let piece = mesh.pieces[(u() * mesh.pieces.len() as f64) as usize];
        let [a, b, c] = piece.points.map(|p| mesh.points[p as usize]);
        let mut place = || a + (b - a) * (1.4 * u() - 0.2) + (c - a) * (1.4 * u() - 0.2);
        let ends = match i % 10 {
            0 => [a, b],
            1 => [a.lerp(b, 0.3), b.lerp(c, 0.7)],
            2 => [a, b.lerp(c, 0.5)],
            3 => [place(), a],
            4 if i % 50 == 4 => [a, DVec3::NAN],
            5 if i % 50 == 5 => [a, a],
            6 => [a.lerp(c, 0.2), a.lerp(c, 0.9)],
            _ => [place(), place()],
        };
        let order = if i % 3 == 0 { Order::Jump } else { Order::Bend };
        lines.push(CriticalLine { surface: 0, triangle: piece.source, ends, order, contrast: 1.0, width: 0.1 });
    }
    lines
}

/// Checks that pieces fill the triangles of `whole` exactly and meet without gaps.
fn assert_watertight(whole: &FineMesh, mesh: &FineMesh, mirrored: bool) {
    let mut areas: BTreeMap<u32, f64> = BTreeMap::new();
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a);
    let corners = |points: [u32; 3], mesh: &FineMesh| points.map(|p| mesh.points[p as usize]);
    let mut edges: BTreeMap<[u32; 2], [i32; 2]> = BTreeMap::new();
    for piece in &mesh.pieces {
        let source = whole.pieces[piece.source as usize];
        let own = corners(source.points, whole);
        let normal = area(own).normalize();
        let part = area(corners(piece.points, mesh)).dot(normal);
        assert!(part > 0.0, "{piece:?} turned over");
        *areas.entry(piece.source).or_default() += part;
        for k in 0..3 {
            let (a, b) = (piece.points[k], piece.points[(k + 1) % 3]);
            edges.entry(edge(a, b)).or_default()[usize::from(a < b)] += 1;
            let w = piece.corners[k].0;
            assert!((w.element_sum() - 1.0).abs() < 1e-12 && w.min_element() >= 0.0, "{w}");
            let place = own[0] * w.x + own[1] * w.y + own[2] * w.z;
            assert!(place.distance(mesh.points[piece.points[k] as usize]) < 1e-9);
        }
    }
    for (source, sum) in areas {
        let expected = area(corners(whole.pieces[source as usize].points, whole)).length();
        assert!((sum - expected).abs() < 1e-9 * expected.max(1e-3), "triangle {source}: {sum} of {expected}");
    }
    // The border of the sheet alone has one piece; all else two, one each way.
    let is_border = |e: &[u32; 2]| {
        let [a, b] = e.map(|p| mesh.points[p as usize] * DVec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0));
        [0, 2].iter().any(|x| [0.0, 2.0].iter().any(|at| (a[*x] - at).abs() < 1e-6 && (b[*x] - at).abs() < 1e-6))
    };
    for (e, count) in &edges {
        assert!(*count == [1, 1] || (is_border(e) && count.iter().sum::<i32>() == 1), "{e:?}: {count:?}");
    }
    assert!(mesh.breaks.iter().all(|e| edges.contains_key(e)));
}

#[test]
fn meshes_that_are_cut_stay_watertight() {
    for (n, count, mirrored) in [(1, 60, false), (8, 1500, false), (8, 400, true), (40, 3000, false)] {
        let hill = hill(n, 2.0, mirrored);
        let whole = FineMesh::new(&hill, 0);
        let mut mesh = whole.clone();
        constrain(&mut mesh, &scribbles(&whole, count), &ConstrainParams { tolerance: 0.01 });
        println!("{} pieces of {}, {} breaks", mesh.pieces.len(), whole.pieces.len(), mesh.breaks.len());
        assert!(mesh.pieces.len() > whole.pieces.len() + count / 2 && !mesh.breaks.is_empty());
        assert_watertight(&whole, &mesh, mirrored);
        let sources: Vec<u32> = mesh.pieces.iter().map(|p| p.source).collect();
        assert!(sources.is_sorted());
    }
}

#[test]
fn nothing_comes_nearer_than_the_tolerance() {
    let hill = hill(2, 2.0, false);
    let mut mesh = FineMesh::new(&hill, 0);
    let tolerance = 0.01;
    let lines = scribbles(&mesh, 200);
    constrain(&mut mesh, &lines, &ConstrainParams { tolerance });
    let mut heights: Vec<f64> = Vec::new();
    for piece in &mesh.pieces {
        let [a, b, c] = piece.points.map(|p| mesh.points[p as usize]);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let shortest = a.distance(b).min(b.distance(c)).min(c.distance(a));
        assert!(shortest > 0.99 * tolerance, "{shortest}");
        heights.push((b - a).cross(c - a).length() / longest);
    }
    heights.sort_by(f64::total_cmp);
    println!("heights: least {}, 1 % {}", heights[0], heights[heights.len() / 100]);
    assert!(heights[0] > 0.0 && heights[heights.len() / 50] > 0.2 * tolerance);
}

#[test]
fn a_line_becomes_edges_on_both_sides_of_a_diagonal() {
    // The floor is two triangles; a jump across both, drawn on each.
    let hall = scene(&[floor()]);
    let mut mesh = FineMesh::new(&hall, 0);
    let line = |triangle, ends: [[f64; 2]; 2]| CriticalLine {
        surface: 0,
        triangle,
        ends: ends.map(|[x, z]| DVec3::new(x, 0.0, z)),
        order: Order::Jump,
        contrast: 1.0,
        width: 0.0,
    };
    let lines = [line(0, [[-3.0, 1.0], [1.0, 1.0]]), line(1, [[1.0, 1.0], [3.0, 1.0]])];
    let lines: Vec<CriticalLine> = lines.into_iter().collect();
    constrain(&mut mesh, &lines, &ConstrainParams { tolerance: 0.01 });
    let along: f64 = mesh.breaks.iter().map(|[a, b]| mesh.points[*a as usize].distance(mesh.points[*b as usize])).sum();
    assert!((along - 6.0).abs() < 1e-9, "{along}: {:?}", mesh.breaks);
    assert_eq!(mesh.points.len(), 7);
    assert_eq!(mesh.pieces.len(), 6);
}

#[test]
fn lines_that_go_on_beyond_others_start_where_those_end() {
    let hall = scene(&[floor()]);
    let mut mesh = FineMesh::new(&hall, 0);
    let line = |to: f64, order| CriticalLine {
        surface: 0,
        triangle: 0,
        ends: [DVec3::new(-2.0, 0.0, 1.0), DVec3::new(to, 0.0, 1.0)],
        order,
        contrast: 1.0,
        width: 0.0,
    };
    // The longer shows more, but breaks come first.
    let lines = [line(0.5, Order::Bend), line(-1.0, Order::Jump)];
    constrain(&mut mesh, &lines, &ConstrainParams { tolerance: 0.01 });
    assert_eq!(mesh.points.len(), 7, "{:?}", &mesh.points[4..]);
    assert_eq!(mesh.breaks.len(), 1);
}
