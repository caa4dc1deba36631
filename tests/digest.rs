//! Hashes of scenes: each kind of change is in exactly the keys of what depends on it.

mod files;

use files::shared;
use glam::{Affine3A, Mat3, Vec2, Vec3, Vec4};
use lumel::color::Rgb;
use lumel::digest::{atlas, geometry, mesh, shining, surface, surfaces};
use lumel::light::Shining;
use lumel::scene::projector::Throw;
use lumel::scene::web::WebKind;
use lumel::scene::{
    Alpha, BakeMode, Camera, Environment, Light, LightShape, Linked, Material, Medium, MediumShape, Mesh,
    PhotometricWeb, Picture, Profile, Projector, Scene, Shaping, Surface, SurfaceOrigin, Texels, Texture, TextureSlot,
    TriangleOrigin, UvSet, Wrap,
};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

fn quad(materials: [u32; 2]) -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
    let coords = positions.iter().map(|p| p.truncate()).collect();
    Mesh {
        name: "quad".into(),
        normals: vec![Vec3::Z; 4],
        uvs: vec![UvSet { name: "uv".into(), coords }],
        colors: vec![Vec4::ONE; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_material: materials.to_vec(),
        origin: vec![TriangleOrigin::default(); 2],
        positions,
    }
}

fn texture(texels: Texels) -> Texture {
    Texture { name: "picture".into(), width: 2, height: 2, texels }
}

fn place(mesh: usize, x: f32) -> Surface {
    Surface {
        name: format!("surface at {x}"),
        mesh,
        world_from_local: Affine3A::from_translation(Vec3::X * x),
        origin: SurfaceOrigin::None,
        role: Default::default(),
    }
}

const SLOT: &str = "uv";
const LAMP: usize = 0;
const PANEL: usize = 1;
const PROJECTOR: usize = 2;
const WINDOW: usize = 3;
const WINDOW_OF_TWO: usize = 4;

fn materials() -> Vec<Material> {
    let slot = |t| Some(TextureSlot::new(t, SLOT));
    let plain = Material { albedo_texture: slot(0), ..Material::default() };
    let leaf = Material { alpha: Alpha::Mask { cutoff: 0.5, opacity: 1.0 }, ..plain.clone() };
    let glass = Material { transmission: Rgb::splat(0.5), transmission_texture: slot(1), ..Material::default() };
    let glow = Material { emission: Rgb::ONE, emission_texture: slot(2), double_sided: true, ..Material::default() };
    vec![plain, leaf, glass, glow]
}

fn lights() -> Vec<Light> {
    let sky = || Environment { texture: Some(3), ..Environment::constant("own sky", Rgb::ONE) };
    let (center, u, v) = (Vec3::Y, Vec3::X, Vec3::Z);
    let web = PhotometricWeb {
        name: "web".into(),
        kind: WebKind::C,
        vertical: vec![0.0, 1.0],
        horizontal: vec![0.0],
        candela: vec![5.0, 6.0],
        rated_lumens: None,
        tilt: Vec::new(),
    };
    let throw = Throw { fov: 1.0, aspect: 1.0, target: None };
    let thrown = Projector::new(4, Vec3::Y, Mat3::IDENTITY, &throw).unwrap();
    let two = Environment { others: vec![Environment::constant("other", Rgb::ONE)], ..sky() };
    let of = |shape| Light::new("light", shape);
    let shaping = Shaping { axis: Vec3::NEG_Y, cone_angle: 1.0, cone_softness: 0.5, focus: 0.0, focus_tint: Rgb::ONE };
    let panel = of(LightShape::Rect { center, u, v, radiance: Rgb::ONE });
    let spot = LightShape::Spot {
        position: Vec3::Y,
        direction: Vec3::NEG_Z,
        intensity: Rgb::ONE,
        inner: 0.1,
        outer: 0.5,
        range: None,
    };
    vec![
        of(LightShape::Point { position: Vec3::Y, intensity: Rgb::ONE, range: None }),
        Light {
            profile: Some(Profile { web: Arc::new(web), scale: 1.0, angle_scale: 0.0, web_from_light: Mat3::IDENTITY }),
            shaping: Some(shaping),
            ..panel
        },
        Light { picture: Some(Picture::Thrown(thrown)), ..of(spot) },
        of(LightShape::Portal { center, u, v, sky: Arc::new(sky()) }),
        of(LightShape::Portal { center, u, v, sky: Arc::new(two) }),
    ]
}

