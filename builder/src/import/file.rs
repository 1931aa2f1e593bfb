//! Reads files as bytes and text, and finds out the kind of a mesh file by its extension and by its content.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::error::ImportError;

/// Opens a regular file, and says how many bytes it has. Devices and pipes are refused: they may never end.
pub(super) fn open(path: &Path) -> Result<(File, u64), ImportError> {
    let failed = |source| ImportError::Read { path: path.into(), source };
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile { path: path.into() });
    }
    Ok((File::open(path).map_err(failed)?, metadata.len()))
}

/// The whole content of a regular file.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, ImportError> {
    let (mut file, length) = open(path)?;
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    file.read_to_end(&mut bytes).map_err(|source| ImportError::Read { path: path.into(), source })?;
    Ok(bytes)
}

/// A format of mesh files or of voxel models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0 as JSON.
    Gltf,
    /// glTF 2.0 in a binary container.
    Glb,
    /// PLY, text or binary.
    Ply,
    /// STL, text or binary.
    Stl,
    /// A voxel model of MagicaVoxel.
    Vox,
}

impl Format {
    /// The format that the extension of a file stands for, in any case.
    #[must_use]
    pub fn of_extension(path: &Path) -> Option<Self> {
        Self::of_name(path.extension()?.to_str()?)
    }

    /// The format with this name, which is the extension of its files, in any case.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        match name.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "gltf" => Some(Self::Gltf),
            "glb" => Some(Self::Glb),
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "vox" => Some(Self::Vox),
            _ => None,
        }
    }

    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Obj => "an OBJ text file",
            Self::Gltf => "a glTF JSON file",
            Self::Glb => "a binary glTF file",
            Self::Ply => "a PLY file",
            Self::Stl => "an STL file",
            Self::Vox => "a voxel model of MagicaVoxel",
        }
    }

    pub(super) fn allows(self, content: Content) -> bool {
        match self {
            Self::Obj => matches!(content, Content::Text | Content::Utf16),
            // Text that does not start like JSON goes to the JSON parser: its message contains line and column.
            Self::Gltf => matches!(content, Content::Json | Content::Text | Content::Glb),
            Self::Glb => content == Content::Glb,
            Self::Ply => content == Content::Ply,
            // The header of a binary file may contain any text.
            Self::Stl => matches!(content, Content::Text | Content::Utf16 | Content::Json | Content::Binary),
            Self::Vox => content == Content::Vox,
        }
    }
}

/// The kind of a file by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Png,
    Jpeg,
    Archive,
    Glb,
    Ply,
    Vox,
    Json,
    Text,
    Utf16,
    Binary,
}

impl Content {
    pub(super) fn of(bytes: &[u8]) -> Self {
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
        } else if head.starts_with(b"VOX ") {
            Self::Vox
        } else if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") || text.starts_with(b"ply ") {
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

    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Png => "a PNG image",
            Self::Jpeg => "a JPEG image",
            Self::Archive => "a compressed archive",
            Self::Glb => "a binary glTF file",
            Self::Ply => "a PLY file",
            Self::Vox => "a voxel model of MagicaVoxel",
            Self::Json => "JSON text",
            Self::Text => "a text file",
            Self::Utf16 => "UTF-16 text",
            Self::Binary => "a binary file",
        }
    }
}

/// Decodes text: UTF-8, or UTF-16 with a byte order mark. Invalid sequences are replaced. Line ends of CR alone, as Mac OS 9
/// wrote them, become LF.
pub(super) fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    let wide = |word: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes[2..].as_chunks::<2>().0.iter().map(|&pair| word(pair)).collect();
        Cow::Owned(String::from_utf16_lossy(&words))
    };
    let text: Cow<'_, str> = match bytes {
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
    };
    let alone = |(at, _): (usize, &str)| text.as_bytes().get(at + 1) != Some(&b'\n');
    if text.match_indices('\r').any(alone) { Cow::Owned(text.replace("\r\n", "\n").replace('\r', "\n")) } else { text }
}
