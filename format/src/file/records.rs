//! The structured parts of a file: header, directory, object table, block table, info section (spec sections 2 to 4,
//! 6).

use binrw::{BinRead, BinWrite};

/// The identifier. A byte above 127, both line endings and a control-Z make 7-bit transfers, text-mode transfers and
/// truncation at a control-Z detectable.
pub const IDENTIFIER: [u8; 12] = *b"\xABESVO 1\xBB\r\n\x1A\n";
/// Major version written and understood.
pub const MAJOR_VERSION: u16 = 1;
/// Minor version written.
pub const MINOR_VERSION: u16 = 0;
/// Required feature bit 0: some blocks are stored compressed.
pub const FEATURE_COMPRESSED: u64 = 1;
/// Required feature bit 1: the blocks are stored in parts (spec 4.3).
pub const FEATURE_PARTS: u64 = 2;
/// All required feature bits that this reader knows: [`FEATURE_COMPRESSED`] and [`FEATURE_PARTS`] with the crate's feature
/// `zstd`.
pub const KNOWN_REQUIRED: u64 = if cfg!(feature = "zstd") { FEATURE_COMPRESSED | FEATURE_PARTS } else { 0 };

/// Bytes in a page. Size and offset of a block are multiples of it.
pub const PAGE_BYTES: u64 = 8192;
/// Slots in a page.
pub const PAGE_SLOTS: u32 = 1024;
/// Slot of the first child descriptor in a block. Slot 0 is the page header, slot 1 is unused.
pub const FIRST_SLOT: u32 = 2;
/// Largest number of slots in an image, as far pointers have 32 bits (B011).
pub const MAX_IMAGE_SLOTS: u64 = 1 << 32;
/// Largest number of directory entries.
pub const MAX_SECTIONS: u32 = 1024;
/// Largest number of attachments of a block.
pub const MAX_ATTACHMENTS: u32 = 64;

/// File header, 64 bytes at offset 0 (spec 2.1). The fields follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct Header {
    /// [`IDENTIFIER`] (H001).
    pub identifier: [u8; 12],
    /// [`MAJOR_VERSION`] (H002).
    pub major: u16,
    /// [`MINOR_VERSION`]; readers accept any.
    pub minor: u16,
    /// Feature bits; a reader that does not know one of them must refuse the file (H003).
    pub required_features: u64,
    /// Feature bits that a reader may ignore.
    pub optional_features: u64,
    /// Length of the whole file in bytes (H004).
    pub file_length: u64,
    /// Offset of the directory in bytes, a multiple of 8 (D001).
    pub directory_offset: u64,
    /// Number of directory entries, at most [`MAX_SECTIONS`] (D008).
    pub directory_count: u32,
    /// CRC-32 of the directory (D002).
    pub directory_crc: u32,
    /// Length in bytes of the head: header, directory, object table and root page of the index. 0 without an index (H006).
    pub head: u32,
    /// CRC-32 of the 60 bytes before (H005).
    pub header_crc: u32,
}

/// Size of a [`Header`] in bytes.
pub const HEADER_BYTES: u64 = 64;

/// Directory entry, 32 bytes (spec 2.2). The fields follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct SectionEntry {
    /// Four ASCII characters, unique in the directory (D006).
    pub tag: [u8; 4],
    /// [`SECTION_REQUIRED`] (D005), [`SECTION_OWN_CHECKSUMS`]; all other bits are zero (D007).
    pub flags: u32,
    /// Offset in the file in bytes, a multiple of 8 (D003).
    pub offset: u64,
    /// Length in bytes (D003).
    pub length: u64,
    /// CRC-32 of the section, or 0 with [`SECTION_OWN_CHECKSUMS`] (D004).
    pub crc: u32,
    /// Zero (D007).
    pub reserved: u32,
}

/// Size of a [`SectionEntry`] in bytes.
pub const SECTION_BYTES: u64 = 32;
/// Section flag: a reader that does not know the tag must refuse the file.
pub const SECTION_REQUIRED: u32 = 1;
/// Section flag: the parts of the section have their own checksums.
pub const SECTION_OWN_CHECKSUMS: u32 = 2;

