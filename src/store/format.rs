//! How an entry lies in its file.
//!
//! | at | bytes | |
//! |---|---|---|
//! | 0 | 8 | [`MAGIC`] |
//! | 8 | 4 | [`VERSION`] |
//! | 12 | 4 | bytes of the kind's name |
//! | 16 | 8 | sections, n |
//! | 24 | 8 | bytes of the file |
//! | 32 | 32 | the key |
//! | 64 | 32 | the kind's name, zeros behind it |
//! | 96 | 40 n | for each section its length [bytes] (8) and its BLAKE3 hash (32) |
//! | 96 + 40 n | 32 | BLAKE3 hash of all of the above |
//!
//! Sections follow in order, each from the next multiple of [`ALIGNMENT`] on; the last is filled up to one. Gaps are zero. Numbers are
//! little-endian. Every byte is thus either under a hash, a hash, or known to be zero, and the file's length is known: no byte can
//! change, none be lost and none be added without being found.

use super::key::{Key, update};
use std::io::{self, Write};
use std::ops::Range;

/// What a file starts with.
const MAGIC: [u8; 8] = *b"LUMELSTO";
/// The version of this layout.
const VERSION: u32 = 1;
/// Where sections start: at multiples of this [bytes], a line of the processor's cache.
pub const ALIGNMENT: usize = 64;
/// Bytes of a kind's name, at most.
pub const KIND_BYTES: usize = 32;

const HASH: usize = blake3::OUT_LEN;
/// Bytes before the table of sections, and of each row of it.
const FIXED: usize = 64 + KIND_BYTES;
const ROW: usize = 8 + HASH;

/// Writes an entry.
///
/// # Errors
/// Those of `out`.
pub fn write(out: &mut dyn Write, kind: &str, key: Key, sections: &[&[u8]]) -> io::Result<()> {
    let header = header(kind, key, sections);
    let zeros = [0; ALIGNMENT];
    for part in std::iter::once(header.as_slice()).chain(sections.iter().copied()) {
        out.write_all(part)?;
        out.write_all(&zeros[..gap(part.len())])?;
    }
    Ok(())
}

/// Bytes of the header of `n` sections, where that can be told.
fn header_len(n: usize) -> Option<usize> {
    n.checked_mul(ROW)?.checked_add(FIXED + HASH)
}

/// Zeros behind `len` bytes.
fn gap(len: usize) -> usize {
    len.wrapping_neg() % ALIGNMENT
}

fn header(kind: &str, key: Key, sections: &[&[u8]]) -> Vec<u8> {
    let own = header_len(sections.len()).expect("sections are in memory, and larger than a row each");
    let total = sections.iter().fold(own + gap(own), |sum, s| sum + s.len() + gap(s.len()));
    let mut header = Vec::with_capacity(own);
    header.extend(MAGIC);
    header.extend(VERSION.to_le_bytes());
    header.extend((kind.len() as u32).to_le_bytes());
    header.extend((sections.len() as u64).to_le_bytes());
    header.extend((total as u64).to_le_bytes());
    header.extend(key.as_bytes());
    header.extend(kind.as_bytes());
    header.resize(FIXED, 0);
    for section in sections {
        header.extend((section.len() as u64).to_le_bytes());
        header.extend(hash(section).as_bytes());
    }
    let checksum = hash(&header);
    header.extend(checksum.as_bytes());
    header
}

fn hash(bytes: &[u8]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    update(&mut hasher, bytes);
    hasher.finalize()
}

