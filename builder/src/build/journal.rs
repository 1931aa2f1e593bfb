//! The finished parts of a build, kept next to its output so that the build can continue after an interruption.
//!
//! A folder with two files: `blocks` holds the packed blocks one after the other, and `journal` a list of records, each
//! preceded by its length and CRC-32. A record that was not written completely ends the list; the part it describes is
//! built again.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use esvo_format::{BlockStore, BlockSummary, Tree};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::subtrees::Finished as FinishedPart;
use crate::surface::attributes::Mean;
use crate::{BuildError, BuildSettings, DisplaceOptions, Mesh};

/// The files in the folder: first the journal, second the blocks.
const FILES: [&str; 2] = ["journal", "blocks"];

/// Stands for what the builder makes of a mesh and its settings, and how parts are kept. Raise it with every change of either: a build must not
/// go on from parts that an older builder would finish in another way.
pub(super) const RESULTS: u32 = 6;

/// Bytes of the first record with its length and CRC-32.
const FIRST_RECORD: usize = 12 + 1 + 32;

/// A record of the journal. The first is `Build`; any number of the others follow.
#[derive(Serialize, Deserialize)]
enum Record {
    /// Hash of the mesh, the settings and the version of the builder.
    Build([u8; 32]),
    /// The blocks that were added to the store since the previous such record.
    Blocks(Vec<BlockSummary>),
    /// Finished sibling cubes: the path from the root to the first of them, and what was made of them.
    Cubes(u32, Box<Finished>),
    /// A finished subtree of a displaced mesh: the number of its path, and the subtree.
    Part(u32, Box<FinishedPart>),
}

/// What was made of one or two sibling cubes.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Finished {
    /// The part of their subtrees that is not in blocks.
    pub tree: Tree,
    /// The means of their attributes; `None` for a cube without surface.
    pub means: [Option<Mean>; 2],
    /// Their number of voxels.
    pub voxels: u64,
}

pub(crate) struct Journal {
    folder: PathBuf,
    /// Voxels of the cubes that an earlier build had finished.
    resumed: u64,
    /// Cubes that an earlier build had finished and that have not been taken yet.
    finished: Mutex<HashMap<u32, Finished>>,
    /// The same for subtrees of a displaced mesh.
    finished_parts: Mutex<HashMap<u32, FinishedPart>>,
    writer: Mutex<Writer>,
}

struct Writer {
    file: File,
    /// Number of blocks that the journal lists.
    blocks: usize,
}

impl Journal {
    /// Opens or creates the folder of the build whose output is `path`, and the store of its blocks. With `displaced`, the mesh
    /// is displaced while it is built.
    pub(crate) fn open(
        path: &Path,
        mesh: &Mesh,
        displaced: Option<&DisplaceOptions>,
        settings: &BuildSettings,
    ) -> Result<(Self, BlockStore), BuildError> {
        Self::open_as(path, fingerprint(mesh, displaced, settings, RESULTS))
    }