/// Tag of the object table.
pub const TAG_OBJECTS: [u8; 4] = *b"OBJT";
/// Tag of the block table.
pub const TAG_BLOCKS: [u8; 4] = *b"BLKT";
/// Tag of the block data.
pub const TAG_DATA: [u8; 4] = *b"BLKS";
/// Tag of the table of parts; only with [`FEATURE_PARTS`].
pub const TAG_PARTS: [u8; 4] = *b"PART";
/// Tag of the root page of the index; only with [`FEATURE_PARTS`].
pub const TAG_INDEX: [u8; 4] = *b"INDX";
/// Tag of the other pages of the index.
pub const TAG_PAGES: [u8; 4] = *b"PAGE";
/// Tag of the metadata: a JSON object in UTF-8 (M001).
pub const TAG_META: [u8; 4] = *b"META";

/// Object table entry, 192 bytes: one octree and its place in the mesh's space (spec 3). The fields follow each other
/// without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Debug)]
#[brw(little)]
pub struct ObjectEntry {
    /// Octree space (the root cube is `[0, 1]³`) to mesh space; 4 x 4, column-major, column vectors (O004).
    pub octree_to_mesh: [f64; 16],
    /// Index of the root block in the block table (O002).
    pub root_block: u32,
    /// Level of the deepest voxel, 1..=23; the root is level 0 (O003).
    pub levels: u32,
    /// Slot of the root's child descriptor, counted from the start of the image: slot [`FIRST_SLOT`] of the root block
    /// (O002).
    pub root_slot: u64,
    /// Number of child descriptors, that is, of non-leaf voxels, the root included (O005).
    pub descriptors: u64,
    /// Number of leaf voxels (O005).
    pub leaf_voxels: u64,
    /// Number of contour values (O005).
    pub contours: u64,
    /// Number of far pointers (O005).
    pub far_pointers: u64,
    /// Zero (O006).
    pub reserved: [u32; 4],
}

/// Size of an [`ObjectEntry`] in bytes.
pub const OBJECT_BYTES: u64 = 192;

impl ObjectEntry {
    /// Number of voxels other than the root.
    pub fn voxels(&self) -> u64 {
        // Every descriptor except the root's describes the voxel of one child slot.
        (self.descriptors + self.leaf_voxels).saturating_sub(1)
    }
}

/// Block table entry, 72 bytes (spec 4.1). The fields follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct BlockEntry {
    /// Index of the object.
    pub object: u32,
    /// Index of the block that refers to this one, smaller than the index of this one; or [`NO_PARENT`] (B007, B010,
    /// B012).
    pub parent: u32,
    /// Lower corner of the cube whose descendants the block holds, in units of 2^-23 of the root cube; a
    /// multiple of the cube's edge (B008).
    pub cube_position: [u32; 3],
    /// Scale of that cube, 1..=23: its edge is `2^(scale - 23)` of the root cube (B008).
    pub cube_scale: u32,
    /// Offset in the image in bytes, a multiple of [`PAGE_BYTES`]; there are no gaps between blocks (B002, B003).
    pub image_offset: u64,
    /// Size in the image in bytes, a multiple of [`PAGE_BYTES`] and not 0 (B002).
    pub image_size: u64,
    /// Offset in the file in bytes, a multiple of [`PAGE_BYTES`] (B004).
    pub file_offset: u64,
    /// Size as stored in bytes (B004, B005).
    pub stored_size: u64,
    /// How the block is stored: [`CODEC_RAW`], [`CODEC_ZSTD`] or [`CODEC_FIELDS`] (B005). Blocks in memory are never compressed.
    pub codec: u32,
    /// CRC-32 of the stored bytes (B006).
    pub crc: u32,
    /// Zero (B009).
    pub reserved: u64,
}

impl BlockEntry {
    /// The entry of a block of object 0 in memory. The fields about a file are not set.
    pub(crate) fn in_memory(
        parent: u32,
        (cube_position, cube_scale): ([u32; 3], u32),
        image_offset: u64,
        image_size: u64,
    ) -> Self {
        Self {
            object: 0,
            parent,
            cube_position,
            cube_scale,
            image_offset,
            image_size,
            file_offset: 0,
            stored_size: image_size,
            codec: CODEC_RAW,
            crc: 0,
            reserved: 0,
        }
    }
}

