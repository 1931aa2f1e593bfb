//! Opening files, by mapping where possible, and reading all of their structure except the blocks (spec section 2).

use std::fs::File;
use std::path::Path;

use memmap2::Mmap;
use rayon::prelude::*;

use crate::check::stored::gaps;
use crate::check::tables::{check_blocks, check_codecs, check_objects, check_stored, compressed, stored_ranges};
use crate::check::{instances, metadata};
use crate::file::*;
use crate::file::{compression, hash};
use crate::index::check::check_index;
use crate::octree::{Gaps, Image, Origin, Stored, UnknownSection};
use crate::parts::block::decode_parts;
use crate::parts::stored::Decoder;
use crate::parts::table::PartTable;
use crate::{Broken, FormatError, Octree, ids};

/// Default limit of the memory for decompressed blocks: 8 GiB.
pub const DEFAULT_MEMORY_LIMIT: u64 = 8 << 30;

/// How a file is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenOptions {
    /// Largest image in bytes that is allocated: for a file with compressed blocks, for a file in memory, or for the
    /// blocks that a [`StreamReader`](crate::StreamReader) loads at once. Mapped files are not limited. Default:
    /// [`DEFAULT_MEMORY_LIMIT`].
    pub memory_limit: u64,
    /// Whether [`Octree::intact`], and with it every caster that loads the octree, compares the checksums of all blocks.
    /// Default: true. False is for files that were verified before: casters then read only what they need. Writers
    /// ([`Octree::verified`]), [`validate`](crate::validate()) and a [`StreamReader`](crate::StreamReader) compare them
    /// anyway.
    pub verify: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { memory_limit: DEFAULT_MEMORY_LIMIT, verify: true }
    }
}

impl OpenOptions {
    /// Refuses an image that is larger than the limit.
    pub(crate) fn check(&self, image: u64) -> Result<(), FormatError> {
        if image <= self.memory_limit {
            return Ok(());
        }
        let what = format!("the blocks need {image} bytes, above the memory limit of {}: raise it", self.memory_limit);
        Err(FormatError::Limit(what))
    }
}

impl Octree {
    /// Opens a file with the default [`OpenOptions`], see [`open_with`](Self::open_with).
    ///
    /// # Errors
    /// The system's, the rule that the file breaks, or the memory limit.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        Self::open_with(path, &OpenOptions::default())
    }

    /// Opens a file by mapping it. Checks header, directory, tables, info sections and the checksums of the sections;
    /// reads nothing else. The checksums of the blocks are compared when the octree is used, see
    /// [`intact`](Self::intact) and [`verified`](Self::verified).
    ///
    /// If any block is compressed, all blocks are read, checked against their checksums and decompressed in parallel;
    /// the image is then held in memory.
    ///
    /// The file must not be modified or truncated while the octree exists.
    ///
    /// # Errors
    /// The system's, the rule that the file breaks, or the memory limit.
    pub fn open_with(path: &Path, options: &OpenOptions) -> Result<Self, FormatError> {
        let map = map(path)?;
        Contents::read(&map)?.into_mapped(map, options)
    }

    /// Opens a file in memory with the default [`OpenOptions`], see [`from_bytes_with`](Self::from_bytes_with).
    ///
    /// # Errors
    /// The rule that the bytes break, or the memory limit.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FormatError> {
        Self::from_bytes_with(bytes, &OpenOptions::default())
    }

    /// Opens a file in memory, with the checks of [`open_with`](Self::open_with). The image is copied.
    ///
    /// # Errors
    /// The rule that the bytes break, or the memory limit.
    pub fn from_bytes_with(bytes: &[u8], options: &OpenOptions) -> Result<Self, FormatError> {
        Contents::read(bytes)?.into_owned(bytes, options)
    }
}

