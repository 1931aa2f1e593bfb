//! The rules of version 1. Letter: H header, D directory, O object table, B block table, P pages and info sections,
//! C child descriptors, K contours, A attachments.

/// A numbered rule that a writer must keep and a validator checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Stable id: a letter for the part of the file and three digits.
    pub id: &'static str,
    /// What must hold, in one sentence.
    pub text: &'static str,
}

macro_rules! rules {
    ($($name:ident = $id:literal : $text:literal;)*) => {
        /// Every rule, in the order of the text.
        pub const RULES: &[Rule] = &[$(Rule { id: $id, text: $text }),*];
        /// The ids by name.
        pub mod ids {
            $(#[doc = $text] pub const $name: &str = $id;)*
        }
    };
}

rules! {
    IDENTIFIER = "H001": "The file starts with the 12-byte identifier.";
    MAJOR_VERSION = "H002": "The major version is 1.";
    REQUIRED_FEATURES = "H003": "Every required feature bit that is set is known to the reader.";
    FILE_LENGTH = "H004": "The file length in the header equals the length of the file.";
    HEADER_CHECKSUM = "H005": "The header checksum is the CRC-32 of the header bytes before it.";
    HEADER_RESERVED = "H006": "Reserved bytes of the header are zero.";

    DIRECTORY_RANGE = "D001": "The directory lies within the file and is aligned to 8 bytes.";
    DIRECTORY_CHECKSUM = "D002": "The directory checksum is the CRC-32 of the directory bytes.";
    SECTION_RANGE = "D003": "Every section lies within the file, is aligned to 8 bytes and overlaps no other section.";
    SECTION_CHECKSUM = "D004": "The checksum of a section is the CRC-32 of its bytes, unless flag bit 1 says that its parts carry their own.";
    SECTION_REQUIRED = "D005": "A section with flag bit 0 set is known to the reader.";
    SECTION_MISSING = "D006": "The sections OBJT, BLKT and BLKS occur exactly once; no other tag occurs twice.";
    SECTION_RESERVED = "D007": "Undefined flag bits and reserved fields of the directory are zero.";

    OBJECT_SIZE = "O001": "The object table holds a whole number of entries, at least one.";
    OBJECT_ROOT = "O002": "The root slot of an object is the first child descriptor of its root block, and the root block belongs to the object.";
    OBJECT_LEVELS = "O003": "The number of levels is 1 to 23 and equals the level of the deepest voxel.";
    OBJECT_TRANSFORM = "O004": "The octree-to-mesh transform is finite, affine and invertible.";
    OBJECT_COUNTS = "O005": "The counts of descriptors, leaf voxels, contours and far pointers equal those found in the blocks.";
    OBJECT_RESERVED = "O006": "Undefined flag bits and reserved fields of the object table are zero.";

    BLOCK_SIZE = "B001": "The block table holds a whole number of entries, at least one.";
    BLOCK_ALIGNMENT = "B002": "The image size and the image offset of a block are multiples of 8192 and the size is not zero.";
    BLOCK_IMAGE = "B003": "Blocks follow each other in the image without gaps, in table order, and fill it.";
    BLOCK_RANGE = "B004": "The stored bytes of a block lie within the section BLKS, at a multiple of 8192 from the start of the file, and overlap no other block.";
    BLOCK_CODEC = "B005": "The codec is known; codec 0 stores the image bytes as they are.";
    BLOCK_CHECKSUM = "B006": "The block checksum is the CRC-32 of the stored bytes.";
    BLOCK_PARENT = "B007": "A block's parent comes before it in the table and belongs to the same object; a root block has none.";
    BLOCK_CUBE = "B008": "The cube of a block has scale 1 to 23, starts at a multiple of its size within the root cube, and lies within its parent's cube.";
    BLOCK_RESERVED = "B009": "Reserved fields of the block table are zero.";

    PAGE_HEADER = "P001": "The first slot of every page of the descriptor array holds the distance in slots to the info section, and zero above it.";
    INFO_RANGE = "P002": "The info section lies in the block, right behind the descriptor array.";
    INFO_BLOCK = "P003": "The info section names its own block.";
    INFO_FIRST = "P004": "The first-descriptor field leads to slot 2 of the block.";
    INFO_CONTOURS = "P005": "The contour pool lies in the block behind the info section.";
    INFO_RESERVED = "P006": "Reserved fields, unused slots and the space between and behind the parts of a block are zero.";

    CHILD_LEAF_MASK = "C001": "The leaf mask is a subset of the valid mask, and the valid mask is not zero.";
    CHILD_RANGE = "C002": "The child pointer leads forward to slots of a descriptor array, of the same block or, through a far pointer, of another.";
    CHILD_PAGE = "C003": "Sibling descriptors are consecutive, start at an even slot and do not straddle a page header.";
    CHILD_FAR = "C004": "A far pointer lies in the same block behind the descriptor that refers to it, holds a distance greater than zero, and zero above it.";
    CHILD_ONCE = "C005": "Every descriptor but a root is referred to by exactly one descriptor, and no slot serves two purposes.";
    CHILD_NONE = "C006": "A descriptor without non-leaf children has child pointer 0 and a clear far bit.";
    CHILD_DEPTH = "C007": "No voxel is deeper than the number of levels of its object.";
    CHILD_BLOCK = "C008": "A pointer into another block leads to that block's first child descriptor, and the referring block is its parent.";

    CONTOUR_MASK = "K001": "The contour mask is a subset of the valid mask.";
    CONTOUR_RANGE = "K002": "The contour pointer and all the values it leads to lie in the contour pool of the block.";
    CONTOUR_NONE = "K003": "A descriptor without contours has contour pointer 0.";
    CONTOUR_NORMAL = "K004": "The decoded normal of a contour is not zero.";

    ATTACHMENT_RANGE = "A001": "An attachment lies in the block behind the contour pool, is aligned to 8 bytes, and overlaps no other.";
    ATTACHMENT_TYPE = "A002": "An attachment type below 0x8000 is in the registry, and occurs once per block.";
    ATTACHMENT_SIZE = "A003": "The size of an attachment is the one that its type prescribes.";
}