fn scene() -> Scene {
    let bytes: Vec<[u8; 4]> = (0..4).map(|k| [k, 10 + k, 20 + k, 200 + k]).collect();
    let floats = vec![[1.0, 2.0, 3.0, 1.0]; 4];
    let sky = Environment { texture: Some(3), ..Environment::constant("sky", Rgb::ONE) };
    Scene {
        meshes: vec![quad([0, 0]), quad([1, 2]), quad([3, 3])],
        materials: materials(),
        textures: vec![
            texture(Texels::Srgb8(bytes.clone())),
            texture(Texels::Linear8(bytes.clone())),
            texture(Texels::Srgb8(bytes)),
            texture(Texels::Float(floats.clone())),
            texture(Texels::Float(floats)),
        ],
        surfaces: vec![place(0, 0.0), place(0, 1.0), place(1, 2.0), place(2, 3.0)],
        lights: lights(),
        environment: Some(Environment { others: vec![Environment::constant("haze", Rgb::ONE)], ..sky }),
        ..Scene::default()
    }
}

/// All keys, and all strengths, by name.
fn keys(scene: &Scene) -> BTreeMap<String, String> {
    let mut keys = BTreeMap::from([("geometry".to_string(), geometry(scene).to_string())]);
    let all = surfaces(scene);
    for (s, &key) in all.iter().enumerate() {
        assert_eq!(surface(scene, s), key, "alone and among all");
        keys.insert(format!("surface {s}"), key.to_string());
    }
    for (m, content) in scene.meshes.iter().enumerate() {
        keys.insert(format!("mesh {m}"), mesh(content).to_string());
    }
    let lights = (0..scene.lights.len()).map(|l| (format!("light {l}"), Shining::Light(l)));
    let skies = (0..2).map(|k| (format!("sky {k}"), Shining::Sky(k)));
    for (name, what) in lights.chain(skies).chain([("glow".to_string(), Shining::Material(3))]) {
        let (key, strength) = shining(scene, what);
        keys.insert(format!("strength of {name}"), format!("{strength:?}"));
        keys.insert(name, key.to_string());
    }
    keys
}

/// Checks that `edit` changes the keys `expected`, and no others.
#[track_caller]
fn assert_changes(expected: &[&str], edit: impl Fn(&mut Scene)) {
    let mut edited = scene();
    edit(&mut edited);
    let (before, after) = (keys(&scene()), keys(&edited));
    assert_eq!(before.len(), after.len());
    let mut expected: Vec<&str> = expected.to_vec();
    expected.sort_unstable();
    let changed: Vec<&str> =
        before.iter().filter(|(name, key)| after[*name] != **key).map(|(n, _)| n.as_str()).collect();
    assert_eq!(changed, expected);
}

fn texel(scene: &mut Scene, texture: usize, channel: usize) {
    match &mut scene.textures[texture].texels {
        Texels::Srgb8(t) | Texels::Linear8(t) => t[3][channel] += 1,
        Texels::Float(t) => t[3][channel] += 1.0,
    }
}

fn sky(scene: &mut Scene) -> &mut Environment {
    scene.environment.as_mut().unwrap()
}

fn portal_sky(light: &mut Light) -> &mut Environment {
    let LightShape::Portal { sky, .. } = &mut light.shape else { panic!("no portal") };
    Arc::get_mut(sky).unwrap()
}

