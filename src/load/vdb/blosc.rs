//! Blosc 1 containers with LZ4 inside (c-blosc, README_HEADER.rst): blocks of streams, bytes shuffled by their place in a number.

use super::bytes::{Bytes, Fault};

/// Bits of the flags; the compressor stands above them.
const SHUFFLED: u8 = 1;
const STORED: u8 = 2;
const BIT_SHUFFLED: u8 = 4;
const WHOLE: u8 = 16;
const LZ4: u8 = 1;

/// Blocks are split into a stream for each byte of a number up to this many bytes, where each has at least so many numbers.
const MOST_STREAMS: usize = 16;
const LEAST_NUMBERS: usize = 128;

/// The `size` bytes that the container `packed` holds.
pub(super) fn unpack(packed: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
    let mut file = Bytes::new(packed, 2);
    let (flags, width) = (file.u8()?, usize::from(file.u8()?));
    let [unpacked, block, length] = [file.u32()? as usize, file.u32()? as usize, file.u32()? as usize];
    // The caller knows how much there must be: nothing larger is made.
    if unpacked != size || length > packed.len() || width == 0 {
        return Err(Fault::Cut);
    }
    if flags & STORED != 0 {
        return Ok(file.take(size)?.to_vec());
    }
    if flags >> 5 != LZ4 || flags & BIT_SHUFFLED != 0 {
        return Err(Fault::Unsupported("a grid compressed by Blosc without LZ4; save it again by OpenVDB".into()));
    }
    if block == 0 {
        return Err(Fault::Cut);
    }
    let mut starts = Vec::new();
    for _ in 0..size.div_ceil(block) {
        starts.push(file.u32()? as usize);
    }
    let mut all = Vec::with_capacity(size);
    for (i, start) in starts.into_iter().enumerate() {
        let length = block.min(size - i * block);
        let is_split = width <= MOST_STREAMS && block / width >= LEAST_NUMBERS && length == block && flags & WHOLE == 0;
        let streams = if is_split { width } else { 1 };
        let unpacked = unpack_block(Bytes::new(packed, start), length, streams)?;
        if flags & SHUFFLED != 0 && width > 1 { unshuffle(&unpacked, width, &mut all) } else { all.extend(unpacked) }
    }
    Ok(all)
}

/// A block of `length` bytes, of so many streams of equal length.
fn unpack_block(mut file: Bytes, length: usize, streams: usize) -> Result<Vec<u8>, Fault> {
    let mut block = vec![0; length];
    for stream in block.chunks_exact_mut(length / streams) {
        let packed = file.u32()? as usize;
        let bytes = file.take(packed)?;
        if packed == stream.len() {
            stream.copy_from_slice(bytes);
        } else if lz4_flex::block::decompress_into(bytes, stream).ok() != Some(stream.len()) {
            return Err(Fault::Cut);
        }
    }
    Ok(block)
}

/// Appends numbers of `width` bytes of which `block` has all first bytes, then all second ones, and so on; what is left over follows
/// as it is.
fn unshuffle(block: &[u8], width: usize, all: &mut Vec<u8>) {
    let count = block.len() / width;
    for i in 0..count {
        all.extend((0..width).map(|byte| block[byte * count + i]));
    }
    all.extend(&block[count * width..]);
}
