//! Selected objects baked beside kept texels: what is kept stays to the bit, what is baked is as a bake of all has it.

mod command;
mod support;

use command::{Folder, assert_fails_cleanly, stderr};
use lumel::color::{Rgb, luminance};
use lumel::compare::{ReadLayer, read_layers};
use lumel::illuminate::only::Earlier;
use lumel::illuminate::{Illuminated, illuminate, illuminate_only};
use lumel::load::{MaterialEdit, load_with};
use lumel::patch::{Patches, rasterize};
use lumel::pipeline::{Report, bake};
use lumel::post::{Directional, LayerKind, Quantity};
use lumel::progress::Silent;
use lumel::scene::{Light, LightShape, Scene};
use lumel::settings::{Normals, ProbeSetting, Settings};
use lumel::store::Store;
use lumel::trace::Tracer;
use lumel::unwrap::{Atlas, unwrap};
use lumel::work::Work;
use lumel::write::encode::Encoding;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use support::{Quad, atlas, room, scene};

fn cornell_box() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cornell_box/cornell_box.glb")
}

/// The texels of a bake by `settings`.
struct Ground {
    scene: Scene,
    patches: Patches,
    padding: i64,
}

impl Ground {
    fn new(file: &Path, settings: &Settings) -> Self {
        let scene = load_with(file, &settings.load_options()).unwrap().scene;
        let (atlas, _) = unwrap(&scene, &settings.unwrap_params(), &Silent).unwrap();
        let tracer = Tracer::new(&scene);
        let patches = rasterize(&scene, &atlas, tracer.triangles(), &Silent).unwrap();
        Self { scene, patches, padding: i64::from(atlas.padding) }
    }

    fn name(&self, i: usize) -> &str {
        &self.scene.surfaces[self.patches.surface(i) as usize].name
    }
}

/// The colours of the only page in `folder` and all of its layers, each with its name.
fn images(folder: &Path) -> (usize, Vec<(String, Vec<Rgb>)>) {
    let page = std::fs::read_dir(folder.join("lightmaps")).unwrap().map(|e| e.unwrap().path());
    let page = page.filter(|path| path.extension().is_some_and(|e| e == "exr")).collect::<Vec<_>>();
    assert_eq!(page.len(), 1, "{page:?}");
    let (page, layers) = read_layers(&page[0]).unwrap();
    let layers = layers.into_iter().map(|ReadLayer { name, values, .. }| (name, values));
    (page.width, std::iter::once(("whole".to_string(), page.rgb)).chain(layers).collect())
}

fn bits(v: Rgb) -> [u32; 3] {
    v.to_array().map(f32::to_bits)
}

/// Root mean square of the differences, without the worst hundredth, and difference of the means, both over the mean of `truth`.
fn differences(mut pairs: Vec<(f64, f64)>) -> (f64, f64) {
    assert!(pairs.len() > 500, "{}", pairs.len());
    let n = pairs.len() as f64;
    let mean = pairs.iter().map(|p| p.1).sum::<f64>() / n;
    let bias = pairs.iter().map(|p| p.0 - p.1).sum::<f64>() / n;
    pairs.sort_by(|a, b| (a.0 - a.1).abs().total_cmp(&(b.0 - b.1).abs()));
    pairs.truncate(pairs.len() * 99 / 100);
    let square = pairs.iter().map(|p| (p.0 - p.1).powi(2)).sum::<f64>() / pairs.len() as f64;
    (square.sqrt() / mean, bias / mean)
}

fn plain() -> Settings {
    Settings { resolution: Some(256), error: Some(2.0), ..Settings::default() }
}

fn rich() -> Settings {
    use LayerKind::{Ao, BentNormal, Direct, Emission, Error, Indirect, LightGroups, SkyVisibility};
    Settings {
        layers: vec![Direct, Indirect, Error, Emission, Ao, BentNormal, SkyVisibility, LightGroups],
        directional: Directional::Sh,
        encoding: Some(vec![Encoding::Exr, Encoding::Hdr]),
        probes: Some(ProbeSetting::Spacing(0.25)),
        ..plain()
    }
}

/// `settings` for one object alone, in other random numbers, so that what is baked anew can be told.
fn only(pattern: &str, settings: &Settings) -> Settings {
    Settings { only: vec![pattern.into()], seed: 5, ..settings.clone() }
}

