//! Layers beside the whole: what they add up to, closed forms of what surrounds a texel, and lights that are baked in part.

mod support;

use glam::{Vec2, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::illuminate::Illuminated;
use lumel::post::denoise::Denoise;
use lumel::post::seam::SeamMode;
use lumel::post::{Channels, LayerKind, Quantity};
use lumel::scene::{BakeMode, Contribution, Environment, Light, LightShape, Scene};
use lumel::settings::{Gather, Method, Normals, Quality, Settings};
use std::f32::consts::PI;
use support::measure::{Case, room_with_a_block, sunroom};
use support::{Quad, atlas, bake, draft, room, scene};

fn asking(layers: &[LayerKind]) -> Settings {
    // As light is found: what closes seams and takes noise out comes after.
    let (denoise, seams) = (Denoise::Off, SeamMode::Off);
    Settings { layers: layers.to_vec(), float: true, denoise, seams, ..draft() }
}

/// The texels of layer `name` by page.
fn pages<'a>(baked: &'a Illuminated, name: &str) -> &'a [Vec<Rgb>] {
    let known: Vec<&str> = baked.lightmap.layers.iter().map(|l| l.name.as_str()).collect();
    let layer = baked.lightmap.layers.iter().find(|l| l.name == name);
    &layer.unwrap_or_else(|| panic!("{name} is not among {known:?}")).pages
}

/// The texel of patch `i` in layer `name`.
fn value(baked: &Illuminated, name: &str, i: usize) -> Rgb {
    let [page, texel] = baked.patches.texel(i);
    pages(baked, name)[page as usize][texel as usize]
}

fn whole(baked: &Illuminated, i: usize) -> Rgb {
    let [page, texel] = baked.patches.texel(i);
    baked.lightmap.pages[page as usize].rgb[texel as usize]
}

fn of_surface(baked: &Illuminated, surface: u32) -> impl Iterator<Item = usize> {
    (0..baked.patches.len()).filter(move |&i| baked.patches.surface(i) == surface)
}

fn group(name: &str) -> Contribution {
    Contribution { group: Some(name.into()), ..Contribution::default() }
}

fn mode(mode: BakeMode) -> Contribution {
    Contribution { mode: Some(mode), ..Contribution::default() }
}

fn point(position: [f32; 3], intensity: f32) -> LightShape {
    LightShape::Point { position: position.into(), intensity: Rgb::splat(intensity), range: None }
}

/// A room with a glowing panel in group `panel`, and a point light in none.
fn room_with_two_lights() -> Case {
    let mut case = room_with_a_block(12).light(point([0.4, 2.4, 0.4], 3.0));
    case.scene.materials[6].contribution = group("panel");
    case
}

/// A room with sun in group `sun`, and sky in group `sky`.
fn grouped_sunroom() -> Case {
    let mut case = sunroom(12);
    case.scene.lights[0].contribution = group("sun");
    case.scene.environment.as_mut().unwrap().contribution = group("sky");
    case
}

#[test]
fn groups_add_up_to_the_page() {
    for (case, names) in
        [(room_with_two_lights(), ["group.panel", "group.ungrouped"]), (grouped_sunroom(), ["group.sky", "group.sun"])]
    {
        for quantity in [Quantity::Outgoing, Quantity::Radiosity] {
            let baked = case.bake(&Settings { quantity, ..asking(&[LayerKind::LightGroups]) });
            let found: Vec<&str> = baked.lightmap.layers.iter().map(|l| l.name.as_str()).collect();
            assert_eq!(found, names);
            for (t, whole) in baked.lightmap.pages[0].rgb.iter().enumerate() {
                let sum: Rgb = names.iter().map(|name| pages(&baked, name)[0][t]).sum();
                let tolerance = 1e-4 * whole.max_element().max(0.1);
                assert!((sum - *whole).abs().max_element() < tolerance, "{sum} against {whole} at {t}");
            }
            // The balance closes as well as it does without them.
            let plain = case.bake(&Settings { quantity, ..asking(&[]) }).energy.imbalance;
            assert!((baked.energy.imbalance - plain).abs() < 0.01, "{} against {plain}", baked.energy.imbalance);
        }
    }
}

