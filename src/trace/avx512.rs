//! The traversal with AVX-512: near and far planes of eight children share a register, and so does the sorting of those met.
// Loads and stores of registers; indices into the tree unchecked, which is worth 2 % of a ray's time.
#![allow(unsafe_code)]

use super::avx2::Triangles;
use super::traverse::{Batch, Line, Nearest};
use super::wide::{Child, Node, WIDTH, Wide};
use glam::Vec3;
use std::arch::x86_64::*;

/// [`Batch::each`] with AVX-512.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn each<const ANY: bool>(
    batch: &Batch,
    query: impl FnMut(usize) -> (Vec3, Vec3, f32),
    answer: impl FnMut(usize, &Line, Nearest),
) {
    batch.each(query, answer, |line, limit, stack| walk::<ANY>(batch.wide, line, batch.offset, limit, stack));
}

#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
fn walk<const ANY: bool>(wide: &Wide, line: &Line, offset: f32, limit: f32, stack: &mut [u64]) -> Nearest {
    let spread = |near: f32, far: f32| _mm512_insertf32x8::<1>(_mm512_set1_ps(near), _mm256_set1_ps(far));
    let [ox, oy, oz] =
        [spread(line.near[0], line.far[0]), spread(line.near[1], line.far[1]), spread(line.near[2], line.far[2])];
    let [ix, iy, iz] = [
        spread(line.inverse[0], -line.inverse[0]),
        spread(line.inverse[1], -line.inverse[1]),
        spread(line.inverse[2], -line.inverse[2]),
    ];
    // Lower sides come first in a node; where the ray runs against the axis the upper are near.
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let turned = |k: usize| _mm512_xor_si512(lanes, _mm512_set1_epi32(8 * line.negative[k] as i32));
    let [tx, ty, tz] = [turned(0), turned(1), turned(2)];
    let triangles = Triangles::new(line);

    let mut best = Nearest::none(limit);
    let mut limits = spread(0.0, -limit);
    let (mut top, mut child) = (0, Child::ROOT);
    loop {
        if child.is_block() {
            if top > 0 {
                prefetch(wide, Child(stack[top - 1] as u32));
            }
            // SAFETY: children index into the tree that they are part of.
            let block = unsafe { wide.blocks.get_unchecked(child.index()) };
            let before = best.t;
            if triangles.test::<ANY>(block, child.index(), line, offset, &mut best) && ANY {
                return best;
            }
            if best.t < before {
                limits = spread(0.0, -best.t);
            }
        } else {
            // SAFETY: as above.
            let node: &Node = unsafe { wide.nodes.get_unchecked(child.index()) };
            let planes = |k: usize, order, origin, inverse| {
                // SAFETY: the sides of an axis are sixteen numbers in a row.
                let planes = unsafe { _mm512_load_ps(node.bounds[k].as_ptr().cast()) };
                _mm512_mul_ps(_mm512_sub_ps(_mm512_permutexvar_ps(order, planes), origin), inverse)
            };
            let [x, y, z] = [planes(0, tx, ox, ix), planes(1, ty, oy, iy), planes(2, tz, oz, iz)];
            let ends = _mm512_max_ps(_mm512_max_ps(x, y), _mm512_max_ps(z, limits));
            let near = _mm512_castps512_ps256(ends);
            let far = _mm256_xor_ps(_mm512_extractf32x8_ps::<1>(ends), _mm256_set1_ps(-0.0));
            let met = _mm256_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
            if met != 0 {
                if met & (met - 1) == 0 {
                    child = node.children[met.trailing_zeros() as usize & (WIDTH - 1)];
                    continue;
                }
                // SAFETY: eight words.
                let children = unsafe { _mm256_load_si256(node.children.as_ptr().cast()) };
                let distance = _mm512_slli_epi64::<32>(_mm512_cvtepu32_epi64(_mm256_castps_si256(near)));
                let keys = _mm512_or_si512(distance, _mm512_cvtepu32_epi64(children));
                let count = met.count_ones() as usize;
                let open = &mut stack[top..top + WIDTH];
                top += count - 1;
                if ANY {
                    let keys = _mm512_maskz_compress_epi64(met, keys);
                    // SAFETY: `open` has eight words.
                    unsafe { _mm512_storeu_si512(open.as_mut_ptr().cast(), keys) };
                    child = Child(open[count - 1] as u32);
                    continue;
                }
                // Absent keys last.
                let keys = _mm512_mask_compress_epi64(_mm512_set1_epi64(-1), met, keys);
                let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
                child = Child(_mm_cvtsi128_si64(_mm512_castsi512_si128(keys)) as u32);
                let turn =
                    _mm512_sub_epi64(_mm512_set1_epi64(count as i64 - 1), _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 6, 7));
                let keys = _mm512_permutexvar_epi64(turn, keys);
                // SAFETY: `open` has eight words.
                unsafe { _mm512_storeu_si512(open.as_mut_ptr().cast(), keys) };
                continue;
            }
        }
        // The next subtree that may hold something nearer.
        loop {
            if top == 0 {
                return best;
            }
            top -= 1;
            let key = stack[top];
            if ANY || f32::from_bits((key >> 32) as u32) <= best.t {
                child = Child(key as u32);
                break;
            }
        }
    }
}

/// Brings a subtree's first node or block near before its turn.
#[inline(always)]
fn prefetch(wide: &Wide, child: Child) {
    let at: *const i8 = if child.is_block() {
        wide.blocks.as_ptr().wrapping_add(child.index()).cast()
    } else {
        wide.nodes.as_ptr().wrapping_add(child.index()).cast()
    };
    for line in 0..5 {
        // SAFETY: prefetching has no effect but on caches, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(64 * line)) };
    }
}

/// The first four keys, least first.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
fn sort4(keys: __m512i) -> __m512i {
    let keys = _mm512_castsi512_si256(keys);
    let swapped = _mm256_shuffle_epi32::<0b01_00_11_10>(keys);
    let keys = _mm256_mask_max_epu64(_mm256_min_epu64(keys, swapped), 0b1010, keys, swapped);
    let swapped = _mm256_permute4x64_epi64::<0b00_01_10_11>(keys);
    let keys = _mm256_mask_max_epu64(_mm256_min_epu64(keys, swapped), 0b1100, keys, swapped);
    let swapped = _mm256_shuffle_epi32::<0b01_00_11_10>(keys);
    let keys = _mm256_mask_max_epu64(_mm256_min_epu64(keys, swapped), 0b1010, keys, swapped);
    _mm512_castsi256_si512(keys)
}

/// Eight keys, least first: Batcher's bitonic network.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
fn sort8(keys: __m512i) -> __m512i {
    let step = |keys, swapped, upper| _mm512_mask_max_epu64(_mm512_min_epu64(keys, swapped), upper, keys, swapped);
    let keys = step(keys, _mm512_shuffle_epi32::<0b01_00_11_10>(keys), 0b1010_1010);
    let keys = step(keys, _mm512_permutex_epi64::<0b00_01_10_11>(keys), 0b1100_1100);
    let keys = step(keys, _mm512_shuffle_epi32::<0b01_00_11_10>(keys), 0b1010_1010);
    let turned = _mm512_setr_epi64(7, 6, 5, 4, 3, 2, 1, 0);
    let keys = step(keys, _mm512_permutexvar_epi64(turned, keys), 0b1111_0000);
    let keys = step(keys, _mm512_permutex_epi64::<0b01_00_11_10>(keys), 0b1100_1100);
    step(keys, _mm512_shuffle_epi32::<0b01_00_11_10>(keys), 0b1010_1010)
}
