//! What `fearless_simd` has not: numbers from places that differ from lane to lane.

use fearless_simd::i32x8;
use fearless_simd::prelude::*;

/// Vectors with which bytes can be gathered.
pub(super) trait Gather: Simd {
    /// The byte at each place, and three that follow it, in the order of the machine. Places behind the last byte are taken for it.
    fn gather(self, bytes: &[u8], at: i32x8<Self>) -> i32x8<Self>;

    /// The numbers of a table at places from 0 to 7.
    fn pick(self, table: i32x8<Self>, at: i32x8<Self>) -> i32x8<Self>;
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use fearless_simd::prelude::*;
    use fearless_simd::{Avx2, i32x8};

    use super::Gather;

    impl Gather for Avx2 {
        #[inline(always)]
        fn gather(self, bytes: &[u8], at: i32x8<Self>) -> i32x8<Self> {
            gather(self, bytes, at.into()).simd_into(self)
        }

        #[inline(always)]
        fn pick(self, table: i32x8<Self>, at: i32x8<Self>) -> i32x8<Self> {
            pick(self, table.into(), at.into()).simd_into(self)
        }
    }

    fearless_simd::kernel!(
        #[inline(always)]
        fn pick(avx2: Avx2, table: __m256i, at: __m256i) -> __m256i {
            _mm256_permutevar8x32_epi32(table, at)
        }
    );

    fearless_simd::kernel!(
        #[inline(always)]
        fn gather(avx2: Avx2, bytes: &[u8], at: __m256i) -> __m256i {
            if bytes.len() < 4 || bytes.len() > i32::MAX as usize {
                return _mm256_setzero_si256();
            }
            let last = bytes.len() as i32 - 4;
            let at = _mm256_min_epu32(at, _mm256_set1_epi32(last));
            // SAFETY: Four bytes are read from each place. The places are at most `last` as numbers without a sign, so they are not negative,
            // and the four bytes at `last` are the last of the slice.
            unsafe { _mm256_i32gather_epi32::<1>(bytes.as_ptr().cast(), at) }
        }
    );
}
