//! Instruction sets that the decoder is compiled for, and the choice of one when it runs.
//!
//! There is one source: the compiler translates it once for any processor and once for processors with AVX2 and BMI2, with wider
//! vectors and single instructions for what else takes several.

/// What a decoder may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InstructionSet {
    /// What every processor of this architecture has.
    Portable,
    /// AVX2, BMI1, BMI2, POPCNT, LZCNT.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
}

/// The proof that this processor has AVX2 and what belongs to it: only [`InstructionSet::all`] makes one.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx2(());

/// A piece of work that is compiled for each instruction set. What `run` calls must be inlined into it, or is compiled for any
/// processor.
pub(crate) trait Work {
    type Output;

    fn run(self) -> Self::Output;
}

impl InstructionSet {
    /// Those that this processor has, the fastest last.
    pub(crate) fn all() -> Vec<Self> {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "there is only one"))]
        let mut all = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("lzcnt")
        {
            all.push(Self::Avx2(Avx2(())));
        }
        all
    }

    /// The fastest that this processor has.
    pub(crate) fn best() -> Self {
        Self::all().pop().unwrap_or(Self::Portable)
    }

    /// Does the work with these instructions.
    pub(crate) fn run<W: Work>(self, work: W) -> W::Output {
        match self {
            Self::Portable => work.run(),
            // SAFETY: `Avx2` is only made where the processor has all of these instructions.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => unsafe { run_avx2(work) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt,lzcnt")]
fn run_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}
