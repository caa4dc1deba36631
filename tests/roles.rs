//! Roles of objects: known light with blockers that don't receive and receivers that don't cast, densities on the atlas, and the
//! same asked for by USD, glTF and `lumel.toml`, down to the files that come out.

mod files;
mod support;

use files::Folder;
use glam::Vec3;
use lumel::illuminate::{Illuminated, illuminate};
use lumel::load::{self, LampEdit, LoadOptions, Loaded, MaterialEdit, ObjectEdit};
use lumel::progress::Silent;
use lumel::scene::role::HIDDEN_SCALE;
use lumel::scene::{Light, LightShape, Role, Scene, Surface};
use lumel::settings::{Gather, Method, Quality, Settings};
use lumel::solve::Solver;
use lumel::trace::{Ray, Tracer};
use lumel::unwrap::{Atlas, Density, UnwrapParams, UvMode, unwrap};
use serde_json::{Value, json};
use std::f32::consts::PI;
use std::path::Path;
use std::process::Command;
use support::{Quad, draft, room, scene};

const BLOCKER: Role =
    Role { skip: false, casts: true, receives: false, lightmapped: true, density: None, density_scale: 1.0 };
const GHOST: Role =
    Role { skip: false, casts: false, receives: true, lightmapped: true, density: None, density_scale: 1.0 };

fn laid_out(scene: &Scene, density: Density) -> Atlas {
    let params = UnwrapParams { density, page_size: 256, max_pages: 8, uv: UvMode::New, ..UnwrapParams::default() };
    unwrap(scene, &params, &Silent).unwrap().0
}

fn baked(scene: &Scene, settings: &Settings) -> (Atlas, Illuminated) {
    let atlas = laid_out(scene, Density::TexelsPerMetre(8.0));
    let lit = illuminate(scene, &atlas, settings, &Silent).unwrap();
    (atlas, lit)
}

/// A floor of 4 m squared, a sheet of 1 m squared one metre above its middle, and a lamp two metres above that.
fn sheet_over_floor(role: Role) -> Scene {
    let floor = Quad::new([-2., 0., -2.], [0., 0., 4.], [4., 0., 0.]);
    let sheet = Quad::new([-0.5, 1., -0.5], [0., 0., 1.], [1., 0., 0.]).double_sided();
    let mut scene = scene(&[floor, sheet]);
    scene.surfaces[1].role = role;
    let intensity = Vec3::splat(100.0);
    scene.lights.push(Light::new("lamp", LightShape::Point { position: Vec3::Y * 3.0, intensity, range: None }));
    scene
}

/// Mean irradiance of the patches of `surface` within `radius` of the y axis [lx].
fn within(lit: &Illuminated, surface: u32, radius: f32) -> f32 {
    let patches = &lit.patches;
    let near = |i: &usize| {
        let p = patches.position[*i];
        patches.surface(*i) == surface && p.x.abs().max(p.z.abs()) < radius
    };
    let all: Vec<usize> = (0..patches.len()).filter(near).collect();
    assert!(!all.is_empty(), "no patch of surface {surface}");
    all.iter().map(|&i| lit.gathered.irradiance[i].x).sum::<f32>() / all.len() as f32
}

#[test]
fn a_blocker_that_does_not_receive_shadows_the_floor_but_has_no_texels() {
    let (plain_atlas, plain) = baked(&sheet_over_floor(Role::default()), &draft());
    let (atlas, lit) = baked(&sheet_over_floor(BLOCKER), &draft());
    // Below the sheet, at half the height: its shadow is 1.5 m wide.
    let open = 100.0 / 9.0;
    assert!(within(&lit, 0, 0.5) < 0.01 * open, "{}", within(&lit, 0, 0.5));
    assert!((within(&lit, 0, 0.5) - within(&plain, 0, 0.5)).abs() < 0.002 * open);
    assert!(atlas.is_shown(0) && !atlas.is_shown(1));
    assert_eq!((atlas.shown_pages, atlas.pages.len()), (1, 2));
    assert_eq!((plain_atlas.shown_pages, plain_atlas.pages.len()), (1, 1));
    // Nothing of it lies on the page that is written.
    let on_page: Vec<u32> =
        (0..lit.patches.len()).filter(|&i| lit.patches.page(i) == 0).map(|i| lit.patches.surface(i)).collect();
    assert!(!on_page.is_empty() && on_page.iter().all(|s| *s == 0));
}

