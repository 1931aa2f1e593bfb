//! The binary side of glTF: the GLB container, buffers, and accessors that cannot be read out of bounds.
//!
//! Built on the JSON types of the `gltf` crate. The crate's own readers trust indices, strides and lengths, and panic if a
//! file gives wrong ones. Here each of them is checked before it is used.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf::json;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use percent_encoding::percent_decode_str;

use super::error::{ImportError, one_line};
use super::file::read_file;
use super::gltf_json::{ignored_extensions, without_unused_parts};

/// Most values of an accessor without a buffer view (all zero except sparse ones): the file size does not limit these.
const MAX_VALUES_WITHOUT_BYTES: u64 = 1 << 20;

/// A parsed file with its buffers. A buffer is read when it is first needed.
#[derive(Debug)]
pub(super) struct Source<'p> {
    pub(super) path: &'p Path,
    pub(super) root: json::Root,
    /// Extensions that are in use but not known: the name, and the first place where it is used.
    pub(super) ignored: Vec<(String, String)>,
    binary_chunk: Option<Vec<u8>>,
    buffers: Vec<OnceCell<Vec<u8>>>,
}

/// Only the version of the format, which decides whether the rest can be parsed.
#[derive(serde::Deserialize)]
struct Versioned {
    asset: Version,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct Version {
    /// A string in valid files; in some files of version 1 a number.
    version: json::Value,
    min_version: Option<String>,
}

impl<'p> Source<'p> {
    /// Parses a `.gltf` or `.glb` file. `is_known` says which extensions need no entry in `ignored`.
    pub(super) fn parse(path: &'p Path, bytes: &[u8], is_known: fn(&str) -> bool) -> Result<Self, ImportError> {
        let (text, binary_chunk) = if bytes.starts_with(b"glTF") {
            let (text, chunk) = split_glb(bytes).map_err(|what| ImportError::malformed(path, what))?;
            (text, chunk.map(<[u8]>::to_vec))
        } else {
            // A byte order mark is not valid, but harmless.
            (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None)
        };
        let bad =
            |e: &dyn std::fmt::Display| ImportError::malformed(path, format!("not a glTF document: {}", one_line(e)));
        let Versioned { asset } = json::deserialize::from_slice(text).map_err(|e| bad(&e))?;
        let version = asset.version.as_str().map_or_else(|| asset.version.to_string(), str::to_owned);
        let needed = asset.min_version.as_deref().unwrap_or(&version);
        let readable = match asset.min_version {
            Some(_) => needed == "2.0",
            None => needed.starts_with("2."),
        };
        if !readable {
            let needed = one_line(needed);
            return Err(ImportError::unsupported(path, format!("glTF version {needed}; only version 2 can be read")));
        }
        let root = match json::Root::from_slice(text) {
            Ok(root) => root,
            Err(e) => without_unused_parts(text, &["animations", "cameras", "extensions", "extras"])
                .or_else(|| without_unused_parts(text, &["animations", "cameras", "skins", "extensions", "extras"]))
                .ok_or_else(|| bad(&e))?,
        };
        let buffers = root.buffers.iter().map(|_| OnceCell::new()).collect();
        let ignored = ignored_extensions(&root, text, is_known);
        Ok(Self { path, root, ignored, binary_chunk, buffers })
    }

    pub(super) fn malformed(&self, what: impl Into<String>) -> ImportError {
        ImportError::malformed(self.path, what)
    }

    /// The error for an index beyond the end of a top-level array.
    pub(super) fn out_of_range(&self, what: &str, index: usize, count: usize) -> ImportError {
        self.malformed(format!("{what} {index} does not exist: there are only {count}"))
    }

