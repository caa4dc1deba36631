//! What a binary USD file (usdc, "crate") claims to hold, looked at before the openusd crate takes memory for it.
//!
//! The crate checks plain counts against the file's length, but compressed ones can't be: LZ4 gives up to 255 bytes a
//! byte, and four integers of a sequence take one of those, so that a megabyte of file stands for gigabytes. The tables
//! of the structural sections and the compressed arrays that fields point to are added up here; values within time
//! samples and dictionaries are not, but each of them is bounded by the reader alone (4 GiB a block).
//!
//! Layout: OpenUSD's crateFile.h, and sections 16.3.8 and following of the USD Core Specification 1.0.1.

use std::collections::BTreeMap;

/// First bytes of the format.
const MAGIC: &[u8] = b"PXR-USDC";

/// Memory that all structural tables may take [bytes].
const MOST_TABLE_BYTES: u64 = 2 << 30;

/// Elements of all compressed arrays, at most.
const MOST_ELEMENTS: u64 = 1 << 28;

/// Most bytes that a byte of an LZ4 block stands for.
const MOST_RATIO: u64 = 255;

/// Memory that the reader takes for each entry of a section beside what it is read from [bytes], about.
const ENTRY_BYTES: [(&[u8], u64); 5] =
    [(b"FIELDS", 32), (b"FIELDSETS", 24), (b"PATHS", 64), (b"SPECS", 384), (b"STRINGS", 12)];
const TOKEN_BYTES: u64 = 48;

/// Refuses a crate whose tables or arrays are larger than can be meant. What isn't sound otherwise is left to the
/// reader.
///
/// # Errors
/// What is too large, as a message.
pub fn check(bytes: &[u8]) -> Result<(), String> {
    if !bytes.starts_with(MAGIC) {
        return Ok(());
    }
    let sections = sections(bytes).unwrap_or_default();
    let mut total = 0u64;
    for (name, start) in &sections {
        let count = word(bytes, *start).unwrap_or(0);
        let entry = ENTRY_BYTES.iter().find(|(known, _)| known == name).map_or(0, |(_, bytes)| *bytes);
        total = total.saturating_add(count.saturating_mul(entry));
        if name == b"TOKENS" {
            total = total.saturating_add(token_bytes(bytes, *start, MOST_TABLE_BYTES).unwrap_or(0));
        }
        if total > MOST_TABLE_BYTES {
            let name = String::from_utf8_lossy(name);
            return Err(format!(
                "the binary file's tables would take {total} bytes up to its section {name}, more than {MOST_TABLE_BYTES}; \
                 write it again from its source"
            ));
        }
    }
    let fields = sections.iter().find(|(name, _)| name == b"FIELDS");
    let elements = fields.and_then(|(_, start)| elements(bytes, *start)).unwrap_or(0);
    if elements > MOST_ELEMENTS {
        return Err(format!(
            "the binary file's compressed arrays would have {elements} elements, more than {MOST_ELEMENTS}; split the scene, or \
             write the file again from its source"
        ));
    }
    Ok(())
}

fn word(bytes: &[u8], at: u64) -> Option<u64> {
    let at = usize::try_from(at).ok()?;
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Name and start of each section.
fn sections(bytes: &[u8]) -> Option<Vec<(Vec<u8>, u64)>> {
    const NAME: usize = 16;
    const SIZE: usize = NAME + 16;
    let table = word(bytes, 16)?;
    let count = word(bytes, table)?;
    let rows = bytes.get(usize::try_from(table).ok()?.checked_add(8)?..)?.chunks_exact(SIZE);
    let rows = rows.take(usize::try_from(count).ok()?);
    Some(
        rows.filter_map(|row| Some((row[..NAME].split(|b| *b == 0).next()?.to_vec(), word(row, NAME as u64)?)))
            .collect(),
    )
}

/// The compressed block whose size stands at `at`, and where what follows it begins.
fn block(bytes: &[u8], at: u64) -> Option<(&[u8], u64)> {
    let size = word(bytes, at)?;
    let start = at.checked_add(8)?;
    let end = start.checked_add(size)?;
    Some((bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)?, end))
}

/// The contents of a compressed block: one chunk of LZ4 after a zero byte; of `size` bytes at most.
fn unpack(block: &[u8], size: u64) -> Option<Vec<u8>> {
    let (0, block) = block.split_first()? else { return None };
    let most = (block.len() as u64).saturating_mul(MOST_RATIO).saturating_add(64);
    let mut out = vec![0; usize::try_from(size.min(most)).ok()?];
    let size = lz4_flex::block::decompress_into(block, &mut out).ok()?;
    out.truncate(size);
    Some(out)
}

