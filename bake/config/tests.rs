//! Files and command lines, laid over each other.

use super::*;
use crate::args::{Args, Command};
use clap::Parser;
use lumel::post::Quantity;
use lumel::settings::{Quality, SkySetting};
use lumel::unwrap::UvMode;
use lumel::write::GltfProfile;
use lumel::write::encode::Encoding;
use lumel::write::engines::LightmapExtension;

fn typed(line: &str) -> Table {
    let args = Args::try_parse_from(["lumel", "bake", "room.glb"].into_iter().chain(line.split_whitespace())).unwrap();
    let Command::Bake(bake) = args.command else { panic!("not a bake") };
    bake.table().unwrap()
}

fn layered(file: &str, line: &str) -> Settings {
    settle(parse(file, Path::new("lumel.toml")).unwrap(), typed(line)).unwrap()
}

fn complaint(file: &str) -> String {
    parse(file, Path::new("a/lumel.toml")).unwrap_err().to_string()
}

#[test]
fn a_mistyped_key_is_told_its_nearest() {
    assert_eq!(complaint("sampels = 3\n"), "a/lumel.toml:1: unknown field `sampels`: did you mean `samples`?");
    assert!(complaint("wxyz = 3\n").contains("expected one of"), "{}", complaint("wxyz = 3\n"));
    assert_eq!(complaint("quality = \"hihg\"\n").split(": ").last(), Some("did you mean `high`?"));
    assert_eq!((edits("kitten", "sitting"), edits("", "abc"), edits("same", "same")), (3, 3, 0));
}

#[test]
fn absent_flags_are_absent_keys() {
    assert!(typed("").is_empty());
}

#[test]
fn the_command_line_wins_over_the_file_and_the_file_over_the_defaults() {
    let file = "quality = \"high\"\nseed = 7\nfloat = true\nmax-bounces = 3\nuv = \"new\"\n";
    let s = layered(file, "--seed 9 --float=false");
    assert_eq!((s.quality, s.seed, s.float, s.max_bounces, s.uv), (Quality::High, 9, false, Some(3), UvMode::New));
    assert_eq!(s.samples, None);
    let s = layered(file, "");
    assert_eq!((s.seed, s.float), (7, true));
}

#[test]
fn every_setting_has_its_option() {
    let line = "--quality draft --resolution 256 --max-pages 2 --padding 3 --mips 2 --align 4 --min-chart 2 --unwrapper uvunwrap --uv keep --uv-name st1 --normals geometric \
                --quantity irradiance --float --max-bounces 4 --seed 5 --threads 2 --sky 1,2,0.1 --sun 40,180,8e4 \
                --gltf engine,vertex --vertex-colors u16 --lights remove --bake-lights indirect --ao-distance 2 --dump-stages d --overwrite --solver progressive --form-factors hemicube --hemicube 32 \
                --elements 100 --iterations 7 --overshoot=false --ambient=false --caustics=false --gather auto --directional sh --probes 2 --layers direct,ao --watch w \
                --watch-every 3 --variant /a:b=c --subdivide 1 --purpose proxy --confine d \
                --strict --max-texture 9 --max-texels 9 --max-memory 4G --for bevy --encoding exr,ktx2-half \
                --gltf-lightmap-ext moz --adaptive-density --denoise oidn --oidn-library f --seams surface --gutter padding";
    let mut keys: Vec<String> = typed(line).keys().cloned().collect();
    keys.extend(
        typed(
            "--density 2 --page-size 512 --pages free --environment e.hdr --method path --link-error 1e-6 --samples 64 \
               --error 2% --time-budget 5 --surfaces diffuse --time 1.5 --animation walk --mesh adaptive --vertex-error 3% --max-triangles 9",
        )
        .keys()
        .cloned(),
    );
    keys.sort();
    keys.dedup();
    // Not through TOML: it has no null for a value that is absent.
    let all = serde_json::to_value(Settings::default()).unwrap();
    let mut expected: Vec<String> = all.as_object().unwrap().keys().cloned().collect();
    expected.sort();
    assert_eq!(keys, expected);
    let s = layered("", line);
    assert_eq!(s.sky, Some(SkySetting::Constant([1.0, 2.0, 0.1])));
    assert_eq!(s.gltf.as_deref(), Some([GltfProfile::Engine, GltfProfile::Vertex].as_slice()));
    assert_eq!(s.vertex_colors, lumel::write::VertexColors::U16);
    assert_eq!(s.threads, Some(2));
    assert_eq!((s.max_memory, s.strict), (Some(4 << 30), true));
}

