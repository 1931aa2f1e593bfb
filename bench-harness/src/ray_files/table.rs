//! What files of rays and files of hits have in common: the header, and records of equal length.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Bytes of the header.
pub(super) const HEADER: usize = 192;
/// Version of the layouts.
const VERSION: u32 = 1;
/// Set if voxels are clipped by their contours.
const FLAG_CONTOURS: u32 = 1;
/// Largest `.json` that is read, in bytes: the whole file is held in memory.
const MOST_JSON: u64 = 1 << 30;

/// Why a file of rays or hits cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct RayFileError {
    path: PathBuf,
    what: String,
}

impl RayFileError {
    pub(super) fn new(path: &Path, what: impl ToString) -> Self {
        Self { path: path.to_owned(), what: what.to_string() }
    }
}

/// What a file says about all of its records.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileHeader {
    /// Index of the object in the octree.
    pub object: u32,
    /// Whether voxels are clipped by their contours.
    pub contours: bool,
    /// Width and height of the picture that the rays make; `[0, 0]`: they make none.
    pub size: [u32; 2],
    /// From octree space, the cube 0 to 1, to mesh units, column by column.
    pub octree_to_mesh: [f64; 16],
}

impl FileHeader {
    /// Checks it as the header of `count` records. `Err` says what is wrong.
    fn check(&self, count: u64, records: &str) -> Result<(), String> {
        let [width, height] = self.size;
        let pixels = u64::from(width) * u64::from(height);
        if self.size != [0, 0] && pixels != count {
            return Err(format!("a picture of {width}x{height} has {pixels} {records}, not {count}"));
        }
        if !self.octree_to_mesh.iter().all(|x| x.is_finite()) {
            return Err("the matrix has numbers that are not finite".into());
        }
        Ok(())
    }
}

/// A kind of record.
pub(super) trait Layout: Sized + Serialize + DeserializeOwned {
    /// First bytes of a `.bin`.
    const MAGIC: &'static [u8; 8];
    /// First member of a `.json`.
    const SCHEMA: &'static str;
    /// What the records are, for errors.
    const WHAT: &'static str;
    /// Bytes of a record.
    const BYTES: usize;

    /// Appends the record.
    fn put(&self, out: &mut Vec<u8>);
    /// Reads a record of [`BYTES`](Self::BYTES) bytes. `Err` says what is wrong.
    fn get(bytes: &[u8]) -> Result<Self, String>;
    /// The first number that a `.json` cannot hold, with its name: JSON has neither infinity nor NaN.
    fn not_in_json(&self) -> Option<(&'static str, f64)>;
}

/// The form of a file, by its extension.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Binary,
    Json,
}

impl Form {
    pub(super) fn of(path: &Path) -> Result<Self, RayFileError> {
        match path.extension().map(|e| e.to_ascii_lowercase()) {
            Some(e) if e == "bin" => Ok(Self::Binary),
            Some(e) if e == "json" => Ok(Self::Json),
            _ => Err(RayFileError::new(path, "has an unknown extension; expected .bin or .json")),
        }
    }
}

/// The first part of a `.json`; the records follow.
#[derive(Serialize)]
struct JsonHead<'a> {
    schema: &'a str,
    #[serde(flatten)]
    header: &'a FileHeader,
}

/// A whole `.json`.
#[derive(Deserialize)]
struct Json<R> {
    schema: String,
    object: u32,
    contours: bool,
    size: [u32; 2],
    octree_to_mesh: [f64; 16],
    records: Vec<R>,
}

/// Writes records one after the other.
pub(super) struct TableWriter<'a> {
    out: &'a mut dyn Write,
    form: Form,
    /// What the records are, for errors.
    what: &'static str,
    /// Number of records in the header.
    count: u64,
    written: u64,
    bytes: Vec<u8>,
}

