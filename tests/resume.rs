//! Bakes that are disturbed or shared out leave what an undisturbed one leaves, to the bit: killed and begun again, on a disk without
//! room, with a damaged cache, and by shards. `tools/torture` does the same for longer.

mod files;

use files::Folder;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A scene of several lamps, each of which leaves something in the cache.
const LAMPS: usize = 3;

/// Exit code of a shard that needs the parts of others.
const AWAITED: i32 = 75;

/// A room of 4 m with a table and lamps that shine one as brightly as the other.
fn room(folder: &Folder) -> PathBuf {
    let quad = |name: &str, points: [[f32; 3]; 4]| {
        let points = points.map(|[x, y, z]| format!("({x}, {y}, {z})")).join(", ");
        format!(
            "    def Mesh \"{name}\" {{\n        uniform token subdivisionScheme = \"none\"\n        int[] faceVertexCounts = [4]\n\
             \x20       int[] faceVertexIndices = [0, 1, 2, 3]\n        point3f[] points = [{points}]\n\
             \x20       color3f[] primvars:displayColor = [(0.6, 0.5, 0.4)]\n    }}\n"
        )
    };
    let walls = [
        quad("floor", [[0., 0., 0.], [0., 0., 4.], [4., 0., 4.], [4., 0., 0.]]),
        quad("ceiling", [[0., 3., 0.], [4., 3., 0.], [4., 3., 4.], [0., 3., 4.]]),
        quad("left", [[0., 0., 0.], [0., 3., 0.], [0., 3., 4.], [0., 0., 4.]]),
        quad("right", [[4., 0., 0.], [4., 0., 4.], [4., 3., 4.], [4., 3., 0.]]),
        quad("back", [[0., 0., 0.], [4., 0., 0.], [4., 3., 0.], [0., 3., 0.]]),
        quad("front", [[0., 0., 4.], [0., 3., 4.], [4., 3., 4.], [4., 0., 4.]]),
        quad("table", [[1., 0.8, 1.], [1., 0.8, 3.], [3., 0.8, 3.], [3., 0.8, 1.]]),
    ];
    let lamp = |k: usize| {
        let x = 1.0 + k as f32;
        format!(
            "    def SphereLight \"lamp{k}\" {{\n        float inputs:radius = 0.1\n        float inputs:intensity = 3000\n\
             \x20       double3 xformOp:translate = ({x}, 2.5, 2)\n        uniform token[] xformOpOrder = [\"xformOp:translate\"]\n    }}\n"
        )
    };
    let lamps: String = (0..LAMPS).map(lamp).collect();
    let text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\ndef Xform \"World\" {{\n{}{lamps}}}\n",
        walls.concat()
    );
    folder.write("room.usda", text)
}

struct Bakes {
    folder: Folder,
    scene: PathBuf,
    expected: BTreeMap<String, Vec<u8>>,
    /// What an undisturbed bake takes.
    time: Duration,
}

impl Bakes {
    /// The undisturbed bake stands in `undisturbed`, with its cache.
    fn new(name: &str) -> Self {
        let folder = Folder::new(&format!("resume-{name}"));
        let scene = room(&folder);
        let mut bakes = Self { folder, scene, expected: BTreeMap::new(), time: Duration::ZERO };
        let start = Instant::now();
        succeeded(&bakes.bake("undisturbed", &[]));
        bakes.time = start.elapsed();
        bakes.expected = result(&bakes.path("undisturbed"));
        bakes
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.0.join(name)
    }

    fn command(&self, output: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
        command.arg("bake").arg(&self.scene).arg("-o").arg(self.path(output));
        command.args(["--resolution", "128", "--error", "1%", "--checkpoint", "0"]).args(more);
        command.current_dir(&self.folder.0).env_remove("LUMEL_LOG").stdin(Stdio::null());
        command
    }

    fn bake(&self, output: &str, more: &[&str]) -> Output {
        self.command(output, more).output().unwrap()
    }