/// Mean and root mean square of the difference of `a` to `b`, over the mean of `b`.
fn apart(baked: &Illuminated, a: impl Fn(usize) -> Rgb, b: impl Fn(usize) -> Rgb) -> [f32; 2] {
    let open: Vec<usize> = (0..baked.patches.len()).filter(|&i| !baked.exposure.is_buried(i)).collect();
    let (mut mean, mut sum, mut square) = (0.0, 0.0, 0.0);
    for &i in &open {
        let d = luminance(a(i)) - luminance(b(i));
        (mean, sum, square) = (mean + luminance(b(i)), sum + d, square + d * d);
    }
    let n = open.len() as f32;
    [sum / mean, (square / n).sqrt() / (mean / n)]
}

#[test]
fn a_group_is_what_its_lights_alone_cause() {
    let without = |case: Case, change: &dyn Fn(&mut Scene)| {
        let mut case = case;
        change(&mut case.scene);
        case
    };
    let dark_panel = |scene: &mut Scene| scene.materials[6].emission = Rgb::ZERO;
    let no_lights = |scene: &mut Scene| scene.lights.clear();
    let no_sky = |scene: &mut Scene| scene.environment = None;
    let settings = Settings { error: Some(0.5), ..asking(&[LayerKind::LightGroups]) };
    let rooms = room_with_two_lights().bake(&settings);
    let sunny = grouped_sunroom().bake(&settings);
    for (all, name, case) in [
        (&rooms, "group.panel", without(room_with_two_lights(), &no_lights)),
        (&rooms, "group.ungrouped", without(room_with_two_lights(), &dark_panel)),
        (&sunny, "group.sun", without(grouped_sunroom(), &no_sky)),
        (&sunny, "group.sky", without(grouped_sunroom(), &no_lights)),
    ] {
        let alone = case.bake(&Settings { layers: Vec::new(), ..settings.clone() });
        // What lies right under a panel is open where the panel shines, and a crevice where it is dark.
        let both = |i: usize, value: Rgb| if alone.exposure.is_buried(i) { Rgb::ZERO } else { value };
        let [mean, rms] = apart(all, |i| both(i, value(all, name, i)), |i| both(i, whole(&alone, i)));
        assert!(mean.abs() < 0.01 && rms < 0.06, "{name}: mean {mean}, rms {rms}");
    }
}

#[test]
fn groups_are_the_same_bits_for_any_number_of_threads() {
    let case = grouped_sunroom();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let layers = [LayerKind::LightGroups, LayerKind::Bounces, LayerKind::Ao, LayerKind::ShadowMasks];
        let baked = pool.install(|| case.bake(&asking(&layers)));
        let bits = |page: &Vec<Rgb>| page.iter().map(|c| c.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        baked.lightmap.layers.iter().flat_map(|l| l.pages.iter().map(bits)).collect::<Vec<_>>()
    };
    assert!(run(1) == run(3));
}

#[test]
fn bounces_by_links_add_up_and_are_told_apart() {
    let case = room_with_a_block(12);
    let settings = asking(&[LayerKind::Bounces, LayerKind::Direct, LayerKind::Indirect]);
    let baked = case.bake(&settings);
    assert!(baked.exchanged.is_some(), "not by blocks");
    let is_bounce = |name: &str| name.starts_with("bounce") || name == "rest";
    let names: Vec<&str> = baked.lightmap.layers.iter().map(|l| l.name.as_str()).filter(|n| is_bounce(n)).collect();
    assert!(names.len() > 4, "{names:?}");
    for (t, whole) in baked.lightmap.pages[0].rgb.iter().enumerate() {
        let sum: Rgb = names.iter().map(|name| pages(&baked, name)[0][t]).sum();
        assert!((sum - *whole).abs().max_element() < 1e-4 * whole.max_element().max(0.1), "{sum} against {whole}");
    }
    assert_eq!(pages(&baked, "bounce0"), pages(&baked, "direct"));
    // Light up to each bounce, against bakes that end there.
    let mut up_to = vec![Rgb::ZERO; baked.patches.len()];
    for (bounces, name) in ["bounce0", "bounce1", "bounce2"].into_iter().enumerate() {
        (0..up_to.len()).for_each(|i| up_to[i] += value(&baked, name, i));
        let limited = Settings { max_bounces: Some(bounces as u32), layers: Vec::new(), ..settings.clone() };
        let ended = case.bake(&limited);
        let [mean, rms] = apart(&baked, |i| up_to[i], |i| whole(&ended, i));
        assert!(mean.abs() < 0.01 && rms < 0.06, "{bounces}: mean {mean}, rms {rms}");
    }
    // As many as there may be, and no rest.
    let ended = case.bake(&Settings { max_bounces: Some(2), ..settings });
    let last: Vec<&str> =
        ended.lightmap.layers.iter().map(|l| l.name.as_str()).filter(|name| is_bounce(name)).collect();
    assert_eq!(last.len(), 3, "{last:?}");
}

