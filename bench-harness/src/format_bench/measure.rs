//! The measurements of the format.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::Path;
use std::time::Instant;

use esvo_format::{FormatError, Octree, RangeRead, Region, StreamReader, WriteOptions, validate_file};

use super::source::{Source, copies};
use super::{AccessRow, FormatBenchOptions, FormatReport, LargeFile, SCHEMA, StorageRow, Timed, ValidationRow};
use crate::system::machine::Machine;
use crate::system::proc::mapped_bytes;
use crate::system::scratch::Scratch;
use crate::{BenchError, Progress};

/// Bytes of a page of the page cache.
const PAGE: u64 = 4096;

/// Minimum number of runs for a figure.
const RUNS: usize = 5;

/// Deepest level that a viewer would load first.
const COARSE: u32 = 6;

/// Makes all measurements, on the calling thread.
pub(super) fn all(
    options: &FormatBenchOptions,
    sources: &[Source],
    progress: &Progress,
) -> Result<FormatReport, BenchError> {
    let machine = Machine::detect();
    let start = Instant::now();
    let first = &sources[0];
    let storage = storage(options, first, progress)?;
    let folder = Scratch::new()?;
    let mut validation = Vec::new();
    for source in sources {
        progress.say(format!("validating, {}", source.row.name));
        let path = folder.file("octree.esvo");
        source.octree.write(&path).map_err(BenchError::Format)?;
        validation.push(validate(options, &source.row.name, &path)?);
    }
    progress.say("writing the large file");
    let path = folder.file("large.esvo");
    copies(&first.octree, options.large_bytes).and_then(|octree| octree.write(&path)).map_err(BenchError::Format)?;
    progress.say("validating the large file");
    validation.push(validate(options, "large file", &path)?);
    for threads in [1, 2] {
        progress.say(format!("comparing the checksums of the large file, {threads} threads"));
        validation.push(checksums(options, &path, threads)?);
    }
    progress.say("reading the large file");
    let large = access(options, &path)?;
    Ok(FormatReport {
        schema: SCHEMA,
        machine,
        octrees: sources.iter().map(|source| source.row.clone()).collect(),
        storage,
        validation,
        large,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Runs a function at least [`RUNS`] times and for the seconds of the options. Returns the times and the last result.
fn time<T>(
    options: &FormatBenchOptions,
    mut run: impl FnMut() -> Result<T, FormatError>,
) -> Result<(Timed, T), BenchError> {
    let started = Instant::now();
    let mut seconds = Vec::new();
    loop {
        let before = Instant::now();
        let result = run().map_err(BenchError::Format)?;
        seconds.push(before.elapsed().as_secs_f64());
        if seconds.len() >= RUNS && started.elapsed().as_secs_f64() >= options.seconds {
            return Ok((Timed { seconds }, result));
        }
        drop(result);
    }
}

fn storage(options: &FormatBenchOptions, source: &Source, progress: &Progress) -> Result<Vec<StorageRow>, BenchError> {
    let mut rows = Vec::new();
    let ways = [(None, false), (Some(1), false), (Some(3), false), (Some(9), false), (Some(3), true), (Some(9), true)];
    for (zstd, parts) in ways {
        let streams = if parts { " in parts, as streams of fields" } else { "" };
        progress.say(match zstd {
            None => "storing".into(),
            Some(level) => format!("storing{streams}, Zstandard at level {level}"),
        });
        let (write, file) = time(options, || {
            let mut file = Vec::new();
            let written = source
                .octree
                .write_to_with(&mut file, &WriteOptions { compress: zstd, parts, ..WriteOptions::default() });
            written.map(|()| file).map_err(|source| FormatError::Io { path: "memory".into(), source })
        })?;
        let reader = StreamReader::open(&file).map_err(BenchError::Format)?;
        // Read block by block, like a program that loads blocks.
        let blocks = reader.blocks().len() as u32;
        let (read, ()) = time(options, || (0..blocks).try_for_each(|index| reader.read_block(index).map(drop)))?;
        let file_bytes = file.len() as u64;
        let bytes_per_voxel = file_bytes as f64 / source.row.voxels.max(1) as f64;
        rows.push(StorageRow { zstd, parts, file_bytes, bytes_per_voxel, write, read });
    }
    Ok(rows)
}

fn validate(options: &FormatBenchOptions, name: &str, path: &Path) -> Result<ValidationRow, BenchError> {
    let (time, report) = time(options, || validate_file(path))?;
    if !report.is_ok() {
        let first = report.findings.first().map(|finding| finding.broken.clone());
        return Err(first.map_or_else(
            || BenchError::scene(name, "breaks the specification"),
            |broken| BenchError::Format(broken.into()),
        ));
    }
    Ok(ValidationRow { name: name.into(), file_bytes: length(path)?, time })
}

/// Opens a file by mapping it and compares the checksums of its blocks, which every caster does when it loads an octree.
fn checksums(options: &FormatBenchOptions, path: &Path, threads: usize) -> Result<ValidationRow, BenchError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| BenchError::scene("large file", e))?;
    let run = || Ok(Octree::open(path)?.intact()?);
    let (time, ()) = pool.install(|| time(options, run))?;
    let name = format!("large file, checksums alone, {threads} thread{}", if threads == 1 { "" } else { "s" });
    Ok(ValidationRow { name, file_bytes: length(path)?, time })
}

fn length(path: &Path) -> Result<u64, BenchError> {
    std::fs::metadata(path).map(|metadata| metadata.len()).map_err(|e| BenchError::io(path, e))
}

/// A file that records what is read from it.
struct Watched {
    file: File,
    reads: RefCell<Vec<(u64, u64)>>,
}

impl RangeRead for Watched {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.reads.borrow_mut().push((offset, buf.len() as u64));
        self.file.read_at(offset, buf)
    }

    fn length(&self) -> io::Result<Option<u64>> {
        self.file.length()
    }
}

