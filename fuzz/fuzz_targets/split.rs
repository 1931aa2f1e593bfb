//! See `esvo_fuzz::split`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::split::run(data));