/// A floor of 1 m along +x from a wall of `height` and nearly endless length.
fn floor_beside_a_wall(height: f32, length: f32, normals: Normals, layers: &[LayerKind], distance: f32) -> Illuminated {
    let floor = Quad::new([0., 0., -0.5], [0., 0., 1.], [1., 0., 0.]);
    let wall = Quad::new([0., 0., -length], [0., height, 0.], [0., 0., 2. * length]);
    let mut scene = scene(&[floor, wall]);
    scene.environment = Some(Environment::constant("sky", Rgb::ONE));
    let settings = Settings { normals, quality: Quality::High, ao_distance: Some(distance), ..asking(layers) };
    bake(&scene, &atlas(2, 16), &settings)
}

#[test]
fn ambient_occlusion_beside_a_wall_is_the_closed_form() {
    let height = 0.8f32;
    let layers = [LayerKind::Ao, LayerKind::SkyVisibility];
    let baked = floor_beside_a_wall(height, 60.0, Normals::Geometric, &layers, 0.0);
    let ao = baked.lightmap.layers.iter().find(|l| l.name == "ao").unwrap();
    assert_eq!((ao.channels, ao.unit), (Channels::Y, "1"));
    let mut checked = 0;
    for i in of_surface(&baked, 0).filter(|&i| baked.patches.position[i].z.abs() < 0.4) {
        let x = baked.patches.position[i].x;
        // The form factor of a point beside an endless strip at right angles.
        let expected = 1.0 - 0.5 * (1.0 - x / x.hypot(height));
        let found = value(&baked, "ao", i).x;
        assert!((found - expected).abs() < 0.015, "{found} at {x}, not {expected}");
        // Without a bound on the distance nothing differs from the share of the sky.
        assert_eq!(found, value(&baked, "sky-visibility", i).x);
        checked += 1;
    }
    assert!(checked > 100);
    // Beside an endless wall half of the hemisphere is open; beyond the distance asked for all of it.
    let half = floor_beside_a_wall(500.0, 500.0, Normals::Geometric, &[LayerKind::Ao], 0.0);
    for i in of_surface(&half, 0) {
        assert!((value(&half, "ao", i).x - 0.5).abs() < 0.015);
    }
    let near = floor_beside_a_wall(500.0, 500.0, Normals::Geometric, &[LayerKind::Ao], 0.3);
    let (mut beyond, mut within) = (0, 0);
    for i in of_surface(&near, 0) {
        let (x, found) = (near.patches.position[i].x, value(&near, "ao", i).x);
        if x > 0.35 {
            assert_eq!(found, 1.0, "at {x}");
            beyond += 1;
        } else if x < 0.1 {
            assert!(found < 0.75 && found > 0.5, "{found} at {x}");
            within += 1;
        }
    }
    assert!(beyond > 100 && within > 10);
}

#[test]
fn an_open_plane_is_not_occluded_and_looks_up() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    scene.lights.push(Light::new("lamp", point([0., 1., 0.], 1.0)));
    let layers = [LayerKind::Ao, LayerKind::BentNormal, LayerKind::SkyVisibility];
    let baked = bake(&scene, &atlas(1, 8), &asking(&layers));
    for i in 0..baked.patches.len() {
        assert_eq!((value(&baked, "ao", i).x, value(&baked, "sky-visibility", i).x), (1.0, 1.0));
        assert!(value(&baked, "bent-normal", i).angle_between(Vec3::Y) < 0.06);
    }
}

#[test]
fn bent_normals_beside_a_wall_are_the_closed_form() {
    let baked = floor_beside_a_wall(500.0, 500.0, Normals::Geometric, &[LayerKind::BentNormal], 0.0);
    // Over half of the hemisphere, int w cos dw is 2 / 3 away from the wall and pi / 3 up.
    let expected = Vec3::new(2.0 / 3.0, PI / 3.0, 0.0).normalize();
    for i in of_surface(&baked, 0) {
        let found = value(&baked, "bent-normal", i);
        assert!((found.length() - 1.0).abs() < 1e-5);
        assert!(found.angle_between(expected) < 2f32.to_radians(), "{found}");
    }
    // Filled gutters hold directions, too.
    let unit = |v: &&Rgb| (v.length() - 1.0).abs() < 1e-4;
    let page = &pages(&baked, "bent-normal")[0];
    assert!(page.iter().filter(unit).count() > baked.patches.len() + 64);
    assert!(page.iter().all(|v| *v == Rgb::ZERO || unit(&v)));
}

