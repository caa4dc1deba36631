//! Subdivision against closed forms. Agreement with OpenSubdiv is in `tools/checks/test_usd_geometry.py`.

use lumel::subdivide::{Boundary, Cage, INFINITE, Linear, Rules, Scheme, TriangleRule, Values, smooth_normals};

const RULES: Rules =
    Rules { scheme: Scheme::CatmullClark, boundary: Boundary::EdgeAndCorner, triangles: TriangleRule::CatmullClark };

const CUBE: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn cube_points() -> Values {
    let sign = |bit: usize| if bit == 0 { -1.0 } else { 1.0 };
    Values { width: 3, data: (0..8).flat_map(|i| [sign(i & 1), sign(i & 2), sign(i & 4)]).collect() }
}

fn cube(creases: &[([u32; 2], f32)]) -> Cage {
    Cage::new(RULES, &[4; 6], CUBE.concat(), 8, creases, &[], &[]).unwrap()
}

/// A flat grid of `n` by `n` unit quads, with its points (x, y).
fn grid(n: u32, boundary: Boundary) -> (Cage, Values) {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let faces = (0..n).flat_map(|y| (0..n).map(move |x| [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]));
    let corners: Vec<u32> = faces.flatten().collect();
    let points = (0..=n).flat_map(|y| (0..=n).flat_map(move |x| [x as f32, y as f32])).collect();
    let counts = vec![4; (n * n) as usize];
    let cage = Cage::new(Rules { boundary, ..RULES }, &counts, corners, ((n + 1) * (n + 1)) as usize, &[], &[], &[]);
    (cage.unwrap(), Values { width: 2, data: points })
}

fn refined(cage: &Cage, points: &Values, levels: usize) -> (Cage, Values) {
    let (mut cage, mut values) = (cage.clone(), [points.clone()]);
    for _ in 0..levels {
        cage = cage.refine(&mut values, &mut []).unwrap();
    }
    let [values] = values;
    (cage, values)
}

fn assert_row(values: &Values, row: usize, expected: &[f32]) {
    let found = values.row(row);
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(found.len() == expected.len() && off < 2e-6, "{found:?} is not {expected:?}");
}

#[test]
fn a_cube_has_the_limit_of_catmull_and_clark() {
    // By hand: a corner goes to 5/9 and has its limit at 1/2; the middle of a face has it at 68/81.
    let (cage, points) = refined(&cube(&[]), &cube_points(), 1);
    assert_eq!((cage.face_count(), cage.vertex_count()), (24, 26));
    assert_row(&points, 7, &[5.0 / 9.0; 3]);
    for levels in 1..=4 {
        let (cage, mut points) = refined(&cube(&[]), &cube_points(), levels);
        cage.push_to_limit(&mut points);
        assert_row(&points, 7, &[0.5; 3]);
        // Vertices of each level stay in front: 8 of the cube, 12 of its edges, then one a face.
        assert_row(&points, 8 + 12 + 5, &[0.0, 0.0, 68.0 / 81.0]);
    }
}

#[test]
fn loops_octahedron_has_its_limit() {
    let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let points = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
    let points = Values { width: 3, data: points.concat().into_iter().map(|v| v as f32).collect() };
    let rules = Rules { scheme: Scheme::Loop, ..RULES };
    let cage = Cage::new(rules, &[3; 8], faces.concat(), 6, &[], &[], &[]).unwrap();
    for levels in 1..=3 {
        let (cage, mut values) = refined(&cage, &points, levels);
        cage.push_to_limit(&mut values);
        // Valence 4: beta = (5/8 - 9/64) / 4, omega = 1 / (3 / (8 beta) + 4), and the neighbours cancel.
        assert_row(&values, 0, &[24.0 / 55.0, 0.0, 0.0]);
        let normals = smooth_normals(&cage, &values);
        let normal = normals.values[normals.index[0] as usize];
        assert!(normal.dot(glam::Vec3::X) > 0.9999, "{normal}");
    }
    assert!(Cage::new(rules, &[4; 6], CUBE.concat(), 8, &[], &[], &[]).is_none(), "Loop takes triangles alone");
}

#[test]
fn sharp_edges_stay_and_half_sharp_ones_blend() {
    let all: Vec<([u32; 2], f32)> =
        CUBE.iter().flat_map(|f| (0..4).map(|k| ([f[k], f[(k + 1) % 4]], INFINITE))).collect();
    let (cage, mut points) = refined(&cube(&all), &cube_points(), 3);
    cage.push_to_limit(&mut points);
    let on_cube = points.data.chunks(3).all(|p| p.iter().fold(0.0f32, |m, v| m.max(v.abs())) == 1.0);
    assert!(on_cube, "a cube of sharp edges is a cube");
    let normals = smooth_normals(&cage, &points);
    assert!(normals.values.iter().all(|n| n.abs().max_element() > 0.999), "and has its six normals");
    // The middle of an edge: 3/4 smooth, 1 sharp.
    let middle = |sharpness: f32| {
        let (cage, points) = refined(&cube(&[([1, 3], sharpness)]), &cube_points(), 1);
        let row = (8..20).find(|&i| points.row(i)[1] == 0.0 && points.row(i)[0] > 0.5 && points.row(i)[2] < -0.5);
        assert_eq!(cage.vertex_count(), 26);
        points.row(row.unwrap()).to_vec()
    };
    assert_eq!(middle(0.0), [0.75, 0.0, -0.75]);
    assert_eq!(middle(0.5), [0.875, 0.0, -0.875]);
    assert_eq!(middle(1.0), [1.0, 0.0, -1.0]);
    assert_eq!(middle(3.0), [1.0, 0.0, -1.0]);
}