/// Maps a file for reading. The file must not change while the mapping exists.
pub(crate) fn map(path: &Path) -> Result<Mmap, FormatError> {
    // Check before opening, as opening a pipe waits for a writer.
    let metadata = std::fs::metadata(path).map_err(|e| FormatError::io(path, e))?;
    if !metadata.is_file() {
        return Err(FormatError::io(path, std::io::Error::other("not a regular file")));
    }
    let file = File::open(path).map_err(|e| FormatError::io(path, e))?;
    if metadata.len() < HEADER_BYTES {
        let what = format!("the file has {} bytes, too short for a header of {HEADER_BYTES}", metadata.len());
        return Err(Broken::new(ids::IDENTIFIER, 0, what).into());
    }
    // SAFETY: the mapping is read-only and private to this process, and any content is valid as plain bytes. The caller
    // must ensure that the file is not truncated meanwhile; the documentation of the public functions says so.
    unsafe { Mmap::map(&file) }.map_err(|e| FormatError::io(path, e))
}

/// The parts of a file except the image.
pub(crate) struct Contents {
    objects: Vec<ObjectEntry>,
    blocks: Vec<BlockEntry>,
    meta: String,
    instances: Vec<InstanceEntry>,
    /// Contents and offset of HASH.
    pub(crate) hash: Option<(FileHash, u64)>,
    unknown: Vec<UnknownSection>,
    /// Offset and length of the block data in the file.
    data: (usize, usize),
    origin: Origin,
    /// The parts, if the blocks are stored in parts.
    parts: Option<PartTable>,
    /// Start and end of header, directory and sections, in order. If any block is compressed, the ranges of the stored
    /// blocks replace that of the block data.
    pub(crate) ranges: Vec<(u64, u64)>,
}

/// Largest section other than the block data that is read into memory.
const MAX_SECTION: u64 = 1 << 30;

impl Contents {
    /// The octree with its own copy of the image. `bytes` are those that this was read from.
    pub(crate) fn into_owned(self, bytes: &[u8], options: &OpenOptions) -> Result<Octree, FormatError> {
        if self.origin.compressed {
            return self.into_decompressed(bytes, options);
        }
        let (offset, length) = self.data;
        options.check(length as u64)?;
        let mut image = vec![0u64; length / 8];
        bytemuck::cast_slice_mut::<u64, u8>(&mut image).copy_from_slice(&bytes[offset..offset + length]);
        let gaps = Gaps::Read(gaps(bytes, &self.ranges).next());
        self.into_octree(Image::Owned(image), gaps, options)
    }

    /// The octree with the image in the map that this was read from, or in memory if any block is compressed.
    pub(crate) fn into_mapped(mut self, map: Mmap, options: &OpenOptions) -> Result<Octree, FormatError> {
        if self.origin.compressed {
            return self.into_decompressed(&map, options);
        }
        let (offset, bytes) = self.data;
        let gaps = Gaps::Unread(std::mem::take(&mut self.ranges));
        self.into_octree(Image::Mapped { map, offset, bytes }, gaps, options)
    }

    fn into_decompressed(self, bytes: &[u8], options: &OpenOptions) -> Result<Octree, FormatError> {
        let length: u64 = self.blocks.iter().map(|b| b.image_size).sum();
        options.check(length)?;
        let mut image = vec![0u64; (length / 8) as usize];
        let mut rest: &mut [u8] = bytemuck::cast_slice_mut(&mut image);
        let mut work = Vec::with_capacity(self.blocks.len());
        for (index, block) in self.blocks.iter().enumerate() {
            let (head, tail) = rest.split_at_mut(block.image_size as usize);
            work.push((index, block, head));
            rest = tail;
        }
        let results: Vec<Result<(), Broken>> = (work.into_par_iter())
            .map_init(Decoder::new, |decoder, (index, block, image)| {
                if let Some(parts) = &self.parts {
                    let decoder = decoder.as_mut().map_err(|what| {
                        Broken::new(ids::PART_FIELDS, block.file_offset, format!("block {index}: {what}"))
                    })?;
                    return decode_parts(&self.blocks, parts, index, bytes, image, decoder);
                }
                let stored = block.file_offset as usize..(block.file_offset + block.stored_size) as usize;
                compression::decode(index, block, &bytes[stored], image)
            })
            .collect();
        // Report the first broken block in table order, whichever thread was first.
        results.into_iter().collect::<Result<(), Broken>>()?;
        let gaps = Gaps::Read(gaps(bytes, &self.ranges).next());
        self.into_octree(Image::Owned(image), gaps, options)
    }