/// What the cache holds beside openings, which are the same whatever is baked.
fn entries(cache: &Path) -> Vec<(String, std::path::PathBuf, u64)> {
    let items = Store::open(cache).unwrap().survey().unwrap().items;
    let mut all: Vec<_> = items
        .into_iter()
        .filter(|item| item.kind != "openings")
        .map(|item| (item.kind, item.path, item.size))
        .collect();
    all.sort();
    all
}

#[test]
fn kept_texels_stay_to_the_bit_and_selected_ones_are_as_a_bake_of_all_has_them() {
    let (folder, truth) = (Folder::new("bits"), Folder::new("truth"));
    let cache = folder.0.join(".lumel");
    let remembering = |settings: Settings| Settings { cache: Some(cache.clone()), ..settings };
    let first = bake(&cornell_box(), &folder.0, &remembering(rich()), &Silent).unwrap();
    let (width, before) = images(&folder.0);
    let hdr = || std::fs::read(folder.0.join("lightmaps/cornell_box_0.hdr")).unwrap();
    let (known, hdr_before) = (entries(&cache), hdr());
    let report: Report = bake(&cornell_box(), &folder.0, &remembering(only("tall_block", &rich())), &Silent).unwrap();
    let (_, after) = images(&folder.0);
    let ground = Ground::new(&cornell_box(), &rich());
    let fine = Settings { error: Some(0.5), seed: 77, probes: None, ..rich() };
    bake(&cornell_box(), &truth.0, &fine, &Silent).unwrap();
    let (_, fine) = images(&truth.0);

    assert_eq!(entries(&cache), known, "the bake remembers nothing of its own, and the last state stays");
    assert_ne!(hdr(), hdr_before);
    assert_eq!(before.len(), 1 + 7 + 1 + 4, "{:?}", before.iter().map(|image| &image.0).collect::<Vec<_>>());
    let is_tall = |i: usize| ground.name(i) == "tall_block";
    let count = (0..ground.patches.len()).filter(|&i| is_tall(i)).count();
    let told = report.only.as_ref().unwrap();
    assert_eq!([told.surfaces, told.baked_texels, told.kept_texels], [1, count, ground.patches.len() - count]);
    assert!(report.energy.is_empty() && report.rays < first.rays / 3, "{} of {}", report.rays, first.rays);
    assert_eq!(report.probes.unwrap().count, first.probes.unwrap().count);

    let stated = report.error.unwrap().estimated / 100.0;
    for (((name, old), (other, new)), (_, truth)) in before.iter().zip(&after).zip(&fine) {
        assert_eq!(name, other);
        let (mut pairs, mut fresh) = (Vec::new(), 0);
        for i in 0..ground.patches.len() {
            let [_, t] = ground.patches.texel(i).map(|n| n as usize);
            if is_tall(i) {
                pairs.push([new[t], truth[t]].map(|v| f64::from(luminance(v))).into());
                fresh += usize::from(bits(old[t]) != bits(new[t]));
            } else {
                assert_eq!(bits(old[t]), bits(new[t]), "{name}: a texel of {}", ground.name(i));
            }
        }
        let is_light = !matches!(&name[..], "error" | "emission") && !name.starts_with("sh1");
        if is_light {
            let (rms, bias) = differences(pairs);
            println!("{name}: rms {:.2} %, bias {:+.2} %, stated {:.2} %", 100.0 * rms, 100.0 * bias, 100.0 * stated);
            // Shadows of the lamp have their own tolerance, parts are noisier than the whole, and what surrounds a texel is not filtered.
            let (most, most_bias) = match &name[..] {
                "whole" => (1.5 * stated + 0.01, 0.01),
                "ao" | "bent-normal" | "sky-visibility" => (0.2, 0.02),
                _ => (0.06, 0.02),
            };
            assert!(rms < most && bias.abs() < most_bias || name.starts_with("bent"), "{name}: {rms} {bias}");
            // Off shadows direct light has no random numbers in it.
            assert!(fresh * 2 > count || name == "direct", "{name}: {fresh} of {count} were baked");
        }
    }
    kept_gutters(&ground, width, &before, &after, &is_tall);

    // The bake of all is remembered as it was.
    let again = bake(&cornell_box(), &folder.0, &remembering(rich()), &Silent).unwrap();
    assert!(again.reused["links"].anew == 0 && again.reused["direct"].anew == 0, "{:?}", again.reused);
    assert!(images(&folder.0).1 == before);
}