    /// The bytes of a buffer, limited to its declared length.
    fn buffer(&self, index: usize) -> Result<&[u8], ImportError> {
        let buffer =
            self.root.buffers.get(index).ok_or_else(|| self.out_of_range("buffer", index, self.root.buffers.len()))?;
        let declared = buffer.byte_length.0;
        let compressed = |name: &&str| {
            let extensions = buffer.extensions.as_ref();
            extensions.and_then(|e| e.others.get(*name)?.get("fallback")?.as_bool()) == Some(true)
        };
        if buffer.uri.is_none()
            && (index > 0 || self.binary_chunk.is_none())
            && let Some(name) = MESHOPT.into_iter().find(compressed)
        {
            return Err(ImportError::unsupported(
                self.path,
                format!(
                    "buffer {index} is compressed with the glTF extension {name}, which is not supported, and has no \
                     uncompressed copy; export it without compression"
                ),
            ));
        }
        let bytes = match (&buffer.uri, self.buffers[index].get()) {
            (None, _) => match &self.binary_chunk {
                Some(chunk) if index == 0 => chunk,
                _ => return Err(self.malformed(format!("buffer {index} has no data: no uri and no binary chunk"))),
            },
            (Some(_), Some(bytes)) => bytes,
            (Some(uri), None) => {
                let loaded = match self.resolve(uri, &format!("buffer {index}"))? {
                    Resource::Embedded { bytes, .. } => bytes,
                    Resource::File(file) => {
                        read_file(&file).map_err(|e| self.malformed(format!("buffer {index}: {}", one_line(e))))?
                    }
                };
                self.buffers[index].get_or_init(|| loaded)
            }
        };
        usize::try_from(declared).ok().and_then(|length| bytes.get(..length)).ok_or_else(|| {
            self.malformed(format!("buffer {index} has {} bytes, but {declared} are declared", bytes.len()))
        })
    }

    /// The bytes of a buffer view, and its stride if it has one.
    pub(super) fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), ImportError> {
        let views = &self.root.buffer_views;
        let view = views.get(index).ok_or_else(|| self.out_of_range("buffer view", index, views.len()))?;
        let buffer = self.buffer(view.buffer.value())?;
        let offset = view.byte_offset.map_or(0, |o| o.0);
        let bytes = slice(buffer, offset, view.byte_length.0).ok_or_else(|| {
            self.malformed(format!("buffer view {index} reaches past the end of buffer {}", view.buffer.value()))
        })?;
        Ok((bytes, view.byte_stride.map(|s| s.0)))
    }

