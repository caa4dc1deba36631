//! The files of a stage, guarded: openusd asks a resolver for every layer, package and asset, and this one lets it have
//! what [`Access`] allows and what isn't larger or deeper than can be meant.

use super::{crate_size, package_file};
use crate::load::access::Access;
use openusd::ar::{Asset, AssetBuffer, AssetInfo, DefaultResolver, ResolvedPath, Resolver};
use std::borrow::Cow;
use std::io::{self, Cursor, SeekFrom};
use std::time::SystemTime;

/// Entries of a package, at most: its directory takes several times its size.
const MOST_ENTRIES: u64 = 1 << 17;

/// Brackets within each other in a text layer, at most: the parser recurses, and a stage of that depth can't be
/// composed.
const MOST_NESTING: usize = 4096;

/// Braces that open in a text layer, at most: each stands for a prim, which takes about 3 KB once it is composed.
const MOST_BRACES: usize = 1 << 20;

/// Text layers larger than this are refused [bytes]: the parser takes several times their size.
const MOST_TEXT: usize = 512 << 20;

/// openusd's own resolver behind the checks. Clones share what they opened.
pub struct GuardedResolver {
    inner: DefaultResolver,
    access: Access,
}

impl GuardedResolver {
    /// A resolver of what `access` allows.
    pub fn new(access: Access) -> Self {
        Self { inner: DefaultResolver::new(), access }
    }

    /// The bytes of the asset at `resolved`.
    ///
    /// # Errors
    /// Those of the system, and the guard's.
    pub fn read(&self, resolved: &str) -> io::Result<Vec<u8>> {
        self.open_asset(&ResolvedPath::new(resolved))?.read_all()
    }

    fn check(&self, path: &str) -> io::Result<()> {
        self.access.check(&package_file(path)).map(drop).map_err(io::Error::other)
    }
}

impl Resolver for GuardedResolver {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        self.inner.create_identifier(asset_path, anchor)
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        // To look into a package is to read it.
        let package = package_file(asset_path);
        let is_packaged = package.as_os_str() != asset_path;
        if is_packaged {
            let outer = self.inner.resolve(package.to_str()?)?;
            check_entries(&mut *self.open_asset(&outer).ok()?).ok()?;
        }
        self.inner.resolve(asset_path)
    }

    fn resolve_for_new_asset(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.inner.resolve_for_new_asset(asset_path)
    }

    fn open_asset(&self, resolved: &ResolvedPath) -> io::Result<Box<dyn Asset>> {
        let path = resolved.to_str().unwrap_or_default();
        self.check(path)?;
        let mut asset = self.inner.open_asset(resolved)?;
        match self.get_extension(path).to_ascii_lowercase().as_str() {
            "usdz" => {
                check_entries(&mut *asset)?;
                Ok(asset)
            }
            "usd" | "usda" | "usdc" => {
                let bytes = asset.into_buffer()?;
                check_layer(&bytes).map_err(io::Error::other)?;
                Ok(Box::new(Cursor::new(AssetBuffer::Shared(bytes.into_shared()))))
            }
            _ => Ok(asset),
        }
    }

    fn is_context_dependent_path(&self, asset_path: &str) -> bool {
        self.inner.is_context_dependent_path(asset_path)
    }

    fn in_memory_identifier<'a>(&self, asset_path: &'a str) -> Cow<'a, str> {
        self.inner.in_memory_identifier(asset_path)
    }

    fn get_asset_info(&self, asset_path: &str, resolved: &ResolvedPath) -> AssetInfo {
        self.inner.get_asset_info(asset_path, resolved)
    }

    fn get_modification_timestamp(&self, asset_path: &str, resolved: &ResolvedPath) -> Option<SystemTime> {
        self.inner.get_modification_timestamp(asset_path, resolved)
    }

    fn identity(&self) -> String {
        self.inner.identity()
    }

    fn cache_id(&self) -> Option<u64> {
        self.inner.cache_id()
    }
}

