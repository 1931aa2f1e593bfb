//! The container: a file of clusters of equal size; a chunk is a chain of clusters.
//!
//! ```text
//! cluster 0..      master chunk: "Clusters", version 2, number of clusters, bytes per cluster, number of chunks,
//!                  default compression; for each chunk {group, id, first cluster, compression, stored size, size};
//!                  for each cluster the next cluster of its chain
//! other clusters   the chunks
//! ```

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::fault;
use crate::FormatError;

const IDENTIFIER: &[u8; 8] = b"Clusters";
const VERSION: u32 = 2;
/// Words of the master chunk before its tables.
const HEADER_WORDS: u64 = 7;
/// Words per chunk in the table of the master chunk.
const CHUNK_WORDS: u64 = 6;
/// Marks the last cluster of a chain in place of the next cluster.
const LAST: u32 = 0x7fff_ffff;
/// Bytes per cluster in files written by this library; the authors' default.
const CLUSTER_BYTES: usize = 4096;

/// Group and number of a chunk.
pub(super) type ChunkId = (u32, u32);
/// The chunk that lists the objects.
pub(super) const OCTREE_CHUNK: ChunkId = (1, 0);
/// Group of the slices.
pub(super) const SLICES: u32 = 2;
/// Group of the meshes that octrees are built from.
pub(super) const MESHES: u32 = 3;

#[derive(Clone, Copy)]
struct Chunk {
    first: u32,
    compression: u32,
    stored: u32,
    size: u32,
}

/// A file that is being read. Every chunk can be read only once.
pub(super) struct Clusters<R> {
    source: R,
    path: PathBuf,
    cluster_bytes: u64,
    chunks: BTreeMap<ChunkId, Chunk>,
    next: Vec<u32>,
    taken: Vec<bool>,
}

impl<R: Read + Seek> Clusters<R> {
    /// Reads the master chunk. `path` is used in messages only.
    pub(super) fn open(mut source: R, path: &Path) -> Result<Self, FormatError> {
        let io = |e| FormatError::io(path, e);
        let length = source.seek(SeekFrom::End(0)).map_err(io)?;
        source.seek(SeekFrom::Start(0)).map_err(io)?;
        let short = |what: &str| fault("start", format!("the file has {length} bytes, too few for {what}"));
        if length < HEADER_WORDS * 4 {
            return Err(short("a header"));
        }
        let mut header = [0; HEADER_WORDS as usize * 4];
        source.read_exact(&mut header).map_err(io)?;
        if !header.starts_with(IDENTIFIER) {
            return Err(fault("start", "not an .oct file: it does not begin with \"Clusters\""));
        }
        let header = words(&header);
        let [version, clusters, cluster_bytes, chunk_count] = [2, 3, 4, 5].map(|i| header[i]);
        if version != VERSION {
            return Err(fault("start", format!("the container has version {version}, expected {VERSION}")));
        }
        let table_words = u64::from(chunk_count) * CHUNK_WORDS + u64::from(clusters);
        let master = (HEADER_WORDS + table_words) * 4;
        if !(64..=1 << 30).contains(&cluster_bytes) {
            return Err(fault("start", format!("clusters have {cluster_bytes} bytes, expected 64 to 2^30")));
        }
        if u64::from(clusters) * u64::from(cluster_bytes) > length || master > length {
            return Err(short(&format!("{chunk_count} chunks in {clusters} clusters of {cluster_bytes} bytes")));
        }
        let mut table = vec![0; table_words as usize * 4];
        source.read_exact(&mut table).map_err(io)?;
        let table = words(&table);
        let (entries, next) = table.split_at((u64::from(chunk_count) * CHUNK_WORDS) as usize);
        let mut chunks = BTreeMap::new();
        for entry in entries.chunks_exact(CHUNK_WORDS as usize) {
            let chunk = Chunk { first: entry[2], compression: entry[3], stored: entry[4], size: entry[5] };
            if chunks.insert((entry[0], entry[1]), chunk).is_some() {
                return Err(fault("master chunk", format!("chunk {} of group {} occurs twice", entry[1], entry[0])));
            }
        }
        let taken = vec![false; clusters as usize];
        let cluster_bytes = u64::from(cluster_bytes);
        Ok(Self { source, path: path.to_owned(), cluster_bytes, chunks, next: next.to_vec(), taken })
    }

    /// Number of chunks of a group that have not been read.
    pub(super) fn left(&self, group: u32) -> usize {
        self.chunks.keys().filter(|id| id.0 == group).count()
    }