/// The form factor from a point to a rectangle `height` above it, in the opposite plane, that spans `low` to `high` beside it.
fn to_rectangle(low: Vec2, high: Vec2, height: f32) -> f32 {
    let corner = |x: f32, y: f32| {
        let (x, y) = (x / height, y / height);
        let part = |x: f32, y: f32| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
        (part(x, y) + part(y, x)) / (2.0 * PI)
    };
    corner(high.x, high.y) - corner(low.x, high.y) - corner(high.x, low.y) + corner(low.x, low.y)
}

#[test]
fn sky_visibility_in_a_box_is_the_form_factor_of_its_opening() {
    let mut quads = room([2., 2., 2.]);
    quads.remove(1);
    // The ceiling around an opening of 1 m squared.
    for [x, z, width, depth] in [[0., 0., 2., 0.5], [0., 1.5, 2., 0.5], [0., 0.5, 0.5, 1.], [1.5, 0.5, 0.5, 1.]] {
        quads.push(Quad::new([x, 2., z], [width, 0., 0.], [0., 0., depth]));
    }
    let mut scene = scene(&quads);
    scene.environment = Some(Environment::constant("sky", Rgb::ONE));
    let settings = Settings { quality: Quality::High, ..asking(&[LayerKind::SkyVisibility, LayerKind::Direct]) };
    let baked = bake(&scene, &atlas(quads.len(), 16), &settings);
    for i in of_surface(&baked, 0) {
        let at = Vec2::new(baked.patches.position[i].x, baked.patches.position[i].z);
        let expected = to_rectangle(Vec2::splat(0.5) - at, Vec2::splat(1.5) - at, 2.0);
        let found = value(&baked, "sky-visibility", i).x;
        assert!((found - expected).abs() < 0.015, "{found} at {at}, not {expected}");
    }
}

#[test]
fn shadow_masks_are_the_visible_share_of_direct_light() {
    let lamps = [
        point([0., 3., 0.], 10.0),
        LightShape::Rect {
            center: Vec3::new(0.3, 3., 0.),
            u: Vec3::X * 0.4,
            v: Vec3::NEG_Z * 0.4,
            radiance: Rgb::splat(20.0),
        },
    ];
    let floor = Quad::new([-2., 0., -2.], [0., 0., 4.], [4., 0., 0.]).albedo(0.0);
    let sheet = Quad::new([-0.5, 1., -0.5], [0., 0., 1.], [1., 0., 0.]).albedo(0.0).double_sided();
    for shape in lamps {
        let run = |quads: &[Quad]| {
            let mut scene = scene(quads);
            scene.lights.push(Light::new("/World/Lamp 1", shape.clone()));
            // Another one, dark but for itself: masks are by light.
            scene
                .lights
                .push(Light { contribution: mode(BakeMode::Dynamic), ..Light::new("live", point([0., 2., 0.], 1.0)) });
            scene.lights[0].contribution.shadow_mask = Some(true);
            let layers = [LayerKind::ShadowMasks, LayerKind::Direct];
            bake(&scene, &atlas(quads.len(), 32), &Settings { quality: Quality::High, ..asking(&layers) })
        };
        let (with, without) = (run(&[floor, sheet]), run(&[floor]));
        let name = "shadow.World_Lamp_1";
        let (mut dark, mut between, mut bright) = (0, 0, 0);
        let at = |baked: &Illuminated, p: Vec3| {
            of_surface(baked, 0).find(|&i| baked.patches.position[i].distance(p) < 1e-3).unwrap()
        };
        for i in of_surface(&with, 0) {
            let j = at(&without, with.patches.position[i]);
            let share = value(&with, "direct", i).x / value(&without, "direct", j).x;
            let mask = value(&with, name, i).x;
            assert!((mask - share).abs() < 0.02, "{mask} where {share} of the light arrives");
            assert_eq!(value(&without, name, j).x, 1.0);
            dark += i32::from(mask == 0.0);
            bright += i32::from(mask == 1.0);
            between += i32::from(mask > 0.0 && mask < 1.0);
        }
        assert!(dark > 20 && between > 10 && bright > 300, "{dark} {between} {bright}");
        assert!(with.lightmap.layers.iter().any(|l| l.name == "shadow.live"));
        let of = with.lightmap.layers.iter().find(|l| l.name == name).unwrap().of.as_deref();
        assert_eq!(of, Some("/World/Lamp 1"));
    }
}

