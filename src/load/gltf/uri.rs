//! URIs of buffers and images: data URIs, and files in the scene's folder tree.

use crate::error::{Error, Result};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// What a URI refers to.
pub(super) enum Resource {
    Bytes(Vec<u8>),
    File(PathBuf),
}

/// Resolves `uri` against the folder of the scene at `scene`. A scene may come from anywhere, so it may not reach outside
/// its own folder tree.
///
/// # Errors
/// `Invalid` naming `place`, for URIs with a scheme, absolute paths, paths that leave the folder, and broken data URIs.
pub(super) fn resolve(scene: &Path, uri: &str, place: &str) -> Result<Resource> {
    if let Some(data) = uri.strip_prefix("data:") {
        let bytes = data_uri(data);
        return bytes
            .map(Resource::Bytes)
            .ok_or_else(|| Error::invalid(place, "broken data URI; export the file again"));
    }
    let shown: String = uri.chars().take(120).collect();
    let decoded = percent_decode(uri.as_bytes());
    let Ok(text) = std::str::from_utf8(&decoded) else {
        return Err(Error::invalid(place, format!("the URI {shown} is not UTF-8; rename the file")));
    };
    // Some exporters on Windows write back slashes.
    let text = text.replace('\\', "/");
    if text.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err(Error::invalid(
            place,
            format!("the URI {shown} is not a relative path; copy the file beside the scene"),
        ));
    }
    let mut depth = 0usize;
    for component in Path::new(&text).components() {
        let next = match component {
            Component::Normal(_) => depth.checked_add(1),
            Component::CurDir => Some(depth),
            Component::ParentDir => depth.checked_sub(1),
            Component::RootDir | Component::Prefix(_) => None,
        };
        depth = next.ok_or_else(|| {
            Error::invalid(place, format!("the URI {shown} leaves the scene's folder; copy the file beside the scene"))
        })?;
    }
    let folder = scene.parent().unwrap_or(Path::new(""));
    Ok(Resource::File(folder.join(text)))
}

/// The bytes of `[<mime>][;base64],<payload>`.
fn data_uri(data: &str) -> Option<Vec<u8>> {
    let (head, payload) = data.split_once(',')?;
    let payload = percent_decode(payload.as_bytes());
    if head.ends_with(";base64") { base64(&payload) } else { Some(payload.into_owned()) }
}

/// RFC 3986 section 2.1; a `%` without two hex digits stays as it is.
fn percent_decode(text: &[u8]) -> Cow<'_, [u8]> {
    if !text.contains(&b'%') {
        return Cow::Borrowed(text);
    }
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text;
    while let [first, tail @ ..] = rest {
        let escaped = match rest {
            [b'%', high, low, ..] => hex(*high).zip(hex(*low)).map(|(high, low)| high * 16 + low),
            _ => None,
        };
        out.push(escaped.unwrap_or(*first));
        rest = if escaped.is_some() { tail.get(2..).unwrap_or_default() } else { tail };
    }
    Cow::Owned(out)
}

fn hex(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).and_then(|d| u8::try_from(d).ok())
}

/// RFC 4648 section 4, and the URL alphabet of section 5; padding is optional, line breaks are skipped.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut count) = (0u32, 0u32);
    for &c in text {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => break,
            b'\r' | b'\n' | b' ' => continue,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push(((bits >> count) & 0xff) as u8);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_every_tail_length() {
        assert_eq!(base64(b"").unwrap(), b"");
        assert_eq!(base64(b"Zg==").unwrap(), b"f");
        assert_eq!(base64(b"Zm8").unwrap(), b"fo");
        assert_eq!(base64(b"Zm9vYmFy").unwrap(), b"foobar");
        assert!(base64(b"Zm9*").is_none());
    }

    #[test]
    fn percent_escapes_keep_what_is_no_escape() {
        assert_eq!(percent_decode(b"a%20b%2").as_ref(), b"a b%2");
        assert_eq!(percent_decode(b"100%.png").as_ref(), b"100%.png");
    }

    #[test]
    fn paths_stay_in_the_folder() {
        let scene = Path::new("scenes/room.gltf");
        let file = |uri: &str| match resolve(scene, uri, "place") {
            Ok(Resource::File(path)) => Some(path),
            _ => None,
        };
        assert_eq!(file("a/../b%20c.png"), Some(PathBuf::from("scenes/a/../b c.png")));
        assert_eq!(file(r"textures\a.png"), Some(PathBuf::from("scenes/textures/a.png")));
        for bad in
            ["../x.png", "a/../../x.png", "/etc/passwd", "%2e%2e/x", "http://host/x.png", "C:/x.png", r"..\x.png"]
        {
            assert_eq!(file(bad), None, "{bad}");
        }
    }
}
