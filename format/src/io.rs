//! Files: opening by mapping, writing to a temporary and renaming (spec sections 2 and 3).

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use memmap2::Mmap;
use rayon::prelude::*;

use crate::file::*;
use crate::octree::{Image, Origin, UnknownSection};
use crate::tables::{check_blocks, check_objects, check_stored};
use crate::{Broken, FormatError, Octree, ids};

impl Octree {
    /// Opens a file by mapping it. Checks header, directory, tables and info sections, and the checksums of all of
    /// these; reads nothing else.
    ///
    /// The file must not be changed or truncated while the octree lives.
    ///
    /// # Errors
    /// The system's, or the rule that the file breaks.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let map = map(path)?;
        Contents::read(&map)?.into_mapped(map)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// The rule that the bytes break.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FormatError> {
        Contents::read(bytes)?.into_owned(bytes)
    }

    /// Writes the file to a temporary beside `path`, then renames it: `path` is either untouched or complete.
    ///
    /// # Errors
    /// The system's; `path` exists and is not a regular file.
    pub fn write(&self, path: &Path) -> Result<(), FormatError> {
        write_atomically(path, |out| self.write_to(out)).map_err(|e| FormatError::io(path, e))
    }

    /// Writes the file to `out`. The same octree always gives the same bytes.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_to(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let image: &[u8] = bytemuck::cast_slice(self.slots());
        let objects: Vec<u8> = self.objects.iter().flat_map(to_bytes).collect();
        let mut sections: Vec<(SectionEntry, &[u8])> = Vec::new();
        let entry = |tag, flags, length: usize| SectionEntry {
            tag,
            flags,
            offset: 0,
            length: length as u64,
            crc: 0,
            reserved: 0,
        };
        let block_table_bytes = self.blocks.len() * BLOCK_BYTES as usize;
        let mut blocks = Vec::new();
        sections.push((entry(TAG_OBJECTS, SECTION_REQUIRED, objects.len()), &objects));
        sections.push((entry(TAG_BLOCKS, SECTION_REQUIRED, block_table_bytes), &[]));
        if !self.meta.is_empty() {
            sections.push((entry(TAG_META, 0, self.meta.len()), self.meta.as_bytes()));
        }
        for unknown in &self.unknown {
            sections.push((entry(unknown.tag, unknown.flags, unknown.bytes.len()), &unknown.bytes));
        }
        let directory_offset = HEADER_BYTES;
        let mut offset = directory_offset + (sections.len() as u64 + 1) * SECTION_BYTES;
        for (section, _) in &mut sections {
            section.offset = offset;
            offset = (offset + section.length).next_multiple_of(8);
        }
        let data_offset = offset.next_multiple_of(PAGE_BYTES);
        let data_flags = SECTION_REQUIRED | SECTION_OWN_CHECKSUMS;
        let data = SectionEntry { offset: data_offset, ..entry(TAG_DATA, data_flags, image.len()) };

        let crcs: Vec<u32> = (self.blocks.par_iter())
            .map(|b| crc32fast::hash(&image[b.image_offset as usize..(b.image_offset + b.image_size) as usize]))
            .collect();
        for (block, crc) in self.blocks.iter().zip(crcs) {
            let file_offset = data_offset + block.image_offset;
            let stored = BlockEntry { file_offset, stored_size: block.image_size, codec: CODEC_RAW, crc, ..*block };
            blocks.extend(to_bytes(&stored));
        }
        sections[1].1 = &blocks;
        let mut directory = Vec::new();
        for (section, bytes) in &mut sections {
            section.crc = if section.flags & SECTION_OWN_CHECKSUMS != 0 { 0 } else { crc32fast::hash(bytes) };
            directory.extend(to_bytes(section));
        }
        directory.extend(to_bytes(&data));
        let mut header = Header {
            identifier: IDENTIFIER,
            major: MAJOR_VERSION,
            minor: MINOR_VERSION,
            required_features: 0,
            optional_features: 0,
            file_length: data_offset + image.len() as u64,
            directory_offset,
            directory_count: sections.len() as u32 + 1,
            directory_crc: crc32fast::hash(&directory),
            reserved: 0,
            header_crc: 0,
        };
        header.header_crc = crc32fast::hash(&to_bytes(&header)[..HEADER_BYTES as usize - 4]);

        let mut written = 0u64;
        let mut put = |out: &mut dyn Write, at: u64, bytes: &[u8]| -> std::io::Result<()> {
            out.write_all(&vec![0; (at - written) as usize])?;
            out.write_all(bytes)?;
            written = at + bytes.len() as u64;
            Ok(())
        };
        put(out, 0, &to_bytes(&header))?;
        put(out, directory_offset, &directory)?;
        for (section, bytes) in &sections {
            put(out, section.offset, bytes)?;
        }
        put(out, data_offset, image)
    }
}

