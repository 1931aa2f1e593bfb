//! Counting, showing and comparing octrees.

pub mod diff;
pub mod dump;
pub(crate) mod stats;
pub(crate) mod stream_stats;