    /// As [`open`](Self::open), of a build with this hash.
    pub(super) fn open_as(path: &Path, build: [u8; 32]) -> Result<(Self, BlockStore), BuildError> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let folder = path.with_file_name(name);
        let io = |e| BuildError::io(&folder, e);
        std::fs::create_dir_all(&folder).map_err(io)?;
        let open =
            |name| OpenOptions::new().read(true).write(true).create(true).truncate(false).open(folder.join(name));
        let mut file = open(FILES[0]).map_err(io)?;
        file.try_lock().map_err(|_| BuildError::Busy(folder.clone()))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(io)?;
        let first = Records { bytes: &bytes, at: 0 }.next();
        // A build that was stopped while it wrote its first record leaves a piece of it and no blocks.
        let begun = bytes.len() < FIRST_RECORD && folder.join(FILES[1]).metadata().map_or(0, |m| m.len()) == 0;
        if !matches!(first, Some((Record::Build(other), _)) if other == build) && !begun {
            return Err(BuildError::OtherWork(folder));
        }
        let blocks = open(FILES[1]).map_err(io)?;
        let (mut summaries, mut finished, mut parts) = (Vec::new(), HashMap::new(), HashMap::new());
        let mut end = 0;
        let mut same = false;
        for (record, at) in (Records { bytes: &bytes, at: 0 }) {
            match record {
                Record::Build(other) => same = other == build,
                Record::Blocks(blocks) => summaries.extend(blocks),
                Record::Cubes(path, cubes) => drop(finished.insert(path, *cubes)),
                Record::Part(path, part) => drop(parts.insert(path, *part)),
            }
            if !same {
                break;
            }
            end = at;
        }
        let stored = blocks.metadata().map_err(io)?.len();
        if !same || summaries.iter().any(|s: &BlockSummary| s.end() > stored) {
            (summaries, end, same) = (Vec::new(), 0, false);
            finished.clear();
            parts.clear();
        }
        file.set_len(end as u64).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        let voxels = finished.values().map(|cubes: &Finished| &cubes.voxels);
        let resumed = voxels.chain(parts.values().map(|part: &FinishedPart| &part.voxels)).sum();
        let mut writer = Writer { file, blocks: summaries.len() };
        if !same {
            writer.put(&Record::Build(build)).map_err(io)?;
        }
        let store = BlockStore::in_file(blocks, summaries);
        store.check().map_err(|source| BuildError::Part { folder: folder.clone(), source })?;
        let (finished, finished_parts) = (Mutex::new(finished), Mutex::new(parts));
        Ok((Self { folder, resumed, finished, finished_parts, writer: Mutex::new(writer) }, store))
    }

    /// Voxels of the finished parts of an earlier build that were found.
    pub(crate) fn resumed(&self) -> u64 {
        self.resumed
    }

    /// Takes the cubes whose first has this path if an earlier build had finished them. Returns them only once.
    pub(super) fn finished(&self, path: u32) -> Option<Finished> {
        self.finished.lock().unwrap_or_else(PoisonError::into_inner).remove(&path)
    }

    /// Records that cubes are finished, the first of them with this path. Their blocks must be in the store already.
    pub(super) fn finish(&self, path: u32, cubes: &Finished, store: &BlockStore) -> Result<(), BuildError> {
        self.put(&Record::Cubes(path, Box::new(cubes.clone())), store)
    }

    /// As [`finished`](Self::finished), of a subtree of a displaced mesh.
    pub(super) fn finished_part(&self, path: u32) -> Option<FinishedPart> {
        self.finished_parts.lock().unwrap_or_else(PoisonError::into_inner).remove(&path)
    }

    /// As [`finish`](Self::finish), of a subtree of a displaced mesh.
    pub(super) fn finish_part(&self, path: u32, part: &FinishedPart, store: &BlockStore) -> Result<(), BuildError> {
        self.put(&Record::Part(path, Box::new(part.clone())), store)
    }

    /// The two files of the folder, the journal first.
    pub(super) fn files(&self) -> Result<[File; 2], BuildError> {
        let open = |name| File::open(self.folder.join(name)).map_err(|e| BuildError::io(&self.folder, e));
        Ok([open(FILES[0])?, open(FILES[1])?])
    }

    /// Writes a record after that of the blocks that it needs.
    fn put(&self, record: &Record, store: &BlockStore) -> Result<(), BuildError> {
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        let blocks = store.summaries_from(writer.blocks);
        writer.blocks += blocks.len();
        let blocks = Record::Blocks(blocks);
        writer.put(&blocks).and_then(|()| writer.put(record)).map_err(|e| BuildError::io(&self.folder, e))
    }

    /// Removes the two files when the output is complete, and the folder if it contains nothing else.
    pub(crate) fn remove(self) -> Result<(), BuildError> {
        let Self { folder, writer, .. } = self;
        drop(writer);
        for name in FILES {
            std::fs::remove_file(folder.join(name)).map_err(|e| BuildError::io(&folder, e))?;
        }
        // Fails if the folder is not empty: it then contains files that are not ours.
        let _ = std::fs::remove_dir(&folder);
        Ok(())
    }
}

impl Writer {
    fn put(&mut self, record: &Record) -> std::io::Result<()> {
        let bytes = postcard::to_stdvec(record).map_err(std::io::Error::other)?;
        let mut framed = Vec::with_capacity(bytes.len() + 12);
        framed.extend((bytes.len() as u64).to_le_bytes());
        framed.extend(crc32fast::hash(&bytes).to_le_bytes());
        framed.extend(bytes);
        self.file.write_all(&framed)
    }
}

/// The complete records of a journal, each with the offset of its end.
struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Iterator for Records<'_> {
    type Item = (Record, usize);

    fn next(&mut self) -> Option<Self::Item> {
        let (length, rest) = self.bytes.get(self.at..)?.split_first_chunk::<8>()?;
        let (crc, rest) = rest.split_first_chunk::<4>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let record = rest.get(..length)?;
        if crc32fast::hash(record) != u32::from_le_bytes(*crc) {
            return None;
        }
        self.at += 12 + length;
        Some((postcard::from_bytes(record).ok()?, self.at))
    }
}