/// Gutters that lie beside kept charts, and out of the reach of selected ones, stay to the bit; those beside selected charts follow these.
fn kept_gutters(
    ground: &Ground,
    width: usize,
    before: &[(String, Vec<Rgb>)],
    after: &[(String, Vec<Rgb>)],
    is_selected: &dyn Fn(usize) -> bool,
) {
    let height = before[0].1.len() / width;
    let within = |t: usize, reach: i64, holds: &dyn Fn(usize) -> bool| {
        let (x, y) = ((t % width) as i64, (t / width) as i64);
        let rows = (y - reach).max(0)..(y + reach + 1).min(height as i64);
        rows.flat_map(|v| ((x - reach).max(0)..(x + reach + 1).min(width as i64)).map(move |u| (u, v)))
            .any(|(u, v)| ground.patches.at(0, v as usize * width + u as usize).is_some_and(holds))
    };
    let is_kept = |i: usize| !is_selected(i);
    let (mut kept, mut fresh) = (0, 0);
    for t in (0..width * height).filter(|&t| ground.patches.at(0, t).is_none()) {
        let stays = before.iter().zip(after).all(|((_, a), (_, b))| bits(a[t]) == bits(b[t]));
        if within(t, 1, &is_kept) && !within(t, ground.padding + 1, is_selected) {
            assert!(stays, "a gutter of kept texels at {} {}", t % width, t / width);
            kept += 1;
        }
        if within(t, 1, is_selected) && !within(t, ground.padding + 1, &is_kept) {
            fresh += usize::from(!stays);
        }
    }
    assert!(kept > 500 && fresh > 100, "{kept} kept, {fresh} fresh");
}

#[test]
fn kept_texels_send_their_light_on_by_the_albedo_of_now_and_selected_ones_may_be_looked_at_more_closely() {
    let folder = Folder::new("albedo");
    bake(&cornell_box(), &folder.0, &plain(), &Silent).unwrap();
    let (_, before) = images(&folder.0);
    // All but the red and the green wall.
    let black = MaterialEdit { name: "white".into(), albedo: Some([0.0; 3]), ..MaterialEdit::default() };
    let settings = Settings { materials: vec![black], error: Some(1.0), ..only("short_block", &plain()) };
    let report = bake(&cornell_box(), &folder.0, &settings, &Silent).unwrap();
    assert!(report.error.unwrap().estimated <= 1.0, "{:?}", report.error);
    let (_, after) = images(&folder.0);
    let ground = Ground::new(&cornell_box(), &plain());
    let light = |images: &[(String, Vec<Rgb>)], t: usize| f64::from(luminance(images[0].1[t]));
    let of_block = (0..ground.patches.len()).filter(|&i| ground.name(i) == "short_block");
    let pairs = of_block.map(|i| ground.patches.texel(i)[1] as usize).map(|t| (light(&after, t), light(&before, t)));
    let (_, bias) = differences(pairs.collect());
    assert!((-0.5..-0.2).contains(&bias), "black walls send nothing: {bias}");
}

/// A room of quads with a block in it, the last five, and a lamp.
fn furnished(block_albedo: f32) -> (Scene, Atlas) {
    let mut quads = room([4.0, 3.0, 5.0]);
    let [x, y, z] = [0.8, 0.6, 0.7];
    let at = |p: [f32; 3]| [p[0] + 1.5, p[1], p[2] + 2.0];
    let faces = [
        ([0.0, y, 0.0], [0., 0., z], [x, 0., 0.]),
        ([0.0, 0.0, 0.0], [0., 0., z], [0., y, 0.]),
        ([x, 0.0, 0.0], [0., y, 0.], [0., 0., z]),
        ([0.0, 0.0, 0.0], [0., y, 0.], [x, 0., 0.]),
        ([0.0, 0.0, z], [x, 0., 0.], [0., y, 0.]),
    ];
    quads.extend(faces.map(|(corner, u, v)| Quad::new(at(corner), u, v).albedo(block_albedo)));
    let mut scene = scene(&quads);
    let lamp = LightShape::Point { position: [3.0, 2.5, 4.0].into(), intensity: Rgb::splat(30.0), range: None };
    scene.lights.push(Light::new("lamp", lamp));
    (scene, atlas(quads.len(), 24))
}

fn geometric() -> Settings {
    Settings { normals: Normals::Geometric, error: Some(1.0), ..Settings::default() }
}

/// What an earlier bake leaves, and which of `count` surfaces are selected.
fn earlier(lit: &Illuminated, count: usize, selected: &dyn Fn(usize) -> bool) -> Earlier {
    Earlier { lightmap: lit.lightmap.clone(), known: (0..count).map(|s| !selected(s)).collect() }
}

