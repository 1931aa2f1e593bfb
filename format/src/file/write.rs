//! Writing files, reproducibly and atomically (spec sections 2 and 11).

use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, TryLockError};

use rayon::prelude::*;

use crate::check::metadata;
use crate::file::compression;
use crate::file::extras::Extras;
use crate::file::hash::Hashing;
use crate::file::write_parts::{PartsFile, Waiting};
use crate::file::*;
use crate::parts::block::{StoredPart, encode_block};
use crate::{FormatError, Octree, ids};

/// How a file is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// Zstandard compression level of the blocks, 1 to 22 ([`COMPRESSION_LEVELS`](crate::COMPRESSION_LEVELS)). A block
    /// is stored uncompressed if compression would not save a page; a file without compressed blocks can be mapped.
    /// `None` (the default) stores all blocks uncompressed.
    pub compress: Option<i32>,
    /// Whether the blocks are stored in parts by level, as streams of fields (codec 2): the smallest files, and the ones of
    /// which a coarse version is read by few ranges. [`compress`](Self::compress) is the level of the streams then, 3 if
    /// `None`. Default: false.
    pub parts: bool,
    /// Whether the file gets a SHA-256 of all its bytes and an id of its octrees (spec 2.5), by which copies are compared and
    /// damage outside of all other checksums is found. An octree of a file that [has both](Octree::file_hash) gets them whatever this
    /// says, and keeps its id. Default: false.
    pub hash: bool,
}

impl WriteOptions {
    /// Level of the streams of parts.
    pub(crate) fn part_level(&self) -> i32 {
        self.compress.unwrap_or(3)
    }
}

impl Octree {
    /// Writes the file with uncompressed blocks. Writes to a temporary file in the same folder, then renames it: `path`
    /// is either untouched or complete.
    ///
    /// An octree that came from a file is [verified](Self::verified) first, as writing gives its blocks new checksums.
    ///
    /// # Errors
    /// The system's; the rule that the octree breaks; `path` exists and is not a regular file.
    pub fn write(&self, path: &Path) -> Result<(), FormatError> {
        self.write_with(path, &WriteOptions::default())
    }

    /// Like [`write`](Self::write), with options.
    ///
    /// # Errors
    /// The system's; the rule that the octree breaks; `path` exists and is not a regular file; a compression level outside 1 to 22, or any without the
    /// crate's feature `zstd`.
    pub fn write_with(&self, path: &Path, options: &WriteOptions) -> Result<(), FormatError> {
        self.verified()?;
        write_atomically(path, |out| self.write_to_with(out, options)).map_err(|e| FormatError::io(path, e))
    }

    /// Writes the file with uncompressed blocks to `out`. The same octree always gives the same bytes. An octree that came
    /// from a file is [verified](Self::verified) first.
    ///
    /// # Errors
    /// Those of `out`; an octree that breaks a rule: [`ErrorKind::InvalidData`], with the [`Broken`](crate::Broken) inside.
    pub fn write_to(&self, out: &mut dyn Write) -> std::io::Result<()> {
        self.write_to_with(out, &WriteOptions::default())
    }

    /// Like [`write_to`](Self::write_to), with options. Compressed bytes depend on the octree and the version of the
    /// Zstandard library, but not on the number of threads. All compressed blocks are held in memory until written.
    ///
    /// # Errors
    /// Those of [`write_to`](Self::write_to); a compression level outside 1 to 22, or any without the crate's feature
    /// `zstd`.
    pub fn write_to_with(&self, out: &mut dyn Write, options: &WriteOptions) -> std::io::Result<()> {
        self.verified().map_err(|broken| Error::new(ErrorKind::InvalidData, broken))?;
        if !self.meta.is_empty()
            && let Err((at, what)) = metadata::parse(self.meta.as_bytes())
        {
            let what = format!("the metadata breaks rule {}: {what}, at byte {at}", ids::META_JSON);
            return Err(Error::new(ErrorKind::InvalidInput, what));
        }
        let hash = options.hash || self.hash.is_some();
        let mut out = Hashing::new(out, hash);
        if options.parts {
            self.write_parts(&mut out, options.part_level(), hash)?;
        } else {
            self.write_blocks(&mut out, options.compress, hash)?;
        }
        out.finish(self.file_id())
    }