    /// Prepares an accessor for reading. `what` describes its purpose in messages. Its type must be one of `types`.
    pub(super) fn accessor(&self, index: usize, what: &str, types: &[Type]) -> Result<Accessor<'_>, ImportError> {
        let accessors = &self.root.accessors;
        let accessor = accessors.get(index).ok_or_else(|| self.out_of_range("accessor", index, accessors.len()))?;
        let wrong = |why: String| self.malformed(format!("accessor {index} ({what}) {why}"));
        let Checked::Valid(component) = accessor.component_type else {
            return Err(wrong("has an unknown component type".into()));
        };
        let component = component.0;
        let kind = match accessor.type_ {
            Checked::Valid(kind) if types.contains(&kind) => kind,
            _ => return Err(wrong(format!("must be of type {}", names(types)))),
        };
        let components = kind.multiplicity();
        let size = component.size() * components;
        let count = accessor.count.0;
        let (base, stride) = match accessor.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.view(view.value())?;
                let stride = stride.unwrap_or(size);
                if stride < size {
                    return Err(wrong(format!("has values of {size} bytes in a buffer view of stride {stride}")));
                }
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                let length = match count.checked_sub(1) {
                    Some(steps) => steps.checked_mul(stride as u64).and_then(|l| l.checked_add(size as u64)),
                    None => Some(0),
                };
                let bytes = length.and_then(|length| slice(bytes, offset, length)).ok_or_else(|| {
                    wrong(format!("with {count} values reaches past the end of buffer view {}", view.value()))
                })?;
                (Some(bytes), stride)
            }
            None if count > MAX_VALUES_WITHOUT_BYTES => {
                return Err(wrong(format!(
                    "has {count} values and no buffer view; the limit is {MAX_VALUES_WITHOUT_BYTES}"
                )));
            }
            None => (None, size),
        };
        let count = usize::try_from(count).map_err(|_| wrong(format!("has too many values: {count}")))?;
        let mut result = Accessor {
            base,
            stride,
            count,
            component,
            components,
            normalized: accessor.normalized,
            replaced: Vec::new(),
        };
        if let Some(sparse) = &accessor.sparse {
            result.replaced = self.sparse(sparse, size, count).map_err(|e| match e {
                SparseError::Import(e) => e,
                SparseError::What(why) => wrong(why),
            })?;
        }
        Ok(result)
    }

    /// Refuses a primitive whose vertices are only there in compressed form.
    pub(super) fn check_compression(
        &self,
        primitive: &json::mesh::Primitive,
        positions: usize,
        label: &str,
    ) -> Result<(), ImportError> {
        let is_compressed = primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key(DRACO));
        let has_copy =
            self.root.accessors.get(positions).is_some_and(|a| a.buffer_view.is_some() || a.sparse.is_some());
        if is_compressed && !has_copy {
            return Err(ImportError::unsupported(
                self.path,
                format!(
                    "{label} is compressed with the glTF extension {DRACO}, which is not supported, and has no uncompressed \
                     copy; export it without compression"
                ),
            ));
        }
        Ok(())
    }

    /// The replaced values of a sparse accessor, in ascending order of index.
    fn sparse(
        &self,
        sparse: &json::accessor::sparse::Sparse,
        size: usize,
        count: usize,
    ) -> Result<Vec<(usize, &[u8])>, SparseError> {
        let Checked::Valid(kind) = sparse.indices.component_type else {
            return Err(SparseError::What("has sparse indices of an unknown component type".into()));
        };
        let replaced = sparse.count.0;
        let part = |view: usize, offset: u64, width: usize, name: &str| {
            let (bytes, _) = self.view(view)?;
            let length = replaced.checked_mul(width as u64);
            length.and_then(|length| slice(bytes, offset, length)).ok_or_else(|| {
                SparseError::What(format!("has sparse {name} that reach past the end of buffer view {view}"))
            })
        };
        let width = kind.0.size();
        let indices = part(sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0, width, "indices")?;
        let values = part(sparse.values.buffer_view.value(), sparse.values.byte_offset.0, size, "values")?;
        let mut result = Vec::with_capacity(indices.len() / width);
        for (index, value) in indices.chunks_exact(width).zip(values.chunks_exact(size)) {
            let index = integer(kind.0, index) as usize;
            if index >= count {
                return Err(SparseError::What(format!("replaces value {index}, but has only {count}")));
            }
            if result.last().is_some_and(|&(last, _)| last >= index) {
                return Err(SparseError::What("has sparse indices that do not ascend".into()));
            }
            result.push((index, value));
        }
        Ok(result)
    }

    /// What a URI refers to: a file next to the document, or embedded data. Nothing is fetched from a network.
    pub(super) fn resolve(&self, uri: &str, what: &str) -> Result<Resource, ImportError> {
        let bad = |why: String| self.malformed(format!("{what}: {why}"));
        if let Some(data) = uri.strip_prefix("data:") {
            let (media_type, payload) =
                data.split_once(',').ok_or_else(|| bad("its data URI has no comma before the data".into()))?;
            let bytes = match media_type.strip_suffix(";base64") {
                Some(_) => BASE64
                    .decode(payload.trim_ascii())
                    .map_err(|e| bad(format!("its data URI is not valid base64: {}", one_line(e))))?,
                None => percent_decode_str(payload).collect(),
            };
            return Ok(Resource::Embedded { bytes });
        }
        let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
        if scheme.is_some_and(|s| !s.is_empty() && s.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))) {
            let shown = one_line(uri);
            return Err(ImportError::unsupported(
                self.path,
                format!("{what}: the URI {shown} is not a relative path; put the file next to the document"),
            ));
        }
        let decoded = percent_decode_str(uri)
            .decode_utf8()
            .map_err(|_| bad(format!("the URI {} is not UTF-8 once decoded", one_line(uri))))?;
        let dir = self.path.parent().unwrap_or(Path::new(""));
        // A literal percent sign in a file name is not valid, but occurs.
        let candidates = [dir.join(&*decoded), dir.join(uri)];
        let found = candidates.iter().find(|c| c.is_file()).unwrap_or(&candidates[0]);
        Ok(Resource::File(found.clone()))
    }
}

const DRACO: &str = "KHR_draco_mesh_compression";
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// An error as a part of a message that names the file already.
pub(super) fn reason(error: ImportError) -> String {
    match error {
        ImportError::Malformed { what, .. } | ImportError::Unsupported { what, .. } => what,
        ImportError::Image { image, what, .. } => format!("the image {image} cannot be decoded: {what}"),
        other => one_line(other),
    }
}

/// Where the bytes are that a URI refers to.
#[derive(Debug)]
pub(super) enum Resource {
    Embedded { bytes: Vec<u8> },
    File(PathBuf),
}

enum SparseError {
    Import(ImportError),
    What(String),
}

impl From<ImportError> for SparseError {
    fn from(error: ImportError) -> Self {
        Self::Import(error)
    }
}

/// Accepts data without padding: the format requires it, but some exporters omit it.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

fn slice(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(offset).ok()?..end)
}

fn names(types: &[Type]) -> String {
    let name = |t: &Type| match t {
        Type::Scalar => "SCALAR",
        Type::Vec2 => "VEC2",
        Type::Vec3 => "VEC3",
        Type::Vec4 => "VEC4",
        Type::Mat2 => "MAT2",
        Type::Mat3 => "MAT3",
        Type::Mat4 => "MAT4",
    };
    types.iter().map(name).collect::<Vec<_>>().join(" or ")
}