#[test]
fn names_and_origins_change_nothing() {
    assert_changes(&[], |_| ());
    assert_changes(&[], |scene| {
        scene.meshes.iter_mut().for_each(|m| {
            m.name += "x";
            m.origin[1].face = 7;
        });
        scene.materials.iter_mut().for_each(|m| m.name += "x");
        scene.textures.iter_mut().for_each(|t| t.name += "x");
        scene.surfaces.iter_mut().for_each(|s| {
            s.name += "x";
            s.origin = SurfaceOrigin::GltfNode(3);
        });
        scene.lights.iter_mut().for_each(|l| {
            l.name += "x";
            l.gltf_node = Some(4);
            l.contribution.mode = Some(BakeMode::Indirect);
        });
        Arc::get_mut(&mut scene.lights[PANEL].profile.as_mut().unwrap().web).unwrap().name += "x";
        sky(scene).name += "x";
        sky(scene).contribution.group = Some("day".into());
        portal_sky(&mut scene.lights[WINDOW]).name += "x";
        scene.materials[3].contribution.mode = Some(BakeMode::Indirect);
    });
    assert_changes(&[], |scene| scene.media.push(Medium::new("fog", MediumShape::Scene)));
    assert_changes(&[], |scene| {
        scene.cameras.extend(Camera::look_at(Vec3::ONE, Vec3::ZERO, 1.0));
        scene.textures.push(texture(Texels::Float(vec![[0.0; 4]; 4])));
    });
}

#[test]
fn shapes_change_what_rays_meet() {
    let of_0 = ["geometry", "mesh 0", "surface 0", "surface 1"];
    assert_changes(&of_0, |scene| scene.meshes[0].positions[2].z += 0.25);
    assert_changes(&of_0, |scene| scene.meshes[0].normals[2] = Vec3::Y);
    assert_changes(&of_0, |scene| scene.meshes[0].normals.clear());
    assert_changes(&of_0, |scene| scene.meshes[0].uvs[0].coords[1].y = 0.5);
    assert_changes(&of_0, |scene| scene.meshes[0].uvs[0].name += "1");
    assert_changes(&of_0, |scene| scene.meshes[0].triangles[0].rotate_left(1));
    assert_changes(&["geometry", "mesh 1", "surface 2"], |scene| scene.meshes[1].triangle_material.swap(0, 1));
    assert_changes(&["geometry", "surface 1"], |scene| scene.surfaces[1].world_from_local.translation.y += 1.0);
    assert_changes(&["geometry", "surface 0"], |scene| scene.surfaces[0].role.casts = false);
    assert_changes(&["geometry", "surface 0"], |scene| scene.surfaces[0].role.density = Some(3.0));
    assert_changes(&["geometry", "surface 0", "surface 1"], |scene| scene.surfaces.swap(0, 1));
    // What shines from there moves with it.
    assert_changes(&["geometry", "surface 3", "glow"], |scene| scene.surfaces[3].world_from_local.translation.y += 1.0);
    assert_changes(&["geometry", "surface 3", "glow"], |scene| scene.surfaces[3].role.casts = false);
}