#[test]
fn emission_is_what_surfaces_emit() {
    let case = room_with_a_block(8);
    for (quantity, factor) in [(Quantity::Outgoing, 1.0), (Quantity::Irradiance, PI), (Quantity::Radiosity, PI)] {
        let baked = case.bake(&Settings { quantity, ..asking(&[LayerKind::Emission]) });
        for i in (0..baked.patches.len()).filter(|&i| !baked.exposure.is_buried(i)) {
            let expected = if baked.patches.surface(i) == 6 { 10.0 * factor } else { 0.0 };
            let found = value(&baked, "emission", i).x;
            assert!((found - expected).abs() < 1e-3, "{quantity:?}: {found}, not {expected}, at {i}");
        }
    }
}

#[test]
fn of_indirect_lights_the_reflected_light_alone_is_shown() {
    for gather in [Gather::Blocks, Gather::Final] {
        let settings = Settings { gather, ..asking(&[LayerKind::Direct, LayerKind::Indirect]) };
        let mut case = room_with_two_lights();
        let all = case.bake(&settings);
        case.scene.lights[0].contribution = mode(BakeMode::Indirect);
        let part = case.bake(&settings);
        case.scene.lights.clear();
        let panel = case.bake(&settings);
        // Its direct light is gone, its reflected light is not.
        let [mean, rms] = apart(&part, |i| value(&part, "direct", i), |i| value(&panel, "direct", i));
        assert!(mean.abs() < 0.005 && rms < 0.03, "direct: mean {mean}, rms {rms}");
        let [mean, rms] = apart(&part, |i| value(&part, "indirect", i), |i| value(&all, "indirect", i));
        assert!(mean.abs() < 0.01 && rms < 0.06, "indirect: mean {mean}, rms {rms}");
        let light = |baked: &Illuminated| baked.gathered.irradiance.iter().map(|e| e.x).sum::<f32>();
        assert!(light(&panel) < 0.98 * light(&part) && light(&part) < 0.9 * light(&all));
        // What an engine adds is counted.
        assert!(part.energy.imbalance.abs() < 0.02, "{}", part.energy.imbalance);
        assert!((part.energy.inflow[0] / all.energy.inflow[0] - 1.0).abs() < 0.01);
    }
}

#[test]
fn of_an_indirect_sky_the_reflected_light_alone_is_shown() {
    let settings = asking(&[LayerKind::Direct, LayerKind::Indirect, LayerKind::LightGroups]);
    let mut case = grouped_sunroom();
    let all = case.bake(&settings);
    case.scene.environment.as_mut().unwrap().contribution.mode = Some(BakeMode::Indirect);
    let part = case.bake(&settings);
    let [mean, rms] = apart(&part, |i| value(&part, "indirect", i), |i| value(&all, "indirect", i));
    assert!(mean.abs() < 0.005 && rms < 0.02, "indirect: mean {mean}, rms {rms}");
    case.scene.environment = None;
    let sun = case.bake(&settings);
    let [mean, rms] = apart(&part, |i| value(&part, "direct", i), |i| value(&sun, "direct", i));
    assert!(mean.abs() < 0.005 && rms < 0.03, "direct: mean {mean}, rms {rms}");
    for i in 0..part.patches.len() {
        let sum = value(&part, "group.sun", i) + value(&part, "group.sky", i);
        assert!((sum - whole(&part, i)).abs().max_element() < 1e-4 * whole(&part, i).max_element().max(0.1));
    }
    assert!(part.energy.imbalance.abs() < 0.02, "{}", part.energy.imbalance);
}

#[test]
fn dynamic_lights_are_as_good_as_absent() {
    for method in [Method::Radiosity, Method::Path] {
        let settings = Settings { method, ..draft() };
        let mut case = room_with_two_lights();
        case.scene.lights[0].contribution = mode(BakeMode::Dynamic);
        let dynamic = case.bake(&settings);
        case.scene.lights.clear();
        assert!(dynamic.gathered.irradiance == case.bake(&settings).gathered.irradiance);
    }
    let mut case = sunroom(8);
    case.scene.environment.as_mut().unwrap().contribution = mode(BakeMode::Dynamic);
    let dynamic = case.bake(&draft());
    assert!(case.scene.has_light());
    case.scene.lights[0].contribution = mode(BakeMode::Dynamic);
    assert!(!case.scene.has_light());
    case.scene.lights[0].contribution = Contribution::default();
    case.scene.environment = None;
    assert!(dynamic.gathered.irradiance == case.bake(&draft()).gathered.irradiance);
}