/// The values of a checked accessor, readable in any order.
#[derive(Clone, Debug)]
pub(super) struct Accessor<'a> {
    /// From the first value to the end of the last; `None` if all values are zero.
    base: Option<&'a [u8]>,
    stride: usize,
    count: usize,
    component: ComponentType,
    components: usize,
    normalized: bool,
    /// Values replaced by sparse storage, in ascending order of index.
    replaced: Vec<(usize, &'a [u8])>,
}

impl Accessor<'_> {
    pub(super) fn len(&self) -> usize {
        self.count
    }

    pub(super) fn is_float(&self) -> bool {
        self.component == ComponentType::F32
    }

    /// The bytes of value `index`, which must be below `len()`; `None` if the value is zero.
    fn bytes(&self, index: usize) -> Option<&[u8]> {
        if !self.replaced.is_empty()
            && let Ok(found) = self.replaced.binary_search_by_key(&index, |&(i, _)| i)
        {
            return Some(self.replaced[found].1);
        }
        let size = self.component.size() * self.components;
        self.base.map(|bytes| &bytes[index * self.stride..][..size])
    }

    /// Value `index`, which must be below `len()`. Integers are converted, or, if normalized, become fractions. Components
    /// that the accessor's type lacks are zero.
    pub(super) fn vector(&self, index: usize) -> [f64; 4] {
        let mut result = [0.0; 4];
        if let Some(bytes) = self.bytes(index) {
            for (value, chunk) in result.iter_mut().zip(bytes.chunks_exact(self.component.size())) {
                *value = self.number(chunk);
            }
        }
        result
    }

    /// How many numbers a value has.
    pub(super) fn components(&self) -> usize {
        self.components
    }

    /// Value `index`, which must be below `len()`, of an accessor of 4 x 4 matrices: its columns.
    pub(super) fn matrix(&self, index: usize) -> [f64; 16] {
        let mut result = [0.0; 16];
        if let Some(bytes) = self.bytes(index) {
            for (value, chunk) in result.iter_mut().zip(bytes.chunks_exact(self.component.size())) {
                *value = self.number(chunk);
            }
        }
        result
    }

    /// Integer scalar `index`, which must be below `len()`.
    pub(super) fn index(&self, index: usize) -> u32 {
        self.bytes(index).map_or(0, |bytes| integer(self.component, bytes))
    }

    fn number(&self, bytes: &[u8]) -> f64 {
        let (value, largest) = match (self.component, bytes) {
            (ComponentType::F32, &[a, b, c, d]) => return f64::from(f32::from_le_bytes([a, b, c, d])),
            (ComponentType::I8, &[a]) => (f64::from(a as i8), 127.0),
            (ComponentType::I16, &[a, b]) => (f64::from(i16::from_le_bytes([a, b])), 32767.0),
            (ComponentType::U8, _) => (f64::from(integer(self.component, bytes)), 255.0),
            (ComponentType::U16, _) => (f64::from(integer(self.component, bytes)), 65535.0),
            _ => (f64::from(integer(self.component, bytes)), f64::from(u32::MAX)),
        };
        // Both the lowest signed value and the next one stand for -1.
        if self.normalized { (value / largest).max(-1.0) } else { value }
    }
}

/// A little-endian unsigned integer of one, two or four bytes.
fn integer(kind: ComponentType, bytes: &[u8]) -> u32 {
    match (kind.size(), bytes) {
        (1, &[a, ..]) => u32::from(a),
        (2, &[a, b, ..]) => u32::from(u16::from_le_bytes([a, b])),
        (4, &[a, b, c, d, ..]) => u32::from_le_bytes([a, b, c, d]),
        _ => 0,
    }
}

