//! The values of a node, and which of them are active.

use super::blosc;
use super::bytes::{Bytes, Fault};
use std::io::Read;

/// Bits of a grid's compression.
const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;

/// One bit for each value of a node.
pub(super) struct Mask(Vec<u64>);

impl Mask {
    /// The mask of a node with 2^`side` values along each side.
    pub fn read(file: &mut Bytes, side: u32) -> Result<Self, Fault> {
        let bytes = file.take((1 << (3 * side)) / 8)?;
        Ok(Self(
            bytes
                .chunks_exact(8)
                .map(|b| b.iter().rev().fold(0, |word, &byte| (word << 8) | u64::from(byte)))
                .collect(),
        ))
    }

    fn len(&self) -> usize {
        64 * self.0.len()
    }

    pub fn is_on(&self, i: usize) -> bool {
        (self.0[i / 64] >> (i % 64)) & 1 != 0
    }

    pub fn ones(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).filter(|&i| self.is_on(i))
    }

    fn count(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }
}

/// How a grid keeps its values.
pub(super) struct Values {
    pub compression: u32,
    pub is_half: bool,
    pub background: f32,
}

impl Values {
    /// The values of a node whose active ones are `active`, as many as that has bits. The byte in front says which values the
    /// inactive ones have, of which the file then holds none.
    pub fn read(&self, file: &mut Bytes, active: &Mask) -> Result<Vec<f32>, Fault> {
        let form = file.u8()?;
        let mut inactive = [if form == 0 { self.background } else { -self.background }, self.background];
        if matches!(form, 2 | 4 | 5) {
            inactive[0] = file.f32()?;
        }
        if form == 5 {
            inactive[1] = file.f32()?;
        }
        let selection = match form {
            // As long as the mask of active ones, which has the node's side.
            3..=5 => Some(Mask::read(file, active.len().ilog2() / 3)?),
            0..=2 | 6 => None,
            _ => return Err(Fault::Cut),
        };
        let is_sparse = self.compression & ACTIVE_MASK != 0 && form != 6;
        let stored = self.stored(file, if is_sparse { active.count() } else { active.len() })?;
        if !is_sparse {
            return Ok(stored);
        }
        let mut next = stored.into_iter();
        let value = |i| match active.is_on(i) {
            true => next.next().unwrap_or_default(),
            false => inactive[usize::from(selection.as_ref().is_some_and(|mask| mask.is_on(i)))],
        };
        Ok((0..active.len()).map(value).collect())
    }

    /// `count` values as they are stored.
    fn stored(&self, file: &mut Bytes, count: usize) -> Result<Vec<f32>, Fault> {
        // Of no half floats not even the length is written.
        if self.is_half && count == 0 {
            return Ok(Vec::new());
        }
        let size = count * if self.is_half { 2 } else { 4 };
        let packed;
        let bytes = if self.compression & (ZIP | BLOSC) == 0 {
            file.take(size)?
        } else {
            let length = file.i64()?;
            let taken = file.take(usize::try_from(length.unsigned_abs()).map_err(|_| Fault::Cut)?)?;
            if length <= 0 {
                taken
            } else if self.compression & BLOSC != 0 {
                packed = blosc::unpack(taken, size)?;
                &packed
            } else {
                let mut unpacked = Vec::with_capacity(size);
                let decoder = flate2::read::ZlibDecoder::new(taken).take(size as u64);
                { decoder }.read_to_end(&mut unpacked).map_err(|_| Fault::Cut)?;
                packed = unpacked;
                &packed
            }
        };
        if bytes.len() != size {
            return Err(Fault::Cut);
        }
        Ok(match self.is_half {
            true => bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            false => bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
        })
    }
}
