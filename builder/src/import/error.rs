//! Errors of reading mesh files.

use std::io;
use std::path::{Path, PathBuf};

use crate::mesh::MeshError;

/// Why a file could not be read as a mesh. Each message is one line that starts with the path of the file.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system reported an error.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file that cannot be read; it may be one that the mesh file refers to (a buffer, a material library).
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The path leads to a directory or device instead of a file.
    #[error("{}: is not a regular file; give the path of a .obj, .gltf, .glb, .ply, .stl or .vox file", path.display())]
    NotAFile {
        /// The path as given.
        path: PathBuf,
    },
    /// The file has no bytes.
    #[error("{}: is empty", path.display())]
    Empty {
        /// The path as given.
        path: PathBuf,
    },
    /// The extension is not one of those that can be read.
    #[error("{}: unknown kind of mesh; the extension must be .obj, .gltf, .glb, .ply, .stl or .vox", path.display())]
    UnknownKind {
        /// The path as given.
        path: PathBuf,
    },
    /// The content does not fit the format.
    #[error("{}: is {found}, not {expected} as {source_of_format} says", path.display())]
    WrongKind {
        /// The path as given.
        path: PathBuf,
        /// The kind of file that the format stands for.
        expected: &'static str,
        /// Where the format is from: "its extension" or "the given format".
        source_of_format: &'static str,
        /// The kind of file that the first bytes look like.
        found: &'static str,
    },
    /// The content breaks the rules of its format.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file as given.
        path: PathBuf,
        /// What is wrong, and where.
        what: String,
    },
    /// The content may be valid, but this importer cannot read it.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file as given.
        path: PathBuf,
        /// What is not supported, and what to do.
        what: String,
    },
    /// An image exists but cannot be decoded.
    #[error("{}: cannot decode the image {image}: {what}", path.display())]
    Image {
        /// The mesh file that refers to the image.
        path: PathBuf,
        /// Path or number of the image.
        image: String,
        /// The error of the decoder.
        what: String,
    },
    /// The content exceeds one of the limits of this module.
    #[error("{}: {what}; the limit is {limit}", path.display())]
    TooLarge {
        /// The file as given.
        path: PathBuf,
        /// What is too large, and how large it is.
        what: String,
        /// The limit it exceeds.
        limit: u64,
    },
    /// Reading the file would need more memory than allowed.
    #[error(
        "{}: a memory limit of {} MB is too small to read it: that needs at least {} MB",
        path.display(), limit / 1_000_000, least.div_ceil(1_000_000)
    )]
    Memory {
        /// The file as given.
        path: PathBuf,
        /// The limit in bytes.
        limit: u64,
        /// What is needed at least, in bytes.
        least: u64,
    },
    /// The file was read, but the result is not a valid mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file as given.
        path: PathBuf,
        /// The rule that is broken.
        source: MeshError,
    },
}

impl ImportError {
    pub(super) fn malformed(path: &Path, what: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), what: what.into() }
    }

    pub(super) fn unsupported(path: &Path, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.into(), what: what.into() }
    }
}

/// The message of a library as one line of limited length, for use at the end of a message of this module.
pub(super) fn one_line(message: impl ToString) -> String {
    const LIMIT: usize = 240;
    let message = message.to_string();
    let joined = message.split_whitespace().collect::<Vec<_>>().join(" ");
    let printable: String = joined.chars().filter(|c| !c.is_control()).collect();
    match printable.char_indices().nth(LIMIT) {
        Some((cut, _)) => format!("{}...", &printable[..cut]),
        None => printable,
    }
}