#[test]
fn a_receiver_that_does_not_cast_leaves_no_shadow() {
    let (_, lit) = baked(&sheet_over_floor(GHOST), &draft());
    // E = I cos / d^2, at texels.
    let (mut seen, mut worst) = (0, 0.0f32);
    for i in 0..lit.patches.len() {
        let p = lit.patches.position[i];
        let to_light = Vec3::Y * 3.0 - p;
        let known = 100.0 * to_light.normalize().y / to_light.length_squared();
        worst = worst.max((lit.direct.shown[i].x / known - 1.0).abs());
        seen += u32::from(lit.patches.surface(i) == 1);
    }
    assert!(seen > 50 && worst < 0.002, "{seen} texels, {worst}");
    // Nor does it send anything: the floor gets light from the lamp alone.
    let floor = |i: &usize| lit.patches.surface(*i) == 0;
    let added = (0..lit.patches.len()).filter(floor).map(|i| lit.gathered.irradiance[i].x - lit.direct.shown[i].x);
    assert!(added.into_iter().all(|e| e.abs() < 1e-6));
    assert!(lit.energy.imbalance.abs() < 0.005, "{}", lit.energy.imbalance);
}

#[test]
fn rays_pass_through_what_does_not_cast_and_find_the_rest() {
    let at = |y: f32| Quad::new([-1., y, -1.], [0., 0., 2.], [2., 0., 0.]);
    for ghosts in [vec![0], vec![1, 3], vec![4], vec![0, 1, 2, 3, 4]] {
        let mut scene = scene(&[4., 3., 2., 1., 0.].map(at));
        ghosts.iter().for_each(|g: &usize| scene.surfaces[*g].role = GHOST);
        let tracer = Tracer::new(&scene);
        let ray = Ray { origin: Vec3::new(0.3, 9.0, 0.2), direction: Vec3::NEG_Y };
        let mut hits = [None];
        tracer.closest(&[ray], &mut hits);
        let first = (0..5).find(|s| !ghosts.contains(s));
        assert_eq!(hits[0].map(|hit| tracer.place(hit.triangle).0), first, "{ghosts:?}");
    }
}