fn bake_only(scene: &Scene, atlas: &Atlas, settings: &Settings, earlier: &Earlier) -> Illuminated {
    illuminate_only(scene, atlas, settings, earlier, &Work::unstored(), &Silent).unwrap()
}

#[test]
fn light_on_a_convex_object_does_not_depend_on_its_own_albedo_where_all_else_is_kept() {
    let (white, atlas) = furnished(0.8);
    let (black, _) = furnished(0.1);
    let first = illuminate(&white, &atlas, &geometric(), &Silent).unwrap();
    let count = white.surfaces.len();
    let earlier = earlier(&first, count, &|s| s >= 6);
    let second = bake_only(&black, &atlas, &Settings { seed: 3, ..geometric() }, &earlier);
    let on_block = |i: &usize| first.patches.surface(*i) >= 6 && first.exposure.area[*i] > 0.0;
    let light = |lit: &Illuminated, i: usize| f64::from(luminance(lit.gathered.irradiance[i]));
    let pairs = (0..first.patches.len()).filter(on_block).map(|i| (light(&second, i), light(&first, i)));
    let (rms, bias) = differences(pairs.collect());
    println!("rms {:.2} %, bias {:+.2} %", 100.0 * rms, 100.0 * bias);
    assert!(rms < 0.025 && bias.abs() < 0.006, "{rms} {bias}");
}

#[test]
fn a_selected_wall_of_a_furnace_is_one_whatever_pages_hold() {
    // Walls of emittance 1 - rho in units of pi: the light is 1 everywhere.
    let quads: Vec<Quad> = room([1.0, 0.8, 1.2]).into_iter().map(|q| q.albedo(0.6).emission(0.4)).collect();
    let (scene, atlas) = (scene(&quads), atlas(quads.len(), 24));
    for quantity in [Quantity::Outgoing, Quantity::Irradiance, Quantity::Radiosity] {
        let settings = Settings { quantity, ..geometric() };
        let first = illuminate(&scene, &atlas, &settings, &Silent).unwrap();
        let mut earlier = earlier(&first, quads.len(), &|s| s == 2);
        // What the pages are told is exact.
        let known = if quantity == Quantity::Outgoing { 1.0 } else { PI };
        earlier.lightmap.pages.iter_mut().flat_map(|page| &mut page.rgb).for_each(|v| *v = Rgb::splat(known));
        let second = bake_only(&scene, &atlas, &settings, &earlier);
        let (mut sum, mut count) = (0.0, 0.0);
        for i in (0..second.patches.len()).filter(|&i| second.patches.surface(i) == 2) {
            let light = f64::from(luminance(second.gathered.irradiance[i])) / std::f64::consts::PI;
            assert!((light - 1.0).abs() < 0.03, "{}: {light}", quantity.name());
            (sum, count) = (sum + light, count + 1.0);
            let [page, t] = second.patches.texel(i).map(|n| n as usize);
            let value = f64::from(luminance(second.lightmap.pages[page].rgb[t]));
            assert!((value / f64::from(known) - 1.0).abs() < 0.03, "{}: {value}", quantity.name());
        }
        assert!((sum / count - 1.0).abs() < 0.002, "{}: {}", quantity.name(), sum / count);
    }
}