    fn into_octree(self, image: Image, gaps: Gaps, options: &OpenOptions) -> Result<Octree, FormatError> {
        let stored = Stored::File { gaps, verify: options.verify };
        let part_order = self.parts.as_ref().and_then(PartTable::disorder);
        let mut octree =
            Octree::new(self.objects, self.blocks, self.meta, self.unknown, image, Some(self.origin), stored)?;
        octree.part_order = part_order;
        octree.instances = self.instances;
        octree.hash = self.hash.map(|(hash, _)| hash);
        Ok(octree)
    }

    /// Reads and checks everything except info sections and blocks.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let header = read_header(bytes, Some(bytes.len() as u64))?;
        let (start, end) = directory_range(&header)?;
        let Directory { sections, mut ranges } = read_directory(&bytes[start as usize..end as usize], &header)?;
        let slice = |s: &SectionEntry| &bytes[s.offset as usize..(s.offset + s.length) as usize];
        for section in &sections {
            check_section(section, slice(section))?;
        }
        check_overlaps(&ranges)?;
        check_head(&header, &sections)?;
        let Tables { objects, blocks, data, object_at, parts } =
            Tables::read(&header, &sections, |section| Ok(slice(section).to_vec()))?;
        let find = |tag| sections.iter().find(|section| section.tag == tag);
        check_pages(find(TAG_INDEX), find(TAG_PAGES), slice, &blocks, parts.as_ref())?;
        let compressed = compressed(&blocks) || parts.is_some();
        let mut origin = Origin { image: data.offset, objects: object_at, meta: 0, instances: 0, compressed };
        let (mut meta, mut placed, mut hash) = (String::new(), Vec::new(), None);
        let mut unknown = Vec::new();
        check_tags(&sections)?;
        for section in &sections {
            match section.tag {
                TAG_OBJECTS | TAG_BLOCKS | TAG_DATA | TAG_PARTS | TAG_INDEX | TAG_PAGES => {}
                TAG_META => {
                    let found = metadata::parse(slice(section)).map_err(|(at, what)| {
                        broken(ids::META_JSON, section.offset + at as u64, format!("the metadata: {what}"))
                    })?;
                    meta = found.text.to_owned();
                    origin.meta = section.offset;
                }
                TAG_INSTANCES => {
                    placed = instances::read(slice(section), objects.len(), section.offset)?;
                    origin.instances = section.offset;
                }
                TAG_HASH => hash = Some((hash::read(section, slice(section))?, section.offset)),
                tag => unknown.push(UnknownSection { tag, flags: section.flags, bytes: slice(section).to_vec() }),
            }
        }
        if compressed {
            ranges.retain(|range| *range != (data.offset, data.offset + data.length));
            match &parts {
                Some(parts) => ranges.extend((0..parts.entries.len()).map(|part| parts.range(part as u32))),
                None => ranges.extend(stored_ranges(&blocks)),
            }
            ranges.sort_unstable();
        }
        let data = (data.offset as usize, data.length as usize);
        Ok(Self { objects, blocks, meta, instances: placed, hash, unknown, data, origin, parts, ranges })
    }
}

/// Checks the index, if there is one, against the tables.
fn check_pages<'a>(
    index: Option<&SectionEntry>,
    pages: Option<&SectionEntry>,
    slice: impl Fn(&SectionEntry) -> &'a [u8],
    blocks: &[BlockEntry],
    parts: Option<&PartTable>,
) -> Result<(), FormatError> {
    let Some((index, parts)) = index.zip(parts) else {
        let Some(section) = index.or(pages) else { return Ok(()) };
        let what = "INDX without required feature bit 1, or PAGE without INDX".into();
        return Err(broken(ids::INDEX_PAGE, section.offset, what));
    };
    let (bytes, at) = pages.map_or((&[][..], 0), |pages| (slice(pages), pages.offset));
    Ok(check_index(slice(index), index.offset, bytes, at, blocks, parts)?)
}

