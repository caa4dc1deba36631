//! What bakes remember: the same to the bit where nothing has changed, as good as a bake anew where something has.

mod files;
mod support;

use files::Folder;
use glam::{Affine3A, Vec3};
use lumel::color::Rgb;
use lumel::illuminate::kept::add_base;
use lumel::illuminate::state::State;
use lumel::illuminate::{Illuminated, illuminate, illuminate_with};
use lumel::progress::Silent;
use lumel::scene::{Light, LightShape, Scene};
use lumel::settings::{Normals, Settings};
use lumel::store::{Key, Store};
use lumel::unwrap::Atlas;
use lumel::work::Work;
use std::time::Duration;
use support::measure::differences;
use support::{Quad, atlas, room, scene};

/// A room with a table, whose place is `at`, a lamp and a glowing panel. The table's quads are the last five.
fn furnished(at: [f32; 2]) -> (Scene, Atlas) {
    let mut quads = room([4.0, 3.0, 5.0]);
    quads.push(Quad::new([0.5, 2.9, 0.5], [1.0, 0., 0.], [0., 0., 1.0]).emission(20.0));
    let legs = quads.len();
    let (low, high) = ([0.0, 0.0, 0.0], [0.8, 0.6, 0.7]);
    let [x, y, z] = high;
    quads.push(Quad::new([low[0], y, low[2]], [0., 0., z], [x, 0., 0.]).albedo(0.7));
    quads.push(Quad::new(low, [0., 0., z], [0., y, 0.]).albedo(0.7));
    quads.push(Quad::new([x, 0., 0.], [0., y, 0.], [0., 0., z]).albedo(0.7));
    quads.push(Quad::new(low, [0., y, 0.], [x, 0., 0.]).albedo(0.7));
    quads.push(Quad::new([0., 0., z], [x, 0., 0.], [0., y, 0.]).albedo(0.7));
    let mut scene = scene(&quads);
    for surface in &mut scene.surfaces[legs..] {
        surface.world_from_local = Affine3A::from_translation(Vec3::new(at[0], 0.0, at[1]));
    }
    let lamp = LightShape::Point { position: Vec3::new(3.0, 2.5, 4.0), intensity: Rgb::splat(30.0), range: None };
    scene.lights.push(Light::new("lamp", lamp));
    (scene, atlas(quads.len(), 40))
}

fn settings() -> Settings {
    Settings { normals: Normals::Geometric, error: Some(1.0), ..Settings::default() }
}

fn base(scene: &Scene, atlas: &Atlas) -> Key {
    Key::of("base", |hasher| add_base(hasher, scene, atlas))
}

fn state(scene: &Scene, atlas: &Atlas, lit: &Illuminated) -> State {
    State::new(scene, atlas, base(scene, atlas), &lit.patches.runs(scene.surfaces.len()))
}

fn remembering(scene: &Scene, atlas: &Atlas, store: &Store) -> Illuminated {
    let work = Work::new(store, base(scene, atlas), None, Duration::ZERO);
    illuminate_with(scene, atlas, &settings(), &work, &Silent).unwrap()
}

