//! Counting, showing and comparing octrees.

pub mod diff;
pub mod dump;
pub(crate) mod stats;
pub(crate) mod storage;
pub(crate) mod stream_stats;
