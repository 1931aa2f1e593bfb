//! How a file is stored: features, codecs, parts, index, sections.

use serde::Serialize;

use crate::file::open::{directory_range, read_directory, read_header};
use crate::file::*;
use crate::{FormatError, RangeRead};

/// How a file is stored. Made of its header, its directory and its block table; nothing else is read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Storage {
    /// Length of the file in bytes.
    pub file_bytes: u64,
    /// Major and minor version.
    pub version: [u16; 2],
    /// Required feature bits (spec 2.1).
    pub required_features: u64,
    /// Optional feature bits.
    pub optional_features: u64,
    /// Bytes of the file for each voxel.
    pub bytes_per_voxel: f64,
    /// Blocks by how they are stored.
    pub blocks: Codecs,
    /// Number of parts, if the blocks are stored in parts by level (spec 4.3).
    pub parts: Option<u64>,
    /// The index, if the file has one (spec 4.5).
    pub index: Option<Index>,
    /// The directory: where every byte of the file belongs, apart from the header, itself and padding.
    pub sections: Vec<StoredSection>,
    /// Bytes of the header, the directory and padding between sections.
    pub other_bytes: u64,
}

/// Numbers of blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Codecs {
    /// Stored as they are in memory (codec 0).
    pub raw: u64,
    /// As a Zstandard frame (codec 1).
    pub zstd: u64,
    /// As streams of fields (codec 2).
    pub fields: u64,
}

/// The index of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Index {
    /// Bytes of the root page.
    pub root_bytes: u64,
    /// Bytes of all other pages.
    pub page_bytes: u64,
    /// Bytes from the start of the file that have what a reader needs first.
    pub head_bytes: u32,
}

/// A section of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StoredSection {
    /// Its tag; bytes that are not printable ASCII are escaped.
    pub tag: String,
    /// Its flags (spec 2.2).
    pub flags: u32,
    /// Offset in the file in bytes.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u64,
}

impl Storage {
    /// Reads header and directory of a file whose tables are these.
    ///
    /// # Errors
    /// The source's, or the rule that header or directory break.
    pub fn read(
        source: &(impl RangeRead + ?Sized),
        objects: &[ObjectEntry],
        blocks: &[BlockEntry],
    ) -> Result<Self, FormatError> {
        let fetch = |offset: u64, length: u64| {
            let mut bytes = vec![0; length as usize];
            match source.read_at(offset, &mut bytes) {
                Ok(()) => Ok(bytes),
                Err(source) => Err(FormatError::Source { offset, source }),
            }
        };
        let header = read_header(&fetch(0, HEADER_BYTES)?, None)?;
        let (start, end) = directory_range(&header)?;
        let sections = read_directory(&fetch(start, end - start)?, &header)?.sections;
        let length = |tag| sections.iter().find(|s| s.tag == tag).map(|s| s.length);
        let mut codecs = Codecs::default();
        for block in blocks {
            match block.codec {
                CODEC_RAW => codecs.raw += 1,
                CODEC_ZSTD => codecs.zstd += 1,
                _ => codecs.fields += 1,
            }
        }
        let voxels: u64 = objects.iter().map(ObjectEntry::voxels).sum();
        Ok(Self {
            file_bytes: header.file_length,
            version: [header.major, header.minor],
            required_features: header.required_features,
            optional_features: header.optional_features,
            bytes_per_voxel: header.file_length as f64 / voxels.max(1) as f64,
            blocks: codecs,
            parts: length(TAG_PARTS).map(|bytes| bytes / PART_BYTES),
            index: length(TAG_INDEX).map(|root_bytes| Index {
                root_bytes,
                page_bytes: length(TAG_PAGES).unwrap_or(0),
                head_bytes: header.head,
            }),
            other_bytes: header.file_length.saturating_sub(sections.iter().map(|s| s.length).sum()),
            sections: sections.iter().map(StoredSection::new).collect(),
        })
    }
}

impl StoredSection {
    fn new(entry: &SectionEntry) -> Self {
        let tag = entry.tag.escape_ascii().to_string();
        Self { tag, flags: entry.flags, offset: entry.offset, bytes: entry.length }
    }
}