/// A row from the times of its runs and the recorded reads of another run.
fn row(what: String, time: Timed, reads: &[(u64, u64)]) -> AccessRow {
    let pages: BTreeSet<u64> =
        reads.iter().filter(|read| read.1 > 0).flat_map(|(at, n)| at / PAGE..=(at + n - 1) / PAGE).collect();
    AccessRow {
        what,
        time,
        bytes: Some(reads.iter().map(|read| read.1).sum()),
        reads: Some(reads.len() as u64),
        pages: Some(pages.len() as u64),
    }
}

fn open_file(path: &Path) -> Result<File, FormatError> {
    File::open(path).map_err(|source| FormatError::Io { path: path.to_owned(), source })
}

/// Offset and length of all reads when the file is opened and `run` uses it.
fn reads(
    path: &Path,
    run: impl Fn(&StreamReader<&Watched>) -> Result<(), FormatError>,
) -> Result<Vec<(u64, u64)>, BenchError> {
    let file = Watched { file: open_file(path).map_err(BenchError::Format)?, reads: RefCell::default() };
    StreamReader::open(&file).and_then(|reader| run(&reader)).map_err(BenchError::Format)?;
    Ok(file.reads.into_inner())
}

fn access(options: &FormatBenchOptions, path: &Path) -> Result<LargeFile, BenchError> {
    let open = || open_file(path).and_then(StreamReader::open);
    let reader = open().map_err(BenchError::Format)?;
    let (objects, blocks) = (reader.objects().len(), reader.blocks().len());
    // A block in the middle of the file.
    let middle = blocks as u32 / 2;
    let object = objects / 2;
    let coarse = reader.blocks_for(object, &Region::ALL, COARSE);
    let mut access = Vec::new();

    let (seconds, _) = time(options, open)?;
    access.push(row("open: header, directory, tables".into(), seconds, &reads(path, |_| Ok(()))?));
    let (seconds, _) = time(options, || open()?.read_block(middle))?;
    let what = "open and read one block, checked".into();
    access.push(row(what, seconds, &reads(path, |reader| reader.read_block(middle).map(drop))?));
    let (seconds, _) = time(options, || open()?.partial(&coarse))?;
    let what = format!("open and load an object down to level {COARSE}, ready to cast");
    access.push(row(what, seconds, &reads(path, |reader| reader.partial(&coarse).map(drop))?));
    let (seconds, octree) = time(options, || Octree::open(path))?;
    let pages = mapped_bytes(path).map(|bytes| bytes / PAGE);
    drop(octree);
    let what = "open by mapping, every block's parts checked".into();
    access.push(AccessRow { what, time: seconds, bytes: None, reads: None, pages });
    Ok(LargeFile { file_bytes: length(path)?, objects: objects as u64, blocks: blocks as u64, access })
}