/// The JSON text of a GLB container, and the binary chunk if there is one.
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let word = |at: usize| -> Option<u32> {
        let four = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes(four.try_into().ok()?))
    };
    let truncated = || format!("the GLB container is truncated: it has {} bytes", bytes.len());
    let version = word(4).ok_or_else(truncated)?;
    if version != 2 {
        return Err(format!("GLB container version {version}; only version 2 can be read"));
    }
    let declared = word(8).ok_or_else(truncated)? as usize;
    if declared > bytes.len() {
        return Err(format!("{} of {declared} bytes", truncated()));
    }
    let chunk = |at: usize, name: &str| -> Result<(&[u8], &[u8], usize), String> {
        let length = word(at).ok_or_else(truncated)? as usize;
        let kind = bytes.get(at + 4..at + 8).ok_or_else(truncated)?;
        let end = (at + 8).checked_add(length).filter(|&end| end <= declared);
        let end = end.ok_or_else(|| format!("the {name} chunk of the GLB container reaches past its end"))?;
        Ok((kind, &bytes[at + 8..end], end))
    };
    let (kind, text, end) = chunk(12, "first")?;
    if kind != b"JSON" {
        return Err("the first chunk of the GLB container is not JSON".into());
    }
    // Chunks of other kinds must be ignored. Chunks are multiples of 4 bytes long. Old exporters wrote others, with the next
    // chunk directly after them or at the next multiple of 4.
    let next = |end: usize| {
        let is_binary = |at: usize| chunk(at, "next").is_ok_and(|(kind, ..)| kind == b"BIN\0");
        let aligned = end.next_multiple_of(4);
        if is_binary(aligned) && !is_binary(end) { aligned } else { end }
    };
    let mut at = next(end);
    while at < declared {
        // Padding after the last chunk.
        if at % 4 != 0 && declared - at < 4 {
            break;
        }
        let (kind, data, end) = chunk(at, "second")?;
        if kind == b"BIN\0" {
            return Ok((text, Some(data)));
        }
        at = next(end);
    }
    Ok((text, None))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut body = Vec::new();
        for (kind, data) in chunks {
            body.extend((data.len() as u32).to_le_bytes());
            body.extend(*kind);
            body.extend(*data);
        }
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((body.len() as u32 + 12).to_le_bytes());
        bytes.extend(body);
        bytes
    }

    #[test]
    fn glb_chunks_are_found_and_unknown_ones_skipped() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"XTRA", b"1234"), (b"BIN\0", b"5678")]);
        assert_eq!(split_glb(&bytes), Ok((&b"{}  "[..], Some(&b"5678"[..]))));
        assert_eq!(split_glb(&glb(&[(b"JSON", b"{}  ")])), Ok((&b"{}  "[..], None)));
    }

    #[test]
    fn glb_chunks_of_any_length_are_followed_by_the_next() {
        let bytes = glb(&[(b"JSON", b"{}"), (b"XTRA", b"123"), (b"BIN\0", b"5678")]);
        assert_eq!(split_glb(&bytes), Ok((&b"{}"[..], Some(&b"5678"[..]))));
        // Padded, but the length does not count the padding.
        let mut bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"5678")]);
        bytes[12] = 2;
        assert_eq!(split_glb(&bytes), Ok((&b"{}"[..], Some(&b"5678"[..]))));
        let mut bytes = glb(&[(b"JSON", b"{}  ")]);
        bytes[12] = 2;
        assert_eq!(split_glb(&bytes), Ok((&b"{}"[..], None)));
    }

    #[test]
    fn every_truncation_of_a_glb_is_an_error() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"5678")]);
        for length in 4..bytes.len() {
            assert!(split_glb(&bytes[..length]).unwrap_err().starts_with("the GLB container is truncated"), "{length}");
        }
    }

    #[test]
    fn bad_glb_containers_are_errors() {
        let mut bytes = glb(&[(b"BIN\0", b"5678")]);
        assert_eq!(split_glb(&bytes).unwrap_err(), "the first chunk of the GLB container is not JSON");
        bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(split_glb(&bytes).unwrap_err(), "the first chunk of the GLB container reaches past its end");
        bytes[4] = 1;
        assert_eq!(split_glb(&bytes).unwrap_err(), "GLB container version 1; only version 2 can be read");
    }

    #[test]
    fn integers_become_fractions_if_normalized() {
        let accessor = |component, normalized, bytes| Accessor {
            base: Some(bytes),
            stride: 4,
            count: 1,
            component,
            components: 2,
            normalized,
            replaced: Vec::new(),
        };
        assert_eq!(accessor(ComponentType::U8, true, &[255, 51, 0, 0]).vector(0), [1.0, 0.2, 0.0, 0.0]);
        assert_eq!(accessor(ComponentType::U8, false, &[255, 51, 0, 0]).vector(0), [255.0, 51.0, 0.0, 0.0]);
        assert_eq!(accessor(ComponentType::I8, true, &[0x80, 0x7f, 0, 0]).vector(0), [-1.0, 1.0, 0.0, 0.0]);
        assert_eq!(accessor(ComponentType::I16, true, &[0x01, 0x80, 0, 0]).vector(0), [-1.0, 0.0, 0.0, 0.0]);
    }
}
