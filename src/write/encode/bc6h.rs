//! BC6H (unsigned half floats in blocks of 4 x 4, Direct3D 11 functional specification, section 19.5.12), by a port of
//! Intel's ISPC texture compressor.

use super::half;
use crate::post::PageImage;
use block_compression::{BC6HSettings, CompressionVariant, encode::compress_rgba16};
use half::f16;
use rayon::prelude::*;

/// Texels along an edge of a block, and bytes of one.
const SIDE: usize = 4;
const BLOCK: usize = 16;

/// The blocks of a page, row by row from the top; what reaches beyond its edges repeats the last texel.
pub fn encode(page: &PageImage) -> Vec<u8> {
    let (width, height) = (page.width as usize, page.height as usize);
    let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
    let mut blocks = vec![0; columns * rows * BLOCK];
    // The compressor works on one thread, and blocks don't depend on each other.
    blocks.par_chunks_mut(columns * BLOCK).enumerate().for_each(|(row, blocks)| {
        let mut texels = vec![f16::ZERO; columns * SIDE * SIDE * 4];
        for (i, texel) in texels.chunks_exact_mut(4).enumerate() {
            let (x, y) = ((i % (columns * SIDE)).min(width - 1), (row * SIDE + i / (columns * SIDE)).min(height - 1));
            let color = page.rgb[y * width + x];
            texel.copy_from_slice(&[half(color.x), half(color.y), half(color.z), f16::ONE]);
        }
        let width = (columns * SIDE) as u32;
        let variant = CompressionVariant::BC6H(BC6HSettings::basic());
        compress_rgba16(variant, &texels, blocks, width, SIDE as u32, width * 4);
    });
    blocks
}
