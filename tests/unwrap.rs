//! Lightmap UVs: what must hold of any atlas, checked texel by texel, on small meshes and on real scenes.

mod atlas;

use atlas::covered;
use atlas::scenes::{cornell, cube, mesh, quads, scene, sphere, surface};
use glam::{Affine3A, Quat, Vec2, Vec3};
use lumel::error::Warnings;
use lumel::progress::Silent;
use lumel::scene::{Mesh, Scene, UvSet};
use lumel::unwrap::{Atlas, Density, UnwrapParams, UvMode, unwrap};
use std::collections::HashMap;
use std::path::PathBuf;

fn params(density: Density) -> UnwrapParams {
    UnwrapParams { density, page_size: 1024, ..UnwrapParams::default() }
}

// ---- the checker ----

/// Figures of an atlas.
#[derive(Debug)]
struct Figures {
    /// Texels touched by charts / texels of all pages.
    utilization: f64,
    charts: usize,
}

/// Holds everything that an atlas promises; `authored_pages` lifts what authored page-space UVs can't.
fn check(scene: &Scene, atlas: &Atlas, authored_pages: bool) -> Figures {
    assert_eq!(atlas.meshes.len(), scene.meshes.len());
    assert_eq!(atlas.placements.len(), scene.surfaces.len());
    let mut owners: Vec<Vec<u32>> = atlas.pages.iter().map(|p| vec![0; p[0] as usize * p[1] as usize]).collect();
    let mut numbers: HashMap<(usize, u32), u32> = HashMap::new();
    let mut charts = 0;
    for (s, surface) in scene.surfaces.iter().enumerate() {
        let (source, uvs) = (&scene.meshes[surface.mesh], &atlas.meshes[surface.mesh]);
        assert_eq!(uvs.corners.len(), source.triangles.len());
        assert_eq!(uvs.chart.len(), source.triangles.len());
        charts += uvs.chart_count as usize;
        let mut material = HashMap::new();
        let mut polygon = HashMap::new();
        let page = atlas.placements[s].page as usize;
        let [w, h] = atlas.pages[page];
        let (mut flat, mut area) = (0.0, 0.0);
        for t in 0..source.triangles.len() {
            let chart = uvs.chart[t];
            assert!(chart < uvs.chart_count);
            assert_eq!(*material.entry(chart).or_insert(source.triangle_material[t]), source.triangle_material[t]);
            let origin = source.origin[t];
            assert_eq!(*polygon.entry((origin.part, origin.face)).or_insert(chart), chart, "{} {t}", surface.name);
            let texels = atlas.page_texels(s, surface.mesh, t).map(|p| p.as_dvec2());
            let own = (texels[1] - texels[0]).perp_dot(texels[2] - texels[0]) * 0.5;
            assert!(own.abs() > 0.0, "{} triangle {t}: {texels:?}", surface.name);
            flat += own.abs();
            let [a, b, c] = scene.world_triangle(s, t).map(|p| p.as_dvec3());
            area += 0.5 * (b - a).cross(c - a).length();
            for p in texels {
                assert!(p.min_element() >= 0.0 && p.x <= w as f64 && p.y <= h as f64, "{p}");
            }
            let count = numbers.len() as u32;
            let number = *numbers.entry((s, chart)).or_insert(count + 1);
            for [x, y] in covered(texels) {
                let owner = &mut owners[page][y * w as usize + x];
                if !authored_pages {
                    assert!(*owner == 0 || *owner == number, "{} shares texel {x} {y} of page {page}", surface.name);
                }
                *owner = number;
            }
        }
        let density = (flat / area).sqrt();
        if area * f64::from(atlas.density).powi(2) > 400.0 && !authored_pages {
            assert!((0.5..2.0).contains(&(density / f64::from(atlas.density))), "{}: {density} texels/m", surface.name);
        }
    }
    let mut used = 0;
    for (owners, &[w, h]) in owners.iter().zip(&atlas.pages) {
        let (w, h, p) = (w as usize, h as usize, atlas.padding as usize);
        used += owners.iter().filter(|o| **o > 0).count();
        for (i, &owner) in owners.iter().enumerate().filter(|(_, o)| **o > 0 && !authored_pages) {
            let (x, y) = (i % w, i / w);
            assert!(x >= p && y >= p && x + p < w && y + p < h, "texel {x} {y} is too near to the edge");
            for ny in y - p..=y + p {
                for nx in x - p..=x + p {
                    let other = owners[ny * w + nx];
                    assert!(other == 0 || other == owner, "{x} {y} and {nx} {ny} are too near");
                }
            }
        }
    }
    let texels: usize = atlas.pages.iter().map(|p| p[0] as usize * p[1] as usize).sum();
    Figures { utilization: used as f64 / texels as f64, charts }
}

