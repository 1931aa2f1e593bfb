//! Any bytes: open, validate, count, walk.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| esvo_fuzz::survive(data));
