//! Memory that sixteen lanes read and write at places of their own, with AVX-512.

use std::arch::x86_64::*;
use std::marker::PhantomData;
use std::mem::MaybeUninit;

use esvo_core::reference::MAX_SCALE;

use super::tiles::LANES;

/// The image of an octree, for gathers.
pub(super) struct Image<'a> {
    words: *const i32,
    borrowed: PhantomData<&'a [u32]>,
}

impl<'a> Image<'a> {
    /// Words of the largest image: indices are signed.
    pub(super) const MAX_WORDS: usize = i32::MAX as usize;

    /// `None` if the image has more than [`MAX_WORDS`](Self::MAX_WORDS).
    pub(super) fn new(words: &'a [u32]) -> Option<Self> {
        (words.len() <= Self::MAX_WORDS).then(|| Self { words: words.as_ptr().cast(), borrowed: PhantomData })
    }

    /// The low words of the slots in the lanes of `mask`, 0 in the others.
    ///
    /// # Safety
    /// The slots in the lanes of `mask` are in the image.
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn low_words(&self, mask: __mmask16, slots: __m512i) -> __m512i {
        // SAFETY: the slots are in the image, and their offsets, in units of 8 bytes, fit signed 32-bit numbers.
        unsafe { _mm512_mask_i32gather_epi32::<8>(_mm512_setzero_si512(), mask, slots, self.words) }
    }

    /// The high words of the slots in the lanes of `mask`, 0 in the others.
    ///
    /// # Safety
    /// As for [`low_words`](Self::low_words).
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn high_words(&self, mask: __mmask16, slots: __m512i) -> __m512i {
        // SAFETY: as in `low_words`; the high word lies in the same slot.
        unsafe { _mm512_mask_i32gather_epi32::<8>(_mm512_setzero_si512(), mask, slots, self.words.wrapping_add(1)) }
    }

    /// The words at these places in the lanes of `mask`, 0 in the others.
    ///
    /// # Safety
    /// The places in the lanes of `mask` are in the image.
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn words(&self, mask: __mmask16, at: __m512i) -> __m512i {
        // SAFETY: the places are in the image, and their offsets, in units of 4 bytes, fit signed 32-bit numbers.
        unsafe { _mm512_mask_i32gather_epi32::<4>(_mm512_setzero_si512(), mask, at, self.words) }
    }
}

/// A stack for each lane: a frame for each scale, of a parent's slot and its `t_max`. It starts without contents.
pub(super) struct Stack {
    parent: [[MaybeUninit<i32>; LANES]; MAX_SCALE as usize + 1],
    t_max: [[MaybeUninit<f32>; LANES]; MAX_SCALE as usize + 1],
}

impl Stack {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            parent: [[MaybeUninit::uninit(); LANES]; MAX_SCALE as usize + 1],
            t_max: [[MaybeUninit::uninit(); LANES]; MAX_SCALE as usize + 1],
        }
    }

    /// Writes the frames of the lanes of `mask`.
    ///
    /// # Safety
    /// In the lanes of `mask`, `scale` is at most [`MAX_SCALE`].
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn write(&mut self, mask: __mmask16, scale: __m512i, parent: __m512i, t_max: __m512) {
        let frame = frames(scale);
        // SAFETY: a lane is below 16, so that a frame of these scales lies in both arrays.
        unsafe {
            _mm512_mask_i32scatter_epi32::<4>(self.parent.as_mut_ptr().cast(), mask, frame, parent);
            _mm512_mask_i32scatter_ps::<4>(self.t_max.as_mut_ptr().cast(), mask, frame, t_max);
        }
    }

    /// The frames of the lanes of `mask`; `parent` and `t_max` as they are in the others.
    ///
    /// # Safety
    /// The lanes of `mask` have written a frame of their `scale`.
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn read(
        &self,
        mask: __mmask16,
        scale: __m512i,
        parent: __m512i,
        t_max: __m512,
    ) -> (__m512i, __m512) {
        let frame = frames(scale);
        // SAFETY: the frames that are read were written.
        unsafe {
            (
                _mm512_mask_i32gather_epi32::<4>(parent, mask, frame, self.parent.as_ptr().cast()),
                _mm512_mask_i32gather_ps::<4>(t_max, mask, frame, self.t_max.as_ptr().cast()),
            )
        }
    }
}

/// The frame of each lane at its scale.
#[inline]
#[target_feature(enable = "avx512f")]
fn frames(scale: __m512i) -> __m512i {
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    _mm512_add_epi32(_mm512_slli_epi32::<4>(scale), lanes)
}