fn run(scene: &Scene, params: &UnwrapParams) -> (Atlas, Warnings) {
    unwrap(scene, params, &Silent).expect("unwraps")
}

/// Writes a picture of each page into the folder that `LUMEL_ATLAS_PICTURES` names, if it names one.
fn picture(name: &str, scene: &Scene, atlas: &Atlas) {
    let Some(folder) = std::env::var_os("LUMEL_ATLAS_PICTURES") else { return };
    for (page, &[w, h]) in atlas.pages.iter().enumerate() {
        let mut image = image::RgbImage::new(w, h);
        for (s, surface) in scene.surfaces.iter().enumerate().filter(|(s, _)| atlas.placements[*s].page == page as u32)
        {
            for (t, &chart) in atlas.meshes[surface.mesh].chart.iter().enumerate() {
                let hash = (chart + 1 + 7919 * s as u32).wrapping_mul(2654435761);
                let shade = [hash >> 8, hash >> 16, hash >> 24].map(|v| (v & 127) as u8 + 80 + (t % 4) as u8 * 12);
                for [x, y] in covered(atlas.page_texels(s, surface.mesh, t).map(|p| p.as_dvec2())) {
                    image.put_pixel(x as u32, y as u32, image::Rgb(shade));
                }
            }
        }
        image.save(PathBuf::from(&folder).join(format!("{name}_{page}.png"))).expect("picture is written");
    }
}

// ---- what must hold ----

#[test]
fn cube_has_six_exact_squares() {
    let scene = scene(vec![cube(Vec3::ONE)]);
    let (atlas, warnings) = run(&scene, &params(Density::TexelsPerMetre(32.0)));
    let figures = check(&scene, &atlas, false);
    assert!(warnings.is_empty());
    assert_eq!(figures.charts, 6);
    // Each face is 32 x 32 texels, borders on texel borders, to the bit.
    let [w, h] = atlas.pages[0];
    for t in 0..12 {
        for p in atlas.page_texels(0, 0, t) {
            assert_eq!(p, p.round());
        }
    }
    assert_eq!(figures.utilization, 6.0 * 1024.0 / f64::from(w * h));
}

#[test]
fn cornell_box_fills_a_page() {
    let scene = cornell();
    let (atlas, _) = run(&scene, &params(Density::FillPage(256)));
    let figures = check(&scene, &atlas, false);
    picture("cornell", &scene, &atlas);
    println!("cornell: {figures:?}, density {}", atlas.density);
    assert_eq!(atlas.pages, [[256, 256]]);
    assert_eq!(figures.charts, 17);
    assert!(figures.utilization > 0.62, "{figures:?}");
}

#[test]
fn texel_count_is_met() {
    let scene = cornell();
    for count in [1 << 12, 1 << 16, 1 << 18] {
        let (atlas, _) = run(&scene, &params(Density::TexelCount(count)));
        check(&scene, &atlas, false);
        let area: f64 = (0..scene.surfaces.len())
            .flat_map(|s| (0..scene.meshes[s].triangles.len()).map(move |t| (s, t)))
            .map(|(s, t)| {
                let [a, b, c] = atlas.page_texels(s, s, t).map(|p| p.as_dvec2());
                0.5 * (b - a).perp_dot(c - a).abs()
            })
            .sum();
        assert!((area / count as f64 - 1.0).abs() < 0.05, "{area} of {count} texels");
        println!("{count} texels on {:?}", atlas.pages);
    }
}

