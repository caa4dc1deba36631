//! The command itself: exit codes, one clear line for what goes wrong, nothing left half done.

mod command;

use command::{Folder, assert_fails_cleanly, glb, grid, stderr, stdout};
use std::path::Path;
use std::process::{Command, Stdio};

/// A page of one colour, fully covered.
fn write_page(path: &Path, size: (usize, usize), value: f32) {
    exr::prelude::write_rgba_file(path, size.0, size.1, |_, _| (value, value, value, 1.0f32)).unwrap();
}

#[test]
fn usage_errors_exit_with_2() {
    let f = Folder::new("usage");
    f.write("a.glb", "");
    let cases: &[&[&str]] = &[
        &[],
        &["bake"],
        &["bak", "a.glb"],
        &["bake", "a.glb", "--bogus"],
        &["bake", "a.glb", "--quality", "best"],
        &["bake", "a.glb", "--samples", "many"],
        &["bake", "a.glb", "--sky", "1,2"],
        &["bake", "a.glb", "--sky", "1,1,-1"],
        &["bake", "a.glb", "--resolution", "4"],
        &["bake", "a.glb", "--resolution", "256", "--density", "3"],
        &["bake", "a.glb", "--sky", "1,1,1", "--environment", "e.hdr"],
        &["bake", "a.glb", "--gltf", "engine,webgl"],
        &["bake", "a.glb", "--config", "missing.toml"],
        &["compare", "a.exr"],
        &["compare", "a.exr", "b.exr", "--range", "0"],
        &["completions", "cmd"],
    ];
    for args in cases {
        let output = f.run(args);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(!text.is_empty() && !text.contains("panic"), "{args:?}: {text}");
    }
    assert_eq!(f.entries(), ["a.glb"]);
}

