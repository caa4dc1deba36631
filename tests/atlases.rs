//! What options make of an atlas, and that no texel is shared, on meshes made to be hard and on all shared scenes, by an exact judge.

mod atlas;
mod files;

use atlas::scenes::{cornell, cube, mesh, quads, scene, sphere, surface};
use atlas::{Judgement, chart_maps, judge};
use files::shared;
use glam::{Affine3A, Vec2, Vec3};
use lumel::progress::Silent;
use lumel::scene::{Mesh, Scene, UvSet};
use lumel::unwrap::{
    Atlas, Density, DensityVolume, Earlier, Importance, PageSizes, UnwrapParams, Unwrapper, UvMode, Verdict, unwrap,
    unwrap_after,
};
use std::collections::BTreeSet;

const BOTH: [Unwrapper; 2] = [Unwrapper::Xatlas, Unwrapper::Uvunwrap];

fn params(density: Density) -> UnwrapParams {
    UnwrapParams { density, page_size: 1024, uv: UvMode::New, ..UnwrapParams::default() }
}

fn run(scene: &Scene, params: &UnwrapParams) -> Atlas {
    unwrap(scene, params, &Silent).expect("unwraps").0
}

/// Holds that no texel is shared and nothing overlaps.
fn sound(name: &str, scene: &Scene, atlas: &Atlas) -> Judgement {
    let found = judge(scene, atlas);
    assert_eq!((found.shared_texels, found.near_texels), (0, 0), "{name}: {found:?}");
    assert!(found.overlap < 1e-6, "{name}: {found:?}");
    found
}

// ---- hard meshes ----

/// A mesh of triangles with corners of their own.
fn soup(triangles: impl Iterator<Item = [Vec3; 3]>) -> Mesh {
    let corners: Vec<Vec3> = triangles.flatten().collect();
    let faces: Vec<_> = (0..corners.len() as u32 / 3).map(|t| (vec![3 * t, 3 * t + 1, 3 * t + 2], 0)).collect();
    mesh(corners, &faces)
}

