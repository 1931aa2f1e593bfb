//! Part files: what was built of some cubes of an octree, to be joined with the others.
//!
//! A file begins with [`MAGIC`], the length and CRC-32 of the header, and the header. Then come the length of the journal and the journal
//! (`journal.rs`: each record has a checksum), and the blocks, whose checksums are in the journal, to the end of the file. The layout is
//! that of one version of the builder: parts are joined by the version that built them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use esvo_format::{AssembleOptions, BlockSummary, Column, write_atomically};
use serde::{Deserialize, Serialize};

use super::journal::{Finished, Index, RESULTS};
use super::share::Top;
use crate::{BuildError, BuildSettings};

const MAGIC: [u8; 16] = *b"esvo build part\n";
/// Largest header that is read: the nodes above the cubes, and the metadata.
const MOST_HEADER: u64 = 64 << 20;

/// What a part says of its build, and of itself.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Header {
    /// Raised with every change of what parts hold.
    results: u32,
    /// Hash of the mesh, the settings and the version of the builder.
    pub build: [u8; 32],
    /// The part's number, from 1, and the number of parts.
    pub part: u32,
    pub parts: u32,
    pub octree_to_mesh: [f64; 16],
    pub meta: String,
    pub settings: BuildSettings,
    /// `block_slots` and `near_limit` of the settings, which leave them out.
    assemble: [u32; 2],
    /// Columns of the components, without values.
    pub columns: Vec<Column>,
    /// Number of voxels in the part.
    pub voxels: u64,
    /// The part of each cube of level 4 with surface, by its path.
    pub owners: BTreeMap<u32, u32>,
    /// The nodes above these cubes.
    pub tops: BTreeMap<u32, Top>,
}

impl Header {
    pub(super) fn new(settings: &BuildSettings, build: [u8; 32], (part, parts): (u32, u32)) -> Self {
        let AssembleOptions { block_slots, near_limit } = settings.assemble;
        Self {
            results: RESULTS,
            build,
            part,
            parts,
            octree_to_mesh: [0.0; 16],
            meta: String::new(),
            settings: *settings,
            assemble: [block_slots, near_limit],
            columns: Vec::new(),
            voxels: 0,
            owners: BTreeMap::new(),
            tops: BTreeMap::new(),
        }
    }

    /// The bytes of what all parts of a build share.
    pub(super) fn shared(&self) -> Vec<u8> {
        let shared = (&self.octree_to_mesh, &self.meta, &self.owners, &self.tops, &self.columns);
        // Nothing of it can fail to be encoded.
        postcard::to_stdvec(&shared).unwrap_or_default()
    }
}

/// Writes a part file of the two files of a journal.
pub(super) fn write(path: &Path, header: &Header, journal: &mut File, blocks: &mut File) -> Result<(), BuildError> {
    let header = postcard::to_stdvec(header).map_err(|e| BuildError::io(path, io::Error::other(e)))?;
    write_atomically(path, |out| {
        out.write_all(&MAGIC)?;
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(&crc32fast::hash(&header).to_le_bytes())?;
        out.write_all(&header)?;
        let length = journal.seek(SeekFrom::End(0))?;
        out.write_all(&length.to_le_bytes())?;
        for file in [journal, blocks] {
            file.seek(SeekFrom::Start(0))?;
            io::copy(file, out)?;
        }
        Ok(())
    })
    .map_err(|e| BuildError::io(path, e))
}

/// Whether a file begins as part files do.
pub(super) fn is_part(path: &Path) -> io::Result<bool> {
    let mut start = [0; MAGIC.len()];
    let read = File::open(path)?.read(&mut start)?;
    Ok(read == MAGIC.len() && start == MAGIC)
}

/// A part file that was opened.
pub(super) struct PartFile {
    pub path: PathBuf,
    pub file: File,
    pub header: Header,
    /// Where the journal begins.
    journal: u64,
    index: Index,
    /// Where the blocks begin.
    pub blocks: u64,
}

impl PartFile {
    /// Opens a part, and checks all of it but the bytes of the blocks.
    pub(super) fn open(path: &Path) -> Result<Self, BuildError> {
        let io = |e| BuildError::io(path, e);
        let bad = |what: &str| BuildError::PartFile { path: path.to_owned(), what: what.into() };
        let cut = "is cut off or damaged; build this part again";
        let mut file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut start = [0; 28];
        if length < 36 {
            return Err(bad("is no part of a build: esvo build --part makes them"));
        }
        file.read_exact(&mut start).map_err(io)?;
        if start[..16] != MAGIC {
            return Err(bad("is no part of a build: esvo build --part makes them"));
        }
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
        let (header_length, crc) = (number(&start[16..24]), number(&start[24..28]) as u32);
        if header_length > MOST_HEADER || header_length > length - 36 {
            return Err(bad(cut));
        }
        let mut header = vec![0; header_length as usize];
        file.read_exact(&mut header).map_err(io)?;
        if crc32fast::hash(&header) != crc {
            return Err(bad(cut));
        }
        // The number of results is first, whatever follows it.
        let results = postcard::take_from_bytes::<u32>(&header).map(|(results, _)| results);
        if results != Ok(RESULTS) {
            return Err(bad("was built by another version of esvo; join parts with the version that built them"));
        }
        let mut header: Header = postcard::from_bytes(&header).map_err(|_| bad(cut))?;
        let [block_slots, near_limit] = header.assemble;
        header.settings.assemble = AssembleOptions { block_slots, near_limit };
        let mut bytes = [0; 8];
        file.read_exact(&mut bytes).map_err(io)?;
        let (journal, journal_length) = (36 + header_length, u64::from_le_bytes(bytes));
        if journal_length > length - journal {
            return Err(bad(cut));
        }
        let index = Index::read(&mut (&file).take(journal_length)).map_err(io)?;
        let blocks = journal + journal_length;
        let end = index.blocks.iter().map(BlockSummary::end).max().unwrap_or(0);
        if index.end != journal_length || end != length - blocks {
            return Err(bad(cut));
        }
        Ok(Self { path: path.to_owned(), file, header, journal, index, blocks })
    }

    /// The summaries of its blocks.
    pub(super) fn take_summaries(&mut self) -> Vec<BlockSummary> {
        std::mem::take(&mut self.index.blocks)
    }

    /// What was made of the cubes whose first has this path.
    pub(super) fn finished(&self, path: u32) -> Result<Option<Finished>, BuildError> {
        let Some(&(at, size)) = self.index.cubes.get(&path) else { return Ok(None) };
        let mut record = vec![0; size as usize];
        let mut file = &self.file;
        let read = file.seek(SeekFrom::Start(self.journal + at)).and_then(|_| file.read_exact(&mut record));
        read.map_err(|e| BuildError::io(&self.path, e))?;
        super::journal::cubes(&record).map(Some).ok_or_else(|| BuildError::PartFile {
            path: self.path.clone(),
            what: "has changed while it was read; join the parts again".into(),
        })
    }
}