#[test]
fn looks_change_nothing_but_where_light_passes() {
    assert_changes(&[], |scene| scene.materials.iter_mut().for_each(|m| m.albedo = Rgb::splat(0.9)));
    assert_changes(&[], |scene| scene.materials[3].appearance = Some(Default::default()));
    assert_changes(&[], |scene| scene.meshes.iter_mut().for_each(|m| m.colors[0].x = 0.5));
    assert_changes(&["geometry", "surface 0", "surface 1"], |scene| scene.materials[0].double_sided = true);
    // The albedo texture: its colours nowhere, its alpha where it makes holes, on an opaque material nowhere.
    assert_changes(&[], |scene| texel(scene, 0, 1));
    assert_changes(&["geometry", "surface 2"], |scene| texel(scene, 0, 3));
    assert_changes(&["geometry", "surface 2"], |scene| scene.meshes[1].colors[0].w = 0.5);
    assert_changes(&[], |scene| scene.meshes[0].colors[0].w = 0.5);
    let of_2 = ["geometry", "surface 2"];
    assert_changes(&of_2, |scene| scene.materials[1].alpha = Alpha::Mask { cutoff: 0.4, opacity: 1.0 });
    assert_changes(&of_2, |scene| scene.materials[1].alpha = Alpha::Opaque);
    // Another texture of the same alpha is as good.
    assert_changes(&[], |scene| scene.materials[1].opacity_texture = Some(TextureSlot::new(1, SLOT)));
    assert_changes(&of_2, |scene| scene.materials[1].opacity_texture = Some(TextureSlot::new(3, SLOT)));
    let slot =
        |scene: &mut Scene, edit: &dyn Fn(&mut TextureSlot)| edit(scene.materials[1].albedo_texture.as_mut().unwrap());
    assert_changes(&of_2, |scene| slot(scene, &|slot| slot.scale.w = 0.5));
    assert_changes(&[], |scene| slot(scene, &|slot| slot.scale.x = 0.5));
    assert_changes(&of_2, |scene| slot(scene, &|slot| slot.wrap[0] = Wrap::Black));
    assert_changes(&of_2, |scene| slot(scene, &|slot| slot.image_from_uv.translation.x = 0.5));
    assert_changes(&of_2, |scene| slot(scene, &|slot| slot.uv_set += "1"));
    assert_changes(&[], |scene| scene.materials[0].albedo_texture.as_mut().unwrap().wrap[0] = Wrap::Black);
    // Of the tint of glass its colours.
    assert_changes(&of_2, |scene| scene.materials[2].transmission.x = 0.25);
    assert_changes(&of_2, |scene| texel(scene, 1, 2));
    assert_changes(&[], |scene| texel(scene, 1, 3));
    // Colours of the same bytes, encoded otherwise.
    assert_changes(&of_2, |scene| {
        let Texels::Linear8(t) = &scene.textures[1].texels else { panic!("not linear") };
        scene.textures[1].texels = Texels::Srgb8(t.clone());
    });
}

#[test]
fn emission_has_its_strength_beside() {
    assert_changes(&["strength of glow"], |scene| scene.materials[3].emission = Rgb::new(5.0, 1.0, 0.5));
    assert_changes(&["glow"], |scene| texel(scene, 2, 0));
    assert_changes(&[], |scene| texel(scene, 2, 3));
    assert_changes(&["glow"], |scene| scene.materials[3].emission_texture.as_mut().unwrap().bias.y = 0.5);
    // Both sides shine, or don't.
    let dark = |scene: &mut Scene| scene.materials[3].emission = Rgb::ZERO;
    assert_changes(&["geometry", "surface 3", "glow", "strength of glow"], dark);
    assert_changes(&["geometry", "surface 3", "glow"], |scene| scene.materials[3].double_sided = false);
    // One that shines on one side is as good as one that doesn't.
    let (mut one_sided, mut matte) = (scene(), scene());
    one_sided.materials[3].double_sided = false;
    matte.materials[3] = Material { emission: Rgb::ZERO, ..one_sided.materials[3].clone() };
    assert_eq!(geometry(&one_sided), geometry(&matte));
}