/// Where things are in a journal, for a reader that has no room for all of it.
pub(super) struct Index {
    /// All blocks, in the order of their numbers.
    pub blocks: Vec<BlockSummary>,
    /// By the path of their first: where the records of finished cubes begin, and their sizes.
    pub cubes: HashMap<u32, (u64, u32)>,
    /// Where the last complete record ends.
    pub end: u64,
}

impl Index {
    /// Reads a journal record by record.
    pub(super) fn read(journal: &mut dyn Read) -> std::io::Result<Self> {
        let mut index = Self { blocks: Vec::new(), cubes: HashMap::new(), end: 0 };
        let mut bytes = Vec::new();
        loop {
            let mut head = [0; 12];
            bytes.clear();
            journal.take(12).read_to_end(&mut bytes)?;
            if bytes.len() < 12 {
                return Ok(index);
            }
            head.copy_from_slice(&bytes);
            let [a, b, c, d, e, f, g, h, ..] = head;
            let length = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
            bytes.clear();
            // Takes no more memory than there are bytes.
            let read = journal.take(length).read_to_end(&mut bytes)? as u64;
            let (Ok(size), true) = (u32::try_from(length), read == length) else { return Ok(index) };
            if crc32fast::hash(&bytes).to_le_bytes() != head[8..] {
                return Ok(index);
            }
            match postcard::from_bytes(&bytes) {
                Ok(Record::Blocks(blocks)) => index.blocks.extend(blocks),
                Ok(Record::Cubes(path, _)) => drop(index.cubes.insert(path, (index.end + 12, size))),
                Ok(Record::Build(_) | Record::Part(..)) => {}
                Err(_) => return Ok(index),
            }
            index.end += 12 + length;
        }
    }
}

/// The finished cubes of a record.
pub(super) fn cubes(record: &[u8]) -> Option<Finished> {
    match postcard::from_bytes(record) {
        Ok(Record::Cubes(_, finished)) => Some(*finished),
        _ => None,
    }
}

/// Hash of everything that the result of a build depends on. `results` is [`RESULTS`].
pub(super) fn fingerprint(
    mesh: &Mesh,
    displaced: Option<&DisplaceOptions>,
    settings: &BuildSettings,
    results: u32,
) -> [u8; 32] {
    let mut hash = Sha256::new();
    let mut part = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    part(format!("{} {results}", env!("CARGO_PKG_VERSION")).as_bytes());
    part(format!("{settings:?}").as_bytes());
    part(bytemuck::cast_slice(&mesh.positions));
    part(bytemuck::cast_slice(&mesh.normals));
    part(bytemuck::cast_slice(&mesh.uvs));
    part(bytemuck::cast_slice(&mesh.colors));
    part(bytemuck::cast_slice(&mesh.tangents));
    part(bytemuck::cast_slice(&mesh.triangles));
    part(bytemuck::cast_slice(&mesh.triangle_materials));
    for material in &mesh.materials {
        part(format!("{:?} {:?}", material.base_color, material.alpha_cutoff).as_bytes());
        if let Some(texture) = &material.texture {
            part(format!("{:?}", texture.wrap).as_bytes());
            part(bytemuck::cast_slice(&texture.mips[0].texels));
        }
        if let Some(map) = &material.normal_map {
            part(format!("{} {:?} {:?}", map.scale, map.uv_transform.rows, map.texture.wrap).as_bytes());
            part(bytemuck::cast_slice(&map.texture.mips[0].texels));
        }
        material.properties.visit_bytes(&mut part);
    }
    if let Some(options) = displaced {
        part(format!("{options:?}").as_bytes());
        for map in mesh.materials.iter().map(|material| &material.height_map) {
            let Some(map) = map else {
                part(&[]);
                continue;
            };
            let numbers = (map.amplitude, map.bias, map.uv_transform.rows, map.texture.wrap);
            part(format!("{numbers:?}").as_bytes());
            part(bytemuck::cast_slice(&map.texture.mips[0].texels));
        }
    }
    hash.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_builders_with_other_results_are_refused() {
        let (mesh, settings) = (Mesh::default(), BuildSettings::default());
        let files = tempfile::tempdir().unwrap();
        let output = files.path().join("a.esvo");
        std::fs::create_dir(files.path().join("a.esvo.part")).unwrap();
        for (results, same) in [(RESULTS - 1, false), (RESULTS, true)] {
            let file = File::create(files.path().join("a.esvo.part/journal")).unwrap();
            let mut writer = Writer { file, blocks: 0 };
            writer.put(&Record::Build(fingerprint(&mesh, None, &settings, results))).unwrap();
            let opened = Journal::open(&output, &mesh, None, &settings);
            assert_eq!(opened.is_ok(), same);
            assert!(same || matches!(opened, Err(BuildError::OtherWork(_))));
        }
    }
}
