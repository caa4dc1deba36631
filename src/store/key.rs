//! Names of entries: hashes of all that their content depends on.

use bytemuck::NoUninit;
use std::fmt;
use std::str::FromStr;

/// Slices of at least so many bytes are hashed by all threads: below, starting them takes longer.
const LARGE: usize = 1 << 18;

/// A BLAKE3 hash (O'Connor, Aumasson, Neves, Wilcox-O'Hearn 2020), shown as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Key([u8; Self::BYTES]);

impl Key {
    /// Bytes of a key.
    pub const BYTES: usize = 32;

    /// The key of what `add` adds to the hash. `domain` says what it is the key of, and in which version (`"links 1"`): equal content
    /// has other keys in other domains, by BLAKE3's key derivation.
    pub fn of(domain: &str, add: impl FnOnce(&mut Hasher)) -> Self {
        let mut hasher = Hasher(blake3::Hasher::new_derive_key(&format!("lumel {domain}")));
        add(&mut hasher);
        Self(*hasher.0.finalize().as_bytes())
    }

    /// The key that has these bytes.
    pub const fn from_bytes(bytes: [u8; Self::BYTES]) -> Self {
        Self(bytes)
    }

    /// Its bytes.
    pub fn as_bytes(&self) -> &[u8; Self::BYTES] {
        &self.0
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({self})")
    }
}

impl FromStr for Key {
    type Err = String;

    /// Reads what `Display` writes: 64 hexadecimal digits, in lower case.
    fn from_str(text: &str) -> Result<Self, String> {
        let fault = || format!("{text:?} is no key; 64 hexadecimal digits are");
        let is_digit = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
        if text.len() != 2 * Self::BYTES || !text.bytes().all(is_digit) {
            return Err(fault());
        }
        let mut bytes = [0; Self::BYTES];
        for (byte, k) in bytes.iter_mut().zip((0..).step_by(2)) {
            *byte = u8::from_str_radix(&text[k..k + 2], 16).map_err(|_| fault())?;
        }
        Ok(Self(bytes))
    }
}

/// Takes what a key depends on. Each addition says its type and length, so that no two series of additions run together.
///
/// Numbers count by their bits: 0 and -0 differ, which costs work that is done again and nothing else.
pub struct Hasher(blake3::Hasher);

impl Hasher {
    /// Adds bytes.
    pub fn add_bytes(&mut self, bytes: &[u8]) {
        self.add(b'b', 1, bytes);
    }

    /// Adds a text.
    pub fn add_str(&mut self, text: &str) {
        self.add(b's', 1, text.as_bytes());
    }

    /// Adds values by their bytes, as the machine has them; long ones are hashed by all threads.
    pub fn add_slice<T: NoUninit>(&mut self, values: &[T]) {
        self.add(b'v', size_of::<T>() as u64, bytemuck::cast_slice(values));
    }

    /// Adds the text that `{:?}` makes of a value: for small structs of parameters, of which a new field is then part by itself.
    /// Floating-point numbers are written with all their digits.
    pub fn add_debug(&mut self, value: &impl fmt::Debug) {
        self.add(b'd', 1, format!("{value:?}").as_bytes());
    }

    /// Adds another key.
    pub fn add_key(&mut self, key: Key) {
        self.add(b'k', 1, &key.0);
    }

    /// Adds a whole number.
    pub fn add_u64(&mut self, value: u64) {
        self.add(b'u', 1, &value.to_le_bytes());
    }

    fn add(&mut self, kind: u8, unit: u64, bytes: &[u8]) {
        self.0.update(&[kind]);
        self.0.update(&unit.to_le_bytes());
        self.0.update(&(bytes.len() as u64).to_le_bytes());
        update(&mut self.0, bytes);
    }
}

/// Hashes on, by all threads where that is worth it; the hash is the same.
pub(super) fn update(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    if bytes.len() < LARGE {
        hasher.update(bytes);
    } else {
        hasher.update_rayon(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn additions_do_not_run_together() {
        let large = vec![7u32; LARGE];
        let keys = [
            Key::of("a", |_| ()),
            Key::of("b", |_| ()),
            Key::of("a", |h| h.add_bytes(b"")),
            Key::of("a", |h| h.add_str("")),
            Key::of("a", |h| h.add_str("ab")),
            Key::of("a", |h| h.add_bytes(b"ab")),
            Key::of("a", |h| h.add_debug(&"ab")),
            Key::of("a", |h| {
                h.add_str("a");
                h.add_str("b");
            }),
            Key::of("a", |h| h.add_slice(&[1u32, 0])),
            Key::of("a", |h| h.add_slice(&[1u64])),
            Key::of("a", |h| h.add_u64(1)),
            Key::of("a", |h| h.add_slice(&large)),
            Key::of("a", |h| h.add_slice(&large[1..])),
            Key::of("a", |h| h.add_key(Key::of("a", |_| ()))),
        ];
        assert_eq!(keys.iter().collect::<HashSet<_>>().len(), keys.len());
        assert_eq!(Key::of("a", |h| h.add_str("ab")), keys[4]);
    }

    #[test]
    fn threads_do_not_change_a_hash() {
        let bytes: Vec<u8> = (0..3 * LARGE).map(|i| (i * i / 128) as u8).collect();
        let (mut one, mut all) = (blake3::Hasher::new(), blake3::Hasher::new());
        one.update(&bytes);
        update(&mut all, &bytes);
        assert_eq!(one.finalize(), all.finalize());
    }

    #[test]
    fn keys_are_read_as_they_are_shown() {
        let key = Key::of("a", |h| h.add_debug(&(1.5f32, Some(2))));
        assert_eq!(key.to_string().parse(), Ok(key));
        for wrong in ["", "0", &key.to_string().to_uppercase(), &format!("{key}0"), &"ä".repeat(32)] {
            assert!(wrong.parse::<Key>().is_err(), "{wrong}");
        }
        assert_eq!(Key::from_bytes(*key.as_bytes()), key);
    }
}
