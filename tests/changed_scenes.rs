//! What is kept over a change in scenes of all kinds: curved and double-sided things, panes, skies, links of lights, things that don't cast.

mod files;
mod support;

use files::Folder;
use glam::{Affine3A, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::kept::add_base;
use lumel::illuminate::state::State;
use lumel::illuminate::{Illuminated, illuminate, illuminate_with};
use lumel::post::{Directional, Layer};
use lumel::progress::Silent;
use lumel::scene::{Environment, Light, LightShape, Linked, Scene, Texels, Texture};
use lumel::settings::{Normals, Settings};
use lumel::store::{Key, Store};
use lumel::unwrap::{Atlas, Density, Earlier, UnwrapParams, unwrap_after};
use lumel::work::Work;
use std::time::Duration;
use support::{Quad, measure::block, mesh_scene, room, sphere, triangles};

/// Something in a room: its name, where it stands, and its triangles there.
type Thing = (&'static str, [f32; 3], Vec<[Vec3; 3]>);

fn cube(name: &'static str, at: [f32; 3], size: [f32; 3]) -> Thing {
    (name, at, block([0.0; 3], size).iter().flat_map(triangles).collect())
}

fn ball(name: &'static str, at: [f32; 3], radius: f32) -> Thing {
    (name, at, sphere(Vec3::splat(radius), radius, 8, false))
}

fn sheet(name: &'static str, at: [f32; 3], u: [f32; 3], v: [f32; 3]) -> Thing {
    (name, at, triangles(&Quad::new([0.0; 3], u, v)))
}

/// The `walls` and `things` in them, each of a material of its own.
fn furnished(walls: &[Quad], things: &[Thing]) -> Scene {
    let mut surfaces: Vec<Vec<[Vec3; 3]>> = walls.iter().map(triangles).collect();
    surfaces.extend(things.iter().map(|thing| thing.2.clone()));
    let mut scene = mesh_scene(&surfaces);
    for (surface, (name, at, _)) in scene.surfaces[walls.len()..].iter_mut().zip(things) {
        surface.name = (*name).to_owned();
        surface.world_from_local = Affine3A::from_translation(Vec3::from(*at));
    }
    scene.materials = vec![scene.materials[0].clone(); surfaces.len()];
    for (k, mesh) in scene.meshes.iter_mut().enumerate() {
        mesh.triangle_material.fill(k as u32);
    }
    scene
}

/// The index of the surface `name`, which is that of its mesh and material, too.
fn index(scene: &Scene, name: &str) -> usize {
    scene.surfaces.iter().position(|surface| surface.name == name).unwrap()
}

fn lamp(at: [f32; 3], intensity: f32) -> Light {
    Light::new("lamp", LightShape::Point { position: at.into(), intensity: Rgb::splat(intensity), range: None })
}

fn globe(at: [f32; 3]) -> Light {
    let world_from_unit = Affine3A::from_scale_rotation_translation(Vec3::splat(0.15), glam::Quat::IDENTITY, at.into());
    Light::new("globe", LightShape::Sphere { world_from_unit, radiance: Rgb::splat(100.0) })
}

fn settings() -> Settings {
    Settings { normals: Normals::Geometric, error: Some(1.0), ..Settings::default() }
}

fn laid_out(scene: &Scene, before: &Earlier) -> (Atlas, Earlier) {
    let params = UnwrapParams { density: Density::TexelsPerMetre(10.0), page_size: 256, ..UnwrapParams::default() };
    let made = unwrap_after(scene, &params, before, &Silent).unwrap();
    (made.atlas, made.earlier)
}

fn base(scene: &Scene, atlas: &Atlas) -> Key {
    Key::of("base", |hasher| add_base(hasher, scene, atlas))
}

/// The root mean square of the differences of luminance between two bakes of the same texels, over the mean, that of the means, and the
/// largest of the means of a surface.
fn differences(a: &Illuminated, b: &Illuminated, surfaces: usize) -> [f64; 3] {
    let (mut square, mut bias, mut sum, mut area) = (0.0, 0.0, 0.0, 0.0);
    let mut of_surface = vec![[0.0; 2]; surfaces];
    for i in 0..a.patches.len() {
        let w = f64::from(b.exposure.area[i]);
        let [x, y] = [a, b].map(|lit| f64::from(luminance(lit.gathered.irradiance[i])));
        (square, bias) = (square + w * (x - y).powi(2), bias + w * (x - y));
        (sum, area) = (sum + w * y, area + w);
        let own = &mut of_surface[a.patches.surface(i) as usize];
        *own = [own[0] + w * (x - y), own[1] + w];
    }
    let mean = sum / area;
    let off = of_surface.iter().filter(|own| own[1] > 0.0).map(|own| (own[0] / own[1] / mean).abs());
    [(square / area).sqrt() / mean, bias / sum, off.fold(0.0, f64::max)]
}

/// The share of the area on which `a` has more or less than `b` by over half of what is there.
fn stark(a: &Illuminated, b: &Illuminated) -> f64 {
    let (mut off, mut all) = (0.0, 0.0);
    for i in 0..a.patches.len() {
        let area = f64::from(b.exposure.area[i]);
        let [x, y] = [a, b].map(|lit| f64::from(luminance(lit.gathered.irradiance[i])));
        all += area;
        off += if (x - y).abs() > 0.5 * y { area } else { 0.0 };
    }
    off / all
}

/// The root mean square of the differences between the texels of two layers, over that of one of them.
fn layer_difference(a: &Layer, b: &Layer) -> f64 {
    let square = |off: Vec3| f64::from(off.length_squared());
    let pairs = || a.pages.iter().flatten().zip(b.pages.iter().flatten());
    let (off, whole) = pairs().fold((0.0, 0.0), |(off, whole), (a, b)| (off + square(*a - *b), whole + square(*b)));
    (off / whole).sqrt()
}

/// Bakes `before`, then `after` with what is known from it, and holds that against a bake anew.
fn assert_follows(name: &str, before: &Scene, after: &Scene, settings: &Settings) {
    let folder = Folder::new(name);
    let store = Store::open(&folder.0).unwrap();
    let (atlas, earlier) = laid_out(before, &Earlier::default());
    let work = Work::new(&store, base(before, &atlas), None, Duration::MAX);
    let first = illuminate_with(before, &atlas, settings, &work, &Silent).unwrap();
    let known = State::new(before, &atlas, base(before, &atlas), &first.patches.runs(before.surfaces.len()));
    let (atlas, _) = laid_out(after, &earlier);
    let now = State::new(after, &atlas, base(after, &atlas), &[]);
    let (key, change) = now.since(&known).expect("most is as it was");
    let work = Work::new(&store, base(after, &atlas), None, Duration::MAX).after(key, change);
    let again = illuminate_with(after, &atlas, settings, &work, &Silent).unwrap();
    let full = illuminate(after, &atlas, settings, &Silent).unwrap();
    let [rms, bias, off] = differences(&again, &full, after.surfaces.len()).map(|d| 100.0 * d);
    let imbalance = 100.0 * (again.energy.imbalance - full.energy.imbalance);
    let stark = 100.0 * stark(&again, &full);
    println!(
        "{name}: rms {rms:.2} %, bias {bias:+.2} %, of a surface {off:.2} %, balance {imbalance:+.2} %, stark {stark:.3} %"
    );
    // Contact shadows are small and deep.
    assert!(stark < 0.05, "{name}: {stark}");
    assert!(rms < 2.0 && bias.abs() < 0.4 && off < 1.5, "{name}: {rms} {bias} {off}");
    assert!(imbalance.abs() < 0.5, "{name}: {imbalance}");
    for (ours, theirs) in again.lightmap.layers.iter().zip(&full.lightmap.layers) {
        let off = layer_difference(ours, theirs);
        println!("{name}, {}: {:.2} %", ours.name, 100.0 * off);
        assert!(off < 0.04, "{name}, {}: {off}", ours.name);
    }
    // Of a scene that changed that much, or else this tells nothing.
    let rays = |lit: &Illuminated| lit.direct.rays + lit.gathered.rays;
    assert!(rays(&again) < 2 * rays(&full) / 3, "{name}: {} of {} rays", rays(&again), rays(&full));
}

#[test]
fn links_of_lights_follow_surfaces_that_have_other_numbers() {
    let walls = room([4.0, 3.0, 5.0]);
    let stool = || cube("stool", [2.9, 0.0, 3.2], [0.4, 0.4, 0.4]);
    let table = || cube("table", [1.0, 0.0, 1.0], [0.9, 0.6, 0.7]);
    let shelf = || cube("shelf", [0.2, 0.0, 3.4], [0.4, 1.6, 1.0]);
    let chest = || cube("chest", [2.6, 0.0, 0.6], [0.5, 0.5, 0.5]);
    let scene = |things: &[Thing], lit: &str| {
        let mut scene = furnished(&walls, things);
        let only = |name: &str| Linked::only(scene.surfaces.iter().map(|s| s.name == name).collect());
        let mut linked = lamp([2.0, 2.6, 2.6], 60.0);
        linked.links.lit = only(lit);
        scene.lights = vec![lamp([3.0, 2.5, 4.0], 20.0), linked];
        scene
    };
    // The same number: first the table has it, then the shelf.
    let (before, after) = (scene(&[stool(), table(), shelf()], "table"), scene(&[table(), shelf(), chest()], "shelf"));
    assert_eq!(index(&before, "table"), index(&after, "shelf"));
    assert_follows("links", &before, &after, &settings());
}

#[test]
fn curved_things_follow_with_smooth_normals() {
    let walls = room([4.0, 3.0, 5.0]);
    let scene = |at: [f32; 3]| {
        let things = [
            ball("ball", [2.2, 0.4, 2.0], 0.5),
            ball("other", at, 0.35),
            cube("block", [0.6, 0.0, 3.2], [0.6, 0.9, 0.6]),
        ];
        let mut scene = furnished(&walls, &things);
        for (mesh, (_, _, triangles)) in scene.meshes[walls.len()..].iter_mut().zip(&things[..2]) {
            let middle = triangles.iter().flatten().sum::<Vec3>() / (3 * triangles.len()) as f32;
            mesh.normals = mesh.positions.iter().map(|p| (*p - middle).normalize()).collect();
        }
        scene.lights.push(globe([2.4, 2.6, 2.8]));
        scene
    };
    let (before, after) = (scene([3.0, 0.3, 0.6]), scene([1.2, 0.2, 1.0]));
    assert_follows("curved", &before, &after, &Settings { normals: Normals::Shading, ..settings() });
    let directional = Settings { normals: Normals::Shading, directional: Directional::Sh, ..settings() };
    assert_follows("directional", &before, &after, &directional);
}

#[test]
fn double_sided_things_and_their_backs_follow() {
    let walls = room([4.0, 3.0, 5.0]);
    let scene = |at: [f32; 3]| {
        let screen = sheet("screen", [2.6, 0.2, 1.0], [0.0, 0.0, 1.6], [0.0, 1.5, 0.0]);
        let things =
            [screen, sheet("table", at, [0.0, 0.0, 0.9], [1.1, 0.0, 0.0]), cube("chest", [0.2, 0.0, 0.3], [0.5; 3])];
        let mut scene = furnished(&walls, &things);
        for name in ["screen", "table"] {
            let k = index(&scene, name);
            scene.materials[k].double_sided = true;
        }
        scene.lights = vec![lamp([3.2, 2.4, 2.0], 40.0), globe([1.0, 0.9, 4.0])];
        scene
    };
    assert_follows("double-sided", &scene([0.9, 0.7, 1.0]), &scene([1.2, 1.1, 2.8]), &settings());
}

#[test]
fn panes_follow() {
    let walls = room([4.0, 3.0, 5.0]);
    let scene = |at: [f32; 3]| {
        let pane = sheet("pane", at, [0.0, 0.0, 1.4], [0.0, 1.6, 0.0]);
        let mut scene = furnished(&walls, &[pane, cube("chest", [0.4, 0.0, 3.6], [0.7; 3])]);
        let k = index(&scene, "pane");
        scene.materials[k].transmission = Rgb::new(0.9, 0.3, 0.1);
        scene.materials[k].double_sided = true;
        scene.lights = vec![lamp([3.2, 1.6, 2.4], 40.0), globe([0.8, 2.4, 1.0])];
        scene
    };
    assert_follows("pane", &scene([2.4, 0.2, 0.8]), &scene([1.6, 0.4, 2.2]), &settings());
}

#[test]
fn things_under_skies_follow() {
    // Without a wall, and with a bright spot in the sky.
    let walls = &room([4.0, 3.0, 5.0])[..5];
    let scene = |at: [f32; 3], has_picture: bool| {
        let things = [cube("table", at, [0.9, 0.6, 0.7]), cube("shelf", [0.1, 0.0, 0.4], [0.4, 1.6, 1.0])];
        let mut scene = furnished(walls, &things);
        let mut sky = Environment::constant("sky", Rgb::new(4.0, 5.0, 6.0));
        if has_picture {
            let texel = |k: u32| if k == 32 * 10 + 9 { [900.0, 800.0, 700.0, 1.0] } else { [1.0, 1.0, 1.5, 1.0] };
            let texels = Texels::Float((0..32 * 16).map(texel).collect());
            scene.textures.push(Texture { name: "sky".into(), width: 32, height: 16, texels });
            sky.texture = Some(0);
        }
        scene.environment = Some(sky);
        scene
    };
    assert_follows("constant sky", &scene([1.0, 0.0, 1.0], false), &scene([2.4, 0.0, 2.9], false), &settings());
    assert_follows("sky", &scene([1.0, 0.0, 1.0], true), &scene([2.4, 0.0, 2.9], true), &settings());
}

#[test]
fn things_that_do_not_cast_and_those_that_shine_follow() {
    let walls = room([4.0, 3.0, 5.0]);
    let scene = |at: [f32; 3], casts: bool, shines: [f32; 3]| {
        let things = [
            cube("ghost", [1.6, 0.0, 2.0], [0.8, 1.0, 0.8]),
            cube("table", at, [0.7, 0.5, 0.6]),
            sheet("panel", shines, [0.6, 0.0, 0.0], [0.0, 0.0, 0.6]),
        ];
        let mut scene = furnished(&walls, &things);
        let (ghost, panel) = (index(&scene, "ghost"), index(&scene, "panel"));
        scene.surfaces[ghost].role.casts = casts;
        scene.materials[panel].emission = Rgb::splat(30.0);
        scene.lights.push(lamp([3.2, 2.4, 4.0], 20.0));
        scene
    };
    let (at, shines) = ([0.4, 0.0, 0.5], [1.0, 2.6, 1.0]);
    assert_follows("ghost", &scene(at, true, shines), &scene(at, false, shines), &settings());
    assert_follows("solid", &scene(at, false, shines), &scene(at, true, shines), &settings());
    assert_follows("past a ghost", &scene(at, false, shines), &scene([2.8, 0.0, 1.0], false, shines), &settings());
}
