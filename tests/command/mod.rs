//! The command in a folder of its own, and small scenes for it.
#![allow(dead_code)]

#[path = "../files/mod.rs"]
mod files;

pub use files::Folder;
use std::fmt::Write as _;
use std::process::{Command, Output};

impl Folder {
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lumel"));
        command.args(args).current_dir(&self.0);
        for name in ["LUMEL_LOG", "RUST_LOG", "RUST_BACKTRACE"] {
            command.env_remove(name);
        }
        command
    }

    pub fn run(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Exit 1 and one line `error: ...` that holds `name`, without a word about a panic.
pub fn assert_fails_cleanly(output: &Output, name: &str) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    assert!(errors[0].contains(name), "{text}");
    assert_eq!(text.lines().last(), errors.first().copied(), "the error comes last: {text}");
    for word in ["panic", "internal error", "RUST_BACKTRACE", "src/"] {
        assert!(!text.contains(word), "{word}: {text}");
    }
}

/// A binary glTF of `json` and `bin`.
pub fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let total = 12 + 8 + json.len() + 8 + bin.len();
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &bin)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// A bumpy grid of `n` x `n` squares, 1 m each, that gets light from a point light 3 m above its middle where `lit`.
pub fn grid(n: u32, lit: bool) -> Vec<u8> {
    let mut bin = Vec::new();
    for z in 0..=n {
        for x in 0..=n {
            let height = 0.3 * ((x * 7 + z * 13) % 5) as f32;
            for v in [x as f32, height, z as f32] {
                bin.extend(v.to_le_bytes());
            }
        }
    }
    let vertices = (n + 1) * (n + 1);
    let indices_at = bin.len();
    for z in 0..n {
        for x in 0..n {
            let a = z * (n + 1) + x;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            for i in [a, c, b, b, c, d] {
                bin.extend(i.to_le_bytes());
            }
        }
    }
    let middle = n as f32 / 2.0;
    let mut json = String::from(r#"{"asset":{"version":"2.0"},"scene":0,"#);
    let nodes = if lit { "[0,1]" } else { "[0]" };
    write!(json, r#""scenes":[{{"nodes":{nodes}}}],"nodes":[{{"name":"ground","mesh":0}}"#).unwrap();
    if lit {
        write!(json, r#",{{"name":"lamp","translation":[{middle},3,{middle}],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}"#)
            .unwrap();
    }
    json.push_str("],");
    if lit {
        json.push_str(r#""extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":100}]}},"#);
    }
    write!(
        json,
        r#""meshes":[{{"name":"grid","primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
        "materials":[{{"name":"clay","pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.5,0.5,1],"metallicFactor":0}}}}],
        "buffers":[{{"byteLength":{0}}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":{indices_at}}},
                       {{"buffer":0,"byteOffset":{indices_at},"byteLength":{1}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3","min":[0,0,0],"max":[{n},1.2,{n}]}},
                     {{"bufferView":1,"componentType":5125,"count":{2},"type":"SCALAR"}}]}}"#,
        bin.len(),
        bin.len() - indices_at,
        6 * n * n
    )
    .unwrap();
    glb(&json, &bin)
}