/// A number in 0..1 that looks random.
fn hash(i: u32, k: u32) -> f32 {
    let x = (i.wrapping_mul(0x9E37_79B9) ^ k.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
    ((x ^ (x >> 15)).wrapping_mul(0x27D4_EB2F) >> 8) as f32 / (1 << 24) as f32
}

fn random_point(i: u32) -> Vec3 {
    Vec3::new(hash(i, 1), hash(i, 2), hash(i, 3))
}

/// A rolling ground, each face of it twice: up and down.
fn doubled_ground() -> Mesh {
    let at = |x: u32, z: u32| z * 12 + x;
    let ground = (0..12).flat_map(|z| (0..12).map(move |x| (x as f32, z as f32)));
    let positions = ground.map(|(x, z)| Vec3::new(x, (0.4 * x).sin() + (0.3 * z).cos(), z)).collect();
    let squares = (0..11).flat_map(|z| (0..11).map(move |x| [at(x, z), at(x, z + 1), at(x + 1, z + 1), at(x + 1, z)]));
    let faces: Vec<[u32; 4]> = squares.flat_map(|[a, b, c, d]| [[a, b, c, d], [a, d, c, b]]).collect();
    mesh(positions, &quads(&faces))
}

#[test]
fn both_sides_of_a_doubled_sheet_stay_whole() {
    let scene = scene(vec![doubled_ground()]);
    for unwrapper in BOTH {
        let found =
            sound("ground", &scene, &run(&scene, &UnwrapParams { unwrapper, ..params(Density::FillPage(256)) }));
        assert!(found.charts <= 8, "{unwrapper:?}: {found:?}");
    }
}

/// Ten leaves of a book: three and more faces at each edge of its spine, some of them twice.
fn non_manifold() -> Mesh {
    let mut positions = vec![Vec3::ZERO, Vec3::Y];
    let mut faces = Vec::new();
    for i in 0..10 {
        let angle = 0.6 * (i / 2 * 2) as f32 + 0.2 * (i % 2) as f32;
        let out = Vec3::new(angle.cos(), 0.0, angle.sin());
        let n = positions.len() as u32;
        positions.extend([out, out + Vec3::Y]);
        faces.push([0, n, n + 1, 1]);
        if i % 3 == 0 {
            faces.push([0, n, n + 1, 1]);
        }
    }
    mesh(positions, &quads(&faces))
}

/// A sphere whose vertices are shaken, so that it folds over itself.
fn crumpled() -> Mesh {
    let mut mesh = sphere(1.0, 40, 20);
    for (i, p) in mesh.positions.iter_mut().enumerate() {
        *p += 0.25 * (random_point(i as u32) - 0.5);
    }
    mesh
}

/// A ramp that winds eight times around a pole: flat all but for its rise, so that it lies on itself.
fn helix() -> Mesh {
    let at = |i: u32, r: f32| {
        let a = i as f32 * 0.2;
        Vec3::new(r * a.cos(), 0.002 * i as f32, r * a.sin())
    };
    let positions = (0..=250).flat_map(|i| [at(i, 0.5), at(i, 1.0)]).collect();
    mesh(positions, &quads(&(0..250).map(|i| [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1]).collect::<Vec<_>>()))
}

#[test]
fn hard_meshes_share_no_texel() {
    let slivers = soup((0..300).map(|i| {
        let (a, b) = (random_point(i), random_point(i + 1000));
        [a, b, a.lerp(b, 0.5) + 10f32.powi(-(i as i32 % 7)) * (random_point(i + 2000) - 0.5)]
    }));
    let far = Affine3A::from_translation(Vec3::new(1e5, 0.0, -1e5));
    let meshes = [
        ("slivers", slivers),
        ("non-manifold", non_manifold()),
        ("crumpled", crumpled()),
        ("helix", helix()),
        ("tiny", sphere(1e-5, 12, 6)),
        ("huge", sphere(1e6, 24, 12)),
        ("coincident", soup((0..60).map(|_| [Vec3::ZERO, Vec3::X, Vec3::Y]))),
    ];
    for (name, mesh) in meshes {
        let mut scene = scene(vec![mesh]);
        for unwrapper in BOTH {
            for place in [Affine3A::IDENTITY, far] {
                // A sphere of a hundredth of a millimetre has no area in single precision 100 km away.
                if name == "tiny" && place == far {
                    continue;
                }
                scene.surfaces[0].world_from_local = place;
                let p = UnwrapParams { unwrapper, ..params(Density::FillPage(256)) };
                sound(&format!("{name} by {unwrapper:?}"), &scene, &run(&scene, &p));
            }
        }
    }
}

#[test]
fn ten_thousand_charts_share_no_texel() {
    let loose = soup((0..10_000).map(|i| {
        let a = 30.0 * random_point(3 * i);
        [a, a + random_point(3 * i + 1) - 0.5, a + random_point(3 * i + 2) - 0.5]
    }));
    let scene = scene(vec![loose]);
    let found = sound("loose", &scene, &run(&scene, &params(Density::FillPage(1024))));
    assert!(found.charts == 10_000 && found.touched > 0.25, "{found:?}");
}

#[test]
fn the_judge_sees_what_is_wrong() {
    let scene = cornell();
    let good = run(&scene, &params(Density::FillPage(128)));
    sound("cornell", &scene, &good);
    let mut wide = good.clone();
    wide.padding = 12;
    assert!(judge(&scene, &wide).near_texels > 0);
    let mut doubled = good.clone();
    doubled.meshes[2] = doubled.meshes[1].clone();
    assert!(judge(&scene, &doubled).shared_texels > 100);
    let mut stacked = good;
    stacked.meshes[0].corners[2] = stacked.meshes[0].corners[0];
    let found = judge(&scene, &stacked);
    assert!(found.overlap > 0.01, "{found:?}");
}

// ---- shared scenes ----

#[test]
fn shared_scenes_share_no_texel() {
    let Some(shared) = shared() else { return };
    let mut folders = vec![shared.join("scenes"), shared.join("reference")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            match path.extension().and_then(|e| e.to_str()) {
                _ if path.is_dir() => folders.push(path),
                Some("glb" | "gltf" | "usd" | "usda" | "usdc" | "usdz") => files.push(path),
                _ => {}
            }
        }
    }
    files.sort();
    let mut count = 0;
    let mut known = BTreeSet::new();
    for file in &files {
        let Ok(loaded) = lumel::load::load(file) else { continue };
        let (scene, name) = (loaded.scene, file.strip_prefix(&shared).unwrap_or(file).display());
        // The same scene in another format, or with other materials, has nothing new to unwrap.
        let shape = (scene.triangle_count(), scene.surfaces.len());
        if scene.surfaces.is_empty() || scene.triangle_count() > 300_000 || !known.insert(shape) {
            continue;
        }
        for unwrapper in BOTH {
            let start = std::time::Instant::now();
            let p = UnwrapParams { unwrapper, page_size: 2048, ..params(Density::TexelCount(1 << 15)) };
            match unwrap(&scene, &p, &Silent) {
                Ok((atlas, _)) => {
                    let took = start.elapsed();
                    let found = sound(&format!("{name} by {unwrapper:?}"), &scene, &atlas);
                    println!("{name} by {unwrapper:?}: {} charts, {took:.2?} of {:.2?}", found.charts, start.elapsed());
                    count += 1;
                }
                Err(error) => assert!(error.to_string().contains("nothing to bake"), "{name}: {error}"),
            }
        }
    }
    assert!(count > 20, "{count} scenes of {} files were unwrapped", files.len());
}

