//! The rules of version 1. Letter: H header, D directory, M metadata, O object table, B block table, P pages and info
//! sections, C child descriptors, K contours, A attachments.

/// How strict a rule is (in the sense of RFC 2119).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// A file that breaks it is not a file of this version.
    Must,
    /// Readers cope, but there had better be a reason.
    Should,
}

/// A numbered rule that a writer must keep and a validator checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Stable id: a letter for the part of the file and three digits. Never used again for another rule.
    pub id: &'static str,
    /// How strict it is.
    pub level: Level,
    /// What must or should hold, in one sentence.
    pub text: &'static str,
}

macro_rules! rules {
    ($($name:ident = $id:literal $level:ident : $text:literal;)*) => {
        /// Every rule, in the order of the text.
        pub const RULES: &[Rule] = &[$(Rule { id: $id, level: Level::$level, text: $text }),*];
        /// The ids by name.
        pub mod ids {
            $(#[doc = $text] pub const $name: &str = $id;)*
        }
    };
}

rules! {
    IDENTIFIER = "H001" Must: "The file starts with the 12-byte identifier, and is long enough for a header.";
    MAJOR_VERSION = "H002" Must: "The major version is 1.";
    REQUIRED_FEATURES = "H003" Must: "Every required feature bit that is set is known to the reader.";
    FILE_LENGTH = "H004" Must: "The file length in the header equals the length of the file.";
    HEADER_CHECKSUM = "H005" Must: "The header checksum is the CRC-32 of the header bytes before it.";
    HEADER_RESERVED = "H006" Must: "Reserved bytes of the header are zero.";

    DIRECTORY_RANGE = "D001" Must: "The directory lies within the file behind the header and is aligned to 8 bytes.";
    DIRECTORY_CHECKSUM = "D002" Must: "The directory checksum is the CRC-32 of the directory bytes.";
    SECTION_RANGE = "D003" Must: "Every section lies within the file, is aligned to 8 bytes and overlaps no other section, the header or the directory.";
    SECTION_CHECKSUM = "D004" Must: "The checksum of a section is the CRC-32 of its bytes, or 0 if flag bit 1 says that its parts carry their own.";
    SECTION_REQUIRED = "D005" Must: "A section with flag bit 0 set is known to the reader.";
    SECTION_MISSING = "D006" Must: "The sections OBJT, BLKT and BLKS occur exactly once; no other tag occurs twice.";
    SECTION_RESERVED = "D007" Must: "Undefined flag bits and reserved fields of the directory are zero.";
    DIRECTORY_LIMIT = "D008" Must: "The directory has at most 1024 entries.";
    FILE_GAPS = "D009" Must: "Bytes of the file that belong to neither header, directory nor a section are zero, and so are those of BLKS that belong to no block.";

    META_JSON = "M001" Must: "The section META, if there is one, is a JSON object in UTF-8.";

    OBJECT_SIZE = "O001" Must: "The object table holds a whole number of entries, at least one.";
    OBJECT_ROOT = "O002" Must: "The root slot of an object is the first child descriptor of its root block, and the root block belongs to the object and has no parent.";
    OBJECT_LEVELS = "O003" Must: "The number of levels is 1 to 23 and equals the level of the deepest voxel.";
    OBJECT_TRANSFORM = "O004" Must: "The octree-to-mesh transform is finite, affine and invertible.";
    OBJECT_COUNTS = "O005" Must: "The counts of descriptors, leaf voxels, contours and far pointers equal those found in the blocks.";
    OBJECT_RESERVED = "O006" Must: "Reserved fields of the object table are zero.";

    BLOCK_SIZE = "B001" Must: "The block table holds a whole number of entries, at least one.";
    BLOCK_ALIGNMENT = "B002" Must: "The image size and the image offset of a block are multiples of 8192 and the size is not zero.";
    BLOCK_IMAGE = "B003" Must: "Blocks follow each other in the image without gaps, in table order, and fill it.";
    BLOCK_RANGE = "B004" Must: "The stored bytes of a block, up to the next multiple of 8192, lie within the section BLKS, start at a multiple of 8192 from the start of the file and overlap no other block; with codec 0 everywhere they follow each other as in the image.";
    BLOCK_CODEC = "B005" Must: "The codec is known, and one other than 0 goes with required feature bit 0; codec 0 stores the image bytes as they are, codec 1 one Zstandard frame of exactly the image bytes.";
    BLOCK_CHECKSUM = "B006" Must: "The block checksum is the CRC-32 of the stored bytes.";
    BLOCK_PARENT = "B007" Must: "A block's parent comes before it in the table and belongs to the same object; exactly the root blocks have none.";
    BLOCK_CUBE = "B008" Must: "The cube of a block is that of the voxel whose descendants it holds: of scale 1 to 23, at a multiple of its size, within its parent's cube.";
    BLOCK_RESERVED = "B009" Must: "Reserved fields of the block table are zero.";
    BLOCK_REACHED = "B010" Must: "Every block but a root block is referred to by its parent.";
    BLOCK_LIMIT = "B011" Must: "The image has at most 2^32 slots.";
    BLOCK_ORDER = "B012" Should: "Blocks stand breadth first: the blocks of an object are in the order of their parents.";

    PAGE_HEADER = "P001" Must: "The first slot of every page of the descriptor array holds the distance in slots to the info section, and zero above it.";
    INFO_RANGE = "P002" Must: "The info section lies in the block, right behind the descriptor array.";
    INFO_BLOCK = "P003" Must: "The info section names its own block.";
    INFO_FIRST = "P004" Must: "The first-descriptor field leads to slot 2 of the block.";
    INFO_CONTOURS = "P005" Must: "The contour pool lies in the block behind the attachment directory.";
    INFO_RESERVED = "P006" Must: "Reserved fields, unused slots and the space between and behind the parts of a block are zero.";

    CHILD_LEAF_MASK = "C001" Must: "The leaf mask is a subset of the valid mask, and the valid mask is not zero.";
    CHILD_RANGE = "C002" Must: "The child pointer leads forward to slots of a descriptor array, of the same block or, through a far pointer, of another.";
    CHILD_PAGE = "C003" Must: "Sibling descriptors are consecutive, start at an even slot and do not straddle a page header; nothing refers to a page header.";
    CHILD_FAR = "C004" Must: "A far pointer lies in the descriptor array of the same block behind the descriptor that refers to it, holds a distance greater than zero, and zero above it.";
    CHILD_ONCE = "C005" Must: "Every descriptor but a root is referred to by exactly one descriptor, and no slot serves two purposes.";
    CHILD_NONE = "C006" Must: "A descriptor without non-leaf children has child pointer 0 and a clear far bit.";
    CHILD_DEPTH = "C007" Must: "No voxel is deeper than the number of levels of its object.";
    CHILD_BLOCK = "C008" Must: "A pointer into another block leads to that block's first child descriptor, and the referring block is its parent.";

    CONTOUR_MASK = "K001" Must: "The contour mask is a subset of the valid mask.";
    CONTOUR_RANGE = "K002" Must: "The contour pointer and all the values it leads to lie in the contour pool of the block.";
    CONTOUR_NONE = "K003" Must: "A descriptor without contours has contour pointer 0.";
    CONTOUR_NORMAL = "K004" Must: "The decoded normal of a contour is not zero.";
    CONTOUR_ONCE = "K005" Must: "Every value of a contour pool belongs to exactly one voxel.";

    ATTACHMENT_RANGE = "A001" Must: "An attachment lies in the block behind the contour pool, is aligned to 8 bytes, and overlaps no other.";
    ATTACHMENT_TYPE = "A002" Must: "An attachment type is in the registry or in the vendor range and occurs once per block; a block has at most one type with colours and at most one with normals.";
    ATTACHMENT_SIZE = "A003" Must: "The size of an attachment is the one that its type prescribes.";
    ATTACHMENT_LIMIT = "A004" Must: "A block has at most 64 attachments.";
    ATTACHMENT_UNUSED = "A005" Must: "Attribute blocks of pairs and entries of slots without a child descriptor, and the unused bytes of a constant colour, are zero.";
    ATTACHMENT_UNIFORM = "A006" Should: "The blocks of an object all have colours or none has, and likewise normals and ambient occlusion.";
    ATTACHMENT_ENTRY = "A007" Must: "The entry of a descriptor in plain colours, plain normals or corners leads to values in the attachment behind its entries; a value mask is a subset of the valid mask, undefined bits are zero, and so is an entry without values.";
    ATTACHMENT_ONCE = "A008" Must: "Every value of plain colours, plain normals or corners belongs to the entry of exactly one descriptor.";
}
