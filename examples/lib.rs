//! Short programs that use the crates of esvo as a library.
//!
//! Each is one file next to this one: `read_leaves`, `render_picture`, `cast_rays`,
//! `stream_region`, `own_backend`. Run one with
//! `cargo run -p esvo-examples --example read_leaves`. The tests run all of them, and the sample of the project's README too.

/// Runs the README's sample as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeSample;
