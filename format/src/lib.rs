//! Reader, writer, validator and codecs of the esvo sparse voxel octree format.
//!
//! The bytes are laid down in the specification, version 1 (`spec/v1/README.md`, also [`esvo_spec::TEXT_V1`]). Errors and
//! findings cite its numbered rules ([`ids`]), and so do these pages: "H004" is a rule, "spec 4.1" a section.
//!
//! # Reading
//!
//! [`Octree::open`] maps a file, [`Octree::from_bytes`] takes bytes from anywhere. Both check everything but the
//! descriptors: these are checked once by [`Octree::sound`], and what is sound can be walked without fear.
//!
//! ```
//! # use esvo_format::*;
//! # let mut tree = Tree::default();
//! # let mut children = [None; 8];
//! # children[5] = Some(Voxel { color: Some([255, 0, 0]), leaf: true, ..Voxel::default() });
//! # let node = tree.open(&children);
//! # tree.close(node);
//! # let octree = assemble(&tree, glam::DMat4::IDENTITY, &AssembleOptions::default())?;
//! # let mut bytes = Vec::new();
//! # octree.write_to(&mut bytes).unwrap();
//! # let mut leaves = Vec::new();
//! let octree = Octree::from_bytes(&bytes)?; // or Octree::open("sibenik.esvo".as_ref())?
//! octree.sound()?;
//!
//! // Every leaf voxel of the first object: its lower corner and its edge in the space of the mesh, and its colour.
//! let object = &octree.objects()[0];
//! let to_mesh = octree.octree_to_mesh(0);
//! // Slot of a descriptor, and lower corner and edge of its voxel in octree space, where the root cube is [0, 1]³.
//! let mut stack = vec![(object.root_slot as u32, glam::DVec3::ZERO, 1.0)];
//! while let Some((slot, corner, edge)) = stack.pop() {
//!     let descriptor = octree.descriptor(slot);
//!     for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
//!         // Bit 0 of a child slot is x, bit 1 is y, bit 2 is z.
//!         let offset = glam::DVec3::new((child & 1).into(), (child >> 1 & 1).into(), (child >> 2).into());
//!         let (corner, edge) = (corner + offset * edge / 2.0, edge / 2.0);
//!         match octree.child(slot, child) {
//!             Some(below) => stack.push((below, corner, edge)),
//!             None => {
//!                 let colour = octree.color(slot, child); // sRGB, 0 to 1, if the octree has colours
//!                 println!("{} {edge} {colour:?}", to_mesh.transform_point3(corner));
//! #               leaves.push((corner.to_array(), edge, colour));
//!             }
//!         }
//!     }
//! }
//! # assert_eq!(leaves, [([0.5, 0.0, 0.5], 0.5, Some([1.0, 0.0, 0.0]))]);
//! # Ok::<(), FormatError>(())
//! ```
//!
//! # Writing
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
//! let mut bytes = Vec::new(); // or octree.write("red.esvo".as_ref())?
//! octree.write_to(&mut bytes).unwrap();
//! assert!(esvo_format::validate_bytes(&bytes)?.is_ok());
//! # Ok::<(), esvo_format::FormatError>(())
//! ```
//!
//! # What is where
//!
//! | to | use |
//! |---|---|
//! | read a whole file | [`Octree`] |
//! | read some blocks of a file, from a disk or an object store | [`StreamReader`], [`RangeRead`] |
//! | find out which rules a file breaks | [`validate_file`], [`validate_bytes`], [`Report`] |
//! | make an octree | [`Tree`], [`assemble`]; in parts, with little memory: [`pack`](pack()) |
//! | encode and decode values | [`Contour`], [`ColorBlock`], [`NormalBlock`], [`RawNormal`], [`AmbientBlock`] |
//! | go between sRGB and linear light | [`srgb`] |
//! | take a descriptor apart | [`ChildDescriptor`] |
//! | upload to a device | [`Octree::slots`], as it is; [`Octree::needs`] |
//! | count, show, compare | [`stats`](stats()), [`dump`], [`diff`] |
//! | read and write the files of the paper's authors | [`oct`] |
//! | know the bytes of headers and tables | [`file`](mod@file) |
//!
//! # Words and units
//!
//! A *slot* is 8 bytes, a *word* 4; slots of the image are numbered from 0, and the low word of slot `s` is word `2 s`. A
//! *child slot*, 0 to 7, is a place in a cube: `x + 2 y + 4 z`. The root cube is `[0, 1]³` in *octree space* and level 0;
//! the transform of an object leads from there to the space of its mesh. Offsets are bytes unless something else is said.
//!
//! # Hostile input
//!
//! Nothing here panics, hangs or reads out of bounds on bytes that nobody vouches for, with one exception that the
//! functions name: a slot that comes from an octree which is not [sound](Octree::sound). Memory is bounded by
//! [`OpenOptions::memory_limit`].
//!
//! # Features
//!
//! `zstd` (on by default): compressed blocks. Without it, files that have any are refused (H003).

#[cfg(target_endian = "big")]
compile_error!("the image is viewed in place as little-endian words; a big-endian reader would have to swap them");

mod block;
mod check;
mod descriptor;
mod error;
pub mod file;
mod inspect;
mod layout;
mod needs;
pub mod oct;
mod octree;
mod stream;
mod values;

pub use block::BlockParts;
pub use check::report::{Finding, Report};
pub use check::validate::{validate, validate_bytes, validate_bytes_with, validate_file, validate_file_with};
pub use descriptor::{ChildDescriptor, MAX_CONTOUR_POINTER, MAX_NEAR_POINTER};
pub use error::{Broken, FormatError};
pub use esvo_spec::ids;
pub use file::FIRST_SLOT;
pub use file::compression::COMPRESSION_LEVELS;
pub use file::open::{DEFAULT_MEMORY_LIMIT, OpenOptions};
pub use file::write::{WriteOptions, remove_temporaries, write_atomically};
pub use inspect::stats::{Bytes, Stats, stats};
pub use inspect::{diff, dump};
pub use layout::assemble::assemble;
pub use layout::pack::{BlockStore, BlockSummary, PackedBlock, pack};
pub use layout::plan::AssembleOptions;
pub use layout::tree::{Tree, TreeNode, Voxel};
pub use needs::Needs;
pub use octree::{Octree, UnknownSection};
pub use stream::block::{Block, Region};
pub use stream::reader::StreamReader;
pub use stream::source::{RangeRead, SeekSource};
pub use values::ambient::AmbientBlock;
pub use values::color::ColorBlock;
pub use values::contour::{Contour, Slab};
pub use values::normal::{NormalBlock, RawNormal};
pub use values::plain::{CornerCell, CornerValue, NodeCorners};
pub use values::srgb;
