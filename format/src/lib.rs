//! Reader, writer, validator and codecs of the esvo sparse voxel octree format.
//!
//! The bytes of the format are laid down in `esvo-spec` (`spec/v1/README.md`); rule ids in the errors refer to it.
//! Decoding does no I/O: [`Octree::open`] maps a file, everything else works on the mapped image.
//!
//! ```
//! use esvo_format::{AssembleOptions, Octree, Tree, Voxel, assemble};
//!
//! // One voxel in the corner of the root cube, red, without a contour.
//! let mut tree = Tree::default();
//! let voxel = Voxel { color: Some([255, 0, 0]), leaf: true, ..Voxel::default() };
//! let mut children = [None; 8];
//! children[0] = Some(voxel);
//! let root = tree.open(&children);
//! tree.close(root);
//! let octree = assemble(&tree, glam::DMat4::IDENTITY, &AssembleOptions::default())?;
//!
//! // Through bytes and back.
//! let mut bytes = Vec::new();
//! octree.write_to(&mut bytes).unwrap();
//! let octree = Octree::from_bytes(&bytes)?;
//! octree.sound()?;
//! let root = octree.objects()[0].root_slot as u32;
//! assert_eq!(octree.descriptor(root).valid_mask(), 1);
//! assert_eq!(octree.color(root, 0), Some([1.0, 0.0, 0.0]));
//! # Ok::<(), esvo_format::FormatError>(())
//! ```

#[cfg(target_endian = "big")]
compile_error!("the image is viewed in place as little-endian words; a big-endian reader would have to swap them");

mod ambient;
mod assemble;
mod codec;
mod color;
mod contour;
mod descriptor;
pub mod diff;
pub mod dump;
mod error;
pub mod file;
mod io;
mod layout;
mod layout_attributes;
mod needs;
mod normal;
pub mod oct;
mod octree;
mod pack;
mod reattach;
mod stats;
mod stream;
mod stream_partial;
mod stream_source;
mod tables;
mod topology;
mod tree;
mod validate;
mod validate_values;
mod values;
mod write;

pub use ambient::AmbientBlock;
pub use assemble::{AssembleOptions, assemble};
pub use codec::COMPRESSION_LEVELS;
pub use color::ColorBlock;
pub use contour::{Contour, Slab};
pub use descriptor::{ChildDescriptor, MAX_CONTOUR_POINTER, MAX_NEAR_POINTER};
pub use error::{Broken, FormatError};
pub use esvo_spec::ids;
pub use file::FIRST_SLOT;
pub use io::{DEFAULT_MEMORY_LIMIT, OpenOptions};
pub use needs::Needs;
pub use normal::{NormalBlock, RawNormal};
pub use octree::{BlockParts, Octree, UnknownSection};
pub use pack::{BlockStore, BlockSummary, PackedBlock, pack};
pub use stats::{Bytes, Stats, stats};
pub use stream::{Block, Region, StreamReader};
pub use stream_source::{RangeRead, SeekSource};
pub use tree::{Tree, TreeNode, Voxel};
pub use validate::{Finding, Report, validate, validate_bytes, validate_bytes_with, validate_file, validate_file_with};
pub use values::{CornerCell, CornerValue, NodeCorners};
pub use write::{WriteOptions, remove_temporaries, write_atomically};