#[test]
fn in_a_furnace_every_role_sees_the_same_light() {
    // Walls that shine and reflect alike: B = M / (1 - rho) everywhere, and E = B on whatever stands inside.
    let mut quads: Vec<Quad> = room([2., 2., 2.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    quads.push(Quad::new([0.6, 0.9, 0.6], [0., 0., 0.8], [0.8, 0., 0.]).albedo(0.9).emission(7.0));
    let known = PI / 0.5;
    for (method, gather) in
        [(Method::Radiosity, Gather::Auto), (Method::Radiosity, Gather::Final), (Method::Path, Gather::Auto)]
    {
        let mut scene = scene(&quads);
        scene.surfaces[6].role = GHOST;
        scene.surfaces[0].role = BLOCKER;
        scene.surfaces[1].role = Role { lightmapped: false, ..Role::default() };
        let settings = Settings { method, gather, quality: Quality::Medium, ..draft() };
        let (atlas, lit) = baked(&scene, &settings);
        assert_eq!(atlas.shown_pages, 1);
        for surface in 0..7u32 {
            let of: Vec<usize> = (0..lit.patches.len()).filter(|&i| lit.patches.surface(i) == surface).collect();
            let area: f32 = of.iter().map(|&i| lit.patches.area[i]).sum();
            let mean = of.iter().map(|&i| lit.gathered.irradiance[i].x * lit.patches.area[i]).sum::<f32>() / area;
            assert!(
                (mean / known - 1.0).abs() < 0.005,
                "{method:?} {gather:?}: surface {surface} has {mean} of {known}"
            );
        }
        assert!(lit.energy.imbalance.abs() < 0.005, "{method:?} {gather:?}: {}", lit.energy.imbalance);
    }
}

#[test]
fn elements_know_what_does_not_cast() {
    let settings = Settings { solver: Solver::Progressive, gather: Gather::Final, ..draft() };
    let (_, lit) = baked(&sheet_over_floor(GHOST), &settings);
    assert!(lit.energy.imbalance.abs() < 0.005, "{}", lit.energy.imbalance);
    assert!(within(&lit, 0, 0.5) > 10.0);
}

#[test]
fn density_is_each_objects_own() {
    let quads: Vec<Quad> = (0..5).map(|k| Quad::new([5. * k as f32, 0., 0.], [0., 0., 3.], [4., 0., 0.])).collect();
    let mut scene = scene(&quads);
    let role = Role::default();
    let roles = [
        role,
        Role { density_scale: 2.0, ..role },
        Role { density: Some(5.0), ..role },
        Role { density: Some(10.0), density_scale: 0.5, ..role },
        BLOCKER,
    ];
    scene.surfaces.iter_mut().zip(roles).for_each(|(s, role)| s.role = role);
    for density in [Density::TexelsPerMetre(10.0), Density::TexelCount(12_000), Density::FillPage(256)] {
        let atlas = laid_out(&scene, density);
        let base = f64::from(atlas.density);
        if density == Density::TexelsPerMetre(10.0) {
            assert_eq!(base, 10.0);
        }
        let wanted = [base, 2.0 * base, 5.0, 5.0, f64::from(HIDDEN_SCALE) * base];
        for (s, wanted) in wanted.into_iter().enumerate() {
            let found = f64::from(atlas.surface_density(&scene, s));
            assert!((found / wanted - 1.0).abs() < 0.05, "{density:?}: surface {s} has {found}, not {wanted}");
        }
        if let Density::TexelCount(count) = density {
            let texels: f64 = (0..4).map(|s| 12.0 * f64::from(atlas.surface_density(&scene, s)).powi(2)).sum();
            assert!((texels / count as f64 - 1.0).abs() < 0.05, "{texels}");
        }
    }
}

#[test]
fn instances_share_the_density_that_most_ask_for() {
    let mut scene = scene(&[Quad::new([0.; 3], [0., 0., 3.], [4., 0., 0.])]);
    let first = scene.surfaces[0].clone();
    scene.surfaces = (0..4)
        .map(|k| {
            let density = (k == 1).then_some(80.0);
            let role = Role { density, receives: k != 3, ..Role::default() };
            Surface { name: format!("tree[{k}]"), role, ..first.clone() }
        })
        .collect();
    let params = UnwrapParams {
        density: Density::TexelsPerMetre(10.0),
        page_size: 256,
        max_pages: 8,
        uv: UvMode::New,
        ..UnwrapParams::default()
    };
    let (atlas, warnings) = unwrap(&scene, &params, &Silent).unwrap();
    for s in 0..4 {
        assert!((atlas.surface_density(&scene, s) / 10.0 - 1.0).abs() < 0.05);
        assert_eq!(atlas.is_shown(s), s != 3);
    }
    let warning = warnings.iter().next().unwrap();
    assert!(warning.message.contains("what most of them ask for") && warning.places == ["tree[1]"], "{warnings:?}");
}

// ---- the files ----

impl Folder {
    /// Runs the command in the folder; its output on success.
    fn lumel(&self, args: &[&str]) -> String {
        let output = Command::new(env!("CARGO_BIN_EXE_lumel")).args(args).current_dir(&self.0).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, file: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.0.join(file)).unwrap()).unwrap()
    }

    /// The JSON of a GLB.
    fn glb(&self, file: &str) -> Value {
        let bytes = std::fs::read(self.0.join(file)).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&bytes[20..20 + length]).unwrap()
    }

    fn text(&self, file: &str) -> String {
        std::fs::read_to_string(self.0.join(file)).unwrap()
    }
}