#[test]
fn an_engine_chooses_what_is_not_given() {
    let s = layered("", "--for needle");
    assert_eq!((s.quantity, s.encodings()), (Quantity::Irradiance, vec![Encoding::RgbmSrgb]));
    assert_eq!(s.gltf_lightmap_ext, Some(LightmapExtension::Needle));
    let s = layered("for = \"bevy\"", "--quantity irradiance");
    assert_eq!((s.quantity, s.encodings()), (Quantity::Irradiance, vec![Encoding::Ktx2Half]));
    let s = layered("quantity = \"irradiance\"\nencoding = [\"hdr\"]", "--for unity");
    assert_eq!((s.quantity, s.encodings()), (Quantity::Outgoing, vec![Encoding::Exr]));
    let s = layered("", "--gltf-lightmap-ext moz");
    assert_eq!(s.encodings(), [Encoding::Exr, Encoding::Hdr]);
}

#[test]
fn an_option_takes_the_place_of_the_files_alternative() {
    let s = layered("density = 32.0\npage-size = 512", "--resolution 256");
    assert_eq!((s.resolution, s.density, s.page_size), (Some(256), None, None));
    let s = layered("solver = \"jacobi\"\niterations = 4\nwatch = \"w\"", "--method path");
    assert_eq!((s.solver, s.iterations, s.watch), (lumel::solve::Solver::Auto, None, None));
    let s = layered("overshoot = true\niterations = 4", "--solver jacobi");
    assert_eq!((s.overshoot, s.iterations), (false, Some(4)));
    let s = layered("sky = \"clear,2\"\nsun = [30.0, 90.0, 50000.0]", "");
    assert_eq!((s.sky, s.sun), (Some(SkySetting::Clear { turbidity: 2.0 }), Some([30.0, 90.0, 5e4])));
    assert!(complaint("sky = \"clear\"").contains("sun"));
    let s = layered("environment = \"sky.hdr\"", "--sky 1,1,1");
    assert!(s.environment.is_none() && s.sky.is_some());
}

#[test]
fn a_mistake_in_the_file_names_file_line_and_key() {
    let e = complaint("seed = 1\nqualty = \"high\"\n");
    assert!(e.starts_with("a/lumel.toml:2: ") && e.contains("qualty"), "{e}");
    let e = complaint("# a comment\n\nresolution = \"big\"\n");
    assert!(e.starts_with("a/lumel.toml:3: resolution: "), "{e}");
    let e = complaint("seed = 1\nresolution = 4\n");
    assert!(e.starts_with("a/lumel.toml:2: resolution: 4 is out of range"), "{e}");
    let e = complaint("sky = [\n  1.0,\n  \"x\",\n  1.0]\n");
    assert!(e.contains("sky"), "{e}");
    let e = complaint("seed = = 1\n");
    assert!(e.starts_with("a/lumel.toml:1"), "{e}");
}

#[test]
fn out_of_range_options_name_the_option() {
    let e = settle(Table::new(), typed("--resolution 4")).unwrap_err().to_string();
    assert!(e.starts_with("--resolution: 4 is out of range"), "{e}");
}

#[test]
fn what_would_do_nothing_is_refused() {
    let e = settle(Table::new(), typed("--gltf engine --vertex-colors u8")).unwrap_err().to_string();
    assert!(e.starts_with("--vertex-colors: is for the GLB vertex"), "{e}");
    assert!(settle(Table::new(), typed("--gltf engine --vertex-colors float")).is_ok());
}

#[test]
fn paths_in_the_file_are_relative_to_it() {
    let dir = std::env::temp_dir().join(format!("lumel-config-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let path = dir.join("lumel.toml");
    let projector = "[[projectors]]\nlight = \"*\"\npicture = \"slides/a.png\"\nfov = 30\n";
    let medium = "[[medium]]\ngrid = \"smoke.npz\"\nsigma_s = [1, 2, 3]\n";
    std::fs::write(&path, format!("environment = \"sky/day.hdr\"\n{projector}{medium}")).unwrap();
    let settings = settle(read(&path).unwrap(), typed("")).unwrap();
    assert_eq!(settings.environment, Some(dir.join("sky/day.hdr")));
    assert_eq!(settings.projectors[0].picture, dir.join("slides/a.png"));
    assert_eq!(settings.projectors[0].fov, Some(30.0));
    assert_eq!(settings.media[0].grid, Some(dir.join("smoke.npz")));
    std::fs::remove_dir_all(dir).unwrap();
}