/// The two tables of a file, checked as far as possible without the blocks.
pub(crate) struct Tables {
    pub(crate) objects: Vec<ObjectEntry>,
    pub(crate) blocks: Vec<BlockEntry>,
    /// The section with the blocks.
    pub(crate) data: SectionEntry,
    /// Offset of the object table in the file.
    pub(crate) object_at: u64,
    /// The parts, if the blocks are stored in parts.
    pub(crate) parts: Option<PartTable>,
}

impl Tables {
    /// Reads the tables with `fetch`, which returns the bytes of a section.
    pub(crate) fn read(
        header: &Header,
        sections: &[SectionEntry],
        mut fetch: impl FnMut(&SectionEntry) -> Result<Vec<u8>, FormatError>,
    ) -> Result<Self, FormatError> {
        let find = |tag: [u8; 4]| {
            let mut found = sections.iter().filter(|s| s.tag == tag);
            match (found.next(), found.next()) {
                (Some(section), None) => Ok(*section),
                _ => Err(broken(
                    ids::SECTION_MISSING,
                    header.directory_offset,
                    format!("section {} does not occur exactly once", name(tag)),
                )),
            }
        };
        let (object_section, block_section, data) = (find(TAG_OBJECTS)?, find(TAG_BLOCKS)?, find(TAG_DATA)?);
        let objects = entries::<ObjectEntry>(&fetch(&object_section)?, OBJECT_BYTES).ok_or_else(|| {
            broken(
                ids::OBJECT_SIZE,
                object_section.offset,
                format!("the object table is empty or no multiple of {OBJECT_BYTES} bytes"),
            )
        })?;
        let blocks = entries::<BlockEntry>(&fetch(&block_section)?, BLOCK_BYTES).ok_or_else(|| {
            broken(
                ids::BLOCK_SIZE,
                block_section.offset,
                format!("the block table is empty or no multiple of {BLOCK_BYTES} bytes"),
            )
        })?;
        check_objects(&objects, object_section.offset)?;
        let in_parts = header.required_features & FEATURE_PARTS != 0;
        let image = (!compressed(&blocks) && !in_parts).then_some(data.length);
        check_blocks(&blocks, block_section.offset, &objects, image)?;
        check_codecs(&blocks, block_section.offset, header.required_features)?;
        let part_section = sections.iter().find(|s| s.tag == TAG_PARTS);
        let parts = match part_section {
            Some(section) if in_parts => {
                let parts = entries::<PartEntry>(&fetch(section)?, PART_BYTES).ok_or_else(|| {
                    let what = format!("the table of parts is empty or no multiple of {PART_BYTES} bytes");
                    broken(ids::PART_TABLE, section.offset, what)
                })?;
                Some(PartTable::new(parts, section.offset, &blocks, block_section.offset, &data)?)
            }
            None if !in_parts => {
                check_stored(&blocks, block_section.offset, &data)?;
                None
            }
            section => {
                let at = section.map_or(16, |section| section.offset);
                let what = "section PART and required feature bit 1 do not occur together".into();
                return Err(broken(ids::PART_TABLE, at, what));
            }
        };
        Ok(Self { objects, blocks, data, object_at: object_section.offset, parts })
    }
}

/// Checks the length of the head (H006).
pub(crate) fn check_head(header: &Header, sections: &[SectionEntry]) -> Result<(), FormatError> {
    let directory = header.directory_offset + u64::from(header.directory_count) * SECTION_BYTES;
    let ends = sections.iter().filter(|s| matches!(s.tag, TAG_OBJECTS | TAG_INDEX)).map(|s| s.offset + s.length);
    let expected = match sections.iter().any(|section| section.tag == TAG_INDEX) {
        true => ends.fold(directory, u64::max),
        false => 0,
    };
    if u64::from(header.head) == expected {
        return Ok(());
    }
    let what = format!("the header says that the head has {} bytes, expected {expected}", header.head);
    Err(broken(ids::HEADER_HEAD, 56, what))
}