#[test]
fn sphere_has_few_charts_of_even_density() {
    let scene = scene(vec![sphere(1.0, 48, 24)]);
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(40.0)));
    let figures = check(&scene, &atlas, false);
    picture("sphere", &scene, &atlas);
    println!("sphere: {figures:?}");
    assert!(figures.charts < 40, "{figures:?}");
    for t in 0..scene.meshes[0].triangles.len() {
        let [a, b, c] = atlas.page_texels(0, 0, t).map(|p| p.as_dvec2());
        let [i, j, k] = scene.world_triangle(0, t).map(|p| p.as_dvec3());
        let stretch = (b - a).perp_dot(c - a) / (j - i).cross(k - i).length() / 1600.0;
        assert!((0.1..10.0).contains(&stretch), "triangle {t} is stretched by {stretch}");
    }
}

#[test]
fn instances_share_uvs_and_have_rectangles() {
    let mut scene = scene(vec![sphere(0.3, 16, 8), cube(Vec3::ONE)]);
    for i in 1..6 {
        let scale = Vec3::splat(0.5 + 0.1 * i as f32) * Vec3::new(if i == 3 { -1.0 } else { 1.0 }, 1.0, 1.0);
        let place = Affine3A::from_scale_rotation_translation(scale, Quat::IDENTITY, Vec3::splat(i as f32));
        scene.surfaces.push(surface(&format!("/i{i}"), 0, place));
    }
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(60.0)));
    picture("instances", &scene, &atlas);
    // Small instances have the rectangle of the largest, so density is checked on the largest alone.
    let mut loose = atlas.clone();
    loose.density = 1e-3;
    check(&scene, &loose, false);
    let uvs = atlas.meshes[0].corners.iter().flatten();
    let high = uvs.fold(Vec2::ZERO, |m, p| m.max(*p));
    assert!((high - Vec2::ONE).abs().max_element() < 1e-6, "shared UVs fill 0..1: {high}");
}

#[test]
fn charts_keep_to_one_material() {
    let mut split = sphere(1.0, 24, 12);
    for (m, t) in split.triangle_material.iter_mut().zip(&split.triangles) {
        *m = u32::from(split.positions[t[0] as usize].x > 0.1);
    }
    // A polygon has one material.
    for i in 1..split.origin.len() {
        if split.origin[i].face == split.origin[i - 1].face {
            split.triangle_material[i] = split.triangle_material[i - 1];
        }
    }
    let scene = scene(vec![split]);
    let (atlas, _) = run(&scene, &params(Density::TexelCount(20000)));
    check(&scene, &atlas, false);
}

#[test]
fn bent_polygons_stay_whole() {
    // Quads bent by up to 40 degrees along their diagonals: xatlas would like to cut some of them.
    let mut bent = sphere(1.0, 9, 5);
    for (i, p) in bent.positions.iter_mut().enumerate() {
        *p *= 1.0 + 0.25 * ((i * 7 % 5) as f32 / 5.0);
    }
    let scene = scene(vec![bent]);
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(50.0)));
    let figures = check(&scene, &atlas, false);
    picture("bent", &scene, &atlas);
    println!("bent: {figures:?}");
}

#[test]
fn slivers_and_stacked_faces_are_mapped() {
    let mut positions = Vec::new();
    let mut polygons = Vec::new();
    // A fan of slivers, thinner and thinner, then the same square three times over, once turned around.
    positions.push(Vec3::ZERO);
    for i in 0..40 {
        let angle = 1.0 - 0.7f32.powi(i);
        positions.push(Vec3::new(angle.cos(), 0.01 * (i % 3) as f32, angle.sin()));
    }
    for i in 1..36 {
        polygons.push((vec![0, i + 1, i], 0));
    }
    let base = positions.len() as u32;
    positions.extend([Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y].map(|p| p + 3.0 * Vec3::X));
    for _ in 0..3 {
        polygons.push((vec![base, base + 1, base + 2, base + 3], 0));
    }
    polygons.push((vec![base, base + 3, base + 2, base + 1], 0));
    let scene = scene(vec![mesh(positions, &polygons)]);
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(64.0)));
    check(&scene, &atlas, false);
    picture("slivers", &scene, &atlas);
}

