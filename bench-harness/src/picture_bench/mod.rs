//! `esvo bench pictures`: pictures of octrees next to pictures of their triangles. Also the exact pictures of meshes that the
//! other benchmarks compare octrees with.

pub(crate) mod cutout;
pub(crate) mod mesh_picture;
mod pictures;
mod tables;

pub use pictures::{PictureBenchOptions, PicturePair, run_picture_bench};
pub use tables::{to_markdown, write_picture_table};
