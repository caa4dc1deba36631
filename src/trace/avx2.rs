//! The traversal with AVX2: eight children or eight triangles at a time.
//!
//! Triangles are tested by the operations of `watertight`, in its order and without fused multiplication, so that each lane holds
//! the bits that the portable path finds. Where a ray crosses an edge the triangle is left to it.
// Loads and stores of registers; indices into the tree unchecked, which is worth 2 % of a ray's time.
#![allow(unsafe_code)]

use super::traverse::{Batch, Line, Nearest, push};
use super::wide::{Block, Child, Node, WIDTH, Wide};
use glam::Vec3;
use std::arch::x86_64::*;

/// [`Batch::each`] with AVX2.
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn each<const ANY: bool>(
    batch: &Batch,
    query: impl FnMut(usize) -> (Vec3, Vec3, f32),
    answer: impl FnMut(usize, &Line, Nearest),
) {
    batch.each(query, answer, |line, limit, stack| walk::<ANY>(batch.wide, line, batch.offset, limit, stack));
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn walk<const ANY: bool>(wide: &Wide, line: &Line, offset: f32, limit: f32, stack: &mut [u64]) -> Nearest {
    let near_side = |k: usize| (_mm256_set1_ps(line.near[k]), _mm256_set1_ps(line.inverse[k]), line.negative[k]);
    let [x, y, z] = [near_side(0), near_side(1), near_side(2)];
    let [fx, fy, fz] = [_mm256_set1_ps(line.far[0]), _mm256_set1_ps(line.far[1]), _mm256_set1_ps(line.far[2])];
    let triangles = Triangles::new(line);

    let mut best = Nearest::none(limit);
    let (mut top, mut child) = (0, Child::ROOT);
    loop {
        if child.is_block() {
            // SAFETY: children index into the tree that they are part of.
            let block = unsafe { wide.blocks.get_unchecked(child.index()) };
            if triangles.test::<ANY>(block, child.index(), line, offset, &mut best) && ANY {
                return best;
            }
        } else {
            // SAFETY: as above.
            let node: &Node = unsafe { wide.nodes.get_unchecked(child.index()) };
            let planes = |axis: usize, side: usize, origin, inverse| {
                // SAFETY: eight numbers a side; sides are 0 and 1.
                let planes = unsafe { _mm256_load_ps(node.bounds[axis].get_unchecked(side).as_ptr()) };
                _mm256_mul_ps(_mm256_sub_ps(planes, origin), inverse)
            };
            let near = _mm256_max_ps(
                _mm256_max_ps(planes(0, x.2, x.0, x.1), planes(1, y.2, y.0, y.1)),
                _mm256_max_ps(planes(2, z.2, z.0, z.1), _mm256_setzero_ps()),
            );
            let far = _mm256_min_ps(
                _mm256_min_ps(planes(0, 1 - x.2, fx, x.1), planes(1, 1 - y.2, fy, y.1)),
                _mm256_min_ps(planes(2, 1 - z.2, fz, z.1), _mm256_set1_ps(best.t)),
            );
            let mut met = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32;
            if met != 0 {
                if met & (met - 1) == 0 {
                    child = node.children[met.trailing_zeros() as usize & (WIDTH - 1)];
                    continue;
                }
                let mut distances = [0.0f32; WIDTH];
                // SAFETY: eight numbers.
                unsafe { _mm256_storeu_ps(distances.as_mut_ptr(), near) };
                let first = top;
                while met != 0 {
                    let lane = met.trailing_zeros() as usize & (WIDTH - 1);
                    met &= met - 1;
                    push(stack, first, &mut top, distances[lane], node.children[lane]);
                }
            }
        }
        // The next subtree that may hold something nearer.
        loop {
            if top == 0 {
                return best;
            }
            top -= 1;
            let key = stack[top];
            if f32::from_bits((key >> 32) as u32) <= best.t {
                child = Child(key as u32);
                break;
            }
        }
    }
}

/// What a ray needs to test blocks.
pub(super) struct Triangles {
    axes: [usize; 3],
    origin: [__m256; 3],
    shear: [__m256; 3],
}

impl Triangles {
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub fn new(line: &Line) -> Self {
        let axes = line.shear.axes;
        Self {
            axes,
            origin: [
                _mm256_set1_ps(line.shear.origin[axes[0]]),
                _mm256_set1_ps(line.shear.origin[axes[1]]),
                _mm256_set1_ps(line.shear.origin[axes[2]]),
            ],
            shear: [
                _mm256_set1_ps(line.shear.shear[0]),
                _mm256_set1_ps(line.shear.shear[1]),
                _mm256_set1_ps(line.shear.shear[2]),
            ],
        }
    }

    /// Takes what lies nearer; whether there was something, for any hit.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub fn test<const ANY: bool>(
        &self,
        block: &Block,
        index: usize,
        line: &Line,
        offset: f32,
        best: &mut Nearest,
    ) -> bool {
        let [sx, sy, sz] = self.shear;
        let relative = |corner: usize| {
            let from = |i: usize| {
                // SAFETY: eight numbers a corner and axis.
                let position = unsafe { _mm256_load_ps(block.corners[corner].get_unchecked(self.axes[i]).as_ptr()) };
                _mm256_sub_ps(position, self.origin[i])
            };
            let z = from(2);
            [_mm256_sub_ps(from(0), _mm256_mul_ps(sx, z)), _mm256_sub_ps(from(1), _mm256_mul_ps(sy, z)), z]
        };
        let [a, b, c] = [relative(0), relative(1), relative(2)];
        let edge = |p: [__m256; 3], q: [__m256; 3]| _mm256_sub_ps(_mm256_mul_ps(p[0], q[1]), _mm256_mul_ps(p[1], q[0]));
        let [u, v, w] = [edge(c, b), edge(a, c), edge(b, a)];
        let zero = _mm256_setzero_ps();
        let least = _mm256_min_ps(_mm256_min_ps(u, v), w);
        let most = _mm256_max_ps(_mm256_max_ps(u, v), w);
        let missed = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(least, zero), _mm256_cmp_ps::<_CMP_GT_OQ>(most, zero));
        let crossed = !_mm256_movemask_ps(missed) as u32 & 0xff;
        if crossed == 0 {
            return false;
        }
        let on = |e| _mm256_cmp_ps::<_CMP_EQ_OQ>(e, zero);
        let on_edge = _mm256_movemask_ps(_mm256_or_ps(_mm256_or_ps(on(u), on(v)), on(w))) as u32;
        let determinant = _mm256_add_ps(_mm256_add_ps(u, v), w);
        let inverse = _mm256_div_ps(_mm256_set1_ps(1.0), determinant);
        let sum = _mm256_add_ps(_mm256_mul_ps(u, a[2]), _mm256_mul_ps(v, b[2]));
        let sum = _mm256_add_ps(sum, _mm256_mul_ps(w, c[2]));
        let t = _mm256_mul_ps(_mm256_mul_ps(sum, sz), inverse);
        let back = _mm256_cmp_ps::<_CMP_LT_OQ>(determinant, zero);
        let counted = if ANY { t } else { _mm256_blendv_ps(t, _mm256_add_ps(t, _mm256_set1_ps(offset)), back) };
        let ahead =
            _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(t, zero), _mm256_cmp_ps::<_CMP_NEQ_OQ>(determinant, zero));
        let reach = _mm256_set1_ps(best.t);
        let near =
            if ANY { _mm256_cmp_ps::<_CMP_LT_OQ>(counted, reach) } else { _mm256_cmp_ps::<_CMP_LE_OQ>(counted, reach) };
        let mut hit = crossed & !on_edge & _mm256_movemask_ps(_mm256_and_ps(ahead, near)) as u32;
        if ANY && hit != 0 {
            // Which one doesn't matter.
            best.number = block.numbers[hit.trailing_zeros() as usize & (WIDTH - 1)];
            return true;
        }
        let mut found = false;
        let mut distances = [0.0f32; WIDTH];
        // SAFETY: eight numbers.
        unsafe { _mm256_storeu_ps(distances.as_mut_ptr(), counted) };
        while hit != 0 {
            let lane = hit.trailing_zeros() as usize;
            hit &= hit - 1;
            found |= best.take::<ANY>(distances[lane & (WIDTH - 1)], block, index, lane);
        }
        let unsure = crossed & on_edge;
        if unsure != 0 {
            found |= on_edges::<ANY>(unsure, line, block, index, offset, best);
        }
        found
    }
}

/// The lanes that a ray crosses on an edge, or next to it: apart, so that they don't cost the others their registers.
#[cold]
#[inline(never)]
fn on_edges<const ANY: bool>(
    lanes: u32,
    line: &Line,
    block: &Block,
    index: usize,
    offset: f32,
    best: &mut Nearest,
) -> bool {
    let lanes = (0..WIDTH).filter(|lane| lanes >> lane & 1 != 0);
    let mut found = false;
    for lane in lanes {
        found |= best.test::<ANY>(line, block, index, lane, offset);
    }
    found
}