/// Maps a file for reading. It must not change while the mapping lives.
pub(crate) fn map(path: &Path) -> Result<Mmap, FormatError> {
    // Asked before opening: to open a pipe would wait for a writer.
    let metadata = std::fs::metadata(path).map_err(|e| FormatError::io(path, e))?;
    if !metadata.is_file() {
        return Err(FormatError::io(path, std::io::Error::other("not a regular file")));
    }
    let file = File::open(path).map_err(|e| FormatError::io(path, e))?;
    if metadata.len() < HEADER_BYTES {
        let what = format!("{} bytes are too short for a header", metadata.len());
        return Err(Broken::new(ids::IDENTIFIER, 0, what).into());
    }
    // SAFETY: the mapping is private to this process and read-only. The memory is plain bytes, valid for any
    // content; that nobody truncates the file meanwhile is asked of the caller, as every mapping reader must.
    unsafe { Mmap::map(&file) }.map_err(|e| FormatError::io(path, e))
}

/// Runs `write` on a temporary file beside `path`, syncs it, and renames it to `path`.
///
/// # Errors
/// The system's; `path` exists and is not a regular file (a device or a directory is never replaced).
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        return Err(std::io::Error::other("exists and is not a regular file"));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Readable like any other output; the umask still applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.prefix(".esvo-").suffix(".tmp").tempfile_in(folder)?;
    let mut out = BufWriter::with_capacity(1 << 20, temporary);
    write(&mut out)?;
    let temporary = out.into_inner().map_err(|e| e.into_error())?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// The parts of a file but for the image.
pub(crate) struct Contents {
    objects: Vec<ObjectEntry>,
    blocks: Vec<BlockEntry>,
    meta: String,
    unknown: Vec<UnknownSection>,
    /// Offset and length of the image in the file.
    image: (usize, usize),
    origin: Origin,
    /// Start and end of header, directory and sections, in order.
    pub(crate) ranges: Vec<(u64, u64)>,
}

/// Largest section other than the block data that is read into memory.
const MAX_SECTION: u64 = 1 << 30;

impl Contents {
    /// With an image of its own, copied from the bytes that this was read from.
    pub(crate) fn into_owned(self, bytes: &[u8]) -> Result<Octree, FormatError> {
        let (offset, length) = self.image;
        let mut image = vec![0u64; length / 8];
        bytemuck::cast_slice_mut::<u64, u8>(&mut image).copy_from_slice(&bytes[offset..offset + length]);
        self.into_octree(Image::Owned(image))
    }

    /// With the image in the map that this was read from.
    pub(crate) fn into_mapped(self, map: Mmap) -> Result<Octree, FormatError> {
        let (offset, bytes) = self.image;
        self.into_octree(Image::Mapped { map, offset, bytes })
    }

    fn into_octree(self, image: Image) -> Result<Octree, FormatError> {
        Octree::new(self.objects, self.blocks, self.meta, self.unknown, image, Some(self.origin))
    }

    pub(crate) fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let header = read_header(bytes)?;
        let Directory { sections, ranges } = read_directory(bytes, &header)?;
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
        let slice = |s: &SectionEntry| &bytes[s.offset as usize..(s.offset + s.length) as usize];
        let (object_section, block_section, data) = (find(TAG_OBJECTS)?, find(TAG_BLOCKS)?, find(TAG_DATA)?);
        let objects = entries::<ObjectEntry>(slice(&object_section), OBJECT_BYTES)
            .ok_or_else(|| broken(ids::OBJECT_SIZE, object_section.offset, "object table has no whole entry".into()))?;
        let blocks = entries::<BlockEntry>(slice(&block_section), BLOCK_BYTES)
            .ok_or_else(|| broken(ids::BLOCK_SIZE, block_section.offset, "block table has no whole entry".into()))?;
        check_objects(&objects, object_section.offset)?;
        check_blocks(&blocks, block_section.offset, &objects, data.length)?;
        check_stored(&blocks, block_section.offset, &data)?;
        let mut origin = Origin { image: data.offset, objects: object_section.offset, meta: 0 };
        let mut meta = String::new();
        let mut unknown = Vec::new();
        for (i, section) in sections.iter().enumerate() {
            match section.tag {
                TAG_OBJECTS | TAG_BLOCKS | TAG_DATA => {}
                tag if sections[..i].iter().any(|s| s.tag == tag) => {
                    let what = format!("section {} occurs twice", name(tag));
                    return Err(broken(ids::SECTION_MISSING, section.offset, what));
                }
                TAG_META => {
                    meta = String::from_utf8_lossy(slice(section)).into_owned();
                    origin.meta = section.offset;
                }
                tag if section.flags & SECTION_REQUIRED != 0 => {
                    let what = format!("section {} is required and not known to this reader", name(tag));
                    return Err(broken(ids::SECTION_REQUIRED, section.offset, what));
                }
                tag => unknown.push(UnknownSection { tag, flags: section.flags, bytes: slice(section).to_vec() }),
            }
        }
        Ok(Self { objects, blocks, meta, unknown, image: (data.offset as usize, data.length as usize), origin, ranges })
    }
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

