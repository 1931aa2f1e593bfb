//! The choice of vectors: code that is generic over the vectors of `fearless_simd` is compiled for each of them, and those
//! that the processor has are found when it runs.

use esvo_core::reference::EPSILON;
use fearless_simd::prelude::*;
use fearless_simd::{Fallback, Level, f32x16};

/// Vectors that casters are compiled for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Vectors {
    /// Plain arrays, on every processor.
    Arrays,
    Neon,
    /// On every x86-64 processor.
    Sse2,
    Avx2,
    Avx512,
}

/// Code that is compiled for all vectors.
pub(crate) trait Work {
    type Output;

    /// Does the work, in a closure that is passed to [`Simd::vectorize`]. `TILES` and `LISTS`: whether code for tiles of
    /// pictures and for lists of rays is worth compiling, see `octree::shared`.
    ///
    /// The closure, and all functions and closures in it that compute with vectors, need `#[inline(always)]`: what is not
    /// inlined is compiled without the instructions of the vectors.
    fn run<S: Simd, const TILES: bool, const LISTS: bool>(self, simd: S) -> Self::Output;
}

impl Vectors {
    /// All of them, the fastest last.
    pub(crate) const ALL: [Self; 5] = [Self::Arrays, Self::Neon, Self::Sse2, Self::Avx2, Self::Avx512];

    /// Those that the processor has, the fastest last.
    pub(crate) fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|vectors| vectors.are_available())
    }

    /// The fastest that the processor has.
    pub(crate) fn best() -> Self {
        Self::available().last().unwrap_or(Self::Arrays)
    }

    /// Whether the processor has them.
    pub(crate) fn are_available(self) -> bool {
        match self {
            Self::Arrays => true,
            #[cfg(target_arch = "aarch64")]
            Self::Neon => Level::new().as_neon().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 => Level::new().as_sse2().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => Level::new().as_avx2().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => Level::new().as_avx512().is_some(),
            _ => false,
        }
    }

    /// Does work with them. Gives it back if the processor does not have them.
    pub(crate) fn run<W: Work>(self, work: W) -> Result<W::Output, W> {
        #[cfg(any(target_arch = "aarch64", target_arch = "x86_64"))]
        let level = Level::new();
        match self {
            Self::Arrays => return Ok(work.run::<_, false, false>(Fallback::new())),
            #[cfg(target_arch = "aarch64")]
            Self::Neon => {
                if let Some(simd) = level.as_neon() {
                    return Ok(work.run::<_, true, true>(simd));
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 => {
                if let Some(simd) = level.as_sse2() {
                    return Ok(work.run::<_, true, false>(simd));
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                if let Some(simd) = level.as_avx2() {
                    return Ok(work.run::<_, true, true>(simd));
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                if let Some(simd) = level.as_avx512() {
                    return Ok(work.run::<_, true, true>(simd));
                }
            }
            _ => {}
        }
        Err(work)
    }
}

/// The least of the lanes.
#[inline(always)]
pub(crate) fn least<S: Simd>(lanes: f32x16<S>) -> f32 {
    let simd = lanes.token();
    let (a, b) = simd.split_f32x16(lanes);
    let (a, b) = simd.split_f32x8(a.min(b));
    let x = a.min(b);
    x[0].min(x[1]).min(x[2].min(x[3]))
}

/// The greatest of the lanes.
#[inline(always)]
pub(crate) fn greatest<S: Simd>(lanes: f32x16<S>) -> f32 {
    -least(-lanes)
}

/// Replaces numbers nearer to zero than [`EPSILON`] by it, keeping the sign.
#[inline(always)]
pub(crate) fn away_from_zero<S: Simd>(simd: S, x: f32x16<S>) -> f32x16<S> {
    x.abs().simd_lt(f32x16::splat(simd, EPSILON)).select(f32x16::splat(simd, EPSILON).copysign(x), x)
}