#[test]
fn a_spiral_ramp_does_not_overlap_itself() {
    let mut positions = Vec::new();
    let steps = 120;
    for i in 0..=steps {
        let a = i as f32 * 0.15;
        for r in [0.6, 1.0] {
            positions.push(Vec3::new(r * a.cos(), 0.01 * i as f32, r * a.sin()));
        }
    }
    let polygons: Vec<_> = (0..steps).map(|i| (vec![2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1], 0)).collect();
    let scene = scene(vec![mesh(positions, &polygons)]);
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(60.0)));
    check(&scene, &atlas, false);
    picture("spiral", &scene, &atlas);
    // Within a chart, texel centres are covered once.
    let mut seen = std::collections::HashSet::new();
    for t in 0..scene.meshes[0].triangles.len() {
        let [a, b, c] = atlas.page_texels(0, 0, t).map(|p| p.as_dvec2());
        for [x, y] in covered([a, b, c]) {
            let p = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let sides = [(a, b), (b, c), (c, a)].map(|(a, b)| (b - a).perp_dot(p - a));
            if sides.iter().all(|s| *s > 1e-3) || sides.iter().all(|s| *s < -1e-3) {
                assert!(seen.insert((x, y)), "texel {x} {y} is covered twice");
            }
        }
    }
}

#[test]
fn many_pages_and_too_few() {
    let scene = scene((0..20).map(|_| cube(Vec3::ONE)).collect());
    let mut p = params(Density::TexelsPerMetre(48.0));
    p.page_size = 256;
    let (atlas, warnings) = run(&scene, &p);
    check(&scene, &atlas, false);
    assert!(warnings.is_empty());
    // Five by five squares of 48 texels and their padding: four cubes a page.
    assert_eq!(atlas.pages.len(), 5);
    p.max_pages = 2;
    let (atlas, warnings) = run(&scene, &p);
    let figures = check(&scene, &atlas, false);
    assert_eq!(warnings.iter().count(), 1);
    assert!(atlas.pages.len() <= 2 && atlas.density < 48.0);
    println!("two pages: {figures:?} at {}", atlas.density);
    assert!(figures.utilization > 0.5);
    // One surface too large for a page loses density alone.
    let mut large = self::scene(vec![cube(Vec3::ONE), cube(Vec3::splat(10.0))]);
    large.surfaces[1].name = "/large".into();
    p.max_pages = 8;
    let (atlas, warnings) = run(&large, &p);
    assert_eq!(atlas.density, 48.0);
    assert!(warnings.iter().any(|w| w.places[0].starts_with("/large")));
    let mut loose = atlas.clone();
    loose.density = 1e-3;
    check(&large, &loose, false);
}

#[test]
fn padding_falls_before_charts_are_refused() {
    let cubes = |count: usize| scene((0..count).map(|_| cube(Vec3::ONE)).collect());
    for density in [Density::FillPage(16), Density::TexelsPerMetre(48.0)] {
        let mut p = params(density);
        (p.max_pages, p.page_size, p.padding) = (1, 16, 2);
        // Charts of a texel each: 6 of them have room for the padding, 36 for one texel, 180 for none.
        for (count, padding) in [(1, 2), (6, 1), (30, 0)] {
            let scene = cubes(count);
            let (atlas, warnings) = run(&scene, &p);
            let mut loose = atlas.clone();
            loose.density = 1e-3;
            check(&scene, &loose, false);
            assert_eq!(atlas.padding, padding, "{count} cubes");
            assert_eq!(warnings.iter().any(|w| w.message.contains("padding was lowered")), padding < 2);
        }
        // More charts than texels.
        let error = unwrap(&cubes(50), &p, &Silent).unwrap_err().to_string();
        assert!(error.contains("300 charts"), "{error}");
    }
}