// ---- options ----

/// Every block of `side` texels holds texels of one chart at most.
fn one_chart_a_block(scene: &Scene, atlas: &Atlas, side: usize) -> bool {
    chart_maps(scene, atlas).iter().zip(&atlas.pages).all(|(map, size)| {
        let (w, h) = (size[0] as usize, size[1] as usize);
        let blocks = (0..h.div_ceil(side)).flat_map(|y| (0..w.div_ceil(side)).map(move |x| [x * side, y * side]));
        blocks.into_iter().all(|[x, y]| {
            let rows = y..(y + side).min(h);
            let charts = rows.flat_map(|y| (x..(x + side).min(w)).map(move |x| map[y * w + x]));
            charts.filter(|c| *c > 0).collect::<BTreeSet<_>>().len() <= 1
        })
    })
}

/// Free charts, and two rectangles of a shared mesh.
fn mixed() -> Scene {
    let mut scene = scene(vec![sphere(0.5, 24, 12), cube(Vec3::ONE), sphere(0.3, 12, 6)]);
    for i in 1..5 {
        scene.surfaces.push(surface(&format!("/i{i}"), 1, Affine3A::from_translation(Vec3::splat(2.0 * i as f32))));
    }
    scene
}

#[test]
fn aligned_blocks_hold_one_chart() {
    let scene = mixed();
    for (align, padding) in [(4, 1), (4, 2), (4, 5), (8, 2)] {
        let p = UnwrapParams { align, padding, ..params(Density::TexelsPerMetre(30.0)) };
        let atlas = run(&scene, &p);
        sound("aligned", &scene, &atlas);
        assert!(one_chart_a_block(&scene, &atlas, align as usize), "align {align}, padding {padding}");
        // Bilinear filtering reads one texel beyond a chart: that too lies in blocks of its own.
        for (map, size) in chart_maps(&scene, &atlas).iter().zip(&atlas.pages) {
            let (w, a) = (size[0] as usize, align as usize);
            for i in (0..map.len()).filter(|i| map[*i] > 0) {
                let (x, y) = (i % w, i / w);
                for (nx, ny) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                    let (bx, by) = (nx / a * a, ny / a * a);
                    if nx < w && ny < size[1] as usize {
                        let block = (by..by + a).flat_map(|y| (bx..bx + a).map(move |x| map[y * w + x]));
                        assert!(block.into_iter().all(|c| c == 0 || c == map[i]), "align {align} at {x} {y}");
                    }
                }
            }
        }
    }
    // Without it, blocks are shared: the test can fail.
    assert!(!one_chart_a_block(&scene, &run(&scene, &params(Density::TexelsPerMetre(30.0))), 4));
}