    fn start(&self, output: &str, more: &[&str]) -> Child {
        self.command(output, more).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Nothing in `output` differs from what an undisturbed bake leaves.
    fn assert_holds(&self, output: &str, why: &str) {
        let found = result(&self.path(output));
        let names: BTreeSet<&String> = found.keys().chain(self.expected.keys()).collect();
        let differing: Vec<&&String> =
            names.iter().filter(|name| found.get(**name) != self.expected.get(**name)).collect();
        assert!(differing.is_empty(), "{why}: {differing:?} differ");
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{:?}: {}", output.status, stderr(output));
    stderr(output)
}

/// The files below `folder`, but for what is hidden.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut files = Vec::new();
    for entry in entries.map(Result::unwrap).filter(|e| !e.file_name().to_string_lossy().starts_with('.')) {
        match entry.path().is_dir() {
            true => files.extend(files_below(&entry.path())),
            false => files.push(entry.path()),
        }
    }
    files.sort();
    files
}

/// What a bake left, by name: of the report what it says of the result, not of the run.
fn result(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let content = |file: PathBuf| {
        let bytes = fs::read(&file).unwrap();
        let name = file.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
        if name != "report.json" {
            return (name, bytes);
        }
        let mut report: Value = serde_json::from_slice(&bytes).unwrap();
        for key in ["stages", "peak_memory_bytes", "rays", "warnings", "reused"] {
            report.as_object_mut().unwrap().remove(key);
        }
        (name, report.to_string().into_bytes())
    };
    files_below(folder).into_iter().map(content).collect()
}

/// The entries of a cache, of some kinds or all.
fn entries(cache: &Path, kinds: &[&str]) -> Vec<PathBuf> {
    let of_kind = |file: &PathBuf| {
        let kind = file.parent().unwrap().file_name().unwrap().to_string_lossy().into_owned();
        kinds.is_empty() || kinds.iter().any(|known| kind == *known || kind.starts_with(&format!("{known}-")))
    };
    files_below(&cache.join("v1")).into_iter().filter(of_kind).collect()
}

/// Adds the files of the folder `from` to those of `to`.
fn bring(from: &Path, to: &Path) {
    for file in files_below(from) {
        let place = to.join(file.strip_prefix(from).unwrap());
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::copy(&file, place).unwrap();
    }
}

/// The number that follows `word` in what a shard said.
fn number_after(text: &str, word: &str) -> usize {
    let rest = text.split(word).nth(1).unwrap_or_else(|| panic!("no {word:?} in {text}"));
    rest.chars().take_while(char::is_ascii_digit).collect::<String>().parse().unwrap()
}

#[test]
fn killed_bakes_go_on_to_the_same_bits() {
    let bakes = Bakes::new("killed");
    let mut went_on = 0;
    for k in 0..8 {
        let mut process = bakes.start("killed", &[]);
        std::thread::sleep(bakes.time.mul_f64(f64::from(k) / 8.0));
        let _ = process.kill();
        process.wait().unwrap();
        for (name, bytes) in result(&bakes.path("killed")) {
            assert_eq!(bakes.expected.get(&name), Some(&bytes), "{name} is half written after kill {k}");
        }
        went_on += usize::from(!entries(&bakes.path("killed/.lumel"), &[]).is_empty());
        succeeded(&bakes.bake("killed", &[]));
        bakes.assert_holds("killed", &format!("kill {k}"));
        fs::remove_dir_all(bakes.path("killed")).unwrap();
    }
    assert!(went_on > 1, "most were killed before anything was kept");
}

/// A limit on the size of files stands for a disk that fills up: it is met by the same writes, and needs no right to mount one.
#[cfg(unix)]
#[test]
fn without_room_nothing_is_half_written() {
    let bakes = Bakes::new("full");
    let (mut failed, mut unkept) = (0, 0);
    for blocks in [0, 1, 8, 40, 100, 200, 400, 4000] {
        // A write past the limit fails, where it isn't to end the process.
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
        let bake = bakes.command("full", &[]);
        let words = std::iter::once(bake.get_program()).chain(bake.get_args());
        let output = Command::new("sh").args(["-c", &script, "sh"]).args(words).output().unwrap();
        let text = stderr(&output);
        if output.status.success() {
            bakes.assert_holds("full", &format!("{blocks} blocks"));
            unkept += usize::from(text.contains("nothing is kept for later bakes"));
        } else {
            failed += 1;
            assert_eq!(output.status.code(), Some(1), "{blocks} blocks: {text}");
            assert_eq!(text.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{blocks} blocks: {text}");
            assert!(!text.contains("internal error"), "{text}");
            assert!(result(&bakes.path("full")).is_empty(), "{blocks} blocks: something is half written");
        }
        succeeded(&bakes.bake("full", &[]));
        bakes.assert_holds("full", &format!("room after {blocks} blocks"));
        fs::remove_dir_all(bakes.path("full")).unwrap();
    }
    assert!(failed > 1 && unkept > 0, "{failed} bakes had no room for results, {unkept} none for the cache alone");
}

#[test]
fn a_damaged_cache_is_told_and_done_again() {
    let bakes = Bakes::new("damaged");
    // A shard leaves its parts, which a bake lets go.
    let whole = bakes.path("whole");
    succeeded(&bakes.bake("none", &["--cache", whole.to_str().unwrap(), "--shard", "1/1"]));
    let sound = entries(&whole, &[]);
    assert!(entries(&whole, &["direct"]).len() >= LAMPS);
    // One of each kind, another of its bytes each time.
    let mut seen = BTreeMap::new();
    for (k, file) in sound.iter().enumerate() {
        let folder = file.parent().unwrap().file_name().unwrap().to_string_lossy().into_owned();
        let kind = folder.split('-').next().unwrap().to_string();
        let count: &mut usize = seen.entry(kind.clone()).or_default();
        *count += 1;
        if *count > 2 {
            continue;
        }
        bring(&whole, &bakes.path("damaged/.lumel"));
        let place = bakes.path("damaged/.lumel").join(file.strip_prefix(&whole).unwrap());
        let mut bytes = fs::read(&place).unwrap();
        let at = (7919 * (k + 1) * (k + 3)) % bytes.len();
        bytes[at] ^= 1 << (k % 8);
        fs::write(&place, bytes).unwrap();
        let mut verify = Command::new(env!("CARGO_BIN_EXE_lumel"));
        let verified = verify.args(["cache", "verify"]).arg(bakes.path("damaged")).output().unwrap();
        assert_eq!(verified.status.code(), Some(1), "byte {at} of {kind}");
        if kind == "look" {
            // Parts of what is there as a whole aren't read.
            fs::remove_dir_all(bakes.path("damaged/.lumel/v1/links")).unwrap();
        }
        let text = succeeded(&bakes.bake("damaged", &[]));
        assert!(text.contains("damaged entry"), "byte {at} of {kind}: {text}");
        bakes.assert_holds("damaged", &format!("byte {at} of {kind}"));
        fs::remove_dir_all(bakes.path("damaged")).unwrap();
    }
    for kind in ["direct", "links", "look", "openings"] {
        assert!(seen.contains_key(kind), "no {kind} among {seen:?}");
    }
}

#[test]
fn shards_at_once_do_each_part_once() {
    let bakes = Bakes::new("at-once");
    for n in [1, 3, 8] {
        let cache = bakes.path(&format!("cache{n}"));
        let cache = cache.to_str().unwrap();
        let shards: Vec<Child> = (1..=n)
            .map(|k| bakes.start("none", &["--cache", cache, "--shard", &format!("{k}/{n}"), "--threads", "1"]))
            .collect();
        let said: Vec<String> = shards.into_iter().map(|shard| succeeded(&shard.wait_with_output().unwrap())).collect();
        let did: usize = said.iter().map(|text| number_after(text, "did ")).sum();
        let parts = entries(Path::new(cache), &["openings", "direct", "look"]).len();
        assert_eq!(did, parts, "{n} shards: {said:?}");
        assert!(!bakes.path("none").exists(), "a shard writes no result");
        succeeded(&bakes.bake("merged", &["--cache", cache]));
        bakes.assert_holds("merged", &format!("{n} shards at once"));
        fs::remove_dir_all(bakes.path("merged")).unwrap();
    }
}

#[test]
fn shards_in_turn_and_alone_give_the_same_bits() {
    let bakes = Bakes::new("in-turn");
    let n = 3;
    let cache = bakes.path("shared");
    for k in 1..=n {
        succeeded(&bakes.bake("none", &["--cache", cache.to_str().unwrap(), "--shard", &format!("{k}/{n}")]));
    }
    succeeded(&bakes.bake("in-turn", &["--cache", cache.to_str().unwrap()]));
    bakes.assert_holds("in-turn", "shards in turn");

    let caches: Vec<PathBuf> = (1..=n).map(|k| bakes.path(&format!("alone{k}"))).collect();
    let mut rounds = 0;
    loop {
        rounds += 1;
        let alone = |(k, cache): (usize, &PathBuf)| {
            let shard = format!("{}/{n} alone", k + 1);
            let output = bakes.bake("none", &["--cache", cache.to_str().unwrap(), "--shard", &shard]);
            let code = output.status.code().unwrap();
            assert!(code == 0 || code == AWAITED, "{}", stderr(&output));
            code
        };
        let codes: Vec<i32> = caches.iter().enumerate().map(alone).collect();
        for (from, to) in caches.iter().flat_map(|from| caches.iter().map(move |to| (from, to))) {
            if from != to {
                bring(from, to);
            }
        }
        if codes.iter().all(|code| *code == 0) {
            break;
        }
        assert!(rounds < 30, "parts stay missing");
    }
    succeeded(&bakes.bake("alone", &["--cache", caches[0].to_str().unwrap()]));
    bakes.assert_holds("alone", &format!("shards alone, {rounds} rounds"));
}

/// A shard that dies leaves its claims to the others.
#[test]
fn a_killed_shard_is_made_good_by_the_others() {
    let bakes = Bakes::new("dead-shard");
    let cache = bakes.path("cache");
    let shard = |k: usize| {
        bakes.start("none", &["--cache", cache.to_str().unwrap(), "--shard", &format!("{k}/2"), "--threads", "1"])
    };
    let (mut first, second) = (shard(1), shard(2));
    std::thread::sleep(bakes.time.mul_f64(0.4));
    let _ = first.kill();
    first.wait().unwrap();
    succeeded(&second.wait_with_output().unwrap());
    let text = succeeded(&bakes.bake("merged", &["--cache", cache.to_str().unwrap()]));
    assert!(!text.contains("links: done"), "all was there: {text}");
    bakes.assert_holds("merged", "a killed shard");
}

fn lumel(folder: &Folder, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
    command.args(args).current_dir(&folder.0).env_remove("LUMEL_LOG").stdin(Stdio::null()).output().unwrap()
}

#[test]
fn a_plan_is_baked_by_shards_and_merged() {
    let bakes = Bakes::new("plan");
    let folder = &bakes.folder;
    let run = |args: &[&str]| lumel(folder, args);
    let planned = run(&["plan", "room.usda", "--shards", "2", "--resolution", "128", "--error", "1%", "-o", "job"]);
    succeeded(&planned);
    let commands = String::from_utf8_lossy(&planned.stdout).into_owned();
    assert!(
        commands.contains("lumel bake --plan plan.json --shard 1/2") && commands.contains("lumel merge plan.json"),
        "{commands}"
    );
    let job: Vec<PathBuf> = files_below(&bakes.path("job"));
    assert_eq!(job, ["plan.json", "template.yaml"].map(|name| bakes.path("job").join(name)));
    for shard in ["1/2", "2/2"] {
        succeeded(&run(&["bake", "--plan", "job/plan.json", "--shard", shard]));
    }
    let text = succeeded(&run(&["merge", "job/plan.json", "-o", "planned"]));
    assert!(text.contains("shards had done all"), "{text}");
    bakes.assert_holds("planned", "a plan");
}

/// Whatever differs on another machine is refused, or can be said there.
#[test]
fn a_plan_holds_for_all_machines() {
    let folder = Folder::new("resume-machines");
    let scene = room(&folder);
    let run = |args: &[&str]| lumel(&folder, args);
    let failed = |args: &[&str], code: i32, word: &str| {
        let output = run(args);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {text}");
        assert!(text.contains(word), "{args:?}: {text}");
    };
    failed(&["plan", "room.usda", "--shards", "2", "--method", "path", "-o", "job"], 2, "shared out");
    failed(&["plan", "room.usda", "--shards", "2", "--time-budget", "9", "-o", "job"], 2, "given time");
    failed(&["plan", "room.usda", "--shards", "0", "-o", "job"], 2, "shards");
    failed(&["plan", "missing.usda", "--shards", "2", "-o", "job"], 1, "missing.usda");
    failed(&["plan", "room.usda", "--shards", "2", "--shard", "1/2", "-o", "job"], 2, "--shards");
    assert!(!folder.0.join("job").exists(), "a plan that is refused leaves nothing");

    succeeded(&run(&["plan", "room.usda", "--shards", "2", "--resolution", "64", "--quality", "draft", "-o", "job"]));
    failed(&["bake", "--plan", "job/plan.json", "--shard", "1/3"], 2, "has 2");
    failed(&["bake", "--plan", "job/plan.json", "--resolution", "64"], 2, "the plan's to say");
    failed(&["bake", "--plan", "job/plan.json", "--no-cache"], 2, "cache");
    failed(&["merge", "room.usda"], 1, "no plan");

    // Elsewhere, with the same content.
    let moved = folder.write("elsewhere/room.usda", fs::read(&scene).unwrap());
    fs::remove_file(&scene).unwrap();
    let there = ["elsewhere/room.usda", "--plan", "job/plan.json", "--cache", "shared", "--shard", "1/2"];
    succeeded(&run(&[&["bake"], &there[..]].concat()));
    let merge = ["merge", "job/plan.json", "elsewhere/room.usda", "--cache", "shared", "-o", "out"];
    let text = succeeded(&run(&merge));
    assert!(text.contains("shards had done all"), "{text}");
    let text = succeeded(&run(&["merge", "job/plan.json", "elsewhere/room.usda", "--cache", "empty", "-o", "all"]));
    assert!(text.contains("parts of the work itself"), "{text}");
    assert_eq!(result(&folder.0.join("out")), result(&folder.0.join("all")));

    // Other content, and another version.
    fs::write(&moved, format!("{}\n", fs::read_to_string(&moved).unwrap())).unwrap();
    failed(&merge, 1, "another file");
    let plan = folder.0.join("job/plan.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&plan).unwrap()).unwrap();
    json["lumel"] = json!("0.0.9");
    json["of-later-versions"] = json!([]);
    fs::write(&plan, json.to_string()).unwrap();
    failed(&merge, 1, "by Lumel 0.0.9");
}

#[test]
fn a_template_names_no_place_of_this_machine() {
    let folder = Folder::new("resume-template");
    room(&folder);
    let scene = folder.0.join("room.usda");
    let run = |args: &[&str]| lumel(&folder, args);
    succeeded(&run(&["plan", scene.to_str().unwrap(), "--shards", "7", "--resolution", "64", "-o", "job"]));
    let template = fs::read_to_string(folder.0.join("job/template.yaml")).unwrap();
    assert!(!template.contains(folder.0.to_str().unwrap()), "{template}");
    for line in
        ["specificationVersion: jobtemplate-2023-09", "range: \"1-7\"", "dependsOn: Bake", "{{Task.Param.Shard}}/7"]
    {
        assert!(template.contains(line), "{line}: {template}");
    }
    // A scene in the job's folder needs no naming.
    fs::copy(&scene, folder.0.join("job/room.usda")).unwrap();
    succeeded(&run(&["plan", "job/room.usda", "--shards", "7", "--resolution", "64", "-o", "job"]));
    assert!(fs::read_to_string(folder.0.join("job/template.yaml")).unwrap().contains("default: \"room.usda\""));
    // What isn't a plan stays.
    folder.write("other/plan.json", "{}");
    let refused = run(&["plan", "room.usda", "--shards", "2", "--resolution", "64", "-o", "other"]);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert_eq!(fs::read(folder.0.join("other/plan.json")).unwrap(), b"{}");
}

#[test]
fn a_farm_is_told_how_far_a_shard_is() {
    let folder = Folder::new("resume-openjd");
    room(&folder);
    let bake = ["bake", "room.usda", "--resolution", "64", "--quality", "draft", "-o", "out", "--log-format", "openjd"];
    let text = succeeded(&lumel(&folder, &bake));
    let progress: Vec<f64> = text.lines().filter_map(|l| l.strip_prefix("openjd_progress: ")?.parse().ok()).collect();
    assert!(progress.is_sorted() && progress.first() == Some(&0.0) && progress.last() == Some(&100.0), "{text}");
    assert!(text.lines().any(|line| line == "openjd_status: direct"), "{text}");
    let failed = lumel(&folder, &["bake", "missing.usda", "--log-format", "openjd"]);
    assert!(stderr(&failed).lines().any(|line| line.starts_with("openjd_fail: missing.usda")), "{}", stderr(&failed));
}
