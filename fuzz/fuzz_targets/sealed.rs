//! See `esvo_fuzz::sealed`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::sealed::run(data));