#[test]
fn help_says_units_and_defaults_and_version_says_the_version() {
    let f = Folder::new("help");
    let output = f.run(&["bake", "--help"]);
    assert_eq!(output.status.code(), Some(0));
    let help = stdout(&output);
    for text in
        ["[nit", "[lx]", "texels per metre", "16..16384", "default: medium", "E / pi", "Lightmap UVs:", "Effort:"]
    {
        assert!(help.contains(text), "{text}");
    }
    let output = f.run(&["--help"]);
    let help = stdout(&output);
    for command in ["bake", "unwrap", "inspect", "compare", "cache", "completions", "130 interrupted"] {
        assert!(help.contains(command), "{command}");
    }
    let version = stdout(&f.run(&["--version"]));
    assert_eq!(version.trim(), format!("lumel {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn completions_name_the_commands() {
    let f = Folder::new("completions");
    for shell in ["bash", "zsh", "fish"] {
        let output = f.run(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0));
        assert!(stdout(&output).contains("inspect"), "{shell}");
    }
}

#[test]
fn a_closed_pipe_is_quiet() {
    let f = Folder::new("pipe");
    let mut child = f.command(&["completions", "zsh"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()));
}

#[test]
fn scenes_that_cannot_be_read_fail_with_one_line_and_leave_nothing() {
    let f = Folder::new("unreadable");
    let sound = grid(4, true);
    f.write("truncated.glb", &sound[..sound.len() / 2]);
    f.write("header.glb", &sound[..10]);
    f.write("scene.obj", "v 0 0 0");
    f.write("noextension", "v 0 0 0");
    for name in ["empty.glb", "empty.gltf", "empty.usda", "empty.usdc", "empty.usdz", "empty.usd"] {
        f.write(name, "");
    }
    f.write("nothing.glb", glb(r#"{"asset":{"version":"2.0"}}"#, &[]));
    std::fs::create_dir(f.0.join("folder.glb")).unwrap();
    let before = f.entries();
    let mut names = before.clone();
    names.extend(["missing.glb", "missing.usda"].map(String::from));
    for name in &names {
        for command in ["bake", "unwrap", "inspect"] {
            assert_fails_cleanly(&f.run(&[command, name]), name);
            assert_eq!(f.entries(), before, "{command} {name}");
        }
        assert_fails_cleanly(&f.run(&["bake", name, "-o", "deep/out"]), name);
        assert_eq!(f.entries(), before, "{name}");
    }
}

#[test]
fn every_prefix_of_a_glb_fails_cleanly() {
    let f = Folder::new("prefixes");
    let sound = grid(1, true);
    for length in (0..sound.len()).step_by(97) {
        f.write("cut.glb", &sound[..length]);
        assert_fails_cleanly(&f.run(&["inspect", "cut.glb"]), "cut.glb");
    }
}

#[test]
fn a_wrong_config_names_file_line_and_key() {
    let f = Folder::new("config");
    f.write("a.glb", grid(1, true));
    f.write("lumel.toml", "quality = \"draft\"\n\ndensty = 3.0\n");
    let output = f.run(&["bake", "a.glb"]);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.starts_with("error: ") && text.contains("lumel.toml:3") && text.contains("densty"), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    f.write("other.toml", "padding = 900\n");
    let text = stderr(&f.run(&["bake", "a.glb", "--config", "other.toml"]));
    assert!(text.contains("other.toml:1: padding: 900 is out of range"), "{text}");
    assert_eq!(f.entries(), ["a.glb", "lumel.toml", "other.toml"]);
}

#[test]
fn json_errors_are_one_object() {
    let f = Folder::new("json");
    for flags in [&["--log-format", "json"][..], &["--quiet", "--log-format", "json"]] {
        let args: Vec<&str> = ["bake", "missing.glb"].iter().chain(flags).copied().collect();
        let output = f.run(&args);
        assert_eq!(output.status.code(), Some(1));
        let text = stderr(&output);
        let events: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        let last = events.last().unwrap();
        assert_eq!(last["event"], "error");
        assert!(last["message"].as_str().unwrap().contains("missing.glb"), "{text}");
        assert!(flags[0] != "--quiet" || events.len() == 1, "{text}");
    }
}

#[test]
fn results_never_replace_the_input() {
    let f = Folder::new("replace");
    let bytes = grid(2, true);
    let path = f.write("a.glb", &bytes);
    let output = f.run(&["bake", "a.glb", "-o", ".", "--overwrite"]);
    assert_fails_cleanly(&output, "a.glb");
    assert!(stderr(&output).contains("would be replaced"));
    assert_eq!(std::fs::read(path).unwrap(), bytes);
    assert_eq!(f.entries(), ["a.glb"]);
}

#[test]
fn a_page_compared_with_itself_gives_zeros() {
    let f = Folder::new("compare");
    write_page(&f.0.join("a.exr"), (8, 4), 0.5);
    write_page(&f.0.join("b.exr"), (8, 4), 0.4);
    write_page(&f.0.join("small.exr"), (4, 4), 0.5);
    let output = f.run(&["compare", "a.exr", "a.exr", "--json", "-o", "error.png"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let figures: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    for name in ["bias", "rel_rmse", "rel_rmse_trim", "p50", "p95", "p99", "max"] {
        assert_eq!(figures[name], 0.0, "{name}");
    }
    assert_eq!((&figures["texels"], &figures["only_a"]), (&32.into(), &0.into()));
    let picture = image::open(f.0.join("error.png")).unwrap().to_rgb8();
    assert!(picture.dimensions() == (8, 4) && picture.pixels().all(|p| p.0 == [255; 3]));

    let output = f.run(&["compare", "a.exr", "b.exr"]);
    assert!(stdout(&output).contains("25 %"), "{}", stdout(&output));
    let output = f.run(&["compare", "a.exr", "small.exr"]);
    assert_fails_cleanly(&output, "a.exr");
    assert!(stderr(&output).contains("8 x 4") && stderr(&output).contains("4 x 4"));
    assert_fails_cleanly(&f.run(&["compare", "a.exr", "missing.exr"]), "missing.exr");
    let output = f.run(&["compare", "a.exr", "b.exr", "-o", "b.exr"]);
    assert_eq!(output.status.code(), Some(2));
}

// From here on a loader is needed.

#[test]
fn inspect_shows_areas_and_lights_with_units() {
    let f = Folder::new("inspect");
    f.write("a.glb", grid(2, true));
    let output = f.run(&["inspect", "a.glb", "--density", "10"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = stdout(&output);
    for word in ["ground", "grid", "clay", "m^2", "point", "cd", "lm", "texels per metre"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let json: serde_json::Value = serde_json::from_str(&stdout(&f.run(&["inspect", "a.glb", "--json"]))).unwrap();
    assert_eq!(json["triangles"], 8);
    let area = json["area"].as_f64().unwrap();
    assert!(area > 4.0 && (area - json["surfaces"][0]["area"].as_f64().unwrap()).abs() < 1e-9);
    assert_eq!((&json["lights"][0]["kind"], &json["lights"][0]["unit"]), (&"point".into(), &"cd".into()));
    let power = json["lights"][0]["power"].as_f64().unwrap();
    assert!((power - 400.0 * std::f64::consts::PI).abs() < 0.01, "{power}");
}

// From here on the pipeline is needed.

#[test]
fn a_scene_without_light_names_the_flags_that_give_some() {
    let f = Folder::new("dark");
    f.write("dark.glb", grid(1, false));
    let output = f.run(&["bake", "dark.glb"]);
    assert_fails_cleanly(&output, "dark.glb");
    let text = stderr(&output);
    assert!(text.contains("--sky") && text.contains("--environment"), "{text}");
    assert_eq!(f.entries(), ["dark.glb"]);
}

#[test]
fn a_bake_writes_its_folder_and_says_so() {
    let f = Folder::new("bake");
    f.write("a.glb", grid(2, true));
    f.write("lumel.toml", "resolution = 64\nsamples = 16\n");
    let output = f.run(&["bake", "a.glb", "--threads", "2"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(output.stdout.is_empty());
    assert!(stderr(&output).contains("wrote a_baked in"), "{}", stderr(&output));
    for name in ["a.glb", "a.vertex.glb", "report.json", "lightmaps/a_0.exr"] {
        assert!(f.0.join("a_baked").join(name).is_file(), "{name}");
    }
    assert!(!f.0.join("a_baked/.lumel-partial").exists());
    let report = std::fs::read_to_string(f.0.join("a_baked/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["settings"]["resolution"], 64);

    let output = f.run(&["bake", "a.glb", "--quiet"]);
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()), "a second run, and quiet");
    let output = f.run(&["bake", "a.glb", "--log-format", "json"]);
    let text = stderr(&output);
    let events: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert!(events.iter().any(|e| e["event"] == "stage" && e["name"].is_string()), "{text}");
    assert_eq!(events.last().unwrap()["event"], "done", "{text}");
    let page = "a_baked/lightmaps/a_0.exr";
    assert_eq!(f.run(&["compare", page, page]).status.code(), Some(0));
}

/// The report of a bake of `a.glb` with `flags`, and what was said.
fn reported(f: &Folder, flags: &[&str]) -> (serde_json::Value, String) {
    let args: Vec<&str> =
        ["bake", "a.glb", "--resolution", "64", "--quality", "draft"].iter().chain(flags).copied().collect();
    let output = f.run(&args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = std::fs::read_to_string(f.0.join("a_baked/report.json")).unwrap();
    (serde_json::from_str(&report).unwrap(), stderr(&output))
}

#[test]
fn light_beyond_half_floats_is_held_and_balanced() {
    let f = Folder::new("bright");
    f.write("a.glb", grid(2, false));
    let sun = ["--sun", "60,120,900000", "--sky", "100,100,100"];
    let with = |more: &[&str]| reported(&f, &[&sun[..], more].concat());
    let note = || std::fs::read_to_string(f.0.join("a_baked/a.loading.txt")).unwrap();
    let (report, said) = with(&["--for", "three"]);
    assert_eq!(report["pages"][0]["samples"], "float");
    assert!(said.contains("written as 32-bit floats") && !said.contains("does not close"), "{said}");
    assert!(report["energy"]["imbalance"].as_f64().unwrap().abs() < 0.01, "{}", report["energy"]);
    assert!(!report["warnings"].to_string().contains("half"), "{}", report["warnings"]);
    assert!(note().contains("THREE.FloatType"), "{}", note());
    let (report, said) = with(&["--for", "bevy"]);
    let scale = report["encodings"][0]["scale"].as_f64().unwrap();
    assert!(scale > 1.0 && note().contains(&format!("lightmap_exposure = {scale}")), "{scale}: {}", note());
    assert!(!report["warnings"].to_string().contains("can hold") && !said.contains("does not close"), "{said}");
    let (report, said) = reported(&f, &["--sky", "100,100,100", "--for", "three"]);
    assert_eq!(report["pages"][0]["samples"], "half");
    assert!(!said.contains("32-bit") && !note().contains("FloatType"), "{said}");
}

#[test]
fn settings_that_do_nothing_are_told() {
    let f = Folder::new("idle");
    f.write("a.glb", grid(2, false));
    let (report, _) = reported(&f, &["--lights", "remove", "--vertex-error", "3%", "--sky", "100,100,100"]);
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("no lights that could be removed") && warnings.contains("vertex-error"), "{warnings}");
    f.write("a.glb", grid(2, true));
    let (report, _) = reported(&f, &["--mesh", "adaptive", "--max-triangles", "1"]);
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("max-triangles 1 (given:"), "{warnings}");
    assert_eq!(report["vertices"]["triangles"], report["vertices"]["given_triangles"]);
    let (report, _) = reported(&f, &["--mesh", "adaptive", "--lights", "mark"]);
    assert!(!report["warnings"].to_string().contains("triangle"), "{}", report["warnings"]);
}

#[test]
fn messages_name_what_stands_in_the_way() {
    let f = Folder::new("way");
    f.write("a.glb", grid(2, true));
    f.write("file", "");
    let text = stderr(&f.run(&["bake", "a.glb", "-o", "file/below"]));
    assert!(text.contains("output folder can't be made") && text.contains("-o"), "{text}");
    let text = stderr(&f.run(&["bake", "a.glb", "--error", "2%", "--method", "path"]));
    assert!(text.contains("--error") && text.contains("method path"), "{text}");
    let text = stderr(&f.run(&["bake", "a.glb", "--error", "2%", "--hemicube", "32", "--form-factors", "hemicube"]));
    assert!(text.contains("--error") && text.contains("form-factors"), "{text}");
}

#[test]
fn an_error_or_time_that_cannot_be_had_is_refused() {
    let f = Folder::new("error-refused");
    f.write("a.glb", grid(2, true));
    let cases: &[(&[&str], &str)] = &[
        (&["--error", "0"], "0.05 to 50"),
        (&["--error", "50.1%"], "0.05 to 50"),
        (&["--error=-1"], "0.05 to 50"),
        (&["--error", "nan"], "0.05 to 50"),
        (&["--error", "inf"], "0.05 to 50"),
        (&["--error", "little"], "percentage"),
        (&["--error", ""], "percentage"),
        (&["--error", "2%", "--gather", "final"], "--error"),
        (&["--error", "2%", "--gather", "none"], "--error"),
        (&["--error", "2%", "--samples", "16"], "--error"),
        (&["--error", "2%", "--elements", "100"], "--error"),
        (&["--error", "2%", "--layers", "light-groups", "--gather", "final"], "--layers"),
        (&["--error", "2%", "--method", "path"], "--error"),
        (&["--error", "2%", "--method", "photon"], "and method photon goes"),
        (&["--time-budget", "0"], "0.1 to 1000000"),
        (&["--time-budget", "5", "--gather", "final"], "--time-budget"),
        (&["--gather", "blocks", "--solver", "jacobi"], "--gather"),
        (&["--gather", "blocks", "--form-factors", "hemicube"], "--gather"),
        (&["--gather", "blocks", "--samples", "16"], "--gather"),
        (&["--gather", "blocks", "--method", "path"], "--gather"),
    ];
    for (flags, said) in cases {
        let args: Vec<&str> = ["bake", "a.glb"].iter().chain(*flags).copied().collect();
        let output = f.run(&args);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{flags:?}: {text}");
        assert_eq!(text.lines().count(), 1, "{flags:?}: {text}");
        assert!(text.starts_with("error: ") && text.contains(said), "{flags:?}: {text}");
    }
    f.write("lumel.toml", "quality = \"draft\"\nerror = \"90 %\"\n");
    let output = f.run(&["bake", "a.glb"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("lumel.toml:2: error"), "{}", stderr(&output));
    assert_eq!(f.entries(), ["a.glb", "lumel.toml"]);
}

#[test]
fn an_error_is_read_in_any_form_and_stated() {
    let f = Folder::new("error-forms");
    f.write("a.glb", grid(2, true));
    let report = || -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(f.0.join("a_baked/report.json")).unwrap()).unwrap()
    };
    let base = ["bake", "a.glb", "--resolution", "32"];
    let stated = |flags: &[&str]| {
        let args: Vec<&str> = base.iter().chain(flags).copied().collect();
        let output = f.run(&args);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(stderr(&output).contains("estimated error"), "{}", stderr(&output));
        let report = report();
        let error = &report["error"];
        let [aimed, estimated, noise, bias] =
            ["aimed", "estimated", "noise", "bias"].map(|key| error[key].as_f64().unwrap());
        assert!((noise.hypot(bias) - estimated).abs() < 1e-6 * estimated.max(1.0), "{error}");
        assert_eq!(report["solver"]["name"], "links");
        (aimed, estimated)
    };
    for form in ["4%", "4 %", "4", "4.0", " 4% "] {
        let (aimed, estimated) = stated(&["--error", form]);
        assert!(aimed == 4.0 && estimated < 2.0 * aimed, "{form:?}: {aimed} {estimated}");
    }
    for form in ["\"4%\"", "\"4 %\"", "4", "4.0"] {
        f.write("lumel.toml", format!("error = {form}\n"));
        assert_eq!(stated(&[]).0, 4.0, "{form}");
    }
    assert_eq!(stated(&["--error", "3%"]).0, 3.0, "the command line comes before the file");
    std::fs::remove_file(f.0.join("lumel.toml")).unwrap();
    for (quality, percent) in [("draft", 5.0), ("medium", 2.0), ("high", 1.0), ("production", 0.5)] {
        // Presets take so many samples and no more: what they came to is stated, whatever they aim at.
        assert_eq!(stated(&["--quality", quality]).0, percent, "{quality}");
    }
    // The reference has noise, and no aim.
    let args: Vec<&str> = base.iter().chain(&["--gather", "final", "--samples", "16"]).copied().collect();
    let output = f.run(&args);
    assert!(output.status.success() && !stderr(&output).contains("estimated error"), "{}", stderr(&output));
    assert!(report()["error"].is_null());
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_ends_within_a_second_and_leaves_nothing() {
    use std::time::{Duration, Instant};
    let f = Folder::new("interrupt");
    f.write("big.glb", grid(150, true));
    for (signal, before) in [("-INT", 1500), ("-TERM", 600), ("-INT", 3500)] {
        let mut child = f
            .command(&["bake", "big.glb", "--quality", "production", "--samples", "65536", "--no-cache"])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(before));
        assert!(child.try_wait().unwrap().is_none(), "the bake ended before it could be interrupted");
        let id = child.id().to_string();
        let start = Instant::now();
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
        // Not a second longer than promised, plus what a loaded machine needs to let the process die.
        while child.try_wait().unwrap().is_none() {
            assert!(
                start.elapsed() < Duration::from_millis(1500),
                "it still runs {:?} after {signal}",
                start.elapsed()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = child.wait_with_output().unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(130), "{text}");
        assert_eq!(text.lines().last(), Some("interrupted"), "{text}");
        assert_eq!(f.entries(), ["big.glb"], "after {signal} at {before} ms");
    }
}
