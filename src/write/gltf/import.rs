//! A glTF source as one self-contained document: all buffers in one, pictures embedded.

use super::document::{Document, Object, Target, index};
use crate::error::{Error, Result, Warnings};
use crate::load::gltf::GltfSource;
use crate::load::gltf::uri::{Resource, resolve};
use serde_json::Value;
use std::path::Path;

/// Takes over `source`: buffer views point into one buffer, files that images name are embedded. `folder` is where the
/// output goes, for URIs that have to stay.
///
/// # Errors
/// `Invalid` where the document is broken.
pub fn import(source: &GltfSource, folder: &Path, warnings: &mut Warnings) -> Result<Document> {
    let mut bin = Vec::new();
    let mut starts = Vec::new();
    for buffer in &source.buffers {
        // Views are aligned relative to their buffer; 16 keeps every alignment that one may ask for.
        bin.resize(bin.len().next_multiple_of(16), 0);
        starts.push(bin.len());
        bin.extend_from_slice(buffer);
    }
    let mut doc = Document::new(source.json.clone(), bin, source.path.display().to_string())?;
    for view in 0..doc.count("bufferViews") {
        let place = format!("{}: bufferViews[{view}]", doc.place);
        let view = doc.item_mut("bufferViews", view)?;
        let moved = repoint(view, &starts).is_some();
        // Compressed views name their buffer once more.
        let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
        let inner = extensions.into_iter().flat_map(|e| e.values_mut()).filter_map(Value::as_object_mut);
        if !moved || inner.filter(|e| e.contains_key("buffer")).any(|e| repoint(e, &starts).is_none()) {
            return Err(Error::invalid(place, "names a buffer that isn't there; export the file again"));
        }
    }
    embed_images(&mut doc, source, folder, warnings)?;
    rebase_uris(doc.root_mut(), &source.path, folder);
    Ok(doc)
}

/// Moves a range of a buffer to its place in the merged one.
fn repoint(range: &mut Object, starts: &[usize]) -> Option<()> {
    let start = *starts.get(index(range, "buffer")?)?;
    range.insert("buffer".into(), 0.into());
    if start > 0 {
        let offset = index(range, "byteOffset").unwrap_or(0);
        range.insert("byteOffset".into(), start.checked_add(offset)?.into());
    }
    Some(())
}

/// Puts the files that images name into buffer views.
fn embed_images(doc: &mut Document, source: &GltfSource, folder: &Path, warnings: &mut Warnings) -> Result<()> {
    let scene = &source.path;
    for i in 0..doc.count("images") {
        let image = doc.item("images", i)?;
        let Some(uri) = image.get("uri").and_then(Value::as_str).map(str::to_string) else { continue };
        let bytes = match resolve(scene, &uri, &doc.place) {
            Ok(Resource::Bytes(bytes)) => Some(bytes),
            Ok(Resource::File(file)) => source.access.read(&file).ok(),
            Err(_) => None,
        };
        match bytes.as_deref().and_then(|b| Some((b, mime_type(b)?))) {
            Some((bytes, mime)) => {
                let view = doc.push_view(bytes, Target::None, None);
                let image = doc.item_mut("images", i)?;
                image.shift_remove("uri");
                image.insert("bufferView".into(), view.into());
                image.insert("mimeType".into(), mime.into());
            }
            None if uri.starts_with("data:") => {}
            None => {
                warnings.add(&uri, "the picture can't be embedded in the GLB; it is still named by its file");
                let rebased = rebase(&uri, scene, folder);
                doc.item_mut("images", i)?.insert("uri".into(), rebased.into());
            }
        }
    }
    Ok(())
}

/// The media type by a picture's first bytes.
fn mime_type(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xff, 0xd8, 0xff, ..] => Some("image/jpeg"),
        [0xab, b'K', b'T', b'X', b' ', b'2', b'0', ..] => Some("image/ktx2"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        [b'D', b'D', b'S', b' ', ..] => Some("image/vnd-ms.dds"),
        _ => None,
    }
}

/// Corrects the relative URIs inside extensions (IES profiles and the like), which stay side files.
fn rebase_uris(object: &mut Object, scene: &Path, folder: &Path) {
    fn walk(value: &mut Value, inside: bool, scene: &Path, folder: &Path) {
        match value {
            Value::Object(object) => {
                for (key, value) in object.iter_mut().filter(|(key, _)| *key != "extras") {
                    match value {
                        Value::String(uri) if inside && key == "uri" => *uri = rebase(uri, scene, folder),
                        value => walk(value, inside || key == "extensions", scene, folder),
                    }
                }
            }
            Value::Array(items) => items.iter_mut().for_each(|v| walk(v, inside, scene, folder)),
            _ => {}
        }
    }
    for (key, value) in object.iter_mut().filter(|(key, _)| *key != "extras") {
        walk(value, key == "extensions", scene, folder);
    }
}

/// The relative `uri` of the file at `scene` as seen from `folder`; itself where it is absolute or no path leads there.
fn rebase(uri: &str, scene: &Path, folder: &Path) -> String {
    let has_scheme = uri.split('/').next().is_some_and(|first| first.contains(':'));
    let scene_folder = scene.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(from), Ok(to)) = (std::path::absolute(folder), std::path::absolute(scene_folder)) else {
        return uri.to_string();
    };
    if has_scheme || uri.starts_with('/') {
        return uri.to_string();
    }
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let mut path = "../".repeat(from.len() - shared);
    for folder in &to[shared..] {
        path += &percent_encode(&folder.as_os_str().to_string_lossy());
        path.push('/');
    }
    path + uri
}

/// The relative path `path`, with `/`, as a URI.
pub fn uri_of(path: &str) -> String {
    path.split('/').map(percent_encode).collect::<Vec<_>>().join("/")
}

fn percent_encode(text: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-._~!$&'()*+,;=@".contains(&b);
    text.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_seen_from_the_output_folder() {
        let (scene, folder) = (Path::new("/a/b/scene.gltf"), Path::new("/a/c/out"));
        assert_eq!(rebase("tex/1.png", scene, folder), "../../b/tex/1.png");
        assert_eq!(rebase("x.png", Path::new("/a/b c/s.gltf"), Path::new("/a")), "b%20c/x.png");
        assert_eq!(rebase("http://host/x.png", scene, folder), "http://host/x.png");
    }
}