#[test]
fn light_groups_are_sent_on_by_kept_texels_each_on_its_own() {
    let (mut scene, atlas) = furnished(0.5);
    let lamp = |name: &str, position: [f32; 3], group: &str| {
        let shape = LightShape::Point { position: position.into(), intensity: Rgb::splat(20.0), range: None };
        let mut light = Light::new(name, shape);
        light.contribution.group = Some(group.into());
        light
    };
    scene.lights = vec![lamp("a", [3.0, 2.5, 4.0], "warm"), lamp("b", [0.6, 1.0, 0.8], "cold")];
    let settings = Settings { layers: vec![LayerKind::LightGroups], ..geometric() };
    let first = illuminate(&scene, &atlas, &settings, &Silent).unwrap();
    let count = scene.surfaces.len();
    let second = bake_only(&scene, &atlas, &Settings { seed: 9, ..settings }, &earlier(&first, count, &|s| s >= 6));
    let layers = |lit: &Illuminated| lit.lightmap.layers.iter().map(|l| l.name.clone()).collect::<Vec<_>>();
    assert_eq!(layers(&first), ["group.cold", "group.warm"]);
    assert_eq!(layers(&second), layers(&first));
    let texel = |i: usize| second.patches.texel(i)[1] as usize;
    let on_block = |i: &usize| second.patches.surface(*i) >= 6 && second.exposure.area[*i] > 0.0;
    for (new, old) in second.lightmap.layers.iter().zip(&first.lightmap.layers) {
        let value = |pages: &[Vec<Rgb>], i: usize| f64::from(luminance(pages[0][texel(i)]));
        let all = (0..second.patches.len()).filter(on_block);
        let (rms, bias) = differences(all.map(|i| (value(&new.pages, i), value(&old.pages, i))).collect());
        println!("{}: rms {:.2} %, bias {:+.2} %", new.name, 100.0 * rms, 100.0 * bias);
        // Two bakes at 2 %, of which a group's part is noisier.
        assert!(rms < 0.035 && bias.abs() < 0.01, "{}: {rms} {bias}", new.name);
    }
    for i in (0..second.patches.len()).filter(on_block) {
        let t = texel(i);
        let sum: Rgb = second.lightmap.layers.iter().map(|l| l.pages[0][t]).sum();
        let whole = second.lightmap.pages[0].rgb[t];
        assert!((sum - whole).abs().max_element() < 2e-3 * whole.max_element(), "{sum} {whole}");
    }
}

#[test]
fn a_usd_stage_has_its_layer_and_vertex_colours_of_both() {
    let stage = cornell_box().with_extension("usda");
    let folder = Folder::new("usd");
    bake(&stage, &folder.0, &Settings { resolution: Some(128), ..plain() }, &Silent).unwrap();
    let layer = || std::fs::read_to_string(folder.0.join("cornell_box.lumel.usda")).unwrap();
    let before = layer();
    let settings = Settings { resolution: Some(128), ..only("*tall*", &plain()) };
    let report = bake(&stage, &folder.0, &settings, &Silent).unwrap();
    let after = layer();
    assert!(report.only.is_some_and(|only| only.kept_texels > only.baked_texels));
    let colours = |text: &str| -> Vec<String> {
        text.lines().filter(|line| line.contains("displayColor")).map(str::to_owned).collect()
    };
    let (before, after) = (colours(&before), colours(&after));
    assert_eq!(before.len(), after.len());
    let changed = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!(changed >= 1 && changed < before.len(), "{changed} of {}", before.len());
}

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    let folder = Folder::new("refused");
    folder.write("box.glb", std::fs::read(cornell_box()).unwrap());
    let base = ["bake", "box.glb", "-o", "baked", "--resolution", "64", "--error", "5%"];
    let run = |more: &[&str]| folder.run(&[&base[..], more].concat());
    assert_fails_cleanly(&run(&["--only", "lamp"]), "bake all objects first");
    assert_eq!(run(&[]).status.code(), Some(0));
    let page = || std::fs::read(folder.0.join("baked/lightmaps/box_0.exr")).unwrap();
    let before = page();
    for (more, words) in [
        (&["--only", "chair"][..], "chair matches no object"),
        (&["--only", "**"], "matches every object"),
        (&["--only", "lamp", "--quantity", "irradiance"], "quantity"),
        (&["--only", "lamp", "--normals", "geometric"], "normals"),
        (&["--only", "lamp", "--layers", "ao"], "ao: is a layer"),
        (&["--only", "lamp", "--directional", "sh"], "sh0: is a layer"),
        (&["--only", "lamp", "--padding", "5"], "texels don't lie where"),
    ] {
        assert_fails_cleanly(&run(more), words);
    }
    for (more, word) in [
        (&["--method", "path"][..], "--only"),
        (&["--gather", "final"], "--only"),
        (&["--max-bounces", "3"], "--max-bounces"),
        (&["--caustics"], "--caustics"),
        (&["--layers", "bounces"], "--layers"),
        (&["--bake-lights", "indirect"], "--bake-lights"),
        (&["--shard", "1/2", "--cache", "c"], "--only"),
    ] {
        let output = run(&[&["--only", "lamp"], more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(word), "{more:?}: {}", stderr(&output));
    }
    folder.write("lumel.toml", "only = [\"lamp\"]\n");
    assert_fails_cleanly(&folder.run(&["form-factors", "box.glb"]), "only: selects whose light is baked");
    assert!(page() == before, "nothing was written");
    // The file selects as the command line does.
    let output = run(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains(" surface(s), kept "), "{}", stderr(&output));
}
