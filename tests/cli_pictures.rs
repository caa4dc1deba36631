//! `lumel render` as it is called: what it says, and when it ends.

mod command;

use command::{Folder, assert_fails_cleanly, grid, stderr};
use std::process::{Command, Stdio};

#[test]
fn a_picture_is_taken_whatever_a_file_says_of_bakes() {
    let f = Folder::new("picture");
    f.write("a.glb", grid(2, true));
    f.write("lumel.toml", "error = \"2%\"\nlayers = [\"bounces\"]\nresolution = 64\nmax-bounces = 1\n");
    let view = ["render", "a.glb", "--camera", "1,3,1,1,0,1.01,60", "--size", "8x6", "--samples", "2"];
    let output = f.run(&view);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("8 x 6 pixels, 2 samples each"), "{}", stderr(&output));
    assert_eq!(f.entries(), ["a.exr", "a.glb", "a.png", "lumel.toml"]);

    let fails = |flags: &[&str], said: &str| {
        let output = f.run(&[&["render", "a.glb", "--quiet"], flags].concat());
        let text = stderr(&output);
        assert!(!output.status.success() && text.starts_with("error: ") && text.contains(said), "{flags:?}: {text}");
    };
    fails(&[], "has no camera");
    fails(&["--camera", "front"], "there is no camera front");
    fails(&["--camera", "1,2,3,1,2,3,60"], "looks nowhere");
    fails(&["--camera", "1,2,3,0,0,0,200"], "200 degrees");
    fails(&["--camera", "1,2,3"], "seven numbers");
    fails(&["--camera", "1,3,1,1,0,1.01,60", "-o", "a.glb"], "would be replaced");
    fails(&["--camera", "1,3,1,1,0,1.01,60", "-o", "a.jpg"], "no .exr file");
    fails(&["--camera", "1,3,1,1,0,1.01,60", "-o", "a.glb/a.exr"], "a.glb");
    fails(&["--camera", "1,3,1,1,0,1.01,60", "--size", "9000", "--max-memory", "64M"], "--size");
    fails(&["--camera", "1,3,1,1,0,1.01,60", "--final-gather"], "names no lightmaps");
    let output = f.run(&[&view[..], &["-o", "new/folder/a.exr"]].concat());
    assert!(output.status.success() && f.0.join("new/folder/a.png").is_file(), "{}", stderr(&output));
}

#[test]
fn pictures_of_nothing_lit_say_so() {
    let f = Folder::new("dark-picture");
    f.write("dark.glb", grid(2, false));
    f.write("a.glb", grid(2, true));
    let down = ["--camera", "1,3,1,1,0,1.01,60", "--size", "8x6"];
    let output = f.run(&[&["render", "dark.glb"], &down[..]].concat());
    assert_fails_cleanly(&output, "the scene has no light; give it a sky");
    let away = ["render", "a.glb", "--camera", "1,3,1,1,9,1.01,60", "--size", "8x6", "--samples", "4"];
    let output = f.run(&away);
    let text = stderr(&output);
    assert!(output.status.success() && text.contains("sees nothing that is lit"), "{text}");
    assert!(text.contains("noise unknown") && !text.contains("% of the mean"), "{text}");
    let one = f.run(&[&["render", "a.glb", "--samples", "1"], &down[..]].concat());
    assert!(stderr(&one).contains("noise unknown") && !stderr(&one).contains("lit"), "{}", stderr(&one));
    let more = f.run(&[&["render", "a.glb", "--samples", "16"], &down[..]].concat());
    assert!(stderr(&more).contains("% of the mean"), "{}", stderr(&more));
}

#[test]
fn a_picture_ends_with_its_time() {
    use std::time::{Duration, Instant};
    let f = Folder::new("budget");
    f.write("a.glb", grid(20, true));
    for method in ["path", "bidirectional", "metropolis", "photon"] {
        let start = Instant::now();
        let mut child = f
            .command(&[
                "render",
                "a.glb",
                "--camera",
                "10,30,10,10,0,10.01,60",
                "--size",
                "64x48",
                "--log-format",
                "json",
            ])
            .args(["--time-budget", "4", "--method", method])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        while child.try_wait().unwrap().is_none() {
            // Without a clock it would never end.
            if start.elapsed() > Duration::from_secs(20) {
                child.kill().unwrap();
                panic!("{method} still runs after 20 s of 4");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let took = start.elapsed().as_secs_f64();
        let text = stderr(&child.wait_with_output().unwrap());
        assert!((2.0..8.0).contains(&took), "{method} took {took} s: {text}");
        let events: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        let left = events.iter().filter(|e| e["event"] == "progress").find_map(|e| e["seconds_left"].as_f64());
        assert!(left.is_some_and(|left| left < 2.0), "{method}: {text}");
        assert_eq!(events.last().unwrap()["event"], "done", "{text}");
    }
}

#[test]
fn a_picture_that_there_is_no_time_for_is_coarse() {
    let f = Folder::new("hurry");
    f.write("a.glb", grid(20, true));
    let camera = ["--camera", "10,30,10,10,0,10.01,60", "--size", "2048x1536", "--time-budget", "2"];
    let start = std::time::Instant::now();
    let output = f.run(&[&["render", "a.glb", "--method", "bidirectional"], &camera[..]].concat());
    let (text, took) = (stderr(&output), start.elapsed().as_secs_f64());
    assert!(output.status.success() && took < 8.0, "{took} s: {text}");
    assert!(text.contains("too short for a sample of each pixel") && text.contains("samples of each"), "{text}");
    assert_eq!(image::image_dimensions(f.0.join("a.png")).unwrap(), (2048, 1536));
    let one =
        f.run(&["render", "a.glb", "--camera", "10,30,10,10,0,10.01,60", "--size", "32x24", "--time-budget", "2"]);
    assert!(!stderr(&one).contains("too short"), "{}", stderr(&one));
}

#[cfg(unix)]
#[test]
fn an_interrupted_picture_says_what_lies_there() {
    use std::time::{Duration, Instant};
    let f = Folder::new("interrupted-picture");
    f.write("a.glb", grid(20, true));
    for signal in ["-INT", "-TERM"] {
        let _ = std::fs::remove_file(f.0.join("a.exr"));
        let child = f
            .command(&[
                "render",
                "a.glb",
                "--camera",
                "10,30,10,10,0,10.01,60",
                "--size",
                "64x48",
                "--samples",
                "65536",
            ])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while !f.0.join("a.exr").is_file() {
            assert!(start.elapsed() < Duration::from_secs(20), "no preview");
            std::thread::sleep(Duration::from_millis(20));
        }
        std::thread::sleep(Duration::from_millis(300));
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(130), "{text}");
        let last = text.lines().last().unwrap();
        assert!(last.starts_with("interrupted; the picture so far, of ") && last.ends_with("is a.exr"), "{text}");
        assert_eq!(f.entries(), ["a.exr", "a.glb", "a.png"], "after {signal}");
    }
}