/// Size of a [`BlockEntry`] in bytes.
pub const BLOCK_BYTES: u64 = 72;
/// Parent of a root block.
pub const NO_PARENT: u32 = u32::MAX;
/// The block is stored uncompressed.
pub const CODEC_RAW: u32 = 0;
/// The block is stored as one Zstandard frame; needs [`FEATURE_COMPRESSED`].
pub const CODEC_ZSTD: u32 = 1;

/// The block is stored as streams of fields, in parts by level; needs [`FEATURE_PARTS`].
pub const CODEC_FIELDS: u32 = 2;

/// Entry of the table of parts, 12 bytes (spec 4.3). The parts lie in the block data in the order of the table. The fields
/// follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct PartEntry {
    /// Index of the block (S003).
    pub block: u32,
    /// Size as stored in bytes, with the part header (S002).
    pub size: u32,
    /// Level of the first descriptors of the part; that of a descriptor is the level of its voxel (S003).
    pub first_level: u8,
    /// Level of the last descriptors; [`LAST_LEVEL`] unless the codec of the block is [`CODEC_FIELDS`] (S003).
    pub last_level: u8,
    /// Zero (S007).
    pub reserved: u16,
}

/// Size of a [`PartEntry`] in bytes.
pub const PART_BYTES: u64 = 12;
/// Deepest level of a voxel with a descriptor.
pub const LAST_LEVEL: u8 = 22;

/// What every part begins with, 16 bytes (spec 4.3). The fields follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct PartHeader {
    /// CRC-32 of the bytes of the part after this field (S004).
    pub crc: u32,
    /// As in [`PartEntry`] (S005).
    pub size: u32,
    /// As in [`PartEntry`] (S005).
    pub block: u32,
    /// As in [`PartEntry`] (S005).
    pub first_level: u8,
    /// As in [`PartEntry`] (S005).
    pub last_level: u8,
    /// Codec of the block (S005).
    pub codec: u8,
    /// Zero (S005).
    pub reserved: u8,
}

/// Size of a [`PartHeader`] in bytes.
pub const PART_HEADER_BYTES: u64 = 16;

/// Fixed part of a block's info section, 32 bytes, followed by `attachment_count` [`AttachmentEntry`]
/// (spec 6).
///
/// Starts in the slot after the descriptor array (P002). The fields follow each other without gaps, in this order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct InfoSection {
    /// Index of the block in the block table (P003).
    pub block: u32,
    /// Length of the descriptor array in slots; also the distance back to the start of the block (P002).
    pub array_slots: u32,
    /// Distance back, in slots, from the info section to the first child descriptor: `array_slots - 2`
    /// (P004).
    pub first_descriptor: u32,
    /// Distance in 32-bit words from the info section to the contour pool (P005).
    pub contour_offset: u32,
    /// Number of contour values in the pool (P005).
    pub contour_count: u32,
    /// Number of attachments, at most [`MAX_ATTACHMENTS`] (A004).
    pub attachment_count: u32,
    /// Zero (P006).
    pub reserved: u64,
}

/// Size of an [`InfoSection`] in bytes.
pub const INFO_BYTES: u64 = 32;

/// Entry of a block's attachment directory, 16 bytes (spec 6 and 8). The fields follow each other without gaps, in this
/// order.
#[derive(BinRead, BinWrite, Clone, Copy, PartialEq, Eq, Debug)]
#[brw(little)]
pub struct AttachmentEntry {
    /// Registered type, see [`attachment`] (A002).
    pub kind: u32,
    /// Distance in bytes from the info section to the data; a multiple of 8 (A001).
    pub offset: u32,
    /// Size of the data in bytes (A003).
    pub size: u64,
}

/// Size of an [`AttachmentEntry`] in bytes.
pub const ATTACHMENT_BYTES: u64 = 16;