#[test]
fn skies_are_one_source() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    let sky = |name: &str, contribution| Environment { contribution, ..Environment::constant(name, Rgb::ONE) };
    let others = vec![sky("b", group("night")), sky("c", mode(BakeMode::Dynamic))];
    scene.environment = Some(Environment { others, ..sky("a", mode(BakeMode::Indirect)) });
    assert_eq!(lumel::light::parts::unite_skies(&mut scene), ["b"]);
    let modes: Vec<BakeMode> =
        scene.environment.iter().flat_map(Environment::each).map(|sky| sky.contribution.mode()).collect();
    assert_eq!(modes, [BakeMode::Indirect, BakeMode::Indirect, BakeMode::Dynamic]);
    let parts = lumel::light::parts::parts(&scene, true);
    assert_eq!(parts.len(), 1);
    let baked = bake(&scene, &atlas(1, 8), &asking(&[LayerKind::LightGroups]));
    assert!(baked.lightmap.pages[0].rgb.iter().all(|c| *c == Rgb::ZERO));
    // Of two skies of 1 nit that take part, all that falls on 4 square metres.
    assert!((baked.energy.inflow[0] / f64::from(8.0 * PI) - 1.0).abs() < 1e-3, "{:?}", baked.energy.inflow);
}

#[test]
fn masks_are_made_of_the_lights_that_want_them() {
    let mut scene = scene(&[Quad::new([-1., 0., -1.], [0., 0., 2.], [2., 0., 0.])]);
    for k in 0..20 {
        scene.lights.push(Light::new(format!("lamp{k}"), point([0., 1., 0.], 1.0)));
    }
    let masked = |scene: &Scene| lumel::light::mask::masked_lights(scene);
    // All where nothing else is said, up to a limit.
    assert_eq!(masked(&scene), ((0..16).collect(), (16..20).collect()));
    scene.lights[0].contribution.shadow_mask = Some(false);
    assert_eq!(masked(&scene).0, (1..17).collect::<Vec<usize>>());
    scene.lights[3].contribution.mode = Some(BakeMode::Dynamic);
    scene.lights[5].contribution.mode = Some(BakeMode::Indirect);
    scene.lights[7].contribution.shadow_mask = Some(true);
    scene.lights[5].contribution.shadow_mask = Some(false);
    assert_eq!(masked(&scene), (vec![3, 7], Vec::new()));
    // Where every light is dynamic, pages are black and masks are not.
    scene.lights.iter_mut().for_each(|light| light.contribution.mode = Some(BakeMode::Dynamic));
    let baked = bake(&scene, &atlas(1, 8), &asking(&[LayerKind::ShadowMasks, LayerKind::LightGroups, LayerKind::Ao]));
    assert!(baked.lightmap.pages[0].rgb.iter().all(|c| *c == Rgb::ZERO) && baked.energy.imbalance == 0.0);
    assert_eq!(value(&baked, "shadow.lamp3", 0), Rgb::ONE);
}

#[test]
fn what_a_method_can_not_tell_apart_is_refused() {
    let complaint = |settings: Settings| settings.check().unwrap_err().to_string();
    let groups = asking(&[LayerKind::LightGroups]);
    assert!(groups.check().is_ok());
    assert!(complaint(Settings { gather: Gather::Final, ..groups.clone() }).contains("light groups"));
    assert!(complaint(Settings { method: Method::Path, ..groups.clone() }).contains("light groups"));
    assert!(complaint(Settings { ao_distance: Some(1.0), ..groups }).contains("ao-distance"));
    assert!(complaint(Settings { ao_distance: Some(-1.0), ..asking(&[LayerKind::Ao]) }).contains("allowed"));
    let mut case = room_with_two_lights();
    case.scene.lights[0].contribution = mode(BakeMode::Indirect);
    let settings = Settings { method: Method::Path, ..draft() };
    let failed = lumel::illuminate::illuminate(&case.scene, &case.atlas, &settings, &lumel::progress::Silent);
    assert!(failed.err().unwrap().to_string().contains("paths"));
}
