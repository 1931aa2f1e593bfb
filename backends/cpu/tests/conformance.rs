//! Every instruction set passes every check; see `esvo_core::testing::conformance`.

use esvo_core::testing::conformance::{Fault, Opened, Subject, tell_what_is_tested};
use esvo_cpu::{CpuCaster, InstructionSet};

/// Environment variables that are set where the processor must have an instruction set: without it the tests then fail.
const REQUIRE_NEON: &str = "ESVO_REQUIRE_NEON";
const REQUIRE_SSE2: &str = "ESVO_REQUIRE_SSE2";
const REQUIRE_AVX2: &str = "ESVO_REQUIRE_AVX2";
const REQUIRE_AVX512: &str = "ESVO_REQUIRE_AVX512";

fn open(instructions: InstructionSet) -> Opened {
    Ok(Box::new(CpuCaster::with_instructions(Some(2), instructions)?))
}

const SCALAR: Subject = Subject::native(|| open(InstructionSet::Scalar));
const ARRAYS: Subject = Subject::native(|| open(InstructionSet::Arrays));
const NEON: Subject = Subject::native(|| open(InstructionSet::Neon)).required_by(REQUIRE_NEON);
const SSE2: Subject = Subject::native(|| open(InstructionSet::Sse2)).required_by(REQUIRE_SSE2);
const AVX2: Subject = Subject::native(|| open(InstructionSet::Avx2)).required_by(REQUIRE_AVX2);
const AVX512: Subject = Subject::native(|| open(InstructionSet::Avx512)).required_by(REQUIRE_AVX512);

esvo_core::conformance_suite!(scalar, super::SCALAR);
esvo_core::conformance_suite!(arrays, super::ARRAYS);
esvo_core::conformance_suite!(neon, super::NEON);
esvo_core::conformance_suite!(sse2, super::SSE2);
esvo_core::conformance_suite!(avx2, super::AVX2);
esvo_core::conformance_suite!(avx512, super::AVX512);

/// Says on standard error which instruction sets this machine tests and which it does not.
#[test]
fn instruction_sets_tested_here() -> Result<(), Fault> {
    let subjects =
        [("arrays", ARRAYS), ("scalar", SCALAR), ("NEON", NEON), ("SSE2", SSE2), ("AVX2", AVX2), ("AVX-512", AVX512)];
    assert_eq!(subjects.map(|(name, _)| name), InstructionSet::ALL.map(InstructionSet::name), "one is not tested");
    tell_what_is_tested(&subjects)
}

#[test]
fn an_instruction_set_that_is_missing_is_an_error() {
    for set in InstructionSet::ALL {
        match CpuCaster::with_instructions(Some(1), set) {
            Ok(_) => assert!(set.is_available()),
            Err(error) => {
                assert!(!set.is_available());
                assert_eq!(error.to_string(), format!("this processor has no {set}"));
            }
        }
    }
    assert!(InstructionSet::Scalar.is_available() && InstructionSet::best().is_available());
}
