//! Reading files on servers: what is needed of them, or all.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use esvo_bench::Progress;
use esvo_format::file::ObjectEntry;
use esvo_format::{FormatError, IndexReader, Octree, RangeRead, Region, StreamReader};
use esvo_remote::{RemoteFile, RemoteOptions};

use super::{RemoteArguments, shown};
use crate::fail::{Failure, complain};
use crate::files::not_opened;
use crate::words::{count, size};

/// Offset of the length of the head in the header, which is 0 without an index (specification, section 2.1).
const HEAD_AT: u64 = 56;

/// Opens a file by its address. Says so if the server sends no ranges.
fn open(path: &Path, arguments: &RemoteArguments, progress: &Progress) -> Result<RemoteFile, Failure> {
    let name = shown(path);
    let (line, told) = (progress.clone(), name.clone());
    let on_bytes = move |bytes: u64, of: Option<u64>| match of.filter(|all| *all > 0) {
        Some(all) => line.fraction(
            &format!("reading {told}"),
            bytes as f64 / all as f64,
            &format!("{} of {}", size(bytes), size(all)),
        ),
        None => line.say(format!("reading {told}, {}", size(bytes))),
    };
    let options = RemoteOptions {
        max_download: arguments.max_download,
        on_bytes: Some(Arc::new(on_bytes)),
        ..RemoteOptions::default()
    };
    progress.say(format!("reading {name}"));
    let file = RemoteFile::open(&path.to_string_lossy(), options);
    let file = file.map_err(|error| named(&name, &error.to_string()))?;
    if file.is_whole() {
        progress.finish();
        let what = "the server sends no ranges: all of the file was read";
        complain("warning", &format!("{name}: {what}, {}", size(file.len())));
    }
    Ok(file)
}

/// Removes all copies: for a program that is interrupted.
pub(crate) fn remove_copies() {
    esvo_remote::remove_temporaries();
}

/// The error with the name in front, and with the option that raises the limit.
fn named(name: &str, error: &str) -> Failure {
    Failure::Message(format!("{name}: {}", error.replace("raise the limit,", "raise the limit by --max-download,")))
}

/// A copy of all of a file, removed when it is dropped.
pub(crate) struct Copy(esvo_remote::Temporary);

impl Copy {
    pub(crate) fn of(path: &Path, arguments: &RemoteArguments) -> Result<Self, Failure> {
        let progress = Progress::terminal();
        let copy = open(path, arguments, &progress)
            .and_then(|file| file.download().map_err(|error| named(&shown(path), &error.to_string())));
        progress.finish();
        copy.map(Self)
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }
}

enum Reader {
    Index(Box<IndexReader<Arc<RemoteFile>>>),
    Tables(Box<StreamReader<Arc<RemoteFile>>>),
}

/// A file on a server of which only what is needed is read.
pub(crate) struct Served {
    name: PathBuf,
    file: Arc<RemoteFile>,
    reader: Reader,
    progress: Progress,
}

impl Served {
    /// Opens a file: reads its head, or its tables if it has no index.
    pub(crate) fn open(path: &Path, arguments: &RemoteArguments) -> Result<Self, Failure> {
        let progress = Progress::terminal();
        let name: PathBuf = shown(path).into();
        let opened = open(path, arguments, &progress).and_then(|file| {
            let file = Arc::new(file);
            let mut head = [0; 4];
            // A file too short for a header is named by the reader of tables.
            let has_index = file.read_at(HEAD_AT, &mut head).is_ok() && head != [0; 4];
            let reader = if has_index {
                IndexReader::open(file.clone()).map(|reader| Reader::Index(Box::new(reader)))
            } else {
                StreamReader::open(file.clone()).map(|reader| Reader::Tables(Box::new(reader)))
            };
            Ok((file, reader.map_err(|error| not_opened(&name, error))?))
        });
        progress.finish();
        let (file, reader) = opened?;
        Ok(Self { name, file, reader, progress })
    }

    /// The object table.
    pub(crate) fn objects(&self) -> &[ObjectEntry] {
        match &self.reader {
            Reader::Index(reader) => reader.objects(),
            Reader::Tables(reader) => reader.objects(),
        }
    }

    /// Whether the file has an index.
    pub(crate) fn has_index(&self) -> bool {
        matches!(self.reader, Reader::Index(_))
    }

    /// An octree as deep as wanted, see [`IndexReader::octree_by`].
    pub(crate) fn octree_by(&mut self, level: impl Fn(usize, &Region) -> u32) -> Result<Octree, Failure> {
        self.progress.say(format!("reading {}", self.name.display()));
        let octree = self.read(&level);
        self.progress.finish();
        octree.map_err(|error| not_opened(&self.name, error).into())
    }

    fn read(&mut self, level: &impl Fn(usize, &Region) -> u32) -> Result<Octree, FormatError> {
        if let Reader::Index(reader) = &mut self.reader {
            match reader.octree_by(level) {
                // Blocks of other codecs need the tables.
                Err(FormatError::Limit(_)) if reader.needs_tables() => {}
                octree => return octree,
            }
            self.reader = Reader::Tables(Box::new(StreamReader::open(self.file.clone())?));
        }
        let Reader::Tables(reader) = &self.reader else { return Err(FormatError::Limit("it has no tables".into())) };
        if reader.parts().is_empty() {
            return reader.partial(&reader.blocks_by(level));
        }
        reader.partial_parts(&reader.parts_by(level))
    }

    /// Bytes and requests so far, and the length of the file.
    pub(crate) fn counts(&self) -> (u64, u64, u64) {
        (self.file.bytes(), self.file.requests(), self.file.len())
    }

    /// What has been read, in one line.
    pub(crate) fn about(&self) -> String {
        let (bytes, requests, all) = self.counts();
        format!("read {} of {} in {}", size(bytes), size(all), count(requests, "request"))
    }
}
