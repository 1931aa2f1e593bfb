//! See `esvo_fuzz::oct`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::oct::run(data));