/// Memory of the tokens, each a string of its own; no more than `most` of them are unpacked to be counted.
fn token_bytes(bytes: &[u8], section: u64, most: u64) -> Option<u64> {
    let size = word(bytes, section.checked_add(8)?)?;
    let (packed, _) = block(bytes, section.checked_add(16)?)?;
    let size = size.min((packed.len() as u64).saturating_mul(MOST_RATIO));
    if size > most {
        return Some(size);
    }
    let tokens = unpack(packed, size)?;
    let count = tokens.iter().filter(|b| **b == 0).count() as u64;
    Some(size.saturating_add(count.saturating_mul(TOKEN_BYTES)))
}

/// Elements of the compressed arrays that fields point to, each array once.
fn elements(bytes: &[u8], section: u64) -> Option<u64> {
    const IS_ARRAY: u64 = 1 << 63;
    const IS_INLINED: u64 = 1 << 62;
    const IS_COMPRESSED: u64 = 1 << 61;
    const PAYLOAD: u64 = (1 << 48) - 1;
    let count = word(bytes, section)?;
    let (_, at) = block(bytes, section.checked_add(8)?)?;
    let (packed, _) = block(bytes, at)?;
    let values = unpack(packed, count.checked_mul(8)?)?;
    // From version 0.7 on an array's length has 64 bits.
    let is_long = (bytes.get(8)?, bytes.get(9)?) >= (&0, &7);
    let mut arrays: BTreeMap<u64, u64> = BTreeMap::new();
    for value in values.as_chunks().0.iter().map(|v| u64::from_le_bytes(*v)) {
        if value & (IS_ARRAY | IS_INLINED | IS_COMPRESSED) == IS_ARRAY | IS_COMPRESSED {
            let place = value & PAYLOAD;
            let length = word(bytes, place).unwrap_or(0);
            arrays.insert(place, if is_long { length } else { length & u64::from(u32::MAX) });
        }
    }
    Some(arrays.values().fold(0, |sum, n| sum.saturating_add(*n)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A crate with the one section `name`, which begins with `body`.
    fn file(name: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = b"PXR-USDC\0\x08\0\0\0\0\0\0".to_vec();
        bytes.extend(((16 + 16 + body.len()) as u64).to_le_bytes());
        bytes.extend([0; 8]);
        bytes.extend(body);
        bytes.extend(1u64.to_le_bytes());
        let mut row = [0u8; 32];
        row[..name.len()].copy_from_slice(name.as_bytes());
        row[16..24].copy_from_slice(&32u64.to_le_bytes());
        row[24..].copy_from_slice(&(body.len() as u64).to_le_bytes());
        bytes.extend(row);
        bytes
    }

    fn packed(contents: &[u8]) -> Vec<u8> {
        let mut block = vec![0];
        block.extend(lz4_flex::block::compress(contents));
        [&(block.len() as u64).to_le_bytes()[..], &block].concat()
    }

    #[test]
    fn tokens_that_unpack_to_gigabytes_are_refused() {
        let tokens = |count: u64| {
            let contents = vec![0u8; count as usize];
            let words = [count.to_le_bytes(), count.to_le_bytes()].concat();
            file("TOKENS", &[words, packed(&contents)].concat())
        };
        assert_eq!(check(&tokens(1000)), Ok(()));
        let bomb = tokens(64 << 20);
        assert!(bomb.len() < 1 << 20, "{}", bomb.len());
        assert!(check(&bomb).unwrap_err().contains("TOKENS"));
    }

    #[test]
    fn counts_and_arrays_beyond_any_scene_are_refused() {
        assert!(check(&file("SPECS", &u64::MAX.to_le_bytes())).is_err());
        assert_eq!(check(&file("SPECS", &1000u64.to_le_bytes())), Ok(()));
        let fields = |elements: u64| {
            // Its one value is an array whose length stands at the section's end.
            let mut body = [1u64.to_le_bytes().to_vec(), packed(&[0; 8])].concat();
            let value = |place: u64| packed(&((5u64 << 61) | place).to_le_bytes());
            let place = (32 + body.len() + value(0xffff).len()) as u64;
            body.extend(value(place));
            assert_eq!(32 + body.len() as u64, place, "small numbers pack alike");
            body.extend(elements.to_le_bytes());
            file("FIELDS", &body)
        };
        assert_eq!(check(&fields(1 << 20)), Ok(()));
        assert!(check(&fields(1 << 40)).unwrap_err().contains("elements"));
    }

    #[test]
    fn what_is_cut_off_is_left_to_the_reader() {
        let whole = file("TOKENS", &[0; 40]);
        (0..whole.len()).for_each(|length| assert_eq!(check(&whole[..length]), Ok(())));
    }
}
