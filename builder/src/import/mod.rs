//! Reads triangle meshes from files: OBJ, glTF (text and binary), PLY and STL (text and binary).
//!
//! Every file gives either a mesh that [`Mesh::validate`] accepts or one error that names the file and the place in it.
//! Nothing here panics or hangs on bad input, and memory stays in proportion to the file (within the limits below).

mod assembly;
mod gltf;
mod gltf_data;
mod gltf_material;
mod image;
mod mtl;
mod obj;
mod ply;
mod stl;

use std::borrow::Cow;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::mesh::maps::{HeightMap, UvTransform};
use crate::mesh::{Mesh, MeshError};
use image::{Channel, TextureStore};

pub use crate::mesh::texture::TextureError;
pub(crate) use assembly::fill_missing_normals;

/// Most triangles, and most vertices, that one mesh may have. Instances in a glTF scene can multiply a small file into
/// more than any machine holds; this is where that stops.
pub const MAX_ELEMENTS: usize = 1 << 27;

/// Most texels per side of a texture.
pub const MAX_TEXTURE_SIDE: u32 = 1 << 14;

/// Most texels that all textures of a mesh may have together (without their mip levels).
pub const MAX_TEXTURE_TEXELS: u64 = 1 << 29;

/// Why a file gave no mesh. Each message is one line that starts with the path of the file.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system refused.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file that could not be read; not always the one asked for (a buffer, a material library).
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A directory or device instead of a file.
    #[error("{}: is not a regular file; give the path of a .obj, .gltf, .glb, .ply or .stl file", path.display())]
    NotAFile {
        /// The path as given.
        path: PathBuf,
    },
    /// A file without a single byte.
    #[error("{}: is empty", path.display())]
    Empty {
        /// The path as given.
        path: PathBuf,
    },
    /// The extension is none of those known.
    #[error("{}: unknown kind of mesh; the extension must be .obj, .gltf, .glb, .ply or .stl", path.display())]
    UnknownKind {
        /// The path as given.
        path: PathBuf,
    },
    /// The content contradicts the extension.
    #[error("{}: is {found}, not {expected} as its extension says", path.display())]
    WrongKind {
        /// The path as given.
        path: PathBuf,
        /// What the extension promises.
        expected: &'static str,
        /// What the first bytes look like.
        found: &'static str,
    },
    /// The content breaks the rules of its format.
    #[error("{}: {what}", path.display())]
    Malformed {
        /// The file as given.
        path: PathBuf,
        /// What is wrong, where.
        what: String,
    },
    /// The content may be right, but needs something this importer lacks.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file as given.
        path: PathBuf,
        /// What is missing, and what to do.
        what: String,
    },
    /// An image that exists cannot be decoded.
    #[error("{}: cannot decode the image {image}: {what}", path.display())]
    Image {
        /// The mesh file that refers to the image.
        path: PathBuf,
        /// Path or number of the image.
        image: String,
        /// What the decoder said.
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
    /// The file was read, but what it holds is not a usable mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file as given.
        path: PathBuf,
        /// The rule that is broken.
        source: MeshError,
    },
}

impl ImportError {
    fn malformed(path: &Path, what: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), what: what.into() }
    }

    fn unsupported(path: &Path, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.into(), what: what.into() }
    }
}

/// Reads a mesh, its materials and its textures.
///
/// The extension decides how (`.obj`, `.gltf`, `.glb`, `.ply`, `.stl`, in any case); the first bytes must agree with it.
/// Anything that could be left out without losing triangles (a missing texture, a skipped line primitive) is noted in
/// [`Mesh::warnings`].
///
/// # Errors
/// See [`ImportError`]. A mesh without triangles, with a vertex that is not finite or an index out of range is an error.
pub fn load_mesh(path: &Path) -> Result<Mesh, ImportError> {
    let kind = Kind::of_extension(path).ok_or_else(|| {
        // A directory without extension deserves the better message.
        if path.is_dir() {
            ImportError::NotAFile { path: path.into() }
        } else {
            ImportError::UnknownKind { path: path.into() }
        }
    })?;
    let bytes = read_file(path)?;
    if bytes.is_empty() {
        return Err(ImportError::Empty { path: path.into() });
    }
    let found = Content::of(&bytes);
    if !kind.allows(found) {
        return Err(ImportError::WrongKind {
            path: path.into(),
            expected: kind.description(),
            found: found.description(),
        });
    }
    let mesh = match kind {
        Kind::Obj => obj::load(path, &bytes)?,
        Kind::Gltf | Kind::Glb => gltf::load(path, bytes)?,
        Kind::Ply => ply::load(path, &bytes)?,
        Kind::Stl => stl::load(path, &bytes)?,
    };
    mesh.validate().map_err(|source| ImportError::Mesh { path: path.into(), source })?;
    Ok(mesh)
}

