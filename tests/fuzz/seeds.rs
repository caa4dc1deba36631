//! Sound files to break: small ones of our own, and those of the shared corpora where these are there.

use crate::gltf_document::{Builder, TRIANGLE, one, png};
use crate::target::Target;
use serde_json::json;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

/// Largest file of a corpus that is taken [bytes], and most of them.
const MOST_BYTES: u64 = 64 << 10;
const MOST_SEEDS: usize = 48;

/// A file to start from.
pub struct Seed {
    pub bytes: Vec<u8>,
    /// Made here, so that the reader must take it.
    pub is_ours: bool,
}

/// The seeds of `target`.
pub fn of(target: &Target) -> Vec<Seed> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let sample = |name: &str| std::fs::read(root.join("samples").join(name)).unwrap();
    let ours = match target.name {
        "glb" | "accessors" => vec![textured(), sample("furnace/furnace.glb")],
        "usda" => vec![stage().into_bytes(), sample("furnace/furnace.usda")],
        "usdz" => vec![package()],
        "usdc" => vec![binary()],
        "image" => pictures(),
        _ => vec![sample("projector/downlight.ies")],
    };
    let mut seeds: Vec<Seed> = ours.into_iter().map(|bytes| Seed { bytes, is_ours: true }).collect();
    let shared = corpus(target).into_iter().filter(|bytes| !target.is_json || is_glb(bytes));
    seeds.extend(shared.map(|bytes| Seed { bytes, is_ours: false }));
    seeds
}

/// True where a GLB's JSON can be read.
fn is_glb(bytes: &[u8]) -> bool {
    let length = bytes.get(12..16).map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize);
    let json = length.and_then(|l| bytes.get(20..20usize.checked_add(l)?));
    bytes.starts_with(b"glTF") && json.is_some_and(|j| serde_json::from_slice::<serde_json::Value>(j).is_ok())
}

/// Files that once broke the target's reader.
pub fn findings(target: &Target) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/findings").join(target.name);
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|p| std::fs::read(p).unwrap()).collect()
}

/// Small files of the shared corpora, in the order of their names.
fn corpus(target: &Target) -> Vec<Vec<u8>> {
    let fallback = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let root = std::env::var_os("LUMEL_REFERENCE").map_or(fallback, PathBuf::from).join("scenes");
    if !root.is_dir() {
        println!("{} is absent (set LUMEL_REFERENCE): seeds of our own alone", root.display());
    }
    let extensions: &[&str] = match target.name {
        "image" => &["png", "jpg", "exr", "hdr", "webp"],
        _ => &[target.extension],
    };
    let mut paths = Vec::new();
    collect(&root, extensions, &mut paths);
    paths.sort();
    // Spread over the whole corpus.
    let step = paths.len().div_ceil(MOST_SEEDS).max(1);
    paths.into_iter().step_by(step).map(|p| std::fs::read(p).unwrap()).collect()
}

fn collect(folder: &Path, extensions: &[&str], paths: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_small = || entry.metadata().is_ok_and(|m| m.is_file() && m.len() <= MOST_BYTES);
        if path.is_dir() {
            collect(&path, extensions, paths);
        } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) && is_small() {
            paths.push(path);
        }
    }
}

/// A GLB with everything that accessors can be: indices, sparse values, normalized and packed numbers, a picture.
fn textured() -> Vec<u8> {
    let mut b = Builder::default();
    let (positions, indices) = (b.floats(&TRIANGLE), b.indices(&[0, 1, 2]));
    let uvs = b.view(&[0, 0, 0, 0, 255, 255, 0, 0, 0, 0, 255, 255], None);
    let uvs =
        b.accessor(json!({ "bufferView": uvs, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2" }));
    let moved = b.view(&[1.5f32.to_le_bytes(); 3].concat(), None);
    let which = b.view(&[1, 0, 0, 0], None);
    let sparse = json!({
        "count": 1,
        "indices": { "bufferView": which, "componentType": 5121 },
        "values": { "bufferView": moved },
    });
    let target =
        b.accessor(json!({ "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [2, 2, 2], "sparse": sparse }));
    let picture = b.view(&png(), None);
    let mut document = one(json!({
        "attributes": { "POSITION": positions, "TEXCOORD_0": uvs },
        "indices": indices,
        "material": 0,
        "targets": [{ "POSITION": target }],
    }));
    document["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    document["textures"] = json!([{ "source": 0 }]);
    document["images"] = json!([{ "bufferView": picture, "mimeType": "image/png" }]);
    b.glb(document)
}

/// A stage with a mesh, a light, a variant set, an instancer and a material.
fn stage() -> String {
    r#"#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "World" (
    variants = { string look = "a" }
    prepend variantSets = "look"
)
{
    double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Square" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
        rel material:binding = </World/Paint>
    }
    def Material "Paint"
    {
        token outputs:surface.connect = </World/Paint/Surface.outputs:surface>
        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.5, 0.4, 0.3)
            token outputs:surface
        }
    }
    def PointInstancer "Points"
    {
        rel prototypes = [</World/Points/Ball>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 1), (1, 0, 1)]
        def Sphere "Ball" { double radius = 0.25 }
    }
    def RectLight "Lamp" { float inputs:intensity = 10 }
    variantSet "look" = {
        "a" { over "Square" { color3f[] primvars:displayColor = [(1, 0, 0)] } }
        "b" { over "Square" { color3f[] primvars:displayColor = [(0, 1, 0)] } }
    }
}
"#
    .to_owned()
}

/// The stage in a package, beside a picture.
fn package() -> Vec<u8> {
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in [("scene.usda", stage().into_bytes()), ("textures/a.png", png())] {
        archive.start_file(name, options).unwrap();
        archive.write_all(&bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The stage as a binary file.
fn binary() -> Vec<u8> {
    let folder = crate::gltf_document::Folder::new("fuzz-seed");
    let text = folder.write("seed.usda", stage().as_bytes());
    let stage = openusd::usd::Stage::open(text.to_str().unwrap()).unwrap();
    let binary = folder.0.join("seed.usdc");
    stage.flatten().unwrap().export(binary.to_str().unwrap()).unwrap();
    std::fs::read(binary).unwrap()
}

/// One picture of each format.
fn pictures() -> Vec<Vec<u8>> {
    use image::{DynamicImage, ImageFormat, Rgb, Rgb32FImage, RgbImage};
    let small = RgbImage::from_fn(9, 7, |x, y| Rgb([(x * 28) as u8, (y * 36) as u8, 90]));
    let bright = Rgb32FImage::from_fn(9, 7, |x, y| Rgb([x as f32, y as f32 * 100.0, 0.5]));
    let encode = |picture: DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let plain = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP];
    let float = [ImageFormat::OpenExr, ImageFormat::Hdr];
    let plain = plain.into_iter().map(|format| encode(small.clone().into(), format));
    plain.chain(float.into_iter().map(|format| encode(bright.clone().into(), format))).collect()
}