/// Registered attachment types. Types from 0x8000 to 0xffff belong to vendors.
pub mod attachment {
    /// One [`ColorBlock`](crate::ColorBlock) per pair of slots of the descriptor array.
    pub const COLOR_BLOCKS: u32 = 1;
    /// One [`NormalBlock`](crate::NormalBlock) per pair of slots of the descriptor array.
    pub const NORMAL_BLOCKS: u32 = 2;
    /// One colour for every voxel of the block: four bytes R, G, B, 0 (sRGB-encoded) and four zero bytes.
    pub const COLOR_CONSTANT: u32 = 3;
    /// One [`AmbientBlock`](crate::AmbientBlock) per pair of slots of the descriptor array.
    pub const AMBIENT_BLOCKS: u32 = 4;
    /// Plain colours R, G, B, A, one per voxel. First a word for each slot of the descriptor array: the value mask, and
    /// the distance in words from the start of the attachment to the first value. Then the values.
    pub const COLORS_PLAIN: u32 = 5;
    /// Plain normals ([`RawNormal`](crate::RawNormal)), one per voxel, laid out as [`COLORS_PLAIN`].
    pub const NORMALS_PLAIN: u32 = 6;
    /// Colours and normals at the corners of voxels. First two words for each slot of the descriptor array: the corner
    /// mask, and the distance in words from the start of the attachment to the first value. Then the values
    /// ([`CornerValue`](crate::CornerValue)).
    pub const CORNERS: u32 = 7;
    /// Emitted light: red, green and blue, linear. This and the types up to [`NAMED_LAST`] are laid out alike: a head,
    /// then a word for each slot of the descriptor array as of [`COLORS_PLAIN`], then the values
    /// ([`ComponentFormat`](crate::ComponentFormat)).
    pub const EMISSION: u32 = 8;
    /// Roughness and metalness, 0 to 1.
    pub const ROUGHNESS_METALNESS: u32 = 9;
    /// Opacity, 0 to 1.
    pub const OPACITY: u32 = 10;
    /// Number of the material.
    pub const MATERIAL: u32 = 11;
    /// First type with components whose meaning the metadata give.
    pub const NAMED_FIRST: u32 = 16;
    /// Last type with components whose meaning the metadata give.
    pub const NAMED_LAST: u32 = 31;
    /// All types with colours. A block has at most one of them.
    pub const COLORS: [u32; 4] = [COLOR_BLOCKS, COLOR_CONSTANT, COLORS_PLAIN, CORNERS];
    /// All types with normals. A block has at most one of them.
    pub const NORMALS: [u32; 3] = [NORMAL_BLOCKS, NORMALS_PLAIN, CORNERS];
    /// First vendor type.
    pub const VENDOR_FIRST: u32 = 0x8000;
    /// Last vendor type.
    pub const VENDOR_LAST: u32 = 0xffff;

    /// Whether attachments of a type have components.
    pub const fn has_components(kind: u32) -> bool {
        matches!(kind, EMISSION..=MATERIAL | NAMED_FIRST..=NAMED_LAST)
    }

    /// Name of a type.
    pub const fn name(kind: u32) -> &'static str {
        match kind {
            COLOR_BLOCKS => "colour blocks",
            NORMAL_BLOCKS => "normal blocks",
            COLOR_CONSTANT => "constant colour",
            AMBIENT_BLOCKS => "ambient occlusion blocks",
            COLORS_PLAIN => "plain colours",
            NORMALS_PLAIN => "plain normals",
            CORNERS => "corners",
            EMISSION => "emission",
            ROUGHNESS_METALNESS => "roughness and metalness",
            OPACITY => "opacity",
            MATERIAL => "material",
            NAMED_FIRST..=NAMED_LAST => "components",
            VENDOR_FIRST..=VENDOR_LAST => "of a vendor",
            _ => "unknown",
        }
    }
}

/// The bytes of a structure.
pub(crate) fn to_bytes<T>(value: &T) -> Vec<u8>
where
    T: BinWrite + binrw::meta::WriteEndian,
    for<'a> T::Args<'a>: Default,
{
    let mut out = std::io::Cursor::new(Vec::new());
    value.write(&mut out).expect("writing to memory does not fail");
    out.into_inner()
}

/// A structure read from the start of `bytes`. `None` if there are too few bytes.
pub(crate) fn from_bytes<T>(bytes: &[u8]) -> Option<T>
where
    T: BinRead + binrw::meta::ReadEndian,
    for<'a> T::Args<'a>: Default,
{
    T::read(&mut std::io::Cursor::new(bytes)).ok()
}