fn bits(lit: &Illuminated) -> Vec<[u32; 3]> {
    lit.lightmap.pages.iter().flat_map(|page| &page.rgb).map(|c| c.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_bake_again_is_the_same_to_the_bit_and_traces_next_to_nothing() {
    let folder = Folder::new("again");
    let store = Store::open(&folder.0).unwrap();
    let (scene, atlas) = furnished([1.0, 1.0]);
    let fresh = illuminate(&scene, &atlas, &settings(), &Silent).unwrap();
    let first = remembering(&scene, &atlas, &store);
    let again = remembering(&scene, &atlas, &store);
    assert_eq!(bits(&fresh), bits(&first), "with a cache and without");
    assert_eq!(bits(&first), bits(&again));
    let entries = store.survey().unwrap().items;
    let count = |kind: &str| entries.iter().filter(|item| item.kind.starts_with(kind)).count();
    assert_eq!([count("links"), count("direct"), count("openings")], [1, 2, 1], "a lamp and a panel");
    assert!(count("look") > 0, "parts of the work were put down");
}

#[test]
fn other_strengths_and_albedos_take_what_is_remembered() {
    let folder = Folder::new("strengths");
    let store = Store::open(&folder.0).unwrap();
    let (mut scene, atlas) = furnished([1.0, 1.0]);
    remembering(&scene, &atlas, &store);
    let before = store.survey().unwrap().items.len();
    scene.lights[0].shape =
        LightShape::Point { position: Vec3::new(3.0, 2.5, 4.0), intensity: Rgb::new(20.0, 45.0, 10.0), range: None };
    scene.materials[0].albedo = Rgb::new(0.2, 0.6, 0.3);
    let relit = remembering(&scene, &atlas, &store);
    assert_eq!(store.survey().unwrap().items.len(), before, "nothing was looked for anew");
    let full = illuminate(&scene, &atlas, &settings(), &Silent).unwrap();
    let (rms, bias) = differences(&relit, &full);
    println!("rms {:.3} %, bias {:+.3} %", 100.0 * rms, 100.0 * bias);
    assert!(rms < 0.015 && bias.abs() < 0.003, "{rms} {bias}");
    assert!((relit.energy.imbalance - full.energy.imbalance).abs() < 0.005);
}

#[test]
fn a_moved_object_changes_what_it_can_touch() {
    let folder = Folder::new("moved");
    let store = Store::open(&folder.0).unwrap();
    let (scene, atlas) = furnished([1.0, 1.0]);
    let first = remembering(&scene, &atlas, &store);
    let (moved, _) = furnished([2.6, 3.2]);
    let now = State::new(&moved, &atlas, base(&moved, &atlas), &[]);
    let (key, change) = now.since(&state(&scene, &atlas, &first)).expect("the same surfaces");
    assert_eq!(change.surfaces.iter().filter(|changed| **changed).count(), 5);
    let work = Work::new(&store, base(&moved, &atlas), None, Duration::MAX).after(key, change);
    let again = illuminate_with(&moved, &atlas, &settings(), &work, &Silent).unwrap();
    let full = illuminate(&moved, &atlas, &settings(), &Silent).unwrap();
    let (rms, bias) = differences(&again, &full);
    let rays = |lit: &Illuminated| lit.direct.rays + lit.gathered.rays;
    println!("rms {:.3} %, bias {:+.3} %, {} rays of {}", 100.0 * rms, 100.0 * bias, rays(&again), rays(&full));
    assert!(rms < 0.02 && bias.abs() < 0.003, "{rms} {bias}");
    assert!((again.energy.imbalance - full.energy.imbalance).abs() < 0.005);
    // What stood there before must not be seen any more: without the change, much is off.
    let stale = illuminate(&scene, &atlas, &settings(), &Silent).unwrap();
    assert!(differences(&stale, &full).0 > 0.05);
}

/// Quads side by side on one page, whose edges lie in the middle of texels that they share.
fn crowded(count: usize, texels: u32) -> Atlas {
    let mut all = atlas(count, texels);
    let columns = (count as f64).sqrt().ceil() as u32;
    let side = texels as f32 + 0.5;
    let size = (columns as f32 * side).ceil() as u32 + 1;
    for (i, uvs) in all.meshes.iter_mut().enumerate() {
        let (x, y) = ((i as u32 % columns) as f32 * side, (i as u32 / columns) as f32 * side);
        let at = |dx: f32, dy: f32| glam::Vec2::new(x + dx, y + dy) / size as f32;
        let [a, b, c, d] = [at(0.0, 0.0), at(side, 0.0), at(side, side), at(0.0, side)];
        uvs.corners = vec![[a, b, c], [a, c, d]];
    }
    Atlas { pages: vec![[size, size]], ..all }
}

#[test]
fn what_shares_texels_with_something_that_moves_goes_on_sending_light() {
    let folder = Folder::new("shared");
    let store = Store::open(&folder.0).unwrap();
    let (scene, _) = furnished([1.0, 1.0]);
    let atlas = crowded(scene.surfaces.len(), 16);
    let first = remembering(&scene, &atlas, &store);
    let mut known = state(&scene, &atlas, &first);
    let mut last = None;
    for at in [[2.6, 3.2], [1.2, 3.0], [2.2, 1.0], [0.6, 2.0], [2.8, 2.2]] {
        let moved = furnished(at).0;
        let (key, change) = State::new(&moved, &atlas, base(&moved, &atlas), &[]).since(&known).unwrap();
        let work = Work::new(&store, base(&moved, &atlas), None, Duration::MAX).after(key, change);
        let lit = illuminate_with(&moved, &atlas, &settings(), &work, &Silent).unwrap();
        known = state(&moved, &atlas, &lit);
        last = Some((moved, lit));
    }
    let (moved, again) = last.unwrap();
    let full = illuminate(&moved, &atlas, &settings(), &Silent).unwrap();
    let (rms, bias) = differences(&again, &full);
    println!("rms {:.3} %, bias {:+.3} %", 100.0 * rms, 100.0 * bias);
    assert!(rms < 0.025 && bias.abs() < 0.005, "{rms} {bias}");
}

#[test]
fn many_moves_make_no_light_and_heap_up_no_links() {
    let folder = Folder::new("moves");
    let store = Store::open(&folder.0).unwrap();
    let (mut scene, atlas) = furnished([1.0, 1.0]);
    let first = remembering(&scene, &atlas, &store);
    let mut known = state(&scene, &atlas, &first);
    let links = |lit: &Illuminated| lit.exchanged.map_or(0, |exchanged| exchanged.links);
    let mut last = None;
    for step in 1..=12 {
        let turn = 2.4 * step as f32;
        scene = furnished([1.6 + 1.2 * turn.cos(), 2.2 + 1.6 * turn.sin()]).0;
        let (key, change) = State::new(&scene, &atlas, base(&scene, &atlas), &[]).since(&known).unwrap();
        let work = Work::new(&store, base(&scene, &atlas), None, Duration::MAX).after(key, change);
        let lit = illuminate_with(&scene, &atlas, &settings(), &work, &Silent).unwrap();
        known = state(&scene, &atlas, &lit);
        last = Some(lit);
    }
    let (last, full) = (last.unwrap(), illuminate(&scene, &atlas, &settings(), &Silent).unwrap());
    let (rms, bias) = differences(&last, &full);
    println!("rms {:.3} %, bias {:+.3} %, {} links of {}", 100.0 * rms, 100.0 * bias, links(&last), links(&full));
    assert!(rms < 0.025 && bias.abs() < 0.003, "{rms} {bias}");
    assert!(links(&last) < 5 * links(&full) / 2, "{} links of {}", links(&last), links(&full));
}