/// Checks that no tag occurs twice and that all required sections are known.
pub(crate) fn check_tags(sections: &[SectionEntry]) -> Result<(), FormatError> {
    for (i, section) in sections.iter().enumerate() {
        match section.tag {
            TAG_OBJECTS | TAG_BLOCKS | TAG_DATA => {}
            tag if sections[..i].iter().any(|s| s.tag == tag) => {
                let what = format!("section {} occurs twice", name(tag));
                return Err(broken(ids::SECTION_MISSING, section.offset, what));
            }
            TAG_META | TAG_PARTS | TAG_INDEX | TAG_PAGES | TAG_INSTANCES | TAG_HASH => {}
            tag if section.flags & SECTION_REQUIRED != 0 => {
                let what = format!("section {} is required, but this reader does not know it", name(tag));
                return Err(broken(ids::SECTION_REQUIRED, section.offset, what));
            }
            _ => {}
        }
    }
    Ok(())
}

fn broken(rule: &'static str, offset: u64, what: String) -> FormatError {
    Broken::new(rule, offset, what).into()
}

fn name(tag: [u8; 4]) -> String {
    tag.escape_ascii().to_string()
}

fn entries<T>(bytes: &[u8], size: u64) -> Option<Vec<T>>
where
    T: binrw::BinRead + binrw::meta::ReadEndian,
    for<'a> T::Args<'a>: Default,
{
    if bytes.is_empty() || !(bytes.len() as u64).is_multiple_of(size) {
        return None;
    }
    bytes.chunks_exact(size as usize).map(from_bytes::<T>).collect()
}

/// Reads and checks the header from the first bytes of a file. `length` is that of the whole file, if known.
pub(crate) fn read_header(bytes: &[u8], length: Option<u64>) -> Result<Header, FormatError> {
    if !bytes.starts_with(&IDENTIFIER) {
        let what = if bytes.starts_with(b"\xABESVO") {
            "the identifier is damaged by a text-mode transfer, or belongs to another major version"
        } else if bytes.starts_with(b"Clusters") {
            "not an esvo file but an .oct file of ESVO 1.x; convert it with `esvo convert`"
        } else {
            "not an esvo file: the identifier is missing"
        };
        return Err(broken(ids::IDENTIFIER, 0, what.into()));
    }
    let header: Header = from_bytes(bytes).ok_or_else(|| {
        broken(
            ids::IDENTIFIER,
            0,
            format!("the file has {} bytes, too short for a header of {HEADER_BYTES}", bytes.len()),
        )
    })?;
    if header.major != MAJOR_VERSION {
        let what = format!("the file has version {}.{}, this reader knows major version 1", header.major, header.minor);
        return Err(broken(ids::MAJOR_VERSION, 12, what));
    }
    if crc32fast::hash(&bytes[..HEADER_BYTES as usize - 4]) != header.header_crc {
        return Err(broken(ids::HEADER_CHECKSUM, 60, "the header is damaged: its checksum differs".into()));
    }
    let strange = header.required_features & !KNOWN_REQUIRED;
    if strange != 0 {
        let what = if strange == FEATURE_COMPRESSED {
            "required feature bit 0 (compressed blocks) needs a build of esvo-format with the feature `zstd`".into()
        } else {
            format!("this reader does not know the required feature bits {strange:#x}")
        };
        return Err(broken(ids::REQUIRED_FEATURES, 16, what));
    }
    if let Some(length) = length.filter(|length| *length != header.file_length) {
        let what = format!("the file has {length} bytes, the header says {}: truncated?", header.file_length);
        return Err(broken(ids::FILE_LENGTH, 32, what));
    }
    Ok(header)
}