#[test]
fn padding_for_mips_keeps_bilinear_reads_apart() {
    let scene = mixed();
    for levels in 1..4u32 {
        let p = UnwrapParams { padding: 1 << levels, ..params(Density::TexelsPerMetre(30.0)) };
        let atlas = run(&scene, &p);
        sound("mips", &scene, &atlas);
        for level in 0..levels {
            assert!(reads_apart(&scene, &atlas, 1 << level), "level {level} of {levels}");
        }
    }
    let p = UnwrapParams { padding: 1, ..params(Density::TexelsPerMetre(30.0)) };
    assert!(!reads_apart(&scene, &run(&scene, &p), 4));
}

/// No bilinear read within a chart, of a mip level with texels of `side`, takes in a texel of another.
fn reads_apart(scene: &Scene, atlas: &Atlas, side: usize) -> bool {
    chart_maps(scene, atlas).iter().zip(&atlas.pages).all(|(map, size)| {
        let (w, h) = (size[0] as usize, size[1] as usize);
        (0..map.len()).filter(|i| map[*i] > 0).all(|i| {
            // Mip texels whose middle is nearer than one of them to some point of the texel.
            let range = |p: usize, limit: usize| {
                let (low, high) = (p as f64 / side as f64 - 0.5, (p + 1) as f64 / side as f64 - 0.5);
                (low.floor().max(0.0) as usize * side)..((high.ceil() as usize + 1) * side).min(limit)
            };
            let columns = range(i % w, w);
            range(i / w, h).all(|y| columns.clone().all(|x| map[y * w + x] == 0 || map[y * w + x] == map[i]))
        })
    })
}

#[test]
fn free_pages_are_multiples_of_four_and_smaller() {
    let scene = mixed();
    let texels = |atlas: &Atlas| atlas.pages.iter().map(|p| p[0] * p[1]).sum::<u32>();
    for density in [20.0, 37.0, 60.0] {
        let p = params(Density::TexelsPerMetre(density));
        let (pot, free) = (run(&scene, &p), run(&scene, &UnwrapParams { pages: PageSizes::Free, ..p.clone() }));
        let found = sound("free", &scene, &free);
        assert!(free.pages.iter().flatten().all(|s| s % 4 == 0), "{:?}", free.pages);
        assert!(texels(&free) <= texels(&pot) && found.touched > 0.6, "{:?} {found:?}", free.pages);
        assert_eq!(free.density, density);
        // Full pages as well, and a count that is kept to.
        let small = UnwrapParams { pages: PageSizes::Free, page_size: 128, max_pages: 3, ..p };
        let few = run(&scene, &small);
        sound("few", &scene, &few);
        assert!(few.pages.len() <= 3 && few.pages.iter().flatten().all(|s| s % 4 == 0 && *s <= 128), "{:?}", few.pages);
    }
}

#[test]
fn no_chart_is_smaller_than_the_least() {
    let scene = scene(vec![cube(Vec3::new(1.0, 0.01, 0.3)), cube(Vec3::splat(0.001))]);
    let p = UnwrapParams { min_chart: 4, ..params(Density::TexelsPerMetre(50.0)) };
    let atlas = run(&scene, &p);
    sound("least", &scene, &atlas);
    for s in 0..2 {
        for chart in 0..atlas.meshes[s].chart_count {
            let of = (0..12).filter(|t| atlas.meshes[s].chart[*t] == chart);
            let corners: Vec<Vec2> = of.flat_map(|t| atlas.page_texels(s, s, t)).collect();
            let low = corners.iter().fold(Vec2::INFINITY, |m, p| m.min(*p));
            let high = corners.iter().fold(Vec2::NEG_INFINITY, |m, p| m.max(*p));
            assert!((high - low).min_element() > 3.999, "{low} {high}");
        }
    }
}