fn read_header(bytes: &[u8]) -> Result<Header, FormatError> {
    if !bytes.starts_with(&IDENTIFIER) {
        let what = if bytes.starts_with(b"\xABESVO") {
            "the identifier is damaged: the file went through a text-mode transfer, or is of another major version"
        } else {
            "not an esvo file: the identifier is missing"
        };
        return Err(broken(ids::IDENTIFIER, 0, what.into()));
    }
    let header: Header = from_bytes(bytes)
        .ok_or_else(|| broken(ids::IDENTIFIER, 0, format!("{} bytes are too short for a header", bytes.len())))?;
    if header.major != MAJOR_VERSION {
        let what = format!("version {}.{}: this reader knows major version 1", header.major, header.minor);
        return Err(broken(ids::MAJOR_VERSION, 12, what));
    }
    if crc32fast::hash(&bytes[..HEADER_BYTES as usize - 4]) != header.header_crc {
        return Err(broken(ids::HEADER_CHECKSUM, 60, "the header is damaged".into()));
    }
    if header.required_features & !KNOWN_REQUIRED != 0 {
        let what = format!("required feature bits {:#x} are not known to this reader", header.required_features);
        return Err(broken(ids::REQUIRED_FEATURES, 16, what));
    }
    if header.file_length != bytes.len() as u64 {
        let what = format!("{} bytes, but the header says {}: truncated?", bytes.len(), header.file_length);
        return Err(broken(ids::FILE_LENGTH, 32, what));
    }
    if header.reserved != 0 {
        return Err(broken(ids::HEADER_RESERVED, 56, "reserved bytes are not zero".into()));
    }
    Ok(header)
}

struct Directory {
    sections: Vec<SectionEntry>,
    /// Start and end of header, directory and sections in the file, in order.
    ranges: Vec<(u64, u64)>,
}

fn read_directory(bytes: &[u8], header: &Header) -> Result<Directory, FormatError> {
    let at = header.directory_offset;
    let length = u64::from(header.directory_count) * SECTION_BYTES;
    let end =
        at.checked_add(length).filter(|end| *end <= header.file_length && at.is_multiple_of(8) && at >= HEADER_BYTES);
    let Some(end) = end else {
        return Err(broken(ids::DIRECTORY_RANGE, 40, format!("directory at {at} with {length} bytes")));
    };
    if header.directory_count > MAX_SECTIONS {
        return Err(broken(ids::DIRECTORY_LIMIT, 48, format!("{} sections", header.directory_count)));
    }
    let directory = &bytes[at as usize..end as usize];
    if crc32fast::hash(directory) != header.directory_crc {
        return Err(broken(ids::DIRECTORY_CHECKSUM, at, "the directory is damaged".into()));
    }
    let sections: Vec<SectionEntry> = entries(directory, SECTION_BYTES).unwrap_or_default();
    let mut ranges = vec![(0, HEADER_BYTES), (at, end)];
    for (i, section) in sections.iter().enumerate() {
        let entry_at = at + i as u64 * SECTION_BYTES;
        let tag = name(section.tag);
        let own = section.flags & SECTION_OWN_CHECKSUMS != 0;
        if section.flags & !(SECTION_REQUIRED | SECTION_OWN_CHECKSUMS) != 0 || section.reserved != 0 {
            return Err(broken(ids::SECTION_RESERVED, entry_at, format!("section {tag} has reserved bits set")));
        }
        let end = section.offset.checked_add(section.length).filter(|end| *end <= header.file_length);
        let Some(end) = end.filter(|_| section.offset % 8 == 0) else {
            let what = format!("section {tag} at {} with {} bytes", section.offset, section.length);
            return Err(broken(ids::SECTION_RANGE, entry_at, what));
        };
        if section.tag != TAG_DATA && section.length > MAX_SECTION {
            return Err(FormatError::Limit(format!(
                "section {tag} has {} bytes: more than this reader takes",
                section.length
            )));
        }
        ranges.push((section.offset, end));
        let crc = if own { 0 } else { crc32fast::hash(&bytes[section.offset as usize..end as usize]) };
        if crc != section.crc {
            return Err(broken(ids::SECTION_CHECKSUM, section.offset, format!("section {tag} is damaged")));
        }
    }
    ranges.sort_unstable();
    if let Some(pair) = ranges.windows(2).find(|pair| pair[0].1 > pair[1].0) {
        let what = format!("something else lies at {} already", pair[1].0);
        return Err(broken(ids::SECTION_RANGE, pair[1].0, what));
    }
    Ok(Directory { sections, ranges })
}