/// The directory of a file.
pub(crate) struct Directory {
    pub(crate) sections: Vec<SectionEntry>,
    /// Start and end of header, directory and sections in the file, in order.
    pub(crate) ranges: Vec<(u64, u64)>,
}

/// Start and end of the directory.
pub(crate) fn directory_range(header: &Header) -> Result<(u64, u64), FormatError> {
    let at = header.directory_offset;
    let length = u64::from(header.directory_count) * SECTION_BYTES;
    let end =
        at.checked_add(length).filter(|end| *end <= header.file_length && at.is_multiple_of(8) && at >= HEADER_BYTES);
    let Some(end) = end else {
        return Err(broken(
            ids::DIRECTORY_RANGE,
            40,
            format!(
                "the directory at offset {at} with {length} bytes is not within the file, or not aligned to 8 bytes"
            ),
        ));
    };
    if header.directory_count > MAX_SECTIONS {
        return Err(broken(
            ids::DIRECTORY_LIMIT,
            48,
            format!("the directory has {} entries, expected at most {MAX_SECTIONS}", header.directory_count),
        ));
    }
    Ok((at, end))
}

/// Reads the directory and checks the ranges of its sections, except whether they overlap.
pub(crate) fn read_directory(directory: &[u8], header: &Header) -> Result<Directory, FormatError> {
    let at = header.directory_offset;
    if crc32fast::hash(directory) != header.directory_crc {
        return Err(broken(ids::DIRECTORY_CHECKSUM, at, "the directory is damaged: its checksum differs".into()));
    }
    let sections: Vec<SectionEntry> = entries(directory, SECTION_BYTES).unwrap_or_default();
    let mut ranges = vec![(0, HEADER_BYTES), (at, at + directory.len() as u64)];
    for (i, section) in sections.iter().enumerate() {
        let entry_at = at + i as u64 * SECTION_BYTES;
        let tag = name(section.tag);
        if section.flags & !(SECTION_REQUIRED | SECTION_OWN_CHECKSUMS) != 0 || section.reserved != 0 {
            return Err(broken(
                ids::SECTION_RESERVED,
                entry_at,
                format!("reserved flags or fields of section {tag} are not zero"),
            ));
        }
        let end = section.offset.checked_add(section.length).filter(|end| *end <= header.file_length);
        let Some(end) = end.filter(|_| section.offset % 8 == 0) else {
            let (at, length) = (section.offset, section.length);
            let what = format!(
                "section {tag} at offset {at} with {length} bytes is not within the file, or not aligned to 8 bytes"
            );
            return Err(broken(ids::SECTION_RANGE, entry_at, what));
        };
        if section.tag != TAG_DATA && section.length > MAX_SECTION {
            return Err(FormatError::Limit(format!(
                "section {tag} has {} bytes, this reader accepts at most {MAX_SECTION}",
                section.length
            )));
        }
        ranges.push((section.offset, end));
    }
    ranges.sort_unstable();
    Ok(Directory { sections, ranges })
}

/// Checks that header, directory and sections do not overlap.
pub(crate) fn check_overlaps(ranges: &[(u64, u64)]) -> Result<(), FormatError> {
    if let Some(pair) = ranges.windows(2).find(|pair| pair[0].1 > pair[1].0) {
        let what = format!("header, directory or sections overlap at offset {}", pair[1].0);
        return Err(broken(ids::SECTION_RANGE, pair[1].0, what));
    }
    Ok(())
}

/// Checks the bytes of a section against its checksum.
pub(crate) fn check_section(section: &SectionEntry, bytes: &[u8]) -> Result<(), FormatError> {
    let crc = if section.flags & SECTION_OWN_CHECKSUMS != 0 { 0 } else { crc32fast::hash(bytes) };
    if crc != section.crc {
        let what = format!("section {} is damaged: its checksum differs", name(section.tag));
        return Err(broken(ids::SECTION_CHECKSUM, section.offset, what));
    }
    Ok(())
}