/// Refuses a layer whose reading would take memory or stack out of all proportion.
fn check_layer(bytes: &[u8]) -> Result<(), String> {
    if bytes.starts_with(b"PXR-USDC") {
        return crate_size::check(bytes);
    }
    if bytes.len() > MOST_TEXT {
        return Err(format!("has {} bytes of text; write it as usdc (usdcat -o scene.usdc)", bytes.len()));
    }
    let (depth, braces) = nesting(bytes);
    if depth > MOST_NESTING {
        return Err(format!("nests brackets more than {MOST_NESTING} deep, which no scene needs"));
    }
    if braces > MOST_BRACES {
        return Err(format!(
            "opens {braces} braces, more than {MOST_BRACES}; split the layer, or place copies by instances"
        ));
    }
    Ok(())
}

/// How deep the brackets of a text layer lie within each other, and how many braces open, those in strings and comments
/// left out.
fn nesting(text: &[u8]) -> (usize, usize) {
    let (mut depth, mut most, mut braces) = (0usize, 0, 0);
    let mut at = 0;
    while let Some(&byte) = text.get(at) {
        match byte {
            b'{' | b'[' | b'(' => {
                depth += 1;
                most = most.max(depth);
                braces += usize::from(byte == b'{');
            }
            b'}' | b']' | b')' => depth = depth.saturating_sub(1),
            b'#' => at += text[at..].iter().position(|b| *b == b'\n').unwrap_or(text.len() - at),
            b'"' | b'\'' | b'@' => at = end_of_string(text, at),
            _ => {}
        }
        at += 1;
    }
    (most, braces)
}

/// Where the string or asset path that begins at `at` has its last quote.
fn end_of_string(text: &[u8], at: usize) -> usize {
    let quote = text[at];
    let width = if text[at..].starts_with(&[quote; 3]) { 3 } else { 1 };
    let mut end = at + width;
    while end < text.len() {
        match text[end] {
            b'\\' => end += 1,
            // An ordinary string ends with its line at the latest.
            b'\n' if width == 1 => return end,
            _ if text[end..].starts_with(&[quote; 3][..width]) => return end + width - 1,
            _ => {}
        }
        end += 1;
    }
    end
}

/// Refuses a package with more entries than any has (APPNOTE.TXT of ZIP, sections 4.3.14 and 4.3.16).
fn check_entries(asset: &mut dyn Asset) -> io::Result<()> {
    /// The end record and the longest comment after it.
    const TAIL: u64 = 22 + 65535;
    let size = asset.size()?;
    let tail_at = size.saturating_sub(TAIL);
    asset.seek(SeekFrom::Start(tail_at))?;
    let mut tail = vec![0; usize::try_from(size - tail_at).unwrap_or(0)];
    asset.read_exact(&mut tail)?;
    let end = tail.windows(4).rposition(|w| w == b"PK\x05\x06");
    let count = |at: usize| tail.get(at..)?.first_chunk().map(|b| u64::from(u16::from_le_bytes(*b)));
    let mut entries = end.and_then(|end| count(end + 10)).unwrap_or(0);
    // 65,535 stands for: see the record of 64 bits.
    if let Some(long) = tail.windows(4).rposition(|w| w == b"PK\x06\x06")
        && let Some(bytes) = tail.get(long + 32..).and_then(|t| t.first_chunk())
    {
        entries = entries.max(u64::from_le_bytes(*bytes));
    }
    asset.seek(SeekFrom::Start(0))?;
    // An entry takes 46 bytes at least.
    if entries > MOST_ENTRIES || entries.saturating_mul(46) > size {
        return Err(io::Error::other(format!("the package claims {entries} entries; write it again (usdzip)")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brackets_in_strings_and_comments_do_not_nest() {
        assert_eq!(nesting(b"def \"a\" { b = [(1, 2)] } {"), (3, 2));
        assert_eq!(nesting(b"\"{{{\" '[[' \"\"\"((\n((\"\"\" # {{{\n {"), (1, 1));
        assert_eq!(nesting(b"\"a\\\"{{\" ("), (1, 0));
        assert_eq!(nesting(b"} } {"), (1, 1));
        assert_eq!(nesting(b"@a#b@ (("), (2, 0));
        assert_eq!(nesting("(".repeat(70).as_bytes()), (70, 0));
    }
}