/// A square of one metre that faces up, by nodes with a name, a place, a size and extras; those after the first are below a
/// node `Things` with the extras `things`. A lamp hangs above.
fn gltf(nodes: &[(&str, [f32; 3], f32, Value)], things: Value) -> String {
    let floats = [0f32, 0., 0., 0., 0., 1., 1., 0., 1., 1., 0., 0.].map(f32::to_le_bytes).concat();
    let indices = [0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes).concat();
    let bytes = [floats, indices].concat();
    let hex: String = bytes.iter().map(|b| format!("%{b:02X}")).collect();
    let mut list: Vec<Value> = nodes
        .iter()
        .map(|(name, at, size, extras)| {
            json!({ "name": name, "mesh": 0, "translation": at, "scale": [size, 1.0, size], "extras": extras })
        })
        .collect();
    let below: Vec<usize> = (1..nodes.len()).collect();
    list.push(json!({ "name": "Things", "children": below, "extras": things }));
    list.push(
        json!({ "name": "Lamp", "translation": [0, 3, 0], "extensions": { "KHR_lights_punctual": { "light": 0 } } }),
    );
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 100.0 }] } },
        "scene": 0,
        "scenes": [{ "nodes": [0, nodes.len(), nodes.len() + 1] }],
        "nodes": list,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "Grey", "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0 } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1] },
            { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 12 }
        ],
        "buffers": [{ "byteLength": 60, "uri": format!("data:application/octet-stream,{hex}") }]
    })
    .to_string()
}

fn lumel(keys: Value) -> Value {
    json!({ "lumel": keys, "kept": 1 })
}

/// A floor, and above it a blocker, a ghost, and something with vertex colours, each by its own opinion over an inherited one.
fn gltf_of_roles() -> String {
    gltf(
        &[
            ("Floor", [-2., 0., -2.], 4., json!({})),
            ("Blocker", [-1.5, 1., -0.5], 1., lumel(json!({ "receives": false }))),
            ("Ghost", [0.5, 1., -0.5], 1., lumel(json!({ "casts": false, "densityScale": 2.0 }))),
            ("Colours", [-0.5, 1., -1.9], 1., lumel(json!({ "lightmapped": false }))),
            ("Gone", [-0.5, 1., 0.9], 1., lumel(json!({ "skip": true }))),
        ],
        lumel(json!({ "densityScale": 0.5 })),
    )
}

/// The same as USD.
fn usd_of_roles() -> String {
    let square = |name: &str, at: [f32; 3], size: f32, says: &str| {
        format!(
            "def Mesh \"{name}\" {{\n uniform token subdivisionScheme = \"none\"\n int[] faceVertexCounts = [4]\n \
             int[] faceVertexIndices = [0, 1, 2, 3]\n point3f[] points = [(0, 0, 0), (0, 0, {size}), ({size}, 0, {size}), ({size}, 0, 0)]\n \
             color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)]\n double3 xformOp:translate = ({}, {}, {})\n \
             uniform token[] xformOpOrder = [\"xformOp:translate\"]\n {says}\n}}\n",
            at[0], at[1], at[2]
        )
    };
    let things = [
        square("Blocker", [-1.5, 1., -0.5], 1., "bool lumel:receives = 0"),
        square("Ghost", [0.5, 1., -0.5], 1., "bool lumel:casts = 0\n float lumel:densityScale = 2"),
        square("Colours", [-0.5, 1., -1.9], 1., "bool lumel:lightmapped = 0"),
        square("Gone", [-0.5, 1., 0.9], 1., "bool lumel:skip = 1"),
    ];
    format!(
        "#usda 1.0\n(\n metersPerUnit = 1\n upAxis = \"Y\"\n)\n{}def Xform \"Things\" {{\n custom double lumel:densityScale = 0.5\n{}}}\n\
         def SphereLight \"Lamp\" {{\n float inputs:radius = 0.1\n float inputs:intensity = 3000\n double3 xformOp:translate = (0, 3, 0)\n \
         uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}}\n",
        square("Floor", [-2., 0., -2.], 4., ""),
        things.concat()
    )
}

fn names(loaded: &Loaded) -> Vec<(String, Role)> {
    let last = |name: &str| name.rsplit('/').next().unwrap_or_default().to_owned();
    loaded.scene.surfaces.iter().map(|s| (last(&s.name), s.role)).collect()
}

#[test]
fn both_formats_say_roles_and_inherit_them() {
    let f = Folder::new("formats");
    let role = Role { density_scale: 0.5, ..Role::default() };
    let expected = [
        ("Floor", Role::default()),
        ("Blocker", Role { receives: false, ..role }),
        ("Ghost", Role { casts: false, density_scale: 2.0, ..role }),
        ("Colours", Role { lightmapped: false, ..role }),
    ]
    .map(|(name, role)| (name.to_owned(), role));
    for path in [f.write("a.gltf", gltf_of_roles()), f.write("a.usda", usd_of_roles())] {
        let loaded = load::load(&path).unwrap();
        assert_eq!(names(&loaded), expected, "{}", path.display());
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    }
}

