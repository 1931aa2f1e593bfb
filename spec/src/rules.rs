//! The rules of version 1. Letter: H header, D directory, M metadata, O object table, B block table, S parts, I index, P pages and info
//! sections, C child descriptors, K contours, A attachments.

/// How strict a rule is (in the sense of BCP 14).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// A file that breaks it is not a file of this version.
    Must,
    /// Readers read a file that breaks it; a writer needs a reason to.
    Should,
}

/// A numbered rule that a writer must keep and a validator checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Stable id: a letter for the part of the file and three digits. Never used again for another rule.
    pub id: &'static str,
    /// How strict it is.
    pub level: Level,
    /// What must or should hold, in one sentence; the same as in appendix C of the text.
    pub text: &'static str,
    /// Why the test vectors have no file that breaks the rule; `None` if they have one.
    pub no_vector: Option<&'static str>,
}

macro_rules! reason {
    () => {
        None
    };
    ($reason:literal) => {
        Some($reason)
    };
}

macro_rules! rules {
    ($($name:ident = $id:literal $level:ident : $text:literal $(, no vector: $reason:literal)?;)*) => {
        /// Every rule, in the order of the text.
        pub const RULES: &[Rule] = &[$(Rule {
            id: $id,
            level: Level::$level,
            text: $text,
            no_vector: reason!($($reason)?),
        }),*];
        /// The ids by name.
        pub mod ids {
            $(#[doc = $text] pub const $name: &str = $id;)*
        }
    };
}

rules! {
    IDENTIFIER = "H001" Must: "The file starts with the 12-byte identifier and has at least 64 bytes.";
    MAJOR_VERSION = "H002" Must: "The major version is 1.";
    REQUIRED_FEATURES = "H003" Must: "The reader knows every required feature bit that is set.";
    FILE_LENGTH = "H004" Must: "The file length in the header is the length of the file.";
    HEADER_CHECKSUM = "H005" Must: "The header checksum is the CRC-32 of header bytes 0 to 59.";
    HEADER_HEAD = "H006" Must: "The length of the head is 0 in a file without INDX, and else the least that has the header, the directory, OBJT and INDX.";

    DIRECTORY_RANGE = "D001" Must: "The directory lies within the file, after the header, at a multiple of 8 bytes.";
    DIRECTORY_CHECKSUM = "D002" Must: "The directory checksum is the CRC-32 of the directory bytes.";
    SECTION_RANGE = "D003" Must: "Every section lies within the file, starts at a multiple of 8 bytes, and overlaps neither another section nor the header nor the directory.";
    SECTION_CHECKSUM = "D004" Must: "The checksum of a section is the CRC-32 of its bytes, or 0 if flag bit 1 says that its parts carry their own.";
    SECTION_REQUIRED = "D005" Must: "The reader knows every section that has flag bit 0 set.";
    SECTION_MISSING = "D006" Must: "The sections OBJT, BLKT and BLKS occur exactly once; no other tag occurs twice.";
    SECTION_RESERVED = "D007" Must: "Undefined flag bits and reserved fields of the directory are zero.";
    DIRECTORY_LIMIT = "D008" Must: "The directory has at most 1024 entries.";
    FILE_GAPS = "D009" Must: "Bytes of the file outside the header, the directory and all sections are zero, and so are bytes of BLKS that belong to no stored block.";

    META_JSON = "M001" Must: "The section META, where present, is a JSON object in UTF-8, as section 2.3 lays down.";
    META_MEMBERS = "M002" Should: "The values of registered members of META are strings.";

    OBJECT_SIZE = "O001" Must: "The object table holds a whole number of entries, at least one.";
    OBJECT_ROOT = "O002" Must: "The root block of an object belongs to the object and has no parent, and the root slot is slot 2 of that block.";
    OBJECT_LEVELS = "O003" Must: "The number of levels is 1 to 23, and at least one voxel of the object is at that level.";
    OBJECT_TRANSFORM = "O004" Must: "The transform is finite and affine, and its determinant is a normal number.";
    OBJECT_COUNTS = "O005" Must: "The counts of descriptors, leaf voxels, contours and far pointers are those found in the blocks of the object.";
    OBJECT_RESERVED = "O006" Must: "The reserved fields of the object table are zero.";

    BLOCK_SIZE = "B001" Must: "The block table holds a whole number of entries, at least one.";
    BLOCK_ALIGNMENT = "B002" Must: "The image offset and the image size of a block are multiples of 8192, and the size is not zero.";
    BLOCK_IMAGE = "B003" Must: "Blocks follow each other in the image without gaps, in table order, from offset 0; if all blocks have codec 0, BLKS has the size of the image.";
    BLOCK_RANGE = "B004" Must: "The stored bytes of a block, extended to the next multiple of 8192, start at a multiple of 8192 from the start of the file, lie within BLKS and overlap those of no other block; if all blocks have codec 0, each is as far into BLKS as into the image.";
    BLOCK_CODEC = "B005" Must: "The codec is known, and one other than 0 goes with required feature bit 0; codec 0 stores the image bytes as they are, codec 1 stores exactly one Zstandard frame that decodes to the image bytes.";
    BLOCK_CHECKSUM = "B006" Must: "The block checksum is the CRC-32 of the stored bytes, or of the checksums of the parts if the block is stored in parts.";
    BLOCK_PARENT = "B007" Must: "The object of a block exists; the root block of an object has no parent, and the parent of any other block comes before it in the table and belongs to the same object.";
    BLOCK_CUBE = "B008" Must: "The cube of a root block is the root cube; the cube of any other block has scale 1 to 23 and a position that is a multiple of its edge, lies within the parent's cube, and is the cube of the voxel whose descendants the block holds.";
    BLOCK_RESERVED = "B009" Must: "The reserved fields of the block table are zero.";
    BLOCK_REACHED = "B010" Must: "Every block but a root block is referred to by its parent.";
    BLOCK_LIMIT = "B011" Must: "The image has at most 2^32 slots.", no vector: "A file with such an image has more than 32 GiB, or more than 1 MiB of frames if it is compressed.";
    BLOCK_ORDER = "B012" Should: "The blocks of an object are in the order of their parents.";

    PART_TABLE = "S001" Must: "The section PART occurs exactly if required feature bit 1 is set, and holds a whole number of entries, at least one.";
    PART_PLACE = "S002" Must: "The parts lie in BLKS in the order of PART, the first at its start, every other at the next multiple of 8 after the one before, and BLKS ends at the next multiple of 8 after the last; a part has more than 16 bytes.";
    PART_LEVELS = "S003" Must: "The block of a part exists; the parts of a block follow each other by level without gaps, from the level of its first descriptors on and to level 22 at most; a block with a codec other than 2 has one part, to level 22.";
    PART_CHECKSUM = "S004" Must: "The checksum of a part is the CRC-32 of the bytes of the part after it.";
    PART_HEADER = "S005" Must: "The other fields of a part header are those of PART and of the block table, and its reserved field is zero.";
    PART_FIELDS = "S006" Must: "The parts of a block of codec 2 decode, as section 4.4 lays down, to the image of the block.";
    PART_RESERVED = "S007" Must: "The reserved fields of PART are zero.";
    PART_BLOCK = "S008" Must: "The file offset of a block that is stored in parts is that of its first part, and its stored size is the sum of the sizes of its parts.";
    PART_ORDER = "S009" Should: "PART is in the order of first level, then block.";

    INDEX_PAGE = "I001" Must: "INDX and PAGE occur only with required feature bit 1, and PAGE only with INDX; every page decodes as section 4.5 lays down.";
    INDEX_LINK = "I002" Must: "Every link of the index leads to a page in PAGE and has its CRC-32; every byte of PAGE belongs to exactly one page, to which exactly one link leads.";
    INDEX_TABLES = "I003" Must: "The blocks and parts of all pages of the index are those of BLKT and PART, each exactly once, and the parts of a page are in the order of their offsets.";

    PAGE_HEADER = "P001" Must: "The first slot of every page of a descriptor array holds the distance in slots to the info section, and zero in its high word; the array has at least 4 slots and lies within the block.";
    INFO_RANGE = "P002" Must: "The info section comes directly after the descriptor array and says how long that is; together with the attachment directory it lies within the block.";
    INFO_BLOCK = "P003" Must: "The info section names its own block.";
    INFO_FIRST = "P004" Must: "The first-descriptor field leads to slot 2 of the block.";
    INFO_CONTOURS = "P005" Must: "The contour pool lies within the block, after the attachment directory.";
    INFO_RESERVED = "P006" Must: "The reserved fields of info sections, unused slots, and bytes between and after the parts of a block are zero.";

    CHILD_LEAF_MASK = "C001" Must: "The leaf mask is a subset of the valid mask, and the valid mask is not zero.";
    CHILD_RANGE = "C002" Must: "A pointer to children leads forward, and all descriptors that it leads to lie in one descriptor array: of the same block or, through a far pointer, of another.";
    CHILD_PAGE = "C003" Must: "Sibling descriptors are consecutive, start at an even slot and include no page header; no pointer leads to a page header.";
    CHILD_FAR = "C004" Must: "A far pointer lies in the descriptor array of the same block, after the descriptor that refers to it, holds a distance greater than zero, and zero in its high word.";
    CHILD_ONCE = "C005" Must: "Every descriptor but a root and every far pointer is referred to by exactly one descriptor, and no slot serves two purposes.";
    CHILD_NONE = "C006" Must: "A descriptor without non-leaf children has child pointer 0 and a clear far bit.";
    CHILD_DEPTH = "C007" Must: "No voxel is deeper than the number of levels of its object.";
    CHILD_BLOCK = "C008" Must: "A pointer into another block leads to slot 2 of that block, and the referring block is its parent.";

    CONTOUR_MASK = "K001" Must: "The contour mask is a subset of the valid mask.";
    CONTOUR_RANGE = "K002" Must: "All values that a contour pointer leads to lie in the contour pool of the block.";
    CONTOUR_NONE = "K003" Must: "A descriptor without contours has contour pointer 0.";
    CONTOUR_NORMAL = "K004" Must: "The decoded normal of a contour is not zero.";
    CONTOUR_ONCE = "K005" Must: "Every value of a contour pool belongs to exactly one voxel.";

    ATTACHMENT_RANGE = "A001" Must: "An attachment lies within the block, after the contour pool, starts at a multiple of 8 bytes, and overlaps no other attachment.";
    ATTACHMENT_TYPE = "A002" Must: "An attachment type is in the registry or in the vendors' range and occurs once per block; a block has at most one type with colours and at most one with normals.";
    ATTACHMENT_SIZE = "A003" Must: "The size of an attachment is one that its type prescribes.";
    ATTACHMENT_LIMIT = "A004" Must: "A block has at most 64 attachments.";
    ATTACHMENT_UNUSED = "A005" Must: "Attribute blocks of pairs and entries of slots without a child descriptor are zero, and so are the unused bytes of a constant colour.";
    ATTACHMENT_UNIFORM = "A006" Should: "The blocks of an object all have colours or none has, and likewise normals and ambient occlusion.";
    ATTACHMENT_ENTRY = "A007" Must: "The entry of a descriptor in plain colours, plain normals, corners or components leads to values in the attachment, after the entries, at an even distance for corners; a value mask is a subset of the valid mask, undefined bits are zero, and so is an entry without values.";
    ATTACHMENT_ONCE = "A008" Must: "Every value of plain colours, plain normals, corners or components belongs to the entry of exactly one descriptor.";
    COMPONENT_HEAD = "A009" Must: "The head of a component attachment names a format that its type can have and a form of this text, and its other bytes are zero.";
    COMPONENT_VALUE = "A010" Must: "The numbers of components are finite, those of emission are not negative, and the bits of a value that belong to no component are zero.";
}
