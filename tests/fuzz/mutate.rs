//! What is done to sound files: changes of bytes, numbers and JSON leaves, drawn from a seed.

use serde_json::{Value, json};

/// Pseudo-random numbers (Vigna, "xorshift*", 2014), the same on every machine.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `n`, which is more than 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next() >> 16) % n as u64) as usize
    }
}

/// Numbers at which readers break: the ends of ranges, and sizes beyond any memory.
const EDGES: [u64; 14] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x00ff_ffff,
    0x7fff_ffff,
    0xffff_ffff,
    0x0001_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_fff8,
    u64::MAX,
];

/// Texts in place of numbers, for formats of text.
const TEXTS: [&str; 12] =
    ["0", "-1", "1e38", "-1e39", "nan", "inf", "99999999999999999999", "2147483648", "4294967295", "1e-45", "", "@"];

/// `seed` with up to eight changes; some take a part of `other`.
pub fn mutate(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..1 + random.below(8) {
        if bytes.is_empty() {
            return bytes;
        }
        let at = random.below(bytes.len());
        let length = 1 + random.below(bytes.len().min(64));
        let end = (at + length).min(bytes.len());
        match random.below(10) {
            0 | 1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at] = random.next() as u8,
            3 | 4 => {
                let edge = EDGES[random.below(EDGES.len())].to_le_bytes();
                let width = [1, 2, 4, 8][random.below(4)].min(bytes.len() - at);
                bytes[at..at + width].copy_from_slice(&edge[..width]);
            }
            5 => drop(bytes.drain(at..end)),
            6 => {
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            7 if !other.is_empty() => {
                let from = random.below(other.len());
                let part = other[from..(from + length).min(other.len())].to_vec();
                bytes.splice(at..end, part);
            }
            8 => change_number(&mut bytes, at, random),
            _ if random.below(4) == 0 => bytes.truncate(at),
            _ => {}
        }
    }
    bytes
}

/// Puts another text in place of the number written at or after `at`.
fn change_number(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let is_part = |b: &u8| b.is_ascii_digit() || *b == b'.';
    let Some(first) = bytes[at..].iter().position(is_part).map(|i| at + i) else { return };
    let end = bytes[first..].iter().position(|b| !is_part(b)).map_or(bytes.len(), |i| first + i);
    bytes.splice(first..end, TEXTS[random.below(TEXTS.len())].bytes());
}

/// The GLB `seed` with up to four values of its JSON changed; its container stays sound.
pub fn mutate_json(seed: &[u8], random: &mut Random) -> Vec<u8> {
    let length = u32::from_le_bytes(seed[12..16].try_into().unwrap()) as usize;
    let mut json: Value = serde_json::from_slice(&seed[20..20 + length]).unwrap();
    for _ in 0..1 + random.below(4) {
        change_value(&mut json, random);
    }
    let mut text = serde_json::to_vec(&json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &seed[20 + length..];
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((20 + text.len() + rest.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend(rest);
    out
}

/// Changes one value somewhere below `value`.
fn change_value(value: &mut Value, random: &mut Random) {
    match value {
        Value::Object(map) if !map.is_empty() && random.below(12) > 0 => {
            let index = random.below(map.len());
            let key = map.keys().nth(index).cloned().unwrap_or_default();
            if random.below(16) == 0 {
                map.remove(&key);
            } else if let Some(inner) = map.get_mut(&key) {
                change_value(inner, random);
            }
        }
        Value::Array(items) if !items.is_empty() && random.below(12) > 0 => {
            let index = random.below(items.len());
            match random.below(16) {
                0 => drop(items.remove(index)),
                1 => items.push(items[index].clone()),
                _ => change_value(&mut items[index], random),
            }
        }
        _ => {
            *value = match random.below(10) {
                0 => json!(null),
                1 => json!("\u{0}../x"),
                2 => json!([]),
                3 => json!(-1),
                4 => json!(1e39),
                5 => json!(random.below(8)),
                6 => json!([5120, 5121, 5122, 5123, 5125, 5126][random.below(6)]),
                7 => json!(["SCALAR", "VEC2", "VEC3", "VEC4", "MAT4"][random.below(5)]),
                _ => json!(EDGES[random.below(EDGES.len())]),
            };
        }
    }
}