#[test]
fn the_config_goes_before_the_file_and_later_tables_before_earlier_ones() {
    let f = Folder::new("config");
    let path = f.write("a.gltf", gltf_of_roles());
    let object = |path: &str| ObjectEdit { path: path.into(), ..ObjectEdit::default() };
    let mut options = LoadOptions::default();
    options.edits.objects = vec![
        ObjectEdit { receives: Some(false), density: Some(7.0), ..object("Things") },
        ObjectEdit { receives: Some(true), skip: Some(false), ..object("/Things/G*") },
        ObjectEdit { casts: Some(false), ..object("Blokcer") },
    ];
    options.edits.materials = vec![MaterialEdit {
        name: "Gr?y".into(),
        albedo: Some([0.2; 3]),
        emission_scale: Some(2.0),
        double_sided: Some(true),
        ..MaterialEdit::default()
    }];
    options.edits.lamps = vec![LampEdit { name: "Lamp".into(), scale: Some(3.0), ..LampEdit::default() }];
    let loaded = load::load_with(&path, &options).unwrap();
    let role = |name: &str| names(&loaded).into_iter().find(|(n, _)| n == name).map(|(_, role)| role);
    assert_eq!(role("Floor"), Some(Role::default()));
    assert!(role("Blocker").is_some_and(|r| !r.receives && r.casts && r.density == Some(7.0)));
    assert!(role("Ghost").is_some_and(|r| r.receives && !r.casts));
    assert!(role("Gone").is_some_and(|r| r.receives), "skip can be taken back");
    assert!(loaded.scene.materials[0].double_sided && loaded.scene.materials[0].albedo == Vec3::splat(0.2));
    assert!(
        matches!(loaded.scene.lights[0].shape, LightShape::Point { intensity, .. } if intensity == Vec3::splat(300.0))
    );
    let warning = loaded.warnings.iter().find(|w| w.places == ["Blokcer"]).unwrap();
    assert!(warning.message.contains("[[objects]] matches nothing; near to it: Blocker"), "{}", warning.message);

    options.edits.lamps[0].skip = Some(true);
    assert!(load::load_with(&path, &options).unwrap().scene.lights.is_empty());
    options.edits.objects = vec![ObjectEdit { skip: Some(true), ..object("**") }];
    let error = load::load_with(&path, &options).unwrap_err().to_string();
    assert!(error.contains("every surface is left out"), "{error}");
}

#[test]
fn slips_are_told_with_the_keys_that_there_are() {
    let f = Folder::new("slips");
    let slip = |extras: Value| {
        let path = f.write("slip.gltf", gltf(&[("Floor", [0.; 3], 1., lumel(extras))], json!({})));
        load::load(&path).unwrap_err().to_string()
    };
    let e = slip(json!({ "cast": false }));
    assert!(e.contains("unknown key cast") && e.contains("casts, receives, lightmapped") && e.contains("Floor"), "{e}");
    assert!(slip(json!({ "density": 0 })).contains("density 0 is out of range"));
    assert!(slip(json!({ "casts": "no" })).contains("Floor"));
    assert!(slip(json!(3)).contains("no object"));

    let text = usd_of_roles()
        .replace("lumel:receives", "lumel:recieves")
        .replace("bool lumel:casts = 0", "token lumel:casts = \"no\"");
    let loaded = load::load(&f.write("slip.usda", text)).unwrap();
    let told = |message: &str, place: &str| {
        loaded.warnings.iter().any(|w| w.message.contains(message) && w.places.iter().any(|p| p.contains(place)))
    };
    assert!(told("known are lumel:skip, lumel:casts", "/Things/Blocker.lumel:recieves"), "{:?}", loaded.warnings);
    assert!(told("has no value of its type", "/Things/Ghost.lumel:casts"), "{:?}", loaded.warnings);

    let config = |text: &str| {
        f.write("lumel.toml", text);
        let output =
            Command::new(env!("CARGO_BIN_EXE_lumel")).args(["inspect", "slip.usda"]).current_dir(&f.0).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let e = config("[[objects]]\npath = \"*\"\ncast = false\n");
    assert!(e.contains("lumel.toml:3") && e.contains("`cast`") && e.contains("`casts`"), "{e}");
    assert!(config("[[objects]]\npath = \"*\"\ndensity = -1\n").contains("density -1 is out of range"));
    assert!(config("[[materials]]\nname = \"*\"\nalbedo = [2, 0, 0]\n").contains("albedo 2 is out of range"));
    assert!(config("[[lamps]]\nname = \"\"\n").contains("empty pattern"));
}

#[test]
fn a_lamp_and_a_sky_can_be_left_to_the_engine() {
    let f = Folder::new("lamps");
    let dome = "def DomeLight \"Sky\" {\n float inputs:intensity = 5\n}\n";
    let path = f.write("a.usda", usd_of_roles() + dome);
    let lamp = |name: &str, skip, scale| LampEdit { name: name.into(), skip, scale, ..LampEdit::default() };
    let with = |lamps: Vec<LampEdit>| {
        let mut options = LoadOptions::default();
        options.edits.lamps = lamps;
        load::load_with(&path, &options).unwrap().scene
    };
    let scaled = with(vec![lamp("Sky", None, Some(2.0))]);
    assert_eq!(scaled.environment.unwrap().radiance, Vec3::splat(10.0));
    let left = with(vec![lamp("**", Some(true), None), lamp("Lamp", Some(false), None)]);
    assert!(left.environment.is_none() && left.lights.len() == 1);
}

/// The surface of a report by the end of its name.
fn reported<'a>(report: &'a Value, name: &str) -> &'a Value {
    let is = |s: &&Value| s["name"].as_str().is_some_and(|n| n.ends_with(name));
    report["surfaces"].as_array().unwrap().iter().find(is).unwrap()
}