    /// Reads the words of a chunk, the last padded with zeros, and removes the chunk from the list.
    pub(super) fn take(&mut self, id: ChunkId) -> Result<Vec<u32>, FormatError> {
        let place = || format!("chunk {} of group {}", id.1, id.0);
        let chunk = self.chunks.remove(&id).ok_or_else(|| fault(place(), "it is not in the file, or used twice"))?;
        if chunk.compression != 0 {
            return Err(fault(place(), "it is compressed, expected uncompressed: save the file without compression"));
        }
        if chunk.stored != chunk.size {
            return Err(fault(place(), format!("the stored size is {} bytes, expected {}", chunk.stored, chunk.size)));
        }
        // Follow the chain before allocating anything. A cluster must be in only one chain.
        let mut left = u64::from(chunk.size);
        let mut runs: Vec<(u64, u64)> = Vec::new();
        let mut cluster = chunk.first;
        while left > 0 {
            match self.taken.get_mut(cluster as usize) {
                Some(taken) if !*taken => *taken = true,
                Some(_) => return Err(fault(place(), format!("cluster {cluster} is used twice"))),
                None => {
                    return Err(fault(
                        place(),
                        format!("its chain has cluster {cluster}, the file has {} clusters", self.next.len()),
                    ));
                }
            }
            let (at, bytes) = (u64::from(cluster) * self.cluster_bytes, left.min(self.cluster_bytes));
            match runs.last_mut() {
                Some((start, length)) if *start + *length == at => *length += bytes,
                _ => runs.push((at, bytes)),
            }
            left -= bytes;
            cluster = self.next[cluster as usize];
            if left > 0 && cluster >= LAST {
                return Err(fault(place(), format!("its chain ends {left} bytes early")));
            }
        }
        let mut bytes = vec![0; (chunk.size as usize).next_multiple_of(4)];
        let mut rest = &mut bytes[..chunk.size as usize];
        for (start, length) in runs {
            let (now, later) = rest.split_at_mut(length as usize);
            self.source.seek(SeekFrom::Start(start)).map_err(|e| FormatError::io(&self.path, e))?;
            self.source.read_exact(now).map_err(|e| FormatError::io(&self.path, e))?;
            rest = later;
        }
        Ok(words(&bytes))
    }
}

/// Little-endian words.
fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// A file that is being assembled in memory.
#[derive(Default)]
pub(super) struct NewFile {
    chunks: BTreeMap<ChunkId, Vec<u32>>,
}

impl NewFile {
    /// Adds or replaces a chunk.
    pub(super) fn put(&mut self, id: ChunkId, words: Vec<u32>) {
        self.chunks.insert(id, words);
    }

    /// Checks that the numbers of clusters and of bytes per chunk fit the format.
    pub(super) fn check(&self) -> Result<(), FormatError> {
        let chunk = self.chunks.values().map(|words| words.len() as u64 * 4).max().unwrap_or(0);
        let clusters = self.layout().1;
        if chunk > i32::MAX as u64 || clusters >= u64::from(LAST) {
            return Err(FormatError::Limit(format!(
                "the .oct file has {clusters} clusters and a chunk of {chunk} bytes, expected less than 2^31 of both"
            )));
        }
        Ok(())
    }

    /// Size of the master chunk in bytes, and total number of clusters.
    fn layout(&self) -> (u64, u64) {
        let needs = |bytes: u64| bytes.div_ceil(CLUSTER_BYTES as u64).max(1);
        let others: u64 = self.chunks.values().map(|words| needs(words.len() as u64 * 4)).sum();
        let master = |clusters: u64| (HEADER_WORDS + CHUNK_WORDS * (self.chunks.len() as u64 + 1) + clusters) * 4;
        // The table of the clusters is in clusters too, so iterate until it fits.
        let mut clusters = others + 1;
        while others + needs(master(clusters)) > clusters {
            clusters = others + needs(master(clusters));
        }
        (master(clusters), clusters)
    }

    /// Writes the file.
    pub(super) fn write_to(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let (master_bytes, clusters) = self.layout();
        let mut master = vec![0; HEADER_WORDS as usize];
        bytemuck::cast_slice_mut::<u32, u8>(&mut master)[..8].copy_from_slice(IDENTIFIER);
        master[2..6].copy_from_slice(&[VERSION, clusters as u32, CLUSTER_BYTES as u32, self.chunks.len() as u32 + 1]);
        let mut chain = Vec::new();
        let mut place = |id: ChunkId, bytes: u64, count: u64| {
            let first = chain.len() as u32;
            chain.extend((1..count as u32).map(|i| first + i));
            chain.push(LAST);
            [id.0, id.1, first, 0, bytes as u32, bytes as u32]
        };
        let own =
            clusters - self.chunks.values().map(|w| (w.len() * 4).div_ceil(CLUSTER_BYTES).max(1) as u64).sum::<u64>();
        master.extend(place((0, 0), master_bytes, own));
        for (id, words) in &self.chunks {
            let bytes = words.len() as u64 * 4;
            master.extend(place(*id, bytes, bytes.div_ceil(CLUSTER_BYTES as u64).max(1)));
        }
        master.extend(chain);
        let mut put = |words: &[u32], clusters: usize| -> std::io::Result<()> {
            out.write_all(bytemuck::cast_slice(words))?;
            out.write_all(&vec![0; clusters * CLUSTER_BYTES - words.len() * 4])
        };
        put(&master, own as usize)?;
        for words in self.chunks.values() {
            put(words, (words.len() * 4).div_ceil(CLUSTER_BYTES).max(1))?;
        }
        Ok(())
    }
}