// ---- density ----

/// Texels of a chart.
fn chart_texels(atlas: &Atlas, surface: usize, mesh: usize, chart: u32) -> f64 {
    let of = (0..atlas.meshes[mesh].chart.len()).filter(|t| atlas.meshes[mesh].chart[*t] == chart);
    of.map(|t| atlas::signed_area(atlas.page_texels(surface, mesh, t).map(|p| p.as_dvec2())).abs()).sum()
}

#[test]
fn importance_moves_texels_between_charts_and_keeps_their_number() {
    let scene = mixed();
    let total = |atlas: &Atlas| -> f64 {
        let surfaces = scene.surfaces.iter().enumerate();
        surfaces
            .flat_map(|(s, x)| (0..atlas.meshes[x.mesh].chart_count).map(move |c| (s, x.mesh, c)))
            .map(|(s, m, c)| chart_texels(atlas, s, m, c))
            .sum()
    };
    for density in [Density::TexelsPerMetre(80.0), Density::TexelCount(1 << 17)] {
        let p = params(density);
        let even = run(&scene, &p);
        // The first chart of the sphere, and one side of the shared cube.
        let mut factors = vec![vec![1.0; even.meshes[0].chart_count as usize], vec![1.0; 6]];
        (factors[0][0], factors[1][2]) = (3.0, 2.0);
        let varied = run(&scene, &UnwrapParams { importance: Some(Importance { factors }), ..p });
        sound("important", &scene, &varied);
        assert_eq!(even.meshes[0].chart, varied.meshes[0].chart, "charts keep their numbers");
        let ratio = total(&varied) / total(&even);
        assert!((0.97..1.03).contains(&ratio), "{ratio}");
        let gain = |s: usize, m: usize, c: u32| chart_texels(&varied, s, m, c) / chart_texels(&even, s, m, c);
        for (gain, square) in [(gain(0, 0, 0) / gain(0, 0, 1), 9.0), (gain(1, 1, 2) / gain(1, 1, 3), 4.0)] {
            assert!((gain / square - 1.0).abs() < 0.1, "{gain} is not {square}");
        }
        assert!(gain(0, 0, 1) < 1.0);
    }
}

#[test]
fn volumes_make_texels_finer_where_they_reach() {
    let mut scene = scene((0..4).map(|_| cube(Vec3::ONE)).collect());
    for (i, s) in scene.surfaces.iter_mut().enumerate() {
        s.world_from_local = Affine3A::from_translation(Vec3::X * 10.0 * i as f32);
    }
    // Two instances of the last mesh, one of them in the volume.
    let near = DensityVolume {
        center: [0.5, 0.5, 0.5],
        size: Some([2.0; 3]),
        factor: 2.0,
        falloff: 20.0,
        ..DensityVolume::default()
    };
    scene.surfaces.push(surface("/twin", 3, Affine3A::IDENTITY));
    let p = UnwrapParams { volumes: vec![near], ..params(Density::TexelsPerMetre(60.0)) };
    let atlas = run(&scene, &p);
    sound("volumes", &scene, &atlas);
    let density = |s: usize| atlas.surface_density(&scene, s);
    assert!((density(0) / 120.0 - 1.0).abs() < 0.02, "{}", density(0));
    // Half way, the root; beyond, one.
    assert!((density(1) / 84.85 - 1.0).abs() < 0.15, "{}", density(1));
    assert!((density(2) / 60.0 - 1.0).abs() < 0.05, "{}", density(2));
    assert!((density(3) / 120.0 - 1.0).abs() < 0.02, "what most asks for holds for all: {}", density(3));
}

