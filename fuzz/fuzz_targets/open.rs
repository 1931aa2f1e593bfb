//! See `esvo_fuzz::open`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::open::run(data));