impl<'a> TableWriter<'a> {
    /// Writes the header. Refuses one that [`TableReader`] would refuse.
    pub(super) fn new<R: Layout>(
        out: &'a mut dyn Write,
        form: Form,
        header: &FileHeader,
        count: u64,
    ) -> std::io::Result<Self> {
        header.check(count, R::WHAT).map_err(std::io::Error::other)?;
        match form {
            Form::Binary => out.write_all(&binary_header::<R>(header, count))?,
            Form::Json => {
                let head = JsonHead { schema: R::SCHEMA, header };
                let head = serde_json::to_string(&head).map_err(std::io::Error::other)?;
                write!(out, "{},\"records\":[", &head[..head.len() - 1])?;
            }
        }
        Ok(Self { out, form, what: R::WHAT, count, written: 0, bytes: Vec::new() })
    }

    /// Writes some records. Refuses more than the header announces, and in a `.json` numbers that are not finite.
    pub(super) fn put<R: Layout>(&mut self, records: &[R]) -> std::io::Result<()> {
        for record in records {
            if self.written == self.count {
                let (what, count) = (self.what, self.count);
                return Err(std::io::Error::other(format!("there are more {what} than the {count} of the header")));
            }
            match self.form {
                Form::Binary => {
                    self.bytes.clear();
                    record.put(&mut self.bytes);
                    self.out.write_all(&self.bytes)?;
                }
                Form::Json => {
                    if let Some((name, value)) = record.not_in_json() {
                        let what =
                            format!("record {}: {name} is {value}, which JSON cannot hold; use .bin", self.written);
                        return Err(std::io::Error::other(what));
                    }
                    let text = serde_json::to_string(record).map_err(std::io::Error::other)?;
                    write!(self.out, "{}\n{text}", if self.written == 0 { "" } else { "," })?;
                }
            }
            self.written += 1;
        }
        Ok(())
    }

    /// Writes what follows the last record. Refuses fewer records than the header announces.
    pub(super) fn end(self) -> std::io::Result<()> {
        if self.written < self.count {
            let (what, count, written) = (self.what, self.count, self.written);
            return Err(std::io::Error::other(format!("there are {written} {what}, but the header announces {count}")));
        }
        if self.form == Form::Json { writeln!(self.out, "\n]}}") } else { Ok(()) }
    }
}

fn binary_header<R: Layout>(header: &FileHeader, count: u64) -> Vec<u8> {
    let mut bytes = R::MAGIC.to_vec();
    for number in [VERSION, HEADER as u32, R::BYTES as u32, header.object] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(count.to_le_bytes());
    for number in [u32::from(header.contours) * FLAG_CONTOURS, header.size[0], header.size[1]] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.resize(64, 0);
    header.octree_to_mesh.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    bytes
}

/// Reads records one after the other.
pub(super) struct TableReader<R> {
    path: PathBuf,
    pub(super) header: FileHeader,
    pub(super) count: u64,
    /// Records that were read.
    read: u64,
    source: Source<R>,
}

enum Source<R> {
    Binary(BufReader<File>),
    Json(std::vec::IntoIter<R>),
}