#[test]
fn lights_have_their_strength_beside() {
    fn lamp(scene: &mut Scene) -> (&mut Vec3, &mut Rgb, &mut Option<f32>) {
        let LightShape::Point { position, intensity, range } = &mut scene.lights[LAMP].shape else { panic!("no lamp") };
        (position, intensity, range)
    }
    assert_changes(&["light 0"], |scene| lamp(scene).0.y += 1.0);
    assert_changes(&["light 0"], |scene| *lamp(scene).2 = Some(3.0));
    assert_changes(&["strength of light 0"], |scene| *lamp(scene).1 *= 2.0);
    assert_changes(&["strength of light 0"], |scene| lamp(scene).1.z = 0.0);
    assert_changes(&["light 0"], |scene| scene.lights[LAMP].links.lit = Linked::only(vec![true, false, true, true]));
    let (mut lit, mut blockers) = (scene(), scene());
    lit.lights[LAMP].links.lit = Linked::none(4);
    blockers.lights[LAMP].links.blockers = Linked::none(4);
    assert_ne!(shining(&lit, Shining::Light(LAMP)).0, shining(&blockers, Shining::Light(LAMP)).0);

    assert_changes(&["light 1"], |scene| scene.lights[PANEL].shaping.as_mut().unwrap().cone_softness = 0.25);
    assert_changes(&["light 1"], |scene| {
        Arc::get_mut(&mut scene.lights[PANEL].profile.as_mut().unwrap().web).unwrap().candela[1] = 7.0;
    });
    assert_changes(&["light 1"], |scene| scene.lights[PANEL].picture = Some(Picture::OnLight(4)));
    assert_changes(&["light 2"], |scene| texel(scene, 4, 0));
    assert_changes(&["light 2"], |scene| texel(scene, 4, 3));
    assert_changes(&["light 2"], |scene| {
        let Some(Picture::Thrown(thrown)) = &mut scene.lights[PROJECTOR].picture else { panic!("no picture") };
        thrown.picture_from_direction.x_axis.x *= 2.0;
    });

    // Each kind of light of the same place and strength is another light.
    let (center, u, v, radiance, world_from_unit) = (Vec3::Y, Vec3::X, Vec3::Z, Rgb::ONE, Affine3A::IDENTITY);
    let shapes = [
        LightShape::Rect { center, u, v, radiance },
        LightShape::Disk { center, u, v, radiance },
        LightShape::Sphere { world_from_unit, radiance },
        LightShape::Cylinder { world_from_unit, radiance },
        LightShape::Directional { direction: Vec3::NEG_Y, illuminance: radiance, angle: 0.0 },
        LightShape::Directional { direction: Vec3::NEG_Y, illuminance: radiance, angle: 0.1 },
    ];
    let mut scene = scene();
    scene.lights = shapes.map(|shape| Light { world_from_light: Mat3::IDENTITY, ..Light::new("", shape) }).to_vec();
    let keys: Vec<_> = (0..scene.lights.len()).map(|l| shining(&scene, Shining::Light(l)).0).collect();
    (1..keys.len()).for_each(|k| assert!(!keys[..k].contains(&keys[k]), "light {k}"));
}

#[test]
fn skies_have_their_strength_beside() {
    assert_changes(&["strength of sky 0"], |scene| sky(scene).radiance *= 2.0);
    assert_changes(&["strength of sky 1"], |scene| sky(scene).others[0].radiance *= 2.0);
    assert_changes(&["sky 0"], |scene| sky(scene).world_from_sky = Mat3::from_rotation_y(1.0));
    assert_changes(&[], |scene| sky(scene).others[0].world_from_sky = Mat3::from_rotation_y(1.0));
    // Both portals show the same picture.
    assert_changes(&["sky 0", "light 3", "light 4"], |scene| texel(scene, 3, 1));
    assert_changes(&["strength of light 3"], |scene| portal_sky(&mut scene.lights[WINDOW]).radiance *= 2.0);
    assert_changes(&["light 4"], |scene| portal_sky(&mut scene.lights[WINDOW_OF_TWO]).radiance *= 2.0);
    assert_changes(&["light 4"], |scene| portal_sky(&mut scene.lights[WINDOW_OF_TWO]).others[0].radiance *= 2.0);
    assert_eq!(shining(&scene(), Shining::Light(WINDOW_OF_TWO)).1, Rgb::ONE);
}