/// Checks the whole of a file, and says where its sections lie.
///
/// # Errors
/// What is wrong with it.
pub fn check(file: &[u8], kind: &str, key: Key) -> Result<Vec<Range<usize>>, &'static str> {
    const SHORT: &str = "it is cut off";
    let fixed = file.get(..FIXED).ok_or(SHORT)?;
    if fixed[..8] != MAGIC {
        return Err("it is no entry");
    }
    if word32(fixed, 8) != VERSION {
        return Err("it is of another version");
    }
    if word64(fixed, 24) != file.len() as u64 {
        return Err("its length is wrong");
    }
    let count = usize::try_from(word64(fixed, 16)).ok().ok_or(SHORT)?;
    let end = header_len(count).filter(|end| *end <= file.len()).ok_or(SHORT)?;
    let (covered, checksum) = file[..end].split_at(end - HASH);
    if hash(covered).as_bytes() != checksum {
        return Err("its header is changed");
    }
    let is_its = fixed[32..64] == *key.as_bytes()
        && word32(fixed, 12) as usize == kind.len()
        && fixed[64..].starts_with(kind.as_bytes());
    if !is_its {
        return Err("it is another entry");
    }
    let mut sections = Vec::with_capacity(count);
    let mut at = padded(file, end)?;
    for row in covered[FIXED..].chunks_exact(ROW) {
        let len = usize::try_from(word64(row, 0)).ok().ok_or(SHORT)?;
        let end = at.checked_add(len).filter(|end| *end <= file.len()).ok_or(SHORT)?;
        if hash(&file[at..end]).as_bytes() != &row[8..] {
            return Err("its content is changed");
        }
        sections.push(at..end);
        at = padded(file, end)?;
    }
    if at == file.len() { Ok(sections) } else { Err("something follows it") }
}

/// The end of the zeros that stand behind what ends at `end`.
fn padded(file: &[u8], end: usize) -> Result<usize, &'static str> {
    let zeros = file.get(end..end + gap(end)).ok_or("it is cut off")?;
    if zeros.iter().all(|byte| *byte == 0) { Ok(end + zeros.len()) } else { Err("a gap isn't empty") }
}

fn word32(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|k| bytes[at + k]))
}

fn word64(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|k| bytes[at + k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(sections: &[&[u8]]) -> (Vec<u8>, Key) {
        let key = Key::of("test", |h| h.add_u64(7));
        let mut file = Vec::new();
        write(&mut file, "links", key, sections).unwrap();
        (file, key)
    }

    #[test]
    fn sections_are_found_where_they_were_put() {
        let parts: [&[u8]; 4] = [b"abc", b"", &[9; 64], &[1; 65]];
        let (file, key) = file(&parts);
        assert_eq!(file.len() % ALIGNMENT, 0);
        let found = check(&file, "links", key).unwrap();
        assert!(found.iter().all(|range| range.start % ALIGNMENT == 0));
        assert_eq!(found.iter().map(|range| &file[range.clone()]).collect::<Vec<_>>(), parts);
    }

    #[test]
    fn every_flipped_bit_is_found() {
        let (mut file, key) = file(&[b"abc", b"", &[9; 70]]);
        for k in 0..8 * file.len() {
            file[k / 8] ^= 1 << (k % 8);
            assert!(check(&file, "links", key).is_err(), "bit {k}");
            file[k / 8] ^= 1 << (k % 8);
        }
        assert!(check(&file, "links", key).is_ok());
    }

    #[test]
    fn every_other_length_is_found() {
        for sections in [&[b"abc".as_slice()][..], &[], &[b"abc", b""]] {
            let (file, key) = file(sections);
            (0..file.len()).for_each(|n| assert!(check(&file[..n], "links", key).is_err(), "{n}"));
            for more in [&[0][..], &[0; 64], &[1; 64]] {
                assert!(check(&[&file, more].concat(), "links", key).is_err());
            }
            assert!(check(&file, "links", key).is_ok());
        }
    }

    #[test]
    fn an_entry_is_nothing_but_itself() {
        let (file, key) = file(&[b"abc"]);
        assert_eq!(check(&file, "link", key), Err("it is another entry"));
        assert_eq!(check(&file, "linkss", key), Err("it is another entry"));
        assert_eq!(check(&file, "links", Key::of("other", |_| ())), Err("it is another entry"));
        let mut newer = file.clone();
        newer[8] = 2;
        assert_eq!(check(&newer, "links", key), Err("it is of another version"));
    }

    /// Headers that are whole and claim more than there is: memory is taken for nothing that isn't there.
    #[test]
    fn claims_are_checked_before_they_are_believed() {
        let (file, key) = file(&[b"abc"]);
        for (at, value) in [(16, u64::MAX), (16, u64::MAX / 40), (16, 2), (96, u64::MAX), (96, 65), (96, 1 << 40)] {
            let mut wrong = file.clone();
            wrong[at..at + 8].copy_from_slice(&value.to_le_bytes());
            let checksum = hash(&wrong[..FIXED + ROW]);
            wrong[FIXED + ROW..FIXED + ROW + HASH].copy_from_slice(checksum.as_bytes());
            assert!(check(&wrong, "links", key).is_err(), "{at} {value}");
        }
    }
}