#[test]
fn the_files_of_a_gltf_bake_follow_the_roles() {
    let f = Folder::new("gltf");
    f.write("a.gltf", gltf_of_roles());
    f.lumel(&["bake", "a.gltf", "-o", "out", "--density", "8", "--quality", "draft", "--quiet"]);
    let report = f.json("out/report.json");
    assert_eq!(reported(&report, "Blocker")["role"], "casts only");
    assert!(reported(&report, "Blocker")["page"].is_null() && reported(&report, "Colours")["page"].is_null());
    assert_eq!(reported(&report, "Ghost")["page"], 0);
    assert_eq!(report["pages"].as_array().unwrap().len(), 1);
    for (name, density) in [("Floor", 8.0), ("Ghost", 16.0), ("Colours", 4.0)] {
        let found = reported(&report, name)["density"].as_f64().unwrap();
        assert!((found / density - 1.0).abs() < 0.05, "{name}: {found}");
    }
    assert!(report["energy"]["imbalance"].as_f64().unwrap().abs() < 0.005);
    assert_eq!(std::fs::read_dir(f.0.join("out/lightmaps")).unwrap().count(), 1);

    let node =
        |glb: &Value, name: &str| glb["nodes"].as_array().unwrap().iter().find(|n| n["name"] == name).unwrap().clone();
    let glb = f.glb("out/a.glb");
    let mesh = |glb: &Value, name: &str| glb["meshes"][node(glb, name)["mesh"].as_u64().unwrap() as usize].clone();
    let attributes = |glb: &Value, name: &str| mesh(glb, name)["primitives"][0]["attributes"].clone();
    for name in ["Floor", "Ghost"] {
        assert_eq!(node(&glb, name)["extras"]["lumel"]["page"], 0, "{name}");
        assert!(attributes(&glb, name)["TEXCOORD_1"].is_u64(), "{name}");
    }
    for name in ["Blocker", "Colours", "Gone"] {
        assert!(node(&glb, name)["extras"]["lumel"]["page"].is_null(), "{name}");
    }
    // What was asked for stays, so that the file can be baked again.
    assert_eq!(node(&glb, "Blocker")["extras"], lumel(json!({ "receives": false })));
    assert_eq!(node(&glb, "Ghost")["extras"]["lumel"]["densityScale"], 2.0);
    let vertex = f.glb("out/a.vertex.glb");
    for name in ["Floor", "Ghost", "Colours"] {
        assert!(attributes(&vertex, name)["COLOR_0"].is_u64(), "{name}");
    }
    for name in ["Blocker", "Gone"] {
        assert!(attributes(&vertex, name)["COLOR_0"].is_null(), "{name}");
    }
}

