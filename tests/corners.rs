//! Contacts, crevices and walls that part a texel: which cells of its footprint count.

mod support;

use lumel::illuminate::Illuminated;
use lumel::patch::footprint::CellMask;
use support::{Quad, bake_quads, draft};

/// A floor of 2 m by 2 m at 16 texels a metre.
const TEXEL: f32 = 1.0 / 16.0;

fn floor() -> Quad {
    Quad::new([0., 0., 0.], [0., 0., 2.], [2., 0., 0.])
}

/// All six faces of a box with fronts outside, corner and size in texels, but for its height [m].
fn closed_box(x: [f32; 2], y: [f32; 2], z: [f32; 2]) -> Vec<Quad> {
    let ([x, w], [y, h], [z, d]) = (x.map(|v| v * TEXEL), y, z.map(|v| v * TEXEL));
    vec![
        Quad::new([x, y + h, z], [0., 0., d], [w, 0., 0.]),
        Quad::new([x, y, z], [w, 0., 0.], [0., 0., d]),
        Quad::new([x, y, z], [0., 0., d], [0., h, 0.]),
        Quad::new([x + w, y, z], [0., h, 0.], [0., 0., d]),
        Quad::new([x, y, z], [0., h, 0.], [w, 0., 0.]),
        Quad::new([x, y, z + d], [w, 0., 0.], [0., h, 0.]),
    ]
}

/// Open cells of the floor's texel at column `x`, row `z`.
fn cells(baked: &Illuminated, x: u32, z: u32) -> CellMask {
    let at = |i: &usize| {
        let p = baked.patches.position[*i] / TEXEL;
        baked.patches.surface(*i) == 0 && (p.x as u32, p.z as u32) == (x, z)
    };
    baked.exposure.cells[(0..baked.patches.len()).find(at).expect("a texel")]
}

#[test]
fn a_box_leaves_no_rim_whether_it_stands_sinks_or_floats() {
    // It ends three eighths into the texel at column 14: a cell and a half are covered, and a half covered one is left out.
    for bottom in [0.0, -0.01, 0.001, 0.005] {
        let mut quads = vec![floor()];
        quads.extend(closed_box([8.0, 6.375], [bottom, 0.3], [5.0, 6.0]));
        let baked = bake_quads(&quads, 32, &draft());
        assert_eq!(cells(&baked, 10, 8), CellMask::EMPTY, "under a box at {bottom}");
        assert_eq!(cells(&baked, 14, 8).0.count_ones(), 8, "beside a box at {bottom}");
        assert_eq!(cells(&baked, 16, 8), CellMask::ALL, "far from a box at {bottom}");
    }
}

#[test]
fn what_can_be_looked_under_is_no_crevice() {
    let mut quads = vec![floor()];
    quads.extend(closed_box([8.0, 6.375], [0.021, 0.3], [5.0, 6.0]));
    let baked = bake_quads(&quads, 32, &draft());
    assert_eq!(cells(&baked, 10, 8), CellMask::ALL);
    assert_eq!(cells(&baked, 14, 8), CellMask::ALL);
}

#[test]
fn a_lamp_right_above_a_floor_covers_nothing() {
    let lamp = Quad::new([0.5, 0.002, 0.5], [1., 0., 0.], [0., 0., 1.]).emission(10.0);
    let baked = bake_quads(&[floor(), lamp], 32, &draft());
    assert_eq!(baked.exposure.buried_count(), 0);
    let is_under = |i: &usize| {
        let p = baked.patches.position[*i];
        baked.patches.surface(*i) == 0 && (0.6..1.4).contains(&p.x) && (0.6..1.4).contains(&p.z)
    };
    let least = (0..baked.patches.len()).filter(is_under).map(|i| baked.direct.shown[i].x).reduce(f32::min);
    // Nearly all of what the lamp sends: pi times its radiance.
    assert!(least.is_some_and(|e| e > 28.0), "{least:?}");
}

#[test]
fn a_texel_that_a_wall_parts_shows_its_front() {
    // A single-sided wall through the middle of the texels of column 20 faces +X; the floor goes on behind it.
    let wall = Quad::new([20.5 * TEXEL, 0., -1.], [0., 2., 0.], [0., 0., 4.]);
    let baked = bake_quads(&[floor(), wall], 32, &draft());
    for z in 2..30 {
        let open = cells(&baked, 20, z);
        // Its cells are numbered along the texel: whichever way that is, half of them are in front.
        assert_eq!(open.0.count_ones(), 8, "{:016b} in row {z}", open.0);
        assert_eq!(cells(&baked, 24, z), CellMask::ALL);
        assert_eq!(cells(&baked, 10, z), CellMask::ALL);
    }
}