/// Text as programs save it: UTF-8, or UTF-16 with a byte order mark. What is neither is replaced.
fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    let wide = |word: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes[2..].as_chunks::<2>().0.iter().map(|&pair| word(pair)).collect();
        Cow::Owned(String::from_utf16_lossy(&words))
    };
    match bytes {
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
    }
}

/// Whether [`load_mesh`] knows the extension of `path`.
#[must_use]
pub fn is_mesh_file(path: &Path) -> bool {
    Kind::of_extension(path).is_some()
}

/// Reads an image as a height map of amplitude 1 and bias 0: its luminance, from black at 0 to white at 1.
///
/// # Errors
/// See [`ImportError`].
pub fn load_height_map(image: &Path) -> Result<HeightMap, ImportError> {
    let texture = TextureStore::default().load_heights(image, image, Channel::Luminance)?;
    match texture {
        Some(texture) => Ok(HeightMap { texture, amplitude: 1.0, bias: 0.0, uv_transform: UvTransform::IDENTITY }),
        None => Err(ImportError::Read { path: image.into(), source: io::ErrorKind::NotFound.into() }),
    }
}

/// The whole content of a regular file. Devices and pipes are refused: they need not end.
fn read_file(path: &Path) -> Result<Vec<u8>, ImportError> {
    let metadata = fs::metadata(path).map_err(|source| ImportError::Read { path: path.into(), source })?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile { path: path.into() });
    }
    fs::read(path).map_err(|source| ImportError::Read { path: path.into(), source })
}

/// Kinds of mesh files by extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Obj,
    Gltf,
    Glb,
    Ply,
    Stl,
}

impl Kind {
    fn of_extension(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "gltf" => Some(Self::Gltf),
            "glb" => Some(Self::Glb),
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            _ => None,
        }
    }

    fn description(self) -> &'static str {
        match self {
            Self::Obj => "an OBJ text file",
            Self::Gltf => "a glTF JSON file",
            Self::Glb => "a binary glTF file",
            Self::Ply => "a PLY file",
            Self::Stl => "an STL file",
        }
    }

    fn allows(self, content: Content) -> bool {
        match self {
            Self::Obj => matches!(content, Content::Text | Content::Utf16),
            // Text that does not start as JSON goes to the JSON parser, whose message tells the line and column.
            Self::Gltf => matches!(content, Content::Json | Content::Text | Content::Glb),
            Self::Glb => content == Content::Glb,
            Self::Ply => content == Content::Ply,
            // The header of a binary file may say anything.
            Self::Stl => matches!(content, Content::Text | Content::Json | Content::Binary),
        }
    }
}

/// What the first bytes of a file look like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Png,
    Jpeg,
    Archive,
    Glb,
    Ply,
    Json,
    Text,
    Utf16,
    Binary,
}

impl Content {
    fn of(bytes: &[u8]) -> Self {
        let head = &bytes[..bytes.len().min(4096)];
        let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
        if head.starts_with(b"\x89PNG") {
            Self::Png
        } else if head.starts_with(b"\xff\xd8\xff") {
            Self::Jpeg
        } else if head.starts_with(b"PK\x03\x04")
            || head.starts_with(b"\x1f\x8b")
            || head.starts_with(b"\x28\xb5\x2f\xfd")
        {
            Self::Archive
        } else if head.starts_with(b"glTF") {
            Self::Glb
        } else if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") || head.starts_with(b"ply ") {
            Self::Ply
        } else if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
            Self::Utf16
        } else if head.contains(&0) {
            Self::Binary
        } else if text.trim_ascii_start().starts_with(b"{") {
            Self::Json
        } else {
            Self::Text
        }
    }

    fn description(self) -> &'static str {
        match self {
            Self::Png => "a PNG image",
            Self::Jpeg => "a JPEG image",
            Self::Archive => "a compressed archive",
            Self::Glb => "a binary glTF file",
            Self::Ply => "a PLY file",
            Self::Json => "JSON text",
            Self::Text => "a text file",
            Self::Utf16 => "UTF-16 text",
            Self::Binary => "a binary file",
        }
    }
}

/// A message of a library as one line of bounded length, fit for the end of our own.
fn one_line(message: impl ToString) -> String {
    const LIMIT: usize = 240;
    let message = message.to_string();
    let joined = message.split_whitespace().collect::<Vec<_>>().join(" ");
    let printable: String = joined.chars().filter(|c| !c.is_control()).collect();
    match printable.char_indices().nth(LIMIT) {
        Some((cut, _)) => format!("{}...", &printable[..cut]),
        None => printable,
    }
}