/// Surfaces are themselves wherever they stand in the lists of a scene; keys of the whole scene know the places.
#[test]
fn surfaces_keep_their_keys_when_others_come_and_go() {
    let old = scene();
    let mut new = scene();
    new.materials.insert(0, Material::default());
    new.meshes.iter_mut().flat_map(|m| &mut m.triangle_material).for_each(|m| *m += 1);
    new.meshes.insert(0, quad([0, 0]));
    new.surfaces.iter_mut().for_each(|s| s.mesh += 1);
    new.surfaces.insert(0, place(0, 9.0));
    new.textures.reverse();
    let last = new.textures.len() - 1;
    let slots = |m: &mut Material| {
        let slots =
            [&mut m.albedo_texture, &mut m.emission_texture, &mut m.opacity_texture, &mut m.transmission_texture];
        slots.into_iter().flatten().for_each(|slot| slot.texture = last - slot.texture);
    };
    new.materials.iter_mut().for_each(slots);
    assert_eq!(surfaces(&new)[1..], surfaces(&old));
    assert_eq!(shining(&new, Shining::Material(4)), shining(&old, Shining::Material(3)));
    assert_ne!(geometry(&new), geometry(&old));
}

#[test]
fn every_part_of_an_atlas_counts() {
    let sound = Atlas {
        pages: vec![[64, 32]],
        meshes: vec![MeshUvs {
            corners: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]],
            chart: vec![0],
            chart_count: 1,
            authored: None,
        }],
        placements: vec![Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO }],
        density: 8.0,
        padding: 2,
        shown_pages: 1,
    };
    let edits: [fn(&mut Atlas); 13] = [
        |_| (),
        |a| a.pages[0] = [32, 64],
        |a| a.meshes[0].corners[0][1].x = 0.5,
        |a| a.meshes[0].chart[0] = 1,
        |a| a.meshes[0].chart_count = 2,
        |a| a.meshes[0].authored = Some("st1".into()),
        |a| a.meshes.push(MeshUvs::default()),
        |a| a.placements[0].page = 1,
        |a| a.placements[0].scale.y = 0.5,
        |a| a.placements[0].offset.y = 0.5,
        |a| a.density = 9.0,
        |a| a.padding = 3,
        |a| a.shown_pages = 0,
    ];
    let keys = edits.map(|edit| {
        let mut edited = sound.clone();
        edit(&mut edited);
        atlas(&edited)
    });
    assert_eq!(keys[0], atlas(&sound));
    (1..keys.len()).for_each(|k| assert!(!keys[..k].contains(&keys[k]), "edit {k}"));
}

/// Real scenes: the same on any number of threads, and in less time than anyone would notice.
#[test]
fn real_scenes_are_hashed_at_once() {
    let Some(shared) = shared() else { return };
    let scenes = [
        "reference/atrium/scene.usdc",
        "scenes/godot_gi_zdm2/3d/global_illumination/zdm2.glb",
        "scenes/arnold_point_instancer/test_0185/data/scene.usd",
        "scenes/bevy_flight_helmet/assets/models/FlightHelmet/FlightHelmet.gltf",
    ];
    for file in scenes.map(|scene| shared.join(scene)) {
        let scene = lumel::load::load(&file).unwrap().scene;
        let start = Instant::now();
        let whole = geometry(&scene);
        let (seconds, triangles) = (start.elapsed().as_secs_f64(), scene.triangle_count());
        println!("{}: {triangles} triangles in {:.1} ms", file.display(), seconds * 1e3);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| geometry(&scene)), whole);
        assert!(seconds < 1.0, "{seconds} s");
    }
}

#[test]
fn many_instances_are_hashed_at_once() {
    let mut scene = scene();
    scene.surfaces = (0..100_000).map(|k| place(k % 3, k as f32)).collect();
    let start = Instant::now();
    let whole = geometry(&scene);
    let seconds = start.elapsed().as_secs_f64();
    println!("100 000 surfaces in {:.1} ms", seconds * 1e3);
    assert!(seconds < 1.0, "{seconds} s");
    scene.surfaces.swap(99_996, 99_999);
    assert_ne!(geometry(&scene), whole);
}
