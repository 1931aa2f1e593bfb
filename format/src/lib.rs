//! Reader, writer, validator and codecs of the esvo sparse voxel octree format.
//!
//! The specification, version 1, defines the bytes (`spec/v1/README.md`, also [`esvo_spec::TEXT_V1`]). Errors, findings and
//! these pages cite its numbered rules ([`ids`]): "H004" is a rule, "spec 4.1" a section.
//!
//! # Reading
//!
//! [`Octree::open`] maps a file, [`Octree::from_bytes`] reads a file in memory. Both check everything except the
//! descriptors and the checksums of the blocks. [`Octree::sound`] checks the descriptors once; walking a sound octree cannot
//! fail. [`Octree::intact`] compares the checksums once, in parallel; it reads the whole file. Casters call both.
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
//! octree.intact()?;
//! octree.sound()?;
//!
//! // For every leaf voxel of the first object: its lower corner in mesh space, its edge in octree space, and its colour.
//! let object = &octree.objects()[0];
//! let to_mesh = octree.octree_to_mesh(0);
//! // Slot of a descriptor; lower corner and edge of its voxel in octree space, in which the root cube is [0, 1]³.
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
//!                 let colour = octree.color(slot, child); // sRGB, 0 to 1; None if the octree has no colours
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
//! // One red voxel without a contour, in the corner of the root cube.
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
//! An octree that came from a file is [verified](Octree::verified) before it is written again: checksums and every other
//! rule. Writing gives blocks new checksums, so damage would be hidden for good.
//!
//! # What is where
//!
//! | to | use |
//! |---|---|
//! | read a whole file | [`Octree`] |
//! | read some blocks of a file, from a disk or an object store | [`StreamReader`], [`RangeRead`] |
//! | read a file with an index page by page, without its tables | [`IndexReader`] |
//! | find out which rules a file breaks | [`validate_file`], [`validate_bytes`], [`Report`] |
//! | make an octree | [`Tree`], [`assemble`]; block by block, with little memory: [`pack`](pack()), [`BlockStore`] |
//! | encode and decode values | [`Contour`], [`ColorBlock`], [`NormalBlock`], [`RawNormal`], [`AmbientBlock`], [`ComponentFormat`] |
//! | join several octrees into one | [`join`] |
//! | number the cubes of a level | [`morton`](morton()), [`morton_place`] |
//! | convert between sRGB and linear light | [`srgb`] |
//! | read the fields of a descriptor | [`ChildDescriptor`] |
//! | upload to a device | [`Octree::slots`], unchanged; [`Octree::needs`] |
//! | count, show, compare | [`stats`](stats()), [`stream_stats`], [`dump`], [`diff`] |
//! | read and write the files of the paper's authors | [`oct`] |
//! | see the layout of headers and tables | [`file`](mod@file) |
//!
//! In the source code:
//!
//! | folder or file | subject |
//! |---|---|
//! | `values/` | encodings of the values of voxels: contours, colours, normals, ambient occlusion, plain values, components, sRGB |
//! | `file/` | records of headers and tables; opening, writing, compression |
//! | `octree.rs`, `components.rs`, `block.rs`, `descriptor.rs`, `needs.rs` | an octree in memory, and access to its voxels |
//! | `morton.rs` | cubes of one level as numbers |
//! | `check/` | the rules of the specification: tables, topology (the walk along all pointers), validation and its report |
//! | `parts/` | blocks stored in parts by level, as streams of fields |
//! | `index/` | the index of a file with parts, in pages |
//! | `layout/` | from a tree to blocks: planning, placing, encoding, packing; adding an attachment |
//! | `stream/` | reading parts of a file |
//! | `inspect/` | dumps, differences, statistics |
//! | `oct/` | the files of the paper's authors |
//!
//! # Words and units
//!
//! A *slot* has 8 bytes, a *word* 4. The slots of the image are numbered from 0; the low word of slot `s` is word `2 s`. A
//! *child slot*, 0 to 7, is an octant of a cube: `x + 2 y + 4 z`. The root cube is `[0, 1]³` in *octree space* and has
//! level 0. The transform of an object maps octree space to the space of its mesh. Offsets are in bytes unless another unit
//! is given.
//!
//! # Untrusted input
//!
//! No function panics, hangs or reads out of bounds on untrusted bytes, with one exception: methods that take the slot of a
//! descriptor may panic if the octree is not [sound](Octree::sound). [`OpenOptions::memory_limit`] bounds the memory.
//!
//! # Features
//!
//! `zstd` (on by default): compressed blocks. Without it, files with compressed blocks are refused (H003).

#[cfg(target_endian = "big")]
compile_error!("esvo-format needs a little-endian target: it views the image in place as little-endian words");

mod block;
mod check;
mod components;
mod descriptor;
mod error;
pub mod file;
mod index;
mod inspect;
mod layout;
mod morton;
mod needs;
pub mod oct;
mod octree;
mod parts;
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
pub use inspect::stats::{Bytes, ComponentStats, Stats, component_stats, stats};
pub use inspect::stream_stats::stream_stats;
pub use inspect::{diff, dump};
pub use layout::assemble::assemble;
pub use layout::columns::Column;
pub use layout::join::join;
pub use layout::pack::{BlockStore, BlockSummary, PackedBlock, StoredBlocks, pack};
pub use layout::plan::AssembleOptions;
pub use layout::tree::{Tree, TreeNode, Voxel};
pub use morton::{morton, morton_place};
pub use needs::Needs;
pub use octree::{Octree, UnknownSection};
pub use stream::block::{Block, Part, Region};
pub use stream::reader::StreamReader;
pub use stream::served::IndexReader;
pub use stream::source::{RangeRead, SeekSource};
pub use values::ambient::AmbientBlock;
pub use values::color::ColorBlock;
pub use values::components::{ComponentFormat, Components, MAX_RGB9E5, NumberFormat};
pub use values::contour::{Contour, Slab};
pub use values::normal::{NormalBlock, RawNormal};
pub use values::plain::{CornerCell, CornerValue, NodeCorners};
pub use values::srgb;

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