#[test]
fn the_files_of_a_usd_bake_follow_the_roles() {
    let f = Folder::new("usd");
    f.write("a.usda", usd_of_roles());
    f.lumel(&["bake", "a.usda", "-o", "out", "--density", "8", "--quality", "draft", "--quiet"]);
    let layer = f.text("out/a.lumel.usda");
    let prim = |name: &str| {
        let start = layer.find(&format!("over \"{name}\""))?;
        let rest = &layer[start..];
        Some(rest[..rest[4..].find("over \"").map_or(rest.len(), |end| end + 4)].to_owned())
    };
    for name in ["Floor", "Ghost"] {
        let prim = prim(name).unwrap();
        assert!(prim.contains("lumel:scaleOffset") && prim.contains("lumel:lightmap ="), "{name}: {prim}");
    }
    let colours = prim("Colours").unwrap();
    assert!(colours.contains("primvars:lumel:irradiance") && !colours.contains("scaleOffset"), "{colours}");
    assert!(prim("Blocker").is_none() && prim("Gone").is_none(), "{layer}");
    let is_named = |n: &Value, name: &str| n["name"].as_str().is_some_and(|n| n.ends_with(name));
    for (file, set, with, without) in [
        ("out/a.glb", "TEXCOORD_1", ["Floor", "Ghost"], ["Blocker", "Colours"]),
        ("out/a.vertex.glb", "COLOR_0", ["Colours", "Ghost"], ["Blocker", "Blocker"]),
    ] {
        let glb = f.glb(file);
        let has = |name: &str| {
            let node = glb["nodes"].as_array().unwrap().iter().find(|n| is_named(n, name)).unwrap().clone();
            let mesh = &glb["meshes"][node["mesh"].as_u64().unwrap() as usize];
            mesh["primitives"][0]["attributes"][set].is_u64()
        };
        assert!(with.into_iter().all(has) && !without.into_iter().any(has), "{file}");
    }
}

#[test]
fn inspect_tells_roles_doubts_and_the_light_of_the_options() {
    let f = Folder::new("inspect");
    f.write("a.gltf", gltf_of_roles());
    f.write("lumel.toml", "density = 8\n[[lamps]]\nname = \"Lamp\"\nskip = true\n[[materials]]\nname = \"Grey\"\nalbedo = [0.0, 0.0, 0.0]\n");
    let i: Value =
        serde_json::from_str(&f.lumel(&["inspect", "a.gltf", "--json", "--sun", "40,180,1000", "--sky", "1,1,1"]))
            .unwrap();
    assert_eq!(reported(&i, "Blocker")["role"], "casts only");
    assert_eq!(reported(&i, "Ghost")["density"], 16.0);
    assert_eq!(reported(&i, "Ghost")["texels"], 256);
    assert_eq!(reported(&i, "Floor")["opacity"], json!([1.0, 1.0]));
    assert_eq!((i["lights"].as_array().unwrap().len(), &i["lights"][0]["name"]), (1, &json!("--sun")));
    assert_eq!(i["environment"][0]["name"], "--sky");
    assert_eq!(i["limits"]["max_pages"], 64);
    let said =
        i["warnings"].as_array().unwrap().iter().any(|w| w["message"].as_str().unwrap().contains("exactly black"));
    assert!(said, "{}", i["warnings"]);
    let text = f.lumel(&["inspect", "a.gltf", "--quiet"]);
    assert!(text.contains("casts only") && text.contains("nothing shines"), "{text}");
}

#[test]
fn form_factors_are_between_what_casts() {
    let f = Folder::new("factors");
    f.write("a.gltf", gltf_of_roles());
    let text = f.lumel(&["form-factors", "a.gltf", "--json", "--quality", "draft", "--quiet"]);
    assert!(text.contains("Things/Blocker") && !text.contains("Things/Gone"), "{text}");
    let figures: Value = serde_json::from_str(&text).unwrap();
    let warnings = figures["warnings"].to_string();
    assert!(warnings.contains("doesn't cast") && warnings.contains("Things/Ghost"), "{warnings}");
    assert!(Path::new(&f.0.join("a_form_factors.npz")).exists());
}
