//! `esvo bench pictures`: octrees next to the triangles they were built from.

pub(crate) mod cutout;
pub(crate) mod mesh_picture;
mod pictures;
mod tables;

pub use pictures::{PictureBenchOptions, PicturePair, run_picture_bench};
pub use tables::{to_markdown, write_picture_table};
