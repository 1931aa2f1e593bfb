//! See `esvo_fuzz::values`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::values::run(data));