// ---- authored charts ----

/// Two quads, their UVs on top of each other, one beyond 0..1 and mirrored.
fn clumsy() -> Mesh {
    let x = 3.0 * Vec3::X;
    let positions = vec![
        Vec3::ZERO,
        Vec3::X,
        Vec3::new(1.0, 0.5, 0.0),
        0.5 * Vec3::Y,
        x,
        x + Vec3::X,
        x + Vec3::ONE,
        x + Vec3::new(0.0, 1.0, 1.0),
    ];
    let mut two = mesh(positions, &quads(&[[0, 1, 2, 3], [4, 5, 6, 7]]));
    let coords = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1], [1.5, 0.0], [0.1, 0.0], [0.1, 1.4], [1.5, 1.4]];
    two.uvs.push(UvSet { name: "TEXCOORD_1".into(), coords: coords.map(Vec2::from).to_vec() });
    two
}

#[test]
fn repacking_keeps_the_shapes_of_authored_charts() {
    let scene = scene(vec![clumsy()]);
    let p = UnwrapParams { uv: UvMode::Repack, ..params(Density::TexelsPerMetre(64.0)) };
    let made = unwrap_after(&scene, &p, &Earlier::default(), &Silent).unwrap();
    let found = sound("repacked", &scene, &made.atlas);
    assert_eq!(found.charts, 2);
    assert!(made.warnings.is_empty(), "{:?}", made.warnings);
    let [finding] = &made.authored[..] else { panic!("{:?}", made.authored) };
    assert_eq!((finding.surface.as_str(), finding.verdict), ("/s0", Verdict::Repacked));
    // Two quads of 0.2 x 0.1 and 1.4 x 1.4 share 0.1 x 0.1; densities are 0.2 and the root of 1.96 / sqrt 2.
    assert!((finding.overlap - 0.01 / 1.98).abs() < 5e-4, "{finding:?}");
    assert_eq!(finding.range.map(|p| p.map(|v| (v * 1e4).round() / 1e4)), [[0.0, 0.0], [1.5, 1.4]]);
    assert!((finding.density_spread - 1.4 / 2f64.powf(0.25) / 0.2).abs() < 0.03, "{finding:?}");
    // 64 x 32 texels, and a square of the area of the slanted quad.
    let sides = |t: usize| {
        let [a, b, c] = made.atlas.page_texels(0, 0, t);
        [a.distance(b), b.distance(c)]
    };
    assert_eq!(sides(0), [64.0, 32.0]);
    let [u, v] = sides(2);
    assert!((u / v - 1.0).abs() < 0.01 && (u * v / (64.0 * 64.0 * 2f32.sqrt()) - 1.0).abs() < 0.02, "{u} {v}");
    // Without repacking, they are refused, and the report says why.
    let made = unwrap_after(&scene, &UnwrapParams { uv: UvMode::Auto, ..p }, &Earlier::default(), &Silent).unwrap();
    assert_eq!(made.authored[0].verdict, Verdict::Refused);
    assert_eq!(made.authored[0].reason.as_deref(), Some("leaves 0..1"));
    assert_eq!(made.warnings.iter().count(), 1);
}

#[test]
fn repacked_charts_of_instances_have_rectangles() {
    let mut scene = scene(vec![clumsy(), cube(Vec3::ONE)]);
    scene.surfaces.push(surface("/second", 0, Affine3A::from_translation(Vec3::Z)));
    let p = UnwrapParams { uv: UvMode::Repack, ..params(Density::TexelsPerMetre(40.0)) };
    let made = unwrap_after(&scene, &p, &Earlier::default(), &Silent).unwrap();
    // Two charts for each instance, and six new ones of the cube, which has no UVs.
    assert_eq!(sound("instances", &scene, &made.atlas).charts, 10);
    assert_eq!(made.authored.len(), 1);
    assert_eq!(made.atlas.placements[0].scale, made.atlas.placements[2].scale);
}