    fn write_blocks(&self, out: &mut dyn Write, compress: Option<i32>, hash: bool) -> std::io::Result<()> {
        let image: &[u8] = bytemuck::cast_slice(self.slots());
        let stored = self.blocks.par_iter().map(|block| {
            let image = &image[block.image_offset as usize..(block.image_offset + block.image_size) as usize];
            let (codec, bytes) = compression::encode(image, compress)?;
            let crc = crc32fast::hash(&bytes);
            Ok((codec, crc, bytes))
        });
        let stored: Vec<(u32, u32, Cow<[u8]>)> = stored.collect::<std::io::Result<_>>()?;
        let front = Front { objects: &self.objects, extras: Extras::of(self, hash) };
        let mut file_offset = front.length(self.blocks.len());
        let blocks: Vec<BlockEntry> = (self.blocks.iter().zip(&stored))
            .map(|(block, (codec, crc, bytes))| {
                let stored_size = bytes.len() as u64;
                let entry = BlockEntry { file_offset, stored_size, codec: *codec, crc: *crc, ..*block };
                file_offset += stored_size.next_multiple_of(PAGE_BYTES);
                entry
            })
            .collect();
        out.write_all(&front.bytes(&blocks))?;
        for (_, _, bytes) in &stored {
            out.write_all(bytes)?;
            out.write_all(padding(bytes.len()))?;
        }
        Ok(())
    }
}

impl Octree {
    fn write_parts(&self, out: &mut dyn Write, level: i32, hash: bool) -> std::io::Result<()> {
        let stored = (0..self.blocks.len()).into_par_iter().map(|index| {
            let block = &self.blocks[index];
            let image = &self.slots()[(block.image_offset / 8) as usize..][..(block.image_size / 8) as usize];
            encode_block(&self.blocks, index as u32, image, &self.parts[index].within(), level)
        });
        let stored: Vec<(u32, Vec<StoredPart>)> = stored.collect::<std::io::Result<_>>()?;
        let parts: Vec<(u32, &StoredPart)> =
            stored.iter().flat_map(|(codec, parts)| parts.iter().map(|part| (*codec, part))).collect();
        let waiting = |&(codec, part): &(u32, &StoredPart)| Waiting { entry: part.entry, codec, crc: part.crc() };
        let waiting: Vec<Waiting> = parts.iter().map(waiting).collect();
        let file = PartsFile { objects: &self.objects, blocks: self.blocks.clone(), extras: Extras::of(self, hash) };
        let laid = file.lay_out(&waiting)?;
        out.write_all(&laid.head)?;
        for part in laid.order {
            let bytes = &parts[part as usize].1.bytes;
            out.write_all(bytes)?;
            out.write_all(&[0; 8][..bytes.len().next_multiple_of(8) - bytes.len()])?;
        }
        out.write_all(&laid.tail)
    }
}

/// The zeros that pad `length` bytes to whole pages.
pub(crate) fn padding(length: usize) -> &'static [u8] {
    const ZEROS: [u8; PAGE_BYTES as usize] = [0; PAGE_BYTES as usize];
    &ZEROS[..length.next_multiple_of(PAGE_BYTES as usize) - length]
}

/// A section before the blocks, and its bytes.
type FrontSection<'a> = (SectionEntry, Cow<'a, [u8]>);

/// The part of a file before the blocks: header, directory, tables, metadata, instances, unknown sections.
pub(crate) struct Front<'a> {
    pub(crate) objects: &'a [ObjectEntry],
    pub(crate) extras: Extras<'a>,
}

impl Front<'_> {
    /// The sections in file order with their bytes (none yet for the tables), and the offset of the first block.
    fn sections(&self, blocks: usize) -> (Vec<FrontSection<'_>>, u64) {
        let entry = |tag, flags, length: usize| SectionEntry {
            tag,
            flags,
            offset: 0,
            length: length as u64,
            crc: 0,
            reserved: 0,
        };
        let none = || Cow::Borrowed(&[][..]);
        let mut sections: Vec<FrontSection> = vec![
            (entry(TAG_OBJECTS, SECTION_REQUIRED, self.objects.len() * OBJECT_BYTES as usize), none()),
            (entry(TAG_BLOCKS, SECTION_REQUIRED, blocks * BLOCK_BYTES as usize), none()),
        ];
        for (tag, flags, bytes) in self.extras.sections() {
            sections.push((entry(tag, flags, bytes.len()), bytes));
        }
        // BLKS and HASH have entries too.
        let count = sections.len() as u64 + 1 + u64::from(self.extras.hash);
        let mut offset = HEADER_BYTES + count * SECTION_BYTES;
        for (section, _) in &mut sections {
            section.offset = offset;
            offset = (offset + section.length).next_multiple_of(8);
        }
        (sections, offset.next_multiple_of(PAGE_BYTES))
    }

    /// Length in bytes, which is the offset of the first block.
    pub(crate) fn length(&self, blocks: usize) -> u64 {
        self.sections(blocks).1
    }

    /// The bytes. The file offsets and checksums in `blocks` must be set.
    pub(crate) fn bytes(&self, blocks: &[BlockEntry]) -> Vec<u8> {
        let (mut sections, data_offset) = self.sections(blocks.len());
        let objects: Vec<u8> = self.objects.iter().flat_map(to_bytes).collect();
        let compressed = blocks.iter().any(|b| b.codec != CODEC_RAW);
        let data_end = blocks
            .iter()
            .map(|b| b.file_offset + b.stored_size.next_multiple_of(PAGE_BYTES))
            .fold(data_offset, u64::max);
        let blocks: Vec<u8> = blocks.iter().flat_map(to_bytes).collect();
        sections[0].1 = Cow::Owned(objects);
        sections[1].1 = Cow::Owned(blocks);
        let mut directory = Vec::new();
        for (section, bytes) in &mut sections {
            section.crc = if section.flags & SECTION_OWN_CHECKSUMS != 0 { 0 } else { crc32fast::hash(bytes) };
            directory.extend(to_bytes(section));
        }
        directory.extend(to_bytes(&SectionEntry {
            tag: TAG_DATA,
            flags: SECTION_REQUIRED | SECTION_OWN_CHECKSUMS,
            offset: data_offset,
            length: data_end - data_offset,
            crc: 0,
            reserved: 0,
        }));
        let (hash, file_length) = self.extras.hash_at(data_end);
        directory.extend(hash.iter().flat_map(to_bytes));
        let features = if compressed { FEATURE_COMPRESSED } else { 0 };
        let count = directory.len() as u64 / SECTION_BYTES;
        let header = header(features, file_length, count as u32, &directory, 0);
        let mut front = vec![0; data_offset as usize];
        let mut put = |at: u64, bytes: &[u8]| front[at as usize..at as usize + bytes.len()].copy_from_slice(bytes);
        put(0, &header);
        put(HEADER_BYTES, &directory);
        for (section, bytes) in &sections {
            put(section.offset, bytes);
        }
        front
    }
}

