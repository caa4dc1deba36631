//! What unwrappers made of parts of meshes, by what these are: found once for as long as a mesh stays as it is.
//!
//! That saves their time, and more: xatlas lays out several parts at once, so that what it makes of one differs in its last bits with what
//! else there is. Remembered charts are the same to the bit, and so are the texels of objects beside which others come and go.

use super::params::Unwrapper;
use super::part::{Part, Unwrapped};
use crate::store::Key;
use std::collections::BTreeMap;

/// Parts, and what was made of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts(BTreeMap<Key, Unwrapped>);

/// Bytes of the numbers before each part: its triangles, its charts, and whether UVs are in double precision.
const HEAD: usize = 12;

/// The key of what `unwrapper` makes of `part`.
pub(super) fn key(part: &Part, unwrapper: Unwrapper) -> Key {
    Key::of("part 1", |hasher| {
        hasher.add_debug(&unwrapper);
        hasher.add_slice(&part.positions);
        hasher.add_slice(&part.triangles);
        hasher.add_slice(&part.polygons);
    })
}

impl Parts {
    /// What was made of the part with this key, where it is known.
    pub(super) fn find(&self, key: Key) -> Option<&Unwrapped> {
        self.0.get(&key)
    }

    /// Adds what was made of a part.
    pub(super) fn put(&mut self, key: Key, unwrapped: Unwrapped) {
        self.0.insert(key, unwrapped);
    }

    /// All parts as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (key, Unwrapped { chart, chart_count, uv }) in &self.0 {
            let values = || uv.as_flattened().as_flattened();
            let is_double = values().iter().any(|v| f64::from(*v as f32).to_bits() != v.to_bits());
            bytes.extend(key.as_bytes());
            for number in [chart.len() as u32, *chart_count, u32::from(is_double)] {
                bytes.extend(number.to_le_bytes());
            }
            bytes.extend(chart.iter().flat_map(|c| c.to_le_bytes()));
            match is_double {
                true => bytes.extend(values().iter().flat_map(|v| v.to_le_bytes())),
                false => bytes.extend(values().iter().flat_map(|v| (*v as f32).to_le_bytes())),
            }
        }
        bytes
    }

    /// The parts that [`to_bytes`](Self::to_bytes) wrote; `None` where these are no such bytes.
    pub fn from_bytes(mut bytes: &[u8]) -> Option<Self> {
        let mut parts = BTreeMap::new();
        let mut take = |count: usize| {
            let (taken, rest) = bytes.split_at_checked(count)?;
            bytes = rest;
            Some(taken)
        };
        while let Some(key) = take(Key::BYTES) {
            let key = Key::from_bytes(key.try_into().ok()?);
            let [count, chart_count, is_double] = words(take(HEAD)?)[..] else { return None };
            if chart_count > count {
                return None;
            }
            let chart = words(take(4 * count as usize)?);
            let size = if is_double == 1 { 8 } else { 4 };
            let values = take(6 * size * count as usize)?.chunks_exact(size);
            let values: Vec<f64> = values
                .map(|v| match v {
                    &[a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
                    _ => v.try_into().map_or(0.0, f64::from_le_bytes),
                })
                .collect();
            let uv = values.chunks_exact(6).map(|v| [[v[0], v[1]], [v[2], v[3]], [v[4], v[5]]]).collect();
            parts.insert(key, Unwrapped { chart, chart_count, uv });
        }
        bytes.is_empty().then_some(Self(parts))
    }
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_come_back_from_bytes() {
        let of = |v: f64| Unwrapped {
            chart: vec![0, u32::MAX],
            chart_count: 1,
            uv: vec![[[v, 2.0], [0.5, 1.0], [3.0, 4.0]]; 2],
        };
        let mut parts = Parts::default();
        let part = |x: f32| Part { positions: vec![[x, 0.0, 0.0]], ..Part::default() };
        parts.put(key(&part(1.0), Unwrapper::Xatlas), of(0.25));
        parts.put(key(&part(1.0), Unwrapper::Uvunwrap), of(0.1));
        parts.put(key(&part(2.0), Unwrapper::Xatlas), Unwrapped::none(0));
        let bytes = parts.to_bytes();
        assert_eq!(Parts::from_bytes(&bytes), Some(parts));
        assert_eq!(Parts::from_bytes(&bytes[..bytes.len() - 1]), None);
        let mut many = bytes.clone();
        many[Key::BYTES + 4..Key::BYTES + 8].fill(0xff);
        assert_eq!(Parts::from_bytes(&many), None, "more charts than triangles");
        assert_eq!(Parts::from_bytes(&[]), Some(Parts::default()));
    }
}