#[test]
fn same_bits_for_any_thread_count() {
    let mut scene = cornell();
    scene.meshes.push(sphere(0.5, 32, 16));
    scene.surfaces.push(surface("/ball", 3, Affine3A::from_scale(Vec3::new(1.0, 2.0, 0.5))));
    let p = params(Density::TexelCount(30000));
    let first = run(&scene, &p).0;
    assert_eq!(first, run(&scene, &p).0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    assert_eq!(first, pool.install(|| run(&scene, &p).0));
}

// ---- real scenes ----

/// Unwraps a scene of the shared folder and checks the atlas; the folder is absent outside the project.
fn real_scene(path: &str, density: Density, uv: UvMode) {
    let folder = std::env::var_os("LUMEL_REFERENCE")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = folder.join(path);
    if !path.exists() {
        println!("skipped: {} is not here", path.display());
        return;
    }
    let scene = lumel::load::load(&path).expect("loads").scene;
    let start = std::time::Instant::now();
    let mut p = params(density);
    p.uv = uv;
    let (atlas, warnings) = run(&scene, &p);
    let took = start.elapsed();
    let mut loose = atlas.clone();
    loose.density = 1e-3;
    let figures = check(&scene, &loose, uv == UvMode::Keep);
    let name = path.file_stem().expect("a file").to_string_lossy();
    println!(
        "{name}: {} triangles, {took:.2?}, {figures:?}, {:?}, {} texels/m, {warnings:?}",
        scene.triangle_count(),
        atlas.pages,
        atlas.density
    );
    picture(&name, &scene, &atlas);
}

#[test]
fn reference_cornell_box() {
    real_scene("reference/cornell_box/scene.glb", Density::FillPage(256), UvMode::New);
}

#[test]
fn reference_living_room() {
    real_scene("reference/living_room/scene.glb", Density::TexelCount(1 << 18), UvMode::New);
}

#[test]
fn reference_atrium_keeps_its_page() {
    real_scene("reference/atrium/scene.glb", Density::TexelCount(1 << 18), UvMode::Keep);
}

#[test]
fn godot_gi() {
    real_scene("scenes/godot_gi_zdm2/3d/global_illumination/zdm2.glb", Density::TexelCount(1 << 18), UvMode::New);
}

#[test]
fn playcanvas_house() {
    real_scene("scenes/playcanvas_house/examples/assets/models/house.glb", Density::TexelCount(1 << 18), UvMode::New);
}

// ---- authored UVs ----

/// A quad whose UV set covers `low..high`.
fn authored_quad(low: Vec2, high: Vec2) -> Mesh {
    let mut quad = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y], &quads(&[[0, 1, 2, 3]]));
    let coords = vec![low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)];
    quad.uvs.push(UvSet { name: "TEXCOORD_1".into(), coords });
    quad
}

#[test]
fn authored_page_space_stands() {
    let left = authored_quad(Vec2::new(0.05, 0.05), Vec2::new(0.45, 0.45));
    let right = authored_quad(Vec2::new(0.55, 0.05), Vec2::new(0.95, 0.45));
    let scene = scene(vec![left, right]);
    let (atlas, warnings) = run(&scene, &params(Density::FillPage(128)));
    check(&scene, &atlas, true);
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(atlas.pages, [[128, 128]]);
    assert_eq!(atlas.placements[1].scale, Vec2::ONE);
    assert_eq!(atlas.meshes[0].authored.as_deref(), Some("TEXCOORD_1"));
    assert_eq!(atlas.meshes[1].corners[0][0], Vec2::new(0.55, 0.05));
    let (atlas, _) = run(&scene, &params(Density::TexelsPerMetre(25.6)));
    assert_eq!(atlas.pages, [[64, 64]]);
}

#[test]
fn authored_sets_of_instances_get_rectangles() {
    let mut scene = scene(vec![authored_quad(Vec2::ZERO, Vec2::ONE)]);
    scene.surfaces.push(surface("/second", 0, Affine3A::from_translation(Vec3::Z)));
    let (atlas, warnings) = run(&scene, &params(Density::TexelsPerMetre(32.0)));
    check(&scene, &atlas, false);
    assert!(warnings.is_empty());
    assert_eq!(atlas.meshes[0].authored.as_deref(), Some("TEXCOORD_1"));
    assert_eq!(atlas.meshes[0].corners[0][2], Vec2::ONE);
}

#[test]
fn unsound_authored_sets_are_replaced_or_refused() {
    let mut overlapping = cube(Vec3::ONE);
    let coords = overlapping.positions.iter().map(|p| p.truncate()).collect();
    overlapping.uvs.push(UvSet { name: "st1".into(), coords });
    let outside = authored_quad(Vec2::ZERO, Vec2::new(2.0, 1.0));
    for mesh in [overlapping, outside] {
        let scene = scene(vec![mesh]);
        let mut p = params(Density::TexelsPerMetre(20.0));
        let (atlas, warnings) = run(&scene, &p);
        check(&scene, &atlas, false);
        assert_eq!(warnings.iter().count(), 1);
        assert_eq!(atlas.meshes[0].authored, None);
        p.uv = UvMode::Keep;
        let error = unwrap(&scene, &p, &Silent).expect_err("refused").to_string();
        assert!(error.starts_with("/s0: "), "{error}");
    }
}
