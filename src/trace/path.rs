//! The instructions that rays are traced with, chosen once a tracer; all give the same bits.
// Calls to code for instructions that this processor has.
#![allow(unsafe_code)]

use super::traverse::{Batch, Line, Nearest, walk};
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use glam::Vec3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Path {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Path {
    /// All that this processor has, the fastest last.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "other processors have none but the first")]
        let mut paths = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            let bits = is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("popcnt");
            if is_x86_feature_detected!("avx2") && bits {
                paths.push(Self::Avx2);
                let f_and_dq = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq");
                if f_and_dq && is_x86_feature_detected!("avx512vl") {
                    paths.push(Self::Avx512);
                }
            }
        }
        paths
    }

    /// Hands `answer` the nearest triangle of each ray of a batch that `query` gives, or, for any hit, one of them.
    #[inline]
    pub fn each<const ANY: bool>(
        self,
        batch: &Batch,
        query: impl FnMut(usize) -> (Vec3, Vec3, f32),
        answer: impl FnMut(usize, &Line, Nearest),
    ) {
        match self {
            Self::Portable => {
                batch.each(query, answer, |line, limit, stack| {
                    walk::<ANY>(batch.wide, line, batch.offset, limit, stack)
                });
            }
            // SAFETY: these paths are made by `available` alone, where the processor has their instructions.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::each::<ANY>(batch, query, answer) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::each::<ANY>(batch, query, answer) },
        }
    }
}