/// The bytes of a header with the directory directly after it. `head` is the length of the head.
pub(crate) fn header(required_features: u64, file_length: u64, count: u32, directory: &[u8], head: u32) -> Vec<u8> {
    let mut bytes = to_bytes(&Header {
        identifier: IDENTIFIER,
        major: MAJOR_VERSION,
        minor: MINOR_VERSION,
        required_features,
        optional_features: 0,
        file_length,
        directory_offset: HEADER_BYTES,
        directory_count: count,
        directory_crc: crc32fast::hash(directory),
        head,
        header_crc: 0,
    });
    let crc = crc32fast::hash(&bytes[..HEADER_BYTES as usize - 4]);
    bytes[HEADER_BYTES as usize - 4..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// Runs `write` on a temporary file in the folder of `path`, syncs it, and renames it to `path`.
///
/// If `path` is a symbolic link, its target is replaced, not the link. A process that is asked to stop meanwhile can
/// call [`remove_temporaries`].
///
/// # Errors
/// The system's; `path` exists and is read-only or not a regular file (devices and directories are never replaced); a
/// broken link.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    replace_file(path, |temporary| {
        let mut out = BufWriter::with_capacity(1 << 20, temporary);
        write(&mut out)?;
        out.flush()
    })
}

/// Like [`write_atomically`], but passes the temporary file itself.
pub(crate) fn replace_file(path: &Path, write: impl FnOnce(&File) -> std::io::Result<()>) -> std::io::Result<()> {
    let is_link = std::fs::symlink_metadata(path).is_ok_and(|m| m.is_symlink());
    let resolved = if is_link { path.canonicalize()? } else { path.to_owned() };
    let path = &*resolved;
    if let Ok(metadata) = std::fs::metadata(path) {
        if !metadata.is_file() {
            return Err(Error::other("exists and is not a regular file"));
        }
        if metadata.permissions().readonly() {
            return Err(Error::new(ErrorKind::PermissionDenied, "exists and is read-only"));
        }
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The default mode of new files; the umask applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.prefix(".esvo-").suffix(".tmp").tempfile_in(folder)?;
    let _listed = Listed::new(temporary.path());
    write(temporary.as_file())?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// The temporary files being written.
static TEMPORARIES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Keeps a temporary file in [`TEMPORARIES`] while it is written.
struct Listed(PathBuf);

impl Listed {
    fn new(path: &Path) -> Self {
        TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.0);
    }
}

/// Removes the unfinished temporary files of [`write_atomically`]. For a program that was asked to stop and will exit. It may
/// be called from a failed allocation: it needs no memory. While another thread adds or removes a file, it waits once, for 0.1
/// seconds; if the list is still locked then, it removes nothing, and all temporary files stay.
pub fn remove_temporaries() {
    let mut paths = match TEMPORARIES.try_lock() {
        Ok(paths) => paths,
        Err(TryLockError::Poisoned(paths)) => paths.into_inner(),
        Err(TryLockError::WouldBlock) => {
            // Another thread holds the list for a moment; if it is this thread, the list never comes.
            std::thread::sleep(std::time::Duration::from_millis(100));
            match TEMPORARIES.try_lock() {
                Ok(paths) => paths,
                Err(TryLockError::Poisoned(paths)) => paths.into_inner(),
                Err(TryLockError::WouldBlock) => return,
            }
        }
    };
    for path in paths.drain(..) {
        // The program is about to exit: a failure cannot be handled.
        let _ = std::fs::remove_file(path);
    }
}