#[test]
fn boundaries_follow_their_rule() {
    let corner = |boundary| {
        let (cage, points) = grid(3, boundary);
        let (cage, mut points) = refined(&cage, &points, 2);
        cage.push_to_limit(&mut points);
        let shown = (0..cage.face_count()).filter(|&f| !cage.is_hidden(f)).count();
        (points, shown)
    };
    let (kept, shown) = corner(Boundary::EdgeAndCorner);
    assert_row(&kept, 0, &[0.0, 0.0]);
    assert_eq!(shown, 9 * 16);
    let (rounded, shown) = corner(Boundary::EdgeOnly);
    // A cubic B-spline: (4 v + e1 + e2) / 6.
    assert_row(&rounded, 0, &[1.0 / 6.0, 1.0 / 6.0]);
    assert_eq!(shown, 9 * 16);
    let (points, shown) = corner(Boundary::None);
    assert_eq!(shown, 16, "the middle face alone touches no boundary");
    // Regular vertices keep what is linear.
    assert_row(&points, 5, &[1.0, 1.0]);
    let (cage, _) = grid(3, Boundary::EdgeAndCorner);
    let counts = vec![4; 9];
    let holed = Cage::new(RULES, &counts, cage.corners().to_vec(), 16, &[], &[], &[4]).unwrap();
    assert!((0..9).all(|f| holed.is_hidden(f) == (f == 4)));
}

#[test]
fn smooth_triangles_take_their_own_weights() {
    // Two triangles over a square; the edge between them: 0.5 (w0 + w1) = 0.47 on each face point, 0.03 on each end.
    let rules = Rules { triangles: TriangleRule::Smooth, ..RULES };
    let cage = Cage::new(rules, &[3, 3], vec![0, 1, 2, 0, 2, 3], 4, &[], &[], &[]).unwrap();
    let points = Values { width: 1, data: vec![0.0, 3.0, 0.0, 3.0] };
    let (_, values) = refined(&cage, &points, 1);
    // Edges in the order of their ends: 01, 02, 03, 12, 23. Face points are 1.
    assert_row(&values, 5, &[0.94]);
}

#[test]
fn bilinear_refinement_moves_nothing() {
    let rules = Rules { scheme: Scheme::Bilinear, ..RULES };
    let cage = Cage::new(rules, &[4; 6], CUBE.concat(), 8, &[], &[], &[]).unwrap();
    let (cage, mut points) = refined(&cage, &cube_points(), 2);
    cage.push_to_limit(&mut points);
    assert_row(&points, 7, &[1.0; 3]);
    assert!(cage.is_flat() && points.data.chunks(3).all(|p| p.iter().any(|v| v.abs() == 1.0)));
}

#[test]
fn face_varying_values_follow_their_mode() {
    // Each face of the cube has the whole unit square: nothing but seams, and every value a corner of one face.
    let values: Vec<u32> = (0..24).collect();
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let at = |linear: Linear| {
        let (mut channel, corner_of_value) = cube(&[]).channel(&values, linear).unwrap();
        let uv = corner_of_value.iter().flat_map(|&c| square[c as usize % 4]).collect();
        let mut rows = [Values { width: 2, data: uv }];
        for _ in 0..2 {
            channel = match linear {
                Linear::All => channel.refine(&mut [], &mut rows),
                _ => channel.refine(&mut rows, &mut []),
            }
            .unwrap();
        }
        let [mut rows] = rows;
        if linear != Linear::All {
            channel.push_to_limit(&mut rows);
        }
        rows
    };
    for kept in [Linear::CornersOnly, Linear::CornersPlus1, Linear::CornersPlus2, Linear::Boundaries, Linear::All] {
        let rows = at(kept);
        (0..24).for_each(|v| assert_row(&rows, v, &square[v % 4]));
        assert!(rows.data.iter().all(|v| (0.0..=1.0).contains(v)));
    }
    // A closed curve of four points: (4 v + e1 + e2) / 6 of the corners.
    assert_row(&at(Linear::None), 0, &[1.0 / 6.0, 1.0 / 6.0]);
    // One island over the whole cube follows the mesh: values that are the points go where the points go.
    let (mut channel, corner_of_value) = cube(&[]).channel(&CUBE.concat(), Linear::CornersPlus1).unwrap();
    let points = cube_points();
    let rows = corner_of_value.iter().flat_map(|&c| points.row(CUBE.concat()[c as usize] as usize).to_vec()).collect();
    let mut rows = [Values { width: 3, data: rows }];
    channel = channel.refine(&mut rows, &mut []).unwrap();
    let (cage, points) = refined(&cube(&[]), &points, 1);
    for (a, b) in channel.corners().iter().zip(cage.corners()) {
        assert_row(&rows[0], *a as usize, points.row(*b as usize));
    }
}

#[test]
fn broken_topology_is_refused_and_tangled_ones_end() {
    let new = |counts: &[u32], corners: Vec<u32>| Cage::new(RULES, counts, corners, 4, &[], &[], &[]);
    assert!(new(&[2], vec![0, 1]).is_none());
    assert!(new(&[3], vec![0, 1, 4]).is_none());
    assert!(new(&[3], vec![0, 1, 2, 3]).is_none());
    // Three faces at one edge, a face of one vertex, a bow tie.
    for corners in [vec![0, 1, 2, 0, 1, 3, 1, 0, 2], vec![0, 0, 0], vec![0, 1, 2, 0, 3, 2]] {
        let counts = vec![3; corners.len() / 3];
        let points = Values { width: 1, data: vec![0.0, 1.0, 2.0, 3.0] };
        let (cage, mut values) = refined(&new(&counts, corners).unwrap(), &points, 2);
        cage.push_to_limit(&mut values);
        assert!(values.data.iter().all(|v| v.is_finite() && (0.0..=3.0).contains(v)));
    }
}