impl<R: Layout> TableReader<R> {
    /// Opens a file and checks its header and its length.
    pub(super) fn open(path: &Path) -> Result<Self, RayFileError> {
        let form = Form::of(path)?;
        let failed = |what: String| RayFileError::new(path, what);
        let io = |e: std::io::Error| RayFileError::new(path, e);
        let file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        if !metadata.is_file() {
            return Err(failed("is not a regular file".into()));
        }
        let mut file = BufReader::with_capacity(1 << 20, file);
        if form == Form::Json {
            if metadata.len() > MOST_JSON {
                let what = format!("has {} bytes; .json is read up to {MOST_JSON}, use .bin", metadata.len());
                return Err(failed(what));
            }
            let json: Json<R> = serde_json::from_reader(file).map_err(|e| failed(e.to_string()))?;
            if json.schema != R::SCHEMA {
                return Err(failed(format!("its schema is {}; expected {}", json.schema, R::SCHEMA)));
            }
            let Json { object, contours, size, octree_to_mesh, records, .. } = json;
            let header = FileHeader { object, contours, size, octree_to_mesh };
            let count = records.len() as u64;
            let source = Source::Json(records.into_iter());
            return Self { path: path.to_owned(), header, count, read: 0, source }.checked();
        }
        let mut bytes = [0; HEADER];
        if metadata.len() < HEADER as u64 {
            return Err(failed(format!("has {} bytes; the header alone has {HEADER}", metadata.len())));
        }
        file.read_exact(&mut bytes).map_err(io)?;
        let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(number(at)) | u64::from(number(at + 4)) << 32;
        if bytes[..8] != *R::MAGIC {
            return Err(failed(format!("is no file of {} of esvo: it must start with {}", R::WHAT, text(R::MAGIC))));
        }
        for (what, at, expected) in [
            ("version", 8, VERSION),
            ("bytes of the header", 12, HEADER as u32),
            ("bytes of a record", 16, R::BYTES as u32),
        ] {
            if number(at) != expected {
                return Err(failed(format!("{what}: {}; expected {expected}", number(at))));
            }
        }
        if number(32) & !FLAG_CONTOURS != 0 || bytes[44..64].iter().any(|&b| b != 0) {
            return Err(failed("flags or reserved bytes are set that this version does not know".into()));
        }
        let count = long(24);
        let expected = u128::from(count) * R::BYTES as u128 + HEADER as u128;
        if expected != u128::from(metadata.len()) {
            let there = metadata.len();
            return Err(failed(format!("{count} {} take {expected} bytes, but the file has {there}", R::WHAT)));
        }
        let header = FileHeader {
            object: number(20),
            contours: number(32) & FLAG_CONTOURS != 0,
            size: [number(36), number(40)],
            octree_to_mesh: std::array::from_fn(|i| f64::from_bits(long(64 + 8 * i))),
        };
        Self { path: path.to_owned(), header, count, read: 0, source: Source::Binary(file) }.checked()
    }

    fn checked(self) -> Result<Self, RayFileError> {
        match self.header.check(self.count, R::WHAT) {
            Ok(()) => Ok(self),
            Err(what) => Err(self.error(what)),
        }
    }

    /// An error of this file.
    pub(super) fn error(&self, what: impl ToString) -> RayFileError {
        RayFileError::new(&self.path, what)
    }

    /// Replaces `records` by the next ones, at most `most`. Leaves none at the end.
    pub(super) fn next(&mut self, most: usize, records: &mut Vec<R>) -> Result<(), RayFileError> {
        records.clear();
        let left = usize::try_from(self.count - self.read).unwrap_or(usize::MAX).min(most);
        match &mut self.source {
            Source::Json(all) => records.extend(all.take(left)),
            Source::Binary(file) => {
                let mut bytes = vec![0; left * R::BYTES];
                file.read_exact(&mut bytes).map_err(|e| RayFileError::new(&self.path, e))?;
                for (index, record) in bytes.chunks_exact(R::BYTES).enumerate() {
                    let named =
                        |what| RayFileError::new(&self.path, format!("record {}: {what}", self.read + index as u64));
                    records.push(R::get(record).map_err(named)?);
                }
            }
        }
        self.read += records.len() as u64;
        Ok(())
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The first number that is infinite or NaN, with its name.
pub(super) fn first_not_finite(numbers: &[(&'static str, &[f32])]) -> Option<(&'static str, f64)> {
    let values = numbers.iter().flat_map(|(name, values)| values.iter().map(move |value| (*name, f64::from(*value))));
    values.into_iter().find(|(_, value)| !value.is_finite())
}

/// The `f32` at an offset.
pub(super) fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// The `u32` at an offset.
pub(super) fn whole(bytes: &[u8], at: usize) -> u32 {
    float(bytes, at).to_bits()
}

/// The `f64` at an offset.
pub(super) fn double(bytes: &[u8], at: usize) -> f64 {
    f64::from_bits(u64::from(whole(bytes, at)) | u64::from(whole(bytes, at + 4)) << 32)
}
